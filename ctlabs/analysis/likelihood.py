r"""The likelihood as a function of a model's constants, and a start at which a record is possible.

Where perfect measurements contradict the constants (:mod:`ctlabs.filtering.contradictions`), ℓ = −∞ has no slope: the sum of squares of
the contradicting innovations is lowered first, until none is left. Constants of which then no other value is possible are
determined exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ctlabs.analysis import maximum
from ctlabs.analysis.maximum import Box
from ctlabs.filtering import contradictions
from ctlabs.filtering.filter import kalman_filter, log_likelihood
from ctlabs.filtering.measured import begins
from ctlabs.filtering.results import Filtered
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel
from ctlabs.text import _, fill, number

Build = Callable[[dict[str, float]], DiscreteModel]

#: The part of a constant by which it is moved to see whether another value is possible.
ASIDE = 1e-6


class Likelihood:
    """ℓ as a function of the constants' values, −∞ where they make no model; every value is computed once."""

    def __init__(self, build: Build, z: ArrayLike, names: tuple[str, ...], first: int | None) -> None:
        self.build, self.z, self.names, self.first = build, np.array(z, dtype=np.float64), names, first
        self.z = self.z[:, None] if self.z.ndim == 1 else self.z
        self.known: dict[bytes, float] = {}
        self.used = 0  # elements that enter the filter at the start
        size = np.sqrt(np.nanmean(np.where(np.isnan(self.z).all(axis=0), 0.0, self.z) ** 2, axis=0)) if self.z.size else 1.0
        self.size = np.where(size > 0, size, 1.0)  # of each measurement: their innovations are added up in these units

    @property
    def evaluations(self) -> int:
        """How many values were computed."""
        return len(self.known)

    def __call__(self, values: Array) -> float:
        """ℓ of the values, (p,)."""
        key = values.tobytes()
        if key not in self.known:
            try:
                self.known[key] = self._value(values)
            except (ValueError, ArithmeticError):
                self.known[key] = -math.inf
        return self.known[key]

    def extra(self, values: Array) -> float:
        """What the measurements that determine something unknown contribute."""
        model = self.build(named(self.names, values))
        if np.isfinite(model.P0).all():
            return 0.0
        found = kalman_filter(model, self.z, first=self.first)
        ordinary, diffuse = float(found.log_likelihood), float(found.log_likelihood_diffuse)
        return diffuse - ordinary if math.isfinite(ordinary) else 0.0

    def at_start(self, values: Array, *, possible: bool = False) -> None:
        """Refuse a record without measurements, and a start at which nothing can be computed (or ``possible``), with the reason."""
        given = ", ".join(f"{name} = {value:g}" for name, value in named(self.names, values).items())
        excluded = False
        try:
            found = self.filtered(values)
            excluded, self.used = bool(found.contradictions), int(found.used.sum())
            value, why = self._value(values), "a log-likelihood that is not finite"
        except KeyError as error:
            value, why = math.nan, f"no value for {error}"
        except (ValueError, ArithmeticError) as error:
            value, why = math.nan, " ".join(str(error).split())
        if not (math.isfinite(value) or (excluded and not possible)):
            msg = f"start: expected constants at which the likelihood can be evaluated, received {given}: {why}"
            raise ValueError(msg)
        if not (self.used or self._seen(values, found)):
            msg = "no observations: expected a record with at least one element measured, received one without"
            raise ValueError(msg)

    def _seen(self, values: Array, found: Filtered) -> bool:
        """Whether something is measured, though known already."""
        model = self.build(named(self.names, values))
        return bool(contradictions.known(model, found.z, found.used, begins(model, self.first)).any())

    def filtered(self, values: Array) -> Filtered:
        """The record filtered with these values."""
        return kalman_filter(self.build(named(self.names, values)), self.z, first=self.first)

    def residuals(self, values: Array) -> Array:
        """The innovations of what is known already, in units of their measurements; of what is not, 0."""
        model = self.build(named(self.names, values))
        with np.errstate(all="ignore"):
            found = kalman_filter(model, self.z, first=self.first)
            e, _allowed = contradictions.innovations(model, found.z[:, :, None], found, begins(model, self.first))
        return np.asarray(np.nan_to_num(e[:, :, 0] / self.size)).ravel()

    def determined(self, values: Array, box: Box) -> NDArray[np.bool_]:
        """Which constants have no other value beside this one that the record does not contradict."""
        return np.array([self._single(values, box, i) for i in range(len(values))])

    def _single(self, values: Array, box: Box, i: int) -> bool:
        """Whether both neighbours along axis i are impossible, and one is by a contradiction."""
        inside = [x for x in _beside(box, values) if x[i] != values[i]]
        if not np.isfinite(self(values)) or any(np.isfinite(self(x)) for x in inside):
            return False
        return any(self._contradicts(x) for x in inside)

    def _contradicts(self, values: Array) -> bool:
        try:
            return bool(self.filtered(values).contradictions)
        except (ValueError, ArithmeticError):
            return False

    def _value(self, values: Array) -> float:
        model = self.build(named(self.names, values))
        with np.errstate(all="ignore"):  # far from the data anything may overflow; the result says so
            if np.diagonal(model.R, axis1=-2, axis2=-1).all():
                value = log_likelihood(model, self.z, self.first)
            else:  # the filter passes over perfect measurements of what it knows: densities of fewer elements do not compare
                found = kalman_filter(model, self.z, first=self.first)
                value = float(found.log_likelihood_diffuse) if found.used.sum() >= self.used else -math.inf
        return value if math.isfinite(value) else -math.inf


def named(names: tuple[str, ...], values: Array) -> dict[str, float]:
    """Values by their names."""
    return {name: float(value) for name, value in zip(names, values, strict=True)}


def possible(likelihood: Likelihood, box: Box, starts: int) -> tuple[Array, str]:
    """The start, or where the sum of squares of its contradicting innovations is least; and what was done, in words."""
    if math.isfinite(likelihood(box.start)):
        return box.start, ""
    first = likelihood.filtered(box.start).contradictions[0]

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
