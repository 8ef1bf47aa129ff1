"""What a student may know before handing in: whether a form is complete and how it is read; with attempts, what of it is right.

Form, names and units need no secret. Right or wrong needs the key, for whoever has digests of rounded numbers finds the numbers by
trying; so it is told only where the course's folder is, and each look at new answers is an attempt, counted in ``attempts/`` there.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from ctlabs.course import keeping, reading, record, submissions
from ctlabs.course.asked import AskedValue
from ctlabs.course.folder import Course
from ctlabs.course.key import key
from ctlabs.course.marking import Kind, mark
from ctlabs.course.pages import received
from ctlabs.course.submissions import HEAD
from ctlabs.course.units import coherent
from ctlabs.course.values import AnswerError, Received, answer
from ctlabs.files import whole
from ctlabs.labs.catalogue import catalogue, find, load

#: Folder of the counts in that of the course.
ATTEMPTS = "attempts"


@dataclass(frozen=True, slots=True)
class FormLine:
    """What is said of a value: its ``name``, how it was ``read``, what is ``wrong`` with its form, the ``verdict`` where it is told."""

    name: str
    read: str
    wrong: str = ""
    verdict: str = ""


@dataclass(frozen=True, slots=True)
class CheckedForm:
    """A form: ``lines`` of its values, ``problems`` with the rest, how many values are ``empty``, ``left`` attempts (None: not asked)."""

    lab: str
    lines: tuple[FormLine, ...]
    problems: tuple[str, ...]
    empty: int
    left: int | None = None

    @property
    def good(self) -> bool:
        """Whether everything that stands in the form can be read."""
        return not self.problems and not any(line.wrong for line in self.lines)


def check(path: Path) -> CheckedForm:
    """What a form says, as it is read; no number is compared with anything.

    Raises
    ------
    ValueError
        The file cannot be read, or is no form.
    """
    return _checked(*_form(path))


def _checked(lab: str, answers: reading.Answers) -> CheckedForm:
    lines = tuple(_line(each, answers) for each in usual(lab))
    return CheckedForm(lab, lines, answers.problems, sum(not line.read and not line.wrong for line in lines))


@cache
def usual(lab: str) -> tuple[AskedValue, ...]:
    """What a lab asks for, with the numbers of the sheet: shapes and units are everybody's."""
    return key(lab, load(catalogue()[lab]).Parameters())


def _form(path: Path) -> tuple[str, reading.Answers]:
    raw = reading.content(path, path.name)
    word = reading.parsed(raw, HEAD, path.name).text("lab")
    if not word:
        raise ValueError(f"{path.name}: expected a form of a course with the line lab = …, received another file")
    try:
        (lab,) = find([word])
    except ValueError:
        raise ValueError(f"{path.name}: expected a lab as in `ctlabs list`, received {word[:40]}") from None
    return lab.name, reading.parsed(raw, [*HEAD, *(each.name for each in usual(lab.name))], path.name)


def _line(asked: AskedValue, answers: reading.Answers) -> FormLine:
    try:
        found = _read(asked, answers)
    except AnswerError as error:
        return FormLine(asked.name, "", f"line {answers.entries[asked.name].line}: {error}")
    if found is None:
        return FormLine(asked.name, "")
    told, wanted = mark(asked, found), coherent(asked.unit)
    if found.unit is not None and wanted is not None and found.unit.dimension != wanted.dimension:
        wrong = f"line {answers.entries[asked.name].line}: expected {asked.unit}, received another unit"
        return FormLine(asked.name, received(told), wrong)
    return FormLine(asked.name, received(told))


def _read(asked: AskedValue, answers: reading.Answers) -> Received | None:
    return answer(answers.text(asked.name), asked.value.shape, verdict=asked.value.dtype == bool)


def attempt(course: Course, path: Path, allowed: int) -> CheckedForm:
    """Right or wrong for each value, at most ``allowed`` times for one student and lab; the same answers again are no new attempt.

    Raises
    ------
    ValueError
        The file is no form of this course.
    """
    own, answers = _form(path)
    plain = _checked(own, answers)
    head = reading.parsed(reading.content(path, path.name), HEAD, path.name, [each.name for each in course.students])
    student, lab, _ = submissions.owner(course, course.forms(), head, path.name)
    asked = keeping.answers(course, lab)[student.id]
    digest = hashlib.sha256(json.dumps([answers.text(each.name) for each in asked]).encode()).hexdigest()
    place = course.folder / ATTEMPTS / student.id / f"{lab}.json"
    looked = _looked(place)
    if digest not in looked:
        if len(looked) >= allowed:
            over = f"expected at most {allowed} attempts, received one more"
            return CheckedForm(lab, plain.lines, (*plain.problems, over), plain.empty, 0)
        looked = [*looked, digest]
        place.parent.mkdir(parents=True, exist_ok=True)
        whole.write(place, json.dumps(looked).encode())
    pairs = zip(plain.lines, asked, strict=True)
    lines = tuple(FormLine(line.name, line.read, line.wrong, _verdict(each, answers)) for line, each in pairs)
    return CheckedForm(lab, lines, plain.problems, plain.empty, allowed - len(looked))


def _looked(place: Path) -> list[str]:
    try:
        found = json.loads(place.read_text(encoding="utf-8"))
        return [str(each) for each in found] if isinstance(found, list) else []
    except FileNotFoundError:
        return []
    except (OSError, ValueError):
        raise ValueError(f"{place.name}: expected the attempts of a student, received another file; the teacher may delete it") from None


def _verdict(asked: AskedValue, answers: reading.Answers) -> str:
    """Right, wrong, or nothing where nothing can be said."""
    try:
        found = _read(asked, answers)
    except AnswerError:
        return ""
    if found is None:
        return ""
    return "right" if mark(asked, found).kind == Kind.RIGHT else "wrong"


def columns(lab: str) -> str:
    """How the record of a lab's experiment is to be written, in a sentence; empty where there is none."""
    theory = record.tested(usual(lab))
    if not theory:
        return ""
    P = record.variances(theory[0])
    index = "".join(f", {name} = 1 … {size}" for name, size in zip(("i", "j"), P.shape, strict=False))
    return f"The record of the experiment, a CSV file beside the form: columns run{index}, error (x̂ − x), held against {theory[0].name}."


