r"""Lab 12. Two measurements at once or one after another.

Source: Semushin & Tsyganova 2001, task 12. x(t_i) = 0.7x(t_{i−1}) + w with E w = 0.2, Var w = 0.01; z1 = 2x + v1 and
z2 = sin x(t_i) + v2, variances 1 and cos²t_i. The sheet asks for (a) the propagation of estimate and covariance, (b) whether
"independent white" says one thing twice, (c) that sequential and simultaneous updates agree, (d) which property of R makes
them agree and whether it is necessary, (e) an experiment.

Expected answer: x̂⁻ = 3, P⁻ = 0.5; z1 gives 2 and 1/6. "sin x(t_i)" is most probably (sin t_i)·x(t_i): then both ways give
1.76636 and 0.11869 exactly. Read literally the filter is an extended one, and they agree only if z2 is linearised about x̂⁻;
relinearised after z1 they differ, and neither is the exact posterior (1.95140, 0.14189). A diagonal R is sufficient, not necessary
in general; correlated noises are decorrelated first (R = LDLᵀ).
"""

import math
from dataclasses import replace

import numpy as np
from ctlabs.tasks._task12_updates import H1, LEVELS, R1, literal, pair, part_c, second
from ctlabs.tasks._task12_words import answers, conclusions, discussion, result
from ctlabs.tasks.answers import task12 as by_hand

from ctlabs.analysis import sensitivity
from ctlabs.filtering import kalman_filter, updates
from ctlabs.labs.experiment import Experiment, covariances, filtered
from ctlabs.labs.portrait import agreement, portrait, rms
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import DiscreteModel
from ctlabs.reporting.drawing import Curve, Drawing, Panel
from ctlabs.reporting.draws import span
from ctlabs.reporting.params import LabParameters, Real, Variance, given
from ctlabs.reporting.report import EXACT, SOLVER, Report
from ctlabs.text import text

META = {
    "name": "task12",
    "title": "Two measurements at once or one after another",
    "source": "Semushin & Tsyganova 2001, task 12",
    "parts": ["a", "b", "c", "d", "e"],
}

#: Measurement times of the experiment with the linear reading, fewer where x would outgrow the rounding of its error.
STEPS = 25
STEP = "measurement number i"
IMPOSSIBLE = "R₁₂² > R₁R₂: no noises have such a covariance"


class Parameters(LabParameters):
    """What may be changed."""

    Phi: Real = given(0.7, unit="1", meaning="transition factor", draw=span(0.5, 0.9, 0.05))
    b: Real = given(0.2, unit="1", meaning="mean of the process noise", symbol="b", draw=span(0.1, 0.5, 0.1))
    Q: Variance = given(0.01, unit="1", meaning="variance of the process noise", draw=span(0.01, 0.05, 0.01))
    x_posterior: Real = given(4.0, unit="1", meaning="estimate at the previous time, after its update", symbol=r"\hat x(t_{i-1}^+)", draw=span(2, 6, 0.5))
    P_posterior: Variance = given(1.0, unit="1", meaning="its error variance", symbol="P(t_{i-1}^+)", draw=span(0.5, 2, 0.25))
    z1: Real = given(3.0, unit="1", meaning="first measurement", draw=span(2, 8, 0.5))
    z2: Real = given(1.0, unit="1", meaning="second measurement", draw=span(0.2, 1.2, 0.1))
    t: Real = given(1.0, unit="s", meaning="time of the measurements (and their period in the experiment)", draw=span(0.5, 1.3, 0.1))
    R12: Real = given(0.3, unit="1", meaning="covariance of v1 and v2 in part (d)", symbol="R_{12}", draw=span(0.05, 0.4, 0.05))


def model(p, t, R12=0.0):
    """The linear reading with measurements at the times t (steps+1,), t[0] without one."""
    sine, R2 = second(t)
    H = np.stack([np.full(len(t), H1), sine], axis=1)[:, :, None]
    R = np.zeros((len(t), 2, 2))
    R[:, 0, 0], R[:, 1, 1] = R1, R2
    R[:, 0, 1] = R[:, 1, 0] = R12
    return DiscreteModel([[p.Phi]], [[p.Q]], H, R, x0=[p.x_posterior], P0=[[p.P_posterior]], offset=[p.b], states=["x"],
                         measurements=["z1", "z2"], units=["1"])


def part_a(r, p, answer):
    """Propagation."""
    r.section("a", "Propagation to the next measurement")
    r.says("$\\hat{x}(t_{i-1}^+)$ is the conditional mean of $x(t_{i-1})$ given all measurements so far, $P(t_{i-1}^+)$ the variance of its error ({ref:maybeck, section 5.3}). The mean of a sum is the sum of the means, whatever the distributions; the noise enters with its mean $b$:")
    r.math(r"\hat x(t_i^-) = E[\Phi x(t_{i-1}) + w_d(t_{i-1}) \mid Z_{i-1}] = \Phi\,\hat x(t_{i-1}^+) + b", "mean")
    r.says("The error of the prediction is $e(t_i^-) = \\Phi e(t_{i-1}^+) - [w_d(t_{i-1}) - b]$. The noise is white and independent of $x(t_0)$ and of the measurement noises, hence of everything in $e(t_{i-1}^+)$: no cross term, and the *central* moment of the noise, not $E[w_d^2] = Q + b^2$, is added:")
    r.math(r"P(t_i^-) = \Phi^2P(t_{i-1}^+) + Q, \qquad Q = E\{[w_d - b]^2\}", "variance")
    schedule, system = covariances(model(p, np.array([0.0, p.t])), 1), model(p, np.array([0.0, p.t]))
    mean = filtered(system, [[p.z1, p.z2]]).x_minus[1, 0]
    r.value("prior", [mean, schedule.P_minus[1, 0, 0]], agrees=answer, routes=("filter", "formula"), kind=EXACT)
    r.says("With $\\hat{x}(t_{i-1}^+) = {x}$ and $P(t_{i-1}^+) = {P}$: $\\hat{x}(t_i^-) = {mean}$, $P(t_i^-) = {variance}$. The sheet asks for $\\hat{x}(t_{i-1}^-)$, a misprint for $\\hat{x}(t_i^-)$.",
           x=p.x_posterior, P=p.P_posterior, mean=mean, variance=schedule.P_minus[1, 0, 0])


def part_b(r, p, answer):
    """What 'independent white' says."""
    r.section("b", "Does \"independent white\" say one thing twice?")
    r.says("*White* concerns one sequence in time: its values at different instants are uncorrelated, and, if they are jointly Gaussian, independent. If \"independent\" meant the same thing, it would be redundant. Here it says of **two** sequences that no values of $v_1$ and $v_2$, at any two instants, depend on each other, and that does not follow from each being white and Gaussian. So the phrase is not redundant. It leaves unsaid that both are independent of $x(t_0)$ and of $w_d$, which (a) uses.")
    r.says("Three pairs, each member white and Gaussian with variances 1 and $R_2$, that are not independent:")
    r.items(["$v_2$ correlated with $v_1$ at the same instant: part (d).",
             "$v_2(t_i) = \\sqrt{R_2}\\,v_1(t_{i-1})$: no correlation at any one instant, and $R$ is diagonal. The error before the update already contains $v_1(t_{i-1})$, so that the filter's own variance is wrong.",
             "$v_2(t_i) = s_i\\sqrt{R_2}\\,v_1(t_i)$ with a random sign $s_i$: uncorrelated at all instants, both normal, yet not jointly normal: $E[v_1^2v_2^2] = 3R_2$ instead of $R_2$. The linear filter does not notice (it uses covariances only), but it is no longer the conditional mean."])
    P = answer["prior"][1]
    h2, R2 = (float(v) for v in second(p.t))
    node, weight = np.polynomial.hermite_e.hermegauss(8)
    fourth = float(weight @ node**4 / weight.sum()) * R2
    r.check("E[v1² v2²] of the pair with a random sign", fourth, 3 * R2, ("Gauss–Hermite quadrature over v1, sum over the signs", "fourth moment of a normal variable"))
    # Truth with the old noise as a state: u(t_i) = v1(t_i), and its value one step before.
    truth = DiscreteModel(
        [[p.Phi, 0, 0], [0, 0, 0], [0, 1, 0]], np.diag([p.Q, R1, 0]), [[H1, 1, 0], [h2, 0, math.sqrt(R2)]], np.zeros((2, 2)),
        x0=[p.x_posterior, 0, 0], P0=np.diag([p.P_posterior, R1, R1]), offset=[p.b, 0, 0],
    )
    design = DiscreteModel([[p.Phi]], [[p.Q]], [[H1], [h2]], np.diag([R1, R2]), x0=[p.x_posterior], P0=[[p.P_posterior]], offset=[p.b])
    steps = length(p)
    actual = sensitivity.actual(truth, design, steps, compare=[[1, 0, 0]])
    r.check("true variance for the delayed noise", actual.P_plus[1:, 0, 0], by_hand.lagged(p, P, R2, h2, steps),
            ("joint covariance of truth and filter", "recursion by hand with E[e⁺v1] = K1"), SOLVER)
    best = covariances(truth, steps).P_plus[-1, 0, 0]
    r.table("independence", ["filter for a $v_2$ that is the $v_1$ of the time before", "error variance"], [
        ["believes in independence: claimed", actual.claimed.P_plus[-1, 0, 0]],
        ["believes in independence: true", actual.P_plus[-1, 0, 0]],
        ["knows the noise", best],
    ], "Why independence of the two sequences has to be said: the second pair, sensors and $R_2$ held at their values for $t$, after {steps} measurements.", steps=steps)
    r.value("verdict_b", False)
    r.says("{tab:independence} is for the second pair. Each of its members is white and Gaussian, they are not independent of each other, and the filter claims a wrong variance: the words are not redundant.")


def length(p):
    """Measurements simulated: x grows at most 10⁸ times."""
    growth = math.log10(max(abs(p.Phi), 1.0))
    return STEPS if growth * STEPS <= 8 else max(1, int(8 / growth))


def part_d(r, p, answer):
    """Sufficient and necessary."""
    r.section("d", "The property of R")
    r.says("**Sufficient:** $R$ is diagonal (block-diagonal, if groups of measurements are processed together): the noises of what is processed separately are uncorrelated. The proof of (c) used nothing else.")
    r.says("**Necessary?** Sequential processing that ignores the rest of $R$ is the simultaneous update with $D = \\mathrm{diag}\\,R$. Both estimates agree for all data iff the gains do. With $S_D = HPH^T + D$, $S = HPH^T + R$ invertible,")
    r.math(r"PH^TS_D^{-1} = PH^TS^{-1} \iff PH^TS_D^{-1}(S - S_D) = 0 \iff PH^TS_D^{-1}(R - D) = 0", "gains")
    r.says("If the columns of $PH^T$ are independent ($P$ nonsingular and $H$ of full row rank) this forces $R = D$: then the property is necessary. In general it is not:")
    r.items(["$H = (0, 1, -1)^T$, $R = \\begin{bmatrix} 1 & a & a \\\\ a & 1 & 0 \\\\ a & 0 & 1 \\end{bmatrix}$ for a scalar state: $z_1$ sees only noise, which is correlated equally with $v_2$ and $v_3$ and cancels in $z_2 - z_3$. $R$ is nonsingular for $2a^2 < 1$ and not diagonal, $H$ has three rows and rank 1, and both ways agree.",
             "$PH^T = 0$: what is known already is not changed by any measurement, whatever $R$."])
    a, state = 0.6, ([1.0], [[0.5]])
    H, R = np.array([[0.0], [1.0], [-1.0]]), np.array([[1, a, a], [a, 1, 0], [a, 0, 1]])
    data = [0.7, 1.9, -0.4]
    ways = [pair(f(*state, data, H, each)) for f, each in ((updates.sequential, np.eye(3)), (updates.joint, R))]
    r.check("counterexample: equal though R is not diagonal", ways[0], ways[1], ("sequential, correlations ignored", "both at once"))
    r.value("verdict_d", False)
    r.says("So it is not necessary in general: for $a = {a}$ the first example gives the estimate {x} and the variance {P} both ways.", x=ways[0][0], P=ways[0][1], a=a)
    correlated(r, p, answer)


def correlated(r, p, answer):
    """The sheet's own pair of measurements with correlated noises."""
    x, P = answer["prior"]
    h2, R2 = (float(v) for v in second(p.t))
    r.says("**For the pair of the sheet** (linear reading, scalar $x$, two rows) $R - D$ has the determinant $-R_{12}^2$ and $PH^T \\ne 0$ if $P > 0$, so a diagonal $R$ *is* necessary. The variance alone can agree without it: for $h_2 \\ne 0$ at $R_{12} = 2h_1h_2/(h_1^2/R_1 + h_2^2/R_2)$ both ways claim the same $P^+$ with different estimates. Before a correlated pair is processed sequentially it is decorrelated, $R = LDL^T$, $z' = L^{-1}z$ and $H' = L^{-1}H$ ({ref:maybeck, chapter 7}):")
    r.math(r"l_{21} = \frac{R_{12}}{R_1}, \qquad z_2' = z_2 - l_{21}z_1, \qquad h_2' = h_2 - l_{21}h_1, \qquad d_2 = R_2 - \frac{R_{12}^2}{R_1}", "decorrelate")
    if answer["correlated_joint"] is None:
        for name in ("correlated_joint", "correlated_sequential_naive", "correlated_sequential_decorrelated", "naive_actual_variance"):
            r.value(name, None, reason=IMPOSSIBLE)
        least = float(np.linalg.eigvalsh([[R1, p.R12], [p.R12, R2]])[0])
        r.holds("R has a negative eigenvalue", [-least], ("eigenvalues of R", "R12² > R1·R2"), size=1.0)
        r.says("With $R_{12} = {R12}$ and $R_1R_2 = {product}$ no such noises exist ($R_{12}^2 > R_1R_2$), so there is no correlated case to compute.", R12=p.R12, product=R1 * R2)
        return
    singular = p.R12**2 >= R2 * (1 - 1e-12)
    off = math.copysign(math.sqrt(R1 * R2), p.R12) if singular else p.R12
    H, R, z = np.array([[H1], [h2]]), np.array([[R1, off], [off, R2]]), [p.z1, p.z2]
    new = updates.decorrelate(H, R)
    routes = "closed form by Cramer's rule"
    whole, naive = updates.joint([x], [[P]], z, H, R), updates.sequential([x], [[P]], z, H, np.diag(np.diag(R)))
    apart = updates.sequential([x], [[P]], new.measurements(z), new.H, new.R)
    r.value("correlated_joint", pair(whole), agrees=answer, routes=("both at once", routes))
    r.value("correlated_sequential_naive", pair(naive), agrees=answer, routes=("one after another, R12 ignored", routes))
    r.value("correlated_sequential_decorrelated", pair(apart), agrees=answer, routes=("one after another, decorrelated", routes))
    truth = single(x, P, H, R)
    true = sensitivity.actual(truth, replace(truth, R=np.diag(np.diag(R))), 1, first=0).P_plus[0, 0, 0]
    r.value("naive_actual_variance", true, agrees=answer, routes=("joint covariance of truth and filter", "(1 − KH)²P + KRKᵀ"))
    r.holds("no filter is better than the one that uses R12", [true - whole.P[0, 0]], ("true variance of the naive filter", "variance of the joint update"), size=P or 1.0)
    r.table("correlated", [text("$R_{12} = {R12}$", R12=p.R12), "estimate", "claimed variance", "true variance"], [
        ("both at once, or decorrelated and one after another", *pair(whole), float(whole.P[0, 0])),
        ("one after another, $R_{12}$ ignored", *pair(naive), true),
    ], "Correlated noises: $l_{21} = {l}$, $d = {d}$, $h_2' = {h}$.", l=new.L[1, 0], d=list(new.d), h=new.H[1, 0])
    r.says("{tab:correlated} has the numbers.")
    if singular and R2:
        r.says("Here $R_{12}^2 = R_1R_2$: $R$ is singular, $d_2 = 0$, and $z_2'$ is a perfect measurement of $h_2'x$.")
    by_correlation(r, x, P, h2, R2, p)


def single(x, P, H, R):
    """One update at t0 from the prior, as a model (a step follows, without meaning)."""
    return DiscreteModel([[1]], [[0]], H, R, x0=[x], P0=[[P]])


def by_correlation(r, x, P, h2, R2, p):
    """Variances against R12."""
    if R2 <= 1e-12 or P == 0:
        return
    largest_R12 = math.sqrt(R1 * R2)
    levels = np.linspace(-0.999, 0.999, 401) * largest_R12
    K1, K2 = by_hand.gains(P, h2, R2)
    curves = {
        "R₁₂ used: joint, or decorrelated": [by_hand.both(x, P, h2, 0, 0, R2, c)[1] for c in levels],
        "R₁₂ ignored: claimed": np.full(len(levels), by_hand.both(x, P, h2, 0, 0, R2, 0.0)[1]),
        "R₁₂ ignored: true": (1 - 2 * K1 - h2 * K2) ** 2 * P + K1**2 + 2 * K1 * K2 * levels + K2**2 * R2,
    }
    meet = 2 * H1 * h2 / (H1**2 / R1 + h2**2 / R2)
    drawn = [Curve(name, levels, values, colour, style) for (name, values), (colour, style) in zip(curves.items(), (("blue", "line"), ("black", "dash"), ("orange", "line")), strict=True)]
    if abs(h2) > 1e-9:
        drawn.append(Curve("equal claims, different estimates", [meet], [by_hand.both(x, P, h2, 0, 0, R2, meet)[1]], "green", "points", size=7.0))
    r.figure("correlation", Drawing("Correlation", "covariance R₁₂ of the noises (a pure number)", (Panel("error variance (a pure number)", tuple(drawn), kind="count"),)),
             "Error variances of one update against the covariance of the noises.")
    r.says("In {fig:correlation} the filter that ignores $R_{12}$ claims the same variance for every $R_{12}$. Its true variance is never below the joint one and touches it at $R_{12} = 0$ only; towards the ends, where one noise is a multiple of the other, the joint update can cancel them and the naive one cannot.")
    nu = [p.z1 - 2 * x, p.z2 - h2 * x]
    r.check("variance at the crossing", by_hand.both(x, P, h2, *nu, R2, meet)[1], float(updates.sequential([x], [[P]], [p.z1, p.z2], [[H1], [h2]], np.diag([R1, R2])).P[0, 0]),
            ("joint, correlated, by Cramer's rule", "sequential, R12 ignored"))


def plan(r, p, answer, experiment):
    """Every number chosen."""
    r.says("{tab:plan} lists what was chosen for two ensembles. The linear reading is filtered over {steps} measurements at $t_i = it$, with $H = (2, \\sin t_i)$ and $R = \\mathrm{diag}(1, \\cos^2t_i)$, all of it time-varying; then the same with noises of a constant correlation coefficient. The literal reading is studied in one update, repeated over the runs with $x$ drawn from $N(\\hat{x}^-, P^-)$, because there the exact posterior is at hand.", steps=length(p))
    coefficient = correlation(p, answer)
    r.table("plan", ["quantity", "value", "why"], [
        ["measurements, linear reading", length(p), "several periods of sin and cos, and of the filter's memory"],
        ["period, s", p.t, "the sheet's time t, so that the first measurement is that of (c)"],
        ["start", [p.x_posterior, p.P_posterior], "the sheet's estimate and variance"],
        ["correlation coefficient", coefficient, "that of $R_{12}$ at $t$, at most 0.99 either way; a dash where no such noises exist"],
        ["prior variances, literal reading", [level * answer["prior"][1] for level in LEVELS], "the $P^-$ of the sheet, a tenth and ten times of it: how far the straight line is trusted"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["seed", experiment.seed, "all filters of a comparison see the same data"],
    ], "Plan of the experiment.")


def correlation(p, answer):
    """ρ = R12/√(R1 R2) at the time t, not beyond ±0.99: rounding gives noises that are to cancel a σ of 1e-8."""
    if answer["correlated_joint"] is None:
        return None
    R2 = float(second(p.t)[1])
    return float(np.clip(p.R12 / math.sqrt(R1 * R2), -0.99, 0.99)) if R2 else 0.0


def part_e(r, p, answer, experiment):
    """The linear reading over many measurements."""
    r.section("e", "Experiment")
    r.says("**The linear reading.** {fig:errors} and {fig:ensemble} show the filter with both measurements. The widths of the bands vary with $\\sin t_i$ and $\\cos^2t_i$: they are narrow where the second measurement is good.")
    steps = length(p)
    t = np.arange(steps + 1) * p.t
    system = model(p, t)
    stats = portrait(r, experiment, system, steps, figures={
        "errors": "The innovations are those of the first measurement, $z_1$.",
        "ensemble": "The second measurement varies in time, and with it the theory."})
    said = {"measured": rms(stats), "sd": float(covariances(system, steps).sd_plus[-1, 0])}
    some = experiment.histories(system, steps=steps)
    one = kalman_filter(system, some.z[1:, :, 0], algorithm="sequential")
    scale = float(np.abs(some.x_plus).max()) or 1.0
    r.check("one record, all measurements: estimates", one.x_plus, some.x_plus[:, :, 0], ("one element after another", "both at once"), scale=scale)
    r.check("one record, all measurements: variances", one.P_plus, some.P_plus, ("one element after another", "both at once"), scale=float(some.P_plus.max()) or 1.0)
    r.check("first measurement of the experiment", some.P_plus[1, 0, 0], answer["linear_joint"][1], ("recursion", "closed form of (c)"), scale=answer["prior"][1] or 1.0)
    correlated_ensemble(r, p, answer, experiment, t)
    return said


def correlated_ensemble(r, p, answer, experiment, t):
    """The linear reading with correlated noises: what it costs to ignore that they are."""
    coefficient = correlation(p, answer)
    if coefficient is None:
        r.says("The correlated ensemble is left out: at $t$ no noises have the covariance $R_{12}$ ($R_{12}^2 > R_1R_2$).")
        return
    steps, system = len(t) - 1, model(p, t)
    truth = model(p, t, coefficient * np.sqrt(second(t)[1]))
    naive = replace(truth, R=system.R)
    new, by = updates.decorrelated(truth)
    seen = experiment.histories(truth, steps=steps)
    apart = filtered(new, by.measurements(seen.z)[1:])
    r.check("correlated: estimates of 25 runs", apart.x_plus, seen.x_plus, ("decorrelated data", "both at once"), scale=float(np.abs(seen.x_plus).max()) or 1.0)
    stats = experiment.statistics(truth, steps=steps)
    agreement(r, "correlated, R12 used", stats, seen.P_plus)
    wrong, actual = experiment.statistics(truth, naive, steps=steps), sensitivity.actual(truth, naive, steps)
    agreement(r, "correlated, R12 ignored", wrong, actual.P_plus, consistent=False)
    claimed, i = actual.claimed.P_plus, np.arange(1, steps + 1)
    curves = (Curve("R₁₂ used: theory", i, seen.sd_plus[1:, 0], "blue"), Curve("R₁₂ used: ensemble", i, stats.rms[1:, 0], "blue", "points", size=3.0),
              Curve("R₁₂ ignored: true", i, np.sqrt(actual.P_plus[1:, 0, 0]), "orange"), Curve("R₁₂ ignored: ensemble", i, wrong.rms[1:, 0], "orange", "square", size=3.0),
              Curve("R₁₂ ignored: claimed", i, np.sqrt(claimed[1:, 0, 0]), "black", "dash"))
    r.figure("correlated", Drawing("Correlated", STEP, (Panel("σ of the error (a pure number)", curves, kind="count"),), whole=True),
             "Correlated noises with the coefficient {rho:3}: standard deviations of theory (lines) and RMS errors of {runs} runs (points), with $R_{12}$ used and ignored.", rho=coefficient, runs=experiment.runs)
    mean = float(np.mean(actual.P_plus[1:, 0, 0]) / np.mean(seen.P_plus[1:, 0, 0])) if seen.P_plus[1:].any() else 1.0
    r.says("In {fig:correlated} the filter that ignores the correlation has on average {mean:3} times the variance of the one that uses it, and it claims {claim:3} times its own true one. The ensemble follows the true curves, whatever is claimed.", mean=mean,
           claim=float(np.mean(claimed[1:]) / np.mean(actual.P_plus[1:])) if actual.P_plus[1:].any() else 1.0)


PARTS = Skeleton(
    result=result,
    key="densities",
    analysis=(part_a, part_b, part_c, part_d),
    plan=plan,
    experiment=(part_e, literal),
    discussion=discussion,
    answers=answers,
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    answer = by_hand.analytic(p)
    return PARTS.report(META, p, experiment, answer=answer)


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
