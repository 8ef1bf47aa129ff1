r"""What later data say, backward over one record, in square roots.

With u the deviation of x_k from the estimate x̂⁺_k, all that is measured after k has, as a function of x_k, the likelihood
:math:`\exp(-\tfrac12\|Uu - y\|^2)`. One step back adds the rows of the measurement at k+1, and the disturbance between
is eliminated by Householder's reflections:

.. math:: \begin{bmatrix} I & 0 & 0\\ \bar UG & \bar U\Phi & \bar y\end{bmatrix} \to
          \begin{bmatrix} T & E & \cdot\\ 0 & U & y\end{bmatrix}, \qquad
          \bar U = \begin{bmatrix} U\\ R^{-1/2}H\end{bmatrix},\ Q = GG^T

No covariance is inverted, however singular P⁺ or Q are and however large P0 is (Bierman, *Factorization Methods for
Discrete Sequential Estimation*, 1977, chapter X, whose pseudo-epoch smoother starts from such an array).
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from ctlabs import compiled
from ctlabs._check import Array
from ctlabs.recursions.common import System, alike, entry, helper, motion, picked, root, triangle


class Backward(NamedTuple):
    """What the way back needs: Phi, G (steps or 1, n, n), rows R^(−1/2)H (steps+1, m, n), values R^(−1/2)ν (…, m, runs).

    Rows of elements that are not used are zero. ``shift`` (steps+1, n, runs) is x̂⁺ − x̂⁻; ``since`` (steps+1,) the
    instant from which on the same elements are used.
    """

    Phi: Array
    G: Array
    rows: Array
    values: Array
    shift: Array
    since: Array


@helper
def absorb(T: Array, B: Array, count: int, work: Array) -> None:
    """Reflect the rows B (p, columns) into T (n, columns), until the first ``count`` columns of B are zero.

    Those of T are upper triangular before and after. What is left in B's other columns is no longer tied to T's.
    """
    for j in range(count):
        square = 0.0
        for a in range(B.shape[0]):
            square += B[a, j] * B[a, j]
        if square == 0.0:
            continue
        norm = np.sqrt(T[j, j] * T[j, j] + square)
        pivot = -norm if T[j, j] > 0 else norm
        own = T[j, j] - pivot
        scale = 2 / (own * own + square)
        T[j, j] = pivot
        for c in range(j + 1, T.shape[1]):
            work[c] = own * T[j, c]
        for a in range(B.shape[0]):
            for c in range(j + 1, T.shape[1]):
                work[c] += B[a, j] * B[a, c]
        for c in range(j + 1, T.shape[1]):
            work[c] *= scale
            T[j, c] -= own * work[c]
        for a in range(B.shape[0]):
            for c in range(j + 1, T.shape[1]):
                B[a, c] -= B[a, j] * work[c]
            B[a, j] = 0.0


@helper
def earlier(
    Phi: Array, G: Array, rows: Array, values: Array, shift: Array, Uy: Array, T: Array, B: Array, work: Array
) -> None:
    """From what is measured after k+1 to what is measured after k, both as [U | y] about x̂⁺; T is left for :func:`back`.

    ``rows`` (m, n), ``values`` (m, columns): the measurement at k+1 · ``shift`` (n, columns): x̂⁺ − x̂⁻ at k+1.
    """
    n, m, columns = Phi.shape[0], rows.shape[0], values.shape[1]
    for i in range(n):
        for j in range(n):
            s, t = 0.0, 0.0
            for h in range(i, n):
                s += Uy[i, h] * G[h, j]
                t += Uy[i, h] * Phi[h, j]
            B[i, j], B[i, n + j] = s, t
        for c in range(columns):
            B[i, 2 * n + c] = Uy[i, n + c]
        for h in range(i, n):
            for c in range(columns):
                B[i, 2 * n + c] += Uy[i, h] * shift[h, c]
    for a in range(m):
        for j in range(n):
            s, t = 0.0, 0.0
            for h in range(n):
                s += rows[a, h] * G[h, j]
                t += rows[a, h] * Phi[h, j]
            B[n + a, j], B[n + a, n + j] = s, t
        for c in range(columns):
            B[n + a, 2 * n + c] = values[a, c]
    T[:] = 0.0
    for i in range(n):
        T[i, i] = 1.0
    absorb(T, B, n, work)
    Uy[:] = 0.0
    absorb(Uy, B[:, n:], n, work)


@helper
def back(Phi: Array, G: Array, T: Array, E: Array) -> None:
    """E = Φ − G T⁻¹(the next columns of T): how x_{k+1}, given all data, follows x_k."""
    n = Phi.shape[0]
    for j in range(n):
        for i in range(n - 1, -1, -1):
            s = T[i, n + j]
            for h in range(i + 1, n):
                s -= T[i, h] * E[h, j]
            E[i, j] = s / T[i, i]
        for i in range(n):
            T[i, n + j] = Phi[i, j]
            for h in range(n):
                T[i, n + j] -= G[i, h] * E[h, j]
    E[:] = T[:, n : 2 * n]


@helper
def meet(
    P_plus: Array,
    Uy: Array,
    first: int,
    x: Array,
    P: Array,
    T: Array,
    B: Array,
    L: Array,
    d: Array,
    work: Array,
    own: Array,
) -> None:
    """Add to x (n, runs), x̂⁺ before, what later data say: columns ``first``… of [U | y]; P (n, n) of the result."""
    n, runs = x.shape
    root(P_plus, L, d, own)
    T[:, : n + runs] = 0.0
    for i in range(n):
        T[i, i] = 1.0
        for j in range(n):
            s = 0.0
            for h in range(i, n):
                s += Uy[i, h] * L[h, j]
            B[i, j] = s
        for c in range(runs):
            B[i, n + c] = Uy[i, n + first + c]
    absorb(T[:, : n + runs], B[:n, : n + runs], n, work)
    for i in range(n):  # L ← L T⁻¹
        for j in range(n):
            s = L[i, j]
            for h in range(j):
                s -= L[i, h] * T[h, j]
            L[i, j] = s / T[j, j]
    for i in range(n):
        for h in range(n):
            for c in range(runs):
                x[i, c] += L[i, h] * T[h, n + c]
        for j in range(i + 1):
            s = 0.0
            for h in range(n):
                s += L[i, h] * L[j, h]
            P[i, j], P[j, i] = s, s


@numba.njit(nogil=True, error_model="numpy")
def prepare(system: System, used: Array, innovation: Array, out: Backward) -> bool:
    """Fill ``out`` but for its shift; False where a measurement is perfect."""
    n, m, runs, rows = system.Phi.shape[1], used.shape[1], innovation.shape[2], used.shape[0]
    L, d, pick, everything = np.empty((m, m)), np.empty(m), np.empty(m, dtype=np.int64), np.arange(n)
    M, Q, wide, variances, count = np.empty((n, m)), np.empty((n, n)), np.empty((n, n)), np.empty(n), 0
    constant = max(system.Phi.shape[0], system.Q.shape[0], system.H.shape[0], system.R.shape[0]) == 1
    for k in range(rows):
        same = k > 0 and alike(used[k], used[k - 1])
        out.since[k] = out.since[k - 1] if same and constant else k
        H, R = entry(system.H, k), entry(system.R, k)
        if not same or system.R.shape[0] > 1:
            count = picked(used[k], pick)
            if not triangle(R, L, d, pick, count):
                return False
        out.rows[k], out.values[k] = 0.0, 0.0
        for a in range(count):
            out.rows[k, a] = H[pick[a]]
            out.values[k, a] = innovation[k, pick[a]]
            for b in range(a):
                for j in range(n):
                    out.rows[k, a, j] -= L[a, b] * out.rows[k, b, j]
                for c in range(runs):
                    out.values[k, a, c] -= L[a, b] * out.values[k, b, c]
        for a in range(count):
            scale = 1 / np.sqrt(d[a])
            for j in range(n):
                out.rows[k, a, j] *= scale
            for c in range(runs):
                out.values[k, a, c] *= scale
        if k < out.G.shape[0] and k < rows - 1:
            if system.N.size > 0:
                motion(system, k, pick, count, out.Phi[k], Q, M, L, d)
                triangle(R, L, d, pick, count)
            else:
                Q[:] = entry(system.Q, k)
            root(Q, wide, variances, everything)
            out.G[k] = wide
    return True


@numba.njit(nogil=True, error_model="numpy")
def smooth(b: Backward, P_plus: Array, x: Array, P: Array, lag_one: Array) -> bool:
    """From x = x̂⁺, P = P⁺ to the estimates given the whole record, and cov(x_{k+1}, x_k) at k+1; False: overflow."""
    n, m, runs, last = x.shape[1], b.rows.shape[1], x.shape[2], x.shape[0] - 1
    Uy, T, B = np.zeros((n, n + runs)), np.empty((n, 2 * n + runs)), np.empty((n + m, 2 * n + runs))
    E, L, d, work, own = np.empty((n, n)), np.empty((n, n)), np.empty(n), np.empty(2 * n + runs), np.arange(n)
    for k in range(last - 1, -1, -1):
        Phi, G = entry(b.Phi, k), entry(b.G, k)
        earlier(Phi, G, b.rows[k + 1], b.values[k + 1], b.shift[k + 1], Uy, T, B, work)
        back(Phi, G, T, E)
        meet(P_plus[k], Uy, 0, x[k], P[k], T, B, L, d, work, own)
        for i in range(n):
            for j in range(n):
                s = 0.0
                for h in range(n):
                    s += E[i, h] * P[k, h, j]
                lag_one[k + 1, i, j] = s
    return bool(np.isfinite(P).all() and np.isfinite(x).all())


@numba.njit(nogil=True, error_model="numpy")
def windows(b: Backward, P_plus: Array, lag: int, width: int, x: Array, P: Array) -> bool:
    """From x = x̂⁺, P = P⁺ to the estimates of x_k given the record up to k + lag ≤ the last; False: overflow.

    Each window of ``lag`` steps goes back on its own. Up to ``width`` windows with the same matrices go together.
    """
    n, m, last = x.shape[1], b.rows.shape[1], x.shape[0] - 1
    Uy, T, B = np.empty((n, n + width)), np.empty((n, 2 * n + width)), np.empty((n + m, 2 * n + width))
    L, d, work, own = np.empty((n, n)), np.empty(n), np.empty(2 * n + width), np.arange(n)
    values, shift = np.empty((m, width)), np.empty((n, width))
    k = 0
    while k <= last - lag:
        count = 1
        while count < width and k + count <= last - lag and b.since[k + count + lag] <= k:
            count += 1
        Uy[:] = 0.0
        for i in range(k + lag - 1, k - 1, -1):
            for c in range(count):
                for a in range(m):
                    values[a, c] = b.values[i + 1 + c, a, 0]
                for a in range(n):
                    shift[a, c] = b.shift[i + 1 + c, a, 0]
            earlier(
                entry(b.Phi, i),
                entry(b.G, i),
                b.rows[i + 1],
                values[:, :count],
                shift[:, :count],
                Uy[:, : n + count],
                T[:, : 2 * n + count],
                B[:, : 2 * n + count],
                work,
            )
        for c in range(count):
            meet(P_plus[k + c], Uy, c, x[k + c], P[k + c], T, B, L, d, work, own)
        k += count
    return bool(np.isfinite(P).all() and np.isfinite(x).all())


for _kernel in (prepare, smooth, windows):
    compiled.enable(_kernel)
