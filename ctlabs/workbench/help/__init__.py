r"""Context help: what a field is, its equation, unit and example; the algorithms; the figures. No page is needed for it.

>>> help_for("model.Q").unit
'(input unit)²·s'
>>> help_for("model.Q").tooltip
'Strength of the noise, Q: how strong the white noise w is: the height of its flat spectrum, not a variance.'

A page shows the tooltip beside a field, and :attr:`Help.html` in a panel. The texts are the TOML files beside this one, a file for a
group, and the steps of the guided first experiment in ``tour.toml``.
"""

from __future__ import annotations

import difflib
import re
import tomllib
from dataclasses import dataclass
from functools import cache
from html import escape
from pathlib import Path
from typing import Any

from ctlabs.reporting.mathml import mathml


@dataclass(frozen=True, slots=True)
class Help:
    """The help on one thing.

    ``key`` "model.F" · ``title`` · ``what`` it is, in a sentence or two · ``equation`` in LaTeX · ``unit`` ·
    ``example``, what may be typed there · ``note``, what to watch out for · ``source``; empty where there is none ·
    ``able``, ``cost`` of an algorithm: what it can do (see ``algorithm.toml``), and its operations per step
    """

    key: str
    title: str
    what: str
    equation: str = ""
    unit: str = ""
    example: str = ""
    note: str = ""
    source: str = ""
    able: tuple[str, ...] = ()
    cost: str = ""

    @property
    def tooltip(self) -> str:
        """One line: the title and the first sentence."""
        first = re.split(r"(?<=[.?!])\s", self.what, maxsplit=1)[0]
        return f"{self.title}: {first[0].lower() + first[1:] if first[1:2].islower() or first[1:2] == ' ' else first}"

    @property
    def equation_html(self) -> str:
        """The equation as MathML, shown on a line of its own; empty where there is none."""
        return mathml(self.equation, block=True) if self.equation else ""

    @property
    def html(self) -> str:
        """All of it but the title, as HTML."""
        example = f"<code>{escape(self.example)}</code>" if self.example else ""
        told = {"Unit": escape(self.unit), "Example": example, "Note": escape(self.note), "Source": escape(self.source)}
        rows = "".join(f"<dt>{word}</dt><dd>{text}</dd>" for word, text in told.items() if text)
        return f"<p>{escape(self.what)}</p>{self.equation_html}" + (f"<dl>{rows}</dl>" if rows else "")


@dataclass(frozen=True, slots=True)
class Group:
    """The help on one subject: its heading, and its entries by key."""

    heading: str
    entries: dict[str, Help]


def read(name: str) -> dict[str, Any]:
    """A file of texts."""
    return tomllib.loads((Path(__file__).parent / f"{name}.toml").read_text(encoding="utf-8"))


@cache
def groups() -> dict[str, Group]:
    """All help, the groups in the order in which a person meets them."""
    files = {path.stem: read(path.stem) for path in Path(__file__).parent.glob("*.toml")}
    found = {}
    for group in sorted((name for name in files if "order" in files[name]), key=lambda name: files[name]["order"]):
        texts = {name: each for name, each in files[group].items() if isinstance(each, dict)}
        entries = [Help(f"{group}.{name}", **{**each, "able": tuple(each.get("able", ()))}) for name, each in texts.items()]
        found[group] = Group(files[group]["heading"], {each.key: each for each in entries})
    return found


def help_for(key: str) -> Help:
    """The help on a field, algorithm or figure.

    Raises
    ------
    LookupError
        A key that there is no help on.
    """
    group = groups().get(key.partition(".")[0])
    if group is None or key not in group.entries:
        close = difflib.get_close_matches(key, [known for each in groups().values() for known in each.entries], n=1)
        meant = f" (did you mean {close[0]}?)" if close else ""
        msg = f"help: expected a key such as model.F, received {key!r}{meant}"
        raise LookupError(msg)
    return group.entries[key]


def topics(words: str = "") -> dict[str, tuple[Help, ...]]:
    """All help by group, or that in which every one of ``words`` occurs; groups without any are left out."""
    wanted, found = words.lower().split(), {}
    for name, group in groups().items():
        if entries := tuple(each for each in group.entries.values() if _has(each, wanted)):
            found[name] = entries
    return found


def _has(each: Help, wanted: list[str]) -> bool:
    text = f"{each.key} {each.title} {each.what} {each.unit} {each.example} {each.note} {each.source}".lower()
    return all(word in text for word in wanted)
