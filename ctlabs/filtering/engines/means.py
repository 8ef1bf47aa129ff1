r"""The estimates of one record: sequentially beside the covariances, or, once these are fixed, several stretches of it side by side.

With fixed gains the filter is linear, :math:`\hat x_k = A\hat x_{k-1} + \dots` with A = (I−KH)Φ. A stretch of the record is cut into
:data:`LANES` chunks of equal length, which step together; the compiler makes vectors of them, whatever n and m are. Where A forgets, the
estimate before a chunk is that of its predecessor begun some steps before, from zero: so many that a power of A, in units of the
standard deviations, is below :data:`FORGOTTEN`. Where it forgets too slowly, the predecessor is begun from zero at its own beginning,
and what it began with is added, carried on by a power of A. Either way the end of every chunk is compared with the beginning of the
next: where they differ by more than rounding, the stretch is done again in order.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from ctlabs.filtering.engines.common import EPS, alike, copied, helper
from ctlabs.linalg.checks import Array

#: Chunks that step side by side.
LANES = 16
#: Shorter chunks are not worth it; a stretch that is cut has at least so many instants.
SHORT = 16
LONG = SHORT * LANES
#: What is left of a start when a chunk has forgotten it, beside its own size: estimates may be 1e8 standard deviations from zero.
FORGOTTEN = 1e-24
#: Ends and beginnings of chunks agree to this part of the standard deviations, beside the rounding of the estimates themselves.
SEAM = 1e-13
#: Where the rounding of an estimate alone is more than this part of its standard deviation, the order of the sums tells.
LEFT = 1e-8


class Histories(NamedTuple):
    """What the filter leaves: one entry for each instant, or no entry at all where only the likelihood is asked for."""

    x_minus: Array
    x_plus: Array
    P_minus: Array
    P_plus: Array
    K: Array
    innovation: Array
    S: Array
    nis: Array


class Means(NamedTuple):
    """The estimates of an instant, in so many lanes: x_minus, x (n, lanes), nu, e (m, lanes), nis (lanes,)."""

    x_minus: Array
    x: Array
    nu: Array
    e: Array
    nis: Array


class Applied(NamedTuple):
    """Covariances and gains of an instant.

    Phi (n, n), with M (n, m) where w and v correlate, else empty: what moves the state to it · H (m, n) · P_minus, P (n, n) · of the
    elements used, in leading rows: Kt = Kᵀ (m, n), S and its factor C (m, m)
    """

    Phi: Array
    M: Array
    H: Array
    P_minus: Array
    P: Array
    Kt: Array
    S: Array
    C: Array


@helper
def means(x: Array, m: int, lanes: int) -> Means:
    """Room, with x in the first lane."""
    n = x.shape[0]
    room = Means(np.zeros((n, lanes)), np.zeros((n, lanes)), np.zeros((m, lanes)), np.zeros((m, lanes)), np.zeros(lanes))
    for i in range(n):
        room.x[i, 0] = x[i]
        room.x_minus[i, 0] = x[i]
    return room


@partial(helper, inline="always")
def put(k: int, lane: int, at: Means, pick: Array, count: int, out: Histories) -> None:
    """Store the estimates of an instant."""
    for i in range(at.x.shape[0]):
        out.x_minus[k, i], out.x_plus[k, i] = at.x_minus[i, lane], at.x[i, lane]
    if count < at.nu.shape[0]:
        for a in range(at.nu.shape[0]):
            out.innovation[k, a] = np.nan
    for a in range(count):
        out.innovation[k, pick[a]] = at.nu[a, lane]
    out.nis[k] = at.nis[lane] if count > 0 else np.nan


@partial(helper, inline="always")
def put_gains(k: int, g: Applied, pick: Array, count: int, out: Histories) -> None:
    """Store the covariances and gains of an instant."""
    n, m = g.P.shape[0], g.S.shape[0]
    for i in range(n):
        for j in range(n):
            out.P_minus[k, i, j], out.P_plus[k, i, j] = g.P_minus[i, j], g.P[i, j]
    if count < m:
        for a in range(m):
            for i in range(n):
                out.K[k, i, a] = 0.0
            for b in range(m):
                out.S[k, a, b] = np.inf if a == b else 0.0
    for a in range(count):
        for i in range(n):
            out.K[k, i, pick[a]] = g.Kt[a, i]
        for b in range(count):
            out.S[k, pick[a], pick[b]] = g.S[a, b]


@partial(helper, forceinline=True)
def added(A: Array, i: int, count: int, sign: float, x: Array, lanes: int, out: Array, o: int) -> None:
    """Row o of ``out`` plus or minus the first elements of row i of A times those of x, four at a time: few stores, long vectors."""
    for j in range(0, count, 4):
        q, r, s = min(j + 1, count - 1), min(j + 2, count - 1), min(j + 3, count - 1)
        a, b, c, d = sign * A[i, j], sign * A[i, q], sign * A[i, r], sign * A[i, s]
        if j + 1 >= count:
            b = 0.0
        if j + 2 >= count:
            c = 0.0
        if j + 3 >= count:
            d = 0.0
        for lane in range(lanes):
            out[o, lane] += a * x[j, lane] + b * x[q, lane] + c * x[r, lane] + d * x[s, lane]


@partial(helper, forceinline=True)
def moved(Phi: Array, c: Array, k: int, apart: int, lanes: int, at: Means) -> None:
    """x̂⁻ = Φx̂ + c from the instants k, k + apart, … on; c (steps or 1 or 0, n)."""
    n = at.x.shape[0]
    for i in range(n):
        for lane in range(lanes):
            at.x_minus[i, lane] = 0.0
        if c.shape[0] > 0:
            for lane in range(lanes):
                at.x_minus[i, lane] = c[k + lane * apart if c.shape[0] > 1 else 0, i]
        added(Phi, i, n, 1.0, at.x, lanes, at.x_minus, i)


@partial(helper, forceinline=True)
def told(M: Array, z: Array, k: int, apart: int, lanes: int, pick: Array, count: int, at: Means) -> None:
    """x̂⁻ + Mz of the instants k, k + apart, …: what these measurements tell of the disturbance after them."""
    x_minus = at.x_minus
    for i in range(x_minus.shape[0]):
        for a in range(count):
            for lane in range(lanes):
                x_minus[i, lane] += M[i, pick[a]] * z[k + lane * apart, pick[a]]


@partial(helper, forceinline=True)
def whitened(z: Array, k: int, apart: int, lanes: int, H: Array, C: Array, pick: Array, count: int, at: Means) -> None:
    """ν = z − Hx̂⁻ of the elements picked, e = C⁻¹ν with CCᵀ = S in the leading part of C, and nis = eᵀe = νᵀS⁻¹ν."""
    nu, e, nis = at.nu, at.e, at.nis
    for lane in range(lanes):
        nis[lane] = 0.0
    for a in range(count):
        for lane in range(lanes):
            nu[a, lane] = z[k + lane * apart, pick[a]]
        added(H, pick[a], at.x.shape[0], -1.0, at.x_minus, lanes, nu, a)
        for lane in range(lanes):
            e[a, lane] = nu[a, lane]
        added(C, a, a, -1.0, e, lanes, e, a)
        for lane in range(lanes):
            e[a, lane] /= C[a, a]
            nis[lane] += e[a, lane] * e[a, lane]


@partial(helper, forceinline=True)
def estimated(
    z: Array, k: int, apart: int, lanes: int, H: Array, C: Array, Kt: Array, pick: Array, count: int, at: Means
) -> None:  # fmt: skip
    """x̂ = x̂⁻ + Kν of the elements picked, and what :func:`whitened` gives."""
    whitened(z, k, apart, lanes, H, C, pick, count, at)
    for i in range(at.x.shape[0]):
        for lane in range(lanes):
            at.x[i, lane] = at.x_minus[i, lane]
        added(Kt.T, i, count, 1.0, at.nu, lanes, at.x, i)


@partial(helper, forceinline=True)
def stepped(k: int, apart: int, lanes: int, g: Applied, c: Array, pick: Array, count: int, z: Array, at: Means) -> None:
    """From the instants before k, k + apart, … to these."""
    moved(g.Phi, c, k - 1, apart, lanes, at)
    if g.M.shape[0] > 0:
        told(g.M, z, k - 1, apart, lanes, pick, count, at)
    estimated(z, k, apart, lanes, g.H, g.C, g.Kt, pick, count, at)


@helper
def product(A: Array, B: Array, out: Array) -> None:
    """out = AB, square matrices."""
    for i in range(A.shape[0]):
        for j in range(A.shape[0]):
            s = 0.0
            for h in range(A.shape[0]):
                s += A[i, h] * B[h, j]
            out[i, j] = s


@helper
def loop(g: Applied, pick: Array, count: int, A: Array) -> None:
    """A = (I − KH)Φ."""
    n = A.shape[0]
    for i in range(n):
        for j in range(n):
            A[i, j] = g.Phi[i, j]
    for a in range(count):
        for j in range(n):
            s = 0.0
            for h in range(n):
                s += g.H[pick[a], h] * g.Phi[h, j]
            for i in range(n):
                A[i, j] -= g.Kt[a, i] * s


@helper
def size(A: Array, P: Array) -> float:
    """The largest sum of magnitudes of a row of A in units of the standard deviations; infinite where one of these is zero."""
    most = 0.0
    for i in range(A.shape[0]):
        s = 0.0
        for j in range(A.shape[0]):
            s += abs(A[i, j]) * np.sqrt(P[j, j])
        if not (P[i, i] > 0.0 and s < np.inf):
            return np.inf
        most = max(most, s / np.sqrt(P[i, i]))
    return most


@helper
def memory(A: Array, P: Array, length: int, power: Array, square: Array, work: Array) -> int:
    """How many steps A takes to forget, and A^length in ``power``; or ``length`` where that is not enough."""
    n, done, bit = A.shape[0], 0, 1
    copied(A, square)
    for i in range(n):
        for j in range(n):
            power[i, j] = 1.0 if i == j else 0.0
    while bit <= length:
        if size(square, P) < FORGOTTEN:
            return bit
        if length & bit:
            product(square, power, work)
            copied(work, power)
            done += bit
        product(square, square, work)
        copied(work, square)
        bit *= 2
    return length


@helper
def side_by_side(
    k: int, length: int, g: Applied, c: Array, half: float, pick: Array, count: int, z: Array, x: Array, out: Histories
) -> tuple[bool, float]:  # fmt: skip
    """The instants k … k + LANES·length − 1 in chunks; whether they fit, and the log-likelihood. x (n, 1) is moved to the end if so."""
    n = x.shape[0]
    A, power, square, work, starts = np.empty((n, n)), np.empty((n, n)), np.empty((n, n)), np.empty((n, n)), np.empty((n, LANES))
    loop(g, pick, count, A)
    before = memory(A, g.P, length, power, square, work)
    at, total = means(np.zeros(n), z.shape[1], LANES), 0.0
    for t in range(k + length - before, k + length):
        stepped(t, length, LANES, g, c, pick, count, z, at)
    for i in range(n):
        starts[i, 0] = x[i, 0]
    for lane in range(1, LANES):
        for i in range(n):
            s = at.x[i, lane - 1]
            if before == length:
                for j in range(n):
                    s += power[i, j] * starts[j, lane - 1]
            starts[i, lane] = s
    copied(starts, at.x)
    for t in range(k, k + length):
        stepped(t, length, LANES, g, c, pick, count, z, at)
        for lane in range(LANES):
            total -= 0.5 * at.nis[lane]
        if out.nis.shape[0] > 0:
            for lane in range(LANES):
                put(t + lane * length, lane, at, pick, count, out)
    for lane in range(LANES - 1):
        for i in range(n):
            sd, rounded = np.sqrt(max(g.P[i, i], 0.0)), EPS * max(abs(at.x[i, lane]), abs(at.x_minus[i, lane]))
            if not abs(at.x[i, lane] - starts[i, lane + 1]) <= SEAM * sd + 16 * n * rounded or (sd > 0.0 and rounded > LEFT * sd):
                return False, 0.0
    for i in range(n):
        x[i, 0] = at.x[i, LANES - 1]
    return True, total - LANES * length * half


@helper
def coasted(
    k: int, g: Applied, c: Array, half: float, pick: Array, count: int, z: Array, used: Array, at: Means, total: float, out: Histories
) -> tuple[int, float]:
    """From the instant k on with fixed covariances, as long as the same elements are measured: where that ends, and the log-likelihood."""
    stop = k
    while stop < z.shape[0] and alike(used[stop], used[k - 1]):
        stop += 1
    if out.nis.shape[0] > 0:
        for i in range(k, stop):
            put_gains(i, g, pick, count, out)
    if stop - k >= LONG:
        length = (stop - k) // LANES
        fits, gained = side_by_side(k, length, g, c, half, pick, count, z, at.x, out)
        if fits:
            k, total = k + LANES * length, total + gained
    while k < stop:
        stepped(k, 0, 1, g, c, pick, count, z, at)
        total -= 0.5 * at.nis[0] + half
        if out.nis.shape[0] > 0:
            put(k, 0, at, pick, count, out)
        k += 1
    return k, total
