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
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from ctlabs import _check, shaping
from ctlabs._check import Array
from ctlabs.models import ContinuousModel

#: Roots: numpy returns real or complex ones.
Complex = Any
#: A root is on the imaginary axis when its real part is below this fraction of its size (double ones are known to √eps).
AXIS = 1e-7
#: The longest text and the largest exponent that are read.
LONGEST, LARGEST = 500, 20


@dataclass(frozen=True, slots=True, eq=False)
class Spectrum:
    """A rational power spectral density.

    Parameters
    ----------
    num, den : coefficients in descending powers of ω²

    Raises
    ------
    ValueError
        What no process has: a density that is negative somewhere or grows beyond all bounds (num of higher degree than
        den), and what is none: a pole at a real frequency, where the power is infinite.

    >>> S = Spectrum([10], [1, 25])
    >>> float(S(0.0)), float(S.power)
    (0.4, 1.0)
    """

    num: Array
    den: Array

    def __init__(self, num: ArrayLike, den: ArrayLike) -> None:
        top, bottom = (_trimmed(_check.shaped(name, p, ("terms",))) for name, p in (("num", num), ("den", den)))
        if not bottom.any():
            msg = "den: expected a polynomial other than 0, received 0"
            raise ValueError(msg)
        top, bottom = top / bottom[0], bottom / bottom[0]
        if len(top) > len(bottom):
            msg = (
                f"spectrum: expected a numerator of degree at most {len(bottom) - 1} in w^2, received degree "
                f"{len(top) - 1}: the density grows without bound"
            )
            raise ValueError(msg)
        for array in (top, bottom):
            array.setflags(write=False)
        object.__setattr__(self, "num", top)
        object.__setattr__(self, "den", bottom)
        factor(self)  # refuses what cannot be factorised

    def __call__(self, w: ArrayLike) -> Array:
        """S(ω) at ω in rad/s, any shape."""
        x = np.asarray(w, dtype=np.float64) ** 2
        return np.asarray(np.polyval(self.num, x) / np.polyval(self.den, x))

    def __add__(self, other: Spectrum) -> Spectrum:
        """The spectrum of the sum of two uncorrelated processes."""
        num = np.polyadd(np.polymul(self.num, other.den), np.polymul(other.num, self.den))
        return Spectrum(num, np.polymul(self.den, other.den))

    @property
    def floor(self) -> float:
        """S(∞), the strength of the white part."""
        return float(self.num[0]) if len(self.num) == len(self.den) else 0.0

    @property
    def power(self) -> float:
        """The variance of the process; ∞ with a white part."""
        if self.floor:
            return np.inf
        return _power(*factor(self))

    def through(self, num: ArrayLike, den: ArrayLike) -> Spectrum:
        """The spectrum behind a stable filter H(s) = num/den (descending powers of s): |H(jω)|²S(ω).

        >>> Spectrum([1], [1]).through([1], [1, 2]).den
        array([1., 4.])
        """
        top, bottom = _filter(num, den)
        return Spectrum(np.polymul(self.num, _squared(top)), np.polymul(self.den, _squared(bottom)))


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
        coefficients = sympy.Poly(part, w).all_coeffs()
        # Even as a whole: an odd factor common to both parts has been cancelled.
        if any(c != 0 for c in coefficients[-2::-2]):
            msg = f"text: expected an even function of {symbol}, received {text!r}"
            raise ValueError(msg)
        found.append([float(c) for c in coefficients[::-1][::2][::-1]])
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
    num, den = np.zeros(1, dtype=complex), np.ones(1, dtype=complex)
    for c, a in pairs:
        num = np.polyadd(np.polymul(num, [1, a * a]), 2 * a * c * den)
        den = np.polymul(den, [1, a * a])
    for name, p in (("num", num), ("den", den)):
        if np.abs(p.imag).max() > 1e-12 * np.abs(p).max():
            msg = f"terms: expected complex ones in conjugate pairs, received {pairs} ({name} is not real)"
            raise ValueError(msg)
    # Leading terms that cancel (Σ ac = 0: a process that can be differentiated) leave rounding.
    size = np.polyadd(*[np.abs(num)] * 2) / 2
    real = np.where(size > 1e-13 * np.abs(num).max(initial=0.0), num.real, 0.0)
    return Spectrum(real, den.real)


def white(strength: float) -> Spectrum:
    """White noise of a strength, unit²·s.

    >>> float(white(2.0)(100.0))
    2.0
    """
    if isinstance(strength, bool) or not np.isfinite(strength) or strength < 0:
        msg = f"strength: expected a number >= 0, received {strength!r}"
        raise ValueError(msg)
    return Spectrum([strength], [1])


def of(model: ContinuousModel, output: int = 0) -> Spectrum:
    """The spectrum of a stationary model's measurement, with the white part Rc (and N) if it has one.

    :func:`ctlabs.shaping.psd` gives the values of it without Rc; here it is the rational function.

    >>> of(shaping.gauss_markov(1.0, 0.2)).num
    array([10.])
    """
    _check.instance("model", model, ContinuousModel)
    shaping.psd(model, [], output)  # refuses unstable modes and outputs that do not exist, in its own words
    den = np.real(np.poly(model.F))
    markov, columns = [], model.G
    for _ in range(model.n):
        markov.append(model.H[output] @ columns)
        columns = model.F @ columns
    rows = [np.convolve(den, h)[: model.n] for h in np.array(markov).T]
    num = np.zeros(1)
    for i, p in enumerate(rows):
        for j, q in enumerate(rows):
            num = np.polyadd(num, model.Q[i, j] * np.polymul(p, _mirrored(q)))
    if model.Rc is not None:
        num = np.polyadd(num, model.Rc[output, output] * np.polymul(den, _mirrored(den)))
    if model.N is not None:
        for p, n in zip(rows, model.N[:, output], strict=True):
            num = np.polyadd(num, n * np.polyadd(np.polymul(p, _mirrored(den)), np.polymul(_mirrored(p), den)))
    return Spectrum(_without_noise(_in_square(num)), _squared(den))


def factor(spectrum: Spectrum) -> tuple[Array, Array]:
    r"""Spectral factorisation: H(s), stable and without zeros in the right half-plane, with |H(jω)|² = S(ω).

    Only |H| is in the spectrum; every other factor is this one times an all-pass, (s − b)/(s + b).

    Returns
    -------
    num, den : descending powers of s; den is monic, num[0] ≥ 0

    >>> factor(parse("(w^2+16)/(4*(w^2+4))"))
    (array([0.5, 2. ]), array([1., 2.]))
    """
    poles = np.roots(spectrum.den)
    for x in poles:
        if _on_axis(x):
            msg = (
                f"spectrum: expected no pole at a real frequency, received one at w = {np.sqrt(max(x.real, 0.0)):g}: "
                "a line or a drift has no rational density"
            )
            raise ValueError(msg)
    if not spectrum.num.any():
        return np.zeros(1), _polynomial(_left(poles))
    if spectrum.num[0] < 0:
        msg = "spectrum: expected a density >= 0 at every frequency, received a negative one for w → ∞"
        raise ValueError(msg)
    zeros = _zeros(np.roots(spectrum.num))
    return np.sqrt(spectrum.num[0]) * _polynomial(zeros), _polynomial(_left(poles))


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
    root, n = np.sqrt(_check.positive("strength", strength)), len(den) - 1
    if not n:
        msg = "spectrum: expected one with a pole (white noise needs no filter), received a constant"
        raise ValueError(msg)
    D = float(num[0]) if len(num) > n else 0.0
    direct = np.polysub(num, D * den) if D else num
    G = np.zeros((n, 1))
    tail = direct[-n:]
    G[n - len(tail) :, 0] = tail / root
    F = np.eye(n, k=1)
    F[:, 0] = -den[1:]
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
        _check.instance(name, spectrum, Spectrum)
    if signal.floor:
        msg = f"signal: expected a finite power, received a white part of strength {signal.floor:g}"
        raise ValueError(msg)
    total = signal + noise
    if not total.num.any():
        msg = "signal, noise: expected one that is not zero, received neither"
        raise ValueError(msg)
    B, _ = factor(total)
    A_s, A_n = factor(signal)[1], factor(noise)[1]
    zeros = np.roots(B)
    if (np.abs(zeros.real) <= AXIS * np.abs(zeros)).any():
        w = np.abs(zeros[np.abs(zeros.real) <= AXIS * np.abs(zeros)].imag).min()
        msg = f"signal, noise: expected power at every frequency, received none at w = {w:g}"
        raise ValueError(msg)
    # N_s(s)A_n(−s) = C(s)B(−s) + E(s)A_s(s): C/A_s is the causal part.
    right = np.polymul(_in_s(signal.num), _mirrored(A_n))
    C = _diophantine(_mirrored(B), A_s, right)
    lead = B[0]
    num, den = np.polymul(C, A_n) / lead, B / lead
    num = _trimmed(_without_noise(num))
    return Wiener(num, den, mean_square_error(num, den, signal, noise))


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
    top, bottom = _filter(num, den)
    total = 0.0
    for through, spectrum in ((_trimmed(np.polysub(bottom, top)), signal), (top, noise)):
        b, a = factor(spectrum)
        upper, lower = np.polymul(through, b), np.polymul(bottom, a)
        upper = _trimmed(np.where(np.abs(upper) > 1e-14 * np.abs(upper).max(initial=0.0), upper, 0.0))
        if len(upper) >= len(lower) and upper.any():
            msg = "num, den: expected a filter that white noise does not pass unattenuated, received an infinite error"
            raise ValueError(msg)
        total += _power(upper, lower)
    return total


# Polynomials: descending powers; those in x = ω² become even ones in s by x = −s².


def _trimmed(p: Array) -> Array:
    """Without leading zeros; 0 is [0]."""
    p = np.trim_zeros(np.asarray(p, dtype=np.float64), "f")
    return p if p.size else np.zeros(1)


def _without_noise(p: Array) -> Array:
    """Leading coefficients at the rounding level are zero."""
    size = np.abs(p).max(initial=0.0)
    significant = np.flatnonzero(np.abs(p) > 1e-13 * size)
    start = int(significant[0]) if significant.size else 0
    return np.where(np.arange(len(p)) < start, 0.0, p)


def _mirrored(p: Array) -> Array:
    """p(−s)."""
    return np.where((np.arange(len(p))[::-1] % 2).astype(bool), -p, p)


def _in_square(p: Array) -> Array:
    """An even polynomial in s as one in ω² = −s²."""
    even = p[::-1][::2][::-1]
    return _mirrored(even)


def _in_s(p: Array) -> Array:
    """A polynomial in ω² as one in s."""
    even = _mirrored(p)
    wide = np.zeros(2 * len(p) - 1)
    wide[::2] = even
    return wide


def _squared(p: Array) -> Array:
    """|p(jω)|² as a polynomial in ω²."""
    return _in_square(np.polymul(p, _mirrored(p)))


def _polynomial(roots: Complex) -> Array:
    return np.atleast_1d(np.real(np.poly(roots)))


def _filter(num: ArrayLike, den: ArrayLike) -> tuple[Array, Array]:
    """The polynomials of a stable filter."""
    top, bottom = (_trimmed(_check.shaped(name, p, ("terms",))) for name, p in (("num", num), ("den", den)))
    poles = np.roots(bottom)
    if not bottom.any() or len(top) > len(bottom) or (poles.real >= 0).any():
        msg = f"num, den: expected a stable proper filter, received the poles {poles.tolist()}"
        raise ValueError(msg)
    return top / bottom[0], bottom / bottom[0]


def _left(x: Complex) -> Complex:
    """The roots s of s² = −x in the left half-plane."""
    return -np.sqrt(-x.astype(complex))


def _on_axis(x: complex) -> bool:
    s = np.sqrt(complex(-x))
    return bool(abs(s.real) <= AXIS * abs(s))


def _zeros(x: Complex) -> Complex:
    """Zeros of the factor from those of S in ω²; at a real frequency S only touches zero, so they come in pairs."""
    axis = np.array([_on_axis(value) and value != 0 for value in x], dtype=bool)
    touching = np.sort(x[axis].real)
    gaps = touching[1::2] - touching[::2] if len(touching) % 2 == 0 else np.array([np.inf])
    if (gaps > 1e-5 * np.abs(touching[-1:])).any():
        msg = (
            "spectrum: expected a density >= 0 at every frequency, received one that changes its sign at w = "
            f"{np.sqrt(abs(touching[0])):g}"
        )
        raise ValueError(msg)
    middle = 1j * np.sqrt(np.abs(0.5 * (touching[::2] + touching[1::2])))
    return np.concatenate([_left(x[~axis]), middle, -middle])


def _diophantine(P: Array, A: Array, right: Array) -> Array:
    """C of C·P + E·A = right with deg C < deg A, by the coefficients; P and A have no common root."""
    n, m = len(A) - 1, max(len(P) - 1, len(right) - len(A) + 1)
    size = n + m
    if not n:
        return np.zeros(1)
    columns = [_shifted(P, j, size) for j in range(n)] + [_shifted(A, j, size) for j in range(m)]
    matrix = np.array(columns).T
    scale = np.abs(matrix).max(axis=0)
    solved = np.linalg.solve(matrix / scale, np.pad(right, (size - len(right), 0))) / scale
    return solved[:n][::-1]


def _shifted(p: Array, j: int, size: int) -> Array:
    """The coefficients of sʲp(s), padded to ``size`` (descending)."""
    wide = np.concatenate([p, np.zeros(j)])
    return np.pad(wide, (size - len(wide), 0))


def _power(num: Array, den: Array) -> float:
    """(1/2π)∫|num/den|²dω of a stable strictly proper filter: Lyapunov's equation of a companion form."""
    n = len(den) - 1
    if not n or not num.any():
        return 0.0
    # Time in units of the geometric mean of the poles, so that the companion form is balanced.
    rate = abs(den[-1] / den[0]) ** (1 / n)
    den = den / den[0] / rate ** np.arange(n + 1)
    num = np.pad(num, (n - len(num), 0)) / rate ** np.arange(1, n + 1)
    F = np.eye(n, k=1)
    F[:, 0] = -den[1:]
    P = scipy.linalg.solve_continuous_lyapunov(F, -np.outer(num, num))
    return float(P[0, 0] * rate)


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
