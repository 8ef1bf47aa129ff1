"""Figures: pure functions from arrays and labels to a matplotlib ``Figure``.

No pyplot, no global state: the style file is applied while a figure is built. Legends stand outside the axes, so they
never cover data. Every axis has a label with its unit; captions belong to the report.
"""

from matplotlib.figure import Figure

from ctlabs.plots.base import lines, styled
from ctlabs.plots.circuits import ladder
from ctlabs.plots.continuous import ensemble_log, estimates, gains, sampled, transient
from ctlabs.plots.diagrams import Arrow, Node, block_diagram
from ctlabs.plots.fields import animation, errors_by_noise, gain_rows, maps, surface
from ctlabs.plots.filters import ensemble_against_theory, errors, record, sawtooth
from ctlabs.plots.frequency import bode, poles, response
from ctlabs.plots.records import autocorrelation, innovations, likelihood_profiles, measured
from ctlabs.plots.sweeps import pairs, sweep

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
