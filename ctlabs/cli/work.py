"""What the commands on a model share: options, refusals, the model that a word means, the folder of the results."""

from __future__ import annotations

import contextlib
import functools
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ctlabs.cli.common import settings, whole

if TYPE_CHECKING:
    from ctlabs.files.mapping import Mapping
    from ctlabs.files.modelfile import ModelFile
    from ctlabs.reporting.report import Report

#: What ctlabs writes at the top of a result's folder; with anything else in it a folder is somebody's and is left alone.
OURS = {
    "report.md",
    "report.html",
    "results.json",
    "estimates.csv",
    "estimates.parquet",
    "draws.csv",
    "forecast.csv",
    "runs.csv",
    "data.csv",
    "fitted.toml",
    "figures",
    "tables",
}


def options(command: Callable[..., int]) -> Callable[..., int]:
    """What the commands on a model have in common."""
    path = click.Path(path_type=Path)
    for option in (
        click.option("--json", "as_json", is_flag=True, help="Print results.json instead of the table."),
        click.option(
            "--out", type=path, metavar="DIR", help="Folder for the results (default: one named after the model)."
        ),
        click.option(
            "--set",
            "pairs",
            multiple=True,
            metavar="NAME=VALUE",
            help="Another value of a constant of the model. Repeatable.",
        ),
    ):
        command = option(command)

    @functools.wraps(command)
    def mannered(**given: Any) -> int:
        with refusing(), at_work():
            return command(**given)

    return click.argument("model", metavar="MODEL")(mannered)


def seed_option() -> Callable[[Callable[..., int]], Callable[..., int]]:
    """``--seed``."""
    return click.option(
        "--seed", metavar="N", callback=whole(0), help="Seed of the random numbers (default: the model's)."
    )


@contextlib.contextmanager
def refusing() -> Iterator[None]:
    """What the library refuses becomes the command line's one line."""
    try:
        yield
    except (ValueError, TypeError, ArithmeticError) as error:
        raise click.ClickException(str(error)) from None
    except RuntimeError as error:
        from ctlabs.montecarlo import BlockFailed  # costs half a second that most commands need not spend

        if not isinstance(error, BlockFailed):
            raise
        raise click.ClickException(str(error)) from None
    except MemoryError:
        msg = "expected a task that fits into the memory, received a larger one: fewer steps, runs, states or rows"
        raise click.ClickException(msg) from None


@contextlib.contextmanager
def at_work() -> Iterator[None]:
    """A word on a terminal while there is nothing else to see; nothing elsewhere."""
    if not sys.stderr.isatty():
        yield
        return
    from ctlabs.linalg import compiled

    sys.stderr.write("compiling the filter, once on this machine (some 20 s)…" if compiled.cold() else "computing…")
    sys.stderr.flush()
    try:
        yield
    finally:
        clear()


def clear() -> None:
    """Take the word away, before anything else is written."""
    if sys.stderr.isatty():
        sys.stderr.write("\r\x1b[K")
        sys.stderr.flush()


def one_stdin(*words: str | None) -> None:
    """Refuse the standard input for several files."""
    if words.count("-") > 1:
        msg = "-: expected the standard input for one of the files, received it for several"
        raise ValueError(msg)


def model_of(
    word: str, pairs: tuple[str, ...], mapping: Mapping | None = None, tables: Sequence[tuple[bytes, str]] = ()
) -> ModelFile:
    """The model file that a word means: a path, "-", or a name of the gallery; with the regressors of the options and the tables."""
    from ctlabs.files import modelfile

    is_file = word == "-" or Path(word).is_file() or bool(Path(word).suffix) or os.sep in word
    found = modelfile.load(word, check=False) if is_file else modelfile.ready(word)
    if mapping is not None:
        found = _declared(found, mapping, tables)
        found = found.edit(("model", "dt"), mapping.dt) if mapping.dt is not None else found
    return _changed(found.checked(), settings(pairs)).checked()


def _declared(model: ModelFile, mapping: Mapping, tables: Sequence[tuple[bytes, str]]) -> ModelFile:
    """The model with the regressors of --regressor, and with names in H, R, D, B that only a column of the table has."""
    from ctlabs.files import datafile

    model = model.declaring(mapping.regressors)
    if not (tables and model.unknown):
        return model
    columns = datafile.header(*tables[0], model.mapping.over(mapping))
    met = {name: name for name in model.unknown if name in columns}
    if met:
        clear()
        click.echo(f"note: {model.name}: {', '.join(met)} in the model: the column of {tables[0][1]} of that name", err=True)
    return model.declaring(met)


def _changed(model: ModelFile, values: dict[str, object]) -> ModelFile:
    """The model with other constants: numbers, or expressions of the others."""
    for name, value in values.items():
        if isinstance(value, str) and name in model.constants:
            model = model.set_constant(name, value).checked()
        else:
            model = model.replace({name: value})  # type: ignore[dict-item]  # what is no number is refused there
    return model


def folder_of(word: str, out: Path | None, *read: str | None) -> Path:
    """Where the results go, refused before anything is computed if it is not ours to write, or holds what is ``read``."""
    folder = out if out is not None else Path("model" if word == "-" else Path(word).stem)
    what = f"--out {folder}: expected"
    if folder.resolve() in (Path.cwd(), *Path.cwd().parents):
        msg = f"{what} a folder of its own for the results, received the current one"
        raise ValueError(msg)
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        msg = f"{what} a folder or none, received a file"
        raise ValueError(msg)
    foreign = sorted(path.name for path in folder.iterdir() if path.name not in OURS) if folder.is_dir() else []
    if foreign or (folder.is_dir() and any(folder.iterdir()) and not (folder / "results.json").is_file()):
        msg = f"{what} a new or empty folder, or one that ctlabs wrote, received one with other files ({', '.join(foreign[:3])})"
        raise ValueError(msg)
    for name in (word, *read):
        if (
            name not in (None, "-")
            and Path(str(name)).is_file()
            and folder.resolve() in Path(str(name)).resolve().parents
        ):
            msg = f"{what} a folder without the files that are read, received the one with {Path(str(name)).name}: name another"
            raise ValueError(msg)
    near = next(path for path in folder.resolve().parents if path.exists())
    try:
        with tempfile.TemporaryFile(dir=near):
            pass
    except OSError as error:
        msg = f"{what} a folder that can be written, received: {error.strerror}"
        raise ValueError(msg) from None
    return folder


def outside(option: str, path: Path, folder: Path) -> None:
    """Refuse a file in the folder that is to be replaced."""
    if folder.resolve() in path.resolve().parents:
        msg = f"{option} {path}: expected a file outside the folder of the results, {folder}, received one in it"
        raise ValueError(msg)


def deliver(report: Report, folder: Path, as_json: bool, *tables: str) -> int:
    """Write the folder, print the table or the JSON; 1 if a check failed."""
    from ctlabs.reporting import render

    former = folder.is_dir() and any(folder.iterdir())
    try:
        render.write(report, folder)
    except OSError as error:
        msg = f"--out {folder}: expected a folder that can be written, received: {error.strerror}"
        raise click.ClickException(msg) from None
    clear()
    told = f"{folder / 'report.html'}" + (" (replaces the results that stood there)" if former else "")
    if as_json:
        click.echo((folder / "results.json").read_text(encoding="utf-8"), nl=False)
        if former:
            click.echo(told, err=True)
    else:
        for line in render.summary(report, tables):
            click.echo(line)
        click.echo(f"\n{told}")
    failed = [check.name for check in report.checks if not check.passed]
    for name in failed:
        click.echo(f"failed: {name}", err=True)
    return int(bool(failed))
