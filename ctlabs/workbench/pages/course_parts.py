"""The parts of the page Course: tables of the roster and the labs, work with its progress, grades, and a hand-out in a frame."""

from __future__ import annotations

import time
from collections.abc import Callable
from html import escape
from typing import TYPE_CHECKING, Any

from nicegui import ui

from ctlabs.course.issue import issued
from ctlabs.course.pages import PLAIN, kept_grades
from ctlabs.labs.catalogue import catalogue
from ctlabs.workbench.desk.courses import GRADES, CourseDesk
from ctlabs.workbench.pages import course_files
from ctlabs.workbench.pages.course_files import address
from ctlabs.workbench.pages.showing import Show, help_button
from ctlabs.workbench.pages.tables import table
from ctlabs.workbench.runs.running import said

if TYPE_CHECKING:
    from ctlabs.course.folder import Course, LabPlace
    from ctlabs.workbench.pages.shell import Shell
    from ctlabs.workbench.runs.worker import RunProgress

#: Most students in a table, and most lines of what could not be read.
ROWS, LINES = 1000, 30


def roster_table(course: Course) -> tuple[str, str]:
    """The students as a table in HTML, and how many hand-outs there are, in words."""
    there = issued(course)
    rows = []
    for each in course.students[:ROWS]:
        labs, own = course.labs(each), there[each.id]
        variant = (each.variant or course.variant).upper()
        rows.append([each.name, each.group, variant, " ".join(map(_lab, labs)), f"{len(own)} of {len(labs)}"])
    if len(course.students) > ROWS:
        rows.append([f"and {len(course.students) - ROWS} more, in roster.csv"])
    made, total = sum(map(len, there.values())), sum(len(course.labs(each)) for each in course.students)
    words = f"{made} of {total} hand-outs are in the folder." if made else f"No hand-out is in the folder yet; there will be {total}."
    return table(["Student", "Group", "Variant", "Labs", "Hand-outs"], rows), words


def _lab(place: LabPlace) -> str:
    return catalogue()[place.lab].short + "*" * place.control


def labs_table(course: Course) -> str:
    """The labs as a table in HTML."""
    rows = []
    for lab in course.all_labs():
        places = [(letter, place) for letter, own in course.variants.items() for place in own if place.lab == lab]
        last = places[0][1]
        variants = " ".join(letter.upper() + "*" * place.control for letter, place in places)
        days = ["" if day is None else day.isoformat() for day in (last.theory, last.report)]
        rows.append([f"{catalogue()[lab].short}. {catalogue()[lab].title}", f"{len(course.takers(lab))}", variants, *days])
    return table(["Lab", "Students", "Variants", "Theory until", "Report until"], rows)


class CourseWork:
    """A button for long work, how far it is, and what ends it.

    ``name`` of the work · ``unit`` in which it is counted
    """

    def __init__(self, desk: CourseDesk, name: str, word: str, icon: str, unit: str, start: Callable[[], Any]) -> None:
        self.running, self.name, self.unit = desk.running, name, unit
        with ui.row().classes("items-center gap-2"):
            self.button = ui.button(word, icon=icon, on_click=lambda: start()).props(f"no-caps data-test=course-{name}-run")
            self.cancel = ui.button("Cancel", icon="stop", on_click=self.running.cancel)
            self.cancel.props(f"no-caps outline data-test=course-{name}-cancel")
            self.told = ui.label("").classes("ctl-show-hint").props(f"role=status aria-live=polite data-test=course-{name}-told")
        self.bar = ui.linear_progress(value=0.0, show_value=False, size="8px").props(f'aria-label="Progress: {word}"')
        self.wrong = ui.label("").classes("ctl-show-error").props(f"role=alert data-test=course-{name}-error")

    def look(self) -> None:
        """Show how far it is."""
        now = self.running
        mine = now.name == self.name
        going = now.running and mine
        self.button.set_enabled(not now.running)
        self.cancel.set_visibility(going)
        self.bar.set_visibility(going)
        if going:
            self.bar.value = now.progress.fraction if now.progress is not None else 0.0
            self.told.text, self.wrong.text = self._far(now.progress), ""
        elif mine:
            self.told.text = "Cancelled; what was there stays, and is whole." if now.cancelled else ""
            self.wrong.text = now.problem

    def _far(self, progress: RunProgress | None) -> str:
        if progress is None or progress.ahead:
            return said(progress)
        left = "" if progress.left is None or progress.fraction < 0.05 else f", about {progress.left:.0f} s left"
        count = f"{progress.done} of {progress.total} {self.unit}{left}" if progress.total else "Reading…"
        return f"{count}. {progress.note}" if progress.note else count


class Grades:
    """What the last grading run has left in the folder: a table with links to the feedback, files, and the teacher's page."""

    def __init__(self, show: Show, shell: Shell, draft: str, desk: CourseDesk) -> None:
        self.show, self.shell, self.draft, self.desk = show, shell, draft, desk
        self.frame: Frame | None = None
        self.box = ui.element("div").classes("ctl-course-body").props("data-test=course-grades")
        self.draw()

    def draw(self) -> None:
        """Read it and show it."""
        self.box.clear()
        self.frame = None
        course = self.desk.course
        if course is None:
            return
        with self.box:
            try:
                rows = kept_grades(course)
            except ValueError as why:
                ui.label(str(why)).classes("ctl-show-error").props("role=alert")
                return
            if not rows:
                ui.label("Nothing has been graded yet.").classes("ctl-show-hint")
                return
            self._found()
            ui.html(self._table(course, rows), sanitize=False).classes("ctl-course-table ctl-course-grades")
            self._links()
            self._overview()

    def _found(self) -> None:
        """What the run that has just ended says."""
        found = self.desk.found
        if found is None:
            return
        count = len(found.problems)
        told = f"{found.labs} labs graded, {found.copies} like another’s, {count} {'problem' if count == 1 else 'problems'}."
        ui.label(told).props("role=status data-test=course-found")
        if found.problems:
            with ui.expansion("What could not be read", icon="report_problem").classes("w-full").props("data-test=course-problems"):
                with ui.element("ul").classes("ctl-data-list"):
                    for each in found.problems[:LINES]:
                        with ui.element("li"):
                            ui.label(each)
                if count > LINES:
                    ui.label(f"and {count - LINES} more, in problems.txt").classes("ctl-show-hint")

    def _table(self, course: Course, rows: list[dict[str, str]]) -> str:
        heads = ["Student", "Group", *(each.capitalize() for each in PLAIN)]
        body = []
        for row in rows[:ROWS]:
            cells = "".join(f"<td>{escape(row[key])}</td>" for key in ("group", *PLAIN))
            body.append(f'<tr><th scope="row">{self._named(course, row["name"])}</th>{cells}</tr>')
        top = "".join(f'<th scope="col">{escape(head)}</th>' for head in heads)
        return (
            '<div class="ctl-show-scroll" tabindex="0" role="region" aria-label="Grades"><table class="ctl-show-table">'
            f"<thead><tr>{top}</tr></thead><tbody>{''.join(body)}</tbody></table></div>"
        )

    def _named(self, course: Course, name: str) -> str:
        """A name that leads to the feedback; one that is no more in the roster leads nowhere."""
        try:
            link = address(self.draft, f"grades/feedback/{course.student(name).id}.html", theme=self.shell.theme)
        except ValueError:
            return escape(name)
        return f'<a href="{escape(link)}" target="_blank" rel="noopener">{escape(name)}</a>'

    def _links(self) -> None:
        with ui.element("div").classes("ctl-course-links"):
            for name in GRADES[1:]:
                with ui.element("a").props(f'href="{address(self.draft, f"grades/{name}")}" download="{name}"'):
                    ui.label(name)

    def _overview(self) -> None:
        with ui.element("div").classes("ctl-show-head"):
            ui.html("<h3>Who has handed in what</h3>", sanitize=False)
            help_button("course.handed")
            ui.space()
            back = ui.button("Overview", icon="arrow_back", on_click=self._back)
            back.props('flat dense no-caps size=sm aria-label="Back to the overview of the course"')
        self.frame = Frame(self.shell, self.draft, "grades/course.html", "Who has handed in what", course_files.GRADES)

    def _back(self) -> None:
        if self.frame is not None:
            self.frame.again()

    def theme(self) -> None:
        """Follow the colours of the workbench."""
        if self.frame is not None:
            self.frame.theme()


class Handout:
    """One hand-out as its student sees it."""

    def __init__(self, shell: Shell, draft: str, desk: CourseDesk) -> None:
        self.shell, self.draft, self.desk = shell, draft, desk
        self.frame: Frame | None = None
        course = desk.course
        students = {} if course is None else {each.id: each.name for each in course.students}
        with ui.element("div").classes("ctl-course-choices"):
            self.student = ui.select(students, value=next(iter(students), None), label="Student", with_input=True, on_change=self._whose)
            self.student.props("outlined dense options-dense data-test=course-student")
            self.lab = ui.select({}, label="Lab", on_change=lambda: self.draw())
            self.lab.props("outlined dense options-dense data-test=course-lab")
        self.box = ui.element("div").classes("ctl-course-body")
        self._whose()

    def _whose(self) -> None:
        """The labs of the student who is chosen."""
        course = self.desk.course
        if course is None or not self.student.value:
            return
        own = {each.lab: f"{_lab(each)}. {catalogue()[each.lab].title}" for each in course.labs(course.student(self.student.value))}
        self.lab.set_options(own, value=self.lab.value if self.lab.value in own else next(iter(own)))
        self.draw()

    def draw(self) -> None:
        """Show the hand-out, if there is one."""
        self.box.clear()
        self.frame = None
        course, student, lab = self.desk.course, self.student.value, self.lab.value
        if course is None or not student or not lab:
            return
        place = course.handout(course.student(student), lab)
        with self.box:
            if not (place / "statement.html").is_file():
                ui.label("This hand-out has not been issued yet.").classes("ctl-show-hint").props("data-test=course-missing")
                return
            with ui.element("div").classes("ctl-course-links"):
                for name in ("answers.toml", "statement.pdf", "statement.md"):
                    if (place / name).is_file():
                        with ui.element("a").props(f'href="{address(self.draft, f"handout/{student}/{lab}/{name}")}" download="{name}"'):
                            ui.label(name)
            self.frame = Frame(
                self.shell, self.draft, f"handout/{student}/{lab}/statement.html", "The hand-out", course_files.HANDOUT
            )

    def theme(self) -> None:
        """Follow the colours of the workbench."""
        if self.frame is not None:
            self.frame.theme()


class Frame:
    """A file of the course in a frame that can do nothing but be read."""

    def __init__(self, shell: Shell, draft: str, path: str, title: str, sandbox: str) -> None:
        self._shell, self._draft, self._path, self._theme = shell, draft, path, ""
        self._element = ui.element("iframe").classes("ctl-course-frame").props(f"data-test=course-frame-{path.partition('/')[0]}")
        self._element.props["title"], self._element.props["sandbox"] = title, sandbox
        self.again()

    def again(self) -> None:
        """Read the file anew; another address each time, so that none is taken from the browser's memory."""
        self._theme = self._shell.theme
        self._element.props["src"] = address(self._draft, self._path, theme=self._theme, v=time.monotonic_ns())
        self._element.update()

    def theme(self) -> None:
        """Follow the colours of the workbench."""
        if self._theme != self._shell.theme:
            self.again()
