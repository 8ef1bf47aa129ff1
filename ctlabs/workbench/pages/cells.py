"""Cells as texts: numbers as they are read, pasted blocks, the positions of a slider; no page is needed for it."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, NamedTuple

from ctlabs.text import RAISED

if TYPE_CHECKING:
    from ctlabs.workbench.desk.sheet import Cell

#: Positions of a slider, and from which ratio of its ends on it is logarithmic.
POSITIONS, DECADES = 200, 100.0
NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")

#: What is shown of a cell: its text, its value where it is an expression, its problem.
Shown = list[str]


class Label(NamedTuple):
    """What stands beside a row that can be typed into: name, unit, and what is wrong with them."""

    name: str
    unit: str
    problem: str = ""


def number(value: float) -> str:
    """A value as it is read, with six digits.

    >>> number(0.1 + 0.2), number(-1234567.0), number(2.5e-9), number(math.inf)
    ('0.3', '−1.23457·10⁶', '2.5·10⁻⁹', '∞')
    """
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    digits, _, power = f"{value:.6g}".partition("e")
    raised = f"·10{str(int(power)).translate(RAISED)}" if power else ""
    return digits.replace("-", "−") + raised


def shown(cell: Cell) -> Shown:
    """A cell for the browser. A plain number needs no value beside it."""
    plain = NUMBER.fullmatch(cell.text.strip()) is not None
    value = "" if cell.value is None or plain else f"= {number(cell.value)}{' at t1' if cell.varies else ''}"
    found = [cell.text, value, cell.problem or ""]
    while not found[-1] and len(found) > 1:
        found.pop()
    return found


def block(text: str) -> list[list[str]]:
    r"""The cells of a pasted text: rows by lines, columns by tabs; a line's end at the end means nothing.

    >>> block("1\t2*q\r\n0\t\n")
    [['1', '2*q'], ['0', '']]
    """
    return [[cell.strip() for cell in line.split("\t")] for line in text.rstrip("\r\n").splitlines()]


def placed(text: str, row: int, column: int, size: tuple[int, int]) -> dict[tuple[int, int], str]:
    r"""What a pasted block puts into which cells; what goes beyond the matrix is left out, and so are empty cells.

    >>> placed("1\t2\n3\t4", 1, 1, (2, 3))
    {(1, 1): '1', (1, 2): '2'}
    """
    rows, columns = size
    return {
        (row + i, column + j): cell
        for i, line in enumerate(block(text))
        for j, cell in enumerate(line)
        if cell and row + i < rows and column + j < columns
    }


class Slider(NamedTuple):
    """A slider's range: logarithmic where its ends are positive and far apart.

    >>> Slider(1e-4, 1.0).at(100), Slider(0.0, 5.0).at(100), Slider(1e-4, 1.0).position(0.01)
    (0.01, 2.5, 100)
    """

    low: float
    high: float

    @property
    def logarithmic(self) -> bool:
        """Whether equal steps are equal ratios."""
        return self.low > 0 and self.high / self.low >= DECADES

    def at(self, position: int) -> float:
        """The value at a position, with no more digits than the steps are apart; the ends are exact."""
        if position <= 0 or position >= POSITIONS:
            return self.low if position <= 0 else self.high
        share = position / POSITIONS
        if self.logarithmic:
            return float(f"{self.low * (self.high / self.low) ** share:.3g}")
        value = self.low + share * (self.high - self.low)
        digits = 1 - math.floor(math.log10((self.high - self.low) / POSITIONS))
        return float(min(max(round(value, digits), self.low), self.high))

    def position(self, value: float) -> int:
        """The position nearest to a value."""
        value = min(max(value, self.low), self.high)
        if self.logarithmic:
            return round(POSITIONS * math.log(value / self.low) / math.log(self.high / self.low))
        return round(POSITIONS * (value - self.low) / (self.high - self.low))


def slider(low: float | None, high: float | None) -> Slider | None:
    """A slider, if there is a range to move in."""
    if low is None or high is None or not (math.isfinite(low) and math.isfinite(high) and low < high):
        return None
    return Slider(low, high)


def typed(value: float) -> str:
    """A number as it is typed.

    >>> typed(2.0), typed(0.0125), typed(1e-7)
    ('2', '0.0125', '1e-07')
    """
    return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)
