r"""Matrices in twice the working precision: each is the unevaluated sum of two arrays of doubles.

A residual such as :math:`APA^T + Q - P` of a good solution is the difference of nearly equal numbers: in doubles nothing of it is
left but rounding. In twice the precision (some 31 digits) it keeps half of its digits, and a solution corrected by it is right to its
last one.

Products come from exact products of slices: rows of the left and columns of the right factor are cut into slices of so few bits
that the sums of their products are whole numbers below 2⁵³, which any order of summation (and so the fastest BLAS) leaves exact
(Ozaki, Ogita, Oishi & Rump, Numer. Algorithms 59, 2012).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ctlabs._check import Array

#: Slices of each factor: with 21 bits or more each, 105 bits of the largest element of a row or column.
SLICES = 5
#: Relative rounding of a product, per term of its sums, beside the largest elements of its row and column.
ROUNDING = 2.0**-100


@dataclass(frozen=True, slots=True, eq=False)
class Twofold:
    """The matrix ``high + low``; |low| is at most half a unit in the last place of high.

    >>> third = Twofold.of([[1.0]]) @ Twofold.of([[1 / 3]])
    >>> (Twofold.of([[1.0]]) - third - third - third).high[0, 0] == 1 - 3 * 0.333333333333333314829616256247390992939472198486328125
    True
    """

    high: Array
    low: Array

    __array_ufunc__ = None  # so that an array on the left leaves the operation to this class

    @staticmethod
    def of(value: object) -> Twofold:
        """The same matrix in twice the precision; a :class:`Twofold` as it is."""
        if isinstance(value, Twofold):
            return value
        high = np.asarray(value, dtype=np.float64)
        return Twofold(high, np.zeros_like(high))

    @property
    def T(self) -> Twofold:  # noqa: N802, the name that arrays have
        """The transpose."""
        return Twofold(self.high.T, self.low.T)

    @property
    def symmetric(self) -> Twofold:
        """½(M + Mᵀ)."""
        twice = self + self.T
        return Twofold(0.5 * twice.high, 0.5 * twice.low)

    def scaled(self, rows: Array, columns: Array) -> Twofold:
        """diag(rows) M diag(columns); exact for powers of 2."""
        unit = rows[:, None] * columns
        return Twofold(self.high * unit, self.low * unit)

    def __mul__(self, factor: float) -> Twofold:
        """Times a number; exact for a power of 2."""
        return Twofold(factor * self.high, factor * self.low)

    def __neg__(self) -> Twofold:
        return Twofold(-self.high, -self.low)

    def __add__(self, other: Twofold | Array) -> Twofold:
        other = Twofold.of(other)
        total, rest = _sum(self.high, other.high)
        return Twofold(*_sum(total, rest + (self.low + other.low)))

    def __radd__(self, other: Array) -> Twofold:
        return self + other

    def __sub__(self, other: Twofold | Array) -> Twofold:
        return self + -Twofold.of(other)

    def __rsub__(self, other: Array) -> Twofold:
        return -self + other

    def __matmul__(self, other: Twofold | Array) -> Twofold:
        return _product(self, Twofold.of(other))

    def __rmatmul__(self, other: Array) -> Twofold:
        return _product(Twofold.of(other), self)

    def inverse(self) -> Twofold:
        """The inverse, by Newton's iteration from that of the high part: right to some 31 digits less the condition's."""
        one = np.eye(len(self.high))
        X = Twofold.of(np.linalg.inv(self.high))
        for _ in range(3):
            X = X + X @ (one - self @ X)
        return X


Matrix = Array | Twofold


def high(M: Matrix) -> Array:
    """M in the working precision."""
    return M.high if isinstance(M, Twofold) else M


def symmetric(M: Matrix) -> Matrix:
    """½(M + Mᵀ)."""
    return M.symmetric if isinstance(M, Twofold) else 0.5 * (M + M.T)


def inverse(M: Matrix) -> Matrix:
    """M⁻¹, in the precision of M."""
    return M.inverse() if isinstance(M, Twofold) else np.linalg.inv(M)


def _sum(a: Array, b: Array) -> tuple[Array, Array]:
    """a + b and its rounding (Knuth)."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


def _product(A: Twofold, B: Twofold) -> Twofold:
    terms = A.high.shape[1]
    bits = int((55 - math.log2(max(SLICES * terms, 1))) // 2)
    left, rows = _slices(A, bits)
    right, columns = _slices(B.T, bits)
    high = low = np.zeros((len(rows), len(columns)))
    for d in range(SLICES):
        # Slices i and d − i have the same weight 2^(−bits·d): their products are summed within one exact product.
        exact = np.hstack(left[: d + 1]) @ np.hstack(right[d::-1]).T
        high, rest = _sum(high, exact)
        low = low + rest
    return Twofold(*_sum(high, low)).scaled(rows, columns)


def _slices(M: Twofold, bits: int) -> tuple[list[Array], Array]:
    """The slices of the rows of M, in units (the second answer) in which each row has a largest element of ½ to 1."""
    largest = np.abs(M.high).max(axis=1, initial=0.0)
    unit = np.ldexp(1.0, np.frexp(np.where(largest > 0, largest, 1.0))[1])
    rest, low = M.high / unit[:, None], M.low / unit[:, None]
    slices = []
    for i in range(SLICES):
        anchor = 1.5 * 2.0 ** (52 - bits * (i + 1) + 1)
        now = (rest + anchor) - anchor
        slices.append(now)
        rest, low = _sum(rest - now, low)
    return slices, unit
