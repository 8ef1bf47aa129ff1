r"""The Kalman–Bucy filter of a continuous model: covariance in time, steady state, transfer function.

.. math:: \dot P = FP + PF^T + GQG^T - K_cR_cK_c^T, \quad K_c = (PH^T + GN)R_c^{-1}, \quad
          \dot{\hat x} = F\hat x + Bu + K_c(z - H\hat x)

The covariance is not stepped through time. Over an interval the flow of this equation is known once and for all:

.. math:: P(t+h) = \mathcal G + \Phi\,P\,(I + \mathcal C P)^{-1}\,\Phi^T

with three matrices: 𝒢, what P becomes from 0; 𝒞, the information on the state at the beginning; Φ, the transition of
the filter that starts from 0. Two intervals join like layers of glass that scatter light (Redheffer's product), so h
is doubled at once. Covariances and information only add, nothing cancels and nothing is stiff.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from ctlabs.linalg import checks, riccati
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import symmetric
from ctlabs.linalg.factors import ldl
from ctlabs.linalg.manyfold import Manyfold
from ctlabs.linalg.resolvent import resolvent
from ctlabs.models import ContinuousModel, observability
from ctlabs.models.interop import distinct
from ctlabs.text import moment

if TYPE_CHECKING:
    import control

#: Intervals are not doubled beyond this growth of Φ (undriven unstable modes), which would amplify rounding.
GROWTH = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Transient:
    """The filter in time.

    ``t`` (points,) s · ``P`` (points, n, n), covariance of the error · ``K`` (points, n, m), gain, unit/(unit_z·s)
    """

    t: Array
    P: Array
    K: Array

    @property
    def sd(self) -> Array:
        """Standard deviation of the error, (points, n)."""
        return np.sqrt(np.diagonal(self.P, axis1=1, axis2=2))


@dataclass(frozen=True, slots=True, eq=False)
class BucySteadyState:
    r"""Limits for t → ∞.

    ``P`` (n, n), covariance of the error · ``K`` (n, m), gain · ``poles`` (n,) of the filter, 1/s, ascending:
    eigenvalues of F − K H · ``error``, a bound of the error of P: :math:`|dP_{ij}| \le error\cdot\sigma_i\sigma_j`, absolute where
    one of the σ is zero
    """

    P: Array
    K: Array
    poles: Array
    error: float


def transient(model: ContinuousModel, t: ArrayLike) -> Transient:
    """The covariance and gain of the Kalman–Bucy filter at given times, exact between them.

    Parameters
    ----------
    model : with Rc; P0 is the covariance at t = 0. Stiff models, singular P0 and Q, modes that are not measured or not
        driven by noise are all in order.
    t : (points,), s, increasing from t ≥ 0, with any spacing; t = 0 gives P0

    Raises
    ------
    TypeError
        A discrete model.
    ValueError
        Times that do not increase; no Rc or a singular one: with perfect or missing continuous measurements the
        gain is infinite, and a reduced filter is needed.
    FloatingPointError
        The covariance overflows (an unstable mode that is not measured): the time is in the message.

    Source: Maybeck vol. 1, eq. 5-126 (the equation); Kailath, Sayed & Hassibi, *Linear Estimation* (2000), chapter 17
    (scattering, doubling).

    >>> m = ContinuousModel(F=[[0]], G=[[1]], Q=[[4]], H=[[1]], Rc=[[16]], P0=[[25]])
    >>> transient(m, [0.5, 1, 2, 5]).P[:, 0, 0].round(5)
    array([15.27121, 11.74123,  9.19909,  8.05573])
    """
    plain = _plain(model)
    checks.finite_start("a transient", model.P0)
    t = checks.shaped("t", t, ("points",))
    steps = np.diff(t, prepend=0.0)
    if t.size and (t[0] < 0 or (steps[1:] <= 0).any()):
        shown = t.tolist() if t.size < 8 else f"{moment(t[0], t[-1])} … {moment(t[-1], t[0])}"
        msg = f"t: expected increasing times >= 0, received {shown}"
        raise ValueError(msg)
    flow = _Flow(plain, float(t[-1]) if t.size else 0.0)
    P, rows = np.array(model.P0), np.empty((len(t), model.n, model.n))
    for k, now in enumerate(t):
        P = flow.to(float(now), P)
        if not np.isfinite(P).all():
            msg = f"P: expected finite covariances, received an overflow by t = {moment(t[k])} s"
            raise FloatingPointError(msg)
        rows[k] = P
    return Transient(t, rows, plain.gain(rows))


def steady(model: ContinuousModel) -> BucySteadyState:
    """The limit of the filter from P0 > 0.

    Modes that no noise drives and that do not grow become known exactly: P is zero along them.

    Raises
    ------
    TypeError, ValueError
        As for :func:`transient`; also a mode that does not decay and is not measured, so that there is no limit or it
        depends on P0: the message names the mode (its eigenvalue and states), as :func:`ctlabs.models.observability.analyse` does; no
        solution with an error bound below 1e-6.

    Source: Kailath, Sayed & Hassibi, *Linear Estimation* (2000), chapter 16 and appendix E.

    >>> m = ContinuousModel(F=[[1]], G=[[1]], Q=[[1]], H=[[1]], Rc=[[1]], P0=[[1]])
    >>> steady(m).P.round(6), steady(m).poles.round(6)
    (array([[2.414214]]), array([-1.414214+0.j]))
    """
    _plain(model)  # refuses what has no continuous gain
    pair = observability.measured(model)
    if unseen := observability.undetectable(*pair, continuous=True, unseen=observability.ROUNDED):
        msg = (
            "steady state: expected every mode with Re(eigenvalue) >= 0 to be measured, received the mode "
            f"{unseen[0].name(model.states)}, which no measurement sees: its error variance has no limit "
            "that does not depend on P0"
        )
        raise ValueError(msg)
    G = Manyfold.of(model.G, 2)
    W, N = (G @ model.Q @ G.T).symmetric, None if model.N is None else G @ model.N
    assert model.Rc is not None
    try:
        found = riccati.solve(model.F, model.H, W, model.Rc, N, continuous=True)
    except ValueError as error:
        msg = f"steady state: {error}"
        if hardly := observability.undetectable(*pair, continuous=True):
            msg += f" (the measurements tell next to nothing of the mode {hardly[0].name(model.states)})"
        raise ValueError(msg) from None
    poles = np.sort_complex(np.linalg.eigvals(model.F - found.K @ model.H))
    return BucySteadyState(found.P.high.copy(), found.K.copy(), poles, found.error)


def transfer_function(model: ContinuousModel, state: int = 0, measurement: int = 0) -> tuple[Array, Array]:
    r"""From a measurement to an estimate in the steady filter: :math:`\hat x(s)/z(s) = (sI - F + K_cH)^{-1}K_c`.

    Returns
    -------
    num, den : descending powers of s; den (n+1,) with den[0] = 1, num without leading zeros. Common factors (modes
        of the filter that this measurement does not reach) are left in.

    >>> m = ContinuousModel(F=[[0]], G=[[1]], Q=[[4]], H=[[1]], Rc=[[16]], P0=[[25]])
    >>> num, den = transfer_function(m)
    >>> num.round(9), den.round(9)
    (array([0.5]), array([1. , 0.5]))
    """
    limit = steady(model)
    num, den = resolvent(model.F - limit.K @ model.H, limit.K[:, measurement], np.eye(model.n)[state])
    num = np.trim_zeros(num, "f")
    return (num if num.size else np.zeros(1)), den


def filter_system(model: ContinuousModel) -> control.StateSpace:
    """The steady filter as a python-control system from z to x̂, with the model's names.

    >>> m = ContinuousModel(F=[[0]], G=[[1]], Q=[[4]], H=[[1]], Rc=[[16]], P0=[[25]])
    >>> filter_system(m).poles().round(9)
    array([-0.5+0.j])
    """
    import control  # costs 1 s to import

    limit = steady(model)
    return control.ss(
        model.F - limit.K @ model.H,
        limit.K,
        np.eye(model.n),
        np.zeros((model.n, model.m)),
        0,
        inputs=distinct(model.measurements),
        outputs=distinct(tuple(f"{name}_hat" for name in model.states)),
        states=distinct(model.states),
    )


def settling_time(model: ContinuousModel, within: float = 0.01) -> float | None:
    """The first time from which the variance of every state stays within a fraction of its limit, s.

    Searched as far as needed, up to 2⁴⁷ times of the fastest pole; ``None`` when there is no such time: a variance that tends to
    zero never stays within a fraction of it (unless it is zero all the time).

    Raises
    ------
    ValueError
        As for :func:`steady`: there is no limit.

    >>> m = ContinuousModel(F=[[0]], G=[[1]], Q=[[4]], H=[[1]], Rc=[[16]], P0=[[25]])
    >>> round(settling_time(m), 3)
    4.64
    """
    limit, within = steady(model), checks.positive("within", within)
    variance = np.diag(limit.P)
    zero = variance == 0
    rate = np.abs(limit.poles).max(initial=0.0) or 1.0
    if zero.any() and np.diagonal(transient(model, [0.0, 1 / rate]).P, axis1=1, axis2=2)[:, zero].any():
        return None
    if zero.all():
        return 0.0

    def outside(P: Array) -> Array:
        """The farthest variance from its limit, in units of the band."""
        return (np.abs(np.diagonal(P, axis1=1, axis2=2) - variance)[:, ~zero] / (within * variance[~zero])).max(axis=1)

    t, rows = np.zeros(1), np.array([model.P0])
    for end in 2.0 ** np.arange(48) / rate:
        points = int(np.clip(4 * (end - t[-1]) * np.abs(limit.poles.imag).max(), 64, 8192))
        window = np.linspace(t[-1], end, points + 1)[1:]
        P = transient(replace(model, P0=rows[-1]), window - t[-1]).P
        t, rows = np.concatenate([t, window]), np.concatenate([rows, P])
        # As long again in half the band is taken for staying there: the error converges.
        if outside(P).max() < 0.5:
            return _last_entry(model, t, rows, outside)
    return None


def _last_entry(model: ContinuousModel, t: Array, P: Array, outside: Callable[[Array], Array]) -> float:
    """When ``outside`` falls below 1 for the last time, refined between the samples P (points, n, n) at t."""
    from scipy.optimize import brentq, minimize_scalar  # 0.1 s to import, for this alone

    def after(i: int, h: float) -> float:
        return float(outside(transient(replace(model, P0=P[i]), [h]).P)[0])

    r = outside(P)
    i = int(np.flatnonzero(r > 1).max(initial=-1))
    low, high = 0.0, t[i + 1] - t[i]
    # A swing may leave the band between two samples, of which it has a dozen: look into the peaks after the last entry.
    for k in range(len(t) - 2, max(i, 0), -1):
        if r[k] > 0.8 and r[k] >= max(r[k - 1], r[k + 1]):
            width = t[k + 1] - t[k - 1]
            peak = minimize_scalar(
                lambda h, k=k: -after(k - 1, h), bounds=(0.0, width), method="bounded", options={"xatol": 1e-6 * width}
            )
            if peak.fun < -1:
                i, low, high = k - 1, float(peak.x), width
                break
    if i < 0:
        return 0.0
    return float(t[i] + brentq(lambda h: after(i, h) - 1, low, high, xtol=1e-12 * high))


class _Plain(NamedTuple):
    """The model with N taken out: ẋ = Fx + w + known input, w of strength W, J the rate of information."""

    F: Array
    W: Array
    J: Array
    H: Array
    Rc: Array
    GN: Array

    def gain(self, P: Array) -> Array:
        """Kc of one covariance or a stack of them."""
        return np.swapaxes(np.linalg.solve(self.Rc, np.swapaxes(P @ self.H.T + self.GN, -1, -2)), -1, -2)


def _plain(model: ContinuousModel) -> _Plain:
    """F − GNRc⁻¹H and G(Q − NRc⁻¹Nᵀ)Gᵀ: what a measurement tells of the disturbance at the same time is used."""
    checks.instance("model", model, ContinuousModel)
    if model.Rc is None:
        msg = "Rc: expected the strength of the continuous measurements' noise, received None: sample the measurements"
        raise ValueError(msg)
    scale = np.sqrt(np.diag(model.Rc))
    lowest = np.linalg.eigvalsh(model.Rc / np.outer(scale, scale)).min(initial=1.0) if scale.all() else 0.0
    if lowest < 1e-13:
        msg = (
            "Rc: expected a positive definite matrix, received a singular one: perfect continuous measurements "
            "need the reduced filter"
        )
        raise ValueError(msg)
    root = np.linalg.cholesky(model.Rc)
    seen = scipy.linalg.solve_triangular(root, model.H, lower=True)
    N = np.zeros((model.s, model.m)) if model.N is None else model.N
    shared = scipy.linalg.solve_triangular(root, N.T, lower=True)
    Q = model.Q - shared.T @ shared
    known = np.diag(Q) <= 8 * model.s * np.finfo(float).eps * np.diag(model.Q)
    Q = np.where(known[:, None] | known, 0.0, Q)
    W = model.G @ Q @ model.G.T
    return _Plain(model.F - model.G @ shared.T @ seen, 0.5 * (W + W.T), seen.T @ seen, model.H, model.Rc, model.G @ N)


class _Layer(NamedTuple):
    """The flow over an interval: transition Φ = I + E, covariance 𝒢 from zero, information 𝒞 on the beginning.

    E is kept beside Φ, since a slow mode's e^(λh) − 1 over an interval made for a fast one is lost in Φ.
    """

    Phi: Array
    E: Array
    G: Array
    C: Array

    def carried(self, P: Array) -> Array:
        """P at the end of the interval from P at its beginning."""
        root = self.Phi @ _root(P, self.C)
        return self.G + root @ root.T

    def doubled(self) -> _Layer:
        """The interval twice over."""
        inner = _root(self.G, self.C)
        forward, backward = self.Phi @ inner, self.Phi.T @ _root(self.C, self.G)
        Phi, E = self._twice(_solve_gap(self.G, self.C, self.Phi), inner @ (inner.T @ self.C))
        return _Layer(Phi, E, self.G + forward @ forward.T, self.C + backward @ backward.T)

    def about(self, P: Array) -> _Layer:
        """The same flow for what is added to P; 𝒢, how P itself changes, need not be positive."""
        inner, root = _root(P, self.C), _root(self.C, P)
        Phi = self.Phi @ _solve_gap(P, self.C, np.eye(len(P)))
        return _merged(Phi, self.E - self.Phi @ inner @ (inner.T @ self.C), self.carried(P) - P, root @ root.T)

    def doubled_about(self) -> _Layer:
        """:meth:`doubled` of a flow whose 𝒢 is not positive."""
        n = len(self.G)
        inner = np.linalg.solve(np.eye(n) + self.G @ self.C, np.hstack([self.G, self.Phi]))
        reduced, between = inner[:, :n], inner[:, n:]
        Phi, E = self._twice(between, reduced @ self.C)
        C = self.C + self.Phi.T @ self.C @ between
        return _Layer(Phi, E, self.G + symmetric(self.Phi @ reduced @ self.Phi.T), symmetric(C))

    def leap(self, P: Array, most: int) -> tuple[Array, int]:
        """P after a number of such intervals, a power of 2 up to ``most``; P itself after 0 if its filter is unstable.

        The flow is taken about P, which tames the unstable modes that P covers, and doubled until P has changed much:
        what is left of it then would carry the rounding of what it was.
        """
        change, steps = self.about(P), 1
        if np.abs(np.linalg.eigvals(change.Phi)).max(initial=0.0) > 1 + 1e-6:
            return P, 0
        while 2 * steps <= most:
            longer = change.doubled_about()
            if (np.diag(P + longer.G) < 0.1 * np.diag(P)).any():
                break
            change, steps = longer, 2 * steps
        return P + change.G, steps

    def _twice(self, between: Array, X: Array) -> tuple[Array, Array]:
        """Φ and E of two intervals from (I + 𝒢𝒞)⁻¹Φ = (I − X)Φ."""
        E = 2 * self.E + self.E @ self.E - self.Phi @ X @ self.Phi
        return _merged(self.Phi @ between, E, self.G, self.C)[:2]


def _merged(Phi: Array, E: Array, G: Array, C: Array) -> _Layer:
    """Each diagonal element from Φ or from E, whichever has it without cancellation."""
    slow = (np.abs(np.diag(E)) < 0.5) & np.eye(len(E), dtype=bool)
    return _Layer(np.where(slow, 1 + E, Phi), np.where(slow, E, Phi - np.eye(len(E))), G, C)


def _root(P: Array, C: Array) -> Array:
    """A factor of P(I + CP)⁻¹, which is nonnegative whatever is singular."""
    L, d = ldl(P)
    L = L * np.sqrt(d)
    inner = np.linalg.cholesky(np.eye(len(P)) + L.T @ C @ L)
    return scipy.linalg.solve_triangular(inner, L.T, lower=True).T


def _solve_gap(P: Array, C: Array, right: Array) -> Array:
    """(I + PC)⁻¹ right, in units in which P and C are alike."""
    p, c = np.diag(P), np.diag(C)
    unit = np.where((p > 0) & (c > 0), np.sqrt(np.sqrt(np.where(p > 0, p, 1.0) / np.where(c > 0, c, 1.0))), 1.0)
    gap = np.eye(len(P)) + (P / np.outer(unit, unit)) @ (C * np.outer(unit, unit))
    return unit[:, None] * np.linalg.solve(gap, right / unit[:, None])


class _Flow:
    """The flow of one model's Riccati equation over any interval; intervals met before are remembered."""

    def __init__(self, plain: _Plain, longest: float) -> None:
        """``longest`` is the longest interval asked for, s."""
        n = len(plain.F)
        hamiltonian = np.block([[plain.F, plain.W], [plain.J, -plain.F.T]])
        # The spectral radius of |M| is the same in all units of the states, which a norm is not.
        rate = np.abs(np.linalg.eigvals(np.abs(hamiltonian))).max(initial=0.0)
        self._short = 0.125 / max(rate, 0.125 / longest if longest > 0 else 1.0)
        self._series = _series(plain, self._short, 20 + 2 * min(n, 10))
        self._known: dict[float, tuple[_Layer, int]] = {}
        self._clock = 0.0

    def to(self, t: float, P: Array) -> Array:
        """P at time t from P at the time of the call before (0 at first)."""
        h = t - self._clock
        # On an even grid the differences differ in their last digits: one that leads to t within rounding will do.
        h = next((known for known in self._known if abs(known - h) <= 4 * np.finfo(float).eps * t), h)
        self._clock += h
        if h == 0:
            return P
        if h not in self._known:
            self._known[h] = self._layers(h)
        layer, count = self._known[h]
        with np.errstate(over="ignore", invalid="ignore"):  # an overflow is reported by the caller, with its time
            while count:
                for _ in range(min(count, 8)):
                    previous, P, count = P, layer.carried(P), count - 1
                    if not np.isfinite(P).all() or np.array_equal(previous, P):
                        return P
                if count:
                    P, steps = layer.leap(P, count)
                    count -= steps
        return P

    def _layers(self, h: float) -> tuple[_Layer, int]:
        """A layer and how many of it make the interval: one, or more where Φ would grow too much."""
        doublings = max(0, math.ceil(math.log2(h / self._short)))
        powers = (h / 2**doublings / self._short) ** np.arange(self._series.shape[1])
        E, G, C = np.einsum("k,akij->aij", powers, self._series)
        layer = _merged(np.eye(len(E)) + E, E, G, C)
        for left in range(doublings, 0, -1):
            if np.abs(np.linalg.eigvals(layer.Phi)).max(initial=0.0) > GROWTH:
                return layer, 2**left
            layer = layer.doubled()
        return layer, 1


def _series(plain: _Plain, unit: float, terms: int) -> Array:
    r"""Power series of Φ, 𝒢 and 𝒞 in t/unit, (3, terms, n, n), from their own equations.

    .. math:: \dot{\mathcal G} = F\mathcal G + \mathcal GF^T + W - \mathcal GJ\mathcal G, \quad
              \dot\Phi = (F - \mathcal GJ)\Phi, \quad \dot{\mathcal C} = \Phi^TJ\Phi
    """
    F, W, J = plain.F * unit, plain.W * unit, plain.J * unit
    n = len(F)
    Phi, G, C, GJ, JPhi = (np.zeros((terms, n, n)) for _ in range(5))
    Phi[0], JPhi[0] = np.eye(n), J
    for k in range(terms - 1):
        linear = F @ G[k] + (W / 2 if k == 0 else 0.0)
        change = linear + linear.T - _product(GJ, G, k)
        G[k + 1] = 0.5 * (change + change.T) / (k + 1)
        Phi[k + 1] = (F @ Phi[k] - _product(GJ, Phi, k)) / (k + 1)
        information = _product(np.swapaxes(Phi, 1, 2), JPhi, k)
        C[k + 1] = 0.5 * (information + information.T) / (k + 1)
        GJ[k + 1], JPhi[k + 1] = G[k + 1] @ J, J @ Phi[k + 1]
    Phi[0] = 0.0
    return np.array([Phi, G, C])


def _product(left: Array, right: Array, k: int) -> Array:
    """Coefficient k of the product of two power series of matrices."""
    return np.tensordot(left[: k + 1], right[k::-1], axes=([0, 2], [0, 1]))

