"""Monte-Carlo experiments: a truth, a filter, and what the errors of many runs say.

:func:`monte_carlo` gives statistics without storing histories, :func:`simulate` the histories of a truth, :func:`sweep` the
statistics over a grid of parameters; :mod:`chance` says whether an ensemble agrees with theory.
"""

from __future__ import annotations

from ctlabs.filtering.extended import EnsembleFilter
from ctlabs.montecarlo import chance
from ctlabs.montecarlo.blocks import BlockFailed, Interrupted
from ctlabs.montecarlo.executors import Team, team
from ctlabs.montecarlo.histogram import Bins, Histogram
from ctlabs.montecarlo.runner import monte_carlo
from ctlabs.montecarlo.simulation import Simulation, simulate
from ctlabs.montecarlo.statistics import Statistics
from ctlabs.montecarlo.sweeps import Sweep, sweep

__all__ = [
    "Bins",
    "BlockFailed",
    "EnsembleFilter",
    "Histogram",
    "Interrupted",
    "Simulation",
    "Statistics",
    "Sweep",
    "Team",
    "chance",
    "monte_carlo",
    "simulate",
    "sweep",
    "team",
]
