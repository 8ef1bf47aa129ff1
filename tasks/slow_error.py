r"""Slowly varying measurement errors: the batch and the recursive Bayesian estimator, and what they can and cannot do.

Source: Shapiro & Shchelkanovtsev, "Synthesis of computing devices for information processing with slowly varying
measurement errors taken into account", Avtometriya 1968, no. 6. A signal λᵀφ[k] is measured with a slowly varying
error μᵀψ[k] and noise n[k]. The paper gives the batch estimate (11), (12) with its risk (15), the recursive filter
(16)–(32), and an example with constants λ and μ (section 5, figures 1 and 2, errors of 7 % and 15 %).

Expected answer, with D = σ_w² + k(σ_λ² + σ_μ²): P11 = σ_λ²(σ_w² + kσ_μ²)/D, P22 = σ_μ²(σ_w² + kσ_λ²)/D,
P12 = −kσ_λ²σ_μ²/D; the floor is σ_λ²σ_μ²/(σ_λ² + σ_μ²), and λ̂/μ̂ = σ_λ²/σ_μ² at every k: only the sum is ever found.
"""

import math

import numpy as np
from ctlabs.tasks._slow_error_examples import (
    AR_SLOW_MEAN,
    AR_SLOW_VARIANCE,
    DRIFT_VARIANCE,
    POLY_AT,
    POLY_NOISE,
    POLY_T,
    POLY_VARIANCE,
    alone,
    constants,
    examples,
    moving,
    moving_state,
    named,
    polynomial,
    powers,
    rounding,
    truth,
)
from ctlabs.tasks._slow_error_figures import DENSE, part_figure1, part_figure2, part_statement
from ctlabs.tasks._slow_error_words import answers, conclusions, discussion, misprints, result
from ctlabs.tasks.answers import slow_error as by_hand
from ctlabs.tasks.answers.slow_error import AR_BEYOND, AR_DT, AR_N

from ctlabs import montecarlo
from ctlabs.filtering import bayes, bias, kalman_filter, update
from ctlabs.filtering.bayes import SlowError
from ctlabs.labs.experiment import Experiment, filtered
from ctlabs.labs.skeleton import Skeleton
from ctlabs.reporting import plots
from ctlabs.reporting.draws import span
from ctlabs.reporting.params import Count, LabParameters, Positive, Real, Variance, given
from ctlabs.reporting.report import Report
from ctlabs.text import text

META = {
    "name": "slow_error",
    "title": "Slowly varying measurement errors",
    "source": "Shapiro & Shchelkanovtsev, Avtometriya 1968, no. 6",
    "parts": ["batch", "recursive", "figure1", "figure2", "statement"],
}


class Parameters(LabParameters):
    """What may be changed."""

    lam: Real = given(8.0, unit="u", meaning="signal (u is the unit of the samples)", symbol=r"\lambda", draw=span(4, 12, 1))
    mu: Real = given(5.0, unit="u", meaning="slow error", draw=span(3, 9, 1))
    sigma_w2: Positive = given(1000.0, unit="u²", meaning="variance of the noise", symbol=r"\sigma_w^2", draw=span(500, 2000, 100))
    sigma_lambda2: Variance = given(100.0, unit="u²", meaning="prior variance of the signal", symbol=r"\sigma_\lambda^2", draw=span(60, 150, 10))
    sigma_mu2: Variance = given(50.0, unit="u²", meaning="prior variance of the slow error", symbol=r"\sigma_\mu^2", draw=span(30, 80, 5))
    k: Count = given(10_000, unit="1", meaning="number of measurements")


def plan(r, experiment):
    """What is chosen for the ensembles."""
    r.says("The three examples are those of {tab:plan}. Example (i) is the paper's; in {part:figure1} λ and μ are drawn from their priors anew in every run, in {part:statement} they have the given values in every run and only the noise is drawn. All ensembles have {runs} runs (a standard error of the variance of {percent:2} %), seed {seed}. Where the number of measurements is large the filter takes averages of them: for constants an average says all that its samples say.",
           runs=experiment.runs, seed=experiment.seed, percent=100 * math.sqrt(2 / experiment.runs))


def part_batch(r, p, y, poly, moved):
    """Equations (8)–(15)."""
    r.section("batch", "The batch estimate")
    r.says("In {ref:shapiro} signal, slow error and noise make up the sample,")
    r.math(r"y[k] = \lambda^T\varphi[k] + \mu^T\psi[k] + n[k], \qquad \lambda \sim N(m_\lambda, K_\lambda), \quad \mu \sim N(m_\mu, K_\mu), \quad n \sim N(0, K).", "sample")
    r.says("**The loss does not matter.** Given the samples, $s[N] = \\lambda^T\\varphi[N]$ is Gaussian, so its density is symmetric about its mean $m$ and falls away from it. For a loss $W(e)$ that is convex and even, $g(a) = E\\,W(s - a)$ is convex in $a$, and $g(m + h) = g(m - h)$ by the symmetry; hence $g(m) \\le \\frac12 g(m + h) + \\frac12 g(m - h) = g(m + h)$ for every $h$. The rule of equations (4)–(7), a decision without randomness, is therefore the conditional mean (10) for every such loss, the squared one (9) among them ({ref:sherman}). ∎ (Numbers of equations in this paragraph and in the list of misprints are those of the paper.)")
    r.says("**Correct equations.** The slow error cannot be subtracted, for it is not known either. So the joint information of λ and μ is formed and μ is eliminated from it; what the samples had to spend on μ is the last term of J. With")
    r.math(r"A = K_\mu^{-1} + \Phi_\mu^TK^{-1}\Phi_\mu, \qquad J = K_\lambda^{-1} + \Phi_\lambda^TK^{-1}\Phi_\lambda - \Phi_\lambda^TK^{-1}\Phi_\mu A^{-1}\Phi_\mu^TK^{-1}\Phi_\lambda", "information")
    r.says("estimate and risk are")
    r.math(r"\hat s[N,k] = \varphi^T[N]J^{-1}\{K_\lambda^{-1}m_\lambda + \Phi_\lambda^TK^{-1}\bar y - \Phi_\lambda^TK^{-1}\Phi_\mu A^{-1}(K_\mu^{-1}m_\mu + \Phi_\mu^TK^{-1}\bar y)\}, \qquad R[N] = \varphi^T[N]J^{-1}\varphi[N].", "batch")
    misprints(r)
    part = (powers(POLY_T)[:, :2], polynomial().psi, POLY_NOISE * np.eye(len(POLY_T)), np.diag(POLY_VARIANCE[:2]), np.diag(DRIFT_VARIANCE), np.zeros(2), np.zeros(2), poly.z[1:, 0, 0])
    phi = np.array([1.0, POLY_T[-1]])
    right, wrong = (float(phi @ by_hand.corrected(*part, last=last)[1] @ phi) for last in (None, part[1]))
    r.check("risk of λ₀ + λ₁t under the drift, last factor Φ_λ", float(bayes.batch(SlowError(*part[:2], POLY_NOISE, *part[3:5]), part[-1]).signal(phi)[1][0]), right, ("orthogonal transformations", "(15) corrected"))
    r.says("The misprint in (11) is no trifle. For a signal $\\lambda_0 + \\lambda_1t$ under the drift of (ii), two parameters each, the risk at the last sample is {right} by {eq:batch}; with the printed factor (15) would give {wrong}.", right=right, wrong=wrong)
    r.says("**Computation.** The inverses are not formed. With $(\\lambda, \\mu) = m + F\\xi$ and whitened samples the estimate is a least-squares problem, solved by orthogonal transformations; for white noise its cost is linear in the number of samples and no matrix of their size is formed.")
    three_examples(r, p, y, poly, moved)


def three_examples(r, p, y, poly, moved):
    """Estimates and risks of the three examples against the joint distribution."""
    rows, k = [], min(p.k, DENSE)
    part = constants(p, count=k)
    cases = [
        ("(i)", part, y[:k], np.ones((1, 1)), [k]),
        ("(ii)", polynomial(), poly.z[1:, 0, 0], powers(POLY_AT[[29, 59, 79]]), POLY_AT[[29, 59, 79]]),
        ("(iii)", moving(), moved.z[1:, 0, 0], np.column_stack([np.ones(3), AR_DT * np.array([30, AR_N, AR_N + AR_BEYOND])]), [30, AR_N, AR_N + AR_BEYOND]),
    ]
    for name, problem, samples, phi, when in cases:
        found = bayes.batch(problem, samples)
        s_hat, risk = found.signal(phi)
        K = problem.noise if problem.noise.ndim == 2 else problem.noise * np.eye(problem.N)
        given_ = (problem.phi, problem.psi, K, problem.K_lambda, problem.K_mu, problem.m_lambda, problem.m_mu, samples)
        mean, P = by_hand.conditioned(*given_)
        routes, size = ("orthogonal transformations", "joint distribution conditioned"), np.abs(problem.covariance).max()
        r.check(text("estimates of λ and μ, {name}", name=name), found.mean, mean, routes)
        r.check(text("their covariance, {name}", name=name), found.P, P, routes, scale=size)
        if p.sigma_lambda2 * p.sigma_mu2 or name != "(i)":
            mean, P = by_hand.corrected(*given_)
            slack = rounding(p) if name == "(i)" else 1.0  # inverses cancel
            routes = ("orthogonal transformations", "(11), (12), (15) corrected")
            r.check(text("ŝ[N, k], {name}", name=name), s_hat, phi @ mean, routes, scale=slack * float(np.abs(s_hat).max() or 1.0))
            r.check(text("risk R[N], {name}", name=name), risk, np.diag(phi @ P @ phi.T), routes, scale=slack * size)
        rows += [(name, problem.N, at, s, R, math.sqrt(R)) for at, s, R in zip(when, s_hat, risk, strict=True)]
    r.table("batch", ["example", "samples", "N (time in s for (ii), (iii))", "ŝ[N, k]", "R[N]", "√R[N]"], rows,
            "Estimates and risks at instants within the record, at its end and, the last of (ii) and (iii), beyond it; in the unit of the samples and its square.")
    r.says("{tab:batch} has estimates and risks of the three examples, each confirmed by conditioning the joint Gaussian distribution of everything.")
    batch_figures(r, poly, moved)


def batch_figures(r, poly, moved):
    """Signals of (ii) and (iii), estimated and extrapolated."""
    k = AR_DT * np.arange(1, AR_N + AR_BEYOND + 1)
    shown = (
        ("polynomial", polynomial(), poly, POLY_T, POLY_AT, powers(POLY_AT), poly.truth[0, :3, 0], "Example (ii): samples and estimate, less the true polynomial."),
        ("moving", moving(), moved, k[:AR_N], k, np.column_stack([np.ones_like(k), k]), moved.truth[0, :2, 0], "Example (iii): samples and estimated position, less the true position."),
    )
    for name, problem, record, t, at, phi, lam, caption in shown:
        y = record.z[1:, 0, 0]
        s_hat, risk = bayes.batch(problem, y).signal(phi)
        error, signal = s_hat - phi @ lam, phi[: len(y)] @ lam  # both grids begin alike
        curves = {"estimate ŝ[N, k]": error, "ŝ + √R[N]": error + np.sqrt(risk), "ŝ − √R[N]": error - np.sqrt(risk)}
        figure = plots.lines(at, curves, xlabel="time of the estimate NT, s", ylabel="difference from the true signal (units of y)", points={"samples": (t, y - signal)}, straight={"true signal": (at, 0 * at)})
        r.figure(name, figure, caption)
    r.says("In {fig:polynomial} the samples wave with the harmonic drift; the estimate goes through the waves and has only that part of the drift in it which looks like a polynomial. Beyond the last sample it is extrapolated, and its band widens. In {fig:moving} the samples lie far to one side at first, since the slow error has a mean; the estimate knows that mean and is drawn along much less. All samples contribute to every estimate, so that its error is a straight line.")


def part_recursive(r, p, answer, y, poly, moved, experiment):
    """Equations (16)–(32)."""
    r.section("recursive", "The recursive filter")
    r.says("Signal and error together are the state of one Kalman filter, $F = \\mathrm{diag}(\\Phi, \\Psi)$, $T = (H\\; G)$; the equations (30) of the paper, their misprint removed, read")
    r.math(r"M[k+1] = FP[k]F^T + U[k], \quad K^0 = MT^T(TMT^T + S)^{-1}, \quad P[k+1] = (I - K^0T)M[k+1].", "recursion")
    system = named(constants(p))
    r.says("This is the Kalman filter ({ref:kalman}; {ref:maybeck, section 5.3}) of the model with white noise; coloured noise is made a state as in (iii). In section 5 of the paper the state is constant,")
    r.model(system)
    short = min(p.k, DENSE)
    small = filtered(system, y[:short, None, None])
    whole, batch = bayes.recursion(constants(p, count=p.k), y), bayes.batch(constants(p, count=p.k), y)
    scale = np.sqrt(np.array([p.sigma_lambda2, p.sigma_mu2])) + np.sqrt(p.sigma_w2) * (p.sigma_lambda2 + p.sigma_mu2 == 0)
    differences = [
        np.abs(whole.x[-1] - batch.mean).max() / scale.max(), np.abs(whole.P[-1] - batch.P).max() / scale.max() ** 2,
        *compared(r, "(i)", small, bayes.batch(constants(p, count=short), y[:short]), np.eye(2)),
        *compared(r, "(ii)", filtered(bayes.model(polynomial()), poly.z[1:]), bayes.batch(polynomial(), poly.z[1:, 0, 0]), np.eye(5)),
        *compared(r, "(iii)", filtered(moving_state(), moved.z[1:]), bayes.batch(moving(), moved.z[1:, 0, 0]), by_hand.state_of_moving()),
    ]
    worst = max(1e-12, *differences)  # what is less is rounding, and another number on every machine
    r.value("batch_minus_recursive_max", worst)
    r.holds("batch = recursion to 10⁻⁹", 1e-9 - worst, ("batch", "recursion"), size=1.0)
    r.says("The largest difference of batch and recursion over the three examples is at most {worst:2} (estimates in units of the largest prior standard deviation, covariances of the largest prior variance): the two are one estimator. That they must be so is clear: both are the conditional mean of the same Gaussian quantities given the same samples, and all that the past samples say of the state is in its estimate and covariance, so that the recursion need not look back. In (iii) the batch has one μ a sample and noise of full covariance; the recursion has four states.", worst=worst)
    beyond = filtered(moving_state(), np.concatenate([moved.z[1:], np.full((AR_BEYOND, 1, 1), np.nan)]))
    s_hat, risk = bayes.batch(moving(), moved.z[1:, 0, 0]).signal([1.0, AR_DT * (AR_N + AR_BEYOND)])
    routes = ("recursion without measurements", "batch")
    r.check("extrapolated position, (iii)", beyond.x_plus[-1, 0], s_hat, routes, scale=float(np.abs(s_hat).max()) or 1.0)
    r.check("risk of the extrapolated position, (iii)", beyond.P_plus[-1, 0, 0], risk[0], routes)
    closed_forms(r, p, answer, y, experiment, system, short, small, whole, scale)


def closed_forms(r, p, answer, y, experiment, system, short, small, whole, scale):
    """Variances, gains and the floor of the example of constants."""
    routes, D = ("square-root recursion", "closed form"), ("P11[k]", "P22[k]", "P12[k]")
    r.says("**Closed forms.** Only the sum of the samples matters; with $D = \\sigma_w^2 + k(\\sigma_\\lambda^2 + \\sigma_\\mu^2)$ and the gains $K^*$ of λ̂ and $\\Delta^*$ of μ̂ (the paper's letters),")
    r.math(r"P_{11} = \frac{\sigma_\lambda^2(\sigma_w^2 + k\sigma_\mu^2)}{D}, \quad P_{22} = \frac{\sigma_\mu^2(\sigma_w^2 + k\sigma_\lambda^2)}{D}, \quad P_{12} = -\frac{k\sigma_\lambda^2\sigma_\mu^2}{D}, \quad K^* = \frac{\sigma_\lambda^2}{D}, \quad \Delta^* = \frac{\sigma_\mu^2}{D}.", "closed")
    for name, value, letter in (("lambda_variance", whole.P[-1, 0, 0], "P_{11}"), ("mu_variance", whole.P[-1, 1, 1], "P_{22}"), ("covariance", whole.P[-1, 0, 1], "P_{12}")):
        r.value(name, value, "u²", symbol=letter, agrees=answer, routes=routes)
    gain = alone(p)
    for i, name in enumerate(("lambda_gain", "mu_gain")):
        r.value(name, gain[i], agrees=answer, routes=("batch, last sample 1 and all others 0", "closed form"))
    r.check("gain on the last measurement", whole.K[-1], gain, ("square-root recursion", "batch, last sample 1 and all others 0"), scale=float(gain.max() or 1.0) * rounding(p))
    k = np.arange(1, short + 1)
    closed = [by_hand.analytic(p.model_copy(update={"k": int(i)})) for i in k]
    for label, name, (i, j) in zip(D, ("lambda_variance", "mu_variance", "covariance"), ((0, 0), (1, 1), (0, 1)), strict=True):
        r.check(label, small.P_plus[1:, i, j], [one[name] for one in closed], ("Kalman filter", "closed form"))
    floor = update(system.P0, [[1.0, 1.0]], [[0.0]]).P_plus[0, 0]
    r.value("variance_floor", floor, "u²", symbol=r"P_{11}\;(k \to \infty)", agrees=answer, routes=("λ + μ measured without noise", "closed form"))
    r.says("As k grows, $P_{11}$ falls to the floor {floor} u², which is what remains when λ + μ is known exactly. At k = {k} it is {now} u².", floor=floor, k=p.k, now=whole.P[-1, 0, 0])
    r.check("σ_μ²λ̂ = σ_λ²μ̂ at every k", p.sigma_mu2 * whole.x[:, 0], p.sigma_lambda2 * whole.x[:, 1], ("estimate of λ", "estimate of μ"), scale=scale.max() ** 3)
    separate(r, p, y[:short], experiment)
    numerics(r, p, whole)


def compared(r, name, filtered, batch, C):
    """Last estimates of a recursion against C(λ, μ) of a batch; returns the differences, relative to the prior."""
    kept = [0, 1, 3] if len(C) == 3 and filtered.x_plus.shape[1] == 4 else list(range(len(C)))
    x, P = filtered.x_plus[-1, kept, 0], filtered.P_plus[-1][np.ix_(kept, kept)]
    size = np.diag(filtered.P_minus[0]).max() or 1.0
    mean, cov = C @ batch.mean, C @ batch.P @ C.T
    routes = ("recursion", "batch")
    r.check(text("estimates after the last sample, {name}", name=name), x, mean, routes)
    r.check(text("covariance after the last sample, {name}", name=name), P, cov, routes, scale=size)
    return [np.abs(x - mean).max() / math.sqrt(size), np.abs(P - cov).max() / size]


def separate(r, p, y, experiment):
    """Friedland's form."""
    r.says("**Separate bias.** The augmented filter splits in two {ref:friedland}: one filter of the signal that knows of no error, and one of the error that takes the innovations of the first for measurements. For a constant error in (i), and in (iii) with a constant error of variance {v} in the place of the AR(1) sequence, both forms give the same estimates and covariances.", v=AR_SLOW_VARIANCE)
    signal = bayes.model(constants(p, count=1).ignoring())
    plane, G = moving_state(slow=False), [[1.0]]
    biased = bias.augmented(plane, G, [[AR_SLOW_VARIANCE]], [AR_SLOW_MEAN])
    some = experiment.histories(biased, steps=AR_N, runs=3, stream=4)
    for name, model, prior, mean, z in (("(i)", signal, p.sigma_mu2, 0.0, y[:, None, None]), ("(iii)", plane, AR_SLOW_VARIANCE, AR_SLOW_MEAN, some.z[1:])):
        apart = bias.separate_bias(model, G, [[prior]], z, [mean])
        both = filtered(bias.augmented(model, G, [[prior]], [mean]), z)
        routes = ("two filters", "augmented filter")
        r.check(text("estimates, {name}, by separate filters", name=name), np.concatenate([apart.x, apart.b], axis=1), both.x_plus, routes, scale=float(np.abs(both.x_plus).max() + np.abs(apart.free.x_plus).max()) or 1.0)
        r.check(text("covariance, {name}, by separate filters", name=name), apart.P, both.P_plus, routes)


def numerics(r, p, whole):
    """What rounding does to λ + μ and to (15)."""
    sw, sl, sm = p.sigma_w2, p.sigma_lambda2, p.sigma_mu2
    if not sl * sm:
        r.says("**Rounding** has nothing to destroy here: one of λ and μ is known beforehand.")
        return
    r.says("**Rounding.** λ and μ stay uncertain while their sum becomes known ever better: the variance of λ + μ is the small difference of large numbers in P. A filter of 200 averages of q samples each shows the loss for large k = 200q; the exact variance is $\\sigma_w^2(\\sigma_\\lambda^2 + \\sigma_\\mu^2)/D$. In the last column of {tab:rounding} the risk is computed by the inverses of (15).")
    rows, ones = [], np.full(DENSE, p.lam + p.mu)
    for q in (1.0, 1e3, 1e6, 1e9):
        problem, k = constants(p, noise=np.full(DENSE, sw / q)), DENSE * q
        exact, risk = sw * (sl + sm) / (sw + k * (sl + sm)), sl * (sw + k * sm) / (sw + k * (sl + sm))
        errors = [abs(kalman_filter(bayes.model(problem), ones, algorithm=form).P_plus[-1].sum() / exact - 1) for form in ("conventional", "joseph", "potter")]
        found = bayes.batch(problem, ones)
        kept = found.combination([1.0, 1.0])[1][0]
        r.check(text("variance of λ + μ after {k} samples", k=k), kept, exact, ("root of the batch", "closed form"))
        rows.append((k, *errors, abs(kept / exact - 1), abs(by_hand.by_inverses(sl, sm, k / sw) / risk - 1)))
    r.table("rounding", ["k", "(I − KT)M", "Joseph", "Potter, P formed", "batch, root kept", "risk by (15)"], rows,
            "Relative errors of the variance of λ + μ by five routes, and of the risk by inverses.")
    r.says("Every form that hands over P as a matrix of doubles loses the variance of λ + μ in proportion to k, Joseph's form included: an entry of P holds no more than 16 digits, and the sum of the four entries is what is left of them. Checks of such forms therefore allow a relative error of $10^{-14}k(\\sigma_\\lambda^2 + \\sigma_\\mu^2)/\\sigma_w^2$ where that exceeds 10⁻⁸ (here it is {allowed}). What keeps the variance is a root of P, asked for the combination itself, or a root carried through the recursion, sample by sample ({tab:rounding}).", allowed=1e-14 * p.k * (sl + sm) / sw)
    exact = sw * (sl + sm) / (sw + p.k * (sl + sm))
    r.check("variance of λ + μ after k samples", whole.P[-1].sum(), exact, ("square-root recursion", "closed form"), scale=max(exact, 1e-6 * (sl + sm)))


PARTS = Skeleton(
    result=result,
    key="figure2",
    analysis=(examples, part_batch, part_recursive),
    plan=plan,
    experiment=(part_figure1, part_figure2, part_statement),
    discussion=discussion,
    answers=answers,
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Reproduce the paper, part by part."""
    answer = by_hand.analytic(p)
    y = montecarlo.simulate(truth(p, named(constants(p))), p.k, 1, experiment.seed).z[:, 0, 0]
    poly = experiment.histories(bayes.model(polynomial()), steps=len(POLY_T), runs=1, stream=2)
    moved = experiment.histories(moving_state(), steps=AR_N, runs=1, stream=3)
    return PARTS.report(META, p, experiment, y=y, poly=poly, moved=moved, answer=answer)


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
