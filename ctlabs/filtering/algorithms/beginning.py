"""The first instants of a record, until an ordinary filter may go on: :mod:`ctlabs.filtering.algorithms.vague`, instant by instant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ctlabs.filtering.algorithms import contract, vague
from ctlabs.filtering.algorithms.contract import Numbers
from ctlabs.filtering.results import Start
from ctlabs.linalg.checks import Array

if TYPE_CHECKING:
    from ctlabs.filtering.engines.record import Record


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


def begin(record: Record, P0: Numbers) -> Beginning | None:
    """The first instants from P0; ``None`` where an ordinary filter may start at once.

    ``record.used`` is corrected where a perfect measurement is of what is known already.

    Raises
    ------
    FloatingPointError
        The covariance overflows: the step and the time are in the message.
    """
    state, rows = vague.start(record.model, P0), list[dict[str, Any]]()
    if state.settled:
        return None
    with np.errstate(over="ignore", invalid="ignore"):  # an overflow is reported, with its time
        for k in range(len(record.z)):
            if k:
                state = vague.predict(state, *record.motion(k - 1))
                _finite(state, k, record.model.dt)
                if state.settled:
                    break
            row, state = _instant(record, k, state)
            rows.append(row)
    found = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    later = np.append(found.pop("determined")[:0:-1].cumsum()[::-1], 0)
    nominal = {name: found.pop("nominal_" + name) for name in ("x_minus", "x_plus", "innovation", "P", "L", "A", "excess", "terms")}
    start = Start(**nominal, unknown=found.pop("unknown"), determined=later)
    x, P, L = (state.x, state.P, state.L) if state.settled else (None, None, None)
    return Beginning(start, **found, x=x, P=P, L=L)


def _finite(state: vague.State, k: int, dt: float) -> None:
    """Refuse an overflow; variances are squares of what the columns hold."""
    A, P = contract.doubles(state.A), contract.doubles(state.P)
    if not (np.isfinite(P).all() and np.isfinite(A * A).all() and np.isfinite(contract.doubles(state.x)).all()):
        msg = f"P_minus: expected finite covariances, received an overflow at step {k} (t = {k * dt:g} s)"
        raise FloatingPointError(msg)


def _instant(record: Record, k: int, state: vague.State) -> tuple[dict[str, Any], vague.State]:
    """One instant, and the state after it."""
    n, m, runs = len(state.P), record.z.shape[1], record.z.shape[2]
    own: dict[str, Any] = {"known": state.unknown == 0, "determined": 0, "log_likelihood": np.zeros(runs)}
    own |= {"x_minus": _spread(vague.mean(state), runs), "P_minus": contract.doubles(vague.covariance(state))}
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
        z, H, R = z[told.used], H[told.used], record.measurement(k)[2]
        own["nominal_innovation"][used] = contract.doubles(z - H @ before.x)
        own["innovation"][used], own["S"][np.ix_(used, used)] = vague.innovation(before, z, H, R)
        own["K"][:, used] = contract.doubles(_gain(before, *given)[:, told.used])
        own |= {"determined": told.determined, "log_likelihood": contract.doubles(told.log_likelihood)}
        if used.any() and np.isfinite(own["S"][used, used]).all():
            own["nis"] = contract.doubles(told.nis)
    A, L = np.zeros((n, n)), np.zeros((n, n))
    A[:, : state.A.shape[1]], L[:, : state.L.shape[1]] = contract.doubles(state.A), contract.doubles(state.L)
    own |= {"x_plus": _spread(vague.mean(state), runs), "P_plus": contract.doubles(vague.covariance(state))}
    own |= {"nominal_x_plus": _spread(state.x, runs), "nominal_P": contract.doubles(state.P), "nominal_L": L, "nominal_A": A}
    return own | {"unknown": state.unknown, "used": record.used[k].copy()}, state


def _gain(state: vague.State, H: Numbers, R: contract.Noise) -> Numbers:
    """K (n, m): what unit innovations move."""
    nowhere = state._replace(x=contract.zeros((len(state.P), len(H)), state.x))
    return vague.update(nowhere, contract.identity(len(H), state.x), H, R)[0].x


def _spread(x: Numbers, runs: int) -> Array:
    """An estimate (n, 1) or (n, runs) as doubles, (n, runs)."""
    return np.repeat(contract.doubles(x), runs // x.shape[1], axis=1)
