"""What is in a table, before anything is asked of it: columns, gaps, sampling, suspicious values, and the [data] that would read it."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ctlabs.files import columns as columns_
from ctlabs.files import datafile, fast, suspicions, table, times
from ctlabs.files.columns import counts, is_time, likely
from ctlabs.files.mapping import NO_TIME, Mapping, pasted
from ctlabs.files.numbers import Numbers, TwoReadings
from ctlabs.files.rows import Rows
from ctlabs.files.spelling import NUMBER, WORDS, short
from ctlabs.linalg.checks import Array

#: An interval that is so many times the usual one is a gap; equal values in succession that look like a stuck sensor.
GAP, STUCK = 1.5, 10
#: Lines of an excerpt: at the top, at the end, on either side of one that is asked for; cells that tell how numbers are written.
HEAD, TAIL, BESIDE, HEAD_CELLS = 8, 3, 2, 500
_ZONE = re.compile(r"(?:Z|UTC|GMT|[+-]\d\d:?\d\d)$")
SEPARATORS = {",": "a comma", ";": "a semicolon", "\t": "a tab", "|": "a bar", " ": "blanks"}


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """A column: ``kind`` is "numbers", "times", "text", "empty" or "unclear"; ``values``, the numbers; ``first`` cell; ``remarks``."""

    number: int
    name: str
    kind: str
    values: Array
    missing: int
    first: str
    remarks: tuple[str, ...] = ()

    @property
    def range(self) -> tuple[float, float] | tuple[None, None]:
        """Least and greatest number."""
        there = self.values[np.isfinite(self.values)]
        return (float(there.min()), float(there.max())) if there.size else (None, None)


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """A table seen through: its ``columns``, how it is written, the times ``t`` where a column ``clock`` holds them, the gaps.

    ``decimal`` mark of its numbers, "" where they have none · ``zone`` of its first time, as it is written, or "" · ``absent``, the words
    that stand where nothing was measured ("" for an empty cell)
    """

    source: str
    separator: str
    line: int
    rows: int
    columns: tuple[Column, ...]
    clock: str
    unit: str
    t: Array | None
    remarks: tuple[str, ...]
    data: str
    options: str
    decimal: str = ""
    zone: str = ""
    absent: tuple[str, ...] = ()

    @property
    def usual(self) -> float | None:
        """The median interval, s."""
        return None if self.t is None or len(self.t) < 2 else float(np.median(np.diff(self.t)))


def survey(content: bytes, source: str, mapping: Mapping, measurements: Sequence[str] = ()) -> Survey:
    r"""Look through the bytes of a table; with a model's ``measurements`` the suggested table names its columns.

    >>> found = survey(b"time,pos [m]\n0,1.5\n1,-9999\n2,3.5\n5,4\n", "log.csv", Mapping(), ["pos"])
    >>> [column.kind for column in found.columns], found.usual, found.options
    (['numbers', 'numbers'], 1.0, '--column pos="pos [m]" --time time --t0 first --missing -9999')
    """
    wanted = columns_.wanted(measurements, mapping.sought())
    layout = table.layout(datafile.text(content, source, wanted, mapping.encoding, mapping.sheet), wanted, source, mapping.skip)
    lines, cells, remarks, columns = _seen(layout, mapping, source)
    clock = _clock(columns, mapping, measurements)
    unit, t = mapping.unit, None
    if clock is not None:
        unit = mapping.unit or _unit(columns[clock])
        t, said = _times(columns[clock], cells[clock], lines, unit, source)
        remarks += said
    data, options = _suggested(columns, clock, unit, mapping, measurements, t)
    name = "" if clock is None else columns[clock].name
    return Survey(
        source, SEPARATORS[layout.mark], layout.line, len(lines), columns, name, unit, t, tuple(remarks), data, options,
        mapping.decimal or _mark(columns, cells), "" if clock is None else _zone(columns[clock]), _absent(columns, cells, mapping),
    )  # fmt: skip


def excerpt(
    content: bytes, source: str, mapping: Mapping, measurements: Sequence[str] = (), *, around: int | None = None
) -> list[tuple[int, list[str]]]:
    r"""The first and the last lines of a table, and those ``around`` a line, each with its number and its cells.

    >>> excerpt(b"t,z\n0,1\n1,2\n", "log.csv", Mapping(), ["z"])
    [(1, ['t', 'z']), (2, ['0', '1']), (3, ['1', '2'])]
    """
    wanted = columns_.wanted(measurements, mapping.sought())
    layout = table.layout(datafile.text(content, source, wanted, mapping.encoding, mapping.sheet), wanted, source, mapping.skip)
    lines = layout.text.replace("\r\n", "\n").replace("\r", "\n").rstrip("\n").split("\n")
    top = max(layout.line, 1) - 1
    chosen = {*range(top, top + HEAD), *range(len(lines) - TAIL, len(lines))}
    if around is not None:
        chosen |= set(range(around - 1 - BESIDE, around + BESIDE))
    found = []
    for i in sorted(chosen):
        if top <= i < len(lines):
            line = lines[i].replace('"', "") if lines[i].count('"') % 2 else lines[i]  # a cell of several lines
            found.append((i + 1, next((cells for _, cells in table.rows(line, layout.mark, source)), [])))
    return found


def _seen(
    layout: table.Layout, mapping: Mapping, source: str
) -> tuple[Sequence[int], Sequence[Sequence[str]], list[str], tuple[Column, ...]]:
    """Lines, cells and what was left out, and what each column holds; a large table of plain numbers is read at once."""
    plain = fast.read(layout, mapping, source)
    if plain is None:
        told, texts, remarks = _cells(layout, mapping, source)
        return told, texts, remarks, tuple(
            _column(i, layout.header[i], texts[i], told, layout, mapping, source) for i in range(layout.width)
        )  # fmt: skip
    lines, cells = range(plain.line, plain.line + len(plain.values)), [plain.cells(i) for i in range(layout.width)]
    columns = []
    for i, column in enumerate(plain.values.T):
        values, name = column.copy(), layout.header[i] or str(i + 1)
        for word in mapping.missing:
            if NUMBER.fullmatch(word):
                values[values == float(word.replace(",", "."))] = np.nan
        missing = int(np.isnan(values).sum())
        first = next((cell for cell in cells[i][:1000] if cell.strip()), "")
        remarks = [*suspicions.notes(values[:, None], [name], np.array(lines)), *_stuck(name, values, lines)]
        columns.append(Column(i + 1, name, "empty" if missing == len(values) else "numbers", values, missing, first, tuple(remarks)))
    return lines, cells, [], tuple(columns)


def _mark(columns: Sequence[Column], cells: Sequence[Sequence[str]]) -> str:
    """The decimal mark with which numbers are written."""
    for column, texts in zip(columns, cells, strict=True):
        for value, cell in zip(column.values[:HEAD_CELLS], texts[:HEAD_CELLS], strict=True) if column.kind == "numbers" else ():
            for mark in ",.":
                if mark in cell and NUMBER.fullmatch(cell.strip()) and float(cell.replace(",", ".")) == value:
                    return mark
    return ""


def _zone(clock: Column) -> str:
    """The zone in the first cell of a column of instants."""
    found = _ZONE.search(clock.first) if clock.kind == "times" else None
    return found[0].strip() if found else ""


def _absent(columns: Sequence[Column], cells: Sequence[Sequence[str]], mapping: Mapping) -> tuple[str, ...]:
    """What stands in the cells in which nothing was measured."""
    found: dict[str, None] = {}
    for column, texts in zip(columns, cells, strict=True):
        if column.kind == "numbers" and column.missing:
            there = np.flatnonzero(np.isnan(column.values))[:HEAD_CELLS]
            found |= dict.fromkeys(texts[i].strip() for i in there)
    return tuple(dict.fromkeys([*found, *mapping.missing]))


def _cells(layout: table.Layout, mapping: Mapping, source: str) -> tuple[list[int], list[list[str]], list[str]]:
    """The cells column by column."""
    found = columns_.Columns(
        next((i for i, name in enumerate(layout.header) if is_time(name)), None), tuple(range(layout.width)), (), ()
    )
    lines: list[int] = []
    cells: list[list[str]] = [[] for _ in range(layout.width)]
    rows = Rows(layout, found, mapping, source)
    for some, block in rows:
        lines += some
        for column, told in zip(cells, zip(*block, strict=True), strict=True):
            column += told
    if not lines:
        raise ValueError(f"{source}: expected rows of numbers below the header, received none")
    return lines, cells, rows.notes


def _column(
    i: int, name: str, cells: list[str], lines: list[int], layout: table.Layout, mapping: Mapping, source: str
) -> Column:
    """What the cells of a column are."""
    name = name or str(i + 1)
    full = [cell.strip() for cell in cells if cell.strip().lower() not in WORDS]
    missing = len(cells) - len(full)
    nothing = np.full(len(cells), np.nan)
    if not full:
        return Column(i + 1, name, "empty", nothing, missing, "")
    numeric = sum(NUMBER.fullmatch(cell) is not None for cell in full[:100])
    if times.ways(full[0]) and not NUMBER.fullmatch(full[0]):
        return Column(i + 1, name, "times", nothing, missing, full[0])
    try:
        values = _numbers(name, cells, lines, layout, mapping, source)
    except ValueError as error:
        kind = "unclear" if 2 * numeric > len(full[:100]) or "may be" in str(error) else "text"
        return Column(
            i + 1,
            name,
            kind,
            nothing,
            missing,
            full[0],
            (str(error).removeprefix(f"{source}: "),) if kind == "unclear" else (),
        )
    remarks = [*suspicions.notes(values[:, None], [name], np.array(lines)), *_stuck(name, values, lines)]
    return Column(i + 1, name, "numbers", values, int(np.isnan(values).sum()), full[0], tuple(remarks))


def _numbers(
    name: str, cells: list[str], lines: list[int], layout: table.Layout, mapping: Mapping, source: str
) -> Array:
    thousands = ""
    while True:
        column = Numbers(name, source, mapping, thousands=thousands, quoted=layout.mark == ",")
        column.add(cells, lines)
        try:
            return column.values()
        except TwoReadings as told:
            thousands = told.mark


def _stuck(name: str, values: Array, lines: Sequence[int]) -> list[str]:
    """Equal values in succession, in a column that otherwise changes."""
    change = np.flatnonzero(np.diff(values) != 0)
    if len(change) < 3 or 2 * len(change) < len(values):
        return []
    edges = np.concatenate([[-1], change, [len(values) - 1]])
    runs = np.diff(edges)
    longest = int(runs.argmax())
    if runs[longest] < STUCK:
        return []
    start = int(edges[longest]) + 1
    return [f"{name} is {values[start]:g} {runs[longest]} times in succession from line {lines[start]} on: stuck?"]


def _clock(columns: Sequence[Column], mapping: Mapping, measurements: Sequence[str]) -> int | None:
    """The column of times: as told, called t, called like times, or holding dates."""
    if mapping.time == NO_TIME:
        return None
    told = mapping.time or mapping.columns.get("t", "t")
    for chosen in (
        [i for i, c in enumerate(columns) if c.name == told and told not in measurements],
        [
            i
            for i, c in enumerate(columns)
            if is_time(c.name) and c.kind in ("numbers", "times") and c.name not in measurements
        ],
        [i for i, c in enumerate(columns) if c.kind == "times"],
    ):
        if chosen:
            return chosen[0]
    return None


def _unit(column: Column) -> str:
    """How the times are written, by their looks."""
    if column.kind == "times":
        found = times.ways(column.first)
        return found[0] if len(found) == 1 else ""
    told = times.choice("t", column.first)
    return told.split(":")[1].split()[0] if told else ""


def _times(
    column: Column, cells: Sequence[str], lines: Sequence[int], unit: str, source: str
) -> tuple[Array | None, list[str]]:
    """The times since the first, and what is remarkable of them."""
    try:
        told = times.read(cells, lines, Numbers(column.name, source, Mapping(t0="first"), needed="a time"), unit)
    except (ValueError, TwoReadings) as error:
        return None, [str(error).removeprefix(f"{source}: ")]
    t = told.since
    if len(t) < 3:
        return t, []
    steps = np.diff(t)
    usual = float(np.median(steps))
    gaps = np.flatnonzero(steps > GAP * usual)
    remarks = []
    if gaps.size:
        worst = int(gaps[steps[gaps].argmax()])
        count = f"{gaps.size} gap{'s' if gaps.size > 1 else ''}"
        remarks.append(
            f"{count} in the times, the longest of {steps[worst]:g} s behind line {lines[worst]} (usual: {usual:g} s)"
        )
    return t, remarks


def _suggested(
    columns: Sequence[Column],
    clock: int | None,
    unit: str,
    mapping: Mapping,
    measurements: Sequence[str],
    t: Array | None,
) -> tuple[str, str]:
    """The table [data] of a model file, and the same as options."""
    free = [c.name for i, c in enumerate(columns) if i != clock and c.kind in ("numbers", "unclear")]
    counting = {c.name: counts(c.values) for c in columns}
    named: dict[str, str] = dict(mapping.columns)
    for name in measurements:
        if name in free or name in named:
            continue
        rest = [column for column in free if not counting[column]]
        best = likely(name, free) or (rest[0] if len(rest) == 1 else "")
        named[name] = best or "COLUMN"
        if best:
            free.remove(best)
    if not measurements and not named:
        named = {f"MEASUREMENT_{i + 1}": name for i, name in enumerate(free[:6])}
    options = [("--column", f"{name}={column}") for name, column in named.items() if name != "t"]
    keys: dict[str, Any] = {}
    columns_told = dict(named)
    if clock is not None:
        name = columns[clock].name
        if name != "t":
            columns_told["t"] = name
        if name != "t" or unit:
            options.append(("--time", f"{name}:{unit}" if unit else name))
        if unit:
            keys["time_unit"] = unit
        far = (
            t is not None
            and columns[clock].kind == "numbers"
            and not 0 < columns[clock].values[0] < 1000 * float(np.median(np.diff(t)) if len(t) > 1 else 1.0)
        )
        if columns[clock].kind == "times" or unit or far:
            keys["t0"] = "first"
            options.append(("--t0", "first"))
    absent = dict.fromkeys(
        [
            *mapping.missing,
            *(
                note.rsplit(" ", 1)[1]
                for c in columns
                for note in c.remarks
                if "--missing " in note and "not measured, --missing" in note
            ),
        ]
    )
    if absent:
        keys["missing"] = list(absent)
        options += [("--missing", word) for word in absent]
    known = [c.name for c in columns]
    rows = {
        name: column if column in (*known, NO_TIME) else likely(column, free) or (NO_TIME if name in mapping.standing else "COLUMN")
        for name, column in mapping.regressors.items()
    }
    if rows:
        keys["regressors"] = rows
        options += [("--regressor", f"{name}={column}") for name, column in rows.items()]
    if mapping.record:
        options.append(("--record-column", mapping.record))
    for key in ("inputs", "u0", "record", "scale", "decimal", "thousands", "blank", "encoding", "skip", "sheet"):
        if getattr(mapping, key):
            keys[key] = getattr(mapping, key)
    lines = ["[data]"]
    if columns_told:
        lines.append(
            "columns = { "
            + ", ".join(f"{_key(name)} = {_toml(column)}" for name, column in columns_told.items())
            + " }"
        )
    lines += [f"{key} = {_toml(value)}" for key, value in keys.items()]
    return ("\n".join(lines) if len(lines) > 1 else ""), pasted(*options)


def _key(name: str) -> str:
    bare = name.isascii() and all(c.isalnum() or c in "_-" for c in name)
    return name if bare and name else _toml(name)


def _toml(value: Any) -> str:
    """A value as TOML."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_key(name)} = {_toml(item)}" for name, item in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value, ensure_ascii=False)


def described(column: Column) -> str:
    """The range of a column, or its first cell."""
    low, high = column.range
    return f"{low:.6g} … {high:.6g}" if low is not None else short(column.first)
