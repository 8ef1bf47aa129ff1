"""Figures of a measured record: likelihood profiles, innovations, their correlation, and the estimates over the data."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike
from scipy import special

from ctlabs.linalg.checks import Array
from ctlabs.reporting.plots.base import BLACK, BLUE, GREEN, GREY, ORANGE, legend, panels, styled, whole
from ctlabs.text import _, fill

#: How far below its top a profile lies at the ends of the 95 % interval: half of a quantile of χ²(1).
DROP = 0.5 * float(special.chdtri(1, 0.05))


@styled
def likelihood_profiles(
    profiles: Mapping[str, tuple[ArrayLike, ArrayLike]],
    estimates: Mapping[str, float],
    *,
    top: float,
    labels: Mapping[str, str],
    standard_errors: Mapping[str, float | None] | None = None,
    columns: int = 2,
) -> Figure:
    """Profile log-likelihood of each constant, its estimate, the level of the 95 % interval and the parabola of its standard error.

    ``profiles`` : values and log-likelihood · ``top`` : log-likelihood of the estimates · ``labels`` : axis label (with
    unit) of each constant · ``standard_errors`` : where one is given, the quadratic approximation is drawn
    """
    columns = min(columns, len(profiles))
    rows = -(-len(profiles) // columns)
    figure, grid = panels(rows, columns, sharey=True, height=1.2 + 2.7 * rows)
    for axes, (name, (values, likelihood)) in zip(grid.flat, profiles.items(), strict=False):
        values, likelihood = np.asarray(values, dtype=np.float64), np.asarray(likelihood, dtype=np.float64)
        se = (standard_errors or {}).get(name)
        if se is not None:
            fine = np.linspace(values.min(), values.max(), 200)
            parabola = -0.5 * ((fine - estimates[name]) / se) ** 2
            axes.plot(fine, parabola, color=GREY, linestyle="--", label=_("quadratic approximation"))
        axes.plot(values, likelihood - top, color=BLUE, marker=".", label=_("profile log-likelihood"))
        axes.axhline(-DROP, color=ORANGE, linestyle=":", label=_("95 % level"))
        axes.plot(
            [estimates[name]],
            [0.0],
            color=BLACK,
            marker="o",
            markersize=6,
            linestyle="none",
            label=_("estimate"),
            zorder=5,
        )
        axes.set_ylim(-2.2 * DROP, 0.25 * DROP)
        axes.set_xlabel(labels[name])
    for axes in grid[:, 0]:
        axes.set_ylabel(_("log-likelihood − maximum"))
    for axes in grid.flat[len(profiles) :]:
        axes.set_visible(False)
    legend(figure, max(grid.flat[: len(profiles)], key=lambda a: len(a.get_legend_handles_labels()[1])))
    return figure


@styled
def columns(t: ArrayLike, values: Mapping[str, ArrayLike], *, xlabel: str) -> Figure:
    """The columns of a table over its rows or times, one below another.

    ``values`` : the numbers of each column by its name, NaN where there is none
    """
    figure, grid = panels(len(values), 1, sharex=True, height=1.0 + 1.7 * len(values))
    for axes, (name, column) in zip(grid.flat, values.items(), strict=True):
        axes.plot(t, column, color=BLUE, marker=".", markersize=3, linewidth=0.8)
        axes.set_ylabel(name.replace("$", r"\$"))
    grid.flat[-1].set_xlabel(xlabel)
    return figure


@styled
def innovations(
    t: ArrayLike,
    innovation: ArrayLike,
    sd: ArrayLike,
    nis: ArrayLike,
    dof: ArrayLike,
    *,
    xlabel: str,
    labels: tuple[str, ...] | list[str],
) -> Figure:
    """Innovations of each measurement in their ±2σ band, and their normalised square in the 95 % band of χ².

    ``innovation``, ``sd`` (steps+1, m), NaN where nothing is measured · ``nis``, ``dof`` (steps+1,), number of elements
    measured at each instant · ``labels`` : axis label (with unit) of each innovation
    """
    t, innovation, sd = np.asarray(t), np.asarray(innovation, dtype=np.float64), np.asarray(sd, dtype=np.float64)
    m = innovation.shape[1]
    figure, grid = panels(m + 1, 1, sharex=True, height=1.2 + 2.2 * (m + 1))
    for i, (axes, label) in enumerate(zip(grid[:-1, 0], labels, strict=True)):
        band = np.where(np.isfinite(innovation[:, i]), 2 * sd[:, i], np.nan)
        _boxes(axes, t, -band, band, _("95 % band (±2σ)"))
        axes.axhline(0.0, color=GREY, linewidth=1.0)
        _points(axes, t, innovation[:, i], band, -band, _("innovation, NIS"))
        axes.set_ylabel(label)
    nis, dof = np.asarray(nis, dtype=np.float64), np.asarray(dof, dtype=np.float64)
    measured = dof > 0
    low, high = (np.where(measured, special.chdtri(np.where(measured, dof, 1), p), np.nan) for p in (0.975, 0.025))
    axes = grid[-1, 0]
    _boxes(axes, t, low, high, None)
    _points(axes, t, np.where(measured, nis, np.nan), high, low, None)
    axes.set_ylim(bottom=0)
    axes.set_ylabel(_("NIS"))
    axes.set_xlabel(xlabel)
    legend(figure, grid[0, 0])
    return figure


@styled
def autocorrelation(
    correlations: Mapping[str, tuple[ArrayLike, ArrayLike, ArrayLike]],
    *,
    xlabel: str = "",
    ylabel: str = "",
) -> Figure:
    """Autocorrelation of the standardised innovations of each measurement, and the band of 95 % of white ones.

    ``correlations`` : by the measurement's name its lags, autocorrelations, and half the width of the band at each lag
    """
    figure, grid = panels(len(correlations), 1, sharex=True, height=1.2 + 2.2 * len(correlations))
    for axes, (name, columns) in zip(grid[:, 0], correlations.items(), strict=True):
        lags, r, band = (np.asarray(column, dtype=np.float64) for column in columns)
        axes.fill_between(lags, -band, band, color=BLUE, alpha=0.2, linewidth=0, label=_("95 % of white sequences"))
        axes.axhline(0.0, color=GREY, linewidth=1.0)
        outside = np.abs(r) > band
        for where, colour, marker, label in (
            (~outside, BLUE, "o", _("autocorrelation")),
            (outside, ORANGE, "s", _("outside the band")),
        ):
            axes.vlines(lags[where], 0.0, r[where], color=colour, linewidth=1.6)
            axes.plot(lags[where], r[where], color=colour, marker=marker, linestyle="none", label=label)
        axes.set_ylim(
            min(-1.2 * np.abs([*r, *band]).max(initial=0.2), -0.2), max(1.2 * np.abs([*r, *band]).max(initial=0.2), 0.2)
        )
        axes.set_ylabel(ylabel or fill(_("autocorrelation of {name}"), name=name))
        whole(axes)
    grid[-1, 0].set_xlabel(xlabel or _("lag, innovations"))
    legend(figure, grid[0, 0])
    return figure


@styled
def measured(
    t: ArrayLike,
    estimate: ArrayLike,
    sd: ArrayLike,
    *,
    xlabel: str,
    ylabel: str,
    z: ArrayLike | None = None,
    smoothed: ArrayLike | None = None,
    smoothed_sd: ArrayLike | None = None,
) -> Figure:
    """Data, filtered and smoothed estimate of one quantity with their ±σ bands; gaps in the data stay empty.

    All (steps+1,); ``z`` : the data in the unit of the quantity, NaN where there is none
    """
    t, estimate, sd = (np.asarray(a, dtype=np.float64) for a in (t, estimate, sd))
    figure, ((axes,),) = panels(height=4.2)
    _band(axes, t, estimate - sd, estimate + sd, _("estimate ± σ"))
    if smoothed is not None:
        x = np.asarray(smoothed, dtype=np.float64)
        if smoothed_sd is not None:
            s = np.asarray(smoothed_sd, dtype=np.float64)
            _band(axes, t, x - s, x + s, _("smoothed ± σ"), GREEN)
        axes.plot(t, x, color=GREEN, linestyle="--", label=_("smoothed"))
    axes.plot(t, estimate, color=BLUE, label=_("estimate"))
    if z is not None:
        axes.plot(t, np.asarray(z, dtype=np.float64), color=BLACK, linestyle="none", marker="x", label=_("measurement"))
    axes.set_xlabel(xlabel)
    axes.set_ylabel(ylabel)
    legend(figure, axes, columns=5)
    return figure


def _band(axes: Axes, t: ArrayLike, low: ArrayLike, high: ArrayLike, label: str | None, colour: str = BLUE) -> None:
    axes.fill_between(t, low, high, color=colour, alpha=0.18, linewidth=0, label=label)


def _boxes(axes: Axes, t: Array, low: Array, high: Array, label: str | None) -> None:
    """A band made of one box for each instant, so that an instant between two gaps has one too."""
    edges = np.concatenate([[t[0]], 0.5 * (t[1:] + t[:-1]), [t[-1]]])
    x, y = np.column_stack([edges[:-1], edges[1:]]).ravel(), [np.repeat(side, 2) for side in (low, high)]
    _band(axes, x, y[0], y[1], label)


def _points(axes: Axes, t: ArrayLike, values: ArrayLike, high: ArrayLike, low: ArrayLike, label: str | None) -> None:
    """Points, those outside a band in another colour and shape."""
    t, values = np.asarray(t), np.asarray(values)
    outside = (values > high) | (values < low)
    inside = np.isfinite(values) & ~outside
    size = 4.0 if len(t) < 400 else 2.0
    axes.plot(t[inside], values[inside], color=BLUE, marker="o", markersize=size, linestyle="none", label=label)
    axes.plot(
        t[outside],
        values[outside],
        color=ORANGE,
        marker="s",
        markersize=size,
        linestyle="none",
        label=_("outside the band") if label else None,
    )
