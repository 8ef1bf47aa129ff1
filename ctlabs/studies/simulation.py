"""Many simulated runs of a model, filtered, against the theory of their errors: ``ctlabs simulate``, and the workbench's experiments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ctlabs import montecarlo
from ctlabs.analysis import sensitivity
from ctlabs.analysis.naming import stands_for
from ctlabs.filtering.results import Covariances, Filtered
from ctlabs.labs.experiment import Experiment
from ctlabs.labs.portrait import agreement
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import deviations
from ctlabs.models.anomalies import Anomaly, anomalous
from ctlabs.reporting import plots
from ctlabs.reporting.plots.studies import estimates, gains
from ctlabs.reporting.report import Report
from ctlabs.studies import common
from ctlabs.studies.comparison import Attempt, tried, working
from ctlabs.text import _, fill, number

if TYPE_CHECKING:
    from ctlabs.files.modelfile import ModelFile
    from ctlabs.models import DiscreteModel

#: The runs that are kept with their histories, and the condition numbers that are looked at.
HISTORIES, MANY = 25, 200


@dataclass(frozen=True, slots=True, eq=False)
class Simulated:
    """Runs of a model through a filter, and their theory.

    ``file``, and that of the filter, ``other``, where it believes in another model · ``truth``, ``design`` : the models · ``E`` (d, n),
    which states of the truth the design's stand for · ``experiment``, ``first`` · ``some`` : a few runs with their histories, through
    the truth's own filter · ``stats`` over all runs · ``claimed``, what the filter says of itself, and ``P`` (steps+1, d, d), the
    covariance of its errors · ``actual``, their theory, and ``optimal`` (steps+1, d), the σ of the right filter, where it is another
    one · ``tried``, the first of ``some`` by other forms
    """

    file: ModelFile
    other: ModelFile | None
    truth: DiscreteModel
    design: DiscreteModel
    E: Array
    experiment: Experiment
    first: int
    some: Filtered
    stats: montecarlo.Statistics
    claimed: Covariances
    P: Array
    actual: sensitivity.Actual | None
    optimal: Array | None
    tried: dict[str, Attempt]

    @property
    def true(self) -> Array:
        """The truth of ``some`` in the design's states, (steps+1, d, runs)."""
        assert self.some.truth is not None
        return np.einsum("di,kir->kdr", self.E, self.some.truth)

    @property
    def steps(self) -> int:
        """Of each run."""
        return len(self.some.t) - 1

    @property
    def summary(self) -> dict[str, tuple[Any, str]]:
        """The numbers to copy: value and unit by name."""
        stats, claimed, used = self.stats, self.claimed.sd_plus[-1], self.other or self.file
        columns = {"rms": stats.rms[-1], "rms_se": stats.rms_se[-1], "bias": stats.bias[-1]}
        if self.actual is not None and self.optimal is not None:
            columns = {"sd_claimed": claimed, "rms_theory": deviations(self.actual.mse_plus[-1]), "sd_optimal": self.optimal[-1]} | columns
        else:
            columns = {"sd_theory": claimed} | columns
        found: dict[str, tuple[Any, str]] = {
            f"{name}[{state}]": (float(value), unit)
            for name, values in columns.items()
            for state, unit, value in zip(used.states, used.units, values, strict=True)
        }
        for name, (average, dof, _band) in self.consistency.items():
            found[f"{name}_mean"], found[f"{name}_expected"] = (float(average.mean()), ""), (float(dof.mean()), "")
        if self.tried:
            found["log_likelihood_run_1"] = float(working(self.tried)[1].log_likelihood[0]), ""
        return found

    @property
    def consistency(self) -> dict[str, tuple[Array, Array, Array]]:
        """NEES and NIS where there are any: averages over the runs, their expectations, and bands (2, ·) of 95 %."""
        stats = self.stats
        rows = {"nees": (stats.nees, stats.nees_dof, stats.nees_band()), "nis": (stats.nis, stats.nis_dof, stats.nis_band())}
        return {name: (a[dof > 0], dof[dof > 0], np.array(band)[:, dof > 0]) for name, (a, dof, band) in rows.items() if (dof > 0).any()}


def compute(
    model: ModelFile,
    *,
    design: ModelFile | None = None,
    runs: int | None = None,
    seed: int | None = None,
    steps: int | None = None,
    first: int | None = None,
    anomalies: Sequence[Anomaly] = (),
    algorithms: Sequence[str] = (),
    histories: int = HISTORIES,
    workers: int | None = None,
    progress: Any = None,
) -> Simulated:
    """Simulate ``model``, and filter with it or with ``design``.

    Parameters
    ----------
    model : the truth · design : the filter's model, where it is another one; its states stand for those of the same name
    runs, seed, steps, first : of the experiment; the model file's where not given
    anomalies : other variances of measurements at some instants
    algorithms : forms by which the runs with ``histories`` are filtered too; a constant gain, "steady", is that of all runs where it
        is the first that works
    workers : blocks of runs computed at a time, all cores by default; no number depends on it · progress : see
        :func:`ctlabs.monte_carlo`

    Raises
    ------
    ValueError
        A design whose measurements or states are not the model's; no algorithm works.
    FloatingPointError
        An unstable model overflows: the step is in the message.
    """
    plan = model.experiment
    steps, first = steps or plan.steps, plan.first if first is None else first
    experiment = Experiment(runs or plan.runs, plan.seed if seed is None else seed, workers)
    truth = anomalous(model.discrete(steps=steps), anomalies, steps)
    wrong = None if design is None else anomalous(design.discrete(steps=steps), anomalies, steps)
    E = np.eye(truth.n) if wrong is None else stands_for(truth, wrong)
    some = experiment.histories(truth, steps=steps, runs=histories, first=first)
    attempts = tried(wrong or truth, some.z[first:], algorithms, first)
    constant = None
    if attempts:
        name, filtered = working(attempts)
        constant = filtered if name == "steady" else None
    actual = optimal = None
    if wrong is not None or constant is not None:
        actual = sensitivity.actual(truth, wrong or truth, steps, compare=E, gains=constant, first=first)
        optimal = deviations(E @ some.P_plus @ E.T)
    stats = experiment.statistics(truth, wrong, steps=steps, compare=E, gains=constant, first=first, progress=progress)
    claimed, P = (some, some.P_plus) if actual is None else (actual.claimed, actual.P_plus)
    return Simulated(model, design, truth, wrong or truth, E, experiment, first, some, stats, claimed, P, actual, optimal, attempts)


# The report ----------------------------------------------------------------------------------------------------------


def study(model: ModelFile, *, csv_runs: int = 0, **more: Any) -> Report:
    """:func:`compute` as a report; ``csv_runs``, how many runs go to ``runs.csv``, the first one's measurements then to ``data.csv``."""
    if csv_runs:
        common.distinct("runs.csv", _columns(model.states, model.measurements))
    return report(compute(model, histories=max(csv_runs, HISTORIES), **more), csv_runs)


def report(found: Simulated, csv_runs: int = 0) -> Report:
    """The runs in figures, tests and tables."""
    given = common.settings(
        found.file,
        ("dt", found.truth.dt, "s", _("period")),
        ("steps", found.steps, "1", _("steps of each run")),
        ("first", found.first, "1", _("index of the first measurement")),
    )
    experiment = found.experiment
    made = common.begin("simulate", _("simulation"), found.file, "abc", given, runs=experiment.runs, seed=experiment.seed)
    made.section("a", _("The model that is simulated"))
    common.show(made, found.truth)
    (_consistent if found.actual is None else _mismatched)(made, found)
    if csv_runs:
        _csv(made, found, csv_runs)
    return made


def _consistent(report: Report, found: Simulated) -> None:
    """The model's own filter."""
    report.section("b", _("The optimal filter on simulated data"))
    model, some, stats, first = found.truth, found.some, found.stats, found.first
    units = tuple(unit or "1" for unit in model.units)
    assert some.truth is not None
    for i, (name, unit) in enumerate(list(zip(model.states, model.units, strict=True))[: common.SHOWN]):
        measured = common.measured(model, i)
        figure = estimates(
            some.t,
            {_("estimate"): (some.x_plus[:, i, 0], some.sd_plus[:, i])},
            data=None if measured is None else some.z[:, measured, 0],
            truth=some.truth[:, i, 0],
            ylabel=common.label(name, unit),
        )
        report.figure(
            f"record_{i + 1}", figure, _("One run: truth and estimate of {name} with its ±σ band."), name=name
        )
    shown = slice(common.SHOWN)
    states = dict(zip(model.states[shown], model.units, strict=False))
    sensors = dict(zip(model.measurements, found.file.measurement_units, strict=True))
    report.figure("gain", gains(some.t[first:], some.K[first:, shown], states, sensors), _("The gain, known before any measurement."))
    draw = plots.ensemble_log if common.wide(some.sd_plus) else plots.ensemble_against_theory
    names = [common.label(name) for name in model.states]
    report.figure(
        "ensemble",
        draw(stats, found.P, xlabel="t, s", units=units, names=names),
        _(
            "RMS and mean of the filtering errors of {runs} runs against theory, in the bands of 95 % of ensembles; NEES and NIS averaged over the runs."
        ),
        runs=stats.runs,
    )
    worst = agreement(report, "", stats, found.P)
    report.says(
        _("The largest deviation of the ensemble from theory, over all tests, is {worst} standard errors."), worst=worst
    )
    report.section("c", _("The errors at the end"))
    _errors(report, model, stats, {_("σ of theory"): some.sd_plus[-1]})
    report.value("rms_theory", some.sd_plus[-1], common.units(model))
    _consistency(report, found)
    worst = common.delicacy(some.P_minus, some.P_plus, some.S, MANY)
    if not report.passed and not worst < common.SINGULAR:
        text = _(
            "The failed checks are rounding, which the nearly singular covariances magnify {worst}: simulated runs are filtered in Joseph's form. `ctlabs compare` shows the forms that keep their digits; take one of them for `filter --algorithm`."
        )
        report.value(
            "advice",
            fill(text, worst=fill(_("{by} times"), by=number(worst, 2)) if worst < np.inf else _("without bound")),
        )
        report.says("{advice}", advice=report.values["advice"].value)


def _mismatched(report: Report, found: Simulated) -> None:
    """Another model's filter on the data of the truth."""
    actual, design, stats = found.actual, found.design, found.stats
    assert actual is not None
    assert found.optimal is not None
    if found.other is not None:
        report.says(_("The filter believes in another model:"))
        common.show(report, design)
    true, claimed = deviations(actual.mse_plus), found.claimed.sd_plus
    report.section("b", _("The wrong filter on simulated data"))
    common.cost(report, design, actual.t, claimed, true, found.optimal)
    figure = plots.ensemble_against_theory(
        stats, actual.P_plus, xlabel="t, s", units=design.units, names=[common.label(name) for name in design.states]
    )
    report.figure(
        "ensemble",
        figure,
        _(
            "RMS and mean of the filtering errors of {runs} runs against the theory of a filter without bias; NEES and NIS lie in their bands only where the filter's claims are right."
        ),
        runs=stats.runs,
    )
    agreement(report, "", stats, actual.P_plus, actual.bias_plus, consistent=False)
    report.section("c", _("The errors at the end"))
    columns = {_("claimed"): claimed[-1], _("true"): true[-1], _("optimal"): found.optimal[-1]}
    _errors(report, design, stats, columns)
    report.value("bias_theory", actual.bias_plus[-1], common.units(design))
    _consistency(report, found)


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


def _consistency(report: Report, found: Simulated) -> None:
    """NEES and NIS averaged over time, with the share of steps inside the 95 % bands."""
    for what, (average, dof, (low, high)) in found.consistency.items():
        report.value(f"{what}_mean", float(average.mean()))
        report.value(f"{what}_expected", float(dof.mean()))
        report.value(f"{what}_inside_band", float(((average >= low) & (average <= high)).mean()))


def _columns(states: Sequence[str], measurements: Sequence[str]) -> list[str]:
    """Of runs.csv; a measurement that is called as a state is told from it."""
    return ["run", "k", "t", *states, *(f"measured_{name}" if name in {"t", *states} else name for name in measurements)]


def _csv(report: Report, found: Simulated, runs: int) -> None:
    """The first runs as tables: everything in runs.csv, the measurements of the first one in data.csv."""
    some, first, names = found.some, found.first, found.truth.measurements
    assert some.truth is not None
    known = found.truth.measurement_offset  # Du and the offset, which move no error and are no part of the histories
    measured = some.z if known is None else some.z + np.broadcast_to(known, some.z.shape[:2])[:, :, None]
    rows = (
        [run + 1, k, t, *x, *z]
        for run in range(runs)
        for k, (t, x, z) in enumerate(
            zip(some.t.tolist(), some.truth[:, :, run].tolist(), measured[:, :, run].tolist(), strict=True)
        )
    )
    report.csv("runs", _columns(found.truth.states, names), rows)
    timed = "t" not in names  # a measurement of that name: the rows are one period apart anyway
    data = ([t, *z][not timed :] for t, z in zip(some.t[first:].tolist(), measured[first:, :, 0].tolist(), strict=True))
    report.csv("data", ["t", *names][not timed :], data)
    report.says(
        _(
            "`runs.csv` holds {runs} runs, states and measurements; `data.csv` the measurements of the first one, as `ctlabs filter` reads them."
        ),
        runs=runs,
    )
