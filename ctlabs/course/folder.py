"""A course in a folder: ``course.toml`` says what it is, ``roster.csv`` who takes it; nothing of it is kept elsewhere.

``handouts/STUDENT/LAB`` holds what students get, ``key`` what they do not.
"""

from __future__ import annotations

import datetime as dt
import hashlib
import hmac
import re
import secrets
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ctlabs.course import roster
from ctlabs.course.roster import Student
from ctlabs.labs.catalogue import VARIANTS, catalogue, find
from ctlabs.text import fill

#: Files of a course's folder.
COURSE, ROSTER, REDRAWN = "course.toml", "roster.csv", "redrawn.toml"
#: Table 1 of the practicum: the mark for 1, 2, … 12 labs done.
TABLE1 = (1.7, 2.0, 2.3, 2.7, 3.0, 3.3, 3.7, 4.0, 4.3, 4.7, 5.0, 5.3)
#: Keys of course.toml that are words.
WORDS = ("title", "university", "faculty", "department", "teacher", "city", "term", "language", "variant", "secret")


@dataclass(frozen=True, slots=True)
class LabPlace:
    """A lab in a variant: its name, whether it is the control session's, part 1 or 2, last days of its theory and its report."""

    lab: str
    control: bool
    part: int
    theory: dt.date | None = None
    report: dt.date | None = None


@dataclass(frozen=True, slots=True)
class Rule:
    """How marks are made.

    ``marks`` : for 1, 2, … labs done · ``control`` : what each failed control session takes off · ``done`` : share of a lab's
    points from which it counts as done · ``theory_first`` : whether the theory must be in, in time, for the experiment to count
    """

    marks: tuple[float, ...] = TABLE1
    control: float = 0.5
    done: float = 0.6
    theory_first: bool = True


@dataclass(frozen=True, slots=True)
class Course:
    """A course as its folder says it; ``redrawn`` : how often a student's lab was drawn anew, by both names."""

    folder: Path
    title: str
    term: str
    secret: str
    variant: str
    students: tuple[Student, ...]
    variants: Mapping[str, tuple[LabPlace, ...]]
    rule: Rule = Rule()
    words: Mapping[str, str] = field(default_factory=dict)
    redrawn: Mapping[tuple[str, str], int] = field(default_factory=dict)

    def labs(self, student: Student) -> tuple[LabPlace, ...]:
        """The labs of a student's variant."""
        return self.variants[student.variant or self.variant]

    def student(self, name: str) -> Student:
        """The student with this name or folder.

        Raises
        ------
        ValueError
            There is none.
        """
        for each in self.students:
            if name.casefold() in {each.id.casefold(), each.name.casefold()}:
                return each
        msg = f"student {name}: expected one of {ROSTER}, received an unknown name"
        raise ValueError(msg)

    def takers(self, lab: str) -> tuple[Student, ...]:
        """Who has a lab, in the order of the roster."""
        return tuple(each for each in self.students if any(place.lab == lab for place in self.labs(each)))

    def all_labs(self) -> tuple[str, ...]:
        """Every lab that somebody has, in the order of the catalogue."""
        there = {place.lab for each in self.students for place in self.labs(each)}
        return tuple(name for name in catalogue() if name in there)

    def handout(self, student: Student, lab: str) -> Path:
        """The folder of a hand-out."""
        return self.folder / "handouts" / student.id / lab

    def digest(self, *words: object) -> bytes:
        """A function of the secret, the term and some words that nobody without the secret can compute.

        >>> course = Course(Path("."), "", "autumn", "s", "a", (), {})
        >>> course.digest("x") == course.digest("x") != course.digest("y")
        True
        """
        told = "\x1f".join(map(str, (self.term, *words)))
        return hmac.digest(self.secret.encode(), told.encode(), hashlib.sha256)

    def place(self, student: Student, lab: str) -> LabPlace | None:
        """A lab in a student's variant; none where it is not in it."""
        return next((each for each in self.labs(student) if each.lab == lab), None)

    def form(self, student: Student, lab: str) -> str:
        """The number of a form, by which a submitted one is known."""
        return self.digest("form", student.id, lab).hex()[:8]

    def forms(self) -> dict[str, tuple[Student, str]]:
        """Whose form a number is, and of which lab."""
        return {self.form(each, place.lab): (each, place.lab) for each in self.students for place in self.labs(each)}


def open_course(folder: Path) -> Course:
    """The course in a folder.

    Raises
    ------
    ValueError
        A file is missing, or holds what a course has not; with file, and line where there is one.
    """
    path = folder / COURSE
    try:
        text = path.read_text(encoding="utf-8-sig")
        found = tomllib.loads(text)
    except OSError as error:
        msg = f"{path}: expected the file of a course (ctlabs course new {folder}), received: {error.strerror}"
        raise ValueError(msg) from None
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        msg = f"{path}: expected TOML in UTF-8, received: {error}"
        raise ValueError(msg) from None
    told = _Told(found, text, COURSE)
    told.only("", (*WORDS, "variants", "dates", "grading"))
    words = {name: told.word(name) for name in WORDS}
    if words["language"] not in ("", "en"):
        raise told.refused("language", '"en" (hand-outs have no catalogue of another language)', words["language"])
    if len(words["secret"]) < 16:
        raise told.refused("secret", "16 characters or more, which nobody can guess", f"{len(words['secret'])}")
    if not words["title"]:
        raise told.refused("title", "words", "none")
    variants = _variants(told)
    students = roster.read(folder / ROSTER)
    variant = words["variant"].lower()
    for each in students:
        if (each.variant or variant) not in variants:
            there, received = ", ".join(variants), each.variant or variant or "none"
            msg = f"{ROSTER}: line {each.line}: expected one of the variants {there}, received {received}"
            raise ValueError(msg)
    return Course(
        folder, words["title"], words["term"], words["secret"], variant, students, variants, _rule(told), words, _redrawn(folder / REDRAWN)
    )


@dataclass(frozen=True, slots=True)
class _Told:
    """What course.toml says, and refusals that name its line."""

    found: Mapping[str, Any]
    text: str
    source: str

    def refused(self, key: str, expected: str, received: object) -> ValueError:
        last = key.rpartition(".")[2]
        line = next((i for i, each in enumerate(self.text.splitlines(), 1) if re.match(rf"\s*\"?{re.escape(last)}\"?\s*=", each)), 0)
        return ValueError(f"{self.source}:{f' line {line}:' if line else ''} {key}: expected {expected}, received {received}")

    def table(self, key: str) -> Mapping[str, Any]:
        found = self.found.get(key, {})
        if not isinstance(found, dict):
            raise self.refused(key, f"a table [{key}]", found)
        return found

    def only(self, key: str, names: tuple[str, ...]) -> None:
        table = self.table(key) if key else self.found
        for unknown in set(table) - set(names):
            raise self.refused(f"{key}.{unknown}" if key else unknown, f"keys among {', '.join(names)}", "another")

    def word(self, key: str) -> str:
        found = self.found.get(key, "")
        if not isinstance(found, str) or len(found) > 200 or not found.isprintable():
            raise self.refused(key, "words between quotation marks", found)
        return found.strip()


def _variants(told: _Told) -> dict[str, tuple[LabPlace, ...]]:
    """The labs of each variant, with their dates."""
    table = told.table("variants") or {letter: list(halves) for letter, halves in VARIANTS.items()}
    dates, found = _dates(told), {}
    for letter, halves in table.items():
        if not (isinstance(halves, list) and halves and all(isinstance(half, str) for half in halves)):
            raise told.refused(f"variants.{letter}", 'lists of labs such as ["1 2* 5", "11* 15"]', halves)
        words = [(part, word) for part, half in enumerate(halves, 1) for word in half.split()]
        places = [LabPlace(_lab(told, f"variants.{letter}", word.rstrip("*")), word.endswith("*"), part) for part, word in words]
        if len({place.lab for place in places}) < len(places) or not places:
            raise told.refused(f"variants.{letter}", "each lab once", " ".join(halves) or "none")
        found[letter.lower()] = tuple(LabPlace(p.lab, p.control, p.part, *dates.get(p.lab, (None, None))) for p in places)
    return found


def _lab(told: _Told, key: str, word: str) -> str:
    try:
        (lab,) = find([word])
    except ValueError:
        raise told.refused(key, "labs as in `ctlabs list`", word) from None
    return lab.name


def _dates(told: _Told) -> dict[str, tuple[dt.date | None, dt.date | None]]:
    found = {}
    for word, days in told.table("dates").items():
        if not (isinstance(days, dict) and set(days) <= {"theory", "report"} and all(type(day) is dt.date for day in days.values())):
            raise told.refused(f"dates.{word}", "{ theory = 2026-10-01, report = 2026-10-15 }", days)
        found[_lab(told, f"dates.{word}", word)] = (days.get("theory"), days.get("report"))
    return found


def _rule(told: _Told) -> Rule:
    told.only("grading", tuple(Rule.__dataclass_fields__))
    table, usual = told.table("grading"), Rule()

    def number(key: str, least: float, most: float, value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
            raise told.refused(f"grading.{key}", f"a number from {least:g} to {most:g}", value)
        return float(value)

    marks, first = table.get("marks", list(usual.marks)), table.get("theory_first", usual.theory_first)
    if not isinstance(marks, list) or not marks:
        raise told.refused("grading.marks", "a list: the mark for 1, 2, … labs done", marks)
    if not isinstance(first, bool):
        raise told.refused("grading.theory_first", "true or false", first)
    return Rule(
        tuple(number("marks", 0, 1000, mark) for mark in marks),
        number("control", 0, 1000, table.get("control", usual.control)),
        number("done", 0, 1, table.get("done", usual.done)),
        first,
    )


def _redrawn(path: Path) -> dict[tuple[str, str], int]:
    """How often each student's lab was drawn anew, from the file that ``ctlabs course test`` writes."""
    if not path.is_file():
        return {}
    try:
        found = tomllib.loads(path.read_text(encoding="utf-8"))
        return {(student, lab): int(row["attempt"]) for student, labs in found.items() for lab, row in labs.items()}
    except (ValueError, KeyError, TypeError, AttributeError, UnicodeDecodeError):
        msg = f"{path.name}: expected what `ctlabs course test` wrote, received another form"
        raise ValueError(msg) from None


def new(folder: Path, title: str = "", today: dt.date | None = None) -> list[Path]:
    """Write ``course.toml`` and a ``roster.csv`` to be filled in; what is there is left alone.

    Raises
    ------
    ValueError
        The folder holds a course.
    """
    if (folder / COURSE).exists():
        msg = f"{folder}: expected a folder without a {COURSE}, received one that has it"
        raise ValueError(msg)
    folder.mkdir(parents=True, exist_ok=True)
    day = today or dt.date.today()
    marks = ", ".join(f"{mark:g}" for mark in TABLE1)
    variants = "\n".join(f'{letter} = ["{one}", "{two}"]' for letter, (one, two) in VARIANTS.items())
    term = f"{'spring' if day.month < 7 else 'autumn'} {day.year}"
    clean = re.sub(r'["\\]', "", title) or "Stochastic models and estimates: laboratory practicum"
    text = fill(TEMPLATE, title=clean, term=term, secret=secrets.token_hex(16), variants=variants, marks=marks)
    (folder / COURSE).write_text(text, encoding="utf-8")
    made = [folder / COURSE]
    if not (folder / ROSTER).exists():
        (folder / ROSTER).write_text("name;group;variant\n", encoding="utf-8")
        made.append(folder / ROSTER)
    return made


TEMPLATE = """# A course. Lines that begin with # explain; everything else may be changed.
# After a change: ctlabs course issue FOLDER. What has not changed comes out byte for byte as before.

# What stands at the head of every hand-out.
title = "{title}"
university = ""
faculty = ""
department = ""
teacher = ""
city = ""
term = "{term}"
language = "en"

# The students' numbers follow from this secret, the term, the student's name and the lab. Keep it to yourself: who has it can compute
# everybody's numbers. A new term or a new secret gives new numbers.
secret = "{secret}"

# The variant of students whose line in roster.csv has none.
variant = "a"

# The labs of each variant, a part of the semester in each string; * marks the labs of its control session, one of which must be done.
# These are those of the practicum's table 2; other labs, other letters and more parts are possible (ctlabs list shows all labs).
[variants]
{variants}

# Last days, by lab: of the theory part, which admits to the experiment, and of the whole report. Labs without a line have none.
[dates]
# 1 = { theory = 2026-09-21, report = 2026-10-05 }
# 2 = { theory = 2026-10-05, report = 2026-10-19 }

[grading]
# The mark for 1, 2, 3, … labs done (the practicum's table 1).
marks = [{marks}]
# What a failed control session takes off the mark.
control = 0.5
# A lab counts as done from this share of its points on.
done = 0.6
# Whether an experiment counts only if the theory part was in, in time.
theory_first = true
"""
