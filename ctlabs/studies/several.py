"""Several records of one model: each filtered, and one verdict of all of them on the model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ctlabs.analysis.diagnosis.consistency import chi2_p, share
from ctlabs.linalg.covariance import deviations
from ctlabs.reporting.plots.studies import estimates
from ctlabs.studies import common, filtering
from ctlabs.studies.estimates import table
from ctlabs.studies.filtered import LEVEL, Run, compute
from ctlabs.text import _, fill, number

if TYPE_CHECKING:
    from ctlabs.files.datafile import Record
    from ctlabs.files.modelfile import ModelFile
    from ctlabs.reporting.report import Report

#: Records that are drawn.
DRAWN = 3


class Joint(NamedTuple):
    """All records together: ``nis`` of ``dof`` innovations over ``instants``, its probability ``p``, the ``verdict`` and words on it."""

    nis: float
    dof: int
    instants: int
    p: float
    verdict: str
    suggestion: str


def study(
    model: ModelFile, records: Sequence[Record], *, algorithm: str | None = None, smooth: bool = False, design: ModelFile | None = None
) -> Report:
    """Filter every record with the model; parameters and refusals are those of :func:`ctlabs.studies.filtering.study`."""
    if design is not None:
        raise ValueError(f"--design: expected one record, received {len(records)}: filter them one by one")
    algorithm = common.form(model, algorithm)
    runs = _runs(model, records, algorithm, smooth=smooth)
    given = common.settings(model, ("algorithm", runs[0].algorithm, "", _("form of the filter")))
    report = common.begin("filter", _("several records filtered"), model, "abc", given, data=sources(records))
    report.section("a", _("Model and data"))
    _notes(report, runs)
    common.show(report, runs[0].model)
    report.section("b", _("Estimates"))
    _figures(report, runs)
    report.section("c", _("What the data say of the model"))
    _told(report, runs)
    report.csv("estimates", *_table(runs))
    return report


def add(report: Report, model: ModelFile, records: Sequence[Record]) -> None:
    """Filtered records in another study's report: figures, the joint verdict, ``estimates.csv``."""
    runs = _runs(model, records, "auto")
    _notes(report, runs)
    _figures(report, runs)
    _told(report, runs)
    report.csv("estimates", *_table(runs))


def sources(records: Sequence[Record]) -> str:
    """The files of records, each once."""
    return ", ".join(dict.fromkeys(record.file or record.source for record in records))


def _runs(model: ModelFile, records: Sequence[Record], algorithm: str, *, smooth: bool = False) -> list[Run]:
    """The records, filtered and diagnosed at the level that each has of all."""
    return [compute(model, record, algorithm, smooth=smooth, level=_level(len(records))) for record in records]


def _level(records: int) -> float:
    """The tests of the records share one level, with the size of all innovations together as one test more."""
    return share(LEVEL, records + 1)


def _notes(report: Report, runs: Sequence[Run]) -> None:
    common.notes(report, [f"{run.record.name}: {note}" for run in runs for note in run.notes])


def joint(runs: Sequence[Run], level: float) -> Joint:
    """The verdict of all records; ``level``, that of one of them, and of the size of all innovations together."""
    nis = float(sum(np.nansum(run.filtered.nis) for run in runs))
    dof = int(sum(run.filtered.used.sum() for run in runs))
    instants = int(sum(run.filtered.used.any(axis=1).sum() for run in runs))
    p = chi2_p(nis, dof) if dof else float("nan")
    worse = [(run.record.name, run.verdict) for run in runs if run.verdict is not None and not run.verdict.ok]
    if worse:
        told = "; ".join(f"{name}: {verdict.suggestion}" for name, verdict in worse)
        kinds = {verdict.verdict for _name, verdict in worse}
        return Joint(nis, dof, instants, p, kinds.pop() if len(kinds) == 1 else "other", told)
    if p < level:
        size = _("larger") if nis > dof else _("smaller")
        text = _("no record alone speaks against the model, but their innovations together are {size} than it says (p = {p})")
        return Joint(nis, dof, instants, p, "other", fill(text, size=size, p=number(p, 2)))
    return Joint(nis, dof, instants, p, "consistent", _("nothing speaks against the model"))


def _told(report: Report, runs: Sequence[Run]) -> None:
    """What each record says, and all together."""
    together = joint(runs, _level(len(runs)))
    report.table(
        "records",
        [_("record"), _("rows"), _("missing"), _("log-likelihood"), _("NIS per instant"), _("expected"), _("verdict")],
        [_row(run) for run in runs],
        _("The records, each filtered from the model's own start."),
    )
    if "log_likelihood" not in report.values:
        report.value("log_likelihood", float(sum(run.filtered.log_likelihood for run in runs)))
        diffuse = float(sum(run.filtered.log_likelihood_diffuse for run in runs))
        if diffuse != report.values["log_likelihood"].value:
            report.value("log_likelihood_diffuse", diffuse)
    report.value("records", len(runs))
    report.value("missing", sum(run.record.missing for run in runs))
    if together.instants:
        report.value("nis_mean", together.nis / together.instants)
        report.value("nis_expected", together.dof / together.instants)
        report.value("nis_p", together.p)
    for i, run in enumerate(runs):
        if run.filtered.contradictions:
            filtering.excluding(report, run, run.model, run.filtered, f"contradiction_{i + 1}")
    filtering.events(report, runs, [_("record")])
    report.value("verdict", together.verdict)
    report.value("suggestion", together.suggestion)
    report.says(
        _("The log-likelihoods of independent records add up. **Verdict on all {count} records:** {suggestion}."),
        count=len(runs), suggestion=together.suggestion.rstrip("."),
    )  # fmt: skip


def _row(run: Run) -> tuple[Any, ...]:
    filtered = run.filtered
    instants = int(filtered.used.any(axis=1).sum())
    size = (float(np.nansum(filtered.nis)) / instants, float(filtered.used.sum()) / instants) if instants else (None, None)
    verdict = run.untested if run.verdict is None else run.verdict.suggestion
    return run.record.name, run.record.rows, run.record.missing, float(filtered.log_likelihood_diffuse), *size, verdict


def _figures(report: Report, runs: Sequence[Run]) -> None:
    """The estimates of each state, record beside record."""
    model = runs[0].model
    for i, (name, unit) in enumerate(list(zip(model.states, model.units, strict=True))[: common.SHOWN]):
        for j, run in enumerate(runs[:DRAWN]):
            measured = common.measured(run.model, i)
            curves = {_("filtered"): (run.filtered.x_plus[:, i], deviations(run.filtered.P_plus)[:, i])}
            if run.smoothed is not None:
                curves[_("smoothed")] = (run.smoothed.x[:, i], deviations(run.smoothed.P)[:, i])
            data = None if measured is None else run.told[:, measured]
            figure = estimates(run.t, curves, data=data, ylabel=common.label(name, unit))
            report.figure(
                f"estimates_{i + 1}_{j + 1}", figure, _("Record {record}: estimates of {name} with their ±σ bands."),
                record=run.record.name, name=name,
            )  # fmt: skip
    if len(runs) > DRAWN:
        report.says(_("Of {count} records the first {drawn} are drawn."), count=len(runs), drawn=DRAWN)


def _table(runs: Sequence[Run]) -> tuple[list[str], list[list[Any]]]:
    """Columns and rows of estimates.csv, with the record's name before them."""
    tables = [table(run) for run in runs]
    columns = ["record", *tables[0][0]]
    common.distinct("estimates.csv", columns)
    return columns, [[run.record.name, *row] for run, (_columns, rows) in zip(runs, tables, strict=True) for row in rows]
