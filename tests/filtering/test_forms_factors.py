"""The factorised forms of the filter: what is particular to each, and what all of them are there for."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ctlabs.filtering import flops, kalman_filter
from ctlabs.filtering.algorithms import array, carlson, contract, extended_array, ld, potter, srif, ud
from ctlabs.filtering.algorithms.contract import Noise
from ctlabs.filtering.engines import driver
from ctlabs.filtering.problem import pose
from ctlabs.models import DiscreteModel
from tests import reference
from tests.reference import EPS, EXACT, SOLVER, as_floats, broken, close, exact, inverse
from tests.strategies import covariance, discrete_models, record, seeds, transition

pytestmark = pytest.mark.numerical

COVARIANCE = {
    "potter": potter,
    "carlson": carlson,
    "array": array,
    "extended_array": extended_array,
    "ud": ud,
    "ld": ld,
}
FACTORS = {**COVARIANCE, "srif": srif}
PERFECT = [name for name in COVARIANCE if name != "extended_array"]


class Case:
    """A model of given size, and a measurement, with numbers from a seed."""

    def __init__(self, seed, n=4, m=2):
        rng = np.random.default_rng(seed)
        self.Phi, self.Q = transition(rng, n, False), covariance(rng, n, n - 1)
        self.H, self.R = rng.normal(size=(m, n)), covariance(rng, m)
        self.x0, self.P0 = rng.normal(size=n), covariance(rng, n)
        self.z = rng.normal(size=(m, 3))  # three runs
        self.model = DiscreteModel(self.Phi, self.Q, self.H, self.R, x0=self.x0, P0=self.P0)

    def start(self, form):
        """The form's state at t0."""
        return form.start(self.model, self.P0)

    def predicted(self, form):
        """The form's state one step later."""
        return form.predict(self.start(form), self.Phi, None, Noise(self.Q))

    def due(self, form):
        """What a hundred roundings may change in a prediction, relative to its size.

        The triangular factor of a Q of rank n−1, found without pivots, is that of a matrix off by (1 + ‖W‖)²ε, where
        W = Q₁₁⁻¹q₁₂ (Higham, *Accuracy and Stability of Numerical Algorithms*, theorem 10.14). SRIF keeps P⁻¹ and moves
        it with Φ⁻¹: an error of the size κ(Φ)ε in a root whose own condition is κ(Φ)√κ(P0) or less.
        """
        loss = (1 + np.linalg.norm(np.linalg.solve(self.Q[:-1, :-1], self.Q[:-1, -1]))) ** 2
        if form is srif:
            loss += np.linalg.cond(self.Phi) ** 2 * np.linalg.cond(self.P0) ** 0.5
        return 100 * EPS * loss

    def updated(self, form):
        """The form's state after a measurement at t0, with its evidence."""
        return form.update(self.start(form), self.z, self.H, Noise(self.R))


def lower(matrix):
    """Whether nothing at all is left above the diagonal."""
    return not np.triu(matrix, 1).any()


def unit(matrix):
    """Whether the diagonal is all ones."""
    return (matrix.diagonal() == 1).all()


# One prediction, one update -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", FACTORS.values(), ids=FACTORS)
@settings(deadline=None, max_examples=15, derandomize=True)
@given(seed=seeds)
def test_a_step_of_each_form_is_the_textbooks(form, seed):
    """Factors multiply to ΦPΦᵀ + Q and (I−KH)P, the means are Φx and x + Kν in every run; of a broken R they do not."""
    case = Case(seed)
    x, P = reference.predict(case.x0, case.P0, case.Phi, case.Q)
    state = case.predicted(form)
    assert close(state.covariance, P, case.due(form))
    assert close(state.mean[:, 0], x, case.due(form), np.abs(case.Phi).max())
    x, P, _ = reference.update(case.x0[:, None], case.P0, case.z, case.H, case.R)
    state, _ = case.updated(form)
    assert close(state.covariance, P, SOLVER)
    assert close(state.mean, x, SOLVER)
    wrong, _ = form.update(case.start(form), case.z, case.H, Noise(broken(case.R, (1, 1))))
    assert not close(wrong.covariance, P, SOLVER)


@pytest.mark.parametrize("form", FACTORS.values(), ids=FACTORS)
@settings(deadline=None, max_examples=15, derandomize=True)
@given(seed=seeds)
def test_the_evidence_is_that_of_the_innovation_before_the_update(form, seed):
    """ln N(ν; 0, S) and νᵀS⁻¹ν with a correlated R, one value for each run; S is that of P before the update."""
    case = Case(seed, n=3, m=3)
    _, told = case.updated(form)
    S, nu = case.H @ case.P0 @ case.H.T + case.R, case.z - case.H @ case.x0[:, None]
    nis = np.sum(nu * np.linalg.solve(S, nu), axis=0)
    assert close(told.nis, nis, SOLVER)
    assert close(told.log_likelihood, -0.5 * (nis + np.linalg.slogdet(2 * np.pi * S)[1]), SOLVER)
    P_plus = case.updated(form)[0].covariance
    after = np.sum(nu * np.linalg.solve(case.H @ P_plus @ case.H.T + case.R, nu), axis=0)
    assert not close(told.nis, after, SOLVER)


@pytest.mark.parametrize("form", FACTORS.values(), ids=FACTORS)
def test_a_state_is_not_changed_by_what_follows(form):
    """predict and update leave the state they are given as it is, to the bit."""
    case = Case(3)
    state = case.predicted(form)
    kept = [np.array(part) for part in state]
    form.update(state, case.z, case.H, Noise(case.R))
    form.predict(state, case.Phi, case.x0[:, None], Noise(case.Q))
    assert all(np.array_equal(part, copy) for part, copy in zip(state, kept, strict=True))


# Roots of P -----------------------------------------------------------------------------------------------------------


@settings(deadline=None, max_examples=20, derandomize=True)
@given(seed=seeds)
def test_carlsons_update_keeps_the_triangle_and_potters_fills_it(seed):
    """Below the diagonal of C are exact zeros at the start, after a prediction, and after updates; S is full."""
    case = Case(seed)
    for state in (case.start(carlson), case.predicted(carlson), case.updated(carlson)[0]):
        assert lower(state.root.T)
    assert lower(case.predicted(potter).root)
    assert not lower(case.updated(potter)[0].root)
    assert not lower(case.updated(potter)[0].root.T)


@settings(deadline=None, max_examples=20, derandomize=True)
@given(seed=seeds)
def test_potters_factor_is_a_root_of_the_projection(seed):
    """(I − γffᵀ)² = I − ffᵀ/s with f = Sᵀh, s = fᵀf + r, γ = 1/(s + √(sr)); another γ is no root."""
    case = Case(seed, m=1)
    S = case.start(potter).root
    f, r = S.T @ case.H[0], case.R[0, 0]
    s = f @ f + r
    left, wanted = np.linalg.solve(S, case.updated(potter)[0].root), np.eye(len(f)) - np.outer(f, f) / s
    assert close(left @ left, wanted, SOLVER)
    wrong = np.eye(len(f)) - 1.05 * np.outer(f, f) / (s + np.sqrt(s * r))
    assert not close(wrong @ wrong, wanted, SOLVER)


@settings(deadline=None, max_examples=20, derandomize=True)
@given(seed=seeds)
def test_the_array_holds_the_gain_and_the_innovations_root(seed):
    """Its rows have the products before and after: S½S½ᵀ = HPHᵀ + R, K̄S^{T/2} = PHᵀ; K̄S^{-1/2} is the gain K."""
    case, m = Case(seed), 2
    before = array.pre_array(case.start(array).root, case.H, Noise(case.R))
    after = contract.triangular(before)
    S_root, K_bar = after[:m, :m], after[m:, :m]
    assert lower(after)
    assert (after.diagonal() >= 0).all()
    assert close(after @ after.T, before @ before.T, EXACT)
    assert close(S_root @ S_root.T, case.H @ case.P0 @ case.H.T + case.R, EXACT)
    K = reference.update(case.x0, case.P0, case.z[:, 0], case.H, case.R)[2]
    assert close(np.linalg.solve(S_root.T, K_bar.T).T, K, SOLVER)
    assert np.array_equal(case.updated(array)[0].root, after[m:, m:])
    assert not close(broken(after) @ broken(after).T, before @ before.T, SOLVER)


@settings(deadline=None, max_examples=20, derandomize=True)
@given(seed=seeds)
def test_the_extended_array_is_park_and_kailaths_with_the_origin_moved(seed):
    """Their row [−zᵀR^{-T/2}, x̂ᵀP^{-T/2}] of whole states ends in the same ē and in P₊½ times it = x̂⁺."""
    case, m = Case(seed), 2
    root, R_root = np.linalg.cholesky(case.P0), np.linalg.cholesky(case.R)
    x = np.repeat(case.x0[:, None], 3, axis=1)
    row = np.hstack([-np.linalg.solve(R_root, case.z).T, np.linalg.solve(root, x).T])
    before = np.vstack([np.block([[R_root, case.H @ root], [np.zeros(case.H.T.shape), root]]), row])
    after = contract.triangularised(before, m + len(root))
    state, told = case.updated(extended_array)
    assert close(after @ after.T, before @ before.T, EXACT)
    assert close(state.root, after[m:-3, m:], SOLVER)
    assert close(state.x, after[m:-3, m:] @ after[-3:, m:].T, SOLVER)
    assert close(told.nis, (after[-3:, :m] ** 2).sum(axis=1), SOLVER)
    assert not close(state.x, after[m:-3, m:] @ broken(after[-3:, m:]).T, SOLVER)


# Factors without square roots -----------------------------------------------------------------------------------------


@settings(deadline=None, max_examples=30, derandomize=True)
@given(p=st.integers(1, 5), extra=st.integers(0, 3), rank=st.integers(1, 5), seed=seeds)
def test_weighted_gram_schmidt_factors_dependent_rows_too(p, extra, rank, seed):
    """A·diag(w)·Aᵀ = L·diag(d)·Lᵀ, L unit lower triangular, d ≥ 0 with as many zeros as rows depend on others."""
    rng, rank = np.random.default_rng(seed), min(rank, p)
    rows = rng.normal(size=(p, rank)) @ rng.normal(size=(rank, p + extra))
    weights = rng.uniform(0.1, 3, p + extra)
    L, d = ld.gram_schmidt(rows, weights)
    wanted = rows * weights @ rows.T
    assert lower(L)
    assert unit(L)
    assert (d >= 0).all()
    assert np.count_nonzero(d) == rank
    assert close(L * d @ L.T, wanted, EXACT)
    assert not close(L * broken(d) @ L.T, wanted, SOLVER)


def test_the_factors_are_right_where_gram_schmidts_rows_are_not_orthogonal():
    """A row that depends on others up to 10⁻¹³: the factors' product keeps all digits, and one weight is 10⁻²⁶."""
    rng = np.random.default_rng(4)
    base = rng.normal(size=(2, 6))
    rows = np.vstack([base, [[0.3, 0.7]] @ base + 1e-13 * rng.normal(size=6), rng.normal(size=(2, 6))])
    weights = rng.uniform(0.1, 3, 6)
    L, d = ld.gram_schmidt(rows, weights)
    wanted = rows * weights @ rows.T
    assert close(L * d @ L.T, wanted, EXACT)
    assert 1e-28 < d[2] < 1e-24
    V = np.linalg.solve(L, rows)  # the rows that classical orthogonality would need
    products = V * weights @ V.T / np.sqrt(np.outer(d, d))
    assert np.abs(products - np.eye(5)).max() > 1e-6


@settings(deadline=None, max_examples=20, derandomize=True)
@given(seed=seeds)
def test_ld_is_ud_with_the_states_in_reverse_order(seed):
    """U of P is L of JPJ seen from the other end, J reversing: at the start, after a prediction, and after an update."""
    case = Case(seed)
    back = Case(seed)
    back.Phi, back.Q, back.P0 = (M[::-1, ::-1].copy() for M in (case.Phi, case.Q, case.P0))
    back.H, back.x0 = case.H[:, ::-1].copy(), case.x0[::-1].copy()
    back.model = DiscreteModel(back.Phi, back.Q, back.H, back.R, x0=back.x0, P0=back.P0)
    for own, other in (
        (case.start(ud), back.start(ld)),
        (case.predicted(ud), back.predicted(ld)),
        (case.updated(ud)[0], back.updated(ld)[0]),
    ):
        assert lower(own.U.T)
        assert unit(own.U)
        assert lower(other.L)
        assert unit(other.L)
        assert close(own.U[::-1, ::-1], other.L, SOLVER)
        assert close(own.d[::-1], other.d, SOLVER)
        assert close(own.x[::-1], other.x, SOLVER)


@pytest.mark.parametrize("form", [ud, ld], ids=["ud", "ld"])
@settings(deadline=None, max_examples=20, derandomize=True)
@given(seed=seeds)
def test_a_measurement_multiplies_the_determinant_by_r_over_s(form, seed):
    """Π d⁺ = Π d⁻ · det R/det S: unit triangles have the determinant 1, so the weights carry all of it."""
    case = Case(seed)
    before, after = case.start(form).d, case.updated(form)[0].d
    ratio = np.linalg.det(case.R) / np.linalg.det(case.H @ case.P0 @ case.H.T + case.R)
    assert close(after.prod(), before.prod() * ratio, SOLVER)
    assert not close(broken(after).prod(), before.prod() * ratio, SOLVER)


def test_ud_and_ld_take_no_square_root(monkeypatch):
    """Powers are refused to counting numbers, and a step of both goes on; of the array it does not."""
    case = Case(8)

    def step(form):
        to = {
            name: contract.numbers(getattr(case, name), contract.Counted) for name in ("Phi", "Q", "H", "R", "P0", "z")
        }
        state = form.predict(form.start(case.model, to["P0"]), to["Phi"], None, Noise(to["Q"]))
        form.update(state, to["z"], to["H"], Noise(to["R"]))

    def refused(self, other):
        msg = "a square root"
        raise AssertionError(msg)

    monkeypatch.setattr(contract.Counted, "__pow__", refused)
    step(ud)
    step(ld)
    with pytest.raises(AssertionError, match="a square root"):
        step(array)


# The square-root information filter -----------------------------------------------------------------------------------


@settings(deadline=None, max_examples=20, derandomize=True)
@given(seed=seeds)
def test_the_residual_of_the_data_equation_is_the_nis(seed):
    """min over x of ‖ρx − b‖² + ‖R^{-½}(z − Hx)‖² = νᵀS⁻¹ν, taken at x̂⁺; ρᵀρ is the sum of the information."""
    case = Case(seed)
    state, told = case.updated(srif)
    assert lower(state.rho.T)
    assert close(state.rho.T @ state.rho, np.linalg.inv(case.P0) + case.H.T @ np.linalg.solve(case.R, case.H), SOLVER)
    own = np.linalg.solve(np.linalg.cholesky(case.R), np.hstack([case.H, case.z]))
    root = np.linalg.inv(np.linalg.cholesky(case.P0))
    A, b = np.vstack([root, own[:, :4]]), np.vstack([np.repeat(root @ case.x0[:, None], 3, axis=1), own[:, 4:]])
    x = np.linalg.lstsq(A, b)[0]
    assert close(state.mean, x, SOLVER)
    assert close(told.nis, ((A @ x - b) ** 2).sum(axis=0), SOLVER)
    assert not close(told.nis, ((A @ broken(x) - b) ** 2).sum(axis=0), SOLVER)


@settings(deadline=None, max_examples=20, derandomize=True)
@given(seed=seeds)
def test_the_prediction_without_an_inverse_is_biermans(seed):
    """w = 0 and ρΦ⁻¹(x⁻ − Q½w − c) = b with w eliminated leave the same triangle and the same right side."""
    case = Case(seed)
    c, G = np.arange(4.0)[:, None], Noise(case.Q).thin
    s, state = G.shape[1], case.start(srif)
    M = state.rho @ np.linalg.inv(case.Phi)
    both = np.block([[np.eye(s), np.zeros((s, 5))], [-M @ G, M, state.b + M @ c]])
    left = contract.triangularised(both.T.copy(), s + 4).T
    found = srif.predict(state, case.Phi, c, Noise(case.Q))
    assert lower(found.rho.T)
    assert close(found.rho, left[s:, s:-1], SOLVER)
    assert close(found.b, left[s:, -1:], SOLVER)
    assert not close(found.b, (both[s:, -1:]), SOLVER)


def test_a_singular_transition_is_no_obstacle_where_noise_fills_its_null_space():
    """Φ of rank 1 with a noise on the other direction: ΦPΦᵀ + Q; without that noise P⁻ has no inverse."""
    case = Case(5, n=2)
    Phi, Q = np.array([[1.0, 2.0], [2.0, 4.0]]), np.array([[0.5, 0.0], [0.0, 0.0]])
    state = srif.predict(case.start(srif), Phi, None, Noise(Q))
    assert close(state.covariance, Phi @ case.P0 @ Phi.T + Q, EXACT)
    assert close(state.mean[:, 0], Phi @ case.x0, EXACT)
    with pytest.raises(ValueError, match=r"form srif: expected ΦPΦᵀ \+ Q with an inverse, received"):
        srif.predict(case.start(srif), Phi, None, Noise(0 * Q))


def test_the_srif_begins_with_no_information_and_finds_least_squares():
    """P0 = ∞: with as many equations as states the estimate is their solution, with more the least squares'."""
    rng = np.random.default_rng(12)
    H, R = rng.normal(size=(2, 3)), np.diag([0.5, 2.0])
    model = DiscreteModel(transition(rng, 3, False), np.zeros((3, 3)), H, R, x0=np.zeros(3), P0=np.eye(3))
    z = record(model, 4, rng)
    found = kalman_filter(model, z[1:], algorithm="srif", P0=np.diag([np.inf] * 3))
    assert np.isinf(np.diagonal(found.P_plus[:2], axis1=1, axis2=2)).all()
    assert np.isnan(found.x_plus[:2]).all()
    for k in (2, 3, 4):
        information, y, back = exact(np.zeros((3, 3))), exact(np.zeros(3)), exact(np.eye(3))
        for j in range(k, 0, -1):  # of x_k the measurement of step j sees HΦ^(j−k)
            seen = exact(H) @ back
            weighted = seen.T @ inverse(R)
            information, y = information + weighted @ seen, y + weighted @ exact(z[j])
            back = back @ inverse(model.Phi)
        assert close(found.x_plus[k], as_floats(inverse(information) @ y), EXACT)
        assert close(found.P_plus[k], as_floats(inverse(information)), EXACT)


def test_what_is_known_of_a_part_is_used_before_the_rest_is():
    """Three states, one unknown and not measured yet: the others filter, and the evidence is theirs alone."""
    model = DiscreteModel(
        np.diag([0.9, 0.8, 1.0]), 0.1 * np.eye(3), [[1, 1, 0]], [[0.5]], x0=[1.0, 2.0, 0.0], P0=np.diag([1.0, 2.0, 1.0])
    )
    small = DiscreteModel(
        np.diag([0.9, 0.8]), 0.1 * np.eye(2), [[1, 1]], [[0.5]], x0=[1.0, 2.0], P0=np.diag([1.0, 2.0])
    )
    z = record(model, 5, np.random.default_rng(2))
    found, wanted = kalman_filter(model, z[1:], algorithm="srif", P0=np.diag([1.0, 2.0, np.inf])), reference.recursion(small, z)
    assert close(found.x_plus[:, :2], wanted.x_plus, EXACT)
    assert close(found.P_plus[:, :2, :2], wanted.P_plus, EXACT)
    assert np.isinf(found.P_plus[:, 2, 2]).all()
    assert close(found.log_likelihood_diffuse, reference.log_likelihood(small, z), EXACT)
    assert found.log_likelihood == 0.0  # of what is measured when everything is known


# What they can and cannot do ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", PERFECT)
@settings(deadline=None, max_examples=10, derandomize=True)
@given(model=discrete_models(stable=None, correlated=False, offset=False, varying=False, max_m=2), seed=seeds)
def test_perfect_measurements_are_taken(form, model, seed):
    """R = 0 altogether: the moments of the joint distribution; what is measured has no variance left."""
    model = DiscreteModel(model.Phi, model.Qd, model.H, np.zeros((model.m, model.m)), x0=model.x0, P0=model.P0)
    z = record(model, 3, np.random.default_rng(seed))
    found = kalman_filter(model, z[1:], algorithm=form)
    size = max(1.0, np.abs(found.P_minus).max())
    for k in range(1, 4):
        assert np.abs(model.H @ found.P_plus[k] @ model.H.T).max() <= SOLVER * size * np.abs(model.H).max() ** 2
    assert close(found.P_plus[1], reference.conditioned(model, z[:2]).P_plus[1], SOLVER, size)


@pytest.mark.parametrize("form", PERFECT)
def test_what_is_known_and_measured_without_noise_changes_nothing(form):
    """R = 0 and HPHᵀ = 0, handed over all the same: S = 0 tells nothing, of one element and of a second, equal one."""
    how, P0 = FACTORS[form], np.diag([0.0, 2.0])
    model = DiscreteModel(np.eye(2), np.eye(2), [[1, 0]], [[0]], x0=[1, 2], P0=P0)
    before = how.start(model, P0)
    state, told = how.update(before, np.array([[1.0]]), np.array([[1.0, 0.0]]), Noise(np.zeros((1, 1))))
    assert close(state.covariance, P0, EXACT)
    assert np.array_equal(state.mean, [[1.0], [2.0]])
    assert told.log_likelihood == told.nis == 0
    twice = np.array([[0.0, 1.0], [0.0, 1.0]])
    state, told = how.update(before, np.array([[3.0], [3.0]]), twice, Noise(np.zeros((2, 2))))
    assert close(state.mean, [[1.0], [3.0]], EXACT)
    assert close(state.covariance, np.zeros((2, 2)), EXACT)
    assert close(told.nis, [0.5], EXACT)


REFUSED = {
    "no information": ({"P0": np.diag([np.inf, 1.0])}, "", []),
    "a perfect measurement": (
        {"R": np.zeros((1, 1))},
        "an? (regular )?R( with an inverse)?",
        ["extended_array", "srif"],
    ),
    "a singular P0": ({"P0": np.diag([1.0, 0.0])}, "a P0 with an inverse", ["srif"]),
}


@pytest.mark.parametrize("form", FACTORS)
@pytest.mark.parametrize(("parts", "expected", "refusing"), REFUSED.values(), ids=REFUSED)
def test_a_form_does_what_it_is_asked_or_refuses_in_one_line(form, parts, expected, refusing):
    """No information, a perfect measurement, a singular P0: the message names the form and what it expected."""
    chosen = {"P0": np.eye(2), "R": np.eye(1), **parts}
    finite = np.where(np.isfinite(chosen["P0"]), chosen["P0"], 0.0)
    model = DiscreteModel(np.eye(2), np.eye(2), [[1, 0]], chosen["R"], x0=[0, 0], P0=finite)
    z = np.array([[np.nan], [1.0]])
    if form in refusing:
        with pytest.raises(ValueError, match=rf"^form {form}: expected {expected}, received [^\n]+$"):
            kalman_filter(model, z[1:], algorithm=form, P0=chosen["P0"])
    else:
        assert kalman_filter(model, z[1:], algorithm=form, P0=chosen["P0"]).used[1, 0]


OPERATIONS = {
    "potter": lambda n, m, s: 10 * n**3 / 3 + 2 * s * n**2 + 6 * m * n**2,
    "carlson": lambda n, m, s: 10 * n**3 / 3 + 2 * s * n**2 + 4.5 * m * n**2,
    "array": lambda n, m, s: 10 * n**3 / 3 + 2 * s * n**2 + 4 * (m + n) ** 3 / 3 + 2 * m * n**2,
    "extended_array": lambda n, m, s: 10 * n**3 / 3 + 2 * s * n**2 + 4 * (m + n) ** 3 / 3 + 2 * m * n**2,
    "ud": lambda n, m, s: 4 * n**3 + 2 * s * n**2 + 4 * m * n**2,
    "ld": lambda n, m, s: 4 * n**3 + 2 * s * n**2 + 2 * (m + n) ** 3 + 2 * m * n**2,
    "srif": lambda n, m, s: (
        17 * n**3 / 3 + 12 * s * n**2 + 8 * s**2 * n + 4 * s**3 / 3 + 4 * n**3 / 3 + 2 * m * n**2 + m**2 * n
    ),
}


@pytest.mark.parametrize("form", FACTORS)
def test_a_step_costs_what_the_docstring_says(form):
    """Twice the dimensions cost 8a + 4b where once cost a + b, cubic and quadratic terms: the docstring gives a."""

    def counted(n):
        rng = np.random.default_rng(6)
        model = DiscreteModel(
            transition(rng, n, True),
            covariance(rng, n, n // 2),
            rng.normal(size=(n // 4, n)),
            np.eye(n // 4),
            x0=np.zeros(n),
            P0=covariance(rng, n),
        )
        return flops(model, form)

    cubic, stated = (counted(24) - 4 * counted(12)) / 4, OPERATIONS[form](12, 3, 6)
    assert abs(cubic / stated - 1) < 0.03


# What they are there for ----------------------------------------------------------------------------------------------


def bierman(delta, steps=300):
    """Two precise sensors that differ by δ, three states, nearly no noise; one record."""
    H = [[1, 1, 1], [1, 1, 1 + delta]]
    model = DiscreteModel(np.eye(3), 1e-18 * np.eye(3), H, delta**2 * np.eye(2), x0=np.zeros(3), P0=np.eye(3))
    return model, record(model, steps, np.random.default_rng(1))


def error(found, wanted):
    """The largest ‖P⁺ − P_ref‖/‖P_ref‖ of a record."""
    difference = np.linalg.norm(found.P_plus - wanted.P_plus, axis=(1, 2))
    return (difference / np.linalg.norm(wanted.P_plus, axis=(1, 2))).max()


@pytest.mark.parametrize("delta", [1e-6, 1e-7, 1e-8, 1e-9])
def test_factorised_forms_survive_biermans_example(delta):
    """300 steps of it: P is right to 10⁻⁶ down to δ = 10⁻⁹; Joseph's form has lost a tenth of it at 10⁻⁸."""
    model, z = bierman(delta)
    wanted = reference.high_precision(model, z)
    for form in FACTORS:
        assert error(driver.run(pose(model, z[1:]), form, own_start=True)[0], wanted) <= 1e-6, form
    if delta == 1e-8:
        assert error(driver.run(pose(model, z[1:]), "joseph", own_start=True)[0], wanted) >= 0.1


def test_the_extended_array_pays_for_its_row_with_the_estimate():
    """Where HPHᵀ/R = 10¹² its P is the array's, while its estimate has a thousand times the array's error."""
    model, z = bierman(1e-6, 20)
    wanted = reference.high_precision(model, z)
    own, plain = (driver.run(pose(model, z[1:]), form, own_start=True)[0] for form in ("extended_array", "array"))
    assert close(own.P_plus, plain.P_plus, SOLVER)
    far, near = (np.abs(found.x_plus[:, :, 0] - wanted.x_plus).max() for found in (own, plain))
    assert near < 1e-6
    assert 1e3 * near < far < 1e-2


@pytest.mark.parametrize("form", FACTORS)
def test_forms_in_fifty_digits_are_the_reference(form):
    """Written for any number: with mpmath's they agree with the textbook far below the rounding of doubles."""
    case = Case(9, n=3)
    how = FACTORS[form]
    with mpmath.workdps(50):
        Phi, Q, H, R, P0, z = (
            contract.numbers(M, mpmath.mpf) for M in (case.Phi, np.diag([1.0, 2, 3]), case.H, case.R, case.P0, case.z)
        )
        state = how.predict(how.start(case.model, P0), Phi, None, Noise(Q))
        state, _ = how.update(state, z, H, Noise(R))
        P = mpmath.matrix(Phi.tolist()) * mpmath.matrix(P0.tolist()) * mpmath.matrix(Phi.T.tolist())
        P = P + mpmath.matrix(Q.tolist())
        rows, found = mpmath.matrix(H.tolist()), mpmath.matrix(state.covariance.tolist())
        P = P - P * rows.T * (rows * P * rows.T + mpmath.matrix(R.tolist())) ** -1 * rows * P
        assert mpmath.norm(found - P) < 1e-30 * mpmath.norm(P)
