r"""Lab 18. Which measurement of a satellite in a plane orbit.

Source: Semushin & Tsyganova 2001, task 18. r̈ = rΘ̇² − G/r² + u_r, Θ̈ = −2Θ̇ṙ/r + u_τ/r, x = (r, ṙ, Θ, Θ̇). The sheet asks
for (a) the linear equations of deviations from a nominal trajectory; (b) the same for a circular orbit; (c) whether the angle
or the range should be measured, whether both models are observable, and whether both measurements together gain anything;
(d) an experiment with plausible numbers and the three sets of measurements.

Expected answer: F = [[0,1,0,0],[3w²,0,0,2r0w],[0,0,0,1],[0,−2w/r0,0,0]], e^{Ft} by Clohessy & Wiltshire; ranks 4 (angle),
3 (range), 4 (both): the range never tells of a constant angle. At half a period between samples 3, 2, 4, at a full one 2, 1, 3.
"""

import math

import numpy as np
import sympy
from ctlabs.tasks import _task18_scales as scales
from ctlabs.tasks._task18_experiment import part_d
from ctlabs.tasks._task18_models import equations, in_natural_units, measured
from ctlabs.tasks._task18_scales import LOOKS, NAMES, STATES, TURNS, UNITS, revolutions
from ctlabs.tasks._task18_words import answers, conclusions, discussion, result
from ctlabs.tasks.answers import task18 as by_hand
from ctlabs.tasks.answers.task18 import LONG, RATES, SETS

from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import observability
from ctlabs.models.discretisation import discretise
from ctlabs.reporting.drawing import Curve, Drawing, Panel
from ctlabs.reporting.draws import one_of, span
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


class Parameters(LabParameters):
    """What may be changed."""

    r0: Positive = given(7.0e6, unit="m", meaning="radius of the nominal circular orbit", draw=one_of(*(k * 1e5 for k in range(67, 81))))
    w: PositiveOrNull = given(None, unit="rad/s", meaning="its angular rate; where none is given, $\\sqrt{3.986004418\\cdot10^{14}/r_0^3}$, the Earth's")
    sigma_r: Positive = given(50.0, unit="m", meaning="standard deviation of the range measurement", draw=span(30, 100, 5))
    sigma_theta: Positive = given(1e-4, unit="rad", meaning="standard deviation of the angle measurement", symbol=r"\sigma_\Theta", draw=one_of(5e-5, 1e-4, 1.5e-4, 2e-4))
    dt: Positive = given(60.0, unit="s", meaning="sampling period", draw=one_of(40, 50, 60, 70))
    steps: Count = given(200, unit="1", meaning="number of measurements", symbol="N")
    P0: Covariance(4) = given(((1e6, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1e-8, 0), (0, 0, 0, 1e-14)), unit="m, m/s, rad, rad/s", meaning="covariance of the deviations at t0")


def part_a(r, p):
    """Jacobians at any point."""
    r.section("a", "Deviations from any nominal trajectory")
    dynamics, _circle = equations()
    F, B = dynamics.jacobians()
    r.says("Let $x^*(t)$, $u^*(t)$ solve $\\dot{x} = f(x, u)$, $x = (r, \\dot{r}, \\Theta, \\dot{\\Theta})$. For small $\\delta x = x - x^*$, $\\delta u = u - u^*$ Taylor's formula leaves $\\delta\\dot{x} = F\\,\\delta x + B\\,\\delta u$ with the derivatives along the nominal ({ref:maybeck, section 2.2}),")
    r.math(f"F(t) = {scales.bracket(F)}, \\qquad B(t) = {scales.bracket(B)}", "any")
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
    r.says("$r = r_0$, $\\Theta = wt$, $u = 0$ solves the equations if and only if $G = r_0^3w^2$. There $F$ and $B$ are constant:")
    r.math(f"F = {scales.bracket(circle.F)}, \\qquad B = {scales.bracket(circle.B)}", "circle")
    r.says("For the Earth $w = \\sqrt{3.986004418 \\cdot 10^{14}/r_0^3}$ = {w} rad/s" if p.w is None else "Here $w$ = {w} rad/s is given, so that $G = r_0^3w^2$ = {G} m³/s²", ", and one revolution takes {T:4} s, {n:4} sampling periods. No noise drives the state: $Q = 0$.", w=w, G=p.r0**3 * w**2, T=2 * math.pi / w, n=2 * math.pi / w / p.dt)
    model, scale = measured(p), by_hand.units(p)
    r.value("F", model.F, "1/s², 1/s, m, rad", agrees=answer, routes=("sympy's derivatives", "by hand"), kind=EXACT)
    ratio = scale / (scale[:, None] * w)
    r.check("F in natural units", model.F * ratio, RATES, ("sympy's derivatives", "by hand"), EXACT)
    r.check("B", model.B * p.r0, np.array(answer["B"]) * p.r0, ("sympy's derivatives", "by hand"), EXACT)
    r.says("In the units $r_0$, $r_0w$, 1 rad, $w$ every number of the orbit disappears. With $c = \\cos wt$, $s = \\sin wt$ the transition matrix in these units is that of Clohessy and Wiltshire ({ref:clohessy_wiltshire}),")
    r.math(r"\Phi(t) = \begin{bmatrix} 4 - 3c & s & 0 & 2 - 2c \\ 3s & c & 0 & 2s \\ 6s - 6wt & 2c - 2 & 1 & 4s - 3wt \\ 6c - 6 & -2s & 0 & 4c - 3 \end{bmatrix}, \qquad \text{eigenvalues of } F: 0, 0, \pm iw", "transition")
    r.says("This is an ellipse of period $2\\pi/w$ about a centre that moves forward at the rate $-\\frac32 C w$, $C = 4\\,\\delta r/r_0 + 2\\,\\delta\\dot{\\Theta}/w$: a higher orbit is slower, and this drift is the double eigenvalue 0. {fig:orbit} shows both.")
    for t in (p.dt, 10 * p.dt):
        found = discretise(model, t, R=scales.noise(p)).Phi * scale / scale[:, None]
        r.check(text("Φ over {t} s", t=t), found, by_hand.transition(math, w * t), ("matrix exponential", "Clohessy and Wiltshire"), SOLVER, scale=float(np.abs(by_hand.transition(math, w * t)).max()))
    orbit(r, p, w, scale)


def orbit(r, p, w, scale):
    """Two revolutions of the linear and the nonlinear motion."""
    times = np.linspace(0, 4 * math.pi / w, 201)
    start = np.sqrt(np.diag(p.P0)) * (scales.spread(p) / scales.relative(p, p.P0) if scales.far(p) else 1.0)
    bent, straight = by_hand.integrated(p, start, times), np.array([by_hand.transition(math, w * t) for t in times]) @ (start / scale)
    turns = times * w / (2 * math.pi)
    up, along = bent[0] - straight[:, 0] * p.r0, p.r0 * (bent[2] - straight[:, 2])
    panels = (Panel("upwards, δr, km", (Curve("nonlinear equations", turns, bent[0] / 1e3, "black"),)),
              Panel("along, r₀δΘ, km", (Curve("nonlinear equations", turns, p.r0 * bent[2] / 1e3, "black"),)),
              Panel("nonlinear − linear, m", (Curve("upwards", turns, up, "blue"), Curve("along the orbit", turns, along, "orange"))))
    r.figure("orbit", Drawing("Deviations", TURNS, panels, height=7.4),
             text("Two revolutions after a deviation of +σ in all four states, seen from the nominal satellite: the deviations upwards and along the orbit, and the difference between the nonlinear and the linear motion.",
                  " The start is less than given, {share:2} of the orbit." if scales.far(p) else "", share=scales.spread(p)))
    r.says("In {fig:orbit} the deviation upwards is a periodic one about a constant, while that along the orbit drifts by the same amount in each revolution. The linear equations leave the nonlinear motion by {apart:2} m at most, which is {share:2} of the largest deviation.",
           apart=float(np.hypot(up, along).max()), share=float(np.hypot(up, along).max() / max(np.hypot(bent[0], p.r0 * bent[2]).max(), 1e-300)))


def part_c(r, p, answer, schedules):
    """Ranks, variances, limits."""
    r.section("c", "The angle, the range, or both")
    w, routes = by_hand.rate(p), ("orthogonal steps in scaled units", "exact rank of [H; HF; HF²; HF³]")
    models = {name: measured(p, rows) for name, rows in SETS.items()}
    seen = {name: observability.analyse(model) for name, model in models.items()}
    for name in SETS:
        r.value(f"observability_rank_{name}", seen[name].rank, agrees=answer, routes=routes)
    r.says("**Observability.** With $z_1 = \\delta\\Theta$ the rows $H, HF, HF^2, HF^3$ are, in natural units, $[0,0,1,0]$, $[0,0,0,1]$, $[0,-2,0,0]$, $[-6,0,0,-4]$, which are independent: rank 4. With $z_2 = \\delta r$ every row has a zero in the third place, for $F$ has a zero third column: rank 3, and the direction $\\delta\\Theta$ = const is never seen. Turning the orbit as a whole changes no range: the measured range fixes shape, size and phase of the ellipse of deviations, but not where on the orbit the satellite is. ∎")
    r.value("unobservable_direction_range", seen["range"].unobservable[:, 0], agrees=answer, routes=("orthogonal steps in scaled units", "zero column of F"))
    sampled = {name: [observability.loss_by_sampling(model, t) for t in (math.pi / w, 2 * math.pi / w, p.dt)] for name, model in models.items()}
    exact = ("orthogonal steps on the sampled pair", "exact rank with Clohessy and Wiltshire's Φ")
    r.value("observability_ranks_half_period", [sampled[name][0].rank for name in SETS], agrees=answer, routes=exact)
    r.value("observability_ranks_full_period", [sampled[name][1].rank for name in SETS], agrees=answer, routes=exact)
    r.table("ranks", ["measured", "continuous", "every half period", "every period", text("every {dt} s", dt=p.dt)],
            [(NAMES[name], seen[name].rank, *(loss.rank for loss in losses)) for name, losses in sampled.items()],
            "Ranks of observability; 4 is all.")
    r.says("In {tab:ranks} are the ranks of both pairs, continuous and sampled. At half a period between samples the exponentials of the eigenvalues $\\pm iw$ meet, at a full one all four: samples so far apart show the satellite at the same phases only.")
    return long_run(r, p, answer, schedules, w, sampled)


def long_run(r, p, answer, schedules, w, sampled):
    """Variances without process noise."""
    r.says("**Without process noise** the information only grows: with $\\Phi_k = \\Phi(t_k)$ and $P_0 = LL^T$")
    r.math(r"P(t_N^+) = \Phi_NL\left[I + L^T\sum_{k=1}^N(H\Phi_k)^TR^{-1}H\Phi_k\,L\right]^{-1}L^T\Phi_N^T", "information")
    r.says("This is the least-squares estimate of the start, carried to $t_N$ ({ref:maybeck, section 5.7} has the information form). The noises of the samples have the variances {one} rad² and {two} m²; the strengths of continuous noise to which samples every {dt} s are equivalent are $R_1 = \\sigma_\\Theta^2dt$ = {R1} rad²·s and $R_2 = \\sigma_r^2dt$ = {R2} m²·s.", one=p.sigma_theta**2, two=p.sigma_r**2, dt=p.dt, R1=p.sigma_theta**2 * p.dt, R2=p.sigma_r**2 * p.dt)
    scale, both = np.outer(by_hand.units(p), by_hand.units(p)), ("recursion", "all measurements at once")
    for name, rows in SETS.items():
        P, wanted = schedules[name].P_plus[p.steps], answer["covariances"][name][0]
        r.value(f"posterior_variances_{name}", np.diag(P), SQUARED, agrees=answer, routes=both)
        r.check(text("correlations and relative variances, {name}", name=NAMES[name]), scales.normal(P, scales.ruler(p, wanted)), scales.normal(wanted, scales.ruler(p, wanted)), both, SOLVER, scale=scales.known(p, wanted))
        H, R = scales.seeing(rows), np.diag(scales.noise(p, rows))
        sizes = np.diag(scales.ruler(p, wanted))
        short = np.sqrt(np.where(sizes > 0, sizes, 1.0))[:, None] / np.sqrt(R)
        r.check(text("last gain, {name}", name=NAMES[name]), schedules[name].K[p.steps] / short, wanted @ H.T / R / short, ("recursion", "P⁺HᵀR⁻¹"), SOLVER, scale=scales.known(p, wanted) * max(1.0, float(np.abs(wanted @ H.T / R / short).max())))
        natural = covariances(in_natural_units(p, rows), p.steps).P_plus[-1] * scale
        r.check(text("units, {name}", name=NAMES[name]), scales.normal(P, scales.ruler(p, wanted)), scales.normal(natural, scales.ruler(p, wanted)), ("recursion in m, m/s, rad, rad/s", "recursion in natural units"), SOLVER, scale=scales.known(p, wanted))
    r.table("variances", ["state", "σ at t0", *NAMES.values()],
            [(f"{state}, {unit}", math.sqrt(p.P0[i][i]), *(schedules[name].sd_plus[p.steps, i] for name in SETS)) for i, (state, unit) in enumerate(zip(STATES, UNITS, strict=True))],
            "Standard deviations of the four errors after {n} measurements, {revolutions} revolutions.", n=p.steps, revolutions=p.steps * p.dt * w / 2 / math.pi)
    r.holds("both measurements are never worse", np.array([scales.normal(schedules[name].P_plus[k] - schedules["both"].P_plus[k], scales.ruler(p, schedules[name].P_plus[k])).diagonal() for name in ("theta", "range") for k in range(LONG * p.steps + 1)]), ("one measurement", "both measurements"), size=1e4 * max(scales.known(p, P) for values in answer["covariances"].values() for P in values))
    deviations(r, p, schedules)
    ranks = {name: losses[2].rank for name, losses in sampled.items()}
    scales.limits(r, p, answer, schedules, ranks)
    scales.gained(r, p, schedules)
    verdict(r, p, schedules, ranks)
    return {"ranks": ranks}


def deviations(r, p, schedules):
    """Standard deviations of the four states for the three sets."""
    turns, panels = revolutions(p, p.steps), []
    for i, (state, unit) in enumerate(zip(STATES, ("m", "m/s", "µrad", "µrad/s"), strict=True)):
        size = 1e6 if unit.startswith("µ") else 1.0
        curves = {name: np.where(s := schedules[name].sd_plus[1 : p.steps + 1, i] * size, s, np.nan) for name in SETS}
        panels.append(Panel(f"σ of {state}, {unit}", tuple(
            Curve(NAMES[name], turns, curve, colour, style, size=2.5)
            for (name, curve), (colour, style) in zip(curves.items(), LOOKS, strict=True) if np.isfinite(curve).any()), kind="log"))
    r.figure("sd", Drawing("Standard deviations", TURNS, tuple(panel for panel in panels if panel.curves), log=True, height=9.0),
             "Standard deviation of the error of each state after each measurement, for the three sets; both axes logarithmic.")
    r.says("{fig:sd} and {tab:variances} show what each set reaches. Where the curve of both measurements lies on that of one of them, the other one adds nothing to this state. With the range only σ of δΘ never falls below {floor:3} rad, what a perfect knowledge of the other three states would leave of it.",
           floor=math.sqrt(scales.floor(p)))


def verdict(r, p, schedules, ranks):
    """One answer to the question of the sheet, and its criterion."""
    sd = {name: schedules[name].sd_plus[p.steps] for name in SETS}
    closer = [state for i, state in enumerate(STATES) if sd["range"][i] < sd["theta"][i]]
    r.value("verdict_c", ranks["theta"] > ranks["range"])
    r.value("verdict_c_both_observe_more", ranks["both"] > max(ranks["theta"], ranks["range"]))
    r.says("**Which is better?** The criterion is what can be found in the end: that measurement is better which leaves fewer directions of the state unobserved at the given period. ",
           "The angle observes {one} directions of the four, the range {two}: the angle is better." if ranks["theta"] > ranks["range"] else "Both observe {one} directions: at this period neither is better.",
           " The errors after {n} measurements are no such criterion, for they turn with the instruments. Here the range is more accurate in {states}; a coarser instrument would change that, while nothing in the range alone can ever tell the angle.",
           one=ranks["theta"], two=ranks["range"], n=p.steps, states=", ".join(closer) if closer else "no state")
    r.says("**Both** together observe {three} directions, ", "more than either." if ranks["both"] > max(ranks["theta"], ranks["range"]) else "no more than the better of them: what is gained is accuracy, not observability.", three=ranks["both"])


PARTS = Skeleton(
    result=result,
    key="sd",
    analysis=(part_a, part_b, part_c),
    plan=scales.plan,
    experiment=(part_d,),
    discussion=discussion,
    answers=answers,
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
