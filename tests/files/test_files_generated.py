"""Tables made in all combinations of marks, encodings, clocks and gaps: read back exactly, or refused; never misread."""

from __future__ import annotations

import csv
import datetime as dt
import io

import numpy as np
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from ctlabs.files import datafile, fast
from ctlabs.files.mapping import Mapping

START = dt.datetime(2024, 5, 31, 23, 59, 50, tzinfo=dt.UTC)
GAPS = ["", "NA", "NaN", "null", "N/A", "-nan", "#N/A", ".", "?"]
ENCODINGS = ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "cp1252", "latin-1"]
#: How a clock writes the seconds since the start, and what has to be told to read it.
CLOCKS = {
    "none": (None, {}),
    "s": (lambda s: f"{s + 1:g}", {}),
    "ms": (lambda s: str(1000 * (s + 1)), {"unit": "ms"}),
    "unix": (lambda s: f"{START.timestamp() + s:.0f}", {"unit": "unix", "t0": "first"}),
    "unix_ms": (lambda s: f"{1000 * (START.timestamp() + s):.0f}", {"unit": "unix_ms", "t0": "first"}),
    "iso": (lambda s: (START + dt.timedelta(seconds=s)).isoformat(), {"unit": "iso", "t0": "first"}),
    "dmy": (lambda s: f"{START + dt.timedelta(seconds=s):%d.%m.%Y %H:%M:%S}", {"unit": "dmy", "t0": "first"}),
    "mdy": (lambda s: f"{START + dt.timedelta(seconds=s):%m/%d/%Y %I:%M:%S %p}", {"unit": "mdy", "t0": "first"}),
}


@st.composite
def columns(draw):
    """The numbers of a column, None for a gap, and how it writes them: decimals (None: as many as needed), thousands."""
    decimals = draw(st.sampled_from([None, 0, 1, 2, 3, 6]))
    whole = st.integers(-3_000_000, 3_000_000) | st.integers(-1500, 1500)
    numbers = st.builds(lambda w, f: w + f / 1e6, whole, st.integers(0, 999_999)) if decimals != 0 else whole.map(float)
    if decimals is None:
        numbers |= st.floats(allow_nan=False, allow_infinity=False) | st.sampled_from([1.125, 2.0, 1120.0, 0.001])
    return draw(st.lists(st.none() | numbers, min_size=5, max_size=5)), decimals, draw(st.booleans())


def spelled(number, decimals, grouped, point, comma):
    """A number as a program of a country writes it."""
    text = repr(number) if decimals is None else f"{number:.{decimals}f}"
    if grouped and "e" not in text:
        whole, dot, rest = text.partition(".")
        text = f"{int(whole):,}" if int(whole) or not whole.startswith("-") else "-0"
        text += dot + rest
    return text.replace(",", "\0").replace(".", point).replace("\0", comma)


@settings(max_examples=400, deadline=None)
@given(
    st.lists(columns(), min_size=1, max_size=3),
    st.sampled_from([",", ";", "\t", "|"]),
    st.sampled_from([(".", ","), (",", "."), (".", "'"), (",", " "), (",", "\u202f")]),
    st.sampled_from(ENCODINGS),
    st.sampled_from(["\n", "\r\n", "\r\r\n", "\r"]),
    st.sampled_from(sorted(CLOCKS)),
    st.sampled_from(GAPS),
    st.booleans(),
    st.sampled_from(["", "# logger 7\n", "Station Höhe\n\n"]),
    st.booleans(),
)
@example([([1120.0, 1160.0, 963.0, None, 2.0], 0, True)], ",", (".", ","), "utf-8", "\n", "none", "", False, "", False)
@example([([1.125, 2.0, 3.5, 4.0, 5.0], None, False)], ";", (",", "."), "utf-8", "\n", "s", "", False, "", True)
def test_a_table_is_read_back_exactly_or_refused(told, separator, marks, encoding, end, clock, gap, quoted, title, quickly):
    """Whatever writes it; every second example by the parser for large tables."""
    point, comma = marks
    assume("\u202f" not in marks or encoding.startswith("utf"))
    for numbers, _, grouped in told:  # all above 1000 with a mark that is also a decimal mark: as decimals, by convention
        assume(not grouped or comma not in ".," or any(n is not None and abs(n) < 1000 for n in numbers))
    write, options = CLOCKS[clock]
    names = [f"Größe{i}" for i in range(len(told))]
    rows = [[spelled(n, d, g, point, comma) if n is not None else gap for n in column] for column, d, g in told]
    right = [[float(f"{n:.{d}f}") if d is not None and n is not None else n for n in column] for column, d, _ in told]
    if write:
        rows.insert(0, [write(s).replace(".", point) if clock == "s" else write(s) for s in range(5)])
    out = io.StringIO()
    writer = csv.writer(out, delimiter=separator, lineterminator=end, quoting=csv.QUOTE_ALL if quoted else csv.QUOTE_MINIMAL)
    writer.writerow([*(["t"] if write else []), *names])
    writer.writerows(zip(*rows, strict=True))
    content = (title.replace("\n", end) + out.getvalue()).encode(encoding)
    least, fast.LEAST = fast.LEAST, 0 if quickly else fast.LEAST
    found, refusal = None, ""
    try:
        found = datafile.parse(content, names, "made.csv", Mapping(**options))
    except ValueError as error:
        refusal = str(error)
    finally:
        fast.LEAST = least
    if found is None:
        assert "\n" not in refusal
        assert 0 < len(refusal) < 500
        return
    np.testing.assert_array_equal(found.z, np.array(right, dtype=float).T)
    if write:
        np.testing.assert_allclose(found.t, np.arange(5) + (0 if options.get("t0") else 1), atol=1e-9)
    else:
        assert found.t is None


numbers = st.from_regex(r"[+-]?[0-9]{0,4}[.]?[0-9]{0,4}([eE][+-]?[0-9]{0,2})?", fullmatch=True) | st.text("0123456789.,-+eE", max_size=6)


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(numbers, numbers), min_size=1, max_size=5), st.sampled_from(";|\t"))
def test_the_parser_for_large_tables_gives_the_same_or_nothing(rows, separator):
    """Numbers well and badly formed: where it reads, the general way reads the same bits."""
    text = f"a{separator}b\n" + "".join(f"{a}{separator}{b}\n" for a, b in rows)
    found = []
    for least in (0, 10**9):
        before, fast.LEAST = fast.LEAST, least
        try:
            found.append(datafile.parse(text.encode(), ["a", "b"]).z)
        except ValueError as error:
            found.append(str(error))
        finally:
            fast.LEAST = before
    if isinstance(found[0], str) or isinstance(found[1], str):
        assert found[0] == found[1]
    else:
        np.testing.assert_array_equal(found[0], found[1])


def test_how_many_generated_tables_are_read():
    """Refusals are for what has two readings: the plain forms of every country are read."""
    for separator, point in ((",", "."), (";", ","), ("\t", ","), ("|", "."), (" ", ".")):
        text = separator.join(["t", "flow"]) + "\n" + "".join(f"{k}{separator}{k * 1.25}\n".replace(".", point) for k in range(1, 9))
        found = datafile.parse(text.encode(), ["flow"])
        np.testing.assert_array_equal(found.z[:, 0], np.arange(1, 9) * 1.25)
