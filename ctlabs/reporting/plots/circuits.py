"""Circuit diagrams: a ladder of resistors in series and capacitors to ground."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch, Rectangle

from ctlabs.reporting.plots.base import BLACK, GREY, styled

TOP, SECTION = 1.5, 2.6
LINE: dict[str, Any] = {"color": BLACK, "linewidth": 1.3}


@styled
def ladder(
    sections: Sequence[tuple[str, str, str]], *, source: str, output: str, enclosure: str = "", followers: bool = False
) -> Figure:
    """Sections (resistor, capacitor, voltage of the capacitor) from the voltage ``source`` to the terminals ``output``.

    A voltage left empty is not drawn (that of the last capacitor is the output). ``enclosure`` names a dashed box
    around what cannot be reached; with ``followers`` a unit-gain amplifier stands between the sections, so that the
    later ones do not load the earlier.

    >>> figure = ladder([("R₁", "C₁", "U₁"), ("R₂", "C₂", "U₂")], source="u", output="U₀", enclosure="black box")
    """
    wide = SECTION + (0.9 if followers else 0.0)
    right = 0.7 + wide * len(sections) + (0.3 if not followers else -0.6)
    figure = Figure(figsize=(7.2, 7.2 * (TOP + 1.7) / (right + 2.6)))
    figure.set_layout_engine("none")
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.grid(visible=False)
    axes.set_xlim(-1.2, right + 1.4)
    axes.set_ylim(-0.7, TOP + 1.0)
    axes.plot([0, right], [0, 0], **LINE)
    axes.plot([0, 0.7], [TOP, TOP], **LINE)
    for i, (resistor, capacitor, voltage) in enumerate(sections):
        x = 0.7 + wide * i
        _resistor(axes, x, resistor)
        _capacitor(axes, x + 1.7, capacitor, voltage)
        end = x + wide if i + 1 < len(sections) else right
        axes.plot([x + 1.0, end], [TOP, TOP], **LINE)
        if followers and i + 1 < len(sections):
            _follower(axes, x + 2.5)
    _terminals(axes, 0.0, source, left=True)
    _terminals(axes, right, output, left=False)
    if enclosure:
        axes.add_patch(
            Rectangle((0.35, -0.3), right - 0.7, TOP + 0.85, fill=False, edgecolor=GREY, linestyle="--", linewidth=1.4)
        )
        axes.text(0.45, TOP + 0.68, enclosure, color=GREY, fontsize=10, va="bottom")
    return figure


def _resistor(axes: Axes, x: float, name: str) -> None:
    """From x to x + 1 at the top."""
    axes.add_patch(
        FancyBboxPatch((x + 0.1, TOP - 0.14), 0.8, 0.28, boxstyle="square,pad=0", facecolor="white", edgecolor=BLACK, linewidth=1.3)
    )  # fmt: skip
    axes.plot([x, x + 0.1], [TOP, TOP], **LINE)
    axes.plot([x + 0.9, x + 1.0], [TOP, TOP], **LINE)
    axes.text(x + 0.5, TOP + 0.3, name, ha="center", va="center", fontsize=11)


def _capacitor(axes: Axes, x: float, name: str, voltage: str) -> None:
    """From the top to ground at x, with a dot where it joins and its voltage beside it."""
    middle = TOP / 2
    axes.plot([x, x], [TOP, middle + 0.07], **LINE)
    axes.plot([x, x], [middle - 0.07, 0], **LINE)
    for y in (middle - 0.07, middle + 0.07):
        axes.plot([x - 0.28, x + 0.28], [y, y], color=BLACK, linewidth=2.2)
    for y in (0.0, TOP):
        axes.add_patch(Circle((x, y), 0.045, facecolor=BLACK, edgecolor=BLACK))
    axes.text(x - 0.36, middle, name, ha="right", va="center", fontsize=11)
    if not voltage:
        return
    axes.annotate("", xy=(x + 0.45, 0.2), xytext=(x + 0.45, TOP - 0.2), arrowprops={"arrowstyle": "-|>", "color": GREY})
    axes.text(x + 0.53, middle, voltage, ha="left", va="center", fontsize=11)


def _follower(axes: Axes, x: float) -> None:
    """A triangle of unit gain at the top, from x to x + 0.6."""
    axes.fill(
        [x, x, x + 0.6], [TOP - 0.34, TOP + 0.34, TOP], facecolor="white", edgecolor=BLACK, linewidth=1.3, zorder=3
    )
    axes.text(x + 0.2, TOP, "1", ha="center", va="center", fontsize=10, zorder=4)


def _terminals(axes: Axes, x: float, name: str, *, left: bool) -> None:
    """Two open terminals and the voltage between them."""
    for y in (0.0, TOP):
        axes.add_patch(Circle((x, y), 0.06, facecolor="white", edgecolor=BLACK, linewidth=1.3, zorder=3))
    axes.annotate("", xy=(x, 0.15), xytext=(x, TOP - 0.15), arrowprops={"arrowstyle": "-|>", "color": GREY})
    axes.text(x + (-0.15 if left else 0.15), TOP / 2, name, ha="right" if left else "left", va="center", fontsize=11)
