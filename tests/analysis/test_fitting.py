"""Maximum likelihood of a model's constants, against closed forms, the joint density, and another library."""

import functools

import numpy as np
import pytest
from scipy import optimize, stats

from ctlabs.analysis import fitting
from ctlabs.filtering import log_likelihood
from ctlabs.models import DiscreteModel
from tests import nile, reference
from tests.reference import EXACT, SOLVER, close
from tests.strategies import record

POSITIVE = {"q": (0, None), "r": (0, None)}


def level(c, P0=1e7):
    """A random walk in white noise."""
    return DiscreteModel([[1]], [[c["q"]]], [[1]], [[c["r"]]], x0=[0], P0=[[P0]])


def scatter(c):
    """Independent errors of variance r about a constant mu."""
    return DiscreteModel([[1]], [[0]], [[1]], [[c["r"]]], x0=[c.get("mu", 0.0)], P0=[[0]])


def walk(steps, q, r, seed):
    """A record of the local level that starts at 0."""
    rng = np.random.default_rng(seed)
    return (np.cumsum(rng.normal(size=steps + 1) * np.sqrt(q)) + rng.normal(size=steps + 1) * np.sqrt(r))[:, None]


@functools.cache
def flow():
    """The Nile, as Durbin & Koopman fit it."""
    return fitting.fit(level, nile.FLOW[:, None], {"q": 1000.0, "r": 10000.0}, POSITIVE, first=0)


class TestNile:
    def test_the_estimates_are_those_of_durbin_and_koopman(self):
        """q = 1469.1, r = 15099 for a start about which nothing is known, and with P0 = 1e7 to a part in a thousand."""

        def vague(c):
            return level(c, P0=1e10)

        found = fitting.fit(vague, nile.FLOW[:, None], {"q": 1.0, "r": 1.0}, POSITIVE, first=0, profiles=False)
        assert found.estimates["q"] == pytest.approx(nile.Q, abs=0.1)
        assert found.estimates["r"] == pytest.approx(nile.R, abs=1.0)
        assert found.converged
        assert flow().estimates["q"] == pytest.approx(nile.Q, rel=1e-3)
        assert flow().estimates["r"] == pytest.approx(nile.R, rel=1e-3)

    def test_the_log_likelihood_is_the_joint_density_of_the_record(self):
        """At the estimates it is the Gaussian density of 100 flows, computed without a filter."""
        assert flow().log_likelihood == pytest.approx(
            reference.log_likelihood(flow().model, nile.FLOW[:, None], 0), rel=1e-9
        )
        assert flow().observations == 100

    def test_the_gradient_of_the_joint_density_is_zero_there_and_only_there(self):
        """In units of the standard errors; 5 % away from the estimates it is not."""

        def slope(name, factor):
            at = dict(flow().estimates)
            at[name] *= factor
            h = 1e-4 * flow().standard_errors[name]
            values = [
                reference.log_likelihood(level({**at, name: at[name] + s * h}), nile.FLOW[:, None], 0) for s in (1, -1)
            ]
            return (values[0] - values[1]) / 2e-4

        for name in ("q", "r"):
            assert abs(slope(name, 1.0)) < 1e-5
            assert abs(slope(name, 1.05)) > 1e-2
        assert np.abs(flow().gradient * [flow().standard_errors[n] for n in flow().names]).max() < SOLVER

    def test_it_is_the_maximum_of_statsmodels(self):
        """Another library's likelihood and optimiser, with the same start."""
        sm = pytest.importorskip("statsmodels.api", reason="statsmodels is a second route only")
        theirs = sm.tsa.UnobservedComponents(nile.FLOW, "llevel")
        theirs.ssm.initialize_known(np.zeros(1), np.array([[1e7]]))
        theirs.ssm.loglikelihood_burn = 0
        found = theirs.fit(disp=0, method="lbfgs", pgtol=1e-12, factr=1.0, maxiter=500)
        assert found.llf == pytest.approx(flow().log_likelihood, rel=1e-12)
        assert found.params == pytest.approx([flow().estimates["r"], flow().estimates["q"]], rel=1e-6)

    def test_the_result_does_not_depend_on_the_start(self):
        """From six decades away, or without bounds, the same constants to a millionth."""
        for start, bounds in (
            ({"q": 1e-3, "r": 1.0}, POSITIVE),
            ({"q": 1e9, "r": 1e9}, POSITIVE),
            ({"q": 900.0, "r": 2e4}, None),
        ):
            found = fitting.fit(level, nile.FLOW[:, None], start, bounds, first=0, profiles=False)
            assert list(found.estimates.values()) == pytest.approx(list(flow().estimates.values()), rel=1e-6)
            assert list(found.standard_errors.values()) == pytest.approx(
                list(flow().standard_errors.values()), rel=1e-6
            )

    @pytest.mark.parametrize("unit", [1e-4, 1e5])
    def test_units_of_the_data_do_not_matter(self, unit):
        """In other units the variances scale by the square and the log-likelihood moves by −N ln(unit)."""

        def rescaled(c):
            return level(c, P0=1e7 * unit**2)

        start = {"q": 1000.0 * unit**2, "r": 10000.0 * unit**2}
        found = fitting.fit(rescaled, unit * nile.FLOW[:, None], start, POSITIVE, first=0, profiles=False)
        for name in ("q", "r"):
            assert found.estimates[name] / unit**2 == pytest.approx(flow().estimates[name], rel=1e-7)
            assert found.standard_errors[name] / unit**2 == pytest.approx(flow().standard_errors[name], rel=1e-6)
        assert found.log_likelihood == pytest.approx(flow().log_likelihood - 100 * np.log(unit), rel=1e-12)

    def test_missing_flows_widen_the_intervals(self):
        """With every fourth decade missing the estimates stay within their errors, which grow."""
        z = np.array(nile.FLOW[:, None])
        z[20:40] = z[60:80] = np.nan
        found = fitting.fit(level, z, {"q": 1000.0, "r": 10000.0}, POSITIVE, first=0, profiles=False)
        assert found.observations == 60
        assert found.log_likelihood == pytest.approx(reference.log_likelihood(found.model, z, 0), rel=1e-9)
        assert found.standard_errors["r"] > flow().standard_errors["r"]


class TestProfiles:
    def test_a_profile_has_the_other_constant_at_its_best(self):
        """At every point it is the maximum over r that another optimiser finds on the same density."""
        values, likelihood = flow().profiles["q"]
        for i in (1, 4, 8):

            def loss(log_r, q=values[i]):
                return -log_likelihood(level({"q": q, "r": np.exp(log_r)}), nile.FLOW[:, None], 0)

            best = optimize.minimize_scalar(loss, bounds=(7, 12), method="bounded", options={"xatol": 1e-9})
            assert likelihood[i] == pytest.approx(-best.fun, abs=1e-6)
            fixed = log_likelihood(level({"q": values[i], "r": flow().estimates["r"]}), nile.FLOW[:, None], 0)
            assert likelihood[i] > fixed + 1e-4

    def test_the_interval_ends_where_the_profile_has_fallen_by_half_the_quantile(self):
        """1.9207 below the top, at both ends of both intervals."""
        for name in ("q", "r"):
            values, likelihood = flow().profiles[name]
            for end in flow().intervals[name]:
                other = "r" if name == "q" else "q"

                def loss(log_other, end=end, name=name, other=other):
                    return -log_likelihood(level({name: end, other: np.exp(log_other)}), nile.FLOW[:, None], 0)

                best = optimize.minimize_scalar(loss, bounds=(0, 15), method="bounded", options={"xatol": 1e-9})
                drop = flow().log_likelihood + best.fun
                assert drop == pytest.approx(0.5 * stats.chi2.ppf(0.95, 1), abs=1e-5)
                assert values[0] <= end <= values[-1]
            assert likelihood.max() == pytest.approx(flow().log_likelihood, abs=1e-9)

    def test_the_interval_is_not_the_symmetric_one(self):
        """That of q reaches four times as far up as down; 1.96 standard errors would include negative variances."""
        low, high = flow().intervals["q"]
        estimate = flow().estimates["q"]
        assert (high - estimate) > 3 * (estimate - low)
        assert estimate - 1.96 * flow().standard_errors["q"] < 0 < low


class TestAccuracy:
    def test_mean_and_variance_have_their_classical_errors(self):
        """The mean's is √(r/N), the variance's r√(2/N), and they are uncorrelated."""
        z = 4.0 + 3.0 * np.random.default_rng(8).normal(size=(51, 1))[1:]
        found = fitting.fit(scatter, z, {"mu": 1.0, "r": 2.0}, {"r": (0, None)}, profiles=False)
        N, sample = 50, z[:, 0]
        r = sample.var()
        assert found.estimates == {"mu": pytest.approx(sample.mean(), rel=1e-7), "r": pytest.approx(r, rel=1e-7)}
        assert close(found.covariance, np.diag([r / N, 2 * r**2 / N]), 1e-7)
        assert not close(reference.broken(found.covariance), np.diag([r / N, 2 * r**2 / N]), 1e-3)
        assert found.standard_errors["r"] == pytest.approx(r * np.sqrt(2 / N), rel=1e-7)
        assert found.aic == 4 - 2 * found.log_likelihood

    def test_the_profile_interval_of_a_variance_is_that_of_the_exact_likelihood(self):
        """Its ends solve ln(s²/r) − s²/r + 1 = −χ²/N, whatever s²."""
        z = 3.0 * np.random.default_rng(5).normal(size=(31, 1))[1:]
        found = fitting.fit(scatter, z, {"r": 1.0}, {"r": (0, None)})
        s2 = float((z**2).mean())
        for end in found.intervals["r"]:
            assert np.log(s2 / end) - s2 / end + 1 == pytest.approx(-stats.chi2.ppf(0.95, 1) / 30, rel=1e-5)

    def test_an_autoregression_measured_perfectly_is_a_linear_regression(self):
        """The coefficient is Σz_k z_{k−1}/Σz²_{k−1} with the regression's error, also where it is negative."""
        rng = np.random.default_rng(3)
        z = np.zeros(25)
        for k in range(1, len(z)):
            z[k] = -0.6 * z[k - 1] + 2.0 * rng.normal()
        z = z[:, None]

        def build(c):
            return DiscreteModel([[c["a"]]], [[c["q"]]], [[1]], [[0]], x0=[0], P0=[[0]])

        found = fitting.fit(build, z[1:], {"a": 0.5, "q": 1.0}, {"a": (-1, 1), "q": (0, None)}, profiles=False, starts=0)
        before, after = z[:-1, 0], z[1:, 0]
        a = before @ after / (before @ before)
        q = ((after - a * before) ** 2).mean()
        assert found.estimates == {"a": pytest.approx(a, rel=1e-7), "q": pytest.approx(q, rel=1e-7)}
        assert found.standard_errors["a"] == pytest.approx(np.sqrt(q / (before @ before)), rel=1e-6)

    def test_errors_and_likelihood_ratios_have_their_distributions(self):
        """100 records: the truth lies within 1.96 standard errors, and below the 95 % quantile of χ²(2), in 95 % of them."""
        truth, within, halved, below, runs = {"q": 1.0, "r": 2.0}, 0, 0, 0, 100
        model = level(truth, P0=1.0)
        for seed in range(runs):
            z = record(model, 200, np.random.default_rng(seed))[1:]
            found = fitting.fit(lambda c: level(c, P0=1.0), z, truth, POSITIVE, profiles=False, starts=0)
            deviation = abs(found.estimates["r"] - 2.0) / found.standard_errors["r"]
            within, halved = within + (deviation < 1.96), halved + (deviation < 0.98)
            below += 2 * (found.log_likelihood - found.start_log_likelihood) < stats.chi2.ppf(0.95, 2)
        # A second-order error of 2 % at N = 200 is allowed on either side; with it, one false alarm in a million.
        low, high = stats.binom.ppf(1e-6, runs, 0.93), stats.binom.isf(1e-6, runs, 0.97)
        assert low <= within <= high
        assert low <= below <= high
        assert halved < low  # standard errors half as large would have been noticed


class TestBounds:
    def test_a_variance_that_the_record_does_not_need_ends_on_zero_and_says_so(self):
        """White noise about a constant: q = 0 exactly, no standard error, and r is as without q."""
        z = 5.0 + np.random.default_rng(3).normal(size=(80, 1))
        found = fitting.fit(level, z, {"q": 1.0, "r": 3.0}, POSITIVE, first=0)
        alone = fitting.fit(lambda c: level({**c, "q": 0.0}), z, {"r": 3.0}, {"r": (0, None)}, first=0, profiles=False)
        assert found.estimates["q"] == 0.0
        assert found.standard_errors["q"] is None
        assert found.reasons["q"] == "the likelihood is greatest on the bound q = 0, where there is no standard error"
        assert np.isnan(found.covariance[0]).all()
        assert found.converged
        assert found.gradient[0] < 0
        assert found.estimates["r"] == pytest.approx(alone.estimates["r"], rel=1e-7)
        assert found.standard_errors["r"] == pytest.approx(alone.standard_errors["r"], rel=1e-6)
        assert found.intervals["q"][0] == 0.0 < found.intervals["q"][1]

    def test_a_constant_is_held_within_its_bounds(self):
        """The Nile with r at most 10000: r there, and q the best beside it."""
        found = fitting.fit(level, nile.FLOW[:, None], {"q": 1.0, "r": 5e3}, {"q": (0, None), "r": (1, 1e4)}, first=0)
        assert found.estimates["r"] == 1e4
        assert "r = 10000" in found.reasons["r"]
        assert found.log_likelihood == pytest.approx(
            np.interp(1e4, *flow().profiles["r"]), abs=0.1
        )  # a point of the free fit's profile
        assert found.standard_errors["q"] > 0

    def test_perfect_measurements_that_contradict_the_model_are_not_likely(self):
        """A constant measured several times: r = 0 would leave the filter one measurement and drop the others."""
        z = np.array([1.0, 1.4, 0.7, 1.1])[:, None]
        found = fitting.fit(lambda c: level({**c, "q": 0.0}), z, {"r": 1.0}, {"r": (0, None)})
        assert found.estimates["r"] > 0.05
        assert found.observations == 4

    def test_an_estimate_beside_its_bound_says_so(self):
        """The maximum lies inside, but nearer to the bound than its error can be told."""
        z = 3.0 * np.random.default_rng(5).normal(size=(31, 1))[1:]
        best = float((z**2).mean())
        found = fitting.fit(scatter, z, {"r": 2 * best}, {"r": (best * (1 - 1e-4), None)}, profiles=False)
        assert found.estimates["r"] == pytest.approx(best, rel=1e-6)
        assert found.standard_errors["r"] is None
        assert "too near to the bound" in found.reasons["r"]

    def test_an_edge_that_is_no_bound_is_no_maximum(self):
        """Variances below 20 make no model, and nobody said so: the search ends there without a claim."""
        z = 3.0 * np.random.default_rng(5).normal(size=(31, 1))[1:]

        def build(c):
            if c["r"] < 20.0:
                msg = "r: expected at least 20"
                raise ValueError(msg)
            return scatter(c)

        found = fitting.fit(build, z, {"r": 50.0}, {"r": (0, None)}, profiles=False)
        assert found.estimates["r"] == pytest.approx(20.0, rel=1e-3)
        assert not found.converged
        assert found.standard_errors["r"] is None
        assert found.reasons["r"] == "the likelihood has no second derivative at the estimate"


class TestWhatTheRecordDoesNotTell:
    def test_constants_that_enter_as_a_sum_have_no_errors_of_their_own(self):
        """Only q1 + q2 is determined; its profile is flat, its interval has no lower end but the bound."""

        def build(c):
            return level({"q": c["q1"] + c["q2"], "r": c["r"]})

        bounds = {"q1": (0, None), "q2": (0, None), "r": (0, None)}
        found = fitting.fit(build, nile.FLOW[:, None], {"q1": 500.0, "q2": 500.0, "r": 1e4}, bounds, first=0)
        assert found.log_likelihood == pytest.approx(flow().log_likelihood, abs=1e-8)
        if found.estimates["q1"] > 0 and found.estimates["q2"] > 0:
            assert found.standard_errors["q1"] is None
            assert "does not determine it (the likelihood does not fall along q1, q2)" in found.reasons["q1"]
            assert found.standard_errors["r"] == pytest.approx(flow().standard_errors["r"], rel=1e-4)
        assert found.intervals["q1"][0] == 0.0
        assert found.intervals["q1"][1] == pytest.approx(flow().intervals["q"][1], rel=1e-3)

    def test_a_constant_without_effect_has_an_infinite_interval(self):
        """The record says nothing of it: no error, no end."""
        found = fitting.fit(
            lambda c: level({"q": 1000.0, "r": c["r"]}), nile.FLOW[:, None], {"r": 1e4, "s": 3.0}, first=0
        )
        assert found.standard_errors["s"] is None
        assert found.intervals["s"] == (-np.inf, np.inf)
        assert found.standard_errors["r"] > 0

    def test_a_frequency_is_found_from_a_wrong_start(self):
        """The likelihood of a frequency has many peaks: the search from several starts takes the highest."""
        w, k = 0.8, np.arange(81)
        z = (np.sin(w * k) + 0.3 * np.random.default_rng(1).normal(size=81))[1:, None]

        def build(c):
            cos, sin = np.cos(c["w"]), np.sin(c["w"])
            return DiscreteModel(
                [[cos, sin], [-sin, cos]], np.zeros((2, 2)), [[1, 0]], [[0.09]], x0=[0, 0], P0=np.eye(2)
            )

        found = fitting.fit(build, z, {"w": 2.0}, {"w": (0.01, 3.0)}, profiles=False, starts=8)
        assert found.estimates["w"] == pytest.approx(w, abs=0.01)

    def test_a_higher_maximum_met_on_a_profile_is_climbed(self):
        """From the lower of two peaks, 0.1 below the other one, its own interval leads across the valley."""
        z = np.random.default_rng(5).normal(size=(31, 1))[1:]
        best = float((z**2).mean())

        def build(c):
            a = c["a"]
            return scatter({"r": best * np.exp(0.05 * a**2 * (a - 3) ** 2 + 0.1 * (1 - a / 3))})

        stuck = fitting.fit(build, z, {"a": -0.2}, profiles=False, starts=0)
        found = fitting.fit(build, z, {"a": -0.2}, starts=0)
        assert stuck.estimates["a"] < 1
        assert found.estimates["a"] > 2
        assert found.log_likelihood > stuck.log_likelihood + 0.01
        assert found.intervals["a"][0] < stuck.estimates["a"] < found.intervals["a"][1]
        assert found.converged


class TestRefusals:
    @pytest.mark.parametrize(
        ("start", "bounds", "message"),
        [
            ({}, None, "start: expected at least one constant, received none"),
            ({"q": 1.0, "r": 1.0}, {"s": (0, 1)}, r"bounds: expected names among \['q', 'r'\], received 's'"),
            ({"q": -1.0, "r": 1.0}, POSITIVE, r"bounds of q: expected lower < upper around the start, received \(0, inf\) and -1"),
            ({"q": 1.0, "r": 1.0}, {"q": (1, 1)}, r"bounds of q: expected lower < upper around the start"),
            ({"q": -1.0, "r": 1.0}, None, r"start: expected constants at which .*, received q = -1, r = 1: Qd: expected"),
            ({"q": 1.0}, None, "received q = 1: no value for 'r'"),
            ({"q": np.nan, "r": 1.0}, None, "start: expected finite numbers"),
        ],
    )  # fmt: skip
    def test_what_cannot_be_searched_is_refused_in_one_line(self, start, bounds, message):
        """Before anything is computed, with what was expected and received."""
        with pytest.raises(ValueError, match=message) as caught:
            fitting.fit(level, nile.FLOW[:, None], start, bounds)
        assert "\n" not in str(caught.value)

    def test_data_that_do_not_fit_are_refused_with_the_reason(self):
        """They are what is named, not the start."""
        with pytest.raises(ValueError, match=r"^z: expected shape \(rows, 1\) or \(rows,\), .*, received \(50, 2\)"):
            fitting.fit(level, np.zeros((50, 2)), {"q": 1.0, "r": 1.0})

    def test_a_density_that_is_infinite_at_the_start_is_refused(self):
        """A model that overflows has no likelihood."""

        def build(c):
            return DiscreteModel([[c["a"]]], [[1]], [[1]], [[1]], x0=[0], P0=[[1]])

        with pytest.raises(ValueError, match="received a = 1e\\+200"):
            fitting.fit(build, np.ones((40, 1)), {"a": 1e200})

    def test_an_invalid_region_met_on_the_way_is_avoided(self):
        """Without bounds the search steps into negative variances, and comes back."""
        z = walk(60, 0.5, 4.0, seed=4)[1:]
        free = fitting.fit(lambda c: level(c, 1.0), z, {"q": 0.01, "r": 30.0}, profiles=False)
        held = fitting.fit(lambda c: level(c, 1.0), z, {"q": 0.01, "r": 30.0}, POSITIVE, profiles=False)
        assert free.log_likelihood == pytest.approx(held.log_likelihood, abs=1e-6)


def test_the_start_is_reported_as_given():
    """Its values, and the likelihood there."""
    assert flow().start == {"q": 1000.0, "r": 10000.0}
    assert flow().start_log_likelihood == pytest.approx(
        reference.log_likelihood(level(flow().start), nile.FLOW[:, None], 0), rel=EXACT * 1e3
    )
    assert flow().start_log_likelihood < flow().log_likelihood


@pytest.mark.parametrize("start", [{"q": 1000.0, "r": 10000.0}, {"q": 30.0, "r": 3e5}])
def test_the_estimates_alone_are_those_of_the_whole_fit(start):
    """To the accuracy of the record, from far off too; a bound is reached where it is the best."""
    found, top = fitting.most_likely(level, nile.FLOW[:, None], start, POSITIVE, 0)
    whole = flow()
    assert top == pytest.approx(whole.log_likelihood, abs=1e-4)
    assert all(abs(found[name] - whole.estimates[name]) < 0.01 * whole.standard_errors[name] for name in found)
    z = np.tile([1.0, -1.0], 50)[:, None]  # a level that moved would not turn back every time
    on_bound, _top = fitting.most_likely(lambda c: level({"q": c["q"], "r": 1.0}), z, {"q": 1.0}, {"q": (0, None)})
    assert on_bound["q"] == 0.0


class TestSigns:
    """Constants that enter by their squares alone: the sign is not the record's to tell."""

    def test_a_standard_deviation_is_positive_and_has_the_error_of_its_variance(self):
        """s = √q from either side, and its standard error is that of q over 2s."""
        z = walk(80, 0.5, 4.0, seed=4)[1:]
        variances = fitting.fit(level, z, {"q": 1.0, "r": 2.0}, POSITIVE, profiles=False)
        for start in ({"q": 0.9, "r": 1.5}, {"q": -0.9, "r": -1.5}, {"q": 0.0, "r": 1.5}):
            found = fitting.fit(lambda c: level({"q": c["q"] ** 2, "r": c["r"] ** 2}), z, start, profiles=False)
            for name, value in variances.estimates.items():
                assert found.estimates[name] == pytest.approx(np.sqrt(value), rel=1e-6)
                assert found.standard_errors[name] == pytest.approx(variances.standard_errors[name] / 2 / np.sqrt(value), rel=1e-5)
            assert found.converged
            assert ("both signs" in found.remark) == (start["q"] < 0)

    def test_a_deviation_that_is_not_needed_is_zero_without_an_error(self):
        """The curvature at 0, a point of symmetry, is no accuracy; the interval is that of the variance's root."""
        z = np.tile([1.0, -1.0], 40)[:, None]
        variances = fitting.fit(level, z, {"q": 1.0, "r": 2.0}, POSITIVE, first=0)
        found = fitting.fit(lambda c: level({"q": c["q"] ** 2, "r": c["r"]}), z, {"q": 1.0, "r": 2.0}, {"r": (0, None)}, first=0)
        assert found.estimates["q"] == variances.estimates["q"] == 0.0
        assert found.standard_errors["q"] is None
        assert found.intervals["q"] == (0.0, pytest.approx(np.sqrt(variances.intervals["q"][1]), rel=1e-4))
        assert found.converged

    def test_two_deviations_and_their_correlation_have_two_signs_too_many(self):
        """rho·s1·s2 is the same when s1 and rho change their signs: the deviations are positive, whatever the start."""
        rng = np.random.default_rng(5)
        z = rng.multivariate_normal([0, 0], [[4.0, -1.8], [-1.8, 1.0]], 60)

        def build(c):
            cross = c["rho"] * c["s1"] * c["s2"]
            R = [[c["s1"] ** 2, cross], [cross, c["s2"] ** 2]]
            return DiscreteModel(np.eye(2), np.zeros((2, 2)), np.eye(2), R, P0=np.zeros((2, 2)))

        sample = z.T @ z / len(z)
        right = [np.sqrt(sample[0, 0]), np.sqrt(sample[1, 1]), sample[0, 1] / np.sqrt(sample[0, 0] * sample[1, 1])]
        for s1, s2, rho in ((1.0, 1.0, 0.1), (-1.0, 1.0, 0.1), (1.0, -3.0, -0.5)):
            found = fitting.fit(build, z, {"s1": s1, "s2": s2, "rho": rho}, {"rho": (-1, 1)}, first=0, profiles=False)
            assert list(found.estimates.values()) == pytest.approx(right, rel=1e-6)

    @pytest.mark.parametrize(("turn", "scale"), [(2 * np.pi, 1.0), (360.0, np.pi / 180)])
    def test_an_angle_is_within_half_a_turn(self, turn, scale):
        """A bearing from its sine and cosine, started four turns off; a slope of the same size stays where it is."""
        rng, truth = np.random.default_rng(1), 0.7 / scale
        z = [np.cos(0.7), np.sin(0.7)] + 0.1 * rng.normal(size=(30, 2))

        def build(c):
            x0 = [np.cos(scale * c["a"]), np.sin(scale * c["a"])]
            return DiscreteModel(np.eye(2), np.zeros((2, 2)), np.eye(2), 0.01 * np.eye(2), x0=x0, P0=np.zeros((2, 2)))

        right = np.arctan2(*z.mean(axis=0)[::-1]) / scale
        found = fitting.fit(build, z, {"a": truth + 4 * turn + 0.2 / scale}, first=0)
        assert found.estimates["a"] == pytest.approx(right, rel=1e-6)
        assert found.intervals["a"][0] < right < found.intervals["a"][1] < right + 0.5 * turn
        line = fitting.fit(lambda c: scatter({"mu": c["a"], "r": 1.0}), 25.0 + z[:, 0], {"a": 25.0}, profiles=False)
        assert line.estimates["a"] > 20


class TestHardRecords:
    def test_the_nile_takes_sixty_likelihoods(self):
        """Estimates, errors and profiles; a third of them without profiles."""
        assert flow().evaluations <= 60
        alone = fitting.fit(level, nile.FLOW[:, None], {"q": 1000.0, "r": 10000.0}, POSITIVE, first=0, profiles=False)
        assert alone.evaluations <= 25

    @pytest.mark.parametrize("noise", [1.0, 1e-3, 1e-6])
    def test_a_start_that_is_far_in_standard_deviations_is_left(self, noise):
        """The mean of 300 weighings, from 99 away: −ℓ up to 1e18 at the start."""
        z = 100.0 + noise * np.random.default_rng(2).normal(size=(301, 1))[1:]
        found = fitting.fit(lambda c: scatter({"mu": c["mu"], "r": noise**2}), z, {"mu": 1.0})
        assert found.estimates["mu"] == pytest.approx(float(z.mean()), abs=1e-6 * noise)
        assert found.standard_errors["mu"] == pytest.approx(noise / np.sqrt(300), rel=1e-5)
        assert found.converged

    def test_a_start_at_zero_is_a_start(self):
        """Of a variance whose maximum is elsewhere, and of one whose maximum is there."""
        z = walk(60, 0.5, 4.0, seed=4)[1:]
        right = fitting.fit(level, z, {"q": 1.0, "r": 2.0}, POSITIVE, profiles=False)
        found = fitting.fit(level, z, {"q": 0.0, "r": 2.0}, POSITIVE, profiles=False)
        assert list(found.estimates.values()) == pytest.approx(list(right.estimates.values()), rel=1e-6)
        still = fitting.fit(level, np.tile([1.0, -1.0], 40)[:, None], {"q": 0.0, "r": 2.0}, POSITIVE, profiles=False)
        assert still.estimates["q"] == 0.0
        assert still.converged
        assert still.standard_errors["r"] > 0

    def test_records_of_one_model_are_fitted_together(self):
        """Two halves whose constants are one: the sum of their likelihoods has its maximum there; one after the other differ."""
        z = nile.FLOW[:, None]
        found = fitting.fit([level, level], [z[:50], z[50:]], {"q": 1000.0, "r": 1e4}, POSITIVE, 0, profiles=False)

        def loss(logs):
            at = dict(zip(("q", "r"), np.exp(logs), strict=True))
            return -sum(log_likelihood(level(at), part, 0) for part in (z[:50], z[50:]))

        best = optimize.minimize(loss, np.log([1000.0, 1e4]), method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-11})
        assert found.log_likelihood == pytest.approx(-best.fun, abs=1e-8)
        assert found.log_likelihood >= -best.fun - 1e-9
        assert found.observations == 100
        assert len(found.models) == 2
        with pytest.raises(ValueError, match="z: expected 2 records, one for each build, received 1"):
            fitting.fit([level, level], [z], {"q": 1000.0, "r": 1e4})

    def test_a_record_without_measurements_is_refused(self):
        """It says nothing of any constant."""
        with pytest.raises(ValueError, match="no observations: expected a record with at least one element measured"):
            fitting.fit(level, np.full((20, 1), np.nan), {"q": 1.0, "r": 1.0}, POSITIVE)

    @pytest.mark.parametrize("after", [5, 14, 30])
    def test_what_is_interrupted_keeps_the_best_so_far(self, after):
        """In the search, at the errors, among the profiles: no constants beside the best met, and it says so."""
        told = []

        def stop(now):
            told.append(now)
            if now.done >= after and not any(each.done > after for each in told[:-1]) and len(told) == after:
                raise KeyboardInterrupt

        found = fitting.fit(level, nile.FLOW[:, None], {"q": 1.0, "r": 1.0}, POSITIVE, first=0, progress=stop)
        assert found.interrupted
        assert "interrupted" in found.remark
        assert found.log_likelihood >= max(each.best for each in told) - 1e-6
        assert all(now.expected >= now.done and now.left >= 0 for now in told)


@pytest.mark.parametrize("seed", range(4))
def test_random_models_have_the_maximum_that_a_simplex_finds(seed):
    """Two states, correlated constants, gaps, perfect or noisy measurements: scipy's search on the same likelihood finds none higher."""
    rng = np.random.default_rng(seed)
    perfect = seed % 2 == 0

    def build(c):
        Phi = [[c["a"], c["b"]], [0, 0.6]]
        R = [[0.0]] if perfect else [[np.exp(c["s"])]]
        return DiscreteModel(Phi, [[np.exp(c["s"]), 0], [0, 1]], [[1, 0]], R, P0=np.eye(2))

    truth = {"a": rng.uniform(0.2, 0.9), "b": rng.uniform(0.5, 2.0), "s": rng.uniform(-1, 1)}
    z = record(build(truth), 120, rng, gaps=0.1)[1:]
    found = fitting.fit(build, z, {"a": 0.1, "b": 1.0, "s": 0.0}, profiles=False)

    def loss(v):
        return -log_likelihood(build(dict(zip(truth, v, strict=True))), z)

    best = optimize.minimize(loss, list(found.estimates.values()), method="Nelder-Mead", options={"xatol": 1e-8, "fatol": 1e-10})
    assert found.converged
    assert found.log_likelihood >= -best.fun - 1e-8
    start = optimize.minimize(loss, list(truth.values()), method="Nelder-Mead", options={"xatol": 1e-8, "fatol": 1e-10})
    assert found.log_likelihood >= -start.fun - 1e-6
