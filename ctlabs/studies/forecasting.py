"""What comes after a record: ``ctlabs forecast``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

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
    from ctlabs.files.clock import Over
    from ctlabs.files.datafile import Record
    from ctlabs.files.modelfile import ModelFile
    from ctlabs.filtering.results import Filtered
    from ctlabs.linalg.checks import Array
    from ctlabs.models.linear import DiscreteModel
    from ctlabs.reporting.drawing import Drawing

#: Instants after a record that are predicted unless it is said how many.
STEPS = 12
#: Rows of the record that are drawn before the forecast, as a multiple of its length.
BEFORE = 4


@dataclass(frozen=True, slots=True, eq=False)
class Continued:
    """A record filtered up to its instant ``last``, and what follows.

    ``whole``, the model over the record and beyond · ``model``, over the record alone · ``found``, its estimates at ``t`` (last+1,) from
    ``z`` (last+1, m) · ``ahead`` at the times ``later`` · ``held``, the row of ``last`` · ``rows`` of the times to come, None where the
    record has none · ``notes``
    """

    whole: DiscreteModel
    model: DiscreteModel
    found: Filtered
    ahead: Forecast
    t: Array
    z: Array
    later: Array
    held: int
    rows: NDArray[np.int64] | None
    notes: tuple[str, ...]


def compute(model: ModelFile, record: Record, steps: int | None = None) -> Continued:
    """What is known of the ``steps`` instants after a record; refusals as of :func:`study`."""
    first, made = model.experiment.first, clock.over(model, record)
    standing = _standing(model, record, made)
    known = record.u is not None or standing is None
    whole, last, later = _known(model, record, made, steps) if known else _free(model, record, made, steps)
    z, discrete, held = made.z[: last + 1], whole.cut(last), int(made.placing.held[last])
    found = kalman_filter(discrete, z[first:], first=first)
    ahead = forecast(whole, found, len(later))
    notes = (*record.notes, *clock.notes(model, record, made), *([] if known or standing is None else standing))
    rows = made.placing.rows[last + 1 : last + 1 + len(later)] if known else None
    return Continued(whole, discrete, found, ahead, made.t[: last + 1], z, later, held, rows, notes)


def study(model: ModelFile, record: Record, steps: int | None = None) -> Report:
    """Filter a record, and predict the states and measurements of the ``steps`` instants after it.

    Of a continuous model and a record with times they are as far apart as its rows usually are. Known inputs and regressors of the
    time to come stand in rows below the last measurement: then these are the instants.

    Raises
    ------
    ValueError
        Times that do not fit the model; a known input or a regressor without values for the time to come; a model given for fewer steps.
    """
    made = compute(model, record, steps)
    first, discrete, ahead = model.experiment.first, made.model, made.ahead
    t, z, later, held = made.t, made.z, made.later, made.held
    steps, last = len(later), len(t) - 1
    given = common.settings(model, ("steps", steps, "1", _("instants after the record")))
    report = common.begin("forecast", _("a record continued"), model, "ab", given, data=record.source)
    report.section("a", _("Model and data"))
    report.says(
        _("{source}: {rows} rows from t = {start} to {end} s."),
        source=record.source, rows=held + 1, start=float(t[first]), end=float(t[-1]),
    )  # fmt: skip
    common.notes(report, made.notes)
    common.show(report, discrete)
    report.section("b", _("Forecast"))
    report.says(_("All estimates are given the whole record, and nothing after it. σ counts what the measurement adds of its own noise."))
    _numbers(report, model, discrete, ahead, later)
    for i, (name, figure) in enumerate(pictures(made).items(), 1):
        report.figure(f"forecast_{i}", figure, _("The last rows of the record, and {name} after it, with ±σ bands."), name=name)
    _checked(report, made.whole, z, first, ahead)
    own = _columns(discrete, ahead)
    names = [name for name, _values in own]
    if made.rows is not None:
        head, times = clocks(record, later, names, made.rows)
    else:
        head, times = _continued(record, held, later, names)
    columns = ["k", *head, *names]
    common.distinct("forecast.csv", columns)
    values = np.column_stack([values for _name, values in own]).tolist()
    report.csv("forecast", columns, [[k, *time, *row] for k, (time, row) in enumerate(zip(times, values, strict=True), last + 1)])
    return report


def _standing(model: ModelFile, record: Record, made: Over) -> list[str] | None:
    """What is said of the constants that stand in for all regressors behind a record that ends with a measurement; None where none do."""
    names = list(made.regressors.values) if made.regressors is not None else []
    if names and (any(name not in model.constants for name in names) or np.isnan(record.z[-1]).all()):
        return None
    return [f"{name} of the time to come is the constant {moment(model.constants[name])}" for name in names]


def _free(model: ModelFile, record: Record, made: Over, steps: int | None) -> tuple[DiscreteModel, int, Array]:
    """The model over the record and beyond, the last instant of the record, and the times to come."""
    steps, t = steps or STEPS, made.t
    regressors = made.regressors and made.regressors.continued(steps, model.constants)
    if record.t is None:
        return model.discrete(steps=len(t) - 1 + steps, regressors=regressors), len(t) - 1, t[-1] + made.model.dt * np.arange(1, steps + 1)
    interval = made.model.dt if model.kind == "discrete" else float(np.median(np.diff(t)))
    later = t[-1] + interval * np.arange(1, steps + 1)
    return model.discrete(times=np.concatenate([t, later]), regressors=regressors), len(t) - 1, later


def _known(model: ModelFile, record: Record, made: Over, steps: int | None) -> tuple[DiscreteModel, int, Array]:
    """The same where the record tells its inputs and regressors beyond the last row in which something was measured."""
    measured = np.flatnonzero(~np.isnan(record.z).all(axis=1))
    row = int(measured[-1]) if measured.size else record.rows - 1
    last = int(np.flatnonzero(made.placing.rows == row)[0])
    left = len(made.t) - 1 - last
    if left < (steps or 1):
        names = ", ".join([*record.mapping.inputs, *model.regressors])
        what = f"{left} such row{'s' if left > 1 else ''}" if left else "none"
        msg = (
            f"{record.source}: expected rows below the last measurement (line {record.lines[row]}) with {names} of the time to come, "
            f"received {what}: write {steps or 'as many as are to be predicted'} below it, with empty cells for what will be measured"
        )
        raise ValueError(msg)
    end = last + (steps or left)
    unknown = made.absent[last + 1 : end + 1].any(axis=1)
    if unknown.any():
        t = moment(made.t[last + 1 + int(unknown.argmax())])
        msg = f"{record.source}: expected {', '.join(model.regressors)} at every instant to come, received none at t = {t}"
        raise ValueError(msg)
    return made.model.cut(end), last, made.t[last + 1 : end + 1]


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


def pictures(made: Continued, most: int = common.SHOWN) -> dict[str, Drawing]:
    """The end of the record and what follows it, for the first states by their names."""
    model, found, ahead, t, later = made.model, made.found, made.ahead, made.t, made.later
    shown = slice(max(0, len(t) - BEFORE * len(later)), None)
    at = np.concatenate([t[shown], later])
    drawn = {}
    for i, (name, unit) in enumerate(list(zip(model.states, model.units, strict=True))[:most]):
        measured = common.measured(model, i)
        x, sd = found.x_plus[shown, i], deviations(found.P_plus)[shown, i]
        before, after = np.full(len(later), np.nan), np.full(len(x) - 1, np.nan)
        curves = {  # the forecast begins at the last estimate
            _("filtered"): (np.concatenate([x, before]), np.concatenate([sd, before])),
            _("forecast"): (np.concatenate([after, x[-1:], ahead.x[:, i]]), np.concatenate([after, sd[-1:], ahead.sd[:, i]])),
        }
        data = None if measured is None else np.concatenate([found.z[shown, measured], before])
        drawn[name] = estimates(at, curves, data=data, ylabel=common.label(name, unit))
    return drawn


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


def _columns(model: DiscreteModel, ahead: Forecast) -> list[tuple[str, Array]]:
    """The columns of forecast.csv after the times: states and measurements, each with its standard deviation."""
    with np.errstate(invalid="ignore"):
        sd = np.sqrt(np.diagonal(ahead.S, axis1=1, axis2=2))
    found: list[tuple[str, Array]] = []
    for names, values, spread in ((model.states, ahead.x, ahead.sd), (model.measurements, ahead.z, sd)):
        for i, name in enumerate(names):
            own = fill("measured_{name}", name=name) if names is model.measurements and name in model.states else name
            found += [(own, values[:, i]), (f"{own}_sd", spread[:, i])]
    return found


def _continued(record: Record, row: int, later: Array, others: list[str]) -> tuple[list[str], list[list[Any]]]:
    """The columns of times after a record's ``row``: written as its own are, or in seconds alone where they cannot be."""
    if not record.clocked or record.t is None:
        return ["t"], [[each] for each in later.tolist()]
    stamps = continued(record.stamps[row], record.mapping.unit, later - record.t[row])
    if stamps is None:
        return ["seconds" if record.clock == "t" else "t"], [[each] for each in later.tolist()]
    return clocks(replace(record, stamps=stamps), later, others)
