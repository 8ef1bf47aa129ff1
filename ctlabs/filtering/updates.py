r"""Measurement updates one way and another: all elements at once, one after another, decorrelated, about which point.

With independent measurement noises the elements of z may be processed one at a time; with correlated ones only after
the transformation that makes their covariance diagonal,

.. math:: R = L\,\mathrm{diag}(d)\,L^T, \quad z' = L^{-1}z, \quad H' = L^{-1}H, \quad R' = \mathrm{diag}(d)

(Bierman, *Factorization Methods for Discrete Sequential Estimation* (1977), section IV.2). With a nonlinear sensor the
result also depends on the point about which each element is linearised; :func:`posterior_by_quadrature` is the judge.
:class:`SequentialExtended` and :class:`PointMass` filter many runs at once and are designs for
:func:`ctlabs.montecarlo.monte_carlo`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from ctlabs.filtering.algorithms.contract import Counted
from ctlabs.filtering.engines import adapter
from ctlabs.filtering.extended import EnsembleFilter
from ctlabs.linalg import checks, rounding
from ctlabs.linalg.checks import Array
from ctlabs.linalg.factors import ldl
from ctlabs.models import DiscreteModel, NonlinearModel, at

#: Orders of processing in :func:`extended`.
ORDERS = ("joint", "fixed", "relinearised")
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
    _diagonal(R)
    estimate = Estimate(x, P)
    for i in range(len(z)):
        estimate = joint(*estimate, z[i : i + 1], H[i : i + 1], R[i : i + 1, i : i + 1])
    return estimate


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
    _diagonal(R)
    estimate = Estimate(x, np.asarray(P, dtype=np.float64))
    for i in range(len(z)):
        row = np.asarray(H(estimate.x), dtype=np.float64)[i : i + 1]
        straight = z[i : i + 1] - np.asarray(h(estimate.x), dtype=np.float64)[i : i + 1] + row @ estimate.x
        estimate = joint(*estimate, straight, row, R[i : i + 1, i : i + 1])
    return estimate


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
            _diagonal(R)
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
            _diagonal(R)
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


class Together:
    """Several filters on the same data as one design, so that their errors can be compared run by run.

    Its estimate stacks theirs and it claims no covariance. With ``compare=np.vstack([E, E])`` the statistics of
    :func:`ctlabs.montecarlo.monte_carlo` hold the covariances between the errors of different filters too, which :func:`paired`
    needs.

    Parameters
    ----------
    filters : objects that make up a :class:`ctlabs.filtering.extended.EnsembleFilter`, not started
    """

    P = None

    def __init__(self, *filters: EnsembleFilter) -> None:
        self.filters = filters

    @property
    def x(self) -> Array:
        """All estimates, (d1 + d2 + …, runs)."""
        return np.concatenate([each.x for each in self.filters])

    def start(self, runs: int) -> None:
        """Begin ``runs`` records with every filter."""
        for each in self.filters:
            each.start(runs)

    def predict(self, k: int) -> None:
        """From k−1 to k."""
        for each in self.filters:
            each.predict(k)

    def update(self, k: int, z: Array) -> None:
        """The same data to all; their normalised innovations are not comparable and not returned."""
        for each in self.filters:
            each.update(k, z)


def paired(second_moment: ArrayLike, runs: int) -> Array:
    r"""How clearly the mean squares of two filters differ on the same data, in standard errors; > 0: the first is larger.

    .. math:: \frac{\overline{e_1^2} - \overline{e_2^2}}
              {\sqrt{2(s_{11}^2 + s_{22}^2 - 2s_{12}^2)/\text{runs}}},\quad s_{ij} = \overline{e_ie_j}

    Parameters
    ----------
    second_moment : (…, 2d, 2d), averages of e eᵀ, with d errors of the first filter before d of the second
    runs : how many

    Returns
    -------
    (…, d). The standard error is that of errors that are nearly Gaussian. Where both errors are the same: 0.

    >>> paired([[2.0, 1.0], [1.0, 1.0]], 600).round(6)
    array([10.])
    """
    moments = checks.array("second_moment", second_moment)
    if moments.ndim < 2 or moments.shape[-1] != moments.shape[-2] or moments.shape[-1] % 2:
        msg = f"second_moment: expected shape (…, 2d, 2d), received {moments.shape}"
        raise ValueError(msg)
    d = moments.shape[-1] // 2
    first, second = (np.diagonal(moments, axis1=-2, axis2=-1)[..., part] for part in (slice(d), slice(d, None)))
    cross = np.diagonal(moments[..., :d, d:], axis1=-2, axis2=-1)
    variance = 2 * (first**2 + second**2 - 2 * cross**2) / checks.count("runs", runs)
    same = variance <= 64 * np.finfo(float).eps * first**2
    return np.asarray(np.where(same, 0.0, (first - second) / np.sqrt(np.where(same, 1.0, variance))))


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


def _diagonal(R: Array) -> None:
    off = R[~np.eye(len(R), dtype=bool)]
    if off.any():
        worst = off[np.abs(off).argmax()]
        msg = f"R: expected independent noises (a diagonal matrix; decorrelate them first), received a covariance of {worst:g}"
        raise ValueError(msg)


def _spread(matrix: ArrayLike) -> Array:
    """A matrix (·, ·) or (·, ·, runs) with the run as its last axis."""
    matrix = np.asarray(matrix, dtype=np.float64)
    return matrix[:, :, None] if matrix.ndim == 2 else matrix


def _normalised(logs: Array) -> Array:
    """exp of the columns, each with the sum 1."""
    p = np.exp(logs - logs.max(axis=0))
    return np.asarray(p / p.sum(axis=0))
