r"""Lab 21. A slope in white noise: a filter with a time-varying measurement that falls asleep.

Source: Semushin & Tsyganova 2001, task 21. For z(t) = at + n(t) with E a = 0, E a² = P0 = 1 and white n of strength
R = 2 the sheet asks for the continuous filter and whether it is stable, for the discrete filter of equivalent
measurements, and whether it reaches a steady state.

Expected answer: P = 1/(1/P0 + t³/(3R)) = 6/(6 + t³), K = Pt/R, largest at t³ = 3R/(2P0); asymptotically stable and
stable from bounded input to bounded output, but neither uniformly asymptotically nor exponentially stable; discrete
1/P_k = 1/P0 + dt³k(k+1)(2k+1)/(6R); no nontrivial steady state, P → 3R/t³ and K → 3/t².
"""

import math

import numpy as np
from ctlabs.tasks._task21_words import answers, conclusions, discussion, result
from ctlabs.tasks.answers import task21 as by_hand
from ctlabs.tasks.answers.task21 import TIMES

from ctlabs.filtering import settling_step, varying
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import agreement, mean_error, rms
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import DiscreteModel
from ctlabs.reporting import plots
from ctlabs.reporting.draws import one_of, span
from ctlabs.reporting.params import LabParameters, Positive, Variance, given
from ctlabs.reporting.report import EXACT, Report
from ctlabs.text import text

META = {
    "name": "task21",
    "title": "A slope in white noise: the filter that falls asleep",
    "source": "Semushin & Tsyganova 2001, task 21",
    "parts": ["a", "b", "c"],
}

#: More measurements than this before the last of the times are not run one by one.
LONGEST = 5000
TIME = "t, s"


class Parameters(LabParameters):
    """What may be changed."""

    R: Positive = given(2.0, unit="m²·s", meaning="strength of the measurement noise n", draw=span(1, 6, 0.25))
    P0: Variance = given(1.0, unit="m²/s²", meaning="variance of the slope a", draw=span(0.5, 4, 0.25))
    dt: Positive = given(0.5, unit="s", meaning="period of the discrete measurements", draw=one_of(0.25, 0.5))


def model(p, steps, dt=None):
    """a(t_{k+1}) = a(t_k), z(t_k) = t_k a + v_k with the variance R/dt."""
    dt = dt or p.dt
    return DiscreteModel(Phi=[[1]], Qd=[[0]], H=(dt * np.arange(steps + 1.0))[:, None, None], R=[[p.R / dt]], x0=[0],
                         P0=[[p.P0]], dt=dt, states=["a"], measurements=["z"], units=["m/s"])


def scale(p):
    """The time of the largest gain, s, before which little is known of a; ten periods if a is known from the start."""
    return (1.5 * p.R / p.P0) ** (1 / 3) if p.P0 else 10 * p.dt


def continuous(p):
    """ȧ = 0, z = t·a + n."""
    return varying.VaryingModel(F=[[0]], G=[[1]], Q=[[0]], H=lambda t: [[t]], Rc=[[p.R]], P0=[[p.P0]])


def part_a(r, p, answer, system):
    """The continuous filter."""
    r.section("a", "The continuous filter and its stability")
    r.says("The parameter is a constant state that is measured with the growing factor t: $\\dot{a} = 0$, $z = H(t)a + n$ with $F = 0$, $Q = 0$, $H(t) = t$. The Kalman–Bucy filter holds for such H too ({ref:kalman_bucy}; {ref:maybeck, section 5.11}):")
    r.math(r"\dot{\hat a} = K(t)\,(z - t\,\hat a), \quad \hat a(0) = 0; \qquad K(t) = \frac{P(t)\,t}{R}; \qquad \dot P = -\frac{P^2t^2}{R}, \quad P(0) = P_0", "filter")
    r.says("**The variance.** $\\mathrm{d}(1/P)/\\mathrm{d}t = -\\dot{P}/P^2 = t^2/R$: the information grows by the square of the factor. Hence")
    r.math(r"\frac{1}{P(t)} = \frac{1}{P_0} + \frac{t^3}{3R}, \qquad P(t) = \frac{3RP_0}{3R + P_0t^3}, \qquad K(t) = \frac{3P_0t}{3R + P_0t^3}", "variance")
    r.says("**The largest gain.** $\\dot{K} = 0$ where $3R + P_0t^3 = 3P_0t^3$. At first t is small and the measurement says nothing of a; later a is known and the filter needs no more; in between the gain has its maximum,")
    r.math(r"t_* = \sqrt[3]{\frac{3R}{2P_0}}, \qquad K_{\max} = \frac{2P_0t_*}{3R}, \qquad P(t_*) = \tfrac23P_0.", "peak")
    found, routes = varying.transient(system, TIMES), ("Riccati equation, integrated", "closed form")
    r.value("variance_continuous", found.P[:, 0, 0], "m²/s²", at=TIMES, symbol="P(0.5), P(1), P(2), P(4)", agrees=answer, routes=routes)
    r.value("gain_continuous", found.K[:, 0, 0], "1/s²", at=TIMES, symbol="K(0.5), K(1), K(2), K(4)", agrees=answer, routes=routes)
    span = np.linspace(0.0, 5 * scale(p), 41)
    when, top = varying.gain_peak(system, span)
    peak = ("search along the integrated K(t)", "closed form")
    r.value("gain_maximum", top, "1/s²", symbol=r"K_{\max}", agrees=answer, routes=peak)
    r.value("gain_maximum_time", when if p.P0 else None, "s", symbol="t_*", agrees=answer, routes=peak, reason="" if p.P0 else "with P0 = 0 the gain is 0 at all times")
    curve = varying.transient(system, np.linspace(0.0, 5 * scale(p), 201))
    figure = plots.transient(curve.t, {"K(t)": curve.K[:, 0, 0]}, ylabel="gain K, 1/s²", marks={"$t_*$": answer["gain_maximum_time"]} if p.P0 else None)
    r.says("{fig:gain} shows both ends of {eq:variance}: near t = 0 there is nothing to be learnt from a measurement, whose factor t is nearly zero, and later there is nothing left to learn." if p.P0 else "{fig:gain}: the slope is known from the start, so the gain is zero at all times.")
    r.figure("gain", figure, "The gain K(t) of {eq:variance}, and the instant of its maximum." if p.P0 else "The gain K(t), which is zero.")


def stability(r, p, system):
    """Whether the filter is stable, and in which sense."""
    r.says("**Is the filter stable?** Its homogeneous part is $\\dot{y} = -K(t)\\,t\\,y = -(Pt^2/R)\\,y$. Since $\\dot{P}/P = -Pt^2/R$ too, the transition function is")
    r.math(r"\psi(t, s) = e^{-\int_s^tK(\tau)\tau\,\mathrm{d}\tau} = \frac{P(t)}{P(s)} = \frac{3R + P_0s^3}{3R + P_0t^3}, \qquad 0 \le s \le t.", "transition")
    if not p.P0:
        r.says("With $P_0 = 0$ the gain is 0 and $\\psi = 1$: an error neither grows nor dies out. The filter is stable in Lyapunov's sense, not asymptotically; it takes no measurements, and its output is 0 for every input.")
        r.check("ψ(t, 0) without gain", varying.transition(system, TIMES)[:, 0, 0], [1.0] * 4, ("integrated", "closed form"))
        for name, verdict in (("verdict_a", False), ("uniformly_asymptotically_stable", False), ("exponentially_stable", False), ("bibo_stable", True)):
            r.value(name, verdict)
        return
    r.says("What {eq:transition} says depends on what is asked:")
    r.items(["*Stable, uniformly:* $|\\psi(t, s)| \\le 1$ for all s ≤ t.",
             "*Asymptotically stable:* $\\psi(t, s) \\to 0$ as t → ∞ for every s, like $t^{-3}$.",
             "*Not uniformly asymptotically stable:* for every fixed T, $\\psi(s + T, s) \\to 1$ as s → ∞. An error that enters at s is halved after $T = \\sqrt[3]{2s^3 + 3R/P_0} - s$. This is shortest at $s^3 = 3R/(2(\\sqrt{2} - 1)P_0)$ and then grows without bound, like $(\\sqrt[3]{2} - 1)s = 0.26\\,s$: the later an error enters, the longer it stays.",
             "*Not exponentially stable:* $\\psi(t, 0)e^{\\lambda t} \\to \\infty$ for every λ > 0. For linear systems this is the previous point in other words.",
             "*Bounded input, bounded output (from z to* $\\hat{a}$*):* $\\int_0^t|\\psi(t, \\tau)K(\\tau)|\\,\\mathrm{d}\\tau = P(t)\\,t^2/(2R)$ is largest at $t^3 = 6R/P_0$, where it is $P_0t^2/(6R)$, and tends to 0: a constant error of the instrument is forgotten like 3/(2t).",
             "*But not for a disturbance of a itself:* $\\int_0^t|\\psi(t, \\tau)|\\,\\mathrm{d}\\tau = P(t)(t/P_0 + t^4/(12R))$ grows like t/4. If a drifts, though at a bounded rate, the error grows without bound. This is what the missing uniformity costs."])
    r.says("**Lyapunov's function** $V(y, t) = y^2/P(t)$ says the same. Along the solutions")
    r.math(r"\dot V = \frac{2y\dot y}{P} - \frac{y^2\dot P}{P^2} = -\frac{2t^2}{R}y^2 + \frac{t^2}{R}y^2 = -\frac{t^2}{R}\,y^2 \le 0, \qquad V \ge \frac{y^2}{P_0}.", "lyapunov")
    r.says("V is positive definite and does not grow, so y = 0 is stable: $y^2 = PV \\le P(t)V(s)$, and as P → 0, y → 0: asymptotically stable. But $V = y^2(1/P_0 + t^3/(3R))$ has no bound $c\\,y^2$ that holds for all t (it is not decrescent), so the theorem on uniform asymptotic stability does not apply, and the points above show that its claim is false here. ∎ It fails since without process noise P has no positive lower bound; the theorem on the stability of the Kalman–Bucy filter assumes such noise, as uniform controllability ({ref:kalman_bucy}; {ref:jazwinski, chapter 7}).")
    T = scale(p)
    grid = np.array([1.0, 2.0, 5.0, 20.0]) * T
    integrated = varying.transition(system, grid)[:, 0, 0]
    r.check("ψ(t, 0)", integrated, [by_hand.variance(p.R, p.P0, t) / p.P0 for t in grid], ("transition, integrated", "P(t)/P0"))
    far = np.array([400.0, 800.0]) * T
    r.order("power of t with which ψ(t, 0) decays", varying.transition(system, far)[:, 0, 0], 3.0, ("transition, integrated", "closed form"))
    halving_and_bound(r, p, system, T)


def halving_and_bound(r, p, system, T):
    """How long an error lasts, and the bound from z to the estimate."""
    rows = []
    for s in (0.0, T, 10 * T, 100 * T):
        half = by_hand.halving(p.R, p.P0, s)
        pair = varying.transition(system, [s, s + half] if s else [0.0, half])[:, 0, 0]
        r.check(text("ψ = ½ at the halving time after {s} s", s=s), pair[1] / pair[0], 0.5, ("transition, integrated", "closed form of the time"))
        rows.append((s, half, half / s if s else None))
    r.table("halving", ["enters at s, s", "is halved after, s", "as a fraction of s"], rows, "How long an error stays that enters at s: no bound holds for all s.")
    peak = (6 * p.R / p.P0) ** (1 / 3)
    r.value("input_output_bound", p.P0 * peak**2 / (6 * p.R), "1/s", symbol=r"\max\textstyle\int|\psi K|\,\mathrm{d}\tau")
    r.check("bound from z to the estimate", p.P0 * peak**2 / (6 * p.R), by_hand.response(p.R, p.P0, peak), ("closed form", "quadrature of |ψK|"))
    end = 100 * T
    r.check("error from a drift of 1 m/s², as a fraction of t", by_hand.variance(p.R, p.P0, end) * (1 / p.P0 + end**3 / (12 * p.R)), by_hand.drift(p.R, p.P0, end) / end, ("closed form", "quadrature of ψ"))
    verdicts = {"verdict_a": True, "uniformly_asymptotically_stable": False, "exponentially_stable": False, "bibo_stable": True}
    for name, verdict in verdicts.items():
        r.value(name, verdict)
    r.says("Here the bound from z to the estimate is {bound} 1/s, reached at {when} s.", bound=p.P0 * peak**2 / (6 * p.R), when=peak)
    age = np.linspace(0.0, 4 * T, 161)[1:]
    decay = {text("error at {s} s", s=s): np.array([by_hand.variance(p.R, p.P0, s + t) / by_hand.variance(p.R, p.P0, s) for t in age]) for s in (0.0, T, 3 * T, 10 * T)}
    figure = plots.lines(age, decay, xlabel="time since the error entered, s", ylabel="what is left of it, ratio ψ(s + T, s)", ordered=True, ylim=(0, 1.05))
    r.says("{fig:decay} and {tab:halving} show the missing uniformity: the curves are drawn over the age of the error, so for a uniformly asymptotically stable filter they would all lie below one curve that falls to zero. Here they rise towards 1 in the end, as the error enters later and later; where only a few per cent are left of the error that enters at t = 0, that of $10t_*$ has lost less than two thirds.")
    r.figure("decay", figure, "What is left of an error, by its age, if it enters at 0, $t_*$, $3t_*$ and $10t_*$. In the end an error stays the longer, the later it enters.")


def part_b(r, p, answer):
    """The discrete filter."""
    r.section("b", "The discrete filter")
    r.says("The average of n over a period has the variance R/Δt; a measurement with this noise at $t_k = k\\,\\Delta t$ is worth the continuous one over a period:")
    r.math(r"a(t_{k+1}) = a(t_k), \qquad z(t_k) = t_k\,a + v_k, \qquad R_d = R/\Delta t, \quad H_k = k\,\Delta t", "sampled")
    r.math(r"K_k = \frac{P_{k-1}t_k}{P_{k-1}t_k^2 + R/\Delta t} = \frac{P_kt_k\,\Delta t}{R}, \qquad \hat a_k = \hat a_{k-1} + K_k(z_k - t_k\hat a_{k-1}), \qquad P_k = (1 - K_kt_k)P_{k-1}", "discrete")
    r.says("Prediction changes nothing, $P_k^- = P_{k-1}$, as the state is constant and no noise drives it.")
    r.says("**The variance in closed form.** The update adds information, $1/P_k = 1/P_{k-1} + t_k^2\\,\\Delta t/R$, so that $1/P_k = 1/P_0 + (\\Delta t^3/R)\\sum_{j=1}^kj^2$. From $(j+1)^3 - j^3 = 3j^2 + 3j + 1$, added for j = 1 … k, $(k+1)^3 - 1 = 3\\sum j^2 + \\tfrac32k(k+1) + k$, hence $\\sum j^2 = k(k+1)(2k+1)/6$ and")
    r.math(r"\frac{1}{P_k} = \frac{1}{P_0} + \frac{\Delta t^3\,k(k+1)(2k+1)}{6R} = \frac{1}{P_0} + \frac{1}{R}\Bigl(\frac{t_k^3}{3} + \frac{t_k^2\,\Delta t}{2} + \frac{t_k\,\Delta t^2}{6}\Bigr). \qquad\blacksquare", "closed")
    r.says("The measurement at the end of a period has a larger factor t than the period has on average, so it says more: $P_k \\le P(t_k)$ for every period, and $P_k - P(t_k) = -P^2t^2\\,\\Delta t/(2R) + O(\\Delta t^2)$.")
    numbers = [by_hand.last(t, p.dt) for t in TIMES]
    if numbers[-1] > LONGEST:
        r.says("The last measurement before {t} s has the number {k}. The recursion is not run so far; the information is added up instead.", t=TIMES[-1], k=numbers[-1])
        r.value("posterior_variance", answer["posterior_variance"], "m²/s²", at=TIMES, symbol="P_k")
        r.check("posterior variance", answer["posterior_variance"], [by_hand.added_variance(p.R, p.P0, p.dt, k) for k in numbers], ("closed form", "sum of the information"))
    else:
        steps = max(numbers[-1], 1)
        shown = covariances(model(p, steps), steps)
        r.value("posterior_variance", shown.P_plus[numbers, 0, 0], "m²/s²", at=TIMES, symbol="P_k", agrees=answer)
        r.says("The answers give the variance at {times} s, each after the last measurement up to that time: the measurements {numbers}.", "" if numbers[0] else " The number 0 means that there is none yet.", times=", ".join(f"{t:g}" for t in TIMES), numbers=", ".join(map(str, numbers)))
    some = covariances(model(p, 20), 20)
    plus = [by_hand.sampled_variance(p.R, p.P0, p.dt, k) for k in range(21)]
    routes = ("recursion", "closed form")
    r.check("P⁺ of 20 measurements", some.P_plus[:, 0, 0], plus, routes)
    r.check("P⁻ of 20 measurements", some.P_minus[1:, 0, 0], plus[:-1], routes)
    r.check("gain of 20 measurements", some.K[1:, 0, 0], [plus[k] * k * p.dt**2 / p.R for k in range(1, 21)], routes)


def plan(r, p, experiment):
    """Every number chosen; returns the number of measurements."""
    steps = min(max(math.ceil(10 * scale(p) / p.dt), 20), 300)
    r.says("{tab:plan} lists what was chosen. The variances of the discrete filter are followed for a long time, to see whether they come to rest, and the filter runs on simulated records, each with a slope of its own.")
    r.table("plan", ["quantity", "value", "why"], [
        ["period Δt, s", p.dt, "given"],
        ["measurements", steps, "to ten times the instant of the largest gain; 20 at least, 300 at most"],
        ["last measurement at, s", steps * p.dt, "there P is far below $P_0$, unless the number above is the most that is allowed"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent:2} %", percent=100 * math.sqrt(2 / experiment.runs))],
        ["seed", experiment.seed, "a is drawn anew in every run, with the variance $P_0$"],
    ], "Plan of the experiment.")
    return {"steps": steps}


def part_c(r, p, system, steps):
    """Whether there is a steady state."""
    r.section("c", "The experiment: is there a steady state?")
    shown = covariances(model(p, steps), steps)
    between = np.array([by_hand.variance(p.R, p.P0, t) for t in shown.t])
    r.holds("P⁺ ≤ P(t)", between - shown.P_plus[:, 0, 0], ("recursion", "closed form of P(t)"), size=p.P0 or 1.0)
    r.value("steady_state_exists", False)
    if not p.P0:
        r.says("The slope is known from the start: P = 0 and K = 0 at all times, the trivial case. A steady state in which the filter goes on using measurements with a constant gain does not exist.")
        r.check("P⁺ of a known slope", shown.P_plus[:, 0, 0], [0.0] * (steps + 1), ("recursion", "closed form"), EXACT)
        return
    r.says("**There is no nontrivial steady state.** By that we mean a positive limit of P, or a constant gain in the limit with which the filter goes on measuring. In {eq:variance} and {eq:closed} 1/P grows beyond every bound, so P → 0 and K → 0, like")
    r.math(r"P(t) \to \frac{3R}{t^3}, \qquad K(t) \to \frac3{t^2}, \qquad \frac{K_k}{\Delta t} \to \frac{3}{t_k^2}", "tails")
    r.says("whatever $P_0$ is. (The arrows of {eq:tails} mean that the ratio of both sides tends to 1.) On logarithmic axes P ends on a straight line of slope −3, and it never stays within a given fraction of its limit 0. In the end the filter is the least-squares line through the origin and all the data, with equal weights, and a new measurement moves it less and less.")
    T = scale(p)
    tail = varying.transient(system, [500 * T, 1000 * T])
    r.order("slope of log P against log t, reversed", tail.P[:, 0, 0], 3.0, ("Riccati equation, integrated", "closed form"), within=1e-3)
    r.order("slope of log K against log t, reversed", tail.K[:, 0, 0], 2.0, ("Riccati equation, integrated", "closed form"), within=1e-3)
    settled = settling_step(shown.P_plus[:, :, 0], [0.0])
    r.check("step from which P⁺ stays within 1 % of its limit: none", settled, None, ("search along the recursion", "closed form: P⁺ > 0"))
    halves = (8, 16, 32, 64)
    target = float(varying.transient(system, [T]).P[0, 0, 0])
    errors = [float(covariances(model(p, n, T / n), n).P_plus[-1, 0, 0]) - target for n in halves]
    leading = -(target**2) * T**2 / (2 * p.R)
    r.order("order of P⁺ − P(t)", np.abs(errors), 1.0, ("discrete filter", "continuous filter, integrated"))
    r.order("order of what the leading term leaves", np.abs([e - leading * T / n for n, e in zip(halves, errors, strict=True)]), 2.0, ("discrete filter", "closed form of the error"))
    r.table("limit", ["Δt, s", "P⁺ − P(t), m²/s²", "leading term, m²/s²"], [(T / n, e, leading * T / n) for n, e in zip(halves, errors, strict=True)],
            "The discrete filter at t = {T} s, where the gain is largest, as the period is halved.", T=T)
    falling(r, p, system, shown, steps)


def falling(r, p, system, shown, steps):
    """The variances on logarithmic and on linear axes."""
    T = scale(p)
    t = np.geomspace(min(p.dt, T) / 4, max(steps * p.dt, 100 * T), 241)
    curve = varying.transient(system, t)
    figure = plots.lines(t, {"continuous P(t)": curve.P[:, 0, 0]}, xlabel=TIME, ylabel="variance P, m²/s²", log="xy",
                         points={"discrete P⁺": (shown.t[1:], shown.P_plus[1:, 0, 0])}, straight={"$3R/t^3$": (t[t > T], 3 * p.R / t[t > T] ** 3)})
    r.says("{fig:slope} shows the fall of P on logarithmic axes: flat at $P_0$ as long as t is below $t_*$, then along the dashed line $3R/t^3$, three decades in P for one in t. It goes on for ever; a steady state would be a horizontal line at the right. The dots of the discrete filter lie below the curve, and {tab:limit} shows that the difference is halved with the period.")
    r.figure("slope", figure, "P(t) and the variance of the discrete filter on logarithmic axes: in the end a straight line of slope −3.")
    window = np.linspace(0.0, max(4 * T, 4 * p.dt), 301)
    teeth = min(steps, max(4, math.ceil(window[-1] / p.dt)))
    discrete = covariances(model(p, teeth), teeth)
    dense = varying.transient(system, window)
    r.says("{fig:sawtooth} is the same on linear axes: a prediction leaves the variance as it is, so that every tooth is a step down, and every P⁺ lies below the curve.")
    r.figure("sawtooth", plots.sampled({text("Δt = {dt} s", dt=p.dt): discrete}, window, dense.P[:, 0, 0], ylabel="variance, m²/s²"),
             "The variance of the discrete filter over P(t).")


def ensemble(r, p, experiment, steps):
    """The filter on simulated data."""
    system = model(p, steps)
    theory = covariances(system, steps)
    some = experiment.histories(system, steps=steps)
    stats = experiment.statistics(system, steps=steps)
    r.says("**Simulated records.** {fig:errors} shows 25 runs, {fig:ensemble} and {tab:ensemble} the statistics of all {runs}.", runs=experiment.runs)
    estimates = [by_hand.batch(some.z[1:, 0, run], some.t[1:], p.R, p.P0, p.dt) for run in range(some.z.shape[2])]
    r.check("last estimates of 25 runs", some.x_plus[-1, 0], estimates, ("recursion", "least squares of all measurements at once"), scale=float(np.abs(estimates).max()) or 1.0)
    r.figure("errors", plots.errors(some, xlabel=TIME, unit="m/s", measured_unit="m"), "Innovations, prediction and filtering errors of 25 runs inside the bands of the theory. The innovations soon have the width of the measurement noise alone, while each error of the slope settles on a curve of its own, which creeps towards zero.")
    r.figure("ensemble", plots.ensemble_log(stats, theory.P_plus, xlabel=TIME, units=["m/s"], names=["a"]),
             "RMS and mean of the filtering errors of {runs} runs against theory, NEES and NIS averaged over the runs, in the bands of 95 % of ensembles.", runs=experiment.runs)
    agreement(r, "", stats, theory.P_plus)
    rows = [(k, theory.t[k], theory.sd_plus[k, 0], rms(stats, k), mean_error(stats, k), theory.K[k, 0, 0] / p.dt) for k in sorted({1, 2, 5, 10, steps // 2, steps}) if k <= steps]
    r.table("ensemble", ["k", TIME, "σ of theory, m/s", "RMS, m/s", "mean error, m/s", "K/Δt, 1/s²"], rows, "The ensemble along the measurements.")
    return {"measured": rms(stats, unit="m/s"), "sd": float(theory.sd_plus[-1, 0]), "when": float(theory.t[-1])}


PARTS = Skeleton(
    result=result,
    key="gain",
    analysis=(part_a, stability, part_b),
    plan=plan,
    experiment=(part_c, ensemble),
    discussion=discussion,
    answers=answers,
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    answer, system = by_hand.analytic(p), continuous(p)
    return PARTS.report(META, p, experiment, answer=answer, system=system)


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
