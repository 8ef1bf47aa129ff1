r"""The algebraic Riccati equation of the filter, in discrete and continuous time, with a bound of the error.

.. math:: P = APA^T + Q - VS^{-1}V^T, \quad V = APH^T + N, \quad S = HPH^T + R, \quad K = VS^{-1}

.. math:: 0 = AP + PA^T + Q - VS^{-1}V^T, \quad V = PH^T + N, \quad S = R, \quad K = VS^{-1}

P is the solution whose loop A − KH is stable (the regulator's equation is the same with A, H transposed). Some solver's P is corrected by
Newton's method, with residuals in twice the working precision, until it stands still. With the gain K as rounded, L = A − KH,
:math:`r = KS - V` and what is missing, :math:`\Delta = P^* - P`, the equation reads

.. math:: \Delta = L\Delta L^T + D - (r - L\Delta H^T)(S + H\Delta H^T)^{-1}(r - L\Delta H^T)^T, \quad
          D = LPL^T + Q + KRK^T - NK^T - KN^T - P

(in continuous time :math:`L\Delta + \Delta L^T + D - (r - \Delta H^T)R^{-1}(\cdot)^T = 0`). If the right-hand side maps
:math:`\{-Y \preceq \Delta \preceq Y\}` into itself, there is a solution in it (Brouwer), and the same numbers show that its loop is stable:
it is the one that is sought (the argument of Kantorovich). Y is made of the solution of a Lyapunov equation that proves L stable.

A Lyapunov equation is one without measurements.
"""

from __future__ import annotations

import warnings
from contextlib import nullcontext
from typing import NamedTuple

import numpy as np

from ctlabs.linalg import manyfold, undriven
from ctlabs.linalg.checks import Array
from ctlabs.linalg.correlated import regression
from ctlabs.linalg.lyapunov import Operator, lost, prove
from ctlabs.linalg.manyfold import Manyfold, Matrix, high
from ctlabs.linalg.starts import Uncorrelated, starts
from ctlabs.linalg.threads import one_thread
from ctlabs.linalg.units import balanced

#: Below this number of states a second thread of BLAS only waits.
SMALL = 128
#: A solution counts as one below this bound of its error, in standard deviations.
SOLVED = 1e-6
#: Bound that a solution in doubles must reach to be left at that.
GOOD = 1e-13
#: Newton's steps, at most: far from the solution each halves an error, near it they square it.
STEPS = 40
#: Solutions that are remembered: the steady state of one model is asked for again and again.
KEPT = 256
#: A correction below this part of the standard deviations is none; of twice the precision, and that to the power fold/2.
STILL = 1e-26
#: A variance below this part of its own terms is the rounding of twice the working precision, and zero; the same.
NOTHING = 2.0**-90


class Solution(NamedTuple):
    """The stabilising solution; its arrays are shared by all who ask for it.

    ``P`` (n, n) · ``K`` (n, m), its gain, in discrete time the predictor's · ``reach`` (n, n), Y with −Y ⪯ P* − P ⪯ Y for the exact P* ·
    ``error``, the bound of |P*_ij − P.high_ij| in units of σ_iσ_j, σ² = diag P; absolute where one of them is zero
    """

    P: Manyfold
    K: Array
    reach: Array
    error: float


class RiccatiEquation(NamedTuple):
    """A (n, n), H (m, n), Q (n, n), R (m, m), N (n, m); strengths instead of covariances if continuous."""

    A: Array
    H: Array
    Q: Manyfold
    R: Array
    N: Manyfold
    continuous: bool

    def scaled(self, x: Array, z: Array, time: float = 1.0) -> RiccatiEquation:
        """The same in other units of the states, the measurements and time."""
        return RiccatiEquation(
            self.A * x / x[:, None] * time,
            self.H * x / z[:, None],
            self.Q.scaled(time / x, 1 / x),
            self.R / np.outer(z, z) / time,
            self.N.scaled(1 / x, 1 / z),
            self.continuous,
        )

    def without_N(self) -> RiccatiEquation:
        """Transition and noise given what the measurements tell of the noise; what is rounding of its own terms is zero."""
        N = self.N.high
        if not N.any():
            return self
        M = regression(N, self.R)
        Q = self.Q.high - M @ N.T
        known = np.diag(Q) <= 16 * len(Q) * np.finfo(float).eps * np.diag(self.Q.high)
        Q = np.where(known[:, None] | known, 0.0, 0.5 * (Q + Q.T))
        return self._replace(A=self.A - M @ self.H, Q=Manyfold.of(Q), N=Manyfold.of(np.zeros_like(N)))

    def precisely_without_N(self, fold: int) -> Uncorrelated:
        """The same in a multiple of the working precision; R has an inverse, or N is zero."""
        if not self.N.high.any():
            return Uncorrelated(self.A, self.H, self.Q, self.R)
        M = manyfold.solve(Manyfold.of(self.R, fold), Manyfold.of(self.N, fold).T).T
        return Uncorrelated(Manyfold.of(self.A, fold) - M @ self.H, self.H, (self.Q - M @ self.N.T).symmetric, self.R)

    def reduced(self, rest: undriven.Rest) -> RiccatiEquation:
        """The equation of the states kept."""
        k, M = rest.kept, rest.M
        A = self.A[np.ix_(k, k)] + self.A[np.ix_(k, rest.known)] @ M
        H = self.H[:, k] + self.H[:, rest.known] @ M
        return self._replace(A=A, H=H, Q=self.Q[np.ix_(k, k)], N=self.N[k])

    def told(self, elements: Array) -> RiccatiEquation:
        """The equation with some of the measurements."""
        R = self.R[np.ix_(elements, elements)]
        return self._replace(H=self.H[elements], R=R, N=self.N[:, elements])

    def key(self) -> tuple[object, ...]:
        """What tells this equation from others."""
        matrices = (self.A, self.H, *self.Q.parts, self.R, *self.N.parts)
        return self.continuous, self.Q.fold, *((M.shape, M.tobytes()) for M in matrices)

    def innovation(self, P: Array) -> Array:
        """The diagonal of S."""
        return np.diag(self.R) if self.continuous else np.diag(self.R) + np.diag(self.H @ P @ self.H.T)


def solve(A: Array, H: Array, Q: Matrix, R: Array, N: Matrix | None = None, *, continuous: bool) -> Solution:
    """The stabilising solution; zero along what no noise drives and what does not grow (:mod:`ctlabs.linalg.undriven`).

    Raises
    ------
    ValueError
        No solution with an error bound below 1e-6 was found: a mode that does not decay is not measured, or the loop is too near to the
        boundary of stability for double precision.

    Source: Lancaster & Rodman, *Algebraic Riccati Equations* (1995); Kleinman (1968), IEEE Trans. AC-13 (Newton's method).

    >>> one = np.eye(1)
    >>> solve(one, one, one, one, continuous=True).P.high, solve(one, one, one, one, continuous=False).P.high.round(6)
    (array([[2.41421356]]), array([[1.618034]]))
    """
    given = RiccatiEquation(A, H, Manyfold.of(Q), R, Manyfold.of(np.zeros((len(A), len(H))) if N is None else N), continuous)
    key = given.key()
    if key not in _KNOWN:
        with one_thread() if len(A) < SMALL else nullcontext():  # threads that wait for each other take ten times as long
            found = _found(given)
        while len(_KNOWN) >= KEPT:
            _KNOWN.pop(next(iter(_KNOWN)), None)
        _KNOWN[key] = found
    return _KNOWN[key]


_KNOWN: dict[tuple[object, ...], Solution] = {}


def _found(given: RiccatiEquation) -> Solution:
    """The solution, computed."""
    plain, continuous, R = given.without_N(), given.continuous, given.R
    rest = undriven.without(plain.A, plain.Q.high, continuous=continuous)
    left, first = given.reduced(rest), plain.reduced(rest)
    told = telling(left.H, R)
    found = _solved(left.told(told), first.told(told))
    whole = told.all() and not len(rest.known)
    return found if whole else _completed(given, rest, told, found)


def telling(H: Array, R: Array) -> Array:
    """Which measurements tell what those before them do not: all but perfect ones of what is known, and combinations, noise included.

    >>> telling(np.array([[1.0], [1.0], [0.0]]), np.array([[1.0, 1, 0], [1, 1, 0], [0, 0, 0]])).tolist()
    [True, False, False]
    """
    m, tiny = len(R), 16 * len(R) * np.finfo(float).eps
    sd = np.sqrt(np.diag(R))
    told = np.ones(m, dtype=bool)
    unit = np.where(sd > 0, sd, 1.0)
    if np.linalg.eigvalsh(R / np.outer(unit, unit)).min(initial=1.0) > tiny:
        return told
    for i in range(m):
        before = np.flatnonzero(told[:i])
        w = np.linalg.lstsq(R[np.ix_(before, before)] / unit[before], R[before, i], rcond=tiny)[0] / unit[before]
        if R[i, i] - w @ R[before, i] <= tiny * R[i, i]:
            rest, terms = H[i] - w @ H[before], np.abs(H[i]) + np.abs(w) @ np.abs(H[before])
            told[i] = (np.abs(rest) > tiny * terms).any()
    return told


def stationary(A: Array, Q: Matrix, *, continuous: bool) -> Solution:
    r"""The solution of :math:`P = APA^T + Q` or :math:`AP + PA^T + Q = 0`, A stable.

    >>> stationary(np.array([[0.5]]), np.array([[3.0]]), continuous=False).P.high
    array([[4.]])
    """
    n = len(A)
    return solve(A, np.zeros((0, n)), Q, np.zeros((0, 0)), continuous=continuous)


def _completed(given: RiccatiEquation, rest: undriven.Rest, told: Array, found: Solution) -> Solution:
    """The solution for all states and measurements from that of the states kept and the measurements that tell."""
    T = np.zeros((len(given.A), len(rest.kept)))
    T[rest.kept, np.arange(len(rest.kept))] = 1.0
    T[rest.known] = rest.M
    P, reach = (T @ Manyfold.of(found.P, 2) @ T.T).symmetric, T @ found.reach @ T.T
    some = given.told(told)
    S, V = some.R, P.high @ some.H.T + some.N.high
    if not given.continuous:
        S, V = some.H @ P.high @ some.H.T + some.R, some.A @ P.high @ some.H.T + some.N.high
    K = np.zeros_like(given.N.high)
    K[:, told] = np.linalg.solve(S, V.T).T
    sd, own = np.sqrt(np.diag(found.P.high)), np.sqrt(np.diag(P.high))
    unit = np.where(own > 0, own, 1.0)
    doubt = rest.doubt @ sd / unit[rest.known]
    rounded = (np.abs(P.low) / np.outer(unit, unit)).max(initial=0.0)
    return Solution(P, K, reach, found.error + rounded + 3 * doubt.max(initial=0.0))


def power(variance: Array) -> Array:
    """Powers of 2 near the roots of variances; 1 where they are zero."""
    return np.exp2(np.round(0.5 * np.log2(np.where(variance > 0, variance, 1.0))))


def _solved(eq: RiccatiEquation, plain: RiccatiEquation) -> Solution:
    """The solution of an equation; ``plain`` is the same without N, for the first approximation."""
    n, m = eq.N.high.shape
    if not n:
        return Solution(Manyfold.of(np.zeros((0, 0)), 2), np.zeros((0, m)), np.zeros((0, 0)), 0.0)
    z = power(plain.innovation(plain.Q.high))
    seen = plain.H / z[:, None]
    x, time = balanced(plain.A, plain.Q.high, seen.T @ seen, continuous=plain.continuous)
    z = power(plain.innovation(plain.Q.high) / time)
    here, first = eq.scaled(x, z, time), plain.scaled(x, z, time)
    why = "none whose loop is provably stable"
    # What fails here, and what other solvers warn of, only leads to the next one.
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ways = starts(Uncorrelated(first.A, first.H, first.Q.high, first.R), here.precisely_without_N, continuous=eq.continuous)
        for fold, start in ways:
            try:
                found = _Newton(here, fold).solution(Manyfold.of(start(), fold))
            except _Unproved as error:
                why = str(error)
                continue
            except (ArithmeticError, np.linalg.LinAlgError):
                continue
            K = found.K * x[:, None] / z / (time if eq.continuous else 1.0)
            P, reach = found.P.scaled(x, x), found.reach * np.outer(x, x)
            return Solution(P, K, reach, max(found.error, _absolute(P.high, reach)))
    sought = "Riccati equation: expected a stabilising solution" if m else "Lyapunov equation: expected the solution of a stable matrix"
    msg = f"{sought} with an error bound below {SOLVED:g}, received {why}"
    raise ValueError(msg)


def _absolute(P: Array, reach: Array) -> float:
    """Bound of the error of elements of states without variance."""
    sd = np.sqrt(np.diag(reach))
    zero = np.diag(P) == 0
    return float((np.outer(sd, sd)[zero]).max(initial=0.0))


class _Point(NamedTuple):
    """P with its gain: L, sums of magnitudes behind it, D − rS⁻¹rᵀ, how far rounding may have moved that, rS⁻¹rᵀ."""

    P: Manyfold
    K: Manyfold
    S: Manyfold
    loop: Manyfold
    size: Array
    rest: Manyfold
    doubt: Array
    best: Array


def _at(eq: RiccatiEquation, P: Manyfold) -> _Point:
    """The equation at P, in the precision of P."""
    A, H, Q, R, N, continuous = eq
    PH = P @ H.T
    S, V = (Manyfold.of(R, P.fold), PH + N) if continuous else (H @ PH + R, A @ PH + N)
    K = manyfold.solve(S, V.T).T
    loop, miss = A - K @ H, K @ S - V
    LP, NK = loop @ P, N @ K.T
    moved = LP + LP.T if continuous else LP @ loop.T - P
    noise = K @ R @ K.T - NK - NK.T + Q
    best = (miss @ manyfold.solve(S, miss.T)).symmetric  # what a better gain would save
    size = np.abs(A) + np.abs(K.high) @ np.abs(H)
    m, k = len(H), np.abs(K.high).max(axis=1, initial=0.0)
    terms = m * m * np.outer(k, k) * np.abs(R).max(initial=0.0) + m * np.abs(N.high).max(initial=0.0) * (k[:, None] + k)
    doubt = lost(size, np.abs(P.high), P.fold, continuous=continuous) + 8 * manyfold.rounding(P.fold) * (terms + np.abs(Q.high))
    return _Point(P, K, S, loop, size, (moved + noise - best).symmetric, doubt, best.high)


class _Unproved(ArithmeticError):
    """A P that does not change any more, with too large a bound or none."""


class _Newton:
    """Newton's method for one equation: residuals in a multiple of the working precision, corrections in it or, later, as well."""

    def __init__(self, eq: RiccatiEquation, fold: int) -> None:
        self.eq, self.fold = eq, fold
        self.x = np.ones(len(eq.A))

    def solution(self, P: Manyfold) -> Solution:
        """From a first P to where the corrections stand still; ``ArithmeticError`` where that is not, or proves nothing."""
        precise, last, bound = self.fold > 2, np.inf, np.inf
        for _ in range(STEPS):
            here, own, x, z = self._units(P)
            at = _at(here, own)
            try:
                operator = Operator(at.loop if precise else at.loop.high, continuous=here.continuous)
            except ArithmeticError:
                if precise:
                    raise
                precise = True
                continue
            change = operator.solve(at.rest if precise else at.rest.high)
            sd = np.sqrt(np.maximum(np.diag(own.high), 0.25))
            part = float((np.abs(high(change)) / np.outer(sd, sd)).max())
            if not np.isfinite(part):
                msg = "corrections that diverge"
                raise ArithmeticError(msg)
            if part < STILL ** (self.fold / 2) or 0.75 * last < part < 0.1:
                reach = _reach(here, at, operator)
                found = None if reach is None else _bounded(own, at.K.high * x[:, None] / z, reach, x)
                bound = np.inf if found is None else found.error
                if found is not None and (bound < GOOD or (precise and bound < SOLVED)):
                    return found
                if precise:
                    break
                precise, part = True, np.inf
            else:
                P = (own + change).symmetric.scaled(x, x)
            last = part
        msg = f"the bound {bound:.3g}" if np.isfinite(bound) else "none whose loop is provably stable"
        raise _Unproved(msg)

    def _units(self, P: Manyfold) -> tuple[RiccatiEquation, Manyfold, Array, Array]:
        """The equation and P in units in which the variances are near 1, and these units."""
        variance = np.diag(P.high)
        sd = np.sqrt(np.maximum(variance, 0.0))
        terms = (np.abs(self.eq.A) @ sd) ** 2 + np.diag(self.eq.Q.high)
        if self.eq.continuous:
            terms /= max(1.0, np.abs(self.eq.A).sum(axis=1).max()) ** 2
        self.x = np.where(variance > NOTHING ** (self.fold / 2) * terms, power(variance), np.where(terms > 0, power(terms), self.x))
        z = power(self.eq.innovation(P.high))
        return self.eq.scaled(self.x, z), P.scaled(1 / self.x, 1 / self.x), self.x, z


def _reach(eq: RiccatiEquation, at: _Point, operator: Operator) -> Array | None:
    """Y with −Y ⪯ P* − P ⪯ Y, or None if that cannot be shown."""
    proof = prove(operator, at.loop, at.size)
    if proof is None:
        return None
    c = 2 * proof.times(np.abs(at.rest.high) + at.doubt)
    Y = c * proof.reach
    if not len(eq.H):
        return Y
    # HΔHᵀ ⪯ θS and LΔHᵀS⁻¹HΔLᵀ ⪯ θY ⪯ φ²·weight: the part of the map that is not linear.
    theta = float(np.trace(manyfold.solve(at.S, eq.H @ Manyfold.of(Y, 2) @ eq.H.T).high))
    phi = np.sqrt(2 * theta * proof.times(Y))
    beta = np.sqrt(proof.times(at.best))
    return Y if theta < 0.5 and 2 * beta * phi + phi**2 + 2 * beta**2 * theta <= c / 8 else None


def _bounded(P: Manyfold, K: Array, reach: Array, x: Array) -> Solution:
    """The solution in the units that were left for ``x``."""
    variance, own = np.diag(P.high), np.diag(reach)
    zero = variance <= NOTHING ** (P.fold / 2)
    sd = np.where(zero, 1.0, np.sqrt(np.where(zero, 1.0, variance)))
    error = (own / sd**2)[~zero].max(initial=0.0) + (np.abs(P.low) / np.outer(sd, sd))[np.ix_(~zero, ~zero)].max(initial=0.0)
    known = zero[:, None] | zero
    left = Manyfold(tuple(np.where(known, 0.0, part) for part in P.parts))
    reach = reach + np.diag(np.where(zero, np.abs(variance), 0.0))
    return Solution(left.scaled(x, x), K, reach * np.outer(x, x), float(error) * (1 + 1e-6))
