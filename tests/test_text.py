"""Words and numbers for readers: placeholders beside LaTeX, five significant digits, matrices in equations."""

from __future__ import annotations

from decimal import Decimal
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ctlabs.text import SURE, _, fill, latex_matrix, latex_number, number

properties = settings(deadline=None, max_examples=200, derandomize=True)


def test_english_is_the_source_language() -> None:
    """Without a catalogue a text is returned as it is."""
    assert _("The limit is {limit}.") == "The limit is {limit}."


@pytest.mark.parametrize(
    "latex", [r"\bar{P}", r"x_{k}", r"x^{T}", r"\frac{a}{b}", r"\begin{bmatrix} 1 \end{bmatrix}", r"e^{s}_{i}"]
)
def test_braces_of_latex_are_no_placeholders(latex: str) -> None:
    """What follows a command, _, ^ or } stays, even if a value of that name is given."""
    assert fill(latex, P=1, k=2, T=3, a=4, b=5, bmatrix=6, s=7, i=8) == latex


def test_placeholders_take_numbers_words_and_matrices() -> None:
    """Numbers are rounded, strings go in as they are, and braces inside a value are not looked at again."""
    text = "With {name}, $K = {K}$ and {poles}: {verdict}, {small}, $P = {P}$."
    filled = fill(text, name="{K}", K=0.61803398875, poles=[0.5, np.float64(0.25)], verdict=True, small=-1.5e-7, P=2e-9)
    assert filled == "With {K}, $K = 0.61803$ and (0.5, 0.25): yes, −1.5×10⁻⁷, $P = 2\\cdot 10^{-9}$."
    assert fill("{text}", text="its own name") == "its own name"


def test_a_missing_value_is_named() -> None:
    """The message says which placeholder has no value and which values there are."""
    with pytest.raises(KeyError, match=r"text: expected a value for \{gain\}, received \['limit'\]"):
        fill("{limit} {gain}", limit=1)


SHOWN: dict[str, tuple[Any, str]] = {
    "nothing": (None, "—"),
    "yes": (True, "yes"),
    "numpy's no": (np.False_, "no"),
    "whole numbers in full": (123456789, "123456789"),
    "numpy's whole number": (np.int64(-5), "-5"),
    "five digits": (1 / 3, "0.33333"),
    "no noise": (0.1 + 0.2, "0.3"),
    "no point": (2.0, "2"),
    "rounded up": (99999.5, "100000"),
    "large": (1234567.0, "1234600"),
    "very large": (1.5e7, "1.5e7"),
    "small": (1e-4, "0.0001"),
    "very small": (9.999e-5, "9.999e-5"),
    "negative": (-3.25, "-3.25"),
    "zero": (-0.0, "0"),
    "infinite": (np.inf, "∞"),
    "minus infinite": (-np.inf, "−∞"),
    "not a number": (np.nan, "NaN"),
    "single precision": (np.float32(0.1), "0.1"),
    "complex": (1 - 2.5j, "1 − 2.5i"),
    "complex, negative": (-0.15708 - 1.5629j, "−0.15708 − 1.5629i"),
    "complex array": (np.array([0.5 + 0.25j]), "[0.5 + 0.25i]"),
    "list": ([1, 0.25], "[1, 0.25]"),
    "matrix": (np.eye(2), "[[1, 0], [0, 1]]"),
    "array without axes": (np.array(0.5), "0.5"),
    "ragged list": ([1.0, [2, None]], "[1, [2, —]]"),
    "Booleans in a list": ([True, 1.5], "[yes, 1.5]"),
    "empty": ((), "[]"),
    "words": ("settled", "settled"),
    "infinity as results have it": (["inf", "-inf"], "[∞, −∞]"),
}


@pytest.mark.parametrize("case", SHOWN.values(), ids=SHOWN)
def test_a_number_as_a_reader_wants_it(case: tuple[Any, str]) -> None:
    """Five significant digits, powers of ten outside 1e-4 … 1e7, no digits of rounding noise."""
    value, shown = case
    assert number(value) == shown


@properties
@given(st.floats(allow_nan=False, allow_infinity=False), st.integers(1, 12))
def test_a_shown_number_is_the_number_rounded(value: float, digits: int) -> None:
    """Reading it back gives the value to half a unit of the last digit, and no more digits than asked.

    Of a value within rounding of the middle both neighbours are right: it is taken to its sure digits first.
    """
    shown = number(value, digits)
    unit = Decimal(10) ** (Decimal(value).adjusted() - digits + 1)
    sure = Decimal(10) ** min(digits - SURE, -1)
    assert abs(Decimal(shown) - Decimal(value)) <= unit * (1 + sure) / 2
    mantissa = shown.split("e")[0].lstrip("-").replace(".", "").strip("0")
    assert len(mantissa) <= digits


def test_numbers_in_equations() -> None:
    r"""Powers of ten as \cdot 10^{…}, infinities as \infty, an ASCII minus."""
    assert latex_number(1.2e-7) == r"1.2\cdot 10^{-7}"
    assert latex_number(-3e20) == r"-3\cdot 10^{20}"
    assert latex_number(-np.inf) == r"-\infty"
    assert latex_number(0.123456789, digits=3) == "0.123"


def test_matrices_in_equations() -> None:
    """Rows by two backslashes, a vector as a column, 1×1 as a number."""
    assert latex_matrix([[1, 0.5], [0, np.inf]]) == r"\begin{bmatrix} 1 & 0.5 \\ 0 & \infty \end{bmatrix}"
    assert latex_matrix([1, 2]) == r"\begin{bmatrix} 1 \\ 2 \end{bmatrix}"
    assert latex_matrix([[1, 2]]) == r"\begin{bmatrix} 1 & 2 \end{bmatrix}"
    assert latex_matrix([[0.25]]) == latex_matrix(0.25) == "0.25"
