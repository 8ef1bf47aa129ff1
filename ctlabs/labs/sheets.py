"""The sheets of the labs: what is given and asked, the aim, and the control questions; the listings and the books beside them."""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass
from functools import cache

from ctlabs.labs.catalogue import catalogue, folder

_ITEM = re.compile(r"^- \*\*\((\w+)\)\*\* (.+)$", re.MULTILINE)
_HEADING = re.compile(r"^## (.+)$", re.MULTILINE)
_QUESTION = re.compile(r"^\d+\. (.+\?) — (.+)$", re.MULTILINE)
#: What a sheet may hold below its items.
AIM, QUESTIONS = "Aim", "Control questions"


@dataclass(frozen=True, slots=True)
class Sheet:
    """A lab's sheet; Markdown with LaTeX between dollar signs.

    ``statement`` : what is given · ``items`` : what each item asks, by its letter · ``aim`` : what the lab is for ·
    ``questions`` : each control question with the place of its answer in the report
    """

    statement: str
    items: dict[str, str]
    aim: str = ""
    questions: tuple[tuple[str, str], ...] = ()


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
    asked, *more = _HEADING.split(path.read_text(encoding="utf-8"))
    sections = dict(zip(more[::2], (each.strip() for each in more[1::2]), strict=True))
    if unknown := set(sections) - {AIM, QUESTIONS}:
        msg = f"{path.name}: expected headings among {AIM}, {QUESTIONS}, received {', '.join(sorted(unknown))}"
        raise ValueError(msg)
    lines = sections.get(QUESTIONS, "").splitlines()
    questions = tuple(_QUESTION.findall(sections.get(QUESTIONS, "")))
    if len(questions) != len([line for line in lines if line.strip()]):
        msg = f"{path.name}: expected a control question in each line, '1. …? — place of its answer', received {lines}"
        raise ValueError(msg)
    statement = _ITEM.split(asked, maxsplit=1)[0].strip()
    return Sheet(statement, dict(_ITEM.findall(asked)), sections.get(AIM, ""), questions)


def listing(name: str) -> str:
    """The script of the lab ``name`` in public verbs, from ``tasks/listings/NAME.py``."""
    return (folder() / "listings" / f"{name}.py").read_text(encoding="utf-8")


@cache
def bibliography() -> dict[str, str]:
    """All books and papers that the labs refer to, by key, from ``tasks/bibliography.toml``."""
    return dict(tomllib.loads((folder() / "bibliography.toml").read_text(encoding="utf-8")))
