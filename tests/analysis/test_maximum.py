"""Maxima in a box, on functions whose maxima, curvature and profiles are known in closed form."""

import numpy as np
import pytest
from scipy import stats

from ctlabs.analysis import maximum
from ctlabs.analysis.maximum import Box
from tests.reference import EXACT, SOLVER, close

pytestmark = pytest.mark.numerical

COVARIANCE = np.array([[4.0, 1.5], [1.5, 1.0]])
MEAN = np.array([3.0, -2.0])


def gaussian(x):
    """The logarithm of a Gaussian density without its constant: everything about it is known."""
    return float(-0.5 * (x - MEAN) @ np.linalg.solve(COVARIANCE, x - MEAN))


def box(start, lower=None, upper=None):
    p = len(start)
    return Box(
        np.array(start, dtype=float),
        np.full(p, -np.inf) if lower is None else np.array(lower, dtype=float),
        np.full(p, np.inf) if upper is None else np.array(upper, dtype=float),
    )


class TestTop:
    def test_the_maximum_of_a_gaussian_is_its_mean_and_its_curvature_the_inverse_covariance(self):
        """Position, gradient and Hessian, from a start that is far away."""
        top = maximum.search(gaussian, box([100.0, 50.0]))
        assert close(top.at, MEAN, SOLVER)
        assert close(-np.linalg.inv(top.hessian), COVARIANCE, SOLVER)
        assert np.abs(top.gradient * top.width).max() < SOLVER
        assert top.converged
        assert top.free.all()

    @pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
    def test_units_do_not_matter(self, unit):
        """A function of x/unit has its maximum at the same multiple, as accurately."""
        scale = np.array([unit, 1 / unit])
        top = maximum.search(lambda x: gaussian(x / scale), box(10 * scale))
        assert close(top.at / scale, MEAN, SOLVER)
        assert close(-np.linalg.inv(top.hessian) / np.outer(scale, scale), COVARIANCE, SOLVER)

    def test_a_curved_valley_is_followed_to_its_end(self):
        """Rosenbrock's function has its maximum at (1, 1), with a known Hessian."""
        top = maximum.search(lambda x: float(-(100 * (x[1] - x[0] ** 2) ** 2 + (1 - x[0]) ** 2)), box([-1.2, 1.0]))
        assert top.value > -1e-12
        assert np.abs((top.at - 1) / top.width).max() < 1e-5
        assert close(top.hessian, [[-802.0, 400.0], [400.0, -200.0]], 1e-6)

    def test_positive_arguments_are_found_over_many_decades(self):
        """a ln x − x/s has its maximum at a·s, ten decades from the start."""
        top = maximum.search(lambda x: float(3 * np.log(x[0]) - x[0] / 1e10), box([1.0], [0.0]))
        assert close(top.at, [3e10], SOLVER)

    def test_the_highest_of_several_peaks_is_taken(self):
        """With more starts the search leaves the peak it began on."""

        def peaks(x):
            return float(np.logaddexp(-0.5 * (x[0] + 5) ** 2, 4 - 0.5 * (x[0] - 7) ** 2))

        inside = box([-5.0], [-20.0], [20.0])
        assert maximum.search(peaks, inside, starts=0).at[0] < 0
        assert maximum.search(peaks, inside).at[0] == pytest.approx(7.0, abs=1e-6)

    def test_where_a_function_is_not_defined_it_is_not_climbed(self):
        """−∞ beyond a line: the maximum inside is found."""
        top = maximum.search(lambda x: gaussian(x) if x[0] > 0 else -np.inf, box([0.5, 9.0]))
        assert close(top.at, MEAN, SOLVER)

    def test_a_kink_is_found_where_gradients_fail(self):
        """A roof has no gradient on its ridge: Nelder and Mead's simplex gets there, and no convergence is claimed."""
        top = maximum.search(
            lambda x: float(-30 * abs(x[0] - 1 + 0.9 * x[1]) - abs(x[1] - 2)), box([5.0, -3.0]), starts=0
        )
        assert close(top.at, [-0.8, 2.0], 1e-3)
        assert not top.converged


class TestBounds:
    def test_a_maximum_outside_is_replaced_by_the_best_point_of_the_bound(self):
        """x1 ≤ 1: the other argument takes its conditional mean, and the Hessian is that of the free one."""
        top = maximum.search(gaussian, box([0.0, 0.0], upper=[1.0, np.inf]))
        assert top.at[0] == 1.0
        assert top.at[1] == pytest.approx(MEAN[1] + 1.5 / 4 * (1 - 3), abs=1e-8)
        assert top.free.tolist() == [False, True]
        assert top.converged
        assert top.hessian[1, 1] == pytest.approx(-np.linalg.inv(COVARIANCE)[1, 1], rel=1e-8)
        assert np.isnan(top.hessian[0]).all()

    def test_a_positive_argument_may_end_on_zero(self):
        """−x falls from 0 on: the logarithmic search finds the bound itself."""
        top = maximum.search(lambda x: float(-5 * x[0]), box([1.0], [0.0]))
        assert top.at[0] == 0.0
        assert top.converged
        assert top.gradient[0] == pytest.approx(-5.0)

    def test_a_maximum_near_a_bound_is_not_pulled_onto_it(self):
        """A peak at 1e-3 of the range stays where it is."""
        top = maximum.search(lambda x: float(np.log(x[0]) - 1e3 * x[0]) if x[0] > 0 else -np.inf, box([1.0], [0.0]))
        assert top.at[0] == pytest.approx(1e-3, rel=1e-7)


class TestWidth:
    def test_at_a_maximum_it_is_the_standard_deviation(self):
        """A Gaussian falls by about ½ one conditional standard deviation away."""
        for i in range(2):
            sd = 1 / np.sqrt(np.linalg.inv(COVARIANCE)[i, i])
            assert maximum.width(gaussian, box(MEAN), MEAN, i, 1e-6) == pytest.approx(sd, rel=0.5)
            assert maximum.width(gaussian, box(MEAN), MEAN, i, 1e6) == pytest.approx(sd, rel=0.5)

    def test_a_flat_function_has_no_end(self):
        """It is the length at which the search gives up, not an endless loop."""
        assert maximum.width(lambda x: 0.0, box([1.0]), np.array([1.0]), 0, 1.0) > 1e9


class TestProfile:
    def test_the_profile_of_a_gaussian_is_that_of_its_marginal(self):
        """The others at their best: −½(x1 − mean)²/σ1², with σ1 of the marginal, and ±1.96σ1 as interval."""
        top = maximum.search(gaussian, box([0.0, 0.0]))
        for i in range(2):
            sd = np.sqrt(COVARIANCE[i, i])
            interval, found, best = maximum.profile(gaussian, box([0.0, 0.0]), top, i)
            quantile = stats.norm.ppf(0.975)
            assert close(interval, MEAN[i] + sd * quantile * np.array([-1, 1]), 1e-6)
            assert np.abs(found.log_likelihood + 0.5 * ((found.values - MEAN[i]) / sd) ** 2).max() < 1e-5
            assert (np.diff(found.values) > 0).all()
            assert found.values[0] < interval[0] < interval[1] < found.values[-1]
            assert gaussian(best) <= top.value + EXACT

    def test_without_the_others_at_their_best_it_would_be_narrower(self):
        """The slice through the maximum is the conditional distribution: 34 % narrower here, and not the profile."""
        top = maximum.search(gaussian, box([0.0, 0.0]))
        (low, high), _, _ = maximum.profile(gaussian, box([0.0, 0.0]), top, 0)
        conditional = 2 * 1.96 / np.sqrt(np.linalg.inv(COVARIANCE)[0, 0])
        assert high - low > 1.4 * conditional

    def test_an_end_is_a_bound_or_infinite_where_the_function_does_not_fall_enough(self):
        """1.92 is never lost: to the left lies a bound, to the right nothing."""
        inside = box([1.0], [0.0])

        def saturating(x):
            return float(-1.0 * (x[0] - 1) ** 2 / (1 + (x[0] - 1) ** 2))

        interval, found, _ = maximum.profile(saturating, inside, maximum.search(saturating, inside, starts=0), 0)
        assert interval == (0.0, np.inf)
        assert found.values[0] == 0.0
        assert np.isfinite(found.values).all()

    def test_a_profile_that_meets_a_higher_peak_tells_where(self):
        """From the lower peak of two the profile climbs the higher one, and reports it."""

        def peaks(x):
            return float(np.logaddexp(-0.5 * x[0] ** 2, 3 - 0.5 * (x[0] - 4) ** 2) - 0.5 * x[1] ** 2)

        inside = box([0.0, 1.0])
        _, _, best = maximum.profile(peaks, inside, maximum.finish(peaks, inside, np.array([0.0, 0.0])), 0)
        assert peaks(best) > peaks(np.zeros(2)) + 1


def test_the_hessian_is_of_sixth_order():
    """Halving the steps divides the error by about 2⁶; a plain central difference would give 2²."""
    x, exact = np.array([0.3, 0.5]), np.exp(0.3) * np.array([[np.sin(0.5), np.cos(0.5)], [np.cos(0.5), -np.sin(0.5)]])
    everything = np.array([True, True])

    def error(h):
        found = maximum.hessian(lambda x: float(np.exp(x[0]) * np.sin(x[1])), x, np.full(2, h), everything)
        return np.abs(found - exact).max()

    assert np.log2(error(1.6) / error(0.8)) == pytest.approx(6.0, abs=0.4)
    assert error(0.1) < SOLVER
