r"""How an experiment is computed: :func:`run`, in a process of the worker.

Simulated: an ensemble of the truth through the filter (:func:`ctlabs.montecarlo.monte_carlo`), the first few runs with their histories,
one of them by every chosen algorithm. Measured: the record through the filter and the smoother, and what its innovations say.
Long histories are thinned to what a plot can show (``k`` says which instants are left); statistics are over all runs and instants.
"""

from __future__ import annotations

import contextlib
import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.special import chdtri

from ctlabs import montecarlo
from ctlabs.analysis import diagnosis, sensitivity
from ctlabs.files.modelfile import ModelFile, loads
from ctlabs.filtering import contradictions
from ctlabs.filtering.comparison import compare, flops
from ctlabs.filtering.filter import kalman_filter, log_likelihood
from ctlabs.filtering.results import Covariances, Filtered
from ctlabs.filtering.smoothing import smooth
from ctlabs.labs.experiment import Experiment
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import deviations
from ctlabs.models import DiscreteModel
from ctlabs.studies import clock, common, comparison
from ctlabs.text import number
from ctlabs.workbench.outcomes import Algorithm, Anomaly, Outcome, Plan, Statistics, Verdict, packed

__all__ = ["Outcome", "Plan", "anomalous", "prepared", "run"]

#: Runs whose histories are shown, and instants that are kept of them.
SHOWN, POINTS = 3, 2000
#: Products of numbers with 50 digits that the reference may take, about a second; a longer record is compared in its first steps.
PATIENCE = 3e5


def run(
    model: str,
    plan: Mapping[str, Any],
    progress: Callable[[int, int], object] | None = None,
    workers: int | None = None,
) -> dict[str, Any]:
    """Carry out a plan on a model; the plain form of an :class:`~ctlabs.workbench.outcomes.Outcome`.

    Parameters
    ----------
    model : text of a model file
    plan : plain form of a :class:`~ctlabs.workbench.outcomes.Plan`
    progress : function of (runs done, runs)
    workers : threads

    Raises
    ------
    ValueError, FloatingPointError
        What the model, the design, the data or an algorithm refuses; one line.
    """
    start, wanted = time.perf_counter(), Plan.of(plan)
    wanted.check()
    truth = prepared(model, "", wanted)
    design = None if wanted.design is None else prepared(wanted.design, "design", wanted)
    simulated = wanted.data is None
    found = (
        _simulated(truth, design, wanted, progress or False, workers) if simulated else _measured(truth, design, wanted)
    )
    return packed(dataclasses.replace(found, seconds=time.perf_counter() - start))


def anomalous(model: DiscreteModel, anomalies: Sequence[Anomaly], steps: int) -> DiscreteModel:
    """The model with other variances at some instants: R becomes (steps+1, m, m).

    >>> walk = DiscreteModel([[1]], [[1]], [[1]], [[4]], x0=[0], P0=[[1]])
    >>> anomalous(walk, [Anomaly(2, 0, 0.0)], 3).R[:, 0, 0]
    array([4., 4., 0., 4.])
    """
    if not anomalies:
        return model
    if model.N is not None:
        msg = "anomaly: expected a model whose two noises are independent, received one with N (it belongs to one R)"
        raise ValueError(msg)
    R = np.array(np.broadcast_to(model.R, (steps + 1, model.m, model.m)))
    for anomaly in anomalies:
        i, last = anomaly.measurement, anomaly.k if anomaly.last is None else anomaly.last
        if i >= model.m or last > steps:
            name, most, got = ("measurement", model.m - 1, i) if i >= model.m else ("k", steps, last)
            msg = f"anomaly.{name}: expected a whole number from 0 to {most}, received {got}"
            raise ValueError(msg)
        at = slice(anomaly.k, last + 1)
        R[at, i, :] = R[at, :, i] = 0.0
        R[at, i, i] = anomaly.R
    return dataclasses.replace(model, R=R)


def prepared(text: str, name: str, plan: Plan) -> ModelFile:
    """A model file with the plan's first measurement."""
    file = loads(text, name)
    return file if file.experiment.first == plan.first else file.edit(("experiment", "first"), plan.first).checked()


class Attempt(NamedTuple):
    """A record by one algorithm, in so many seconds a step; or why it refused."""

    filtered: Filtered | None
    seconds: float
    failed: str


Tried = dict[str, Attempt]


# Simulated -----------------------------------------------------------------------------------------------------------


class _Theory(NamedTuple):
    """The filter's covariances, and the true errors of a design that is not the truth."""

    E: Array
    claimed: Covariances
    P: Array
    actual: sensitivity.Actual | None
    optimal: Array | None


def _simulated(file: ModelFile, other: ModelFile | None, plan: Plan, progress: Any, workers: int | None) -> Outcome:
    steps, first = plan.steps, plan.first
    truth = anomalous(file.discrete(steps=steps), plan.anomalies, steps)
    design = truth if other is None else anomalous(other.discrete(steps=steps), plan.anomalies, steps)
    E = np.eye(truth.n) if other is None else common.stands_for(truth, design)
    experiment = Experiment(plan.runs, plan.seed, workers)
    few = experiment.histories(truth, steps=steps, runs=min(SHOWN, plan.runs), first=first)
    assert few.truth is not None
    tried = _tried(design, few.z[first:], plan)
    name, own = _first(tried)
    applied = own if name == "steady" else None  # a constant gain, and what a filter with it claims
    theory = _theory(truth, None if other is None else design, E, few, applied, plan)
    stats = experiment.statistics(
        truth,
        None if other is None else design,
        steps=steps,
        compare=E,
        gains=applied,
        first=first,
        progress=progress,
    )
    true = np.einsum("di,kir->kdr", theory.E, few.truth)
    k = _kept(steps)
    return Outcome(
        kind="simulation",
        algorithm=name,
        k=k,
        t=(file.experiment.t0 + few.t)[k],
        **_labels(other or file),
        measured=_read_alone(design),
        z=few.z[k],
        truth=true[k],
        **_histories(own, k),
        estimates={name: f.x_plus[k, :, 0] for name, (f, _, _) in tried.items() if f is not None},
        P_minus=theory.claimed.P_minus[k],
        P_plus=theory.claimed.P_plus[k],
        K=theory.claimed.K[k],
        statistics=_statistics(stats, theory.P, k),
        actual_P=None if theory.actual is None else theory.actual.P_plus[k],
        actual_bias=None if theory.actual is None else theory.actual.bias_plus[k],
        optimal_sd=None if theory.optimal is None else theory.optimal[k],
        verdict=_tested(own),
        algorithms=_algorithms(design, few.z[first:, :, 0], plan, tried, true),
        log_likelihood=float(own.log_likelihood[0]),
        summary=_summary(other or file, stats, theory, float(own.log_likelihood[0])),
        notes=(*_refused(tried, name), *_thinned(k, steps, "statistics are over all of them")),
        contradiction=_contradiction(design, own, (file.experiment.t0 + own.t)[first:]),
    )


def _theory(
    truth: DiscreteModel,
    design: DiscreteModel | None,
    E: Array,
    optimal: Covariances,
    applied: Covariances | None,
    plan: Plan,
) -> _Theory:
    """What is known before any run, of the optimal filter or of one with another model or gain."""
    if design is None and applied is None:
        return _Theory(E, optimal, optimal.P_plus, None, None)
    actual = sensitivity.actual(truth, design or truth, plan.steps, compare=E, gains=applied, first=plan.first)
    return _Theory(E, actual.claimed, actual.P_plus, actual, deviations(E @ optimal.P_plus @ E.T))


def _tried(model: DiscreteModel, z: Array, plan: Plan) -> Tried:
    """A record, or the shown runs, by every algorithm."""
    found: Tried = {}
    for name in plan.algorithms:
        # What is loaded at the first call is not the algorithm's time.
        with contextlib.suppress(ValueError, ArithmeticError):
            kalman_filter(model.cut(1), z[: 2 - plan.first], first=plan.first, algorithm=name)
        start = time.perf_counter()
        try:
            filtered = kalman_filter(model, z, first=plan.first, algorithm=name)
        except (ValueError, ArithmeticError) as error:
            found[name] = Attempt(None, 0.0, " ".join(str(error).split()))
        else:
            found[name] = Attempt(filtered, (time.perf_counter() - start) / len(z), "")
    return found


def _first(tried: Tried) -> tuple[str, Filtered]:
    """The first algorithm that works, and its result."""
    for name, attempt in tried.items():
        if attempt.filtered is not None:
            return name, attempt.filtered
    raise ValueError(next(iter(tried.values())).failed)


def _refused(tried: Tried, name: str) -> tuple[str, ...]:
    """What is to be said where the results are not those of the algorithm that was named first."""
    asked = next(iter(tried))
    return () if asked == name else (f"The results are those of {name}. {asked} refused: {tried[asked].failed}.",)


def _algorithms(model: DiscreteModel, z: Array, plan: Plan, tried: Tried, true: Array | None) -> tuple[Algorithm, ...]:
    """The chosen algorithms on the first record: cost, and (if there are several) accuracy against 50 digits."""
    compared: dict[str, comparison.Judged] = {}
    if len(tried) > 1:
        per_step = model.n**3 + model.n**2 * model.m + model.m**3
        steps = min(len(z) - 1 + plan.first, max(int(PATIENCE / per_step), 2))
        found = compare(model.cut(steps), z[: steps + 1 - plan.first], list(tried), plan.first)
        compared = {each.name: each for each in comparison.judged(found, _first(tried)[1].P_plus[: steps + 1])}
    rows = []
    for name, (filtered, seconds, failed) in tried.items():
        each = compared.get(name)
        why = failed or (each.form.failed if each else "")
        if filtered is None or why:
            rows.append(Algorithm(name, failed=why.removeprefix(f"form {name}: ")))
            continue
        rms = None if true is None else np.sqrt(np.mean((filtered.x_plus[-1] - true[-1]) ** 2, axis=-1))
        if each is None:
            rows.append(Algorithm(name, flops(model.cut(1), name), seconds, rms=rms))
        else:
            form = each.form
            rows.append(Algorithm(name, form.flops, form.seconds, form.error_P, each.error_x, rms))
    return tuple(rows)


def _statistics(stats: montecarlo.Statistics, P: Array, k: Array) -> Statistics:
    bands = [
        np.array(band)[:, k] for band in (stats.rms_band(P), stats.bias_band(P), stats.nees_band(), stats.nis_band())
    ]
    return Statistics(
        runs=stats.runs,
        rms=stats.rms[k],
        bias=stats.bias[k],
        rms_band=bands[0],
        bias_band=bands[1],
        nees=stats.nees[k],
        nees_dof=stats.nees_dof[k],
        nees_band=bands[2],
        nis=stats.nis[k],
        nis_dof=stats.nis_dof[k],
        nis_band=bands[3],
    )


def _summary(
    file: ModelFile, stats: montecarlo.Statistics, theory: _Theory, log_likelihood: float
) -> dict[str, tuple[Any, str]]:
    """The numbers to copy."""
    found: dict[str, tuple[Any, str]] = {}
    claimed = theory.claimed.sd_plus[-1]
    columns = {"sd_theory": claimed, "rms": stats.rms[-1], "rms_se": stats.rms_se[-1], "bias": stats.bias[-1]}
    if theory.actual is not None and theory.optimal is not None:
        actual = np.sqrt(np.diag(theory.actual.mse_plus[-1]).clip(0))
        columns = {"sd_claimed": claimed, "rms_theory": actual, "sd_optimal": theory.optimal[-1]} | {
            key: columns[key] for key in ("rms", "rms_se", "bias")
        }
    for name, values in columns.items():
        for state, unit, value in zip(file.states, file.units, values, strict=True):
            found[f"{name}[{state}]"] = float(value), unit
    for name, average, dof in (("nees", stats.nees, stats.nees_dof), ("nis", stats.nis, stats.nis_dof)):
        if (dof > 0).any():
            found[f"{name}_mean"] = float(average[dof > 0].mean()), ""
            found[f"{name}_expected"] = float(dof[dof > 0].mean()), ""
    found["log_likelihood_run_1"] = log_likelihood, ""
    return found


# Measured ------------------------------------------------------------------------------------------------------------


def _measured(file: ModelFile, other: ModelFile | None, plan: Plan) -> Outcome:
    assert plan.data is not None
    used = file if other is None else other
    record = plan.data.record(used)
    model, z, t = clock.timed(used, record)
    steps = len(z) - 1
    model = anomalous(model, plan.anomalies, steps)
    tried = _tried(model, z[plan.first :], plan)
    name, own = _first(tried)
    whole = smooth(model, own)
    k = _kept(steps)
    summary: dict[str, tuple[Any, str]] = {"rows": (record.rows, ""), "missing": (record.missing, "")}
    sd = deviations(own.P_plus)
    for what, values in (("estimate", own.x_plus[-1]), ("sd", sd[-1])):
        for state, unit, value in zip(used.states, used.units, values, strict=True):
            summary[f"{what}[{state}]"] = float(value), unit
    summary["log_likelihood"] = float(own.log_likelihood), ""
    if other is not None:
        truth, own_z, _t = clock.timed(file, plan.data.record(file))
        better = log_likelihood(anomalous(truth, plan.anomalies, steps), own_z[plan.first :], plan.first)
        summary["log_likelihood_of_the_other_model"] = better, ""
    verdict = _diagnosed(model, own, plan.first)
    if verdict is not None:
        summary |= {
            "nis_mean": (verdict.nis_mean, ""),
            "nis_expected": (verdict.nis_expected, ""),
            "nis_p": (verdict.nis_p, ""),
        }
        summary["verdict"] = verdict.verdict, ""
    many = dataclasses.replace(
        own, **{n: getattr(own, n)[..., None] for n in ("x_minus", "x_plus", "innovation", "nis", "z")}
    )
    return Outcome(
        kind="data",
        algorithm=name,
        k=k,
        t=t[k],
        **_labels(used),
        measured=_read_alone(model),
        z=z[k, :, None],
        truth=None,
        **_histories(many, k),
        estimates={name: f.x_plus[k] for name, (f, _, _) in tried.items() if f is not None},
        P_minus=own.P_minus[k],
        P_plus=own.P_plus[k],
        K=own.K[k],
        verdict=verdict,
        algorithms=_algorithms(model, z[plan.first :], plan, tried, None),
        log_likelihood=float(own.log_likelihood),
        smoothed=whole.x[k],
        smoothed_sd=deviations(whole.P)[k],
        summary=summary,
        notes=(*_refused(tried, name), *_thinned(k, steps, "all were filtered")),
        contradiction=_contradiction(model, own, t[plan.first :]),
    )


def _diagnosed(model: DiscreteModel, own: Filtered, first: int) -> Verdict | None:
    """The tests of the record, and what would make it (of a long one, its first rows) more likely."""
    tested = _tested(own)
    if tested is None:
        return None
    found = diagnosis.diagnose(model, own, first=first, longest=diagnosis.LONG)
    return dataclasses.replace(
        tested, verdict=found.verdict, suggestion=found.suggestion, factor_R=found.factor_R, factor_Q=found.factor_Q
    )


def _contradiction(model: DiscreteModel, own: Filtered, t: Array) -> str:
    """Why the record, or the first of the shown runs that is, is impossible for the model."""
    if not own.contradictions:
        return ""
    first = own.contradictions[0]
    found = [each for each in own.contradictions if each.run == first.run]
    where = f"row {first.row} (t = {number(float(t[first.row]))} s)" + (f" of run {first.run + 1}" if first.run else "")
    return contradictions.sentence(found, model.measurements, where)


# Both ----------------------------------------------------------------------------------------------------------------


def _tested(found: Filtered) -> Verdict | None:
    """NIS, mean and whiteness of the innovations of a record, or of the first run."""
    innovation, nis = (a if found.x_plus.ndim == 2 else a[..., 0] for a in (found.innovation, found.nis))
    if not np.isfinite(innovation).any():
        return None
    own = diagnosis.innovations(innovation, found.S, nis)
    return Verdict(
        nis_mean=own.nis_mean,
        nis_expected=own.nis_expected,
        nis_low=own.nis_band[0],
        nis_high=own.nis_band[1],
        nis_p=own.nis_p,
        mean_p=own.mean_p,
        whiteness_p=own.whiteness_p,
        lags=own.lags,
        correlation=own.autocorrelation,
        band=own.band,
    )


def _histories(found: Filtered, k: Array) -> dict[str, Any]:
    """Estimates and innovations of the shown runs at the kept instants."""
    with np.errstate(invalid="ignore"):
        sd = np.sqrt(np.diagonal(found.S, axis1=1, axis2=2))
    dof = found.used.sum(axis=1).astype(float)
    band = np.where(dof > 0, np.array([chdtri(np.maximum(dof, 1), p) for p in (0.975, 0.025)]), np.nan)
    return {
        "x_minus": found.x_minus[k],
        "x_plus": found.x_plus[k],
        "innovation": found.innovation[k],
        "innovation_sd": np.where(found.used & np.isfinite(sd), sd, np.nan)[k],
        "nis": found.nis[k],
        "nis_dof": dof[k],
        "nis_band": band[:, k],
    }


def _labels(file: ModelFile) -> dict[str, Any]:
    names = ("states", "units", "measurements", "measurement_units")
    return {name: getattr(file, name) for name in names}


def _read_alone(model: DiscreteModel) -> tuple[int, ...]:
    """Which measurement reads each state alone, −1 if none does."""
    found = (common.measured(model, i) for i in range(model.n))
    return tuple(-1 if j is None else j for j in found)


def _kept(steps: int) -> Array:
    """The instants that are shown."""
    if steps < POINTS:
        return np.arange(steps + 1)
    return np.unique(np.linspace(0, steps, POINTS).round().astype(np.int64))


def _thinned(k: Array, steps: int, rest: str) -> tuple[str, ...]:
    """What is to be said where not all instants are shown."""
    return () if len(k) == steps + 1 else (f"{len(k)} of {steps + 1} instants are shown; {rest}.",)
