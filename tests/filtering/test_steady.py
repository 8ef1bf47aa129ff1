"""The steady filter: limits of the recursion, both gains, closed forms of labs 1, 7 and 16, and what has no limit."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from numpy.typing import NDArray

from ctlabs.filtering import covariances, kalman_filter, settling, settling_step, steady
from ctlabs.models import DiscreteModel
from tests.reference import EXACT, SOLVER, broken, close, recursion
from tests.strategies import covariance, discrete_models, transition

pytestmark = pytest.mark.numerical

Array = NDArray[Any]
properties = settings(deadline=None, max_examples=15, derandomize=True)


def scalar(Phi: float, Q: float, R: float, P0: float = 10.0) -> DiscreteModel:
    return DiscreteModel([[Phi]], [[Q]], [[1]], [[R]], x0=[0], P0=[[P0]])


def riccati(P: Array, model: DiscreteModel) -> Array:
    """ΦPΦᵀ + Qd − K_p S K_pᵀ with K_p = (ΦPHᵀ + N)S⁻¹."""
    N = np.zeros((model.n, model.m)) if model.N is None else model.N
    S = model.H @ P @ model.H.T + model.R
    cross = model.Phi @ P @ model.H.T + N
    return model.Phi @ P @ model.Phi.T + model.Qd - cross @ np.linalg.solve(S, cross.T)


@properties
@given(discrete_models(stable=None, singular=False, varying=False, offset=False))
def test_steady_state_is_the_limit_of_the_schedule(model: DiscreteModel) -> None:
    """P⁻, P⁺, K and S after many steps, for stable and unstable models, with and without N."""
    limit, plan = steady.solve(model), covariances(model, 400, algorithm="filterpy")
    assert (np.abs(limit.poles) < 0.97).all(), "the strategy is meant to give filters that settle within 400 steps"
    for name in ("P_minus", "P_plus", "K", "S"):
        assert close(getattr(limit, name), getattr(plan, name)[-1], SOLVER)
        assert not close(broken(getattr(limit, name)), getattr(plan, name)[-1], 1e-3)


@properties
@given(discrete_models(stable=None, singular=False, varying=False, offset=False))
def test_steady_covariance_satisfies_the_riccati_equation(model: DiscreteModel) -> None:
    """P⁻ is a fixed point of the recursion, and not after a change of 5 %."""
    P = steady.solve(model).P_minus
    assert close(riccati(P, model), P, 1e-10)
    assert not close(riccati(broken(P), model), broken(P), 1e-5)


@properties
@given(discrete_models(stable=None, singular=False, varying=False, offset=False))
def test_the_two_gains_and_the_poles(model: DiscreteModel) -> None:
    """K = P⁻HᵀS⁻¹, K_pred = ΦK + NS⁻¹, poles = eigenvalues of Φ − K_pred H, inside the unit circle."""
    limit = steady.solve(model)
    N = np.zeros((model.n, model.m)) if model.N is None else model.N
    assert close(limit.K, limit.P_minus @ model.H.T @ np.linalg.inv(limit.S), EXACT)
    assert close(limit.K_pred, model.Phi @ limit.K + N @ np.linalg.inv(limit.S), EXACT)
    assert not close(limit.K_pred, model.Phi @ broken(limit.K) + N @ np.linalg.inv(limit.S), 1e-6)
    poles = np.sort_complex(np.linalg.eigvals(model.Phi - limit.K_pred @ model.H))
    assert close(limit.poles, poles, SOLVER)
    assert (np.abs(limit.poles) < 1).all()


@properties
@given(discrete_models(stable=True, singular=False, varying=False, correlated=True, offset=False))
def test_predictor_gain_is_the_textbooks(model: DiscreteModel) -> None:
    """x̂⁻ of the textbook's predictor, in the steady state, moves as Φx̂⁻ + K_pred ν."""
    limit = steady.solve(model)
    z = np.random.default_rng(4).normal(size=(203, model.m))
    x = recursion(model, z).x_minus
    nu = z[-2] - model.H @ x[-2]
    assert close(x[-1], model.Phi @ x[-2] + limit.K_pred @ nu, SOLVER)
    assert not close(x[-1], model.Phi @ x[-2] + 1.05 * (limit.K_pred @ nu), 1e-6)


# --- closed forms -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("Phi", [-1.5, -1.0, -0.3, 0.0, 1e-3, 0.78, 1.0, 1.2, 3.0])
@pytest.mark.parametrize("ratio", [1e-3, 0.1, 0.78, 8.0, 1e4])
def test_scalar_gain_is_that_of_lab_7(Phi: float, ratio: float) -> None:
    """K = {−(λ+1−Φ²) + √[(λ+1−Φ²)² + 4Φ²λ]}/(2Φ²), λ/(1+λ) at Φ = 0; P⁺ = KR."""
    R = 0.5
    b = ratio + 1 - Phi**2
    K = (2 * ratio) / (b + np.sqrt(b**2 + 4 * Phi**2 * ratio))  # the same root, without cancellation where b > 0
    if b < 0:
        K = (-b + np.sqrt(b**2 + 4 * Phi**2 * ratio)) / (2 * Phi**2)
    limit = steady.solve(scalar(Phi, ratio * R, R))
    assert close(limit.K, K, 1e-10)
    assert close(limit.P_plus, K * R, 1e-10)
    assert close(limit.K_pred, Phi * K, 1e-10)
    assert not close(limit.K, 1.05 * K, 1e-3)


@pytest.mark.parametrize("ratio", [0.01, 0.1, 1.0, 10.0, 100.0])
def test_random_walk_is_that_of_labs_1_and_16(ratio: float) -> None:
    """P⁻ = [Q + √(Q² + 4QR)]/2, P⁺ = P⁻ − Q, K = [−ρ + √(ρ² + 4ρ)]/2, the pole is 1 − K."""
    R = 16.0
    Q = ratio * R
    limit = steady.solve(scalar(1.0, Q, R))
    K = (-ratio + np.sqrt(ratio**2 + 4 * ratio)) / 2
    assert close(limit.P_minus, (Q + np.sqrt(Q**2 + 4 * Q * R)) / 2, EXACT)
    assert close(limit.P_plus, limit.P_minus - Q, EXACT)
    assert close(limit.K, K, 1e-11)
    assert close(limit.poles, 1 - K, 1e-11)


@pytest.mark.parametrize("tau", [0.1, 1.0, 5.0])
def test_tracking_gains_satisfy_the_relations_of_lab_3(tau: float) -> None:
    """α = K1, β = K2 τ: β²/(1−α) = qτ³/R and α² + αβ + β²/6 − 2β = 0."""
    q, R = 2.0, 0.7
    Qd = q * np.array([[tau**3 / 3, tau**2 / 2], [tau**2 / 2, tau]])
    limit = steady.solve(DiscreteModel([[1, tau], [0, 1]], Qd, [[1, 0]], [[R]], x0=[0, 0], P0=np.eye(2), dt=tau))
    alpha, beta = limit.K[0, 0], limit.K[1, 0] * tau
    assert close(beta**2 / (1 - alpha), q * tau**3 / R, SOLVER)
    assert abs(alpha**2 + alpha * beta + beta**2 / 6 - 2 * beta) < SOLVER
    assert abs(alpha**2 + alpha * beta + (1.05 * beta) ** 2 / 6 - 2 * 1.05 * beta) > 1e-4


def test_perfect_and_absent_measurements_have_limits() -> None:
    """R = 0: P⁺ = 0, P⁻ = Q; R = ∞ on a stable model: P⁻ of the Lyapunov equation, K = 0."""
    perfect = steady.solve(scalar(0.9, 0.4, 0.0))
    assert perfect.P_plus.tolist() == [[0]]
    assert close(perfect.P_minus, 0.4, EXACT)
    assert close(perfect.K, 1, EXACT)
    absent = steady.solve(scalar(0.9, 0.4, np.inf))
    assert close(absent.P_minus, 0.4 / (1 - 0.81), EXACT)
    assert close(absent.P_plus, absent.P_minus, EXACT)
    assert absent.K.tolist() == [[0]]
    assert close(absent.poles, 0.9, EXACT)


# --- modes that no noise drives ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("Phi", "H"),
    [
        ([[1.0]], [[1.0]]),
        ([[-1.0]], [[1.0]]),
        ([[0.5]], [[1.0]]),
        ([[1.0, 1.0], [0.0, 1.0]], [[1.0, 0.0]]),
        ([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]]),
        ([[np.cos(1.0), np.sin(1.0)], [-np.sin(1.0), np.cos(1.0)]], [[1.0, 0.0]]),
    ],
    ids=["constant", "alternating", "decay", "double integrator", "triple integrator", "oscillator"],
)
def test_without_disturbances_what_does_not_grow_becomes_known(Phi: Any, H: Any) -> None:
    """Q = 0 and |λ| ≤ 1: P → 0, K → 0, and the recursion indeed goes there like 1/k."""
    n = len(Phi)
    model = DiscreteModel(Phi, np.zeros((n, n)), H, [[2.0]], x0=np.zeros(n), P0=np.eye(n))
    limit = steady.solve(model)
    assert not limit.P_minus.any()
    assert not limit.P_plus.any()
    assert not limit.K.any()
    P = covariances(model, 800, algorithm="filterpy").P_plus
    assert np.trace(P[800]) < 0.6 * np.trace(P[400]) < 0.4 * np.trace(P[200])
    assert np.trace(P[800]) < 0.1


@pytest.mark.parametrize("Phi", [1.01, -1.2, 3.0])
def test_without_disturbances_what_grows_keeps_an_error(Phi: float) -> None:
    """Q = 0 and |Φ| > 1: P⁺ → (Φ² − 1)R/Φ², from P0 > 0."""
    R = 0.5
    model = scalar(Phi, 0.0, R)
    limit = steady.solve(model)
    assert close(limit.P_plus, (Phi**2 - 1) * R / Phi**2, 1e-10)
    assert close(limit.poles, 1 / Phi, 1e-10)
    assert close(covariances(model, 2000, algorithm="filterpy").P_plus[-1], limit.P_plus, SOLVER)
    assert not close(broken(limit.P_plus), (Phi**2 - 1) * R / Phi**2, 1e-3)


@pytest.mark.parametrize("seed", range(6))
def test_driven_and_undriven_modes_together(seed: int) -> None:
    """A constant beside driven states, in a random basis: zero along the constant, the driven states' limit elsewhere."""
    rng = np.random.default_rng(seed)
    A, T = transition(rng, 2, stable=True), rng.normal(size=(3, 3)) + 2 * np.eye(3)
    Phi = np.block([[A, np.zeros((2, 1))], [np.zeros((1, 2)), np.ones((1, 1))]])
    Qd = np.zeros((3, 3))
    Qd[:2, :2] = covariance(rng, 2)
    H, R = rng.normal(size=(1, 3)), [[0.6]]
    inverse = np.linalg.inv(T)
    mixed = DiscreteModel(T @ Phi @ inverse, T @ Qd @ T.T, H @ inverse, R, x0=np.zeros(3), P0=np.eye(3))
    found = inverse @ steady.solve(mixed).P_minus @ inverse.T
    driven = steady.solve(DiscreteModel(A, Qd[:2, :2], H[:, :2], R, x0=np.zeros(2), P0=np.eye(2))).P_minus
    assert close(found[:2, :2], driven, SOLVER)
    assert np.abs(found[2]).max() < SOLVER * np.abs(driven).max()


@pytest.mark.parametrize(("R", "N"), [(2.0, 1.0), (0.3, 0.1)])
def test_a_disturbance_known_from_the_noise_drives_nothing(R: float, N: float) -> None:
    """Qd = NR⁻¹N and |Φ − N/R| < 1: P → 0 exactly although Qd > 0, and K_pred = N/R."""
    limit = steady.solve(DiscreteModel([[0.9]], [[N * N / R]], [[1]], [[R]], x0=[0], P0=[[1]], N=[[N]]))
    assert limit.P_minus.tolist() == [[0]]
    assert close(limit.K_pred, N / R, EXACT)


def test_a_disturbance_known_from_the_noise_may_still_feed_an_error() -> None:
    """Qd = NR⁻¹N and |a| > 1 with a = Φ − N/R: P⁺ → (a² − 1)R/a², as without disturbances."""
    R, N = 0.7, -0.3
    a = 0.9 - N / R
    limit = steady.solve(DiscreteModel([[0.9]], [[N * N / R]], [[1]], [[R]], x0=[0], P0=[[1]], N=[[N]]))
    assert close(limit.P_plus, (a**2 - 1) * R / a**2, 1e-10)


# --- no limit ---------------------------------------------------------------------------------------------------


def refusal(model: Any) -> str:
    with pytest.raises(ValueError, match=r"^steady state: ") as caught:
        steady.solve(model)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_an_unobserved_mode_is_named() -> None:
    """Its eigenvalue and its states are in the message: a wandering bias, a sum of two walks, an unseen oscillation."""
    model = DiscreteModel(
        np.diag([0.5, 1.0]), np.eye(2), [[1, 0]], [[1]], x0=[0, 0], P0=np.eye(2), states=["speed", "bias"]
    )
    message = refusal(model)
    assert "1 of the states bias" in message
    assert "speed" not in message
    walks = DiscreteModel(np.eye(2), np.eye(2), [[1, 1]], [[1]], x0=[0, 0], P0=np.eye(2))
    assert "1 of the states x1, x2" in refusal(walks)
    c, s = np.cos(1.0), np.sin(1.0)
    hidden = DiscreteModel(
        [[0.3, 0, 0], [0, c, s], [0, -s, c]],
        np.eye(3),
        [[1, 0, 0]],
        [[1]],
        x0=[0, 0, 0],
        P0=np.eye(3),
        states=["a", "b", "c"],
    )
    assert "0.540302 ± 0.841471i of the states b, c" in refusal(hidden)
    assert "1 of the states x1" in refusal(scalar(1.0, 1.0, np.inf))


def test_a_decaying_unobserved_mode_is_no_obstacle() -> None:
    """Detectability is enough: the unseen state keeps its stationary variance."""
    model = DiscreteModel(np.diag([0.5, 1.0]), np.eye(2), [[0, 1]], [[1]], x0=[0, 0], P0=np.eye(2))
    P = steady.solve(model).P_minus
    assert close(P[0, 0], 1 / (1 - 0.25), EXACT)
    assert close(P[1, 1], (1 + np.sqrt(5)) / 2, EXACT)


def test_a_varying_model_has_no_steady_state() -> None:
    """Matrices that vary, and models of another kind, are refused."""
    varying = replace(scalar(1.0, 1.0, 1.0), Phi=[[[1.0]], [[0.5]]])
    with pytest.raises(ValueError, match=r"^model: expected constant matrices, received some that vary over 2 steps$"):
        steady.solve(varying)
    with pytest.raises(TypeError, match=r"^model: expected a DiscreteModel, received a str$"):
        steady.solve("model")  # type: ignore[arg-type]  # refused


# --- transfer function and settling -------------------------------------------------------------------------------


def impulse_response(num: Array, den: Array, length: int) -> Array:
    """Long division of num(z⁻¹)/den(z⁻¹)."""
    response = np.zeros(length)
    for k in range(length):
        response[k] = (num[k] if k < len(num) else 0.0) - sum(
            den[i] * response[k - i] for i in range(1, min(k, len(den) - 1) + 1)
        )
    return response / den[0]


@properties
@given(discrete_models(stable=None, singular=False, varying=False, offset=False))
def test_transfer_function_is_the_filters_response_to_an_impulse(model: DiscreteModel) -> None:
    """The steady gains applied to a unit impulse in one measurement give the quotient's series, from every measurement."""
    model, length = replace(model, x0=np.zeros(model.n)), 12
    limit, plan = steady.solve(model), covariances(model, length - 1, first=0, algorithm="filterpy")
    constant = replace(plan, K=np.array([limit.K] * length))
    z = np.zeros((length, model.m, model.m))
    z[0] = np.eye(model.m)
    response = kalman_filter(model, z, first=0, algorithm="filterpy", gains=constant).x_plus
    for state in range(model.n):
        for measurement in range(model.m):
            num, den = steady.transfer_function(model, state, measurement)
            assert len(num) == len(den) == model.n + 1
            assert den[0] == 1
            expected = response[:, state, measurement]
            assert close(impulse_response(num, den, length), expected, SOLVER, size=np.abs(response).max())
            assert not close(impulse_response(broken(num), den, length), expected, 1e-3)


def test_transfer_function_is_that_of_lab_16() -> None:
    """K/(1 − (1−K)z⁻¹), and its static gain is one for a random walk."""
    num, den = steady.transfer_function(scalar(1.0, 4.0, 16.0))
    K = (np.sqrt(17) - 1) / 8
    assert close(num, [K, 0], EXACT)
    assert close(den, [1, K - 1], EXACT)
    assert close(num.sum() / den.sum(), 1, EXACT)


def test_settling_is_counted_from_the_last_step_outside_the_band() -> None:
    """A later excursion counts, a value at the end outside means not settled, a zero limit needs exact zeros."""
    assert settling_step([[1.0], [1.005], [1.02], [1.0]], [1.0]) == 3
    assert settling_step([[1.0], [1.005]], [1.0]) == 0
    assert settling_step([[1.0], [2.0]], [1.0]) is None
    assert settling_step([[1.0, 2.0], [1.0, 1.0], [1.0, 1.0]], [1.0, 1.0]) == 1
    assert settling_step([[1.0], [0.0], [0.0]], [0.0]) == 1
    assert settling_step([[1.0], [1.005], [1.02], [1.0]], [1.0], within=0.05) == 0


def test_settling_of_the_labs() -> None:
    """Steps within 1 % of the limit: 3 in lab 1, 5 in lab 3, 6 in lab 4 (by the schedule), none for P like 1/k."""
    assert settling(scalar(1.0, 1.0, 1.0)) == 3
    two = DiscreteModel(
        [[1, 1], [0, 1]], [[1 / 3, 1 / 2], [1 / 2, 1]], [[1, 0]], [[1]], x0=[0, 0], P0=np.diag([100, 10])
    )
    assert settling(two) == 5
    Qd = [[1 / 20, 1 / 8, 1 / 6], [1 / 8, 1 / 3, 1 / 2], [1 / 6, 1 / 2, 1]]
    three = DiscreteModel(
        [[1, 1, 0.5], [0, 1, 1], [0, 0, 1]], Qd, [[1, 0, 0]], [[1]], x0=np.zeros(3), P0=np.diag([100, 10, 1])
    )
    assert settling(three) == 6
    assert settling(scalar(1.0, 0.0, 1.0)) is None
    assert settling(scalar(1.0, 1.0, 0.0)) == 1
    assert settling(scalar(1.0, 1.0, 0.0), first=0) == 0
    slow = scalar(1.0, 1e-6, 1.0, P0=0.0)
    plan, limit = covariances(slow, 5000, algorithm="filterpy").P_plus[:, :, 0], np.diag(steady.solve(slow).P_plus)
    assert settling(slow) == settling_step(plan, limit) > 1000


@properties
@given(discrete_models(stable=True, singular=False, varying=False, offset=False))
def test_after_settling_the_variances_stay_in_the_band(model: DiscreteModel) -> None:
    """From the step found on all variances are within 1 %, and just before it one is not."""
    step, limit = settling(model), np.diag(steady.solve(model).P_plus)
    assert step is not None
    values = np.diagonal(covariances(model, step + 50, algorithm="filterpy").P_plus, axis1=1, axis2=2)
    inside = (np.abs(values - limit) <= 0.01 * limit).all(axis=1)
    assert inside[step:].all()
    assert step == 1 or not inside[step - 1]


@pytest.mark.parametrize("across", [30.0, 3e3, 3e4])
def test_slow_filters_with_double_poles_have_a_limit(across: float) -> None:
    """Motion in a plane, measured 10 m along and ``across`` m across a direction: two filters of one coordinate, turned."""
    Phi, Q = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[4 / 3, 2.0], [2.0, 4.0]])
    turn = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
    R = turn @ np.diag([100.0, across**2]) @ turn.T
    two = np.eye(2)
    plane = DiscreteModel(
        np.kron(two, Phi), np.kron(two, Q), np.kron(two, [[1, 0]]), R, x0=np.zeros(4), P0=1e3 * np.eye(4)
    )
    apart = [
        steady.solve(DiscreteModel(Phi, Q, [[1, 0]], [[r]], x0=[0, 0], P0=1e3 * two)).P_minus
        for r in (100.0, across**2)
    ]
    wanted = sum(np.kron(np.outer(c, c), P) for c, P in zip(turn.T, apart, strict=True))
    assert close(steady.solve(plane).P_minus, wanted, SOLVER)
    assert not close(steady.solve(replace(plane, R=1.05 * R)).P_minus, wanted, SOLVER)


def test_a_measurement_that_repeats_another_with_its_noise_changes_nothing() -> None:
    """One sensor, read twice: K and S of the first alone; a second one with a noise of its own is used."""
    twice = DiscreteModel([[1]], [[1]], [[1], [1]], [[1, 1], [1, 1]], x0=[0], P0=[[1]])
    found, alone = steady.solve(twice), steady.solve(scalar(1.0, 1.0, 1.0))
    assert close(found.P_plus, alone.P_plus, EXACT)
    assert close(found.K, [[alone.K[0, 0], 0]], EXACT)
    assert np.isinf(found.S[1, 1])
    assert steady.solve(replace(twice, R=[[1, 0.5], [0.5, 1]])).P_plus[0, 0] < 0.99 * alone.P_plus[0, 0]


@pytest.mark.parametrize("R", [[[0.5, 0.1], [0.1, 2e20]], [[1e-20, 0], [0, 1]], [[1e-10, 0], [0, 1e20]]])
@pytest.mark.parametrize("H", [np.eye(2), [[1, 0], [1, 1]]])
def test_noises_of_very_different_size_have_the_recursions_limit(R: Any, H: Any) -> None:
    """A sensor that says next to nothing beside a precise one; no library's warning gets out."""
    model = DiscreteModel([[1, 1], [0, 1]], [[0.1, 0], [0, 0.1]], H, R, x0=[0, 0], P0=np.eye(2))
    wanted = covariances(model, 400, algorithm="filterpy").P_minus[-1]
    assert close(steady.solve(model).P_minus, wanted, SOLVER)
    assert not close(steady.solve(replace(model, Qd=1.05 * model.Qd)).P_minus, wanted, SOLVER)
