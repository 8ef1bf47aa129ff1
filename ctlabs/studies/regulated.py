"""The report of a regulator: ``ctlabs regulate``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ctlabs import montecarlo
from ctlabs.filtering import steady
from ctlabs.labs.portrait import tested
from ctlabs.linalg.checks import Array
from ctlabs.models import ContinuousModel
from ctlabs.montecarlo import chance
from ctlabs.regulation.runs import LoopEnsemble
from ctlabs.reporting.report import EXACT, SOLVER, Report
from ctlabs.studies import common, loops, second
from ctlabs.studies.analysis import limit_check
from ctlabs.studies.regulating import Regulated, compute, replayed
from ctlabs.studies.understanding import Part
from ctlabs.text import _, fill, number

if TYPE_CHECKING:
    from ctlabs.files.modelfile import ModelFile

#: A factor of gain below this is none.
ROUNDED = 1e-12
#: Instants at which the machine is replayed.
REPLAYED = 50


def study(model: ModelFile, **more: Any) -> Report:
    """:func:`ctlabs.studies.regulating.compute` as a report."""
    return report(compute(model, **more))


def report(found: Regulated) -> Report:
    """The statement, the regulator, its cost by several routes, what its loop does and bears; the right one beside a wrong design."""
    regulator = found.regulator
    given = common.settings(
        found.file,
        ("dt", regulator.plant.dt, "s", _("period")),
        ("steps", found.steps, "1", _("steps for which the loop is followed")),
        ("kind", regulator.kind, "", _("which measurement an input answers")),
    )
    runs = found.ensemble.found
    size = 0 if runs is None else runs.statistics.runs
    made = common.begin("regulate", _("regulator"), found.file, "abcde", given, runs=size, seed=found.seed)
    made.section("a", _("The plant and what is to be kept small"))
    _statement(made, found)
    made.section("b", _("The regulator"))
    _gains(made, found)
    made.section("c", _("What it costs"))
    _costs(made, found)
    made.section("d", _("What the loop does"))
    _motions(made, found)
    made.section("e", _("How much it bears"))
    _margins(made, found)
    return made


# a -------------------------------------------------------------------------------------------------------------------


def _statement(report: Report, found: Regulated) -> None:
    best, design = found.best, found.design
    common.show(report, best.model)
    _weights(report, found)
    if found.other is not None:
        report.says(_("The regulator is designed for another model, and put to work on this one:"))
        common.show(report, design.model)
    if isinstance(best.model, ContinuousModel):
        report.says(
            _("The measurements come every {dt} s, and the input is held in between; model and cost are seen at the samples exactly."),
            dt=found.truth.dt,
        )
        if delay := best.told.delay:
            report.says(_("An answer begins to act {delay} s after its measurement: inputs on their way are states, too."), delay=delay)
    for note in found.noted:
        report.says("{note}.", note=note)


def _weights(report: Report, found: Regulated) -> None:
    """The cost as an equation, with the weights of the outputs in it."""
    cost, model = found.best.cost, found.best.model
    w = cost.weights(model)
    continuous = isinstance(model, ContinuousModel)
    inside = r"x^TQ_xx + 2x^TNu + u^TQ_uu" if w.N.any() else r"x^TQ_xx + u^TQ_uu"
    if cost.horizon is not None:
        last = r" + x^TQ_fx\big|_{\mathrm{end}}" if w.Qf.any() else ""
        end = found.best.regulator.steps
        summed = rf"E\int_0^{{{cost.horizon:g}}} ({inside})\,dt" if continuous else rf"E\sum_{{k=0}}^{{{end}-1}} ({inside})"
        formula = summed + last
    else:
        formula = rf"\lim\frac1T\,E\!\int_0^T ({inside})\,dt" if continuous else rf"\lim\frac1N\,E\sum_{{k<N}} ({inside})"
    report.math("J = " + formula.replace("{", "{{").replace("}", "}}"))
    if model.n <= common.LARGE:
        parts, values = [r"Q_x = {a}", r"Q_u = {b}"], {"a": w.Qx, "b": w.Qu}
        if w.N.any():
            parts, values = [*parts, "N = {c}"], values | {"c": w.N}
        if w.Qf.any():
            parts, values = [*parts, "Q_f = {d}"], values | {"d": w.Qf}
        report.math(r" \qquad ".join(parts), "", **values)
    told = found.design.told
    if told.integral:
        report.says(
            _("The errors of {names} are integrated, and the integrals weighed: a constant disturbance leaves no offset."),
            names=", ".join(told.integral),
        )
    if told.loads:
        report.says(_("{names} is a load: it is estimated, and the tracked outputs are kept free of it."), names=", ".join(told.loads))


# b -------------------------------------------------------------------------------------------------------------------


def _gains(report: Report, found: Regulated) -> None:
    regulator = found.regulator
    if regulator.steps is not None:
        _scheduled(report, found)
        return
    feedback, estimator, design = regulator.feedback, regulator.estimator, regulator.design
    report.math(r"u = -L\hat x \qquad L = {a} \qquad K = {b}", "", a=regulator.L, b=regulator.K)
    report.says(
        _("L is the gain on the estimate; K is the gain by which a measurement moves it."),
        _(" The input answers the measurement of its own instant.") if regulator.kind == "current" else _(" The input answers the measurement before."),
    )
    columns: dict[str, list[float | None]] = {
        fill(_("gain L of {name}"), name=name): [float(v) for v in row] for name, row in zip(found.inputs, regulator.L, strict=True)
    }
    for j, name in enumerate(design.measurements):
        K = [float(v) for v in regulator.K[:, j]]
        columns[fill(_("gain K on {name}"), name=name)] = [*K, *[None] * (design.n - len(K))]
    common.states_table(report, "gains", design, columns, _("The gain L from each estimate to the inputs, and K from each measurement to the estimates."))
    report.value("L", regulator.L)
    report.value("K", regulator.K)
    if estimator.K_w.any():
        report.value("L_w", regulator.L_w)
        report.says(_("Noises of plant and measurement correlate, so that a measurement tells of the disturbance; the input answers that, too."))
    _machine(report, found)
    report.value("poles_plant", np.sort_complex(np.linalg.eigvals(found.truth.Phi)))
    report.value("poles_feedback", feedback.poles)
    report.value("poles_estimator", estimator.poles)
    caption = _("Modes of the plant and of the loop, as rates ln(z)/dt: those at the left decay, the farther the sooner.")
    report.figure("poles", loops.poles(found), caption)
    if not regulator.loads:
        size = feedback.S.diagonal()
        scale = np.sqrt(np.where(size > 0, size, size.max(initial=0.0) or 1.0))
        report.check(
            _("feedback"), feedback.S, second.cost_of_gain(design, regulator.weights, regulator.L),
            (_("Riccati solver"), _("cost of its gain, 50 digits")), SOLVER, scale=np.outer(scale, scale),
        )  # fmt: skip
    try:
        limit_check(report, regulator.plant, steady.solve(regulator.plant))
    except ValueError:  # perfect measurements, whose reduced estimator is checked by the routes to the cost
        return


def _machine(report: Report, found: Regulated) -> None:
    """The controller as a few matrices, as it is exported."""
    M = found.regulator.machine
    if len(M.A) <= common.LARGE:
        follows = (r" + Gr_k", r" + Fr_k") if M.set_points else ("", "")
        report.says(_("As a machine with the memory ξ (the estimate before the measurement, and what the controller carries beside it):"))
        report.math(rf"\xi_{{{{k+1}}}} = A\xi_k + Bz_k{follows[0]} \qquad u_k = C\xi_k + Dz_k{follows[1]}")
    for letter in "ABCDFG" if M.set_points else "ABCD":
        report.value(f"controller_{letter}", getattr(M, letter))


def _scheduled(report: Report, found: Regulated) -> None:
    """Gains that depend on the time that is left."""
    regulator = found.regulator
    report.says(_("The gains are scheduled over {steps} steps, {time} s; at the end nothing is left to be gained."), steps=found.steps, time=found.steps * found.truth.dt)
    report.math(r"L_0 = {a} \qquad K_{b} = {c}".replace("{b}", "{{1}}"), "", a=regulator.L[0], c=regulator.K[min(1, len(regulator.K) - 1)])
    report.value("L_start", regulator.L[0])
    report.value("L_end", regulator.L[-1])
    report.figure("schedule", loops.schedule(found), _("Gains L from the estimates to the inputs as the end comes near."))


# c -------------------------------------------------------------------------------------------------------------------


def _costs(report: Report, found: Regulated) -> None:
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
    named = dict(zip(_u(len(found.inputs)), found.inputs, strict=True))
    weighed = [[named.get(name, name), value, value / total] for name, value in budget.weights.items()]
    rest = budget.total - budget.between - sum(budget.weights.values())
    if abs(rest) > SOLVER * total:
        weighed.append([_("cross terms"), rest, rest / total])
    if budget.between:
        weighed.append([_("between the samples"), budget.between, budget.between / total])
    report.table("weights", [_("weighed"), *heads[1:]], weighed, _("The same cost by what is weighed, at the samples."))
    whole = sum(budget.sources.values()) + budget.between
    report.check(_("cost budget adds up"), whole, budget.total, (_("sum over the sources"), _("separation")), SOLVER, scale=total)
    bars = {str(name): float(value) for name, value in budget.table()[:-1]}
    report.figure("budget", loops.shares(bars, _each(found)), _("The cost by source of noise."))


def _u(count: int) -> tuple[str, ...]:
    return ("u",) if count == 1 else tuple(f"u{i + 1}" for i in range(count))


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


# d -------------------------------------------------------------------------------------------------------------------


def _motions(report: Report, found: Regulated) -> None:
    """σ over time and in the limit; responses to steps, the start and kicks."""
    if found.regulator.steps is not None:
        report.says(_("Over a finite horizon there is no stability to speak of."))
    elif found.stable:
        report.says(_("The loop is stable: its slowest mode decays by a factor {slow} per step."), slow=_slowest(found))
    else:
        report.says(_("**The loop is not stable**: {reason}."), reason=found.growing)
    if found.regulator.steps is None:
        report.value("stable", found.stable)
    if found.over:
        _sizes(report, found)
        some = min(found.truth.n, loops.SHOWN)
        caption = _("Standard deviations of states and inputs from the start on. Dashed: their limits.")
        report.figure("deviations", loops.deviations(found, range(some), range(min(found.truth.r, 2))), caption)
    else:
        report.says("{reason}.", reason=found.over.reason)
    _replay(report, found)
    for i, response in enumerate(found.set_points.found or () if found.stable else ()):
        final = float(response.z[-1, found.truth.measurements.index(response.name)])
        settled = response.settled(response.z[:, found.truth.measurements.index(response.name)], 1.0)
        report.figure(f"step_{i + 1}", loops.step(found, response), _("{cause}: no noise, from rest."), cause=_capital(response.cause))
        report.value(f"step_end_{i + 1}", final)
        report.value(f"step_settled_{i + 1}", settled, "s", reason=_("it does not stay within 2 % of the step within the steps that are followed"))
    if found.initial:
        response = found.initial.value
        report.figure("start", loops.motion(found, response), _("The mean motion after {cause}."), cause=response.cause)
    if found.kicks.found and found.stable:
        shown = range(min(found.truth.n, 3))
        caption = _("One kick of each noise at t = 0, as large as one σ of it in a period, and what becomes of it.")
        report.figure("kicks", loops.kicked(found, shown), caption)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _slowest(found: Regulated) -> float:
    """The modulus of the slowest mode, loads aside."""
    return float(np.sort(np.abs(found.loop.poles))[len(found.loop.poles) - len(found.regulator.loads) - 1])


def _sizes(report: Report, found: Regulated) -> None:
    """A table of σ at the end and in the limit, with what the design believes where it is wrong."""
    over, limit = found.over.value, found.limit
    n, r = found.truth.n, found.truth.r
    names, units = (*found.truth.states, *found.inputs), (*found.truth.units, *[""] * r)
    columns: dict[str, Array] = {_("mean at the end"): np.concatenate([over.x.mean[-1], over.u.mean[-1]]), _("σ at the end"): np.concatenate([over.x.sd[-1], over.u.sd[-1]])}
    if limit.found is not None:
        columns[_("σ in the limit")] = np.concatenate([limit.found.x.sd, limit.found.u.sd])
        _limits(report, found)
    if found.other is not None and found.best.regulator.steps is None and not found.best.regulator.loads:
        right = found.best.regulator.closed.steady()
        if len(right.x.sd) == n:
            columns[_("σ of the right design")] = np.concatenate([right.x.sd, right.u.sd])
    rows = [[name, unit, *(float(column[i]) for column in columns.values())] for i, (name, unit) in enumerate(zip(names, units, strict=True))]
    report.table("sizes", [_("signal"), _("unit"), *columns], rows, _("States and inputs of the loop."))
    report.value("sd_x_end", over.x.sd[-1], common.units(found.truth))
    report.value("sd_u_end", over.u.sd[-1])


def _limits(report: Report, found: Regulated) -> None:
    """The limits, and a second route to them."""
    limit, model = found.limit.value, found.loop.model
    report.value("sd_x", limit.x.sd, common.units(found.truth))
    report.value("sd_u", limit.u.sd)
    P = second.stationary(model.Phi, model.Qd)
    n = found.truth.n
    sd = np.where(limit.x.sd > 0, limit.x.sd, 1.0)
    routes = (_("Lyapunov solver"), _("sum of all that is left of the noises, 50 digits"))
    report.check(_("covariance of the loop"), limit.x.P, P[:n, :n], routes, SOLVER, scale=np.outer(sd, sd))


def _replay(report: Report, found: Regulated) -> None:
    """The controller as it is exported, fed the measurements of one run of the loop, gives that run's inputs."""
    if not found.over:
        return
    steps = min(found.steps, REPLAYED)
    signals = montecarlo.simulate(found.loop.model, steps, 1, found.seed, 0).z[:, :, 0]
    m, count = found.truth.m, steps if found.regulator.steps is not None else steps + 1
    z, u = signals[:count, :m], signals[:count, m:]
    again = replayed(found, z)
    size = np.abs(u).max(axis=0, initial=0.0)
    report.check(
        _("the controller, step by step"), again, u, (_("controller fed one run's measurements"), _("the loop as one model")),
        EXACT, scale=np.broadcast_to(np.where(size > 0, size, 1.0), u.shape),
    )  # fmt: skip


# e -------------------------------------------------------------------------------------------------------------------


def _margins(report: Report, found: Regulated) -> None:
    """Gain, phase, delay and disk margins of the loop opened at each input."""
    margins: Part[Any] = found.margins
    if not margins:
        report.says(_("There are no margins: {reason}."), reason=margins.reason)
        return
    names = dict(zip(_u(len(found.inputs)), found.inputs, strict=True))
    rows = []
    for key, one in margins.value.inputs.items():
        low, high = one.gain
        low = 0.0 if low < ROUNDED else low
        rows.append([names[key], low, high, np.degrees(one.phase), one.delay, one.disk, one.modulus, one.crossover])
        suffix = "" if len(names) == 1 else f"_{names[key]}"
        for what, value, unit in (
            ("gain_margin_low", low, "1"), ("gain_margin_high", high, "1"), ("phase_margin", np.degrees(one.phase), "°"),
            ("delay_margin", one.delay, "s"), ("disk_margin", one.disk, "1"),
        ):  # fmt: skip
            finite = np.isfinite(value)
            report.value(f"{what}{suffix}", float(value) if finite else None, unit, reason="" if finite else _("without bound"))
    heads = [
        _("loop opened at"), _("gain from"), _("gain to"), _("phase, °"), _("delay, s"), _("disk α"), _("distance from −1"), _("crossover, rad/s"),
    ]  # fmt: skip
    cells = [[cell if isinstance(cell, str) or np.isfinite(cell) else None for cell in row] for row in rows]
    report.table("margins", heads, cells, _("The factors of gain, the lag of phase and the delay that the loop bears at each input, the others closed. Empty: without bound."))
    report.says(
        _("An optimal feedback of a known state bears any gain from ½ on and 60° of phase; with an estimator nothing is sure, and these are what there is."),
    )
    try:
        drawing = loops.opened(found)
    except ValueError:
        return
    report.figure("opened", drawing, _("The loop opened at its input: what comes back for a sine that goes in."))
