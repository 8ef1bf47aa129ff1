r"""Lab 11. A scalar random walk and two measurements.

Source: Semushin & Tsyganova 2001, task 11. x(t_{i+1}) = x(t_i) + w(t_i), z(t_i) = x(t_i) + v(t_i), given E x(t1) and E x²(t1).
The sheet asks for (a) x̂⁻, x̂⁺ as explicit functions of z1, z2, the variances, the gains, and the information that each
measurement adds to 1/P⁻; (b) any number of measurements, and vectors with as many measurements as states; (c) an experiment.

Expected answer: P(t1⁻) = 2 − 1² = 1; K = 4/5, 14/19; P⁺ = 1/5, 7/38; x̂(t2⁺) = 1/19 + 4z1/19 + 14z2/19; each measurement
adds 1/R = 4. In general P⁻¹ grows by R⁻¹ at a measurement, and P⁻ → [Q + √(Q² + 4QR)]/2.
"""

import math

import numpy as np
from ctlabs.tasks.answers import task11 as by_hand
from ctlabs.tasks.answers.task11 import WITHIN
from pydantic import field_validator

from ctlabs.filtering import settling, steady
from ctlabs.labs.experiment import Experiment, covariances, filtered
from ctlabs.labs.portrait import largest, mean_error, portrait, rms
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import DiscreteModel
from ctlabs.reporting.drawing import Curve, Drawing, Panel
from ctlabs.reporting.draws import one_of, span
from ctlabs.reporting.params import Count, LabParameters, Real, Variance, given
from ctlabs.reporting.report import EXACT, SOLVER, Report
from ctlabs.text import Uncertain, latex_number, text

META = {
    "name": "task11",
    "title": "A scalar random walk and two measurements",
    "source": "Semushin & Tsyganova 2001, task 11",
    "parts": ["a", "b", "c"],
}

#: Measurements simulated in part (c), if the lists are shorter.
SIMULATED = 30
#: At most so many estimates are written out as sums of measurements.
LISTED = 40
#: A settling step beyond this is not searched for by recursion too.
SEARCHED = 20_000
#: Shapes of P(t1⁻), Q and R in the example with vectors, multiplied by the scalar values.
SHAPES = (((1, 0.5), (0.5, 1)), ((1, 0), (0, 0.25)), ((1, 0.2), (0.2, 2)))
SINCE = "time since t1, steps (i − 1)"


class Parameters(LabParameters):
    """What may be changed."""

    x1_mean: Real = given(1.0, unit="m", meaning="mean of x(t1)", symbol=r"E\,x(t_1)", draw=one_of(0.5, 1, 1.5, 2))
    x1_second_moment: Variance = given(2.0, unit="m²", meaning="mean of x²(t1), at least the square of the mean", symbol=r"E\,x^2(t_1)", draw=span(1, 8, 0.5))
    Q: Variance = given(0.5, unit="m²", meaning="variance of the process noise w", draw=span(0.1, 2, 0.1))
    R: Variance = given(0.25, unit="m²", meaning="variance of the measurement noise v", draw=span(0.1, 2, 0.05))
    steps: Count = given(5, unit="1", meaning="measurements in the lists, the first at t1", symbol="N")

    @field_validator("x1_second_moment")
    @classmethod
    def _possible(cls, value, info):
        """The mean of a square is not less than the square of the mean."""
        mean = info.data.get("x1_mean", 0.0)
        if by_hand.decimal(value) < by_hand.decimal(mean) ** 2:
            raise ValueError(f"expected at least the square of x1_mean = {mean:.15g}, received {value:.15g}")
        return value


def model(mean, P1, Q, R):
    """x(t_{i+1}) = x(t_i) + w(t_i), z(t_i) = x(t_i) + v(t_i), from t1 on; scalars or matrices."""
    n = len(mean)
    return DiscreteModel(Phi=np.eye(n), Qd=Q, H=np.eye(n), R=R, x0=mean, P0=P1, dt=1, states=["x"] if n == 1 else None,
                         measurements=["z"] if n == 1 else None, units=["m"] * n)


def conditioned(P1, Q, R, N):
    """The weights (N, N + 1) of 1·mean and z1…zN in x̂(t_i⁺), i = 1…N, from the joint covariance, for R > 0."""
    index = np.arange(N)
    C = P1 + Q * np.minimum(index[:, None], index)
    weights = np.zeros((N, N + 1))
    for i in range(N):
        weights[i, 1 : i + 2] = np.linalg.solve(C[: i + 1, : i + 1] + R * np.eye(i + 1), C[i, : i + 1])
    weights[:, 0] = 1 - weights[:, 1:].sum(axis=1)
    return weights


def shown(x):
    """A sympy number in LaTeX: as it is where that is short, as a decimal number elsewhere."""
    import sympy

    exact = sympy.latex(x)
    return exact if len(exact) < 40 else latex_number(float(x))


def affine(coefficients):
    """An estimate in LaTeX: constant + a z1 + b z2, terms of zero left out."""
    terms = [("" if c == 1 and name else shown(c) + r"\," * bool(name)) + name for c, name in zip(coefficients, ("", "z_1", "z_2"), strict=False) if c != 0]
    return " + ".join(terms) or "0"


def part_a(r, p, answer, system):
    """Two measurements, in exact fractions."""
    r.section("a", "Two measurements")
    r.says("The given moments are those of $x(t_1)$, before any measurement; the filter starts there, without a prediction:")
    exact = by_hand.two_measurements(p)
    r.math(r"\hat x(t_1^-) = E\,x(t_1) = {mean}, \qquad P(t_1^-) = E\,x^2(t_1) - [E\,x(t_1)]^2 = {second} - ({mean})^2 = {P}",
           mean=p.x1_mean, second=p.x1_second_moment, P=shown(exact["prior"][0]))
    r.math(r"\Phi = 1, \qquad Q_d = {Q} \; \text{m}^2, \qquad H = 1, \qquad R = {R} \; \text{m}^2", Q=p.Q, R=p.R)
    r.says("A measurement, and the prediction that follows it, are {ref:maybeck, section 5.3}")
    r.math(r"K(t_i) = \frac{P(t_i^-)}{P(t_i^-) + R}, \qquad \hat x(t_i^+) = [1 - K(t_i)]\,\hat x(t_i^-) + K(t_i)z_i, \qquad P(t_i^+) = K(t_i)R", "update")
    r.math(r"\hat x(t_{i+1}^-) = \hat x(t_i^+), \qquad P(t_{i+1}^-) = P(t_i^+) + Q", "prediction")
    r.says("With the given numbers, exactly:")
    for i in (0, 1):
        r.math(r"P(t_{n}^-) = {prior}, \qquad K(t_{n}) = {gain}, \qquad P(t_{n}^+) = {posterior}".replace("{n}", str(i + 1)),
               prior=shown(exact["prior"][i]), gain=shown(exact["gain"][i]), posterior=shown(exact["posterior"][i]))
    r.math(r"\hat x(t_1^-) = {mean}, \qquad \hat x(t_1^+) = \hat x(t_2^-) = {one}", "first", mean=shown(_rational(p.x1_mean)), one=affine(exact["coefficients"][0]))
    r.math(r"\hat x(t_2^+) = {two}", "second", two=affine(exact["coefficients"][1]))
    r.says("**Information.** The reciprocal of the update is $1/P(t_i^+) = 1/P(t_i^-) + 1/R$: each measurement adds $1/R$ = {added} 1/m², the same at $t_1$ and $t_2$ whatever was known before. The prediction between them takes information away ({tab:information}).", added=answer["information_increment"][0])
    rows = [(f"$t_{i + 1}$", _inverse(exact["prior"][i]), answer["information_increment"][i], _inverse(exact["posterior"][i])) for i in (0, 1)]
    r.table("information", ["", "1/P⁻, 1/m²", "added, 1/m²", "1/P⁺, 1/m²"], rows, "Information before and after the two measurements.")
    schedule = covariances(system, 1, first=0)
    P_minus, P_plus, K = (stack[:, 0, 0] for stack in (schedule.P_minus, schedule.P_plus, schedule.K))
    routes = ("recursion", "exact fractions")
    r.check("P⁻ at t1, t2", P_minus, [float(x) for x in exact["prior"]], routes, EXACT)
    r.check("K at t1, t2", K, [float(x) for x in exact["gain"]], routes, EXACT)
    r.check("P⁺ at t1, t2", P_plus, [float(x) for x in exact["posterior"]], routes, EXACT)
    added = [k / after if after else answer["information_increment"][i] for i, (k, after) in enumerate(zip(K, P_plus, strict=True))]
    r.value("information_increment", answer["information_increment"], "1/m²", at=[1, 2], symbol=r"1/P^+ - 1/P^-")
    r.check("information increment", added, answer["information_increment"], ("K/P⁺ of the recursion", "1/R"), EXACT)
    if P_plus.all():
        r.check("1/P⁺ − 1/P⁻", 1 / P_plus - 1 / P_minus, answer["information_increment"], ("recursion", "1/R"), EXACT, scale=(1 / P_plus).max())
    table = responses(system, 2)
    for i in (0, 1):
        name = f"posterior_estimate_coefficients_{i + 1}"
        r.value(name, answer[name], symbol=rf"\text{{coefficients of }}\hat x(t_{i + 1}^+)")
        r.check(name.replace("_", " "), table[i, : i + 2], answer[name], ("filter's answer to unit measurements", "exact fractions"), EXACT)
    r.says("The coefficients in {eq:first} and {eq:second} are those of 1, $z_1$ and $z_2$. The constant is what is left of the initial mean. The weights of the mean, of $z_1$ and of $z_2$ add up to one, so that the estimate is unbiased.")


def _rational(x):
    """A number as a sympy fraction."""
    import sympy

    return sympy.Rational(*by_hand.decimal(x).as_integer_ratio())


def _inverse(x):
    """1/x for the table: a fraction in words, or infinity."""
    if x == 0:
        return math.inf
    exact = str(1 / x)
    return exact if len(exact) < 20 else float(1 / x)


def responses(system, N):
    """Coefficients (N, N + 1) of 1, z1…zN in x̂(t_i⁺) as the filter has them: its answers to unit measurements."""
    units = np.eye(N)[:, None, :]
    still = DiscreteModel(system.Phi, system.Qd, system.H, system.R, x0=np.zeros(1), P0=system.P0)
    silent = filtered(system, np.zeros((N, 1, 1)), first=0).x_plus[:, 0]
    return np.hstack([silent, filtered(still, units, first=0).x_plus[:, 0]])


def part_b(r, p, answer, system):
    """Any number of measurements; the steady state."""
    r.section("b", "Any number of measurements, and vectors")
    r.says("**Any number.** The same two steps repeat. For $i = 1, 2, \\dots$")
    r.math(r"\frac1{P(t_i^+)} = \frac1{P(t_i^-)} + \frac1R, \qquad P(t_{i+1}^-) = P(t_i^+) + Q, \qquad K(t_i) = \frac{P(t_i^+)}R", "information")
    r.math(r"\hat x(t_N^+) = E\,x(t_1)\prod_{j=1}^{N}[1 - K(t_j)] + \sum_{j=1}^{N}K(t_j)z_j\prod_{l=j+1}^{N}[1 - K(t_l)]", "sum")
    N, at, routes = max(p.steps, 2), list(range(1, p.steps + 1)), ("recursion", "power of the step's matrix")
    schedule = covariances(system, N - 1, first=0)
    for name, stack, unit in (("prior_variance", schedule.P_minus, "m²"), ("gain", schedule.K, "1"), ("posterior_variance", schedule.P_plus, "m²")):
        r.value(name, stack[: p.steps, 0, 0], unit, at=at, agrees=answer, routes=routes, kind=SOLVER)
    r.table("sequence", ["i", "P⁻, m²", "K", "P⁺, m²", "1/P⁺, 1/m²"], [(i + 1, schedule.P_minus[i, 0, 0], schedule.K[i, 0, 0], schedule.P_plus[i, 0, 0], 1 / schedule.P_plus[i, 0, 0] if schedule.P_plus[i, 0, 0] else math.inf) for i in range(p.steps)],
            "The filter along the measurements.")
    r.says("**Steady state.** With $P(t_{i+1}^-) = P(t_i^-)$ what a measurement removes is what the noise adds, $(\\bar{P}^-)^2/(\\bar{P}^- + R) = Q$, so")
    exact, number = shown(by_hand.steady_exact(p)), latex_number(answer["prior_variance_steady"])
    r.math(r"\bar P^- = \frac{Q + \sqrt{Q^2 + 4QR}}2 = {root}, \qquad \bar P^+ = \bar P^- - Q = {posterior}, \qquad \bar K = \frac{Q}{\bar P^-} {gain}", "steady",
           root=exact if exact == number else rf"{exact} \approx {number}", posterior=answer["posterior_variance_steady"], gain=f" = {latex_number(answer['gain_steady'])}" if p.Q else r" \to 0")
    limit = steady.solve(system)
    both = ("Riccati equation", "closed form")
    r.value("prior_variance_steady", limit.P_minus[0, 0], "m²", symbol=r"\bar P^-", agrees=answer, routes=both)
    r.value("posterior_variance_steady", limit.P_plus[0, 0], "m²", symbol=r"\bar P^+", agrees=answer, routes=both)
    r.value("gain_steady", limit.K[0, 0], symbol=r"\bar K", agrees=answer, routes=both)
    settled = answer["settling_step"]
    r.value("settling_step", settled, reason="" if settled else "without process noise the variance falls like R/i and never stays within 1 % of its limit 0")
    if settled is None or settled < SEARCHED:
        found = settling(system, within=WITHIN, first=0)
        r.check("settling step", None if found is None else found + 1, settled, ("recursion", "closed form"))
    if p.Q and p.R:
        r.says("Each measurement multiplies an old error by $1 - \\bar{K} = {left}$, and the distance of the variance from its limit by about $(1-\\bar{K})^2 = {square}$: $P^+$ is within 1 % of the limit from measurement {settled} on.",
               left=1 - answer["gain_steady"], square=(1 - answer["gain_steady"]) ** 2, settled=answer["settling_step"])
    elif p.R:
        r.says("With $Q = 0$ the information only grows, $1/P(t_i^+) = 1/P(t_1^-) + i/R$: the limits are zero, approached like $R/i$, and the estimate tends to the mean of all measurements.")
    else:
        r.says("With $R = 0$ every measurement is the state: $P^+ = 0$ from the first one on, $P^- = Q$ from the second.")


def weights(r, p, answer, system, N):
    """What each measurement weighs in the last estimate."""
    own = responses(system, N)
    last, share = own[-1, 1:], answer["gain_steady"]
    still = model([1.0], system.P0, system.Qd, system.R)
    r.check("sum of all weights", responses(still, N).sum(axis=1), np.ones(N), ("filter's answer to unit measurements", "unbiasedness"), EXACT)
    C = by_hand.start(p) + p.Q * np.minimum(np.arange(N)[:, None], np.arange(N)) + p.R * np.eye(N)
    if p.R and np.linalg.cond(C) < 1e6:
        whole = conditioned(by_hand.start(p), p.Q, p.R, N)
        whole[:, 0] *= p.x1_mean
        r.check(text("coefficients of all estimates up to {n} measurements", n=N), own, whole, ("filter's answer to unit measurements", "conditioning on all measurements at once"), SOLVER, scale=max(1.0, abs(p.x1_mean)))
    recent = np.arange(max(1, N - 11), N + 1)
    steady_ones, weighty = share * (1 - share) ** (N - recent), np.where(last[recent - 1] > 1e-300, last[recent - 1], math.nan)
    curves = [Curve(text("weight of measurement j in the estimate after measurement {n}", n=N), recent, weighty, "blue", "points", size=5.0)]
    if share and (steady_ones > 1e-300).all():
        curves.append(Curve("steady: $\\bar{K}(1-\\bar{K})^{N-j}$", recent, steady_ones, "grey", "dash"))
    kind = "log" if np.isfinite(weighty).any() else "count"
    figure = Drawing("Weights", "measurement number j", (Panel("weight (gain K times later 1 − K)", tuple(curves), kind=kind),), whole=True)
    settled = answer["settling_step"] is not None and answer["settling_step"] <= N - 12
    r.says(("{fig:weights} shows the weights of {eq:sum}: they grow towards the last measurement, whose weight is the gain." if p.Q and p.R else "{fig:weights} shows the weights of {eq:sum}."),
           " On the logarithmic axis they lie on the straight line of the steady filter." if settled and p.Q and p.R else "")
    r.figure("weights", figure, "Weights of the last 12 of {n} measurements in the estimate after all of them: the filter forgets old measurements because the state has moved since." if p.Q else
             "Weights of the last 12 of {n} measurements in the estimate after all of them: the state does not move, so none is forgotten.", n=N)


def vectors(r, p):
    """H = I with matrices."""
    r.says("**Vectors.** If $x$ and $z$ have the same dimension and $H = I$, the formulas keep their form with matrices as long as these are regular:")
    r.math(r"P^{-1}(t_i^+) = P^{-1}(t_i^-) + R^{-1}, \qquad K(t_i) = P(t_i^-)[P(t_i^-) + R]^{-1} = P(t_i^+)R^{-1}, \qquad P(t_{i+1}^-) = P(t_i^+) + Q")
    r.math(r"\hat x(t_i^+) = [I - K(t_i)]\,\hat x(t_i^-) + K(t_i)z_i, \qquad I - K(t_i) = P(t_i^+)P^{-1}(t_i^-)")
    r.says("Each measurement adds $R^{-1}$. (With $\\Phi \\ne I$ and a regular square $H$ it adds $H^TR^{-1}H$, and $P(t_{i+1}^-) = \\Phi P(t_i^+)\\Phi^T + Q$.) In the steady state $\\bar{P}^-(\\bar{P}^- + R)^{-1}\\bar{P}^- = Q$; choosing coordinates in which $R = I$ and $Q = \\text{diag}(q_j)$ makes it scalar, $\\bar{P}^-_{jj} = [q_j + \\sqrt{q_j^2 + 4q_j}]/2$.")
    P1, Q, R = (scale * np.array(shape) for scale, shape in zip((by_hand.start(p), p.Q, p.R), SHAPES, strict=True))
    system = model([p.x1_mean] * 2, P1, Q, R)
    r.says("An example in two dimensions, in which the scalar values multiply fixed matrices:")
    r.math(r"P(t_1^-) = {P1}, \qquad Q = {Q}, \qquad R = {R}", P1=P1, Q=Q, R=R)
    schedule = covariances(system, max(p.steps, 2) - 1, first=0)
    if p.R and by_hand.start(p) and 1e-6 < by_hand.start(p) / p.R < 1e6:
        routes = ("recursion", "inverse covariances")
        inverse = np.linalg.inv
        r.check("P⁻¹ added by each measurement", inverse(schedule.P_plus) - inverse(schedule.P_minus), np.broadcast_to(inverse(R), schedule.P_plus.shape), routes, SOLVER, scale=np.abs(inverse(schedule.P_plus)).max())
        r.check("gain matrices", schedule.K, schedule.P_plus @ inverse(R), ("recursion", "P⁺R⁻¹"))
        r.math(r"P(t_1^+) = {one}, \quad P(t_2^+) = {two}, \quad K(t_2) = {K}, \quad P^{-1}(t_2^+) - P^{-1}(t_2^-) = R^{-1} = {added}",
               one=schedule.P_plus[0], two=schedule.P_plus[1], K=schedule.K[1], added=inverse(R))
    limit = steady.solve(system).P_minus
    r.value("vector_prior_covariance_steady", limit, "m²")
    r.check("steady covariance of the vectors", limit, by_hand.vector_limit(Q, R) if p.R else Q, ("Riccati equation", "scalar problems in common coordinates"))
    r.math(r"\bar P^- = {limit}", limit=limit)


def plan(r, p, experiment, count):
    """Every number chosen."""
    r.says("{tab:plan} lists what was chosen. The ensemble is compared with the variances of (b), over enough measurements to see the steady state. The first measurement is made at the start $t_1$, without a prediction.")
    r.table("plan", ["quantity", "value", "why"], [
        ["measurements", count, "several settling times, unless Q is small"],
        ["mean and variance of $x(t_1)$, m and m²", [p.x1_mean, by_hand.start(p)], "from the given moments"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["seed", experiment.seed, "any; the tests hold for all"],
    ], "Plan of the experiment.")


def part_c(r, p, answer, system, experiment, count):
    """Ensemble against theory."""
    r.section("c", "Ensemble against theory")
    limits = (answer["prior_variance_steady"], answer["posterior_variance_steady"])
    r.says("{fig:record} is one run, {fig:ensemble} the statistics of all {runs}; {tab:ensemble} has the first measurements and the last one.", runs=experiment.runs)
    stats = portrait(r, experiment, system, count - 1, first=0, limits=limits, xlabel=SINCE, figures={
        "record": "Each measurement draws the estimate towards itself; between two measurements the estimate does not change, for a random walk has no trend to follow.",
        "ensemble": "The points lie on both sides of theory, about one in twenty outside the band."})
    theory, unit = covariances(system, count - 1, first=0), "m"
    rows = [(i + 1, theory.sd_minus[i, 0], Uncertain(float(stats.rms_minus[i, 0]), float(stats.rms_minus[i, 0]) / math.sqrt(2 * experiment.runs)), theory.sd_plus[i, 0], rms(stats, i), mean_error(stats, i), averaged(stats.nees[i], experiment), averaged(stats.nis[i], experiment)) for i in (*range(min(p.steps, 6)), count - 1)]
    r.table("ensemble", ["i", "σ⁻ of theory, m", "RMS⁻, m", "σ⁺ of theory, m", "RMS⁺, m", "mean error⁺, m", "NEES", "NIS"], rows,
            "The ensemble before (−) and after (+) the first measurements and the last one; NEES and NIS are averages over the runs, 1 in theory (— where the variance is zero).")
    r.value("rms_error", stats.rms[:2, 0], "m", at=[1, 2])
    one, two = rms(stats, 0, unit=unit), rms(stats, 1, unit=unit)
    r.says("The RMS errors after the first two measurements are {one} and {two}; theory has {first:4} and {second:4} m.", one=one, two=two, first=theory.sd_plus[0, 0], second=theory.sd_plus[1, 0])
    return {"measured": two, "sd": float(theory.sd_plus[1, 0])}


def averaged(x, experiment):
    """An average of χ²(1) over the runs with its standard error, "—" where there is none."""
    return "—" if math.isnan(x) else Uncertain(float(x), math.sqrt(2 / experiment.runs))


def conclusions(r, p, answer):
    """What the numbers say."""
    K, lines = by_hand.two_measurements(p)["gain"], []
    first, second = float(K[0]), float(K[1])
    if p.R == 0:
        lines.append("The measurements are perfect: the estimate is the last measurement, and what was known before is of no use." if second else "The first measurement is perfect and the state does not move: the others add nothing." if first else "The state is known from the start and does not move; even perfect measurements add nothing to that.")
    else:
        lines.append(text("The first measurement has the weight {first:4} beside the prior mean, the second the weight {second:4} beside the estimate before it.", first=first, second=second))
        lines.append(text("Each adds the information 1/R = {added} 1/m²; how much of the variance this removes depends on what was known: {one:3} % at $t_1$, {two:3} % at $t_2$.", added=1 / p.R, one=100 * first, two=100 * second))
    if by_hand.start(p) == 0 and p.R:
        lines.append("$x(t_1)$ is known (its second moment is the square of its mean), so the first measurement changes nothing.")
    if p.Q and p.R:
        lines.append(text("From measurement {settled} on the variance is within 1 % of its limit: $\\bar P^- = {prior:4}$ m², $\\bar P^+ = {posterior:4}$ m², $\\bar K = {gain:4}$.", settled=answer["settling_step"], prior=answer["prior_variance_steady"], posterior=answer["posterior_variance_steady"], gain=answer["gain_steady"]))
    elif p.R and by_hand.start(p):
        lines.append("Without process noise the state is a constant: its variance falls like R/i and the gain tends to 0.")
    elif p.R:
        lines.append("Without process noise it stays known for ever.")
    lines.append("With vectors and $H = I$ everything holds with matrices, and in suitable coordinates the steady state separates into scalar ones.")
    lines.append(largest(r))
    r.items(lines)


def result(p, answer, measured, sd):
    """The lab in three sentences."""
    second = answer["posterior_estimate_coefficients_2"]
    limit = "The variance after a measurement tends to {posterior:4} m² and the gain to {gain:4} ({eq:steady}); with every new measurement the weights of the old ones fall by the factor {left:3} ({fig:weights})." if p.Q and p.R else "The limits are zero ({eq:steady}): in the end the state is known after each measurement; {fig:weights} shows what each measurement weighs."
    return [
        text("After two measurements the estimate is a weighted mean of what was known before, of $z_1$ and of $z_2$, with the weights {mean:3}, {one:3} and {two:3}; each measurement adds the same information 1/R.",
             mean=1 - second[1] - second[2], one=second[1], two=second[2]),
        text(limit, posterior=answer["posterior_variance_steady"], gain=answer["gain_steady"], left=1 - answer["gain_steady"]),
        text("In the experiment the RMS error after two measurements was {measured}, where theory has {sd:4} m.", measured=measured, sd=sd),
    ]


def discussion(r, p):
    """What the numbers mean together."""
    r.says("**Information and variance.** A measurement adds 1/R to the information whatever was known ({eq:information}), but the variance that this removes is large where little was known and small where much was. So the second measurement removes less than the first unless the state has moved far in between.")
    if p.Q and p.R:
        r.says("**Forgetting.** Process noise devalues old measurements: the weight of a measurement that is $j$ steps old is $\\bar K(1-\\bar K)^j$, so the filter has a memory of about $1/\\bar K$ measurements ({fig:weights}). Without process noise all measurements would have the same weight, and the estimate would be a mean.")
    r.says("**Experiment.** A point of {fig:ensemble} outside the band is no fault: one in twenty is expected there, and errors of successive instants are correlated, so that such points come in groups. The exact tests are in {app:chance}.")


def answers():
    """Each item of the sheet in a sentence or two."""
    return {
        "a": "The estimates are {eq:first} and {eq:second}; variances and gains stand above them as exact fractions. Each measurement adds 1/R to the information ({tab:information}).",
        "b": "For any number of measurements the answer is {eq:information} and {eq:sum}, with the limits {eq:steady}. For vectors with $H = I$ the formulas are the same with matrices, and each measurement adds $R^{-1}$.",
        "c": "RMS, mean, NEES and NIS of the ensemble agree with (a) and (b) ({fig:ensemble}, {tab:ensemble}).",
    }


PARTS = Skeleton(
    result=result,
    key="weights",
    discussion=discussion, answers=answers,
    analysis=(part_a, part_b, weights, vectors),
    plan=plan,
    experiment=(part_c,),
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    answer, system = by_hand.analytic(p), model([p.x1_mean], [[by_hand.start(p)]], [[p.Q]], [[p.R]])
    count = max(p.steps, SIMULATED)
    return PARTS.report(META, p, experiment, answer=answer, system=system, N=min(count, LISTED), count=count)


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
