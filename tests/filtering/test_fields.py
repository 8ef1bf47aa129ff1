"""The random field: its model, its stability, and three filters that are one."""

from dataclasses import FrozenInstanceError, replace

import mpmath
import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

from ctlabs import covariances
from ctlabs.filtering.fields import RandomField, filter_dense, filter_exact, filter_local, measure
from ctlabs.models.field import stability
from ctlabs.montecarlo import chance
from ctlabs.reporting import plots
from tests.reference import EXACT, SOLVER, broken, close, recursion

pytestmark = pytest.mark.numerical

PAPER = RandomField(alpha=0.1, beta=0.1, b20=0.25, b11=1.0, h=1.0, dt=0.2, N1=30, sigma_eta=3.0)
SMALL = replace(PAPER, N1=6)
FILTERS = {"dense": filter_dense, "exact": filter_exact, "local": filter_local}
several = settings(deadline=None, max_examples=25, derandomize=True)


@st.composite
def random_fields(draw, nodes=6):
    """Fields of any coefficients whose step is a share of von Neumann's limit (those that have one)."""
    number = st.floats(0.05, 2.0)
    b20, b11, beta, h = (draw(number) for _ in range(4))
    alpha = draw(st.floats(0.05, 1.0)) * beta * b11 / b20
    loose = RandomField(alpha, beta, b20, b11, h, 1.0, nodes, draw(number), allow_unstable=True)
    return replace(loose, dt=draw(st.floats(0.1, 0.98)) * loose.dt_limit_von_neumann, allow_unstable=False)


def printed(field):
    """Φ and G of eq. 25-28, element by element."""
    a00, a01 = -field.alpha * field.beta / field.b20, -field.alpha / field.b20
    a10, a11 = -field.beta / field.b20, -field.b11 / field.b20
    dt, h, N = field.dt, field.h, field.N1 + 1
    Phi, G = np.zeros((2 * N, 2 * N)), np.zeros((2 * N, N))
    Phi[0, 0] = Phi[N, N] = 1
    for i in range(1, N):
        Phi[i, i], Phi[i, N + i] = 1, dt
        Phi[N + i, i], Phi[N + i, i - 1] = (a00 + a01 / h) * dt, -a01 * dt / h
        Phi[N + i, N + i], Phi[N + i, N + i - 1] = 1 + dt * (a10 + a11 / h), -a11 * dt / h
        G[N + i, i] = np.sqrt(4 * field.alpha * field.beta) / field.b20 * dt
    return Phi, G


def moving(field):
    """Φ and the noise covariance without the boundary node."""
    Phi, G = printed(field)
    keep = np.r_[1 : field.N1 + 1, field.N1 + 2 : 2 * field.N1 + 2]
    return Phi[np.ix_(keep, keep)], (field.sigma_eta**2 * G @ G.T)[np.ix_(keep, keep)]


class TestModel:
    @several
    @given(random_fields())
    def test_matrices_are_those_printed(self, field):
        """Eq. 17 and 25-28; the sparse and the dense model are one."""
        Phi, G = printed(field)
        model, sparse = field.model(sigma_n=0.7, P0=4.0), field.matrices()
        assert close(model.Phi, Phi, EXACT)
        assert close(model.Qd, field.sigma_eta**2 * G @ G.T, EXACT)
        assert close(sparse.Phi.toarray(), Phi, EXACT)
        assert close(sparse.G.toarray(), G, EXACT)
        assert np.array_equal(sparse.H.toarray(), model.H)
        assert np.array_equal(model.R, 0.7**2 * np.eye(7))
        assert np.array_equal(model.P0, 4.0 * np.eye(14))
        assert not close(model.Phi, broken(Phi), EXACT)

    @several
    @given(random_fields())
    def test_the_recursion_is_the_matrix(self, field):
        """``advance`` is Φx without forming Φ."""
        x = np.random.default_rng(1).standard_normal((14, 3))
        assert close(field.advance(x), printed(field)[0] @ x, EXACT)

    def test_coefficients_of_the_paper(self):
        """Eq. 17 with the paper's numbers, by hand."""
        assert close(list(PAPER.coefficients), [0.12, -0.8, -0.088, -0.08, 0.16], EXACT)

    def test_a_field_is_frozen(self):
        """A field changes by ``replace`` only."""
        with pytest.raises(FrozenInstanceError):
            PAPER.dt = 0.1

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"dt": 0.3}, r"dt: expected at most 0\.240999 s .*received 0\.3 s"),
            ({"alpha": 0.05, "beta": 0.05, "dt": 0.25}, r"dt: expected at most 0\.245408 s"),
            ({"alpha": 1.0}, r"dt: expected an equation whose waves do not grow.*alpha/beta = 10.*received 0\.2 s"),
            ({"N1": 0}, r"N1: expected a whole number >= 1, received 0"),
            ({"h": 0.0}, r"h: expected a number > 0, received 0\.0"),
            ({"beta": -0.1}, r"beta: expected a number >= 0, received -0\.1"),
            ({"sigma_eta": np.nan}, r"sigma_eta: expected a number >= 0, received nan"),
        ],
    )
    def test_a_field_that_cannot_be_is_refused(self, change, message):
        """What, expected, received; a step beyond the limit with the largest admissible one."""
        with pytest.raises(ValueError, match=message):
            replace(PAPER, **change)

    def test_the_largest_admissible_step_of_the_message_is_admissible(self):
        """The number in the message is rounded down."""
        assert replace(PAPER, dt=0.240999).von_neumann_factor <= 1

    def test_an_unstable_step_is_taken_when_asked_for(self):
        """``allow_unstable`` builds the model, and a run that overflows says when."""
        wild = replace(PAPER, dt=5.0, allow_unstable=True)
        assert wild.von_neumann_factor > 1
        with pytest.raises(FloatingPointError, match=r"z: .* overflow at step \d+ \(t = .* s\)"):
            wild.simulate(400, seed=1)


class TestStability:
    @pytest.mark.parametrize(
        ("alpha", "waves", "eigenvalue"), [(0.05, 0.24541, 0.48200), (0.1, 0.24100, 0.46537)], ids=["0.05", "0.1"]
    )
    def test_limits_of_the_paper(self, alpha, waves, eigenvalue):
        """Both limits of the step for the printed variants."""
        field = replace(PAPER, alpha=alpha, beta=alpha)
        assert round(field.dt_limit_von_neumann, 5) == waves
        assert round(field.dt_limit_eigenvalue, 5) == eigenvalue

    def test_eigenvalues_of_the_whole_are_those_of_the_block(self):
        """With 60 digits the defective Φ has the block's eigenvalues; with 16 they are wrong in the fourth."""
        field = replace(PAPER, N1=3)
        with mpmath.workdps(120):
            exact = mpmath.eig(mpmath.matrix(moving(field)[0].tolist()), left=False, right=False)
            radius = float(max(abs(value) for value in exact))
        assert abs(radius - field.spectral_radius) < 1e-6
        e = field.coefficients
        block = np.linalg.eigvals([[1, field.dt], [e.e2, e.e0]])
        assert close(np.abs(block).max(), field.spectral_radius, EXACT)
        assert abs(np.abs(np.linalg.eigvals(moving(PAPER)[0])).max() - PAPER.spectral_radius) > 1e-6

    @several
    @given(random_fields())
    def test_the_factor_is_the_largest_over_all_waves(self, field):
        """A scan of the 2×2 matrices of 4000 waves comes close from below."""
        e, w = field.coefficients, np.exp(-1j * np.linspace(0, np.pi, 4001))
        A = np.empty((len(w), 2, 2), dtype=complex)
        A[:, 0, 0], A[:, 0, 1] = 1, field.dt
        A[:, 1, 0], A[:, 1, 1] = e.e2 - e.e3 * w, e.e0 - e.e1 * w
        scanned = np.abs(np.linalg.eigvals(A)).max()
        assert scanned <= field.von_neumann_factor * (1 + SOLVER)
        assert field.von_neumann_factor <= scanned * (1 + 1e-4)

    @several
    @given(random_fields())
    def test_the_limit_separates_decay_from_growth(self, field):
        """The factor is at most 1 up to the limit, above 1 beyond it."""
        limit = field.dt_limit_von_neumann
        assert stability.von_neumann_factor(field.equation, limit) <= 1 + SOLVER
        assert stability.von_neumann_factor(field.equation, 1.05 * limit) > 1

    @several
    @given(random_fields())
    def test_von_neumanns_condition_is_the_stricter_one(self, field):
        """No wave is damped more strongly than the block: the factor is subharmonic in w."""
        assert field.von_neumann_factor >= field.spectral_radius * (1 - EXACT)
        assert field.dt_limit_von_neumann <= field.dt_limit_eigenvalue * (1 + EXACT)

    @several
    @given(random_fields(), st.floats(0.5, 1.5))
    def test_stable_in_time_means_not_amplified_in_space(self, field, share):
        """max |a(e^{iω})| ≤ 1 exactly when no wave grows."""
        dt = share * field.dt_limit_von_neumann
        each = replace(field, dt=dt, allow_unstable=True)
        if abs(share - 1) < 0.02 or each.spectral_radius >= 1:
            return
        e, q = each.coefficients, np.exp(1j * np.linspace(0, np.pi, 8001))
        a = (e.e1 * (q - 1) + e.e3 * dt) / ((q - 1) * (q - e.e0) - e.e2 * dt)
        assert (np.abs(a).max() > 1) == (share > 1)

    def test_between_the_limits_the_field_grows_though_all_eigenvalues_are_small(self):
        """The spectral radius is below 1 and the variance grows by many orders of magnitude."""
        between = replace(PAPER, dt=0.46, allow_unstable=True)
        assert between.spectral_radius < 1 < between.von_neumann_factor
        assert np.sqrt(between.variance(100).max()) > 1e16

    def test_an_equation_whose_waves_grow_has_no_admissible_step(self):
        """Where the equation is unstable the limit is 0."""
        assert replace(PAPER, alpha=1.0, allow_unstable=True).dt_limit_von_neumann == 0


class TestVariance:
    @several
    @given(random_fields(nodes=4))
    def test_variance_is_the_covariance_recursion(self, field):
        """The sum over the answers to one unit of noise is the diagonal of X ← ΦXΦᵀ + GQGᵀ."""
        Phi, G = printed(field)
        X, rows = np.zeros((10, 10)), [np.zeros(5)]
        for _k in range(25):
            X = Phi @ X @ Phi.T + field.sigma_eta**2 * G @ G.T
            rows.append(np.diag(X)[:5])
        assert close(field.variance(25), rows, EXACT)

    def test_every_node_answers_alike(self):
        """A unit of noise at node j is felt j − 1 nodes further on."""
        Phi, G = printed(SMALL)
        x, rows = G[:, 3], [np.zeros(7)]
        for _k in range(20):
            rows.append(x[:7])
            x = Phi @ x
        assert close(SMALL.response(20)[:, 1:5], np.array(rows)[:, 3:], EXACT)

    @several
    @given(random_fields())
    def test_stationary_variance_solves_lyapunovs_equation(self, field):
        """P = ΦPΦᵀ + GQGᵀ without the boundary node."""
        P = scipy.linalg.solve_discrete_lyapunov(*moving(field))
        found = field.stationary_variance()
        assert found[0] == 0
        assert close(found[1:], np.diag(P)[: field.N1], SOLVER)
        assert not close(broken(found[1:]), np.diag(P)[: field.N1], SOLVER)

    def test_stationary_variance_is_the_limit_of_the_recursion(self):
        """After a long time the variance from rest is the steady one."""
        assert close(PAPER.variance(3000)[-1], PAPER.stationary_variance(), SOLVER)

    @several
    @given(random_fields(nodes=1))
    def test_first_node_is_a_second_order_autoregression(self, field):
        """Its steady variance in closed form: s²(1 + φ₂')/((1 − φ₂')((1 + φ₂')² − φ₁²)), φ₂' = −φ₂."""
        e = field.coefficients
        first, second = 1 + e.e0, e.e0 - e.e2 * field.dt
        s2 = (e.e4 * field.dt * field.sigma_eta) ** 2
        closed = s2 * (1 + second) / ((1 - second) * ((1 + second) ** 2 - first**2))
        assert close(field.stationary_variance()[1], closed, SOLVER)

    def test_no_stationary_variance_of_an_unstable_field(self):
        """The eigenvalue is in the message."""
        with pytest.raises(ValueError, match=r"stationary variance: .*received 1\."):
            replace(PAPER, dt=0.5, allow_unstable=True).stationary_variance()


class TestSimulation:
    def test_ensemble_has_the_theoretical_variance(self):
        """At every node and step at once; a theory wrong by 5 % in one entry by much is refused."""
        field = replace(PAPER, N1=8)
        z, theory = field.simulate(40, seed=3, runs=3000), field.variance(40)
        assert chance.mean_square(z, theory).passed
        wrong = np.array(theory)
        wrong[20, 4] *= 1.5
        assert not chance.mean_square(z, wrong).passed

    def test_the_noise_behind_a_field_is_white(self):
        """The driving noise recovered from z by eq. 15-16 has the variance e4²σ_η² and no memory."""
        z, e, dt = SMALL.simulate(400, seed=2, runs=20), SMALL.coefficients, SMALL.dt
        rate = np.diff(z, axis=0) / dt
        eta = rate[1:, 1:] - (e.e0 * rate[:-1, 1:] + e.e2 * z[:-2, 1:] - e.e3 * z[:-2, :-1] - e.e1 * rate[:-1, :-1])
        eta /= e.e4 * SMALL.sigma_eta
        count = eta.size
        assert abs(eta.mean()) < 5 / np.sqrt(count)
        assert abs(eta.var() - 1) < 5 * np.sqrt(2 / count)
        assert abs((eta[1:] * eta[:-1]).mean()) < 5 / np.sqrt(count)
        assert abs((eta[:, 1:] * eta[:, :-1]).mean()) < 5 / np.sqrt(count)

    def test_shapes_seeds_and_more_runs(self):
        """One run is a matrix; more runs continue an experiment; another seed is another field."""
        one, three = SMALL.simulate(10, seed=1), SMALL.simulate(10, seed=1, runs=3)
        assert one.shape == (11, 7)
        assert three.shape == (11, 7, 3)
        assert np.array_equal(three[:, :, 0], one)
        assert np.array_equal(SMALL.simulate(10, seed=1, runs=2), three[:, :, :2])
        assert not np.array_equal(SMALL.simulate(10, seed=2)[2:, 1:], one[2:, 1:])
        assert not three[:, 0].any()
        assert not three[:2].any()

    def test_measurement_noise_is_white_and_the_start_is_not_measured(self):
        """Row 0 is NaN, the rest has the variance asked for; twice the σ is twice the same noise."""
        z = np.zeros((201, 31, 10))
        once, twice = measure(z, 1.0, seed=5), measure(z, 2.0, seed=5)
        assert np.isnan(once[0]).all()
        assert abs(once[1:].var() - 1) < 5 * np.sqrt(2 / once[1:].size)
        assert close(twice[1:], 2 * once[1:], EXACT)
        assert np.array_equal(measure(z[:, :, 0], 1.0, seed=5), once[:, :, 0], equal_nan=True)
        field = SMALL.simulate(50, seed=5)
        assert (
            abs(np.corrcoef(field[2:, 1:].ravel(), measure(np.zeros((51, 7)), 1.0, seed=5)[2:, 1:].ravel())[0, 1]) < 0.3
        )

    def test_what_is_no_field_is_refused(self):
        """A vector is no record of a field; noise has no negative size."""
        with pytest.raises(ValueError, match=r"z: expected shape \(steps\+1, N1\+1\[, runs\]\), received \(5,\)"):
            measure(np.zeros(5), 1.0, seed=1)
        with pytest.raises(ValueError, match="sigma_n: expected a number >= 0, received -1"):
            measure(np.zeros((5, 3)), -1.0, seed=1)


def data_of(field, steps, sigma_n=1.0, seed=4, runs=1):
    """Simulated measurements, from t1 on."""
    return measure(field.simulate(steps, seed, runs), sigma_n, seed)[1:]


class TestFilters:
    @several
    @given(random_fields(nodes=5), st.floats(0.05, 5.0), st.floats(0.0, 20.0))
    def test_dense_and_exact_are_the_textbook_filter(self, field, sigma_n, P0):
        """Both equal plain prediction and update on the printed matrices, for any coefficients."""
        z = data_of(field, 15, sigma_n)
        plain = recursion(field.model(sigma_n, P0), np.concatenate([np.full((1, 6), np.nan), z]))
        for run in (filter_dense, filter_exact):
            found = run(field, z, sigma_n=sigma_n, P0=P0)
            assert close(found.z_hat, plain.x_plus[:, :6], SOLVER)
            assert close(found.variance, np.diagonal(plain.P_plus, axis1=1, axis2=2)[:, :6], SOLVER)
            assert (found.truncation, found.half_width) == (0.0, 5)

    def test_structure_gives_the_same_numbers(self):
        """With the paper's numbers and several runs, to rounding; not so when the model is wrong by 5 % in one number."""
        z = data_of(PAPER, 100, runs=3)
        dense, exact = (run(PAPER, z, sigma_n=1.0) for run in (filter_dense, filter_exact))
        assert close(exact.z_hat, dense.z_hat, EXACT)
        assert close(exact.variance, dense.variance, EXACT)
        wrong = filter_exact(replace(PAPER, b11=1.05), z, sigma_n=1.0)
        assert not close(wrong.z_hat, dense.z_hat, 1e-4)

    def test_gains_computed_before_serve_all_seeds(self):
        """A schedule passed in gives the same estimates."""
        z = data_of(SMALL, 20, runs=2)
        plan = covariances(SMALL.model(1.0, 10.0), 20, algorithm="joseph")
        assert np.array_equal(
            filter_dense(SMALL, z, sigma_n=1.0, gains=plan).z_hat, filter_dense(SMALL, z, sigma_n=1.0).z_hat
        )

    @several
    @given(st.integers(0, 2**32 - 1), st.floats(0.0, 1.0))
    def test_gaps_are_filtered_exactly(self, seed, share):
        """Any pattern of missing nodes and times: structure equals the dense filter."""
        rng = np.random.default_rng(seed)
        z = data_of(SMALL, 15, runs=2)
        z[rng.random((16, 7))[1:] < share] = np.nan
        dense, exact = (run(SMALL, z, sigma_n=1.0) for run in (filter_dense, filter_exact))
        assert close(exact.z_hat, dense.z_hat, 1e-10)
        assert close(exact.variance, dense.variance, 1e-10)

    def test_a_precise_measurement_keeps_its_digits(self):
        """Where the variance falls to 1e-12 of the prior the structured update subtracts nothing."""
        field = replace(PAPER, N1=2)
        z = data_of(field, 3, sigma_n=1e-4)
        exact = filter_exact(field, z, sigma_n=1e-4, P0=1e4)
        with mpmath.workdps(60):
            model = field.model(1e-4, 1e4)
            Phi, Q, H, P, R = (mpmath.matrix(m.tolist()) for m in (model.Phi, model.Qd, model.H, model.P0, model.R))
            for k in range(1, 4):
                P = Phi * P * Phi.T + Q
                P = P - P * H.T * mpmath.inverse(H * P * H.T + R) * H * P
                want = [float(P[i, i]) for i in range(3)]
                assert np.allclose(exact.variance[k], want, rtol=1e-9, atol=0)

    def test_errors_have_the_variance_claimed(self):
        """With X_0 = 0 known to the filter its claim is the truth, at every node and step."""
        z = PAPER.simulate(60, seed=8, runs=400)
        found = filter_exact(PAPER, measure(z, 1.0, seed=8)[1:], sigma_n=1.0, P0=0.0)
        assert chance.mean_square(found.z_hat - z, found.variance).passed
        assert not chance.mean_square(found.z_hat - z, 1.3 * found.variance).passed

    @pytest.mark.parametrize("name", FILTERS)
    @pytest.mark.parametrize(
        ("z", "message"),
        [
            (np.zeros((5, 6)), r"measured: expected shape \(rows, 7\[, runs\]\), received \(5, 6\)"),
            (np.zeros(7), r"measured: expected shape .*received \(7,\)"),
            (np.zeros((0, 7)), r"measured: expected shape .*received \(0, 7\)"),
            (
                np.full((5, 7), np.inf),
                r"z\[0\]\[0\]: expected finite numbers, or NaN in every run, received an infinite",
            ),
            (np.where(np.arange(2) == 1, np.nan, np.zeros((5, 7, 1))), "received NaN in some runs only"),
        ],
    )
    def test_data_that_do_not_fit_are_refused(self, name, z, message):
        """Shape, infinity, and NaN in some runs only."""
        with pytest.raises(ValueError, match=message):
            FILTERS[name](SMALL, z, sigma_n=1.0)

    @pytest.mark.parametrize("name", FILTERS)
    @pytest.mark.parametrize(
        "wrong", [{"sigma_n": 0.0}, {"sigma_n": 1.0, "P0": -1.0}]
    )
    def test_numbers_out_of_range_are_refused(self, name, wrong):
        """σ_n > 0, P0 ≥ 0."""
        with pytest.raises(ValueError, match=f"{list(wrong)[-1]}: expected a number"):
            FILTERS[name](SMALL, np.zeros((3, 7)), **wrong)

    def test_a_tolerance_is_a_positive_number(self):
        """tolerance > 0, of the filter that has one."""
        with pytest.raises(ValueError, match="tolerance: expected a number"):
            filter_local(SMALL, np.zeros((3, 7)), sigma_n=1.0, tolerance=0.0)


class TestLongFields:
    LONG = replace(PAPER, N1=260)

    @pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-9])
    def test_local_is_exact_within_the_tolerance(self, tolerance):
        """Boundary layers and a convolution reproduce the exact filter; what was left out is reported."""
        z = data_of(self.LONG, 40, runs=2)
        exact, local = (
            filter_exact(self.LONG, z, sigma_n=1.0),
            filter_local(self.LONG, z, sigma_n=1.0, tolerance=tolerance),
        )
        assert 0 < local.truncation <= tolerance
        assert close(local.z_hat, exact.z_hat, tolerance)
        assert close(local.variance, exact.variance, tolerance)

    def test_a_smaller_tolerance_needs_a_wider_window(self):
        """The half-width grows like the logarithm of the tolerance."""
        z = np.zeros((20, 401))
        widths = [
            filter_local(replace(PAPER, N1=400), z, sigma_n=1.0, tolerance=10.0**-n).half_width for n in (3, 6, 9)
        ]
        assert widths == sorted(set(widths))
        assert 0.5 < (widths[2] - widths[1]) / (widths[1] - widths[0]) < 2

    def test_one_run_is_one_of_many(self):
        """Runs do not mix in the convolution."""
        z = data_of(self.LONG, 10, runs=3)
        many = filter_local(self.LONG, z, sigma_n=1.0).z_hat
        assert close(many[:, :, 1], filter_local(self.LONG, z[:, :, 1], sigma_n=1.0).z_hat, EXACT)

    def test_a_short_field_is_filtered_exactly(self):
        """Where the window is as long as the field nothing is left out."""
        z = data_of(PAPER, 20)
        exact, local = filter_exact(PAPER, z, sigma_n=1.0), filter_local(PAPER, z, sigma_n=1.0)
        assert np.array_equal(local.z_hat, exact.z_hat)
        assert (local.truncation, local.half_width) == (0.0, 30)

    def test_a_tolerance_below_rounding_is_refused(self):
        """The message says which tolerance is reached."""
        with pytest.raises(
            ValueError,
            match=r"tolerance: expected at least \d\.\de-1\d \(what half-width \d+ reaches\), received 1e-18",
        ):
            filter_local(replace(PAPER, N1=600), np.zeros((5, 601)), sigma_n=1.0, tolerance=1e-18)

    def test_gaps_in_a_long_field(self):
        """Missing nodes, missing times and a dead end are filtered in windows, within the tolerance."""
        field = replace(PAPER, N1=320)
        z = data_of(field, 15)
        z[3:8, 150:153] = np.nan
        z[10] = np.nan
        z[5:, 0] = np.nan
        exact, local = filter_exact(field, z, sigma_n=1.0), filter_local(field, z, sigma_n=1.0, tolerance=1e-4)
        assert local.half_width < 60
        assert close(local.z_hat, exact.z_hat, 1e-4)
        assert close(local.variance, exact.variance, 1e-4)
        ignored = np.where(np.isnan(z), 0.0, z)
        assert not close(filter_local(field, ignored, sigma_n=1.0, tolerance=1e-4).z_hat, exact.z_hat, 1e-2)

    def test_cost_is_linear_in_length(self):
        """Twenty thousand nodes are no trouble, and far from the ends the claim does not depend on the length."""
        field = replace(PAPER, N1=20_000)
        local = filter_local(field, data_of(field, 5), sigma_n=1.0)
        short = filter_exact(self.LONG, np.zeros((5, 261)), sigma_n=1.0)
        assert local.z_hat.shape == (6, 20_001)
        assert close(local.variance[:, 10_000], short.variance[:, 130], SOLVER)


class TestMeanSquare:
    def test_the_right_variance_passes_for_any_seed(self):
        """No false alarm in a hundred experiments of few runs."""
        variance = np.array([[0.0, 1.0, 4.0]])
        for seed in range(100):
            sample = np.sqrt(variance)[..., None] * np.random.default_rng(seed).standard_normal((1, 3, 5))
            assert chance.mean_square(sample, variance).passed

    def test_a_wrong_variance_and_a_wrong_zero_are_noticed(self):
        """Five per cent with many runs; anything but rounding where the theory has zero."""
        sample = np.random.default_rng(1).standard_normal((2, 50_000))
        assert chance.mean_square(sample, [1.0, 1.0]).passed
        assert not chance.mean_square(sample, [1.0, 1.05]).passed
        assert not chance.mean_square(1e-6 * sample, [1e-12, 0.0]).passed
        assert chance.mean_square(np.zeros((2, 4)), [0.0, 0.0]).passed


class TestPictures:
    def test_figures_of_a_field_have_labels_with_units(self):
        """Surface, maps with colour bars, gain rows, errors against noise."""
        z, x, t = SMALL.simulate(10, seed=1), SMALL.x, 0.2 * np.arange(11)
        surface = plots.surface(x, t, z, xlabel="place x, m", tlabel="time t, s", zlabel="z, u")
        maps = plots.maps(
            x, t, {"z, u": z, "error, u": 0 * z}, xlabel="place x, m", tlabel="time t, s", common=["z, u"]
        )
        rows = plots.gain_rows(range(7), {"k = 1": (z[5], z[6])}, xlabel="number", ylabels=("gain", "gain, 1/s"))
        group = {
            "noise": [1, 2],
            "printed": [0.3, 0.5],
            "true": [0.4, 0.6],
            "bound": [0.35, 0.55],
            "low": [0.3, 0.5],
            "high": [0.5, 0.7],
        }
        errors = plots.errors_by_noise(
            {"a": group, "b": {k: v for k, v in group.items() if k not in ("low", "high")}},
            xlabel="σ_n, u",
            ylabel="σ_ε, u",
        )
        for figure in (surface, maps, rows, errors):
            assert isinstance(figure, Figure)
            figure.canvas.draw()
        assert surface.axes[0].get_zlabel() == "z, u"
        assert [axes.get_ylabel() for axes in maps.axes if axes.get_ylabel() != "place x, m"] == ["z, u", "error, u"]
        assert rows.axes[1].get_ylabel() == "gain, 1/s"
        assert errors.axes[0].get_ylim()[1] >= 0.7
