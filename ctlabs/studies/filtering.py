"""A measured record filtered (and smoothed), and what its innovations say of the model: ``ctlabs filter``."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ctlabs.analysis import diagnosis, sensitivity
from ctlabs.analysis.diagnosis.wording import NAMED, shown
from ctlabs.files import clock
from ctlabs.filtering import contradictions, steady
from ctlabs.filtering.filter import covariances, kalman_filter
from ctlabs.filtering.smoothing import smooth as smooth_
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import deviations
from ctlabs.models import DiscreteModel
from ctlabs.reporting.plots import records as pictures
from ctlabs.reporting.plots.studies import estimates
from ctlabs.reporting.report import SOLVER, Report
from ctlabs.studies import common, paths, second
from ctlabs.studies.estimates import table
from ctlabs.studies.filtered import Run, compute
from ctlabs.text import _, fill, number

if TYPE_CHECKING:
    from ctlabs.analysis.diagnosis import Diagnosis
    from ctlabs.files.datafile import Record
    from ctlabs.files.modelfile import ModelFile
    from ctlabs.filtering.results import Contradiction, Filtered

#: The second route filters at most so many rows (it is a hundred times slower than the first).
CHECKED = 2000
#: All states are conditioned on all measurements at once for so many of them.
CONDITIONED = 120
#: Innovations whose σ is more times the usual one are not drawn.
WIDE = 5
#: Contradictions of which the report has a table.
LISTED = 20
#: So many rows at the end beyond the gate, and the filter has lost the record.
LOST = 5
SUFFIXES = (".npz", ".mat", ".h")


def study(
    model: ModelFile,
    record: Record,
    *,
    algorithm: str | None = None,
    smooth: bool = False,
    design: ModelFile | None = None,
    gate: float | None = None,
    draws: int = 0,
    seed: int | None = None,
    reach: tuple[str, ...] = (),
) -> Report:
    """Filter ``record`` with ``model``, or with ``design`` where ``model`` is only what is thought to be true.

    Parameters
    ----------
    model, record : as read
    algorithm : a form of the filter; the first of the model file's where not given (:func:`ctlabs.studies.common.form`)
    smooth : whether every state is also estimated from the whole record
    design : the filter's model, where it is another one
    gate : leave out innovations beyond so many standard deviations
    draws, seed : how many histories of the state given the record are drawn, with which seed (the model's where not given)
    reach : "STATE=VALUE", first passages of the draws

    Raises
    ------
    ValueError
        An algorithm that does not exist or cannot filter the model; times that do not fit it.
    """
    used = model if design is None else design
    if design is not None and (record.u is not None or record.regressors):
        names = ", ".join([*record.mapping.inputs, *record.regressors])
        raise ValueError(f"--design: expected a record without known inputs and regressors, received {names}")
    levels = paths.levels(reach)
    if levels and not draws:
        raise ValueError("--reach: expected --draws N beside it, received none")
    run = compute(used, record, common.form(used, algorithm), smooth=smooth, gate=gate)
    given = common.settings(
        used,
        ("algorithm", run.algorithm, "", _("form of the filter")),
        ("dt", run.model.dt, "s", _("period")),
        ("t0", float(run.t[0]), "s", _("time of the initial estimate")),
        ("first", run.first, "1", _("index of the first row of the data")),
        *([] if gate is None else [("gate", gate, "σ", _("innovations beyond it are left out"))]),
    )
    drawn = used.experiment.seed if seed is None else seed
    own = {"runs": draws, "seed": drawn} if draws else {}
    report = common.begin("filter", _("a record filtered"), used, "abcde", given, data=record.source, **own)
    report.section("a", _("Model and data"))
    _data(report, run, record)
    report.section("b", _("Estimates"))
    _estimates(report, run)
    report.section("c", _("What the data say of the model"))
    _verdict(report, run, used.measurement_units)
    if design is not None:
        report.section("d", _("If the other model is the truth"))
        _truth(report, model, run)
    if draws:
        report.section("e", _("Histories given the record"))
        paths.report(report, run, paths.compute(run, draws, drawn, levels), drawn)
    report.csv("estimates", *table(run))
    return report


def add(report: Report, model: ModelFile, record: Record) -> None:
    """A filtered record in another study's report: the figures, the verdict, ``estimates.csv``."""
    run = compute(model, record, "auto")
    common.notes(report, run.notes)
    _figures(report, run)
    _verdict(report, run, model.measurement_units)
    report.csv("estimates", *table(run))


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
    common.notes(report, run.notes)
    common.show(report, run.model)
    report.value("steps", len(run.z) - 1)
    report.value("missing", record.missing)
    _left_out(report, run)


def _left_out(report: Report, run: Run) -> None:
    """What was beyond the gate, row by row; and whether the filter has lost the record."""
    found = run.filtered.left_out
    if not found:
        return
    names = run.model.measurements
    one = _("{name} = {value} in {row}, {sigmas} σ")
    told = [
        fill(one, name=names[each.element], value=shown(each.value), row=run.called(each.row), sigmas=number(each.sigmas, 3))
        for each in found[:NAMED]
    ]
    if len(found) > NAMED:
        told.append(fill(_("{count} more"), count=len(found) - NAMED))
    report.says(_("**Left out by the gate:** {rows}."), rows="; ".join(told))
    report.value("left_out", len(found))
    report.value("left_out_rows", "; ".join(told))
    report.table(
        "left_out",
        [_("line"), _("time"), _("measurement"), _("value"), _("innovation"), "σ"],
        [
            (run.line(c.row), _time(run, c.row), names[c.element], c.value, c.innovation, c.sigmas)
            for c in found[:LISTED]
        ],
        _("Measurements beyond the gate (the first of them)."),
    )
    last = int(np.flatnonzero(run.filtered.used.any(axis=1)).max(initial=0))
    lost = int(np.isfinite(run.z[last + 1 :]).any(axis=1).sum())
    if lost >= LOST:
        text = _("The last {count} rows are all beyond the gate: the filter has lost the record (a jump, or Qd too small)")
        report.says("**{text}.**", text=fill(text, count=lost))
        report.value("lost", lost)


def _time(run: Run, row: int) -> Any:
    """The time of a row of z from the first measurement on: as it was written, where that is not in seconds."""
    instant = row + run.first
    return run.record.stamps[run.rows[instant]].strip() if run.record.clocked and run.rows[instant] >= 0 else float(run.t[instant])


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
    model, z, n = run.bare, run.filtered.z, run.model.n
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
        data = None if measured is None else run.told[:, measured]
        figure = estimates(run.t, curves, data=data, ylabel=common.label(name, unit))
        caption = _("Estimates of {name} with their ±σ bands.")
        if measured is not None:
            caption = _("Estimates of {name} with their ±σ bands, and the measurements.")
        report.figure(f"estimates_{i + 1}", figure, caption, name=name)


def _second_route(report: Report, run: Run) -> None:
    """The same estimates by another form of the filter, over the first rows of a long record, where rounding allows it."""
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
    name, form = common.other_form(run.algorithm)
    other = kalman_filter(model, run.data[run.first : steps + 1], first=run.first, algorithm=form)
    routes = (_("this form of the filter"), name)
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
    limit = steady.solve(run.bare)
    updates = np.asarray(plan.used).any(axis=1).astype(np.float64)
    constant = dataclasses.replace(plan, K=np.multiply.outer(updates, limit.K))
    other = kalman_filter(run.model, run.data[run.first : steps + 1], first=run.first, gains=constant)
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
    known = int(contradictions.known(run.model, found.z, found.used, run.first).sum())
    excluded = excluding(report, run, run.model, found)
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
    if run.verdict is None:
        report.says(_("The data are not tested against the model: {reason}."), reason=run.untested)
        return
    _innovations(report, run, run.verdict, units)
    _tests(report, run, run.verdict)
    events(report, [run])
    if len(run.z) > diagnosis.LONG:
        report.says(
            _("The tests of whiteness and the factors are those of the first {rows} rows."), rows=diagnosis.LONG
        )


def excluding(
    report: Report, run: Run, model: DiscreteModel, filtered: Filtered, name: str = "contradiction"
) -> tuple[Contradiction, ...]:
    """Say that a record contradicts a model, with which it was ``filtered``, and where. The contradictions."""
    found = filtered.contradictions
    if not found:
        return ()
    values = [float(run.z[c.row + run.first, c.element]) for c in found[:LISTED]]
    where = fill(_("{row}, where {value} was measured"), row=run.called(found[0].row), value=shown(values[0]))
    said = contradictions.sentence(found, model.measurements, where)
    report.says("**{said}**", said=said)
    report.value(name, said)
    report.value(f"{name}s", len(found))
    report.table(
        f"{name}s",
        [_("row"), _("measurement"), _("value"), _("innovation"), _("explained by rounding")],
        [
            (run.called(c.row), model.measurements[c.element], value, c.innovation, c.allowed)
            for c, value in zip(found[:LISTED], values, strict=True)
        ],
        _("Perfect measurements that contradict what is known exactly (the first of them)."),
    )
    return found


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
        "Innovations (what each measurement tells beyond its prediction) and their normalised square, each in the band that holds 95 % of a right model's."
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


def events(report: Report, runs: Sequence[Run], record: Sequence[str] = ()) -> None:
    """The rows that speak against the model, one by one; of several records after each one's name, in a column ``record``."""
    found = [(run, event) for run in runs if run.verdict is not None for event in run.verdict.events]
    if not found:
        return
    kinds = {"outlier": _("outlier"), "break": _("break before this row"), "stuck": _("stuck")}
    rows: list[tuple[Any, ...]] = []
    for run, event in found:
        name = (run.model.states if event.kind == "break" else run.model.measurements)[event.place]
        value, size = None if np.isnan(event.value) else event.value, event.size if len(event.rows) == 1 else None
        own = [run.record.name] if record else []
        rows += [(*own, run.line(row), _time(run, row), name, kinds[event.kind], value, size) for row in event.rows]
    report.value("events", len(found))
    report.table(
        "events",
        [*record, _("line"), _("time"), _("quantity"), _("kind"), _("value"), _("differs by")],
        rows,
        _("Rows that speak against the model. What a value differs by is told by the rest of the record."),
    )


def _truth(report: Report, model: ModelFile, run: Run) -> None:
    """What the design's estimates are worth, and how likely the record is, if ``model`` is the truth."""
    truth = model.discrete(times=run.t)
    E = common.stands_for(truth, run.model)
    missing = np.isnan(run.data)
    filtered = kalman_filter(truth, run.data[run.first :], first=run.first)
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
    excluding(report, run, truth, filtered, "contradiction_truth")
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
        gains: Any = steady.solve(dataclasses.replace(discrete, measurement_offset=None))  # which may vary where all else is constant
    except ValueError:  # it varies with time, or has no steady state
        gains = covariances(discrete, len(z) - 1, first=model.experiment.first)
    export.write(discrete, gains, path)


def _known(values: Sequence[float] | Array) -> list[float | None]:
    """Numbers, with None for NaN."""
    return [None if np.isnan(value) else float(value) for value in values]
