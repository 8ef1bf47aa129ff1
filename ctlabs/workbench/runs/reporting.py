"""An experiment as a report."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from ctlabs.files import timed
from ctlabs.files.modelfile import ModelFile
from ctlabs.filtering import steady
from ctlabs.filtering.engines import adapter
from ctlabs.filtering.filter import kalman_filter
from ctlabs.models import anomalous
from ctlabs.reporting.report import Report
from ctlabs.studies import common, comparison, second
from ctlabs.workbench.runs.figures import pictures
from ctlabs.workbench.runs.outcomes import Asked, Outcome
from ctlabs.workbench.runs.programs import files, python

#: The second route of a report's check goes over so many steps.
CHECKED = 1000


def report(name: str, model: str, plan: Asked, found: Outcome) -> Report:
    """The experiment as a report: model, estimates, errors, innovations, algorithms, and the lines that give it again."""
    file, design = files(model, plan)
    steps: tuple[str, Any, str, str] = ("steps", plan.steps, "1", "steps of each run")
    given = common.settings(
        file,
        ("algorithm", found.algorithm, "", "form of the filter"),
        steps if plan.data is None else ("data", plan.data.name, "", "the measured record"),
        ("first", plan.first, "1", "index of the first measurement"),
    )
    runs, seed = (plan.runs, plan.seed) if plan.data is None else (0, 0)
    made = common.begin("workbench", name, file, "abcde", given, runs=runs, seed=seed)
    made.meta = {**made.meta, "title": " ".join(name.split()), "source": "ctlabs workbench"}
    made.section("a", "The model")
    _model(made, file)
    if design is not None:
        made.says("The filter believes in another model:")
        _model(made, design)
    for anomaly in plan.anomalies:
        where = f"k = {anomaly.k}" + (f" to {anomaly.last}" if anomaly.last is not None else "")
        words = {"name": found.measurements[anomaly.measurement], "R": anomaly.R, "where": where}
        made.says("The variance of {name} is {R} at {where}.", **words)
    for line in (f"**{found.contradiction}**", *found.notes) if found.contradiction else found.notes:
        made.says("{line}", line=line)
    drawn = pictures(found)

    def begin(part: str, title: str, *names: str) -> None:
        made.section(part, title)
        for key, (drawing, caption) in drawn.items():
            if key.startswith(names):
                made.figure(key, drawing, "{caption}", caption=caption)

    begin("b", "Estimates", "estimates_", "gain")
    for key, (value, unit) in found.summary.items():
        known = not isinstance(value, float) or not math.isnan(value)
        made.value(key, value if known else None, unit or "1", reason="" if known else "there is none")
    if plan.data is None:
        begin("c", "Errors", "errors_", "nees")
    _second_route(made, file if design is None else design, plan, found)
    begin("d", "Innovations", "innovations", "autocorrelation")
    _tests(made, found)
    made.section("e", "Algorithms")
    comparison.side_by_side(made, found.algorithms)
    made.says("The Python lines that give these numbers again:")
    made.says("{lines}", lines=f"```python\n{python(name, model, plan, found)}```")
    return made


def _model(made: Report, file: ModelFile) -> None:
    """As it was typed, where it is continuous, and its samples."""
    if file.kind == "continuous" and not file.varying:
        common.show(made, file.continuous())
        made.says("Sampled every {dt} s:", dt=file.dt)
    common.show(made, file.discrete(steps=1))


def _second_route(made: Report, file: ModelFile, plan: Asked, found: Outcome) -> None:
    """The covariances by a square-root form, where rounding lets two forms agree."""
    steps = min(int(found.k[-1]), CHECKED)
    kept = found.k if found.at is None else found.at  # the instants whose covariances are whole
    at = kept[kept <= steps]
    wanted = found.P_plus[: len(at)]
    if not max(common.condition(P) for P in wanted) < common.SINGULAR:
        made.says("The error covariance is nearly singular: forms of the filter differ by their rounding.")
        return
    if plan.data is None:
        whole = anomalous(file.discrete(steps=plan.steps), plan.anomalies, plan.steps)
        z = np.zeros((steps + 1, whole.m))
    else:
        whole, z, _t = timed(file, plan.data.record(file))
        whole, z = anomalous(whole, plan.anomalies, len(z) - 1), z[: steps + 1]
    if found.algorithm == "steady":
        bare = replace(whole, measurement_offset=None)  # which may vary where all else is constant
        again = adapter.update(second.covariance_of_gain(bare, steady.solve(bare)), bare.H, bare.R).P_plus
        made.check("steady error covariance", found.P_plus[-1], again, ("limit", "errors under its gain, 50 digits"))
        return
    if plan.data is None:  # where the truth is not measured, its filter has nothing
        absent = np.isnan(found.z[: len(at), :, 0])
        if len(at) != steps + 1 and absent[plan.first :].any():
            return
        z[at] = np.where(absent, np.nan, 0.0)
    other = kalman_filter(whole.cut(steps), z[plan.first :], first=plan.first, algorithm="array").P_plus[at]
    made.check("error covariances", wanted, other, ("covariance", "square root of it"))


def _tests(made: Report, found: Outcome) -> None:
    own = found.verdict
    if own is None:
        made.says("No element entered the updates, so there are no innovations to test.")
        return
    rows = [
        [name, *(None if math.isnan(p) else float(p) for p in pair)]
        for name, *pair in zip(found.measurements, own.mean_p, own.whiteness_p, strict=True)
    ]
    made.table(
        "tests",
        ["measurement", "p of a zero mean", "p of whiteness"],
        rows,
        "Tests of the first record's innovations: a small p speaks against the model.",
    )
    made.says(
        "The NIS of the first record averages {mean} per instant; a right model's lies between {low} and {high} in 95 % "
        "of records (p = {p}).",
        mean=own.nis_mean, low=own.nis_low, high=own.nis_high, p=own.nis_p,
    )  # fmt: skip
    if own.suggestion:
        made.says("**Verdict:** {suggestion}.", suggestion=own.suggestion.rstrip("."))
