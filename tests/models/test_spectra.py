"""Spectral factorisation and the Wiener filter, against state space, quadrature and each other."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

import hypothesis.strategies as st
import mpmath
import numpy as np
import pytest
import scipy.integrate
from hypothesis import assume, given, settings
from numpy.typing import NDArray

from ctlabs.filtering import bucy, reduced
from ctlabs.models import ContinuousModel, shaping, spectra
from ctlabs.models.spectra import Spectrum
from tests.reference import EXACT, SOLVER, broken, close
from tests.strategies import continuous_models, seeds

pytestmark = pytest.mark.numerical

Array = NDArray[Any]
W = np.array([0.0, 0.1, 0.7, 1.0, 3.0, 10.0, 100.0])


def response(num: Any, den: Any, w: Any = W) -> Array:
    """H(jω)."""
    s = 1j * np.asarray(w)
    return np.polyval(num, s) / np.polyval(den, s)


@st.composite
def minimum_phase(draw: st.DrawFn, *, direct: bool | None = None) -> tuple[Array, Array]:
    """A stable transfer function with zeros in the left half-plane, real ones and pairs."""
    n = draw(st.integers(1, 4))
    biproper = draw(st.booleans()) if direct is None else direct
    m = n if biproper else draw(st.integers(0, n - 1))
    rng = np.random.default_rng(draw(seeds))

    def polynomial(degree: int) -> Array:
        p = np.ones(1)
        while degree >= 2 and rng.random() < 0.5:
            w0 = rng.uniform(0.3, 5.0)
            p, degree = np.polymul(p, [1, 2 * rng.uniform(0.1, 0.95) * w0, w0**2]), degree - 2
        return np.polymul(p, np.poly(-rng.uniform(0.2, 5.0, size=degree)))

    return rng.uniform(0.3, 3.0) * polynomial(m), polynomial(n)


@given(minimum_phase())
def test_the_factor_of_a_squared_magnitude_is_the_function_itself(h: tuple[Array, Array]) -> None:
    """H → |H|² → H, and |H(jω)|² = S(ω)."""
    num, den = h
    S = spectra.white(1.0).through(num, den)
    assert close(S(W), np.abs(response(num, den)) ** 2, SOLVER)
    top, bottom = spectra.factor(S)
    assert close(top, num, 1e-6)
    assert close(bottom, den, 1e-6)
    assert close(np.abs(response(top, bottom)) ** 2, S(W), SOLVER)
    assert not close(np.abs(response(broken(top), bottom)) ** 2, S(W), 1e-4)


@given(minimum_phase())
def test_zeros_on_the_wrong_side_are_mirrored(h: tuple[Array, Array]) -> None:
    """All-pass factors leave the spectrum as it is: a box with its zeros mirrored has the same factor."""
    num, den = h
    mirrored = num * (-1.0) ** np.arange(len(num))
    S, other = spectra.white(2.0).through(num, den), spectra.white(2.0).through(mirrored, den)
    assert close(S(W), other(W), SOLVER)
    assert close(spectra.factor(other)[0], np.sqrt(2) * num, 1e-6)


@given(minimum_phase(), st.floats(0.1, 10.0))
def test_the_shaping_filter_has_the_spectrum(h: tuple[Array, Array], strength: float) -> None:
    """|H|² against shaping.psd of the realisation (plus Rc and the cross term), whatever the strength of its noise."""
    num, den = h
    S = spectra.white(1.0).through(num, den)
    block = spectra.shaping_filter(S, strength, unit="V")
    assert close(spectra.of(block)(W), S(W), SOLVER)
    if block.Rc is None:
        assert close(shaping.psd(block, W), S(W), SOLVER)
        assert close(block.P0[0, 0], S.power, SOLVER)
        wrong = replace(block, F=broken(block.F))
        assert not close(shaping.psd(wrong, W), S(W), 1e-6)
    else:
        assert np.isinf(S.power)
        assert close(block.Rc, [[S.floor]], SOLVER)
        # As an input of a plant: white and coloured part are one noise.
        plant = ContinuousModel([[-1]], [[1]], [[1]], [[1]], P0=[[1]])
        assert close(shaping.psd(shaping.augment(plant, block), W), S(W) / (1 + W**2), SOLVER)
    assert close(shaping.stationary_covariance(block), block.P0, SOLVER)


@given(continuous_models(stable=True))
def test_the_way_back_is_the_spectrum_of_the_model(model: ContinuousModel) -> None:
    """A state-space output as a rational function: equal to shaping.psd, with Rc and N to the direct formula."""
    for output in range(model.m):
        bare = replace(model, Rc=None, N=None)
        assert close(spectra.of(bare, output)(W), shaping.psd(bare, W, output), 1e-6)
        assert model.Rc is not None
        N = np.zeros((model.s, model.m)) if model.N is None else model.N
        joint = []
        for w in W:
            g = np.linalg.solve(1j * w * np.eye(model.n) - model.F, model.G)
            h = model.H[output] @ g
            joint.append((h @ model.Q @ h.conj() + 2 * (h @ N[:, output]).real + model.Rc[output, output]).real)
        assert close(spectra.of(model, output)(W), joint, 1e-6)


@pytest.mark.parametrize(
    "terms",
    [
        [(5.0, 10.0)],
        [(2.0, 1.0), (1.0, 3.0)],
        [(2.0, 1.0), (-0.4, 3.0)],
        [(0.5, 0.3 + 2j), (0.5, 0.3 - 2j)],
        [(2.0, 1.0), (-1.0, 2.0)],
    ],
    ids=["one", "two", "difference", "damped cosine", "smooth"],
)
def test_sums_of_exponentials(terms: list[tuple[complex, complex]]) -> None:
    """The spectrum of Σ c e^(−a|τ|) is its Fourier integral, and its filter's output has that autocorrelation."""
    S = spectra.exponentials(terms)
    tau = np.linspace(-3, 3, 13)
    psi = sum(c * np.exp(-a * np.abs(tau)) for c, a in terms)
    block = spectra.shaping_filter(S)
    assert close(shaping.autocorrelation(block, tau), np.real(psi), SOLVER)
    assert close(S.power, sum(complex(c).real for c, _ in terms), SOLVER)

    def integrand(t: float, w: float) -> float:
        return float(2 * np.cos(w * t) * np.real(sum(c * np.exp(-a * t) for c, a in terms)))

    for w in (0.0, 1.3):
        assert close(S(w), scipy.integrate.quad(integrand, 0, 80, args=(w,), limit=500)[0], 1e-7)


def test_text_is_read_exactly() -> None:
    """Products, powers, decimals, signs; common factors are cancelled, also odd ones."""
    S = spectra.parse("10/(w^2+25)")
    assert (S.num.tolist(), S.den.tolist()) == ([10.0], [1.0, 25.0])
    S = spectra.parse("0.1*w**2*(w^2+1)/((w^2+1)*(2*w^4 + 3))")
    assert (S.num.tolist(), S.den.tolist()) == ([0.05, 0.0], [1.0, 0.0, 1.5])
    assert spectra.parse("w/(w*(w^2+4))").den.tolist() == [1.0, 4.0]
    assert spectra.parse("-3/(-w^2-4)").num.tolist() == [3.0]
    assert spectra.parse("1/(omega^2+1)", "omega").num.tolist() == [1.0]
    assert spectra.parse("+2").num.tolist() == [2.0]
    for box in ("(w^2+16)/(4*(w^2+4))",):
        num, den = spectra.factor(spectra.parse(box))
        assert close(num, [0.5, 2], EXACT)
        assert close(den, [1, 2], EXACT)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1/(w^2-4)", "expected no pole at a real frequency, received one at w = 2"),
        ("1/w^2", "expected no pole at a real frequency, received one at w = 0"),
        ("w^2", "expected a numerator of degree at most 0 in w.2, received degree 1: the density grows without bound"),
        ("1/(w+1)", r"text: expected an even function of w, received '1/\(w\+1\)'"),
        ("w/(w^2+1)", "text: expected an even function of w"),
        (
            "(w^2-1)/(w^2+4)^2",
            "expected a density >= 0 at every frequency, received a negative one at w = 0.7",
        ),
        ("-1/(w^2+4)", "expected a density >= 0 at every frequency, received a negative one for w → ∞"),
        ("1/(w^2+4", "text: expected a rational expression in w, received"),
        ("1/(w-w)", "text: expected a rational expression in w"),
        ("exp(w)", r"text: expected numbers, w, \+ - \* / \^ and parentheses, received 'exp\(w\)'"),
        ("__import__('os')", "text: expected numbers, w,"),
        ("w^0.5", "text: expected numbers, w,"),
        ("w^1000", "text: expected numbers, w,"),
        ("1/(x^2+1)", "text: expected numbers, w,"),
        ("w" * 600, "text: expected a rational expression in w, received"),
        ("w // 2", "text: expected numbers, w,"),
    ],
)
def test_what_is_no_spectrum_is_refused(text: str, message: str) -> None:
    """Lines and drifts, negative and uneven densities, unbounded ones, and text that is no rational expression."""
    with pytest.raises(ValueError, match=message) as caught:
        spectra.parse(text)
    assert "\n" not in str(caught.value)


def test_bad_numbers_are_refused() -> None:
    """Empty sums, growing or unpaired exponentials, a zero denominator, negative strengths, unstable filters."""
    for terms in ([], [(1.0, 0.0)], [(1.0, -2.0)], [(np.nan, 1.0)]):
        with pytest.raises(ValueError, match=r"terms: expected pairs \(c, a\) with a of positive real part"):
            spectra.exponentials(terms)
    with pytest.raises(ValueError, match="terms: expected complex ones in conjugate pairs"):
        spectra.exponentials([(1.0, 1 + 1j)])
    with pytest.raises(ValueError, match="received a negative one at w = "):
        spectra.exponentials([(1.0, 1.0), (-0.9, 0.5)])
    with pytest.raises(ValueError, match="den: expected a polynomial other than 0"):
        Spectrum([1], [0, 0])
    with pytest.raises(ValueError, match="strength: expected a number >= 0, received -1"):
        spectra.white(-1)
    with pytest.raises(ValueError, match="expected one with a pole"):
        spectra.shaping_filter(spectra.white(1.0))
    S = spectra.parse("1/(w^2+1)")
    with pytest.raises(ValueError, match="num, den: expected a stable proper filter, received the poles"):
        S.through([1], [1, -1])
    with pytest.raises(ValueError, match="num, den: expected a filter that white noise does not pass"):
        spectra.mean_square_error([1, 2], [1, 1], S, spectra.white(1.0))
    with pytest.raises(ValueError, match="signal: expected a finite power, received a white part of strength 2"):
        spectra.wiener(S + spectra.white(2.0), S)
    with pytest.raises(ValueError, match="expected one that is not zero, received neither"):
        spectra.wiener(Spectrum([0], [1]), Spectrum([0], [1]))
    with pytest.raises(ValueError, match="expected power at every frequency, received none at w = 1"):
        spectra.wiener(spectra.parse("(w^2-1)^2/(w^2+4)^3"), Spectrum([0], [1]))


def test_a_spectrum_may_touch_zero() -> None:
    """(ω²−1)² has a double zero at ω = 1 and factorises with a zero on the axis; ω² with one at the origin."""
    num, den = spectra.factor(spectra.parse("(w^2-1)^2/(w^2+4)^3"))
    assert close(num, [1, 0, 1], 1e-6)
    assert close(den, np.poly([-2, -2, -2]), 1e-4)
    assert close(spectra.factor(spectra.parse("w^2/(w^2+4)^2"))[0], [1, 0], EXACT)
    assert spectra.factor(Spectrum([0], [1, 4]))[0].tolist() == [0]
    assert Spectrum([0], [1, 4]).power == 0


@settings(max_examples=25)
@given(model=continuous_models(stable=True, singular=False, correlated=False, max_n=3, max_m=1))
def test_wiener_in_white_noise_is_the_kalman_bucy_filter(model: ContinuousModel) -> None:
    """Signal Hx in white noise: the transfer function to Hx̂ and the mean square error HPHᵀ."""
    assert model.Rc is not None
    found = spectra.wiener(spectra.of(replace(model, Rc=None)), spectra.white(float(model.Rc[0, 0])))
    limit = bucy.steady(model)
    closed = model.F - limit.K @ model.H
    expected = [(model.H @ np.linalg.solve(1j * w * np.eye(model.n) - closed, limit.K))[0, 0] for w in W]
    assert close(response(found.num, found.den), expected, 1e-6)
    mse = (model.H @ limit.P @ model.H.T)[0, 0]
    assert close(found.mse, mse, 1e-6)
    noisy = spectra.wiener(spectra.of(replace(model, Rc=None)), spectra.white(1.05 * float(model.Rc[0, 0])))
    assert not close(noisy.mse, mse, 1e-6)


@settings(max_examples=25)
@given(signal=minimum_phase(direct=False), noise=minimum_phase(direct=False), strength=st.floats(0.05, 5.0))
def test_wiener_in_coloured_and_white_noise_is_the_augmented_filter(
    signal: tuple[Array, Array], noise: tuple[Array, Array], strength: float
) -> None:
    """Signal, coloured noise and white noise: bucy on the augmented model gives the same filter and the same error."""
    S, N = (spectra.white(1.0).through(*h) for h in (signal, noise))
    plant = replace(spectra.shaping_filter(S, name="s"), Rc=[[strength]])
    model = shaping.augment_measurement(plant, spectra.shaping_filter(N, name="n"))
    found = spectra.wiener(S, N + spectra.white(strength))
    num, den = bucy.transfer_function(model)
    assert close(response(found.num, found.den), response(num, den), 1e-6)
    assert close(found.mse, bucy.steady(model).P[0, 0], 1e-6)
    assert close(found.mse, spectra.mean_square_error(num, den, S, N + spectra.white(strength)), 1e-6)


@settings(max_examples=25)
@given(signal=minimum_phase(direct=False), seed=seeds)
def test_wiener_in_coloured_noise_alone_is_the_reduced_filter(signal: tuple[Array, Array], seed: int) -> None:
    """Without white noise the filter has a direct term; it is that of ctlabs.filtering.reduced."""
    rng = np.random.default_rng(seed)
    S = spectra.white(1.0).through(*signal)
    N = spectra.exponentials([(rng.uniform(0.2, 2.0), rng.uniform(0.3, 4.0))])
    model = shaping.augment_measurement(spectra.shaping_filter(S, name="s"), spectra.shaping_filter(N, name="n"))
    found, small = spectra.wiener(S, N), reduced.continuous(model)
    num, den = reduced.transfer_function(small)
    assert close(response(found.num, found.den), response(num, den), 1e-6)
    assert close(found.mse, reduced.steady(small).P[0, 0], 1e-6)


@settings(max_examples=20)
@given(signal=minimum_phase(direct=False), noise=minimum_phase(), seed=seeds)
def test_no_other_stable_filter_is_better(signal: tuple[Array, Array], noise: tuple[Array, Array], seed: int) -> None:
    """Orthogonality as an inequality: the optimum with its gain or poles disturbed has a larger error; by quadrature too."""
    S, N = (spectra.white(1.0).through(*h) for h in (signal, noise))
    best = spectra.wiener(S, N)
    rng = np.random.default_rng(seed)
    for _ in range(3):
        num = best.num * (1 + 0.1 * rng.normal(size=best.num.shape))
        assert spectra.mean_square_error(num, best.den, S, N) >= best.mse * (1 - 1e-9)

    def density(u: float) -> float:
        w = u / (1 - u)
        H = response(best.num, best.den, w)
        return float((abs(1 - H) ** 2 * S(w) + abs(H) ** 2 * N(w)) / np.pi / (1 - u) ** 2)

    integral = scipy.integrate.quad(density, 0, 1, limit=400)[0]
    assert close(best.mse, integral, 1e-5)


@st.composite
def touching_products(draw: st.DrawFn) -> tuple[list[tuple[Fraction, Fraction, int]], int]:
    """Factors ((x − a)² + b)ᵐ of a numerator in x = ω², b = 0 or small, and a degree of the denominator that exceeds it."""
    rng = np.random.default_rng(draw(seeds))
    factors = []
    for _ in range(draw(st.integers(1, 3))):
        a = Fraction(round(float(rng.uniform(0.2, 9.0)), draw(st.integers(0, 3)))) + Fraction(1, 4)
        b = Fraction(10) ** -int(rng.integers(0, 13)) if draw(st.booleans()) else Fraction(0)
        factors.append((a, b, draw(st.integers(1, 3))))
    return factors, 2 * sum(m for *_, m in factors) + draw(st.integers(0, 2))


def expanded(factors: list[tuple[Fraction, Fraction, int]]) -> list[Fraction]:
    """The product's coefficients, descending powers, exact."""
    p = [Fraction(1)]
    for a, b, m in factors:
        for _ in range(m):
            q = [Fraction(1), -2 * a, a * a + b]
            p = [
                sum((q[j] * p[i - j] for j in range(3) if 0 <= i - j < len(p)), Fraction(0)) for i in range(len(p) + 2)
            ]
    return p


@settings(max_examples=60)
@given(touching_products(), st.sampled_from([-3, 0, 3]))
def test_zeros_of_any_even_order_factor(product: tuple[list[tuple[Fraction, Fraction, int]], int], unit: int) -> None:
    """|H|² = Π((ω²−a)² + b)ᵐ/(ω²+1)ⁿ to the rounding of its terms, from fractions and from doubles, in any unit of time."""
    factors, degree = product
    u = Fraction(4) ** (5 * unit)
    num = [c * u**k for k, c in enumerate(expanded(factors))]
    den = [c * u**k for k, c in enumerate(expanded([(Fraction(-1), Fraction(0), 1)] * degree))][: 2 * degree + 1]
    assume(all(1e-307 < abs(c) < 1e307 for c in (*num, *den) if c))  # what lies beyond doubles is refused
    for S in (Spectrum(num, den), Spectrum([float(c) for c in num], [float(c) for c in den])):
        top, bottom = spectra.factor(S)
        assert len(top) == len(num)
        with mpmath.workdps(60):
            for w in (0.0, 0.3, 1.1, *(float(a) ** 0.5 for a, _, _ in factors), 7.0):
                x, s = mpmath.mpf(w) ** 2, mpmath.mpc(0, w * 2.0 ** (5 * unit))
                right = mpmath.fprod(((x - float(a)) ** 2 + float(b)) ** m for a, b, m in factors) / (x + 1) ** (
                    2 * degree
                )
                terms = mpmath.fprod(((x + float(a)) ** 2 + float(b)) ** m for a, b, m in factors) / (x + 1) ** (
                    2 * degree
                )
                found = abs(mpmath.polyval(top.tolist(), s) / mpmath.polyval(bottom.tolist(), s)) ** 2
                assert abs(found / mpmath.mpf(2.0) ** (10 * unit * (len(num) - len(den))) - right) < 1e-13 * terms
        assert _left_half(top.tolist())


def _left_half(p: list[float]) -> bool:
    """Whether p(s + r) is a Hurwitz polynomial for a shift r of 1e-2 of its roots: no zero further to the right."""
    n = len(p) - 1
    unit = abs(p[-1] / p[0]) ** (1 / n)
    with mpmath.workdps(60):
        scaled = [mpmath.mpf(c) / p[0] / mpmath.mpf(unit) ** k for k, c in enumerate(p)]
        row = mpmath.taylor(lambda s: mpmath.polyval(scaled, s), 1e-2, n)[::-1]
        above, below = row[0::2], row[1::2]
        while below:
            if above[0] <= 0 or below[0] <= 0:
                return False
            ratio = above[0] / below[0]
            above, below = below, [a - ratio * b for a, b in zip(above[1:], [*below[1:], 0], strict=False)]
        return True


@settings(max_examples=60)
@given(touching_products(), seeds)
def test_a_spectrum_pushed_below_zero_is_refused(
    product: tuple[list[tuple[Fraction, Fraction, int]], int], seed: int
) -> None:
    """By 1e-12 of its terms at a zero (fractions: by 1e-30): the message names a frequency at which it is negative."""
    factors, degree = product
    a, _, m = factors[0]
    factors[0] = (a, Fraction(0), m)
    num, den = expanded(factors), expanded([(Fraction(-1), Fraction(0), 1)] * degree)
    terms = sum(abs(c) * a**k for k, c in enumerate(reversed(num)))
    for depth, given_as in ((Fraction(1, 10**12), float), (Fraction(1, 10**30), Fraction)):
        pushed = [*num[:-1], num[-1] - depth * terms]
        with pytest.raises(ValueError, match="received a negative one at w = ") as caught:
            Spectrum([given_as(c) for c in pushed], [given_as(c) for c in den])
        w = Fraction(str(caught.value).rpartition("w = ")[2])
        assert sum(c * w ** (2 * k) for k, c in enumerate(reversed(pushed))) < 0
    assert Spectrum(num, den).num.size == len(num)


@pytest.mark.parametrize("unit", [1e-9, 1e-4, 1e5, 1e8])
def test_no_answer_depends_on_the_unit_of_time(unit: float) -> None:
    """Power, stationary covariance, the way back and the Wiener filter, with time in other units."""
    terms = [(2.0, 1.0), (-0.4, 3.0), (0.5, 0.3 + 2j), (0.5, 0.3 - 2j)]
    S, other = (spectra.exponentials([(c, a * u) for c, a in terms]) for u in (1.0, unit))
    assert close(other.power, 2.6, EXACT)
    block = spectra.shaping_filter(other)
    assert close(block.P0[0, 0], 2.6, EXACT)
    assert close(spectra.of(block)(W * unit), S(W) / unit, EXACT)
    found = [spectra.wiener(each, spectra.white(0.3 / u)) for each, u in ((S, 1.0), (other, unit))]
    assert close(found[0].mse, found[1].mse, EXACT)
    H = [response(each.num, each.den, W * u) for each, u in zip(found, (1.0, unit), strict=True)]
    assert close(H[0], H[1], EXACT)


def test_fractions_are_exact_and_numbers_are_rounded() -> None:
    """(ω²−1.1)⁶ from text has threefold zeros on the axis; an undamped line in doubles may be a faint resonance."""
    num, _ = spectra.factor(spectra.parse("(w^2-1.1)^6/(w^2+1)^8"))
    assert num[1::2].tolist() == [0, 0, 0]
    assert close(num[::2], [1, 3.3, 3.63, 1.331], EXACT)
    num, den = spectra.factor(spectra.parse("1/((w^2-1)^2+4e-20*w^2)"))
    assert close(den[1], 2e-10, EXACT)
    with pytest.raises(ValueError, match=r"expected a damping above the precision of the coefficients, .* w = 1 "):
        Spectrum([1.0], [1.0, -2.0, 1.0])
    with pytest.raises(ValueError, match="no pole at a real frequency, received one at w = 1:"):
        spectra.parse("1/(w^2-1)^2")
    with pytest.raises(ValueError, match="received a negative one for w → ∞"):
        Spectrum([-1.0, 1.0], [1.0, 2.0, 1.0])
    with pytest.raises(
        ValueError, match=r"num: expected coefficients within double precision .*, received smaller ones"
    ):
        Spectrum([1e-300], [1e30, 1e30])


def test_lab_23_by_hand() -> None:
    """(s+4)/(2(s+3)) with 1/24, the box's 19/384, and a static filter for equal poles."""
    S, N = spectra.parse("5/12/(w^2+4)"), spectra.parse("7/12/(w^2+16)")
    found = spectra.wiener(S, N)
    assert close(found.num, [0.5, 2], SOLVER)
    assert close(found.den, [1, 3], SOLVER)
    assert close(found.mse, 1 / 24, SOLVER)
    assert close(spectra.mean_square_error([0.5, 2], [1, 2], S, N), 19 / 384, SOLVER)
    found = spectra.wiener(S, spectra.parse("7/12/(w^2+4)"))
    assert close(response(found.num, found.den), np.full(len(W), 5 / 12), SOLVER)


def test_a_signal_without_noise_passes_and_noise_alone_does_not() -> None:
    """The limits of the problem: H = 1 and H = 0, both without error."""
    S, zero = spectra.parse("1/(w^2+1)"), Spectrum([0], [1])
    found = spectra.wiener(S, zero)
    assert close(response(found.num, found.den), np.ones(len(W)), SOLVER)
    assert found.mse < EXACT
    found = spectra.wiener(Spectrum([0], [1, 1]), S)
    assert close(response(found.num, found.den), np.zeros(len(W)), SOLVER)
    assert found.mse == 0
