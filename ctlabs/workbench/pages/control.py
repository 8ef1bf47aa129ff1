"""Control: a regulator of the own model; what its loop does and costs follows as its weights are moved."""

from __future__ import annotations

import asyncio
import threading
from typing import TYPE_CHECKING

from nicegui import background_tasks, ui

from ctlabs.text import prose
from ctlabs.workbench.desk.costing import AddInput, BeginCost, EndCost
from ctlabs.workbench.pages.control_more import Elsewhere, Export, Many
from ctlabs.workbench.pages.control_results import LoopResults, signals, verdict
from ctlabs.workbench.pages.control_weights import RegulatorForm, WeightList
from ctlabs.workbench.pages.editing import Editor
from ctlabs.workbench.pages.model_constants import Constants
from ctlabs.workbench.pages.showing import Show
from ctlabs.workbench.runs.loops import regulated, steps, warm
from ctlabs.workbench.runs.worker import RunFailed

if TYPE_CHECKING:
    from ctlabs.studies.regulating import Regulated
    from ctlabs.workbench.desk.session import Session
    from ctlabs.workbench.pages.shell import Shell

PAGE = {"place": 6, "title": "Control", "icon": "control_camera", "letter": "r"}

#: For how long nothing is moved before the curves are drawn, s.
CALM = 0.8


def page(session: Session, shell: Shell) -> None:
    """Draw the page."""
    _Control(session, shell).draw()


class _Control:
    """The page in one tab."""

    def __init__(self, session: Session, shell: Shell) -> None:
        self.session, self.shell = session, shell
        self.show = Show(shell)
        self.editor = Editor(session, shell, self._changed)
        self.found: Regulated | None = None
        self.refused = ""
        self.wanted: str | None = None
        self.computing = self.left = False
        self.drawing: threading.Event | None = None
        self.begun = self._regulated

    @property
    def _regulated(self) -> bool:
        """Whether the model says what a regulator keeps small."""
        return "cost" in self.session.sheet.data

    def draw(self) -> None:
        self.shell.name_draft(self.session.title)
        (self._draw if self.begun else self._draw_beginning)()
        self.shell.shortcut("mod+z", "Undo", self.editor.undo, in_fields=False)
        self.shell.shortcut("mod+shift+z", "Redo", self.editor.redo, in_fields=False)
        self.shell.on_leave(self._leave)
        self.shell.on_change(lambda: self._changed(""))
        if self.begun:
            self._changed("")

    # Before there is a regulator -----------------------------------------------------------------------------------------

    def _draw_beginning(self) -> None:
        sheet = self.session.sheet
        has_input, known = "B" in sheet.grids, "u" in sheet.grids
        with self.show.card("A regulator", "control.begin", wide=True, test="control-begin"):
            if sheet.problems:
                where, what = next(iter(sheet.problems.items()))
                told = f"The model is to be put right first: {where + ': ' if where else ''}{what}"
                ui.label(told).classes("ctl-show-error").props("role=alert")
                ui.button("Go to the model", icon="grid_on", on_click=lambda: self.shell.go("model")).props("outline no-caps dense")
            elif not has_input:
                ui.label("The model has no input (no matrix B): nothing can act on it. Choose the state whose rate an input shall change.")
                with ui.row().classes("items-center gap-2"):
                    self.state = ui.select(dict(enumerate(sheet.states)), value=len(sheet.states) - 1, label="The input moves")
                    self.state.props("outlined dense options-dense data-test=control-input-state").classes("w-48")
                    ui.button("Add an input", icon="add", on_click=self._add_input).props("no-caps data-test=control-add-input")
                ui.label("It becomes a column of B with a 1 there, which can be changed on the page Model.").classes("ctl-show-hint")
            else:
                told = ", ".join(cell.text for row in sheet.grids["u"].rows for cell in row) if known else ""
                ui.label(
                    f"The model's input is known: u = {told}. A regulator makes the input itself, from what is measured."
                    if known
                    else "The model has an input, and nothing that makes it. A regulator answers every measurement with one."
                )
                begin = ui.button("Let a regulator make the input", icon="control_camera", on_click=lambda: self.editor.do(BeginCost()))
                begin.props("no-caps data-test=control-begin-cost")
                kept = "All weights begin at 1; what is changed here is kept in the model file, and can be undone."
                ui.label(kept).classes("ctl-show-hint")

    def _add_input(self) -> None:
        if self.editor.do(AddInput(int(self.state.value))):
            self.editor.do(BeginCost())

    # With one --------------------------------------------------------------------------------------------------------------

    def _draw(self) -> None:
        with ui.element("div").classes("ctl-control"):
            with ui.element("div").classes("ctl-control-side"):
                self.weights = WeightList(self.editor)
                self.settings = RegulatorForm(self.editor)
                self.constants = Constants(self.editor)
            with ui.element("div").classes("ctl-column"):
                self._draw_summary()
                self.results = LoopResults(self.show, self.session.loops)
                with ui.element("div").classes("ctl-show-grid"):
                    self.many = Many(self.show, self.session, self.shell)
                    self.export = Export(self.show, self.session, self.shell)
                    self.elsewhere = Elsewhere(self.show, self.session, self.shell)

    def _draw_summary(self) -> None:
        with self.show.card("In short", "control.margins", wide=True, test="control-summary") as card:
            self.box = card.section
            with card.head:
                ui.space()
                end = ui.button("No regulator", icon="close", on_click=lambda: self.editor.do(EndCost()))
                end.props("flat dense no-caps data-test=control-end")
            self.summary = ui.html("<p>Computing…</p>", sanitize=False).props("role=status aria-live=polite data-test=control-verdict")
            self.wrong = ui.label("").classes("ctl-show-error").props("role=alert data-test=control-wrong")
            self.hint = ui.label("").classes("ctl-show-hint")

    # Following -------------------------------------------------------------------------------------------------------------

    def _changed(self, _key: str) -> None:
        if self._regulated != self.begun or not self.begun:
            self.shell.refresh()
            return
        sheet = self.session.sheet
        self.weights.show(sheet)
        self.settings.show(sheet)
        self.constants.show(sheet.constants)
        self.wanted = self.session.text
        if self.drawing is not None:
            self.drawing.set()
        if not self.computing:
            self.computing = True
            background_tasks.create(self._compute(), name="control")

    async def _compute(self) -> None:
        """The regulator of the present model, in a thread; of several that are wanted meanwhile only the last one."""
        try:
            while self.wanted is not None and not self.left:
                text, self.wanted = self.wanted, None
                found, refused = await asyncio.to_thread(_found, text)
                if self.wanted is None and not self.left:
                    with self.box:
                        self._show(found, refused)
                    background_tasks.create(self._curves(text), name="curves")
        finally:
            self.computing = False

    def _leave(self) -> None:
        self.left = True
        if self.drawing is not None:
            self.drawing.set()

    def _show(self, found: Regulated | None, refused: str) -> None:
        """The regulator, or why there is none beside the last one that there was."""
        problems = self.session.sheet.problems
        if problems:
            where, what = next(iter(problems.items()))
            refused = f"{where + ': ' if where else ''}{what}"
            found = None
        stale = found is None and self.found is not None
        below = " What stands below is the regulator before." if stale else ""
        self.wrong.text = f"There is no regulator: {refused.rstrip('.')}.{below}" if refused else ""
        self.results.box.classes(add="ctl-stale" if stale else "", remove="" if stale else "ctl-stale")
        self.summary.set_visibility(found is not None)
        self.export.allow(found is not None)
        self.many.show(found)
        self.elsewhere.show()
        if found is None:
            return
        self.found = found
        self.summary.content = verdict(found)
        file = found.file
        asked = file.experiment.steps
        cut = steps(file) != asked and found.regulator.steps is None
        self.hint.text = f"The loop is followed for {steps(file)} steps (the model file says {asked})." if cut else ""
        self.results.show(found)
        self._deviations(found)

    def _deviations(self, found: Regulated) -> None:
        """σ beside each weight."""
        if not found.limit:
            self.weights.deviations({})
            return
        rows = [f"σ {prose(sd, 3)} {unit}".strip() for _, sd, _, unit in signals(found)]
        n, m = found.truth.n, found.truth.m
        told = {("States", name): rows[i] for i, name in enumerate(found.truth.states)}
        told |= {("Outputs", name): rows[n + i] for i, name in enumerate(found.truth.measurements)}
        told |= {("Inputs", name): rows[n + m + i] for i, name in enumerate(found.inputs)}
        self.weights.deviations(told)

    async def _curves(self, text: str) -> None:
        """The curves, when nothing has been moved for a moment; they end when something is."""
        desk = self.session.loops
        if self.found is None or self.wrong.text:
            return
        moved = self.drawing = threading.Event()
        await asyncio.to_thread(warm)
        if desk.curves is None or desk.curves[0] != text:
            if not moved.is_set():
                with self.box:
                    self.results.draw_curves(None, "Computing the curves…")
            for _ in range(8):
                await asyncio.sleep(CALM / 8)
                if moved.is_set():
                    return
            why = await self._draw_curves(text, moved)
            if why and not moved.is_set():
                with self.box:
                    self.results.draw_curves(None, f"No curves: {why}")
                return
        if not moved.is_set() and desk.curves is not None and desk.curves[0] == text:
            with self.box:
                self.results.draw_curves(desk.curves[1])

    async def _draw_curves(self, text: str, moved: threading.Event) -> str:
        """Have them computed; why there are none, or empty."""
        try:
            await self.session.loops.draw(text, moved)
        except RunFailed as why:
            return why.line
        except (ValueError, ArithmeticError) as why:
            return " ".join(str(why).split())
        return ""


def _found(text: str) -> tuple[Regulated | None, str]:
    """The regulator of a text, or why there is none."""
    try:
        return regulated(text), ""
    except (ValueError, TypeError, ArithmeticError) as why:
        return None, " ".join(str(why).split())
