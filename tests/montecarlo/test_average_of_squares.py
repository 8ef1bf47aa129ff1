"""The test of an average of squares: exact where it is one χ², on the safe side of every other form."""

import numpy as np
import pytest

from ctlabs.montecarlo import chance


@pytest.mark.parametrize("runs", [1, 10, 1000])
@pytest.mark.parametrize("seed", range(5))
def test_a_form_of_squares_is_never_judged_harder_than_it_deserves(runs: int, seed: int) -> None:
    """Σλχ²(runs)/runs far above its mean: no farther than by its own distribution; the same where all λ but one are 0."""
    rng = np.random.default_rng(seed)
    weights = rng.exponential(size=4) ** 3
    mean, sd = weights.sum(), np.sqrt(2 * (weights**2).sum() / runs)
    for apart in (4.0, 8.0, 12.0):
        own = chance.weighted_chi2_quantile(runs * (mean + apart * sd), weights, runs)
        assert abs(chance.average_of_squares(mean + apart * sd, mean, sd, runs).value) <= own * (1 + 0.02)
        one = chance.average_of_squares(1 + apart * np.sqrt(2 / runs), 1.0, np.sqrt(2 / runs), runs)
        assert one.value == pytest.approx(float(chance.chi2_quantile(runs + apart * np.sqrt(2 * runs), runs)), rel=1e-12)


def test_a_wrong_expectation_is_found() -> None:
    """Eight standard deviations above and below."""
    assert not chance.average_of_squares(1.8, 1.0, 0.1, 10_000).passed
    assert not chance.average_of_squares(0.2, 1.0, 0.1, 10_000).passed
    assert chance.average_of_squares(1.1, 1.0, 0.1, 10_000).passed
