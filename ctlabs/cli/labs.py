"""The commands on the practicum's labs: ``list``, ``show``, ``run``."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ctlabs.cli.common import can_write, checked, settings, whole

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from ctlabs.labs.catalogue import Lab
    from ctlabs.labs.experiment import Experiment


@click.command("list")
def list_() -> None:
    """The labs, and the variants of the practicum.

    A star marks a control lab; extensions are no part of the practicum.
    """
    from ctlabs.labs import catalogue as labs

    for lab in labs.catalogue().values():
        click.echo(f"{lab.short:>15}  {lab.title}  [{lab.source}]{'  (extension)' if lab.extension else ''}")
    click.echo("\nVariants (ctlabs run variant-a); * = control lab:")
    for letter in labs.VARIANTS:
        row = "  ".join(f"{int(name[4:])}{'*' if starred else ''}" for name, starred in labs.variant(letter))
        click.echo(f"      variant-{letter}  {row}")


@click.command()
@click.argument("lab")
def show(lab: str) -> None:
    """A lab's question, parts and parameters.

    LAB: 7, 07, task07, field, …
    """
    from ctlabs.labs import catalogue as labs
    from ctlabs.text import number

    for entry in checked(lambda: labs.find([lab])):
        module = labs.load(entry)
        click.echo(f"{entry.name}: {entry.title}\n{entry.source}\n\n{(module.__doc__ or '').strip()}\n")
        click.echo(f"Parts: {', '.join(entry.parts)}\n\nParameters (--set NAME=VALUE):")
        defaults = module.Parameters()
        for name, info in type(defaults).model_fields.items():
            shown = number(getattr(defaults, name))
            click.echo(f"  {name:>14} = {shown:<24} {info.json_schema_extra['unit']:<8} {info.description}")
        click.echo("")


def _formats(_context: click.Context, _option: click.Parameter, asked: str) -> tuple[str, ...]:
    """The formats of ``--format``: pdf, docx, tex, html, md."""
    from ctlabs.labs.printing import FORMATS

    found = tuple(word.strip().lower() for word in asked.split(",") if word.strip())
    if unknown := [word for word in found if word not in FORMATS]:
        msg = f"--format: expected some of {', '.join(FORMATS)}, received {', '.join(unknown)}"
        raise click.ClickException(msg)
    return found


def _title(formats: tuple[str, ...], path: Path | None) -> dict[str, str]:
    """What the title page says; refused before anything is computed, as is a program that is missing."""
    from ctlabs.labs import printing

    title = {} if path is None else checked(lambda: printing.title_page(path))
    if printing.ON_PAPER & set(formats):
        checked(printing.programs)
    return title


def _print(out: Path, names: list[str], formats: tuple[str, ...], title: dict[str, str]) -> None:
    """The files on paper of some reports."""
    from ctlabs.labs import printing

    if not printing.ON_PAPER & set(formats):
        return
    for name in names:
        for path in printing.make(out / name, formats, title):
            click.echo(f"{'':<15} {path}")


@click.command()
@click.option("--out", type=click.Path(path_type=Path), default=Path("reports"), show_default=True, help="Folder of the reports.")
@click.option("--format", "formats", metavar="KIND,…", callback=_formats, default="pdf", show_default=True, help="pdf, docx, tex or md.")
@click.option("--title-page", type=click.Path(path_type=Path), metavar="FILE.toml", help="What a title page says, as in ctlabs run.")
def book(out: Path, formats: tuple[str, ...], title_page: Path | None) -> int:
    """All labs as one document, from their reports.

    \b
    ctlabs run all && ctlabs book
    """
    from ctlabs.labs import book as books

    if "html" in formats or not formats:
        raise click.ClickException("--format: expected some of pdf, docx, tex, md, for a book, received html or none")
    title = _title(formats, title_page)
    if absent := books.missing(out):
        msg = f"--out {out}: expected the reports of all labs (ctlabs run all --out {out}), received none of {', '.join(absent)}"
        raise click.ClickException(msg)
    for kind in formats:
        click.echo(str(books.write(out, kind, title)))
    return 0


@click.command()
@click.argument("lab", nargs=-1, required=True, metavar="LAB...")
@click.option(
    "--set",
    "pairs",
    multiple=True,
    metavar="NAME=VALUE",
    help='A parameter: a number, "inf", or a JSON list. task07.Phi=1 addresses one lab. Repeatable.',
)
@click.option(
    "--runs",
    metavar="N",
    callback=whole(1),
    help="Runs of the computational experiment (default: the lab's own, usually 1000).",
)
@click.option(
    "--seed",
    type=str,
    metavar="N",
    callback=whole(0),
    default=1,
    show_default=True,
    help="Seed of the random numbers.",
)
@click.option(
    "--workers",
    type=str,
    metavar="N",
    callback=whole(1),
    default=os.cpu_count() or 1,
    show_default="all cores",
    help="Labs, or blocks of runs, computed at a time; the results do not depend on it.",
)
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("reports"), show_default=True, help="Folder for the reports."
)
@click.option(
    "--resume",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Keep finished blocks of runs in DIR; the same command goes on from there after an interruption.",
)
@click.option(
    "--format",
    "formats",
    metavar="KIND,…",
    callback=_formats,
    default="html,md",
    show_default=True,
    help="Also write report.pdf, report.docx or report.tex (extra: print).",
)
@click.option(
    "--title-page",
    type=click.Path(path_type=Path),
    metavar="FILE.toml",
    help="What a title page says: university, course, student, group, variant, teacher, date, …",
)
@click.option("--scheduler", metavar="ADDR", help="Compute on a Dask cluster: tcp://host:8786 (extra: cluster).")
def run(
    lab: tuple[str, ...],
    pairs: tuple[str, ...],
    runs: int | None,
    seed: int,
    workers: int,
    out: Path,
    resume: Path | None,
    formats: tuple[str, ...],
    title_page: Path | None,
    scheduler: str | None,
) -> int:
    """Run labs and write their reports.

    LAB: 7, 07, task07, field, slow_error, coloured_plant, all, variant-a (b, c).

    \b
    ctlabs run 7
    ctlabs run 7 --set Phi=1.3 --set Q=0 --runs 10000
    ctlabs run 6 --set R='[2, 4, "inf", 1, 3, 0, 5]'
    ctlabs run 3 --runs 1000000 --resume work     a long experiment that may be interrupted
    ctlabs run 7 --format pdf --title-page me.toml     to hand in
    """
    from ctlabs.labs import catalogue as labs

    chosen = checked(lambda: labs.find(lab))
    values = checked(lambda: labs.parameters(chosen, settings(pairs)))
    _writable(out, [entry.name for entry in chosen])
    title = _title(formats, title_page)
    from ctlabs.labs import course
    from ctlabs.labs.experiment import Experiment
    from ctlabs.montecarlo import BlockFailed, Interrupted

    together = 1 if scheduler else min(workers, len(chosen))  # labs at a time, each with its share of the workers
    jobs = [
        (
            entry,
            values[entry.name],
            Experiment(
                runs or entry.runs, seed, max(1, workers // together), scheduler, resume and resume / entry.name
            ),
            out,
            tuple(each.name for each in chosen),
        )
        for entry in chosen
    ]
    failed = False
    try:
        for done in progressing(run_all(jobs, together), len(jobs)):
            failed |= bool(done["failed"]) or not done["checks"]
            page = out / done["lab"] / "report.html"
            click.echo(f"{done['lab']:<15} {_verdict(done)}, {done['seconds']:.1f} s: {page}")
            for name in done["failed"]:
                click.echo(f"{'':<15} failed: {name}", err=True)
    except (ArithmeticError, BlockFailed) as error:
        raise click.ClickException(str(error)) from None
    except ValueError as error:
        if not str(error).startswith(("checkpoint:", "executor:", "scheduler:")):
            raise
        raise click.ClickException(str(error)) from None
    except Interrupted as error:
        click.echo(f"ctlabs: {error}", err=True)
        return 130
    course.write_index(out, anew=len(chosen) == len(labs.catalogue()))
    _print(out, [entry.name for entry in chosen], formats, title)
    return int(failed)


def _verdict(done: dict[str, Any]) -> str:
    if done["failed"]:
        return f"{len(done['failed'])} of {done['checks']} checks failed"
    return f"all {done['checks']} checks passed" if done["checks"] else "no checks, which is no success"


def run_all(jobs: list[tuple[Lab, Any, Experiment, Path, tuple[str, ...]]], together: int) -> Iterator[dict[str, Any]]:
    """Run the labs, ``together`` of them at a time in processes of their own; results in the order given."""
    from ctlabs.labs.together import several

    yield from several(_written, jobs, together, ordered=True)


def _written(job: tuple[Lab, Any, Experiment, Path, tuple[str, ...]]) -> dict[str, Any]:
    from ctlabs.labs import catalogue as labs

    return labs.run_and_write(*job)


def progressing(items: Iterable[dict[str, Any]], total: int) -> Iterable[dict[str, Any]]:
    """A bar on a terminal while several labs run; nothing elsewhere."""
    if total == 1 or not sys.stderr.isatty():
        return items
    from tqdm import tqdm

    return tqdm(items, total=total, unit="lab", leave=False)


def _writable(out: Path, names: list[str]) -> None:
    """Refuse a folder that cannot be written, or holds a file where a report should go."""
    can_write(out)
    for name in names:
        if (out / name).exists() and not (out / name).is_dir():
            msg = f"--out {out}: expected a folder {out / name} or none, received a file"
            raise click.ClickException(msg)
