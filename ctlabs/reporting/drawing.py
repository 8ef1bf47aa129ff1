r"""What a figure shows, apart from how it is drawn: panels over one axis, each with curves, bands and marks.

A :class:`Drawing` is described once. :func:`ctlabs.reporting.paper.to_matplotlib` draws it for reports,
:func:`ctlabs.reporting.screen.to_plotly` for pages, and :meth:`Drawing.text` gives its numbers to be copied.

>>> drawing = Drawing("Squares", "t, s", (Panel("x, m", (Curve("x", [0, 1, 2], [0, 1, 4], unit="m"),)),))
>>> drawing.text().split("\n")
['t, s\tx, m', '0\t0', '1\t1', '2\t4']
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.linalg.checks import Array

#: The order in which the curves of a family are coloured.
CYCLE = ("blue", "orange", "green", "purple", "amber", "sky", "black", "brown")
#: A size that is so many times larger than most of its values is drawn over a logarithmic axis.
FALLING = 25.0


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """One curve.

    ``style`` : a line ("line", "dash", "dashdot", "dot"), points ("points", "cross", "plus", "square", "triangle", "open"), "bars", or
    "stems" (bars with a point at their end) · ``sd``, shown as ± beside the value · ``hidden``, until its name in the legend is
    clicked · ``quiet``, without name and values · ``width`` of its line and ``size`` of its points on paper (0: the usual ones) ·
    ``every``: all its points are drawn, however many there are
    """

    name: str
    x: ArrayLike
    y: ArrayLike
    colour: str = "blue"
    style: str = "line"
    unit: str = ""
    sd: ArrayLike | None = None
    hidden: bool = False
    quiet: bool = False
    width: float = 0.0
    size: float = 0.0
    every: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """What lies between two curves. ``frame``: its edges as lines, without a filling."""

    name: str
    x: ArrayLike
    low: ArrayLike
    high: ArrayLike
    colour: str = "blue"
    unit: str = ""
    frame: bool = False


@dataclass(frozen=True, slots=True)
class Mark:
    """A straight line across a panel: at a place of the horizontal axis, or at a level of the vertical one. ``name`` : "", if none."""

    name: str
    at: float
    colour: str = "grey"
    style: str = "dash"
    width: float = 1.2


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """Curves over bands; ``label`` of the vertical axis with its unit.

    ``kind`` : "size" (from 0 on, or logarithmic where it falls far), "count" (from 0 on), "log" (logarithmic), "signed" (around 0; a
    few values that are much larger than the others are beyond it at first) or "" (as the curves are) · ``levels``, marked ·
    ``reach`` : the least and the greatest value that are shown, where not all are
    """

    label: str
    curves: tuple[Curve, ...] = ()
    bands: tuple[Band, ...] = ()
    kind: str = ""
    levels: tuple[Mark, ...] = ()
    reach: tuple[float, float] | None = None

    @property
    def loud(self) -> tuple[Curve, ...]:
        """The curves that have a name and values."""
        return tuple(curve for curve in self.curves if not curve.quiet)

    @property
    def falls(self) -> bool:
        """Whether its vertical axis is logarithmic: it is to be, or most of its values are far below the largest."""
        if self.kind != "size":
            return self.kind == "log"
        values = [array(curve.y).ravel() for curve in self.curves if not curve.hidden]
        known = np.concatenate([*values, np.zeros(0)])
        known = known[np.isfinite(known)]
        return bool(len(known) and known.min() > 0 and known.max() > FALLING * np.median(known))


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """Panels, one below the other, over one horizontal axis with its ``label``.

    ``square``: both axes in one scale · ``log``: the horizontal one is logarithmic · ``whole``: it counts · ``ticks`` : names of its
    places 0, 1, … · ``marks`` : places on it, marked in all panels · ``reach`` : what of it is shown · ``verbatim`` : a dollar sign in its
    words begins no formula (they are a user's) · ``height`` on paper, inches
    """

    name: str
    label: str
    panels: tuple[Panel, ...]
    square: bool = False
    log: bool = False
    whole: bool = False
    ticks: tuple[str, ...] = ()
    marks: tuple[Mark, ...] = ()
    reach: tuple[float, float] | None = None
    verbatim: bool = False
    height: float = 0.0

    @property
    def scalable(self) -> bool:
        """Whether a panel can be drawn over a logarithmic vertical axis: it has positive values, and no negative ones."""
        return not self.square and any(_positive(panel) for panel in self.panels)

    @property
    def falls(self) -> bool:
        """Whether the panels that can be have a logarithmic axis."""
        return any(panel.falls for panel in self.panels if _positive(panel))

    def scaled(self, log: bool) -> Drawing:  # what it is about
        """With a logarithmic vertical axis where there can be one, or without any.

        >>> drawing = Drawing("Sizes", "t, s", (Panel("x", (Curve("x", [0, 1], [1, 2]),), kind="size"),))
        >>> drawing.falls, drawing.scaled(True).falls, drawing.scaled(True).scaled(False).falls
        (False, True, False)
        """
        kind = "log" if log else "count"
        return replace(self, panels=tuple(replace(panel, kind=kind, reach=None) if _positive(panel) else panel for panel in self.panels))

    def columns(self) -> dict[str, Array]:
        """Its numbers: what is on the horizontal axis (if all curves share it; one column for each curve otherwise), and every curve."""
        curves = [(panel, curve) for panel in self.panels for curve in panel.loud]
        several = len(self.panels) > 1
        found: dict[str, Array] = {}
        shared = curves and all(_equal(curve.x, curves[0][1].x) for _, curve in curves)
        if shared:
            found[self.label] = array(curves[0][1].x)
        for panel, curve in curves:
            what, _, unit = panel.label.partition(", ")
            name = f"{what}: {curve.name}" if several or curve.name != what else curve.name
            name = _free(labelled(name, curve.unit or unit), found)
            if not shared:
                found[_free(f"{name}: {self.label}", found)] = array(curve.x)
            found[name] = array(curve.y)
        return found

    def text(self) -> str:
        """Its numbers with tabs between them, a line for each instant: to be pasted into a spreadsheet."""
        columns = self.columns()
        length = max((len(column) for column in columns.values()), default=0)
        rows = ([plain(column[i]) if i < len(column) else "" for column in columns.values()] for i in range(length))
        return "\n".join("\t".join(row) for row in [list(columns), *rows])


def line_styles(count: int, start: int = 0) -> list[tuple[str, str]]:
    """Colours and dashes for a family: no two alike among the first 24."""
    styles = ("line", "dash", "dot")
    return [(CYCLE[(start + i) % len(CYCLE)], styles[(start + i) // len(CYCLE) % 3]) for i in range(count)]


def inside_outside(
    name: str, t: ArrayLike, values: ArrayLike, low: ArrayLike, high: ArrayLike, unit: str = "", style: str = "points"
) -> tuple[Curve, ...]:
    """Points inside a band, and those outside in another colour and shape."""
    values = array(values)
    with np.errstate(invalid="ignore"):
        outside = (values < low) | (values > high)
    curves = [Curve(name, t, np.where(outside, np.nan, values), "blue", style, unit)]
    if outside.any():
        curves.append(Curve("outside the band", t, np.where(outside, values, np.nan), "orange", "square", unit, every=True))
    return tuple(curves)


def boxes(name: str, t: ArrayLike, low: ArrayLike, high: ArrayLike, unit: str = "") -> Band:
    """A band with a box for each instant, so that one between two gaps is seen too."""
    t = array(t)
    edges = np.concatenate([t[:1], 0.5 * (t[1:] + t[:-1]), t[-1:]])
    return Band(name, np.column_stack([edges[:-1], edges[1:]]).ravel(), np.repeat(array(low), 2), np.repeat(array(high), 2), unit=unit)


def labelled(name: str, unit: str) -> str:
    """A name with its unit, for an axis.

    >>> labelled("position", "m"), labelled("share", "")
    ('position, m', 'share')
    """
    return f"{name}, {unit}" if unit else name


def array(values: ArrayLike) -> Array:
    """Doubles."""
    return np.asarray(values, dtype=np.float64)


def finite(values: ArrayLike) -> Array:
    """Infinite values (nothing is known, no finite gain) leave a gap."""
    found = array(values)
    return np.where(np.isfinite(found), found, np.nan)


def plain(value: float) -> str:
    """A number as a spreadsheet reads it, with all its digits; nothing where there is none.

    >>> plain(0.1), plain(3.0), plain(float("nan"))
    ('0.1', '3', '')
    """
    if math.isnan(value):
        return ""
    value = float(value)
    return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)


def _positive(panel: Panel) -> bool:
    """Whether it has positive values, and no negative ones, in all that is shown."""
    values = [array(curve.y).ravel() for curve in panel.curves if not curve.hidden and not curve.quiet]
    known = finite(np.concatenate([*values, np.zeros(0)]))
    return panel.kind != "signed" and bool(np.nanmin(known, initial=0.0) >= 0 < np.nanmax(known, initial=0.0))


def _equal(a: ArrayLike, b: ArrayLike) -> bool:
    return a is b or np.array_equal(array(a), array(b))


def _free(name: str, taken: Iterable[str]) -> str:
    """A heading that no column has yet."""
    found, count = name, 2
    while found in taken:
        found, count = f"{name} ({count})", count + 1
    return found
