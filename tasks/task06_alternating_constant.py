r"""Lab 6. An alternating constant: what each measurement adds, one that is lost, and one that is perfect.

Source: Semushin & Tsyganova 2001, task 6. x(t_{i+1}) = (−1)^{2i+1} x(t_i) = −x(t_i), x(t0) ~ N(0, P0), measured at
t1, t2, … with independent errors of variance R(t_i). The sheet asks for (a) the filter's equations; (b) proofs that
P(t_i⁺) decreases while 0 < R(t_i) < ∞, that a measurement with R(t_i) → ∞ is dropped, and that after R(t_i) = 0 further
filtering is useless; (c) an experiment.

Expected answer: 1/P(t_i⁺) = 1/P0 + Σ 1/R(t_j); a term of zero is a dropped measurement, an infinite one ends the filtering,
after which the estimate only changes its sign.
"""

import math

import numpy as np
from ctlabs.tasks._task06_words import answers, conclusions, discussion, result
from ctlabs.tasks.answers import task06 as by_hand

from ctlabs.filtering import settling_step
from ctlabs.labs.experiment import Experiment, covariances, filtered
from ctlabs.labs.portrait import mean_error, portrait, rms
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import DiscreteModel
from ctlabs.reporting.drawing import Band, Curve, Drawing, Mark, Panel
from ctlabs.reporting.draws import each, one_of, span
from ctlabs.reporting.params import LabParameters, Variance, VariancesOrInf, given
from ctlabs.reporting.report import EXACT, SOLVER, Report
from ctlabs.text import Uncertain, text

META = {
    "name": "task06",
    "title": "An alternating constant: lost and perfect measurements",
    "source": "Semushin & Tsyganova 2001, task 6",
    "parts": ["a", "b", "c"],
}

STEP = "measurement number i"
#: What the instrument shows in place of the lost measurement, m.
NONSENSE = 1e9


class Parameters(LabParameters):
    """What may be changed."""

    P0: Variance = given(4.0, unit="m²", meaning="variance of x(t0)", draw=span(1, 9, 0.5))
    R: VariancesOrInf = given((1, 1, 1, 1, 1, 1), unit="m²", meaning='variances of the measurement errors, 0 and "inf" allowed; as many measurements as entries', draw=each(*[one_of(0.5, 1, 1.5, 2, 2.5, 3, 4, 5)] * 6))


def model(P0, R):
    """x(t_{i+1}) = −x(t_i), z(t_i) = x(t_i) + v(t_i) with the variances R(t_1), R(t_2) and so on."""
    return DiscreteModel(Phi=[[-1]], Qd=[[0]], H=[[1]], R=np.reshape([R[0], *R], (-1, 1, 1)), x0=[0], P0=[[P0]], dt=1,
                         states=["x"], measurements=["z"], units=["m"])


def with_both(P0, R):
    """Variances with a lost measurement and, later but not last, a perfect one; and the same without the lost one.

    The given list where it has both; otherwise its ordinary entries (ones, if there are none) with the two put in.
    """
    if P0 > 0 and 0 in R[:-1] and math.inf in R[: R.index(0)]:
        return R, tuple(x for x in R if x < math.inf)
    plain = [x for x in R if 0 < x < math.inf] or [1.0]
    n = max(3, len(plain))
    plain = (plain * 3)[:n]
    third, end = math.ceil(n / 3), math.ceil(2 * n / 3)
    rest = (*plain[third:end], 0.0, *plain[end:])
    return (*plain[:third], math.inf, *rest), (*plain[:third], *rest)


def part_a(r, p, answer, system, experiment):
    """Equations of the filter, and the same estimate from all measurements at once."""
    r.section("a", "Equations of the optimal filter")
    r.says("The power $2i+1$ is odd for every $i$, so the factor is always $-1$. The sequence has one unknown magnitude and changes its sign at each step,")
    r.math(r"x(t_{i+1}) = -x(t_i), \qquad x(t_i) = (-1)^i x(t_0), \qquad z(t_i) = x(t_i) + v(t_i)")
    r.math(r"\Phi = -1, \qquad Q_d = 0, \qquad H = 1, \qquad \bar x_0 = 0, \qquad P_0 = {P0} \; \text{m}^2, \qquad R(t_i) = {R} \; \text{m}^2, \quad i = 1, \dots, {n}",
           P0=p.P0, R=np.array([p.R]), n=len(p.R))
    r.says("From $\\hat{x}(t_0^+) = 0$ and $P(t_0^+) = P_0$ the filter {ref:maybeck, section 5.3} goes on for $i = 1, 2, \\dots$ by")
    r.math(r"\hat x(t_i^-) = -\hat x(t_{i-1}^+), \qquad P(t_i^-) = \Phi^2P(t_{i-1}^+) = P(t_{i-1}^+),", "prediction")
    r.math(r"K(t_i) = \frac{P(t_i^-)}{P(t_i^-) + R(t_i)}, \qquad \hat x(t_i^+) = \hat x(t_i^-) + K(t_i)\,[z(t_i) - \hat x(t_i^-)], \qquad P(t_i^+) = \frac{P(t_i^-)\,R(t_i)}{P(t_i^-) + R(t_i)}.", "update")
    r.says("**The same estimate by least squares.** Every $(-1)^jz(t_j)$ is a measurement of the one number $x(t_0)$. Weighted with $1/R(t_j)$, together with the prior value 0 of weight $1/P_0$, they give")
    r.math(r"\hat x_i(t_0) = P(t_i^+)\sum_{j=1}^{i}\frac{(-1)^jz(t_j)}{R(t_j)}, \qquad \hat x(t_i^+) = (-1)^i\,\hat x_i(t_0).", "squares")
    schedule = covariances(system, len(p.R))
    r.value("gain", schedule.K[1:, 0, 0], at=range(1, len(p.R) + 1), agrees=answer, routes=("recursion", "share of the information"))
    some = experiment.histories(system, steps=len(p.R))
    r.check("estimates of 25 records", some.x_plus[1:, 0], by_hand.least_squares(some.z[1:, 0], p.P0, p.R),
            ("filter", "least squares over all measurements"), SOLVER, scale=float(np.abs(some.truth[1:]).max()) or 1.0)


def part_b(r, p, answer, system):
    """The three proofs, and the given list."""
    r.section("b", "What a measurement adds: three proofs")
    r.says("The proofs use the inverse covariance form of the update {ref:maybeck, section 5.7}. **1. The variance decreases.** Let $P_0 > 0$ and $0 < R(t_i) < \\infty$. Then $P(t_i^-) = P(t_{i-1}^+) > 0$ and $P(t_i^+) > 0$, and the reciprocal of the update is")
    r.math(r"\frac1{P(t_i^+)} = \frac{P(t_i^-) + R(t_i)}{P(t_i^-)\,R(t_i)} = \frac1{P(t_{i-1}^+)} + \frac1{R(t_i)} \quad\Rightarrow\quad \frac1{P(t_i^+)} = \frac1{P_0} + \sum_{j=1}^{i}\frac1{R(t_j)}", "information")
    r.says("by induction. Each measurement adds the positive number $1/R(t_i)$, so $1/P(t_i^+)$ increases and $P(t_i^+)$ decreases strictly. ∎ It tends to zero exactly when $\\sum 1/R(t_j)$ diverges; for a constant $R$ it falls like $R/i$, and as its limit is 0 it never stays within 1 % of it: it does not settle.")
    r.says("**2. $R(t_i) \\to \\infty$ drops the measurement.** Then $K(t_i) \\to 0$ and $P(t_i^+) = P(t_i^-)/[1 + P(t_i^-)/R(t_i)] \\to P(t_i^-)$. A small gain alone would not do, as the innovation grows without bound with $R$; but the variance of the correction,")
    r.math(r"E\{K^2(t_i)\,[z(t_i) - \hat x(t_i^-)]^2\} = K^2(t_i)\,[P(t_i^-) + R(t_i)] = \frac{P^2(t_i^-)}{P(t_i^-) + R(t_i)} \to 0,")
    r.says("tends to zero too: in the mean square $\\hat{x}(t_i^+) \\to \\hat{x}(t_i^-)$. In the sum of proof 1 the term $1/R(t_i)$ is missing. ∎")
    r.says("**3. $R(t_i) = 0$ ends the filtering.** If $P(t_i^-) > 0$, then $K(t_i) = 1$, $\\hat{x}(t_i^+) = z(t_i) = x(t_i)$ and $P(t_i^+) = 0$. From there $P(t_j^-) = 0$ for all $j > i$, hence $K(t_j) = 0/[0 + R(t_j)] = 0$ and")
    r.math(r"\hat x(t_j^+) = -\hat x(t_{j-1}^+) = x(t_j), \qquad P(t_j^+) = 0, \qquad j > i:")
    r.says("only the sign is still to be changed. A second perfect measurement, $R(t_j) = 0$, has the gain 0/0; its innovation is zero whatever the gain, and the filter takes $K = 0$. ∎")
    schedule, at = covariances(system, len(p.R)), list(range(1, len(p.R) + 1))
    P, routes = schedule.P_plus[:, 0, 0], ("recursion", "sum of information")
    r.says("**The given measurements** are followed in {tab:given}, and {fig:information} shows their information.")
    r.table("given", ["i", "R, m²", "P⁻, m²", "K", "P⁺, m²", "1/P⁺, 1/m²", "the measurement"],
            [(i, p.R[i - 1], schedule.P_minus[i, 0, 0], schedule.K[i, 0, 0], P[i], by_hand.reciprocal(P[i]), role(schedule, p.R, i)) for i in at],
            "The filter along the given variances.")
    information(r, p, P)
    r.value("posterior_variance", P[1:], "m²", at=at, agrees=answer, routes=routes, kind=EXACT)
    r.value("posterior_information", [by_hand.reciprocal(x) for x in P[1:]], "1/m²", at=at, agrees=answer, routes=routes, kind=EXACT)
    r.holds("P⁺ never increases", -np.diff(P), ("recursion", "proof 1"), size=p.P0 or 1.0)
    if p.P0 > 0:
        r.check("share of the initial error left, Π(1 − K) = P⁺/P0", np.cumprod(1 - schedule.K[1:, 0, 0]), [P_ / p.P0 for P_ in answer["posterior_variance"]],
                ("product of the gains' complements", "sum of information"), EXACT, scale=1.0)
    decreasing = bool((schedule.K[1:] > 0).all())
    r.value("verdict_b", decreasing)
    settled = settling_step(schedule.P_plus[:, 0], [0.0])
    r.value("settling_step", None if settled is None else max(settled, 1), agrees=answer, routes=("recursion", "first perfect measurement"),
            reason="" if settled is not None else "the variance is positive to the end of the list, and one that falls towards zero never stays within 1 % of it")
    if decreasing:
        r.says("Here every gain is positive, so $P(t_i^+)$ decreases strictly from {start} to {end} m².", start=p.P0, end=P[-1])
    else:
        still = [i for i in at if schedule.K[i, 0, 0] == 0]
        r.says("The variance decreases strictly where the gain is positive; here it stays as it is at i = {still}. At i = 0 it is {start} m², at the end {end} m².",
               still=", ".join(map(str, still)), start=p.P0, end=P[-1])


def information(r, p, P):
    """What is known after each measurement, as information."""
    known = np.array([1 / x if x else math.nan for x in P])
    if not np.isfinite(known).any():
        known = np.zeros_like(known)
    perfect = np.flatnonzero(P == 0)
    marks = (Mark("known exactly from here on", float(perfect[0]), "grey"),) if len(perfect) else ()
    r.figure("information", Drawing("information", STEP, (Panel("information $1/P(t_i^+)$, 1/m²", (Curve("information", np.arange(len(P)), known, "blue", "stems"),), kind="count"),), whole=True, marks=marks),
             "The information $1/P(t_i^+)$ along the given measurements, from $1/P_0$ at i = 0." if p.P0 else "With $P_0 = 0$ the information is infinite from the start, and nothing can be drawn.")
    if p.P0:
        r.says("In {fig:information} each measurement raises the information by $1/R(t_i)$, whatever was known before; a lost one by nothing.", (" After the perfect one it is infinite." if len(perfect) else ""))


def role(schedule, R, i):
    """In words, what a measurement does."""
    if R[i - 1] == math.inf:
        return "dropped"
    if schedule.P_minus[i, 0, 0] == 0:
        return "useless: x is known"
    return "perfect" if R[i - 1] == 0 else "used"


def shown(r, experiment, start, both, without):
    """The limits R → ∞ and R → 0, and both extremes."""
    r.says("**The limits in numbers.** Let the variance before a measurement be $P = {P}$ m². When R is doubled again and again from $1000P$ on, the decrease $P - P^+ = P^2/(P+R)$ should in the end be halved each time; when R is halved again and again from $P/1000$ on, so should be $P^+ = PR/(P+R)$. The computed variances do both.", P=start)
    far = [covariances(model(start, (1e3 * start * 2**j,)), 1).P_plus[1, 0, 0] for j in range(4)]
    near = [covariances(model(start, (1e-3 * start / 2**j,)), 1).P_plus[1, 0, 0] for j in range(4)]
    r.order("P⁻ − P⁺ as R → ∞", [start - P for P in far], 1, ("recursion", "proof 2"))
    r.order("P⁺ as R → 0", near, 1, ("recursion", "proof 3"))
    r.says("**Both extremes** occur in the list of variances {R} m². The variances $P^+$ at the other measurements are the same, to the last digit, as if the lost one were not in the list. In 25 simulated records the estimate at the lost measurement is the prediction, whatever the instrument shows (here {nonsense} m), and after the perfect one it only changes its sign.",
           R=both, nonsense=NONSENSE)
    lost, perfect = both.index(math.inf) + 1, both.index(0) + 1
    system = model(start, both)
    full, short = covariances(system, len(both)), covariances(model(start, without), len(without))
    kept = [i for i in range(1, len(both) + 1) if both[i - 1] < math.inf]
    bits = {"kind": EXACT, "scale": 0.0}
    r.check("variances of the others, bit for bit", full.P_plus[kept, 0, 0], short.P_plus[1:, 0, 0], ("with R = ∞ in the list", "list without it"), **bits)
    some = experiment.histories(system, steps=len(both), stream=1)
    shown_anyway = np.where(np.isnan(some.z), NONSENSE, some.z)
    again = filtered(system, shown_anyway[1:])
    r.check("estimates, bit for bit", some.x_plus, again.x_plus, ("no measurement", "any measurement with R = ∞"), **bits)
    r.check("estimate at the lost measurement, bit for bit", some.x_plus[lost], some.x_minus[lost], ("after", "before"), **bits)
    after = some.x_plus[perfect:, 0]
    r.check("estimate after the perfect one, bit for bit", after[1:], -after[:-1], ("filter", "change of sign"), **bits)
    r.check("estimate from the perfect one on", after, some.truth[perfect:, 0], ("filter", "truth"), EXACT)
    plain = next(x for x in without if x > 0)
    cases = {
        "$P^+$, neither": tuple(x if 0 < x < math.inf else plain for x in both),
        "$P^+$, one lost": tuple(x or plain for x in both),
        "$P^+$, lost and perfect": both,
    }
    panels = tuple(Panel(text("{what}, m²", what=what), (Curve("", np.arange(1, len(R) + 1), covariances(model(start, R), len(R)).P_plus[1:, 0, 0], "blue", "stems", quiet=True),), kind="count") for what, R in cases.items())
    r.figure("extremes", Drawing("extremes", STEP, panels, whole=True, height=6.5), "Variance $P(t_i^+)$ after each measurement: with ordinary measurements only, with a lost one at i = {lost}, and with a perfect one at i = {perfect} as well.",
             lost=lost, perfect=perfect)
    r.says("In {fig:extremes} both are seen. At i = {lost} the variance stays as it is, and every later one is larger than it would have been; from i = {perfect} on it is 0, and no later measurement can change that.", lost=lost, perfect=perfect)


def plan(r, p, experiment, start, both):
    """Every number chosen."""
    rows = [
        ["measurements", len(p.R), "the entries of R"],
        ["$P_0$, m²", p.P0, "the sheet leaves it open; so are the variances R"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["seed", experiment.seed, "another stream of random numbers for each system"],
    ]
    if (start, both) != (p.P0, p.R):
        rows.insert(2, ["second system: R, m²", list(both), text("one lost and one perfect measurement, from the variance {P0} m²", P0=start)])
    r.says("{tab:plan} lists what was chosen. The ensemble is compared with the variances of {part:b}: mean error, RMS, NEES, NIS. Where the variance is zero in theory, the error may be no more than rounding.",
           " The given list has a lost and a perfect measurement, so one system is enough." if (start, both) == (p.P0, p.R)
           else " A second system has a lost and a perfect measurement among the given ones.")
    r.table("plan", ["quantity", "value", "why"], rows, "Plan of the experiment.")


def part_c(r, p, answer, system, experiment, start, both):
    """Ensembles against theory."""
    r.section("c", "Ensemble against theory")
    record(r, experiment, p, system)
    stats = portrait(r, experiment, system, len(p.R), figures={"ensemble": "The errors change their sign with x, which their RMS does not show."})
    r.value("rms_error", stats.rms[1:, 0], "m", at=range(1, len(p.R) + 1))
    theory = [math.sqrt(P) for P in answer["posterior_variance"]]
    rows = []
    for i, sd in enumerate(theory, start=1):
        measured, mean = (rms(stats, i), mean_error(stats, i)) if sd else (0.0, 0.0)
        rows.append((i, p.R[i - 1], sd, measured, mean, averaged(stats.nees[i], experiment), averaged(stats.nis[i], experiment)))
    r.says("{fig:ensemble} and {tab:ensemble} compare all {runs} runs with theory.", runs=experiment.runs)
    r.table("ensemble", ["i", "R, m²", "σ of theory, m", "RMS, m", "mean error, m", "NEES", "NIS"], rows,
            "The ensemble at every measurement; NEES and NIS are averages over the runs, 1 in theory; they do not exist where the variance is zero or nothing is measured.")
    found = {"measured": rms(stats, unit="m") if theory[-1] else None, "sd": theory[-1]}
    if (start, both) == (p.P0, p.R):
        r.says("The lost measurement leaves the error as it was; after the perfect one it is zero and stays so.")
        return found
    portrait(r, experiment, model(start, both), len(both), prefix="extremes_", stream=1, figures={"ensemble": "One measurement is lost and one is perfect."})
    r.says("{fig:extremes_ensemble} is the same for the second system, with the variances {R} m² from $P_0 = {P0}$ m². The lost measurement leaves the RMS error where it was; from the perfect one on it is zero, and there is no NEES.", R=both, P0=start)
    return found


def record(r, experiment, p, system):
    """One run, with the alternating sign taken away."""
    some = experiment.histories(system, steps=len(p.R), runs=1)
    i = np.arange(len(p.R) + 1)
    sign = (-1.0) ** i
    estimate, sd = sign * some.x_plus[:, 0, 0], some.sd_plus[:, 0]
    z = sign[1:] * some.z[1:, 0, 0]
    curves = (Curve("$x(t_0)$", i, np.full(len(i), some.truth[0, 0, 0]), "black", "dash"), Curve("estimate", i, estimate, "blue", "points"), Curve("measurement", i[1:], z, "orange", "cross"))
    r.figure("record", Drawing("record", STEP, (Panel("$(-1)^i$ times x and z, m", curves, (Band("estimate ± σ", i, estimate - sd, estimate + sd, "blue"),)),), whole=True),
             "One run with the alternating sign taken away, so that all measurements and estimates are of the one number $x(t_0)$.")
    r.says("In {fig:record} the estimate begins at 0 with the uncertainty of $P_0$. A measurement draws it towards itself in proportion to the gain, which becomes smaller as more becomes known, and narrows the band.")


def averaged(x, experiment):
    """An average of χ²(1) over the runs with its standard error, "—" where there is none."""
    return "—" if math.isnan(x) else Uncertain(float(x), math.sqrt(2 / experiment.runs))


PARTS = Skeleton(
    result=result,
    key="extremes",
    analysis=(part_a, part_b, shown),
    plan=plan,
    experiment=(part_c,),
    discussion=discussion,
    answers=answers,
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    answer, system = by_hand.analytic(p), model(p.P0, p.R)
    start = p.P0 or 1.0
    both, without = with_both(p.P0, p.R)
    return PARTS.report(META, p, experiment, answer=answer, system=system, start=start, both=both, without=without)


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
