r"""A bank of questions in Moodle's XML: one for each value of a lab and each of N variants of its numbers.

A question is of the kind *Embedded answers (Cloze)*, with a gap ``{1:NUMERICAL:=0.523:0.0026~%50%0.411:0.0021#…}`` for each element:
right within the tolerance of the key, half for a known confusion, which its feedback names. In a gap ``} ~ # " &`` and ``\`` are written
as entities, which Moodle turns back; in the text of a question ``{`` before a number would begin a gap, and is an entity too. LaTeX
stands in ``\( \)``, as Moodle's filter MathJax takes it.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np

from ctlabs.course.asked import AskedValue
from ctlabs.course.convention import confused
from ctlabs.course.folder import Course, LabPlace
from ctlabs.course.roster import Student
from ctlabs.course.variants import Drawn, drawn
from ctlabs.files import whole
from ctlabs.labs.catalogue import catalogue
from ctlabs.labs.sheets import sheet
from ctlabs.reporting.params import LabParameters
from ctlabs.text import latex

#: Most gaps of a question; of longer lists and matrices the first elements are asked.
GAPS = 12
#: Digits of the answers and tolerances.
DIGITS = 10
_ENTITIES = {
    "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "{": "&#123;", "}": "&#125;", "~": "&#126;", "#": "&#35;", "\\": "&#92;",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class BankQuestion:
    """A question of the bank: ``name``, its place ``category``, the ``text`` in HTML with its gaps, and a stable ``number``."""

    name: str
    category: str
    text: str
    number: str


def bank(course: Course, labs: Sequence[str], variants: int) -> Iterator[BankQuestion]:
    """The questions on some labs, each in ``variants`` variants of its numbers."""
    for lab in labs:
        each = [list(_questions(course, lab, variant, one)) for variant, one in enumerate(several(course, lab, variants), 1)]
        for same in zip(*each, strict=True):  # the variants of a value, which are one category
            yield from same


def several(course: Course, lab: str, count: int) -> list[Drawn]:
    """Variants of a lab's numbers, which are those of no student but by chance.

    Raises
    ------
    ValueError
        The lab has no sets to draw from, or they hold too few problems.
    """
    nobody = tuple(Student(f"moodle-{i + 1}", f"variant {i + 1}") for i in range(count))
    variants = {"a": (LabPlace(lab, control=False, part=1),)}
    return list(drawn(Course(course.folder, course.title, course.term, course.secret, "a", nobody, variants), lab).values())


def _questions(course: Course, lab: str, variant: int, each: Drawn) -> Iterator[BankQuestion]:
    title, asked = catalogue()[lab].title, sheet(lab)
    head = f"<p>{prose(asked.statement)}</p>\n{given(each.parameters)}"
    for value in each.answers:
        item = asked.items.get(value.item, "")
        task = f"<p><b>({value.item})</b> {prose(item)}</p>\n" if item else ""
        wanted = f"<p>\\({value.symbol}\\), {prose(value.meaning)}{_unit(value.unit)}, to three significant digits:</p>\n{gaps(value)}"
        name = f"{lab} ({value.item}) {value.name}, variant {variant}"
        parts = (course.title, f"Lab {catalogue()[lab].short}. {title}", value.name)
        category = "/".join(["$course$/top", *(part.replace("/", "//") for part in parts)])
        yield BankQuestion(name, category, head + task + wanted, f"{lab}-{value.name}-{variant}")


def given(p: LabParameters) -> str:
    """A table of a student's numbers."""
    rows = []
    for name, info in type(p).model_fields.items():
        told = info.json_schema_extra if isinstance(info.json_schema_extra, dict) else {}
        unit = str(told.get("unit", ""))
        shown = latex(getattr(p, name))
        rows.append(f"<tr><td>{prose(info.description or name)}</td><td>\\({shown}\\){_unit(unit).replace(', in', '')}</td></tr>")
    return "<table>\n" + "\n".join(rows) + "\n</table>\n"


def _unit(unit: str) -> str:
    return "" if unit in ("", "1") else ", in units of SI" if unit == "SI" else f", in {escape(unit)}"


def prose(text: str) -> str:
    r"""A text of a sheet, Markdown with LaTeX in dollars, as HTML that holds no gap.

    >>> prose("the gain $K_{1}$ is **not** {1:NUMERICAL:=5} < 1")
    'the gain \\(K_{1}\\) is <b>not</b> &#123;1:NUMERICAL:=5} &lt; 1'
    """
    plain = escape(text, quote=False)
    plain = re.sub(r"\$\$(.+?)\$\$", r"\\[\1\\]", plain, flags=re.DOTALL)
    plain = re.sub(r"\$(.+?)\$", r"\\(\1\\)", plain, flags=re.DOTALL)
    plain = re.sub(r"\*\*(.+?)\*\*", r"<b>\1</b>", plain)
    plain = re.sub(r"\n\s*\n", "</p>\n<p>", plain)
    return re.sub(r"\{(?=#?\d*(?::|#|\}))(?!\d*\})|\{(?=#\d)", "&#123;", plain)


def gaps(value: AskedValue) -> str:
    """The gaps of a value: one for a number, a row for a list, a table for a matrix."""
    flat, count = np.ravel(value.value), min(value.value.size, GAPS)
    others = {name: np.ravel(other) for name, other in confused(value).items() if other.shape == value.value.shape}
    made = [gap(value, at, {name: float(other[at]) for name, other in others.items()}) for at in range(count)]
    if value.value.ndim == 0:
        return f"<p>{made[0]}</p>"
    wide = value.value.shape[-1] if value.value.ndim > 1 else count
    rows = [made[at : at + wide] for at in range(0, len(made), wide)]
    body = "\n".join("<tr>" + "".join(f"<td>{each}</td>" for each in row) + "</tr>" for row in rows)
    cut = f"<p>(The first {count} of {flat.size} elements.)</p>" if count < flat.size else ""
    return f"<table>\n{body}\n</table>{cut}"


def gap(value: AskedValue, at: int, others: dict[str, float]) -> str:
    """One gap: the right number, and known confusions that no right number can be."""
    right = float(np.ravel(value.value)[at])
    allowed = value.relative * abs(right) + value.absolute
    parts = [f"={_number(right)}:{_number(allowed)}"]
    taken = [(right, allowed)]
    for name, other in {**others, "the sign": -right}.items():
        own = value.relative * abs(other) + value.absolute
        if value.relative and np.isfinite(other) and all(abs(other - x) > own + tolerance for x, tolerance in taken):
            words = "right but for the sign" if name == "the sign" else f"another convention: {name}"
            parts.append(f"%50%{_number(other)}:{_number(own)}#{entities(words)}")
            taken.append((other, own))
    return "{1:NUMERICAL:" + "~".join(parts) + "}"


def entities(words: str) -> str:
    """Words inside a gap."""
    return "".join(_ENTITIES.get(sign, sign) for sign in words)


def _number(value: float) -> str:
    return f"{value:.{DIGITS}g}"


def xml(questions: Sequence[BankQuestion]) -> str:
    """The bank as Moodle imports it: *Question bank → Import → Moodle XML format*."""
    found, category = ['<?xml version="1.0" encoding="UTF-8"?>', "<quiz>"], ""
    for each in questions:
        if each.category != category:
            category = each.category
            found.append(f'<question type="category"><category><text>{escape(category)}</text></category></question>')
        found.append(
            f'<question type="cloze"><name><text>{escape(each.name)}</text></name>'
            f'<questiontext format="html"><text>{cdata(each.text)}</text></questiontext>'
            f'<generalfeedback format="html"><text></text></generalfeedback><penalty>0.3333333</penalty><hidden>0</hidden>'
            f"<idnumber>{escape(each.number)}</idnumber></question>"
        )
    return "\n".join([*found, "</quiz>", ""])


def cdata(text: str) -> str:
    """A text that no sign of XML ends.

    >>> cdata("a]]>b")
    '<![CDATA[a]]]]><![CDATA[>b]]>'
    """
    return "<![CDATA[" + text.replace("]]>", "]]]]><![CDATA[>") + "]]>"


def table(course: Course, labs: Sequence[str], variants: int) -> str:
    """The same numbers as a table: a row for each element of each value of each variant."""
    made = io.StringIO()
    out = csv.writer(made, lineterminator="\n")
    out.writerow(["lab", "variant", "item", "value", "place", "right", "allowed", "unit", "meaning"])
    for lab in labs:
        for variant, each in enumerate(several(course, lab, variants), 1):
            for value in each.answers:
                elements = zip(np.ndindex(value.value.shape), np.ravel(value.value), np.ravel(value.allowed), strict=True)
                for place, right, allowed in elements:
                    where = " ".join(str(i + 1) for i in place)
                    told = [_number(float(right)), _number(float(allowed)), value.unit, value.meaning]
                    out.writerow([lab, variant, value.item, value.name, where, *told])
    return made.getvalue()


def write(path: Path, text: str) -> None:
    """A file, whole or not at all."""
    whole.write(path, text.encode())
