"""A large matrix on the page: the entries that are not zero as a list, instead of a cell for each."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from nicegui import ui

from ctlabs.workbench.pages import model_parts as parts
from ctlabs.workbench.pages.cells import shown
from ctlabs.workbench.pages.grid import CellElement, TextField, Typed

if TYPE_CHECKING:
    from ctlabs.workbench.desk.sheet import Grid

#: A matrix with more cells is shown by its entries.
CELLS = 25 * 25
#: So many entries are shown at once.
LISTED = 200
_ZERO = re.compile(r"[+-]?0*\.?0*(e[+-]?\d+)?", re.IGNORECASE)


def is_large(matrix: Grid) -> bool:
    """Whether a matrix is shown by its entries.

    >>> from ctlabs.files.modelfile import new
    >>> from ctlabs.workbench.desk.sheet import ModelSheet
    >>> [name for name, matrix in ModelSheet(new(30)).grids.items() if is_large(matrix)]
    ['F', 'P0']
    """
    return len(matrix.rows) * max((len(row) for row in matrix.rows), default=0) > CELLS


def places(matrix: Grid, line: int | None = None, also: frozenset[tuple[int, int]] = frozenset()) -> list[tuple[int, int]]:
    """The entries that are listed: what is not zero, what is wrong, and ``also``; of one ``line`` (row) if it is given.

    >>> from ctlabs.files.modelfile import new
    >>> from ctlabs.workbench.desk.sheet import ModelSheet
    >>> F = ModelSheet(new(30)).grids["F"]
    >>> places(F)[:2], places(F, 28), places(F, 28, frozenset({(28, 3)}))
    ([(0, 1), (1, 2)], [(28, 29)], [(28, 3), (28, 29)])
    """
    chosen = range(len(matrix.rows)) if line is None else (line,)
    return [
        (i, j)
        for i in chosen
        for j, cell in enumerate(matrix.rows[i])
        if cell.text != "0" or cell.problem or (i, j) in also
        if cell.problem or (i, j) in also or not _ZERO.fullmatch(cell.text.strip() or "0")
    ]


class EntryList(CellElement):
    """The entries that are listed, as cells one below the other."""

    def __init__(self, name: str, on_typed: Typed, on_done: Callable[[], object]) -> None:
        super().__init__("entries", name, on_typed, on_done)

    def show(self, matrix: Grid, label: str, listed: list[tuple[int, int]]) -> None:
        """Show these entries."""
        self._send(
            {
                "label": label,
                "rows": [[shown(matrix.rows[i][j])] for i, j in listed],
                "rowNames": [matrix.row_names[i] for i, _ in listed],
                "columnNames": [matrix.column_names[j] for _, j in listed],
                "places": [f"{i},{j}" for i, j in listed],
                "problem": matrix.problem or "",
            }
        )

    def _known(self, key: str) -> str:
        keys = self._last.get("places", [])
        return str(self._last["rows"][keys.index(key)][0][0]) if key in keys else ""

    def _put(self, now: dict[str, object], key: str, text: str, line: str) -> None:
        keys = self._last["places"]
        now["rows"] = [[[text, "", line]] if each == key else row for each, row in zip(keys, self._last["rows"], strict=True)]


class Entries:
    """A large matrix: its list of entries, and a field that adds one or shows a row."""

    def __init__(self, name: str, on_typed: Typed, on_done: Callable[[], object]) -> None:
        self.name = name
        self._matrix: Grid | None = None
        self._line: int | None = None
        self._also: frozenset[tuple[int, int]] = frozenset()
        self._label = ""
        self._told = ui.label("").classes("ctl-meaning")
        self.list = EntryList(name, on_typed, on_done)
        with ui.element("div").classes("ctl-bar"):
            self._wanted = TextField(
                "Row, column", self._go, test=f"entry-{name}", lazy=True, placeholder="3, 17 or a row: 3"
            )
            parts.add("All", f"entries-{name}", partial(self._look, None))

    def show(self, matrix: Grid, label: str) -> None:
        """Show a matrix."""
        self._matrix, self._label = matrix, label
        size = len(matrix.rows), len(matrix.column_names)
        if self._line is not None and self._line >= size[0]:
            self._line = None
        self._also = frozenset((i, j) for i, j in self._also if i < size[0] and j < size[1])
        found = places(matrix, self._line, self._also)
        first = [place for place in found if place in self._also or matrix.rows[place[0]][place[1]].problem]
        listed = sorted({*first[:LISTED], *found[: max(LISTED - len(first), 0)]})
        row = "" if self._line is None else f" in the row {matrix.row_names[self._line]}"
        rest = f"; the first {len(listed)} are shown" if len(listed) < len(found) else ""
        self._told.text = f"{size[0]} × {size[1]}, {len(found)} entries{row} that are not 0{rest}."
        self.list.show(matrix, label, listed)

    def enter(self, path: str) -> None:
        """Put the caret into the entry at a place of the file."""
        found = re.fullmatch(r".*\[(\d+)\]\[(\d+)\]", path)
        if found:
            self._look(None, (int(found[1]), int(found[2])))
        else:
            self.list.run_method("enter", "")

    def _go(self, text: str) -> str:
        """Show the entry or the row that was asked for."""
        if not text.strip() or self._matrix is None:
            return ""
        names = self._matrix.row_names, self._matrix.column_names
        words = [word.strip() for word in re.split(r"[,;]|\s+", text.strip()) if word.strip()]
        found = [_index(word, of) for word, of in zip(words, names, strict=False)]
        if not 1 <= len(words) <= 2 or None in found:
            return f'expected a row and a column (numbers from 1, or names), received "{text.strip()[:40]}"'
        index = [number for number in found if number is not None]
        self._look(index[0] if len(index) == 1 else None, (index[0], index[1]) if len(index) == 2 else None)
        return ""

    def _look(self, line: int | None, place: tuple[int, int] | None = None) -> None:
        if self._matrix is None:
            return
        self._line, self._also = line, self._also | {place} if place else frozenset()
        self.show(self._matrix, self._label)
        if place:
            self.list.run_method("enter", f"model.{self.name}[{place[0]}][{place[1]}]")


def _index(word: str, names: tuple[str, ...]) -> int | None:
    if word in names:
        return names.index(word)
    return int(word) - 1 if word.isdigit() and 1 <= int(word) <= len(names) else None
