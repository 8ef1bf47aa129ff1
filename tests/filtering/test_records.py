"""The compiled filter of one record is the filter: against the recursion, filterpy, and the joint distribution."""

import dataclasses
import importlib.util
import pickle
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ctlabs import simulate
from ctlabs.filtering import kalman_filter, log_likelihood
from ctlabs.filtering.comparison import reference as fifty_digits
from ctlabs.filtering.engines import compiled, driver, forward, means, roots
from ctlabs.filtering.problem import pose
from ctlabs.filtering.results import without_runs
from ctlabs.linalg import compiled as kernels
from ctlabs.models import ContinuousModel, DiscreteModel
from tests import reference
from tests.reference import EXACT, broken, close
from tests.strategies import discrete_models, record, seeds

pytestmark = pytest.mark.numerical

FIELDS = ("t", "x_minus", "x_plus", "P_minus", "P_plus", "innovation", "S", "nis", "log_likelihood", "used")
#: Two coupled states, two measurements with correlated errors; the filter settles within a hundred steps.
TRACK = DiscreteModel(
    Phi=[[1, 0.5], [0, 0.9]], Qd=[[0.1, 0.05], [0.05, 0.2]], H=[[1, 0], [0.5, 1]], R=[[1, 0.3], [0.3, 2]],
    x0=[1, -1], P0=[[4, 0], [0, 2]], dt=0.5,
)  # fmt: skip


def differs(a, b, tolerance=EXACT):
    """The fields in which two histories differ."""
    return [name for name in FIELDS if not close(*(1.0 * np.asarray(getattr(f, name)) for f in (a, b)), tolerance)]


def josephs(model, z, first=1):
    """The record by the form ``joseph``, instant by instant."""
    return without_runs(driver.run(pose(model, z, first=first), "joseph")[0])


def changed(model, **arrays):
    """The model with other arrays."""
    return dataclasses.replace(model, **arrays)


@settings(max_examples=40)
@given(discrete_models(stable=None), seeds, st.sampled_from([0.0, 0.3]), st.integers(0, 1))
def test_the_compiled_filter_is_josephs_form(model, seed, gaps, first):
    """Every field equals that of the form ``joseph``, whatever the model."""
    z = record(model, 6, np.random.default_rng(seed), gaps, first)
    assert differs(kalman_filter(model, z[first:], first=first), josephs(model, z[first:], first=first)) == []


@settings(max_examples=40)
@given(discrete_models(), seeds, st.sampled_from([0.0, 0.3]), st.integers(0, 1))
def test_estimates_are_those_of_the_textbook_and_of_filterpy(model, seed, gaps, first):
    """x and P equal the plain recursion's (with N a one-step predictor) and filterpy's."""
    z = record(model, 6, np.random.default_rng(seed), gaps, first)
    found, textbook = kalman_filter(model, z[first:], first=first), reference.recursion(model, z, first)
    size = np.abs(model.Qd).max() + np.abs(model.P0).max()  # with N all of it may cancel
    runs = kalman_filter(model, z[first:], first=first, algorithm="filterpy")
    for name in ("x_minus", "x_plus"):
        assert close(getattr(found, name), getattr(textbook, name), EXACT)
        assert close(getattr(found, name), getattr(runs, name), EXACT)
    for name in ("P_minus", "P_plus"):
        assert close(getattr(found, name), getattr(textbook, name), EXACT, size)
        assert close(getattr(found, name), getattr(runs, name), EXACT, size)
    assert close(found.innovation, runs.innovation, EXACT)


@settings(max_examples=40)
@given(discrete_models(), seeds, st.sampled_from([0.0, 0.3]), st.integers(0, 1))
def test_the_likelihood_is_the_joint_density_of_the_record(model, seed, gaps, first):
    """Innovations before the update multiply to the density of all measurements together; a broken R is noticed."""
    z = record(model, 6, np.random.default_rng(seed), gaps, first)
    found = log_likelihood(model, z[first:], first)
    assert close(found, reference.log_likelihood(model, z, first), EXACT, size=z.size)
    assert found == kalman_filter(model, z[first:], first=first).log_likelihood
    if not np.isnan(z[first:]).all():
        wrong = changed(model, R=1.05 * model.R)
        assert not close(log_likelihood(wrong, z[first:], first), reference.log_likelihood(model, z, first), EXACT, size=z.size)


@pytest.mark.parametrize("name", ["Phi", "Qd", "H", "R", "x0", "P0"])
def test_a_broken_input_is_noticed(name):
    """5 % in one element of any array changes the result."""
    z = record(TRACK, 12, np.random.default_rng(1))
    wrong = changed(TRACK, **{name: broken(getattr(TRACK, name))})
    assert differs(kalman_filter(wrong, z[1:]), josephs(TRACK, z[1:]))


CORRELATED = changed(TRACK, N=[[0.1, 0.0], [0.05, 0.1]])
DRIVEN = changed(CORRELATED, offset=np.random.default_rng(5).normal(size=(600, 2)))


@pytest.mark.parametrize("model", [TRACK, CORRELATED, DRIVEN], ids=["plain", "correlated", "driven"])
@pytest.mark.parametrize("gaps", [[], [200, 201, 330], range(150, 450)], ids=["none", "some", "half"])
def test_the_settled_filter_is_the_filter(model, gaps):
    """With covariances left out after they have settled the results are the same, also after and in a stretch of gaps."""
    z = record(model, 600, np.random.default_rng(2))
    z[list(gaps), 0] = np.nan
    found = kalman_filter(model, z[1:])
    assert differs(found, josephs(model, z[1:])) == []
    assert (found.P_plus[590:] == found.P_plus[590]).all()
    assert log_likelihood(model, z[1:]) == found.log_likelihood


def test_a_small_step_is_not_taken_for_the_end_of_the_way():
    """P = 1/(1/P0 + k) changes by 5e-14 of itself per step, and by 1.5e-10 in the record: it is not settled."""
    constant = DiscreteModel([[1]], [[0]], [[1]], [[1]], x0=[0], P0=[[5e-14]])
    found = kalman_filter(constant, np.zeros((3001, 1))[1:]).P_plus[:, 0, 0]
    exact = 1 / (1 / 5e-14 + np.arange(3001))
    assert close(found, exact, EXACT)
    assert not close(np.full(3001, exact[1]), exact, EXACT)


@pytest.mark.parametrize(
    ("Phi", "step", "wanted"),
    [
        (0.5 * np.eye(2), np.diag([1e-13, 0.0]), True),  # all that follows is a third of it
        (0.999 * np.eye(2), np.diag([1e-15, 0.0]), False),  # five hundred times as much follows
        (np.array([[0.8, 0.6], [-0.6, 0.8]]), np.diag([1e-15, -1e-15]), False),  # goes round for ever
        (np.array([[0.8, 0.6], [-0.6, 0.8]]), np.zeros((2, 2)), True),
        (np.roll(np.eye(3), 1, axis=0), 2.0**-51 * np.diag([2.0, -1.0, -1.0]), False),  # comes back after three
        (2 * np.eye(2), np.diag([1e-15, 0.0]), False),
    ],
)
def test_what_is_left_of_the_way_is_summed_to_its_end(Phi, step, wanted):
    """A step of P is judged by the sum of AʲΔAʲᵀ, here with A = Φ and P = I."""
    P = np.eye(len(Phi))
    scratch = [np.empty_like(P) for _ in range(4)]
    assert forward.settled(P, P - step, Phi, P, *scratch) == wanted


@pytest.mark.parametrize("q", [1e-2, 1e-5, 1e-8])
def test_slow_filters_settle_at_their_limit(q):
    """A random walk with little noise has a pole near 1; after 20 000 steps its variance is √(qr) for small q."""
    walk = DiscreteModel([[1]], [[q]], [[1]], [[1]], x0=[0], P0=[[1]])
    found = kalman_filter(walk, np.zeros((20001, 1))[1:]).P_plus[:, 0, 0]
    P, exact = 1.0, [1.0]
    for _ in range(20000):
        P = (P + q) / (P + q + 1)
        exact.append(P)
    assert close(found, exact, EXACT)
    assert found[-1] == pytest.approx(np.sqrt(q + q * q / 4) - q / 2, rel=0.1)


def test_an_unstable_model_settles_too():
    """The filter of an unstable model is stable: P settles though the estimate grows."""
    model = DiscreteModel([[1.1]], [[1]], [[1]], [[1]], x0=[1], P0=[[1]])
    z = record(model, 300, np.random.default_rng(3))
    found = kalman_filter(model, z[1:])
    assert differs(found, josephs(model, z[1:])) == []
    assert (found.P_plus[100:] == found.P_plus[100]).all()


def test_absent_elements_are_left_out():
    """R = inf is no measurement: the likelihood and the estimates are those without the element."""
    both = changed(TRACK, R=[[1, 0], [0, np.inf]])
    alone = changed(TRACK, H=TRACK.H[:1], R=[[1]], measurements=("z1",), measurement_units=None)
    z = record(TRACK, 20, np.random.default_rng(4))
    found, wanted = kalman_filter(both, z[1:]), kalman_filter(alone, z[:, :1][1:])
    assert close(found.x_plus, wanted.x_plus, EXACT)
    assert close(found.log_likelihood, wanted.log_likelihood, EXACT)
    assert np.isnan(found.innovation[:, 1]).all()
    assert (found.S[:, 1, 1] == np.inf).all()
    assert not found.used[:, 1].any()


def test_a_perfect_measurement_is_one():
    """R = 0 (for some of the time too) gives the conditional moments, and an exact zero of the variance."""
    R = np.tile(np.diag([0.0, 1.0]), (9, 1, 1))
    R[4:, 0, 0] = 0.5
    for model in (changed(TRACK, R=np.diag([0.0, 1.0])), changed(TRACK, R=R)):
        z = record(model, 8, np.random.default_rng(5))
        found, wanted = kalman_filter(model, z[1:]), reference.conditioned(model, z)
        assert close(found.x_plus, wanted.x_plus, EXACT)
        assert close(found.P_plus, wanted.P_plus, EXACT)
        assert found.P_plus[1, 0, 0] == 0
        assert log_likelihood(model, z[1:]) == found.log_likelihood
        assert close(found.log_likelihood, reference.log_likelihood(model, z), EXACT, size=z.size)


def test_a_record_shorter_than_the_models_horizon():
    """Of matrices given for more steps the first ones are used; arrays in any order of memory do."""
    rng = np.random.default_rng(6)
    varying = changed(TRACK, Phi=np.asfortranarray(TRACK.Phi * rng.uniform(0.8, 1, (30, 1, 1))), R=np.asfortranarray(
        TRACK.R * rng.uniform(0.5, 2, (31, 1, 1))))  # fmt: skip
    z = np.asfortranarray(record(varying, 12, rng))
    z.setflags(write=False)
    assert differs(kalman_filter(varying, z[1:]), josephs(varying, z[1:])) == []


@pytest.mark.parametrize("first", [0, 1])
def test_plain_python_is_what_is_compiled(first):
    """The loop without numba gives the same histories: plain, correlated, varying, settled, with gaps, cancelled."""
    known = DiscreteModel([[1, -1], [0, 1]], np.zeros((2, 2)), [[0, 1]], [[1]], x0=[1, 1], P0=[[1, 1], [1, 1]])
    singular = changed(CORRELATED, Qd=CORRELATED.N @ np.linalg.solve(TRACK.R, CORRELATED.N.T))
    varying = changed(DRIVEN, Phi=np.tile(TRACK.Phi, (600, 1, 1)))
    perfect = changed(TRACK, R=np.diag([0.0, 1.0]))
    for model in (TRACK, DRIVEN, singular, varying, known, perfect):
        z = record(model, 330, np.random.default_rng(7), first=first)
        z[60, 0] = np.nan
        problem, found = pose(model, z[first:], first=first), kalman_filter(model, z[first:], first=first)
        plain = histories(331, model.n, model.m)
        arguments = (compiled.system(problem.model), model.x0, model.P0, problem.z[:, :, 0], ~problem.absent, 0)
        if model is perfect:  # which goes by square roots
            assert plainly(*arguments, plain)[0] == forward.LOSING
            system, x0, P0, *rest = arguments
            total = roots.forward.py_func(system, x0, np.linalg.cholesky(P0), *rest, plain)[2]
        else:
            total = plainly(*arguments, plain)[2]
        assert found.algorithm == ("array" if model is perfect else "joseph")
        assert found.log_likelihood == pytest.approx(total, rel=EXACT)
        assert all(close(getattr(found, name), values, EXACT) for name, values in plain._asdict().items())


@pytest.mark.parametrize("model", [TRACK, CORRELATED], ids=["plain", "correlated"])
def test_the_loop_of_short_records_is_that_of_long_ones(model, monkeypatch):
    """What a short record does not need, and is not compiled for it, changes nothing: the same histories with and without it."""
    z = record(model, 330, np.random.default_rng(8))
    problem, found = pose(model, z[1:]), []
    arguments = (compiled.system(problem.model), model.x0, model.P0, problem.z[:, :, 0], ~problem.absent, 0)
    for long in (forward.LONG, 10**9):
        monkeypatch.setattr(forward, "LONG", long)
        found.append(out := histories(331, model.n, model.m))
        found.append(plainly(*arguments, out))
    assert found[1] == pytest.approx(found[3], rel=EXACT)
    assert all(close(one, other, EXACT) for one, other in zip(found[0], found[2], strict=True))


def plainly(*arguments):
    """The filter over a record in plain Python."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(forward, "forward", forward.forward.py_func)
        return forward.filtered(*arguments)


def histories(rows, n, m):
    """What the kernel fills in."""
    shapes = {"x_minus": (n,), "x_plus": (n,), "P_minus": (n, n), "P_plus": (n, n), "K": (n, m)}
    shapes |= {"innovation": (m,), "S": (m, m), "nis": ()}
    return means.Histories(**{name: np.empty((rows, *shape)) for name, shape in shapes.items()})


def test_plain_python_reports_how_a_record_ends():
    """Known already, overflow, indefinite: the kernel's own words for it."""
    ends = []
    for Phi, Qd, R in (([[1.0]], [[0.0]], [[0.0]]), ([[1e200]], [[1.0]], [[1.0]]), ([[1.0]], [[1.0]], [[1.0]])):
        model = DiscreteModel(Phi, Qd, [[1]], R, x0=[0], P0=[[1]])
        problem = pose(model, [0.0, 0.0])
        start = -100 * model.P0 if len(ends) == 2 else model.P0  # no model has it; rounding may
        with np.errstate(over="ignore", invalid="ignore"):
            arguments = (compiled.system(model), model.x0, start, problem.z[:, :, 0], ~problem.absent, 0)
            end = plainly(*arguments, histories(0, 1, 1))
        ends.append(end[:2])
    assert ends == [(forward.PERFECT, 2), (forward.OVERFLOW, 1), (forward.INDEFINITE, 1)]


def test_an_overflow_names_its_step():
    """As filtering with histories does, in the same words."""
    growing = DiscreteModel([[1e3]], [[1]], [[1]], [[np.inf]], x0=[0], P0=[[1]], dt=0.5)
    z = np.zeros((80, 1))
    with pytest.raises(
        FloatingPointError, match=r"P_minus: expected finite .* overflow at step 52 \(t = 26 s\)"
    ) as own:
        kalman_filter(growing, z[1:])
    with pytest.raises(FloatingPointError) as filterpys:
        kalman_filter(growing, z[1:], algorithm="filterpy")
    assert str(own.value) == str(filterpys.value)
    with pytest.raises(FloatingPointError, match="step 52"):
        log_likelihood(growing, z[1:])


def test_an_innovation_beyond_double_precision_is_refused_or_left_to_factors():
    """Two sensors that are one in double precision: Joseph's form and roots refuse; factors keep what they have in common."""
    hard = DiscreteModel([[1, 0], [0, 1]], np.eye(2), [[1, 1], [1, 1]], 1e-18 * np.eye(2), x0=[0, 0], P0=np.zeros((2, 2)))
    z = np.full((5, 2), 0.5)
    with pytest.raises(FloatingPointError, match=r"S: expected a covariance with digits left .* at step \d+ .*larger R.*ud"):
        kalman_filter(hard, z, algorithm="joseph")
    found, exact = kalman_filter(hard, z), fifty_digits(hard, z)
    assert found.algorithm == "ud"
    assert close(found.x_plus, exact.x_plus, EXACT)
    assert close(found.P_plus, exact.P_plus, EXACT)
    assert close(log_likelihood(hard, z), exact.log_likelihood, 1e-6)


def test_roots_take_over_where_josephs_form_loses_digits():
    """Of a sensor that is 1e-13 of the prediction Joseph's form keeps few digits: roots keep them, and the result says so."""
    fine = DiscreteModel([[1, 1], [0, 1]], 1e-3 * np.eye(2), [[1, 0]], [[1e-13]], x0=[0, 0], P0=np.eye(2))
    z = record(fine, 20, np.random.default_rng(3))[1:]
    found, exact = kalman_filter(fine, z), fifty_digits(fine, z)
    assert found.algorithm == "array"
    assert close(found.x_plus, exact.x_plus, 1e-10)
    sd = exact.sd_plus
    assert (np.abs(found.P_plus - exact.P_plus) <= 1e-8 * sd[:, :, None] * sd[:, None, :]).all()  # of 1e-13 too
    assert np.allclose(found.K, exact.K, rtol=1e-9, atol=1e-9)
    assert differs(found, kalman_filter(fine, z, algorithm="array"), 1e-7) == []


def test_what_joseph_loses_is_kept_from_a_large_start():
    """Bierman's two sensors: P0 is 1e18 times R, and every digit is there."""
    delta = 1e-9
    hard = DiscreteModel(
        np.eye(3), np.zeros((3, 3)), [[1, 1, 1], [1, 1, 1 + delta]], delta**2 * np.eye(2), x0=np.zeros(3), P0=np.eye(3)
    )
    z = record(hard, 10, np.random.default_rng(8))
    found, exact = kalman_filter(hard, z[1:]), fifty_digits(hard, z[1:])
    assert close(found.x_plus, exact.x_plus, 1e-5)  # of what H, with its 1e-9 beside 1, determines in each of ten steps
    assert close(found.P_plus, exact.P_plus, 1e-5)
    assert close(found.log_likelihood, exact.log_likelihood, 1e-5)


def test_no_likelihood_is_no_number(monkeypatch):
    """Where the form that takes over for a perfect measurement loses S, that is said as well."""
    perfect, run = changed(TRACK, R=np.diag([0.0, 1.0]), N=[[0.0, 0.1], [0.0, 0.1]]), driver.run

    def lost(*arguments, **options):
        found, seconds = run(*arguments, **options)
        return dataclasses.replace(found, nis=np.where(np.arange(9)[:, None] == 3, np.nan, found.nis)), seconds

    monkeypatch.setattr(driver, "run", lost)
    for verb in (partial(kalman_filter, algorithm="joseph"), log_likelihood):
        with pytest.raises(FloatingPointError, match=r"S: expected .* at step 3 \(t = 1.5 s\)"):
            verb(perfect, record(perfect, 8, np.random.default_rng(9))[1:])


@pytest.mark.parametrize(
    ("z", "first", "message"),
    [
        (np.zeros((5, 3)), 1, r"z: expected shape \(rows, 2\) or \(rows, 2, runs\), received \(5, 3\)"),
        (np.zeros((0, 2)), 1, r"z: expected shape \(rows, 2\) .*, received \(0, 2\)"),
        (np.zeros((5, 2, 0)), 1, r"z: expected shape \(rows, 2\) .*, received \(5, 2, 0\)"),
        ([[0, 0], [0, np.inf]], 1, r"z\[1\]\[1\]: expected finite numbers, .* received an infinite value"),
        (np.zeros((5, 2)), 2, "first: expected 0 or 1, received 2"),
    ],
)
def test_bad_records_are_refused(z, first, message):
    """Shape, length, infinity and first are checked, with what was expected."""
    with pytest.raises(ValueError, match=message):
        kalman_filter(TRACK, z, first=first)
    with pytest.raises(ValueError, match=message):
        log_likelihood(TRACK, z, first)


def test_the_likelihood_alone_is_of_one_record():
    """An ensemble has one of each run, which the filter gives."""
    with pytest.raises(ValueError, match=r"z: expected one record, \(rows, 2\), received an ensemble"):
        log_likelihood(TRACK, np.zeros((5, 2, 3)))


def test_the_model_must_be_discrete_and_long_enough():
    """A continuous model has no period; more rows than the model is given for are refused."""
    with pytest.raises(ValueError, match=r"t: expected the times of the rows .*a ContinuousModel has no period.*, received None"):
        kalman_filter(ContinuousModel([[0]], [[1]], [[1]], [[1]], P0=[[1]]), [[0]])
    with pytest.raises(ValueError, match="steps: expected at most 600"):
        log_likelihood(DRIVEN, np.zeros((700, 2)))


def test_kernels_are_kept_where_the_user_says_or_not_at_all(tmp_path, monkeypatch):
    """NUMBA_CACHE_DIR is respected; a folder that cannot be written is no reason to fail."""
    import numba

    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    dispatcher = numba.njit(forward.alike)
    kernels.keep(dispatcher)
    assert dispatcher._cache.cache_path.startswith(str(tmp_path))
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setattr(kernels, "folder", lambda: tmp_path / "file" / "kernels")
    (tmp_path / "file").write_text("in the way")
    dispatcher = numba.njit(forward.alike)
    kernels.keep(dispatcher)
    assert dispatcher(np.array([True]), np.array([True]))


def test_a_kernel_is_compiled_anew_when_its_helpers_change(tmp_path, monkeypatch):
    """The stamp of the cache covers the files beside the kernel's."""
    import numba

    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    (tmp_path / "helpers.py").write_text("one = 1\n")
    (tmp_path / "kernels.py").write_text("def add(x):\n    return x + 1\n")

    def stamp():
        spec = importlib.util.spec_from_file_location("kernels", tmp_path / "kernels.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        dispatcher = numba.njit(module.add)
        kernels.keep(dispatcher)
        return dispatcher._cache._impl.locator.get_source_stamp()

    before = stamp()
    assert stamp() == before
    (tmp_path / "helpers.py").write_text("one = 2\n")
    assert stamp() != before


def test_what_other_sources_left_is_not_read(tmp_path, monkeypatch):
    """An index that names a class which is gone is no reason to fail: it is of the sources that had it."""
    import numba

    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(kernels, "folder", lambda: tmp_path)
    dispatcher = numba.njit(forward.alike)
    kernels.keep(dispatcher)
    gone = pickle.dumps(numba.__version__) + b"cctlabs.filtering.engines.forward\nGone\n."
    Path(dispatcher._cache._cache_file._index_path).write_bytes(gone)
    with pytest.raises(AttributeError, match="Gone"):
        pickle.loads(gone[len(pickle.dumps(numba.__version__)) :])
    assert dispatcher(np.array([True]), np.array([True]))


def forgetting(rng, n, m, radius):
    """A random constant model whose Φ has the spectral radius ``radius``, a record of it far from zero, and bursts without data."""
    Phi, W = rng.normal(size=(n, n)), rng.uniform(-1, 1, (n, m)) / np.sqrt(n * m)
    L, C = 10.0 ** rng.uniform(-2, 1) * (rng.normal(size=(n, n)) + np.eye(n)), rng.normal(size=(m, m)) + 2 * np.eye(m)
    model = DiscreteModel(
        Phi * (radius / np.abs(np.linalg.eigvals(Phi)).max()), L @ L.T, rng.normal(size=(m, n)), C @ C.T,
        x0=10.0 ** rng.uniform(0, 4) * rng.normal(size=n), P0=np.eye(n), offset=rng.normal(size=n),
        N=None if rng.uniform() < 0.7 else 0.5 * L @ W @ C.T,
    )  # fmt: skip
    z = simulate(model, 3000, 1, seed=int(rng.integers(2**31))).z[1:, :, 0]
    return model, z


@pytest.mark.property
@settings(max_examples=20)
@given(seeds, st.integers(1, 5), st.integers(1, 3), st.sampled_from([0.3, 0.9, 0.99, 0.9999, 1.0]), st.booleans())
def test_chunks_side_by_side_are_the_record_in_order(seed, n, m, radius, holes):
    """The likelihood and the histories are those of the loop in order, whose chunks would be too short, to 1e-12 of their size."""
    rng = np.random.default_rng(seed)
    model, z = forgetting(rng, n, m, radius)
    if holes:
        z[700:730], z[2000:2040, 0] = np.nan, np.nan
    found, value = kalman_filter(model, z), log_likelihood(model, z)
    parts = josephs(model, z)
    assert abs(value - parts.log_likelihood) <= 1e-12 * (abs(parts.log_likelihood) + z.size)
    sd = np.sqrt(np.diagonal(parts.P_plus, axis1=1, axis2=2))
    assert (np.abs(found.x_plus - parts.x_plus) <= 1e-11 * sd + 1e-13 * np.abs(parts.x_plus).max()).all()


def test_a_seam_that_does_not_fit_is_noticed():
    """Chunks of a filter that forgets nothing, with a wrong power of its transition, are refused."""
    n, m = 2, 1
    gains = means.Applied(np.eye(n), np.zeros((0, m)), np.ones((m, n)), np.eye(n), np.eye(n), np.zeros((m, n)), np.eye(m), np.eye(m))
    out = histories(0, n, m)
    z, x, pick = np.zeros((1000, m)), np.ones((n, 1)), np.arange(m)
    fits, _value = side_by_side(1, 50, gains, np.zeros((0, n)), 0.0, pick, m, z, x, out)
    assert fits
    assert (x == 1).all()
    z[:] = np.nan
    assert not side_by_side(1, 50, gains, np.zeros((0, n)), 0.0, pick, m, z, x, out)[0]


@kernels.kernel
def side_by_side(k, length, gains, c, half, pick, count, z, x, out):
    """The chunks by themselves."""
    return means.side_by_side(k, length, gains, c, half, pick, count, z, x, out)
