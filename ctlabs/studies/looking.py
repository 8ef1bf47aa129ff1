"""What is in a table of data: ``ctlabs look``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ctlabs.files import look
from ctlabs.files.mapping import WRITTEN
from ctlabs.reporting.plots import records as pictures
from ctlabs.reporting.report import Report
from ctlabs.studies import common
from ctlabs.text import _, fill, number

if TYPE_CHECKING:
    from ctlabs.files.look import Survey
    from ctlabs.files.mapping import Mapping
    from ctlabs.files.modelfile import ModelFile

#: So many columns are drawn.
DRAWN = 6


def study(content: bytes, source: str, mapping: Mapping, model: ModelFile | None = None) -> Report:
    """The columns of a table, its sampling, what looks suspicious, and the [data] by which ``model`` would read it.

    Raises
    ------
    ValueError
        What is no table.
    """
    found = look.survey(content, source, mapping, () if model is None else model.measurements)
    return report(found, source, named=model is not None)


def report(found: Survey, source: str, *, named: bool) -> Report:
    """What is in the table, in words and figures; ``named``, whether the measurements of a model were looked for."""
    meta = {
        "name": "look",
        "title": fill(_("{source}: a look"), source=source),
        "source": f"ctlabs look {source}",
        "parts": ["a", "b"],
    }
    made = Report(meta, common.Settings(()), 0, 0)
    made.section("a", _("Columns"))
    _columns(made, found)
    made.section("b", _("How a model reads it"))
    _reading(made, found, named=named)
    return made


def sentences(found: Survey) -> list[str]:
    r"""How a table was understood: its columns, the marks of its numbers, its times and what stands for missing values.

    >>> from ctlabs.files.mapping import Mapping
    >>> table = "Time;pos\n2024-05-31T12:30:00+02:00;1,5\n2024-05-31T12:30:01+02:00;NA\n"
    >>> for line in sentences(look.survey(table.encode(), "log.csv", Mapping())):
    ...     print(line)
    2 rows, columns separated by a semicolon, named in line 1.
    Numbers have a decimal comma.
    Times in the column Time: dates and times as ISO 8601 writes them, in the zone +02:00; usually 1 s apart.
    Not measured: NA.
    """
    names = fill(_("named in line {line}"), line=found.line) if found.line else _("without names: they are counted from 1")
    told = [fill(_("{rows} rows, columns separated by {separator}, {names}."), rows=found.rows, separator=found.separator, names=names)]
    if found.decimal:
        told.append(_("Numbers have a decimal comma.") if found.decimal == "," else _("Numbers have a decimal point."))
    told.append(_times(found))
    if found.absent:
        words = ", ".join(word or _("empty cells") for word in found.absent)
        told.append(fill(_("Not measured: {words}."), words=words))
    return told


def _times(found: Survey) -> str:
    """The column of times and how it is written."""
    if not found.clock:
        return _("No column of times: the rows are one period of the model apart.")
    text = fill(_("Times in the column {name}: {written}"), name=found.clock, written=written(found.unit))
    if found.zone:
        text += fill(_(", in the zone {zone}"), zone=found.zone)
    elif found.unit in WRITTEN:
        text += _(", without a zone")
    if found.usual is not None:
        text += fill(_("; usually {interval} s apart"), interval=number(found.usual, 4))
    return f"{text}."


def written(unit: str) -> str:
    """How times are written, in words.

    >>> written("unix_ms"), written("")
    ('milliseconds since 1970', 'seconds, or the unit of dt')
    """
    return {
        "": _("seconds, or the unit of dt"), "s": _("seconds"), "ms": _("milliseconds"), "us": _("microseconds"), "ns": _("nanoseconds"),
        "min": _("minutes"), "h": _("hours"), "d": _("days"), "unix": _("seconds since 1970"), "unix_ms": _("milliseconds since 1970"),
        "unix_us": _("microseconds since 1970"), "unix_ns": _("nanoseconds since 1970"), "excel": _("days of a spreadsheet"),
        "iso": _("dates and times as ISO 8601 writes them"), "dmy": _("dates, the day first"), "mdy": _("dates, the month first"),
        "ymd": _("dates, the year first"), "clock": _("times of day"),
    }[unit]  # fmt: skip


def _columns(report: Report, found: Survey) -> None:
    """What each column holds, drawn where it is numbers; sampling and remarks."""
    for sentence in sentences(found):
        report.says("{sentence}", sentence=sentence)
    report.table(
        "columns",
        [_("number"), _("column"), _("type"), _("missing"), _("range, or the first")],
        [(c.number, c.name, c.kind, c.missing, look.described(c)) for c in found.columns],
        _("The columns of the table."),
    )
    report.value("rows", found.rows)
    if found.clock:
        report.value("clock", found.clock + (f":{found.unit}" if found.unit else ""))
    if found.t is not None and found.usual is not None:
        steps = np.diff(found.t)
        report.value("interval", found.usual, "s")
        report.value("interval_least", float(steps.min()), "s")
        report.value("interval_greatest", float(steps.max()), "s")
    remarks = [*found.remarks, *(remark for column in found.columns for remark in column.remarks)]
    for remark in remarks:
        report.says("{remark}.", remark=remark)
    if remarks:
        report.value("remarks", "; ".join(remarks))
    drawn = [c for c in found.columns if c.kind == "numbers" and c.name != found.clock and np.isfinite(c.values).any()][
        :DRAWN
    ]
    if drawn:
        t = np.arange(1.0, found.rows + 1) if found.t is None else found.t
        label = _("row") if found.t is None else _("time since the first row, s")
        figure = pictures.columns(t, {c.name: c.values for c in drawn}, xlabel=label)
        report.figure("columns", figure, _("The columns of numbers; gaps are missing values."))


def _reading(report: Report, found: Survey, *, named: bool) -> None:
    """The table [data] and the options that say the same."""
    if not found.data:
        report.says(_("Nothing has to be told: the columns are named as the model's measurements."))
        report.value("options", "")
        return
    wanted = (
        _("COLUMN stands for what could not be found")
        if named
        else _("the names of the model's measurements stand for MEASUREMENT")
    )
    report.says(_("In the model file (where {wanted}):"), wanted=wanted)
    report.says("\n```toml\n{data}\n```\n", data=found.data)
    report.says(_("or as options: `{options}`"), options=found.options)
    report.value("options", found.options)
