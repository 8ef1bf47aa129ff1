"""CSV files as they are found in the world: read as meant, or refused with file, line and column."""

import io
import re
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ctlabs.files import datafile, decode, reading

NAN = float("nan")


def read(text: str | bytes, *names: str):
    """The record in a text, for a model with these measurements (flow where none is named)."""
    content = text if isinstance(text, bytes) else text.encode()
    return datafile.parse(content, names or ("flow",), "data.csv")


#: A file's text and the flow that is in it.
SPELLINGS = [
    ("flow\n1120\n963.5\n", [1120, 963.5]),
    ("flow\r\n1120\r\n963.5\r\n", [1120, 963.5]),
    ("flow\r1120\r963.5\r", [1120, 963.5]),
    ("flow\n1120\n963.5", [1120, 963.5]),
    ("flow\n1120\n963.5\n\n  \n", [1120, 963.5]),
    ("\n\nflow\n1120\n963.5\n", [1120, 963.5]),
    ('"flow"\n"1120"\n 963.5 \n', [1120, 963.5]),
    ("t,flow\n1,1120\n2,963.5\n", [1120, 963.5]),
    ("flow,t\n1120,1\n963.5,2\n", [1120, 963.5]),
    ("t;flow\n1;1120\n2;963,5\n", [1120, 963.5]),
    ("t\tflow\n1\t1120\n2\t963,5\n", [1120, 963.5]),
    ('t,flow\n"1,5","1120"\n"2,5","963,5"\n', [1120, 963.5]),
    ("flow\n1120,0\n963,5\n", [1120, 963.5]),
    ("flow\n1120,0\n963,5\n7\n", [1120, 963.5, 7]),
    ("sep=;\nt;flow\n1;1120\n2;963,5\n", [1120, 963.5]),
    ("t;flow;;\n1;1120;;\n2;963,5;;\n", [1120, 963.5]),
    ("flow\n1.12e3\n+9635E-1\n", [1120, 963.5]),
    ("flow\n.5\n5.\n\u22127\n", [0.5, 5, -7]),
    ("flow\n1120\n\n963.5\n", [1120, NAN, 963.5]),
    ("flow\n\n1120\n", [NAN, 1120]),
    ('flow\n1120\n""\n', [1120, NAN]),
    ("flow\nNA\nNaN\nnan\n#N/A\n1\n", [NAN, NAN, NAN, NAN, 1]),
    ("t,flow\n1,\n2,963.5\n", [NAN, 963.5]),
    ("flow\n1\n2\n\x1a", [1, 2]),
    ("\nflow,x\n1,2\n", [1]),
    (",flow\n1,2\n", [2]),
    ("t;flow\n1;1.234,5\n", [1234.5]),
    ("t,flow\n1,1\n\n2,2\n", [1, 2]),
]


@pytest.mark.parametrize(("text", "flow"), SPELLINGS, ids=[repr(text)[:40] for text, _flow in SPELLINGS])
def test_a_table_means_the_same_in_every_spelling(text, flow):
    """Separators, decimal commas, quotes, ends of lines, blank lines, Excel's additions, missing values."""
    record = read(text)
    np.testing.assert_array_equal(record.z, np.array(flow, dtype=float)[:, None])
    assert record.missing == np.isnan(flow).sum()
    assert record.rows == len(flow)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1251"])
def test_names_are_read_in_every_encoding(encoding):
    """UTF-8 with and without a byte-order mark, UTF-16, and what old programs write."""
    np.testing.assert_array_equal(read("расход\n1,5\n2,5\n".encode(encoding), "расход").z[:, 0], [1.5, 2.5])


def test_names_are_compared_in_one_normal_form():
    """An é of one character is an é of two."""
    assert read("d\u0065\u0301bit\n1\n", "d\u00e9bit").z[0, 0] == 1


def test_columns_come_in_the_models_order_with_their_lines():
    """Whatever their order in the file; the lines are those of the file, for messages about rows."""
    record = read("b,t,a\n1,0.5,\n2,1,10\n", "a", "b")
    np.testing.assert_array_equal(record.z, [[NAN, 1], [10, 2]])
    np.testing.assert_array_equal(record.t, [0.5, 1])
    assert record.lines.tolist() == [2, 3]
    assert record.missing == 1
    assert read("flow\n1\n").t is None


def test_a_measurement_may_be_called_t():
    """Then the column is the measurement, and there are no times."""
    record = read("t,x\n3,1\n2,5\n", "t", "x")
    assert record.t is None
    np.testing.assert_array_equal(record.z, [[3, 1], [2, 5]])


#: A file and the one line with which it is refused.
REFUSED = [
    ("", r"expected a header row and rows of numbers, received an empty file"),
    (" \n\n", r"expected a header row and rows of numbers, received an empty file"),
    ("flow\n", r"expected rows of numbers below the header, received none"),
    ("flow\n\n\n", r"expected rows of numbers below the header, received none"),
    ("sep=;\n", r"expected rows of numbers below the header, received none"),
    (b"\x89PNG\r\n\x1a\n\x00\x00", r"expected a text file .* received a binary file \(a picture\)"),
    (b"flow\n\x01\x02\n", r"expected a text file .* received a binary file"),
    (b"\xff\xfeflow", r"line 1: expected .*, received .*"),
    (b"PK\x03\x04xl/workbook", r"expected a text file .* received an Excel workbook \(save it as CSV\): it cannot be opened.*"),
    ("1\n2\n", r"line 1: expected a header, .*, received numbers .*: the first line must hold names, or count .*: --column flow=1"),
    ("volume\n1\n", r'line 1: expected the column flow, received "volume"; --column flow=volume'),
    ("flwo\n1\n", r'line 1: expected .*, received "flwo"; --column flow=flwo'),
    ("Flow\n1\n", r'line 1: expected .*, received "Flow"; --column flow=Flow'),
    ("flow,flow\n1,2\n", r"line 1: expected the column flow once, received it 2 times: --column flow=1 takes the first"),
    ("t\n1\n", r'line 1: expected the column flow, received "t"'),
    ("flow\n1\nabc\n", r'line 3, column flow: expected a number, received "abc"; if it means not measured: --missing abc'),
    ("flow\n1\n12 m\n", r'line 3, column flow: expected a number, received "12 m"; a number stands alone in its cell, .*'),
    ("flow\n-\n", r'line 2, column flow: expected a number, received "-"; if .*: --missing=-'),
    ("flow\n1_000\n", r'line 2, column flow: expected a number, received "1_000"; .*'),
    ("flow\n\u0661\n", r'line 2, column flow: expected a number, received "\u0661"; .*'),
    ("flow\n" + "x" * 90 + "\n", r'line 2, column flow: expected a number, received "x{37}…"'),
    ("flow\ninf\n", r'line 2, column flow: expected a finite number, received "inf"; .*--missing inf'),
    ("flow\n-Infinity\n", r'line 2, column flow: expected a finite number, received "-Infinity"; .*--missing=-Infinity'),
    ("flow\n1e999\n", r'line 2, column flow: expected a finite number, received "1e999"; .*'),
    ("t,flow\n2024-05-31,1\n", r'line 2, column t: expected a number, received the date "2024-05-31": .*seconds.*'),
    ("t;flow\n31.05.2024 12:00;1\n", r"line 2, column t: expected a number, received the date .*"),
    ("t,flow\n12:30:01,1\n", r"line 2, column t: expected a number, received the time of day .*--time t:clock --t0 first"),
    ("t,flow\n1,1,1\n", r"line 2: expected 2 columns \(t, flow\), received 3 .*decimal comma.*"),
    ("t;flow\n1;1;1\n", r"line 2: expected 2 columns \(t, flow\), received 3"),
    ("t,flow\n1,1\n2\n", r"line 3: expected 2 columns \(t, flow\), received 1"),
    ("flow\n1\n2\n3,4\n", r"line 4: expected 1 column \(flow\), received 2 .*"),
    ("flow,x\n1,1\n\n2,2\n", r"line 3: expected 2 columns, received a blank line, .*--blank missing or --blank skip"),
    ("t,flow\n,2\n", r"line 2, column t: expected a time, received none: only measurements may be missing"),
    ("t,flow\n1,2\n1,3\n", r"line 3, column t: expected a time after 1 \(.*\), received 1; --time none .*"),
    ("t,flow\n2,2\n1,3\n3,4\n2,5\n", r"line 3, column t: expected .*, received 1 \(so are 1 more, next in line 5\); --time none .*"),
    ("t;flow\n1,5;2.5\n", r'line 2, column flow: expected one decimal mark in the file, received "2\.5" after "1,5" in line 2; .*'),
    ('t,flow\n1,"2\n3,4\n', r"line 2: expected separated values, received: .*"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "line"), REFUSED, ids=[repr(text)[:40] for text, _line in REFUSED])
def test_what_is_wrong_is_named_by_file_line_and_column(text, line):
    """One line, nothing guessed."""
    with pytest.raises(ValueError) as error:
        read(text)
    assert re.fullmatch(rf"data\.csv: {line}", str(error.value)), error.value


def test_a_file_that_cannot_be_read_is_refused(tmp_path):
    """None, a folder."""
    for path in (tmp_path / "none.csv", tmp_path):
        with pytest.raises(ValueError, match=r"expected a file that can be read, received: "):
            reading.read_record(path, ["flow"])


def test_a_file_beyond_the_limit_is_refused(tmp_path, monkeypatch):
    """Before it fills the memory."""
    monkeypatch.setattr(decode, "LARGEST", 2**20)
    (tmp_path / "big.csv").write_bytes(b"flow\n" + b"1\n" * 2**19)
    with pytest.raises(ValueError, match=r"big\.csv: expected at most 1 MB, received more"):
        reading.read_record(tmp_path / "big.csv", ["flow"])


def test_a_dash_is_the_standard_input(monkeypatch):
    """For pipes; messages call it stdin."""
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(b"flow\n1\nx\n")))
    with pytest.raises(ValueError, match=r'stdin: line 3, column flow: expected a number, received "x"'):
        reading.read_record("-", ["flow"])
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(b"flow\n1\n2\n")))
    assert reading.read_record("-", ["flow"]).z.ravel().tolist() == [1, 2]


numbers = st.one_of(st.floats(allow_nan=False, allow_infinity=False), st.just(NAN))


@settings(max_examples=40)
@given(
    st.lists(st.tuples(numbers, numbers), min_size=1, max_size=8),
    st.sampled_from([(",", "."), (";", "."), (";", ","), ("\t", ",")]),
)
def test_what_is_written_is_read_back_to_the_bit(rows, marks):
    """Every finite double in every pair of separator and decimal mark, and every gap."""
    separator, decimal = marks
    lines = [separator.join("" if x != x else repr(x).replace(".", decimal) for x in row) for row in rows]
    found = read(separator.join(["u", "v"]) + "\n" + "\n".join(lines) + "\n", "u", "v")
    np.testing.assert_array_equal(found.z, np.array(rows))


@settings(max_examples=60)
@given(st.binary(max_size=60))
def test_any_bytes_are_a_record_or_one_line_of_refusal(content):
    """No other exception, no message of two lines."""
    refusal = ""
    try:
        z = read(b"flow\n" + content).z
    except ValueError as error:
        refusal, z = str(error), np.zeros((1, 1))
    assert "\n" not in refusal
    assert z.shape[1] == 1
    assert not np.isinf(z).any()
