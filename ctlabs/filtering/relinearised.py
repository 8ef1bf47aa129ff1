r"""Extended filters that differ in the points about which they linearise the elements of a measurement.

With a nonlinear sensor the result of one element after another depends on that point; :mod:`ctlabs.filtering.pointmass` has the
judge. :class:`SequentialExtended` filters many runs at once and is a design for :func:`ctlabs.montecarlo.monte_carlo`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.filtering.updates import Estimate, independent, joint, sequential
from ctlabs.linalg import checks, rounding
from ctlabs.linalg.checks import Array
from ctlabs.models import NonlinearModel, at

#: Orders of processing in :func:`extended`.
ORDERS = ("joint", "fixed", "relinearised")


def extended(
    x: ArrayLike,
    P: ArrayLike,
    z: ArrayLike,
    h: Callable[[Array], ArrayLike],
    H: Callable[[Array], ArrayLike],
    R: ArrayLike,
    order: str = "joint",
) -> Estimate:
    r"""One update of an extended filter, z = h(x) + v.

    Parameters
    ----------
    x : (n,) · P : (n, n), before the update · z : (m,)
    h : x (n,) → (m,) · H : x (n,) → (m, n), its derivative · R : (m, m), diagonal unless ``order`` is "joint"
    order : "joint", all elements at once; "fixed", one after another, all linearised at x̂⁻; "relinearised", one after
        another, each linearised at the estimate that includes those before it

    With "fixed" the element i is compared with h_i(x̂⁻) + H_i(x̂ − x̂⁻), the same straight line as in "joint".

    Source: Maybeck vol. 2, section 9.5.

    >>> def h(x): return [2 * x[0], np.sin(x[0])]
    >>> def H(x): return [[2.0], [np.cos(x[0])]]
    >>> [extended([3.0], [[0.5]], [3.0, 1.0], h, H, np.diag([1.0, 0.3]), order).x.round(4).item() for order in ORDERS]
    [2.0467, 2.0467, 1.9809]
    """
    if order not in ORDERS:
        msg = f"order: expected one of {', '.join(ORDERS)}, received {order!r}"
        raise ValueError(msg)
    x = checks.shaped("x", x, ("n",))
    z = checks.shaped("z", z, ("m",))
    R = checks.measurement_covariance("R", R, (len(z), len(z)))
    if order != "relinearised":
        line = np.asarray(H(x), dtype=np.float64)
        straight = z - np.asarray(h(x), dtype=np.float64) + line @ x
        return (joint if order == "joint" else sequential)(x, P, straight, line, R)
    independent(R)
    estimate = Estimate(x, np.asarray(P, dtype=np.float64))
    for i in range(len(z)):
        row = np.asarray(H(estimate.x), dtype=np.float64)[i : i + 1]
        straight = z[i : i + 1] - np.asarray(h(estimate.x), dtype=np.float64)[i : i + 1] + row @ estimate.x
        estimate = joint(*estimate, straight, row, R[i : i + 1, i : i + 1])
    return estimate


class SequentialExtended:
    """The extended filter that processes one element after another, each relinearised, for many runs at once.

    A design for :func:`ctlabs.montecarlo.monte_carlo`: ``design=lambda: SequentialExtended(model)``. The gain is the same as in
    :func:`extended`, in Joseph's form.

    Parameters
    ----------
    model : functions with derivatives F and H, additive noises, R diagonal (0 and inf allowed)
    """

    def __init__(self, model: NonlinearModel) -> None:
        if model.F is None or model.H is None or callable(model.Qd) or callable(model.R):
            msg = "model: expected derivatives F, H and matrices Qd, R, received a model without one of them"
            raise ValueError(msg)
        self._f, self._h, self._F, self._H, self._Qd, self._R = model.f, model.h, model.F, model.H, model.Qd, model.R
        for R in self._R if self._R.ndim == 3 else self._R[None]:
            independent(R)
        self._x0, self._P0 = model.x0, model.P0
        self.x, self.P = np.empty((0, 0)), np.empty((0, 0, 0))

    def start(self, runs: int) -> None:
        """Begin ``runs`` records at x0, P0."""
        self.x = np.repeat(self._x0[:, None], runs, axis=1)
        self.P = np.repeat(self._P0[:, :, None], runs, axis=2)

    def predict(self, k: int) -> None:
        """From k−1 to k."""
        Q = at(self._Qd, k - 1, 2)
        F = _spread(self._F(k - 1, self.x))
        self.P = np.einsum("ij...,jk...,lk...->il...", F, self.P, F) + Q[:, :, None]
        self.x = np.asarray(self._f(k - 1, self.x, np.zeros((len(Q), self.x.shape[1]))))

    def update(self, k: int, z: Array) -> tuple[Array, float]:
        """All elements of z (m, runs) that are measured; the sum of their normalised innovations squared."""
        variances, none = np.diag(at(self._R, k, 2)), np.zeros_like(z)
        nis, used = np.zeros(z.shape[1]), 0
        for i in np.flatnonzero(np.isfinite(variances) & np.isfinite(z).all(axis=1)):
            row = np.broadcast_to(_spread(self._H(k, self.x))[i], self.x.shape)
            f = np.einsum("ij...,j...->i...", self.P, row)
            s = (row * f).sum(axis=0) + variances[i]
            K = np.divide(f, s, out=np.zeros_like(f), where=s > 0)
            nu = z[i] - self._h(k, self.x, none)[i]
            left = np.eye(len(f))[:, :, None] - K[:, None] * row[None]
            before = self.P
            self.P = np.einsum("ij...,jk...,lk...->il...", left, self.P, left) + variances[i] * K[:, None] * K[None]
            if variances[i] == 0:  # what a perfect element determines is known, not of a variance of 1e-17
                first = (np.moveaxis(part, -1, 0) for part in (self.P, before, K[:, None], row[None]))
                self.P = np.moveaxis(rounding.corrected(*first), 0, -1)
            self.x = self.x + K * nu
            nis += np.divide(nu**2, s, out=np.zeros_like(s), where=s > 0)
            used += 1
        return nis, float(used)


def _spread(matrix: ArrayLike) -> Array:
    """A matrix (·, ·) or (·, ·, runs) with the run as its last axis."""
    matrix = np.asarray(matrix, dtype=np.float64)
    return matrix[:, :, None] if matrix.ndim == 2 else matrix
