"""Figures of the studies: estimates over data or truth, the forms of the filter compared."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from ctlabs.reporting.plots.base import BLACK, BLUE, GREEN, GREY, ORANGE, legend, panels, styled
from ctlabs.text import _, fill

#: Longer records are drawn by lines and small dots instead of marked points.
POINTS = 200
#: More points than this in a curve are not seen: bands and lines are thinned to it.
DRAWN = 4000
#: An error of zero in a logarithmic figure.
FLOOR = 1e-17


@styled
def estimates(
    t: ArrayLike,
    curves: Mapping[str, tuple[ArrayLike, ArrayLike]],
    *,
    data: ArrayLike | None = None,
    truth: ArrayLike | None = None,
    ylabel: str,
    xlabel: str = "t, s",
) -> Figure:
    """Estimates with their ±σ bands (each a pair of estimate and σ), over the measurements (and the truth) of the same quantity.

    The vertical axis follows the estimates and the data, not a band that is wider than both (an estimate at t0).
    """
    t, figure, axes = np.asarray(t), *_one()
    shown = slice(None, None, -(-len(t) // DRAWN))
    seen = []
    if data is not None:
        data = np.asarray(data, dtype=np.float64)
        marker: dict[str, Any] = (
            {"marker": "x", "markersize": 4} if len(t) <= POINTS else {"marker": ".", "markersize": 2}
        )
        axes.plot(t[shown], data[shown], linestyle="none", color=GREY, label=_("measurement"), **marker)
        seen.append(data)
    if truth is not None:
        truth = np.asarray(truth, dtype=np.float64)
        axes.plot(t[shown], truth[shown], color=BLACK, label=_("truth"))
        seen.append(truth)
    for (name, (estimate, sd)), colour in zip(curves.items(), (BLUE, ORANGE, GREEN), strict=False):
        x, band = np.asarray(estimate, dtype=np.float64), np.asarray(sd, dtype=np.float64)
        axes.fill_between(t[shown], (x - band)[shown], (x + band)[shown], color=colour, alpha=0.18, linewidth=0)
        axes.plot(t[shown], x[shown], color=colour, label=fill(_("{name} ± σ"), name=name))
        usual = band <= 3 * np.median(band)
        seen += [x[usual], (x - band)[usual], (x + band)[usual]]
    values = np.concatenate(seen)
    low, high = np.nanmin(values, initial=np.inf), np.nanmax(values, initial=-np.inf)
    if low < high:
        axes.set_ylim(low - 0.05 * (high - low), high + 0.05 * (high - low))
    axes.set_xlabel(xlabel)
    axes.set_ylabel(ylabel)
    legend(figure, axes)
    return figure


@styled
def paths(t: ArrayLike, x: ArrayLike, smoothed: tuple[ArrayLike, ArrayLike], *, ylabel: str, xlabel: str = "t, s") -> Figure:
    """Histories x (rows, number) as thin lines over a smoothed estimate and its ±2σ band."""
    t, x, figure, axes = np.asarray(t), np.asarray(x), *_one()
    shown = slice(None, None, -(-len(t) // DRAWN))
    estimate, sd = (np.asarray(part, dtype=np.float64) for part in smoothed)
    axes.fill_between(t[shown], (estimate - 2 * sd)[shown], (estimate + 2 * sd)[shown], color=BLUE, alpha=0.18, linewidth=0)
    lines = axes.plot(t[shown], x[shown], color=GREY, linewidth=0.6)
    lines[0].set_label(_("draws"))
    axes.plot(t[shown], estimate[shown], color=BLUE, label=_("smoothed ± 2σ"))
    axes.set_xlabel(xlabel)
    axes.set_ylabel(ylabel)
    legend(figure, axes)
    return figure


@styled
def accuracy(names: Sequence[str], errors_P: ArrayLike, errors_x: ArrayLike, flops: ArrayLike) -> Figure:
    """Forms of the filter: relative error of P and error of the estimate (logarithmic), and operations of a step."""
    figure, grid = panels(1, 2, sharey=True, height=1.4 + 0.3 * len(names))
    places = np.arange(len(names))[::-1]
    left, right = grid[0]
    for values, colour, marker, label in (
        (errors_P, BLUE, "o", _("covariance, relative")),
        (errors_x, ORANGE, "x", _("estimate, in units of its σ")),
    ):
        known = np.asarray(values, dtype=np.float64)
        left.plot(
            np.maximum(known, FLOOR), places, linestyle="none", color=colour, marker=marker, markersize=7, label=label
        )
    left.set_xscale("log")
    left.set_yticks(places, names)
    left.set_xlabel(_("largest error against 50 digits"))
    right.barh(places, np.nan_to_num(np.asarray(flops, dtype=np.float64)), color=GREY)
    right.set_xlabel(_("operations of a step"))
    legend(figure, left)
    return figure


@styled
def against(values: ArrayLike, curves: Mapping[str, ArrayLike], *, xlabel: str) -> Figure:
    """Relative errors of the forms against a constant of the model, both axes logarithmic; gaps where a form refuses."""
    figure, axes = _one(4.8)
    for (name, errors), style in zip(curves.items(), _styles(len(curves)), strict=True):
        axes.plot(values, np.maximum(np.asarray(errors, dtype=np.float64), FLOOR), label=name, markersize=5, **style)
    if (np.asarray(values, dtype=np.float64) > 0).all():
        axes.set_xscale("log")
    axes.set_yscale("log")
    axes.axhline(1.0, color=BLACK, linestyle=":", linewidth=1.0)
    axes.set_xlabel(xlabel)
    axes.set_ylabel(_("largest relative error of P against 50 digits"))
    legend(figure, axes, columns=6)
    return figure


def _one(height: float = 4.2) -> tuple[Figure, Axes]:
    figure, ((axes,),) = panels(height=height)
    return figure, axes


def _styles(count: int) -> list[dict[str, Any]]:
    """Line styles and markers that stay apart where curves lie on one another."""
    lines, markers = ("-", "--", "-.", ":"), "osD^vx+*<>ph"
    return [{"linestyle": lines[(i // 8) % 4], "marker": markers[i % len(markers)]} for i in range(count)]
