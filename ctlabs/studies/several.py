"""Several records of one model: each filtered, and one verdict of all of them on the model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy import special

from ctlabs.analysis import diagnosis
from ctlabs.files import clock
from ctlabs.linalg.covariance import deviations
from ctlabs.reporting.plots.studies import estimates
from ctlabs.studies import common, filtering
from ctlabs.studies.estimates import table
from ctlabs.studies.filtered import Run, compute
from ctlabs.text import _, fill, number

if TYPE_CHECKING:
    from ctlabs.analysis.diagnosis import Diagnosis
    from ctlabs.files.datafile import Record
    from ctlabs.files.modelfile import ModelFile
    from ctlabs.reporting.report import Report

#: Records that are drawn.
DRAWN = 3
#: The probability that all tests together suspect a right model.
LEVEL = 0.01


class Judged(NamedTuple):
    """A record, filtered, and what its innovations say; ``verdict`` is None where nothing can be tested, for a ``reason``."""

    record: Record
    run: Run
    verdict: Diagnosis | None
    reason: str = ""


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
    algorithm = algorithm or model.experiment.algorithms[0]
    given = common.settings(model, ("algorithm", algorithm, "", _("form of the filter")))
    source = ", ".join(dict.fromkeys(record.file or record.source for record in records))
    report = common.begin("filter", _("several records filtered"), model, "abc", given, data=source)
    report.section("a", _("Model and data"))
    for note in dict.fromkeys(note for record in records for note in (*record.notes, *clock.notes(model, record))):
        report.says("**{note}.**", note=note)
    runs = [compute(model, record, algorithm, smooth=smooth) for record in records]
    common.show(report, runs[0].model)
    report.section("b", _("Estimates"))
    _figures(report, records, runs)
    report.section("c", _("What the data say of the model"))
    _told(report, records, runs)
    report.csv("estimates", *_table(records, runs))
    return report


def add(report: Report, model: ModelFile, records: Sequence[Record]) -> None:
    """Filtered records in another study's report: figures, the joint verdict, ``estimates.csv``."""
    runs = [compute(model, record, "joseph") for record in records]
    _figures(report, records, runs)
    _told(report, records, runs)
    report.csv("estimates", *_table(records, runs))


def judged(record: Record, run: Run, level: float) -> Judged:
    """The diagnosis of one record."""
    if not np.isfinite(run.filtered.innovation).any():
        return Judged(record, run, None, _("nothing was measured"))
    try:
        verdict = diagnosis.diagnose(run.model, run.z[run.first :], first=run.first, level=level, longest=diagnosis.LONG, where=run.called)
    except ArithmeticError as error:
        return Judged(record, run, None, str(error))
    return Judged(record, run, verdict)


def joint(found: Sequence[Judged], level: float) -> Joint:
    """The verdict of all records: their tests share one level, with the size of all innovations together as one test more."""
    nis = float(sum(np.nansum(each.run.filtered.nis) for each in found))
    dof = int(sum(each.run.filtered.used.sum() for each in found))
    instants = int(sum(each.run.filtered.used.any(axis=1).sum() for each in found))
    tails = special.gammainc(0.5 * dof, 0.5 * nis), special.gammaincc(0.5 * dof, 0.5 * nis)
    p = min(1.0, 2 * float(min(tails))) if dof else float("nan")
    worse = [each for each in found if each.verdict is not None and not each.verdict.ok]
    if worse:
        told = "; ".join(f"{each.record.name}: {each.verdict.suggestion}" for each in worse if each.verdict is not None)
        kinds = {each.verdict.verdict for each in worse if each.verdict is not None}
        return Joint(nis, dof, instants, p, kinds.pop() if len(kinds) == 1 else "other", told)
    if p < level:
        size = _("larger") if nis > dof else _("smaller")
        text = _("no record alone speaks against the model, but their innovations together are {size} than it says (p = {p})")
        return Joint(nis, dof, instants, p, "other", fill(text, size=size, p=number(p, 2)))
    return Joint(nis, dof, instants, p, "consistent", _("nothing speaks against the model"))


def _told(report: Report, records: Sequence[Record], runs: Sequence[Run]) -> None:
    """What each record says, and all together."""
    level = float(-np.expm1(np.log1p(-LEVEL) / (len(records) + 1)))
    found = [judged(record, run, level) for record, run in zip(records, runs, strict=True)]
    together = joint(found, level)
    report.table(
        "records",
        [_("record"), _("rows"), _("missing"), _("log-likelihood"), _("NIS per instant"), _("expected"), _("verdict")],
        [_row(each) for each in found],
        _("The records, each filtered from the model's own start."),
    )
    if "log_likelihood" not in report.values:
        report.value("log_likelihood", float(sum(run.filtered.log_likelihood for run in runs)))
        diffuse = float(sum(run.filtered.log_likelihood_diffuse for run in runs))
        if diffuse != report.values["log_likelihood"].value:
            report.value("log_likelihood_diffuse", diffuse)
    report.value("records", len(records))
    report.value("missing", sum(record.missing for record in records))
    if together.instants:
        report.value("nis_mean", together.nis / together.instants)
        report.value("nis_expected", together.dof / together.instants)
        report.value("nis_p", together.p)
    for i, each in enumerate(found):
        if each.run.filtered.contradictions:
            filtering.excluding(report, each.run, each.run.model, each.run.filtered, f"contradiction_{i + 1}")
    report.value("verdict", together.verdict)
    report.value("suggestion", together.suggestion)
    report.says(
        _("The log-likelihoods of independent records add up. **Verdict on all {count} records:** {suggestion}."),
        count=len(records), suggestion=together.suggestion.rstrip("."),
    )  # fmt: skip


def _row(each: Judged) -> tuple[Any, ...]:
    filtered = each.run.filtered
    instants = int(filtered.used.any(axis=1).sum())
    size = (float(np.nansum(filtered.nis)) / instants, float(filtered.used.sum()) / instants) if instants else (None, None)
    verdict = each.reason if each.verdict is None else each.verdict.suggestion
    return each.record.name, each.record.rows, each.record.missing, float(filtered.log_likelihood_diffuse), *size, verdict


def _figures(report: Report, records: Sequence[Record], runs: Sequence[Run]) -> None:
    """The estimates of each state, record beside record."""
    model = runs[0].model
    for i, (name, unit) in enumerate(list(zip(model.states, model.units, strict=True))[: common.SHOWN]):
        for j, (record, run) in enumerate(list(zip(records, runs, strict=True))[:DRAWN]):
            measured = common.measured(run.model, i)
            curves = {_("filtered"): (run.filtered.x_plus[:, i], deviations(run.filtered.P_plus)[:, i])}
            if run.smoothed is not None:
                curves[_("smoothed")] = (run.smoothed.x[:, i], deviations(run.smoothed.P)[:, i])
            data = None if measured is None else run.told[:, measured]
            figure = estimates(run.t, curves, data=data, ylabel=common.label(name, unit))
            report.figure(
                f"estimates_{i + 1}_{j + 1}", figure, _("Record {record}: estimates of {name} with their ±σ bands."),
                record=record.name, name=name,
            )  # fmt: skip
    if len(records) > DRAWN:
        report.says(_("Of {count} records the first {drawn} are drawn."), count=len(records), drawn=DRAWN)


def _table(records: Sequence[Record], runs: Sequence[Run]) -> tuple[list[str], list[list[Any]]]:
    """Columns and rows of estimates.csv, with the record's name before them."""
    tables = [table(run) for run in runs]
    columns = ["record", *tables[0][0]]
    common.distinct("estimates.csv", columns)
    return columns, [[record.name, *row] for record, (_columns, rows) in zip(records, tables, strict=True) for row in rows]
