r"""Lab 19. An identically zero input: the free motion of a first-order system in white noise.

Source: Semushin & Tsyganova 2001, task 19. For x(s)/w(s) = (s + α)/(s + β) with w ≡ 0, E x(0) = 0, E x²(0) = 1 and
z = x + v, v white of strength 1, the sheet asks for the continuous filter with its variance in explicit form (and for a
proof of the hint on M⁻¹), for the discrete filter of equivalent measurements, and whether an experiment agrees.

Expected answer: one state, ẋ = −βx; 1/P = e^(2βt) + (e^(2βt) − 1)/(2β), that is 1/(1 + t) for β = 0, with the limit 0
for β ≥ 0 and 2|β| for β < 0; discrete 1/P⁺ₖ = gᵏ + dt(gᵏ − 1)/(g − 1), g = e^(2β dt), which tends to P(t) like dt, from
above for β > 0 and from below for β < 0.
"""

import math

import numpy as np
from ctlabs.tasks._task19_words import answers, conclusions, discussion, result
from ctlabs.tasks.answers import task19 as by_hand
from ctlabs.tasks.answers.task19 import TIMES, WITHIN

from ctlabs.filtering import bucy, steady
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import TOGETHER, portrait, rms
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import ContinuousModel
from ctlabs.models.discretisation import discretise
from ctlabs.reporting import plots
from ctlabs.reporting.draws import one_of, span
from ctlabs.reporting.params import LabParameters, Positive, Real, given
from ctlabs.reporting.report import EXACT, SOLVER, Report
from ctlabs.text import text

META = {
    "name": "task19",
    "title": "Identically zero input: the free motion of a first-order system in white noise",
    "source": "Semushin & Tsyganova 2001, task 19",
    "parts": ["a", "b", "c"],
}

#: More measurements than this before 1 s are not run one by one.
LONGEST = 5000
#: The largest |β|t simulated: x then changes by e^15, and the rounding of a growing x stays far below its error.
GROWTH = 15.0
TIME = "t, s"
#: P⁺ at the last measurement not later than 1 s.
AT_1S = r"P^+(1\,\text{s})"


class Parameters(LabParameters):
    """What may be changed."""

    alpha: Real = given(2.0, unit="1/s", meaning="minus the zero of the transfer function", draw=span(0.5, 4, 0.5))
    beta: Real = given(1.0, unit="1/s", meaning="minus its pole", draw=one_of(*(k / 20 for k in (*range(-30, -5), *range(6, 41)))))
    dt: Positive = given(0.1, unit="s", meaning="period of the discrete measurements", draw=one_of(0.05, 0.1, 0.2, 0.25))


def model(p, beta=None):
    """ẋ = −βx (w ≡ 0), z = x + v."""
    return ContinuousModel(F=[[-p.beta if beta is None else -beta]], G=[[1]], Q=[[0]], H=[[1]], Rc=[[1]], x0=[0],
                           P0=[[1]], states=["x"], measurements=["z"], units=["m"])


def part_a(r, p, answer, system):
    """How many states, the hint, P(t)."""
    r.section("a", "The continuous filter")
    r.says("**One state is enough.** The differential equation of the transfer function is $\\dot{x} + \\beta x = \\dot{w} + \\alpha w$. In state space it is")
    r.math(r"\dot q = -\beta q + (\alpha - \beta)\,w, \qquad x = q + w", "realisation")
    r.says("With $w \\equiv 0$ what is left is $x = q$, $\\dot{x} = -\\beta x$, and $x(t) = e^{-\\beta t}x(0)$. The zero α says only how w enters {eq:realisation}, so it plays no part; x(0) differs from 0 because of what happened before t = 0.")
    r.says("Even where α = β the state must not be cancelled. The transfer function is then 1 and says $x = w \\equiv 0$, but a transfer function describes a system that is at rest at t = 0. The mode $e^{-\\beta t}$, which w does not reach then, is still there and still starts from x(0).")
    r.model(system)
    r.value("states_required", system.n, symbol="n", agrees=answer, routes=("dimension of the model", "degree of s + β"), kind=EXACT)
    moved = [discretise(system, t).Phi[0, 0] for t in TIMES]
    r.check("free motion x(t)/x(0), whatever α", moved, answer["free_response"], ("transition e^(F t)", "Laplace transform with α kept"))
    r.says("**The hint.** Let $\\dot{M} = AM + MA^T - MBM$ with a regular M. Differentiating $MM^{-1} = I$ gives $\\dot{M}M^{-1} + M\\,\\mathrm{d}(M^{-1})/\\mathrm{d}t = 0$, hence")
    r.math(r"\frac{\mathrm{d}}{\mathrm{d}t}M^{-1} = -M^{-1}\dot M M^{-1} = -M^{-1}A - A^TM^{-1} + B. \qquad\blacksquare", "hint")
    r.says("Computer algebra confirms {eq:hint} where the inverse of a 1 × 1 and of a 2 × 2 matrix of symbols is written out and each element differentiated; with the sign of B reversed all four elements of the 2 × 2 matrix disagree, so the test would have found the slip that is most easily made.")
    r.says("For covariances this is the equation of information: without process noise the Riccati equation has no term free of P, and the inverse of P obeys a linear equation, in which each measurement adds and nothing is subtracted ({ref:kalman_bucy}; {ref:jazwinski, chapter 7}).")
    r.check("elements in which the hint fails, 1 × 1 and 2 × 2", answer["hint"][:2], [0, 0], ("derivative of M⁻¹, element by element", "the hint's equation"), EXACT)
    r.says("**The filter.** The Kalman–Bucy filter {ref:maybeck, section 5.11} of this system, whose process noise is zero, is")
    r.math(r"\dot{\hat x} = -\beta\hat x + P(t)\,(z - \hat x), \quad \hat x(0) = 0; \qquad \dot P = -2\beta P - P^2, \quad P(0) = 1", "filter")
    r.says("Its gain is P itself, since the measurement noise has the strength 1. By {eq:hint} with M = P, A = −β, B = 1")
    r.math(r"\frac{\mathrm{d}}{\mathrm{d}t}\frac1P = \frac{2\beta}{P} + 1, \qquad \frac{1}{P(t)} = e^{2\beta t} + t\,m(2\beta t), \qquad m(x) = \frac{e^x - 1}{x}, \quad m(0) = 1", "variance")
    r.says("For β ≠ 0 this is $P = 2\\beta/[(2\\beta + 1)e^{2\\beta t} - 1]$, and $1/(1 + t)$ for β = 0; written with m both are one formula with two positive terms, and no digit is lost as β passes through 0. The filter can be written out too: it is least squares for x(0), carried on to t,")
    r.math(r"\hat x(t) = e^{-\beta t}\,\frac{\int_0^t e^{-\beta\tau}z(\tau)\,\mathrm{d}\tau}{1 + \int_0^t e^{-2\beta\tau}\,\mathrm{d}\tau}.", "written")
    r.says("The 1 in the denominator is the information that was there before the first measurement, the integral is what the measurements have added.")
    found = bucy.transient(system, TIMES)
    r.value("variance_continuous", found.P[:, 0, 0], "m²", at=TIMES, symbol="P(0.25), P(0.5), P(1), P(2)", agrees=answer, routes=("Riccati equation, integrated", "closed form"))
    limit, routes = bucy.steady(system), ("algebraic Riccati equation", "closed form")
    r.says("**The limit.** If β ≥ 0, the right side of {eq:variance} grows without bound (like $e^{2\\beta t}$, or like t for β = 0) and P → 0. If β < 0 its first term dies out and the second tends to $1/(2|\\beta|)$: P → 2|β|, since an x that grows carries its error with it. The pole of the filter tends to $-\\beta - P_\\infty = -|\\beta|$: a stable mode stays where it is, an unstable one is reflected in the imaginary axis.")
    r.value("variance_limit", limit.P[0, 0], "m²", symbol=r"P_\infty", agrees=answer, routes=routes)
    r.value("filter_pole", limit.poles[0].real + 0.0, "1/s", symbol=r"-\beta - P_\infty", agrees=answer, routes=routes)
    settled = bucy.settling_time(system, WITHIN)
    r.value("settling_time", settled, "s", symbol=r"t_{1\%}", agrees=answer, routes=("search along P(t)", "closed form"),
            reason="" if settled is not None else "the limit is 0, and a variance that decays to 0 never stays within 1 % of it")
    size = abs(p.beta) or 1.0
    betas = sorted({p.beta, 0.0, size, -size}, reverse=True)
    t = np.geomspace(0.01, 100, 161)
    straight = {"$1/t$": (t[100:], 1 / t[100:])} | {f"limit $2|\\beta|$ = {-2 * b:g} m²": (t[[0, -1]], [-2 * b] * 2) for b in betas if b < 0}
    figure = plots.lines(t, {f"β = {b:g} 1/s": bucy.transient(model(p, b), t).P[:, 0, 0] for b in betas}, xlabel=TIME, ylabel="variance P, m²", log="xy", straight=straight, ylim=(1e-5, 2 * max(1.0, 2 * size)))
    r.figure("variance", figure, "P(t) of {eq:variance}. For β > 0 it falls exponentially, for β = 0 like 1/t, and for β < 0 it has a floor at 2|β|.")
    r.says("{fig:variance} shows the three kinds on logarithmic axes: a curve that bends down ever faster (β > 0, exponential), one that follows the dashed line 1/t (β = 0), and one that comes to rest on its limit (β < 0). They part only when t is about $1/(2|\\beta|) = {part:3}$ s: before that the mode has hardly moved, and all three filters average the same constant.", part=1 / (2 * size))


def part_b(r, p, answer, sampled):
    """The discrete filter."""
    r.section("b", "The discrete filter of equivalent measurements")
    r.says("The average of v over a period has the variance 1/Δt, so a measurement with this noise is worth the continuous one over a period {ref:maybeck, section 5.11}. The signal is carried exactly:")
    r.math(r"x(t_{i+1}) = e^{-\beta\,\Delta t}x(t_i), \qquad z(t_i) = x(t_i) + v_d(t_i), \qquad Q_d = 0, \quad R_d = 1/\Delta t", "sampled")
    r.model(sampled)
    r.check("Φ", sampled.Phi, [[math.exp(-p.beta * p.dt)]], ("matrix exponential", "by hand"), EXACT)
    r.check("R_d", sampled.R, [[1 / p.dt]], ("model", "by hand"), EXACT)
    r.says("The filter of {eq:sampled} is, with $g = e^{2\\beta\\,\\Delta t}$,")
    r.math(r"\hat x(t_i^-) = e^{-\beta\,\Delta t}\hat x(t_{i-1}^+), \quad P(t_i^-) = \frac{P(t_{i-1}^+)}{g}; \qquad K(t_i) = \frac{P(t_i^-)}{P(t_i^-) + 1/\Delta t} = P(t_i^+)\,\Delta t", "discrete")
    r.math(r"\hat x(t_i^+) = \hat x(t_i^-) + K(t_i)\,[z(t_i) - \hat x(t_i^-)], \qquad P(t_i^+) = [1 - K(t_i)]\,P(t_i^-), \qquad \hat x(t_0^+) = 0, \quad P(t_0^+) = 1")
    r.says("**The variance in closed form.** Information is added at each measurement, $1/P(t_i^+) = g/P(t_{i-1}^+) + \\Delta t$, from $1/P(t_0^+) = 1$. Hence")
    r.math(r"\frac{1}{P(t_k^+)} = g^k + \Delta t\,(1 + g + \dots + g^{k-1}) = g^k + \Delta t\,\frac{g^k - 1}{g - 1}", "closed")
    r.says("For β = 0 the sum is k and $1/P = 1 + k\\,\\Delta t$. For β < 0 the right side tends to $\\Delta t/(1 - g)$, so that $P^+ \\to (1 - g)/\\Delta t$, which is below 2|β|.")
    limit = steady.solve(sampled)
    r.value("posterior_variance_limit", limit.P_plus[0, 0], "m²", symbol=r"P^+_\infty", agrees=answer, routes=("Riccati equation", "closed form"))
    k = by_hand.last(p.dt)
    if k > LONGEST:
        r.says("Up to 1 s there are {k} measurements. The recursion is not run so far; a power of the matrix of its step takes its place.", k=k)
        at_1s = answer["posterior_variance_at_1s"]
        r.value("posterior_variance_at_1s", at_1s, "m²", symbol=AT_1S)
        r.check("P⁺ at 1 s", at_1s, by_hand.sampled_power(p.beta, p.dt, k), ("closed form", "power of the step's matrix"))
    else:
        r.says("The last measurement up to 1 s is number {k}, at {t} s." if k else "Up to 1 s there is no measurement: the variance is still P(0) = 1 m².", k=k, t=k * p.dt)
        shown = covariances(sampled, max(k, 1))
        r.value("posterior_variance_at_1s", shown.P_plus[k, 0, 0], "m²", symbol=AT_1S, agrees=answer)


def span(p):
    """The time in which P shows its course, s: four time constants, or ten seconds where 1/(1 + t) decides."""
    return 4 / max(abs(p.beta), 0.4)


def plan(r, p, experiment):
    """Every number chosen; returns the number of measurements, 0 if x grows too much to be simulated."""
    steps = min(max(math.ceil(span(p) / p.dt * (1 - 1e-12)), 5), 400)
    if abs(p.beta) * p.dt * steps > GROWTH:
        steps = int(GROWTH / (abs(p.beta) * p.dt))
        steps = steps if p.beta < 0 else max(steps, 1)
    r.says("{tab:plan} lists what was chosen. Two experiments are made: the variances of the discrete filter, which need no random numbers, are compared with P(t) as the period shrinks, and the filter runs on simulated records.")
    r.table("plan", ["quantity", "value", "why"], [
        ["period Δt, s", p.dt, "given"],
        ["measurements", steps, "four time constants 1/|β|, ten seconds at most; 5 to 400, and no more than x changes by a factor of e^15"],
        ["periods of the limit Δt → 0", "T/8, T/16, T/32, T/64", "T = 1 s, or 1/|β| if that is shorter"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent:2} %", percent=100 * math.sqrt(2 / experiment.runs))],
        ["seed", experiment.seed, "any: the tests hold for all"],
    ], "Plan of the experiment.")
    return {"steps": steps}


def part_c(r, p, answer, system, sampled, steps):
    """Discrete against continuous."""
    r.section("c", "Does the discrete filter agree with the analysis?")
    count = max(steps, 1)
    shown = covariances(sampled, count)
    plus = [by_hand.sampled_variance(p.beta, p.dt, k) for k in range(count + 1)]
    r.check("P⁺ along the measurements", shown.P_plus[:, 0, 0], plus, ("recursion", "closed form"))
    r.check("P⁻ along the measurements", shown.P_minus[1:, 0, 0], [P * math.exp(-2 * p.beta * p.dt) for P in plus[:-1]], ("recursion", "closed form"))
    r.check("gain along the measurements", shown.K[1:, 0, 0], [P * p.dt for P in plus[1:]], ("recursion", "closed form"))
    r.says("**The sign of the error.** What a filter knows about x(0) is a sum over the past in both cases: the integral $\\int_0^t e^{-2\\beta\\tau}\\mathrm{d}\\tau$ of {eq:written}, and the rectangles $\\Delta t\\sum_{j=1}^k e^{-2\\beta j\\,\\Delta t}$ with their height taken at the right end. If β > 0 the integrand falls, the rectangles lie under it, the discrete filter knows less, and $P^+ > P(t)$. If β < 0 it rises and $P^+ < P(t)$. If β = 0 both are t, and the variances are equal for every period. Expanded in Δt at a fixed t, {eq:closed} gives")
    r.math(r"P(t_k^+) - P(t_k) = P^2(t)\,\frac{e^{2\beta t} - 1}{2}\,\Delta t + O(\Delta t^2)", "difference")
    between = bucy.transient(system, shown.t).P[:, 0, 0]
    sign = 1 if p.beta >= 0 else -1
    # The exact variances differ relatively by β dt at least, far above the rounding of both routes, unless β dt is nothing.
    r.holds("P⁺ − P(t) has the sign of β", sign * (shown.P_plus[:, 0, 0] - between), ("recursion", "Riccati equation, integrated"), size=max(1.0, float(between.max())))
    T, halves = min(1.0, 1 / abs(p.beta)) if p.beta else 1.0, (8, 16, 32, 64)
    target = float(bucy.transient(system, [T]).P[0, 0, 0])
    errors = [float(covariances(discretise(system, T / n), n).P_plus[-1, 0, 0]) - target for n in halves]
    leading = target**2 * math.expm1(2 * p.beta * T) / 2
    r.table("limit", ["Δt, s", "P⁺ − P(T), m²", "leading term, m²"], [(T / n, e, leading * T / n) for n, e in zip(halves, errors, strict=True)],
            "The discrete filter at T = {T} s as the period is halved: its difference from P(T), and the leading term of {eq:difference}.", T=T)
    if abs(leading) > 1e-7 * target:
        r.order("order of P⁺ − P(T)", np.abs(errors), 1.0, ("discrete filter", "continuous filter"))
        r.order("order of what the leading term leaves", np.abs([e - leading * T / n for n, e in zip(halves, errors, strict=True)]), 2.0, ("discrete filter", "closed form of the error"))
        agrees = abs(math.log2(errors[-2] / errors[-1]) - 1) < 0.2
    else:
        r.check("P⁺ = P(T), since β is 0 or as good as 0", target + np.array(errors), [target] * 4, ("recursion", "Riccati equation, integrated"), 1e-8)
        agrees = bool(np.abs(errors).max() < SOLVER * target)
    r.value("verdict_c", agrees)
    r.says("Agreement means that the difference is halved with the period, or is 0 for every period. {tab:limit} meets this: the filters agree, and the shorter the period, the more nearly is the difference its leading term." if agrees and p.beta else
           "Agreement means that the difference is halved with the period, or is 0 for every period. {tab:limit} meets this: there is no difference beyond rounding." if agrees else
           "Agreement means that the difference is halved with the period, or is 0 for every period. {tab:limit} does not meet this.")
    sawteeth(r, p, answer, system, shown, between)


def sawteeth(r, p, answer, system, shown, between):
    """The discrete filters over the continuous one, and how far they are from it."""
    count = len(shown.t) - 1
    fine = covariances(discretise(system, p.dt / 4), 4 * count)
    close = np.linspace(0.0, shown.t[min(count, 12)], 201)
    schedules = {text("Δt = {dt} s", dt=p.dt): shown, text("Δt = {dt} s", dt=p.dt / 4): fine}
    figure = plots.sampled(schedules, close, bucy.transient(system, close).P[:, 0, 0], ylabel="variance, m²", limit=answer["variance_limit"] or None)
    r.says("{fig:overlay} lays the sawtooth of the discrete filter over P(t). ", "Between measurements the variance falls by itself, as x does, and each measurement takes it down to the curve or just above." if p.beta > 0 else "Between measurements the variance rises, as x grows, and each measurement takes it below the curve." if p.beta < 0 else "Between measurements nothing changes, so the teeth are steps whose lower corners lie on the curve.", " With a shorter period the teeth are lower and nearer to the curve.")
    r.figure("overlay", figure, "Variances of the discrete filter before and after each measurement over P(t), for the given period (above) and a quarter of it (below).")
    if between.all():
        ratios = {name: 100 * (s.P_plus[:: len(s.t) // count, 0, 0] / between - 1) for name, s in schedules.items()}
        r.says("{fig:ratio} shows the same difference in per cent, at the common instants: ", "it is zero but for rounding." if p.beta == 0 else "it has the sign of β throughout, as proved, and comes to rest at a constant.", " A quarter of the period leaves about a quarter of it." if 0 < abs(p.beta) * p.dt < 0.2 else "")
        r.figure("ratio", plots.lines(shown.t, ratios, xlabel=TIME, ylabel="$P^+/P(t) - 1$, %", marker=".", straight={"no difference": (shown.t[[0, -1]], [0, 0])}), "How far the discrete filter's variance is from the continuous one's, in per cent of it.")


def ensemble(r, p, experiment, sampled, steps):
    """The filter on simulated data."""
    if not steps:
        r.says("Within one period x grows by a factor of e to the power {power:3}. Its rounding would hide the error of the estimate, so nothing is simulated; the covariances above stand.", power=-p.beta * p.dt)
        return {"measured": None, "sd": None, "when": None}
    r.says("**Simulated records.** {fig:errors} shows 25 runs, {fig:ensemble} the statistics of all {runs}.", runs=experiment.runs)
    stats = portrait(r, experiment, sampled, steps, xlabel=TIME, together_steps=TOGETHER if p.beta >= 0 else min(TOGETHER, int(GROWTH / (-p.beta * p.dt))), figures={
        "errors": "The innovations are wider than the prediction errors by the noise of a measurement; the errors " + ("shrink with x." if p.beta > 0 else "shrink as more measurements are averaged." if p.beta == 0 else "keep the width at which growth and measurements balance.")})
    theory = covariances(sampled, steps)
    r.figure("ensemble", plots.ensemble_log(stats, theory.P_plus, xlabel=TIME, units=["m"], names=["x"]),
             "RMS and mean of the filtering errors of {runs} runs against theory, NEES and NIS averaged over the runs, in the bands of 95 % of ensembles. The points follow theory over the whole range of the RMS error.", runs=experiment.runs)
    some = experiment.histories(sampled, steps=steps, runs=5, stream=1)
    estimates = [by_hand.batch(some.z[1:, 0, run], some.t[1:], p.beta, p.dt) for run in range(5)]
    r.check("last estimates of five runs", some.x_plus[-1, 0], estimates, ("recursion", "least squares of all measurements at once"), scale=float(np.abs(estimates).max()) or 1.0)
    k = min(by_hand.last(p.dt), steps) or steps
    return {"measured": rms(stats, k, unit="m"), "sd": float(theory.sd_plus[k, 0]), "when": float(theory.t[k])}


PARTS = Skeleton(
    result=result,
    key="variance",
    analysis=(part_a, part_b),
    plan=plan,
    experiment=(part_c, ensemble),
    discussion=discussion,
    answers=answers,
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    answer, system = by_hand.analytic(p), model(p)
    sampled = discretise(system, p.dt)
    return PARTS.report(META, p, experiment, answer=answer, system=system, sampled=sampled)


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
