r"""The filter over one record, in Joseph's form.

Of the elements that are measured at k (their rows of H, their part of R):

.. math:: S = HP^-H^T + R = CC^T,\ K = P^-H^TC^{-T}C^{-1},\
          P^+ = (I-KH)P^-(I-KH)^T + KRK^T,\ P^-_{k+1} = \Phi P^+\Phi^T + Q
"""

from __future__ import annotations

import numpy as np

from ctlabs.filtering.engines.common import (
    CANCELLED,
    EPS,
    SETTLED,
    System,
    alike,
    crossed_out,
    entry,
    fades,
    helper,
    mirror,
    motion,
    picked,
    similarity,
    triangle,
)
from ctlabs.filtering.engines.means import (
    LONG,
    Applied,
    Histories,
    coasted,
    estimated,
    means,
    moved,
    put,
    put_gains,
    told,
)
from ctlabs.linalg import rounding
from ctlabs.linalg.checks import Array
from ctlabs.linalg.compiled import kernel

#: As in :mod:`ctlabs.linalg.rounding`.
MARGIN = rounding.MARGIN
LOG_2PI = float(np.log(2 * np.pi))
#: The longest wait, in steps, from one look at the fixed point to the next.
PATIENCE = 4096

#: How a record ended: at its last row, or before, with the reason. PERFECT: where a perfect measurement is of what is known, or
#: N ≠ 0 beside a singular R. LOSING: where a part of a variance above :data:`LOST` may be rounding.
DONE, PERFECT, OVERFLOW, INDEFINITE, LOSING = 0, 1, 2, 3, 4
#: What rounding may leave of a variance before square roots are carried instead (:mod:`ctlabs.filtering.engines.roots`).
LOST = 1e-10
#: The least share of a variance that has digits enough in Joseph's form.
THIN = 1e-7


@helper
def predict(P: Array, Phi: Array, Q: Array, ahead: Array, work: Array, size: Array) -> bool:
    """ahead = ΦPΦᵀ + Q, with exact zeros where terms cancelled; whether it is finite."""
    n, suspect, finite = P.shape[0], False, True
    for i in range(n):
        for j in range(i + 1):
            ahead[i, j] = Q[i, j]
    similarity(Phi, P, ahead, work)
    mirror(ahead)
    for i in range(n):
        work[0, i] = np.sqrt(abs(P[i, i]))
    for i in range(n):
        s = np.sqrt(Q[i, i])
        for j in range(n):
            s += abs(Phi[i, j]) * work[0, j]
        size[i] = s
        suspect |= not ahead[i, i] > CANCELLED * s * s
        finite &= np.isfinite(ahead[i, i])
    if suspect and finite:
        for i in range(n):
            known = True
            for j in range(n):
                known &= abs(ahead[i, j]) <= CANCELLED * size[i] * size[j]
            work[0, i] = known
        for i in range(n):
            if work[0, i] > 0:
                crossed_out(ahead, i)
    return finite


@helper
def terms(P: Array, H: Array, R: Array, pick: Array, a: int, C: Array, size: Array) -> float:
    """The size of the terms of the variance that element a has when those before it are known; ``size`` (2, m) is filled."""
    for b in range(a + 1):
        s = 0.0
        for j in range(P.shape[0]):
            s += abs(H[pick[b], j]) * np.sqrt(max(P[j, j], 0.0))
        size[0, b] = np.sqrt(s * s + R[pick[b], pick[b]])
    total = size[0, a]
    for b in range(a - 1, -1, -1):  # the weights of those before it
        s = C[a, b]
        for c in range(b + 1, a):
            s -= C[c, b] * size[1, c]
        size[1, b] = s / C[b, b]
        total += abs(size[1, b]) * size[0, b]
    return total * total


@helper
def gain(
    P: Array, H: Array, R: Array, pick: Array, count: int, d: Array, S: Array, C: Array, Kt: Array, size: Array
) -> int:
    """S and its factor C of the elements picked (in the leading rows), Kᵀ (m, n); how it ended.

    ``size`` (3, m): room, and in its last row how much of the variance of each element may be rounding.
    INDEFINITE: S is not, or as far as rounding tells; PERFECT: an element without a noise of its own (d = 0) is known from
    what was before it, its variance being rounding of its own terms, as in :mod:`ctlabs.filtering.measured`.
    """
    n = P.shape[0]
    for a in range(count):
        for j in range(n):
            s = 0.0
            for h in range(n):
                s += H[pick[a], h] * P[h, j]
            Kt[a, j] = s
        for b in range(a + 1):
            s = R[pick[a], pick[b]]
            for j in range(n):
                s += Kt[a, j] * H[pick[b], j]
            S[a, b], S[b, a] = s, s
    for a in range(count):
        for b in range(a + 1):
            s = S[a, b]
            for c in range(b):
                s -= C[a, c] * C[b, c]
            if a > b:
                C[a, b] = s / C[b, b]
            else:
                lost = MARGIN * n * EPS * terms(P, H, R, pick, a, C, size)
                if d[a] == 0.0 and s <= 4 * lost:
                    return PERFECT
                if not s > lost:
                    return INDEFINITE
                size[2, a] = lost / s
                C[a, a] = np.sqrt(s)
    for a in range(count):
        for b in range(a):
            for j in range(n):
                Kt[a, j] -= C[a, b] * Kt[b, j]
        for j in range(n):
            Kt[a, j] /= C[a, a]
    for a in range(count - 1, -1, -1):
        for b in range(a + 1, count):
            for j in range(n):
                Kt[a, j] -= C[b, a] * Kt[b, j]
        for j in range(n):
            Kt[a, j] /= C[a, a]
    return DONE


@helper
def closed(Kt: Array, H: Array, pick: Array, count: int, B: Array) -> None:
    """B = I − KH."""
    for i in range(B.shape[0]):
        for j in range(B.shape[0]):
            B[i, j] = 1.0 if i == j else 0.0
        for a in range(count):
            for j in range(B.shape[0]):
                B[i, j] -= Kt[a, i] * H[pick[a], j]


@helper
def joseph(
    P: Array, R: Array, Kt: Array, B: Array, pick: Array, count: int, after: Array, work: Array, RKt: Array
) -> None:
    """after = (I−KH)P(I−KH)ᵀ + KRKᵀ."""
    n = P.shape[0]
    for a in range(count):
        for j in range(n):
            s = 0.0
            for b in range(count):
                s += R[pick[a], pick[b]] * Kt[b, j]
            RKt[a, j] = s
    for i in range(n):
        for j in range(i + 1):
            s = 0.0
            for a in range(count):
                s += Kt[a, i] * RKt[a, j]
            after[i, j] = s
    similarity(B, P, after, work)
    mirror(after)


@helper
def losing(P: Array, P_minus: Array, Kt: Array, H: Array, pick: Array, count: int, perfect: bool, size: Array) -> bool:
    """Whether the update leaves more rounding than :data:`LOST` in a variance of the innovation or of an estimate.

    Row i of I − KH is a difference, known to ε of the sum of (|I| + |K||H|)σ⁻. What a ``perfect`` measurement determined is
    zero to the bit, or is left to the roots to judge.
    """
    for a in range(count):
        if size[2, a] > LOST:
            return True
        size[0, a] = 0.0
        for j in range(P.shape[0]):
            size[0, a] += abs(H[pick[a], j]) * np.sqrt(max(P_minus[j, j], 0.0))
    for i in range(P.shape[0]):
        if perfect and P[i, i] == 0.0:
            for j in range(P.shape[0]):
                if P[i, j] != 0.0:
                    return True
            continue
        terms = np.sqrt(max(P_minus[i, i], 0.0))
        for a in range(count):
            terms += abs(Kt[a, i]) * size[0, a]
        if 2 * EPS * terms > LOST * np.sqrt(max(P[i, i], 0.0)):
            return True
    return False


@helper
def thin(P: Array, W: Array) -> bool:
    """Whether P is so much smaller along some direction than its elements say that their rounding, ε of them, may tell there.

    The pivots of its correlations are the shares of variances that the states before do not explain. In units of P no closed loop
    lets an error grow (APAᵀ ≤ P⁺), but there the rounding of one step is ε over the least share. One at the rounding level is none: P
    is singular by its structure.
    """
    n = P.shape[0]
    for i in range(n):
        for j in range(i + 1):
            W[i, j] = P[i, j]
    for c in range(n):
        if not W[c, c] > MARGIN * n * EPS * P[c, c]:
            continue
        if W[c, c] < THIN * P[c, c]:
            return True
        for i in range(c + 1, n):
            factor = W[i, c] / W[c, c]
            for j in range(c + 1, i + 1):
                W[i, j] -= factor * W[j, c]
    return False


@helper
def near(P: Array, before: Array) -> bool:
    """Whether one step changed P by less than the tolerance."""
    for i in range(P.shape[0]):
        for j in range(i + 1):
            if not abs(P[i, j] - before[i, j]) <= SETTLED * np.sqrt(P[i, i]) * np.sqrt(P[j, j]):
                return False
    return True


@helper
def settled(P: Array, before: Array, Phi: Array, B: Array, A: Array, X: Array, Y: Array, work: Array) -> bool:
    r"""Whether P is as near to its fixed point as :data:`SETTLED` says, in units of its standard deviations.

    A change Δ of P becomes AΔAᵀ in the next step, A = Φ(I−KH), up to terms in Δ². Near the fixed point a small Δ alone says little:
    where A is near the unit circle the steps are many.
    """
    n = P.shape[0]
    for i in range(n):
        for j in range(n):
            s = 0.0
            for h in range(n):
                s += Phi[i, h] * B[h, j]
            both = np.sqrt(P[i, i]) * np.sqrt(P[j, j])
            A[i, j] = s * (np.sqrt(P[j, j]) / np.sqrt(P[i, i])) if both > 0 else 0.0
            Y[i, j] = (P[i, j] - before[i, j]) / both if both > 0 else 0.0
    return fades(A, Y, X, work)


def filtered(
    system: System, x0: Array, P0: Array, z: Array, used: Array, begin: int, out: Histories
) -> tuple[int, int, float]:
    """Filter a record from the instant ``begin``, predicted as x0 and P0; how it ended, at which step, the log-likelihood.

    Where nothing but z and c varies, and P has come to its fixed point, the covariances are not computed again until
    other elements are measured than at the step before.
    """
    coupled, long = system.N if system.N.size else None, True if len(z) - begin >= LONG else None
    return forward(system, x0, P0, z, used, begin, out, coupled, long)


@kernel
def forward(
    system: System, x0: Array, P0: Array, z: Array, used: Array, begin: int, out: Histories,
    coupled: Array | None, long: bool | None
) -> tuple[int, int, float]:  # fmt: skip
    """:func:`filtered` with what a record needs; what it does not need is None, and is not compiled.

    ``coupled``: N · ``long``: for stretches that :func:`~ctlabs.filtering.engines.means.coasted` cuts into chunks
    """
    n, m, rows = x0.shape[0], z.shape[1], z.shape[0]
    keep = out.nis.shape[0] > 0
    constant = max(system.Phi.shape[0], system.Q.shape[0], system.H.shape[0], system.R.shape[0]) == 1
    at = means(x0, m, 1)
    P, P_minus, before, ahead = P0.copy(), P0.copy(), P0.copy(), P0.copy()
    S, C, Kt, RKt, B = np.empty((m, m)), np.empty((m, m)), np.empty((m, n)), np.empty((m, n)), np.empty((n, n))
    A, X, Y, work, size = np.empty((n, n)), np.empty((n, n)), np.empty((n, n)), np.empty((n, n)), np.empty(n)
    Phi_N, Q_N, M = np.empty((n, n)), np.empty((n, n)), np.zeros((n, m))
    L, d, pick, sizes = np.empty((m, m)), np.empty(m), np.empty(m, dtype=np.int64), np.empty((3, m))
    fixed, wait, look, half, total, count, perfect = False, 1, 0, 0.0, 0.0, 0, False
    k = begin
    while k < rows:
        if long is not None:  # noqa: SIM102  # numba leaves out what stands under this alone
            if fixed:
                led = system.Phi[0] if coupled is None else Phi_N
                mixed = M[:0] if coupled is None else M
                now = Applied(led, mixed, system.H[0], P_minus, P, Kt, S, C)
                k, total = coasted(k, now, system.c, half, pick, count, z, used, at, total, out)
                fixed = False
                if k == rows:
                    break
        same = k > begin and alike(used[k], used[k - 1])
        if k > begin:
            if coupled is None:
                Phi = entry(system.Phi, k - 1)
            else:
                if not (constant and k > begin + 1 and alike(used[k - 1], used[k - 2])):
                    count = picked(used[k - 1], pick)
                    motion(system, k - 1, pick, count, Phi_N, Q_N, M, L, d)
                Phi = Phi_N
            moved(Phi, system.c, k - 1, 0, 1, at)
            if coupled is not None:
                told(M, z, k - 1, 0, 1, pick, count, at)
        H, R = entry(system.H, k), entry(system.R, k)
        if not (fixed and same):
            if k > begin:
                if coupled is None:
                    finite = predict(P, Phi, entry(system.Q, k - 1), ahead, work, size)
                else:
                    finite = predict(P, Phi, Q_N, ahead, work, size)
                if not finite:
                    return OVERFLOW, k, np.nan
                for i in range(n):
                    if 0.0 < LOST * ahead[i, i] < MARGIN * n * EPS * size[i] * size[i]:
                        return LOSING, k, np.nan
                before, P_minus, ahead = P_minus, ahead, before
            count = picked(used[k], pick)
            if coupled is not None or not constant or not same:
                perfect = not triangle(R, L, d, pick, count)
                if perfect and coupled is not None:
                    return PERFECT, k, np.nan
            end = gain(P_minus, H, R, pick, count, d, S, C, Kt, sizes)
            if end != DONE:
                return end, k, np.nan
            closed(Kt, H, pick, count, B)
            joseph(P_minus, R, Kt, B, pick, count, P, work, RKt)
            if losing(P, P_minus, Kt, H, pick, count, perfect, sizes) or thin(P, work):
                return LOSING, k, np.nan
            half = 0.5 * count * LOG_2PI
            for a in range(count):
                half += np.log(C[a, a])
            if not (constant and same):
                fixed, wait, look = False, 1, 0
            elif k >= look and near(P_minus, before):
                fixed = settled(P_minus, before, Phi, B, A, X, Y, work)
                wait = min(2 * wait, PATIENCE)
                look = k + wait
        estimated(z, k, 0, 1, H, C, Kt, pick, count, at)
        total -= 0.5 * at.nis[0] + half
        if keep:
            put(k, 0, at, pick, count, out)
            put_gains(k, Applied(Phi_N, M, H, P_minus, P, Kt, S, C), pick, count, out)
        k += 1
    return DONE, rows, total
