"""A :class:`~ctlabs.reporting.drawing.Drawing` as plotly draws it in a browser: a dict of ``data``, ``layout``, ``config``.

The library plotly is not needed here. There is a light and a dark theme; a click in the legend hides a curve in all panels.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ctlabs.linalg.checks import Array
from ctlabs.reporting.drawing import FALLING, Band, Curve, Drawing, Panel, array

#: Colours on white, darker ones of the same order as on paper (Okabe and Ito's), and lighter ones on dark.
COLOURS = {
    "black": ("#000000", "#F2F2F2"),
    "blue": ("#0072B2", "#56B4E9"),
    "orange": ("#D55E00", "#FF9A57"),
    "green": ("#009E73", "#3DD1A3"),
    "purple": ("#B5528F", "#E8A6CC"),
    "amber": ("#A66F00", "#F2C14E"),
    "sky": ("#3D8FBF", "#A9DAF5"),
    "brown": ("#8C6D1F", "#C9A95A"),
    "grey": ("#70767D", "#A7AEB6"),
}
#: Page, text, lines of the grid, behind what hovers.
BACKGROUND, INK, GRID, HOVER = (
    ("#FFFFFF", "#1D1D1D"),
    ("#20242A", "#E6E8EB"),
    ("#D8D8D8", "#3C4147"),
    ("#FFFFFF", "#2A2E33"),
)
#: Heights in pixels: of a panel, between two, above for the legend, below for the axis.
PANEL, GAP, ABOVE, BELOW = 190, 26, 48, 48
#: A line of a legend in pixels: its width, its height, what stands before a name, a letter; and how many lines are made room for.
LEGEND, LINE, SIGN, LETTER, LINES = 540, 20, 46, 7, 4
#: Pixels of a letter in the label of a vertical axis.
UP = 5.6
#: Instants above which points are not marked on a line, and from which on crosses would hide what is below them: they are dots then.
MARKED, DOTS = 120, 500

Figure = dict[str, Any]


def height(drawing: Drawing) -> int:
    """Its height in pixels; the width is that of its place."""
    rows = len(drawing.panels)
    panel = 340 if drawing.square else PANEL + 60 if rows == 1 else PANEL
    return rows * panel + (rows - 1) * GAP + above(drawing) + BELOW


def above(drawing: Drawing) -> int:
    """Room for the legend, in pixels, so that none of its lines is behind the buttons."""
    parts = (part for panel in drawing.panels for part in (panel.bands, panel.levels, panel.loud))
    names = {each.name for part in parts for each in part} - {""}
    lines = math.ceil(sum(SIGN + LETTER * len(name) for name in names) / LEGEND)
    return ABOVE + LINE * (min(max(lines, 1), LINES) - 1)


def to_plotly(drawing: Drawing, *, dark: bool = False, reach: tuple[float, float] | None = None, fit: bool = True) -> Figure:
    """The figure, for ``ui.plotly``.

    ``reach`` : what of the horizontal axis is shown, where it is not all (or what the drawing says) · ``fit`` : the vertical axes show what
    is within it; otherwise they stay as they are without it
    """
    traces: list[dict[str, Any]] = []
    named: set[str] = set()
    for row, panel in enumerate(drawing.panels, 1):
        own = [trace for band in panel.bands for trace in _band(band, dark)]
        own += [_curve(curve, dark) for curve in (*_levels(drawing, panel), *panel.curves)]
        for trace in own:
            group = trace["legendgroup"]
            trace |= {"xaxis": "x", "yaxis": "y" if row == 1 else f"y{row}"}
            trace["showlegend"] = bool(trace.pop("told", True) and group) and group not in named
            if trace["showlegend"]:
                named.add(group)
        traces += own
    layout = _layout(drawing, dark, len(named))
    if reach is not None:
        layout["xaxis"]["range"] = list(np.log10(reach) if drawing.log else reach)
        if fit:
            layout.pop("annotations", None)  # all that is within is shown
        for row, panel in enumerate(drawing.panels if fit else ()):
            layout["yaxis" if row == 0 else f"yaxis{row + 1}"] |= _within(panel, reach)
    layout["xaxis"]["uirevision"] = f"{drawing.name} {reach}"
    return {"data": traces, "layout": layout, "config": _config(drawing.name)}


def _within(panel: Panel, reach: tuple[float, float]) -> dict[str, Any]:
    """The range of the vertical axis that shows what a panel has within the reach; nothing where there is no such thing."""
    edges = [array(y)[_inside(each.x, reach)] for each in panel.curves if not each.hidden for y in [each.y]]
    edges += [array(y)[_inside(each.x, reach)] for each in panel.bands for y in (each.low, each.high)]
    found = np.concatenate([*edges, np.zeros(0)])
    found = found[np.isfinite(found) & ((found > 0) | (not panel.falls))]
    if not len(found) or found.min() == found.max():
        return {}
    low, high = (np.log10 if panel.falls else np.asarray)([found.min(), found.max()])
    room = 0.05 * (high - low)
    return {"range": [low - room, high + room], "dtick": None}  # as many ticks as fit, on a part of a decade too


def _inside(x: ArrayLike, reach: tuple[float, float]) -> Array:
    return (array(x) >= reach[0]) & (array(x) <= reach[1])


def _levels(drawing: Drawing, panel: Panel) -> list[Curve]:
    """The levels as curves from one side to the other."""
    if not panel.levels:
        return []
    ends = drawing.reach or _span([curve.x for curve in panel.curves])
    return [Curve(each.name, ends, [each.at] * 2, each.colour, each.style, quiet=not each.name) for each in panel.levels]


def _layout(drawing: Drawing, dark: bool, names: int) -> dict[str, Any]:
    ink, grid, rows = INK[dark], GRID[dark], len(drawing.panels)
    inner = height(drawing) - above(drawing) - BELOW
    panel_height = (inner - (rows - 1) * GAP) / rows
    line = {"gridcolor": grid, "linecolor": grid, "zerolinecolor": grid, "zerolinewidth": 1, "automargin": True}
    number = {"exponentformat": "power", "showexponent": "all", "minexponent": 4}  # 8000, not 0.8×10⁴
    layout: dict[str, Any] = {
        "height": height(drawing),
        "margin": {"l": 58, "r": 14, "t": above(drawing), "b": BELOW},
        "paper_bgcolor": BACKGROUND[dark],
        "plot_bgcolor": BACKGROUND[dark],
        "font": {"family": "Roboto, DejaVu Sans, sans-serif", "size": 12, "color": ink},
        "hovermode": "closest" if drawing.reach else "x unified",
        "hoverlabel": {"bgcolor": HOVER[dark], "bordercolor": grid, "font": {"color": ink, "size": 12}, "namelength": -1},
        "showlegend": names > 1,
        "legend": {
            "orientation": "h", "x": 0, "xanchor": "left", "y": 1.0, "yanchor": "bottom",
            "bgcolor": "rgba(0,0,0,0)", "itemsizing": "constant", "tracegroupgap": 0,
        },
        "dragmode": "zoom",
        "uirevision": drawing.name,
        "bargap": 0.35,
        "xaxis": {
            **line, **number, "title": {"text": _safe(drawing.label), "standoff": 8}, "anchor": "y" if rows == 1 else f"y{rows}",
            "ticks": "outside", "tickcolor": grid, "hoverformat": ".9~g", "zeroline": drawing.square, **_headed(drawing.label),
        },
        "shapes": [
            {"type": "line", "yref": "paper", "y0": 0, "y1": 1, "x0": mark.at, "x1": mark.at,
             "line": {"color": COLOURS[mark.colour][dark], "width": mark.width, "dash": _LINES[mark.style]}}
            for mark in drawing.marks
        ],
    }  # fmt: skip
    if drawing.log:
        layout["xaxis"]["type"] = "log"
    if drawing.ticks:
        layout["xaxis"] |= {"tickvals": list(range(len(drawing.ticks))), "ticktext": [_safe(each) for each in drawing.ticks]}
    if drawing.reach:  # given, for plotly takes long to find ranges that fit one scale
        layout["xaxis"] |= {"range": list(drawing.reach), "automargin": False}
    for row, panel in enumerate(drawing.panels):
        top = 1 - row * (panel_height + GAP) / inner
        layout["yaxis" if row == 0 else f"yaxis{row + 1}"] = {
            **line, **number, "domain": [max(top - panel_height / inner, 0.0), min(top, 1.0)], "anchor": "x",
            "title": {"text": _safe(_short(panel.label, round(panel_height / UP))), "standoff": 6}, "hoverformat": ".5~g",
            **_vertical(panel), **({"scaleanchor": "x", "scaleratio": 1} if drawing.square else {}),
        }  # fmt: skip
    if any(_beyond(panel) for panel in drawing.panels):
        layout["annotations"] = [{
            "text": "some values are beyond the axes: a double click shows them", "showarrow": False, "xref": "paper", "yref": "paper",
            "x": 1, "y": 1, "xanchor": "right", "yanchor": "top", "font": {"size": 11, "color": ink}, "bgcolor": BACKGROUND[dark],
        }]  # fmt: skip
    return layout


def _headed(label: str) -> dict[str, Any]:
    """Above the values at a place: what is on the horizontal axis, the place, and its unit."""
    what, _, unit = label.partition(", ")
    return {"unifiedhovertitle": {"text": f"{_safe(what)} = %{{x}} {_safe(unit)}".strip()}} if what else {}


def _vertical(panel: Panel) -> dict[str, Any]:
    """What is special about the vertical axis."""
    values = _values(panel)
    if panel.reach is not None:
        return {"range": list(np.log10(panel.reach) if panel.falls else panel.reach), "automargin": False}
    if panel.label.endswith((", °", ", degrees")):
        span = float(np.ptp(values)) if len(values) else 0.0
        return {"dtick": 45 if span <= 180 else 90}
    if panel.falls:
        few = len(values) and values.max() < 1e3 * values.min()  # ticks at 1, 2, 5: all nine do not fit into a panel
        return {"type": "log", "dtick": "D2"} if few else {"type": "log"}
    if panel.kind in ("size", "count"):
        return {"rangemode": "tozero"}
    reach = _beyond(panel)
    return {"range": [-reach, reach]} if reach else {}


def _beyond(panel: Panel) -> float:
    """How far a signed panel reaches at first, where a few values, or the beginning of a band, are far beyond the rest; otherwise 0."""
    values = _values(panel)
    if panel.kind != "signed" or not len(values):
        return 0.0
    edges = np.abs(np.concatenate([values, *(array(band.high) for band in panel.bands)]))
    edges = edges[np.isfinite(edges)]
    reach = 1.3 * float(np.quantile(edges, 0.95))
    return reach if 0 < FALLING / 5 * reach < edges.max() else 0.0


def _values(panel: Panel) -> Array:
    """All finite values that are shown."""
    found = np.concatenate([*(array(curve.y).ravel() for curve in panel.curves if not curve.hidden), np.zeros(0)])
    return found[np.isfinite(found)]


def _span(values: Sequence[ArrayLike]) -> tuple[float, float]:
    """From the least to the greatest value."""
    found = np.concatenate([array(each).ravel() for each in values])
    return float(found.min()), float(found.max())


_MARKERS = {
    "points": "circle",
    "cross": "x-thin-open",
    "square": "square",
    "open": "circle-open",
    "triangle": "triangle-up",
    "plus": "cross-thin-open",
}
_LINES = {"line": "solid", "dash": "dash", "dashdot": "dashdot", "dot": "dot"}


def _curve(curve: Curve, dark: bool) -> dict[str, Any]:
    colour, name, x, y = COLOURS[curve.colour][dark], _safe(curve.name), array(curve.x), array(curve.y)
    trace: dict[str, Any] = {"name": name, "legendgroup": name, "x": _typed(x), "y": _typed(y), "told": not curve.quiet}
    if curve.hidden:
        trace["visible"] = "legendonly"
    if curve.style in ("bars", "stems"):
        trace |= {"type": "bar", "marker": {"color": colour}}
    elif curve.style in _MARKERS:
        dots = len(x) > DOTS and not curve.every
        size = 7 if len(x) <= MARKED else 3 if dots else 4
        big = curve.style in {"cross", "open"}
        size = size + 3 if big and len(x) <= 40 else size
        marker = {"symbol": "circle" if dots else _MARKERS[curve.style], "color": colour, "size": size}
        marker["line"] = {"width": 0 if dots else 2 if big and len(x) <= 40 else 1.2, "color": colour}
        trace |= {"type": "scatter", "mode": "markers", "marker": marker}
    else:
        thin = curve.quiet or len(x) > 600
        line = {"color": colour, "width": 1.0 if thin else 1.8, "dash": _LINES[curve.style]}
        trace |= {"type": "scatter", "mode": "lines", "line": line}
    if curve.quiet:
        trace["hoverinfo"] = "skip"
    else:
        unit = f" {_safe(curve.unit)}" if curve.unit and curve.unit != "1" else ""
        more = ""
        if curve.sd is not None:
            trace["customdata"], more = _typed(array(curve.sd)), " ± %{customdata:.3~g}"
        place = "%{x:.5~g}, " if curve.style in {"cross", "open"} and len(x) <= 40 else ""
        trace["hovertemplate"] = f"{name}: {place}%{{y:.5~g}}{more}{unit}<extra></extra>"
    return trace


def _band(band: Band, dark: bool) -> list[dict[str, Any]]:
    """A filled band as one closed line for every stretch without a gap, or two lines."""
    colour, name = COLOURS[band.colour][dark], _safe(band.name)
    x, low, high = array(band.x), array(band.low), array(band.high)
    common = {"type": "scatter", "mode": "lines", "name": name, "legendgroup": name, "hoverinfo": "skip"}
    if band.frame:
        line = {"color": colour, "width": 1.2, "dash": "dash"}
        return [
            {**common, "x": _typed(x), "y": _typed(edge), "line": line, "told": i == 0}
            for i, edge in enumerate((high, low))
        ]
    px, py = _outline(x, low, high)
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    fill = f"rgba({red},{green},{blue},{0.28 if dark else 0.18})"
    return [
        {
            **common,
            "x": _typed(px),
            "y": _typed(py),
            "fill": "toself",
            "fillcolor": fill,
            "line": {"width": 0, "color": colour},
        }
    ]


def _outline(x: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Around a band, stretch by stretch; an instant alone between two gaps is a thin box."""
    there = np.isfinite(low) & np.isfinite(high)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], there.astype(np.int8), [0]])))
    px: list[Array] = []
    py: list[Array] = []
    width = 0.3 * float(np.diff(x).min()) if len(x) > 1 else 0.5
    gap = np.array([np.nan])
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        xs, ls, hs = x[begin:end], low[begin:end], high[begin:end]
        if len(xs) == 1:
            xs, ls, hs = np.array([xs[0] - width, xs[0] + width]), np.repeat(ls, 2), np.repeat(hs, 2)
        px += [xs, xs[::-1], xs[:1], gap]
        py += [hs, ls[::-1], hs[:1], gap]
    if not px:
        return np.zeros(0), np.zeros(0)
    return np.concatenate(px[:-1]), np.concatenate(py[:-1])


def _typed(values: Array) -> dict[str, str]:
    """An array as plotly reads it quickest: bytes. Seven digits are more than a screen shows, where they hold the values, and the steps
    between them, at which one may look closely.
    """
    single = values.astype(np.float32)
    finite = np.isfinite(values)
    exact = values[finite]
    close = bool(_close(single[finite], exact)) if finite.any() else True
    kind, kept = ("f4", single) if close else ("f8", values)
    return {"dtype": kind, "bdata": base64.b64encode(np.ascontiguousarray(kept, dtype=f"<{kind}").tobytes()).decode()}


def _close(single: NDArray[np.float32], exact: Array) -> bool:
    error, steps = np.abs(single - exact), np.abs(np.diff(exact))
    steps = steps[steps > 0]
    return bool(np.all(error <= 1e-6 * np.ptp(exact)) and (not len(steps) or error.max() <= 0.01 * np.median(steps)))


def untyped(values: dict[str, str]) -> Array:
    """The array of what :func:`_typed` made."""
    return np.frombuffer(base64.b64decode(values["bdata"]), dtype=f"<{values['dtype']}").astype(np.float64)


def _config(name: str) -> dict[str, Any]:
    """No logo, no service of anybody's; a picture is made in the browser."""
    word = "".join(c if c.isalnum() else "_" for c in name.lower()).strip("_")
    return {
        "displaylogo": False,
        "responsive": True,
        "showSendToCloud": False,
        "plotlyServerURL": "",
        "showLink": False,
        "modeBarButtonsToRemove": ["select2d", "lasso2d", "autoScale2d", "sendDataToCloud"],
        "toImageButtonOptions": {"format": "png", "scale": 2, "filename": word},
    }


def _short(text: str, most: int) -> str:
    """A label that fits beside its panel; the unit stays."""
    if len(text) <= most:
        return text
    name, comma, unit = text.rpartition(", ")
    return f"{text[: most - 1]}…" if not comma else f"{name[: max(most - len(unit) - 3, 8)]}…, {unit}"


def _safe(text: str) -> str:
    """A user's name: plotly reads <…> as markup and %{…} as a value's place."""
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;").replace("%{", "% {")
