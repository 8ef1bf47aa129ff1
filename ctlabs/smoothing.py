r"""Smoothing: every state given the whole record, or given so many more measurements.

The estimate from what is measured up to k and the likelihood of what is measured after k meet:

.. math:: p(x_k \mid z_1\dots z_N) \propto p(x_k \mid z_1\dots z_k)\;
          \exp\left(-\tfrac12\|U_k(x_k - \hat x_k^+) - y_k\|^2\right), \qquad
          P_s = L(I + L^TU^TUL)^{-1}L^T,\ P^+ = LL^T

(Fraser & Potter, IEEE Trans. AC-14, 1969). U and y come backward through orthogonal reflections of
square roots (:mod:`ctlabs.recursions.backward`): no covariance is inverted, so that singular P0, Qd, Φ or P⁻ are no exceptions, and
P_s is a square, symmetric and nonnegative. It equals the recursion of Rauch, Tung & Striebel (AIAA J. 3, 1965),

.. math:: \hat x_s = \hat x^+ + C(\hat x_{s,k+1} - \hat x^-_{k+1}), \quad C = P^+\Phi^T(P^-_{k+1})^{-1}, \quad
          P_s = (I-C\Phi)P^+(I-C\Phi)^T + C(P_{s,k+1} + Q_d)C^T

which serves where a perfect measurement (R = 0) would be an infinite information. With N ≠ 0 both use Φ−NR⁺H and
Qd−NR⁺Nᵀ. Only the filter's estimates, covariances and innovations are used: any form's will do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ctlabs import _check, kalman, records
from ctlabs._check import Array
from ctlabs.contradictions import Contradiction
from ctlabs.discretise import ldl
from ctlabs.models import DiscreteModel

if TYPE_CHECKING:
    from ctlabs.forms import Filtered
    from ctlabs.recursions.backward import Backward

#: Windows of the fixed-lag smoother that go back together where their matrices are the same.
TOGETHER = 64


@dataclass(frozen=True, slots=True, eq=False)
class Smoothed:
    """Estimates given the whole record.

    ``t`` (steps+1,) s · ``x`` (steps+1, n[, runs]) · ``P`` (steps+1, n, n), covariance of their errors · ``lag_one``
    (steps+1, n, n), entry k is cov(x_k, x_{k−1}) given the record; NaN at 0, which nothing precedes · ``contradictions``,
    those of the filtered record: the estimates are given the rest of it
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
        A history that does not fit the model; one that starts from zero information (``inf`` in P).

    >>> from ctlabs import records
    >>> m = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])
    >>> found = smooth(m, records.filter_record(m, [[np.nan], [1.0], [2.0]]))
    >>> found.x[:, 0].round(6), found.P[:, 0, 0].round(6), found.lag_one[1:, 0, 0].round(6)
    (array([1.142857, 1.257143, 1.628571]), array([1.428571, 0.628571, 0.657143]), array([0.571429, 0.314286]))
    """
    _fits(model, filtered)
    single = filtered.x_plus.ndim == 2
    x_plus = filtered.x_plus[:, :, None] if single else filtered.x_plus
    x, P, lag_one = x_plus.copy(order="C"), filtered.P_plus.copy(order="C"), np.full_like(filtered.P_plus, np.nan)
    way = _way(model, filtered)
    if way is None or not _compiled("smooth", way, records.fixed(filtered.P_plus), x, P, lag_one):
        x, P, lag_one = _striebel(model, filtered, 0, len(x) - 1)
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
    x, P = filtered.x_plus[:, :, None].copy(), filtered.P_plus.copy()
    way = _way(model, filtered)
    if way is None or not _compiled("windows", way, records.fixed(filtered.P_plus), lag, TOGETHER, x, P):
        for k in range(steps - lag):
            found, covariance, _ = _striebel(model, filtered, k, k + lag)
            x[k], P[k] = found[0], covariance[0]
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
    unknown = ~np.isfinite(filtered.P_plus).all(axis=(1, 2))
    if unknown.any():
        msg = f"filtered.P_plus: expected finite covariances, received inf at step {int(np.argmax(unknown))} (no information)"
        raise ValueError(msg)


def _way(model: DiscreteModel, filtered: Filtered) -> Backward | None:
    """What the compiled way back needs; None where a measurement is perfect."""
    from ctlabs.recursions.backward import Backward

    rows, n = len(filtered.t), model.n
    innovation = records.fixed(filtered.innovation.reshape(rows, model.m, -1))
    changing = model.N is not None or model.Qd.ndim == 3
    Phi = np.tile(model.Phi, (rows - 1, 1, 1)) if model.N is not None and model.Phi.ndim == 2 else np.array(model.Phi)
    way = Backward(
        np.ascontiguousarray(Phi if Phi.ndim == 3 else Phi[None]),
        np.empty((rows - 1 if changing else 1, n, n)),
        np.empty((rows, model.m, n)),
        np.empty(innovation.shape),
        np.ascontiguousarray(filtered.x_plus - filtered.x_minus).reshape(rows, n, -1),
        np.empty(rows, dtype=np.int64),
    )
    return way if _compiled("prepare", records.system(model), records.fixed(filtered.used), innovation, way) else None


def _compiled(name: str, *arguments: object) -> bool:
    """A compiled loop of :mod:`ctlabs.recursions.backward`, loaded when it is needed."""
    from ctlabs.recursions import backward

    return bool(getattr(backward, name)(*arguments))


def _striebel(model: DiscreteModel, filtered: Filtered, start: int, end: int) -> tuple[Array, Array, Array]:
    """Rauch, Tung & Striebel's recursion over the instants from ``start`` to ``end``: x (…, n, runs), P, lag_one."""
    rows, count, n = len(filtered.t), end - start + 1, model.n
    x_minus, x_plus = filtered.x_minus.reshape(rows, n, -1), filtered.x_plus.reshape(rows, n, -1)
    x, P = x_plus[start : end + 1].copy(), filtered.P_plus[start : end + 1].copy()
    lag_one = np.full((count, n, n), np.nan)
    for i in range(count - 2, -1, -1):
        k = start + i
        Phi, Q, _ = kalman._motion(model, k, filtered.used[k])
        P_plus = filtered.P_plus[k]
        C = _divided(Phi @ P_plus, filtered.P_minus[k + 1]).T
        left = np.eye(n) - C @ Phi
        x[i] += C @ (x[i + 1] - x_minus[k + 1])
        P_s = left @ P_plus @ left.T + C @ (P[i + 1] + Q) @ C.T
        P[i], lag_one[i + 1] = 0.5 * (P_s + P_s.T), P[i + 1] @ C.T
    return x, P, lag_one


def _divided(B: Array, P: Array) -> Array:
    """P⁻¹B; a direction in which P is zero, as B is then, gets zeros."""
    L, d = ldl(P)
    B = np.array(B)
    for j in range(len(P)):
        B[j + 1 :] -= np.outer(L[j + 1 :, j], B[j])
    B /= np.where(d > 0, d, np.inf)[:, None]
    for j in range(len(P) - 1, -1, -1):
        B[:j] -= np.outer(L[j, :j], B[j])
    return B
