"""Smoothing is conditioning on the whole record: against the joint distribution, least squares, and the other route."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ctlabs.filtering import kalman_filter, smooth, smoothing
from ctlabs.filtering.algorithms.catalogue import FORMS
from ctlabs.filtering.engines import backward
from ctlabs.filtering.motion import motion
from ctlabs.models import DiscreteModel, NonlinearModel
from tests import reference
from tests.reference import EXACT, SOLVER, broken, close
from tests.strategies import discrete_models, record, seeds

pytestmark = pytest.mark.numerical

TRACK = DiscreteModel(
    Phi=[[1, 0.5], [0, 0.9]], Qd=[[0.1, 0.05], [0.05, 0.2]], H=[[1, 0], [0.5, 1]], R=[[1, 0.3], [0.3, 2]],
    x0=[1, -1], P0=[[4, 0], [0, 2]], dt=0.5,
)  # fmt: skip
CORRELATED = dataclasses.replace(TRACK, N=[[0.1, 0.0], [0.05, 0.1]], offset=[0.5, -1.0])


def jointly(model, z, first=1):
    """Means, covariances and lag-one covariances of the states given the record, by conditioning all at once."""
    J = reference.learned(model, z, first)[-1]
    x, P = reference.states(J)
    lag_one = np.full_like(P, np.nan)
    for k in range(1, len(x)):
        lag_one[k] = J.cov[J.x(k), J.x(k - 1)]
    return x, P, lag_one


def striebel(model, past):
    """Rauch, Tung & Striebel's recursion: x, P, lag_one."""
    x, P, lag_one = past.x_plus.copy(), past.P_plus.copy(), np.full_like(past.P_plus, np.nan)
    for k in range(len(x) - 2, -1, -1):
        Phi, Q, _ = motion(model, k, past.used[k])
        C = np.linalg.solve(past.P_minus[k + 1], Phi @ past.P_plus[k]).T
        left = np.eye(model.n) - C @ Phi
        x[k] += C @ (x[k + 1] - past.x_minus[k + 1])
        P[k] = left @ past.P_plus[k] @ left.T + C @ (P[k + 1] + Q) @ C.T
        lag_one[k + 1] = P[k + 1] @ C.T
    return x, P, lag_one


def size_of(model):
    """The size of the covariances whose difference a smoothed one is."""
    return max(np.abs(model.P0).max(), np.abs(model.Qd).max())


@settings(max_examples=60)
@given(discrete_models(), seeds, st.sampled_from([0.0, 0.3]), st.integers(0, 1))
def test_the_smoother_is_the_joint_conditional(model, seed, gaps, first):
    """x, P and cov(x_k, x_{k−1}) given the record, whatever is singular, correlated, varying or missing."""
    z = record(model, 6, np.random.default_rng(seed), gaps, first)
    found, (x, P, lag_one) = smooth(model, kalman_filter(model, z[first:], first=first)), jointly(model, z, first)
    size = size_of(model)
    assert close(found.x, x, EXACT)
    assert close(found.P, P, EXACT, size)
    assert close(found.lag_one, lag_one, EXACT, size)


@settings(max_examples=30)
@given(discrete_models(stable=None, singular=False), seeds, st.sampled_from([0.0, 0.3]), st.integers(0, 1))
def test_square_roots_and_rauch_tung_striebel_agree(model, seed, gaps, first):
    """Two routes to one posterior: likelihoods that meet, and corrections that run backward."""
    past = kalman_filter(model, record(model, 6, np.random.default_rng(seed), gaps, first)[first:], first=first)
    found, (x, P, lag_one) = smooth(model, past), striebel(model, past)
    assert close(found.x, x, SOLVER)
    assert close(found.P, P, SOLVER)
    assert close(found.lag_one, lag_one, SOLVER)


@settings(max_examples=30)
@given(discrete_models(stable=None), seeds, st.sampled_from([0.0, 0.3]))
def test_a_smoothed_covariance_is_one_and_no_larger_than_the_filters(model, seed, gaps):
    """P is symmetric and nonnegative, and P⁺ − P is."""
    past = kalman_filter(model, record(model, 6, np.random.default_rng(seed), gaps)[1:])
    found = smooth(model, past)
    assert (found.P == found.P.transpose(0, 2, 1)).all()
    rounding = EXACT * np.abs(past.P_plus).max()
    assert np.linalg.eigvalsh(found.P).min() >= -EXACT * np.abs(found.P).max()
    assert np.linalg.eigvalsh(past.P_plus - found.P).min() >= -rounding


@pytest.mark.parametrize("name", ["Phi", "Qd", "H", "R"])
def test_a_broken_model_is_noticed(name):
    """5 % in one element of the model changes the smoothed estimates of one and the same history."""
    z = record(CORRELATED, 8, np.random.default_rng(1))
    past, exact = kalman_filter(CORRELATED, z[1:]), reference.smoothed(CORRELATED, z)
    assert close(smooth(CORRELATED, past).x, exact.x, EXACT)
    wrong = dataclasses.replace(CORRELATED, **{name: broken(getattr(CORRELATED, name), (0, 0))})
    assert not close(smooth(wrong, dataclasses.replace(past, model=wrong)).x, exact.x, EXACT)
    if name in ("Phi", "Qd"):
        with pytest.raises(ValueError, match=f"filtered: expected a record of this model, .* filtered with another {name}"):
            smooth(wrong, past)


@pytest.mark.parametrize("form", list(FORMS))
def test_the_history_of_any_form_will_do(form):
    """The smoother takes estimates and covariances; how they were computed does not matter."""
    model = dataclasses.replace(CORRELATED, P0=kalman_filter(CORRELATED, np.zeros((500, 2))[1:]).P_minus[-1])
    z = record(model, 8, np.random.default_rng(2), first=0)
    if form != "steady":  # whose gain is that of complete measurements
        z[4, 0] = np.nan
    found, wanted = smooth(model, kalman_filter(model, z, first=0, algorithm=form)), reference.smoothed(model, z, 0)
    assert close(found.x, wanted.x, SOLVER)
    assert close(found.P, wanted.P, SOLVER)


def test_an_ensemble_is_smoothed_run_by_run():
    """All runs in one pass, with one covariance."""
    rng = np.random.default_rng(3)
    z = np.stack([record(CORRELATED, 12, rng) for _ in range(5)], axis=2)
    z[7, 1] = np.nan
    found = smooth(CORRELATED, kalman_filter(CORRELATED, z[1:], algorithm="joseph"))
    for run in range(5):
        alone = smooth(CORRELATED, kalman_filter(CORRELATED, z[1:, :, run]))
        assert close(found.x[:, :, run], alone.x, EXACT)
        assert close(found.P, alone.P, EXACT)


@pytest.mark.parametrize("size", [1e7, 1e12, 1e20])
def test_a_vague_start_costs_no_digits(size):
    """Where P0 is large the smoothed moments at t0 are those of weighted least squares, to its own accuracy."""
    vague = dataclasses.replace(TRACK, P0=size * np.eye(2))
    z = record(TRACK, 12, np.random.default_rng(4))
    found, wanted = smooth(vague, kalman_filter(vague, z[1:])), reference.least_squares(vague, z)
    assert close(found.x[0], wanted.x[0], SOLVER)
    assert close(found.P[0], wanted.P[0], SOLVER)
    assert np.linalg.eigvalsh(found.P).min() > 0


def test_states_that_decay_are_smoothed_too():
    """Without disturbances everything said of the end is said of x0: P_s = Φᵏ P_{0|N} Φᵏᵀ, though P⁻ loses its rank."""
    model = DiscreteModel(
        Phi=[[0.9, 0.2], [0.0, 0.3]], Qd=np.zeros((2, 2)), H=[[1, 1]], R=[[0.01]], x0=[0, 0], P0=[[1, 0.2], [0.2, 1]]
    )
    z = record(model, 60, np.random.default_rng(5))
    found = smooth(model, kalman_filter(model, z[1:]))
    P = np.linalg.inv(reference.information(model, 60))
    for k in range(61):
        assert close(found.P[k], P, EXACT)
        assert close(found.x[k], np.linalg.matrix_power(model.Phi, k) @ found.x[0], EXACT)
        P = model.Phi @ P @ model.Phi.T
    rows = np.array([model.H @ np.linalg.matrix_power(model.Phi, k) for k in range(1, 61)])[:, 0]
    x0 = np.linalg.solve(np.linalg.inv(model.P0) + rows.T @ rows / 0.01, rows.T @ z[1:, 0] / 0.01)
    assert close(found.x[0], x0, EXACT)


def test_information_that_would_overflow_is_a_constraint():
    """x grows by 2 per step without a disturbance: of x0 more is known than doubles can say, and the result is finite."""
    model = DiscreteModel([[2]], [[0]], [[1]], [[1]], x0=[1], P0=[[1]])
    z = record(model, 700, np.random.default_rng(6))
    found = smooth(model, kalman_filter(model, z[1:]))
    assert np.isfinite(found.x).all()
    assert close(found.x[1:, 0] / found.x[:-1, 0], 2 * np.ones(700), EXACT)
    assert close(found.P[:, 0, 0], 0.75 * 0.25 ** np.arange(700.0, -1, -1), EXACT)


PERFECT = [
    dataclasses.replace(TRACK, R=np.diag([0.0, 1.0])),
    dataclasses.replace(TRACK, R=np.diag([0.0, 0.0])),
    dataclasses.replace(TRACK, R=np.diag([0.0, 1.0]), Qd=np.zeros((2, 2))),
    dataclasses.replace(TRACK, R=np.diag([0.0, 1.0]), N=[[0.0, 0.1], [0.0, 0.1]]),
]


@pytest.mark.parametrize("model", PERFECT, ids=["one", "both", "no disturbance", "correlated"])
def test_perfect_measurements_are_smoothed(model):
    """R = 0 would be an infinite information; the states it determines keep their exact values."""
    z = record(model, 7, np.random.default_rng(7))
    found, (x, P, lag_one) = smooth(model, kalman_filter(model, z[1:])), jointly(model, z)
    assert close(found.x, x, 1e-10)
    assert close(found.P, P, 1e-10, size_of(model))
    assert close(found.lag_one, lag_one, 1e-10, size_of(model))
    behind = smooth(model, z[1:], lag=2)
    for k in range(8):
        x, P, _ = jointly(model, z[: min(k + 2, 7) + 1])
        assert close(behind.x[k], x[k], 1e-10)
        assert close(behind.P[k], P[k], 1e-10, size_of(model))


@settings(max_examples=40)
@given(discrete_models(), seeds, st.sampled_from([0.0, 0.3]), st.integers(0, 1), st.integers(0, 8))
def test_a_fixed_lag_is_the_conditional_mean(model, seed, gaps, first, lag):
    """Entry k is x_k given what is measured up to k + lag, by the joint distribution; nothing is approximated."""
    z = record(model, 6, np.random.default_rng(seed), gaps, first)
    found, given = smooth(model, z[first:], first=first, lag=lag), reference.learned(model, z, first)
    for k in range(7):
        last = max(min(k + lag, 6), 1)  # a record has one step at least; with one row less x_0 is P0's or the filter's
        if k + lag == 0:
            past = kalman_filter(model, z[first:], first=first)
            x, P = past.x_plus[:1], past.P_plus[:1]
        else:
            x, P = (moments[: last + 1] for moments in reference.states(given[last + 1]))
        assert close(found.x[k], x[k], EXACT, np.abs(x).max())
        assert close(found.P[k], P[k], EXACT, size_of(model))


def test_lag_0_is_the_filter_and_a_long_lag_the_smoother():
    """The ends of the scale, to the bit."""
    z = record(CORRELATED, 20, np.random.default_rng(8))
    past = kalman_filter(CORRELATED, z[1:])
    none, whole = smooth(CORRELATED, z[1:], lag=0), smooth(CORRELATED, past)
    assert close(none.x, past.x_plus, EXACT)
    assert close(none.P, past.P_plus, EXACT)
    for lag in (20, 25):
        found = smooth(CORRELATED, z[1:], lag=lag)
        assert (found.x == whole.x).all()
        assert (found.P == whole.P).all()
    assert (smooth(CORRELATED, z[1:], lag=3).x[-1] == whole.x[-1]).all()


@pytest.mark.parametrize("model", [TRACK, CORRELATED], ids=["plain", "correlated"])
def test_windows_that_go_back_together_are_the_windows(model, monkeypatch):
    """Windows with the same elements share their matrices; one by one, and across gaps, the result is the same."""
    z = record(model, 250, np.random.default_rng(9))
    z[[100, 101, 180], 0] = np.nan
    together = smooth(model, z[1:], lag=7)
    monkeypatch.setattr(smoothing, "TOGETHER", 1)
    alone = smooth(model, z[1:], lag=7)
    assert close(together.x, alone.x, EXACT)
    assert close(together.P, alone.P, EXACT)
    for k in (60, 95, 101, 178):
        whole = smooth(model, kalman_filter(model, z[: k + 8][1:]))
        assert close(together.x[k], whole.x[k], EXACT)
        assert close(together.P[k], whole.P[k], EXACT)


def test_waiting_helps():
    """The variance of a state falls with the lag, towards the smoother's."""
    z = np.zeros((60, 2))
    variances = [smooth(TRACK, z[1:], lag=lag).P[20, 1, 1] for lag in range(12)]
    assert (np.diff(variances) < 0).all()
    assert close(variances[-1], smooth(TRACK, kalman_filter(TRACK, z[1:])).P[20, 1, 1], 1e-3)


def test_plain_python_is_what_is_compiled(monkeypatch):
    """The loops without numba give the same numbers, with N, with gaps, for varying matrices, R = 0 and unknown states."""
    varying = dataclasses.replace(TRACK, Qd=np.tile(TRACK.Qd, (30, 1, 1)), R=np.tile(TRACK.R, (31, 1, 1)))
    unknown = [dataclasses.replace(PERFECT[0], P0=P0) for P0 in (np.diag([np.inf, 1]), np.diag([np.inf] * 2), 1e12 * np.eye(2))]
    hidden = dataclasses.replace(unknown[1], H=[[1, 0], [1, 0]], Phi=[[1, 0], [0, 1]])
    for model in (TRACK, CORRELATED, varying, *PERFECT, *unknown, hidden):
        z = record(dataclasses.replace(model, P0=np.eye(2)), 30, np.random.default_rng(10))
        z[15, 0] = np.nan
        past = kalman_filter(model, z[1:])
        own = smooth(model, past), smooth(model, past, lag=5)
        with monkeypatch.context() as patched:
            for name in ("prepare", "smooth", "windows"):
                patched.setattr(backward, name, getattr(backward, name).py_func)
            plain = smooth(model, past), smooth(model, past, lag=5)
        for one, other in zip(own, plain, strict=True):
            assert close(one.x, other.x, EXACT)
            assert close(one.P, other.P, EXACT)
            assert close(one.lag_one, other.lag_one, EXACT)


def test_histories_that_do_not_fit_are_refused():
    """A nonlinear model, another model's history, one that starts from nothing, a negative lag."""
    z = record(TRACK, 8, np.random.default_rng(11))
    past = kalman_filter(TRACK, z[1:])
    nonlinear = NonlinearModel(lambda k, x, w: x + w, lambda k, x, v: x + v, np.eye(2), np.eye(2), np.zeros(2), np.eye(2))
    with pytest.raises(TypeError, match="model: expected a DiscreteModel or a ContinuousModel, received a NonlinearModel"):
        smooth(nonlinear, z[1:])
    with pytest.raises(TypeError, match="model: expected a DiscreteModel or a ContinuousModel, received a NonlinearModel"):
        smooth(nonlinear, past)
    walk = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[1]])
    with pytest.raises(ValueError, match=r"filtered: expected a record of a model with n, m = \(1, 1\), received one with \(2, 2\)"):
        smooth(walk, past)
    with pytest.raises(ValueError, match=r"^first: expected none beside a filtered record"):
        smooth(TRACK, past, first=0)
    nothing = dataclasses.replace(kalman_filter(TRACK, z[1:], algorithm="information", P0=np.diag([np.inf, np.inf])), start=None)
    with pytest.raises(ValueError, match=r"filtered.P_plus: expected finite covariances, received inf at step 0"):
        smooth(TRACK, nothing)
    short = dataclasses.replace(TRACK, Phi=np.tile(TRACK.Phi, (5, 1, 1)))
    with pytest.raises(ValueError, match=r"filtered: expected a record of this model, .* another Phi"):
        smooth(short, past)
    with pytest.raises(ValueError, match="steps: expected at most 5"):
        smooth(short, z[1:])
    with pytest.raises(ValueError, match="lag: expected one record"):
        smooth(TRACK, np.zeros((5, 2, 3)), lag=2)
    for lag in (-1, 1.5):
        with pytest.raises(ValueError, match="lag: expected a whole number >= 0"):
            smooth(TRACK, z[1:], lag=lag)
