r"""Block diagrams: transfer functions, summing points, samplers and signals joined by arrows.

Places are (column, row) on a grid, rows growing upwards; an arrow that does not run straight turns one corner.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch

from ctlabs.reporting.plots.base import BLACK, styled

WIDTH, HEIGHT, RADIUS = 1.1, 0.62, 0.13


@dataclass(frozen=True, slots=True)
class Node:
    r"""A place in the diagram.

    ``kind``: ``block`` (a box with ``text``, usually a transfer function), ``sum`` (a circle that adds what arrives),
    ``branch`` (a dot where a signal divides), ``sampler`` (an open switch) or ``signal`` (its ``text`` alone).
    """

    at: tuple[float, float]
    text: str = ""
    kind: Literal["block", "sum", "branch", "sampler", "signal"] = "block"


@dataclass(frozen=True, slots=True)
class Arrow:
    """From one node to another: ``label`` above its first leg, ``sign`` beside its head (for a summing point).

    ``turn`` says which leg comes first where it has two: ``"across"`` (horizontal first) or ``"along"`` (vertical first).
    """

    start: str
    end: str
    label: str = ""
    sign: str = ""
    turn: Literal["across", "along"] = "across"


@styled
def block_diagram(nodes: Mapping[str, Node], arrows: Sequence[Arrow]) -> Figure:
    """A block diagram from named ``nodes`` and ``arrows`` between them.

    >>> figure = block_diagram(
    ...     {"w": Node((0, 0), "w", "signal"), "F": Node((1.4, 0), r"$1/(s+a)$"), "x": Node((2.8, 0), "x", "signal")},
    ...     [Arrow("w", "F"), Arrow("F", "x")],
    ... )
    """
    across = [node.at[0] for node in nodes.values()]
    along = [node.at[1] for node in nodes.values()]
    width, height = max(across) - min(across) + 1.6, max(along) - min(along) + 1.3
    figure = Figure(figsize=(7.2, max(1.1, 7.2 * height / max(width, 5.0))))
    figure.set_layout_engine("none")
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.grid(visible=False)
    middle = 0.5 * (max(across) + min(across))
    half = 0.5 * max(width, 5.0)
    axes.set_xlim(middle - half, middle + half)
    axes.set_ylim(min(along) - 0.65, max(along) + 0.65)
    for node in nodes.values():
        _draw(axes, node)
    for arrow in arrows:
        _join(axes, nodes[arrow.start], nodes[arrow.end], arrow)
    return figure


def _draw(axes: Axes, node: Node) -> None:
    x, y = node.at
    if node.kind == "block":
        box = FancyBboxPatch(
            (x - WIDTH / 2, y - HEIGHT / 2), WIDTH, HEIGHT, boxstyle="round,pad=0,rounding_size=0.04",
            facecolor="#EEF4FA", edgecolor=BLACK, linewidth=1.2,
        )  # fmt: skip
        axes.add_patch(box)
        axes.text(x, y, node.text, ha="center", va="center", fontsize=11)
    elif node.kind == "sum":
        axes.add_patch(Circle((x, y), RADIUS, facecolor="white", edgecolor=BLACK, linewidth=1.2))
        axes.plot([x - 0.06, x + 0.06], [y, y], color=BLACK, linewidth=1.0)
        axes.plot([x, x], [y - 0.06, y + 0.06], color=BLACK, linewidth=1.0)
    elif node.kind == "branch":
        axes.add_patch(Circle((x, y), 0.035, facecolor=BLACK, edgecolor=BLACK))
    elif node.kind == "sampler":
        axes.plot([x - 0.22, x + 0.16], [y, y + 0.2], color=BLACK, linewidth=1.4)
        axes.text(x, y - 0.24, node.text, ha="center", va="center", fontsize=10)
    else:
        axes.text(x, y, node.text, ha="center", va="center", fontsize=11)


def _reach(node: Node) -> tuple[float, float]:
    """How far a node extends across and along from its place."""
    return {
        "block": (WIDTH / 2, HEIGHT / 2),
        "sum": (RADIUS, RADIUS),
        "branch": (0.0, 0.0),
        "sampler": (0.22, 0.0),
        "signal": (0.1 + 0.045 * len(node.text.replace("$", "")), 0.18),
    }[node.kind]


def _join(axes: Axes, start: Node, end: Node, arrow: Arrow) -> None:
    (x0, y0), (x1, y1) = start.at, end.at
    turned = (x1, y0) if arrow.turn == "across" else (x0, y1)
    corner = None if y0 == y1 or x0 == x1 else turned
    first, last = _leave(start, corner or (x1, y1)), _leave(end, corner or (x0, y0))
    path = [first, corner, last] if corner else [first, last]
    if corner:
        axes.plot([first[0], corner[0]], [first[1], corner[1]], color=BLACK, linewidth=1.2)
    axes.annotate(
        "", xy=last, xytext=path[-2],
        arrowprops={"arrowstyle": "-" if end.kind in ("branch", "sampler") else "-|>", "color": BLACK, "linewidth": 1.2,
                    "shrinkA": 0, "shrinkB": 0},
    )  # fmt: skip
    a, b = path[0], path[1]
    if arrow.label:
        level = a[1] == b[1]
        place = (0.5 * (a[0] + b[0]), a[1] + 0.14) if level else (a[0] + 0.1, 0.5 * (a[1] + b[1]))
        axes.text(*place, arrow.label, ha="center" if level else "left", va="center", fontsize=10)
    if arrow.sign:
        before = path[-2]
        beside = (
            (last[0] - 0.1, last[1] + 0.13)
            if before[1] == last[1]
            else (last[0] + 0.1, last[1] + 0.12 * (1 if before[1] > last[1] else -1))
        )
        axes.text(*beside, arrow.sign, ha="center", va="center", fontsize=10)


def _leave(node: Node, towards: tuple[float, float]) -> tuple[float, float]:
    """The point on a node's edge where an arrow to or from ``towards`` meets it."""
    (x, y), (across, along) = node.at, _reach(node)
    if towards[1] == y:
        return x + (across if towards[0] > x else -across), y
    return x, y + (along if towards[1] > y else -along)
