"""A sampled cost is the integral of the cost between the samples, whatever the delay."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import scipy.linalg

from ctlabs import ContinuousModel, Cost
from ctlabs.regulation import lqr, regulator, sample
from ctlabs.regulation.closed import closed
from ctlabs.regulation.design import loop_cost
from ctlabs.regulation.sampling import between
from tests.regulation.plants import INTEGRATOR, MOTOR, MOTOR_COST, continuous

pytestmark = pytest.mark.numerical

ROOT = np.sqrt(3.0)


def integral(model: ContinuousModel, cost: Cost, x: np.ndarray, pieces: list[tuple[float, np.ndarray]]) -> tuple[float, np.ndarray]:
    """The cost without noise from x under inputs held for given times, by Gauss's quadrature on fine pieces."""
    nodes, weights = np.polynomial.legendre.leggauss(20)
    own = cost.weights(model).joint
    n, total = model.n, 0.0
    A = scipy.linalg.block_diag(model.F, np.zeros((model.r, model.r)))
    A[:n, n:] = model.B
    for length, u in pieces:
        parts = max(1, int(np.ceil(4 * length * np.abs(np.linalg.eigvals(model.F)).max())))
        begin = np.concatenate([x, u])
        for i in range(parts):
            a, b = i * length / parts, (i + 1) * length / parts
            for node, weight in zip(nodes, weights, strict=True):
                y = scipy.linalg.expm(A * (0.5 * (a + b) + 0.5 * (b - a) * node)) @ begin
                total += 0.5 * (b - a) * weight * float(y @ own @ y)
        x = (scipy.linalg.expm(A * length) @ begin)[:n]
    return total, x


@pytest.mark.parametrize("late", [0.0, 0.13, 0.3, 0.3 + 1e-14, 0.47, 0.6, 0.75])
@pytest.mark.parametrize("seed", range(4))
def test_a_sampled_cost_is_the_integral_of_the_cost(seed, late):
    model, cost = continuous(seed)
    model = ContinuousModel(model.F, model.G, model.Q, model.H, Rc=model.Rc, B=model.B, P0=model.P0)
    h, steps, rng = 0.3, 5, np.random.default_rng(seed)
    plant, held = sample(model, cost, h, delay=late)
    x0, inputs = rng.normal(size=model.n), rng.normal(size=(steps, model.r))
    x, mine = np.concatenate([x0, np.zeros(plant.n - model.n)]), 0.0
    for u in inputs:
        mine += float(x @ held.Qx @ x + 2 * x @ held.N @ u + u @ held.Qu @ u)
        x = plant.Phi @ x + plant.B @ u
    # The same as one piecewise constant input: zero until the first one begins to act.
    acts = [(late + k * h, u) for k, u in enumerate(inputs)]
    marks = sorted({0.0, steps * h, *(t for t, _ in acts if t < steps * h)})
    pieces = []
    for a, b in pairwise(marks):
        present = [u for t, u in acts if t <= a + 1e-12]
        pieces.append((b - a, present[-1] if present else np.zeros(model.r)))
    total, end = integral(model, cost, x0, pieces)
    assert mine == pytest.approx(total, rel=1e-11)
    assert np.allclose(x[: model.n], end, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_noise_between_the_samples_costs_what_its_covariance_says(seed):
    model, cost = continuous(seed)
    h = 0.7
    nodes, weights = np.polynomial.legendre.leggauss(30)
    from ctlabs.models.discretisation import interval

    W = model.G @ model.Q @ model.G.T
    total = sum(0.5 * h * w * np.trace(cost.Qx @ interval(model.F, W, 0.5 * h * (1 + x)).Qd) for x, w in zip(nodes, weights, strict=True))
    assert between(model, cost.Qx, h) == pytest.approx(total, rel=1e-12)


def test_noise_between_the_samples_of_a_chain_and_of_a_fast_mode():
    chain = ContinuousModel(np.diag([1.0, 1], 1), [[0], [0], [1]], [[1]], [[1, 0, 0]], P0=np.eye(3))
    assert between(chain, np.diag([1.0, 0, 0]), 1e-3) == pytest.approx(1e-18 / 120, rel=1e-12, abs=0)  # ∫ s⁵/20
    for rate in (-1e5, -50.0, 50.0):
        h = 1.0
        model = ContinuousModel([[rate]], [[1]], [[2]], [[1]], P0=[[1]])
        a = 2 * rate
        assert between(model, np.eye(1), h) == pytest.approx(2 * (np.expm1(a * h) / a - h) / a, rel=1e-11)


@pytest.mark.parametrize("h", [1e-6, 0.1, 1.0, 1e4])
def test_the_integrators_least_variance(h):
    """L h = (3+√3)/(2+√3), and the mean cost per second is (3+√3)/6 of the period."""
    found = regulator(INTEGRATOR, Cost([[1]], [[0]]), dt=h, R=[[0]])
    assert found.L[0, 0] * h == pytest.approx((3 + ROOT) / (2 + ROOT), rel=1e-12)
    assert found.cost.value / h == pytest.approx((3 + ROOT) / 6, rel=1e-12)
    assert found.cost.spread < 1e-12


@pytest.mark.parametrize(("h", "J"), [(0.025, 1.038359), (0.1, 1.040965), (0.25, 1.055809), (0.5, 1.111583)])
def test_the_sampled_motor(h, J):
    found = regulator(MOTOR, MOTOR_COST, dt=h)
    assert found.cost.value == pytest.approx(J, abs=5e-7)
    assert found.cost.spread < 1e-12


def test_the_continuous_motor():
    found = regulator(MOTOR, MOTOR_COST)
    assert found.cost.value == pytest.approx(1.03818585506075, rel=1e-14)
    assert found.cost.spread < 1e-12


def test_without_the_cross_term_a_sampled_regulator_costs_more():
    """The integrator's deadbeat, optimal where the cost is counted at the samples only, costs 5/6 of the period instead of (3+√3)/6."""
    plant, cost = sample(INTEGRATOR, Cost([[1]], [[0]]), 0.5, R=[[0]])
    naive = lqr(plant, Cost([[1]], [[0]]))
    assert naive.L[0, 0] * 0.5 == pytest.approx(1.0, rel=1e-12)
    own = regulator(INTEGRATOR, Cost([[1]], [[0]]), dt=0.5, R=[[0]])
    deadbeat = replace(own.machine, C=0 * own.machine.C, D=-naive.L, A=0 * own.machine.A, B=np.zeros((1, 1)))
    found = loop_cost(closed(plant, deadbeat), own.weights, 0, None, cost.constant) / 0.5
    assert found == pytest.approx(5 / 6 * 0.5, rel=1e-12)


def test_a_delay_costs_and_its_inputs_are_known():
    costs = [regulator(MOTOR, MOTOR_COST, dt=0.1, delay=late).cost.value for late in (0.0, 0.03, 0.1, 0.25)]
    assert costs == sorted(costs)
    found = regulator(MOTOR, MOTOR_COST, dt=0.1, delay=0.25)
    assert found.plant.states == ("place", "speed", "input 1, 1 before", "input 1, 2 before", "input 1, 3 before")
    assert np.array_equal(found.estimator.P_plus[2:], np.zeros((3, 5)))
    # A whole period late is the regulator that answers the measurement before.
    delayed = regulator(MOTOR, MOTOR_COST, dt=0.1, kind="delayed").cost.value
    assert regulator(MOTOR, MOTOR_COST, dt=0.1, delay=0.1).cost.value == pytest.approx(delayed, rel=1e-12)
