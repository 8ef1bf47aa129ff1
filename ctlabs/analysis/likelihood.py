r"""The likelihood as a function of a model's constants, and a start at which a record is possible.

Where perfect measurements contradict the constants (:mod:`ctlabs.filtering.contradictions`), ℓ = −∞ has no slope: the sum of squares of
the contradicting innovations is lowered first, until none is left. Constants of which then no other value is possible are
determined exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ctlabs.analysis import maximum
from ctlabs.analysis.maximum import Box
from ctlabs.analysis.score import Score, gathered
from ctlabs.filtering import contradictions
from ctlabs.filtering.filter import density, kalman_filter
from ctlabs.filtering.measured import any_perfect, begins
from ctlabs.filtering.problem import FilterProblem, pose
from ctlabs.filtering.results import Contradiction
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel
from ctlabs.text import _, fill, number

Build = Callable[[dict[str, float]], DiscreteModel]

#: The part of a constant by which it is moved to see whether another value is possible.
ASIDE = 1e-6


class Piece(NamedTuple):
    """One record: ``build``, from constants to its model; its data ``z`` (rows, m); ``first``, as for :func:`ctlabs.fit`."""

    build: Build
    z: Array
    first: int | None

    def problem(self, names: tuple[str, ...], values: Array) -> FilterProblem:
        """Model and data at the values of the constants."""
        return pose(self.build(named(names, values)), self.z, first=self.first)

    @property
    def size(self) -> Array:
        """The size of each measurement, (m,): their innovations are added up in these units."""
        with np.errstate(all="ignore"):
            size = np.sqrt(np.nanmean(np.where(np.isnan(self.z).all(axis=0), 0.0, self.z) ** 2, axis=0))
        return np.where(size > 0, size, 1.0)


def pieces(build: Build | Sequence[Build], z: ArrayLike | Sequence[ArrayLike], first: Any = None) -> tuple[Piece, ...]:
    """The records of a fit: one, or as many as there are builds."""
    if callable(build):
        return (Piece(build, _rows(z), first),)
    builds, records = list(build), list(z)  # type: ignore[arg-type]
    if not builds or len(builds) != len(records):
        msg = f"z: expected {len(builds)} records, one for each build, received {len(records)}"
        raise ValueError(msg)
    firsts = list(first) if isinstance(first, Sequence) else [first] * len(builds)
    return tuple(Piece(own, _rows(each), start) for own, each, start in zip(builds, records, firsts, strict=True))


def _rows(z: Any) -> Array:
    data = np.array(z, dtype=np.float64)
    data = data[:, None].copy() if data.ndim == 1 else data
    data.setflags(write=False)
    return data


class Likelihood:
    """ℓ as a function of the constants' values, of one record or the sum over several; −∞ where they make no model.

    Every value is computed once; the best of them is kept. ``watch``, called after each with this object.
    """

    def __init__(
        self, records: tuple[Piece, ...], names: tuple[str, ...], box: Box, watch: Callable[[Likelihood], object] | None = None
    ) -> None:
        self.records, self.names, self.box, self.watch = records, names, box, watch
        self.known: dict[bytes, float] = {}
        self.slopes: dict[bytes, Array | None] = {}
        self.used = [0] * len(records)  # elements that enter the filter at the start
        self.best, self.top = box.start, -math.inf
        self.inexact = False  # whether a slope had to be taken from differences of ℓ
        self._scores = [Score(partial(piece.problem, names), box) for piece in records]

    @property
    def evaluations(self) -> int:
        """At how many values something was computed."""
        return len(self.known)

    def __call__(self, values: Array) -> float:
        """ℓ of the values, (p,)."""
        key = values.tobytes()
        if key not in self.known:
            try:
                self.known[key] = self._value(values)
            except (ValueError, ArithmeticError):
                self.known[key] = -math.inf
            if self.known[key] > self.top:
                self.best, self.top = np.array(values), self.known[key]
            if self.watch is not None:
                self.watch(self)
        return self.known[key]

    def score(self, values: Array) -> Array | None:
        """∂ℓ by the constants, (p,), exact; ``None`` where ℓ has no such derivative."""
        key = values.tobytes()
        if key not in self.slopes:
            self(values)
            with np.errstate(all="ignore"):
                try:
                    found = [score(values) for score in self._scores]
                except (ValueError, ArithmeticError):
                    found = [None]
            parts = [each[1] for each in found if each is not None]
            whole = np.sum(parts, axis=0) if len(parts) == len(self.records) else None
            self.slopes[key] = whole if whole is not None and np.isfinite(whole).all() else None
            self.inexact |= self.slopes[key] is None
        return self.slopes[key]

    def matrices(self, values: Array) -> Array:
        """All the numbers of the models with these values."""
        problems = [piece.problem(self.names, values) for piece in self.records]
        return np.concatenate([part for each in problems for part in (gathered(each), np.nan_to_num(each.z).ravel())])

    def extra(self, values: Array) -> float:
        """What the measurements that determine something unknown contribute."""
        total = 0.0
        for piece in self.records:
            model = piece.build(named(self.names, values))
            if not np.isfinite(model.P0).all():
                found = kalman_filter(model, piece.z, first=piece.first)
                ordinary = float(found.log_likelihood)
                total += float(found.log_likelihood_diffuse) - ordinary if math.isfinite(ordinary) else 0.0
        return total

    def at_start(self, values: Array, *, possible: bool = False) -> None:
        """Refuse a record without measurements, and a start at which nothing can be computed (or ``possible``), with the reason."""
        given = ", ".join(f"{name} = {value:g}" for name, value in named(self.names, values).items())
        for i, piece in enumerate(self.records):
            excluded, why = False, "a log-likelihood that is not finite"
            try:
                model = piece.build(named(self.names, values))
                _fits(piece.z, model.m, "" if len(self.records) == 1 else f"[{i}]")
                value, self.used[i] = self._one(piece, values)
                if not math.isfinite(value):
                    excluded = bool(kalman_filter(model, piece.z, first=piece.first).contradictions)
            except KeyError as error:
                value, why = math.nan, f"no value for {error}"
            except (ValueError, ArithmeticError) as error:
                if str(error).startswith("z"):
                    raise
                value, why = math.nan, " ".join(str(error).split())
            if not (math.isfinite(value) or (excluded and not possible)):
                msg = f"start: expected constants at which the likelihood can be evaluated, received {given}: {why}"
                raise ValueError(msg)
        if not (any(self.used) or any(self._seen(values, piece) for piece in self.records)):
            msg = "no observations: expected a record with at least one element measured, received one without"
            raise ValueError(msg)

    def _seen(self, values: Array, piece: Piece) -> bool:
        """Whether something is measured, though known already."""
        model = piece.build(named(self.names, values))
        found = kalman_filter(model, piece.z, first=piece.first)
        return bool(contradictions.known(model, found.z, found.used, begins(model, piece.first)).any())

    def contradictions(self, values: Array) -> tuple[Contradiction, ...]:
        """Those of the records filtered with these values."""
        found = [kalman_filter(piece.build(named(self.names, values)), piece.z, first=piece.first) for piece in self.records]
        return tuple(each for own in found for each in own.contradictions)

    def residuals(self, values: Array) -> Array:
        """The innovations of what is known already, in units of their measurements; of what is not, 0."""
        parts = []
        for piece in self.records:
            model = piece.build(named(self.names, values))
            with np.errstate(all="ignore"):
                found = kalman_filter(model, piece.z, first=piece.first)
                e, _allowed = contradictions.innovations(model, found.z[:, :, None], found, begins(model, piece.first))
            parts.append(np.nan_to_num(e[:, :, 0] / piece.size).ravel())
        return np.concatenate(parts)

    def determined(self, values: Array, box: Box) -> NDArray[np.bool_]:
        """Which constants have no other value beside this one that the record does not contradict."""
        model = (piece.build(named(self.names, values)) for piece in self.records)
        if not any(any_perfect(each.R) for each in model):
            return np.zeros(len(values), dtype=bool)  # noises of their own contradict nothing
        return np.array([self._single(values, box, i) for i in range(len(values))])

    def _single(self, values: Array, box: Box, i: int) -> bool:
        """Whether both neighbours along axis i are impossible, and one is by a contradiction."""
        inside = [x for x in _beside(box, values) if x[i] != values[i]]
        if not np.isfinite(self(values)) or any(np.isfinite(self(x)) for x in inside):
            return False
        return any(self._contradicts(x) for x in inside)

    def _contradicts(self, values: Array) -> bool:
        try:
            return bool(self.contradictions(values))
        except (ValueError, ArithmeticError):
            return False

    def _value(self, values: Array) -> float:
        """The sum over the records.

        A filter passes over perfect measurements of what it knows: densities of fewer elements than at the start do not compare.
        """
        total = 0.0
        for piece, used in zip(self.records, self.used, strict=True):
            value, entered = self._one(piece, values)
            total += value if math.isfinite(value) and entered >= used else -math.inf
        return total

    def _one(self, piece: Piece, values: Array) -> tuple[float, int]:
        """ℓ of one record, and how many elements enter the filter."""
        with np.errstate(all="ignore"):  # far from the data anything may overflow; the result says so
            return density(piece.problem(self.names, values))


def _fits(z: Array, m: int, which: str) -> None:
    """Refuse data of a wrong shape."""
    if z.ndim != 2 or z.shape[1] != m or not len(z):
        either = f"(rows, {m})" + (" or (rows,)" if m == 1 else "")
        msg = f"z{which}: expected shape {either}, as the model has {m} measurement{'' if m == 1 else 's'}, received {z.shape}"
        raise ValueError(msg)


def named(names: tuple[str, ...], values: Array) -> dict[str, float]:
    """Values by their names."""
    return {name: float(value) for name, value in zip(names, values, strict=True)}


def possible(likelihood: Likelihood, box: Box, starts: int) -> tuple[Array, str]:
    """The start, or where the sum of squares of its contradicting innovations is least; and what was done, in words."""
    if math.isfinite(likelihood(box.start)):
        return box.start, ""
    first = likelihood.contradictions(box.start)[0]

    def rank(x: Array) -> tuple[float, float]:
        return likelihood(x), -_squares(likelihood, x)

    others = maximum.others(lambda x: -_squares(likelihood, x), box, box.size, max(starts, 1))
    best = max([box.start, *_beside(box, box.start), *others], key=rank)
    for x in [box.start, *others]:
        if math.isfinite(likelihood(best)):
            break
        best = max((best, _lowered(likelihood, box, x)), key=rank)
    if rank(best) <= (-math.inf, (ASIDE - 1) * _squares(likelihood, box.start)):  # lower by its rounding alone
        best = box.start
    said = fill(
        _(
            "At the start the record is impossible (row {row} of z, element {element}: {innovation} away from what is known "
            "exactly, of which rounding explains {allowed}), and its log-likelihood is −∞. The sum of squares of such "
            "innovations, in units of their measurements, was lowered from {before} to {after}"
        ),
        row=first.row, element=first.element, innovation=number(first.innovation), allowed=number(first.allowed, 2),
        before=number(_squares(likelihood, box.start), 3), after=number(_squares(likelihood, best), 3),
    )  # fmt: skip
    if math.isfinite(likelihood(best)):
        return best, said + _(", where the record is possible; the likelihood was searched from there.")
    return best, said + _(
        ", where the record is still impossible: no constants were found with which the model allows it. A measurement "
        "without noise has to agree in all its digits; where it does not, give it a variance."
    )


def _beside(box: Box, x: Array) -> list[Array]:
    """The points a little to either side along each axis, inside the box."""
    steps = [side * step for step in ASIDE * box.size * np.eye(len(x)) for side in (-1, 1)]
    return [x + step for step in steps if (box.lower <= x + step).all() and (x + step <= box.upper).all()]


def _squares(likelihood: Likelihood, values: Array) -> float:
    """The sum of squares of the contradicting innovations; ∞ where there is no model."""
    try:
        e = likelihood.residuals(values)
    except (ValueError, ArithmeticError):
        return math.inf
    return float(e @ e)


def _lowered(likelihood: Likelihood, box: Box, start: Array) -> Array:
    """The least sum of squares from a start on (Gauss & Newton, within the box)."""
    from scipy.optimize import least_squares

    if not math.isfinite(_squares(likelihood, start)):
        return start
    size = likelihood.residuals(start).size

    def residuals(x: Array) -> Array:
        try:
            return likelihood.residuals(x)
        except (ValueError, ArithmeticError):  # no model there: as bad as nothing else
            return np.full(size, 1e6)

    bounds, digits = (box.lower, box.upper), float(np.finfo(float).eps)
    with np.errstate(all="ignore"):  # where a noise appears the innovations vanish at once: no slope is right there
        found = least_squares(
            residuals, start, "3-point", bounds, xtol=digits, ftol=None, gtol=None, x_scale=box.size, max_nfev=100 * len(start)
        )
    return np.clip(found.x, *bounds)


def separate(likelihood: Likelihood, box: Box) -> bool:
    """Whether the contradictions tell all constants apart, and not only combinations of them."""
    steps = ASIDE * box.size * np.eye(len(box.start))
    J = np.array([likelihood.residuals(box.start + step) for step in steps])
    J /= np.linalg.norm(J, axis=1, keepdims=True)
    return bool(np.linalg.svd(J, compute_uv=False)[-1] > ASIDE)
