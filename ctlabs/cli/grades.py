"""The commands of a course after its hand-outs: ``ctlabs course check``, ``grade``, ``export``."""

from __future__ import annotations

import os
from pathlib import Path

import click

from ctlabs.cli.common import checked, whole

FOLDER = click.Path(path_type=Path)


@click.command()
@click.argument("answers", type=FOLDER)
@click.option("--attempts", metavar="N", callback=whole(1), help="Tell right from wrong, at most N times; needs --course.")
@click.option("--course", "folder", type=FOLDER, metavar="FOLDER", help="The folder of the course, for --attempts.")
def check(answers: Path, attempts: int | None, folder: Path | None) -> int:
    """How a form is read, before it is handed in.

    ANSWERS is the form of a lab, answers.toml. Shown is what stands for each value, as it is read, and what cannot be read; no number is
    compared with anything, and nothing secret is needed.

    With --attempts N it is also said of each value whether it is right, without the answer. This needs the key, and so works only where
    the course's folder is, in a computer class for example: any file that could tell a student right from wrong would give the
    answers to whoever tries numbers. The attempts of a student at a lab are counted in the course's folder, in attempts/; the same
    answers again are no new attempt.
    """
    from ctlabs.course import checking
    from ctlabs.course.folder import open_course

    if attempts is None:
        found = checked(lambda: checking.check(answers))
    elif folder is None:
        raise click.ClickException("--attempts: expected --course FOLDER too, for only there is the key, received none")
    else:
        found = checked(lambda: checking.attempt(open_course(folder), answers, attempts))
    width = max(len(line.name) for line in found.lines)
    for line in found.lines:
        said = f"{line.verdict}: " if line.verdict else ""
        click.echo(f"{line.name:<{width}}  {line.wrong or said + (line.read or '(empty)')}")
    for problem in found.problems:
        click.echo(problem)
    words = checking.columns(found.lab)
    click.echo(f"\n{len(found.lines) - found.empty} of {len(found.lines)} values have an answer." + (f"\n{words}" if words else ""))
    if found.left is not None:
        click.echo(f"Attempts left: {found.left}")
    return 0 if found.good else 1


@click.command()
@click.argument("submitted", type=FOLDER)
@click.option("--course", "folder", type=FOLDER, metavar="FOLDER", help="The course's folder, if it is not above SUBMITTED.")
@click.option(
    "--workers", type=str, metavar="N", callback=whole(1), default=os.cpu_count() or 1, show_default="all cores", help="Labs at a time."
)
def grade(submitted: Path, folder: Path | None, workers: int) -> int:
    """Grade what was handed in.

    SUBMITTED holds forms (answers.toml), in folders of any kind, with the record of the experiment beside each (a CSV file). Written are,
    all or nothing, in the course's folder: grades/grades.csv, grades/moodle.csv for Moodle's import of grades, a page for each student in
    grades/feedback, grades/copies.csv (answers like another student's), grades/course.html and grades/problems.txt.

    Days are those of the forms' heads, or of handed_in.csv in the course's folder (columns student, lab, theory, report, defence).
    """
    from ctlabs.course import grades, pages
    from ctlabs.course.folder import COURSE, open_course

    above = next((place for place in (Path(), *submitted.absolute().parents) if (place / COURSE).is_file()), Path())
    course = checked(lambda: open_course(folder or above))
    finished = 0

    def tell(done: int, _total: int, lab: str) -> None:
        nonlocal finished
        if done > finished:
            finished = done
            click.echo(f"{lab:<15} graded", err=True)

    graded = checked(lambda: grades.grade(course, submitted, workers, tell))
    place = checked(lambda: grades.write(graded, pages.files))
    for problem in graded.problems:
        click.echo(problem, err=True)
    count = sum(map(len, graded.results.values()))
    copies, problems = len(graded.copies), len(graded.problems)
    click.echo(f"{count} labs of {len(course.students)} students graded, {copies} like another's, {problems} problems")
    click.echo(str(place / "grades.csv"))
    return 0


@click.command()
@click.option("--moodle", "form", flag_value="moodle", help="A bank of questions in Moodle's XML.")
@click.option("--csv", "form", flag_value="csv", help="The right numbers, with tolerances, as a table.")
@click.option("--variants", type=str, metavar="N", callback=whole(1), default=5, show_default=True, help="Variants of each question.")
@click.option("--lab", "words", multiple=True, metavar="LAB", help="Only this lab. Repeatable.")
@click.option("--out", type=FOLDER, metavar="FILE", help="The file; questions.xml or questions.csv in the course's folder if left out.")
@click.argument("folder", type=FOLDER, default=Path(), required=False)
def export(form: str | None, variants: int, words: tuple[str, ...], out: Path | None, folder: Path) -> int:
    """Questions of the course's labs for other programs.

    One question for each value and variant of the numbers; the variants are no student's. In Moodle: Question bank, Import, Moodle XML
    format. The file holds the answers.
    """
    from ctlabs.course import moodle
    from ctlabs.course.folder import open_course
    from ctlabs.labs import catalogue

    if form is None:
        raise click.ClickException("export: expected --moodle or --csv, received neither")
    course = checked(lambda: open_course(folder))
    labs = [lab.name for lab in checked(lambda: catalogue.find(list(words)))] if words else list(course.all_labs())
    path = out or folder / ("questions.xml" if form == "moodle" else "questions.csv")
    if form == "moodle":
        questions = checked(lambda: list(moodle.bank(course, labs, variants)))
        moodle.write(path, moodle.xml(questions))
        click.echo(f"{len(questions)} questions on {len(labs)} labs")
    else:
        moodle.write(path, checked(lambda: moodle.table(course, labs, variants)))
    click.echo(str(path))
    return 0
