r"""The extended Kalman filter: a nonlinear model linearised about each run's own estimate.

.. math:: P^- = FP^+F^T + G Q G^T, \quad S = HP^-H^T + LRL^T, \quad F = \partial f/\partial x,\
          G = \partial f/\partial w,\ H = \partial h/\partial x,\ L = \partial h/\partial v

(Maybeck vol. 2, eq. 9-77 ff.)
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.filtering.measured import begins, gaps
from ctlabs.filtering.problem import by_instant, rows_of
from ctlabs.filtering.results import Filtered, Mask, without_runs
from ctlabs.linalg import rounding
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import symmetric
from ctlabs.models.linear import at
from ctlabs.models.nonlinear import NonlinearModel


class Updates(NamedTuple):
    """One update of many runs: the elements ``used`` (m,), their innovations ``nu`` (runs, used, 1), ``S`` (runs, used, used) and
    ``K`` (runs, n, used), and ``nis`` (runs,).
    """

    used: Mask
    nu: Array
    S: Array
    K: Array
    nis: Array


class EnsembleFilter(Protocol):
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
        self._P = symmetric(F @ self._P @ np.swapaxes(F, 1, 2) + Q)
        self.x = np.asarray(model.f(k, x, none))

    def update(self, k: int, z: Array) -> tuple[Array, float]:
        """One update with all elements that are measured; νᵀS⁻¹ν of each run, and the number of elements."""
        told = self.told(k, z)
        return told.nis, float(told.used.sum())

    def told(self, k: int, z: Array) -> Updates:
        """The same, with gain and innovation."""
        model, x, P = self.model, self.x, self._P
        none = np.zeros((model.q, x.shape[1]))
        H = _stack(model.H(k, x)) if model.H else _derivative(lambda y: model.h(k, y, none), x, self._scale)
        R = _stack(model.R(k, x)) if callable(model.R) else _spread(partial(model.h, k, x), none, at(model.R, k, 2))
        expected = np.asarray(model.h(k, x, none))
        nu = (model.residual(z, expected) if model.residual else z - expected).T[:, :, None]
        used = np.isfinite(np.diagonal(R, axis1=1, axis2=2)).all(axis=0) & np.isfinite(nu).all(axis=(0, 2))
        if not used.any():
            return Updates(used, nu[:, used], R[:, used][:, :, used], np.zeros((x.shape[1], model.n, 0)), np.zeros(x.shape[1]))
        H, nu = H[:, used], nu[:, used]
        R = R[:, used][:, :, used]
        S = H @ P @ np.swapaxes(H, 1, 2) + R
        cross = P @ np.swapaxes(H, 1, 2)
        K = np.swapaxes(_solve(S, np.swapaxes(cross, 1, 2)), 1, 2)
        left = np.eye(model.n) - K @ H
        after = symmetric(left @ P @ np.swapaxes(left, 1, 2) + K @ R @ np.swapaxes(K, 1, 2))
        self._P = rounding.corrected(after, P, K, H, S, R)
        self.x = x + (K @ nu)[:, :, 0].T
        return Updates(used, nu, S, K, (nu * _solve(S, nu)).sum(axis=(1, 2)))


def filtered(model: NonlinearModel, z: ArrayLike, first: int | None = None, **unknown: Any) -> Filtered:
    """A record, or an ensemble of records, through the extended filter: :func:`ctlabs.kalman_filter` of a NonlinearModel.

    The covariances are those of the linearisation about each record's own estimates; of an ensemble they have the runs as their last
    axis.
    """
    if unknown.pop("algorithm") not in ("auto", "extended"):
        raise ValueError("algorithm: expected auto or extended with a NonlinearModel, received another form")
    for name, given in unknown.items():
        if given is not None:
            msg = f"{name}: expected none with a NonlinearModel (its functions say everything), received one"
            raise ValueError(msg)
    data, single = rows_of(z, model.m)
    begin = begins(model, first)
    gaps(data)
    data = by_instant(data, begin)
    rows, n, m, runs = len(data), model.n, model.m, data.shape[2]
    x, P = np.empty((2, rows, n, runs)), np.empty((2, rows, n, n, runs))
    K, S = np.zeros((rows, n, m, runs)), np.zeros((rows, m, m, runs))
    S[:, range(m), range(m)] = np.inf
    innovation, nis, used = np.full(data.shape, np.nan), np.full((rows, runs), np.nan), np.zeros((rows, m), dtype=bool)
    total = np.zeros(runs)
    own = Extended(model)
    own.start(runs)
    with np.errstate(over="ignore", invalid="ignore"):  # an overflow is reported below, with its time
        for k in range(rows):
            if k:
                own.predict(k)
            x[0, k], P[0, k] = own.x, own.P
            told = own.told(k, data[k])
            x[1, k], P[1, k], used[k] = own.x, own.P, told.used
            if told.used.any():
                innovation[k, told.used], nis[k] = told.nu[:, :, 0].T, told.nis
                K[k][:, told.used], S[k][np.ix_(told.used, told.used)] = (np.moveaxis(part, 0, -1) for part in (told.K, told.S))
                total -= 0.5 * (told.nis + np.linalg.slogdet(told.S)[1] + told.used.sum() * np.log(2 * np.pi))
            if not (np.isfinite(own.x).all() and np.isfinite(own.P).all()):
                msg = f"x_plus: expected finite estimates, received an overflow at step {k} (t = {k * model.dt:g} s)"
                raise FloatingPointError(msg)
    P_minus, P_plus, K, S = (part[..., 0] if single else part for part in (P[0], P[1], K, S))
    found = Filtered(
        np.arange(rows) * model.dt, P_minus, P_plus, K, S, used, "extended", x_minus=x[0], x_plus=x[1], innovation=innovation, nis=nis,
        log_likelihood=total, log_likelihood_diffuse=total, z=data, model=model,
    )  # fmt: skip
    return without_runs(found) if single else found


def _stack(matrix: Array) -> Array:
    """A matrix (·, ·) or (·, ·, runs) with the run first."""
    matrix = np.asarray(matrix, dtype=np.float64)
    return matrix[None] if matrix.ndim == 2 else np.ascontiguousarray(np.moveaxis(matrix, -1, 0))


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
