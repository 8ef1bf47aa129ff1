"""Figures of a random field: the surface z(x, t), maps over (x, t), rows of the gain, σ_ε against the noise."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, cast

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import ArrayLike
from PIL import Image

from ctlabs.reporting.plots.base import BLACK, BLUE, GREY, ORANGE, legend, panels, styled
from ctlabs.text import _

if TYPE_CHECKING:
    from mpl_toolkits.mplot3d.axes3d import Axes3D


@styled
def surface(x: ArrayLike, t: ArrayLike, z: ArrayLike, *, xlabel: str, tlabel: str, zlabel: str) -> Figure:
    """The surface z (times, nodes) over place and time."""
    figure = Figure(figsize=(7.2, 5.2))
    figure.set_layout_engine("none")  # it would leave the cube too little room
    axes = cast("Axes3D", figure.add_axes((0.0, 0.02, 0.93, 1.0), projection="3d"))
    places, times = np.meshgrid(np.asarray(x), np.asarray(t))
    axes.plot_surface(
        times, places, np.asarray(z), cmap="cividis", rcount=101, ccount=61, linewidth=0.15, edgecolor=GREY
    )
    axes.set_xlabel(tlabel)
    axes.set_ylabel(xlabel)
    axes.set_zlabel(zlabel)
    axes.set_box_aspect((1.5, 1.1, 0.7))
    axes.view_init(elev=32, azim=-58)
    return figure


@styled
def maps(
    x: ArrayLike,
    t: ArrayLike,
    fields: Mapping[str, ArrayLike],
    *,
    xlabel: str,
    tlabel: str,
    common: Sequence[str] = (),
) -> Figure:
    """Colour maps of fields (times, nodes) over time and place, one below the other, each with its colour bar.

    The keys of ``fields`` label the colour bars ("z, u"); those in ``common`` share one scale. Zero is white.
    """
    values = {name: np.asarray(field, dtype=np.float64) for name, field in fields.items()}
    sizes = {name: _largest([field]) for name, field in values.items()}
    shared = _largest([values[name] for name in common])
    figure, grid = panels(len(values), 1, sharex=True, height=1.0 + 1.9 * len(values))
    for axes, (name, field) in zip(grid[:, 0], values.items(), strict=True):
        size = shared if name in common else sizes[name]
        image = axes.pcolormesh(
            np.asarray(t),
            np.asarray(x),
            field.T,
            cmap="RdBu_r",
            vmin=-size,
            vmax=size,
            shading="nearest",
            rasterized=True,
        )
        axes.grid(visible=False)
        axes.set_ylabel(xlabel)
        figure.colorbar(image, ax=axes, label=name)
    grid[-1, 0].set_xlabel(tlabel)
    return figure


@styled
def gain_rows(
    nodes: ArrayLike, rows: Mapping[str, tuple[ArrayLike, ArrayLike]], *, xlabel: str, ylabels: tuple[str, str]
) -> Figure:
    """Rows of the gain over the measured nodes: for z (above) and for its rate (below), one curve per key."""
    figure, grid = panels(2, 1, sharex=True, height=5.4)
    colours = mpl.colormaps["cividis"](np.linspace(0.0, 0.85, len(rows)))
    for i, (axes, ylabel) in enumerate(zip(grid[:, 0], ylabels, strict=True)):
        for (name, pair), colour in zip(rows.items(), colours, strict=True):
            axes.plot(nodes, pair[i], marker=".", color=colour, label=name)
        axes.axhline(0.0, color=GREY, linewidth=0.8)
        axes.set_ylabel(ylabel)
    grid[-1, 0].set_xlabel(xlabel)
    legend(figure, grid[0, 0], columns=5)
    return figure


@styled
def errors_by_noise(groups: Mapping[str, Mapping[str, ArrayLike]], *, xlabel: str, ylabel: str) -> Figure:
    """σ_ε against σ_n, one panel per group: printed values, theory, bound, and the middle 95 % of an ensemble.

    A group holds the lists ``noise``, ``printed``, ``true``, ``bound`` and, where there is an ensemble, ``low`` and ``high``.
    """
    figure, grid = panels(1, len(groups), sharey=True, height=4.4)
    for axes, (name, group) in zip(grid[0], groups.items(), strict=True):
        noise = group["noise"]
        if "low" in group:
            axes.fill_between(
                noise, group["low"], group["high"], color=BLUE, alpha=0.2, linewidth=0, label=_("95 % of seeds")
            )
        axes.plot(noise, group["true"], color=BLUE, marker=".", label=_("theory of the printed filter"))
        axes.plot(noise, group["bound"], color=BLACK, linestyle="--", marker=".", label=_("causal bound"))
        axes.plot(noise, group["printed"], color=ORANGE, linestyle="none", marker="x", markersize=7, label=_("printed"))
        axes.set_title(name)
        axes.set_xlabel(xlabel)
    grid[0, 0].set_ylabel(ylabel)
    grid[0, 0].set_ylim(bottom=0)
    legend(figure, grid[0, 0])
    return figure


def _largest(fields: Sequence[np.ndarray]) -> float:
    return max((float(np.nanmax(np.abs(field), initial=0.0)) for field in fields), default=0.0) or 1.0


@styled
def animation(
    x: ArrayLike,
    t: ArrayLike,
    fields: Mapping[str, ArrayLike],
    *,
    xlabel: str,
    ylabel: str,
    every: int = 1,
    milliseconds: int = 80,
) -> bytes:
    """An animated GIF of fields (times, nodes) along x: truth, measurement, estimate.

    ``every`` : show each so-manieth time · ``milliseconds`` : for each of them. Returns the file's bytes.

    >>> gif = animation([0, 1, 2], [0, 1], {"truth": [[0, 1, 0], [1, 0, 1]]}, xlabel="place x, m", ylabel="field z, u")
    >>> gif[:6]
    b'GIF89a'
    """
    values = {name: np.asarray(field, dtype=np.float64) for name, field in fields.items()}
    times = np.asarray(t, dtype=np.float64)
    for name, field in values.items():
        if field.shape != (len(times), np.size(x)):
            msg = f"{name}: expected shape {(len(times), np.size(x))} (times, nodes), received {field.shape}"
            raise ValueError(msg)
    figure, ((axes,),) = panels(height=3.6)
    canvas = FigureCanvasAgg(figure)
    styles = {"measurement": {"linestyle": "none", "marker": "x", "color": ORANGE}, "truth": {"color": BLACK}}
    lines = {
        name: axes.plot(x, field[0], label=name, **styles.get(name, {"color": BLUE}))[0]
        for name, field in values.items()
    }
    everything = np.concatenate([field.ravel() for field in values.values()])
    axes.set_ylim(np.nanmin(everything), np.nanmax(everything))
    axes.set_xlabel(xlabel)
    axes.set_ylabel(ylabel)
    legend(figure, axes)
    frames = []
    for k in range(0, len(times), every):
        for name, line in lines.items():
            line.set_ydata(values[name][k])
        axes.set_title(f"t = {times[k]:.4g} s", loc="right")
        canvas.draw()  # type: ignore[no-untyped-call]  # matplotlib's canvas has no types
        pixels = np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]  # as above
        frames.append(Image.fromarray(pixels).convert("RGB").quantize(64))
    packed = io.BytesIO()
    frames[0].save(packed, format="gif", save_all=True, append_images=frames[1:], duration=milliseconds, loop=0)
    return packed.getvalue()
