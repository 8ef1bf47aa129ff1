"""The feedback of a known state against other routes: the filter of the transposed system, python-control, all inputs at once."""

from __future__ import annotations

from dataclasses import replace

import control
import numpy as np
import pytest

from ctlabs import ContinuousModel, Cost, DiscreteModel, discretise, steady_state
from ctlabs.regulation import lqr, sample
from tests.regulation.plants import INTEGRATOR, MOTOR, MOTOR_COST, continuous, discrete

pytestmark = pytest.mark.numerical

SEEDS = range(12)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_discrete_regulator_is_the_filter_of_the_transposed_system(seed):
    model, cost = discrete(seed)
    dual = DiscreteModel(model.Phi.T, cost.Qx, model.B.T, cost.Qu, N=cost.N, P0=np.eye(model.n))
    found, limit = lqr(model, cost), steady_state(dual)
    sd = np.sqrt(np.diag(limit.P_minus))
    assert np.abs((found.S - limit.P_minus) / np.outer(sd, sd)).max() < 1e-12
    assert np.abs(found.L - limit.K_pred.T).max() < 1e-12 * np.abs(found.L).max()


@pytest.mark.parametrize("seed", SEEDS)
def test_the_discrete_regulator_is_that_of_python_control(seed):
    model, cost = discrete(seed)
    L, _, poles = control.dlqr(model.Phi, model.B, cost.Qx, cost.Qu, cost.N)
    found = lqr(model, cost)
    assert np.allclose(found.L, L, rtol=0, atol=1e-9 * np.abs(L).max())
    assert np.allclose(np.sort_complex(poles), found.poles, atol=1e-6)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_continuous_regulator_is_that_of_python_control(seed):
    model, cost = continuous(seed)
    L, S, _ = control.lqr(model.F, model.B, cost.Qx, cost.Qu, cost.N)
    found = lqr(model, cost)
    assert np.allclose(found.L, L, rtol=0, atol=1e-8 * np.abs(L).max())
    assert np.allclose(found.S, S, rtol=0, atol=1e-8 * np.abs(S).max())


def all_at_once(model: DiscreteModel, cost: Cost, x0: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, float]:
    """The inputs of a finite horizon as one least-squares problem, with the disturbances known, and their cost."""
    steps, n, r = int(cost.horizon), model.n, model.r
    free, by_u = np.zeros((steps + 1, n)), np.zeros((steps + 1, n, steps * r))
    free[0] = x0
    for k in range(steps):
        free[k + 1], by_u[k + 1] = model.Phi @ free[k] + w[k], model.Phi @ by_u[k]
        by_u[k + 1][:, k * r : (k + 1) * r] += model.B
    H, g, c = np.zeros((steps * r, steps * r)), np.zeros(steps * r), 0.0
    own = cost.weights(model)
    for k in range(steps + 1):
        weight = cost.discount**k
        E = np.zeros((r, steps * r))
        if k < steps:
            E[:, k * r : (k + 1) * r] = np.eye(r)
        Q = own.Qx if k < steps else own.Qf
        H += weight * (by_u[k].T @ Q @ by_u[k] + by_u[k].T @ own.N @ E + E.T @ own.N.T @ by_u[k] + E.T @ own.Qu @ E)
        g += weight * (by_u[k].T @ Q @ free[k] + E.T @ own.N.T @ free[k])
        c += weight * float(free[k] @ Q @ free[k])
    u = -np.linalg.solve(H, g)
    return u.reshape(steps, r), c + float(g @ u)


@pytest.mark.parametrize("discount", [1.0, 0.8])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_finite_horizon_is_the_least_squares_of_all_inputs(seed, discount):
    model, cost = discrete(seed)
    cost = replace(cost, Qf=np.eye(model.n), horizon=6, discount=discount)
    found = lqr(model, cost)
    u, least = all_at_once(model, cost, model.x0, np.zeros((6, model.n)))
    assert np.allclose(-found.L[0] @ model.x0, u[0], rtol=0, atol=1e-9 * np.abs(u).max())
    assert found.S[0] @ model.x0 @ model.x0 == pytest.approx(least, rel=1e-10)
    # A disturbance known when the input acts: the first one only.
    w = np.zeros((6, model.n))
    w[0] = np.arange(1, model.n + 1)
    u, _ = all_at_once(model, cost, model.x0, w)
    assert np.allclose(-found.L[0] @ model.x0 - found.L_w[0] @ w[0], u[0], rtol=0, atol=1e-9 * np.abs(u).max())


@pytest.mark.parametrize("seed", SEEDS)
def test_the_steady_regulator_is_where_a_long_horizon_begins(seed):
    model, cost = discrete(seed)
    limit = lqr(model, cost)
    radius = np.abs(limit.poles).max()
    steps = int(np.ceil(np.log(1e-15) / np.log(min(radius, 0.999)) / 2)) + 20
    if steps > 4000:
        pytest.skip("the loop forgets too slowly")
    long = lqr(model, replace(cost, Qf=np.eye(model.n), horizon=steps))
    assert np.allclose(long.L[0], limit.L, rtol=0, atol=1e-10 * np.abs(limit.L).max())
    assert np.allclose(long.L_w[0], limit.L_w, rtol=0, atol=1e-10 * np.abs(limit.L_w).max())


@pytest.mark.parametrize("seed", range(6))
def test_a_discounted_regulator_is_that_of_a_plant_that_fades(seed):
    model, cost = discrete(seed)
    faded = replace(model, Phi=0.9 * model.Phi, B=0.9 * model.B)
    assert np.allclose(lqr(model, replace(cost, discount=0.81)).L, lqr(faded, cost).L, rtol=0, atol=1e-12)
    plant, price = continuous(seed)
    slower = replace(plant, F=plant.F - 0.25 * np.eye(plant.n))
    assert np.allclose(lqr(plant, replace(price, discount=np.exp(-0.5))).L, lqr(slower, price).L, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("seed", range(4))
def test_a_continuous_horizon_is_the_limit_of_short_periods(seed):
    model, cost = continuous(seed)
    cost = replace(cost, Qf=np.eye(model.n), horizon=1.0)
    S = lqr(model, cost, t=[0.0, 0.5, 1.0]).S
    off = []
    for periods in (200, 400):
        held = lqr(*sample(replace(model, N=None), cost, 1 / periods)).S[[0, periods // 2, periods]]
        off.append(np.abs(held - S).max() / np.abs(S).max())
    assert off[1] < 1e-3
    assert off[1] < 0.3 * off[0] or off[1] < 1e-9  # a held input costs more in the second order of the period


def test_inputs_that_cost_nothing_bring_the_least_variance():
    model = DiscreteModel([[2, 1], [0, 0.5]], np.eye(2), [[1, 0]], [[1]], B=[[1], [1]], P0=np.eye(2))
    found = lqr(model, Cost(np.diag([1.0, 0.0]), [[0.0]]))
    # x1 becomes w1 in one step; the plant's zero, 2 + 1·λ…, is hidden by the feedback where it is stable.
    assert np.allclose(found.L, [[2, 1]], atol=1e-10)


def test_a_fast_plant_is_right_to_its_digits():
    """|λ|dt = 50: against the same equations with 120 digits, of which Van Loan's exponential loses some 45."""
    import mpmath

    with mpmath.workdps(120):
        h, a = mpmath.mpf("0.5"), mpmath.mpf(100)
        # ẋ1 = x2, ẋ2 = −100 x2 + 100 u: the fast actuator of an integrator.
        model = ContinuousModel([[0, 1], [0, -100]], [[0], [1]], [[1]], [[1, 0]], B=[[0], [100]], P0=np.eye(2), Rc=[[1e-3]])
        F, B = mpmath.matrix([[0, 1], [0, -a]]), mpmath.matrix([0, a])
        big = mpmath.zeros(3)
        big[:2, :2], big[:2, 2] = F, B
        twice = mpmath.zeros(6)
        twice[:3, :3], twice[:3, 3:], twice[3:, 3:] = -big.T, mpmath.diag([1, mpmath.mpf("0.1"), mpmath.mpf("0.2")]), big
        loan = mpmath.expm(twice * h)
        weights = loan[3:, 3:].T * loan[:3, 3:]
        E = mpmath.expm(big * h)
        Phi, G = E[:2, :2], E[:2, 2]
        S = mpmath.eye(2)
        for _ in range(400):
            V = Phi.T * S * G + weights[:2, 2]
            W = (G.T * S * G)[0] + weights[2, 2]
            S = Phi.T * S * Phi + weights[:2, :2] - V * V.T / W
        L = (Phi.T * S * G + weights[:2, 2]) / ((G.T * S * G)[0] + weights[2, 2])
    plant, cost = sample(model, Cost(np.diag([1.0, 0.1]), [[0.2]]), 0.5)
    for i in range(3):
        for j in range(3):
            mine = np.block([[cost.Qx, cost.N], [cost.N.T, cost.Qu]])[i, j]
            assert mine == pytest.approx(float(weights[i, j]), rel=1e-12)
    assert np.allclose(lqr(plant, cost).L[0], [float(L[0]), float(L[1])], rtol=1e-10, atol=0)


def test_units_change_nothing_but_the_units():
    plant, cost = sample(MOTOR, MOTOR_COST, 0.1)
    found = lqr(plant, cost)
    for powers in ([9, -6], [-12, 3], [0, 15]):
        T = np.diag(10.0 ** np.array(powers))
        back = np.linalg.inv(T)
        other = DiscreteModel(T @ plant.Phi @ back, T @ plant.Qd @ T, plant.H @ back, plant.R, B=1e-4 * T @ plant.B, P0=T @ T)
        scaled = Cost(back @ cost.Qx @ back, 1e-8 * cost.Qu, 1e-4 * back @ cost.N)
        assert np.allclose(1e-4 * lqr(other, scaled).L @ T, found.L, rtol=1e-12, atol=0)


UNREACHED = DiscreteModel([[0.5, 0], [0, 1.2]], np.eye(2), [[1, 1]], [[1]], B=[[1], [0]], P0=np.eye(2), states=["a", "b"])
BAD = {
    "no B": (lambda: lqr(replace(MOTOR, B=None), MOTOR_COST), "model: expected B"),
    "indefinite Qx": (lambda: Cost(np.diag([1.0, -1.0]), [[1]]), "Qx: expected weights >= 0 on the diagonal, received -1"),
    "indefinite Qu": (lambda: Cost(np.eye(2), [[1, 2], [2, 1]]), "Qu: expected a nonnegative definite matrix"),
    "indefinite together": (lambda: Cost([[1]], [[1]], [[2]]), r"\[\[Qx, N\], \[N', Qu\]\]: expected a nonnegative definite"),
    "no Qu": (lambda: Cost([[1]]), "Cost: expected Qu"),
    "shape of Qx": (lambda: lqr(MOTOR, Cost(np.eye(3), [[1]])), r"Qx: expected shape \(2, 2\)"),
    "shape of Qu": (lambda: lqr(MOTOR, Cost(np.eye(2), np.eye(2))), r"Qu: expected shape \(1, 1\)"),
    "Qf without horizon": (lambda: Cost([[1]], [[1]], Qf=[[1]]), "Qf: expected a horizon"),
    "discount": (lambda: Cost([[1]], [[1]], discount=1.5), r"discount: expected a number in \(0, 1\]"),
    "unreached": (lambda: lqr(UNREACHED, Cost(np.eye(2), [[1]])), "eigenvalue 1.2 of the states b, which none reaches"),
    "unseen": (lambda: lqr(MOTOR, Cost(np.diag([0.0, 1.0]), [[1]])), "eigenvalue 0 of the states place, which it does not see"),
    "free input": (lambda: lqr(MOTOR, Cost(np.eye(2), [[0]])), "Qu: expected a positive definite matrix in continuous time"),
    "half a step": (lambda: lqr(UNREACHED, Cost(np.eye(2), [[1]], horizon=2.5)), "horizon: expected a whole number"),
    "half a period": (lambda: sample(MOTOR, Cost(np.eye(2), [[1]], horizon=1.05), 0.1), "horizon: expected a whole number of periods"),
    "unknown output": (lambda: lqr(MOTOR, Cost(Qu=[[1]], outputs={"speed": 1.0})), "outputs: expected a measurement"),
    "negative delay": (lambda: sample(MOTOR, MOTOR_COST, 0.1, delay=-1), "delay: expected a number >= 0"),
}


@pytest.mark.parametrize("what", BAD)
def test_what_cannot_be_is_refused(what):
    call, message = BAD[what]
    with pytest.raises(ValueError, match=message) as error:
        call()
    assert "\n" not in str(error.value)


def test_a_growing_mode_that_the_cost_does_not_see_asks_what_shall_become_of_it():
    model = DiscreteModel([[2, 0], [0, 0.5]], np.eye(2), [[1, 0]], [[1]], B=[[1], [0]], P0=np.eye(2))
    cost = Cost(np.diag([0.0, 1.0]), [[1]])
    with pytest.raises(ValueError, match="stabilise=True"):
        lqr(model, cost)
    assert np.allclose(lqr(model, cost, stabilise=True).poles, [0.5, 0.5])  # the mirror image of 2


def test_weights_of_outputs_are_weights_of_the_states_that_make_them():
    direct = Cost(np.diag([2.0, 0.0]), [[1]])
    for outputs in ({"place": 2.0}, [[2.0]], {"mine": ([1, 0], 2.0)}):
        assert np.array_equal(lqr(MOTOR, Cost(Qu=[[1]], outputs=outputs)).L, lqr(MOTOR, direct).L)
    through = replace(discretise(INTEGRATOR, 1.0, R=[[1]]), D=[[0.5]])
    own = Cost(Qu=[[1]], outputs=[[1.0]]).weights(through)
    assert (own.Qx[0, 0], own.N[0, 0], own.Qu[0, 0]) == (1.0, 0.5, 1.25)
