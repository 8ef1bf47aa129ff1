"""One verb filters every model with every algorithm: against hand-made models, conditioning, and the filter that is fed online."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ctlabs import (
    ContinuousModel,
    DiscreteModel,
    Filter,
    NonlinearModel,
    covariances,
    discretise,
    forecast,
    kalman_filter,
    smooth,
)
from ctlabs.filtering import Model, draws, log_likelihood
from ctlabs.filtering.algorithms.catalogue import FORMS
from ctlabs.filtering.engines import driver
from ctlabs.filtering.problem import pose
from ctlabs.filtering.results import without_runs
from tests import reference
from tests.reference import EXACT, SOLVER, close
from tests.strategies import continuous_models, covariance, discrete_models, record, seeds, transition

pytestmark = pytest.mark.numerical

ALGORITHMS = ["auto", "filterpy", *(name for name in FORMS if name != "steady")]
properties = settings(deadline=None, max_examples=20, derandomize=True)
inf, nan = np.inf, np.nan
WALK = DiscreteModel(Phi=[[1]], Qd=[[1]], H=[[1]], R=[[1]], P0=[[10]])
#: Two states, two measurements, all that a discrete model may have but matrices that vary.
FULL = DiscreteModel(
    Phi=[[1.0, 0.5], [-0.2, 0.8]], Qd=[[0.4, 0.1], [0.1, 0.6]], H=[[1.0, 0.3], [0.2, 1.0]], R=[[0.5, 0.1], [0.1, 0.7]],
    x0=[1.0, -1.0], P0=[[2.0, 0.3], [0.3, 1.0]], dt=0.5, N=[[0.1, 0.0], [0.05, 0.1]], B=[[0.3], [1.0]], D=[[0.5], [-0.2]],
    offset=[0.1, -0.3], measurement_offset=[2.0, -1.0],
)  # fmt: skip
PUSH = np.array([[0.3], [-1.0], [0.5], [2.0], [-0.4]])
DATA = np.random.default_rng(1).normal(size=(5, 2))


def agree(found, wanted, tolerance=EXACT, names=("x_minus", "x_plus", "P_minus", "P_plus"), size=0.0):
    """Whether two filters say the same."""
    return all(close(getattr(found, name), getattr(wanted, name), tolerance, size) for name in names)


# The index rule -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_one_row_is_one_measurement(algorithm):
    """z = 5, 5, 5 from P0 = 10: by hand, at t1, t2, t3, or at t0, t1, t2; online the same."""
    for first, wanted in ((1, [55 / 12, 34 / 7, 460 / 93]), (0, [50 / 11, 155 / 32, 84 / 17])):
        found = kalman_filter(WALK, [5, 5, 5], first=first, algorithm=algorithm)
        online = Filter(WALK, algorithm=algorithm, first=first)
        assert (found.steps, found.x_plus.shape) == (2 + first, (3 + first, 1))
        assert found.used[:, 0].tolist() == [False] * first + [True] * 3
        assert close(found.x_plus[first:, 0], wanted, EXACT)
        assert close([online.step(5.0).x_plus[0] for _ in range(3)], wanted, EXACT)
        assert (online.k, online.t) == (found.steps, found.t[-1])
    assert close(kalman_filter(WALK, [5, 5, 5], algorithm=algorithm).x_plus[1:, 0], [4.5833, 4.8571, 4.9462], 2e-5)


def test_the_steady_gain_counts_as_all_do():
    """A row for each measurement from t1 on, online too."""
    found, online = kalman_filter(WALK, [5, 5, 5], algorithm="steady"), Filter(WALK, algorithm="steady")
    assert found.steps == 3
    assert close([online.step(5.0).x_plus[0] for _ in range(3)], found.x_plus[1:, 0], EXACT)


def test_a_model_says_when_its_first_measurement_comes():
    """Its own ``first`` holds where a call says nothing."""
    at_t0 = dataclasses.replace(WALK, first=0)
    assert agree(kalman_filter(at_t0, [5, 5]), kalman_filter(WALK, [5, 5], first=0))
    assert agree(kalman_filter(at_t0, [5, 5], first=1), kalman_filter(WALK, [5, 5]))
    assert log_likelihood(at_t0, [5, 5]) == kalman_filter(at_t0, [5, 5]).log_likelihood
    assert Filter(at_t0).step(5.0).t == 0.0
    assert covariances(at_t0, 2).used.all()


# Engines --------------------------------------------------------------------------------------------------------------


@properties
@given(discrete_models(stable=None), seeds, st.sampled_from([0.0, 0.3]), st.integers(0, 1))
def test_engines_agree(model, seed, gaps, first):
    """The compiled loop, the form ``joseph`` step by step and filterpy, on a record, an ensemble, and without data."""
    rng = np.random.default_rng(seed)
    z = record(model, 5, rng, gaps, first)[first:]
    size = max(np.abs(model.Qd).max(), np.abs(model.P0).max())
    runs = np.stack([z, 2 * z, np.where(np.isnan(z), nan, 1.0)], axis=2)
    wanted = kalman_filter(model, z, first=first, algorithm="filterpy")
    names = ("x_minus", "x_plus", "P_minus", "P_plus", "S", "innovation", "nis")
    step_by_step = driver.run(pose(model, z, first=first), "joseph")[0]
    compiled = kalman_filter(model, z, first=first)
    assert compiled.algorithm in ("joseph", "array")  # square roots, where known and unknown states are correlated to rounding
    for found in (compiled, without_runs(step_by_step)):
        assert agree(found, wanted, EXACT, names, size)
        assert close(found.log_likelihood, wanted.log_likelihood, EXACT, z.size)
    for algorithm in ("auto", "joseph", "filterpy"):
        together = kalman_filter(model, runs, first=first, algorithm=algorithm)
        for run in range(3):
            alone = kalman_filter(model, runs[:, :, run], first=first, algorithm="filterpy")
            assert close(together.x_plus[:, :, run], alone.x_plus, EXACT)
            assert close(together.nis[:, run], alone.nis, EXACT, 1.0)
            assert close(together.log_likelihood[run], alone.log_likelihood, EXACT, z.size)
        assert agree(together, wanted, EXACT, ("P_minus", "P_plus", "S"), size)
        if not gaps:
            plan = covariances(model, 5, first=first, algorithm=algorithm)
            assert agree(plan, wanted, EXACT, ("P_minus", "P_plus", "S"), size)
            assert close(plan.K, wanted.K, SOLVER)


# Known inputs, and H and R that come with the data --------------------------------------------------------------------


def by_hand(model, z, u, u0, H, R, first):
    """The time-varying model without inputs of the same record, and the record by instants without what they bring."""
    rows, before = len(z), u[:-1] if first == 0 else np.vstack([u0, u[:-1]])
    c = np.zeros(model.n) if model.offset is None else model.offset
    seen = u @ model.D.T + model.measurement_offset
    both = [np.concatenate([M[:first], M]) for M in (H, R)]
    steps = rows - 1 + first
    plain = DiscreteModel(
        np.tile(model.Phi, (steps, 1, 1)), model.Qd, *both, x0=model.x0, P0=model.P0, N=model.N, offset=c + before @ model.B.T
    )
    return plain, np.vstack([np.full((first, model.m), nan), z - seen])


@properties
@given(seed=seeds, first=st.integers(0, 1), coupled=st.booleans(), r=st.integers(1, 2))
def test_known_inputs_act_from_their_row_to_the_next(seed, first, coupled, r):
    """B, D, u0, a measurement offset, H and R for each row, N and gaps: conditioning of the model written out by hand; online too."""
    rng = np.random.default_rng(seed)
    n, m, rows = int(rng.integers(1, 4)), int(rng.integers(1, 3)), 4
    N = 0.1 * rng.normal(size=(n, m)) if coupled else None
    model = DiscreteModel(
        transition(rng, n, True), covariance(rng, n) + np.eye(n), rng.normal(size=(m, n)), np.eye(m), x0=rng.normal(size=n),
        P0=covariance(rng, n), N=N, B=rng.normal(size=(n, r)), D=rng.normal(size=(m, r)), offset=rng.normal(size=n),
        measurement_offset=rng.normal(size=m),
    )  # fmt: skip
    z, u, u0 = rng.normal(size=(rows, m)), rng.normal(size=(rows, r)), rng.normal(size=r)
    z[rng.uniform(size=z.shape) < 0.2] = nan
    H, R = rng.normal(size=(rows, m, n)), np.array([covariance(rng, m) + np.eye(m) for _ in range(rows)])
    plain, data = by_hand(model, z, u, u0, H, R, first)
    wanted = reference.conditioned(plain, data, first)
    start = {"u0": u0} if first else {}
    for algorithm in ALGORITHMS:
        found = kalman_filter(model, z, first=first, u=u, H=H, R=R, algorithm=algorithm, **start)
        assert agree(found, wanted, 1e-10), algorithm
    found = kalman_filter(model, z, first=first, u=u, H=H, R=R, **start)
    assert close(found.log_likelihood, reference.log_likelihood(plain, data, first), EXACT, 1.0)
    other = kalman_filter(model, z, first=first, u=1.05 * u, H=H, R=R, **start)
    assert not agree(other, wanted, 1e-4)
    online = Filter(model, first=first, **start)
    for i in range(rows):
        estimate = online.step(z[i], u=u[i], H=H[i], R=R[i])
        assert close(estimate.x_plus, found.x_plus[i + first], EXACT, 1.0)
        assert close(estimate.P_plus, found.P_plus[i + first], EXACT)
    assert close(online.log_likelihood, found.log_likelihood, EXACT, 1.0)


def test_a_constant_input_acts_from_t0():
    """(r,) is the same u in every row, and from t0 on."""
    found = kalman_filter(FULL, DATA, u=[0.7])
    assert agree(found, kalman_filter(FULL, DATA, u=np.full((5, 1), 0.7), u0=[0.7]))
    assert not close(found.x_plus, kalman_filter(FULL, DATA, u=[0.8]).x_plus, 1e-3)


def test_records_of_one_kind_share_their_input():
    """An ensemble with u is its records with u."""
    runs = np.stack([DATA, -DATA], axis=2)
    together = kalman_filter(FULL, runs, u=PUSH, u0=[1.0])
    for run in range(2):
        alone = kalman_filter(FULL, runs[:, :, run], u=PUSH, u0=[1.0])
        assert close(together.x_plus[:, :, run], alone.x_plus, EXACT)


def test_one_matrix_is_the_same_for_every_row():
    """H and R (m, n), (m, m) replace the model's."""
    H, R = [[2.0, 0.0], [0.0, 1.0]], np.diag([3.0, 1.0])
    found = kalman_filter(FULL, DATA, u=PUSH, u0=[1.0], H=H, R=R)
    assert agree(found, kalman_filter(dataclasses.replace(FULL, H=H, R=R), DATA, u=PUSH, u0=[1.0]))
    assert agree(found, kalman_filter(FULL, DATA, u=PUSH, u0=[1.0], H=[H] * 5, R=[R] * 5))


# Continuous models ----------------------------------------------------------------------------------------------------


@properties
@given(continuous_models(correlated=False, singular=False, max_n=3), seeds, st.integers(0, 1))
def test_a_continuous_model_is_measured_at_any_times(model, seed, first):
    """Irregular times, with an input: the discrete models of the intervals, and the filter that is fed online."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.05, 1.0, size=4))
    t = t if first else t - t[0]
    R, z = covariance(rng, model.m), rng.normal(size=(4, model.m))
    z[1, 0] = nan
    h = np.diff(np.concatenate([[0.0], t]) if first else t)
    pieces = [discretise(model, each, R) for each in h]
    driven = {} if model.B is None else {"u": rng.normal(size=(4, model.r))}
    start = {"u0": rng.normal(size=model.r)} if driven and first else {}
    c = np.zeros((len(h), model.n))
    if driven:
        before = np.vstack([start["u0"], driven["u"][:-1]]) if first else driven["u"][:-1]
        c = np.array([piece.B @ each for piece, each in zip(pieces, before, strict=True)])
    whole = dataclasses.replace(
        pieces[0], Phi=np.array([p.Phi for p in pieces]), Qd=np.array([p.Qd for p in pieces]), B=None, offset=c
    )
    found, wanted = kalman_filter(model, z, t=t, R=R, **driven, **start), kalman_filter(whole, z, first=first)
    assert agree(found, wanted)
    assert np.array_equal(found.t[first:], t)
    assert found.t[0] == 0.0
    online = Filter(model, R=R, first=first, **start)
    for i in range(4):
        estimate = online.step(z[i], t[i], **{name: value[i] for name, value in driven.items()})
        assert close(estimate.x_plus, found.x_plus[i + first], EXACT, 1.0)
        assert close(estimate.P_plus, found.P_plus[i + first], EXACT)
    smoothed, by_pieces = smooth(model, z, t=t, R=R, **driven, **start), smooth(whole, wanted)
    assert close(smoothed.x, by_pieces.x, SOLVER)


def test_equal_intervals_are_a_period():
    """t = dt, 2dt …: the discretised model, whose D and offset the continuous one has as well."""
    model = ContinuousModel(
        [[0, 1], [-1, -0.4]], [[0], [1]], [[0.3]], [[1, 0]], P0=np.eye(2), B=[[0], [2]], D=[[0.5]], measurement_offset=[3.0]
    )
    z, u = DATA[:, :1], PUSH
    found = kalman_filter(model, z, t=0.2 * np.arange(1, 6), R=[[0.1]], u=u, u0=[1.0])
    assert agree(found, kalman_filter(discretise(model, 0.2, R=[[0.1]]), z, u=u, u0=[1.0]))


# Models of other kinds ------------------------------------------------------------------------------------------------


class Spinning:
    """A model of the protocol that is no DiscreteModel: it turns ever faster, and is seen from ever farther."""

    n, m, dt, first = 2, 1, 0.5, 1
    x0, P0 = np.array([1.0, 0.0]), np.eye(2)
    states, measurements = ("east", "north"), ("z",)

    def motion(self, k):
        """Φ, c and Qd from k to k+1."""
        angle = 0.1 * k
        Phi = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        return Phi, np.array([0.0, 0.1 * k]), 0.1 * np.eye(2)

    def measurement(self, k):
        """H, R and N at k."""
        return np.array([[1.0, 0.5]]), np.array([[1.0 + k]]), None


def test_any_object_of_the_protocol_is_a_model():
    """motion(k) and measurement(k) are the matrices of a model that varies, for every algorithm and the smoother."""
    own, z = Spinning(), DATA[:, :1]
    assert isinstance(own, Model)
    assert isinstance(FULL, Model)
    Phi, c, Qd = (np.array(part) for part in zip(*map(own.motion, range(5)), strict=True))
    H, R = (np.array([own.measurement(k)[i] for k in range(6)]) for i in range(2))
    same = DiscreteModel(Phi, Qd, H, R, x0=own.x0, P0=own.P0, offset=c, dt=0.5)
    for algorithm in ALGORITHMS:
        found = kalman_filter(own, z, algorithm=algorithm)
        assert agree(found, kalman_filter(same, z, algorithm=algorithm))
    assert close(found.t, 0.5 * np.arange(6), EXACT)
    assert found.model.states == own.states
    assert close(smooth(own, z).x, smooth(same, z).x, EXACT)
    assert agree(kalman_filter(own, z, first=0), kalman_filter(same, z, first=0))


def test_a_linear_nonlinear_model_is_linear():
    """f and h that are linear: the extended filter is the filter, of a record and of an ensemble."""
    plain = dataclasses.replace(FULL, N=None, B=None, D=None, measurement_offset=None)
    model = NonlinearModel(
        lambda k, x, w: plain.Phi @ x + plain.offset[:, None] + w, lambda k, x, v: plain.H @ x + v, plain.Qd, plain.R,
        x0=plain.x0, P0=plain.P0, dt=0.5,
    )  # fmt: skip
    z = DATA.copy()
    z[2, 0], z[3] = nan, nan
    for first in (0, 1):
        found, wanted = kalman_filter(model, z, first=first), kalman_filter(plain, z, first=first)
        assert found.algorithm == "extended"
        assert agree(found, wanted, SOLVER, ("x_minus", "x_plus", "P_minus", "P_plus", "K", "S", "innovation", "t"))
        assert close(found.log_likelihood, wanted.log_likelihood, SOLVER)
        assert np.array_equal(found.used, wanted.used)
        assert close(found.nis, wanted.nis, SOLVER)
    runs = kalman_filter(model, np.stack([z, 2 * z], axis=2))
    assert close(runs.x_plus[:, :, 1], kalman_filter(plain, 2 * z).x_plus, SOLVER)
    assert close(runs.P_plus[..., 1], wanted.P_plus, SOLVER)


# Gains, and starts without information --------------------------------------------------------------------------------


def test_gains_of_the_same_filter_change_nothing_and_others_are_applied():
    """The optimal gains are those that the filter would use; a filter with other gains has larger errors, and keeps its own claims."""
    model = dataclasses.replace(FULL, B=None, D=None)
    own = covariances(model, 5)
    assert agree(kalman_filter(model, DATA, gains=own), kalman_filter(model, DATA))
    wrong = covariances(dataclasses.replace(model, Qd=4 * model.Qd), 5)
    found = kalman_filter(model, DATA, gains=wrong)
    assert np.array_equal(found.K, wrong.K)
    assert np.array_equal(found.P_plus, wrong.P_plus)
    assert not close(found.x_plus, kalman_filter(model, DATA).x_plus, 1e-3)
    assert close(found.x_plus[1], found.x_minus[1] + wrong.K[1] @ found.innovation[1], EXACT)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_from_no_information_the_first_measurement_is_the_estimate(algorithm):
    """P0 = inf: NaN until something is measured, then the measurement with its own variance; online too."""
    found = kalman_filter(WALK, [nan, 5.0, 6.0], P0=[[inf]], algorithm=algorithm)
    assert np.isnan(found.x_plus[:2]).all()
    assert np.isinf(found.P_plus[:2]).all()
    assert close(found.x_plus[2:, 0], [5.0, 5.0 + 2 / 3], EXACT)
    assert close(found.P_plus[2:, 0, 0], [1.0, 2 / 3], EXACT)
    last = -0.5 * (1 / 3 + np.log(2 * np.pi * 3))
    assert close(found.log_likelihood, last, EXACT)
    assert close(found.log_likelihood_diffuse, last - 0.5 * np.log(2 * np.pi), EXACT)
    online = Filter(WALK, algorithm=algorithm, P0=[[inf]])
    assert close([online.step(z).x_plus[0] for z in (nan, 5.0, 6.0)], found.x_plus[1:, 0], EXACT)


# What comes after, and what may have been -----------------------------------------------------------------------------


def test_a_forecast_is_the_filter_without_measurements():
    """The next rows as NaN: the same predictions, with inputs, N and gaps; of an ensemble too."""
    u = np.vstack([PUSH, [[0.9], [-0.6], [0.1]]])
    for z in (DATA, np.stack([DATA, -DATA], axis=2)):
        padded = np.concatenate([z, np.full((3, *z.shape[1:]), nan)])
        ahead = forecast(FULL, kalman_filter(FULL, z, u=u[:5], u0=[1.0]), 3, u=u[4:])
        wanted = kalman_filter(FULL, padded, u=u, u0=[1.0])
        assert close(ahead.x, wanted.x_minus[6:], EXACT)
        assert close(ahead.P, wanted.P_minus[6:], EXACT)
        assert close(ahead.t, wanted.t[6:], EXACT)
        seen = np.einsum("ij,kj...->ki...", FULL.H, wanted.x_minus[6:])
        known = u[5:] @ FULL.D.T + FULL.measurement_offset
        assert close(ahead.z, seen + known.reshape(known.shape + (1,) * (z.ndim - 2)), EXACT)
        assert close(ahead.S, FULL.H @ wanted.P_minus[6:] @ FULL.H.T + FULL.R, EXACT)


def test_draws_are_distributed_as_the_smoother_says():
    """Mean, covariance and the covariance of neighbours, within six standard deviations of 4000 draws; with inputs and a gap."""
    z, number = DATA.copy(), 4000
    z[2, 1] = nan
    found = kalman_filter(FULL, z, u=PUSH, u0=[1.0])
    told, drawn = smooth(FULL, found), draws(FULL, found, number, 3)
    assert drawn.shape == (6, 2, number)
    sd = np.sqrt(np.diagonal(told.P, axis1=1, axis2=2))
    assert (np.abs(drawn.mean(axis=2) - told.x) < 6 * sd / np.sqrt(number)).all()
    off = drawn - told.x[:, :, None]
    spread = off @ off.transpose(0, 2, 1) / number
    assert (np.abs(spread - told.P) < 6 * np.sqrt(2 / number) * sd[:, :, None] * sd[:, None, :]).all()
    beside = off[1:] @ off[:-1].transpose(0, 2, 1) / number
    assert (np.abs(beside - told.lag_one[1:]) < 6 * np.sqrt(2 / number) * sd[1:, :, None] * sd[:-1, None, :]).all()


# Online ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("algorithm", ["auto", "ud", "array"])
@pytest.mark.parametrize("late", [[0], [1, 3], [3, 2, 0]])
def test_late_saved_and_driven_it_is_the_record(algorithm, late, tmp_path):
    """u, H and R with each step, measurements that come late with their H and R, and a saved filter that goes on."""
    rng = np.random.default_rng(5)
    H, R = rng.normal(size=(5, 2, 2)), np.array([covariance(rng, 2) + np.eye(2) for _ in range(5)])
    wanted = kalman_filter(FULL, DATA, u=PUSH, u0=[1.0], H=H, R=R, algorithm=algorithm)
    online = Filter(FULL, algorithm=algorithm, u0=[1.0], memory=5)
    for i in range(5):
        if i in late:
            online.step(None, u=PUSH[i])
        else:
            online.step(DATA[i], u=PUSH[i], H=H[i], R=R[i])
        if i == 2:
            online.save(tmp_path / "filter")
            online = Filter.load(tmp_path / "filter")
    for i in late:
        online.step(DATA[i], 0.5 * (i + 1), H=H[i], R=R[i])
    assert close(online.estimate.x_plus, wanted.x_plus[-1], EXACT)
    assert close(online.estimate.P_plus, wanted.P_plus[-1], EXACT)
    assert close(online.log_likelihood, wanted.log_likelihood, EXACT)


# Refusals -------------------------------------------------------------------------------------------------------------

PLANT = ContinuousModel([[0]], [[1]], [[1]], [[1]], P0=[[1]])
PUSHED = dataclasses.replace(FULL, D=None)
BENT = NonlinearModel(lambda k, x, w: x + w, lambda k, x, v: x + v, np.eye(1), np.eye(1), np.zeros(1), np.eye(1))
REFUSED = {
    "no model": (lambda: kalman_filter("walk", [1]), TypeError, "expected a DiscreteModel, a ContinuousModel or a NonlinearModel"),
    "no row": (lambda: kalman_filter(WALK, []), ValueError, r"z: expected shape \(rows, 1\)"),
    "a wrong width": (lambda: kalman_filter(FULL, [[1.0]], u=[1.0]), ValueError, r"z: expected shape \(rows, 2\) or"),
    "times of a period": (lambda: kalman_filter(WALK, [1], t=[1]), ValueError, r"t: expected none .*period \(dt = 1 s\)"),
    "no times": (lambda: kalman_filter(PLANT, [1], R=[[1]]), ValueError, "t: expected the times of the rows of z, in s"),
    "times that go back": (lambda: kalman_filter(PLANT, [1, 1], t=[1, 1], R=[[1]]), ValueError, r"t\[1\]: expected increasing times"),
    "times before t0": (lambda: kalman_filter(PLANT, [1], t=[-1], R=[[1]]), ValueError, r"t\[0\]: expected increasing times from t0"),
    "times against first": (lambda: kalman_filter(PLANT, [1], t=[0], R=[[1]], first=1), ValueError, r"first: expected 0, as t\[0\]"),
    "no noise": (lambda: kalman_filter(PLANT, [1], t=[1]), ValueError, r"R: expected the covariance .*: pass R"),
    "no input": (lambda: kalman_filter(FULL, DATA), ValueError, r"u: expected the known input, \(5, 1\) or \(1,\), as the model has B"),
    "no input before": (lambda: kalman_filter(FULL, DATA, u=PUSH), ValueError, r"u0: expected the input from t0 .*\(first=1"),
    "an input that cannot act": (
        lambda: kalman_filter(FULL, DATA, u=PUSH, u0=[1], first=0), ValueError, r"u0: expected none \(nothing moves between",
    ),
    "an input without B": (lambda: kalman_filter(WALK, [1], u=[1]), ValueError, "u: expected a model with B or D"),
    "inputs of another length": (lambda: kalman_filter(PUSHED, DATA, u=PUSH[:3], u0=[1]), ValueError, r"u: expected shape \(5, 1\)"),
    "R of another length": (lambda: kalman_filter(WALK, [1, 2], R=np.ones((3, 1, 1))), ValueError, "R: expected one matrix, or 2 as z"),
    "H of another shape": (lambda: kalman_filter(WALK, [1, 2], H=[[1, 2]]), ValueError, r"H: expected shape \(1, 1\)"),
    "an unknown algorithm": (lambda: kalman_filter(WALK, [1], algorithm="kalman"), ValueError, "algorithm: expected one of auto"),
    "gains of another length": (
        lambda: kalman_filter(WALK, [1], gains=covariances(WALK, 4)), ValueError, r"gains: expected gains of shape \(2, 1, 1\)",
    ),
    "a form of a curve": (lambda: kalman_filter(BENT, [1], algorithm="ud"), ValueError, "algorithm: expected auto or extended"),
    "R of a curve": (lambda: kalman_filter(BENT, [1], R=[[1]]), ValueError, r"R: expected none with a NonlinearModel"),
    "a forecast of nothing": (
        lambda: forecast(WALK, kalman_filter(WALK, [nan], P0=[[inf]]), 2), ValueError, "filtered: expected a record that determines",
    ),
    "a forecast without its input": (
        lambda: forecast(FULL, kalman_filter(FULL, DATA, u=[1.0]), 2), ValueError, r"u: expected the known input, \(3, 1\) or \(1,\)",
    ),
    "draws of many": (lambda: draws(WALK, kalman_filter(WALK, np.ones((3, 1, 2))), 5, 1), ValueError, "filtered: expected one record"),
}  # fmt: skip


@pytest.mark.parametrize(("call", "error", "message"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_filtered_is_refused(call, error, message):
    """In one line, with what to do."""
    with pytest.raises(error, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)
    assert "expected" in str(caught.value)
