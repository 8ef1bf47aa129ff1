"""The bank of questions, read back by a reader of its own: XML by the standard library, gaps by the grammar that Moodle documents."""

from __future__ import annotations

import csv
import html
import io
import re
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from ctlabs.course import moodle
from ctlabs.course.asked import THREE_DIGITS, AskedValue
from ctlabs.course.folder import Course
from tests.course import a_course

LABS = ("task03", "task07", "task16")


class Choice(NamedTuple):
    """An answer that a gap knows: its number, the tolerance, the part of the mark, the feedback."""

    number: float
    tolerance: float
    fraction: float
    feedback: str


def choices(inside: str) -> list[Choice]:
    r"""What a NUMERICAL gap holds: answers parted by ~, each ``[=|%n%]number:tolerance[#feedback]``; \ keeps a sign from parting."""
    found = []
    for part in re.split(r"(?<!\\)~", inside):
        match = re.fullmatch(r"(?:(=)|%(-?\d+(?:[.,]\d*)?)%)?(.+?)(?:(?<!\\|&)#(.*))?", part, re.DOTALL)
        assert match, part
        number = re.fullmatch(r"(-?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][-+]?\d+)?)(?::((?:\d+[.,]?\d*|[.,]\d+)(?:[eE][-+]?\d+)?))?", match[3])
        assert number, match[3]
        fraction = 1.0 if match[1] else float(match[2] or 0) / 100
        found.append(Choice(float(number[1]), float(number[2] or 0), fraction, html.unescape(match[4] or "")))
    return found


def gaps(text: str) -> list[list[Choice]]:
    r"""The gaps of a question: ``{weight:NUMERICAL:…}``, to the first brace that neither \ nor & keeps."""
    return [choices(match[1]) for match in re.finditer(r"\{\d*:(?:NUMERICAL|NM):(.*?)(?<!\\)\}", text, re.DOTALL)]


@pytest.fixture(scope="module")
def course(tmp_path_factory: pytest.TempPathFactory) -> Course:
    return a_course.made(tmp_path_factory.mktemp("course"), 2)


@pytest.fixture(scope="module")
def written(course: Course) -> str:
    return moodle.xml(list(moodle.bank(course, LABS, 3)))


def test_the_bank_is_read_back(course: Course, written: str) -> None:
    """Each value of each variant is one question whose gaps take the right number and refuse one that is 2 % off."""
    root = ET.fromstring(written)
    assert root.tag == "quiz"
    assert {each.get("type") for each in root} == {"category", "cloze"}
    found = {each.findtext("idnumber"): each for each in root if each.get("type") == "cloze"}
    wanted = {
        f"{lab}-{value.name}-{variant}": value
        for lab in LABS
        for variant, each in enumerate(moodle.several(course, lab, 3), 1)
        for value in each.answers
    }
    assert found.keys() == wanted.keys()
    for number, value in wanted.items():
        text = found[number].findtext("questiontext/text") or ""
        assert found[number].findtext("name/text")
        flat = np.ravel(value.value)
        read = gaps(text)
        assert len(read) == min(flat.size, moodle.GAPS), number
        for right, gap in zip(flat.tolist(), read, strict=False):
            full = [each for each in gap if each.fraction == 1]
            assert len(full) == 1
            assert abs(full[0].number - right) <= 1e-9 * abs(right)
            assert abs(float(f"{right:.3g}") - full[0].number) <= full[0].tolerance * (1 + 1e-9)
            if value.relative and right:
                assert abs(1.02 * right - full[0].number) > full[0].tolerance
            for each in gap:
                if each is not full[0]:
                    assert each.fraction == 0.5
                    assert abs(each.number - right) > full[0].tolerance + each.tolerance  # nothing is right and half right
                    assert each.feedback.startswith(("another convention: ", "right but for the sign"))


def test_categories_name_course_lab_and_value(written: str) -> None:
    paths = [each.text or "" for each in ET.fromstring(written).iterfind("question/category/text")]
    assert all(path.startswith("$course$/top/Stochastic models/Lab ") for path in paths)
    assert len(set(paths)) == len(paths)


def test_a_question_shows_the_numbers_of_its_variant(course: Course, written: str) -> None:
    questions = ET.fromstring(written).iterfind("question[@type='cloze']")
    root = {each.findtext("idnumber"): each.findtext("questiontext/text") or "" for each in questions}
    for variant, each in enumerate(moodle.several(course, "task07", 3), 1):
        text = root[f"task07-gain_steady-{variant}"]
        assert rf"\({each.parameters.Q:g}\)" in text  # type: ignore[attr-defined]
        assert "variance of the process noise w" in text


def test_signs_that_mean_something_in_a_gap_come_back(course: Course) -> None:
    words = 'a}b~c#d"e\\f&g<h>i{j'
    value = AskedValue("K", "a", "K", "gain", "1", np.array(0.5), THREE_DIGITS, 0.0, {words: np.array(0.7)})
    read = gaps("x " + moodle.gap(value, 0, {words: 0.7}) + " {2:NM:=1:0}")
    assert [each.feedback for each in read[0]] == ["", f"another convention: {words}", "right but for the sign"]
    assert read[1] == [Choice(1, 0, 1, "")]


@pytest.mark.parametrize("text", ["{1:NUMERICAL:=5:1}", "$K_{1}$ {2:SA:x}", "{:NM:=1}", "{#1}", "]]>"])
def test_a_sheet_makes_no_gap_and_ends_no_text(text: str) -> None:
    made = moodle.prose(text)
    assert not re.search(r"\{\d*:[A-Z_]+:|\{#\d", made)
    assert ET.fromstring(f"<t>{moodle.cdata(made)}</t>").text == made


def test_the_same_course_gives_the_same_bytes(course: Course, written: str) -> None:
    assert moodle.xml(list(moodle.bank(course, LABS, 3))) == written


def test_the_table_has_every_element(course: Course, tmp_path: Path) -> None:
    path = tmp_path / "questions.csv"
    moodle.write(path, moodle.table(course, ["task07"], 2))
    rows = list(csv.DictReader(io.StringIO(path.read_text(encoding="utf-8"))))
    variants = moodle.several(course, "task07", 2)
    assert len(rows) == sum(value.value.size for each in variants for value in each.answers)
    row = next(row for row in rows if row["value"] == "gain" and row["variant"] == "2" and row["place"] == "3")
    value = next(value for value in variants[1].answers if value.name == "gain")
    assert float(row["right"]) == pytest.approx(value.value[2], rel=1e-9)
    assert float(row["allowed"]) == pytest.approx(value.allowed[2], rel=1e-9)
