"""The course that a person has open: its folder on this machine, and the long work on it; everything but the page.

desk = session.courses
desk.open("~/autumn")                            # desk.course, or a ValueError in words
await desk.issue(progress, cancel)               # handouts/STUDENT/LAB
await desk.grade(progress, cancel)               # grades/, from desk.submitted; desk.found says what came of it

Folders are this machine's: only where nobody else gets in (:attr:`~ctlabs.workbench.desk.desk.Desk.private`) may a page offer it.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from ctlabs.workbench.runs.running import Running
from ctlabs.workbench.runs.worker import here

if TYPE_CHECKING:
    from ctlabs.course.folder import Course
    from ctlabs.workbench.desk.store import Draft, Store
    from ctlabs.workbench.runs.courses import CourseGrades
    from ctlabs.workbench.runs.worker import Cancel, Runner, RunProgress

#: How long it may take, and how long until it stops between two files when it is cancelled, s.
LONGEST, PATIENCE = 4 * 3600.0, 60.0
#: Files of a hand-out, and of the grades, that a page leads to.
HANDOUT = ("statement.html", "statement.pdf", "statement.md", "answers.toml")
GRADES = ("course.html", "grades.csv", "moodle.csv", "copies.csv", "problems.txt")
#: Most folders that are listed to choose from.
LISTED = 500
Show = Callable[["RunProgress"], object]


class CourseSession(Protocol):
    """What is needed of a session."""

    draft: Draft
    store: Store
    runner: Runner | None


class CourseDesk:
    """The course of one draft.

    ``course`` that is open · ``submitted``, the folder with what students handed in · ``found`` by the last grading run ·
    ``running``, the work that goes on
    """

    def __init__(self, session: CourseSession) -> None:
        self.session, self.running = session, Running()
        self.course: Course | None = None
        self.found: CourseGrades | None = None
        noted = session.draft.notes.get("course")
        told = noted if isinstance(noted, dict) else {}
        #: The folder that was open when the draft was left.
        self.left = str(told.get("folder", ""))
        self.submitted = str(told.get("submitted", ""))

    def open(self, text: str) -> Course:
        """Open the course in a folder, and note it with the draft.

        Raises
        ------
        ValueError
            There is none, or it cannot be read.
        """
        from ctlabs.course.folder import open_course  # not before there is one: it loads the catalogue of labs

        place = folder(text, "a folder with a course")
        found = open_course(place)
        if self.course is None or self.course.folder != place:
            self.found = None
            noted, usual = self.submitted if self.left == str(place) else "", place / "submitted"
            self.submitted = noted or (str(usual) if usual.is_dir() else "")
        self.course, self.left = found, str(place)
        self._note()
        return found

    def again(self) -> None:
        """Read the course anew: its files may have been edited, or work has changed what there is.

        Raises
        ------
        ValueError
            It cannot be read any more.
        """
        if self.course is not None:
            self.open(str(self.course.folder))

    def close(self) -> None:
        """Without a course."""
        self.course, self.found, self.left, self.submitted = None, None, "", ""
        self._note()

    def take(self, text: str) -> str:
        """Where submissions are; its whole path.

        Raises
        ------
        ValueError
            There is no such folder.
        """
        self.submitted = str(folder(text, "a folder with what students handed in"))
        self._note()
        return self.submitted

    def _note(self) -> None:
        self.session.store.note(self.session.draft.id, course={"folder": self.left, "submitted": self.submitted})

    async def issue(self, progress: Show | None = None, cancel: Cancel | None = None) -> int:
        """Write all hand-outs; those that are there when it is cancelled are whole."""
        count: int = await self._run("course_issue", {"folder": str(self._needed().folder)}, progress, cancel)
        return count

    async def grade(self, progress: Show | None = None, cancel: Cancel | None = None) -> None:
        """Grade :attr:`submitted`; cancelled, the grades of before stay."""
        arguments = {"folder": str(self._needed().folder), "submitted": self.submitted}
        self.found = await self._run("course_grade", arguments, progress, cancel)

    def _needed(self) -> Course:
        if self.course is None:
            raise ValueError("course: expected one that is open, received none")
        return self.course

    async def _run(self, name: str, arguments: dict[str, Any], progress: Show | None, cancel: Cancel | None) -> Any:
        if self.session.runner is not None:
            return await self.session.runner.run(
                name, arguments, session=self.session.draft.id, progress=progress, cancel=cancel, seconds=LONGEST, patience=PATIENCE
            )
        return await here(name, arguments)

    def file(self, path: str) -> Path:
        """A file of the open course that a page leads to: ``handout/STUDENT/LAB/NAME``, ``grades/NAME``, ``grades/feedback/STUDENT.html``.

        Raises
        ------
        ValueError
            There is none of this name, or it lies elsewhere.
        """
        course = self._needed()
        match path.split("/"):
            case ["handout", student, lab, name] if name in HANDOUT and lab in {each.lab for each in course.labs(course.student(student))}:
                found = course.handout(course.student(student), lab) / name
            case ["grades", name] if name in GRADES:
                found = course.folder / "grades" / name
            case ["grades", "feedback", name] if name.endswith(".html"):
                found = course.folder / "grades" / "feedback" / f"{course.student(name.removesuffix('.html')).id}.html"
            case _:
                raise ValueError(f"{path}: expected a hand-out or grades of the course, received another file")
        if not found.resolve().is_relative_to(course.folder.resolve()):  # a link that leads out of the folder
            raise ValueError(f"{path}: expected a file in the folder of the course, received one elsewhere")
        return found


def folder(text: str, what: str) -> Path:
    """A folder that is typed, as a whole path: ``~`` is one's own, and what does not begin at a root lies in the present one.

    Raises
    ------
    ValueError
        There is none.
    """
    plain = text.strip().strip('"')
    if not plain:
        raise ValueError(f"folder: expected {what}, received nothing")
    try:
        found = Path(plain).expanduser().resolve()
        there = found.is_dir()
    except (OSError, RuntimeError, ValueError):  # no permission, no such user, a sign that no path has
        there = False
    if not there:
        raise ValueError(f"{plain[:200]}: expected {what}, received no folder of this machine")
    return found


def inside(place: Path) -> list[tuple[str, bool]]:
    """The folders in a folder, and whether each holds a course; hidden ones are left out.

    Raises
    ------
    ValueError
        It cannot be read.
    """
    try:
        found = [each for each in place.iterdir() if not each.name.startswith(".") and each.is_dir()]
        return [(each.name, is_course(each)) for each in sorted(found, key=lambda each: each.name.lower())[:LISTED]]
    except OSError as why:
        raise ValueError(f"{place}: expected a folder that can be read, received: {why.strerror}") from None


def is_course(place: Path) -> bool:
    """Whether a folder holds a course."""
    try:
        return (place / "course.toml").is_file()
    except OSError:
        return False
