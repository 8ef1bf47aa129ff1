r"""The score: the derivatives of a record's log-likelihood by the constants of a model.

.. math:: \frac{\partial\ell}{\partial\theta_i} = \sum_M\left\langle\frac{\partial\ell}{\partial M},
          \frac{\partial M}{\partial\theta_i}\right\rangle

The first factors are exact (:mod:`ctlabs.filtering.slopes`). The second are derivatives of smooth expressions, of which no record and no
sum of many terms enters: differences of fourth order, whose step follows from the matrices themselves, have ten digits and more.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ctlabs.analysis.surface import Box, moved
from ctlabs.filtering.problem import FilterProblem
from ctlabs.filtering.slopes import MATRICES, Slopes, beginning, slopes
from ctlabs.linalg.checks import Array

Posed = Callable[[Array], FilterProblem]

#: The first step of a difference, as a part of the constant.
STEP = 1e-3
#: Differences of second order at steps h and 2h agree so far that those of fourth order have ten digits.
SMOOTH = 1e-5
#: What rounding may leave of a derivative before a longer step is tried.
ROUGH = 1e-10
#: Matrices that are so nearly quadratic in a constant are taken from two neighbours for so many scores.
QUADRATIC, TRUSTED = 1e-10, 10
#: Weights of the derivative at steps of h; the second row is of an order less, to compare with.
CENTRAL = (np.array([-2, -1, 1, 2]), np.array([[1, -8, 8, -1], [0, -6, 6, 0]]) / 12)
PAIR = (np.array([-1, 1]), np.array([[-1, 1], [-1, 1]]) / 2)
FORWARD = (np.array([0, 1, 2, 3, 4]), np.array([[-25, 48, -36, 16, -3], [-18, 24, -6, 0, 0]]) / 12)


class Score:
    """∂ℓ/∂θ of one record at the values of the constants; steps are kept from one call to the next.

    ``posed``, from values (p,) to the problem, of the same record always; may raise ValueError where they make no model ·
    ``box``, of the values
    """

    def __init__(self, posed: Posed, box: Box) -> None:
        self.posed, self.box = posed, box
        self.part = np.full(len(box.start), STEP)  # of the size, each constant's step
        self.trust = np.zeros(len(box.start), dtype=int)  # for how many scores two neighbours do
        self.size = np.where(box.log, 0.0, np.where(box.start != 0, np.abs(box.start), box.size))

    def __call__(self, values: Array) -> tuple[float, Array] | None:
        """ℓ and its derivatives (p,); ``None`` where it has none, or a model has no neighbours."""
        posed = self.posed(values)
        own = slopes(posed)
        if own is None:
            return None
        self.size = np.maximum(np.abs(values), np.where(self.box.log, 0.0, 1e-2 * self.size))
        weights = _along(own)
        found = [self._derivative(values, i, posed, own, weights) for i in range(len(values))]
        if any(each is None for each in found):
            return None
        return float(own.found.log_likelihood_diffuse[0]), np.array(found, dtype=np.float64)

    def _derivative(self, values: Array, i: int, posed: FilterProblem, own: Slopes, weights: Array) -> float | None:
        """∂ℓ/∂θ_i, at the first step at which neither curvature nor rounding counts."""
        best, lowest, size = None, np.inf, self.size[i] or self.box.size[i]
        for _again in range(24):
            stencil = self._stencil(values, i, self.part[i] * size, posed, own)
            if stencil is None:
                self.part[i] /= 8
                continue
            change, other, level = stencil
            own_weights = weights[: len(change)]  # data that no constant moves are left out
            total = _sum(np.abs(own_weights), np.abs(change))
            if total == 0:  # no matrix that the likelihood knows depends on it, or the step is below their last digits
                if self.part[i] >= STEP:
                    return 0.0
                self.part[i] *= 64
                continue
            curved = _sum(np.abs(own_weights), np.abs(change - other)) / total
            rounded = _sum(np.abs(own_weights), level) / total
            error = curved**2 + rounded
            if error < lowest:
                best, lowest = _sum(own_weights, change), error
            if curved > max(SMOOTH, 20 * rounded):
                self.part[i] /= 8
            elif rounded > ROUGH and curved < max(SMOOTH / 64, 20 * rounded) and self.part[i] < 1e12:
                self.part[i] *= 8
            else:
                if self.trust[i]:
                    self.trust[i] -= 1
                elif curved < max(QUADRATIC, 20 * rounded):
                    self.trust[i] = TRUSTED
                return _sum(own_weights, change)
        return best

    def _stencil(self, values: Array, i: int, h: float, posed: FilterProblem, own: Slopes) -> tuple[Array, Array, Array] | None:
        """The change of the matrices with θ_i by fourth and by second order, and its rounding; ``None`` where neighbours are missing."""
        low, high = self.box.lower[i], self.box.upper[i]
        for side, (places, rows) in ((1, PAIR if self.trust[i] else CENTRAL), (1, FORWARD), (-1, FORWARD)):
            points = values[i] + side * h * places
            if (points < low).any() or (points > high).any():
                continue
            try:
                near = [self.posed(moved(values, i, point)) for point in points]
                found = np.array([gathered(each, own.begun) for each in near])
            except (ValueError, ArithmeticError):
                continue
            if not np.isfinite(found).all():
                continue
            moving = any(each.known is not None for each in (posed, *near))  # of what is measured, only what is known of it moves
            if moving and not all(np.array_equal(each.z, posed.z, equal_nan=True) for each in near):
                found = np.hstack([found, [np.nan_to_num(each.z[:, :, 0]).ravel() for each in near]])
            step = (points[-1] - points[0]) / (side * (places[-1] - places[0]))  # as the points came out in doubles
            change, other = np.einsum("ij,jk->ik", side * rows / step, found - found[0])
            level = np.finfo(float).eps * np.abs(found).max(axis=0) * (found != found[0]).any(axis=0) / abs(step)
            return change, other, level
        return None


def _sum(a: Array, b: Array) -> float:
    """a·b, without the threads that a library starts for so little."""
    return float((a * b).sum())


def _along(own: Slopes) -> Array:
    """∂ℓ by everything that :func:`gathered` gathers, and by the data."""
    parts = [getattr(own, name) for name in MATRICES]
    return np.concatenate([part.ravel() for part in parts if part is not None] + ([np.ones(1)] if own.begun else []) + [own.z.ravel()])


def gathered(problem: FilterProblem, begun: int = 0) -> Array:
    """All matrices of a problem; after the ``begun`` instants of a vague start, what they leave in place of x0 and P0."""
    model, last = problem.model, []
    x0, P0 = model.x0, np.where(np.isfinite(model.P0), model.P0, 0.0)
    if begun:
        left = beginning(problem, begun)
        x0, P0, last = left.x, left.P, [np.array([left.log_likelihood])]
    matrices = [getattr(model, name) for name in MATRICES[:-2]] + [x0, P0]
    found = [np.where(np.isinf(part), 0.0, part).ravel() for part in matrices if part is not None]
    return np.concatenate([*found, *last])

