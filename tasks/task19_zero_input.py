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
from ctlabs.tasks.answers import task19 as by_hand
from ctlabs.tasks.answers.task19 import TIMES, WITHIN

from ctlabs.filtering import bucy, steady
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import largest, portrait
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import ContinuousModel
from ctlabs.models.discretisation import discretise
from ctlabs.reporting import plots
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


class Parameters(LabParameters):
    """What may be changed."""

    alpha: Real = given(2.0, unit="1/s", meaning="minus the zero of the transfer function")
    beta: Real = given(1.0, unit="1/s", meaning="minus its pole")
    dt: Positive = given(0.1, unit="s", meaning="period of the discrete measurements")


def model(p, beta=None):
    """ẋ = −βx (w ≡ 0), z = x + v."""
    return ContinuousModel(F=[[-p.beta if beta is None else -beta]], G=[[1]], Q=[[0]], H=[[1]], Rc=[[1]], x0=[0],
                           P0=[[1]], states=["x"], measurements=["z"], units=["m"])


def part_a(r, p, answer, system):
    """How many states, the hint, P(t)."""
    r.section("a", "The continuous filter")
    r.says("**One state is enough.** The differential equation of the transfer function is $\\dot{x} + \\beta x = \\dot{w} + \\alpha w$. In state space")
    r.math(r"\dot q = -\beta q + (\alpha - \beta)\,w, \qquad x = q + w")
    r.says("With $w \\equiv 0$ what is left is $x = q$, $\\dot{x} = -\\beta x$, and $x(t) = e^{-\\beta t}x(0)$. The zero α only says how w enters, so it plays no part; that E x²(0) = 1 is not 0 comes from what happened before t = 0. For α = β the pole and the zero cancel in the transfer function, which is then 1 and says x = w ≡ 0; but a transfer function describes a system at rest at t = 0. The mode $e^{-\\beta t}$ that w does not reach then is still there and still starts from x(0), so the state must not be cancelled.")
    r.model(system)
    r.value("states_required", system.n, agrees=answer, routes=("dimension of the model", "degree of s + β"), kind=EXACT)
    moved = [discretise(system, t).Phi[0, 0] for t in TIMES]
    r.check("free motion x(t)/x(0), whatever α", moved, answer["free_response"], ("transition e^(F t)", "Laplace transform with α kept"))
    r.says("**The hint.** Let $\\dot{M} = AM + MA^T - MBM$. Differentiating $MM^{-1} = I$ gives $\\dot{M}M^{-1} + M\\,\\mathrm{d}(M^{-1})/\\mathrm{d}t = 0$, hence")
    r.math(r"\frac{\mathrm{d}}{\mathrm{d}t}M^{-1} = -M^{-1}\dot M M^{-1} = -M^{-1}A - A^TM^{-1} + B.")
    r.says("∎ The same by computer algebra: for 1 × 1 and for 2 × 2 matrices of symbols the inverse is written out and each element differentiated. {one} and {two} elements differ from the equation; with the sign of B reversed {wrong} of 4 do.",
           one=answer["hint"][0], two=answer["hint"][1], wrong=answer["hint"][2])
    r.check("elements in which the hint fails, 1 × 1 and 2 × 2", answer["hint"][:2], [0, 0], ("derivative of M⁻¹, element by element", "the hint's equation"), EXACT)
    r.says("**The filter.** With M = P, A = −β, B = 1 (no process noise, so the equation has this form):")
    r.math(r"\dot{\hat x} = -\beta\hat x + P(t)\,(z - \hat x), \quad \hat x(0) = 0; \qquad \dot P = -2\beta P - P^2, \quad P(0) = 1")
    r.math(r"\frac{\mathrm{d}}{\mathrm{d}t}\frac1P = \frac{2\beta}{P} + 1, \qquad \frac{1}{P(t)} = e^{2\beta t} + t\,m(2\beta t), \qquad m(x) = \frac{e^x - 1}{x}, \quad m(0) = 1")
    r.says("For β ≠ 0 this is $P = 2\\beta/((2\\beta + 1)e^{2\\beta t} - 1)$, and $1/(1 + t)$ for β = 0; written with m (the function expm1) both are one formula with two positive terms, and no digit is lost as β passes through 0. The gain is $K = P$. The filter can be written out too: it is least squares for x(0), carried on to t,")
    r.math(r"\hat x(t) = e^{-\beta t}\,\frac{\int_0^t e^{-\beta\tau}z(\tau)\,\mathrm{d}\tau}{1 + \int_0^t e^{-2\beta\tau}\,\mathrm{d}\tau}.")
    found = bucy.transient(system, TIMES)
    r.value("variance_continuous", found.P[:, 0, 0], "m²", at=TIMES, agrees=answer, routes=("Riccati equation, integrated", "closed form"))
    limit, routes = bucy.steady(system), ("algebraic Riccati equation", "closed form")
    r.says("**The limit.** If β ≥ 0 both terms together grow without bound (like $e^{2\\beta t}$, or t for β = 0) and P → 0. If β < 0 the first dies out and the second tends to $1/(2|\\beta|)$: P → 2|β|, since an x that grows carries its error with it. The pole of the filter tends to $-\\beta - P_\\infty = -|\\beta|$: an unstable mode is reflected.")
    r.value("variance_limit", limit.P[0, 0], "m²", agrees=answer, routes=routes)
    r.value("filter_pole", limit.poles[0].real + 0.0, "1/s", agrees=answer, routes=routes)
    settled = bucy.settling_time(system, WITHIN)
    r.value("settling_time", settled, "s", agrees=answer, routes=("search along P(t)", "closed form"),
            reason="" if settled is not None else "the limit is 0, and a variance that decays to 0 never stays within 1 % of it")
    size = abs(p.beta) or 1.0
    betas = sorted({p.beta, 0.0, size, -size}, reverse=True)
    t = np.geomspace(0.01, 100, 161)
    figure = plots.lines(t, {f"β = {b:g} 1/s": bucy.transient(model(p, b), t).P[:, 0, 0] for b in betas}, xlabel=TIME, ylabel="variance P, m²", log="xy",
                         straight={"1/t": (t[100:], 1 / t[100:])}, ylim=(1e-5, 2 * max(1.0, 2 * size)))
    r.figure("variance", figure, "P(t) for the given β, its opposite and 0: exponential decay, 1/t, and a floor at 2|β|.")


def part_b(r, p, answer, sampled):
    """The discrete filter."""
    r.section("b", "The discrete filter of equivalent measurements")
    r.says("The average of v over a period has the variance 1/dt, so a measurement with this noise is worth the continuous one over a period. The signal is carried exactly:")
    r.math(r"x(t_{i+1}) = e^{-\beta\,dt}x(t_i), \qquad z(t_i) = x(t_i) + v_d(t_i), \qquad Q_d = 0, \quad R_d = 1/dt")
    r.model(sampled)
    r.check("Φ", sampled.Phi, [[math.exp(-p.beta * p.dt)]], ("matrix exponential", "by hand"), EXACT)
    r.check("R_d", sampled.R, [[1 / p.dt]], ("model", "by hand"), EXACT)
    r.math(r"\hat x(t_i^-) = e^{-\beta\,dt}\hat x(t_{i-1}^+), \quad P(t_i^-) = P(t_{i-1}^+)/g, \quad g = e^{2\beta\,dt}; \qquad K(t_i) = \frac{P(t_i^-)}{P(t_i^-) + 1/dt} = P(t_i^+)\,dt")
    r.says("**The variance in closed form.** Information is added: $1/P(t_i^+) = g/P(t_{i-1}^+) + dt$ from $1/P(t_0^+) = 1$. Hence")
    r.math(r"\frac{1}{P(t_k^+)} = g^k + dt\,(1 + g + \dots + g^{k-1}) = g^k + dt\,\frac{g^k - 1}{g - 1}")
    r.says("For β = 0 the sum is k and $1/P = 1 + k\\,dt$. For β < 0 it tends to $dt/(1 - g)$, so that $P^+ \\to (1 - g)/dt$, below 2|β|.")
    limit = steady.solve(sampled)
    r.value("posterior_variance_limit", limit.P_plus[0, 0], "m²", agrees=answer, routes=("Riccati equation", "closed form"))
    k = by_hand.last(p.dt)
    if k > LONGEST:
        r.says("The last measurement not later than 1 s has the number {k}. The recursion is not run so far; a power of the matrix of its step takes its place.", k=k)
        at_1s = answer["posterior_variance_at_1s"]
        r.value("posterior_variance_at_1s", at_1s, "m²")
        r.check("P⁺ at 1 s", at_1s, by_hand.sampled_power(p.beta, p.dt, k), ("closed form", "power of the step's matrix"))
    else:
        r.says("The last measurement not later than 1 s has the number {k}, at {t} s.", "" if k else " That is none yet: the variance is still P(0) = 1 m².", k=k, t=k * p.dt)
        shown = covariances(sampled, max(k, 1))
        r.value("posterior_variance_at_1s", shown.P_plus[k, 0, 0], "m²", agrees=answer)


def span(p):
    """The time in which P shows its course, s: four time constants, or ten seconds where 1/(1 + t) decides."""
    return 4 / max(abs(p.beta), 0.4)


def plan(r, p, experiment):
    """Every number chosen; returns the number of measurements, 0 if x grows too much to be simulated."""
    steps = min(max(math.ceil(span(p) / p.dt * (1 - 1e-12)), 5), 400)
    if abs(p.beta) * p.dt * steps > GROWTH:
        steps = int(GROWTH / (abs(p.beta) * p.dt))
        steps = steps if p.beta < 0 else max(steps, 1)
    r.table("plan", ["quantity", "value", "why"], [
        ["period dt, s", p.dt, "given"],
        ["measurements", steps, "four time constants 1/|β|, ten seconds at most; 5 to 400, and no more than x changes by a factor of e^15"],
        ["periods of the limit dt → 0", "T/8, T/16, T/32, T/64", "T = 1 s, or 1/|β| if that is shorter"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["seed", experiment.seed, "another stream of random numbers for the pictures of part (c)"],
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
    r.says("**The sign of the error.** Both amounts of information about x(0) are sums over the past, $\\int_0^t e^{-2\\beta\\tau}\\mathrm{d}\\tau$ and the rectangles $dt\\sum_{j=1}^k e^{-2\\beta j\\,dt}$ with their height taken at the right end. If β > 0 the integrand falls, the rectangles lie under it, the discrete filter knows less and $P^+ > P(t)$. If β < 0 it rises and $P^+ < P(t)$. If β = 0 both are t and the variances are equal for every dt. Expanded in dt at a fixed t:")
    r.math(r"P(t_k^+) - P(t_k) = P^2(t)\,\frac{e^{2\beta t} - 1}{2}\,dt + O(dt^2)")
    between = bucy.transient(system, shown.t).P[:, 0, 0]
    sign = 1 if p.beta >= 0 else -1
    # The exact variances differ relatively by β dt at least, far above the rounding of both routes, unless β dt is nothing.
    r.holds("P⁺ − P(t) has the sign of β", sign * (shown.P_plus[:, 0, 0] - between), ("recursion", "Riccati equation, integrated"), size=max(1.0, float(between.max())))
    T, halves = min(1.0, 1 / abs(p.beta)) if p.beta else 1.0, (8, 16, 32, 64)
    target = float(bucy.transient(system, [T]).P[0, 0, 0])
    errors = [float(covariances(discretise(system, T / n), n).P_plus[-1, 0, 0]) - target for n in halves]
    leading = target**2 * math.expm1(2 * p.beta * T) / 2
    r.table("limit", ["dt, s", "P⁺ − P(T), m²", "leading term, m²"], [(T / n, e, leading * T / n) for n, e in zip(halves, errors, strict=True)],
            "The discrete filter at T = {T} s as the period is halved.", T=T)
    if abs(leading) > 1e-7 * target:
        r.order("order of P⁺ − P(T)", np.abs(errors), 1.0, ("discrete filter", "continuous filter"))
        r.order("order of what the leading term leaves", np.abs([e - leading * T / n for n, e in zip(halves, errors, strict=True)]), 2.0, ("discrete filter", "closed form of the error"))
        agrees = abs(math.log2(errors[-2] / errors[-1]) - 1) < 0.2
    else:
        r.check("P⁺ = P(T), since β is 0 or as good as 0", target + np.array(errors), [target] * 4, ("recursion", "Riccati equation, integrated"), 1e-8)
        agrees = bool(np.abs(errors).max() < SOLVER * target)
    r.value("verdict_c", agrees)
    r.says("The criterion of agreement: the difference is halved with the period, or is 0 for every period. It is met." if agrees else "The difference is not halved with the period: no agreement.")
    fine = covariances(discretise(system, p.dt / 4), 4 * count)
    close, t = np.linspace(0.0, shown.t[min(count, 12)], 201), np.linspace(0.0, shown.t[-1], 401)
    curve = bucy.transient(system, t)
    schedules = {text("dt = {dt} s", dt=p.dt): shown, text("dt = {dt} s", dt=p.dt / 4): fine}
    figure = plots.sampled(schedules, close, bucy.transient(system, close).P[:, 0, 0], ylabel="variance, m²", limit=answer["variance_limit"] or None)
    r.figure("overlay", figure, "The sawtooth of the discrete filter over P(t), for the given period and a quarter of it.")
    if between.all():
        ratios = {name: s.P_plus[:: len(s.t) // count, 0, 0] / between for name, s in schedules.items()}
        r.figure("ratio", plots.lines(shown.t, ratios, xlabel=TIME, ylabel="ratio P⁺/P(t)", marker="."), "The discrete filter's variance as a fraction of the continuous one's: a quarter of the period, about a quarter of the difference.")
    r.figure("gains", plots.gains(t, curve.K, shown, names=["gain K, or K/dt"], units=["1/s"], log="y" if plus[-1] < 0.05 else ""), "The continuous gain, and that of the discrete filter divided by its period.")


def ensemble(r, p, experiment, sampled, steps):
    """The filter on simulated data."""
    if not steps:
        r.says("Within one period x grows by a factor of e^{power}: its rounding would hide the error of the estimate, so nothing is simulated; the covariances above stand.", power=round(-p.beta * p.dt, 1))
        return
    portrait(r, experiment, sampled, steps, xlabel=TIME)
    some = experiment.histories(sampled, steps=steps, runs=5, stream=1)
    estimates = [by_hand.batch(some.z[1:, 0, run], some.t[1:], p.beta, p.dt) for run in range(5)]
    r.check("last estimates of five runs", some.x_plus[-1, 0], estimates, ("recursion", "least squares of all measurements at once"), scale=float(np.abs(estimates).max()) or 1.0)


def conclusions(r, p, answer):
    """What the numbers say."""
    lines = ["One state suffices and α is of no consequence: with w ≡ 0 only the pole and x(0) are left."]
    limit = answer["variance_limit"]
    if p.beta > 0:
        lines.append(text("x dies out by itself and P(t) falls like e^(−2βt), at {rate} 1/s, measured or not; the measurements only add the constant factor 2β/(2β + 1) = {share}. The gain goes to 0 and the filter never settles.", rate=2 * p.beta, share=2 * p.beta / (2 * p.beta + 1)))
    elif p.beta == 0:
        lines.append("x is a constant and the filter its average: P(t) = 1/(1 + t), the gain goes to 0 like 1/t, and the filter never settles. The discrete filter has the same variance at its instants for every period.")
    else:
        lines.append(text("x grows and its error with it; the measurements hold the variance at 2|β| = {limit} m², and the gain stays at {limit} 1/s. P(t) is within 1 % of this from {when} s on; the discrete filter's P⁺ tends to {other} m².", limit=limit, when=answer["settling_time"], other=answer["posterior_variance_limit"]))
    if p.beta:
        k = by_hand.last(p.dt)
        ratio = answer["posterior_variance_at_1s"] / by_hand.variance(p.beta, k * p.dt) if by_hand.variance(p.beta, k * p.dt) else 1.0
        lines.append(text("At {t} s the discrete filter's P⁺ is {ratio} times P(t); the difference tends to 0 like dt, from {side}.", t=k * p.dt, ratio=ratio, side="above (β > 0)" if p.beta > 0 else "below (β < 0)"))
    lines.append(largest(r))
    r.items(lines)


PARTS = Skeleton(
    analysis=(part_a, part_b),
    plan=plan,
    experiment=(part_c, ensemble),
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
