"""A grading run: all labs of a course, then what is written of it; what stood there goes only when the new is whole."""

from __future__ import annotations

import shutil
import tempfile
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ctlabs.course import copies, keeping, submissions
from ctlabs.course.copies import Likeness
from ctlabs.course.folder import Course
from ctlabs.course.grading import LabResult, Total, lab_result, total
from ctlabs.course.submissions import Noted, Submission
from ctlabs.course.telling import Tell, nobody
from ctlabs.labs.together import several
from ctlabs.reporting.render import swap

#: Folder of the grades in that of the course.
GRADES = "grades"


@dataclass(frozen=True, slots=True)
class Graded:
    """All results of a course by student and lab, the totals, the copies, and what could not be read."""

    course: Course
    results: Mapping[str, Mapping[str, LabResult]]
    totals: Mapping[str, Total]
    copies: Sequence[Likeness]
    problems: Sequence[str]


def grade(course: Course, folder: Path, workers: int = 1, tell: Tell = nobody) -> Graded:
    """The grades of a course from what was handed in; ``tell`` is called with the labs that are done, how many there are, and the name
    of the one in hand, or of the last. Workers change nothing.

    Raises
    ------
    ValueError
        The folder is none, or the course's own tables cannot be read.
    """
    noted = submissions.noted(course)
    found, problems = submissions.collect(course, folder)
    by_lab: dict[str, list[Submission]] = defaultdict(list)
    for each in found:
        by_lab[each.lab].append(each)
    labs = [lab for lab in course.all_labs() if by_lab[lab] or any(key[1] == lab for key in noted)]
    results: dict[str, dict[str, LabResult]] = {each.id: {} for each in course.students}
    met: list[Likeness] = []
    jobs = [(course, lab, by_lab[lab], noted) for lab in labs]
    for lab, own, theirs, wrong in _done(jobs, workers, tell):
        for student, result in own.items():
            results[student][lab] = result
        met += theirs
        problems += wrong
    ordered = {student: {lab: own[lab] for lab in labs if lab in own} for student, own in results.items()}
    totals = {each.id: total(course, each, ordered[each.id]) for each in course.students}
    met.sort(key=lambda each: (each.chance, each.lab, each.student, each.other))
    return Graded(course, ordered, totals, met, sorted(set(problems)))


Job = tuple[Course, str, list[Submission], Mapping[tuple[str, str], Noted]]
Done = tuple[str, dict[str, LabResult], list[Likeness], list[str]]


def _done(jobs: Sequence[Job], workers: int, tell: Tell) -> list[Done]:
    """The labs' results in their order."""
    found: dict[str, Done] = {}
    if workers == 1 or len(jobs) < 2:
        for job in jobs:
            found[job[1]] = graded_lab(job, partial(_tell_of, tell, len(found), len(jobs), job[1]))
            tell(len(found), len(jobs), job[1])
        return list(found.values())
    for done in several(graded_lab, jobs, workers):
        found[done[0]] = done
        tell(len(found), len(jobs), done[0])
    return [found[job[1]] for job in jobs]


def _tell_of(tell: Tell, done: int, total: int, lab: str, _number: int) -> None:
    """A lab is in hand."""
    tell(done, total, lab)


def graded_lab(job: Job, told: Callable[[int], object] = int) -> Done:
    """All results of a lab, the copies in it, and why it could not be graded where it could not; ``told`` of each student before."""
    course, lab, found, noted = job
    try:
        keys = keeping.answers(course, lab, told)
    except ValueError as error:
        return lab, {}, [], [f"{lab}: not graded: {error}"]
    results: dict[str, LabResult] = {}
    for number, student in enumerate(course.takers(lab)):
        told(number)
        own = [each for each in found if each.student == student.id]
        said = noted.get((student.id, lab), Noted())
        if own:
            place = course.place(student, lab)
            assert place is not None  # for a taker has it
            results[student.id] = lab_result(course, student, place, keys[student.id], own, said)
    return lab, results, copies.copies(lab, keys, results, len(course.all_labs())), []


def write(graded: Graded, pages: Callable[[Graded], Mapping[str, str]]) -> Path:
    """Put the grades into the course's folder, all or nothing: ``pages`` gives each file's text by its name."""
    folder = graded.course.folder / GRADES
    for old in graded.course.folder.glob(f".{GRADES}-*-old"):  # a run before was killed between two renames, or after them
        if folder.exists():
            shutil.rmtree(old, ignore_errors=True)
        else:
            old.rename(folder)
    place = Path(tempfile.mkdtemp(prefix=f".{GRADES}-", dir=graded.course.folder))
    try:
        for name, text in pages(graded).items():
            path = place / name
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8", newline="")
        place.chmod(0o755)
        swap(place, folder)
    finally:
        shutil.rmtree(place, ignore_errors=True)
    return folder
