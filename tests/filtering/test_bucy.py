"""The Kalman–Bucy filter: the flow of the Riccati equation, its limit, its transfer function, settling."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import mpmath
import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from ctlabs.filtering import bucy, steady
from ctlabs.models import ContinuousModel
from ctlabs.models.discretisation import discretise
from tests.reference import EXACT, SOLVER, Array, as_floats, broken, close, order
from tests.strategies import continuous_models

pytestmark = pytest.mark.numerical

I2 = np.eye(2)
PRINTED = 6e-6  # the practicum's values have five decimals or six digits


def wiener(Q: float = 4.0, R: float = 16.0, P0: float = 25.0) -> ContinuousModel:
    """Lab 16."""
    return ContinuousModel([[0]], [[1]], [[Q]], [[1]], Rc=[[R]], P0=[[P0]])


def autopilot() -> ContinuousModel:
    """Lab 13: two stiff orders between P0, which is singular, and the steady state; an undriven mode at 0."""
    q = np.array([1, -0.294, 1])
    return ContinuousModel(
        F=[[-0.006, 1, 0.3], [-0.003, 0, 0.003], [0, 0, 0]],
        G=[[0.3], [0.003], [0]],
        Q=[[1296]],
        H=[[1, 0, 0]],
        Rc=[[6561]],
        P0=22500**2 * np.outer(q, q),
        states=["h", "x2", "h_c0"],
    )


def coloured(P0: Array = I2) -> ContinuousModel:
    """The example of the coloured plant noise."""
    return ContinuousModel([[-1, 1], [0, -2]], [[0], [1]], [[4]], [[1, 0]], Rc=[[0.5]], P0=P0)


def correlated(P0: Array = I2) -> ContinuousModel:
    """An oscillator whose two disturbances are correlated, with each other and with the measurement's noise."""
    return ContinuousModel(
        [[0, 1], [-1, -0.2]], I2, [[1, 0.2], [0.2, 1]], [[1, 0]], Rc=[[0.5]], N=[[0.5], [-0.3]], P0=P0
    )


def two_wieners() -> ContinuousModel:
    """Lab 17's trap: only the sum is measured."""
    return ContinuousModel(0 * I2, I2, I2, [[1, 1]], Rc=[[2]], P0=np.diag([1, 2]))


def derivative(model: ContinuousModel, P: Array) -> Array:
    """The right side of the Riccati equation, term by term."""
    N = np.zeros((model.s, model.m)) if model.N is None else model.N
    gain = (P @ model.H.T + model.G @ N) @ np.linalg.inv(model.Rc)
    return model.F @ P + P @ model.F.T + model.G @ model.Q @ model.G.T - gain @ model.Rc @ gain.T


def integrated(model: ContinuousModel, t: Array) -> Array:
    """P(t) by a Runge–Kutta method of order 8."""
    n = model.n
    run = scipy.integrate.solve_ivp(
        lambda _, p: derivative(model, p.reshape(n, n)).ravel(),
        (0, t[-1]),
        model.P0.ravel(),
        "DOP853",
        t,
        rtol=1e-12,
        atol=1e-13 * max(1.0, np.abs(model.P0).max()),
    )
    return run.y.T.reshape(-1, n, n)


def hamiltonian(model: ContinuousModel, t: float, digits: int) -> Array:
    """P(t) = XY⁻¹ from the exponential of the Hamiltonian matrix with so many digits."""
    n = model.n
    N = np.zeros((model.s, model.m)) if model.N is None else model.N
    with mpmath.workdps(digits):
        F, G, Q, H, Rc, N, P0 = (
            mpmath.matrix(M.tolist()) for M in (model.F, model.G, model.Q, model.H, model.Rc, N, model.P0)
        )
        M = mpmath.zeros(2 * n)
        M[:n, :n] = F - G * N * Rc**-1 * H
        M[:n, n:] = G * (Q - N * Rc**-1 * N.T) * G.T
        M[n:, :n] = H.T * Rc**-1 * H
        M[n:, n:] = -M[:n, :n].T
        E = mpmath.expm(M * mpmath.mpf(t))
        return as_floats((E[:n, :n] * P0 + E[:n, n:]) * (E[n:, :n] * P0 + E[n:, n:]) ** -1)


def scaled_error(P: Array, exact: Array) -> float:
    """The largest error of an element, in units of the standard deviations of its two states."""
    sd = np.sqrt(np.diag(exact))
    return float((np.abs(P - exact) / np.outer(sd, sd)).max())


# --- the transient ---------------------------------------------------------------------------------------------------


def test_wiener_process_follows_the_closed_form():
    """P(t) = P∞ (P0 + P∞ tanh ωt)/(P∞ + P0 tanh ωt) with P∞ = √(QR), ω = √(Q/R), at any time."""
    t = np.array([0, 1e-9, 0.5, 1, 2, 5, 5.5, 100, 1e5])
    found = bucy.transient(wiener(), t)
    tanh = np.tanh(0.5 * t)
    assert np.abs(found.P[:, 0, 0] / (8 * (25 + 8 * tanh) / (8 + 25 * tanh)) - 1).max() <= EXACT
    assert np.abs(found.P[[2, 3, 4, 5], 0, 0] - [15.27121, 11.74123, 9.19909, 8.05573]).max() <= PRINTED
    assert np.array_equal(found.K, found.P / 16)
    assert np.array_equal(found.sd, np.sqrt(found.P[:, :, 0]))
    assert not close(bucy.transient(wiener(P0=25 * 1.05), t).P, found.P, SOLVER)


@pytest.mark.parametrize("R", [1.0, 2.0, 4.0])
def test_unstable_plant_follows_its_hyperbolic_tangent(R):
    """Lab 20: Ṗ = 2P + 1 − P²/R from P0 = 1, to R(1 + √(1 + 1/R))."""
    model = ContinuousModel([[1]], [[1]], [[1]], [[1]], Rc=[[R]], P0=[[1]])
    t = np.array([0.25, 0.5, 1, 2, 1e4])
    w = math.sqrt(1 + 1 / R)
    tanh = np.tanh(w * t)
    expected = R + R * w * ((1 - R) / (R * w) + tanh) / (1 + (1 - R) / (R * w) * tanh)
    assert close(bucy.transient(model, t).P[:, 0, 0], expected, EXACT)
    if R == 2:
        assert abs(expected[2] - 3.61448) <= PRINTED
    assert close(bucy.steady(model).P, R * (1 + w), EXACT)


def test_autopilot_is_stiff_and_starts_singular():
    """Lab 13: P11 and P33 at 1, 10, 60, 300 s from a singular P0 that is 10⁵ times the later values."""
    model = autopilot()
    t = np.array([1.0, 10, 60, 300])
    P = bucy.transient(model, t).P
    assert np.abs(P[:, 2, 2] - [6599.841, 997.041, 367.574, 31.540]).max() <= 6e-4
    exact = np.array([hamiltonian(model, s, 60) for s in t])
    assert max(map(scaled_error, P, exact)) <= SOLVER
    assert 1.03 < P[3, 0, 0] / 850.1199 < 1.04


def test_coloured_plant_values():
    """The two-state example: diag(1, 1) at 0 becomes the printed covariance at 0.25 and in the limit."""
    P = bucy.transient(coloured(), [0.25]).P[0]
    assert np.abs(P - [[0.467182, 0.155300], [0.155300, 0.996155]]).max() <= PRINTED
    limit = bucy.steady(coloured()).P
    assert np.abs(limit - [[0.226862, 0.278328], [0.278328, 0.961267]]).max() <= PRINTED


def test_constant_state_loses_variance_by_information():
    """F = Q = 0: P⁻¹(t) = P0⁻¹ + t HᵀRc⁻¹H, for a billion seconds too."""
    H, Rc = np.array([[1.0, 2.0], [0.5, -1.0]]), np.array([[2.0, 0.3], [0.3, 1.0]])
    P0 = np.array([[4.0, 1.0], [1.0, 2.0]])
    model = ContinuousModel(0 * I2, I2, 0 * I2, H, Rc=Rc, P0=P0)
    for t in (1e-6, 1.0, 1e3, 1e9):
        P = bucy.transient(model, [t]).P[0]
        expected = np.linalg.inv(np.linalg.inv(P0) + t * H.T @ np.linalg.inv(Rc) @ H)
        assert close(P, expected, EXACT)
        assert not close(broken(P), expected, SOLVER)


def test_unmeasured_sum_is_exact_and_the_difference_grows():
    """Lab 17: with only x1 + x2 measured, P11 + 2P12 + P22 follows the scalar filter and the difference is lost."""
    t = np.array([0.25, 0.5, 1, 2, 1e4])
    P = bucy.transient(two_wieners(), t).P
    total = P.sum(axis=(1, 2))
    assert np.abs(total[:4] - [2.55221, 2.31768, 2.11128, 2.01471]).max() <= PRINTED
    scalar = bucy.transient(wiener(2, 2, 3), t)
    assert np.abs(total / scalar.P[:, 0, 0] - 1).max() <= 1e-10
    reference = integrated(two_wieners(), t[:4])
    assert close(P[:4], reference, 1e-10)
    assert abs((P[4, 0, 0] - P[3, 0, 0]) / ((1e4 - 2) / 2) - 1) <= 1e-3


@given(continuous_models(stable=None))
@settings(max_examples=25)
def test_flow_agrees_with_runge_kutta(model):
    """P(t) on an uneven grid equals the integrated equation, with and without N, singular Q or P0, unstable plants."""
    t = np.array([0.0, 0.01, 0.3, 0.37, 1.0])
    found = bucy.transient(model, t)
    size = max(np.abs(found.P).max(), np.abs(model.G @ model.Q @ model.G.T).max())
    assert np.abs(found.P - integrated(model, t)).max() <= 1e-9 * size
    N = np.zeros((model.s, model.m)) if model.N is None else model.N
    assert close(found.K, (found.P @ model.H.T + model.G @ N) @ np.linalg.inv(model.Rc), 1e-11)
    assert np.array_equal(found.P, np.swapaxes(found.P, 1, 2))


@given(continuous_models(stable=None), st.floats(0.01, 3), st.floats(0.01, 3))
@settings(max_examples=25)
def test_flow_is_a_semigroup(model, first, second):
    """Going on from P(s) for t gives P(s + t); from another P(s) it does not."""
    whole = bucy.transient(model, [first, first + second]).P
    onward = bucy.transient(replace(model, P0=whole[0]), [second]).P[0]
    assert close(onward, bucy.transient(model, [first + second]).P[0], 1e-10)
    assert close(onward, whole[1], 1e-10)


@given(continuous_models(stable=None))
@settings(max_examples=15)
def test_times_in_between_change_nothing(model):
    """One interval is the same as a hundred."""
    fine = bucy.transient(model, np.linspace(0.01, 1.0, 100)).P[-1]
    assert close(fine, bucy.transient(model, [1.0]).P[0], 1e-11)


@given(continuous_models(stable=None))
@settings(max_examples=15)
def test_more_variance_at_the_start_never_means_less_later(model):
    """P0 ⪯ P0' gives P(t) ⪯ P'(t)."""
    t = [0.1, 1.0, 10.0]
    more = bucy.transient(replace(model, P0=model.P0 + np.eye(model.n)), t).P
    less = bucy.transient(model, t).P
    lowest = np.linalg.eigvalsh(more - less).min(axis=1)
    assert (lowest >= -1e-11 * np.abs(more).max(axis=(1, 2))).all()


STIFF = ContinuousModel(
    [[-1e6, 1, 0], [0, -1, 1], [0, 0, -1e-3]],
    np.eye(3),
    np.diag([1e3, 1, 1e-3]),
    [[1, 1, 0], [0, 0, 1]],
    Rc=np.diag([1, 1e-3]),
    P0=1e6 * np.eye(3),
)
UNDRIVEN_UNSTABLE = ContinuousModel([[1, 0.3], [0.2, -2]], I2, 0 * I2, [[1, 0.7]], Rc=[[1]], P0=[[4, 1], [1, 2]])
HARD = {
    "P0 a million times the limit": wiener(P0=8e6),
    "triple integrator from P0 = 0": ContinuousModel(
        np.diag([1.0, 1.0], 1), [[0], [0], [1]], [[1]], [[1, 0, 0]], Rc=[[1]], P0=np.zeros((3, 3))
    ),
    "unstable and hardly driven": ContinuousModel(
        [[1, 0.3, 0.1], [0.2, -2, 0.5], [0.1, 0.1, -0.3]],
        np.eye(3),
        np.diag([0, 1e-8, 1]),
        [[1, 0.7, 0.2]],
        Rc=[[1]],
        P0=[[4, 1, 0], [1, 2, 0], [0, 0, 1]],
    ),
    "unstable and undriven": UNDRIVEN_UNSTABLE,
    "undriven chain at 0": ContinuousModel(
        [[0, 1, 0], [0, 0, 0], [0, 0, -1]],
        np.eye(3),
        np.diag([0, 0, 1]),
        [[1, 0, 1]],
        Rc=[[1]],
        P0=np.diag([1e6, 1e6, 1]),
    ),
    "correlated noises": correlated(1e6 * I2),
    "mixed units": ContinuousModel(
        [[0, 1, 0, 0], [3e-6, 0, 0, 1.4e4], [0, 0, 0, 1], [0, -2e-3 / 7e6, 0, 0]],
        np.eye(4)[:, [1, 3]],
        np.diag([1e-8, 1e-20]),
        [[1, 0, 0, 0], [0, 0, 1, 0]],
        Rc=np.diag([1.5e5, 6e-7]),
        P0=np.diag([1e6, 1, 1e-8, 1e-14]),
    ),
}


@pytest.mark.parametrize("name", HARD)
@pytest.mark.parametrize("t", [1e-6, 0.5, 30.0, 300.0])
def test_hard_models_agree_with_many_digits(name, t):
    """Each element is right to 1e-11 of its standard deviations, compared with 700 digits."""
    model = HARD[name]
    exact = hamiltonian(model, t, 700)
    assert scaled_error(bucy.transient(model, [t]).P[0], exact) <= 1e-11
    assert scaled_error(broken(exact), exact) > 1e-11


@pytest.mark.parametrize("t", [1e-8, 1e-6, 1e-4])
def test_stiff_model_agrees_with_many_digits(t):
    """Time constants from 1e-6 s to 1000 s, P0 a billion times the fast state's limit."""
    assert scaled_error(bucy.transient(STIFF, [t]).P[0], hamiltonian(STIFF, t, 200)) <= 1e-11


@pytest.mark.parametrize(
    "model", [wiener(), STIFF, UNDRIVEN_UNSTABLE, coloured(), correlated(), HARD["unstable and hardly driven"]]
)
def test_after_ten_thousand_time_constants_the_limit_stands(model):
    """P(1e4 s) is the solution of the algebraic equation, however many fast time constants that are."""
    limit = bucy.steady(model).P
    assert scaled_error(bucy.transient(model, [1e4]).P[0], limit) <= 1e-11
    assert scaled_error(broken(limit), limit) > 1e-11


def test_fast_unstable_undriven_mode_beside_a_slow_one():
    """A hundred million time constants of an unstable mode that only its measurement holds."""
    model = ContinuousModel(np.diag([1e4, -1]), I2, np.diag([0, 1]), [[1, 1]], Rc=[[1]], P0=I2)
    assert scaled_error(bucy.transient(model, [1e4]).P[0], bucy.steady(model).P) <= 1e-11
    assert scaled_error(bucy.transient(model, [1e-3]).P[0], hamiltonian(model, 1e-3, 100)) <= 1e-11


def test_zero_stays_zero():
    """P0 = 0, Q = 0: nothing is uncertain, in an unstable model too."""
    model = ContinuousModel([[1, 2], [0, -1]], I2, 0 * I2, [[1, 0]], Rc=[[1]], P0=0 * I2)
    assert not bucy.transient(model, [1.0, 1e4]).P.any()


def test_known_unmeasured_unstable_mode_stays_known():
    """An unstable mode that is not measured, not driven and known at the start does not disturb the others."""
    model = ContinuousModel(np.diag([1, -1]), I2, np.diag([0, 1]), [[0, 1]], Rc=[[1]], P0=np.diag([0, 1]))
    P = bucy.transient(model, [1e4]).P[0]
    assert close(P, np.diag([0, math.sqrt(2) - 1]), EXACT)


def test_overflow_is_reported_with_its_time():
    """An unstable mode that is not measured overflows: the message has the time."""
    model = ContinuousModel(np.diag([1, -1]), I2, I2, [[0, 1]], Rc=[[1]], P0=I2)
    with pytest.raises(FloatingPointError, match=r"^P: expected finite .*, received an overflow by t = 10000 s$"):
        bucy.transient(model, [1.0, 1e4])


def test_perfectly_correlated_noise_is_known_from_the_measurement():
    """With w = v the disturbance is read off the measurement: Ṗ = (F−H)P·2 − P²/Rc, and P → 0 if F < H."""
    model = ContinuousModel([[0.5]], [[1]], [[2]], [[1]], Rc=[[2]], N=[[2]], P0=[[3]])
    t = np.array([0.5, 1.0, 5.0])
    assert close(bucy.transient(model, t).P[:, 0, 0], 1 / ((1 / 3 + 1 / 2) * np.exp(t) - 1 / 2), EXACT)
    assert bucy.steady(model).P[0, 0] == 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"Rc": None}, r"^Rc: expected the strength .*, received None"),
        ({"Rc": [[0]]}, r"^Rc: expected a positive definite matrix, received a singular one"),
    ],
)
def test_gain_needs_a_regular_measurement_noise(change, message):
    """Without Rc, or with perfect measurements, the gain is infinite and the message says what to do."""
    with pytest.raises(ValueError, match=message):
        bucy.transient(replace(wiener(), **change), [1.0])


def test_singular_strength_of_two_measurements_is_refused():
    """Two measurements with the same noise contain a perfect one."""
    model = ContinuousModel(0 * I2, I2, I2, I2, Rc=[[1, 1], [1, 1]], P0=I2)
    with pytest.raises(ValueError, match="positive definite"):
        bucy.steady(model)


@pytest.mark.parametrize("t", [[1.0, 1.0], [2.0, 1.0], [-1.0, 1.0]])
def test_times_must_increase_from_zero(t):
    """Times are given in order, and not before P0."""
    with pytest.raises(ValueError, match=re.escape(f"t: expected increasing times >= 0, received {t}")):
        bucy.transient(wiener(), t)


def test_many_wrong_times_are_not_all_printed():
    """The message stays one line."""
    with pytest.raises(ValueError, match=r"received 10 … 1$"):
        bucy.transient(wiener(), np.linspace(10, 1, 50))


def test_discrete_model_is_refused():
    """A covariance never passes for a strength."""
    with pytest.raises(TypeError, match="expected a ContinuousModel"):
        bucy.transient(discretise(wiener(), 1.0), [1.0])


def test_no_times_give_no_points():
    """An empty grid is a grid."""
    assert bucy.transient(wiener(), []).P.shape == (0, 1, 1)


# --- the steady state ------------------------------------------------------------------------------------------------


@given(continuous_models(stable=None))
@settings(max_examples=25)
def test_steady_state_is_the_limit_of_the_transient(model):
    """From P0 > 0, and it solves the algebraic equation with stable filter poles; 5 % off it does not."""
    limit = bucy.steady(model)
    slowest = -limit.poles.real.max()
    last = bucy.transient(replace(model, P0=np.eye(model.n)), [40 / slowest]).P[0]
    assert close(last, limit.P, SOLVER)
    size = np.abs(model.F).max() * np.abs(limit.P).max() + np.abs(model.G @ model.Q @ model.G.T).max()
    assert np.abs(derivative(model, limit.P)).max() <= SOLVER * size
    assert np.array_equal(limit.P, limit.P.T)
    if size > 1e-6:
        wrong = broken(limit.P) if limit.P.any() else limit.P + 0.05 * np.eye(model.n)
        assert np.abs(derivative(model, wrong)).max() > SOLVER * size


def test_steady_wiener_process():
    """P = √(QR), Kc = √(Q/R), one pole at −Kc."""
    limit = bucy.steady(wiener())
    assert close(limit.P, 8, EXACT)
    assert close(limit.K, 0.5, EXACT)
    assert close(limit.poles, -0.5, EXACT)


def test_autopilot_limit_comes_from_its_driven_part():
    """Lab 13: the constant command becomes known; altitude and gain tend to those of the two-state model."""
    limit = bucy.steady(autopilot())
    assert abs(limit.P[0, 0] - 850.1199) <= 6e-5
    assert abs(limit.K[0, 0] - 0.1295717) <= 6e-8
    assert not limit.P[2].any()
    assert not limit.P[:, 2].any()
    assert limit.K[2, 0] == 0
    assert np.abs(1 / np.sort(-limit.poles.real)[1:] - [31.7, 9.6]).max() <= 0.05
    two = ContinuousModel([[-0.006, 1], [-0.003, 0]], [[0.3], [0.003]], [[1296]], [[1, 0]], Rc=[[6561]], P0=I2)
    assert close(bucy.steady(two).P, limit.P[:2, :2], EXACT)


def test_undriven_unstable_mode_keeps_a_variance():
    """Lab 19 with β < 0: P → 2|β|Rc although nothing drives the state; with β ≥ 0 it tends to 0."""
    for F, expected in ((0.7, 1.4), (0.0, 0.0), (-0.7, 0.0)):
        model = ContinuousModel([[F]], [[1]], [[0]], [[1]], Rc=[[1]], P0=[[1]])
        limit = bucy.steady(model)
        assert abs(limit.P[0, 0] - expected) <= EXACT
        assert close(limit.poles, F - expected, EXACT)


def test_undriven_jordan_chain_is_taken_out_whole():
    """An undriven constant velocity: position and velocity both become known."""
    limit = bucy.steady(HARD["undriven chain at 0"])
    assert close(limit.P, np.diag([0, 0, math.sqrt(2) - 1]), EXACT)


def test_limit_without_information_is_the_stationary_covariance():
    """A stable plant seen through H = 0 has the covariance of its Lyapunov equation."""
    model = replace(coloured(), H=[[0, 0]])
    F, W = model.F, model.G @ model.Q @ model.G.T
    assert close(bucy.steady(model).P, scipy.linalg.solve_continuous_lyapunov(F, -W), EXACT)
    assert not bucy.steady(model).K.any()


@pytest.mark.parametrize(
    ("model", "mode"),
    [
        (two_wieners(), "eigenvalue 0 of the states x1, x2"),
        (
            ContinuousModel(np.diag([0.5, -1]), I2, I2, [[0, 1]], Rc=[[1]], P0=I2, states=["fuel", "height"]),
            "eigenvalue 0.5 of the states fuel",
        ),
        (
            ContinuousModel(
                [[0, 2, 0], [-2, 0, 0], [0, 0, -1]], np.eye(3), np.eye(3), [[0, 0, 1]], Rc=[[1]], P0=np.eye(3)
            ),
            "eigenvalue 0 ± 2i of the states x1, x2",
        ),
    ],
)
def test_undetectable_mode_is_named(model, mode):
    """Where there is no limit the message says which eigenvalue and which states."""
    with pytest.raises(ValueError, match=re.escape(f"received the mode {mode}, which no measurement sees")):
        bucy.steady(model)


@pytest.mark.parametrize("q", [1e-100, 1e-30, 1e-8])
def test_hardly_driven_marginal_mode_has_its_limit(q):
    """√(QRc) of a constant, and of an oscillator P12 = q/(1 + √(1 + q)), P11 = √(2 P12), however small the noise."""
    assert bucy.steady(wiener(Q=q)).P[0, 0] == pytest.approx(
        math.sqrt(q) * math.sqrt(wiener().Rc[0, 0]), rel=1e-14, abs=0
    )
    if q < 1e-50:
        return
    P = bucy.steady(ContinuousModel([[0, 1], [-1, 0]], [[0], [1]], [[q]], [[1, 0]], Rc=[[1]], P0=I2)).P
    across = q / (1 + math.sqrt(1 + q))
    assert P[0, 1] == pytest.approx(across, rel=1e-14, abs=0)
    assert P[0, 0] == pytest.approx(math.sqrt(2 * across), rel=1e-14, abs=0)


def test_undetectable_but_stable_mode_is_in_order():
    """A mode that nobody measures and that decays keeps its stationary variance."""
    model = ContinuousModel(np.diag([-1, -2]), I2, I2, [[1, 0]], Rc=[[1]], P0=I2)
    assert close(bucy.steady(model).P, np.diag([math.sqrt(2) - 1, 0.25]), EXACT)


def test_discrete_steady_gain_tends_to_the_continuous_one_at_first_order():
    """K/dt − Kc halves with dt, for measurements with R = Rc/dt."""
    model = coloured()
    Kc = bucy.steady(model).K
    errors = [np.abs(steady.solve(discretise(model, dt)).K / dt - Kc).max() for dt in (0.02, 0.01, 0.005, 0.0025)]
    assert np.abs(order(errors) - 1).max() <= 0.05
    assert np.abs(order([e + 0.05 * Kc.max() for e in errors]) - 1).max() > 0.05


# --- transfer function, settling -------------------------------------------------------------------------------------


def test_transfer_function_of_the_wiener_filter():
    """0.5/(s + 0.5)."""
    num, den = bucy.transfer_function(wiener())
    assert close(num, [0.5], EXACT)
    assert close(den, [1, 0.5], EXACT)


@given(continuous_models(stable=None), st.integers(0, 3), st.integers(0, 2))
@settings(max_examples=25)
def test_transfer_function_is_the_response_of_the_filter(model, state, measurement):
    """num/den = (sI − F + KcH)⁻¹Kc at points of the complex plane; the python-control system agrees."""
    state, measurement = min(state, model.n - 1), min(measurement, model.m - 1)
    limit, system = bucy.steady(model), bucy.filter_system(model)
    num, den = bucy.transfer_function(model, state, measurement)
    assert den[0] == 1
    assert len(den) == model.n + 1
    assert num[0] != 0 or len(num) == 1
    size = 1 + np.abs(limit.poles).max()
    for s in size * np.array([2.0, 1 + 2j, 3j]):
        direct = np.linalg.solve(s * np.eye(model.n) - model.F + limit.K @ model.H, limit.K)
        scale = np.abs(direct).max() or 1.0
        assert abs(np.polyval(num, s) / np.polyval(den, s) - direct[state, measurement]) <= SOLVER * scale
        assert close(system(s, squeeze=False), direct, SOLVER)


def test_filter_system_has_the_names_of_the_model():
    """Inputs are the measurements, outputs the estimates, and it is continuous."""
    system = bucy.filter_system(autopilot())
    assert system.input_labels == ["z1"]
    assert system.output_labels == ["h_hat", "x2_hat", "h_c0_hat"]
    assert system.isctime(strict=True)


def test_transfer_function_without_gain_is_zero():
    """The known constant of the autopilot gets nothing from the measurement."""
    num, den = bucy.transfer_function(autopilot(), state=2)
    assert num.tolist() == [0.0]
    assert len(den) == 4


def test_settling_time_of_the_wiener_process():
    """P(t) = 1.01·P∞ solved by hand: tanh ωt = (P0 − 1.01 P∞)P∞/(1.01 P∞P0 − P∞²), 4.640 s."""
    expected = 2 * math.atanh((25 - 8.08) / (8.08 * 25 / 8 - 8))
    found = bucy.settling_time(wiener())
    assert abs(found / expected - 1) <= 1e-8
    assert round(found, 3) == 4.640
    assert abs(bucy.settling_time(wiener(), within=0.0105) / expected - 1) > 1e-6


@given(continuous_models(stable=None, singular=False))
@settings(max_examples=5)
def test_settling_time_is_the_last_entry_into_the_band(model):
    """On the settling time one variance is on the edge of the band, and none leaves it afterwards."""
    found = bucy.settling_time(model)
    limit = np.diag(bucy.steady(model).P)

    def outside(t: Array) -> Array:
        return (np.abs(np.diagonal(bucy.transient(model, t).P, axis1=1, axis2=2) / limit - 1) / 0.01).max(axis=1)

    assert found is not None
    if found > 0:
        assert abs(outside(np.array([found]))[0] - 1) <= 1e-6
    assert outside(found + np.geomspace(1e-6, 50, 200) * max(found, 1)).max() <= 1 + 1e-6


def test_swing_back_out_of_the_band_counts():
    """A variance that passes its limit and returns settles on the return, between samples or not."""
    model = ContinuousModel([[0, 1], [-1, -0.1]], [[0], [1]], [[1]], [[1, 0]], Rc=[[10]], P0=np.diag([0, 10]))
    found, limit = bucy.settling_time(model), bucy.steady(model).P
    t = np.linspace(0, 2 * found, 4001)
    outside = np.abs(np.diagonal(bucy.transient(model, t).P, axis1=1, axis2=2) / np.diag(limit) - 1).max(axis=1) > 0.01
    assert t[2000] - t[outside].max() <= 1.01 * t[1]
    assert not outside[2001:].any()
    assert (np.diff(outside.astype(int)) == 1).sum() == 5


@pytest.mark.parametrize("within", [0.0101, 0.05])
def test_peak_between_samples_is_found(within):
    """A band whose edge is just below a peak of the swing is left by it, whatever the samples show."""
    model = ContinuousModel([[0, 1], [-1, -0.1]], [[0], [1]], [[1]], [[1, 0]], Rc=[[10]], P0=np.diag([0, 10]))
    limit = np.diag(bucy.steady(model).P)
    t = np.linspace(0, 40, 4001)
    off = np.abs(np.diagonal(bucy.transient(model, t).P, axis1=1, axis2=2) / limit - 1).max(axis=1)
    peaks = np.flatnonzero((off[1:-1] > off[:-2]) & (off[1:-1] >= off[2:])) + 1
    peak = peaks[off[peaks] > within][-1]
    assert abs(bucy.settling_time(model, within=off[peak] * (1 - 1e-6)) - t[peak]) <= 0.1
    assert bucy.settling_time(model, within=off[peak] * (1 + 1e-4)) < t[peak] - 0.3


def test_zero_limit_never_settles():
    """A variance that tends to zero leaves every band around it; one that is zero from the start is settled."""
    assert bucy.settling_time(autopilot()) is None
    assert bucy.settling_time(wiener(Q=0)) is None
    assert bucy.settling_time(wiener(Q=0, P0=0)) == 0.0
    known = ContinuousModel(np.diag([0, -1]), I2, np.diag([4, 0]), [[1, 1]], Rc=[[16]], P0=np.diag([25, 0]))
    assert abs(bucy.settling_time(known) / bucy.settling_time(wiener()) - 1) <= 1e-8


def test_start_in_the_steady_state_is_settled():
    """P0 = P∞: no time at all."""
    assert bucy.settling_time(coloured(bucy.steady(coloured()).P)) == 0.0


def test_settling_without_a_limit_is_refused():
    """No limit, no settling."""
    with pytest.raises(ValueError, match="no measurement sees"):
        bucy.settling_time(two_wieners())


def test_band_finer_than_arithmetic_is_never_reached():
    """A band below rounding gives None instead of an endless search."""
    assert bucy.settling_time(wiener(Q=3.7, R=1.3), within=1e-300) is None
