"""What a grading run writes: tables for other programs, a page for each student and one for the teacher."""

from __future__ import annotations

import csv
import io
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ctlabs.course import reading, submissions
from ctlabs.course.folder import ROSTER, Course
from ctlabs.course.grades import GRADES, Graded
from ctlabs.course.grading import LabResult
from ctlabs.course.marking import Kind, ValueMark
from ctlabs.course.roster import Student
from ctlabs.files import datafile
from ctlabs.labs.catalogue import catalogue
from ctlabs.reporting.mathml import STYLE, mathml
from ctlabs.text import number, printed

#: Columns of a roster by which Moodle knows a person, with their names in its tables.
MOODLE = {
    "id_number": "ID number", "idnumber": "ID number", "username": "Username", "login": "Username",
    "email": "Email address", "e_mail": "Email address", "email_address": "Email address",
}  # fmt: skip
#: The table of the grades, and its columns behind those of the labs.
TABLE, PLAIN = "grades.csv", ("labs done", "control parts failed", "mark", "grade", "like another's", "remarks")
#: How many items are called the hardest.
HARDEST = 12
_LOOKS = {Kind.RIGHT: "good", Kind.WRONG: "bad", Kind.UNREADABLE: "bad", Kind.NONE: "note"}


def files(graded: Graded) -> dict[str, str]:
    """Every file of a grading run by its name in the folder of the grades."""
    course = graded.course
    found = {
        TABLE: "\ufeff" + _table(_grades(graded)),
        "moodle.csv": _table(_moodle(graded)),
        "copies.csv": "\ufeff" + _table(_copies(graded)),
        "problems.txt": "".join(f"{each}\n" for each in graded.problems),
        "course.html": _page("course.html", **_overview(graded)),
    }
    for student in course.students:
        found[f"feedback/{student.id}.html"] = _page(
            "feedback.html", course=course, student=student, places=course.labs(student), titles=_titles(),
            results=graded.results[student.id], total=graded.totals[student.id],
        )  # fmt: skip
    return found


# Tables ------------------------------------------------------------------------------------------------------------------


def _table(rows: Iterable[Sequence[object]]) -> str:
    made = io.StringIO()
    csv.writer(made, lineterminator="\n").writerows([_cell(cell) for cell in row] for row in rows)
    return made.getvalue()


def _cell(value: object) -> object:
    """A cell that no spreadsheet takes for a formula."""
    if isinstance(value, str) and value[:1] in ("=", "+", "-", "@", "\t", "\r"):
        return f"'{value}"
    return "" if value is None else f"{value:.6g}" if isinstance(value, float) else value


def _grades(graded: Graded) -> Iterable[Sequence[object]]:
    """A row for each student: the share of each lab, what is done, the mark."""
    labs, course = graded.course.all_labs(), graded.course
    yield ["name", "group", "variant", *labs, *PLAIN]
    like = Counter(each.student for each in graded.copies)
    for student in course.students:
        own, total = graded.results[student.id], graded.totals[student.id]
        remarks = "; ".join(f"{lab}: {note}" for lab, result in own.items() for note in result.notes)
        yield [
            student.name, student.group, student.variant or course.variant, *(_share(own.get(lab)) for lab in labs),
            total.done, " ".join(map(str, total.failed)), total.mark, total.grade, like[student.id] or None, remarks,
        ]  # fmt: skip


def _share(result: LabResult | None) -> float | None:
    return None if result is None or not result.source else round(result.points, 4)


def _moodle(graded: Graded) -> Iterable[Sequence[object]]:
    """The columns that Moodle's import of grades takes: by which it knows a person, then the points of each lab, 0 to 100."""
    labs, known = graded.course.all_labs(), contacts(graded.course)
    keys = sorted({key for row in known.values() for key in row})
    titles = _titles()
    yield ["Full name", *keys, *(f"Lab {_short(lab)}. {titles[lab]}" for lab in labs), "Labs done", "Mark"]
    for student in graded.course.students:
        own, total = graded.results[student.id], graded.totals[student.id]
        shares = [_share(own.get(lab)) for lab in labs]
        points = [None if share is None else round(100 * share, 2) for share in shares]
        row = known.get(student.id, {})
        yield [student.name, *(row.get(key, "") for key in keys), *points, total.done, total.mark]


def contacts(course: Course) -> dict[str, dict[str, str]]:
    """By which Moodle knows the students, from further columns of the roster: e-mail address, ID number, user name."""
    path = course.folder / ROSTER
    text = datafile.text(path.read_bytes(), ROSTER, [each.name for each in course.students])
    lines = {each.line: each for each in course.students}
    found: dict[str, dict[str, str]] = {}
    for line, row in submissions.rows(text):
        if line in lines:
            own = {MOODLE[key]: cell.strip() for key, cell in row.items() if key in MOODLE and cell and cell.strip()}
            found[lines[line].id] = own
    return found


def _copies(graded: Graded) -> Iterable[Sequence[object]]:
    names = {each.id: each.name for each in graded.course.students}
    yield ["lab", "student", "like", "values", "chance", "what"]
    for each in graded.copies:
        yield [each.lab, names[each.student], names[each.other], len(each.values), each.chance, each.why]


def kept_grades(course: Course) -> list[dict[str, str]]:
    """The rows of ``grades.csv`` as the last grading run left it, by the heads of their columns; none where there was no run.

    Raises
    ------
    ValueError
        The table is another than a grading run writes.
    """
    path = course.folder / GRADES / TABLE
    try:
        rows = list(csv.DictReader(io.StringIO(path.read_text(encoding="utf-8-sig"))))
    except FileNotFoundError:
        return []
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"{TABLE}: expected the table of a grading run, received: {error}") from None
    wanted = {"name", "group", *PLAIN}
    if not all(wanted <= {key for key, cell in row.items() if isinstance(cell, str)} for row in rows):
        raise ValueError(f"{TABLE}: expected the columns {', '.join(sorted(wanted))} with commas between, received others: grade again")
    return rows


# Pages -------------------------------------------------------------------------------------------------------------------


def _overview(graded: Graded) -> dict[str, Any]:
    """What the teacher's page shows."""
    course, labs = graded.course, graded.course.all_labs()
    results = [result for own in graded.results.values() for result in own.values()]
    counted = [each for each in results if each.source]
    cells = {each.id: {lab: _matrix_cell(course, each, lab, graded.results[each.id].get(lab)) for lab in labs} for each in course.students}
    totals = graded.totals.values()
    grades = Counter(each.grade for each in totals) if any(each.grade for each in totals) else None
    marks = [(f"grade {grade}", grades[grade]) for grade in (5, 4, 3, 2)] if grades else _steps([each.mark for each in totals])
    return {
        "course": course, "labs": labs, "titles": _titles(), "names": {each.id: each.name for each in course.students},
        "handed": len(results), "expected": sum(len(course.labs(each)) for each in course.students),
        "done": sum(each.done for each in results), "cells": cells, "totals": graded.totals, "graded": bool(grades),
        "marks": marks, "most": max([count for _, count in marks] + [1]), "means": _means(counted, labs),
        "hardest": _hardest(counted), "mistakes": _mistakes(counted), "copies": graded.copies, "problems": graded.problems,
    }  # fmt: skip


def _matrix_cell(course: Course, student: Student, lab: str, result: LabResult | None) -> tuple[str, str]:
    place = course.place(student, lab)
    if place is None:
        return "none", ""
    star = "*" if place.control else ""
    if result is None:
        return "none", f"—{star}"
    if not result.source:
        return "poor", f"late{star}"
    return "done" if result.done else "poor", f"{round(100 * result.points)}{star}"


def _steps(marks: Sequence[float]) -> list[tuple[str, int]]:
    counts = Counter(marks)
    return [(number(mark), counts[mark]) for mark in sorted(counts, reverse=True)]


def _means(results: Sequence[LabResult], labs: Sequence[str]) -> list[tuple[str, int, float]]:
    points: dict[str, list[float]] = defaultdict(list)
    for each in results:
        points[each.lab].append(each.points)
    return [(lab, len(points[lab]), float(np.mean(points[lab]))) for lab in labs if points[lab]]


def _hardest(results: Sequence[LabResult]) -> list[tuple[str, str, float, int, str]]:
    """Items with the least mean share, with their most frequent mistake."""
    shares: dict[tuple[str, str], list[float]] = defaultdict(list)
    wrong: dict[tuple[str, str], Counter[str]] = defaultdict(Counter)
    for result in results:
        for item, share in result.items.items():
            shares[result.lab, item].append(share)
        for mark in result.marks:
            if mark.kind != Kind.RIGHT:
                wrong[result.lab, mark.asked.item][f"{mark.asked.name}: {mistake(mark)}"] += 1
    rows = [(lab, item, float(np.mean(found)), len(found)) for (lab, item), found in shares.items() if np.mean(found) < 1]
    rows.sort(key=lambda row: (row[2], row[0], row[1]))
    return [(*row, _most(wrong[row[0], row[1]])) for row in rows[:HARDEST]]


def _most(counts: Counter[str]) -> str:
    word, count = min(counts.items(), key=lambda pair: (-pair[1], pair[0]))
    return f"{word} ({count})"


def _mistakes(results: Sequence[LabResult]) -> list[tuple[str, int]]:
    counts = Counter(mistake(mark) for result in results for mark in result.marks if mark.kind != Kind.RIGHT)
    return sorted(counts.items(), key=lambda pair: (-pair[1], pair[0]))[:HARDEST]


def mistake(mark: ValueMark) -> str:
    """A mistake in words that do not depend on the numbers."""
    return mark.words if mark.kind in (Kind.OTHER, Kind.UNIT) else mark.kind.value


@cache
def _environment() -> Any:
    import jinja2

    folder = jinja2.FileSystemLoader(Path(__file__).parent / "templates")
    made = jinja2.Environment(loader=folder, autoescape=True, trim_blocks=True, undefined=jinja2.StrictUndefined)
    made.filters |= {
        "short": _short, "number": lambda value: printed(number(float(value))), "received": received, "chance": _chance,
        "math": mathml,
        "looks": lambda mark: _LOOKS.get(mark.kind, "half"),
    }  # fmt: skip
    return made


def _page(name: str, **values: Any) -> str:
    return str(_environment().get_template(name).render(css=_css(), **values))


@cache
def _css() -> str:
    from ctlabs import reporting

    shared = Path(reporting.__file__).parent / "templates" / "page.css"
    own = Path(__file__).parent / "templates" / "grades.css"
    return shared.read_text(encoding="utf-8") + STYLE + own.read_text(encoding="utf-8")


@cache
def _titles() -> Mapping[str, str]:
    return {name: lab.title for name, lab in catalogue().items()}


def _short(lab: str) -> str:
    return catalogue()[lab].short


def _chance(value: float) -> str:
    return "none" if value == 0 else f"{value:.0e}".replace("e-0", "e-")


def received(mark: ValueMark) -> str:
    """An answer as it was read, in the asked unit; long ones cut."""
    if mark.values is None:
        return reading.unquoted(mark.text)[:60] or "—"
    if mark.values.dtype == bool:
        return "yes" if mark.values else "no"
    unit = "" if mark.asked.unit in ("", "1", "SI") or "," in mark.asked.unit else f" {mark.asked.unit}"
    flat = [printed(number(value, 4)) for value in np.ravel(mark.values).tolist()]
    if mark.values.ndim < 2:
        return ", ".join(flat[:8]) + (", …" if len(flat) > 8 else "") + unit
    wide = mark.values.shape[-1]
    rows = [", ".join(flat[at : at + wide]) for at in range(0, len(flat), wide)]
    return "; ".join(rows[:4]) + ("; …" if len(rows) > 4 else "") + unit
