"""The page Model: matrices as grids of text cells, constants with sliders, equations with the numbers in, the file as text.

What is typed is a command to the session at once (after 150 ms), and only what it changes is drawn again. A cell that is typed
into for a while is one edit to undo.
"""

from __future__ import annotations

import re
from collections.abc import Awaitable
from dataclasses import replace
from functools import partial
from html import escape
from typing import TYPE_CHECKING, Any

from nicegui import ui

from ctlabs.files.modelfile.errors import ModelFileError
from ctlabs.files.modelfile.toml import LARGEST, decoded
from ctlabs.reporting.mathml import mathml
from ctlabs.workbench.desk import commands
from ctlabs.workbench.desk.sheet import LETTERS
from ctlabs.workbench.pages import model_dialogs
from ctlabs.workbench.pages import model_parts as parts
from ctlabs.workbench.pages.cells import Label
from ctlabs.workbench.pages.editing import Editor
from ctlabs.workbench.pages.entries import Entries, is_large
from ctlabs.workbench.pages.grid import GridElement, TextField
from ctlabs.workbench.pages.math import Equations
from ctlabs.workbench.pages.model_constants import Constants
from ctlabs.workbench.pages.model_edits import (
    Section,
    block_command,
    cell_command,
    line_of,
    sections,
    unknown_name,
)
from ctlabs.workbench.runs.inside import line

if TYPE_CHECKING:
    from nicegui.events import UploadEventArguments

    from ctlabs.workbench.desk.session import Session
    from ctlabs.workbench.desk.sheet import Cell, ModelSheet
    from ctlabs.workbench.pages.shell import Shell

PAGE = {"place": 1, "title": "Model", "icon": "grid_on"}

#: How many problems are listed above the cells.
LISTED = 4
KEYS = (
    "Arrows, Enter and Tab go from cell to cell, Ctrl+Home and Ctrl+End to the first and last of a matrix; Esc takes back what was "
    "typed. Ctrl+Delete in the name of a state or measurement removes it. A block copied from a spreadsheet can be pasted into the cells."
)


def page(session: Session, shell: Shell) -> None:
    """Draw the page."""
    ModelPage(session, shell).draw()


class ModelPage:
    """The page in one tab."""

    def __init__(self, session: Session, shell: Shell) -> None:
        self.session, self.shell = session, shell
        self.grids: dict[str, GridElement | Entries] = {}
        self.names: dict[str, GridElement] = {}  # where names and units of a large matrix are typed
        self._layout: tuple[Any, ...] = ()
        self._view = "cells"
        self._title = ""
        self._unfinished = str(_notes(session).get("unfinished", ""))
        self.editor = Editor(session, shell, self._changed)
        self.do, self.type, self.done = self.editor.do, self.editor.type, self.editor.done
        self._told: dict[str, str] | None = None
        self._listed: dict[tuple[str, str, str], ui.element] = {}
        self._times: dict[str, TextField] = {}

    def _changed(self, key: str) -> None:
        if key != "text":
            self._remember("")
        self.show()

    def _remember(self, text: str) -> None:
        """Keep a text that is no file yet, so that nothing typed is lost."""
        if text != self._unfinished:
            self._unfinished = text
            if not text:
                self._text.forget()
            self.session.store.note(self.session.draft.id, unfinished=text)

    # Drawing -------------------------------------------------------------------------------------------------------------

    def draw(self) -> None:
        """Draw everything."""
        with ui.element("div").classes("ctl-model") as root:
            with ui.element("div").style("display: none"):
                self._uploader = ui.upload(
                    auto_upload=True, max_file_size=LARGEST, on_upload=self._uploaded, on_rejected=self._rejected
                ).props('accept=".toml,text/plain"')
            root.props(f"data-uploader={self._uploader.id}")
            parts.text("div", "Drop a model file to open it").classes("ctl-drop").props("aria-hidden=true")
            self._begin = ui.element("section").props('aria-label="Begin"').classes("ctl-column")
            with self._begin:
                self._draw_begin()
            self._work = ui.element("div").classes("ctl-column")
            with self._work:
                self._draw_head()
                self._problems = (
                    ui.element("div").classes("ctl-problems").props("role=status aria-live=polite data-test=problems")
                )
                with self._problems:
                    self._verdict_icon = ui.icon("check_circle").props("aria-hidden=true size=xs")
                    self._verdict = ui.label("")
                    self._problem_list = ui.element("span").style("display: contents")
                    self._more_problems = ui.label("")
                self._cells = ui.element("div").classes("ctl-columns")
                self._text_place = ui.element("div").classes("ctl-card")
            with self._cells:
                self._matrices = ui.element("div").classes("ctl-column")
                with ui.element("div").classes("ctl-column ctl-side"):
                    self._draw_equations()
                    self._constants = Constants(self.editor)
            with self._text_place:
                self._draw_text()
        for keys, label, action in (
            ("mod+z", "Undo", self.editor.undo),
            ("mod+shift+z", "Redo", self.editor.redo),
            ("mod+y", "Redo", self.editor.redo),
            ("mod+o", "Open a model", self.open_dialog),
            ("mod+s", "Download the model file", self.download),
            ("mod+e", "Cells or text", self._other_view),
        ):
            self.shell.shortcut(keys, label, action)
        self.shell.on_change(self.show)
        if self._unfinished:
            self._view = "text"
        self.show()
        if self._unfinished:
            why = self.type("text", commands.Rewrite(self._unfinished))
            self._text.write(self._unfinished, self._text_done(self._unfinished, why) if isinstance(why, str) else "")

    def _draw_begin(self) -> None:
        parts.text("h2", "Begin with a model")
        with ui.element("div").classes("ctl-begin"):
            for test, title, what, action in (
                (
                    "begin-ready",
                    "A ready model",
                    "From the gallery or one of the labs, to try and to change.",
                    self.open_dialog,
                ),
                (
                    "begin-new",
                    "A new model",
                    "Say how many states, noises and measurements it has, and type.",
                    self.new_dialog,
                ),
                (
                    "begin-data",
                    "I have data",
                    "A table of measurements: CSV, Excel, parquet. Drop it here, and say which column is what.",
                    lambda: self.shell.go("data"),
                ),
            ):
                with ui.element("button").props(f"type=button data-test={test}").on("click", action):
                    ui.html(f"<b>{title}</b><br>{what}", sanitize=False)
            with ui.element("button").props("type=button data-test=begin-file") as button:
                ui.html(
                    "<b>A file of your own</b><br>A model file (.toml); you can also drop it on this page.",
                    sanitize=False,
                )
            button.on("click", js_handler=self._pick)
        with ui.row().classes("items-center"):
            ui.label("For the first time here?")
            tour = parts.text("button", "Take the guided tour (about five minutes)").classes("ctl-link")
            tour.props("type=button data-test=begin-tour")
            tour.on("click", lambda: self.shell.go("help"))
        self._begin_redo = ui.button("Redo what was undone", icon="redo", on_click=self.editor.redo)
        self._begin_redo.props("outline no-caps data-test=begin-redo").classes("self-start")
        if self.session.untouched and (models := parts.earlier(self.session)):
            parts.text("h2", "Earlier models")
            parts.earlier_list(models)

    @property
    def _pick(self) -> str:
        """The browser's own dialog may be opened by a click only, so this does not go by the server."""
        return f"() => getElement({self._uploader.id}).$refs.qRef.pickFiles()"

    def _draw_head(self) -> None:
        with ui.element("div").classes("ctl-bar"):
            self._title_field = TextField(
                "Title", lambda text: self.type("title", commands.EditCell(("title",), text)), self.done, test="title", show_label=False,
                placeholder="Title of the model",
            )  # fmt: skip
            self._title_field.classes("ctl-titlefield")
            options = {"continuous": "Continuous", "discrete": "Discrete"}
            self._kind = ui.toggle(options, on_change=lambda event: self._set_kind(event.value))
            self._kind.classes("ctl-toggle").props('dense no-caps unelevated data-test=kind aria-label="Kind of model"')
            parts.help_button("model.kind")
        with ui.element("div").classes("ctl-bar").props('role=toolbar aria-label="Model"'):
            parts.tool("New", "add", "new", self.new_dialog)
            parts.tool("Open", "folder_open", "open", self.open_dialog, keys="Ctrl+O")
            parts.tool("Download", "download", "save", self.download, keys="Ctrl+S")
            ui.element("span").style("width: .5rem")
            self._undo = parts.tool("Undo", "undo", "undo", self.editor.undo, keys="Ctrl+Z")
            self._redo = parts.tool("Redo", "redo", "redo", self.editor.redo, keys="Ctrl+Shift+Z")
            ui.element("span").classes("ctl-gap")
            self._block = parts.tool("Coloured noise", "graphic_eq", "block", self.block_dialog)
            self._view_button = parts.tool("Text", "code", "view-text", self._other_view, keys="Ctrl+E")
        self._about = ui.element("p").classes("ctl-about")
        with self._about:
            self._about_text = ui.html("", sanitize=False)

    def _draw_equations(self) -> None:
        with ui.element("section").classes("ctl-card").props('aria-label="Equations"'):
            with ui.element("div").classes("ctl-bar"):
                parts.text("h2", "Equations")
                ui.element("span").classes("ctl-gap")
                self._inside = ui.toggle(
                    {"numbers": "Numbers", "names": "As typed"}, value="numbers", on_change=self._show_equations
                )
                self._inside.classes("ctl-toggle").props(
                    'dense no-caps unelevated size=sm data-test=equations-inside aria-label="What stands in the equations"'
                )
            self._equations = Equations("The model's equations")
            self._equations.props("data-test=equations")

    def _draw_text(self) -> None:
        with ui.element("div").classes("ctl-bar"):
            parts.text("h2", "The model file")
            ui.element("span").classes("ctl-gap")
            self._goto = ui.button("Go to the line", on_click=self._go_to_line).props(
                "flat dense no-caps data-test=go-to-line"
            )
        self._text = TextField(
            "The model file, TOML", self._text_typed, self.done, test="text", area=True, show_label=False
        )
        self._wrong_line = 0

    # Showing -------------------------------------------------------------------------------------------------------------

    def show(self) -> None:
        """Show what the session has; only what has changed travels to the browser."""
        session, sheet = self.session, self.session.sheet
        self._begin.set_visibility(session.untouched)
        self._begin_redo.set_visibility(session.can_redo)
        self._work.set_visibility(not session.untouched)
        title = "" if session.untouched else session.title
        if title != self._title:
            self._title = title
            self.shell.name_draft(title)
        self._title_field.show(sheet.shown(("title",)))
        about = escape(
            " ".join(part for part in (sheet.description, f"({sheet.source})" if sheet.source else "") if part)
        )
        if self._about_text.content != about:
            self._about_text.content = about
            self._about.set_visibility(bool(about))
        if self._kind.value != (sheet.kind or None):
            self._kind.set_value(sheet.kind or None)
        for button, word, able, label in (
            (self._undo, "Undo", session.can_undo, _label(session, 0)),
            (self._redo, "Redo", session.can_redo, _label(session, 1)),
        ):
            parts.tell(button, word, able, label)
        parts.tell(
            self._block,
            "Coloured noise",
            sheet.kind == "continuous",
            "" if sheet.kind == "continuous" else "of a continuous model only",
        )
        self._show_view()
        layout = (sheet.kind, tuple((name, is_large(grid)) for name, grid in sheet.grids.items()), sheet.missing_parts)
        if layout != self._layout:
            self._layout = layout
            self._draw_matrices()
        self._show_matrices()
        self._constants.show(sheet.constants)
        self._show_equations()
        self._show_problems()
        self._show_text()

    def _show_text(self) -> None:
        """The text is sent only where it is seen."""
        if self._view == "text" and not self._unfinished:
            self._text.write(self.session.text)

    def _show_view(self) -> None:
        if not self.session.sheet.kind:
            self._view = "text"  # there is nothing to show in cells
        cells = self._view == "cells"
        self._cells.set_visibility(cells)
        self._text_place.set_visibility(not cells)
        self._goto.set_visibility(self._wrong_line > 0)
        word = "Text" if cells else "Cells"
        self._view_button.props(f'aria-label="{word}" icon={"code" if cells else "grid_on"}')
        self._view_word.text = word

    @property
    def _view_word(self) -> ui.label:
        return parts.word_of(self._view_button)

    def _other_view(self) -> None:
        self._view = "text" if self._view == "cells" else "cells"
        self._show_view()
        self._show_text()
        (self._text if self._view == "text" else self._title_field).run_method("enter", "")

    def _draw_matrices(self) -> None:
        """The cards; they are made anew only when a matrix comes or goes."""
        sheet = self.session.sheet
        self._matrices.clear()
        self.grids, self.names = {}, {}
        with self._matrices:
            for section in sections(sheet.kind, sheet.grids) if sheet.kind else ():
                with ui.element("section").classes("ctl-card").props(f'aria-label="{section.title}"'):
                    with ui.element("div").classes("ctl-bar"):
                        parts.text("h2", section.title)
                        ui.element("span").classes("ctl-gap")
                        ui.html(mathml(section.equation, block=True), sanitize=False)
                    with ui.element("div").classes("ctl-sections"):
                        for name in section.parts:
                            self._draw_part(name)
                        if section.title == "The beginning":
                            self._draw_times()
                    self._draw_additions(section)
            if sheet.kind:
                ui.label(KEYS).classes("ctl-meaning")

    def _draw_part(self, name: str) -> None:
        with ui.element("div").classes("ctl-part"):
            with ui.element("div").classes("ctl-caption"):
                ui.html(mathml(LETTERS.get(name, name), block=True), sanitize=False)
                parts.text("h3", parts.TITLES[name])
                parts.help_button(f"model.{name}")
                if name in {"u", "N", "offset"}:
                    remove = ui.button(icon="close", on_click=partial(self.do, commands.RemovePart(name)))  # type: ignore[arg-type]
                    remove.props(
                        f'flat round dense size=xs aria-label="Remove {parts.TITLES[name]}" data-test=remove-{name}'
                    )
            kind = {"F": "state", "Phi": "state", "H": "measurement"}.get(name, "")
            if not is_large(self.session.sheet.grids[name]):
                self.grids[name] = self._draw_grid(name, kind, "noise" if name == "G" else "")
                return
            self.grids[name] = Entries(name, partial(self._typed, name), self.done)
            if kind:
                with ui.expansion(f"Names and units of the {kind}s").props("dense").classes("w-full"):
                    self.names[name] = self._draw_grid(name, kind, "")

    def _draw_grid(self, name: str, row_kind: str, column_kind: str) -> GridElement:
        return GridElement(
            name,
            partial(self._typed, name),
            on_block=partial(self._pasted, name),
            on_remove=self._remove,
            on_done=self.done,
            row_kind=row_kind,
            column_kind=column_kind,
            refused=self.session.refused.setdefault(name, {}),
        )

    def _draw_times(self) -> None:
        with ui.element("div").classes("ctl-part ctl-small"):
            for name, label in (("dt", "Period dt"), ("t0", "Beginning t0")):
                with ui.element("div").classes("ctl-caption"):
                    parts.text("h3", label)
                    parts.help_button(f"model.{name}")
                self._times[name] = TextField(
                    label, partial(self._time_typed, name), self.done, test=name, show_label=False, suffix="s"
                )

    def _draw_additions(self, section: Section) -> None:
        sheet = self.session.sheet
        with ui.element("div").classes("ctl-bar"):
            if section.title == "The system":
                parts.add("State", "add-state", partial(self._add, "state"))
                if sheet.kind == "continuous":
                    parts.add("Noise", "add-noise", partial(self._add, "noise"))
                optional: tuple[str, ...] = ("u", "offset")
            elif section.title == "The measurement":
                parts.add("Measurement", "add-measurement", partial(self._add, "measurement"))
                optional = ("N", "R", "Rc")
            else:
                optional = ()
            for part in optional:
                if part in sheet.missing_parts:
                    parts.add(parts.PARTS[part], f"add-{part}", partial(self.do, commands.AddPart(part)))  # type: ignore[arg-type]

    def _show_matrices(self) -> None:
        sheet = self.session.sheet
        for name, element in self.grids.items():
            labels: list[Label] = []
            if name in {"F", "Phi"}:
                labels = self._labels("states", sheet.states, sheet.units)
            elif name == "H":
                labels = self._labels("measurements", sheet.measurements, sheet.measurement_units)
            matrix, label = sheet.grids[name], f"{name}, {parts.TITLES[name]}"
            if isinstance(element, Entries):
                element.show(matrix, label)
            else:
                element.show(matrix, label, labels)
            if name in self.names:
                rows = ((),) * len(matrix.rows)
                self.names[name].show(replace(matrix, rows=rows, column_names=(), problem=None), f"{label}: names", labels)
        if self.grids:
            self._times["dt"].show(sheet.dt)
            self._times["t0"].show(sheet.shown(("experiment", "t0")) if "t0" in _experiment(sheet) else _default_t0())

    def _labels(self, key: str, names: tuple[str, ...], units: tuple[str, ...]) -> list[Label]:
        problems = self.session.sheet.problems
        whole, last = problems.get(f"model.{key}", ""), len(names) - 1
        return [
            Label(name, unit, problems.get(f"model.{key}[{i}]", "") or (whole if i == last else ""))
            for i, (name, unit) in enumerate(zip(names, units, strict=True))
        ]

    def _show_equations(self) -> None:
        sheet = self.session.sheet
        self._equations.show(sheet.equations() if self._inside.value == "numbers" else sheet.statement())

    def _show_problems(self) -> None:
        problems = self.session.sheet.problems
        self._problems.props(f"data-count={len(problems)}")
        if self._told == problems:
            return
        self._told = dict(problems)
        self._draw_verdict(len(problems))
        known = {row.name for row in self.session.sheet.constants}
        wanted: list[tuple[str, str, str]] = []
        for where, message in list(problems.items())[:LISTED]:
            name = unknown_name(message)
            wanted.append((where, message, name if name and name not in known else ""))
            known.add(name)
        # What is told still stays the same element: somebody may be pressing it.
        for gone in self._listed.keys() - set(wanted):
            self._listed.pop(gone).delete()
        with self._problem_list:
            for i, each in enumerate(wanted):
                if each not in self._listed:
                    self._listed[each] = self._draw_problem(*each)
                if self._problem_list.default_slot.children[i] is not self._listed[each]:
                    self._listed[each].move(target_index=i)

    def _draw_verdict(self, count: int) -> None:
        self._verdict_icon.set_name("error_outline" if count else "check_circle")
        several = f"{count} to put right:" if count > 1 else "To put right:"
        parts.write(self._verdict, several if count else "The model is complete.")
        parts.write(self._more_problems, f"and {count - LISTED} more" if count > LISTED else "")

    def _draw_problem(self, where: str, message: str, name: str) -> ui.element:
        """A problem as a link to its cell, and a button for the constant that it wants."""
        with ui.element("span").style("display: contents") as element:
            words = f"{where.removeprefix('model.')}: {message}" if where else message
            link = parts.text("button", words).classes("ctl-link").props("type=button")
            link.on("click", partial(self._go_to, where))
            if name:
                parts.add(f"Constant {name}", f"add-constant-{name}", partial(self._add_constant, name))
        return element

    def _add_constant(self, name: str) -> None:
        """A constant that a cell asks for; its value is typed next."""
        if self.do(commands.AddConstant(name)):
            self._constants.enter(f"constants.{name}")
            with self._problems:  # the button itself is gone
                ui.run_javascript("document.activeElement?.select?.()")

    def _go_to(self, where: str) -> None:
        """Put the caret where a problem is."""
        if self._view == "text":
            self._text.run_method("line", line_of(self.session.text, where))
            return
        if where.startswith("cost"):
            self.shell.go("control")
            return
        part = where.removeprefix("model.").partition("[")[0]
        element = self.grids.get(part)
        if isinstance(element, Entries):
            element.enter(where)
        elif element is not None:
            element.run_method("enter", where if where.count("[") else "")
        elif part in self._times:
            self._times[part].run_method("enter", "")
        else:
            self._constants.enter(where)

    # What is typed and pressed ---------------------------------------------------------------------------------------------

    def _typed(self, name: str, key: str, text: str) -> str | Awaitable[str]:
        try:
            command = cell_command(self.session.sheet, name, key, text)
        except (LookupError, ValueError):
            return ""  # the cell is gone by now
        return self.type(f"{name},{key}", command)

    async def _pasted(self, name: str, row: int, column: int, text: str) -> None:
        await self._done(block_command(self.session.sheet, name, row, column, text))

    async def _done(self, command: commands.Command) -> bool:
        """Carry a command out, in a thread where the model is large."""
        return await self.editor.do_later(command) if self.session.large else self.do(command)

    async def _remove(self, what: commands.What, index: int) -> None:
        if await self._done(commands.Remove(what, index)) and what != "noise":
            self._enter_row(what, index)

    async def _add(self, what: commands.What) -> None:
        if await self._done(commands.Add(what)) and what != "noise":
            self._enter_row(what, 10**6)

    def _enter_row(self, what: str, index: int) -> None:
        """Put the caret into the name of a state or measurement, or of the last."""
        name = "H" if what == "measurement" else "F" if "F" in self.grids else "Phi"
        last = len(self.session.sheet.grids[name].rows) - 1
        element = self.names.get(name, self.grids[name])
        element.run_method("nameRow", min(index, last))  # type: ignore[union-attr]  # what has no names there is a grid

    def _time_typed(self, name: str, text: str) -> str | Awaitable[str]:
        return self.type(name, commands.EditCell(("model" if name == "dt" else "experiment", name), text))

    def _set_kind(self, kind: str | None) -> None:
        sheet = self.session.sheet
        if not kind or kind == sheet.kind:
            return
        if self.do(commands.SetKind(kind)):
            self.shell.tell("The matrices are numbers now; Undo brings the expressions back.")
        else:
            self._kind.set_value(sheet.kind or None)

    def _text_typed(self, text: str) -> str | Awaitable[str]:
        found = self.type("text", commands.Rewrite(text))
        return self._text_done(text, found) if isinstance(found, str) else self._text_later(text, found)

    async def _text_later(self, text: str, found: Awaitable[str]) -> str:
        return self._text_done(text, await found)

    def _text_done(self, text: str, why: str) -> str:
        found = re.match(r"line (\d+)", why)
        self._wrong_line = int(found[1]) if found else 0
        self._remember(text if why else "")
        self._show_view()
        if not why:
            self._text.write(self.session.text)
        return why

    def _go_to_line(self) -> None:
        self._text.run_method("line", self._wrong_line)

    # Files and dialogs -------------------------------------------------------------------------------------------------------

    def download(self) -> None:
        """The model file, to be kept elsewhere."""
        ui.download.content(self.session.text, self.session.filename, "application/toml")

    def open(self, text: str, name: str) -> bool:
        """Put another model here."""
        self._remember("")
        self._view = "cells"
        done = self.do(commands.Open(text, name))
        if done:  # what had the focus may be gone
            ui.run_javascript('document.querySelector(".ctl-main").focus({ preventScroll: true })')
        return done

    async def open_later(self, text: str, name: str) -> bool:
        """The same in a thread: a file may be a large one."""
        self._remember("")
        self._view = "cells"
        with self._work:
            done = await self.editor.do_later(commands.Open(text, name))
            if done:
                ui.run_javascript('document.querySelector(".ctl-main").focus({ preventScroll: true })')
        return done

    async def _uploaded(self, event: UploadEventArguments) -> None:
        content = await event.file.read()
        self._uploader.reset()
        try:
            text = decoded(content, event.file.name)
        except ModelFileError as why:
            self.shell.complain(line(why))
            return
        if await self.open_later(text, event.file.name):
            self.shell.tell(f"{event.file.name} is open; Undo brings the model before it back.")

    def _rejected(self) -> None:
        self.shell.complain(f"file: expected a model file (.toml) of at most {LARGEST // 2**20} MB, received another")

    def open_dialog(self) -> None:
        """Ready models, and files."""
        model_dialogs.ready(self.open, self._pick, parts.earlier(self.session))

    def new_dialog(self) -> None:
        """How many of everything."""
        model_dialogs.new(self._begin_new)

    def _begin_new(self, command: commands.New) -> bool:
        self._remember("")
        self._view = "cells"
        done = self.do(command)
        if done:
            first = next(iter(self.grids.values()))
            (first.list if isinstance(first, Entries) else first).run_method("enter", "")
        return done

    def block_dialog(self) -> None:
        """Coloured noise from a transfer function or a spectrum."""
        if self.session.sheet.kind != "continuous":
            self.shell.tell("Coloured noise is a differential equation: of a continuous model only.")
            return
        model_dialogs.block(self.session, self.do)


def _label(session: Session, ahead: int) -> str:
    """What would be taken back (0) or done again (1)."""
    history = session.history
    done = sum(step.done for step in history)
    if ahead:
        return history[done].label if done < len(history) else ""
    return history[done - 1].label if done > 1 else ""


def _notes(session: Session) -> dict[str, Any]:
    found = session.store.draft(session.draft.id)
    return dict(found.notes) if found else {}


def _experiment(sheet: ModelSheet) -> dict[str, Any]:
    found = sheet.data.get("experiment")
    return found if isinstance(found, dict) else {}


def _default_t0() -> Cell:
    from ctlabs.workbench.desk.sheet import Cell

    return Cell(("experiment", "t0"), "0", 0.0)
