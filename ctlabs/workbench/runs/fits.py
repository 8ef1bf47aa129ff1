"""Constants fitted to a record for the page Fit, in a process of the worker: the likelihood as it rises, and what is known in the end."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ctlabs.analysis.fitting import Progress
from ctlabs.files.modelfile import ModelFile, loads
from ctlabs.linalg.checks import Array
from ctlabs.reporting.drawing import Curve, Drawing, Mark, Panel, labelled
from ctlabs.reporting.plots.records import DROP
from ctlabs.studies import filtered, fitting
from ctlabs.text import _
from ctlabs.workbench.runs.inside import Unwanted
from ctlabs.workbench.runs.outcomes import Upload
from ctlabs.workbench.runs.records import Judgement, judged

#: A rise of the log-likelihood that says nothing: that of a tenth of a standard error.
RISE = 0.005


@dataclass(frozen=True, slots=True)
class Point:
    """How far a fit is: its ``stage``, ``best`` log-likelihood so far after so many ``done``, and about how many seconds are ``left``."""

    stage: str
    best: float
    done: int
    left: float


@dataclass(frozen=True, slots=True)
class Side:
    """A model with the record, before the fit or after: its constants' ``values``, ``log_likelihood``, NIS per instant and what is
    expected of it, and the ``judgement``.
    """

    values: tuple[float, ...]
    log_likelihood: float
    nis: float
    expected: float
    judgement: Judgement


@dataclass(frozen=True, slots=True, eq=False)
class FitResult:
    """What a fit found, constant by constant of ``names`` with their ``units``.

    ``values``, standard ``errors`` (NaN: none, see ``reasons``), 95 % ``intervals`` · ``correlation`` (p, p) or None · ``profiles`` ·
    ``before`` and ``after`` (None where the search was cancelled before they could be computed) · ``aic`` · ``converged``,
    ``interrupted`` · ``remark`` · ``evaluations`` of the likelihood, ``seconds`` · ``model``, the text it began from, and its ``source``
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    start: tuple[float, ...]
    values: tuple[float, ...]
    errors: tuple[float, ...]
    intervals: tuple[tuple[float, float] | None, ...]
    reasons: dict[str, str]
    correlation: Array | None
    profiles: tuple[Drawing, ...]
    log_likelihood: float
    start_log_likelihood: float
    aic: float
    converged: bool
    interrupted: bool
    remark: str
    evaluations: int
    model: str
    source: str
    before: Side | None = None
    after: Side | None = None

    @property
    def estimates(self) -> dict[str, float]:
        """The constants by name."""
        return dict(zip(self.names, self.values, strict=True))


def fitted(
    model: str, data: Upload, free: Sequence[str], starts: int = 0, progress: Callable[[int, int, Any], object] | None = None
) -> FitResult:
    """The constants ``free`` that make the records in the data most likely; a cancelled search gives the best that it found.

    Raises
    ------
    ValueError
        No constant chosen; what the reader or the model refuses; a start at which there is no likelihood.
    """
    if not free:
        raise ValueError("constants: expected one at least to be fitted, received none")
    file = loads(model, "")
    records = data.records(file)
    stopped = False

    def tell(state: Progress) -> None:
        nonlocal stopped
        if progress is None or stopped:
            return
        try:
            progress(state.done, state.expected, Point(_(state.stage), float(state.best), state.done, float(state.left)))
        except Unwanted:
            stopped = True
            raise KeyboardInterrupt from None  # as Ctrl-C ends a search: with the best so far

    made = fitting.compute(file, records, free, starts, tell)
    found = made.fit
    units = {each.name: each.unit for each in file.definitions}
    errors = tuple(math.nan if (error := found.standard_errors[name]) is None else error for name in found.names)
    sides: tuple[Side | None, Side | None] = (None, None)
    if not stopped:
        if progress is not None:
            end = Point("the record is tested before and after", found.log_likelihood, found.evaluations, math.nan)
            progress(found.evaluations, found.evaluations, end)
        sides = _side(file, records, found.names), _side(made.model, records, found.names)
    return FitResult(
        names=found.names, units=tuple(units[name] for name in found.names), start=tuple(found.start.values()),
        values=tuple(found.estimates.values()), errors=errors, intervals=tuple(found.intervals.get(name) for name in found.names),
        reasons=dict(found.reasons), correlation=found.correlation,
        profiles=tuple(
            _profile(labelled(name, units[name]), found.estimates[name], found.standard_errors[name], *found.profiles[name],
                     top=found.log_likelihood_diffuse)
            for name in found.names if name in found.profiles
        ),
        log_likelihood=found.log_likelihood, start_log_likelihood=found.start_log_likelihood, aic=found.aic, converged=found.converged,
        interrupted=found.interrupted, remark=found.remark, evaluations=found.evaluations, model=model, source=data.name,
        before=sides[0], after=sides[1],
    )  # fmt: skip


def _side(file: ModelFile, records: Sequence[Any], names: Sequence[str]) -> Side:
    """All records with a model; the judgement is that of the first that speaks against it."""
    runs = [filtered.compute(file, each, "auto") for each in records]
    instants = sum(int(run.filtered.used.any(axis=1).sum()) for run in runs)
    nis = sum(float(np.nansum(run.filtered.nis)) for run in runs)
    dof = sum(int(run.filtered.used.sum()) for run in runs)
    told = [judged(run) for run in runs]
    return Side(
        values=tuple(file.constants[name] for name in names), log_likelihood=sum(float(run.filtered.log_likelihood) for run in runs),
        nis=nis / instants if instants else math.nan, expected=dof / instants if instants else math.nan,
        judgement=next((each for each in told if not each.ok), told[0]),
    )  # fmt: skip


def _profile(label: str, estimate: float, error: float | None, values: Array, likelihood: Array, *, top: float) -> Drawing:
    """The profile log-likelihood of a constant below its top, the parabola of its standard error, and the level of the 95 % interval."""
    curves = [Curve("profile log-likelihood", values, likelihood - top, "blue", "line")]
    if error is not None:
        fine = np.linspace(values.min(), values.max(), 121)
        curves.insert(0, Curve("quadratic approximation", fine, -0.5 * ((fine - estimate) / error) ** 2, "grey", "dash"))
    curves.append(Curve("estimate", [estimate], [0.0], "black", "points"))
    panel = Panel("ℓ − maximum", tuple(curves), levels=(Mark("95 % level", -DROP, "orange", "dot"),), reach=(-2.2 * DROP, 0.25 * DROP))
    return Drawing(f"Profile of {label}", label, (panel,), verbatim=True)


def trace(points: Sequence[Point]) -> Drawing:
    """The best log-likelihood after so many evaluations; a rise of less than :data:`RISE` looks like none."""
    done, best = (np.array([getattr(point, name) for point in points], dtype=float) for name in ("done", "best"))
    best[~np.isfinite(best)] = np.nan
    low, high = (np.nanmin(best), np.nanmax(best)) if np.isfinite(best).any() else (0.0, 1.0)
    low = min(low, high - RISE)
    reach = float(low - 0.05 * (high - low)), float(high + 0.05 * (high - low))
    return Drawing("The likelihood as it rises", "likelihoods computed", (Panel("best ℓ", (Curve("best ℓ", done, best),), reach=reach),))
