"""A measured record filtered (and smoothed), and what its innovations say of the model: ``ctlabs filter``."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

import numpy as np

from ctlabs.analysis import diagnosis, sensitivity
from ctlabs.filtering import contradictions, steady
from ctlabs.filtering.filter import covariances, kalman_filter
from ctlabs.filtering.smoothing import Smoothed
from ctlabs.filtering.smoothing import smooth as smooth_
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import deviations
from ctlabs.models import DiscreteModel
from ctlabs.reporting.plots import records as pictures
from ctlabs.reporting.plots.studies import estimates
from ctlabs.reporting.report import SOLVER, Report
from ctlabs.studies import clock, common, second
from ctlabs.text import _, fill

if TYPE_CHECKING:
    from ctlabs.analysis.diagnosis import Diagnosis
    from ctlabs.files.datafile import Record
    from ctlabs.files.modelfile import ModelFile
    from ctlabs.filtering.results import Contradiction, Filtered
    from ctlabs.filtering.smoothing import Smoothed

#: The second route filters at most so many rows (it is a hundred times slower than the first).
CHECKED = 2000
#: All states are conditioned on all measurements at once for so many of them.
CONDITIONED = 120
#: Innovations whose σ is more times the usual one are not drawn.
WIDE = 5
#: Contradictions of which the report has a table.
LISTED = 20
#: Standard deviations whose square is beyond double precision.
ENORMOUS = 1e150
SUFFIXES = (".npz", ".mat", ".h")


class Run(NamedTuple):
    """A record ready to be filtered, and what came of it."""

    model: DiscreteModel
    z: Array
    t: Array
    first: int
    algorithm: str
    filtered: Filtered
    smoothed: Smoothed | None


def study(
    model: ModelFile,
    record: Record,
    *,
    algorithm: str | None = None,
    smooth: bool = False,
    design: ModelFile | None = None,
) -> Report:
    """Filter ``record`` with ``model``, or with ``design`` where ``model`` is only what is thought to be true.

    Parameters
    ----------
    model, record : as read
    algorithm : a form of the filter; the first of the model file's where not given
    smooth : whether every state is also estimated from the whole record
    design : the filter's model, where it is another one

    Raises
    ------
    ValueError
        An algorithm that does not exist or cannot filter the model; times that do not fit it.
    """
    used = model if design is None else design
    if design is not None and (record.u is not None or record.regressors):
        names = ", ".join([*record.mapping.inputs, *record.regressors])
        raise ValueError(f"--design: expected a record without known inputs and regressors, received {names}")
    algorithm = algorithm or used.experiment.algorithms[0]
    run = filtered_run(used, record, algorithm, smooth)
    given = common.settings(
        used,
        ("algorithm", algorithm, "", _("form of the filter")),
        ("dt", run.model.dt, "s", _("period")),
        ("t0", float(run.t[0]), "s", _("time of the initial estimate")),
        ("first", run.first, "1", _("index of the first row of the data")),
    )
    report = common.begin("filter", _("a record filtered"), used, "abcd", given, data=record.source)
    report.section("a", _("Model and data"))
    _data(report, run, record)
    for note in clock.notes(used, record):
        report.says("{note}.", note=note)
    report.section("b", _("Estimates"))
    _estimates(report, run)
    report.section("c", _("What the data say of the model"))
    _verdict(report, run, used.measurement_units)
    if design is not None:
        report.section("d", _("If the other model is the truth"))
        _truth(report, model, run)
    report.csv("estimates", *table(run))
    return report


def add(report: Report, model: ModelFile, record: Record) -> None:
    """A filtered record in another study's report: the figures, the verdict, ``estimates.csv``."""
    run = filtered_run(model, record, "joseph", smooth=False)
    _figures(report, run)
    _verdict(report, run, model.measurement_units)
    report.csv("estimates", *table(run))


def filtered_run(model: ModelFile, record: Record, algorithm: str, smooth: bool) -> Run:
    """The record with its model, filtered."""
    discrete, z, t = clock.timed(model, record)
    first = model.experiment.first
    filtered = kalman_filter(discrete, z[first:], first=first, algorithm=algorithm)
    if not (np.isfinite(filtered.log_likelihood) or filtered.contradictions):
        _refuse(discrete, filtered, algorithm, record, clock.instants(model, record).rows)
    smoothed = smooth_(discrete, filtered) if smooth else None
    return Run(discrete, z, t, first, algorithm, filtered, smoothed)


def _refuse(model: DiscreteModel, filtered: Filtered, algorithm: str, record: Record, rows: Array) -> NoReturn:
    """Say why there is no likelihood: values without measure, or a form that rounding has defeated."""
    sd = np.sqrt(np.diagonal(filtered.S, axis1=1, axis2=2).clip(np.finfo(float).tiny))
    away = np.abs(np.where(np.isfinite(filtered.innovation), filtered.innovation, 0.0)) / sd
    k, i = divmod(int(np.argmax(np.nan_to_num(away))), model.m)
    if away[k, i] > ENORMOUS:
        row, name = rows[k], model.measurements[i]
        msg = (
            f"{record.source}: line {record.lines[row]}, column {name}: expected a value that the model leaves possible, "
            f"received {record.z[row, i]:g}, {away[k, i]:.0e} standard deviations away"
        )
    else:
        msg = f"form {algorithm}: expected finite numbers, received NaN by rounding; take a factorised form: --algorithm ud"
    raise FloatingPointError(msg)


def _data(report: Report, run: Run, record: Record) -> None:
    """What was read, and the model it is filtered with."""
    report.says(
        _("{source}: {rows} rows from t = {start} to {end} s. Measured: {names}. Missing elements: {missing}."),
        source=record.source, rows=record.rows, names=", ".join(run.model.measurements),
        start=float(run.t[run.first]), end=float(run.t[-1]), missing=record.missing,
    )  # fmt: skip
    if record.ignored:
        report.says(_("Columns that were not used: {names}."), names=", ".join(record.ignored))
        report.value("columns_not_used", ", ".join(record.ignored))
    for note in record.notes:
        report.says("**{note}.**", note=note)
    if record.notes:
        report.value("notes", "; ".join(record.notes))
    common.show(report, run.model)
    report.value("steps", len(run.z) - 1)
    report.value("missing", record.missing)


def _estimates(report: Report, run: Run) -> None:
    """The estimates in figures, the last ones in a table, and the second route."""
    model, found = run.model, run.filtered
    _figures(report, run)
    x, sd = found.x_plus[-1], deviations(found.P_plus)[-1]
    known = np.isfinite(sd).tolist()
    columns = {_("estimate"): [v if there else None for v, there in zip(x.tolist(), known, strict=True)], "σ": sd}
    common.states_table(report, "last", model, columns, _("The last estimates."))
    if all(known):
        report.value("estimate_end", x, common.units(model))
        report.value("sd_end", sd, common.units(model))
    else:
        names = ", ".join(name for name, there in zip(model.states, known, strict=True) if not there)
        reason = fill(_("the record does not determine {names}, of which nothing was known at the start"), names=names)
        report.value("estimate_end", None, common.units(model), reason=reason)
        report.value("sd_end", None, common.units(model), reason=reason)
        report.says(_("No estimate of every state: {reason}."), reason=reason)
    _second_route(report, run)
    if run.smoothed is not None and run.algorithm != "steady":  # what goes back from a constant gain is not the smoother
        _smoothed_route(report, run)


def _smoothed_route(report: Report, run: Run) -> None:
    """The smoother by conditioning all states on all measurements at once; of a long record its beginning, smoothed by itself."""
    model, z, n = run.model, run.z, run.model.n
    rows = min(len(z), max(2, CONDITIONED // max(n, model.m)))
    smoothed = run.smoothed
    if rows < len(z):
        model, z = model.cut(rows - 1), z[:rows]
        report.says(_("The smoother is checked on the first {rows} rows, as a record of their own."), rows=rows)
        smoothed = smooth_(model, z[run.first :], first=run.first)
    if smoothed is not None:
        smoothed_check(report, model, z, run.first, smoothed.x, smoothed.P)


def smoothed_check(report: Report, model: DiscreteModel, z: Array, first: int, x: Array, P: Array) -> None:
    """Smoothed estimates and covariances against conditioning with 150 digits, within 1e-6 of their σ."""
    wanted, covariance = second.smoothed(model, z, first)
    sd = deviations(covariance)
    size = np.maximum(sd, 1e-3 * sd.max(axis=0))  # a state that is known at one instant is judged like that at others
    size = np.where(size > 0, size, 1e-8 * np.maximum(np.abs(wanted).max(axis=0), np.finfo(float).tiny))
    unknown = ~np.isfinite(np.diagonal(P, axis1=1, axis2=2))  # what no measurement determines
    either = unknown[:, :, None] | unknown[:, None, :]
    routes = (_("smoother"), _("joint distribution conditioned, 150 digits"))
    report.check(_("smoothed estimates"), x, np.where(unknown, np.nan, wanted), routes, SOLVER, scale=100 * size)
    report.check(
        _("their error covariances"), np.where(either, 0.0, P), np.where(either, 0.0, covariance), routes, SOLVER,
        scale=100 * size[:, :, None] * size[:, None, :],
    )  # fmt: skip


def _figures(report: Report, run: Run) -> None:
    """The estimates of each state over the data."""
    model, found = run.model, run.filtered
    for i, (name, unit) in enumerate(list(zip(model.states, model.units, strict=True))[: common.SHOWN]):
        measured = common.measured(model, i)
        curves = {_("filtered"): (found.x_plus[:, i], deviations(found.P_plus)[:, i])}
        if run.smoothed is not None:
            curves[_("smoothed")] = (run.smoothed.x[:, i], deviations(run.smoothed.P)[:, i])
        data = None if measured is None else run.z[:, measured]
        figure = estimates(run.t, curves, data=data, ylabel=common.label(name, unit))
        caption = _("Estimates of {name} with their ±σ bands.")
        if measured is not None:
            caption = _("Estimates of {name} with their ±σ bands, and the measurements.")
        report.figure(f"estimates_{i + 1}", figure, caption, name=name)


def _second_route(report: Report, run: Run) -> None:
    """The same estimates by the library's other filter, over the first rows of a long record, where rounding allows it."""
    if run.algorithm == "steady":
        steady_route(report, run)
        return
    worst = common.delicacy(run.filtered.P_minus, run.filtered.P_plus, run.filtered.S, CHECKED)
    if not worst < common.SINGULAR:
        report.says(
            _(
                "The error covariance is nearly singular (condition number {condition}), so that forms of the filter differ by their rounding: `ctlabs compare` shows which to trust."
            ),
            condition=worst,
        )
        return
    steps = min(len(run.z) - 1, CHECKED)
    model = run.model.cut(steps)
    other = kalman_filter(model, run.z[run.first : steps + 1], first=run.first, algorithm="filterpy")
    routes = (_("this form of the filter"), _("filterpy"))
    known = np.isfinite(other.P_plus).all(axis=(1, 2))
    if not known.any():
        return
    _same_estimates(report, run, other.x_plus, deviations(other.P_plus), routes)
    ours, theirs = (P[: steps + 1][known] for P in (run.filtered.P_plus, other.P_plus))
    report.check(_("error covariances, scaled to unit variances"), ours, theirs, routes, SOLVER)


def _same_estimates(report: Report, run: Run, x: Array, sd: Array, routes: tuple[str, str]) -> None:
    """The estimates by another route, in units of their σ; of a state's own size no more than 14 digits are asked for."""
    known = np.isfinite(sd).all(axis=1)
    size = sd[known] + 1e-6 * np.abs(x[known]).max(axis=0, initial=0.0)
    report.check(_("estimates"), run.filtered.x_plus[: len(x)][known], x[known], routes, SOLVER, scale=np.where(size > 0, size, 1.0))


def steady_route(report: Report, run: Run) -> None:
    """The estimates once more, by gains known beforehand; and what a constant gain means for the tests below."""
    steps = min(len(run.z) - 1, CHECKED)
    plan = covariances(run.model, steps, first=run.first)
    limit = steady.solve(run.model)
    updates = np.asarray(plan.used).any(axis=1).astype(np.float64)
    constant = dataclasses.replace(plan, K=np.multiply.outer(updates, limit.K))
    other = kalman_filter(run.model, run.z[run.first : steps + 1], first=run.first, gains=constant)
    routes = (_("this form of the filter"), _("a schedule of constant gains"))
    _same_estimates(report, run, other.x_plus, deviations(run.filtered.P_plus[: steps + 1]), routes)
    report.says(
        _(
            "One gain serves all rows. Until the filter has settled its estimates are worse than their σ says and its innovations larger, and so is the NIS; the verdict below is therefore from the optimal filter's innovations."
        )
    )


def _verdict(report: Report, run: Run, units: Sequence[str]) -> None:
    """Innovations and their statistics, and what they suggest."""
    found = run.filtered
    if "log_likelihood" not in report.values:
        report.value("log_likelihood", float(found.log_likelihood))
        if found.log_likelihood_diffuse != found.log_likelihood:
            report.value("log_likelihood_diffuse", float(found.log_likelihood_diffuse))
    known = int(contradictions.known(run.model, run.z, found.used, run.first).sum())
    excluded = excluding(report, run.model, found, run.t[run.first :])
    measured = np.isfinite(found.innovation)
    if known:
        report.value("known_already", known - len(excluded))
        report.says(
            _(
                "Known already: {agree} perfect measurements agree with what was known exactly, and tell nothing more; {contradict} contradict it."
            ),
            agree=known - len(excluded), contradict=len(excluded),
        )  # fmt: skip
    if not measured.any():
        if not known:
            nothing = _("No element was measured, so the data say nothing of the model.")
            report.says("{nothing}", nothing=nothing)
            report.value("remark", nothing)
        return
    try:
        verdict = _diagnosed(run)
    except ArithmeticError as error:  # the diagnosis filters in Joseph's form, whatever the form chosen here
        report.says(_("The data are not tested against the model: {reason}."), reason=str(error))
        return
    _innovations(report, run, verdict, units)
    _tests(report, run, verdict)
    if len(run.z) > diagnosis.LONG:
        report.says(
            _("The tests of whiteness and the factors are those of the first {rows} rows."), rows=diagnosis.LONG
        )


def excluding(
    report: Report, model: DiscreteModel, filtered: Filtered, rows: Array, name: str = "contradiction"
) -> tuple[Contradiction, ...]:
    """Say that a record contradicts a model, and where; ``rows``, the times of the rows of data. The contradictions."""
    found = filtered.contradictions
    if not found:
        return ()
    first = found[0]
    where = fill(_("row {row} (t = {t} s)"), row=first.row, t=float(rows[first.row]))
    said = contradictions.sentence(found, model.measurements, where)
    report.says("**{said}**", said=said)
    report.value(name, said)
    report.value(f"{name}s", len(found))
    report.table(
        f"{name}s",
        [_("row"), "t, s", _("measurement"), _("innovation"), _("explained by rounding")],
        [(c.row, float(rows[c.row]), model.measurements[c.element], c.innovation, c.allowed) for c in found[:LISTED]],
        _("Perfect measurements that contradict what is known exactly (the first of them)."),
    )
    return found


def _diagnosed(run: Run) -> Diagnosis:
    """The diagnosis by the optimal filter's innovations (the start of one with the steady gain is not the model's)."""
    found = run.filtered if run.algorithm != "steady" else kalman_filter(run.model, run.z[run.first :], first=run.first)
    return diagnosis.diagnose(run.model, found, longest=diagnosis.LONG)


def _innovations(report: Report, run: Run, verdict: Diagnosis, units: Sequence[str]) -> None:
    """The innovations in their bands, and their autocorrelation."""
    found, names = run.filtered, run.model.measurements
    with np.errstate(invalid="ignore"):
        sd = np.sqrt(np.diagonal(found.S, axis1=1, axis2=2))
    measured = np.isfinite(found.innovation)
    usual = np.array([np.median(sd[there, i]) if there.any() else np.nan for i, there in enumerate(measured.T)])
    shown = ~(measured & (sd > WIDE * usual)).any(
        axis=1
    )  # an innovation of a start that knows nothing hides all others
    labels = [
        common.label(fill(_("innovation of {name}"), name=name), unit) for name, unit in zip(names, units, strict=True)
    ]
    figure = pictures.innovations(
        run.t[shown], found.innovation[shown], np.where(measured, sd, np.nan)[shown], found.nis[shown],
        found.used.sum(axis=1)[shown], xlabel="t, s", labels=labels,
    )  # fmt: skip
    caption = _(
        "Innovations (what each measurement tells beyond its prediction) in the filter's ±2σ, and their normalised square in the band of 95 % of a right model's."
    )
    if not shown.all():
        caption += _(" Left out: {count} of a band more than {wide} times the usual one.")
    report.figure("innovations", figure, caption, count=int((~shown).sum()), wide=WIDE)
    correlations = {}
    for name, r, band in zip(names, verdict.autocorrelation, verdict.band, strict=True):
        tested = np.isfinite(r)
        if tested.any():
            correlations[common.label(name)] = verdict.lags[tested], r[tested], band[tested]
    if correlations:
        report.figure(
            "autocorrelation",
            pictures.autocorrelation(correlations),
            _("Autocorrelation of the standardised innovations; those of a right model are white."),
        )


def _tests(report: Report, run: Run, verdict: Diagnosis) -> None:
    """The tests in numbers and words."""
    own = diagnosis.innovations(run.filtered.innovation, run.filtered.S, run.filtered.nis)
    report.value("nis_mean", own.nis_mean)
    report.value("nis_expected", own.nis_expected)
    report.value("nis_band", list(own.nis_band))
    report.value("nis_p", own.nis_p)
    few = _("too few innovations")
    report.value("mean_p", _known(verdict.mean_p), reason=few)
    report.value("whiteness_p", _known(verdict.whiteness_p), reason=few)
    for letter, factor in (("R", verdict.factor_R), ("Q", verdict.factor_Q)):
        report.value(f"factor_{letter}", factor, reason=_("nothing to scale"))
    report.value("verdict", verdict.verdict)
    report.value("suggestion", verdict.suggestion)
    report.table(
        "tests",
        [_("measurement"), _("mean of the standardised innovations"), _("its p"), _("p of whiteness")],
        zip(
            run.model.measurements,
            _known(verdict.mean),
            _known(verdict.mean_p),
            _known(verdict.whiteness_p),
            strict=True,
        ),
        _("Tests of the innovations, measurement by measurement: a small p speaks against the model."),
    )
    report.says(
        _("The NIS averages {mean} per instant; a right model's lies between {low} and {high} in 95 % of records (p = {p}). **Verdict:** {suggestion}."),
        mean=own.nis_mean, low=own.nis_band[0], high=own.nis_band[1], p=own.nis_p,
        suggestion=verdict.suggestion.rstrip("."),
    )  # fmt: skip


def _truth(report: Report, model: ModelFile, run: Run) -> None:
    """What the design's estimates are worth, and how likely the record is, if ``model`` is the truth."""
    truth = model.discrete(times=run.t)
    E = common.stands_for(truth, run.model)
    missing = np.isnan(run.z)
    filtered = kalman_filter(truth, run.z[run.first :], first=run.first)
    steps = len(run.z) - 1
    actual = sensitivity.actual(
        _without(truth, missing), _without(run.model, missing), steps, compare=E, first=run.first
    )
    optimal = deviations(E @ filtered.P_plus @ E.T)
    true = deviations(actual.mse_plus)
    claimed = deviations(run.filtered.P_plus)
    common.cost(report, run.model, run.t, claimed, true, optimal)
    if missing[run.first :].any() and not (truth.N is None and run.model.N is None):
        report.says(
            _(
                "These errors are those of a record without gaps: with N ≠ 0 the theory leaves missing elements out of account."
            )
        )
    report.value("log_likelihood_truth", float(filtered.log_likelihood))
    excluding(report, truth, filtered, run.t[run.first :], "contradiction_truth")
    report.says(
        _("The record's log-likelihood is {truth} by the other model and {design} by the filter's."),
        truth=float(filtered.log_likelihood),
        design=float(run.filtered.log_likelihood),
    )


def _without(model: DiscreteModel, missing: Array) -> DiscreteModel:
    """The model with the missing elements' variances infinite."""
    if not missing.any() or model.N is not None:
        return model
    R = np.array(np.broadcast_to(model.R, (len(missing), model.m, model.m)))
    R[missing[:, :, None] | missing[:, None, :]] = 0.0
    k, i = np.nonzero(missing)
    R[k, i, i] = np.inf
    return dataclasses.replace(model, R=R)


def table(run: Run) -> tuple[list[str], list[list[Any]]]:
    """Columns and rows of estimates.csv: one row per row of the data."""
    model, found = run.model, run.filtered
    with np.errstate(invalid="ignore"):
        sd = np.sqrt(np.diagonal(found.S, axis1=1, axis2=2))
    sd = np.where(np.isfinite(found.innovation), sd, np.nan)
    columns = ["k", "t"]
    parts = [np.arange(len(run.t))[:, None], run.t[:, None]]
    for names, values, sds, value, deviation in (
        (model.states, found.x_plus, deviations(found.P_plus), "{}", "{}_sd"),
        (model.measurements, found.innovation, sd, "innovation_{}", "innovation_sd_{}"),
        *(
            []
            if run.smoothed is None
            else [(model.states, run.smoothed.x, deviations(run.smoothed.P), "{}_smoothed", "{}_smoothed_sd")]
        ),
    ):
        for i, name in enumerate(names):
            columns += [value.format(name), deviation.format(name)]
            parts += [values[:, i, None], sds[:, i, None]]
    common.distinct("estimates.csv", columns)
    rows = np.hstack(parts)[run.first :].tolist()
    return columns, [[int(row[0]), *row[1:]] for row in rows]


def exportable(path: Path) -> None:
    """Refuse a file that gains cannot be written to, before anything is computed.

    >>> exportable(Path("gains.txt"))
    Traceback (most recent call last):
    ...
    ValueError: --export gains.txt: expected a name that ends with .npz, .mat or .h, received .txt
    """
    if path.suffix not in SUFFIXES:
        msg = f"--export {path}: expected a name that ends with .npz, .mat or .h, received {path.suffix or 'none of them'}"
        raise ValueError(msg)
    if path.exists() or not path.absolute().parent.is_dir():
        found = "one that is there already: it is left alone" if path.exists() else "a folder that does not exist"
        msg = f"--export {path}: expected a new file in a folder that exists, received {found}"
        raise ValueError(msg)


def export_gains(model: ModelFile, record: Record, path: Path) -> None:
    """The matrices and the steady gains, or (where there are none) the gains row by row, for other programs."""
    from ctlabs.files import export

    discrete, z, _t = clock.timed(model, record)
    try:
        gains: Any = steady.solve(discrete)
    except ValueError:  # it varies with time, or has no steady state
        gains = covariances(discrete, len(z) - 1, first=model.experiment.first)
    export.write(discrete, gains, path)


def _known(values: Sequence[float] | Array) -> list[float | None]:
    """Numbers, with None for NaN."""
    return [None if np.isnan(value) else float(value) for value in values]
