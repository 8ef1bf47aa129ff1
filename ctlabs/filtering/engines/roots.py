r"""The filter over one record by square roots, for covariances of which Joseph's form would lose digits.

.. math:: \begin{bmatrix} R^{1/2} & HL\\ 0 & L\end{bmatrix}\Theta = \begin{bmatrix} C & 0\\ \bar K & L^+\end{bmatrix}, \qquad
          [\Phi L^+\ \ Q^{1/2}]\,\Theta = [L^-_{k+1}\ \ 0]

with orthogonal Θ; :math:`P = LL^T`, :math:`S = CC^T`, :math:`\hat x^+ = \hat x^- + \bar KC^{-1}\nu`. Where w and v correlate the motion
is found from the array before the update, in which no inverse of R stands beside what it takes from P:

.. math:: \begin{bmatrix} R^{1/2} & HL & 0\\ NR^{-T/2} & \Phi L & (Q-NR^{-1}N^T)^{1/2}\end{bmatrix}\Theta =
          \begin{bmatrix} C & 0 & 0\\ \cdot & L^-_{k+1} & 0\end{bmatrix}, \qquad
          \hat x^-_{k+1} = \Phi\hat x^+ + c + NS^{-1}\nu

A variance of 1e-12 of what it was keeps ten digits here, in Joseph's form four. Of 1e-18, or less, also a root has too few: that is
refused (``INDEFINITE``). What perfect measurements leave at the rounding level of its own terms is zero, and such a measurement of what
is known already is left out.

Source: Kailath, Sayed & Hassibi, *Linear Estimation* (2000), chapter 12.
"""

from __future__ import annotations

import numpy as np

from ctlabs.filtering.engines.common import (
    EPS,
    System,
    alike,
    copied,
    crossed_out,
    emptied,
    entry,
    helper,
    motion,
    picked,
    root,
    triangle,
)
from ctlabs.filtering.engines.forward import (
    DONE,
    INDEFINITE,
    LOG_2PI,
    MARGIN,
    OVERFLOW,
    PATIENCE,
    PERFECT,
    closed,
    near,
    settled,
    terms,
)
from ctlabs.filtering.engines.means import Applied, Histories, means, moved, put, put_gains, whitened
from ctlabs.linalg.checks import Array
from ctlabs.linalg.compiled import kernel

#: What rounding may leave of a standard deviation before the record is refused.
LEFT = 1e-8


@helper
def turned(W: Array, first: int, count: int, rows: int, columns: int) -> None:
    """W Θ: rows from ``first`` to ``count`` lower triangular, all ``rows`` taking part; Householder's reflections from the right."""
    for i in range(first, count):
        square, top = 0.0, 0.0
        for c in range(i, columns):
            top = max(top, abs(W[i, c]))
        if top == 0.0:
            continue
        for c in range(i, columns):
            square += (W[i, c] / top) ** 2
        norm = np.sqrt(square)  # in units of the largest: no square underflows
        for c in range(i, columns):
            W[i, c] /= top
        pivot = -norm if W[i, i] > 0 else norm
        own = W[i, i] - pivot
        scale = 1 / (norm * (norm + abs(W[i, i])))
        for r in range(i + 1, rows):
            s = W[r, i] * own
            for c in range(i + 1, columns):
                s += W[r, c] * W[i, c]
            s *= scale
            W[r, i] -= s * own
            for c in range(i + 1, columns):
                W[r, c] -= s * W[i, c]
        W[i, i] = pivot * top
        for c in range(i + 1, columns):
            W[i, c] = 0.0


@helper
def measured(W: Array, L: Array, H: Array, pick: Array, count: int, noise: Array, d: Array) -> None:
    """The rows [R½ | HL] of the elements picked."""
    n = L.shape[0]
    for a in range(count):
        for b in range(count):
            W[a, b] = noise[a, b] * np.sqrt(d[b]) if b <= a else 0.0
        for j in range(n):
            s = 0.0
            for h in range(n):
                s += H[pick[a], h] * L[h, j]
            W[a, count + j] = s


@helper
def squared(L: Array, P: Array) -> bool:
    """P = LLᵀ; whether it is finite."""
    n, finite = L.shape[0], True
    for i in range(n):
        for j in range(i + 1):
            s = 0.0
            for h in range(n):
                s += L[i, h] * L[j, h]
            P[i, j], P[j, i] = s, s
        finite &= np.isfinite(P[i, i])
    return finite


@helper
def led(W: Array, top: int, begin: int, Phi: Array, L: Array, G: Array) -> None:
    """The rows [ΦL | Q½] from row ``top`` and column ``begin`` on."""
    n = L.shape[0]
    for i in range(n):
        for j in range(n):
            s = 0.0
            for h in range(n):
                s += Phi[i, h] * L[h, j]
            W[top + i, begin + j] = s
            W[top + i, begin + n + j] = G[i, j]


@helper
def known(P: Array, W: Array, H: Array, R: Array, d: Array, pick: Array, count: int, sizes: Array) -> int:
    """The first element without a noise of its own (d = 0) whose innovation, given those before it, is rounding; −1 if none.

    ``W``: C in its first columns; ``sizes`` (2, m): room.
    """
    for a in range(count):
        if d[a] == 0.0:
            lost = MARGIN * P.shape[0] * EPS * np.sqrt(terms(P, H, R, pick, a, W, sizes))
            if abs(W[a, a]) <= lost:
                return a
    return -1


@helper
def beyond(
    P: Array, L: Array, P_minus: Array, W: Array, H: Array, R: Array, pick: Array, count: int, perfect: bool, row: Array, size: Array
) -> bool:
    """Whether the rounding of the roots before an update may be more than :data:`LEFT` of those after it, or of C.

    A root at the rounding level of its terms after a ``perfect`` measurement becomes zero, and as long as it is on its way there it is no
    loss: nothing but such measurements made it small. ``W``: C and K̄ = P⁻HᵀC⁻ᵀ in its first columns, so that the gain is K̄C⁻¹;
    ``row`` (m,), ``size`` (n,): room.
    """
    n = P.shape[0]
    for i in range(n):
        size[i] = np.sqrt(P_minus[i, i])
    for a in range(count):
        terms = 0.0
        for j in range(n):
            terms += abs(H[pick[a], j]) * size[j]
        if EPS * terms > LEFT * abs(W[a, a]):
            return True
    for i in range(n):
        terms = size[i]
        for a in range(count - 1, -1, -1):
            row[a] = W[count + i, a]
            for b in range(a + 1, count):
                row[a] -= row[b] * W[b, a]
            row[a] /= W[a, a]
            for j in range(n):
                terms += abs(row[a]) * abs(H[pick[a], j]) * size[j]
        if EPS * terms <= LEFT * np.sqrt(P[i, i]):
            continue
        noise = 0.0
        for a in range(count):
            for b in range(count):
                noise += abs(row[a] * R[pick[a], pick[b]] * row[b])
        if perfect and np.sqrt(P[i, i]) <= MARGIN * n * EPS * terms:
            crossed_out(P, i)
            for j in range(n):
                L[i, j] = 0.0
        elif not perfect or 4 * noise > P[i, i]:
            return True
    return False


@helper
def ahead(L: Array, Phi: Array, G: Array, W: Array) -> None:
    """L ← a root of ΦLLᵀΦᵀ + GGᵀ."""
    n = L.shape[0]
    emptied(W, 0.0)
    led(W, 0, 0, Phi, L, G)
    turned(W, 0, n, n, 2 * n)
    for i in range(n):
        for j in range(n):
            L[i, j] = W[i, j]


@helper
def told(
    L: Array, P_minus: Array, H: Array, R: Array, alone: bool, used: Array, pick: Array, noise: Array, d: Array, W: Array, sizes: Array
) -> int:
    """The array after an update with the elements ``used``, in W: C, K̄ and L⁺; how many they are, or −1.

    Perfect measurements of what is known are taken out of ``used``. There may be perfect ones where w and v are ``alone``, otherwise
    −1. ``noise``, ``d``: R's factors; ``sizes`` (2, m): room.
    """
    n, count = L.shape[0], picked(used, pick)
    while count > 0:
        perfect = not triangle(R, noise, d, pick, count)
        if perfect and not alone:
            return -1
        emptied(W, 0.0)
        measured(W, L, H, pick, count, noise, d)
        for i in range(n):
            for j in range(n):
                W[count + i, count + j] = L[i, j]
        turned(W, 0, count, count + n, count + n)
        a = known(P_minus, W, H, R, d, pick, count, sizes) if perfect else -1
        if a < 0:
            break
        used[pick[a]] = False
        count = picked(used, pick)
    return count


@helper
def after(
    L: Array, P: Array, P_minus: Array, W: Array, H: Array, R: Array, d: Array, pick: Array, count: int, S: Array, row: Array, size: Array
) -> int:
    """L⁺, P⁺ and S (of the elements picked) out of the array; how it ended. ``row`` (m,), ``size`` (n,): room."""
    perfect = False
    for a in range(count):
        if W[a, a] == 0.0:
            return INDEFINITE
        perfect |= d[a] == 0.0
        for b in range(a + 1):
            s = 0.0
            for c in range(b + 1):
                s += W[a, c] * W[b, c]
            S[a, b], S[b, a] = s, s
    for i in range(L.shape[0]):
        for j in range(L.shape[0]):
            L[i, j] = W[count + i, count + j]
    if not squared(L, P):
        return OVERFLOW
    return INDEFINITE if beyond(P, L, P_minus, W, H, R, pick, count, perfect, row, size) else DONE


@helper
def gains(W: Array, n: int, count: int, Kt: Array) -> None:
    """Kᵀ = (K̄C⁻¹)ᵀ, (count, n) of ``Kt``."""
    for i in range(n):
        for a in range(count - 1, -1, -1):
            s = W[count + i, a]
            for b in range(a + 1, count):
                s -= Kt[b, i] * W[b, a]
            Kt[a, i] = s / W[a, a]


@kernel
def forward(
    system: System, x0: Array, L0: Array, z: Array, used: Array, begin: int, out: Histories
) -> tuple[int, int, float]:
    """As :func:`ctlabs.filtering.engines.forward.forward`, from a root of P0.

    Perfect measurements of what is known are taken out of ``used``; N ≠ 0 beside one ends it (``PERFECT``). At the fixed point of a
    constant model the roots are not computed again until other elements are measured.
    """
    n, m, rows = x0.shape[0], z.shape[1], z.shape[0]
    keep, correlated = out.nis.shape[0] > 0, system.N.size > 0
    constant = not correlated and max(system.Phi.shape[0], system.Q.shape[0], system.H.shape[0], system.R.shape[0]) == 1
    at, row = means(x0, m, 1), np.empty(m)
    x, x_minus, e = at.x, at.x_minus, at.e  # numba loses an addition in place to an element of at.x
    L, before, P, P_minus = L0.copy(), L0.copy(), np.empty((n, n)), np.empty((n, n))
    W, S, G, rest, left = np.empty((m + n, m + 2 * n)), np.empty((m, m)), np.zeros((n, n)), np.empty((n, n)), np.empty(n)
    Phi_N, Q_N, M, N_S = np.empty((n, n)), np.empty((n, n)), np.zeros((n, m)), np.zeros(n)
    Kt, B, A, X, Y, earlier = np.empty((m, n)), np.empty((n, n)), np.empty((n, n)), np.empty((n, n)), np.empty((n, n)), np.empty((n, n))
    last, fixed, wait, look, half = np.empty((n, n)), False, 1, 0, 0.0
    noise, d, pick, count, total = np.empty((m, m)), np.empty(m), np.empty(m, dtype=np.int64), 0, 0.0
    sizes = np.empty((2, m))
    for k in range(begin, rows):
        same = k > begin and alike(used[k], used[k - 1])
        again = not (fixed and same)
        if k > begin:
            Phi, Q = entry(system.Phi, k - 1), entry(system.Q, k - 1)
            coupled = correlated and count > 0
            if coupled:
                emptied(W, 0.0)
                H = entry(system.H, k - 1)
                motion(system, k - 1, pick, count, Phi_N, Q_N, M, noise, d)
                root(Q_N, G, left, rest)
                measured(W, before, H, pick, count, noise, d)
                for i in range(n):
                    for b in range(count):
                        s = 0.0
                        for a in range(b, count):
                            s += M[i, pick[a]] * W[a, b]
                        W[count + i, b] = s
                led(W, count, count, Phi, before, G)
                turned(W, 0, count + n, count + n, count + 2 * n)
                for i in range(n):
                    for j in range(n):
                        L[i, j] = W[count + i, count + j]
            elif again:
                if k == begin + 1 or correlated or system.Q.shape[0] > 1:
                    root(Q, G, left, rest)
                ahead(L, Phi, G, W)
            moved(Phi, system.c, k - 1, 0, 1, at)
            if coupled:
                for i in range(n):
                    x_minus[i, 0] += N_S[i]
        H, R = entry(system.H, k), entry(system.R, k)
        copied(x_minus, x)
        if again:
            copied(L, before)
            copied(P_minus, earlier)
            copied(P, last)
            if not squared(L, P_minus):
                return OVERFLOW, k, np.nan
            copied(P_minus, P)
            count = told(L, P_minus, H, R, not correlated, used[k], pick, noise, d, W, sizes)
            if count < 0:
                return PERFECT, k, np.nan
            if count > 0:
                end = after(L, P, P_minus, W, H, R, d, pick, count, S, row, left)
                if end != DONE:
                    return end, k, np.nan
                gains(W, n, count, Kt)
            half = 0.5 * count * LOG_2PI
            for a in range(count):
                half += np.log(abs(W[a, a]))
            if not (constant and same):
                fixed, wait, look = False, 1, 0
            elif k >= look and near(P_minus, earlier) and near(P, last):  # what is left of P may be small beside what it was before
                closed(Kt, H, pick, count, B)
                fixed = settled(P_minus, earlier, Phi, B, A, X, Y, rest)
                wait = min(2 * wait, PATIENCE)
                look = k + wait
        if count > 0:
            whitened(z, k, 0, 1, H, W, pick, count, at)
            total -= 0.5 * at.nis[0] + half
            for i in range(n):
                for a in range(count):
                    x[i, 0] += W[count + i, a] * e[a, 0]
            if correlated:  # N S⁻¹ν
                for a in range(count - 1, -1, -1):
                    for b in range(a + 1, count):
                        e[a, 0] -= W[b, a] * e[b, 0]
                    e[a, 0] /= W[a, a]
                for i in range(n):
                    N_S[i] = 0.0
                    for a in range(count):
                        N_S[i] += system.N[i, pick[a]] * e[a, 0]
        if keep:
            put(k, 0, at, pick, count, out)
            put_gains(k, Applied(Phi_N, M, H, P_minus, P, Kt, S, S), pick, count, out)
    return DONE, rows, total
