"""The weights of a regulator on the page: a field and a slider for each, how it is built, and the whole matrices."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from nicegui import ui

from ctlabs.workbench.desk import commands
from ctlabs.workbench.desk.costing import SetRegulator, Weigh
from ctlabs.workbench.desk.sheet import Cell
from ctlabs.workbench.pages import model_parts as parts
from ctlabs.workbench.pages.cells import Slider, placed, typed
from ctlabs.workbench.pages.grid import GridElement, Range, TextField
from ctlabs.workbench.pages.showing import help_button

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ctlabs.files.modelfile.errors import Path
    from ctlabs.workbench.desk.sheet import ModelSheet
    from ctlabs.workbench.pages.editing import Editor

#: Decades of a slider to each side of where its weight was when it was first shown.
DECADES = 4
#: The matrices that can be typed whole, with what they weigh.
MATRICES = {"Qx": "weight of the states", "Qu": "weight of the inputs", "N": "cross weight of states and inputs"}
KINDS = {"current": "of its own instant", "delayed": "of the instant before"}


class Weight(NamedTuple):
    """One weight: what it weighs in a word and a few, its ``path`` in [cost], its cell, the group it is shown in."""

    name: str
    told: str
    path: Path
    cell: Cell
    group: str


def weights(sheet: ModelSheet) -> Iterator[Weight]:
    """All that may be weighed one by one: states, measurements and named combinations, integrals, inputs."""
    cost = _cost(sheet)
    for i, name in enumerate(sheet.states):
        yield Weight(name, f"state {name}", ("Qx", i, i), _cell(sheet, ("Qx", i, i)), "States")
    outputs, integral = _table(cost, "outputs"), _table(cost, "integral")
    for name in dict.fromkeys((*sheet.measurements, *outputs)):
        inner = ("weight",) if isinstance(outputs.get(name), dict) else ()
        yield Weight(name, f"output {name}", ("outputs", name), _cell(sheet, ("outputs", name, *inner)), "Outputs")
    for name in integral:
        yield Weight(f"∫ {name}", f"integral of {name}", ("integral", name), _cell(sheet, ("integral", name)), "Integrals")
    for j, name in enumerate(sheet.inputs):
        yield Weight(name, f"input {name}", ("Qu", j, j), _cell(sheet, ("Qu", j, j)), "Inputs")


def _cost(sheet: ModelSheet) -> Mapping[str, Any]:
    found = sheet.data.get("cost")
    return found if isinstance(found, dict) else {}


def _table(cost: Mapping[str, Any], key: str) -> dict[str, Any]:
    """A table of weights by name, as far as it is one."""
    found = cost.get(key)
    return dict(found) if isinstance(found, dict) else {}


def _list(cost: Mapping[str, Any], key: str) -> list[str]:
    """A list of names, as far as it is one."""
    found = cost.get(key)
    return [each for each in found if isinstance(each, str)] if isinstance(found, list) else []


def _cell(sheet: ModelSheet, path: Path) -> Cell:
    """A cell of [cost]; one that is not there weighs nothing."""
    found = sheet.shown(("cost", *path))
    if found.text:
        problem = found.problem or sheet.problems.get(f"cost.{path[0]}")
        return Cell(found.path, found.text, found.value, problem)
    return Cell(found.path, "0", 0.0, found.problem)


class WeightList:
    """The list of weights; rows stay where they are, so that nothing is lost that is being typed."""

    def __init__(self, editor: Editor) -> None:
        self.editor = editor
        self.rows: list[WeightRow] = []
        with ui.element("section").classes("ctl-card").props('aria-label="Weights" data-test=weights'):
            with ui.element("div").classes("ctl-bar"):
                parts.text("h2", "Weights")
                help_button("control.weights")
            self._list = ui.element("div").classes("ctl-column").style("width: 100%; gap: .4rem")
            with ui.expansion("Whole matrices").props("dense data-test=matrices").classes("w-full"):
                self._matrices = Matrices(editor)

    def show(self, sheet: ModelSheet) -> None:
        """Show the weights of a model."""
        found = list(weights(sheet))
        if [(row.path, row.name) for row in self.rows] != [(each.path, each.name) for each in found]:
            self._list.clear()
            self.rows, group = [], ""
            with self._list:
                for each in found:
                    if each.group != group:
                        group = each.group
                        parts.text("h3", group)
                    self.rows.append(WeightRow(self.editor, each))
        for row, each in zip(self.rows, found, strict=True):
            row.show(each)
        self._matrices.show(sheet)

    def deviations(self, told: Mapping[tuple[str, str], str]) -> None:
        """Say beside each weight what becomes of what it weighs; by group and name."""
        for row in self.rows:
            parts.write(row.sigma, told.get((row.group, row.name), ""))


class WeightRow:
    """One weight: its name, its field, a logarithmic slider, and the σ that comes of it."""

    def __init__(self, editor: Editor, each: Weight) -> None:
        self.editor, self.path, self.name, self.group = editor, each.path, each.name, each.group
        self.slider = Slider(1.0, 10.0)
        self.test = "-".join(["weight", str(each.path[0]), str(each.path[-1])])
        with ui.element("div").classes("ctl-weight"):
            ui.label(each.name).classes("ctl-weight-name").props("aria-hidden=true")
            self.field = TextField(f"Weight of the {each.told}", self._set, editor.done, test=self.test, show_label=False)
            self.range = Range(each.told, self._set, editor.done, test=f"slider-{self.test}")
            self.sigma = ui.label("").classes("ctl-meaning").props(f"data-test=sigma-{self.test}")

    def show(self, each: Weight) -> None:
        """Show its value."""
        value = each.cell.value
        if value is not None and value > 0 and math.isfinite(value) and not self.slider.low <= value <= self.slider.high:
            middle = round(math.log10(value))
            self.slider = Slider(10.0 ** (middle - DECADES), 10.0 ** (middle + DECADES))
        elif self.slider.high == 10.0:
            self.slider = Slider(10.0**-DECADES, 10.0**DECADES)
        self.field.show_as(each.cell, self.test, f"Weight of the {each.told}")
        text = each.cell.text if value is None else typed(value)  # the slider puts a number in the place of an expression
        self.range.show(f"Weight of the {each.told}, slider", self.slider, value, text, "", f"slider-{self.test}")

    def _set(self, text: str) -> str | Awaitable[str]:
        return self.editor.type(f"cost.{self.path}", Weigh(self.path, text))


class Matrices:
    """Qx, Qu and N as far as the file has them."""

    def __init__(self, editor: Editor) -> None:
        self.editor = editor
        self.grids: dict[str, GridElement] = {}
        self.place = ui.element("div").classes("ctl-column")
        with self.place:
            self.none = ui.label("").classes("ctl-meaning")

    def show(self, sheet: ModelSheet) -> None:
        """Show those of a model."""
        found = {name: grid for name, grid in sheet.weights.items() if name in MATRICES}
        for gone in self.grids.keys() - found.keys():
            self.grids.pop(gone).delete()
        with self.place:
            for name in found.keys() - self.grids.keys():
                self.grids[name] = GridElement(
                    f"cost-{name}", partial(self._typed, name), on_block=partial(self._pasted, name),
                    on_remove=lambda _what, _index: None, on_done=self.editor.done,
                )  # fmt: skip
        for name, grid in found.items():
            self.grids[name].show(grid, f"{name}, {MATRICES[name]}")
        parts.write(self.none, "" if "Qx" in found else "There is no Qx: only outputs are weighed. A weight of a state makes one.")

    def _typed(self, name: str, key: str, text: str) -> str | Awaitable[str]:
        i, j = (int(part) for part in key.split(","))
        path, mirror = (("cost", name, *index) for index in ((i, j), (j, i)))
        sheet = self.editor.session.sheet
        same = name != "N" and i != j and sheet.shown(path).text == sheet.shown(mirror).text
        return self.editor.type(f"cost.{name}.{i}.{j}", commands.EditCells(((path, text), (mirror, text)) if same else ((path, text),)))

    def _pasted(self, name: str, row: int, column: int, text: str) -> str | Awaitable[str]:
        grid = self.editor.session.sheet.weights[name]
        cells = placed(text, row, column, (len(grid.rows), len(grid.rows[0]))).items()
        return self.editor.type("", commands.EditCells(tuple((("cost", name, i, j), cell) for (i, j), cell in cells)))


class RegulatorForm:
    """How the regulator is built."""

    def __init__(self, editor: Editor) -> None:
        self.editor, self.sheet, self.showing = editor, editor.session.sheet, False
        self.boxes: dict[tuple[str, str], ui.checkbox] = {}
        with ui.element("section").classes("ctl-card").props('aria-label="The regulator" data-test=settings'):
            with ui.element("div").classes("ctl-bar"):
                parts.text("h2", "The regulator")
                help_button("control.settings")
            self.kind = ui.select(KINDS, label="An input answers the measurement", on_change=lambda e: self._set("kind", e.value))
            self.kind.props("outlined dense options-dense data-test=control-kind").classes("w-full")
            with ui.element("div").classes("ctl-control-times"):
                self.dt = TextField("Period dt", self._dt, editor.done, test="control-dt", suffix="s")
                self.delay = TextField("Delay", partial(self._typed, "delay"), editor.done, test="control-delay", suffix="s")
                self.horizon = TextField("Horizon (empty: for ever)", partial(self._typed, "horizon"), editor.done, test="control-horizon")
            self.follow = ui.element("div").classes("ctl-column").style("gap: .1rem")
            self.loads = ui.select([], multiple=True, on_change=lambda e: self._listed("loads", e.value))
            self.loads.props('label="Loads (states that no input reaches)"')
            self.loads.props("outlined dense options-dense use-chips data-test=control-loads").classes("w-full")
            self.stabilise = ui.checkbox("Stabilise modes that cost nothing", on_change=lambda e: self._set("stabilise", bool(e.value)))
            self.stabilise.props("dense data-test=control-stabilise")

    def show(self, sheet: ModelSheet) -> None:
        """Show those of a model."""
        self.sheet, cost, self.showing = sheet, _cost(sheet), True
        try:
            self.kind.value = "delayed" if cost.get("kind") == "delayed" else "current"
            self.dt.show(sheet.dt)
            self.delay.show(_cell(sheet, ("delay",)))
            self.horizon.show(sheet.shown(("cost", "horizon")))
            self.delay.set_visibility(sheet.kind == "continuous")
            self._show_boxes(sheet, cost)
            chosen = [name for name in _list(cost, "loads") if name in sheet.states]
            if self.loads.options != list(sheet.states) or self.loads.value != chosen:
                self.loads.set_options(list(sheet.states), value=chosen)
            self.stabilise.value = cost.get("stabilise") is True
        finally:
            self.showing = False

    def _show_boxes(self, sheet: ModelSheet, cost: Mapping[str, Any]) -> None:
        wanted = [(key, name) for name in sheet.measurements for key in ("track", "integral")]
        if list(self.boxes) != wanted:
            self.follow.clear()
            self.boxes = {}
            with self.follow:
                for name in sheet.measurements:
                    with ui.element("div").classes("ctl-control-follow"):
                        for key, words in (("track", f"{name} follows a set point"), ("integral", "integrate its error")):
                            box = ui.checkbox(words, on_change=partial(self._box, key, name)).props(f"dense data-test=control-{key}-{name}")
                            box.props["aria-label"] = words if key == "track" else f"integrate the error of {name}"
                            self.boxes[key, name] = box
        for (key, name), box in self.boxes.items():
            box.value = name in (_list(cost, key) if key == "track" else _table(cost, key))

    def _box(self, key: str, name: str, event: Any) -> None:
        if self.showing:
            return
        if key == "integral":
            self._do(Weigh(("integral", name), "1" if event.value else "0"))
            return
        self._listed("track", [each for each in self.sheet.measurements if self.boxes["track", each].value])

    def _listed(self, key: str, names: list[str]) -> None:
        self._set(key, tuple(names))

    def _set(self, key: str, value: Any) -> None:
        if not self.showing:
            self._do(SetRegulator(key, value))

    def _do(self, command: commands.Command) -> None:
        if not self.editor.do(command):
            self.show(self.editor.session.sheet)

    def _typed(self, key: str, text: str) -> str | Awaitable[str]:
        return self.editor.type(f"cost.{key}", SetRegulator(key, text))

    def _dt(self, text: str) -> str | Awaitable[str]:
        return self.editor.type("dt", commands.EditCell(("model", "dt"), text))
