"""Text cells in the browser: a matrix with headers, one field, a slider, a text; ``grid.js`` draws them and says what is typed.

One element for a whole matrix, so that one of 20 × 20 cells is quick, and so that only what has changed travels. Texts go both
ways with a number: an answer that is older than what has been typed since never overwrites it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from nicegui import ui

from ctlabs.workbench.pages.cells import NUMBER, POSITIONS, Label, Shown, Slider, number, shown, typed

if TYPE_CHECKING:
    from nicegui.events import GenericEventArguments

    from ctlabs.workbench.commands import What
    from ctlabs.workbench.sheet import Cell
    from ctlabs.workbench.sheet import Grid as Matrix

#: What is typed: the key of a cell ("0,1" row and column, "name,0", "unit,0" of a header) and the text; the answer is why not.
Typed = Callable[[str, str], str]

#: Light and dark by the browser's own colours; the rules about the outline are in the shell's layer, so that they win.
STYLE = """
:root { --bad: #b00020; --field: #fff; --card: #fff; }
body.body--dark { --bad: #ff8a80; --field: #1b1f24; --card: #1d1d1d; }
.ctl-cells { --line: color-mix(in srgb, currentColor 28%, transparent); --soft: color-mix(in srgb, currentColor 62%, transparent);
  max-width: 100%; min-width: 0; }
.ctl-scroll { overflow: auto; max-height: min(72vh, 660px); max-width: 100%; border-radius: 8px; padding: 2px; }
.ctl-grid { border-collapse: separate; border-spacing: 0; }
.ctl-grid th, .ctl-grid td { padding: 2px 3px; vertical-align: top; text-align: left; }
.ctl-grid thead th, .ctl-grid thead td { position: sticky; top: 0; z-index: 2; background: var(--card); }
.ctl-grid th { font-weight: 500; font-size: .8rem; line-height: 1.2rem; color: var(--soft); white-space: nowrap; }
.ctl-grid tbody th { position: sticky; left: 0; z-index: 1; background: var(--card); padding-top: 6px; max-width: 11rem;
  overflow: hidden; text-overflow: ellipsis; padding-right: 8px; }
.ctl-grid tbody th.ctl-editable { padding-top: 2px; }
.ctl-grid thead td.ctl-corner { left: 0; z-index: 3; }
.ctl-colname { display: inline-block; max-width: 7.5rem; overflow: hidden; text-overflow: ellipsis; vertical-align: bottom; }
.ctl-cells input, .ctl-cells textarea { font: .9rem/1.5 ui-monospace, SFMono-Regular, Menlo, Consolas, "Liberation Mono", monospace;
  color: inherit; background: var(--field); border: 1px solid var(--line); border-radius: 5px; padding: 2px 6px; box-sizing: border-box;
  height: 1.9rem; min-width: 0; }
.ctl-grid .ctl-cell { text-align: center; }
.ctl-grid .ctl-zero { color: var(--soft); }
.ctl-cells input:hover { border-color: var(--soft); }
.ctl-cells [aria-invalid=true] { border-color: var(--bad) !important; box-shadow: 0 0 0 1px var(--bad); }
.ctl-cells .ctl-name, .ctl-cells .ctl-unit { border-color: transparent; background: transparent; font-family: inherit;
  width: 7.2rem; display: block; height: 1.55rem; padding: 1px 4px; }
.ctl-cells .ctl-name { font-weight: 600; width: 5.9rem; }
.ctl-cells .ctl-unit { color: var(--soft); font-size: .76rem; height: 1.3rem; }
.ctl-cells .ctl-name:hover, .ctl-cells .ctl-unit:hover, .ctl-cells .ctl-name:focus, .ctl-cells .ctl-unit:focus {
  border-color: var(--line); background: var(--field); }
.ctl-cells .ctl-name { border-bottom: 1px dotted var(--line); border-radius: 5px 5px 0 0; }
.ctl-rowname { display: flex; align-items: center; }
.ctl-x { border: 0; background: none; color: var(--soft); cursor: pointer; font-size: 1rem; line-height: 1; min-width: 1.35rem;
  height: 1.5rem; border-radius: 5px; padding: 0; }
.ctl-x:hover:not(:disabled) { background: color-mix(in srgb, var(--bad) 16%, transparent); color: var(--bad); }
.ctl-x:disabled { opacity: .25; cursor: default; }
.ctl-value { display: block; font-size: .74rem; line-height: 1.1rem; color: var(--soft); text-align: center; white-space: nowrap; }
.ctl-error { color: var(--bad); font-size: .8rem; line-height: 1.2rem; padding: 1px 4px; overflow-wrap: anywhere; white-space: normal; }
.ctl-stick { position: sticky; left: 0; max-width: min(34rem, 82vw); }
.ctl-field { display: flex; align-items: stretch; min-width: 0; }
.ctl-field input { width: 100%; }
.ctl-field > .ctl-suffix { padding: .25rem 0 0 .4rem; color: var(--soft); }
.ctl-cells > label { display: block; font-size: .78rem; color: var(--soft); }
.ctl-cells .ctl-hidden { position: absolute; width: 1px; height: 1px; overflow: hidden; clip-path: inset(50%); }
.ctl-cells > .ctl-value { text-align: left; padding-left: 4px; }
.ctl-cells input[type=range] { border: 0; padding: 0; background: none; width: 100%;
  accent-color: var(--q-primary); height: 1.4rem; margin: 0; }
.ctl-cells .ctl-area { flex: 1; height: auto; min-height: 50vh; border-radius: 0 6px 6px 0; resize: vertical; tab-size: 4; }
.ctl-gutter { margin: 0; overflow: hidden; padding: 2px 6px; /* lines as high as the text's beside them */
  font: .9rem/1.5 ui-monospace, SFMono-Regular, Menlo, Consolas, "Liberation Mono", monospace;
  text-align: right; color: var(--soft); border: 1px solid var(--line); border-right: 0; border-radius: 6px 0 0 6px; box-sizing: border-box;
  contain: size; width: 3.2rem; white-space: pre; }
@media (max-width: 599px) { .ctl-grid tbody th, .ctl-grid thead td.ctl-corner { position: static; } }
@layer theme {
  .ctl-cells input:focus-visible, .ctl-cells textarea:focus-visible { outline-width: 2px !important; outline-offset: 0 !important; }
}
"""


class Cells(ui.element, component="grid.js"):
    """What a matrix and a field have in common: texts that are typed, numbered messages, texts that were refused.

    Parameters
    ----------
    on_typed : called with a cell's key and text; its answer is a line why the text is impossible, or empty
    on_done : called when a cell is left

    A text that is impossible stays in its cell with the line, until something else is shown or typed there.
    """

    def __init__(self, mode: str, name: str, on_typed: Typed, on_done: Callable[[], object] | None = None) -> None:
        super().__init__()
        self._typed, self._ack = on_typed, 0
        self._refused: dict[str, tuple[str, str, str]] = {}
        self._last: dict[str, Any] = {}
        with self._props.suspend_updates():
            self._props.update({"mode": mode, "name": name, "rows": [], "rowNames": [], "ack": 0})
        self.on("edit", self._edited)
        if on_done is not None:
            self.on("done", lambda _: on_done())

    def forget(self) -> None:
        """Show no more what was refused."""
        self._refused.clear()

    def _edited(self, event: GenericEventArguments) -> None:
        key, text = str(event.args["key"]), str(event.args["text"])
        before = self._known(key)
        self._refused.pop(key, None)
        line = ""
        try:
            line = self._typed(key, text)
        finally:
            if line:
                self._refused[key] = (before, text, line)
            self._answer(int(event.args["number"]))

    def _answer(self, number: int) -> None:
        """Show what there is now, up to message ``number``."""
        self._ack = number
        self._send(self._last)

    def _known(self, key: str) -> str:
        """The text of a cell as the model has it."""
        first, _, second = key.partition(",")
        index = int(second or 0)
        if first in {"name", "unit"}:
            return str(self._last.get("rowNames" if first == "name" else "rowUnits", [])[index])
        rows: list[list[Shown]] = self._last.get("rows", [])
        i = int(first)
        return rows[i][index][0] if i < len(rows) and index < len(rows[i]) else ""

    def _send(self, found: dict[str, Any]) -> None:
        """To the browser, if anything is new there."""
        self._last = found
        now = {**found, "ack": self._ack}
        for key, (before, text, line) in list(self._refused.items()):
            if self._known(key) != before:  # the model has another text there by now
                del self._refused[key]
            else:
                _put(now, key, text, line)
        if any(self._props.get(name) != value for name, value in now.items()):
            with self._props.suspend_updates():
                self._props.update(now)
            self.update()


def _put(now: dict[str, Any], key: str, text: str, line: str) -> None:
    """A text that was refused, in a copy of what is shown."""
    first, _, second = key.partition(",")
    index = int(second)
    if first in {"name", "unit"}:
        names = "rowNames" if first == "name" else "rowUnits"
        now[names] = [text if i == index else each for i, each in enumerate(now[names])]
        now["rowProblems"] = [line if i == index else each for i, each in enumerate(now["rowProblems"])]
        return
    i = int(first)
    now["rows"] = [list(row) for row in now["rows"]]
    now["rows"][i][index] = [text, "", line]


class Grid(Cells):
    """A matrix: a table of cells that scrolls inside itself.

    Parameters
    ----------
    on_block : called with row, column and text of a block that is pasted
    on_remove : called with what is removed ("state", "noise", "measurement") and its index
    row_kind : "state" or "measurement", if the names and units of the rows are typed here
    column_kind : "noise", if columns can be removed here
    """

    def __init__(
        self,
        name: str,
        on_typed: Typed,
        *,
        on_block: Callable[[int, int, str], object],
        on_remove: Callable[[What, int], object],
        on_done: Callable[[], object],
        row_kind: str = "",
        column_kind: str = "",
    ) -> None:
        super().__init__("grid", name, on_typed, on_done)
        self._kinds = {"rowKind": row_kind or None, "removeColumn": column_kind or None}
        self.on("remove", lambda event: on_remove(event.args[0], int(event.args[1])))

        def pasted(event: GenericEventArguments) -> None:
            try:
                on_block(int(event.args["row"]), int(event.args["column"]), str(event.args["text"]))
            finally:
                self._answer(int(event.args["number"]))

        self.on("block", pasted)

    def show(self, matrix: Matrix, label: str, labels: Sequence[Label] = ()) -> None:
        """Show a matrix; ``labels`` of its rows where they are typed here."""
        self._send(
            {
                "label": label,
                "rows": [[shown(cell) for cell in row] for row in matrix.rows],
                "rowNames": [each.name for each in labels] or list(matrix.row_names),
                "rowUnits": [each.unit for each in labels] or None,
                "rowProblems": [each.problem for each in labels] or None,
                "columnNames": None if matrix.vector else list(matrix.column_names),
                "problem": matrix.problem or "",
                **self._kinds,
            }
        )


class Field(Cells):
    """One text: of a line, or a whole file (``area``); ``lazy``: said only when it is left or with Enter."""

    def __init__(
        self,
        label: str,
        on_typed: Callable[[str], str],
        on_done: Callable[[], object] | None = None,
        *,
        test: str,
        area: bool = False,
        lazy: bool = False,
        show_label: bool = True,
        placeholder: str = "",
        suffix: str = "",
    ) -> None:
        super().__init__("area" if area else "text", label, lambda _, text: on_typed(text), on_done)
        self._fixed = {
            "label": label,
            "test": test,
            "lazy": lazy,
            "showLabel": show_label,
            "placeholder": placeholder,
            "suffix": suffix,
        }
        self.write("")

    def show(self, cell: Cell) -> None:
        """Show a cell."""
        self._send({"rows": [[shown(cell)]], **self._fixed})

    def show_as(self, cell: Cell | str, test: str, label: str) -> None:
        """Show a cell, or a text, that may be another's than before."""
        self._fixed |= {"test": test, "label": label}
        self.write(cell) if isinstance(cell, str) else self.show(cell)

    def write(self, text: str, problem: str = "") -> None:
        """Show a text that is no cell of the model."""
        self._send({"rows": [[[text, "", problem]]], **self._fixed})


class Range(Cells):
    """A slider for a number."""

    def __init__(
        self,
        label: str,
        on_moved: Callable[[str], object],
        on_done: Callable[[], object] | None = None,
        *,
        test: str,
    ) -> None:
        super().__init__("range", label, self._moved, on_done)
        self._on_moved, self._slider = on_moved, Slider(0.0, 1.0)
        self._send(
            {
                "rows": [[["0"]]],
                "label": label,
                "test": test,
                "limits": [0, POSITIONS, 1],
                "disabled": True,
            }
        )

    def show(self, label: str, chosen: Slider, value: float | None, text: str, unit: str, test: str) -> None:
        """Show the value of a constant; one that is an expression cannot be moved."""
        self._slider = chosen
        movable = value is not None and NUMBER.fullmatch(text.strip()) is not None
        position = chosen.position(value) if value is not None else 0
        told = f"{number(value)} {unit}".strip() if value is not None else "no value"
        hint = "" if movable else "An expression of other constants; type a number to move it here"
        self._send(
            {
                "rows": [[[str(position), told]]],
                "hinted": hint,
                "label": label,
                "test": test,
                "limits": [0, POSITIONS, 1],
                "disabled": not movable,
            }
        )

    def _moved(self, _key: str, text: str) -> str:
        self._on_moved(typed(self._slider.at(round(float(text)))))
        return ""
