"""What a text calls a figure, table, equation, section or reference by, and the number and link that stand in its place.

``{fig:family}`` becomes "Figure 3", ``{tab:table3}`` "Table 4", ``{eq:gain}`` "equation (2)", ``{part:c}`` "part (c)",
``{sec:plan}`` the title of that section, ``{app:checks}`` a table of the appendix, and ``{ref:maybeck, p. 217}`` "[1, p. 217]"; each
is a link. References are numbered in the order in which the text cites them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from ctlabs.reporting.report import Copy, Equation, Heading, Picture, Report, Table, Text
from ctlabs.text import _, fill

_CALLED = re.compile(r"\{(fig|tab|eq|part|sec|app|ref):([^{},]+)(?:, *([^{}]+))?\}")
#: Tables of the appendix, by what a text calls them.
APPENDIX = {"checks": "A1", "chance": "A2", "parameters": "B1", "results": "B2"}
#: An anchor in Markdown, before it is known for which reader.
ANCHOR = re.compile("\ue000([^\ue001]+)\ue001")
#: A part that is folded: before and after its title, at its end.
FOLD, TITLE, END = "\ue002", "\ue003", "\ue004"


def anchor(name: str) -> str:
    """A mark that a link may lead to."""
    return f"\ue000{name}\ue001"


def without_places(text: str) -> str:
    """A sentence that stands outside its report: the references in brackets, which lead nowhere there, are left out.

    >>> without_places("It tends to 2 ({eq:limit}, {fig:transient}).")
    'It tends to 2.'
    """
    return re.sub(rf" \({_CALLED.pattern}(?:, {_CALLED.pattern})*\)", "", text)


@dataclass
class Places:
    """Where everything of a report is; ``cited`` are the references in order, ``missing`` what is not there."""

    report: Report
    cited: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        blocks = self.report.blocks
        self._words = {f"fig:{b.name}": fill(_("Figure {n}"), n=b.number) for b in blocks if isinstance(b, Picture)}
        self._words |= {f"tab:{b.name}": fill(_("Table {n}"), n=b.number) for b in blocks if isinstance(b, Table)}
        self._words |= {
            f"eq:{b.name}": fill(_("equation ({n})"), n=b.number) for b in blocks if isinstance(b, Equation)
        }
        self._words |= {
            f"part:{b.part}": fill(_("part ({letter})"), letter=b.part)
            for b in blocks
            if isinstance(b, Heading) and b.part
        }
        self._words |= {f"sec:{b.name}": b.text for b in blocks if isinstance(b, Heading) and b.name}
        self._words |= {f"app:{name}": fill(_("Table {n}"), n=n) for name, n in APPENDIX.items()}

    def linked(self, text: str) -> str:
        """A text with what it calls replaced by numbers and links."""
        return _CALLED.sub(self._link, text)

    def there(self, places: str) -> str:
        """Of a list of places those that the report has, which may lack some at the corners of its parameters; all where it has none."""
        found = [match[0] for match in _CALLED.finditer(places) if f"{match[1]}:{match[2].strip()}" in self._words]
        return ", ".join(found) or places

    def _link(self, match: re.Match[str]) -> str:
        kind, name, where = match[1], match[2].strip(), match[3]
        if kind == "ref" and name in self.report.bibliography:
            if name not in self.cited:
                self.cited.append(name)
            number = f"{self.cited.index(name) + 1}" + (f", {where}" if where else "")
            return rf"[\[{number}\]](#ref-{name})"
        if f"{kind}:{name}" not in self._words:
            self.missing.append(f"{kind}:{name}")
            return _("(not in this report)")
        return f"[{self._words[f'{kind}:{name}']}](#{kind}-{name})"


def called(report: Report) -> Iterator[str]:
    """What the texts of a report call ("fig:family", "ref:maybeck"), of captions those of other things only."""
    for block in report.blocks:
        own = (
            f"fig:{block.name}"
            if isinstance(block, Picture)
            else f"tab:{block.name}"
            if isinstance(block, Table)
            else ""
        )
        words = (
            block.text
            if isinstance(block, Text | Heading)
            else block.caption
            if isinstance(block, Picture | Table)
            else ""
        )
        yield from (name for match in _CALLED.finditer(words) if (name := f"{match[1]}:{match[2].strip()}") != own)


def complaints(report: Report) -> list[str]:
    """Figures that no text refers to, and references to what is not there."""
    places, found = Places(report), set(called(report))
    for block in report.blocks:
        if isinstance(block, Text):
            places.linked(block.text)
        elif isinstance(block, Picture | Table):
            places.linked(block.caption)
    names = [f"fig:{block.name}" for block in report.blocks if isinstance(block, Picture)]
    unread = [f"{name}: no text refers to this figure" for name in names if name not in found]
    shown = {block.name for block in report.blocks if isinstance(block, Picture)}
    copies = [f"{b.name}: no such figure to copy" for b in report.blocks if isinstance(b, Copy) and b.name not in shown]
    return unread + copies + [f"{name}: no such place in the report" for name in places.missing]
