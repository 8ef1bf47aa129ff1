"""Large tables of nothing but plain numbers, by the parser of pandas: the same values as the general way, in a tenth of its time.

Bytes are proved to be a rectangle of well-formed numbers with one decimal mark of one meaning; whatever is not, the general way reads.
"""

from __future__ import annotations

import io
import itertools
import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple, overload

import numpy as np

from ctlabs.files.mapping import Mapping
from ctlabs.files.table import TOP, Layout, rows
from ctlabs.linalg.checks import Array

#: Smaller tables are read the general way, which does not load pandas.
LEAST = 500_000
_NUMBER = b"0123456789+-.,eE"


class Plain(NamedTuple):
    """A table of numbers: ``values`` (rows, columns), the ``line`` of the first row, and its cells as they are written."""

    values: Array
    line: int
    body: bytes
    starts: Array
    ends: Array

    def cells(self, column: int) -> Cells:
        """The cells of a column, written."""
        return Cells(self.body, self.starts[:, column], self.ends[:, column])


class Cells(Sequence[str]):
    """Cells in the bytes of a table, decoded when they are looked at."""

    def __init__(self, body: bytes, starts: Array, ends: Array) -> None:
        self.body, self.starts, self.ends = body, starts, ends

    def __len__(self) -> int:
        return len(self.starts)

    @overload
    def __getitem__(self, at: int) -> str: ...
    @overload
    def __getitem__(self, at: slice) -> list[str]: ...
    def __getitem__(self, at: int | slice) -> str | list[str]:
        if isinstance(at, slice):
            return [self[i] for i in range(*at.indices(len(self)))]
        return self.body[self.starts[at] : self.ends[at]].decode()

    def __iter__(self) -> Iterator[str]:
        for start, end in zip(self.starts.tolist(), self.ends.tolist(), strict=True):
            yield self.body[start:end].decode()


def read(layout: Layout, mapping: Mapping, source: str) -> Plain | None:
    """The table, or None where it is small or not plain."""
    if len(layout.text) < LEAST or layout.mark == " " or layout.width < 2 or mapping.thousands or mapping.blank:
        return None
    line, body = _body(layout, source)
    others = body.translate(None, _NUMBER + layout.mark.encode() + b"\n")
    if others or (body.count(b".") and body.count(b",") and layout.mark != ","):
        return None
    mark = "," if layout.mark != "," and b"," in body else "."
    if mapping.decimal not in ("", mark) and mark.encode() in body:
        return None
    edges = _rectangle(body, layout)
    if edges is None:
        return None
    starts, ends = edges
    if not (_well_formed(body, layout.mark) and _decided(body, mark, starts, ends)):
        return None
    values = _parsed(body, layout, mark)
    if values is None or values.shape != starts.shape or np.isinf(values).any():
        return None
    return Plain(values, line, body, starts, ends)


def _body(layout: Layout, source: str) -> tuple[int, bytes]:
    """The line at which the numbers begin, and all text from there on."""
    top = layout.text[:TOP]
    line = next((at for at, _ in itertools.islice(rows(top, layout.mark, source, layout.skip), layout.start, None)), 1)
    ends = itertools.islice(re.finditer(r"\r\n|\r|\n", top), line - 1)
    start = max((end.end() for end in ends), default=0)
    body = layout.text[start:]
    if "\r" in body:
        body = body.replace("\r\n", "\n")
    return line, body.rstrip("\n").encode("utf-8", "replace") + b"\n"


def _rectangle(body: bytes, layout: Layout) -> tuple[Array, Array] | None:
    """Where each cell begins and ends, (rows, columns); None where a row has another number of cells."""
    data = np.frombuffer(body, np.uint8)
    width = layout.width
    ends = np.flatnonzero((data == ord(layout.mark)) | (data == 10)).astype(np.int32)
    if len(ends) % width or len(ends) // width != body.count(b"\n") or not (data[ends[width - 1 :: width]] == 10).all():
        return None
    starts = np.concatenate([np.zeros(1, np.int32), ends[:-1] + 1])
    return starts.reshape(-1, width), ends.reshape(-1, width)


def _well_formed(body: bytes, mark: str) -> bool:
    """Whether signs and exponents stand where they may, and each mark beside a digit."""
    data = np.frombuffer(body, np.uint8)
    edge = np.zeros(256, bool)
    edge[[10, ord(mark)]] = True
    digit = np.zeros(256, bool)
    digit[48:58] = True
    power = np.zeros(256, bool)
    power[[69, 101]] = True
    point = np.zeros(256, bool)
    point[[c for c in (44, 46) if c != ord(mark)]] = True
    sign = np.zeros(256, bool)
    sign[[43, 45]] = True
    padded = np.concatenate([np.array([10], np.uint8), data, np.array([10], np.uint8)])
    signs, powers, points = (np.flatnonzero(kind[data]) for kind in (sign, power, point))
    before, after = padded[signs], padded[signs + 2]
    if not ((edge | power)[before].all() and ((digit | point)[after]).all() and digit[after[power[before]]].all()):
        return False
    if not ((digit | point)[padded[powers]].all() and (digit | sign)[padded[powers + 2]].all()):
        return False
    return bool((digit[padded[points]] | digit[padded[points + 2]]).all())


def _decided(body: bytes, mark: str, starts: Array, ends: Array) -> bool:
    """Whether each column's marks are decimal marks for certain, one in a cell and before the exponent."""
    data = np.frombuffer(body, np.uint8)
    points = np.flatnonzero(data == ord(mark)).astype(ends.dtype)
    if not len(points):
        return True
    cell = np.searchsorted(ends.ravel(), points).astype(ends.dtype)
    if (np.diff(cell) == 0).any():
        return False
    powers = np.flatnonzero((data == 69) | (data == 101))
    if len(powers):
        at = np.searchsorted(ends.ravel(), powers)
        where = np.searchsorted(cell, at)
        same = where < len(cell)
        same[same] = cell[where[same]] == at[same]
        if (np.diff(at) == 0).any() or (points[where[same]] > powers[same]).any():
            return False
    behind = ends.ravel()[cell] - points - 1
    width = ends.shape[1]
    full = ends > starts
    for column in range(width):
        own = cell % width == column
        if own.any() and (behind[own] == 3).all() and own.sum() < full[:, column].sum():
            return False  # three digits behind every mark, beside numbers without one
    return True


def _parsed(body: bytes, layout: Layout, mark: str) -> Array | None:
    import pandas as pd

    exact = {} if tuple(map(int, pd.__version__.split(".")[:2])) >= (3, 1) else {"float_precision": "round_trip"}
    try:
        frame = pd.read_csv(
            io.BytesIO(body), sep=layout.mark, header=None, names=range(layout.width), index_col=False, dtype=np.float64, decimal=mark,
            keep_default_na=False, na_values=[""], skip_blank_lines=False, quoting=3, engine="c", **exact,
        )  # fmt: skip
    except ValueError:
        return None
    return frame.to_numpy()
