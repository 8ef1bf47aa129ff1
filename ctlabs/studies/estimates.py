"""``estimates.csv``: the estimates, predictions and innovations of a filtered record, a row for each instant: of every row of the record,
and of the model's grid between them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ctlabs.files.datafile import Record
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import deviations
from ctlabs.models import DiscreteModel, at
from ctlabs.studies import common
from ctlabs.studies.filtered import Run


def table(run: Run) -> tuple[list[str], list[list[Any]]]:
    """Columns and rows; times as they were written beside those of the model's clock where the two differ."""
    model, found = run.model, run.filtered
    with np.errstate(invalid="ignore"):
        sd = np.sqrt(np.diagonal(found.S, axis1=1, axis2=2))
    predicted, spread = predictions(model, found.x_minus, found.P_minus)
    parts: list[tuple[Any, Array, Array, str]] = [(model.states, found.x_plus, deviations(found.P_plus), "{}|{}_sd")]
    if run.smoothed is not None:
        parts.append((model.states, run.smoothed.x, deviations(run.smoothed.P), "{}_smoothed|{}_smoothed_sd"))
    parts += [
        (model.measurements, predicted, spread, "predicted_{}|predicted_sd_{}"),
        (model.measurements, found.innovation, np.where(np.isfinite(found.innovation), sd, np.nan), "innovation_{}|innovation_sd_{}"),
    ]
    columns, values = list[str](), list[Array]()
    for names, value, deviation, pattern in parts:
        for i, name in enumerate(names):
            columns += pattern.format(name, name).split("|")
            values += [value[:, i], deviation[:, i]]
    begin = 0 if run.rows[0] >= 0 else run.first  # a row at t0 is one although nothing is measured in it
    rows = np.column_stack(values)[begin:].tolist()
    head, times = clocks(run.record, run.t[begin:], columns, run.rows[begin:])
    common.distinct("estimates.csv", ["k", *head, *columns])
    return ["k", *head, *columns], [[k, *time, *row] for k, (time, row) in enumerate(zip(times, rows, strict=True), begin)]


def predictions(model: DiscreteModel, x: Array, P: Array) -> tuple[Array, Array]:
    """What is measured at each instant given the estimates x (steps+1, n) and P before: ẑ = Hx̂⁻ + d and its σ, (steps+1, m) each.

    σ is that of a measurement, √(HP⁻Hᵀ + R) on the diagonal; ``inf`` where it would say something of an unknown state.
    """
    rows = len(x)
    H, R = (np.broadcast_to(M, (rows, *M.shape[-2:])) for M in (model.H, model.R))
    unknown = np.einsum("kij,kj->ki", np.abs(H), np.isinf(np.diagonal(P, axis1=1, axis2=2)).astype(float)) > 0
    known = np.where(np.isfinite(P), P, 0.0)
    S = ((H @ known) * H).sum(axis=2) + np.diagonal(R, axis1=1, axis2=2)
    z = (H @ np.where(np.isfinite(x), x, 0.0)[:, :, None])[:, :, 0]
    if model.measurement_offset is not None:
        z = z + np.array([at(model.measurement_offset, k, 1) for k in range(rows)])
    return np.where(unknown, np.nan, z), np.sqrt(np.where(unknown, np.inf, S))


def clocks(record: Record, t: Array, others: list[str], rows: NDArray[np.int64] | None = None) -> tuple[list[str], list[list[Any]]]:
    """The columns of the times of the ``rows`` (by default all), and their cells: as written, under the name that they had, and in
    seconds as ``t``. An instant without a row (−1) has nothing written.
    """
    seconds = t.tolist()
    if not record.clocked:
        return ["t"], [[each] for each in seconds]
    stamps = [stamp.strip() for stamp in record.stamps]
    written = stamps if rows is None else [stamps[row] if row >= 0 else "" for row in rows]
    cells = [list(pair) for pair in zip(written, seconds, strict=True)]
    if record.clock == "t":
        return ["t", "seconds"], cells
    return [f"time_{record.clock}" if record.clock in ("k", *others) else record.clock, "t"], cells
