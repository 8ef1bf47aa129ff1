"""From where a student's own numbers may come: finite sets of nice numbers, which a lab declares beside a parameter.

``R: Positive = given(0.5, unit="m²", meaning="…", draw=span(0.2, 2, 0.1))``: 0.2, 0.3, … 2.0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from decimal import Decimal
from typing import Any, Literal


@dataclass(frozen=True, slots=True)
class Draw:
    """A finite set in a fixed order.

    ``axes`` : the values of each number · ``form`` : whether a member is a number, a list, or a diagonal matrix

    >>> both = each(one_of(1, 2), one_of(5, 6, 7))
    >>> len(both), [both[i] for i in range(len(both))]
    (6, [[1, 5], [1, 6], [1, 7], [2, 5], [2, 6], [2, 7]])
    >>> diagonal(one_of(4), one_of(9))[0]
    [[4, 0], [0, 9]]
    """

    axes: tuple[tuple[Any, ...], ...]
    form: Literal["number", "list", "diagonal"] = "number"

    def __len__(self) -> int:
        """How many members there are."""
        return math.prod(map(len, self.axes))

    def __getitem__(self, index: int) -> Any:
        """The member of this number, 0 … len − 1, as a lab's parameters take it."""
        if not 0 <= index < len(self):
            raise IndexError(index)
        found: list[Any] = []
        for axis in reversed(self.axes):
            index, at = divmod(index, len(axis))
            found.insert(0, axis[at])
        if self.form == "number":
            return found[0]
        if self.form == "list":
            return found
        return [[x if i == j else 0 for j in range(len(found))] for i, x in enumerate(found)]


def span(low: float, high: float, step: float) -> Draw:
    """The numbers from ``low`` to ``high`` in steps that a person would write.

    >>> span(0.1, 0.4, 0.1).axes
    ((0.1, 0.2, 0.3, 0.4),)
    """
    first, last, by = (Decimal(repr(x)) for x in (low, high, step))
    if by <= 0 or last < first:
        msg = f"draw: expected a step > 0 and low <= high, received {low}, {high}, {step}"
        raise ValueError(msg)
    count = int((last - first) / by)
    whole = all(x == x.to_integral_value() for x in (first, by))
    return Draw((tuple((int if whole else float)(first + i * by) for i in range(count + 1)),))


def one_of(*values: Any) -> Draw:
    """These values."""
    return Draw((values,))


def each(*draws: Draw) -> Draw:
    """A list, each number of which has a set of its own."""
    return Draw(tuple(draw.axes[0] for draw in draws), "list")


def diagonal(*draws: Draw) -> Draw:
    """A diagonal matrix, each element of whose diagonal has a set of its own."""
    return Draw(tuple(draw.axes[0] for draw in draws), "diagonal")
