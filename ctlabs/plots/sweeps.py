"""Figures of a sweep over parameters: a line over one, a heat map over two."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from ctlabs.plots.base import panels, styled

if TYPE_CHECKING:
    from ctlabs.montecarlo import Sweep


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
        axes.set_xscale("log")
        if len(names) == 2:
            axes.set_yscale("log")
    axes.set_xlabel(labels[names[0]])
    return figure
