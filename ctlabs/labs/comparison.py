"""What labs compare with what: continuous time with its sampling, a reduced filter with the whole one, white noise with coloured.

Each verb computes both sides, puts the checks into the report's present section, and returns what the lab writes about.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.analysis import sensitivity
from ctlabs.filtering import reduced, steady
from ctlabs.filtering.results import Covariances, Filtered
from ctlabs.labs.experiment import covariances
from ctlabs.labs.portrait import agreement
from ctlabs.models.discretisation import discretise
from ctlabs.reporting.report import EXACT

if TYPE_CHECKING:
    from ctlabs.labs.experiment import Experiment
    from ctlabs.models import ContinuousModel, DiscreteModel
    from ctlabs.montecarlo import Statistics
    from ctlabs.reporting.report import Report

#: Periods δ in the time constant of a filter, and how many of them are simulated at most.
FINE, LONGEST = 100, 4000


@dataclass(frozen=True, slots=True)
class Fine:
    """A ``model`` with a period δ in place of continuous time: ``ratio`` of them in a period dt, ``steps`` in all."""

    model: DiscreteModel
    steps: int
    ratio: int

    def one_path(self, experiment: Experiment, sampled: DiscreteModel) -> dict[str, Filtered]:
        """One path of the state that both filters see: "continuous", and "sampled" with a measurement at every ratio-th instant."""
        measured = np.arange(self.steps + 1) % self.ratio == 0
        R = np.where(measured[:, None, None], sampled.R, np.where(np.eye(sampled.m, dtype=bool), np.inf, 0.0))
        models = {"continuous": self.model}
        if self.ratio <= self.steps:
            models["sampled"] = replace(self.model, R=R)
        return {name: experiment.histories(model, steps=self.steps, runs=1) for name, model in models.items()}


def fine(system: ContinuousModel, dt: float, steps: int, scale: float) -> Fine:
    """A continuous model sampled so finely that it stands for continuous time beside ``steps`` periods ``dt``.

    δ is a hundredth of ``scale``, the time constant of the filter, or ``dt`` if that is shorter; a whole number of them in ``dt``.

    >>> from ctlabs import ContinuousModel
    >>> found = fine(ContinuousModel(F=[[0]], G=[[1]], Q=[[4]], H=[[1]], Rc=[[16]], P0=[[25]]), 1.0, 20, 2.0)
    >>> found.ratio, found.steps, found.model.dt
    (50, 1000, 0.02)
    """
    ratio = max(1, math.ceil(FINE * dt / scale))
    return Fine(discretise(system, dt / ratio), min(ratio * steps, LONGEST), ratio)


def same_as_whole(
    report: Report, small: reduced.ReducedDiscrete, whole: DiscreteModel, steps: int, variance: ArrayLike
) -> Covariances:
    """A filter reduced to one state of two against the whole one, and against the ``variance`` (steps+1,) by hand.

    Returns the whole filter's covariances.
    """
    P, K = reduced.covariances(small, steps)
    full = covariances(whole, steps, first=0)
    routes, scale = ("reduced filter", "two-state filter"), float(full.P_minus.max())
    report.check("P⁺ of the reduced filter", P, full.P_plus, routes, EXACT, scale=scale)
    # The gains add up to one where z is the sum of the states: a small one is a difference of larger numbers.
    report.check("gains of the reduced filter", K, full.K, routes, scale=float(np.abs(full.K).max()))
    star = small.basis.T @ full.P_plus @ small.basis.T.T
    expected = np.zeros_like(star)
    expected[:, 1, 1] = variance
    by_hand = ("two-state filter, transformed", "power of the fraction's matrix")
    report.check("P* = diag(0, p)", star, expected, by_hand, EXACT, scale=scale)
    return full


def same_estimates(
    report: Report, experiment: Experiment, small: reduced.ReducedDiscrete, whole: DiscreteModel, steps: int
) -> Filtered:
    """A reduced filter and the whole one on the same 25 records; returns those of the whole one."""
    some = experiment.histories(whole, steps=steps, first=0)
    again, scale = reduced.estimates(small, some.z), float(np.abs(some.x_plus).max())
    routes = ("reduced filter", "two-state filter")
    report.check("estimates of 25 runs", again.x_plus, some.x_plus, routes, EXACT, scale=scale)
    return some


@dataclass(frozen=True, slots=True)
class TakenForWhite:
    """What a filter that takes coloured noise for white claims and has: steadily, in time, and in an ensemble."""

    gain: float
    claimed: float
    true: float
    actual: sensitivity.Actual
    statistics: Statistics


def taken_for_white(
    report: Report,
    experiment: Experiment,
    truth: DiscreteModel,
    design: DiscreteModel,
    steps: int,
    *,
    by_hand: Callable[[float], float],
    best: float,
    size: float,
) -> TakenForWhite:
    """A one-state ``design`` for white noise on data of a ``truth`` whose first state it estimates.

    ``by_hand`` : its true steady variance as a function of its gain · ``best`` : the optimal one · ``size`` : of the variances
    """
    C = np.eye(1, truth.n)
    claimed, found = steady.solve(design), sensitivity.steady(truth, design, compare=C)
    gain, true = float(claimed.K[0, 0]), float(found.P_plus[0, 0])
    name = "true variance of the filter for white noise"
    report.check(name, true, by_hand(gain), ("sensitivity analysis", "by hand"))
    routes = ("sensitivity analysis", "root of the quadratic")
    report.holds("the filter for white noise is not better", true - best, routes, size=size)
    stats = experiment.statistics(truth, design, steps=steps, compare=C, first=0)
    actual = sensitivity.actual(truth, design, steps, compare=C, first=0)
    agreement(report, "filter for white noise", stats, actual.P_plus, consistent=False)
    return TakenForWhite(gain, float(claimed.P_plus[0, 0]), true, actual, stats)
