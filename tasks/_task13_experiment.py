"""Lab 13, part (c): both filters on simulated flights."""

import math

import numpy as np
from ctlabs.tasks._task13_coefficients import TIME

from ctlabs.filtering import bucy
from ctlabs.labs.comparison import fine
from ctlabs.labs.experiment import covariances
from ctlabs.labs.portrait import mean_error, rms, tested
from ctlabs.models.discretisation import discretise
from ctlabs.montecarlo import chance
from ctlabs.reporting import plots
from ctlabs.reporting.drawing import Curve, Drawing, Panel
from ctlabs.reporting.plots.studies import estimates_panel
from ctlabs.text import text


def plan(r, p, experiment, two, three):
    """Every number chosen."""
    fastest = float(np.abs(bucy.steady(two).poles).max())
    close = fine(three, p.dt, p.steps, 1 / fastest)
    r.says("{tab:plan} lists what was chosen. White noise has no values, so the continuous filter is simulated by a discrete one, with a period δ much shorter than the time constants of the filter and with measurements of the variance $N_m/\\delta$. The states move by the exact transition over δ; only the measurements are replaced, and the variance of the filter differs from P(t) by terms of the order δ, as stated with the results. In the pictures of single runs both filters watch the same flight.")
    r.table("plan", ["quantity", "value", "why"], [
        ["period Δt of the sampled measurements, s", p.dt, "given"],
        ["sampled measurements", p.steps, "given"],
        ["period δ in place of continuous time, s", close.model.dt, text("a hundredth of the shortest time constant {tau:3} s, or of Δt if that is shorter; a whole number of them in Δt", tau=1 / fastest)],
        ["steps of length δ", close.steps, "the same horizon, 4000 steps at most"],
        ["initial state", "settled flight", "the sheet gives none: $P_0$ of (a), by which the first innovation is of the order of 10 km" if p.var_hc0 > 1e8 else "the sheet gives none: $P_0$ of (a)"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["seed", experiment.seed, "another stream of random numbers for each ensemble"],
    ], "Plan of the experiment.")
    return {"close": close}


def flights(r, p, experiment, sampled, close, names, second):
    """Both filters in one flight, and the sampled one in a flight of the other reading of the data."""
    seen, ratio = close.one_path(experiment, sampled), close.ratio
    other = experiment.histories(discretise(second[1], p.dt), steps=p.steps, runs=1, stream=4)
    continuous, own = seen["continuous"], list(seen.values())[-1]
    pairs = ((own, slice(ratio if "sampled" in seen else 1, None, ratio if "sampled" in seen else 1)), (other, slice(1, None)))
    late = continuous.t >= own.t[pairs[0][1]][0]
    line = Curve("continuous filter", continuous.t[late], continuous.x_plus[late, 0, 0], "amber", width=1.2)
    panels = tuple(
        estimates_panel(flight.t[at], {"sampled filter": (flight.x_plus[at, 0, 0], flight.sd_plus[at, 0])},
                        text("h, m ({name})", name=name), data=flight.z[at, 0, 0], truth=flight.truth[at, 0, 0], others=others)
        for name, (flight, at), others in zip(names, pairs, ((line,), ()), strict=True)
    )
    r.figure("flights", Drawing("Flights", TIME, panels, height=6.6),
             "One flight with the data {first}, and one with the data {second}: the altitude, its measurements, and the estimate of the sampled filter with its ±σ band, from the first measurement on; above also the estimate of the continuous filter in the same flight.",
             first=names[0], second=names[1])
    wild = text("With σ = {sd:3} km of the command about a mean of {mean:2} km the upper flight may lie at any altitude, below the ground as well: these are the numbers of the sheet and not those of an aircraft, and the filter takes its level from the first measurements. ",
                sd=p.var_hc0**0.5 / 1000, mean=p.mean_hc0 / 1000) if p.var_hc0 > 1e7 else ""
    r.says("{fig:flights} shows one flight with the data {first} and one with the data {second}. ", wild,
           "In both the estimate follows the altitude through measurements whose errors are larger than its own.", first=names[0], second=names[1])
    beginning(r, names, pairs)


def beginning(r, names, pairs):
    """Size of the innovations, and the error of the estimated command, in both readings."""
    sizes, errors, first = [], [], []
    for name, (seen, at), colour in zip(names, pairs, ("blue", "orange"), strict=True):
        t, sd, error = seen.t[at], np.sqrt(seen.S[at, 0, 0]), np.abs(seen.error()[at, 2, 0])
        sizes += [Curve(text("innovation, {name}", name=name), t, np.abs(seen.innovation[at, 0, 0]), colour, "points", size=2.5),
                  Curve(text("its σ, {name}", name=name), t, sd, colour)]
        errors += [Curve(text("error, {name}", name=name), t, np.where(error > 0, error, np.nan), colour, "points", size=2.5),
                   Curve(text("its σ, {name}", name=name), t, np.where(seen.sd_plus[at, 2] > 0, seen.sd_plus[at, 2], np.nan), colour)]
        first.append(float(sd[0]))
    drawn = [curve for curve in errors if np.isfinite(curve.y).any()]
    panels = (Panel("size of the innovation, m", tuple(sizes), kind="log"), Panel("error of $\\hat h_{c0}$, m", tuple(drawn), kind="log"))
    r.figure("beginning", Drawing("Innovations and command", TIME, panels, log=True, height=6.6),
             "Sizes of the innovations and of the errors of the estimated command in the two flights (points), with their standard deviations in theory (lines).")
    r.says("{fig:beginning} shows where the readings differ. The standard deviation of the first innovation is {one:3} m with the data {first}, {two:3} m with the data {second}; what remains after it is the noise of the measurements and what the altitude does in a period. The errors of the command are of the size of their standard deviations, which fall in the same way in both.",
           first=names[0], second=names[1], one=first[0], two=first[1])


def ensembles(r, p, answer, experiment, three, sampled, close, names, second):
    """Both filters on simulated data."""
    flights(r, p, experiment, sampled, close, names, second)
    # What the noise has brought in must stand above the rounding of what the filter began with.
    regular = answer["altitude_variance_steady_continuous"] > 1e3 * np.finfo(float).eps * three.P0.max()
    if not regular:
        r.says("The NEES is not tested: with so little noise in the command the errors of the three states are multiples of one another, and other directions of the covariance hold nothing but rounding.")
    row, _stats = ensemble(r, experiment, three, "continuous (period δ)", close.model, close.steps, 2, regular)
    own, stats = ensemble(r, experiment, three, "sampled", sampled, p.steps, 3, regular)
    theory = covariances(sampled, p.steps)
    figure = plots.ensemble_log(stats, theory.P_plus, xlabel=TIME, units=["m", "m/s", "m"],
                                names=["$h$", "$x_2$", "$h_{c0}$"], log="xy")
    r.figure("ensemble", figure,
             "The ensemble of the sampled filter against theory: RMS errors, mean errors in units of σ, with the bands of 95 % of ensembles; NEES and NIS averaged over the runs.")
    r.table("ensemble", ["filter", "to t, s", "σ of $h$ in theory, m", "RMS of $h$, m", "mean error of $h$, m", "σ of $h_{c0}$ in theory, m", "RMS of $h_{c0}$, m", "$P_{11}^+$ from $P_{11}(t)$, % at most"], [row, own],
            "Both ensembles at their last instant, with standard errors. The last column is theory: the largest deviation from the continuous variance over the whole horizon.")
    r.says("{fig:ensemble} and {tab:ensemble} compare {runs} flights with theory. The RMS errors follow the covariances all the way down, and the mean errors scatter about 0. With the period δ in place of continuous time the variance of the altitude differs from $P_{11}(t)$ by {percent:2} % at most: to that accuracy the first ensemble shows the continuous filter.",
           runs=experiment.runs, percent=row[7])
    return {"measured": rms(stats, unit="m"), "sd": float(theory.sd_plus[-1, 0])}


def ensemble(r, experiment, three, name, system, steps, stream, regular):
    """One of the filters against theory; the row of it."""
    stats, theory = experiment.statistics(system, steps=steps, stream=stream), covariances(system, steps)
    tested(r, name, {
        "mean error": chance.bias(stats, theory.P_plus), "error variance": chance.variance(stats, theory.P_plus),
        "NIS": chance.nis(stats), **({"NEES": chance.nees(stats)} if regular else {}),
    })
    some = np.unique(np.geomspace(1, steps, 150).astype(int))
    continuous, discrete = bucy.transient(three, theory.t[some]).P[:, 0, 0], theory.P_plus[some, 0, 0]
    apart = np.abs(discrete / np.where(continuous > 0, continuous, 1.0) - 1)[continuous > 0]
    return (name, theory.t[-1], theory.sd_plus[-1, 0], rms(stats), mean_error(stats), theory.sd_plus[-1, 2],
            rms(stats, state=2), 100 * float(apart.max(initial=0.0))), stats
