"""Reduced filters for perfect and coloured measurements give what the full ones give, with fewer equations."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from numpy.typing import NDArray

from ctlabs.filtering import bucy, covariances, kalman_filter, reduced, steady
from ctlabs.models import ContinuousModel, DiscreteModel, shaping
from ctlabs.models.discretisation import discretise
from tests.reference import EXACT, SOLVER, broken, close, conditioned, order
from tests.strategies import covariance, record, seeds, transition

pytestmark = pytest.mark.numerical

Array = NDArray[Any]


def noise(rng: np.random.Generator, m: int, perfect: int) -> Array:
    """A covariance of m measurements that leaves ``perfect`` combinations of them without noise."""
    if perfect == m:
        return np.zeros((m, m))
    mixing = np.eye(m) + np.tril(rng.normal(size=(m, m)), -1)
    return mixing @ np.diag([*np.zeros(perfect), *rng.uniform(0.2, 2.0, size=m - perfect)]) @ mixing.T


@st.composite
def perfectly_measured(draw: st.DrawFn) -> DiscreteModel:
    """A stable discrete model of which some combinations of measurements are perfect, with offset and N or without."""
    n = draw(st.integers(2, 4))
    perfect = draw(st.integers(1, n - 1))
    m = perfect + draw(st.integers(0, 2))
    correlated, driven = draw(st.booleans()), draw(st.booleans())
    rng = np.random.default_rng(draw(seeds))
    R, W = noise(rng, m, perfect), covariance(rng, n)
    N = R @ rng.normal(size=(m, n)) * 0.3 if correlated else None
    Qd = W if N is None else W + N.T @ np.linalg.pinv(R, hermitian=True) @ N
    return DiscreteModel(
        transition(rng, n, True), Qd, rng.normal(size=(m, n)), R, x0=rng.normal(size=n), P0=covariance(rng, n),
        dt=rng.uniform(0.1, 2.0), N=None if N is None else N.T, offset=rng.normal(size=n) if driven else None,
    )  # fmt: skip


@st.composite
def continuously_measured(draw: st.DrawFn) -> ContinuousModel:
    """The same in continuous time, with noise in every state."""
    n = draw(st.integers(2, 4))
    perfect = draw(st.integers(1, n - 1))
    m = perfect + draw(st.integers(0, 1))
    correlated = draw(st.booleans())
    rng = np.random.default_rng(draw(seeds))
    F = rng.normal(size=(n, n))
    F -= (np.linalg.eigvals(F).real.max() + rng.uniform(0.1, 2.0)) * np.eye(n)
    Rc, W = noise(rng, m, perfect), covariance(rng, n)
    N = Rc @ rng.normal(size=(m, n)) * 0.3 if correlated else None
    Q = W if N is None else W + N.T @ np.linalg.pinv(Rc, hermitian=True) @ N
    H = np.linalg.qr(rng.normal(size=(n, n)))[0][:m] if m <= n else rng.normal(size=(m, n))
    return ContinuousModel(F, np.eye(n), Q, H, P0=covariance(rng, n), Rc=Rc, N=None if N is None else N.T)


def signal_and_noise(w0: float = 1.0, wn: float = 2.0, Q1: float = 2.0, Q2: float = 1.0) -> ContinuousModel:
    """Signal and coloured noise of the first order; z is their sum."""
    return ContinuousModel(
        np.diag([-w0, -wn]), np.eye(2), np.diag([Q1, Q2]), [[1, 1]], P0=np.diag([1.0, 0.5]), states=["s", "n"]
    )


@pytest.mark.parametrize("first", [0, 1])
@settings(max_examples=30)
@given(model=perfectly_measured(), seed=seeds)
def test_the_reduced_filter_gives_the_estimates_of_the_full_one(first: int, model: DiscreteModel, seed: int) -> None:
    """x̂⁺, P⁺ and K of every step equal those of the Kalman filter and of conditioning the joint distribution."""
    z = record(model, 8, np.random.default_rng(seed), first=first)
    small, full = reduced.discrete(model, first=first), kalman_filter(model, z[first:], first=first, algorithm="filterpy")
    P, K = reduced.covariances(small, 8)
    found = reduced.estimates(small, z[first:])
    assert small.model.n < model.n
    assert close(found.x_plus, full.x_plus, 1e-10)
    assert close(P, full.P_plus, 1e-10)
    assert close(K, full.K, SOLVER)
    assert close(found.x_plus, conditioned(model, z, first=first).x_plus, SOLVER)
    wrong = replace(small, model=replace(small.model, Phi=broken(small.model.Phi)))
    assert not close(reduced.estimates(wrong, z[first:]).x_plus, full.x_plus, 1e-6)


def test_lab_15_is_reproduced_to_rounding() -> None:
    """Signal in coloured noise alone: the first-order recursion equals the two-state filter to 1e-12 on many records."""
    model = discretise(signal_and_noise(), 0.5, R=[[0]])
    z = np.random.default_rng(3).normal(size=(41, 1, 5))
    full = kalman_filter(model, z, first=0, algorithm="filterpy")
    small = reduced.discrete(model, keep=["s"], first=0)
    assert close(reduced.estimates(small, z).x_plus, full.x_plus, EXACT)
    P, K = reduced.covariances(small, 40)
    assert close(P, full.P_plus, EXACT)
    assert close(K, full.K, EXACT)
    transformed = small.basis.T @ P @ small.basis.T.T
    assert close(transformed[:, 1, 1], P[:, 0, 0], EXACT)
    assert np.abs(transformed[:, 0]).max() < EXACT
    assert not close(reduced.estimates(replace(small, A_0=1.05 * small.A_0), z).x_plus, full.x_plus, 1e-3)


@settings(max_examples=25)
@given(model=perfectly_measured())
def test_the_steady_state_is_that_of_the_full_filter(model: DiscreteModel) -> None:
    """P⁺, K, the poles other than zero, and the frequency response from every measurement to every state."""
    small, full = reduced.discrete(model), steady.solve(model)
    limit = reduced.steady(small)
    assert close(limit.P, full.P_plus, SOLVER)
    assert close(limit.K, full.K, 1e-7)
    assert close(np.poly(full.poles)[: small.model.n + 1], np.poly(limit.poles), 1e-7)
    q = np.exp(-1j * np.array([0.1, 1.0, 3.0]))
    for state in range(model.n):
        for measurement in range(model.m):
            num, den = reduced.transfer_function(small, state, measurement)
            wide, deep = steady.transfer_function(model, state, measurement)
            assert len(num) == len(den) == small.model.n + 1
            response, expected = (
                np.polyval(a[::-1], q) / np.polyval(b[::-1], q) for a, b in ((num, den), (wide, deep))
            )
            assert close(response, expected, 1e-6, size=1.0)


@settings(max_examples=25)
@given(model=continuously_measured())
def test_the_continuous_filter_is_the_limit_of_little_white_noise(model: ContinuousModel) -> None:
    """With noise of strength ε in the perfect rows the Riccati equation tends to the reduced one, like √ε."""
    small = reduced.continuous(model)
    t = [0.3, 1.0]
    P = reduced.transient(small, t)
    assert model.Rc is not None
    errors = []
    for strength in (1e-8, 1e-10):
        # The noise is spread over all measurements: a regular Rc with the same limit and a joint covariance with N.
        noisy = replace(model, Rc=model.Rc + strength * np.eye(model.m))
        errors.append(np.abs(bucy.transient(noisy, t).P - P).max())
    assert errors[1] < 0.2 * errors[0] or errors[1] < 1e-7
    assert errors[1] < 1e-3 * max(1.0, np.abs(P).max())
    H = model.H[: small.basis.D_p.shape[0]] if model.Rc is None else small.basis.H_p
    assert np.abs(H @ P @ H.T).max() < 1e-10 * max(1.0, np.abs(P).max())
    wrong = replace(small.model, Rc=1.05 * small.model.Rc, N=None)  # type: ignore[operator]  # it has one
    assert not close(bucy.transient(wrong, t).P, bucy.transient(small.model, t).P, 1e-6)


@settings(max_examples=10)
@given(model=continuously_measured())
def test_sampled_filters_tend_to_the_continuous_one(model: ContinuousModel) -> None:
    """The full filter of the sampled perfect measurements approaches the reduced continuous one as dt → 0."""
    H_p = reduced.continuous(model).basis.H_p
    perfect = replace(model, H=H_p, Rc=None, N=None, measurements=None, measurement_units=None)
    P = reduced.transient(reduced.continuous(perfect), [1.0])[0]
    errors = []
    for steps in (128, 256, 512):
        sampled = discretise(perfect, 1 / steps, R=np.zeros((len(H_p), len(H_p))))
        errors.append(np.abs(covariances(sampled, steps, first=0, algorithm="filterpy").P_plus[-1] - P).max())
    assert errors[-1] < 0.1 * max(1.0, np.abs(P).max())
    assert 0.7 < order(errors)[-1] < 2.5 or errors[-1] < 1e-8


@settings(max_examples=25)
@given(model=continuously_measured())
def test_the_realisation_needs_no_derivative(model: ContinuousModel) -> None:
    """ξ̇ = Aξ + Bz, x̂ = Cξ + Dz is the filter with ż in its gain: the same response at every frequency, and H_p x̂ = ζ."""
    small = reduced.continuous(model)
    A, B, C, D = reduced.realisation(small)
    b, K = small.basis, bucy.steady(small.model).K
    p = len(b.D_p)
    for w in (0.2, 3.0):
        s = 1j * w
        found = C @ np.linalg.solve(s * np.eye(len(A)) - A, B) + D
        # The filter as derived: (sI − F̃ + KH̃)ŷ = WFLζ + K[(sI − H_pFL)ζ; (D_n − H_nLD_p)z]
        derived = np.vstack([(s * np.eye(p) - b.H_p @ model.F @ b.L) @ b.D_p, b.D_n - b.H_n @ b.L @ b.D_p])
        left = s * np.eye(len(A)) - small.model.F + K @ small.model.H
        y = np.linalg.solve(left, b.W @ model.F @ b.L @ b.D_p + K @ derived)
        expected = b.L @ b.D_p + b.M @ y
        assert close(found, expected, SOLVER)
        assert close(b.H_p @ found, b.D_p, SOLVER)
        for state in range(model.n):
            num, den = reduced.transfer_function(small, state)
            assert close(np.polyval(num, s) / np.polyval(den, s), expected[state, 0], SOLVER, size=1.0)
    P = reduced.steady(small).P
    assert close(reduced.transient(small, [80.0])[0], P, 1e-6)


def test_the_error_of_the_realised_filter_is_the_one_claimed() -> None:
    """Lyapunov: plant and filter together, driven by the plant's noise, have the covariance of the Riccati equation."""
    model = signal_and_noise(1.3, 0.4, 2.0, 3.0)
    small = reduced.continuous(model, keep=["s"])
    A, B, C, D = reduced.realisation(small)
    both = np.block([[model.F, np.zeros((2, 1))], [B @ model.H, A]])
    W = scipy.linalg.block_diag(model.G @ model.Q @ model.G.T, np.zeros((1, 1)))
    error = np.hstack([D @ model.H - np.eye(2), C])
    assert close(error @ scipy.linalg.solve_continuous_lyapunov(both, -W) @ error.T, reduced.steady(small).P, SOLVER)
    assert not close(
        error @ scipy.linalg.solve_continuous_lyapunov(both, -broken(W)) @ error.T, reduced.steady(small).P, SOLVER
    )


def test_lab_22_is_the_closed_form() -> None:
    """x̂1/z = c1(s+a)/(s+a c1), c1 = √(Q1/(Q1+Q2)), and P = (√(Q1(Q1+Q2)) − Q1)/a."""
    for a, Q1, Q2 in ((2.0, 1.0, 3.0), (0.5, 2.0, 1.0)):
        model = ContinuousModel(np.diag([0.0, -a]), np.eye(2), np.diag([Q1, Q2]), [[1, 1]], P0=np.eye(2))
        small = reduced.continuous(model, keep=[0])
        c1 = np.sqrt(Q1 / (Q1 + Q2))
        num, den = reduced.transfer_function(small)
        assert close(num, [c1, c1 * a], SOLVER)
        assert close(den, [1, a * c1], SOLVER)
        assert close(reduced.steady(small).P[0, 0], (np.sqrt(Q1 * (Q1 + Q2)) - Q1) / a, SOLVER)


def test_equal_poles_leave_a_static_filter() -> None:
    """With w0 = wn the derived measurement says nothing of the signal: x̂ is a constant fraction of z, in both times."""
    model = signal_and_noise(2.0, 2.0)
    small = reduced.discrete(discretise(model, 0.5, R=[[0]]), keep=["s"], first=0)
    assert np.abs(small.model.H).max() < EXACT
    num, den = reduced.transfer_function(small)
    assert close(num, num[0] * den, SOLVER)
    assert close(reduced.steady(small).P[0, 0], 2 * 1 / (3 * 4), SOLVER)
    num, den = reduced.transfer_function(reduced.continuous(model, keep=["s"]))
    assert close(num, 2 / 3 * den, SOLVER)


def test_coloured_noise_of_a_plant_becomes_a_derived_measurement() -> None:
    """Keeping the plant's states: H̃ = HΦ − ΨH, the derived measurement of Bryson and Henrikson."""
    plant = ContinuousModel([[0, 1], [-1, -0.5]], [[0], [1]], [[1]], [[1, 0]], P0=np.eye(2), states=["x", "v"])
    model = discretise(shaping.augment_measurement(plant, shaping.gauss_markov(0.3, 0.7)), 0.2, R=[[0]])
    small = reduced.discrete(model, keep=["x", "v"])
    Phi, H = model.Phi[:2, :2], plant.H
    assert close(small.model.H, H @ Phi - model.Phi[2, 2] * H, EXACT)
    assert small.model.states == ("x", "v")
    assert close(small.model.N, model.Qd[:2, :2] @ H.T, EXACT)


def test_a_record_of_one_step_and_a_first_measurement_at_t1_are_in_order() -> None:
    """Before the first measurement the estimate is the mean and the covariance P0."""
    model = replace(discretise(signal_and_noise(), 0.5, R=[[0]]), x0=[1.0, -0.5])
    small = reduced.discrete(model, first=1)
    found = reduced.estimates(small, [[0.4]])
    expected = kalman_filter(model, [[0.4]], algorithm="filterpy")
    assert close(found.x_plus, expected.x_plus, EXACT)
    P, K = reduced.covariances(small, 1)
    assert close(P, expected.P_plus, EXACT)
    assert close(K, expected.K, EXACT)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"R": [[1.0]]}, r"R: expected 1 to 1 perfect measurements \(without noise\) of 2 states, received 0"),
        ({"R": [[np.inf]]}, "R: expected every element to be measured, received inf"),
        ({"H": np.eye(2), "R": np.zeros((2, 2))}, "R: expected 1 to 1 perfect measurements .* received 2"),
        ({"H": [[0, 0]]}, "H: expected perfect measurements of which none follows from the others"),
        ({"offset": np.zeros((3, 2))}, "model: expected constant matrices, received some that vary over 3 steps"),
    ],
)
def test_what_cannot_be_reduced_is_refused(change: dict[str, Any], message: str) -> None:
    """No perfect measurement, all states measured, empty or dependent rows, variation, absence: each in one line."""
    model = discretise(signal_and_noise(), 0.5, R=[[0]])
    with pytest.raises(ValueError, match=message):
        reduced.discrete(replace(model, measurements=None, measurement_units=None, **change))


def test_bad_choices_are_refused() -> None:
    """States that do not exist, repeat or are determined; a wrong first; records with gaps or of another shape."""
    model = discretise(signal_and_noise(), 0.5, R=[[0]])
    for keep in (["x"], ["s", "n"], [2], ["s", "s"]):
        with pytest.raises(ValueError, match="keep: expected 1 different states of s, n, received"):
            reduced.discrete(model, keep=keep)
    with pytest.raises(ValueError, match="keep: expected states that the perfect measurements leave open"):
        reduced.discrete(replace(model, H=[[1, 0]]), keep=["s"])
    with pytest.raises(ValueError, match="first: expected 0 or 1, received 2"):
        reduced.discrete(model, first=2)
    small = reduced.discrete(model)
    with pytest.raises(ValueError, match=r"z: expected shape \(rows, 1\) or \(rows, 1, runs\), received \(3, 2\)"):
        reduced.estimates(small, np.zeros((3, 2)))
    with pytest.raises(ValueError, match=r"z: expected finite numbers \(a gap needs the full filter\)"):
        reduced.estimates(small, [[0.0], [np.nan], [1.0]])
    with pytest.raises(TypeError, match="model: expected a DiscreteModel, received a ContinuousModel"):
        reduced.discrete(signal_and_noise())  # type: ignore[arg-type]


def test_a_known_derivative_and_a_known_input_are_refused() -> None:
    """A perfect measurement without white noise in its derivative would have to be differentiated."""
    smooth = ContinuousModel([[0, 1], [-1, -1]], [[0], [1]], [[1]], [[1, 0]], P0=np.eye(2))
    with pytest.raises(ValueError, match="expected white noise in the derivative of every perfect measurement"):
        reduced.continuous(smooth)
    with pytest.raises(ValueError, match="expected white noise in the derivative"):
        reduced.continuous(signal_and_noise(Q1=0.0, Q2=0.0))
    with pytest.raises(ValueError, match="B: expected no known input"):
        reduced.continuous(replace(signal_and_noise(), B=[[1], [0]]))
    dependent = ContinuousModel(
        -np.eye(3), np.array([[1.0], [1.0], [0.0]]), [[1]], np.eye(3)[:2], P0=np.eye(3)
    )  # two measurements, one noise
    with pytest.raises(ValueError, match="expected white noise in the derivative"):
        reduced.continuous(dependent)
    with pytest.raises(TypeError, match="model: expected a ContinuousModel, received a DiscreteModel"):
        reduced.continuous(discretise(signal_and_noise(), 0.5, R=[[0]]))  # type: ignore[arg-type]


def test_no_limit_is_refused_by_the_mode() -> None:
    """Two integrators seen through their sum: the difference is never observed and grows."""
    model = signal_and_noise(0.0, 0.0)
    with pytest.raises(ValueError, match="received the mode eigenvalue 0 of the states"):
        reduced.steady(reduced.continuous(model))
    with pytest.raises(ValueError, match="received the mode eigenvalue 1 of the states"):
        reduced.steady(reduced.discrete(discretise(model, 0.5, R=[[0]])))
