r"""Rational spectra: from a power spectral density to a shaping filter, and to the causal Wiener filter.

.. math:: S(\omega) = \frac{n(\omega^2)}{d(\omega^2)} = |H(j\omega)|^2, \qquad
          \psi(\tau) = \sum_ic_ie^{-a_i|\tau|} \;\Leftrightarrow\; S = \sum_i\frac{2a_ic_i}{\omega^2+a_i^2}

Spectra are two-sided, unit²·s, so that the variance is :math:`\frac1{2\pi}\int S\,d\omega`. A spectrum is given by coefficients
(:class:`Spectrum`), text (:func:`parse`), an autocorrelation (:func:`exponentials`), a strength (:func:`white`) or a model
(:func:`of`). :func:`factor` finds the one stable H without zeros in the right half-plane; :func:`shaping_filter` makes a
model of it, whose output has that spectrum; :func:`wiener` finds the best causal filter for a signal in noise.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.linalg import checks
from ctlabs.linalg import polynomials as poly
from ctlabs.linalg.checks import Array
from ctlabs.linalg.companion import companion, double
from ctlabs.linalg.polynomials import Polynomial
from ctlabs.linalg.resolvent import polynomials
from ctlabs.models import ContinuousModel, shaping

#: The longest text and the largest exponent that are read.
LONGEST, LARGEST = 500, 20


@dataclass(frozen=True, slots=True, eq=False)
class Spectrum:
    """A rational power spectral density.

    Parameters
    ----------
    num, den : coefficients in descending powers of ω²: numbers, or fractions, which are kept as they are
    rounded : whether they are known to their rounding alone; numbers are unless said otherwise, fractions are not

    Raises
    ------
    ValueError
        What no process has: a density that is negative somewhere or grows beyond all bounds (num of higher degree than
        den), and what is none: a pole at a real frequency, where the power is infinite. With rounded coefficients a
        density that falls below zero by less than the rounding of its own terms touches zero, and a denominator that is
        not above it may have an undamped line.

    >>> S = Spectrum([10], [1, 25])
    >>> float(S(0.0)), float(S.power)
    (0.4, 1.0)
    """

    num: Array
    den: Array
    exact: tuple[tuple[Fraction, ...], tuple[Fraction, ...]] = field(repr=False)
    slack: Fraction = field(repr=False)

    def __init__(
        self,
        num: ArrayLike | Sequence[Fraction],
        den: ArrayLike | Sequence[Fraction],
        *,
        rounded: bool | None = None,
    ) -> None:
        if rounded is None:
            rounded = not (_are_fractions(num) and _are_fractions(den))
        top, bottom = (_coefficients(name, p) for name, p in (("num", num), ("den", den)))
        if not bottom[0]:
            msg = "den: expected a polynomial other than 0, received 0"
            raise ValueError(msg)
        if len(top) > len(bottom):
            msg = (
                f"spectrum: expected a numerator of degree at most {len(bottom) - 1} in w^2, received degree "
                f"{len(top) - 1}: the density grows without bound"
            )
            raise ValueError(msg)
        object.__setattr__(self, "exact", tuple(tuple(c / bottom[0] for c in p) for p in (top, bottom)))
        object.__setattr__(self, "slack", poly.ROUNDING if rounded else Fraction(0))
        for name, p in zip(("num", "den"), self.exact, strict=True):
            array = np.array([double(name, c) for c in p])
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        _no_line(self.exact[1], self.slack)
        _nowhere_negative(self.exact[0], self.slack)

    def __call__(self, w: ArrayLike) -> Array:
        """S(ω) at ω in rad/s, any shape."""
        x = np.asarray(w, dtype=np.float64) ** 2
        return np.asarray(np.polyval(self.num, x) / np.polyval(self.den, x))

    def __add__(self, other: Spectrum) -> Spectrum:
        """The spectrum of the sum of two uncorrelated processes."""
        den = poly.times(self.exact[1], other.exact[1])
        return Spectrum(_total(self, other), den, rounded=bool(self.slack or other.slack))

    @property
    def floor(self) -> float:
        """S(∞), the strength of the white part."""
        return float(self.num[0]) if len(self.num) == len(self.den) else 0.0

    @property
    def power(self) -> float:
        """The variance of the process; ∞ with a white part."""
        if self.floor:
            return np.inf
        return float(poly.power(*_factors(self)))

    def through(self, num: ArrayLike, den: ArrayLike) -> Spectrum:
        """The spectrum behind a stable filter H(s) = num/den (descending powers of s): |H(jω)|²S(ω).

        >>> Spectrum([1], [1]).through([1], [1, 2]).den
        array([1., 4.])
        """
        top, bottom = (poly.times(own, poly.squared(p)) for own, p in zip(self.exact, _filter(num, den), strict=True))
        return Spectrum(top, bottom, rounded=bool(self.slack))


class Wiener(NamedTuple):
    """A causal filter: ``num``, ``den`` in descending powers of s, ``mse`` the mean square of its error, unit²."""

    num: Array
    den: Array
    mse: float


def parse(text: str, symbol: str = "w") -> Spectrum:
    """A spectrum from a rational expression in the frequency; common factors are cancelled exactly.

    Parameters
    ----------
    text : numbers, the symbol, + - * / ** ^ and parentheses
    symbol : name of the frequency

    Raises
    ------
    ValueError
        Text of another kind, an expression that is not even in the frequency, and whatever :class:`Spectrum` refuses.

    >>> S = parse("5/2*(w^2+16)/((w^2+4)*(w^2+25))")
    >>> S.num, S.den
    (array([ 2.5, 40. ]), array([  1.,  29., 100.]))
    """
    import sympy

    if not isinstance(text, str) or len(text) > LONGEST:
        msg = f"text: expected a rational expression in {symbol}, received {text!r:.60}"
        raise ValueError(msg)
    w = sympy.Symbol(symbol)
    try:
        tree = ast.parse(text.strip().replace("^", "**"), mode="eval").body
        expression = sympy.cancel(sympy.together(_expression(tree, symbol, w, text)))
    except (SyntaxError, ZeroDivisionError, RecursionError, MemoryError):
        msg = f"text: expected a rational expression in {symbol}, received {text!r}"
        raise ValueError(msg) from None
    if expression.has(sympy.nan, sympy.zoo, sympy.oo):
        msg = f"text: expected a rational expression in {symbol}, received a division by zero in {text!r}"
        raise ValueError(msg)
    found = []
    for part in sympy.fraction(expression):
        coefficients = [Fraction(int(c.p), int(c.q)) for c in sympy.Poly(part, w).all_coeffs()]
        # Even as a whole: an odd factor common to both parts has been cancelled.
        if any(c != 0 for c in coefficients[-2::-2]):
            msg = f"text: expected an even function of {symbol}, received {text!r}"
            raise ValueError(msg)
        found.append(coefficients[::-1][::2][::-1])
    return Spectrum(*found)


def exponentials(terms: Iterable[tuple[complex, complex]]) -> Spectrum:
    r"""The spectrum of an autocorrelation :math:`\sum_ic_ie^{-a_i|\tau|}`.

    Parameters
    ----------
    terms : pairs (c, a), Re a > 0; complex ones in conjugate pairs (a damped cosine)

    Raises
    ------
    ValueError
        No terms, a term that does not decay, a sum that is not real, or no autocorrelation at all (S < 0 somewhere).

    >>> exponentials([(1.0, 5.0)]).num, exponentials([(1.0, 5.0)]).den
    (array([10.]), array([ 1., 25.]))
    """
    pairs = [(complex(c), complex(a)) for c, a in terms]
    if not pairs or not all(np.isfinite([c, a]).all() and a.real > 0 for c, a in pairs):
        msg = f"terms: expected pairs (c, a) with a of positive real part, received {pairs}"
        raise ValueError(msg)
    num, size, den = _sum_of_exponentials(pairs)
    for name, p, terms in (("num", num, size), ("den", den, [abs(c) for c in den])):
        if any(abs(c.imag) > 1e-12 * t for c, t in zip(p, terms, strict=True)):
            msg = f"terms: expected complex ones in conjugate pairs, received {pairs} ({name} is not real)"
            raise ValueError(msg)
    # Leading terms that cancel (Σ ac = 0: a process that can be differentiated) leave rounding.
    real = poly.without_rounding([c.real for c in num], size)
    return Spectrum([float(c) for c in real], [float(c.real) for c in den])


def _sum_of_exponentials(pairs: Sequence[tuple[complex, complex]]) -> tuple[Polynomial, Polynomial, Polynomial]:
    """Numerator, the sum of its terms' magnitudes, and denominator in ω², complex numbers of mpmath."""
    import mpmath

    with mpmath.workdps(poly.DIGITS):
        zero, one = mpmath.mpc(0), mpmath.mpc(1)
        num, size, den = [zero], [zero], [one]
        for c, a in ((mpmath.mpmathify(c), mpmath.mpmathify(a)) for c, a in pairs):
            term = [2 * a * c * d for d in den]
            size = poly.plus(poly.times(size, [one, abs(a * a)]), [abs(t) for t in term])
            num = poly.plus(poly.times(num, [one, a * a]), term)
            den = poly.times(den, [one, a * a])
    return num, [t.real for t in size], den


def white(strength: float) -> Spectrum:
    """White noise of a strength, unit²·s.

    >>> float(white(2.0)(100.0))
    2.0
    """
    if isinstance(strength, bool) or not np.isfinite(strength) or strength < 0:
        msg = f"strength: expected a number >= 0, received {strength!r}"
        raise ValueError(msg)
    return Spectrum([Fraction(float(strength))], [Fraction(1)])


def of(model: ContinuousModel, output: int = 0) -> Spectrum:
    """The spectrum of a stationary model's measurement, with the white part Rc (and N) if it has one.

    :func:`ctlabs.models.shaping.psd` gives the values of it without Rc; here it is the rational function.

    >>> of(shaping.gauss_markov(1.0, 0.2)).num
    array([10.])
    """
    checks.instance("model", model, ContinuousModel)
    shaping.psd(model, [], output)  # refuses unstable modes and outputs that do not exist, in its own words
    rows, den = [], [Fraction(1)]
    for column in model.G.T:
        row, den = polynomials(model.F, column, model.H[output])
        rows.append(row)
    # Σ Q_ij p_i(s)p_j(−s) + Rc a(s)a(−s) + Σ N_i (p_i(s)a(−s) + a(s)p_i(−s)), and the magnitudes of what is added.
    terms = [(Q, rows[i], rows[j]) for (i, j), Q in np.ndenumerate(model.Q) if Q]
    if model.Rc is not None:
        terms.append((model.Rc[output, output], den, den))
    if model.N is not None:
        terms += [(N, *pair) for N, p in zip(model.N[:, output], rows, strict=True) for pair in ((p, den), (den, p))]
    num, size = [Fraction(0)], [Fraction(0)]
    for factor_, p, q in terms:
        weight, product = Fraction(float(factor_)), poly.times(p, poly.mirrored(q))
        num = poly.plus(num, [weight * c for c in product])
        size = poly.plus(size, [abs(weight) * c for c in poly.times([abs(c) for c in p], [abs(c) for c in q])])
    num = poly.without_rounding(poly.in_square(num), [abs(c) for c in poly.in_square(size)])
    return Spectrum(num, poly.squared(den), rounded=True)


def factor(spectrum: Spectrum) -> tuple[Array, Array]:
    r"""Spectral factorisation: H(s), stable and without zeros in the right half-plane, with |H(jω)|² = S(ω).

    Only |H| is in the spectrum; every other factor is this one times an all-pass, (s − b)/(s + b).

    Returns
    -------
    num, den : descending powers of s; den is monic, num[0] ≥ 0

    A zero of order 2k on the axis of S becomes one of order k. The rounding of coefficients parts such zeros by its 2k-th root,
    in S and therefore here; |H|² is S all the same.

    >>> factor(parse("(w^2+16)/(4*(w^2+4))"))
    (array([0.5, 2. ]), array([1., 2.]))
    """
    num, den = _factors(spectrum)
    return np.array([float(c) for c in num]), np.array([float(c) for c in den])


def shaping_filter(
    spectrum: Spectrum, strength: float = 1.0, *, name: str = "coloured", unit: str = ""
) -> ContinuousModel:
    r"""The model whose output has a given spectrum: white noise of the given strength through the factor H(s).

    .. math:: y = x_1 \; (+\; D\,w), \quad F = \begin{bmatrix}-a_1 & 1 & \\ \vdots & & 1 \\ -a_n & 0 & 0\end{bmatrix}

    (observable form). A white part of the spectrum becomes Rc and N, since it is the same noise. P0 is stationary.

    Parameters
    ----------
    spectrum : with at least one pole
    strength : of the white noise, unit²·s, > 0
    name, unit : of the first state

    >>> shaping_filter(exponentials([(5.0, 10.0)])).P0.round(12)
    array([[5.]])
    """
    num, den = factor(spectrum)
    root, n = np.sqrt(checks.positive("strength", strength)), len(den) - 1
    if not n:
        msg = "spectrum: expected one with a pole (white noise needs no filter), received a constant"
        raise ValueError(msg)
    F, G, _, direct = companion([num], den)
    G, D = G / root, float(direct[0, 0])
    model = ContinuousModel(
        F,
        G,
        [[strength]],
        np.eye(1, n),
        P0=np.zeros((n, n)),
        Rc=[[D * D]] if D else None,
        N=[[D * root]] if D else None,
        states=[name, *(f"{name}_{i}" for i in range(2, n + 1))],
        measurements=[name],
        units=[unit, *("" for _ in range(n - 1))],
    )
    P0 = shaping.stationary_covariance(model)
    return ContinuousModel(
        F, G, [[strength]], np.eye(1, n), P0=P0, Rc=model.Rc, N=model.N, states=model.states,
        measurements=model.measurements, units=model.units,
    )  # fmt: skip


def wiener(signal: Spectrum, noise: Spectrum) -> Wiener:
    r"""The causal filter that estimates a signal from signal + noise, uncorrelated, with the least mean square error.

    .. math:: H = \frac1\Psi\left[\frac{S_s}{\Psi(-s)}\right]_+, \qquad S_s + S_n = \Psi(s)\Psi(-s)

    The part of the bracket with poles in the left half-plane comes from a linear equation between polynomials. Factors
    common to num and den (equal poles of signal and noise) are left in.

    Parameters
    ----------
    signal : of finite power (no white part)
    noise : white, coloured or a sum of both

    Raises
    ------
    ValueError
        A signal with a white part; signal + noise without power at some frequency, where no filter is best.

    Source: Wiener (1949); Kailath, Sayed & Hassibi, *Linear Estimation* (2000), section 7.3.

    >>> num, den, mse = wiener(parse("5/12/(w^2+4)"), parse("7/12/(w^2+16)"))
    >>> num.round(9), den.round(9), round(24 * mse, 9)
    (array([0.5, 2. ]), array([1., 3.]), 1.0)
    """
    for name, spectrum in (("signal", signal), ("noise", noise)):
        checks.instance(name, spectrum, Spectrum)
    if signal.floor:
        msg = f"signal: expected a finite power, received a white part of strength {signal.floor:g}"
        raise ValueError(msg)
    total, slack = poly.trimmed(_total(signal, noise)), max(signal.slack, noise.slack)
    if not total[0]:
        msg = "signal, noise: expected one that is not zero, received neither"
        raise ValueError(msg)
    silent = poly.touching(total, slack)
    if silent:
        msg = f"signal, noise: expected power at every frequency, received none at w = {_frequency(*silent)}"
        raise ValueError(msg)
    import mpmath

    with mpmath.workdps(poly.DIGITS):
        B, A_s, A_n = _half(tuple(total)), _factors(signal)[1], _factors(noise)[1]
        # N_s(s)A_n(−s) = C(s)B(−s) + E(s)A_s(s): C/A_s is the causal part.
        right = poly.times(poly.in_s(poly.digits(signal.exact[0])), poly.mirrored(A_n))
        C = _diophantine(poly.mirrored(B), A_s, right)
        # H is bounded: terms of C that would make it improper are 0 but for rounding.
        num = poly.times(C, A_n)[-len(B) :]
        num, den = [c / B[0] for c in num], [c / B[0] for c in B]
        mse = float(_error(num, den, signal, noise))
    return Wiener(_trimmed(np.array([float(c) for c in num])), np.array([float(c) for c in den]), mse)


def mean_square_error(num: ArrayLike, den: ArrayLike, signal: Spectrum, noise: Spectrum) -> float:
    r"""The mean square error of any stable filter num/den: :math:`\frac1{2\pi}\int|1-H|^2S_s + |H|^2S_n\,d\omega`.

    Raises
    ------
    ValueError
        An unstable filter, or one that passes white noise through (infinite power).

    >>> S, N = parse("5/12/(w^2+4)"), parse("7/12/(w^2+16)")
    >>> round(384 * mean_square_error([0.5, 2], [1, 2], S, N), 9)
    19.0
    """
    import mpmath

    with mpmath.workdps(poly.DIGITS):
        top, bottom = (poly.digits(p) for p in _filter(num, den))
        return float(_error(top, bottom, signal, noise))


def _error(top: Polynomial, bottom: Polynomial, signal: Spectrum, noise: Spectrum) -> Any:
    total = 0
    for through, spectrum in ((poly.plus(bottom, [-c for c in top]), signal), (top, noise)):
        b, a = _factors(spectrum)
        upper, lower = poly.trimmed(poly.times(poly.trimmed(through), b)), poly.times(bottom, a)
        if len(upper) >= len(lower) and upper[0]:
            msg = "num, den: expected a filter that white noise does not pass unattenuated, received an infinite error"
            raise ValueError(msg)
        total += poly.power(upper, lower) if len(lower) > 1 else 0
    return total


# A spectrum and its factor ---------------------------------------------------------------------------------------------


def _no_line(den: Sequence[Fraction], slack: Fraction) -> None:
    """Refuse a denominator that is zero at a real frequency, or not above the rounding of its own terms."""
    near = poly.touching(den, slack)
    if near and (not slack or not den[-1] or poly.negative(den, slack)):
        where = math.sqrt(max(x.real for x in poly.roots(den) if x.imag == 0))
        msg = (
            f"spectrum: expected no pole at a real frequency, received one at w = {where:g}: "
            "a line or a drift has no rational density"
        )
        raise ValueError(msg)
    if near:
        where = math.sqrt((near[0] + near[1]) / 2)
        msg = (
            "spectrum: expected a damping above the precision of the coefficients, received a denominator that is zero at "
            f"w = {where:.6g} to the rounding of its terms: a resonance with less damping looks like an undamped "
            "line, which has no rational density"
        )
        raise ValueError(msg)


def _nowhere_negative(num: Sequence[Fraction], slack: Fraction) -> None:
    """Refuse a density that is negative by more than the rounding of its terms."""
    found = poly.negative(num, slack)
    if found:
        where = "for w → ∞" if found[1] is None else f"at w = {_frequency(*found)}"
        msg = f"spectrum: expected a density >= 0 at every frequency, received a negative one {where}"
        raise ValueError(msg)


def _frequency(low: Fraction, high: Fraction | None) -> str:
    """A frequency whose square is between two numbers, with as many digits as that takes."""
    high = 4 * low + 1 if high is None else high
    if low == high:
        return f"{math.sqrt(low):g}"
    middle = math.sqrt((low + high) / 2)
    texts = (f"{middle:.{digits}g}" for digits in range(3, 18))
    return next((text for text in texts if low < Fraction(text) ** 2 < high), f"{middle!r}")


def _factors(spectrum: Spectrum) -> tuple[Polynomial, Polynomial]:
    """H = num/den with the digits of mpmath."""
    num, den = spectrum.exact
    return _half(_raised(num, spectrum.slack)), _half(den)


def _raised(num: tuple[Fraction, ...], slack: Fraction) -> tuple[Fraction, ...]:
    """A numerator that rounding has made negative, with the least part of the slack that makes it nonnegative."""
    share = Fraction(0)
    while share < slack and poly.negative(num, share):
        share = min(2 * share, slack) or Fraction(1, 2**54)
    return tuple(c + share * abs(c) for c in num)


@lru_cache(maxsize=64)
def _half(p: tuple[Fraction, ...]) -> Polynomial:
    """The polynomial h(s) without zeros in the right half-plane for which |h(jω)|² = p(ω²), p ≥ 0."""
    import mpmath

    with mpmath.workdps(poly.DIGITS):
        roots = poly.roots(p)
        touching = sorted(x.real for x in roots if x.imag == 0 and x.real > 0)
        zeros = [-mpmath.sqrt(-x) for x in roots if x.imag != 0 or x.real <= 0]
        # Where p touches zero its roots are double: one of each pair goes to h(s), the other to h(−s).
        zeros += [sign * 1j * mpmath.sqrt(x) for x in touching[::2] for sign in (1, -1)]
        h = [mpmath.sqrt(poly.digits(p)[0])]
        for zero in zeros:
            h = poly.times(h, [1, -zero])
        return [mpmath.re(c) for c in h]


def _total(signal: Spectrum, noise: Spectrum) -> Polynomial:
    """The numerator of the sum of two spectra over the product of their denominators, exact."""
    (n, d), (m, e) = signal.exact, noise.exact
    return poly.plus(poly.times(n, e), poly.times(m, d))


def _are_fractions(p: Any) -> bool:
    return isinstance(p, list | tuple) and len(p) > 0 and all(isinstance(c, Fraction) for c in p)


def _coefficients(name: str, p: Any) -> Polynomial:
    """Numbers as fractions, without leading zeros."""
    if _are_fractions(p):
        return poly.trimmed(p)
    return poly.trimmed(poly.exact(checks.shaped(name, p, ("terms",)).tolist()))


def _trimmed(p: Array) -> Array:
    """Without leading zeros; 0 is [0]."""
    p = np.trim_zeros(p, "f")
    return p if p.size else np.zeros(1)


def _filter(num: ArrayLike, den: ArrayLike) -> tuple[Polynomial, Polynomial]:
    """The polynomials of a stable filter."""
    top, bottom = (_coefficients(name, p) for name, p in (("num", num), ("den", den)))
    if not bottom[0] or len(top) > len(bottom) or not poly.stable(bottom):
        poles = np.roots([float(c) for c in bottom])
        msg = f"num, den: expected a stable proper filter, received the poles {poles.tolist()}"
        raise ValueError(msg)
    return [c / bottom[0] for c in top], [c / bottom[0] for c in bottom]


def _diophantine(P: Polynomial, A: Polynomial, right: Polynomial) -> Polynomial:
    """C of C·P + E·A = right with deg C < deg A, by the coefficients; P and A have no common root."""
    import mpmath

    n, m = len(A) - 1, max(len(P) - 1, len(right) - len(A) + 1)
    size = n + m
    if not n:
        return [mpmath.mpf(0)]
    columns = [_shifted(P, j, size) for j in range(n)] + [_shifted(A, j, size) for j in range(m)]
    solved = mpmath.lu_solve(mpmath.matrix(columns).T, mpmath.matrix(_shifted(right, 0, size)))
    return list(solved)[:n][::-1]


def _shifted(p: Polynomial, j: int, size: int) -> Polynomial:
    """The coefficients of sʲp(s), padded to ``size`` (descending)."""
    return [0] * (size - len(p) - j) + p + [0] * j


def _expression(node: ast.AST, symbol: str, w: Any, text: str) -> Any:
    """A sympy expression from a syntax tree of numbers, the symbol and arithmetic; nothing is evaluated."""
    import sympy

    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        return sympy.Rational(repr(node.value))
    if isinstance(node, ast.Name) and node.id == symbol:
        return w
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.UAdd | ast.USub):
        value = _expression(node.operand, symbol, w, text)
        return -value if isinstance(node.op, ast.USub) else value
    if isinstance(node, ast.BinOp):
        left, right = (_expression(side, symbol, w, text) for side in (node.left, node.right))
        if isinstance(node.op, ast.Add):
            return left + right
        if isinstance(node.op, ast.Sub):
            return left - right
        if isinstance(node.op, ast.Mult):
            return left * right
        if isinstance(node.op, ast.Div):
            return left / right
        if isinstance(node.op, ast.Pow) and right.is_Integer and abs(right) <= LARGEST:
            return left**right
    msg = f"text: expected numbers, {symbol}, + - * / ^ and parentheses, received {text!r}"
    raise ValueError(msg)
