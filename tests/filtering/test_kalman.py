"""The discrete filter against its definition: joint Gaussian conditioning, least squares, 60 digits, and filterpy's own loop."""

from __future__ import annotations

import importlib
from dataclasses import fields, replace
from functools import partial
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from numpy.typing import NDArray

from ctlabs.filtering import Covariances, Filtered, covariances, kalman_filter, update
from ctlabs.models import ContinuousModel, DiscreteModel
from tests.reference import (
    EXACT,
    SOLVER,
    Moments,
    at,
    broken,
    close,
    conditioned,
    deviation,
    high_precision,
    information,
    information_update,
    least_squares,
    offset_at,
    recursion,
)
from tests.strategies import covariance, discrete_models, record, seeds

pytestmark = pytest.mark.numerical

Array = NDArray[Any]
STEPS = 6
properties = settings(deadline=None, max_examples=25, derandomize=True)
inf, nan = np.inf, np.nan
filterpys = partial(kalman_filter, algorithm="filterpy")
planned = partial(covariances, algorithm="filterpy")
#: What no data change.
PLAN = [field.name for field in fields(Covariances)]


def size(model: DiscreteModel) -> float:
    """The size of the terms of which the filter's covariances are sums and differences."""
    return float(max(np.abs(model.Qd).max(), np.abs(model.P0).max(), 1e-300))


def agrees(found: Filtered, expected: Moments, model: DiscreteModel, tolerance: float) -> bool:
    """Whether estimates and covariances are those of an oracle."""
    return all(
        [
            close(found.x_minus, expected.x_minus, tolerance),
            close(found.x_plus, expected.x_plus, tolerance),
            close(found.P_minus, expected.P_minus, tolerance, size(model)),
            close(found.P_plus, expected.P_plus, tolerance, size(model)),
        ]
    )


def identical(a: Covariances, b: Covariances, names: list[str] = PLAN) -> bool:
    """Whether two filters agree in every bit."""
    return all(same_bits(getattr(a, name), getattr(b, name)) for name in names)


def same_bits(a: Any, b: Any) -> bool:
    return a == b if isinstance(a, str) else np.array_equal(a, b, equal_nan=True)


# --- the filter is conditioning ---------------------------------------------------------------------------------


@properties
@given(st.one_of(discrete_models(stable=True, correlated=False), discrete_models(stable=True, singular=False)), seeds)
def test_filter_is_joint_gaussian_conditioning(model: DiscreteModel, seed: int) -> None:
    """x̂ and P are the moments of x_k given the measurements, with gaps, known inputs, correlation and variation."""
    z = record(model, STEPS, np.random.default_rng(seed), gaps=0.2, first=seed % 2)
    found, expected = filterpys(model, z[seed % 2 :], first=seed % 2), conditioned(model, z, first=seed % 2)
    assert agrees(found, expected, model, EXACT)


@properties
@given(st.one_of(discrete_models(stable=None, correlated=False), discrete_models(stable=None, singular=False)), seeds)
def test_filter_keeps_twelve_digits(model: DiscreteModel, seed: int) -> None:
    """The same as the textbook's recursion with 60 digits, for stable and unstable models."""
    z = record(model, STEPS, np.random.default_rng(seed), gaps=0.2, first=seed % 2)
    assert agrees(filterpys(model, z[seed % 2 :], first=seed % 2), high_precision(model, z, first=seed % 2), model, EXACT)


@properties
@given(discrete_models(stable=True, singular=False), seeds)
def test_filter_is_weighted_least_squares(model: DiscreteModel, seed: int) -> None:
    """The last estimate minimises the weighted squares of all disturbances and noises."""
    z = record(model, STEPS, np.random.default_rng(seed), gaps=0.2)
    found, expected = filterpys(model, z[1:]), least_squares(model, z)
    assert close(found.x_plus[-1], expected.x[-1], 1e-10)
    assert close(found.P_plus[-1], expected.P[-1], 1e-10)


@pytest.mark.parametrize("field", ["Phi", "Qd", "H", "R", "P0", "x0", "N", "offset"])
def test_every_part_of_the_model_counts(field: str) -> None:
    """A change of 5 % in one element of any matrix is a different filter."""
    rng = np.random.default_rng(5)
    model = DiscreteModel(
        Phi=[[0.9, 0.4], [-0.3, 0.8]], Qd=covariance(rng, 2), H=[[1.0, 0.5]], R=[[0.7]], x0=[1.0, -2.0], P0=covariance(rng, 2),
        N=[[0.2], [-0.1]], offset=[0.3, 1.0],
    )  # fmt: skip
    z = record(model, STEPS, rng)
    assert agrees(filterpys(model, z[1:]), conditioned(model, z), model, EXACT)
    changed = broken(getattr(model, field))
    if field in {"Qd", "P0"}:
        changed = 0.5 * (changed + changed.T)
    assert not agrees(filterpys(replace(model, **{field: changed}), z[1:]), conditioned(model, z), model, 1e-4)


@properties
@given(discrete_models(stable=None, correlated=False, offset=None), seeds)
def test_adapter_equals_filterpys_own_loop(model: DiscreteModel, seed: int) -> None:
    """One run at a time through filterpy's predict and update gives the same estimates, covariances and gains."""
    filterpy = importlib.import_module("filterpy.kalman")
    rng = np.random.default_rng(seed)
    runs = np.stack([record(model, STEPS, rng) for _ in range(3)], axis=-1)
    found = filterpys(model, runs[1:])
    for run in range(3):
        kf = filterpy.KalmanFilter(dim_x=model.n, dim_z=model.m)
        kf.x, kf.P = model.x0[:, None].copy(), model.P0.copy()
        for k in range(1, STEPS + 1):
            c = offset_at(model, k - 1)[:, None]
            kf.predict(F=at(model.Phi, k - 1), Q=at(model.Qd, k - 1), u=c, B=np.eye(model.n))
            kf.update(runs[k, :, run, None], R=at(model.R, k), H=at(model.H, k))
            assert close(found.x_minus[k, :, run], kf.x_prior[:, 0], EXACT)
            assert close(found.x_plus[k, :, run], kf.x[:, 0], EXACT)
            assert close(found.P_minus[k], kf.P_prior, EXACT, size(model))
            assert close(found.P_plus[k], kf.P, EXACT, size(model))
            assert close(found.K[k], kf.K, EXACT, size(model))
            assert close(found.S[k], kf.S, EXACT)
            assert close(found.innovation[k, :, run], kf.y[:, 0], EXACT)


@properties
@given(discrete_models(stable=None), seeds)
def test_batch_equals_loop(model: DiscreteModel, seed: int) -> None:
    """Many runs in one pass are the runs one by one."""
    rng = np.random.default_rng(seed)
    gaps = np.isnan(record(model, STEPS, rng, gaps=0.3))
    runs = np.stack([np.where(gaps, nan, record(model, STEPS, rng)) for _ in range(4)], axis=-1)
    together = filterpys(model, runs[1:])
    for run in range(4):
        alone = filterpys(model, runs[1:, :, run])
        assert identical(alone, together)
        for name in ("x_minus", "x_plus", "innovation"):
            assert close(getattr(together, name)[:, :, run], getattr(alone, name), EXACT)


@properties
@given(discrete_models(stable=None), seeds)
def test_covariances_need_no_data(model: DiscreteModel, seed: int) -> None:
    """The covariances computed before the data are those the filter uses, bit for bit, and the estimates with it too."""
    z = record(model, STEPS, np.random.default_rng(seed))
    plan = planned(model, STEPS)
    found = filterpys(model, z[1:])
    assert identical(plan, found)
    assert identical(filterpys(model, z[1:], gains=plan), found, [*PLAN, "x_minus", "x_plus", "innovation", "nis", "log_likelihood"])
    assert plan.steps == STEPS
    assert np.array_equal(plan.t, np.arange(STEPS + 1) * model.dt)
    assert np.array_equal(plan.sd_plus**2 > 0, np.diagonal(plan.P_plus, axis1=1, axis2=2) > 0)
    assert close(plan.sd_minus**2, np.diagonal(plan.P_minus, axis1=1, axis2=2), EXACT)


@properties
@given(discrete_models(stable=True))
def test_covariances_are_covariances(model: DiscreteModel) -> None:
    """P⁻, P⁺ and S are symmetric and nonnegative definite, no variance is negative, and an update never adds variance."""
    plan = planned(model, STEPS)
    for P in (plan.P_minus, plan.P_plus):
        assert close(P, np.swapaxes(P, 1, 2), EXACT, size(model))
        assert np.linalg.eigvalsh(P).min() > -EXACT * size(model)
        assert (np.diagonal(P, axis1=1, axis2=2) >= 0).all()
    assert np.linalg.eigvalsh(plan.P_minus - plan.P_plus).min() > -EXACT * size(model)


@properties
@given(discrete_models(stable=True, singular=False, varying=False, correlated=False), seeds)
def test_one_update_in_information_form(model: DiscreteModel, seed: int) -> None:
    """(P⁺)⁻¹ = (P⁻)⁻¹ + HᵀR⁻¹H and K = P⁺HᵀR⁻¹; with K changed by 5 % Joseph's form gives more variance."""
    step = update(model.P0, model.H, model.R)
    _, P_plus, K = information_update(model.x0, model.P0, np.zeros(model.m), model.H, model.R)
    assert close(step.P_plus, P_plus, EXACT)
    assert close(step.K, K, EXACT)
    wrong = broken(step.K)
    left = np.eye(model.n) - wrong @ model.H
    excess = left @ model.P0 @ left.T + wrong @ model.R @ wrong.T - step.P_plus
    assert np.trace(excess) > 1e-6 * np.trace(step.P_plus) * (np.abs(step.K).max() / 10) ** 2 > 0
    assert close(excess, (wrong - step.K) @ step.S @ (wrong - step.K).T, EXACT, size(model))


def test_without_disturbances_information_only_adds_up() -> None:
    """Qd = 0: ΨP⁻¹Ψᵀ carried back to t0 is P0⁻¹ + ΣΨᵀHᵀR⁻¹HΨ."""
    rng = np.random.default_rng(11)
    model = DiscreteModel(
        Phi=rng.normal(size=(5, 3, 3)), Qd=np.zeros((3, 3)), H=rng.normal(size=(6, 2, 3)), R=covariance(rng, 2), x0=[0, 0, 0],
        P0=covariance(rng, 3),
    )  # fmt: skip
    Psi = np.linalg.multi_dot(model.Phi[::-1])
    P0_given_all = np.linalg.solve(Psi, np.linalg.solve(Psi, planned(model, 5).P_plus[-1]).T)
    assert close(np.linalg.inv(P0_given_all), information(model, 5), SOLVER)
    assert not close(np.linalg.inv(broken(P0_given_all)), information(model, 5), 1e-4)


# --- absent measurements ----------------------------------------------------------------------------------------


@properties
@given(discrete_models(stable=None, varying=False, correlated=False), seeds)
def test_infinite_noise_is_no_measurement_bit_for_bit(model: DiscreteModel, seed: int) -> None:
    """R = ∞: x̂⁺ = x̂⁻, P⁺ = P⁻ in every bit, K = 0, S = ∞, whatever the data."""
    absent = replace(model, R=np.diag(np.full(model.m, inf)))
    found = filterpys(absent, np.random.default_rng(seed).normal(size=(STEPS + 1, model.m)), first=0)
    assert same_bits(found.x_plus, found.x_minus)
    assert same_bits(found.P_plus, found.P_minus)
    assert not found.K.any()
    assert not found.used.any()
    assert np.isinf(np.diagonal(found.S, axis1=1, axis2=2)).all()
    assert np.isnan(found.innovation).all()


@properties
@given(discrete_models(stable=None, varying=False, correlated=False, max_m=2), seeds)
def test_an_element_with_infinite_noise_might_as_well_not_exist(model: DiscreteModel, seed: int) -> None:
    """A further row of H with R = ∞ changes no bit of covariances and estimates."""
    rng = np.random.default_rng(seed)
    z = record(model, STEPS, rng)
    R = np.diag(np.full(model.m + 1, inf))
    R[1:, 1:] = model.R
    wider = replace(model, H=np.vstack([rng.normal(size=model.n), model.H]), R=R, measurements=None, measurement_units=None)
    found, expected = filterpys(wider, np.hstack([rng.normal(size=(STEPS, 1)), z[1:]])), filterpys(model, z[1:])
    for name in ("P_minus", "P_plus"):
        assert same_bits(getattr(found, name), getattr(expected, name))
    assert same_bits(found.K[:, :, 1:], expected.K)
    assert not found.K[:, :, 0].any()
    assert close(found.x_plus, expected.x_plus, EXACT)


@properties
@given(discrete_models(stable=None, varying=False, correlated=False), seeds)
def test_a_gap_in_the_data_is_an_infinite_noise(model: DiscreteModel, seed: int) -> None:
    """NaN in one element at one time is R = ∞ there, also when only some elements are missing."""
    z = record(model, STEPS, np.random.default_rng(seed), gaps=0.4)
    gap = np.isnan(z)
    R = np.where(gap[:, :, None] | gap[:, None, :], 0.0, model.R)
    k, i = np.nonzero(gap)
    R[k, i, i] = inf
    found, expected = filterpys(model, z[1:]), filterpys(replace(model, R=R), np.nan_to_num(z[1:]))
    assert identical(found, expected)
    assert same_bits(found.x_plus, expected.x_plus)
    assert np.array_equal(found.used, ~gap)
    assert np.array_equal(np.isnan(found.innovation), gap)


def test_first_measurement_is_at_t1_unless_one_is_taken_at_t0() -> None:
    """first=1: z[0] is measured at t1, and t0 is not measured; first=0: z[0] is taken at t0 with P_minus[0] = P0."""
    model = DiscreteModel([[0.9]], [[1]], [[1]], [[2]], x0=[3], P0=[[4]])
    z = [[1.0], [2.0], [-1.0]]
    later, now = filterpys(model, z[1:]), filterpys(model, z, first=0)
    assert (later.steps, now.steps) == (2, 2)
    assert later.x_plus[0, 0] == 3
    assert later.P_plus[0, 0, 0] == 4
    assert not later.used[0].any()
    assert np.isnan(later.innovation[0]).all()
    assert same_bits(later.x_plus, filterpys(model, [[nan], *z[1:]], first=0).x_plus)
    assert agrees(later, recursion(model, z), model, EXACT)
    assert close(now.x_plus[0], 3 + 4 / 6 * (1 - 3), EXACT)
    assert close(now.P_plus[0], 4 * 2 / 6, EXACT)
    assert now.P_minus[0, 0, 0] == 4
    assert agrees(now, recursion(model, z, first=0), model, EXACT)


@properties
@given(discrete_models(stable=True, varying=False, correlated=False))
def test_several_predictions_can_be_reduced_to_one(model: DiscreteModel) -> None:
    """Steps without measurements are one step with Φʲ, ΣΦⁱQdΦⁱᵀ and ΣΦⁱc."""
    z = np.full((STEPS + 1, model.m), nan)
    found = filterpys(model, z[1:])
    Phi, Qd, c = np.eye(model.n), np.zeros((model.n, model.n)), np.zeros(model.n)
    for k in range(STEPS):
        Qd, c, Phi = Qd + Phi @ model.Qd @ Phi.T, c + Phi @ offset_at(model, k), model.Phi @ Phi
    once = filterpys(replace(model, Phi=Phi, Qd=Qd, offset=c), z[1:2])
    assert close(found.x_plus[-1], once.x_plus[-1], EXACT)
    assert close(found.P_plus[-1], once.P_plus[-1], EXACT)


# --- order and batches of measurements --------------------------------------------------------------------------


@properties
@given(discrete_models(stable=None), seeds)
def test_numbering_of_the_measurements_does_not_matter(model: DiscreteModel, seed: int) -> None:
    """A permutation of the rows of H, R, N and z permutes the gain's columns and changes nothing else."""
    rng = np.random.default_rng(seed)
    z, order = record(model, STEPS, rng, gaps=0.2), rng.permutation(model.m)
    shuffled = replace(
        model,
        H=model.H[..., order, :],
        R=model.R[..., order, :][..., order],
        N=None if model.N is None else model.N[:, order],
        measurements=[model.measurements[i] for i in order],
    )
    found, expected = filterpys(shuffled, z[1:, order]), filterpys(model, z[1:])
    assert close(found.x_plus, expected.x_plus, EXACT)
    assert close(found.P_plus, expected.P_plus, EXACT, size(model))
    assert close(found.K, expected.K[:, :, order], EXACT, size(model))


@properties
@given(discrete_models(stable=True, varying=False, correlated=False), seeds)
def test_independent_measurements_at_once_or_one_after_another(model: DiscreteModel, seed: int) -> None:
    """With diagonal R the vector update is the scalar updates in any order; with correlated noise it is not."""
    rng = np.random.default_rng(seed)
    variances = rng.uniform(0.1, 2, size=model.m)
    P = model.P0
    for i in rng.permutation(model.m):
        P = update(P, model.H[i : i + 1], [[variances[i]]]).P_plus
    assert close(P, update(model.P0, model.H, np.diag(variances)).P_plus, EXACT)


def test_ignoring_correlation_of_noises_is_another_filter() -> None:
    """Two measurements with R12 ≠ 0: the update is that of conditioning, and scalar updates with R11, R22 are not."""
    P, H, R = np.diag([2.0, 1.0]), np.array([[1.0, 0.5], [0.3, 1.0]]), np.array([[1.0, 0.6], [0.6, 0.8]])
    expected = P - P @ H.T @ np.linalg.solve(H @ P @ H.T + R, H @ P)
    one_by_one = update(update(P, H[:1], R[:1, :1]).P_plus, H[1:], R[1:, 1:]).P_plus
    assert close(update(P, H, R).P_plus, expected, EXACT)
    assert not close(one_by_one, expected, 1e-2)


# --- perfect measurements ---------------------------------------------------------------------------------------


def test_perfect_measurement_of_a_state_is_exact() -> None:
    """R = 0: x̂ takes the measured value, its variance and covariances become zero exactly, the rest is conditioned."""
    P0 = np.array([[2.0, 0.6], [0.6, 1.0]])
    model = DiscreteModel(np.eye(2), 0.1 * np.eye(2), [[1, 0]], [[0]], x0=[0, 0], P0=P0)
    found = filterpys(model, [[1.3], [nan]], first=0)
    assert close(found.x_plus[0], [1.3, 1.3 * 0.3], EXACT)
    assert found.P_plus[0].tolist()[0] == [0, 0]
    assert close(found.P_plus[0, 1, 1], 1 - 0.36 / 2, EXACT)
    assert found.used[0].all()


@properties
@given(discrete_models(stable=True, singular=False, varying=False, correlated=False, max_m=2), seeds)
def test_perfect_measurements_are_conditioning_too(model: DiscreteModel, seed: int) -> None:
    """R = 0 in one element, over several steps, against the joint distribution."""
    perfect = np.array(model.R)
    perfect[0], perfect[:, 0] = 0.0, 0.0
    model = replace(model, R=perfect)
    z = record(model, STEPS, np.random.default_rng(seed))
    assert agrees(filterpys(model, z[1:]), conditioned(model, z), model, 1e-10)


@properties
@given(discrete_models(stable=True, singular=False, varying=False, correlated=False, max_m=2), seeds)
def test_the_same_perfect_measurement_twice_is_taken_once(model: DiscreteModel, seed: int) -> None:
    """In the same instant: the copy gets K = 0 and S = ∞, and nothing else changes (also for a multiple of it)."""
    rng = np.random.default_rng(seed)
    row = rng.normal(size=model.n)
    R = np.zeros((model.m + 2, model.m + 2))
    R[1:-1, 1:-1] = model.R
    once = update(model.P0, np.vstack([row, model.H]), R[:-1, :-1])
    twice = update(model.P0, np.vstack([row, model.H, rng.uniform(-5, 5) * row]), R)
    assert twice.used.tolist() == [*once.used, False]
    assert not twice.K[:, -1].any()
    assert twice.S[-1, -1] == inf
    assert close(twice.K[:, :-1], once.K, EXACT)
    assert close(twice.P_plus, once.P_plus, EXACT)


@properties
@given(seeds)
def test_the_same_perfect_measurement_later_tells_nothing_new(seed: int) -> None:
    """Of a constant vector, one combination measured perfectly: K = 0 at every later step, whatever the prior's spread."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 5))
    P0 = covariance(rng, n) + 10.0 ** rng.integers(0, 7) * np.diag(rng.uniform(size=n))
    model = DiscreteModel(np.eye(n), np.zeros((n, n)), rng.normal(size=(1, n)), [[0]], x0=rng.normal(size=n), P0=P0)
    found = filterpys(model, record(model, 4, rng)[1:])
    assert found.used.ravel().tolist() == [False, True, False, False, False]
    assert not found.K[2:].any()
    assert np.isinf(found.S[2:]).all()
    assert same_bits(found.P_plus[2:], found.P_minus[2:])
    assert np.isnan(found.innovation[2:]).all()


@pytest.mark.parametrize(
    "Phi", [np.diag([1.0, -1.0]), np.array([[0.0, 1.0], [-1.0, 0.0]]), np.array([[1.0, 0.5], [0.0, 1.0]])]
)
def test_what_is_known_stays_known_as_it_moves(Phi: Array) -> None:
    """Without disturbances the measured combination moves with Φ, and measuring it perfectly again gets K = 0."""
    H = np.array([[[2.0, 1.0]] @ np.linalg.matrix_power(np.linalg.inv(Phi), k) for k in range(5)])
    model = DiscreteModel(Phi, np.zeros((2, 2)), H, [[0]], x0=[1, 2], P0=[[3, 1], [1, 2]])
    z = record(model, 4, np.random.default_rng(3))
    found = filterpys(model, z[1:])
    assert found.used.ravel().tolist() == [False, True, False, False, False]
    assert agrees(found, conditioned(model, z), model, 1e-10)


def test_after_all_states_are_known_the_filter_only_predicts() -> None:
    """R = 0 on a full-rank H with Q = 0: P stays exactly zero; a filter of lab 6 becomes a sign flip."""
    model = DiscreteModel([[-1]], [[0]], [[1]], [[[1]], [[1]], [[0]], [[1]], [[0]]], x0=[0], P0=[[4]])
    found = filterpys(model, [[1.0], [-2.0], [2.5], [-2.0]])
    assert found.P_plus[2:].ravel().tolist() == [0, 0, 0]
    assert close(found.x_plus[2:, 0], [-2, 2, -2], EXACT)
    assert not found.K[3:].any()


def test_perfectly_correlated_noises_are_one_noise() -> None:
    """R = [[1, 1], [1, 1]]: equal rows of H make the second measurement a copy; different ones reveal the state."""
    R = [[1.0, 1.0], [1.0, 1.0]]
    copy = update([[2.0]], [[1.0], [1.0]], R)
    assert copy.used.tolist() == [True, False]
    assert close(copy.K, [[2 / 3, 0]], EXACT)
    assert close(copy.P_plus, 2 / 3, EXACT)
    reveals = update([[2.0]], [[1.0], [2.0]], R)
    assert reveals.used.all()
    assert close(reveals.K, [[-1, 1]], EXACT)
    assert close(reveals.P_plus, 0, EXACT, size=2)
    model = DiscreteModel([[1]], [[0.5]], [[1], [1]], R, x0=[0], P0=[[2]])
    z = np.repeat(np.array([[nan], [1.0], [-0.5], [0.3]]), 2, axis=1)
    assert agrees(filterpys(model, z[1:]), conditioned(model, z), model, EXACT)


@pytest.mark.parametrize(("R", "N"), [(2.0, 1.0), (0.3, 0.1), (0.7, -0.3)])
def test_a_disturbance_that_the_measurement_noise_determines_leaves_no_error(R: float, N: float) -> None:
    """Qd = NR⁻¹Nᵀ: from a known start P stays exactly zero and x̂ is the truth, although R > 0 and Qd > 0."""
    model = DiscreteModel([[0.9]], [[N * N / R]], [[1]], [[R]], x0=[1], P0=[[0]], N=[[N]])
    v = np.random.default_rng(8).normal(size=5) * np.sqrt(R)
    x = [1.0]
    for k in range(4):
        x.append(0.9 * x[k] + N / R * v[k])
    found = filterpys(model, np.add(x, v)[:, None], first=0)
    assert not found.P_plus.any()
    assert not found.sd_minus.any()
    assert close(found.x_plus[:, 0], x, EXACT)


# --- given gains, failures --------------------------------------------------------------------------------------


@properties
@given(discrete_models(stable=True, correlated=False, varying=False), seeds)
def x(model: DiscreteModel, seed: int) -> None:
    """x̂⁺ = x̂⁻ + Kν with any gains; a missing element leaves its column out."""
    rng = np.random.default_rng(seed)
    plan = planned(model, STEPS)
    gains = replace(plan, K=rng.normal(size=plan.K.shape))
    z = record(model, STEPS, rng, gaps=0.3)
    found = kalman_filter(model, z[1:], gains=gains)
    x = model.x0
    for k in range(STEPS + 1):
        x = x if k == 0 else model.Phi @ x + offset_at(model, k - 1)
        nu = np.nan_to_num(z[k] - model.H @ x)
        x = x + (gains.K[k] @ nu if k else 0)
        assert close(found.x_plus[k], x, EXACT)
    assert identical(found, gains, [name for name in PLAN if name != "used"])
    assert np.array_equal(found.used, gains.used & ~np.isnan(z))


def test_overflow_is_reported_with_its_time() -> None:
    """A covariance beyond double precision is an error that names the step, not a NaN later."""
    model = DiscreteModel([[1e100]], [[1]], [[1]], [[inf]], x0=[0], P0=[[1]], dt=0.5)
    with pytest.raises(FloatingPointError, match=r"^P_minus: .*received an overflow at step 2 \(t = 1 s\)$"):
        planned(model, 4)


def test_innovations_that_rounding_makes_equal_are_reported_with_their_time() -> None:
    """Two measurements of one state so uncertain that their own noises are beyond the last digit of S."""
    model = DiscreteModel([[1]], [[1e12]], [[1], [1]], np.diag([1e-9, 1e-9]), x0=[0], P0=[[0]], dt=0.5)
    with pytest.raises(FloatingPointError, match=r"^S: .*received one singular by rounding at step 1 \(t = 0.5 s\)$"):
        planned(model, 3)


def test_error_is_estimate_minus_truth() -> None:
    """e = x̂ − x; measured data have no truth to compare with."""
    model = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[2], P0=[[1]])
    found = filterpys(model, [[3.0]])
    x = np.array([[1.0], [2.5]])
    assert same_bits(replace(found, truth=x).error(), found.x_plus - x)
    assert same_bits(replace(found, truth=x).error("minus"), found.x_minus - x)
    with pytest.raises(ValueError, match=r"^error: expected a simulated truth, received measured data"):
        found.error()


REFUSED: dict[str, tuple[Any, type[Exception], str]] = {
    "a continuous model": (
        lambda m: planned(ContinuousModel([[0]], [[1]], [[1]], [[1]], P0=[[1]]), 1),  # type: ignore[arg-type]  # refused
        TypeError,
        r"^model: expected a DiscreteModel for a number of steps \(discretise it, or give times\), received a ContinuousModel$",
    ),
    "no steps": (lambda m: planned(m, 0), ValueError, r"^steps: expected a whole number >= 1, received 0$"),
    "a fraction of a step": (lambda m: planned(m, 1.5), ValueError, r"^steps: expected a whole number >= 1, received 1.5$"),
    "a first measurement at t2": (lambda m: planned(m, 3, first=2), ValueError, r"^first: expected 0 or 1, received 2$"),
    "data of another width": (
        lambda m: filterpys(m, np.zeros((3, 1))), ValueError, r"^z: expected shape \(rows, 2\) or \(rows, 2, runs\), received \(3, 1\)$",
    ),
    "a flat record": (lambda m: filterpys(m, [1.0, 2.0]), ValueError, r"^z: expected shape .*received \(2,\)$"),
    "no row": (lambda m: filterpys(m, np.zeros((0, 2))), ValueError, r"^z: expected shape \(rows, 2\) .*received \(0, 2\)$"),
    "infinite data": (
        lambda m: filterpys(m, [[0, 0], [1, inf]]), ValueError, r"^z\[1\]\[1\]: expected finite .*received an infinite value$",
    ),
    "infinite data from t0 on": (
        lambda m: filterpys(m, [[0, 0], [1, inf]], first=0), ValueError, r"^z\[1\]\[1\]: expected finite .*received an infinite value$",
    ),
    "a gap in one run": (
        lambda m: filterpys(m, [[[0.0, 0.0]] * 2, [[1.0, nan], [1.0, 1.0]]]),
        ValueError,
        r"^z\[1\]\[0\]: expected finite numbers, or NaN in every run, received NaN in some runs only$",
    ),
    "gains of another length": (
        lambda m: filterpys(m, np.zeros((2, 2)), gains=planned(m, 3)),
        ValueError,
        r"^gains: expected gains of shape \(3, 2, 2\), received \(4, 2, 2\)$",
    ),
    "more steps than the model has": (
        lambda m: planned(replace(m, Phi=[np.eye(2)] * 3), 4),
        ValueError,
        r"^steps: expected at most 3 \(the model is given for so many\), received 4$",
    ),
    "H of another width": (lambda m: update(m.P0, [[1.0]], [[1.0]]), ValueError, r"^H: expected shape \(m, 2\), received \(1, 1\)$"),
    "an indefinite P": (lambda m: update([[1, 2], [2, 1]], m.H, m.R), ValueError, r"^P_minus: expected a nonnegative definite"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED.values(), ids=REFUSED)
def test_bad_input_is_refused(case: tuple[Any, type[Exception], str]) -> None:
    """Every message says what was expected and what was received."""
    call, error, message = case
    model = DiscreteModel(np.eye(2), np.eye(2), np.eye(2), np.eye(2), x0=[0, 0], P0=np.eye(2))
    with pytest.raises(error, match=message):
        call(model)


def test_gains_are_those_of_lab_1() -> None:
    """Random walk with Q = R = 1, P0 = 10: P⁻ = 11, 1.91667, 1.65714, P⁺ = 0.916667, 0.657143, 0.623656."""
    plan = planned(DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]]), 3)
    assert close(plan.P_minus[1:].ravel(), [11, 23 / 12, 58 / 35], EXACT)
    assert close(plan.P_plus[1:].ravel(), [11 / 12, 23 / 35, 58 / 93], EXACT)
    assert close(plan.K[1:].ravel(), plan.P_plus[1:].ravel(), EXACT)
    assert deviation(plan.P_plus[1:].ravel(), broken(plan.P_plus[1:].ravel())) > 0.04


@pytest.mark.parametrize("angle", [np.pi / 3, np.pi / 4, np.pi / 6, 2.02 * np.pi])
@pytest.mark.parametrize("known", [0, 1])
def test_known_combination_stays_known_when_turned_onto_a_state(angle: float, known: int) -> None:
    """A state that Φ makes of a known combination has variance 0, not ±1e-17, and no variance is ever negative."""
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    P0 = np.diag(np.roll([0.0, 2.0], known))
    plan = planned(DiscreteModel(turn, np.zeros((2, 2)), [[1, 0]], [[1]], x0=[0, 0], P0=P0), 26)
    k = np.arange(27)
    hits = np.abs(np.sin(2 * k * angle)) < 1e-9  # a multiple of a quarter turn: onto an axis
    assert hits[1:].any()
    least = np.diagonal(plan.P_minus, axis1=1, axis2=2).min(axis=1)
    assert (least[hits] <= 1e-30).all()
    assert (least >= 0).all()
    assert (least[~hits] > 1e-6).all()
    direction = np.stack([np.cos(k * angle + known * np.pi / 2), -np.sin(k * angle + known * np.pi / 2)])[::-1].T
    size = np.trace(plan.P_minus, axis1=1, axis2=2)
    rank_one = size[:, None, None] * direction[:, :, None] * direction[:, None, :]
    assert close(np.abs(plan.P_minus), np.abs(rank_one), EXACT)
    assert deviation(np.abs(plan.P_minus), np.abs(broken(rank_one))) > 0.04
