"""The rows of a table that are measurements: blank lines, rows of units, surplus and lacking cells."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator

from ctlabs.files.columns import Columns
from ctlabs.files.mapping import Mapping
from ctlabs.files.spelling import FOREIGN, GROUPED, INSTANT, NUMBER, WORDS, short, shown
from ctlabs.files.table import Layout, chunks, is_comment, is_data, is_value, rows

#: Rows below the names that may hold units and kinds of values.
BELOW = 3
#: Units, in lower case.
_UNITS = frozenset({
    "s", "sec", "ms", "us", "ns", "min", "h", "hr", "d", "day", "m", "mm", "cm", "km", "um", "nm", "ft", "in", "kg", "g", "mg", "t", "n",
    "kn", "pa", "hpa", "kpa", "mpa", "bar", "mbar",
    "k", "c", "f", "degc", "degf", "deg", "rad", "v", "mv", "kv", "a", "ma", "w", "kw", "mw",
    "j", "kj", "hz", "khz", "mhz", "m/s", "km/h", "m/s2", "m/s^2", "m/s²", "deg/s", "rad/s", "rpm", "m3/s", "m³/s", "l/s", "l/min",
    "m2", "m3", "m²", "m³", "%", "ppm", "ppb", "g/l", "mg/l", "mol", "db", "lux", "ohm", "ω", "°c", "°f", "°", "mm/h", "n/m",
    "µs", "µm", "µg", "ug", "l", "ml", "wh", "kwh", "ah", "μs", "μm", "μg",
})  # fmt: skip


class Rows:
    """The rows in blocks of lines and cells, each row as wide as the table.

    ``notes`` says afterwards what was left out.
    """

    def __init__(self, layout: Layout, columns: Columns, mapping: Mapping, source: str) -> None:
        self.layout, self.columns, self.mapping, self.source = layout, columns, mapping, source
        self.notes: list[str] = []
        self.width = layout.width
        self.leading = 0
        self.single = layout.width == 1
        self.split = self.filled = 0
        self.comma: tuple[int, str] | None = None

    def __iter__(self) -> Iterator[tuple[list[int], list[list[str]]]]:
        """Blocks of rows."""
        if "\n" in self.layout.text or "\r" in self.layout.text:
            self._double_spaced()
        for number, (lines, cells) in enumerate(chunks(self.layout, self.source)):
            if number == 0:
                lines, cells = self._below(lines, cells)
                self.leading = self._row_names(cells)
            widths = set(map(len, cells))
            if widths != {self.width} or self.single:
                lines, cells = self._squared(lines, cells)
            if self.columns.time is not None and any(not row[self.columns.time] for row in cells):
                lines, cells = _full(lines, cells)
            if cells:
                yield lines, cells
        if self.single and self.comma and (self.split < 2 or 2 * self.split < self.filled):
            self._refuse_single(*self.comma)
        self._comments()

    def _below(self, lines: list[int], cells: list[list[str]]) -> tuple[list[int], list[list[str]]]:
        """Without rows of units right below the names."""
        for row in cells[:BELOW] if self.layout.named else ():
            if not self._is_units(row):
                break
            self.notes.append(
                f"line {lines[0]} is a row of units: {short(', '.join(cell for cell in row if cell.strip()))}"
            )
            lines, cells = lines[1:], cells[1:]
        return lines, cells

    def _is_units(self, row: list[str]) -> bool:
        told = [cell.strip() for cell in row]
        full = [cell for cell in told if cell]
        missing = {word.lower() for word in self.mapping.missing} | WORDS
        if not full or any(
            NUMBER.fullmatch(cell) or INSTANT.fullmatch(cell) or cell.lower() in missing for cell in full
        ):
            return False
        if any(any(c.isdecimal() for c in cell) and not _units(cell) for cell in full):
            return False
        if self.columns.time is not None and self.columns.time < len(told):
            return True  # a measurement has a time
        own = [told[place] for place in self.columns.z if place < len(told)]
        return all(
            _units(cell) and not (len(cell) == 1 and cell.isalpha()) for cell in own if cell
        )  # m may mean missing

    def _row_names(self, cells: list[list[str]]) -> int:
        """1 where R wrote the numbers of the rows before them, and no name for them."""
        full = [row for row in cells if row]
        if self.layout.mark not in (" ", "\t") or not full or any(len(row) != self.width + 1 for row in full):
            return 0
        return int([row[0] for row in full] == [str(i + 1) for i in range(len(full))])

    def _squared(self, lines: list[int], cells: list[list[str]]) -> tuple[list[int], list[list[str]]]:
        """Rows of the width of the table: blank ones as missing or left out, surplus cells dropped where they are empty."""
        told_lines, told = [], []
        for line, row in zip(lines, cells, strict=True):
            found = self._row(line, row)
            if found is not None:
                told_lines.append(line)
                told.append(found)
        return told_lines, told

    def _row(self, line: int, row: list[str]) -> list[str] | None:
        if not row:
            return self._blank(line)
        if self.leading:
            row = row[1:]
        if len(row) > self.width and not any(cell.strip() for cell in row[self.width :]):
            row = row[: self.width]
        if len(row) != self.width:
            self._refuse_width(line, row)
        if self.single:
            self._single(line, row[0])
        return row

    def _blank(self, line: int) -> list[str] | None:
        if self.mapping.blank == "skip" or (self.columns.time is not None and not self.mapping.blank):
            return None
        if self.mapping.blank == "missing" and self.columns.time is not None:
            raise ValueError(f"{self.source}: line {line}: expected a time, received a blank line; --blank skip")
        if self.single or self.mapping.blank:
            return [""] * self.width
        raise ValueError(
            f"{self.source}: line {line}: expected {self.width} columns, received a blank line, which may be a "
            "missing row or nothing: --blank missing or --blank skip"
        )

    def _single(self, line: int, cell: str) -> None:
        """In a table of one column a comma is a decimal comma, if most of the cells have one."""
        text = cell.strip()
        self.filled += bool(text)
        if "," not in text or self.layout.mark == ",":
            return
        parts = text.split(",")
        if (len(parts) == 2 and NUMBER.fullmatch(text)) or GROUPED.fullmatch(text):
            self.split += 1
            self.comma = self.comma or (line, text)
        elif all(NUMBER.fullmatch(part.strip()) for part in parts) and not all(len(part) == 3 for part in parts[1:]):
            self._refuse_single(line, text)

    def _refuse_single(self, line: int, text: str) -> None:
        count = len(text.split(","))
        hint = f" ({shown(text)} with a decimal comma: --decimal ,)" if count == 2 else " (one value in each line)"
        if count == 2 and self.mapping.decimal == ",":
            return
        raise ValueError(
            f"{self.source}: line {line}: expected 1 column ({self.layout.header[0]}), received {count}{hint}"
        )

    def _refuse_width(self, line: int, row: list[str]) -> None:
        hint = ""
        if self.width < len(row) <= 2 * self.width and self.layout.mark in ", ":
            hint = " (a decimal comma needs ; or a tab between columns)"
        if self.layout.mark == " ":
            hint = " (columns are parted by spaces)"
        if len(row) < self.width and not any(is_value(cell.strip()) for cell in row if cell.strip()):
            hint = FOREIGN
        columns = f"{self.width} column{'s' if self.width > 1 else ''} ({short(', '.join(self.layout.header))})"
        raise ValueError(f"{self.source}: line {line}: expected {columns}, received {len(row)}{hint}")

    def _double_spaced(self) -> None:
        """Refuse blank lines that alternate with the values: they may be missing rows, or how the file is written."""
        if self.mapping.blank or not self.single:
            return
        full: list[int] = []
        for lines, cells in chunks(self.layout, self.source):
            full += [line for line, row in zip(lines, cells, strict=True) if row]
            if len(full) > 2:
                break
        begins = self.layout.line or full[0] if full else 0
        steps = [b - a for a, b in itertools.pairwise(full)]
        below = full[0] - begins if full and self.layout.named else 0
        if len(full) < 2 or len(set(steps[:2])) > 1 or steps[0] < 2 or (len(full) == 2 and below != steps[0]):
            return
        if self._regular(steps[0]):
            raise ValueError(
                f"{self.source}: line {full[0] + 1}: a blank line {'behind' if below < 2 else 'before'} every "
                "value may be a missing value or nothing: "
                "expected a choice, --blank skip or --blank missing"
            )

    def _regular(self, step: int) -> bool:
        """Whether all values stand ``step`` lines apart."""
        before = 0
        for lines, cells in chunks(self.layout, self.source):
            for line, row in zip(lines, cells, strict=True):
                if row:
                    if before and line - before != step:
                        return False
                    before = line
        return True

    def _comments(self) -> None:
        """Refuse rows behind a comment sign where no time tells that they are left out."""
        if self.columns.time is not None or "#" not in self.layout.text:
            return
        for number, (line, cells) in enumerate(rows(self.layout.text, self.layout.mark, self.source, self.layout.skip)):
            if number >= self.layout.start and is_comment(cells):
                bare = [cells[0].lstrip().lstrip("#"), *cells[1:]]
                if len(bare) == self.width and is_data(bare):
                    raise ValueError(
                        f"{self.source}: line {line}: a row of numbers behind # may be a missing row or none: "
                        "expected rows without #, "
                        f"received {shown(','.join(cells))}; write empty cells, or delete the line"
                    )


def _full(lines: list[int], cells: list[list[str]]) -> tuple[list[int], list[list[str]]]:
    """Without the rows of empty cells that a spreadsheet leaves below a table."""
    kept = [i for i, row in enumerate(cells) if any(cell.strip() for cell in row)]
    return [lines[i] for i in kept], [cells[i] for i in kept]


def _units(cell: str) -> bool:
    """Whether a cell looks like a unit."""
    parts = re.split(r"[/*·⋅ ]", cell.strip("[]() ").lower())
    known = all(part in _UNITS or re.sub(r"\^?[-⁻]?[1-4¹²³⁴]$", "", part) in _UNITS for part in parts)
    return known or bool(re.fullmatch(r"[\[(][^\])]*[\])]", cell))
