"""Tables of the pages: numbers below each other by their decimal points, one sign of minus, texts as they are."""

from __future__ import annotations

import re

from hypothesis import given
from hypothesis import strategies as st

from ctlabs.workbench.pages.tables import shown, table


def cells(html: str) -> list[tuple[str, float | None]]:
    """The cells of a table, each with the room behind it in digits where it stands at the right."""
    found = re.findall(r"<td([^>]*)>([^<]*)</td>", html.partition("<tbody>")[2])
    room = (re.search(r"--behind: ([\d.]+)", told) for told, _ in found)
    return [(text, float(each[1]) if each else None) for (_, text), each in zip(found, room, strict=True)]


@given(st.lists(st.floats(-9e6, 9e6).filter(lambda x: abs(x) >= 1e-3), min_size=1))
def test_decimal_points_stand_below_each_other(values: list[float]) -> None:
    """What is behind the point, and the room behind the number, are together as wide in all rows."""
    found = cells(table(["name", "value"], [["x", value] for value in values]))
    behind = [len(text.partition(".")[2]) + (0.45 if "." in text else 0.0) for text, _ in found]
    assert {round(width + room, 6) for width, (_, room) in zip(behind, found, strict=True) if room is not None} == {max(behind)}


def test_a_column_with_a_word_is_one_of_texts() -> None:
    """It stays at the left; what is not known does not make one of it."""
    assert [room for _, room in cells(table(["", "a"], [["x", 1.5], ["y", "white"]]))] == [None, None]
    assert [room for _, room in cells(table(["", "a"], [["x", 1.5], ["y", None]]))] == [0.0, 1.45]
    assert 'class=n">a' not in table(["", "a"], [["x", 1.5], ["y", "white"]])
    assert '<th scope="col" class=n>a' in table(["", "a"], [["x", 1.5]])


@given(st.complex_numbers(allow_nan=False, allow_infinity=False))
def test_one_number_has_one_sign_of_minus(value: complex) -> None:
    """The mathematical one, in real and imaginary part and in powers of ten."""
    assert "-" not in shown(value)
    assert "-" not in shown(value.real)


def test_names_of_a_person_are_texts() -> None:
    """With a hyphen, or with signs that mean something in HTML."""
    assert "<b>" not in table(["<b>"], [["-x"], ["<b>"]])
    assert shown("-x") == "-x"
