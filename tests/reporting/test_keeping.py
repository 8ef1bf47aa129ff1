"""A file that says the same is not written anew."""

import numpy as np
import pytest

from ctlabs.reporting import plots, render
from ctlabs.reporting.keeping import kept, same
from tests.reporting.test_render import META, ROUTES, Parameters, Report, files


@pytest.mark.parametrize(
    ("a", "b"),
    [
        ("x = 0.3333333333,", "x = 0.3333333334,"),
        ("-1.5e-07 and 2", "-1.5000000001e-07 and 2"),
        ("no number", "no number"),
        ("[1, 2.0]", "[1, 2.0]"),
    ],
)
def test_lines_that_agree_up_to_rounding_say_the_same(a, b):
    """The tenth digit is another machine's."""
    assert same(a, b)
    assert kept(f"{a}\nlast", f"{b}\nlast") == f"{a}\nlast"


@pytest.mark.parametrize(
    ("a", "b"),
    [
        ("x = 0.33333333,", "x = 0.33333334,"),
        ("gain 1", "gains 1"),
        ("1", "-1"),
        ("3", "4"),
        ("1e-17", "2e-17"),
        ("[1, 2]", "[1, 2, 3]"),
        ("true", "false"),
        ("0.0", "1e-30"),
    ],
)
def test_what_has_changed_is_written(a, b):
    """A digit that is known, a word, a sign, a shape, a verdict; a small number is judged by its own size."""
    assert not same(a, b)
    assert kept(f"first\n{a}", f"first\n{b}") == f"first\n{b}"


def test_a_text_with_other_lines_is_new():
    """Where one line more is there, nothing is kept."""
    assert kept("0.3333333333\n", "0.3333333334\nmore\n") == "0.3333333334\nmore\n"


def report(noise: float) -> Report:
    """A report whose numbers carry some rounding."""
    r = Report(META, Parameters(), runs=10, seed=1)
    r.section("a", "Numbers")
    numbers = np.array([1 / 3, 2e-7, 12345.678]) * (1 + noise)
    r.value("gain", numbers)
    r.table("gains", ["a", "b", "c"], [numbers], "Gains.")
    r.says("It is {x}.", x=0.125 * (1 + noise))
    r.check("gain", numbers, numbers * (1 + 1e-15), ROUTES)
    r.figure("curve", plots.lines(np.arange(9), {"x": np.arange(9) * numbers[0]}, xlabel="time, s", ylabel="x, m"), "A curve.")
    return r


def test_rounding_changes_no_file(tmp_path):
    """Two machines write the same bytes; a change of a number is written."""
    found = []
    for name, noise in (("one", 0.0), ("two", 3e-15), ("other", 1e-4)):
        render.write(report(noise), tmp_path / name)
        found.append(files(tmp_path / name))
    one, two, other = found
    assert one == two
    assert {name for name in one if one[name] != other[name]} >= {"results.json", "report.md", "tables/gains.csv"}


def test_a_report_written_again_keeps_what_it_said(tmp_path):
    """A difference of 1e-10 keeps the digits that stood there."""
    render.write(report(0.0), tmp_path / "task99")
    before = (tmp_path / "task99/results.json").read_bytes()
    render.write(report(2e-10), tmp_path / "task99")
    assert (tmp_path / "task99/results.json").read_bytes() == before
    render.write(report(1e-6), tmp_path / "task99")
    assert (tmp_path / "task99/results.json").read_bytes() != before
