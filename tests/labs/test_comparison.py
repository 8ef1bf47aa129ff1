"""What labs compare: each verb passes for what is right and notices what is wrong by 5 %."""

import math

import numpy as np
import pytest

from ctlabs import ContinuousModel, DiscreteModel, discretise
from ctlabs.filtering import reduced
from ctlabs.labs.comparison import LONGEST, fine, same_as_whole, same_estimates, taken_for_white
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.reporting.params import LabParameters
from ctlabs.reporting.report import Report

META = {"name": "task99", "title": "A test", "source": "A book", "parts": ["a"]}
WIENER = ContinuousModel(F=[[0]], G=[[1]], Q=[[4]], H=[[1]], Rc=[[16]], P0=[[25]])
#: A signal in coloured noise, nothing white: x1' = −x1 + w1, x2' = −2 x2 + w2, z = x1 + x2.
COLOURED = discretise(
    ContinuousModel(
        F=[[-1, 0], [0, -2]], G=np.eye(2), Q=[[2, 0], [0, 1]], H=[[1, 1]], P0=[[1, 0], [0, 0.25]], states=["s", "n"]
    ),
    0.5,
    R=[[0]],
)


@pytest.fixture
def report() -> Report:
    made = Report(META, LabParameters(), runs=50, seed=1)
    made.section("a", "First part")
    return made


@pytest.mark.parametrize(("dt", "steps", "scale"), [(1.0, 20, 2.0), (0.3, 7, 5.0), (1.0, 400, 0.5), (0.01, 30, 2.0)])
def test_a_fine_model_has_a_hundred_periods_in_a_time_constant(dt: float, steps: int, scale: float) -> None:
    """δ divides dt, is at most a hundredth of the time constant and at most dt; the horizon is that of the sampled filter."""
    found = fine(WIENER, dt, steps, scale)
    assert found.model.dt == dt / found.ratio
    assert found.model.dt <= min(dt, scale / 100) * (1 + 1e-12)
    assert found.model.dt > scale / 100 / 2 or found.ratio == 1 or dt / (found.ratio - 1) > scale / 100
    assert found.steps == min(found.ratio * steps, LONGEST)
    assert np.allclose(found.model.R, 16 / found.model.dt)


def test_both_filters_see_one_path() -> None:
    """The sampled filter measures at every ratio-th instant only, with the variance of its own period."""
    close, sampled = fine(WIENER, 1.0, 20, 2.0), discretise(WIENER, 1.0)
    runs = close.one_path(Experiment(runs=1, seed=3), sampled)
    assert list(runs) == ["continuous", "sampled"]
    assert np.array_equal(runs["continuous"].truth, runs["sampled"].truth)
    entered = np.flatnonzero(runs["sampled"].used.any(axis=1))
    assert np.array_equal(entered, np.arange(50, 1001, 50))
    own = covariances(sampled, 20)
    assert np.allclose(runs["sampled"].P_plus[::50], own.P_plus, rtol=1e-9)


def test_a_horizon_shorter_than_a_period_has_no_sampled_filter() -> None:
    """Nothing would be measured."""
    close = fine(WIENER, 1000.0, 1, 2.0)
    assert (close.ratio, close.steps) == (50000, LONGEST)
    assert list(close.one_path(Experiment(runs=1, seed=3), discretise(WIENER, 1000.0))) == ["continuous"]


@pytest.mark.parametrize(("factor", "passes"), [(1.0, True), (1.05, False)])
def test_a_reduced_filter_is_the_whole_one(report: Report, factor: float, passes: bool) -> None:
    """Covariances, gains and the variance by hand; the last is noticed where it is wrong by 5 %."""
    small = reduced.discrete(COLOURED, keep=["s"], first=0)
    own = covariances(COLOURED, 6, first=0)
    full = same_as_whole(report, small, COLOURED, 6, factor * own.P_plus[:, 0, 0])
    same_estimates(report, Experiment(runs=50, seed=1), small, COLOURED, 6)
    assert np.array_equal(full.P_plus, own.P_plus)
    verdicts = {check.name: check.passed for check in report.checks}
    assert verdicts == {
        "P⁺ of the reduced filter": True,
        "gains of the reduced filter": True,
        "P* = diag(0, p)": passes,
        "estimates of 25 runs": True,
    }


@pytest.mark.parametrize(("factor", "passes"), [(1.0, True), (1.05, False)])
def test_noise_taken_for_white(report: Report, factor: float, passes: bool) -> None:
    """By hand the error is that of e(i) = (1−K)a e(i−1) − (1−K)w + K n with the noise n, which has the factor b."""
    a, b = np.diagonal(COLOURED.Phi)
    q, r = COLOURED.Qd[0, 0], 0.25

    def by_hand(K: float) -> float:
        c = (1 - K) * a
        return factor * ((1 - K) ** 2 * q + K**2 * r * (1 + c * b) / (1 - c * b)) / (1 - c**2)

    design = DiscreteModel([[a]], [[q]], [[1]], [[r]], P0=[[1]], dt=0.5, states=["s"])
    best = float(covariances(COLOURED, 60, first=0).P_plus[-1, 0, 0])
    found = taken_for_white(
        report, Experiment(runs=50, seed=1), COLOURED, design, 10, by_hand=by_hand, best=best, size=best
    )
    first, *others = report.checks
    assert first.passed == passes
    assert all(check.passed for check in others)
    assert math.isclose(found.true, by_hand(found.gain) / factor, rel_tol=1e-8)
    assert found.claimed < best < found.true
