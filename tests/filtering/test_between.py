"""The covariance between samples: continuous, equal to the filter's own at the samples, and to the definition between."""

import numpy as np
import pytest
import scipy.integrate
from hypothesis import given, settings
from hypothesis import strategies as st

from ctlabs.filtering import bucy
from ctlabs.filtering.between import between
from ctlabs.labs.experiment import covariances
from ctlabs.models import ContinuousModel
from ctlabs.models.discretisation import discretise
from tests.reference import EXACT, SOLVER, broken, close
from tests.strategies import continuous_models

pytestmark = pytest.mark.numerical

OSCILLATOR = ContinuousModel(
    [[0, 1], [-4, -0.3]], [[0], [1]], [[2]], [[1, 0]], P0=[[1, 0.2], [0.2, 3]], states=["x", "v"]
)


def lyapunov(model, P, span):
    """P after ``span`` by integrating the differential equation Ṗ = FP + PFᵀ + GQGᵀ."""

    def flow(_t, p):
        P = p.reshape(model.n, model.n)
        return (model.F @ P + P @ model.F.T + model.G @ model.Q @ model.G.T).ravel()

    found = scipy.integrate.solve_ivp(flow, (0, span), P.ravel(), method="DOP853", rtol=1e-12, atol=1e-13)
    return found.y[:, -1].reshape(P.shape)


def test_it_follows_the_differential_equation_from_every_update():
    """Inside an interval P obeys the Lyapunov equation from P⁺, and a broken F is noticed."""
    schedule = covariances(discretise(OSCILLATOR, 0.7, R=[[0.5]]), 3)
    found = between(OSCILLATOR, schedule, points=4)
    wrong = ContinuousModel(broken(OSCILLATOR.F), OSCILLATOR.G, OSCILLATOR.Q, OSCILLATOR.H, P0=OSCILLATOR.P0)
    for k in range(3):
        inside = found.P[5 * k + 2]
        assert close(inside, lyapunov(OSCILLATOR, schedule.P_plus[k], 0.35), SOLVER)
        assert not close(inside, lyapunov(wrong, schedule.P_plus[k], 0.35), SOLVER)


@settings(deadline=None, max_examples=30, derandomize=True)
@given(model=continuous_models(correlated=False), points=st.integers(1, 5), dt=st.floats(0.01, 1.0))
def test_at_the_samples_it_is_the_filters_own_covariance(model, points, dt):
    """Before and after each update the curve passes through P⁻ and P⁺; t never decreases."""
    schedule = covariances(discretise(model, dt, R=np.eye(model.m)), 3)
    found = between(model, schedule, points)
    assert len(found.t) == 3 * (points + 1) + 1
    assert (np.diff(found.t) >= 0).all()
    starts = np.arange(3) * (points + 1)
    assert close(found.P[starts], schedule.P_plus[:-1], EXACT)
    assert close(found.P[starts + points], schedule.P_minus[1:], EXACT)
    assert np.array_equal(found.P[-1], schedule.P_plus[-1])
    assert np.array_equal(found.t[starts + points], schedule.t[1:])
    assert np.array_equal(found.P, np.swapaxes(found.P, 1, 2))


def test_without_measurements_it_is_continuous():
    """With R = ∞ nothing drops, and the curve is that of the whole time in one interval."""
    schedule = covariances(discretise(OSCILLATOR, 0.5, R=[[np.inf]]), 4)
    found = between(OSCILLATOR, schedule, points=3)
    assert close(found.P[3], found.P[4], EXACT)
    assert close(found.P[-1], lyapunov(OSCILLATOR, OSCILLATOR.P0, 2.0), SOLVER)
    assert np.allclose(found.sd[0], [1.0, np.sqrt(3)])


def test_frequent_measurements_tend_to_the_continuous_filter():
    """With R = Rc/dt the curve tends to the Kalman–Bucy variance, at first order in dt."""
    model = ContinuousModel([[-1]], [[1]], [[2]], [[1]], P0=[[3]], Rc=[[0.5]])
    limit, errors = bucy.transient(model, [1.0]).P[0, 0, 0], []
    for steps in (50, 100):
        schedule = covariances(discretise(model, 1 / steps), steps)
        errors.append(abs(between(model, schedule, 2).P[-1, 0, 0] - limit))
    assert errors[0] / errors[1] == pytest.approx(2, abs=0.1)


def test_a_schedule_of_another_model_is_refused():
    """The prediction of the schedule must be what the model makes of P⁺: 5 % in Q is noticed."""
    other = ContinuousModel(OSCILLATOR.F, OSCILLATOR.G, 1.05 * OSCILLATOR.Q, OSCILLATOR.H, P0=OSCILLATOR.P0)
    schedule = covariances(discretise(other, 0.5, R=[[1]]), 2)
    with pytest.raises(ValueError, match=r"filtered: expected predictions of this model, received P_minus\[1\]"):
        between(OSCILLATOR, schedule)
    one = ContinuousModel([[0]], [[1]], [[1]], [[1]], P0=[[0]])
    with pytest.raises(ValueError, match=r"filtered: expected covariances of 1 states, received 2"):
        between(one, schedule)
    with pytest.raises(TypeError, match="model"):
        between(discretise(OSCILLATOR, 0.5, R=[[1]]), schedule)
    with pytest.raises(ValueError, match="points"):
        between(other, schedule, points=0)
