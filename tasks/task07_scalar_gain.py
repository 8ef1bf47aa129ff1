r"""Lab 7. The scalar system: limits of the optimal filter.

Source: Semushin & Tsyganova 2001, task 7. For x(i+1) = Φx(i) + w(i), z(i) = x(i) + v(i) the sheet asks for the
filter's equations, the bounds of its error variances and gain, the loss of a constant gain that is not optimal, the
optimal constant gain, the family of curves of P̄/R against K*, the case without process noise, six numerical variants
(table 3), and an experiment.

Expected answer: P⁻ ≥ Q, 0 ≤ P⁺ ≤ R, 0 ≤ K ≤ 1; P̄/R = [(1−K*)²λ + K*²]/[1 − (1−K*)²Φ²] where |(1−K*)Φ| < 1;
its minimum is at K* = K̄ and equals K̄; for Q = 0 the limit is 0 for |Φ| ≤ 1 and (Φ²−1)R/Φ² for |Φ| > 1.
"""

import math

import numpy as np
from ctlabs.tasks._task07_words import answers, conclusions, discussion, result
from ctlabs.tasks.answers import task07 as by_hand
from ctlabs.tasks.answers.task07 import TABLE3

from ctlabs.analysis import sensitivity
from ctlabs.filtering import settling, steady
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import agreement, lasting, mean_error, portrait, rms
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import DiscreteModel
from ctlabs.reporting import plots
from ctlabs.reporting.draws import one_of, span
from ctlabs.reporting.params import Count, Fraction, LabParameters, Positive, Real, Variance, Variances, given
from ctlabs.reporting.report import EXACT, SOLVER, Report
from ctlabs.text import Uncertain, text

META = {
    "name": "task07",
    "title": "The scalar system: limits of the optimal filter",
    "source": "Semushin & Tsyganova 2001, task 7",
    "parts": ["a", "b", "c", "d", "e", "f", "g"],
}

STEP = "measurement number i"
#: Measurements of a simulated system, fewer of one that grows fast.
STEPS = 40


class Parameters(LabParameters):
    """What may be changed."""

    Phi: Real = given(0.78, unit="1", meaning="transition factor Φ", draw=one_of(*(k / 100 for k in (*range(60, 96), *range(105, 131)))))
    Q: Variance = given(0.39, unit="m²", meaning="variance of the process noise w", draw=span(0.1, 1, 0.05))
    R: Positive = given(0.5, unit="m²", meaning="variance of the measurement noise v", draw=span(0.2, 2, 0.05))
    P0: Variance = given(1.0, unit="m²", meaning="variance of x(t0)", draw=span(0.5, 3, 0.25))
    K_star: Fraction = given(0.3, unit="1", meaning="a constant gain that is not optimal, parts (b) and (g)", draw=span(0.25, 0.8, 0.05))
    Phi2: Variance = given(0.5, unit="1", meaning="Φ² of the family of curves, part (d)", draw=span(0.3, 0.9, 0.05))
    lambdas: Variances = given((0.1, 0.2, 0.5, 1, 2, 3, 4, 5), unit="1", meaning="ratios λ = Q/R of part (d)", symbol="\\lambda")
    steps: Count = given(5, unit="1", meaning="measurements in the lists and in table 3", symbol="N")


def model(Phi, Q, R, P0):
    """x(i+1) = Φx(i) + w(i), z(i) = x(i) + v(i)."""
    return DiscreteModel(Phi=[[Phi]], Qd=[[Q]], H=[[1]], R=[[R]], x0=[0], P0=[[P0]], dt=1, states=["x"],
                         measurements=["z"], units=["m"])


def part_a(r, p, system):
    """Equations of the filter, written for scalars, run over `steps` measurements."""
    r.section("a", "Equations of the optimal filter")
    r.says("The system and its measurement are scalar:")
    r.math(r"x(t_{i+1}) = \Phi x(t_i) + w(t_i), \qquad z(t_i) = x(t_i) + v(t_i)")
    r.model(system)
    r.says("From $\\hat{x}(t_0^+) = 0$ and $P(t_0^+) = P_0$ the filter predicts and then updates with each measurement, $i = 1, 2, \\dots$:")
    r.math(r"\hat x(t_i^-) = \Phi\,\hat x(t_{i-1}^+), \qquad P(t_i^-) = \Phi^2P(t_{i-1}^+) + Q", "prediction")
    r.math(r"K(t_i) = \frac{P(t_i^-)}{P(t_i^-) + R}, \qquad \hat x(t_i^+) = \hat x(t_i^-) + K(t_i)\,[z(t_i) - \hat x(t_i^-)], \qquad P(t_i^+) = [1 - K(t_i)]\,P(t_i^-)", "update")
    r.says("These are the equations of {ref:maybeck, section 5.3} for one state and one measurement. The variances and the gain do not depend on the measurements, so they are computed before any data come.")
    schedule = covariances(system, p.steps)
    K = schedule.K[1:, 0, 0]
    short = (1 - K) * schedule.P_minus[1:, 0, 0]
    r.check("P⁺ = (1 − K)P⁻", schedule.P_plus[1:, 0, 0], short, ("Joseph form", "short form"), EXACT, scale=schedule.P_minus.max())


def part_b(r, p, answer, system):
    """Bounds, with proofs, and the variance under a constant gain."""
    r.section("b", "Bounds, and the price of a constant gain")
    r.says("**Prediction.** $P(t_i^-) = \\Phi^2P(t_{i-1}^+) + Q \\ge Q$, because $\\Phi^2P(t_{i-1}^+) \\ge 0$: nothing known at $t_{i-1}$ tells of $w(t_{i-1})$.")
    r.says("**Filtering.** Put the gain into {eq:update}:")
    r.math(r"P(t_i^+) = \frac{P(t_i^-)\,R}{P(t_i^-) + R} = K(t_i)\,R, \qquad K(t_i) = \frac{P(t_i^-)}{P(t_i^-) + R}")
    r.says("Since $P(t_i^-) \\ge 0$ and $R > 0$, the fraction lies in $[0, 1]$. Hence $0 \\le K(t_i) \\le 1$ and $0 \\le P(t_i^+) \\le R$: the filter is never worse than the last measurement alone. ∎")
    r.says("**A constant gain** $K_* \\in [0, 1]$. The error $e = \\hat{x} - x$ obeys")
    r.math(r"e(t_i^+) = (1 - K_*)\,[\Phi\,e(t_{i-1}^+) - w(t_{i-1})] + K_*v(t_i)")
    r.says("and its three terms are independent, so that $P(t_i^+) = (1-K_*)^2[\\Phi^2P(t_{i-1}^+) + Q] + K_*^2R$. Where $|(1-K_*)\\Phi| < 1$ this linear recursion has the limit")
    r.math(r"\frac{\bar P}{R} = \frac{(1-K_*)^2\lambda + K_*^2}{1 - (1-K_*)^2\Phi^2}, \qquad \lambda = \frac QR", "constant")
    r.says("For $|\\Phi| \\ge 1$ the condition is narrower than $K_* \\in [0, 1]$, which the sheet allows: a gain below $1 - 1/|\\Phi|$ lets the error grow without bound.")
    schedule = covariances(system, p.steps)
    P_minus, P_plus, K = schedule.P_minus[1:, 0, 0], schedule.P_plus[1:, 0, 0], schedule.K[1:, 0, 0]
    routes = ("recursion", "bound proved")
    r.holds("P⁻ ≥ Q", P_minus - p.Q, routes, size=P_minus.max())
    r.holds("0 ≤ P⁺ ≤ R", np.minimum(P_plus, p.R - P_plus), routes, size=p.R)
    r.holds("0 ≤ K ≤ 1", np.minimum(K, 1 - K), routes, size=1.0)
    multiplier = abs((1 - p.K_star) * p.Phi)
    converges = multiplier < 1
    r.value("verdict_b", converges)
    ratio = float(sensitivity.steady(system, system, K=[[p.K_star]]).P_plus[0, 0]) / p.R if converges else None
    reason = "" if converges else "the error variance grows without bound"
    r.value("suboptimal_variance_ratio", ratio, reason=reason, symbol=r"\bar P/R \;(K_*)", agrees=answer, routes=("Lyapunov equation", "closed form"))
    if converges:
        r.says("Here $K_* = {gain}$ and $|(1-K_*)\\Phi| = {multiplier} < 1$, so the formula holds: $\\bar{P}/R = {ratio}$, where the optimal filter has $\\bar{K} = {best}$.",
               gain=p.K_star, multiplier=multiplier, ratio=ratio, best=answer["gain_steady"])
    else:
        r.says("Here $K_* = {gain}$ and $|(1-K_*)\\Phi| = {multiplier} \\ge 1$: the error grows without bound and the formula does not apply (it would give a negative or infinite value). The least constant gain that keeps the error bounded is above $1 - 1/|\\Phi| = {least}$.",
               gain=p.K_star, multiplier=multiplier, least=1 - 1 / abs(p.Phi))


def part_c(r, p, answer, system):
    """The optimal constant gain."""
    r.section("c", "The optimal constant gain")
    r.says("Write {eq:constant} as $f(K) = [(1-K)^2\\lambda + K^2]/D(K)$ with $D = 1 - (1-K)^2\\Phi^2$. In the numerator of the derivative, $[2K - 2(1-K)\\lambda]D - [(1-K)^2\\lambda + K^2]\\cdot 2(1-K)\\Phi^2$, the cubic terms cancel, and")
    r.math(r"f'(K) = \frac{2\,[\Phi^2K^2 + (\lambda + 1 - \Phi^2)K - \lambda]}{[1 - (1-K)^2\Phi^2]^2}", "derivative")
    r.says("The bracket is $-\\lambda$ at $K = 0$ and $1$ at $K = 1$. For λ > 0 it is therefore negative first and positive then, for a quadratic with such values has one root between (for λ = 0 it has the roots 0 and $1 - 1/\\Phi^2$, and the larger one is meant):")
    r.math(r"\bar K = \frac{-(\lambda + 1 - \Phi^2) + \sqrt{(\lambda + 1 - \Phi^2)^2 + 4\Phi^2\lambda}}{2\Phi^2}, \qquad \bar K = \frac{\lambda}{1 + \lambda} \; \text{at} \; \Phi = 0", "best")
    r.says("So $f$ falls before $\\bar K$ and rises after it: the root is the minimum. There the second derivative is $2\\sqrt{(\\lambda + 1 - \\Phi^2)^2 + 4\\Phi^2\\lambda}/D^2$, as the bracket vanishes and its slope at the larger root is that square root; it is positive where λ > 0.")
    r.says("The same quadratic follows from the steady state of the optimal filter, $\\bar{P} = \\bar{K}R$ and $\\bar{P}^- = \\Phi^2\\bar{P} + Q$: the best constant gain is the limit of the optimal gain, and the least value of $\\bar{P}/R$ is $\\bar{K}$ itself.")
    limit = steady.solve(system)
    routes = ("Riccati equation", "closed form")
    r.value("gain_steady", limit.K[0, 0], symbol=r"\bar K", agrees=answer, routes=routes)
    r.value("prior_variance_steady", limit.P_minus[0, 0], "m²", symbol=r"\bar P^-", agrees=answer, routes=routes)
    r.value("posterior_variance_steady", limit.P_plus[0, 0], "m²", symbol=r"\bar P", agrees=answer, routes=routes)
    if abs((1 - answer["gain_steady"]) * p.Phi) < 1:
        least = by_hand.variance_ratio(answer["gain_steady"], p.Phi**2, p.Q / p.R)
        r.check("least P̄/R equals K̄", least, answer["gain_steady"], ("formula of (b)", "formula of (c)"), SOLVER)
    r.says("For the given numbers λ = {ratio}, $\\bar{K} = {gain}$, $\\bar{P} = {posterior}$ m² after and $\\bar{P}^- = {prior}$ m² before an update; the steady filter's pole is $(1-\\bar{K})\\Phi = {pole}$.",
           ratio=p.Q / p.R, gain=limit.K[0, 0], posterior=limit.P_plus[0, 0], prior=limit.P_minus[0, 0], pole=float(limit.poles[0].real))


def part_d(r, p, answer):
    """The family of curves."""
    r.section("d", "The family of curves")
    K = np.linspace(0.0, 1.0, 401)
    bounded = (1 - K) ** 2 * p.Phi2 < 1 - 1e-9
    curves = {
        f"λ = {ratio:g}": [
            by_hand.variance_ratio(k, p.Phi2, ratio) if good else math.nan for k, good in zip(K, bounded, strict=True)
        ]
        for ratio in p.lambdas
    }
    gains = answer["gain_optimal_by_lambda"]
    figure = plots.lines(K, curves, xlabel="constant gain $K_*$", ylabel="steady $\\bar{P}/R$", ordered=True,
                         points={"minima": (gains, gains)}, straight={"$\\bar{P}/R = K_*$": ([0, 1], [0, 1])},
                         ylim=(0.0, 1.6))
    r.figure("family", figure,
             "Steady error variance against a constant gain for Φ² = {square}. Every curve has its minimum on the line $\\bar{P}/R = K_*$, at the gain of part (c), and all meet at $K_* = 1$, where only the last measurement counts.",
             square=p.Phi2)
    solved = [float(steady.solve(model(math.sqrt(p.Phi2), ratio, 1.0, 1.0)).K[0, 0]) for ratio in p.lambdas]
    r.says("In {fig:family} each curve has one minimum, on the straight line, and its ordinate there is the gain itself; {tab:family} has the numbers. The ratio λ rises from the lowest curve to the highest. Left of the minimum the filter trusts its model too much, right of it the measurements; at $K_* = 1$ all curves meet, as the estimate is then the last measurement.")
    r.value("gain_optimal_by_lambda", solved, agrees=answer, routes=("Riccati equation", "closed form"))
    r.table("family", ["λ", "K̄", "P̄/R"], [(ratio, k, by_hand.variance_ratio(k, p.Phi2, ratio)) for ratio, k in zip(p.lambdas, solved, strict=True)],
            "The minima of the curves: the least P̄/R equals K̄.")
    if p.Phi2 >= 1:
        r.says("With Φ² = {square} the curves begin at $K_* = {least}$: a smaller gain does not hold the unstable system.",
               square=p.Phi2, least=1 - 1 / math.sqrt(p.Phi2))


def part_e(r, p, answer):
    """No process noise."""
    r.section("e", "Without process noise")
    r.says("For $Q = 0$ and $P_0 > 0$ the update adds information, $1/P(t_i^+) = 1/P(t_i^-) + 1/R$, and the prediction scales it, $P(t_i^-) = \\Phi^2P(t_{i-1}^+)$. Hence")
    r.math(r"\frac1{P(t_i^+)} = \frac{\Phi^{-2i}}{P_0} + \frac1R\sum_{j=0}^{i-1}\Phi^{-2j}")
    r.items(["$|\\Phi| < 1$: the right side grows like $\\Phi^{-2i}$, so $P(t_i^+) \\to 0$ geometrically: the state becomes known exactly.",
             "$|\\Phi| = 1$ (missing from the sheet): $1/P(t_i^+) = 1/P_0 + i/R$, so $P(t_i^+) \\to 0$ only like $R/i$.",
             "$|\\Phi| > 1$: the first term vanishes and the sum tends to $\\Phi^2/(\\Phi^2-1)$, so $P(t_i^+) \\to (\\Phi^2-1)R/\\Phi^2 < R$: no number of measurements does better. ∎",
             "$P_0 = 0$: the variance stays 0, whatever Φ is, and so does the gain. For $|\\Phi| > 1$ such a filter is of no practical use: it never corrects an error, and the smallest one grows."])
    start, length = p.P0 or p.R, 40
    shown = sorted({0.6, 0.9, 1.0, 1.1, 1.5, round(abs(p.Phi), 6)})
    curves, limits = {}, {}
    for Phi in shown:
        recursion = covariances(model(Phi, 0.0, p.R, start), length).P_plus[:, 0, 0]
        r.check(text("P⁺ for Q = 0, |Φ| = {factor}", factor=Phi), recursion, by_hand.noiseless(Phi, p.R, start, length),
                ("recursion", "sum of information"), SOLVER)
        curves[f"|Φ| = {Phi:g}"] = np.where(recursion > 1e-9 * p.R, recursion / p.R, np.nan)
        if Phi > 1:
            level = (Phi**2 - 1) / Phi**2
            limits["limits $(\\Phi^2-1)/\\Phi^2$" if not limits else f"_{Phi}"] = ([0, length], [level, level])
    figure = plots.lines(range(length + 1), curves, xlabel=STEP, ylabel="$P(t_i^+)/R$ for Q = 0", straight=limits,
                         log="y", ordered=True, steps=True)
    r.figure("noiseless", figure,
             "Filtering variance without process noise: geometric decay for |Φ| < 1, R/i for |Φ| = 1, a floor for |Φ| > 1 (dashed).")
    limit = steady.solve(model(p.Phi, 0.0, p.R, 1.0)).P_plus[0, 0]
    r.value("noiseless_limit", limit, "m²", symbol=r"\bar P \;(Q = 0)", agrees=answer, routes=("Riccati equation", "closed form"))
    known = bool(limit == 0)
    r.value("verdict_e", known)
    r.says("In {fig:noiseless} $|\\Phi|$ rises from the lowest curve to the highest. A straight line on the logarithmic axis is geometric decay; the curve of $|\\Phi| = 1$ bends, and each curve above it ends on its floor.")
    r.says("For Φ = {Phi} the limit is 0: the state can be found exactly by filtering long enough." if known else "For Φ = {Phi} the limit is {limit} m²: the state cannot be found exactly, however long one filters.",
           Phi=p.Phi, limit=limit)
    if p.P0 == 0:
        r.says("This is the limit from any $P_0 > 0$. With the given $P_0 = 0$ and $Q = 0$ the variance would stay 0.")


def plan(r, p, experiment):
    """Every number chosen."""
    steps = lasting(model(p.Phi, p.Q, p.R, p.P0), STEPS)
    r.says("{tab:plan} lists what was chosen. Part (f) needs no random numbers. Part (g) simulates the given parameters and the six variants of table 3, and compares the ensemble with the variances of (f) and, for the constant gain $K_*$, of (b).")
    r.table("plan", ["quantity", "value", "why"], [
        ["measurements, part (f)", p.steps, "the sheet's four or five"],
        ["measurements, part (g)", steps, "several settling times; fewer where an unstable x outgrows the rounding of its error"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["seed", experiment.seed, "another stream of random numbers for each system, the same for both filters of a system"],
        ["initial mean", 0, "the sheet's"],
    ], "Plan of the experiment.")
    return {"steps": steps}


def part_f(r, p, answer, system):
    """Table 3 and the given parameters."""
    r.section("f", "Error variances along the measurements")
    systems = [model(*row) for row in TABLE3]
    limits = [steady.solve(s) for s in systems]
    four = {
        text("{n}: Φ = {Phi}, Q = {Q}, R = {R}", n=i + 1, Phi=row[0], Q=row[1], R=row[2]): covariances(s, 4)
        for i, (row, s) in enumerate(zip(TABLE3, systems, strict=True))
    }
    figure = plots.sawtooth(four, xlabel=STEP, ylabel="variance, m²", limits=[(s.P_minus[0, 0], s.P_plus[0, 0]) for s in limits])
    r.says("The variances of {fig:table3} and {tab:table3} are known before any measurement. Those of variants 1 to 5 begin above their limits and come down to them, the first four in two or three steps; in variant 6, whose noise is large beside $P_0$, they rise.")
    r.figure("table3", figure, "The six variants of table 3 from $P_0$ over four measurements: each measurement lowers the variance, and the prediction after it raises it again. Dotted: steady values.")
    schedules = [covariances(s, p.steps) for s in systems]
    rows = [
        (variant + 1, i, s.P_minus[i, 0, 0], s.P_plus[i, 0, 0], s.K[i, 0, 0])
        for variant, s in enumerate(schedules) for i in range(1, p.steps + 1)
    ]
    r.table("table3", ["variant", "i", "P⁻, m²", "P⁺, m²", "K"], rows, "Table 3 of the sheet, computed.")
    own, at, routes = covariances(system, p.steps), list(range(1, p.steps + 1)), ("recursion", "power of the step's matrix")
    for name, pick, unit in (("prior_variance", "P_minus", "m²"), ("posterior_variance", "P_plus", "m²"), ("gain", "K", "1")):
        r.value(f"table3_{name}", [getattr(s, pick)[1:, 0, 0] for s in schedules], unit, agrees=answer, routes=routes)
        r.value(name, getattr(own, pick)[1:, 0, 0], unit, at=at, agrees=answer, routes=routes)
    settled = settling(system)
    if settled is not None:
        r.check("settling step", settled, answer["settling_step"], ("recursion", "scalar fraction"), EXACT)
    reason = "the variance stays 0, away from the limit from any P0 > 0" if p.P0 == 0 and p.Q == 0 else "the limit is 0, and a variance that decays to 0 never stays within 1 % of it"
    r.value("settling_step", answer["settling_step"] if settled is None else settled, reason=reason)


def part_g(r, p, system, experiment, steps):
    """Ensemble against theory."""
    r.section("g", "Innovations and errors of the simulated filter")
    limit = steady.solve(system)
    r.says("{fig:errors} shows 25 runs, {fig:ensemble} the statistics of all {runs}. In {tab:ensemble} are the six variants at their last measurement.", runs=experiment.runs)
    own = portrait(r, experiment, system, steps, limits=(limit.P_minus[0, 0], limit.P_plus[0, 0]), figures={
        "errors": "The band of the innovations is wider than that of the errors by the measurement's own noise; an update narrows the band of the prediction to that of the filtering.",
        "ensemble": "The points scatter about theory, about one in twenty of them outside the band; neighbours often lie on one side, as errors of successive instants are correlated."})
    rows = []
    for i, row in enumerate(TABLE3, start=1):
        variant = model(*row)
        stats, theory = experiment.statistics(variant, steps=lasting(variant, STEPS), stream=i), covariances(variant, lasting(variant, STEPS))
        agreement(r, text("variant {n}", n=i), stats, theory.P_plus)
        rows.append((i, theory.sd_plus[-1, 0], rms(stats), mean_error(stats), spread(stats.nees[-1], experiment), spread(stats.nis[-1], experiment)))
    r.table("ensemble", ["variant", "σ of theory, m", "RMS, m", "mean error, m", "NEES", "NIS"], rows,
            "The variants of table 3 at the last measurement, with standard errors; NEES and NIS are averages over the runs, 1 in theory.")
    constant = sensitivity.fixed_gain(system, [[p.K_star]], steps)
    stats = experiment.statistics(system, steps=steps, gains=constant)
    agreement(r, "constant gain", stats, constant.P_plus, consistent=False)
    r.says("On the same data the constant gain $K_* = {gain}$ has an RMS error of {constant} at the last measurement (theory {claimed:4} m), the optimal filter {optimal} (theory {best:4} m).",
           gain=p.K_star, constant=rms(stats, unit="m"), claimed=math.sqrt(constant.P_plus[-1, 0, 0]), optimal=rms(own, unit="m"),
           best=math.sqrt(covariances(system, steps).P_plus[-1, 0, 0]))
    return {"measured": rms(own, unit="m"), "sd": math.sqrt(covariances(system, steps).P_plus[-1, 0, 0])}


def spread(average, experiment):
    """An average of χ²(1) over the runs with its standard error."""
    return Uncertain(float(average), math.sqrt(2 / experiment.runs))


PARTS = Skeleton(
    result=result,
    key="family",
    analysis=(part_a, part_b, part_c, part_d, part_e),
    plan=plan,
    experiment=(part_f, part_g),
    discussion=discussion,
    answers=answers,
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    answer, system = by_hand.analytic(p), model(p.Phi, p.Q, p.R, p.P0)
    return PARTS.report(META, p, experiment, system=system, answer=answer)


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
