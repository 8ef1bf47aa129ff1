"""What an experiment's figures show: the same :class:`~ctlabs.reporting.drawing.Drawing` for pages, pictures and reports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ctlabs.linalg.checks import Array
from ctlabs.reporting import levels
from ctlabs.reporting.drawing import Band, Curve, Drawing, Panel, finite, labelled, line_styles, plain
from ctlabs.reporting.plots import records, studies
from ctlabs.text import fill, number, squared
from ctlabs.workbench.help import help_for

if TYPE_CHECKING:
    from ctlabs.workbench.runs.outcomes import Outcome

#: States and measurements of which an export has pictures.
SHOWN = 6


def pictures(found: Outcome) -> dict[str, tuple[Drawing, str]]:
    """The pictures of an experiment, each with its caption."""
    states = range(min(len(found.states), SHOWN))
    made: dict[str, tuple[Drawing, str]] = {}
    for i in states:
        caption = fill("The first run: estimate of {state} with its ±σ band.", state=found.states[i])
        made[f"estimates_{i + 1}"] = estimates(found, [i]), caption
    if found.statistics is not None:
        runs = f"{found.statistics.runs} runs"
        for i in states:
            caption = fill("RMS error of {state} over {runs} against theory.", state=found.states[i], runs=runs)
            made[f"errors_{i + 1}"] = accuracy(found, [i]), caption
        made["nees"] = consistency(found), "NEES and NIS averaged over the runs, and what is expected of a right model."
    made["gain"] = gains(found, states), "The gain."
    innovation = innovations(found, range(len(found.measurements)))
    both = Drawing(innovation.name, innovation.label, (*innovation.panels, *nis(found).panels), verbatim=True)
    made["innovations"] = both, "Innovations and the NIS in their bands of 95 %."
    if found.verdict is not None and found.verdict.lags.size:
        made["autocorrelation"] = whiteness(found), "Autocorrelation of the standardised innovations; those of a right model are white."
    judged = [each for each in found.algorithms if not each.failed and each.error_P is not None]
    if len(judged) > 1:
        made["algorithms"] = studies.algorithms(judged), "The algorithms against 50 digits, and their operations."
    return {name: (levels.level(drawing), caption) for name, (drawing, caption) in made.items()}


def estimates(found: Outcome, states: Sequence[int], run: int = 0) -> Drawing:
    """Truth, measurement and estimate of a run with its ±σ; of data also the smoothed estimate; other algorithms on request."""
    panels = []
    own, others = _by(found.algorithm), list(found.estimates)[1:] if run == 0 else []
    name = f"estimate, {own}" if len(found.estimates) > 1 else "estimate"
    for i in states:
        unit = found.units[i]
        curves = {name: (found.x_plus[:, i, run], found.sd_plus[:, i])}
        if found.smoothed is not None and found.smoothed_sd is not None:
            curves["smoothed"] = found.smoothed[:, i], found.smoothed_sd[:, i]
        panel = studies.estimates_panel(
            found.t,
            curves,
            labelled(found.states[i], unit),
            unit,
            data=measurements(found, i, run),
            truth=None if found.truth is None else found.truth[:, i, run],
            others=[
                Curve(f"estimate, {_by(other)}", found.t, found.estimates[other][:, i], colour, style, unit, hidden=True)
                for other, (colour, style) in zip(others, line_styles(len(others), 3), strict=True)
            ],
        )
        beside = studies.residual_panel(panel, name, labelled(f"{found.states[i]}, less its estimate", unit), unit)
        panels += [panel] if beside is None else [panel, beside]
    return _over_time("Measurement and estimate" if found.truth is None else "Truth, measurement, estimate", panels)


def measurements(found: Outcome, state: int, run: int = 0) -> dict[str, Array]:
    r"""What each measurement tells of a state, in the state's unit: :math:`(z_j-\sum_{l\ne i}h_{jl}\hat x_l)/h_{ji}`, by its name.

    A measurement of the state alone is its value, divided by the factor; of others too, their estimates are taken out of it.
    """
    if found.H is None:  # kept before there was one
        j = found.measured[state]
        return {} if j < 0 else {"measurement": found.z[:, j, run]}
    H = np.broadcast_to(found.H, (len(found.t), *found.H.shape[-2:]))
    told: dict[str, Array] = {}
    for j in np.flatnonzero((H[:, :, state] != 0).any(axis=0)).tolist():
        h, x = H[:, j], found.x_plus[:, :, run]
        mixed = bool((np.delete(h, state, axis=1) != 0).any())
        own = np.where(h[:, state] != 0, h[:, state], np.nan)
        rest = np.einsum("ki,ki->k", np.where(np.arange(h.shape[1]) == state, 0.0, h), np.where(h != 0, x, 0.0)) if mixed else 0.0
        words = ", less the other states" if mixed else "" if (h[:, state] == 1).all() else ", as this state"
        told[f"{found.measurements[j]}{words}"] = (found.z[:, j, run] - rest) / own
    alone = len(told) == 1 and next(iter(told)) in found.measurements
    return {"measurement": next(iter(told.values()))} if alone else {f"measured: {name}": z for name, z in told.items()}


def _by(algorithm: str) -> str:
    """A form of the filter, as people call it."""
    return help_for(f"algorithm.{algorithm}").title


def errors(found: Outcome, states: Sequence[int]) -> Drawing:
    """Errors of the shown runs inside the bands of σ and 2σ that the filter claims."""
    assert found.errors is not None
    panels = []
    for i in states:
        unit, sd = found.units[i], finite(found.sd_plus[:, i])
        bands = (
            Band("±2σ", found.t, -2 * sd, 2 * sd, "orange", unit, frame=True),
            Band("±σ", found.t, -sd, sd, "orange", unit),
        )
        runs = found.errors.shape[2]
        curves = [
            Curve(f"run {r + 1}", found.t, found.errors[:, i, r], ("black", "blue", "green")[r % 3], "line", unit, sd if r == 0 else None)
            for r in reversed(range(runs))
        ]  # fmt: skip
        panels.append(Panel(f"error of {labelled(found.states[i], unit)}", tuple(curves), bands, "signed"))
    return _over_time("Errors of single runs", panels)


def accuracy(found: Outcome, states: Sequence[int]) -> Drawing:
    """RMS error over all runs against what theory and the filter say."""
    stats = found.statistics
    assert stats is not None
    actual, panels = found.actual_rms, []
    for i in states:
        unit = found.units[i]
        claimed = finite(found.sd_plus[:, i])
        style = "points" if len(found.t) <= studies.MARKED else "line"
        curves = [Curve(f"RMS of {stats.runs} runs", found.t, stats.rms[:, i], "black", style, unit)]
        if actual is None:
            curves.append(Curve("theory σ", found.t, claimed, "blue", "line", unit))
        else:
            curves.append(Curve("theory of this filter", found.t, actual[:, i], "blue", "line", unit))
            curves.append(Curve("what the filter claims", found.t, claimed, "orange", "dash", unit))
        if found.optimal_sd is not None:
            curves.append(Curve("the right filter", found.t, found.optimal_sd[:, i], "green", "dot", unit))
        band = Band("95 % of such ensembles", found.t, stats.rms_band[0][:, i], stats.rms_band[1][:, i], "blue", unit)
        panels.append(Panel(labelled(found.states[i], unit), tuple(curves), (band,), kind="size"))
    return _over_time("RMS error against theory", panels)


def bias(found: Outcome, states: Sequence[int]) -> Drawing:
    """Mean error over all runs, in the band of chance."""
    stats = found.statistics
    assert stats is not None
    panels = []
    for i in states:
        unit = found.units[i]
        curves = [Curve(f"mean of {stats.runs} runs", found.t, stats.bias[:, i], "black", "line", unit)]
        if found.actual_bias is not None:
            curves.append(Curve("theory of this filter", found.t, found.actual_bias[:, i], "blue", "dash", unit))
        band = Band("95 % of such ensembles", found.t, stats.bias_band[0][:, i], stats.bias_band[1][:, i], "blue", unit)
        panels.append(Panel(labelled(found.states[i], unit), tuple(curves), (band,), "signed"))
    return _over_time("Mean error", panels)


def consistency(found: Outcome) -> Drawing:
    """NEES and NIS averaged over all runs, in the bands of chance."""
    stats = found.statistics
    assert stats is not None
    panels = []
    for name, values, dof, band in (
        ("NEES", stats.nees, stats.nees_dof, stats.nees_band),
        ("NIS", stats.nis, stats.nis_dof, stats.nis_band),
    ):
        there = dof > 0
        if there.any():
            low, high = np.where(there, band[0], np.nan), np.where(there, band[1], np.nan)
            curves = (
                Curve("mean over the runs", found.t, np.where(there, values, np.nan), "black", "line", "1"),
                Curve("expected", found.t, np.where(there, dof, np.nan), "blue", "dash", "1"),
            )
            panels.append(Panel(f"{name}, 1", curves, (Band("95 % band", found.t, low, high),)))
    return _over_time("Size of errors and innovations", panels)


def gains(found: Outcome, states: Sequence[int]) -> Drawing:
    """The gain from every measurement to every estimate."""
    units = {found.states[i]: found.units[i] for i in states}
    sensors = dict(zip(found.measurements, found.measurement_units, strict=True))
    return studies.gains(found.t, found.K[:, list(states)], units, sensors)


def variances(found: Outcome, states: Sequence[int]) -> Drawing:
    """The sawtooth of P⁻ and P⁺ as the filter claims."""
    panels = []
    for i in states:
        unit, both = squared(found.units[i]), tuple(variance[:, i] for variance in found.variances)
        panels.append(studies.before_after(found.t, both[0], both[1], labelled(found.states[i], unit), unit, ("P⁻", "P⁺")))
    return _over_time("Variances before and after", panels)


def innovations(found: Outcome, measurements: Sequence[int], run: int = 0) -> Drawing:
    """Innovations of a run in the band that holds 95 % of them."""
    panels = []
    for j in measurements:
        unit = found.measurement_units[j]
        label = f"innovation of {labelled(found.measurements[j], unit)}"
        panels.append(records.innovation_panel(found.t, found.innovation[:, j, run], found.innovation_sd[:, j], label, unit))
    return _over_time("Innovations", panels)


def nis(found: Outcome, run: int = 0) -> Drawing:
    """The normalised innovations squared of a run in their 95 % band."""
    return _over_time("Normalised innovations squared", [records.nis_panel(found.t, found.nis[:, run], found.nis_dof)])


def whiteness(found: Outcome) -> Drawing:
    """Autocorrelations of the innovations of one record, with the band for white ones."""
    own = found.verdict
    assert own is not None
    rows = zip(found.measurements, own.correlation, own.band, strict=True)
    tested = {name: (own.lags, r, half) for name, r, half in rows if np.isfinite(r).any()}
    return replace(records.autocorrelation(tested), verbatim=True)


def side_by_side(first: tuple[str, Outcome], second: tuple[str, Outcome]) -> Drawing | None:
    """σ and RMS error of two experiments, for the states that both have by the same name and unit; ``None`` without any."""
    (_, a), (_, b) = first, second
    panels = []
    for i, (state, unit) in enumerate(zip(a.states, a.units, strict=True)):
        if (state, unit) not in zip(b.states, b.units, strict=True):
            continue
        j = list(b.states).index(state)
        curves = []
        for (name, found), index, colour in ((first, i, "blue"), (second, j, "orange")):
            curves.append(Curve(f"{name}: σ", found.t, finite(found.sd_plus[:, index]), colour, "line", unit))
            if found.statistics is not None:
                curves.append(Curve(f"{name}: RMS", found.t, found.statistics.rms[:, index], colour, "dot", unit))
        panels.append(Panel(labelled(state, unit), tuple(curves), kind="size"))
    return _over_time("Standard deviations and RMS errors of both", panels[:SHOWN]) if panels else None


def _over_time(name: str, panels: Sequence[Panel]) -> Drawing:
    return Drawing(name, "t, s", tuple(panels), verbatim=True)


def table(rows: Sequence[Sequence[object]]) -> str:
    """Rows with tabs between their cells, numbers with all digits: to be pasted into a spreadsheet."""
    return "\n".join("\t".join(_cell(value) for value in row) for row in rows)


def _cell(value: object) -> str:
    if isinstance(value, bool | np.bool_ | str) or value is None:
        return "" if value is None else " ".join(str(value).split())
    if isinstance(value, int | float | np.integer | np.floating):
        return str(int(value)) if isinstance(value, int | np.integer) else plain(float(value))
    return number(value, 17)
