"""What a wrong filter really does: the recursion against dense Gaussian algebra, closed forms, the labs' numbers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from numpy.typing import NDArray

from ctlabs.analysis import budgets, sensitivity, sources
from ctlabs.filtering import steady
from ctlabs.labs.experiment import covariances
from ctlabs.models import ContinuousModel, DiscreteModel
from ctlabs.models.discretisation import discretise
from tests import reference
from tests.reference import EXACT, SOLVER, broken, close
from tests.strategies import covariance, discrete_models, seeds, transition

pytestmark = pytest.mark.numerical

Array = NDArray[Any]
STEPS = 6


def scalar(Phi: float = 1.0, Qd: float = 1.0, R: float = 1.0, P0: float = 10.0, **more: Any) -> DiscreteModel:
    return DiscreteModel([[Phi]], [[Qd]], [[1.0]], [[R]], x0=[0.0], P0=[[P0]], **more)


def hit(matrix: Array) -> Array:
    """The matrix broken by 5 % in its largest entry, at a step that counts if it varies."""
    if matrix.ndim == 2:
        return broken(matrix)
    result = np.array(matrix)
    result[3] = broken(matrix[3])
    return result


def other(truth: DiscreteModel, seed: int) -> tuple[DiscreteModel, Array]:
    """A design that shares nothing with the truth but the number of measurements and dt, and what it estimates."""
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(1, 4)), truth.m
    R = np.array([covariance(rng, m) for _ in range(STEPS + 1)])
    R[2, 0, :], R[2, :, 0], R[2, 0, 0] = 0.0, 0.0, np.inf
    design = DiscreteModel(
        Phi=np.array([transition(rng, n, stable=True) for _ in range(STEPS)]),
        Qd=covariance(rng, n, rank=1),
        H=rng.normal(size=(m, n)),
        R=R,
        x0=rng.normal(size=n),
        P0=covariance(rng, n),
        dt=truth.dt,
        offset=rng.normal(size=(STEPS, n)),
    )
    return design, rng.normal(size=(n, truth.n))


def densely(truth: DiscreteModel, design: DiscreteModel, C: Array, first: int = 1) -> tuple[Array, Array]:
    """Moments of e⁺ by definition: the textbook filter is an affine map of the data, whose joint moments are known."""
    J = reference.joint(truth, STEPS)
    m = truth.m
    made = [reference.present(truth, np.zeros((STEPS + 1, m)), k, 0) for k in range(STEPS + 1)]
    nothing = np.full((STEPS + 1, m), np.nan)
    for k, elements in enumerate(made):
        nothing[k, elements] = 0.0
    constant = reference.recursion(design, nothing, first).x_plus
    places, columns = [], []
    for k, elements in enumerate(made):
        for i in elements:
            unit = nothing.copy()
            unit[k, i] = 1.0
            places.append(J.z(k, [i])[0])
            columns.append(reference.recursion(design, unit, first).x_plus - constant)
    means, covs = [], []
    for k in range(STEPS + 1):
        T = reference.exact(np.zeros((design.n, len(J.mean))))
        T[:, places] = reference.exact([column[k] for column in columns]).T
        T[:, J.x(k)] -= reference.exact(C)
        means.append(constant[k] + reference.as_floats(T @ J.mean))
        covs.append(reference.as_floats(T @ J.cov @ T.T))
    return np.array(means), np.array(covs)


@given(discrete_models(steps=STEPS), st.sampled_from([0, 1]))
def test_the_right_design_has_the_filters_covariance_and_no_bias(model: DiscreteModel, first: int) -> None:
    """With design = truth the true covariance is the filter's own, and the mean error is zero at every step."""
    result = sensitivity.actual(model, model, STEPS, first=first)
    plan = covariances(model, STEPS, first)
    assert close(result.P_minus, plan.P_minus, EXACT)
    assert close(result.P_plus, plan.P_plus, EXACT)
    assert not result.bias_minus.any()
    assert not result.bias_plus.any()
    wrong = sensitivity.actual(model, replace(model, H=hit(model.H)), STEPS, first=first)
    assert not close(wrong.P_plus, plan.P_plus, 1e-9) or not plan.P_plus.any()


@given(discrete_models(steps=STEPS, singular=False), st.sampled_from([0, 1]), seeds)
@settings(max_examples=20)
def test_actual_is_the_dense_covariance_of_the_error(truth: DiscreteModel, first: int, seed: int) -> None:
    """For any truth and any design the recursion gives the moments of x̂ − Cx that the joint distribution gives."""
    design, C = other(truth, seed)
    result = sensitivity.actual(truth, design, STEPS, compare=C, first=first)
    bias, cov = densely(truth, design, C, first)
    assert close(result.bias_plus, bias, EXACT)
    assert close(result.P_plus, cov, EXACT)
    assert close(result.mse_plus, cov + bias[:, :, None] * bias[:, None, :], EXACT)
    noticed = sensitivity.actual(replace(truth, H=hit(truth.H)), design, STEPS, compare=C, first=first)
    assert not close(noticed.P_plus, cov, 1e-9)


@given(discrete_models(steps=STEPS, varying=False, correlated=False), seeds)
@settings(max_examples=15)
def test_measurements_the_truth_does_not_make_are_missing_for_the_filter(truth: DiscreteModel, seed: int) -> None:
    """Infinite R in the truth, element by element, acts on the filter as NaN in its data."""
    R = np.repeat(truth.R[None], STEPS + 1, axis=0)
    R[3] = np.diag(np.full(truth.m, np.inf))
    R[5, -1], R[5, :, -1], R[5, -1, -1] = 0.0, 0.0, np.inf
    truth = replace(truth, R=R)
    design, C = other(truth, seed)
    bias, cov = densely(truth, design, C)
    result = sensitivity.actual(truth, design, STEPS, compare=C)
    assert close(result.bias_plus, bias, EXACT)
    assert close(result.P_plus, cov, EXACT)
    assert not result.claimed.used[3].any()


@given(discrete_models(steps=STEPS), seeds)
def test_no_other_unbiased_linear_filter_is_better(truth: DiscreteModel, seed: int) -> None:
    """A filter with other noise covariances, or any gains, has P_actual − P nonnegative definite at every step."""
    rng = np.random.default_rng(seed)
    best = covariances(truth, STEPS)
    design = replace(truth, N=None, Qd=covariance(rng, truth.n), R=covariance(rng, truth.m, size=3.0))
    arbitrary = sensitivity.fixed_gain(replace(truth, N=None), 0.3 * rng.normal(size=(truth.n, truth.m)), STEPS)
    for result in (
        sensitivity.actual(truth, design, STEPS),
        sensitivity.actual(truth, replace(truth, N=None), STEPS, gains=arbitrary),
    ):
        excess = np.linalg.eigvalsh(result.P_plus - best.P_plus)
        size = np.abs(result.P_plus).max(axis=(1, 2))
        assert (excess.min(axis=1) >= -EXACT * np.maximum(size, 1e-300)).all()
        assert np.abs(result.bias_plus).max() <= EXACT * max(1.0, np.abs(truth.x0).max())


@given(discrete_models(steps=STEPS, correlated=False))
def test_fixed_gain_with_the_optimal_gains_is_the_optimal_schedule(model: DiscreteModel) -> None:
    """The Joseph recursion with the filter's own gains returns its own covariances and innovations."""
    plan = covariances(model, STEPS)
    same = sensitivity.fixed_gain(model, plan.K, STEPS)
    assert close(same.P_plus, plan.P_plus, EXACT)
    assert close(same.P_minus, plan.P_minus, EXACT)
    assert close(same.S, plan.S, EXACT)
    assert (same.used == plan.used).all()


def test_an_unstable_truth_does_not_swamp_its_filters_error() -> None:
    """Where the state's variance grows to 1e40 the error of the right filter keeps its digits."""
    truth = DiscreteModel([[1.3, 1.0], [0.0, 1.2]], np.eye(2), [[1.0, 0.0]], [[0.1]], x0=[1e3, 0.0], P0=1e3 * np.eye(2))
    assert close(sensitivity.actual(truth, truth, 300).P_plus, covariances(truth, 300).P_plus, EXACT)


def test_an_overflow_names_its_step() -> None:
    """A truth whose variance leaves the floating-point range while it reaches the error is refused with the step."""
    with pytest.raises(FloatingPointError, match=r"overflow at step \d+"):
        sensitivity.actual(scalar(Phi=1e30), scalar(Phi=0.5), 40)


# Budget


@given(discrete_models(steps=STEPS), seeds)
def test_the_budget_adds_up(model: DiscreteModel, seed: int) -> None:
    """The contributions of the sources sum to the covariance that is computed with all of them at work."""
    design, C = other(model, seed)
    for result in (
        budgets.budget(model, STEPS),
        budgets.budget(model, STEPS, design=design, compare=C),
    ):
        assert len(result.names) == len(result.parts)
        assert close(result.parts.sum(axis=0), result.P_plus, EXACT)
        assert np.linalg.eigvalsh(result.parts).min() >= -1e-10 * max(1.0, np.abs(result.parts).max())
        if len(result.parts) > 1:
            assert not close(result.parts[1:].sum(axis=0), result.P_plus, EXACT)


def test_each_source_of_the_budget_is_what_it_is_alone() -> None:
    """A source's part equals the covariance of a truth in which everything else is certain."""
    model = DiscreteModel(
        [[1.0, 0.5], [0.0, 0.9]], np.diag([0.3, 0.7]), np.eye(2), np.diag([1.0, 2.0]),
        x0=[0, 0], P0=np.diag([4.0, 5.0]), states=["x", "v"], measurements=["range", "speed"],
    )  # fmt: skip
    result = budgets.budget(model, 8)
    none = np.zeros((2, 2))
    quiet = {"P0": none, "Qd": none, "R": none}
    one, two = np.diag([1.0, 0.0]), np.diag([0.0, 1.0])
    alone = {
        "initial x": {"P0": 4.0 * one},
        "initial v": {"P0": 5.0 * two},
        "noise on x": {"Qd": 0.3 * one},
        "noise on v": {"Qd": 0.7 * two},
        "noise of range": {"R": 1.0 * one},
        "noise of speed": {"R": 2.0 * two},
    }
    assert result.names == tuple(alone)
    for part, source in zip(result.parts, alone.values(), strict=True):
        truth = replace(model, **(quiet | source))
        plan = covariances(model, 8)
        assert close(part, sensitivity.actual(truth, model, 8, gains=plan).P_plus, EXACT)


def test_correlated_quantities_are_one_source() -> None:
    """Correlated initial states, process noises and measurement noises are grouped, across w and v too."""
    full = np.array([[2.0, 0.5], [0.5, 1.0]])
    model = DiscreteModel(0.9 * np.eye(2), full, np.eye(2), full, x0=[0, 0], P0=full, states=["a", "b"])
    assert budgets.budget(model, 3).names == ("initial a, b", "noise on a, b", "noise of z1, z2")
    mixed = replace(model, Qd=np.diag([2.0, 1.0]), R=np.diag([2.0, 1.0]), N=[[0.0, 0.5], [0.0, 0.0]])
    result = budgets.budget(mixed, 3)
    assert result.names == ("initial a, b", "noise on a and of z2", "noise on b", "noise of z1")
    assert close(result.parts.sum(axis=0), result.P_plus, EXACT)


def test_given_groups_split_the_process_noise_by_its_physical_inputs() -> None:
    """The parts of Qd by noise input add up to Qd, and their contributions to the total."""
    plant = ContinuousModel([[0, 1], [0, -0.5]], np.eye(2), np.diag([0.2, 3.0]), [[1, 0]], P0=np.eye(2))
    model = discretise(plant, 0.5, [[1.0]])
    groups = sources.noise_by_input(plant, 0.5)
    assert close(sum(groups.values()), model.Qd, EXACT)
    result = budgets.budget(model, 10, groups=groups)
    assert "noise w1" in result.names
    assert "noise w2" in result.names
    assert close(result.parts.sum(axis=0), result.P_plus, EXACT)
    assert result.table()[-1][0] == "total"
    assert np.allclose(np.sum([row[1:] for row in result.table()[:-1]], axis=0), result.table()[-1][1:], rtol=EXACT)
    with pytest.raises(ValueError, match="groups: expected parts that add up to Qd"):
        budgets.budget(model, 10, groups={"all": broken(model.Qd)})
    with pytest.raises(ValueError, match="groups: expected a model without N"):
        budgets.budget(replace(model, N=[[0.01], [0.0]]), 10, groups=groups)


def test_states_of_one_name_are_still_two_sources() -> None:
    """Equal labels do not make one source overwrite another."""
    model = DiscreteModel(0.9 * np.eye(2), np.eye(2), np.eye(2), np.eye(2), x0=[0, 0], P0=np.eye(2), states=["x", "x"])
    result = budgets.budget(model, 2)
    assert len(set(result.names)) == 6
    assert close(result.parts.sum(axis=0), result.P_plus, EXACT)


# The steady state


@given(discrete_models(varying=False, singular=False), seeds)
@settings(max_examples=12)
def test_the_steady_state_is_the_limit_of_the_recursion(truth: DiscreteModel, seed: int) -> None:
    """For a stable truth and a design of any other order the joint Lyapunov equation gives what many steps give."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4))
    design = DiscreteModel(
        transition(rng, n, stable=True), covariance(rng, n), rng.normal(size=(truth.m, n)), covariance(rng, truth.m),
        x0=rng.normal(size=n), P0=covariance(rng, n), dt=truth.dt, offset=rng.normal(size=n),
    )  # fmt: skip
    C = rng.normal(size=(n, truth.n))
    limit = sensitivity.steady(truth, design, C)
    late = sensitivity.actual(truth, design, 500, compare=C)
    for name in ("P_minus", "P_plus", "bias_minus", "bias_plus", "mse_minus", "mse_plus"):
        assert close(getattr(late, name)[-1], getattr(limit, name), SOLVER), name
    other_limit = sensitivity.steady(replace(truth, Phi=broken(truth.Phi, by=-0.05)), design, C)
    assert not close(other_limit.P_plus, limit.P_plus, SOLVER)


@given(discrete_models(varying=False, singular=False, stable=None, offset=False))
def test_the_steady_error_of_the_right_design_is_that_of_the_riccati_equation(model: DiscreteModel) -> None:
    """With design = truth, unstable or not, the Lyapunov route and the Riccati equation agree."""
    own = steady.solve(model)
    limit = sensitivity.steady(model, model)
    assert close(limit.P_minus, own.P_minus, SOLVER)
    assert close(limit.P_plus, own.P_plus, SOLVER)


def test_a_limit_of_ever_smaller_gains_is_found_for_the_right_design() -> None:
    """A constant without process noise becomes known exactly: zero error, although the limiting gain is zero."""
    constant = scalar(Qd=0.0)
    assert not sensitivity.steady(constant, constant).P_plus.any()
    with pytest.raises(ValueError, match="every pole inside the unit circle, received the pole 1"):
        sensitivity.steady(constant, scalar(Qd=0.0, R=2.0))


@pytest.mark.parametrize(("Qd", "R", "step"), [(1.0, 1.0, 1.0), (0.3, 2.0, -0.7)])
def test_a_forgotten_input_gives_the_steady_bias_of_lab_2(Qd: float, R: float, step: float) -> None:
    """A drift uτ that the filter does not know leaves −uτ(1−K)/K after and −uτ/K before an update."""
    truth, design = scalar(Qd=Qd, R=R, offset=[step]), scalar(Qd=Qd, R=R)
    rho = Qd / R
    K = (-rho + np.sqrt(rho**2 + 4 * rho)) / 2
    limit = sensitivity.steady(truth, design)
    assert close(limit.bias_plus, [-step * (1 - K) / K], SOLVER)
    assert close(limit.bias_minus, [-step / K], SOLVER)
    assert close(limit.mse_plus, [[R * K + (step * (1 - K) / K) ** 2]], SOLVER)
    assert limit.bias_plus == pytest.approx([-0.618034], abs=5e-7) or step != 1.0
    bias = sensitivity.actual(truth, design, 200).bias_minus[-1]
    assert close(bias, limit.bias_minus, SOLVER)


def test_a_wrong_initial_mean_fades_by_the_product_of_lab_1() -> None:
    """A wrong start leaves the bias b0·Π(1 − K_j)."""
    truth = scalar()
    wrong = replace(truth, x0=[2.0])
    result = sensitivity.actual(truth, wrong, 10)
    assert close(result.bias_plus[:, 0], 2.0 * np.cumprod(1 - result.claimed.K[:, 0, 0]), EXACT)


@pytest.mark.parametrize("Phi", [0.78, -0.5, 1.0, 1.3])
@pytest.mark.parametrize("K", [0.3, 0.6, 0.95])
def test_the_constant_gain_formula_of_lab_7(Phi: float, K: float) -> None:
    """P/R = [(1−K)²λ + K²]/[1 − (1−K)²Φ²], also for an unstable or integrating system; no limit if |(1−K)Φ| ≥ 1."""
    Q, R = 0.39, 0.5
    model = scalar(Phi=Phi, Qd=Q, R=R, P0=1.0)
    expected = ((1 - K) ** 2 * Q / R + K**2) / (1 - (1 - K) ** 2 * Phi**2)
    assert close(sensitivity.steady(model, model, K=[[K]]).P_plus / R, [[expected]], EXACT)
    steps = 2 + int(np.log(1e-14) / np.log(((1 - K) * Phi) ** 2))  # what is left of P0 is below EXACT
    late = sensitivity.actual(model, model, steps, gains=sensitivity.fixed_gain(model, [[K]], steps)).P_plus[-1]
    assert close(late / R, [[expected]], EXACT)
    assert not close(sensitivity.steady(model, model, K=[[1.05 * K]]).P_plus / R, [[expected]], 1e-6)


@pytest.mark.parametrize(("Phi", "K"), [(1.0, 0.0), (1.5, 0.3), (-2.0, 0.5), (2.5, 0.3)])
def test_a_gain_too_small_for_the_system_has_no_limit(Phi: float, K: float) -> None:
    """Where |(1−K)Φ| ≥ 1 the error does not converge, and the pole is named."""
    model = scalar(Phi=Phi)
    with pytest.raises(ValueError, match=rf"received the pole {(1 - K) * Phi:g}"):
        sensitivity.steady(model, model, K=[[K]])


def coloured(a: float, T: float, dt: float, R: float, power: float) -> tuple[DiscreteModel, list[DiscreteModel]]:
    """Lab 8: the truth (x, y) and the two filters that take y for white."""
    truth = ContinuousModel(
        [[-a, 1], [0, -1 / T]], [[0], [1]], [[2 * power / T]], [[1, 0]], P0=np.diag([0.0, power]), states=["x", "y"]
    )
    strengths = [2 * power * T, 2 * power * T / (1 + a * T)]
    designs = [ContinuousModel([[-a]], [[1]], [[q]], [[1]], P0=[[0]]) for q in strengths]
    return discretise(truth, dt, [[R]]), [discretise(design, dt, [[R]]) for design in designs]


def test_the_simplified_filters_of_lab_8_have_the_numbers_of_its_sheet() -> None:
    """Optimal 0.336466; claimed and true 0.368405, 0.337098 (variant 1) and 0.342549, 0.336745 (variant 2)."""
    truth, designs = coloured(1.0, 0.1, 0.5, 2.0, 5.0)
    assert steady.solve(truth).P_plus[0, 0] == pytest.approx(0.336466, abs=5e-7)
    expected = [(0.368405, 0.337098), (0.342549, 0.336745)]
    for design, (claimed, true) in zip(designs, expected, strict=True):
        limit = sensitivity.steady(truth, design, [[1, 0]])
        assert limit.claimed is not None
        assert limit.claimed.P_plus[0, 0] == pytest.approx(claimed, abs=5e-7)
        assert limit.P_plus[0, 0] == pytest.approx(true, abs=5e-7)


def plainly(truth: DiscreteModel, phi: float, K: Array, R: float, steps: int) -> Array:
    """The variance of x̂ − x by the covariance of (x, y, x̂) itself, as the sheet of lab 8 asks."""
    X = np.zeros((3, 3))
    X[:2, :2] = truth.P0
    e, found = np.array([-1.0, 0.0, 1.0]), [0.0]
    for k in range(1, steps + 1):
        move = np.block([[truth.Phi, np.zeros((2, 1))], [K[k] * truth.Phi[:1], np.array([[(1 - K[k]) * phi]])]])
        into = np.array([[1.0, 0.0], [0.0, 1.0], [K[k], 0.0]])
        X = move @ X @ move.T + into @ truth.Qd @ into.T
        X[2, 2] += K[k] ** 2 * R
        found.append(e @ X @ e)
    return np.array(found)


@pytest.mark.parametrize(
    ("a", "T", "dt", "R"), [(1.0, 0.1, 0.5, 2.0), (0.0, 1.0, 0.2, 0.3), (-0.4, 0.5, 0.5, 1.0), (3.0, 2.0, 0.1, 5.0)]
)
def test_lab_8_by_the_joint_covariance_of_truth_and_estimate(a: float, T: float, dt: float, R: float) -> None:
    """The recursion of (x, y, x̂) itself, written out plainly, gives the same true variance, for an unstable a too."""
    truth, designs = coloured(a, T, dt, R, 5.0)
    for design in designs:
        result = sensitivity.actual(truth, design, 20, compare=[[1, 0]])
        phi, K = design.Phi[0, 0], result.claimed.K[:, 0, 0]
        assert close(result.P_plus[:, 0, 0], plainly(truth, phi, K, R, 20), 1e-10)
        assert not close(result.P_plus[:, 0, 0], plainly(truth, 1.05 * phi, K, R, 20), 1e-4)


def test_an_integrating_truth_that_the_design_follows_has_a_limit() -> None:
    """With a = 0 the truth of lab 8 wanders, but its integrator cancels in the error of the simplified filter."""
    truth, (design, _) = coloured(0.0, 0.3, 0.5, 2.0, 5.0)
    limit = sensitivity.steady(truth, design, [[1, 0]])
    assert close(sensitivity.actual(truth, design, 400, compare=[[1, 0]]).P_plus[-1], limit.P_plus, SOLVER)


def test_an_unknown_constant_bias_of_a_sensor_has_a_limit() -> None:
    """A random constant in the measurement that the design ignores adds its variance and mean to the error, in full."""
    truth = DiscreteModel(
        [[0.9, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.8]], np.diag([1.0, 0.0, 0.2]), [[1.0, 1.0, 1.0]], [[0.5]],
        x0=[0.0, 0.4, 0.0], P0=np.diag([2.0, 3.0, 1.0]),
    )  # fmt: skip
    design = scalar(Phi=0.9, R=0.5)
    C = [[1, 0, 0]]
    limit = sensitivity.steady(truth, design, C)
    late = sensitivity.actual(truth, design, 400, compare=C)
    assert close(limit.P_minus, late.P_minus[-1], SOLVER)
    assert close(limit.P_plus, late.P_plus[-1], SOLVER)
    K = limit.K[0, 0]
    assert close(limit.bias_plus, [0.4 * K / (1 - (1 - K) * 0.9)], SOLVER)
    without = sensitivity.steady(replace(truth, P0=np.diag([2.0, 0.0, 1.0])), design, C)
    assert close(limit.P_plus - without.P_plus, [[3.0 * (K / (1 - (1 - K) * 0.9)) ** 2]], SOLVER)


@pytest.mark.parametrize(
    ("block", "Qd", "offset"),
    [
        ([[1.0]], [[0.1]], None),
        ([[1.0]], [[0.0]], [0.0, 0.2]),
        ([[1.0, 1.0], [0.0, 1.0]], np.zeros((2, 2)), None),
        ([[-1.0]], [[0.0]], None),
        ([[1.1]], [[0.0]], None),
    ],
    ids=["random walk", "constant input", "ramp", "alternating", "growing"],
)
def test_a_wandering_truth_that_reaches_the_error_is_refused_by_name(block: Any, Qd: Any, offset: Any) -> None:
    """A disturbance that the design ignores and that has no limit leaves none to the error."""
    n = 1 + len(block)
    Phi, noise, H = np.eye(n) * 0.9, np.zeros((n, n)), np.zeros((1, n))
    Phi[1:, 1:], noise[0, 0], noise[1:, 1:], H[0, :2] = block, 1.0, Qd, 1.0
    names = ["x", "b", "c"][:n]
    truth = DiscreteModel(Phi, noise, H, [[0.5]], x0=np.zeros(n), P0=np.eye(n), offset=offset, states=names)
    with pytest.raises(ValueError, match=r"received the mode .* of the states b.* there is no limit"):
        sensitivity.steady(truth, scalar(Phi=0.9, R=0.5), np.eye(1, n))


def test_an_element_the_truth_lacks_is_left_out_of_the_steady_gain() -> None:
    """An absent sensor is absent for the filter, also where the design's N names it."""
    design = DiscreteModel([[0.9]], [[1.0]], [[1.0], [1.0]], np.diag([1.0, 2.0]), x0=[0], P0=[[1]], N=[[0.2, 0.3]])
    truth = replace(design, R=np.diag([1.0, np.inf]), N=[[0.2, 0.0]])
    limit = sensitivity.steady(truth, design)
    assert limit.K[0, 1] == 0
    assert close(limit.P_plus, steady.solve(truth).P_plus, SOLVER)


def test_bad_input_is_refused_with_what_was_expected() -> None:
    """Orders, measurements, periods, horizons and shapes that do not fit are named."""
    one = scalar()
    two = DiscreteModel(np.eye(2), np.eye(2), [[1, 0]], [[1]], x0=[0, 0], P0=np.eye(2))
    both = DiscreteModel([[1]], [[1]], [[1], [1]], np.eye(2), x0=[0], P0=[[1]])
    varying = replace(one, Phi=np.ones((4, 1, 1)))
    with pytest.raises(ValueError, match=r"compare: expected a matrix of shape \(1, 2\) .*, received None"):
        sensitivity.actual(two, one, 3)
    with pytest.raises(ValueError, match=r"compare: expected shape \(1, 2\), received \(2, 2\)"):
        sensitivity.actual(two, one, 3, compare=np.eye(2))
    with pytest.raises(ValueError, match=r"design: expected the truth's m = 1 and dt = 1\.0 s, received m = 2"):
        sensitivity.actual(one, both, 3)
    with pytest.raises(ValueError, match=r"received m = 1 and dt = 0\.5 s"):
        sensitivity.actual(one, replace(one, dt=0.5), 3)
    with pytest.raises(ValueError, match=r"steps: expected at most 4 \(the truth is given for so many\), received 5"):
        sensitivity.actual(varying, one, 5)
    with pytest.raises(ValueError, match="design: expected constant matrices"):
        sensitivity.steady(one, varying)
    with pytest.raises(ValueError, match=r"gains: expected gains of shape \(4, 1, 1\), received \(6, 1, 1\)"):
        sensitivity.actual(one, one, 3, gains=covariances(one, 5))
    with pytest.raises(TypeError, match="truth: expected a DiscreteModel, received a str"):
        sensitivity.actual("x", one, 3)  # type: ignore[arg-type]
