"""The times of a record and the model's clock: which model moves the state from row to row."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ctlabs.files.mapping import pasted
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


def timed(model: ModelFile, record: Record) -> tuple[DiscreteModel, Array, Array]:
    """The model over the record's instants, the data z (steps+1, m) and the times t (steps+1,).

    With ``first = 1`` the first row is t1, and row 0 of z, at t0, is empty; with ``first = 0`` it is t0. Times in the file
    that are not uniform give every interval of a continuous model its own matrices.

    Raises
    ------
    ValueError
        Too few rows; a first row before t0; intervals that a discrete model does not have: the line is named.
    """
    first, t0 = model.experiment.first, float(model.experiment.t0)
    steps = record.rows - 1 + first
    if steps < 1:
        msg = f"{record.source}: expected at least 2 rows (first = 0: one is at t0), received {record.rows}"
        raise ValueError(msg)
    inputs = _inputs(model, record, first)
    z = np.vstack([np.full((first, record.z.shape[1]), np.nan), record.z])
    if record.t is not None:
        _plausible(model, record, t0)
    if record.t is None:
        discrete = model.discrete(steps=steps, inputs=inputs)
        return discrete, z, t0 + np.arange(steps + 1) * discrete.dt
    if model.kind == "discrete":
        return _uniform(model, record, steps, z, inputs)
    t = np.concatenate([[t0][:first], record.t])
    _begins(record, t0, first)
    return model.discrete(times=t, inputs=inputs), z, t


def building(model: ModelFile, record: Record) -> tuple[Callable[[dict[str, float]], DiscreteModel], Array]:
    """From values of constants to the model over the record's instants, again and again; and the data z of :func:`timed`."""
    first, t0 = model.experiment.first, float(model.experiment.t0)
    _model, z, t = timed(model, record)
    inputs = _inputs(model, record, first)

    def build(values: dict[str, float]) -> DiscreteModel:
        changed = model.replace(values)
        if (changed.dt, float(changed.experiment.t0)) != (model.dt, t0):  # another clock, which has to fit the record
            return timed(changed, record)[0]
        if record.t is None:
            return changed.discrete(steps=len(z) - 1, inputs=inputs)
        return changed.discrete(times=t, inputs=inputs)

    return build, z


def _inputs(model: ModelFile, record: Record, first: int) -> Array | None:
    """The known inputs of the intervals, (steps, r): each row's acts until the next row."""
    if record.u is None:
        if model.driven:
            msg = f"{record.source}: expected the known input of B, received none; --input COLUMN for each column of B, or u under [model]"
            raise ValueError(msg)
        return None
    if first:
        msg = (
            f"{record.source}: expected an input for every interval, received none from t0 to the first row (first = 1): "
            "set first = 0 under [experiment], then the first row is at t0"
        )
        raise ValueError(msg)
    return record.u[:-1]


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


def _uniform(
    model: ModelFile, record: Record, steps: int, z: Array, inputs: Array | None
) -> tuple[DiscreteModel, Array, Array]:
    """The same for a model in discrete time, whose period is what every interval must be."""
    assert record.t is not None
    first, dt = model.experiment.first, model.dt
    t = np.concatenate([[record.t[0] - dt][:first], record.t])
    off = np.flatnonzero(np.abs(t - t[0] - dt * np.arange(steps + 1)) > NEAR * dt)
    if off.size:
        row = off[0] - first
        msg = (
            f"{record.source}: line {record.lines[row]}, column {record.clock}: expected {moment(t[0] + dt * off[0], record.t[row])} "
            f"(a model in discrete time has one period, here {moment(dt)} s), received {moment(record.t[row], t[0] + dt * off[0])}; "
            "write a row with empty cells where nothing was measured, or a continuous model"
        )
        raise ValueError(msg)
    return model.discrete(times=t, inputs=inputs), z, t
