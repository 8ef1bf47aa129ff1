r"""One entry of the help, and how its equation becomes MathML."""

from __future__ import annotations

import re
from dataclasses import dataclass
from html import escape

from ctlabs.reporting.mathml import mathml


@dataclass(frozen=True, slots=True)
class Help:
    """The help on one thing.

    ``key`` "model.F" · ``title`` · ``what`` it is, in a sentence or two · ``equation`` in LaTeX · ``unit`` ·
    ``example``, what may be typed there · ``note``, what to watch out for · ``source``; empty where there is none
    """

    key: str
    title: str
    what: str
    equation: str = ""
    unit: str = ""
    example: str = ""
    note: str = ""
    source: str = ""

    @property
    def group(self) -> str:
        """The part before the dot."""
        return self.key.partition(".")[0]

    @property
    def name(self) -> str:
        """The part after the dot: "F", "joseph"."""
        return self.key.partition(".")[2]

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
        parts = [f"<p>{escape(self.what)}</p>", self.equation_html]
        rows = [
            (word, f"<code>{escape(text)}</code>" if word == "Example" else escape(text))
            for word, text in (
                ("Unit", self.unit),
                ("Example", self.example),
                ("Note", self.note),
                ("Source", self.source),
            )
            if text
        ]
        if rows:
            parts.append("<dl>" + "".join(f"<dt>{word}</dt><dd>{text}</dd>" for word, text in rows) + "</dl>")
        return "".join(parts)
