"""The standard experiment of a lab on closed loops: an ensemble of some signals, tested against their covariances and their cost.

A loop without random inputs of its own is a :class:`~ctlabs.models.DiscreteModel`; what it does is a Gaussian process whose covariances
are known, so that an ensemble's mean squares and its whole cost are compared with their exact distributions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ctlabs import montecarlo
from ctlabs.labs.portrait import tested
from ctlabs.montecarlo import chance
from ctlabs.text import Uncertain

if TYPE_CHECKING:
    from ctlabs.labs.experiment import Experiment
    from ctlabs.models import DiscreteModel
    from ctlabs.reporting.report import Report

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Ensemble:
    """Signals of many runs, and what theory says of them.

    ``t`` (steps+1,) s · ``y`` (steps+1, d, runs) · ``P`` (steps+1, d, d), their covariances · ``joint`` (steps+1, d, steps+1, d), those
    between all instants · ``weight`` (d, d), of their cost
    """

    t: Array
    y: Array
    P: Array
    joint: Array
    weight: Array

    @property
    def runs(self) -> int:
        """How many."""
        return self.y.shape[-1]

    @property
    def sd(self) -> Array:
        """Standard deviations in theory, (steps+1, d)."""
        return np.sqrt(np.diagonal(self.P, axis1=1, axis2=2).clip(0))

    @property
    def rms(self) -> Array:
        """Roots of the mean squares, (steps+1, d)."""
        return np.asarray(np.sqrt((self.y**2).mean(axis=-1)))

    def cost(self, begin: int = 0) -> Uncertain:
        """The mean cost per instant from ``begin`` on, with its standard error."""
        of_run = np.einsum("kir,ij,kjr->r", self.y[begin:], self.weight, self.y[begin:]) / len(self.y[begin:])
        return Uncertain(float(of_run.mean()), float(of_run.std(ddof=1)) / math.sqrt(self.runs))

    def expected(self, begin: int = 0) -> float:
        """That mean in theory."""
        return float(np.einsum("kij,ij->k", self.P[begin:], self.weight).mean())


def ensemble(
    experiment: Experiment, model: DiscreteModel, rows: ArrayLike, weight: ArrayLike, steps: int, stream: int = 0
) -> Ensemble:
    """Runs of a loop.

    ``rows`` (d, n) : signals y of the states x, whose mean at t0 is zero · ``weight`` (d, d) : of their cost, yᵀWy per instant
    """
    C, W = np.asarray(rows, dtype=np.float64), np.asarray(weight, dtype=np.float64)
    found = montecarlo.simulate(model, steps, experiment.runs, experiment.seed_of(stream))
    P, joint = in_time(model, C, steps)
    return Ensemble(found.t, np.einsum("di,kir->kdr", C, found.x), P, joint, W)


def in_time(model: DiscreteModel, rows: Array, steps: int) -> tuple[Array, Array]:
    """Covariances of signals, (steps+1, d, d), and those between all instants, (steps+1, d, steps+1, d).

    >>> from ctlabs import DiscreteModel
    >>> walk = DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[2]])
    >>> in_time(walk, np.eye(1), 2)[1][:, 0, :, 0]
    array([[2., 2., 2.],
           [2., 3., 3.],
           [2., 3., 4.]])
    """
    d = len(rows)
    joint = np.zeros((steps + 1, d, steps + 1, d))
    P, earlier = np.array(model.P0), np.zeros((0, model.n, d))
    for k in range(steps + 1):
        if k:
            earlier = model.Phi @ earlier
            P = model.Phi @ P @ model.Phi.T + model.Qd
            P = 0.5 * (P + P.T)
        earlier = np.concatenate([earlier, (P @ rows.T)[None]])
        joint[k, :, : k + 1] = np.swapaxes(rows @ earlier, 0, 1)
        joint[: k + 1, :, k] = np.swapaxes(rows @ earlier, 1, 2)
    return np.array([joint[k, :, k] for k in range(steps + 1)]), joint


def agreement(report: Report, name: str, found: Ensemble) -> float:
    """Exact tests: mean squares at every instant, and the whole cost of the runs; returns the largest deviation, in sigmas."""
    size, _, runs = found.y.shape
    values, vectors = np.linalg.eigh(found.weight)
    half = np.sqrt(values.clip(0))[:, None] * vectors.T
    counted = np.einsum("ij,kjr->kir", half, found.y).reshape(size * len(half), runs)
    spread = np.einsum("ai,kilj,bj->kalb", half, found.joint, half).reshape(len(counted), len(counted))
    return tested(report, name, {
        "mean squares of the signals": chance.mean_square(found.y, np.diagonal(found.P, axis1=1, axis2=2)),
        "cost of the whole time": chance.total_square(counted, spread),
    })  # fmt: skip
