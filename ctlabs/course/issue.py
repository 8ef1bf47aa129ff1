"""Hand-outs for everybody: a folder for each student and lab, written as a whole or not at all; the same course gives the same bytes."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ctlabs.course import keeping, statement
from ctlabs.course.folder import Course, LabPlace
from ctlabs.course.roster import Student
from ctlabs.course.telling import Tell, nobody
from ctlabs.course.variants import drawn
from ctlabs.labs import printing
from ctlabs.labs.catalogue import catalogue
from ctlabs.reporting.crossrefs import anchor
from ctlabs.reporting.render import page, swap

_HEADING = re.compile(r"^## (.+)$", re.MULTILINE)


def issue_all(course: Course, tell: Tell = nobody) -> int:
    """Write the hand-outs of all labs, one after the other; how many there are. Those that are written when ``tell`` raises are whole."""
    labs, done = course.all_labs(), 0
    total = sum(len(course.labs(each)) for each in course.students)
    for lab in labs:

        def step(count: int, _takers: int, words: str, lab: str = lab, before: int = done) -> None:
            tell(before + count, total, f"Lab {catalogue()[lab].short}, {labs.index(lab) + 1} of {len(labs)}: {words}")

        done += issue(course, lab, tell=step)["count"]
    tell(done, total, "")
    return done


def issued(course: Course) -> dict[str, tuple[str, ...]]:
    """The labs of which each student's hand-out is there, by the names of the students' folders."""
    return {
        each.id: tuple(place.lab for place in course.labs(each) if (course.handout(each, place.lab) / statement.FORM).is_file())
        for each in course.students
    }


def issue(course: Course, lab: str, students: frozenset[str] | None = None, tell: Tell = nobody) -> dict[str, Any]:
    """Write the hand-outs of a lab; returns its name, how many there are, and what was drawn anew.

    ``students`` : folders of those who get theirs; of all if it is None. What a student gets depends on those before in the roster,
    so that all are drawn.
    """
    takers, count = course.takers(lab), 0
    found = drawn(course, lab, lambda number: tell(0, len(takers), f"numbers of {number} of {len(takers)} students"))
    keeping.keep(course, lab, {name: each.answers for name, each in found.items()})
    for student in takers:
        if students is not None and student.id not in students:
            continue
        tell(count, len(takers), "hand-outs")
        place, mine = course.place(student, lab), found[student.id]
        assert place is not None  # for a taker has it
        write(course, student, place, statement.statement(course, student, place, mine.parameters, mine.answers),
              statement.form(course, student, lab, mine.answers))  # fmt: skip
        count += 1
    return {"lab": lab, "count": count, "anew": sum(len(each.refused) for each in found.values())}


def write(course: Course, student: Student, place: LabPlace, text: str, form: str) -> None:
    """One hand-out: text, page and form; its PDF stays if the text is the same."""
    folder = course.handout(student, place.lab)
    old = folder / statement.TEXT
    new = {
        statement.TEXT: text,
        statement.PAGE: page(statement.title(place.lab), _HEADING.sub(_named, text)),
        statement.FORM: form,
    }
    if all((folder / name).is_file() and (folder / name).read_bytes() == content.encode() for name, content in new.items()):
        return
    folder.parent.mkdir(parents=True, exist_ok=True)
    made = Path(tempfile.mkdtemp(prefix=f".{place.lab}-", dir=folder.parent))
    try:
        made.chmod(0o755)
        for name, content in new.items():
            (made / name).write_bytes(content.encode())
        if old.is_file() and old.read_bytes() == text.encode() and (folder / statement.PAPER).is_file():
            shutil.copyfile(folder / statement.PAPER, made / statement.PAPER)
        swap(made, folder)
    finally:
        shutil.rmtree(made, ignore_errors=True)


def _named(heading: re.Match[str]) -> str:
    """A heading with a name, by which the page's contents lead to it."""
    name = "-".join(re.findall("[a-z]+", heading[1].lower()))
    return f"{heading[0]}{anchor(name)}"


def handouts(course: Course, labs: Sequence[str], students: frozenset[str] | None = None) -> list[tuple[Path, dict[str, str]]]:
    """The folder of each hand-out and what its title page says."""
    return [
        (course.handout(student, place.lab), titled(course, student))
        for student in course.students if students is None or student.id in students
        for place in course.labs(student) if place.lab in labs
    ]  # fmt: skip


def titled(course: Course, student: Student) -> dict[str, str]:
    """What a title page says of a student."""
    words = {key: course.words.get(key, "") for key in ("university", "faculty", "department", "teacher", "city")}
    own = {"course": course.title, "student": student.name, "group": student.group, "date": course.term,
           "variant": (student.variant or course.variant).upper()}  # fmt: skip
    return {key: word for key, word in (words | own).items() if word}


def paper(folder: Path) -> Path:
    """The PDF of a hand-out that is there; made beside it and then renamed."""
    head, body = (folder / statement.TEXT).read_text(encoding="utf-8").split("\n", 1)
    made = folder / f".{statement.PAPER}"
    printing.convert(body, "pdf", made, head.removeprefix("# "), {})
    return made.replace(folder / statement.PAPER)


def papers(folder: Path) -> dict[str, Any]:
    """The same, if there is none that is as new as the text."""
    made, text = folder / statement.PAPER, folder / statement.TEXT
    if not made.is_file() or made.stat().st_mtime < text.stat().st_mtime:
        paper(folder)
    return {"lab": str(folder), "count": 1}
