"""Times after those of a record, written as its own are."""

from __future__ import annotations

import datetime as dt
import re
from fractions import Fraction

from ctlabs.files.mapping import ABSOLUTE, RELATIVE
from ctlabs.linalg.checks import Array


def continued(last: str, unit: str, since: Array) -> list[str] | None:
    """The times ``since`` (rows,), s, after the last one of a record, as that is written; None for what is not written so here.

    Dates with their order, zone and separator, and numbers of a unit with as many places.

    >>> import numpy as np
    >>> continued("2024-05-31T23:59:59+02:00", "iso", np.array([1.0, 2.5]))
    ['2024-06-01T00:00:00+02:00', '2024-06-01T00:00:01.500000+02:00']
    >>> continued("1717156804000", "unix_ms", np.array([1.0, 2.5]))
    ['1717156805000', '1717156806500']
    >>> continued("31.12.2024 23:30", "dmy", np.array([1800.0])), continued("45000,25", "excel", np.array([21600.0, 86400.0]))
    (['01.01.2025 00:00'], ['45000,50', '45001,25'])
    >>> continued("31.12.2024", "dmy", np.array([1800.0])), continued("2024-05-31", "iso", np.array([86400.0]))
    (None, ['2024-06-01'])
    """
    text = last.strip()
    if unit == "iso":
        try:
            begin = dt.datetime.fromisoformat(text)
        except ValueError:
            return None
        later = [begin + dt.timedelta(seconds=float(each)) for each in since]
        if len(text) == 10 and not any(each.time() != dt.time() for each in later):
            return [each.date().isoformat() for each in later]
        mark = text[10] if len(text) > 10 else "T"
        told = [each.isoformat(mark) for each in later]
        return [each.removesuffix("+00:00") + "Z" if text.endswith("Z") else each for each in told]
    if unit in ("dmy", "mdy", "ymd"):
        return _dates(text, unit, since)
    units = {**RELATIVE, **ABSOLUTE}
    return _numbers(text, *units[unit], since) if unit in units else None


def _dates(text: str, order: str, since: Array) -> list[str] | None:
    """Dates in an order of day, month and year, with a time of day where the last has one."""
    found = _DATE.fullmatch(text)
    if not found:
        return None
    parts = dict(zip(order, found.group(1, 3, 4), strict=True))
    hour, minute, second = (int(part or 0) for part in found.group(6, 7, 9))
    year = int(parts["y"]) + (0 if len(parts["y"]) == 4 else 2000 if int(parts["y"]) < 70 else 1900)
    try:
        begin = dt.datetime(year, int(parts["m"]), int(parts["d"]), hour, minute, second)
    except ValueError:  # 24:00
        return None
    later = [begin + dt.timedelta(seconds=float(each)) for each in since]
    left = [each.microsecond or (found[9] is None and each.second) or (found[5] is None and each.time() != dt.time()) for each in later]
    if any(left):
        return None
    digits = 1 if 1 in (len(parts["d"]), len(parts["m"])) else 2
    written = []
    for each in later:
        own = {"y": f"{each.year}"[-len(parts["y"]) :], "m": f"{each.month:0{digits}d}", "d": f"{each.day:0{digits}d}"}
        time = "" if found[5] is None else f"{found[5]}{each:%H:%M}" + ("" if found[9] is None else f":{each:%S}")
        written.append(found[2].join(own[letter] for letter in order) + time)
    return written


_DATE = re.compile(r"(\d{1,4})([-./])(\d{1,2})\2(\d{1,4})(?:([T ])(\d\d):(\d\d)(:(\d\d))?)?", re.ASCII)


def _numbers(text: str, numerator: int, denominator: int, since: Array) -> list[str] | None:
    """Numbers with as many places as the last has, where these tell the instants to a thousandth of what lies between."""
    if not re.fullmatch(r"-?\d+([.,]\d+)?", text, re.ASCII):
        return None
    mark = "," if "," in text else "."
    places = len(text.partition(mark)[2])
    last, one = Fraction(text.replace(",", ".")), Fraction(10) ** places
    steps = [Fraction(float(each)) * denominator / numerator for each in since]
    values = [round((last + step) * one) for step in steps]
    least = min(abs(b - a) for a, b in zip([Fraction(0), *steps], steps, strict=False))
    if any(abs(value / one - last - step) > least / 1000 for value, step in zip(values, steps, strict=True)):
        return None
    return [f"{'-' * (value < 0)}{_placed(abs(value), places, mark)}" for value in values]


def _placed(value: int, places: int, mark: str) -> str:
    digits = str(value).rjust(places + 1, "0")
    return f"{digits[:-places]}{mark}{digits[-places:]}" if places else digits
