"""Measurement updates: one after another equals all at once exactly when the noises are independent, and other orders."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings

from ctlabs.filtering import covariances, kalman_filter, pairing, pointmass, relinearised, update, updates
from ctlabs.filtering.extended import Extended
from ctlabs.models import DiscreteModel
from ctlabs.models.nonlinear import NonlinearModel
from ctlabs.montecarlo import chance, monte_carlo
from tests import reference
from tests.reference import EXACT, SOLVER, broken, close
from tests.strategies import seeds

pytestmark = pytest.mark.numerical

QUIET = {"workers": 1, "progress": False}


def drawn(seed, n, m, *, correlated=True):
    """x, P, z, H, R of an update."""
    rng = np.random.default_rng(seed)
    A, B = rng.normal(size=(n, n)), rng.normal(size=(m, m))
    R = B @ B.T + 0.1 * np.eye(m)
    return (
        rng.normal(size=n),
        A @ A.T,
        rng.normal(size=m),
        rng.normal(size=(m, n)),
        R if correlated else np.diag(np.diag(R)),
    )


def agree(a, b, tolerance=1e-9):
    return close(a.x, b.x, tolerance) and close(a.P, b.P, tolerance)


SIZES = pytest.mark.parametrize(("n", "m"), [(1, 1), (1, 3), (2, 2), (4, 2), (3, 5)])


@settings(max_examples=20, deadline=None, derandomize=True)
@given(seed=seeds)
@SIZES
def test_joint_is_the_textbook_update(n, m, seed):
    """All elements at once give the estimate and covariance of the plain formula."""
    case = drawn(seed, n, m)
    x, P, _ = reference.update(*case)
    assert agree(updates.joint(*case), updates.Estimate(x, P))


@settings(max_examples=20, deadline=None, derandomize=True)
@given(seed=seeds)
@SIZES
def test_sequential_is_joint_for_independent_noises(n, m, seed):
    """With R diagonal the elements may be processed one after another."""
    case = drawn(seed, n, m, correlated=False)
    assert agree(updates.sequential(*case), updates.joint(*case))
    if m > 1:
        assert not agree(updates.sequential(*case[:4], broken(case[4])), updates.joint(*case))


@settings(max_examples=20, deadline=None, derandomize=True)
@given(seed=seeds)
@pytest.mark.parametrize(("n", "m"), [(1, 3), (2, 2), (4, 2), (3, 5)])
def test_decorrelated_sequential_is_joint_for_correlated_noises(n, m, seed):
    """After L⁻¹ the noises are independent and one after another gives the same as all at once; H must be transformed too."""
    x, P, z, H, R = drawn(seed, n, m)
    new = updates.decorrelate(H, R)
    inverse = np.linalg.inv(new.L)
    assert close(inverse @ R @ inverse.T, new.R, 1e-10)
    assert close(np.tril(new.L), new.L, EXACT)
    assert (np.diag(new.L) == 1).all()
    expected = updates.joint(x, P, z, H, R)
    assert agree(updates.sequential(x, P, new.measurements(z), new.H, new.R), expected, SOLVER)
    assert not agree(updates.sequential(x, P, new.measurements(z), H, new.R), expected, SOLVER)  # the old H
    assert not agree(updates.sequential(x, P, z, H, np.diag(np.diag(R))), expected, SOLVER)  # correlation neglected


def test_a_singular_covariance_is_decorrelated_into_a_perfect_measurement():
    """v2 = 3 v1: z2 − 3 z1 has no noise, and the sequential update uses it as such."""
    x, P, z, H, R = [0.0, 0.0], np.eye(2), [1.0, 2.0], [[1.0, 0.0], [1.0, 1.0]], [[1.0, 3.0], [3.0, 9.0]]
    new = updates.decorrelate(H, R)
    assert new.d.tolist() == [1, 0]
    found = updates.sequential(x, P, new.measurements(z), new.H, new.R)
    assert agree(found, updates.joint(x, P, z, H, R))
    assert close(new.H[1] @ found.x, -1.0, EXACT)


def test_a_decorrelated_model_gives_the_same_filter_over_time():
    """Schedule and estimates are unchanged when R, H and the data are transformed at every step."""
    rng = np.random.default_rng(5)
    R = np.array([np.diag([1.0, 2.0]) + 0.9 * np.cos(k) * np.array([[0, 1], [1, 0]]) for k in range(9)])
    model = DiscreteModel([[1, 1], [0, 0.9]], np.diag([0.1, 0.2]), np.eye(2), R, x0=[0, 1], P0=np.eye(2))
    for wanted, z in ((model, rng.normal(size=(9, 2))), (model, rng.normal(size=(9, 2, 3)))):
        z[0] = np.nan
        new, by = updates.decorrelated(wanted)
        changed = by.measurements(z)
        assert changed.shape == z.shape
        own, plain = kalman_filter(new, changed[1:], algorithm="filterpy"), kalman_filter(wanted, z[1:], algorithm="filterpy")
        assert close(own.x_plus, plain.x_plus, 1e-10)
        assert close(covariances(new, 8, algorithm="filterpy").P_plus, covariances(wanted, 8, algorithm="filterpy").P_plus, 1e-10)
    constant = DiscreteModel([[1]], [[1]], [[1], [2]], [[2, 1], [1, 3]], x0=[0], P0=[[4]], N=[[0.3, -0.4]])
    z = rng.normal(size=(7, 2, 4))
    new, by = updates.decorrelated(constant)
    whole = kalman_filter(new, np.array([by.measurements(each) for each in z])[1:], algorithm="filterpy").x_plus
    assert close(whole, kalman_filter(constant, z[1:], algorithm="filterpy").x_plus, 1e-10)


CASES = [(3.0, 0.5, (3.0, 1.0), 1.0, 0.3), (0.2, 2.0, (0.0, -0.4), 0.5, 0.01), (-4.0, 0.1, (-7.0, 0.9), 2.0, 4.0)]


def sensor(x):
    return np.array([2 * x[0], np.sin(x[0])])


def slope(x):
    return np.array([[2.0 + 0 * x[0]], [np.cos(x[0])]])


@pytest.mark.parametrize(("x", "P", "z", "r1", "r2"), CASES)
def test_a_fixed_linearisation_keeps_sequential_and_joint_equal(x, P, z, r1, r2):
    """Along one straight line the order does not matter; relinearised it does."""
    one, other, again = (relinearised.extended([x], [[P]], z, sensor, slope, np.diag([r1, r2]), o) for o in relinearised.ORDERS)
    assert agree(one, other, 1e-12)
    assert not agree(one, again, 1e-3)
    first = updates.joint([x], [[P]], z[:1], [[2.0]], [[r1]])
    by_hand = (z[1] - np.sin(first.x)) * first.P[0, 0] * np.cos(first.x)
    assert close(again.x, first.x + by_hand / (np.cos(first.x) ** 2 * first.P[0, 0] + r2), 1e-12)


def test_a_linear_sensor_makes_all_orders_equal():
    """For h(x) = Hx the extended filter is the linear one, in every order."""
    x, P, z, H, R = drawn(3, 3, 2, correlated=False)
    expected = updates.joint(x, P, z, H, R)
    for order in relinearised.ORDERS:
        assert agree(relinearised.extended(x, P, z, lambda y: H @ y, lambda _: H, R, order), expected)


@pytest.mark.parametrize("width", [1.0, 1e-3, 1e-7])
def test_quadrature_finds_peaks_however_narrow(width):
    """Mean and variance of two normal peaks far apart, by their closed form; a peak it is not told of is missed."""
    a, b, share = -1.0, 2.5, 0.3

    def logs(x):
        return np.logaddexp(
            np.log(share) - 0.5 * ((x - a) / width) ** 2, np.log1p(-share) - 0.5 * ((x - b) / width) ** 2
        )

    found = pointmass.posterior_by_quadrature(logs, [a, b], -20.0, 20.0)
    mean = share * a + (1 - share) * b
    assert close(found.x, mean, 1e-10)
    assert close(found.P, width**2 + share * (1 - share) * (a - b) ** 2, 1e-10)
    assert not close(pointmass.posterior_by_quadrature(logs, [a, 1.05 * b], -20.0, 20.0).x, mean, 1e-10) or width == 1


@pytest.mark.parametrize("width", [1.0, 1e-3])
def test_quadrature_agrees_with_mpmath(width):
    """A density that is not Gaussian, integrated by another rule with more digits."""
    with mpmath.workdps(16):

        def density(x):
            return mpmath.exp(-((x - 2) ** 2) * 3 - (mpmath.mpf(1) - mpmath.sin(x)) ** 2 / (2 * width))

        edges = mpmath.linspace(-5, 9, 141)
        mass, first = mpmath.quad(density, edges), mpmath.quad(lambda x: x * density(x), edges)
        wanted = float(first / mass)
    found = pointmass.posterior_by_quadrature(
        lambda x: -((x - 2) ** 2) * 3 - (1 - np.sin(x)) ** 2 / (2 * width),
        [np.pi / 2, -1.5 * np.pi, 2.5 * np.pi],
        -5,
        9,
    )
    assert close(found.x, wanted, 1e-9)


def scalar(r2=0.3, steps=None, Q=0.05):
    """x' = 0.7x + 0.2 + w seen through 2x and sin x; with ``steps`` the second element is missing at step 2."""
    R = np.diag([1.0, r2])
    if steps:
        R = np.repeat(R[None], steps + 1, axis=0)
        R[2, 1, 1] = np.inf
    return NonlinearModel(
        f=lambda k, x, w: 0.7 * x + 0.2 + w, h=lambda k, x, v: np.array([2 * x[0], np.sin(x[0])]) + v,
        F=lambda k, x: np.array([[0.7]]), H=lambda k, x: slope(x), Qd=[[Q]], R=R, x0=[4], P0=[[1]],
    )  # fmt: skip


def data(model, steps, runs, seed=3):
    rng = np.random.default_rng(seed)
    return [np.array([6.0, 0.1])[:, None] + rng.normal(size=(2, runs)) for _ in range(steps)]


def test_the_sequential_filter_of_many_runs_is_that_of_each():
    """Every run's recursion by instants, with a missing element left out."""
    model = scalar(steps=4)
    many, each = relinearised.SequentialExtended(model), [updates.Estimate(model.x0, model.P0)] * 3
    many.start(3)
    for k, z in enumerate(data(model, 4, 3), start=1):
        many.predict(k)
        nis, used = many.update(k, z)
        m = 1 if k == 2 else 2
        assert used == m
        for run_, (x, P) in enumerate(each):
            before = updates.Estimate(0.7 * x + 0.2, 0.49 * P + 0.05)
            some, rows = (lambda y, m=m: sensor(y)[:m]), (lambda y, m=m: slope(y)[:m])
            each[run_] = relinearised.extended(*before, z[:m, run_], some, rows, model.R[k, :m, :m], "relinearised")
        assert close(many.x, np.array([e.x for e in each]).T, 1e-12)
        assert close(many.P[0, 0], [e.P[0, 0] for e in each], 1e-12)
        assert (nis > 0).all()


def test_with_a_linear_sensor_it_is_the_extended_filter_of_montecarlo():
    """All elements at once (montecarlo.Extended) and one after another agree on several states, a perfect element included."""
    H = np.array([[1.0, 0.0], [1.0, 1.0]])
    Phi = np.array([[1.0, 1.0], [0.0, 0.9]])
    model = NonlinearModel(
        f=lambda k, x, w: Phi @ x + w, h=lambda k, x, v: H @ x + v, F=lambda k, x: Phi, H=lambda k, x: H,
        Qd=np.diag([0.1, 0.2]), R=np.diag([0.5, 0.0]), x0=[1, 2], P0=np.eye(2),
    )  # fmt: skip
    one, other = relinearised.SequentialExtended(model), Extended(model)
    for each in (one, other):
        each.start(5)
    for k, z in enumerate(data(model, 3, 5), start=1):
        results = []
        for each in (one, other):
            each.predict(k)
            results.append(each.update(k, z)[0])
        assert close(one.x, other.x, 1e-10)
        assert close(one.P, other.P, 1e-10)
        assert close(*results, 1e-9)


def test_the_point_mass_filter_is_the_kalman_filter_of_a_linear_system():
    """On a grid fine enough Bayes' rule gives the Kalman filter's moments and its innovations squared."""
    model = NonlinearModel(
        f=lambda k, x, w: 0.7 * x + 0.2 + w, h=lambda k, x, v: np.array([2 * x[0], 0.5 * x[0]]) + v,
        Qd=[[0.05]], R=np.diag([1.0, 0.3]), x0=[4], P0=[[1]],
    )  # fmt: skip
    linear = DiscreteModel([[0.7]], [[0.05]], [[2.0], [0.5]], np.diag([1.0, 0.3]), x0=[4], P0=[[1]], offset=[0.2])
    z = data(model, 4, 3)
    record = np.array([np.full((2, 3), np.nan), *z])
    expected = kalman_filter(linear, record[1:], algorithm="filterpy")
    bayes = pointmass.PointMass(model, np.linspace(-8, 16, 321))
    bayes.start(3)
    for k in range(1, 5):
        bayes.predict(k)
        nis, used = bayes.update(k, z[k - 1])
        assert used == 2
        assert close(bayes.x, expected.x_plus[k], 1e-8)
        assert close(bayes.P[0, 0], np.full(3, expected.P_plus[k, 0, 0]), 1e-8)
        nu, S = expected.innovation[k], expected.S[k]
        assert close(nis, np.einsum("ir,ij,jr->r", nu, np.linalg.inv(S), nu), 1e-6)


def test_the_point_mass_filter_agrees_with_quadrature():
    """One update through the sine equals the posterior integrated by panels."""
    model, z = scalar(), np.array([[3.0, 5.0], [1.0, -0.4]])
    bayes = pointmass.PointMass(model, np.linspace(-4, 10, 281))
    bayes.start(2)
    bayes.predict(1)
    bayes.update(1, z)
    P_minus = 0.49 + 0.05
    for each in range(2):

        def logs(x, z=z[:, each]):
            return -0.5 * ((x - 3) ** 2 / P_minus + (z[0] - 2 * x) ** 2 + (z[1] - np.sin(x)) ** 2 / 0.3)

        exact = pointmass.posterior_by_quadrature(logs, [2.0], -5.0, 11.0)
        assert close(bayes.x[0, each], exact.x[0], 1e-9)
        assert close(bayes.P[0, 0, each], exact.P[0, 0], 1e-9)


def test_the_exact_filter_is_best_and_its_gaussianised_innovations_are_chi_square():
    """Over an ensemble the point-mass filter passes the exact NIS test, and no extended filter has a smaller mean square."""
    model = scalar(r2=0.1, Q=0.3)
    grid = np.linspace(-8, 14, 221)
    common = {"steps": 3, "runs": 2000, "seed": 4, **QUIET}
    exact = monte_carlo(model, lambda: pointmass.PointMass(model, grid), **common)
    assert chance.nis(exact)
    wrong = scalar(r2=0.2, Q=0.3)
    assert not chance.nis(monte_carlo(model, lambda: pointmass.PointMass(wrong, grid), **common))
    for design in (model, lambda: relinearised.SequentialExtended(model)):
        assert (exact.rms[1:] < monte_carlo(model, design, **common).rms[1:]).all()


def test_filters_run_together_give_what_they_give_alone():
    """Stacked on the same data two filters have their own statistics, and the covariance between their errors."""
    model = scalar(r2=0.05, Q=0.3)
    common = {"steps": 3, "runs": 3000, "seed": 8, **QUIET}

    def both():
        return pairing.Together(Extended(model), relinearised.SequentialExtended(model))

    stats = monte_carlo(model, both, compare=[[1.0], [1.0]], **common)
    alone = [monte_carlo(model, design, **common) for design in (model, lambda: relinearised.SequentialExtended(model))]
    assert close(stats.rms, np.hstack([each.rms for each in alone]), EXACT)
    clear = pairing.paired(stats.second_moment, stats.runs)
    assert clear.shape == (4, 1)
    assert clear[0] == 0
    assert clear[1] > 5  # the line at the prediction is worse
    assert pairing.paired(stats.second_moment[..., ::-1, ::-1], stats.runs) == pytest.approx(-clear)


def test_a_paired_comparison_has_unit_variance_for_equal_filters():
    """For Gaussian errors of equal variance, correlated between the filters, the comparison is standard normal."""
    rng = np.random.default_rng(2)
    e = rng.normal(size=(2, 400, 2000))
    e[1] = 0.9 * e[0] + np.sqrt(1 - 0.81) * e[1]
    scores = pairing.paired(np.einsum("anr,bnr->rab", e, e) / 400, 400)[:, 0]
    assert abs(scores.mean()) < 5 / np.sqrt(2000)
    assert abs(scores.std() - 1) < 5 / np.sqrt(4000)


def counted(n, m, way):
    """Operations of an update by formula: products of matrices, elimination on the lower half, rank-one corrections."""
    if way == "sequential":
        return m * (n * (2 * n - 1) + 2 * n + n + 2 * n + 2 * n + 2 * n * n)

    def eliminate(columns):
        return sum(1 + 2 * (m - i) + 2 * columns for j in range(m) for i in range(j + 1, m))

    if way == "decorrelation":
        return eliminate(n + 1)
    products = m * n * (2 * n - 1) + m * m * (2 * n - 1) + m * m + m * 2 * n
    return products + eliminate(n + 1) + m * n + n * (2 * m - 1) + n + n * n * (2 * m - 1) + n * n


@SIZES
@pytest.mark.parametrize("way", updates.WAYS)
def test_flops_are_counted_as_a_formula_counts_them(n, m, way):
    """The count made while an update is done equals the sum over its products."""
    assert updates.flops(n, m, way) == counted(n, m, way)


def plain(n, **derivatives):
    """A motion that stays where it is and is seen directly."""
    one = np.eye(n)
    return NonlinearModel(lambda k, x, w: x, lambda k, x, v: x + v, one, one, x0=np.zeros(n), P0=one, **derivatives)


def varying():
    """A model whose R varies, with correlated noises."""
    return DiscreteModel([[1]], [[1]], [[1]], np.ones((3, 1, 1)), x0=[0], P0=[[1]], N=[[0.1]])


CORRELATED = [[1, 0.5], [0.5, 1]]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: updates.sequential([0], [[1]], [1, 2], [[1], [1]], CORRELATED), "R: expected independent noises"),
        (lambda: relinearised.extended([0], [[1]], [1], sensor, slope, [[1]], "up"), "order: expected one of joint, fixed"),
        (lambda: relinearised.extended([0], [[1]], [1, 2], sensor, slope, CORRELATED, "relinearised"), "R: expected indep"),
        (lambda: updates.decorrelate([[1]], [[np.inf]]), "R: expected finite numbers"),
        (lambda: updates.decorrelate(np.ones((3, 1, 1)), np.ones((2, 1, 1))), "R: expected 3 entries"),
        (lambda: updates.decorrelated(varying()), "model: expected a constant R beside N"),
        (lambda: pointmass.posterior_by_quadrature(lambda x: x, [0.0], 1.0, 1.0), "low, high: expected low < high"),
        (
            lambda: pointmass.posterior_by_quadrature(lambda x: x - np.inf, [0.0], 0.0, 1.0),
            "log_density: expected finite",
        ),
        (lambda: updates.flops(2, 2, "up"), "way: expected one of"),
        (lambda: pairing.paired(np.eye(3), 5), "second_moment: expected shape"),
        (lambda: pointmass.PointMass(scalar(), [0.0, 1.0, 3.0]), "grid: expected at least three evenly spaced"),
        (lambda: pointmass.PointMass(scalar(r2=0.0), np.arange(4.0)), "model: expected R > 0 and P0 > 0"),
        (lambda: pointmass.PointMass(plain(2), np.arange(4.0)), "model: expected a scalar state"),
        (lambda: relinearised.SequentialExtended(plain(1)), "model: expected derivatives F, H"),
    ],
)
def test_bad_input_is_refused_with_what_was_expected(call, message):
    """One line that says what, expected, received."""
    with pytest.raises(ValueError, match=message):
        call()


def test_a_motion_without_noise_is_refused_by_the_grid():
    """A density on a fixed grid cannot follow x' = 0.7x exactly."""
    bayes = pointmass.PointMass(scalar(Q=0.0), np.linspace(-2, 8, 101))
    bayes.start(1)
    with pytest.raises(ValueError, match="Qd: expected > 0 at step 0"):
        bayes.predict(1)


def test_far_innovations_stay_finite():
    """A measurement twenty standard deviations off has a finite Gaussianised innovation, not an infinite one."""
    bayes = pointmass.PointMass(scalar(), np.linspace(-10, 26, 721))
    bayes.start(1)
    bayes.predict(1)
    sd = np.sqrt(4 * 0.54 + 1)
    nis, _ = bayes.update(1, np.array([[6.0 + 20 * sd], [np.nan]]))
    assert close(nis, 400.0, 1e-2)


@pytest.mark.parametrize("ratio", np.linspace(-3, 3, 13))
def test_noises_that_cancel_leave_no_negative_variance(ratio):
    """v2 = ratio·v1 exactly: a scalar state is known after both elements, with the variance 0 and not −1e-17."""
    found = update([[0.5]], [[2.0], [0.8]], np.outer([1.0, ratio], [1.0, ratio]))
    assert found.P_plus[0, 0] == 0
    nearly = np.outer([1.0, ratio], [1.0, ratio]) + np.diag([0, 1e-6])
    assert update([[0.5]], [[2.0], [0.8]], nearly).P_plus[0, 0] > 0
