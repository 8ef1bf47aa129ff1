"""Experiments of a lab: the same numbers for the same seed, other numbers for another seed or stream."""

from pathlib import Path

import numpy as np
import pytest

from ctlabs import montecarlo
from ctlabs.labs.experiment import Experiment, filtered
from ctlabs.models import DiscreteModel
from tests.reference import EXACT, close

TRUTH = DiscreteModel(Phi=[[0.9]], Qd=[[0.4]], H=[[1]], R=[[0.5]], x0=[0], P0=[[1]], dt=1, units=["m"])
DESIGN = DiscreteModel(Phi=[[0.9]], Qd=[[0.1]], H=[[1]], R=[[0.5]], x0=[0], P0=[[1]], dt=1, units=["m"])


def test_the_defaults_are_1000_runs_and_seed_1():
    """A lab that says nothing gets the command line's defaults."""
    assert (Experiment().runs, Experiment().seed) == (1000, 1)


def test_statistics_have_the_runs_of_the_experiment():
    """The number of runs is the experiment's, the number of steps the lab's."""
    stats = Experiment(runs=30, seed=4).statistics(TRUTH, steps=6)
    assert (stats.runs, len(stats.t)) == (30, 7)


def test_the_same_seed_gives_the_same_numbers():
    """Bit by bit; another seed or another stream gives other numbers."""
    first = Experiment(30, 4).statistics(TRUTH, steps=6)
    assert np.array_equal(Experiment(30, 4).statistics(TRUTH, steps=6).rms, first.rms)
    assert not np.isclose(Experiment(30, 5).statistics(TRUTH, steps=6).rms, first.rms).any()
    assert not np.isclose(Experiment(30, 4).statistics(TRUTH, steps=6, stream=1).rms, first.rms).any()


def test_seeds_of_streams_do_not_meet():
    """Stream 1 of seed 1 is neither seed 2 nor stream 0 of any seed nearby."""
    seeds = {Experiment(1, seed).seed_of(stream) for seed in range(50) for stream in range(20)}
    assert len(seeds) == 1000


def test_filters_are_compared_on_the_same_data():
    """Two designs get the same truth and measurements: with equal designs the statistics are equal."""
    experiment = Experiment(30, 4)
    optimal, other = (experiment.histories(TRUTH, design, steps=6, runs=5) for design in (None, DESIGN))
    assert np.array_equal(optimal.truth, other.truth)
    assert np.array_equal(optimal.z, other.z, equal_nan=True)
    assert not np.isclose(optimal.x_plus[1:], other.x_plus[1:]).any()
    assert np.array_equal(experiment.statistics(TRUTH, TRUTH, steps=6).rms, experiment.statistics(TRUTH, steps=6).rms)


def test_histories_are_the_filter_of_the_design_on_data_of_the_truth():
    """The estimates are those that the filter makes of the measurements shown."""
    found = Experiment(30, 4).histories(TRUTH, DESIGN, steps=6, runs=5)
    again = filtered(DESIGN, found.z[1:])
    assert found.truth.shape == (7, 1, 5)
    assert np.array_equal(found.x_plus, again.x_plus)
    assert close(found.error("plus"), again.x_plus - found.truth, EXACT)


@pytest.mark.parametrize("first", [0, 1])
def test_histories_begin_to_measure_where_asked(first):
    """With first=0 the row t0 is measured, with first=1 it is not."""
    found = Experiment(30, 4).histories(TRUTH, steps=6, runs=5, first=first)
    assert np.isnan(found.z[0]).all() == bool(first)
    assert not np.isnan(found.z[1:]).any()
    assert (found.K[0] == 0).all() == bool(first)


def test_histories_and_statistics_are_of_the_same_runs():
    """The runs that a figure shows are the first of those that were counted."""
    experiment = Experiment(runs=5, seed=4)
    e = experiment.histories(TRUTH, steps=6, runs=5).error("plus")
    assert close(experiment.statistics(TRUTH, steps=6).bias, e.mean(axis=-1), 1e-10)


def test_options_are_passed_to_the_experiment(monkeypatch):
    """Workers and checkpoints are the caller's business, steps and design the lab's."""
    calls = []
    monkeypatch.setattr(montecarlo, "monte_carlo", lambda *arguments, **named: calls.append((arguments, named)))
    experiment = Experiment(30, 4, workers=2, checkpoint=Path("kept"))
    experiment.statistics(TRUTH, DESIGN, steps=6, first=0)
    experiment.statistics(TRUTH, steps=6)
    common = {"steps": 6, "runs": 30, "seed": experiment.seed_of(0), "executor": None, "workers": 2}
    assert calls == [
        ((TRUTH, DESIGN), {**common, "checkpoint": Path("kept/000"), "first": 0, "algorithm": "filterpy"}),
        ((TRUTH, None), {**common, "checkpoint": Path("kept/001"), "algorithm": "filterpy"}),
    ]


def test_a_crew_is_shared_by_all_ensembles_and_changes_no_number():
    """Workers are started once; the numbers are those of an experiment without a crew."""
    experiment = Experiment(30, 4, workers=2)
    with experiment.with_workers() as own:
        assert isinstance(own.executor, montecarlo.Team)
        assert np.array_equal(own.statistics(TRUTH, steps=6).rms, experiment.statistics(TRUTH, steps=6).rms)
