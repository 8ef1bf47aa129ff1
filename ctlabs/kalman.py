r"""Discrete Kalman filtering: filterpy behind one adapter.

Prediction from k−1 to k, then the update with the measurement at k:

.. math:: \hat x_k^- = \Phi\hat x_{k-1}^+ + c, \quad P_k^- = \Phi P_{k-1}^+\Phi^T + Q_d

.. math:: S = HP^-H^T + R, \quad K = P^-H^TS^{-1}, \quad \hat x^+ = \hat x^- + K(z - H\hat x^-), \quad
          P^+ = (I-KH)P^-(I-KH)^T + KRK^T

(Maybeck vol. 1, eq. 5-36 to 5-42, with Joseph's form.) The index k runs 0…steps and P_minus[0] = P0. With ``first=1``
the first measurement is at t1, with ``first=0`` one is processed at t0. Elements with R = ∞ or NaN data are left out;
a perfect measurement (R = 0) of something already known gets K = 0 instead of 0/0.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ctlabs import _check, contradictions
from ctlabs._check import Array
from ctlabs.contradictions import Contradiction, Gains
from ctlabs.discretise import CANCELLED, ldl
from ctlabs.linalg import rounding
from ctlabs.linalg.correlated import regression
from ctlabs.models import DiscreteModel, at
from ctlabs.text import moment

Mask = NDArray[Any]


@dataclass(frozen=True, slots=True, eq=False)
class Schedule:
    """What a filter does, whatever the data: its covariances and gains.

    ``t`` (steps+1,) s · ``P_minus``, ``P_plus`` (steps+1, n, n), covariance of the error given the measurements
    before k and up to k · ``K`` (steps+1, n, m) · ``S`` (steps+1, m, m), covariance of the innovation ·
    ``measured`` (steps+1, m), whether the element enters the update. Where it does not (absent, or a perfect
    measurement of something known) K = 0 and S = inf on the diagonal.
    """

    t: Array
    P_minus: Array
    P_plus: Array
    K: Array
    S: Array
    measured: Mask

    @property
    def steps(self) -> int:
        """Number of steps; the arrays have one entry more."""
        return len(self.t) - 1

    @property
    def sd_minus(self) -> Array:
        """Standard deviation of the prediction error, (steps+1, n)."""
        return sd(self.P_minus)

    @property
    def sd_plus(self) -> Array:
        """Standard deviation of the filtering error, (steps+1, n)."""
        return sd(self.P_plus)


@dataclass(frozen=True, slots=True, eq=False)
class Ensemble:
    """One filter on many records; the run is the last axis.

    ``t`` (steps+1,) s · ``z`` (steps+1, m, runs), the data as given · ``innovation`` (steps+1, m, runs), NaN where an
    element does not enter the update · ``x`` (steps+1, n, runs), the truth, ``None`` for measured data ·
    ``x_minus``, ``x_plus`` (steps+1, n, runs), estimates given the
    measurements before k and up to k · ``schedule``, the gains used · ``contradictions``, the perfect measurements that
    disagree with what is known exactly (:mod:`ctlabs.contradictions`).
    """

    t: Array
    z: Array
    innovation: Array
    x: Array | None
    x_minus: Array
    x_plus: Array
    schedule: Schedule
    contradictions: tuple[Contradiction, ...] = ()

    def error(self, when: str = "plus") -> Array:
        """e = x̂ − x, (steps+1, n, runs), after (``"plus"``) or before (``"minus"``) the update."""
        if self.x is None:
            msg = "error: expected a simulated truth, received measured data (x is None)"
            raise ValueError(msg)
        return (self.x_plus if when == "plus" else self.x_minus) - self.x


class Update(NamedTuple):
    """One update: gain (n, m), innovation covariance (m, m), covariance after (n, n), elements used (m,)."""

    K: Array
    S: Array
    P_plus: Array
    used: Mask


def schedule(model: DiscreteModel, steps: int, first: int = 1) -> Schedule:
    """The covariances and gains of the optimal filter of ``model`` over ``steps`` steps; no data are needed.

    Parameters
    ----------
    model : discrete model, constant or given for at least ``steps`` steps
    steps : number of periods
    first : 1 (first measurement at t1) or 0 (at t0)

    Raises
    ------
    TypeError
        A continuous model: discretise it first.
    ValueError
        steps < 1, or more steps than a time-varying model is given for.
    FloatingPointError
        The covariance overflows, or that of the innovation is singular by rounding: the step and the time are in the message.

    >>> m = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])
    >>> schedule(m, 2).P_plus[1:, 0, 0].round(6)
    array([0.916667, 0.657143])
    """
    return _covariances(model, _horizon(model, steps, first), first, None)


def filter_runs(model: DiscreteModel, z: ArrayLike, schedule: Schedule | None = None, first: int = 1) -> Ensemble:
    """Filter a record, or an ensemble of records with one gain sequence and all runs in one pass.

    Parameters
    ----------
    model : the filter's model
    z : (steps+1, m) or (steps+1, m, runs); NaN = not measured, for all runs alike. With ``first=1`` row 0 is not used.
    schedule : gains to apply instead of the optimal ones (computed before, or those of another filter)
    first : 1 (first measurement at t1) or 0 (at t0)

    Returns
    -------
    Ensemble, without a truth (``x`` is None)

    Raises
    ------
    ValueError
        A shape that does not fit the model; an infinite value; NaN in some runs only; a schedule of another length.

    >>> m = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])
    >>> filter_runs(m, [[np.nan], [1.0], [np.nan]]).x_plus[:, 0, 0].round(6)
    array([0.      , 0.916667, 0.916667])
    """
    data = np.array(z, dtype=np.float64)
    data = data[:, :, None] if data.ndim == 2 else data
    if data.ndim != 3 or data.shape[1] != model.m:
        msg = f"z: expected shape (steps+1, {model.m}[, runs]), received {np.shape(z)}"
        raise ValueError(msg)
    steps = _horizon(model, len(data) - 1, first)
    gaps = _gaps(data)
    if schedule is None:
        schedule = _covariances(model, steps, first, gaps)
    elif schedule.steps != steps or schedule.K.shape[1:] != (model.n, model.m):
        msg = f"schedule: expected gains of shape {(steps + 1, model.n, model.m)}, received {schedule.K.shape}"
        raise ValueError(msg)
    found = _estimates(model, data, schedule, gaps)
    used = schedule.measured & ~gaps
    history = Gains(found.x_minus, found.x_plus, schedule.P_minus, schedule.P_plus, used, schedule.K)
    return replace(found, contradictions=contradictions.find(model, data, history, first))


def update(P_minus: ArrayLike, H: ArrayLike, R: ArrayLike) -> Update:
    """The covariance half of one measurement update, for one instant.

    Parameters
    ----------
    P_minus : (n, n) · H : (m, n) · R : (m, m), inf and 0 allowed on the diagonal

    >>> update([[1.0]], [[1.0], [1.0]], [[0.0, 0.0], [0.0, 0.0]]).K
    array([[1., 0.]])
    """
    P = _check.covariance("P_minus", P_minus, ("n", "n"))
    H = _check.shaped("H", H, ("m", P.shape[0]))
    R = _check.measurement_covariance("R", R, (H.shape[0], H.shape[0]))
    return _update(_filter(P), H, R)


def _horizon(model: DiscreteModel, steps: int, first: int) -> int:
    _check.instance("model", model, DiscreteModel)
    steps = _check.count("steps", steps)
    if first not in (0, 1):
        msg = f"first: expected 0 or 1, received {first!r}"
        raise ValueError(msg)
    if model.horizon is not None and steps > model.horizon:
        msg = f"steps: expected at most {model.horizon} (the model is given for so many), received {steps}"
        raise ValueError(msg)
    return steps


def _gaps(z: Array) -> Mask:
    """Where data are missing, (steps+1, m): NaN, in every run or in none."""
    missing = np.isnan(z)
    gaps: Mask = np.all(missing, axis=2)
    wrong = np.isinf(z).any(axis=2) | (missing.any(axis=2) & ~gaps)
    if wrong.any():
        k, i = np.argwhere(wrong)[0]
        found = "an infinite value" if np.isinf(z[k, i]).any() else "NaN in some runs only"
        msg = f"z[{k}][{i}]: expected finite numbers, or NaN in every run, received {found}"
        raise ValueError(msg)
    return gaps


def _filter(P: Array) -> Any:
    """filterpy's filter with the covariance P."""
    from filterpy.kalman import KalmanFilter  # costs 0.7 s to import

    kf = KalmanFilter(dim_x=len(P), dim_z=1)
    kf.P = np.array(P)
    return kf


def _covariances(model: DiscreteModel, steps: int, first: int, gaps: Mask | None) -> Schedule:
    """Predict and update the covariance from t0 to the end by filterpy; from a vague start by :mod:`ctlabs.forms.vague`."""
    from ctlabs.forms import contract, vague  # made of this module's parts

    state = vague.start(model, model.P0)
    kf = _filter(state.P)
    rows: list[tuple[Array, Update]] = []
    for k in range(steps + 1):
        if k:
            Phi, Q, _ = _motion(model, k - 1, rows[-1][1].used)
            with np.errstate(over="ignore", invalid="ignore"):  # an overflow is reported below, with its time
                if state.settled:
                    kf.predict(F=Phi, Q=Q)
                    kf.P = _without_cancelled(kf.P, Phi, rows[-1][1].P_plus, Q)
                else:
                    state = vague.predict(state, Phi, None, contract.Noise(Q))
                    kf.P = state.P
        H, R = at(model.H, k, 2), at(model.R, k, 2)
        if k < first or (gaps is not None and gaps[k].any()):
            R = _absent(R, np.full(model.m, True) if k < first or gaps is None else gaps[k])
        if not np.isfinite(kf.P).all():
            msg = f"P_minus: expected finite covariances, received an overflow at step {k} (t = {k * model.dt:g} s)"
            raise FloatingPointError(msg)
        if not state.settled:
            P_minus = vague.covariance(state)
            state, step = _vague(state, H, R)
            kf.P = state.P
            rows.append((P_minus, step))
            continue
        P_minus = kf.P
        try:
            step = _update(kf, H, R)
        except np.linalg.LinAlgError as error:
            received = f"one singular by rounding at step {k} (t = {moment(k * model.dt)} s)"
            msg = f"S: expected a covariance of the innovation with an inverse, received {received}"
            raise FloatingPointError(msg) from error
        kf.P = step.P_plus
        rows.append((P_minus, step))
    K, S, P_plus, used = (np.array(stack) for stack in zip(*(step for _, step in rows), strict=True))
    return Schedule(np.arange(steps + 1) * model.dt, np.array([P for P, _ in rows]), P_plus, K, S, used)


def _vague(state: Any, H: Array, R: Array) -> tuple[Any, Update]:
    """One update from a vague start; S is ``inf`` where an element sees something unknown."""
    from ctlabs.forms import contract, vague

    (m, n), used = H.shape, np.isfinite(R.diagonal())
    K, S = np.zeros((n, m)), np.diag(np.full(m, np.inf))
    if used.any():
        before, own = state, (np.eye(used.sum()), H[used], contract.Noise(R[np.ix_(used, used)]))
        state, told = vague.update(before._replace(x=np.zeros((n, 1))), *own)  # of unit innovations: the gain
        K[:, used] = state.x
        S[np.ix_(used, used)] = vague.innovation(before, *own)[1]
        left_out = np.flatnonzero(used)[~told.used]
        used[left_out], K[:, left_out], S[left_out], S[:, left_out] = False, 0.0, 0.0, 0.0
        S[left_out, left_out] = np.inf
    return state, Update(K, S, vague.covariance(state), used)


def _estimates(model: DiscreteModel, z: Array, plan: Schedule, gaps: Mask) -> Ensemble:
    """The estimates of all runs under given gains."""
    x_minus = np.empty((len(z), model.n, z.shape[2]))
    x_plus, innovation = np.empty_like(x_minus), np.full(z.shape, np.nan)
    x_minus[0] = np.where(np.isinf(np.diag(model.P0)), 0.0, model.x0)[:, None]
    used = plan.measured & ~gaps
    for k in range(len(z)):
        if k:
            Phi, _, M = _motion(model, k - 1, used[k - 1])
            np.matmul(Phi, x_plus[k - 1], out=x_minus[k])
            if M is not None:
                x_minus[k] += M @ z[k - 1, used[k - 1]]
            if model.offset is not None:
                x_minus[k] += at(model.offset, k - 1, 1)[:, None]
        np.subtract(z[k], at(model.H, k, 2) @ x_minus[k], out=innovation[k])
        if used[k].all():
            np.matmul(plan.K[k], innovation[k], out=x_plus[k])
        else:
            np.matmul(plan.K[k][:, used[k]], innovation[k, used[k]], out=x_plus[k])
            innovation[k, ~used[k]] = np.nan
        x_plus[k] += x_minus[k]
    for values, variances in ((x_minus, plan.P_minus), (x_plus, plan.P_plus), (innovation, plan.S)):
        values[np.isinf(np.diagonal(variances, axis1=1, axis2=2))] = np.nan  # not known, whatever stands there
    return Ensemble(plan.t, z, innovation, None, x_minus, x_plus, plan)


def _absent(R: Array, missing: Mask) -> Array:
    """R with the ``missing`` elements' variance infinite and their correlations gone."""
    either = missing[:, None] | missing
    return np.where(either, np.where(np.eye(len(R), dtype=bool), np.inf, 0.0), R)


def _motion(model: DiscreteModel, k: int, used: Mask) -> tuple[Array, Array, Array | None]:
    """Transition and noise covariance from k to k+1, and the gain M on z_k where w_k correlates with v_k.

    What a measurement tells of the next disturbance is used: Φ − NR⁺H, Qd − NR⁺Nᵀ and the known input NR⁺z
    (Kailath, Sayed & Hassibi, *Linear Estimation*, section 9.5).
    """
    Phi, Qd = at(model.Phi, k, 2), at(model.Qd, k, 2)
    if model.N is None or not used.any():
        return Phi, Qd, None
    N = model.N[:, used]
    M = regression(N, at(model.R, k, 2)[np.ix_(used, used)])
    taken = M @ N.T
    return Phi - M @ at(model.H, k, 2)[used], rounding.difference(Qd - taken, Qd, taken), M


def _update(kf: Any, H: Array, R: Array) -> Update:
    """filterpy's update with the informative elements; the elements left out have K = 0, S = inf."""
    m, P_minus = H.shape[0], kf.P
    used = _informative(P_minus, H, R)
    if used.all():
        kf.update(np.zeros((m, 1)), R=R, H=H)
        K, S = kf.K, kf.S
    else:
        K, S = np.zeros((len(P_minus), m)), np.diag(np.full(m, np.inf))
        if not used.any():
            return Update(K, S, P_minus, used)
        kf.update(np.zeros((used.sum(), 1)), R=R[np.ix_(used, used)], H=H[used])
        K[:, used], S[np.ix_(used, used)] = kf.K, kf.S
    P_plus = 0.5 * (kf.P + kf.P.T)
    if _perfect(R).any():
        P_plus = rounding.corrected(P_plus, P_minus, K[:, used], H[used], *(M[np.ix_(used, used)] for M in (S, R)))
    return Update(K, S, P_plus, used)


def _informative(P: Array, H: Array, R: Array) -> Mask:
    """Which elements enter the update: those measured, but no perfect one whose value is known already.

    An element is perfect when its noise is zero, or a combination of the noises before it; it is known when its
    innovation, given the innovations before it, has a variance at the rounding level of its own terms.
    """
    used, perfect = np.isfinite(R.diagonal()), _perfect(R)
    if perfect.any():
        finite = np.where(used[:, None] & used, R, 0.0)
        S = H @ P @ H.T + finite
        size = (np.abs(H) @ np.sqrt(np.diag(P).clip(0))) ** 2 + np.diag(finite)
        for i in np.flatnonzero(perfect):
            before = np.flatnonzero(used[:i])
            weights = np.linalg.solve(S[np.ix_(before, before)], S[before, i])
            terms = (np.abs(weights) @ np.sqrt(size[before]) + np.sqrt(size[i])) ** 2  # of the innovation that is left
            used[i] = S[i, i] - S[i, before] @ weights > 16 * len(P) * np.finfo(float).eps * terms
    return used


def _perfect(R: Array) -> Mask:
    """Which elements have no noise of their own: a variance of zero, or a noise combined of those before it."""
    used = np.isfinite(R.diagonal())
    if R.diagonal().all() and np.count_nonzero(R) == len(R):  # independent noises, none of them zero
        return np.zeros_like(used)
    return used & (ldl(np.where(used[:, None] & used, R, 0.0))[1] == 0)


def _without_cancelled(P: Array, Phi: Array, before: Array, Q: Array) -> Array:
    """Exact zeros for a predicted state whose row of P is the rounding of the terms that cancelled in it.

    A known combination of states that Φ turns into a state of its own is known, not of a variance ±1e-17.
    """
    size = np.abs(Phi) @ np.sqrt(np.abs(np.diag(before))) + np.sqrt(np.diag(Q))
    rounding = CANCELLED * size
    if (np.diag(P) > rounding * size).all():
        return P
    known = (np.abs(P) <= rounding[:, None] * size).all(axis=1) & np.isfinite(np.diag(P))
    return np.where(known[:, None] | known, 0.0, P)


def sd(P: Array) -> Array:
    """Standard deviations, the roots of the diagonals of covariances (…, n, n).

    A variance that is zero may come out as −1e-30 where a singular covariance is moved: it counts as zero.

    >>> sd(np.diag([4.0, -1e-30]))
    array([2., 0.])
    """
    return np.sqrt(np.diagonal(P, axis1=-2, axis2=-1).clip(0))
