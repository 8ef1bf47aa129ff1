"""Lab 18: natural units, and what is linear in them."""

import math

import numpy as np
import sympy
from ctlabs.tasks.answers import task18 as by_hand
from ctlabs.tasks.answers.task18 import LONG, SETS

from ctlabs.filtering import update
from ctlabs.reporting.drawing import Curve, Drawing, Mark, Panel
from ctlabs.reporting.report import SOLVER
from ctlabs.text import text

STATES, UNITS = ["δr", "δṙ", "δΘ", "dδΘ/dt"], ["m", "m/s", "rad", "rad/s"]
TURNS = "number of revolutions"
NAMES = {"theta": "angle only", "range": "range only", "both": "both"}
#: Colour and line of the three sets: lines that may lie on one another are told apart.
LOOKS = (("blue", "line"), ("orange", "line"), ("black", "dash"))
#: Runge-Kutta steps of all periods together, at most; largest relative spread simulated; largest index tested for chance.
WORK, SPREAD, MILD = 800, 0.02, 0.05


def seeing(rows):
    """H of some of the measurements."""
    return np.array([[[0, 0, 1, 0], [1, 0, 0, 0]][row] for row in rows])


def noise(p, rows=(0, 1)):
    """Covariance of some of the measurements."""
    return np.diag([(p.sigma_theta**2, p.sigma_r**2)[row] for row in rows])


def normal(P, scale):
    """A covariance in units of the standard deviations of ``scale``, so that small variances count as much as large ones."""
    sd = np.sqrt(np.diag(scale))
    sd = np.where(sd > 0, sd, 1.0)
    return np.asarray(P) / np.outer(sd, sd)


def bracket(matrix):
    """A sympy matrix in LaTeX."""
    return sympy.latex(matrix, mat_str="bmatrix", mat_delim="")


def relative(p, P):
    """The largest standard deviation in natural units; Θ, on which the motion does not depend, is not counted."""
    return float(np.max((np.sqrt(np.diagonal(P, axis1=-2, axis2=-1).clip(0)) / by_hand.units(p))[..., [0, 1, 3]]))


def spread(p):
    """The largest relative spread of a nonlinear start: less where a sampling period bends the motion more."""
    return SPREAD / (1 + by_hand.rate(p) * p.dt) ** 2


def far(p):
    """Whether the given start is so far from the orbit that the nonlinear truth is started nearer."""
    return relative(p, p.P0) > spread(p) * (1 + 1e-9)


def known(p, wanted):
    """What a covariance so near to singular holds in double precision, in units of SOLVER; 1 if its condition is harmless."""
    return max(1.0, 10 * np.finfo(float).eps * np.linalg.cond(normal(wanted, wanted)) / SOLVER) if regular(p) else 1.0


def ruler(p, wanted):
    """Variances against which errors are measured: the state's own, or with a singular P0 the largest in natural units."""
    return wanted if regular(p) else np.diag((np.diag(wanted) / by_hand.units(p) ** 2).max() * by_hand.units(p) ** 2)


def revolutions(p, steps):
    """The instants of the measurements in revolutions of the nominal orbit."""
    return np.arange(1, steps + 1) * p.dt * by_hand.rate(p) / (2 * math.pi)


def floor(p):
    """Variance of the angle at the start that a perfect knowledge of the other states would leave."""
    return float(update(p.P0, np.eye(4)[[0, 1, 3]], np.zeros((3, 3))).P_plus[2, 2])


def regular(p):
    """Whether nothing is known from the start."""
    return bool(np.linalg.matrix_rank(normal(p.P0, np.array(p.P0)), tol=1e-8) == 4)


def limits(r, p, answer, schedules, ranks):
    """What is left after many measurements."""
    r.says("**After many measurements.** Where all is observed, $P \\to 0$ and $K \\to 0$: without process noise the filter falls asleep. With the range only it is otherwise. The part of $\\Theta(t_0)$ that is uncorrelated with the rest stays as it was, and the error of the drift's rate $-\\frac32Cw$, of standard deviation $\\frac32w\\,\\sigma_r/(r_0\\sqrt N)$ after N measurements, has by then acted for $N\\,dt$. So for large $N$ (and a regular $P_0$)")
    r.math(r"P_{33} \approx \text{const} + \frac94\,w^2dt^2\,\frac{\sigma_r^2}{r_0^2}\,N, \qquad K_3 \to -\frac32\,\frac{w\,dt}{r_0} = {limit} \; \text{rad/m}", "drift", limit=answer["gain_limit"])
    if ranks["range"] == 3 and regular(p):
        r.says("The variance of the angle then does not fall but grows, by {growth:2} rad² with each measurement; and its gain does not vanish, for the filter integrates the drift that it observes.", growth=answer["growth"])
    else:
        r.says("Here this does not apply: {why}.", why="$P_0$ is singular, so that something is known from the start" if not regular(p) else "the samples come at the same phases again and again")
    many, rows = [p.steps, 2 * p.steps, LONG * p.steps], []
    for name, which in SETS.items():
        schedule, wanted = schedules[name], answer["covariances"][name][1]
        r.check(text("after {n} measurements, {name}", n=many[-1], name=NAMES[name]), normal(schedule.P_plus[-1], ruler(p, wanted)), normal(wanted, ruler(p, wanted)), ("recursion", "all measurements at once"), SOLVER, scale=known(p, wanted))
        rows += [(NAMES[name], N, *schedule.sd_plus[N], float(np.abs(schedule.K[N, 2] * np.sqrt(np.diag(noise(p, which)))).max())) for N in many]
    left = floor(p)
    r.value("theta_variance_floor_range", left, "rad²")
    r.holds("P33 with the range only stays above what the rest leaves open", schedules["range"].P_plus[:, 2, 2] - left, ("recursion", "perfect knowledge of the rest"), size=max(p.P0[2][2], 1e-300))
    r.table("long", ["measured", "N", *(f"σ of {state}, {unit}" for state, unit in zip(STATES, UNITS, strict=True)), "correction of Θ by an error σ of a measurement, rad"], rows, "The same filters for longer.")
    r.says("{tab:long} follows the filters over {n} measurements.", n=many[-1])
    gains(r, p, schedules, ranks)


def gains(r, p, schedules, ranks):
    """The gain of the angle with the range only, and with the angle only."""
    n = LONG * p.steps
    turns, scale = revolutions(p, n), by_hand.rate(p) * p.dt / p.r0
    applies = ranks["range"] == 3 and regular(p)
    own = schedules["theta"].K[1:, 2, 0]
    panels = (Panel("$K_3r_0/(w\\,dt)$, range only", (Curve("range only", turns, schedules["range"].K[1:, 2, 0] / scale, "orange"),),
                    levels=(Mark("limit −3/2", -1.5),) if applies else ()),
              Panel("$K_3$, angle only", (Curve("angle only", turns, np.where(own > 0, own, np.nan), "blue"),), kind="log"))
    r.figure("gain", Drawing("Gains", TURNS, panels if (own > 0).any() else panels[:1], log=True, height=6.0),
             "Gain of the angle: with the range only, in units of $w\\,dt/r_0$, and with the angle only.")
    r.says("In {fig:gain} the gain with the angle only falls to 0. The gain by which the range corrects the angle oscillates with the revolutions",
           " and comes to rest at $-3/2$: a range that is too long by a metre means a slower satellite, whose angle is taken back at each step." if applies else " and, as said, has no such limit here.")


def gained(r, p, schedules):
    """Information in nats."""
    if not regular(p):
        r.says("$P_0$ is singular, so the information gained is not a finite number.")
        return
    scale = np.outer(by_hand.units(p), by_hand.units(p))
    gained_by = {}
    for name, rows in SETS.items():
        s, last = schedules[name], p.steps + 1
        by_covariance = 0.5 * (np.linalg.slogdet(np.array(p.P0) / scale)[1] - np.linalg.slogdet(s.P_plus[:last] / scale)[1])
        by_innovations = 0.5 * np.cumsum(np.linalg.slogdet(s.S[1:last])[1] - np.linalg.slogdet(noise(p, rows))[1])
        r.check(text("information, {name}", name=NAMES[name]), by_covariance[1:], by_innovations, ("determinants of P", "sum over innovations"), SOLVER, scale=known(p, s.P_plus[p.steps]) * max(1.0, by_innovations[-1]))
        gained_by[name] = float(by_innovations[-1])
    r.says("**In one number**, the information $\\frac{1}{2}\\ln(\\det P_0/\\det P)$ that {n} measurements have given is {theta:3} nats with the angle, {range:3} with the range, {both:3} with both. Motion without noise keeps volumes ($\\det\\Phi = 1$), so it is also $\\frac{1}{2}\\sum\\ln(\\det S/\\det R)$ over the innovations.", n=p.steps, **gained_by)


def plan(r, p, experiment):
    """Every number chosen; the parameters of the nonlinear trial, its length and its flow."""
    w = by_hand.rate(p)
    shrink = spread(p) / relative(p, p.P0) if far(p) else 1.0
    trial = p.model_copy(update={"P0": tuple(map(tuple, (np.array(p.P0) * shrink**2).tolist()))})
    horizon = w * p.dt * p.steps
    # The error of Runge and Kutta's steps, relative to r0, is near 0.003 ρ wT (w dt/parts)⁴ for deviations ρ; it is checked below.
    parts = math.ceil(w * p.dt * (0.03 * max(relative(p, trial.P0), 1e-6) * max(horizon, 1) / 1e-9) ** 0.25)
    steps = min(p.steps, max(1, WORK // parts))
    r.says("{tab:plan} lists what was chosen.")
    r.table("plan", ["quantity", "value", "why"], [
        ["radius and rate of the nominal orbit", [p.r0, w], "given, m and rad/s"],
        ["σ of the range, m, and of the angle, rad", [p.sigma_r, p.sigma_theta], text("given; that of the angle is {along:3} m along the orbit", along=p.r0 * p.sigma_theta)],
        ["period of sampling, s", p.dt, text("{n} samples a revolution", n=2 * math.pi / w / p.dt)],
        ["measurements", [p.steps, steps], "linear truth, nonlinear truth (fewer where the motion takes many small steps)"],
        ["steps of the integration in a period", parts, "so that their error is far below σ"],
        ["σ of the start, as a share of the orbit", relative(p, trial.P0), "given" if shrink == 1 else "less than given: a nonlinear truth that far from the orbit would meet the centre"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["bounds of the deviations in an extended filter", "from −0.7 to 3, ±2, from −0.9 to 2", "δr, δṙ, dδΘ/dt in units of $r_0$, $r_0w$, $w$: a filter that is led astray must not meet the centre, where nothing is finite; the truth has no bounds"],
        ["seed", experiment.seed, "the three sets and both kinds of filter get the same runs"],
    ], "Plan of the experiment.")
    return {"trial": (trial, steps, parts)}
