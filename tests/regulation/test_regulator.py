"""The regulator: no other controller is cheaper, every route gives its cost, nothing constant is left of a load."""

from __future__ import annotations

from dataclasses import replace

import control
import numpy as np
import pytest

from ctlabs import ContinuousModel, Cost, DiscreteModel, regulator
from ctlabs.regulation import lqr
from ctlabs.regulation.closed import closed
from ctlabs.regulation.design import loop_cost
from tests.regulation.plants import MOTOR, MOTOR_COST, continuous, discrete

pytestmark = pytest.mark.numerical

SEEDS = range(10)
KINDS = ("current", "delayed")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", SEEDS)
def test_three_routes_give_one_cost(seed, kind):
    model, cost = discrete(seed, offset=seed % 3 == 0, through=kind == "delayed" and seed % 2 == 0)
    assert regulator(model, cost, kind=kind).cost.spread < 1e-11
    for first in (0, 1):
        horizon = replace(cost, Qf=np.eye(model.n), horizon=7)
        assert regulator(model, horizon, kind=kind, first=first).cost.spread < 1e-11


@pytest.mark.parametrize("seed", SEEDS)
def test_three_routes_give_one_cost_in_continuous_time(seed):
    model, cost = continuous(seed)
    assert regulator(model, cost).cost.spread < 1e-10
    assert regulator(replace(model, N=None), cost, dt=0.2).cost.spread < 1e-11


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", SEEDS)
def test_no_controller_near_it_is_cheaper(seed, kind):
    """The cost is stationary, and rises to the second order in whatever matrix of the controller is changed."""
    model, cost = discrete(seed, through=kind == "delayed" and seed % 2 == 0)
    found, rng = regulator(model, cost, kind=kind), np.random.default_rng(seed)
    least, M = found.cost.value, found.machine

    def changed(size: float, moves: dict[str, np.ndarray]) -> float:
        other = replace(M, **{name: getattr(M, name) + size * move for name, move in moves.items()})
        return loop_cost(closed(model, other), found.weights, 0, None, 0.0)

    for names in (("C",), ("A", "B"), ("D",), ("A", "B", "C", "D")):
        if "D" in names and kind == "delayed":
            continue  # which would be another kind
        moves = {name: rng.normal(size=getattr(M, name).shape) * (np.abs(getattr(M, name)).max() + 0.1) for name in names}
        size = 1e-3
        while True:  # as far as the loop stays stable
            try:
                up, down = changed(size, moves), changed(-size, moves)
                break
            except ValueError:
                size /= 4
        rise = 0.5 * (up + down) - least
        assert rise > 0
        half = 0.5 * (changed(size / 2, moves) + changed(-size / 2, moves)) - least
        assert min(up, down) > least - 1e-10 * least
        assert rise == pytest.approx(4 * half, rel=0.3)  # so the slope is that of a minimum, not merely small


@pytest.mark.parametrize("seed", SEEDS)
def test_what_a_measurement_tells_of_the_disturbance_is_used(seed):
    model, cost = discrete(seed)
    found = regulator(model, cost)
    M = found.machine
    # Without its share of L_w the same estimator costs more.
    answer = found.L @ found.K
    without = replace(M, C=-found.L + answer @ model.H, D=-answer)
    E = model.B @ (without.D - M.D)
    without = replace(without, A=M.A + model.B @ (without.C - M.C), B=M.B + E)
    assert loop_cost(closed(model, without), found.weights, 0, None, 0.0) > found.cost.value


@pytest.mark.parametrize("seed", SEEDS)
def test_the_poles_are_those_of_feedback_and_filter(seed):
    model, cost = discrete(seed)
    found = regulator(model, cost)
    assert np.allclose(np.sort_complex(np.abs(found.closed.poles)), np.sort_complex(np.abs(found.poles)), atol=1e-6)
    loop = control.feedback(control.ss(model.Phi, model.B, model.H, 0, model.dt), found.compensator, -1)
    assert np.allclose(np.sort(np.abs(loop.poles())), np.sort(np.abs(found.poles)), atol=1e-6)


def test_the_continuous_compensator_is_negative_feedback():
    found = regulator(MOTOR, MOTOR_COST)
    loop = control.feedback(control.ss(MOTOR.F, MOTOR.B, MOTOR.H, 0), found.compensator, -1)
    assert np.allclose(np.sort_complex(loop.poles()), found.poles)


# Loads, set points, integrals --------------------------------------------------------------------------------------------


def pushed(load: float) -> ContinuousModel:
    """The motor with a torque that nobody tells the design."""
    F = np.block([[MOTOR.F, np.array([[0.0], [1.0]])], [np.zeros((1, 3))]])
    P0 = np.diag([1, 1, 0.0])
    return ContinuousModel(F, [[0], [1], [0]], [[1]], [[1, 0, 0]], Rc=MOTOR.Rc, B=[[0], [1], [0]], P0=P0, x0=[0, 0, load])


def after_long(found, truth, **options) -> float:
    """The mean place when everything has come to rest."""
    loop = found.loop(truth, **options)
    if isinstance(truth, ContinuousModel) and not hasattr(found, "sampling"):
        return float(loop.covariances([200.0]).x.mean[-1, 0])
    return float(loop.covariances(2000).x.mean[-1, 0])


@pytest.mark.parametrize("options", [{}, {"dt": 0.1}, {"dt": 0.1, "kind": "delayed"}, {"dt": 0.1, "delay": 0.13}])
def test_an_integral_leaves_no_offset_of_a_load(options):
    plain = regulator(MOTOR, MOTOR_COST, **options)
    integrating = regulator(MOTOR, MOTOR_COST, integral={"place": 0.5}, **options)
    known = pushed(0.0)
    loads = regulator(
        replace(known, Q=np.diag([1.0, 0.1]), G=np.array([[0.0, 0], [1, 0], [0, 1]]), P0=np.eye(3), states=("place", "speed", "torque"),
                measurements=("place",)),
        Cost(np.diag([1.1, 0.3, 0]), [[0.7]]), loads=["torque"], track=["place"], **options,
    )  # fmt: skip
    if not options.get("delay"):
        assert abs(after_long(plain, pushed(2.0))) > 0.5
    assert abs(after_long(integrating, pushed(2.0))) < 1e-9
    assert abs(after_long(loads, pushed(2.0))) < 1e-9
    assert integrating.cost.spread < 1e-11
    assert loads.cost.spread < 1e-11
    assert abs(after_long(integrating, pushed(2.0), set_point=[3.0]) - 3.0) < 1e-9
    assert abs(after_long(loads, pushed(-1.0), set_point=3.0) - 3.0) < 1e-9


def test_a_sinusoidal_load_is_cancelled_by_its_model():
    """A load that swings at a known frequency: its estimate feeds an input that keeps the output still."""
    w = 2.0
    F = np.zeros((4, 4))
    F[:2, :2], F[2:, 2:], F[1, 2] = MOTOR.F, [[0, w], [-w, 0]], 1.0
    G = np.zeros((4, 2))
    G[1, 0] = G[3, 1] = 1.0
    swinging = ContinuousModel(
        F, G, np.diag([1.0, 1.0]), [[1, 0, 0, 0]], Rc=[[0.01]], B=[[0], [1], [0], [0]], P0=np.eye(4),
        states=["place", "speed", "sin", "cos"], measurements=["place"],
    )  # fmt: skip
    for options in ({}, {"dt": 0.1}):
        found = regulator(swinging, Cost(np.diag([1.1, 0.3, 0, 0]), [[0.7]]), loads=["sin", "cos"], track=["place"], **options)
        assert found.cost.spread < 1e-10
        truth = replace(swinging, Q=np.zeros((2, 2)), x0=[0, 0, 3.0, 0], P0=np.zeros((4, 4)))
        still = found.loop(truth).covariances(np.arange(200.0, 204.0, 0.1) if not options else 2000).x.mean[-30:, 0]
        assert np.abs(still).max() < (1e-6 if not options else 0.02)  # between samples the held input follows a swing but in steps


def test_set_points_of_two_outputs_are_reached():
    model, cost = discrete(3)
    rng = np.random.default_rng(0)
    B = rng.normal(size=(model.n, 2))
    plant = DiscreteModel(model.Phi, model.Qd, np.eye(model.n)[:2], np.eye(2), B=B, P0=model.P0, measurements=["a", "b"])
    wide = Cost(cost.Qx, np.eye(2))
    found = regulator(plant, wide, track=["a", "b"])
    assert np.allclose(found.loop(set_point=[1.0, -2.0]).steady().x.mean[:2], [1.0, -2.0], atol=1e-9)


def test_a_known_offset_is_answered_optimally_or_kept_from_the_outputs():
    model, cost = discrete(5)
    loaded = replace(model, offset=np.ones(model.n))
    best = regulator(loaded, cost)
    assert best.cost.spread < 1e-11
    # No constant input of another size is cheaper.
    for size in (-1e-3, 1e-3):
        f = best.machine.f + size
        other = replace(best.machine, f=f, g=best.machine.g + loaded.B @ (f - best.machine.f))
        assert loop_cost(closed(loaded, other), best.weights, 0, None, 0.0) > best.cost.value
    held = regulator(replace(MOTOR_SAMPLED, offset=np.array([0.0, 0.3])), MOTOR_COST, track=["place"])
    assert abs(held.closed.steady().x.mean[0]) < 1e-12
    assert held.cost.spread < 1e-11


MOTOR_SAMPLED = regulator(MOTOR, MOTOR_COST, dt=0.1).plant


# Measurements without noise -----------------------------------------------------------------------------------------------


def test_perfect_measurements_take_the_reduced_filter():
    exact = ContinuousModel([[0, 1], [0, -1]], [[0, 0.3], [1, 0]], np.eye(2), [[1, 0]], B=[[0], [1]], P0=np.eye(2))
    found = regulator(exact, MOTOR_COST)
    assert found.cost.spread < 1e-12
    assert len(found.machine.A) == 1
    noisy = [regulator(replace(exact, Rc=[[r]]), MOTOR_COST).cost.value - found.cost.value for r in (1e-6, 1e-8)]
    assert 0 < noisy[1] < 0.2 * noisy[0]  # the error falls like the root of the noise


def test_a_state_that_is_measured_exactly_needs_no_filter():
    exact = ContinuousModel([[0, 1], [0, -1]], np.eye(2), np.diag([0.1, 1.0]), [[1, 1], [0, 2]], B=[[0], [1]], P0=np.eye(2))
    found, known = regulator(exact, MOTOR_COST), lqr(exact, MOTOR_COST)
    assert found.cost.spread < 1e-12
    assert found.cost.value == pytest.approx(float(np.trace(known.S @ exact.G @ exact.Q @ exact.G.T)), rel=1e-12)
    assert found.machine.A.shape == (0, 0)
    assert np.allclose(found.machine.D, -known.L @ np.linalg.inv(exact.H))
    assert found.compensator.nstates == 0


def test_coloured_measurement_noise_takes_the_reduced_filter():
    """z = x + n with n an AR(1): no white noise is left; the discrete filter with R = 0."""
    model = DiscreteModel([[0.9, 0], [0, 0.6]], np.diag([1.0, 0.3]), [[1, 1]], [[0]], B=[[1], [0]], P0=np.eye(2))
    found = regulator(model, Cost(np.diag([1.0, 0]), [[0.1]]))
    assert found.cost.spread < 1e-10


# Wrong designs -----------------------------------------------------------------------------------------------------------


def test_a_wrong_design_costs_more_on_the_truth():
    truth = replace(MOTOR, F=np.array([[0, 1], [0, -0.5]]))
    for options in ({}, {"dt": 0.1}):
        wrong, right = regulator(MOTOR, MOTOR_COST, **options), regulator(truth, MOTOR_COST, **options)
        assert wrong.actual_cost() == pytest.approx(wrong.cost.value, rel=1e-12)
        assert wrong.actual_cost(truth) > right.cost.value
        assert right.actual_cost(truth) == pytest.approx(right.cost.value, rel=1e-12)


def test_a_wrong_design_that_is_not_stable_is_named():
    reversed_motor = replace(MOTOR, B=-MOTOR.B)
    for options in ({}, {"dt": 0.1}):
        with pytest.raises(ValueError, match=r"every mode to decay, received the mode eigenvalue .* of the states place"):
            regulator(MOTOR, MOTOR_COST, **options).actual_cost(reversed_motor)


HIDDEN = DiscreteModel(np.diag([1.1, 0.5]), np.eye(2), [[0, 1]], [[1]], B=np.ones((2, 1)), P0=np.eye(2))
BAD = {
    "kind": (lambda: regulator(MOTOR_SAMPLED, MOTOR_COST, kind="now"), "kind: expected one of current, delayed"),
    "dt of a discrete model": (lambda: regulator(MOTOR_SAMPLED, MOTOR_COST, dt=1.0), "expected none with a DiscreteModel"),
    "delay without dt": (lambda: regulator(MOTOR, MOTOR_COST, delay=0.1), "delay: expected dt beside it"),
    "averages at once": (
        lambda: regulator(MOTOR, MOTOR_COST, dt=0.1, average=True, kind="current"),
        'kind: expected "delayed" with average',
    ),
    "D at once": (lambda: regulator(replace(MOTOR_SAMPLED, D=[[1.0]]), MOTOR_COST), 'kind: expected "delayed" beside D'),
    "unknown integral": (lambda: regulator(MOTOR, MOTOR_COST, integral={"speed": 1.0}), "integral: expected names of 'place'"),
    "too many outputs": (lambda: regulator(MOTOR, MOTOR_COST, track={"a": [1, 0], "b": [0, 1]}), "track: expected at most 1 outputs"),
    "no rest": (lambda: regulator(MOTOR, MOTOR_COST, track={"speed": [0, 1]}), "set points: expected a plant whose inputs can hold"),
    "zero": (
        lambda: regulator(DiscreteModel([[0.5]], [[1]], [[0]], [[1]], B=[[1]], P0=[[1]]), Cost([[1]], [[1]]), track=["z1"]),
        "set points: expected a plant whose inputs can hold",
    ),
    "load that moves": (lambda: regulator(MOTOR, MOTOR_COST, loads=["speed"], track=["place"]), "loads: expected a state that neither"),
    "both": (
        lambda: regulator(pushed(0), Cost(np.eye(3), [[1]]), loads=["x3"], integral={"z1": 1.0}),
        "integral: expected none beside loads",
    ),
    "unmeasured": (
        lambda: regulator(HIDDEN, Cost(np.eye(2), [[1]])),
        "which no measurement sees",
    ),
    "discount": (lambda: regulator(MOTOR_SAMPLED, replace(MOTOR_COST, discount=0.9)), "discount: expected 1"),
}  # fmt: skip


@pytest.mark.parametrize("what", BAD)
def test_what_cannot_be_is_refused(what):
    call, message = BAD[what]
    with pytest.raises(ValueError, match=message) as error:
        call()
    assert "\n" not in str(error.value)


def test_lqr_and_regulator_agree():
    assert np.array_equal(regulator(MOTOR, MOTOR_COST).L, lqr(MOTOR, MOTOR_COST).L)
