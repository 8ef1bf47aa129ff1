"""The share of points outside their bands: its covariance by a series against integrals and draws, its band against many experiments."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate, stats

from ctlabs import DiscreteModel, covariances, monte_carlo
from ctlabs.montecarlo import chance, shares

#: The remainder of the series beyond its terms, of the indicator's variance: seen only next to a correlation of one.
REST = 5e-3


@pytest.mark.parametrize("rho", [0.3, 0.8, 0.95])
def test_the_covariance_is_that_of_two_squares(rho: float) -> None:
    """One run: P(|x| and |y| both outside) of a bivariate normal, by an integral over x of the conditional normal's tails."""
    low, high = np.sqrt(stats.chi2(1).ppf([0.025, 0.975]))
    sd = np.sqrt(1 - rho**2)

    def within(x: float) -> float:
        inner = sum(stats.norm.cdf((sign * end - rho * x) / sd) * weight for sign, end, weight in
                    ((1, high, 1), (1, low, -1), (-1, low, 1), (-1, high, -1)))  # fmt: skip
        return float(stats.norm.pdf(x) * inner)

    both = 2 * integrate.quad(within, low, high, epsabs=1e-12)[0]  # both inside
    wanted = both - 0.95**2  # of the complements, the same covariance
    assert shares.covariance(np.array([rho**2]), 1)[0] == pytest.approx(wanted, rel=2e-3, abs=REST * 0.0475 * rho**400)


def test_many_runs_are_a_normal_distribution() -> None:
    """Of 10⁶ runs the mean squares are normal: the covariance is that of two-sided exceedances at the correlation ρ²."""
    r = 0.6
    points = [1.959963984540054, -1.959963984540054]
    cdf = stats.multivariate_normal([0, 0], [[1, r], [r, 1]]).cdf
    inside = sum(sign * cdf(corner) for sign, corner in (
        (1, [points[0], points[0]]), (-1, [points[0], points[1]]), (-1, [points[1], points[0]]), (1, [points[1], points[1]])))  # fmt: skip
    assert shares.covariance(np.array([r]), 10**6)[0] == pytest.approx(inside - 0.95**2, rel=0.01)


@pytest.mark.parametrize("runs", [1, 7, 100, 10**5])
def test_the_ends_are_known(runs: int) -> None:
    """Independent points do not vary together, equal ones as one; between them it only grows."""
    values = shares.covariance(np.linspace(0, 1, 200), runs)
    assert values[0] == pytest.approx(0, abs=1e-15)
    assert values[-1] == pytest.approx(0.05 * 0.95, rel=1e-12)
    assert (np.diff(values) >= 0).all()


def test_the_band_holds_what_chance_gives() -> None:
    """Of 300 experiments with slow errors some 5 % are outside a band that independent points would leave in a third of all."""
    model = DiscreteModel([[1]], [[0.01]], [[1]], [[1]], x0=[0], P0=[[1]])
    plan = covariances(model, 60)
    found = [shares.outside(monte_carlo(model, steps=60, runs=20, seed=seed, progress=False), model, plan) for seed in range(300)]
    values, low, high = (np.array([getattr(each, name) for each in found]) for name in ("value", "low", "high"))
    assert values.mean() == pytest.approx(0.05, abs=4 * values.std() / np.sqrt(len(values)))
    outside = ((values < low) | (values > high)).mean()
    assert stats.binomtest(int(outside * 300), 300, 0.05).pvalue > 1e-4
    naive = stats.binom(61, 0.05).ppf([0.025, 0.975]) / 61
    assert ((values < naive[0]) | (values > naive[1])).mean() > 3 * outside
    assert (np.array([each.p < 0.05 for each in found if each]) == ((values < low) | (values > high))).mean() > 0.97


def test_correlations_of_some_rows_are_those_of_all() -> None:
    """By name of the rows, to rounding."""
    model = DiscreteModel([[1, 0.1], [0, 0.9]], [[0.1, 0], [0, 0.2]], [[1, 0]], [[1]], x0=[0, 0], P0=np.eye(2))
    plan, rows = covariances(model, 30), [0, 3, 4, 17, 30]
    whole = chance.error_correlation(model, plan)
    np.testing.assert_allclose(chance.error_correlation(model, plan, rows), whole[:, rows][:, :, rows], rtol=1e-12)
