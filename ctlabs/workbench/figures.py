r"""Interactive figures: the same arrays as the reports', as plotly draws them in the browser.

A :class:`Drawing` says what is drawn, in no colours: panels over one axis, each with curves and bands. From it come the figure in a
light and in a dark theme (:meth:`Drawing.plotly`: a dict of ``data``, ``layout``, ``config``; the library plotly is not needed
here) and its numbers as text to copy (:meth:`Drawing.text`). A click in the legend hides a curve in all panels.

>>> drawing = Drawing("Squares", "t, s", (Panel("x, m", (Curve("x", [0, 1, 2], [0, 1, 4], unit="m"),)),))
>>> drawing.text().split("\n")
['t, s\tx, m', '0\t0', '1\t1', '2\t4']
"""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.linalg.checks import Array
from ctlabs.text import number

if TYPE_CHECKING:
    from ctlabs.workbench.outcomes import Outcome
    from ctlabs.workbench.understanding import Bode, Poles, Transient, Understanding

#: Colours by their part: Okabe and Ito's on white, as in plots/style.mplstyle, and lighter ones in the same order on dark.
COLOURS = {
    "black": ("#000000", "#F2F2F2"),
    "blue": ("#0072B2", "#56B4E9"),
    "orange": ("#D55E00", "#FF9A57"),
    "green": ("#009E73", "#3DD1A3"),
    "purple": ("#B5528F", "#E8A6CC"),
    "amber": ("#A66F00", "#F2C14E"),
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
#: The order in which the curves of a family are coloured.
CYCLE = ("blue", "orange", "green", "purple", "amber", "black", "brown", "grey")
#: Heights in pixels: of a panel, between two, above for the legend, below for the axis.
PANEL, GAP, ABOVE, BELOW = 190, 26, 48, 48
#: A line of a legend in pixels: its width, its height, what stands before a name, a letter; and how many lines are made room for.
LEGEND, LINE, SIGN, LETTER, LINES = 540, 20, 46, 7, 4
#: Instants above which points are not marked on a line.
MARKED = 120

#: A size that is so many times larger than most of its values is drawn over a logarithmic axis.
FALLING = 25.0

Figure = dict[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """One curve.

    ``style`` : "line", "dash", "dot", "points", "cross", "square", "triangle", "open", "bars" · ``sd``, shown as ± beside the value ·
    ``hidden``, until its name in the legend is clicked · ``quiet``, without name and values (further runs)
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


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """Curves over bands; ``label`` of the vertical axis with its unit.

    ``kind`` : "size" (from 0 on, or logarithmic where it falls far), "count" (from 0 on), "signed" (around 0; a few values that
    are much larger than the others are beyond it at first) or "" (as the curves are)
    """

    label: str
    curves: tuple[Curve, ...] = ()
    bands: tuple[Band, ...] = ()
    kind: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """Panels, one below the other, over one horizontal axis. ``square``: both axes in one scale · ``log``: the horizontal one is."""

    name: str
    label: str
    panels: tuple[Panel, ...]
    square: bool = False
    log: bool = False

    @property
    def height(self) -> int:
        """Its height in pixels; the width is that of its place."""
        rows = len(self.panels)
        panel = 340 if self.square else PANEL + 60 if rows == 1 else PANEL
        return rows * panel + (rows - 1) * GAP + self.above + BELOW

    @property
    def above(self) -> int:
        """Room for the legend, in pixels, so that none of its lines is behind the buttons."""
        names = {each.name for panel in self.panels for each in panel.bands}
        names |= {each.name for panel in self.panels for each in panel.curves if not each.quiet}
        lines = math.ceil(sum(SIGN + LETTER * len(name) for name in names) / LEGEND)
        return ABOVE + LINE * (min(max(lines, 1), LINES) - 1)

    def plotly(self, *, dark: bool = False) -> Figure:
        """The figure, for ``ui.plotly``."""
        traces: list[dict[str, Any]] = []
        named: set[str] = set()
        for row, panel in enumerate(self.panels, 1):
            axis = "y" if row == 1 else f"y{row}"
            own = [trace for band in panel.bands for trace in _band(band, dark)]
            own += [_curve(curve, dark) for curve in panel.curves]
            for trace in own:
                group = trace.get("legendgroup", "")
                trace |= {"xaxis": "x", "yaxis": axis}
                trace["showlegend"] = bool(trace.pop("told", True)) and group not in named
                if trace["showlegend"]:
                    named.add(group)
            traces += own
        return {"data": traces, "layout": self._layout(dark, len(named)), "config": _config(self.name)}

    def columns(self) -> dict[str, Array]:
        """Its numbers: what is on the horizontal axis (if all curves share it; one column for each curve otherwise), and every curve."""
        curves = [(panel, curve) for panel in self.panels for curve in _told(panel)]
        several = len(self.panels) > 1
        found: dict[str, Array] = {}
        shared = curves and all(_equal(curve.x, curves[0][1].x) for _, curve in curves)
        if shared:
            found[self.label] = _array(curves[0][1].x)
        for panel, curve in curves:
            what, _, unit = panel.label.partition(", ")
            name = f"{what}: {curve.name}" if several or curve.name != what else curve.name
            unit = curve.unit or unit
            name = _free(f"{name}, {unit}" if unit else name, found)
            if not shared:
                found[_free(f"{name}: {self.label}", found)] = _array(curve.x)
            found[name] = _array(curve.y)
        return found

    def text(self) -> str:
        """Its numbers with tabs between them, a line for each instant: to be pasted into a spreadsheet."""
        columns = self.columns()
        lines = ["\t".join(columns)]
        length = max((len(column) for column in columns.values()), default=0)
        lines += [
            "\t".join(plain(column[i]) if i < len(column) else "" for column in columns.values()) for i in range(length)
        ]
        return "\n".join(lines)

    def _layout(self, dark: bool, names: int) -> dict[str, Any]:
        ink, grid, rows = INK[dark], GRID[dark], len(self.panels)
        inner = self.height - self.above - BELOW
        height = (inner - (rows - 1) * GAP) / rows
        line = {"gridcolor": grid, "linecolor": grid, "zerolinecolor": grid, "zerolinewidth": 1, "automargin": True}
        number_ = {"exponentformat": "power", "showexponent": "all"}
        layout: dict[str, Any] = {
            "height": self.height,
            "margin": {"l": 58, "r": 14, "t": self.above, "b": BELOW},
            "paper_bgcolor": BACKGROUND[dark],
            "plot_bgcolor": BACKGROUND[dark],
            "font": {"family": "Roboto, DejaVu Sans, sans-serif", "size": 12, "color": ink},
            "hovermode": "closest" if self.square else "x unified",
            "hoverlabel": {"bgcolor": HOVER[dark], "bordercolor": grid, "font": {"color": ink, "size": 12}, "namelength": -1},
            "showlegend": names > 1,
            "legend": {
                "orientation": "h", "x": 0, "xanchor": "left", "y": 1.0, "yanchor": "bottom",
                "bgcolor": "rgba(0,0,0,0)", "itemsizing": "constant", "tracegroupgap": 0,
            },
            "dragmode": "zoom",
            "uirevision": self.name,
            "bargap": 0.35,
            "xaxis": {
                **line, **number_, "title": {"text": _safe(self.label), "standoff": 8}, "anchor": "y" if rows == 1 else f"y{rows}",
                "ticks": "outside", "tickcolor": grid, "hoverformat": ".6~g", "zeroline": self.square,
            },
        }  # fmt: skip
        if self.log:
            layout["xaxis"]["type"] = "log"
        if self.square:  # given, for plotly takes long to find ranges that fit one scale
            layout["xaxis"] |= {"range": _reach([curve.x for curve in self.panels[0].curves]), "automargin": False}
        for row, panel in enumerate(self.panels):
            top = 1 - row * (height + GAP) / inner
            layout["yaxis" if row == 0 else f"yaxis{row + 1}"] = {
                **line, **number_, "domain": [max(top - height / inner, 0.0), min(top, 1.0)], "anchor": "x",
                "title": {"text": _safe(_short(panel.label)), "standoff": 6}, "hoverformat": ".5~g",
                **_vertical(panel),
                **(_square(panel) if self.square else {}),
            }  # fmt: skip
        if any(_vertical(panel).get("range") for panel in self.panels):
            layout["annotations"] = [{
                "text": "some values are beyond the axes: a double click shows them", "showarrow": False, "xref": "paper", "yref": "paper",
                "x": 1, "y": 1, "xanchor": "right", "yanchor": "top", "font": {"size": 11, "color": ink}, "bgcolor": BACKGROUND[dark],
            }]  # fmt: skip
        return layout


# What is drawn -------------------------------------------------------------------------------------------------------


def estimates(found: Outcome, states: Sequence[int], run: int = 0) -> Drawing:
    """Truth, measurement and estimate of a run with its ±σ; of data also the smoothed estimate; other algorithms on request."""
    panels = []
    for i in states:
        unit, x, sd = found.units[i], found.x_plus[:, i, run], _finite(found.sd_plus[:, i])
        bands = [Band("estimate ± σ", found.t, x - sd, x + sd, unit=unit)]
        curves = []
        if found.smoothed is not None and found.smoothed_sd is not None:
            y, s = found.smoothed[:, i], _finite(found.smoothed_sd[:, i])
            bands.append(Band("smoothed ± σ", found.t, y - s, y + s, "green", unit))
            curves.append(Curve("smoothed", found.t, y, "green", "dash", unit, s))
        j = found.measured[i]
        if j >= 0 and found.units[i] == found.measurement_units[j]:
            curves.append(Curve("measurement", found.t, found.z[:, j, run], "orange", "cross", unit))
        if found.truth is not None:
            curves.append(Curve("truth", found.t, found.truth[:, i, run], "black", unit=unit))
        curves.append(Curve("estimate", found.t, x, unit=unit, sd=sd))
        others = [name for name in list(found.estimates)[1:] if run == 0]
        for name, (colour, style) in zip(others, line_styles(len(others), 3), strict=True):
            curves.append(Curve(f"by {name}", found.t, found.estimates[name][:, i], colour, style, unit, hidden=True))
        panels.append(Panel(_with_unit(found.states[i], unit), tuple(curves), tuple(bands)))
    name = "Measurement and estimate" if found.truth is None else "Truth, measurement, estimate"
    return Drawing(name, "t, s", tuple(panels))


def errors(found: Outcome, states: Sequence[int]) -> Drawing:
    """Errors of the shown runs inside the bands of σ and 2σ that the filter claims."""
    assert found.errors is not None
    panels = []
    for i in states:
        unit, sd = found.units[i], _finite(found.sd_plus[:, i])
        bands = (
            Band("±2σ", found.t, -2 * sd, 2 * sd, "orange", unit, frame=True),
            Band("±σ", found.t, -sd, sd, "orange", unit),
        )
        runs = found.errors.shape[2]
        curves = [
            Curve(f"run {r + 1}", found.t, found.errors[:, i, r], ("black", "blue", "green")[r % 3], "line", unit, sd if r == 0 else None)
            for r in reversed(range(runs))
        ]  # fmt: skip
        panels.append(Panel(f"error of {_with_unit(found.states[i], unit)}", tuple(curves), bands, "signed"))
    return Drawing("Errors of single runs", "t, s", tuple(panels))


def accuracy(found: Outcome, states: Sequence[int]) -> Drawing:
    """RMS error over all runs against what theory and the filter say."""
    stats = found.statistics
    assert stats is not None
    actual, panels = found.actual_rms, []
    for i in states:
        unit = found.units[i]
        curves = [
            Curve(
                f"RMS of {stats.runs} runs",
                found.t,
                stats.rms[:, i],
                "black",
                "points" if len(found.t) <= MARKED else "line",
                unit,
            )
        ]
        if actual is None:
            curves.append(Curve("theory σ", found.t, _finite(found.sd_plus[:, i]), "blue", "line", unit))
        else:
            curves.append(Curve("theory of this filter", found.t, actual[:, i], "blue", "line", unit))
            curves.append(
                Curve("what the filter claims", found.t, _finite(found.sd_plus[:, i]), "orange", "dash", unit)
            )
        if found.optimal_sd is not None:
            curves.append(Curve("the right filter", found.t, found.optimal_sd[:, i], "green", "dot", unit))
        band = Band("95 % of such ensembles", found.t, stats.rms_band[0][:, i], stats.rms_band[1][:, i], "blue", unit)
        panels.append(Panel(_with_unit(found.states[i], unit), tuple(curves), (band,), kind="size"))
    return Drawing("RMS error against theory", "t, s", tuple(panels))


def bias(found: Outcome, states: Sequence[int]) -> Drawing:
    """Mean error over all runs, in the band of chance."""
    stats = found.statistics
    assert stats is not None
    panels = []
    for i in states:
        unit = found.units[i]
        curves = [Curve(f"mean of {stats.runs} runs", found.t, stats.bias[:, i], "black", "line", unit)]
        if found.actual_bias is not None:
            curves.append(Curve("theory of this filter", found.t, found.actual_bias[:, i], "blue", "dash", unit))
        band = Band("95 % of such ensembles", found.t, stats.bias_band[0][:, i], stats.bias_band[1][:, i], "blue", unit)
        panels.append(Panel(_with_unit(found.states[i], unit), tuple(curves), (band,), "signed"))
    return Drawing("Mean error", "t, s", tuple(panels))


def consistency(found: Outcome) -> Drawing:
    """NEES and NIS averaged over all runs, in the bands of chance."""
    stats = found.statistics
    assert stats is not None
    panels = []
    for name, values, dof, band in (
        ("NEES", stats.nees, stats.nees_dof, stats.nees_band),
        ("NIS", stats.nis, stats.nis_dof, stats.nis_band),
    ):
        there = dof > 0
        if there.any():
            low, high = np.where(there, band[0], np.nan), np.where(there, band[1], np.nan)
            curves = (
                Curve("mean over the runs", found.t, np.where(there, values, np.nan), "black", "line", "1"),
                Curve("expected", found.t, np.where(there, dof, np.nan), "blue", "dash", "1"),
            )
            panels.append(Panel(f"{name}, 1", curves, (Band("95 % band", found.t, low, high),)))
    return Drawing("Size of errors and innovations", "t, s", tuple(panels))


def gains(found: Outcome, states: Sequence[int]) -> Drawing:
    """The gain from every measurement to every estimate."""
    return _gains(found.t, found.K, states, found.states, found.units, found.measurements, found.measurement_units)


def variances(found: Outcome, states: Sequence[int]) -> Drawing:
    """The sawtooth of P⁻ and P⁺ as the filter claims."""
    panels = [
        _sawtooth(found.t, found.P_minus[:, i, i], found.P_plus[:, i, i], found.states[i], squared(found.units[i]), ("P⁻", "P⁺"))
        for i in states
    ]  # fmt: skip
    return Drawing("Variances before and after", "t, s", tuple(panels))


def innovations(found: Outcome, measurements: Sequence[int], run: int = 0) -> Drawing:
    """Innovations of a run in the band that holds 95 % of them."""
    panels = []
    for j in measurements:
        unit, half = found.measurement_units[j], 1.96 * _finite(found.innovation_sd[:, j])
        values = found.innovation[:, j, run]
        panels.append(
            Panel(
                f"innovation of {_with_unit(found.measurements[j], unit)}",
                _inside_outside("innovation", found.t, values, -half, half, unit),
                (Band("±1.96 √S", found.t, -half, half, unit=unit),),
                "signed",
            )
        )
    return Drawing("Innovations", "t, s", tuple(panels))


def nis(found: Outcome, run: int = 0) -> Drawing:
    """The normalised innovations squared of a run in their 95 % band."""
    there = found.nis_dof > 0
    low, high = (np.where(there, edge, np.nan) for edge in found.nis_band)
    curves = (
        *_inside_outside("NIS", found.t, found.nis[:, run], low, high, "1"),
        Curve("expected", found.t, np.where(there, found.nis_dof, np.nan), "black", "dash", "1"),
    )
    return Drawing(
        "Normalised innovations squared",
        "t, s",
        (Panel("NIS, 1", curves, (Band("95 % band", found.t, low, high),), "count"),),
    )


def whiteness(found: Outcome) -> Drawing:
    """Autocorrelations of the innovations of one record, with the band for white ones."""
    told = found.verdict
    assert told is not None
    panels = []
    for name, values, half in zip(found.measurements, told.correlation, told.band, strict=True):
        lags, values, half = (np.asarray(a, dtype=float)[: len(told.lags)] for a in (told.lags, values, half))
        panels.append(
            Panel(
                f"autocorrelation, {name}",
                (Curve("autocorrelation", lags, values, "blue", "bars", "1"),),
                (Band("95 % of white innovations", lags, -half, half, "orange", "1", frame=True),),
            )
        )
    return Drawing("Whiteness", "lag, steps", tuple(panels))


def poles(found: Poles) -> Drawing:
    """The poles of the model and of its filter, and where stability ends."""
    curves = [_pole_curve("model", found.model, found.plane, "orange", "cross")]
    if found.filter is not None:
        curves.append(_pole_curve("filter", found.filter, found.plane, "blue", "open"))
    size = max(
        [float(np.abs(c.x).max(initial=0.0)) for c in curves] + [float(np.abs(c.y).max(initial=0.0)) for c in curves]
    )
    if found.plane == "z":
        angle = np.linspace(0, 2 * np.pi, 181)
        edge = Curve("unit circle", np.cos(angle), np.sin(angle), "grey", "dot")
        axes = ("Re z, 1", "Im z, 1")
    else:
        reach = 1.2 * size or 1.0
        edge = Curve("edge of stability", [0.0, 0.0], [-reach, reach], "grey", "dot", "1/s")
        axes = ("Re s, 1/s", "Im s, 1/s")
    return Drawing(f"Poles in the plane of {found.plane}", axes[0], (Panel(axes[1], (edge, *curves)),), square=True)


def bode(found: Bode, names: Sequence[str] | None = None) -> Drawing:
    """Gain in dB and phase of the settled filter, a curve for each pair of an estimate and a measurement."""
    chosen = [i for i, name in enumerate(found.names) if names is None or name in names]
    gain, phase = [], []
    for i, (colour, style) in zip(chosen, line_styles(len(chosen)), strict=True):
        size = np.where(found.gain[i] > 0, found.gain[i], np.nan)
        gain.append(Curve(found.names[i], found.w, 20 * np.log10(size), colour, style, "dB"))
        phase.append(Curve(found.names[i], found.w, found.phase[i], colour, style, "°"))
    return Drawing(
        "Bode plot of the filter",
        "ω, rad/s",
        (Panel("gain, dB", tuple(gain)), Panel("phase, °", tuple(phase))),
        log=True,
    )


def deviations(found: Understanding, states: Sequence[int]) -> Drawing:
    """Standard deviations over time as they will be, with their limits."""
    plan: Transient = found.transient.value
    panels = []
    for i in states:
        panel = _sawtooth(
            plan.t, plan.sd_minus[:, i], plan.sd_plus[:, i], found.states[i], found.units[i], ("σ⁻", "σ⁺")
        )
        if found.limit:
            ends = np.array([plan.t[0], plan.t[-1]])
            limits = tuple(
                Curve(f"limit of {name}", ends, [sd[i], sd[i]], colour, "dot", found.units[i])
                for name, sd, colour in (
                    ("σ⁻", found.limit.value.sd_minus, "orange"),
                    ("σ⁺", found.limit.value.sd_plus, "blue"),
                )
            )
            panel = Panel(panel.label, (*panel.curves, *limits), (), kind="size")
        panels.append(panel)
    return Drawing("Standard deviation over time", "t, s", tuple(panels))


def side_by_side(first: tuple[str, Outcome], second: tuple[str, Outcome]) -> Drawing | None:
    """σ and RMS error of two experiments, for the states that both have by the same name and unit; ``None`` without any."""
    (_, a), (_, b) = first, second
    panels = []
    for i, (state, unit) in enumerate(zip(a.states, a.units, strict=True)):
        if (state, unit) not in zip(b.states, b.units, strict=True):
            continue
        j = list(b.states).index(state)
        curves = []
        for (name, found), index, colour in ((first, i, "blue"), (second, j, "orange")):
            curves.append(Curve(f"{name}: σ", found.t, _finite(found.sd_plus[:, index]), colour, "line", unit))
            if found.statistics is not None:
                curves.append(Curve(f"{name}: RMS", found.t, found.statistics.rms[:, index], colour, "dot", unit))
        panels.append(Panel(_with_unit(state, unit), tuple(curves), kind="size"))
    return Drawing("Standard deviations and RMS errors of both", "t, s", tuple(panels[:6])) if panels else None


# Parts of drawings ---------------------------------------------------------------------------------------------------


def squared(unit: str) -> str:
    """The unit of a variance.

    >>> squared("m"), squared("m/s"), squared("")
    ('m²', '(m/s)²', '')
    """
    return unit and (f"{unit}²" if unit.isalpha() else f"({unit})²")


def per(unit: str, other: str) -> str:
    """A unit for another one.

    >>> per("m/s", "m"), per("m", "m"), per("", "s")
    ('(m/s)/m', '1', '1/s')
    """
    if unit == other:
        return "1"
    top, bottom = ((each if each.isalpha() else f"({each})") if each else "1" for each in (unit, other))
    return top if bottom == "1" else f"{top}/{bottom}"


def plain(value: float) -> str:
    """A number as a spreadsheet reads it, with all its digits; nothing where there is none.

    >>> plain(0.1), plain(3.0), plain(float("nan"))
    ('0.1', '3', '')
    """
    if math.isnan(value):
        return ""
    value = float(value)
    return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)


def _gains(
    t: Array,
    K: Array,
    states: Sequence[int],
    names: Sequence[str],
    units: Sequence[str],
    sensors: Sequence[str],
    sensor_units: Sequence[str],
) -> Drawing:
    panels = []
    for i in states:
        curves = [
            Curve(f"from {sensors[j]}", t, _finite(K[:, i, j]), colour, style, per(units[i], sensor_units[j]))
            for j, (colour, style) in enumerate(line_styles(K.shape[2]))
        ]
        alike = {curve.unit for curve in curves}
        panels.append(Panel(_with_unit(f"gain of {names[i]}", alike.pop() if len(alike) == 1 else ""), tuple(curves)))
    return Drawing("Gain", "t, s", tuple(panels))


def _sawtooth(t: Array, before: Array, after: Array, state: str, unit: str, names: tuple[str, str]) -> Panel:
    """P0, P1⁻, P1⁺, …: one line through all, and both kinds of points where they can be told apart."""
    before, after = _finite(before), _finite(after)
    both = np.column_stack([before, after]).ravel()
    line = Curve(f"{names[0]} and {names[1]}", np.repeat(t, 2), both, "grey", "line", unit, quiet=True)
    marked = ("triangle", "points") if len(t) <= MARKED else ("line", "line")
    curves = (
        line,
        Curve(names[0], t, before, "orange", marked[0], unit),
        Curve(names[1], t, after, "blue", marked[1], unit),
    )
    return Panel(_with_unit(state, unit), curves, kind="size")


def _inside_outside(name: str, t: Array, values: Array, low: Array, high: Array, unit: str) -> tuple[Curve, ...]:
    """Points inside a band, and those outside in another colour and shape."""
    with np.errstate(invalid="ignore"):
        outside = (values < low) | (values > high)
    inside = np.where(outside, np.nan, values)
    curves = [Curve(name, t, inside, "blue", "points", unit)]
    if outside.any():
        curves.append(Curve("outside the band", t, np.where(outside, values, np.nan), "orange", "square", unit))
    return tuple(curves)


def _pole_curve(name: str, values: Array, plane: str, colour: str, style: str) -> Curve:
    values = np.asarray(values, dtype=complex)
    return Curve(name, values.real + 0.0, values.imag + 0.0, colour, style, "1/s" if plane == "s" else "")


def line_styles(count: int, start: int = 0) -> list[tuple[str, str]]:
    """Colours and dashes for a family: no two alike among the first 24."""
    styles = ("line", "dash", "dot")
    return [(CYCLE[(start + i) % len(CYCLE)], styles[(start + i) // len(CYCLE) % 3]) for i in range(count)]


def _with_unit(name: str, unit: str) -> str:
    return f"{name}, {unit}" if unit else name


def _array(values: ArrayLike) -> Array:
    return np.asarray(values, dtype=np.float64)


def _finite(values: ArrayLike) -> Array:
    """Infinite values (nothing is known, no finite gain) leave a gap."""
    found = _array(values)
    return np.where(np.isfinite(found), found, np.nan)


def _equal(a: ArrayLike, b: ArrayLike) -> bool:
    return a is b or np.array_equal(_array(a), _array(b))


def _told(panel: Panel) -> Iterable[Curve]:
    return (curve for curve in panel.curves if not curve.quiet)


def _free(name: str, taken: Iterable[str]) -> str:
    """A heading that no column has yet."""
    found, count = name, 2
    while found in taken:
        found, count = f"{name} ({count})", count + 1
    return found


def _square(panel: Panel) -> dict[str, Any]:
    """The vertical axis in the scale of the horizontal one."""
    return {
        "scaleanchor": "x",
        "scaleratio": 1,
        "range": _reach([curve.y for curve in panel.curves]),
        "automargin": False,
    }


def _reach(values: Sequence[ArrayLike]) -> list[float]:
    """From the least to the greatest value, and a little more."""
    found = np.concatenate([_array(each).ravel() for each in values])
    low, high = float(found.min()), float(found.max())
    more = 0.08 * (high - low) or 1.0
    return [low - more, high + more]


def _vertical(panel: Panel) -> dict[str, Any]:
    """What is special about the vertical axis."""
    values = [_array(curve.y) for curve in panel.curves if not curve.hidden]
    if panel.kind == "count" or not values:
        return {"rangemode": "tozero"} if values else {}
    everything = np.concatenate(values)
    everything = everything[np.isfinite(everything)]
    if panel.kind == "size":
        if len(everything) and everything.min() > 0 and everything.max() > FALLING * np.median(everything):
            few = everything.max() < 1e3 * everything.min()  # ticks at 1, 2, 5: all nine do not fit into a panel
            return {"type": "log", "dtick": "D2"} if few else {"type": "log"}
        return {"rangemode": "tozero"}
    if panel.kind == "signed" and len(everything):
        edges = np.abs(np.concatenate([*values, *(_array(band.high) for band in panel.bands)]))
        reach = 1.3 * float(np.quantile(edges[np.isfinite(edges)], 0.95))
        if 0 < FALLING / 5 * reach < np.abs(everything).max():
            return {"range": [-reach, reach]}
    return {}


# For plotly ----------------------------------------------------------------------------------------------------------

_MARKERS = {
    "points": "circle",
    "cross": "x-thin-open",
    "square": "square",
    "open": "circle-open",
    "triangle": "triangle-up",
}
_LINES = {"line": "solid", "dash": "dash", "dot": "dot"}


def _curve(curve: Curve, dark: bool) -> dict[str, Any]:
    colour, name, x, y = COLOURS[curve.colour][dark], _safe(curve.name), _array(curve.x), _array(curve.y)
    trace: dict[str, Any] = {"name": name, "legendgroup": name, "x": _typed(x), "y": _typed(y), "told": not curve.quiet}
    if curve.hidden:
        trace["visible"] = "legendonly"
    if curve.style == "bars":
        trace |= {"type": "bar", "marker": {"color": colour}}
    elif curve.style in _MARKERS:
        size = 7 if len(x) <= MARKED else 4
        big = curve.style in {"cross", "open"}
        marker = {"symbol": _MARKERS[curve.style], "color": colour, "size": size + 3 if big and len(x) <= 40 else size}
        marker["line"] = {"width": 2 if big and len(x) <= 40 else 1.2, "color": colour}
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
            trace["customdata"], more = _typed(_array(curve.sd)), " ± %{customdata:.3~g}"
        place = "%{x:.5~g}, " if curve.style in {"cross", "open"} and len(x) <= 40 else ""
        trace["hovertemplate"] = f"{name}: {place}%{{y:.5~g}}{more}{unit}<extra></extra>"
    return trace


def _band(band: Band, dark: bool) -> list[dict[str, Any]]:
    """A filled band as one closed line for every stretch without a gap, or two lines."""
    colour, name = COLOURS[band.colour][dark], _safe(band.name)
    x, low, high = _array(band.x), _array(band.low), _array(band.high)
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
    """An array as plotly reads it quickest: bytes. Seven digits are more than a screen shows, where they hold the values."""
    single = values.astype(np.float32)
    finite = np.isfinite(values)
    exact = values[finite]
    close = bool(np.all(np.abs(single[finite] - exact) <= 1e-6 * np.ptp(exact))) if finite.any() else True
    kind, kept = ("f4", single) if close else ("f8", values)
    return {"dtype": kind, "bdata": base64.b64encode(np.ascontiguousarray(kept, dtype=f"<{kind}").tobytes()).decode()}


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


def _short(text: str, most: int = 34) -> str:
    """A label that fits beside its panel; the unit stays."""
    if len(text) <= most:
        return text
    name, comma, unit = text.rpartition(", ")
    return f"{text[: most - 1]}…" if not comma else f"{name[: max(most - len(unit) - 3, 8)]}…, {unit}"


def _safe(text: str) -> str:
    """A user's name: plotly reads <…> as markup and %{…} as a value's place."""
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;").replace("%{", "% {")


def table(rows: Sequence[Sequence[object]]) -> str:
    """Rows with tabs between their cells, numbers with all digits: to be pasted into a spreadsheet."""
    return "\n".join("\t".join(_cell(value) for value in row) for row in rows)


def _cell(value: object) -> str:
    if isinstance(value, bool | np.bool_ | str) or value is None:
        return "" if value is None else " ".join(str(value).split())
    if isinstance(value, int | float | np.integer | np.floating):
        return str(int(value)) if isinstance(value, int | np.integer) else plain(float(value))
    return number(value, 17)
