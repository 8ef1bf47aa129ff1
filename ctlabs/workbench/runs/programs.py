"""The Python lines that give an experiment's numbers again: a program that needs nothing but the library."""

from __future__ import annotations

from pprint import pformat

import ctlabs
from ctlabs.files.modelfile import ModelFile
from ctlabs.workbench.runs.experiments import prepared
from ctlabs.workbench.runs.outcomes import Asked, Outcome


def python(name: str, model: str, plan: Asked, found: Outcome) -> str:
    """A program that needs nothing but the library and prints the experiment's summary as JSON."""
    file, design = files(model, plan)
    simulated = plan.data is None
    imports = ["import json", "import numpy as np"]
    imports += ["from ctlabs.files.modelfile import loads"]
    lines = [f"MODEL = {_literal(file.dumps())}", "model = loads(MODEL)"]
    if design is not None:
        lines += [f"DESIGN = {_literal(design.dumps())}", "design = loads(DESIGN)  # what the filter believes"]
    if plan.anomalies:
        imports += ["from ctlabs.models import Anomaly, anomalous"]
        changes = pformat([(a.k, a.measurement, a.R, a.last) for a in plan.anomalies], width=100).replace(" inf,", " np.inf,")
        lines += [f"anomalies = [Anomaly(*each) for each in {changes}]  # instant, measurement, variance, last instant"]
    more, body = (_simulation if simulated else _record)(
        plan, found.algorithm, other=design is not None, changed=bool(plan.anomalies)
    )
    imports += more
    ordered = [line for line in imports if line.startswith("import ") and "numpy" not in line]
    others = [line for line in imports if line not in ordered and "numpy" not in line]
    head = ['"""' + name.replace("\\", "").replace('"', "'") + f'; ctlabs {ctlabs.__version__}."""', ""]
    top = [*head, *sorted(ordered), "", "import numpy as np", "", *sorted(set(others)), ""]
    return "\n".join([*top, *lines, *body, "print(json.dumps(numbers, indent=1))", ""])


def _simulation(plan: Asked, algorithm: str, *, other: bool, changed: bool) -> tuple[list[str], list[str]]:
    imports = ["from ctlabs import kalman_filter", "from ctlabs.labs.experiment import Experiment"]
    build = "anomalous({}.discrete(steps=steps), anomalies, steps)" if changed else "{}.discrete(steps=steps)"
    lines = [f"steps, first = {plan.steps}, {plan.first}", f"truth = {build.format('model')}"]
    lines += [f"experiment = Experiment(runs={plan.runs}, seed={plan.seed})"]
    lines += ["some = experiment.histories(truth, steps=steps, runs=1, first=first)"]
    design = "wrong" if other else "truth"
    if other:
        imports += ["from ctlabs.analysis import stands_for"]
        lines += [
            f"wrong = {build.format('design')}",
            "E = stands_for(truth, wrong)  # which states of the truth the filter estimates",
        ]
    lines += [f"run = kalman_filter({design}, some.z[first:, :, 0], first=first, algorithm={algorithm!r})"]
    pair, more = ("truth, wrong", ", compare=E") if other else ("truth", "")
    if algorithm == "steady":
        more += ", gains=run"
    lines += [f"statistics = experiment.statistics({pair}, steps=steps{more}, first=first)"]
    if other or algorithm == "steady":
        optimal = "E @ some.P_plus[-1] @ E.T" if other else "some.P_plus[-1]"
        lines += [
            f"actual = actual_errors(truth, {design}, steps{more}, first=first)",
            "columns = {",
            '    "sd_claimed": actual.claimed.sd_plus[-1],',
            '    "rms_theory": np.sqrt(np.diag(actual.mse_plus[-1]).clip(0)),',
            f'    "sd_optimal": np.sqrt(np.diag({optimal}).clip(0)),',
        ]
    else:
        lines += ["columns = {", '    "sd_theory": some.sd_plus[-1],']
    if other or algorithm == "steady":
        imports[0] = "from ctlabs import actual_errors, kalman_filter"
    lines += [
        '    "rms": statistics.rms[-1],',
        '    "rms_se": statistics.rms_se[-1],',
        '    "bias": statistics.bias[-1],',
        "}",
        f"states = {'design' if other else 'model'}.states",
        'numbers = {f"{name}[{state}]": float(x) for name, values in columns.items() for state, x in zip(states, values)}',
        'for name, average, dof in (("nees", statistics.nees, statistics.nees_dof), ("nis", statistics.nis, statistics.nis_dof)):',
        "    if (dof > 0).any():",
        '        numbers[f"{name}_mean"] = float(average[dof > 0].mean())',
        '        numbers[f"{name}_expected"] = float(dof[dof > 0].mean())',
        'numbers["log_likelihood_run_1"] = run.log_likelihood',
    ]
    return imports, lines


def _record(plan: Asked, algorithm: str, *, other: bool, changed: bool) -> tuple[list[str], list[str]]:
    assert plan.data is not None
    imports = ["from ctlabs import diagnose, kalman_filter", "from ctlabs.files import reading, timed"]
    used = "design" if other else "model"
    lines = [
        f"DATA = {_literal(plan.data.text)}",
        f"first = {plan.first}",
        f"record = reading.parsed([(DATA.encode(), {plan.data.name!r})], {used})[0]",
        f"discrete, z, t = timed({used}, record)",
        *(["discrete = anomalous(discrete, anomalies, len(z) - 1)"] if changed else []),
        f"found = kalman_filter(discrete, z[first:], first=first, algorithm={algorithm!r})",
        'numbers = {"rows": record.rows, "missing": record.missing}',
        'for name, values in (("estimate", found.x_plus[-1]), ("sd", np.sqrt(np.diag(found.P_plus[-1])))):',
        f"    for state, x in zip({used}.states, values):",
        '        numbers[f"{name}[{state}]"] = float(x)',
        'numbers["log_likelihood"] = found.log_likelihood',
    ]
    if other:
        imports.append("from ctlabs.filtering import log_likelihood")
        lines += [
            "truth, z_truth, t = timed(model, reading.parsed([(DATA.encode(), record.file)], model)[0])",
            *(["truth = anomalous(truth, anomalies, len(z) - 1)"] if changed else []),
            'numbers["log_likelihood_of_the_other_model"] = log_likelihood(truth, z_truth[first:], first)',
        ]
    lines += [
        "if np.isfinite(found.innovation).any():",
        "    verdict = diagnose(discrete, found, first=first)",
        '    numbers |= {"nis_mean": verdict.nis_mean, "nis_expected": verdict.nis_expected}',
        '    numbers |= {"nis_p": verdict.nis_p, "verdict": verdict.verdict}',
    ]
    return imports, lines


def _literal(text: str) -> str:
    """A text as Python writes it: as it stands where that is possible."""
    plain = text.replace("\n", "").isprintable() and "\\" not in text and '"""' not in text and not text.endswith('"')
    if plain:
        return f'"""\\\n{text}"""'
    return "(\n" + "".join(f"    {line!r}\n" for line in text.splitlines(keepends=True)) + ")"


def files(model: str, plan: Asked) -> tuple[ModelFile, ModelFile | None]:
    """Truth and design, with the plan's first measurement."""
    return prepared(model, "", plan), None if plan.design is None else prepared(plan.design, "", plan)
