"""Lab 13, part (c): both filters on simulated flights."""

import math

import numpy as np
from ctlabs.tasks._task13_coefficients import TIME

from ctlabs.filtering import bucy
from ctlabs.labs.comparison import fine
from ctlabs.labs.experiment import covariances
from ctlabs.labs.portrait import tested
from ctlabs.montecarlo import chance
from ctlabs.reporting import plots
from ctlabs.text import text


def plan(r, p, experiment, two, three):
    """Every number chosen."""
    fastest = float(np.abs(bucy.steady(two).poles).max())
    close = fine(three, p.dt, p.steps, 1 / fastest)
    r.says("White noise has no values, so the continuous filter is simulated by the discrete one with a period δ much shorter than the filter's time constants and measurements of the variance $N_m/\\delta$. The states move by the exact transition over δ; only the measurements are replaced, and the filter's variance differs from P(t) by O(δ), as stated with the results. In the pictures of single runs both filters watch the same flight.")
    r.table("plan", ["quantity", "value", "why"], [
        ["period of the sampled measurements dt, s", p.dt, "given"],
        ["sampled measurements", p.steps, "given"],
        ["period δ in place of continuous time, s", close.model.dt, text("a hundredth of 1/|fastest pole| = {tau} s or dt if that is shorter; a whole number in dt", tau=1 / fastest)],
        ["steps of length δ", close.steps, "the same horizon, 4000 steps at most"],
        ["initial state", "settled flight", "the sheet gives none: $P_0$ of (a), by which the first innovations are of the order of 10⁴ m with the printed data" if p.var_hc0 > 1e8 else "the sheet gives none: $P_0$ of (a)"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["seed", experiment.seed, "another stream of random numbers for each ensemble"],
    ], "Plan of the experiment.")
    return {"close": close}


def one_flight(r, p, experiment, sampled, close):
    """Both filters in one flight."""
    seen, ratio = close.one_path(experiment, sampled), close.ratio
    runs = dict(zip(("continuous filter", "sampled filter"), zip(seen.values(), (1, ratio), strict=False), strict=False))
    last, cut = list(seen.values())[-1], slice(ratio, None, ratio)
    for i, key, name, caption in (
        (0, "altitude", "altitude, m", "One flight: the altitude h, the sampled measurements $h_m$, and the estimates of both filters with their ±σ bands, from the first measurement on."),
        (2, "command", "commanded altitude $h_{c0}$, m", "The estimate of the command in the same flight, with ±√P33."),
    ):
        if i == 2 and not p.var_hc0:
            continue
        # The altitude from the first sampled measurement on: what precedes it is off the scale.
        begin = ratio if i == 0 and ratio < close.steps else 1
        tracks = {}
        for who, (e, step) in runs.items():
            shown = slice(max(begin, step), None, step)
            tracks[who] = (e.t[shown], e.x_plus[shown, i, 0], e.sd_plus[shown, i])
        measured = (last.t[cut], last.z[cut, 0, 0]) if i == 0 and len(runs) == 2 else None
        figure = plots.estimates((last.t[begin:], last.truth[begin:, i, 0]), tracks, xlabel=TIME, ylabel=name,
                                 measurements=measured, log="x" if i else "")
        r.figure(key, figure, caption)


def ensembles(r, p, answer, experiment, three, sampled, close):
    """Both filters on simulated data."""
    one_flight(r, p, experiment, sampled, close)
    # What the noise has brought in must stand above the rounding of what the filter began with.
    regular = answer["altitude_variance_steady_continuous"] > 1e3 * np.finfo(float).eps * three.P0.max()
    if not regular:
        r.says("The NEES is not tested: with so little noise in the command the errors of the three states are multiples of one another, and other directions of the covariance hold nothing but rounding.")
    rows = [
        ensemble(r, experiment, three, "continuous (period δ)", "ensemble_continuous", close.model, close.steps, 2, regular),
        ensemble(r, experiment, three, "sampled", "ensemble", sampled, p.steps, 3, regular),
    ]
    r.table("ensemble", ["filter", "to t, s", "σ of h in theory, m", "RMS of h, m", "mean error of h, m", "σ of h_c0 in theory, m", "RMS of h_c0, m", "P11⁺ from P11(t), % at most", "largest deviation, σ"], rows,
            "The ensembles at the last instant. The deviation of P11⁺ from the continuous P11(t) is that of theory, over the whole horizon; the last column is over all instants and tests.")
    r.says("With the period δ in place of continuous time the variance of the altitude differs from P(t) by {percent} % at most: to that accuracy the ensemble shows the continuous filter.",
           percent=rows[0][7])


def ensemble(r, experiment, three, name, key, system, steps, stream, regular):
    """One of the filters against theory; the row of it."""
    stats, theory = experiment.statistics(system, steps=steps, stream=stream), covariances(system, steps)
    worst = tested(r, name, {
        "mean error": chance.bias(stats, theory.P_plus), "error variance": chance.variance(stats, theory.P_plus),
        "NIS": chance.nis(stats), **({"NEES": chance.nees(stats)} if regular else {}),
    })
    some = np.unique(np.geomspace(1, steps, 150).astype(int))
    continuous, discrete = bucy.transient(three, theory.t[some]).P[:, 0, 0], theory.P_plus[some, 0, 0]
    apart = np.abs(discrete / np.where(continuous > 0, continuous, 1.0) - 1)[continuous > 0]
    figure = plots.ensemble_log(stats, theory.P_plus, xlabel=TIME, units=["m", "m/s", "m"],
                                names=["h", "x2", "h_c0"], log="xy")
    r.figure(key, figure,
             "Ensemble against theory, {name} filter: RMS on a logarithmic scale and mean error in units of σ, with the bands of 95 % of ensembles; NEES and NIS averaged over the runs.",
             name=name)
    return (name, theory.t[-1], theory.sd_plus[-1, 0], stats.rms[-1, 0], stats.bias[-1, 0], theory.sd_plus[-1, 2],
            stats.rms[-1, 2], 100 * float(apart.max(initial=0.0)), worst)
