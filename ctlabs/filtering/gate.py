r"""The gate: measurements that are too far from their prediction are left out.

An element does not enter the update at k where, given what was measured before and not left out,

.. math:: \nu_i^2 > g^2 S_{ii}, \quad S = HP^-H^T + R

The others enter with their own part of H, R and N, as beside an element that was not measured. Which are left out is decided instant
by instant, as what is left out changes the predictions that follow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ctlabs.filtering.problem import FilterProblem
from ctlabs.filtering.results import Filtered, LeftOut
from ctlabs.linalg.checks import Array
from ctlabs.models.linear import DiscreteModel

#: Instants that are filtered before they are looked at; twice as many after every piece without an outlier.
PIECE = 64


def width(gate: Any) -> float:
    """The gate as a number of standard deviations."""
    if isinstance(gate, bool) or not isinstance(gate, int | float | np.number) or not 0 < gate < np.inf:
        msg = f"gate: expected a positive number of standard deviations, received {gate!r}"
        raise ValueError(msg)
    return float(gate)


def gated(
    problem: FilterProblem, data: Array, gate: float, answer: Callable[[FilterProblem], Filtered]
) -> tuple[FilterProblem, tuple[LeftOut, ...]]:
    """The problem without the elements beyond the gate, and these; ``data`` (rows, m, runs) as they were given, ``answer`` a filter.

    Raises
    ------
    ValueError
        No positive gate; several runs; nothing within the gate.
    """
    gate, rows, left = width(gate), len(problem.z), list[LeftOut]()
    if problem.z.shape[2] != 1:
        msg = f"gate: expected one record, received {problem.z.shape[2]} runs, which share their gains"
        raise ValueError(msg)
    z, checked, begin, model, length = problem.z.copy(), -1, 0, problem.model, PIECE
    while checked < rows - 1:
        end = min(max(checked, begin) + length + 1, rows)
        found = answer(FilterProblem(_piece(model, begin, end), z[begin:end], problem.t[begin:end], 0, single=True))
        away = _away(found)
        away[: checked + 1 - begin] = 0.0
        beyond = np.flatnonzero((away > gate).any(axis=1))
        if beyond.size:
            at = int(beyond[0])
            checked, length = begin + at, PIECE
            for i in np.flatnonzero(away[at] > gate).tolist():
                told = float(data[checked - problem.first, i, 0]), float(found.innovation[at, i, 0]), float(away[at, i])
                left.append(LeftOut(checked - problem.first, i, *told))
                z[checked, i] = np.nan
        else:
            checked, length = end - 1, 2 * length
        here = checked - begin
        if np.isfinite(found.P_minus[here]).all():  # else the pieces begin once more where the record does
            model = replace(problem.model, x0=found.x_minus[here, :, 0], P0=found.P_minus[here])
            begin = checked
    if left and np.isnan(z).all():
        msg = (
            f"gate: expected measurements within {gate:g} σ of their predictions, received none (the first is {left[0].sigmas:.3g} σ "
            "away): the initial estimate, R or Qd is wrong, and a record without a gate tells which"
        )
        raise ValueError(msg)
    return replace(problem, z=z), tuple(left)


def _piece(model: DiscreteModel, begin: int, end: int) -> DiscreteModel:
    """The model of the instants from ``begin`` until before ``end``."""
    varying: dict[str, Any] = {name: M[begin : end - 1 + extra] for name, (M, extra) in model.varying().items()}
    return replace(model, **varying) if varying and end - begin > 1 else model


def _away(found: Filtered) -> Array:
    """|ν| in standard deviations (rows, m), 0 where nothing entered or something unknown was measured."""
    variances = np.diagonal(found.S, axis1=1, axis2=2)
    there = np.isfinite(found.innovation[:, :, 0]) & np.isfinite(variances) & (variances > 0)
    return np.abs(np.where(there, found.innovation[:, :, 0], 0.0)) / np.sqrt(np.where(there, variances, 1.0))
