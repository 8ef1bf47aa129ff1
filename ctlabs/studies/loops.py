"""Pictures of a regulator's loop, for reports and pages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ctlabs.linalg.checks import Array
from ctlabs.regulation.curves import Periods, Tradeoff
from ctlabs.regulation.runs import LoopEnsemble
from ctlabs.reporting.drawing import Curve, Drawing, Mark, Panel, labelled, line_styles
from ctlabs.reporting.plots import frequency
from ctlabs.text import _, fill

if TYPE_CHECKING:
    from ctlabs.studies.regulating import Regulated
    from ctlabs.studies.responses import Response

#: Signals that a picture shows at most.
SHOWN = 4
#: A mode of less modulus is over within a period.
DEAD = 1e-9
#: Points of a frequency response.
POINTS = 400


def poles(found: Regulated) -> Drawing:
    """Of the plant, and of the loop: those of the feedback and those of the estimator, or, where the design is wrong, all together.

    As rates ln(z)/dt, 1/s, but for those that are over within a period (z = 0).
    """
    shown: dict[str, Array] = {_("plant"): np.linalg.eigvals(found.truth.Phi)}
    if found.other is None:
        shown |= {_("feedback"): found.regulator.feedback.poles, _("estimator"): found.regulator.estimator.poles}
    else:
        shown |= {_("closed loop"): found.loop.poles, _("closed loop as designed"): found.regulator.poles}
    dt = found.truth.dt
    rates = {name: np.log(z[np.abs(z) > DEAD].astype(complex)) / dt for name, z in shown.items()}
    return frequency.poles({name: each for name, each in rates.items() if len(each)}, plane="s")


def deviations(found: Regulated, states: Sequence[int], inputs: Sequence[int] = ()) -> Drawing:
    """σ of states and inputs over time, with their limits where there are any."""
    over, limit = found.over.value, found.limit.found
    panels = []
    for i in states:
        levels = () if limit is None else (Mark(_("limit"), float(limit.x.sd[i]), "orange", "dash"),)
        panels.append(_sd(over.t, over.x.sd[:, i], found.truth.states[i], found.truth.units[i], levels))
    for j in inputs:
        levels = () if limit is None else (Mark(_("limit"), float(limit.u.sd[j]), "orange", "dash"),)
        panels.append(_sd(over.t, over.u.sd[:, j], found.inputs[j], "", levels))
    return Drawing(_("Standard deviations in the loop"), "t, s", tuple(panels), verbatim=True)


def _sd(t: Array, sd: Array, name: str, unit: str, levels: tuple[Mark, ...]) -> Panel:
    curve = Curve(_("standard deviation"), t, sd, "blue", "line", unit)
    return Panel(labelled(fill("σ({name})", name=name), unit), (curve,), kind="size", levels=levels)


def step(found: Regulated, response: Response) -> Drawing:
    """The output that follows a set point, the other measurements, and the inputs."""
    names = found.truth.measurements
    units = found.file.measurement_units
    order = [i for i in (names.index(response.name),) if i < len(names)] if response.name in names else []
    order += [i for i in range(len(names)) if i not in order]
    panels = [
        _signal(response.t, response.z[:, i], names[i], units[i], (Mark(_("set point"), response.size, "orange", "dash"),) if names[i] == response.name else ())
        for i in order[:SHOWN]
    ]
    return Drawing(_("Step of a set point"), "t, s", (*panels, *_inputs(found, response)), verbatim=True)


def motion(found: Regulated, response: Response) -> Drawing:
    """States and inputs of one response."""
    states = zip(found.truth.states[:SHOWN], found.truth.units, strict=False)
    panels = [_signal(response.t, response.x[:, i], name, unit) for i, (name, unit) in enumerate(states)]
    return Drawing(_("Motion of the loop"), "t, s", (*panels, *_inputs(found, response)), verbatim=True)


def _inputs(found: Regulated, response: Response) -> list[Panel]:
    return [_signal(response.t, response.u[:, j], name, "", colour="green") for j, name in enumerate(found.inputs[:SHOWN])]


def _signal(t: Array, values: Array, name: str, unit: str, levels: tuple[Mark, ...] = (), colour: str = "blue") -> Panel:
    curve = Curve(_("input") if colour == "green" else _("response"), t, values, colour, "line", unit)
    return Panel(labelled(name, unit), (curve,), levels=levels or (Mark("", 0.0, "grey", "line", 0.8),))


def kicked(found: Regulated, shown: Sequence[int]) -> Drawing:
    """The answers of some states, and of the inputs, to one kick of each noise."""
    responses = found.kicks.value
    looks = list(zip(responses, line_styles(len(responses)), strict=True))
    panels = []
    zero = (Mark("", 0.0, "grey", "line", 0.8),)
    for i in shown:
        name, unit = found.truth.states[i], found.truth.units[i]
        curves = tuple(Curve(each.name, each.t, each.x[:, i], colour, style, unit) for each, (colour, style) in looks)
        panels.append(Panel(labelled(name, unit), curves, levels=zero))
    for j, name in enumerate(found.inputs[:SHOWN]):
        curves = tuple(Curve(each.name, each.t, each.u[:, j], colour, style) for each, (colour, style) in looks)
        panels.append(Panel(name, curves, levels=zero))
    return Drawing(_("One kick of each noise"), "t, s", tuple(panels), verbatim=True)


def shares(parts: Mapping[str, float], label: str) -> Drawing:
    """Shares of a cost as bars; ``label`` says what it is counted by."""
    places = np.arange(len(parts))
    bars = Curve(_("share of the cost"), places, list(parts.values()), "blue", "bars")
    panel = Panel(label, (bars,), kind="count")
    return Drawing(_("Where the cost comes from"), "", (panel,), ticks=tuple(parts), verbatim=True)


def tradeoff(found: Regulated, state: int, u: int = 0) -> Drawing:
    """σ of a state against σ of an input as the weight of the inputs changes; the regulator's own place is marked."""
    family: Tradeoff = found.tradeoff.value
    name, unit = found.truth.states[state], found.truth.units[state]
    here = int(np.argmin(np.abs(np.log(family.values))))
    curves = (
        Curve(_("other weights of the inputs"), family.u_rms[:, u], family.x_rms[:, state], "blue", "line", unit),
        Curve(_("this regulator"), family.u_rms[here : here + 1, u], family.x_rms[here : here + 1, state], "orange", "points", unit, size=9),
    )
    panel = Panel(labelled(fill("σ({name})", name=name), unit), curves, kind="count")
    return Drawing(_("What quiet states cost in inputs"), fill("σ({name})", name=found.inputs[u]), (panel,), verbatim=True)


def periods(found: Regulated) -> Drawing:
    """The cost per second against the period."""
    family: Periods = found.periods.value
    here = int(np.argmin(np.abs(np.log(family.values / found.regulator.plant.dt))))
    curves = (
        Curve(_("optimal for each period"), family.values, family.cost, "blue", "line"),
        Curve(_("this regulator"), family.values[here : here + 1], family.cost[here : here + 1], "orange", "points", size=9),
    )
    return Drawing(_("What slow sampling costs"), _("period, s"), (Panel(_("cost per second"), curves, kind="count"),), log=True)


def opened(found: Regulated) -> Drawing:
    """The loop opened at its one input: magnitude and phase, with the place of the phase margin.

    Raises
    ------
    ValueError
        Several inputs; scheduled gains.
    """
    if found.truth.r != 1 or found.regulator.steps is not None:
        msg = "the frequency response of the opened loop is drawn for one input and constant gains"
        raise ValueError(msg)
    plant, M = found.truth, found.regulator.machine
    omega = np.geomspace(1e-4, 1, POINTS) * np.pi / plant.dt
    z = np.exp(1j * omega * plant.dt)

    def answer(A: Array, B: Array, C: Array, D: Array | None) -> Array:
        values = np.array([C @ np.linalg.solve(each * np.eye(len(A)) - A, B.astype(complex)) for each in z])
        return values if D is None else values + D

    assert plant.B is not None
    rest = [i for i in range(plant.n) if i not in found.regulator.loads]
    through = answer(plant.Phi[np.ix_(rest, rest)], plant.B[rest], plant.H[:, rest], plant.D)
    loop = (answer(M.A, M.B, -M.C, -M.D) @ through)[:, 0, 0]
    marks = {}
    if found.margins and np.isfinite(at := found.margins.value.inputs["u"].crossover):
        marks = {_("crossover"): float(at)}
    return frequency.bode({_("opened loop"): loop}, omega, marks=marks)


def many(found: Regulated, shown: Sequence[int]) -> Drawing:
    """RMS of some of (x, integrals, u) over the runs, and in theory."""
    runs: LoopEnsemble = found.ensemble.value
    t = found.over.value.t
    units = (*found.truth.units, *[""] * len(runs.names))
    panels = []
    for i in shown:
        name = _signal_name(found, i, runs)
        unit = units[i] if i < found.truth.n else ""
        curves = (
            Curve(_("ensemble"), t, runs.rms[:, i], "blue", "points", unit),
            Curve(_("theory"), t, runs.theory.rms[:, i], "black", "line", unit),
        )
        panels.append(Panel(labelled(fill(_("RMS of {name}"), name=name), unit), curves, kind="size"))
    return Drawing(_("Many runs of the loop"), "t, s", tuple(panels), verbatim=True)


def _signal_name(found: Regulated, i: int, runs: LoopEnsemble) -> str:
    """Of an element of (x, q, u), inputs by the names of the file."""
    first = len(runs.names) - found.truth.r
    return runs.names[i] if i < first else found.inputs[i - first]


def schedule(found: Regulated) -> Drawing:
    """The gains over a finite horizon, one panel for each input."""
    L = found.regulator.L
    t = found.truth.dt * np.arange(len(L))
    names = found.regulator.design.states
    panels = [
        Panel(
            fill(_("gains of {name}"), name=name),
            tuple(Curve(state, t, L[:, j, i], *look) for i, (state, look) in enumerate(zip(names, line_styles(len(names)), strict=True))),
        )
        for j, name in enumerate(found.inputs[:SHOWN])
    ]
    return Drawing(_("Scheduled gains"), "t, s", tuple(panels), verbatim=True)
