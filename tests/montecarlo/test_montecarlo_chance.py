"""Exact tests of chance: their quantiles, their false alarms, and what they notice."""

import dataclasses

import mpmath
import numpy as np
import pytest

from ctlabs.labs.experiment import covariances
from ctlabs.models import DiscreteModel
from ctlabs.montecarlo import chance, monte_carlo
from tests.reference import SOLVER, broken, close

MODEL = DiscreteModel([[0.9, 0.2], [0, 0.8]], [[1, 0.2], [0.2, 0.5]], [[1, 0]], [[0.7]], x0=[1, 2], P0=[[4, 1], [1, 2]])


def experiment(runs, seed=1, design=None, **options):
    return monte_carlo(MODEL, design, steps=25, runs=runs, seed=seed, progress=False, **options)


@pytest.mark.parametrize("dof", [1, 2, 7, 1000, 2_000_000])
@pytest.mark.parametrize("ratio", [1e-8, 0.3, 0.9, 0.999, 1.001, 1.1, 3.0, 1e4])
def test_quantiles_of_chi_square_equal_those_of_high_precision(dof, ratio):
    """The normal quantile of a χ² probability is right to 1e-8 from the middle to the farthest tail."""
    with mpmath.workdps(60):
        x, a = mpmath.mpf(ratio) * dof / 2, mpmath.mpf(dof) / 2
        lower = ratio < 1
        tail = mpmath.gammainc(a, 0, x, regularized=True) if lower else _upper(a, x)
        found = chance.chi2_quantile(ratio * dof, dof)
        assert np.isfinite(found)
        # The normal tail must be that tail; their logarithms are compared, for both may be far below any double.
        z = mpmath.mpf(float(found if lower else -found))
        log_phi = mpmath.log(mpmath.erfc(-z / mpmath.sqrt(2)) / 2)
        assert close(float(log_phi), float(mpmath.log(tail)), SOLVER)


def _upper(a, x):
    """The upper tail of the incomplete gamma function, by the series for the lower one where that keeps digits."""
    tail = mpmath.gammainc(a, x, regularized=True)
    return tail if tail > 0 else mpmath.exp(a * mpmath.log(x) - x - mpmath.loggamma(a)) / x


def test_quantiles_stay_finite_at_the_end_of_the_range():
    """No deviation, however absurd, gives infinity or NaN."""
    x = np.array([0.0, 1e-300, 1e-30, 1e12, 1e300])
    for dof in (1.0, 50.0, 1e7):
        found = chance.chi2_quantile(x, dof)
        assert np.isfinite(found).all()
        assert (np.diff(found) >= 0).all()


@pytest.mark.parametrize("runs", [1, 2, 30, 3000])
def test_a_correct_theory_passes_with_any_number_of_runs(runs):
    """Bias, variance, NEES and NIS of a matched filter pass for one run as for thousands."""
    schedule = covariances(MODEL, 25)
    for seed in range(30):
        stats = experiment(runs, seed, gains=schedule)
        for verdict in (
            chance.bias(stats, schedule.P_plus),
            chance.variance(stats, schedule.P_plus),
            chance.bias(stats, schedule.P_minus, when="minus"),
            chance.variance(stats, schedule.P_minus, when="minus"),
            chance.nees(stats),
            chance.nis(stats),
        ):
            assert verdict, str(verdict)
            assert verdict.value <= verdict.critical


def test_deviations_are_standard_normal():
    """Over 400 seeds the deviation of one variance and one mean, as quantiles, have the spread and mean of N(0, 1)."""
    schedule = covariances(MODEL, 25)
    scores = []
    for seed in range(400):
        stats = experiment(5, seed, gains=schedule)
        square = stats.cov[9, 1, 1] + stats.bias[9, 1] ** 2
        scores.append(
            [
                chance.chi2_quantile(5 * square / schedule.P_plus[9, 1, 1], 5),
                chance.chi2_quantile(5 * stats.nees[9], 5 * 2),
                chance.chi2_quantile(5 * stats.nis[9], 5),
                stats.bias[9, 1] / np.sqrt(schedule.P_plus[9, 1, 1] / 5),
            ]
        )
    z = np.array(scores)
    assert (np.abs(z.mean(axis=0)) < 5 / np.sqrt(400)).all()
    assert (np.abs(z.var(axis=0) - 1) < 5 * np.sqrt(2 / 400)).all()


def test_an_error_of_five_per_cent_is_found():
    """With enough runs one entry of the theory that is 5 % wrong fails, and the verdict says where."""
    stats = experiment(60_000)
    P = covariances(MODEL, 25).P_plus
    assert chance.variance(stats, P)
    verdict = chance.variance(stats, broken(P, (11, 1, 1)))
    assert not verdict
    assert verdict.where == (11, 1)
    assert str(verdict).startswith("disagrees: worst deviation")
    shifted = np.zeros((26, 2))
    shifted[4, 0] = 0.05 * np.sqrt(P[4, 0, 0])
    assert chance.bias(stats, P)
    assert chance.bias(stats, P, shifted).where == (4, 0)
    assert not chance.bias(stats, P, shifted)
    wrong = experiment(200_000, design=dataclasses.replace(MODEL, R=1.05 * MODEL.R))
    assert not chance.nis(wrong)


def test_a_variance_of_zero_is_met_to_rounding():
    """An exactly known state passes with an exact zero, and fails when theory says zero and the ensemble does not."""
    known = dataclasses.replace(MODEL, R=[[0.0]])
    schedule = covariances(known, 25)
    stats = monte_carlo(known, steps=25, runs=50, seed=1, progress=False)
    assert (schedule.P_plus[1:, 0, 0] == 0).all()
    for check in (chance.bias, chance.variance):
        assert check(stats, schedule.P_plus)
        verdict = check(experiment(50), schedule.P_plus)
        assert not verdict
        assert np.isfinite(verdict.value)


def test_bad_arguments_are_refused():
    """Theory of another shape and an unknown instant are one line."""
    stats = experiment(10)
    with pytest.raises(ValueError, match=r"P: expected shape \(26, 2, 2\)"):
        chance.bias(stats, np.eye(2))
    with pytest.raises(ValueError, match="when: expected 'plus' or 'minus'"):
        chance.variance(stats, np.zeros((26, 2, 2)), when="after")
    with pytest.raises(ValueError, match=r"expected: expected shape \(26, 2\)"):
        chance.bias(stats, np.zeros((26, 2, 2)), np.zeros(2))
