"""Figures of a measured record: likelihood profiles, its columns, innovations and their correlation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from ctlabs.reporting.drawing import Band, Curve, Drawing, Mark, Panel, array, boxes, finite, inside_outside
from ctlabs.reporting.plots.base import BLACK, BLUE, GREY, ORANGE, legend, panels, styled
from ctlabs.text import _, fill

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Standard deviations on either side of 0 that hold 95 % of a normal distribution.
SIDE = 1.96

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


def columns(t: ArrayLike, values: Mapping[str, ArrayLike], *, xlabel: str) -> Drawing:
    """The columns of a table over its rows or times, one below another.

    ``values`` : the numbers of each column by its name, NaN where there is none
    """
    curves = ((Curve(name, t, y, width=0.8), Curve(name, t, y, style="points", size=1.5, quiet=True)) for name, y in values.items())
    panels = (Panel(name, pair) for name, pair in zip(values, curves, strict=True))
    return Drawing(_("Columns"), xlabel, tuple(panels), verbatim=True, height=1.0 + 1.7 * len(values))


def innovations(
    t: ArrayLike,
    innovation: ArrayLike,
    sd: ArrayLike,
    nis: ArrayLike,
    dof: ArrayLike,
    *,
    xlabel: str,
    labels: Sequence[str],
    units: Sequence[str] = (),
) -> Drawing:
    """Innovations of each measurement in the band of 95 %, and their normalised square in that of χ².

    ``innovation``, ``sd`` (steps+1, m), NaN where nothing is measured · ``nis``, ``dof`` (steps+1,), number of elements
    measured at each instant · ``labels`` : axis label (with unit) of each innovation
    """
    innovation, sd, units = array(innovation), array(sd), units or [""] * len(labels)
    pairs = zip(labels, units, innovation.T, sd.T, strict=True)
    panels = [innovation_panel(t, values, each, label, unit) for label, unit, values, each in pairs]
    return Drawing(_("Innovations"), xlabel, (*panels, nis_panel(t, nis, dof)))


def innovation_panel(t: ArrayLike, values: ArrayLike, sd: ArrayLike, label: str, unit: str = "") -> Panel:
    """The innovations of one measurement in the band that holds 95 % of them."""
    half = np.where(np.isfinite(array(values)), SIDE * finite(sd), np.nan)
    band = boxes(_("95 % band"), t, -half, half, unit)
    points = inside_outside(_("innovation"), t, values, -half, half, unit)
    return Panel(label, points, (band,), "signed", (Mark("", 0.0, style="line", width=1.0),))


def nis_panel(t: ArrayLike, nis: ArrayLike, dof: ArrayLike) -> Panel:
    """The normalised innovations squared in the band of 95 %."""
    nis, dof = array(nis), array(dof)
    measured = dof > 0
    high, low = (np.where(measured, special.chdtri(np.where(measured, dof, 1), p), np.nan) for p in (0.025, 0.975))
    expected = Curve(_("expected"), t, np.where(measured, dof, np.nan), "black", "dash", "1", width=1.0)
    points = inside_outside("NIS", t, np.where(measured, nis, np.nan), low, high, "1")
    return Panel(_("NIS, 1"), (*points, expected), (boxes(_("95 % band"), t, low, high),), "count")


def autocorrelation(
    correlations: Mapping[str, tuple[ArrayLike, ArrayLike, ArrayLike]], *, xlabel: str = "", ylabel: str = ""
) -> Drawing:
    """Autocorrelation of the standardised innovations of each measurement, and the band of 95 % of white ones.

    ``correlations`` : by the measurement's name its lags, autocorrelations, and half the width of the band at each lag
    """
    panels = []
    for name, columns in correlations.items():
        lags, r, half = (array(column) for column in columns)
        band = Band(_("95 % of white sequences"), lags, -half, half, unit="1")
        reach = max(1.2 * np.abs([*r, *half]).max(initial=0.2), 0.2)
        panels.append(
            Panel(
                ylabel or fill(_("autocorrelation of {name}"), name=name),
                inside_outside(_("autocorrelation"), lags, r, -half, half, "1", "stems"),
                (band,),
                levels=(Mark("", 0.0, style="line", width=1.0),),
                reach=(-reach, reach),
            )
        )
    return Drawing(_("Whiteness"), xlabel or _("lag, innovations"), tuple(panels), whole=True, height=1.2 + 2.2 * len(panels))
