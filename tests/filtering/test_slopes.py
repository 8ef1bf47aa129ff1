"""Derivatives of the likelihood: every matrix's against the joint density in decimals, constants' against closed forms."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given

from ctlabs.analysis.likelihood import Likelihood, pieces
from ctlabs.analysis.score import Score
from ctlabs.analysis.surface import Box
from ctlabs.filtering import log_likelihood
from ctlabs.filtering.problem import pose
from ctlabs.filtering.slopes import MATRICES, slopes
from ctlabs.models import DiscreteModel
from tests import nile, reference
from tests.strategies import discrete_models, record, seeds

pytestmark = pytest.mark.numerical
FIELDS = (*MATRICES, "dt", "n", "m", "states")


def along(model: DiscreteModel, z: Any, first: int, name: str, D: Any) -> float:
    """The derivative of the joint density along D, by differences of a likelihood in decimals, to order h⁶."""

    def density(h: float) -> float:
        parts = {field: getattr(model, field) for field in FIELDS}
        return reference.log_likelihood(SimpleNamespace(**parts | {name: parts[name] + h * D}), z, first)

    a, b, c = ((density(k * 1e-3) - density(-k * 1e-3)) / (2e-3 * k) for k in (1, 2, 4))
    return (16 * (4 * a - b) / 3 - (4 * b - c) / 3) / 15


@given(discrete_models(), seeds)
def test_the_slope_by_every_matrix_is_that_of_the_joint_density(model, seed):
    """Any model: varying, correlated, singular Φ, Qd, P0, gaps; along a random direction. A slope of half the size is not."""
    rng = np.random.default_rng(seed)
    z = record(model, 6, rng, gaps=0.2)
    own = slopes(pose(model, z[1:], first=1))
    assert own is not None
    for name in MATRICES:
        M = getattr(model, name)
        if M is None:
            continue
        D = rng.normal(size=M.shape)
        if name in ("Qd", "R", "P0"):  # within the range of a singular one: beside it there is no density on one side
            D = M @ (D + D.swapaxes(-1, -2)) @ M
        D *= 0.1 * np.abs(M).max() / max(np.abs(D).max(), 1e-300)
        terms = getattr(own, name) * D
        assert terms.sum() == pytest.approx(along(model, z, 1, name, D), abs=1e-8 * (np.abs(terms).sum() + 1e-3))
        if np.abs(terms).sum() > 1e-3:
            assert abs(2 * terms.sum() - along(model, z, 1, name, D)) > 1e-9 * abs(terms.sum())


def test_a_perfect_measurement_has_slopes_too():
    """R = 0 with S > 0: the regression of z_k on z_{k−1} in closed form, and the slope by R itself along a growing noise."""
    z, a, q = np.array([0.0, 1.0, -0.5, 2.0, 1.2]), 0.7, 2.0
    model = DiscreteModel([[a]], [[q]], [[1]], [[0]], x0=[0], P0=[[0]])
    own = slopes(pose(model, z[1:]))
    e = z[1:] - a * z[:-1]
    assert own.Phi == pytest.approx(np.array([[e @ z[:-1] / q]]), rel=1e-12)
    assert own.Qd == pytest.approx(np.array([[0.5 * (e @ e / q**2 - 4 / q)]]), rel=1e-12)

    def value(r):
        return log_likelihood(DiscreteModel([[a]], [[q]], [[1]], [[r]], x0=[0], P0=[[0]]), z[1:])

    h = 1e-4
    forward = (-3 * value(0) + 4 * value(h) - value(2 * h)) / (2 * h)
    assert own.R[0, 0] == pytest.approx(forward, rel=1e-6)


def test_where_there_is_no_density_there_is_no_slope():
    """A record that contradicts the model: ℓ = −∞."""
    assert slopes(pose(DiscreteModel([[0.5]], [[0]], [[1]], [[0]], x0=[1], P0=[[0]]), [0.8, 0.64])) is None


def box(start, lower=None, upper=None):
    start = np.array(start, dtype=float)
    p = len(start)
    return Box(
        start,
        np.full(p, -np.inf) if lower is None else np.array(lower, dtype=float),
        np.full(p, np.inf) if upper is None else np.array(upper, dtype=float),
    )


def level(q, r, P0=1e7):
    return DiscreteModel([[1]], [[q]], [[1]], [[r]], x0=[0], P0=[[P0]])


def score(build, z, at, first=0, **bounds):
    """∂ℓ/∂θ at a point."""
    within = box(at, **bounds)
    found = Score(lambda values: pose(build(values), z, first=first), within)(within.start)
    assert found is not None
    return found[1]


def numerical(build, z, at, i, h, first=0):
    """The same by differences of the likelihood to order h⁶."""

    def value(shift):
        values = np.array(at, dtype=float)
        values[i] += shift
        return log_likelihood(build(values), z, first)

    a, b, c = ((value(k * h) - value(-k * h)) / (2 * k * h) for k in (1, 2, 4))
    return (16 * (4 * a - b) / 3 - (4 * b - c) / 3) / 15


@pytest.mark.parametrize("P0", [1e5, 1e7, 1e12, np.inf])
def test_the_score_of_the_nile_for_any_start(P0):
    """Also where nothing is known at first: the diffuse likelihood's."""
    for at in ([1469.0, 15099.0], [3.0, 100.0]):
        found = score(lambda v: level(*v, P0=P0), nile.FLOW[:, None], at, lower=[0, 0])
        for i, value in enumerate(at):
            right = numerical(lambda v: level(*v, P0=P0), nile.FLOW[:, None], at, i, 0.01 * value)
            assert found[i] == pytest.approx(right, rel=1e-7, abs=1e-9 / value * 100)


def test_a_seasonal_start_that_is_not_known_is_differentiated_with_its_period():
    """Trend and cycle, all unknown at t0, gaps among the first rows; the period moves what the beginning leaves."""
    rng, t = np.random.default_rng(0), np.arange(60)
    z = (0.1 * np.cumsum(rng.normal(size=60)) + np.sin(2 * np.pi * t / 12) + 0.2 * rng.normal(size=60))[:, None]
    z[3:9] = np.nan

    def build(v):
        q, r, period = v
        c, s = np.cos(2 * np.pi / period), np.sin(2 * np.pi / period)
        Phi = np.zeros((4, 4))
        Phi[:2, :2], Phi[2:, 2:] = [[1, 1], [0, 1]], 0.98 * np.array([[c, s], [-s, c]])
        return DiscreteModel(Phi, np.diag([0, q, q, q]), [[1, 0, 1, 0]], [[r]], P0=np.diag([np.inf] * 4))

    at = [0.01, 0.04, 12.3]
    found = score(build, z, at, lower=[0, 0, 0])
    for i, value in enumerate(at):
        assert found[i] == pytest.approx(numerical(build, z, at, i, 1e-3 * value), rel=1e-7)


@pytest.mark.parametrize(
    ("build", "at", "right"),
    [
        (lambda v: (v[0], 1.0), 0.0, None),  # a start at 0
        (lambda v: (1e-9 + v[0] * 1e3, 1.0), 2e-12, None),  # tiny beside what it moves
        (lambda v: (np.cos(1e4 * v[0]), 1.0), 1.00003, None),  # changes within 1e-4 of itself
        (lambda v: (0.3, np.exp(20 * v[0])), 0.1, None),
    ],
)
def test_steps_follow_from_the_matrices(build, at, right):
    """The mean of four measurements and their variance: Σ(z − μ)/r dμ + ½Σ((z − μ)²/r² − 1/r) dr, in closed form."""
    z = np.array([0.3, -1.2, 2.0, 0.7])

    def model(v):
        mu, r = build(v)
        return DiscreteModel([[1]], [[0]], [[1]], [[r]], x0=[mu], P0=[[0]])

    mu, r = build([at])
    h = 1e-7 * max(abs(at), 1e-12)
    by_mu, by_r = ((after - before) / (2 * h) for after, before in zip(build([at + h]), build([at - h]), strict=True))
    right = (z - mu).sum() / r * by_mu + 0.5 * (((z - mu) ** 2 / r**2).sum() - 4 / r) * by_r
    assert score(model, z, [at])[0] == pytest.approx(right, rel=1e-6, abs=1e-9)


def test_a_bound_is_differentiated_from_inside():
    """At q = 0 from above, at a correlation of 1 from below; a constant without effect has the slope 0."""
    z = np.random.default_rng(2).normal(size=(30, 1))
    found = score(lambda v: level(v[0], 1.0), z, [0.0, 3.0], lower=[0, -np.inf])
    right = (log_likelihood(level(1e-6, 1.0), z, 0) - log_likelihood(level(0.0, 1.0), z, 0)) / 1e-6
    assert found[0] == pytest.approx(right, rel=1e-3)
    assert found[1] == 0.0

    def pair(v):
        return DiscreteModel(np.eye(2), [[1, v[0]], [v[0], 1]], np.eye(2), np.eye(2), P0=np.eye(2))

    both = np.random.default_rng(3).normal(size=(20, 2))
    slope = score(pair, both, [1.0], lower=[-1], upper=[1])[0]
    values = [log_likelihood(pair([1.0 - k * 1e-4]), both, 0) for k in (0, 1, 2)]
    assert slope == pytest.approx((3 * values[0] - 4 * values[1] + values[2]) / 2e-4, rel=1e-3)


def test_a_measurement_offset_moves_the_data():
    """∂ℓ/∂d = Σ S⁻¹ν of independent measurements: what is subtracted from z."""
    z = np.array([1.0, 2.0, 4.0])

    def build(v):
        return DiscreteModel([[0]], [[0]], [[1]], [[2.0]], x0=[0], P0=[[0]], measurement_offset=[v[0]])

    assert score(build, z, [0.5])[0] == pytest.approx((z - 0.5).sum() / 2.0, rel=1e-10)


def test_several_records_add_up():
    """Values and scores are sums over the records."""
    z, names, within = nile.FLOW[:, None], ("q", "r"), box([1000.0, 1e4], [0, 0])

    def build(c):
        return level(c["q"], c["r"])

    whole = Likelihood(pieces([build, build], [z[:40], z[40:]], 0), names, within)
    parts = [Likelihood(pieces(build, part, 0), names, within) for part in (z[:40], z[40:])]
    assert whole(within.start) == pytest.approx(sum(part(within.start) for part in parts), rel=1e-15)
    assert whole.score(within.start) == pytest.approx(sum(part.score(within.start) for part in parts), rel=1e-12)
