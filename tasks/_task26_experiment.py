"""Lab 26's experiment: the optimal loop with the right plant and with others."""

import math

import numpy as np

from ctlabs.labs import loops
from ctlabs.models import ContinuousModel, discretise
from ctlabs.reporting.drawing import Band, Curve, Drawing, Panel
from ctlabs.text import Uncertain, text

#: Instants simulated, and those in a slow time constant of the loop.
STEPS, PER_CONSTANT, SETTLED = 100, 10, 60


def step(answer):
    """A tenth of the loop's slowest time constant: for q, σ that are not small these are f − 2 and d − 2."""
    return max(answer["feedback_gain"][0], answer["filter_gain"][0]) / PER_CONSTANT


def plan(r, answer, experiment):
    """Every number chosen."""
    r.says("{tab:plan} lists what was chosen. The loop of plant and regulator is a continuous model with white noise, and is sampled exactly; $x_1 + x_2$ and $u$ are counted at the instants. All begin at rest.")
    r.table("plan", ["quantity", "value", "why"], [
        ["instants", STEPS, text("{n} in the slowest time constant of the loop", n=PER_CONSTANT)],
        ["period between them", step(answer), "the units of time of the plant"],
        ["instants of the mean cost", text("{begin} to {end}", begin=SETTLED, end=STEPS), "the start from rest is forgotten"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["seed", experiment.seed, "the same random numbers for both plants"],
    ], "Plan of the experiment.")


def sampled(loop, dt):
    """The loop as a discrete model, and the rows of x1 + x2 and of u."""
    whole = loop.model
    seen = ContinuousModel(whole.F, whole.G, whole.Q, np.eye(1, 4), P0=whole.P0)
    return discretise(seen, dt, R=[[0]]), np.vstack([[1, 1, 0, 0], loop.U])


def part_f(r, p, answer, optimal, truths, beyond, experiment):
    """Ensembles against theory, and a loop that grows."""
    r.section("f", "The loop simulated")
    dt, rows, own = step(answer), [], None
    weight = np.diag([p.q, 1.0])
    for i, (name, truth) in enumerate(truths.items()):
        if i and (answer["cost_actual"] is None or p.m == 1):
            continue
        model, signals = sampled(optimal.loop(truth), dt)
        runs = loops.ensemble(experiment, model, signals, weight, STEPS)
        loops.agreement(r, name, runs)
        limit = answer["cost_actual"] if i else answer["cost"]
        rows.append((name, runs.cost(SETTLED), runs.expected(SETTLED), limit, Uncertain(float(runs.rms[-1, 0]), float(runs.rms[-1, 0]) / math.sqrt(2 * runs.runs)), runs.sd[-1, 0]))
        own = own or runs
    r.table("ensemble", ["plant", "mean cost", "in theory", "its limit", "RMS of $x_1 + x_2$ at the end", "in theory"], rows,
            "The mean cost of the ensemble over the last instants, with its standard error.")
    _growth(r, answer, optimal, beyond, own, dt)
    measured, theory = rows[0][1], rows[0][2]
    r.says("With the right plant the mean cost is {measured}, where theory has {theory:5} ({tab:ensemble}).", measured=measured, theory=theory)
    if answer["cost_actual"] is None:
        r.says("The loop with the given $m$ is not stable and was not simulated.")
    return {"measured": measured, "theory": theory}


def _growth(r, answer, optimal, beyond, own, dt):
    """σ of x1 + x2 beyond the bound, and the ensemble."""
    t = np.arange(STEPS + 1) * dt
    half = 1.96 / math.sqrt(2 * own.runs)
    bands = (Band("95 % of ensembles", t, own.sd[:, 0] * (1 - half), own.sd[:, 0] * (1 + half), "blue"),)
    curves = [Curve("ensemble, m = 1", t, own.rms[:, 0], "blue", "points", size=3.0)]
    model, signals = sampled(optimal.loop(beyond), dt)
    sd = np.sqrt(loops.in_time(model, signals, STEPS)[0][:, 0, 0])
    curves.append(Curve("twice as far as the bound, theory", t, np.where(sd < 30 * own.sd[:, 0].max(), sd, np.nan), "orange", "dash"))
    r.figure("growth", Drawing("Growth", "time t (units of the plant)", (Panel("RMS of $x_1 + x_2$ (units of the plant)", tuple(curves), bands, kind="log"),)),
             "RMS of the controlled quantity from rest: of the ensemble with the right plant, and in theory with an input that is too strong by twice the upper margin.")
    r.says("In {fig:growth} the two loops begin alike. The right plant settles; that with an input too strong by {percent:3} % has one slowly growing motion, which the experiment with the right plant does not contain: an ensemble, however large, says nothing about another plant.",
           percent=200 * (answer["gain_margins"][1] - 1))
