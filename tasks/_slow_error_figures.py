"""The lab slow_error, its experiment: the figures of the paper and its statement."""

import math

import numpy as np
from ctlabs.tasks._slow_error_examples import alone, constants, named, polynomial, rounding, truth
from ctlabs.tasks.answers import slow_error as by_hand
from numpy.polynomial import Polynomial

from ctlabs.analysis import sensitivity
from ctlabs.filtering import bayes, bias, hypotheses
from ctlabs.labs.experiment import covariances
from ctlabs.labs.portrait import agreement, mean_error, portrait, rms
from ctlabs.reporting import plots
from ctlabs.text import text

#: The paper's own numbers of section 5 (λ, μ, σ_w², σ_λ², σ_μ², k), and its two percentages.
PAPER, PRINTED = (8.0, 5.0, 1000.0, 100.0, 50.0, 10_000), (7.0, 15.0)
#: Samples of the dense comparisons, instants of the curves against k.
DENSE, INSTANTS = 200, 120
STEP = "number of measurements k"


def grid(p):
    """Numbers of measurements from 1 to k, and the variance of the average of those between one and the next.

    For constants an average says all that its samples say, so a filter of averages is the filter of all samples.
    """
    counts = np.unique(np.geomspace(1, p.k, INSTANTS).round())
    return counts, p.sigma_w2 / np.diff([0, *counts])


def part_figure1(r, p, y, experiment):
    """Figure 1: the estimates against k, and an ensemble of the beginning."""
    r.section("figure1", "Figure 1: the estimates against k")
    marks = sorted({min(p.k, n) for n in (1, 10, 100, 1000, p.k)})
    keep = np.union1d(np.geomspace(1, p.k, min(p.k, 2000)).round().astype(int), marks)
    found = bayes.recursion(constants(p, count=p.k), y, keep=keep)
    D = p.sigma_w2 + p.k * (p.sigma_lambda2 + p.sigma_mu2)
    total = [p.sigma_lambda2 * y.sum() / D, p.sigma_mu2 * y.sum() / D]
    r.check("λ̂[k], μ̂[k] at the end", found.x[-1], total, ("recursion", "sum of the samples"), scale=max(np.abs(total).max(), 1e-3))
    figure = plots.lines(keep, {"estimate of λ": found.x[:, 0], "estimate of μ": found.x[:, 1]}, xlabel=STEP, ylabel="estimates of λ and μ, u", log="x",
                         straight={"true values": ([1, p.k, np.nan, 1, p.k], [p.lam, p.lam, np.nan, p.mu, p.mu])})
    r.says("{fig:figure1} and {tab:figure1} are the paper's figure 1 on a logarithmic axis, since everything happens in the first samples. The estimates settle, but not at the true values (dashed): from the first sample on their ratio is that of the prior variances." if p.sigma_lambda2 * p.sigma_mu2 else "{fig:figure1} and {tab:figure1} are the paper's figure 1 on a logarithmic axis. What has no prior variance is not estimated, and stays where it was.")
    r.figure("figure1", figure, "Estimates of λ and μ from one record with λ = {lam} and μ = {mu} (dashed).", lam=p.lam, mu=p.mu)
    r.table("figure1", ["k", "λ̂, u", "μ̂, u", "λ̂ + μ̂, u", "σ of λ̂, u", "σ of λ̂ + μ̂, u"],
            [(keep[i], *found.x[i], found.x[i].sum(), math.sqrt(found.P[i, 0, 0]), math.sqrt(max(found.P[i].sum(), 0.0))) for i in np.searchsorted(keep, marks)],
            "The same record at some k.")
    r.says("For {fig:section5_ensemble} λ and μ are drawn from their priors anew in each of the {runs} runs. The errors of λ̂ and μ̂ stay large while their sum becomes known; an error hardly changes from one measurement to the next, so that mean, RMS and NEES drift slowly and keep to one side for long, whereas NIS, whose innovations are white, scatters.", runs=experiment.runs)
    count = min(p.k, 60)
    stats = portrait(r, experiment, named(constants(p)), count, prefix="section5_", xlabel=STEP, figures={"ensemble": "The drift of the points is one deviation, not many."})
    return {"measured": rms(stats, unit="u"), "sd": float(covariances(named(constants(p)), count).sd_plus[-1, 0]), "count": count}


def part_figure2(r, p, answer):
    """Figure 2: what ignoring μ costs."""
    r.section("figure2", "Figure 2: the slow error accounted for, and ignored")
    r.says("An estimator that ignores μ has the gain $g = k\\sigma_\\lambda^2/(\\sigma_w^2 + k\\sigma_\\lambda^2)$ on the average of the samples and believes in the variance $\\sigma_\\lambda^2\\sigma_w^2/(\\sigma_w^2 + k\\sigma_\\lambda^2)$. Its true error variance is")
    r.math(r"\tilde\sigma_\lambda^2[k] = \frac{\sigma_\lambda^2\sigma_w^2}{\sigma_w^2 + k\sigma_\lambda^2} + \Big(\frac{k\sigma_\lambda^2}{\sigma_w^2 + k\sigma_\lambda^2}\Big)^2\sigma_\mu^2 \;\to\; \sigma_\mu^2.", "naive")
    counts, noise = grid(p)
    curves, rows, sw, sl = {}, [], p.sigma_w2, p.sigma_lambda2
    for sm in sorted({p.sigma_mu2 or 50.0, (p.sigma_mu2 or 50.0) / 4, 4 * (p.sigma_mu2 or 50.0)} | {p.sigma_mu2}):
        problem = constants(p, noise=noise, sm=sm)
        best = covariances(bayes.model(problem), len(counts)).P_plus[1:, 0, 0]
        worse = sensitivity.actual(bayes.model(problem), bayes.model(problem.ignoring()), len(counts), compare=[[1.0, 0.0]]).P_plus[1:, 0, 0]
        curves[text("$\\sigma_\\mu^2$ = {v} u²: ignored", v=sm)], curves[text("$\\sigma_\\mu^2$ = {v} u²: optimal", v=sm)] = worse, best
        r.check(text("variance that ignores μ, σ_μ² = {v}", v=sm), worse, [by_hand.naive(k, sw, sl, sm) for k in counts], ("sensitivity", "closed form"))
        r.check(text("optimal variance, σ_μ² = {v}", v=sm), best, sl * (sw + counts * sm) / (sw + counts * (sl + sm)), ("Kalman filter", "closed form"))
        r.holds(text("the optimal estimator is never worse, σ_μ² = {v}", v=sm), worse - best, ("sensitivity", "Kalman filter"), size=sl or 1.0)
        rows.append((sm, sl * sm / (sl + sm) if sl + sm else 0.0, best[-1], worse[-1], worse[-1] / best[-1] if best[-1] else 1.0))
        if sm == p.sigma_mu2:
            r.value("naive_variance", worse[-1], "u²", symbol=r"\tilde\sigma_\lambda^2[k]", agrees=answer, routes=("sensitivity", "closed form"))
    figure = plots.lines(counts, curves, xlabel=STEP, ylabel="error variance of λ̂, u²", log="x", pairs=True)
    r.says("{fig:figure2} and {tab:figure2} are the paper's figure 2: the optimal variance (dashed) never rises and ends at its floor; that of the estimator which ignores μ ends at the variance of μ, above it.")
    r.figure("figure2", figure, "Error variance of λ̂ against k: full lines for the estimator that ignores μ, dashed for the optimal one, one colour for each variance of μ.")
    r.table("figure2", ["variance of μ, u²", "floor, u²", "optimal at k, u²", "ignored at k, u²", "ratio"], rows, "The ends of the curves, k = {k}.", k=p.k)
    minimum(r, p, answer)
    considered(r, p)


def minimum(r, p, answer):
    """Where more measurements begin to harm."""
    sw, sl, sm = p.sigma_w2, p.sigma_lambda2, p.sigma_mu2
    if answer["naive_minimum_k"] is None:
        reason = "λ is known beforehand and never estimated" if not sl else "the variance falls at every k, as 2σ_μ² ≤ σ_λ²"
        r.value("naive_minimum_k", None, reason=reason)
        r.says("With $\\sigma_\\lambda^2 = {sl}$ and $\\sigma_\\mu^2 = {sm}$ there is no minimum", ", as λ is known beforehand and never estimated." if not sl else ": the variance falls at every k.", " One exists where $2\\sigma_\\mu^2 > \\sigma_\\lambda^2 > 0$, at $k = \\sigma_w^2/(2\\sigma_\\mu^2 - \\sigma_\\lambda^2)$.", sl=sl, sm=sm)
        return
    top, bottom = Polynomial([sl * sw**2, sl**2 * sw, sl**2 * sm]), Polynomial([sw, sl])
    slope = top.deriv() * bottom - 2 * sl * top  # the derivative's numerator, after one factor of the denominator
    found = float(-slope.coef[0] / slope.coef[1])  # the square terms cancel
    r.value("naive_minimum_k", found, symbol=r"k_{\min}", agrees=answer, routes=("root of the derivative", "closed form"))
    at = [0.5 * found, found, 2 * found]
    variances = [float(sensitivity.actual(bayes.model(one), bayes.model(one.ignoring()), 1, compare=[[1.0, 0.0]]).P_plus[1, 0, 0]) for one in (constants(p, noise=[sw / k]) for k in at)]
    r.holds("the variance is least there", np.array([variances[0], variances[2]]) - variances[1], ("sensitivity", "closed form of k"), size=variances[1])
    r.check("the least variance", variances[1], by_hand.naive(answer["naive_minimum_k"], sw, sl, sm), ("sensitivity", "closed form"))
    r.says("As $2\\sigma_\\mu^2 > \\sigma_\\lambda^2$, the estimator that ignores μ is best at k = {k}, with a variance of {least} u². More measurements make it worse, towards {sm} u²: it averages the noise away and trusts what remains.", k=found, least=variances[1], sm=sm)


def considered(r, p):
    """The Schmidt–Kalman filter."""
    steps = min(p.k, DENSE)
    signal = bayes.model(constants(p, count=1).ignoring())
    whole, plan_ = bias.consider(signal, [[1.0]], [[p.sigma_mu2]], steps)
    actual = sensitivity.actual(whole, whole, steps, gains=plan_).P_plus
    best = covariances(whole, steps).P_plus[:, 0, 0]
    ignored = sensitivity.actual(whole, signal, steps, compare=[[1.0, 0.0]]).P_plus[:, 0, 0]
    r.says("**Considered, not estimated.** The Schmidt–Kalman filter {ref:schmidt} keeps the variance of μ and its correlation with the error of λ̂, but never estimates μ; it spends one state where the optimal filter spends two. Its gain is the best for one step at a time, which is not the best over many. {fig:consider} shows it between the two others.")
    r.check("covariance of the Schmidt–Kalman filter", plan_.P_plus, actual, ("its own", "sensitivity"))
    r.holds("it is never better than the optimal one", plan_.P_plus[:, 0, 0] - best, ("Schmidt–Kalman", "Kalman filter"), size=p.sigma_lambda2 or 1.0)
    curves = {"optimal": best, "μ considered (Schmidt–Kalman)": plan_.P_plus[:, 0, 0], "μ ignored": ignored}
    r.figure("consider", plots.lines(np.arange(steps + 1), curves, xlabel=STEP, ylabel="error variance of λ̂, u²", steps=True),
             "Three treatments of the slow error. After {k} measurements the variances are {a} (optimal), {b} (considered) and {c} u² (ignored).", k=steps, a=best[-1], b=plan_.P_plus[-1, 0, 0], c=ignored[-1])


def part_statement(r, p, answer, poly, experiment):
    """The 7 % and 15 %."""
    r.section("statement", "The statement: 7 % and 15 % at k = 10 000")
    counts, noise = grid(p)
    design = named(constants(p, noise=noise))
    actual = sensitivity.actual(truth(p, design), design, len(counts))
    r.says("The paper gives the errors of one run. For fixed λ and μ the estimates are Gaussian with")
    r.math(r"E\hat\lambda = \frac{k\sigma_\lambda^2(\lambda + \mu)}{D}, \quad \sigma(\hat\lambda) = \frac{\sigma_\lambda^2\sqrt{k\sigma_w^2}}{D}, \qquad E\hat\mu = \frac{k\sigma_\mu^2(\lambda + \mu)}{D}, \quad \sigma(\hat\mu) = \frac{\sigma_\mu^2\sqrt{k\sigma_w^2}}{D}.", "errors")
    routes, reason = ("batch", "closed form"), "a percentage of 0 does not exist"
    mean, gain = bayes.batch(constants(p, count=p.k), np.full(p.k, p.lam + p.mu)).mean, alone(p)
    for i, (name, true) in enumerate((("lambda", p.lam), ("mu", p.mu))):
        bias, sd = mean[i] - true, gain[i] * math.sqrt(p.k * p.sigma_w2)  # k samples of equal gains
        r.value(f"{name}_error_percent_expected", 100 * bias / true if true else None, "%", reason=reason, symbol=rf"E\hat\{name}/\{name} - 1", agrees=answer, routes=routes)
        r.value(f"{name}_error_percent_sd", 100 * sd / abs(true) if true else None, "%", reason=reason, symbol=rf"\sigma(\hat\{name})/|\{name}|", agrees=answer, routes=routes)
        sizes = np.array([abs(p.lam + p.mu) + abs(true), sd]) * rounding(p)
        r.check(text("mean error of {name}", name=design.states[i]), actual.bias_plus[-1, i], bias, ("sensitivity", "batch"), scale=sizes[0] or 1.0)
        r.check(text("standard deviation of the error of {name}", name=design.states[i]), math.sqrt(actual.P_plus[-1, i, i]), sd, ("sensitivity", "batch"), scale=sizes[1] or 1.0)
    stats = experiment.statistics(truth(p, design), design, steps=len(counts), stream=1)
    agreement(r, "fixed λ and μ", stats, actual.P_plus, actual.bias_plus, consistent=False)
    r.says("An ensemble of {runs} runs with the given λ = {lam} and μ = {mu} has, at k = {k}, mean errors of {a} and {b} where theory says {c:4} and {d:4} u.",
           runs=experiment.runs, lam=p.lam, mu=p.mu, k=p.k, a=mean_error(stats, unit="u"), b=mean_error(stats, state=1, unit="u"), c=actual.bias_plus[-1, 0], d=actual.bias_plus[-1, 1])
    ends = by_hand.limits(p.lam, p.mu, p.sigma_lambda2, p.sigma_mu2)
    paper, at_infinity = by_hand.percentages(*PAPER), by_hand.limits(PAPER[0], PAPER[1], PAPER[3], PAPER[4])
    rows = [
        (name, printed, paper[f"{key}_error_percent_expected"], paper[f"{key}_error_percent_sd"], (printed - abs(paper[f"{key}_error_percent_expected"])) / paper[f"{key}_error_percent_sd"], end)
        for name, key, printed, end in zip(("λ̂", "μ̂"), ("lambda", "mu"), PRINTED, at_infinity, strict=True)
    ]
    r.table("statement", ["estimate", "printed, %", "expected, %", "σ, %", "printed minus expected, σ", "limit k → ∞, %"], rows, "The paper's statement for its own numbers (λ = 8, μ = 5, k = 10 000). The paper prints sizes without signs, so sizes are compared.")
    ordinary = all(abs(row[4]) < 1.96 for row in rows)
    r.value("verdict_statement", ordinary)
    lam, mu, _sw, sl, sm, _k = PAPER
    low, high = (((1 - e / 100) * mu * sl / sm / lam - 1) * 100 for e in (PRINTED[1] + 0.5, PRINTED[1] - 0.5))
    r.says("{tab:statement} compares the printed numbers with their expectation. Both lie within 1.96 σ of it: they are an ordinary draw. They are also one draw and not two: as λ̂ = 2μ̂ for these variances, a μ̂ that is 14.5 to 15.5 % low means a λ̂ that is {low} to {high} % high, and 7 % rounded (6.5 to 7.5) overlaps with it. But they are not errors that more measurements remove. The limits are {a} % and {b} %; what k removes is the scatter about them.",
           low=round(low, 2), high=round(high, 2), a=round(at_infinity[0], 2), b=round(at_infinity[1], 2))
    if None not in ends and tuple(ends) != tuple(at_infinity):
        r.says("For the parameters of this report the limits are {a} % and {b} %.", a=round(ends[0], 2), b=round(ends[1], 2))
    doubted(r, p, counts, noise, poly, experiment)


def doubted(r, p, counts, noise, poly, experiment):
    """Is there a slow error? Two filters and the probability of each."""
    problem = constants(p, noise=noise)
    some = experiment.histories(truth(p, bayes.model(problem)), bayes.model(problem), steps=len(counts), runs=1, stream=5)
    bank = hypotheses.hypotheses([bayes.model(problem), bayes.model(problem.ignoring())], some.z[1:])
    sizes = np.diff([0, *counts])
    averages = np.cumsum(sizes * some.z[1:, 0, 0]) / counts
    exact = [by_hand.posterior_odds(a, k, p.sigma_w2, p.sigma_lambda2, p.sigma_mu2) for a, k in zip(averages, counts, strict=True)]
    r.check("probability of a slow error, (i)", bank.probability[1:, 0, 0], exact, ("innovations of two filters", "average of the samples"), scale=rounding(p))
    ending = by_hand.posterior_odds(p.lam + p.mu, 1e300, p.sigma_w2, p.sigma_lambda2, p.sigma_mu2) if p.sigma_lambda2 else (1.0 if p.sigma_mu2 and p.lam + p.mu else 0.5)
    drift, y = polynomial(), poly.z[1:, 0, 0]
    other = hypotheses.hypotheses([bayes.model(drift), bayes.model(drift.ignoring())], poly.z[1:])
    r.says("**Is there a slow error at all?** Two filters, one with μ and one without, begin with even odds, which Bayes' rule changes by their innovations {ref:magill}. In {fig:hypotheses} the probability of a slow error in (i) is followed over the measurements. The data hold one value of λ + μ, however many the samples, so that the question is never decided; a drift as in (ii), which the signal cannot imitate, is found: its probability after the last sample is {last}.", last=float(other.probability[-1, 0, 0]))
    common, noise_ = drift.phi @ drift.K_lambda @ drift.phi.T, drift.noise * np.eye(drift.N)
    densities = [by_hand.log_density(y, drift.phi @ drift.m_lambda, K) for K in (common + drift.psi @ drift.K_mu @ drift.psi.T + noise_, common + noise_)]
    r.check("log-likelihoods of the two hypotheses, (ii)", other.log_likelihood[-1, :, 0], densities, ("innovations of two filters", "joint density"))
    figure = plots.lines(counts, {"(i), constant error": bank.probability[1:, 0, 0]}, xlabel=STEP, ylabel="probability of a slow error", log="x", ylim=(0.0, 1.02), straight={"limit for k → ∞": ([1, p.k], [ending, ending])})
    r.figure("hypotheses", figure, "Probability of a slow error in (i). For this λ + μ it tends to {ending} (dashed).", ending=ending)
