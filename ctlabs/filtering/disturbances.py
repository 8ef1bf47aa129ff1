r"""Single instants that speak against a model: values added to one measurement, or to the state between two.

Of a value δ added to element i of z_k only (an outlier), or to state j between k − 1 and k (a break: a level that jumps, a slope that
changes), the innovations of a right filter are linear, :math:`\nu = \delta a + N(0, S)`. With the score u and the information D of
:mod:`ctlabs.filtering.engines.shocks`

.. math:: \hat\delta = u/D, \quad \tau = u/\sqrt D, \quad \tau \sim N(0, 1) \text{ if } \delta = 0,

and τ² is twice what ln p(z) gains by δ. τ is the smoothed disturbance over its standard deviation: Harvey & Koopman's auxiliary
residual, where the disturbance has a noise of its own. It is exact also where R or Qd is singular.

Source: Harvey & Koopman (1992), J. Bus. Econ. Stat. 10, 377–389; de Jong & Penzer (1998), J. Amer. Statist. Assoc. 93, 796–806.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ctlabs.filtering.gathered import corrected
from ctlabs.filtering.results import Filtered
from ctlabs.linalg.checks import Array
from ctlabs.models.linear import DiscreteModel


class StartShift(NamedTuple):
    """The most likely change of the initial estimate: ``shift`` (n,), ``gain`` (twice that of ln p(z)) and its degrees of freedom."""

    shift: Array
    gain: float
    dof: int


@dataclass(frozen=True, slots=True, eq=False)
class Shocks:
    """What a record says of a value added at each instant, over k = 0 … steps.

    ``outlier`` (steps+1, m), τ of a value added to z_k, NaN where an element is not measured · ``outlier_size``, that value ·
    ``shock`` (steps+1, n), τ of a value added to x_k, NaN where no later measurement shows it · ``shock_size``, that value ·
    ``start``, of the initial estimate; None where the record began without information. Of the instants of such a beginning
    nothing is known (NaN), nor of a value added to x_0 alone, which is the initial estimate's; nor up to an instant whose S
    rounding has made singular
    """

    outlier: Array
    outlier_size: Array
    shock: Array
    shock_size: Array
    start: StartShift | None

    @property
    def count(self) -> int:
        """How many values were tried."""
        return int(np.isfinite(self.outlier).sum() + np.isfinite(self.shock).sum())


def shocks(filtered: Filtered) -> Shocks:
    """What one filtered record, of any form of the optimal filter, says of values added at single instants.

    Raises
    ------
    ValueError
        An ensemble, or a record of a nonlinear model.

    >>> from ctlabs import kalman_filter
    >>> walk = DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[10]])
    >>> found = shocks(kalman_filter(walk, [0.0, 0.0, 12.0, 0.0, 0.0]))
    >>> int(np.nanargmax(abs(found.outlier))), found.outlier_size[3].round(6), found.outlier[3].round(3)
    (3, array([12.]), array([8.868]))
    """
    model = filtered.model
    if not isinstance(model, DiscreteModel) or filtered.z.ndim != 2:
        msg = f"filtered: expected one record of a linear model, received {type(model).__name__} and shape {filtered.z.shape}"
        raise ValueError(msg)
    from ctlabs.filtering.engines import shocks as engine  # numba costs 0.3 s to import

    rows, n, m = len(filtered.t), model.n, model.m
    begin = int(np.flatnonzero(~np.isfinite(filtered.P_minus).all(axis=(1, 2))).max(initial=-1)) + 1
    system, M = corrected(model, filtered.used)
    (r, N), (u, D) = np.full((2, rows, n), np.nan), np.full((2, rows, m), np.nan)
    told = engine.ShockOutputs(r, N, u, D, np.zeros((n, n)))
    own = (np.array(a, order="C") for a in (filtered.K, filtered.S, filtered.innovation, filtered.used))
    if begin < rows:
        engine.backward(engine.ShockInputs(system.Phi, M, system.H, *own), begin, told)
    start = None
    if begin == 0 and np.isfinite(told.N0).all():
        start = _moved(told.r[0], told.N0)
        told.r[0] = np.nan
    return Shocks(*_judged(told.u, told.D), *_judged(told.r, told.N), start)


def _judged(score: Array, information: Array) -> tuple[Array, Array]:
    """τ and δ; NaN where there is no information."""
    there = (information > 0) & np.isfinite(information) & np.isfinite(score)
    safe = np.where(there, information, 1.0)
    return np.where(there, score / np.sqrt(safe), np.nan), np.where(there, score / safe, np.nan)


def _moved(r: Array, N: Array) -> StartShift:
    """The shift N⁺r of x0, as far as the record shows one."""
    scale = np.sqrt(np.where(N.diagonal() > 0, N.diagonal(), 1.0))
    values, vectors = np.linalg.eigh(N / (scale[:, None] * scale))
    seen = values > 1e-10
    along = vectors[:, seen].T @ (r / scale)
    shift = vectors[:, seen] @ (along / values[seen]) / scale
    return StartShift(shift, float((along**2 / values[seen]).sum()), int(seen.sum()))
