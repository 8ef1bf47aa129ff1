"""Text cells in the browser: a matrix with headers, one field, a slider, a text; ``grid.js`` draws them and says what is typed.

One element for a whole matrix, so that one of 20 × 20 cells is quick, and so that only what has changed travels. Texts go both
ways with a number: an answer that is older than what has been typed since never overwrites it.
"""

from __future__ import annotations

import inspect
from collections.abc import Awaitable, Callable, Sequence
from typing import TYPE_CHECKING, Any

from nicegui import ui

from ctlabs.workbench.pages import STATIC
from ctlabs.workbench.pages.cells import NUMBER, POSITIONS, Label, Shown, Slider, number, shown, typed

if TYPE_CHECKING:
    from nicegui.events import GenericEventArguments

    from ctlabs.workbench.desk.commands import What
    from ctlabs.workbench.desk.sheet import Cell, Grid

#: What is typed: the key of a cell ("0,1" row and column, "name,0", "unit,0" of a header) and the text; the answer is why not, at
#: once or when a large model has been edited.
Typed = Callable[[str, str], str | Awaitable[str]]



#: A text that was refused: what was there before, the text, why.
Refused = tuple[str, str, str]


class CellElement(ui.element, component=STATIC / "grid.js"):
    """What a matrix and a field have in common: texts that are typed, numbered messages, texts that were refused.

    Parameters
    ----------
    on_typed : called with a cell's key and text; its answer is a line why the text is impossible, or empty
    on_done : called when a cell is left
    refused : where the texts that were refused are remembered, if they are to outlive the element

    A text that is impossible stays in its cell with the line, until something else is shown or typed there.
    """

    def __init__(
        self,
        mode: str,
        name: str,
        on_typed: Typed,
        on_done: Callable[[], object] | None = None,
        refused: dict[str, Refused] | None = None,
    ) -> None:
        super().__init__()
        self._typed, self._ack = on_typed, 0
        self._refused = {} if refused is None else refused
        self._last: dict[str, Any] = {}
        with self._props.suspend_updates():
            self._props.update({"mode": mode, "name": name, "rows": [], "rowNames": [], "ack": 0})
        self.on("edit", self._edited)
        if on_done is not None:
            self.on("done", lambda _: on_done())

    def forget(self) -> None:
        """Show no more what was refused."""
        self._refused.clear()

    def _edited(self, event: GenericEventArguments) -> Awaitable[None] | None:
        key, text, number = str(event.args["key"]), str(event.args["text"]), int(event.args["number"])
        before, found = self._known(key), ""  # type: tuple[str, str | Awaitable[str]]
        self._refused.pop(key, None)
        try:
            found = self._typed(key, text)
        finally:
            if isinstance(found, str):
                self._told(number, key, (before, text, found))
        return None if isinstance(found, str) else self._later(found, number, key, before, text)

    async def _later(self, answer: Awaitable[str], number: int, key: str, before: str, text: str) -> None:
        line = ""
        try:
            line = await answer
        finally:
            self._told(number, key, (before, text, line))

    def _told(self, number: int, key: str, refused: tuple[str, str, str]) -> None:
        """Answer message ``number``: why a text is impossible, if it is."""
        if self.is_deleted:
            return
        if refused[2]:
            self._refused[key] = refused
        self._answer(number)

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
            try:
                gone = self._known(key) != before  # the model has another text there by now
            except LookupError:
                gone = True
            if gone:
                del self._refused[key]
            else:
                self._put(now, key, text, line)
        if any(self._props.get(name) != value for name, value in now.items()):
            with self._props.suspend_updates():
                self._props.update(now)
            self.update()

    def _put(self, now: dict[str, Any], key: str, text: str, line: str) -> None:
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


class GridElement(CellElement):
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
        refused: dict[str, Refused] | None = None,
    ) -> None:
        super().__init__("grid", name, on_typed, on_done, refused)
        self._kinds = {"rowKind": row_kind or None, "removeColumn": column_kind or None}
        self.on("remove", lambda event: on_remove(event.args[0], int(event.args[1])))

        async def pasted(event: GenericEventArguments) -> None:
            try:
                done = on_block(int(event.args["row"]), int(event.args["column"]), str(event.args["text"]))
                if inspect.isawaitable(done):
                    await done
            finally:
                self._answer(int(event.args["number"]))

        self.on("block", pasted)

    def show(self, matrix: Grid, label: str, labels: Sequence[Label] = ()) -> None:
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


class TextField(CellElement):
    """One text: of a line, or a whole file (``area``); ``lazy``: said only when it is left or with Enter."""

    def __init__(
        self,
        label: str,
        on_typed: Callable[[str], str | Awaitable[str]],
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


class Range(CellElement):
    """A slider for a number."""

    def __init__(
        self,
        label: str,
        on_moved: Callable[[str], str | Awaitable[str]],
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

    def _moved(self, _key: str, text: str) -> str | Awaitable[str]:
        found = self._on_moved(typed(self._slider.at(round(float(text)))))
        return found if not isinstance(found, str) else ""
