r"""Lab 1. A position that is a random constant plus Brownian motion.

Source: Semushin & Tsyganova 2001, task 1. x(t) = x0 + β(t), measured at t1, t2, … with independent errors of variance
R(t_i). The sheet asks for the filter and for an experiment on what governs the quality of its estimates (bias, accuracy,
time to settle): (a) the diffusion σ_w², (b) the measurement variance R, (c) their ratio, (d) a single anomalous
measurement in the steady state, with R(t*) → ∞ or R(t*) = 0.

Expected answer: with ρ = σ_w²τ/R the steady gain is K̄ = [−ρ + √(ρ² + 4ρ)]/2 and P̄⁺ = K̄R: everything but the scale
depends on ρ alone. Each step multiplies an old error by 1 − K̄. The filter drops a measurement with R = ∞ by itself and
takes one with R = 0 as the state.
"""

import math
from dataclasses import replace
from functools import partial

import numpy as np
from ctlabs.tasks.answers import task01 as by_hand
from ctlabs.tasks.answers.task01 import AFTER

from ctlabs.analysis import sensitivity
from ctlabs.filtering import settling, settling_step, steady
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import agreement, largest, portrait
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import ContinuousModel
from ctlabs.models.discretisation import discretise
from ctlabs.reporting import plots
from ctlabs.reporting.params import Count, LabParameters, Positive, Real, Variance, VarianceOrVariances, given
from ctlabs.reporting.report import EXACT, Report
from ctlabs.text import text

META = {
    "name": "task01",
    "title": "Random constant plus Brownian motion",
    "source": "Semushin & Tsyganova 2001, task 1",
    "parts": ["a", "b", "c", "d"],
}

STEP = "measurement number i"
FACTORS = (0.01, 0.1, 1.0, 10.0, 100.0)


class Parameters(LabParameters):
    """What may be changed."""

    sigma_w2: Variance = given(1.0, unit="m²/s", meaning="diffusion σ_w² of the Brownian motion")
    tau: Positive = given(1.0, unit="s", meaning="period of the measurements")
    R: VarianceOrVariances = given(1.0, unit="m²", meaning="variance of the measurement error, or a list over the measurements")
    x0_mean: Real = given(0.0, unit="m", meaning="mean of x(t0)")
    P0: Variance = given(10.0, unit="m²", meaning="variance of x(t0)")
    steps: Count = given(10, unit="1", meaning="number of measurements (a list R sets it)")


def model(p, R, sigma_w2=None):
    """The sampled system with a constant variance R, or one for each measurement (t0 has none)."""
    stacked = np.array([math.inf, *R])[:, None, None] if np.ndim(R) else [[R]]
    return discretise(continuous(p, sigma_w2), p.tau, stacked)


def continuous(p, sigma_w2=None):
    """ẋ = w: the constant is the initial state, the Brownian motion its increments."""
    return ContinuousModel(F=[[0]], G=[[1]], Q=[[p.sigma_w2 if sigma_w2 is None else sigma_w2]], H=[[1]], x0=[p.x0_mean], P0=[[p.P0]],
                           states=["x"], units=["m"])


def analysis(r, p, answer, R):
    """Model, filter and closed forms."""
    r.section("a", "Model and filter")
    r.says("The constant $x_0$ and the Brownian motion are one state: $\\dot{x} = w$ with $x(t_0) = x_0$. Over one period the increments add $Q_d = \\sigma_w^2\\tau$ to the variance (σ_w² is a diffusion, m²/s, not a variance):")
    r.math(r"F = 0, \quad G = 1, \quad Q = \sigma_w^2, \quad \Phi = 1, \quad Q_d = \sigma_w^2\tau, \quad H = 1")
    r.model(model(p, R))
    r.math(r"\hat x(t_i^-) = \hat x(t_{i-1}^+), \qquad P(t_i^-) = P(t_{i-1}^+) + Q_d")
    r.math(r"K(t_i) = \frac{P(t_i^-)}{P(t_i^-) + R(t_i)}, \qquad \hat x(t_i^+) = \hat x(t_i^-) + K(t_i)[z(t_i) - \hat x(t_i^-)], \qquad P(t_i^+) = [1 - K(t_i)]P(t_i^-)")
    r.says("The position itself never becomes stationary (its variance grows by $Q_d$ each period); its estimation error does.")
    at = [i * p.tau for i in range(1, len(by_hand.variances(p)) + 1)]
    system = model(p, by_hand.variances(p))
    schedule = covariances(system, len(at))
    routes = ("recursion", "joint conditioning")
    r.value("prior_variance", schedule.P_minus[1:, 0, 0], "m²", at=at, agrees=answer, routes=routes)
    r.value("posterior_variance", schedule.P_plus[1:, 0, 0], "m²", at=at, agrees=answer, routes=routes)
    r.value("gain", schedule.K[1:, 0, 0], "1", at=at, agrees=answer, routes=routes)
    wrong = sensitivity.actual(replace(system, x0=[p.x0_mean + 1.0]), system, len(at))
    r.value("bias_factor", -wrong.bias_plus[1:, 0], "1", at=at, agrees=answer, routes=("joint recursion of the means", "product of 1 − K"))
    r.says("A wrong initial mean leaves the bias $b_i = b_0\\prod_{j \\le i}(1 - K(t_j))$: after {n} measurements {left} of it is left.", n=len(at), left=answer["bias_factor"][-1])

    r.section("c", "The steady state depends on one ratio")
    r.says("With $\\rho = \\sigma_w^2\\tau/R$ the steady variances and gain are")
    r.math(r"\bar P^\mp = \tfrac12\left[\pm Q_d + \sqrt{Q_d^2 + 4Q_dR}\,\right], \qquad \bar K = \tfrac12\left[-\rho + \sqrt{\rho^2 + 4\rho}\,\right], \qquad \frac{\bar P^+}{R} = \bar K")
    limited = math.isfinite(R)
    reason = "" if limited else "the last measurement is absent (R = ∞): the variance grows without limit"
    limit = steady.solve(model(p, R)) if limited else None
    routes = ("Riccati equation", "closed form")
    r.value("prior_variance_steady", None if limit is None else limit.P_minus[0, 0], "m²", reason=reason, agrees=answer, routes=routes)
    r.value("posterior_variance_steady", None if limit is None else limit.P_plus[0, 0], "m²", reason=reason, agrees=answer, routes=routes)
    r.value("gain_steady", None if limit is None else limit.K[0, 0], "1", reason=reason, agrees=answer, routes=routes)
    settled = settling(model(p, R)) if limited else None
    listed = settled if np.ndim(p.R) == 0 or not limited else settled_after(p, R)
    if listed is not None:
        r.check("settling step", listed, answer["settling_step"], ("recursion", "information form"), EXACT)
    r.value("settling_step", answer["settling_step"] if listed is None else listed, "1",
            reason=reason or "the limit is 0, and a variance that decays to 0 never stays within 1 % of it")
    if limited:
        r.says("Here $\\rho = {ratio}$: the gain tends to {gain}, the error variance to {after} m² after and {before} m² before an update, and every step multiplies an old error by {factor}.",
               ratio=p.sigma_w2 * p.tau / R if R else math.inf, gain=limit.K[0, 0], after=limit.P_plus[0, 0], before=limit.P_minus[0, 0], factor=1 - limit.K[0, 0])


def settled_after(p, R):
    """Settling of a filter whose measurement variances are listed and then stay at the last one."""
    limit = np.diag(steady.solve(model(p, R)).P_plus)
    after = covariances(model(p, p.R), len(p.R)).P_plus[-1]
    horizon = len(p.R) + 64 + (settling(replace(model(p, R), P0=after)) or 0)
    padded = [*p.R, *[R] * (horizon - len(p.R))]
    found = settling_step(covariances(model(p, padded), horizon).P_plus[:, :, 0], limit)
    return None if found is None else max(found, 1)


def plan(r, experiment):
    """Every number chosen."""
    steps = 40
    r.table("plan", ["quantity", "value", "why"], [
        ["measurements in a run", steps, "several settling times of the given parameters"],
        ["factors of (a), (b), (c)", list(FACTORS), "two decades to each side of the given value"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["seed", experiment.seed, "the same for every filter"],
        ["steps after the anomaly", AFTER, "enough to see the recovery"],
    ], "Plan of the experiment.")
    return {"steps": steps}


def sweep(r, build, experiment, steps, part, title, name, cases):
    """Bias, accuracy and settling for several values of one factor, theory beside the ensemble."""
    r.section(part, title)
    rows, curves, symbol = [], {}, text(name).split(",")[0]
    for shown, sigma_w2, R in cases:
        if not math.isfinite(R):
            continue
        system = build(R, sigma_w2)
        schedule, limit = covariances(system, steps), steady.solve(system)
        stats = experiment.statistics(system, steps=steps)
        worst = agreement(r, f"{symbol} = {shown:g}", stats, schedule.P_plus)
        left = float(np.prod(1 - schedule.K[1:11, 0, 0]))
        rows.append((shown, limit.K[0, 0], math.sqrt(limit.P_plus[0, 0]), stats.rms[-1, 0], left, settling(system), worst))
        curves[f"{symbol} = {shown:g}"] = schedule.sd_plus[:, 0]
    r.table(f"sweep_{part}", [name, "K̄", "steady σ, m", "RMS of the ensemble, m", "share of an initial bias left after 10 measurements", "settling step", "largest deviation, σ"], rows,
            "Quality of the estimates: accuracy, bias and settling.")
    if curves:
        figure = plots.lines(range(steps + 1), curves, xlabel=STEP, ylabel="σ of the error after an update, m", ordered=True, log="y" if all(c.min() > 0 for c in curves.values()) else "", steps=True)
        r.figure(f"sweep_{part}", figure, "Standard deviation of the error along the measurements.")


def part_a(r, p, build, experiment, steps, R):
    """The diffusion."""
    sweep(r, build, experiment, steps, "a", "Influence of the diffusion", "diffusion σ_w², m²/s",
          [(p.sigma_w2 * f, p.sigma_w2 * f, R) for f in FACTORS])


def part_b(r, p, build, experiment, steps, R):
    """The measurements."""
    sweep(r, build, experiment, steps, "b", "Influence of the measurement variance", "variance R, m²",
          [(R * f, p.sigma_w2, R * f) for f in FACTORS])


def part_c(r, p, build, experiment, steps):
    """The ratio alone counts."""
    r.section("c", "Influence of the ratio σ_w²τ/R")
    rows, curves = [], {}
    for ratio in FACTORS:
        R = p.sigma_w2 * p.tau / ratio or 1.0
        Qd = ratio * R
        limit = steady.solve(build(R, Qd / p.tau))
        other = steady.solve(build(7 * R, 7 * Qd / p.tau))
        r.check(text("K̄ at ρ = {ratio}, σ_w² and R seven times larger", ratio=ratio), other.K[0, 0], limit.K[0, 0], ("scaled system", "system"))
        r.check(text("K̄ at ρ = {ratio}", ratio=ratio), limit.K[0, 0], by_hand.gain_by_ratio(Qd, R), ("Riccati equation", "closed form"))
        rows.append((ratio, limit.K[0, 0], limit.P_plus[0, 0] / R, 1 - limit.K[0, 0], settling(build(R, Qd / p.tau))))
    r.table("ratio", ["ρ", "K̄", "P̄⁺/R", "multiplier 1 − K̄", "settling step"], rows, "The gain and the relative variance depend on ρ alone; the settling step also on P0.")
    ratios = np.logspace(-3, 3, 121)
    curves = {"K̄ = P̄⁺/R": [by_hand.gain_by_ratio(x, 1.0) for x in ratios], "error multiplier 1 − K̄": [1 - by_hand.gain_by_ratio(x, 1.0) for x in ratios]}
    figure = plots.lines(ratios, curves, xlabel="ratio $\\rho = \\sigma_w^2\\tau/R$", ylabel="steady gain, multiplier (ratio)", log="x",
                         points={"table": (FACTORS, [row[1] for row in rows])}, ylim=(0.0, 1.02))
    r.figure("ratio", figure, "The steady gain: below ρ ≈ 0.1 the filter averages many measurements, above ρ ≈ 10 it follows the last one.")
    R = by_hand.variances(p)[-1]
    if math.isfinite(R) and R > 0:
        limit = steady.solve(build(R))
        portrait(r, experiment, build(R), steps, limits=(limit.P_minus[0, 0], limit.P_plus[0, 0]))


def part_d(r, p, build, answer, experiment, R):
    """One anomalous measurement in the steady state."""
    r.section("d", "One anomalous measurement in the steady state")
    r.says("At $t_*$ a measurement with $R \\to \\infty$ has $K = 0$: the prediction passes unchanged. One with $R = 0$ has $K = 1$: the estimate becomes the measurement and the error zero. Then the ordinary measurements bring the variance back to its limit, from above or from below.")
    reason = "without a last finite R there is no steady state"
    if answer["gain_steady"] is None:
        r.value("posterior_variance_missing", None, "m²", reason=reason, agrees=answer, routes=("recursion", "information form"))
        r.value("posterior_variance_perfect", None, "m²", reason=reason, agrees=answer, routes=("recursion", "information form"))
        return
    limit = steady.solve(build(R))
    settled = 6
    curves, ensembles = {}, {}
    x = range(-settled - 1, AFTER + 1)
    for name, what, anomaly in (("missing", "missing (R = ∞)", math.inf), ("perfect", "perfect (R = 0)", 0.0)):
        listed = [R] * settled + [anomaly] + [R] * AFTER
        system = replace(build(listed), P0=limit.P_plus)
        schedule = covariances(system, len(listed))
        after = schedule.P_plus[settled + 1 :, 0, 0]
        at = [k * p.tau for k in range(AFTER + 1)]
        r.value(f"posterior_variance_{name}", after, "m²", at=at, agrees=answer, routes=("recursion", "information form"))
        stats = experiment.statistics(system, steps=len(listed), stream=1)
        agreement(r, what, stats, schedule.P_plus)
        curves[what] = schedule.P_plus[:, 0, 0]
        ensembles["_" * len(ensembles) + "ensembles"] = (x, stats.rms[:, 0] ** 2)
    r.check("a missing measurement leaves the prediction unchanged", curves["missing (R = ∞)"][settled + 1], limit.P_minus[0, 0], ("recursion", "Riccati equation"))
    straight = {"limit P̄⁺": ([x[0], x[-1]], [limit.P_plus[0, 0]] * 2)}
    figure = plots.lines(x, curves, xlabel="measurement number after t*", ylabel="error variance after the update, m²", straight=straight, points=ensembles, steps=True)
    r.figure("anomaly", figure, "One missing and one perfect measurement in the steady state, and the recovery; the ensemble beside the theory.")
    ratio = (1 - answer["gain_steady"]) ** 2
    r.says("Near the limit the deviation shrinks by $(1-\\bar{K})^2 = {ratio}$ per measurement, whichever its cause.", ratio=ratio)


def conclusions(r, p, answer, R):
    """What the numbers say."""
    lines = []
    gain = answer["gain_steady"]
    if gain is None:
        lines.append("The last measurement is absent for ever: the error variance grows without limit, like the Brownian motion.")
    elif gain == 0:
        lines.append("Without diffusion the state is a constant: the gain tends to 0 like 1/i and every measurement counts equally. The error variance tends to 0 and never settles.")
    elif R == 0:
        lines.append("Measurements without error make the gain 1: the estimate is the last measurement, its error zero until the next increment of the Brownian motion.")
    else:
        lines.append(text("At ρ = {ratio} the gain is {gain}: an estimate weighs about {memory} measurements. Larger σ_w² or smaller R raise the gain: the filter then forgets faster, settles sooner and is less accurate relative to R.",
                          ratio=p.sigma_w2 * p.tau / R, gain=gain, memory=round(1 / gain, 2)))
        lines.append(text("A missing measurement raises the variance from {limit} to {missing} m², a perfect one lowers it to 0; {steps} measurements later they are at {later} and {perfect} m².",
                          limit=answer["posterior_variance_steady"], missing=answer["posterior_variance_missing"][0], steps=AFTER,
                          later=answer["posterior_variance_missing"][-1], perfect=answer["posterior_variance_perfect"][-1]))
    if gain and R:
        lines.append("Only the ratio σ_w²τ/R shapes the filter; the scale of the variances is R.")
    lines.append(largest(r))
    r.items(lines)


PARTS = Skeleton(analysis=(analysis,), plan=plan, experiment=(part_a, part_b, part_c, part_d), conclusions=conclusions)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    return PARTS.report(META, p, experiment, answer=by_hand.analytic(p), R=by_hand.variances(p)[-1], build=partial(model, p))


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
