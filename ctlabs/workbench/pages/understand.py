"""Understand: what the model tells before any data, part by part, as its constants are moved."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Sequence
from functools import lru_cache
from html import escape
from typing import TYPE_CHECKING, Any

from nicegui import background_tasks, ui

from ctlabs.files.modelfile import loads
from ctlabs.reporting.mathml import mathml
from ctlabs.studies.understanding import Part, Poles, Understanding, compute
from ctlabs.text import number
from ctlabs.workbench.pages.editing import Editor
from ctlabs.workbench.pages.model_constants import Constants
from ctlabs.workbench.pages.showing import Show
from ctlabs.workbench.pages.tables import matrix, table
from ctlabs.workbench.runs import figures

if TYPE_CHECKING:
    from ctlabs.workbench.desk.session import Session
    from ctlabs.workbench.pages.shell import Shell

PAGE = {"place": 2, "title": "Understand", "icon": "insights"}

#: States and pairs that are drawn at first.
SHOWN = 4



def page(session: Session, shell: Shell) -> None:
    """Draw the page."""
    _Understand(session, shell).draw()


class _Understand:
    """The page in one tab."""

    def __init__(self, session: Session, shell: Shell) -> None:
        self.session, self.shell = session, shell
        self.show = Show(shell)
        self.states: list[int] | None = None
        self.pairs: list[str] | None = None
        self.found: Understanding | None = None
        self.wanted: str | None = None
        self.computing = self.left = False
        self.editor = Editor(session, shell, self._changed)

    # Drawing ---------------------------------------------------------------------------------------------------------

    def draw(self) -> None:
        self.shell.name_draft(self.session.title)
        with ui.element("div").classes("ctl-und"):
            with ui.element("div").classes("ctl-und-constants"):
                self.constants = Constants(self.editor)
            with ui.element("div").classes("ctl-column"):
                self._draw_results()
        self.constants.show(self.session.sheet.constants)
        self.shell.shortcut("mod+z", "Undo", self.editor.undo, in_fields=False)
        self.shell.shortcut("mod+shift+z", "Redo", self.editor.redo, in_fields=False)
        self.shell.on_leave(self._leave)
        self.shell.on_change(lambda: self._changed(""))
        self._want()

    def _draw_results(self) -> None:
        with self.show.card("In short", wide=True, test="summary") as card:
            self.box = card.section
            with card.head:
                ui.space()
                self.report = ui.button("Report", icon="download", on_click=self._download)
                self.report.props('flat dense no-caps data-test=understand-report title="All of this as one page to keep"')
            self.summary = ui.html("<p>Computing…</p>", sanitize=False).props("role=status aria-live=polite")
            with ui.row().classes("items-center gap-2") as self.wrong:
                self.why = ui.label("").classes("ctl-show-error").props("role=alert data-test=understand-wrong")
                self.to_model = ui.button("Go to the model", icon="grid_on", on_click=lambda: self.shell.go("model"))
                self.to_model.props("outline no-caps dense data-test=go-model")
        with ui.element("div").classes("ctl-show-grid") as self.results:
            self._draw_observability()
            self._draw_detectability()
            self._draw_poles()
            self._draw_steady()
            self._draw_transient()
            self._draw_filter()
        self.results.set_visibility(False)
        self.wrong.set_visibility(False)

    def _draw_observability(self) -> None:
        with self.show.card("Observability", "understand.observability", test="observability"):
            self.observability = _Body()

    def _draw_detectability(self) -> None:
        with self.show.card("Detectability", "understand.detectability", test="detectability"):
            self.detectability = _Body()

    def _draw_poles(self) -> None:
        with self.show.card("Poles", "understand.poles", wide=True, test="poles"):
            self.pole_tables = _Body()
            with ui.element("div").classes("ctl-show-grid"):
                self.plane_z, self.plane_s = self.show.plot(test="plot-poles-z"), self.show.plot(test="plot-poles-s")

    def _draw_steady(self) -> None:
        with self.show.card("Steady state", "understand.steady", wide=True, test="steady") as card:
            with card.head:
                ui.space()
                self.copy_steady = self.show.copy(
                    self._steady_text, "Copy the numbers of the matrices", test="copy-steady", words="Numbers"
                )
            self.steady = _Body()

    def _draw_transient(self) -> None:
        with self.show.card("Standard deviation over time", "understand.variance", wide=True, test="transient"):
            self.transient = _Body()
            self.choose_states = ui.select({}, multiple=True, label="States shown", on_change=self._states_chosen)
            self.choose_states.props("outlined dense use-chips data-test=understand-states").classes("w-full")
            self.deviations = self.show.plot(test="plot-transient", title=False)

    def _draw_filter(self) -> None:
        with self.show.card("Transfer function of the filter", "understand.transfer", wide=True, test="transfer"):
            self.transfer = _Body()
        with self.show.card("Bode plot of the filter", "understand.bode", wide=True, test="bode"):
            self.bode_body = _Body()
            self.choose_pairs = ui.select(
                [], multiple=True, label="Estimate ← measurement", on_change=self._pairs_chosen
            )
            self.choose_pairs.props("outlined dense use-chips data-test=understand-pairs").classes("w-full")
            self.bode = self.show.plot(test="plot-bode", title=False)

    # Filling ---------------------------------------------------------------------------------------------------------

    def _changed(self, _key: str) -> None:
        self.constants.show(self.session.sheet.constants)
        self._want()

    def _want(self) -> None:
        """Understand the present model, in a thread; of several that are wanted meanwhile only the last one."""
        self.wanted = self.session.text
        if not self.computing:
            self.computing = True
            background_tasks.create(self._compute(), name="understand")

    async def _compute(self) -> None:
        try:
            while self.wanted is not None and not self.left:
                text, self.wanted = self.wanted, None
                found = await asyncio.to_thread(_understood, text)
                if self.wanted is None and not self.left:
                    with self.box:
                        self._show(found)
        finally:
            self.computing = False

    def _leave(self) -> None:
        self.left = True

    def _show(self, found: Understanding) -> None:
        """Results, or what is wrong with the model beside the last results that there were."""
        problems = self.session.sheet.problems
        stale = bool(problems) and self.found is not None
        self.wrong.set_visibility(bool(problems))
        if problems:
            where, message = next(iter(problems.items()))
            name, _, rest = where.partition(".")
            # Of a constant it is said at its field, beside this.
            constant = f"The constant {rest.removesuffix('.value')} is to be put right"
            told = constant if name == "constants" else f"{rest or where}: {message}"
            more = f" ({len(problems) - 1} more)" if len(problems) > 1 else ""
            below = " What stands below is of the model before." if stale else ""
            self.why.text = f"{told}{more}.{below}"
        self.report.set_visibility(not problems)
        self.results.classes(add="ctl-stale" if stale else "", remove="" if stale else "ctl-stale")
        self.summary.classes(add="ctl-stale" if stale else "", remove="" if stale else "ctl-stale")
        if not problems and found is not self.found:
            self.found = found
            self.results.set_visibility(True)
            self._fill(found)
        elif problems and self.found is None:
            self.summary.content = "<p>Nothing can be said of it yet.</p>"

    async def _download(self) -> None:
        """The report that ``ctlabs analyse`` writes, as one page."""
        text, name = self.session.text, self.session.filename.removesuffix(".toml")
        self.report.props("loading")
        try:
            page = await asyncio.to_thread(_report, text)
        except (ValueError, ArithmeticError) as why:
            self.shell.complain(f"There is no report: {' '.join(str(why).split())}")
            return
        finally:
            self.report.props(remove="loading")
        ui.download.content(page, f"{name}-analysis.html", "text/html")

    def _fill(self, found: Understanding) -> None:
        lines = found.sentences or (found.discrete.reason,)
        self.summary.content = f'<ul class="ctl-und-summary">{"".join(f"<li>{escape(line)}</li>" for line in lines)}</ul>'
        self._fill_observability(found)
        self._fill_poles(found)
        self._fill_steady(found)
        self._fill_transient(found)
        self._fill_transfer(found)

    def _fill_observability(self, found: Understanding) -> None:
        part = found.observability
        if not part:
            self.observability.reason(part)
            self.detectability.reason(part)
            return
        seen = part.value
        n = len(seen.ranks)
        verdict = _good(f"Yes: all {n} states are observable.") if seen.ok else _bad(f"No: rank {seen.rank} of {n}.")
        rows = [
            [complex(v), f"{rank} of {n}", float(s)]
            for v, rank, s in zip(seen.eigenvalues, seen.ranks, seen.sigma_min, strict=True)
        ]
        content = [verdict, table(["Eigenvalue", "Rank of [λI − Φ; H]", "Smallest singular value, relative"], rows)]
        if not seen.ok:
            content.append(f"<p>Never seen: {escape('; '.join(seen.unobservable_modes))}.</p>")
            names = [f"direction {i + 1}" for i in range(seen.unobservable.shape[1])]
            content.append(matrix("States that no measurement tells", seen.unobservable, found.states, names))
        if loss := found.sampling.found:
            content.append(f'<p class="ctl-show-hint">{escape(_sampling(loss))}</p>')
        self.observability.content("".join(content))
        if seen.detectable:
            words = (
                "every mode that does not die out by itself is measured"
                if seen.ok
                else "what is not seen dies out by itself"
            )
            self.detectability.content(_good(f"Yes: {words}, so the filter's errors stay bounded."))
        else:
            modes = "; ".join(seen.undetectable_modes)
            self.detectability.content(
                _bad("No.")
                + f"<p>{escape(modes)}: it neither dies out nor is measured, so its error grows or stays as it began.</p>"
            )

    def _fill_poles(self, found: Understanding) -> None:
        content, z, s = [], found.poles, found.poles_continuous
        for part, plot, title in (
            (z, self.plane_z, "Samples, plane of z"),
            (s, self.plane_s, "Continuous, plane of s"),
        ):
            if part:
                content.append(_pole_table(part.value, title, found))
                plot.show(part.value.drawing)
            else:
                plot.hide()
        if not z:
            self.pole_tables.reason(z)
            return
        if z.value.filter is None:
            content.append(
                f'<p class="ctl-show-why">No steady filter, so no poles of one: {escape(found.limit.reason)}</p>'
            )
        self.pole_tables.content(f'<div class="ctl-show-side">{"".join(content)}</div>')

    def _fill_steady(self, found: Understanding) -> None:
        self.copy_steady.set_visibility(bool(found.limit))
        if not found.limit:
            self.steady.reason(found.limit)
            return
        limit = found.limit.value
        names, sensors = found.states, found.measurements
        rows = [
            [name, float(minus), float(plus), unit or "1"]
            for name, minus, plus, unit in zip(names, limit.sd_minus, limit.sd_plus, found.units, strict=True)
        ]
        settled = (
            f"Every variance stays within 1 % of its limit from step {limit.settled} ({number(limit.time, 4)} s) on."
            if limit.settled is not None
            else "The variances do not come within 1 % of their limits in the steps that were tried."
        )
        content = [f"<p>{escape(settled)}</p>", '<div class="ctl-show-side">']
        content.append(table(["State", "σ⁻", "σ⁺", "Unit"], rows, "Standard deviations"))
        content += [matrix(name, values, names, columns) for name, values, columns in _matrices(found)]
        content.append("</div>")
        if not found.continuous_limit and found.continuous and found.continuous.value.Rc is not None:
            content.append(
                f'<p class="ctl-show-hint">Of a continuous measurement: {escape(found.continuous_limit.reason)}.</p>'
            )
        if bucy := found.continuous_limit.found:
            content.append('<p>Of the continuous measurement (the Kalman–Bucy filter):</p><div class="ctl-show-side">')
            content.append(matrix("P", bucy.P, names, names) + matrix("Gain Kc", bucy.K, names, sensors) + "</div>")
        self.steady.content("".join(content))

    def _steady_text(self) -> str:
        found = self.found
        if found is None or not found.limit:
            return ""
        rows: list[Sequence[object]] = []
        for name, values, columns in _matrices(found):
            rows += [
                [name, *columns],
                *([state, *map(float, row)] for state, row in zip(found.states, values, strict=True)),
                [],
            ]
        return figures.table(rows)

    def _fill_transient(self, found: Understanding) -> None:
        part = found.transient
        n = len(found.states)
        self.choose_states.set_visibility(bool(part) and n > SHOWN)
        if not part:
            self.transient.reason(part)
            self.deviations.hide()
            return
        self.transient.content("")
        if self.states is None or any(i >= n for i in self.states):
            self.states = list(range(min(n, SHOWN)))
        options = dict(enumerate(found.states))
        if self.choose_states.options != options or self.choose_states.value != self.states:
            self.choose_states.set_options(options, value=self.states)
        self.deviations.show(found.deviations(self.states))

    def _states_chosen(self) -> None:
        chosen = sorted(self.choose_states.value or [])
        if chosen and chosen != self.states and self.found is not None:
            self.states = chosen
            self._fill_transient(self.found)

    def _fill_transfer(self, found: Understanding) -> None:
        if found.transfers:
            lines = [
                rf"\frac{{\hat x_{{{_letter(each.state)}}}}}{{{_letter(each.measurement)}}} = {each.latex}"
                for each in found.transfers.value
            ]
            self.transfer.content(
                "".join(f'<div class="ctl-show-equation" tabindex="0">{mathml(line, block=True)}</div>' for line in lines)
            )
        else:
            self.transfer.reason(found.transfers)
        part = found.bode
        names = list(part.value.names) if part else []
        self.choose_pairs.set_visibility(len(names) > SHOWN)
        if not part:
            self.bode_body.reason(part)
            self.bode.hide()
            return
        self.bode_body.content("")
        if self.pairs is None or not set(self.pairs) <= set(names):
            self.pairs = names[:SHOWN]
        if self.choose_pairs.options != names or self.choose_pairs.value != self.pairs:
            self.choose_pairs.set_options(names, value=self.pairs)
        self.bode.show(part.value.drawing(self.pairs))

    def _pairs_chosen(self) -> None:
        chosen = [name for name in self.choose_pairs.options if name in (self.choose_pairs.value or [])]
        if chosen and chosen != self.pairs and self.found is not None:
            self.pairs = chosen
            self._fill_transfer(self.found)


@lru_cache(maxsize=32)
def _understood(text: str) -> Understanding:
    """What can be said of a text; a model that one comes back to is there at once."""
    return compute(loads(text, "", check=False), quick=True)


def _report(text: str) -> bytes:
    """The report of the analysis as one page."""
    from ctlabs.reporting import render
    from ctlabs.reporting.report import Picture
    from ctlabs.studies import analysis

    made = analysis.study(loads(text, ""))
    pictures = {block.name: render.png(block.figure) for block in made.blocks if isinstance(block, Picture)}
    return render.html(made, pictures).encode()


class _Body:
    """What stands in a card: a result, or why there is none."""

    def __init__(self) -> None:
        self._why = ui.label("").classes("ctl-show-why").props("data-test=reason")
        self._html = ui.html("", sanitize=False).classes("w-full")
        self._why.set_visibility(False)

    def content(self, html: str) -> None:
        """A result."""
        self._why.set_visibility(False)
        self._html.content = html

    def reason(self, part: Part[Any]) -> None:
        """Why there is none."""
        self._why.text = f"Not possible: {part.reason}"
        self._why.set_visibility(True)
        self._html.content = ""


# In HTML -------------------------------------------------------------------------------------------------------------


def _good(line: str) -> str:
    return f'<p class="ctl-show-good">{escape(line)}</p>'


def _bad(line: str) -> str:
    return f'<p class="ctl-show-bad">{escape(line)}</p>'


def _matrices(found: Understanding) -> list[tuple[str, Any, tuple[str, ...]]]:
    """The matrices of the steady filter with the names of their columns."""
    state, names, sensors = found.limit.value.state, found.states, found.measurements
    return [
        ("P⁻ before an update", state.P_minus, names),
        ("P⁺ after an update", state.P_plus, names),
        ("Gain K of the filter", state.K, sensors),
        ("Gain of the predictor", state.K_pred, sensors),
    ]


def _sampling(loss: Any) -> str:
    if loss.lost:
        return f"Sampling every {loss.dt:g} s loses something: a continuous measurement would have rank {loss.rank_continuous}."
    if not loss.losing_periods or not math.isfinite(loss.distance):
        return f"Sampling every {loss.dt:g} s loses nothing, and no other period would."
    nearest = ", ".join(f"{period:.4g}" for period in loss.losing_periods[:3])
    return (
        f"Sampling every {loss.dt:g} s loses nothing. Periods at which modes can no longer be told apart: {nearest} s."
    )


def _pole_table(found: Poles, title: str, of: Understanding) -> str:
    """Poles with what they mean: their size, and how long a deviation lasts."""
    dt = of.discrete.value.dt if of.discrete else 1.0
    heads = ["Of the", "Pole", "|z|, 1" if found.plane == "z" else "Frequency, rad/s", "Time constant, s"]
    rows: list[list[Any]] = []
    for name, values in (("model", found.model), ("filter", found.filter)):
        for value in sorted([] if values is None else values, key=lambda v: (-abs(v), v.imag)):
            decay = -math.log(abs(value)) / dt if found.plane == "z" and abs(value) > 0 else -value.real
            if found.plane == "z" and abs(value) == 0:
                lasts = "none: gone in a step"
            elif abs(decay) <= 1e-9 * max(1.0 / dt if found.plane == "z" else abs(value), 1e-300) or decay == 0:
                lasts = "∞"
            else:
                lasts = number(1 / decay, 4) if decay > 0 else f"grows, {number(-1 / decay, 4)}"
            size = abs(value)
            rows.append([name, complex(value), float(size), lasts])
    return table(heads, rows, title)


def _letter(name: str) -> str:
    """A name inside an equation."""
    plain = "".join(c for c in name if c.isalnum() or c in " _-").replace("_", r"\_")
    return rf"\text{{{plain}}}" if plain else r"\square"
