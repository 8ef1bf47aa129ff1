"""Values added at single instants: the auxiliary residuals against the likelihoods of models that have them."""

from dataclasses import replace

import numpy as np
import pytest

from ctlabs import DiscreteModel, kalman_filter
from ctlabs.filtering import log_likelihood
from ctlabs.filtering.disturbances import shocks

pytestmark = pytest.mark.numerical


def some(seed, correlated):
    """A model of random matrices, Qd singular where w and v are independent, and a record with gaps."""
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(1, 4)), int(rng.integers(1, 3))
    A = rng.normal(size=(n, n))
    A /= max(1.0, 1.1 * abs(np.linalg.eigvals(A)).max())
    J = rng.normal(size=(n + m, n + m))
    J = J @ J.T
    G = rng.normal(size=(n, max(1, n - 1)))
    Q, N = (J[:n, :n], J[:n, n:]) if correlated else (G @ G.T, None)
    model = DiscreteModel(A, Q, rng.normal(size=(m, n)), J[n:, n:], x0=rng.normal(size=n), P0=np.eye(n) * rng.uniform(0.1, 10), N=N)
    z = 2 * rng.normal(size=(14, m))
    z[rng.random(z.shape) < 0.2] = np.nan
    return model, z


def top(likelihood):
    """Where a quadratic function is greatest, and twice what it gains there."""
    up, here, down = likelihood(1.0), likelihood(0.0), likelihood(-1.0)
    slope, bend = (up - down) / 2, 2 * here - up - down
    return slope / bend, slope**2 / bend


@pytest.mark.parametrize("seed", range(6))
def test_each_is_the_most_likely_value_and_its_gain(seed):
    """τ² and δ of outliers, breaks and the initial estimate from likelihoods: 1e-9 of gains of order 1 (differences of about 50)."""
    first, (model, z) = seed % 2, some(seed, seed % 2 == 1)
    found = shocks(kalman_filter(model, z, first=first))
    steps = len(z) - 1 + first
    for k, i in np.argwhere(~np.isnan(z)).tolist():

        def outlying(c, k=k, i=i):
            changed = z.copy()
            changed[k, i] -= c
            return log_likelihood(model, changed, first)

        size, gain = top(outlying)
        assert found.outlier[k + first, i] ** 2 == pytest.approx(gain, rel=1e-8, abs=1e-9)
        assert found.outlier_size[k + first, i] == pytest.approx(size, rel=1e-7, abs=1e-8)
    assert np.isnan(found.outlier[first:][np.isnan(z)]).all()
    for k in range(1, steps + 1):
        for j in range(model.n):

            def broken(c, k=k, j=j):
                offset = np.zeros((steps, model.n))
                offset[k - 1, j] = c
                return log_likelihood(replace(model, offset=offset), z, first)

            if broken(1.0) != broken(0.0):
                assert found.shock[k, j] ** 2 == pytest.approx(top(broken)[1], rel=1e-7, abs=1e-8)
    assert np.isnan(found.shock[0]).all()
    gain = 2 * (log_likelihood(replace(model, x0=model.x0 + found.start.shift), z, first) - log_likelihood(model, z, first))
    assert found.start.gain == pytest.approx(gain, rel=1e-9)


def test_what_no_measurement_shows_is_not_told():
    """A second state that is not measured, nor moves the first; and a speed at the last instant, which would show later."""
    apart = DiscreteModel(np.diag([1, 0.5]), np.eye(2), [[1, 0]], [[1]], P0=np.eye(2))
    found = shocks(kalman_filter(apart, np.arange(5.0)))
    assert np.isnan(found.shock[:, 1]).all()
    assert found.start.dof == 1
    moving = DiscreteModel([[1, 1], [0, 1]], np.eye(2), [[1, 0]], [[1]], P0=np.eye(2))
    assert np.isnan(shocks(kalman_filter(moving, np.arange(5.0))).shock[-1, 1])
    assert np.isfinite(shocks(kalman_filter(moving, np.arange(5.0))).shock[1:-1]).all()


def test_a_vague_beginning_is_left_out():
    """Two instants determine position and speed: from then on as with what is known of them, and no initial estimate."""
    model = DiscreteModel([[1, 1], [0, 1]], 0.1 * np.eye(2), [[1, 0]], [[1.0]], P0=np.diag([np.inf, np.inf]))
    z = np.cumsum(np.random.default_rng(0).normal(size=12))
    found = kalman_filter(model, z)
    vague = shocks(found)
    begin = int(np.flatnonzero(~np.isfinite(found.P_minus).all(axis=(1, 2))).max()) + 1
    later = replace(model, x0=found.x_minus[begin], P0=found.P_minus[begin])
    known = shocks(kalman_filter(later, z[begin - 1 :], first=0))
    assert vague.start is None
    assert np.isnan(vague.outlier[:begin]).all()
    np.testing.assert_allclose(vague.outlier[begin:], known.outlier, rtol=1e-8)
    np.testing.assert_allclose(vague.shock[begin + 1 :], known.shock[1:], rtol=1e-8)


def test_an_ensemble_is_refused():
    """Of one record only."""
    model = DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[1]])
    with pytest.raises(ValueError, match=r"filtered: expected one record of a linear model, received DiscreteModel and shape \(4, 1, 2\)"):
        shocks(kalman_filter(model, np.zeros((3, 1, 2))))
