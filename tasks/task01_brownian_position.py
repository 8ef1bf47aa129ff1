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
from ctlabs.tasks._task01_words import answers, conclusions, discussion, result
from ctlabs.tasks.answers import task01 as by_hand
from ctlabs.tasks.answers.task01 import AFTER

from ctlabs.analysis import sensitivity
from ctlabs.filtering import settling, settling_step, steady
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import agreement, portrait, rms
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import ContinuousModel
from ctlabs.models.discretisation import discretise
from ctlabs.montecarlo import chance
from ctlabs.reporting import plots
from ctlabs.reporting.draws import one_of, span
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
#: Measurements in a run, and by what factor every third one is worse where R is to vary.
STEPS, WORSE = 40, 10
FACTORS = (0.01, 0.1, 1.0, 10.0, 100.0)


class Parameters(LabParameters):
    """What may be changed."""

    sigma_w2: Variance = given(1.0, unit="m²/s", meaning="diffusion of the Brownian motion", draw=span(0.2, 3, 0.1))
    tau: Positive = given(1.0, unit="s", meaning="period of the measurements", draw=one_of(0.5, 1, 2))
    R: VarianceOrVariances = given(1.0, unit="m²", meaning="variance of the measurement error, or a list over the measurements", draw=span(0.2, 4, 0.2))
    x0_mean: Real = given(0.0, unit="m", meaning="mean of x(t0)", symbol=r"\bar x_0")
    P0: Variance = given(10.0, unit="m²", meaning="variance of x(t0)", draw=one_of(5, 8, 10, 12, 15, 20, 25))
    steps: Count = given(10, unit="1", meaning="number of measurements (a list R sets it)", symbol="N")


def model(p, R, sigma_w2=None):
    """The sampled system with a constant variance R, or one for each measurement (t0 has none)."""
    stacked = np.array([math.inf, *R])[:, None, None] if np.ndim(R) else [[R]]
    return discretise(continuous(p, sigma_w2), p.tau, stacked)


def continuous(p, sigma_w2=None):
    """ẋ = w: the constant is the initial state, the Brownian motion its increments."""
    return ContinuousModel(F=[[0]], G=[[1]], Q=[[p.sigma_w2 if sigma_w2 is None else sigma_w2]], H=[[1]], x0=[p.x0_mean], P0=[[p.P0]],
                           states=["x"], units=["m"])


def analysis(r, p, answer, R):
    """Model and filter."""
    r.part = "a"
    r.subsection("Model and filter", "model")
    r.says("**Model.** The constant $x_0$ and the Brownian motion are one state: $\\dot{x} = w$ with $x(t_0) = x_0$. Over one period the increments add $Q_d = \\sigma_w^2\\tau$ to the variance, for the variance of a sum of independent increments is the sum of theirs; $\\sigma_w^2$ is a diffusion in m²/s and not a variance {ref:maybeck, section 4.9}. In the letters of the general model")
    r.math(r"F = 0, \quad G = 1, \quad Q = \sigma_w^2, \quad \Phi = 1, \quad Q_d = \sigma_w^2\tau, \quad H = 1")
    r.model(model(p, R))
    last_of_list(r, p)
    r.says("**Filter.** From $\\hat{x}(t_0^+) = \\bar x_0$ and $P(t_0^+) = P_0$ {ref:maybeck, section 5.3},")
    r.math(r"\hat x(t_i^-) = \hat x(t_{i-1}^+), \qquad P(t_i^-) = P(t_{i-1}^+) + Q_d", "prediction")
    r.math(r"K(t_i) = \frac{P(t_i^-)}{P(t_i^-) + R(t_i)}, \qquad \hat x(t_i^+) = \hat x(t_i^-) + K(t_i)[z(t_i) - \hat x(t_i^-)], \qquad P(t_i^+) = [1 - K(t_i)]P(t_i^-)", "update")
    at = [i * p.tau for i in range(1, len(by_hand.variances(p)) + 1)]
    system = model(p, by_hand.variances(p))
    schedule = covariances(system, len(at))
    routes = ("recursion", "joint conditioning")
    r.value("prior_variance", schedule.P_minus[1:, 0, 0], "m²", at=at, agrees=answer, routes=routes)
    r.value("posterior_variance", schedule.P_plus[1:, 0, 0], "m²", at=at, agrees=answer, routes=routes)
    r.value("gain", schedule.K[1:, 0, 0], "1", at=at, agrees=answer, routes=routes)
    wrong = sensitivity.actual(replace(system, x0=[p.x0_mean + 1.0]), system, len(at))
    r.value("bias_factor", -wrong.bias_plus[1:, 0], "1", at=at, agrees=answer, routes=("joint recursion of the means", "product of 1 − K"))
    r.subsection("Bias", "bias")
    r.says("The error $e = \\hat x - x$ obeys $e(t_i^+) = [1 - K(t_i)][e(t_{i-1}^+) - w_d(t_{i-1})] + K(t_i)v(t_i)$, in which both noises have the mean zero. If the filter starts at the right mean its estimates are therefore unbiased at every instant. If it starts at a mean that is wrong by $b_0$ the bias is")
    r.math(r"b_i = b_0\prod_{j \le i}[1 - K(t_j)],", "bias")
    r.says("so that after {n} measurements the share {left:3} of it is left.", n=len(at), left=answer["bias_factor"][-1])
    steady_state(r, p, answer, R)


def last_of_list(r, p):
    """Where R is a list, a sentence on which of its elements stands for it."""
    if np.ndim(p.R):
        r.says("Of the listed variances the last one, {R} m², is shown. It is the R of the steady state and of every experiment that does not name another; the variances and gains along the measurements are those of the whole list.", R=by_hand.variances(p)[-1])


def steady_state(r, p, answer, R):
    """Closed forms of the limit, and when it is reached."""
    r.part = "c"
    r.subsection("Steady state and settling", "steady")
    r.says("The position itself never becomes stationary where $\\sigma_w^2 > 0$, for its variance grows by $Q_d$ each period; its estimation error does, in the wide sense. With $P(t_i^+) = P(t_{i-1}^+) = \\bar P^+$ the equations of the filter become a quadratic, and with $\\rho = \\sigma_w^2\\tau/R$")
    r.math(r"\bar P^\mp = \tfrac12\left[\pm Q_d + \sqrt{Q_d^2 + 4Q_dR}\,\right], \qquad \bar K = \tfrac12\left[-\rho + \sqrt{\rho^2 + 4\rho}\,\right], \qquad \frac{\bar P^+}{R} = \bar K", "steady")
    r.says("Everything but the scale depends on ρ alone. That the filter tends to this limit from any $P_0$ is a theorem {ref:anderson_moore, section 4.4}. **Settling** is defined here by one per cent: the error is called stationary from the first measurement after which $P(t_i^+)$ stays within 1 % of $\\bar P^+$. That depends on $P_0$ as well as on ρ.")
    limited = math.isfinite(R)
    reason = "" if limited else "the last measurement is absent (R = ∞): the variance grows without limit"
    limit = steady.solve(model(p, R)) if limited else None
    routes = ("Riccati equation", "closed form")
    r.value("prior_variance_steady", None if limit is None else limit.P_minus[0, 0], "m²", symbol=r"\bar P^-", reason=reason, agrees=answer, routes=routes)
    r.value("posterior_variance_steady", None if limit is None else limit.P_plus[0, 0], "m²", symbol=r"\bar P^+", reason=reason, agrees=answer, routes=routes)
    r.value("gain_steady", None if limit is None else limit.K[0, 0], "1", symbol=r"\bar K", reason=reason, agrees=answer, routes=routes)
    settled = settling(model(p, R)) if limited else None
    listed = settled if np.ndim(p.R) == 0 or not limited else settled_after(p, R)
    if listed is not None:
        r.check("settling step", listed, answer["settling_step"], ("recursion", "information form"), EXACT)
    r.value("settling_step", answer["settling_step"] if listed is None else listed, "1",
            reason=reason or "the limit is 0, and a variance that decays to 0 never stays within 1 % of it")
    if not limited:
        r.says("Here the last measurement is absent, and it is taken to be absent for ever: there is no steady state, and the variance grows by $Q_d$ each period.")
    elif limit.K[0, 0] == 0:
        r.says("Here $\\sigma_w^2 = 0$: the state is a constant, the limit is $\\bar P^\\mp = 0$ with $\\bar K = 0$. It is approached like $R/i$, so that the variance never stays within one per cent of it: nothing settles.")
    else:
        r.says("Here $\\rho = {ratio}$: the gain tends to {gain}, the error variance to {after} m² after and {before} m² before an update, and every step multiplies an old error by $1 - \\bar K = {factor}$.",
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
    r.says("{tab:plan} lists what was chosen. One factor is changed at a time. The quality of the estimates is their bias, their accuracy (the RMS error) and the time until the error is stationary, as defined above.")
    r.table("plan", ["quantity", "value", "why"], [
        ["measurements in a run", STEPS, "several settling times of the given parameters, where these settle; the lists of the theory have as many as are given"],
        ["factors of (a), (b), (c)", "0.01, 0.1, 1, 10, 100", "two decades to each side of the given value"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["seed", experiment.seed, "the same for every filter"],
        ["measurements after the anomaly", AFTER, "enough to see the recovery"],
    ], "Plan of the experiment.")
    return {"steps": STEPS}


def sweep(r, build, experiment, steps, part, name, symbol, cases, *, drawn=True):
    """Bias, accuracy and settling for several values of one factor, theory beside the ensemble."""
    rows, curves, unit = [], {}, text(name).split(", ")[1]
    for shown, sigma_w2, R in cases:
        if not math.isfinite(R):
            continue
        system = build(R, sigma_w2)
        schedule, limit = covariances(system, steps), steady.solve(system)
        stats = experiment.statistics(system, steps=steps)
        agreement(r, f"{text(name).split(',')[0]} = {shown:g}", stats, schedule.P_plus)
        left = float(np.prod(1 - schedule.K[1:11, 0, 0]))
        sd = schedule.sd_plus[-1, 0]
        rows.append((shown, limit.K[0, 0], math.sqrt(limit.P_plus[0, 0]), sd, rms(stats) if sd else 0.0, left, settling(system) or "—"))
        curves[f"${symbol} = {shown:g}$ {unit}"] = schedule.sd_plus[:, 0]
    r.table(f"sweep_{part}", [f"${symbol}$, {unit}", "K̄", "steady σ, m", "σ at the end, m", "RMS at the end, m", "bias left after 10", "settles at"], rows,
            "Quality of the estimates, by theory and by the ensemble at the last of {steps} measurements; the share of an initial bias that is left after ten; and the measurement at which the error has settled to 1 %.", steps=steps)
    if drawn and len(curves) > 1:
        figure = plots.lines(range(steps + 1), curves, xlabel=STEP, ylabel="σ of the error after an update, m", log="y" if all(c.min() > 0 for c in curves.values()) else "", steps=True)
        r.figure(f"sweep_{part}", figure, "Standard deviation of the error along the measurements. Each curve comes from the same $P_0$ and ends on its own level.")
    return len(curves)


def part_a(r, p, build, experiment, steps, R):
    """The diffusion."""
    r.section("a", "Influence of the diffusion")
    diffusions(r, p, build, experiment, steps, R)
    found = portrayed(r, build, experiment, steps, R)
    if found["sd"] is not None:
        wrong_mean(r, p, build, experiment, steps, R)
    return found


def diffusions(r, p, build, experiment, steps, R):
    """The sweep over the diffusion, and what one sees in it."""
    factors = FACTORS if p.sigma_w2 else (1.0,)
    drawn = sweep(r, build, experiment, steps, "a", "diffusion σ_w², m²/s", r"\sigma_w^2", [(p.sigma_w2 * f, p.sigma_w2 * f, R) for f in factors])
    if drawn > 1 and R == 0:
        r.says("{fig:sweep_a} and {tab:sweep_a}: measurements without error leave σ = 0 after each of them, whatever the diffusion.")
    elif drawn > 1:
        r.says("{fig:sweep_a} and {tab:sweep_a}: all curves begin at $\\sqrt{P_0}$. A small diffusion lets the filter average many measurements: σ ends low, after a long transient. With a large one it ends high, near $\\sqrt R$, and soon. The larger the diffusion, the faster an initial bias is forgotten.")
    elif drawn:
        r.says("No diffusion is given, and no factor changes that: {tab:sweep_a} has one row.")


def portrayed(r, build, experiment, steps, R):
    """The ensemble of the given system."""
    if not (math.isfinite(R) and R > 0):
        r.says("The last of the variances of measurement is {R} m², and no ensemble of the given system is shown.", R=R)
        return {"measured": None, "sd": None}
    limit = steady.solve(build(R))
    stats = portrait(r, experiment, build(R), steps, limits=(limit.P_minus[0, 0], limit.P_plus[0, 0]), figures={
        "ensemble": "The points scatter about theory; about one in twenty is expected outside the bands."})
    schedule = covariances(build(R), steps)
    sd, far = float(schedule.sd_plus[-1, 0]), abs(chance.bias(stats, schedule.P_plus).value)
    r.says("{fig:ensemble} shows the given system. The mean error scatters about zero, as that of an unbiased filter must; its farthest point is {far:3} standard errors away, and {app:chance} judges it among all instants. The RMS error at the last measurement is {measured}, in theory {sd:4} m.",
           far=far, measured=rms(stats, unit="m"), sd=sd)
    return {"measured": rms(stats, unit="m"), "sd": sd}


def wrong_mean(r, p, build, experiment, steps, R):
    """A filter that starts at a wrong mean."""
    start = 3 * math.sqrt(p.P0) or 3 * math.sqrt(R)
    believed = build(R)
    truth = replace(believed, x0=believed.x0 + start)
    actual, wrong = sensitivity.actual(truth, believed, steps), experiment.statistics(truth, believed, steps=steps, stream=2)
    agreement(r, "wrong initial mean", wrong, actual.P_plus, actual.bias_plus, consistent=False)
    i = np.arange(min(steps, 15) + 1)
    figure = plots.lines(i, {"theory": -actual.bias_plus[i, 0]}, xlabel=STEP, ylabel="bias, truth − estimate, m", points={"ensemble": (i, -wrong.bias[i, 0])}, steps=True, marker=".")
    r.figure("bias", figure, "Bias of a filter whose initial mean is wrong by {start:3} m: theory and the mean of the ensemble.", start=start)
    r.says("**A wrong initial mean.** In {fig:bias} the filter starts {start:3} m too low. ", ("Its P does not know of that, and its gain is 0 from the start: the bias stays." if p.P0 == 0 and p.sigma_w2 == 0 else
           "The bias falls by the factor $1 - K(t_i)$ at each measurement, as in {eq:bias}: at first by large steps, because P is large, later by the factor of the steady gain." if p.sigma_w2 else
           "The bias falls by the factor $1 - K(t_i)$ at each measurement, as in {eq:bias}: at first by large steps, because P is large, later by ever smaller ones, as the gain tends to 0."), start=start)


def part_b(r, p, build, experiment, steps, R):
    """The measurements."""
    r.section("b", "Influence of the measurement variance")
    drawn = sweep(r, build, experiment, steps, "b", "variance R, m²", "R", [(R * f, p.sigma_w2, R * f) for f in (FACTORS if R else (1.0,))])
    if drawn > 1:
        r.says("Here R is varied and the diffusion kept. In {fig:sweep_b} a larger R raises the whole curve: after one measurement σ is near $\\sqrt R$ where that is small beside $\\sqrt{P_0}$, and where it is not, the measurement hardly counts. {tab:sweep_b} has the numbers.", (" The settling step depends on more than ρ: where $P_0$ happens to be near the limit the error settles early." if p.sigma_w2 else " As the limits are 0, nothing settles."))
    if R or np.ndim(p.R):
        varying(r, p, build, experiment, R)


def varying(r, p, build, experiment, R):
    """A variance that changes from one measurement to the next."""
    listed = list(p.R) if np.ndim(p.R) else [R, R, WORSE * R] * 8
    system = build(listed)
    stats, schedule = experiment.statistics(system, steps=len(listed), stream=3), covariances(system, len(listed))
    agreement(r, "varying variance", stats, schedule.P_plus)
    i = np.arange(1, len(listed) + 1)
    variances = schedule.P_plus[1:, 0, 0]
    figure = plots.lines(i, {"theory": variances}, xlabel=STEP, ylabel="error variance after an update, m²", steps=True, marker=".", points={"ensemble": (i, stats.rms[1:, 0] ** 2)})
    r.figure("varying", figure, "Error variance where R(t_i) is not constant: theory and ensemble.")
    r.says("**A variance that changes.** The equations hold for any known sequence $R(t_i)$. ", ("{fig:varying} shows the given list." if np.ndim(p.R) else
           "In {fig:varying} every third measurement has {worse} times the variance R of the others. The filter knows it and gives that measurement a small gain; the variance rises there, and the next good measurement brings it down."), worse=WORSE)


def part_c(r, p, build):
    """The ratio alone counts."""
    r.section("c", "Influence of the ratio of both")
    rows = []
    for ratio in FACTORS:
        R = p.sigma_w2 * p.tau / ratio or 1.0
        Qd = ratio * R
        limit = steady.solve(build(R, Qd / p.tau))
        other = steady.solve(build(7 * R, 7 * Qd / p.tau))
        r.check(text("K̄ at ρ = {ratio}, σ_w² and R seven times larger", ratio=ratio), other.K[0, 0], limit.K[0, 0], ("scaled system", "system"))
        r.check(text("K̄ at ρ = {ratio}", ratio=ratio), limit.K[0, 0], by_hand.gain_by_ratio(Qd, R), ("Riccati equation", "closed form"))
        rows.append((ratio, limit.K[0, 0], limit.P_plus[0, 0] / R, 1 - limit.K[0, 0], settling(build(R, Qd / p.tau))))
    r.table("ratio", ["ρ", "K̄", "P̄⁺/R", "multiplier 1 − K̄", "settles at"], rows, "The gain and the relative variance depend on ρ alone; the settling step on $P_0$ too.")
    ratios = np.logspace(-3, 3, 121)
    curves = {"$\\bar K = \\bar P^+/R$": [by_hand.gain_by_ratio(x, 1.0) for x in ratios], "error multiplier $1 - \\bar K$": [1 - by_hand.gain_by_ratio(x, 1.0) for x in ratios]}
    figure = plots.lines(ratios, curves, xlabel="ratio $\\rho = \\sigma_w^2\\tau/R$", ylabel="steady gain, multiplier (ratio)", log="x",
                         points={"table": (FACTORS, [row[1] for row in rows])}, ylim=(0.0, 1.02))
    r.figure("ratio", figure, "The steady gain and what is left of an old error at each step. Below ρ ≈ 0.1 the filter averages many measurements, above ρ ≈ 10 it follows the last one.")
    r.says("{fig:ratio} and {tab:ratio}: the gain rises from $\\sqrt\\rho$ at small ρ to 1. The curves cross at $\\bar K = \\tfrac12$, ρ = ½, where prediction and measurement have equal weights. A system with both variances seven times larger has the same gain; this was computed for every row of the table.")


def part_d(r, p, build, answer, experiment, R):
    """One anomalous measurement in the steady state."""
    r.section("d", "One anomalous measurement in the steady state")
    r.says("At $t_*$ a measurement with $R \\to \\infty$ has $K = 0$: the prediction passes unchanged. One with $R = 0$ has $K = 1$ wherever $P(t_*^-) > 0$: the estimate becomes the measurement and its error zero. Then the ordinary measurements bring the variance back to its limit, from above or from below.")
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
    if not limit.P_minus[0, 0]:
        r.says("Here the steady state is $\\bar P^\\mp = 0$: nothing is left to be learnt, and an anomaly changes nothing.")
        return
    straight = {"limit $\\bar P^+$": ([x[0], x[-1]], [limit.P_plus[0, 0]] * 2)}
    figure = plots.lines(x, curves, xlabel="measurement number after $t_*$", ylabel="error variance after the update, m²", straight=straight, points=ensembles, steps=True, marker=".")
    r.figure("anomaly", figure, "One missing and one perfect measurement in the steady state, and the recovery; the ensembles (black) beside the theory.")
    r.says("In {fig:anomaly} the variance after a missing measurement is that of the prediction. What a perfect one gives is soon lost, because the diffusion makes the state unknown again. Near the limit the deviation shrinks by $(1-\\bar{K})^2 = {ratio:3}$ per measurement, whatever has caused it.", ratio=(1 - answer["gain_steady"]) ** 2)


PARTS = Skeleton(
    result=result,
    key="ratio",
    analysis=(analysis,),
    plan=plan,
    experiment=(part_a, part_b, part_c, part_d),
    discussion=discussion,
    answers=answers,
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    return PARTS.report(META, p, experiment, answer=by_hand.analytic(p), R=by_hand.variances(p)[-1], build=partial(model, p))


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
