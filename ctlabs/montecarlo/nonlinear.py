r"""Nonlinear truths and extended filters, by functions over blocks of runs: no loop over runs.

.. math:: x_{k+1} = f(k, x_k, w_k), \quad z_k = h(k, x_k, v_k), \quad x_0 \sim N(\bar x_0, P_0)

Every function takes arrays with the run as the last axis and returns one of the same kind. The extended filter
linearises about each run's own estimate (Maybeck vol. 2, eq. 9-77 ff.):

.. math:: P^- = FP^+F^T + G Q G^T, \quad S = HP^-H^T + LRL^T, \quad F = \partial f/\partial x,\
          G = \partial f/\partial w,\ H = \partial h/\partial x,\ L = \partial h/\partial v
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np

from ctlabs import _check
from ctlabs._check import Array
from ctlabs.linalg import rounding
from ctlabs.models import at
from ctlabs.montecarlo.plan import Design, entry, whiten

Motion = Callable[[int, Array, Array], Array]
Jacobian = Callable[[int, Array], Array]
Covariance = Array | Callable[[int, Array], Array]


@dataclass(frozen=True, slots=True, eq=False)
class NonlinearModel:
    """A nonlinear system with Gaussian noises, as a truth or as the model of an extended filter.

    Parameters
    ----------
    f : (k, x (n, runs), w (s, runs)) → (n, runs), the state at k+1; for additive noise ``… + w``
    h : (k, x (n, runs), v (q, runs)) → (m, runs), the measurement at k
    Qd : (s, s) or (steps, s, s), covariance of w, unit². For a design also a function (k, x̂) → (n, n[, runs]), the
        covariance that is added to the state's.
    R : (q, q) or (steps+1, q, q), covariance of v, unit²; inf on the diagonal: no measurement (as many noises as
        measurements). For a design also a function (k, x̂⁻) → (m, m[, runs]), the
        covariance that the filter takes for the measurement's, for example at the predicted geometry.
    x0, P0 : (n,), (n, n)
    dt : period, s
    F, H : (k, x̂) → (n, n[, runs]), (m, n[, runs]), the derivatives; by central differences if not given
    residual : (z, ẑ) → z − ẑ, where that needs care (angles); the difference if not given
    states, measurements : names

    Raises
    ------
    ValueError, TypeError
        Shapes that do not fit; what the functions return is checked by one trial call.
    """

    f: Motion
    h: Motion
    Qd: Covariance
    R: Covariance
    x0: Array
    P0: Array
    dt: float = 1.0
    F: Jacobian | None = None
    H: Jacobian | None = None
    residual: Callable[[Array, Array], Array] | None = None
    states: tuple[str, ...] = None  # type: ignore[assignment]  # names from __post_init__ on
    measurements: tuple[str, ...] = None  # type: ignore[assignment]  # names from __post_init__ on

    def __post_init__(self) -> None:
        def put(name: str, value: object) -> None:
            object.__setattr__(self, name, value)

        put("x0", _check.shaped("x0", self.x0, ("n",)))
        put("P0", _check.covariance("P0", self.P0, (self.n, self.n)))
        if not callable(self.Qd):
            put("Qd", _check.covariance("Qd", self.Qd, ("s", "s"), ("steps", "s", "s")))
        if not callable(self.R):
            put("R", _check.measurement_covariance("R", self.R, ("q", "q"), ("steps+1", "q", "q")))
        put("dt", _check.positive("dt", self.dt))
        start = np.repeat(self.x0[:, None], 2, axis=1)
        moved = np.asarray(self.f(0, start, np.zeros((self.s, 2))))
        seen = np.asarray(self.h(0, start, np.zeros((self.q, 2))))
        if moved.shape != (self.n, 2):
            msg = f"f: expected to return shape ({self.n}, runs), received {moved.shape} for 2 runs"
            raise ValueError(msg)
        if seen.ndim != 2 or seen.shape[1] != 2:
            msg = f"h: expected to return shape (m, runs), received {seen.shape} for 2 runs"
            raise ValueError(msg)
        put("states", _check.labels("states", self.states, self.n, "x"))
        put("measurements", _check.labels("measurements", self.measurements, len(seen), "z"))

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.x0)

    @property
    def m(self) -> int:
        """Number of measurements."""
        return len(self.measurements)

    @property
    def s(self) -> int:
        """Number of noise inputs (n where Qd is a function)."""
        return self.n if callable(self.Qd) else self.Qd.shape[-1]

    @property
    def q(self) -> int:
        """Number of measurement noises (where R is a function, as many as that returns rows)."""
        return np.asarray(self.R(0, self.x0[:, None])).shape[0] if callable(self.R) else self.R.shape[-1]


class Filter(Protocol):
    """What an experiment needs of a filter; any object of this kind is a design (given as a function that makes it).

    ``x`` (d, runs), the estimates · ``P`` (d, d) or (d, d, runs), the covariance claimed, or ``None``
    """

    @property
    def x(self) -> Array:
        """Estimates."""
        ...

    @property
    def P(self) -> Array | None:
        """Covariance claimed."""
        ...

    def start(self, runs: int) -> None:
        """Begin ``runs`` new records at t0."""
        ...

    def predict(self, k: int) -> None:
        """From k−1 to k."""
        ...

    def update(self, k: int, z: Array) -> tuple[Array, float] | None:
        """Use z_k (m, runs); the normalised innovation squared (runs,) and its degrees of freedom, if known."""
        ...


class Scheduled:
    """A linear filter with gains known beforehand."""

    def __init__(self, design: Design, P_plus: Array, nis_dof: Array) -> None:
        self.design, self.covariances, self.nis_dof = design, P_plus, nis_dof
        self.x, self.P = np.empty((0, 0)), P_plus[0]
        self._z = np.empty((0, 0))

    def start(self, runs: int) -> None:
        """Begin at x0."""
        self.x = np.repeat(self.design.x0[:, None], runs, axis=1)
        self.P = self.covariances[0]
        self._z = np.zeros((self.design.H.shape[1], runs))

    def predict(self, k: int) -> None:
        """x̂⁻ = A x̂⁺ + b + M z."""
        design = self.design
        self.x = entry(design.A, k - 1) @ self.x + entry(design.b, k - 1)[:, None]
        if len(design.M):
            self.x += entry(design.M, k - 1) @ self._z

    def update(self, k: int, z: Array) -> tuple[Array, float]:
        """x̂⁺ = x̂⁻ + K(z − Hx̂⁻)."""
        nu = z - entry(self.design.H, k) @ self.x
        self.x = self.x + entry(self.design.K, k) @ nu
        self.P, self._z = self.covariances[k], z
        return np.square(entry(self.design.V, k) @ nu).sum(axis=0), float(self.nis_dof[k])


class Extended:
    """The extended Kalman filter of many runs at once; covariances have the run as the first axis inside."""

    def __init__(self, model: NonlinearModel) -> None:
        self.model = model
        self.x, self._P = np.empty((0, 0)), np.empty((0, 0, 0))
        self._scale = np.sqrt(np.diag(model.P0))

    @property
    def P(self) -> Array:
        """Covariance claimed, (n, n, runs)."""
        return np.moveaxis(self._P, 0, -1)

    def start(self, runs: int) -> None:
        """Begin at x0, P0."""
        self.x = np.repeat(self.model.x0[:, None], runs, axis=1)
        self._P = np.repeat(self.model.P0[None], runs, axis=0)

    def predict(self, k: int) -> None:
        """Through f, and its derivatives about the estimate."""
        model, x, k = self.model, self.x, k - 1
        none = np.zeros((model.s, x.shape[1]))
        F = _stack(model.F(k, x)) if model.F else _derivative(lambda y: model.f(k, y, none), x, self._scale)
        Q = _stack(model.Qd(k, x)) if callable(model.Qd) else _spread(partial(model.f, k, x), none, at(model.Qd, k, 2))
        self._P = _symmetric(F @ self._P @ np.swapaxes(F, 1, 2) + Q)
        self.x = np.asarray(model.f(k, x, none))

    def update(self, k: int, z: Array) -> tuple[Array, float]:
        """One update with all elements that are measured."""
        model, x, P = self.model, self.x, self._P
        none = np.zeros((model.q, x.shape[1]))
        H = _stack(model.H(k, x)) if model.H else _derivative(lambda y: model.h(k, y, none), x, self._scale)
        R = _stack(model.R(k, x)) if callable(model.R) else _spread(partial(model.h, k, x), none, at(model.R, k, 2))
        expected = np.asarray(model.h(k, x, none))
        nu = (model.residual(z, expected) if model.residual else z - expected).T[:, :, None]
        used = np.isfinite(np.diagonal(R, axis1=1, axis2=2)).all(axis=0) & np.isfinite(nu).all(axis=(0, 2))
        if not used.any():
            return np.zeros(x.shape[1]), 0.0
        H, nu = H[:, used], nu[:, used]
        R = R[:, used][:, :, used]
        S = H @ P @ np.swapaxes(H, 1, 2) + R
        cross = P @ np.swapaxes(H, 1, 2)
        K = np.swapaxes(_solve(S, np.swapaxes(cross, 1, 2)), 1, 2)
        left = np.eye(model.n) - K @ H
        after = _symmetric(left @ P @ np.swapaxes(left, 1, 2) + K @ R @ np.swapaxes(K, 1, 2))
        self._P = rounding.corrected(after, P, K, H, S, R)
        self.x = x + (K @ nu)[:, :, 0].T
        return (nu * _solve(S, nu)).sum(axis=(1, 2)), float(used.sum())


def normalised(e: Array, P: Array) -> tuple[Array, float]:
    """eᵀP⁺e of each run, and the rank of P (its average over the runs)."""
    if P.ndim == 2:
        W, rank = whiten(P[None])
        return np.square(W[0] @ e).sum(axis=0), float(rank[0])
    stack = np.moveaxis(P, -1, 0)
    column = e.T[:, :, None]
    try:
        # A covariance that has a factor and is well scaled needs no pseudo-inverse.
        L = np.linalg.cholesky(stack)
        diagonal = np.diagonal(L, axis1=1, axis2=2) ** 2 / np.diagonal(stack, axis1=1, axis2=2)
        if diagonal.min() > 1e-9:
            return np.square(np.linalg.solve(L, column)).sum(axis=(1, 2)), float(len(e))
    except np.linalg.LinAlgError:
        pass
    W, rank = whiten(stack)
    return np.square(W @ column).sum(axis=(1, 2)), float(rank.mean())


def _stack(matrix: Array) -> Array:
    """A matrix (·, ·) or (·, ·, runs) with the run first."""
    matrix = np.asarray(matrix, dtype=np.float64)
    return matrix[None] if matrix.ndim == 2 else np.ascontiguousarray(np.moveaxis(matrix, -1, 0))


def _symmetric(P: Array) -> Array:
    return 0.5 * (P + np.swapaxes(P, 1, 2))


def _derivative(function: Callable[[Array], Array], x: Array, scale: Array) -> Array:
    """∂function/∂x by central differences, (runs, rows, len(x)); relative error about ε^(2/3)."""
    columns = []
    for j in range(len(x)):
        step = np.cbrt(np.finfo(float).eps) * np.maximum(np.abs(x[j]), scale[j] if scale[j] > 0 else 1.0)
        up, down = np.array(x), np.array(x)
        up[j] += step
        down[j] -= step
        columns.append((np.asarray(function(up)) - np.asarray(function(down))) / (up[j] - down[j]))
    return np.moveaxis(np.array(columns), (0, 1, 2), (2, 1, 0))


def _spread(function: Callable[[Array], Array], none: Array, Q: Array) -> Array:
    """G Q Gᵀ with G the derivative by the noise; an element whose own noise is infinite stays so."""
    finite = np.isfinite(np.diag(Q))
    sd = np.sqrt(np.where(finite, np.diag(Q), 0.0))
    G = _derivative(function, none, sd)
    known = np.where(finite[:, None] & finite, Q, 0.0)
    result = G @ known @ np.swapaxes(G, 1, 2)
    if not finite.all():
        touched = (G[:, :, ~finite] != 0).any(axis=(0, 2))
        result[:, touched, touched] = np.inf
    return result


def _solve(S: Array, right: Array) -> Array:
    try:
        return np.linalg.solve(S, right)
    except np.linalg.LinAlgError:  # a perfect measurement of something known: the pseudo-inverse leaves it out
        return np.linalg.pinv(S, hermitian=True) @ right
