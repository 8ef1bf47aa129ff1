r"""What of a long figure is drawn: so many points that a screen shows no others, chosen among those that there are.

A screen has some hundred columns of pixels. Of a line the first, least, greatest and last value of each column are enough to
draw what all would draw (Jugel and others' M4); of points one in every cell of pixels; and points that a person looks for, those outside a
band, are drawn all. Nothing is averaged: what is drawn was computed, at its own place. Where a part of the axis is looked at, that part
is drawn with its own columns.

>>> x = np.arange(100_000.0)
>>> y = np.where(x == 12_345, 30.0, np.sin(x / 1e4))
>>> drawn = level(Drawing("Long", "t, s", (Panel("y", (Curve("y", x, y),)),))).panels[0].curves[0]
>>> len(drawn.x) < 4 * COLUMNS, np.asarray(drawn.y).max()
(True, np.float64(30.0))
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ctlabs.linalg.checks import Array
from ctlabs.reporting.drawing import Band, Curve, Drawing, Panel, array

#: Columns of pixels, and the rows of a panel.
COLUMNS, ROWS = 800, 150
#: Values of a curve above which it is drawn by columns; points above which one in every cell is drawn, and those of which all are wanted.
LONG, MANY, EVERY = 4 * COLUMNS, 8000, 20_000

Places = NDArray[np.intp]


def level(drawing: Drawing, reach: tuple[float, float] | None = None) -> Drawing:
    """The drawing as a screen shows it: as it is where it is short; otherwise by columns, and what is within ``reach`` by its own.

    Source: Jugel, Jerzak, Hackenbroich & Markl, *M4: a visualization-oriented time series data aggregation*, VLDB 7 (2014) 797.
    """
    if longest(drawing) <= LONG:
        return drawing
    return replace(drawing, panels=tuple(_panel(panel, reach) for panel in drawing.panels))


def longest(drawing: Drawing) -> int:
    """How many values the longest of its curves has."""
    xs = [each.x for panel in drawing.panels for each in panel.curves] + [each.x for panel in drawing.panels for each in panel.bands]
    return max((len(array(x)) for x in xs), default=0)


def lines(x: Array, values: Sequence[Array], reach: tuple[float, float] | None = None, columns: int = COLUMNS) -> Places:
    """The places of a line, or of the two edges of a band, that are drawn: in each of the ``columns`` those of the first, the least, the
    greatest and the last of each of the ``values``, and a gap where there is one between two of them.

    ``x`` rises · ``reach`` : only what is within, and its neighbours · at most 12 a column and value
    """
    begin, end = _within(x, reach)
    starts = _columns(x, begin, end, columns)
    found = [np.concatenate([starts, np.append(starts[1:], end) - 1])] if len(starts) else []
    for y in values:
        found += _extremes(y, starts, begin, end)
    chosen = np.unique(np.concatenate(found)) if found else np.zeros(0, np.intp)
    return _gaps(chosen, values, begin, end)


def points(x: Array, y: Array, reach: tuple[float, float] | None = None, most: int = MANY) -> Places:
    """The places of points that are drawn: all where there are at most ``most``; otherwise the extremes of each column, and one point in
    each cell of some pixels, so that each that is not drawn is beside one that is.
    """
    begin, end = _within(x, reach)
    there = begin + np.flatnonzero(np.isfinite(y[begin:end]) & np.isfinite(x[begin:end]))
    if len(there) <= most:
        return there
    px, py = x[there], y[there]
    starts = _columns(px, 0, len(px), COLUMNS)
    ends = np.concatenate(_extremes(py, starts, 0, len(py)))
    columns, rows, at = COLUMNS, ROWS, np.arange(len(there))
    while True:
        at = _one_each(_cells(px, columns)[at] * (rows + 1) + _cells(py, rows)[at], at, (columns + 1) * (rows + 1))
        if len(at) <= most or columns <= 2:
            return there[np.union1d(at, ends)]
        columns, rows = columns // 2, max(rows // 2, 1)


def _panel(panel: Panel, reach: tuple[float, float] | None) -> Panel:
    return replace(
        panel,
        curves=tuple(_curve(curve, reach) for curve in panel.curves),
        bands=tuple(_band(band, reach) for band in panel.bands),
    )


def _curve(curve: Curve, reach: tuple[float, float] | None) -> Curve:
    x, y = array(curve.x), array(curve.y)
    dotted = curve.style not in ("line", "dash", "dashdot", "dot")
    if len(x) <= LONG or curve.style in ("bars", "stems") or not _rises(x):
        return curve
    most = EVERY if curve.every else MANY
    views = [None] if reach is None else [None, reach]
    found = [points(x, y, view, most) if dotted else lines(x, [y], view) for view in views]
    at = found[0] if len(found) == 1 else np.union1d(*found)
    return replace(curve, x=x[at], y=y[at], sd=None if curve.sd is None else array(curve.sd)[at])


def _band(band: Band, reach: tuple[float, float] | None) -> Band:
    x, edges = array(band.x), (array(band.low), array(band.high))
    if len(x) <= LONG or not _rises(x):
        return band
    at = lines(x, edges)
    at = at if reach is None else np.union1d(at, lines(x, edges, reach))
    return replace(band, x=x[at], low=edges[0][at], high=edges[1][at])


def _rises(x: Array) -> bool:
    return bool((x[1:] >= x[:-1]).all())


def _within(x: Array, reach: tuple[float, float] | None) -> tuple[int, int]:
    """From which place to which the reach goes, with a neighbour on either side."""
    if reach is None:
        return 0, len(x)
    begin, end = np.searchsorted(x, reach[0], "left"), np.searchsorted(x, reach[1], "right")
    return max(int(begin) - 1, 0), min(int(end) + 1, len(x))


def _columns(x: Array, begin: int, end: int, count: int) -> Places:
    """Where each column that is not empty begins."""
    if begin >= end:
        return np.zeros(0, np.intp)
    edges = np.linspace(x[begin], x[end - 1], count + 1)[:-1]
    return np.unique(np.minimum(begin + np.searchsorted(x[begin:end], edges, "left"), end - 1))


def _extremes(y: Array, starts: Places, begin: int, end: int) -> list[Places]:
    """The first places of the least and of the greatest value of each column, with their neighbours where there are gaps beside them."""
    if not len(starts):
        return []
    part = y[begin:end]
    finite = np.isfinite(part)
    column = np.repeat(np.arange(len(starts)), np.diff(np.append(starts, end)))
    found = []
    for best, empty in ((np.minimum, np.inf), (np.maximum, -np.inf)):
        values = np.where(finite, part, empty)
        at = np.flatnonzero((values == best.reduceat(values, starts - begin)[column]) & finite)
        first = np.ones(len(at), bool)
        first[1:] = column[at[1:]] > column[at[:-1]]
        found.append(begin + at[first])
    if finite.all():
        return found
    beside = np.concatenate([at + step for at in found for step in (-1, 1)])
    return [*found, beside[(beside >= begin) & (beside < end)]]


def _gaps(chosen: Places, values: Sequence[Array], begin: int, end: int) -> Places:
    """The places chosen, and of what is not there between two of them the first."""
    absent = np.zeros(end - begin, bool)
    for y in values:
        absent |= ~np.isfinite(y[begin:end])
    holes = begin + np.flatnonzero(absent)
    if not len(holes):
        return chosen
    before = np.searchsorted(chosen, holes, "right")  # between which two of the chosen each hole lies
    _, first = np.unique(before, return_index=True)
    return np.union1d(chosen, holes[first])


def _one_each(cells: NDArray[np.int64], at: Places, count: int) -> Places:
    """Of the places ``at``, the first in each of the cells."""
    first = np.full(count, -1, np.intp)
    first[cells[::-1]] = at[::-1]
    return np.sort(first[first >= 0])


def _cells(values: Array, count: int) -> NDArray[np.int64]:
    """In which of so many equal parts each value lies."""
    low, high = float(values.min()), float(values.max())
    return ((values - low) * (count / (high - low) if high > low else 0.0)).astype(np.int64)
