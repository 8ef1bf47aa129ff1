"""The commands of a course: ``ctlabs course new``, ``issue``, ``key``, ``test``."""

from __future__ import annotations

import os
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ctlabs.cli.common import Commands, can_write, checked, whole

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from ctlabs.course.folder import Course

FOLDER = click.argument("folder", type=click.Path(path_type=Path), default=Path())
LABS = click.option("--lab", "labs", multiple=True, metavar="LAB", help="Of this lab only. Repeatable.")
STUDENTS = click.option("--student", "students", multiple=True, metavar="NAME", help="Of this student only. Repeatable.")
WORKERS = click.option(
    "--workers", type=str, metavar="N", callback=whole(1), default=os.cpu_count() or 1, show_default="all cores",
    help="Labs, or hand-outs, made at a time; the files do not depend on it.",
)  # fmt: skip


@click.group(cls=Commands)
def course() -> None:
    """A course from one roster: personal variants, keys, grades.

    In plain files, with nothing sent anywhere.

    \b
    ctlabs course new FOLDER          course.toml and roster.csv, to be filled in
    ctlabs course test FOLDER         try every student's problems
    ctlabs course issue FOLDER        hand-outs/STUDENT/LAB: statement.html, answers.toml
    ctlabs course key FOLDER          the teacher's edition
    ctlabs course grade SUBMITTED     marks for what came back
    """


@course.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--title", default="", help="Title of the course.")
def new(folder: Path, title: str) -> None:
    """Begin a course: write FOLDER/course.toml and FOLDER/roster.csv, both to be edited."""
    from ctlabs.course import folder as folders

    can_write(folder)
    for path in checked(lambda: folders.new(folder, title)):
        click.echo(str(path))
    click.echo(f"Now put your students into {folder / folders.ROSTER}, and read {folder / folders.COURSE}.")


@course.command()
@FOLDER
@LABS
@STUDENTS
@click.option("--pdf", is_flag=True, help="Also statement.pdf (extra: print).")
@WORKERS
def issue(folder: Path, labs: tuple[str, ...], students: tuple[str, ...], pdf: bool, workers: int) -> None:
    """Write a hand-out for every student and lab, into FOLDER/handouts/STUDENT/LAB.

    The same folder gives the same files, byte for byte. No file of a student holds an answer.
    """
    from ctlabs.course import issue as issuing

    found, names, chosen = _opened(folder, labs, students)
    if pdf:
        from ctlabs.labs import printing

        checked(printing.programs)
    can_write(folder)
    work = partial(issuing.issue, found, students=chosen)
    count = sum(each["count"] for each in _progress(work, names, workers, "lab"))
    click.echo(f"{count} hand-outs in {folder / 'handouts'}")
    if pdf:
        places = [place for place, _title in issuing.handouts(found, names, chosen)]
        made = sum(each["count"] for each in _progress(issuing.papers, places, workers, "PDF"))
        click.echo(f"{made} of them as PDF")


@course.command()
@FOLDER
@LABS
@STUDENTS
@click.option("--reports", is_flag=True, help="Also the full reports with each student's numbers; this takes some seconds each.")
@click.option("--runs", metavar="N", callback=whole(1), help="Runs of the experiments in the reports (default: each lab's own).")
@WORKERS
def key(folder: Path, labs: tuple[str, ...], students: tuple[str, ...], reports: bool, runs: int | None, workers: int) -> int:
    """Write the teacher's edition into FOLDER/key: each student's answers, with what counts as right.

    key.csv holds all of them; STUDENT/LAB.html and LAB.toml one student's. Keep this folder to yourself.
    """
    from ctlabs.course import edition

    found, names, chosen = _opened(folder, labs, students)
    can_write(folder)
    rows = [row for each in _progress(partial(edition.edition, found), names, workers, "lab") for row in each["rows"]]
    click.echo(str(edition.table(found, rows)))
    failed = False
    if reports:
        for done in _progress(partial(edition.report, found, runs), _jobs(found, names, chosen), workers, "report"):
            failed |= bool(done["failed"])
            for name in done["failed"]:
                click.echo(f"{done['student']} {done['lab']}: failed: {name}", err=True)
    return int(failed)


@course.command()
@FOLDER
@LABS
@STUDENTS
@click.option("--runs", metavar="N", callback=whole(1), type=str, default=20, show_default=True, help="Runs of each experiment.")
@WORKERS
def test(folder: Path, labs: tuple[str, ...], students: tuple[str, ...], runs: int, workers: int) -> int:
    """Try every student's problems: run the labs, compare the reports with the keys.

    What fails is drawn anew and tried again; FOLDER/redrawn.toml keeps it. Do this before the hand-outs are given out.
    """
    from ctlabs.course import trial

    found, names, chosen = _opened(folder, labs, students)
    can_write(folder)
    jobs, offenders = _jobs(found, names, chosen), []
    for _round in range(trial.ROUNDS):
        results = list(_progress(partial(trial.tried, found, runs), jobs, workers, "problem"))
        offenders = sorted((each for each in results if each["wrong"]), key=lambda each: (each["student"], each["lab"]))
        for each in offenders:
            click.echo(f"{each['student']} {each['lab']}: {'; '.join(each['wrong'])}")
        if not offenders:
            break
        found = trial.anew(found, offenders)
        jobs = _again(found, offenders)
    tried = len(_jobs(found, names, chosen))
    if offenders:
        click.echo(f"{len(offenders)} of {tried} problems are still wrong", err=True)
        return 1
    drawn_anew = len(set(found.redrawn))
    click.echo(f"{tried} problems tried: all checks passed, the keys are what the reports say; {drawn_anew} drawn anew")
    return 0


def _again(found: Course, offenders: list[dict[str, Any]]) -> list[tuple[str, str]]:
    """Who is to be tried once more: those drawn anew, and those below them, whose numbers may have given way to theirs."""
    first: dict[str, int] = {}
    order = [each.id for each in found.students]
    for each in offenders:
        at = order.index(each["student"])
        first[each["lab"]] = min(at, first.get(each["lab"], at))
    return [(student.id, lab) for lab, at in first.items() for student in found.takers(lab) if order.index(student.id) >= at]


def _opened(folder: Path, labs: tuple[str, ...], students: tuple[str, ...]) -> tuple[Course, list[str], frozenset[str] | None]:
    """The course, the labs and the students that are asked for."""
    from ctlabs.course.folder import open_course
    from ctlabs.labs.catalogue import find

    found = checked(lambda: open_course(folder))
    wanted = {lab.name for lab in checked(lambda: find(labs))} if labs else set(found.all_labs())
    if unknown := wanted - set(found.all_labs()):
        raise click.ClickException(f"--lab: expected labs of this course, received {', '.join(sorted(unknown))}")
    chosen = frozenset(checked(lambda: [found.student(name).id for name in students])) if students else None
    return found, [name for name in found.all_labs() if name in wanted], chosen


def _jobs(found: Course, labs: list[str], students: frozenset[str] | None) -> list[tuple[str, str]]:
    return [
        (student.id, place.lab)
        for student in found.students if students is None or student.id in students
        for place in found.labs(student) if place.lab in labs
    ]  # fmt: skip


def _progress(work: Callable[[Any], Any], jobs: list[Any], workers: int, unit: str) -> Iterable[Any]:
    """Results as they are ready, with a bar on a terminal; what is refused ends the command in one line."""
    from ctlabs.labs.together import several

    results = several(work, jobs, workers)
    if sys.stderr.isatty():
        from tqdm import tqdm

        results = tqdm(results, total=len(jobs), unit=unit, leave=False)
    try:
        yield from results
    except (ValueError, ArithmeticError) as error:
        raise click.ClickException(str(error)) from None
