"""A signal under a slowly varying error: batch, recursion and conditioning agree; closed forms; other filters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from numpy.typing import NDArray

from ctlabs import montecarlo
from ctlabs.analysis import sensitivity
from ctlabs.filtering import bayes, bias, hypotheses, kalman_filter
from ctlabs.filtering.bayes import SlowError
from ctlabs.labs.experiment import covariances
from ctlabs.models import DiscreteModel
from ctlabs.montecarlo import chance
from tests.reference import EXACT, SOLVER, broken, close, log_likelihood
from tests.strategies import covariance, discrete_models, record, seeds

pytestmark = pytest.mark.numerical

Array = NDArray[Any]
SW, SL, SM = 1000.0, 100.0, 50.0


def constants(count: int, *, noise: Any = SW, sm: float = SM) -> SlowError:
    """The paper's section 5: a constant signal and a constant error."""
    one = np.ones((count, 1))
    return SlowError(one, one, noise, [[SL]], [[sm]])


@st.composite
def problems(draw: st.DrawFn, *, white: bool | None = None) -> tuple[SlowError, Array]:
    """Any regressors, priors with means, white or coloured noise, and samples (N, 3)."""
    N, M, L = draw(st.integers(1, 12)), draw(st.integers(1, 3)), draw(st.integers(0, 3))
    coloured = not (draw(st.booleans()) if white is None else white)
    rng = np.random.default_rng(draw(seeds))
    noise = covariance(rng, N) if coloured else rng.uniform(0.2, 2.0, size=N)
    problem = SlowError(
        rng.normal(size=(N, M)), rng.normal(size=(N, L)) if L else None, noise, covariance(rng, M),
        covariance(rng, L) if L else None, rng.normal(size=M), rng.normal(size=L),
    )  # fmt: skip
    return problem, rng.normal(size=(N, 3))


def conditioned(s: SlowError, y: Array) -> tuple[Array, Array]:
    """The joint distribution of parameters and samples, conditioned on the samples."""
    H = np.hstack([s.phi, s.psi])
    K = s.noise if s.noise.ndim == 2 else np.diag(np.broadcast_to(s.noise, s.N))
    gain = np.linalg.solve(H @ s.covariance @ H.T + K, H @ s.covariance).T
    mean = s.mean[:, None] + gain @ (y - (H @ s.mean)[:, None])
    return mean, s.covariance - gain @ H @ s.covariance


@settings(max_examples=40)
@given(problems())
def test_the_batch_estimate_is_the_conditional_mean(drawn: tuple[SlowError, Array]) -> None:
    """Estimates and covariance equal those of conditioning the joint Gaussian distribution, whatever the noise."""
    problem, y = drawn
    mean, P = conditioned(problem, y)
    found = bayes.batch(problem, y)
    assert close(found.mean, mean, SOLVER)
    assert close(found.P, P, SOLVER, size=np.abs(problem.covariance).max())
    assert close(found.lam, mean[: problem.M], SOLVER, size=np.abs(mean).max())
    assert not close(bayes.batch(replace(problem, m_lambda=broken(problem.m_lambda)), y).mean, mean, EXACT)


@settings(max_examples=40)
@given(problems())
def test_the_batch_estimate_is_that_of_the_corrected_equations(drawn: tuple[SlowError, Array]) -> None:
    """(11), (12), (15) with the last factor Φ_λ give the same estimate and risk, at any instant N."""
    s, y = drawn
    if not s.L:
        return
    Ki = np.linalg.inv(s.noise if s.noise.ndim == 2 else np.diag(s.noise))
    Fl, Fm, Kl, Km = s.phi, s.psi, np.linalg.inv(s.K_lambda), np.linalg.inv(s.K_mu)
    A = Km + Fm.T @ Ki @ Fm
    J = Kl + Fl.T @ Ki @ Fl - Fl.T @ Ki @ Fm @ np.linalg.inv(A) @ Fm.T @ Ki @ Fl
    right = (Kl @ s.m_lambda)[:, None] + Fl.T @ Ki @ y
    right -= Fl.T @ Ki @ Fm @ np.linalg.inv(A).T @ ((Km @ s.m_mu)[:, None] + Fm.T @ Ki @ y)
    phi = np.random.default_rng(s.N).normal(size=(2, s.M))  # instants outside the record: extrapolation
    s_hat, risk = bayes.batch(s, y).signal(phi)
    assert close(s_hat, phi @ np.linalg.solve(J, right), SOLVER)
    assert close(risk, np.diag(phi @ np.linalg.solve(J, phi.T)), SOLVER)


@settings(max_examples=30)
@given(problems(white=True))
def test_the_recursions_are_the_batch_of_the_samples_so_far(drawn: tuple[SlowError, Array]) -> None:
    """After every sample the discrete filter and Potter's recursion give the batch estimate of equally many samples."""
    s, y = drawn
    filtered = kalman_filter(bayes.model(s), bayes.record(y))
    potter = bayes.recursion(s, y[:, 0])
    assert close(potter.K, filtered.K[1:, :, 0], SOLVER)
    for k in range(1, s.N + 1):
        so_far = SlowError(s.phi[:k], s.psi[:k] if s.L else None, s.noise[:k], s.K_lambda, s.K_mu, s.m_lambda, s.m_mu)
        found = bayes.batch(so_far, y[:k])
        assert close(filtered.x_plus[k], found.mean, SOLVER)
        assert close(filtered.P_plus[k], found.P, SOLVER, size=np.abs(s.covariance).max())
        assert close(potter.x[k - 1], found.mean[:, 0], SOLVER)
        assert close(potter.P[k - 1], found.P, SOLVER, size=np.abs(s.covariance).max())
    wrong = bayes.recursion(replace(s, noise=broken(s.noise)), y[:, 0])
    assert not close(wrong.P, potter.P, EXACT)


def test_the_compiled_recursion_is_the_plain_one() -> None:
    """The compiled kernel gives the numbers of the Python function it comes from."""
    rng = np.random.default_rng(3)
    rows, r, y = rng.normal(size=(20, 2)), rng.uniform(1, 2, size=20), rng.normal(size=20)
    y[7] = np.nan
    r.setflags(write=False)  # as it comes from samples: nothing is compiled for another type
    keep = np.array([1, 8, 20])
    results = []
    for function in (bayes.potter, bayes.compiled()):
        out = np.empty((3, 2)), np.empty((3, 2, 2)), np.empty((3, 2))
        function(rows, r, y, np.zeros(2), np.eye(2), keep, *out)
        results.append(out)
    for plain, compiled in zip(*results, strict=True):
        assert close(plain, compiled, EXACT)
    assert not results[0][2][1].any()  # the eighth sample is missing: no gain


@pytest.mark.parametrize("k", [1, 10, 10_000])
def test_the_example_of_section_5_has_closed_forms(k: int) -> None:
    """P11, P22, P12 and the ratio of the estimates after k samples, by batch and recursion."""
    D = SW + k * (SL + SM)
    P = np.array([[SL * (SW + k * SM), -k * SL * SM], [-k * SL * SM, SM * (SW + k * SL)]]) / D
    y = 13 + np.random.default_rng(k).normal(size=k) * SW**0.5
    found, last = bayes.batch(constants(k), y), bayes.recursion(constants(k), y, keep=[k])
    for mean, cov in ((found.mean, found.P), (last.x[0], last.P[0])):
        assert close(cov, P, SOLVER)
        assert close(mean[0] / mean[1], SL / SM, SOLVER)
        assert close(mean, np.array([SL, SM]) * y.sum() / D, SOLVER)
    assert not close(bayes.batch(constants(k, sm=1.05 * SM), y).P, P, SOLVER)


def test_a_million_samples_keep_the_variance_of_the_sum() -> None:
    """λ+μ is known to 1e-3 where λ and μ are not: batch and recursion keep its variance, by one estimate of both."""
    k = 1_000_000
    y = 13 + np.random.default_rng(1).normal(size=k) * SW**0.5
    exact = SW * (SL + SM) / (SW + k * (SL + SM))
    found, last = bayes.batch(constants(k), y), bayes.recursion(constants(k), y, keep=[k])
    assert close(found.combination([1, 1])[1], exact, EXACT * 10)
    assert close(last.P[0].sum(), exact, SOLVER)
    assert close(found.mean, last.x[0], SOLVER)


def test_the_batch_keeps_its_digits_where_inverses_cancel() -> None:
    """At the information of 1e14 samples (15) with inverses is wrong by more than 1e-5, the batch right to 1e-12."""
    k = 1e14
    exact = SL * (SW + k * SM) / (SW + k * (SL + SM))
    risk = bayes.batch(constants(1, noise=SW / k), [13.0]).signal([1.0])[1]
    assert close(risk, exact, EXACT)
    i = k / SW
    assert not close(1 / (1 / SL + i - i * (1 / (1 / SM + i)) * i), exact, 1e-5)


@settings(max_examples=30)
@given(problems(white=True))
def test_the_gain_is_the_response_to_the_last_sample(drawn: tuple[SlowError, Array]) -> None:
    """The estimates are linear in the samples; what a unit added to the last one changes is the recursion's gain."""
    s, y = drawn
    more = np.array(y)
    more[-1] += 1
    response = (bayes.batch(s, more).mean - bayes.batch(s, y).mean)[:, 0]
    assert close(response, bayes.recursion(s, y[:, 0]).K[-1], SOLVER, size=1.0)
    assert not close(1.05 * response, bayes.recursion(s, y[:, 0]).K[-1], SOLVER)


@pytest.mark.parametrize("noise", [1e-6, 1.0, 1e6])
def test_the_response_to_one_sample_keeps_its_digits(noise: float) -> None:
    """Samples that tell of one combination only leave rounding in the other direction; it does not reach the estimate."""
    k = 10_000
    found = bayes.batch(constants(k, noise=noise), np.eye(1, k, k - 1)[0])
    assert close(found.mean, np.array([SL, SM]) / (noise + k * (SL + SM)), SOLVER)


def test_without_a_sample_the_prior_is_the_estimate() -> None:
    """A record of gaps alone tells nothing."""
    problem = SlowError([[1], [2]], [[1], [1]], 3.0, [[4]], [[5]], [6], [7])
    found = bayes.batch(problem, [np.nan, np.nan])
    assert found.mean.tolist() == [6, 7]
    assert close(found.P, np.diag([4.0, 5.0]), EXACT)


def test_missing_samples_are_left_out() -> None:
    """NaN, an infinite variance and a shorter record are the same; also with coloured noise."""
    rng = np.random.default_rng(5)
    phi, psi, K = rng.normal(size=(6, 2)), rng.normal(size=(6, 1)), covariance(rng, 6)
    y, kept = rng.normal(size=6), [0, 1, 3, 4, 5]
    gap = np.array(y)
    gap[2] = np.nan
    for noise, less in ((K, K[np.ix_(kept, kept)]), (np.full(6, 2.0), np.full(5, 2.0))):
        whole = SlowError(phi, psi, noise, np.eye(2), [[1]])
        part = SlowError(phi[kept], psi[kept], less, np.eye(2), [[1]])
        assert close(bayes.batch(whole, gap).mean, bayes.batch(part, y[kept]).mean, EXACT)
        assert close(bayes.batch(whole, gap).P, bayes.batch(part, y[kept]).P, EXACT)
    absent = SlowError(phi, psi, [2, 2, np.inf, 2, 2, 2], np.eye(2), [[1]])
    assert close(bayes.batch(absent, y).mean, bayes.recursion(absent, y).x[-1], EXACT)
    assert close(bayes.batch(absent, y).mean, kalman_filter(bayes.model(absent), bayes.record(y)).x_plus[-1], EXACT)  # fmt: skip


def test_chunks_do_not_change_the_estimate(monkeypatch: pytest.MonkeyPatch) -> None:
    """A long record is triangularised piece by piece; the pieces' size is of no account."""
    rng = np.random.default_rng(6)
    problem = SlowError(rng.normal(size=(50, 2)), rng.normal(size=(50, 1)), 1.0, np.eye(2), [[1]])
    y = rng.normal(size=(50, 2))
    whole = bayes.batch(problem, y)
    monkeypatch.setattr(bayes, "CHUNK", 7)
    assert close(bayes.batch(problem, y).mean, whole.mean, EXACT)
    assert close(bayes.batch(problem, y).P, whole.P, EXACT)


def test_a_singular_prior_is_honoured() -> None:
    """A parameter known beforehand stays; equal parameters stay equal."""
    y = np.array([3.0, 4.0])
    found = bayes.batch(SlowError([[1], [1]], [[1], [1]], 1.0, [[0]], [[5]], m_lambda=[2]), y)
    assert found.lam == pytest.approx([2.0], abs=0)
    assert found.P[0, 0] == 0
    twins = bayes.batch(SlowError([[1, 0], [0, 1]], None, 1.0, np.ones((2, 2))), y)
    assert close(twins.mean[0], twins.mean[1], EXACT)
    assert close(twins.mean[0], 7 / 3, EXACT)


def test_a_slow_error_by_parameters_is_one_by_coloured_noise() -> None:
    """An AR(1) error may be μ with one parameter a sample, or part of K: the signal's estimate is the same."""
    rng, t = np.random.default_rng(8), np.arange(12.0)
    phi, slow = np.column_stack([np.ones(12), t]), 2.0 * 0.9 ** np.abs(t[:, None] - t)
    y = rng.normal(size=12)
    explicit = bayes.batch(SlowError(phi, np.eye(12), 0.5, np.eye(2), slow), y)
    implicit = bayes.batch(SlowError(phi, None, slow + 0.5 * np.eye(12), np.eye(2)), y)
    assert close(explicit.lam, implicit.lam, SOLVER)
    assert close(explicit.signal([1, 20])[1], implicit.signal([1, 20])[1], SOLVER)


@pytest.mark.parametrize("sm", [50.0, 100.0])
def test_ignoring_the_slow_error_makes_more_data_worse(sm: float) -> None:
    """The true variance of the naive estimator is its closed form; with 2σ_μ² > σ_λ² it has a minimum at sw/(2sm−sl)."""
    steps = 40
    problem = constants(steps, sm=sm)
    naive = sensitivity.actual(bayes.model(problem), bayes.model(problem.ignoring()), steps, compare=[[1, 0]])
    k = np.arange(steps + 1)
    exact = SL * SW / (SW + k * SL) + (k * SL / (SW + k * SL)) ** 2 * sm
    assert close(naive.P_plus[:, 0, 0], exact, EXACT * 10)
    assert int(np.argmin(naive.P_plus[:, 0, 0])) == (10 if sm == 100 else steps)


# Signals that are states ---------------------------------------------------------------------------------------------


@st.composite
def disturbed(draw: st.DrawFn) -> tuple[DiscreteModel, Array, Array, Array, Array]:
    """A model without N, an error of its measurements with prior, and a record."""
    model = draw(discrete_models(correlated=False))
    rng = np.random.default_rng(draw(seeds))
    L = draw(st.integers(1, 2))
    return model, rng.normal(size=(model.m, L)), covariance(rng, L), rng.normal(size=L), record(model, 6, rng)[1:, :, None]


@settings(max_examples=40)
@given(disturbed())
def test_friedlands_two_filters_are_the_augmented_one(drawn: tuple[DiscreteModel, Array, Array, Array, Array]) -> None:
    """State, error and all covariances of the separate-bias form equal those of the filter of both."""
    model, G, P_b, m_b, z = drawn
    both = kalman_filter(bias.augmented(model, G, P_b, m_b), z)
    apart = bias.separate_bias(model, G, P_b, z, m_b)
    size = max(np.abs(both.x_plus).max(), np.abs(apart.free.x_plus).max())
    assert close(np.concatenate([apart.x, apart.b], axis=1), both.x_plus, SOLVER, size=size)
    assert close(apart.P, both.P_plus, SOLVER)
    assert not close(bias.separate_bias(model, broken(G), P_b, z, m_b).P, both.P_plus, EXACT)


def test_the_consider_filter_knows_its_own_error() -> None:
    """Its covariance is the true one, lies between the optimal and the naive filter's, and its gain on the error is 0."""
    walk = DiscreteModel([[0.9]], [[0.5]], [[1]], [[2]], x0=[0], P0=[[10]])
    whole, plan = bias.consider(walk, [[1]], [[3]], 20)
    assert not plan.K[:, 1].any()
    assert close(plan.P_plus, sensitivity.actual(whole, whole, 20, gains=plan).P_plus, EXACT * 10)
    best = covariances(whole, 20).P_plus[:, 0, 0]
    naive = sensitivity.actual(whole, walk, 20, compare=[[1, 0]]).P_plus[:, 0, 0]
    assert (plan.P_plus[2:, 0, 0] > best[2:]).all()
    assert (plan.P_plus[1:, 0, 0] < naive[1:]).all()
    stats = montecarlo.monte_carlo(whole, whole, steps=20, runs=400, seed=1, gains=plan)
    assert chance.variance(stats, plan.P_plus).passed
    assert not chance.variance(stats, 2 * plan.P_plus).passed


def test_the_consider_filter_without_an_error_is_the_filter() -> None:
    """With P_b = 0 nothing is left to consider, gaps in the measurements included."""
    R = np.array([[[1.0]], [[1.0]], [[np.inf]], [[1.0]]])
    walk = DiscreteModel([[1]], [[1]], [[1]], R, x0=[0], P0=[[10]])
    _, plan = bias.consider(walk, [[1]], [[0]], 3)
    own = covariances(walk, 3)
    assert close(plan.P_plus[:, :1, :1], own.P_plus, EXACT)
    assert close(plan.K[:, :1], own.K, EXACT)
    assert close(plan.S, own.S, EXACT)


@settings(max_examples=25)
@given(discrete_models(correlated=False), seeds)
def test_the_bank_has_the_likelihood_of_the_joint_distribution(model: DiscreteModel, seed: int) -> None:
    """The log-likelihood of each model is that of all measurements at once, and Bayes' rule gives the probabilities."""
    rng = np.random.default_rng(seed)
    z = record(model, 5, rng)
    other = replace(model, x0=model.x0 + 0.3)
    bank = hypotheses.hypotheses([model, other], z[1:], prior=[0.3, 0.7])
    exact = np.array([log_likelihood(one, z) for one in (model, other)])
    assert close(bank.log_likelihood[-1, :, 0], exact, SOLVER, size=1.0)
    odds = np.log(0.7 / 0.3) + exact[1] - exact[0]
    assert bank.probability[-1, 1, 0] == pytest.approx(1 / (1 + np.exp(-odds)), rel=1e-6, abs=1e-12)


def test_the_mixture_of_one_certain_model_is_that_model() -> None:
    """With prior 1 and 0 the mixture is the first filter; with doubt the spread of the estimates adds to P."""
    one, two = (DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[x], P0=[[1]]) for x in (0.0, 3.0))
    z = [[1.0], [2.0]]
    sure = hypotheses.hypotheses([one, two], z, prior=[1, 0])
    mean, cov = sure.mixture([[[1]], [[1]]])
    assert close(mean, sure.filters[0].x_plus, EXACT)
    assert close(cov[..., 0], sure.filters[0].P_plus, EXACT)
    unsure = hypotheses.hypotheses([one, two], z)
    p, x = unsure.probability[1, :, 0], [f.x_plus[1, 0, 0] for f in unsure.filters]
    mean, cov = unsure.mixture([[[1]], [[1]]])
    assert mean[1, 0, 0] == pytest.approx(p @ x, rel=EXACT)
    spread = p[0] * p[1] * (x[0] - x[1]) ** 2
    assert cov[1, 0, 0, 0] == pytest.approx(unsure.filters[0].P_plus[1, 0, 0] + spread, rel=EXACT)


def test_augmenting_keeps_what_varies_and_what_is_known() -> None:
    """A varying G, an offset and N of the signal come through; G of another length is refused."""
    walk = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[1], P0=[[10]], offset=[2], N=[[0.5]])
    G = np.arange(4.0).reshape(4, 1, 1)
    whole = bias.augmented(walk, G, [[4]])
    assert whole.H[3].tolist() == [[1.0, 3.0]]
    assert whole.offset is not None
    assert whole.offset.tolist() == [2.0, 0.0]
    assert whole.N is not None
    assert whole.N.tolist() == [[0.5], [0.0]]
    with pytest.raises(ValueError, match="G: expected 4 instants as H has, received 3"):
        bias.augmented(replace(walk, H=np.ones((4, 1, 1))), G[:3], [[4]])
    with pytest.raises(ValueError, match="separate_bias: expected a signal without N"):
        bias.separate_bias(walk, [[1]], [[4]], [[0.0], [1.0]])
    with pytest.raises(ValueError, match="consider: expected a signal without N"):
        bias.consider(walk, [[1]], [[4]], 2)


ONE = [[1.0], [1.0]]
REFUSED: dict[str, tuple[Callable[[], object], str]] = {
    "another length of psi": (lambda: SlowError(ONE, [[1.0]], 1, [[1]], [[1]]), "psi: expected shape"),
    "psi without a prior": (lambda: SlowError(ONE, ONE, 1, [[1]]), "K_mu: expected shape .* received None"),
    "no noise": (lambda: SlowError(ONE, ONE, 0, [[1]], [[1]]), "noise: expected variances > 0, received 0"),
    "NaN in the regressors": (lambda: SlowError([[np.nan], [1.0]], None, 1, [[1]]), "phi: expected finite"),
    "singular coloured noise": (
        lambda: bayes.batch(SlowError(ONE, None, np.ones((2, 2)), [[1]]), [1, 2]),
        "positive definite covariance, received a singular one",
    ),
    "another length of y": (lambda: bayes.batch(constants(2), [1, 2, 3]), r"y: expected shape \(2,\)"),
    "infinite samples": (lambda: bayes.batch(constants(2), [1.0, np.inf]), "received an infinite value"),
    "NaN in some runs": (lambda: bayes.batch(constants(2), [[1.0, 2.0], [np.nan, 2.0]]), "NaN in some runs only"),
    "several records": (lambda: bayes.recursion(constants(2), [[1, 2], [1, 2]]), "expected one record"),
    "coloured recursion": (lambda: bayes.recursion(SlowError(ONE, None, np.eye(2), [[1]]), [1, 2]), "white noise"),
    "coloured model": (lambda: bayes.model(SlowError(ONE, None, np.eye(2), [[1]])), "white noise"),
    "keep out of order": (lambda: bayes.recursion(constants(2), [1, 2], keep=[2, 1]), "keep: expected increasing"),
    "keep too long": (lambda: bayes.recursion(constants(2), [1, 2], keep=[3]), "from 1 to 2"),
    "one hypothesis": (lambda: hypotheses.hypotheses([bayes.model(constants(2))], bayes.record([1, 2])), "two or more"),
    "no probabilities": (
        lambda: hypotheses.hypotheses([bayes.model(constants(2))] * 2, bayes.record([1, 2]), prior=[0.5, 0.4]),
        "add up to 1",
    ),
    "different measurements": (
        lambda: hypotheses.hypotheses(
            [bayes.model(constants(2)), bayes.model(constants(2, noise=[1, np.inf]))], bayes.record([1, 2])
        ),
        "the same elements",
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSED)
def test_bad_input_is_refused(what: str) -> None:
    """One line says what was expected and what was received."""
    call, message = REFUSED[what]
    with pytest.raises(ValueError, match=message):
        call()


def test_the_prior_of_the_augmented_model_is_block_diagonal() -> None:
    """Signal and error are independent beforehand: the model's P0 and H are those of the paper's example."""
    model = bayes.model(constants(3))
    assert close(model.P0, scipy.linalg.block_diag(SL, SM), EXACT)
    assert model.H.tolist() == [[1.0, 1.0]]
    assert model.states == ("λ", "μ")
