r"""Lab 5. Motion in a plane, measured in polar coordinates.

Source: Semushin & Tsyganova 2001, task 5. Both velocities are random constants plus Brownian motions; range D and bearing θ are
measured every τ and turned into pseudo-measurements of x and y. The sheet asks first for the model as in task 3 (a), (b), then
for (a) the errors e_x, e_y to first order, (b) their covariance, (c) an experiment that neglects it (variant 1), (d) its LDLᵀ,
(e) decorrelated pseudo-measurements, (f) an experiment with them (variant 2), and (g) whether variant 2 is worth while.

Expected answer: e_x = cosθ·e_D − D sinθ·e_θ, e_y = sinθ·e_D + D cosθ·e_θ, which are not independent (the sheet calls them so):
R12 = sinθ cosθ(σ_D² − D²σ_θ²). z' = L⁻¹z needs H' = L⁻¹H too. At fixed geometry no variance of variant 2 is above that of
variant 1, and they are equal iff R12 = 0.
"""

import math
from dataclasses import replace

import numpy as np
import sympy
from ctlabs.tasks._task05_model import LETTERS, SIMULATED, STEP, UNITS, continuous, covariance, length, start, variants
from ctlabs.tasks._task05_pseudo import part_a, part_b, part_c, part_d, part_e
from ctlabs.tasks._task05_sensor import cost, nonlinear
from ctlabs.tasks._task05_words import answers, conclusions, discussion, result, verdict
from ctlabs.tasks.answers import kinematics as one_coordinate
from ctlabs.tasks.answers import task05 as by_hand
from ctlabs.tasks.answers.task05 import LISTED

from ctlabs.analysis import sensitivity
from ctlabs.filtering import settling, steady, updates
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import agreement, portrait, rms
from ctlabs.labs.skeleton import Skeleton
from ctlabs.linalg.factors import factor, unit_triangular
from ctlabs.models import kinematics, symbolic
from ctlabs.models.discretisation import discretise
from ctlabs.reporting import plots
from ctlabs.reporting.draws import one_of, span
from ctlabs.reporting.params import LabParameters, Positive, Real, given
from ctlabs.reporting.report import EXACT, Report
from ctlabs.text import text

META = {
    "name": "task05",
    "title": "Motion in a plane, measured in polar coordinates",
    "source": "Semushin & Tsyganova 2001, task 5",
    "parts": ["a", "b", "c", "d", "e", "f", "g"],
}

SIGMA, TAU = sympy.symbols("sigma_w tau", positive=True)
#: Other units of length (m) and time (s), for the check of the units.
METRE, SECOND = 3.7, 0.23
#: Factors of the experiment and their levels.
LEVELS = {"sigma_w2": (0.1, 10.0), "sigma_D": (1 / 3, 3.0), "sigma_theta": (1 / 3, 3.0), "tau": (0.5, 2.0)}
SYMBOLS = {"sigma_w2": "$\\sigma_w^2$", "sigma_D": "$\\sigma_D$", "sigma_theta": "$\\sigma_\\theta$", "tau": "τ"}
NAMES = {"sigma_w2": "disturbance", "sigma_D": "error of range", "sigma_theta": "error of bearing", "tau": "period"}


class Parameters(LabParameters):
    """What may be changed."""

    D: Positive = given(1000.0, unit="m", meaning="range of the point at t0", draw=span(800, 2000, 100))
    theta: Real = given(math.pi / 6, unit="rad", meaning="bearing of the point at t0", draw=one_of(*(k * math.pi / 36 for k in (4, 5, 6, 7, 8, 10, 11, 12, 13, 14))))
    sigma_D: Positive = given(10.0, unit="m", meaning="standard deviation of the range error", draw=span(6, 16, 1))
    sigma_theta: Positive = given(0.03, unit="rad", meaning="standard deviation of the bearing error", draw=span(0.02, 0.04, 0.005))
    sigma_w2: Positive = given(4.0, unit="m²/s³", meaning="diffusion of both velocities", draw=span(2, 8, 0.5))
    tau: Positive = given(1.0, unit="s", meaning="period of the measurements", draw=one_of(0.5, 1, 2))


def model_part(r, p, answer, truth):
    """What task 3 (a), (b) asks, for the plane."""
    r.section("a", "The model of lab 3 for the plane, and the errors of the pseudo-measurements")
    r.says("The state is $(x, v_x, y, v_y)$. Each velocity is a random constant plus a Brownian motion of diffusion $\\sigma_w^2$, independent of the other, so that every matrix has the block of lab 3 twice on its diagonal and zeros elsewhere. As there, the noise of a period is written with independent elements, $Q_d = G_d\\bar Q_dG_d^T$ with a unit lower triangular $G_d$, and with elements of variance 1 {ref:maybeck, section 4.9}.")
    chain = symbolic.chain(np.kron(np.eye(2, dtype=int), [[0, 1], [0, 0]]), np.kron(np.eye(2, dtype=int), [[0], [1]]), [[SIGMA**2, 0], [0, SIGMA**2]], TAU)
    for equation in chain.latex():
        r.math(equation)
    r.math(r"x(t_{i+1}) = \Phi x(t_i) + G_d\bar w_d(t_i) = \Phi x(t_i) + \bar G_d\bar w(t_i), \qquad E[\bar w\bar w^T] = I")
    r.model(truth)
    lower, variances = unit_triangular(truth.Qd)
    routes = ("matrix exponential by doubling", "closed form")
    r.value("Phi", truth.Phi, "SI", agrees=answer, routes=routes, kind=EXACT)
    r.value("Qd", truth.Qd, "SI", agrees=answer, routes=routes, kind=EXACT)
    routes = ("LDLᵀ in floating point", "closed form")
    r.value("unit_lower_factor", lower, "SI", agrees=answer, routes=routes, kind=EXACT)
    r.value("diagonal_noise_variances", variances, "SI", agrees=answer, routes=routes, kind=EXACT)
    r.value("standardised_noise_factor", factor(truth.Qd), "SI", agrees=answer, routes=("Cholesky factor in floating point", "closed form"), kind=EXACT)
    r.check("Q_d of the chain", chain.evaluate(sigma_w=math.sqrt(p.sigma_w2), tau=p.tau).Qd, truth.Qd, ("symbolic chain", "matrix exponential by doubling"), EXACT)
    table, other = kinematics.units(continuous(p)), kinematics.rescaled(continuous(p), METRE, SECOND)
    quantities = {
        "t, τ": "t", "x": "x", "w": "w", "Q = σ²I": "Q", "F": "F", "G": "G", "H": "H", "x̄₀": "x0", "$P_0$, P": "P", "Φ": "Phi", "$Q_d$": "Qd", "$\\bar w_d$": "w_diagonal", "$G_d$": "Gd",
        "$\\bar Q_d$": "Qd_diagonal", "w̄": "w_standardised", "$\\bar G_d$": "Gd_standardised", "z and its errors": "z", "R, S": "R", "K": "K",
    }
    r.says("{tab:units} gives the unit of every constant and variable.")
    r.table("units", ["quantity", "SI unit, element by element"], [*((symbol, words(table[name])) for symbol, name in quantities.items()), ("range D, its error and σ", "m"), ("bearing θ, its error and σ", "rad = 1"), ("$l_{21}$", "1"), ("$d_1$, $d_2$", "m²")],
            "Units of all constants and variables. Φ and $G_d$ have zeros between x and y, whose units do not matter.")
    R = kinematics.converted(truth.R, table["R"], METRE, SECOND)
    changed = discretise(other, float(kinematics.converted(p.tau, table["t"], METRE, SECOND)), R)
    here, there = covariances(truth, LISTED), covariances(changed, LISTED)
    for name, value, again in (("Phi", truth.Phi, changed.Phi), ("Qd", truth.Qd, changed.Qd), ("Gd_standardised", factor(truth.Qd), factor(changed.Qd)), ("K", here.K[-1], there.K[-1]), ("P", here.P_plus[-1], there.P_plus[-1])):
        r.check(text("unit of {name}", name=name), again, kinematics.converted(value, table[name], METRE, SECOND), ("computed in other units", "converted by its unit"))
    r.says("**Check of the units.** Everything is computed again with {metre} m as the unit of length and {second} s as that of time, and each element changes as its unit requires.", metre=METRE, second=SECOND)


def words(unit):
    """A unit, or a matrix of them, as words."""
    return str(unit) if isinstance(unit, kinematics.Unit) else [words(element) for element in unit]


def plan(r, p, experiment, truth):
    """Every number chosen."""
    settled = settling(truth)
    steps = min(max(SIMULATED, 10 + (settled or SIMULATED)), 60)
    position, velocity = by_hand.spread(p)
    speed = p.D / (length(p) * p.tau)
    r.says("Parts (c) and (f) fix the geometry at D, θ: the pseudo-measurements are linear with a constant R, and theory and ensemble can be compared exactly. Part (g) uses the true sensor: range and bearing with their own noise, the conversion, and R at the geometry that each filter predicts at each measurement, on three trajectories. All filters see the same random numbers. {tab:plan} has the numbers.")
    r.table("plan", ["quantity", "value", "why"], [
        ["measurements, fixed geometry", steps, "the transient and ten more"],
        ["measurements, true sensor", length(p), "fewer where the point would wander by more than D/4"],
        ["mean velocity, true sensor", text("at rest: 0; approaching: {half} m/s towards the sensor; crossing: {speed} m/s across the radius", half=0.5 * speed, speed=speed), "three trajectories: over the run the distance to the sensor is kept, halved, or grows to $\\sqrt2D$ as the bearing turns"],
        ["initial mean, fixed geometry", text("{x} m, 0 m/s, {y} m, 0 m/s", x=truth.x0[0], y=truth.x0[2]), "the point at D, θ, at rest"],
        ["initial σ: position, velocity", text("{position} m, {velocity} m/s", position=math.sqrt(position), velocity=math.sqrt(velocity)), "as good as one measurement, $\\sqrt{\\sigma_D^2 + D^2\\sigma_\\theta^2}$; $\\sqrt{10\\sigma_w^2\\tau}$"],
        ["factors", "initial state ×0.1, ×10; disturbance ×0.1, ×10; each measurement error ×⅓, ×3; period ×½, ×2", "one at a time"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["seed", experiment.seed, "common random numbers for both variants"],
    ], "Plan of the experiment.")
    return {"steps": steps}


def part_f(r, p, answer, truth, first, experiment, steps):
    """Variant 2."""
    r.section("f", "Variant 2: decorrelated pseudo-measurements")
    r.says("**Theory.** The motion is the same in all directions, so axes along and across the radius may be taken instead of x and y. There the two errors are independent, $\\sigma_D^2$ and $D^2\\sigma_\\theta^2$, and with $P_0$ the same in both directions the optimal filter separates into two filters of lab 3. If $p(R)$ is a variance of such a filter,")
    r.math(r"P_x = \cos^2\theta\,p(\sigma_D^2) + \sin^2\theta\,p(D^2\sigma_\theta^2), \qquad P_y = \sin^2\theta\,p(\sigma_D^2) + \cos^2\theta\,p(D^2\sigma_\theta^2)")
    new = replace(updates.decorrelated(truth)[0], measurements=("z_x", "z_y'"))
    limit = steady.solve(new)
    listed = covariances(new, LISTED).P_plus
    r.value("posterior_variance_variant2", np.diagonal(listed[1:], axis1=1, axis2=2), "m², m²/s²", at=list(range(1, LISTED + 1)), agrees=answer, routes=("recursion", "two filters along and across the radius"))
    r.value("posterior_variance_steady_variant2", np.diag(limit.P_plus), "m², m²/s²", agrees=answer, routes=("Riccati equation", "spectral factorisation along and across the radius"))
    settled = settling(new)
    r.value("settling_step_variant2", settled, reason="not within 100 000 measurements", agrees=answer, routes=("recursion", "two filters along and across the radius"), kind=EXACT)
    stats, counted = portrait(r, experiment, new, steps, figures={}), covariances(new, steps)
    r.figure("ensemble", plots.ensemble_log(stats, counted.P_plus, xlabel=STEP, units=UNITS, names=LETTERS),
             "Variant 2 at fixed geometry, {runs} runs against theory: RMS errors on logarithmic axes, mean errors in units of σ, NEES and NIS, in the bands of 95 % of ensembles.", runs=experiment.runs)
    last = counted.sd_plus[-1]
    r.says("{fig:ensemble} compares the ensemble with theory. At the last measurement the RMS errors of x and y are {x} and {y}, in theory {sd_x:4} and {sd_y:4} m.", x=rms(stats, unit="m"), y=rms(stats, state=2, unit="m"), sd_x=last[0], sd_y=last[2])
    if settled is None:
        r.says("The filter does not settle within 100 000 measurements.")
    else:
        r.says("The filter settles (all variances within 1 % of their limits) at measurement {settled}, after {time} s.", settled=settled, time=settled * p.tau)
    loss(r, truth, first, stats, experiment, steps)
    factors(r, p, experiment)


def loss(r, truth, first, stats, experiment, steps):
    """What variant 1 gives away along the measurements."""
    own, other = sensitivity.actual(truth, first, steps).P_plus, covariances(truth, steps).P_plus
    again = experiment.statistics(truth, first, steps=steps)
    i = np.arange(steps + 1)
    curves = {letter: own[:, j, j] / other[:, j, j] for j, letter in enumerate(LETTERS)}
    points = {f"ensemble, {LETTERS[j]}": (i, (again.rms[:, j] / stats.rms[:, j]) ** 2) for j in (1,)}
    r.figure("loss", plots.lines(i, curves, xlabel=STEP, ylabel="ratio of variances, variant 1 / 2", steps=True, marker=".", points=points),
             "Error variances of variant 1 over those of variant 2 along the measurements, in theory, and for $v_x$ in the ensembles on the same data.")
    r.says("{fig:loss} shows what is given away by neglecting $R_{12}$: the ratios begin at 1, where both filters know the same, and end at the steady ratios of part (g). On the way they may be larger: as long as the velocity is poorly known, what the other coordinate tells is worth more. The points of $v_x$ are ratios of two errors on the same data, and so they scatter less than either of the two." if abs(truth.R[0, 1]) > 1e-12 * truth.R[0, 0]
           else "{fig:loss} is a row of ones: $R_{12} = 0$, and both filters are the same.")


def factors(r, p, experiment):
    """One factor at a time, both variants."""
    cases = [("given", "given", p, 1.0), *((f"P0 ×{level:g}", f"$P_0$ ×{level:g}", p, level) for level in (0.1, 10.0))]
    cases += [(f"{text(NAMES[name])} ×{level:.3g}", f"{SYMBOLS[name]} ×{level:.3g}", p.model_copy(update={name: level * getattr(p, name)}), 1.0) for name, levels in LEVELS.items() for level in levels]
    rows, ratios, found, expected = [], [], [], []
    for name, shown, q, level in cases:
        truth, first = (replace(model, P0=level * model.P0) for model in variants(q))
        own = (sensitivity.steady(truth, first).P_plus, steady.solve(truth).P_plus)
        by = analytic_limits(q)
        found, expected = [*found, *(np.diag(P) / wanted for P, wanted in zip(own, by, strict=True))], [*expected, np.ones(4), np.ones(4)]
        settles = [settling(design) for design in (first, truth)]
        steps = min(max(s or 60 for s in settles) + 5, 60)
        stats = [experiment.statistics(truth, design, steps=steps) for design in (first, truth)]
        theory = [sensitivity.actual(truth, design, steps).P_plus for design in (first, truth)]
        for n in (1, 2):
            agreement(r, text("{name}, variant {n}", name=name, n=n), stats[n - 1], theory[n - 1], consistent=n == 2)
        ratio = np.diag(own[0]) / np.diag(own[1])
        rows.append((shown, math.sqrt(own[0][0, 0]), rms(stats[0]), math.sqrt(own[1][0, 0]), rms(stats[1]), *(s or "—" for s in settles)))
        ratios.append((shown, *ratio))
    r.says("**Factors.** {tab:factors} and {tab:factor_ratios} repeat both experiments with one factor changed at a time. $P_0$ acts on the approach only. The disturbance and the period decide how much of a measurement's error stays in the estimate; the two measurement errors decide the shape of the ellipse, and the longer it is, the more the neglected covariance costs.")
    r.table("factors", ["case", "σ of x, variant 1, m", "RMS, m", "σ of x, variant 2, m", "RMS, m", "variant 1 settles at", "variant 2 settles at"], rows,
            "Limits of σ, RMS errors of the ensembles at their last measurement, and the measurement from which all variances stay within 1 % of their limits.")
    r.table("factor_ratios", ["case", *(text("ratio of {state}", state=letter) for letter in LETTERS)], ratios, "Steady variances of variant 1 over those of variant 2.")
    r.check("limits of all cases, relative", found, expected, ("Lyapunov and Riccati equations", "spectral factorisation"))


def analytic_limits(p):
    """Steady variances of both variants from those of one coordinate."""
    R = covariance(p, *start(p))
    along, across = (np.diag(one_coordinate.steady_state(2, p.sigma_w2, p.tau, variance)[1]) for variance in (p.sigma_D**2, (p.D * p.sigma_theta) ** 2))
    own = [np.diag(one_coordinate.steady_state(2, p.sigma_w2, p.tau, variance)[1]) for variance in np.diag(R)]
    return np.concatenate(own), by_hand.turned(along, across, p.theta)


def part_g(r, p, answer, truth, first):
    """Comparison at fixed geometry."""
    r.section("g", "Is variant 2 worth while?")
    r.says("**Fixed geometry, proof.** Variant 1 has $P_x = p(R_{11})$ with $R_{11} = \\cos^2\\theta\\,\\sigma_D^2 + \\sin^2\\theta\\,D^2\\sigma_\\theta^2$. For a constant gain the error variance is linear in R, and p(R) is its minimum over all gains; a minimum of linear functions is concave, hence")
    r.math(r"p(\cos^2\theta\,\sigma_D^2 + \sin^2\theta\,D^2\sigma_\theta^2) \ge \cos^2\theta\,p(\sigma_D^2) + \sin^2\theta\,p(D^2\sigma_\theta^2)")
    r.says("and likewise for y and the velocities. As the optimal gain changes with R, p is strictly concave, and equality needs $\\sin\\theta\\cos\\theta = 0$ or $\\sigma_D = D\\sigma_\\theta$, that is $R_{12} = 0$. ∎")
    one, other = sensitivity.steady(truth, first).P_plus, steady.solve(truth).P_plus
    ratio = np.diag(one) / np.diag(other)
    r.value("variance_ratio_steady", ratio, agrees=answer, routes=("Lyapunov and Riccati equations", "closed forms of one coordinate"))
    r.holds("no variance of variant 2 is above that of variant 1", np.diag(one - other) / np.diag(other) + 1e-9, ("Lyapunov equation", "Riccati equation"), size=1.0)
    r.says("Here the steady variances of variant 1 are above those of variant 2 by the factors {x:5} in x, {vx:5} in $v_x$, {y:5} in y and {vy:5} in $v_y$. {fig:by_bearing} and {fig:by_ratio} show what they depend on: nothing is lost where the radius lies along an axis or where the errors along and across it are equal, and most where it lies between the axes and the ellipse is long.",
           **dict(zip(("x", "vx", "y", "vy"), ratio, strict=True)))
    angles = np.linspace(0, math.pi, 61)
    limits = [analytic_limits(p.model_copy(update={"theta": float(a)})) for a in angles]
    curves = {name: [a[j] / b[j] for a, b in limits] for j, name in enumerate(LETTERS)}
    r.figure("by_bearing", plots.lines(np.degrees(angles), curves, xlabel="bearing θ, °", ylabel="ratio of steady variances, variant 1 / 2", points={"given θ": ([math.degrees(p.theta % math.pi)] * 4, ratio)}),
             "Steady variances of variant 1 over those of variant 2 against the bearing: 1 on the axes, most between them." if max(map(max, curves.values())) > 1 + 1e-9
             else "Steady variances of variant 1 over those of variant 2 against the bearing: 1 everywhere, as the errors along and across the radius are equal.")
    here = p.D * p.sigma_theta / p.sigma_D
    factors_of = np.geomspace(0.03, 30, 41)
    limits = [analytic_limits(p.model_copy(update={"theta": math.pi / 4, "sigma_theta": float(f) * p.sigma_D / p.D})) for f in factors_of]
    r.figure("by_ratio", plots.lines(factors_of, {"position": [a[0] / b[0] for a, b in limits], "velocity": [a[1] / b[1] for a, b in limits]}, xlabel="ratio of the errors across and along the radius, $D\\sigma_\\theta/\\sigma_D$", ylabel="ratio of steady variances, variant 1 / 2", log="x",
                                     points={"given ratio": ([here] * 2, [a / b for a, b in zip(*analytic_limits(p.model_copy(update={"theta": math.pi / 4})), strict=True)][:2])} if factors_of[0] <= here <= factors_of[-1] else None),
             "The same at θ = 45° against the ratio of the two errors, that of the range being kept: the longer the ellipse, the more it helps to know its direction. Black: the given ratio.")


PARTS = Skeleton(
    result=result,
    key="crossing",
    analysis=(model_part, part_a, part_b),
    plan=plan,
    experiment=(part_c, part_d, part_e, part_f, part_g, cost, nonlinear, verdict),
    discussion=discussion,
    answers=answers,
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    answer, (truth, first) = by_hand.analytic(p), variants(p)
    return PARTS.report(META, p, experiment, answer=answer, truth=truth, first=first)


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
