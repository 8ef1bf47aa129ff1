"""One reader of numbers for all fields: what people write is read as they mean it, and what has two readings is refused with both."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import ctlabs.workbench
from ctlabs.files.modelfile import new
from ctlabs.workbench.desk import plain
from ctlabs.workbench.desk.commands import EditCell, apply

PAGES = Path(ctlabs.workbench.__file__).parent / "pages"


@given(st.floats(allow_nan=False, allow_infinity=False), st.sampled_from("-−–"), st.sampled_from(".,"))
def test_a_number_is_read_back_however_its_signs_are_written(value: float, minus: str, mark: str) -> None:
    """To the last bit; a comma with three digits behind it may have two readings, and is then refused."""
    text = repr(value).replace("-", minus).replace(".", mark)
    try:
        assert plain.number(text) == value
    except ValueError:
        assert mark == ","
        assert re.fullmatch(r"\D?[1-9]\d{0,2},\d{3}", text)


@given(st.integers(0, 10**15), st.sampled_from(" \u00a0\u2007\u2009\u202f"))
def test_blanks_between_thousands_are_no_part_of_a_number(value: int, blank: str) -> None:
    """Thin and wide ones; of a whole number and of one with a decimal comma."""
    text = f"{value:,}".replace(",", blank)
    assert plain.whole(text, 0, 10**15) == value
    assert plain.number(f"{text},5") == value + 0.5 or value < 1000


@given(st.integers(1, 99), st.integers(-30, 30))
def test_powers_of_ten_are_read_as_they_are_printed(mantissa: int, power: int) -> None:
    """1,2·10⁻³, 1.2×10^-3, 1.2 · 10^(-3) and 1.2e-3 are one number."""
    raised = str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    told = f"{mantissa / 10}"
    ways = [f"{told}·10{raised}", f"{told}×10^{power}", f"{told} · 10^({power})", f"{told.replace('.', ',')}⋅10{raised}"]
    assert [plain.number(way) for way in ways] == [float(f"{told}e{power}")] * 4


def test_whole_numbers_are_whole() -> None:
    """In groups and as 1e3; anything else, and what is beyond the limits, is refused in one line."""
    assert [plain.whole(text, 1, 10**6) for text in ("1", " 10 000 ", "1_000", "1e3", "+5", 7)] == [1, 10000, 1000, 1000, 5, 7]
    for text in ("0", "", "1.5", "-3", "10000000", "٣", "x" * 100, "1,5", "1 00", "1e-3", "1e400"):
        with pytest.raises(ValueError, match=r"^expected a whole number from 1 to 1000000, received [^\n]{2,90}$"):
            plain.whole(text, 1, 10**6)


@pytest.mark.parametrize(
    ("text", "remedy"),
    [("1,120", "write 1.120 or 1120"), ("1.234,5", "write 1234.5"), ("1,000,000", "write 1000000"), ("-12,500", "write -12.500 or -12500")],
)
def test_two_readings_are_refused_with_both(text: str, remedy: str) -> None:
    """In a field for a number, in one for a whole number, and in a cell of the model alike."""
    for read in (plain.number, lambda text: plain.whole(text, 0, 10**7)):
        with pytest.raises(ValueError, match=f'received "{re.escape(text)}"; {remedy}$'):
            read(text)
    file, _ = apply(new(1), EditCell(("model", "F", 0, 0), text))
    assert remedy in file.problems()[0].message


def test_a_cell_takes_what_a_field_takes() -> None:
    """The file has the number, not the text; an expression stays as it was typed."""
    texts = {"0,5": "0.5", "−3": "-3", "1\u202f000": "1000", "2,5·10⁻³": "2.5e-3", "pi/2": "pi/2"}
    for text, stands in texts.items():
        file, _ = apply(new(1), EditCell(("model", "F", 0, 0), text))
        assert str(file.data()["model"]["F"][0][0]) == stands
        assert not file.problems()


def test_numbers_in_a_row() -> None:
    """Semicolons make commas decimal ones."""
    assert plain.numbers("0,5; 2") == plain.numbers("0.5, 2") == plain.numbers("0.5 2") == (0.5, 2.0)
    assert plain.numbers(" ") == plain.numbers(None) == ()
    with pytest.raises(ValueError, match=r'^expected a number, received "x"$'):
        plain.numbers("1; x")


def test_no_page_reads_numbers_by_itself() -> None:
    """Neither by Python nor by the browser: there is one reader."""
    own = re.compile(r"ui\.number\(|isdecimal|(?:int|float)\(\s*(?:str\(|text|word)")
    lines = itertools.chain.from_iterable(
        ((path.name, line.strip()) for line in path.read_text(encoding="utf-8").splitlines()) for path in sorted(PAGES.glob("*.py"))
    )
    allowed = {"entries.py", "grid.py"}  # the number of a row; the position of a slider
    assert [each for each in lines if own.search(each[1]) and each[0] not in allowed] == []
