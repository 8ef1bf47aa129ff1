"""What a regulator costs, in its report: by several routes, beside a wrong design, by sources and weights, over many runs."""

from __future__ import annotations

from typing import Any

import numpy as np

from ctlabs.labs.portrait import tested
from ctlabs.montecarlo import chance
from ctlabs.regulation.runs import LoopEnsemble
from ctlabs.reporting.report import SOLVER, Report
from ctlabs.studies import common, loops
from ctlabs.studies.regulating import Regulated
from ctlabs.text import _, fill, number


def write(report: Report, found: Regulated) -> None:
    """The cost on its routes, that of a wrong design, the ensemble, the budget, and the curves."""
    cost, per = found.regulator.cost, _per(found)
    rows: list[list[Any]] = [[_("by separation"), cost.value], [_("by the covariance of the closed loop"), cost.closed_loop], [_("by the innovations"), cost.innovations]]
    report.value("cost", cost.value, per)
    report.value("cost_regulation", cost.regulation, per)
    report.value("cost_estimation", cost.estimation, per)
    if cost.between:
        report.value("cost_between_samples", cost.between, per)
    if cost.offset:
        report.value("cost_offset", cost.offset, per)
    routes = _("separation"), _("covariance of the closed loop"), _("innovations")
    size = abs(cost.value) or 1.0
    report.check(_("cost"), cost.value, cost.closed_loop, (routes[0], routes[1]), SOLVER, scale=size)
    report.check(_("cost, again"), cost.value, cost.innovations, (routes[0], routes[2]), SOLVER, scale=size)
    report.table("cost", [_("route"), _each(found)], rows, _("The cost on three routes that share no formula."))
    if found.other is not None:
        report.says(_("These are the costs that the design believes in."))
    report.says(
        _("What the disturbances would cost a regulator that knows the state is {known}; not knowing it adds {unknown}."),
        known=cost.regulation + cost.offset + cost.between, unknown=cost.estimation,
    )  # fmt: skip
    if found.other is not None:
        _wrong(report, found)
    if found.ensemble:
        _many(report, found, found.ensemble.value)
    else:
        report.says(_("There is no ensemble: {reason}."), reason=found.ensemble.reason)
    if found.other is None:
        _budget(report, found)
    _curves(report, found)


def _per(found: Regulated) -> str:
    """The unit of a cost whose weights have none."""
    return "1/s" if found.per == "s" else "1"


def _each(found: Regulated) -> str:
    """What a cost is counted by, as a heading."""
    return {"s": _("cost per second"), "step": _("cost per step"), "horizon": _("cost of the horizon")}[found.per]


def _wrong(report: Report, found: Regulated) -> None:
    """What a wrong design believes, what is true, and what could be."""
    claimed, optimal, per = found.regulator.cost.value, found.best.regulator.cost.value, _per(found)
    true = found.cost.found
    report.value("cost_claimed", claimed, per)
    report.value("cost_optimal", optimal, per)
    report.value("cost_true", true, per, reason=found.cost.reason)
    if true is None:
        report.value("verdict", fill(_("The regulator of the wrong design does not hold this plant: {reason}."), reason=found.growing or found.cost.reason))
    else:
        text = _("The wrong design believes that it costs {claimed}; in truth it costs {true}, a factor {factor} above the {optimal} of the right one.")
        report.value("verdict", fill(text, claimed=number(claimed, 4), true=number(true, 4), factor=number(true / optimal, 4), optimal=number(optimal, 4)))
        report.value("factor", true / optimal)
    report.says("{verdict}", verdict=report.values["verdict"].value)


def _budget(report: Report, found: Regulated) -> None:
    """The cost by source, by weight and by what is not known."""
    budget = found.budget.found
    if budget is None:
        report.says(_("There is no budget of the cost: {reason}."), reason=found.budget.reason)
        return
    total = budget.total or 1.0
    rows = [[name, float(value), float(value) / total] for name, value in budget.table()]
    heads = [_("source"), _each(found), _("share")]
    report.table("budget", heads, rows, _("Where the cost comes from: by source of noise."))
    report.table("weights", [_("weighed"), *heads[1:]], found.weighed(), _("The same cost by what is weighed, at the samples."))
    whole = sum(budget.sources.values()) + budget.between
    report.check(_("cost budget adds up"), whole, budget.total, (_("sum over the sources"), _("separation")), SOLVER, scale=total)
    weighed = sum(budget.weights.values()) + budget.between
    report.check(_("weights add up"), weighed, budget.total, (_("sum over the weights"), _("separation")), SOLVER, scale=total)
    bars = {str(name): float(value) for name, value in budget.table()[:-1]}
    report.figure("budget", loops.shares(bars, _each(found)), _("The cost by source of noise."))


def _curves(report: Report, found: Regulated) -> None:
    """Costs of other weights and other periods, of the design."""
    if found.tradeoff:
        i = _foremost(found)
        caption = _("RMS of {name} against that of {u} as the weight of the inputs changes from a hundredth to a hundredfold: no regulator is below the curve.")
        report.figure("tradeoff", loops.tradeoff(found, i), caption, name=found.truth.states[i], u=found.inputs[0])
    if found.periods:
        caption = _("The least cost per second that can be had with other periods; what happens between the samples is counted.")
        report.figure("periods", loops.periods(found), caption)


def _foremost(found: Regulated) -> int:
    """The state whose share of the cost is largest; the first where that is not known."""
    budget = found.budget.found
    shares = {} if budget is None else budget.weights
    return int(np.argmax([shares.get(name, 0.0) for name in found.truth.states]))


def _many(report: Report, found: Regulated, runs: LoopEnsemble) -> None:
    """The ensemble: RMS of states and inputs, and the cost, against theory."""
    stats, theory = runs.statistics, runs.theory
    tests: dict[str, Any] = {"mean of states and inputs": chance.bias(stats, theory.P), "variance of states and inputs": chance.variance(stats, theory.P)}
    if runs.cost_sd > 0:
        tests["cost of the runs"] = chance.average_of_squares(runs.cost, runs.cost_expected, runs.cost_sd, stats.runs)
    worst = tested(report, "", tests)
    report.value("cost_ensemble", runs.cost, _per(found))
    report.value("cost_ensemble_sd", runs.cost_sd, _per(found))
    report.value("cost_ensemble_expected", runs.cost_expected, _per(found))
    report.says(
        _("{runs} runs of {steps} steps cost {cost} ± {sd} on average, from the initial state on; theory says {expected}."),
        _(" The largest deviation of the ensemble from theory, over all tests, is {worst} standard errors."),
        runs=stats.runs, steps=found.steps, cost=runs.cost, sd=runs.cost_sd, expected=runs.cost_expected, worst=worst,
    )  # fmt: skip
    shown = [*range(min(found.truth.n, loops.SHOWN)), *range(len(runs.names) - found.truth.r, len(runs.names))][: common.SHOWN]
    report.figure("ensemble", loops.many(found, shown), _("RMS of states and inputs over {runs} runs, and in theory."), runs=stats.runs)
