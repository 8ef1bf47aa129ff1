"""The checks of studies and labs can fail: each finds an answer that is wrong by one per cent in its smallest part."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from ctlabs import montecarlo
from ctlabs.filtering import kalman_filter, smooth, steady
from ctlabs.labs import catalogue as labs
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.models import DiscreteModel
from ctlabs.models.discretisation import discretise
from ctlabs.montecarlo import chance
from ctlabs.reporting.report import Report
from ctlabs.studies import analysis, filtering, second
from tests import cases

WALK = DiscreteModel([[0.9]], [[1.0]], [[1.0]], [[2.0]], x0=[0], P0=[[3.0]])
PAIR = DiscreteModel(
    [[1.0, 0.5], [0.0, 0.8]], [[0.1, 0.05], [0.05, 0.3]], [[1.0, 0.0]], [[0.5]], x0=[0, 0], P0=[[4.0, 0], [0, 1.0]]
)


def report() -> Report:
    """A report without a parameter."""

    class Nothing:
        def plain(self):
            return {}

        def described(self):
            return []

    return Report({"name": "x", "title": "", "source": "", "parts": ["a"]}, Nothing(), 0, 0)


def sampled(case):
    """The discrete model of a case."""
    model, given = cases.model(case["model"]), case.get("given", {})
    return model if isinstance(model, DiscreteModel) else discretise(model, given["dt"], R=given["R"])


class TestSteadyCovariance:
    """The check "steady covariance" of ``ctlabs analyse``."""

    def passes(self, model: DiscreteModel, P_minus: np.ndarray) -> bool:
        made = report()
        made.part = "a"
        analysis.limit_check(made, model, replace(steady.solve(model), P_minus=P_minus))
        return made.passed

    @pytest.mark.parametrize("name", ["k5_ins_channel", "k5_clock"])
    def test_it_passes_for_the_right_answer_and_for_no_other(self, name):
        """An inertial channel and a clock, whose variances span twenty decades."""
        case = cases.read(cases.NUMERICS / f"{name}.json")
        model = sampled(case)
        assert self.passes(model, cases.matrix(case["right"]["P_minus"]))
        for broken in case["broken"]:
            assert not self.passes(model, cases.matrix(broken["P_minus"])), broken["what"]

    @pytest.mark.parametrize("factor", [0.99, 1.01])
    @pytest.mark.parametrize("drive", [1e-14, 1e-6, 1.0])
    def test_the_smallest_variance_is_judged(self, drive, factor):
        """A slow bias beside a position, in any proportion."""
        model = DiscreteModel(
            [[1.0, 1.0], [0.0, 1.0]], [[1.0, 0], [0, drive]], [[1.0, 0.0]], [[1.0]], x0=[0, 0], P0=[[1, 0], [0, 1]]
        )
        right = second.covariance_of_gain(model, steady.solve(model))
        assert self.passes(model, right)
        wrong = right.copy()
        wrong[1, 1] *= factor
        assert not self.passes(model, wrong)


class TestSecondRoute:
    def test_a_gain_off_by_a_little_gives_the_optimal_covariance(self):
        """To first order the errors do not feel the gain: the route does not depend on the answer that it judges."""
        limit = steady.solve(PAIR)
        off = replace(limit, K_pred=limit.K_pred * (1 + 1e-7))
        right = second.covariance_of_gain(PAIR, limit)
        np.testing.assert_allclose(second.covariance_of_gain(PAIR, off), right, rtol=1e-12)
        assert not np.allclose(
            second.covariance_of_gain(PAIR, replace(limit, K_pred=limit.K_pred * 1.1)), right, rtol=1e-4
        )

    def test_correlated_noises_belong_to_it(self):
        """With N the errors under the predictor's gain have the Riccati equation's covariance too."""
        model = replace(PAIR, N=[[0.1], [0.05]])
        limit = steady.solve(model)
        np.testing.assert_allclose(second.covariance_of_gain(model, limit), limit.P_minus, rtol=1e-10)

    def test_a_filter_that_does_not_settle_has_no_covariance(self):
        """A gain of zero leaves an undamped mode growing."""
        walk = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[1]])
        dead = replace(steady.solve(walk), K_pred=np.zeros((1, 1)))
        assert np.isinf(second.covariance_of_gain(walk, dead)).all()


class TestSmoother:
    """The checks of ``ctlabs filter --smooth``."""

    def test_they_pass_for_the_right_answer_and_for_no_other(self):
        """A moving average observed exactly: σ = 0, or 1 % less than is right, at the first instant."""
        case = cases.read(cases.NUMERICS / "k5_smoother_ma1.json")
        model, z, first = cases.model(case["model"]), cases.record(case["given"]), case["given"]["first"]
        x, P = second.smoothed(model, z, first)
        np.testing.assert_allclose(np.sqrt(P[0, 1, 1]), case["right"]["sd"][0][1], rtol=1e-12)
        assert self.passes(model, z, first, x, P)
        for broken in case["broken"]:
            wrong = P.copy()
            wrong[0] = np.diag(np.square(broken["sd"][0]))
            assert not self.passes(model, z, first, x, wrong), broken["what"]
        assert not self.passes(model, z, first, x + 0.01 * np.sqrt(P[0, 1, 1]) * (np.arange(2) == 1), P)

    def test_the_library_passes(self):
        """Its smoother agrees with conditioning, gaps and a time-varying model included."""
        model = replace(PAIR, H=np.repeat(PAIR.H[None], 13, axis=0) * np.linspace(0.5, 2, 13)[:, None, None])
        z = np.cos(np.arange(13.0))[:, None]
        z[[0, 4, 5]] = np.nan
        found = smooth(model, kalman_filter(model, z[1:]))
        assert self.passes(model, z, 1, found.x, found.P)

    @staticmethod
    def passes(model, z, first, x, P) -> bool:
        made = report()
        made.part = "a"
        filtering.smoothed_check(made, model, z, first, x, P)
        return made.passed


class TestEnsembles:
    """An ensemble finds a variance that is wrong by 5 %."""

    @staticmethod
    def verdicts(model: DiscreteModel, factor: float, seed: int) -> list[chance.Verdict]:
        """The pooled tests of a filter whose true variances are ``factor`` times what it claims."""
        truth = replace(model, P0=factor * model.P0, Qd=factor * model.Qd, R=factor * model.R)
        steps = 150
        stats = montecarlo.monte_carlo(truth, model, steps=steps, runs=1000, seed=seed)
        plan = covariances(model, steps)
        pooled = chance.pooled_variance(stats, plan.P_plus, chance.error_correlation(model, plan))
        return [chance.pooled_nis(stats), pooled]

    @pytest.mark.parametrize("model", [WALK, PAIR], ids=["scalar", "pair"])
    @pytest.mark.parametrize("seed", [1, 2, 3])
    def test_five_per_cent_are_found(self, model, seed):
        """In the innovations and in the errors."""
        assert not any(self.verdicts(model, 1.05, seed))
        assert not any(self.verdicts(model, 0.95, seed))

    @pytest.mark.parametrize("model", [WALK, PAIR], ids=["scalar", "pair"])
    def test_a_right_filter_passes(self, model):
        """Its deviations are those of chance."""
        values = [test.value for seed in range(1, 7) for test in self.verdicts(model, 1.0, seed)]
        assert max(values) < 4
        assert np.mean(np.square(values)) < 3

    def test_the_power_is_what_a_report_needs(self):
        """At 150 measurements and 1000 runs 5 % are missed less than once in a thousand ensembles."""
        dof = 150 * 1000
        quantile = chance.chi2_quantile(1.05 * dof * (1 - 3.1 * np.sqrt(2 / dof)), dof)
        assert quantile > chance.pooled_nis(montecarlo.monte_carlo(WALK, steps=2, runs=2, seed=1)).critical

    def test_labs_have_random_numbers_of_their_own(self):
        """The same model and seed in two labs are two experiments."""
        one, other = (Experiment(50, 1, name=name).statistics(WALK, steps=3).rms for name in ("task01", "task07"))
        assert not np.isclose(one, other).any()


class TestLabs:
    """References that hold at all legal parameters."""

    @pytest.mark.parametrize(
        ("lab", "values"),
        [("task01", {"R": 1e-6}), ("task02", {"R": 1e-6, "u": -1000})],
    )
    @pytest.mark.slow
    def test_a_right_run_passes(self, lab, values):
        """A measurement error of a millimetre beside ten metres of drift."""
        assert ran(lab, values).passed

    @pytest.mark.slow
    @pytest.mark.parametrize("values", [{"sigma_theta": 1e-9, "sigma_r": 1}])
    def test_a_laser_on_a_satellite(self, values):
        """Errors below the rounding of the orbit's radius are not simulated, and the report says so."""
        made = ran("task18", values)
        assert made.passed
        assert any("left out here" in getattr(block, "text", "") for block in made.blocks)

    @pytest.mark.slow
    def test_a_limit_is_one_that_was_reached(self):
        """Lab 3 with a loud sensor: 9.912 after 300 measurements is on its way to 4.298."""
        case = cases.read(cases.NUMERICS / "k5_limit_not_reached.json")
        made = ran("task03", {"R": 1e6, "tau": 0.01})
        text = " ".join(getattr(block, "text", "") for block in made.blocks)
        assert "stays there" not in text
        assert "falls on to its limit 4.298" in text
        assert "its transient, not its limits" in " ".join(str(getattr(block, "rows", "")) for block in made.blocks)
        np.testing.assert_allclose(
            made.values["constant_variance"].value, case["right"]["variance_of_c"]["300"], rtol=1e-9
        )

    def test_what_an_alarm_misses(self):
        """Lab 9: by quadrature over the voltage, the share of dangerous moments that no alarm announces."""
        case = cases.read(cases.NUMERICS / "k5_lab9_alarm.json")
        by_hand = labs.load(labs.find(["9"])[0]).by_hand
        for row in case["right"]["table"]:
            left, limit, k = row["P"] / row["V"], row["Umax_in_sd"], row["margin_in_sd"]
            for route in (by_hand.unannounced, by_hand.by_estimate):
                np.testing.assert_allclose(route(left, limit, k), row["joint"], rtol=1e-6)
            share = by_hand.unannounced(left, limit, k) / ndtr(-limit)
            np.testing.assert_allclose(share, row["missed_of_dangerous"], rtol=1e-6)


def ran(lab: str, values: dict[str, float]) -> Report:
    """The report of a lab with other parameters."""
    (chosen,) = labs.find([lab])
    return labs.run(chosen, labs.parameters([chosen], values)[lab], Experiment(60, 1, 1))
