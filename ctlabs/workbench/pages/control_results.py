"""What the page Control says of a regulator: gains, poles, σ, responses, cost, curves of trade-offs."""

from __future__ import annotations

import dataclasses
import math
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from nicegui import ui

from ctlabs.reporting.drawing import Band, Curve, Drawing, Mark, Panel, labelled
from ctlabs.studies import loops as pictures
from ctlabs.studies.understanding import Part
from ctlabs.text import prose
from ctlabs.workbench.pages.control_set_points import SetPoints
from ctlabs.workbench.pages.tables import matrix, table
from ctlabs.workbench.runs import figures

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ctlabs.regulation.stability import Margin
    from ctlabs.studies.regulating import Regulated
    from ctlabs.workbench.desk.loops import LoopDesk
    from ctlabs.workbench.pages.showing import Show
    from ctlabs.workbench.runs.loops import LoopCurves

#: States that a figure shows at most.
SHOWN = 4
#: Less than this is little: of phase in degrees, of gain a factor.
PHASE, GAIN = 30.0, 2.0


class LoopResults:
    """The cards of results, empty until :meth:`show`."""

    def __init__(self, show: Show, desk: LoopDesk) -> None:
        self.found: Regulated | None = None
        self.curves: LoopCurves | None = None
        with ui.element("div").classes("ctl-show-grid") as self.box:
            with show.card("Gains", "control.gains", wide=True, test="control-gains") as card:
                with card.head:
                    ui.space()
                    show.copy(self._gains_text, "Copy the numbers of the gains", test="copy-gains", words="Numbers")
                self.gains = _html()
                self.schedule = show.plot(test="plot-schedule", title=False)
            with show.card("Poles", "control.poles", test="control-poles"):
                self.poles = show.plot(test="plot-control-poles", title=False)
                self.pole_told = _html()
            with show.card("Standard deviations in the loop", "control.sigma", test="control-sigma"):
                self.sigma = _html()
            with show.card("Responses", "control.responses", wide=True, test="control-responses"):
                self.set_points = SetPoints(show, desk)
                self.course = show.plot(test="plot-control-course")
                self.kicks = show.plot(test="plot-control-kicks")
            with show.card("What it costs", "control.cost", wide=True, test="control-cost"):
                self.cost = _html()
                self.shares = show.plot(test="plot-control-budget")
            with show.card("What other weights and periods would give", "control.curves", wide=True, test="control-curves") as card:
                self.curves_card = card.section
                self.curves_told = ui.label("").classes("ctl-show-hint").props("role=status data-test=curves-told")
                self.state = ui.select([], label="State", on_change=lambda _: self._draw_tradeoff())
                self.state.props("outlined dense options-dense data-test=control-state").classes("w-48")
                with ui.element("div").classes("ctl-show-grid"):
                    self.tradeoff, self.periods = show.plot(test="plot-tradeoff"), show.plot(test="plot-periods")
        self.box.set_visibility(False)

    def show(self, found: Regulated) -> None:
        """Show a regulator."""
        self.found = found
        self.box.set_visibility(True)
        self.gains.content = _gains(found)
        drawn = found.regulator.steps is not None
        (self.schedule.show(pictures.schedule(found)) if drawn else self.schedule.hide())
        if drawn:
            self.poles.hide()
            self.pole_told.content = "<p>Gains that are scheduled over a horizon have no poles.</p>"
        else:
            self.poles.show(pictures.poles(found))
            self.pole_told.content = ""
        self.sigma.content = _sigma(found)
        self._responses(found)
        self.cost.content = _cost(found)
        if found.budget:
            shares = {str(name): float(value) for name, value in found.budget.value.table()[:-1]}
            self.shares.show(pictures.shares(shares, _each(found)))
        else:
            self.shares.hide()

    def _responses(self, found: Regulated) -> None:
        self.set_points.show(found)
        (self.course.show(course(found)) if found.over else self.course.hide())
        kicked = bool(found.kicks and found.kicks.value)
        (self.kicks.show(pictures.kicked(found, range(min(found.truth.n, SHOWN)))) if kicked else self.kicks.hide())

    # Curves ------------------------------------------------------------------------------------------------------------

    def draw_curves(self, curves: LoopCurves | None, told: str = "") -> None:
        """Show the curves of trade-offs, or say why they are not there (yet)."""
        self.curves = curves
        self.curves_told.text = told
        self.curves_told.set_visibility(bool(told))
        self.curves_card.classes(add="" if curves else "ctl-stale", remove="ctl-stale" if curves else "")
        found = self.found
        if curves is None or found is None:
            return
        names = list(found.truth.states)
        if self.state.options != names:
            self.state.set_options(names, value=names[foremost(found)])
        self._draw_tradeoff()
        if len(curves.periods.values):
            self.periods.show(pictures.periods(dataclasses.replace(found, periods=Part(curves.periods.periods))))
        else:
            self.periods.hide()
        families = (("Weights", curves.weights), ("Periods", curves.periods))
        self.curves_told.text = " ".join(f"{what}: {family.reason}." for what, family in families if family.reason)
        self.curves_told.set_visibility(bool(self.curves_told.text))

    def _draw_tradeoff(self) -> None:
        found, curves = self.found, self.curves
        if found is None or curves is None or self.state.value not in found.truth.states:
            return
        if not len(curves.weights.values):
            self.tradeoff.hide()
            return
        i = found.truth.states.index(self.state.value)
        self.tradeoff.show(pictures.tradeoff(dataclasses.replace(found, tradeoff=Part(curves.weights.tradeoff)), i))

    def _gains_text(self) -> str:
        found = self.found
        if found is None:
            return ""
        regulator = found.regulator
        L, K = (M if M.ndim == 2 else M[0] for M in (regulator.L, regulator.K))
        rows: list[Sequence[object]] = [["L", *regulator.design.states]]
        rows += [[u, *map(float, row)] for u, row in zip(found.inputs, L, strict=True)]
        rows += [[], ["K", *regulator.plant.measurements]]
        rows += [[x, *map(float, row)] for x, row in zip(regulator.plant.states, K, strict=True)]
        return figures.table(rows)


def foremost(found: Regulated) -> int:
    """The state whose share of the cost is largest; the first where that is not known."""
    shares = {} if not found.budget else found.budget.value.weights
    return int(np.argmax([shares.get(name, 0.0) for name in found.truth.states]))


# Verdict -------------------------------------------------------------------------------------------------------------


def verdict(found: Regulated) -> str:
    """The verdict in HTML: stable, how much it bears, what it costs."""
    lines = [_stable(found)]
    if found.margins:
        names = dict(zip(found.margins.value.inputs, found.inputs, strict=True))
        lines += [bears(margin, names[name] if len(names) > 1 else "") for name, margin in found.margins.value.inputs.items()]
        if len(names) > 1:
            lines.append(f"<p>All inputs at once: disk margin at least {prose(found.margins.value.together, 3)}.</p>")
    elif found.regulator.steps is None:
        lines.append(f'<p class="ctl-show-why">No margins: {escape(found.margins.reason)}.</p>')
    cost = found.regulator.cost
    known, unknown = cost.regulation + cost.offset + cost.between, cost.estimation
    per = {"s": "per second", "step": "per step", "horizon": "in all"}[cost.per]
    lines.append(
        f"<p>It costs <b>{prose(cost.value, 5)}</b> {per}: {prose(known, 4)} a regulator that knows the state, "
        f"{prose(unknown, 4)} more since the state has to be estimated.</p>"
    )
    lines += [f"<p>{escape(note)}.</p>" for note in found.noted]
    return "".join(lines)


def _stable(found: Regulated) -> str:
    if found.regulator.steps is not None:
        return f"<p>The gains are scheduled over {found.regulator.steps} steps.</p>"
    if found.growing:
        return f'<p class="ctl-show-bad">Not stable: {escape(found.growing)}.</p>'
    poles = np.abs(found.loop.poles)
    loads = len(found.regulator.loads)
    slowest = float(np.sort(poles)[: len(poles) - loads].max(initial=0.0))
    lasts = -found.truth.dt / math.log(slowest) if slowest > 0 else 0.0
    open_ = np.abs(np.linalg.eigvals(found.truth.Phi))
    alone = "" if (open_ < 1).all() else " (the plant alone is not)"
    return f'<p class="ctl-show-good">The loop is stable{alone}: its slowest mode decays with a time constant of {prose(lasts, 3)} s.</p>'


def bears(margin: Margin, name: str = "") -> str:
    """What one loop bears, in HTML; what is little is said so."""
    low, high = margin.gain
    phase = math.degrees(margin.phase)
    gain = f"from {prose(low, 3)} to {prose(high, 3)} times" if math.isfinite(high) else f"from {prose(low, 3)} times up, without limit"
    parts = [f"a gain {gain} as large"]
    if math.isfinite(margin.phase):
        parts.append(f"{prose(phase, 3)}° of phase")
    if math.isfinite(margin.delay):
        parts.append(f"{prose(margin.delay, 3)} s of delay")
    together = f"gain and phase together by a disk of {prose(margin.disk, 3)} ({prose(math.degrees(margin.disk_phase), 3)}°)"
    little = phase < PHASE or high < GAIN
    where = f" at {escape(name)}" if name else ""
    text = f"It bears{where} {', '.join(parts)}; {together}."
    if little:
        text += f" That is little: {prose(PHASE)}° and a factor {prose(GAIN)} are usual."
    return f'<p class="{"ctl-show-bad" if little else "ctl-show-good"}" data-test="margins">{text}</p>'


# In HTML -------------------------------------------------------------------------------------------------------------


def _html() -> ui.html:
    return ui.html("", sanitize=False).classes("w-full")


def _gains(found: Regulated) -> str:
    regulator = found.regulator
    L, K = (M if M.ndim == 2 else M[0] for M in (regulator.L, regulator.K))
    told = "" if regulator.steps is None else ", at the beginning"
    answers = "that of its own instant" if regulator.kind == "current" else "that of the instant before"
    parts = [
        matrix(f"L: u = −L x̂{told}", L, found.inputs, regulator.design.states),
        matrix(f"K: what a measurement moves{told}", K, regulator.plant.states, regulator.plant.measurements),
    ]
    if regulator.estimator.K_w.any() and regulator.L_w.ndim == 2:
        names = regulator.plant.states[: regulator.L_w.shape[1]]
        parts.append(matrix("L_w: on the estimated disturbance", regulator.L_w, found.inputs, names))
    period = f"every {prose(regulator.plant.dt, 4)} s"
    return f'<p>Measured {period}; an input answers {answers}.</p><div class="ctl-show-side">{"".join(parts)}</div>'


def _sigma(found: Regulated) -> str:
    if not found.limit:
        return f'<p class="ctl-show-why">There is no limit: {escape(found.limit.reason)}.</p>'
    rows = [[name, sd, rms, unit or ("" if name in found.inputs else "1")] for name, sd, rms, unit in signals(found)]
    return table(["Signal", "σ", "RMS", "Unit"], rows, "In the limit: states, measurements, inputs")


def signals(found: Regulated) -> list[tuple[str, float, float, str]]:
    """Name, σ, RMS and unit of states, measurements and inputs in the limit."""
    limit = found.limit.value
    names = (*found.truth.states, *(f"{name} (measured)" for name in found.truth.measurements), *found.inputs)
    units = (*found.truth.units, *found.file.measurement_units, *[""] * len(found.inputs))
    sd, rms = (np.concatenate([getattr(part, what) for part in (limit.x, limit.z, limit.u)]) for what in ("sd", "rms"))
    return [(name, float(s), float(r), unit) for name, s, r, unit in zip(names, sd, rms, units, strict=True)]


def _each(found: Regulated) -> str:
    return {"s": "cost per second", "step": "cost per step", "horizon": "cost of the horizon"}[found.per]


def _cost(found: Regulated) -> str:
    cost = found.regulator.cost
    routes = [[name, value] for name, value in cost.routes.items()]
    rows: list[list[Any]] = [["what disturbances cost, the state known", cost.regulation]]
    rows += [["what not knowing the state adds", cost.estimation]]
    rows += [["a known constant disturbance", cost.offset]] if cost.offset else []
    rows += [["noise between the samples", cost.between]] if cost.between else []
    total = cost.value or math.nan
    heads = [_each(found).capitalize(), "Share"]
    parts = [table(["Route", _each(found).capitalize()], routes, "On three routes that share no formula")]
    parts.append(table(["Known or not", *heads], [[name, value, value / total] for name, value in rows], "By what is known"))
    if found.budget:
        told = found.budget.value.table()
        parts.append(table(["Source", *heads], [[name, value, float(value) / total] for name, value in told], "By source of noise"))
        parts.append(table(["Weighed", *heads], found.weighed(), "By what is weighed"))
    else:
        parts.append(f'<p class="ctl-show-why">No budget: {escape(found.budget.reason)}.</p>')
    spread = f'<p class="ctl-show-hint">The routes differ by {prose(cost.spread, 2)} of the cost.</p>'
    return f'<div class="ctl-show-side">{"".join(parts)}</div>{spread}'


def course(found: Regulated) -> Drawing:
    """States and inputs from the beginning on: their mean, and a band of 2σ."""
    over = found.over.value
    states = list(zip(found.truth.states, found.truth.units, strict=True))[:SHOWN]
    panels = [_course(over.t, over.x.mean[:, i], over.x.sd[:, i], *each, "blue") for i, each in enumerate(states)]
    panels += [_course(over.t, over.u.mean[:, j], over.u.sd[:, j], name, "", "green") for j, name in enumerate(found.inputs[:SHOWN])]
    return Drawing("From the beginning: mean and 2σ", "t, s", tuple(panels), verbatim=True)


def _course(t: Any, mean: Any, sd: Any, name: str, unit: str, colour: str) -> Panel:
    band = Band(f"{name} ± 2σ", t, mean - 2 * sd, mean + 2 * sd, colour, unit)
    curve = Curve(f"mean of {name}", t, mean, colour, "line", unit)
    return Panel(labelled(name, unit), (curve,), (band,), levels=(Mark("", 0.0, "grey", "line", 0.8),))
