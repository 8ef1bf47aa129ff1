"""Parameters of labs: what a person may type, what is refused, and in which words."""

import json
import math

import numpy as np
import pytest
from hypothesis import given as examples
from hypothesis import strategies as st

from ctlabs.reporting.params import (
    Count,
    Covariance,
    Flag,
    Fraction,
    LabParameters,
    Positive,
    PositiveOrNull,
    Positives,
    Real,
    Variance,
    VarianceOrInf,
    Variances,
    VariancesOrInf,
    Vector,
    given,
    plain,
    typed,
)


class Parameters(LabParameters):
    """One parameter of every type."""

    a: Real = given(-0.5, unit="1/s", meaning="a number")
    T: Positive = given(2.0, unit="s", meaning="a period")
    Q: Variance = given(0.0, unit="m²", meaning="a variance")
    R: VarianceOrInf = given(1.0, unit="m²", meaning="a variance, infinite where nothing is measured")
    K_star: Fraction = given(0.3, unit="1", meaning="a gain")
    steps: Count = given(5, unit="1", meaning="a count")
    switch: Flag = given(False, unit="1", meaning="a switch")
    taus: Positives = given([1, 2], unit="s", meaning="periods")
    lambdas: Variances = given([0, 1], unit="1", meaning="ratios")
    Rs: VariancesOrInf = given([0, "inf"], unit="m²", meaning="variances of measurements")
    x0: Vector(2) = given([0, 0], unit="m", meaning="a mean")  # type: ignore[valid-type]  # made by a function
    P0: Covariance(2) = given([[100, 0], [0, 10]], unit="m²", meaning="a covariance")  # type: ignore[valid-type]  # same


ACCEPTED = [
    ("a", -3, -3.0),
    ("a", np.float64(0.25), 0.25),
    ("a", np.int64(2), 2.0),
    ("T", 1e-300, 1e-300),
    ("Q", 0, 0.0),
    ("Q", 2.5, 2.5),
    ("R", 0, 0.0),
    ("R", "inf", math.inf),
    ("R", " Inf ", math.inf),
    ("R", "∞", math.inf),
    ("R", "Infinity", math.inf),
    ("R", math.inf, math.inf),
    ("K_star", 0, 0.0),
    ("K_star", 1, 1.0),
    ("steps", 1, 1),
    ("steps", np.int64(7), 7),
    ("switch", True, True),
    ("taus", [3], (3.0,)),
    ("lambdas", (0, 2), (0.0, 2.0)),
    ("lambdas", np.array([0.5, 2]), (0.5, 2.0)),
    ("Rs", [2, "inf", 0], (2.0, math.inf, 0.0)),
    ("x0", [-1, 1.5], (-1.0, 1.5)),
    ("P0", [[1, 0.5], [0.5, 2]], ((1.0, 0.5), (0.5, 2.0))),
    ("P0", np.zeros((2, 2)), ((0.0, 0.0), (0.0, 0.0))),
    ("P0", [[1, -1], [-1, 1]], ((1.0, -1.0), (-1.0, 1.0))),
]

NUMBERS = {
    "a": "a number",
    "T": "a number > 0",
    "Q": "a number >= 0",
    "R": 'a variance >= 0 or "inf"',
    "K_star": "a number from 0 to 1",
}
#: What is no number for anybody, and how it is shown.
NO_NUMBERS = [
    (math.nan, "NaN"),
    ("nan", '"nan"'),
    ("abc", '"abc"'),
    ("2", '"2"'),
    (True, "true"),
    (None, "None"),
    ([1], "[1]"),
    ({"a": 1}, '{"a": 1}'),
    (-math.inf, "-Infinity"),
    ("-inf", '"-inf"'),
    (1j, "1j"),
    (10**400, str(10**400)),
]
REFUSED = [
    *((name, expected, *case) for name, expected in NUMBERS.items() for case in NO_NUMBERS),
    *((name, expected, math.inf, "Infinity") for name, expected in NUMBERS.items() if name != "R"),
    *((name, expected, "inf", '"inf"') for name, expected in NUMBERS.items() if name != "R"),
    ("T", "a number > 0", 0, "0"),
    ("T", "a number > 0", -1.5, "-1.5"),
    ("Q", "a number >= 0", -1, "-1"),
    ("R", 'a variance >= 0 or "inf"', -1e-300, "-1e-300"),
    ("K_star", "a number from 0 to 1", 1.0000001, "1.0000001"),
    ("K_star", "a number from 0 to 1", -0.1, "-0.1"),
    *(
        ("steps", "a whole number >= 1", value, shown)
        for value, shown in [(0, "0"), (-1, "-1"), (2.0, "2.0"), (2.5, "2.5"), (True, "true"), ("3", '"3"')]
    ),
    ("switch", "true or false", 1, "1"),
    ("switch", "true or false", "true", '"true"'),
    ("taus", "a list of numbers", [], "[]"),
    ("taus", "a list of numbers", 1, "1"),
    ("taus", "a list of numbers", "1, 2", '"1, 2"'),
    ("taus", "a number > 0", [1, 0], "0"),
    ("lambdas", "a number >= 0", [1, -1], "-1"),
    ("lambdas", "a number >= 0", [1, "inf"], '"inf"'),
    ("lambdas", "a number >= 0", [1, math.nan], "NaN"),
    ("lambdas", "a number >= 0", [[1]], "[1]"),
    ("Rs", 'a variance >= 0 or "inf"', [1, -2], "-2"),
    ("x0", "a list of 2 numbers", [1], "[1]"),
    ("x0", "a list of 2 numbers", [1, 2, 3], "[1, 2, 3]"),
    ("x0", "a number", [1, True], "true"),
]

COVARIANCES = [
    ([[1, 0.5], [0.4, 1]], "asymmetry 0.1"),
    ([[1, 2], [2, 1]], "eigenvalue -1"),
    ([[-1, 0], [0, 1]], ""),
    ([[1, 0, 0], [0, 1, 0], [0, 0, 1]], ""),
    ([[1]], ""),
    ([1, 2], ""),
    ([], ""),
    (3, ""),
    ("I", ""),
    ([[1, 0], [0]], ""),
    ([[1, 0], [0, math.nan]], ""),
    ([[1, 0], [0, "inf"]], ""),
    ([["1", "0"], ["0", "1"]], ""),
    ([[True, False], [False, True]], ""),
    ([[10**400, 0], [0, 1]], ""),
]


@pytest.mark.parametrize(("name", "value", "kept"), ACCEPTED)
def test_a_good_value_is_kept_as_a_plain_python_value(name, value, kept):
    """Numbers become floats, lists tuples, whatever numeric type they came in."""
    found = getattr(Parameters.parse("task99", {name: value}), name)
    assert found == kept
    assert type(found) is type(kept)


@pytest.mark.parametrize(("name", "expected", "value", "shown"), REFUSED)
def test_a_bad_value_is_refused_in_one_line(name, expected, value, shown):
    """The line names the lab, the parameter, what was expected and what was received."""
    with pytest.raises(ValueError) as refusal:
        Parameters.parse("task99", {name: value})
    assert str(refusal.value) == f"task99: {name}: expected {expected}, received {shown}"


def test_null_stands_for_a_value_that_follows_others():
    """A rate may be null or positive; anything else is refused with both said."""

    class Orbit(LabParameters):
        w: PositiveOrNull = given(None, unit="rad/s", meaning="a rate; null: it follows the radius")

    assert Orbit().w is None
    assert Orbit.parse("orbit", {"w": None}).plain() == {"w": None}
    assert Orbit.parse("orbit", {"w": 2}).w == 2.0
    for wrong in (0, -1.0, "fast", True):
        with pytest.raises(ValueError, match=r"^orbit: w: expected a number > 0 or null, received [^\n]+$"):
            Orbit.parse("orbit", {"w": wrong})


@pytest.mark.parametrize(("value", "why"), COVARIANCES)
def test_what_is_no_covariance_is_refused_with_the_reason(value, why):
    """Asymmetric, indefinite, wrongly sized matrices, text and Booleans are refused; never silently symmetrised."""
    with pytest.raises(ValueError) as refusal:
        Parameters.parse("task99", {"P0": value})
    lead = "task99: P0: expected a 2×2 covariance (symmetric, nonnegative definite), received "
    assert str(refusal.value).startswith(lead + (json.dumps(value)[:3] if not isinstance(value, str) else '"I"'))
    assert why in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_rounding_asymmetry_of_a_covariance_is_removed():
    """Asymmetry of the last digits is no mistake; five per cent is."""
    P0 = np.array([[1, 0.5], [0.5 + 1e-16, 2]])
    kept = np.array(Parameters.parse("task99", {"P0": P0}).P0)
    assert np.array_equal(kept, kept.T)
    P0[1, 0] *= 1.05
    with pytest.raises(ValueError, match="asymmetry"):
        Parameters.parse("task99", {"P0": P0})


def test_an_unknown_name_is_refused_with_those_there_are():
    """A parameter that does not exist is not ignored."""
    with pytest.raises(ValueError, match=r"^task99: Phi: expected one of a, T, Q, .*, received an unknown name$"):
        Parameters.parse("task99", {"Phi": 1})


def test_the_default_is_checked_like_a_typed_value():
    """A lab whose own default is out of range does not load."""

    class Wrong(LabParameters):
        Q: Variance = given(-1.0, unit="m²", meaning="a variance")

    with pytest.raises(ValueError, match=r"^task99: Q: expected a number >= 0, received -1\.0$"):
        Wrong.parse("task99", {})


def test_parameters_cannot_be_changed():
    """What was checked stays as it was."""
    with pytest.raises(ValueError, match="frozen"):
        Parameters().Q = -1


def test_the_schema_tells_default_unit_meaning_and_range():
    """The workbench makes a form from the same schema."""
    shown = Parameters.model_json_schema()["properties"]
    assert set(shown) == set(Parameters.model_fields)
    for field in shown.values():
        assert {"default", "unit", "description"} <= set(field)
    assert shown["T"]["exclusiveMinimum"] == 0
    assert shown["Q"]["minimum"] == 0
    assert (shown["K_star"]["minimum"], shown["K_star"]["maximum"]) == (0, 1)
    assert shown["steps"]["minimum"] == 1
    assert shown["Q"]["unit"] == "m²"


def test_plain_parameters_are_json_and_come_back():
    """What results.json says of the parameters gives the same parameters again."""
    first = Parameters.parse("task99", {"R": "inf", "Rs": ["inf", 3], "P0": [[2, 1], [1, 2]]})
    stored = json.loads(json.dumps(first.plain(), allow_nan=False))
    assert stored["R"] == "inf"
    assert stored["Rs"] == ["inf", 3.0]
    assert Parameters.parse("task99", stored) == first


@pytest.mark.parametrize(
    ("value", "kept"),
    [
        (np.float64(0.1), 0.1),
        (np.int64(3), 3),
        (np.bool_(True), True),
        (True, True),
        (np.array(2.5), 2.5),
        (np.array([[1, 2], [3, 4]]), [[1, 2], [3, 4]]),
        (np.array([1.0, np.inf, -np.inf]), [1.0, "inf", "-inf"]),
        ((1, (2.5, None)), [1, [2.5, None]]),
        (1 - 2j, [1.0, -2.0]),
        (np.array([1j, np.inf]), [[0.0, 1.0], ["inf", 0.0]]),
        (math.inf, "inf"),
        ("inf", "inf"),
        (None, None),
    ],
)
def test_plain_turns_numbers_into_what_json_holds(value, kept):
    """numpy's types, infinities and complex numbers have one form in JSON."""
    found = plain(value)
    assert found == kept
    assert type(found) is type(kept)
    json.dumps(found, allow_nan=False)


@pytest.mark.parametrize("value", [math.nan, np.nan, [1, [math.nan]], np.array([1, np.nan]), complex(0, math.nan)])
def test_nan_is_never_a_result(value):
    """An undefined value is null with a reason, not NaN."""
    with pytest.raises(ValueError, match="expected a number, received NaN"):
        plain(value)


@pytest.mark.parametrize("value", [{1, 2}, {"a": 1}, object(), b"1"])
def test_plain_refuses_what_has_no_form_in_json(value):
    """A value of another kind is found at once, not when files are written."""
    with pytest.raises(TypeError, match=f"received a {type(value).__name__}"):
        plain(value)


@examples(st.floats(allow_nan=False, allow_infinity=False))
def test_every_double_survives_json(x):
    """Full precision: a float in results.json is the float that was computed."""
    assert json.loads(json.dumps(plain(np.float64(x)))) == x


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1.5", 1.5),
        ("-2", -2),
        ("1e-3", 1e-3),
        ("[1, 2.5]", [1, 2.5]),
        ('[2, "inf"]', [2, "inf"]),
        ("[[1, 0], [0, 1]]", [[1, 0], [0, 1]]),
        ("true", True),
        ("inf", "inf"),
        ("Infinity", "Infinity"),
        ("NaN", "NaN"),
        ("1/2", "1/2"),
        ("", ""),
        ("[1, 2", "[1, 2"),
        ("9" * 5000, "9" * 5000),
        ("[" * 100_000, "[" * 100_000),
    ],
    ids=lambda value: str(value)[:12],
)
def test_typed_reads_json_and_leaves_other_text(text, value):
    """Numbers, lists and true are values; everything else is text, for the parameter's type to refuse."""
    found = typed(text)
    assert found == value
    assert type(found) is type(value)
