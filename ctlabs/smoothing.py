r"""Smoothing: every state given the whole record, or given so many more measurements.

The estimate from what is measured up to k and the likelihood of what is measured after k meet:

.. math:: p(x_k \mid z_1\dots z_N) \propto p(x_k \mid z_1\dots z_k)\;
          \exp\left(-\tfrac12\|U_k(x_k - \hat x_k^+) - y_k\|^2\right), \qquad
          P_s = L(I + L^TU^TUL)^{-1}L^T,\ P^+ = LL^T

(Fraser & Potter, IEEE Trans. AC-14, 1969). U and y come backward through orthogonal reflections of
square roots (:mod:`ctlabs.recursions.backward`), and perfect measurements (R = 0) as constraints Cx = c beside them: no covariance is
inverted, so that singular P0, Qd, Φ, R or P⁻ are no exceptions, and P_s is a square, symmetric and nonnegative. After a
vague start (:mod:`ctlabs.forms.vague`) L has the columns of what is vaguely known, or not known, beside P's. With N ≠ 0 the
transition is Φ−NR⁺H with the noise Qd−NR⁺Nᵀ. Only the filter's estimates, covariances and innovations are used: any form's will do.
It equals the recursion of Rauch, Tung & Striebel (AIAA J. 3, 1965), where that has the inverses that it needs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ctlabs import _check, forms, kalman, records
from ctlabs._check import Array
from ctlabs.contradictions import Contradiction
from ctlabs.models import DiscreteModel

if TYPE_CHECKING:
    from ctlabs.forms import Filtered
    from ctlabs.recursions.backward import Backward, Prior

#: Windows of the fixed-lag smoother that go back together where their matrices are the same.
TOGETHER = 64


@dataclass(frozen=True, slots=True, eq=False)
class Smoothed:
    """Estimates given the whole record.

    ``t`` (steps+1,) s · ``x`` (steps+1, n[, runs]) · ``P`` (steps+1, n, n), covariance of their errors · ``lag_one``
    (steps+1, n, n), entry k is cov(x_k, x_{k−1}) given the record; NaN at 0, which nothing precedes. A state that the
    whole record does not determine is NaN with the variance ``inf``, zeros beside it and NaN in ``lag_one`` ·
    ``contradictions``, those of the filtered record: the estimates are given the rest of it
    """

    t: Array
    x: Array
    P: Array
    lag_one: Array
    contradictions: tuple[Contradiction, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Lagged:
    """Estimates given the record up to ``lag`` steps later, or up to its end: entry k is known at t_{k+lag}.

    ``t`` (steps+1,) s · ``x`` (steps+1, n) · ``P`` (steps+1, n, n), covariance of their errors · ``lag``
    """

    t: Array
    x: Array
    P: Array
    lag: int


def smooth(model: DiscreteModel, filtered: Filtered) -> Smoothed:
    """Every state given the whole record.

    Parameters
    ----------
    model : the filter's model
    filtered : its history, of any form, of one record or of several runs

    Raises
    ------
    ValueError
        A history that does not fit the model; one that began without information elsewhere (``inf`` in P, and no ``start``).
    FloatingPointError
        An overflow.

    >>> from ctlabs import records
    >>> m = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])
    >>> found = smooth(m, records.filter_record(m, [[np.nan], [1.0], [2.0]]))
    >>> found.x[:, 0].round(6), found.P[:, 0, 0].round(6), found.lag_one[1:, 0, 0].round(6)
    (array([1.142857, 1.257143, 1.628571]), array([1.428571, 0.628571, 0.657143]), array([0.571429, 0.314286]))
    """
    _fits(model, filtered)
    single = filtered.x_plus.ndim == 2
    way, prior, x = _way(model, filtered)
    P, lag_one = np.empty_like(filtered.P_plus), np.full_like(filtered.P_plus, np.nan)
    _compiled("smooth", way, prior, x, P, lag_one)
    return Smoothed(filtered.t, x[:, :, 0] if single else x, P, lag_one, filtered.contradictions)


def fixed_lag(model: DiscreteModel, z: ArrayLike, lag: int, first: int = 1) -> Lagged:
    r"""Every state given what is measured up to ``lag`` steps later: :math:`E[x_{k-lag} \mid z_1\dots z_k]`, exactly.

    Each instant k goes back over the last ``lag`` steps, so that the work per step is proportional to ``lag``. With
    ``lag=0`` this is the filter, with ``lag`` ≥ steps the smoother. The last ``lag`` states have the rest of the record.

    Parameters
    ----------
    model : constant or time-varying
    z : (steps+1, m), NaN = not measured. With ``first=1`` row 0 is not used.
    lag : number of steps, ≥ 0
    first : 1 (first measurement at t1) or 0 (at t0)

    Raises
    ------
    TypeError, ValueError, FloatingPointError
        As for :func:`ctlabs.records.filter_record`; a lag that is no whole number ≥ 0.

    >>> m = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])
    >>> fixed_lag(m, [[np.nan], [1.0], [2.0], [4.0]], 1).x[:, 0].round(6)
    array([0.833333, 1.257143, 2.215054, 3.107527])
    """
    lag = _check.count("lag", lag, least=0)
    filtered = records.filter_record(model, z, first)
    whole = smooth(model, filtered)
    steps = len(filtered.t) - 1
    if lag >= steps:
        return Lagged(whole.t, whole.x, whole.P, lag)
    way, prior, x = _way(model, filtered)
    P = np.empty_like(filtered.P_plus)
    _compiled("windows", way, prior, lag, TOGETHER, x, P)
    x, rest = x[:, :, 0], slice(steps - lag, None)
    x[rest], P[rest] = whole.x[rest], whole.P[rest]
    return Lagged(filtered.t, x, P, lag)


def _fits(model: DiscreteModel, filtered: Filtered) -> None:
    """Refuse a history that is not one of the model, and one with infinite covariances."""
    _check.instance("model", model, DiscreteModel)
    rows, n, m = len(filtered.t), model.n, model.m
    shapes = {"x_plus": (rows, n), "P_plus": (rows, n, n), "innovation": (rows, m), "used": (rows, m)}
    for name, shape in shapes.items():
        found = getattr(filtered, name).shape
        if found[: len(shape)] != shape:
            msg = f"filtered.{name}: expected shape {shape} as the model has it, received {found}"
            raise ValueError(msg)
    kalman._horizon(model, rows - 1, 1)
    begin = 0 if filtered.start is None else len(filtered.start.P)
    unknown = ~np.isfinite(filtered.P_plus[begin:]).all(axis=(1, 2))
    if unknown.any():
        found = f"inf at step {begin + int(np.argmax(unknown))} (no information)"
        msg = f"filtered.P_plus: expected finite covariances, received {found}"
        raise ValueError(msg)


def _way(model: DiscreteModel, filtered: Filtered) -> tuple[Backward, Prior, Array]:
    """What the compiled way back needs: later data, earlier data, and x̂⁺ (steps+1, n, runs) to be changed."""
    from ctlabs.recursions.backward import Backward, Prior

    rows, n, m, start = len(filtered.t), model.n, model.m, filtered.start
    x_minus, x_plus = (x.reshape(rows, n, -1).copy() for x in (filtered.x_minus, filtered.x_plus))
    innovation, P = filtered.innovation.reshape(rows, m, -1).copy(), filtered.P_plus.copy()
    L, A = np.empty((2, 0, n, n))
    unknown, later = np.empty(0, dtype=np.int64), np.zeros(rows, dtype=np.int64)
    if start is not None:
        begin = len(start.P)
        x_minus[:begin], x_plus[:begin], innovation[:begin] = start.x_minus, start.x_plus, start.innovation
        P[:begin], L, A, unknown, later[:begin] = start.P, start.L, start.A, start.unknown, start.determined
    Phi, Q = _motions(model, filtered.used)
    system = records.system(model)
    way = Backward(
        Phi,
        np.empty_like(Q),
        np.empty((rows, m, n)),
        np.empty(innovation.shape),
        np.empty((rows, m), dtype=np.int64),
        x_plus - x_minus,
        np.empty(rows, dtype=np.int64),
    )
    _compiled("prepare", system, records.fixed(filtered.used), records.fixed(innovation), Q, way)
    return way, Prior(P, L, A, unknown.astype(np.int64), later), x_plus


def _motions(model: DiscreteModel, used: Array) -> tuple[Array, Array]:
    """Φ and Q of each step as stacks, or of one step that is that of all; with N ≠ 0 what z_k tells of w_k is in them."""
    if model.N is None:
        return _stack(model.Phi), _stack(model.Qd)
    motion = forms.Record(model, np.zeros((*used.shape, 1)), 0, float, used).motion
    Phi, Q = zip(*((step[0], step[2].matrix) for step in map(motion, range(len(used) - 1))), strict=True)
    return np.array(Phi), np.array(Q)


def _stack(matrix: Array) -> Array:
    return np.array(matrix if matrix.ndim == 3 else matrix[None], order="C")


def _compiled(name: str, *arguments: object) -> None:
    """A compiled loop of :mod:`ctlabs.recursions.backward`, loaded when it is needed."""
    from ctlabs.recursions import backward

    if getattr(backward, name)(*arguments) is False:
        msg = "smoothed P: expected finite covariances, received an overflow"
        raise FloatingPointError(msg)
