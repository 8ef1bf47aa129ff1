"""From a plant and a cost to a regulator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TypedDict, Unpack, overload

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.filtering.measured import begins
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models import at
from ctlabs.models.cost import Cost, Weights
from ctlabs.models.linear import ContinuousModel, DiscreteModel
from ctlabs.regulation import costs, targets
from ctlabs.regulation.augmented import weighed, with_integrals
from ctlabs.regulation.closed import closed, decaying, inner_loop
from ctlabs.regulation.continuous import ContinuousRegulator, continuous_regulator
from ctlabs.regulation.controller import Machine
from ctlabs.regulation.costs import LoopCost
from ctlabs.regulation.design import (
    KINDS,
    Regulator,
    Sampling,
    about_loads,
    loop_cost,
    steady_cost_about,
    with_integral_weights,
)
from ctlabs.regulation.estimator import Estimator, disturbance, scheduled_estimator, steady_estimator
from ctlabs.regulation.feedback import Feedback, lqr, whole_steps
from ctlabs.regulation.loads import at_rest, forward, loaded
from ctlabs.regulation.sampling import sample


class Options(TypedDict, total=False):
    """What :func:`regulator` takes beside the model, the cost and the period."""

    R: ArrayLike | None
    average: bool
    delay: float
    kind: str | None
    integral: Mapping[str, float] | None
    loads: Sequence[str]
    track: Sequence[str] | Mapping[str, ArrayLike]
    first: int | None
    stabilise: bool


@overload
def regulator(model: DiscreteModel, cost: Cost, *, dt: None = None, **options: Unpack[Options]) -> Regulator: ...
@overload
def regulator(model: ContinuousModel, cost: Cost, *, dt: float, **options: Unpack[Options]) -> Regulator: ...
@overload
def regulator(model: ContinuousModel, cost: Cost, *, dt: None = None, **options: Unpack[Options]) -> ContinuousRegulator: ...
def regulator(
    model: ContinuousModel | DiscreteModel,
    cost: Cost,
    *,
    dt: float | None = None,
    R: ArrayLike | None = None,
    average: bool = False,
    delay: float = 0.0,
    kind: str | None = None,
    integral: Mapping[str, float] | None = None,
    loads: Sequence[str] = (),
    track: Sequence[str] | Mapping[str, ArrayLike] = (),
    first: int | None = None,
    stabilise: bool = False,
) -> Regulator | ContinuousRegulator:
    r"""The optimal regulator of a plant whose state is measured with noise (LQG).

    .. math:: u_k = -L\hat x_k - L_w\hat w_k \quad\text{or}\quad u(t) = -L\hat x(t)

    Parameters
    ----------
    model : the plant, with B. A ContinuousModel with ``dt`` is sampled, its cost with it (:func:`ctlabs.regulation.sample`), and the
        input is held for a period; without, the regulator is continuous
    cost : what to keep small. A horizon makes a discrete regulator with scheduled gains, from the model's x0 and P0
    dt, R, average, delay : of the sampling; ``delay`` s, from the measurement to the moment at which its answer begins to act
    kind : ``"current"``, the input answers the measurement of its own instant (the default), or ``"delayed"``, that before (the
        default with ``average=True``, whose averages are known a period later)
    integral : measurement → weight of its integral, per second or step. The outputs return to their set points under any
        constant load: nothing need be known of it
    loads : states of the model that are constant or move on their own, which inputs cannot reach: they are estimated, and the
        tracked outputs kept free of them
    track : outputs that follow set points, at most as many as inputs: measurements by name, or name → row of a combination of states.
        Those of ``integral`` are tracked; a known constant ``offset`` of the model is then kept from them
    first : of scheduled gains: whether the first measurement comes at t0 (0) or a period later (1), by default as the model says.
        The steady regulator measures from t0 on
    stabilise : as for :func:`ctlabs.regulation.lqr`

    Returns
    -------
    Regulator, or ContinuousRegulator

    Raises
    ------
    ValueError, TypeError
        No B; an indefinite cost; a mode that no input reaches, no measurement sees or the cost does not see: it is named. D beside
        ``kind="current"``; outputs that the inputs cannot hold.

    Source: Åström, *Introduction to Stochastic Control Theory* (1970), chapter 8; Kwakernaak & Sivan, *Linear Optimal Control Systems*
    (1972), sections 5.3 to 5.5, 6.6; set points and loads: Francis (1977), SIAM J. Control Optim. 15.

    >>> walk = ContinuousModel([[0]], [[1]], [[1]], [[1]], B=[[1]], P0=[[1]])
    >>> found = regulator(walk, Cost([[1]], [[0]]), dt=0.5, R=[[0]])
    >>> (found.L * 0.5).round(12), round(found.cost.value / 0.5, 12)
    (array([[1.26794919]]), 0.788675134595)
    """
    checks.instance("cost", cost, Cost)
    if isinstance(model, ContinuousModel) and dt is None:
        _only_sampled(R=R, average=average, delay=delay, kind=kind, first=first)
        return continuous_regulator(model, cost, integral, loads, track, stabilise)
    sampling = None
    if isinstance(model, ContinuousModel):
        assert dt is not None
        sampling = Sampling(model, cost, dt, R, average, delay)
        plant, stepwise = sample(model, cost, dt, R=R, average=average, delay=delay)
    else:
        checks.instance("model", model, DiscreteModel)
        if dt is not None or R is not None or average or delay:
            msg = "dt, R, average, delay: expected none with a DiscreteModel, which is sampled already, received some"
            raise ValueError(msg)
        plant, stepwise = model, cost
    kind = ("delayed" if average else "current") if kind is None else kind
    if kind not in KINDS:
        msg = f"kind: expected one of {', '.join(KINDS)}, received {kind!r}"
        raise ValueError(msg)
    if kind == "current" and average:
        msg = 'kind: expected "delayed" with average=True (an average is known at the end of its period), received "current"'
        raise ValueError(msg)
    if kind == "current" and plant.D is not None and plant.D.any():
        msg = 'kind: expected "delayed" beside D (a measurement that contains the input cannot be answered by it), received "current"'
        raise ValueError(msg)
    if stepwise.discount != 1:
        msg = f"discount: expected 1 (the mean cost per step has no discount; lqr takes one), received {stepwise.discount:g}"
        raise ValueError(msg)
    return _designed(plant, stepwise, kind, integral or {}, loads, track, first, stabilise, sampling)


def _only_sampled(**given: object) -> None:
    wrong = [name for name, value in given.items() if value is not None and value is not False and value != 0.0]
    if wrong:
        msg = f"{wrong[0]}: expected dt beside it (the period of a sampled regulator), received none"
        raise ValueError(msg)


def _designed(
    plant: DiscreteModel,
    cost: Cost,
    kind: str,
    integral: Mapping[str, float],
    loads: Sequence[str],
    track: Sequence[str] | Mapping[str, ArrayLike],
    first: int | None,
    stabilise: bool,
    sampling: Sampling | None,
) -> Regulator:
    """The regulator of a discrete plant."""
    steps = whole_steps(cost)
    first = begins(plant, first)
    unit = plant.dt if sampling is not None else 1.0
    chosen, places, C, names, own = targets.asked(plant, integral, loads, track)
    if steps is not None and (chosen or places or len(C)):
        msg = "horizon: expected none beside integral, loads or track (they are of a regulator that works for ever), received one"
        raise ValueError(msg)
    weights = with_integral_weights(cost.weights(plant), unit * own)
    design = with_integrals(plant, chosen)
    estimator = steady_estimator(plant) if steps is None else scheduled_estimator(plant, steps, first)
    known = _with_known(estimator, design, plant)
    target, feedback = None, None
    if places:
        target, feedback, weights = loaded(plant, weights, places, C, stabilise=stabilise)
    else:
        whole = Cost(weights.Qx, weights.Qu, weights.N, weights.Qf if steps is not None else None, steps)
        feedback = lqr(design, whole, stabilise=stabilise)
    machine, offset = _machine(design, plant, feedback, known, kind, steps, C, names, chosen, places)
    if steps is None:
        _decaying(plant, machine, places, target)
    regulation, estimation, innovations = _parts(design, weights, feedback, known, kind, steps)
    between = cost.constant
    about = at_rest(plant, C, len(chosen)) if len(C) and plant.offset is not None and not places else None
    of_loop = partial(_of_loop, plant, machine, weights, len(chosen), steps, between, about, places, target)
    added = between * (steps or 1)
    unit_of = "step" if steps is None else "horizon"
    found = LoopCost(regulation, estimation, offset, added, innovations + offset + added, of_loop, unit_of)
    if sampling is not None and steps is None:
        found = found.scaled(1 / plant.dt, "s")
    return Regulator(plant, design, weights, feedback, estimator, kind, machine, found, between, tuple(places), target, sampling)


def _decaying(plant: DiscreteModel, machine: Machine, places: list[int], target: targets.Target | None) -> None:
    """Refuse a loop with a mode that does not decay; loads, which stay as they are, are none of its."""
    to, kept = about_loads(plant.n, len(machine.xi0), places, target)
    moves = (to @ inner_loop(plant, machine) @ np.linalg.inv(to))[np.ix_(kept, kept)]
    modes = (*plant.states, *(f"{name} (controller)" for name in machine.states))
    decaying(moves, tuple(modes[i] for i in kept), continuous=False)


def _of_loop(
    plant: DiscreteModel,
    machine: Machine,
    weights: Weights,
    integrals: int,
    steps: int | None,
    between: float,
    about: Array | None,
    places: list[int],
    target: targets.Target | None,
) -> float:
    """The cost from the covariances of the closed loop."""
    loop = closed(plant, machine)
    if target is not None:
        return steady_cost_about(loop, weights, places, target) + between
    return loop_cost(loop, weights, integrals, steps, between, about)


def _with_known(e: Estimator, design: DiscreteModel, plant: DiscreteModel) -> Estimator:
    """The estimator of the plant with the rows of what the controller knows exactly: the integrals, moved by z itself."""
    q = design.n - plant.n
    if not q:
        return e
    K = np.vstack([e.K, np.zeros((q, plant.m))])
    return e._replace(K=K, K_w=disturbance(design, e.S), P_minus=weighed(e.P_minus, q), P_plus=weighed(e.P_plus, q))


def _machine(
    design: DiscreteModel,
    plant: DiscreteModel,
    f: Feedback,
    e: Estimator,
    kind: str,
    steps: int | None,
    C: Array,
    names: tuple[str, ...],
    chosen: list[int],
    places: list[int],
) -> tuple[Machine, float]:
    """The controller's matrices, and the cost of the known offset."""
    assert design.B is not None
    n, r, p = plant.n, design.r, len(C)
    F, G = np.zeros((r, p)), np.zeros((design.n, p))
    inputs, cost = np.zeros(r), 0.0
    if p:
        F, inputs = forward(plant, f, C, places)
        if chosen:
            G[n:] = -design.dt * np.eye(len(chosen), p)
    else:
        inputs, cost = costs.offset_gains(design, f, steps)
    count = 1 if steps is None else steps
    rows: list[dict[str, Array]] = []
    for k in range(count):
        Phi, c, _ = design.motion(k)
        B, H = at(design.B, k, 2), at(design.H, k, 2)
        D = np.zeros((design.m, r)) if design.D is None else at(design.D, k, 2)
        d = np.zeros(design.m) if design.measurement_offset is None else at(design.measurement_offset, k, 1)
        g = e if steps is None else e.at(k)
        L, Lw = at(f.L, k, 2), at(f.L_w, k, 2)
        answer = L @ g.K + Lw @ g.K_w if kind == "current" else np.zeros((r, design.m))
        move = Phi @ g.K + g.K_w
        C_u, D_u, f_u = -L + answer @ H, -answer, at(inputs, k, 1) + answer @ d
        E = B - move @ D
        rows.append({
            "A": Phi - move @ H + E @ C_u, "B": move + E @ D_u, "C": C_u, "D": D_u, "F": F, "G": E @ F + G, "f": f_u,
            "g": c - move @ d + E @ f_u, "H_hat": H, "d_hat": d, "D_hat": D,
        })  # fmt: skip
    matrices = rows[0] if steps is None else {name: np.array([row[name] for row in rows]) for name in rows[0]}
    machine = Machine(
        **matrices, xi0=np.array(design.x0), dt=design.dt, states=design.states, measurements=design.measurements, set_points=names
    )  # fmt: skip
    return machine, cost


def _parts(
    design: DiscreteModel, weights: Weights, f: Feedback, e: Estimator, kind: str, steps: int | None
) -> costs.Parts:
    """The cost by separation and by the innovations, without offsets."""
    if steps is None:
        one = costs.step_cost(design, weights.Qx, f, e, kind, 0)
        arrival = costs.arrival(f.S, e) if kind == "current" else 0.0
        return one._replace(innovations=one.innovations + arrival)
    start = float(design.x0 @ f.S[0] @ design.x0)
    total = np.array([start + costs.trace(f.S[0], design.P0), 0.0, start + costs.trace(weights.Qf, e.P_minus[steps])])
    for k in range(steps):
        own = Feedback(f.L[k], f.S[k + 1], f.L_w[k], f.weight[k], f.poles, f.error)
        total += costs.step_cost(design, at(weights.Qx, k, 2), own, e.at(k), kind, k)
        if kind == "current":
            total[2] += costs.arrival(f.S[k], e.at(k))
    return costs.Parts(*total.tolist())
