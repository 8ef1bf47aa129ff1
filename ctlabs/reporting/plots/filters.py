"""Figures of a filter: variances, single runs, errors in their bands, an ensemble against theory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from ctlabs.filtering.results import Covariances, Filtered
from ctlabs.reporting.plots.base import BLACK, BLUE, GREY, ORANGE, legend, panels, styled, whole
from ctlabs.text import _, fill

if TYPE_CHECKING:
    from ctlabs.montecarlo import Statistics


@styled
def sawtooth(
    filters: Mapping[str, Covariances],
    *,
    ylabel: str,
    xlabel: str,
    state: int = 0,
    limits: Sequence[tuple[float, float]] | None = None,
    columns: int = 3,
) -> Figure:
    """Error variance P0, P1⁻, P1⁺, P2⁻, … of each each, one panel each; ``limits`` = steady (P⁻, P⁺)."""
    columns = min(columns, len(filters))
    rows = -(-len(filters) // columns)
    figure, grid = panels(rows, columns, sharex=True, height=1.4 + 2.1 * rows)
    for i, (name, each) in enumerate(filters.items()):
        axes = grid.flat[i]
        minus, plus = each.P_minus[:, state, state], each.P_plus[:, state, state]
        start = 0 if each.used[0].any() else 1  # a measurement at t0 has a P⁻ before it
        t, both = np.repeat(each.t, 2)[start:], np.column_stack([minus, plus]).ravel()[start:]
        axes.plot(t, both, color=GREY, linewidth=1.0)
        axes.plot(
            each.t[start:], minus[start:], linestyle="none", marker="^", color=ORANGE, label=_("prediction P⁻")
        )
        axes.plot(each.t, plus, linestyle="none", marker="o", color=BLUE, label=_("filtering P⁺"))
        if limits is not None:
            for value, colour in zip(limits[i], (ORANGE, BLUE), strict=True):
                axes.axhline(
                    value, color=colour, linestyle=":", linewidth=1.2, label=_("limits") if colour == BLUE else None
                )
        axes.set_title(name)
        axes.set_ylim(0, 1.08 * both.max() or 1.0)
        whole(axes)
    for axes in grid[:, 0]:
        axes.set_ylabel(ylabel)
    for axes in grid.flat[len(filters) :]:
        axes.set_visible(False)
    for axes in grid.flat[max(len(filters) - columns, 0) : len(filters)]:  # the lowest visible one of each column
        axes.set_xlabel(xlabel)
        axes.tick_params(labelbottom=True)
    legend(figure, grid.flat[0])
    return figure


@styled
def record(
    ensemble: Filtered, *, xlabel: str, ylabel: str, state: int = 0, measurement: int | None = 0, run: int = 0
) -> Figure:
    """Truth, measurements and estimate of one run, with the estimate's ±σ band."""
    figure, ((axes,),) = panels(height=4.2)
    estimate, sd = ensemble.x_plus[:, state, run], ensemble.sd_plus[:, state]
    axes.fill_between(
        ensemble.t, estimate - sd, estimate + sd, color=BLUE, alpha=0.18, linewidth=0, label=_("estimate ± σ")
    )
    if measurement is not None:
        axes.plot(
            ensemble.t,
            ensemble.z[:, measurement, run],
            linestyle="none",
            marker="x",
            color=ORANGE,
            label=_("measurement"),
        )
    if ensemble.truth is not None:
        axes.plot(ensemble.t, ensemble.truth[:, state, run], color=BLACK, label=_("truth"))
    axes.plot(ensemble.t, estimate, color=BLUE, marker=".", label=_("estimate"))
    axes.set_xlabel(xlabel)
    axes.set_ylabel(ylabel)
    legend(figure, axes)
    return figure


@styled
def errors(
    ensemble: Filtered,
    *,
    xlabel: str,
    unit: str,
    state: int = 0,
    measurement: int = 0,
    measured_unit: str | None = None,
    shown: int = 25,
) -> Figure:
    """Innovations, prediction errors and filtering errors of some runs inside their ±σ bands.

    ``unit`` is the state's, ``measured_unit`` the measurement's where it is another one.
    """
    S = ensemble.S[:, measurement, measurement]
    sd = np.sqrt(np.where(np.isfinite(S), S, np.nan))
    rows = [
        (_("innovation"), ensemble.innovation[:, measurement], sd, unit if measured_unit is None else measured_unit),
        (_("prediction error"), ensemble.error("minus")[:, state], ensemble.sd_minus[:, state], unit),
        (_("filtering error"), ensemble.error("plus")[:, state], ensemble.sd_plus[:, state], unit),
    ]
    figure, grid = panels(3, 1, sharex=True, height=7.0)
    for (name, values, band, of), axes in zip(rows, grid[:, 0], strict=True):
        several = axes.plot(ensemble.t, values[:, :shown], color=BLUE, linewidth=0.6, alpha=0.45)
        several[0].set_label(_("single runs"))
        axes.plot(ensemble.t, values[:, 0], color=BLACK, linewidth=1.2, label=_("run 1"))
        for k, style in ((1, "-"), (2, "--")):
            axes.plot(ensemble.t, k * band, color=ORANGE, linestyle=style, label=f"±{k}σ" if k > 1 else "±σ")
            axes.plot(ensemble.t, -k * band, color=ORANGE, linestyle=style)
        axes.set_ylabel(f"{name}{of_unit(of)}".replace(" (", "\n("))  # in two lines: a panel is low
        whole(axes)
    grid[-1, 0].set_xlabel(xlabel)
    legend(figure, grid[0, 0], columns=5)
    return figure


@styled
def ensemble_against_theory(
    stats: Statistics, P: ArrayLike, *, xlabel: str, units: Sequence[str], names: Sequence[str] | None = None
) -> Figure:
    """RMS and mean of the filtering error against theory, state by state, and NEES and NIS, in 95 % bands.

    ``P`` (steps+1, n, n) is the error covariance of the theory, ``names`` and ``units`` those of the states.
    """
    P = np.asarray(P, dtype=np.float64)
    n = P.shape[-1]
    names = names or (["x"] if n == 1 else [f"x{i + 1}" for i in range(n)])
    figure, grid = panels(n + 1, 2, sharex=True, height=1.6 + 1.9 * (n + 1))
    rms_band, bias_band = stats.rms_band(P), stats.bias_band(P)
    for i, (name, unit) in enumerate(zip(names, units, strict=True)):
        unit = of_unit(unit)
        against_theory(grid[i, 0], stats.t, np.sqrt(P[:, i, i]), [edge[:, i] for edge in rms_band], stats.rms[:, i])
        grid[i, 0].set_ylabel(f"{_('RMS error of')} {name}{unit}")
        grid[i, 0].set_ylim(bottom=0)
        against_theory(grid[i, 1], stats.t, np.zeros(len(stats.t)), [edge[:, i] for edge in bias_band], stats.bias[:, i])
        grid[i, 1].set_ylabel(f"{_('mean error of')} {name}{unit}")
    consistency = (
        ("NEES", stats.nees_dof, stats.nees_band(), stats.nees),
        ("NIS", stats.nis_dof, stats.nis_band(), stats.nis),
    )
    for axes, (name, freedom, band, values) in zip(grid[n], consistency, strict=True):
        against_theory(axes, stats.t, np.where(freedom > 0, freedom, np.nan), band, values)
        axes.set_ylabel(fill(_("{what}, average"), what=name))
        axes.set_xlabel(xlabel)
    legend(figure, grid[0, 0])
    return figure


def of_unit(unit: str) -> str:
    """What follows a quantity at its axis: its unit, or in words that it has none."""
    return f" ({_('a pure number')})" if unit == "1" else f", {unit}" if unit else ""


def against_theory(axes: Axes, t: ArrayLike, theory: ArrayLike, band: Sequence[ArrayLike], ensemble: ArrayLike) -> None:
    """A quantity of an ensemble as points over its theory and the band of 95 % of ensembles."""
    axes.fill_between(t, band[0], band[1], color=BLUE, alpha=0.2, linewidth=0, label=_("95 % of ensembles"))
    axes.plot(t, theory, color=BLUE, label=_("theory"))
    axes.plot(t, ensemble, color=ORANGE, linestyle="none", marker=".", label=_("ensemble"))
