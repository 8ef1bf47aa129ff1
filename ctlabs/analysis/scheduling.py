r"""Which measurements to take: the best ``count`` of the instants t0 … t(horizon−1), judged by the RMS at the end.

Covariances do not depend on data, so a plan can be made beforehand. The search walks through time and keeps, for every
number of measurements used, the covariances that no other one beats: if :math:`P_a \preceq P_b` then whatever is measured
later leaves :math:`P_a` the better one, for the Riccati recursion is monotone. With one state a single covariance is
left for each number, so the search is exact at any size; with several, what a cap on the number kept cuts off is bounded
by measuring at every remaining instant, which gives the optimality gap.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, islice
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel

When = Literal["update", "always"]
#: Covariances kept for each number of measurements used.
KEPT = 256
#: Differences below this fraction are ties: the later instants win.
TIE = 1e-12
#: Selections that an exhaustive search takes on.
MOST = 50_000_000
CHUNK = 100_000


@dataclass(frozen=True, slots=True)
class Plan:
    """The best plan found.

    ``instants`` : when to measure, ``None`` if no plan keeps the limit · ``rms`` : at the end · ``worst`` : the largest RMS
    that the limit applies to · ``gap`` : the true optimum is at least ``rms − gap`` (0: this is the optimum) ·
    ``needed`` : the least limit that some plan keeps, where none keeps the one given
    """

    instants: tuple[int, ...] | None
    rms: float | None
    worst: float | None
    gap: float
    needed: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Selections:
    """Every selection of instants: ``instants`` (selections, count), ``rms`` at the end, ``worst`` where a limit applies."""

    instants: Array
    rms: Array
    worst: Array

    def feasible(self, limit: float | None) -> Array:
        """Which selections keep the limit."""
        return np.full(len(self.rms), True) if limit is None else np.asarray(self.worst <= limit * (1 + TIE))

    def best(self, limit: float | None = None) -> int | None:
        """Index of the selection with the least RMS that keeps the limit, the lexicographically last of equals."""
        found = np.flatnonzero(self.feasible(limit))
        if not found.size:
            return None
        least = self.rms[found].min()
        return int(found[self.rms[found] <= least * (1 + TIE)].max())


def exhaustive(
    model: DiscreteModel, count: int, horizon: int, *, when: When = "update", output: ArrayLike | None = None
) -> Selections:
    """All C(horizon, count) selections, in lexicographic order.

    Parameters
    ----------
    model : constant discrete model; every measurement it has is taken at a chosen instant
    count, horizon : how many of the instants 0 … horizon−1; the RMS that counts is the one at ``horizon``
    when : what ``worst`` is taken over: the prior RMS at the instants of updates, or the RMS at all instants
    output : (n,), the combination of states whose RMS counts; the first measurement's row by default

    Raises
    ------
    ValueError
        More measurements than instants, a model that varies, or more than 5·10⁷ selections.

    >>> m = DiscreteModel([[1]], [[900]], [[1]], [[900]], x0=[0], P0=[[900]])
    >>> every = exhaustive(m, 2, 10)
    >>> every.instants[every.best()], len(every.rms)
    (array([8, 9]), 45)
    """
    c = _checked(model, count, horizon, output)
    total = math.comb(horizon, count)
    if total > MOST:
        msg = f"selections: expected at most {MOST}, received {total}; search with scheduling.best instead"
        raise ValueError(msg)
    chosen = combinations(range(horizon), count)
    parts = [_walk(model, np.array(part).reshape(-1, count), horizon, when, c) for part in _chunks(chosen)]
    return Selections(*(np.concatenate([part[i] for part in parts]) for i in range(3)))


def best(
    model: DiscreteModel,
    count: int,
    horizon: int,
    *,
    limit: float | None = None,
    when: When = "update",
    output: ArrayLike | None = None,
    kept: int = KEPT,
) -> Plan:
    """The selection with the least RMS at the end, at any size.

    Parameters
    ----------
    limit : largest RMS allowed, before an update (``when="update"``) or at all instants after t0 and before the end
        too (``when="always"``)
    kept : covariances kept for each number of measurements used; more take longer and narrow the gap

    Others as for :func:`exhaustive`. With one state the result is the optimum (gap 0), in time proportional to
    horizon·count.

    Source: pruning by the order of covariances: Vitus, Zhang, Abate, Hu & Tomlin (2012), Automatica 48(10).

    >>> m = DiscreteModel([[1]], [[900]], [[1]], [[900]], x0=[0], P0=[[900]])
    >>> best(m, 2, 10, limit=75.0).instants
    (5, 9)
    """
    c = _checked(model, count, horizon, output)
    if limit is not None:
        limit = checks.positive("limit", limit)
    found = _search(model, count, horizon, limit, when, c, kept)
    if found.instants is not None or limit is None:
        return found
    return Plan(None, None, None, found.gap, _needed(model, count, horizon, limit, when, c, kept))


def _needed(
    model: DiscreteModel, count: int, horizon: int, limit: float, when: When, c: Array, kept: int
) -> float | None:
    """The least limit that a plan keeps, by bisection; above it is the worst RMS of the best plan without a limit."""
    free = _search(model, count, horizon, None, when, c, kept)
    low, high = limit, free.worst
    if high is None:
        return None
    while high - low > 1e-9 * high:
        middle = 0.5 * (low + high)
        found = _search(model, count, horizon, middle, when, c, kept)
        if found.worst is None:
            low = middle
        else:
            high = min(middle, found.worst)
    return high


@dataclass(frozen=True, slots=True, eq=False)
class _Front:
    """Partial plans that used equally many measurements: covariances (k, n, n), instants (k, used), worst RMS (k,)."""

    P: Array
    instants: Array
    worst: Array


def _search(
    model: DiscreteModel, count: int, horizon: int, limit: float | None, when: When, c: Array, kept: int
) -> Plan:
    fronts = {0: _Front(model.P0[None], np.zeros((1, 0), dtype=int), np.zeros(1))}
    lower = math.inf  # what plans that were cut off could reach at best
    for t in range(horizon):
        grown: dict[int, list[_Front]] = {}
        for used, front in fronts.items():
            rms = _rms(front.P, c)
            watched = front if when == "update" else _Front(front.P, front.instants, np.maximum(front.worst, rms))
            if count - used <= horizon - t - 1:
                grown.setdefault(used, []).append(_allowed(watched, limit))
            if used < count:
                taken = np.hstack([front.instants, np.full((len(rms), 1), t)])
                after = _Front(_updated(model, front.P), taken, np.maximum(front.worst, rms))
                grown.setdefault(used + 1, []).append(_allowed(after, limit))
        fronts = {}
        for used, parts in grown.items():
            joined = _Front(
                *(np.concatenate([getattr(part, name) for part in parts]) for name in ("P", "instants", "worst"))
            )
            if len(joined.worst):
                front, dropped = _pruned(joined, c, kept)
                lower = min(lower, _optimistic(model, dropped, horizon - t, c))
                fronts[used] = _Front(model.Phi @ front.P @ model.Phi.T + model.Qd, front.instants, front.worst)
    final = fronts.get(count)
    if final is None:
        return Plan(None, None, None, 0.0 if math.isinf(lower) else math.inf)
    rms = _rms(final.P, c)
    tied = np.flatnonzero(rms <= rms.min() * (1 + TIE))
    winner = max(tied, key=lambda i: tuple(final.instants[i]))
    value = float(rms[winner])
    return Plan(tuple(map(int, final.instants[winner])), value, float(final.worst[winner]), max(0.0, value - lower))


def _allowed(front: _Front, limit: float | None) -> _Front:
    if limit is None:
        return front
    good = front.worst <= limit * (1 + TIE)
    return _Front(front.P[good], front.instants[good], front.worst[good])


def _pruned(front: _Front, c: Array, kept: int) -> tuple[_Front, Array]:
    """The plans that no other beats, at most ``kept``; and the covariances that only the cap cut off."""
    size = np.trace(front.P, axis1=1, axis2=2) / len(c)
    # Better covariances first; of equal ones the lexicographically last, which is then the one kept.
    order = sorted(
        range(len(size)),
        key=lambda i: (round(size[i] / size.max() / TIE) if size.max() else 0, [-x for x in front.instants[i]]),
    )
    alive: list[int] = []
    dropped: list[int] = []
    for i in order:
        if alive and (np.linalg.eigvalsh(front.P[i] - front.P[alive]).min(axis=1) >= -TIE * size[i]).any():
            continue
        (alive if len(alive) < kept else dropped).append(i)
    return _Front(front.P[alive], front.instants[alive], front.worst[alive]), front.P[dropped]


def _optimistic(model: DiscreteModel, P: Array, steps: int, c: Array) -> float:
    """The RMS at the end if every remaining instant were measured: nothing that continues from P can do better."""
    if not len(P):
        return math.inf
    for k in range(steps):
        P = model.Phi @ (_updated(model, P) if k else P) @ model.Phi.T + model.Qd
    return float(_rms(P, c).min())


def _walk(model: DiscreteModel, chosen: Array, horizon: int, when: When, c: Array) -> tuple[Array, Array, Array]:
    """Selections (k, count) all at once: their RMS at the end and the worst one where a limit applies."""
    P = np.repeat(model.P0[None], len(chosen), axis=0)
    worst = np.zeros(len(chosen))
    for t in range(horizon):
        measured = (chosen == t).any(axis=1)
        rms = _rms(P, c)
        watched = measured if when == "update" else np.full(len(chosen), True)
        worst[watched] = np.maximum(worst[watched], rms[watched])
        P[measured] = _updated(model, P[measured])
        P = model.Phi @ P @ model.Phi.T + model.Qd
    return chosen, _rms(P, c), worst


def _updated(model: DiscreteModel, P: Array) -> Array:
    """Covariances (k, n, n) after an update each, in Joseph's form."""
    S = model.H @ P @ model.H.T + model.R
    K = np.swapaxes(np.linalg.pinv(S, hermitian=True) @ (model.H @ P), 1, 2)
    left = np.eye(model.n) - K @ model.H
    after = left @ P @ np.swapaxes(left, 1, 2) + K @ model.R @ np.swapaxes(K, 1, 2)
    return 0.5 * (after + np.swapaxes(after, 1, 2))


def _rms(P: Array, c: Array) -> Array:
    return np.sqrt(np.einsum("i,kij,j->k", c, P, c).clip(0))


def _chunks(chosen: Iterator[tuple[int, ...]]) -> Iterator[list[tuple[int, ...]]]:
    while part := list(islice(chosen, CHUNK)):
        yield part


def _checked(model: DiscreteModel, count: int, horizon: int, output: ArrayLike | None) -> Array:
    checks.instance("model", model, DiscreteModel)
    if model.horizon is not None or model.N is not None or not np.isfinite(model.R).all():
        msg = "model: expected constant matrices, finite R and no N, received others"
        raise ValueError(msg)
    horizon, count = checks.count("horizon", horizon), checks.count("count", count)
    if count > horizon:
        msg = f"count: expected at most as many measurements as instants ({horizon}), received {count}"
        raise ValueError(msg)
    return np.array(model.H[0] if output is None else checks.shaped("output", output, (model.n,)))
