r"""Whose answers are another student's.

Students have different numbers, so an answer that is wrong for one and right for another tells where it comes from, and so do wrong
numbers that are equal digit by digit. One such answer may be chance: that it is right for a given other student has the probability

.. math:: p = \max(0.01,\ m/(n - 2))

with m of the n − 2 remaining students for whom it would be right too (0.003 for a list of numbers), and the chances of several values
multiply. Reported is what is expected less than once in twenty courses of this size by chance. A known confusion is no evidence.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ctlabs.course.asked import AskedValue
from ctlabs.course.grading import LabResult
from ctlabs.course.marking import Kind, ValueMark, agrees

#: Least probability that a wrong number is right for another student, and that a wrong list is.
NUMBER, LIST = 0.01, 0.003
#: The same for equal wrong digits.
DIGITS = 1e-3
#: Expected number of false reports in a course.
FALSE = 0.05
#: Share of equal numbers in two records of an experiment that are one.
RECORD = 0.2


@dataclass(frozen=True, slots=True)
class Likeness:
    """``student`` has ``values`` of ``other`` in a lab; ``chance`` : that it is so by chance; ``why``, in words."""

    lab: str
    student: str
    other: str
    values: tuple[str, ...]
    chance: float
    why: str


def copies(lab: str, keys: Mapping[str, Sequence[AskedValue]], results: Mapping[str, LabResult], labs: int = 1) -> list[Likeness]:
    """The copies in a lab: ``keys`` of all students who have it, ``results`` of those who handed in something; of a course of ``labs``."""
    right = {name: {each.name: each for each in key} for name, key in keys.items()}
    limit = FALSE / max(labs * len(keys) * (len(keys) - 1), 1)
    found = []
    for name, result in sorted(results.items()):
        wrong = [each for each in result.marks if each.kind == Kind.WRONG and each.values is not None]
        owners = {each.asked.name: _owners(each, right, name) for each in wrong}
        pairs = (_copy(result, other, wrong, owners, results, len(keys)) for other in sorted(keys) if other != name)
        found += _best(sorted((each for each in pairs if each and each.chance <= limit), key=lambda each: each.chance))
        found += _records(lab, result, results)
    return sorted(found, key=lambda each: (each.chance, each.student, each.other))


def _best(found: Sequence[Likeness]) -> list[Likeness]:
    """Copies of a student without those that a likelier one explains."""
    best: list[Likeness] = []
    for each in found:
        if not any(set(each.values) <= set(other.values) for other in best):
            best.append(each)
    return best


def _owners(found: ValueMark, right: Mapping[str, Mapping[str, AskedValue]], own: str) -> frozenset[str]:
    """For whom a wrong value would be right."""
    asked, owners = found.asked, set()
    assert found.values is not None
    for student, key in right.items():
        other = key.get(asked.name)
        if student == own or other is None or other.value.shape != found.values.shape or not other.relative:
            continue
        if agrees(other, found.values) and not agrees(asked, other.value):
            owners.add(student)
    return frozenset(owners)


def _copy(
    result: LabResult,
    other: str,
    wrong: Sequence[ValueMark],
    owners: Mapping[str, frozenset[str]],
    results: Mapping[str, LabResult],
    count: int,
) -> Likeness | None:
    """What one student has of another's answers."""
    name, chance, theirs, digits = result.student, 1.0, [], []
    marks = {each.asked.name: each for each in results[other].marks} if other in results else {}
    for each in wrong:
        value = each.asked.name
        if other in owners[value]:
            shared = (len(owners[value]) - 1) / max(count - 2, 1)
            chance *= max(NUMBER if each.asked.value.size < 3 else LIST, shared)
            theirs.append(value)
        elif each.kind == Kind.WRONG and value in marks and _same_digits(each, marks[value]):
            others = sum(_same_digits(each, mark) for key, result in results.items() if key not in (name, other) for mark in result.marks)
            chance *= max(DIGITS, others / max(count - 2, 1))
            digits.append(value)
    if not theirs and not digits:
        return None
    words = [f"right for the other, wrong here: {', '.join(theirs)}"] if theirs else []
    words += [f"the same wrong digits: {', '.join(digits)}"] if digits else []
    return Likeness(result.lab, name, other, (*theirs, *digits), chance, "; ".join(words))


def _same_digits(one: ValueMark, other: ValueMark) -> bool:
    """Whether two wrong answers are one, written with four digits or more."""
    if other.kind != Kind.WRONG or other.asked.name != one.asked.name or one.values is None or other.values is None:
        return False
    if one.values.shape != other.values.shape or not one.asked.relative:
        return False
    mantissas = (f"{abs(x):.12g}".split("e")[0] for x in np.ravel(one.values).tolist() if math.isfinite(x))
    long = any(len(each.replace(".", "").strip("0")) >= 4 for each in mantissas)
    return long and bool(np.array_equal(one.values, other.values))


def _records(lab: str, result: LabResult, results: Mapping[str, LabResult]) -> Iterator[Likeness]:
    """Records of the experiment that are another student's."""
    own = frozenset[int]().union(*(each.sample for each in result.outcomes))
    for other, theirs in sorted(results.items()):
        sample = frozenset[int]().union(*(each.sample for each in theirs.outcomes))
        least = min(len(own), len(sample))
        if other != result.student and least >= 8 and len(own & sample) >= RECORD * least:
            why = f"{len(own & sample)} of {least} numbers of the record are the same"
            yield Likeness(lab, result.student, other, ("record",), 0.0, why)
