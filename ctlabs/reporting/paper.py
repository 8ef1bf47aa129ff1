"""A :class:`~ctlabs.reporting.drawing.Drawing` as a matplotlib figure, for reports."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ctlabs.reporting.drawing import Band, Curve, Drawing, Panel, array
from ctlabs.reporting.plots.base import legend, logarithmic, panels, styled, whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: The colours on paper: Okabe and Ito's, as in plots/style.mplstyle.
COLOURS = {
    "black": "#000000", "blue": "#0072B2", "orange": "#D55E00", "green": "#009E73", "purple": "#CC79A7", "amber": "#E69F00",
    "sky": "#56B4E9", "brown": "#8C6D1F", "grey": "#8A8F96",
}  # fmt: skip
LINES = {"line": "-", "dash": "--", "dashdot": "-.", "dot": ":"}
MARKERS = {"points": "o", "cross": "x", "plus": "+", "square": "s", "triangle": "^", "open": "o", "stems": "o"}
#: More points than this in a curve are not seen: it is thinned to them; points of a longer curve are small.
DRAWN, MANY = 4000, 200


@styled
def to_matplotlib(drawing: Drawing) -> Figure:
    """The figure, as wide as the page; every name stands once in its legend, above the panels."""
    rows, named = len(drawing.panels), {""}

    def name(text: str) -> str | None:
        new = text not in named
        named.add(text)
        return _words(drawing, text) if new else None

    figure, grid = panels(rows, 1, sharex=True, height=drawing.height or (4.2 if rows == 1 else 1.2 + 2.2 * rows))
    for axes, panel in zip(grid[:, 0], drawing.panels, strict=True):
        for curve in panel.curves:
            _curve(axes, curve, name)
        for band in panel.bands:
            _band(axes, band, name)
        for level in panel.levels:
            axes.axhline(level.at, color=COLOURS[level.colour], linestyle=LINES[level.style], linewidth=level.width, label=name(level.name))
        for mark in drawing.marks:
            axes.axvline(mark.at, color=COLOURS[mark.colour], linestyle=LINES[mark.style], linewidth=mark.width, label=name(mark.name))
        _axes(axes, drawing, panel)
    grid[-1, 0].set_xlabel(_words(drawing, drawing.label))
    legend(figure, *grid[:, 0])
    return figure


def _words(drawing: Drawing, text: str) -> str:
    return text.replace("$", r"\$") if drawing.verbatim else text


def _axes(axes: Axes, drawing: Drawing, panel: Panel) -> None:
    """Scales, limits and labels."""
    axes.set_ylabel(_words(drawing, panel.label))
    if drawing.square:
        axes.set_aspect("equal")
    if drawing.log:
        logarithmic(axes, "x")
    if drawing.ticks:
        axes.set_xticks(range(len(drawing.ticks)), drawing.ticks, rotation=30, ha="right", rotation_mode="anchor")
    if drawing.reach is not None:
        axes.set_xlim(*drawing.reach)
    if drawing.whole:
        whole(axes)
    if panel.falls:
        logarithmic(axes, "y")
    elif panel.kind in ("size", "count"):
        axes.set_ylim(bottom=0)
    if panel.reach is not None:
        axes.set_ylim(*panel.reach)


def _curve(axes: Axes, curve: Curve, name: Callable[[str], str | None]) -> None:
    if curve.hidden:
        return
    x, y, colour = array(curve.x), array(curve.y), COLOURS[curve.colour]
    thin = slice(None, None, -(-len(x) // DRAWN))
    style: dict[str, Any] = {"color": colour, "label": None if curve.quiet else name(curve.name)}
    if curve.style == "bars":
        axes.bar(x, y, **style)
        return
    if curve.style == "stems":
        axes.vlines(x, 0.0, y, color=colour, linewidth=1.6)
    if curve.style in LINES:
        style |= {"linestyle": LINES[curve.style]} | ({"linewidth": curve.width} if curve.width else {})
    else:
        style |= {"linestyle": "none", "marker": MARKERS[curve.style], "markersize": curve.size or (4.0 if len(x) <= MANY else 2.0)}
        style |= ({"markerfacecolor": "none"} if curve.style == "open" else {}) | ({"markeredgewidth": curve.width} if curve.width else {})
    axes.plot(x[thin], y[thin], **style)


def _band(axes: Axes, band: Band, name: Callable[[str], str | None]) -> None:
    colour, label = COLOURS[band.colour], name(band.name)
    x, low, high = array(band.x), array(band.low), array(band.high)
    if band.frame:
        for edge, word in ((high, label), (low, None)):
            axes.plot(x, edge, color=colour, linestyle="--", linewidth=1.2, label=word)
        return
    thin = slice(None, None, -(-len(x) // DRAWN))
    axes.fill_between(x[thin], low[thin], high[thin], color=colour, alpha=0.12 if band.colour == "grey" else 0.18, linewidth=0, label=label)
