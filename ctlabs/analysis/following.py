r"""The error of a filter followed step by step, in the coordinates (x, e) of :mod:`ctlabs.analysis.sensitivity`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.analysis.sources import Source
from ctlabs.filtering.algorithms import contract
from ctlabs.filtering.filter import planned
from ctlabs.filtering.results import Covariances, Mask
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.linalg.correlated import regression
from ctlabs.models import DiscreteModel, at
from ctlabs.models.linear import check_inputs

#: Below this fraction of the terms it is the difference of, a coupling of the error to the truth is rounding.
ROUNDING = 1e-13


class Map(NamedTuple):
    """X ← A X + W w + V v + c for X = (x, e)."""

    A: Array
    W: Array
    V: Array
    c: Array


class Maps(NamedTuple):
    """``update[k]`` leads over the measurement at k, ``predict[k]`` from there to k+1; d is the order of e."""

    update: list[Map]
    predict: list[Map]
    d: int


def pair(
    truth: DiscreteModel, design: DiscreteModel, compare: ArrayLike | None, steps: int | None
) -> tuple[Array, int]:
    """C, and the number of steps, of two models that can work on the same data (``steps`` None: constant models)."""
    checks.instance("truth", truth, DiscreteModel)
    checks.instance("design", design, DiscreteModel)
    if truth.m != design.m or truth.dt != design.dt:
        msg = (
            f"design: expected the truth's m = {truth.m} and dt = {truth.dt!r} s, "
            f"received m = {design.m} and dt = {design.dt!r} s"
        )
        raise ValueError(msg)
    check_inputs(truth, design)
    for name, model in (("truth", truth), ("design", design)):
        if steps is None and model.horizon is not None:
            msg = f"{name}: expected constant matrices, received some that vary over {model.horizon} steps"
            raise ValueError(msg)
        if steps is not None and model.horizon is not None and checks.count("steps", steps) > model.horizon:
            msg = f"steps: expected at most {model.horizon} (the {name} is given for so many), received {steps}"
            raise ValueError(msg)
    if compare is None and truth.n != design.n:
        msg = f"compare: expected a matrix of shape {(design.n, truth.n)} (the orders differ), received None"
        raise ValueError(msg)
    C = np.eye(truth.n) if compare is None else checks.shaped("compare", compare, (design.n, truth.n))
    return C, 0 if steps is None else checks.count("steps", steps)


def plan(
    truth: DiscreteModel, design: DiscreteModel, steps: int, gains: Covariances | None, first: int
) -> tuple[Covariances, Mask]:
    """The gains, and the elements (steps+1, m) that both the filter uses and the truth measures."""
    made = np.array([np.isfinite(np.diag(at(truth.R, k, 2))) for k in range(steps + 1)])
    if gains is None:
        gains = planned(design, ~made, first)
    elif gains.K.shape != (steps + 1, design.n, design.m):
        msg = f"gains: expected gains of shape {(steps + 1, design.n, design.m)}, received {gains.K.shape}"
        raise ValueError(msg)
    return gains, gains.used & made


def update(
    truth: DiscreteModel, design: DiscreteModel, C: Array, K: Array, used: Mask, k: int, *, whole: bool
) -> Map:
    """Over the measurement at k; without x unless ``whole``."""
    K, H_t, H_d = K[:, used], at(truth.H, k, 2)[used], at(design.H, k, 2)[used]
    n = truth.n if whole else 0
    coupling = K @ _difference(H_t, H_d @ C)
    A = np.block([[np.eye(n), np.zeros((n, design.n))], [coupling[:, :n], np.eye(design.n) - K @ H_d]])
    return Map(A, np.zeros((n + design.n, truth.n)), np.vstack([np.zeros((n, K.shape[1])), K]), np.zeros(n + design.n))


def predict(truth: DiscreteModel, design: DiscreteModel, C: Array, used: Mask, k: int, *, whole: bool) -> Map:
    """From after the measurement at k to before that at k+1; without x unless ``whole``."""
    Phi_t, Phi_d, M = at(truth.Phi, k, 2), at(design.Phi, k, 2), _cross_gain(design, k, used)
    H_t, H_d = at(truth.H, k, 2)[used], at(design.H, k, 2)[used]
    n = truth.n if whole else 0
    coupling = _difference(Phi_d @ C, C @ Phi_t) + M @ _difference(H_t, H_d @ C)
    A = np.block([[Phi_t[:n, :n], np.zeros((n, design.n))], [coupling[:, :n], Phi_d - M @ H_d]])
    c_t, c_d = (np.zeros(m.n) if m.offset is None else at(m.offset, k, 1) for m in (truth, design))
    return Map(
        A,
        np.vstack([np.eye(truth.n)[:n], -C]),
        np.vstack([np.zeros((n, M.shape[1])), M]),
        np.concatenate([c_t[:n], c_d - C @ c_t]),
    )


def maps(truth: DiscreteModel, design: DiscreteModel, C: Array, K: Array, used: Mask) -> Maps:
    """The maps of all steps; x is left out where it never reaches the error."""

    def all_maps(whole: bool) -> Maps:
        return Maps(
            [update(truth, design, C, K[k], used[k], k, whole=whole) for k in range(len(K))],
            [predict(truth, design, C, used[k], k, whole=whole) for k in range(len(K) - 1)],
            design.n,
        )

    n = truth.n
    if np.array_equal(C, np.eye(n)) and np.array_equal(truth.Phi, design.Phi) and np.array_equal(truth.H, design.H):
        return all_maps(whole=False)  # nothing couples
    joint = all_maps(whole=True)
    return joint if any(step.A[n:, :n].any() for step in (*joint.update, *joint.predict)) else all_maps(whole=False)


def means(truth: DiscreteModel, design: DiscreteModel, C: Array, maps: Maps) -> tuple[Array, Array]:
    """Mean of e before and after each update."""
    d, X = design.n, np.concatenate([truth.x0, design.x0 - C @ truth.x0])[-len(maps.predict[0].c) :]
    minus, plus = np.empty((len(maps.update), d)), np.empty((len(maps.update), d))
    for k, update in enumerate(maps.update):
        if k:
            X = maps.predict[k - 1].A @ X + maps.predict[k - 1].c
        minus[k] = X[-d:]
        X = update.A @ X
        plus[k] = X[-d:]
    return minus, plus


def covariances(source: Source, maps: Maps, used: Mask) -> tuple[Array, Array]:
    """Covariance of e before and after each update, as far as ``source`` makes it.

    By a root of it: of P0 = 1e14 R no more than the rounding of P0 would be left in the covariance itself.
    """
    d = maps.d
    checks.finite_start("the actual error", source.P0)
    L = maps.predict[0].W @ contract.rooted(source.P0)  # x0 enters (x, e) as w does: with I and −C
    minus, plus = np.empty((len(maps.update), d, d)), np.empty((len(maps.update), d, d))
    known: dict[bytes, Array] = {}
    constant = source.Qd.ndim == source.R.ndim == 2
    for k, update in enumerate(maps.update):
        key = used[k].tobytes()
        noises = known[key] if constant and key in known else _noises(source, k, used[k], last=k + 1 == len(maps.update))
        known[key] = noises
        v, w = np.split(noises, [int(used[k].sum())])
        with np.errstate(over="ignore", invalid="ignore"):  # reported below, with its step
            minus[k], after = _squared(L[-d:]), np.hstack([update.A @ L, update.V @ v])
            plus[k] = _squared(after[-d:])
            if not np.isfinite(minus[k]).all():
                msg = f"sensitivity: expected finite covariances, received an overflow at step {k}"
                raise FloatingPointError(msg)
            if k + 1 < len(maps.update):
                # v_k sits in e_k⁺ already, and correlates with w_k through N.
                predict = maps.predict[k]
                moved = predict.A @ after
                moved[:, L.shape[1] :] += predict.W @ w + predict.V @ v
                L = contract.triangular(moved) if np.isfinite(moved).all() else moved
    return minus, plus


def _noises(source: Source, k: int, used: Array, *, last: bool) -> Array:
    """A root of the joint covariance of v_k, as far as it is used, and w_k; nothing of w after the last instant."""
    R, N = at(source.R, k, 2)[np.ix_(used, used)], source.N[:, used]
    Qd = np.zeros((len(N), len(N))) if last and source.Qd.ndim == 3 else at(source.Qd, k, 2)
    N = N if Qd.any() else 0 * N
    return contract.rooted(np.block([[R, N.T], [N, Qd]]))


def _cross_gain(design: DiscreteModel, k: int, used: Mask) -> Array:
    """M = NR⁺ of the design: what its filter infers from z_k about w_k, (d, elements used)."""
    if design.N is None:
        return np.zeros((design.n, int(used.sum())))
    return regression(design.N[:, used], at(design.R, k, 2)[np.ix_(used, used)])


def _difference(a: Array, b: Array) -> Array:
    """a − b, exactly zero where rounding is all there is."""
    return np.where(np.abs(a - b) > ROUNDING * (np.abs(a) + np.abs(b)), a - b, 0.0)


def _squared(L: Array) -> Array:
    return L @ L.T
