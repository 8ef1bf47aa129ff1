"""A student's own numbers: drawn from the sets that a lab declares, by the course's secret, and drawn anew where they would spoil it.

A draw is a function of secret, term, student, lab and attempt. Refused are numbers for which the problem degenerates: a value that is
asked does not exist, is 0 or equals another though it need not, or could be guessed; and numbers so near to those of a student before
in the roster that most answers would be the same.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache, lru_cache, partial
from itertools import combinations
from pathlib import Path

import numpy as np

from ctlabs.course.asked import AskedValue
from ctlabs.course.folder import Course
from ctlabs.course.key import key
from ctlabs.course.roster import Student
from ctlabs.labs.catalogue import by_hand, catalogue, load
from ctlabs.reporting.draws import Draw
from ctlabs.reporting.params import LabParameters

#: Attempts for one student.
ATTEMPTS = 300
#: Two values of a student are equal where they differ by less, as a part of their size.
EQUAL = 1e-4
#: Draws besides the default that tell which values are equal, or 0, whatever the parameters are.
PROBES = 3


@dataclass(frozen=True, slots=True)
class Drawn:
    """A student's parameters, the key to them, the attempt that gave them, and why the attempts before were refused."""

    parameters: LabParameters
    answers: tuple[AskedValue, ...]
    attempt: int
    refused: tuple[str, ...] = ()


def parameters(course: Course, student: Student, lab: str) -> LabParameters:
    """The parameters of a student's lab."""
    return drawn(course, lab)[student.id].parameters


@dataclass(frozen=True, slots=True)
class Takers:
    """All that the draws of a lab depend on: who has it and the attempts that come first, secret and term; and who is told of each draw."""

    lab: str
    students: tuple[str, ...]
    first: tuple[int, ...]
    secret: str
    term: str
    told: Callable[[int], object] = field(default=int, compare=False)


def drawn(course: Course, lab: str, told: Callable[[int], object] = int) -> Mapping[str, Drawn]:
    """The draws of all students who have a lab, by the name of the folder.

    ``told`` is called with how many there are, before each that is drawn now; what it raises ends the drawing.

    Raises
    ------
    ValueError
        The lab declares no sets to draw from, or they do not hold enough different problems.
    """
    takers = tuple(each.id for each in course.takers(lab))
    first = tuple(course.redrawn.get((each, lab), 0) for each in takers)
    return of_class(Takers(lab, takers, first, course.secret, course.term, told))


@lru_cache(maxsize=64)
def of_class(takers: Takers) -> Mapping[str, Drawn]:
    """The same from all that it depends on, kept for the next call."""
    course = Course(Path(), "", takers.term, takers.secret, "", (), {})
    found: dict[str, Drawn] = {}
    for student, start in zip(takers.students, takers.first, strict=True):
        takers.told(len(found))
        found[student] = _one(course, student, takers.lab, start, tuple(found.values()))
    return found


def _one(course: Course, student: str, lab: str, start: int, before: tuple[Drawn, ...]) -> Drawn:
    refused: list[str] = []
    for attempt in range(start, start + ATTEMPTS):
        p, answers, why = tried(lab, chosen(lab, partial(_number, course, student, lab, attempt)))
        why = why or next((reason for other in before if (reason := alike(lab, answers, other.answers))), "")
        if p is not None and not why:
            return Drawn(p, answers, attempt, tuple(refused))
        refused.append(why)
    msg = f"{lab}: expected sets that hold a problem of {student}'s own, received none in {ATTEMPTS} draws; the last: {refused[-1]}"
    raise ValueError(msg)


def _number(course: Course, student: str, lab: str, attempt: int, name: str) -> int:
    """A whole number of 256 digits of two, of which nobody without the secret knows one."""
    return int.from_bytes(course.digest("draw", student, lab, attempt, name))


def chosen(lab: str, number: Callable[[str], int]) -> dict[str, object]:
    """Raw parameters: of the set of each the member that its ``number`` says, counted round and round.

    Raises
    ------
    ValueError
        The lab has no sets.
    """
    draws: dict[str, Draw] = load(catalogue()[lab]).Parameters.draws()
    if not draws:
        msg = f"{lab}: expected sets to draw a student's numbers from (given(…, draw=…)), received none"
        raise ValueError(msg)
    return {name: draw[number(name) % len(draw)] for name, draw in draws.items()}


def tried(lab: str, values: Mapping[str, object]) -> tuple[LabParameters | None, tuple[AskedValue, ...], str]:
    """Parameters and key of a draw, and why it is none for a student."""
    try:
        p = load(catalogue()[lab]).Parameters.parse(lab, values)
        answers = key(lab, p)
    except (ValueError, ArithmeticError) as error:
        return None, (), str(error)
    return p, answers, degenerate(lab, p, answers)


def degenerate(lab: str, p: LabParameters, answers: tuple[AskedValue, ...]) -> str:
    """Why a problem is none for a student; empty where it is one."""
    usual = _usual(lab)
    for each in answers:
        if each.value.ndim == 0 and each.name not in usual.flat:
            if not each.value:
                return f"{each.name} is 0"
            if not each.relative and each.value == 1:
                return f"{each.name} is 1, which could be guessed"
            if each.name.startswith("gain") and each.unit == "1" and (abs(each.value) < 0.01 or abs(each.value - 1) < 0.01):
                return f"{each.name} is nearly {round(float(each.value))}, which could be guessed"
    for one, other in combinations(answers, 2):
        if equal(one, other) and (one.name, other.name) not in usual.equal:
            return f"{one.name} equals {other.name}"
    own = getattr(by_hand(lab), "degenerate", None)
    return own(p) if own else ""


def equal(one: AskedValue, other: AskedValue, within: float = EQUAL) -> bool:
    """Whether two values are the same but for ``within`` of their size (counts may be equal by chance)."""
    if one.unit != other.unit or one.value.shape != other.value.shape or not one.relative or not other.relative:
        return False
    return bool((abs(one.value - other.value) <= within * abs(one.value) + one.absolute).all())


def alike(lab: str, one: tuple[AskedValue, ...], other: tuple[AskedValue, ...]) -> str:
    """Why one student's answers would do for another: more than half of those that need not be equal are."""
    constant = _usual(lab).constant
    pairs = [(a, b) for a, b in zip(one, other, strict=True) if a.name not in constant and a.relative]
    same = [a.name for a, b in pairs if equal(a, b, a.relative + b.relative)]
    return f"{len(same)} of {len(pairs)} answers as those of another student ({same[0]}, …)" if 2 * len(same) > len(pairs) else ""


@dataclass(frozen=True, slots=True)
class _Usual:
    """Of a lab whatever its parameters: scalars that may be 0 or 1, pairs that may be equal, values that are always the same."""

    flat: frozenset[str]
    equal: frozenset[tuple[str, str]]
    constant: frozenset[str]


@cache
def _usual(lab: str) -> _Usual:
    """What the default and some other draws have in common."""
    parse, course, looked = load(catalogue()[lab]).Parameters.parse, Course(Path(), "", "", "", "", (), {}), []
    for values in ({}, *(chosen(lab, partial(_number, course, "probe", lab, i)) for i in range(ATTEMPTS))):
        try:
            looked.append(key(lab, parse(lab, values)))
        except (ValueError, ArithmeticError):
            continue
        if len(looked) > PROBES:
            break
    flat = frozenset(a.name for a in looked[0] if a.value.ndim == 0 and (not a.value or (not a.relative and a.value == 1)))
    pairs = [{(a.name, b.name) for a, b in combinations(each, 2) if equal(a, b)} for each in looked]
    constant = {a.name for a in looked[0] if all(np.array_equal(a.value, b.value) for each in looked for b in each if b.name == a.name)}
    return _Usual(flat, frozenset(set.intersection(*pairs)), frozenset(constant))
