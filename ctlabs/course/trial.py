"""Every problem of a course tried: its lab is run with the student's numbers, all checks pass, and the key is what the report says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from ctlabs.course.asked import AskedValue
from ctlabs.course.folder import REDRAWN, Course
from ctlabs.course.key import questions, rectangular
from ctlabs.course.variants import drawn
from ctlabs.labs.catalogue import catalogue, run
from ctlabs.labs.experiment import Experiment
from ctlabs.linalg.checks import Array
from ctlabs.reporting.params import LabParameters

#: Key and report agree where they differ by less, as a part of a value's size.
AGREE = 1e-6
#: How often offenders are drawn anew.
ROUNDS = 5


def tried(course: Course, runs: int, job: tuple[str, str]) -> dict[str, Any]:
    """Run the lab of a student, both given by name; says what is wrong with it, and the attempt that drew it."""
    student, lab = job
    mine = drawn(course, lab)[student]
    wrong = against_report(lab, mine.parameters, mine.answers, runs)
    return {"student": student, "lab": lab, "wrong": wrong, "attempt": mine.attempt, "refused": mine.refused}


def against_report(lab: str, p: LabParameters, answers: tuple[AskedValue, ...], runs: int, seed: int = 1) -> list[str]:
    """What a real run says against a key: checks that failed, values that differ."""
    try:
        report = run(catalogue()[lab], p, Experiment(runs, seed, 1))
    except (ValueError, ArithmeticError) as error:
        return [f"refused: {error}"]
    wrong = [f"check failed: {check.name}" for check in report.checks if not check.passed]
    values = report.values
    for each in answers:
        if each.name not in values:
            wrong.append(f"{each.name} is not in the report")
        elif not agrees(each, rectangular(values[each.name].value), questions(lab)[each.name].first):
            wrong.append(f"{each.name} is not what the report says")
    return wrong


def agrees(asked: AskedValue, found: Array | None, first: int = 0) -> bool:
    """Whether a report's value, or its ``first`` rows, are the key's."""
    if found is None:
        return False
    found = (found[:first] if first else found).astype(float)
    allowed = AGREE * abs(asked.value) + AGREE * asked.absolute + (asked.value == 0) * asked.absolute
    return found.shape == asked.value.shape and bool((abs(found - asked.value) <= allowed).all())


def anew(course: Course, offenders: list[dict[str, Any]]) -> Course:
    """The course with other numbers for the ``offenders``, which ``redrawn.toml`` keeps."""
    redrawn = {**course.redrawn, **{(each["student"], each["lab"]): each["attempt"] + 1 for each in offenders}}
    lines = ["# Numbers that `ctlabs course test` drew anew: the attempt from which each student's lab is drawn."]
    for student, lab in sorted(redrawn):
        lines.append(f'"{student}".{lab} = {{ attempt = {redrawn[student, lab]} }}')
    path = Path(course.folder / REDRAWN)
    new = path.with_name(f".{path.name}")
    new.write_text("\n".join(lines) + "\n", encoding="utf-8")
    new.replace(path)
    return replace(course, redrawn=redrawn)
