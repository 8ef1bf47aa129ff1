"""Figures in the frequency domain: Bode plots of filters, poles and zeros in the complex plane.

A system may be a python-control object, the polynomials of a transfer function, or what has been computed from it:

- a control ``TransferFunction`` or ``StateSpace`` with one input and one output (its ``dt`` says which kind);
- ``(num, den)`` in descending powers of s, or ``(num, den, dt)`` in ascending powers of z⁻¹, dt in s;
- for a Bode plot the complex response at each frequency, for a pole plot the array of poles.

python-control itself is not imported here: an object is only asked for its response, poles and zeros.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import ArrayLike

from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.reporting.plots.base import BLACK, GREY, legend, panels, styled
from ctlabs.text import _, fill

#: See the module's docstring.
System = Any
ComplexArray = np.ndarray[Any, np.dtype[np.complex128]]
LINES = ("-", "--", "-.", ":")
MARKERS = ("x", "+", "1", "2", "3", "4")


def response(system: System, omega: ArrayLike) -> ComplexArray:
    r"""The complex response of a system at the frequencies ω.

    .. math:: H(s)\big|_{s=j\omega} \quad\text{or}\quad H(z)\big|_{z=e^{j\omega\,dt}}, \ \omega \le \pi/dt

    Parameters
    ----------
    system : as in the module's docstring
    omega : (points,), rad/s, > 0

    Returns
    -------
    (points,), complex; NaN above the Nyquist frequency π/dt of a sampled system, which says nothing there

    Raises
    ------
    ValueError
        Frequencies that are not positive; an array of another length; more than one input or output; a sampled system
        whose period is not given.

    >>> abs(response(([0.5], [1, 0.5]), [0.5])).round(6)
    array([0.707107])
    >>> abs(response(([0.5, 0], [1, -0.5], 1.0), [1e-6, 4.0])).round(3)
    array([ 1., nan])
    """
    omega = checks.shaped("omega", omega, ("points",))
    if not (omega > 0).all():
        msg = f"omega: expected frequencies > 0, received {omega.min():g} rad/s"
        raise ValueError(msg)
    dt = _period(system)
    if isinstance(system, tuple):
        shift = np.exp(-1j * omega * dt) if dt else 1j * omega
        num, den = (np.asarray(p, dtype=np.float64)[:: -1 if dt else 1] for p in system[:2])
        values = np.polyval(num, shift) / np.polyval(den, shift)
    elif callable(system):
        points = np.exp(1j * omega * dt) if dt else 1j * omega
        values = np.asarray(system(points, squeeze=False, warn_infinite=False), dtype=np.complex128)
        if values.ndim == 3 and values.shape[:2] == (1, 1):
            values = values[0, 0]
    else:
        values = np.asarray(system, dtype=np.complex128)
    if values.shape != omega.shape:
        msg = f"system: expected one input, one output and {omega.shape} responses, received shape {values.shape}"
        raise ValueError(msg)
    return np.where(omega * dt <= np.pi, values, np.nan)


@styled
def bode(
    systems: Mapping[str, System], omega: ArrayLike, *, marks: Mapping[str, float] | None = None, unit: str = "1"
) -> Figure:
    """Magnitude and phase against frequency; a sampled system ends at its Nyquist frequency (dotted).

    Parameters
    ----------
    systems : by name, as in the module's docstring
    omega : (points,), rad/s, > 0
    marks : frequencies to mark (a bandwidth, for example), rad/s, by name
    unit : of the magnitude
    """
    omega = np.asarray(omega, dtype=np.float64)
    figure, grid = panels(2, 1, sharex=True, height=5.4)
    magnitude, phase = grid[:, 0]
    nyquist = sorted({np.pi / dt for dt in map(_period, systems.values()) if dt and np.pi / dt <= omega.max()})
    for (name, system), style in zip(systems.items(), _cycle(LINES, len(systems)), strict=True):
        values = response(system, omega)
        magnitude.plot(omega, np.abs(values), linestyle=style, label=name)
        phase.plot(omega, _degrees(values), linestyle=style)
    for (name, frequency), style in zip((marks or {}).items(), _cycle(LINES[1:], len(marks or {})), strict=True):
        for axes in (magnitude, phase):
            axes.axvline(
                frequency, color=GREY, linestyle=style, linewidth=1.2, label=name if axes is magnitude else None
            )
    for i, frequency in enumerate(nyquist):
        for axes in (magnitude, phase):
            label = _("Nyquist frequency") if axes is magnitude and not i else None
            axes.axvline(frequency, color=BLACK, linestyle=":", linewidth=1.0, label=label)
    magnitude.set_xscale("log")
    if any(
        line.get_ydata(orig=True)[np.isfinite(line.get_ydata(orig=True))].any()
        for line in magnitude.lines[: len(systems)]
    ):
        magnitude.set_yscale("log")
    magnitude.set_ylabel(fill(_("magnitude, {unit}"), unit=unit))
    phase.set_ylabel(_("phase, degrees"))
    phase.set_xlabel(_("frequency ω, rad/s"))
    legend(figure, magnitude)
    return figure


@styled
def poles(systems: Mapping[str, System], *, plane: str = "s") -> Figure:
    """Poles (crosses) and zeros (circles) in the complex plane with its boundary of stability.

    Parameters
    ----------
    systems : by name: arrays of poles, or systems as in the module's docstring
    plane : "s" (stable left of the imaginary axis) or "z" (stable inside the unit circle)

    Raises
    ------
    ValueError
        Another plane; a continuous system in the plane of z or a sampled one in that of s.
    """
    if plane not in ("s", "z"):
        msg = f"plane: expected 's' or 'z', received {plane!r}"
        raise ValueError(msg)
    figure, ((axes,),) = panels(height=4.6)
    found = []
    for (name, system), marker in zip(systems.items(), _cycle(MARKERS, len(systems)), strict=True):
        roots, zeros = _roots(name, system, plane)
        (line,) = axes.plot(
            roots.real,
            roots.imag,
            linestyle="none",
            marker=marker,
            markersize=10,
            markeredgewidth=2,
            label=name,
            zorder=4,
        )
        if zeros.size:
            axes.plot(
                zeros.real, zeros.imag, linestyle="none", marker="o", markersize=9, markerfacecolor="none",
                markeredgecolor=line.get_color(), label=fill(_("{name}, zeros"), name=name), zorder=3,
            )  # fmt: skip
        found += [roots, zeros]
    _boundary(axes, np.concatenate([*found, np.zeros(0)]), plane)
    unit = ", 1/s" if plane == "s" else _(" (ratio per step)")
    axes.set_xlabel(fill(_("real part of {plane}"), plane=plane) + unit)
    axes.set_ylabel(fill(_("imaginary part of {plane}"), plane=plane) + unit)
    legend(figure, axes)
    return figure


def _boundary(axes: Axes, points: ComplexArray, plane: str) -> None:
    """The boundary of stability, and limits that show it together with the points."""
    axes.axhline(0.0, color=GREY, linewidth=0.8, zorder=1)
    axes.axvline(0.0, color=BLACK if plane == "s" else GREY, linewidth=1.6 if plane == "s" else 0.8, zorder=1)
    if plane == "z":
        axes.add_patch(Circle((0, 0), 1, fill=False, color=BLACK, linewidth=1.6, zorder=1))
        axes.set_aspect("equal")
        reach = 1.15 * max(1.0, np.abs(points).max(initial=0.0))
        axes.set_xlim(-reach, reach)
        axes.set_ylim(-reach, reach)
        return
    size = np.abs(points).max(initial=0.0) or 1.0
    right = max(points.real.max(initial=0.0), 0.0) + 0.15 * size
    axes.set_xlim(min(points.real.min(initial=0.0), 0.0) - 0.15 * size, right)
    height = 1.3 * max(np.abs(points.imag).max(initial=0.0), 0.25 * size)
    axes.set_ylim(-height, height)
    axes.axvspan(0.0, right, color=GREY, alpha=0.12, linewidth=0, label=_("unstable"), zorder=0)


def _roots(name: str, system: System, plane: str) -> tuple[ComplexArray, ComplexArray]:
    """Poles and zeros; an array holds poles only."""
    if not (isinstance(system, tuple) or callable(system)):
        return np.atleast_1d(np.asarray(system, dtype=np.complex128)), np.zeros(0, dtype=np.complex128)
    dt = _period(system)
    if bool(dt) != (plane == "z"):
        kind = fill("a sampled one, dt = {dt} s", dt=dt) if dt else "a continuous one"
        msg = f"{name}: expected a {'sampled' if plane == 'z' else 'continuous'} system in the plane of {plane}, received {kind}"
        raise ValueError(msg)
    if callable(system):
        return np.asarray(system.poles()), np.asarray(system.zeros())
    num, den = (np.asarray(p, dtype=np.float64) for p in system[:2])
    if dt:  # ascending powers of z⁻¹ are descending powers of z when both are equally long
        size = max(len(num), len(den))
        num, den = np.pad(num, (0, size - len(num))), np.pad(den, (0, size - len(den)))
    return np.asarray(np.roots(den), dtype=np.complex128), np.asarray(np.roots(num), dtype=np.complex128)


def _period(system: System) -> float:
    """The period of a sampled system, s; 0 of a continuous one and of what has no time."""
    dt = system[2] if isinstance(system, tuple) and len(system) == 3 else getattr(system, "dt", None)
    if dt is True:
        msg = "system: expected a period dt, received a discrete system without one"
        raise ValueError(msg)
    return float(dt) if dt else 0.0


def _degrees(values: ComplexArray) -> Array:
    """The phase without jumps; NaN stays NaN, and where the response vanishes there is none."""
    phase = np.full(values.shape, np.nan)
    known = np.isfinite(values) & (values != 0)
    phase[known] = np.degrees(np.unwrap(np.angle(values[known])))
    return phase


def _cycle(items: tuple[str, ...], count: int) -> list[str]:
    return [items[i % len(items)] for i in range(count)]
