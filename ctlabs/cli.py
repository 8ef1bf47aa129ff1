"""The command line: ``ctlabs list``, ``show``, ``run``.

Exit 0: every check passed; 1: a check failed; 2: bad input, in one line that says what, where, expected, received.
"""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from ctlabs.experiment import Experiment
    from ctlabs.labs import Lab


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; errors of the user end with one line and exit code 2."""
    for threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(threads, "1")  # labs and blocks of runs are what runs in parallel; read when numpy loads
    try:
        code = cli.main(args=arguments, prog_name="ctlabs", standalone_mode=False)
    except click.ClickException as error:
        code = _refuse(_said(error))
    except (click.exceptions.Abort, KeyboardInterrupt):  # click turns Ctrl-C into Abort
        click.echo("ctlabs: interrupted; the reports that stood there are whole", err=True)
        code = 130
    sys.exit(code or 0)


def script(meta: Mapping[str, Any]) -> None:
    """Run a lab from its own script: ``python tasks/task07_scalar_gain.py --set Phi=1``."""
    main(["run", meta["name"], *sys.argv[1:]])


def _refuse(message: str) -> int:
    click.echo(f"ctlabs: {' '.join(message.split())}", err=True)
    return 2


def _said(error: click.ClickException) -> str:
    """A refusal of click in the words of all others: what was expected, what was received."""
    if isinstance(error, click.NoSuchOption):
        close = f" (did you mean {' or '.join(sorted(error.possibilities))}?)" if error.possibilities else ""
        return f"{error.option_name}: expected an option of `{_path(error)} --help`{close}, received an unknown name"
    if isinstance(error, click.MissingParameter) and error.param:
        return f"{error.param.human_readable_name}: expected as in `{_path(error)} --help`, received none"
    if isinstance(error, click.UsageError):
        return f"expected what `{_path(error)} --help` shows, received another form: {error.format_message()}"
    return error.format_message()


def _path(error: click.UsageError) -> str:
    return error.ctx.command_path if error.ctx else "ctlabs"


def _whole(least: int) -> Callable[[click.Context, click.Parameter, str | int | None], int | None]:
    """A whole number of the command line, refused in the words of all checks."""

    def check(_context: click.Context, option: click.Parameter, value: str | int | None) -> int | None:
        if value is None:
            return None
        with contextlib.suppress(ValueError):
            if int(value) >= least:
                return int(value)
        msg = f"{option.opts[0]}: expected a whole number >= {least}, received {value or 'nothing'}"
        raise click.ClickException(msg)

    return check


class Commands(click.Group):
    """A group that names its commands when it is given another."""

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        """The command that ``args`` begin with."""
        if self.get_command(ctx, args[0]) is None:
            msg = f"command {args[0]}: expected one of {', '.join(self.list_commands(ctx))}, received an unknown name"
            raise click.ClickException(msg)
        return super().resolve_command(ctx, args)


@click.group(
    cls=Commands,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(package_name="ctlabs")
@click.pass_context
def cli(ctx: click.Context) -> None:
    """Optimal (Kalman) filtering: from a problem's statement to a verified report.

    \b
    ctlabs list                      what labs there are
    ctlabs show 7                    a lab's question and parameters
    ctlabs run 7 --set Phi=1.3       run it with other numbers; writes reports/task07/report.html
    """
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())


@cli.command("list")
def list_() -> None:
    """The labs, and the variants of the practicum (a star marks a control lab)."""
    from ctlabs import labs

    for lab in labs.catalogue().values():
        click.echo(f"{lab.short:>15}  {lab.title}  [{lab.source}]")
    click.echo("\nVariants (ctlabs run variant-a); * = control lab:")
    for letter in labs.VARIANTS:
        row = "  ".join(f"{int(name[4:])}{'*' if starred else ''}" for name, starred in labs.variant(letter))
        click.echo(f"      variant-{letter}  {row}")


@cli.command()
@click.argument("lab")
def show(lab: str) -> None:
    """A lab's question, parts and parameters (LAB: 7, 07, task07, …)."""
    from ctlabs import labs
    from ctlabs.text import number

    for entry in _checked(lambda: labs.find([lab])):
        module = labs.load(entry)
        click.echo(f"{entry.name}: {entry.title}\n{entry.source}\n\n{(module.__doc__ or '').strip()}\n")
        click.echo(f"Parts: {', '.join(entry.parts)}\n\nParameters (--set NAME=VALUE):")
        defaults = module.Parameters()
        for name, info in type(defaults).model_fields.items():
            shown = number(getattr(defaults, name))
            click.echo(f"  {name:>14} = {shown:<24} {info.json_schema_extra['unit']:<8} {info.description}")
        click.echo("")


@cli.command()
@click.argument("lab", nargs=-1, required=True, metavar="LAB...")
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="NAME=VALUE",
    help='A parameter: a number, "inf", or a JSON list. task07.Phi=1 addresses one lab. Repeatable.',
)
@click.option(
    "--runs",
    metavar="N",
    callback=_whole(1),
    help="Runs of the computational experiment (default: the lab's own, usually 1000).",
)
@click.option(
    "--seed",
    type=str,
    metavar="N",
    callback=_whole(0),
    default=1,
    show_default=True,
    help="Seed of the random numbers.",
)
@click.option(
    "--workers",
    type=str,
    metavar="N",
    callback=_whole(1),
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
@click.option("--scheduler", metavar="ADDR", help="Compute on a Dask cluster: tcp://host:8786 (extra: cluster).")
def run(
    lab: tuple[str, ...],
    settings: tuple[str, ...],
    runs: int | None,
    seed: int,
    workers: int,
    out: Path,
    resume: Path | None,
    scheduler: str | None,
) -> int:
    """Run labs and write their reports.

    LAB: 7, 07, task07, field, slow_error, coloured_plant, all, variant-a (b, c).

    \b
    ctlabs run 7
    ctlabs run 7 --set Phi=1.3 --set Q=0 --runs 10000
    ctlabs run 6 --set R='[2, 4, "inf", 1, 3, 0, 5]'
    ctlabs run 3 --runs 1000000 --resume work     a long experiment that may be interrupted
    """
    from ctlabs import labs

    chosen = _checked(lambda: labs.find(lab))
    values = _checked(lambda: labs.parameters(chosen, _settings(settings)))
    _writable(out, [entry.name for entry in chosen])
    from ctlabs import render
    from ctlabs.experiment import Experiment
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
        )
        for entry in chosen
    ]
    failed = False
    try:
        for done in _progress(_run_all(jobs, together), len(jobs)):
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
    render.write_index(out)
    return int(failed)


def _verdict(done: dict[str, Any]) -> str:
    if done["failed"]:
        return f"{len(done['failed'])} of {done['checks']} checks failed"
    return f"all {done['checks']} checks passed" if done["checks"] else "no checks, which is no success"


def _run_all(jobs: list[tuple[Lab, Any, Experiment, Path]], together: int) -> Iterator[dict[str, Any]]:
    """Run the labs, ``together`` of them at a time in processes of their own; results in the order given."""
    from ctlabs import labs

    if together == 1:
        for job in jobs:
            yield labs.run_and_write(*job)
        return
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor

    with ProcessPoolExecutor(together, mp_context=multiprocessing.get_context("spawn")) as pool:
        try:
            yield from pool.map(labs.run_and_write, *zip(*jobs, strict=True))
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def _progress(items: Iterable[dict[str, Any]], total: int) -> Iterable[dict[str, Any]]:
    """A bar on a terminal while several labs run; nothing elsewhere."""
    if total == 1 or not sys.stderr.isatty():
        return items
    from tqdm import tqdm

    return tqdm(items, total=total, unit="lab", leave=False)


def _settings(pairs: tuple[str, ...]) -> dict[str, object]:
    from ctlabs.params import typed

    found = {}
    for pair in pairs:
        name, equals, text = pair.partition("=")
        if not equals or not name.strip():
            raise ValueError(f"--set {pair}: expected NAME=VALUE, received no name or no =")
        found[name.strip()] = typed(text.strip())
    return found


def _checked(action: Any) -> Any:
    """What ``action`` returns; a ``ValueError`` becomes the command line's one line."""
    try:
        return action()
    except ValueError as error:
        raise click.ClickException(str(error)) from None


def _writable(out: Path, names: list[str]) -> None:
    """Refuse a folder that cannot be written before anything is computed."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=out):
            pass
    except OSError as error:
        raise click.ClickException(
            f"--out {out}: expected a folder that can be written, received: {error.strerror}"
        ) from None
    for name in names:
        if (out / name).exists() and not (out / name).is_dir():
            msg = f"--out {out}: expected a folder {out / name} or none, received a file"
            raise click.ClickException(msg)
