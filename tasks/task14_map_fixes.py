r"""Lab 14. Where to take two map fixes.

Source: Semushin & Tsyganova 2001, task 14. A vehicle drifts along a line, x(i+1) = x(i) + u + w(i). Of ten possible
position fixes at t = 0…9 only two can be afforded, and the RMS of the position at t = 10 is to be least. (a) no other
condition; (b) a fix is possible only while the RMS is at most 75, since beyond it the vehicle may have left the stored map;
(c), (d), (e) the same with a larger P0, Qd or R; (f) an experiment, and a program that tries all selections.

Expected answer: (a) the last two instants, (8, 9); (b) (5, 9); (c) and (d) no pair keeps the limit; (e) (5, 7). There are
C(10, 2) = 45 pairs.
"""

import math
from dataclasses import replace

import numpy as np
from ctlabs.tasks.answers import task14 as by_hand
from pydantic import model_validator

from ctlabs.analysis import scheduling
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import agreement, largest
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import DiscreteModel
from ctlabs.reporting import plots
from ctlabs.reporting.params import Count, LabParameters, Positive, Real, given
from ctlabs.reporting.report import EXACT, Report
from ctlabs.text import text

META = {
    "name": "task14",
    "title": "Where to take two map fixes",
    "source": "Semushin & Tsyganova 2001, task 14",
    "parts": ["a", "b", "c", "d", "e", "f"],
}


class Parameters(LabParameters):
    """What may be changed."""

    sigma: Positive = given(30.0, unit="m", meaning="root of P0, Qd and R in (a) and (b)")
    sigma_high: Positive = given(90.0, unit="m", meaning="its place in P0 in (c), in Qd in (d), in R in (e)")
    limit_rms: Positive = given(75.0, unit="m", meaning="largest RMS before a fix, (b) to (e)")
    horizon: Count = given(10, unit="1", meaning="number of instants; the RMS at t = horizon counts")
    fixes: Count = given(2, unit="1", meaning="number of fixes that can be afforded")
    u: Real = given(1.0, unit="m", meaning="known displacement in a period (in the simulation only)")
    x0_mean: Real = given(0.0, unit="m", meaning="mean of x(t0) (in the simulation only)")

    @model_validator(mode="after")
    def _enough_instants(self):
        if self.fixes > self.horizon:
            msg = f"expected at most as many fixes as instants ({self.horizon}), received {self.fixes}"
            raise ValueError(msg)
        if math.comb(self.horizon, self.fixes) > 2_000_000:
            msg = f"expected at most 2000000 selections to enumerate, received C({self.horizon}, {self.fixes}) = {math.comb(self.horizon, self.fixes)}"
            raise ValueError(msg)
        return self


def model(p, P0, Qd, R):
    """x(i+1) = x(i) + u + w(i), z(i) = x(i) + v(i)."""
    return DiscreteModel(Phi=[[1]], Qd=[[Qd]], H=[[1]], R=[[R]], x0=[p.x0_mean], P0=[[P0]], dt=1, offset=[p.u], states=["x"], units=["m"])


def planned(p, system, instants):
    """The same with measurements at the chosen instants only."""
    R = np.full((p.horizon + 1, 1, 1), np.inf)
    R[list(instants)] = system.R
    return replace(system, R=R)


TITLES = {
    "a": "The least RMS at the end, no other condition",
    "b": "A fix only while the RMS is within the limit",
    "c": "A larger initial variance",
    "d": "A larger process noise",
    "e": "A larger measurement noise",
}


def solve(r, p, part, system, every, answer):
    """One part: the best plan by search, by complete enumeration, and what is missing where there is none."""
    r.section(part, TITLES[part])
    P0, Qd, R, limit = by_hand.cases(p)[part]
    if part == "a":
        r.says("The covariance does not depend on data, so a plan can be made before the flight. Between fixes the variance grows by $Q_d$ a period; a fix adds information:")
        r.math(r"P(t_{i+1}^-) = P(t_i^+) + Q_d, \qquad \frac1{P(t_i^+)} = \frac1{P(t_i^-)} + \frac1R \;\text{at a fix}, \qquad P(t_i^+) = P(t_i^-) \;\text{elsewhere}")
        r.model(system)
        r.value("pairs", len(every.rms), agrees=answer, routes=("enumeration", "binomial coefficient"), kind=EXACT)
    r.says("$P_0 = {start}$ m², $Q_d = {noise}$ m², $R = {error}$ m²", ", the RMS before a fix at most {limit} m." if limit else ", no limit.", start=P0, noise=Qd, error=R, limit=limit)
    plan = scheduling.best(system, p.fixes, p.horizon, limit=limit)
    none = "no selection keeps the limit"
    routes = ("search by dominated covariances", "every selection tried")
    r.value(f"{part}_best_pair", None if plan.instants is None else list(plan.instants), reason=none, agrees=answer, routes=routes)
    r.value(f"{part}_terminal_rms", plan.rms, "m", reason=none, agrees=answer, routes=routes)
    r.value(f"{part}_feasible_pairs", int(every.feasible(limit).sum()), agrees=answer, routes=("enumeration as arrays", "every selection tried"), kind=EXACT)
    if plan.instants is None:
        r.check("least limit that some selection keeps", plan.needed, answer[f"{part}_needed"], routes)
        free = scheduling.best(system, p.fixes, p.horizon)
        r.says("No selection keeps the limit of {limit} m: the least limit that one keeps is {needed} m. Without a limit the best selection would be {pair} with {rms} m at the end, but its RMS before a fix reaches {worst} m.",
               limit=limit, needed=plan.needed, pair=list(free.instants), rms=free.rms, worst=free.worst)
        fewer = fewer_fixes(system, p, limit)
        if fewer:
            r.says("Still possible within the limit: {count} of {wanted} fixes, at {pair}, with {rms} m at the end.", count=len(fewer.instants), wanted=p.fixes, pair=list(fewer.instants), rms=fewer.rms)
        else:
            r.says("Not even one fix can be taken within the limit.")
    else:
        r.says("The best selection is {pair}: {rms} m at the end; {count} of {all} selections are possible.", pair=list(plan.instants), rms=plan.rms, count=int(every.feasible(limit).sum()), all=len(every.rms))
    if limit is not None:
        r.says("The sheet's words set the limit on the RMS *after* a fix. Read so, {posterior} of {all} selections would pass; the limit is read on the RMS *before* it, since that is when the picture must lie on the map.",
               posterior=answer[f"{part}_feasible_posterior"], all=len(every.rms))


def fewer_fixes(system, p, limit):
    """The plan with the most fixes, fewer than asked for, that keeps the limit."""
    for count in range(p.fixes - 1, 0, -1):
        plan = scheduling.best(system, count, p.horizon, limit=limit)
        if plan.instants is not None:
            return plan
    return None


def parts_a_to_e(r, p, systems, every, answer):
    """The five sets of numbers, one after another."""
    for part in "abcde":
        solve(r, p, part, systems[part], every[part], answer)


def plan(r, experiment, every):
    """Every number chosen."""
    r.table("plan", ["quantity", "value", "why"], [
        ["selections tried in each part", len(every["a"].rms), "all of them"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["seed", experiment.seed, "the same for every plan"],
    ], "Plan of the experiment.")


def part_f(r, p, systems, every, answer, experiment):
    """All selections as a figure, the optimum's variance, the ensemble."""
    r.section("f", "All selections, and the ensemble")
    rows, curves = [], {}
    for part, system in systems.items():
        limit = by_hand.cases(p)[part][3]
        posterior = answer[f"{part}_feasible_posterior"]
        rows.append((part, limit, answer[f"{part}_best_pair"], answer[f"{part}_terminal_rms"], answer[f"{part}_feasible_pairs"], posterior, answer[f"{part}_needed"]))
        pair = answer[f"{part}_best_pair"]
        if pair is None:
            continue
        timed = planned(p, system, pair)
        schedule = covariances(timed, p.horizon, first=0)
        stats = experiment.statistics(timed, steps=p.horizon, first=0)
        agreement(r, text("plan of ({part})", part=part), stats, schedule.P_plus)
        r.check(text("RMS at the end, plan of ({part})", part=part), schedule.sd_minus[-1, 0], answer[f"{part}_terminal_rms"], ("filter with R = ∞ elsewhere", "every selection tried"))
        r.check(text("gains at the fixes, plan of ({part})", part=part), schedule.K[pair, 0, 0], answer[f"{part}_gains"], ("recursion", "information of the fixes"))
        curves[text("({part}) fixes at {pair}", part=part, pair=", ".join(map(str, pair)))] = (schedule, stats)
    r.table("plans", ["part", "limit, m", "best selection", "RMS at the end, m", "selections possible", "possible if read after the fix", "least limit that can be kept, m"], rows,
            "The best selections. Their RMS at the end is that of the prediction at t = horizon.")
    if p.fixes == 2:
        r.figure("pairs", plots.pairs(every["b"].instants, every["b"].rms, every["b"].feasible(p.limit_rms), xlabel="first fix, instant number", ylabel="second fix, instant number", label="RMS at the end, m", best=answer["b_best_pair"]),
                 "RMS at the end of every pair, numbers of (b). Crossed out: pairs whose RMS before a fix exceeds the limit. Framed: the best pair that remains.")
    else:
        order = np.sort(every["b"].rms)
        r.figure("selections", plots.lines(range(1, len(order) + 1), {"all selections": order, "possible ones": np.where(np.arange(len(order)) < every["b"].feasible(p.limit_rms).sum(), np.sort(np.where(every["b"].feasible(p.limit_rms), every["b"].rms, np.inf)), np.nan)}, xlabel="rank, number of selections", ylabel="RMS at the end, m", log="x"),
                 "RMS at the end of every selection, in order; all, and those that keep the limit of (b).")
    if curves:
        r.figure("variance", plots.sawtooth({name: schedule for name, (schedule, _stats) in curves.items()}, xlabel="instant number", ylabel="variance, m²", columns=min(3, len(curves))),
                 "Error variance along the flight under the best plans.")
        figure = plots.lines(range(p.horizon + 1), {name: schedule.sd_plus[:, 0] for name, (schedule, _stats) in curves.items()}, xlabel="instant number", ylabel="RMS of the position error, m",
                             points={"_" * i + "ensembles": (range(p.horizon + 1), stats.rms[:, 0]) for i, (_schedule, stats) in enumerate(curves.values())}, steps=True)
        r.figure("ensemble", figure, "RMS of the position error under the best plans: theory and ensembles.")


def conclusions(r, p, answer):
    """What the numbers say."""
    lines = [text("Without a limit the best selection is {pair}: {rms} m at the end.", pair=answer["a_best_pair"], rms=answer["a_terminal_rms"])]
    for part in "bcde":
        pair = answer[f"{part}_best_pair"]
        if pair is None:
            lines.append(text("({part}) No selection keeps the limit of {limit} m; {needed} m would be the least.", part=part, limit=p.limit_rms, needed=answer[f"{part}_needed"]))
        else:
            lines.append(text("({part}) The best selection that keeps the limit is {pair}: {rms} m at the end.", part=part, pair=pair, rms=answer[f"{part}_terminal_rms"]))
    if answer["b_best_pair"] and answer["b_best_pair"] != answer["a_best_pair"]:
        lines.append(text("The limit costs {loss} m at the end: an early fix is spent to keep the vehicle on the map.", loss=answer["b_terminal_rms"] - answer["a_terminal_rms"]))
    lines.append(largest(r))
    r.items(lines)


PARTS = Skeleton(analysis=(parts_a_to_e,), plan=plan, experiment=(part_f,), conclusions=conclusions)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    systems = {part: model(p, *case[:3]) for part, case in by_hand.cases(p).items()}
    every = {part: scheduling.exhaustive(system, p.fixes, p.horizon) for part, system in systems.items()}
    return PARTS.report(META, p, experiment, answer=by_hand.analytic(p), systems=systems, every=every)


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
