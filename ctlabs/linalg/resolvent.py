r"""The polynomials of :math:`c(sI - A)^{-1}b`, without rounding on the way.

.. math:: \det(sI - A) = s^n + a_1s^{n-1} + \dots + a_n, \qquad
          c\,\mathrm{adj}(sI - A)\,b = \sum_{k=0}^{n-1}(cM_kb)s^{n-1-k}, \quad M_0 = I, \quad M_k = M_{k-1}A + a_kI,
          \quad a_k = -\tfrac1k\mathrm{tr}(M_{k-1}A)

(Leverrier and Faddeev). The recursion cancels all digits of doubles already for moderate n, and eigenvalues lose the small
coefficients of a stiff A, so it runs in whole numbers: doubles are whole numbers times a power of 2.
Source: Zadeh & Desoer, *Linear System Theory* (1963), section 5.5.
"""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np

from ctlabs.linalg.checks import Array
from ctlabs.linalg.companion import double

#: A coefficient is zero when its own terms cancel to this multiple of n·ε of their sum.
ROUNDING = 16


def resolvent(A: Array, b: Array, c: Array) -> tuple[Array, Array]:
    """Numerator and denominator, (n,) and (n+1,), descending powers of s; each coefficient is rounded once.

    A coefficient whose terms cancel to the rounding of A, b and c is 0.

    Raises
    ------
    ValueError
        Coefficients beyond the range of doubles.

    >>> num, den = resolvent(np.array([[-3.0, 1.0], [-5.0, 0.0]]), np.array([1e-15, 1e-15]), np.array([1.0, 0.0]))
    >>> num.tolist(), den.tolist()
    ([1e-15, 1e-15], [1.0, 3.0, 5.0])
    """
    num, den = polynomials(A, b, c)
    return np.array([double("num", p) for p in num]), np.array([double("den", p) for p in den])


def polynomials(A: Array, b: Array, c: Array) -> tuple[list[Fraction], list[Fraction]]:
    """The same as fractions."""
    n = len(A)
    den, unit = _characteristic(A.tobytes(), n)
    (M, _), (right, right_unit), (row, row_unit) = (_whole(x, e) for x, e in ((A, unit), (b, None), (c, None)))
    first, num = row, []
    for k in range(n):
        if k:
            row = row @ M + den[k] * first
        terms = row * right
        value, size = sum(terms.tolist()), sum(abs(terms).tolist())
        kept = value if abs(value) << 52 > ROUNDING * n * size else 0
        num.append(_scaled(kept, -(right_unit + row_unit + k * unit)))
    return num, [_scaled(a, -k * unit) for k, a in enumerate(den)]


@lru_cache(maxsize=8)
def _characteristic(content: bytes, n: int) -> tuple[tuple[int, ...], int]:
    """The coefficients of det(sI − 2ᵉA), whole numbers, and e."""
    A, unit = _whole(np.frombuffer(content).reshape(n, n))
    eye = np.array([[int(i == j) for j in range(n)] for i in range(n)], dtype=object).reshape(n, n)
    M, den = eye, [1]
    for k in range(1, n + 1):
        product = M @ A
        den.append(-sum(int(product[i, i]) for i in range(n)) // k)
        M = product + den[-1] * eye
    return tuple(den), unit


def _whole(x: Array, unit: int | None = None) -> tuple[Any, int]:
    """x times 2ᵉ as whole numbers, and e."""
    parts = [value.as_integer_ratio() for value in x.ravel().tolist()]
    e = max((q.bit_length() - 1 for _, q in parts), default=0) if unit is None else unit
    whole = np.empty(len(parts), dtype=object)
    whole[:] = [p << (e - q.bit_length() + 1) for p, q in parts]
    return whole.reshape(x.shape), e


def _scaled(value: int, power: int) -> Fraction:
    return Fraction(value) * Fraction(2) ** power
