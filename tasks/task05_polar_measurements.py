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
from ctlabs.tasks._task05_pseudo import SIMULATED, STATES, STEP, UNITS, part_a, part_b, part_c, part_d, part_e
from ctlabs.tasks._task05_sensor import converted, cost, judge, polar, pseudo, small, trajectories
from ctlabs.tasks.answers import kinematics as one_coordinate
from ctlabs.tasks.answers import task05 as by_hand
from ctlabs.tasks.answers.task05 import LISTED

from ctlabs.analysis import sensitivity
from ctlabs.filtering import settling, steady, updates
from ctlabs.filtering.extended import Extended
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import agreement, largest, portrait
from ctlabs.labs.skeleton import Skeleton
from ctlabs.linalg.factors import factor, unit_triangular
from ctlabs.models import ContinuousModel, kinematics, symbolic
from ctlabs.models.discretisation import discretise
from ctlabs.reporting import plots
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
#: A ratio of variances from which variant 2 is called worth while.
WORTH = 1.02


class Parameters(LabParameters):
    """What may be changed."""

    D: Positive = given(1000.0, unit="m", meaning="range of the point at t0")
    theta: Real = given(math.pi / 6, unit="rad", meaning="bearing of the point at t0")
    sigma_D: Positive = given(10.0, unit="m", meaning="standard deviation of the range error")
    sigma_theta: Positive = given(0.03, unit="rad", meaning="standard deviation of the bearing error")
    sigma_w2: Positive = given(4.0, unit="m²/s³", meaning="diffusion σ_w² of both velocities")
    tau: Positive = given(1.0, unit="s", meaning="period of the measurements")


def system(p, R=None):
    """The discrete model at fixed geometry; the index of a measurement is its time."""
    R = covariance(p, *start(p)) if R is None else R
    return replace(discretise(continuous(p), p.tau, R), dt=1.0)


def start(p):
    """Position at t0."""
    return p.D * math.cos(p.theta), p.D * math.sin(p.theta)


def covariance(p, x, y):
    """R at one position (2, 2), or at several (…, 2, 2)."""
    R11, R22, R12, *_rest = pseudo(p, np.asarray(x, dtype=float), np.asarray(y, dtype=float))
    return np.moveaxis(np.array([[R11, R12], [R12, R22]]), (0, 1), (-2, -1))


def continuous(p):
    """Two independent Wiener velocities."""
    position, velocity = by_hand.spread(p)
    return ContinuousModel(
        F=np.kron(np.eye(2), [[0, 1], [0, 0]]), G=np.kron(np.eye(2), [[0], [1]]), Q=p.sigma_w2 * np.eye(2), H=np.kron(np.eye(2), [[1, 0]]),
        x0=[start(p)[0], 0, start(p)[1], 0], P0=np.diag([position, velocity] * 2), states=STATES, measurements=["z_x", "z_y"], units=UNITS,
    )


def variants(p, R=None):
    """The truth, which is what variant 2 believes, and the design of variant 1."""
    truth = system(p, R)
    return truth, replace(truth, R=truth.R * np.eye(2))


def model_part(r, p, answer, truth):
    """What task 3 (a), (b) asks, for the plane."""
    r.section("a", "The model (task 3 (a), (b) for the plane), and the errors of the pseudo-measurements")
    r.says("State (x, v_x, y, v_y): each velocity is a random constant plus a Brownian motion of diffusion σ_w², independent of the other, so that every matrix is block-diagonal with twice the block of task 3.")
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
        "t, τ": "t", "x": "x", "w": "w", "Q = σ_w² I": "Q", "F": "F", "G": "G", "H": "H", "x̄0": "x0", "P0, P": "P", "Φ": "Phi", "Q_d": "Qd", "w̄_d": "w_diagonal", "G_d": "Gd",
        "Q̄_d": "Qd_diagonal", "w̄": "w_standardised", "Ḡ_d": "Gd_standardised", "z, e_x, e_y": "z", "R, S": "R", "K": "K",
    }
    r.table("units", ["quantity", "SI unit, element by element"], [*((symbol, words(table[name])) for symbol, name in quantities.items()), ("D, e_D, σ_D", "m"), ("θ, e_θ, σ_θ", "rad = 1"), ("l21", "1"), ("d1, d2", "m²")],
            "Units of all constants and variables. Φ and G_d have zeros between x and y, whose units do not matter.")
    R = kinematics.converted(truth.R, table["R"], METRE, SECOND)
    changed = discretise(other, float(kinematics.converted(p.tau, table["t"], METRE, SECOND)), R)
    here, there = covariances(truth, LISTED), covariances(changed, LISTED)
    for name, value, again in (("Phi", truth.Phi, changed.Phi), ("Qd", truth.Qd, changed.Qd), ("Gd_standardised", factor(truth.Qd), factor(changed.Qd)), ("K", here.K[-1], there.K[-1]), ("P", here.P_plus[-1], there.P_plus[-1])):
        r.check(text("unit of {name}", name=name), again, kinematics.converted(value, table[name], METRE, SECOND), ("computed in other units", "converted by its unit"))
    r.says("**Check of the units:** everything is computed again with {metre} m as the unit of length and {second} s as that of time; each element changes as its unit says.", metre=METRE, second=SECOND)


def words(unit):
    """A unit, or a matrix of them, as words."""
    return str(unit) if isinstance(unit, kinematics.Unit) else [words(element) for element in unit]


def length(p):
    """Measurements at a changing geometry: until the point's own wandering reaches a quarter of D, at most SIMULATED."""
    position, velocity = by_hand.spread(p)
    t = p.tau * np.arange(1, SIMULATED + 1)
    return max(2, int((np.sqrt(position + velocity * t**2 + p.sigma_w2 * t**3 / 3) <= p.D / 4).sum()))


def plan(r, p, experiment, truth):
    """Every number chosen."""
    settled = settling(truth)
    steps = min(max(SIMULATED, 10 + (settled or SIMULATED)), 60)
    position, velocity = by_hand.spread(p)
    r.says("Parts (c) and (f) fix the geometry at D, θ: the pseudo-measurements are linear with a constant R, and theory and ensemble can be compared exactly. Part (g) uses the true sensor: polar noise, `atan2`, the conversion, and R at the geometry predicted by each filter at each measurement, on several trajectories. Both variants see the same random numbers throughout.")
    r.table("plan", ["quantity", "value", "why"], [
        ["measurements, fixed geometry", steps, "the transient and ten more"],
        ["measurements, true sensor", length(p), "fewer where the point would wander by more than D/4"],
        ["initial mean", list(truth.x0), "the point at D, θ, at rest"],
        ["initial σ: position, velocity", [math.sqrt(position), math.sqrt(velocity)], "√(σ_D² + D²σ_θ²), as good as one measurement; √(10σ_w²τ)"],
        ["factors", ", ".join(f"{name} ×{low:.3g}, ×{high:.3g}" for name, (low, high) in {"P0": (0.1, 10.0)} .items()) + ", " + ", ".join(f"{name} ×{low:.3g}, ×{high:.3g}" for name, (low, high) in LEVELS.items()), "initial state, disturbance, measurement errors, period: one at a time"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["seed", experiment.seed, "common random numbers for both variants"],
    ], "Plan of the experiment.")
    return {"steps": steps}


def part_f(r, p, answer, truth, experiment, steps):
    """Variant 2."""
    r.section("f", "Variant 2: decorrelated pseudo-measurements")
    r.says("**Theory.** The motion is the same in all directions, so axes along and across the radius may be taken instead of x and y. There the two errors are independent, $\\sigma_D^2$ and $D^2\\sigma_\\theta^2$, and with P0 the same in both directions the optimal filter falls apart into two filters of task 3. If $p(R)$ is a variance of such a filter,")
    r.math(r"P_x = \cos^2\theta\,p(\sigma_D^2) + \sin^2\theta\,p(D^2\sigma_\theta^2), \qquad P_y = \sin^2\theta\,p(\sigma_D^2) + \cos^2\theta\,p(D^2\sigma_\theta^2)")
    new = replace(updates.decorrelated(truth)[0], measurements=("z_x", "z_y'"))
    limit = steady.solve(new)
    listed = covariances(new, LISTED).P_plus
    r.value("posterior_variance_variant2", np.diagonal(listed[1:], axis1=1, axis2=2), "m², m²/s²", at=list(range(1, LISTED + 1)), agrees=answer, routes=("recursion", "two filters along and across the radius"))
    r.value("posterior_variance_steady_variant2", np.diag(limit.P_plus), "m², m²/s²", agrees=answer, routes=("Riccati equation", "spectral factorisation along and across the radius"))
    settled = settling(new)
    r.value("settling_step_variant2", settled, reason="not within 100 000 measurements", agrees=answer, routes=("recursion", "two filters along and across the radius"), kind=EXACT)
    portrait(r, experiment, new, steps, limits=(limit.P_minus[0, 0], limit.P_plus[0, 0]))
    r.says("It settles at measurement {settled} ({time} s).", settled=settled, time=None if settled is None else settled * p.tau)
    factors(r, p, experiment)


def factors(r, p, experiment):
    """One factor at a time, both variants."""
    r.says("**Factors**, both variants on the same data at fixed geometry; one factor at a time is changed.")
    cases = [("given", p, 1.0), *((f"P0 ×{level:g}", p, level) for level in (0.1, 10.0))]
    cases += [(f"{name} ×{level:.3g}", p.model_copy(update={name: level * getattr(p, name)}), 1.0) for name, levels in LEVELS.items() for level in levels]
    rows, found, expected = [], [], []
    for name, q, level in cases:
        truth, first = (replace(model, P0=level * model.P0) for model in variants(q))
        own = (sensitivity.steady(truth, first).P_plus, steady.solve(truth).P_plus)
        by = analytic_limits(q)
        found, expected = [*found, *(np.diag(P) / wanted for P, wanted in zip(own, by, strict=True))], [*expected, np.ones(4), np.ones(4)]
        settles = [settling(design) for design in (first, truth)]
        steps = min(max(s or 60 for s in settles) + 5, 60)
        stats = [experiment.statistics(truth, design, steps=steps) for design in (first, truth)]
        theory = [sensitivity.actual(truth, design, steps).P_plus for design in (first, truth)]
        worst = max(agreement(r, text("{name}, variant {n}", name=name, n=n), stats[n - 1], theory[n - 1], consistent=n == 2) for n in (1, 2))
        rows.append((name, *(list(np.sqrt(np.diag(P))) for P in own), list(np.diag(own[0]) / np.diag(own[1])), settles, list(stats[0].rms[-1]), list(stats[1].rms[-1]), worst))
    r.table("factors", ["case", "steady σ, variant 1", "steady σ, variant 2", "ratio of variances", "settling steps", "RMS, variant 1", "RMS, variant 2", "largest deviation, σ"], rows,
            "Limits, settling and ensembles (at their last measurement); elements in the order x, v_x, y, v_y; m and m/s.")
    r.check("limits of all cases, relative", found, expected, ("Lyapunov and Riccati equations", "spectral factorisation"))
    r.says("P0 acts on the approach only. A stronger disturbance or a longer period lets the filter lean on the last measurement; a larger difference between $\\sigma_D$ and $D\\sigma_\\theta$ makes the ellipse of R longer, and the neglected covariance costs more.")


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
    worth = bool(ratio.max() >= WORTH)
    r.value("verdict_g", worth)
    r.says("Here the ratios (variant 1 / variant 2 of x, v_x, y, v_y) are {ratio}. The verdict (worth while: {worth}) uses the criterion that some steady variance falls by a factor of at least {limit}.", ratio=list(ratio), worth=worth, limit=WORTH)
    angles = np.linspace(0, math.pi, 61)
    limits = [analytic_limits(p.model_copy(update={"theta": float(a)})) for a in angles]
    curves = {name: [a[j] / b[j] for a, b in limits] for j, name in enumerate(STATES)}
    r.figure("by_bearing", plots.lines(angles, curves, xlabel="θ, rad", ylabel="ratio of steady variances, variant 1 / 2", points={"given θ": ([p.theta % math.pi] * 4, ratio)}),
             "Steady variances of variant 1 over those of variant 2 against the bearing: 1 on the axes, most between them." if max(map(max, curves.values())) > 1 + 1e-9
             else "Steady variances of variant 1 over those of variant 2 against the bearing: 1 everywhere, as the errors along and across the radius are equal.")
    here = p.D * p.sigma_theta / p.sigma_D
    factors_of = np.geomspace(0.03, 30, 41)
    limits = [analytic_limits(p.model_copy(update={"theta": math.pi / 4, "sigma_theta": float(f) * p.sigma_D / p.D})) for f in factors_of]
    r.figure("by_ratio", plots.lines(factors_of, {"position": [a[0] / b[0] for a, b in limits], "velocity": [a[1] / b[1] for a, b in limits]}, xlabel="ratio of the errors across and along the radius, Dσ_θ/σ_D", ylabel="ratio of steady variances, variant 1 / 2", log="x",
                                     points={"given Dσ_θ/σ_D": ([here] * 2, [a / b for a, b in zip(*analytic_limits(p.model_copy(update={"theta": math.pi / 4})), strict=True)][:2])} if factors_of[0] <= here <= factors_of[-1] else None),
             "The same at θ = 45° against the ratio of the two errors (at constant σ_D): the longer the ellipse, the more its direction is worth. Black: the given ratio.")


def scaled(p, size):
    """Parameters of the noises times a factor."""
    return p.model_copy(update={"sigma_D": size * p.sigma_D, "sigma_theta": size * p.sigma_theta, "sigma_w2": size**2 * p.sigma_w2})


def along(p, velocity, steps):
    """The linear model on the nominal trajectory: R at its geometry at every instant."""
    t = p.tau * np.arange(steps + 1)
    motion = system(p, covariance(p, start(p)[0] + velocity[0] * t, start(p)[1] + velocity[1] * t))
    return replace(motion, x0=[start(p)[0], velocity[0], start(p)[1], velocity[1]])


def nonlinear(r, p, experiment):
    """The true sensor."""
    steps = length(p)
    r.says("**The true sensor.** Range and bearing are simulated with their own noise and converted; each filter takes R at the geometry it predicts. The errors are then not exactly Gaussian, and the linear theory on the nominal trajectory is an approximation. That the programme does what the theory says is tested where the approximation is exact: all noises and P0 are made smaller by one factor, until what is not linear is below a hundredth of a standard error.")
    size = small(p, experiment.runs, steps)
    names = list(trajectories(p, steps))
    if size is None:
        r.says("(Left out here: the factor would have to be so small that rounding of D would be seen.)")
    rows, shown = [], {}
    for n, (name, velocity) in enumerate(trajectories(p, steps).items()):
        theory = along(p, velocity, steps)
        P = [sensitivity.actual(theory, design, steps).P_plus for design in (replace(theory, R=theory.R * np.eye(2)), theory)]
        if size is not None and name == names[-1]:
            few, tiny = scaled(p, size), along(scaled(p, size), velocity, steps)
            for variant in (1, 2):
                stats = experiment.statistics(polar(few, tiny), converted(few, tiny, variant == 2), steps=steps, stream=9)
                agreement(r, text("true sensor, small noise, variant {n}", n=variant), stats, size**2 * P[variant - 1], consistent=False)
        stats = [experiment.statistics(polar(p, theory), converted(p, theory, variant == 2), steps=steps, stream=10 + n) for variant in (1, 2)]
        pair = experiment.statistics(polar(p, theory),
                                     lambda m=theory: updates.Together(*(Extended(converted(p, m, correlated)) for correlated in (False, True))),
                                     steps=steps, stream=10 + n, compare=np.vstack([np.eye(4), np.eye(4)]))
        shown[name] = (stats, P, updates.paired(pair.second_moment[-1], pair.runs))
        half = slice(steps // 2, None)
        for j, state in enumerate(STATES):
            means = [np.mean(each.rms[half, j] ** 2) for each in stats]
            believed = [np.mean(each[half, j, j]) for each in P]
            rows.append((name, f"{state}, {UNITS[j]}", stats[0].rms[-1, j], stats[1].rms[-1, j], max(each.rms_se[-1, j] for each in stats), math.sqrt(P[1][-1, j, j]), means[0] / means[1], believed[0] / believed[1]))
    r.table("true_sensor", ["trajectory", "state", "RMS, variant 1", "RMS, variant 2", "standard error", "σ of linear theory, variant 2", "ratio of mean squares", "in linear theory"], rows,
            "Actual errors with the true sensor, {runs} runs on the same data: at the last measurement, and the ratio of mean squares (variant 1 / variant 2) over the second half of the record.", runs=experiment.runs)
    stats, P, _scores = shown[names[-1]]
    i = np.arange(steps + 1)
    position = [np.sqrt(each.rms[:, 0] ** 2 + each.rms[:, 2] ** 2) for each in stats]
    believed = [np.sqrt(each[:, 0, 0] + each[:, 2, 2]) for each in P]
    r.figure("crossing", plots.lines(i, {"variant 1, true sensor": position[0], "variant 2, true sensor": position[1]}, xlabel=STEP, ylabel="RMS error of the position, m", steps=True, marker=".",
                                     straight={"linear theory": (i, believed[0]), "_": (i, believed[1])}),
             "Crossing trajectory: RMS of the position error of both variants with the true sensor, and linear theory (dashed).")
    judge(r, shown)


def conclusions(r, p):
    """What the numbers say."""
    values = {name: value.value for name, value in r.values.items()}
    rho, ratio, lines = values["correlation_coefficient"], np.array(values["variance_ratio_steady"]), []
    if values["verdict_b_independent"]:
        why = "the radius lies along an axis" if abs(math.sin(2 * p.theta)) < 1e-9 else "the errors along and across the radius are equal"
        lines.append(text("R12 = 0, because {why}: the pseudo-measurements are uncorrelated, variant 2 is variant 1, and all ratios are 1.", why=why))
    else:
        lines.append(text("The errors of the pseudo-measurements have the correlation coefficient {rho}; they are not independent, as the sheet calls them.", rho=rho))
        lines.append(text("At fixed geometry neglecting it raises the steady variances of x, v_x, y, v_y by the factors {ratio}: up to {percent} % in σ. By the criterion (a factor of {limit} in a variance) variant 2 is {worth}.",
                          ratio=list(ratio), percent=round(100 * (math.sqrt(ratio.max()) - 1), 2), limit=WORTH, worth="worth while" if values["verdict_g"] else "not worth while"))
    if values["verdict_b_independent"]:
        lines.append("Both filters have bounded errors although the motion has not. Where the point moves away from this geometry R12 appears along the way, as the crossing trajectory shows, unless $\\sigma_D = D\\sigma_\\theta$ stays true.")
    else:
        lines.append("Both filters have bounded errors although the motion has not; variant 1 gives its own variances rightly and is wrong about their correlation only, so nothing in its P warns of the loss.")
    cost = values["cost_of_update"]
    lines.append(text("Variant 2 costs {two} operations per update, variant 1 {one} as two small filters, the full R at once {both}: decorrelating first is {word} than inverting S.", two=cost[2], one=cost[0], both=cost[3], word="cheaper" if cost[2] < cost[3] else "not cheaper"))
    index = p.D * p.sigma_theta**2 / 2 / p.sigma_D
    lines.append(text("The bias that the conversion adds, $D\\sigma_\\theta^2/2$, is {index} of σ_D: {verdict}.", index=index,
                      verdict="first-order pseudo-measurements are good enough" if index < 0.1 else "the pseudo-measurements should be corrected for it, or an extended filter used on D and θ themselves"))
    lines.append(largest(r))
    r.items(lines)


PARTS = Skeleton(
    analysis=(model_part, part_a, part_b),
    plan=plan,
    experiment=(part_c, part_d, part_e, part_f, part_g, cost, nonlinear),
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    answer, (truth, first) = by_hand.analytic(p), variants(p)
    return PARTS.report(META, p, experiment, answer=answer, truth=truth, first=first)


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
