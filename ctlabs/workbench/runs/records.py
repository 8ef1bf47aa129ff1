"""A measured record filtered for the page Data, in a process of the worker: estimates first, then what speaks against the model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ctlabs.analysis import diagnosis
from ctlabs.files.datafile import Record
from ctlabs.files.modelfile import ModelFile, loads
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import deviations
from ctlabs.reporting.drawing import Drawing, Mark, Panel, labelled
from ctlabs.reporting.plots import records as pictures
from ctlabs.reporting.plots.studies import estimates_panel
from ctlabs.studies import common, filtering, forecasting
from ctlabs.studies.filtered import Run, compute
from ctlabs.text import moment, number
from ctlabs.workbench.runs.outcomes import Upload
from ctlabs.workbench.runs.wanted import Wanted

#: Rows that speak against the model, and rows beyond the gate, that are listed.
LISTED = 200
#: Rows on either side of one that is looked at.
BESIDE = 40
Tell = Callable[[int, int, str], object]


@dataclass(frozen=True, slots=True)
class RecordRow:
    """One value that speaks against the model, or was left out: its ``line`` in the file (0: none), instant ``k``, time ``t`` and how
    that is written, the ``quantity``, what is with it, the ``value``, and what it ``differs`` by, as a number and in σ.
    """

    line: int
    k: int
    t: float
    time: str
    quantity: str
    kind: str
    value: float
    differs: float
    sigmas: float


@dataclass(frozen=True, slots=True, eq=False)
class RecordEstimates:
    """A record filtered. K instants, n states, m measurements.

    ``x``, ``sd`` (K, n); ``smoothed``, ``smoothed_sd`` (K, n) or None · ``z`` (K, m), what the measurements say of the states ·
    ``measured``, which of them reads a state alone, −1 if none · ``innovation``, ``innovation_sd`` (K, m), ``nis``, ``dof`` (K,) ·
    ``left_out`` by the gate, ``beyond`` how many in all · ``forecast``, a drawing for each state · ``notes`` in sentences
    """

    source: str
    algorithm: str
    t: Array
    states: tuple[str, ...]
    units: tuple[str, ...]
    measurements: tuple[str, ...]
    measurement_units: tuple[str, ...]
    measured: tuple[int, ...]
    x: Array
    sd: Array
    z: Array
    innovation: Array
    innovation_sd: Array
    nis: Array
    dof: Array
    log_likelihood: float
    rows: int
    missing: int
    smoothed: Array | None = None
    smoothed_sd: Array | None = None
    left_out: tuple[RecordRow, ...] = ()
    beyond: int = 0
    forecast: tuple[Drawing, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """What the record says of the model: ``verdict`` and ``suggestion`` as :class:`ctlabs.analysis.diagnosis.Diagnosis` has them ("" where
    nothing was tested, as ``suggestion`` says), ``rows`` that speak against it, ``tests`` as a table with its heading, ``whiteness``.
    """

    verdict: str
    suggestion: str
    rows: tuple[RecordRow, ...] = ()
    tests: tuple[tuple[Any, ...], ...] = ()
    whiteness: Drawing | None = None

    @property
    def ok(self) -> bool:
        """Whether nothing speaks against the model."""
        return self.verdict == "consistent"


def estimated(model: str, data: Upload, wanted: Wanted, progress: Tell | None = None) -> RecordEstimates:
    """The record with its model: filtered, smoothed where asked for, and continued.

    Raises
    ------
    ValueError, FloatingPointError
        What the reader, the model or the algorithm refuses; one line.
    """
    _tell(progress, 0, "Reading the table")
    file, record = _record(model, data, wanted)
    _tell(progress, 1, "Filtering")
    run = _run(file, record, wanted, test=False)
    found = _estimates(file, record, run)
    if wanted.steps:
        _tell(progress, 2, "Forecasting")
        made = forecasting.compute(file, record, wanted.steps)
        found = replace(found, forecast=tuple(replace(each, name=name) for name, each in forecasting.pictures(made).items()))
    return found


def diagnosed(model: str, data: Upload, wanted: Wanted, progress: Tell | None = None) -> Judgement:
    """What the record says of the model; refusals as of :func:`estimated`."""
    _tell(progress, 0, "Reading the table")
    file, record = _record(model, data, wanted)
    _tell(progress, 1, "Testing the record against the model")
    return judged(_run(file, record, replace(wanted, smooth=False)))


def files(model: str, data: Upload, wanted: Wanted, kind: str) -> bytes:
    """Everything as a file: "csv", every row of the estimates; "html", the report; "forecast", what comes after the record."""
    file, record = _record(model, data, wanted)
    if kind == "forecast":
        return forecasting.study(file, record, wanted.steps or None).files["forecast.csv"]
    report = filtering.study(file, record, algorithm=wanted.algorithm or None, smooth=wanted.smooth, gate=wanted.gate)
    if kind == "csv":
        return report.files["estimates.csv"]
    from ctlabs.reporting import render
    from ctlabs.reporting.report import Picture

    pngs = {block.name: render.png(block.figure) for block in report.blocks if isinstance(block, Picture)}
    return render.html(report, pngs).encode()


def _tell(progress: Tell | None, done: int, what: str) -> None:
    if progress is not None:
        progress(done, 3, what)


def _record(model: str, data: Upload, wanted: Wanted) -> tuple[ModelFile, Record]:
    wanted.check()
    file = loads(model, "")
    records = data.records(file)
    return file, records[min(wanted.which, len(records) - 1)]


def _run(file: ModelFile, record: Record, wanted: Wanted, *, test: bool = True) -> Run:
    form = common.form(file, wanted.algorithm or None)
    return compute(file, record, form, smooth=wanted.smooth, gate=wanted.gate, test=test)


def _estimates(file: ModelFile, record: Record, run: Run) -> RecordEstimates:
    found, model = run.filtered, run.model
    with np.errstate(invalid="ignore"):
        sd = np.sqrt(np.diagonal(found.S, axis1=1, axis2=2))
    left = tuple(
        _row(run, each.row, model.measurements[each.element], "beyond the gate", each.value, each.innovation, each.sigmas)
        for each in found.left_out[:LISTED]
    )
    alone = (common.measured(model, i) for i in range(model.n))
    smoothed = run.smoothed
    return RecordEstimates(
        source=record.source, algorithm=run.algorithm, t=run.t, states=file.states, units=file.units, measurements=file.measurements,
        measurement_units=file.measurement_units, measured=tuple(-1 if j is None else j for j in alone), x=found.x_plus,
        sd=deviations(found.P_plus), z=run.told, innovation=found.innovation,
        innovation_sd=np.where(np.isfinite(found.innovation), sd, np.nan), nis=found.nis, dof=found.used.sum(axis=1).astype(float),
        log_likelihood=float(found.log_likelihood), rows=record.rows, missing=record.missing,
        smoothed=None if smoothed is None else smoothed.x, smoothed_sd=None if smoothed is None else deviations(smoothed.P),
        left_out=left, beyond=len(found.left_out), notes=tuple(f"{note[0].upper()}{note[1:]}." for note in run.notes if note),
    )  # fmt: skip


def _row(run: Run, row: int, quantity: str, kind: str, value: float, differs: float, sigmas: float) -> RecordRow:
    """A row of z from the first measurement on, as a person finds it in the file."""
    k, line = row + run.first, run.line(row)
    at = run.rows[k]
    time = run.record.stamps[at].strip() if run.record.clocked and at >= 0 else moment(float(run.t[k]))
    return RecordRow(line or 0, k, float(run.t[k]), time, quantity, kind, float(value), float(differs), float(sigmas))


def judged(run: Run) -> Judgement:
    """What a diagnosed run says of its model."""
    names = run.model.measurements
    against = [
        _row(run, each.row, names[each.element], "contradiction", run.z[each.row + run.first, each.element], each.innovation, np.nan)
        for each in run.filtered.contradictions[:LISTED]
    ]
    told = run.verdict
    if told is None:
        return Judgement("contradiction" if against else "", run.untested, tuple(against))
    kinds = {"outlier": "outlier", "break": "jump before this row", "stuck": "stuck"}
    for event in told.events:
        quantity = (run.model.states if event.kind == "break" else names)[event.place]
        one = len(event.rows) == 1
        against += [
            _row(run, row, quantity, kinds[event.kind], event.value, event.size if one else np.nan, event.sigmas if one else np.nan)
            for row in event.rows[:LISTED]
        ]
    own = diagnosis.innovations(run.filtered.innovation, run.filtered.S, run.filtered.nis)
    tests: list[tuple[Any, ...]] = [("Test", "Value", "Expected", "p")]
    tests.append(("NIS, mean per instant", own.nis_mean, own.nis_expected, own.nis_p))
    for name, mean, mean_p, white_p in zip(names, told.mean, told.mean_p, told.whiteness_p, strict=True):
        tests.append((f"mean of the standardised innovations of {name}", float(mean), 0, float(mean_p)))
        tests.append((f"whiteness of the innovations of {name}", "", "white", float(white_p)))
    for letter, factor in (("R", told.factor_R), ("Qd", told.factor_Q)):
        if factor is not None:
            tests.append((f"factor on {letter} that makes the record most likely", float(factor), 1, ""))
    correlations = {
        labelled(name, ""): (told.lags[there], r[there], band[there])
        for name, r, band in zip(names, told.autocorrelation, told.band, strict=True)
        if (there := np.isfinite(r)).any()
    }
    drawing = replace(pictures.autocorrelation(correlations), verbatim=True) if correlations else None
    return Judgement(told.verdict, told.suggestion, tuple(sorted(against, key=lambda row: row.k)), tuple(tests), drawing)


# Figures -------------------------------------------------------------------------------------------------------------


def drawn(found: RecordEstimates, states: Sequence[int], row: RecordRow | None = None) -> Drawing:
    """Estimates of some states over the measurements; of the rows beside one alone, where one is looked at."""
    own, marks, reach = _beside(found, row)
    panels = []
    for i in states:
        unit, j = found.units[i], found.measured[i]
        curves = {"filtered": (found.x[own, i], found.sd[own, i])}
        if found.smoothed is not None and found.smoothed_sd is not None:
            curves["smoothed"] = found.smoothed[own, i], found.smoothed_sd[own, i]
        data = found.z[own, j] if j >= 0 and unit == found.measurement_units[j] else None
        panels.append(estimates_panel(found.t[own], curves, labelled(found.states[i], unit), unit, data=data))
    return Drawing("Estimates", "t, s", tuple(panels), verbatim=True, marks=marks, reach=reach)


def innovations(found: RecordEstimates, row: RecordRow | None = None, most: int = 6) -> Drawing:
    """Innovations and NIS in their bands."""
    own, marks, reach = _beside(found, row)
    panels: list[Panel] = []
    for i, (name, unit) in enumerate(list(zip(found.measurements, found.measurement_units, strict=True))[:most]):
        label = labelled(f"innovation of {name}", unit)
        panels.append(pictures.innovation_panel(found.t[own], found.innovation[own, i], found.innovation_sd[own, i], label, unit))
    panels.append(pictures.nis_panel(found.t[own], found.nis[own], found.dof[own]))
    return Drawing("Innovations", "t, s", tuple(panels), verbatim=True, marks=marks, reach=reach)


def _beside(found: RecordEstimates, row: RecordRow | None) -> tuple[slice, tuple[Mark, ...], tuple[float, float] | None]:
    """The instants that are drawn, and the mark at the row that is looked at."""
    if row is None:
        return slice(None), (), None
    low, high = max(row.k - BESIDE, 0), min(row.k + BESIDE, len(found.t) - 1)
    return slice(low, high + 1), (Mark(where(row), row.t, "orange"),), (float(found.t[low]), float(found.t[high]))


def where(row: RecordRow) -> str:
    """How a row is called.

    >>> where(RecordRow(52, 51, 50.0, "50", "flow", "outlier", 9500.0, 8499.0, 56.0))
    'line 52 (t = 50)'
    """
    return f"line {row.line} (t = {row.time})" if row.line else f"t = {row.time}"


def told(row: RecordRow) -> str:
    """What is with a row, in words.

    >>> told(RecordRow(52, 51, 50.0, "50", "flow", "outlier", 9500.0, 8499.0, 56.0))
    'flow = 9500: outlier, 8499 from what the rest suggests (56 σ)'
    """
    value = "" if np.isnan(row.value) else f" = {number(row.value)}"
    if np.isnan(row.differs):
        return f"{row.quantity}{value}: {row.kind}"
    beside = "its prediction" if row.kind in ("beyond the gate", "contradiction") else "what the rest suggests"
    size = f" ({number(row.sigmas, 2)} σ)" if np.isfinite(row.sigmas) else ""
    by = f"by {number(row.differs)}" if row.kind.startswith("jump") else f"{number(abs(row.differs))} from {beside}"
    return f"{row.quantity}{value}: {row.kind}, {by}{size}"
