"""A record of the experiment: right ones pass, wrong variances and means are found, and every table that is none is refused in words."""

from __future__ import annotations

import re

import numpy as np
import pytest

from ctlabs.course import record
from ctlabs.course.asked import THREE_DIGITS, AskedValue
from tests.course import a_course

P = np.array([4.0, 1.0, 0.25])


def made(value: object, name: str = "posterior_variance") -> AskedValue:
    return AskedValue(name, "a", "P", "variance", "m²", np.array(value), THREE_DIGITS, 0.0, {})


def outcome(text: str, *asked: AskedValue) -> record.RecordOutcome:
    (found,) = record.outcomes(text.encode(), asked or (made(P),), "e.csv")
    return found


@pytest.mark.parametrize("value", [P, 2.0, np.diag([4.0, 9.0]), np.stack([np.diag([4.0, 9.0]), np.diag([1.0, 2.0])])])
def test_right_records_pass(value: object) -> None:
    """In a hundred of them one fails with a probability of 1e-3."""
    name = "posterior_covariance" if np.ndim(value) > 1 else "posterior_variance"
    found = [outcome(a_course.experiment([made(value, name)], seed, 40), made(value, name)) for seed in range(25)]
    assert all(each.passed for each in found)
    assert np.mean([each.p < 0.5 for each in found]) < 0.8  # p is no smaller than it says


@pytest.mark.parametrize("scale", [1.3, 0.75])
def test_a_wrong_variance_is_found_and_by_how_much(scale: float) -> None:
    found = outcome(a_course.experiment([made(P)], 1, 1000, scale=scale))
    assert not found.passed
    told = re.match(r"disagrees with theory: the mean square of the error at i = \d is ([\d.]+) times that of theory", found.words)
    assert told is not None
    assert float(told[1]) == pytest.approx(scale**2, rel=5 * np.sqrt(2 / 1000))  # the worst of three


def test_a_wrong_mean_is_found() -> None:
    draws = np.random.default_rng(1)
    rows = [f"{run},{i + 1},{np.sqrt(P[i]) * (draws.standard_normal() + 0.3 * (i == 1))}" for run in range(1000) for i in range(3)]
    found = outcome("\n".join(["run,i,error", *rows]))
    assert not found.passed
    assert "the mean error at i = 2 is not zero" in found.words


def test_power_is_what_is_said() -> None:
    """A variance wrong by ``found`` is missed as often as it is found."""
    power = outcome(a_course.experiment([made(P[:1])], 1, 200), made(P[:1])).found
    scale, one = float(np.sqrt(1 + power)), made(P[:1])
    hits = [not outcome(a_course.experiment([one], seed, 200, scale=scale), one).passed for seed in range(60)]
    assert 0.25 < np.mean(hits) < 0.75


def test_a_record_is_read_in_other_forms() -> None:
    plain = a_course.experiment([made(P)], 3)
    rows = [row.split(",") for row in plain.splitlines()[1:]]
    semicolons = "\n".join(["run;i;error", *(";".join(row).replace(".", ",") for row in rows)])
    pair = "\n".join(["i,estimate,truth", *(f"{i},{1 + float(e)},1" for _, i, e in rows)])
    named = plain.replace("error", "posterior_variance")
    longer = plain + "".join(f"{row[0]},9,{row[2]}\n" for row in rows)  # instants that are not asked for
    for text in (semicolons, pair, named, longer):
        assert outcome(text).p == pytest.approx(outcome(plain).p, rel=1e-6)


def test_a_variance_of_zero_is_met_exactly() -> None:
    value = made([1.0, 0.0])
    text = a_course.experiment([value], 1)
    assert outcome(text, value).passed
    assert not outcome(text.replace("1,2,0\n", "1,2,0.1\n", 1), value).passed


def test_few_runs_are_no_experiment() -> None:
    found = outcome(a_course.experiment([made(P)], 1, record.RUNS - 1))
    assert (found.passed, found.words) == (False, "expected at least 20 runs at i = 1, received 19")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("run,error\n1,0.5\n2,0.5\n", "expected a column i, 1 to 3, for posterior_variance, received none"),
        ("run,i,other\n1,1,0.5\n", "expected columns i and error, or estimate and truth, received i, other"),
        ("run,i,error\n1,1.5,0.5\n", "expected whole numbers in the column i, received others"),
        ("run\n1\n", "expected"),
        ("run,i,error\n1,1,abc\n", "line 2, column error: expected a number"),
        ("", "expected"),
        ("\x00\x01", "expected"),
    ],
)
def test_what_is_no_record_is_refused_in_words(text: str, said: str) -> None:
    with pytest.raises(ValueError, match=rf"^e\.csv: .*{said}"):
        outcome(text)


def test_a_lab_without_a_variance_has_no_record() -> None:
    assert record.tested([made(0.5, "gain"), made(0.5, "settling_step_variant1"), made(0.5, "variance_ratio")]) == ()
    with pytest.raises(ValueError, match="expected a lab with a variance"):
        record.outcomes(b"run,error\n1,1\n", [made(0.5, "gain")], "e.csv")
