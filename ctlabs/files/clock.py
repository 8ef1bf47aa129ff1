"""The times of a record and the model's clock: which model moves the state from row to row, with the record's inputs and regressors."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ctlabs.files.mapping import NO_TIME, RELATIVE, pasted
from ctlabs.files.modelfile.values import Regressors
from ctlabs.files.times import choice
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel
from ctlabs.text import moment

if TYPE_CHECKING:
    from ctlabs.files.datafile import Record
    from ctlabs.files.modelfile import ModelFile

#: How far, in periods, a row may be off the grid of a model in discrete time: written times are rounded.
NEAR = 1e-2
#: So many periods between t0 and the first row, or in a usual interval, are not what was meant.
MANY = 1000
#: No record has more instants, those without a row counted.
LONGEST = 10_000_000
#: Lines that a sentence names.
TOLD = 4


class Placing(NamedTuple):
    """Where a record's rows are: the instants' times ``t`` (steps+1,), or None (one period apart), and the row at each, ``rows``, −1 where none is."""

    t: Array | None
    rows: NDArray[np.int64]

    @property
    def held(self) -> NDArray[np.int64]:
        """The row that was last at each instant; −1 before the first."""
        return np.maximum.accumulate(self.rows)


class Over(NamedTuple):
    """A model over a record: :func:`timed`, the ``placing`` of the record's rows, and its ``inputs`` (steps+1, r) and ``regressors`` there.

    ``absent`` (steps+1, m), the elements that a missing regressor leaves out of ``z``
    """

    model: DiscreteModel
    z: Array
    t: Array
    placing: Placing
    inputs: Array | None
    regressors: Regressors | None
    absent: NDArray[np.bool_]


def timed(model: ModelFile, record: Record) -> tuple[DiscreteModel, Array, Array]:
    """The model over the record's instants, the data z (steps+1, m) and the times t (steps+1,).

    With ``first = 1`` the first row is t1, and row 0 of z, at t0, is empty; with ``first = 0`` it is t0. Times in the file
    that are not uniform give every interval of a continuous model its own matrices; a model in discrete time has instants without
    a row where the record leaves some out. z is the file's; what is known of the measurements (Du and their offset) is the model's
    ``measurement_offset``, which a filter takes off.

    Raises
    ------
    ValueError
        Too few rows; a first row before t0; times that a discrete model does not have; an input or a regressor that lacks: the line is
        named.
    """
    found = over(model, record)
    return found.model, found.z, found.t


def over(model: ModelFile, record: Record) -> Over:
    """:func:`timed`, and what it was made of."""
    at = place(model, record)
    inputs, regressors = _inputs(model, record, at), _regressors(model, record, at)
    z = np.full((len(at.rows), record.z.shape[1]), np.nan)
    there = at.rows >= 0
    z[there] = record.z[at.rows[there]]
    absent = np.zeros(z.shape, dtype=bool) if regressors is None else model.absent(regressors)
    z[absent] = np.nan
    discrete = _discrete(model, at, inputs, regressors)
    t = float(model.experiment.t0) + np.arange(len(z)) * discrete.dt if at.t is None else at.t
    return Over(discrete, z, t, at, inputs, regressors, absent)


def _discrete(model: ModelFile, at: Placing, inputs: Array | None, regressors: Regressors | None) -> DiscreteModel:
    if at.t is None:
        return model.discrete(steps=len(at.rows) - 1, inputs=inputs, regressors=regressors)
    return model.discrete(times=at.t, inputs=inputs, regressors=regressors)


def building(model: ModelFile, record: Record) -> tuple[Callable[[dict[str, float]], DiscreteModel], Array]:
    """From values of constants to the model over the record's instants, again and again; and the data z of :func:`timed`."""
    found, clocked = over(model, record), (model.dt, model.experiment.t0)

    def build(values: dict[str, float]) -> DiscreteModel:
        changed = model.replace(values)
        if (changed.dt, changed.experiment.t0) != clocked:  # another clock, which has to fit the record
            return over(changed, record).model
        return _discrete(changed, found.placing, found.inputs, found.regressors)

    return build, found.z


def notes(model: ModelFile, record: Record, found: Over) -> list[str]:
    """What :func:`over` does beyond reading: instants without a row, measurements that a missing regressor leaves out, inputs in place of u."""
    rows, told = found.placing.rows, list[str]()
    lacking = int((rows < 0).sum()) - int(rows[0] < 0)
    if lacking:
        by = int(np.diff(np.flatnonzero(rows >= 0)).min()) if record.rows > 1 else 1
        apart = f" (no two rows are less than {by} periods apart; {pasted(('--time', NO_TIME))}: they are one apart)" if by > 1 else ""
        told.append(f"{lacking} instant{'s' if lacking > 1 else ''} of the model's grid without a row: not measured there{apart}")
    there = np.flatnonzero(rows >= 0)
    lost = found.absent[there] & ~np.isnan(record.z[rows[there]])
    for j, name in enumerate(model.measurements):
        if lost[:, j].any():
            lines = record.lines[rows[there[lost[:, j]]]]
            where = ", ".join(map(str, lines[:TOLD])) + (f" and {len(lines) - TOLD} more" if len(lines) > TOLD else "")
            plural = "s" if len(lines) > 1 else ""
            told.append(f"{name} in line{plural} {where} is left out: a regressor beside it has no value")
    if record.u is not None and model.moved and not model.driven:
        told.append(f"the known input is the record's ({', '.join(record.mapping.inputs)}), in place of u under [model]")
    for name in model.regressors:
        if name in model.constants:
            column = record.mapping.regressors.get(name, "")
            told.append(f"{name} is the record's ({column}), in place of the constant" if name in record.regressors
                        else f"{name} is the constant {moment(model.constants[name])}, as the record has no such column")  # fmt: skip
    return told


def place(model: ModelFile, record: Record) -> Placing:
    """Where the rows of a record are on the model's clock.

    A first row at t0 in which nothing is measured is t0 itself, also with ``first = 1``: it may tell the input from there on.
    """
    first, t0 = model.experiment.first, float(model.experiment.t0)
    if record.rows - 1 + first < 1:
        msg = f"{record.source}: expected at least 2 rows (first = 0: one is at t0), received {record.rows}"
        raise ValueError(msg)
    rows = np.arange(record.rows)
    if record.t is None:
        return Placing(None, np.concatenate([[-1] * first, rows]).astype(np.int64))
    begins = bool(first and np.isnan(record.z[0]).all() and abs(record.t[0] - t0) <= NEAR * model.dt and record.rows > 1)
    _plausible(model, record, t0)
    if model.kind == "discrete":
        return _on_grid(model, record, first and not begins)
    if begins:
        return Placing(np.concatenate([[t0], record.t[1:]]), rows)
    _begins(record, t0, first)
    return Placing(np.concatenate([[t0][:first], record.t]), np.concatenate([[-1] * first, rows]).astype(np.int64))


def _on_grid(model: ModelFile, record: Record, before: int) -> Placing:
    """The instants of a model in discrete time: multiples of its period from the first row on; rows may be left out."""
    assert record.t is not None
    t, dt = record.t, model.dt
    steps = np.rint((t - t[0]) / dt)
    where = f"{record.source}: line {{}}, column {record.clock}:"
    off = np.flatnonzero(np.abs(t - t[0] - dt * steps) > NEAR * dt)
    if off.size:
        row = int(off[0])
        low = t[0] + dt * np.floor((t[row] - t[0]) / dt)
        msg = (
            f"{where.format(record.lines[row])} {moment(t[row], low)} may be {moment(low, low + dt)} or {moment(low + dt, low)} "
            f"(a model in discrete time has one period, here {moment(dt)} s): expected times on that grid; "
            f"{pasted(('--time', NO_TIME))} takes the rows for one period apart, a continuous model any times"
        )
        raise ValueError(msg)
    twice = np.flatnonzero(np.diff(steps) <= 0)
    if twice.size:
        row = int(twice[0]) + 1
        msg = f"{where.format(record.lines[row])} expected one row at each instant, received a second at {moment(t[row])}"
        raise ValueError(msg)
    by = int(np.diff(steps).min()) if len(t) > 1 else 1
    if by > 1 and record.mapping.unit not in ("", *RELATIVE) and record.mapping.dt is None:
        every = int(np.gcd.reduce(np.diff(steps).astype(np.int64)))
        own = f"{pasted(('--dt', moment(every * dt)))} makes it that, " if every == by else ""
        msg = (
            f"{where.format(record.lines[1])} no two rows are less than {by} periods (dt = {moment(dt)} s) apart: expected a choice, "
            f"{own}{pasted(('--time', NO_TIME))} takes the rows for one period apart, {pasted(('--dt', moment(dt)))} leaves the period"
        )
        raise ValueError(msg)
    if by > 1 and not record.mapping.unit:
        msg = (
            f"{where.format(record.lines[1])} no two rows are one period (dt = {moment(dt)} s) apart, but {by} or more: expected a choice, "
            f"{pasted(('--time', record.clock + ':s'))} (nothing was measured between them) or {pasted(('--time', NO_TIME))} (one period apart)"
        )
        raise ValueError(msg)
    if steps[-1] >= LONGEST:
        msg = f"{where.format(record.lines[-1])} expected at most {LONGEST} periods since the first row, received {moment(steps[-1])}"
        raise ValueError(msg)
    places = steps.astype(np.int64) + before
    grid = t[0] + dt * (np.arange(places[-1] + 1) - before)
    grid[places] = t
    rows = np.full(len(grid), -1)
    rows[places] = np.arange(record.rows)
    return Placing(grid, rows)


def _inputs(model: ModelFile, record: Record, at: Placing) -> Array | None:
    """The known inputs of the instants, (steps+1, r): each row's holds until the next row."""
    if record.u is None:
        if model.driven:
            msg = (
                f"{record.source}: expected the known input of {'B' if model.moved else 'D'}, received none; "
                "--input COLUMN for each column of it, or u under [model]"
            )
            raise ValueError(msg)
        return None
    held, u0 = at.held, record.mapping.u0
    u = record.u[held]
    if held[0] >= 0 or not model.moved:
        if u0:
            what = "the first row is at t0" if held[0] >= 0 else "nothing is moved by the input: no B"
            raise ValueError(f"{record.source}: --u0: expected none ({what}), received {', '.join(map(str, u0))}")
        return u
    if not u0:
        msg = (
            f"{record.source}: expected an input for every interval, received none from t0 to the first row (first = 1): --u0 VALUE says "
            "what it is, or a row at t0 with empty measurements; or set first = 0 under [experiment], then the first row is at t0"
        )
        raise ValueError(msg)
    if len(u0) != u.shape[1]:
        raise ValueError(f"{record.source}: --u0: expected {u.shape[1]} numbers, one for each input, received {len(u0)}")
    u[held < 0] = u0
    return u


def _regressors(model: ModelFile, record: Record, at: Placing) -> Regressors | None:
    """The columns that elements of the model name, by instants."""
    names = [name for name in model.regressors if name in record.regressors or name not in model.constants]
    if not names:
        return None
    there = at.rows >= 0
    values = {}
    for name in names:
        if name not in record.regressors:
            msg = f"{record.source}: expected the regressor {name}, received none; {pasted(('--regressor', f'{name}=COLUMN'))}"
            raise ValueError(msg)
        values[name] = np.where(there, record.regressors[name][at.rows], np.nan)
    return Regressors(values, np.where(there, record.lines[at.rows], 0), record.source)


def _plausible(model: ModelFile, record: Record, t0: float) -> None:
    """Refuse a first row or a usual interval that is a thousand periods away, unless the unit or t0 is told."""
    assert record.t is not None
    dt, start, told = model.dt, float(record.t[0]), record.mapping
    where = f"{record.source}: line {record.lines[0]}, column {record.clock}:"
    away = (start - t0) / dt
    if away > MANY and not told.t0 and (model.kind == "continuous" or model.varying):
        likely = choice(record.clock, record.start) if not told.unit else ""
        msg = (
            f"{where} {record.start} is {moment(away)} periods after t0 = {moment(t0, start)}: expected a first row near t0; "
            f"{likely or pasted(('--t0', 'first'))} counts from the first row ({pasted(('--t0', 'model'))}: the times are meant so)"
        )
        raise ValueError(msg)
    if record.rows < 2 or told.unit:
        return
    usual = float(np.median(np.diff(record.t))) / dt
    if 1 / MANY < usual * (1 - 1e-6) and usual * (1 + 1e-6) < MANY:
        return
    factors = {"ms": 1e3, "us": 1e6, "ns": 1e9, "min": 1 / 60, "h": 1 / 3600, "d": 1 / 86400}
    unit = min(factors, key=lambda name: abs(np.log(usual / factors[name])))
    calendar = choice(record.clock, record.start)
    other = calendar or pasted(("--time", f"{record.clock}:{unit}"))
    names = {"ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds", "min": "minutes", "h": "hours", "d": "days"}
    msg = (
        f"{where} the usual interval, {moment(usual * dt)} s, is {moment(float(f'{usual:.4g}'))} times the model's dt = {moment(dt)} s: expected a choice, "
        f"{other} ({'the calendar' if calendar else names[unit]}) or {pasted(('--time', record.clock + ':s'))} (seconds)"
    )
    raise ValueError(msg)


def _begins(record: Record, t0: float, first: int) -> None:
    """Refuse a first row that is not after t0, or (with ``first = 0``) not at it."""
    assert record.t is not None
    start, where = float(record.t[0]), f"{record.source}: line {record.lines[0]}, column {record.clock}: expected"
    if first and start <= t0:
        msg = f"{where} a time after t0 = {moment(t0, start)} (the first row is t1), received {moment(start, t0)}; --t0 first, or set t0 or first = 0 under [experiment]"
        raise ValueError(msg)
    if not first and start != t0:
        msg = f"{where} t0 = {moment(t0, start)} (first = 0), received {moment(start, t0)}; --t0 first, or set t0 = {start!r} under [experiment]"
        raise ValueError(msg)
