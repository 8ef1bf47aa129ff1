"""Figures of a quantity over a grid: a sweep over parameters, a value for every pair of instants."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from ctlabs.reporting.plots.base import BLACK, GREY, ORANGE, logarithmic, panels, styled, whole
from ctlabs.text import translated

if TYPE_CHECKING:
    from ctlabs.montecarlo import Sweep

#: Instants of a map whose numbers can still be read.
NUMBERED = 12


@styled
def sweep(result: Sweep, quantity: str, *, labels: dict[str, str], label: str, log: bool = False) -> Figure:
    """One measured quantity over the grid: a line for one parameter, a heat map for two.

    ``labels`` : axis label (with unit) of each parameter · ``label`` : of the quantity · ``log`` : logarithmic axes of
    the parameters
    """
    names, values = list(result.axes), result.surface(quantity)
    if len(names) > 2:
        msg = f"sweep: expected one or two parameters to draw, received {names}"
        raise ValueError(msg)
    figure, ((axes,),) = panels(height=4.4)
    if len(names) == 2:
        x, y = (np.asarray(result.axes[name], dtype=np.float64) for name in names)
        image = axes.pcolormesh(x, y, values.T, shading="nearest", cmap="cividis")
        axes.grid(visible=False)
        figure.colorbar(image, ax=axes, label=label)
        axes.set_ylabel(labels[names[1]])
    else:
        axes.plot(result.axes[names[0]], values, marker="o")
        axes.set_ylabel(label)
    if log:
        logarithmic(axes, "xy" if len(names) == 2 else "x")
    axes.set_xlabel(labels[names[0]])
    return figure


@styled
def pairs(
    instants: ArrayLike,
    values: ArrayLike,
    allowed: ArrayLike,
    *,
    xlabel: str,
    ylabel: str,
    label: str,
    best: Sequence[int] | None = None,
) -> Figure:
    """A value for every pair (k, 2) as coloured cells; those not ``allowed`` crossed out, the ``best`` one framed."""
    instants, values = np.asarray(instants), np.asarray(values, dtype=np.float64)
    size = int(instants.max()) + 1
    grid = np.full((size, size), np.nan)
    grid[instants[:, 1], instants[:, 0]] = values
    figure, ((axes,),) = panels(height=5.4)
    image = axes.imshow(grid, origin="lower", cmap="cividis_r", aspect="equal")
    axes.grid(visible=False)
    for (i, j), good in zip(instants, np.asarray(allowed), strict=True):
        if not good:
            axes.plot(i, j, marker="x", color=BLACK, markersize=9, linestyle="none")
    if best is not None:
        axes.add_patch(Rectangle((best[0] - 0.5, best[1] - 0.5), 1, 1, fill=False, edgecolor=ORANGE, linewidth=2.5))
    figure.colorbar(image, ax=axes, label=label)
    whole(axes)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel(xlabel)
    axes.set_ylabel(ylabel)
    return figure


@styled
def pair_maps(
    instants: ArrayLike,
    maps: Mapping[str, tuple[ArrayLike, ArrayLike, Sequence[int] | None]],
    *,
    xlabel: str,
    ylabel: str,
) -> Figure:
    """A value for every pair (k, 2), one map for each title of ``maps``: values, which are allowed, and the best pair.

    Allowed pairs are coloured, the others have grey numbers on white, the best one is framed. Up to twelve instants have their numbers.
    """
    import matplotlib as mpl

    instants = np.asarray(instants)
    size = int(instants.max()) + 1
    figure, grid = panels(math.ceil(len(maps) / 2), 2, height=0.6 + 3.5 * math.ceil(len(maps) / 2))
    colours = mpl.colors.LinearSegmentedColormap.from_list("pale", mpl.colormaps["Blues"](np.linspace(0.08, 0.55, 64)))
    for axes, (title, (values, allowed, best)) in zip(grid.ravel(), maps.items(), strict=False):
        values, allowed = np.asarray(values, dtype=np.float64), np.asarray(allowed, dtype=bool)
        cells = np.full((size, size), np.nan)
        cells[instants[:, 1], instants[:, 0]] = np.where(allowed, values, np.nan)
        axes.imshow(cells[:, : size - 1], origin="lower", cmap=colours, aspect="auto")
        axes.grid(visible=False)
        for (i, j), value, good in zip(instants if size <= NUMBERED else (), values, allowed, strict=False):
            axes.text(i, j, f"{value:.1f}", ha="center", va="center", fontsize=6.5, color=BLACK if good else GREY)
        if best is not None:
            axes.add_patch(Rectangle((best[0] - 0.5, best[1] - 0.5), 1, 1, fill=False, edgecolor=ORANGE, linewidth=2.0))
        axes.set(title=translated(title), xlabel=xlabel, ylabel=ylabel)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    for axes in grid.ravel()[len(maps) :]:
        axes.remove()
    return figure
