"""A column of cells as numbers, with the evidence of what its marks mean: decimals, or groups of thousands."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Mapping as Table
from collections.abc import Sequence

import numpy as np

from ctlabs.files.mapping import Mapping, pasted
from ctlabs.files.spelling import EITHER, FOREIGN, GROUPED, INFINITE, INSTANT, NAMED, NUMBER, WORDS, short, shown
from ctlabs.linalg.checks import Array

_CLEAN = b"0123456789+-.eE\n"
_EITHER_POINT = re.compile(r"^[+-]?[1-9]\d{0,2}\.\d{3}$", re.ASCII | re.MULTILINE)
_SPELLED = frozenset(form for word in WORDS for form in (word, word.upper(), word.capitalize(), word.title()))
_OTHER = {".": ",", ",": "."}


class TwoReadings(Exception):  # no error: the table is read once more with what was found
    """A number such as 1,234,567 says that a mark of the column parts thousands."""

    def __init__(self, name: str, mark: str) -> None:
        super().__init__(name, mark)
        self.name, self.mark = name, mark


class Numbers:
    """The numbers of a column, NaN where nothing was measured, gathered from its cells.

    Parameters
    ----------
    name : the column, for messages
    source : the file
    mapping : marks and words for missing values that were told
    thousands : the mark found to part thousands, on a second reading
    quoted : whether a comma in a cell is one in quotation marks
    needed : what has to stand there ("a time") where nothing may be missing
    """

    def __init__(
        self, name: str, source: str, mapping: Mapping, *, thousands: str = "", quoted: bool = False, needed: str = ""
    ) -> None:
        self.name, self.source, self.mapping, self.needed = name, source, mapping, needed
        self.quoted = quoted
        self.thousands = mapping.thousands or thousands
        self.parts: list[Array] = []
        #: Where each mark was met as what can only be a decimal mark; as what may be either; as what parts thousands.
        self.decimals: dict[str, tuple[int, str]] = {}
        self.either: dict[str, tuple[int, str]] = {}
        self.groups: dict[str, tuple[int, str]] = {}
        self.whole: tuple[int, str] | None = None
        self.words = _SPELLED | set(mapping.missing) | {word.strip() for word in mapping.missing}
        self.absent: list[float] = []
        for word in mapping.missing:
            if NUMBER.fullmatch(word):
                self.absent.append(_number(word))

    def add(self, cells: Sequence[str], lines: Sequence[int]) -> None:
        """Further cells with the lines in which they stand."""
        told = ["nan" if cell in self.words else cell for cell in cells]
        values = self._quickly(told, lines)
        if values is None:
            values = np.array([self._value(cell, line) for cell, line in zip(cells, lines, strict=True)], dtype=float)
        self.take(values, lines)

    def take(self, values: Array, lines: Sequence[int]) -> None:
        """Further numbers, whose marks are known to be decimal marks."""
        for number in self.absent:
            values[values == number] = np.nan
        if self.needed and np.isnan(values).any():
            self._lacks(lines[int(np.isnan(values).argmax())])
        self.parts.append(values)

    def values(self) -> Array:
        """All numbers, after the marks have proved to have one meaning."""
        self._decide()
        return np.concatenate(self.parts) if self.parts else np.zeros(0)

    def _quickly(self, told: list[str], lines: Sequence[int]) -> Array | None:
        """The numbers of cells with a decimal point, None where a cell is anything else or a mark has to be looked at."""
        if self.mapping.decimal == "," or self.thousands == ".":
            return None
        joined = "\n".join(told)
        if " " in joined:
            told = [cell.strip() for cell in told]
            told = ["nan" if cell in self.words else cell for cell in told]
            joined = "\n".join(told)
        missing = told.count("nan")
        if joined.encode("utf-8", "replace").translate(None, _CLEAN) != b"nan" * missing:
            return None
        values = None
        with contextlib.suppress(ValueError):
            values = np.array(list(map(float, told)))
        if values is None or np.isinf(values).any():
            return None
        if "." not in self.decimals or self.whole is None:
            self._evidence(told, joined, missing, lines)
        return values

    def _evidence(self, told: list[str], joined: str, missing: int, lines: Sequence[int]) -> None:
        """What the points among clean cells mean."""
        pointed, either = joined.count("."), len(_EITHER_POINT.findall(joined))
        if pointed < len(told) - missing and self.whole is None:
            self.whole = next(
                (line, cell) for cell, line in zip(told, lines, strict=True) if "." not in cell and cell != "nan"
            )
        if "." in self.decimals:
            return
        if either and "." not in self.either:
            self.either["."] = next(
                (line, cell) for cell, line in zip(told, lines, strict=True) if EITHER.fullmatch(cell)
            )
        if pointed > either:
            self.decimals["."] = next(
                (line, cell)
                for cell, line in zip(told, lines, strict=True)
                if "." in cell and not EITHER.fullmatch(cell)
            )

    def _lacks(self, line: int) -> None:
        self._refuse(line, f"expected {self.needed}, received none: only measurements may be missing")

    def _value(self, cell: str, line: int) -> float:
        """A cell as a number, NaN where it is missing."""
        text = cell.strip().replace("\u2212", "-")
        if cell in self.words or text in self.words or text.lower() in WORDS:
            return np.nan
        if NUMBER.fullmatch(text):
            value = self._marked(text, line)
        elif grouped := GROUPED.fullmatch(text):
            value = self._grouped(text, grouped, line)
        else:
            value = np.inf
        if np.isinf(value):
            self._refuse(line, self._why(text))
        return value

    def _marked(self, text: str, line: int) -> float:
        """A number with at most one mark."""
        mark = "," if "," in text else "." if "." in text else ""
        if not mark:
            self.whole = self.whole or (line, text)
            return _number(text)
        if mark == self.thousands:
            if not EITHER.fullmatch(text):
                self._refuse(
                    line, f"expected {self._called(mark)} between groups of three digits, received {shown(text)}"
                )
            return _number(text.replace(mark, ""))
        if self.mapping.decimal and mark != self.mapping.decimal:
            called = {".": "point", ",": "comma"}[self.mapping.decimal]
            way = pasted(("--thousands", mark)) if EITHER.fullmatch(text) else pasted(("--decimal", mark))
            self._refuse(
                line, f"expected a decimal {called} (--decimal {self.mapping.decimal}), received {shown(text)} ({way})"
            )
        kinds = (
            self.either if EITHER.fullmatch(text) and not self.mapping.decimal and not self.thousands else self.decimals
        )
        kinds.setdefault(mark, (line, text))
        return _number(text.replace(",", "."))

    def _grouped(self, text: str, found: re.Match[str], line: int) -> float:
        """A number whose thousands are parted: by a mark twice, by a blank or an apostrophe, or by one of two marks."""
        sign, first, rest, mark, decimal, fraction = found.groups()
        if decimal == mark or (first == "0" and rest) or (mark in ".,'" and self.thousands not in ("", mark)):
            self._refuse(line, self._why(text))
        if decimal and self.mapping.decimal not in ("", decimal):
            self._refuse(
                line,
                f"expected a decimal mark {self.mapping.decimal}, received {shown(text)} "
                f"({pasted(('--decimal', decimal))})",
            )
        if mark in ".," and mark == self.mapping.decimal:
            self._refuse(
                line,
                f"expected {shown(mark)} as the decimal mark, received {shown(text)} ({pasted(('--thousands', mark))})",
            )
        if mark in ".,":
            self.groups.setdefault(mark, (line, text))
        if decimal:
            self.decimals.setdefault(decimal, (line, text))
        return float(f"{sign}{first}{rest.replace(mark, '')}.{fraction or 0}")

    def _decide(self) -> None:
        """Refuse marks that may mean two things; have the column read again where a number shows what they mean."""
        for mark in ".,":
            if mark in self.groups and mark != self.thousands:
                if mark in self.decimals:
                    self._refuse(
                        self.groups[mark][0],
                        f"expected one meaning of {shown(mark)}, received {shown(self.groups[mark][1])} and "
                        f"{shown(self.decimals[mark][1])}",
                    )
                raise TwoReadings(self.name, mark)
            if mark not in self.either or mark in self.decimals:
                continue
            if self.whole is not None or (mark == "," and self.quoted):
                self._refuse_either(mark)
            self.decimals[mark] = self.either[mark]

    def _refuse_either(self, mark: str) -> None:
        line, text = self.either[mark]
        many, few = text.replace(mark, ""), repr(_number(text.replace(mark, ".")))
        beside = f" beside {shown(self.whole[1])}" if self.whole else ""
        self._refuse(
            line,
            f"{shown(text)}{beside} may be {many} or {few}: expected a choice, {pasted(('--thousands', mark))} "
            f"or {pasted(('--decimal', mark))}",
        )

    def _called(self, mark: str) -> str:
        return f"{shown(mark)} (--thousands {shown(mark) if mark in chr(39) + ' ' else mark})"

    def _why(self, text: str) -> str:
        """What is wrong with a cell that is no number."""
        if INFINITE.fullmatch(text) or NUMBER.fullmatch(text):
            return f"expected a finite number, received {shown(text)}{_told(text)}"
        if INSTANT.fullmatch(text):
            way = pasted(("--time", f"{self.name}:{'dmy' if NAMED.match(text) else 'iso'}"), ("--t0", "first"))
            return f"expected a number, received the date or time of day {shown(text)}: as times, {way}"
        if text == self.name.strip():
            again = "the name of the column again: a second table, or names that were written twice"
            return f"expected a number, received {shown(text)}, {again}{FOREIGN}"
        if self.needed == "a time" and not any(c.isdecimal() for c in text):
            return f"expected a number, received {shown(text)}{FOREIGN}"
        if self.needed == "a time":
            way = pasted(("--time", self.name + ":iso"), ("--t0", "first"))
            return f"expected a number, received {shown(text)}; dates are read as 2024-05-31T12:30:00: {way}"
        if "\n" in text or "\r" in text:
            return f"expected a number, received a quotation mark before {shown(' '.join(text.split()))} that is not closed in its line"
        return f"expected a number, received {shown(text)}{_told(text)}"

    def _refuse(self, line: int, what: str) -> None:
        raise ValueError(f"{self.source}: line {line}, column {self.name}: {what}")


def _told(text: str) -> str:
    """The option for a word, written with = where the word begins like an option."""
    if short(text) != text:
        return ""
    if re.match(r"\W{0,2}\d", text) and not NUMBER.fullmatch(text) and not INFINITE.fullmatch(text):
        return "; a number stands alone in its cell, written with the digits 0 to 9, such as 5.3 or 1e3"
    return "; if it means not measured: " + (
        f"--missing={text}" if text.startswith("-") else pasted(("--missing", text))
    )


def _number(text: str) -> float:
    return float(text.replace(",", ".").replace("D", "e").replace("d", "e"))


def one_mark(columns: Table[int, Numbers]) -> None:
    """Refuse a table in which two decimal marks were met, or a mark of thousands that is a decimal mark in another column."""
    met = sorted(
        (line, place, text, mark, column)
        for place, column in columns.items()
        for mark, (line, text) in column.decimals.items()
    )  # fmt: skip
    for line, _place, text, mark, column in met:
        first = met[0]
        if mark != first[3]:
            msg = (
                f"{column.source}: line {line}, column {column.name}: expected one decimal mark in the file, "
                f"received {shown(text)} "
                f"after {shown(first[2])} in line {first[0]}; "
                f"{pasted(('--decimal', first[3]), ('--thousands', _OTHER[first[3]]))} takes the other for thousands"
            )
            raise ValueError(msg)
