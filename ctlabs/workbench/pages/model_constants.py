"""The constants of a model on the page: a list with sliders."""

from __future__ import annotations

from collections.abc import Awaitable
from functools import partial
from typing import TYPE_CHECKING

from nicegui import ui

from ctlabs.workbench.desk import commands
from ctlabs.workbench.pages import model_parts as parts
from ctlabs.workbench.pages.cells import number, slider
from ctlabs.workbench.pages.grid import Range, TextField
from ctlabs.workbench.pages.model_edits import free_name

if TYPE_CHECKING:
    from ctlabs.workbench.desk.sheet import ConstantRow
    from ctlabs.workbench.pages.editing import Editor


class Constants:
    """The list of constants; rows stay where they are, so that nothing is lost that is being typed."""

    def __init__(self, editor: Editor) -> None:
        self.editor = editor
        self.rows: list[ConstantElement] = []
        with ui.element("section").classes("ctl-card").props('aria-label="Constants"'):
            with ui.element("div").classes("ctl-bar"):
                parts.text("h2", "Constants")
                parts.help_button("model.constants")
            self._empty = ui.label(
                "Numbers with a name, for any cell: type q in a cell, and say here what it is."
            ).classes("ctl-meaning")
            self._list = ui.element("div").classes("ctl-column").style("width: 100%; gap: .4rem")
            with ui.element("div").classes("ctl-bar"):
                parts.add("Constant", "add-constant", self._add)

    def show(self, constants: tuple[ConstantRow, ...]) -> None:
        """Show these constants."""
        self._empty.set_visibility(not constants)
        while len(self.rows) > len(constants):
            self.rows.pop().element.delete()
        with self._list:
            while len(self.rows) < len(constants):
                self.rows.append(ConstantElement(self.editor, constants[len(self.rows)]))
        for element, row in zip(self.rows, constants, strict=True):
            element.show(row)

    def enter(self, where: str) -> None:
        """Put the caret into the constant that a problem is with."""
        name = where.removeprefix("constants.").strip('"')
        for element in self.rows:
            if name in {element.row.name, *(f"{element.row.name}.{key}" for key in ("value", "min", "max"))}:
                element.expression.run_method("enter", "")

    def _add(self) -> None:
        name = free_name(row.name for row in self.editor.session.sheet.constants)
        if self.editor.do(commands.AddConstant(name)):
            self.rows[-1].name.run_method("enter", "")


class ConstantElement:
    """One constant: name = expression, a slider where there is a range, and its details when asked for."""

    def __init__(self, editor: Editor, row: ConstantRow) -> None:
        self.editor, self.row = editor, row
        self._details: dict[str, TextField] = {}
        name = row.name
        with ui.element("div").classes("ctl-constant") as self.element:
            with ui.element("div").classes("ctl-line"):
                self.name = TextField("Name", self._rename, test=f"constant-{name}-name", lazy=True, show_label=False)
                ui.label("=").classes("ctl-eq").props("aria-hidden=true")
                self.expression = TextField(
                    f"Value of {name}", self._set, editor.done, test=f"constant-{name}", show_label=False
                )
                self._unit = ui.label("").classes("ctl-unitof")
                self._more = ui.button(icon="tune", on_click=self._open).props(
                    f"flat round dense size=sm data-test=range-{name}"
                )
                self._remove = ui.button(icon="close", on_click=self._delete).props(
                    f"flat round dense size=sm data-test=remove-constant-{name}"
                )
            with ui.element("div").classes("ctl-ends") as self._ends:
                self._low = ui.label("")
                self.slider = Range(name, self._set, test=f"slider-{name}")
                self._high = ui.label("")
            self._meaning = ui.label("").classes("ctl-meaning")
            self._place = ui.element("div").classes("ctl-details")
            self._place.set_visibility(False)

    def show(self, row: ConstantRow) -> None:
        """Show a constant here, the same as before or another."""
        self.row, name = row, row.name
        self.name.show_as(row.name, f"constant-{name}-name", f"Name of constant {name}")
        self.expression.show_as(row.cell, f"constant-{name}", f"Value of {name}")
        parts.write(self._unit, row.unit)
        parts.write(self._meaning, row.meaning)
        self._meaning.set_visibility(bool(row.meaning))
        parts.attributes(self._more, aria_label=f"Range, unit and meaning of {name}", data_test=f"range-{name}")
        parts.attributes(self._remove, aria_label=f"Remove constant {name}", data_test=f"remove-constant-{name}")
        chosen = slider(row.min, row.max)
        self._ends.set_visibility(chosen is not None)
        if chosen is not None:
            self.slider.show(f"{name}, slider", chosen, row.cell.value, row.cell.text, row.unit, f"slider-{name}")
            parts.write(self._low, number(chosen.low))
            parts.write(self._high, number(chosen.high))
        for key, field in self._details.items():
            field.write(self._text(key))

    def _text(self, key: str) -> str:
        return {"min": self.row.min_text, "max": self.row.max_text, "unit": self.row.unit, "meaning": self.row.meaning}[
            key
        ]

    def _open(self) -> None:
        """Show or hide what is told beside the value."""
        if not self._details:
            with self._place:
                for key, label in (("min", "From"), ("max", "To"), ("unit", "Unit"), ("meaning", "Meaning")):
                    if key == "meaning":
                        ui.element("span")
                    self._details[key] = TextField(
                        label, partial(self._tell, key), self.editor.done, test=f"constant-{self.row.name}-{key}"
                    )
        opening = not self._place.visible
        self._place.set_visibility(opening)
        self._more.props(f"aria-expanded={str(opening).lower()}")
        self.show(self.row)
        if opening:
            self._details["min"].run_method("enter", "")

    def _set(self, text: str) -> str | Awaitable[str]:
        return self.editor.type(f"constants.{self.row.name}", commands.EditCell(("constants", self.row.name), text))

    def _rename(self, text: str) -> str | Awaitable[str]:
        return self.editor.type("", commands.RenameConstant(self.row.name, text)) if text.strip() != self.row.name else ""

    def _tell(self, key: str, text: str) -> str | Awaitable[str]:
        command = commands.EditCell(("constants", self.row.name, key), text)
        return self.editor.type(f"constants.{self.row.name}.{key}", command)

    def _delete(self) -> None:
        self.editor.do(commands.RemoveConstant(self.row.name))
