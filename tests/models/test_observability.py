"""Observability: evidence that does not depend on units, what sampling loses, Gramians."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from ctlabs.linalg import undriven
from ctlabs.linalg.staircase import growing
from ctlabs.models import ContinuousModel, DiscreteModel
from ctlabs.models.discretisation import discretise
from ctlabs.models.observability import Mode, analyse, gramian, loss_by_sampling, undetectable
from tests.reference import EXACT, SOLVER, Array, broken, close
from tests.strategies import continuous_models, discrete_models, seeds

pytestmark = pytest.mark.numerical

I2 = np.eye(2)


def pair(F: Array, H: Array, **names: list[str]) -> ContinuousModel:
    """A model of which only F and H matter."""
    n = len(F)
    return ContinuousModel(F, np.eye(n), np.eye(n), H, P0=np.eye(n), **names)


def sampled(Phi: Array, H: Array) -> DiscreteModel:
    """A discrete model of which only Φ and H matter."""
    n = len(Phi)
    return DiscreteModel(Phi, np.eye(n), H, np.eye(len(H)), x0=np.zeros(n), P0=np.eye(n))


def swing() -> ContinuousModel:
    """The oscillator with unit frequency, position measured."""
    return pair([[0, 1], [-1, 0]], [[1, 0]])


def orbit(sensors: str, r0: float = 7.0e6) -> tuple[ContinuousModel, float]:
    """Lab 18: deviations (r, ṙ, θ, θ̇) from a circular orbit in metres and radians, and its period."""
    w = math.sqrt(3.986004418e14 / r0**3) if r0 > 1 else 1.0
    F = [[0, 1, 0, 0], [3 * w**2, 0, 0, 2 * r0 * w], [0, 0, 0, 1], [0, -2 * w / r0, 0, 0]]
    H = {"angle": [[0, 0, 1, 0]], "range": [[1, 0, 0, 0]], "both": [[1, 0, 0, 0], [0, 0, 1, 0]]}[sensors]
    return pair(F, H, states=["r", "r_dot", "theta", "theta_dot"]), 2 * math.pi / w


def matrix_rank(A: Array, H: Array) -> int:
    """Rank of the observability matrix of a small well-scaled pair."""
    rows = [H]
    while len(rows) < len(A):
        rows.append(rows[-1] @ A)
    return int(np.linalg.matrix_rank(np.vstack(rows), tol=1e-8))


# --- one pair --------------------------------------------------------------------------------------------------------


def test_swing_is_observable():
    """Every piece of the evidence of an observable pair."""
    seen = analyse(swing())
    assert close(seen.eigenvalues, [-1j, 1j], EXACT)
    assert seen.ranks == (2, 2)
    assert (seen.sigma_min > 0.1).all()
    assert seen.unobservable.shape == (2, 0)
    assert (seen.rank, seen.ok, seen.detectable) == (2, True, True)
    assert seen.unobservable_modes == seen.undetectable_modes == ()


def test_hidden_modes_are_told_apart_by_decay():
    """A hidden mode that decays leaves the model detectable; one that does not is named as undetectable."""
    F = scipy.linalg.block_diag([[0, 2], [-2, 0]], [[-3]], [[-1]])
    seen = analyse(pair(F, [[0, 0, 0, 1]]))
    assert (seen.rank, seen.ok, seen.detectable) == (1, False, False)
    assert set(seen.unobservable_modes) == {"eigenvalue 0 ± 2i of the states x1, x2", "eigenvalue -3 of the states x3"}
    assert seen.undetectable_modes == ("eigenvalue 0 ± 2i of the states x1, x2",)
    assert seen.ranks == (3, 4, 3, 3)
    assert analyse(pair(F, [[1, 0, 0, 1]])).detectable
    assert not analyse(pair(F, [[1, 0, 0, 1]])).ok


def test_marginal_discrete_mode_is_undetectable():
    """|λ| = 1 does not decay, |λ| = 0.99 does."""
    assert not analyse(sampled(np.diag([-1, 0.5]), [[0, 1]])).detectable
    assert analyse(sampled(np.diag([0.99, 0.5]), [[0, 1]])).detectable


@given(seeds, st.integers(1, 5), st.integers(0, 3), st.integers(1, 2))
@settings(max_examples=40)
def test_subspace_is_found_in_any_coordinates(seed, n, hidden, m):
    """A pair built with a known unobservable subspace, in random coordinates: rank, basis, modes."""
    rng = np.random.default_rng(seed)
    d = min(hidden, n - 1)
    A, H = rng.normal(size=(n, n)), rng.normal(size=(m, n))
    A[d:, :d], H[:, :d] = 0, 0  # the first d coordinates are never seen
    T = np.linalg.qr(rng.normal(size=(n, n)))[0]
    seen = analyse(sampled(T @ A @ T.T, H @ T.T))
    assert seen.rank == n - d
    assert close(seen.unobservable @ seen.unobservable.T, T[:, :d] @ T[:, :d].T, SOLVER) or d == 0
    assert close(seen.unobservable.T @ seen.unobservable, np.eye(d), EXACT)
    assert close(np.poly(seen.eigenvalues), np.poly(A), SOLVER)
    assert sum(rank < n for rank in seen.ranks) == d
    assert len(seen.unobservable_modes) == (np.linalg.eigvals(A[:d, :d]).imag >= 0).sum()


@given(continuous_models())
@settings(max_examples=30)
def test_random_pairs_are_observable(model):
    """A random F with a random H is observable, unless a row is taken away from it."""
    assert analyse(model).ok
    assert analyse(model).rank == matrix_rank(model.F / np.linalg.norm(model.F), model.H)
    assert analyse(replace(model, H=0 * model.H)).rank == 0


@given(discrete_models(varying=False), st.lists(st.integers(-40, 40), min_size=7, max_size=7))
@settings(max_examples=30)
def test_units_change_nothing(model, powers):
    """States and measurements in units of 2^k: the same ranks, the same singular values."""
    d, e = np.exp2(powers[: model.n]), np.exp2(powers[4 : 4 + model.m])
    other = sampled(model.Phi * d[:, None] / d, model.H / d * e[:, None])
    first, second = analyse(sampled(model.Phi, model.H)), analyse(other)
    assert first.ranks == second.ranks
    assert np.abs(np.log(first.sigma_min / second.sigma_min)).max() <= 3  # the scaling is rounded to powers of 2


def test_units_of_time_change_nothing():
    """The same swing in microseconds and in years."""
    plain = analyse(swing())
    for rate in (1e-12, 1e9):
        model = pair([[0, rate], [-rate, 0]], [[1, 0]])
        assert analyse(model).ok
        assert close(analyse(model).sigma_min, plain.sigma_min, EXACT)


def test_sigma_min_is_the_distance_to_a_loss():
    """Two modes seen through the same combination: sigma_min falls with their distance."""
    found = [analyse(pair(np.diag([-1, -1 - gap]), [[1, 1]])).sigma_min.min() for gap in (1e-1, 1e-3, 1e-5, 0)]
    assert found[0] > found[1] > found[2] > 1e-7
    assert found[3] <= 1e-15
    assert np.abs(np.log10(np.array(found[:2]) / found[1:3]) - 2).max() <= 0.2


def test_repeated_eigenvalues_do_not_disturb():
    """A chain of integrators is seen through its first state only; from the second on, the first is hidden."""
    for n in (2, 3, 6):
        F = np.diag(np.ones(n - 1), 1)
        assert analyse(pair(F, np.eye(n)[:1])).ok
        seen = analyse(pair(F, np.eye(n)[1:2]))
        assert seen.rank == n - 1
        assert close(seen.unobservable, np.eye(n)[:, :1], EXACT)
        assert seen.undetectable_modes == ("eigenvalue 0 of the states x1",)
    damped = np.array([[0, 1], [-1, -2.0]])  # critically: a double eigenvalue, known to 1e-8
    assert analyse(pair(damped, [[1, 0]])).ok
    assert analyse(pair(damped, [[1, 1]])).rank == 1  # the measurement is a left mode


def test_rounding_in_place_of_zero_is_no_coupling():
    """A coupling of 1e-17 beside elements of 1 is a zero, one of 1e-6 is not."""
    assert analyse(pair([[-1, 1e-17], [1e-17, -2]], [[1, 0]])).rank == 1
    assert analyse(pair([[-1, 1e-17], [0, -2]], [[1, 0]])).rank == 1
    assert analyse(pair([[-1, 1e-6], [0, -2]], [[1, 0]])).rank == 2


def test_elements_not_measured_do_not_count():
    """R = ∞ takes a row of H away."""
    model = sampled(np.diag([0.5, 0.2]), I2)
    assert analyse(model).ok
    assert analyse(replace(model, R=np.diag([1, np.inf]))).rank == 1
    assert analyse(replace(model, R=np.diag([np.inf, np.inf]))).rank == 0


def test_varying_model_is_refused():
    """One pair is analysed, not a sequence of them; a varying Qd does not matter."""
    model = sampled(np.diag([0.5, 0.2]), I2)
    with pytest.raises(ValueError, match="model: expected constant Phi, H and R, received some that vary over 3 steps"):
        analyse(replace(model, Phi=np.array([I2] * 3)))
    assert analyse(replace(model, Qd=np.array([I2] * 3))).ok
    with pytest.raises(TypeError, match="expected a DiscreteModel, received a int"):
        analyse(3)


# --- the orbit of lab 18, and sampling -------------------------------------------------------------------------------


@pytest.mark.parametrize("r0", [1.0, 7.0e6, 4.2e7])
@pytest.mark.parametrize(
    ("sensors", "rank", "half", "full"), [("angle", 4, 3, 2), ("range", 3, 2, 1), ("both", 4, 4, 3)]
)
def test_orbit_ranks(r0, sensors, rank, half, full):
    """Ranks 4/3/4; sampled at half a period 3/2/4, at a full one 2/1/3, in metres and radians as they are."""
    model, period = orbit(sensors, r0)
    assert analyse(model).rank == rank
    for dt, expected in ((period / 2, half), (period, full), (2 * period, full), (0.31 * period, rank)):
        loss = loss_by_sampling(model, dt)
        assert loss.rank == expected
        assert loss.rank_continuous == rank
        assert loss.lost == (expected < rank)
        assert analyse(discretise(model, dt, R=np.eye(model.m))).rank == expected


def test_range_never_shows_the_angle():
    """With the range alone the angle's offset is hidden, exactly."""
    model, _ = orbit("range")
    seen = analyse(model)
    assert seen.unobservable.tolist() == [[0.0], [0.0], [1.0], [0.0]]
    assert seen.undetectable_modes == ("eigenvalue 0 of the states theta",)


@pytest.mark.parametrize("dt", [2 * math.pi, math.pi, 4 * math.pi, 200 * math.pi])
def test_swing_sampled_with_its_period_is_lost(dt):
    """sin(2π) is not 0 on a computer, and yet the velocity is never seen."""
    loss = loss_by_sampling(swing(), dt)
    assert loss.lost
    assert loss.pairs == ((-1j, 1j),)
    assert loss.distance <= 1e-15
    assert loss.sampled.undetectable_modes == (f"eigenvalue {round(math.cos(dt))} of the states x2",)
    seen = analyse(discretise(swing(), dt, R=[[1]]))
    assert seen.rank == 1
    assert close(seen.unobservable, [[0], [1]], EXACT)


def test_swing_sampled_near_its_period_is_seen_badly():
    """At 6.2 s nothing is lost, but sigma_min says how little is left, in proportion to the distance."""
    loss, nearer = loss_by_sampling(swing(), 6.2), loss_by_sampling(swing(), 6.283)
    assert not loss.lost
    assert loss.pairs == ()
    assert loss.losing_periods == (2 * math.pi,)
    assert abs(loss.distance - (1 - 6.2 / (2 * math.pi))) <= EXACT
    assert 0.05 < loss.sampled.sigma_min.min() < 0.2
    ratio = nearer.sampled.sigma_min.min() / loss.sampled.sigma_min.min()
    assert 0.5 < ratio / (nearer.distance / loss.distance) < 2
    assert loss_by_sampling(swing(), math.pi / 2).losing_periods == (math.pi,)


def test_many_periods_are_still_a_loss():
    """A thousand periods: the phase is known to a thousand roundings only."""
    assert loss_by_sampling(swing(), 2000 * math.pi).lost
    assert not loss_by_sampling(swing(), 2000 * math.pi + 0.01).lost


def test_two_measurements_may_save_what_one_loses():
    """The condition on the eigenvalues is met, yet position and velocity together lose nothing."""
    loss = loss_by_sampling(pair(swing().F, I2), 2 * math.pi)
    assert loss.pairs == ((-1j, 1j),)
    assert not loss.lost


def test_real_or_differently_damped_modes_cannot_meet():
    """Without a pair on one vertical line no period is dangerous."""
    for F in (np.diag([-1, -2]), np.diag([-1, -1 - 1e-3])):
        loss = loss_by_sampling(pair(F, [[1, 1]]), 3.0)
        assert (loss.losing_periods, loss.distance, loss.lost) == ((), math.inf, False)


def test_two_swings_of_different_frequency_meet_too():
    """Frequencies 1 and 3 on one line: differences 2 (twice), 4 and 6; conjugate pairs count once."""
    F = scipy.linalg.block_diag([[0, 1], [-1, 0]], [[0, 3], [-3, 0]])
    loss = loss_by_sampling(pair(F, [[1, 0, 1, 0]]), math.pi / 2)
    assert len(loss.losing_periods) == 3
    assert close(loss.losing_periods, [math.pi / 3, math.pi / 2, math.pi], EXACT)
    assert loss.lost
    assert len(loss.pairs) == 1
    assert close(np.diff(loss.pairs[0]), [4j], EXACT)


def test_loss_needs_a_continuous_model_and_a_period():
    """What is sampled is a continuous model, with dt > 0."""
    with pytest.raises(TypeError, match="expected a ContinuousModel"):
        loss_by_sampling(sampled(I2, I2), 1.0)
    with pytest.raises(ValueError, match="dt: expected a number > 0, received 0"):
        loss_by_sampling(swing(), 0)


# --- Gramians --------------------------------------------------------------------------------------------------------


@given(continuous_models(), st.floats(0.1, 5))
@settings(max_examples=15)
def test_continuous_gramian_is_the_integral(model, horizon):
    """Doubling agrees with quadrature, and its kernel is what is not observable."""

    def integrand(s: float) -> Array:
        rows = model.H @ scipy.linalg.expm(model.F * s)
        return rows.T @ rows

    expected = scipy.integrate.quad_vec(integrand, 0, horizon, epsabs=0, epsrel=1e-11)[0]
    found = gramian(model, horizon)
    assert close(found, expected, 1e-9)
    assert not close(broken(found), expected, 1e-9)


def test_long_gramian_solves_the_lyapunov_equation():
    """T → ∞ on a stable plant: FᵀO + OF + HᵀH = 0."""
    model = pair([[-1, 2], [0, -300]], [[1, 1]])
    W = gramian(model, 100.0)
    assert np.abs(model.F.T @ W + W @ model.F + model.H.T @ model.H).max() <= EXACT


def test_discrete_gramian_sums_the_measurements():
    """N measurements: Σ (Φᵏ)ᵀHᵀHΦᵏ, the square of the observability matrix; R = ∞ rows are left out."""
    Phi, H = np.array([[0.9, 0.2], [-0.1, 0.8]]), np.array([[1.0, 0.0], [3.0, 3.0]])
    model = replace(sampled(Phi, H), R=np.diag([1, np.inf]))
    rows = np.vstack([H[:1] @ np.linalg.matrix_power(Phi, k) for k in range(5)])
    assert close(gramian(model, 5), rows.T @ rows, EXACT)
    with pytest.raises(ValueError, match=r"horizon: expected a whole number >= 1, received 0.5"):
        gramian(model, 0.5)


def test_gramian_vanishes_along_what_is_hidden():
    """Lab 18 with the range alone: xᵀOx = 0 for the angle."""
    model, period = orbit("range")
    hidden = analyse(model).unobservable
    assert np.abs(hidden.T @ gramian(model, period) @ hidden).max() == 0


# --- what the Riccati solvers ask ------------------------------------------------------------------------------------


def test_mode_is_named_by_its_states():
    """States without a share are left out; of a pair both signs are shown; no −0."""
    assert Mode(-0.0, np.array([1.0, 1e-9])).name(("a", "b")) == "eigenvalue 0 of the states a"
    assert Mode(1e-17 + 2j, np.array([1j, 1.0])).name(("a", "b")) == "eigenvalue 0 ± 2i of the states a, b"
    assert Mode(-0.25, np.array([0.0, 3.0])).name(("a", "b")) == "eigenvalue -0.25 of the states b"


def test_growth_is_relative():
    """The boundary of stability does not depend on the unit of time, and is as sharp as rounding lets it be."""
    for rate in (1e-9, 1.0, 1e9):
        assert growing(rate * np.array([[0, 1], [-1, 0.0]]), continuous=True).tolist() == [0, 0]
        assert growing(rate * np.array([[-1e-12, 1], [-1, -1e-12]]), continuous=True).tolist() == [-1, -1]
    assert growing(np.diag([1 - 1e-15, -1.0, -1.5]), continuous=False).tolist() == [-1, 0, 1]
    assert growing(np.array([[2.0, 1.0], [-1.0, 0.0]]), continuous=False).tolist() == [0, 0]


@given(seeds, st.integers(1, 4), st.integers(1, 3))
@settings(max_examples=30)
def test_driven_part_is_what_noise_reaches(seed, n, idle):
    """Undriven left modes on the boundary are taken out, in any basis, and the rest is invariant; others stay."""
    rng = np.random.default_rng(seed)
    size = n + idle
    A = rng.normal(size=(size, size))
    A[n:, :n] = 0  # the last states are driven by nothing
    A[n:, n:] = np.triu(rng.normal(size=(idle, idle)), 1)
    Q = np.zeros((size, size))
    Q[:n, :n] = np.eye(n)
    T0 = np.linalg.qr(rng.normal(size=(size, size)))[0]
    found = undriven.without(T0 @ A @ T0.T, T0 @ Q @ T0.T, continuous=True)
    assert len(found.kept) == n
    T = np.zeros((size, n))
    T[found.kept], T[found.known] = np.eye(n), found.M
    # The states in which they are known: those of the columns of T0 that noise reaches.
    assert close(T @ np.linalg.lstsq(T, T0[:, :n], rcond=None)[0], T0[:, :n], SOLVER)
    A[n:, n:] -= np.eye(idle)
    assert len(undriven.without(T0 @ A @ T0.T, T0 @ Q @ T0.T, continuous=True).known) == 0
    assert undriven.without(A, Q, continuous=True).kept.tolist() == list(range(n))


def test_undetectable_modes_come_with_their_eigenvalues():
    """Only modes that do not decay, of a pair the one above."""
    A = scipy.linalg.block_diag([[0, 1], [-1, 0]], [[-1]])
    (mode,) = undetectable(A, np.zeros((1, 3)), continuous=True)
    assert close(mode.value, 1j, EXACT)
    assert undetectable(A, np.array([[1.0, 0, 0]]), continuous=True) == []


def test_hidden_subspace_of_mixed_units_has_clean_zeros():
    """A hidden direction in units that differ by 1e12 has no rounding in the states it does not touch."""
    d = np.array([1e6, 1e-6, 1.0])
    A = np.array([[0.5, 0.3, 0.1], [0.2, 0.4, 0.0], [0.0, 0.0, 0.3]])[::-1, ::-1]
    H = np.array([[1.0, 0.0, 0.0]])
    seen = analyse(sampled(A * d[:, None] / d, H / d))
    assert re.match("eigenvalue", seen.unobservable_modes[0])
    assert seen.unobservable[0].tolist() == [0.0] * seen.unobservable.shape[1]
