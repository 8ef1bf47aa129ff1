"""Defects of filterpy and python-control that shape this library, as strict xfails: an upstream repair is noticed here.

Every test states what would be right and is expected to fail today for the reason given.
"""

from __future__ import annotations

import importlib
import math
from typing import Any

import numpy as np
import pytest
import scipy.stats
from numpy.typing import NDArray

from ctlabs.filtering import steady
from ctlabs.models import DiscreteModel
from ctlabs.models.discretisation import interval
from tests.reference import EPS, EXACT, SOLVER, close, information_update, smoothed, update
from tests.strategies import covariance, record

pytestmark = pytest.mark.numerical

Array = NDArray[Any]


@pytest.fixture(name="fk")
def _fk() -> Any:
    return importlib.import_module("filterpy.kalman")


@pytest.fixture(name="control")
def _control() -> Any:
    return importlib.import_module("control")


def tracking(Q: float = 0.2) -> DiscreteModel:
    """A double integrator with noise of full rank."""
    return DiscreteModel([[1, 1], [0, 1]], Q * np.eye(2), [[1, 0]], [[0.5]], x0=[0, 0], P0=np.diag([4.0, 1.0]))


def filterpys(kind: Any, model: DiscreteModel) -> Any:
    """A filterpy filter of this kind with the model's matrices; N is a lag where the kind has one."""
    kf = kind(dim_x=model.n, dim_z=model.m)
    kf.x, kf.P, kf.F = model.x0[:, None].copy(), model.P0.copy(), model.Phi.copy()
    kf.Q, kf.H, kf.R = model.Qd.copy(), model.H.copy(), model.R.copy()
    return kf


# --- filterpy ---------------------------------------------------------------------------------------------------


def information_filter(fk: Any, model: DiscreteModel, P_inv: Array) -> Any:
    kf = fk.InformationFilter(dim_x=model.n, dim_z=model.m)
    kf.x, kf.P_inv, kf.F = model.x0[:, None].copy(), P_inv, model.Phi.copy()
    kf.Q, kf.H, kf.R_inv = model.Qd.copy(), model.H.copy(), np.linalg.inv(model.R)
    return kf


@pytest.mark.xfail(
    reason="InformationFilter takes HᵀR⁻¹H + P⁻¹ for the covariance of the innovation", raises=AssertionError
)
def test_likelihood_of_the_information_filter(fk: Any) -> None:
    """log N(ν; 0, HP⁻Hᵀ + R) for a scalar, where the shapes at least agree."""
    model = DiscreteModel([[1]], [[1]], [[1]], [[3]], x0=[0], P0=[[2]])
    kf = information_filter(fk, model, np.linalg.inv(model.P0))
    kf.predict()
    kf.update(np.array([[1.5]]))
    assert close(kf.log_likelihood, scipy.stats.norm.logpdf(1.5, scale=math.sqrt(6)), EXACT)


@pytest.mark.xfail(
    reason="InformationFilter's start from P⁻¹ = 0 inverts a singular matrix", raises=np.linalg.LinAlgError
)
def test_information_filter_starts_from_nothing(fk: Any) -> None:
    """P⁻¹ = 0 and no disturbances: two exact positions of a line give its slope."""
    kf = information_filter(fk, tracking(0.0), np.zeros((2, 2)))
    for z in (1.0, 3.0, 5.0, 7.0):
        kf.predict()
        kf.update(np.array([[z]]))
    assert close(np.linalg.solve(kf.P_inv, kf.P_inv @ kf.x)[:, 0], [7.0, 2.0], SOLVER)


@pytest.mark.xfail(
    reason="without information InformationFilter predicts with (A + Q)⁻¹ and leaves P⁻¹ as it was",
    raises=AssertionError,
)
def test_information_filter_recovers_from_nothing(fk: Any) -> None:
    """P⁻¹ = 0 with disturbances: after twenty measurements it is the filter with a very wide prior."""
    model = tracking()
    kf, x, P = information_filter(fk, model, np.zeros((2, 2))), np.zeros(2), 1e9 * np.eye(2)
    for z in np.arange(20.0):
        kf.predict()
        kf.update(np.array([[z]]))
        x, P = model.Phi @ x, model.Phi @ P @ model.Phi.T + model.Qd
        x, P, _ = update(x, P, np.array([z]), model.H, model.R)
    assert close(kf.x[:, 0], x, 1e-6)
    assert close(np.linalg.inv(kf.P_inv), P, 1e-6)


@pytest.mark.xfail(reason="InformationFilter.batch_filter is not implemented", raises=NotImplementedError)
def test_information_filter_in_batch(fk: Any) -> None:
    """A record filtered in one call."""
    model = tracking()
    kf = information_filter(fk, model, np.linalg.inv(model.P0))
    means, _ = kf.batch_filter([np.array([[1.0]])])
    expected, _, _ = information_update(
        model.x0, model.Phi @ model.P0 @ model.Phi.T + model.Qd, np.ones(1), model.H, model.R
    )
    assert close(means[0, :, 0], expected, EXACT)


@pytest.mark.xfail(
    reason="FixedLagSmoother's gains start from P⁺ instead of P⁻, leave out Φ and suppose the steady state",
    raises=AssertionError,
)
def test_fixed_lag_smoother_is_optimal(fk: Any) -> None:
    """x_{k−1} given the measurements up to k, against joint conditioning (and x_{k−2}, should the lag mean that)."""
    model = tracking()
    z = record(model, 8, np.random.default_rng(2))
    kf = fk.FixedLagSmoother(dim_x=2, dim_z=1, N=2)
    kf.x, kf.P, kf.F = model.x0[:, None].copy(), model.P0.copy(), model.Phi.copy()
    kf.Q, kf.H, kf.R = model.Qd.copy(), model.H.copy(), model.R.copy()
    for k in range(1, 8):
        kf.smooth(z[k, :, None])
    assert any(close(kf.xSmooth[5][:, 0], smoothed(model, z[: last + 1]).x[6], 1e-6) for last in (7, 8))


def smoother_inputs(fk: Any) -> tuple[Any, Any, Any, Any, Any, Any]:
    rng = np.random.default_rng(1)
    Phi, Qd = rng.normal(size=(5, 2, 2)), np.array([covariance(rng, 2) for _ in range(5)])
    model = DiscreteModel(Phi, Qd, [[1, 0.5]], [[0.5]], x0=[1, 0], P0=np.eye(2))
    z = record(model, 5, rng)
    kf = fk.KalmanFilter(dim_x=2, dim_z=1)
    kf.x, kf.P, kf.H, kf.R = model.x0[:, None].copy(), model.P0.copy(), model.H.copy(), model.R.copy()
    means, covs, _, _ = kf.batch_filter(list(z[1:, :, None]), Fs=list(Phi), Qs=list(Qd))
    return kf, means, covs, list(Phi), list(Qd), smoothed(model, z).x[1:]


@pytest.mark.xfail(reason="the module's rts_smoother takes the matrices of the step before", raises=AssertionError)
def test_module_level_smoother_of_a_varying_model(fk: Any) -> None:
    """The function applied to what batch_filter returns gives the smoothed trajectory."""
    _, means, covs, Phi, Qd, expected = smoother_inputs(fk)
    assert close(fk.rts_smoother(means, covs, Phi, Qd)[0][:, :, 0], expected, SOLVER)


def test_class_level_smoother_of_a_varying_model(fk: Any) -> None:
    """The method of the same name is right, on the same numbers (so the test above fails for its reason)."""
    kf, means, covs, Phi, Qd, expected = smoother_inputs(fk)
    assert close(kf.rts_smoother(means, covs, Phi, Qd)[0][:, :, 0], expected, SOLVER)


@pytest.mark.xfail(reason="update_sequential uses diagonal blocks of R only", raises=AssertionError)
def test_sequential_update_with_correlated_noises(fk: Any) -> None:
    """One measurement after another is the joint update, also when R is not diagonal."""
    H, R, z = np.eye(2), np.array([[1.0, 0.6], [0.6, 0.8]]), np.array([1.0, -1.0])
    kf = fk.KalmanFilter(dim_x=2, dim_z=2)
    kf.x, kf.P, kf.H, kf.R = np.zeros((2, 1)), np.diag([2.0, 1.0]), H, R
    x, P, _ = update(np.zeros(2), kf.P.copy(), z, H, R)
    for i in range(2):
        kf.update_sequential(i, z[i : i + 1])
    assert close(kf.x[:, 0], x, EXACT)
    assert close(kf.P, P, EXACT)


@pytest.mark.xfail(
    reason="SquareRootKalmanFilter.P_post returns the covariance before the update", raises=AssertionError
)
def test_square_root_filter_reports_its_posterior(fk: Any) -> None:
    """P_post is the covariance after the update."""
    kf = filterpys(fk.SquareRootKalmanFilter, tracking())
    kf.predict()
    kf.update(np.array([[1.0]]))
    assert close(kf.P_post, kf.P, EXACT)


@pytest.mark.xfail(
    reason="SquareRootKalmanFilter factors by Cholesky, which refuses singular matrices", raises=np.linalg.LinAlgError
)
@pytest.mark.parametrize("field", ["Q", "P"])
def test_square_root_filter_takes_singular_covariances(fk: Any, field: str) -> None:
    """A state without disturbance, or known at the start, is a legitimate model."""
    kf = fk.SquareRootKalmanFilter(dim_x=2, dim_z=1)
    setattr(kf, field, np.diag([0.0, 1.0]))
    assert close(getattr(kf, field), np.diag([0.0, 1.0]), EXACT)


@pytest.mark.xfail(
    reason="a scalar assigned to Q is added to every element of P, not to its diagonal", raises=AssertionError
)
def test_scalar_process_noise_is_diagonal(fk: Any) -> None:
    """kf.Q = q means what predict(Q=q) means, P + qI."""
    kf = fk.KalmanFilter(dim_x=2, dim_z=1)
    kf.Q = 0.1
    kf.predict()
    assert close(kf.P, 1.1 * np.eye(2), EXACT)


def test_scalar_argument_of_predict_is_diagonal(fk: Any) -> None:
    """predict(Q=q) does add qI (so the test above fails for its reason)."""
    kf = fk.KalmanFilter(dim_x=2, dim_z=1)
    kf.predict(Q=0.1)
    assert close(kf.P, 1.1 * np.eye(2), EXACT)


@pytest.mark.xfail(reason="R = ∞ makes 0·∞ in Joseph's form", raises=AssertionError)
def test_infinite_noise_is_no_measurement(fk: Any) -> None:
    """K = 0 and P⁺ = P⁻."""
    kf = fk.KalmanFilter(dim_x=1, dim_z=1)
    with np.errstate(invalid="ignore"):
        kf.update([[1.0]], R=np.array([[np.inf]]), H=np.ones((1, 1)))
    assert close(kf.P, 1.0, EXACT)


@pytest.mark.xfail(
    reason="van_loan_discretization takes the exponential of −F dt and F dt in one block", raises=AssertionError
)
def test_van_loan_discretisation_of_a_stiff_model() -> None:
    """At |λ|dt = 50 against the library's doubling, which agrees with 60 digits."""
    F, G = np.array([[-50.0, 3.0], [2.0, -1.0]]), np.eye(2)
    _, Q = importlib.import_module("filterpy.common").van_loan_discretization(F, G, 1.0)
    assert close(Q, interval(F, G @ G.T, 1.0).Qd, 1e-6)


# --- python-control ---------------------------------------------------------------------------------------------


def test_dlqe_returns_the_predictor_gain(control: Any) -> None:
    """Its L is ΦK and its P is P⁻: a convention, to be known by whoever compares gains."""
    model = tracking()
    limit = steady.solve(model)
    L, P, _ = control.dlqe(model.Phi, np.eye(2), model.H, model.Qd, model.R)
    assert close(L, limit.K_pred, SOLVER)
    assert close(P, limit.P_minus, SOLVER)
    assert not close(L, limit.K, 1e-2)


@pytest.mark.xfail(reason="lqe and dlqe have no cross-covariance", raises=NotImplementedError)
@pytest.mark.parametrize("name", ["lqe", "dlqe"])
def test_estimators_with_correlated_noises(control: Any, name: str) -> None:
    """With N the gain differs from that without."""
    A = np.array([[0.5]])
    L = getattr(control, name)(A - (name == "lqe"), [[1]], [[1]], [[1]], [[1]], [[0.5]])[0]
    assert not close(L, getattr(control, name)(A - (name == "lqe"), [[1]], [[1]], [[1]], [[1]])[0], 1e-3)


def test_care_takes_correlated_noises(control: Any) -> None:
    """care(S=…) is the way with N ≠ 0: for F = −1/2, Q = R = 1, N = 1/2, P = √(7/4) − 1 and Kc = P + N."""
    P, _, K = control.care(np.array([[-0.5]]), np.eye(1), np.eye(1), np.eye(1), S=np.array([[0.5]]))
    assert close(P, math.sqrt(7 / 4) - 1, SOLVER)
    assert close(K, math.sqrt(7 / 4) - 0.5, SOLVER)


@pytest.mark.xfail(reason="lqe forms GQGᵀ itself and may refuse its rounding as asymmetry", raises=TypeError)
def test_lqe_accepts_every_strength(control: Any) -> None:
    """GQGᵀ is symmetric but for the last digit."""
    for seed in range(200):
        rng = np.random.default_rng(seed)
        G, Q = rng.normal(size=(3, 3)) * 1e3, covariance(rng, 3)
        control.lqe(-np.eye(3), G, np.eye(3), Q, np.eye(3))


# Two eigenvalues of its pencil are 1: rounding moves them by √ε, off the unit circle or along it, and decides what dare says.
@pytest.mark.xfail(
    reason="dare refuses a constant without disturbances beside a growing state",
    raises=np.linalg.LinAlgError,
    strict=False,
)
def test_dare_of_a_growing_state_and_a_constant(control: Any) -> None:
    """Φ = diag(1.2, 1), Q = 0: the recursion's limit is diag(1.2² − 1, 0), as steady.solve says."""
    model = DiscreteModel(np.diag([1.2, 1.0]), np.zeros((2, 2)), [[1, 1]], [[1]], x0=[0, 0], P0=np.eye(2))
    assert close(steady.solve(model).P_minus, np.diag([1.2**2 - 1, 0]), SOLVER)
    P, _, _ = control.dare(model.Phi.T, model.H.T, model.Qd, model.R)
    assert close(P, np.diag([1.2**2 - 1, 0]), 100 * EPS**0.5)


@pytest.mark.xfail(
    reason="gram, MIMO tf2ss and state-space minreal need slycot", raises=(ImportError, NotImplementedError, TypeError)
)
@pytest.mark.parametrize(
    "call",
    [
        lambda c, s: c.gram(s, "c"),
        lambda c, s: c.tf2ss(c.tf([[[1], [1]], [[1], [1]]], [[[1, 1], [1, 2]], [[1, 3], [1, 4]]])),
        lambda c, s: c.minreal(s, verbose=False),
    ],
    ids=["gram", "tf2ss", "minreal"],
)
def test_state_space_tools_without_slycot(control: Any, call: Any) -> None:
    """Gramian, realisation and minimal realisation with the installed packages alone."""
    call(control, control.ss([[-1, 0], [0, -2]], [[1], [1]], [[1, 1]], [[0]]))


def test_tf2ss_numbers_states_in_reverse(control: Any) -> None:
    """1/(s² + 3s + 2): the states are (ẏ, y) and not (y, ẏ): a convention that labels of states must not rely on."""
    system = control.tf2ss(control.tf([1], [1, 3, 2]))
    assert close(system.A, [[-3, -2], [1, 0]], EXACT)
    assert close(system.C, [[0, 1]], EXACT)


@pytest.mark.xfail(strict=True, reason="MMAEFilterBank pairs states with filters when it mixes their covariances")
def test_the_covariance_of_a_bank_is_that_of_the_mixture(fk):
    """P = Σ p_i (P_i + (x_i − x̄)(x_i − x̄)ᵀ) over all filters of the bank."""
    filters = []
    for x, P in ((0.0, 1.0), (2.0, 3.0)):
        kf = fk.KalmanFilter(dim_x=1, dim_z=1)
        kf.x, kf.P = np.array([[x]]), np.array([[P]])
        kf.H, kf.R, kf.Q = np.eye(1), np.eye(1), np.zeros((1, 1))
        filters.append(kf)
    bank = fk.MMAEFilterBank(filters, [0.5, 0.5], dim_x=1, H=np.eye(1))
    bank.update(np.array([[1.0]]))
    mean = sum(p * kf.x for p, kf in zip(bank.p, filters, strict=True))
    mixture = sum(p * (kf.P + (kf.x - mean) ** 2) for p, kf in zip(bank.p, filters, strict=True))
    assert close(bank.P, mixture, EXACT)
