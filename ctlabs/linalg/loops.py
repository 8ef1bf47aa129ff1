"""The arithmetic of :mod:`ctlabs.linalg.manyfold` for small matrices, compiled: the same slices, the same sums, the same bits.

Of small matrices an operation is a few hundred calls of numpy, each of which takes longer than its numbers. Imported when it is needed:
the compiler takes longer to load than a few solutions.
"""

from __future__ import annotations

import math

import numpy as np

from ctlabs.linalg.checks import Array
from ctlabs.linalg.compiled import helper, kernel


@helper
def both(a: float, b: float) -> tuple[float, float]:
    """a + b and its rounding (Knuth)."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


@kernel
def distilled(found: Array, size: int, fold: int) -> None:
    """The sum of the first ``size`` numbers, the largest first, in the first ``fold`` (Ogita, Rump & Oishi)."""
    for done in range(fold):
        for i in range(size - 1, done, -1):
            found[i - 1], found[i] = both(found[i - 1], found[i])
    for i in range(fold, size):
        found[fold - 1] += found[i]
    for i in range(fold - 1):
        found[i], found[i + 1] = both(found[i], found[i + 1])


@kernel
def slices(M: Array, bits: int, count: int, cut: Array, units: Array) -> int:
    """Fill ``cut`` (rows, count, columns) with the slices of M (parts, rows, columns), in ``units`` of the rows; how many are not empty."""
    fold, rows, columns = M.shape
    rest = np.empty(fold)
    most = 1
    for r in range(rows):
        largest = 0.0
        for k in range(columns):
            largest = max(largest, abs(M[0, r, k]))
        units[r] = math.ldexp(1.0, math.frexp(largest if largest > 0 else 1.0)[1])
        for k in range(columns):
            for f in range(fold):
                rest[f] = M[f, r, k] / units[r]
            for i in range(count):
                anchor = math.ldexp(1.5, 52 - bits * (i + 1) + 1)
                now = (rest[0] + anchor) - anchor
                cut[r, i, k] = now
                if now != 0 and i >= most:
                    most = i + 1
                rest[0] -= now
                for f in range(fold - 1):
                    rest[f], rest[f + 1] = both(rest[f], rest[f + 1])
    return most


@kernel
def product(A: Array, B: Array, fold: int, bits: int, count: int) -> Array:
    """AB of A (parts, rows, terms) and B transposed (parts, columns, terms), in so many parts."""
    rows, columns, terms = A.shape[1], B.shape[1], A.shape[2]
    left, right = np.empty((rows, count, terms)), np.empty((columns, count, terms))
    across, down, found, out = np.empty(rows), np.empty(columns), np.empty(fold + 1), np.empty((fold, rows, columns))
    many = slices(A, bits, count, left, across)
    more = slices(B, bits, count, right, down)
    for r in range(rows):
        for c in range(columns):
            for f in range(fold + 1):
                found[f] = 0.0
            for d in range(min(count, many + more - 1)):
                # Slices i and d − i have the same weight 2^(−bits·d): the sum of their products is exact.
                rest = 0.0
                for i in range(max(0, d + 1 - more), min(d + 1, many)):
                    for k in range(terms):
                        rest += left[r, i, k] * right[c, d - i, k]
                for f in range(fold):
                    found[f], rest = both(found[f], rest)
                found[fold] += rest
            distilled(found, fold + 1, fold)
            for f in range(fold):
                out[f, r, c] = found[f] * (across[r] * down[c])
    return out


@kernel
def collected(terms: Array, fold: int) -> Array:
    """The sum of terms (number, rows, columns), the largest first, in so many parts."""
    size, rows, columns = terms.shape
    out, found = np.empty((fold, rows, columns)), np.empty(size)
    for r in range(rows):
        for c in range(columns):
            for i in range(size):
                found[i] = terms[i, r, c]
            distilled(found, size, fold)
            for f in range(fold):
                out[f, r, c] = found[f]
    return out


@kernel
def increased(a: Array, b: Array, sign: float) -> Array:
    """A + sign·B (parts, rows, columns)."""
    fold, rows, columns = a.shape
    out, found = np.empty((fold, rows, columns)), np.empty(2 * fold)
    for r in range(rows):
        for c in range(columns):
            for f in range(fold):
                found[2 * f], found[2 * f + 1] = a[f, r, c], sign * b[f, r, c]
            distilled(found, 2 * fold, fold)
            for f in range(fold):
                out[f, r, c] = found[f]
    return out


@kernel
def eliminated(M: Array, bits: int, count: int) -> tuple[Array, bool]:
    """A⁻¹B beside the rest of what M = [A B] (parts, n, n + m) becomes, and whether A is regular; slices as of products of one term."""
    fold, n, wide = M.shape
    x, a, row = np.empty((fold, 1, 1)), np.empty((fold, 1, 1)), np.empty((fold, wide, 1))
    one, unit, column = np.zeros((fold, 1, 1)), np.zeros((fold, n, 1)), np.empty((fold, n, 1))
    one[0, 0, 0] = 1.0
    for j in range(n):
        pivot = j
        for i in range(j + 1, n):
            if abs(M[0, i, j]) > abs(M[0, pivot, j]):
                pivot = i
        if M[0, pivot, j] == 0:
            return M, False
        for f in range(fold):
            for c in range(wide):
                M[f, j, c], M[f, pivot, c] = M[f, pivot, c], M[f, j, c]
                row[f, c, 0] = M[f, j, c]
            for i in range(n):
                column[f, i, 0] = M[f, i, j]
            a[f, 0, 0] = M[f, j, j]
            x[f, 0, 0] = 0.0
        # The reciprocal of the pivot, by Newton's iteration.
        x[0, 0, 0] = 1 / a[0, 0, 0]
        for _ in range(1 + fold // 2):
            x = increased(x, product(x, increased(one, product(a, x, fold, bits, count), -1.0), fold, bits, count), 1.0)
        ratio = product(x, row, fold, bits, count)
        for f in range(fold):
            for c in range(wide):
                row[f, c, 0] = ratio[f, 0, c]
        for i in range(n):
            unit[0, i, 0] = 1.0 if i == j else 0.0
        M = increased(M, product(increased(column, unit, -1.0), row, fold, bits, count), -1.0)
    return M, True
