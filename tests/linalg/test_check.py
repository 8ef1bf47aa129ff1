"""Checks of the input: what is accepted, what is refused, and what the one-line message says."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings

from ctlabs.linalg import checks
from tests.reference import EXACT, broken, close
from tests.strategies import covariance, seeds

properties = settings(deadline=None, max_examples=50, derandomize=True)
inf, nan = np.inf, np.nan


def test_accepted_arrays_are_read_only_copies_of_doubles() -> None:
    """Changing the original later changes nothing, and the copy cannot be changed."""
    original = np.array([[1, 2], [3, 4]])
    copy = checks.shaped("A", original, ("n", "n"))
    original[0, 0] = 9
    assert copy.dtype == np.float64
    assert copy[0, 0] == 1
    with pytest.raises(ValueError, match="read-only"):
        copy[0, 0] = 5
    for kept in (checks.covariance("P", [[1.0]], (1, 1)), checks.measurement_covariance("R", [[inf]], (1, 1))):
        assert not kept.flags.writeable


def test_a_letter_in_a_shape_is_any_size() -> None:
    """(3, s) fits (3, 1) and (3, 7) but not (2, 1) or (3,)."""
    assert checks.fits((3, 7), (3, "s"))
    assert not checks.fits((2, 1), (3, "s"))
    assert not checks.fits((3,), (3, "s"))
    assert checks.shaped("G", [[1, 2]], (2, "s"), (1, "s")).shape == (1, 2)


@properties
@given(seeds)
def test_covariances_of_any_rank_and_unit_are_accepted(seed: int) -> None:
    """AAᵀ is a covariance in whatever units its states are, also with rounding in its symmetry, also in stacks."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 6))
    units = np.diag(10.0 ** rng.integers(-12, 13, size=n))
    P = units @ covariance(rng, n, int(rng.integers(0, n + 1))) @ units
    rounded = P * (1 + 1e-14 * rng.normal(size=(n, n)))
    accepted = checks.covariance("P", rounded, (n, n))
    assert np.array_equal(accepted, accepted.T)
    assert close(accepted, P, EXACT)
    assert checks.covariance("P", [P, 2 * P], ("steps", n, n)).shape == (2, n, n)


@properties
@given(seeds)
def test_a_clearly_asymmetric_matrix_is_never_symmetrised(seed: int) -> None:
    """A change of 5 % in one element off the diagonal is refused, alone and inside a stack."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 6))
    P = covariance(rng, n)
    P[0, 1] = P[1, 0] = 0.2 * np.sqrt(P[0, 0] * P[1, 1])
    wrong = broken(P, (0, 1))
    for value in (wrong, [P, wrong]):
        with pytest.raises(ValueError, match=r"^P: expected a symmetric matrix, received one with asymmetry"):
            checks.covariance("P", value, (n, n), ("steps", n, n))


def test_a_correlation_above_one_is_refused_in_any_units() -> None:
    """|ρ| > 1 is indefinite, however small the variances are beside others."""
    for sd in (1e-9, 1.0, 1e9):
        P = np.array([[1.0, 1.01 * sd], [1.01 * sd, sd**2]])
        with pytest.raises(
            ValueError, match=r"^P: expected a nonnegative definite matrix.*\(scaled to unit diagonal\)$"
        ):
            checks.covariance("P", P, (2, 2))
        assert checks.covariance("P", [[1.0, sd], [sd, sd**2]], (2, 2))[0, 1] == sd


def test_what_is_measured_how_is_on_the_diagonal_of_R() -> None:
    """inf = not measured, 0 = perfectly; the rest must still be a covariance, and ∞ correlates with nothing."""
    R = checks.measurement_covariance("R", [[inf, 0, 0], [0, 2, 1], [0, 1, 0.5]], ("m", "m"))
    assert R.tolist() == [[inf, 0, 0], [0, 2, 1], [0, 1, 0.5]]
    stack = checks.measurement_covariance("R", [[[inf]], [[0.0]], [[2.0]]], ("steps+1", 1, 1))
    assert stack.ravel().tolist() == [inf, 0, 2]


REFUSED: dict[str, tuple[Any, type[Exception], str]] = {
    "words": (lambda: checks.array("H", [["a"]]), TypeError, r"^H: expected real numbers, received \[\['a'\]\]$"),
    "ragged rows": (lambda: checks.array("H", [[1], [1, 2]]), TypeError, r"^H: expected real numbers, received \[\[1\], \[1, 2\]\]$"),
    "complex numbers": (lambda: checks.array("H", np.eye(2) * 1j), TypeError, r"^H: expected real numbers, received [^\n]*j"),
    "nothing": (lambda: checks.shaped("H", None, (1, 1)), (TypeError, ValueError), r"^H: expected "),  # type: ignore[arg-type,dict-item]  # refused
    "NaN": (lambda: checks.array("H", [[1, 2], [nan, 4]]), ValueError, r"^H: expected finite numbers, received nan at \[1, 0\]$"),
    "infinity": (lambda: checks.array("x0", [1, -inf]), ValueError, r"^x0: expected finite numbers, received -inf at \[1\]$"),
    "NaN beside an allowed infinity": (
        lambda: checks.array("R", [[inf, nan]], finite=False), ValueError, r"^R: expected finite numbers, received nan at \[0, 1\]$",
    ),
    "shape": (lambda: checks.shaped("G", [[1], [2]], (3, "s")), ValueError, r"^G: expected shape \(3, s\), received \(2, 1\)$"),
    "one of several shapes": (
        lambda: checks.shaped("u", 1.0, (1,), ("steps", 1)), ValueError, r"^u: expected shape \(1,\) or \(steps, 1\), received \(\)$",
    ),
    "not square": (lambda: checks.covariance("P", [[1, 0]], (1, 2)), ValueError, r"^P: expected a square matrix, received \(1, 2\)$"),
    "negative variance": (
        lambda: checks.covariance("Q", [[1, 0], [0, -2]], (2, 2)), ValueError, r"^Q: expected variances >= 0 on the diagonal, received -2$",
    ),
    "correlation with a variance of zero": (
        lambda: checks.covariance("Q", [[0, 1], [1, 5]], (2, 2)), ValueError, r"^Q: expected a nonnegative definite matrix",
    ),
    "minus infinity on R": (
        lambda: checks.measurement_covariance("R", [[-inf]], (1, 1)),
        ValueError,
        r"^R: expected variances >= 0 on the diagonal, received -inf$",
    ),
    "correlation with an absent measurement": (
        lambda: checks.measurement_covariance("R", [[inf, 0.1], [0.1, 1]], (2, 2)),
        ValueError,
        r"^R: expected 0 beside an infinite variance, received a correlation$",
    ),
    "infinite correlation": (
        lambda: checks.measurement_covariance("R", [[1, inf], [inf, 1]], (2, 2)),
        ValueError,
        r"^R: expected finite numbers, received inf at \[0, 1\]$",
    ),
    "negative variance in R": (lambda: checks.measurement_covariance("R", [[-1]], (1, 1)), ValueError, r"^R: expected variances >= 0"),
    "a single name for all": (lambda: checks.labels("states", "ab", 2, "x"), ValueError, r"^states: expected 2 names, received 'ab'$"),  # type: ignore[arg-type]  # refused
    "too few names": (lambda: checks.labels("states", ["a"], 2, "x"), ValueError, r"^states: expected 2 names, received \['a'\]$"),
    "a number for names": (lambda: checks.labels("states", 2, 2, "x"), ValueError, r"^states: expected 2 names, received 2$"),  # type: ignore[arg-type]  # refused
    "numbers as names": (lambda: checks.labels("states", [1, 2], 2, "x"), ValueError, r"^states: expected 2 names, received \[1, 2\]$"),  # type: ignore[list-item]  # refused
    "another type": (lambda: checks.instance("model", 3, str), TypeError, r"^model: expected a str, received a int$"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED.values(), ids=REFUSED)
def test_bad_input_is_refused_in_one_line(case: tuple[Any, type[Exception], str]) -> None:
    """what: expected …, received …"""
    call, error, message = case
    with pytest.raises(error, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("value", [0, -1, 1.0, True, np.True_, "1", None, inf])
def test_what_is_no_count(value: object) -> None:
    """A count is a whole number not below its least; True and 1.0 are none."""
    with pytest.raises(ValueError, match=r"^steps: expected a whole number >= 1, received"):
        checks.count("steps", value)


@pytest.mark.parametrize("value", [0, -1.0, inf, nan, True, "1", None, 1 + 0j, np.complex128(1), np.ones(1)])
def test_what_is_not_a_positive_number(value: object) -> None:
    """Zero, infinity, NaN, Booleans, strings, complex numbers and arrays are refused."""
    with pytest.raises(ValueError, match=r"^dt: expected a number > 0, received"):
        checks.positive("dt", value)


def test_numpys_numbers_count_as_numbers() -> None:
    """Scalars that come out of arrays are as good as Python's own."""
    assert checks.count("steps", np.int64(3)) == 3
    assert type(checks.count("steps", np.int32(3))) is int
    assert checks.count("first", 0, least=0) == 0
    assert checks.positive("dt", np.float32(0.5)) == 0.5
    assert type(checks.positive("dt", np.int64(2))) is float


def test_default_names() -> None:
    """x1, x2, …; an empty letter gives empty units; given names become a tuple."""
    assert checks.labels("states", None, 3, "x") == ("x1", "x2", "x3")
    assert checks.labels("units", None, 2, "") == ("", "")
    assert checks.labels("states", ["a", "b"], 2, "x") == ("a", "b")
