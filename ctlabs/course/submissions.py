"""What students handed in: files of answers anywhere below a folder, known by the number of their form, with a record beside them.

Any folders will do: those that a teacher makes, those of an e-mail, those in which Moodle packs what was handed in. The day of a file is
the ``date`` in its head, unless the table ``handed_in.csv`` of the course says otherwise (columns ``student``, ``lab``, ``theory``,
``report``, and ``defence`` for yes or no).
"""

from __future__ import annotations

import csv
import datetime as dt
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from ctlabs.course import reading
from ctlabs.course.folder import Course
from ctlabs.course.key import questions
from ctlabs.course.reading import Answers
from ctlabs.course.roster import Student
from ctlabs.course.values import NOTHING
from ctlabs.files import datafile
from ctlabs.files.spelling import shown

#: What the head of a file of answers says.
HEAD = ("course", "term", "student", "group", "lab", "form", "date")
#: Endings of files of answers, and of records.
ANSWERS, RECORDS = (".toml", ".txt"), (".csv", ".tsv", ".dat")
#: Where a course notes the days and the defences.
HANDED_IN = "handed_in.csv"
#: Most files that are looked at, and deepest folder.
FILES, DEPTH = 20_000, 8


@dataclass(frozen=True, slots=True)
class Submission:
    """A file of answers: whose, of which lab, handed in when (None: not said), and the tables beside it."""

    student: str
    lab: str
    source: str
    answers: Answers
    date: dt.date | None
    records: tuple[Path, ...]
    strange: str = ""

    @property
    def answered(self) -> float:
        """The share of the values that have an answer, 0 to 1."""
        names = questions(self.lab)
        return sum(self.answers.text(name).strip().lower() not in NOTHING for name in names) / len(names)


@dataclass(frozen=True, slots=True)
class Noted:
    """What the teacher noted of a lab: days of the theory and of the report, and whether it was defended (None: not said)."""

    theory: dt.date | None = None
    report: dt.date | None = None
    defence: bool | None = None


def collect(course: Course, folder: Path) -> tuple[list[Submission], list[str]]:
    """All submissions below a folder, in the order of their paths, and what is wrong with files that are none.

    Raises
    ------
    ValueError
        The folder is none.
    """
    if not folder.is_dir():
        raise ValueError(f"{folder}: expected a folder with what students handed in, received none")
    forms = course.forms()
    found: list[Submission] = []
    problems: list[str] = []
    for path in files(folder, problems):
        source = path.relative_to(folder).as_posix()
        try:
            each = _submission(course, forms, path, source)
        except ValueError as error:
            problems.append(str(error))
            continue
        problems.extend(each.answers.problems)
        found.append(each)
    return found, problems


def files(folder: Path, problems: list[str]) -> Iterator[Path]:
    """Files of answers, sorted; links are not followed, hidden files and those of archives of a Mac are left out."""
    count, todo = 0, [(folder, 0)]
    while todo:
        place, depth = todo.pop()
        try:
            inside = sorted(place.iterdir(), key=lambda path: path.name)
        except OSError as error:
            problems.append(f"{place.name}: expected a folder that can be read, received: {error.strerror}")
            continue
        for path in inside:
            if path.name.startswith((".", "__MACOSX")):
                continue
            if path.is_dir() and not path.is_symlink():
                if depth < DEPTH:
                    todo.append((path, depth + 1))
                else:
                    problems.append(f"{path.relative_to(folder).as_posix()}: expected folders at most {DEPTH} deep, received more")
            elif path.suffix.lower() in ANSWERS:
                count += 1
                if count > FILES:
                    problems.append(f"{folder.name}: expected at most {FILES} files, received more; the rest is left out")
                    return
                yield path


def _submission(course: Course, forms: Mapping[str, tuple[Student, str]], path: Path, source: str) -> Submission:
    """The submission in a file, whose owner is told by its form's number, or else by its head's words."""
    people = [each.name for each in course.students]
    raw = reading.content(path, source)
    head = reading.parsed(raw, HEAD, source, people)
    student, lab, strange = owner(course, forms, head, source)
    answers = reading.parsed(raw, [*HEAD, *questions(lab)], source, people)
    beside = sorted(each for each in path.parent.iterdir() if each.suffix.lower() in RECORDS and not each.name.startswith("."))
    own = [each for each in path.parent.iterdir() if each.suffix.lower() in ANSWERS]
    if len(own) > 1:  # several files of answers in one folder: a record has the name of its file
        beside = [each for each in beside if each.stem.startswith(path.stem)]
    return Submission(student.id, lab, source, answers, day(answers.text("date"), source), tuple(beside), strange)


def owner(course: Course, forms: Mapping[str, tuple[Student, str]], head: Answers, source: str) -> tuple[Student, str, str]:
    """Whose form it is, of which lab, and what is strange about it: by the number of the form, else by the words of its head."""
    told, form = head.text("student"), head.text("form").lower()
    if form in forms:
        student, lab = forms[form]
        if told and reading.folded(told) not in {reading.folded(student.name), reading.folded(student.id)}:
            return student, lab, f"the form of {student.name} with the name {shown(told)}"
        return student, lab, ""
    if not told or not head.text("lab"):
        raise ValueError(f"{source}: expected a form of this course (student, lab and form in its head), received another file")
    names = {key: each for each in course.students for key in (reading.folded(each.name), reading.folded(each.id))}
    owner = names.get(reading.folded(told))
    if owner is None:
        raise ValueError(f"{source}: line {head.entries['student'].line}: expected a student of the roster, received {shown(told)}")
    lab = _lab(course, owner, head.text("lab"))
    if not lab:
        raise ValueError(f"{source}: line {head.entries['lab'].line}: expected a lab of {owner.name}, received {shown(head.text('lab'))}")
    return owner, lab, f"the form's number is {'missing' if not form else 'that of nobody'}"


def _lab(course: Course, student: Student, text: str) -> str:
    """The lab of a student that is meant by task07, 07 or 7; empty where it is none."""
    word = reading.folded(text)
    labs = (place.lab for place in course.labs(student))
    return next((each for each in labs if word in (each, each.removeprefix("task"), each.removeprefix("task0"))), "")


def day(text: str, source: str) -> dt.date | None:
    """A day as 2026-10-05 or 05.10.2026; None where nothing stands. With slashes it would have two readings.

    >>> day("2026-10-05", "a"), day("05.10.2026", "a"), day("", "a")
    (datetime.date(2026, 10, 5), datetime.date(2026, 10, 5), None)
    """
    plain = text.strip().split("T")[0].split(" ")[0]
    if not plain or plain.lower() in NOTHING:
        return None
    iso, dotted = re.fullmatch(r"(\d{4})-(\d{1,2})-(\d{1,2})", plain), re.fullmatch(r"(\d{1,2})\.(\d{1,2})\.(\d{4})", plain)
    try:
        if iso:
            return dt.date(int(iso[1]), int(iso[2]), int(iso[3]))
        if dotted:
            return dt.date(int(dotted[3]), int(dotted[2]), int(dotted[1]))
    except ValueError:
        pass
    raise ValueError(f"{source}: expected a date as 2026-10-05 or 05.10.2026, received {shown(text)}")


def noted(course: Course) -> dict[tuple[str, str], Noted]:
    """What ``handed_in.csv`` of a course says, by student and lab; nothing where there is no such table.

    Raises
    ------
    ValueError
        The table cannot be read, or names somebody or something unknown; with its line.
    """
    path = course.folder / HANDED_IN
    if not path.exists():
        return {}
    text = datafile.text(reading.content(path, HANDED_IN), HANDED_IN, [each.name for each in course.students])
    found = {}
    for line, row in rows(text):
        where = f"{HANDED_IN}: line {line}"
        try:
            student = course.student(row.get("student", ""))
        except ValueError:
            raise ValueError(f"{where}: expected a student of the roster, received {shown(row.get('student', ''))}") from None
        lab = _lab(course, student, row.get("lab", ""))
        if not lab:
            raise ValueError(f"{where}: expected a lab of {student.name}, received {shown(row.get('lab', ''))}")
        defence = row.get("defence", "").strip().lower()
        if defence not in ("", "yes", "no", "да", "нет", "+", "-", "1", "0"):
            raise ValueError(f"{where}: expected yes or no for the defence, received {shown(defence)}")
        defended = defence in ("yes", "да", "+", "1") if defence else None
        found[student.id, lab] = Noted(day(row.get("theory", ""), where), day(row.get("report", ""), where), defended)
    return found


def rows(text: str) -> Iterable[tuple[int, dict[str, str]]]:
    """The rows of a table with their lines, by the folded names of its columns."""
    lines = text.splitlines()
    mark = next((each for each in "\t;," if lines and each in lines[0]), ";")
    table = list(csv.reader(lines, delimiter=mark))
    names = [reading.folded(cell) for cell in table[0]] if table else []
    return [(i, dict(zip(names, row, strict=False))) for i, row in enumerate(table[1:], 2) if any(cell.strip() for cell in row)]
