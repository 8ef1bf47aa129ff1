"""Labs 3 and 4, part (d): the experiment and its conclusions."""

import math
from dataclasses import replace

import numpy as np
from ctlabs.tasks._kinematics_model import continuous, growth, length, named, positive, sampled, squared
from ctlabs.tasks.answers import kinematics as by_hand

from ctlabs.analysis import sensitivity
from ctlabs.filtering import settling, steady
from ctlabs.labs.experiment import covariances
from ctlabs.labs.portrait import agreement, largest, portrait
from ctlabs.linalg.factors import factor
from ctlabs.models import kinematics, observability
from ctlabs.models.discretisation import discretise
from ctlabs.reporting import plots
from ctlabs.reporting.report import EXACT
from ctlabs.text import number, text

#: Levels of the factors in the experiment; the period enters the ratio by a high power.
LEVELS = {"P0": (0.1, 10.0), "sigma_w2": (0.1, 10.0), "R": (0.2, 5.0), "tau": (0.5, 2.0)}
STEP = "measurement number i"
#: What the two sheets call the quantity that is a constant plus a Brownian motion.
QUANTITY = {2: "velocity", 3: "acceleration"}
CURVE = {2: "a straight line", 3: "a parabola"}


def plan(r, lab, experiment):
    """Every number chosen."""
    p, steps = lab.p, length(lab.settled)
    chosen = [(name, [level * getattr(p, name) for level in LEVELS[name]]) for name in ("sigma_w2", "R", "tau")]
    units = {"sigma_w2": str(kinematics.units(continuous(p))["Q"][0][0]), "R": "m²", "tau": "s"}
    r.table("plan", ["quantity", "value", "why"], [
        ["measurements in a run", steps, text("at most 300, of the {settled} that the given filter takes to settle: the figures show its transient, not its limits", settled=lab.settled) if lab.settled is not None and lab.settled > steps
         else "two settling times of the given parameters, at least 20 and at most 300 (40 where nothing settles); for each level of a factor its own"],
        ["initial mean x̄0", list(p.x0_mean), "given; then wrong by one standard deviation (by 1 where P0 is 0)"],
        ["initial covariance P0", [list(row) for row in p.P0], text("given; then times {levels}", levels=list(LEVELS["P0"]))],
        *([f"{name}, {units[name]}", getattr(p, name), text("given; then {levels}", levels=levels)] for name, levels in chosen),
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["seed", experiment.seed, "the same random numbers for all levels, so that they compare"],
    ], "Plan of the experiment.")
    return {"steps": steps}


def part_d(r, lab, experiment, steps):
    """Ensemble against theory, and the two kinds of variances side by side."""
    r.section("d", "The filter at the given parameters")
    counted = replace(lab.system, dt=1.0)
    stats = portrait(r, experiment, counted, steps, limits=(lab.limit.P_minus[0, 0], lab.limit.P_plus[0, 0]))
    worst = max(abs(check.value) for check in r.checks if check.kind == "CHANCE" and check.part == "d")
    some = experiment.histories(counted, steps=steps, runs=1)
    for j, label in list(enumerate(named(lab)))[1:]:
        name = lab.system.states[j]
        r.figure(f"record_{name}", plots.record(some, xlabel=STEP, ylabel=label, state=j, measurement=None),
                 "The same run: {name}, which is not measured, and its estimate with the ±σ band.", name=name)
        shown = {"": covariances(counted, min(steps, 15))}
        pair = (lab.limit.P_minus[j, j], lab.limit.P_plus[j, j])
        r.figure(f"sawtooth_{name}", plots.sawtooth(shown, xlabel=STEP, ylabel=text("variance of {name}, {unit}", name=name, unit=squared(lab)[j]), state=j, limits=[pair]),
                 "Error variance of {name} before and after each update. Dotted: the limits.", name=name)
    free, filtered = covariances(replace(counted, R=[[math.inf]]), steps), covariances(counted, steps)
    curves = {}
    for j, name in enumerate(lab.system.states):
        curves[text("state {name}", name=name)] = positive(free.sd_plus[:, j])
        curves[text("error of {name}", name=name)] = positive(filtered.sd_plus[:, j])
    if any(np.isfinite(c).any() for c in curves.values()):
        figure = plots.lines(filtered.t, curves, xlabel=STEP, ylabel=text("standard deviation ({units})", units=", ".join(lab.system.units)), log="y", steps=True)
        r.figure("bounded", figure, "Standard deviations of the state itself and of the error of its estimate, after each update: the first grow without bound, the second do not." if lab.p.sigma_w2 else "Standard deviations of the state itself and of the error of its estimate, after each update.")
    return {"stats": stats, "largest_given": worst}


def sweeps(r, lab, experiment, stats, largest_given):
    """Initial covariance, strength, measurement variance and period, one at a time."""
    r.says("**Factors.** One factor at a time is changed; the first row is the given case.")
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
        worst = agreement(r, f"{name} {level}", ensemble, schedule.P_plus) if name else largest_given
        ratio = replace(lab, p=q).ratio
        _before, after, _gain = by_hand.steady_state(lab.n, q.sigma_w2, q.tau, q.R)
        found, expected = [*found, np.diag(limit.P_plus)], [*expected, np.diag(after)]
        settled.append(settles)
        settled_again.append(by_hand.settling(system.Phi, factor(system.Qd), q.R, q.P0, np.diag(after)))
        sd = np.sqrt(np.diag(limit.P_plus))
        rows.append((f"{name} {level}".strip() or "given", ratio, list(limit.K[:, 0]), list(sd), settles, None if settles is None else settles * q.tau, list(schedule.sd_plus[-1]), list(ensemble.rms[-1]), worst))
        systems[f"{name} {level}".strip() or "given"] = system
    units = ", ".join(lab.system.units)
    r.table("factors", ["case", "ρ", "K̄", text("steady σ after an update ({units})", units=units), "settling step", "settling time, s", "σ of theory at the last measurement", "RMS of the ensemble there", "largest deviation, σ"], rows,
            "Influence of the factors: limits, settling, and the ensemble at its last measurement; elements in the order of the state.")
    routes = ("Riccati equation", "spectral factorisation")
    scale = np.where(np.array(expected) > 0, expected, 1.0)
    r.check("limits of all cases, relative", np.array(found) / scale, np.array(expected) / scale, routes)
    r.check("settling steps of all cases", settled, settled_again, ("recursion", "square-root arrays"), EXACT)
    for key, title in (("P0", "The initial covariance decides how the limit is approached, not the limit."), ("sigma_w2", "A stronger disturbance raises the limit, and it is reached sooner.")):
        chosen = {name: system for name, system in systems.items() if name == "given" or name.startswith(key)}
        begin = 0 if key == "P0" else 1
        curves = {name: positive(covariances(system, 20).sd_plus[begin:, 0]) for name, system in chosen.items()}
        if len(curves) > 1:
            r.figure(f"factor_{key}", plots.lines(range(begin, 21), curves, xlabel=STEP, ylabel="σ of the error of x after an update, m", log="y", steps=True, marker="."), title)


def wrong_start(r, lab, experiment, steps):
    """The initial mean of the filter is wrong."""
    p, n = lab.p, lab.n
    r.says("**Initial mean.** A correct x̄0, whatever it is, does not enter the errors. A wrong one leaves a bias that obeys $b(t_i) = [I - K(t_i)H]\\Phi\\,b(t_{i-1})$.")
    sd = np.sqrt(np.diag(p.P0))
    offset = np.where(sd > 0, sd, 1.0)
    system = replace(lab.system, dt=1.0)
    truth = replace(system, x0=system.x0 + offset)
    actual = sensitivity.actual(truth, system, steps)
    stats = experiment.statistics(truth, system, steps=steps, stream=2)
    agreement(r, "wrong initial mean", stats, actual.P_plus, actual.bias_plus, consistent=False)
    expected = by_hand.bias(lab.answer["Phi"], lab.answer["standardised_noise_factor"], p.R, p.P0, -offset, steps)
    r.check("bias along the measurements", actual.bias_plus, expected, ("joint recursion of the means", "product of (I − KH)Φ with the gains of the arrays"))
    shown = sorted({k for k in (0, 1, 2, 3, 5, 10, steps) if k <= steps})
    labels = named(lab)
    r.table("bias", ["i", *(text("bias of {state}", state=s) for s in labels), *(text("ensemble: {state}", state=s) for s in labels)],
            [(k, *actual.bias_plus[k], *stats.bias[k]) for k in shown], "Mean error of the estimate where the truth starts at x̄0 + {offset}.", offset=number(list(offset)))
    largest_pole = float(np.abs(lab.limit.poles).max())
    if not np.any(p.P0) and not p.sigma_w2:
        r.says("The filter believes that it knows everything: its gain is 0 and the bias is never corrected.")
    elif not lab.limit.K.any():
        r.says("Two exact measurements leave no bias." if p.R == 0 and n == 2 else "Three exact measurements leave no bias." if p.R == 0 else "The gain tends to 0, so the bias is forgotten only as slowly as new measurements outweigh P0, and where P0 is 0 it stays.")
    else:
        r.says("In the steady state the slowest part of the bias shrinks by {pole} per measurement, the largest modulus of the filter's poles.", pole=largest_pole)


def constant(r, lab, steps):
    """Motion and estimate in words, with the constant taken apart."""
    p, n = lab.p, lab.n
    words = {"quantity": QUANTITY[n], "last": lab.system.states[-1]}
    r.says("**What motion, and what is estimated?** The {quantity} is a Wiener process about a random constant; the coordinate is its {times} integral, a smooth curve that wanders off. The filter estimates the state at the *current* time, among it the current {quantity} $c + \\beta(t_i)$, and not the constant c. With c and β as two states the measurements see only their sum:", times="first" if n == 2 else "second", **words)
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
    r.says("What becomes known of c comes from β(t0) = 0: the first measurements, before β has moved away. Its variance falls from {start} to {end} {unit} after {steps} measurements, {words}.",
           start=variance[0], end=variance[-1], unit=unit, steps=steps,
           words="as it is known from the start" if not variance[0] else "and tends to 0: without noise the constant is the state" if not p.sigma_w2
           else "and falls on" if end is None
           else "and stays there: no later measurement tells of it" if variance[-1] <= 1.01 * end else text("and falls on to its limit {end} {unit}", end=end, unit=unit))
    r.value("constant_variance", variance[-1], unit)
    if p.R:
        k = min(steps, 40)
        whole = by_hand.least_squares(lab.answer["Phi"], lab.answer["standardised_noise_factor"], p.R, p.P0, k)[1]
        r.check(text("variance of the constant at measurement {k}", k=k), variance[k], whole[-1, -1], ("filter with c and β apart", "least squares for x(t0)"), scale=float(variance[0]) or 1.0)
    current = covariances(lab.system, steps).P_plus[:, -1, -1]
    if variance[0]:
        figure = plots.lines(range(steps + 1), {"constant c": variance, text("current {quantity}", **words): current}, xlabel=STEP, ylabel=text("error variance, {unit}", unit=unit), log="y" if min(variance.min(), current.min()) > 0 else "", steps=True, marker=".")
        r.figure("constant", figure, "Error variance of the constant and of the current {quantity}.", **words)


def ending(lab, known, steps):
    """The limit of the constant's variance: what is left of it when the filter has settled three times over; None where it does not settle."""
    if lab.settled is None or not lab.p.sigma_w2:
        return None
    return float(covariances(known, max(steps, 3 * lab.settled)).P_plus[-1, lab.n - 1, lab.n - 1])


def conclusions(r, lab):
    """What the numbers say."""
    p, n, limit, lines = lab.p, lab.n, lab.limit, []
    words = {"quantity": QUANTITY[n]}
    sd = ", ".join(f"{number(math.sqrt(v))} {u}" for v, u in zip(np.diag(limit.P_plus), lab.system.units, strict=True))
    if p.sigma_w2:
        lines.append(text("The point's {quantity} wanders about its random start as a Wiener process; the variance of the coordinate grows like {growth} and has no bound.", growth=growth(n), **words))
        lines.append(text("The errors of the estimates are bounded, because {n} measurements already determine the state: their standard deviations tend to {sd} after an update.", n=n, sd=sd))
        lines.append(regime(lab))
        if lab.settled is not None:
            lines.append(text("From the given P0 all variances stay within 1 % of their limits from measurement {settled} on, {time} s.", settled=lab.settled, time=lab.settled * p.tau))
        else:
            lines.append("The variances need more than 100 000 measurements to come within 1 % of their limits.")
        lines.append("P0 decides how the limit is approached and not the limit; σ_w², R and τ act on the shape of the filter through ρ alone. A correct initial mean does not enter the errors.")
    else:
        lines.append(noiseless(lab))
    kept, steps = r.values["constant_variance"].value, length(lab.settled)
    if p.sigma_w2 and p.P0[-1][-1]:
        lines.append(text("The result of the estimation is the current {quantity}, not its constant part: of that {share} % of the initial variance is left after {steps} measurements.", **words, share=100 * kept / p.P0[-1][-1], steps=steps))
    lines.append(largest(r))
    r.items(lines)


def noiseless(lab):
    """What happens for σ_w² = 0."""
    p, words = lab.p, {"quantity": QUANTITY[lab.n], "curve": CURVE[lab.n]}
    if not np.any(p.P0):
        return "Nothing is random and everything is known from the start: the gain is 0 and measurements change nothing."
    if p.R == 0:
        return text("Without noise the {quantity} is a constant and the coordinate {curve}: with measurements free of error everything is known from measurement {settled} on.", settled=lab.settled, **words)
    found = text("Without noise the {quantity} is a constant and the coordinate {curve}. The error variances and the gain tend to 0 like powers of 1/i, and nothing settles within a fraction of its limit.", **words)
    if np.linalg.matrix_rank(p.P0) == lab.n:
        found += text(" The variance of x goes like {factor}R/i: that of the end of {curve} fitted to i points.", factor=lab.n**2, **words)
    return found


def regime(lab):
    """How the filter works at this ρ."""
    first = float(lab.limit.K[0, 0])
    if lab.p.R == 0:
        return text("The position is measured without error; only what is not measured has to be estimated, from the last few measurements. The scaled gains are those for ρ = ∞, {gain}.", gain=number(list(lab.limit.K[:, 0] * lab.p.tau ** np.arange(lab.n))))
    if first > 0.9:
        found = "At ρ = {ratio} a measurement weighs {gain}: the disturbance between two measurements exceeds their errors, and the filter follows the last few of them."
    elif first > 0.5:
        found = "At ρ = {ratio} a measurement weighs {gain}: disturbance and measurement errors are in balance."
    else:
        found = "At ρ = {ratio} a measurement weighs only {gain}: the filter averages many of them, and the position is known {better} times better than one measurement tells it."
    return text(found, ratio=lab.ratio, gain=first, better=1 / math.sqrt(first))
