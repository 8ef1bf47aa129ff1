"""Figures: pure functions from arrays and labels to a :class:`~ctlabs.reporting.drawing.Drawing`, or to a matplotlib ``Figure``.

No pyplot, no global state: the style file is applied while a figure is built. Legends stand outside the axes, so they
never cover data. Every axis has a label with its unit; captions belong to the report. What is named here is loaded when it is first
used, and matplotlib by what draws with it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ctlabs._front import front

if TYPE_CHECKING:
    from ctlabs.reporting.plots.base import lines, styled
    from ctlabs.reporting.plots.circuits import ladder
    from ctlabs.reporting.plots.continuous import ensemble_log, estimates, gains, sampled, transient
    from ctlabs.reporting.plots.diagrams import Arrow, Node, block_diagram
    from ctlabs.reporting.plots.fields import animation, errors_by_noise, gain_rows, maps, surface
    from ctlabs.reporting.plots.filters import ensemble_against_theory, errors, record, sawtooth
    from ctlabs.reporting.plots.frequency import bode, poles, response
    from ctlabs.reporting.plots.records import autocorrelation, innovations, likelihood_profiles
    from ctlabs.reporting.plots.sweeps import pair_maps, pairs, sweep

_HOME = {
    "Arrow": "diagrams",
    "Node": "diagrams",
    "animation": "fields",
    "autocorrelation": "records",
    "block_diagram": "diagrams",
    "bode": "frequency",
    "ensemble_against_theory": "filters",
    "ensemble_log": "continuous",
    "errors": "filters",
    "errors_by_noise": "fields",
    "estimates": "continuous",
    "gain_rows": "fields",
    "gains": "continuous",
    "innovations": "records",
    "ladder": "circuits",
    "likelihood_profiles": "records",
    "lines": "base",
    "maps": "fields",
    "pair_maps": "sweeps",
    "pairs": "sweeps",
    "poles": "frequency",
    "record": "filters",
    "response": "frequency",
    "sampled": "continuous",
    "sawtooth": "filters",
    "styled": "base",
    "surface": "fields",
    "sweep": "sweeps",
    "transient": "continuous",
}

__all__ = [
    "Arrow",
    "Node",
    "animation",
    "autocorrelation",
    "block_diagram",
    "bode",
    "ensemble_against_theory",
    "ensemble_log",
    "errors",
    "errors_by_noise",
    "estimates",
    "gain_rows",
    "gains",
    "innovations",
    "ladder",
    "likelihood_profiles",
    "lines",
    "maps",
    "pair_maps",
    "pairs",
    "poles",
    "record",
    "response",
    "sampled",
    "sawtooth",
    "styled",
    "surface",
    "sweep",
    "transient",
]

__getattr__ = front(__name__, _HOME)
