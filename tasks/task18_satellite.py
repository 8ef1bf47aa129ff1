r"""Lab 18. Which measurement of a satellite in a plane orbit.

Source: Semushin & Tsyganova 2001, task 18. r̈ = rΘ̇² − G/r² + u_r, Θ̈ = −2Θ̇ṙ/r + u_τ/r, x = (r, ṙ, Θ, Θ̇). The sheet asks
for (a) the linear equations of deviations from a nominal trajectory; (b) the same for a circular orbit; (c) whether the angle
or the range should be measured, whether both models are observable, and whether both measurements together gain anything;
(d) an experiment with plausible numbers and the three sets of measurements.

Expected answer: F = [[0,1,0,0],[3w²,0,0,2r0w],[0,0,0,1],[0,−2w/r0,0,0]], e^{Ft} by Clohessy & Wiltshire; ranks 4 (angle),
3 (range), 4 (both): the range never tells of a constant angle. At half a period between samples 3, 2, 4, at a full one 2, 1, 3.
"""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import sympy
from ctlabs.tasks import _task18_scales as scales
from ctlabs.tasks._task18_scales import MILD, STATES, TIME, UNITS, WORK
from ctlabs.tasks.answers import task18 as by_hand
from ctlabs.tasks.answers.task18 import LONG, RATES, SETS

from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import agreement, largest
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import DiscreteModel, linearisation, observability
from ctlabs.models.discretisation import discretise
from ctlabs.models.nonlinear import NonlinearModel
from ctlabs.reporting import plots
from ctlabs.reporting.params import Count, Covariance, LabParameters, Positive, PositiveOrNull, given
from ctlabs.reporting.report import EXACT, SOLVER, Report
from ctlabs.text import text

META = {
    "name": "task18",
    "title": "A satellite in a plane orbit: which measurement?",
    "source": "Semushin & Tsyganova 2001, task 18",
    "parts": ["a", "b", "c", "d"],
}

SQUARED = "m², m²/s², rad², rad²/s²"
#: Radians turned, at most: beyond, double precision no longer holds eight digits of the phase.
PHASES = 1e7
#: Bounds of the deviations that an extended filter moves, in natural units; it may take any angle.
LOWEST, HIGHEST = np.array([-0.7, -2, -np.inf, -0.9]), np.array([3, 2, np.inf, 2])


class Parameters(LabParameters):
    """What may be changed."""

    r0: Positive = given(7.0e6, unit="m", meaning="radius of the nominal circular orbit")
    w: PositiveOrNull = given(None, unit="rad/s", meaning="its angular rate; null: √(3.986004418e14/r0³), the Earth's")
    sigma_r: Positive = given(50.0, unit="m", meaning="standard deviation of the range measurement")
    sigma_theta: Positive = given(1e-4, unit="rad", meaning="standard deviation of the angle measurement")
    dt: Positive = given(60.0, unit="s", meaning="sampling period")
    steps: Count = given(200, unit="1", meaning="measurements")
    P0: Covariance(4) = given(((1e6, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1e-8, 0), (0, 0, 0, 1e-14)), unit="m, m/s, rad, rad/s", meaning="covariance of the deviations at t0")


@cache
def equations():
    """The sheet's equations for sympy, and the circular orbit as a trajectory in t."""
    r, speed, angle, turn, u_r, u_tau = sympy.symbols("r rdot Theta Thetadot u_r u_tau", real=True)
    G, r0, w, t = sympy.symbols("G r_0 w t", positive=True)
    dynamics = linearisation.Dynamics([speed, r * turn**2 - G / r**2 + u_r, turn, -2 * turn * speed / r + u_tau / r], [r, speed, angle, turn], [u_r, u_tau])
    circle = dynamics.at({r: r0, speed: 0, angle: w * t, turn: w, u_r: 0, u_tau: 0, G: r0**3 * w**2}, t)
    return dynamics, circle


def measured(p, rows=(0, 1)):
    """The linear model of the deviations with some of the measurements."""
    return linearisation.model(equations()[1], {"r_0": p.r0, "w": by_hand.rate(p)}, H=scales.seeing(rows), P0=p.P0, states=STATES, units=UNITS, measurements=[("z1", "z2")[row] for row in rows])


def designed(p, rows):
    """The linear model with both measurements, those not in the set marked as absent."""
    return discretise(replace(measured(p), B=None), p.dt, R=np.diag([scales.noise(p)[i, i] if i in rows else np.inf for i in (0, 1)]))


def nonlinear(p, flow, rows=(0, 1), *, bounded=False):
    """The nonlinear motion in deviations from the circular orbit, as a truth and (bounded) as the model of an extended filter.

    A filter far astray may put the satellite into the centre, where nothing is finite; bounds keep its deviations away from there.
    """
    circle, turned = np.array([[p.r0], [0], [0], [by_hand.rate(p)]]), np.array([[p.r0], [0], [by_hand.rate(p) * p.dt], [by_hand.rate(p)]])
    low, high = ((edge * by_hand.units(p))[:, None] for edge in ((LOWEST, HIGHEST) if bounded else (np.full(4, -np.inf), np.full(4, np.inf))))
    return NonlinearModel(
        f=lambda _k, x, _w: flow.f(circle + np.clip(x, low, high)) - turned, h=lambda _k, x, v: x[[2, 0]] + v,
        F=lambda _k, x: flow.F(circle + np.clip(x, low, high)), H=lambda _k, _x: scales.seeing((0, 1)),
        Qd=[[0.0]], R=np.diag([scales.noise(p)[i, i] if i in rows else np.inf for i in (0, 1)]), x0=np.zeros(4), P0=p.P0, dt=p.dt, states=STATES,
    )


def part_a(r, p):
    """Jacobians at any point."""
    r.section("a", "Deviations from any nominal trajectory")
    dynamics, _circle = equations()
    F, B = dynamics.jacobians()
    r.says("Let $x^*(t)$, $u^*(t)$ solve $\\dot{x} = f(x, u)$, $x = (r, \\dot{r}, \\Theta, \\dot{\\Theta})$. For small $\\delta x = x - x^*$, $\\delta u = u - u^*$ Taylor's formula leaves $\\delta\\dot{x} = F\\,\\delta x + B\\,\\delta u$ with the derivatives along the nominal,")
    r.math(f"F(t) = {scales.bracket(F)}, \\qquad B(t) = {scales.bracket(B)}")
    r.says("all at $x^*(t)$, $u^*(t)$: in general a model that varies with time. $\\Theta$ itself appears nowhere, for the field is central: a turn of the whole motion is again a motion.")
    w = by_hand.rate(p)
    point, u = np.array([1.3 * p.r0, 0.2 * p.r0 * w, 0.7, 0.8 * w]), np.array([0.03, -0.05]) * p.r0 * w**2
    values = dict(zip((*dynamics.states, *dynamics.inputs, sympy.Symbol("G", positive=True)), (*point, *u, p.r0**3 * w**2), strict=True))
    scale = np.concatenate([by_hand.units(p), [p.r0 * w**2] * 2]) / (by_hand.units(p)[:, None] * w)
    symbolic = np.array(F.row_join(B).subs(values).evalf(25).tolist(), dtype=float)
    r.check("F, B at a point of an eccentric orbit with thrust", symbolic * scale, by_hand.by_complex_step(point, u, p.r0**3 * w**2) * scale, ("sympy's derivatives", "complex step on the equations"), EXACT)


def part_b(r, p, answer):
    """The circular orbit."""
    r.section("b", "The circular orbit")
    _dynamics, circle = equations()
    w = by_hand.rate(p)
    r.says("$r = r_0$, $\\Theta = wt$, $u = 0$ solves the equations if and only if $G = r_0^3w^2$. There F and B are constant:")
    r.math(f"F = {scales.bracket(circle.F)}, \\qquad B = {scales.bracket(circle.B)}")
    r.says("For the Earth $w = \\sqrt{3.986004418 \\cdot 10^{14}/r_0^3}$ = {w} rad/s" if p.w is None else "Here w = {w} rad/s is given, so that $G = r_0^3w^2$ = {G} m³/s²", ", and one revolution takes {T} s, {n} sampling periods. No noise drives the state: $Q = 0$.", w=w, G=p.r0**3 * w**2, T=2 * math.pi / w, n=2 * math.pi / w / p.dt)
    model, scale = measured(p), by_hand.units(p)
    r.value("F", model.F, "1/s², 1/s, m, rad", agrees=answer, routes=("sympy's derivatives", "by hand"), kind=EXACT)
    ratio = scale / (scale[:, None] * w)
    r.check("F in natural units", model.F * ratio, RATES, ("sympy's derivatives", "by hand"), EXACT)
    r.check("B", model.B * p.r0, np.array(answer["B"]) * p.r0, ("sympy's derivatives", "by hand"), EXACT)
    r.says("In the units $r_0$, $r_0w$, 1 rad, $w$ every number of the orbit disappears. With $c = \\cos wt$, $s = \\sin wt$ the transition matrix in these units is that of Clohessy and Wiltshire,")
    r.math(r"\Phi(t) = \begin{bmatrix} 4 - 3c & s & 0 & 2 - 2c \\ 3s & c & 0 & 2s \\ 6s - 6wt & 2c - 2 & 1 & 4s - 3wt \\ 6c - 6 & -2s & 0 & 4c - 3 \end{bmatrix}, \qquad \text{eigenvalues of } F: 0, 0, \pm iw")
    r.says("An ellipse of period $2\\pi/w$ about a centre that moves forward at the rate $-\\frac32 C w$, $C = 4\\,\\delta r/r_0 + 2\\,\\delta\\dot{\\Theta}/w$: a higher orbit is slower, and this drift is the double eigenvalue 0.")
    for t in (p.dt, 10 * p.dt):
        found = discretise(model, t, R=scales.noise(p)).Phi * scale / scale[:, None]
        r.check(text("Φ over {t} s", t=t), found, by_hand.transition(math, w * t), ("matrix exponential", "Clohessy and Wiltshire"), SOLVER)
    times = np.linspace(0, 4 * math.pi / w, 201)
    start = np.sqrt(np.diag(p.P0)) * (scales.spread(p) / scales.relative(p, p.P0) if scales.far(p) else 1.0)
    bent, straight = by_hand.integrated(p, start, times), np.array([by_hand.transition(math, w * t) for t in times]) @ (start / scale)
    r.figure("orbit", plots.lines(
        p.r0 * bent[2], {"nonlinear equations": bent[0]}, xlabel="r0 δΘ, m", ylabel="δr, m",
        straight={"linear model": (straight[:, 2] * p.r0, straight[:, 0] * p.r0)}, points={"start": ([p.r0 * bent[2, 0]], [bent[0, 0]])},
    ), "Two revolutions in polar coordinates that go round with the nominal satellite (which stays at the origin): along the orbit and upwards, after a deviation of +σ in all four states {shrunk}. The linear model leaves the nonlinear one by {apart} m at most.",
        shrunk=text("(less than given: {share} of the orbit)", share=scales.spread(p)) if scales.far(p) else "", apart=float(np.hypot(bent[0] - straight[:, 0] * p.r0, p.r0 * bent[2] - straight[:, 2] * p.r0).max()))


def part_c(r, p, answer, schedules):
    """Ranks, variances, limits."""
    r.section("c", "The angle, the range, or both")
    w, routes = by_hand.rate(p), ("orthogonal steps in scaled units", "exact rank of [H; HF; HF²; HF³]")
    names = {"theta": "angle Θ only", "range": "range r only", "both": "both"}
    models = {name: measured(p, rows) for name, rows in SETS.items()}
    seen = {name: observability.analyse(model) for name, model in models.items()}
    for name in SETS:
        r.value(f"observability_rank_{name}", seen[name].rank, agrees=answer, routes=routes)
    r.says("**Observability.** With $z_1 = \\delta\\Theta$ the rows $H, HF, HF^2, HF^3$ are, in natural units, $[0,0,1,0]$, $[0,0,0,1]$, $[0,-2,0,0]$, $[-6,0,0,-4]$: rank 4. With $z_2 = \\delta r$ every row has a zero in the third place, for $F$ has a zero third column: rank 3, and the direction $\\delta\\Theta$ = const is never seen. Turning the orbit as a whole changes no range: the measured range fixes shape, size and phase of the ellipse of deviations, but not where on the orbit the satellite is. ∎")
    r.value("unobservable_direction_range", seen["range"].unobservable[:, 0], agrees=answer, routes=("orthogonal steps in scaled units", "zero column of F"))
    sampled = {name: [observability.loss_by_sampling(model, t) for t in (math.pi / w, 2 * math.pi / w, p.dt)] for name, model in models.items()}
    exact = ("orthogonal steps on the sampled pair", "exact rank with Clohessy and Wiltshire's Φ")
    r.value("observability_ranks_half_period", [sampled[name][0].rank for name in SETS], agrees=answer, routes=exact)
    r.value("observability_ranks_full_period", [sampled[name][1].rank for name in SETS], agrees=answer, routes=exact)
    r.table("ranks", ["measured", "continuous", "every half period", "every period", text("every {dt} s", dt=p.dt)],
            [(names[name], seen[name].rank, *(loss.rank for loss in losses)) for name, losses in sampled.items()],
            "Ranks of observability (4 is all). The eigenvalues ±iw meet at half a period, all four at a full one: samples so far apart show the satellite at the same phases only.")
    long_run(r, p, answer, schedules, w, names, sampled)


def long_run(r, p, answer, schedules, w, names, sampled):
    """Variances without process noise."""
    r.says("**Without process noise** the information only grows: with $\\Phi_k = \\Phi(t_k)$ and $P_0 = LL^T$")
    r.math(r"P(t_N^+) = \Phi_NL\left[I + L^T\sum_{k=1}^N(H\Phi_k)^TR^{-1}H\Phi_k\,L\right]^{-1}L^T\Phi_N^T")
    r.says("The noises of the samples have the variances {one} rad² and {two} m²; the sheet's strengths, for which samples every {dt} s are equivalent, are $R_1 = \\sigma_\\Theta^2dt$ = {R1} rad²·s and $R_2 = \\sigma_r^2dt$ = {R2} m²·s.", one=p.sigma_theta**2, two=p.sigma_r**2, dt=p.dt, R1=p.sigma_theta**2 * p.dt, R2=p.sigma_r**2 * p.dt)
    scale, both = np.outer(by_hand.units(p), by_hand.units(p)), ("recursion", "all measurements at once")
    for name, rows in SETS.items():
        P, wanted = schedules[name].P_plus[p.steps], answer["covariances"][name][0]
        r.value(f"posterior_variances_{name}", np.diag(P), SQUARED, agrees=answer, routes=both)
        r.check(text("correlations and relative variances, {name}", name=names[name]), scales.normal(P, scales.ruler(p, wanted)), scales.normal(wanted, scales.ruler(p, wanted)), both, SOLVER, scale=scales.known(p, wanted))
        H, R = scales.seeing(rows), np.diag(scales.noise(p, rows))
        sizes = np.diag(scales.ruler(p, wanted))
        short = np.sqrt(np.where(sizes > 0, sizes, 1.0))[:, None] / np.sqrt(R)
        r.check(text("last gain, {name}", name=names[name]), schedules[name].K[p.steps] / short, wanted @ H.T / R / short, ("recursion", "P⁺HᵀR⁻¹"), SOLVER, scale=scales.known(p, wanted) * max(1.0, float(np.abs(wanted @ H.T / R / short).max())))
        natural = covariances(in_natural_units(p, rows), p.steps).P_plus[-1] * scale
        r.check(text("units, {name}", name=names[name]), scales.normal(P, scales.ruler(p, wanted)), scales.normal(natural, scales.ruler(p, wanted)), ("recursion in m, m/s, rad, rad/s", "recursion in natural units"), SOLVER, scale=scales.known(p, wanted))
    r.table("variances", ["state", "σ at t0", *names.values()],
            [(f"{state}, {unit}", math.sqrt(p.P0[i][i]), *(schedules[name].sd_plus[p.steps, i] for name in SETS)) for i, (state, unit) in enumerate(zip(STATES, UNITS, strict=True))],
            "Standard deviations of the four errors after {n} measurements, {revolutions} revolutions.", n=p.steps, revolutions=p.steps * p.dt * w / 2 / math.pi)
    r.holds("both measurements are never worse", np.array([scales.normal(schedules[name].P_plus[k] - schedules["both"].P_plus[k], scales.ruler(p, schedules[name].P_plus[k])).diagonal() for name in ("theta", "range") for k in range(LONG * p.steps + 1)]), ("one measurement", "both measurements"), size=1e4 * max(scales.known(p, P) for values in answer["covariances"].values() for P in values))
    for i, (state, unit, word) in enumerate(zip(STATES, UNITS, ("r", "rdot", "theta", "thetadot"), strict=True)):
        curves = {names[name]: schedules[name].sd_plus[1 : p.steps + 1, i] for name in SETS}
        r.figure(f"sd_{word}", plots.lines(schedules["both"].t[1 : p.steps + 1], curves, xlabel=TIME, ylabel=f"σ({state}), {unit}", log=scales.logarithmic(curves)),
                 "Standard deviation of the error of {state} after each measurement, for the three sets.", state=state)
    ranks = {name: losses[2].rank for name, losses in sampled.items()}
    scales.limits(r, p, answer, schedules, names, ranks)
    scales.gained(r, p, schedules, names)
    r.value("verdict_c", ranks["theta"] > ranks["range"])
    r.value("verdict_c_both_observe_more", ranks["both"] > max(ranks["theta"], ranks["range"]))
    r.says("Criteria of the verdicts, at the sampling period {dt} s: whether the angle alone leaves less unobserved than the range alone (ranks {one} and {two}); whether both together observe more than the better of them (rank {three}).", dt=p.dt, one=ranks["theta"], two=ranks["range"], three=ranks["both"])


def in_natural_units(p, rows):
    """The sampled model with the states in units of r0, r0 w, 1 rad, w."""
    system, s = discretise(measured(p, rows), p.dt, R=scales.noise(p, rows)), by_hand.units(p)
    m = np.array([(1.0, p.r0)[row] for row in rows])
    return DiscreteModel(system.Phi * s / s[:, None], np.zeros((4, 4)), system.H * s / m[:, None], system.R / np.outer(m, m), x0=system.x0, P0=system.P0 / np.outer(s, s), dt=p.dt)


def part_d(r, p, experiment, trial):
    """Linear truth, small and full deviations in the nonlinear truth."""
    r.section("d", "Three sets of measurements on the same runs")
    names = {"theta": "angle only", "range": "range only", "both": "both"}
    r.says("**Linear truth.** The theory is exact here, and so are the tests.")
    linear(r, p, experiment, names)
    q, steps, parts = trial
    if parts > WORK:
        r.says("The sampling period is so long that the nonlinear motion cannot be followed within it in a sensible number of steps; the nonlinear part is left out.")
        return {"found": None}
    flow = linearisation.flow(equations()[0], {"G": p.r0**3 * by_hand.rate(p) ** 2}, p.dt, parts)
    start = 2 * np.sqrt(np.diag(q.P0))
    path, _transitions = flow.along(np.array([p.r0, 0, 0, by_hand.rate(p)]) + start, steps)
    nominal = np.outer(np.arange(steps + 1) * p.dt, [0, 0, by_hand.rate(p), 0]) + np.array([p.r0, 0, 0, by_hand.rate(p)])
    exact = by_hand.integrated(q, start, np.arange(steps + 1) * p.dt).T
    r.check("nonlinear motion from +2σ", (path - nominal) / by_hand.units(p), exact / by_hand.units(p), ("Runge and Kutta, order 4", "integrator of order 8 at tight tolerance"), SOLVER, scale=max(1.0, float(by_hand.rate(p) * p.dt * steps)))
    r.says("The nonlinear motion is followed by Runge and Kutta's method, {parts} steps a period. From a start of +2σ in all states it leaves an integrator of order 8 with tight tolerance by {error} m in r at most, where the smallest standard deviation of a filter is {least} m.",
           parts=parts, error=float(np.abs(path - nominal - exact)[:, 0].max()), least=float(covariances(designed(q, [0, 1]), steps).sd_plus[:, 0].min()))
    if not scales.regular(q):
        r.says("P0 is singular: both filters take some combinations of the states for exactly known for ever. On the nonlinear truth these combinations curve, however little, and an error against a variance of zero has no size; so the filters are not compared there (a start with small variances instead of zeros allows it).")
        return {"found": None}
    small(r, q, experiment, steps, parts, flow, names)
    return {"found": large(r, q, experiment, steps, flow, names)}


def linear(r, p, experiment, names):
    """The linear truth: one run, gains, errors, and the ensembles of the three sets."""
    truth, designs = designed(p, [0, 1]), {name: designed(p, rows) for name, rows in SETS.items()}
    both, some = covariances(truth, p.steps), experiment.histories(truth, steps=p.steps)
    r.figure("record", plots.record(some, xlabel=TIME, ylabel="δr, m", state=0, measurement=1), "One run: truth, measured range, and the estimate of δr from both measurements with its ±σ band.")
    r.figure("sawtooth", plots.sawtooth({"": covariances(truth, min(p.steps, 15))}, xlabel=TIME, ylabel="variance of δΘ, rad²", state=2), "Error variance of δΘ before and after each of the first updates, both measured.")
    sd, sigma = np.where(both.sd_plus > 0, both.sd_plus, 1.0), np.sqrt(np.diag(scales.noise(p)))
    gains = {f"{state} ← z{j + 1}": both.K[1:, i, j] * sigma[j] / sd[1:, i] for i, state in enumerate(STATES) for j in (0, 1)}
    r.figure("gain", plots.lines(both.t[1:], gains, xlabel=TIME, ylabel="relative gain Kσ(z)/σ(state)"), "Gains with both measurements, made comparable: the correction by an innovation as large as the measurement's σ, in standard deviations of the state.")
    r.figure("errors", plots.errors(some, xlabel=TIME, unit="rad", state=2, measurement=0), "Innovations of the angle, prediction and filtering errors of δΘ of 25 runs inside the bands of the theory.")
    for name, design in designs.items():
        stats, theory = experiment.statistics(truth, design, steps=p.steps), covariances(design, p.steps).P_plus
        agreement(r, names[name], stats, theory, consistent=scales.regular(p))
        if name == "both":
            r.figure("ensemble", plots.ensemble_against_theory(stats, theory, xlabel=TIME, units=UNITS, names=STATES), "RMS and mean of the filtering errors of {runs} runs against theory, in the bands of 95 % of ensembles; NEES and NIS averaged over the runs.", runs=experiment.runs)


def small(r, q, experiment, steps, parts, flow, names):
    """Deviations and noises so small that the equations are linear."""
    least = float((covariances(designed(q, [0, 1]), steps).sd_plus[-1] / by_hand.units(q)).min())
    bend = 4 * scales.relative(q, q.P0) ** 2 * (1 + 3 * by_hand.rate(q) * q.dt * steps)
    factor = min(1.0, 0.01 * least / bend) if bend and least else 1.0
    rounding = np.finfo(float).eps * math.sqrt(steps * parts) * (1 + 3 * by_hand.rate(q) * q.dt * steps)
    r.says("**Nonlinear truth, small deviations.** All σ (start and measurements) are multiplied by {factor}, so that the quadratic terms are below a hundredth of the smallest error; the gains stay the same. The linear filter (here with both measurements) must then be right on the nonlinear truth, up to the ensemble's chance.", factor=factor)
    if factor * least < 30 * rounding:  # its square, what the variances would be off by, must stay below 0.1 %
        r.says("(Left out here: the smallest error would be {share} of the orbit, and a position on the orbit is known in double precision to {rounding} of it after so many steps.)", share=factor * least, rounding=rounding)
        return
    tiny = q.model_copy(update={"P0": tuple(map(tuple, (np.array(q.P0) * factor**2).tolist())), "sigma_r": q.sigma_r * factor, "sigma_theta": q.sigma_theta * factor})
    design = designed(tiny, SETS["both"])
    stats = experiment.statistics(nonlinear(tiny, flow), design, steps=steps)
    agreement(r, text("small deviations, {name}", name=names["both"]), stats, covariances(design, steps).P_plus)


def large(r, q, experiment, steps, flow, names):
    """The deviations planned: linear and extended filter."""
    r.says("**Nonlinear truth, the deviations planned.** The linear filter keeps to the nominal orbit; the extended one linearises about its own estimate.")
    truth, found, rows, curves = nonlinear(q, flow), {}, [], {}
    for name, which in SETS.items():
        theory = covariances(designed(q, which), steps)
        plain = experiment.statistics(truth, designed(q, which), steps=steps)
        extended = experiment.statistics(truth, nonlinear(q, flow, which, bounded=True), steps=steps)
        # The quadratic term of a prediction against the noise, and that of the orbit's phase against 1.
        bend = scales.relative(q, theory.P_minus[1:]) ** 2 * (1 + 3 * by_hand.rate(q) * q.dt) / min(q.sigma_theta, q.sigma_r / q.r0)
        turn = (10 * scales.relative(q, q.P0) * (1 + by_hand.rate(q) * q.dt * steps)) ** 2
        index, tested = max(bend, turn), max(bend, turn) < MILD
        if tested:
            agreement(r, text("extended filter, {name}", name=names[name]), extended, theory.P_plus)
        found[name] = (plain, extended, theory, tested, index)
        for label, stats in (("linear", plain), ("extended", extended)):
            rows.append((names[name], label, *stats.rms[-1], stats.nees[-1], stats.nis[-1]))
            curves[text("{label}, {which}", label=label, which=names[name])] = stats.nees[1:]
        rows.append((names[name], "theory", *theory.sd_plus[-1], 4, len(which)))
    r.table("filters", ["measured", "filter", *(f"RMS({state}), {unit}" for state, unit in zip(STATES, UNITS, strict=True)), "NEES", "NIS"], rows,
            "RMS errors of both filters at the last of {n} measurements against the theory of small deviations.", n=steps)
    r.value("nees_linear", [found[name][0].nees[-1] for name in SETS])
    r.value("nees_extended", [found[name][1].nees[-1] for name in SETS])
    t = found["both"][0].t[1:]
    r.figure("nees", plots.lines(t, curves, xlabel=TIME, ylabel="NEES, average", log="y", straight={"consistent": (t, np.full(len(t), 4.0))}),
             "NEES of both filters with the three sets: 4 where a filter's covariance is true.")
    for i, word in ((0, "r"), (2, "theta")):
        some = {text("{label}, {which}", label=label, which=names[name]): found[name][j].rms[1:, i] for name in ("theta", "both") for j, label in enumerate(("linear", "extended"))}
        r.figure(f"rms_{word}", plots.lines(t, some, xlabel=TIME, ylabel=f"RMS({STATES[i]}), {UNITS[i]}", log=scales.logarithmic(some), straight={"theory, both": (t, found["both"][2].sd_plus[1:, i])}),
                 "RMS error of {state} of the linear and the extended filter on the nonlinear truth.", state=STATES[i])
    untested = [names[name] for name in SETS if not found[name][3]]
    r.says("Errors of a nonlinear filter are not exactly Gaussian, and its covariance is that of its own orbit. Two quadratic terms say how far this matters: $\\rho^2(1 + 3w\\,dt)/\\min(\\sigma_\\Theta, \\sigma_r/r_0)$, a prediction's against the noise (ρ: the largest relative prediction error), and $[10\\rho_0(1 + wT)]^2$, that of the orbit's phase (ρ0 at the start). The larger one is {index} for the three sets. Below {mild} the extended filter is held to the same tests as a linear one, whose bounds are wide against such terms; ",
           "so it is in all three cases." if not untested else "not tested: {untested}, where the table says how it does.",
           index=[found[name][4] for name in SETS], mild=MILD, untested=", ".join(untested))
    return found


def conclusions(r, p, answer, schedules, found):
    """What the numbers say."""
    sd = {name: schedules[name].sd_plus[p.steps] for name in SETS}
    better = [state for i, state in enumerate(STATES) if sd["theta"][i] < sd["range"][i]]
    worse = [state for i, state in enumerate(STATES) if sd["theta"][i] > sd["range"][i]]
    all_seen = observability.loss_by_sampling(measured(p, [0]), p.dt).rank == 4
    lines = [
        "The angle alone observes the whole state; the range alone leaves a constant angle unobserved for ever. By observability the angle is the better single measurement." if all_seen else
        "Continuously the angle alone would observe the whole state, the range alone all but a constant angle. At this sampling period even the angle loses a part, and the range loses more: the angle is the better single measurement, but the period is a bad one.",
        text("In numbers, after {n} measurements: {better}; {worse}.", n=p.steps,
             better=text("the angle alone is more accurate in {states}", states=", ".join(better)) if better else "the angle alone is more accurate in no state",
             worse=text("the range alone in {states}", states=", ".join(worse)) if worse else "the range alone in none"),
    ]
    ratios = [min(sd["theta"][i], sd["range"][i]) / sd["both"][i] if sd["both"][i] else 1.0 for i in range(4)]
    ranks = [observability.loss_by_sampling(measured(p, rows), p.dt).rank for rows in SETS.values()]
    lines.append(text("Both together add no new direction to what the angle observes" if ranks[2] == ranks[0] else "At this period both together observe {rank} directions, more than either", ", and they are more accurate: σ of the four states is smaller than that of the better single measurement by the factors {ratios}." if max(ratios) > 1.0005 else "; nor are they more accurate by anything worth mentioning.",
                      rank=ranks[2], ratios=[round(x, 3) for x in ratios]))
    lines.append(text("There is no process noise, so the variances of all that is observed tend to 0 and with them the gains; with the range only the angle's gain tends to {limit} rad/m instead, and its variance grows without bound.", limit=answer["gain_limit"]) if all_seen and scales.regular(p) else
                 "There is no process noise: what is observed becomes known better and better; what is not observed does not.")
    if found:
        bound = 4 * (1 + 6 * math.sqrt(0.5 / found["both"][0].runs))
        words = {"theta": "the angle", "range": "the range", "both": "both"}
        for j, label in enumerate(("linear", "extended")):
            ends = {name: found[name][j].nees[-1] / max(found[name][j].nees_dof[-1], 1) * 4 for name in SETS}
            wrong = [words[name] for name in SETS if ends[name] > bound]
            lines.append(text("On the nonlinear truth the NEES of the {label} filter ends at {ends} with the angle, the range, and both (4 is consistent): ",
                              "its variances are right." if not wrong else
                              "its variances are too small with {sets}, for it linearises about an orbit that is not the satellite's." if j == 0 else
                              "its variances are too small with {sets}, where its first estimates are too far from the truth to linearise about.",
                              sets=", ".join(wrong), label=label, ends=list(ends.values())))
    lines.append(largest(r))
    r.items(lines)


PARTS = Skeleton(
    analysis=(part_a, part_b, part_c),
    plan=scales.plan,
    experiment=(part_d,),
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    if by_hand.rate(p) * p.dt * LONG * p.steps > PHASES:
        msg = f"a phase w dt of {by_hand.rate(p) * p.dt:g} rad in a period, of which too few digits are left after {LONG * p.steps} periods"
        raise FloatingPointError(msg)
    answer = by_hand.analytic(p)
    schedules = {name: covariances(discretise(measured(p, rows), p.dt, R=scales.noise(p, rows)), LONG * p.steps) for name, rows in SETS.items()}
    return PARTS.report(META, p, experiment, answer=answer, schedules=schedules)


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
