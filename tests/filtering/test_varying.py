"""The Kalman–Bucy filter with matrices that vary: closed forms, the constant case, the transition, the gain's peak."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ctlabs.filtering import bucy, varying
from ctlabs.filtering.varying import VaryingModel
from ctlabs.models import ContinuousModel
from tests.reference import EXACT, SOLVER, broken, close

pytestmark = pytest.mark.numerical


def slope(R: float = 2.0, P0: float = 1.0) -> VaryingModel:
    """Lab 21: a constant slope in white noise."""
    return VaryingModel([[0]], [[1]], [[0]], lambda t: [[t]], [[R]], [[P0]])


@pytest.mark.parametrize(("R", "P0"), [(2.0, 1.0), (0.01, 1e4), (50.0, 1e-3)])
def test_information_of_a_slope_grows_like_the_cube_of_time(R, P0):
    """1/P = 1/P0 + t³/(3R), each value to 1e-9 of itself over five decades of time."""
    t = np.array([0.0, *np.geomspace(1e-2, 1e3, 25)])
    found = varying.transient(slope(R, P0), t)
    expected = 1 / (1 / P0 + t**3 / (3 * R))
    assert np.abs(found.P[:, 0, 0] / expected - 1).max() <= 1e-9
    assert close(found.K[:, 0, 0], expected * t / R, SOLVER)
    assert not close(broken(found.P[:, 0, 0]), expected, SOLVER)


def test_slope_transition_is_the_ratio_of_variances():
    """Without process noise and dynamics Ψ(t, 0) = P(t)/P0."""
    t = [0.5, 1.0, 10.0]
    assert close(varying.transition(slope(3, 4), t)[:, 0, 0], varying.transient(slope(3, 4), t).P[:, 0, 0] / 4, SOLVER)


@pytest.mark.parametrize(("R", "P0"), [(2.0, 1.0), (0.3, 7.0)])
def test_gain_of_a_slope_peaks_where_calculus_says(R, P0):
    """t³ = 3R/(2P0), K = 2P0 t/(3R), on a coarse grid whose points are elsewhere."""
    when = (1.5 * R / P0) ** (1 / 3)
    found = varying.gain_peak(slope(R, P0), np.linspace(0, 7.3 * when, 40))
    assert np.abs(np.array(found) / [when, 2 * P0 * when / (3 * R)] - 1).max() <= SOLVER


def test_a_gain_that_only_falls_peaks_at_the_start():
    """With constant H and no noise K = P/R is largest at the first time given."""
    model = VaryingModel([[0]], [[1]], [[0]], [[1]], [[2]], [[1]])
    when, gain = varying.gain_peak(model, [0.0, 1.0, 2.0])
    assert when == 0
    assert close(gain, 0.5, EXACT)


def test_constant_matrices_give_the_constant_filter():
    """P and the gain of bucy, and Ψ = e^(∫(F−KH)) in a model with two states and two measurements."""
    F, G, Q = [[0, 1], [-1, -0.2]], np.eye(2), [[1, 0.2], [0.2, 1]]
    H, Rc, P0 = [[1, 0], [1, 1]], [[0.5, 0.1], [0.1, 0.8]], [[4, 1], [1, 2]]
    t = [0.1, 1.0, 3.0]
    found = varying.transient(VaryingModel(F, G, Q, H, Rc, P0), t)
    expected = bucy.transient(ContinuousModel(F, G, Q, H, Rc=Rc, P0=P0), t)
    assert close(found.P, expected.P, SOLVER)
    assert close(found.K, expected.K, SOLVER)
    assert np.array_equal(found.P, np.swapaxes(found.P, 1, 2))
    assert not close(broken(expected.P), found.P, SOLVER)


def test_every_matrix_may_vary():
    """A change of the state's scale, y = c(t)x, and of the measurement's unit, leaves the filter what it was."""
    F, P0, t = 0.3, 2.0, np.array([0.4, 1.5])

    def c(now: float) -> float:
        return 2 + math.sin(now)

    plain = bucy.transient(ContinuousModel([[F]], [[1]], [[0.7]], [[1]], Rc=[[0.5]], P0=[[P0]]), t).P[:, 0, 0]
    scaled = VaryingModel(
        lambda s: [[F + math.cos(s) / c(s)]],
        lambda s: [[2 * c(s)]],
        lambda s: [[0.7 / 4]],
        lambda s: [[math.exp(s) / c(s)]],
        lambda s: [[0.5 * math.exp(2 * s)]],
        [[c(0) ** 2 * P0]],
    )
    found = varying.transient(scaled, t).P[:, 0, 0] / np.array([c(s) ** 2 for s in t])
    assert close(found, plain, SOLVER)
    assert not close(1.05 * found, plain, SOLVER)


def test_transition_of_an_unmeasured_state_is_that_of_the_system():
    """H = 0: Ψ = exp ∫F."""
    model = VaryingModel(lambda t: [[math.cos(t)]], [[1]], [[1]], [[0]], [[1]], [[1]])
    assert close(varying.transition(model, [0.0, 1.0])[:, 0, 0], [1.0, math.exp(math.sin(1))], SOLVER)


def test_what_is_known_stays_known():
    """P0 = 0 and Q = 0: zero for ever, exactly; at t = 0 alone P0 itself."""
    assert not varying.transient(slope(P0=0), [1.0, 1e3]).P.any()
    assert varying.transient(slope(P0=3), [0.0]).P[0, 0, 0] == 3


@pytest.mark.parametrize(
    ("model", "t", "message"),
    [
        (slope(), [1.0, 1.0], r"^t: expected increasing times >= 0, received \[1.0, 1.0\]$"),
        (slope(), [], r"^t: expected increasing times"),
        (slope(R=0), [1.0], r"^Rc\(t = 0 s\): expected a positive definite matrix, received \[\[0.0\]\]$"),
        (VaryingModel([[0]], [[1]], [[0]], lambda t: [[t, 1]], [[1]], [[1]]), [1.0], r"^H\(t = 0 s\): expected shape"),
        (VaryingModel([[0, 1]], [[1]], [[0]], [[1]], [[1]], [[1]]), [1.0], r"^F\(t = 0 s\): expected shape"),
    ],
)
def test_wrong_input_is_named(model, t, message):
    """One line: what, what was expected, what was received, at which time."""
    with pytest.raises(ValueError, match=message):
        varying.transient(model, t)


def test_overflow_is_reported():
    """An unstable state that is not measured cannot be integrated for ever."""
    model = VaryingModel([[1]], [[1]], [[1]], [[0]], [[1]], [[1e300]])  # e²ᵗ to the end of the doubles in 9 s, not in 350 s
    with pytest.raises(FloatingPointError, match=r"^P: expected a covariance that can be integrated to t = 1000 s"):
        varying.transient(model, [1000.0])
