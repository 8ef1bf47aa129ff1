"""A column of times as seconds: numbers of a unit, days of a spreadsheet, instants of Unix, dates and times of day."""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ctlabs.files.mapping import ABSOLUTE, RELATIVE, WRITTEN, pasted
from ctlabs.files.numbers import Numbers
from ctlabs.files.spelling import FOREIGN, INSTANT, MONTHS, NAMED, NUMBER, WORDS, shown
from ctlabs.linalg.checks import Array
from ctlabs.text import moment

#: The part of an interval between two times that rounding may take.
LOST = 1e-2
EPOCH = dt.datetime(1970, 1, 1, tzinfo=dt.UTC)
_CLOCK = re.compile(r"(\d{1,3}):(\d{2})(?::(\d{2})([.,]\d*)?)?\s*([AaPp]\.?[Mm]\.?)?", re.ASCII)
_DATE = re.compile(r"(\d{1,4})([-./ ]?)(\d{1,2})\2(\d{1,4})(?:[T ]+(.*))?", re.ASCII)
_COMPACT = re.compile(r"(\d{4})()(\d{2})(\d{2})(?:T(.*))?", re.ASCII)
_ZONE = re.compile(r"(.*?)\s*(Z|UTC|[+-]\d{2}(?::?\d{2})?)?", re.IGNORECASE)
_DIGITS = re.compile(r"(\d{2})(\d{2})(\d{2})?([.,]\d*)?", re.ASCII)


class Times(NamedTuple):
    """Times that increase.

    ``t`` (rows,), s, in the table's own count · ``since`` (rows,), s, since the first of them, without the rounding of large
    numbers · ``first`` : the first as it is written
    """

    t: Array
    since: Array
    first: str


def written(cells: Sequence[str]) -> bool:
    """Whether times are dates or times of day."""
    return any(INSTANT.fullmatch(cell.strip()) for cell in cells[:20]) and not any(
        NUMBER.fullmatch(cell.strip()) for cell in cells[:20]
    )


def ways(cell: str) -> list[str]:
    """The units in which an instant may be written.

    >>> ways("2024-05-31"), ways("31.05.2024"), ways("05/06/2024"), ways("12:00:00")
    (['iso'], ['dmy'], ['dmy', 'mdy'], ['clock'])
    """
    found = []
    for unit in WRITTEN:
        if unit == "ymd" and "iso" in found:
            continue
        try:
            _instant(cell.strip(), unit)
        except ValueError:
            continue
        found.append(unit)
    return found


def read(cells: Sequence[str], lines: Sequence[int], numbers: Numbers, unit: str) -> Times:
    """The times of a column in ``unit`` ("" for seconds); ``numbers`` is fed with them where they are numbers."""
    return several(cells, lines, numbers, unit, [None])[0]


def several(
    cells: Sequence[str], lines: Sequence[int], numbers: Numbers, unit: str, groups: Sequence[Array | None]
) -> list[Times]:
    """The times of several records in one column: of the rows of each group (None: of all rows)."""
    values = np.empty(0)
    if unit not in WRITTEN:
        if written(cells):
            _refuse_written(cells, lines, numbers)
        if not numbers.parts:
            numbers.add(cells, lines)
        values = numbers.values()
    found = []
    for rows in groups:
        own = cells if rows is None else [cells[i] for i in rows]
        places = lines if rows is None else [lines[i] for i in rows]
        if unit in WRITTEN:
            times = _written(own, places, numbers, unit)
        else:
            times = _numbers(own, values if rows is None else values[rows], unit, numbers.mapping.t0 == "first")
        _increasing(times, own, places, numbers)
        found.append(times)
    return found


def _refuse_written(cells: Sequence[str], lines: Sequence[int], numbers: Numbers) -> None:
    """Dates where numbers are expected: the unit to paste."""
    told = [set(way) for way in map(ways, cells[:1000]) if way]  # a line below the table is no instant
    found = sorted((set.intersection(*told) if told else set()) or {"iso"}, key=WRITTEN.index)
    choice = " or ".join(pasted(("--time", f"{numbers.name}:{unit}"), ("--t0", "first")) for unit in found)
    kind = "the time of day" if found == ["clock"] else "the date"
    which = ", which has several readings" if len(found) > 1 else ""
    where = f"{numbers.source}: line {lines[0]}, column {numbers.name}"
    raise ValueError(
        f"{where}: expected a number, received {kind} {shown(cells[0])}{which}: seconds from the first row on, {choice}"
    )


def _numbers(cells: Sequence[str], values: Array, unit: str, exact: bool) -> Times:
    """Numbers: as doubles, and (counted from the first) with all their digits."""
    numerator, denominator = {**RELATIVE, **ABSOLUTE}[unit or "s"]
    close = np.spacing(np.abs(values).max()) > LOST * np.abs(np.diff(values)).min(initial=np.inf)
    since = _exactly(cells, values, numerator, denominator) if exact or close else None
    if since is None:
        since = (values - values[0]) * numerator / denominator
    if unit == "excel":
        values = values - 25569
    return Times(values * numerator / denominator, since, cells[0].strip())


def _exactly(cells: Sequence[str], values: Array, numerator: int, denominator: int) -> Array | None:
    """Times since the first from their decimal digits, free of the rounding of large numbers; None where that is not possible."""
    told = [cell.strip().replace(",", ".") for cell in cells]
    if any(not text.replace(".", "", 1).isdecimal() for text in told):  # exponents, groups, signs
        return None
    places = max(len(text) - text.find(".") - 1 if "." in text else 0 for text in told)
    scaled = np.abs(values).max() * 10.0**places
    if scaled < 2**51:  # then the nearest whole number is what was written
        whole = np.rint(values * 10.0**places)
        return (whole - whole[0]) / 10.0**places * numerator / denominator
    digits = [int(behind[0] + behind[2].ljust(places, "0")) for behind in (text.partition(".") for text in told)]
    return np.array([digit - digits[0] for digit in digits], dtype=float) / 10.0**places * numerator / denominator


def _written(cells: Sequence[str], lines: Sequence[int], numbers: Numbers, unit: str) -> Times:
    """Dates and times of day, in seconds since 1970 (UTC) or since midnight."""
    seconds = np.zeros(len(cells), dtype=np.int64)
    behind = np.zeros(len(cells))
    zoned: bool | None = None
    done = np.zeros(len(cells), dtype=bool)
    if unit == "iso":
        done, zoned = _regular(cells, seconds, behind)
    for i, cell in enumerate(cells):
        if done[i]:
            continue
        text, where = cell.strip(), f"{numbers.source}: line {lines[i]}, column {numbers.name}"
        if text.lower() in WORDS:
            raise ValueError(f"{where}: expected a time, received none: only measurements may be missing")
        try:
            whole, fraction, zone = _instant(text, unit)
        except ValueError:
            others = [way for way in ways(text) if way != unit]
            hint = f" ({' or '.join(pasted(('--time', f'{numbers.name}:{way}')) for way in others)})" if others else ""
            if not others and i and i == len(cells) - 1:
                hint = FOREIGN
            raise ValueError(f"{where}: expected {_MEANT[unit]}, received {shown(text)}{hint}") from None
        if zoned not in (None, zone):
            other = cells[int(done.argmax())] if done.any() else cells[0]
            raise ValueError(
                f"{where}: expected times all with a zone or all without one, received {shown(text)} beside "
                f"{shown(other)}"
            )
        seconds[i], behind[i], zoned = whole, fraction, zone
    return Times(seconds + behind, (seconds - seconds[0]) + (behind - behind[0]), cells[0].strip())


_REGULAR = re.compile(r"(\d{4})-(\d\d)-(\d\d)([T ])(\d\d):(\d\d):(\d\d)(\.\d+)?(Z|[+-]\d\d:?\d\d)?", re.ASCII)


def _regular(cells: Sequence[str], seconds: Array, behind: Array) -> tuple[Array, bool | None]:
    """Fill in the instants that are written like the first, digit under digit; which they are, and whether a zone is told."""
    done = np.zeros(len(cells), dtype=bool)
    lengths = np.array([len(cell) for cell in cells])
    zoned = None
    for length in np.unique(lengths)[:4]:
        rows = np.flatnonzero(lengths == length)
        first = _REGULAR.fullmatch(cells[int(rows[0])])
        if not first or (zoned is not None and zoned != bool(first[9])):
            continue
        written = np.array([cells[int(i)] for i in rows])
        codes = written.view(np.uint32).reshape(len(rows), length)
        fixed = [i for i in range(length) if not first[0][i].isdecimal() or i >= length - len(first[9] or "")]
        pattern = np.array([ord(c) for c in first[0]], dtype=np.uint32)
        digits = [i for i in range(length) if i not in fixed]
        good = (codes[:, fixed] == pattern[fixed]).all(axis=1) & (
            (codes[:, digits] >= 48) & (codes[:, digits] <= 57)
        ).all(axis=1)

        def number(start: int, end: int, codes: Array = codes) -> Array:
            return (codes[:, start:end].astype(np.int64) - 48) @ 10 ** np.arange(end - start - 1, -1, -1)

        year, month, day, hour, minute, second = (number(*first.span(i)) for i in (1, 2, 3, 5, 6, 7))
        good &= (year > 1000) & (month >= 1) & (month <= 12) & (day >= 1) & (hour < 24) & (minute < 60) & (second < 60)
        months = (12 * (year - 1970) + month - 1).astype("datetime64[M]")
        days = months.astype("datetime64[D]") + (day - 1)
        good &= days.astype("datetime64[M]") == months
        told = 86400 * days.astype(np.int64) + 3600 * hour + 60 * minute + second - _offset(first[9])
        seconds[rows[good]] = told[good]
        if first[8] and len(first[8]) < 17:
            start, end = first.span(8)
            behind[rows[good]] = number(start + 1, end)[good] / 10.0 ** (end - start - 1)
        elif first[8]:
            continue
        done[rows[good]] = True
        zoned = bool(first[9])
    return done, zoned


_MEANT = {
    "iso": "a date such as 2024-05-31T12:30:00",
    "dmy": "a date with the day first, such as 31.05.2024 12:30:00",
    "mdy": "a date with the month first, such as 05/31/2024 12:30:00",
    "ymd": "a date with the year first, such as 20240531",
    "clock": "a time of day such as 12:30:00",
}


def _instant(text: str, unit: str) -> tuple[int, float, bool]:
    """Whole seconds and a fraction, since 1970 (UTC) or midnight; whether a zone is told.

    Raises
    ------
    ValueError
        It is not written so.
    """
    if unit == "clock":
        seconds, fraction = _clock(text)
        return seconds, fraction, False
    if named := NAMED.match(text):  # 31-May-2024 as 31-05-2024
        day, _mark, month, year = named.groups()
        text = f"{day}-{MONTHS.index(month.lower()) + 1:02d}-{year}{re.sub('^:', ' ', text[named.end() :])}"
        if unit != "dmy":
            raise ValueError(text)
    found = _COMPACT.fullmatch(text) or _DATE.fullmatch(text)
    if not found:
        raise ValueError(text)
    first, separator, second, third, rest = found.groups()
    if unit in ("iso", "ymd"):
        if (
            len(first) not in ((4, 2) if unit == "ymd" and separator else (4,))
            or len(third) > 2
            or (unit == "iso" and (separator not in ("-", "") or (not separator and rest is None)))
        ):
            raise ValueError(text)
        year, month, day = first, second, third
    else:
        if not separator or len(first) > 2 or len(third) not in (2, 4) or (unit == "mdy" and separator == "."):
            raise ValueError(text)
        day, month, year = (first, second, third) if unit == "dmy" else (second, first, third)
    if len(year) == 2:
        year = f"{'20' if int(year) < 70 else '19'}{year}"
    told = _ZONE.fullmatch(rest or "")
    assert told
    clock, zone = told[1], told[2]
    seconds, fraction = _clock(clock) if clock else (0, 0.0)
    date = dt.datetime(int(year), int(month), int(day), tzinfo=dt.UTC)
    return int((date - EPOCH).total_seconds()) + seconds - _offset(zone), fraction, bool(zone)


def _clock(text: str) -> tuple[int, float]:
    found = _CLOCK.fullmatch(text.strip())
    if found:
        hour, minute, second, behind, half = found.groups()
    elif compact := _DIGITS.fullmatch(text.strip()):
        hour, minute, second, behind = compact.groups()
        half = None
    else:
        raise ValueError(text)
    hours = int(hour)
    if half:
        if not 1 <= hours <= 12:
            raise ValueError(text)
        hours = hours % 12 + 12 * (half[0] in "pP")
    if int(minute) > 59 or int(second or 0) > 60 or hours > 24:
        raise ValueError(text)
    fraction = float("0" + behind.replace(",", ".")) if behind and len(behind) > 1 else 0.0
    return 3600 * hours + 60 * int(minute) + int(second or 0), fraction


def _offset(zone: str | None) -> int:
    """Seconds by which the zone's clocks are ahead of UTC."""
    if not zone or zone.upper() in ("Z", "UTC"):
        return 0
    digits = zone[1:].replace(":", "").ljust(4, "0")
    seconds = 3600 * int(digits[:2]) + 60 * int(digits[2:])
    return -seconds if zone[0] == "-" else seconds


def _increasing(times: Times, cells: Sequence[str], lines: Sequence[int], numbers: Numbers) -> None:
    """Refuse times that do not increase, with the first few rows that are late."""
    t, since = times.t, times.since
    latest = np.maximum.accumulate(since)
    late = np.flatnonzero(since[1:] <= latest[:-1]) + 1
    where = f"{numbers.source}: line"
    if late.size:
        more = f" (so are {late.size - 1} more, next in line {lines[late[1]]})" if late.size > 1 else ""
        at = int(np.argmax(latest[: late[0]] == latest[late[0] - 1]))
        numeric = NUMBER.fullmatch(cells[0].strip())
        before, now = (
            (moment(t[at], t[late[0]]), moment(t[late[0]], t[at]))
            if numeric
            else (cells[at].strip(), cells[late[0]].strip())
        )
        if numeric and before == now and cells[at].strip() != cells[late[0]].strip():
            before, now = cells[at].strip(), cells[late[0]].strip()
        hint = "; past midnight, dates have to tell the day" if ":" in now and len(now) < 14 else ""
        raise ValueError(
            f"{where} {lines[late[0]]}, column {numbers.name}: expected a time after {before} (rows in the "
            f"order of time{hint}), "
            f"received {now}{more}; {pasted(('--time', 'none'))} takes the rows for one period apart"
        )
    alike = np.flatnonzero(np.abs(np.diff(t) - np.diff(since)) > LOST * np.diff(since))
    if alike.size and numbers.mapping.t0 != "first":
        _refuse_digits(times, cells, lines, numbers, int(alike[0]) + 1)


def _refuse_digits(times: Times, cells: Sequence[str], lines: Sequence[int], numbers: Numbers, row: int) -> None:
    """Times with more digits than a double has: they can only be counted from the first."""
    raise ValueError(
        f"{numbers.source}: line {lines[row]}, column {numbers.name}: expected times that a double tells apart, "
        f"received {cells[row].strip()} "
        f"after {cells[row - 1].strip()}; {choice(numbers.name, times.first) or pasted(('--t0', 'first'))}"
    )


def choice(name: str, first: str) -> str:
    """The options for a first instant that looks like one of the calendar; empty where it does not.

    >>> choice("t", "1717156800000")
    '--time t:unix_ms --t0 first'
    """
    units = calendar(first)
    return pasted(("--time", f"{name}:{units[0]}"), ("--t0", "first")) if units else ""


def calendar(first: str) -> list[str]:
    """The units in which a number may be an instant of the calendar.

    >>> calendar("45443.5"), calendar("12.5")
    (['excel'], [])
    """
    if not NUMBER.fullmatch(first.strip()):
        return []
    value = abs(float(first.replace(",", ".")))
    likely = {"unix": 1, "unix_ms": 10**3, "unix_us": 10**6, "unix_ns": 10**9}
    units = [unit for unit, factor in likely.items() if 3e8 <= value / factor < 5e9]
    if "ymd" in ways(first):
        return ["ymd"]
    return ["excel"] if 20000 <= value < 80000 else units
