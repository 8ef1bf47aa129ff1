"""What comes after a record: ``ctlabs forecast``."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ctlabs.files import clock
from ctlabs.files.continued import continued
from ctlabs.filtering.filter import kalman_filter
from ctlabs.filtering.forecasting import Forecast, forecast
from ctlabs.linalg.covariance import deviations
from ctlabs.reporting.plots.studies import estimates
from ctlabs.reporting.report import SOLVER, Report
from ctlabs.studies import common
from ctlabs.studies.estimates import clocks
from ctlabs.text import _, fill, moment

if TYPE_CHECKING:
    from ctlabs.files.datafile import Record
    from ctlabs.files.modelfile import ModelFile
    from ctlabs.filtering.results import Filtered
    from ctlabs.linalg.checks import Array
    from ctlabs.models.linear import DiscreteModel

#: Rows of the record that are drawn before the forecast, as a multiple of its length.
BEFORE = 4


#: Instants after a record that are predicted unless it is said how many.
STEPS = 12


def study(model: ModelFile, record: Record, steps: int | None = None) -> Report:
    """Filter a record, and predict the states and measurements of the ``steps`` instants after it.

    Of a continuous model and a record with times they are as far apart as its rows usually are. Known inputs and regressors of the
    time to come stand in rows below the last measurement: then these are the instants.

    Raises
    ------
    ValueError
        Times that do not fit the model; a known input or a regressor without values for the time to come; a model given for fewer steps.
    """
    first = model.experiment.first
    whole, z, t, later = _known(model, record, steps) if record.u is not None or model.regressors else _free(model, record, steps)
    steps, last = len(later), len(t) - 1
    discrete = whole.cut(last)
    found = kalman_filter(discrete, z[first:], first=first)
    ahead = forecast(whole, found, steps)
    given = common.settings(model, ("steps", steps, "1", _("instants after the record")))
    report = common.begin("forecast", _("a record continued"), model, "ab", given, data=record.source)
    report.section("a", _("Model and data"))
    report.says(
        _("{source}: {rows} rows from t = {start} to {end} s."),
        source=record.source, rows=record.rows, start=float(t[first]), end=float(t[-1]),
    )  # fmt: skip
    common.show(report, discrete)
    report.section("b", _("Forecast"))
    report.says(_("All estimates are given the whole record, and nothing after it. σ counts what the measurement adds of its own noise."))
    _numbers(report, model, discrete, ahead, later)
    _pictures(report, discrete, found, ahead, t, later)
    _checked(report, whole, z, first, ahead)
    report.csv("forecast", *_table(discrete, ahead, last, later, record, int(clock.instants(model, record).held[last])))
    return report


def _free(model: ModelFile, record: Record, steps: int | None) -> tuple[DiscreteModel, Array, Array, Array]:
    """The model over the record and beyond, its data and times, and the times to come."""
    discrete, z, t = clock.timed(model, record)
    steps = steps or STEPS
    later = t[-1] + float(np.median(np.diff(t))) * np.arange(1, steps + 1)
    if record.t is None:
        return model.discrete(steps=len(t) - 1 + steps), z, t, later
    if model.kind == "discrete":
        later = t[-1] + discrete.dt * np.arange(1, steps + 1)
    return model.discrete(times=np.concatenate([t, later])), z, t, later


def _known(model: ModelFile, record: Record, steps: int | None) -> tuple[DiscreteModel, Array, Array, Array]:
    """The same where the record tells its inputs and regressors beyond the last measurement."""
    whole, z, t = clock.timed(model, record)
    names = ", ".join([*record.mapping.inputs, *model.regressors])
    measured = np.flatnonzero(~np.isnan(record.z).all(axis=1))
    line = record.lines[measured[-1] if measured.size else -1]
    last = int(np.flatnonzero(~np.isnan(z).all(axis=1))[-1]) if measured.size else len(t) - 1
    left = len(t) - 1 - last
    if left < (steps or 1):
        what = f"{left} such row{'s' if left > 1 else ''}" if left else "none"
        msg = (
            f"{record.source}: expected rows below the last measurement (line {line}) with {names} of the time to come, received {what}: "
            f"write {steps or 'as many as are to be predicted'} below it, with empty cells for what will be measured"
        )
        raise ValueError(msg)
    steps = steps or left
    unknown = clock.unusable(model, record)[last + 1 : last + 1 + steps].any(axis=1)
    if unknown.any():
        k = last + 1 + int(unknown.argmax())
        msg = f"{record.source}: expected {', '.join(model.regressors)} at every instant to come, received none at t = {moment(t[k])}"
        raise ValueError(msg)
    return whole.cut(last + steps), z[: last + 1], t[: last + 1], t[last + 1 : last + 1 + steps]


def _numbers(report: Report, file: ModelFile, model: DiscreteModel, ahead: Forecast, later: Array) -> None:
    """The measurements to come in a table, and the last of everything as values."""
    with np.errstate(invalid="ignore"):
        sd = np.sqrt(np.diagonal(ahead.S, axis1=1, axis2=2))
    names = [common.label(name, unit) for name, unit in zip(model.measurements, file.measurement_units, strict=True)]
    report.table(
        "forecast",
        ["t, s", *(column for name in names for column in (name, f"σ({name})"))],
        [[float(at), *np.column_stack([z, s]).ravel().tolist()] for at, z, s in zip(later, ahead.z, sd, strict=True)],
        _("Measurements after the record, with their standard deviations."),
    )
    report.value("state_end", ahead.x[-1], common.units(model))
    report.value("state_sd_end", ahead.sd[-1], common.units(model))


def _pictures(report: Report, model: DiscreteModel, found: Filtered, ahead: Forecast, t: Array, later: Array) -> None:
    """The end of the record and what follows it, state by state."""
    shown = slice(max(0, len(t) - BEFORE * len(later)), None)
    at = np.concatenate([t[shown], later])
    for i, (name, unit) in enumerate(zip(model.states, model.units, strict=True)):
        if i == common.SHOWN:
            break
        measured = common.measured(model, i)
        x, sd = found.x_plus[shown, i], deviations(found.P_plus)[shown, i]
        before, after = np.full(len(later), np.nan), np.full(len(x) - 1, np.nan)
        curves = {  # the forecast begins at the last estimate
            _("filtered"): (np.concatenate([x, before]), np.concatenate([sd, before])),
            _("forecast"): (np.concatenate([after, x[-1:], ahead.x[:, i]]), np.concatenate([after, sd[-1:], ahead.sd[:, i]])),
        }
        data = None if measured is None else np.concatenate([found.z[shown, measured], before])
        figure = estimates(at, curves, data=data, ylabel=common.label(name, unit))
        report.figure(f"forecast_{i + 1}", figure, _("The last rows of the record, and {name} after it, with ±σ bands."), name=name)


def _checked(report: Report, whole: DiscreteModel, z: Array, first: int, ahead: Forecast) -> None:
    """The same by the filter of a record that goes on without measurements."""
    steps = len(ahead.t)
    longer = np.concatenate([z[first:], np.full((steps, z.shape[1]), np.nan)])
    again = kalman_filter(whole, longer, first=first)
    routes = (_("forecast"), _("filter of a record that goes on empty"))
    unit = np.where(ahead.sd > 0, ahead.sd, 1.0)
    report.check(_("states to come"), ahead.x, again.x_minus[-steps:], routes, SOLVER, scale=unit)
    report.check(
        _("covariances to come"), ahead.P, again.P_minus[-steps:], routes, SOLVER, scale=unit[:, :, None] * unit[:, None, :]
    )


def _table(
    model: DiscreteModel, ahead: Forecast, last: int, later: Array, record: Record, row: int
) -> tuple[list[str], list[list[Any]]]:
    """Columns and rows of forecast.csv; times are written as those of the record are, of which ``row`` is the last that was filtered."""
    with np.errstate(invalid="ignore"):
        sd = np.sqrt(np.diagonal(ahead.S, axis1=1, axis2=2))
    columns, parts = ["k", "t"], [last + 1.0 + np.arange(len(later))[:, None], later[:, None]]
    for names, values, spread in ((model.states, ahead.x, ahead.sd), (model.measurements, ahead.z, sd)):
        for i, name in enumerate(names):
            own = fill("measured_{name}", name=name) if names is model.measurements and name in model.states else name
            columns += [own, f"{own}_sd"]
            parts += [values[:, i, None], spread[:, i, None]]
    rows = [[int(row[0]), *row[1:]] for row in np.hstack(parts).tolist()]
    clocked = record.clocked and record.t is not None
    stamps = continued(record.stamps[row], record.mapping.unit, later - record.t[row]) if clocked else None  # type: ignore[index]
    if stamps is not None:
        head, times = clocks(replace(record, stamps=stamps), later, columns[2:])
        columns, rows = ["k", *head, *columns[2:]], [[row[0], *time, *row[2:]] for row, time in zip(rows, times, strict=True)]
    common.distinct("forecast.csv", columns)
    return columns, rows
