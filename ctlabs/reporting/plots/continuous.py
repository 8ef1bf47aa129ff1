"""Figures of continuous filters, and of sampled ones laid over them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.filtering.results import Covariances
from ctlabs.reporting.drawing import CYCLE, Curve, Drawing, Mark, Panel
from ctlabs.reporting.plots.base import BLACK, BLUE, GREEN, GREY, ORANGE, legend, logarithmic, panels, styled
from ctlabs.reporting.plots.filters import against_theory
from ctlabs.text import _, fill, translated

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ctlabs.montecarlo import Statistics

#: More measurements than this are drawn as lines, not as points.
POINTS = 60


def transient(
    t: ArrayLike,
    curves: Mapping[str, ArrayLike],
    *,
    ylabel: str,
    xlabel: str = "t, s",
    limits: Mapping[str, float] | None = None,
    marks: Mapping[str, float] | None = None,
    log: str = "",
) -> Drawing:
    """Continuous curves such as P(t), their limits (dashed, in the colour of the curve of that name) and marked times.

    Parameters
    ----------
    t : (points,), s
    curves : (points,) each, by name
    limits : by the names of curves
    marks : times to mark (a settling time, for example), s, by name
    log : the logarithmic axes, "x", "y" or "xy"
    """
    unknown = set(limits or {}) - set(curves)
    if unknown:
        msg = f"limits: expected names among {list(curves)}, received {sorted(unknown)}"
        raise ValueError(msg)
    lines = [Curve(name, t, values, colour) for (name, values), colour in zip(curves.items(), cycle(CYCLE), strict=False)]
    levels = (Mark(_("limit"), limits[each.name], each.colour) for each in lines if limits and each.name in limits)
    positive = all(np.nanmin(np.asarray(each.y)) >= 0 for each in lines)
    panel = Panel(ylabel, tuple(lines), kind="log" if "y" in log else "count" if positive else "", levels=tuple(levels))
    times = tuple(Mark(name, at, "grey", "dot", 1.4) for name, at in (marks or {}).items())
    return Drawing(ylabel, xlabel, (panel,), log="x" in log, marks=times)


@styled
def sampled(
    schedules: Mapping[str, Covariances],
    t: ArrayLike,
    P: ArrayLike,
    *,
    ylabel: str,
    xlabel: str = "t, s",
    state: int = 0,
    limit: float | None = None,
    log: str = "",
    ylim: tuple[float, float] | None = None,
) -> Figure:
    """The sawtooth P⁻, P⁺ of discrete filters over the continuous P(t), one panel for each filter.

    Parameters
    ----------
    schedules : discrete filters by name; what lies beyond the last t is left out
    t, P : (points,), s, and the variance of the same state in the continuous filter
    state : which state of the schedules
    limit : of P(t)
    log : the logarithmic axes, "x", "y" or "xy"
    ylim : range of the variance, where the beginning would hide the rest
    """
    t, P = np.asarray(t, dtype=np.float64), np.asarray(P, dtype=np.float64)
    figure, grid = panels(len(schedules), 1, sharex=True, height=1.6 + 2.6 * len(schedules))
    for (name, schedule), axes in zip(schedules.items(), grid[:, 0], strict=True):
        shown = (schedule.t <= t[-1] * (1 + 1e-12)) & ((schedule.t > 0) | ("x" not in log))
        first = int((schedule.t[shown] <= 0).sum())  # there is no prediction for t0
        when = schedule.t[shown]
        minus, plus = schedule.P_minus[shown, state, state], schedule.P_plus[shown, state, state]
        few = len(when) <= POINTS
        teeth = np.column_stack([minus, plus]).ravel()[first:]
        axes.plot(np.repeat(when, 2)[first:], teeth, color=GREY, linewidth=0.9)
        line, marks = ("none", "^o") if few else ("-", ("", ""))
        axes.plot(
            when[first:],
            minus[first:],
            color=ORANGE,
            linestyle=line,
            marker=marks[0],
            linewidth=1.0,
            label=_("prediction P⁻"),
        )
        axes.plot(when, plus, color=BLUE, linestyle=line, marker=marks[1], linewidth=1.0, label=_("filtering P⁺"))
        axes.plot(t, P, color=BLACK, label=_("continuous P(t)"))
        if limit is not None:
            axes.axhline(limit, color=BLACK, linestyle=":", linewidth=1.2, label=_("limit of P(t)"))
        axes.set_title(name)
        axes.set_ylabel(ylabel)
        _scale(axes, log)
        if ylim:
            axes.set_ylim(*ylim)
        elif "y" not in log:
            axes.set_ylim(bottom=0)
    grid[-1, 0].set_xlabel(xlabel)
    legend(figure, grid[0, 0])
    return figure


@styled
def gains(
    t: ArrayLike,
    Kc: ArrayLike,
    schedule: Covariances,
    *,
    names: Sequence[str],
    units: Sequence[str],
    measurement: int = 0,
    xlabel: str = "t, s",
    log: str = "",
) -> Figure:
    """Gains of a continuous filter and, as points, those of a discrete one divided by its period, state by state.

    Parameters
    ----------
    t : (points,), s
    Kc : (points, n, m), continuous gains
    schedule : the discrete filter; what lies beyond the last t, and before the first, is left out
    names, units : n each, of the gains
    measurement : which column of the gains
    log : the logarithmic axes, "x", "y" or "xy" (there the absolute value)
    """
    t, Kc = np.asarray(t, dtype=np.float64), np.asarray(Kc, dtype=np.float64)
    dt = float(schedule.t[1] - schedule.t[0])
    shown = (schedule.t <= t[-1] * (1 + 1e-12)) & (schedule.t >= t[0] * (1 - 1e-12)) & schedule.used[:, measurement]
    figure, grid = panels(len(names), 1, sharex=True, height=1.4 + 1.9 * len(names))
    for i, (name, unit, axes) in enumerate(zip(names, units, grid[:, 0], strict=True)):
        curve, points = Kc[:, i, measurement], schedule.K[shown, i, measurement] / dt
        if "y" in log:
            curve, points = np.abs(curve), np.abs(points)
        axes.plot(t, curve, color=BLACK, label=_("continuous filter"))
        size = 4.5 if shown.sum() <= POINTS else 2.0
        axes.plot(
            schedule.t[shown], points, linestyle="none", marker="o", markersize=size, color=BLUE,
            label=_("discrete filter, gain over the period"),
        )  # fmt: skip
        _scale(axes, log)
        axes.set_ylabel(f"{translated(name)}, {unit}")
    grid[-1, 0].set_xlabel(xlabel)
    legend(figure, grid[0, 0])
    return figure


@styled
def estimates(
    truth: tuple[ArrayLike, ArrayLike] | None,
    filters: Mapping[str, tuple[ArrayLike, ArrayLike, ArrayLike]],
    *,
    ylabel: str,
    xlabel: str = "t, s",
    measurements: tuple[ArrayLike, ArrayLike] | None = None,
    log: str = "",
) -> Figure:
    """One truth and what several filters make of it, each with its ±σ band, on time grids of their own.

    Parameters
    ----------
    truth : (t, x)
    filters : by name, (t, estimate, standard deviation)
    measurements : (t, z)
    log : "x" for a logarithmic time
    """
    figure, ((axes,),) = panels(height=4.2)
    if measurements is not None:
        size = 5 if np.size(measurements[0]) <= POINTS else 2.5
        axes.plot(*measurements, linestyle="none", marker="x", markersize=size, color=GREY, label=_("measurement"))
    for i, (name, (t, estimate, sd)) in enumerate(filters.items()):
        colour = (BLUE, ORANGE, GREEN)[i % 3]
        estimate, sd = np.asarray(estimate, dtype=np.float64), np.asarray(sd, dtype=np.float64)
        axes.fill_between(t, estimate - sd, estimate + sd, color=colour, alpha=0.16, linewidth=0)
        axes.plot(t, estimate, color=colour, label=f"{translated(name)} ± σ", marker="." if np.size(t) <= POINTS else "")
    if truth is not None:
        axes.plot(*truth, color=BLACK, linewidth=1.2, label=_("truth"))
    _scale(axes, log)
    axes.set_xlabel(xlabel)
    axes.set_ylabel(ylabel)
    legend(figure, axes)
    return figure


@styled
def ensemble_log(
    stats: Statistics, P: ArrayLike, *, xlabel: str, units: Sequence[str], names: Sequence[str], log: str = "y"
) -> Figure:
    """An ensemble against theory where errors shrink by orders of magnitude, from the first measurement on.

    RMS of each state on a logarithmic axis, mean error in units of its standard deviation, NEES and NIS, each with the
    band of 95 % of ensembles. Where theory knows a state exactly (its variance is zero) nothing is drawn.

    Parameters
    ----------
    stats : of the ensemble
    P : (steps+1, n, n), covariance of the error in theory
    units, names : n each, of the states
    log : "y", or "xy" with a logarithmic time as well
    """
    P = np.asarray(P, dtype=np.float64)
    cut, n = slice(max(stats.first, 1), None), P.shape[-1]
    t, sd = stats.t[cut], np.sqrt(np.diagonal(P, axis1=1, axis2=2))
    sd = np.where(sd > 0, sd, np.nan)
    figure, grid = panels(n + 1, 2, sharex=True, height=1.6 + 1.9 * (n + 1))
    rms_band, bias_band = stats.rms_band(P), stats.bias_band(P)
    for i, (name, unit) in enumerate(zip(names, units, strict=True)):
        known = np.isfinite(sd[cut, i])
        rms = np.where(known, stats.rms[cut, i], np.nan)
        against_theory(grid[i, 0], t, sd[cut, i], [np.where(known, edge[cut, i], np.nan) for edge in rms_band], rms)
        grid[i, 0].set_ylabel(f"{_('RMS error of')} {name}, {unit}")
        if known.any():
            logarithmic(grid[i, 0], "y")
        relative = [values[cut, i] / sd[cut, i] for values in (*bias_band, stats.bias)]
        against_theory(grid[i, 1], t, np.where(known, 0.0, np.nan), relative[:2], relative[2])
        grid[i, 1].set_ylabel(fill(_("mean error of {name}, σ"), name=name))
    consistency = (
        ("NEES", stats.nees_dof, stats.nees_band(), stats.nees),
        ("NIS", stats.nis_dof, stats.nis_band(), stats.nis),
    )
    for axes, (name, freedom, band, values) in zip(grid[n], consistency, strict=True):
        expected = np.where(freedom > 0, freedom, np.nan)
        against_theory(axes, t, expected[cut], [edge[cut] for edge in band], values[cut])
        axes.set_ylabel(fill(_("{what}, average"), what=name))
        axes.set_xlabel(xlabel)
        logarithmic(axes, "x" if "x" in log else "")
    legend(figure, grid[0, 0])
    return figure


def _scale(axes: Axes, log: str) -> None:
    if "x" in log:
        axes.set_xscale("log")
    if "y" in log:
        axes.set_yscale("log")
