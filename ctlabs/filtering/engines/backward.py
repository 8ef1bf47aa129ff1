r"""What later data say, backward over one record, in square roots and in constraints.

With u the deviation of x_k from the estimate x̂⁺_k, all that is measured after k has, as a function of x_k, the likelihood
:math:`\exp(-\tfrac12\|Uu - y\|^2)` where Cu = c: rows [U | y] of unit noise, and rows [C | c] without noise, from perfect
measurements. One step back adds the rows of the measurement at k+1, and the disturbance between is eliminated:

.. math:: \begin{bmatrix} I & 0 & 0\\ \bar UG & \bar U\Phi & \bar y\\ \bar CG & \bar C\Phi & \bar c\end{bmatrix} \to
          \begin{bmatrix} T & E & \cdot\\ 0 & U & y\\ 0 & C & c\end{bmatrix}, \qquad
          \bar U = \begin{bmatrix} U\\ R^{-1/2}H\end{bmatrix},\ Q = GG^T

by Householder's reflections; a row without noise, whose weight is infinite, by Gauss's elimination, which is their limit. At k all
of it meets what was measured before, :math:`x = \hat x^+ + L\xi`: one row of unit noise for each element of ξ, and none for one of which
nothing is known. No covariance is inverted or subtracted, however singular P⁺ or Q are and however large P0 is.

Rows of very different size are triangularised with the largest first, so that rounding in it does not touch the small ones.

Source: Bierman, *Factorization Methods for Discrete Sequential Estimation* (1977), chapter X, whose pseudo-epoch smoother starts
from such an array; Cox & Higham, BIT 38 (1998) 34–50 (order of the rows); Golub & Van Loan, *Matrix Computations* (4th ed.), section
6.2 (least squares with constraints, infinite weights).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ctlabs.filtering.engines.common import (
    EPS,
    System,
    alike,
    all_finite,
    copied,
    crossed_out,
    emptied,
    entry,
    fades,
    helper,
    picked,
    root,
    triangle,
)
from ctlabs.linalg.checks import Array
from ctlabs.linalg.compiled import kernel

#: Rows of an array: none, one with unit noise, one without noise.
NONE, NOISY, EXACT = 0, 1, 2
#: The longest wait, in steps, from one look at whether the way back rests to the next.
PATIENCE = 4096
#: A row that says so many times more than is known anyway says it without noise: its square would overflow.
CERTAIN = 1e60


class Backward(NamedTuple):
    """What the way back needs: Phi, G (steps or 1, n, n), rows R^(−1/2)H (steps+1, m, n), values R^(−1/2)ν (…, m, runs).

    ``kind`` (steps+1, m): that of the rows, which are H and ν themselves where a measurement is perfect. ``shift``
    (steps+1, n, runs) is x̂⁺ − x̂⁻; ``since`` (steps+1,) the instant from which on the same elements are used.
    """

    Phi: Array
    G: Array
    rows: Array
    values: Array
    kind: Array
    shift: Array
    since: Array


class Prior(NamedTuple):
    """What was measured up to each instant: P (steps+1, n, n), and of the first instants its root and columns of x = x̂ + e + Aδ.

    ``L`` (rows, n, n) · ``A`` (rows, n, n) first the ``unknown`` (rows,) columns, then those with δ ~ N(0, I), then zeros;
    ``later`` (steps+1,), how many unknown columns are determined after each instant.
    """

    P: Array
    L: Array
    A: Array
    unknown: Array
    later: Array


class Work(NamedTuple):
    """Room for the arrays: W and the sizes of its exact rows' terms, what :func:`reduce` says of its rows and columns, and for a root."""

    W: Array
    terms: Array
    kind: Array
    taken: Array
    pivot: Array
    order: Array
    units: Array
    vector: Array
    rest: Array


@helper
def room(n: int, m: int, runs: int) -> Work:
    """Arrays for n states, m elements and ``runs`` right-hand sides."""
    rows, columns = 3 * n + m, 3 * n
    return Work(
        np.zeros((rows, columns + runs)),
        np.zeros((rows, columns)),
        np.zeros(rows, dtype=np.int64),
        np.zeros(rows, dtype=np.bool_),
        np.zeros(columns, dtype=np.int64),
        np.zeros(columns, dtype=np.int64),
        np.ones(columns),
        np.zeros(columns + runs),
        np.zeros((n, n)),
    )


@helper
def swap(w: Work, a: int, b: int) -> None:
    """Exchange two columns."""
    if a == b:
        return
    for i in range(w.W.shape[0]):
        w.W[i, a], w.W[i, b] = w.W[i, b], w.W[i, a]
        w.terms[i, a], w.terms[i, b] = w.terms[i, b], w.terms[i, a]
    w.order[a], w.order[b] = w.order[b], w.order[a]
    w.units[a], w.units[b] = w.units[b], w.units[a]


@helper
def constrain(w: Work, r: int, j: int, unknowns: int, end: int) -> None:
    """Eliminate unknown j from all rows that are left by the exact row r; what rounding leaves of exact rows is zero."""
    for i in range(w.W.shape[0]):
        if w.taken[i] or w.kind[i] == NONE or i == r or w.W[i, j] == 0.0:
            continue
        factor = w.W[i, j] / w.W[r, j]
        w.W[i, j] = 0.0
        for c in range(j + 1, end):
            w.W[i, c] -= factor * w.W[r, c]
        if w.kind[i] == EXACT:
            for c in range(j + 1, unknowns):
                w.terms[i, c] += abs(factor) * w.terms[r, c]
                if abs(w.W[i, c]) <= 16 * unknowns * EPS * w.terms[i, c]:
                    w.W[i, c] = 0.0


@helper
def reflect(w: Work, j: int, end: int) -> int:
    """Reflect the noisy rows that are left so that unknown j stays in one of them, the largest; which one, or −1."""
    p, top, square, count = -1, 0.0, 0.0, 0
    for i in range(w.W.shape[0]):
        if w.kind[i] == NOISY and not w.taken[i] and abs(w.W[i, j]) > top:
            p, top = i, abs(w.W[i, j])
    if p < 0:
        return p
    for i in range(w.W.shape[0]):  # in units of the largest: squares of what a mode left after ten steps may underflow
        if w.kind[i] == NOISY and not w.taken[i] and w.W[i, j] != 0.0:
            square += (w.W[i, j] / top) ** 2
            count += 1
    if count == 1:
        return p
    norm = np.sqrt(square)
    own = 1 + norm if w.W[p, j] > 0 else -1 - norm
    scale = 1 / (norm * (norm + 1))
    for c in range(j + 1, end):
        w.vector[c] = own * w.W[p, c]
    for i in range(w.W.shape[0]):
        if w.kind[i] == NOISY and not w.taken[i] and i != p and w.W[i, j] != 0.0:
            w.W[i, j] /= top
            for c in range(j + 1, end):
                w.vector[c] += w.W[i, j] * w.W[i, c]
    for c in range(j + 1, end):
        w.vector[c] *= scale
        w.W[p, c] -= own * w.vector[c]
    for i in range(w.W.shape[0]):
        if w.kind[i] == NOISY and not w.taken[i] and i != p and w.W[i, j] != 0.0:
            for c in range(j + 1, end):
                w.W[i, c] -= w.W[i, j] * w.vector[c]
            w.W[i, j] = 0.0
    w.W[p, j] = -norm * top if own > 0 else norm * top
    return p


@helper
def foremost(w: Work, j: int, last: int) -> int:
    """The column from j to ``last`` of which the noisy rows that are left say most, in its own units."""
    best, most = j, 0.0
    for c in range(j, last):
        square = 0.0
        for i in range(w.W.shape[0]):
            if w.kind[i] == NOISY and not w.taken[i]:
                square += w.W[i, c] * w.W[i, c]
        if square * w.units[c] * w.units[c] > most:
            best, most = c, square * w.units[c] * w.units[c]
    return best


@helper
def reduce(w: Work, first: int, last: int, count: int, unknowns: int, end: int, choose: bool) -> int:
    """Triangularise the columns from ``first`` to ``last`` of [unknowns | right-hand sides] (``end`` columns in all).

    The row that keeps column j is ``pivot[j]``, or −1; columns are exchanged as ``order`` tells. ``choose``: no more than ``count``
    columns have rows, which come first. Returned is how many have one.
    """
    j = first
    for r in range(w.W.shape[0]):
        if w.kind[r] == EXACT and not w.taken[r] and j < first + count:
            best, most = -1, 0.0
            for c in range(j, last):
                if abs(w.W[r, c]) * w.units[c] > most:
                    best, most = c, abs(w.W[r, c]) * w.units[c]
            if best >= 0:
                swap(w, j, best)
                constrain(w, r, j, unknowns, end)
                w.taken[r], w.pivot[j] = True, r
                j += 1
    while j < first + count:
        if choose:
            swap(w, j, foremost(w, j, last))
        p = reflect(w, j, end)
        w.pivot[j] = p
        if p >= 0:
            w.taken[p] = True
        elif choose:
            break
        j += 1
    return j - first


@helper
def clear(w: Work, columns: int) -> None:
    """An empty array."""
    emptied(w.W, 0.0)
    emptied(w.terms, 0.0)
    for r in range(w.kind.shape[0]):
        w.kind[r] = NONE
        w.taken[r] = False
    for c in range(w.units.shape[0]):
        w.units[c] = 1.0
    for c in range(columns):
        w.order[c] = c


@helper
def product(w: Work, i: int, row: Array, M: Array, begin: int) -> None:
    """row·M in row i of the array from column ``begin`` on; an exact row has zeros where it is rounding."""
    for j in range(M.shape[1]):
        s, t = 0.0, 0.0
        for h in range(M.shape[0]):
            s += row[h] * M[h, j]
            t += abs(row[h] * M[h, j])
        if w.kind[i] == EXACT:
            w.terms[i, begin + j] = t
            if abs(s) <= 16 * M.shape[0] * EPS * t:
                s = 0.0
        w.W[i, begin + j] = s


@helper
def earlier(
    Phi: Array, G: Array, rows: Array, values: Array, kind: Array, shift: Array, sd: Array, Uy: Array, own: Array, w: Work
) -> None:
    """From what is measured after k+1 to what is measured after k, both as [U | y] about x̂⁺; T is left for :func:`back`.

    ``rows`` (m, n), ``values`` (m, columns), ``kind`` (m,): the measurement at k+1 · ``shift`` (n, columns): x̂⁺ − x̂⁻ at k+1 · ``sd`` (n,):
    units of x_k · ``own`` (n,): the kinds of the rows of [U | y].
    """
    n, m, columns = Phi.shape[0], rows.shape[0], values.shape[1]
    end = 2 * n + columns
    clear(w, 2 * n)
    for i in range(n):
        w.W[i, i], w.kind[i] = 1.0, NOISY
        w.units[n + i] = sd[i]
        if own[i] != NONE:
            w.kind[n + i] = own[i]
            product(w, n + i, Uy[i, :n], G, 0)
            product(w, n + i, Uy[i, :n], Phi, n)
            for c in range(columns):
                w.W[n + i, 2 * n + c] = Uy[i, n + c]
                for h in range(n):
                    w.W[n + i, 2 * n + c] += Uy[i, h] * shift[h, c]
    for a in range(m):
        if kind[a] != NONE:
            i = 2 * n + a
            w.kind[i] = kind[a]
            product(w, i, rows[a], G, 0)
            product(w, i, rows[a], Phi, n)
            for c in range(columns):
                w.W[i, 2 * n + c] = values[a, c]
    reduce(w, 0, n, n, 2 * n, end, False)
    for i in range(n):  # T is wanted later, without the pivots of what follows
        w.pivot[2 * n + i] = w.pivot[i]
    reduce(w, n, 2 * n, n, 2 * n, end, False)
    for j in range(n):
        r = w.pivot[n + j]
        own[j] = NONE if r < 0 else w.kind[r]
        Uy[j] = 0.0
        if r >= 0:
            keep(w, r, n + j, n, Uy, j, own, columns)


@helper
def keep(w: Work, r: int, first: int, n: int, Uy: Array, j: int, own: Array, columns: int) -> None:
    """Row r of the array, which begins at column ``first``, as row j of [U | y]: an exact one near 1."""
    size, top = 0.0, 0.0
    for c in range(first, 2 * n):
        size = max(size, abs(w.W[r, c]) * w.units[c])
        top = max(top, abs(w.W[r, c]))
    if own[j] == NOISY and size > CERTAIN:
        own[j] = EXACT
    scale = 1.0
    if own[j] == EXACT:
        scale = 2.0 ** -np.floor(np.log2(top))
    for c in range(first, 2 * n):
        Uy[j, w.order[c] - n] = w.W[r, c] * scale
    for c in range(columns):
        Uy[j, n + c] = w.W[r, 2 * n + c] * scale


@helper
def back(Phi: Array, G: Array, w: Work, E: Array) -> None:
    """E = Φ − G T⁻¹(the next columns of T): how x_{k+1}, given all data, follows x_k."""
    n = Phi.shape[0]
    for c in range(n, 2 * n):
        column = w.order[c] - n
        for j in range(n - 1, -1, -1):
            r = w.pivot[2 * n + j]
            s = w.W[r, c]
            for h in range(j + 1, n):
                s -= w.W[r, h] * w.vector[h]
            w.vector[j] = s / w.W[r, j]
        for i in range(n):
            s = Phi[i, column]
            for h in range(n):
                s -= G[i, w.order[h]] * w.vector[h]
            E[i, column] = s


@helper
def meet(
    prior: Prior, k: int, known: int, Uy: Array, own: Array, first: int, x: Array, P: Array, lost: Array, w: Work, L: Array, d: Array
) -> None:  # fmt: skip
    """Add to x (n, runs), x̂⁺ before, what later data say: columns ``first``… of [U | y]; P (n, n) of the result.

    ``known``: how many of the unknown columns they determine · ``lost`` (n,): whether a state is not known even so. Such states
    have the values of an x whose unknown columns are zero.
    """
    n, runs = x.shape
    free = prior.unknown[k] if k < prior.unknown.shape[0] else 0
    vague = 0
    if k < prior.unknown.shape[0]:
        for c in range(free, n):
            for i in range(n):
                if prior.A[k, i, c] != 0.0:
                    vague = c - free + 1
    unknowns = free + n + vague
    if k < prior.L.shape[0]:
        copied(prior.L[k], L[:, free : free + n])
    else:
        root(prior.P[k], L[:, free : free + n], d, w.rest)
    for i in range(n):
        for c in range(free):
            L[i, c] = prior.A[k, i, c]
        for c in range(vague):
            L[i, free + n + c] = prior.A[k, i, free + c]
    end = unknowns + runs
    clear(w, unknowns)
    for i in range(n + vague):
        w.W[i, free + i], w.kind[i] = 1.0, NOISY
    for i in range(n):
        if own[i] != NONE:
            r = 2 * n + i
            w.kind[r] = own[i]
            product(w, r, Uy[i, :n], L[:, :unknowns], 0)
            for c in range(runs):
                w.W[r, unknowns + c] = Uy[i, n + first + c]
    for c in range(free):  # in units of its own column
        square = 0.0
        for i in range(n):
            square += w.W[2 * n + i, c] * w.W[2 * n + i, c]
        w.units[c] = 1 / np.sqrt(square) if square > 0 else 1.0
    known = reduce(w, 0, free, known, unknowns, end, True)
    for i in range(w.W.shape[0]):  # what rounding leaves of columns that nothing determines
        if not w.taken[i]:
            w.W[i, known:free] = 0.0
    reduce(w, free, unknowns, n + vague, unknowns, end, False)
    solve(w, known, free, unknowns, runs, L, x, P, lost)


@helper
def solve(
    w: Work, known: int, free: int, unknowns: int, runs: int, L: Array, x: Array, P: Array, lost: Array
) -> None:
    """x + Lξ and the covariance of Lξ from the triangle; the columns from ``known`` to ``free`` are not determined."""
    n = x.shape[0]
    for i in range(n):
        for j in range(unknowns):
            w.vector[j] = L[i, w.order[j]]
        lost[i] = False
        size = 0.0
        for j in range(unknowns):
            s, t = w.vector[j], abs(w.vector[j])
            for h in range(min(j, known) if j < free else j):
                if h < known or h >= free:
                    s -= w.vector[h] * w.W[w.pivot[h], j]
                    t += abs(w.vector[h] * w.W[w.pivot[h], j])
            if known <= j < free:
                lost[i] |= abs(s) > 16 * unknowns * EPS * t
                w.vector[j] = 0.0
            else:
                w.vector[j] = s / w.W[w.pivot[j], j]
            size = max(size, t)
        for j in range(unknowns):
            L[i, j] = w.vector[j]
    for i in range(n):
        for j in range(unknowns):
            if known <= j < free:
                continue
            r = w.pivot[j]
            for c in range(runs):
                x[i, c] += L[i, j] * w.W[r, unknowns + c]
            if w.kind[r] == EXACT:
                L[i, j] = 0.0
    for i in range(n):
        for j in range(i + 1):
            s = 0.0
            for h in range(unknowns):
                s += L[i, h] * L[j, h]
            P[i, j], P[j, i] = s, s


@helper
def hide(x: Array, P: Array, lost: Array) -> None:
    """NaN for the states that nothing determines, an infinite variance and no covariance."""
    for i in range(x.shape[0]):
        if lost[i]:
            x[i] = np.nan
            crossed_out(P, i)
            P[i, i] = np.inf


@helper
def units(P: Array, A: Array, k: int, sd: Array) -> None:
    """Standard deviations of the states, of what is not known the sizes of its columns."""
    for i in range(sd.shape[0]):
        s = max(P[k, i, i], 0.0)
        if k < A.shape[0]:
            for c in range(A.shape[2]):
                s += A[k, i, c] * A[k, i, c]
        sd[i] = np.sqrt(s)


@kernel
def prepare(system: System, used: Array, innovation: Array, Q: Array, out: Backward) -> None:
    """Fill ``out`` but for its Phi and shift; Q (steps or 1, n, n)."""
    n, m, runs, rows = system.Phi.shape[1], used.shape[1], innovation.shape[2], used.shape[0]
    L, d, pick = np.empty((m, m)), np.empty(m), np.empty(m, dtype=np.int64)
    wide, variances, rest, count = np.empty((n, n)), np.empty(n), np.empty((n, n)), 0
    constant = max(system.Phi.shape[0], Q.shape[0], system.H.shape[0], system.R.shape[0]) == 1
    for k in range(rows):
        same = k > 0 and alike(used[k], used[k - 1])
        out.since[k] = out.since[k - 1] if same and constant else k
        H, R = entry(system.H, k), entry(system.R, k)
        if not same or system.R.shape[0] > 1:
            count = picked(used[k], pick)
            triangle(R, L, d, pick, count)
        out.rows[k], out.values[k], out.kind[k] = 0.0, 0.0, NONE
        for a in range(count):
            out.rows[k, a] = H[pick[a]]
            out.values[k, a] = innovation[k, pick[a]]
            for b in range(a):
                for j in range(n):
                    out.rows[k, a, j] -= L[a, b] * out.rows[k, b, j]
                for c in range(runs):
                    out.values[k, a, c] -= L[a, b] * out.values[k, b, c]
        for a in range(count):
            scale = 1 / np.sqrt(d[a]) if d[a] > 0 else 1.0
            out.kind[k, a] = NOISY if d[a] > 0 else EXACT
            for j in range(n):
                out.rows[k, a, j] *= scale
            for c in range(runs):
                out.values[k, a, c] *= scale
        if k < out.G.shape[0]:
            root(Q[k], wide, variances, rest)
            copied(wide, out.G[k])


@helper
def unchanged(A: Array, B: Array) -> bool:
    """Whether two matrices are the same to the last digit."""
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            if A[i, j] != B[i, j]:
                return False
    return True


@helper
def close(U: Array, V: Array, sd: Array) -> bool:
    """Whether the same rows say the same, of states with these standard deviations, to 1e-12."""
    n = U.shape[0]
    for i in range(n):
        top = 1.0  # what says less than what is known anyway need not have digits of its own
        for j in range(n):
            top = max(top, abs(U[i, j]) * sd[j])
        for j in range(n):
            if not abs(U[i, j] - V[i, j]) * sd[j] <= 1e-12 * top:
                return False
    return True


@helper
def resting(U: Array, V: Array, E: Array, sd: Array, A: Array, Y: Array, X: Array, work: Array) -> bool:
    r"""Whether what later data say, UᵀU, is at its fixed point, having been VᵀV a step before.

    A change Δ becomes EᵀΔE in the next step back, where E is how the state, given all data, follows the one before
    (:func:`ctlabs.filtering.engines.common.fades`).
    """
    n = U.shape[0]
    for i in range(n):
        if not sd[i] > 0.0:
            return False
    for i in range(n):
        for j in range(n):
            s = 0.0
            for h in range(n):
                s += U[h, i] * U[h, j] - V[h, i] * V[h, j]
            Y[i, j] = s * sd[i] * sd[j]
            A[i, j] = E[j, i] * (sd[i] / sd[j])
    return fades(A, Y, X, work)


@helper
def mapped(b: Backward, prior: Prior, k: int, U: Array, own: Array, sd: Array, F: Array, M: Array, w: Work) -> bool:
    """What is linear in the data of a step back to k when [U | y] rests: y = F(y, x̂⁺ − x̂⁻, values) and x = x̂⁺ + My.

    F (n, 2n + m), M (n, n); False where rows come in another order, or one of them is without noise.
    """
    n, m = U.shape[0], b.rows.shape[1]
    both, columns = np.zeros((n, 3 * n + m)), 2 * n + m
    values, shift, same = np.zeros((m, columns)), np.zeros((n, columns)), own.copy()
    P, L, d, lost = np.empty((n, n)), np.empty((n, 3 * n)), np.empty(n), np.zeros(n, dtype=np.bool_)
    for i in range(n):
        for j in range(n):
            both[i, j] = U[i, j]
        both[i, n + i], shift[i, n + i] = 1.0, 1.0
        if own[i] == EXACT:
            return False
    for a in range(m):
        values[a, 2 * n + a] = 1.0
        if b.kind[k + 1, a] == EXACT:
            return False
    earlier(entry(b.Phi, k), entry(b.G, k), b.rows[k + 1], values, b.kind[k + 1], shift, sd, both, same, w)
    if not close(both[:, :n], U, sd):
        return False
    for i in range(n):
        if same[i] != own[i]:
            return False
        for j in range(columns):
            F[i, j] = both[i, n + j]
        for j in range(n):
            both[i, n + j] = 1.0 if i == j else 0.0
    emptied(M, 0.0)
    meet(prior, k, 0, both, own, 0, M, P, lost, w, L, d)
    return True


@helper
def coasted(
    b: Backward, prior: Prior, k: int, F: Array, M: Array, Uy: Array, x: Array, P: Array, lag_one: Array, ahead: Array
) -> int:  # fmt: skip
    """Back from k with P and lag_one as they are, as far as the same is measured and known before; where that ends."""
    n, runs, m = x.shape[1], x.shape[2], b.rows.shape[1]
    stop = max(b.since[k + 1] - 1, max(prior.unknown.shape[0], prior.L.shape[0]))
    y = np.empty((n, runs))
    while k > stop and unchanged(prior.P[k - 1], prior.P[k]):
        k -= 1
        for i in range(n):
            for c in range(runs):
                s = 0.0
                for h in range(n):
                    s += F[i, h] * Uy[h, n + c] + F[i, n + h] * b.shift[k + 1, h, c]
                for a in range(m):
                    s += F[i, 2 * n + a] * b.values[k + 1, a, c]
                y[i, c] = s
        for i in range(n):
            for c in range(runs):
                Uy[i, n + c] = y[i, c]
                s = x[k, i, c]
                for h in range(n):
                    s += M[i, h] * y[h, c]
                x[k, i, c] = s
            for j in range(n):
                P[k, i, j], lag_one[k + 1, i, j] = P[k + 1, i, j], ahead[i, j]
    return k


@kernel
def smooth(b: Backward, prior: Prior, x: Array, P: Array, lag_one: Array) -> bool:
    """From x = x̂⁺ to the estimates given the whole record, P, and cov(x_{k+1}, x_k) at k+1; False: overflow.

    Where nothing but data varies, and what is measured before and after an instant says the same of its state as at the next one, the
    covariances are not computed again.
    """
    n, m, runs, last = x.shape[1], b.rows.shape[1], x.shape[2], x.shape[0] - 1
    Uy, own, w = np.zeros((n, n + runs)), np.zeros(n, dtype=np.int64), room(n, m, runs)
    E, L, d, sd = np.empty((n, n)), np.empty((n, 3 * n)), np.empty(n), np.empty(n)
    A, X, Y, work, V = np.empty((n, n)), np.empty((n, n)), np.empty((n, n)), np.empty((n, n)), np.zeros((n, n))
    F, M, wide = np.empty((n, 2 * n + m)), np.empty((n, n)), room(n, m, 2 * n + m)
    lost, before, finite = np.zeros(n, dtype=np.bool_), np.zeros(n, dtype=np.bool_), True
    k, wait, look = last + 1, 1, last
    while k > 0:
        k -= 1
        for i in range(n):
            before[i] = lost[i]
            for j in range(n):
                V[i, j] = Uy[i, j]
        if k < last:
            Phi, G = entry(b.Phi, k), entry(b.G, k)
            units(prior.P, prior.A, k, sd)
            earlier(Phi, G, b.rows[k + 1], b.values[k + 1], b.kind[k + 1], b.shift[k + 1], sd, Uy, own, w)
            back(Phi, G, w, E)
        elif prior.unknown.shape[0] <= last:
            copied(prior.P[k], P[k])
            continue
        meet(prior, k, prior.later[k], Uy, own, 0, x[k], P[k], lost, w, L, d)
        finite &= all_finite(P[k]) and all_finite(x[k])
        if k < last:
            for i in range(n):
                for j in range(n):
                    s = 0.0
                    for h in range(n):
                        s += E[i, h] * P[k, h, j]
                    lag_one[k + 1, i, j] = np.nan if before[i] or lost[j] else s
        hide(x[k], P[k], lost)
        if k + 1 > last or b.since[k + 1] > k or k <= max(prior.unknown.shape[0], prior.L.shape[0]):
            wait, look = 1, k
        elif k <= look and unchanged(prior.P[k], prior.P[k + 1]) and close(Uy[:, :n], V, sd):
            if resting(Uy, V, E, sd, A, Y, X, work) and mapped(b, prior, k, Uy[:, :n], own, sd, F, M, wide):
                begin = k
                k = coasted(b, prior, k, F, M, Uy, x, P, lag_one, lag_one[k + 1].copy())
                for i in range(k, begin):
                    finite &= all_finite(x[i])
            wait = min(2 * wait, PATIENCE)
            look = k - wait
    return finite


@kernel
def windows(b: Backward, prior: Prior, lag: int, width: int, x: Array, P: Array) -> bool:
    """From x = x̂⁺ to the estimates of x_k given the record up to k + lag ≤ the last, and P; False: overflow.

    Each window of ``lag`` steps goes back on its own. Up to ``width`` windows with the same matrices go together.
    """
    n, m, last = x.shape[1], b.rows.shape[1], x.shape[0] - 1
    Uy, own, w, sd = np.empty((n, n + width)), np.zeros(n, dtype=np.int64), room(n, m, width), np.empty(n)
    L, d, lost = np.empty((n, 3 * n)), np.empty(n), np.zeros(n, dtype=np.bool_)
    values, shift, finite = np.empty((m, width)), np.empty((n, width)), True
    k = 0
    while k <= last - lag:
        count = 1
        while count < width and k + count <= last - lag and b.since[k + count + lag] <= k:
            count += 1
        emptied(Uy, 0.0)
        for i in range(n):
            own[i] = NONE
        for i in range(k + lag - 1, k - 1, -1):
            for c in range(count):
                for a in range(m):
                    values[a, c] = b.values[i + 1 + c, a, 0]
                for a in range(n):
                    shift[a, c] = b.shift[i + 1 + c, a, 0]
            units(prior.P, prior.A, i, sd)
            now = i + 1
            earlier(
                entry(b.Phi, i), entry(b.G, i), b.rows[now], values[:, :count], b.kind[now], shift[:, :count], sd,
                Uy[:, : n + count], own, w
            )  # fmt: skip
        for c in range(count):
            known = prior.later[k + c] - prior.later[k + c + lag]
            meet(prior, k + c, known, Uy, own, c, x[k + c], P[k + c], lost, w, L, d)
            finite &= all_finite(P[k + c]) and all_finite(x[k + c])
            hide(x[k + c], P[k + c], lost)
        k += count
    return finite
