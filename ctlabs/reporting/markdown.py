"""A report as Markdown with LaTeX between dollar signs: for a repository, and for the page that becomes HTML.

The two differ in how they write what Markdown has no sign for: a place that a link leads to, and a part that is folded. Between,
private characters stand for them.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from typing import Literal

from ctlabs.reporting import appendix
from ctlabs.reporting.cells import cell, grid, plain_words, reasons, verdict
from ctlabs.reporting.crossrefs import ANCHOR, END, FOLD, TITLE, Places, anchor
from ctlabs.reporting.report import Check, Copy, Equation, Heading, Picture, Report, Table, Text, Value
from ctlabs.text import _, fill, translated

Reader = Literal["repository", "page"]
#: Instead of the copy of the key figure, where pictures are not shown.
SMALL = "the key figure, small"


def markdown(report: Report, reader: Reader = "repository") -> str:
    """The report as Markdown, with LaTeX between dollar signs."""
    places, failed = Places(report), [check.name for check in report.checks if not check.passed]
    lines = [
        f"# {translated(report.meta['title'])}",
        *([_ways(report)] if reader == "repository" and report.around else []),
        fill(_head(report), source=translated(report.meta["source"]), runs=report.runs, seed=report.seed,
             verdict=verdict(len(report.checks), failed)),
        *([] if report.framed else [_parameters(report)]),
    ]  # fmt: skip
    lines += [places.linked(line) for line in _body(report)]
    if places.cited:
        lines += ["## " + _("References") + anchor("sec-references")]
        lines += [
            "\n".join(f"{i}. {anchor(f'ref-{key}')}{report.bibliography[key]}" for i, key in enumerate(places.cited, 1))
        ]
    lines += appendix.written(report)
    return _for(reader, "\n\n".join(lines) + "\n")


def _body(report: Report) -> Iterable[str]:
    """The blocks in order; of a section's checks one sentence at its end, and its values where they are not in the appendix."""
    pending: list[Value | Check] = []
    places: Counter[str] = Counter()
    for block in [*report.blocks, Heading("", 2)]:
        if isinstance(block, Value | Check):
            pending.append(block)
        elif isinstance(block, Heading):
            if not report.framed:
                yield from _values([each for each in pending if isinstance(each, Value)])
            yield from appendix.sentence([each for each in pending if isinstance(each, Check)])
            pending = []
            if block.text:
                place = f"part-{block.part}" if block.part else f"sec-{block.name}" if block.name else ""
                letter = f"({block.part}) " if block.part else ""
                places[place] += 1
                again = f"-{places[place]}" if places[place] > 1 else ""  # a part that has theory and an experiment
                yield "#" * block.level + f" {letter}{block.text}" + (anchor(place + again) if place else "")
        elif isinstance(block, Text):
            yield block.text
        elif isinstance(block, Equation):
            yield f"{anchor(f'eq-{block.name}')}\n\n$$\n{block.latex} \\tag{{{block.number}}}\n$$"
        elif isinstance(block, Table):
            caption = fill(_("**Table {n}.** {caption}"), n=block.number, caption=block.caption)
            yield anchor(f"tab-{block.name}") + caption
            yield grid(block.columns, ([cell(each) for each in row] for row in block.rows))
        elif isinstance(block, Copy):
            yield from _copy(report, block)
        else:
            yield f"![{plain_words(block.caption)}](figures/{block.name}.png)"
            caption = fill(_("**Figure {n}.** {caption}"), n=block.number, caption=block.caption)
            yield anchor(f"fig-{block.name}") + caption


def _copy(report: Report, copy: Copy) -> Iterable[str]:
    """A small copy of a figure that leads to it."""
    if not any(isinstance(block, Picture) and block.name == copy.name for block in report.blocks):
        return
    yield f"[![{_(SMALL)}](figures/{copy.name}.png)](#fig-{copy.name})"
    yield fill(_("*The key figure is {{fig:{name}}}.*"), name=copy.name).replace("{{", "{").replace("}}", "}")


def _for(reader: Reader, text: str) -> str:
    """The private characters in the words of the reader; a page's come out of the parser as they are."""
    if reader == "page":
        return text
    text = ANCHOR.sub(r'<a id="\1"></a>', text)
    return re.sub(f"{FOLD}(.*?){TITLE}", r"<details><summary>\1</summary>", text).replace(END, "</details>")


def _head(report: Report) -> str:
    """The line below the title: a study without an experiment, or without a check, does not speak of it."""
    if report.runs:
        return _("*{source}.* Experiment: {runs} runs, seed {seed}. Checks: {verdict}.")
    return _("*{source}.* Checks: {verdict}.") if report.checks else "*{source}.*"


def _ways(report: Report) -> str:
    """The links to the report before, to the index, and to the report after."""
    signs = {"previous": "← {title}", "index": "{title}", "next": "{title} →"}
    pairs = (
        (fill(sign, title=report.around[way][1]), report.around[way][0])
        for way, sign in signs.items()
        if way in report.around
    )
    return " · ".join(
        f"[{title}]({address.replace('report.html', 'report.md').replace('index.html', 'README.md')})"
        for title, address in pairs
    )


def _parameters(report: Report) -> str:
    """The parameters by name."""
    values = report.parameters.plain()
    rows = [
        [f"`{name}`", cell(values[name]), translated(unit), translated(meaning)]
        for name, unit, meaning in report.parameters.described()
    ]
    return grid([_("parameter"), _("value"), _("unit"), _("meaning")], rows)


def _values(values: list[Value]) -> Iterable[str]:
    """The values of a section as a small table at its end."""
    if values:
        rows = (
            [f"`{v.name}`", cell(v.value) + (f" ({reason})" if reason else ""), v.unit]
            for v, reason in zip(values, reasons(values), strict=True)
        )
        yield grid([_("result"), _("value"), _("unit")], rows)
