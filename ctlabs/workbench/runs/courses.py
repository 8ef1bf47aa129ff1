"""The long work of a course, as a run of its own: hand-outs for everybody, and grades for what came back.

Labs are taken one after the other: a process of the worker begins none of its own. What a run is cancelled at lies between two files,
so that every hand-out that is there is whole; grades change all at once or not at all.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from ctlabs.course import grades, pages
from ctlabs.course.folder import open_course
from ctlabs.course.issue import issue_all
from ctlabs.course.telling import Tell, nobody


class CourseGrades(NamedTuple):
    """What a grading run found: labs that were graded, answers like another student's, and what could not be read."""

    labs: int
    copies: int
    problems: tuple[str, ...]


def issue_course(folder: str, progress: Tell = nobody) -> int:
    """Write the hand-outs of the course in a folder; how many there are.

    Raises
    ------
    ValueError
        The folder holds no course, or cannot be written.
    """
    with _writing(folder):
        return issue_all(open_course(Path(folder)), progress)


def grade_course(folder: str, submitted: str, progress: Tell = nobody) -> CourseGrades:
    """Grade what was handed in, by the rules of the course in ``folder``, and write its ``grades``.

    Raises
    ------
    ValueError
        The folder holds no course or cannot be written, or ``submitted`` is no folder.
    """
    with _writing(folder):
        found = grades.grade(open_course(Path(folder)), Path(submitted), tell=progress)
        labs = sum(map(len, found.results.values()))
        progress(1, 1, "writing")  # the last chance to be cancelled
        grades.write(found, pages.files)
    return CourseGrades(labs, len(found.copies), tuple(found.problems))


@contextmanager
def _writing(folder: str) -> Iterator[None]:
    """A folder that cannot be written is the user's affair, and told in a line."""
    try:
        yield
    except OSError as why:
        raise ValueError(f"{folder}: expected a folder that can be written, received: {why.strerror or why}") from why
