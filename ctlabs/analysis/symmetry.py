r"""Constants of which a record cannot tell the sign, or the number of turns.

A standard deviation σ enters a model by σ², an angle by its sine and cosine, and two deviations with their correlation by ρσ₁σ₂: the
likelihood is the same at some other values, whatever the record. Of all of them one is searched: signs are taken positive, so that 0
is a bound, and not a point where a symmetric function happens to be flat.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ctlabs.analysis.surface import Box, moved, width
from ctlabs.linalg.checks import Array

#: Turns of angles, in radians and degrees.
TURNS = (2 * np.pi, 360.0)
#: Values that differ by less than this part are one.
SAME = 1e-9


class Folded(NamedTuple):
    """``box`` of the search · ``signs``, the places of constants that are taken positive · ``turns``, {place: period}."""

    box: Box
    signs: tuple[int, ...]
    turns: dict[int, float]


def folded(f: Callable[[Array], float], matrices: Callable[[Array], Array], box: Box) -> Folded:
    """The box in which each set of equivalent values has one member.

    Parameters
    ----------
    f : the log-likelihood of the values (p,); −∞ where there is none
    matrices : all the numbers of the models with these values, (any,); may raise ValueError
    box : start and bounds

    >>> box = Box(np.array([-3.0, 1.0]), np.full(2, -np.inf), np.full(2, np.inf))
    >>> found = folded(lambda x: -((x[0] ** 2 - 4) ** 2) - x[1], lambda x: np.array([x[0] ** 2, x[1]]), box)
    >>> found.signs, found.box.start, found.box.lower
    ((0,), array([3., 1.]), array([  0., -inf]))
    """
    turns = {i: turn for i in range(len(box.start)) if (turn := _turn(matrices, box, i))}
    even = np.flatnonzero((box.lower < 0) & (box.upper > 0))
    there = _away(box, even)
    if not len(even) or not np.isfinite(f(there)):
        return Folded(box, (), turns)
    felt = [int(i) for i in even if _differs(matrices, there, moved(there, int(i), 1.37 * there[i]))]
    found = [{i} for i in felt if _mirrored(f, matrices, box, there, (i,))]
    alone = {i for each in found for i in each}
    found += [set(pair) for pair in combinations([i for i in felt if i not in alone], 2) if _mirrored(f, matrices, box, there, pair)]
    start, lower, upper = (np.array(side) for side in (box.start, box.lower, box.upper))
    signs = []
    while found:
        flips = found.pop(0)
        if not flips:
            continue
        pivot = min(flips, key=lambda i: (np.isfinite(box.lower[i]) and np.isfinite(box.upper[i]), i))  # a range has its signs
        found = [each ^ flips if pivot in each else each for each in found]
        signs.append(pivot)
        if start[pivot] < 0:
            start[list(flips)] *= -1
        lower[pivot], upper[pivot] = 0.0, max(upper[pivot], -lower[pivot])
        if pivot in turns:
            upper[pivot] = min(upper[pivot], 0.5 * turns.pop(pivot))
            start[pivot] = _within_half(start[pivot], 2 * upper[pivot])
    inner = Box(np.clip(start, lower, upper), lower, upper)
    for i in signs:
        if inner.start[i] == 0:  # where a symmetric function has no slope: begin where it has one
            off = width(f, inner, inner.start, i, inner.size[i])
            inner = Box(moved(inner.start, i, min(off, 0.5 * upper[i])), lower, upper)
    return Folded(inner, tuple(sorted(signs)), turns)


def principal(value: float, turn: float, low: float, high: float) -> float:
    """The same angle between −½ and ½ turn, or where its bounds leave it."""
    near = value - turn * np.round(value / turn)
    if low <= near <= high:
        return float(near)
    return float(value)


def _within_half(value: float, turn: float) -> float:
    return abs(float(value - turn * np.round(value / turn)))


def _away(box: Box, places: Iterable[int]) -> Array:
    """The start, with what is 0 moved off it."""
    there = np.array(box.start)
    for i in places:
        if there[i] == 0:
            there[i] = min(0.1 * box.size[i], 0.5 * box.upper[i], -0.5 * box.lower[i])
    return there


def _vector(matrices: Callable[[Array], Array], x: Array) -> Array | None:
    try:
        with np.errstate(all="ignore"):  # far off anything may overflow
            return matrices(x)
    except (ValueError, ArithmeticError):
        return None


def _differs(matrices: Callable[[Array], Array], x: Array, y: Array) -> bool:
    one, other = _vector(matrices, x), _vector(matrices, y)
    return one is None or other is None or not np.array_equal(one, other)


def _mirrored(
    f: Callable[[Array], float], matrices: Callable[[Array], Array], box: Box, x: Array, places: tuple[int, ...]
) -> bool:
    """Whether f is the same with these signs changed: at one place by its matrices, or at two by itself."""
    one, other = _vector(matrices, x), _vector(matrices, _flipped(x, places))
    if one is None or other is None:
        return False
    if one.shape == other.shape and (np.abs(one - other) <= 4 * np.finfo(float).eps * np.abs(one)).all():
        return True
    near = np.clip(x * (1 + 0.031 * np.arange(1, len(x) + 1)), box.lower, box.upper)
    for point in (x, near):
        here, there = f(point), f(_flipped(point, places))
        if not (np.isfinite(here) and abs(here - there) <= SAME * (1 + abs(here)) * 1e-2):
            return False
    return True


def _flipped(x: Array, places: tuple[int, ...]) -> Array:
    found = np.array(x)
    found[list(places)] *= -1
    return found


def _turn(matrices: Callable[[Array], Array], box: Box, i: int) -> float | None:
    """The period with which all matrices repeat along axis i; nothing where they do not, or where the bounds hold less than a turn."""
    x = box.start
    for turn in TURNS:
        if box.upper[i] - box.lower[i] <= turn:
            continue
        side = 1 if x[i] + turn <= box.upper[i] else -1
        points = [_vector(matrices, moved(x, i, x[i] + side * part * turn)) for part in (0.0, 0.37, 1.0)]
        if any(point is None for point in points):
            continue
        here, between, again = points
        assert here is not None
        if np.abs(again - here).max(initial=0.0) <= SAME * np.abs(between - here).max(initial=0.0) != 0:
            return turn
    return None
