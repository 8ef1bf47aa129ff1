"""Figures of the studies: estimates over data or truth, variances before and after an update, gains, the forms of the filter compared."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.linalg.checks import Array
from ctlabs.reporting.drawing import Band, Curve, Drawing, Mark, Panel, array, finite, labelled, line_styles
from ctlabs.text import _, fill, per

if TYPE_CHECKING:
    from ctlabs.filtering.comparison import Judged

#: An error of zero in a logarithmic figure.
FLOOR = 1e-17
#: Instants above which points are not marked on a line, and how many bands an axis holds above which one is too thin to be seen.
MARKED, THIN = 120, 50
#: Colours and signs of measurements.
MEASURED = (("orange", "cross"), ("purple", "plus"), ("amber", "triangle"), ("brown", "open"))


def estimates(
    t: ArrayLike,
    curves: Mapping[str, tuple[ArrayLike, ArrayLike]],
    *,
    data: ArrayLike | None = None,
    truth: ArrayLike | None = None,
    ylabel: str,
    xlabel: str = "t, s",
) -> Drawing:
    """Estimates with their ±σ bands (each a pair of estimate and σ), over the measurements (and the truth) of the same quantity."""
    return Drawing(_("Estimates"), xlabel, (estimates_panel(t, curves, ylabel, data=data, truth=truth),))


def estimates_panel(
    t: ArrayLike,
    curves: Mapping[str, tuple[ArrayLike, ArrayLike]],
    label: str,
    unit: str = "",
    *,
    data: ArrayLike | Mapping[str, ArrayLike] | None = None,
    truth: ArrayLike | None = None,
    others: Sequence[Curve] = (),
) -> Panel:
    """One quantity: the first of ``curves`` is above the others, the measurements, ``data``, are below. The axis follows the estimates and
    the data, not a band that is wider than both (that of an estimate at t0).
    """
    measured = data if isinstance(data, Mapping) else {} if data is None else {_("measurement"): data}
    looks = zip(measured.items(), itertools.cycle(MEASURED), strict=False)
    below = [Curve(name, t, z, colour, style, unit) for (name, z), (colour, style) in looks]
    below += [] if truth is None else [Curve(_("truth"), t, truth, "black", unit=unit)]
    bands, lines, seen = [], [], [array(curve.y) for curve in below]
    for (name, (estimate, sd)), (colour, style) in zip(curves.items(), (("blue", "line"), ("green", "dash")), strict=False):
        x, s = array(estimate), finite(sd)
        bands.append(Band(fill(_("{name} ± σ"), name=name), t, x - s, x + s, colour, unit))
        lines.append(Curve(name, t, x, colour, style, unit, s))
        usual = s <= 3 * np.nanmedian(s) if np.isfinite(s).any() else np.zeros(len(s), bool)
        seen += [x[usual], (x - s)[usual], (x + s)[usual]]
    return Panel(label, (*below, *reversed(lines), *others), tuple(bands), reach=_reach(seen))


def _reach(seen: Sequence[Array]) -> tuple[float, float] | None:
    """From the least to the greatest value, and a little more; None where there is nothing between them."""
    values = finite(np.concatenate(seen))
    low, high = np.nanmin(values, initial=np.inf), np.nanmax(values, initial=-np.inf)
    return (float(low - 0.05 * (high - low)), float(high + 0.05 * (high - low))) if low < high else None


def residual_panel(panel: Panel, name: str, label: str, unit: str = "") -> Panel | None:
    """What is in a panel of estimates less the one that is called ``name``, in its band; None where the panel shows that itself.

    The band is not seen where it is thinner than a fiftieth of what the axis spans, as a rule of its instants.
    """
    estimate = next((curve for curve in panel.curves if curve.name == name), None)
    if estimate is None or estimate.sd is None or panel.reach is None:
        return None
    x, sd = array(estimate.y), array(estimate.sd)
    if not np.isfinite(sd).any() or 2 * np.nanmedian(sd) * THIN > panel.reach[1] - panel.reach[0]:
        return None
    rest = tuple(
        replace(curve, y=array(curve.y) - x, sd=None) for curve in panel.curves if curve is not estimate and len(array(curve.y)) == len(x)
    )
    band = Band(fill(_("{name} ± σ"), name=name), estimate.x, -sd, sd, estimate.colour, unit)
    return Panel(label, rest, (band,), "signed", (Mark("", 0.0, estimate.colour, "line", 1.0),)) if rest else None


def paths(t: ArrayLike, x: ArrayLike, smoothed: tuple[ArrayLike, ArrayLike], *, ylabel: str, xlabel: str = "t, s") -> Drawing:
    """Histories x (rows, number) as thin lines over a smoothed estimate and its ±2σ band."""
    x, (estimate, sd) = array(x), (array(part) for part in smoothed)
    band = Band(_("smoothed ± 2σ"), t, estimate - 2 * sd, estimate + 2 * sd)
    thin = (Curve(_("draws"), t, path, "grey", quiet=i > 0, width=0.6) for i, path in enumerate(x.T))
    return Drawing(_("Draws"), xlabel, (Panel(ylabel, (*thin, Curve(_("smoothed"), t, estimate)), (band,)),))


def before_after(
    t: ArrayLike, before: ArrayLike, after: ArrayLike, label: str, unit: str, names: tuple[str, str], limits: Sequence[float] = ()
) -> Panel:
    """P0, P1⁻, P1⁺, …: one line through all, and both kinds of points where they can be told apart; ``limits`` of both."""
    t, pair = array(t), (finite(before), finite(after))
    marked = ("triangle", "points") if len(t) <= MARKED else ("line", "line")
    line = Curve(" ".join(names), np.repeat(t, 2), np.column_stack(pair).ravel(), "grey", "line", unit, quiet=True, width=1.0)
    curves = (Curve(*given, unit) for given in zip(names, (t, t), pair, ("orange", "blue"), marked, strict=True))
    levels = (
        Mark(fill(_("limit of {name}"), name=name), limit, colour, "dot")
        for name, limit, colour in zip(names, limits, ("orange", "blue"), strict=False)
    )
    return Panel(label, (line, *curves), (), "size", tuple(levels))


def gains(
    t: ArrayLike,
    K: ArrayLike,
    states: Mapping[str, str],
    measurements: Mapping[str, str],
) -> Drawing:
    """The gain (instants, n, m) from every measurement to every estimate; ``states`` and ``measurements``: their units by their names."""
    K = finite(K)
    panels = []
    for i, (state, unit) in enumerate(states.items()):
        styles = line_styles(K.shape[2])
        curves = tuple(
            Curve(fill(_("from {name}"), name=name), t, K[:, i, j], colour, style, per(unit, other))
            for j, ((name, other), (colour, style)) in enumerate(zip(measurements.items(), styles, strict=True))
        )
        alike = {curve.unit for curve in curves}
        panels.append(Panel(labelled(fill(_("gain of {name}"), name=state), alike.pop() if len(alike) == 1 else ""), curves))
    return Drawing(_("Gain"), "t, s", tuple(panels), verbatim=True)


def algorithms(found: Sequence[Judged]) -> Drawing:
    """Forms of the filter: relative error of P and error of the estimate (logarithmic), and operations of a step."""
    places = np.arange(len(found))
    P, x, flops = (np.array([getattr(each, name) for each in found], dtype=np.float64) for name in ("error_P", "error_x", "flops"))
    errors = (
        Curve(_("covariance, relative"), places, np.maximum(P, FLOOR), "blue", "points", size=7),
        Curve(_("estimate, in units of its σ"), places, np.maximum(x, FLOOR), "orange", "cross", size=7),
    )
    cost = Curve(_("operations"), places, np.nan_to_num(flops), "grey", "bars", quiet=True)
    panels = (Panel(_("largest error against 50 digits"), errors, kind="log"), Panel(_("operations of a step"), (cost,), kind="count"))
    return Drawing(_("Accuracy and cost"), "", panels, ticks=tuple(each.name for each in found), height=5.8)


def against(values: ArrayLike, curves: Mapping[str, ArrayLike], *, xlabel: str) -> Drawing:
    """Relative errors of the forms against a constant of the model, both axes logarithmic; gaps where a form refuses."""
    drawn = []
    for i, ((name, errors), (colour, style)) in enumerate(zip(curves.items(), line_styles(len(curves)), strict=True)):
        y = np.maximum(array(errors), FLOOR)
        points = ("points", "cross", "square", "triangle", "plus", "open")[i % 6]
        drawn += [Curve(name, values, y, colour, style), Curve(name, values, y, colour, points, quiet=True, size=5)]
    panel = Panel(
        _("largest relative error of P against 50 digits"), tuple(drawn), kind="log", levels=(Mark("", 1.0, "black", "dot", 1.0),)
    )
    return Drawing(_("Accuracy"), xlabel, (panel,), log=bool((array(values) > 0).all()), height=4.8)
