"""Monte-Carlo experiments: the compiled kernel against plain filtering of the same runs, and against theory."""

import dataclasses

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from ctlabs.analysis import sensitivity
from ctlabs.filtering import kalman_filter
from ctlabs.labs.experiment import covariances
from ctlabs.linalg import compiled
from ctlabs.models import DiscreteModel
from ctlabs.models.histories import Normals, Shape, histories, shape, truth_arrays
from ctlabs.models.nonlinear import NonlinearModel
from ctlabs.montecarlo import Bins, chance, kernel, monte_carlo, plan, simulate, streams, sweep, ziggurat
from ctlabs.montecarlo.executors import one_thread
from ctlabs.montecarlo.functional import functional
from ctlabs.montecarlo.histogram import Counter
from ctlabs.montecarlo.linear import linear
from ctlabs.montecarlo.statistics import from_sums
from ctlabs.montecarlo.sums import columns
from tests.reference import EXACT, SOLVER, broken, close
from tests.strategies import covariance, discrete_models, transition

TRACKING = DiscreteModel(
    Phi=[[1, 1], [0, 1]],
    Qd=[[1 / 3, 1 / 2], [1 / 2, 1]],
    H=[[1, 0]],
    R=[[1]],
    x0=[3, -1],
    P0=[[100, 0], [0, 10]],
)
QUIET = {"progress": False}


def of_errors(e, e_minus, P, nu, S, used):
    """Bias, rms, rms before, covariance, NEES and NIS by averages over stored histories (·, ·, runs)."""
    nees, nis = np.empty(len(e)), np.full(len(e), np.nan)
    for k in range(len(e)):
        scale = np.sqrt(np.where(np.diag(P[k]) > 0, np.diag(P[k]), 1.0))
        inverse = np.linalg.pinv(P[k] / np.outer(scale, scale), rcond=1e-10, hermitian=True) / np.outer(scale, scale)
        nees[k] = np.einsum("ir,ij,jr->r", e[k], inverse, e[k]).mean() if P[k].any() else np.nan
        if used[k].any():
            block = np.linalg.inv(S[k][np.ix_(used[k], used[k])])
            nis[k] = np.einsum("ir,ij,jr->r", nu[k, used[k]], block, nu[k, used[k]]).mean()
    centred = e - e.mean(axis=2, keepdims=True)
    cov = np.einsum("kir,kjr->kij", centred, centred) / e.shape[2]
    return e.mean(axis=2), np.sqrt((e**2).mean(axis=2)), np.sqrt((e_minus**2).mean(axis=2)), cov, nees, nis


def by_filter(truth, design, steps, runs, seed, first=1, E=None):
    """The same statistics by :func:`ctlabs.kalman_filter` on the simulated records."""
    records = simulate(truth, steps, runs, seed, first)
    ensemble = kalman_filter(design, records.z, first=first)
    x = records.x if E is None else np.einsum("ij,kjr->kir", E, records.x)
    return of_errors(
        ensemble.x_plus - x, ensemble.x_minus - x, ensemble.P_plus, ensemble.innovation, ensemble.S, ensemble.used
    )


def agree(stats, expected, tolerance=EXACT):
    """Whether an experiment's statistics are those of stored histories; the error's size is that of the signal."""
    size = max(1.0, float(stats.signal_rms.max()))
    found = (stats.bias, stats.rms, stats.rms_minus, stats.cov, stats.nees, stats.nis)
    sizes = (size, size, size, size**2, 1.0, 1.0)
    return all(
        (np.isnan(a).all() and np.isnan(b).all()) or close(a, b, tolerance, s)
        for a, b, s in zip(found, expected, sizes, strict=True)
    )


def random_model(n, m, seed=0):
    """A stable model of n states and m measurements."""
    rng = np.random.default_rng(seed)
    return DiscreteModel(
        transition(rng, n, stable=True), covariance(rng, n), rng.normal(size=(m, n)), covariance(rng, m),
        x0=rng.normal(size=n), P0=covariance(rng, n),
    )  # fmt: skip


@settings(max_examples=40)
@given(discrete_models(stable=None), st.sampled_from([0, 1]), st.integers(0, 99))
def test_statistics_equal_those_of_stored_histories(model, first, seed):
    """The streamed statistics are those of kalman_filter on the simulated records, for every kind of model."""
    stats = monte_carlo(model, steps=6, runs=40, seed=seed, first=first, **QUIET)
    # NEES counts directions down to a relative variance of 1e-10, whose weights magnify rounding.
    assert agree(stats, by_filter(model, model, 6, 40, seed, first), 1e4 * EXACT)


@pytest.mark.parametrize("first", [0, 1])
def test_statistics_equal_those_of_stored_histories_to_the_last_digits(first):
    """For a well-conditioned model the two agree to 1e-12, and not if a gain is 5 % wrong."""
    stats = monte_carlo(TRACKING, steps=30, runs=700, seed=5, first=first, **QUIET)
    expected = by_filter(TRACKING, TRACKING, 30, 700, 5, first)
    assert agree(stats, expected)
    schedule = covariances(TRACKING, 30, first)
    wrong = dataclasses.replace(schedule, K=broken(schedule.K))
    assert not agree(monte_carlo(TRACKING, gains=wrong, steps=30, runs=700, seed=5, first=first, **QUIET), expected)


def test_large_models_use_matrix_products_and_give_the_same_statistics():
    """Twenty states go through BLAS instead of loops, with the same result to 1e-12."""
    model = random_model(20, 5)
    assert model.Phi.size >= kernel.LARGE
    assert agree(monte_carlo(model, steps=12, runs=300, seed=2, **QUIET), by_filter(model, model, 12, 300, 2))


def drawing(function):
    """The streams of a block for the compiled kernel, or for it as plain Python: then they are numpy's generators."""
    generators = streams.generators(3, 0)
    return map(ziggurat.stream, generators) if function is kernel.block else generators


def test_the_compiled_kernel_equals_its_plain_python_on_numpys_normals():
    """Run as plain Python with numpy's Generator the kernel gives the compiled sums to 1e-12, a wrong truth does not."""
    model = dataclasses.replace(TRACKING, N=[[0.2], [0.3]], offset=[0.5, -0.1])
    experiment = linear(model, dataclasses.replace(model, N=None), 5, 1, np.eye(2), None, Bins((0, 1), 8))
    bins, counts = experiment.counter.arrays()

    def sums(function, truth):
        table, count = np.zeros((6, columns(2))), np.zeros_like(counts)
        function(*drawing(function), 2, 7, 4, 1, truth, experiment.gains.arrays, bins, table, count)
        return table, count

    compiled, plain = sums(kernel.block, experiment.truth), sums(kernel.block.py_func, experiment.truth)
    assert close(compiled[0], plain[0], EXACT)
    assert (compiled[1] == plain[1]).all()
    assert compiled[1].sum() == 6 * 2 * 11
    assert not close(
        compiled[0], sums(kernel.block.py_func, experiment.truth._replace(G=broken(experiment.truth.G)))[0], EXACT
    )


def test_bins_need_no_kernel_of_their_own():
    """Whichever errors are counted, the arrays are stored row by row as those of an experiment that counts none."""
    claimed = np.ones((6, 3))
    for bins in (None, Bins((0,), 4), Bins((2, 0), 4), Bins((1, 2), 4, sd=[1.0, 2.0])):
        counted, table = Counter.of(bins, claimed, 5).arrays()
        assert all(array.flags.c_contiguous for array in (*counted, table))


def test_plain_python_covers_matrix_products_and_a_selection():
    """The paths for large matrices and for E ≠ I agree between plain Python and the compiled kernel."""
    truth, design = random_model(17, 17), random_model(16, 17, seed=1)
    experiment = linear(truth, design, 2, 1, np.eye(17)[:16], None, Bins((3, 0), 4, 0.5))
    bins, counts = experiment.counter.arrays()
    tables = []
    for function in (kernel.block, kernel.block.py_func):
        table = np.zeros((3, columns(16)))
        function(*drawing(function), 1, 5, 4, 1, experiment.truth, experiment.gains.arrays, bins, table, counts)
        tables.append(table)
    assert close(*tables, EXACT)


def test_the_random_numbers_of_a_block_are_numpys():
    """What the kernel draws is what Generator.standard_normal gives, to the bit, tails and refused places among it."""

    @compiled.kernel
    def draw(words, into):
        ziggurat.fill(words, into)

    buffer = np.empty((3, 50_000))
    words = ziggurat.stream(streams.generators(4, 2)[0])
    for number in (1, 2):  # the second time from where the first ended
        draw(words, buffer)
        tile = list(streams.tiles(4, 2, plan.Tiling(50_000, number), Shape(3, 0, 0, 1, 1), 50_000 * number))[-1]
        assert (tile.start == buffer).all()
    assert np.abs(buffer).max() > 4


def test_a_mismatched_design_meets_its_true_covariance():
    """Bias and variance of a wrong filter are those of the sensitivity analysis, and not those that it claims."""
    design = dataclasses.replace(TRACKING, R=[[4.0]], Qd=0.3 * TRACKING.Qd, x0=[0, 0])
    stats = monte_carlo(TRACKING, design, steps=40, runs=4000, seed=9, **QUIET)
    actual = sensitivity.actual(TRACKING, design, 40)
    assert chance.bias(stats, actual.P_plus, actual.bias_plus)
    assert chance.variance(stats, actual.P_plus, actual.bias_plus)
    assert chance.bias(stats, actual.P_minus, actual.bias_minus, when="minus")
    assert chance.variance(stats, actual.P_minus, actual.bias_minus, when="minus")
    assert not chance.variance(stats, actual.claimed.P_plus, actual.bias_plus)
    assert not chance.bias(stats, actual.P_plus)
    assert not chance.nees(stats)


def test_a_design_of_another_order_is_compared_through_a_selection():
    """A one-state design is compared with the position of a two-state truth, as in the sensitivity analysis."""
    design = DiscreteModel([[1]], [[2.0]], [[1]], [[1]], x0=[3], P0=[[100]])
    E = [[1.0, 0.0]]
    stats = monte_carlo(TRACKING, design, steps=20, runs=900, seed=4, compare=E, **QUIET)
    assert agree(stats, by_filter(TRACKING, design, 20, 900, 4, E=np.array(E)))
    actual = sensitivity.actual(TRACKING, design, 20, compare=E)
    assert chance.variance(stats, actual.P_plus, actual.bias_plus)


def test_missing_and_perfect_measurements():
    """R = inf leaves the element out in truth and design alike; R = 0 gives an exactly known state."""
    R = np.broadcast_to(np.diag([1.0, 2.0]), (21, 2, 2)).copy()
    R[5, 0, 0] = R[7:9, 1, 1] = np.inf
    R[12] = np.diag([0.0, np.inf])
    truth = dataclasses.replace(TRACKING, H=np.eye(2), R=R, measurements=None, measurement_units=None)
    stats = monte_carlo(truth, steps=20, runs=1500, seed=3, **QUIET)
    assert agree(stats, by_filter(truth, truth, 20, 1500, 3), 100 * EXACT)
    schedule = covariances(truth, 20)
    assert chance.variance(stats, schedule.P_plus)
    assert chance.nees(stats)
    assert chance.nis(stats)
    assert stats.nis_dof[[5, 7, 8, 12]].tolist() == [1, 1, 1, 1]
    assert stats.nees_dof[12] == 1
    assert stats.rms[12, 0] < 1e-12 * stats.signal_rms[12, 0]
    # A design that thinks everything is measured leaves out what the truth does not give.
    trusting = dataclasses.replace(truth, R=np.diag([1.0, 2.0]))
    assert agree(
        monte_carlo(truth, trusting, steps=20, runs=300, seed=3, **QUIET), by_filter(truth, trusting, 20, 300, 3)
    )


def test_nees_counts_only_directions_with_a_variance():
    """A singular covariance is inverted on its range, and the expected value is its rank."""
    model = DiscreteModel(
        np.diag([0.6, 0.4]), np.diag([0.86, 0.31]), [[1, 1]], [[0]], x0=[0, 0], P0=np.diag([1.0, 0.5])
    )
    stats = monte_carlo(model, steps=10, runs=2000, seed=1, first=0, **QUIET)
    assert (stats.nees_dof == 1).all()
    assert chance.nees(stats)
    assert agree(stats, by_filter(model, model, 10, 2000, 1, first=0))


def test_nothing_known_and_nothing_measured_has_no_consistency():
    """Without a variance NEES is NaN, without a measurement NIS is."""
    model = DiscreteModel([[1]], [[0]], [[1]], [[np.inf]], x0=[2], P0=[[0]])
    stats = monte_carlo(model, steps=3, runs=10, seed=1, **QUIET)
    assert np.isnan(stats.nees).all()
    assert np.isnan(stats.nis).all()
    assert chance.nees(stats)
    assert chance.nis(stats).tests == 0
    assert chance.bias(stats, np.zeros((4, 1, 1)))


def test_more_runs_continue_the_same_experiment():
    """The first runs of an experiment do not depend on how many there are, over tiles and blocks."""
    few, many = simulate(TRACKING, 1000, 7, seed=3), simulate(TRACKING, 1000, 2600, seed=3)
    assert plan.layout(2, 1000).runs < 2600
    assert (many.x[:, :, :7] == few.x).all()
    # The sums over 2600 runs are those over 2000 and over the 600 that follow.
    experiment = linear(TRACKING, TRACKING, 1000, 1, np.eye(2))
    size = experiment.layout.runs
    total = experiment.block(3, 0, size).plus(experiment.block(3, 1, 2600 - size))
    whole = monte_carlo(TRACKING, steps=1000, runs=2600, seed=3, **QUIET)
    assert from_sums(total.table, 2600, experiment.claims(total, 2600)).cov.tobytes() == whole.cov.tobytes()


def test_states_do_not_depend_on_what_is_measured():
    """Two experiments with the same seed and motion have the same states, whatever their sensors."""
    other = dataclasses.replace(TRACKING, H=[[0, 1], [1, 1]], R=np.eye(2), measurements=None, measurement_units=None)
    assert (simulate(TRACKING, 30, 600, 8).x == simulate(other, 30, 600, 8).x).all()


def test_simulated_moments_are_those_of_the_model():
    """Mean and covariance of (x, z) with correlated noises, an offset and a singular start meet the theory."""
    model = dataclasses.replace(TRACKING, N=[[0.3], [0.4]], offset=[0.5, -0.1], P0=[[4, 2], [2, 1]])
    runs = 40_000
    s = simulate(model, 3, runs, seed=6)
    # x3 − Φx2 − c = w2 and z2 − Hx2 = v2 have the joint covariance [[Qd, N], [Nᵀ, R]].
    w = s.x[3] - model.Phi @ s.x[2] - model.offset[:, None]
    noise = np.vstack([w, s.z[1] - model.H @ s.x[2]])
    joint = np.block([[model.Qd, model.N], [model.N.T, model.R]])
    whitened = np.linalg.solve(np.linalg.cholesky(joint), noise)
    assert (np.abs(whitened.mean(axis=1)) < 6 / np.sqrt(runs)).all()
    assert (np.abs(whitened @ whitened.T / runs - np.eye(3)) < 6 * np.sqrt(2 / runs)).all()
    assert close(s.x[0, 0] - 3, 2 * (s.x[0, 1] + 1), EXACT)
    assert s.z.shape == (3, 1, runs)
    assert np.isfinite(s.z).all()
    assert simulate(model, 3, 5, seed=6, first=0).z.shape == (4, 1, 5)
    assert np.isfinite(simulate(model, 3, 5, seed=6, first=0).z).all()


def test_histories_made_from_no_noise_are_the_mean():
    """With ξ = 0 the truth follows its mean, which is what sums are taken about."""
    truth = truth_arrays(TRACKING, 4)
    sizes = shape(truth, 4, 1)
    none = Normals(np.zeros((sizes.start, 1)), np.zeros((4, sizes.w, 1)), np.zeros((5, sizes.v, 1)))
    x, z = histories(truth, none, 1)
    assert close(x[:, 0, 0], 3 - np.arange(5.0), EXACT)
    assert close(z[1:, 0, 0], x[1:, 0, 0], EXACT)


def test_a_large_bias_costs_no_accuracy_of_the_covariance():
    """With a bias a million times the scatter the covariance is still right to 1e-8, for it is taken about the mean error."""
    design = dataclasses.replace(TRACKING, offset=[0, 1e7])
    stats = monte_carlo(TRACKING, design, steps=30, runs=500, seed=2, **QUIET)
    plain = monte_carlo(TRACKING, steps=30, runs=500, seed=2, **QUIET)
    assert stats.bias[-1, 0] > 1e6 * stats.sd[-1, 0]
    assert close(stats.cov, plain.cov, SOLVER)
    assert close(stats.rms**2, np.diagonal(stats.second_moment, axis1=1, axis2=2), EXACT)


def test_histogram_counts_every_error_in_its_bin():
    """Counts equal numpy's histogram of the stored errors, and quantiles those of the sorted ones to a bin's width."""
    stats = monte_carlo(TRACKING, steps=5, runs=3000, seed=7, histogram=Bins((1, 0), 40, 4.0), **QUIET)
    records = simulate(TRACKING, 5, 3000, 7)
    e = kalman_filter(TRACKING, records.z).x_plus - records.x
    found = stats.histogram
    assert found is not None
    for k in range(6):
        for i, state in enumerate((1, 0)):
            edges = found.edges[k, i]
            expected, _ = np.histogram(e[k, state].clip(edges[0], edges[-1]), edges)
            # An error within rounding of an edge may fall to either side.
            assert np.abs(found.counts[k, i] - expected).sum() <= 2
    width = found.edges[:, :, 1] - found.edges[:, :, 0]
    for p in (0.05, 0.5, 0.9):
        assert (np.abs(found.quantile(p) - np.quantile(e[:, [1, 0]], p, axis=2)) <= width).all()
    with pytest.raises(ValueError, match="p: expected a probability"):
        found.quantile(1.0)


def test_bands_hold_their_share_and_a_wrong_filter_leaves_them():
    """Over 200 seeds the 95 % bands of NEES and NIS hold about 190 times, those of a wrong filter hardly ever."""
    wrong = dataclasses.replace(TRACKING, R=[[1.5]])
    inside, inside_wrong, verdicts = np.zeros(2), np.zeros(2), []
    schedule, other = covariances(TRACKING, 12), covariances(wrong, 12)
    for seed in range(200):
        right = monte_carlo(TRACKING, gains=schedule, steps=12, runs=200, seed=seed, **QUIET)
        bad = monte_carlo(TRACKING, wrong, gains=other, steps=12, runs=2000, seed=seed, **QUIET)
        verdicts.append(all((chance.nees(right), chance.nis(right), chance.variance(right, schedule.P_plus))))
        for stats, tally in ((right, inside), (bad, inside_wrong)):
            for j, (value, band) in enumerate(((stats.nees, stats.nees_band()), (stats.nis, stats.nis_band()))):
                tally[j] += band[0][-1] <= value[-1] <= band[1][-1]
    # Binomial(200, 0.95): outside 172…199 with a probability below 1e-5.
    assert ((inside >= 172) & (inside <= 199)).all()
    assert (inside_wrong < 20).all()
    assert all(verdicts)


def test_rms_and_bias_bands_hold_the_ensemble():
    """The 99.9999 % bands around theory hold every rms and bias; around a variance 30 % wrong they do not."""
    stats = monte_carlo(TRACKING, steps=20, runs=2000, seed=1, **QUIET)
    P = covariances(TRACKING, 20).P_plus
    low, high = stats.rms_band(P, 1 - 1e-8)
    assert ((low <= stats.rms) & (stats.rms <= high)).all()
    low, high = stats.bias_band(P, 1 - 1e-8)
    assert ((low <= stats.bias) & (stats.bias <= high)).all()
    low, high = stats.rms_band(1.3 * P, 1 - 1e-8)
    assert (stats.rms < low).any()
    with pytest.raises(ValueError, match="level: expected a probability"):
        stats.nees_band(1.0)


def test_standard_errors_are_those_of_repeated_experiments():
    """The scatter of bias, rms and NEES over 150 experiments is their standard error, within 5 of its own."""
    found = [monte_carlo(TRACKING, steps=6, runs=100, seed=seed, **QUIET) for seed in range(150)]
    for name in ("bias", "rms", "rms_minus", "nees", "nis"):
        values = np.array([getattr(s, name)[-1] for s in found])
        claimed = np.array([getattr(s, f"{name}_se")[-1] for s in found]).mean(axis=0)
        assert (np.abs(values.std(axis=0) / claimed - 1) < 5 / np.sqrt(2 * 150)).all()


def test_an_overflow_is_reported_with_its_time():
    """An unstable truth that overflows is an error that names the step, from the experiment and the simulation."""
    unstable = DiscreteModel([[9.0]], [[1.0]], [[1]], [[1]], x0=[0], P0=[[1]])
    with pytest.raises(FloatingPointError, match=r"overflow at step 1\d\d "):
        monte_carlo(unstable, steps=400, runs=10, seed=1, **QUIET)
    with pytest.raises(FloatingPointError, match=r"x: expected finite values, received an overflow at step 3\d\d "):
        simulate(unstable, 400, 10, seed=1)
    with pytest.raises(FloatingPointError, match="mean error"):
        monte_carlo(
            dataclasses.replace(unstable, x0=[1.0]),
            dataclasses.replace(unstable, Phi=[[1.0]]),
            steps=400,
            runs=10,
            seed=1,
            **QUIET,
        )


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"design": random_model(3, 1)}, ValueError, r"compare: expected a matrix of shape \(3, 2\)"),
        ({"design": random_model(2, 2)}, ValueError, "design: expected 1 measurements as the truth has, received 2"),
        ({"compare": np.eye(3)}, ValueError, r"compare: expected shape \(2, 2\), received \(3, 3\)"),
        ({"gains": covariances(TRACKING, 4)}, ValueError, "gains: expected gains of shape"),
        ({"design": 3}, TypeError, "design: expected a DiscreteModel"),
        ({"truth": 3}, TypeError, "truth: expected a DiscreteModel or a NonlinearModel, received a int"),
        ({"runs": 0}, ValueError, "runs: expected a whole number >= 1"),
        ({"seed": -1}, ValueError, "seed: expected a whole number >= 0"),
        ({"first": 2}, ValueError, "first: expected 0 or 1"),
        ({"workers": 0}, ValueError, "workers: expected a whole number >= 1"),
        ({"executor": "gpu"}, ValueError, "executor: expected 'threads'"),
        ({"histogram": Bins((5,))}, ValueError, "states: expected indices of 2 compared states"),
    ],
)
def test_bad_input_is_refused(change, error, message):
    """Every mistake is one line that says what was expected and received."""
    with pytest.raises(error, match=message):
        monte_carlo(**{"truth": TRACKING, "steps": 5, "runs": 10, "seed": 1, **change})


def test_progress_reports_runs(capsys):
    """A function sees growing counts up to the total; a bar is drawn on request and never when not a terminal."""
    seen = []
    monte_carlo(TRACKING, steps=10, runs=50, seed=1, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (50, 50)
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)
    monte_carlo(TRACKING, steps=10, runs=50, seed=1)
    assert capsys.readouterr().err == ""
    monte_carlo(TRACKING, steps=10, runs=50, seed=1, progress=True)
    assert "50.0/50.0" in capsys.readouterr().err


# Sweeps


def test_a_sweep_runs_every_point_of_the_grid(tmp_path):
    """A grid gives one row per point, equal to the single experiments, in a table and as a surface."""

    def build(R, factor):
        design = dataclasses.replace(TRACKING, R=[[R * factor]])
        return dataclasses.replace(TRACKING, R=[[R]]), design

    seen = []
    grid = {"R": [0.5, 2.0], "factor": [1.0, 3.0, 9.0]}
    result = sweep(build, grid, steps=8, runs=60, seed=2, progress=lambda done, total: seen.append((done, total)))
    truth, design = build(2.0, 3.0)
    alone = monte_carlo(truth, design, steps=8, runs=60, seed=2, **QUIET)
    surface = result.surface("rms_2")
    assert surface.shape == (2, 3)
    assert surface[1, 1] == alone.rms[-1, 1]
    assert seen[-1] == (360, 360)
    result.write_csv(tmp_path / "sweep.csv")
    lines = (tmp_path / "sweep.csv").read_text().splitlines()
    assert lines[0].split(",")[:3] == ["R", "factor", "bias_1"]
    assert len(lines) == 7
    assert float(lines[5].split(",")[lines[0].split(",").index("rms_2")]) == alone.rms[-1, 1]
    assert list(tmp_path.iterdir()) == [tmp_path / "sweep.csv"]
    with pytest.raises(ValueError, match="name: expected one of bias_1"):
        result.surface("rms")
    with pytest.raises(ValueError, match="grid: expected at least one parameter"):
        sweep(build, {}, steps=8, runs=60, seed=2)


def test_a_sweep_takes_models_and_arguments(tmp_path):
    """What is built may be a truth or the arguments of run; what is measured may be chosen; each point is saved apart."""
    arguments = {"steps": 4, "runs": 20, "seed": 2, "progress": False}
    single = sweep(lambda R: dataclasses.replace(TRACKING, R=[[R]]), {"R": [1.0]}, **arguments, checkpoint=tmp_path)
    named = sweep(
        lambda R: {"truth": dataclasses.replace(TRACKING, R=[[R]]), "first": 0}, {"R": [1.0]}, **arguments,
        measure=lambda stats: {"last": float(stats.rms[-1, 0])},
    )  # fmt: skip
    assert (tmp_path / "point-0000" / "experiment.json").exists()
    assert named.names == ("R", "last")
    assert named.surface("last")[0] != single.surface("rms_1")[0]


# Functions instead of matrices


def test_functions_that_are_linear_give_the_linear_result():
    """The plain numpy route through functions equals the kernel: linear world and gains to 1e-12, extended filter to its derivatives."""
    model = dataclasses.replace(TRACKING, N=[[0.2], [0.3]], offset=[0.1, 0.2])
    compiled = monte_carlo(model, steps=10, runs=600, seed=3, **QUIET)
    for truth, design, tolerance in (
        (model, model, EXACT),
        (TRACKING, _functions(TRACKING), SOLVER),
        (TRACKING, _functions(TRACKING, derivatives=True), EXACT),
    ):
        with one_thread():
            experiment = functional(truth, design, 10, 1, np.eye(2), None, Bins((0,), 10, 3.0, sd=np.array([2.0])))
            total = experiment.block(3, 0, 600)
        stats = from_sums(total.table, 600, experiment.claims(total, 600))
        expected = compiled if truth is model else monte_carlo(TRACKING, steps=10, runs=600, seed=3, **QUIET)
        names = ("bias", "rms", "rms_minus", "cov", "nees", "nis")
        assert agree(stats, [getattr(expected, name) for name in names], 10 * tolerance)
        assert close(stats.signal_rms, expected.signal_rms, tolerance)
        assert (stats.nees_dof == expected.nees_dof).all()
        assert (stats.nis_dof == expected.nis_dof).all()
        assert total.counts.sum() == 11 * 600


def _functions(model, derivatives=False):
    """A linear model written as functions; with ``derivatives`` nothing is left to differences."""
    return NonlinearModel(
        f=lambda k, x, w: model.Phi @ x + w,
        h=lambda k, x, v: model.H @ x + v,
        Qd=(lambda k, x: model.Qd) if derivatives else model.Qd,
        R=(lambda k, x: model.R) if derivatives else model.R,
        x0=model.x0, P0=model.P0,
        F=(lambda k, x: model.Phi) if derivatives else None,
        H=(lambda k, x: model.H) if derivatives else None,
    )  # fmt: skip


def _polar(**options):
    """A point in the plane seen by range and bearing, with noise inside the sensor."""

    def h(k, x, v):
        return np.array([np.hypot(x[0], x[1]) + v[0], np.arctan2(x[1], x[0]) + v[1]])

    def residual(z, expected):
        nu = z - expected
        nu[1] = (nu[1] + np.pi) % (2 * np.pi) - np.pi
        return nu

    return NonlinearModel(
        f=lambda k, x, w: x + np.array([[-1.0], [0.1]]) + w, h=h, Qd=0.01 * np.eye(2), R=np.diag([0.04, 1e-4]),
        x0=[5, 1], P0=0.25 * np.eye(2), residual=residual, **options,
    )  # fmt: skip


def test_the_extended_filter_of_many_runs_is_that_of_each():
    """Vectorised over runs the extended filter gives each run's own recursion, written plainly with exact derivatives."""
    model = _polar(H=lambda k, x: _polar_derivative(x))
    experiment = functional(model, model, 12, 1, np.eye(2))
    width = experiment.layout.width
    states, measurements = streams.generators(4, 0)
    x = np.array([5.0, 1.0])[:, None] + 0.5 * states.standard_normal((2, width))
    errors, nees = [], []
    estimates = [(np.array([5.0, 1.0]), 0.25 * np.eye(2)) for _ in range(3)]
    for k in range(13):
        if k:
            x = model.f(k - 1, x, 0.1 * states.standard_normal((2, width)))
            z = model.h(k, x, np.array([[0.2], [0.01]]) * measurements.standard_normal((2, width)))
            estimates = [_one_update(model, k, *each, z[:, r]) for r, each in enumerate(estimates)]
        errors.append(np.mean([each[0] - x[:, r] for r, each in enumerate(estimates)], axis=0))
        nees.append(
            np.mean(
                [(each[0] - x[:, r]) @ np.linalg.solve(each[1], each[0] - x[:, r]) for r, each in enumerate(estimates)]
            )
        )
    stats = monte_carlo(model, steps=12, runs=3, seed=4, **QUIET)
    assert close(stats.bias, errors, SOLVER)
    assert close(stats.nees, nees, SOLVER)
    assert not close(monte_carlo(_polar(), steps=12, runs=3, seed=5, **QUIET).bias, errors, SOLVER)


def _polar_derivative(x):
    d = np.hypot(x[0], x[1])
    return np.array([[x[0] / d, x[1] / d], [-x[1] / d**2, x[0] / d**2]])


def _one_update(model, k, x, P, z):
    x, P = model.f(k - 1, x[:, None], np.zeros((2, 1)))[:, 0], P + 0.01 * np.eye(2)
    H, R = _polar_derivative(x), np.diag([0.04, 1e-4])
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    nu = model.residual(z[:, None], model.h(k, x[:, None], np.zeros((2, 1))))[:, 0]
    return x + K @ nu, (np.eye(2) - K @ H) @ P @ (np.eye(2) - K @ H).T + K @ R @ K.T


def test_an_extended_filter_of_perfect_measurements_counts_what_is_unknown():
    """With singular covariances the extended filter agrees with the linear one in rank, error and consistency."""
    model = dataclasses.replace(TRACKING, R=[[0.0]], P0=[[4, 2], [2, 1]])
    functions = dataclasses.replace(
        _functions(TRACKING, derivatives=True), R=lambda k, x: np.zeros((1, 1)), P0=model.P0
    )
    found, expected = (monte_carlo(model, d, steps=6, runs=200, seed=1, **QUIET) for d in (functions, model))
    assert (found.nees_dof == expected.nees_dof).all()
    assert expected.nees_dof.tolist() == [1.0] * 7
    assert close(found.nees, expected.nees, 1e3 * SOLVER)
    assert close(found.rms, expected.rms, SOLVER, size=float(expected.signal_rms.max()))
    # The same thing measured twice, perfectly: the pseudo-inverse leaves the second out.
    twice = dataclasses.replace(model, H=[[1, 0], [1, 0]], R=np.zeros((2, 2)), measurements=None, measurement_units=None)
    doubled = dataclasses.replace(
        functions,
        h=lambda k, x, v: twice.H @ x + v,
        H=lambda k, x: twice.H,
        R=lambda k, x: np.zeros((2, 2)),
        measurements=None,
    )
    assert close(monte_carlo(twice, doubled, steps=6, runs=200, seed=1, **QUIET).rms, found.rms, SOLVER, size=100.0)


def test_an_extended_filter_with_the_covariance_at_its_estimate():
    """R given as a function of the estimate equals the constant it returns; R = inf in it leaves the element out."""
    constant = monte_carlo(_polar(), steps=6, runs=300, seed=1, **QUIET)
    function = dataclasses.replace(_polar(), R=lambda k, x: np.diag([0.04, 1e-4]), Qd=lambda k, x: 0.01 * np.eye(2))
    stats = monte_carlo(_polar(), function, steps=6, runs=300, seed=1, **QUIET)
    assert close(stats.bias, constant.bias, SOLVER)
    blind = dataclasses.replace(_polar(), R=lambda k, x: np.diag([0.04, np.inf]))
    assert (monte_carlo(_polar(), blind, steps=6, runs=30, seed=1, **QUIET).nis_dof[1:] == 1).all()
    absent = dataclasses.replace(_polar(), R=np.diag([0.04, np.inf]))
    assert (monte_carlo(absent, _polar(), steps=6, runs=30, seed=1, **QUIET).nis_dof[1:] == 1).all()
    nothing = dataclasses.replace(_polar(), R=lambda k, x: np.diag([np.inf, np.inf]))
    assert np.isnan(monte_carlo(_polar(), nothing, steps=6, runs=30, seed=1, **QUIET).nis).all()


class Constant:
    """A filter of one's own: the estimate never changes."""

    def start(self, runs):
        self.x, self.P = np.full((2, runs), 1.0), None

    def predict(self, k):
        return None

    def update(self, k, z):
        return None


def test_any_object_that_filters_is_a_design():
    """A filter of one's own is run through start, predict and update; without a covariance there is no NEES."""
    stats = monte_carlo(TRACKING, Constant, steps=5, runs=200, seed=1, **QUIET)
    x = simulate(TRACKING, 5, 200, 1).x
    assert close(stats.bias, (1.0 - x).mean(axis=2), EXACT)
    assert np.isnan(stats.nees).all()
    assert np.isnan(stats.nis).all()
    assert stats.steps == 5


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: dataclasses.replace(_polar(), f=lambda k, x, w: x[:1]), r"f: expected to return shape \(2, runs\)"),
        (lambda: dataclasses.replace(_polar(), h=lambda k, x, v: x[0]), r"h: expected to return shape \(m, runs\)"),
        (
            lambda: monte_carlo(dataclasses.replace(_polar(), R=lambda k, x: np.eye(2)), steps=3, runs=3, seed=1),
            "truth: expected Qd and R as matrices",
        ),
        (lambda: monte_carlo(_polar(), TRACKING, steps=3, runs=3, seed=1), "design: expected 2 measurements"),
        (lambda: monte_carlo(TRACKING, _polar(), steps=3, runs=3, seed=1), "design: expected 1 measurements"),
        (lambda: monte_carlo(_polar(), steps=3, runs=3, seed=1, first=2), "first: expected 0 or 1"),
        (lambda: monte_carlo(_polar(), steps=3, runs=3, seed=1, gains=covariances(TRACKING, 3)), "gains: expected none"),
        (lambda: monte_carlo(_polar(), steps=3, runs=3, seed=1, histogram=Bins((0,))), "sd: expected the bins' scale"),
        (
            lambda: monte_carlo(dataclasses.replace(_polar(), Qd=np.zeros((2, 2, 2))), steps=3, runs=3, seed=1),
            "Qd: expected at least 3 entries",
        ),
        (lambda: Bins(()), "states: expected different indices"),
    ],
)  # fmt: skip
def test_bad_functions_are_refused(make, message):
    """What functions return is checked before anything runs."""
    with pytest.raises(ValueError, match=message):
        make()
