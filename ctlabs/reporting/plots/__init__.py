"""Figures: pure functions from arrays and labels to a matplotlib ``Figure``.

No pyplot, no global state: the style file is applied while a figure is built. Legends stand outside the axes, so they
never cover data. Every axis has a label with its unit; captions belong to the report.
"""

from matplotlib.figure import Figure

from ctlabs.reporting.plots.base import lines, styled
from ctlabs.reporting.plots.circuits import ladder
from ctlabs.reporting.plots.continuous import ensemble_log, estimates, gains, sampled, transient
from ctlabs.reporting.plots.diagrams import Arrow, Node, block_diagram
from ctlabs.reporting.plots.fields import animation, errors_by_noise, gain_rows, maps, surface
from ctlabs.reporting.plots.filters import ensemble_against_theory, errors, record, sawtooth
from ctlabs.reporting.plots.frequency import bode, poles, response
from ctlabs.reporting.plots.records import autocorrelation, innovations, likelihood_profiles, measured
from ctlabs.reporting.plots.sweeps import pairs, sweep

__all__ = [
    "Arrow",
    "Figure",
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
    "measured",
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
