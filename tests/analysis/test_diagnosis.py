"""The verdict on a record: silent on right models as often as it says, and right about stated faults."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from ctlabs.analysis import diagnosis
from ctlabs.filtering import kalman_filter, log_likelihood
from ctlabs.filtering.engines import compiled
from ctlabs.models import DiscreteModel
from tests import nile
from tests.reference import EXACT, at
from tests.strategies import record

STEPS = 200


def level(q=1.0, r=2.0, **more):
    """A random walk in white noise."""
    return DiscreteModel(
        [[1]], [[q]], [[1]], [[r]], x0=[0], P0=[[10]], states=["level"], units=["m"], measurements=["gauge"], **more
    )


def tracked():
    """Position and speed, both measured, with correlated errors and a step of offset."""
    return DiscreteModel(
        [[1, 0.5], [0, 0.9]], [[0.1, 0.05], [0.05, 0.2]], np.eye(2), [[1, 0.3], [0.3, 0.5]], x0=[1, -1], P0=np.eye(2), dt=0.5,
        offset=[0.1, 0.0], states=["x", "v"], units=["m", "m/s"],
    )  # fmt: skip


def judged(model, truth, seed, steps=STEPS, gaps=0.0, first=1, level=0.01):
    z = record(truth, steps, np.random.default_rng(seed), gaps, first)
    return diagnosis.diagnose(model, z[first:], first=first, level=level)


def hum(seed, steps=STEPS):
    """The walk, measured with a noise that swings to and fro in eight steps."""
    rng = np.random.default_rng(seed)
    noise = np.zeros(steps + 1)
    for k in range(2, steps + 1):
        noise[k] = 1.2 * noise[k - 1] - 0.7 * noise[k - 2] + rng.normal()
    return (3 * rng.normal() + np.cumsum(rng.normal(size=steps + 1)) + noise)[1:, None]


class TestCalibration:
    @pytest.mark.parametrize(("truth", "gaps", "runs"), [(level(), 0.0, 80), (tracked(), 0.3, 40)])
    def test_a_right_model_is_suspected_no_more_often_than_the_level_says(self, truth, gaps, runs):
        """False alarms at 5 %, among records that are the model's: not more than binomially explicable."""
        alarms = sum(not judged(truth, truth, seed, 100, gaps, level=0.05).ok for seed in range(runs))
        assert alarms <= stats.binom.isf(1e-6, runs, 0.05)

    def test_the_single_p_values_are_uniform(self):
        """Kolmogorov's distance of the p-values of NIS, mean and independence over an ensemble, at 1e-6."""
        found = []
        for seed in range(400):
            z = record(level(), 60, np.random.default_rng(seed), 0.2)[1:]
            run = kalman_filter(level(), z)
            own = diagnosis.innovations(run.innovation, run.S, run.nis)
            found.append(list(diagnosis.p_values(level(), own).values()))
        for column in np.array(found).T:
            assert stats.kstest(column, "uniform").pvalue > 1e-6

    def test_the_test_of_whiteness_keeps_its_level_in_the_tail(self):
        """At 1 % with 60 innovations, where the sum of Ljung and Box raises twice as many alarms."""
        rng, runs = np.random.default_rng(1), 4000
        alarms = ljung_box = 0
        for _ in range(runs):
            found = diagnosis.whiteness(rng.normal(size=60))
            alarms += found.p < 0.01
            N, lag = 60, found.lags
            ljung_box += stats.chi2.sf(N * (N + 2) * (found.r**2 / (N - lag)).sum(), len(lag)) < 0.01
        assert stats.binom.ppf(1e-6, runs, 0.01) <= alarms <= stats.binom.isf(1e-6, runs, 0.01)
        assert ljung_box > 1.5 * alarms

    def test_an_unstable_model_with_correlated_noises_is_judged_too(self):
        """N between w and v, and a state that grows: nothing is wrong with it."""
        truth = DiscreteModel([[1.02]], [[1.0]], [[1]], [[2.0]], x0=[0], P0=[[1]], N=[[0.7]])
        assert sum(judged(truth, truth, seed, 100).ok for seed in range(12)) >= 10


class TestFaults:
    def test_a_measurement_noise_2_3_times_too_small_is_named_with_its_factor(self):
        """The verdict says R, and its factor is 2.3 within the accuracy of a record."""
        found = [judged(level(r=2.0), level(r=4.6), seed) for seed in range(12)]
        assert sum(d.verdict == "R" for d in found) >= 9
        assert all("R too small by about a factor" in d.suggestion for d in found if d.verdict == "R")
        assert np.exp(np.mean([np.log(d.factor_R) for d in found])) == pytest.approx(2.3, rel=0.15)
        assert judged(level(r=2.0), level(r=4.6), 2).suggestion == "R too small by about a factor 2.3"

    def test_a_process_noise_5_times_too_small_is_named_with_its_factor(self):
        """The verdict says Qd."""
        found = [judged(level(q=1.0), level(q=5.0), seed) for seed in range(12)]
        assert sum(d.verdict == "Qd" for d in found) >= 9
        assert np.exp(np.mean([np.log(d.factor_Q) for d in found])) == pytest.approx(5.0, rel=0.25)

    def test_variances_that_are_too_large_are_named_as_such(self):
        """Both by a factor 4: R and Qd too large."""
        found = judged(level(q=4.0, r=8.0), level(q=1.0, r=2.0), 1, 400)
        assert found.verdict == "R and Qd"
        assert found.factors == pytest.approx((0.25, 0.25), rel=0.5)
        assert found.suggestion.count("too large by about a factor") == 2
        assert found.nis_mean < found.nis_band[0]

    def test_a_missing_drift_is_named_with_its_size(self):
        """A level that rises by half a metre every step, filtered as one that does not."""
        found = [judged(level(), level(offset=[0.5]), seed) for seed in range(8)]
        assert sum(d.verdict == "input" for d in found) >= 6
        assert found[0].suggestion.startswith("a drift is missing: a constant of about 0.5")
        assert "m enters level every step" in found[0].suggestion
        assert found[0].mean[0] > 0
        assert found[0].mean_p[0] < 1e-3

    def test_a_biased_sensor_is_named(self):
        """One of two sensors reads 3 too much: the other one gives it away."""
        truth = tracked()
        z = record(truth, STEPS, np.random.default_rng(5))[1:] + np.array([0.0, 3.0])
        found = diagnosis.diagnose(truth, z)
        assert found.verdict == "bias"
        assert "z2 has a bias of about 3" in found.suggestion.replace("3.0", "3")

    def test_a_noise_with_memory_is_told_from_a_wrong_size(self):
        """R and Qd cannot explain it, whatever they are: something is missing in the model."""
        z = hum(3)
        model = level(r=0.2)
        found = diagnosis.diagnose(model, z)
        assert found.verdict == "correlated"
        assert "a state or a coloured noise is missing" in found.suggestion
        assert "also after the most likely change" in found.suggestion
        assert found.whiteness_p[0] < 1e-4

    def test_innovations_of_the_right_size_that_alternate_are_called_correlated(self):
        """A stationary state measured with an oscillating error: the size is right, the independence is not."""
        model = DiscreteModel([[0.0]], [[1.0]], [[1]], [[1.0]], x0=[0], P0=[[1]])
        rng = np.random.default_rng(0)
        e = np.zeros(401)
        for k in range(1, 401):
            e[k] = -0.5 * e[k - 1] + np.sqrt(2 * 0.75) * rng.normal()
        found = diagnosis.diagnose(model, e[1:, None])
        assert found.verdict == "correlated"
        assert (
            found.suggestion
            == "the innovations are correlated although their size is right: a state or a coloured noise is missing"
        )
        assert found.autocorrelation[0][0] == pytest.approx(-0.5, abs=0.15)

    def test_the_nile_is_a_local_level(self):
        """At Durbin & Koopman's variances nothing speaks against the model; with a tenth of R something does."""
        model = DiscreteModel([[1]], [[nile.Q]], [[1]], [[nile.R]], x0=[1000], P0=[[1e6]])
        z = nile.FLOW[:, None]
        found = diagnosis.diagnose(model, z, first=0)
        assert found.suggestion == "nothing speaks against the model"
        assert found.ok
        assert found.factor_R == pytest.approx(1.0, abs=0.05)
        wrong = replace(model, R=[[nile.R / 10]])
        assert not diagnosis.diagnose(wrong, z, first=0).ok

    def test_a_record_that_nothing_explains_is_called_so(self):
        """Six perfect measurements that are all x0 to the last digit, beside P0 = I: too good for chance, and no change explains it."""
        model = DiscreteModel(np.eye(6), np.zeros((6, 6)), np.eye(6), np.zeros((6, 6)), x0=np.zeros(6), P0=np.eye(6))
        found = diagnosis.diagnose(model, np.zeros((4, 6)), first=0)
        assert found.nis_mean == 0
        assert found.verdict == "other"
        assert found.suggestion.startswith("the record does not fit the model (NIS: p = ")
        assert diagnosis.diagnose(model, np.full((4, 6), 2.0), first=0).verdict == "start"


class TestNumbers:
    def test_the_nis_and_its_band_are_those_of_chi_squared(self):
        """From ν and S of another form: mean per instant, exact quantiles of χ² for all elements together, gaps left out."""
        model = tracked()
        z = record(model, 50, np.random.default_rng(2), 0.3)[1:]
        found = diagnosis.diagnose(model, kalman_filter(model, z, algorithm="ud"))
        run = kalman_filter(model, z)
        total = 0.0
        for nu, S in zip(run.innovation, run.S, strict=True):
            used = np.isfinite(nu)
            total += nu[used] @ np.linalg.solve(S[np.ix_(used, used)], nu[used])
        dof, instants = int(np.isfinite(z).sum()), int(np.isfinite(z).any(axis=1).sum())
        assert found.nis_mean == pytest.approx(total / instants, rel=1e-9)
        assert found.nis_expected == dof / instants
        assert found.nis_band == pytest.approx(tuple(stats.chi2.ppf([0.025, 0.975], dof) / instants), rel=1e-9)
        assert found.nis_p == pytest.approx(2 * min(stats.chi2.cdf(total, dof), stats.chi2.sf(total, dof)), rel=1e-9)

    @pytest.mark.parametrize("R", [[[2.0]], np.linspace(1, 3, 151)[:, None, None]], ids=["constant", "varying"])
    def test_of_a_long_record_so_many_rows_are_looked_at(self, R):
        """As if there were no others; and all, where it is no longer."""
        model = replace(level(), R=R)
        z = record(model, 150, np.random.default_rng(5), 0.1)[1:]
        whole, part = kalman_filter(model, z), kalman_filter(model.cut(80), z[:80])
        short = diagnosis.diagnose(model.cut(80), part)
        assert diagnosis.diagnose(model, whole, longest=80).tests == short.tests
        every = diagnosis.diagnose(model, whole)
        assert diagnosis.diagnose(model, whole, longest=500).tests == every.tests != short.tests

    def test_the_factors_maximise_the_likelihood(self):
        """5 % beside them the record is less likely."""
        model, z = level(), record(level(q=3.0, r=1.0), 80, np.random.default_rng(0))[1:]
        found = diagnosis.diagnose(model, z)

        def likelihood(a, b):
            return log_likelihood(level(b * 1.0, a * 2.0), z)

        a, b = found.factors
        assert likelihood(found.factor_R, 1) > max(likelihood(found.factor_R * s, 1) for s in (0.95, 1.05))
        assert likelihood(1, found.factor_Q) > max(likelihood(1, found.factor_Q * s) for s in (0.95, 1.05))
        assert likelihood(a, b) > max(likelihood(a * s, b * t) for s in (0.95, 1.05) for t in (0.95, 1.05))

    def test_a_constant_is_estimated_as_by_least_squares(self):
        """White measurements of a constant bias: its mean, gained N·mean²/r, with the probability of that."""
        model = DiscreteModel([[0]], [[0]], [[1]], [[4]], x0=[0], P0=[[0]])
        z = 1.5 + 2 * np.random.default_rng(1).normal(size=(51, 1))
        (bias,) = [c for c in diagnosis.constants(model, z, 1) if c.kind == "bias"]
        mean = z[1:].mean()
        assert bias.size[0] == pytest.approx(mean, rel=1e-9)
        assert bias.gain == pytest.approx(50 * mean**2 / 4, rel=1e-9)
        assert bias.p == pytest.approx(stats.chi2.sf(bias.gain, 1), rel=1e-6)

    def test_a_constant_that_no_measurement_shows_is_no_candidate(self):
        """Of two known states only one is measured: an input of the other one cannot be seen."""
        model = DiscreteModel(np.eye(2), np.zeros((2, 2)), [[1, 0]], [[1.0]], x0=[0, 0], P0=np.zeros((2, 2)))
        k = np.arange(31)
        z = (0.2 * k + np.random.default_rng(0).normal(size=31))[:, None]
        found = {(c.kind, c.place): c for c in diagnosis.constants(model, z, 1)}
        assert set(found) == {("input", 0), ("bias", 0)}
        slope = k[1:] @ z[1:, 0] / (k @ k)
        assert found["input", 0].size[0] == pytest.approx(slope, rel=1e-9)


class TestWhiteness:
    def test_partial_autocorrelations_are_the_last_coefficients_of_regressions(self):
        """Durbin and Levinson's recursion equals the Yule-Walker equations, order by order."""
        e = np.random.default_rng(4).normal(size=80)
        found = diagnosis.whiteness(e)
        full = np.array([1.0, *found.r])
        for order in range(1, 11):
            T = full[np.abs(np.subtract.outer(np.arange(order), np.arange(order)))]
            assert found.partial[order - 1] == pytest.approx(np.linalg.solve(T, found.r[:order])[-1], abs=EXACT * 10)

    def test_gaps_leave_the_test_as_it_is_without_them(self):
        """Independent innovations stay independent when some are left out."""
        e = np.random.default_rng(4).normal(size=80)
        gappy = np.full(200, np.nan)
        gappy[np.sort(np.random.default_rng(0).choice(200, 80, replace=False))] = e
        assert diagnosis.whiteness(gappy).p == diagnosis.whiteness(e).p

    def test_one_lag_for_five_innovations_ten_at_most(self):
        """And none where there are fewer than ten."""
        e = np.random.default_rng(0).normal(size=400)
        assert [len(diagnosis.whiteness(e[:n]).lags) for n in (9, 10, 34, 50, 400)] == [0, 2, 6, 10, 10]
        assert np.isnan(diagnosis.whiteness(e[:9]).p)
        assert len(diagnosis.whiteness(e, lags=25).lags) == 25

    def test_the_band_holds_95_percent_of_each_lag(self):
        """Of autocorrelations at lag 1 of white sequences, by count."""
        rng, runs = np.random.default_rng(0), 4000
        inside = 0
        for _ in range(runs):
            found = diagnosis.whiteness(rng.normal(size=40))
            inside += abs(found.r[0]) < found.band[0]
        assert stats.binom.ppf(1e-6, runs, 0.95) <= inside <= stats.binom.isf(1e-6, runs, 0.95)


class TestWhatIsAbsent:
    def test_perfect_measurements_leave_nothing_to_scale_in_R(self):
        """R = 0: only the factor on Qd is found."""
        truth = DiscreteModel([[0.9]], [[3.0]], [[1]], [[0]], x0=[0], P0=[[1]])
        found = judged(replace(truth, Qd=[[1.0]]), truth, 0, 40)
        assert found.factor_R is None
        assert found.factors is None
        assert found.verdict == "Qd"
        assert found.factor_Q == pytest.approx(3.0, rel=0.5)

    def test_a_model_without_disturbances_leaves_nothing_to_scale_in_Qd(self):
        """Qd = 0: only the factor on R is found, and elements with R = ∞ stay absent."""
        truth = DiscreteModel([[0.9]], [[0.0]], [[1], [1]], np.diag([4.0, np.inf]), x0=[0], P0=[[1]])
        found = judged(replace(truth, R=np.diag([1.0, np.inf])), truth, 0, 100)
        assert found.factor_Q is None
        assert found.verdict == "R"
        assert found.factor_R == pytest.approx(4.0, rel=0.5)
        assert np.isnan(found.mean_p[1])
        assert np.isnan(found.whiteness_p[1])
        assert np.isnan(found.autocorrelation[1]).all()
        assert "mean of z2" not in found.tests

    def test_without_either_the_other_tests_remain(self):
        """Qd = 0 and R = 0: one draw of x0 is all there is."""
        model = DiscreteModel([[1]], [[0]], [[1]], [[0]], x0=[0], P0=[[1]])
        z = np.full((3, 1), 0.3)
        found = diagnosis.diagnose(model, z)
        assert found.factor_R is None is found.factor_Q
        assert found.ok
        assert "so few innovations, 1, could hardly" in found.suggestion

    def test_one_run_with_an_axis_for_runs_is_a_record(self):
        """Innovations (steps+1, m, 1) are taken as (steps+1, m)."""
        model = level()
        z = record(model, 30, np.random.default_rng(0))[1:]
        wide = kalman_filter(model, z[:, :, None], algorithm="joseph")
        flat = kalman_filter(model, z)
        assert diagnosis.diagnose(model, wide).tests == pytest.approx(
            diagnosis.diagnose(model, flat).tests, rel=1e-6
        )

    def test_matrices_that_vary_are_scaled_as_they_are(self):
        """R of every instant by one factor."""
        R = np.linspace(1, 3, STEPS + 1)[:, None, None]
        truth = DiscreteModel([[0.9]], [[1.0]], [[1]], 6 * R, x0=[0], P0=[[1]])
        found = judged(replace(truth, R=R), truth, 0)
        assert found.verdict == "R"
        assert found.factor_R == pytest.approx(6.0, rel=0.4)
        assert at(truth.R, 0).shape == (1, 1)


class TestRefusals:
    def test_several_runs_and_other_shapes_are_refused(self):
        """A diagnosis is of one record."""
        model = level()
        z = record(model, 30, np.random.default_rng(0))[1:]
        both = np.stack([z, z], axis=2)
        with pytest.raises(
            ValueError, match=r"z: expected one record of a linear model, \(rows, m\), received DiscreteModel and shape \(31, 1, 2\)"
        ):
            diagnosis.diagnose(model, both)
        with pytest.raises(ValueError, match=r"filtered: expected a record of a model with n, m = \(1, 1\), received one with \(2, 2\)"):
            diagnosis.diagnose(model, kalman_filter(tracked(), np.ones((5, 2))))

    def test_a_record_without_measurements_is_refused(self):
        """Nothing was measured."""
        z = np.full((5, 1), np.nan)
        with pytest.raises(ValueError, match="expected at least one measurement that enters the filter, received none"):
            diagnosis.diagnose(level(), z)

    @pytest.mark.parametrize("probability", [0.0, 1.0, -1])
    def test_a_level_is_a_probability(self, probability):
        """Strictly between 0 and 1."""
        z = record(level(), 30, np.random.default_rng(0))[1:]
        with pytest.raises(ValueError, match="level: expected a probability between 0 and 1"):
            diagnosis.diagnose(level(), z, level=probability)


@pytest.mark.parametrize(("a", "b"), [(1.0, 1.0), (5.0, 1.0), (9.0, 9.0)])
def test_a_verdict_takes_few_likelihoods(a, b, monkeypatch):
    """It filters the record some dozens of times, so that long records can be judged."""
    model, calls = tracked(), []
    z = record(diagnosis.scaled(model, a, b), 400, np.random.default_rng(0))[1:]
    own = compiled.log_likelihood
    monkeypatch.setattr(compiled, "log_likelihood", lambda *given: calls.append(0) or own(*given))
    found = diagnosis.diagnose(model, z)
    assert found.factors == pytest.approx((a, b), rel=0.5)
    assert 5 < len(calls) < 100


def shifted(seed=3, steps=STEPS, **changes):
    """A record of the level, (rows, 1), with values at some rows replaced or added to."""
    z = record(level(), steps, np.random.default_rng(seed))[1:]
    for row, value in changes.get("values", {}).items():
        z[row] = value
    if "jump" in changes:
        z[changes["jump"] :] += 30
    return z


class TestRows:
    def test_an_outlier_is_named_and_is_not_a_wrong_R(self):
        """Its row, its value and what the others suggest; without it nothing speaks against the model."""
        found = diagnosis.diagnose(level(), shifted(values={100: 58.77}), where=lambda row: f"line {row + 2}")
        assert found.verdict == "outlier"
        assert found.suggestion.startswith("gauge = 58.77 in line 102 is an outlier, ")
        assert "R too small" not in found.suggestion
        (event,) = found.events
        assert (event.kind, event.rows, event.value) == ("outlier", (100,), 58.77)
        assert diagnosis.diagnose(level(), shifted(values={100: np.nan})).ok

    def test_the_size_of_an_outlier_is_its_distance_from_the_record_without_it(self):
        """Mean and variance of the element given all others, by conditioning; two other outliers do not touch it."""
        z = shifted(values={20: 50.0, 60: -70.0, 61: 80.0})
        found = {event.rows[0]: event for event in diagnosis.diagnose(level(), z).events}
        assert set(found) == {20, 60, 61}
        T = len(z)
        cov = 10 + np.minimum.outer(np.arange(1, T + 1), np.arange(1, T + 1)) + 2.0 * np.eye(T)
        rest = np.setdiff1d(np.arange(T), [20, 60, 61])
        for row, event in found.items():
            weights = np.linalg.solve(cov[np.ix_(rest, rest)], cov[rest, row])
            size = z[row, 0] - weights @ z[rest, 0]
            assert event.size == pytest.approx(size, rel=1e-9)
            assert event.sigmas == pytest.approx(abs(size) / np.sqrt(cov[row, row] - cov[rest, row] @ weights), rel=1e-9)

    def test_a_jump_of_the_level_is_named_and_is_not_a_wrong_Qd(self):
        """Of 30, before the row from which on it is there."""
        found = diagnosis.diagnose(level(), shifted(jump=120))
        assert found.verdict == "break"
        assert found.events[0].rows == (120,)
        assert found.events[0].size == pytest.approx(30, abs=5)
        assert "Qd" not in found.suggestion

    def test_a_slope_that_changes_is_named(self):
        """Of position and speed, measured in position only: the speed jumps."""
        model = DiscreteModel([[1, 1], [0, 1]], np.diag([1e-3, 1e-4]), [[1, 0]], [[1.0]], P0=np.eye(2), states=["x", "v"])
        z = record(model, 100, np.random.default_rng(1))[1:]
        z[60:, 0] += 2.0 * np.arange(1, 41)
        found = diagnosis.diagnose(model, z)
        assert found.verdict == "break"
        assert (found.events[0].place, found.events[0].rows[0]) in {(1, 59), (1, 60), (1, 61)}
        assert "v jumps by about" in found.suggestion

    def test_equal_outlying_values_look_like_missing_ones(self):
        """Four cells -9999 of 60, told with the option; beside them nothing is wrong."""
        z = shifted(steps=60, values=dict.fromkeys((10, 30, 31, 47), -9999.0))
        found = diagnosis.diagnose(level(), z)
        assert found.verdict == "outlier"
        assert "gauge is -9999 in 4 rows (row 10, row 30, row 31, row 47)" in found.suggestion
        assert found.suggestion.endswith("(--missing -9999)")
        many = shifted(steps=60, values=dict.fromkeys(range(5, 60, 3), -9999.0))
        assert diagnosis.diagnose(level(), many).verdict == "outlier"

    def test_a_stuck_sensor_is_named(self):
        """Ten equal values of a record with four decimals; three of one with none are chance."""
        z = shifted().round(4)
        z[50:60] = z[50]
        found = diagnosis.diagnose(level(), z)
        assert found.verdict == "stuck"
        assert "from row 50 to row 59: 10 equal values" in found.suggestion
        z = shifted().round(0)
        z[50:53] = z[50]
        assert diagnosis.diagnose(level(), z).verdict != "stuck"

    def test_an_initial_estimate_far_from_the_truth_is_named(self):
        """x0 = 0 ± 0.1 beside a record that begins at 100: neither a bias nor Qd; the advice is to widen P0, which helps."""
        model = DiscreteModel([[1, 1], [0, 1]], np.diag([0.01, 0.01]), [[1, 0]], [[4.0]], P0=np.diag([0.01, 0.01]), states=["x", "v"])
        z = record(replace(model, x0=[100, 5]), 80, np.random.default_rng(0))[1:]
        found = diagnosis.diagnose(model, z)
        assert found.verdict == "start"
        assert "widen P0 (inf where nothing is known at the start)" in found.suggestion
        assert "bias" not in found.suggestion
        assert diagnosis.diagnose(replace(model, P0=np.diag([np.inf, np.inf])), z).ok

    def test_a_wrong_q_is_no_drift(self):
        """A level that wanders ten times more than Qd says: of 12 records none is told to lack a drift."""
        found = [judged(level(q=0.01), level(q=1.0), seed, 80) for seed in range(12)]
        assert sum("Qd too small" in d.suggestion for d in found) >= 10
        assert not any("drift" in d.suggestion for d in found)

    def test_a_state_that_wanders_although_Qd_is_zero_has_no_bias(self):
        """P0 = 0 and Qd = 0 beside a random walk: Qd is what is missing."""
        found = diagnosis.diagnose(replace(level(), Qd=[[0.0]], P0=[[0.0]]), shifted())
        assert found.verdict == "Qd"
        assert "level wanders, though Qd says that it does not" in found.suggestion

    def test_a_wrong_R_is_told_beside_an_outlier(self):
        """Both: the row first, then the factor."""
        z = record(level(r=18.0), STEPS, np.random.default_rng(4))[1:]
        z[77] = 200.0
        found = diagnosis.diagnose(level(), z)
        assert found.suggestion.startswith("gauge = 200 in row 77 is an outlier")
        assert "R too small by about a factor" in found.suggestion.partition(";")[2]

    def test_a_wrong_R_makes_no_outliers(self):
        """R 25 times too small: no row is an exception."""
        found = judged(level(), level(r=50.0), 5)
        assert found.verdict in ("R", "R and Qd")
        assert found.events == ()

    def test_single_rows_keep_their_level(self):
        """The greatest of all τ, the initial estimate and runs of equal values in records rounded to one digit: at 5 %."""
        model, runs = level(), 300
        alarms = {"single rows": 0, "initial estimate": 0, "equal values": 0}
        for seed in range(runs):
            z = record(model, 40, np.random.default_rng(seed), 0.1)[1:].round(1)
            tests = diagnosis.tests_of(model, kalman_filter(model, z), first=1)
            for name in alarms:
                alarms[name] += tests.get(name, 1.0) < 0.05
        assert all(count <= stats.binom.isf(1e-6, runs, 0.05) for count in alarms.values()), alarms
        assert alarms["single rows"] >= stats.binom.ppf(1e-6, runs, 0.02)

    def test_a_contradiction_is_told_with_its_value(self):
        """Row, value, and what was known."""
        model = DiscreteModel([[0.5]], [[0]], [[1]], [[0]], x0=[1], P0=[[1]])
        found = diagnosis.diagnose(model, kalman_filter(model, [0.5, 0.8]))
        assert found.verdict == "contradiction"
        assert found.suggestion == "z1 = 0.8 in row 1 contradicts what is known exactly, 0.25: the record is impossible for this model"


def moved(d):
    """A random walk measured with what is known of its measurements, d (steps+1, 1): two of −9999, an outlier and a stuck sensor."""
    rng = np.random.default_rng(4)
    z = np.round(np.cumsum(rng.normal(size=120)) + rng.normal(size=120), 2)[:, None] + d[1:]
    z[[20, 90]] = -9999.0
    z[50] = 160.0
    z[100:112] = z[99]
    return DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[10]], measurement_offset=d), z


class TestWhatIsKnown:
    """Of a record with known inputs or an offset in its measurements everything that is said is in its own values."""

    @pytest.mark.parametrize("d", [np.full((121, 1), 100.0), 30 * np.sin(np.arange(121.0))[:, None]], ids=["constant", "varying"])
    def test_values_are_those_of_the_record(self, d):
        """Values of outliers and runs are the record's, also where no two of them are equal once the known part is off."""
        model, z = moved(d)
        found = diagnosis.diagnose(model, z)
        told = {(event.kind, event.rows): event.value for event in found.events}
        assert told[("outlier", (20, 90))] == -9999.0
        outliers = {event.rows: event.value for event in diagnosis.diagnose(model, np.where(z == -9999, np.nan, z)[:95]).events}
        assert outliers[(50,)] == 160.0
        run = diagnosis.diagnose(model, np.where((z == -9999) | (z == 160), np.nan, z)).events
        assert [(event.kind, event.rows, event.value) for event in run] == [("stuck", tuple(range(99, 112)), z[99, 0])]
        assert "--missing -9999" in found.suggestion

    def test_an_input_is_known_as_an_offset_is(self):
        """Du given to the filter, and the same numbers as an offset: one verdict."""
        d = 30 * np.sin(np.arange(121.0))[:, None]
        model, z = moved(d)
        driven = replace(model, measurement_offset=None, D=[[1]])
        found = diagnosis.diagnose(driven, kalman_filter(driven, z, u=d[1:]))
        assert found.suggestion == diagnosis.diagnose(model, z).suggestion

    def test_the_rest_of_a_biased_record_is_told_in_its_own_values(self):
        """A bias is a change of the model, so that a row that is told after it keeps its value."""
        rng = np.random.default_rng(4)
        z = rng.normal(size=(200, 1)) + 3.0
        model = DiscreteModel([[0.5]], [[1]], [[1]], [[0.25]], P0=[[1]])
        (bias,) = [c for c in diagnosis.constants(model, z, 1) if c.kind == "bias"]
        assert np.array_equal(bias.z, z)
        assert bias.model.measurement_offset == pytest.approx(bias.size)
        assert log_likelihood(bias.model, z) == pytest.approx(log_likelihood(model, z - bias.size))

    def test_a_contradiction_is_told_in_the_values_of_the_record(self):
        """Both the value and the one that was possible."""
        model = DiscreteModel([[0.5]], [[0]], [[1]], [[0]], x0=[1], P0=[[1]], measurement_offset=[7])
        assert diagnosis.diagnose(model, [7.5, 7.5]).suggestion.startswith("z1 = 7.5 in row 1 contradicts what is known exactly, 7.25")
