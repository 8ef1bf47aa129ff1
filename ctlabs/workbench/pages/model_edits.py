"""What typing, pasting and pausing on the page Model mean; no page is needed for it."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, NamedTuple

from ctlabs.files.modelfile.errors import Path
from ctlabs.workbench.desk import commands
from ctlabs.workbench.pages.cells import placed

if TYPE_CHECKING:
    from ctlabs.workbench.desk.session import Session
    from ctlabs.workbench.desk.sheet import ModelSheet

#: Matrices that are equal to their transpose: what is typed on one side stands on the other too.
SYMMETRIC = ("Q", "Qd", "R", "Rc", "P0")
#: A pause in one cell that makes two edits of it, in seconds.
PAUSE = 2.0
#: Names for new constants.
LETTERS = "abcdfghjlmnpqrsuvwxyz"


class Typing:
    """Commands that are typed: those into one cell, without a long pause, are one edit to undo.

    Parameters
    ----------
    session : which does them
    clock : the time in seconds
    """

    def __init__(self, session: Session, clock: Callable[[], float] = time.monotonic) -> None:
        self._session, self._clock = session, clock
        self._key, self._since, self._number = "", 0.0, -1

    def stop(self) -> None:
        """The cell is left: what is typed there later is another edit."""
        self._key = ""

    def do(self, key: str, command: commands.Command) -> None:
        """Carry out what was typed into cell ``key`` (empty: an edit of its own).

        Raises
        ------
        ValueError
            It is impossible; nothing has changed then.
        """
        now, last = self._clock(), self._session.history[-1]
        going_on = (
            key != "" and key == self._key and now - self._since < PAUSE and last.done and last.number == self._number
        )
        if going_on:
            self._again(command)
        else:
            self._session.do(command)
        last = self._session.history[-1]
        self._key, self._since, self._number = key, now, last.number if last.done else -1

    def _again(self, command: commands.Command) -> None:
        """Put a command in the place of the last one; at once, for between the two the text that was saved would be gone."""
        with self._session.store.together():
            self._session.undo()
            try:
                self._session.do(command)
            except Exception:
                self._session.redo()
                raise


class Section(NamedTuple):
    """A card of matrices: title, the general equation, the parts in their order."""

    title: str
    equation: str
    parts: tuple[str, ...]


def sections(kind: str, given: Iterable[str]) -> tuple[Section, ...]:
    r"""The cards of a model with these matrices.

    >>> [section.title for section in sections("continuous", ("F", "G", "Q", "H", "R", "x0", "P0"))]
    ['The system', 'The measurement', 'The beginning']
    >>> sections("discrete", ("Phi", "Qd", "B", "u", "H", "R", "P0"))[0].equation
    'x_{k+1} = \\Phi x_k + B u_k + w_k'
    """
    has = set(given)
    if kind == "continuous":
        driven = "B u + " if "B" in has else ""
        found = (
            Section("The system", rf"\dot x = F x + {driven}G w", ("F", "G", "Q", "B", "u")),
            Section("The measurement", "z = H x + v", ("H", "R", "Rc", "N")),
        )
    else:
        driven = ("B u_k + " if "B" in has else "") + ("c + " if "offset" in has else "")
        found = (
            Section("The system", rf"x_{{k+1}} = \Phi x_k + {driven}w_k", ("Phi", "Qd", "B", "u", "offset")),
            Section("The measurement", "z_k = H x_k + v_k", ("H", "R", "N")),
        )
    last = Section("The beginning", r"x_0 \sim N(\bar x_0,\ P_0)", ("x0", "P0"))
    return tuple(each._replace(parts=tuple(name for name in each.parts if name in has)) for each in (*found, last))


def cell_command(sheet: ModelSheet, name: str, key: str, text: str) -> commands.Command:
    """What typing into a cell or header of a grid means."""
    first, _, second = key.partition(",")
    if first in {"name", "unit"}:
        i, states = int(second), name in {"F", "Phi"}
        names, units = (sheet.states, sheet.units) if states else (sheet.measurements, sheet.measurement_units)
        label, unit = (text, units[i]) if first == "name" else (names[i], text)
        return commands.Name("state" if states else "measurement", i, label, unit)
    i, j = int(first), int(second)
    matrix = sheet.grids[name]
    if matrix.vector:
        return commands.EditCell(("model", name, i), text)
    path: Path = ("model", name, i, j)
    mirror: Path = ("model", name, j, i)
    if name in SYMMETRIC and i != j and sheet.shown(path).text == sheet.shown(mirror).text:
        return commands.EditCells(((path, text), (mirror, text)))
    return commands.EditCell(path, text)


def block_command(sheet: ModelSheet, name: str, row: int, column: int, text: str) -> commands.EditCells:
    """What pasting a block at a cell means."""
    matrix = sheet.grids[name]
    size = len(matrix.rows), len(matrix.rows[0])
    found = placed(text, row, column, size).items()
    return commands.EditCells(
        tuple((("model", name, i) if matrix.vector else ("model", name, i, j), cell) for (i, j), cell in found)
    )


def unknown_name(message: str) -> str:
    """The name in a message about one that is unknown, if a constant could have it.

    >>> unknown_name('column 3: unknown name "q"; known are r'), unknown_name("division by zero")
    ('q', '')
    """
    found = re.search(r'unknown name "([A-Za-z]\w*)"', message)
    return found[1] if found and found[1] not in {"t", "k", "e", "pi", "inf"} else ""


def line_of(text: str, where: str) -> int:
    r"""The line of a file in which a problem's place begins; 1 where it is not found.

    >>> line_of('kind = "discrete"\n[model]\nPhi = [[1]]\n', "model.Phi[0][0]")
    3
    """
    table, _, rest = where.partition(".")
    key = re.match(r'"[^"]*"|[^.\[]+', rest or table)
    name = key[0].strip('"') if key else ""
    inside = not rest
    for number, line in enumerate(text.splitlines(), start=1):
        heading = re.match(r"\s*\[\s*([A-Za-z_]\w*)\s*\]\s*(#|$)", line)
        if heading:
            inside = heading[1] == table and bool(rest)
        elif inside and re.match(rf"""\s*["']?{re.escape(name)}["']?\s*[.=]""", line):
            return number
    return 1


def free_name(taken: Iterable[str]) -> str:
    """A letter that no constant has, or a numbered one.

    >>> free_name([]), free_name("abcd"), free_name([*LETTERS])
    ('a', 'f', 'a1')
    """
    known = set(taken)
    numbered = (f"{letter}{i}" for i in range(1, 1001) for letter in LETTERS)
    return next(name for name in (*LETTERS, *numbered) if name not in known)
