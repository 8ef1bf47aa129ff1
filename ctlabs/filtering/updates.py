r"""Measurement updates one way and another: all elements at once, one after another, decorrelated.

With independent measurement noises the elements of z may be processed one at a time; with correlated ones only after
the transformation that makes their covariance diagonal,

.. math:: R = L\,\mathrm{diag}(d)\,L^T, \quad z' = L^{-1}z, \quad H' = L^{-1}H, \quad R' = \mathrm{diag}(d)

(Bierman, *Factorization Methods for Discrete Sequential Estimation* (1977), section IV.2).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.filtering.algorithms.contract import Counted
from ctlabs.filtering.engines import adapter
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.linalg.factors import ldl
from ctlabs.models import DiscreteModel

#: Ways of an update that :func:`flops` counts.
WAYS = ("joint", "sequential", "decorrelation")


class Estimate(NamedTuple):
    """``x`` (n,), an estimate · ``P`` (n, n), the covariance of its error."""

    x: Array
    P: Array


@dataclass(frozen=True, slots=True, eq=False)
class Decorrelated:
    """``L`` (m, m), unit lower triangular · ``d`` (m,), variances of the new noises · ``H`` (m, n), the new matrix.

    Each may vary with time: (steps+1, …).
    """

    L: Array
    d: Array
    H: Array

    @property
    def R(self) -> Array:
        """The diagonal covariance of the new noises, (…, m, m)."""
        return self.d[..., None] * np.eye(self.d.shape[-1])

    def measurements(self, z: ArrayLike) -> Array:
        r"""z' = L⁻¹z for z (m[, runs]), or (steps+1, m[, runs]) where L varies; NaN spoils the elements after it."""
        data = np.asarray(z, dtype=np.float64)
        if self.L.ndim == 2:
            return np.asarray(np.linalg.solve(self.L, data))
        column = data[:, :, None] if data.ndim == 2 else data
        result = np.asarray(np.linalg.solve(self.L, column))
        return result[:, :, 0] if data.ndim == 2 else result


def decorrelate(H: ArrayLike, R: ArrayLike) -> Decorrelated:
    r"""The equivalent measurement with independent noises.

    .. math:: z = Hx + v \;\Rightarrow\; L^{-1}z = L^{-1}Hx + L^{-1}v, \quad L^{-1}RL^{-T} = \mathrm{diag}(d)

    Parameters
    ----------
    H : (m, n) or (steps+1, m, n) · R : (m, m) or (steps+1, m, m), finite, may be singular

    Raises
    ------
    ValueError
        R is no covariance, or infinite (leave out what is not measured first).

    Source: Semushin & Tsyganova 2001, task 5 (d), (e).

    >>> new = decorrelate([[1.0, 0.0], [0.0, 1.0]], [[4.0, 2.0], [2.0, 5.0]])
    >>> new.d, new.H[1], new.measurements([2.0, 3.0])
    (array([4., 4.]), array([-0.5,  1. ]), array([2., 2.]))
    """
    H = checks.shaped("H", H, ("m", "n"), ("steps+1", "m", "n"))
    m = H.shape[-2]
    R = checks.covariance("R", R, (m, m), ("steps+1", m, m))
    if R.ndim == 2:
        L, d = ldl(R)
    else:
        L, d = (np.array(parts) for parts in zip(*map(ldl, R), strict=True))
    if R.ndim == H.ndim == 3 and len(R) != len(H):
        msg = f"R: expected {len(H)} entries as H has, received {len(R)}"
        raise ValueError(msg)
    return Decorrelated(L, d, np.linalg.solve(L, H))


def decorrelated(model: DiscreteModel) -> tuple[DiscreteModel, Decorrelated]:
    """The same system with decorrelated measurements, and what turns data into them; N follows.

    >>> m = DiscreteModel([[1]], [[1]], [[1], [1]], [[2, 1], [1, 2]], x0=[0], P0=[[10]])
    >>> decorrelated(m)[0].R
    array([[2. , 0. ],
           [0. , 1.5]])
    """
    checks.instance("model", model, DiscreteModel)
    new = decorrelate(model.H, model.R)
    if model.N is not None and new.L.ndim == 3:
        msg = "model: expected a constant R beside N, received one that varies"
        raise ValueError(msg)
    N = None if model.N is None else np.linalg.solve(new.L, model.N.T).T
    return replace(model, H=new.H, R=new.R, N=N), new


def joint(x: ArrayLike, P: ArrayLike, z: ArrayLike, H: ArrayLike, R: ArrayLike) -> Estimate:
    """One update with all elements of z at once.

    Parameters
    ----------
    x : (n,) · P : (n, n), before the update · z : (m,) · H : (m, n) · R : (m, m), may be correlated or singular

    >>> joint([3.0], [[0.5]], [3.0, 1.0], [[2.0], [1.0]], [[1.0, 0.0], [0.0, 1.0]]).x.round(6)
    array([1.857143])
    """
    x, P, z, H, R = _instant(x, P, z, H, R)
    step = adapter.update(P, H, R)
    return Estimate(x + step.K @ np.where(step.used, z - H @ x, 0.0), step.P_plus)


def sequential(x: ArrayLike, P: ArrayLike, z: ArrayLike, H: ArrayLike, R: ArrayLike) -> Estimate:
    """The same update with one element of z after another; the noises must be independent.

    Parameters
    ----------
    as for :func:`joint`; R : (m, m), diagonal

    Raises
    ------
    ValueError
        Correlated noises: :func:`decorrelate` first (or pass diag R, to see what neglecting them does).

    >>> sequential([3.0], [[0.5]], [3.0, 1.0], [[2.0], [1.0]], [[1.0, 0.0], [0.0, 1.0]]).x.round(6)
    array([1.857143])
    """
    x, P, z, H, R = _instant(x, P, z, H, R)
    independent(R)
    estimate = Estimate(x, P)
    for i in range(len(z)):
        estimate = joint(*estimate, z[i : i + 1], H[i : i + 1], R[i : i + 1, i : i + 1])
    return estimate


def flops(n: int, m: int, way: str) -> int:
    """Additions, multiplications and divisions of an update of estimate and covariance, counted while it is done.

    Parameters
    ----------
    n, m : number of states, of measurements; all matrices dense
    way : "joint" (m×m innovation covariance solved by elimination, short form of P⁺), "sequential" (m scalar updates,
        R diagonal), or "decorrelation" (LDLᵀ of R, L⁻¹z and L⁻¹H: what precedes "sequential" when R is correlated)

    >>> [flops(4, 2, way) for way in WAYS]
    [205, 176, 13]
    """
    n, m = checks.count("n", n), checks.count("m", m)
    if way not in WAYS:
        msg = f"way: expected one of {', '.join(WAYS)}, received {way!r}"
        raise ValueError(msg)
    x, P, z, H, R = (
        np.vectorize(Counted, otypes=[object])(value)
        for value in (np.ones(n), np.eye(n) + 1, np.ones(m), np.ones((m, n)), np.eye(m) + 1)
    )
    Counted.total = 0
    if way == "decorrelation":
        _eliminated(R, np.column_stack([z, H]))
    elif way == "sequential":
        for i in range(m):
            f = P @ H[i]
            K = f / (H[i] @ f + R[i, i])
            x, P = x + K * (z[i] - H[i] @ x), P - np.outer(K, f)
    else:
        cross = H @ P
        rows = _eliminated(cross @ H.T + R, np.column_stack([z - H @ x, cross]))
        # Two triangular halves of S⁻¹: with S = LDLᵀ and Y = L⁻¹[ν, HP⁻] the corrections are (HP⁻)ᵀS⁻¹[…] = YᵀD⁻¹Y.
        scaled = rows[1][:, 1:] / rows[0][:, None]
        x, P = x + scaled.T @ rows[1][:, 0], P - scaled.T @ rows[1][:, 1:]
    return Counted.total


def independent(R: Array) -> None:
    """Refuse noises that are correlated, R (m, m): one element after another wants a diagonal matrix."""
    off = R[~np.eye(len(R), dtype=bool)]
    if off.any():
        worst = off[np.abs(off).argmax()]
        msg = f"R: expected independent noises (a diagonal matrix; decorrelate them first), received a covariance of {worst:g}"
        raise ValueError(msg)


def _eliminated(S: Array, right: Array) -> tuple[Array, Array]:
    """d and L⁻¹·right of S = L diag(d) Lᵀ, of any kind of number (the lower half of S is used)."""
    S, right = np.array(S), np.array(right)
    for j in range(len(S)):
        for i in range(j + 1, len(S)):
            factor = S[i, j] / S[j, j]
            S[i:, i] = S[i:, i] - factor * S[i:, j]
            right[i] = right[i] - factor * right[j]
    return np.diagonal(S), right


def _instant(x: ArrayLike, P: ArrayLike, z: ArrayLike, H: ArrayLike, R: ArrayLike) -> tuple[Array, ...]:
    x = checks.shaped("x", x, ("n",))
    z = checks.shaped("z", z, ("m",))
    n, m = len(x), len(z)
    return (
        x,
        checks.covariance("P", P, (n, n)),
        z,
        checks.shaped("H", H, (m, n)),
        checks.measurement_covariance("R", R, (m, m)),
    )
