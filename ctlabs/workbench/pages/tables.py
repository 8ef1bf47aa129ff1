"""Tables of a page in HTML: numbers stand below each other by their decimal points, two texts side by side."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from html import escape
from typing import Any

from ctlabs.text import number, printed

#: Texts of so many letters are not broken.
NARROW = 14
#: A number as it is shown: its digits before and behind the point, its power of ten.
_NUMBER = re.compile(r"[−+]?(?:\d+(?:\.(\d+))?(×10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)?|∞)")
_NOTHING = "—"
#: The width of a decimal point, in digits.
_POINT = 0.45


def table(heads: Sequence[str], rows: Sequence[Sequence[Any]], caption: str = "", *, row_heads: bool = True) -> str:
    """A table in HTML; numbers are written for a reader, texts as they are. The last cell of a short row is as wide as the rest.

    A column of numbers stands at the right, its decimal points below each other.
    """
    told = [[shown(value) for value in row] for row in rows]
    first = 1 if row_heads else 0
    places = {j: place for j in range(first, len(heads)) if (place := _places([row[j] for row in told if j < len(row)]))}
    top = "".join(_head(head, right=j in places) for j, head in enumerate(heads))
    body = []
    for row in told:
        cells = []
        for j, text in enumerate(row):
            if j < first:
                cells.append(f'<th scope="row">{escape(text)}</th>')
                continue
            rest = len(heads) - j if j == len(row) - 1 else 1
            wide = f' colspan="{rest}"' if rest > 1 else ""
            cells.append(f"<td{_kind(text, places.get(j))}{wide}>{escape(text)}</td>")
        body.append(f"<tr>{''.join(cells)}</tr>")
    above = f"<caption>{escape(caption)}</caption>" if caption else ""
    return (
        f'<div class="ctl-show-scroll" tabindex="0" role="region" aria-label="{escape(caption or (heads[0] if heads else "Table"))}">'
        f'<table class="ctl-show-table">{above}<thead><tr>{top}</tr></thead><tbody>{"".join(body)}</tbody></table></div>'
    )


def _head(text: str, *, right: bool) -> str:
    return f'<th scope="col"{" class=n" if right else ""}>{escape(text)}</th>' if text else "<td></td>"


def _places(column: Sequence[str]) -> dict[str, float]:
    """How many digits wide each text of a column of numbers is from its decimal point on; nothing where there is anything else."""
    found = {text: _NUMBER.fullmatch(text) for text in column}
    if not any(found.values()) or any(match is None and text not in {_NOTHING, ""} for text, match in found.items()):
        return {}
    behind = {
        text: (len(match[1]) + _POINT if match[1] else 0.0) + 0.8 * len(match[2] or "") if match else 0.0 for text, match in found.items()
    }
    return {text: max(behind.values()) - width for text, width in behind.items()}


def _kind(text: str, places: dict[str, float] | None) -> str:
    if places:
        return f' class="n at" style="--behind: {places[text]:.2f}"'
    return ' class="n"' if len(text) <= NARROW else ""


def matrix(name: str, values: Any, rows: Sequence[str], columns: Sequence[str]) -> str:
    """A matrix as a table with the names of its rows and columns."""
    return table(["", *columns], [[row, *map(float, line)] for row, line in zip(rows, values, strict=True)], name)


def shown(value: Any) -> str:
    """A number or a text for a reader; a complex number without a part that is not there.

    >>> shown(-1.5e-7), shown(-0.15708 - 1.5629j).split(), shown(2j), shown(float("nan")), shown("-x")
    ('−1.5×10⁻⁷', ['−0.15708', '−', '1.5629i'], '2i', '—', '-x')
    """
    if isinstance(value, str):
        return number(value)
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return _NOTHING
    if isinstance(value, complex):
        size = abs(value)
        if abs(value.imag) <= 1e-12 * size:
            return shown(value.real)
        if abs(value.real) <= 1e-12 * size:
            return f"{shown(value.imag)}i"
        return printed(number(value)).replace(" ", "\u00a0")  # its parts stay together
    return printed(number(value))


def difference(lines: Sequence[Any], first: str, second: str) -> str:
    """Two texts side by side in HTML: what only one of them has is marked."""
    rows: list[str] = []
    old: list[str] = []
    new: list[str] = []

    def flush() -> None:
        for i in range(max(len(old), len(new))):
            left = f'<td class="old">{escape(old[i])}</td>' if i < len(old) else "<td></td>"
            right = f'<td class="new">{escape(new[i])}</td>' if i < len(new) else "<td></td>"
            rows.append(f"<tr>{left}{right}</tr>")
        old.clear()
        new.clear()

    for line in lines:
        if line.mark == " ":
            flush()
            rows.append(f"<tr><td>{escape(line.text)}</td><td>{escape(line.text)}</td></tr>")
        else:
            (old if line.mark == "-" else new).append(line.text)
    flush()
    return (
        '<div class="ctl-show-lines" tabindex="0" role="region" aria-label="Difference"><table class="ctl-show-diff">'
        f'<thead><tr><th scope="col">{escape(first)}</th><th scope="col">{escape(second)}</th></tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table></div>"
    )
