"""Pieces of the formulas that other tests would not miss: constants, known offsets, cross terms beside perfect measurements and delays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ctlabs import Cost, DiscreteModel, discretise, regulator
from ctlabs.regulation import Margin, ensemble, lqr, margins, sample, tradeoff
from ctlabs.regulation.augmented import integrating, with_integrals
from ctlabs.regulation.closed import followed
from tests.regulation.plants import MOTOR, MOTOR_COST, continuous, discrete
from tests.strategies import covariance

pytestmark = pytest.mark.numerical

SEEDS = range(6)


def test_what_is_added_whatever_the_inputs_do_is_added():
    """A cost of c more per second is c dearer, sampled or not, and h c more in each step."""
    more, h = replace(MOTOR_COST, constant=0.5), 0.1
    assert sample(MOTOR, more, h).cost.constant == pytest.approx(sample(MOTOR, MOTOR_COST, h).cost.constant + 0.5 * h, rel=1e-14)
    for options in ({}, {"dt": h}, {"dt": h, "delay": 0.04}):
        dearer, plain = (regulator(MOTOR, cost, **options).cost for cost in (more, MOTOR_COST))
        for route, value in dearer.routes.items():
            assert value == pytest.approx(plain.routes[route] + 0.5, rel=1e-12)


def test_a_discounted_horizon_is_that_of_a_plant_that_fades():
    """e^(−at/2)x for x: F − a/2 and no discount."""
    cost = replace(MOTOR_COST, Qf=np.eye(2), horizon=1.5)
    faded = replace(MOTOR, F=MOTOR.F - 0.25 * np.eye(2))
    found, expected = (lqr(m, c, t=[0.0, 0.7]).L for m, c in ((MOTOR, replace(cost, discount=np.exp(-0.5))), (faded, cost)))
    np.testing.assert_allclose(found, expected, rtol=1e-10)


# Perfect measurements -----------------------------------------------------------------------------------------------------

#: x1 grows, nothing drives it, and it is measured exactly; x2 is measured with a noise that its disturbance is told by.
GROWING = DiscreteModel(
    [[1.2, 0], [0.3, 0.8]], np.diag([0, 1.0]), np.eye(2), np.diag([0, 0.3]), N=[[0, 0], [0, 0.2]], B=[[1], [0]], P0=np.eye(2)
)  # fmt: skip


@pytest.mark.parametrize("kind", ["current", "delayed"])
def test_a_growing_state_that_is_known_takes_the_reduced_filter(kind):
    """The full filter has no stable gain for it. The rest is a scalar filter: P⁻ = 0.64P⁻ + 1 − (0.8P⁻ + 0.2)²/(P⁻ + 0.3)."""
    found = regulator(GROWING, Cost(np.eye(2), [[0.1]]), kind=kind)
    assert np.isnan(found.estimator.error)
    P = np.max(np.roots([1.0, 0.3 - 0.64 * 0.3 - 1 + 2 * 0.8 * 0.2, 0.2**2 - 0.3]))
    assert found.estimator.P_minus[1, 1] == pytest.approx(P, rel=1e-12)
    assert found.estimator.S[1, 1] == pytest.approx(P + 0.3, rel=1e-12)
    assert found.estimator.K_w[1, 1] == pytest.approx(0.2 / (P + 0.3), rel=1e-12)
    assert found.cost.spread < 1e-12


# Known offsets -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["current", "delayed"])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_known_offset_of_the_measurements_costs_nothing(seed, kind):
    """The controller takes it off: no signal of the loop but z differs, over time and in the limit."""
    model, cost = discrete(seed, offset=True, through=kind == "delayed")
    d = np.random.default_rng(seed).normal(size=model.m)
    plain, seen = (regulator(m, cost, kind=kind) for m in (model, replace(model, measurement_offset=d)))
    assert seen.cost.closed_loop == pytest.approx(plain.cost.value, rel=1e-11)
    for one, other in ((plain.closed.steady(), seen.closed.steady()), (plain.closed.covariances(5), seen.closed.covariances(5))):
        np.testing.assert_allclose(other.joint.mean, one.joint.mean, rtol=0, atol=1e-10 * (1 + np.abs(one.joint.mean).max()))
        np.testing.assert_allclose(other.z.mean, one.z.mean + d, rtol=0, atol=1e-10 * (1 + np.abs(one.z.mean).max()))


def test_a_missing_measurement_is_what_is_expected_offset_and_input_included():
    """z missing is replaced by Hξ + d + Du."""
    model, cost = discrete(4, through=True)
    model = replace(model, measurement_offset=np.arange(1.0, model.m + 1))
    found = regulator(model, cost, kind="delayed")
    one, other = found.controller(), found.controller()
    for z in (np.ones(model.m), np.full(model.m, 0.3)):
        one.step(z)
        other.step(z)
    u = -found.L @ other.xi
    np.testing.assert_allclose(one.step(None), other.step(model.H @ other.xi + model.measurement_offset + model.D @ u), rtol=1e-13)
    np.testing.assert_allclose(one.xi, other.xi, rtol=1e-13)


# Integrals and loads -------------------------------------------------------------------------------------------------------


def test_an_integral_is_weighed_per_second():
    """The sampled plant with q' = q + hz and the weight h w of it, by the feedback of a known state."""
    h, w = 0.1, 0.5
    found = regulator(MOTOR, MOTOR_COST, dt=h, integral={"place": w})
    plant, cost = sample(MOTOR, MOTOR_COST, h)
    Qx = np.zeros((3, 3))
    Qx[:2, :2], Qx[2, 2] = cost.Qx, h * w
    np.testing.assert_allclose(found.L, lqr(with_integrals(plant, [0]), Cost(Qx, cost.Qu, np.vstack([cost.N, [[0]]]))).L, rtol=1e-13)


@pytest.mark.parametrize("kind", ["current", "delayed"])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_load_beside_noises_that_correlate_has_its_cost_on_every_route(seed, kind):
    """What a measurement tells of the disturbance of its instant is answered, that of the load included."""
    model, cost = discrete(seed)
    rng, n, m = np.random.default_rng(seed), model.n, model.m
    Phi = np.zeros((n + 1, n + 1))
    Phi[:n, :n], Phi[:n, n], Phi[n, n] = model.Phi, model.B[:, 0], 1.0
    joint = covariance(rng, n + 1 + m)
    plant = DiscreteModel(
        Phi, joint[: n + 1, : n + 1], np.hstack([model.H, np.zeros((m, 1))]), joint[n + 1 :, n + 1 :], N=joint[: n + 1, n + 1 :],
        B=np.vstack([model.B, np.zeros((1, model.r))]), P0=np.eye(n + 1), states=[*(f"x{i}" for i in range(n)), "load"],
    )  # fmt: skip
    wide = np.zeros((n + 1, n + 1))
    wide[:n, :n] = cost.Qx
    held = {"y": np.append(rng.normal(size=n), 0.0)}
    found = regulator(plant, Cost(wide, cost.Qu, np.vstack([cost.N, np.zeros((1, model.r))])), kind=kind, loads=["load"], track=held)
    assert found.L_w[:, :n].any()
    assert found.cost.spread < 1e-10


# Delays --------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("late", "H"), [(0.04, [1, 0, 0.5]), (0.1, [1, 0, 0.5]), (0.13, [1, 0, 0, 0.5]), (0.2, [1, 0, 0, 0.5])])
def test_a_measurement_that_contains_a_late_input_contains_the_one_that_acts(late, H):
    """z = place + u/2: at a sample the input of 0.04 s ago, or of a period ago, is the one of the sample before."""
    model = sample(replace(MOTOR, D=[[0.5]]), MOTOR_COST, 0.1, delay=late).model
    assert model.D is None
    np.testing.assert_array_equal(model.H, [H])


def test_the_end_of_a_horizon_weighs_the_state_alone():
    """Inputs that are still on their way then cost nothing."""
    cost = replace(MOTOR_COST, Qf=[[2, 1], [1, 3]], horizon=1.0)
    held = sample(MOTOR, cost, 0.1, delay=0.13).cost
    np.testing.assert_array_equal(held.Qf, np.block([[cost.Qf, np.zeros((2, 2))], [np.zeros((2, 4))]]))
    assert held.horizon == 10


@pytest.mark.parametrize("seed", SEEDS)
def test_what_a_measurement_tells_of_the_plant_it_does_not_tell_of_inputs_on_their_way(seed):
    model, cost = continuous(seed)
    found = sample(model, cost, 0.2, delay=0.3).model
    np.testing.assert_array_equal(found.N[: model.n], discretise(model, 0.2).N)
    assert not found.N[model.n :].any()


# Integrals, continuous loops, margins, curves ---------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", SEEDS)
def test_an_integral_adds_up_what_is_measured(seed):
    """q' = q + h(Hx + Du + d + v): its motion, its noise h v, and what of that the measurement tells; the same per second."""
    model, _ = discrete(seed, offset=True, through=True)
    rng, h = np.random.default_rng(seed), 0.3
    model = replace(model, dt=h, measurement_offset=rng.normal(size=model.m))
    whole = with_integrals(model, [model.m - 1])
    x, q, u = rng.normal(size=model.n), rng.normal(size=1), rng.normal(size=model.r)
    z = model.H @ x + model.D @ u + model.measurement_offset
    expected = np.concatenate([model.Phi @ x + model.B @ u + model.offset, q + h * z[-1:]])
    np.testing.assert_allclose(whole.Phi @ np.append(x, q) + whole.B @ u + whole.offset, expected, rtol=0, atol=1e-12)
    pick = np.eye(model.n + model.m)[[*range(model.n), model.n + model.m - 1]]
    pick[-1] *= h
    joint = np.block([[model.Qd, model.N], [model.N.T, model.R]])
    np.testing.assert_allclose(whole.Qd, pick @ joint @ pick.T, rtol=1e-13)
    np.testing.assert_allclose(whole.N, (pick @ joint)[:, model.n :], rtol=1e-13)
    plant, _ = continuous(seed)
    plant = replace(plant, D=rng.normal(size=(plant.m, plant.r)))
    slow = integrating(plant, [plant.m - 1])
    np.testing.assert_allclose(slow.B[-1], plant.D[-1])
    np.testing.assert_allclose(slow.F[-1, : plant.n], plant.H[-1])
    np.testing.assert_allclose(slow.Q[-1], np.append(plant.N[:, -1], plant.Rc[-1, -1]))
    np.testing.assert_allclose(slow.N, np.vstack([plant.N, plant.Rc[-1:]]))


@pytest.mark.parametrize("seed", SEEDS)
def test_a_continuous_measurement_that_contains_the_input_costs_nothing_more(seed):
    """Du is known and taken off: every route, and the cost without D."""
    model, cost = continuous(seed)
    through = replace(model, D=np.random.default_rng(seed).normal(size=(model.m, model.r)))
    found, plain = regulator(through, cost).cost, regulator(model, cost).cost
    assert found.spread < 1e-10
    assert found.closed_loop == pytest.approx(plain.closed_loop, rel=1e-10)


def test_two_loops_that_do_not_meet_bear_together_what_the_weaker_bears():
    """A block of two scalar plants: the disk of all inputs at once is the smaller one."""
    plant = DiscreteModel(np.diag([1.1, 0.9]), np.eye(2), np.eye(2), np.diag([1.0, 4.0]), B=np.diag([1.0, 2.0]), P0=np.eye(2))
    found = margins(regulator(plant, Cost(np.eye(2), np.eye(2))))
    assert found.together == pytest.approx(min(each.disk for each in found.inputs.values()), rel=1e-6)


def test_a_disk_of_one_is_a_third_to_three_and_53_degrees():
    """(1 ± α/2)/(1 ∓ α/2), 2 arctan α/2."""
    found = Margin((0.0, np.inf), 1.0, 1.0, 1.0, 1.0, 1.0)
    assert found.disk_gain == pytest.approx((1 / 3, 3.0), rel=1e-15)
    assert np.degrees(found.disk_phase) == pytest.approx(53.13010235415598, rel=1e-15)


def test_a_cross_weight_goes_with_the_root_of_the_inputs_weight():
    """[[Qx, √ρN], [√ρNᵀ, ρQu]] is definite for every ρ."""
    model, cost = discrete(3)
    found = tradeoff(model, cost, [4.0]).members[0]
    np.testing.assert_array_equal(found.L, regulator(model, Cost(cost.Qx, 4 * cost.Qu, 2 * cost.N)).L)


def test_a_perfect_measurement_follows_its_set_point():
    """The controller carries what the reduced filter estimates; the place comes to rest at 3, the estimate with it."""
    exact = replace(MOTOR, Rc=None, G=np.array([[0, 0.3], [1, 0]]), Q=np.eye(2))
    loop = regulator(exact, MOTOR_COST, track=["place"]).loop(set_point=[3.0])
    np.testing.assert_allclose(loop.steady().x.mean, [3.0, 0.0], atol=1e-10)
    over = loop.covariances([0.0, 50.0])
    np.testing.assert_allclose(over.x.mean[-1], [3.0, 0.0], atol=1e-8)


def test_the_variance_of_a_runs_cost_is_that_of_a_sum_of_gaussian_squares():
    """var Σ y'Wy = 2ΣΣ tr WC_klWC_lk + 4ΣΣ m_k'WC_klWm_l, over all pairs of instants."""
    steps, runs = 6, 10
    found = regulator(replace(MOTOR, x0=np.array([1.0, -0.5])), MOTOR_COST, dt=0.1)
    loop = found.closed
    n, size, m, _r = loop.sizes
    over, rows = followed(loop.model, steps), np.vstack([np.eye(n, n + size + m), loop.model.H[m:]])
    W, X, total = rows.T @ found.weights.joint @ rows, loop.model.Phi, 0.0
    for k in range(steps):
        for j in range(steps):
            first, last = min(k, j), max(k, j)
            C = np.linalg.matrix_power(X, last - first) @ over.P[first]  # cov(s_last, s_first)
            total += 2 * float(np.trace(W @ C @ W @ C.T)) + 4 * float(over.mean[last] @ W @ C @ W @ over.mean[first])
    many = ensemble(found, runs=runs, steps=steps, seed=1, progress=False)
    assert many.cost_sd == pytest.approx(np.sqrt(total / runs) / (steps * 0.1), rel=1e-12)
