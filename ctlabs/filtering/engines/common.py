"""What the compiled loops share: a model's arrays, factors of covariances, and the motion where w and v correlate."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ctlabs.linalg.checks import Array
from ctlabs.linalg.compiled import helper as helper
from ctlabs.linalg.rounding import CANCELLED as CANCELLED

EPS = float(np.finfo(float).eps)
#: A matrix is at its fixed point when what is left of its way there is below this, in units of the standard deviations.
SETTLED = 1e-13


class System(NamedTuple):
    """The arrays of a discrete model: Phi, Q (steps or 1, n, n), c (steps or 1, n), H, R (steps+1 or 1, …), N (n, m).

    c and N are empty where there are none.
    """

    Phi: Array
    Q: Array
    c: Array
    H: Array
    R: Array
    N: Array


@helper
def entry(stack: Array, k: int) -> Array:
    """Entry k of a matrix that may be constant (a stack of one)."""
    return stack[k] if stack.shape[0] > 1 else stack[0]


@helper
def emptied(A: Array, value: float) -> None:
    """Every element of a matrix becomes ``value``: loops compile in a fraction of the time of assignments to slices."""
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            A[i, j] = value


@helper
def all_finite(A: Array) -> bool:
    """Whether every element of a matrix is finite."""
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            if not np.isfinite(A[i, j]):
                return False
    return True


@helper
def copied(A: Array, out: Array) -> None:
    """out = A, matrices."""
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            out[i, j] = A[i, j]


@helper
def crossed_out(A: Array, i: int) -> None:
    """Row and column i of a square matrix become zero."""
    for j in range(A.shape[0]):
        A[i, j] = 0.0
        A[j, i] = 0.0


@helper
def alike(a: Array, b: Array) -> bool:
    """Whether the same elements are used."""
    for i in range(a.shape[0]):  # noqa: SIM110  # numba knows no all()
        if a[i] != b[i]:
            return False
    return True


@helper
def picked(used: Array, pick: Array) -> int:
    """The indices of the elements used, at the beginning of ``pick``; their number."""
    count = 0
    for i in range(used.shape[0]):
        if used[i]:
            pick[count] = i
            count += 1
    return count


@helper
def triangle(M: Array, L: Array, d: Array, pick: Array, count: int) -> bool:
    """L, d of the ``count`` rows and columns ``pick`` of M = L diag(d) Lᵀ; whether all d > 0.

    As :func:`ctlabs.linalg.factors.ldl`: what is left of a variance below its rounding is zero.
    """
    regular = True
    for a in range(count):
        for b in range(count):
            L[a, b] = M[pick[a], pick[b]]
    for j in range(count):
        if L[j, j] <= 4 * count * EPS * M[pick[j], pick[j]]:
            regular = False
            d[j] = 0.0
            for a in range(j + 1, count):
                L[a, j] = 0.0
        else:
            d[j] = L[j, j]
            for a in range(j + 1, count):
                factor = L[a, j] / d[j]
                for b in range(j + 1, a + 1):
                    L[a, b] -= factor * L[b, j]
            for a in range(j + 1, count):
                L[a, j] /= d[j]
        L[j, j] = 1.0
    return regular


@helper
def root(M: Array, L: Array, left: Array, rest: Array) -> None:
    """Columns L (n, n) with M = LLᵀ, as :func:`ctlabs.filtering.algorithms.contract.rooted`; those that a singular M has not are zero."""
    n = M.shape[0]
    copied(M, rest)
    emptied(L, 0.0)
    for i in range(n):
        left[i] = 1.0 if M[i, i] > 0.0 else 0.0
    for c in range(n):
        p = 0
        for i in range(n):
            if left[i] > left[p]:
                p = i
        if left[p] <= 4 * n * EPS:
            return
        scale = 1 / np.sqrt(rest[p, p])
        for i in range(n):
            L[i, c] = rest[i, p] * scale
        for i in range(n):
            for j in range(n):
                rest[i, j] -= L[i, c] * L[j, c]
        for i in range(n):
            rest[i, p], rest[p, i] = 0.0, 0.0
        for i in range(n):
            left[i] = rest[i, i] / M[i, i] if M[i, i] > 0.0 else 0.0


@helper
def motion(system: System, k: int, pick: Array, count: int, Phi: Array, Q: Array, M: Array, L: Array, d: Array) -> None:
    """Φ − NR⁻¹H, Qd − NR⁻¹Nᵀ and M = NR⁻¹ for the step after k, given which elements were used at k; their R is regular."""
    n = system.N.shape[0]
    A, W, H, R = entry(system.Phi, k), entry(system.Q, k), entry(system.H, k), entry(system.R, k)
    triangle(R, L, d, pick, count)
    emptied(M, 0.0)
    for i in range(n):
        for j in range(n):
            Phi[i, j], Q[i, j] = A[i, j], W[i, j]
        for a in range(count):  # L diag(d) Lᵀ Mᵀ = Nᵀ, column i
            M[i, a] = system.N[i, pick[a]]
            for b in range(a):
                M[i, a] -= L[a, b] * M[i, b]
        for a in range(count - 1, -1, -1):
            M[i, a] /= d[a]
            for b in range(a + 1, count):
                M[i, a] -= L[b, a] * M[i, b]
    for a in range(count):
        for i in range(n):
            for j in range(n):
                Phi[i, j] -= M[i, a] * H[pick[a], j]
            for j in range(i + 1):
                Q[i, j] -= M[i, a] * system.N[j, pick[a]]
    for i in range(n):
        for j in range(i):
            Q[j, i] = Q[i, j]
    if count > 0:  # exact zeros for a disturbance that the measurement gives away: rounding.difference
        for i in range(n):
            if Q[i, i] <= 16 * n * EPS * W[i, i]:
                crossed_out(Q, i)
    for a in range(count - 1, -1, -1):  # from the elements used to all of them
        if pick[a] != a:
            for i in range(n):
                M[i, pick[a]] = M[i, a]
                M[i, a] = 0.0


@helper
def factor_inverse(C: Array, count: int, out: Array) -> None:
    """out = (CCᵀ)⁻¹ of a lower triangular C, in the leading rows and columns."""
    for c in range(count):
        for a in range(count):
            s = 1.0 if a == c else 0.0
            for b in range(a):
                s -= C[a, b] * out[b, c]
            out[a, c] = s / C[a, a]
        for a in range(count - 1, -1, -1):
            s = out[a, c]
            for b in range(a + 1, count):
                s -= C[b, a] * out[b, c]
            out[a, c] = s / C[a, a]


@helper
def picked_inverse(S: Array, pick: Array, count: int, C: Array, out: Array) -> None:
    """The inverse of the picked part of a covariance S, by its factor C in unit variances."""
    for a in range(count):
        for b in range(a + 1):
            s = S[pick[a], pick[b]] / np.sqrt(S[pick[a], pick[a]] * S[pick[b], pick[b]])
            for c in range(b):
                s -= C[a, c] * C[b, c]
            C[a, b] = np.sqrt(s) if a == b else s / C[b, b]
    factor_inverse(C, count, out)
    for a in range(count):
        for b in range(count):
            out[a, b] /= np.sqrt(S[pick[a], pick[a]] * S[pick[b], pick[b]])


@helper
def similarity(A: Array, P: Array, out: Array, work: Array) -> None:
    """out += A P Aᵀ for a symmetric P, its lower triangle."""
    n = A.shape[0]
    for i in range(n):
        for j in range(n):
            s = 0.0
            for h in range(n):
                s += A[i, h] * P[h, j]
            work[i, j] = s
        for j in range(i + 1):
            s = 0.0
            for h in range(n):
                s += work[i, h] * A[j, h]
            out[i, j] += s


@helper
def mirror(P: Array) -> None:
    """The upper triangle from the lower."""
    for i in range(P.shape[0]):
        for j in range(i):
            P[j, i] = P[i, j]


@helper
def largest(A: Array) -> float:
    """The largest absolute value of a matrix; NaN where one is NaN."""
    most = 0.0
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            size = abs(A[i, j])
            if size != size:
                return size
            most = max(most, size)
    return most


@helper
def fades(A: Array, Y: Array, X: Array, work: Array) -> bool:
    r"""Whether all that follows from a change Y, AʲYAʲᵀ in the j-th step after it, adds up to less than :data:`SETTLED`.

    The sum from j = 1 in X, by doubling: X ← X + AXAᵀ, A ← A². A and Y are lost.
    """
    n = A.shape[0]
    emptied(X, 0.0)
    similarity(A, Y, X, work)
    mirror(X)
    for _ in range(60):
        size, left = largest(A), largest(X)
        if not (size < 1e100 and left <= SETTLED):
            return False
        if left == 0.0 or size < 1e-4:
            return True
        copied(X, Y)
        similarity(A, Y, X, work)
        mirror(X)
        for i in range(n):
            for j in range(n):
                s = 0.0
                for h in range(n):
                    s += A[i, h] * A[h, j]
                Y[i, j] = s
        copied(Y, A)
    return False
