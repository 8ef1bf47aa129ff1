"""The pictures of an experiment, by the plotting functions of the reports."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from ctlabs.reporting import plots
from ctlabs.reporting.plots import Figure, studies
from ctlabs.studies import common
from ctlabs.text import fill
from ctlabs.workbench.outcomes import Outcome


class Drawing(NamedTuple):
    """How a picture is drawn, and its caption with the words that are put into it."""

    draw: Callable[[], Figure]
    caption: str
    words: Mapping[str, object] = MappingProxyType({})


def figures(found: Outcome) -> dict[str, str]:
    """The pictures that there are, and what each shows."""
    return {name: fill(caption, **words) for name, (_, caption, words) in drawings(found).items()}


def drawings(found: Outcome) -> dict[str, Drawing]:
    """How each picture is drawn, and its caption."""
    shown = range(min(len(found.states), common.SHOWN))
    made: dict[str, Drawing] = {}
    for i in shown:
        made[f"estimates_{i + 1}"] = Drawing(
            partial(_estimates, found, i),
            "The first run: estimate of {state} with its ±σ band.",
            {"state": found.states[i]},
        )
    if found.statistics is not None:
        for i in shown:
            made[f"errors_{i + 1}"] = Drawing(
                partial(_errors, found, i),
                "RMS error of {state} over {runs} runs against theory.",
                {"state": found.states[i], "runs": str(found.statistics.runs)},
            )
        made["nees"] = Drawing(
            partial(_consistency, found),
            "NEES and NIS averaged over the runs, and what is expected of a right model.",
        )
    made["gain"] = Drawing(partial(_gain, found), "The gain.")
    made["innovations"] = Drawing(
        partial(_innovations, found),
        "Innovations in their ±2σ band, and the NIS in the band of 95 %.",
    )
    if found.verdict is not None and found.verdict.lags.size:
        made["autocorrelation"] = Drawing(
            partial(_correlation, found),
            "Autocorrelation of the standardised innovations; those of a right model are white.",
        )
    if len([each for each in found.algorithms if not each.failed and each.error_P is not None]) > 1:
        made["algorithms"] = Drawing(
            partial(_accuracy, found), "The algorithms against 50 digits, and their operations."
        )
    return made


def _estimates(found: Outcome, i: int) -> Figure:
    j = found.measured[i]
    curves = {"estimate": (found.x_plus[:, i, 0], found.sd_plus[:, i])}
    if found.smoothed is not None and found.smoothed_sd is not None:
        curves["smoothed"] = (found.smoothed[:, i], found.smoothed_sd[:, i])
    return studies.estimates(
        found.t,
        curves,
        data=None if j < 0 else found.z[:, j, 0],
        truth=None if found.truth is None else found.truth[:, i, 0],
        ylabel=common.label(found.states[i], found.units[i]),
    )


def _errors(found: Outcome, i: int) -> Figure:
    assert found.statistics is not None
    theory = found.sd_plus if found.actual_rms is None else found.actual_rms
    curves = {"theory": theory[:, i]}
    if found.actual_rms is not None and found.optimal_sd is not None:
        curves |= {"claimed": found.sd_plus[:, i], "optimal": found.optimal_sd[:, i]}
    low, high = found.statistics.rms_band[:, :, i]
    straight = {"95 % of ensembles": (found.t, low), "": (found.t, high)} if found.actual_rms is None else None
    ylabel = common.label(f"RMS error of {found.states[i]}", found.units[i])
    few = slice(None, None, -(-len(found.t) // 100))
    points = {f"{found.statistics.runs} runs": (found.t[few], found.statistics.rms[few, i])}
    log = common.wide(*curves.values())
    return plots.lines(found.t, curves, xlabel="t, s", ylabel=ylabel, straight=straight, points=points, log=log)


def _consistency(found: Outcome) -> Figure:
    assert found.statistics is not None
    own = found.statistics
    curves = {"NEES": own.nees, "NIS": own.nis}
    expected = {"expected": (found.t, np.where(own.nees_dof > 0, own.nees_dof, np.nan))}
    expected[""] = (found.t, np.where(own.nis_dof > 0, own.nis_dof, np.nan))
    return plots.lines(found.t, curves, xlabel="t, s", ylabel="average over the runs", straight=expected)


def _gain(found: Outcome) -> Figure:
    curves = {
        common.label(state if len(found.measurements) == 1 else f"{state} ← {measurement}"): found.K[:, i, j]
        for i, state in enumerate(found.states[: common.SHOWN])
        for j, measurement in enumerate(found.measurements[: common.SHOWN])
    }
    return plots.lines(found.t, curves, xlabel="t, s", ylabel="gain K")


def _innovations(found: Outcome) -> Figure:
    pairs = zip(found.measurements, found.measurement_units, strict=True)
    labels = [common.label(f"innovation of {name}", unit) for name, unit in pairs]
    return plots.innovations(
        found.t,
        found.innovation[:, :, 0],
        found.innovation_sd,
        found.nis[:, 0],
        found.nis_dof,
        xlabel="t, s",
        labels=labels,
    )


def _correlation(found: Outcome) -> Figure:
    assert found.verdict is not None
    own, curves = found.verdict, {}
    for name, r, band in zip(found.measurements, own.correlation, own.band, strict=True):
        tested = np.isfinite(r)
        if tested.any():
            curves[common.label(name)] = (own.lags[tested], r[tested], band[tested])
    return plots.autocorrelation(curves)


def _accuracy(found: Outcome) -> Figure:
    worked = [each for each in found.algorithms if not each.failed and each.error_P is not None]
    return studies.accuracy(
        [each.name for each in worked],
        np.array([each.error_P for each in worked], dtype=np.float64),
        np.array([each.error_x for each in worked], dtype=np.float64),
        [each.flops or 0 for each in worked],
    )
