r"""The filter by filterpy: its ``KalmanFilter`` behind one adapter, which is also the oracle of all other engines.

Prediction from k−1 to k, then the update with the measurement at k:

.. math:: \hat x_k^- = \Phi\hat x_{k-1}^+ + c, \quad P_k^- = \Phi P_{k-1}^+\Phi^T + Q_d

.. math:: S = HP^-H^T + R, \quad K = P^-H^TS^{-1}, \quad \hat x^+ = \hat x^- + K(z - H\hat x^-), \quad
          P^+ = (I-KH)P^-(I-KH)^T + KRK^T

(Maybeck vol. 1, eq. 5-36 to 5-42, with Joseph's form.) Elements with R = ∞ or NaN data are left out; a perfect measurement
(R = 0) of something already known gets K = 0 instead of 0/0. The data change nothing of this: :mod:`ctlabs.filtering.engines.gains`
applies the gains to them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.filtering.algorithms import contract, vague
from ctlabs.filtering.measured import informative, perfect, without
from ctlabs.filtering.motion import motion, without_cancelled
from ctlabs.filtering.results import Covariances, Mask
from ctlabs.linalg import checks, rounding
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import symmetric
from ctlabs.models.linear import DiscreteModel, at
from ctlabs.text import moment


class Update(NamedTuple):
    """One update: gain (n, m), innovation covariance (m, m), covariance after (n, n), elements used (m,)."""

    K: Array
    S: Array
    P_plus: Array
    used: Mask


def update(P_minus: ArrayLike, H: ArrayLike, R: ArrayLike) -> Update:
    """The covariance half of one measurement update, for one instant.

    Parameters
    ----------
    P_minus : (n, n) · H : (m, n) · R : (m, m), inf and 0 allowed on the diagonal

    >>> update([[1.0]], [[1.0], [1.0]], [[0.0, 0.0], [0.0, 0.0]]).K
    array([[1., 0.]])
    """
    P = checks.covariance("P_minus", P_minus, ("n", "n"))
    H = checks.shaped("H", H, ("m", P.shape[0]))
    R = checks.measurement_covariance("R", R, (H.shape[0], H.shape[0]))
    return updated(made(P), H, R)


def made(P: Array) -> Any:
    """filterpy's filter with the covariance P."""
    from filterpy.kalman import KalmanFilter  # costs 0.7 s to import

    kf = KalmanFilter(dim_x=len(P), dim_z=1)
    kf.P = np.array(P)
    return kf


def updated(kf: Any, H: Array, R: Array) -> Update:
    """filterpy's update with the informative elements; the elements left out have K = 0, S = inf."""
    m, P_minus = H.shape[0], kf.P
    used = informative(P_minus, H, R)
    if used.all():
        kf.update(np.zeros((m, 1)), R=R, H=H)
        K, S = kf.K, kf.S
    else:
        K, S = np.zeros((len(P_minus), m)), np.diag(np.full(m, np.inf))
        if not used.any():
            return Update(K, S, P_minus, used)
        kf.update(np.zeros((used.sum(), 1)), R=R[np.ix_(used, used)], H=H[used])
        K[:, used], S[np.ix_(used, used)] = kf.K, kf.S
    P_plus = symmetric(kf.P)
    if perfect(R).any():
        P_plus = rounding.corrected(P_plus, P_minus, K[:, used], H[used], *(M[np.ix_(used, used)] for M in (S, R)))
    return Update(K, S, P_plus, used)


def covariances(model: DiscreteModel, absent: Mask) -> Covariances:
    """Predict and update the covariance from t0 to the end; from a vague start by :mod:`ctlabs.filtering.algorithms.vague`.

    Parameters
    ----------
    model : discrete model · absent : (steps+1, m), the elements that are not measured

    Raises
    ------
    FloatingPointError
        The covariance overflows, or that of the innovation is singular by rounding: the step and the time are in the message.
    """
    state = vague.start(model, model.P0)
    kf = made(state.P)
    rows: list[tuple[Array, Update]] = []
    same = _alike(model, absent)
    for k in range(len(absent)):
        if k > 1 and same[k - 1] and _repeats(rows[-2:]):  # the recursion is a function of P alone: all that follows repeats
            rows += [rows[-1]] * (len(absent) - k)
            break
        if k:
            Phi, Q, _ = motion(model, k - 1, rows[-1][1].used)
            with np.errstate(over="ignore", invalid="ignore"):  # an overflow is reported below, with its time
                if state.settled:
                    kf.predict(F=Phi, Q=Q)
                    kf.P = without_cancelled(kf.P, Phi, rows[-1][1].P_plus, Q)
                else:
                    state = vague.predict(state, Phi, None, contract.Noise(Q))
                    kf.P = state.P
        H, R = at(model.H, k, 2), at(model.R, k, 2)
        if absent[k].any():
            R = without(R, absent[k])
        if not np.isfinite(kf.P).all():
            msg = f"P_minus: expected finite covariances, received an overflow at step {k} (t = {k * model.dt:g} s)"
            raise FloatingPointError(msg)
        if not state.settled:
            P_minus = state.covariance
            state, step = _vague(state, H, R)
            kf.P = state.P
            rows.append((P_minus, step))
            continue
        P_minus = kf.P
        try:
            step = updated(kf, H, R)
        except np.linalg.LinAlgError as error:
            received = f"one singular by rounding at step {k} (t = {moment(k * model.dt)} s)"
            msg = f"S: expected a covariance of the innovation with an inverse, received {received}"
            raise FloatingPointError(msg) from error
        kf.P = step.P_plus
        rows.append((P_minus, step))
    K, S, P_plus, used = (np.array(stack) for stack in zip(*(step for _, step in rows), strict=True))
    t = np.arange(len(absent)) * model.dt
    return Covariances(t, np.array([P for P, _ in rows]), P_plus, K, S, used, "filterpy")


def _alike(model: DiscreteModel, absent: Mask) -> Mask:
    """Whether the same is measured from an instant on to the end, as at the one before it, by a constant model, (steps+1,)."""
    if model.horizon is not None:
        return np.zeros(len(absent), dtype=bool)
    different = np.concatenate([[True], (absent[1:] != absent[:-1]).any(axis=1)])
    return np.asarray(np.logical_and.accumulate(~different[::-1])[::-1])


def _repeats(rows: list[tuple[Array, Update]]) -> bool:
    """Whether the last two instants agree to the bit."""
    (before, step), (P_minus, last) = rows
    pairs = ((before, P_minus), (step.P_plus, last.P_plus), (step.used, last.used))
    return all(np.array_equal(one, other) for one, other in pairs) and bool(np.isfinite(P_minus).all())


def _vague(state: vague.State, H: Array, R: Array) -> tuple[vague.State, Update]:
    """One update from a vague start; S is ``inf`` where an element sees something unknown."""
    (m, n), used = H.shape, np.isfinite(R.diagonal())
    K, S = np.zeros((n, m)), np.diag(np.full(m, np.inf))
    if used.any():
        before, own = state._replace(x=np.zeros((n, 1))), (np.eye(used.sum()), H[used], contract.Noise(R[np.ix_(used, used)]))
        state, told = vague.update(before, *own)  # of unit innovations: the gain
        K[:, used] = state.x
        S[np.ix_(used, used)] = vague.innovation(before, *own)[1]
        left_out = np.flatnonzero(used)[~told.used]
        used[left_out], K[:, left_out], S[left_out], S[:, left_out] = False, 0.0, 0.0, 0.0
        S[left_out, left_out] = np.inf
    return state, Update(K, S, state.covariance, used)
