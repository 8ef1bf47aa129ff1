"""A course of thirty students and what they hand in, for tests."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from ctlabs.course import folder, keeping, record
from ctlabs.course.asked import AskedValue
from ctlabs.course.folder import Course
from tests.course.test_answers_read import spelled

NAMES = ("Anna Weiss", "Пётр Иванов", "José Núñez")
#: Four labs in two parts, with a control lab in each, and days.
COURSE = """title = "Stochastic models"
term = "autumn 2026"
secret = "0123456789abcdef0123"
variant = "a"

[variants]
a = ["1* 7", "11 16*"]

[dates]
7 = { theory = 2026-10-01, report = 2026-10-15 }
"""

Change = Callable[[AskedValue], np.ndarray | None]


def made(place: Path, students: int = 30, course: str = COURSE) -> Course:
    """The folder of a course."""
    place.mkdir(parents=True, exist_ok=True)
    (place / folder.COURSE).write_text(course, encoding="utf-8")
    rows = [f"{NAMES[i % 3]} {chr(65 + i // 26)}{chr(97 + i % 26)};CS-{i % 2 + 1};s{i}@example.org\n" for i in range(students)]
    (place / folder.ROSTER).write_text("name;group;email\n" + "".join(rows), encoding="utf-8")
    return folder.open_course(place)


def keys(course: Course) -> dict[str, Mapping[str, tuple[AskedValue, ...]]]:
    """All keys of a course."""
    return {lab: keeping.answers(course, lab) for lab in course.all_labs()}


def form(course: Course, student: str, lab: str, answers: Mapping[str, str], date: str = "2026-09-30") -> str:
    """A form that is filled in."""
    owner = course.student(student)
    told = {"course": course.title, "student": owner.id, "lab": lab, "form": course.form(owner, lab), "date": date}
    lines = [f'{name} = "{text}"' for name, text in [*told.items(), *answers.items()]]
    return "\n".join([*lines, ""])


def texts(asked: Sequence[AskedValue], rng: random.Random, change: Change | None = None) -> dict[str, str]:
    """Answers in three digits, as people write them."""
    found = {}
    for each in asked:
        value = each.value if change is None else change(each)
        if value is not None:
            numbers = np.ravel(value).tolist()
            written = [f"{x:.0f}" if not each.relative else "0" if x == 0 else spelled(x, rng) for x in numbers]
            found[each.name] = "; ".join(written)
    return found


def experiment(asked: Sequence[AskedValue], seed: int, runs: int = 60, scale: float = 1.0) -> str:
    """A record of errors."""
    P, draws = record.variances(record.tested(asked)[0]), np.random.default_rng(seed)
    rows = [",".join(["run", *("i", "j")[: P.ndim], "error"])]
    for run in range(runs):
        for place in np.ndindex(P.shape):
            error = scale * np.sqrt(P[place]) * draws.standard_normal()
            rows.append(",".join([str(run + 1), *(str(i + 1) for i in place), f"{error:.7g}"]))
    return "\n".join(rows) + "\n"


def hand_in(course: Course, root: Path, student: str, lab: str, text: str, table: str = "", encoding: str = "utf-8") -> Path:
    """Put a form, and a record, where a student would."""
    place = root / student / lab
    place.mkdir(parents=True, exist_ok=True)
    (place / "answers.toml").write_bytes(text.encode(encoding))
    if table:
        (place / "experiment.csv").write_text(table, encoding="utf-8")
    return place / "answers.toml"
