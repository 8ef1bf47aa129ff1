"""One record through any form of the filter, in any kind of number, instant by instant."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np

from ctlabs.filtering import contradictions
from ctlabs.filtering.algorithms import beginning, contract
from ctlabs.filtering.algorithms.beginning import Beginning
from ctlabs.filtering.algorithms.catalogue import form as named
from ctlabs.filtering.algorithms.contract import Form, Noise, Numbers
from ctlabs.filtering.engines import adapter
from ctlabs.filtering.engines.record import ByInstant
from ctlabs.filtering.measured import any_perfect
from ctlabs.filtering.problem import FilterProblem
from ctlabs.filtering.results import Filtered, Mask, gains
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import symmetric
from ctlabs.models.linear import DiscreteModel
from ctlabs.text import moment


def run(problem: FilterProblem, form: str, kind: Any = float, *, own_start: bool = False) -> tuple[Filtered, float]:
    """The record by one form in one kind of number, rounded to doubles; and the seconds per step of prediction and update.

    From a P0 of which a part is unknown, or very large beside the noises, the form takes over when that part is known about as
    well as the noises allow (:mod:`ctlabs.filtering.algorithms.vague`): from such a P0 itself most forms lose digits. With
    ``own_start`` it starts from a finite P0 itself, to see what it loses.
    """
    how, model, data = named(form), problem.model, problem.z
    given = model.P0
    record = ByInstant(model, data, kind, entering(problem))
    steps, runs = len(data) - 1, data.shape[2]
    itself = form == "steady" or (own_start and bool(np.isfinite(given).all()))
    begun = None if itself else beginning.begin(record, contract.numbers(given, kind))
    out = _Histories(steps, model.n, model.m, runs)
    seconds, begin, k = 0.0, 0, 0
    if begun is not None:
        begin = out.begin(begun)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # overflows are reported below, with their time
        try:
            if begun is None:
                state = how.start(model, contract.numbers(given, kind))
            elif begun.x is not None and begun.P is not None:
                state = taken_over(how, model, begun.x, begun.P)
            for k in range(begin, steps + 1):
                if k > begin:
                    step, before = record.motion(k - 1), perf_counter()
                    state = how.predict(state, *step)
                    seconds += perf_counter() - before
                x, P = state.mean, state.covariance
                out.x_minus[k], out.P_minus[k] = contract.doubles(x), contract.doubles(P)
                if not (used := record.used[k]).any():
                    out.x_plus[k], out.P_plus[k] = out.x_minus[k], out.P_minus[k]
                    continue
                measured, before = record.measurement(k), perf_counter()
                state, told = how.update(state, *measured)
                seconds += perf_counter() - before
                out.innovation[k, used], out.S[k][np.ix_(used, used)] = innovation(x, P, *measured)
                out.x_plus[k], out.P_plus[k] = contract.doubles(state.mean), contract.doubles(state.covariance)
                if np.isfinite(out.S[k, used, used]).all():
                    out.nis[k] = contract.doubles(told.nis)
                    out.log_likelihood += contract.doubles(told.log_likelihood)
        except np.linalg.LinAlgError as error:
            _finite(form, given, model.dt, out.x_minus[: k + 1], out.P_minus[: k + 1])
            msg = f"form {form}: expected matrices with an inverse, received one singular by rounding at step {k}"
            raise FloatingPointError(msg) from error
    _finite(form, given, model.dt, out.x_minus, out.P_minus)
    _finite(form, given, model.dt, out.x_plus, out.P_plus)
    P_minus, P_plus = symmetric(out.P_minus), symmetric(out.P_plus)
    K = gains(P_minus, model.H, out.S, record.used)
    if begun is not None:
        K[:begin] = begun.K
    found = Filtered(
        problem.t, P_minus, P_plus, K, out.S, record.used, form,
        x_minus=out.x_minus, x_plus=out.x_plus, innovation=out.innovation, nis=out.nis, z=data, model=model,
        log_likelihood=out.log_likelihood + (0.0 if begun is None else begun.ordinary),
        log_likelihood_diffuse=out.log_likelihood + (0.0 if begun is None else begun.diffuse),
        start=None if begun is None else begun.start,
    )  # fmt: skip
    return contradictions.judged(problem, found), seconds / max(steps, 1)


def entering(problem: FilterProblem) -> Mask:
    """Which elements enter the updates, (steps+1, m)."""
    model, rows = problem.model, len(problem.z)
    matrices = model.R[:rows] if model.R.ndim == 3 else model.R[None]
    if any_perfect(matrices):
        return adapter.covariances(model, problem.absent).used
    return np.isfinite(np.diagonal(matrices, axis1=1, axis2=2)) & ~problem.absent


class _Histories:
    """What a run leaves, to be filled."""

    def __init__(self, steps: int, n: int, m: int, runs: int) -> None:
        self.x_minus, self.x_plus = np.empty((2, steps + 1, n, runs))
        self.P_minus, self.P_plus = np.empty((2, steps + 1, n, n))
        self.innovation, self.S = np.full((steps + 1, m, runs), np.nan), np.zeros((steps + 1, m, m))
        self.S[:, range(m), range(m)] = np.inf
        self.nis, self.log_likelihood = np.full((steps + 1, runs), np.nan), np.zeros(runs)

    def begin(self, own: Beginning) -> int:
        """Fill in the first instants; their number."""
        for name in ("x_minus", "x_plus", "P_minus", "P_plus", "innovation", "S", "nis"):
            getattr(self, name)[: own.rows] = getattr(own, name)
        return own.rows


def taken_over(how: Form, model: DiscreteModel, x: Numbers, P: Numbers) -> Any:
    """The form's state of an estimate x (n, runs) with the covariance P."""
    there = replace(model, x0=np.zeros(model.n), P0=contract.doubles(P))
    nothing = Noise(contract.zeros(P.shape, P))
    return how.predict(how.start(there, P), contract.identity(model.n, P), x, nothing)


def innovation(x: Numbers, P: Numbers, z: Numbers, H: Numbers, R: Noise) -> tuple[Array, Array]:
    """ν and S in doubles."""
    return contract.doubles(z - H.dot(x)), contract.doubles(H.dot(P).dot(H.T) + R.matrix)


def _finite(form: str, P0: Array, dt: float, x: Array, P: Array) -> None:
    """An overflow is refused at its first step; after a start from zero information NaN and inf have their meaning."""
    free = np.isposinf(np.diagonal(P, axis1=1, axis2=2)) & (not np.isfinite(P0).all())
    own = free[:, :, None] & np.eye(len(P0), dtype=bool)
    wrong = ~((np.isfinite(P) | own).all(axis=(1, 2)) & (np.isfinite(x) | free[:, :, None]).all(axis=(1, 2)))
    if wrong.any():
        k = int(np.argmax(wrong))
        msg = f"form {form}: expected finite covariances, received an overflow at step {k} (t = {moment(k * dt)} s)"
        raise FloatingPointError(msg)
