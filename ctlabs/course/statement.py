"""A hand-out: the sheet with a student's own numbers, what is asked, the plan of the experiment to fill in, and the form of answers.

Nothing here has the right answers but for their shapes.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from fractions import Fraction

from ctlabs.course.asked import AskedValue
from ctlabs.course.checking import columns
from ctlabs.course.folder import Course, LabPlace
from ctlabs.course.roster import Student
from ctlabs.labs.catalogue import catalogue
from ctlabs.labs.sheets import sheet
from ctlabs.reporting.cells import cell, grid
from ctlabs.reporting.params import LabParameters
from ctlabs.text import _, fill, latex_number, translated

#: Files of a hand-out.
TEXT, PAGE, PAPER, FORM = "statement.md", "statement.html", "statement.pdf", "answers.toml"
#: What a student decides before the experiment, in the order of the plan.
PLAN = (
    ("What is to be confirmed or refuted", "the items of the sheet, with what theory says, as a number"),
    ("What is varied, and what stays", "factor, its levels"),
    ("Initial state and noises", "distributions; what starts the filter, which may differ"),
    ("Length and number of runs", "steps N, runs M, seed"),
    ("What is recorded at each step", "errors, innovations, variances"),
    ("Statistic and its theoretical value", "mean, RMS, NEES, settling time, …"),
    ("What chance may do", "limits for M runs, and how often they are passed by chance"),
    ("What would speak against the theory", ""),
)
_SIGNS = re.compile(r"([\\`*_{}\[\]<>$|#~^])")


def escaped(words: str) -> str:
    r"""Words of a person inside Markdown.

    >>> print(escaped("A_b <c> $5"))
    A\_b \<c\> \$5
    """
    return _SIGNS.sub(r"\\\1", words)


def title(lab: str) -> str:
    """A lab's number and title."""
    found = catalogue()[lab]
    return f"{_('Lab')} {found.short}. {translated(found.title)}" if found.short.isdigit() else translated(found.title)


def statement(course: Course, student: Student, place: LabPlace, p: LabParameters, asked: tuple[AskedValue, ...]) -> str:
    """The hand-out in Markdown."""
    lab, told = place.lab, sheet(place.lab)
    lines = [f"# {title(lab)}", _head(course, student, place), f"## {_('Statement')}", translated(told.statement)]
    lines += ["\n".join(f"- **({letter})** {translated(words)}" for letter, words in told.items.items())]
    lines += [f"## {_('Your numbers')}", _("Where the statement leaves a number open, yours is:"), numbers(p)]
    lines += [f"## {_('Aim')}", translated(told.aim)] if told.aim else []
    lines += [f"## {_('Part I. Theory')}", _(THEORY), _questions(asked)]
    lines += [f"## {_('Plan of the experiment')}", _("Fill it in before the experiment; without a plan there is none."), _plan()]
    lines += [f"## {_('Part II. Experiment')}", _(EXPERIMENT)]
    lines += [f"## {_('What to hand in')}", fill(_(HAND_IN), form=course.form(student, lab)), columns(lab), _days(place)]
    if told.questions:
        lines += [f"## {_('Control questions')}"]
        lines += ["\n".join(f"{i}. {translated(question)}" for i, (question, _place) in enumerate(told.questions, 1))]
    return "\n\n".join(line for line in lines if line) + "\n"


THEORY = (
    "Derive every item by hand, for letters first and then for your numbers; justify each step. Everything in this table is asked for in "
    "`answers.toml`, to three significant digits or more."
)
EXPERIMENT = (
    "Carry out the plan with your numbers. Draw the true state, the measurements and the estimate with its ±σ band, the errors, and the "
    "variances before and after the measurements; compare what the runs give with what theory says, and say which differences chance "
    "explains."
)
HAND_IN = (
    "The file `answers.toml` of this hand-out, filled in (form {form}); the record of the experiment as a table (CSV); the report: "
    "statement, derivations, plan, results with figures, conclusions, answers to the control questions."
)


def _head(course: Course, student: Student, place: LabPlace) -> str:
    of = (
        fill(_("Variant {letter}, part {part}"), letter=(student.variant or course.variant).upper(), part=str(place.part))
        + (f", {_('control lab')}" if place.control else "")
    )  # fmt: skip
    words = course.words
    facts = [student.name, student.group, of, fill(_("form {form}"), form=course.form(student, place.lab))]
    school = [words.get(key, "") for key in ("university", "faculty", "department")]
    course_line = [course.title, course.term, fill(_("teacher: {name}"), name=words["teacher"]) if words.get("teacher") else ""]
    return "  \n".join(" · ".join(escaped(word) for word in line if word) for line in (facts, course_line, school) if any(line))


def numbers(p: LabParameters) -> str:
    """A lab's parameters as a table, exactly."""
    values, symbols = p.plain(), type(p).symbols()
    rows = [
        [f"${symbols[name]}$", exactly(values[name]), "" if unit == "1" else translated(unit), translated(meaning)]
        for name, unit, meaning in p.described()
        if values[name] is not None and not isinstance(values[name], bool)
    ]
    return grid([_("symbol"), _("value"), _("unit"), _("meaning")], rows)


def exactly(value: object) -> str:
    r"""A number with all digits that it was given with, as a fraction of π where it is one.

    >>> exactly(0.35), exactly(math.pi / 3), exactly(506250000.0), exactly([1, 2.5])
    ('0.35', '$\\pi/3$', '$506250000$', '1, 2.5')
    """
    if isinstance(value, list) and not any(isinstance(each, list) for each in value):
        return ", ".join(map(exactly, value))
    if isinstance(value, bool) or not isinstance(value, int | float):
        return cell(value)
    part = Fraction(value / math.pi).limit_denominator(72)
    if part and isinstance(value, float) and math.isclose(float(part) * math.pi, value, rel_tol=1e-14):
        over = "" if part.denominator == 1 else f"/{part.denominator}"
        return rf"${'' if part.numerator == 1 else part.numerator}\pi{over}$"
    if abs(value) >= 1e4 and float(value).is_integer() and abs(value) < 1e9:
        return f"${int(value)}$"
    short = float(f"{value:g}") == value and (1e-4 <= abs(value) < 1e4 or not value)
    return f"{value:g}" if short else f"${latex_number(value, 12)}$"


def _questions(asked: tuple[AskedValue, ...]) -> str:
    units = ("" if each.unit == "1" else translated(each.unit) for each in asked)
    rows = [
        [f"({each.item})", f"${each.symbol}$", translated(each.meaning), unit, f"`{each.name}`"]
        for each, unit in zip(asked, units, strict=True)
    ]
    return grid([_("item"), _("symbol"), _("what is asked"), _("unit"), _("name in answers.toml")], rows)


def _plan() -> str:
    rows = [[f"**{_(what)}**" + (f" ({_(hint)})" if hint else ""), "\xa0" * 60] for what, hint in PLAN]
    return grid([_("decision"), _("yours")], rows)


def _days(place: LabPlace) -> str:
    days = [
        fill(_("**{what}: by {day}**"), what=_(what), day=day.isoformat())
        for what, day in (("theory part", place.theory), ("report", place.report)) if day
    ]  # fmt: skip
    return ", ".join(days)


def form(course: Course, student: Student, lab: str, asked: tuple[AskedValue, ...]) -> str:
    """The file ``answers.toml``, empty: every value with its symbol, unit, and an example of the form."""
    return "\n".join([*_form(course, student, lab), *(line for each in asked for line in _entry(each))]) + "\n"


def _form(course: Course, student: Student, lab: str) -> Iterator[str]:
    yield f"# {title(lab)}: answers of {student.name}"
    yield "#"
    yield "# Write each answer between the quotation marks, with its unit: three significant digits or more."
    yield "# Decimal point or comma, powers as 1.2e-3, fractions and expressions such as sqrt(2)/3 are all read; lists as 1.1, 1.2, 1.3,"
    yield "# matrices by rows. A line that begins with # explains. What you leave empty counts as not answered."
    yield ""
    for name, value in (
        ("course", course.title), ("term", course.term), ("student", student.id), ("lab", lab), ("form", course.form(student, lab)),
    ):  # fmt: skip
        yield f'{name} = "{_plain(value)}"'
    yield "# The day on which you hand it in, as 2026-10-01:"
    yield 'date = ""'


def _entry(each: AskedValue) -> Iterator[str]:
    yield ""
    yield f"# ({each.item}) {each.symbol} — {each.meaning}"
    unit = "a pure number" if each.unit == "1" else "every element in its unit of SI" if each.unit == "SI" else f"unit: {each.unit}"
    yield f"#     {shape(each)}; {unit}; for example: {each.name} = {example(each)}"
    yield f'{each.name} = ""'


def shape(asked: AskedValue) -> str:
    """What form an answer has, in words.

    >>> import numpy as np
    >>> shape(AskedValue("P", "a", "P", "", "1", np.zeros((3, 2, 2)), 0, 0, {}))
    '3 matrices of 2 × 2'
    """
    sizes, whole = asked.value.shape, not asked.relative
    if not sizes:
        return "a whole number" if whole else "a number"
    if len(sizes) == 1:
        return f"a list of {sizes[0]} {'whole ' * whole}numbers"
    if len(sizes) == 2:
        return f"{sizes[0]} rows of {sizes[1]} numbers"
    return f"{sizes[0]} matrices of {sizes[1]} × {sizes[2]}"


def example(asked: AskedValue) -> str:
    """An answer of the right form, with numbers that mean nothing."""
    sizes, unit = asked.value.shape, "" if asked.unit in {"1", "SI"} or "," in asked.unit else f" {asked.unit}"
    if not sizes:
        return f'"12{unit}"' if not asked.relative else f'"1.23{unit}"'

    def block(sizes: tuple[int, ...], begin: int = 1) -> str:
        if len(sizes) == 1:
            numbers = [str(begin + i) if not asked.relative else f"{begin + i}.{i + 1}" for i in range(sizes[0])]
            return f"[{', '.join(numbers)}]" if sizes[0] <= 4 else f"[{', '.join(numbers[:3])}, …]"
        inner = [block(sizes[1:], begin + i) for i in range(sizes[0])]
        return f"[{', '.join(inner)}]" if len(inner) <= 3 else f"[{', '.join(inner[:2])}, …]"

    return f'"{block(sizes)}"'


def _plain(value: str) -> str:
    return value.replace("\\", "\\\\").replace('"', '\\"')
