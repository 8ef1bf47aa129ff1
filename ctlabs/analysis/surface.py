r"""A function of several arguments with its slope, and the climb to a maximum of it.

Written for log-likelihoods, whose unit is the natural one: two points that differ by ½ are one standard deviation apart. A climb takes
positive arguments by their logarithms and others in lengths that the function itself gives, so that units do not matter. Its steps
maximise a quadratic model within a trust region; the model's curvature begins with differences of slopes, and each step adds what
it tells (Nocedal & Wright, *Numerical Optimization*, 2nd ed., chapters 4 and 6.2).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ctlabs.linalg.checks import Array

Function = Callable[[Array], float]
Slope = Callable[[Array], Array | None]

#: The gain that a climb may leave: 1.4e-6 standard deviations.
LEFT = 1e-12
#: A gain below which rounding may hide it, so that slopes judge a step.
HIDDEN = 1e-5
#: So many of such steps may be judged by the gain all the same.
PATIENCE = 10
#: Eigenvalues of a curvature scaled to a unit diagonal below which a direction is flat.
FLAT = 1e-9
#: A positive argument is not searched below this part of where it was: only 0 itself is tried.
DEEP = 1e-20
#: Steps of a climb at most.
STEPS = 120


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """``start``, ``lower``, ``upper`` (p,), the bounds possibly infinite."""

    start: Array
    lower: Array
    upper: Array

    @property
    def log(self) -> NDArray[np.bool_]:
        """Which arguments are positive, declared so by a bound: they are searched by their logarithms."""
        return self.lower >= 0

    @property
    def size(self) -> Array:
        """A first guess of the lengths: a quarter of a finite range, else the start itself."""
        own = np.where(self.start != 0, np.abs(self.start), 1.0)
        span = self.upper - self.lower
        return np.where(np.isfinite(span), 0.25 * span, own)

    def without(self, i: int) -> Box:
        """The box of the other arguments."""
        return Box(*(np.delete(side, i) for side in (self.start, self.lower, self.upper)))


class Climbed(NamedTuple):
    """Where a climb ended: ``at`` (p,), ``value``, ``slope`` (p,), ``curvature`` (p, p), an estimate, and the gain still ``promised``."""

    at: Array
    value: float
    slope: Array
    curvature: Array
    promised: float


class Surface:
    """A function in a box with its slope, exact where one is given (and not ``None``), else by differences."""

    def __init__(self, f: Function, box: Box, slope: Slope | None = None) -> None:
        self.f, self.box, self._exact = f, box, slope
        self.lengths = np.array(box.size)  # of the differences

    def __call__(self, x: Array) -> float:
        """f."""
        return self.f(x)

    def slope(self, x: Array) -> Array:
        """∂f (p,)."""
        found = None if self._exact is None else self._exact(x)
        return self._differences(x) if found is None else found

    @property
    def exact(self) -> bool:
        """Whether it has a slope of its own."""
        return self._exact is not None

    def without(self, x: Array, i: int) -> Surface:
        """The function of the other arguments, with argument i as in x."""
        others = np.arange(len(x)) != i

        def whole(rest: Array) -> Array:
            full = np.array(x)
            full[others] = rest
            return full

        def own(rest: Array) -> Array | None:
            found = None if self._exact is None else self._exact(whole(rest))
            return None if found is None else found[others]

        found = Surface(lambda rest: self.f(whole(rest)), self.box.without(i), own if self.exact else None)
        found.lengths = self.lengths[others]
        return found

    def _differences(self, x: Array) -> Array:
        """Central differences of fourth order over lengths in which f changes by about ½."""
        self.lengths = np.array([width(self.f, self.box, x, i, self.lengths[i]) for i in range(len(x))])
        wide, half = (gradient(self.f, x, part * self.lengths, self.box.lower, self.box.upper) for part in (2e-3, 1e-3))
        return np.asarray((4 * half - wide) / 3)


def climb(
    surface: Surface, x: Array, log: NDArray[np.bool_], curvature: Array | None = None, left: float = LEFT, steps: int = STEPS
) -> Climbed:
    """A maximum next to x, on a bound if it is there.

    >>> box = Box(np.array([1.0]), np.array([0.0]), np.array([np.inf]))
    >>> found = climb(Surface(lambda x: float(3 * np.log(x[0]) - x[0]), box, lambda x: 3 / x - 1), box.start, box.log)
    >>> found.at.round(5)
    array([3.])
    """
    way = _Climb(surface, np.clip(x, surface.box.lower, surface.box.upper), log, curvature, left)
    if not np.isfinite(way.value):
        nothing = np.full(len(x), np.nan)
        return Climbed(x, way.value, nothing, np.full((len(x),) * 2, np.nan), np.inf)
    for _step in range(steps):
        if not (way.step() or way.settle()):
            break
    return way.found()


class _Climb:
    """One climb: where it is, and its quadratic model over u, the logarithms or the arguments in units of ``scale``.

    An argument 0 has no logarithm, and stands still until :meth:`settle` moves it.
    """

    def __init__(self, surface: Surface, x: Array, log: NDArray[np.bool_], curvature: Array | None, left: float) -> None:
        self.f, self.box, self.x, self.log, self.left = surface, surface.box, np.array(x), log, left
        self.value, self.radius, self.hidden = surface(x), 1.0, 0
        self.refused = np.full(len(x), np.inf)  # a bound that was no better is tried again much nearer to it
        if not np.isfinite(self.value):
            return
        self.slope = surface.slope(self.x)
        self.floor = np.where(self.log & (self.x > 0), DEEP * self.x, -np.inf)
        self.scale = np.maximum(np.abs(self.x), self.box.size)
        self.known = curvature is not None
        if curvature is not None:
            self._rescale(curvature)
        else:
            self._look()

    # --- the model ---------------------------------------------------------------------------------------------------

    @property
    def unit(self) -> Array:
        """∂x/∂u."""
        return np.where(self.log, self.x, self.scale)

    @property
    def free(self) -> NDArray[np.bool_]:
        """Which arguments may move: not those on a bound that holds them."""
        held = ((self.x <= self.box.lower) & (self.slope <= 0)) | ((self.x >= self.box.upper) & (self.slope >= 0))
        return np.asarray(~held & (self.unit > 0))

    def _rescale(self, curvature: Array) -> None:
        """Lengths of the arguments without logarithms from ∂²f (p, p), and the model's curvature A = −∂²f/∂u²."""
        diagonal = np.abs(curvature.diagonal())
        with np.errstate(divide="ignore", invalid="ignore"):
            own = np.maximum(1 / np.sqrt(diagonal), np.abs(self.slope) / diagonal)
        own = np.minimum(np.where(np.isfinite(own), own, self.scale), 1e5 * self.scale)
        self.scale = np.where(self.log, self.scale, own)
        with np.errstate(all="ignore"):
            A = -curvature * self.unit * self.unit[:, None] - np.diag(np.where(self.log, self.x * self.slope, 0.0))
        self.A = np.where(np.isfinite(A), A, 0.0)

    def _look(self) -> None:
        """The curvature by differences of slopes."""
        p = len(self.x)
        rows = np.zeros((p, p))
        for i in range(p):
            if self.unit[i] > 0 and self.free[i]:
                rows[i] = self._bent(i)
        mean = 0.5 * (rows + rows.T)
        self._rescale(mean)

    def _bent(self, i: int) -> Array:
        """∂slope/∂x_i, (p,), over a step in which the slope changes so far that rounding does not count."""
        h, found = 1e-4 * self.unit[i], np.zeros(len(self.x))
        for _again in range(6):
            for side in (1, -1):
                near = moved(self.x, i, float(np.clip(self.x[i] + side * h, self.box.lower[i], self.box.upper[i])))
                if near[i] == self.x[i] or not np.isfinite(self.f(near)):
                    continue
                change = self.f.slope(near) - self.slope
                if not np.isfinite(change).all():
                    continue
                found = change / (near[i] - self.x[i])
                if self.log[i] or (abs(change[i]) > 1e-7 * abs(self.slope[i]) and abs(change[i]) * self.unit[i] > 1e-9):
                    return found
                break
            else:
                h /= 100
                continue
            h *= 100
        return found

    def _model(self, p: Array) -> float:
        return float((self.slope * self.unit) @ p - 0.5 * p @ self.A @ p)

    def promised(self) -> float:
        """What the model promises; over a flat direction, over one length."""
        free = self.free
        if not free.any():
            return 0.0
        g, A = (self.slope * self.unit)[free], self.A[np.ix_(free, free)]
        own = 1 / np.sqrt(np.maximum(np.abs(A.diagonal()), 1e-6))
        values, vectors = np.linalg.eigh(A * np.outer(own, own))
        along = vectors.T @ (g * own)
        bent = values > FLAT
        return float((0.5 * along[bent] ** 2 / values[bent]).sum() + np.abs(along[~bent]).sum())

    # --- steps -------------------------------------------------------------------------------------------------------

    def step(self) -> bool:
        """One step within the trust region; whether there is a next one."""
        free, before = self.free, self.promised()
        if before <= self.left:
            return False
        p = np.zeros(len(self.x))
        p[free] = _within(self.A[np.ix_(free, free)], (self.slope * self.unit)[free], self.radius)
        near, p = self._at(p)
        gain = self._model(p)
        if not (gain > 0 and p.any()):
            p = np.where(free, self.radius * self.slope * self.unit, 0.0)
            p /= max(float(np.linalg.norm(self.slope * self.unit)), 1e-300)
            near, p = self._at(p)
            gain = max(self._model(p), float((self.slope * self.unit) @ p) * 1e-3)
        length = float(np.linalg.norm(p))
        if not length > 1e-14:
            return False
        value = self.f(near)
        ratio = (value - self.value) / gain if np.isfinite(value) else -1.0
        hidden = gain < HIDDEN and abs(value - self.value) < HIDDEN
        if ratio > 1e-4 or hidden:
            return self._accept(near, p, value, before if hidden else np.inf, ratio, length)
        self.radius = 0.25 * length
        if self.radius < 1e-3 and not self.known and gain > HIDDEN:
            self.known = True  # the model is not what the function is: look again, once
            self._look()
            self.radius = 0.1
        return self.radius > 1e-10

    def _accept(self, near: Array, p: Array, value: float, before: float, ratio: float, length: float) -> bool:
        """Go on from a better point, or (where rounding hides the gain) from one whose slope promises less than ``before``."""
        old = self.x, self.slope, self.value, self.A
        unit = self.unit
        slope = self.f.slope(near)
        y = slope * np.where(self.log, near, self.scale) - self.slope * unit
        off = -y - self.A @ p
        if abs(off @ p) > 1e-8 * np.linalg.norm(off) * length:
            self.A = self.A + np.outer(off, off) / (off @ p)
        self.x, self.slope, self.value = near, slope, value
        if np.isfinite(before):
            self.hidden += 1
            if self.promised() > 0.5 * before and not (ratio > 0.1 and self.hidden < PATIENCE):
                self.x, self.slope, self.value, self.A = old
                return False
        if ratio > 0.75 and length > 0.8 * self.radius:
            self.radius = 4 * self.radius
        elif ratio < 0.25:
            self.radius = 0.3 * length
        self._to_zero()
        return True

    def _at(self, p: Array) -> tuple[Array, Array]:
        """The point of a step in the box, and the step as it is then."""
        with np.errstate(over="ignore"):
            near = np.where(self.log, self.x * np.exp(np.clip(p, -700, 700)), self.x + self.scale * p)
        near = np.clip(near, np.maximum(self.box.lower, self.floor), self.box.upper)
        with np.errstate(divide="ignore", invalid="ignore"):
            logs = np.log(near / self.x)
        own = np.where(self.log, np.where(np.isfinite(logs), logs, 0.0), (near - self.x) / self.scale)
        near = np.where(self.log & ~np.isfinite(logs), self.x, near)
        return near, own

    def _to_zero(self) -> None:
        """A positive argument that is better still on its bound 0 goes there: its logarithm never would."""
        for i in np.flatnonzero(self.log & (self.box.lower == 0) & (self.x > 0) & (self.slope < 0)):
            weak = self.x[i] * -self.slope[i] < 0.3 and self.A[i, i] < 0.5  # less than this is lost on the way
            if weak and self.x[i] < 0.1 * self.refused[i]:
                near = moved(self.x, int(i), 0.0)
                value = self.f(near)
                if value >= self.value:
                    self.x, self.value, self.slope = near, value, self.f.slope(near)
                else:
                    self.refused[i] = self.x[i]

    def settle(self) -> bool:
        """After the last step: arguments go onto a bound beside them that is as good, and leave one that is not; whether any did."""
        self._to_zero()
        for i in range(len(self.x)):
            low, high = self.box.lower[i], self.box.upper[i]
            inward = self.slope[i] if self.x[i] <= low else -self.slope[i] if self.x[i] >= high else 0.0
            if not (inward > 0 and self.log[i] and self.x[i] == 0):
                continue
            h = min(0.5 / inward, 0.25 * (high - low))
            for _again in range(20):
                near = moved(self.x, i, self.x[i] + h)
                value = self.f(near)
                if value > self.value + self.left:
                    self.x, self.value, self.slope = near, value, self.f.slope(near)
                    self._look()
                    self.radius = 1.0
                    return True
                if inward * h < 1e-9:
                    break
                h /= 8
        return False

    def found(self) -> Climbed:
        """The end, in the arguments themselves."""
        unit = np.where(self.unit > 0, self.unit, 1.0)
        A = self.A + np.diag(np.where(self.log, self.x * self.slope, 0.0))
        with np.errstate(all="ignore"):  # an argument of 1e-200
            curvature = -A / unit / unit[:, None]
        return Climbed(self.x, self.value, self.slope, curvature, self.promised())


def _within(A: Array, g: Array, radius: float) -> Array:
    """The p that maximises g·p − ½pᵀAp with ‖p‖ ≤ radius."""
    values, vectors = np.linalg.eigh(A)
    along = vectors.T @ g
    floor = FLAT * max(float(np.abs(values).max()), 1e-300)
    if values[0] > floor:
        newton = along / values
        if np.linalg.norm(newton) <= radius:
            return np.asarray(vectors @ newton)
    low = max(0.0, -float(values[0])) + floor
    high = low + float(np.linalg.norm(along)) / radius + float(np.abs(values).max())
    for _again in range(80):
        middle = 0.5 * (low + high)
        if np.linalg.norm(along / (values + middle)) > radius:
            low = middle
        else:
            high = middle
        if high - low < 1e-3 * high:
            break
    return np.asarray(vectors @ (along / (values + high)))


def width(f: Function, box: Box, x: Array, i: int, guess: float) -> float:
    """The distance from x along axis i, inside the box, at which f has changed by about ½, or so far that its rounding does not count."""
    here, d = f(x), guess
    target = max(0.5, np.finfo(float).eps ** 0.5 * abs(here)) if np.isfinite(here) else 0.5
    for _ in range(60):
        inside = [x[i] + s * d for s in (1, -1) if box.lower[i] < x[i] + s * d < box.upper[i]]
        changes = [c for c in (abs(f(moved(x, i, v)) - here) for v in inside) if np.isfinite(c)]
        change = max(changes, default=np.inf)
        if 0.5 < change / target < 2.0 or (change <= 0.5 * target and d > 1e9 * guess):
            break
        d *= np.clip(np.sqrt(target / max(change, 1e-300)), 1 / 16, 16) if changes else 0.25
    return float(d)


def gradient(f: Function, x: Array, h: Array, low: Array, high: Array) -> Array:
    """Central differences; one-sided of second order where the other side is outside or not defined."""
    here, g = f(x), np.zeros(len(x))
    for i in range(len(x)):
        up = f(moved(x, i, x[i] + h[i])) if x[i] + h[i] <= high[i] else -np.inf
        down = f(moved(x, i, x[i] - h[i])) if x[i] - h[i] >= low[i] else -np.inf
        if np.isfinite(up) and np.isfinite(down):
            g[i] = (up - down) / (2 * h[i])
        elif np.isfinite(up) or np.isfinite(down):
            side, near = (1, up) if np.isfinite(up) else (-1, down)
            away = x[i] + 2 * side * h[i]
            far = f(moved(x, i, away)) if low[i] <= away <= high[i] else -np.inf
            g[i] = side * ((4 * near - 3 * here - far) / (2 * h[i]) if np.isfinite(far) else (near - here) / h[i])
    return g


def moved(x: Array, i: int, value: float) -> Array:
    """x with another argument i."""
    found = np.array(x)
    found[i] = value
    return found
