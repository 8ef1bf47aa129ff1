"""Measured records from CSV files, as they are found in the world.

The first row names the columns: the model's measurements in any order, and optionally ``t`` (s). Separators are commas,
semicolons or tabs; numbers have a decimal point, or a decimal comma where the separator (or quotes) leaves no doubt; the text
is UTF-8, UTF-16 or, failing these, cp1251. An empty cell, NA or NaN is a missing measurement, and so is a blank line
inside a file of one column. Whatever is wrong is refused with the file, the line and the column; nothing is guessed.
"""

from __future__ import annotations

import csv
import difflib
import io
import json
import math
import re
import sys
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ctlabs.linalg.checks import Array
from ctlabs.text import moment

#: Larger files are refused before they fill the memory.
LARGEST = 256 * 2**20
SEPARATORS = (",", ";", "\t")
#: Cells (in lower case) that mean "not measured".
MISSING = {"", "na", "nan", "#n/a"}
INFINITE = re.compile(r"[+-]?(inf|infinity|∞)", re.IGNORECASE)
NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?", re.ASCII)
#: What no text holds.
CONTROL = re.compile(r"[\x00-\x08\x0e-\x19\x1b-\x1f]")
#: 2024-05-31, 31.05.2024, 5/31/24, 12:30, 2024-05-31T12:30:00Z
DATE = re.compile(r"\d{1,4}[-./]\d{1,2}[-./]\d{1,4}([T ].*)?|\d{1,2}:\d{2}.*")


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """A measured record.

    ``t`` (rows,), s, increasing, or None where the file has no column ``t`` · ``z`` (rows, m) in the model's order, NaN
    where nothing was measured · ``lines`` (rows,), the line of the file each row stands in · ``source``, the file's name
    """

    t: Array | None
    z: Array
    lines: Array
    source: str

    @property
    def rows(self) -> int:
        """How many instants."""
        return len(self.z)

    @property
    def missing(self) -> int:
        """How many elements were not measured."""
        return int(np.isnan(self.z).sum())


class _Row(NamedTuple):
    """The cells of a row and the line it begins in."""

    line: int
    cells: list[str]


class _Table(NamedTuple):
    """The separator, the names of the columns and their line, the rows below, how many unnamed columns stand on the right."""

    mark: str
    header: list[str]
    line: int
    rows: list[_Row]
    spare: int


def read(path: str | Path, measurements: Sequence[str]) -> Record:
    r"""The record in a CSV file.

    Parameters
    ----------
    path : the file, or "-" for the standard input
    measurements : names of the model's measurements, which the header must hold

    Raises
    ------
    ValueError
        One line: file, line, column, what was expected and what was received.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder) / "river.csv"
    ...     _ = file.write_text("t;flow\n0,5;1120\n1;\n1,5;963,5\n", encoding="utf-8")
    ...     river = read(file, ["flow"])
    >>> river.t, river.z.ravel(), river.missing
    (array([0.5, 1. , 1.5]), array([1120. ,    nan,  963.5]), 1)
    """
    source = "stdin" if str(path) == "-" else Path(path).name
    return parse(_bytes(path, source), measurements, source)


def parse(content: bytes, measurements: Sequence[str], source: str = "data") -> Record:
    """The record in the bytes of a CSV file; ``source`` is its name in messages."""
    text, names = decoded(content, source), [_plain(name) for name in measurements]
    table = _table(text, {*names, "t"}, source)
    _known(table.header, names, f"{source}: line {table.line}")
    marks: dict[str, str] = {}
    values = np.array([_numbers(row, table, marks, source) for row in table.rows])
    lines = np.array([row.line for row in table.rows])
    t = None
    if "t" in table.header and "t" not in names:
        t = values[:, table.header.index("t")]
        _increasing(t, lines, source)
        t.setflags(write=False)
    z = values[:, [table.header.index(name) for name in names]]
    z.setflags(write=False)
    return Record(t, z, lines, source)


def _bytes(path: str | Path, source: str) -> bytes:
    """What the file holds, at most LARGEST."""
    try:
        if str(path) == "-":
            if sys.stdin is None:  # closed: <&-
                raise ValueError("stdin: expected values on the standard input, received a closed one")
            content = sys.stdin.buffer.read(LARGEST + 1)
        else:
            with Path(path).open("rb") as file:
                content = file.read(LARGEST + 1)
    except OSError as error:
        raise ValueError(f"{path}: expected a file that can be read, received: {error.strerror}") from None
    if len(content) > LARGEST:
        raise ValueError(f"{source}: expected at most {LARGEST // 2**20} MB, received more")
    return content


def decoded(content: bytes, source: str) -> str:
    """The text: by its byte-order mark, as UTF-8, or as cp1251."""
    workbook = content.startswith(b"PK\x03\x04")
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        encodings = ["utf-16"]
    else:
        encodings = [] if workbook or b"\x00" in content else ["utf-8-sig", "cp1251"]
    for encoding in encodings:
        try:
            text = content.decode(encoding)
        except UnicodeDecodeError:
            continue
        if not CONTROL.search(text):
            return text.rstrip("\x1a")  # the end of a file of DOS
        break
    kind = "an Excel workbook (save it as CSV)" if workbook else "a binary file"
    raise ValueError(f"{source}: expected a text file with separated values (CSV), received {kind}")


def _table(text: str, known: set[str], source: str) -> _Table:
    """The header and the rows, with the separator that makes the header's cells names that are known."""
    if not text.strip():
        raise ValueError(f"{source}: expected a header row and rows of numbers, received an empty file")
    told = re.match(r"sep=([,;\t])[\r\n]", text)  # a line by which Excel tells the separator

    def fitness(mark: str) -> tuple[int, int]:
        try:
            header = next((row.cells for row in _rows(text, mark, source) if row.cells), [])
        except ValueError:  # quotes that make no sense with this separator
            return 0, 0
        return sum(_plain(cell) in known for cell in header), len(header)

    mark = told[1] if told else max(SEPARATORS, key=fitness)
    rows = list(_rows(text, mark, source))[1 if told else 0 :]
    while rows and _blank(rows[-1]):  # a file ends with any number of blank lines
        rows.pop()
    top = next((i for i, row in enumerate(rows) if not _blank(row)), -1)
    if len(rows) == top + 1:
        raise ValueError(f"{source}: expected rows of numbers below the header, received none")
    header = [_plain(cell) for cell in rows[top].cells]
    spare = len(header)
    while header and not header[-1]:  # empty columns that a spreadsheet left on the right
        header.pop()
    found = rows[top + 1 :]
    return _Table(mark, header, rows[top].line, _joined(found) if len(header) == 1 else found, spare - len(header))


def _rows(text: str, mark: str, source: str) -> Iterator[_Row]:
    """The rows one after another, blank ones too (they have no cells)."""
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=mark, strict=True)
    while True:
        line = reader.line_num + 1
        try:
            cells = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            raise ValueError(f"{source}: line {line}: expected separated values, received: {error}") from None
        yield _Row(line, cells)


def _blank(row: _Row) -> bool:
    """Whether the line holds nothing but spaces (a quoted empty cell is something)."""
    return not row.cells or (len(row.cells) == 1 and row.cells[0] != "" and not row.cells[0].strip())


def _joined(rows: list[_Row]) -> list[_Row]:
    """The rows of one column: where most of them are split once by a comma between digits, it is a decimal comma."""
    split = [len(row.cells) == 2 and NUMBER.fullmatch(",".join(row.cells).strip()) is not None for row in rows]
    if sum(split) < 2 or 2 * sum(split) < sum(not _blank(row) for row in rows):
        return rows
    return [_Row(row.line, [",".join(row.cells)]) if one else row for row, one in zip(rows, split, strict=True)]


def _plain(name: str) -> str:
    """A name of a column in the one spelling in which names are compared."""
    return unicodedata.normalize("NFC", name.strip().strip("\ufeff\xa0"))


def _known(header: list[str], names: list[str], where: str) -> None:
    """Refuse a header that does not hold every measurement once, and at most ``t`` beside them."""
    wanted = f"the columns {', '.join(names)}" if len(names) > 1 else f"the column {names[0]}"
    what = f"{where}: expected {wanted}" + (" and optionally t" if "t" not in names else "")
    if header and all(NUMBER.fullmatch(cell) or cell.lower() in MISSING for cell in header):
        raise ValueError(f"{what}, received numbers: the first line must hold names")
    for name in header:
        if header.count(name) > 1:
            raise ValueError(f"{what}, received {_shown(name)} {header.count(name)} times")
        if name not in names and name != "t":
            close = difflib.get_close_matches(name, [*names, "t"], n=1)
            hint = f" (did you mean {close[0]}?)" if close and close[0] not in header else ""
            raise ValueError(f"{what}, received {_shown(name) if name else 'a column without a name'}{hint}")
    lacking = [name for name in names if name not in header]
    if lacking:
        raise ValueError(f"{what}, received no {', '.join(lacking)}")


def _numbers(row: _Row, table: _Table, marks: dict[str, str], source: str) -> list[float]:
    """The numbers of a row; ``marks`` remembers where each decimal mark was met."""
    cells, wanted = row.cells, len(table.header)
    if _blank(row):
        if wanted == 1:
            return [np.nan]
        raise ValueError(f"{source}: line {row.line}: expected {wanted} columns, received a blank line")
    if wanted < len(cells) <= wanted + table.spare and not any(cell.strip() for cell in cells[wanted:]):
        cells = cells[:wanted]
    if len(cells) != wanted:
        hint = (
            " (a decimal comma needs ; or a tab between columns)"
            if wanted < len(cells) <= 2 * wanted and table.mark == ","
            else ""
        )
        columns = f"{wanted} column{'s' if wanted > 1 else ''} ({', '.join(table.header)})"
        raise ValueError(f"{source}: line {row.line}: expected {columns}, received {len(cells)}{hint}")
    values = []
    for name, cell in zip(table.header, cells, strict=True):
        try:
            values.append(_number(cell, name, marks, row.line))
        except ValueError as error:
            raise ValueError(f"{source}: line {row.line}, column {name}: {error}") from None
    return values


def _number(cell: str, name: str, marks: dict[str, str], line: int) -> float:
    """A cell as a number, NaN where it is missing."""
    text = cell.strip().replace("\u2212", "-")
    if NUMBER.fullmatch(text):
        mark = "," if "," in text else "." if "." in text else ""
        if mark and mark not in marks:
            marks[mark] = f"{_shown(text)} in line {line}"
            if len(marks) > 1:
                before = next(iter(marks.values()))
                raise ValueError(f"expected one decimal mark in the file, received {_shown(text)} after {before}")
        value = float(text.replace(",", "."))
        if not math.isinf(value):
            return value
    elif text.lower() in MISSING and name != "t":
        return np.nan
    if NUMBER.fullmatch(text) or INFINITE.fullmatch(text):
        raise ValueError(f"expected a finite number, received {_shown(text)}")
    if DATE.fullmatch(text):
        raise ValueError(f"expected a number, received the date {_shown(text)}: write times in seconds from t0")
    if name == "t" and text.lower() in MISSING:
        raise ValueError("expected a time, received none: only measurements may be missing")
    raise ValueError(f"expected a number, received {_shown(text)}")


def _increasing(t: Array, lines: Array, source: str) -> None:
    """Refuse times that do not increase, with the first few rows that are late."""
    latest = np.maximum.accumulate(t)
    late = np.flatnonzero(t[1:] <= latest[:-1]) + 1
    if late.size:
        more = f" (so are {late.size - 1} more, next in line {lines[late[1]]})" if late.size > 1 else ""
        where, before = lines[late[0]], latest[late[0] - 1]
        raise ValueError(
            f"{source}: line {where}, column t: expected a time after {moment(before, t[late[0]])} (rows in the order of time), "
            f"received {moment(t[late[0]], before)}{more}"
        )


def _shown(text: str) -> str:
    """What was received, in quotes and not too long."""
    return json.dumps(text if len(text) <= 40 else f"{text[:37]}…", ensure_ascii=False)
