"""The online filter: a stream is a record, whatever its order, its gaps and its interruptions."""

from __future__ import annotations

import dataclasses
import json
import pickle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ctlabs.filtering import kalman_filter
from ctlabs.filtering.algorithms.catalogue import FORMS
from ctlabs.filtering.online import Filter, files, plants
from ctlabs.filtering.results import FilteredRow
from ctlabs.models import ContinuousModel, DiscreteModel
from ctlabs.models.discretisation import discretise
from tests import reference
from tests.reference import EXACT, SOLVER, broken, close
from tests.strategies import continuous_models, discrete_models, record

pytestmark = pytest.mark.numerical

OPTIMAL = [name for name in FORMS if name != "steady"]
INFORMATION = ("information", "srif")
#: The forms that take R = 0.
PERFECT = [name for name in OPTIMAL if name not in (*INFORMATION, "extended_array")]
WHEEL = ContinuousModel(
    F=[[0, 1], [0, -0.5]],
    B=[[0], [1]],
    G=[[0], [1]],
    Q=[[0.02]],
    H=[[1, 0], [0.5, 1]],
    x0=[0.1, -0.2],
    P0=[[0.25, 0.01], [0.01, 1]],
    states=["angle", "rate"],
    units=["rad", "rad/s"],
)
NOISE = [[0.01, 0.002], [0.002, 0.04]]
#: Without its known input.
COASTING = dataclasses.replace(WHEEL, B=None)
MODEL = discretise(COASTING, 0.25, R=NOISE)
WALK = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]], dt=0.5)


def streamed(online, z, first=1):
    """The estimates after every row of a record, that is given by instants."""
    return [online.step(row) for row in z[first:]]


#: What a row has, in the order of :func:`values`.
FIELDS = [field.name for field in dataclasses.fields(FilteredRow)]


def values(estimate):
    """All that a row holds, as arrays of numbers."""
    return [np.asarray(part, dtype=float) for part in dataclasses.astuple(estimate)]


def same(a, b):
    """Whether two filters agree in every bit that can be read, and in all that they remember."""
    seen = [(f.t, f.k, f.log_likelihood, *values(f.estimate)) for f in (a, b)]
    kept = [[np.asarray(leaf) for instant in f._past for leaf in files.leaves(instant)] for f in (a, b)]
    pairs = [*zip(*seen, strict=True), *zip(*kept, strict=True)]
    return all(np.array_equal(x, y, equal_nan=True) for x, y in pairs)


# A stream is a record ----------------------------------------------------------------------------------------------------


@settings(deadline=None, max_examples=25, derandomize=True)
@given(model=discrete_models(), seed=st.integers(0, 10**6), first=st.sampled_from([0, 1]))
def test_a_stream_is_a_record(model, seed, first):
    """Step by step every form gives what it gives on the whole record: estimates, innovations, NIS and likelihood."""
    z = record(model, 5, np.random.default_rng(seed), gaps=0.2, first=first)
    for form in OPTIMAL:
        try:
            wanted = kalman_filter(model, z[first:], first=first, algorithm=form)
        except ValueError as refusal:
            with pytest.raises(ValueError, match=str(refusal)[:30]):
                streamed(Filter(model, algorithm=form, first=first), z, first)
            continue
        online = Filter(model, algorithm=form, first=first)
        found = streamed(online, z, first)
        for k, estimate in enumerate(found, start=first):
            assert close(estimate.t, wanted.t[k], EXACT)
            for field, own, batch in zip(FIELDS, values(estimate), values(wanted.row(k)), strict=True):
                terms = 1.0 if field == "nis" else 0.0  # a small innovation is a difference, and its square in units of its variance
                assert close(own, batch, EXACT, terms), f"{form}: {field}"
        assert close(online.log_likelihood, wanted.log_likelihood, EXACT)


@settings(deadline=None, max_examples=25, derandomize=True)
@given(model=discrete_models(), seed=st.integers(0, 10**6))
def test_the_compiled_step_is_the_forms(model, seed):
    """Square roots in the compiled loop and in NumPy: the same rows, for constant and varying models, with gaps, inputs and N."""
    z = record(model, 6, np.random.default_rng(seed), gaps=0.2)
    looped, plain = Filter(model), Filter(model)
    plain._stepper._loops = None
    for row in z[1:]:
        for own, other in zip(values(looped.step(row)), values(plain.step(row)), strict=True):
            assert close(own, other, EXACT)
    assert close(looped.log_likelihood, plain.log_likelihood, EXACT)


def lossy(seed, T=30):
    """Three good sensors of two states that noise drives together: Joseph's form keeps six digits of the estimates, square roots all."""
    rng = np.random.default_rng(seed)
    Qd = np.outer([31.0, 0.85], [31.0, 0.85]) + 1e-3 * np.eye(2)
    H, R = rng.normal(size=(3, 2)), np.diag([1e-6, 2e-6, 4e-6])
    z = rng.normal(size=(T, 3))
    z[rng.random((T, 3)) < 0.1] = np.nan
    return DiscreteModel(0.5 * rng.normal(size=(2, 2)), Qd, H, R, P0=np.eye(2)), z


@pytest.mark.parametrize("seed", range(4))
def test_square_roots_take_over_where_digits_would_be_lost(seed, tmp_path):
    """As over a record: the stream is the record to 1e-8 standard deviations, also when it was saved, and when data are late."""
    model, z = lossy(seed)
    record = kalman_filter(model, z)
    assert record.algorithm == "array"
    sd = np.sqrt(np.diagonal(record.P_plus[1:], axis1=1, axis2=2))
    online = Filter(model, memory=3)
    rows = []
    for k, row in enumerate(z):
        late = k % 7 == 3 and not np.isnan(row[0])
        online.step([np.nan, *row[1:]] if late else row)
        if late:  # it comes an instant later
            online.step(None)
            online.step([row[0], np.nan, np.nan], t=float(k + 1))
            online = Filter.load(online.save(tmp_path / "filter.npz") or tmp_path / "filter.npz")
            break
        rows.append(online.estimate.x_plus)
    assert (np.abs(np.array(rows) - record.x_plus[1 : len(rows) + 1]) < 1e-8 * sd[: len(rows)]).all()
    late = kalman_filter(model, [*z[: k + 1], [np.nan] * 3])
    assert (np.abs(online.estimate.x_plus - late.x_plus[-1]) < 1e-8 * np.sqrt(np.diag(late.P_plus[-1]))).all()
    for row in z[k + 2 :]:
        online.step(row)
    whole = kalman_filter(model, [*z[: k + 1], [np.nan] * 3, *z[k + 2 :]])
    assert (np.abs(online.estimate.x_plus - whole.x_plus[-1]) < 1e-8 * np.sqrt(np.diag(whole.P_plus[-1]))).all()
    assert online.log_likelihood == pytest.approx(float(whole.log_likelihood), rel=1e-9)


def test_one_perfect_measurement_among_others_is_one():
    """R = 0 of one measurement alone: what it determines is known from there on, as in a record with that R."""
    model = DiscreteModel([[1, 1], [0, 1]], [[0, 0], [0, 1]], [[1, 0]], [[0.5]], P0=np.eye(2))
    z = np.array([0.3, 1.0, 2.5, 2.0, 4.0, 3.5])
    R = np.full((7, 1, 1), 0.5)
    R[3] = 0.0
    record = kalman_filter(dataclasses.replace(model, R=R), z)
    online = Filter(model)
    for k, value in enumerate(z, 1):
        row = online.step(value, R=[[0.0]] if k == 3 else None)
        assert close(row.x_plus, record.x_plus[k], EXACT)
        assert close(row.P_plus, record.P_plus[k], EXACT)
    assert online.log_likelihood == pytest.approx(float(record.log_likelihood), rel=1e-12)


def test_a_stream_of_another_model_is_another():
    """The comparison above notices 5 % in one element of a model."""
    z = record(MODEL, 5, np.random.default_rng(1))
    wanted = kalman_filter(MODEL, z[1:], algorithm="joseph")
    for name in ("Phi", "Qd", "R"):
        other = dataclasses.replace(MODEL, **{name: broken(getattr(MODEL, name), (1, 1))})
        found = streamed(Filter(other), z)
        assert not close(found[-1].P_plus, wanted.P_plus[-1], SOLVER)


def test_the_steady_gain_streams_too():
    """The form ``steady`` as on a record; a missing measurement it refuses, and stays where it was."""
    z = record(MODEL, 6, np.random.default_rng(2))
    wanted, online = kalman_filter(MODEL, z[1:], algorithm="steady"), Filter(MODEL, algorithm="steady")
    for k, estimate in enumerate(streamed(online, z), start=1):
        assert np.array_equal(estimate.x_plus, wanted.x_plus[k])
        assert np.array_equal(estimate.P_plus, wanted.P_plus[k])
    before = online.estimate
    with pytest.raises(ValueError, match="form steady: expected 2 measured elements"):
        online.step([0.1, None])
    assert all(np.array_equal(a, b) for a, b in zip(values(before), values(online.estimate), strict=True))


@settings(deadline=None, max_examples=15, derandomize=True)
@given(model=discrete_models(), seed=st.integers(0, 10**6))
def test_its_likelihood_is_that_of_the_joint_density(model, seed):
    """Summed step by step, with late elements, it is the logarithm of the density of all that was measured."""
    z = record(model, 4, np.random.default_rng(seed), gaps=0.2)
    online = Filter(model, memory=1)
    for row in z[1:]:
        t = online.step(np.where(np.arange(model.m) == 0, row, np.nan)).t
        online.step(np.where(np.arange(model.m) != 0, row, np.nan), t)
    assert close(online.log_likelihood, reference.log_likelihood(model, z), SOLVER)


@pytest.mark.parametrize("form", PERFECT)
def test_perfect_measurements_of_what_is_known_are_left_out_as_in_a_record(form):
    """R = 0 and the same thing measured twice: K = 0, no 0/0; as on the record."""
    twice = dataclasses.replace(MODEL, H=[[1, 0], [1, 0]], R=np.zeros((2, 2)), P0=np.zeros((2, 2)))
    z = np.repeat(record(twice, 4, np.random.default_rng(3))[:, :1], 2, axis=1)
    wanted, online = kalman_filter(twice, z[1:], algorithm=form), Filter(twice, algorithm=form)
    for k, estimate in enumerate(streamed(online, z), start=1):
        assert close(estimate.x_plus, wanted.x_plus[k], EXACT)
        assert close(estimate.P_plus, wanted.P_plus[k], EXACT)
        assert np.array_equal(np.isnan(estimate.innovation), ~wanted.used[k])
    assert not wanted.used[1:].all()


@pytest.mark.parametrize("form", [name for name in FORMS if name != "steady"])
@pytest.mark.parametrize("size", [np.inf, 1e14])
def test_a_stream_may_begin_with_little_or_no_information(form, size, tmp_path):
    """P0 = inf: NaN and inf until a state is known, then as on the record; a saved filter goes on from any instant."""
    model = dataclasses.replace(MODEL, H=[[1, 0]], R=[[0.01]], measurements=None, measurement_units=None)
    z = record(model, 5, np.random.default_rng(4))
    z[2] = np.nan
    P0 = np.diag([size, size])
    wanted, online = kalman_filter(model, z[1:], algorithm=form, P0=P0), Filter(model, algorithm=form, P0=P0, memory=2)
    assert np.isnan(online.estimate.x_plus).all() == np.isinf(size)
    for k in range(1, 6):
        estimate = online.step(z[k])
        assert close(estimate.x_plus, wanted.x_plus[k], EXACT)
        assert close(estimate.P_plus, wanted.P_plus[k], EXACT)
        online.save(tmp_path / "filter.npz")
        online = Filter.load(tmp_path / "filter.npz")
    assert np.isfinite(online.estimate.x_plus).all()
    assert close(online.log_likelihood, wanted.log_likelihood, EXACT)
    assert close(online.log_likelihood_diffuse, wanted.log_likelihood_diffuse, EXACT)


def test_a_perfect_stream_may_begin_without_information():
    """R = 0 and P0 = inf: a random walk is known from its first value on, and what is known already is left out."""
    model = DiscreteModel([[1, 0], [0, 1]], np.diag([1.0, 0.0]), np.eye(2), np.zeros((2, 2)), x0=[0, 0], P0=np.diag([np.inf] * 2))
    z = np.array([[np.nan, np.nan], [2.0, np.nan], [3.0, 5.0], [4.0, 5.0]])
    wanted, online = kalman_filter(model, z[1:]), Filter(model)
    for k in range(1, 4):
        assert close(online.step(z[k]).x_plus, wanted.x_plus[k], EXACT)
    assert online.estimate.P_plus.tolist() == np.zeros((2, 2)).tolist()
    assert wanted.used[3].tolist() == [True, False]
    assert close(online.log_likelihood_diffuse, wanted.log_likelihood_diffuse, EXACT)


@settings(deadline=None, max_examples=20, derandomize=True)
@given(
    model=continuous_models(correlated=False, driven=False, singular=False),
    seed=st.integers(0, 10**6),
    form=st.sampled_from(("joseph", "potter", "ud")),
)
def test_irregular_times_are_discretised_interval_by_interval(model, seed, form):
    """A continuous model measured at any times is the discrete model of these intervals."""
    rng = np.random.default_rng(seed)
    t = 3.0 + np.concatenate([[0], np.cumsum(rng.uniform(0.01, 1.0, size=5))])
    R = np.eye(model.m) + 0.1
    pieces = [discretise(model, h, R) for h in np.diff(t)]
    whole = dataclasses.replace(pieces[0], Phi=np.array([p.Phi for p in pieces]), Qd=np.array([p.Qd for p in pieces]))
    z = record(whole, 5, rng, gaps=0.2)
    wanted, online = reference.recursion(whole, z), Filter(model, algorithm=form, R=R, t0=3.0)
    for k in range(1, 6):
        estimate = online.step(z[k], t[k])
        assert (estimate.t, online.k) == (t[k], k)
        assert close(estimate.x_plus, wanted.x_plus[k], SOLVER)
        assert close(estimate.P_plus, wanted.P_plus[k], SOLVER)
    regular = reference.recursion(dataclasses.replace(whole, Phi=whole.Phi[0], Qd=whole.Qd[0]), z)
    assert not close(estimate.P_plus, regular.P_plus[-1], SOLVER)


def test_a_known_input_acts_from_its_instant_until_the_next():
    """u in step is the input from then on, and u0 that from t0, as in the offsets of discretise; without one it is refused."""
    z, u = record(MODEL, 4, np.random.default_rng(5)), np.array([[0.3], [-0.2], [0.0], [1.0], [7.0]])
    wanted = kalman_filter(discretise(WHEEL, 0.25, NOISE, u=u[:4]), z[1:])
    periodic = discretise(WHEEL, 0.25, NOISE)
    for online in (Filter(WHEEL, R=NOISE, u0=u[0]), Filter(periodic, u0=u[0])):
        for k in range(1, 5):
            found = online.step(z[k], 0.25 * k, u=u[k])  # the last acts on nothing yet
            assert close(found.x_plus, wanted.x_plus[k], EXACT)
            assert close(found.P_plus, wanted.P_plus[k], EXACT)
    late = Filter(WHEEL, R=NOISE, u0=0.05 + u[0])
    assert not close(late.step(z[1], 0.25, u=u[1]).x_plus, wanted.x_plus[1], SOLVER)
    with pytest.raises(ValueError, match=r"u: expected the known input, \(1,\), as the model has B; received None"):
        late.step(z[2], 0.5)
    with pytest.raises(ValueError, match=r"u: expected none with a measurement at 0.25 s \(now is 0.25 s\), received one"):
        late.step(None, 0.25, u=[1.0])
    with pytest.raises(ValueError, match=r"u0: expected the known input from t0 to the first measurement .*, received None"):
        Filter(WHEEL, R=NOISE).step(z[1], 0.25, u=u[1])


def test_the_input_from_t0_may_come_with_a_step_to_t0():
    """A step without a measurement at t0 says what acts from there on; a first measurement there takes its own."""
    z, u = record(MODEL, 2, np.random.default_rng(5)), [[0.3], [-0.2], [0.0]]
    one, other = Filter(WHEEL, R=NOISE, u0=u[0]), Filter(WHEEL, R=NOISE)
    other.step(None, 0.0, u=u[0])
    assert close(one.step(z[1], 0.25, u=u[1]).x_plus, other.step(z[1], 0.25, u=u[1]).x_plus, EXACT)
    at_t0, wanted = Filter(WHEEL, R=NOISE, first=0), kalman_filter(WHEEL, z[1:], t=[0.0, 0.25], R=NOISE, u=u[:2])
    at_t0.step(z[1], u=u[0])
    assert close(at_t0.step(z[2], 0.25, u=u[1]).x_plus, wanted.x_plus[1], EXACT)


def test_equal_intervals_are_discretised_once(monkeypatch):
    """Each of two intervals is computed once; and no more than so many are kept."""
    asked = []
    compute = plants.interval
    monkeypatch.setattr(plants, "interval", lambda F, W, h: asked.append(h) or compute(F, W, h))
    online = Filter(COASTING, R=NOISE)
    for t in np.cumsum([0.25, 0.5] * 10):
        online.step(None, t)
    assert asked == [0.25, 0.5]
    for h in np.linspace(1, 2, 3 * plants.CACHED):
        online.step(None, online.t + h)
    assert len(online._plant._kept) <= plants.CACHED


def test_skipped_instants_are_predictions():
    """A discrete model taken two periods ahead predicts twice; a time within rounding of an instant is that instant."""
    z = np.array([np.nan, np.nan, 1.0, np.nan, 3.0])[:, None]
    wanted, online = kalman_filter(WALK, z[1:], algorithm="joseph"), Filter(WALK, t0=10.0)
    online.step(1.0, 11.0 + 1e-9)
    assert (online.t, online.k) == (11.0, 2)
    assert close(online.step(3.0, 12.0).P_plus, wanted.P_plus[-1], EXACT)
    assert close(online.estimate.x_plus, wanted.x_plus[-1], EXACT)


def test_the_first_measurement_may_come_at_t0():
    """first=0: the first step is at t0, with or without its time; with first=1 a measurement there is refused."""
    a, b = Filter(WALK, first=0), Filter(WALK, first=0)
    a.step(1.0)
    b.step(1.0, 0.0)
    assert (a.k, a.t) == (0, 0.0)
    assert same(a, b)
    assert a.step(2.0).t == b.step(2.0).t == 0.5
    assert Filter(COASTING, R=NOISE, t0=2.0, first=0).step([1.0, 2.0]).t == 2.0
    with pytest.raises(
        ValueError, match=r"t: expected a first measurement after t0 = 0 s \(first=1\), received one at t0"
    ):
        Filter(WALK).step(1.0, 0.0)


# Late measurements -------------------------------------------------------------------------------------------------------


@settings(deadline=None, max_examples=25, derandomize=True)
@given(
    model=discrete_models(),
    seed=st.integers(0, 10**6),
    form=st.sampled_from(("joseph", "array", "ud")),
)
def test_late_elements_give_what_elements_in_order_give(model, seed, form):
    """Elements of a record in any order, within the memory: every bit is that of the record in order."""
    rng = np.random.default_rng(seed)
    z = record(model, 5, rng, gaps=0.1)
    ordered, late = Filter(model, algorithm=form, memory=5), Filter(model, algorithm=form, memory=5)
    streamed(ordered, z)
    late.step(z[5], 5 * model.dt)
    for k in rng.permutation(np.arange(1, 5)):
        for i in rng.permutation(model.m):
            late.step(np.where(np.arange(model.m) == i, z[k], np.nan), k * model.dt)
    assert same(late, ordered)
    if np.isfinite(z[2]).any():
        assert not same(late, _without(Filter(model, algorithm=form, memory=5), z, 2))


def _without(online, z, k):
    """A filter of a record that lacks row k."""
    z = z.copy()
    z[k] = np.nan
    streamed(online, z)
    return online


@settings(deadline=None, max_examples=15, derandomize=True)
@given(order=st.permutations([1, 2, 3, 4]), form=st.sampled_from(OPTIMAL))
def test_late_instants_of_a_continuous_model_are_inserted(order, form):
    """Measurements at irregular times, come in any order, with an input: every bit is that of the times in order."""
    t, z = np.array([0.0, 0.3, 0.7, 0.75, 1.9]), record(MODEL, 4, np.random.default_rng(6))
    ordered, late = (Filter(WHEEL, algorithm=form, R=NOISE, memory=4, u0=[0.4]) for _ in range(2))
    ordered.step(None, 2.0, u=[0.4])  # an input that is held while instants are inserted
    late.step(None, 2.0, u=[0.4])
    for k in (1, 2, 3, 4):
        ordered.step(z[k], t[k])
    for k in order:
        assert late.step(z[k], t[k]).t == 2.0
    assert late.k == 5
    assert same(late, ordered)
    direct = Filter(WHEEL, algorithm=form, R=NOISE, memory=4, u0=[0.4])
    for k in (1, 2, 3, 4):
        direct.step(z[k], t[k], u=[0.4])
    direct.step(None, 2.0, u=[0.4])
    assert same(late, direct)


def test_the_memory_has_its_end():
    """A measurement before the oldest instant kept is refused, and nothing has changed."""
    online = Filter(WALK, memory=2)
    for z in (1.0, None, 3.0, 4.0):
        online.step(z)
    before = online.estimate
    with pytest.raises(ValueError, match=r"t: expected a time not before 1 s \(now is 2 s, memory 2\), received 0.5"):
        online.step(2.0, 0.5)
    assert all(np.array_equal(a, b) for a, b in zip(values(before), values(online.estimate), strict=True))
    assert online.step(2.0, 1.0).t == 2.0
    none = Filter(WALK)
    none.step(1.0)
    with pytest.raises(ValueError, match=r"not before 0.5 s \(now is 0.5 s, memory 0\)"):
        none.step(1.0, 0.0)


def test_what_a_late_measurement_overflows_is_undone():
    """A replay that fails leaves the filter as it was."""
    z = np.zeros((4, 1))
    H = np.array([[[1.0]], [[1e200]], [[1.0]], [[1.0]]])
    online = Filter(DiscreteModel([[1]], [[1]], H, [[1]], x0=[0], P0=[[10]]), memory=3)
    online.step(None)
    online.step(z[2])
    before = online.estimate
    with pytest.raises(FloatingPointError, match=r"S: expected a covariance with digits left .*, received one at t = 1 s"):
        online.step([1.0], 1.0)
    assert all(np.array_equal(a, b) for a, b in zip(values(before), values(online.estimate), strict=True))
    assert online.step(z[3]).t == 3.0


# Saved and restored ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", OPTIMAL)
def test_a_restored_filter_continues_to_the_bit(form, tmp_path):
    """Saved in the middle, with a memory: what comes after, late or not, is the same in every bit."""
    z, path = record(MODEL, 8, np.random.default_rng(7), gaps=0.2), tmp_path / "filter.npz"
    online = Filter(MODEL, algorithm=form, t0=-3.0, memory=2)
    for row in z[1:5]:
        online.step(row)
    online.save(path)
    restored = Filter.load(path)
    assert same(restored, online)
    for one in (online, restored):
        one.step([None, 0.7] if np.isnan(z[3, 1]) else [0.7, None] if np.isnan(z[3, 0]) else None, -3.0 + 3 * 0.25)
        streamed(one, z[5:], 0)
    assert same(restored, online)
    assert restored._plant.model.states == MODEL.states


@settings(deadline=None, max_examples=20, derandomize=True)
@given(
    model=st.one_of(discrete_models(), continuous_models(correlated=False)),
    seed=st.integers(0, 10**6),
    form=st.sampled_from(("joseph", "srif", "ld")),
    perfect=st.booleans(),
)
def test_every_kind_of_model_is_saved(model, seed, form, perfect, tmp_path_factory):
    """Time-varying, correlated, with inputs, continuous, perfectly measured: all is in the file."""
    rng, path = np.random.default_rng(seed), tmp_path_factory.mktemp("saved") / "f"
    options = {}
    if isinstance(model, ContinuousModel):
        options = {"R": np.zeros((model.m, model.m)) if perfect and form != "srif" else np.eye(model.m)}
    try:
        online = Filter(model, algorithm=form, memory=1, first=0, **options)
    except ValueError as refusal:
        assert str(refusal).startswith("form srif: expected")  # noqa: PT017  # singular P0
        return
    u = {"u": np.ones(model.B.shape[1])} if options and model.B is not None else {}
    online.step(rng.normal(size=model.m), **u)
    try:
        online.step(rng.normal(size=model.m), online.t + (model.dt if not options else 0.3), **u)
        online.save(path)
        restored = Filter.load(path)
        for one in (online, restored):
            one.step(np.ones(model.m), one.t + (model.dt if not options else 0.4), **u)
    except ValueError as refusal:
        assert str(refusal).startswith("form srif: expected")  # noqa: PT017  # singular Phi
        return
    assert same(online, restored)


def test_the_steady_gain_is_saved_too(tmp_path):
    """Nested states and flags come back as they were."""
    online = Filter(MODEL, algorithm="steady")
    online.step([0.1, 0.2])
    online.save(tmp_path / "f")
    restored = Filter.load(tmp_path / "f")
    assert same(online, restored)
    assert type(restored._past[0].after) is type(online._past[0].after)
    assert restored._past[0].after.waiting is False


@pytest.fixture
def saved(tmp_path):
    """A filter and its file."""
    online, path = Filter(MODEL, algorithm="ud", memory=1), tmp_path / "filter.npz"
    streamed(online, record(MODEL, 3, np.random.default_rng(8)))
    online.save(path)
    return online, path


def rewritten(path: Path, header=None, **arrays):
    """The file with other entries of its header, or other arrays."""
    with np.load(path) as file:
        old = dict(file)
    text = json.loads(old["header"].tobytes()) | (header or {})
    old["header"] = np.frombuffer(json.dumps(text).encode(), dtype=np.uint8)
    with path.open("wb") as file:
        np.savez(file, **(old | arrays))


def refused(path: Path) -> str:
    """The one line with which a file is refused."""
    with pytest.raises(ValueError) as caught:
        Filter.load(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: expected a ")
    assert "\n" not in message
    return message


def test_a_damaged_file_is_refused_in_one_line(saved):
    """Wherever a byte is wrong or the file ends: one line, or (in bytes that mean nothing) the same filter."""
    online, path = saved
    whole, refusals = path.read_bytes(), 0
    for place in np.linspace(0, len(whole) - 1, 150).astype(int):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :])
        try:
            assert same(Filter.load(path), online)
        except ValueError:
            refusals += 1
            assert "damaged file" in refused(path)
    assert refusals > 75
    for size in (0, 1, 100, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:size])
        refused(path)
    path.write_bytes(whole)
    assert same(Filter.load(path), online)


def test_another_format_is_named(saved):
    """A file of a later version says so."""
    path = saved[1]
    rewritten(path, {"format": 99})
    assert refused(path) == f"{path}: expected a saved filter of format {files.FORMAT}, received format 99"


@pytest.mark.parametrize(
    ("header", "arrays", "found"),
    [
        ({"algorithm": "os.system"}, {}, "algorithm: expected one of auto, filterpy, conventional"),
        ({"model": "Popen"}, {}, "KeyError: 'Popen'"),
        ({"first": 2}, {}, "first: expected 0 or 1, received 2"),
        ({"instants": 3}, {}, "IndexError: list index out of range"),
        ({"instants": 0}, {}, "instants: expected a whole number >= 1, received 0"),
        (
            {"labels": {"states": ["a"], "units": ["", ""], "measurements": ["", ""], "measurement_units": ["", ""]}},
            {},
            "states: expected 2 names",
        ),
        ({}, {"model.Qd": -np.eye(2)}, "Qd: expected variances >= 0"),
        ({}, {"instant.0.6": np.zeros(3)}, "expected float64 of shape"),
    ],
)
def test_a_wrong_entry_is_named(saved, header, arrays, found):
    """What the file says is checked as what a program says."""
    path = saved[1]
    rewritten(path, header, **arrays)
    assert found in refused(path)


class Harm:
    """What a pickle can do: the file named here is made when the pickle is read."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return (Path.touch, (self.path,))


def test_loading_executes_nothing(saved, tmp_path):
    """Objects in the file are refused before they are made, in arrays as in bare pickles."""
    path, trace = saved[1], tmp_path / "trace"
    rewritten(path, x=np.array([Harm(trace)], dtype=object))
    assert "Object arrays cannot be loaded" in refused(path)
    path.write_bytes(pickle.dumps(Harm(trace)))
    refused(path)
    with path.open("wb") as file:
        np.save(file, np.zeros(3))
    refused(path)
    assert not trace.exists()
    pickle.loads(pickle.dumps(Harm(trace)))
    assert trace.exists()  # it would have done harm


def test_a_compressed_file_is_refused(saved):
    """No file of some kilobytes fills the memory when it is read."""
    path = saved[1]
    with path.open("wb") as file:
        np.savez_compressed(file, header=np.zeros(10**6, dtype=np.uint8))
    assert "expected members that are not compressed" in refused(path)


def test_a_save_that_is_interrupted_leaves_the_old_file(saved, monkeypatch):
    """The new file is written beside the old one and renamed; nothing else stays in the folder."""
    online, path = saved
    old = path.read_bytes()

    def fails(*_):
        raise OSError("no space")

    monkeypatch.setattr(files.os, "fsync", fails)
    online.step(None)
    with pytest.raises(OSError, match="no space"):
        online.save(path)
    monkeypatch.undo()
    assert path.read_bytes() == old
    online.save(path)
    assert path.read_bytes() != old
    assert same(Filter.load(path), online)
    assert [other.name for other in path.parent.iterdir()] == [path.name]


def test_a_file_that_is_not_there_is_an_oserror(tmp_path):
    """Its name is in Python's own message."""
    with pytest.raises(FileNotFoundError, match=r"missing\.npz"):
        Filter.load(tmp_path / "missing.npz")


# Bad input ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "options", "kind", "message"),
    [
        (WHEEL, {}, ValueError, r"R: expected the covariance of a sampled measurement, .* pass R; received None"),
        (
            ContinuousModel([[0]], [[1]], [[1]], [[1]], P0=[[1]], Rc=[[1]]),
            {},
            ValueError,
            r"\(Rc is a strength\): pass R; received None",
        ),
        (
            ContinuousModel([[0]], [[1]], [[1]], [[1]], P0=[[1]], Rc=[[1]], N=[[0.1]]),
            {"R": [[1]]},
            ValueError,
            "model: expected no N",
        ),
        (WHEEL, {"R": [[1]]}, ValueError, r"R: expected shape \(2, 2\), received \(1, 1\)"),
        (WALK, {"R": [[1]]}, ValueError, "R: expected none beside a DiscreteModel"),
        (WALK, {"algorithm": "kalman"}, ValueError, "algorithm: expected one of auto, filterpy, conventional, .*, received 'kalman'"),
        (WHEEL, {"algorithm": "steady", "R": NOISE}, ValueError, "algorithm: expected a DiscreteModel for steady"),
        (WALK, {"first": 2}, ValueError, "first: expected 0 or 1, received 2"),
        (WALK, {"first": True}, ValueError, "first: expected 0 or 1, received True"),
        (WALK, {"memory": -1}, ValueError, "memory: expected a whole number >= 0, received -1"),
        (WALK, {"t0": np.nan}, ValueError, "t0: expected a finite time in s, received nan"),
        (WALK, {"P0": [[np.inf]], "algorithm": "steady"}, ValueError, "form steady: expected a finite P0"),
        ("walk", {}, TypeError, "model: expected a DiscreteModel or a ContinuousModel, received a str"),
    ],
)
def test_a_filter_that_cannot_be_is_refused(model, options, kind, message):
    """Each with one line."""
    with pytest.raises(kind, match=message) as caught:
        Filter(model, **options)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("online", "arguments", "kind", "message"),
    [
        (Filter(WALK), ([1.0, 2.0],), ValueError, r"z: expected a finite number, NaN or None, received \[1.0, 2.0\]"),
        (Filter(MODEL), ([1.0, np.inf],), ValueError, "z: expected 2 finite numbers, NaN or None where one is missing"),
        (Filter(MODEL), (1.0,), ValueError, "z: expected 2 finite numbers, .* received 1.0"),
        (Filter(MODEL), (["one", 2],), TypeError, "z: expected 2 finite numbers, .* received .'one', 2."),
        (Filter(WALK), ("z" * 999,), TypeError, r"received 'z{76}\.\.\.$"),
        (Filter(WALK), (1.0, 0.6), ValueError, r"t: expected an instant t0 \+ k\*dt \(t0 = 0 s, dt = 0.5 s\); .* 0.6"),
        (Filter(WALK), (1.0, 1e300), ValueError, "t: expected an instant"),
        (Filter(WALK), (1.0, 1e6), ValueError, r"t: expected at most 1000000 instants ahead \(now is 0 s\)"),
        (Filter(WALK), (1.0, "noon"), ValueError, "t: expected a finite time in s, received 'noon'"),
        (Filter(WALK), (1.0, np.nan), ValueError, "t: expected a finite time in s, received nan"),
        (Filter(WALK), (1.0, 0.5, [1.0]), ValueError, "u: expected a model with B or D, received one without"),
        (Filter(WHEEL, R=NOISE), ([1.0, 2.0],), ValueError, "t: expected the time of the measurement"),
        (Filter(WHEEL, R=NOISE), ([1.0, 2.0], 1.0, [1.0, 2.0]), ValueError, r"u: expected shape \(1,\), received"),
        (Filter(WHEEL, R=NOISE), ([1.0, 2.0], 1.0), ValueError, r"u: expected the known input, \(1,\), .*; received None"),
        (Filter(WHEEL, R=NOISE), ([1.0, 2.0], 1.0, [1.0]), ValueError, r"u0: expected the known input from t0 to the first"),
        (
            Filter(COASTING, R=NOISE),
            (None, 1.0, [1.0]),
            ValueError,
            "u: expected a model with B or D, received one without",
        ),
        (
            Filter(dataclasses.replace(WALK, Phi=[[[1]], [[1]]])),
            (1.0, 1.5),
            ValueError,
            r"t: expected at most 2 steps \(the model is given for so many\), received step 3",
        ),
    ],
)
def test_a_measurement_that_cannot_be_is_refused(online, arguments, kind, message):
    """Each with one line, and the filter stays where it was."""
    before = online.estimate
    with pytest.raises(kind, match=message) as caught:
        online.step(*arguments)
    assert "\n" not in str(caught.value)
    assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(values(before), values(online.estimate), strict=True))


def test_a_second_value_is_refused():
    """An element that is measured at an instant already is not measured there again."""
    online = Filter(MODEL)
    online.step([1.0, None])
    with pytest.raises(ValueError, match=r"z\[0\]: expected no second value at 0.25 s, received 2 after 1"):
        online.step([2.0, 3.0], 0.25)
    assert online.step([None, 3.0], 0.25).t == 0.25


def test_an_overflow_has_its_time():
    """An unstable model that is not measured is refused when it leaves double precision, and not before."""
    online = Filter(DiscreteModel([[1e60]], [[1]], [[1]], [[1]], x0=[1], P0=[[1]], dt=2.0))
    online.step(None)
    online.step(None)
    with pytest.raises(
        FloatingPointError, match="form array: expected finite covariances, received an overflow at t = 6 s"
    ):
        online.step(None)
    assert online.t == 4.0


def test_large_numbers_are_numbers():
    """Their squares overflow, they do not; and nothing warns of it."""
    walk = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[1e200], P0=[[10]])
    assert Filter(walk).step([1e200]).x_plus == kalman_filter(walk, [1e200]).x_plus[1] == 1e200


def test_a_matrix_that_rounding_makes_singular_is_reported():
    """Two sensors that are one in double precision: one line with the form's name, and the filter stays where it was."""
    sensors = DiscreteModel(np.eye(2), np.eye(2), [[1, 1], [1, 1]], 1e-18 * np.eye(2), x0=np.zeros(2), P0=np.zeros((2, 2)))
    online = Filter(sensors, algorithm="conventional")
    with pytest.raises(FloatingPointError, match=r"form conventional: expected matrices with an inverse, received one singular"):
        online.step([0.5, 0.5])
    assert online.t == 0.0
    with pytest.raises(FloatingPointError, match=r"S: expected a covariance with digits left .* at t = 1 s .*algorithm ud"):
        Filter(sensors).step([0.5, 0.5])  # square roots, and too few digits for them
    assert close(Filter(sensors, algorithm="ud").step([0.5, 0.5]).x_plus, [0.25, 0.25], EXACT)


def test_what_is_read_is_a_copy():
    """Arrays of an estimate may be written to; the filter does not see it."""
    online, other = Filter(MODEL), Filter(MODEL)
    for one in (online, other):
        one.step([0.1, 0.2])
    row = online.estimate
    for name in ("x_minus", "x_plus", "P_minus", "P_plus", "K", "S", "used", "innovation"):
        getattr(row, name)[:] = 7
    assert same(online, other)
