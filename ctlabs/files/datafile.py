"""Measured records from tables, as they are found in the world.

The names of the columns are the model's measurements, in any order and among others; what has another name, another unit or another
clock is told by a :class:`~ctlabs.files.mapping.Mapping`. What has one reading is read: separators, decimal commas, quotes, comments
and titles above the names, encodings, words for missing values. What has two is refused with both and with the option that decides;
everything else that is wrong with file, line and column. Nothing is guessed.

A text is read by Python's own reader in C, not by that of pandas, which fills short rows and forgets quotes; workbooks and columnar
files are read by pandas.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ctlabs.files import columns as columns_
from ctlabs.files import decode, fast, numbers, suspicions, table, times
from ctlabs.files.columns import Columns
from ctlabs.files.mapping import Mapping
from ctlabs.files.numbers import Numbers, TwoReadings
from ctlabs.files.rows import Rows
from ctlabs.linalg.checks import Array

PLAIN = Mapping()


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """A measured record.

    ``t`` (rows,), s, increasing, or None where the file has no times · ``z`` (rows, m) in the model's order, NaN
    where nothing was measured · ``lines`` (rows,), the line of the file each row stands in · ``source``, the file's name ·
    ``u`` (rows, r), the known inputs, or None · ``ignored``, columns that were not wanted · ``notes``, what looks suspicious ·
    ``mapping``, as it was read · ``clock``, the column of times · ``start``, the first time as it is written ·
    ``stamps`` (rows,), all times as they are written
    """

    t: Array | None
    z: Array
    lines: Array
    source: str
    u: Array | None = None
    ignored: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    mapping: Mapping = PLAIN
    clock: str = ""
    start: str = ""
    stamps: Sequence[str] = ()

    @property
    def clocked(self) -> bool:
        """Whether the times are written otherwise than as the model's seconds: as dates, or in another unit or from another start."""
        return bool(self.stamps) and (self.mapping.unit not in ("", "s") or self.mapping.t0 == "first")

    @property
    def rows(self) -> int:
        """How many instants."""
        return len(self.z)

    @property
    def missing(self) -> int:
        """How many elements were not measured."""
        return int(np.isnan(self.z).sum())


def read(path: str | Path, measurements: Sequence[str], mapping: Mapping = PLAIN) -> Record:
    r"""The record in a table.

    Parameters
    ----------
    path : the file, or "-" for the standard input
    measurements : names of the model's measurements
    mapping : how the table names and writes them

    Raises
    ------
    ValueError
        One line: file, line, column, what was expected and what was received, and what to do.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder) / "river.csv"
    ...     _ = file.write_text("t;flow\n0,5;1120\n1;\n1,5;963,5\n", encoding="utf-8")
    ...     river = read(file, ["flow"])
    >>> river.t, river.z.ravel(), river.missing
    (array([0.5, 1. , 1.5]), array([1120. ,    nan,  963.5]), 1)
    """
    source = "stdin" if str(path) == "-" else Path(path).name
    return parse(decode.content(path, source), measurements, source, mapping)


def parse(content: bytes, measurements: Sequence[str], source: str = "data", mapping: Mapping = PLAIN) -> Record:
    """The record in the bytes of a table; ``source`` is its name in messages. With ``t0 = "first"`` times begin at 0."""
    wanted = columns_.wanted(measurements, mapping)
    layout = table.layout(text(content, source, wanted, mapping.encoding), wanted, source, mapping.skip)
    found = columns_.find(layout, measurements, mapping, source)
    thousands: dict[str, str] = {}
    while True:
        try:
            return _record(layout, found, measurements, mapping, source, thousands)
        except TwoReadings as told:  # at most once for each column
            thousands[told.name] = told.mark


def text(content: bytes, source: str, wanted: Sequence[str] = (), encoding: str = "") -> str:
    """The text of a table, or a table of another program written as text."""
    content = decode.unpacked(content, source)
    if kind := decode.kind(content):
        from ctlabs.files import frames

        return frames.text(content, kind, source)
    return decode.text(content, source, wanted, encoding)


def _record(
    layout: table.Layout,
    found: Columns,
    measurements: Sequence[str],
    mapping: Mapping,
    source: str,
    thousands: dict[str, str],
) -> Record:
    """One reading of the table."""

    def numbered(place: int, needed: str = "") -> Numbers:
        name = layout.header[place] or str(place + 1)
        return Numbers(
            name, source, mapping, thousands=thousands.get(name, ""), quoted=layout.mark == ",", needed=needed
        )

    columns = {place: numbered(place) for place in found.z} | {place: numbered(place, "an input") for place in found.u}
    if found.time is not None:
        columns[found.time] = numbered(found.time, "a time")
    plain = fast.read(layout, mapping, source)
    gathered = None if plain is None else _plain(plain, columns, found)
    lines, stamps, notes = gathered or _rows(layout, columns, found, mapping, source)
    values = {place: column.values() for place, column in columns.items() if place != found.time}
    t, start = None, ""
    if found.time is not None:
        told = times.read(stamps, lines, columns[found.time], mapping.unit)
        t, start = (told.since if mapping.t0 == "first" else told.t), told.first
        t.setflags(write=False)
    numbers.one_mark(columns)
    z = np.column_stack([values[place] for place in found.z])
    notes += suspicions.notes(z, measurements, np.asarray(lines))
    clock = "" if found.time is None else layout.header[found.time] or str(found.time + 1)
    u = _scaled(np.column_stack([values[place] for place in found.u]), mapping.inputs, mapping) if found.u else None
    z = _scaled(z, measurements, mapping)
    return Record(t, z, np.asarray(lines), source, u, found.ignored, tuple(notes), mapping, clock, start, stamps)


def _rows(
    layout: table.Layout, columns: dict[int, Numbers], found: Columns, mapping: Mapping, source: str
) -> tuple[Sequence[int], Sequence[str], list[str]]:
    """Feed the columns row by row; the lines, the cells of the times, what is to be noted."""
    stamps: list[str] = []
    lines: list[int] = []
    told = Rows(layout, found, mapping, source)
    for some, cells in told:
        by_column = list(zip(*cells, strict=True))
        lines += some
        for place, column in columns.items():
            if place == found.time:
                stamps += by_column[place]
            else:
                column.add(by_column[place], some)
    if not lines:
        raise ValueError(f"{source}: expected rows of numbers below the header, received none")
    return lines, stamps, told.notes


def _plain(
    plain: fast.Plain, columns: dict[int, Numbers], found: Columns
) -> tuple[Sequence[int], Sequence[str], list[str]] | None:
    """Feed the columns with numbers that are read already; None where one lacks that is needed."""
    for place, column in columns.items():
        if column.needed and np.isnan(plain.values[:, place]).any():
            return None
    lines = range(plain.line, plain.line + len(plain.values))
    for place, column in columns.items():
        column.take(plain.values[:, place].copy(), lines)
    return lines, [] if found.time is None else plain.cells(found.time), []


def _scaled(values: Array, names: Sequence[str], mapping: Mapping) -> Array:
    """The columns times their factors."""
    if mapping.scale:
        values = values * np.array([mapping.scale.get(name, 1.0) for name in names])
    values.setflags(write=False)
    return values
