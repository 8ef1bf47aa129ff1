r"""The maximum of a smooth function in a box: where it is, how sharp, and its profiles.

Written for log-likelihoods, whose unit is the natural one (:mod:`ctlabs.analysis.surface`). A function returns −∞ where it is not defined.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ctlabs.analysis.surface import Box as Box
from ctlabs.analysis.surface import Climbed, Function, Slope, Surface, climb, moved
from ctlabs.analysis.surface import width as width
from ctlabs.linalg.checks import Array

#: Half of the 95 % quantile of χ²(1): how far a profile may lie below the top inside the likelihood-ratio interval.
DROP = 1.920729410347062
#: Where a profile is drawn, beside the points that the search for its ends meets, in lengths of the interval's half (logarithms of
#: a positive constant).
DRAWN = (0.5, 1.2)
#: The gain in f that a Newton step may still promise at a maximum, unless f itself is rougher.
CONVERGED = 1e-8
#: The gain that a point of a profile may leave to its model, which adds it.
PROFILED = 1e-5
#: A slope, per standard deviation, with which a profile rises.
RISING = 1e-3
#: Steps at most to the end of an interval, and to each point of a profile.
AGAIN = 30
#: The step of the differences of slopes that give a Hessian, in standard deviations.
STEP = 0.02
#: How near to the end of an interval (in standard deviations) a last step of Newton's finds it to 1e-6.
NEAR = 2.5e-3
#: Standard deviations after which a profile that does not fall is taken for one that never does.
FAR = 1e5


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


def search(f: Function, box: Box, starts: int = 2, slope: Slope | None = None) -> Top:
    """The highest maximum found from the start, and from the best of some other points.

    >>> box = Box(np.array([1.0]), np.array([0.0]), np.array([np.inf]))
    >>> search(lambda x: float(3 * np.log(x[0]) - x[0]), box).at.round(6)
    array([3.])
    """
    surface = Surface(f, box, slope)
    return finished(surface, best(surface, starts))


def best(surface: Surface, starts: int = 0) -> Climbed:
    """The highest end of the climbs from the start and from ``starts`` other points; of some more, where those do not end on a maximum."""
    box = surface.box
    found = _climbed(surface, box.start)
    for x in others(surface, box, box.size, starts):
        found = max(found, _climbed(surface, x), key=lambda each: each.value)
    if found.promised > 1e-2:
        for x in others(surface, box, box.size, 2 if not starts else 0):
            found = max(found, _climbed(surface, x), key=lambda each: each.value)
    return found


def nearest(f: Function, box: Box, slope: Slope | None = None) -> Array:
    """The maximum next to the start, without its derivatives: the value to far less than 1, for ratios of likelihoods.

    >>> nearest(lambda x: float(3 * np.log(x[0]) - x[0]), Box(np.array([1.0]), np.array([0.0]), np.array([np.inf]))).round(2)
    array([3.])
    """
    return climb(Surface(f, box, slope), box.start, box.log, left=1e-6).at


def finish(f: Function, box: Box, x: Array, slope: Slope | None = None) -> Top:
    """The maximum next to x, to the last digits, on a bound if it is there."""
    surface = Surface(f, box, slope)
    return finished(surface, _climbed(surface, x))


def finished(surface: Surface, found: Climbed) -> Top:
    """The end of a climb, measured; where its arguments themselves promise more than their logarithms did, it goes on."""
    top = measured(surface, found)
    for _again in range(3):
        if top.converged or not np.isfinite(top.value):
            break
        linear = climb(surface, top.at, np.zeros(len(top.at), dtype=bool), np.nan_to_num(top.hessian))
        if not linear.value > top.value + CONVERGED:
            break
        top = measured(surface, climb(surface, linear.at, surface.box.log))
    return top


def _climbed(surface: Surface, x: Array) -> Climbed:
    """A climb; where it is stuck, as on an edge, Nelder and Mead's simplex helps."""
    from scipy.optimize import minimize

    box = surface.box
    found = climb(surface, x, box.log)
    if found.promised <= 1e-2 or not np.isfinite(found.value):
        return found
    log = box.log & (found.at > 0)
    unit = np.where(log, found.at, np.where(found.at != 0, np.abs(found.at), box.size))

    def point(u: Array) -> Array:
        whole = np.where(log, found.at * np.exp(np.clip(u, -700, 700)), found.at + unit * u)
        return np.asarray(np.clip(whole, box.lower, box.upper))

    def descent(u: Array) -> float:
        value = surface(point(u))
        return -value if np.isfinite(value) else 1e300

    rough = minimize(descent, np.zeros(len(x)), method="Nelder-Mead", options={"maxfev": 200 * len(x)})
    if not -rough.fun > found.value:
        return found
    again = climb(surface, point(rough.x), box.log)
    return again if again.value >= found.value else found


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
    positive = np.where(box.start > 0, box.start, size)
    points = np.where(box.log & ~np.isfinite(span), positive * 10 ** (3 * share), uniform)
    return sorted(np.clip(points, box.lower, box.upper), key=f, reverse=True)[:starts]


def measured(surface: Surface, found: Climbed) -> Top:
    """Gradient, Hessian and the verdict on the end of a climb, with last steps of Newton's."""
    top = _bent(surface, found.at, found.value, found.slope, found.curvature)
    for _again in range(3):
        step = _newton(top)
        gain = float(top.gradient @ step)
        if not 1e-16 < gain < 0.1:
            break
        better = np.clip(top.at + step, surface.box.lower, surface.box.upper)
        value = surface(better)
        slope = surface.slope(better) if value > top.value - 1e-4 else top.gradient
        if not abs(float(slope @ step)) < 0.5 * gain:
            break
        if gain < 1e-10:
            top = top._replace(at=better, value=value, gradient=slope)
            break
        top = _bent(surface, better, value, slope, top.hessian)
    return top._replace(converged=_converged(surface, top))


def _bent(surface: Surface, x: Array, value: float, slope: Array, guess: Array) -> Top:
    """The Hessian at x, with steps in lengths that it gives itself."""
    box, free = surface.box, (x > surface.box.lower) & (x < surface.box.upper)
    if not np.isfinite(value):
        nan = np.full((len(x), len(x)), np.nan)
        return Top(x, value, slope, nan, nan.diagonal(), np.zeros(len(x), dtype=bool), converged=False)
    H, lengths = guess, _lengths(guess, box, x)
    for _again in range(3):
        before, H = lengths, _curvature(surface, x, lengths, free)
        lengths = np.where(np.isfinite(H.diagonal()), _lengths(H, box, x), before)
        if not (free & ~((lengths < 8 * before) & (before < 8 * lengths))).any():
            break
    return Top(x, value, slope, H, lengths, free, converged=False)


def _converged(surface: Surface, top: Top) -> bool:
    """Whether no step promises more than :data:`CONVERGED`, or than the roughness of f where that is more."""
    box = surface.box
    inward = np.where(top.at <= box.lower, top.gradient, np.where(top.at >= box.upper, -top.gradient, -np.inf))
    scaled = (top.gradient * top.width)[top.free]
    leaves = float(np.maximum(inward[~top.free] * top.width[~top.free], 0.0).sum())
    A = -top.hessian[np.ix_(top.free, top.free)] * np.outer(top.width[top.free], top.width[top.free])
    if not np.isfinite(A).all() or not np.isfinite(scaled).all():
        return False
    if not surface.exact and not all(_parabolic(surface, top, int(i)) for i in np.flatnonzero(top.free)):
        return False
    promise = leaves
    if A.size:
        values, vectors = np.linalg.eigh(A)
        along, bent = vectors.T @ scaled, values > 1e-7
        if values[0] < -1e-4:
            return False
        promise += float((0.5 * along[bent] ** 2 / values[bent]).sum() + (along[~bent] ** 2).sum())
    return promise <= CONVERGED or (promise < 1e-3 and promise <= roughness(surface, top))


def _parabolic(surface: Surface, top: Top, i: int) -> bool:
    """Whether f falls on either side as its Hessian says, a tenth of a standard deviation away; a kink does not."""
    fall = -0.5 * float(top.hessian[i, i]) * (0.1 * top.width[i]) ** 2
    both = [surface(moved(top.at, i, top.at[i] + side * 0.1 * top.width[i])) for side in (1, -1)]
    mean = top.value - 0.5 * sum(value for value in both if np.isfinite(value))
    return not np.isfinite(both).all() or abs(mean - fall) <= 0.5 * abs(fall) + 1e-6


def roughness(f: Callable[[Array], float], top: Top) -> float:
    """How far rounding moves f: the spread of its values over steps of 1e-6 standard deviations, which change it by 1e-12.

    >>> top = Top(np.ones(1), 0.0, np.zeros(1), -np.eye(1), np.ones(1), np.ones(1, dtype=bool), converged=True)
    >>> roughness(lambda x: float(np.round(1e9 * np.sin(1e9 * x[0]))) / 1e15, top) < 4e-6
    True
    """
    direction = np.where(top.free, top.width, 0.0)
    values = [f(top.at + 1e-6 * part * direction) for part in (-3, -2, -1, 0, 1, 2, 3)]
    rough = np.array([value for value in values if np.isfinite(value)])
    return float(np.ptp(rough)) if len(rough) > 2 else 0.0


def _lengths(H: Array, box: Box, x: Array) -> Array:
    """The distances at which f has changed by about ½, at most far beyond the arguments' sizes."""
    size = np.maximum(np.abs(x), box.size)
    with np.errstate(divide="ignore", invalid="ignore"):
        own = 1 / np.sqrt(np.abs(H.diagonal()))
    return np.where(np.isfinite(own), np.minimum(own, FAR * size), FAR * size)


def _curvature(surface: Surface, x: Array, lengths: Array, free: NDArray[np.bool_]) -> Array:
    """The Hessian: differences of exact slopes, or of f."""
    if not surface.exact:
        inside = np.where(free, np.minimum(x - surface.box.lower, surface.box.upper - x), np.inf)
        return hessian(surface, x, np.minimum(0.1 * lengths, 0.5 * inside), free)
    return bent(surface, x, np.minimum(STEP * lengths, 0.25 * (surface.box.upper - surface.box.lower)), free)


def bent(surface: Surface, x: Array, h: Array, free: NDArray[np.bool_]) -> Array:
    r"""Second derivatives by central differences of slopes at steps h and h/2, extrapolated to order h⁴.

    >>> box = Box(np.zeros(2), np.full(2, -np.inf), np.full(2, np.inf))
    >>> def slope(x): return np.exp(x[0]) * np.array([np.sin(x[1]), np.cos(x[1])])
    >>> f = Surface(lambda x: float(np.exp(x[0]) * np.sin(x[1])), box, slope)
    >>> bent(f, np.array([0.3, 0.5]), np.array([0.01, 0.01]), np.array([True, True])) / np.exp(0.3)
    array([[ 0.47942554,  0.87758256],
           [ 0.87758256, -0.47942554]])
    """
    H, here = np.full((len(x), len(x)), np.nan), surface.slope(x)
    for i in np.flatnonzero(free).tolist():
        inside = min(x[i] - surface.box.lower[i], surface.box.upper[i] - x[i])
        side = 1 if x[i] + 2 * h[i] <= surface.box.upper[i] else -1
        rows = []
        for part in (1.0, 0.5):
            places = (1, -1) if inside > h[i] else (side, 2 * side)  # beside a bound, to the other side
            near = [moved(x, i, x[i] + place * part * h[i]) for place in places]
            if not all(np.isfinite(surface(each)) for each in near):
                return np.full(H.shape, np.nan)
            one, other = (surface.slope(each) for each in near)
            step = near[0][i] - x[i]
            rows.append((one - other) / (2 * step) if inside > h[i] else (4 * one - 3 * here - other) / (2 * step))
        H[i, free] = ((4 * rows[1] - rows[0]) / 3)[free]
    return np.asarray(0.5 * (H + H.T))


def _newton(top: Top) -> Array:
    """Newton's step over the free arguments; zero where the Hessian is not negative definite."""
    free, step = top.free, np.zeros(len(top.at))
    A = -top.hessian[np.ix_(free, free)] * np.outer(top.width[free], top.width[free])
    if A.size and np.isfinite(A).all() and np.linalg.eigvalsh(A).min() > 1e-7:
        step[free] = top.width[free] * np.linalg.solve(A, (top.gradient * top.width)[free])
    return step


# Profiles -------------------------------------------------------------------------------------------------------------


def profile(
    f: Function, box: Box, top: Top, i: int, slope: Slope | None = None
) -> tuple[tuple[float, float], Profile, Array]:
    """How f falls along argument i with the others at their best: interval of f ≥ top − 1.92, profile, best point met."""
    path = _Path(Surface(f, box, slope), top, i)
    ends = _end(path, -1), _end(path, 1)
    for side, end in zip((-1, 1), ends, strict=True):
        for part in DRAWN:
            path(path.between(end, side, part))
        if np.isfinite(end) and end not in path.values:
            path.values[end] = top.value - DROP
    path.look()
    first, last = (path.between(end, side, 2.0) for side, end in zip((-1, 1), ends, strict=True))  # far beyond nothing is drawn
    known = sorted((v, value) for v, value in path.values.items() if np.isfinite(value) and first <= v <= last)
    return ends, Profile(*(np.array(column) for column in zip(*known, strict=True))), path.best


class _Path:
    """The profile along argument i: f at its best over the others, each point started from those known."""

    def __init__(self, surface: Surface, top: Top, i: int) -> None:
        self.f, self.box, self.top, self.i = surface, surface.box, top, i
        self.others = np.arange(len(top.at)) != i
        self.known: dict[float, Array] = {float(top.at[i]): top.at}
        self.values: dict[float, float] = {float(top.at[i]): top.value}
        self.bends: dict[float, Array] = {}
        self.higher: Array | None = None
        self.log = self.box.log & (top.at > 0)
        self.tangent = self._tangent()
        self.width = self._width()

    @property
    def best(self) -> Array:
        """The highest point met."""
        return max(self.known.values(), key=self.f) if self.higher is None else self.higher

    def look(self) -> None:
        """Where the profile rises away from the top, another peak may be higher: climb it."""
        at = float(self.top.at[self.i])
        for v, x in list(self.known.items()) if self.f.exact else []:
            if v != at and np.isfinite(self.values[v]) and np.sign(v - at) * self.fall(v) * self.width > RISING:
                found = climb(self.f, x, self.box.log)
                if found.value > max(self.top.value, self.f(self.best)) + 1e-6:
                    self.higher = found.at

    def __call__(self, value: float) -> float:
        if value not in self.known:
            x = moved(self._predicted(value), self.i, value)
            self.known[value], self.values[value] = self._highest(x) if self.others.any() else (x, self.f(x))
        return self.values[value]

    def ahead(self, value: float, step: float) -> float:
        """A step along the axis, by its logarithm where that is straighter."""
        return float(value * np.exp(np.clip(step / value, -3, 3)) if self.log[self.i] and value > 0 else value + step)

    def fall(self, value: float) -> float:
        """The slope of the profile."""
        return float(self.f.slope(self.known[value])[self.i])

    def between(self, end: float, side: int, part: float) -> float:
        """A point between the top and the end of the interval, or beyond it."""
        at = float(self.top.at[self.i])
        if not np.isfinite(end):
            value = at + side * part * 8 * self.width
        elif self.log[self.i] and end > 0:
            value = at * (end / at) ** part
        else:
            value = at + part * (end - at)
        return float(np.clip(value, self.box.lower[self.i], self.box.upper[self.i]))

    def _tangent(self) -> Array:
        """How the others move with argument i at the top."""
        free, found = self.top.free & self.others, np.zeros(len(self.top.at))
        found[self.i] = 1.0
        A = self.top.hessian[np.ix_(free, free)]
        if self.top.free[self.i] and free.any() and np.isfinite(A).all():
            own = self.top.width[free]
            scaled = np.linalg.lstsq(A * np.outer(own, own), self.top.hessian[free, self.i] * own, rcond=1e-9)[0]
            found[free] = -scaled * own
        return found

    def _width(self) -> float:
        """The distance along the profile at which f has fallen by ½, as far as its curvature at the top tells."""
        free, t = self.top.free, self.tangent
        bend = float(-t[free] @ self.top.hessian[np.ix_(free, free)] @ t[free]) if free[self.i] else 0.0
        most = float(self.top.width[self.i])
        if bend > 0 and np.isfinite(bend):
            return float(min(bend**-0.5, FAR * most))
        return width(self.f, self.box, self.top.at, self.i, min(most, float(self.box.size[self.i])))

    def _predicted(self, value: float) -> Array:
        """Where the others would be: on the curve through the nearest known points, and the tangent at the top.

        In the logarithms of positive arguments the path is straighter.
        """
        at, unit = self.top.at, np.where(self.log, self.top.at, 1.0)

        def straight(x: Array) -> Array:
            with np.errstate(divide="ignore"):
                return np.asarray(np.where(self.log, np.log(np.maximum(x / unit, 1e-300)), x - at))

        def along(v: float) -> float:
            return float(straight(moved(at, self.i, v))[self.i])

        start, side = float(at[self.i]), np.sign(value - at[self.i])
        near = sorted((v for v in self.known if side * (v - start) > 0), key=lambda v: abs(along(v) - along(value)))[:2]
        d, tangent = along(value), self.tangent * unit[self.i] / unit
        found = d * tangent
        if near:
            nodes = np.array([along(v) for v in near])
            rest = np.array([straight(self.known[v]) - node * tangent for v, node in zip(near, nodes, strict=True)])
            powers = np.arange(len(near))
            found = found + d * d * d**powers @ np.linalg.solve(nodes[:, None] ** powers, rest / nodes[:, None] ** 2)
        close = straight(self.known[near[0]]) if near else np.zeros(len(at))
        found = np.where(self.log & (np.abs(found - close) > 3), close, found)  # too far to be foreseen
        x = np.where(self.log, at * np.exp(np.where(self.log, found, 0.0)), at + found)
        return np.asarray(np.clip(x, self.box.lower, self.box.upper))

    def _highest(self, x: Array) -> tuple[Array, float]:
        """The others at their best, and f there with what the model of the last step still promises."""
        known = self.bends[min(self.bends, key=lambda v: abs(v - x[self.i]))] if self.bends else None
        if known is None and np.isfinite(own := self.top.hessian[np.ix_(self.others, self.others)]).all():
            known = own
        rest = self.f.without(x, self.i)
        found = climb(rest, x[self.others], rest.box.log, known, left=PROFILED, steps=AGAIN)
        if not np.isfinite(found.value):
            found = climb(rest, self.top.at[self.others], rest.box.log, None, left=PROFILED, steps=AGAIN)
        deep = self.log[self.others] & (found.at < 1e-6 * self.top.at[self.others])  # there a curvature is that of logarithms
        if np.isfinite(found.curvature).all() and not deep.any():
            self.bends[float(x[self.i])] = found.curvature
        full = np.array(x)
        full[self.others] = found.at
        return full, found.value + (found.promised if found.promised <= PROFILED else 0.0)


def _end(path: _Path, side: int) -> float:
    """Where the profile has fallen by 1.92 on one side: a bound if it has not fallen so far there, ±∞ if it never does."""
    at, top, i = float(path.top.at[path.i]), path.top.value, path.i
    bound, target = float((path.box.lower if side < 0 else path.box.upper)[i]), float(np.sqrt(2 * DROP))
    inner, outer, d = at, side * np.inf, target * path.width
    if path.log[i]:  # the logarithm is nearer to normal
        d = abs(at * np.expm1(side * min(d / at, 3.0)))
    value = at + side * d
    for _again in range(AGAIN):
        value = max(value, bound) if side < 0 else min(value, bound)
        height = path(value)
        score = min(float(np.sqrt(2 * max(top - height, 0.0))), 30.0)  # nearly straight
        if value == bound and score < target:
            return bound
        inner, outer = (value, outer) if score < target else (inner, value)
        steep = -side * path.fall(value) / score if 0 < score < 30 else 0.0
        newton = path.ahead(value, side * (target - score) / steep) if steep > 0 else side * np.inf
        if abs(score - target) < NEAR and steep > 0 and np.isfinite(newton):
            return float(np.clip(newton, min(inner, outer), max(inner, outer)))
        if abs(value - at) > FAR * max(path.width, float(path.top.width[i])):
            return side * np.inf
        if np.isfinite(outer):
            inside = min(inner, outer) < newton < max(inner, outer)
            value = newton if inside else 0.5 * (inner + outer)
            if abs(outer - inner) < 1e-9 * path.width:
                return float(value)
        else:
            farthest = at + side * max(4 * abs(value - at), path.width)
            near = path.log[i] and side < 0 and value < 0.1 * at  # logarithms never get there
            value = bound if near else side * min(side * newton, side * farthest)
    return float(value)


# Second derivatives of a function without a slope ------------------------------------------------------------------------


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
        near = np.array(x)
        near[i] += s * h[i]
        near[j] += t * h[j]
        return f(near)

    if i == j:
        values = (at(1, 0), -2 * here, at(-1, 0))
        return float(sum(values) / h[i] ** 2) if np.isfinite(values).all() else np.nan
    values4 = (at(1, 1), -at(1, -1), -at(-1, 1), at(-1, -1))
    return float(sum(values4) / (4 * h[i] * h[j])) if np.isfinite(values4).all() else np.nan
