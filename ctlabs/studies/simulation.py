"""Many simulated runs of a model, filtered, against the theory of their errors: ``ctlabs simulate``."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from ctlabs import montecarlo
from ctlabs.analysis import sensitivity
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import agreement
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import deviations
from ctlabs.reporting import plots
from ctlabs.reporting.plots.studies import estimates
from ctlabs.studies import common
from ctlabs.text import _, fill, number

if TYPE_CHECKING:
    from ctlabs.files.modelfile import ModelFile
    from ctlabs.models import DiscreteModel
    from ctlabs.reporting.report import Report

#: Longer runs are drawn without a mark at every step.
MANY = 200


def study(
    model: ModelFile,
    *,
    design: ModelFile | None = None,
    runs: int | None = None,
    seed: int | None = None,
    steps: int | None = None,
    workers: int | None = None,
    csv_runs: int = 0,
) -> Report:
    """Simulate ``model``, filter with it or with ``design``, and compare the errors with their theory.

    Parameters
    ----------
    model : the truth · design : the filter's model, where it is another one; its states stand for those of the same name
    runs, seed, steps : of the experiment; the model file's where not given
    workers : blocks of runs computed at a time, all cores by default; no number depends on it
    csv_runs : how many runs go to ``runs.csv``; the first one's measurements then go to ``data.csv`` too

    Raises
    ------
    ValueError
        A design whose measurements or states are not the model's.
    FloatingPointError
        An unstable model overflows: the step is in the message.
    """
    plan = model.experiment
    runs, steps = runs or plan.runs, steps or plan.steps
    seed = plan.seed if seed is None else seed
    truth = common.discrete(model, steps)
    if csv_runs:
        common.distinct("runs.csv", _columns(truth))
    given = common.settings(
        model,
        ("dt", truth.dt, "s", _("period")),
        ("steps", steps, "1", _("steps of each run")),
        ("first", plan.first, "1", _("index of the first measurement")),
    )
    report = common.begin("simulate", _("simulation"), model, "abc", given, runs=runs, seed=seed)
    experiment = Experiment(runs, seed, workers)
    report.section("a", _("The model that is simulated"))
    common.show(report, truth)
    if design is None:
        _consistent(report, experiment, truth, steps, plan.first)
    else:
        _mismatched(report, experiment, truth, common.discrete(design, steps), steps, plan.first)
    if csv_runs:
        _csv(report, experiment, truth, steps, csv_runs, plan.first)
    return report


def _consistent(report: Report, experiment: Experiment, model: DiscreteModel, steps: int, first: int) -> None:
    """The model's own filter."""
    report.section("b", _("The optimal filter on simulated data"))
    model = dataclasses.replace(model, units=tuple(unit or "1" for unit in model.units))
    schedule = covariances(model, steps, first)
    some = experiment.histories(model, steps=steps, first=first)
    stats = experiment.statistics(model, steps=steps, first=first)
    assert some.truth is not None
    for i, (name, unit) in enumerate(list(zip(model.states, model.units, strict=True))[: common.SHOWN]):
        measured = common.measured(model, i)
        figure = estimates(
            some.t,
            {_("estimate"): (some.x_plus[:, i, 0], schedule.sd_plus[:, i])},
            data=None if measured is None else some.z[:, measured, 0],
            truth=some.truth[:, i, 0],
            ylabel=common.label(name, unit),
        )
        report.figure(
            f"record_{i + 1}", figure, _("One run: truth and estimate of {name} with its ±σ band."), name=name
        )
    gains = {
        common.label(name if model.m == 1 else f"{name} ← {measurement}"): schedule.K[first:, i, j]
        for i, name in enumerate(model.states[: common.SHOWN])
        for j, measurement in enumerate(model.measurements)
    }
    figure = plots.lines(
        schedule.t[first:], gains, xlabel="t, s", ylabel=_("gain K"), marker="." if steps <= MANY else ""
    )
    report.figure("gain", figure, _("The gain, known before any measurement."))
    wide = common.wide(schedule.sd_plus)
    draw = plots.ensemble_log if wide else plots.ensemble_against_theory
    names = [common.label(name) for name in model.states]
    report.figure(
        "ensemble",
        draw(stats, schedule.P_plus, xlabel="t, s", units=model.units, names=names),
        _(
            "RMS and mean of the filtering errors of {runs} runs against theory, in the bands of 95 % of ensembles; NEES and NIS averaged over the runs."
        ),
        runs=experiment.runs,
    )
    worst = agreement(report, "", stats, schedule.P_plus)
    report.says(
        _("The largest deviation of the ensemble from theory, over all tests, is {worst} standard errors."), worst=worst
    )
    report.section("c", _("The errors at the end"))
    _errors(report, model, stats, {_("σ of theory"): schedule.sd_plus[-1]})
    report.value("rms_theory", schedule.sd_plus[-1], common.units(model))
    _consistency(report, stats)
    worst = common.delicacy(schedule.P_minus, schedule.P_plus, schedule.S, MANY)
    if not report.passed and not worst < common.SINGULAR:
        text = _(
            "The failed checks are rounding, which the nearly singular covariances magnify {worst}: simulated runs are filtered in Joseph's form. `ctlabs compare` shows the forms that keep their digits; take one of them for `filter --algorithm`."
        )
        report.value(
            "advice",
            fill(text, worst=fill(_("{by} times"), by=number(worst, 2)) if worst < np.inf else _("without bound")),
        )
        report.says("{advice}", advice=report.values["advice"].value)


def _mismatched(
    report: Report, experiment: Experiment, truth: DiscreteModel, design: DiscreteModel, steps: int, first: int
) -> None:
    """Another model's filter on the data of the truth."""
    E = common.stands_for(truth, design)
    report.says(_("The filter believes in another model:"))
    common.show(report, design)
    actual = sensitivity.actual(truth, design, steps, compare=E, first=first)
    best = covariances(truth, steps, first)
    optimal = deviations(E @ best.P_plus @ E.T)
    true = deviations(actual.mse_plus)
    claimed = actual.claimed.sd_plus
    report.section("b", _("The wrong filter on simulated data"))
    common.cost(report, design, actual.t, claimed, true, optimal)
    stats = experiment.statistics(truth, design, steps=steps, compare=E, first=first)
    figure = plots.ensemble_against_theory(
        stats, actual.P_plus, xlabel="t, s", units=design.units, names=[common.label(name) for name in design.states]
    )
    report.figure(
        "ensemble",
        figure,
        _(
            "RMS and mean of the filtering errors of {runs} runs against the theory of a filter without bias; NEES and NIS lie in their bands only where the filter's claims are right."
        ),
        runs=experiment.runs,
    )
    agreement(report, "", stats, actual.P_plus, actual.bias_plus, consistent=False)
    report.section("c", _("The errors at the end"))
    columns = {_("claimed"): claimed[-1], _("true"): true[-1], _("optimal"): optimal[-1]}
    _errors(report, design, stats, columns)
    report.value("bias_theory", actual.bias_plus[-1], common.units(design))
    _consistency(report, stats)


def _errors(report: Report, model: DiscreteModel, stats: montecarlo.Statistics, theory: dict[str, Array]) -> None:
    """The ensemble's errors after the last update beside theory."""
    columns = {
        **theory,
        _("RMS"): stats.rms[-1],
        _("its standard error"): stats.rms_se[-1],
        _("mean error"): stats.bias[-1],
    }
    common.states_table(report, "errors", model, columns, _("Errors after the last update, theory and ensemble."))
    unit = common.units(model)
    report.value("rms", stats.rms[-1], unit)
    report.value("bias", stats.bias[-1], unit)


def _consistency(report: Report, stats: montecarlo.Statistics) -> None:
    """NEES and NIS averaged over time, with the share of steps inside the 95 % bands."""
    for what, average, dof, band in (
        ("nees", stats.nees, stats.nees_dof, stats.nees_band()),
        ("nis", stats.nis, stats.nis_dof, stats.nis_band()),
    ):
        counted = dof > 0
        if not counted.any():
            continue
        inside = (average[counted] >= band[0][counted]) & (average[counted] <= band[1][counted])
        report.value(f"{what}_mean", float(average[counted].mean()))
        report.value(f"{what}_expected", float(dof[counted].mean()))
        report.value(f"{what}_inside_band", float(inside.mean()))


def _columns(truth: DiscreteModel) -> list[str]:
    """Of runs.csv; a measurement that is called as a state is told from it."""
    measured = (f"measured_{name}" if name in {"t", *truth.states} else name for name in truth.measurements)
    return ["run", "k", "t", *truth.states, *measured]


def _csv(report: Report, experiment: Experiment, truth: DiscreteModel, steps: int, runs: int, first: int) -> None:
    """The first runs as tables: everything in runs.csv, the measurements of the first one in data.csv."""
    some = experiment.histories(truth, steps=steps, runs=runs, first=first)
    assert some.truth is not None
    known = truth.measurement_offset  # Du and the offset, which move no error and are no part of the histories
    measured = some.z if known is None else some.z + np.broadcast_to(known, some.z.shape[:2])[:, :, None]
    rows = (
        [run + 1, k, t, *x, *z]
        for run in range(runs)
        for k, (t, x, z) in enumerate(
            zip(some.t.tolist(), some.truth[:, :, run].tolist(), measured[:, :, run].tolist(), strict=True)
        )
    )
    report.csv("runs", _columns(truth), rows)
    timed = "t" not in truth.measurements  # a measurement of that name: the rows are one period apart anyway
    data = ([t, *z][not timed :] for t, z in zip(some.t[first:].tolist(), measured[first:, :, 0].tolist(), strict=True))
    report.csv("data", ["t", *truth.measurements][not timed :], data)
    report.says(
        _(
            "`runs.csv` holds {runs} runs, states and measurements; `data.csv` the measurements of the first one, as `ctlabs filter` reads them."
        ),
        runs=runs,
    )
