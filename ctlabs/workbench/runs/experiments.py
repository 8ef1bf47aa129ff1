r"""How an experiment is computed: :func:`run`, in a process of the worker.

Simulated: an ensemble of the truth through the filter (:func:`ctlabs.montecarlo.monte_carlo`), the first few runs with their histories,
one of them by every chosen algorithm. Measured: the record through the filter and the smoother, and what its innovations say.
Nothing is thinned: what a plot shows of a long history is its own matter (:mod:`ctlabs.reporting.levels`).
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ctlabs.analysis import diagnosis
from ctlabs.files import timed
from ctlabs.files.modelfile import ModelFile, loads
from ctlabs.filtering import contradictions
from ctlabs.filtering.comparison import Judged
from ctlabs.filtering.filter import log_likelihood
from ctlabs.filtering.results import Covariances, Filtered
from ctlabs.filtering.smoothing import smooth
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import deviations
from ctlabs.models import DiscreteModel, anomalous
from ctlabs.montecarlo import shares
from ctlabs.studies import common, comparison, simulation
from ctlabs.text import number
from ctlabs.workbench.runs.outcomes import Asked, ErrorStatistics, InnovationTests, Outcome, packed

__all__ = ["Asked", "Outcome", "prepared", "run"]

#: Runs whose histories are shown, and instants up to which covariances are kept whole; of a longer record only the first and the last.
SHOWN, POINTS = 3, 2000
#: Products of numbers with 50 digits that the reference may take, about a second; a longer record is compared in its first steps.
PATIENCE = 3e5


def run(
    model: str,
    plan: Mapping[str, Any],
    progress: Callable[[int, int], object] | None = None,
    workers: int | None = None,
) -> dict[str, Any]:
    """Carry out a plan on a model; the plain form of an :class:`~ctlabs.workbench.runs.outcomes.Outcome`.

    Parameters
    ----------
    model : text of a model file
    plan : plain form of a :class:`~ctlabs.workbench.runs.outcomes.Asked`
    progress : function of (runs done, runs)
    workers : threads

    Raises
    ------
    ValueError, FloatingPointError
        What the model, the design, the data or an algorithm refuses; one line.
    """
    start, wanted = time.perf_counter(), Asked.of(plan)
    wanted.check()
    truth = prepared(model, "", wanted)
    design = None if wanted.design is None else prepared(wanted.design, "design", wanted)
    found = _measured(truth, design, wanted) if wanted.data else _simulated(truth, design, wanted, progress or False, workers)
    return packed(dataclasses.replace(found, seconds=time.perf_counter() - start))


def prepared(text: str, name: str, plan: Asked) -> ModelFile:
    """A model file with the plan's first measurement."""
    file = loads(text, name)
    return file if file.experiment.first == plan.first else file.edit(("experiment", "first"), plan.first).checked()


# Simulated -----------------------------------------------------------------------------------------------------------


def _simulated(file: ModelFile, other: ModelFile | None, plan: Asked, progress: Any, workers: int | None) -> Outcome:
    found = simulation.compute(
        file, design=other, runs=plan.runs, seed=plan.seed, steps=plan.steps, first=plan.first, anomalies=plan.anomalies,
        algorithms=plan.algorithms, histories=min(SHOWN, plan.runs), workers=workers, progress=progress,
    )  # fmt: skip
    name, own = comparison.working(found.tried)
    z, true, actual = found.some.z, found.true, found.actual
    return Outcome(
        kind="simulation",
        algorithm=name,
        k=np.arange(plan.steps + 1),
        t=file.experiment.t0 + found.some.t,
        **_labels(other or file, found.design),
        z=z,
        truth=true,
        **_histories(own),
        estimates={name: f.x_plus[:, :, 0] for name, (f, _, _) in found.tried.items() if f is not None},
        **_covariances(found.claimed),
        statistics=_statistics(found),
        actual_P=None if actual is None else actual.P_plus,
        actual_bias=None if actual is None else actual.bias_plus,
        optimal_sd=found.optimal,
        verdict=_tested(own),
        algorithms=_algorithms(found.design, z[plan.first :, :, 0], found.tried, plan.first, true[-1]),
        log_likelihood=float(own.log_likelihood[0]),
        summary=found.summary,
        notes=_refused(found.tried, name),
        contradiction=_contradiction(found.design, own, (file.experiment.t0 + own.t)[plan.first :]),
    )


def _refused(tried: dict[str, comparison.Attempt], name: str) -> tuple[str, ...]:
    """What is to be said where the results are not those of the algorithm that was named first."""
    asked = next(iter(tried))
    return () if asked == name else (f"The results are those of {name}. {asked} refused: {tried[asked].failed}.",)


def _algorithms(
    model: DiscreteModel, z: Array, tried: dict[str, comparison.Attempt], first: int, true: Array | None = None
) -> tuple[Judged, ...]:
    """The chosen algorithms on the first record: cost, accuracy, and errors of simulated runs."""
    rows = comparison.judge(model, z, tried, first, PATIENCE)
    if true is None:
        return tuple(rows)
    ends = {name: each.filtered.x_plus[-1] for name, each in tried.items() if each.filtered is not None}
    rms = {name: np.sqrt(np.mean((x - true) ** 2, axis=-1)) for name, x in ends.items()}
    return tuple(each if each.failed else dataclasses.replace(each, rms=rms[each.name]) for each in rows)


def _statistics(found: simulation.Simulated) -> ErrorStatistics:
    stats, P = found.stats, found.P
    columns = {name: getattr(stats, name) for name in ("rms", "bias", "nees", "nees_dof", "nis", "nis_dof")}
    bands = {"rms": stats.rms_band(P), "bias": stats.bias_band(P), "nees": stats.nees_band(), "nis": stats.nis_band()}
    share = None
    if found.actual is None and found.truth.N is None:  # the errors of another model's filter depend on the states too
        share = shares.outside(stats, found.truth, found.claimed)
    return ErrorStatistics(
        runs=stats.runs, **columns, **{f"{name}_band": np.array(band) for name, band in bands.items()},
        outside=None if share is None else share._asdict(),
    )  # fmt: skip


# Measured ------------------------------------------------------------------------------------------------------------


def _measured(file: ModelFile, other: ModelFile | None, plan: Asked) -> Outcome:
    assert plan.data is not None
    used = file if other is None else other
    record = plan.data.record(used)
    model, z, t = timed(used, record)
    steps = len(z) - 1
    model = anomalous(model, plan.anomalies, steps)
    tried = comparison.tried(model, z[plan.first :], plan.algorithms, plan.first)
    name, own = comparison.working(tried)
    whole = smooth(model, own)
    summary: dict[str, tuple[Any, str]] = {"rows": (record.rows, ""), "missing": (record.missing, "")}
    sd = deviations(own.P_plus)
    for what, values in (("estimate", own.x_plus[-1]), ("sd", sd[-1])):
        for state, unit, value in zip(used.states, used.units, values, strict=True):
            summary[f"{what}[{state}]"] = float(value), unit
    summary["log_likelihood"] = float(own.log_likelihood), ""
    if other is not None:
        truth, own_z, _t = timed(file, plan.data.record(file))
        better = log_likelihood(anomalous(truth, plan.anomalies, steps), own_z[plan.first :], plan.first)
        summary["log_likelihood_of_the_other_model"] = better, ""
    verdict = _diagnosed(model, own, plan.first)
    if verdict is not None:
        summary |= {name: (getattr(verdict, name), "") for name in ("nis_mean", "nis_expected", "nis_p", "verdict")}
    many = dataclasses.replace(
        own, **{n: getattr(own, n)[..., None] for n in ("x_minus", "x_plus", "innovation", "nis", "z")}
    )
    return Outcome(
        kind="data",
        algorithm=name,
        k=np.arange(steps + 1),
        t=t,
        **_labels(used, model),
        z=own.z[:, :, None],
        truth=None,
        **_histories(many),
        estimates={name: f.x_plus for name, (f, _, _) in tried.items() if f is not None},
        **_covariances(own),
        verdict=verdict,
        algorithms=_algorithms(model, z[plan.first :], tried, plan.first),
        log_likelihood=float(own.log_likelihood),
        smoothed=whole.x,
        smoothed_sd=deviations(whole.P),
        summary=summary,
        notes=_refused(tried, name),
        contradiction=_contradiction(model, own, t[plan.first :]),
    )


def _diagnosed(model: DiscreteModel, own: Filtered, first: int) -> InnovationTests | None:
    """The tests of the record, and what would make it (of a long one, its first rows) more likely."""
    tested = _tested(own)
    if tested is None:
        return None
    found = diagnosis.diagnose(model, own, first=first, longest=diagnosis.LONG)
    return dataclasses.replace(tested, **{name: getattr(found, name) for name in ("verdict", "suggestion", "factor_R", "factor_Q")})


def _contradiction(model: DiscreteModel, own: Filtered, t: Array) -> str:
    """Why the record, or the first of the shown runs that is, is impossible for the model."""
    if not own.contradictions:
        return ""
    first = own.contradictions[0]
    found = [each for each in own.contradictions if each.run == first.run]
    where = f"row {first.row} (t = {number(float(t[first.row]))} s)" + (f" of run {first.run + 1}" if first.run else "")
    return contradictions.sentence(found, model.measurements, where)


# Both ----------------------------------------------------------------------------------------------------------------


def _tested(found: Filtered) -> InnovationTests | None:
    """NIS, mean and whiteness of the innovations of a record, or of the first run."""
    innovation, nis = (a if found.x_plus.ndim == 2 else a[..., 0] for a in (found.innovation, found.nis))
    if not np.isfinite(innovation).any():
        return None
    own = diagnosis.innovations(innovation, found.S, nis)
    same = {name: getattr(own, name) for name in ("nis_mean", "nis_expected", "nis_p", "mean_p", "whiteness_p", "lags", "band")}
    return InnovationTests(**same, nis_low=own.nis_band[0], nis_high=own.nis_band[1], correlation=own.autocorrelation)


def _covariances(found: Covariances) -> dict[str, Any]:
    """The gains and covariances of all instants; of a long record the variances, and the covariances of the first and the last."""
    if len(found.t) <= POINTS + 1:
        return {"K": found.K, "P_minus": found.P_minus, "P_plus": found.P_plus}
    at = np.append(np.arange(POINTS), found.steps)
    variances = {f"var_{when}": np.diagonal(getattr(found, f"P_{when}"), axis1=1, axis2=2).copy() for when in ("minus", "plus")}
    return {"K": found.K, "at": at, "P_minus": found.P_minus[at], "P_plus": found.P_plus[at], **variances}


def _histories(found: Filtered) -> dict[str, Any]:
    """Estimates and innovations of the shown runs."""
    with np.errstate(invalid="ignore"):
        sd = np.sqrt(np.diagonal(found.S, axis1=1, axis2=2))
    dof = found.used.sum(axis=1).astype(float)
    return {
        "x_minus": found.x_minus,
        "x_plus": found.x_plus,
        "innovation": found.innovation,
        "innovation_sd": np.where(found.used & np.isfinite(sd), sd, np.nan),
        "nis": found.nis,
        "nis_dof": dof,
    }


def _labels(file: ModelFile, model: DiscreteModel) -> dict[str, Any]:
    """Names and units, and which measurement reads each state alone (−1: none does)."""
    alone = (common.measured(model, i) for i in range(model.n))
    names = ("states", "units", "measurements", "measurement_units")
    labels = {name: getattr(file, name) for name in names}
    return labels | {"H": model.H, "measured": tuple(-1 if j is None else j for j in alone)}

