"""The report of a regulator: ``ctlabs regulate``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ctlabs.filtering import steady
from ctlabs.models import ContinuousModel
from ctlabs.reporting.report import SOLVER, Report
from ctlabs.studies import common, loop_costs, loop_motions, loops, second
from ctlabs.studies.analysis import limit_check
from ctlabs.studies.regulating import Regulated, compute
from ctlabs.studies.understanding import Part
from ctlabs.text import _, fill

if TYPE_CHECKING:
    from ctlabs.files.modelfile import ModelFile

#: A factor of gain below this is none.
ROUNDED = 1e-12


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
    loop_costs.write(made, found)
    made.section("d", _("What the loop does"))
    loop_motions.write(made, found)
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
        summed = rf"E\int_0^{{\,{cost.horizon:g}}} ({inside})\,dt" if continuous else rf"E\sum_{{k<{cost.horizon:g}}} ({inside})"
        formula = summed + last
    else:
        formula = rf"\lim\frac1T\,E\!\int_0^T ({inside})\,dt" if continuous else rf"\lim\frac1N\,E\sum_{{k<N}} ({inside})"
    report.math("J = " + formula)
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
        report.math(rf"\xi_{{k+1}} = A\xi_k + Bz_k{follows[0]} \qquad u_k = C\xi_k + Dz_k{follows[1]}")
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


# e -------------------------------------------------------------------------------------------------------------------


def _margins(report: Report, found: Regulated) -> None:
    """Gain, phase, delay and disk margins of the loop opened at each input."""
    margins: Part[Any] = found.margins
    if not margins:
        report.says(_("There are no margins: {reason}."), reason=margins.reason)
        return
    names = dict(zip(found.plain_inputs, found.inputs, strict=True))
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
