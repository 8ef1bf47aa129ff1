r"""Lab 20. A stable filter of an unstable system.

Source: Semushin & Tsyganova 2001, task 20. For ẋ = x + w, z = x + v with white w, v of strengths Q = 1 and R the sheet
asks for the error variance P(t) and its limit, curves for R = 1, 2, 4 with P0 = 1; a proof by the Lyapunov function
V = y²/P that the filter ẏ = (1 − P/R)y is asymptotically stable, and what that means; the discrete filter for the
equivalent measurements; and an experiment in which P⁻, P⁺ are compared with P(t).

Expected answer: P' = 2P + Q − P²/R; with κ = √(1+Q/R) P(t) by tanh κt, P∞ = R(1+κ), filter pole −κ;
V' = −y²(1/R + Q/P²) < 0, uniformly and exponentially stable. Φ = e^dt, Q_d = Q(e^(2dt) − 1)/2, R_d = R/dt; the bounds
P⁻, P⁺ are P∞ ± P∞²dt/(2R) + …. With Φ = 1 + dt the error would grow with x without limit.
"""

import math
from dataclasses import replace

import numpy as np
from ctlabs.tasks._task20_words import answers, conclusions, discussion, label, result
from ctlabs.tasks.answers import task20 as by_hand
from ctlabs.tasks.answers.task20 import MOMENT, TIMES
from pydantic import model_validator

from ctlabs.analysis import sensitivity
from ctlabs.filtering import bucy, steady
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import TOGETHER, agreement, mean_error, portrait, rms
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import ContinuousModel
from ctlabs.models.discretisation import discretise
from ctlabs.reporting import plots
from ctlabs.reporting.draws import each, one_of, span
from ctlabs.reporting.params import LabParameters, Positive, Positives, Variance, given
from ctlabs.reporting.report import EXACT, Report
from ctlabs.text import text

META = {
    "name": "task20",
    "title": "A stable filter of an unstable system",
    "source": "Semushin & Tsyganova 2001, task 20",
    "parts": ["a", "b", "c", "d"],
}

#: Horizon of curves and experiments, s: x grows like e^t, and the slowest filter (κ = 1) settles within it.
HORIZON = 4.0
#: No path is simulated, and no measurement awaited, longer than this, s: by e^20 rounding of x comes near to the error.
LONGEST = 20.0
#: No more panels than this in one figure.
SHOWN = 4
TIME = "t, s"


class Parameters(LabParameters):
    """What may be changed."""

    Q: Variance = given(1.0, unit="m²/s", meaning="strength of the process noise w", draw=span(0.5, 3, 0.25))
    R_values: Positives = given((1.0, 2.0, 4.0), unit="m²·s", meaning="strengths of the measurement noise v", symbol="R", draw=each(one_of(0.5, 0.75, 1), one_of(1.5, 2, 2.5), one_of(3, 4, 5)))
    P0: Variance = given(1.0, unit="m²", meaning="variance of x(0)", draw=span(0.5, 3, 0.25))
    dt: Positive = given(0.1, unit="s", meaning="period of the discrete measurements", draw=one_of(0.05, 0.1, 0.15, 0.2))

    @model_validator(mode="after")
    def _within_reach(self):
        if not self.Q and not self.P0:
            msg = "P0: expected a variance > 0 where Q = 0 (x would be known for ever and V undefined), received 0"
            raise ValueError(msg)
        if self.dt > LONGEST:
            msg = f"dt: expected at most {LONGEST:g} s (x grows by exp(dt) between measurements, beyond double precision), received {self.dt:g}"
            raise ValueError(msg)
        return self


def model(p, R):
    """ẋ = x + w, z = x + v."""
    return ContinuousModel(F=[[1]], G=[[1]], Q=[[p.Q]], H=[[1]], Rc=[[R]], P0=[[p.P0]], states=["x"],
                           measurements=["z"], units=["m"])


def part_a(r, p, answer, systems):
    """P(t) and its limit."""
    r.section("a", "The error variance and its limit")
    r.says("The system and its measurement, for $R = {R}$ m²·s, are", R=p.R_values[0])
    r.model(systems[0])
    r.says("Its Kalman–Bucy filter {ref:maybeck, section 5.11}, started at $\\hat{x}(0) = E[x(0)]$ and $P(0) = P_0$, is")
    r.math(r"\dot{\hat x} = \hat x + K\,(z - \hat x), \qquad K(t) = \frac{P(t)}{R}, \qquad \dot P = 2P + Q - \frac{P^2}{R}", "riccati")
    r.says("**Solution.** With $\\kappa = \\sqrt{1 + Q/R}$ and $\\pi = P - R$ the square is completed, $\\dot\\pi = (R^2\\kappa^2 - \\pi^2)/R$, which is the Riccati equation of a Wiener process in white noise, with the limit $R\\kappa$ and the rate κ (lab 16). Hence")
    r.math(r"\pi(t) = R\kappa\,\frac{\pi_0 + R\kappa\tanh\kappa t}{R\kappa + \pi_0\tanh\kappa t} \qquad\Longrightarrow\qquad P(t) = \frac{P_0(\kappa + \tanh\kappa t) + Q\tanh\kappa t}{\kappa - \tanh\kappa t + (P_0/R)\tanh\kappa t}", "variance")
    r.says("**Limit.** The roots of $\\dot P = 0$ are $R(1 \\pm \\kappa)$. The ratio $(\\pi - R\\kappa)/(\\pi + R\\kappa)$ decays like $e^{-2\\kappa t}$ unless $P_0$ is the lower root, which is negative (or 0, if $Q = 0 = P_0$, which is excluded). So for every $P_0$")
    r.math(r"P(t) \to P_\infty = R\Bigl(1 + \sqrt{1 + \tfrac QR}\Bigr), \qquad K \to 1 + \kappa, \qquad 1 - K \to -\kappa \qquad\blacksquare", "limit")
    if not p.Q:
        r.says("Without process noise this is $P_\\infty = 2R$, not 0: an unstable state is never known exactly, since what is left of the initial error grows as fast as it is measured away.")
    limits, routes = [bucy.steady(system) for system in systems], ("Riccati equation", "closed form")
    r.value("variance_steady_continuous", [limit.P[0, 0] for limit in limits], "m²", symbol=r"P_\infty", agrees=answer, routes=routes)
    r.value("gain_steady_continuous", [limit.K[0, 0] for limit in limits], "1/s", symbol=r"K_\infty", agrees=answer, routes=routes)
    curves = [bucy.transient(system, TIMES).P[:, 0, 0] for system in systems]
    r.value("variance_continuous", curves, "m²", at=TIMES, agrees=answer, routes=("Riccati equation, integrated", "closed form"))
    r.table("variance", ["R, m²·s", *(text("P({t} s), m²", t=t) for t in TIMES), "P∞, m²", "K∞, 1/s"],
            [(R, *curve, limit.P[0, 0], limit.K[0, 0]) for R, curve, limit in zip(p.R_values, curves, limits, strict=True)], "The error variance at four times, its limit, and the gain in the limit.")
    t = np.linspace(0.0, HORIZON, 241)
    lines = {label(R): bucy.transient(system, t).P[:, 0, 0] for R, system in zip(p.R_values, systems, strict=True)}
    ends = dict(zip(lines, [limit.P[0, 0] for limit in limits], strict=False)) if len(lines) == len(limits) else None
    r.says("In {fig:variance} each curve goes monotonically from $P_0$ to its limit; {tab:variance} has the numbers. A noisier measurement has the higher limit and is slower in reaching it, for the rate κ is the smaller, the larger R is; $P_\\infty$ itself never falls below 2R, however small Q may be.")
    r.figure("variance", plots.transient(t, lines, limits=ends, xlabel=TIME, ylabel="error variance, m²"), "P(t) of {eq:variance} for each R, and its limit (dashed).")


def part_b(r, p, answer, systems):
    """Stability by Lyapunov's function."""
    r.section("b", "Stability of the filter by a Lyapunov function")
    r.says("**Proof.** By {eq:riccati}, for $V(y,t) = y^2/P(t)$ along $\\dot y = (1 - P/R)y$,")
    r.math(r"\dot V = \frac{2y\dot y}{P} - \frac{y^2\dot P}{P^2} = y^2\Bigl[\frac2P - \frac2R - \frac2P - \frac Q{P^2} + \frac1R\Bigr] = -y^2\Bigl(\frac1R + \frac Q{P^2}\Bigr) = -\Bigl(\frac PR + \frac QP\Bigr)V", "lyapunov")
    r.says("$P(t)$ runs monotonically from $P_0$ to $P_\\infty$, so from some $t_0$ on (0 if $P_0 > 0$, any $t_0 > 0$ otherwise) $0 < P_{\\min} \\le P \\le P_{\\max} < \\infty$ with the smaller and the larger of $P(t_0)$, $P_\\infty$. Hence $y^2/P_{\\max} \\le V \\le y^2/P_{\\min}$ and $\\dot V \\le -\\gamma V$ with $\\gamma = \\min(P/R + Q/P) > 0$ over that range, so that")
    r.math(r"y^2(t) \le \frac{P_{\max}}{P_{\min}}\,e^{-\gamma(t-t_1)}\,y^2(t_1), \qquad t \ge t_1 \ge t_0", "bound")
    r.says("The bound of {eq:bound} contains $t - t_1$ alone: the filter is uniformly and exponentially stable, not only asymptotically. Both bounds on P are needed. Without the upper one V would not control y; without the lower one V could fall while y does not. ∎ For vectors the same function proves stability where the system is uniformly observable and controllable ({ref:kalman_bucy}; {ref:jazwinski, chapter 7}).")
    r.says("In closed form, from $1 - P/R = -\\pi/R$,")
    r.math(r"\frac{y(t)}{y(0)} = \frac{\kappa}{\kappa\cosh\kappa t + (P_0/R - 1)\sinh\kappa t} \sim e^{-\kappa t}, \qquad \text{pole of the steady filter } -\kappa = -\sqrt{1 + Q/R}", "closed")
    limits = [bucy.steady(system) for system in systems]
    r.value("filter_pole", [limit.poles[0].real for limit in limits], "1/s", symbol=r"-\kappa", agrees=answer, routes=("Riccati equation", "closed form"))
    now = [float(bucy.transient(system, [MOMENT]).P[0, 0, 0]) for system in systems]
    slopes = [2 * (1 - P / R) / P - (2 * P + p.Q - P**2 / R) / P**2 for P, R in zip(now, p.R_values, strict=True)]
    r.value("lyapunov_derivative", slopes, "1/(m²·s)", symbol=r"\dot V/y^2\;(t = 1\,\text{s})", agrees=answer, routes=("derivative of y²/P with P integrated", "−(1/R + Q/P²), closed form"))
    t0 = 0.0 if p.P0 else HORIZON / 100
    t, rows, ys, Vs = np.linspace(t0, HORIZON, 200), [], {}, {}
    for R, system, limit in zip(p.R_values, systems, limits, strict=True):
        P, end = bucy.transient(system, t).P[:, 0, 0], float(limit.P[0, 0])
        low, high = min(float(P[0]), end), max(float(P[0]), end)
        rate = by_hand.decay(p.Q, R, low, high)
        y = np.array([by_hand.homogeneous(p.Q, R, p.P0, float(at)) for at in t])
        V = y**2 / P
        other = bucy.transient(replace(system, P0=[[2 * p.P0 + R]]), t).P[:, 0, 0]
        both = y * np.array([by_hand.homogeneous(p.Q, R, 2 * p.P0 + R, float(at)) for at in t])
        # Two solutions of the Riccati equation differ by the product of their filters' solutions; of a difference of numbers as large
        # as P the rounding of P stays: SOLVER times a part in 10⁵ of it is 10⁻¹³ P.
        size = both + 1e-5 * P / (p.P0 + R)
        r.check(text("y(t), {name}", name=label(R)), (other - P) / (p.P0 + R), both, ("difference of two variances, integrated", "closed form"), scale=size)
        r.holds(text("V falls at least like exp(−γt), {name}", name=label(R)), V[0] * np.exp(-rate * (t - t0)) - V, ("closed form of y, P integrated", "bound of the proof"), size=float(V[0]))
        r.holds(text("bounds of P, {name}", name=label(R)), [float(P.min()) - low, high - float(P.max())], ("Riccati equation, integrated", "P(t0) and the limit"), size=high)
        num, den = bucy.transfer_function(system)
        r.check(text("the filter reproduces exp(t), {name}", name=label(R)), np.polyval(num, 1.0) / np.polyval(den, 1.0), 1.0, ("transfer function at s = 1", "unbiased estimate"))
        rows.append((R, low, high, rate, limit.poles[0].real))
        ys[label(R)], Vs[label(R)] = np.abs(y), V / V[0]
    stability_says(r, p, t0, t, rows, ys, Vs)


def stability_says(r, p, t0, t, rows, ys, Vs):
    """The constants of the proof, and its figures."""
    r.value("verdict_b", bool(all(row[3] > 0 and row[4] < 0 for row in rows)))
    r.table("stability", ["R, m²·s", "least P, m²", "greatest P, m²", "γ, 1/s", "pole of the filter, 1/s"], rows, text("The constants of {eq:bound}, from {t0} s on. The plant's own pole is at +1 1/s.", t0=t0))
    curves = {f"|y|, {name}": ys[name] for name in list(ys)[:SHOWN]} | {f"V, {name}": Vs[name] for name in list(ys)[:SHOWN]}
    r.says("{tab:stability} has the constants, {fig:lyapunov} the solutions y and the function V on a logarithmic axis. Without the filter an error would grow along the dashed line; with it every y ends on a straight line that falls at the rate κ, and every V falls from the beginning, as {eq:lyapunov} says.")
    r.figure("lyapunov", plots.lines(t, curves, xlabel=TIME, ylabel="ratio to the initial value", log="y", straight={"$e^t$, plant alone": (t, np.exp(t))}), "Solutions y of the filter without input and Lyapunov's function V, both relative to their initial values, against the plant without a filter.")
    if p.P0 < max(p.R_values):
        which = "While $P < R$ the bracket $1 - P/R$ is positive and y grows for a moment" if p.P0 < min(p.R_values) else "For those R that exceed $P_0$, y grows while $P < R$"
        r.says(which, ": the gain is still too small to hold the plant. V falls all the same; that is why V, and not $y^2$, proves stability.")
    r.says("**What it means.** The error $e = \\hat{x} - x$ obeys the same equation, driven by noise: $\\dot e = (1 - P/R)e - w + Kv$. So a wrong $\\hat{x}(0)$ and every rounding error are forgotten like $e^{-\\kappa t}$, and the variance stays bounded, although x itself grows like $e^t$. The steady gain may replace $K(t)$. An error of the model, however, is not forgiven: see {part:c}.")


def part_c(r, p, answer, sampled):
    """The discrete filter, and why Φ is not 1 + dt."""
    r.section("c", "The discrete filter")
    r.says("Between measurements $x(t_{i+1}) = e^{\\Delta t}x(t_i) + \\int e^{t_{i+1}-s}w\\,\\mathrm{d}s$; the average of v over a period has the variance R/Δt. Hence (with Δt in units of the plant's time constant, 1 s)")
    r.math(r"\Phi = e^{\Delta t}, \qquad Q_d = Q\int_0^{\Delta t}e^{2s}\,\mathrm{d}s = \frac Q2\bigl(e^{2\Delta t} - 1\bigr), \qquad R_d = \frac R{\Delta t}", "sampled")
    r.model(sampled[0])
    r.check("Φ", [m.Phi[0, 0] for m in sampled], [math.exp(p.dt)] * len(sampled), ("matrix exponential", "by hand"), EXACT)
    r.check("Q_d", [m.Qd[0, 0] for m in sampled], [0.5 * p.Q * math.expm1(2 * p.dt)] * len(sampled), ("integral of ΦGQGᵀΦᵀ", "by hand"), EXACT)
    r.check("R_d", [m.R[0, 0] for m in sampled], [R / p.dt for R in p.R_values], ("model", "by hand"), EXACT)
    r.says("and the discrete filter is")
    r.math(r"\hat x(t_i^-) = e^{\Delta t}\hat x(t_{i-1}^+), \quad P(t_i^-) = e^{2\Delta t}P(t_{i-1}^+) + Q_d, \quad K(t_i) = \frac{P(t_i^-)}{P(t_i^-) + R_d}", "prediction")
    r.math(r"\hat x(t_i^+) = \hat x(t_i^-) + K(t_i)[z(t_i) - \hat x(t_i^-)], \qquad P(t_i^+) = K(t_i)R_d, \qquad \hat x(t_0^+) = E[x(0)], \quad P(t_0^+) = P_0", "update")
    r.says("The steady state is the positive root of $(P^-)^2 - [(e^{2\\Delta t}-1)R_d + Q_d]P^- - Q_dR_d = 0$, which follows when {eq:prediction} and {eq:update} are put into one. As Δt → 0")
    r.math(r"P^\mp = P_\infty \pm \frac{P_\infty^2}{2R}\,\Delta t + O(\Delta t^2)", "expansion")
    r.says("so the bounds approach $P_\\infty$ at first order, their mean at second.")
    limits, routes = [steady.solve(m) for m in sampled], ("Riccati equation", "closed form")
    r.value("prior_variance_steady", [limit.P_minus[0, 0] for limit in limits], "m²", symbol=r"\bar P^-", agrees=answer, routes=routes)
    r.value("posterior_variance_steady", [limit.P_plus[0, 0] for limit in limits], "m²", symbol=r"\bar P^+", agrees=answer, routes=routes)
    poles = [limit.poles[0].real for limit in limits]
    r.check("pole of the discrete filter", poles, [math.exp(p.dt) * plus / minus for minus, plus in zip(answer["prior_variance_steady"], answer["posterior_variance_steady"], strict=True)], ("Riccati equation", "e^dt P⁺/P⁻, closed form"), scale=math.exp(p.dt))
    r.table("discrete", ["R, m²·s", "P⁻, m²", "P⁺, m²", "K", "pole (1−K)e^Δt", "P∞ of continuous time, m²"],
            [(R, limit.P_minus[0, 0], limit.P_plus[0, 0], limit.K[0, 0], pole, end) for R, limit, pole, end in zip(p.R_values, limits, poles, answer["variance_steady_continuous"], strict=True)],
            text("Steady state of the discrete filters, Δt = {dt} s, beside that of continuous time.", dt=p.dt))
    r.says("In {tab:discrete} each limit of the continuous filter lies between P⁻ and P⁺, and every pole inside the unit circle.")
    not_euler(r, p, answer, sampled)


def not_euler(r, p, answer, sampled):
    """What 1 + dt costs."""
    r.says("**Φ is $e^{\\Delta t}$, not 1 + Δt.** Let a filter use $\\Phi_d = 1 + \\Delta t$, $Q_d = Q\\,\\Delta t$. It is stable itself, but its error obeys")
    r.math(r"e_i^+ = (1-K)\bigl[(1+\Delta t)\,e_{i-1}^+ - (e^{\Delta t} - 1 - \Delta t)\,x_{i-1} - w_d\bigr] + Kv_d", "wrong")
    r.says("and is driven by x, which grows: the innovations cannot average out an error that has always the same sign. In the end the error is a fixed multiple of x,")
    r.math(r"e \to c\,x, \qquad c = -\frac{(1-K)(e^{\Delta t} - 1 - \Delta t)}{e^{\Delta t} - (1-K)(1+\Delta t)} \approx -\frac{\Delta t}{2(1+\kappa)} \quad (\Delta t \to 0)", "multiple")
    r.says("of first order in Δt, and without bound in metres. The variance that the filter computes says nothing of this. {tab:approximation} and {fig:approximation} have the true errors, from the covariance of truth and filter together (no random numbers).")
    steps = max(1, min(max(math.ceil(20 / p.dt), 40), 2000, math.floor(300 / p.dt)))
    shown = max(1, min(steps, round(HORIZON / p.dt)))
    rows, first = [], None
    R, kappa = p.R_values[0], math.sqrt(1 + p.Q / p.R_values[0])
    short = [1 / kappa / n for n in (16, 32, 64, 128)]
    rest = [abs(by_hand.approximation(p.Q, R, dt) + dt / (2 * (1 + kappa))) for dt in short]
    r.order(text("what is left of c beside its first term, {name}", name=label(R)), rest, 2.0, ("closed form", "first term of its series"))
    for R, truth, c in zip(p.R_values, sampled, answer["error_of_the_approximation"], strict=True):
        design = replace(truth, Phi=[[1 + p.dt]], Qd=[[p.Q * p.dt]])
        found = sensitivity.actual(truth, design, steps)
        errors, states = by_hand.moments_of_the_approximation(p.Q, R, p.P0, p.dt, steps)
        true = found.P_plus[:, 0, 0]
        r.check(text("relative mean square error with 1 + dt, {name}", name=label(R)), true[1:] / errors[1:], np.ones(steps), ("sensitivity recursion", "moments of x and e"))
        # Shown where x has outgrown the noise, and 1 − K is not lost in the rounding of K.
        if abs(c) > 1e-6 and steps >= 40 and steps * p.dt >= 20 and states[-1] * c**2 > 1e10 * found.claimed.P_plus[-1, 0, 0]:
            r.check(text("error as a multiple of x, {name}", name=label(R)), math.sqrt(true[-1] / states[-1]), abs(c), ("sensitivity recursion", "closed form of the limit"))
        right = covariances(truth, steps)
        rows.append((R, right.sd_plus[shown, 0], found.claimed.sd_plus[shown, 0], math.sqrt(true[shown]), math.sqrt(states[shown]), c))
        first = first or (right, found, np.sqrt(true))
    r.table("approximation", ["R, m²·s", "σ with e^Δt, m", "σ claimed with 1 + Δt, m", "true RMS with 1 + Δt, m", "RMS of x, m", "c"], rows,
            text("After {shown} measurements, at t = {t} s; c of {eq:multiple} is the final error as a multiple of x.", shown=shown, t=shown * p.dt))
    right, found, true = first
    stop = max(2, min(len(right.t), math.ceil(3 * HORIZON / p.dt)))
    curves = {"with $e^{\\Delta t}$: true, as claimed": right.sd_plus[:stop, 0], "with $1 + \\Delta t$: true": true[:stop]}
    t = right.t[:stop]
    growth = np.sqrt(p.P0 * np.exp(2 * t) + 0.5 * p.Q * np.expm1(2 * t))
    keep, skip = growth > 0, max(1, stop // 20)
    claimed = {"with $1 + \\Delta t$: claimed": (t[keep], found.claimed.sd_plus[:stop, 0][keep])}
    r.figure("approximation", plots.lines(t[keep], {k: v[keep] for k, v in curves.items()}, xlabel=TIME, ylabel="RMS error, m", log="y", straight=claimed, points={"RMS of x": (t[keep][::skip], growth[keep][::skip])}),
             "Errors of the right filter and of that with 1 + Δt, {name}; dots: the size of x.", name=label(p.R_values[0]))
    grown = true[:stop][-1] > 2 * right.sd_plus[:stop, 0][-1]
    r.says("In {fig:approximation} the two filters claim nearly the same (dashed line), ", "but the true error of the second leaves its claim and then grows in parallel with x." if grown else "and at this period the second is true to its claim over the time shown; its error will leave it only when x has become large enough.")


def plan(r, p, experiment, answer):
    """Every number chosen; the number of measurements, 0 if no simulation makes sense."""
    smallest = math.sqrt(min(answer["posterior_variance_steady"]) / (p.P0 + 0.5 * p.Q))
    longest = min(LONGEST, math.log(1e11 * smallest))
    steps = min(max(math.ceil(HORIZON / p.dt), 10), 400, math.floor(longest / p.dt * (1 + 1e-12)))
    steps = max(steps, 0)
    r.says("{tab:plan} lists what was chosen. The variances of (c) need no random numbers and are laid over P(t); the filter then runs on simulated records, as long as rounding permits.")
    r.table("plan", ["quantity", "value", "why"], [
        ["period Δt, s", p.dt, "given"],
        ["horizon at most, s", longest, "x grows exponentially; beyond this its rounding errors come near to the error of the estimate"],
        ["measurements", steps, text("{horizon} s, but 10 at least and 400 at most, within that horizon", horizon=HORIZON)],
        ["runs", experiment.runs, text("a standard error of the variance of {percent:2} %", percent=100 * math.sqrt(2 / experiment.runs))],
        ["seed", experiment.seed, "another stream of random numbers for each R"],
    ], "Plan of the experiment.")
    return {"steps": steps, "together": min(TOGETHER, math.floor(longest / p.dt * (1 + 1e-12)))}


def part_d(r, p, answer, experiment, systems, sampled, steps, together):
    """P⁻ and P⁺ over P(t), and the ensembles."""
    r.section("d", "The variances of prediction and filtering over P(t)")
    r.says("**P(t) lies between them.** Over an interval h the gain alone is $g(P) = aP + q$, $a = e^{2h} > 1$, the loss alone (for an interval h') $l(P) = P/(1 + bP)$, $b = h'/R$; both increase with P. Loss first ends no lower than gain first, since")
    r.math(r"l(g(P)) = \frac{aP}{1 + b(aP+q)} + \frac{q}{1 + b(aP+q)} \le \frac{aP}{1 + bP} + q = g(l(P))", "order")
    r.says("Here $l(g(P))$ is what gain first gives. Continuous time is the limit of many short gains and losses in turn. Moving all gains to the front lowers the result, which is the discrete filter from $t_{i-1}^+$ to $t_i^+$; moving all losses to the front raises it, from $t_{i-1}^-$ to $t_i^-$. By induction $P(t_i^+) \\le P(t_i) \\le P(t_i^-)$. ∎")
    count = min(max(math.ceil(HORIZON / p.dt), 8), 400)
    t, panels = np.linspace(0.0, count * p.dt, 401), {}
    for R, system, m in zip(p.R_values, systems, sampled, strict=True):
        shown, name = covariances(m, count), label(R)
        between, routes = bucy.transient(system, shown.t).P[:, 0, 0], ("recursion", "Riccati equation, integrated")
        size = float(shown.P_minus.max())
        r.holds(f"P⁺ ≤ P(t), {name}", between[1:] - shown.P_plus[1:, 0, 0], routes, size=size)
        r.holds(f"P(t) ≤ P⁻, {name}", shown.P_minus[1:, 0, 0] - between[1:], routes, size=size)
        routes = ("recursion", "fixed points of one step")
        closed = by_hand.posterior_variances(p.Q, R, p.P0, p.dt, count)
        r.check(text("P⁺ along the measurements, {name}", name=name), shown.P_plus[:, 0, 0], closed, routes)
        r.check(text("gain along the measurements, {name}", name=name), shown.K[1:, 0, 0], closed[1:] * p.dt / R, routes)
        panels[name] = (shown, bucy.transient(system, t).P[:, 0, 0], answer["variance_steady_continuous"][p.R_values.index(R)], between)
    sawteeth(r, t, panels)
    convergence(r, p, systems)
    if not steps:
        r.says("No record is simulated: within one period x would grow so much that its rounding errors reach the error of the estimate. The variances above need none.")
        return {"measured": None, "sd": None, "when": None}
    r.says("**Simulated records.** {fig:errors} shows 25 runs for {name}, {fig:ensemble} the statistics of {runs} runs; {tab:ensemble} has further ensembles, one for each R.", name=label(p.R_values[0]), runs=experiment.runs)
    own = portrait(r, experiment, sampled[0], steps, xlabel=TIME, together_steps=together, figures={
        "errors": "x itself grows beyond every axis; the errors stay within bands that soon have a constant width.",
        "ensemble": "The RMS follows theory to its limit; neighbouring points lie on one side for a while, as successive errors are correlated."})
    rows = []
    for stream, (R, m) in enumerate(zip(p.R_values, sampled, strict=True), start=1):
        stats, theory = experiment.statistics(m, steps=steps, stream=stream), covariances(m, steps)
        agreement(r, label(R), stats, theory.P_plus)
        size = math.sqrt(p.P0 * math.exp(2 * theory.t[-1]) + 0.5 * p.Q * math.expm1(2 * theory.t[-1]))
        rows.append((R, theory.t[-1], size, theory.sd_plus[-1, 0], rms(stats), mean_error(stats)))
    r.table("ensemble", ["R, m²·s", "at t, s", "RMS of x, m", "σ of theory, m", "RMS error, m", "mean error, m"], rows, "The errors at the last instant, in an ensemble for each R that is independent of the one in {fig:ensemble}.")
    return {"measured": rms(own, unit="m"), "sd": float(covariances(sampled[0], steps).sd_plus[-1, 0]), "when": steps * p.dt}


def sawteeth(r, t, panels):
    """The discrete filters over the continuous ones."""
    name, (shown, P, limit, _between) = next(iter(panels.items()))
    r.says("{fig:sawtooth} shows this for {name}: a prediction takes the variance above the curve, a measurement below it, and the curve passes through every tooth. ", "For the other R the picture is the same. " if len(panels) > 1 else "", "{fig:gap} shows how far P⁻ and P⁺ are from P(t) in per cent, for every R: in the limit about $\\pm P_\\infty\\Delta t/(2R)$, by {eq:expansion}, where the period is short.", name=name)
    r.figure("sawtooth", plots.sampled({name: shown}, t, P, xlabel=TIME, ylabel="variance, m²", limit=limit), "Variances of the discrete filter before and after each measurement over P(t), {name}.", name=name)
    when, gaps = next(iter(panels.values()))[0].t[1:], {}
    for name, (shown, _P, _limit, between) in list(panels.items())[:SHOWN]:
        gaps |= {f"$P^-$, {name}": 100 * (shown.P_minus[1:, 0, 0] / between[1:] - 1), f"$P^+$, {name}": 100 * (shown.P_plus[1:, 0, 0] / between[1:] - 1)}
    r.figure("gap", plots.lines(when, gaps, xlabel=TIME, ylabel="difference from P(t), %", marker=".", straight={"P(t)": (when[[0, -1]], [0, 0])}), "How far the variances of the discrete filters are from P(t), above before a measurement and below after it.")


def convergence(r, p, systems):
    """dt → 0."""
    rows = []
    for R, system in zip(p.R_values, systems, strict=True):
        exact, tau = float(bucy.steady(system).P[0, 0]), 1 / math.sqrt(1 + p.Q / R)
        periods = [tau / n for n in (8, 16, 32, 64)]
        found = [steady.solve(discretise(system, dt)) for dt in periods]
        minus, plus = (np.array([getattr(s, name)[0, 0] for s in found]) for name in ("P_minus", "P_plus"))
        errors = {"P⁻": (minus - exact, 1.0), "P⁺": (exact - plus, 1.0), "mean of P⁻ and P⁺": (0.5 * (minus + plus) - exact, 2.0)}
        for name, (values, order) in errors.items():
            r.order(text("order of {name}, {R}", name=name, R=label(R)), np.abs(values), order, ("discrete filter", "continuous filter"))
        rows += [(R, dt, *(float(values[i]) for values, _order in errors.values())) for i, dt in enumerate(periods)]
    r.says("**A shorter period.** In {tab:convergence} each halving of the period halves the distance of both bounds from $P_\\infty$ and leaves a quarter of that of their mean, as {eq:expansion} says: in the limit the sampled filter is the continuous one.")
    r.table("convergence", ["R, m²·s", "Δt, s", "P⁻ − P∞, m²", "P∞ − P⁺, m²", "mean − P∞, m²"], rows, "Steady variances of the discrete filter as the period is halved, from the limit of P(t).")


PARTS = Skeleton(
    result=result,
    key="lyapunov",
    analysis=(part_a, part_b, part_c),
    plan=plan,
    experiment=(part_d,),
    discussion=discussion,
    answers=answers,
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    answer, systems = by_hand.analytic(p), [model(p, R) for R in p.R_values]
    sampled = [discretise(system, p.dt) for system in systems]
    return PARTS.report(META, p, experiment, answer=answer, systems=systems, sampled=sampled)


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
