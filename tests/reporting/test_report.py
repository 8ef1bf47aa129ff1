"""A report: what a check compares, what a value may be, and the form of its results."""

import json
import math
from dataclasses import dataclass

import numpy as np
import pytest
from matplotlib.figure import Figure

from ctlabs.models import ContinuousModel
from ctlabs.reporting.params import LabParameters, Variance, VarianceOrInf, given
from ctlabs.reporting.report import EXACT, SOLVER, Heading, Picture, Report, Table, Text

META = {"name": "task99", "title": "A test", "source": "A book, task 99", "parts": ["a", "b"]}
ROUTES = ("recursion", "closed form")


class Parameters(LabParameters):
    """Of a lab that does not exist."""

    Q: Variance = given(0.39, unit="m²", meaning="variance of the process noise")
    R: VarianceOrInf = given("inf", unit="m²", meaning="variance of the measurement noise")


@dataclass(frozen=True)
class Verdict:
    """Outcome of a test of an ensemble."""

    value: float
    critical: float
    passed: bool


@pytest.fixture
def report() -> Report:
    empty = Report(META, Parameters(), runs=10, seed=3)
    empty.section("a", "First part")
    return empty


def only(report: Report):
    (check,) = report.checks
    return check


class TestCheck:
    @pytest.mark.parametrize("kind", [EXACT, SOLVER])
    @pytest.mark.parametrize("size", [1e-9, 1.0, 1e9])
    def test_tolerance_is_relative_to_what_was_expected(self, report, kind, size):
        """A difference below the tolerance passes and one above it fails, whatever the unit."""
        report.check("near", size * (1 + 0.5 * kind), size, ROUTES, kind)
        report.check("far", size * (1 + 2 * kind), size, ROUTES, kind)
        near, far = report.checks
        assert near.passed
        assert not far.passed
        assert near.kind == far.kind == {EXACT: "EXACT", SOLVER: "SOLVER"}[kind]
        assert near.tolerance == kind * size

    def test_the_worst_element_is_reported(self, report):
        """Of two arrays a check shows the pair that differs most."""
        report.check("P", [[1, 2], [3, 4.5]], np.array([[1, 2.1], [3, 4]]), ROUTES)
        check = only(report)
        assert (check.value, check.expected, check.passed) == (4.5, 4.0, False)
        assert check.tolerance == 4 * SOLVER

    def test_one_element_wrong_by_five_percent_fails(self, report):
        """A single wrong element of many is enough."""
        right = np.linspace(1.0, 2.0, 50)
        wrong = right.copy()
        wrong[7] *= 1.05
        report.check("right", right.copy(), right, ROUTES, EXACT)
        report.check("wrong", wrong, right, ROUTES, SOLVER)
        assert [check.passed for check in report.checks] == [True, False]

    @pytest.mark.parametrize("size", [1e-20, 1e-6, 1.0])
    def test_the_smallest_element_wrong_by_one_percent_fails(self, report, size):
        """A gain per second beside one per second squared, a bias beside a position: each is judged by its own size."""
        right = np.array([1.0, size])
        report.check("right", right * (1 + 1e-9), right, ROUTES)
        report.check("wrong", right * [1.0, 1.01], right, ROUTES)
        assert [check.passed for check in report.checks] == [True, False]
        assert report.checks[1].expected == size

    @pytest.mark.parametrize("sd", [1e-8, 1e-3, 1.0])
    @pytest.mark.parametrize("place", [(1, 1), (0, 1)])
    def test_a_covariance_is_judged_in_unit_variances(self, report, sd, place):
        """The smallest variance, or its covariance, wrong by 1 % of σ_iσ_j fails; a small correlation is no small unit."""
        right = np.array([[1.0, 1e-9 * sd], [1e-9 * sd, sd**2]])
        wrong = right.copy()
        wrong[place] += 0.01 * (sd if place == (0, 1) else sd**2)
        wrong[place[::-1]] = wrong[place]
        report.check("right", right + 1e-9 * np.array([[1, sd], [sd, sd**2]]), right, ROUTES)
        report.check("wrong", wrong, right, ROUTES)
        assert [check.passed for check in report.checks] == [True, False]

    def test_numbers_equal_up_to_rounding_are_written_as_equal(self, report):
        """Whatever the last digits of a machine are, the check says the same: of many numbers, the largest one."""
        right = np.array([0.1, 2.0, 1e-3])
        for noise in (1e-16, -3e-15):
            report.check("many", right * (1 + np.array([1.0, 0.1, 7.0]) * noise), right, ROUTES)
        report.check("rounding about zero", 3e-17, -2e-18, ROUTES, scale=1.0)
        first, second, zero = report.checks
        assert first == second
        assert (first.value, first.expected) == (2.0, 2.0)
        assert (zero.value, zero.expected) == (0.0, 0.0)

    def test_a_difference_that_is_no_rounding_is_written(self, report):
        """Of a check that passes the element of largest size is shown; of one that fails, the worst."""
        right = np.array([1.0, 2.0])
        report.check("close", right + np.array([5e-9, 1e-9]), right, ROUTES)
        report.check("far", right + np.array([0.1, 0.0]), right, ROUTES)
        close, far = report.checks
        assert (close.value, close.expected, close.passed) == (2.0 + 1e-9, 2.0, True)
        assert close.share == pytest.approx(5e-9, rel=1e-6)
        assert (far.value, far.expected, far.passed) == (1.1, 1.0, False)

    def test_expected_zero_is_compared_absolutely(self, report):
        """Where zero is expected the tolerance itself is the limit."""
        report.check("rounding", 0.5e-12, 0.0, ROUTES, EXACT)
        report.check("not zero", 2e-12, [0.0], ROUTES, EXACT)
        assert [check.passed for check in report.checks] == [True, False]
        assert report.checks[0].tolerance == EXACT

    def test_scale_replaces_the_size_of_what_was_expected(self, report):
        """A difference of large terms is judged by the terms."""
        report.check("by itself", 1e-10, 0.0, ROUTES, EXACT)
        report.check("by its terms", 1e-10, 0.0, ROUTES, EXACT, scale=1e3)
        assert [check.passed for check in report.checks] == [False, True]
        assert report.checks[1].tolerance == EXACT * 1e3

    @pytest.mark.parametrize(
        ("value", "expected", "passed"),
        [
            (None, None, True),
            (None, 1.0, False),
            (1.0, None, False),
            ("inf", math.inf, True),
            ("inf", "-inf", False),
            ("inf", 1e300, False),
            (5.0, "inf", False),
            ([1, "inf"], [1, np.inf], True),
            ([1, None], [1, None], True),
            ([1, None], [1, 0.5], False),
            ([1, 0.5], [1, None], False),
            (True, True, True),
            (True, False, False),
            (1 + 2j, [1, 2], True),
            (1 + 2j, 1 - 2j, False),
            (2.0, [2.0], True),
        ],
    )
    def test_null_infinity_and_complex_numbers_compare_as_they_should(self, report, value, expected, passed):
        """Undefined equals undefined only, infinity equals infinity only; the result can be stored."""
        report.check("special", value, expected, ROUTES)
        assert only(report).passed is passed
        json.dumps(report.results(), allow_nan=False)

    def test_null_shows_as_null(self, report):
        """The worst pair of a check with an undefined side has null there."""
        report.check("special", [1, None], [1, 0.5], ROUTES)
        assert (only(report).value, only(report).expected) == (None, 0.5)

    @pytest.mark.parametrize(
        ("value", "expected", "words"),
        [
            ([1, 2], [1, 2, 3], r"expected two arrays of one shape, received \(2,\) and \(3,\)"),
            (1.0, [1, 1], "expected two arrays of one shape"),
            ([[1, 2]], [[1], [2]], "expected two arrays of one shape"),
            ([], [], "expected at least one number, received none"),
            (math.nan, 1.0, "received NaN"),
            (1.0, [math.nan], "received NaN"),
        ],
    )
    def test_what_cannot_be_compared_is_refused(self, report, value, expected, words):
        """No broadcasting, no check of nothing, no NaN."""
        with pytest.raises(ValueError, match=words):
            report.check("P", value, expected, ROUTES)
        assert report.checks == []

    def test_a_check_needs_two_routes(self, report):
        """A number compared with itself is no check, of whatever kind."""
        same = ("recursion", "recursion")
        for refused in (
            lambda: report.check("x", 1, 1, same),
            lambda: report.holds("x", 1, same, size=1),
            lambda: report.chance("x", Verdict(0, 5, True), same),
            lambda: report.order("x", [2, 1], 1, same),
            lambda: report.value("x", 1, agrees={"x": 1}, routes=same),
        ):
            with pytest.raises(ValueError, match="expected two different routes"):
                refused()
        assert report.checks == []

    def test_tolerances_cannot_be_tuned(self, report):
        """A check of two numbers has one of two tolerances."""
        with pytest.raises(ValueError, match=r"check P: expected the tolerance EXACT or SOLVER, received 0\.01"):
            report.check("P", 1, 1.001, ROUTES, 1e-2)


class TestOtherKinds:
    def test_an_inequality_holds_up_to_rounding(self, report):
        """A margin of −10⁻¹³ of the size is rounding; −10⁻¹¹ is not."""
        report.holds("clear", [3.0, 1.0], ROUTES, size=2.0)
        report.holds("rounding", [3.0, -2e-13], ROUTES, size=2.0)
        report.holds("violated", [3.0, -2e-11], ROUTES, size=2.0)
        assert [check.passed for check in report.checks] == [True, True, False]
        assert [check.value for check in report.checks] == [0.0, 0.0, -2e-11]  # rounding is written as none
        assert {check.kind for check in report.checks} == {"EXACT"}

    def test_an_undefined_margin_is_refused(self, report):
        """NaN satisfies no inequality and is no number to report."""
        with pytest.raises(ValueError, match="received NaN"):
            report.holds("P", [1.0, math.nan], ROUTES, size=1.0)

    @pytest.mark.parametrize("passed", [True, False])
    def test_chance_passes_on_what_the_test_of_the_ensemble_says(self, report, passed):
        """The deviation in sigmas is held against its critical value."""
        report.chance("NEES", Verdict(4.0, 5.5, passed))
        check = only(report)
        assert (check.value, check.expected, check.tolerance, check.kind, check.passed) == (
            4.0,
            0.0,
            5.5,
            "CHANCE",
            passed,
        )

    def test_order_is_that_of_the_last_halving(self, report):
        """Errors that fall fourfold at each halving are of second order, and of no other."""
        errors = [1.0, 0.3, 0.075]
        report.order("second", errors, 2, ROUTES)
        report.order("first", errors, 1, ROUTES)
        assert [check.passed for check in report.checks] == [True, False]
        assert report.checks[0].value == pytest.approx(2.0, rel=EXACT)
        assert report.checks[0].kind == "ORDER"


class TestValue:
    def test_null_needs_a_reason(self, report):
        """A value that does not exist says why, alone or in a list."""
        for undefined in (None, [1.0, None], [[1.0], [None]]):
            with pytest.raises(ValueError, match="value gain: expected a reason beside null, received none"):
                report.value("gain", undefined)
        report.value("gain", [1.0, None], reason="the error grows without bound")
        assert report.results()["values"]["gain"]["reason"] == "the error grows without bound"

    def test_nan_is_refused(self, report):
        """NaN never reaches a result."""
        with pytest.raises(ValueError, match="received NaN"):
            report.value("gain", np.array([1.0, np.nan]))
        assert report.values == {}

    def test_agrees_adds_the_check_of_the_same_name(self, report):
        """A value that the sheet's own answer contradicts fails a check."""
        answer = {"gain_steady": 0.5, "gain_first": 0.25}
        report.value("gain_steady", 0.5 + 1e-10, agrees=answer)
        report.value("gain_first", 0.25 + 1e-10, agrees=answer, routes=("a sum", "a product"), kind=EXACT)
        first, second = report.checks
        assert (first.name, first.route, first.kind, first.passed) == ("gain steady", ROUTES, "SOLVER", True)
        assert (second.route, second.kind, second.passed) == (("a sum", "a product"), "EXACT", False)
        assert first.part == "a"

    def test_a_name_is_used_once(self, report):
        """A second value, table or figure of a name would silently replace the first."""
        report.value("gain", 1)
        report.table("gains", ["K"], [[1]], "Gains.")
        report.figure("gains", Figure(), "Gains.")
        for kind, repeated in (
            ("value gain", lambda: report.value("gain", 2)),
            ("table gains", lambda: report.table("gains", ["K"], [[2]], "Gains.")),
            ("picture gains", lambda: report.figure("gains", Figure(), "Gains.")),
        ):
            with pytest.raises(ValueError, match=f"{kind}: expected a new name, received one that is taken"):
                repeated()
        assert report.values["gain"].value == 1


class TestText:
    def test_an_unknown_part_is_refused(self, report):
        """A section answers a lettered item that the sheet has."""
        with pytest.raises(ValueError, match=r"section: expected one of the parts \['a', 'b'\], received 'c'"):
            report.section("c", "No such part")

    def test_placeholders_are_filled_with_five_digits(self, report):
        """Numbers in sentences are rounded; LaTeX braces stay."""
        report.says(r"The limit of $\bar{P}$ is {limit} m².", limit=1 / 3)
        report.items(["first {n}", "second {n}"], n=2)
        assert report.blocks[-2:] == [
            Text(r"The limit of $\bar{P}$ is 0.33333 m²."),
            Text("- first 2\n- second 2"),
        ]

    def test_equations_hold_numbers_and_matrices(self, report):
        """A matrix in an equation is written out."""
        report.math(r"\Phi = {Phi}, \bar{P} = {P}, x = {text}", Phi=np.eye(2), P=1e-9, text=r"\alpha")
        shown = r"\begin{bmatrix} 1 & 0 \\ 0 & 1 \end{bmatrix}"
        assert report.blocks[-1] == Text(f"$$\n\\Phi = {shown}, \\bar{{P}} = 1\\cdot 10^{{-9}}, x = \\alpha\n$$")

    def test_a_model_is_one_displayed_equation(self, report):
        """Every matrix of the model, between one pair of double dollars."""
        report.model(ContinuousModel(F=[[-0.125]], G=[[1]], Q=[[4]], H=[[1]], Rc=[[16]], P0=[[25]]))
        text = report.blocks[-1].text
        assert text.startswith("$$\n")
        assert text.endswith("\n$$")
        assert text.count("$") == 4
        assert all(number in text for number in ("-0.125", "4", "16", "25"))

    def test_tables_and_figures_are_numbered_apart(self, report):
        """Table 1, figure 1, table 2, figure 2."""
        for name in ("first", "second"):
            report.table(name, ["k"], [[1]], "A table of {name}.", name=3)
            report.figure(name, Figure(), "A figure of {name}.", name=4)
        assert [(b.name, b.number, b.caption) for b in report.blocks if isinstance(b, Table)] == [
            ("first", 1, "A table of 3."),
            ("second", 2, "A table of 3."),
        ]
        assert [(b.name, b.number, b.caption) for b in report.blocks if isinstance(b, Picture)] == [
            ("first", 1, "A figure of 4."),
            ("second", 2, "A figure of 4."),
        ]

    def test_a_row_has_as_many_cells_as_columns(self, report):
        """A table with a missing cell is refused."""
        with pytest.raises(ValueError, match="table gains: expected 2 cells in a row, received 1"):
            report.table("gains", ["k", "K"], [(1, 2), (3,)], "Gains.")

    def test_headings_have_levels_and_parts(self, report):
        """Large divisions stand above lettered sections."""
        report.heading("Conclusions")
        report.subsection("What is left", "left")
        assert report.blocks == [Heading("First part", 3, "a"), Heading("Conclusions", 2, None), Heading("What is left", 3, None, "left")]


class TestResults:
    def test_a_report_without_checks_has_not_passed(self, report):
        """Nothing checked is nothing shown."""
        assert not report.passed
        report.check("right", 1, 1, ROUTES)
        assert report.passed
        report.check("wrong", 1, 1.05, ROUTES)
        assert not report.passed

    def test_results_have_the_form_of_the_contract(self, report):
        """Names, order and types of results.json."""
        report.value("gain_steady", np.float64(0.5), agrees={"gain_steady": 0.5})
        report.section("b", "Second part")
        report.value("gain", np.array([0.5, np.inf]), "1/s", at=np.array([1, 2]))
        report.value("poles", [1 - 2j], "1/s")
        report.value("verdict_b", np.bool_(True))
        report.value("settling_step", None, reason="it does not settle")
        assert report.results() == {
            "schema": 1,
            "lab": "task99",
            "title": "A test",
            "source": "A book, task 99",
            "seed": 3,
            "runs": 10,
            "parameters": {"Q": 0.39, "R": "inf"},
            "values": {
                "gain_steady": {"value": 0.5, "unit": "1", "part": "a"},
                "gain": {"value": [0.5, "inf"], "unit": "1/s", "part": "b", "at": [1.0, 2.0]},
                "poles": {"value": [[1.0, -2.0]], "unit": "1/s", "part": "b"},
                "verdict_b": {"value": True, "unit": "1", "part": "b"},
                "settling_step": {"value": None, "unit": "1", "part": "b", "reason": "it does not settle"},
            },
            "checks": [
                {
                    "name": "gain steady",
                    "part": "a",
                    "route": ["recursion", "closed form"],
                    "value": 0.5,
                    "expected": 0.5,
                    "tolerance": 0.5 * SOLVER,
                    "kind": "SOLVER",
                    "passed": True,
                }
            ],
        }
        assert list(report.results()) == [
            "schema",
            "lab",
            "title",
            "source",
            "seed",
            "runs",
            "parameters",
            "values",
            "checks",
        ]

    def test_results_are_json(self, report):
        """Nothing in the results is a numpy type, NaN or an infinity."""
        report.chance("NEES", Verdict(np.float64("inf"), np.float64(5.0), np.bool_(False)))
        report.holds("margin", np.array([1.0, 2.0]), ROUTES, size=np.float64(2))
        stored = report.results()
        assert json.loads(json.dumps(stored, allow_nan=False)) == stored
        assert stored["checks"][0]["value"] == "inf"
