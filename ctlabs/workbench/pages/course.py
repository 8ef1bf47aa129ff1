"""Course: a folder of this machine with a roster; hand-outs for everybody, grades for what comes back, a student's view."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from nicegui import ui

from ctlabs.workbench.desk.courses import CourseDesk
from ctlabs.workbench.pages.course_files import serve_files
from ctlabs.workbench.pages.course_parts import CourseWork, Grades, Handout, labs_table, roster_table
from ctlabs.workbench.pages.folders import FolderField
from ctlabs.workbench.pages.showing import Show
from ctlabs.workbench.runs.inside import line

if TYPE_CHECKING:
    from ctlabs.course.folder import Course
    from ctlabs.workbench.desk.session import Session
    from ctlabs.workbench.pages.shell import Shell

PAGE = {"place": 9, "title": "Course", "icon": "groups"}

#: How often it is looked whether the theme has changed, in seconds.
LOOK = 0.5
#: What is said where other people get in.
CLOSED = (
    "A course is a folder of this machine, with names, marks and the secret from which all keys follow. So this page opens none where "
    "other people get in: start ctlabs workbench without --host and without --no-token, on the machine where the folder is."
)


def page(session: Session, shell: Shell) -> None:
    """Draw the page."""
    shell.name_draft(session.title)
    with ui.element("div").classes("ctl-course"):
        if shell.desk.private:
            _CoursePage(session, shell).draw()
        else:
            with Show(shell).card("Course", "course.folder", test="course-closed"):
                ui.label(CLOSED).props("role=status")


class _CoursePage:
    """The page in one tab."""

    def __init__(self, session: Session, shell: Shell) -> None:
        self.session, self.shell, self.show = session, shell, Show(shell)
        self.desk: CourseDesk = session.courses
        self.running = self.desk.running
        self.seen = self.running.finished
        self.drawn: Course | None = None  # the course as it is shown
        self.works: list[CourseWork] = []
        self.grades: Grades | None = None
        self.handout: Handout | None = None
        serve_files(shell.desk)

    def draw(self) -> None:
        with self.show.card("Course", "course.folder", test="course-folder") as card:
            self.card = card.section
            self.path = FolderField(self.shell, "Folder of the course", self.desk.left, "course-path", self._open)
            with ui.row().classes("gap-2 items-center"):
                ui.button("Open", icon="login", on_click=lambda: self._open(self.path.text)).props("no-caps data-test=course-open")
                self.close = ui.button("Close", icon="close", on_click=self._close).props("no-caps flat dense data-test=course-close")
                self.close.props["aria-label"] = "Close the course"
            self.wrong = ui.label("").classes("ctl-show-error").props("role=alert data-test=course-error")
            self.title = ui.label("").classes("ctl-course-title").props("data-test=course-title")
            self.about = ui.label("").classes("ctl-show-hint").props("role=status aria-live=polite data-test=course-about")
        self.body = ui.element("div").classes("ctl-course-body")
        self.shell.shortcut("alt+shift+x", "Cancel the work on the course", self.running.cancel)
        self.shell.on_leave(self.running.watch(self._look))
        ui.timer(LOOK, self._theme)
        self._fill()
        if self.desk.left and not self.running.running:
            ui.timer(0, lambda: self._open(self.desk.left), once=True)

    # The course --------------------------------------------------------------------------------------------------------

    async def _open(self, text: str) -> None:
        """Open what is typed or chosen; what was open stays where that is none."""
        if self.running.running:
            self.shell.tell("Work on this course goes on: cancel it first")
            return
        try:
            await asyncio.to_thread(self.desk.open, text)
            problem = ""
        except ValueError as why:
            problem = line(why)
        with self.card:
            self.wrong.text = problem
            if not problem:
                self._fill()

    def _close(self) -> None:
        if not self.running.running:
            self.desk.close()
            self.path.field.value, self.wrong.text = "", ""
            self._fill()

    def _fill(self) -> None:
        """Draw what is open."""
        course = self.drawn = self.desk.course
        self.close.set_visibility(course is not None)
        self.title.set_visibility(course is not None)
        self.works, self.grades, self.handout = [], None, None
        self.body.clear()
        if course is None:
            self.about.text = "No course is open. The command “ctlabs course new FOLDER” begins one."
            return
        self.path.field.value, self.title.text = str(course.folder), course.title
        told = [course.term, course.words.get("teacher", ""), f"{len(course.students)} students", f"{len(course.all_labs())} labs"]
        self.about.text = " · ".join(each for each in told if each)
        with self.body:
            with self.show.card("Roster", "course.roster", test="course-roster"):
                self.roster = ui.html("", sanitize=False).classes("ctl-course-table")
            with self.show.card("Labs", "course.labs", test="course-labs"):
                ui.html(labs_table(course), sanitize=False).classes("ctl-course-table")
            self._draw_issue()
            self._draw_grades()
            with self.show.card("A student’s view", "course.handout", test="course-handout"):
                self.handout = Handout(self.shell, self.session.draft.id, self.desk)
        self._issued()
        self._look()

    def _draw_issue(self) -> None:
        with self.show.card("Hand-outs", "course.issue", test="course-issue"):
            self.there = ui.label("").props("data-test=course-there")
            self.works.append(CourseWork(self.desk, "issue", "Issue", "assignment", "hand-outs", self._issue))

    def _draw_grades(self) -> None:
        with self.show.card("Grades", "course.grade", test="course-grade"):
            self.submitted = FolderField(self.shell, "Folder with what was handed in", self.desk.submitted, "course-submitted", self._grade)
            self.works.append(CourseWork(self.desk, "grade", "Grade", "grading", "labs", lambda: self._grade(self.submitted.text)))
            self.grades = Grades(self.show, self.shell, self.session.draft.id, self.desk)

    def _issued(self) -> None:
        """How many hand-outs there are."""
        course = self.desk.course
        if course is not None:
            self.roster.content, self.there.text = roster_table(course)

    # Work --------------------------------------------------------------------------------------------------------------------

    def _issue(self) -> None:
        self.running.start(self.desk.issue, "issue")

    def _grade(self, text: str) -> None:
        work = self.works[-1]
        try:
            self.submitted.field.value = self.desk.take(text)
        except ValueError as why:
            work.wrong.text = line(why)
            return
        self.running.start(self.desk.grade, "grade")

    def _look(self) -> None:
        """Show how far it is, and what has come of it."""
        now = self.running
        with self.card:
            for work in self.works:
                work.look()
            if now.running or self.desk.course is None:
                return
            ended = now.finished != self.seen
            self.seen = now.finished
            if ended:
                self._renew()
            if now.name == "issue" and (ended or now.cancelled or now.problem):
                self._issued()
                if self.handout is not None:
                    self.handout.draw()
            if now.name == "grade" and ended and self.grades is not None:
                self.grades.draw()

    def _renew(self) -> None:
        """Work has read the files of the course anew: if they have been edited, so does the page."""
        try:
            self.desk.again()
        except ValueError as why:
            self.wrong.text = line(why)
        if self.desk.course != self.drawn:
            self._fill()

    def _theme(self) -> None:
        """Frames follow the colours of the workbench."""
        for part in (self.grades, self.handout):
            if part is not None:
                part.theme()
