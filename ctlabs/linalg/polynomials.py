r"""Polynomials with coefficients known exactly (fractions) or to sixty digits (mpmath): signs, roots, integrals.

Coefficients are in descending powers. Those of a spectrum are doubles, each true to a rounding, and what follows from them is
decided for them as they stand: where a polynomial is negative by isolating its real roots, without a tolerance between roots.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

#: Coefficients: fractions, or numbers of mpmath.
Polynomial = list[Any]
#: Digits of roots and of what is made of them.
DIGITS = 60
#: Most steps of the iteration for the roots.
STEPS = 500
#: What the rounding of a polynomial's coefficients may be, in its own terms Σ|c_k|x^k.
ROUNDING = Fraction(1, 2**46)


def exact(p: Iterable[float]) -> Polynomial:
    """Doubles as fractions."""
    return [Fraction(float(c)) for c in p]


def trimmed(p: Sequence[Any]) -> Polynomial:
    """Without leading zeros; 0 is [0]."""
    first = next((k for k, c in enumerate(p) if c), len(p) - 1)
    return list(p[first:])


def times(p: Sequence[Any], q: Sequence[Any]) -> Polynomial:
    """The product.

    >>> times([1, 2], [1, -2])
    [1, 0, -4]
    """
    product: Polynomial = [0] * (len(p) + len(q) - 1)
    for i, a in enumerate(p):
        for j, b in enumerate(q):
            product[i + j] += a * b
    return product


def plus(p: Sequence[Any], q: Sequence[Any]) -> Polynomial:
    """The sum."""
    n = max(len(p), len(q))
    return [a + b for a, b in zip([0] * (n - len(p)) + [*p], [0] * (n - len(q)) + [*q], strict=True)]


def mirrored(p: Sequence[Any]) -> Polynomial:
    """p(−s).

    >>> mirrored([1, 2, 3])
    [1, -2, 3]
    """
    return [-c if (len(p) - k) % 2 == 0 else c for k, c in enumerate(p)]


def in_square(p: Sequence[Any]) -> Polynomial:
    """An even polynomial in s as one in ω² = −s²."""
    return mirrored(list(p[::-1][::2][::-1]))


def in_s(p: Sequence[Any]) -> Polynomial:
    """A polynomial in ω² as one in s."""
    wide: Polynomial = [0] * (2 * len(p) - 1)
    wide[::2] = mirrored(p)
    return wide


def squared(p: Sequence[Any]) -> Polynomial:
    """|p(jω)|² as a polynomial in ω²."""
    return in_square(times(p, mirrored(p)))


def without_rounding(p: Sequence[Any], size: Sequence[Any]) -> Polynomial:
    """Leading coefficients that are the rounding of their own terms' sum of magnitudes are 0."""
    first = next((k for k, (c, s) in enumerate(zip(p, size, strict=True)) if abs(c) > s * ROUNDING), len(p))
    return [c * 0 if k < first else c for k, c in enumerate(p)]


def negative(p: Sequence[Fraction], slack: Fraction = Fraction(0)) -> tuple[Fraction, Fraction | None] | None:
    r"""Where :math:`p(x) + slack\sum|c_k|x^k < 0` for x ≥ 0: bounds of an interval in which it is throughout; None if nowhere.

    The upper bound is None where there is none. With the rounding of the coefficients as slack, what is found is negative
    whatever they were before they were rounded.

    >>> negative([Fraction(1), Fraction(-3), Fraction(2)])
    (Fraction(1, 1), Fraction(2, 1))
    """
    p = [c + slack * abs(c) for c in p]
    ends = [end for end, count in positive_roots(p) if count % 2]
    if trimmed(p)[0] < 0:
        return (ends[-1][1] if ends else Fraction(0)), None
    if not ends:
        return None
    return (ends[-2][1] if len(ends) > 1 else Fraction(0)), ends[-1][0]


def touching(p: Sequence[Fraction], slack: Fraction = Fraction(0)) -> tuple[Fraction, Fraction] | None:
    r"""Where :math:`p(x) - slack\sum|c_k|x^k` is zero or negative for x ≥ 0, its highest coefficient being positive.

    >>> touching([Fraction(1), Fraction(-2), Fraction(1)])
    (Fraction(1, 1), Fraction(1, 1))
    """
    lower = [c - slack * abs(c) for c in p]
    if not p[-1]:
        return Fraction(0), Fraction(0)
    found = negative(lower) if slack else None
    if found and found[1] is not None:
        return found[0], found[1]
    return next((end for end, _ in positive_roots(lower)), None)


def positive_roots(p: Sequence[Fraction]) -> list[tuple[tuple[Fraction, Fraction], int]]:
    """Intervals about the positive roots, with gaps between them and before the first, and the roots' multiplicities."""
    import sympy

    p = trimmed(p)
    while len(p) > 1 and not p[-1]:
        p = p[:-1]
    if all(c >= 0 for c in p) or all(c <= 0 for c in p):
        return []
    unit = _unit(p)
    scaled = sympy.Poly(_whole([c / unit**k for k, c in enumerate(p)]), sympy.Symbol("x"))
    simple = [Fraction(int(c)) for c in scaled.sqf_part().all_coeffs()]
    ends: list[tuple[tuple[Fraction, Fraction], int]] = []
    before, found = Fraction(0), scaled.intervals(inf=0)
    sign = (-1) ** (len(found) - 1) * (1 if simple[0] > 0 else -1)  # to the right of the first root
    for interval, count in found:
        low, high = (Fraction(int(end.p), int(end.q)) for end in interval)
        while low <= before < high:
            middle = (low + high) / 2
            low, high = (low, middle) if value(simple, middle) * sign > 0 else (middle, high)
        ends.append(((low * unit, high * unit), count))
        before, sign = high, -sign
    return ends


def value(p: Sequence[Any], x: Any) -> Any:
    """p(x)."""
    total = p[0] * 0
    for c in p:
        total = total * x + c
    return total


def _unit(p: Sequence[Fraction]) -> Fraction:
    """The geometric mean of the roots' magnitudes, rounded to a power of 2."""
    size = abs(p[-1] / p[0])
    return Fraction(2) ** round((math.log2(size.numerator) - math.log2(size.denominator)) / (len(p) - 1))


def _whole(p: Sequence[Fraction]) -> list[int]:
    """The coefficients times their common denominator."""
    common = math.lcm(*(c.denominator for c in p))
    return [int(c * common) for c in p]


def roots(p: Sequence[Fraction]) -> list[Any]:
    """All roots to :data:`DIGITS` digits, multiple ones as often as they occur (their order is found exactly).

    >>> [complex(r) for r in roots([Fraction(1), Fraction(-2), Fraction(1)])]
    [(1+0j), (1+0j)]
    """
    import mpmath
    import sympy

    p = trimmed(p)
    if len(p) == 1:
        return []
    found: list[Any] = []
    with mpmath.workdps(DIGITS):
        for factor, count in sympy.Poly(_whole(p), sympy.Symbol("x")).sqf_list()[1]:
            simple = _simple([Fraction(int(c)) for c in factor.all_coeffs()])
            found += [root for root in simple for _ in range(count)]
    return found


def _simple(p: Sequence[Fraction]) -> list[Any]:
    """The roots of a polynomial without multiple ones, in units in which their geometric mean is near 1."""
    import mpmath

    n = len(p) - 1
    if n == 1:
        return [_mp(-p[1] / p[0])]
    if not p[-1]:
        return [mpmath.mpf(0), *_simple(p[:-1])]
    unit = _unit(p)
    scaled = [c / p[0] / unit**k for k, c in enumerate(p)]
    found = _all_at_once([_mp(c) for c in scaled], np.roots([float(c) for c in scaled]))
    return [root * _mp(unit) for root in found]


def _all_at_once(p: Polynomial, start: Any) -> list[Any]:
    r"""Aberth's iteration: Newton's step for each root of p divided by the others' distances.

    .. math:: r_i \leftarrow r_i - \frac{v_i}{1 - v_i\sum_{j\ne i}1/(r_i - r_j)}, \qquad v_i = p(r_i)/p'(r_i)
    """
    import mpmath

    n, slope = len(p) - 1, [c * (len(p) - 1 - k) for k, c in enumerate(p[:-1])]
    with mpmath.workdps(4 * DIGITS):
        # The starts differ, and no line is an axis of symmetry, on which the iteration would stay.
        found = [mpmath.mpc(r) * (1 + 1e-9 * mpmath.expj(k + 1)) for k, r in enumerate(start.tolist())]
        limit = mpmath.mpf(10) ** (-2 * DIGITS)
        for _ in range(STEPS):
            largest = 0
            for i in range(n):
                newton = mpmath.polyval(p, found[i]) / (mpmath.polyval(slope, found[i]) or limit)
                others = mpmath.fsum(1 / (found[i] - found[j]) for j in range(n) if j != i and found[i] != found[j])
                step = newton / (1 - newton * others)
                found[i] -= step
                largest = max(largest, abs(step) / abs(found[i]))
            if largest < limit:
                return [r.real if abs(r.imag) < limit * abs(r) else r for r in found]
    msg = f"polynomial: expected roots that {STEPS} steps of Aberth's iteration find, received a tighter cluster"
    raise ValueError(msg)


def _mp(x: Fraction) -> Any:
    import mpmath

    return mpmath.mpf(x.numerator) / x.denominator


def digits(p: Sequence[Any]) -> Polynomial:
    """Fractions as numbers of mpmath, in the precision of its context."""
    return [_mp(c) if isinstance(c, Fraction) else c for c in p]


def power(num: Sequence[Any], den: Sequence[Any]) -> Any:
    r"""(1/2π)∫|num/den|²dω of a stable, strictly proper filter; None if it is not stable.

    .. math:: \tilde a = (a_1, 0, a_3, 0, \dots), \quad \alpha = \frac{a_0}{a_1}, \; \beta = \frac{b_1}{a_1}, \quad
              a \leftarrow a - \alpha s\tilde a, \; b \leftarrow b - \beta\tilde a, \quad I = \sum\frac{\beta^2}{2\alpha}

    Routh's array beside the numerator, one degree less in each step; stable when each α is positive. Exact in fractions.
    Source: Åström, *Introduction to Stochastic Control Theory* (1970), section 5.2.

    >>> power([Fraction(2)], [Fraction(1), Fraction(3)])
    Fraction(2, 3)
    """
    a = list(den)
    b = [a[0] * 0] * (len(a) - 1 - len(num)) + list(num)
    total = a[0] * 0
    while len(a) > 1:
        if a[1] == 0 or a[0] / a[1] < 0:
            return None
        alpha, beta = a[0] / a[1], b[0] / a[1]
        total += beta * beta / (2 * alpha)
        odd = [c if k % 2 == 0 else c * 0 for k, c in enumerate(a[1:])]
        a = [c - alpha * o for c, o in zip(a[1:], [*odd[1:], odd[0] * 0], strict=True)]
        b = [c - beta * o for c, o in zip(b[1:], odd[1:], strict=True)]
    return total


def stable(den: Sequence[Fraction]) -> bool:
    """Whether all roots are in the left half-plane (Routh's criterion).

    >>> stable([Fraction(1), Fraction(0), Fraction(1)])
    False
    """
    return power([den[0] * 0], den) is not None if len(den) > 1 else True
