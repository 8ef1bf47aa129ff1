r"""Bayes' rule for a scalar state without an approximation of it: on a grid of points, and by quadrature."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from ctlabs.filtering.updates import Estimate, independent
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models import NonlinearModel, at


class PointMass:
    r"""The exact filter of a scalar state on a grid of points, for many runs at once: Bayes' rule and the trapezoidal rule.

    A design for :func:`ctlabs.montecarlo.monte_carlo`: ``design=lambda: PointMass(model, grid)``. ``x`` and ``P`` are mean and
    variance of the posterior. What ``update`` returns as the normalised innovation squared is Gaussianised: each element,
    given the data before it, is put through its own predicted distribution and the normal quantile,

    .. math:: n_i = \Phi^{-1}\Bigl(\int \Phi\Bigl(\tfrac{z_i-h_i(x)}{\sqrt{R_{ii}}}\Bigr)
              p(x\mid\text{data before})\,dx\Bigr)

    so that the sum of squares is exactly χ²(m) if the filter is right, however far from Gaussian everything is
    (Rosenblatt 1952, *Ann. Math. Statist.* 23).

    Parameters
    ----------
    model : functions of a scalar state, additive noises, R diagonal and > 0; P0 > 0
    grid : (points,), evenly spaced, no wider apart than any standard deviation of w (where Qd > 0), of x0 and of the
        likelihoods of the elements
    """

    def __init__(self, model: NonlinearModel, grid: ArrayLike) -> None:
        self.grid = checks.shaped("grid", grid, ("points",))
        if callable(model.Qd) or callable(model.R) or len(model.x0) != 1:
            msg = "model: expected a scalar state and matrices Qd, R, received others"
            raise ValueError(msg)
        steps = np.diff(self.grid)
        if len(steps) < 2 or not np.allclose(steps, steps[0]) or steps[0] <= 0:
            msg = "grid: expected at least three evenly spaced, ascending points, received others"
            raise ValueError(msg)
        for R in model.R if model.R.ndim == 3 else model.R[None]:
            independent(R)
        if (np.diagonal(model.R, axis1=-2, axis2=-1) <= 0).any() or not model.P0[0, 0] > 0:
            msg = "model: expected R > 0 and P0 > 0, received a variance of 0 (a density on a grid has none)"
            raise ValueError(msg)
        self._f, self._h, self._Qd, self._R, self._x0, self._P0 = (
            model.f,
            model.h,
            model.Qd,
            model.R,
            model.x0,
            model.P0,
        )
        self.p = np.empty((0, 0))

    @property
    def x(self) -> Array:
        """Posterior means, (1, runs)."""
        return (self.grid @ self.p)[None]

    @property
    def P(self) -> Array:
        """Posterior variances, (1, 1, runs)."""
        return ((self.grid[:, None] - self.x) ** 2 * self.p).sum(axis=0)[None, None]

    def start(self, runs: int) -> None:
        """Begin ``runs`` records with the normal density of x0, P0."""
        self.p = _normalised(np.repeat(-0.5 * (self.grid - self._x0[0])[:, None] ** 2 / self._P0[0, 0], runs, axis=1))

    def predict(self, k: int) -> None:
        """From k−1 to k, by the density of w about f; without noise (Qd = 0) no density on a fixed grid follows."""
        Q = at(self._Qd, k - 1, 2)[0, 0]
        if Q == 0:
            msg = f"Qd: expected > 0 at step {k - 1}, received 0 (the grid cannot follow a motion without noise)"
            raise ValueError(msg)
        moved = np.asarray(self._f(k - 1, self.grid[None], np.zeros((1, len(self.grid)))))[0]
        self.p = _normalised(-0.5 * (self.grid[:, None] - moved) ** 2 / Q) @ self.p

    def update(self, k: int, z: Array) -> tuple[Array, float]:
        """Bayes' rule with every element measured; the Gaussianised innovations squared."""
        R = at(self._R, k, 2)
        expected = np.asarray(self._h(k, self.grid[None], np.zeros((len(R), len(self.grid)))))
        nis, used = np.zeros(z.shape[1]), 0
        for i in np.flatnonzero(np.isfinite(np.diag(R)) & np.isfinite(z).all(axis=1)):
            u = (z[i] - expected[i][:, None]) / np.sqrt(R[i, i])
            tail = np.minimum((special.ndtr(u) * self.p).sum(axis=0), (special.ndtr(-u) * self.p).sum(axis=0))
            nis += special.ndtri(tail) ** 2
            with np.errstate(divide="ignore"):  # the logarithm of what has underflowed to zero is −∞
                self.p = _normalised(np.log(self.p) - 0.5 * u**2)
            used += 1
        return nis, float(used)


def posterior_by_quadrature(
    log_density: Callable[[Array], Array], centres: ArrayLike, low: float, high: float, finest: float = 1e-12
) -> Estimate:
    r"""Mean and variance of a scalar density known up to a factor, by Gauss–Legendre panels.

    .. math:: \hat x = \frac{\int x\,p\,dx}{\int p\,dx}, \quad P = \frac{\int (x-\hat x)^2\,p\,dx}{\int p\,dx}

    Panels shrink by halves towards every centre, so a peak there is resolved however narrow it is (down to ``finest``).

    Parameters
    ----------
    log_density : x (points,) → log p + constant, smooth between its peaks
    centres : where p may have peaks
    low, high : ends of the integral, outside of which p is negligible
    finest : width of the smallest panels, in the unit of x

    Raises
    ------
    ValueError
        low ≥ high; a density that is zero at every point, or not a number.

    >>> found = posterior_by_quadrature(lambda x: -0.5 * ((x - 1) / 1e-5) ** 2, [1.0], -9.0, 9.0)
    >>> found.x.round(9), bool(abs(found.P[0, 0] / 1e-10 - 1) < 1e-9)
    (array([1.]), True)
    """
    centres = checks.shaped("centres", centres, ("points",))
    if not low < high:
        msg = f"low, high: expected low < high, received {low!r}, {high!r}"
        raise ValueError(msg)
    reach = finest * 2.0 ** np.arange(np.ceil(np.log2(max((high - low) / finest, 2.0))))
    edges = np.concatenate([[low, high], centres, *(centre + sign * reach for centre in centres for sign in (-1, 1))])
    edges = np.unique(edges[(low <= edges) & (edges <= high)])
    nodes, weights = np.polynomial.legendre.leggauss(24)
    half = 0.5 * np.diff(edges)
    x = (edges[:-1, None] + half[:, None] * (1 + nodes)).ravel()
    logs = np.asarray(log_density(x), dtype=np.float64)
    if not np.isfinite(largest := logs.max()):
        msg = f"log_density: expected finite values somewhere between low and high, received a maximum of {largest}"
        raise ValueError(msg)
    p = (half[:, None] * weights).ravel() * np.exp(logs - largest)
    p /= p.sum()
    mean = p @ x
    return Estimate(np.array([mean]), np.array([[p @ (x - mean) ** 2]]))


def _normalised(logs: Array) -> Array:
    """exp of the columns, each with the sum 1."""
    p = np.exp(logs - logs.max(axis=0))
    return np.asarray(p / p.sum(axis=0))
