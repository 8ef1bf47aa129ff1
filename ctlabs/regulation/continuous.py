r"""The regulator in continuous time: Kalman and Bucy's filter in the optimal feedback.

.. math:: u = -L\hat x, \quad \dot{\hat x} = F\hat x + Bu + K(z - H\hat x - Du), \qquad
          J = \mathrm{tr}\,SGQG^T + \mathrm{tr}\,PL^TQ_uL = \mathrm{tr}\,Q_xP + \mathrm{tr}\,SKR_cK^T

Perfect measurements (a singular R_c) have the reduced filter, whose estimate contains z itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from ctlabs.filtering import bucy, reduced
from ctlabs.linalg import checks, riccati
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import symmetric
from ctlabs.linalg.exponential import interval
from ctlabs.linalg.factors import ldl
from ctlabs.models.cost import Cost, Weights
from ctlabs.models.interop import state_space
from ctlabs.models.linear import ContinuousModel
from ctlabs.regulation import export, targets
from ctlabs.regulation.augmented import integrating
from ctlabs.regulation.closed import LoopCovariances, Signals, decaying
from ctlabs.regulation.controller import ContinuousMachine
from ctlabs.regulation.costs import LoopCost, trace
from ctlabs.regulation.design import about_loads, with_integral_weights
from ctlabs.regulation.feedback import Feedback, lqr
from ctlabs.regulation.loads import forward, loaded

if TYPE_CHECKING:
    import control


@dataclass(frozen=True, slots=True, eq=False)
class ContinuousLoop:
    """A truth and a continuous controller as one :class:`~ctlabs.models.linear.ContinuousModel` with the states (x, ξ).

    ``model``, which measures what the truth does · ``truth`` · ``machine`` · ``U`` (r, n+q), u of (x, ξ) · ``drive`` (n+q,), what a
    set point adds per second · ``poles`` (n+q,)
    """

    model: ContinuousModel
    truth: ContinuousModel
    machine: ContinuousMachine
    U: Array
    drive: Array
    constant: Array
    poles: Array

    def covariances(self, t: ArrayLike) -> LoopCovariances:
        """Means and covariances at increasing times ≥ 0, s, from the truth's x0 and P0."""
        times = checks.shaped("t", t, ("points",))
        checks.finite_start("a closed loop", self.model.P0)
        W = self.model.G @ self.model.Q @ self.model.G.T
        mean, P, now = np.array(self.model.x0), np.array(self.model.P0), 0.0
        means, covariances = [], []
        for time in times:
            if time < now:
                msg = f"t: expected increasing times >= 0, received {times.tolist()}"
                raise ValueError(msg)
            if time > now:
                over = interval(self.model.F, W, float(time - now))
                mean, P = over.Phi @ mean + over.Gamma @ self.drive, symmetric(over.Phi @ P @ over.Phi.T + over.Qd)
                now = float(time)
            means.append(mean)
            covariances.append(P)
        return self._signals(times, np.array(means), np.array(covariances))

    def steady(self) -> LoopCovariances:
        """The limits.

        Raises
        ------
        ValueError
            A loop that is not stable: the mode is named.
        """
        decaying(self.model.F, self.model.states, continuous=True)
        P = riccati.stationary(self.model.F, self.model.G @ self.model.Q @ self.model.G.T, continuous=True).P.high
        return self._signals(np.array(np.inf), -np.linalg.solve(self.model.F, self.drive), np.array(P))

    def _signals(self, t: Array, mean: Array, P: Array) -> LoopCovariances:
        n = self.truth.n
        whole = Signals(mean, P)
        C = np.vstack([np.eye(self.model.n), self.U])
        f = np.concatenate([np.zeros(self.model.n), self.constant])
        both = Signals(mean @ C.T + f, symmetric(C @ P @ C.T))
        H = self.model.H
        z = Signals(mean @ H.T, symmetric(H @ P @ H.T))
        return LoopCovariances(t, whole.part(0, n), whole.part(n, None), z, both.part(self.model.n, None), both)


def closed_continuous(truth: ContinuousModel, machine: ContinuousMachine, set_point: Array | None = None) -> ContinuousLoop:
    """The loop of a truth and a controller.

    Raises
    ------
    ValueError
        Numbers of measurements or inputs that differ; noise on a measurement that the controller passes on as it is.
    """
    checks.instance("truth", truth, ContinuousModel)
    M = machine
    if truth.B is None or truth.r != len(M.C) or truth.m != M.B.shape[1]:
        msg = f"truth: expected {M.B.shape[1]} measurements and {len(M.C)} inputs as the design has, received {truth.m} and {truth.r}"
        raise ValueError(msg)
    D = np.zeros((truth.m, truth.r)) if truth.D is None else truth.D
    Rc = np.zeros((truth.m, truth.m)) if truth.Rc is None else truth.Rc
    N = np.zeros((truth.s, truth.m)) if truth.N is None else truth.N
    if (M.D @ Rc).any() or (M.D.any() and D.any()):
        msg = "truth: expected no noise and no D on the measurements that the controller passes on directly, received some"
        raise ValueError(msg)
    r = np.zeros(len(M.set_points)) if set_point is None else checks.shaped("set_point", set_point, (len(M.set_points),))
    # u = (DH, C)(x, ξ) + f
    U, f = np.hstack([M.D @ truth.H, M.C]), M.F @ r
    zeta, zf = np.hstack([truth.H, np.zeros((truth.m, len(M.A)))]) + D @ U, D @ f
    rows_x = np.hstack([truth.F, np.zeros((truth.n, len(M.A)))]) + truth.B @ U
    rows_xi = np.hstack([np.zeros((len(M.A), truth.n)), M.A]) + M.B @ zeta
    F = np.vstack([rows_x, rows_xi])
    drive = np.concatenate([truth.B @ f, M.B @ zf + M.G @ r])
    G = scipy.linalg.block_diag(truth.G, M.B)
    Q = np.block([[truth.Q, N], [N.T, Rc]])
    cross = np.vstack([N, Rc])
    states = (*truth.states, *(f"{name} (controller)" for name in M.states))
    model = ContinuousModel(
        F, G, symmetric(Q), zeta, Rc=Rc, N=cross if cross.any() else None, x0=np.concatenate([truth.x0, M.xi0]),
        P0=scipy.linalg.block_diag(truth.P0, np.zeros((len(M.A),) * 2)), states=states, measurements=truth.measurements,
    )  # fmt: skip
    return ContinuousLoop(model, truth, machine, U, drive, f, np.sort_complex(np.linalg.eigvals(F)))


@dataclass(eq=False)
class ContinuousRegulator:
    r"""An LQG regulator in continuous time.

    ``plant``, ``design``, the same with the integrals that the controller keeps · ``weights`` · ``L`` (r, n+q) · ``K`` (n, m), the
    filter's gain; of a reduced filter that on what its innovations are · ``P`` (n, n), covariance of the error of x̂ · ``feedback`` ·
    ``machine`` · ``closed``, the loop with ``plant`` · ``poles`` · ``cost``, per second · ``loads``, ``target``, the motion that they ask
    for, and ``follows``, what of x the state of the controller estimates
    """

    plant: ContinuousModel
    design: ContinuousModel
    weights: Weights
    feedback: Feedback
    K: Array
    P: Array
    machine: ContinuousMachine
    closed: ContinuousLoop
    filter_poles: Array
    cost: LoopCost
    loads: tuple[int, ...]
    target: targets.Target | None
    follows: Array

    @property
    def L(self) -> Array:
        """The gain on the estimate and the integrals: u = −L x̂."""
        return self.feedback.L

    @property
    def poles(self) -> Array:
        """Of the closed loop: those of the feedback and those of the filter, 1/s, ascending."""
        return np.sort_complex(np.concatenate([self.feedback.poles, self.filter_poles]))

    def loop(self, truth: ContinuousModel | None = None, set_point: ArrayLike | None = None) -> ContinuousLoop:
        """The loop with another truth, or about a set point (p,)."""
        point = None if set_point is None else np.atleast_1d(np.asarray(set_point, dtype=np.float64))
        return closed_continuous(self.plant if truth is None else truth, self.machine, point)

    def actual_cost(self, truth: ContinuousModel | None = None) -> float:
        """What this regulator costs per second where the plant is ``truth``."""
        return _cost_of(self.loop(truth), self.weights, self.design.n - self.plant.n)

    @cached_property
    def compensator(self) -> control.StateSpace:
        """From z to −u, as python-control's negative feedback has it: ``control.feedback(plant, compensator)`` is the loop."""
        M = self.machine
        return state_space(M.A, M.B, -M.C, -M.D, 0.0)

    def export(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """The controller's matrices for NumPy (.npz), MATLAB (.mat) or C (.h): :func:`ctlabs.regulation.export.write`."""
        return export.write(self.machine, Path(path), overwrite=overwrite)


class _Estimator(NamedTuple):
    """K on innovations of strength R_nu, P, poles; x̂ = Cξ + Dz with ξ̇ = Aξ + B_z z + T(Bu) and ξ an estimate of Tx, or None for x̂ = ξ."""

    K: Array
    R_nu: Array
    P: Array
    poles: Array
    realisation: reduced.Realisation | None

    def follows(self, model: ContinuousModel) -> Array:
        """T: what of x ξ estimates, from CT + DH = I."""
        if self.realisation is None:
            return np.eye(model.n)
        return np.asarray(np.linalg.lstsq(self.realisation.C, np.eye(model.n) - self.realisation.D @ model.H, rcond=None)[0])


def _estimator(model: ContinuousModel) -> _Estimator:
    """The filter, or the reduced one where R_c is singular."""
    Rc = model.Rc
    if Rc is not None and np.diag(Rc).all():
        unit = np.sqrt(np.diag(Rc))
        if (ldl(Rc / np.outer(unit, unit))[1] > 0).all():
            limit = bucy.steady(model)
            return _Estimator(limit.K, Rc, limit.P, limit.poles, None)
    if model.D is not None and model.D.any():
        msg = "D: expected none beside a measurement without noise, received one"
        raise ValueError(msg)
    if (Rc is None or not Rc.any()) and model.m == model.n and np.linalg.matrix_rank(model.H) == model.n:
        # All of x is measured without noise: there is nothing to estimate, and what moves x is the only innovation.
        none, W = np.zeros((model.n, 0)), symmetric(model.G @ model.Q @ model.G.T)
        inverse = np.linalg.inv(model.H)
        direct = reduced.Realisation(np.zeros((0, 0)), np.zeros((0, model.n)), none, inverse)
        return _Estimator(np.eye(model.n), W, np.zeros_like(W), np.zeros(0, dtype=complex), direct)
    small = reduced.continuous(replace(model, B=None, D=None))
    limit_small = reduced.steady(small)
    b = small.basis
    assert small.model.Rc is not None
    gain = b.M @ limit_small.K
    gain[:, : len(b.D_p)] += b.L
    return _Estimator(gain, small.model.Rc, limit_small.P, limit_small.poles, reduced.realisation(small))


def continuous_regulator(
    model: ContinuousModel,
    cost: Cost,
    integral: Mapping[str, float] | None,
    loads: Sequence[str],
    track: Sequence[str] | Mapping[str, ArrayLike],
    stabilise: bool,
) -> ContinuousRegulator:
    """:func:`ctlabs.regulation.regulator` of a continuous model without a period."""
    if cost.horizon is not None or cost.discount != 1:
        what = "horizon" if cost.horizon is not None else "discount"
        msg = f"{what}: expected none of a continuous regulator (give dt, or ask lqr), received one"
        raise ValueError(msg)
    chosen, places, C, names, own = targets.asked(model, integral or {}, loads, track)
    weights = with_integral_weights(cost.weights(model), own)
    e = _estimator(model)
    if chosen and e.realisation is not None:
        msg = "integral: expected noise on every measurement in continuous time, received one without (sample the plant: dt=)"
        raise ValueError(msg)
    design = integrating(model, chosen)
    if places:
        goal, feedback, weights = loaded(model, weights, places, C, stabilise=stabilise)
    else:
        goal, feedback = None, lqr(design, Cost(weights.Qx, weights.Qu, weights.N), stabilise=stabilise)
    K = np.vstack([e.K, np.eye(model.m)[chosen]])
    machine = _machine(model, design, feedback, e, K, C, names, places, len(chosen))
    P = scipy.linalg.block_diag(e.P, np.zeros((len(chosen),) * 2))
    W = symmetric(design.G @ design.Q @ design.G.T)
    regulation = trace(feedback.S, W)
    estimation = trace(feedback.weight, feedback.L, P, feedback.L.T)
    innovations = trace(weights.Qx, P) + trace(feedback.S, K, e.R_nu, K.T)
    loop = closed_continuous(model, machine)
    follows = e.follows(model)
    to, kept = about_loads(model.n, loop.model.n - model.n, places, goal, follows)
    moves = (to @ loop.model.F @ np.linalg.inv(to))[np.ix_(kept, kept)]
    decaying(moves, tuple(loop.model.states[i] for i in kept), continuous=True)
    between = cost.constant
    of_loop = partial(_of_loop, loop, weights, len(chosen), between, places, goal, follows)
    found = LoopCost(regulation, estimation, 0.0, between, innovations + between, of_loop, "s")
    return ContinuousRegulator(model, design, weights, feedback, e.K, e.P, machine, loop, e.poles, found, tuple(places), goal, follows)


def _of_loop(
    loop: ContinuousLoop,
    weights: Weights,
    integrals: int,
    between: float,
    places: list[int],
    goal: targets.Target | None,
    follows: Array,
) -> float:
    """The cost from the covariances of the closed loop."""
    if goal is not None:
        return _about(loop, weights, places, goal, follows) + between
    return _cost_of(loop, weights, integrals) + between


def _machine(
    model: ContinuousModel,
    design: ContinuousModel,
    f: Feedback,
    e: _Estimator,
    K: Array,
    C: Array,
    names: tuple[str, ...],
    places: list[int],
    q: int,
) -> ContinuousMachine:
    """The controller's matrices."""
    assert design.B is not None
    r, p = design.r, len(C)
    F = forward(model, f, C, places)[0] if p else np.zeros((r, 0))
    if e.realisation is not None:
        A, B, C_x, D_x = e.realisation
        T = e.follows(model)
        TB, LC, LD = T @ design.B, f.L @ C_x, f.L @ D_x
        start = T @ model.x0
        kept = tuple(f"xi{i + 1}" for i in range(len(A)))
        return ContinuousMachine(A - TB @ LC, B - TB @ LD, -LC, -LD, F, TB @ F, start, kept, names)
    D = np.zeros((model.m, r)) if design.D is None else design.D
    E = design.B - K @ D
    G = E @ F
    if q:
        G[model.n :] -= np.eye(q, p)
    A = design.F - K @ design.H - E @ f.L
    return ContinuousMachine(A, K, -f.L, np.zeros((r, model.m)), F, G, np.array(design.x0), design.states, names)


def rows_weighed(loop: ContinuousLoop, q: int) -> Array:
    """What of (x, ξ) is weighed: x, the last q elements of ξ, u."""
    n, size = loop.truth.n, loop.model.n
    return np.vstack([np.eye(n, size), np.eye(q, size, size - q), loop.U])


def _cost_of(loop: ContinuousLoop, weights: Weights, q: int) -> float:
    """The cost per second from the covariances of a loop."""
    size, rows = loop.model.n, rows_weighed(loop, q)
    joint = loop.steady().joint
    P, mean = joint.P[:size, :size], joint.mean[:size]
    return float((weights.joint * (rows @ (P + np.outer(mean, mean)) @ rows.T)).sum())


def _about(loop: ContinuousLoop, weights: Weights, places: list[int], goal: targets.Target, follows: Array) -> float:
    """The cost of what differs from the motions that loads ask for, which alone comes to rest."""
    to, kept = about_loads(loop.truth.n, loop.model.n - loop.truth.n, places, goal, follows)
    back = np.linalg.inv(to)[:, kept]
    pushed, rows = to[kept] @ loop.model.G, rows_weighed(loop, 0) @ back
    P = riccati.stationary(to[kept] @ loop.model.F @ back, symmetric(pushed @ loop.model.Q @ pushed.T), continuous=True).P.high
    return float((weights.joint * (rows @ P @ rows.T)).sum())
