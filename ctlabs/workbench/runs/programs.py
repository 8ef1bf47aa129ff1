"""The Python lines, and the commands, that give an experiment's numbers again: they need nothing but the library."""

from __future__ import annotations

import shlex
from pprint import pformat

import ctlabs
from ctlabs.files.modelfile import ModelFile
from ctlabs.labs.experiment import ALGORITHM, Experiment
from ctlabs.workbench.runs.experiments import prepared
from ctlabs.workbench.runs.outcomes import Asked, Outcome, Upload

#: Characters of a record up to which it is in the lines themselves.
LONG = 50_000


def python(name: str, model: str, plan: Asked, found: Outcome) -> str:
    """A program that needs nothing but the library's verbs and prints the experiment's summary as JSON."""
    file, design = files(model, plan)
    imports = {"ctlabs": {"kalman_filter", "read_model"}}
    lines = [
        "folder = Path(tempfile.mkdtemp())",
        f"MODEL = {_literal(file.dumps())}",
        '(folder / "model.toml").write_text(MODEL, encoding="utf-8")',
        'model = read_model(folder / "model.toml")',
    ]
    if design is not None:
        lines += [
            f"DESIGN = {_literal(design.dumps())}",
            '(folder / "design.toml").write_text(DESIGN, encoding="utf-8")',
            'design = read_model(folder / "design.toml")  # what the filter believes',
        ]
    if plan.anomalies:
        imports["ctlabs.models"] = {"Anomaly", "anomalous"}
        changes = pformat([(a.k, a.measurement, a.R, a.last) for a in plan.anomalies], width=100).replace(" inf,", " np.inf,")
        lines += [f"anomalies = [Anomaly(*each) for each in {changes}]  # instant, measurement, variance, last instant"]
    more, body = (_simulation if plan.data is None else _record)(
        plan, found.algorithm, other=design is not None, changed=bool(plan.anomalies)
    )
    for package, verbs in more.items():
        imports.setdefault(package, set()).update(verbs)
    named = [f"from {package} import {', '.join(sorted(verbs, key=str.lower))}" for package, verbs in sorted(imports.items())]
    head = ['"""' + name.replace("\\", "").replace('"', "'") + f'; ctlabs {ctlabs.__version__}."""', ""]
    top = [*head, "import json", "import tempfile", "from pathlib import Path", "", "import numpy as np", "", *named, ""]
    return "\n".join([*top, *lines, *body, "print(json.dumps(numbers, indent=1))", ""])


def _simulation(plan: Asked, algorithm: str, *, other: bool, changed: bool) -> tuple[dict[str, set[str]], list[str]]:
    imports = {"ctlabs": {"monte_carlo", "simulate"}}
    build = "anomalous({}.discrete(steps=steps), anomalies, steps)" if changed else "{}.discrete(steps=steps)"
    lines = [
        f"steps, first, runs = {plan.steps}, {plan.first}, {plan.runs}",
        f"seed = {Experiment(seed=plan.seed).seed_of(0)}  # the random numbers of seed {plan.seed}",
        f"truth = {build.format('model')}",
        "data = simulate(truth, steps, 1, seed, first=first)",
        f"optimal = kalman_filter(truth, data.z, first=first, algorithm={ALGORITHM!r})",
    ]
    design = "wrong" if other else "truth"
    if other:
        imports["ctlabs.analysis"] = {"stands_for"}
        lines += [
            f"wrong = {build.format('design')}",
            "E = stands_for(truth, wrong)  # which states of the truth the filter estimates",
        ]
    lines += [f"run = kalman_filter({design}, optimal.z[first:, :, 0], first=first, algorithm={algorithm!r})"]
    pair, more = ("truth, wrong", ", compare=E") if other else ("truth", "")
    if algorithm == "steady":
        more += ", gains=run"
    lines += [f"statistics = monte_carlo({pair}, steps=steps, runs=runs, seed=seed{more}, first=first, algorithm={ALGORITHM!r})"]
    if other or algorithm == "steady":
        imports["ctlabs"].add("actual_errors")
        best = "E @ optimal.P_plus[-1] @ E.T" if other else "optimal.P_plus[-1]"
        lines += [
            f"actual = actual_errors(truth, {design}, steps{more}, first=first)",
            "columns = {",
            '    "sd_claimed": actual.claimed.sd_plus[-1],',
            '    "rms_theory": np.sqrt(np.diag(actual.mse_plus[-1]).clip(0)),',
            f'    "sd_optimal": np.sqrt(np.diag({best}).clip(0)),',
        ]
    else:
        lines += ["columns = {", '    "sd_theory": optimal.sd_plus[-1],']
    return imports, [*lines, *_summary("design" if other else "model")]


def _summary(used: str) -> list[str]:
    """The numbers of a simulation's summary, from its columns and statistics."""
    return [
        '    "rms": statistics.rms[-1],',
        '    "rms_se": statistics.rms_se[-1],',
        '    "bias": statistics.bias[-1],',
        "}",
        f"states = {used}.states",
        'numbers = {f"{name}[{state}]": float(x) for name, values in columns.items() for state, x in zip(states, values)}',
        'for name, average, dof in (("nees", statistics.nees, statistics.nees_dof), ("nis", statistics.nis, statistics.nis_dof)):',
        "    if (dof > 0).any():",
        '        numbers[f"{name}_mean"] = float(average[dof > 0].mean())',
        '        numbers[f"{name}_expected"] = float(dof[dof > 0].mean())',
        'numbers["log_likelihood_run_1"] = run.log_likelihood',
    ]


def _record(plan: Asked, algorithm: str, *, other: bool, changed: bool) -> tuple[dict[str, set[str]], list[str]]:
    assert plan.data is not None
    imports = {"ctlabs": {"diagnose", "read_record"}, "ctlabs.files": {"timed"}}
    used = "design" if other else "model"
    lines = [
        *_data(plan.data),
        f"first = {plan.first}",
        f"record = read_record(file, {used})",
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
        lines += [
            "truth, z_truth, t = timed(model, read_record(file, model))",
            *(["truth = anomalous(truth, anomalies, len(z) - 1)"] if changed else []),
            'numbers["log_likelihood_of_the_other_model"] = kalman_filter(truth, z_truth[first:], first=first).log_likelihood',
        ]
    lines += [
        "if np.isfinite(found.innovation).any():",
        "    verdict = diagnose(discrete, found, first=first)",
        '    numbers |= {"nis_mean": verdict.nis_mean, "nis_expected": verdict.nis_expected}',
        '    numbers |= {"nis_p": verdict.nis_p, "verdict": verdict.verdict}',
    ]
    return imports, lines


def _data(data: Upload) -> list[str]:
    """Where the record is: in the lines themselves, or a long one beside them."""
    if len(data.text) > LONG:
        return [f"file = Path({data.name!r})  # the record, in the present folder"]
    return [
        f"DATA = {_literal(data.text)}",
        f"file = folder / {_plain(data.name)!r}",
        'file.write_text(DATA, encoding="utf-8", newline="")',
    ]


def commands(name: str, model: str, plan: Asked, found: Outcome) -> str:
    """The commands that do the same with the model file and the record in the present folder."""
    file, design = files(model, plan)
    beside = "" if design is None else "; design.toml: what the filter believes"
    lines = [f"# {' '.join(name.split())}", f"# model.toml: the model file{beside}"]
    if file.dumps() != model:
        lines.append(f"# in [experiment] of model.toml: first = {plan.first}")
    if plan.anomalies:
        lines.append("# the anomalies have no option of these commands; the Python lines have them")
    other = [] if design is None else ["--design", "design.toml"]
    said = [["ctlabs", "analyse", "model.toml"]]
    several = ["--algorithms", ",".join(plan.algorithms)]
    if plan.data is None:
        settings = ["--seed", str(plan.seed), "--steps", str(plan.steps)]
        count = str(found.x_plus.shape[2])
        said.append(["ctlabs", "simulate", "model.toml", *other, "--runs", str(plan.runs), *settings, "--csv", count, "--out", "simulated"])
        if len(plan.algorithms) > 1:
            said.append(["ctlabs", "compare", "model.toml", *several, *settings, "--out", "compared"])
    else:
        data, own = _plain(plan.data.name), ["--algorithm", found.algorithm]
        said.append(["ctlabs", "look", data, "model.toml"])
        rest = ["--smooth", "--table", "estimates.csv", "--export", "gains.npz", "--out", "filtered"]
        said.append(["ctlabs", "filter", "model.toml", data, *own, *other, *rest])
        if len(plan.algorithms) > 1:
            said.append(["ctlabs", "compare", "model.toml", data, *several, "--out", "compared"])
    return "\n".join([*lines, *(shlex.join(each) for each in said), ""])


def _plain(name: str) -> str:
    """The name of a file without what would lead into another folder, or be taken for an option."""
    return name.replace("/", "_").replace("\\", "_").lstrip("-.") or "data.csv"


def _literal(text: str) -> str:
    """A text as Python writes it: as it stands where that is possible."""
    plain = text.replace("\n", "").isprintable() and "\\" not in text and '"""' not in text and not text.endswith('"')
    if plain:
        return f'"""\\\n{text}"""'
    return "(\n" + "".join(f"    {line!r}\n" for line in text.splitlines(keepends=True)) + ")"


def files(model: str, plan: Asked) -> tuple[ModelFile, ModelFile | None]:
    """Truth and design, with the plan's first measurement."""
    return prepared(model, "", plan), None if plan.design is None else prepared(plan.design, "", plan)
