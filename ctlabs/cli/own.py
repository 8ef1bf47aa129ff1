"""The commands on a model and data of your own: ``filter``, ``forecast``, ``simulate``, ``analyse``, ``compare``, ``fit``."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ctlabs.cli.common import whole
from ctlabs.cli.records import noted, reading
from ctlabs.cli.work import (
    at_work,
    clear,
    deliver,
    folder_of,
    model_of,
    one_stdin,
    options,
    outside,
    refusing,
    seed_option,
)

if TYPE_CHECKING:
    from ctlabs.files.datafile import Record
    from ctlabs.files.mapping import Mapping
    from ctlabs.files.modelfile import ModelFile
    from ctlabs.reporting.report import Report
    from ctlabs.studies.fitting import Progress

#: Seconds between two lines on a terminal that say how far a search is.
PAUSE = 0.2
@click.command("filter")
@options
@click.argument("data", metavar="DATA.csv", nargs=-1, required=True)
@reading
@click.option("--algorithm", metavar="NAME", help="A form of the filter: joseph, ud, srif, … (default: the model's).")
@click.option("--smooth", is_flag=True, help="Estimates from the whole record too, forwards and backwards in time.")
@click.option("--design", metavar="MODEL2", help="Filter with this model, and say what it costs if MODEL is the truth.")
@click.option("--gate", type=float, metavar="SIGMAS", help="Leave out and list measurements farther than this from their prediction.")
@click.option("--draws", metavar="N", callback=whole(1), help="Draw N histories of the state given the record: draws.csv.")
@click.option("--reach", multiple=True, metavar="STATE=VALUE", help="First passage of a value, of each draw. Repeatable.")
@seed_option()
@click.option("--table", metavar="parquet|FILE", help="The estimates as parquet beside the report, or in FILE.parquet or FILE.csv.")
@click.option(
    "--export",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Matrices and gains for other programs: FILE.npz (NumPy), FILE.mat (MATLAB) or FILE.h (C).",
)
def filter_(
    model: str,
    data: tuple[str, ...],
    mapping: Mapping,
    algorithm: str | None,
    smooth: bool,
    design: str | None,
    gate: float | None,
    draws: int | None,
    reach: tuple[str, ...],
    seed: int | None,
    table: str | None,
    export: Path | None,
    pairs: tuple[str, ...],
    out: Path | None,
    as_json: bool,
) -> int:
    """Filter a measured record.

    MODEL is a model file, a name of the gallery (`ctlabs models`) or - (standard input). DATA.csv is a table (also .gz,
    .xlsx, .parquet) with the names of its columns above them: the model's measurements, and optionally t, the times in
    seconds; an empty cell is a missing measurement; - is the standard input. Other names, units and clocks are told by
    the options, or once for all in the model file's table [data]; `ctlabs look DATA.csv MODEL` suggests it. Several tables, or
    one with a column that names the record of each row, are filtered one by one and judged together.

    \b
    ctlabs filter nile.toml flow.csv                     writes nile/report.html, nile/estimates.csv, …
    ctlabs filter nile.toml flow.csv --smooth --set q=500
    ctlabs filter track.toml gps.csv --algorithm ud --export gains.h
    ctlabs filter truth.toml gps.csv --design simple.toml
    ctlabs filter nile.toml flow.csv --gate 5 --table estimates.parquet
    ctlabs filter nile.toml flow.csv --draws 1000 --reach level=900
    ctlabs filter track.toml log.csv --column position="alt [m]" --time stamp:unix_ms --t0 first --missing -9999
    ctlabs filter demand.toml sales.csv --regressor price=Price
    ctlabs filter track.toml first.csv second.csv        several records; or --record-column run
    cat flow.csv | ctlabs filter nile.toml - --json | jq .values.log_likelihood.value
    """
    from ctlabs.files import tables as writing
    from ctlabs.studies import filtering, several

    one_stdin(model, *data, design)
    tables = _tables(data, model)
    chosen = model_of(model, pairs, mapping, tables if design is None else ())
    other = None if design is None else model_of(design, (), mapping, tables)
    folder = folder_of(model, out, *data, design)
    if export is not None:
        filtering.exportable(export)
        outside("--export", export, folder)
    written = None if table is None else writing.wanted(table)
    if written is not None:
        outside("--table", written, folder)
    records = _records(tables, other or chosen, mapping)
    if len(records) > 1:
        only_one = {"--gate": gate, "--draws": draws, "--reach": reach or None, "--seed": seed, "--export": export}
        for name in (name for name, given in only_one.items() if given is not None):
            raise ValueError(f"{name}: expected one record, received {len(records)}: filter them one by one")
        report = several.study(chosen, records, algorithm=algorithm, smooth=smooth, design=other)
    else:
        if seed is not None and draws is None:
            raise ValueError(f"--seed {seed}: expected --draws N beside it (a filter draws nothing else), received none; leave --seed out")
        report = filtering.study(
            chosen, records[0], algorithm=algorithm, smooth=smooth, design=other, gate=gate, draws=draws or 0, seed=seed, reach=reach
        )
    if table == "parquet":
        report.files["estimates.parquet"] = writing.parquet(report.files["estimates.csv"])
    code = deliver(report, folder, as_json, "last", "records")
    if written is not None and table != "parquet":
        content = report.files["estimates.csv"]
        written.write_bytes(content if written.suffix == ".csv" else writing.parquet(content))
        click.echo(str(written), err=as_json)
    if export is not None:
        filtering.export_gains(other or chosen, records[0], export)
        click.echo(str(export), err=as_json)
    return code


@click.command("forecast")
@options
@click.argument("data", metavar="DATA.csv")
@reading
@click.option(
    "--steps", metavar="N", callback=whole(1),
    help="Number of instants after the record (default: 12; with inputs or regressors, as many as the record has rows for).",
)  # fmt: skip
def forecast(
    model: str, data: str, mapping: Mapping, steps: int | None, pairs: tuple[str, ...], out: Path | None, as_json: bool
) -> int:
    """Predict what comes after a measured record.

    MODEL and DATA.csv as for `ctlabs filter`. The forecast is given the whole record: states and measurements with their
    standard deviations, in a table, in figures and in forecast.csv. Known inputs and regressors have to be known for the time to
    come too: in rows below the record, with empty measurements.

    \b
    ctlabs forecast nile.toml flow.csv --steps 10        writes nile/report.html, nile/forecast.csv, …
    ctlabs forecast track.toml log.csv --time stamp:unix_ms --t0 first
    """
    from ctlabs.studies import forecasting

    one_stdin(model, data, None)
    tables = _tables([data], model)
    chosen = model_of(model, pairs, mapping, tables)
    folder = folder_of(model, out, data, None)
    report = forecasting.study(chosen, _record(tables, chosen, mapping), steps)
    return deliver(report, folder, as_json, "forecast")


@click.command()
@options
@click.option("--design", metavar="MODEL2", help="Filter with this model on the data of MODEL.")
@click.option("--runs", metavar="N", callback=whole(1), help="Number of runs (default: the model's).")
@seed_option()
@click.option("--steps", metavar="N", callback=whole(1), help="Number of steps of a run (default: the model's).")
@click.option(
    "--workers", metavar="N", callback=whole(1), help="Blocks of runs computed at a time (default: all cores)."
)
@click.option("--csv", "csv_runs", metavar="N", callback=whole(1), help="Write the first N runs to runs.csv.")
def simulate(
    model: str,
    design: str | None,
    runs: int | None,
    seed: int | None,
    steps: int | None,
    workers: int | None,
    csv_runs: int | None,
    pairs: tuple[str, ...],
    out: Path | None,
    as_json: bool,
) -> int:
    """Simulate many runs, and compare their errors with theory.

    MODEL is a model file, a name of the gallery (`ctlabs models`) or - (standard input).

    \b
    ctlabs simulate constant_velocity
    ctlabs simulate track.toml --runs 10000 --seed 5 --steps 400
    ctlabs simulate track.toml --design simple.toml      what a wrong or simpler filter does
    ctlabs simulate track.toml --csv 3                   three runs as data: track/runs.csv
    """
    from ctlabs.studies import simulation

    one_stdin(model, design)
    chosen, other = model_of(model, pairs), None if design is None else model_of(design, ())
    folder = folder_of(model, out, design)
    report = simulation.study(
        chosen, design=other, runs=runs, seed=seed, steps=steps, workers=workers, csv_runs=csv_runs or 0
    )
    return deliver(report, folder, as_json, "errors")


@click.command()
@options
def analyse(model: str, pairs: tuple[str, ...], out: Path | None, as_json: bool) -> int:
    """What a model's filter will do, before there are data.

    Observability with its evidence, the steady covariances and both gains, poles, transfer functions, settling. MODEL
    is a model file, a name of the gallery (`ctlabs models`) or - (standard input).

    \b
    ctlabs analyse oscillator
    ctlabs analyse track.toml --set sigma_w2=0.1 --out wide
    """
    from ctlabs.studies import analysis

    chosen = model_of(model, pairs)
    folder = folder_of(model, out)
    return deliver(analysis.study(chosen), folder, as_json, "steady")


@click.command()
@options
@click.argument("data", metavar="[DATA.csv]", required=False)
@reading
@click.option("--algorithms", metavar="all|a,b", default="all", show_default=True, help="Which forms of the filter.")
@click.option(
    "--sweep", metavar="NAME=a,b,…", help="Repeat for these values of one constant, and draw the errors against it."
)
@seed_option()
@click.option("--steps", metavar="N", callback=whole(1), help="Steps of the simulated record (default: the model's).")
def compare(
    model: str,
    data: str | None,
    mapping: Mapping,
    algorithms: str,
    sweep: str | None,
    seed: int | None,
    steps: int | None,
    pairs: tuple[str, ...],
    out: Path | None,
    as_json: bool,
) -> int:
    """Compare algorithms: digits, operations, time.

    Each filters the same record, beside a run with 50 digits on the same doubles.

    MODEL is a model file, a name of the gallery (`ctlabs models`) or - (standard input); without DATA.csv the record
    is simulated.

    \b
    ctlabs compare track.toml
    ctlabs compare track.toml gps.csv --algorithms joseph,ud,srif
    ctlabs compare ill_conditioned --sweep delta=1e-6,1e-7,1e-8,1e-9
    """
    from ctlabs.studies import comparison

    one_stdin(model, data)
    if data is not None and seed is not None:
        raise ValueError(f"--seed {seed}: expected a record to simulate, received {data}; leave --seed out, or the data")
    tables = [] if data is None else _tables([data], model)
    chosen = model_of(model, pairs, mapping, tables)
    folder = folder_of(model, out, data)
    record = None if data is None else _record(tables, chosen, mapping)
    report = comparison.study(chosen, record, algorithms=algorithms, sweep=sweep, seed=seed, steps=steps)
    return deliver(report, folder, as_json, "algorithms", "sweep")


@click.command()
@options
@click.argument("data", metavar="DATA.csv", nargs=-1, required=True)
@reading
@click.option("--free", metavar="a,b", default="", help="The constants to estimate; their values are where the search starts.")
@click.option(
    "--starts", metavar="N", default=0, callback=whole(0), help="Search from N more starts, chosen around the first."
)
def fit(
    model: str,
    data: tuple[str, ...],
    mapping: Mapping,
    free: str,
    starts: int,
    pairs: tuple[str, ...],
    out: Path | None,
    as_json: bool,
) -> int:
    """Estimate a model's constants from a record.

    By maximum likelihood, with standard errors and profiles. Ctrl-C ends the search with the best so far.

    MODEL is a model file, a name of the gallery (`ctlabs models`) or - (standard input); DATA.csv as for `filter`. Of several
    records the likelihoods are multiplied.

    \b
    ctlabs fit nile.toml flow.csv --free q,r
    ctlabs fit track.toml gps.csv --free tau --set tau=10     start from another value
    ctlabs fit track.toml gps.csv --free tau,q --starts 8     and from eight others
    ctlabs fit track.toml first.csv second.csv --free q       one model of several records
    """
    from ctlabs.studies import fitting

    one_stdin(model, *data)
    tables = _tables(data, model)
    chosen = model_of(model, pairs, mapping, tables)
    if not free:
        msg = f"{chosen.name}: expected the constants to estimate, received none: --free {','.join(chosen.constants) or 'a,b'} takes all"
        raise ValueError(msg)
    folder = folder_of(model, out, *data)
    report = fitting.study(chosen, _records(tables, chosen, mapping), free.split(","), starts, _searching())
    if report.values.get("interrupted"):
        click.echo("ctlabs: interrupted; the best constants so far are in the report", err=True)
    return deliver(report, folder, as_json, "estimates")


def _searching() -> Callable[[Progress], None] | None:
    """A line on a terminal that says how far a fit is, and about how long it will take; nothing elsewhere."""
    if not sys.stderr.isatty():
        return None
    shown = -1.0

    def show(now: Progress) -> None:
        nonlocal shown
        if now.seconds - shown < PAUSE:
            return
        shown = now.seconds
        left = f"about {now.left:.0f} s left" if now.seconds > 1 else ""
        text = f"{now.stage}: likelihood {now.done} of about {now.expected}, greatest {now.best:.6g}  {left}"
        click.echo(f"\r{text:<100}\r", nl=False, err=True)

    return show


@click.command()
@click.argument("data", metavar="DATA.csv")
@click.argument("model", metavar="[MODEL]", required=False)
@reading
@click.option("--json", "as_json", is_flag=True, help="Print results.json instead of the table.")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="Folder for the report (default: look_DATA).")
def look(data: str, model: str | None, mapping: Mapping, out: Path | None, as_json: bool) -> int:
    """See what is in a table of data, before it is filtered.

    Its columns with their types and ranges, gaps, sampling, suspicious values, a figure, and the table [data] of a
    model file (or the options) by which MODEL would read it. - is the standard input.

    \b
    ctlabs look log.csv
    ctlabs look log.csv track.toml
    ctlabs look log.csv --time stamp:unix_ms --missing -9999
    """
    from ctlabs.studies import looking

    with refusing(), at_work():
        one_stdin(model, data)
        [(content, source)] = _tables([data])
        chosen = None if model is None else model_of(model, (), mapping, [(content, source)])
        said = mapping if chosen is None else chosen.mapping.over(mapping)
        folder = folder_of(f"look_{Path(source).name.split('.')[0]}", out, data, model)
        report = looking.study(content, source, said, chosen)
        code = deliver(report, folder, as_json, "columns")
        if not as_json:
            _suggest(report)
        return code


def _suggest(report: Report) -> None:
    """The suggested table [data] on the terminal."""
    from ctlabs.reporting.report import Text

    for block in report.blocks:
        if isinstance(block, Text) and "```toml" in block.text:
            click.echo("\n" + block.text.split("```")[1].removeprefix("toml").strip())


def _tables(data: Sequence[str], model: str = "") -> list[tuple[bytes, str]]:
    """The bytes of the tables, each with its name; a model where a table is expected was meant the other way round."""
    from ctlabs.files import decode, modelfile, reading

    for each in data:
        if model and not Path(each).exists() and each in [entry.name for entry in modelfile.gallery()]:
            command = click.get_current_context().command_path
            msg = f"{each}: expected a table, received a model, which comes first: {command} {each} {model}"
            raise ValueError(msg)
    return [(decode.content(each, reading.source_of(each)), reading.source_of(each)) for each in data]


def _records(tables: Sequence[tuple[bytes, str]], model: ModelFile, mapping: Mapping) -> tuple[Record, ...]:
    """The records in tables, as the model file and the options say; what is remarkable is told."""
    from ctlabs.files import reading

    records = reading.parsed(tables, model, mapping)
    clear()
    noted(*records)
    return records


def _record(tables: Sequence[tuple[bytes, str]], model: ModelFile, mapping: Mapping) -> Record:
    """The one record in a table."""
    from ctlabs.files import datafile

    return datafile.only(_records(tables, model, mapping))
