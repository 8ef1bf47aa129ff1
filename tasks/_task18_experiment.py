"""Lab 18, part (d): the three sets of measurements on a linear and on a nonlinear truth."""

import math

import numpy as np
from ctlabs.tasks import _task18_scales as scales
from ctlabs.tasks._task18_models import designed, equations, nonlinear
from ctlabs.tasks._task18_scales import LOOKS, MILD, NAMES, STATES, TURNS, UNITS, WORK, revolutions
from ctlabs.tasks.answers import task18 as by_hand
from ctlabs.tasks.answers.task18 import SETS

from ctlabs.labs.experiment import covariances
from ctlabs.labs.portrait import agreement, rms
from ctlabs.models import linearisation
from ctlabs.reporting.drawing import Band, Curve, Drawing, Mark, Panel
from ctlabs.reporting.report import SOLVER
from ctlabs.text import prose, text


def part_d(r, p, experiment, trial):
    """Linear truth, small and full deviations in the nonlinear truth."""
    r.section("d", "Three sets of measurements on the same runs")
    r.says("**Linear truth.** The theory is exact here, and so are the tests.")
    said = linear(r, p, experiment)
    q, steps, parts = trial
    if parts > WORK:
        r.says("The sampling period is so long that the nonlinear motion cannot be followed within it in a sensible number of steps; the nonlinear part is left out.")
        return {"found": None, **said}
    flow = linearisation.flow(equations()[0], {"G": p.r0**3 * by_hand.rate(p) ** 2}, p.dt, parts)
    start = 2 * np.sqrt(np.diag(q.P0))
    path, _transitions = flow.along(np.array([p.r0, 0, 0, by_hand.rate(p)]) + start, steps)
    nominal = np.outer(np.arange(steps + 1) * p.dt, [0, 0, by_hand.rate(p), 0]) + np.array([p.r0, 0, 0, by_hand.rate(p)])
    exact = by_hand.integrated(q, start, np.arange(steps + 1) * p.dt).T
    r.check("nonlinear motion from +2σ", (path - nominal) / by_hand.units(p), exact / by_hand.units(p), ("Runge and Kutta, order 4", "integrator of order 8 at tight tolerance"), SOLVER, scale=max(1.0, float(by_hand.rate(p) * p.dt * steps)))
    r.says("**Nonlinear truth.** The motion is followed by the method of Runge and Kutta of order 4, with one step in a sampling period." if parts == 1 else
           "**Nonlinear truth.** The motion is followed by the method of Runge and Kutta of order 4, with {parts} steps in a sampling period.",
           " From a start of +2σ in all states it differs in $r$ from an integration of order 8 with tight tolerance by {error:2} m at most, where the smallest standard deviation of a filter is {least:2} m.",
           parts=parts, error=float(np.abs(path - nominal - exact)[:, 0].max()), least=float(covariances(designed(q, [0, 1]), steps).sd_plus[:, 0].min()))
    if not scales.regular(q):
        r.says("$P_0$ is singular: both filters take some combinations of the states for exactly known for ever. On the nonlinear truth these combinations curve, however little, and an error against a variance of zero has no size; so the filters are not compared there (a start with small variances instead of zeros allows it).")
        return {"found": None, **said}
    small(r, q, experiment, steps, parts, flow)
    return {"found": large(r, q, experiment, steps, flow), **said}


def linear(r, p, experiment):
    """The linear truth: one run, and the ensembles of the three sets."""
    truth, designs = designed(p, [0, 1]), {name: designed(p, rows) for name, rows in SETS.items()}
    one_run(r, p, experiment, truth, designs)
    turns, panels, found = revolutions(p, p.steps), [[] for _ in STATES], {}
    for (name, design), (colour, style) in zip(designs.items(), LOOKS, strict=True):
        stats, theory = experiment.statistics(truth, design, steps=p.steps), covariances(design, p.steps)
        agreement(r, NAMES[name], stats, theory.P_plus, consistent=scales.regular(p))
        found[name] = stats
        sd = np.where(theory.sd_plus > 0, theory.sd_plus, np.nan)
        for i, panel in enumerate(panels):
            panel.append(Curve(NAMES[name], turns, (stats.rms / sd)[1:, i], colour, style, size=2.5))
    low, high = (np.full(len(turns), edge[0, 0]) for edge in stats.rms_band(np.ones((1, 1, 1))))
    band = (Band("95 % of ensembles", turns, low, high, "grey"),)
    r.figure("ensemble", Drawing("Ensembles", TURNS, tuple(Panel(text("ratio RMS/σ of {state}", state=state), tuple(panel), band, levels=(Mark("theory", 1.0),)) for state, panel in zip(STATES, panels, strict=True)), height=8.0),
             "RMS errors of {runs} runs over the standard deviations of theory, for the three sets of measurements and the four states.", runs=experiment.runs)
    r.says("In {fig:ensemble} the errors of the three filters, on the same runs, are those that theory gives them: the ratios scatter about 1. As nothing disturbs the motion, the errors of neighbouring instants are almost the same error, so that a curve that leaves the band stays outside for a while.")
    return {"measured": rms(found["both"], unit="m"), "sd": float(covariances(designs["both"], p.steps).sd_plus[-1, 0])}


def one_run(r, p, experiment, truth, designs):
    """The errors of the three filters in one run."""
    panels = [[], []]
    for (name, design), colour in zip(designs.items(), ("blue", "orange", "green"), strict=True):
        seen = experiment.histories(truth, design, steps=p.steps, runs=1)
        turns, error = revolutions(p, p.steps), seen.error()[1:, :, 0]
        for panel, i, unit in zip(panels, (0, 2), (1.0, 1e6), strict=True):
            size, sd = np.abs(error[:, i]) * unit, seen.sd_plus[1:, i] * unit
            panel += [Curve(NAMES[name], turns, np.where(size > 0, size, np.nan), colour, "points", size=2.5),
                      Curve(text("its σ, {name}", name=NAMES[name]), turns, np.where(sd > 0, sd, np.nan), colour)]
    r.figure("errors", Drawing("Errors", TURNS, (Panel("error of δr, m", drawn(panels[0]), kind="log"), Panel("error of δΘ, µrad", drawn(panels[1]), kind="log")), height=6.4),
             "One run: sizes of the errors of the range and of the angle after each measurement with the three sets (points), and their standard deviations in theory (lines).")
    r.says("{fig:errors} shows one run. Each error stays about its standard deviation or below it. With the range only the error of the angle has no way to decay: what is left of it is what the range does not see.")


def drawn(curves):
    """Those curves that have anything to draw."""
    return tuple(curve for curve in curves if np.isfinite(curve.y).any())


def consistency(r, q, found):
    """NEES of both filters with the three sets."""
    t = revolutions(q, len(found["both"][0].nees) - 1)
    panels = tuple(
        Panel(text("NEES, {label} filter", label=label),
              tuple(Curve(NAMES[name], t, found[name][j].nees[1:], colour, style, size=2.5) for name, (colour, style) in zip(SETS, LOOKS, strict=True)),
              kind="log", levels=(Mark("consistent", 4.0),))
        for j, label in enumerate(("linear", "extended")))
    r.figure("nees", Drawing("NEES", TURNS, panels, height=6.4), "Average NEES of the linear and of the extended filter on the nonlinear truth, for the three sets; 4 where the covariance of a filter is true.")
    r.says("{fig:nees} and {tab:filters} tell the two filters apart. A NEES far above 4 means that the errors are larger than the filter believes: the linear filter neglects the curvature of the motion, and the more accurate the measurements, the sooner what it neglects is larger than its standard deviations. The extended filter linearises about its own estimate, which is as near to the truth as its errors are small.")


def small(r, q, experiment, steps, parts, flow):
    """Deviations and noises so small that the equations are linear."""
    least = float((covariances(designed(q, [0, 1]), steps).sd_plus[-1] / by_hand.units(q)).min())
    bend = 4 * scales.relative(q, q.P0) ** 2 * (1 + 3 * by_hand.rate(q) * q.dt * steps)
    factor = min(1.0, 0.01 * least / bend) if bend and least else 1.0
    rounding = np.finfo(float).eps * math.sqrt(steps * parts) * (1 + 3 * by_hand.rate(q) * q.dt * steps)
    r.says("**Small deviations.** All standard deviations (of the start and of the measurements) are multiplied by {factor:2}, so that the quadratic terms are below a hundredth of the smallest error; the gains stay the same. The linear filter (here with both measurements) must then be right on the nonlinear truth, up to the ensemble's chance.", factor=factor)
    if factor * least < 30 * rounding:  # its square, what the variances would be off by, must stay below 0.1 %
        r.says("This test is left out here. The smallest error would be {share:2} of the radius, and rounding alone moves a position on the orbit by some {rounding:2} of it in so many steps: the test would be one of the arithmetic.", share=factor * least, rounding=rounding)
        return
    tiny = q.model_copy(update={"P0": tuple(map(tuple, (np.array(q.P0) * factor**2).tolist())), "sigma_r": q.sigma_r * factor, "sigma_theta": q.sigma_theta * factor})
    design = designed(tiny, SETS["both"])
    stats = experiment.statistics(nonlinear(tiny, flow), design, steps=steps)
    agreement(r, text("small deviations, {name}", name=NAMES["both"]), stats, covariances(design, steps).P_plus)


def large(r, q, experiment, steps, flow):
    """The deviations planned: linear and extended filter."""
    r.says("**The deviations planned.** The linear filter keeps to the nominal orbit; the extended one linearises about its own estimate.")
    truth, found, rows = nonlinear(q, flow), {}, []
    for name, which in SETS.items():
        theory = covariances(designed(q, which), steps)
        plain = experiment.statistics(truth, designed(q, which), steps=steps)
        extended = experiment.statistics(truth, nonlinear(q, flow, which, bounded=True), steps=steps)
        # The quadratic term of a prediction against the noise, and that of the orbit's phase against 1.
        bend = scales.relative(q, theory.P_minus[1:]) ** 2 * (1 + 3 * by_hand.rate(q) * q.dt) / min(q.sigma_theta, q.sigma_r / q.r0)
        turn = (10 * scales.relative(q, q.P0) * (1 + by_hand.rate(q) * q.dt * steps)) ** 2
        index, tested = max(bend, turn), max(bend, turn) < MILD
        if tested:
            agreement(r, text("extended filter, {name}", name=NAMES[name]), extended, theory.P_plus)
        found[name] = (plain, extended, theory, tested, index)
        for label, stats in (("linear", plain), ("extended", extended)):
            rows.append((NAMES[name], label, *(rms(stats, state=i) for i in range(4)), stats.nees[-1], stats.nis[-1]))
        rows.append((NAMES[name], "theory", *theory.sd_plus[-1], 4, len(which)))
    r.table("filters", ["measured", "filter", *(f"RMS {state}, {unit}" for state, unit in zip(STATES, UNITS, strict=True)), "NEES", "NIS"], rows,
            "RMS errors of both filters at the last of {n} measurements, with standard errors, against the theory of small deviations.", n=steps)
    r.value("nees_linear", [found[name][0].nees[-1] for name in SETS])
    r.value("nees_extended", [found[name][1].nees[-1] for name in SETS])
    consistency(r, q, found)
    untested = [NAMES[name] for name in SETS if not found[name][3]]
    r.says("Errors of a nonlinear filter are not exactly Gaussian, and its covariance is that of its own orbit. Two quadratic terms say how far this matters: $\\rho^2(1 + 3w\\,dt)/\\min(\\sigma_\\Theta, \\sigma_r/r_0)$, a prediction's against the noise (where ρ is the largest relative prediction error), and $[10\\rho_0(1 + wT)]^2$, that of the phase of the orbit (where $\\rho_0$ is ρ at the start). The larger one is {index} for the angle, the range, and both. Below {mild} the extended filter is held to the same tests as a linear one, whose bounds are wide against such terms; ",
           "so it is in all three cases." if not untested else "not tested are {untested}, of which {tab:filters} says how they do.",
           index=prose([found[name][4] for name in SETS], 2), mild=MILD, untested=", ".join(untested))
    return found
