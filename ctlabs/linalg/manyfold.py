r"""Matrices in a multiple of the working precision: each is the unevaluated sum of 2, 4 or more arrays of doubles.

A residual such as :math:`APA^T + Q - P` of a good solution is the difference of nearly equal numbers: in doubles nothing of it is
left but rounding. In twice the precision (some 31 digits) it keeps half of its digits, and a solution corrected by it is right to its
last one.

Products come from exact products of slices: rows of the left and columns of the right factor are cut into slices of so few bits
that the sums of their products are whole numbers below 2⁵³, which any order of summation (and so the fastest BLAS) leaves exact
(Ozaki, Ogita, Oishi & Rump, Numer. Algorithms 59, 2012). Sums are those of Ogita, Rump & Oishi, SIAM J. Sci. Comput. 26 (2005).
"""

from __future__ import annotations

import importlib
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from ctlabs.linalg import compiled
from ctlabs.linalg.checks import Array

#: Systems of equations up to this size are solved by elimination.
ELIMINATED = 60
#: Multiplications and numbers up to which a compiled loop beats numpy.
SMALL = 40**3, 40**2
#: Operations after which loading the compiler pays, where nothing else has loaded it.
PATIENCE = 2000
SINGULAR = "Singular matrix"


@dataclass(frozen=True, slots=True, eq=False)
class Manyfold:
    """The matrix that is the sum of its parts; each part is at most the rounding of the one before.

    Of an array alone the number of parts is 1; a result has as many as the operand that has more.

    >>> third = Manyfold.of([[1 / 3]], 2)
    >>> rest = np.ones((1, 1)) - third - third - third
    >>> bool(rest.high[0, 0] == 2.0**-54)
    True
    """

    parts: tuple[Array, ...]

    __array_ufunc__ = None  # so that an array on the left leaves the operation to this class

    @staticmethod
    def of(value: object, fold: int = 1) -> Manyfold:
        """The same matrix with at least so many parts."""
        parts = value.parts if isinstance(value, Manyfold) else (np.asarray(value, dtype=np.float64),)
        return Manyfold(parts + (np.zeros_like(parts[0]),) * (fold - len(parts)))

    @property
    def fold(self) -> int:
        """The number of parts."""
        return len(self.parts)

    @property
    def high(self) -> Array:
        """The matrix in the working precision."""
        return self.parts[0]

    @property
    def low(self) -> Array:
        """What is missing there."""
        return np.sum(self.parts[1:], axis=0) if self.fold > 1 else np.zeros_like(self.high)

    @property
    def T(self) -> Manyfold:
        """The transpose."""
        return Manyfold(tuple(part.T for part in self.parts))

    @property
    def symmetric(self) -> Manyfold:
        """½(M + Mᵀ)."""
        return (self + self.T) * 0.5

    def scaled(self, rows: Array, columns: Array) -> Manyfold:
        """diag(rows) M diag(columns); exact for powers of 2."""
        unit = rows[:, None] * columns
        return Manyfold(tuple(part * unit for part in self.parts))

    def __mul__(self, factor: float) -> Manyfold:
        """Times a number; exact for a power of 2."""
        return Manyfold(tuple(factor * part for part in self.parts))

    def __neg__(self) -> Manyfold:
        return self * -1.0

    def __add__(self, other: Manyfold | Array) -> Manyfold:
        other = Manyfold.of(other)
        pairs = [part for i in range(max(self.fold, other.fold)) for part in (*self.parts[i : i + 1], *other.parts[i : i + 1])]
        return _collected(pairs, max(self.fold, other.fold))

    def __radd__(self, other: Array) -> Manyfold:
        return self + other

    def __sub__(self, other: Manyfold | Array) -> Manyfold:
        return self + -Manyfold.of(other)

    def __rsub__(self, other: Array) -> Manyfold:
        return -self + other

    def __matmul__(self, other: Manyfold | Array) -> Manyfold:
        return _product(self, Manyfold.of(other))

    def __rmatmul__(self, other: Array) -> Manyfold:
        return _product(Manyfold.of(other), self)

    def __getitem__(self, key: Any) -> Manyfold:
        return Manyfold(tuple(part[key] for part in self.parts))


Matrix = Array | Manyfold


def rounding(fold: int) -> float:
    """Relative rounding of a product, per term of its sums, beside the largest elements of its row and column."""
    return 2.0 ** (6 - 53 * fold)


def high(M: Matrix) -> Array:
    """M in the working precision."""
    return M.high if isinstance(M, Manyfold) else M


def symmetric(M: Matrix) -> Matrix:
    """½(M + Mᵀ)."""
    return M.symmetric if isinstance(M, Manyfold) else 0.5 * (M + M.T)


def inverse(M: Matrix) -> Matrix:
    """M⁻¹, in the precision of M."""
    return solve(M, Manyfold.of(np.eye(len(M.high)))) if isinstance(M, Manyfold) else np.linalg.inv(M)


def solve(A: Manyfold, B: Manyfold) -> Manyfold:
    """A⁻¹B: by elimination, or (of many equations) by Newton's iteration for the inverse.

    >>> A = Manyfold.of([[1.0, 1.0], [1.0, 1.0 + 2.0**-52]], 2)
    >>> solve(A, Manyfold.of([[1.0], [1.0]])).high.tolist()
    [[1.0], [0.0]]
    """
    n = len(A.high)
    if n > ELIMINATED:
        X = Manyfold.of(np.linalg.inv(A.high), A.fold)
        for _ in range(2 + A.fold // 2):
            X = X + X @ (np.eye(n) - A @ X)
        return X @ B
    fold = max(A.fold, B.fold)
    both = zip(Manyfold.of(A, fold).parts, Manyfold.of(B, fold).parts, strict=True)
    M = Manyfold(tuple(np.hstack(pair) for pair in both))
    if (loops := _compiled()) is not None:
        found, regular = loops.eliminated(np.array(M.parts), *_width(fold, 1))
        if not regular:
            raise np.linalg.LinAlgError(SINGULAR)
        return Manyfold(tuple(found[:, :, n:]))
    for j in range(n):
        order = np.arange(n)
        pivot = j + int(np.abs(M.high[j:, j]).argmax())
        order[[j, pivot]] = pivot, j
        M = M[order]
        row = _reciprocal(M[j : j + 1, j : j + 1]) @ M[j : j + 1]
        M = M - (M[:, j : j + 1] - np.eye(n)[:, j : j + 1]) @ row
    return M[:, n:]


def _reciprocal(a: Manyfold) -> Manyfold:
    """1/a of one number."""
    if a.high[0, 0] == 0:
        raise np.linalg.LinAlgError(SINGULAR)
    x = Manyfold.of(1 / a.high, a.fold)
    for _ in range(1 + a.fold // 2):
        x = x + x @ (np.ones((1, 1)) - a @ x)
    return x


_loops: Any = None
_operations = 0


def _compiled() -> Any:
    """:mod:`ctlabs.linalg.loops` if the compiler is there or pays by now, else None; the numbers are the same."""
    global _loops, _operations
    if _loops is None and compiled.COMPILED:
        _operations += 1
        if _operations > PATIENCE or "numba" in sys.modules:
            _loops = importlib.import_module("ctlabs.linalg.loops")
    return _loops


def _sum(a: Array, b: Array) -> tuple[Array, Array]:
    """a + b and its rounding (Knuth)."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


def _collected(terms: Sequence[Array], fold: int) -> Manyfold:
    """The sum of terms, the largest first, in so many parts."""
    found = list(terms)
    if found[0].size <= SMALL[1] and (loops := _compiled()) is not None:
        alike = all(term.shape == found[0].shape for term in found)
        return Manyfold(tuple(loops.collected(np.array(found if alike else np.broadcast_arrays(*found)), fold)))
    for done in range(fold):
        for i in range(len(found) - 1, done, -1):
            found[i - 1], found[i] = _sum(found[i - 1], found[i])
    found[fold - 1] = np.sum(found[fold - 1 :], axis=0)
    for i in range(fold - 1):
        found[i], found[i + 1] = _sum(found[i], found[i + 1])
    return Manyfold(tuple(found[:fold]))


def _product(A: Manyfold, B: Manyfold) -> Manyfold:
    fold, terms = max(A.fold, B.fold), A.high.shape[1]
    bits, count = _width(fold, terms)
    if len(A.high) * B.high.size <= SMALL[0] and (loops := _compiled()) is not None:
        return Manyfold(tuple(loops.product(np.array(A.parts), np.array(B.T.parts), fold, bits, count)))
    left, rows = _slices(A, bits, count)
    right, columns = _slices(B.T, bits, count)
    found = [np.zeros((len(rows), len(columns)))] * (fold + 1)
    for d in range(min(count, len(left) + len(right) - 1)):
        # Slices i and d − i have the same weight 2^(−bits·d): their products are summed within one exact product.
        pairs = range(max(0, d + 1 - len(right)), min(d + 1, len(left)))
        rest = np.concatenate([left[i] for i in pairs], axis=1) @ np.concatenate([right[d - i] for i in pairs], axis=1).T
        for i in range(fold):
            found[i], rest = _sum(found[i], rest)
        found[fold] = found[fold] + rest
    return _collected(found, fold).scaled(rows, columns)


@lru_cache
def _width(fold: int, terms: int) -> tuple[int, int]:
    """So many bits of so many slices that a sum of all products of one weight stays below 2⁵³."""
    bits = count = 1
    for count in range(1, 99):
        bits = int((55 - math.log2(max(count * terms, 1))) // 2)
        if bits * count >= 53 * fold:
            break
    return bits, count


def _slices(M: Manyfold, bits: int, count: int) -> tuple[list[Array], Array]:
    """The slices of the rows of M, in units (the second answer) in which each row has a largest element of ½ to 1."""
    largest = np.abs(M.high).max(axis=1, initial=0.0)
    unit = np.ldexp(1.0, np.frexp(np.where(largest > 0, largest, 1.0))[1])
    rest = [part / unit[:, None] for part in M.parts]
    slices: list[Array] = []
    for i in range(count):
        anchor = 1.5 * 2.0 ** (52 - bits * (i + 1) + 1)
        now = (rest[0] + anchor) - anchor
        slices.append(now)
        rest[0] = rest[0] - now
        for k in range(len(rest) - 1):
            rest[k], rest[k + 1] = _sum(rest[k], rest[k + 1])
        if not rest[0].any():
            break
    return slices, unit
