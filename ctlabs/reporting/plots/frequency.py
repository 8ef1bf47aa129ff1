"""Figures in the frequency domain: Bode plots of filters, poles and zeros in the complex plane.

A system may be a python-control object, the polynomials of a transfer function, or what has been computed from it:

- a control ``TransferFunction`` or ``StateSpace`` with one input and one output (its ``dt`` says which kind);
- ``(num, den)`` in descending powers of s, or ``(num, den, dt)`` in ascending powers of z⁻¹, dt in s;
- for a Bode plot the complex response at each frequency, for a pole plot the array of poles.

python-control itself is not imported here: an object is only asked for its response, poles and zeros.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import cycle
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.reporting.drawing import CYCLE, Band, Curve, Drawing, Mark, Panel
from ctlabs.text import _, fill

#: See the module's docstring.
System = Any
ComplexArray = np.ndarray[Any, np.dtype[np.complex128]]
LINES = ("line", "dash", "dashdot", "dot")
MARKERS = ("cross", "plus", "triangle", "square")


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


def bode(
    systems: Mapping[str, System], omega: ArrayLike, *, marks: Mapping[str, float] | None = None, unit: str = "1"
) -> Drawing:
    """Magnitude and phase against frequency; a sampled system ends at its Nyquist frequency (dotted).

    Parameters
    ----------
    systems : by name, as in the module's docstring
    omega : (points,), rad/s, > 0
    marks : frequencies to mark (a bandwidth, for example), rad/s, by name
    unit : of the magnitude
    """
    omega = np.asarray(omega, dtype=np.float64)
    found = {name: response(system, omega) for name, system in systems.items()}
    styles = list(zip(found.items(), cycle(CYCLE), cycle(LINES), strict=False))
    size = tuple(Curve(name, omega, np.abs(values), colour, style, unit) for (name, values), colour, style in styles)
    phase = tuple(Curve(name, omega, _degrees(values), colour, style, "°") for (name, values), colour, style in styles)
    some = any(np.nan_to_num(np.abs(values)).any() for values in found.values())
    lines = [Mark(name, at, "grey", style) for (name, at), style in zip((marks or {}).items(), cycle(LINES[1:]), strict=False)]
    nyquist = sorted({np.pi / dt for dt in map(_period, systems.values()) if dt and np.pi / dt <= omega.max()})
    lines += [Mark(_("Nyquist frequency"), at, "black", "dot", 1.0) for at in nyquist]
    panels = (
        Panel(_("magnitude") if unit == "1" else fill(_("magnitude, {unit}"), unit=unit), size, kind="log" if some else ""),
        Panel(_("phase, degrees"), phase),
    )
    return Drawing(_("Bode plot"), _("frequency ω, rad/s"), panels, log=True, marks=tuple(lines), height=5.4)


def poles(systems: Mapping[str, System], *, plane: str = "s") -> Drawing:
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
    points, found, unit = [], [np.zeros(0, dtype=np.complex128)], "1/s" if plane == "s" else ""
    for (name, system), colour, style in zip(systems.items(), cycle(CYCLE), cycle(MARKERS), strict=False):
        roots, zeros = _roots(name, system, plane)
        points.append(Curve(name, roots.real + 0.0, roots.imag + 0.0, colour, style, unit, width=2, size=10))
        if zeros.size:
            circles = fill(_("{name}, zeros"), name=name)
            points.append(Curve(circles, zeros.real + 0.0, zeros.imag + 0.0, colour, "open", unit, size=9))
        found += [roots, zeros]
    suffix = ", 1/s" if plane == "s" else _(" (ratio per step)")
    across, up = (fill(text, plane=plane) + suffix for text in (_("real part of {plane}"), _("imaginary part of {plane}")))
    axis = Mark("", 0.0, "grey", "line", 0.8)
    values = np.concatenate(found)
    if plane == "z":
        reach = 1.15 * max(1.0, np.abs(values).max(initial=0.0))
        angle = np.linspace(0, 2 * np.pi, 181)
        circle = Curve(_("unit circle"), np.cos(angle), np.sin(angle), "black", quiet=True, width=1.6)
        panel = Panel(up, (circle, *points), levels=(axis,), reach=(-reach, reach))
        return Drawing(_("Poles in the plane of z"), across, (panel,), True, marks=(axis,), reach=panel.reach, height=4.6)
    size = np.abs(values).max(initial=0.0) or 1.0
    left, right = min(values.real.min(initial=0.0), 0.0) - 0.15 * size, max(values.real.max(initial=0.0), 0.0) + 0.15 * size
    height = 1.3 * max(np.abs(values.imag).max(initial=0.0), 0.25 * size)
    unstable = Band(_("unstable"), [0.0, right], [-height] * 2, [height] * 2, "grey")
    panel = Panel(up, tuple(points), (unstable,), levels=(axis,), reach=(-height, height))
    edge = Mark("", 0.0, "black", "line", 1.6)
    return Drawing(_("Poles in the plane of s"), across, (panel,), marks=(edge,), reach=(left, right), height=4.6)


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
