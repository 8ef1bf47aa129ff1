"""The exponential and its integrals element by element: closed forms, Van Loan in integers, models over twelve decades."""

from __future__ import annotations

from fractions import Fraction
from math import factorial
from typing import Any

import mpmath
import numpy as np
import pytest

from ctlabs.linalg.exponential import Interval, interval, intervals
from ctlabs.linalg.factors import unit_triangular
from ctlabs.models.discretisation import discretise
from tests import cases, reference
from tests.reference import Array

pytestmark = pytest.mark.numerical

EPS = float(np.finfo(float).eps)
#: Below this, doubles lose digits because they are small.
SMALL = 1e-280


def terms(F: Array, W: Array, h: float) -> Interval:
    """What the elements are sums of when the interval is divided: |Φ||Φ|, |Qd| + |Φ||Qd||Φ|ᵀ, |Γ| + |Φ||Γ|, at the worst."""
    found = [np.zeros_like(F)] * 3
    for part in (0.0007, 0.0132, 0.1459, 0.3820, 0.6180, 0.8541):
        a, b = (Interval(*map(np.abs, interval(F, W, p * h))) for p in (part, 1 - part))
        split = a.Phi @ b.Phi, a.Qd + a.Phi @ b.Qd @ a.Phi.T, a.Gamma + a.Phi @ b.Gamma
        found = [np.maximum(x, y) for x, y in zip(found, split, strict=True)]
    return Interval(*found)


def model_over_decades(rng: np.random.Generator) -> tuple[Array, Array, float]:
    """Sparse F and W with elements from 1e-6 to 1e6, of one sign, of any, or a cascade, and |λ|h up to 1e3."""
    n, kind = int(rng.integers(1, 5)), int(rng.integers(3))

    def sparse() -> Array:
        signs = rng.choice([-1, 1], (n, n)) if kind else 1
        return np.where(rng.random((n, n)) < 0.5, 10 ** rng.uniform(-6, 6, (n, n)) * signs, 0.0)

    F, g = sparse(), sparse()
    np.fill_diagonal(F, -np.abs(np.diag(F)))
    F = np.triu(F) if kind == 2 else F
    values = np.linalg.eigvals(F)
    fastest, growth = np.abs(values).max(), values.real.max()
    h = 10 ** rng.uniform(-6, 6)
    h = min(h, 10 ** rng.uniform(-3, 3) / fastest) if fastest else h
    return F, g @ g.T, min(h, 50 / growth) if growth > 0 else h


@pytest.mark.parametrize("seed", range(40))
def test_every_element_has_its_digits(seed: int) -> None:
    """Over twelve decades no element is further off than the rounding of its own terms over |λ|h turns or decays."""
    F, W, h = model_over_decades(np.random.default_rng(seed))
    speed = 1 + np.abs(np.linalg.eigvals(F)).max() * h
    for found, right, own in zip(interval(F, W, h), reference.interval(F, W, h), terms(F, W, h), strict=True):
        assert not found[own == 0].any()
        assert (np.abs(found - right) <= 8 * len(F) * EPS * speed * own + SMALL).all()


@pytest.mark.parametrize("seed", range(40))
def test_many_intervals_have_the_digits_of_each(seed: int) -> None:
    """Stacks over three decades of h below that of the model: each as right as an interval alone."""
    rng = np.random.default_rng(seed)
    F, W, h = model_over_decades(rng)
    lengths = h * np.append(10 ** rng.uniform(-3, 0, 5), 1.0)
    stacks = intervals(F, W, lengths)
    for k, each in enumerate(lengths):
        speed = 1 + np.abs(np.linalg.eigvals(F)).max() * each
        for found, right, own in zip(stacks, reference.interval(F, W, each), terms(F, W, each), strict=True):
            assert not found[k][own == 0].any()
            assert (np.abs(found[k] - right) <= 8 * len(F) * EPS * speed * own + SMALL).all()


def test_many_intervals_of_integrators_are_exact_and_in_order() -> None:
    """Eight integrators over intervals from 1e-12 to 1e4 s, unsorted, each by its closed form; none gives empty stacks."""
    n, h = 8, np.random.default_rng(1).permutation(np.geomspace(1e-12, 1e4, 60))
    found = intervals(np.eye(n, k=1), np.diag([0.0] * (n - 1) + [1.0]), h)
    for d in range(n):
        np.testing.assert_allclose(found.Phi[:, 0, d], h**d / factorial(d), rtol=40 * EPS)
        np.testing.assert_allclose(found.Gamma[:, 0, d], h ** (d + 1) / factorial(d + 1), rtol=40 * EPS)
    np.testing.assert_allclose(found.Qd[:, 0, 0], h ** (2 * n - 1) / (2 * n - 1) / factorial(n - 1) ** 2, rtol=40 * EPS)
    assert [part.shape for part in intervals(np.eye(n), np.eye(n), [])] == [(0, n, n)] * 3


def test_many_intervals_are_refused_by_the_first_that_overflows() -> None:
    """With its length, also where it is not positive."""
    with pytest.raises(ValueError, match="received 1000 s"):
        intervals([[1.0]], [[0.0]], [1.0, 1000.0, 2000.0])
    with pytest.raises(ValueError, match="dt: expected a number > 0, received -1"):
        intervals([[1.0]], [[0.0]], [1.0, -1.0])


@pytest.mark.parametrize("n", [1, 2, 4, 7, 12, 20])
@pytest.mark.parametrize("h", [1e-12, 1e-3, 1.0, 1e4])
def test_a_chain_of_integrators_has_its_closed_form(n: int, h: float) -> None:
    """Φ_ij = h^{j−i}/(j−i)! and Γ, Qd alike, wherever a double can hold them; below the diagonal exactly zero."""
    f, exact, away = factorial, Fraction(h), [[j - i for j in range(n)] for i in range(n)]
    Phi = [[exact**d / f(d) if d >= 0 else 0 for d in row] for row in away]
    Gamma = [[exact ** (d + 1) / f(d + 1) if d >= 0 else 0 for d in row] for row in away]
    Qd = [[exact ** (a + b + 1) / ((a + b + 1) * f(a) * f(b)) for b in range(n)[::-1]] for a in range(n)[::-1]]
    found = interval(np.eye(n, k=1), np.diag([0.0] * (n - 1) + [1.0]), h)
    for part, right in zip(found, (np.array(M, dtype=float) for M in (Phi, Qd, Gamma)), strict=True):
        held = (right > SMALL) | (right == 0)
        np.testing.assert_allclose(part[held], right[held], rtol=40 * EPS)
    assert np.array_equal(found.Qd, found.Qd.T)


@pytest.mark.parametrize("case", cases.numerics("k6_integrators"))
def test_chains(case: cases.Case) -> None:
    """Four to twelve integrators, and the conditional variance of the last one's noise, qT/n², as far as Qd determines it."""
    given, right = case["given"], case["right"]
    n, q = given["n"], given["q"]
    found = interval(np.eye(n, k=1), np.diag([0.0] * (n - 1) + [q]), given["dt"])
    cases.near(found.Phi[0], right["Phi_first_row"], case["tolerance"]["Phi"])
    cases.near(found.Qd[0], right["Qd_first_row"], case["tolerance"]["Qd"])
    cases.near(np.diag(found.Qd), right["Qd_diagonal"], case["tolerance"]["Qd"])
    if "Qd" in right:
        cases.near(found.Qd, right["Qd"], case["tolerance"]["Qd"])
    # d_n = lᵀ Qd l with l, the last row of L⁻¹, so that roundings of Qd alone move it by ε|l|ᵀ|Qd||l|.
    with mpmath.workdps(400):
        inverse = mpmath.matrix(found.Qd.tolist()) ** -1
        row = np.array([abs(float(inverse[n - 1, j] / inverse[n - 1, n - 1])) for j in range(n)])
    rounding = 4 * n * EPS * float(row @ found.Qd @ row)
    off = abs(unit_triangular(found.Qd)[1][-1] - right["last_conditional_variance"])
    assert off <= max(1e-6 * right["last_conditional_variance"], rounding)


@pytest.mark.parametrize(
    "case",
    [
        c
        for name in ("chain_with_slow_bias", "fast_and_slow", "integrators_and_stiff")
        for c in cases.numerics(f"k6_{name}")
    ],
)
def test_mixed_speeds(case: cases.Case) -> None:
    """Slow and fast together, |λ|dt from 1e-7 to 1e6, to 1e-12 of every element."""
    found = discretise(cases.model(case["model"]), case["given"]["dt"], R=[[1.0]])
    for name in ("Phi", "Qd"):
        cases.near(getattr(found, name), case["right"][name], "relative 1e-12")


@pytest.mark.parametrize("case", cases.peers("discretisation"))
def test_published_discretisations(case: cases.Case) -> None:
    """What others print, to their digits, and the reference beside it to all."""
    found = discretise(cases.model(case["model"]), case["given"]["dt"], R=[[1.0]])
    for name, printed in case["expected"].items():
        cases.near(getattr(found, name), printed, case["tolerance"][name])
    for name, right in case["reference"].items():
        cases.near(getattr(found, name), right, "relative 1e-12")


@pytest.mark.parametrize("seed", range(10))
def test_units_change_nothing(seed: int) -> None:
    """States and time in other units, powers of 2 up to 2^±100: the same bits."""
    rng = np.random.default_rng(seed)
    F, W, h = model_over_decades(rng)
    unit, time = np.exp2(rng.integers(-100, 101, len(F))), 2.0 ** rng.integers(-100, 101)
    ratio, product = unit[:, None] / unit, np.outer(unit, unit)
    found, other = interval(F, W, h), interval(F * ratio / time, W * product / time, h * time)
    for part, again, own, units in zip(found, other, terms(F, W, h), (ratio, product, ratio * time), strict=True):
        off = np.abs(again / units - part)
        speed = 1 + np.abs(np.linalg.eigvals(F)).max() * h
        assert (off <= 8 * len(F) * EPS * speed * own + SMALL).all()


def test_a_path_decides_what_is_zero() -> None:
    """Elements that no path leads to are zero to the bit, in a permuted cascade with a loop in it, stiff or not."""
    F = np.zeros((6, 6))
    for i, j, rate in ((3, 1, 1e3), (1, 4, -2.0), (4, 1, 1e-3), (0, 3, 5.0), (5, 2, 1.0), (2, 2, -1e2), (1, 1, -1.0)):
        F[i, j] = rate
    reached = np.linalg.matrix_power(np.eye(6) + (F != 0), 6) > 0
    W = np.diag([0.0, 0.0, 0.0, 0.0, 1.0, 0.0])
    found = interval(F, W, 1.0)
    assert np.array_equal(found.Phi != 0, reached)
    assert np.array_equal(found.Gamma != 0, reached)
    assert np.array_equal(found.Qd != 0, reached @ (W != 0) @ reached.T > 0)


def test_nothing_driven_and_no_states() -> None:
    """W = 0 gives Qd = 0, and a system of no states has empty matrices."""
    assert not interval([[-1.0, 2.0], [0.5, -3.0]], np.zeros((2, 2)), 10.0).Qd.any()
    assert [part.shape for part in interval(np.zeros((0, 0)), np.zeros((0, 0)), 1.0)] == [(0, 0)] * 3


def test_many_terms_where_a_path_is_long() -> None:
    """A ring of 60 lags, whose smallest elements need 60 terms: Φ_ij = e^{−h}h^d/d!, but for turns of the whole ring."""
    n, h = 60, 0.25
    F = np.eye(n, k=1) - np.eye(n)
    F[-1, 0] = 1.0
    Phi = interval(F, np.zeros((n, n)), h).Phi
    right = [np.exp(-h) * sum(h ** (d + k * n) / factorial(d + k * n) for k in range(2)) for d in range(n)]
    np.testing.assert_allclose(Phi[0], right, rtol=100 * EPS)


def test_what_grows_beyond_doubles_is_refused() -> None:
    """e^{1000}, an F h without a double, and a result that overflows in the user's units only."""
    for F, h in (([[1.0]], 1000.0), ([[-1e300]], 1e10), ([[0.0, 1e200, 0.0], [0.0, 0.0, 1e200], [0.0, 0.0, 0.0]], 1.0)):
        with pytest.raises(ValueError, match=r"^dt: expected an interval over which .* double precision, received"):
            interval(F, np.zeros_like(F), h)


def test_the_exponential_of_a_library_would_not_do() -> None:
    """scipy's Padé approximant has 5 % in the smallest element of eight integrators: what the tests above notice."""
    import scipy.linalg

    off: Any = (
        scipy.linalg.expm(np.eye(8, k=1) * 1e-3)[0, 7] / interval(np.eye(8, k=1), np.zeros((8, 8)), 1e-3).Phi[0, 7]
    )
    assert abs(off - 1) > 0.01
