"""The command line: ``ctlabs list``, ``show``, ``run`` for the labs; ``filter``, ``simulate``, … for models and data of your own.

Exit 0: every check passed; 1: a check failed; 2: bad input, in one line that says what, where, expected, received.
"""

from __future__ import annotations

import errno
import os
import sys
from typing import TYPE_CHECKING, Any

import click

from ctlabs.cli import control, course, grades, labs, models, own
from ctlabs.cli.common import Commands
from ctlabs.workbench.serving.command import workbench

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


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
    except OSError as error:
        if error.errno == errno.EPIPE:  # click has left quietly already, but for its last flush
            raise
        code = _refuse(f"expected files that can be read and written, received: {error.strerror or error}")
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
        name = error.param.opts[0] if isinstance(error.param, click.Option) else error.param.human_readable_name
        return f"{name}: expected as in `{_path(error)} --help`, received none"
    if isinstance(error, click.UsageError):
        return f"expected what `{_path(error)} --help` shows, received another form: {error.format_message()}"
    return error.format_message()


def _path(error: click.UsageError) -> str:
    return error.ctx.command_path if error.ctx else "ctlabs"


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
    ctlabs book                      all labs as one document

    \b
    ctlabs models                    ready models; `ctlabs models copy NAME` gives a file to edit
    ctlabs analyse MODEL             what a model's filter will do
    ctlabs simulate MODEL            what it does in many simulated runs
    ctlabs look DATA.csv             what is in a table of data, and how a model reads it
    ctlabs filter MODEL DATA.csv     what it makes of measured data; fit estimates the model's constants
    ctlabs regulate MODEL            the regulator of a plant with a cost, and what its loop does
    ctlabs workbench                 all of it in the browser
    """
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())


for command in (
    labs.list_,
    labs.show,
    labs.run,
    labs.book,
    own.filter_,
    own.forecast,
    own.simulate,
    own.analyse,
    own.compare,
    own.fit,
    own.look,
    control.regulate,
    models.models,
    course.course,
    workbench,
):
    cli.add_command(command)

for command in (grades.check, grades.grade, grades.export):
    course.course.add_command(command)
