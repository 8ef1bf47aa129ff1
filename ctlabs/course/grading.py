r"""From what a student handed in to a mark: values, items, labs, table 1.

Of a lab each lettered item counts alike, an item's values count alike within it, and the record of the experiment counts as one item more
where the lab has a variance to test it against. With shares :math:`s_1 … s_n` of the items and e of the record (0 or 1) a lab has

.. math:: p = \frac{s_1 + \dots + s_n + e}{n + 1}

and is done from :math:`p \ge` ``done`` on, if its report was in time and its defence did not fail. The mark is that of table 1 for the
number of labs done, less half a point for each part of the semester none of whose control labs is done.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ctlabs.course import record
from ctlabs.course.asked import AskedValue
from ctlabs.course.folder import Course, LabPlace, Rule
from ctlabs.course.marking import CREDIT, Kind, ValueMark, mark
from ctlabs.course.record import RecordOutcome
from ctlabs.course.roster import Student
from ctlabs.course.submissions import Noted, Submission
from ctlabs.course.values import AnswerError, answer

#: What the marks of table 1 are called: from each on.
GRADES = ((2.5, 3), (3.5, 4), (4.5, 5))


@dataclass(frozen=True, slots=True, eq=False)
class LabResult:
    """What a student has of a lab.

    ``marks`` of the values · ``items`` : share of each letter, 0 to 1 · ``outcomes`` of the record, ``experiment`` : 0 or 1, None where
    the lab has none · ``admitted`` : whether the theory was in, in time · ``points`` : share of the lab · ``notes`` for the teacher
    """

    student: str
    lab: str
    marks: tuple[ValueMark, ...]
    items: Mapping[str, float]
    outcomes: tuple[RecordOutcome, ...]
    experiment: float | None
    admitted: bool
    points: float
    done: bool
    source: str
    date: dt.date | None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Total:
    """The mark of a student: ``done`` labs, ``failed`` control sessions (parts), the ``mark`` of table 1 and the ``grade`` it is."""

    done: int
    failed: tuple[int, ...]
    mark: float
    grade: int | None


def lab_result(
    course: Course, student: Student, place: LabPlace, asked: Sequence[AskedValue], found: Sequence[Submission], noted: Noted
) -> LabResult:
    """The result of a lab from all its files."""
    counted, notes = _counted(place, found, noted)
    marks = tuple(_marked(each, counted) for each in asked)
    items = shares(marks)
    admitted, why = _admitted(course.rule, place, found, noted)
    outcomes, experiment, told = _experiment(asked, counted, admitted)
    points = (sum(items.values()) + (experiment or 0.0)) / (len(items) + (experiment is not None))
    done = counted is not None and points >= course.rule.done - 1e-9
    if noted.defence is False and done:
        done, notes = False, [*notes, "the defence failed"]
    if counted is not None:
        notes += [each for each in (why, told, counted.strange) if each]
    date = noted.report or (counted.date if counted else None)
    source = counted.source if counted else ""
    return LabResult(student.id, place.lab, marks, items, outcomes, experiment, admitted, points, done, source, date, tuple(notes))


def _counted(place: LabPlace, found: Sequence[Submission], noted: Noted) -> tuple[Submission | None, list[str]]:
    """The file that counts: the last one in time; of files of one day, or without one, the last by its path."""
    if not found:
        return None, []
    notes = []
    in_time = [each for each in found if _in_time(place.report, noted.report or each.date)]
    if not in_time:
        last = noted.report or max(each.date for each in found if each.date is not None)
        return None, [f"handed in on {last}, after the last day, {place.report}: not counted"]
    order = sorted(in_time, key=lambda each: (each.date or dt.date.min, each.source))
    if len(found) > 1:
        notes.append(f"{len(found)} files; {order[-1].source} counts")
    return order[-1], notes


def _in_time(last: dt.date | None, date: dt.date | None) -> bool:
    return last is None or date is None or date <= last


def _admitted(rule: Rule, place: LabPlace, found: Sequence[Submission], noted: Noted) -> tuple[bool, str]:
    """Whether the theory was in, in time: a file that answers enough of the values."""
    if not rule.theory_first:
        return True, ""
    if noted.theory is not None:
        good = _in_time(place.theory, noted.theory)
        return good, "" if good else f"the theory part was in on {noted.theory}, after {place.theory}: the experiment does not count"
    whole = [each for each in found if each.answered >= rule.done]
    if not whole:
        return False, f"less than {100 * rule.done:g} % of the theory part is answered: the experiment does not count"
    if any(_in_time(place.theory, each.date) for each in whole):
        return True, ""
    first = min(each.date for each in whole if each.date is not None)
    return False, f"the theory part was in on {first}, after {place.theory}: the experiment does not count"


def _marked(asked: AskedValue, found: Submission | None) -> ValueMark:
    if found is None:
        return mark(asked, None)
    text, line = found.answers.text(asked.name), found.answers.entries[asked.name].line if asked.name in found.answers.entries else 0
    try:
        return mark(asked, answer(text, asked.value.shape, verdict=asked.value.dtype == bool), line)
    except AnswerError as error:
        return ValueMark(asked, Kind.UNREADABLE, f"line {line}: {error}", text=text[:200], line=line)


def shares(marks: Sequence[ValueMark]) -> dict[str, float]:
    """The share of each item: the mean of what its values earn."""
    found: dict[str, list[float]] = {}
    for each in marks:
        found.setdefault(each.asked.item, []).append(CREDIT[each.kind])
    return {item: sum(earned) / len(earned) for item, earned in found.items()}


def _experiment(
    asked: Sequence[AskedValue], found: Submission | None, admitted: bool
) -> tuple[tuple[RecordOutcome, ...], float | None, str]:
    """What the records beside a file show, and what they earn; None where the lab has nothing to test."""
    if not record.tested(asked):
        return (), None, ""
    if found is None or not found.records:
        return (), 0.0, "" if found is None else "no record of the experiment"
    outcomes: list[RecordOutcome] = []
    wrong = []
    for path in found.records:
        try:
            outcomes += record.read(path, asked, f"{found.source.rpartition('/')[0]}/{path.name}".lstrip("/"))
        except ValueError as error:
            wrong.append(str(error))
    good = bool(outcomes) and all(each.passed for each in outcomes) and admitted
    return tuple(outcomes), float(good), "; ".join(wrong)


def total(course: Course, student: Student, results: Mapping[str, LabResult]) -> Total:
    """The mark of a student.

    >>> from pathlib import Path
    >>> places = tuple(LabPlace(f"task{i:02d}", control=i == 1, part=1) for i in range(1, 8))
    >>> course = Course(Path("."), "", "", "", "a", (), {"a": places})
    >>> total(course, Student("A", "A"), {})
    Total(done=0, failed=(1,), mark=0.0, grade=2)
    """
    places = course.labs(student)
    done = {place.lab for place in places if place.lab in results and results[place.lab].done}
    parts = sorted({place.part for place in places if place.control})
    failed = tuple(part for part in parts if not any(p.control and p.part == part and p.lab in done for p in places))
    marks = course.rule.marks
    plain = marks[min(len(done), len(marks)) - 1] if done else 0.0
    value = max(round(plain - course.rule.control * len(failed), 6), 0.0)
    grade = next((grade for least, grade in reversed(GRADES) if value >= least), 2) if max(marks) < 6 else None
    return Total(len(done), failed, value, grade)
