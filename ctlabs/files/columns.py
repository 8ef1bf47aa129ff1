"""Which columns of a table are the model's: by name, or as the mapping tells; what lacks is refused with the option that helps."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from ctlabs.files import times
from ctlabs.files.mapping import NO_TIME, WRITTEN, Mapping, pasted
from ctlabs.files.spelling import GROUPED, NUMBER, WORDS, shown
from ctlabs.files.table import Layout, plain, rows
from ctlabs.linalg.checks import Array

#: Names (in lower case, without units) of columns that hold times.
TIMES = {
    "t", "time", "times", "timestamp", "timestamps", "date", "datetime", "date_time", "date time", "stamp", "utc", "clock", "epoch",
    "seconds", "elapsed", "temps", "zeit", "datum", "время", "дата", "time stamp", "unix",
    "unixtime", "unix_time", "year", "month", "day", "sec", "jahr", "monat", "tag", "uhrzeit", "fecha", "hora", "heure", "mois",
}  # fmt: skip
#: So many rows tell a column of numbers from one of words.
SAMPLE = 50
_UNIT = re.compile(r"\s*[\[(/,].*$|[ _](s|ms|us|ns|sec|utc|gmt|local)$", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Columns:
    """Places of columns: ``time`` (None where there is none), ``z`` in the model's order, ``u``; ``ignored``, the names of the rest.

    ``regressors`` in the mapping's order, which may be columns of others too · ``record``, the column that names records ·
    ``doubt``, a column that looks like times, and why it is neither taken nor left out without a word
    """

    time: int | None
    z: tuple[int, ...]
    u: tuple[int, ...]
    ignored: tuple[str, ...]
    regressors: tuple[int, ...] = ()
    record: int | None = None
    doubt: tuple[int, str] | None = None


def wanted(names: Sequence[str], mapping: Mapping) -> list[str]:
    """The names of columns by which a table is recognised."""
    told = [mapping.columns.get(name, name) for name in [*names, *mapping.inputs]]
    told += [*mapping.regressors.values(), *([mapping.record] if mapping.record else [])]
    return [*told, mapping.time or mapping.columns.get("t", "t")]


def simulated(layout: Layout, names: Sequence[str], mapping: Mapping) -> Mapping:
    """The mapping, with what the table of simulated runs (``ctlabs simulate --csv``) says by its form: run, k, t and states."""
    header = [plain(name) for name in layout.header]
    if header[:3] != ["run", "k", "t"] or mapping.record or "run" in names or "k" in names:
        return mapping
    told = {name: f"measured_{name}" for name in names if f"measured_{name}" in header and name not in mapping.columns}
    return replace(mapping, record="run", columns={**told, **mapping.columns})


def find(layout: Layout, names: Sequence[str], mapping: Mapping, source: str) -> Columns:
    """The columns of the measurements ``names``, of the inputs and of the times."""
    where = f"{source}: line {layout.line}" if layout.named else f"{source}"
    if layout.title:
        where += f" (the names, below line {1 + layout.skip}: {shown(layout.title)})"
    if not layout.named:
        _headless(layout, names, mapping, where)
    _strange(names, mapping, where)
    z = [_place(layout, mapping.columns.get(plain(name), plain(name)), where, plain(name)) for name in names]
    u = [_place(layout, mapping.columns.get(plain(name), plain(name)), where, plain(name)) for name in mapping.inputs]
    regressors = [_place(layout, _column(mapping, name), where, name, "--regressor") for name in mapping.regressors]
    record = _record(layout, mapping, where)
    time, doubt = _time(layout, names, mapping, where, [*z, *u, *([record] if mapping.record else [])], regressors)
    if None in z or None in u or None in regressors:
        _refuse(layout, [*names, *mapping.inputs, *mapping.regressors], [*z, *u, *regressors], mapping, where, time)
    _measured_twice(layout, names, mapping, where)
    places = [place for place in [*z, *u] if place is not None]
    for place in places:
        if places.count(place) > 1 or place == time:
            twice = layout.header[place] or f"column {place + 1}"
            raise ValueError(f"{where}: expected a column of its own for each name, received {shown(twice)} for two")
    rows = [place for place in regressors if place is not None]
    for name, place in zip(mapping.regressors, rows, strict=True):
        if place in (time, record):
            what = "times" if place == time else "names of records"
            raise ValueError(f"{where}: --regressor {name}: expected a column of numbers, received that of {what}")
    ignored = [name for i, name in enumerate(layout.header) if i not in {*places, *rows, time, record} and name]
    return Columns(time, tuple(places[: len(names)]), tuple(places[len(names) :]), tuple(ignored), tuple(rows), record, doubt)


def _column(mapping: Mapping, name: str) -> str:
    """The column of a regressor."""
    return mapping.columns.get(name, mapping.regressors[name])


def _record(layout: Layout, mapping: Mapping, where: str) -> int | None:
    """The place of the column that names records."""
    if not mapping.record:
        return None
    place = _place(layout, mapping.record, where)
    if place is None:
        close = difflib.get_close_matches(mapping.record, layout.header, n=1, cutoff=0.4)
        hint = f"; {pasted(('--record-column', close[0]))}" if close else ""
        raise ValueError(
            f"{where}: --record-column {mapping.record}: expected one of the columns {_listed(layout)}, "
            f"received {shown(mapping.record)}{hint}"
        )
    return place


def _measured_twice(layout: Layout, names: Sequence[str], mapping: Mapping, where: str) -> None:
    """Refuse a column beside one that says it is its measurement."""
    for name in map(plain, names):
        other = f"measured_{name}"
        if name not in mapping.columns and name in layout.header and other in layout.header and other not in names:
            options = [pasted(("--column", f"{name}={column}")) for column in (other, name)]
            raise ValueError(
                f"{where}: both {shown(name)} and {shown(other)} may be {name}: expected a choice, {' or '.join(options)}"
            )


def _strange(names: Sequence[str], mapping: Mapping, where: str) -> None:
    """Refuse names in the mapping that the model does not have."""
    known = [plain(name) for name in [*names, *mapping.inputs, *mapping.regressors]]
    for option, told in (("--column", mapping.columns), ("--scale", mapping.scale)):
        for name in told:
            if plain(name) not in known and not (option == "--column" and name == "t"):
                close = difflib.get_close_matches(name, known, n=1)
                hint = f" (did you mean {close[0]}?)" if close else ""
                what = f"{option} {name}={told[name]}"
                raise ValueError(f"{where}: {what}: expected one of {', '.join(known)}, received {shown(name)}{hint}")


def _headless(layout: Layout, names: Sequence[str], mapping: Mapping, where: str) -> None:
    """Without names in the file every column has to be told by its number."""
    columns = [*names, *mapping.inputs, *mapping.regressors]
    told = {**mapping.regressors, **mapping.columns}
    if all(told.get(plain(name), "").isdecimal() for name in columns) and (
        mapping.time or layout.width == len(columns)
    ):
        return
    shift = int(layout.width > len(columns))
    options = [
        ("--regressor" if name in mapping.regressors else "--column", f"{name}={min(i + 1 + shift, layout.width)}")
        for i, name in enumerate(columns)
    ]
    if shift:
        options.append(("--time", "1"))
    many = f"{layout.width} columns" if layout.width > 1 else "one column"
    raise ValueError(
        f"{where}: line {layout.start + layout.skip + 1}: expected a header, the names of the columns, in the "
        "first line, received numbers "
        f"in {many}: the first line must hold names, or count the columns: {pasted(*options)}"
    )


def _place(layout: Layout, column: str, where: str, name: str = "", option: str = "--column") -> int | None:
    """The place of a column, by its name or its number; None where it lacks."""
    column = plain(column)
    found = [i for i, told in enumerate(layout.header) if told == column]
    if len(found) > 1:
        choice = pasted((option, f"{name}={found[0] + 1}")) if name else pasted(("--time", str(found[0] + 1)))
        raise ValueError(
            f"{where}: expected the column {column} once, received it {len(found)} times: {choice} takes the first"
        )
    if found:
        return found[0]
    if column.isdecimal() and 1 <= int(column) <= layout.width:
        return int(column) - 1
    return None


def _time(
    layout: Layout, names: Sequence[str], mapping: Mapping, where: str, taken: Sequence[int | None], regressors: Sequence[int | None]
) -> tuple[int | None, tuple[int, str] | None]:
    """The column of times, as told or called t; and a column that looks like one, with the words by which it is refused."""
    told = mapping.time or mapping.columns.get("t", "")
    if told == NO_TIME:
        return None, None
    if told:
        place = _place(layout, told, where)
        if place is None:
            close = difflib.get_close_matches(told, layout.header, n=1, cutoff=0.4)
            hint = f"; {pasted(('--time', close[0]))}" if close else ""
            raise ValueError(
                f"{where}: --time {told}: expected one of the columns {_listed(layout)}, received {shown(told)}{hint}"
            )
        return place, None
    if "t" in layout.header and "t" not in [plain(name) for name in names] and layout.header.index("t") not in taken:
        return _place(layout, "t", where), None
    looking = [name for i, name in enumerate(layout.header) if i not in (*taken, *regressors) and is_time(name)]
    if looking and (mapping.unit or mapping.t0 or None not in taken):
        cells = [] if mapping.unit else _sample(layout).get(looking[0], [])
        clock = [("--time", f"{looking[0]}:{mapping.unit}")] if mapping.unit else _clock(looking[0], cells)
        options = [pasted(*clock), pasted(("--time", NO_TIME))]
        words = (
            f"{where}: expected a column t or a choice, received {shown(looking[0])}, which looks like times: "
            f"{options[0]} takes it, {options[1]} does not"
        )
        if mapping.unit or mapping.t0:
            raise ValueError(words)
        return None, (layout.header.index(looking[0]), words)
    if mapping.unit or mapping.t0 == "first":
        option = f"time_unit = {mapping.unit}" if mapping.unit else "--t0 first"
        raise ValueError(
            f"{where}: {option}: expected a column of times, received {_listed(layout)}; "
            f"{pasted(('--time', layout.header[0] or '1'))}"
        )
    return None, None


def is_time(name: str) -> bool:
    """Whether a column is called as columns of times are.

    >>> [is_time(name) for name in ("Time (s)", "TIMESTAMP", "t [s]", "temperature", "position")]
    [True, True, True, False, False]
    """
    return name.lower() in TIMES or _UNIT.sub("", name.lower()) in TIMES


def _refuse(
    layout: Layout, names: Sequence[str], places: Sequence[int | None], mapping: Mapping, where: str, time: int | None
) -> None:
    """Say which column lacks, and the options that would find it."""
    lacking = [plain(name) for name, place in zip(names, places, strict=True) if place is None]
    free = [name for i, name in enumerate(layout.header) if i not in places and i != time and name]
    cells = _sample(layout)
    measured = {name for name, column in cells.items() if _measures(column)}
    looking = [name for name in free if is_time(name)] if time is None and not mapping.time else []
    options, told = [], {**mapping.regressors, **mapping.columns}
    for name in lacking:
        rest = [column for column in free if column not in looking]
        numeric = [column for column in rest if column in measured] or rest
        best = likely(told.get(name, name), rest)
        if not best and name in mapping.standing:
            options.append(("--regressor", f"{name}={NO_TIME}"))  # the constant stands in
            continue
        best = best or (numeric[0] if len(numeric) == 1 else "")
        if best:
            free.remove(best)
        if best or free:
            options.append(("--regressor" if name in mapping.regressors else "--column", f"{name}={best or 'COLUMN'}"))
    if looking and "t" not in names:
        options += _clock(looking[0], cells.get(looking[0], []))
    columns = f"the column{'s' if len(lacking) > 1 else ''} {', '.join(told.get(name, name) for name in lacking)}"
    raise ValueError(
        f"{where}: expected {columns}, received {_listed(layout)}{'; ' if options else ''}{pasted(*options)}"
    )


def _sample(layout: Layout) -> dict[str, list[str]]:
    """The first cells of each column, without the missing ones."""
    below = (cells for line, cells in rows(layout.text, layout.mark, "", layout.skip) if line > layout.line and len(cells) == layout.width)
    columns = zip(*islice(below, SAMPLE), strict=True)
    return {
        name: [cell.strip() for cell in column if cell.strip().lower() not in WORDS]
        for name, column in zip(layout.header, columns, strict=False)
    }


def _measures(cells: Sequence[str]) -> bool:
    """Whether cells may be measurements: most are numbers, and they do not count the rows."""
    numbers = [cell for cell in cells if NUMBER.fullmatch(cell) or GROUPED.fullmatch(cell)]
    whole = [float(cell) for cell in cells if cell.isdecimal()]
    return 2 * len(numbers) > len(cells) and not (len(whole) == len(cells) and counts(whole))


def counts(values: Sequence[float] | Array) -> bool:
    """Whether the numbers of a column only count the rows.

    >>> counts([0.0, 1.0, 2.0]), counts([1.0, 2.0]), counts([1.0, 2.0, 4.0])
    (True, False, False)
    """
    return len(values) > 2 and bool((np.diff(values) == 1).all())


def _clock(name: str, cells: Sequence[str]) -> list[tuple[str, str]]:
    """The options for a column of times, with the unit where its looks leave no doubt."""
    dates = [cell for cell in cells if times.ways(cell) and not NUMBER.fullmatch(cell)]  # not a row of units
    told = set.intersection(*map(set, map(times.ways, dates))) if dates else set()
    found = [unit for unit in WRITTEN if unit in told] if dates else times.calendar(cells[0]) if cells else []
    return [("--time", f"{name}:{found[0]}"), ("--t0", "first")] if len(found) == 1 else [("--time", name)]


def likely(name: str, columns: Sequence[str]) -> str:
    """The column that is probably meant: of the same name but for case and unit, of its beginning, or of a similar one.

    >>> likely("position", ["time", "pos [m]", "temp"]), likely("flow", ["Flow (m3/s)", "level"]), likely("x", ["a", "b"])
    ('pos [m]', 'Flow (m3/s)', '')
    >>> likely("position", ["lat", "pos_m", "speed"]), likely("flow", ["lat", "lon"])
    ('pos_m', '')
    """
    for kind in (str.lower, lambda text: _UNIT.sub("", text.lower())):
        same = [column for column in columns if kind(column) == kind(name)]
        if len(same) == 1:
            return same[0]
    bare = {column: _UNIT.sub("", column.lower()).strip() for column in columns}
    begun = [column for column, text in bare.items() if len(text) > 1 and (name.lower().startswith(text) or text.startswith(name.lower()))]
    words = {column: re.split(r"[\s_]", text)[0] for column, text in bare.items()}
    begun = begun or [column for column, word in words.items() if len(word) > 2 and name.lower().startswith(word)]
    if len(begun) == 1:
        return begun[0]
    close = difflib.get_close_matches(name.lower(), [column.lower() for column in columns], n=1)
    return next((column for column in columns if close and column.lower() == close[0]), "")


def _listed(layout: Layout) -> str:
    """The names of the columns, not too many."""
    names = [shown(name) if name else "a column without a name" for name in layout.header]
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
