"""A teacher with a course in a folder, in a real browser: from the folder to hand-outs, grades and a student's view.

Fixtures and rules are those of :mod:`tests.workbench_browser`: nothing on the console, nothing to another machine.
"""
# ruff: noqa: F811  # fixtures are imported, and named as arguments

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

import pytest

from ctlabs.course.folder import Course
from ctlabs.course.pages import PLAIN
from tests.course import a_course
from tests.workbench_browser import (  # noqa: F401  # fixtures
    PHONE,
    Tab,
    Visit,
    Workbench,
    another,
    opened,
    until,
    visit,
    workbench,
)

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]
Visits = Callable[..., Visit]

#: A title that would be a picture, or a script, where it were not text.
HOSTILE = "<img src=x onerror=alert(1)> & <script>document.title='taken'</script>"
COURSE = a_course.COURSE.replace('a = ["1* 7", "11 16*"]', 'a = ["7 16*"]').replace("Stochastic models", HOSTILE)


@pytest.fixture
def course(tmp_path: Path) -> Course:
    """A course of three students, one of whom has handed in a lab, with a hostile name for a file."""
    made = a_course.made(tmp_path / "autumn", 3, COURSE)
    student = made.students[0]
    right = a_course.texts(a_course.keys(made)["task07"][student.id], random.Random(1))
    a_course.hand_in(made, tmp_path / "autumn" / "submitted", student.id, "task07", a_course.form(made, student.id, "task07", right))
    (tmp_path / "autumn" / "submitted" / "a<b onload=x>.txt").write_text("no form")
    return made


def text(tab: Tab, test: str) -> str:
    return tab.get(test).first.inner_text()


def open_course(tab: Tab, course: Course) -> None:
    """Type the folder and open it."""
    tab.field("course-path").fill(str(course.folder))
    tab.get("course-open").click()
    tab.get("course-roster").wait_for()


def test_a_teacher_issues_grades_and_looks(visit: Visits, course: Course) -> None:
    """Refused, opened, issued, seen as a student, graded, read; hostile texts are text; the course is there after a reload."""
    tab = visit().tab("course")
    tab.field("course-path").fill(str(course.folder.parent))
    tab.press("Enter")
    tab.page.wait_for_selector("[data-test=course-error]:has-text('expected the file of a course')")
    open_course(tab, course)
    assert text(tab, "course-title") == HOSTILE
    assert text(tab, "course-error") == ""
    assert course.students[1].name in text(tab, "course-roster")
    assert "2026-10-15" in text(tab, "course-labs")
    assert "not been issued" in text(tab, "course-missing")

    tab.get("course-issue-run").click()
    tab.page.wait_for_selector("[data-test=course-there]:has-text('6 of 6 hand-outs')")
    assert len(list(course.folder.glob("handouts/*/*/answers.toml"))) == 6
    frame = tab.page.frame_locator("[data-test=course-frame-handout]")
    frame.locator("h1").first.wait_for()
    assert course.students[0].name in frame.locator("body").inner_text()
    assert tab.get("course-frame-handout").get_attribute("sandbox") == ""
    name, content = tab.saved(lambda: tab.page.click("[data-test=course-handout] a:has-text('answers.toml')"))
    assert (name, content) == ("answers.toml", (course.handout(course.students[0], "task07") / "answers.toml").read_bytes())

    assert tab.field("course-submitted").input_value() == str(course.folder / "submitted")
    tab.get("course-grade-run").click()
    tab.page.wait_for_selector("[data-test=course-found]:has-text('1 labs graded, 0 like another’s, 1 problem')")
    tab.get("course-problems").click()
    tab.page.wait_for_selector("[data-test=course-problems]:has-text('a<b onload=x>.txt')")
    overview = tab.page.frame_locator("[data-test=course-frame-grades]")
    overview.locator("h1", has_text=HOSTILE).wait_for()
    overview.locator("a", has_text=course.students[0].name).click()
    overview.locator("h1", has_text=course.students[0].name).or_(overview.locator("body", has_text="task07")).first.wait_for()
    with tab.page.context.expect_page() as feedback:
        tab.page.click(f"[data-test=course-grades] table a:has-text('{course.students[0].name}')")
    feedback.value.wait_for_load_state()
    assert course.students[0].name in feedback.value.locator("body").inner_text()
    feedback.value.close()

    tab.page.reload()
    tab.ready()
    tab.page.wait_for_selector("[data-test=course-there]:has-text('6 of 6 hand-outs')")
    assert "taken" not in tab.page.title()
    until(lambda: tab.unnamed() == [])


def test_issuing_is_cancelled_and_leaves_whole_hand_outs(visit: Visits, tmp_path: Path) -> None:
    """Grading waits meanwhile; the work goes on while another page is shown."""
    course = a_course.made(tmp_path / "autumn", 30)
    tab = visit().tab("course")
    open_course(tab, course)
    tab.get("course-issue-run").click()
    tab.page.wait_for_selector("[data-test=course-issue-told]:has-text('of 120 hand-outs')")
    assert tab.get("course-grade-run").is_disabled()
    tab.go("keep")
    tab.go("course")
    until(lambda: list(course.folder.glob("handouts/*/*/answers.toml")))
    tab.get("course-issue-cancel").click()
    tab.page.wait_for_selector("[data-test=course-issue-told]:has-text('Cancelled')")
    made = list(course.folder.glob("handouts/*/*"))
    assert 0 < len(made) < 120
    assert all({path.name for path in each.iterdir()} == {"answers.toml", "statement.html", "statement.md"} for each in made)
    tab.page.wait_for_selector(f"[data-test=course-there]:has-text('{len(made)} of 120 hand-outs')")


#: What would leave its frame, the page or this machine, if it could.
PAGE = """<!doctype html><html><head></head><body><h1>hostile</h1><script>parent.document.title = "taken"</script>
<img src="/x.png" onerror="parent.document.title = 'taken'"><iframe src="/model"></iframe>
<meta http-equiv="refresh" content="0; url=/model"></body></html>"""


def test_what_a_hostile_file_says_is_not_done(visit: Visits, course: Course) -> None:
    """A hand-out and grades that somebody has put into the folder: they are shown, and nothing of them runs."""
    handout, grades = course.handout(course.students[0], "task07"), course.folder / "grades"
    for place in (handout, grades):
        place.mkdir(parents=True)
    (handout / "statement.html").write_text(PAGE)
    (grades / "course.html").write_text(PAGE)
    rows = [["name", "group", *PLAIN], [course.students[0].name, "G", *["<img src=x onerror=alert(1)>"] * len(PLAIN)]]
    (grades / "grades.csv").write_text("".join(",".join(row) + "\n" for row in rows), encoding="utf-8")
    tab = visit().tab("course")
    tab.visit.forgiven = "sandbox|Content Security Policy"
    open_course(tab, course)
    assert text(tab, "course-grades").count("<img src=x") == len(PLAIN)
    for part in ("handout", "grades"):
        frame = tab.page.frame_locator(f"[data-test=course-frame-{part}]")
        frame.locator("h1", has_text="hostile").wait_for()
    tab.page.wait_for_load_state("networkidle")
    assert "taken" not in tab.page.title()
    for what in ("img-src", "frame-src", "sandboxed"):
        until(lambda what=what: any(what in line for line in tab.visit.complaints))
    assert sum("/model" in frame.url for frame in tab.page.frames) == 0
    # The roster grows in an editor, and the next run shows it.
    with (course.folder / "roster.csv").open("a", encoding="utf-8") as file:
        file.write("Late Comer;CS-1;late@example.org\n")
    tab.get("course-grade-run").click()
    tab.page.wait_for_selector("[data-test=course-roster]:has-text('Late Comer')")
    tab.page.wait_for_selector("[data-test=course-grades] table:has-text('Late Comer')")


def test_a_folder_is_chosen_on_a_phone(visit: Visits, course: Course) -> None:
    """From the list of folders, and up; nothing is wider than the window."""
    tab = visit(viewport=PHONE, has_touch=True).tab("course")
    tab.field("course-path").fill(str(course.folder / "submitted"))
    tab.get("course-path-choose").click()
    tab.page.wait_for_selector(f"[data-test=folder-where]:has-text('{course.folder / 'submitted'}')")
    tab.get("folder-up").click()
    tab.get("folder-up").click()
    tab.page.click("[data-test=folder][aria-label='autumn: a course']")
    tab.get("folder-take").click()
    tab.get("course-roster").wait_for()
    until(lambda: tab.widest() <= 0)


def test_where_other_people_get_in_no_folder_is_opened(another: Callable[..., Workbench], visit: Visits) -> None:
    """Not by the page, and not by the address of a file."""
    server = another("--no-token")
    server.start()
    tab = visit(server).tab("course")
    tab.page.wait_for_selector("[data-test=course-closed]:has-text('other people get in')")
    assert tab.get("course-path").count() == 0
    draft = tab.page.url.partition("draft=")[2]
    found = tab.visit.context.request.get(f"{server.address}/course-files/{draft}/grades/course.html")
    assert found.status == 404
    assert tab.get("course-open").count() == 0
