"""Lab 24's experiment: loops of many runs, with the right model and with a wrong one."""

import math

import numpy as np

from ctlabs.labs import loops
from ctlabs.reporting.drawing import Band, Curve, Drawing, Panel
from ctlabs.text import text

#: Steps simulated, the first one whose cost counts as settled, and those drawn.
STEPS, SETTLED, SHOWN = 150, 75, 60


def memory(p, answer):
    """Steps until the variance of the start is one per cent of what it was, by the slower of feedback and filter."""
    pole = max(answer["regulator_pole"], (1 - answer["gain_steady"]) * p.Phi)
    return math.ceil(math.log(0.01) / (2 * math.log(pole))) if pole > 0.01 else 1


def plan(r, p, answer, experiment):
    """Every number chosen."""
    r.says("{tab:plan} lists what was chosen. Every loop starts from the given $P_0$ with the estimate 0; what is counted is $x_k$, $u_k$ and the cost, at every instant.")
    r.table("plan", ["quantity", "value", "why"], [
        ["steps", STEPS, text("the variance of the start falls to one per cent within {n}", n=memory(p, answer))],
        ["steps of the mean cost", text("{begin} to {end}", begin=SETTLED, end=STEPS), "the second half; theory is that of the same steps"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["seed", experiment.seed, "the same random numbers for all loops, which are so compared on the same disturbances"],
    ], "Plan of the experiment.")


def part_g(r, p, answer, both, truth, experiment):
    """Ensembles against theory."""
    r.section("g", "The loops simulated")
    current = both["current"]
    cases = {"current": current.closed, "delayed": both["delayed"].closed}
    if answer["cost_actual"] is not None:
        cases["current, wrong model"] = current.loop(truth)
    rows, found = [], {}
    for name, loop in cases.items():
        found[name] = runs = loops.ensemble(experiment, loop.model, picked(loop), np.diag([p.Qx, p.Qu]), STEPS)
        loops.agreement(r, name, runs)
        limit = loop.steady()
        steady = p.Qx * limit.x.P[0, 0] + p.Qu * limit.u.P[0, 0]
        rows.append((name, runs.cost(SETTLED), runs.expected(SETTLED), steady, runs.rms[-1, 0], runs.sd[-1, 0], runs.rms[-1, 1], runs.sd[-1, 1]))
    r.table("ensemble", ["regulator", "mean cost, m²", "in theory, m²", "its limit, m²", "RMS of x, m", "in theory, m", "RMS of u, m", "in theory, m"],
            rows, "The mean cost per step of the ensemble over the second half, with its standard error, and the last step's RMS of state and input.")
    _picture(r, found, memory(p, answer))
    measured = rows[0][1]
    r.says("{tab:ensemble} has the mean cost: {measured} m² with the current regulator, where theory has {theory:4} m².", measured=measured, theory=rows[0][2])
    if answer["cost_actual"] is None:
        r.says("The loop with the true factor of (f) is not stable and was not simulated.")
    return {"measured": measured, "theory": rows[0][2]}


def picked(loop):
    """The rows of x and u among the loop's states."""
    x = np.zeros((1, loop.model.n))
    x[0, 0] = 1.0
    return np.vstack([x, loop.model.H[-1:]])


def _picture(r, found, n):
    """RMS of state and input in time, with the bands of 95 % of ensembles."""
    panels = []
    for i, what in enumerate(("RMS of x, m", "RMS of u, m")):
        curves, bands = [], []
        for (name, runs), colour in zip(found.items(), ("blue", "orange", "green"), strict=False):
            half = 1.96 / math.sqrt(2 * runs.runs)
            k, sd = np.arange(SHOWN + 1), runs.sd[: SHOWN + 1, i]
            bands.append(Band(f"{name}: 95 %", k, sd * (1 - half), sd * (1 + half), colour))
            curves.append(Curve(name, k, runs.rms[: SHOWN + 1, i], colour, "points", size=3.0))
        panels.append(Panel(what, tuple(curves), tuple(bands), kind="count"))
    r.figure("ensemble", Drawing("Ensemble", "step number k", tuple(panels), whole=True),
             "RMS of the state and of the input over the runs (points), with the bands in which theory expects 95 % of them; the first {n} steps.", n=SHOWN)
    r.says("In {fig:ensemble} the points lie in and about the bands. What the start adds falls to one per cent within {n} steps; in the limit the delayed regulator holds the state less well than the current one.", n=n)
