"""Twins of the library's verbs with proved digits: the textbook's formulas in ball arithmetic (Arb), written without the library.

Matrices are flint's ``arb_mat``, whose elements are intervals that hold the exact number: a twin is computed again with more bits
until they are narrow. They take the doubles of a model as exact. Beside the twins stand the random models that they are asked
about, and the comparison of a verb with its twin, in standard deviations.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import reduce
from operator import add
from typing import Any, NamedTuple

import mpmath
import numpy as np
import scipy.linalg
from flint import arb, arb_mat, ctx

from ctlabs import Filter, kalman_filter, smooth
from ctlabs.filtering import bucy, log_likelihood, steady
from ctlabs.linalg.checks import Array
from ctlabs.models import ContinuousModel, DiscreteModel
from ctlabs.models.discretisation import discretise, interval

#: Bits that an answer has beyond the standard deviations in which it is compared, and the most that are tried for them.
BITS, MOST = 100, 200_000
#: Stands for the variance of what is not known at all, and a variance that only such a state has.
UNKNOWN, UNSEEN = arb(2) ** 1600, arb(2) ** 800
#: A verb is right within this part of a standard deviation, or says that it is not.
RIGHT = 1e-6


# --- matrices of balls -----------------------------------------------------------------------------------------------


def exact(M: Any) -> Array:
    """The same numbers in mpmath, with all digits."""
    return np.vectorize(mpmath.mpf, otypes=[object])(np.asarray(M, dtype=np.float64))


def balls(M: Any) -> arb_mat:
    """A matrix, or a column, without rounding."""
    M = np.asarray(M, dtype=np.float64)
    M = M[:, None] if M.ndim == 1 else M
    return arb_mat(*M.shape, M.ravel().tolist())


def floats(M: arb_mat) -> Array:
    """The middles, rounded to doubles."""
    return np.array([float(v) for v in M.entries()]).reshape(M.nrows(), M.ncols())


def one(n: int) -> arb_mat:
    """The identity."""
    return balls(np.eye(n))


def parts(M: arb_mat, rows: Any, columns: Any) -> arb_mat:
    """Some rows and columns."""
    table = M.tolist()
    return arb_mat(len(rows), len(columns), [table[i][j] for i in rows for j in columns])


def joined(blocks: list[list[arb_mat]]) -> arb_mat:
    """A matrix of blocks."""
    table = [reduce(add, (list(block.tolist()[i]) for block in row)) for row in blocks for i in range(row[0].nrows())]
    return arb_mat(table)


def even(M: arb_mat) -> arb_mat:
    """½(M + Mᵀ)."""
    return (M + M.transpose()) / 2


def narrow(M: arb_mat, rows: Array, columns: Array) -> bool:
    """Whether each ball is below 2^−BITS of the sizes of its row and column, or of 1 where they are zero."""
    limit = [arb(row) * arb(column) * arb(2) ** -BITS for row in _units(rows) for column in _units(columns)]
    return all(bool(v.is_finite()) and bool(v.rad() < most) for v, most in zip(M.entries(), limit, strict=True))


def _units(sd: Array) -> list[float]:
    """Sizes to compare with: 1 where there is none."""
    return np.where(sd > 0, sd, 1.0).tolist()


def deviations(P: arb_mat) -> Array:
    """Standard deviations of a covariance (of what is not known, of UNKNOWN's size)."""
    return np.array([float(arb(max(P[i, i].mid(), arb(0))).sqrt()) for i in range(P.nrows())])


def precisely(make: Callable[[], tuple[Any, bool]], bits: int = 400) -> Any:
    """What ``make`` computes with so many bits that it says the answer is narrow."""
    while bits <= MOST:
        with ctx.workprec(bits):
            try:
                found, good = make()
            except ZeroDivisionError:
                good = False
            if good:
                return found
        bits *= 3
    raise AssertionError(f"no narrow answer with {bits // 3} bits")


# --- twins -----------------------------------------------------------------------------------------------------------


def riccati(A: Any, H: Any, Q: Any, R: Any, N: Any = None, *, continuous: bool) -> arb_mat:
    """The limit from P = 0 of the filter's Riccati equation, by doubling the number of steps until nothing changes."""
    return precisely(lambda: _doubled(balls(A), balls(H), balls(Q), balls(R), None if N is None else balls(N), continuous))


def _doubled(A: arb_mat, H: arb_mat, Q: arb_mat, R: arb_mat, N: arb_mat | None, continuous: bool) -> tuple[arb_mat, bool]:
    n = A.nrows()
    if N is not None:
        M = R.solve(N.transpose()).transpose()
        A, Q = A - M * H, Q - M * N.transpose()
    F, G, P = A.transpose(), H.transpose() * R.solve(H) if H.nrows() else A * 0, Q
    if continuous:
        F, G, P = _cayley(F, G, P)
    before, after = range(n), range(n, 2 * n)
    for _ in range(500):
        W = (one(n) + G * P).solve(joined([[F, G]]))
        WF, WG = parts(W, before, before), parts(W, before, after)
        more = even(F.transpose() * P * WF)
        F, G, P = F * WF, even(G + F * WG * F.transpose()), P + more
        sd = deviations(P)
        if not np.isfinite(sd).all():
            break
        unit = np.where(sd > 0, sd, 1.0)
        left = np.abs(floats(F)) * unit[:, None] / unit
        change = np.abs(floats(more)) / np.outer(unit, unit)
        if left.max() < 1e-30 and change.max() < 1e-60:
            return P, narrow(P, sd, sd)
    return P, False


def _cayley(F: arb_mat, G: arb_mat, Q: arb_mat) -> tuple[arb_mat, arb_mat, arb_mat]:
    """The discrete equation with the same solution (Chu, Fan & Lin 2005)."""
    E = one(F.nrows())
    rates = np.abs(np.linalg.eigvals(np.block([[floats(F).T, floats(Q)], [floats(G), -floats(F)]])))
    tau = arb(float(np.exp(np.log(rates[rates > 0]).mean())) * 1.0123)
    B = (F - E * tau).inv()
    W = (F.transpose() - E * tau + Q * B * G).inv()
    return E + W.transpose() * (2 * tau), even(B * G * W) * (2 * tau), even(W * Q * B) * (2 * tau)


def update(P: arb_mat, H: Any, R: Any) -> arb_mat:
    """P⁺ from P⁻."""
    with ctx.workprec(4000):
        H, R = balls(H), balls(R)
        HP = H * P
        return even(P - HP.transpose() * (HP * H.transpose() + R).solve(HP))


class Sampled(NamedTuple):
    """Φ and Qd."""

    Phi: arb_mat
    Qd: arb_mat


def sampled(F: Any, W: Any, dt: float) -> Sampled:
    """Van Loan's exponential over a short step, doubled; its e^{−Ft} stays small."""

    def make() -> tuple[Sampled, bool]:
        n = len(F)
        A, Q = balls(F), balls(W)
        doublings = max(0, math.ceil(math.log2(max(np.abs(F).sum(axis=1).max() * dt, 1.0))))
        both = joined([[A * -1, Q], [A * 0, A.transpose()]]) * (arb(dt) / arb(2) ** doublings)
        E = both.exp()
        Phi = parts(E, range(n, 2 * n), range(n, 2 * n)).transpose()
        Qd = Phi * parts(E, range(n), range(n, 2 * n))
        for _ in range(doublings):
            Phi, Qd = Phi * Phi, even(Qd + Phi * Qd * Phi.transpose())
        sd = deviations(Qd)
        moved = np.sqrt((floats(Phi) ** 2).sum(axis=1)) + 1e-300
        return Sampled(Phi, Qd), narrow(Qd, sd, sd) and narrow(Phi, moved, np.ones(n))

    return precisely(make)


class Record(NamedTuple):
    """Of every row: estimates and covariances before and after the update, given the whole record, cov(x_k, x_{k−1}); ℓ."""

    x_minus: list[arb_mat]
    P_minus: list[arb_mat]
    x_plus: list[arb_mat]
    P_plus: list[arb_mat]
    x: list[arb_mat]
    P: list[arb_mat]
    lag_one: list[arb_mat | None]
    log_likelihood: Any


def filtered(model: DiscreteModel, z: Array, first: int = 1) -> Record:
    """Filter and smoother (de Jong 1989) of a constant model by one-step predictions; NaN is not measured."""
    key = b"".join(np.asarray(M).tobytes() for M in (model.Phi, model.Qd, model.H, model.R, model.x0, model.P0, z)), first
    if key not in _LAST:  # several verbs are asked about one record
        _LAST.clear()
        bits = 400 if np.isfinite(model.P0).all() else 8000
        _LAST[key] = precisely(lambda: _filtered(model, np.asarray(z), first), bits)
    return _LAST[key]


_LAST: dict[Any, Record] = {}


def _filtered(model: DiscreteModel, z: Array, first: int) -> tuple[Record, bool]:
    n, rows = model.n, len(z)
    unknown = np.isinf(np.diag(model.P0))
    Phi, Qd, H, R = balls(model.Phi), balls(model.Qd), balls(model.H), balls(model.R)
    N = balls(np.zeros((n, model.m)) if model.N is None else model.N)
    x, P = balls(np.where(unknown, 0.0, model.x0)), balls(np.where(unknown[:, None] | unknown, 0.0, model.P0))
    for i in np.flatnonzero(unknown).tolist():
        P[i, i] = UNKNOWN
    out = Record([], [], [], [], [], [], [], arb(0))
    log, steps = arb(0), []
    for k, row in enumerate(z):
        used = np.flatnonzero(np.isfinite(row) & (k >= first)).tolist()
        out.x_minus.append(x)
        out.P_minus.append(P)
        if not used:
            steps.append((Phi, x * 0, P * 0))
            out.x_plus.append(x)
            out.P_plus.append(P)
            x, P = Phi * x, even(Phi * P * Phi.transpose() + Qd)
            continue
        Hk, Rk, Nk = parts(H, used, range(n)), parts(R, used, used), parts(N, range(n), used)
        HP = Hk * P
        S, nu = even(HP * Hk.transpose() + Rk), balls(row[used]) - Hk * x
        inverse = S.inv()
        K, K_pred = HP.transpose() * inverse, (Phi * HP.transpose() + Nk) * inverse
        out.x_plus.append(x + K * nu)
        out.P_plus.append(even(P - K * HP))
        log -= ((nu.transpose() * inverse * nu)[0, 0] + S.det().log() + len(used) * (2 * arb.pi()).log()) / 2
        weighted = Hk.transpose() * inverse
        loop = Phi - K_pred * Hk
        steps.append((loop, weighted * nu, even(weighted * Hk)))
        x, P = Phi * x + K_pred * nu, even(Phi * P * Phi.transpose() + Qd - K_pred * S * K_pred.transpose())
    told, known = x * 0, P * 0
    for k in range(rows - 1, -1, -1):
        loop, own, rate = steps[k]
        if k < rows - 1:
            out.lag_one.insert(0, (one(n) - out.P_minus[k + 1] * known) * loop * out.P_minus[k])
        told, known = own + loop.transpose() * told, even(rate + loop.transpose() * known * loop)
        x, P = out.x_minus[k], out.P_minus[k]
        out.x.insert(0, x + P * told)
        out.P.insert(0, even(P - P * known * P))
    out.lag_one.insert(0, None)
    good = bool(log.is_finite()) and bool(log.rad() < 1e-20)
    for xs, Ps in ((out.x_plus, out.P_plus), (out.x, out.P)):
        for x, P in zip(xs, Ps, strict=True):
            sd = deviations(P)
            good = good and narrow(P, sd, sd) and narrow(x, sd, np.ones(1))
    return out._replace(log_likelihood=log), good


# --- how far off -----------------------------------------------------------------------------------------------------


def off(found: Array, right: arb_mat) -> float:
    """The largest error of a covariance, in units of the standard deviations that are right; absolute where one is zero."""
    sd = deviations(right)
    unit = np.where(sd > 0, sd, 1.0)
    with ctx.workprec(4000):
        difference = floats(balls(found) - right)
    return float((np.abs(difference) / unit[:, None] / unit).max(initial=0.0))


def off_estimate(found: Array, right: arb_mat, P: arb_mat) -> float:
    """The largest error of an estimate in its standard deviations, beyond the rounding of the number itself."""
    sd = deviations(P)
    with ctx.workprec(4000):
        error = np.abs(floats(balls(found) - right))[:, 0] - np.spacing(np.abs(found))
    return float((np.maximum(error, 0.0) / np.where(sd > 0, sd, 1.0)).max(initial=0.0))


# --- random models ---------------------------------------------------------------------------------------------------


def covariance(rng: np.random.Generator, n: int, decades: float) -> Array:
    """Diagonal or correlated, variances over so many decades."""
    variance = 10.0 ** rng.uniform(-decades / 2, decades / 2, n)
    if rng.integers(2):
        return np.diag(variance)
    M = rng.normal(size=(n, n + 2))
    sd = np.sqrt(variance / np.diag(M @ M.T))
    Q: Array = (M @ M.T) * np.outer(sd, sd)
    return 0.5 * (Q + Q.T)


class System(NamedTuple):
    """ẋ = Fx + w of strength W, z = Hx + v; R, a variance of v for samples every ``dt``; units of the states."""

    F: Array
    W: Array
    H: Array
    R: Array
    dt: float
    units: Array


def system(seed: Any, most: int = 8, *, sampled_well: bool = False) -> System:
    """Chains, oscillators, stiff and full systems; noise over 12 decades, time scales from 1e-6 to 1e6 s, a unit for each state.

    No mode grows by more than e⁹ within dt. ``sampled_well``: by no more than e, and dt between 1/1000 and 10 times the time scale: a
    record of a chain over 1e10 of its times needs more digits than a double has.
    """
    rng = np.random.default_rng(seed)
    n, m, kind = int(rng.integers(1, most + 1)), int(rng.integers(1, 4)), rng.integers(5)
    time = 10.0 ** rng.uniform(-6, 6)
    if kind == 0:
        F = rng.normal(size=(n, n))
    elif kind == 1:
        F = np.diag(np.ones(n - 1), 1) + np.diag(rng.normal(size=n)) * rng.integers(2)
    elif kind == 2:
        F = np.diag(-(10.0 ** rng.uniform(-6, 2, n)))
    elif kind == 3:
        w, damping = 10.0 ** rng.uniform(-3, 3, n), 10.0 ** rng.uniform(-6, 0, n)
        F = scipy.linalg.block_diag(*[[[0, 1], [-(a**2), -2 * b * a]] for a, b in zip(w, damping, strict=True)])[:n, :n]
    else:
        F = rng.normal(size=(n, n))
        F = F - F.T - np.diag(10.0 ** rng.uniform(-8, 0, n))
    W, R, H = covariance(rng, n, 12), covariance(rng, m, 12), rng.normal(size=(m, n))
    if kind == 1 and rng.integers(2):
        W = np.diag(np.r_[np.zeros(n - 1), 10.0 ** rng.uniform(-6, 6)])
    x = 10.0 ** rng.uniform(-6, 6, n) if rng.integers(2) else np.ones(n)
    free, near = time * 10.0 ** rng.uniform(-6, 6), time * 10.0 ** rng.uniform(-3, 1)
    dt = near if sampled_well or rng.integers(2) else free
    fastest = np.linalg.eigvals(F).real.max() / time
    dt = min(dt, (1.0 if sampled_well else 9.0) / fastest) if fastest > 0 else dt
    return System(F * x[:, None] / x / time, W * np.outer(x, x) / time, H / x, R, dt, x)


def continuous(seed: Any) -> ContinuousModel:
    """One with measurements in continuous time."""
    own = system(seed)
    return ContinuousModel(
        own.F, np.diag(own.units), own.W / np.outer(own.units, own.units), own.H, Rc=own.R * own.dt, P0=np.diag(own.units**2)
    )


def discrete(seed: Any, *, unknown: bool = True, sampled_well: bool = True) -> DiscreteModel:
    """A sampled one, with a P0 over 12 decades; in every tenth something is not known at all, if ``unknown``."""
    own, rng = system(seed, sampled_well=sampled_well), np.random.default_rng([*np.atleast_1d(seed), 2])
    Phi, Qd, _ = interval(own.F, own.W, own.dt)
    P0 = covariance(rng, len(Phi), 12) * np.outer(own.units, own.units)
    N, m = None, len(own.R)
    if rng.integers(4) == 0 and np.diag(Qd).all():
        sd, noise = np.sqrt(np.diag(Qd)), np.sqrt(np.diag(own.R))
        C = rng.normal(size=(len(Phi) + m, len(Phi) + m + 2))
        C = C @ C.T
        unit = np.sqrt(np.diag(C))
        both = C / np.outer(unit, unit) * np.outer(np.r_[sd, noise], np.r_[sd, noise])
        both = 0.5 * (both + both.T)
        if np.linalg.eigvalsh(C / np.outer(unit, unit))[0] > 1e-3:
            n = len(Phi)
            Qd, own, N = both[:n, :n], own._replace(R=both[n:, n:]), both[:n, n:]
    lasting = np.abs(np.linalg.eigvals(Phi)).min() > 1e-9  # what is not known stays so for a step
    if unknown and rng.integers(10) == 0 and lasting:
        free = rng.random(len(Phi)) < 0.5
        P0 = np.where(free[:, None] | free, 0.0, P0) + np.diag(np.where(free, np.inf, 0.0))
    return DiscreteModel(Phi, Qd, own.H, own.R, x0=np.zeros(len(Phi)), P0=P0, dt=own.dt, N=N)


def singular(seed: Any, *, unknown: bool = True) -> DiscreteModel:
    """A sampled one of at most five states: a perfect measurement, a disturbance of rank one, states known exactly or not at all.

    The disturbance's direction has few digits, so that its covariance is of rank one as it stands. A variance that two of these make
    nearly zero is a difference of numbers that are not, and no better known than their rounding.
    """
    own, rng = system(seed, most=5, sampled_well=True), np.random.default_rng([*np.atleast_1d(seed), 7])
    Phi, Qd, _ = interval(own.F, own.W, own.dt)
    (m, n), units, R = own.H.shape, np.outer(own.units, own.units), own.R.copy()
    near = bool(rng.integers(2))
    if near:  # noises about as large as what is measured
        sd = np.sqrt(np.diag(own.H @ np.diag(np.diag(units)) @ own.H.T))
        R = covariance(rng, m, 2) * np.outer(sd, sd)
    if rng.integers(2):
        R[0], R[:, 0] = 0.0, 0.0
    if rng.integers(2):
        mantissa, exponent = np.frexp(rng.normal(size=n) * np.sqrt(np.diag(Qd)))
        g = np.ldexp(np.round(mantissa * 2.0**20), exponent - 20)
        Qd = np.outer(g, g)
    P0 = covariance(rng, n, 4 if near else 12) * units
    kind, some = rng.integers(3), rng.random(n) < 0.6
    if kind < 2:
        P0 = np.where(some[:, None] | some, 0.0, P0)
        if kind == 0 and unknown and np.abs(np.linalg.eigvals(Phi)).min() > 1e-9:
            P0 = P0 + np.diag(np.where(some, np.inf, 0.0))
    return DiscreteModel(Phi, Qd, own.H, R, P0=P0, dt=own.dt)


def data(model: DiscreteModel, seed: Any, rows: int = 16) -> Array:
    """A record of the model, some of its elements missing."""
    rng = np.random.default_rng([*np.atleast_1d(seed), 3])
    n, m = model.n, model.m
    noises = np.block([[model.Qd, np.zeros((n, m))], [np.zeros((m, n)), model.R]])
    if model.N is not None:
        noises[:n, n:], noises[n:, :n] = model.N, model.N.T
    start = np.where(np.isinf(model.P0), np.diag(np.diag(model.Qd)), model.P0)
    x, z = drawn(rng, start), np.empty((rows, m))
    for k in range(rows):
        w = drawn(rng, noises)
        z[k] = model.H @ x + w[n:]
        x = model.Phi @ x + w[:n]
    z[rng.random(z.shape) < 0.15] = np.nan
    return z


def drawn(rng: np.random.Generator, P: Array) -> Array:
    """A vector with a covariance, in units in which it has ones."""
    sd = np.sqrt(np.diag(P))
    unit = np.where(sd > 0, sd, 1.0)
    values, vectors = np.linalg.eigh(P / np.outer(unit, unit))
    return sd * (vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.normal(size=len(P))))


# --- verbs beside their twins ----------------------------------------------------------------------------------------


class Outcome(NamedTuple):
    """A verb on a model: how far off, the bound that it gives (NaN without one), why it refused.

    ``beyond``: the verb said that double precision has too few digits for its estimates.
    """

    off: float
    bound: float = math.nan
    refused: str = ""
    beyond: bool = False

    @property
    def unsaid(self) -> bool:
        """Wrong, and not said so."""
        return not self.refused and not self.beyond and not self.off <= max(RIGHT, self.bound if self.bound > RIGHT else 0.0)


Refusals = (ValueError, ArithmeticError, np.linalg.LinAlgError)


def steady_discrete(seed: Any) -> Outcome:
    """:func:`ctlabs.filtering.steady.solve`."""
    model = discrete(seed, unknown=False, sampled_well=False)
    try:
        found = steady.solve(model)
    except Refusals as error:
        return Outcome(math.nan, refused=str(error))
    right = riccati(model.Phi, model.H, model.Qd, model.R, model.N, continuous=False)
    return Outcome(max(off(found.P_minus, right), off(found.P_plus, update(right, model.H, model.R))), found.error)


def steady_continuous(seed: Any) -> Outcome:
    """:func:`ctlabs.filtering.bucy.steady`."""
    model = continuous(seed)
    try:
        found = bucy.steady(model)
    except Refusals as error:
        return Outcome(math.nan, refused=str(error))
    with ctx.workprec(400):
        G = balls(model.G)
        W = G * balls(model.Q) * G.transpose()
    right = precisely(lambda: _doubled(balls(model.F), balls(model.H), W, balls(model.Rc), None, True))
    return Outcome(off(found.P, right), found.error)


def discretised(seed: Any) -> Outcome:
    """:func:`ctlabs.models.discretisation.discretise`: Qd in its σ, Φ in what it makes of the σ at the start."""
    own = system(seed)
    model = ContinuousModel(own.F, np.eye(len(own.F)), own.W, own.H, P0=np.diag(own.units**2))
    try:
        found = discretise(model, own.dt, R=own.R)
    except Refusals as error:
        return Outcome(math.nan, refused=str(error))
    right = sampled(own.F, own.W, own.dt)
    with ctx.workprec(400):
        start = balls(model.P0)
        after = deviations(right.Phi * start * right.Phi.transpose() + right.Qd)
        moved = np.abs(floats(balls(found.Phi) - right.Phi)) * own.units / after[:, None]
    return Outcome(max(off(found.Qd, right.Qd), float(moved.max())))


def _lost(P: arb_mat) -> Array:
    """Which states are not known."""
    return np.array([bool(P[i, i] > UNSEEN) for i in range(P.nrows())])


class _Heard(NamedTuple):
    """What a verb gave, or why it refused, and whether it said that digits are missing."""

    found: Any
    refused: str
    beyond: bool


def _heard(verb: Callable[[], Any]) -> _Heard:
    try:
        found = verb()
    except Refusals as error:
        return _Heard(None, str(error), beyond=False)
    return _Heard(found, "", bool(found.remarks))


def _compared(x: Array, P: Array, right_x: arb_mat, right_P: arb_mat) -> tuple[float, float]:
    """How far off an estimate and its covariance are; what is not known has to be said not to be."""
    lost = _lost(right_P)
    if (np.isinf(np.diag(P)) != lost).any():
        return math.inf, math.inf
    kept = np.flatnonzero(~lost).tolist()
    if not kept:
        return 0.0, 0.0
    right = parts(right_P, kept, kept)
    return off_estimate(x[kept], parts(right_x, kept, [0]), right), off(P[np.ix_(kept, kept)], right)


#: What rounding may leave of a number after a dozen steps of five states, as a part of its terms: forward, by roots; and on the way back,
#: in covariances, whose roots have half the digits.
LEFT, LEFT_BACK = 1e-13, 1e-7


#: A state may be said not to be known where measurements leave so many times the deviation of its disturbance.
HAIR = 1e10


def within_rounding(
    x: Array, P: Array, right_x: arb_mat, right_P: arb_mat, terms: Array, scale: Array
) -> tuple[float, float]:
    """The same of an estimate and a covariance, beyond what rounding may leave of their ``terms`` (n,), in units of the states.

    What a perfect measurement determines is no better known than that, however small its standard deviation is said to be. A state whose
    deviation is beyond :data:`HAIR` times its ``scale`` may count as not known.
    """
    unknown, lost, sd = _lost(right_P), np.isinf(np.diag(P)), deviations(right_P)
    if (unknown & ~lost).any() or (lost & ~unknown & (sd <= HAIR * scale)).any():
        return math.inf, math.inf
    x, sd, e, value, right = x[~lost], sd[~lost], terms[~lost], floats(right_x)[~lost, 0], floats(right_P)[np.ix_(~lost, ~lost)]
    unit = np.where(sd > 0, sd, np.where(e > 0, e, 1.0))
    estimate = (np.abs(x - value) - e) / unit
    allowed = np.outer(e, sd) + np.outer(sd, e) + np.outer(e, e)
    covariance = (np.abs(P[np.ix_(~lost, ~lost)] - right) - allowed) / unit[:, None] / unit
    return float(estimate.max(initial=0.0)), float(covariance.max(initial=0.0))


def _judged(heard: _Heard, pairs: list[tuple[float, float]]) -> Outcome:
    """The worst of (estimate, covariance)."""
    return Outcome(float(np.max(pairs)), beyond=heard.beyond)


def filter_(seed: Any) -> Outcome:
    """:func:`ctlabs.kalman_filter`: every x and P, before and after the updates."""
    model = discrete(seed)
    z = data(model, seed)
    heard = _heard(lambda: kalman_filter(model, z[1:]))
    if heard.refused:
        return Outcome(math.nan, refused=heard.refused)
    found, right = heard.found, filtered(model, z)
    pairs = [
        _compared(x[k], P[k], xs[k], Ps[k])
        for x, P, xs, Ps in (
            (found.x_minus, found.P_minus, right.x_minus, right.P_minus),
            (found.x_plus, found.P_plus, right.x_plus, right.P_plus),
        )
        for k in range(len(z))
    ]
    return _judged(heard, pairs)


def smoother(seed: Any) -> Outcome:
    """:func:`ctlabs.smooth`: every x and P, and the covariances of neighbours."""
    model = discrete(seed)
    z = data(model, seed)
    heard = _heard(lambda: smooth(model, z[1:]))
    if heard.refused:
        return Outcome(math.nan, refused=heard.refused)
    found, right = heard.found, filtered(model, z)
    pairs = [_compared(found.x[k], found.P[k], right.x[k], right.P[k]) for k in range(len(z))]
    for k in range(1, len(z)):
        here, before = ~_lost(right.P[k]), ~_lost(right.P[k - 1])
        if here.any() and before.any():
            both = np.ix_(here, before)
            lag = right.lag_one[k]
            assert lag is not None
            sizes = [np.where(sd > 0, sd, 1.0) for sd in (deviations(right.P[k])[here], deviations(right.P[k - 1])[before])]
            with ctx.workprec(8000):
                right_lag = parts(lag, np.flatnonzero(here).tolist(), np.flatnonzero(before).tolist())
                difference = floats(balls(found.lag_one[k][both]) - right_lag)
            pairs.append((0.0, float((np.abs(difference) / np.outer(*sizes)).max())))
    return _judged(heard, pairs)


def likelihood(seed: Any) -> Outcome:
    """:func:`ctlabs.filtering.log_likelihood`, whose unit is 1, beyond the rounding of the number itself."""
    model = discrete(seed, unknown=False)
    z = data(model, seed)
    try:
        found = log_likelihood(model, z[1:])
    except Refusals as error:
        return Outcome(math.nan, refused=str(error))
    right = filtered(model, z)
    beyond = _heard(lambda: kalman_filter(model, z[1:])).beyond
    with ctx.workprec(400):
        error = abs(float(arb(found) - right.log_likelihood))
    return Outcome(max(0.0, error - float(np.spacing(abs(found)))), beyond=beyond)


def _singularly(model: DiscreteModel, seed: Any, verb: Callable[[Array], Any], *, smoothed: bool = False) -> Outcome:
    """A verb on the record of a :func:`singular` model."""
    z = data(model, seed, rows=12)
    heard = _heard(lambda: verb(z[1:]))
    if heard.refused:
        return Outcome(math.nan, refused=heard.refused)
    found, right = heard.found, filtered(model, z)
    parts = [(found.x, found.P, right.x, right.P)] if smoothed else [
        (found.x_minus, found.P_minus, right.x_minus, right.P_minus), (found.x_plus, found.P_plus, right.x_plus, right.P_plus)
    ]  # fmt: skip
    left = LEFT_BACK if smoothed else LEFT
    moved = [0.0] * len(z) if smoothed else [np.nansum(np.abs(K) * np.abs(row), axis=1) for K, row in zip(found.K, z, strict=True)]
    scale, pairs = np.sqrt(np.diag(model.Qd)), []
    for x, P, xs, Ps in parts:
        for k in range(len(z)):
            ahead = np.where(_lost(right.P_minus[k]), 0.0, deviations(right.P_minus[k]))
            terms = left * (np.abs(floats(xs[k])[:, 0]) + ahead + moved[k])
            pairs.append(within_rounding(x[k], P[k], xs[k], Ps[k], terms, scale))
    return _judged(heard, pairs)


def singular_filter(seed: Any) -> Outcome:
    """:func:`ctlabs.kalman_filter` of a :func:`singular` model."""
    model = singular(seed)
    return _singularly(model, seed, lambda z: kalman_filter(model, z))


def singular_smoother(seed: Any) -> Outcome:
    """:func:`ctlabs.smooth` of a :func:`singular` model."""
    model = singular(seed)
    return _singularly(model, seed, lambda z: smooth(model, z), smoothed=True)


class _Online(NamedTuple):
    """The rows of an online filter, one above another; it has no remarks."""

    x_minus: Array
    P_minus: Array
    x_plus: Array
    P_plus: Array
    K: Array
    remarks: tuple[str, ...] = ()


def singular_online(seed: Any) -> Outcome:
    """:class:`ctlabs.Filter` of a :func:`singular` model whose start is known."""
    model = singular(seed, unknown=False)

    def online(z: Array) -> _Online:
        fed = Filter(model)
        rows = [fed.estimate, *map(fed.step, z)]
        return _Online(*(np.array([getattr(row, name) for row in rows]) for name in _Online._fields[:5]))

    return _singularly(model, seed, online)


VERBS: dict[str, Callable[[Any], Outcome]] = {
    "steady.solve": steady_discrete,
    "bucy.steady": steady_continuous,
    "discretise": discretised,
    "filter_record": filter_,
    "smooth": smoother,
    "log_likelihood": likelihood,
    "singular: filter": singular_filter,
    "singular: smooth": singular_smoother,
    "singular: online": singular_online,
}
