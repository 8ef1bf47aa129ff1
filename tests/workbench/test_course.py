"""The course on a desk: folders of this machine, hand-outs and grades by work that can be cancelled, files that a page leads to."""

from __future__ import annotations

import asyncio
import random
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from ctlabs.course import grades, pages
from ctlabs.course.folder import open_course
from ctlabs.course.issue import issue_all, issued
from ctlabs.workbench.desk import courses
from ctlabs.workbench.desk.courses import CourseDesk
from ctlabs.workbench.desk.session import Session
from ctlabs.workbench.desk.store import Store
from ctlabs.workbench.pages.course_parts import labs_table, roster_table
from ctlabs.workbench.runs.catalogue import themed
from ctlabs.workbench.runs.courses import grade_course, issue_course
from ctlabs.workbench.runs.inside import Unwanted
from tests.course import a_course

COURSE = a_course.COURSE.replace('a = ["1* 7", "11 16*"]', 'a = ["7 16*"]')
#: A hand-out without its PDF.
FILES = {"statement.md", "statement.html", "answers.toml"}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A course of three students and two labs, with hand-outs, and with what one of them handed in."""
    place = tmp_path_factory.mktemp("course") / "autumn"
    course = a_course.made(place, 3, COURSE)
    assert issue_course(str(place)) == 6
    student = course.students[0]
    right = a_course.texts(a_course.keys(course)["task07"][student.id], random.Random(1))
    a_course.hand_in(course, place / "submitted", student.id, "task07", a_course.form(course, student.id, "task07", right))
    return place


@pytest.fixture
def place(whole: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    return Path(shutil.copytree(whole, tmp_path / "autumn"))


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    store = Store(tmp_path / "data")
    yield Session.begin(store)
    store.close()


@pytest.fixture
def desk(session: Session) -> CourseDesk:
    return session.courses


def files(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


class Stop:
    """Ends work at the so-manyth thing that it tells of the wanted kind."""

    def __init__(self, at: int, wanted: Callable[[int, int, str], bool] = lambda *_told: True) -> None:
        self.left, self.wanted = at, wanted
        self.told: list[tuple[int, int, str]] = []

    def __call__(self, done: int, total: int, words: str) -> None:
        self.told.append((done, total, words))
        self.left -= self.wanted(done, total, words)
        if self.left < 0:
            raise Unwanted


# Folders ---------------------------------------------------------------------------------------------------------------


def test_a_course_is_opened_by_its_folder_and_taken_up_with_the_draft(place: Path, session: Session) -> None:
    """Its submissions are looked for where teachers keep them; both are noted."""
    desk = session.courses
    assert desk.open(f" {place}/../autumn ").title == "Stochastic models"
    assert desk.submitted == str(place / "submitted")
    again = Session.resume(session.store, session.draft.id).courses
    assert (again.course, again.left, again.submitted) == (None, str(place), desk.submitted)
    again.close()
    assert Session.resume(session.store, session.draft.id).courses.left == ""


@pytest.mark.parametrize(
    ("text", "words"),
    [("", "received nothing"), *((text, "received no folder") for text in ("/no/such/place", "a\0b", "~no-such-user/x", "x" * 5000))],
)
def test_what_is_no_folder_is_refused_in_words(desk: CourseDesk, text: str, words: str) -> None:
    """And nothing is open then."""
    with pytest.raises(ValueError, match=f"expected a folder with a course, {words}"):
        desk.open(text)
    assert desk.course is None


def test_a_folder_without_a_right_course_is_refused_and_the_other_stays(desk: CourseDesk, place: Path, tmp_path: Path) -> None:
    """With the words of the reader."""
    course = desk.open(str(place))
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match="expected the file of a course"):
        desk.open(str(tmp_path / "empty"))
    (tmp_path / "empty" / "course.toml").write_text('title = "T"\n')
    with pytest.raises(ValueError, match="secret: expected 16 characters or more"):
        desk.open(str(tmp_path / "empty"))
    assert desk.course is course


def test_folders_are_listed_with_what_is_a_course(place: Path, tmp_path: Path) -> None:
    """Files and hidden folders are left out."""
    for name in (".hidden", "Zoo", "beta"):
        (tmp_path / name).mkdir()
    (tmp_path / "file").touch()
    assert courses.inside(tmp_path) == [("autumn", True), ("beta", False), ("Zoo", False)]
    with pytest.raises(ValueError, match="expected a folder that can be read"):
        courses.inside(tmp_path / "file")


# Hand-outs -------------------------------------------------------------------------------------------------------------


def test_the_desk_issues_what_the_command_issues(desk: CourseDesk, place: Path, tmp_path: Path) -> None:
    """The same bytes, in the same folders."""
    shutil.rmtree(place / "handouts")
    desk.open(str(place))
    assert asyncio.run(desk.issue()) == 6
    other = Path(shutil.copytree(place, tmp_path / "other"))
    shutil.rmtree(other / "handouts")
    issue_all(open_course(other))
    assert files(place / "handouts") == files(other / "handouts")


def test_progress_counts_hand_outs_and_ends_with_all(place: Path) -> None:
    """It never goes back, and every hand-out is told of before it is written."""
    shutil.rmtree(place / "handouts")
    stop = Stop(1000)
    issue_course(str(place), stop)
    counts = [done for done, total, _ in stop.told]
    assert {total for _, total, _ in stop.told} == {6}
    assert counts == sorted(counts)
    assert set(counts) == set(range(7))
    assert stop.told[0][2].startswith("Lab 7, 1 of 2")


@pytest.mark.parametrize("at", range(6))
def test_cancelled_the_hand_outs_that_are_there_are_whole(place: Path, at: int) -> None:
    """Wherever it is cancelled; nothing else is left behind, and issuing again gives all of them."""
    before = files(place / "handouts")
    shutil.rmtree(place / "handouts")
    with pytest.raises(Unwanted):
        issue_course(str(place), Stop(at, lambda _done, _total, words: words.endswith("hand-outs")))
    made = sorted((place / "handouts").glob("*/*"))
    assert len(made) == at
    assert all({path.name for path in each.iterdir()} == FILES for each in made)
    assert sum(map(len, issued(open_course(place)).values())) == at
    issue_course(str(place))
    assert files(place / "handouts") == before


def test_drawing_can_be_cancelled_before_anything_is_written(place: Path) -> None:
    """A lab's numbers are drawn for all before the first hand-out is there."""
    (place / "course.toml").write_text(COURSE.replace("0123456789", "9876543210"))
    shutil.rmtree(place / "handouts")
    with pytest.raises(Unwanted):
        issue_course(str(place), Stop(2, lambda _done, _total, words: "numbers of" in words))
    assert not (place / "handouts").exists()


# Grades ----------------------------------------------------------------------------------------------------------------


def test_the_desk_grades_as_the_command_does(desk: CourseDesk, place: Path) -> None:
    """The table that is shown is the one in the folder, by the library's own run."""
    course = desk.open(str(place))
    assert pages.kept_grades(course) == []
    asyncio.run(desk.grade())
    assert desk.found is not None
    assert (desk.found.labs, desk.found.copies, desk.found.problems) == (1, 0, ())
    expected = pages.files(grades.grade(course, place / "submitted"))
    written = files(place / "grades")
    assert written == {name: text.encode() for name, text in expected.items()}
    rows = pages.kept_grades(course)
    assert [row["name"] for row in rows] == [each.name for each in course.students]
    assert rows[0]["mark"] != rows[1]["mark"] or rows[0]["remarks"]


def test_cancelled_the_grades_of_before_stay(place: Path) -> None:
    """At every moment at which a run can be cancelled."""
    grade_course(str(place), str(place / "submitted"))
    before = files(place / "grades")
    shutil.rmtree(place / "submitted")
    (place / "submitted").mkdir()
    all_told = Stop(1000)
    grade_course(str(place), str(place / "submitted"), all_told)
    assert files(place / "grades") != before
    after = files(place / "grades")
    (place / "grades" / "grades.csv").write_text("mark of the old ones")
    for at in range(len(all_told.told)):
        with pytest.raises(Unwanted):
            grade_course(str(place), str(place / "submitted"), Stop(at))
        assert (place / "grades" / "grades.csv").read_text() == "mark of the old ones"
        assert {path.name for path in place.iterdir() if "grades" in path.name} == {"grades"}
    grade_course(str(place), str(place / "submitted"))
    assert files(place / "grades") == after


def test_a_table_that_is_none_of_ours_is_refused(place: Path) -> None:
    """Saved by a spreadsheet with other separators, or something else altogether."""
    course = open_course(place)
    (place / "grades").mkdir()
    for text in ("name;group;mark\nA;B;1\n", "\ufeffname,group\nA,B\n"):
        (place / "grades" / "grades.csv").write_text(text, encoding="utf-8")
        with pytest.raises(ValueError, match=r"grades\.csv: expected the columns"):
            pages.kept_grades(course)
    (place / "grades" / "grades.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ValueError, match="expected the table of a grading run"):
        pages.kept_grades(course)


def test_a_folder_of_submissions_that_is_none_is_refused(desk: CourseDesk, place: Path) -> None:
    """Before anything runs."""
    desk.open(str(place))
    with pytest.raises(ValueError, match="expected a folder with what students handed in, received no folder"):
        desk.take(str(place / "none"))
    assert desk.submitted == str(place / "submitted")


def test_a_folder_that_cannot_be_written_is_told_in_a_line(place: Path) -> None:
    """A file stands where the hand-outs belong."""
    shutil.rmtree(place / "handouts")
    (place / "handouts").touch()
    with pytest.raises(ValueError, match="expected a folder that can be written"):
        issue_course(str(place))


# Files of a page -------------------------------------------------------------------------------------------------------


def test_a_page_leads_to_hand_outs_and_grades_and_to_nothing_else(desk: CourseDesk, place: Path) -> None:
    """Not to the secret, not to the keys, not out of the folder."""
    course = desk.open(str(place))
    student = course.students[0].id
    grade_course(str(place), str(place / "submitted"))
    for path in (f"handout/{student}/task07/statement.html", "grades/course.html", "grades/grades.csv", f"grades/feedback/{student}.html"):
        assert desk.file(path).is_file()
    for path in (
        "course.toml", "grades/../course.toml", "key/task07.json", "grades/feedback/../../course.toml", "grades/feedback/Nobody.html",
        f"handout/{student}/task01/statement.html", f"handout/{student}/../../key/task07.json", "handout/Nobody/task07/statement.html",
        f"handout/{student}/task07/../../../../course.toml", "", "/", f"handout//{place}",
    ):  # fmt: skip
        with pytest.raises(ValueError, match="expected"):
            desk.file(path)


def test_a_link_that_leads_out_of_the_folder_is_not_followed(desk: CourseDesk, place: Path, tmp_path: Path) -> None:
    """A hand-out that is none."""
    course = desk.open(str(place))
    (tmp_path / "private").write_text("mine")
    target = course.handout(course.students[0], "task07") / "answers.toml"
    target.unlink()
    target.symlink_to(tmp_path / "private")
    with pytest.raises(ValueError, match="received one elsewhere"):
        desk.file(f"handout/{course.students[0].id}/task07/answers.toml")


# What is shown ---------------------------------------------------------------------------------------------------------


def test_tables_tell_students_labs_days_and_stars(place: Path) -> None:
    """As the folder has them."""
    course = open_course(place)
    roster, words = roster_table(course)
    assert words == "6 of 6 hand-outs are in the folder."
    assert roster.count("7 16*") == roster.count("2 of 2") == 3
    labs: Any = labs_table(course)
    assert "2026-10-01" in labs
    assert "2026-10-15" in labs
    assert ">A*<" in labs
    shutil.rmtree(place / "handouts")
    assert roster_table(course)[1] == "No hand-out is in the folder yet; there will be 6."


def test_pages_take_the_colours_of_the_workbench(place: Path) -> None:
    """All of their style sheets, and none of their text."""
    course = open_course(place)
    text = pages.files(grades.grade(course, place / "submitted"))["course.html"]
    assert "prefers-color-scheme: dark" in text
    assert "prefers-color-scheme" not in themed(text, "dark")
    assert "color-scheme: dark" in themed(text, "dark")
    assert themed(text, "auto") == text
    assert themed("<head></head>@media (prefers-color-scheme: dark)", "dark") == "<head></head>@media (prefers-color-scheme: dark)"
