"""The first instants of a record, until an ordinary filter may go on: :mod:`ctlabs.filtering.algorithms.vague`, instant by instant.

What is vaguely known may be 1e20 times as large as what the noises leave of it, and two measurements that see almost the same tell
little apart: doubles may not be enough. So the instants are computed twice, the second time in other units of the states,
whose rounding is another. Where the two differ by more than :data:`SAME` standard deviations they are computed with
:data:`DIGITS` digits, at some ten times the cost.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ctlabs.filtering.algorithms import contract, vague
from ctlabs.filtering.algorithms.contract import Numbers
from ctlabs.filtering.results import Start
from ctlabs.linalg.checks import Array
from ctlabs.linalg.rounding import EPS
from ctlabs.models.linear import derived

if TYPE_CHECKING:
    from ctlabs.filtering.engines.record import ByInstant

#: Digits of a beginning for which doubles are not enough.
DIGITS = 50
#: Doubles are enough where two ways differ by less than this fraction of the standard deviations.
SAME = 1e-8
#: Of more instants than ``LONG``, for which many digits take seconds, this is enough.
LONG, ENOUGH = 50, 1e-6
#: What rounding leaves of an estimate beside any standard deviation.
ROUNDED = 16 * EPS


@dataclass(frozen=True, slots=True, eq=False)
class Beginning:
    """The first instants as the filter gives them, and what it goes on from.

    ``x_minus`` … ``nis`` as in :class:`ctlabs.filtering.results.Filtered`, with runs · ``known`` (rows,), whether
    something was known of every state before the update · ``log_likelihood`` (rows, runs) · ``x`` (n, runs), ``P`` = LLᵀ (n, n): the
    prediction of the next
    instant; ``None`` where the record ends before
    """

    start: Start
    x_minus: Array
    x_plus: Array
    P_minus: Array
    P_plus: Array
    K: Array
    innovation: Array
    S: Array
    nis: Array
    used: NDArray[np.bool_]
    known: NDArray[np.bool_]
    log_likelihood: Array
    x: Numbers | None
    P: Numbers | None
    L: Numbers | None

    @property
    def rows(self) -> int:
        """How many instants."""
        return len(self.known)

    @property
    def diffuse(self) -> Array:
        """The log-likelihood of everything measured, (runs,)."""
        return np.asarray(self.log_likelihood.sum(axis=0))

    @property
    def ordinary(self) -> Array:
        """The log-likelihood of what is measured when something is known of every state, (runs,)."""
        return np.asarray(self.log_likelihood[self.known].sum(axis=0))


def begin(record: ByInstant, P0: Numbers, *, gains: bool = True) -> Beginning | None:
    """The first instants from P0; ``None`` where an ordinary filter may start at once.

    ``record.used`` is corrected where a perfect measurement is of what is known already. Without ``gains`` K is zero, and S, the
    innovations and the NIS are not computed: a likelihood needs none of them, and they are nearly half of the work.

    Raises
    ------
    FloatingPointError
        The covariance overflows: the step and the time are in the message.
    """
    there = vague.sight(record.model) if P0.dtype == np.float64 else None
    if there is not None and not vague.too_large(there, P0):
        return None
    used, state = record.used.copy(), vague.start(record.model, P0, there)
    found = _instants(record, state, gains)
    if found is None or record.kind is not float:
        return found
    other = _elsewhere(record, used, state.sight)
    if _same(found, other, SAME) or (found.rows > LONG and _same(found, other, ENOUGH)):
        return found
    record.used[:] = used
    return precisely(record, P0, state.sight, gains)


def _instants(record: ByInstant, state: vague.State, gains: bool) -> Beginning | None:
    """The first instants from a state at t0, in one kind of number."""
    rows = list[dict[str, Any]]()
    if state.settled:
        return None
    with np.errstate(over="ignore", invalid="ignore"):  # an overflow is reported, with its time
        for k in range(len(record.z)):
            if k:
                state = vague.predict(state, *record.motion(k - 1))
                _finite(state, k, record.model.dt)
                if state.settled:
                    break
            row, state = _instant(record, k, state, gains)
            rows.append(row)
    found = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    later = np.append(found.pop("determined")[:0:-1].cumsum()[::-1], 0)
    nominal = {name: found.pop("nominal_" + name) for name in ("x_minus", "x_plus", "innovation", "P", "L", "A", "excess", "terms")}
    start = Start(**nominal, unknown=found.pop("unknown"), determined=later, precise=False)
    x, P, L = (state.x, state.P, state.L) if state.settled else (None, None, None)
    return Beginning(start, **found, x=x, P=P, L=L)


def units(n: int) -> Array:
    """Other units of n states, not the powers of two, which round alike."""
    return np.asarray(1 + np.arange(1, n + 1) / (n + np.sqrt(2)))


def _elsewhere(record: ByInstant, used: NDArray[np.bool_], sight: Array) -> Beginning | None:
    """The first instants computed in other units of the states, and given in those of the model."""
    model = record.model
    d = units(model.n)
    with np.errstate(invalid="ignore"):
        P0 = np.where(model.P0 == 0, 0.0, model.P0 * np.outer(d, d))
    other = derived(
        model, Phi=model.Phi * d[:, None] / d, Qd=model.Qd * np.outer(d, d), H=model.H / d, x0=model.x0 * d, P0=P0,
        N=None if model.N is None else model.N * d[:, None], offset=None if model.offset is None else model.offset * d,
    )  # fmt: skip
    found = _instants(record.made(other, float, used.copy()), vague.start(other, P0, sight / d), gains=False)
    if found is None:
        return None
    x, P = (None, None) if found.x is None or found.P is None else (found.x / d[:, None], found.P / np.outer(d, d))
    return replace(
        found, x=x, P=P, x_minus=found.x_minus / d[:, None], x_plus=found.x_plus / d[:, None],
        P_minus=found.P_minus / np.outer(d, d), P_plus=found.P_plus / np.outer(d, d),
    )  # fmt: skip


def _same(one: Beginning, other: Beginning | None, part: float) -> bool:
    """Whether two beginnings have the same estimates and covariances, to a part of the standard deviations."""
    if other is None or one.rows != other.rows or (one.used != other.used).any():
        return False
    pairs = [(one.x_minus, other.x_minus, one.P_minus, other.P_minus), (one.x_plus, other.x_plus, one.P_plus, other.P_plus)]
    ahead = (one.x, other.x, one.P, other.P)
    if all(part is not None for part in ahead):
        pairs.append(ahead)  # type: ignore[arg-type]  # just seen
    return all(close(*pair, part) for pair in pairs)


def precisely(record: ByInstant, P0: Numbers, sight: Array, gains: bool) -> Beginning | None:
    """The first instants with :data:`DIGITS` digits, rounded to doubles."""
    import mpmath

    with mpmath.workdps(DIGITS):
        own = record.made(record.model, mpmath.mpf, record.used)
        found = _instants(own, vague.start(record.model, contract.numbers(P0, mpmath.mpf), sight), gains)
    if found is None:
        return None
    found = replace(found, start=replace(found.start, precise=True))
    if found.x is None or found.P is None or found.L is None:
        return found
    return replace(found, x=contract.doubles(found.x), P=contract.doubles(found.P), L=contract.doubles(found.L))


def close(x: Array, y: Array, P: Array, Q: Array, part: float) -> bool:
    """Whether estimates x, y (…, n, runs) and covariances P, Q (…, n, n) differ by less than a part of Q's standard deviations.

    Beside it an estimate may differ by its own rounding. What is not known (NaN, ``inf``) is not known in both.
    """
    if any((np.isfinite(one) != np.isfinite(other)).any() for one, other in ((x, y), (P, Q))):
        return False
    variances = np.diagonal(Q, axis1=-2, axis2=-1)
    sd = np.sqrt(np.where(np.isfinite(variances) & (variances > 0), variances, 0.0))
    unit = np.where(sd > 0, sd, 1.0)
    with np.errstate(invalid="ignore"):
        covariances = np.abs(P - Q) > part * unit[..., :, None] * unit[..., None, :]
        estimates = np.abs(x - y) > part * sd[..., None] + ROUNDED * np.abs(y)
    return not (covariances.any() or estimates.any())


def _finite(state: vague.State, k: int, dt: float) -> None:
    """Refuse an overflow; variances are squares of what the columns hold."""
    A, P = contract.doubles(state.A), contract.doubles(state.P)
    if not (np.isfinite(P).all() and np.isfinite(A * A).all() and np.isfinite(contract.doubles(state.x)).all()):
        msg = f"P_minus: expected finite covariances, received an overflow at step {k} (t = {k * dt:g} s)"
        raise FloatingPointError(msg)


def _instant(record: ByInstant, k: int, state: vague.State, gains: bool) -> tuple[dict[str, Any], vague.State]:
    """One instant, and the state after it."""
    n, m, runs = len(state.P), record.z.shape[1], record.z.shape[2]
    own: dict[str, Any] = {"known": state.unknown == 0, "determined": 0, "log_likelihood": np.zeros(runs)}
    own |= {"x_minus": _spread(state.mean, runs), "P_minus": contract.doubles(state.covariance)}
    own |= {"nominal_x_minus": _spread(state.x, runs), "nis": np.full(runs, np.nan)}
    own |= {"nominal_innovation": np.full((m, runs), np.nan), "innovation": np.full((m, runs), np.nan)}
    own |= {"nominal_excess": np.full((m, runs), np.nan), "nominal_terms": np.full(m, np.nan)}
    own |= {"S": np.diag(np.full(m, np.inf)), "K": np.zeros((n, m))}
    if (used := record.used[k].copy()).any():
        z, H, R = record.measurement(k)
        before, given = state, (H, R)
        state, told = vague.update(state, z, H, R)
        own["nominal_excess"][used], own["nominal_terms"][used] = told.excess, told.terms
        record.used[k, used] = told.used
        used = record.used[k]
        own |= {"determined": told.determined, "log_likelihood": contract.doubles(told.log_likelihood)}
        if gains:
            z, H, R = z[told.used], H[told.used], record.measurement(k)[2]
            own["nominal_innovation"][used] = contract.doubles(z - H @ before.x)
            own["innovation"][used], own["S"][np.ix_(used, used)] = vague.innovation(before, z, H, R)
            own["K"][:, used] = contract.doubles(_gain(before, *given)[:, told.used])
        if gains and used.any() and np.isfinite(own["S"][used, used]).all():
            own["nis"] = contract.doubles(told.nis)
    A, L = np.zeros((n, n)), np.zeros((n, n))
    A[:, : state.A.shape[1]], L[:, : state.L.shape[1]] = contract.doubles(state.A), contract.doubles(state.L)
    own |= {"x_plus": _spread(state.mean, runs), "P_plus": contract.doubles(state.covariance)}
    own |= {"nominal_x_plus": _spread(state.x, runs), "nominal_P": contract.doubles(state.P), "nominal_L": L, "nominal_A": A}
    return own | {"unknown": state.unknown, "used": record.used[k].copy()}, state


def _gain(state: vague.State, H: Numbers, R: contract.Noise) -> Numbers:
    """K (n, m): what unit innovations move."""
    nowhere = state._replace(x=contract.zeros((len(state.P), len(H)), state.x))
    return vague.update(nowhere, contract.identity(len(H), state.x), H, R)[0].x


def _spread(x: Numbers, runs: int) -> Array:
    """An estimate (n, 1) or (n, runs) as doubles, (n, runs)."""
    return np.repeat(contract.doubles(x), runs // x.shape[1], axis=1)
