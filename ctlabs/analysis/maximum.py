r"""The maximum of a smooth function in a box: where it is, how sharp, and its profiles.

Written for log-likelihoods, whose unit is the natural one: two points that differ by ½ are one standard deviation apart.
Lengths on each axis are therefore taken from the function itself (:func:`width`), and nothing depends on the units of the
arguments. A function returns −∞ where it is not defined.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ctlabs.linalg.checks import Array

Function = Callable[[Array], float]

#: Half of the 95 % quantile of χ²(1): how far a profile may lie below the top inside the likelihood-ratio interval.
DROP = 1.920729410347062
#: Points of a profile on each side of the top, and how far they go beyond the interval.
POINTS, BEYOND = 12, 1.25
#: The gain in f that a Newton step may still promise at a maximum.
CONVERGED = 1e-8
#: Step of differences in a climb, and the slope at which it ends (Newton's method goes on), in standard deviations.
STEP, LEVEL = 1e-4, 1e-3
#: Standard deviations after which a profile that does not fall is taken for one that never does.
FAR = 1e5
#: How far from its start a positive argument without other bounds is searched, in logarithms.
DEPTH = 46.0


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """``start``, ``lower``, ``upper`` (p,), the bounds possibly infinite."""

    start: Array
    lower: Array
    upper: Array

    @property
    def log(self) -> NDArray[np.bool_]:
        """Which arguments are positive, declared so by a bound, and therefore searched by their logarithms."""
        return (self.lower >= 0) & (self.start > 0)

    @property
    def size(self) -> Array:
        """A first guess of the lengths: a quarter of a finite range, else the start itself."""
        own = np.where(self.start != 0, np.abs(self.start), 1.0)
        span = self.upper - self.lower
        return np.where(np.isfinite(span), 0.25 * span, own)

    def without(self, i: int) -> Box:
        """The box of the other arguments."""
        return Box(*(np.delete(side, i) for side in (self.start, self.lower, self.upper)))


class Top(NamedTuple):
    """A maximum: ``at`` (p,), its ``value``, ``gradient`` and ``hessian`` (NaN beside arguments that are not ``free``).

    ``width`` (p,), the distance at which f has changed by about ½ · ``free`` (p,), whether the argument lies inside
    the box · ``converged``, whether neither a Newton step nor leaving a bound promises more.
    """

    at: Array
    value: float
    gradient: Array
    hessian: Array
    width: Array
    free: NDArray[np.bool_]
    converged: bool


class Profile(NamedTuple):
    """``values`` of one constant, ascending, and the ``log_likelihood`` of each with the other constants at their best."""

    values: Array
    log_likelihood: Array


def search(f: Function, box: Box, starts: int = 2) -> Top:
    """The highest maximum found from the start and from the best of some other points.

    >>> box = Box(np.array([1.0]), np.array([0.0]), np.array([np.inf]))
    >>> search(lambda x: float(3 * np.log(x[0]) - x[0]), box).at.round(9)
    array([3.])
    """
    size = np.array([1.0 if box.log[i] else width(f, box, box.start, i, box.size[i]) for i in range(len(box.start))])
    found = [_climb(f, box, x, size, box.log) for x in [box.start, *others(f, box, size, starts)]]
    return finish(f, box, max(found, key=f))


def nearest(f: Function, box: Box) -> Array:
    """The maximum next to the start, without its derivatives: the value to far less than 1, for ratios of likelihoods.

    >>> nearest(lambda x: float(3 * np.log(x[0]) - x[0]), Box(np.array([1.0]), np.array([0.0]), np.array([np.inf]))).round(2)
    array([3.])
    """
    size = np.array([1.0 if box.log[i] else width(f, box, box.start, i, box.size[i]) for i in range(len(box.start))])
    return _on_bounds(f, box, _climb(f, box, box.start, size, box.log))


def finish(f: Function, box: Box, x: Array) -> Top:
    """The maximum next to x, to the last digits, on a bound if it is there."""
    x = _on_bounds(f, box, x)
    lengths = _widths(f, box, x, box.size)
    x = _climb(f, box, x, lengths, np.zeros(len(x), dtype=bool))
    lengths = _widths(f, box, x, lengths)
    for _ in range(4):
        top = _measured(f, box, x, lengths)
        step = _newton(box, top)
        gain = float(top.gradient @ step)
        better = np.clip(x + step, box.lower, box.upper)
        if not 1e-13 < gain < 1.0 or f(better) < top.value - 1e-12 * abs(top.value):
            break
        x = better
    return top


def width(f: Function, box: Box, x: Array, i: int, guess: float) -> float:
    """The distance from x along axis i, inside the box, at which f has changed by about ½."""
    here, d = f(x), guess
    for _ in range(60):
        inside = [x[i] + s * d for s in (1, -1) if box.lower[i] <= x[i] + s * d <= box.upper[i]]
        changes = [c for c in (abs(f(_moved(x, i, v)) - here) for v in inside) if np.isfinite(c)]
        change = max(changes, default=np.inf)
        if 0.25 < change < 1.0 or (change <= 0.25 and d > 1e9 * guess):
            break
        d *= np.clip(np.sqrt(0.5 / max(change, 1e-300)), 1 / 16, 16) if changes else 0.25
    return float(d)


def profile(f: Function, box: Box, top: Top, i: int) -> tuple[tuple[float, float], Profile, Array]:
    """How f falls along argument i with the others at their best: interval of f ≥ top − 1.92, profile, best point met."""
    path = _Path(f, box, top, i)
    ends = [_end(path, side) for side in (-1, 1)]
    values: list[float] = [float(top.at[i])]
    for side, end in zip((-1, 1), ends, strict=True):
        reach = BEYOND * abs(end - top.at[i]) if np.isfinite(end) else 10 * top.width[i]
        last = float(np.clip(top.at[i] + side * reach, box.lower[i], box.upper[i]))
        values += np.linspace(top.at[i], last, POINTS + 1)[1:].tolist()
    known = sorted((v, path(v)) for v in set(values))
    drawn = [(v, value) for v, value in known if np.isfinite(value)]
    found = Profile(*(np.array(column) for column in zip(*drawn, strict=True)))
    return (ends[0], ends[1]), found, path.best


class _Path:
    """The profile along argument i: f at its best over the others, each point started from the nearest known one."""

    def __init__(self, f: Function, box: Box, top: Top, i: int) -> None:
        self.f, self.box, self.top, self.i = f, box, top, i
        self.known: dict[float, Array] = {float(top.at[i]): top.at}
        self.others = np.arange(len(top.at)) != i

    @property
    def best(self) -> Array:
        """The highest point met."""
        return max(self.known.values(), key=self.f)

    def __call__(self, value: float) -> float:
        if value not in self.known:
            x = _moved(self.known[min(self.known, key=lambda v: abs(v - value))], self.i, value)
            self.known[value] = self._highest(x) if self.others.any() else x
        return self.f(self.known[value])

    def _highest(self, x: Array) -> Array:
        start = max((x, self._predicted(float(x[self.i]))), key=self.f)

        def along(rest: Array) -> float:
            full = np.array(start)
            full[self.others] = rest
            return self.f(full)

        found = np.array(start)
        linear = np.zeros(int(self.others.sum()), dtype=bool)
        found[self.others] = _climb(
            along, self.box.without(self.i), start[self.others], self.top.width[self.others], linear
        )
        return found

    def _predicted(self, value: float) -> Array:
        """Where the others would be if f were quadratic."""
        free, x = self.top.free & self.others, _moved(self.top.at, self.i, value)
        if self.top.free[self.i] and free.any():
            A = self.top.hessian[np.ix_(free, free)]
            slope = np.linalg.lstsq(A, self.top.hessian[free, self.i])[0] if np.isfinite(A).all() else 0.0
            x[free] -= slope * (value - self.top.at[self.i])
        return np.clip(x, self.box.lower, self.box.upper)


def _end(path: _Path, side: int) -> float:
    """Where the profile has fallen by 1.92 on one side: a bound if it has not fallen so far there, ±∞ if it never does."""
    from scipy.optimize import brentq

    at, top = float(path.top.at[path.i]), path.top.value
    bound = float((path.box.lower if side < 0 else path.box.upper)[path.i])
    inner, d = at, 2.0 * float(path.top.width[path.i])

    def score(value: float) -> float:  # the signed root is nearly straight
        return min(np.sqrt(2 * max(top - path(value), 0.0)), 30.0) - np.sqrt(2 * DROP)

    while True:
        outer = max(at - d, bound) if side < 0 else min(at + d, bound)
        if score(outer) > 0:
            return float(brentq(score, inner, outer, xtol=1e-6 * float(path.top.width[path.i]), rtol=1e-12))
        if outer == bound or d > FAR * path.top.width[path.i]:
            return bound if outer == bound else side * np.inf
        inner, d = outer, 1.7 * d


def _climb(f: Function, box: Box, x: Array, size: Array, log: NDArray[np.bool_]) -> Array:
    """A local maximum by L-BFGS-B over x/size, or over the logarithms of x; Nelder and Mead help where it is stuck."""
    from scipy.optimize import minimize

    def point(u: Array) -> Array:
        return np.clip(np.where(log, np.exp(np.where(log, u, 0.0)), u * size), box.lower, box.upper)

    def coordinates(x: Array) -> Array:
        return np.where(log, np.log(np.where(log & (x > 0), x, 1.0)), x / size)

    centre = np.log(np.where(log, x, 1.0))
    low = np.where(log & (box.lower <= 0), centre - DEPTH, coordinates(box.lower))
    high = np.where(log & np.isinf(box.upper), centre + DEPTH, coordinates(box.upper))
    bounds = list(zip(low, high, strict=True))
    nowhere = abs(f(x)) + 1e4

    def descent(u: Array) -> float:
        value = f(point(u))
        return -value if np.isfinite(value) else nowhere

    def slope(u: Array) -> Array:
        return -_gradient(lambda v: f(point(v)), u, np.full(len(u), STEP), low, high)

    u = np.clip(coordinates(x), low, high)
    settings = {"maxiter": 300, "ftol": 1e-14, "gtol": LEVEL, "maxls": 30}
    found = minimize(descent, u, jac=slope, method="L-BFGS-B", bounds=bounds, options=settings)
    inward = np.where(found.x <= low, found.jac < 0, np.where(found.x >= high, found.jac > 0, True))
    if np.abs(found.jac[inward]).max(initial=0.0) > 1e-2:
        rough = minimize(descent, found.x, method="Nelder-Mead", bounds=bounds, options={"maxfev": 200 * len(u)})
        found = minimize(descent, rough.x, jac=slope, method="L-BFGS-B", bounds=bounds, options=settings)
    return max((x, point(found.x)), key=f)


def others(f: Function, box: Box, size: Array, starts: int) -> list[Array]:
    """The ``starts`` best of some points: three decades either way of the start, or the range between two bounds."""
    if not starts:
        return []
    p = len(box.start)
    golden = 2.0  # its powers fill the cube evenly: Roberts' generalisation of the golden ratio, φ^(p+1) = φ + 1
    for _again in range(60):
        golden = (1 + golden) ** (1 / (p + 1))
    share = 2 * np.mod(0.5 + np.outer(np.arange(1, 8 * starts * (p + 1) + 1), golden ** -np.arange(1.0, p + 1)), 1) - 1
    with np.errstate(invalid="ignore"):  # infinite ranges are not chosen
        span, middle = box.upper - box.lower, 0.5 * (box.upper + box.lower)
        uniform = np.where(np.isfinite(span), middle + 0.49 * span * share, box.start + 30 * size * share)
    points = np.where(box.log, np.where(box.log, box.start, 1.0) * 10 ** (3 * share), uniform)
    return sorted(np.clip(points, box.lower, box.upper), key=f, reverse=True)[:starts]


def _measured(f: Function, box: Box, x: Array, lengths: Array) -> Top:
    """Gradient, Hessian and the verdict on x."""
    free = (x > box.lower) & (x < box.upper)
    g = _gradient(f, x, 2e-3 * lengths, box.lower, box.upper)
    half = _gradient(f, x, 1e-3 * lengths, box.lower, box.upper)
    g = (4 * half - g) / 3
    inside = np.where(free, np.minimum(x - box.lower, box.upper - x), np.inf)
    H = hessian(f, x, np.minimum(0.1 * lengths, 0.5 * inside), free)
    top = Top(x, f(x), g, H, lengths, free, converged=False)
    step, scaled = _newton(box, top), (g * lengths)[free]
    promise = float(g @ step) if step[free].any() else float(g @ step + scaled @ scaled)
    return top._replace(converged=promise <= CONVERGED)


def _newton(box: Box, top: Top) -> Array:
    """Newton's step over the free arguments (zero where the Hessian is not negative definite), and off bounds that hold up."""
    free = top.free
    inward = np.where(top.at <= box.lower, top.gradient, np.where(top.at >= box.upper, -top.gradient, 0.0))
    step = np.where(~free & (inward > 0), top.gradient * top.width**2, 0.0)
    A = -top.hessian[np.ix_(free, free)] * np.outer(top.width[free], top.width[free])
    if A.size and np.isfinite(A).all() and np.linalg.eigvalsh(A).min() > 1e-7:
        step[free] = top.width[free] * np.linalg.solve(A, (top.gradient * top.width)[free])
    return step


def _gradient(f: Function, x: Array, h: Array, low: Array, high: Array) -> Array:
    """Central differences; one-sided of second order where the other side is outside or not defined."""
    here, g = f(x), np.zeros(len(x))
    for i in range(len(x)):
        up = f(_moved(x, i, x[i] + h[i])) if x[i] + h[i] <= high[i] else -np.inf
        down = f(_moved(x, i, x[i] - h[i])) if x[i] - h[i] >= low[i] else -np.inf
        if np.isfinite(up) and np.isfinite(down):
            g[i] = (up - down) / (2 * h[i])
        elif np.isfinite(up) or np.isfinite(down):
            side, near = (1, up) if np.isfinite(up) else (-1, down)
            away = x[i] + 2 * side * h[i]
            far = f(_moved(x, i, away)) if low[i] <= away <= high[i] else -np.inf
            g[i] = side * ((4 * near - 3 * here - far) / (2 * h[i]) if np.isfinite(far) else (near - here) / h[i])
    return g


def hessian(f: Function, x: Array, h: Array, free: NDArray[np.bool_]) -> Array:
    r"""Second derivatives by central differences at steps h, h/2 and h/4, Richardson's extrapolation to order h⁶.

    >>> f = lambda x: float(np.exp(x[0]) * np.sin(x[1]))
    >>> hessian(f, np.array([0.3, 0.5]), np.array([0.1, 0.1]), np.array([True, True])) / np.exp(0.3)
    array([[ 0.47942554,  0.87758256],
           [ 0.87758256, -0.47942554]])
    """
    H, here = np.full((len(x), len(x)), np.nan), f(x)
    for i in np.flatnonzero(free):
        for j in np.flatnonzero(free[: i + 1]):
            a, b, c = (_second(f, x, here, h / part, int(i), int(j)) for part in (1, 2, 4))
            H[i, j] = H[j, i] = (16 * (4 * c - b) / 3 - (4 * b - a) / 3) / 15
    return H


def _second(f: Function, x: Array, here: float, h: Array, i: int, j: int) -> float:
    def at(s: float, t: float) -> float:
        moved = np.array(x)
        moved[i] += s * h[i]
        moved[j] += t * h[j]
        return f(moved)

    if i == j:
        values = (at(1, 0), -2 * here, at(-1, 0))
        return float(sum(values) / h[i] ** 2) if np.isfinite(values).all() else np.nan
    values4 = (at(1, 1), -at(1, -1), -at(-1, 1), at(-1, -1))
    return float(sum(values4) / (4 * h[i] * h[j])) if np.isfinite(values4).all() else np.nan


def _on_bounds(f: Function, box: Box, x: Array) -> Array:
    """x, or the point beside it on a bound where f is larger.

    A bound may be costly (a perfect measurement): it is tried only if the way there does not lead down.
    """
    for i in range(len(x)):
        for bound in (box.lower[i], box.upper[i]):
            if np.isfinite(bound) and f(_moved(x, i, bound + 1e-6 * (x[i] - bound))) > f(x) - 0.01:
                x = max((_moved(x, i, bound), x), key=f)
    return x


def _widths(f: Function, box: Box, x: Array, guess: Array) -> Array:
    return np.array([width(f, box, x, i, guess[i]) for i in range(len(x))])


def _moved(x: Array, i: int, value: float) -> Array:
    moved = np.array(x)
    moved[i] = value
    return moved
