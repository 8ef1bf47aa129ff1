"""The teacher's edition: every student's answers with what counts as right, and on request the full reports with these numbers."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ctlabs.course import keeping, statement
from ctlabs.course.asked import AskedValue
from ctlabs.course.folder import Course
from ctlabs.course.roster import Student
from ctlabs.course.variants import drawn
from ctlabs.files import whole
from ctlabs.labs.catalogue import catalogue, run_and_write
from ctlabs.labs.experiment import Experiment
from ctlabs.reporting.cells import grid
from ctlabs.reporting.render import page
from ctlabs.text import _, number

#: Columns of the table of all keys.
COLUMNS = ("student", "lab", "item", "name", "symbol", "unit", "value", "relative", "absolute")


def edition(course: Course, lab: str) -> dict[str, Any]:
    """Write ``key/STUDENT/LAB.html`` and ``LAB.toml`` of everybody who has a lab; returns its name and the rows of the table of keys."""
    keys, found = keeping.answers(course, lab), drawn(course, lab)
    rows: list[list[Any]] = []
    for student in course.takers(lab):
        asked, place = keys[student.id], course.folder / keeping.KEYS / student.id
        place.mkdir(parents=True, exist_ok=True)
        text = _page(course, student, lab, statement.numbers(found[student.id].parameters), asked)
        whole.write(place / f"{lab}.html", page(f"{statement.title(lab)}: {student.name}", text).encode())
        whole.write(place / f"{lab}.toml", ("\n".join(_entries(asked)) + "\n").encode())
        rows += [
            [student.id, lab, a.item, a.name, a.symbol, a.unit, json.dumps(a.value.tolist()), a.relative, a.absolute] for a in asked
        ]
    return {"lab": lab, "count": len(keys), "rows": rows}


def table(course: Course, rows: Iterable[list[Any]]) -> Path:
    """Write ``key/key.csv``, all keys as one table, by student, lab and item."""
    order = {name: i for i, name in enumerate(each.id for each in course.students)}
    file, ordered = io.StringIO(), sorted(rows, key=lambda row: (order[row[0]], row[1]))
    writer = csv.writer(file, lineterminator="\n")
    writer.writerows([COLUMNS, *ordered])
    path = course.folder / keeping.KEYS / "key.csv"
    path.parent.mkdir(parents=True, exist_ok=True)
    whole.write(path, file.getvalue().encode())
    return path


def report(course: Course, runs: int | None, job: tuple[str, str]) -> dict[str, Any]:
    """Write the full report of a student's lab, both given by name, to ``key/STUDENT/LAB``; how it went, as of a lab that is run."""
    student, lab = job
    p, own = drawn(course, lab)[student].parameters, catalogue()[lab]
    done = run_and_write(own, p, Experiment(runs or own.runs, 1, 1), course.folder / keeping.KEYS / student)
    return {**done, "student": student}


def _page(course: Course, student: Student, lab: str, numbers: str, asked: tuple[AskedValue, ...]) -> str:
    units = ("" if a.unit == "1" else a.unit for a in asked)
    said = [
        [f"({a.item})", f"${a.symbol}$", a.meaning, _shown(a), unit, _allowed(a), "; ".join(a.others)]
        for a, unit in zip(asked, units, strict=True)
    ]
    heads = [_("item"), _("symbol"), _("what is asked"), _("answer"), _("unit"), _("allowed"), _("known confusions")]
    lines = [
        f"# {statement.title(lab)}",
        f"**{_('Key')}** · {statement.escaped(student.name)} · {_('form')} {course.form(student, lab)}",
        f"## {_('Numbers')}", numbers, f"## {_('Answers')}", grid(heads, said),
    ]  # fmt: skip
    return "\n\n".join(lines) + "\n"


def _shown(asked: AskedValue) -> str:
    if asked.value.ndim == 3:
        return "; ".join(number(each.tolist()) for each in asked.value)
    return str(number(asked.value.tolist()))


def _allowed(asked: AskedValue) -> str:
    return f"± {100 * asked.relative:g} %" if asked.relative else _("exactly")


def _entries(asked: tuple[AskedValue, ...]) -> Iterable[str]:
    for a in asked:
        yield f"[{a.name}]"
        yield f'item = "{a.item}"\nunit = "{a.unit}"\nvalue = {json.dumps(a.value.tolist())}'
        yield f"relative = {a.relative!r}\nabsolute = {a.absolute!r}\n"
