"""The page Fit: constants of the model that make the record most likely, how well they are known, and what becomes of the verdict."""

from __future__ import annotations

import math
from html import escape
from typing import TYPE_CHECKING, Any

from nicegui import ui

from ctlabs.text import prose
from ctlabs.workbench.desk import commands, plain
from ctlabs.workbench.desk.telling import TakeEstimates
from ctlabs.workbench.pages.editing import Editor
from ctlabs.workbench.pages.showing import Show, help_button, times
from ctlabs.workbench.pages.tables import table
from ctlabs.workbench.runs.fits import trace

if TYPE_CHECKING:
    from ctlabs.workbench.desk.session import Session
    from ctlabs.workbench.desk.sheet import ConstantRow
    from ctlabs.workbench.pages.shell import Shell
    from ctlabs.workbench.runs.fits import FitResult, Side

PAGE = {"place": 5, "title": "Fit", "icon": "tune"}

#: How often the likelihood is drawn while it rises, s.
REDRAWN = 0.5
#: Most starts beside the first.
STARTS = 1000


def page(session: Session, shell: Shell) -> None:
    """Draw the page."""
    _Fit(session, shell).draw()


class _Fit:
    """The page in one tab."""

    def __init__(self, session: Session, shell: Shell) -> None:
        self.session, self.shell, self.desk = session, shell, session.records
        self.show, self.running = Show(shell), session.records.fitting
        self.editor = Editor(session, shell, self._changed)
        self.seen = self.running.finished
        self.boxes: dict[str, ui.checkbox] = {}
        self.values: dict[str, ui.label] = {}
        self.points = 0

    # Drawing -----------------------------------------------------------------------------------------------------------

    def draw(self) -> None:
        self.shell.name_draft(self.session.title)
        with ui.element("div").classes("ctl-data"):
            self._draw_constants()
            with self.show.card("The likelihood as it rises", "fit.trace", test="fit-trace") as card:
                self.trace_card = card.section
                self.trace = self.show.plot(test="plot-fit-trace", title=False)
            self.box = ui.element("div").classes("ctl-data-found")
        self.shell.shortcut("mod+enter", "Fit", self.run)
        self.shell.shortcut("alt+shift+x", "Cancel, and keep the best so far", self.running.cancel)
        self.shell.shortcut("mod+z", "Undo", self.editor.undo, in_fields=False)
        self.shell.shortcut("mod+shift+z", "Redo", self.editor.redo, in_fields=False)
        self.shell.on_leave(self.running.watch(self._look))
        self.timer = ui.timer(REDRAWN, self._follow)
        self.shell.on_leave(self.timer.cancel)
        self._look()
        self._found()

    def _draw_constants(self) -> None:
        with self.show.card("Constants to be found", "fit.constants", test="fit-constants") as card:
            self.card = card.section
            rows = self.session.sheet.constants
            data = self.desk.data
            source = ui.label(f"From {data.name}." if data else "There are no data yet.").props("data-test=fit-source")
            source.classes("ctl-show-hint")
            to_data = ui.button("Data…", icon="table_chart", on_click=lambda: self.shell.go("data"))
            to_data.props("no-caps outline dense data-test=fit-to-data").set_visibility(data is None)
            if not rows:
                ui.label("The model has no constants: give its numbers names on the page Model, and come back.").props("data-test=fit-none")
            with ui.element("div").classes("ctl-fit-constants").props('role=group aria-label="Constants"'):
                for row in rows:
                    self._draw_constant(row)
            with ui.row().classes("items-center gap-2"):
                self.run_button = ui.button("Fit", icon="play_arrow", on_click=self.run)
                self.run_button.props('no-caps data-test=fit-run aria-keyshortcuts="Control+Enter"')
                self.cancel_button = ui.button("Cancel, keep the best", icon="stop", on_click=self._cancel)
                self.cancel_button.props("no-caps outline data-test=fit-cancel")
                self.starts = ui.input("More starts", value="0").classes("w-32")
                self.starts.props("outlined dense inputmode=numeric data-test=fit-starts")
                help_button("fit.starts")
            self.bar = ui.linear_progress(value=0.0, show_value=False, size="8px").props('aria-label="Progress" data-test=fit-bar')
            self.told = ui.label("").classes("ctl-show-hint").props("role=status aria-live=polite data-test=fit-progress")
            self.wrong = ui.label("").classes("ctl-show-error").props("role=alert data-test=fit-error")

    def _draw_constant(self, row: ConstantRow) -> None:
        """A box to tick, the present value, and the range in which the search stays."""
        name, chosen = row.name, self.desk.free
        with ui.element("div").classes("ctl-fit-constant"):
            label = f"{name}, {row.unit}" if row.unit else name
            box = ui.checkbox(label, value=name in chosen, on_change=self._chosen).props(f"dense data-test=fit-free-{name}")
            if row.meaning:
                with box:
                    ui.tooltip(row.meaning)
            box.set_enabled(row.cell.value is not None and row.cell.problem is None)
            self.boxes[name] = box
            self.values[name] = ui.label(f"now {row.cell.text}").classes("ctl-show-hint").props(f"data-test=fit-value-{name}")
            for key, words, text in (("min", "From", row.min_text), ("max", "To", row.max_text)):
                field = ui.input(words, value=text).props(f"outlined dense hide-bottom-space autocomplete=off data-test=fit-{key}-{name}")
                field.props["aria-label"] = f"{words} of {name}"
                field.on("blur", lambda _, field=field, key=key, name=name: self._range(field, name, key))
                field.on("keydown.enter", lambda _, field=field, key=key, name=name: self._range(field, name, key))

    # Changes -----------------------------------------------------------------------------------------------------------

    async def _range(self, field: ui.input, name: str, key: str) -> None:
        """A limit of a constant, which is the model's."""
        row = next((row for row in self.session.sheet.constants if row.name == name), None)
        text = str(field.value or "").strip()
        if row is None or text == {"min": row.min_text, "max": row.max_text}[key]:
            return
        problem = self.editor.type("", commands.EditCell(("constants", name, key), text))
        field.error = (problem if isinstance(problem, str) else await problem) or None

    def _chosen(self) -> None:
        self.desk.choose([name for name, box in self.boxes.items() if box.value])
        self._look()

    def _changed(self, _key: str) -> None:
        """The model is another one: what stands beside the constants is shown again."""
        known = {row.name: row for row in self.session.sheet.constants}
        if set(known) != set(self.values):
            self.shell.refresh()
            return
        for name, label in self.values.items():
            label.text = f"now {known[name].cell.text}"
        self._look()
        self._found()

    # The run -----------------------------------------------------------------------------------------------------------

    def run(self) -> None:
        """Fit what is ticked, if all is in order."""
        if self.running.running or self._refusal():
            return
        try:
            starts = plain.whole(self.starts.value or "0", 0, STARTS)
        except ValueError as why:
            self.starts.error = str(why)
            return
        self.starts.error, self.points = None, 0
        free = list(self.desk.free)
        self.running.start(lambda progress, cancel: self.desk.fit(free, starts, progress, cancel))

    def _cancel(self) -> None:
        self.running.cancel()
        self.told.text = "Ending with the best so far…"

    def _refusal(self) -> str:
        problems = self.session.sheet.problems
        if problems:
            where, what = next(iter(problems.items()))
            return f"The model cannot be fitted: {where + ': ' if where else ''}{what}"
        if self.desk.data is None:
            return "Fitting needs a record: choose one on the page Data."
        return "" if self.desk.free else "Tick the constants that are to be found."

    def _look(self) -> None:
        """Show how far it is."""
        now, refusal = self.running, self._refusal()
        with self.card:
            self.run_button.set_enabled(not now.running and not refusal)
            self.cancel_button.set_visibility(now.running)
            self.bar.set_visibility(now.running)
            if now.running:  # how far it is is shown by the timer, not with every likelihood
                self.wrong.text = ""
                return
            self.told.text = "Cancelled before anything was found." if now.cancelled else refusal
            self.wrong.text = now.problem
            if now.finished != self.seen:
                self.seen = now.finished
                self._found()
                ui.run_javascript(f"ctlabs.bring({self.box.id})")

    def _tell(self) -> None:
        progress = self.running.progress
        if progress is None or progress.note is None:
            self.told.text, self.bar.value = "Starting…" if progress is None or not progress.ahead else "Waiting for another run…", 0.0
            return
        point = progress.note
        left = f", about {times(point.left)} left" if math.isfinite(point.left) and point.left >= 1 else ""
        best = f"best log-likelihood {prose(point.best, 8)}" if math.isfinite(point.best) else "no likelihood yet"
        self.told.text = f"{point.stage[:1].upper()}{point.stage[1:]}: {best} after {point.done} likelihoods{left}."
        self.bar.value = progress.fraction

    def _follow(self) -> None:
        """How far the search is, and the likelihood as far as it has risen."""
        if self.running.running:
            self._tell()
        points = self.desk.trace
        self.trace_card.set_visibility(len(points) > 1)
        if len(points) > 1 and len(points) != self.points:
            self.points = len(points)
            self.trace.show(trace(points))

    # What was found ----------------------------------------------------------------------------------------------------

    def _found(self) -> None:
        found = self.desk.fitted
        self.box.clear()
        if found is None:
            return
        with self.box:
            with self.show.card("Estimates", "fit.estimates", test="fit-found"):
                self._draw_estimates(found)
            if found.before is not None and found.after is not None:
                with self.show.card("Before and after", "fit.sides", test="fit-sides"):
                    self._draw_sides(found, found.before, found.after)
            if found.profiles:
                card = self.show.card("What the record says of each", "fit.profiles", test="fit-profiles")
                with card, ui.element("div").classes("ctl-fit-profiles"):
                    for drawing in found.profiles:
                        self.show.plot(drawing, test="plot-fit-profile")
            if found.correlation is not None:
                with self.show.card("Correlations of the estimates", "fit.correlation", test="fit-correlation"):
                    rows = [[name, *map(float, row)] for name, row in zip(found.names, found.correlation, strict=True)]
                    ui.html(table(["", *found.names], rows), sanitize=False).classes("w-full")

    def _draw_estimates(self, found: FitResult) -> None:
        lines = [found.remark] if found.remark else []
        if math.isfinite(found.log_likelihood):
            lines.append(
                f"The log-likelihood rises from {prose(found.start_log_likelihood)} to {prose(found.log_likelihood)} "
                f"({found.evaluations} likelihoods); AIC {prose(found.aic)}."
            )
        lines += [f"No standard error of {name}: {reason}." for name, reason in found.reasons.items()]
        if not (found.converged or found.interrupted) and math.isfinite(found.log_likelihood):
            lines.append("The search has not converged: the likelihood may still rise. Start from other values, or with more starts.")
        with ui.element("div").props("role=status aria-live=polite data-test=fit-words"):
            for each in lines:
                ui.label(each)
        heads = ["Constant", "Unit", "Before", "Estimate", "Standard error", "95 % from", "to"]
        ui.html(table(heads, [self._row(found, i) for i in range(len(found.names))]), sanitize=False).classes("w-full")
        taken = all(self.session.file.constants.get(name) == value for name, value in found.estimates.items()) if self._sound() else False
        with ui.row().classes("items-center gap-2"):
            take = ui.button("Take the estimates into the model", icon="check", on_click=self._take)
            take.props("no-caps data-test=fit-take").set_enabled(not taken)
            words = "They are in the model; Ctrl+Z takes them out." if taken else f"Of {found.source}."
            ui.label(words).classes("ctl-show-hint").props("data-test=fit-taken role=status")
            self.show.copy(lambda: _text(heads, found, self._row), "Copy the estimates", test="fit-copy", words="Numbers")

    def _sound(self) -> bool:
        return not self.session.sheet.problems

    def _row(self, found: FitResult, i: int) -> list[Any]:
        interval = found.intervals[i]
        low, high = interval if interval is not None else (None, None)
        error = None if math.isnan(found.errors[i]) else found.errors[i]
        return [found.names[i], found.units[i] or "1", found.start[i], found.values[i], error, low, high]

    def _draw_sides(self, found: FitResult, before: Side, after: Side) -> None:
        rows: list[list[Any]] = [[name, a, b] for name, a, b in zip(found.names, before.values, after.values, strict=True)]
        rows.append(["log-likelihood", before.log_likelihood, after.log_likelihood])
        rows.append([f"NIS per instant (expected {prose(after.expected)})", before.nis, after.nis])
        ui.html(table(["", "Before", "After"], rows), sanitize=False).classes("w-full")
        with ui.element("div").classes("ctl-fit-sides"):
            for words, side, test in (("Before", before, "fit-before"), ("After", after, "fit-after")):
                with ui.element("div"):
                    ui.html(f"<h3>{escape(words)}</h3>", sanitize=False).classes("ctl-show-head")
                    told = side.judgement.suggestion
                    label = ui.label(f"{told[:1].upper()}{told[1:].rstrip('.')}.").props(f"data-test={test}")
                    label.classes("ctl-show-good" if side.judgement.ok else "ctl-show-bad")
                    if side.judgement.whiteness is not None:
                        self.show.plot(side.judgement.whiteness, test=f"plot-{test}")

    def _take(self) -> None:
        """Put the estimates into the model, as one step that can be undone."""
        found = self.desk.fitted
        if found is not None and self.editor.do(TakeEstimates(found.estimates)):
            self.shell.tell("The estimates are in the model")


def _text(heads: list[str], found: FitResult, row: Any) -> str:
    """The estimates with all digits, tabs between them."""
    rows = [["" if cell is None else str(cell) for cell in row(found, i)] for i in range(len(found.names))]
    return "\n".join("\t".join(cells) for cells in [heads, *rows])
