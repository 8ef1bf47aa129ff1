"""The options by which a command is told how a table of data is to be read."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from ctlabs.cli.common import whole

if TYPE_CHECKING:
    from ctlabs.files.mapping import Mapping

OPTIONS = (
    click.option(
        "--column", "columns", multiple=True, metavar="NAME=COLUMN",
        help='The column of a measurement: --column position="pos [m]"; or its number. Repeatable.',
    ),
    click.option(
        "--time", metavar="COLUMN[:UNIT]",
        help="The column of times (default: t), and how they are written: s ms us ns min h d · unix unix_ms unix_us unix_ns · "
        "excel · iso dmy mdy ymd clock. none: there are no times.",
    ),
    click.option(
        "--t0", metavar="first",
        help="The first row is at the model's first instant. (model: times count from the model's t0, however far.)",
    ),
    click.option("--dt", "dt", type=float, metavar="SECONDS", help="The period of a model in discrete time, in place of the file's."),
    click.option("--missing", multiple=True, metavar="WORD", help="A word or number that means not measured. Repeatable."),
    click.option(
        "--scale", "scales", multiple=True, metavar="NAME=FACTOR", help="Multiply a column: --scale position=0.001. Repeatable."
    ),
    click.option(
        "--input", "inputs", multiple=True, metavar="NAME", help="A column that is a known input, in the order of B. Repeatable."
    ),
    click.option("--u0", "u0", metavar="A,B", help="What the known inputs are from t0 to the first row (first = 1)."),
    click.option(
        "--regressor", "regressors", multiple=True, metavar="NAME=COLUMN",
        help="A column that elements of H, R, D, B name: --regressor price=Price. Repeatable.",
    ),
    click.option(
        "--record-column", "record", metavar="COLUMN", help="The column that tells of which record a row is, where there are several."
    ),
    click.option("--decimal", metavar=". or ,", help="The decimal mark, where the file leaves a doubt."),
    click.option("--thousands", metavar=", or .", help="The mark between thousands, where the file leaves a doubt."),
    click.option("--blank", metavar="skip|missing", help="What blank lines are: nothing, or rows without a measurement."),
    click.option("--encoding", metavar="NAME", help="The encoding of the text: cp1252, utf-16, …"),
    click.option("--skip", metavar="N", callback=whole(0), help="Lines above the table that are not read."),
    click.option("--sheet", metavar="NAME", help="The sheet of an Excel workbook, where several hold data."),
)  # fmt: skip


def reading(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options; it is called with ``mapping``, what they say."""

    @functools.wraps(command)
    def told(
        *,
        columns: tuple[str, ...],
        time: str | None,
        t0: str | None,
        dt: float | None,
        missing: tuple[str, ...],
        scales: tuple[str, ...],
        inputs: tuple[str, ...],
        u0: str | None,
        regressors: tuple[str, ...],
        record: str | None,
        decimal: str | None,
        thousands: str | None,
        blank: str | None,
        encoding: str | None,
        skip: int | None,
        sheet: str | None,
        **others: Any,
    ) -> Any:
        marks = {"decimal": decimal, "thousands": thousands, "blank": blank, "encoding": encoding, "skip": skip}
        marks |= {"record": record, "sheet": sheet}
        said: dict[str, Any] = {name: value for name, value in marks.items() if value}
        said |= {} if dt is None else {"dt": dt}
        return command(mapping=_mapping(columns, time, t0, missing, scales, inputs, u0, regressors, said), **others)

    for option in reversed(OPTIONS):
        told = option(told)
    return told


def _mapping(
    columns: tuple[str, ...], time: str | None, t0: str | None, missing: tuple[str, ...], scales: tuple[str, ...],
    inputs: tuple[str, ...], u0: str | None, regressors: tuple[str, ...], said: dict[str, Any],
) -> Mapping:  # fmt: skip
    """What the options say; a wrong one is the command line's one line."""
    from ctlabs.files.mapping import Mapping, pairs, time_option

    try:
        column, unit = time_option(time or "")
        return Mapping(
            columns=pairs("--column", columns), time=column, unit=unit, t0=t0 or "", missing=missing, scale=_factors(scales),
            inputs=inputs, u0=_numbers(u0), regressors=pairs("--regressor", regressors), **said,
        )  # fmt: skip
    except ValueError as error:
        raise click.ClickException(str(error)) from None


def _numbers(text: str | None) -> tuple[float, ...]:
    try:
        return tuple(float(word) for word in text.split(",")) if text else ()
    except ValueError:
        raise ValueError(f"--u0 {text}: expected numbers, one for each input, received {text}") from None


def _factors(words: tuple[str, ...]) -> dict[str, float]:
    from ctlabs.files.mapping import pairs

    found = {}
    for name, text in pairs("--scale", words).items():
        try:
            found[name] = float(text)
        except ValueError:
            raise ValueError(f"--scale {name}={text}: expected a number, received {text}") from None
    return found


def noted(*records: Any) -> None:
    """Tell what was left out of the records and what looks suspicious, once for each table."""
    told = dict.fromkeys(
        f"note: {record.file or record.source}: {text}"
        for record in records
        for text in ([f"columns not used: {', '.join(record.ignored)}"] if record.ignored else []) + list(record.notes)
    )
    for line in told:
        click.echo(line, err=True)
