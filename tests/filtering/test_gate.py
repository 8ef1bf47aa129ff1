"""The gate: what it leaves out, and that the rest is filtered as if that had not been measured."""

from dataclasses import replace

import numpy as np
import pytest

from ctlabs import ContinuousModel, DiscreteModel, Filter, kalman_filter
from tests import reference

MODEL = DiscreteModel(
    [[1, 0.5], [0, 0.9]], [[0.1, 0.05], [0.05, 0.2]], [[1, 0], [1, 1]], [[1, 0.6], [0.6, 0.5]], x0=[1, -1], P0=np.eye(2)
)  # fmt: skip


def simulated(model, rows, seed):
    """A record of a model, (rows, m), by its own filter's innovations."""
    rng = np.random.default_rng(seed)
    x, z = rng.multivariate_normal(model.x0, np.where(np.isfinite(model.P0), model.P0, 0.0)), []
    for k in range(rows):
        Phi, Q = (M[k] if M.ndim == 3 else M for M in (model.Phi, model.Qd))
        x = Phi @ x + rng.multivariate_normal(np.zeros(model.n), Q)
        z.append(model.H @ x + rng.multivariate_normal(np.zeros(model.m), model.R))
    return np.array(z)


def by_hand(model, z, gate):
    """Instant by instant with the textbook's formulas: which elements are left out, and the last estimate."""
    x, P, left = model.x0, model.P0, []
    for row, values in enumerate(z):
        x, P = reference.predict(x, P, model.Phi, model.Qd)
        S = model.H @ P @ model.H.T + model.R
        away = np.abs(values - model.H @ x) / np.sqrt(np.diag(S))
        left += [(row, i) for i in np.flatnonzero(away > gate)]
        used = ~np.isnan(values) & ~(away > gate)
        x, P, _K = reference.update(x, P, values[used], model.H[used], model.R[np.ix_(used, used)])
    return left, x, P


@pytest.mark.parametrize("gate", [1.5, 2.5, 5])
def test_elements_beyond_the_gate_are_those_of_the_textbook(gate):
    """Two sensors whose noises correlate, 300 rows with outliers and gaps: the same elements, the same last estimate."""
    z = simulated(MODEL, 300, 0)
    z[[5, 70, 71, 200], [0, 1, 1, 0]] += [40, -30, 25, 60]
    z[np.random.default_rng(1).random(z.shape) < 0.1] = np.nan
    found = kalman_filter(MODEL, z, gate=gate)
    left, x, P = by_hand(MODEL, z, gate)
    assert [(one.row, one.element) for one in found.left_out] == left
    np.testing.assert_allclose(found.x_plus[-1], x, rtol=1e-9)
    np.testing.assert_allclose(found.P_plus[-1], P, rtol=1e-9)
    for one in found.left_out:
        assert one.value == z[one.row, one.element]
        assert one.sigmas > gate
        assert np.isnan(found.z[one.row + 1, one.element])
    away = np.abs(found.innovation) / np.sqrt(np.diagonal(found.S, axis1=1, axis2=2))
    assert np.nanmax(away) <= gate * (1 + 1e-12)


@pytest.mark.parametrize("algorithm", ["ud", "srif", "filterpy"])
def test_every_form_filters_the_record_without_them(algorithm):
    """As if they had not been measured, to the bit."""
    z = simulated(MODEL, 40, 2)
    z[20, 0] += 50
    found = kalman_filter(MODEL, z, gate=4, algorithm=algorithm)
    z[[one.row for one in found.left_out], [one.element for one in found.left_out]] = np.nan
    other = kalman_filter(MODEL, z, algorithm=algorithm)
    assert [one.row for one in found.left_out] == [20]
    np.testing.assert_array_equal(found.x_plus, other.x_plus)
    assert found.log_likelihood == other.log_likelihood


def test_a_gate_that_nothing_reaches_changes_nothing():
    """And lists nothing."""
    z = simulated(MODEL, 500, 3)
    found, plain = kalman_filter(MODEL, z, gate=20), kalman_filter(MODEL, z)
    assert found.left_out == ()
    np.testing.assert_array_equal(found.x_plus, plain.x_plus)


def test_models_that_vary_and_noises_that_correlate_are_gated_too():
    """Irregular times, an unknown start, whose first measurements cannot be outliers, and N: against the online filter."""
    rng = np.random.default_rng(4)
    plant = ContinuousModel([[0, 1], [0, 0]], [[0], [1]], [[0.1]], [[1, 0]], x0=[0, 0], P0=np.diag([np.inf, np.inf]))
    t = np.cumsum(rng.uniform(0.2, 2, 200))
    z = 500 + np.cumsum(rng.normal(size=200))
    z[[30, 100, 101, 170]] += [60, -80, 90, 100]
    found, online = kalman_filter(plant, z, t=t, R=[[1.0]], gate=5), Filter(plant, R=[[1.0]])
    left = [one.row for i, at in enumerate(t) for one in online.step(z[i], at, gate=5).left_out]
    assert [one.row for one in found.left_out] == left
    assert {30, 100, 101, 170} <= set(left)
    np.testing.assert_allclose(found.x_plus[-1], online.estimate.x_plus, rtol=1e-8)
    tied = replace(MODEL, N=0.02 * np.eye(2))
    z = simulated(MODEL, 150, 5)
    z[[40, 90]] += [[0, 30], [40, 40]]
    found, online = kalman_filter(tied, z, gate=4), Filter(tied)
    left = [one[:2] for row in z for one in online.step(row, gate=4).left_out]
    assert [one[:2] for one in found.left_out] == left
    assert [one[:2] for one in found.row(41).left_out] == [(40, 1)]
    assert {(40, 1), (90, 0), (90, 1)} <= set(left)
    np.testing.assert_allclose(found.x_plus[-1], online.estimate.x_plus, rtol=1e-8)


def test_a_filter_that_is_fed_online_is_as_it_was_after_a_refusal():
    """A gate that is none, or that of a late measurement."""
    online = Filter(MODEL, memory=3)
    online.step([1.0, None], t=1)
    online.step(None, t=2)
    with pytest.raises(ValueError, match="gate: expected none with a late measurement"):
        online.step([None, 1.0], t=1, gate=5)
    with pytest.raises(ValueError, match="gate: expected a positive number of standard deviations, received 0"):
        online.step([1.0, 1.0], gate=0)
    assert online.k == 2


def test_what_cannot_be_gated_is_refused():
    """Everything beyond; several runs; given gains."""
    z = simulated(MODEL, 30, 6)
    with pytest.raises(ValueError, match=r"gate: expected measurements within 5 σ of their predictions, received none"):
        kalman_filter(MODEL, z + 1e4, gate=5)
    with pytest.raises(ValueError, match="gate: expected one record, received 2 runs"):
        kalman_filter(MODEL, np.stack([z, z], axis=2), gate=5)
    with pytest.raises(ValueError, match="gate: expected none beside given gains"):
        kalman_filter(MODEL, z, gains=kalman_filter(MODEL, z), gate=5)
