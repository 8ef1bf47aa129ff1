"""The sheets of the labs: what is given and what is asked, item by item."""

from __future__ import annotations

import re
from dataclasses import dataclass

from ctlabs.labs.catalogue import catalogue, folder

_ITEM = re.compile(r"^- \*\*\((\w+)\)\*\* (.+)$", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Sheet:
    """A lab's sheet: what is given, and what each item asks, by its letter; Markdown with LaTeX between dollar signs."""

    statement: str
    items: dict[str, str]


def sheet(name: str) -> Sheet:
    r"""The sheet of the lab ``name`` (task07, field), from ``tasks/sheets/NAME.md``.

    Raises
    ------
    KeyError
        No lab has this name.

    >>> sheet("task16").items["c"]
    'Carry out experiments for (a) and (b); in particular, estimate the settling time of both.'
    """
    path = folder() / "sheets" / f"{catalogue()[name].name}.md"
    text = path.read_text(encoding="utf-8")
    statement = _ITEM.split(text, maxsplit=1)[0].strip()
    return Sheet(statement, dict(_ITEM.findall(text)))
