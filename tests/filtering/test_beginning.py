"""The first instants from a vague start, where doubles are hardly enough: against many digits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ctlabs import DiscreteModel, covariances, kalman_filter
from ctlabs.filtering import comparison
from ctlabs.filtering import filter as filters
from ctlabs.filtering.algorithms import beginning
from ctlabs.filtering.engines import compiled
from ctlabs.filtering.problem import pose
from ctlabs.linalg.checks import Array

pytestmark = pytest.mark.numerical
ROWS = 8


def chain(seed: int, unknown: float) -> DiscreteModel:
    """Integrators that sensors see which are almost parallel, with noises from 1e-15 to 1e-7, from variances up to 1e11 or ``inf``."""
    rng = np.random.default_rng([5, seed])
    n, m = int(rng.integers(2, 4)), int(rng.integers(1, 4))
    Phi = np.eye(n) + np.diag(np.ones(n - 1), 1) * rng.choice([0.1, 1.0, 10.0])
    Phi += rng.choice([0, 1e-9, 0.1]) * rng.normal(size=(n, n))
    H = rng.normal(size=n) + 10.0 ** rng.integers(-10, 0) * rng.normal(size=(m, n))
    P0 = np.diag(np.where(rng.random(n) < unknown, np.inf, 10.0 ** rng.integers(-2, 12, size=n)))
    Qd = np.diag(np.append(np.zeros(n - 1), 10.0 ** rng.integers(-16, 3)))
    return DiscreteModel(Phi, Qd, H, np.diag(10.0 ** rng.integers(-30, -14, size=m)), P0=P0)


def off(P: Array, right: Array) -> float:
    """The largest error in units of the standard deviations; what is unknown must be so in both."""
    assert (np.isfinite(P) == np.isfinite(right)).all()
    variances = np.diagonal(right, axis1=1, axis2=2)
    sd = np.sqrt(np.where(np.isfinite(variances) & (variances > 0), variances, 1.0))
    with np.errstate(invalid="ignore"):
        error = np.abs(P - right) / (sd[:, :, None] * sd[:, None, :])
    return float(np.where(np.isfinite(right), error, 0.0).max())


@pytest.mark.parametrize("unknown", [0.0, 0.4])
def test_no_variance_is_silently_wrong(unknown, monkeypatch):
    """Right to 1e-7 of the variances, or refused: nothing between; and some of them need the digits."""
    monkeypatch.setattr(comparison, "DIGITS", 200)
    precisely, needed = beginning.precisely, []
    monkeypatch.setattr(beginning, "precisely", lambda *given: needed.append(1) or precisely(*given))
    refused, models = 0, 12
    for seed in range(models):
        model = chain(seed, unknown)
        try:
            found = kalman_filter(model, np.zeros((ROWS, model.m)))
        except FloatingPointError:
            refused += 1
            continue
        right = comparison.reference(model, np.zeros((ROWS, model.m)))
        assert off(found.P_minus, right.P_minus) < 1e-7
        assert off(found.P_plus, right.P_plus) < 1e-7
    assert refused < models / 4
    assert len(needed) > 1


def test_an_ordinary_start_needs_doubles_only(monkeypatch):
    """A large, or unknown, start of an ordinary model is computed twice, and not with more digits."""
    monkeypatch.setattr(beginning, "precisely", None)
    track = DiscreteModel([[1, 1], [0, 1]], np.diag([0, 0.1]), [[1, 0]], [[4]], P0=np.diag([1e9, 1e7]))
    for P0 in (track.P0, np.diag([np.inf, np.inf])):
        assert np.isfinite(covariances(replace(track, P0=P0), 5).P_plus[2:]).all()


def test_a_perfect_measurement_in_many_digits_leaves_exactly_nothing():
    """What two perfect sensors determine has the variance 0, not 1e-100 of what it was."""
    model = DiscreteModel([[1, 1], [0, 1]], np.diag([0.0, 1e-3]), [[1, 0], [1, 1e-9]], np.zeros((2, 2)), P0=np.diag([1e10, 1e10]))
    found = kalman_filter(model, np.zeros((4, 2)))
    assert (found.P_plus[1:] == 0).all()


def test_two_forms_agree_only_if_both_know_the_same():
    """A difference, NaN beside a number, ``inf`` beside a number: each is a disagreement."""
    model = DiscreteModel([[1, 1], [0, 1]], np.diag([0.0, 1.0]), [[1, 0]], [[1]], P0=np.eye(2))
    one = kalman_filter(model, np.zeros((3, 1, 2)))
    assert filters.agree(one, one)
    for name, wrong in (("x_plus", 1e-6), ("x_plus", np.nan), ("P_minus", 1e-6), ("P_minus", np.inf)):
        changed = getattr(one, name).copy()
        changed[2, 0, 0] += wrong
        assert not filters.agree(one, replace(one, **{name: changed}))
        assert not filters.agree(replace(one, **{name: changed}), one)


@pytest.mark.parametrize("unknown", [0.0, 0.4])
def test_a_likelihood_needs_no_gains(unknown):
    """Without histories it is the filter's to the bit, in doubles and in many digits."""
    seen = 0
    for seed in range(6):
        model = chain(seed, unknown)
        z = np.cos(np.arange(ROWS * model.m)).reshape(ROWS, model.m)
        problem = pose(model, z, first=1)
        try:
            whole = compiled.record(problem)
        except FloatingPointError:
            continue
        seen += 1
        assert compiled.log_likelihood(problem)[0] == whole.log_likelihood_diffuse[0]
    assert seen > 2
