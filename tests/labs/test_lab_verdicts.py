"""What labs say where it matters: an alarm's margin, and a filter that is worth while."""

import numpy as np
import pytest
from ctlabs.tasks.answers import task09

from ctlabs.labs import catalogue as labs
from tests.labs.test_tasks import numbers

LABS = labs.catalogue()


@pytest.mark.parametrize("limit", [2.0, 3.0])
@pytest.mark.parametrize("left", [0.05, 0.3, 0.73])
def test_the_margin_bounds_the_share_of_dangerous_moments_that_is_missed(left, limit):
    """Of voltages above the limit, drawn as such, one in a hundred has an estimate that gives no alarm; errors are 6 σ of the count."""
    random, runs = np.random.default_rng(5), 400_000
    candidate = limit + random.exponential(1 / limit, 4 * runs)  # the tail of a normal density, by rejection
    voltage = candidate[random.random(4 * runs) < np.exp(-0.5 * (candidate - limit) ** 2)][:runs]
    estimate = (1 - left) * voltage + np.sqrt(left * (1 - left)) * random.standard_normal(len(voltage))
    missed = float(np.mean(estimate + task09.margin(left, limit) * np.sqrt(left) < limit))
    assert abs(missed - 0.01) < 6 * np.sqrt(0.01 / len(voltage))


@pytest.mark.parametrize(("left", "limit"), [(0.0, 2.0), (1e-9, 3.0)])
def test_an_estimate_that_is_all_but_exact_needs_no_margin(left, limit):
    """It misses less than the share that is allowed, without any."""
    assert task09.margin(left, limit) == 0.0


@pytest.mark.slow
@pytest.mark.parametrize(("sigma_theta", "worth"), [(0.03, True), (0.2, False)])
def test_decorrelation_is_worth_while_only_where_the_true_sensor_agrees(sigma_theta, worth):
    """At fixed geometry it gains in both cases; with a bearing error of 0.2 rad the true sensor shows it to be worse."""
    report = numbers(LABS["task05"], runs=400, sigma_theta=sigma_theta)
    assert max(report.values["variance_ratio_steady"].value) > 1.1
    assert report.values["verdict_g"].value is worth
