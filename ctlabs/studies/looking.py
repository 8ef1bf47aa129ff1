"""What is in a table of data: ``ctlabs look``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ctlabs.files import look
from ctlabs.reporting.plots import records as pictures
from ctlabs.reporting.report import Report
from ctlabs.studies import common
from ctlabs.text import _, fill

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


def _columns(report: Report, found: Survey) -> None:
    """What each column holds, drawn where it is numbers; sampling and remarks."""
    report.says(
        _("{rows} rows, columns separated by {separator}, {names}."), rows=found.rows, separator=found.separator,
        names=fill(_("named in line {line}"), line=found.line) if found.line else _("without names: they are counted from 1"),
    )  # fmt: skip
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
