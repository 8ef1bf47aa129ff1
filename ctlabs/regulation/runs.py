r"""Many runs of a closed loop, in the kernel of all Monte-Carlo experiments, against what the covariances say.

The loop is one linear model, so its runs are those of a truth whose "filter" estimates nothing: its errors are the signals (x, q, u)
themselves, and all exact tests of :mod:`ctlabs.montecarlo.chance` apply to them. The average cost has a variance that is known exactly: of
a Gaussian y with :math:`\mathrm{cov}(y_l, y_k) = X^{l-k}P_k`,

.. math:: \mathrm{var}\sum_k y_k^TWy_k = \sum_k\left[4\,\mathrm{tr}\,Z_kP_kWP_k - 2\,\mathrm{tr}\,WP_kWP_k\right] + \ldots, \qquad
          Z_k = W + X^TZ_{k+1}X

(the dots: what the means add, by the same adjoint).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ctlabs.filtering.results import Covariances
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import symmetric
from ctlabs.models import at
from ctlabs.models.linear import ContinuousModel, DiscreteModel
from ctlabs.montecarlo.runner import monte_carlo
from ctlabs.regulation.closed import ClosedLoop, Signals, followed
from ctlabs.regulation.design import Regulator, picked

if TYPE_CHECKING:
    from ctlabs.montecarlo.statistics import Statistics


@dataclass(frozen=True, slots=True, eq=False)
class LoopEnsemble:
    """What many runs of a loop say.

    ``statistics`` of Ey − y, y = (x, q, u): the state, the integrals, the input · ``theory``, mean and covariance of y from the loop's
    equations, (steps+1, d) and (steps+1, d, d) · ``names`` of y · ``cost``, the average over runs and instants, per second or step as
    the regulator's, over a horizon the whole · ``cost_sd``, its standard deviation by theory · ``cost_expected``
    """

    statistics: Statistics
    theory: Signals
    names: tuple[str, ...]
    cost: float
    cost_sd: float
    cost_expected: float

    @property
    def score(self) -> float:
        """How far the cost is from what is expected, in its standard deviations; without noise 0, or infinite if it is another."""
        off = self.cost - self.cost_expected
        if self.cost_sd:
            return off / self.cost_sd
        return 0.0 if abs(off) <= 1e-12 * abs(self.cost_expected) else float(np.copysign(np.inf, off))

    @property
    def rms(self) -> Array:
        """Root mean squares of (x, q, u), (steps+1, d)."""
        return np.sqrt(np.diagonal(_second(self.statistics, self.theory), axis1=1, axis2=2))


def ensemble(
    regulator: Regulator,
    *,
    runs: int,
    seed: int,
    steps: int | None = None,
    truth: ContinuousModel | DiscreteModel | None = None,
    **options: Any,
) -> LoopEnsemble:
    """Run a closed loop many times.

    Parameters
    ----------
    regulator : of a discrete or sampled plant
    runs, seed : how many runs, a whole number
    steps : how many; the horizon by default where there is one
    truth : the plant, by default that of the design
    options : executor, workers, checkpoint, progress, histogram as for :func:`ctlabs.monte_carlo`

    Raises
    ------
    ValueError
        No steps where there is no horizon; what :func:`ctlabs.monte_carlo` refuses.
    FloatingPointError
        An unstable loop overflows.

    >>> from ctlabs import Cost, regulator
    >>> plant = DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[1]], B=[[1]])
    >>> found = ensemble(regulator(plant, Cost([[1]], [[1]])), runs=400, steps=50, seed=1)
    >>> abs(found.score) < 4
    True
    """
    checks.instance("regulator", regulator, Regulator)
    if steps is None and regulator.steps is None:
        msg = "steps: expected how many (the regulator works for ever), received none"
        raise ValueError(msg)
    count = checks.count("steps", regulator.steps if steps is None else steps)
    _, weights, between = regulator.at_samples(truth)
    loop = regulator.loop(truth)
    q = regulator.design.n - regulator.plant.n
    whole = _with_input(loop, count)
    y = _weighed(loop, q)
    state = followed(whole, count)
    theory = Signals(state.mean @ y.T, symmetric(y @ state.P @ y.T))
    nothing, claims = _nothing(whole, theory), _claims(whole, theory)
    found = monte_carlo(whole, nothing, steps=count, runs=runs, seed=seed, compare=y, gains=claims, **options)
    horizon = regulator.steps is not None
    weight = [at(weights.joint, k, 2) for k in range(count if weights.joint.ndim == 3 else 1)]
    last = np.zeros_like(weight[0])
    if horizon:
        last[: len(weights.Qf), : len(weights.Qf)] = weights.Qf
    every = [*(weight[min(k, len(weight) - 1)] for k in range(count)), last]
    scale, added = (1.0, between * count) if horizon else (regulator.unit / count, between * regulator.unit)
    square = theory.P + theory.mean[:, :, None] * theory.mean[:, None, :]
    measured, expected = (float((np.array(every) * of).sum()) for of in (_second(found, theory), square))
    sd = np.sqrt(_variance(whole, state, y, every) / runs)
    names = (*regulator.design.states, *loop.model.measurements[loop.truth.m :])
    return LoopEnsemble(found, theory, names, scale * measured + added, float(scale * sd), scale * expected + added)


def _second(statistics: Statistics, theory: Signals) -> Array:
    """E[yyᵀ] of the runs, (steps+1, d, d), from the moments about the mean."""
    cross = statistics.bias[:, :, None] * theory.mean[:, None, :]
    mean = theory.mean[:, :, None] * theory.mean[:, None, :]
    return np.asarray(statistics.second_moment - cross - np.swapaxes(cross, 1, 2) + mean)


def _with_input(loop: ClosedLoop, steps: int) -> DiscreteModel:
    """The loop's model with u as a further state."""
    model, m = loop.model, loop.truth.m
    rest = model.measurement_offset
    assert rest is not None
    H, f = model.H[..., m:, :], rest[..., m:]
    varies = model.horizon is not None

    def seen(k: int) -> tuple[Array, Array]:
        return np.vstack([np.eye(model.n), at(H, k, 2)]), np.concatenate([np.zeros(model.n), at(f, k, 1)])

    def extended(k: int) -> tuple[Array, Array, Array]:
        X, c, W = model.motion(k)
        T, o = seen(k + 1)
        return np.hstack([T @ X, np.zeros((len(T), len(T) - model.n))]), T @ c + o, symmetric(T @ W @ T.T)

    maps = [extended(k) for k in range(steps if varies else 1)]
    Phi, c, Qd = (np.array([each[i] for each in maps]) if varies else maps[0][i] for i in range(3))
    T, o = seen(0)
    names = (*model.states, *(f"{name} (input)" for name in model.measurements[m:]))
    start: dict[str, Any] = {"P0": symmetric(T @ model.P0 @ T.T), "x0": T @ model.x0 + o}
    return DiscreteModel(Phi, Qd, np.zeros((1, len(T))), [[np.inf]], dt=model.dt, offset=c, first=0, states=names, **start)


def _weighed(loop: ClosedLoop, q: int) -> Array:
    """Rows that give (x, q, u) of (x, ξ, z, u)."""
    n, size, m, r = loop.sizes
    found = np.zeros((n + q + r, n + size + m + r))
    found[: n + q, : n + size] = picked(n, size, q)
    found[n + q :, n + size + m :] = np.eye(r)
    return found


def _nothing(model: DiscreteModel, theory: Signals) -> DiscreteModel:
    """A "filter" that estimates the mean, whatever happens."""
    d = theory.mean.shape[1]
    zero, steps = np.zeros((d, d)), len(theory.mean) - 1
    moves = np.broadcast_to(zero, (steps, d, d))
    return DiscreteModel(
        moves, zero, np.zeros((1, d)), [[np.inf]], P0=theory.P[0], x0=theory.mean[0], offset=theory.mean[1:], dt=model.dt, first=0
    )  # fmt: skip


def _claims(model: DiscreteModel, theory: Signals) -> Covariances:
    """What it claims: the covariances of y; its gains are zero."""
    steps, d = len(theory.mean) - 1, theory.mean.shape[1]
    S, used = np.full((steps + 1, 1, 1), np.inf), np.zeros((steps + 1, 1), dtype=bool)
    return Covariances(np.arange(steps + 1) * model.dt, theory.P, theory.P, np.zeros((steps + 1, d, 1)), S, used)


def _variance(model: DiscreteModel, state: Signals, y: Array, weights: list[Array]) -> float:
    """The variance of one run's cost, Σ y_kᵀW_ky_k over the instants."""
    Z, a, total = np.zeros_like(model.P0), np.zeros(model.n), 0.0
    for k in range(len(weights) - 1, -1, -1):
        P, m, W = state.P[k], state.mean[k], y.T @ weights[k] @ y
        if k < len(weights) - 1:
            X = model.motion(k)[0]
            Z, a = symmetric(X.T @ Z @ X), X.T @ a
        Z, a = Z + W, a + W @ m
        WP, push = W @ P, W @ m
        total += 4 * float(np.trace(Z @ P @ WP)) - 2 * float(np.trace(WP @ WP)) + 8 * float(a @ P @ push) - 4 * float(push @ P @ push)
    return total
