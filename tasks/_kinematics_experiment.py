"""Labs 3 and 4, part (d): the experiment and its conclusions."""

import math
from dataclasses import replace

import numpy as np
from ctlabs.tasks._kinematics_model import (
    CURVE,
    QUANTITY,
    continuous,
    length,
    lettered,
    listed,
    named,
    positive,
    sampled,
    squared,
)
from ctlabs.tasks.answers import kinematics as by_hand

from ctlabs.analysis import sensitivity
from ctlabs.filtering import settling, steady
from ctlabs.labs.experiment import covariances
from ctlabs.labs.portrait import agreement, mean_error, portrait, rms
from ctlabs.linalg.factors import factor
from ctlabs.models import kinematics, observability
from ctlabs.models.discretisation import discretise
from ctlabs.reporting import plots
from ctlabs.reporting.drawing import Curve, Drawing, Panel
from ctlabs.reporting.report import EXACT
from ctlabs.text import prose, text

#: Levels of the factors in the experiment; the period enters the ratio by a high power.
LEVELS = {"P0": (0.1, 10.0), "sigma_w2": (0.1, 10.0), "R": (0.2, 5.0), "tau": (0.5, 2.0)}
STEP = "measurement number i"
#: The factors as a reader sees them.
SYMBOLS = {"P0": "$P_0$", "sigma_w2": "$\\sigma_w^2$", "R": "R", "tau": "τ"}
NAMES = {"P0": "initial covariance", "sigma_w2": "disturbance", "R": "measurement errors", "tau": "period"}


def plan(r, lab, experiment):
    """Every number chosen."""
    p, steps = lab.p, length(lab.settled)
    chosen = [(name, [level * getattr(p, name) for level in LEVELS[name]]) for name in ("sigma_w2", "R", "tau")]
    units = {"sigma_w2": str(kinematics.units(continuous(p))["Q"][0][0]), "R": "m²", "tau": "s"}
    r.says("{tab:plan} lists what was chosen. One factor is changed at a time, and the ensemble of each level is compared with its theory.")
    r.table("plan", ["quantity", "value", "why"], [
        ["measurements in a run", steps, text("at most 300, of the {settled} that the given filter takes to settle: the figures show its transient, not its limits", settled=lab.settled) if lab.settled is not None and lab.settled > steps
         else "two settling times of the given parameters, at least 20 and at most 300 (40 where nothing settles); for each level of a factor its own"],
        ["initial mean", listed(f"{prose(mean)} {unit}" for mean, unit in zip(p.x0_mean, lab.system.units, strict=True)), "given; then wrong by one standard deviation (by 1 where that is 0)"],
        ["initial covariance, diagonal", listed(f"{prose(each)} {unit}" for each, unit in zip(np.diag(p.P0), squared(lab), strict=True)), "given; then times 0.1 and 10"],
        *([f"{SYMBOLS[name]}, {units[name]}", getattr(p, name), text("given; then {low} and {high}", low=low, high=high) if getattr(p, name) else "given; multiples of 0 are 0"] for name, (low, high) in chosen),
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["seed", experiment.seed, "the same random numbers for all levels, so that they compare"],
    ], "Plan of the experiment.")
    return {"steps": steps}


def part_d(r, lab, experiment, steps):
    """Ensemble against theory, and the two kinds of variances side by side."""
    r.section("d", "The filter in an experiment")
    counted = replace(lab.system, dt=1.0)
    stats = portrait(r, experiment, counted, steps, figures={})
    theory = covariances(counted, steps)
    r.figure("ensemble", plots.ensemble_log(stats, theory.P_plus, xlabel=STEP, units=lab.system.units, names=lettered(lab)),
             "The ensemble of {runs} runs against theory at the given parameters: RMS errors on logarithmic axes, mean errors in units of σ, NEES and NIS, in the bands of 95 % of ensembles.", runs=experiment.runs)
    r.says("{fig:ensemble} compares the simulated filter with theory, at the given parameters. At the last of {steps} measurements the RMS errors of {states} are {measured}, in theory {expected}.", apart(stats, theory), steps=steps, states=listed(lettered(lab)),
           measured=listed(str(rms(stats, state=j, unit=unit)) for j, unit in enumerate(lab.system.units)), expected=listed(f"{sd:.4g} {unit}" for sd, unit in zip(theory.sd_plus[-1], lab.system.units, strict=True)))
    bounded(r, lab, counted, theory, steps)
    return {"stats": stats}


def apart(stats, theory):
    """A sentence where an RMS error at the last instant is by chance far from theory."""
    sd = theory.sd_plus[-1]
    far = float(np.max(np.abs(stats.rms[-1] / np.where(sd > 0, sd, np.inf) - (sd > 0)))) * math.sqrt(2 * stats.runs)
    return text(" One of them lies {far:2} standard errors from theory. Such a point is to be judged among all instants, as {app:chance} does.", far=far) if far > 2.5 else ""


def bounded(r, lab, counted, theory, steps):
    """The state itself beside the error of its estimate."""
    free = covariances(replace(counted, R=[[math.inf]]), steps)
    panels = []
    for j, (name, unit) in enumerate(zip(lettered(lab), lab.system.units, strict=True)):
        pairs = (("state", free.sd_plus[:, j], "orange"), ("error of the estimate", theory.sd_plus[:, j], "blue"))
        curves = tuple(Curve(label, theory.t, positive(sd), colour, quiet=j > 0) for label, sd, colour in pairs if (sd > 0).any())
        if curves:
            panels.append(Panel(text("σ of {state}, {unit}", state=name, unit=unit), curves, kind="log"))
    if not panels:
        return
    r.figure("bounded", Drawing("bounded", STEP, tuple(panels), whole=True, height=1.2 + 1.9 * len(panels)), "Standard deviations of the state and of the error of its estimate after each update.")
    if lab.p.sigma_w2:
        r.says("{fig:bounded} shows what was proved: the standard deviations of the state grow without bound, those of the errors do not. ", ("They have reached their limits at the end of the run." if lab.settled is not None and lab.settled <= steps else "At the end of the run they are still on their way to the limits of {tab:limits}."))
    else:
        r.says("{fig:bounded}: without noise the state keeps the variance of its start (that of x grows with the unknown {quantity}), while the errors of the estimates fall towards 0.", quantity=QUANTITY[lab.n])


def sweeps(r, lab, experiment, stats):
    """Initial covariance, strength, measurement variance and period, one at a time."""
    p, systems, rows = lab.p, {}, []
    cases = [("", p, "")] + [
        (name, p.model_copy(update={name: level * np.asarray(getattr(p, name))}), f"×{level:g}")
        for name, levels in LEVELS.items() for level in levels if np.any(getattr(p, name))
    ]
    settled, settled_again, found, expected = [], [], [], []
    for name, q, level in cases:
        system = replace(sampled(q), dt=1.0)
        limit, settles = steady.solve(system), settling(system)
        steps = length(settles)
        schedule = covariances(system, steps)
        ensemble = experiment.statistics(system, steps=steps) if name else stats
        if name:
            agreement(r, f"{text(NAMES[name])} {level}", ensemble, schedule.P_plus)
        _before, after, _gain = by_hand.steady_state(lab.n, q.sigma_w2, q.tau, q.R)
        found, expected = [*found, np.diag(limit.P_plus)], [*expected, np.diag(after)]
        settled.append(settles)
        settled_again.append(by_hand.settling(system.Phi, factor(system.Qd), q.R, q.P0, np.diag(after)))
        sd = np.sqrt(np.diag(limit.P_plus))
        shown = f"{SYMBOLS[name]} {level}" if name else "given"
        rows.append((shown, replace(lab, p=q).ratio, limit.K[0, 0], sd[0], sd[-1], settles or "—", "—" if settles is None else settles * q.tau, schedule.sd_plus[-1, 0], rms(ensemble)))
        systems[shown] = system
    last = lettered(lab)[-1]
    r.subsection("The factors", "factors")
    r.says("In {tab:factors} one factor at a time is changed. $P_0$ does not change the limit, only the way to it; the disturbance, the measurement errors and the period change the limit and, through ρ, the gain. All rows have the same random numbers, so that their deviations from theory are not independent of one another." if p.sigma_w2
           else "In {tab:factors} one factor at a time is changed. Without disturbance all limits are 0.")
    r.table("factors", ["case", "ρ", "$\\bar K_1$", "limit of σ of x, m", text("limit of σ of {state}, {unit}", state=last, unit=lab.system.units[-1]), "settles at", "settles at, s", "σ of x at the end, m", "RMS at the end, m"], rows,
            "Influence of the factors: limits after an update, settling of all variances, and the error of x at the last measurement of each run, in theory and in the ensemble.")
    routes = ("Riccati equation", "spectral factorisation")
    scale = np.where(np.array(expected) > 0, expected, 1.0)
    r.check("limits of all cases, relative", np.array(found) / scale, np.array(expected) / scale, routes)
    r.check("settling steps of all cases", settled, settled_again, ("recursion", "square-root arrays"), EXACT)
    chosen = {name: system for name, system in systems.items() if name == "given" or name.startswith(SYMBOLS["sigma_w2"])}
    curves = {name: positive(covariances(system, 20).sd_plus[1:, 0]) for name, system in chosen.items()}
    if len(curves) > 1:
        r.figure("factor_sigma_w2", plots.lines(range(1, 21), curves, xlabel=STEP, ylabel="σ of the error of x after an update, m", steps=True, marker="."),
                 "Error of x with a weaker and a stronger disturbance, from the same $P_0$.")
        r.says("In {fig:factor_sigma_w2} the error of x grows with the strength of the disturbance; with a weak one the filter averages more measurements and needs longer to settle.")


def wrong_start(r, lab, experiment, steps):
    """The initial mean of the filter is wrong."""
    p, n = lab.p, lab.n
    r.subsection("A wrong initial mean", "start")
    r.says("A correct $\\bar x_0$, whatever it is, does not enter the errors. A wrong one leaves a bias that obeys $b(t_i) = [I - K(t_i)H]\\Phi\\,b(t_{i-1})$.")
    sd = np.sqrt(np.diag(p.P0))
    offset = np.where(sd > 0, sd, 1.0)
    system = replace(lab.system, dt=1.0)
    truth = replace(system, x0=system.x0 + offset)
    actual = sensitivity.actual(truth, system, steps)
    stats = experiment.statistics(truth, system, steps=steps, stream=2)
    agreement(r, "wrong initial mean", stats, actual.P_plus, actual.bias_plus, consistent=False)
    expected = by_hand.bias(lab.answer["Phi"], lab.answer["standardised_noise_factor"], p.R, p.P0, -offset, steps)
    r.check("bias along the measurements", actual.bias_plus, expected, ("joint recursion of the means", "product of (I − KH)Φ with the gains of the arrays"), scale=sizes(expected, lab.answer["Phi"]))
    shown = sorted({k for k in (0, 1, 2, 3, 5, 10, steps) if k <= steps})
    labels = named(lab)
    r.table("bias", ["i", *(text("bias of {state}", state=s) for s in labels), *(text("ensemble: {state}", state=s) for s in labels)],
            [(k, *actual.bias_plus[k], *(mean_error(stats, k, j) for j in range(n))) for k in shown], "Mean error of the estimate, estimate − truth, where the truth starts above the initial mean by {offset}.", offset=listed(f"{prose(float(o))} {u}" for o, u in zip(offset, lab.system.units, strict=True)))
    largest_pole = float(np.abs(lab.limit.poles).max())
    if not np.any(p.P0) and not p.sigma_w2:
        r.says("{tab:bias} has the numbers. The filter believes that it knows everything: its gain is 0 and the bias is never corrected.")
    elif not lab.limit.K.any():
        r.says("{tab:bias} has the numbers. ", "Two exact measurements leave no bias." if p.R == 0 and n == 2 else "Three exact measurements leave no bias." if p.R == 0 else "The gain tends to 0, so the bias is forgotten only as slowly as new measurements outweigh $P_0$, and where $P_0$ is 0 it stays.")
    else:
        r.says("{tab:bias} shows how it is forgotten. In the steady state its slowest part shrinks by the factor {pole} with each measurement, the largest modulus of the filter's poles.", pole=largest_pole)


def sizes(bias, Phi):
    """What rounding of a bias is measured by: the sizes of the terms that cancel in it, over the last n steps."""
    bias, n, Phi = np.abs(bias), len(Phi), np.abs(Phi)
    terms = [np.vstack([np.repeat(bias[:1], k, axis=0), bias[: len(bias) - k]]) @ np.linalg.matrix_power(Phi, k).T for k in range(n + 1)]
    return np.maximum(np.max(terms, axis=0), 1e-300)


def constant(r, lab, steps):
    """Motion and estimate in words, with the constant taken apart."""
    p, n = lab.p, lab.n
    words = {"quantity": QUANTITY[n], "last": lab.system.states[-1]}
    r.subsection("What motion this is, and what is estimated", "motion")
    if p.sigma_w2:
        r.says("The {quantity} is a Wiener process about a random constant; the coordinate is its {times} integral, a smooth curve that wanders off without bound. The filter estimates the state at the *current* time, among it the current {quantity} $c + \\beta(t_i)$, and not the constant c. With c and β as two states the measurements see only their sum, so that $c - \\beta$ is not observable.", times="first" if n == 2 else "second", **words)
    else:
        r.says("Without disturbance the {quantity} is the random constant c, and the coordinate {curve}. The filter estimates the current state, of which c is a part.", curve=CURVE[n], **words)
    apart = kinematics.with_constant(continuous(p))
    seen = observability.analyse(apart)
    r.value("verdict_constant_observable", bool(seen.ok))
    direction = np.zeros(n + 1)
    direction[-2:] = 1 / math.sqrt(2), -1 / math.sqrt(2)
    r.check("direction that is not observable", np.abs(seen.unobservable[:, 0]) * np.sign(direction), direction, ("staircase", "c − β"))
    known = discretise(apart, p.tau, [[p.R]])
    variance = covariances(known, steps).P_plus[:, n - 1, n - 1]
    unit = squared(lab)[-1]
    end = ending(lab, known, steps)
    r.says(("What becomes known of c comes from $\\beta(t_0) = 0$, through the first measurements, before β has moved away." if p.sigma_w2 else "Nothing makes the constant differ from the state."), " The variance of c goes from {start:4} to {end:4} {unit} after {steps} measurements, {words}.",
           start=variance[0], end=variance[-1], unit=unit, steps=steps,
           words="as it is known from the start" if not variance[0] else "and tends to 0: without noise the constant is the state" if not p.sigma_w2
           else "and falls on" if end is None
           else "and stays there, as no later measurement tells of it" if variance[-1] <= 1.01 * end else text("and falls on to its limit {end:4} {unit}", end=end, unit=unit))
    r.value("constant_variance", variance[-1], unit)
    if p.R:
        k = min(steps, 40)
        whole = by_hand.least_squares(lab.answer["Phi"], lab.answer["standardised_noise_factor"], p.R, p.P0, k)[1]
        r.check(text("variance of the constant at measurement {k}", k=k), variance[k], whole[-1, -1], ("filter with c and β apart", "least squares for x(t0)"), scale=float(variance[0]) or 1.0)
    current = covariances(lab.system, steps).P_plus[:, -1, -1]
    if variance[0]:
        figure = plots.lines(range(steps + 1), {"constant c": variance, text("current {quantity}", **words): current}, xlabel=STEP, ylabel=text("error variance, {unit}", unit=unit), log="y" if min(variance.min(), current.min()) > 0 else "", steps=True, marker=".")
        r.figure("constant", figure, "Error variance of the constant and of the current {quantity}.", **words)
        r.says("{fig:constant} shows both.", (" They are one." if not p.sigma_w2 else " That of the constant has stopped falling; that of the current {quantity} has another limit, the same from every start." if end is not None and variance[-1] <= 1.01 * end else " Both are still on their way at the end of the run."), **words)


def ending(lab, known, steps):
    """The limit of the constant's variance: what is left of it when the filter has settled three times over; None where it does not settle."""
    if lab.settled is None or not lab.p.sigma_w2:
        return None
    return float(covariances(known, max(steps, 3 * lab.settled)).P_plus[-1, lab.n - 1, lab.n - 1])


