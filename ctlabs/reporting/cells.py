"""Numbers, words and tables as Markdown has them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any

from ctlabs.reporting.report import Value
from ctlabs.text import _, fill, latex_matrix, number, printed

#: Lists longer than this are shown by their first and last elements (results.json holds all).
SHOWN = 12
#: Matrices with more rows or columns than this are shown by their size.
LARGE = 4


def verdict(checks: int, failed: list[str]) -> str:
    """How the checks went, in words."""
    if failed:
        said = _("**{count} of {checks} failed**: {names}")
        return fill(said, count=len(failed), checks=checks, names="; ".join(failed))
    if checks == 1:
        return _("1 passed")
    return fill(_("all {checks} passed"), checks=checks) if checks else _("**no checks**")


def reasons(values: Sequence[Value]) -> list[str]:
    """Why values are missing, a reason that several in succession share only once."""
    before = ["", *(value.reason for value in values)]
    return [_("as above") if own and own == last else own for own, last in zip(before[1:], before, strict=False)]


def grid(columns: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table; columns of numbers are set to the right."""
    heads, *body = [[each.replace("|", "\\|") for each in row] for row in [columns, *rows]]
    numeric = [
        bool(body)
        and heads[i] != _("unit")
        and all(re.match(r"^[−-]?[\d.e+×⁻⁰¹²³⁴-⁹-]+( ± [\d.]+)?$|^[—∞]$", row[i]) for row in body)
        for i in range(len(heads))
    ]
    rule = ["---:" if right else "---" for right in numeric]
    return "\n".join("| " + " | ".join(line) + " |" for line in [heads, rule, *body])


def cell(value: Any) -> str:
    """A number, word, list or matrix in a table: a long list by its ends, a large matrix by its size."""
    if isinstance(value, list | tuple) and value and all(isinstance(row, list | tuple) for row in value):
        widths = {len(row) for row in value}
        flat = all(not isinstance(each, list | tuple) for row in value for each in row)
        if flat and len(widths) == 1 and len(value) <= LARGE and max(widths) <= LARGE:
            return _matrix(value)
        sizes = " × ".join(str(size) for size in _sizes(value))
        return fill(_("{sizes} numbers"), sizes=sizes)
    if isinstance(value, list | tuple) and len(value) > SHOWN:
        return f"{', '.join(printed(number(v)) for v in value[:4])}, …, {printed(number(value[-1]))}"
    if isinstance(value, list | tuple):
        return ", ".join(printed(number(v)) for v in value)
    return printed(number(value))


def _matrix(rows: Sequence[Sequence[Any]]) -> str:
    r"""A matrix in an equation; words, such as units, are set upright, and a single one is no equation.

    >>> _matrix([["m²", "m²/s"], ["1", 0.5]]), _matrix([["m²"]])
    ('$\\begin{bmatrix} \\mathrm{m²} & \\mathrm{m²/s} \\\\ 1 & 0.5 \\end{bmatrix}$', 'm²')
    """
    if len(rows) == len(rows[0]) == 1 and isinstance(rows[0][0], str):
        return printed(number(rows[0][0]))
    return f"${latex_matrix([[_upright(each) for each in row] for row in rows])}$"


def _upright(value: Any) -> Any:
    """A word in an equation; numbers, and "inf" and "-inf" among the words, as they are."""
    word = isinstance(value, str) and number(value) == value and any(letter.isalpha() for letter in value)
    return rf"\mathrm{{{value}}}" if word else value


def _sizes(value: Any) -> list[int]:
    """How many elements in each direction."""
    return [len(value), *_sizes(value[0])] if isinstance(value, list | tuple) and value else []


def plain_words(text: str) -> str:
    r"""Markdown and LaTeX out of a caption, for alternative texts and CSV headers; a reference becomes its kind.

    >>> plain_words("The gain of {eq:filter}, $\\bar K$")
    'The gain of the equation,  K'
    """
    kinds = {"eq": _("the equation"), "fig": _("the figure"), "tab": _("the table")}
    text = re.sub(r"\{(\w+):[^{}]+\}", lambda found: kinds.get(found[1], ""), text)
    text = re.sub(r"\\(?:bar|hat|tilde|mathrm)\b|\*\*|[`$\\{}]", "", text)
    return text.replace("[", "(").replace("]", ")")
