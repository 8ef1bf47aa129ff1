"""Measured records from tables, as they are found in the world.

The names of the columns are the model's measurements, in any order and among others; what has another name, another unit or another
clock is told by a :class:`~ctlabs.files.mapping.Mapping`. What has one reading is read: separators, decimal commas, quotes, comments
and titles above the names, encodings, words for missing values. What has two is refused with both and with the option that decides;
everything else that is wrong with file, line and column. Nothing is guessed.

A text is read by Python's own reader in C, not by that of pandas, which fills short rows and forgets quotes; workbooks and columnar
files are read by pandas.
"""

from __future__ import annotations

from collections.abc import Mapping as Table
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

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
    ``u`` (rows, r), the known inputs, or None · ``regressors`` {name: (rows,)}, the columns that elements of the model name, NaN where
    a row has none · ``name`` of the record among several, or "", and its ``file`` · ``ignored``, columns that were not wanted ·
    ``notes``, what looks suspicious · ``mapping``, as it was read · ``clock``, the column of times · ``start``, the first time as it is
    written · ``stamps`` (rows,), all times as they are written
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
    regressors: Table[str, Array] = field(default_factory=dict)
    name: str = ""
    file: str = ""

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


def parse(content: bytes, measurements: Sequence[str], source: str = "data", mapping: Mapping = PLAIN) -> Record:
    """The record in the bytes of a table; ``source`` is its name in messages. With ``t0 = "first"`` times begin at 0."""
    return only(several(content, measurements, source, mapping))


def only(records: Sequence[Record]) -> Record:
    """The record, where one is wanted."""
    if len(records) > 1:
        names = ", ".join(record.name for record in records[:4]) + (", …" if len(records) > 4 else "")
        raise ValueError(f"{records[0].file}: expected one record, received {len(records)} ({names}): filter and fit take several")
    return records[0]


def several(
    content: bytes,
    measurements: Sequence[str],
    source: str = "data",
    mapping: Mapping = PLAIN,
    grid: tuple[float, float] | None = None,
) -> tuple[Record, ...]:
    """The records in the bytes of a table: one, or as many as its column of records names, in the order in which they begin.

    ``grid``: first instant and period of the model's own clock; a column that looks like times is taken without a word if it is that.
    """
    mapping = mapping.sought()
    wanted = columns_.wanted(measurements, mapping)
    layout = table.layout(text(content, source, wanted, mapping.encoding, mapping.sheet), wanted, source, mapping.skip)
    mapping = columns_.simulated(layout, measurements, mapping)
    found = columns_.find(layout, measurements, mapping, source)
    if found.doubt is not None:
        if grid is None:
            raise ValueError(found.doubt[1])
        found = replace(found, time=found.doubt[0], ignored=tuple(n for n in found.ignored if n != layout.header[found.doubt[0]]))
    thousands: dict[str, str] = {}
    while True:
        try:
            records = _records(layout, found, measurements, mapping, source, thousands)
        except TwoReadings as told:  # at most once for each column
            thousands[told.name] = told.mark
        except ValueError as error:
            if found.doubt is None:
                raise
            raise ValueError(found.doubt[1]) from error
        else:
            break
    if found.doubt is not None and grid is not None and not all(_is_clock(record, *grid) for record in records):
        raise ValueError(found.doubt[1])
    return records


def header(content: bytes, source: str, mapping: Mapping = PLAIN) -> tuple[str, ...]:
    """The names of a table's columns."""
    wanted = columns_.wanted((), mapping)
    layout = table.layout(text(content, source, wanted, mapping.encoding, mapping.sheet), wanted, source, mapping.skip)
    return tuple(map(table.plain, layout.header))


def _is_clock(record: Record, start: float, dt: float) -> bool:
    """Whether the times of a record are a model's own: one reading, whether they are taken or not."""
    assert record.t is not None
    return bool((np.abs(record.t - start - dt * np.arange(record.rows)) <= 1e-9 * np.abs(record.t).max() + 1e-6 * dt).all())


def text(content: bytes, source: str, wanted: Sequence[str] = (), encoding: str = "", sheet: str = "") -> str:
    """The text of a table, or a table of another program written as text; of a workbook, its ``sheet``."""
    content = decode.unpacked(content, source)
    if kind := decode.kind(content):
        from ctlabs.files import frames

        return frames.text(content, kind, source, sheet)
    if sheet:
        raise ValueError(f"{source}: --sheet {sheet}: expected an Excel workbook, received a text file; leave --sheet out")
    return decode.text(content, source, wanted, encoding)


def _records(
    layout: table.Layout,
    found: Columns,
    measurements: Sequence[str],
    mapping: Mapping,
    source: str,
    thousands: dict[str, str],
) -> tuple[Record, ...]:
    """One reading of the table."""

    def numbered(place: int, needed: str = "") -> Numbers:
        name = layout.header[place] or str(place + 1)
        return Numbers(
            name, source, mapping, thousands=thousands.get(name, ""), quoted=layout.mark == ",", needed=needed
        )

    columns = {place: numbered(place) for place in (*found.regressors, *found.z)}
    columns |= {place: numbered(place, "an input") for place in found.u}
    if found.time is not None:
        columns[found.time] = numbered(found.time, "a time")
    plain = fast.read(layout, mapping, source)
    gathered = None if plain is None else _plain(plain, columns, found)
    lines, cells, notes = gathered or _rows(layout, columns, found, mapping, source)
    values = {place: column.values() for place, column in columns.items() if place != found.time}
    groups = _groups(cells, lines, found, source)
    told = None if found.time is None else times.several(cells[found.time], lines, columns[found.time], mapping.unit, list(groups.values()))
    numbers.one_mark(columns)
    z, at = np.column_stack([values[place] for place in found.z]), np.asarray(lines)
    notes += suspicions.notes(z, measurements, at)
    u = _scaled(np.column_stack([values[place] for place in found.u]), mapping.inputs, mapping) if found.u else None
    z = _scaled(z, measurements, mapping)
    rows = np.column_stack([np.empty((len(z), 0)), *(values[place] for place in found.regressors)])
    rows = _scaled(rows, tuple(mapping.regressors), mapping)
    clock = "" if found.time is None else layout.header[found.time] or str(found.time + 1)
    records = []
    for i, (name, group) in enumerate(groups.items()):
        own = slice(None) if group is None else group
        t = None if told is None else told[i].since if mapping.t0 == "first" else told[i].t
        stamps: Sequence[str] = ()
        if t is not None and found.time is not None:
            t.setflags(write=False)
            stamps = cells[found.time] if group is None else [cells[found.time][row] for row in group]
        records.append(Record(
            t, z[own], at[own], f"{source}, {mapping.record} {name}" if name else source, None if u is None else u[own],
            found.ignored, tuple(notes), mapping, clock, "" if told is None else told[i].first, stamps,
            {regressor: rows[own, j] for j, regressor in enumerate(mapping.regressors)}, name, source,
        ))  # fmt: skip
    return tuple(records)


def _groups(cells: dict[int, Sequence[str]], lines: Sequence[int], found: Columns, source: str) -> dict[str, Array | None]:
    """The rows of each record by its name, in the order in which they begin; {"": None} where there is one."""
    if found.record is None:
        return {"": None}
    rows: dict[str, list[int]] = {}
    for i, cell in enumerate(cells[found.record]):
        rows.setdefault(cell.strip(), []).append(i)
    if "" in rows:
        raise ValueError(f"{source}: line {lines[rows[''][0]]}: expected the name of a record in every row, received an empty cell")
    return {name: np.array(own) for name, own in rows.items()}


def _rows(
    layout: table.Layout, columns: dict[int, Numbers], found: Columns, mapping: Mapping, source: str
) -> tuple[Sequence[int], dict[int, Sequence[str]], list[str]]:
    """Feed the columns row by row; the lines, the cells of the times and of the records' names, what is to be noted."""
    texts: dict[int, list[str]] = {place: [] for place in (found.time, found.record) if place is not None}
    lines: list[int] = []
    told = Rows(layout, found, mapping, source)
    for some, cells in told:
        by_column = list(zip(*cells, strict=True))
        lines += some
        for place in texts:
            texts[place] += by_column[place]
        for place, column in columns.items():
            if place != found.time:
                column.add(by_column[place], some)
    if not lines:
        raise ValueError(f"{source}: expected rows of numbers below the header, received none")
    return lines, dict(texts), told.notes


def _plain(
    plain: fast.Plain, columns: dict[int, Numbers], found: Columns
) -> tuple[Sequence[int], dict[int, Sequence[str]], list[str]] | None:
    """Feed the columns with numbers that are read already; None where one lacks that is needed."""
    for place, column in columns.items():
        if column.needed and np.isnan(plain.values[:, place]).any():
            return None
    lines = range(plain.line, plain.line + len(plain.values))
    for place, column in columns.items():
        column.take(plain.values[:, place].copy(), lines)
    return lines, {place: plain.cells(place) for place in (found.time, found.record) if place is not None}, []


def _scaled(values: Array, names: Sequence[str], mapping: Mapping) -> Array:
    """The columns times their factors."""
    if mapping.scale:
        values = values * np.array([mapping.scale.get(name, 1.0) for name in names])
    values.setflags(write=False)
    return values
