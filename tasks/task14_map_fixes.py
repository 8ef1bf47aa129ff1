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
from ctlabs.tasks import _task14_figures as figures
from ctlabs.tasks import _task14_words as words
from ctlabs.tasks.answers import task14 as by_hand
from pydantic import model_validator

from ctlabs.analysis import scheduling
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import agreement, rms
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import DiscreteModel
from ctlabs.reporting.draws import one_of, span
from ctlabs.reporting.params import Count, LabParameters, Positive, Real, given
from ctlabs.reporting.report import EXACT, Report
from ctlabs.text import text

META = {
    "name": "task14",
    "title": "Where to take the map fixes",
    "source": "Semushin & Tsyganova 2001, task 14",
    "parts": ["a", "b", "c", "d", "e", "f"],
}


class Parameters(LabParameters):
    """What may be changed."""

    sigma: Positive = given(30.0, unit="m", meaning="root of $P_0$, $Q_d$ and $R$ in (a) and (b)", draw=span(24, 36, 1))
    sigma_high: Positive = given(90.0, unit="m", meaning="its place in $P_0$ in (c), in $Q_d$ in (d), in $R$ in (e)", symbol=r"\sigma_{\mathrm{high}}", draw=span(80, 110, 2))
    limit_rms: Positive = given(75.0, unit="m", meaning="largest RMS before a fix, (b) to (e)", symbol="L", draw=span(60, 90, 1))
    horizon: Count = given(10, unit="1", meaning="number of instants; the RMS at the one after them counts", symbol="N", draw=one_of(9, 10, 11, 12))
    fixes: Count = given(2, unit="1", meaning="number of fixes that can be afforded", symbol="m")
    u: Real = given(1.0, unit="m", meaning="known displacement in a period (in the simulation only)")
    x0_mean: Real = given(0.0, unit="m", meaning="mean of x(t0) (in the simulation only)", symbol=r"\bar x_0")

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


def part_a(r, p, systems, every, answer):
    """No other condition: why the last instants."""
    r.section("a", "The least RMS at the end, no other condition")
    r.says("The covariance does not depend on data ({ref:maybeck, section 5.3}), so a plan can be made before the flight. Between fixes the position moves by the known displacement $c$ of a period, which leaves the error as it is, and the variance grows by $Q_d$ a period; a fix adds information:")
    r.math(r"P(t_{i+1}^-) = P(t_i^+) + Q_d, \qquad P(t_i^+) = h(P(t_i^-)) \;\text{at a fix}, \qquad h(P) = \frac{PR}{P + R}, \qquad P(t_i^+) = P(t_i^-) \;\text{elsewhere}", "variance")
    r.model(systems["a"])
    r.value("pairs", len(every["a"].rms), agrees=answer, routes=("enumeration", "binomial coefficient"), kind=EXACT)
    r.says("**Why a fix is worth more later.** Compare a fix at $t_i$ with the same fix at $t_{i+1}$. Just after $t_{i+1}$ the first has left $h(P) + Q_d$, the second leaves $h(P + Q_d)$. The slope of $h$ is")
    r.math(r"h'(P) = \left(\frac{R}{P + R}\right)^2 < 1 \;\text{for}\; P > 0, \qquad \text{hence} \qquad h(P + Q_d) < h(P) + Q_d", "exchange")
    r.says("In words: the early fix leaves the noise of the next period untouched, the late one shrinks it together with the rest. Whatever follows is an increasing function of $P$, for both $h(P)$ and $P + Q_d$ rise with $P$; so a smaller variance after $t_{i+1}$ is a smaller one ever after. **Moving a fix to the next instant, if that is free, lowers the variance at every later instant.** By such moves, the last fix first, every selection turns into the one of the last instants, and it gets better with each move: without another condition the last instants are the best. ∎")
    solve(r, p, "a", systems["a"], every["a"], answer)


def part_b(r, p, systems, every, answer):
    """With the limit: how far a fix can be moved."""
    r.section("b", "A fix only while the RMS is within the limit")
    r.says("Now a fix at $t_i$ needs $P(t_i^-) \\le L^2$ with the limit $L$. By {eq:exchange} a move to the next instant still lowers all later variances, so it keeps the limit at all later fixes; only at its own new instant may the limit forbid it. **In the best selection, therefore, no fix can be moved:** each stands directly before the next fix, at the last instant, or as late as the limit allows. For a fix before which $n$ periods have passed since the variance was $P$ this means")
    r.math(r"P + nQ_d \le L^2, \qquad n \le \frac{L^2 - P}{Q_d}", "latest")
    r.says("(The limit is read on the RMS *before* a fix, since that is when the picture must lie on the map. The words of the sheet could also be read as setting it on the RMS *after* a fix; how many selections would then be possible is in {tab:plans}.)")
    solve(r, p, "b", systems["b"], every["b"], answer)


def part_c(r, p, systems, every, answer):
    """A larger P0."""
    r.section("c", "A larger initial variance")
    solve(r, p, "c", systems["c"], every["c"], answer)


def part_d(r, p, systems, every, answer):
    """A larger Qd."""
    r.section("d", "A larger process noise")
    solve(r, p, "d", systems["d"], every["d"], answer)


def part_e(r, p, systems, every, answer):
    """A larger R."""
    r.section("e", "A larger measurement noise")
    solve(r, p, "e", systems["e"], every["e"], answer)


def solve(r, p, part, system, every, answer):
    """One part: the best plan by search, by complete enumeration, and why it is the best, or what is missing where there is none."""
    P0, Qd, R, limit = by_hand.cases(p)[part]
    r.says("Here $P_0 = {start}$ m², $Q_d = {noise}$ m², $R = {error}$ m²", ", and $L = {limit}$ m." if limit else ", without a limit.", start=P0, noise=Qd, error=R, limit=limit)
    plan = scheduling.best(system, p.fixes, p.horizon, limit=limit)
    none = "no selection keeps the limit"
    routes, letter = ("search by dominated covariances", "every selection tried"), text("({part})", part=part)
    r.value(f"{part}_best_pair", None if plan.instants is None else list(plan.instants), reason=none, agrees=answer, routes=routes)
    r.value(f"{part}_terminal_rms", plan.rms, "m", reason=none, agrees=answer, routes=routes)
    r.value(f"{part}_feasible_pairs", int(every.feasible(limit).sum()), agrees=answer, routes=("enumeration as arrays", "every selection tried"), kind=EXACT)
    if plan.instants is None:
        r.check("least limit that some selection keeps", plan.needed, answer[f"{part}_needed"], routes)
        missing(r, p, (P0, Qd, R, limit), plan, scheduling.best(system, p.fixes, p.horizon), fewer_fixes(system, p, limit))
        return
    r.check(text("fixes that can be moved, {part}", part=letter), words.movable(P0, Qd, R, limit, plan.instants, p.horizon), 0, ("best selection", "no move is left"), EXACT)
    r.says("Of {all} selections {count} keep the limit, and the best of them is {pair}: RMS {rms:4} m at the end." if limit else "The best of {all} selections is {pair}: RMS {rms:4} m at the end.",
           pair=words.named(plan.instants), rms=plan.rms, count=int(every.feasible(limit).sum()), all=len(every.rms))
    if limit:
        r.items(words.reasons(P0, Qd, R, plan.instants, p.horizon))


def missing(r, p, case, plan, free, fewer):
    """Why no selection keeps the limit, and what is still possible."""
    P0, Qd, R, limit = case
    if limit**2 < P0:
        r.says("At the start the RMS is {start:4} m already, above the limit of {limit} m, and without a fix it only grows: no fix can be taken at all.", start=math.sqrt(P0), limit=limit)
    else:
        r.says("At the start the RMS of {start:4} m is within the limit. But a period adds $Q_d = {Q}$ m² to what a fix with $R = {R}$ m² leaves, and the variance passes $L^2 = {square}$ m² before {count} fixes have been taken, even if they follow each other at once.", start=math.sqrt(P0), R=R, Q=Qd, square=limit**2, count=p.fixes)
    r.says("The least limit that some selection keeps is {needed:4} m. Without a limit the best selection would be {pair} with {rms:4} m at the end, but its RMS before a fix reaches {worst:4} m.",
           needed=plan.needed, pair=words.named(free.instants), rms=free.rms, worst=free.worst)
    if fewer:
        r.says("Still possible within the limit: {count} of {wanted} fixes, at {pair}, with {rms:4} m at the end.", count=len(fewer.instants), wanted=p.fixes, pair=words.named(fewer.instants), rms=fewer.rms)


def fewer_fixes(system, p, limit):
    """The plan with the most fixes, fewer than asked for, that keeps the limit."""
    for count in range(p.fixes - 1, 0, -1):
        plan = scheduling.best(system, count, p.horizon, limit=limit)
        if plan.instants is not None:
            return plan
    return None


def plan(r, p, experiment, every):
    """Every number chosen."""
    r.says("{tab:plan} lists what was chosen: the search needs no random numbers, the ensemble follows each best plan.")
    r.table("plan", ["quantity", "value", "why"], [
        ["selections tried in each part", len(every["a"].rms), "all of them"],
        ["instants, and fixes among them", [p.horizon, p.fixes], "given"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["seed", experiment.seed, "the same for every plan"],
    ], "Plan of the experiment.")


def part_f(r, p, systems, every, answer, experiment):
    """All selections, the flights under the best plans, the ensemble."""
    r.section("f", "All selections, and the ensemble")
    figures.selections(r, p, every, answer)
    if p.fixes == 2:
        figures.moves(r, p, every, answer)
    figures.limits(r, p, every)
    rows, flights = [], {}
    for part, system in systems.items():
        limit = by_hand.cases(p)[part][3]
        pair = answer[f"{part}_best_pair"]
        rows.append((text("({part})", part=part), limit, "none" if pair is None else words.named(pair), answer[f"{part}_terminal_rms"], answer[f"{part}_feasible_pairs"], answer[f"{part}_feasible_posterior"], answer[f"{part}_needed"]))
        if pair is None:
            continue
        timed = planned(p, system, pair)
        schedule = covariances(timed, p.horizon, first=0)
        stats = experiment.statistics(timed, steps=p.horizon, first=0)
        agreement(r, text("plan of ({part})", part=part), stats, schedule.P_plus)
        r.check(text("RMS at the end, plan of ({part})", part=part), schedule.sd_minus[-1, 0], answer[f"{part}_terminal_rms"], ("filter with R = ∞ elsewhere", "every selection tried"))
        r.check(text("gains at the fixes, plan of ({part})", part=part), schedule.K[pair, 0, 0], answer[f"{part}_gains"], ("recursion", "information of the fixes"))
        flights[part] = (pair, limit, schedule, stats)
    r.table("plans", ["part", "limit, m", "best selection", "RMS at the end, m", "selections possible", "possible if read after the fix", "least limit that can be kept, m"], rows,
            "The best selections; their RMS at the end is that of the prediction for the last instant.")
    figures.flights(r, flights, experiment)
    return {"measured": rms(flights["a"][3], unit="m")}


PARTS = Skeleton(
    result=words.result,
    key="pairs",
    analysis=(part_a, part_b, part_c, part_d, part_e),
    plan=plan,
    experiment=(part_f,),
    discussion=words.discussion,
    answers=words.answers,
    conclusions=words.conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    systems = {part: model(p, *case[:3]) for part, case in by_hand.cases(p).items()}
    every = {part: scheduling.exhaustive(system, p.fixes, p.horizon) for part, system in systems.items()}
    return PARTS.report(META, p, experiment, answer=by_hand.analytic(p), systems=systems, every=every)


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
