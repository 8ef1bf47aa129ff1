"""What a student may see of a form, and what it costs; the commands."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from click.testing import CliRunner

from ctlabs.cli import cli
from ctlabs.course import checking
from ctlabs.course.folder import Course
from tests.course import a_course


@pytest.fixture
def course(tmp_path: Path) -> Course:
    return a_course.made(tmp_path / "course", 2)


def filled(course: Course, root: Path, **answers: str) -> Path:
    student = course.students[0].id
    asked = a_course.keys(course)["task07"][student]
    found = a_course.texts(asked, random.Random(1)) | answers
    return a_course.hand_in(course, root, student, "task07", a_course.form(course, student, "task07", found))


def told(found: checking.CheckedForm) -> dict[str, checking.FormLine]:
    return {line.name: line for line in found.lines}


def test_a_form_is_shown_as_it_is_read(course: Course, tmp_path: Path) -> None:
    path = filled(course, tmp_path, gain_steady="52,3 %", noiseless_limit="", gain="1; 2", prior_variance_steady="0.5 m")
    found = checking.check(path)
    lines = told(found)
    assert (lines["gain_steady"].read, lines["noiseless_limit"].read, found.empty, found.good) == ("0.523", "", 1, False)
    assert lines["gain"].wrong.endswith("expected 5 numbers (5), received 2")
    assert lines["prior_variance_steady"].wrong.endswith("expected m², received another unit")
    assert not any(line.verdict for line in found.lines)


def test_nothing_that_a_student_sees_depends_on_the_key(course: Course, tmp_path: Path) -> None:
    """The same file with right and with wrong numbers is told alike, but for the numbers themselves."""
    right, wrong = (checking.check(filled(course, tmp_path / text, gain_steady=text)) for text in ("0.5", "0.9"))
    assert [(line.name, line.wrong) for line in right.lines] == [(line.name, line.wrong) for line in wrong.lines]


def test_attempts_are_counted_and_end(course: Course, tmp_path: Path) -> None:
    path = filled(course, tmp_path, gain_steady="0.98765")
    first = checking.attempt(course, path, 2)
    assert (told(first)["gain_steady"].verdict, told(first)["gain"].verdict, first.left) == ("wrong", "right", 1)
    assert checking.attempt(course, path, 2).left == 1  # the same answers again
    second = checking.attempt(course, filled(course, tmp_path, gain_steady="0.98764"), 2)
    assert (told(second)["gain_steady"].verdict, second.left) == ("wrong", 0)
    third = checking.attempt(course, filled(course, tmp_path), 2)
    assert not any(line.verdict for line in third.lines)
    assert third.problems == ("expected at most 2 attempts, received one more",)


def test_no_verdict_holds_an_answer(course: Course, tmp_path: Path) -> None:
    path = filled(course, tmp_path, gain_steady="0.98765")
    answer = {each.name: each for each in a_course.keys(course)["task07"][course.students[0].id]}["gain_steady"]
    made = CliRunner().invoke(cli, ["course", "check", str(path), "--attempts", "3", "--course", str(course.folder)])
    assert f"{float(answer.value):.3g}" not in made.output.split("gain_optimal")[0]
    assert "wrong: 0.9877" in made.output
    assert "Attempts left: 2" in made.output


@pytest.mark.parametrize(
    ("text", "said"),
    [("x = 1\n", "expected a form of a course"), ('lab = "99"\n', "expected a lab"), ("\x00", "received a binary file")],
)
def test_what_is_no_form_is_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "a.toml").write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=f"^a.toml: .*{said}"):
        checking.check(tmp_path / "a.toml")


def test_the_commands_of_a_teacher(course: Course, tmp_path: Path) -> None:
    filled(course, tmp_path / "in", gain_steady="0.98765")
    run = CliRunner().invoke
    made = run(cli, ["course", "check", str(tmp_path / "in" / course.students[0].id / "task07" / "answers.toml")])
    assert "The record of the experiment, a CSV file beside the form: columns run, i = 1 … 5, error" in made.output
    made = run(cli, ["course", "grade", str(tmp_path / "in"), "--course", str(course.folder), "--workers", "1"])
    assert "1 labs of 2 students graded, 0 like another's, 0 problems" in made.output
    assert (course.folder / "grades" / "grades.csv").is_file()
    made = run(cli, ["course", "export", "--moodle", "--variants", "2", "--lab", "16", str(course.folder)])
    assert (course.folder / "questions.xml").is_file()
    assert made.exit_code == 0
    made = run(cli, ["course", "export", "--csv", "--variants", "1", "--lab", "16", str(course.folder)])
    assert (course.folder / "questions.csv").is_file()
    absent = str(tmp_path / "none")
    for arguments in (["export"], ["check", absent], ["check", absent, "--attempts", "2"], ["grade", absent]):
        made = run(cli, ["course", *arguments])
        assert made.exit_code == 1
        assert "expected" in made.output
