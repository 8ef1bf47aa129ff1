"""What every figure shares: the style, panels, legends; and :func:`lines`, curves over a common axis."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STYLE = Path(__file__).parent / "style.mplstyle"
BLACK, BLUE, ORANGE, GREEN, GREY = "#000000", "#0072B2", "#D55E00", "#009E73", "#8A8F96"
P = ParamSpec("P")
Drawn = TypeVar("Drawn")


def styled(draw: Callable[P, Drawn]) -> Callable[P, Drawn]:
    """Draw with the project's style, leaving matplotlib's settings as they were."""

    @wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> Drawn:
        import matplotlib as mpl  # half a second, which pages need not wait for

        with mpl.rc_context(fname=STYLE):
            return draw(*args, **kwargs)

    return drawn


def panels(rows: int = 1, columns: int = 1, *, height: float | None = None, **share: Any) -> tuple[Figure, Any]:
    """A figure of ``rows`` × ``columns`` axes, as wide as the page; the axes as an array."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.2, height or (1.2 + 2.6 * rows)))
    return figure, figure.subplots(rows, columns, squeeze=False, **share)


def legend(figure: Figure, *axes: Axes, columns: int = 4) -> None:
    """One legend above the axes, from the labels of ``axes``, in at most as many columns as fit the figure's width."""
    found = [each.get_legend_handles_labels() for each in axes]
    handles, names = [handle for pair in found for handle in pair[0]], [name for pair in found for name in pair[1]]
    if names:
        widest = 0.7 + 0.075 * max(len(re.sub(r"\\[a-z]+|[${}^_]", "", name)) for name in names)  # inches, at 9 points
        fitting = max(1, int(figure.get_figwidth() / widest))
        figure.legend(handles, names, loc="outside upper center", ncols=min(columns, fitting, len(names)))


def whole(axes: Axes) -> None:
    """Whole numbers on the horizontal axis where it counts: where all that is drawn lies at whole numbers."""
    from matplotlib.ticker import MaxNLocator

    if all(np.array_equal(x, np.round(x)) for x in (np.asarray(line.get_xdata(), dtype=float) for line in axes.lines)):
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))


def logarithmic(axes: Axes, log: str) -> None:
    """Logarithmic scales on the axes that ``log`` names ("x", "y", "xy"), with numbers that are read at a glance."""
    from ctlabs.reporting.plots.ticks import ShortLogTicks

    for name in log:
        axes.set(**{f"{name}scale": "log"})
        axis = axes.xaxis if name == "x" else axes.yaxis
        axis.set_major_formatter(ShortLogTicks())
        axis.set_minor_formatter(ShortLogTicks(labelOnlyBase=False))


@styled
def lines(
    x: ArrayLike,
    curves: Mapping[str, ArrayLike],
    *,
    xlabel: str,
    ylabel: str,
    points: Mapping[str, tuple[ArrayLike, ArrayLike]] | None = None,
    straight: Mapping[str, tuple[ArrayLike, ArrayLike]] | None = None,
    ordered: bool = False,
    log: str = "",
    marker: str = "",
    steps: bool = False,
    pairs: bool = False,
    ylim: tuple[float, float] | None = None,
) -> Figure:
    """Curves over a common x; ``points`` are marked, ``straight`` are dashed reference lines.

    ``ordered`` colours a family by its order, ``log`` names the logarithmic axes ("x", "y", "xy"),
    ``steps`` puts whole numbers on the horizontal axis; of ``pairs`` the second curve has the colour of the first, dashed.
    """
    import matplotlib as mpl

    figure, ((axes,),) = panels(height=4.2)
    colours = mpl.colormaps["cividis"](np.linspace(0.0, 0.92, len(curves))) if ordered else [None] * len(curves)
    for i, ((name, y), colour) in enumerate(zip(curves.items(), colours, strict=True)):
        second = pairs and i % 2 == 1
        shared = axes.lines[-1].get_color() if second else colour
        axes.plot(x, y, label=name, color=shared, marker=marker, linestyle="--" if second else "-")
    for name, (px, py) in (straight or {}).items():
        axes.plot(px, py, color=GREY, linestyle="--", linewidth=1.2, label=name)
    for name, (px, py) in (points or {}).items():
        axes.plot(px, py, color=BLACK, linestyle="none", marker="o", markersize=5, label=name, zorder=5)
    logarithmic(axes, log)
    if steps:
        whole(axes)
    if ylim:
        axes.set_ylim(*ylim)
    axes.set_xlabel(xlabel)
    axes.set_ylabel(ylabel)
    legend(figure, axes, columns=5)
    return figure
