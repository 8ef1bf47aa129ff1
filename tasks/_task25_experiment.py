"""Lab 25's experiment: three regulators of the integrator, and flights of the autopilot."""

import math

import numpy as np
from ctlabs.tasks._task25_autopilot import cost_of

from ctlabs.labs import loops
from ctlabs.regulation import regulator, sample
from ctlabs.reporting.drawing import Band, Curve, Drawing, Panel
from ctlabs.text import Uncertain, text

#: Samples simulated, the first one whose cost counts as settled, those drawn, and flights drawn.
STEPS, SETTLED, SHOWN, FLIGHTS = 150, 50, 60, 4


def plan(r, p, experiment):
    """Every number chosen."""
    r.says("{tab:plan} lists what was chosen. The simulated loops are exact at the samples; the cost between the samples is that of {eq:weights}, so no finer steps are needed.")
    r.table("plan", ["quantity", "value", "why"], [
        ["samples, integrator", STEPS, text("{time:3} s; its loops forget their start within a few samples", time=STEPS * p.dt)],
        ["samples, autopilot", STEPS, text("{time:3} s of flight, from the aircraft that was left alone", time=STEPS * p.dt_a)],
        ["samples of the mean cost", text("{begin} to {end}", begin=SETTLED, end=STEPS), "the first third is left out; theory is that of the same samples"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["seed", experiment.seed, "the same random numbers for the three regulators of the integrator"],
    ], "Plan of the experiment.")


def joint(cost):
    """[[Qx, N], [Nᵀ, Qu]]."""
    return np.block([[cost.Qx, cost.N], [cost.N.T, cost.Qu]])


def rows(loop, n):
    """The rows of the plant's states and of the input among the loop's states."""
    return np.vstack([np.eye(n, loop.model.n), loop.model.H[-1:]])


def part_f(r, p, answer, found, cost, aircraft, experiment):
    """Ensembles against theory."""
    r.section("f", "The loops simulated")
    table = []
    for name, regulated in found.items():
        loop = regulated.closed
        runs = loops.ensemble(experiment, loop.model, rows(loop, 1), joint(cost), STEPS)
        loops.agreement(r, text("integrator, {name}", name=name), runs)
        table.append((name, per_second(runs, cost, p.dt), (runs.expected(SETTLED) + cost.constant) / p.dt))
    _, own = sample(aircraft, cost_of(p), p.dt_a)
    loop = regulator(aircraft, cost_of(p), dt=p.dt_a).closed
    flights = loops.ensemble(experiment, loop.model, rows(loop, 2), joint(own), STEPS, stream=1)
    loops.agreement(r, "autopilot", flights)
    table.append(("autopilot", per_second(flights, own, p.dt_a), (flights.expected(SETTLED) + own.constant) / p.dt_a))
    r.table("ensemble", ["loop", "J of the ensemble, m²", "J in theory, m²"], table, "The mean cost per second over the last two thirds of the samples, with its standard error.")
    pictures(r, flights, math.sqrt(answer["altitude_variance_free"]))
    r.says("{tab:ensemble} has the costs: all agree with theory, and the three regulators of the integrator stand in the order of {tab:naive}.")
    return {"measured": table[-1][1], "theory": table[-1][2]}


def per_second(runs, cost, h):
    """The mean cost per second of an ensemble, what the noise adds between the samples included."""
    mean = runs.cost(SETTLED)
    return Uncertain((mean.value + cost.constant) / h, mean.error / h)


def pictures(r, flights, free):
    """Some flights, and the RMS of all."""
    t, sd, rms = flights.t[: SHOWN + 1], flights.sd[: SHOWN + 1], flights.rms[: SHOWN + 1]
    some = [Curve(text("flight {n}", n=i + 1), t, flights.y[: SHOWN + 1, 0, i], colour, width=1.0) for i, colour in zip(range(min(FLIGHTS, flights.runs)), ("blue", "orange", "green", "purple"), strict=False)]
    bands = (Band("left alone: ±σ", t, np.full_like(t, -free), np.full_like(t, free), "grey", frame=True), Band("regulated: ±σ", t, -sd[:, 0], sd[:, 0], "blue"))
    r.figure("flights", Drawing("Flights", "time t, s", (Panel("deviation of the altitude, m", tuple(some), bands, kind="signed"),)),
             "Some flights whose regulator is switched on at t = 0, with the band of theory, and that of the aircraft left alone.")
    half = 1.96 / math.sqrt(2 * flights.runs)
    panels = []
    for i, what in ((0, "RMS of the altitude, m"), (2, "RMS of the correction, m")):
        band = Band("95 % of ensembles", t, sd[:, i] * (1 - half), sd[:, i] * (1 + half), "blue")
        panels.append(Panel(what, (Curve("ensemble", t, rms[:, i], "blue", "points", size=3.0),), (band,), kind="count"))
    r.figure("ensemble", Drawing("Ensemble", "time t, s", tuple(panels)), "RMS of altitude and correction over all flights, in the band where theory expects 95 % of the points.")
    r.says("In {fig:flights} the flights begin as wide apart as those of the aircraft left alone; then each keeps for about two thirds of the time to the band of the regulator, about which the noise of the command drives it. {fig:ensemble} has the RMS of all {runs}: it goes from the start to its limit along the band, and about one point in twenty lies outside.", runs=flights.runs)
