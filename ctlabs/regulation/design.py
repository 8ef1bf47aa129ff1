r"""The linear quadratic Gaussian regulator: an optimal estimate in the optimal feedback.

.. math:: u_k = -L\hat x_k - L_w\hat w_k

By the separation theorem the two are designed apart: L as if the state were known, x̂ as if the input had no aim.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from ctlabs.linalg import checks, riccati
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import symmetric
from ctlabs.models import at
from ctlabs.models.cost import Cost, Weights
from ctlabs.models.interop import state_space
from ctlabs.models.linear import ContinuousModel, DiscreteModel
from ctlabs.regulation import costs, export
from ctlabs.regulation.augmented import weighed
from ctlabs.regulation.closed import ClosedLoop, Signals, closed
from ctlabs.regulation.controller import Controller, Machine
from ctlabs.regulation.costs import LoopCost
from ctlabs.regulation.estimator import Estimator
from ctlabs.regulation.feedback import Feedback
from ctlabs.regulation.sampling import SampledProblem, sample
from ctlabs.regulation.targets import Target

if TYPE_CHECKING:
    import control

KINDS = ("current", "delayed")


class Sampling(NamedTuple):
    """How a continuous plant is sampled; the model and the cost that were given."""

    model: ContinuousModel
    cost: Cost
    dt: float
    R: ArrayLike | None
    average: bool
    delay: float

    def sampled(self, model: ContinuousModel, cost: Cost) -> SampledProblem:
        """Another model and cost, sampled in the same way."""
        return sample(model, cost, self.dt, R=self.R, average=self.average, delay=self.delay)


@dataclass(eq=False)
class Regulator:
    r"""An LQG regulator in discrete time: gains, closed loop, cost, and the machine itself.

    ``plant``, the discrete model that it was designed for (that of a continuous one, sampled) · ``design``, the same with the integrals
    that the controller keeps · ``weights`` of (x, q), u, about the target where there is one · ``kind``, ``"current"`` (the input answers
    the measurement of its own instant) or ``"delayed"`` (that before) · ``L`` (r, n+q) or (steps, r, n+q), on the estimate and the
    integrals · ``L_w``, on the estimated disturbance · ``K`` (n, m) or (steps+1, n, m), the filter's gain · ``feedback``,
    ``estimator``, the two halves · ``machine``, the controller's matrices · ``closed``, the loop with ``plant`` · ``poles`` of that loop ·
    ``sampling``, of a continuous plant
    """

    plant: DiscreteModel
    design: DiscreteModel
    weights: Weights
    feedback: Feedback
    estimator: Estimator
    kind: str
    machine: Machine
    cost: LoopCost
    between: float
    loads: tuple[int, ...] = ()
    target: Target | None = None
    sampling: Sampling | None = None

    @cached_property
    def closed(self) -> ClosedLoop:
        """The loop with ``plant``."""
        return closed(self.plant, self.machine)

    @property
    def L(self) -> Array:
        """The gain on the estimate and the integrals: u = −L x̂."""
        return self.feedback.L

    @property
    def L_w(self) -> Array:
        """The gain on the estimated disturbance, at work where the noises correlate."""
        return self.feedback.L_w

    @property
    def K(self) -> Array:
        """The filter's gain."""
        return self.estimator.K[..., : self.plant.n, :]

    @property
    def steps(self) -> int | None:
        """The horizon; ``None``: for ever."""
        return None if self.feedback.L.ndim == 2 else len(self.feedback.L)

    @property
    def poles(self) -> Array:
        """Of the closed loop: those of the feedback and those of the filter, ascending; empty over a finite horizon."""
        return np.sort_complex(np.concatenate([self.feedback.poles, self.estimator.poles]))

    @property
    def unit(self) -> float:
        """What a cost per step is multiplied by to be in the unit of ``cost``: 1/dt of a sampled plant, whose cost is per second."""
        return 1.0 if self.sampling is None or self.steps is not None else 1 / self.plant.dt

    def loop(self, truth: ContinuousModel | DiscreteModel | None = None, set_point: ArrayLike | None = None) -> ClosedLoop:
        """The loop with another truth (of the same measurements and inputs), or about a set point.

        Parameters
        ----------
        truth : discrete, or continuous where the design's plant was: it is sampled with the period, the delay and the R that were given for
            the design (to give it others, sample it: :func:`ctlabs.regulation.sample`). The design's own by default
        set_point : (p,), constant values of the tracked outputs
        """
        point = None if set_point is None else np.atleast_1d(np.asarray(set_point, dtype=np.float64))
        return closed(self._sampled(truth), self.machine, point)

    def actual_cost(self, truth: ContinuousModel | DiscreteModel | None = None) -> float:
        """What this regulator costs where the plant is ``truth``, in the unit of ``cost``.

        Raises
        ------
        ValueError
            The loop is not stable: the mode is named; a truth of another order beside weights of states.
        """
        model, weights, between = self.at_samples(truth)
        loop = closed(model, self.machine)
        return self.unit * loop_cost(loop, weights, self.design.n - self.plant.n, self.steps, between)

    def at_samples(self, truth: ContinuousModel | DiscreteModel | None) -> tuple[DiscreteModel, Weights, float]:
        """A truth at the samples, with the weights there and what noise adds between them."""
        given = self.sampling
        if given is None or not isinstance(truth, ContinuousModel):
            model = self._sampled(truth)
            if model.n != self.plant.n:
                msg = f"truth: expected {self.plant.n} states, which the cost weighs, received {model.n}"
                raise ValueError(msg)
            return model, self.weights, self.between
        model, cost = given.sampled(truth, given.cost)
        q = self.design.n - self.plant.n
        of_q = np.diag(self.weights.Qx)[self.plant.n :] if self.weights.Qx.ndim == 2 else np.zeros(q)
        return model, with_integral_weights(cost.weights(model), of_q), cost.constant

    def _sampled(self, truth: ContinuousModel | DiscreteModel | None) -> DiscreteModel:
        """A truth at the samples."""
        if truth is None:
            return self.plant
        if isinstance(truth, DiscreteModel):
            return truth
        checks.instance("truth", truth, ContinuousModel)
        if self.sampling is None:
            msg = "truth: expected a discrete model as the design's, received a continuous one"
            raise ValueError(msg)
        assert isinstance(truth, ContinuousModel)
        return self.sampling.sampled(truth, Cost(np.zeros((truth.n, truth.n)), np.zeros((truth.r, truth.r)))).model

    @cached_property
    def _controller(self) -> Controller:
        return Controller(self.machine)

    def controller(self) -> Controller:
        """A controller of its own, at t0."""
        return Controller(self.machine)

    def step(self, z: ArrayLike | None, set_point: ArrayLike | None = None) -> Array:
        """The input that answers a measurement; see :meth:`ctlabs.regulation.controller.Controller.step`."""
        return self._controller.step(z, set_point)

    def restart(self) -> None:
        """Forget what :meth:`step` has seen."""
        self._controller.restart()

    def save(self, path: str | Path) -> Path:
        """What :meth:`step` has come to, in a file that :meth:`Controller.load` continues to the bit."""
        return self._controller.save(path)

    @cached_property
    def compensator(self) -> control.StateSpace:
        """From z to −u, as python-control's negative feedback has it: ``control.feedback(plant, compensator)`` is the loop.

        Raises
        ------
        ValueError
            Scheduled gains.
        """
        if self.steps is not None:
            msg = "compensator: expected constant gains, received some scheduled over a horizon"
            raise ValueError(msg)
        M = self.machine
        return state_space(M.A, M.B, -M.C, -M.D, M.dt)

    def export(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """The controller for NumPy (.npz), MATLAB (.mat) or C (.h): :func:`ctlabs.regulation.export.write`."""
        return export.write(self.machine, Path(path), overwrite=overwrite)


def loop_cost(
    loop: ClosedLoop, weights: Weights, q: int, steps: int | None, between: float, about: Array | None = None
) -> float:
    """The cost of a loop from its covariances: per step in the limit (``about`` a state and input of rest), the whole over a horizon."""
    n, size, _, r = loop.sizes
    pick = scipy.linalg.block_diag(picked(n, size, q), np.eye(r))
    if steps is None:
        joint = loop.steady().joint
        if about is not None:
            joint = joint._replace(mean=joint.mean - pick.T @ about)
        return costs.weighed_square(pick.T @ weights.joint @ pick, joint) + between
    found = loop.covariances(steps)
    joint, total, weight = found.joint, between * steps, weights.joint
    for k in range(steps):
        own = pick.T @ at(weight, k, 2) @ pick
        total += costs.weighed_square(own, Signals(joint.mean[k], joint.P[k]))
    last = np.zeros((n + q + r,) * 2)
    last[: n + q, : n + q] = weights.Qf
    return total + costs.weighed_square(pick.T @ last @ pick, Signals(joint.mean[steps], joint.P[steps]))


def picked(n: int, size: int, q: int) -> Array:
    """What of (x, ξ) is weighed: x, and the integrals, the last q elements of ξ; (n+q, n+size)."""
    return np.vstack([np.eye(n, n + size), np.eye(q, n + size, n + size - q)])


def with_integral_weights(weights: Weights, own: Array) -> Weights:
    """Weights of a plant with those of the integrals."""
    q = len(own)
    if not q:
        return weights
    zero = np.zeros((*weights.N.shape[:-2], q, weights.N.shape[-1]))
    N = np.concatenate([weights.N, zero], axis=-2)
    return Weights(weighed(weights.Qx, q, own), weights.Qu, N, weighed(weights.Qf, q))


def about_loads(
    n: int, size: int, places: Sequence[int], target: Target | None, follows: Array | None = None
) -> tuple[Array, list[int]]:
    """(x − Xd, d, ξ − Tx) of (x, ξ), and which of them come to rest: all but the loads d. Without loads (x, ξ) itself.

    ``follows``, T (size, n): what of x ξ estimates; all of it by default
    """
    to = np.eye(n + size)
    if target is None:
        return to, list(range(n + size))
    rest = [i for i in range(n) if i not in places]
    to[np.ix_(rest, list(places))] = -target.X
    to[n:, :n] = -np.eye(size, n) if follows is None else -follows
    return to, [i for i in range(n + size) if i not in places]


def steady_cost_about(loop: ClosedLoop, weights: Weights, places: list[int], target: Target) -> float:
    """The cost of a loop with loads: of what differs from the motions that they ask for, which alone comes to rest.

    In the coordinates (x − Xd, d, ξ − x, z − its motion) nothing of d reaches the others, and d is left out.
    """
    n, q, m, r = loop.sizes
    rest = [i for i in range(n) if i not in places]
    to = scipy.linalg.block_diag(about_loads(n, q, places, target)[0], np.eye(m))
    H = loop.truth.H
    to[n + q :, places] = -(H[:, rest] @ target.X + H[:, places])
    back = np.linalg.inv(to)
    kept = [i for i in range(n + q + m) if i not in places]
    moves = (to @ loop.model.Phi @ back)[np.ix_(kept, kept)]
    noise = symmetric(to @ loop.model.Qd @ to.T)[np.ix_(kept, kept)]
    P = riccati.stationary(moves, noise, continuous=False).P.high
    M = loop.machine
    seen = np.vstack([np.eye(n, n + q + m), np.hstack([np.zeros((r, n)), M.C, M.D])]) @ back  # (x, u) of the new coordinates
    rows = seen[:, kept]
    return float((weights.joint * (rows @ P @ rows.T)).sum())
