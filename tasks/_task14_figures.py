"""Figures of lab 14: all selections, what moving a fix does, what a limit costs, and the flights under the best plans."""

import numpy as np
from ctlabs.tasks._task14_words import named

from ctlabs.reporting import plots
from ctlabs.reporting.drawing import Curve, Drawing, Mark, Panel
from ctlabs.text import text

INSTANT = "instant number"
COLOURS = {"a": "black", "b": "blue", "c": "orange", "d": "green", "e": "purple"}


def selections(r, p, every, answer):
    """Every selection with its RMS at the end."""
    if p.fixes != 2:
        order, good = np.sort(every["b"].rms), np.sort(every["b"].rms[every["b"].feasible(p.limit_rms)])
        curves = (Curve("all selections", np.arange(1, len(order) + 1), order, "grey"), Curve("those that keep the limit", np.arange(1, len(good) + 1), good, "blue", "points"))
        r.figure("pairs", Drawing("Selections", "rank", (Panel("RMS at the end, m", curves[: 1 + bool(len(good))]),), log=True),
                 "RMS at the end of every selection with the numbers of (b), in order of rank; all of them, and those that keep the limit.")
        r.says("{fig:pairs} has all {n} selections of {count} fixes. ", "The best ones differ little: much is decided by the last fix, and little by where the others stand." if p.fixes > 1 else "The RMS falls with each instant by which the fix is later.", n=answer["pairs"], count=p.fixes)
        return
    maps = {
        title: (every[part].rms, every[part].feasible(p.limit_rms), answer[f"{part}_best_pair"])
        for title, part in {"numbers of (a) and (b)": "b", "(c), larger $P_0$": "c", "(d), larger $Q_d$": "d", "(e), larger $R$": "e"}.items()
    }
    r.figure("pairs", plots.pair_maps(every["b"].instants, maps, xlabel="first fix, instant", ylabel="second fix, instant"),
             "RMS at the end, m, of every pair of fixes. Coloured: pairs that keep the limit on the RMS before a fix; grey numbers: those that do not. Framed: the best pair that keeps it.")
    r.says("{fig:pairs} has all {n} pairs. From row to row, with the second fix, the RMS changes much, and in a row, with the first fix, little; in both directions it falls, as {eq:exchange} says. The limit cuts pairs off from the right, where the first fix comes too late, and from above, where the second one does. Without the limit the upper right corner would be the best, which is (a).", n=answer["pairs"])


def moves(r, p, every, answer):
    """One fix moved while the other one stays, numbers of (b)."""
    pairs, pair = every["b"].instants, answer["b_best_pair"] or answer["a_best_pair"]
    panels = []
    for label, values in (("RMS at the end, m", every["b"].rms), ("largest RMS before a fix, m", every["b"].worst)):
        curves = tuple(
            Curve(text("{which} fix moved, the other at {at}", which=which, at=pair[1 - k]), pairs[chosen, k], values[chosen], colour, style)
            for k, which, colour, style in ((0, "first", "blue", "points"), (1, "second", "orange", "square"))
            if (chosen := pairs[:, 1 - k] == pair[1 - k]).any())
        panels.append(Panel(label, curves, levels=(Mark("limit", p.limit_rms),) if "before" in label else ()))
    r.figure("moves", Drawing("Moves", "instant number of the fix that is moved", tuple(panels), whole=True, height=6.2),
             "What moving one fix of {pair} does, with the numbers of (b): RMS at the end, and largest RMS before a fix.", pair=named(pair))
    first, second = (every["b"].rms[pairs[:, 1 - k] == pair[1 - k]] for k in (0, 1))
    r.says("{fig:moves} moves one fix of {pair} and leaves the other. At the end the RMS lies between {a:4} and {b:4} m as the second fix moves, and between {c:4} and {d:4} m as the first does. What the first one decides is the RMS before the fixes: too early, and it has grown again before the second; too late, and it is large before the first itself.",
           pair=named(pair), a=second.min(), b=second.max(), c=first.min(), d=first.max())


def limits(r, p, every):
    """The best RMS at the end against the limit."""
    top = 1.15 * max(float(every[part].worst[every[part].best()]) for part in "bcde")
    low = 0.9 * min(min(float(every[part].worst.min()) for part in "bcde"), p.limit_rms)
    grid = np.linspace(low, max(top, 1.1 * p.limit_rms), 400)
    curves = []
    for part, style in zip("bcde", ("line", "dash", "line", "dash"), strict=True):
        order = np.argsort(every[part].worst)
        worst, least = every[part].worst[order], np.minimum.accumulate(every[part].rms[order])
        at = np.searchsorted(worst, grid * (1 + 1e-12), side="right") - 1
        curves.append(Curve(text("numbers of ({part})", part=part), grid, np.where(at >= 0, least[np.maximum(at, 0)], np.nan), COLOURS[part], style))
    r.figure("limits", Drawing("Limits", "limit on the RMS before a fix, m", (Panel("least RMS at the end, m", tuple(curves)),), marks=(Mark("given limit", p.limit_rms),)),
             "The least RMS at the end that some selection reaches, against the limit. A curve begins where the first selection becomes possible.")
    r.says("{fig:limits} shows what the limit costs. A curve begins at the least limit that some selection keeps ({tab:plans}) and falls in steps, each at a limit that makes a better selection possible, down to the value without a limit.")


def flights(r, plans, experiment):
    """RMS along the flight under the best plans, and the ensembles."""
    panels = []
    for part, (pair, limit, schedule, stats) in plans.items():
        t = np.arange(len(schedule.t))
        x, y = np.repeat(t, 2), np.column_stack([schedule.sd_minus[:, 0], schedule.sd_plus[:, 0]]).ravel()
        curves = (Curve("theory", x, y, "blue"), Curve("ensemble, after an instant", t, stats.rms[:, 0], "orange", "points"))
        panels.append(Panel(text("({part}) {pair}: RMS, m", part=part, pair=named(pair)), curves, kind="count", levels=(Mark("limit", limit),) if limit else ()))
    r.figure("flights", Drawing("Flights", INSTANT, tuple(panels), whole=True, height=1.4 + 2.1 * len(panels)),
             "RMS of the position error along the flight under the best plans: theory, with a drop at each fix, and ensembles of {runs} runs.", runs=experiment.runs)
    r.says("In {fig:flights} the square of the RMS grows by the same amount in each period, and the RMS drops at each fix; the numbers are in {tab:plans}.",
           " Where there is a limit, each fix comes just before the RMS would cross it, just before the next fix, or at the end." if any(limit for _pair, limit, *_ in plans.values()) else "")
