"""The filters of an experiment with functions: the linear filter with gains known beforehand."""

from __future__ import annotations

import numpy as np

from ctlabs.linalg.checks import Array
from ctlabs.models.histories import entry
from ctlabs.montecarlo.plan import Design, whiten


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
