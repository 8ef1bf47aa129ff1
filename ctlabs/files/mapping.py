"""How a table names and writes what a model measures: the table ``[data]`` of a model file, or the options of a command."""

from __future__ import annotations

import codecs
import math
from collections.abc import Iterable
from collections.abc import Mapping as Table
from dataclasses import dataclass, field, fields, replace
from typing import Any

#: Units of relative times as fractions of a second: numerator, denominator.
RELATIVE = {
    "s": (1, 1), "ms": (1, 10**3), "us": (1, 10**6), "ns": (1, 10**9), "min": (60, 1), "h": (3600, 1), "d": (86400, 1),
}  # fmt: skip
#: Units of instants on the calendar that are written as numbers.
ABSOLUTE = {
    "unix": (1, 1), "unix_ms": (1, 10**3), "unix_us": (1, 10**6), "unix_ns": (1, 10**9), "excel": (86400, 1),
}  # fmt: skip
#: Ways to write instants as words: ISO 8601, day or month or year first, a time of day.
WRITTEN = ("iso", "dmy", "mdy", "ymd", "clock")
UNITS = (*RELATIVE, *ABSOLUTE, *WRITTEN)
NO_TIME = "none"


@dataclass(frozen=True, slots=True)
class Mapping:
    """What is said of a table; what is not said is taken from the table where it has one reading.

    ``columns`` : the column of a measurement or input where it has another name (a number counts columns from 1) ·
    ``time``, ``unit`` : the column of times ("none": there are none) and how it is written · ``t0`` : "first" where the first
    row's time is that of the first instant, "model" where times count from the model's t0 · ``dt`` : the model's period for this
    record, s, 0 for its own · ``inputs`` : columns of known inputs,
    ``u0`` : what they are from t0 to the first row · ``regressors`` : columns that elements of the model name, {name: column}
    ("none": a constant stands in), ``standing`` : those for which the model has a constant ·
    ``record`` : the column that tells of which of several records a row is ·
    ``missing`` : further words or numbers for "not measured" · ``scale`` : factors of measurements and inputs · ``decimal``,
    ``thousands`` : marks in numbers · ``blank`` : whether blank lines are to "skip" or "missing" rows · ``encoding`` ·
    ``skip`` : lines above the table · ``sheet`` : of a workbook

    >>> Mapping(columns={"position": "pos [m]"}).over(Mapping(time="stamp", unit="unix_ms")).time
    'stamp'
    >>> Mapping(decimal=";")
    Traceback (most recent call last):
    ...
    ValueError: --decimal: expected . or ,, received ";"
    """

    columns: Table[str, str] = field(default_factory=dict)
    time: str = ""
    unit: str = ""
    t0: str = ""
    dt: float | None = None
    inputs: tuple[str, ...] = ()
    u0: tuple[float, ...] = ()
    regressors: Table[str, str] = field(default_factory=dict)
    standing: tuple[str, ...] = ()
    record: str = ""
    missing: tuple[str, ...] = ()
    scale: Table[str, float] = field(default_factory=dict)
    decimal: str = ""
    thousands: str = ""
    blank: str = ""
    encoding: str = ""
    skip: int = 0
    sheet: str = ""

    def __post_init__(self) -> None:
        _one_of("--time COLUMN:UNIT", self.unit, UNITS)
        _one_of("--t0", self.t0, ("first", "model"))
        _one_of("--decimal", self.decimal, (".", ","))
        _one_of("--thousands", self.thousands, (".", ",", "'", " "))
        _one_of("--blank", self.blank, ("skip", "missing"))
        if self.decimal and self.decimal == self.thousands:
            raise ValueError(f'--thousands: expected another mark than --decimal, received "{self.thousands}" for both')
        if self.dt is not None and not 0 < self.dt < math.inf:
            raise ValueError(f"--dt: expected a period > 0, s, received {self.dt!r}")
        if self.skip < 0:
            raise ValueError(f"--skip: expected a number of lines >= 0, received {self.skip}")
        for name, factor in self.scale.items():
            if not math.isfinite(factor) or factor == 0:
                raise ValueError(f"--scale {name}: expected a finite factor other than 0, received {factor!r}")
        if not all(math.isfinite(value) for value in self.u0):
            raise ValueError(f"--u0: expected finite numbers, received {', '.join(map(repr, self.u0))}")
        if self.u0 and self.inputs and len(self.u0) != len(self.inputs):
            raise ValueError(f"--u0: expected {len(self.inputs)} numbers, one for each input, received {len(self.u0)}")
        if self.encoding:
            try:
                codecs.lookup(self.encoding)
            except LookupError:
                told = f'--encoding: expected one such as utf-8, utf-16, cp1252 or cp1251, received "{self.encoding}"'
                raise ValueError(told) from None

    def over(self, other: Mapping) -> Mapping:
        """The mapping with what ``other`` says in its place: a command's options over a file's table."""
        said = {f.name: getattr(other, f.name) for f in fields(other) if getattr(other, f.name)}
        for name in ("columns", "scale", "regressors"):
            if name in said:
                said[name] = {**getattr(self, name), **said[name]}
        if "missing" in said:
            said["missing"] = tuple(dict.fromkeys([*self.missing, *said["missing"]]))
        if "time" in said and said["time"] != self.time and "unit" not in said:
            said["unit"] = ""
        return replace(self, **said)


    def table(self) -> dict[str, Any]:
        """The table ``[data]`` of a model file that says the same (a period of its own is the model's, and not in it).

        >>> Mapping(columns={"position": "pos [m]"}, time="stamp", unit="unix_ms", t0="first").table()
        {'columns': {'position': 'pos [m]', 't': 'stamp'}, 'time_unit': 'unix_ms', 't0': 'first'}
        """
        columns = {**self.columns, **({"t": self.time} if self.time else {})}
        others = {"columns", "time", "unit", "dt", "standing"}
        own = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in others}
        told = {"columns": columns, "time_unit": self.unit, **own}
        return {name: list(value) if isinstance(value, tuple) else value for name, value in told.items() if value}

    def sought(self) -> Mapping:
        """The mapping without regressors for which a constant is to stand in.

        >>> Mapping(regressors={"price": "Price", "hdop": "none"}).sought().regressors
        {'price': 'Price'}
        """
        return replace(self, regressors={name: column for name, column in self.regressors.items() if column != NO_TIME})


def _one_of(option: str, value: str, known: tuple[str, ...]) -> None:
    if value and value not in known:
        listed = ", ".join(known[:-1]) + " or " + known[-1]
        raise ValueError(f'{option}: expected {listed}, received "{value}"')


def time_option(text: str) -> tuple[str, str]:
    """The column and the unit in COLUMN[:UNIT]; a colon that no unit follows belongs to the name.

    >>> time_option("stamp:unix_ms"), time_option("t [s]"), time_option("a:b")
    (('stamp', 'unix_ms'), ('t [s]', ''), ('a:b', ''))
    """
    name, colon, unit = text.rpartition(":")
    return (name, unit) if colon and unit in UNITS else (text, "")


def pairs(option: str, words: Iterable[str]) -> dict[str, str]:
    """NAME=VALUE words of an option.

    >>> pairs("--column", ["position=pos [m]"])
    {'position': 'pos [m]'}
    """
    found = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not (equals and name.strip() and value.strip()):
            raise ValueError(f"{option} {word}: expected NAME=VALUE, received no name, no = or no value")
        found[name.strip()] = value.strip()
    return found


def pasted(*options: tuple[str, str]) -> str:
    """Options as they are typed, ready to paste.

    >>> pasted(("--column", "position=pos [m]"), ("--t0", "first"))
    '--column position="pos [m]" --t0 first'
    """
    return " ".join(f"{name} {_quoted(value)}" for name, value in options)


def _quoted(value: str) -> str:
    name, equals, rest = value.partition("=")
    if equals and name.replace("_", "").isalnum():
        return f"{name}={_word(rest)}"
    return _word(value)


def _word(value: str) -> str:
    """A word as a shell takes it for one."""
    if _bare(value):
        return value
    return f"'{value}'" if any(c in value for c in '"$`\\!') and "'" not in value else f'"{value}"'


def _bare(value: str) -> bool:
    return bool(value) and all(c.isalnum() or c in "_-+.,:/=@%" for c in value)
