"""Labs on regulators: their standard experiment, and checks that find a regulator or an answer that is wrong by five per cent."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ctlabs import Cost, DiscreteModel, regulator
from ctlabs.filtering import bucy
from ctlabs.labs import catalogue as labs
from ctlabs.labs import loops
from ctlabs.labs.experiment import Experiment
from ctlabs.regulation import continuous, synthesis
from tests.labs.test_checks import report
from tests.labs.test_tasks import FailedError, until_a_check_fails

LABS = {name: lab for name, lab in labs.catalogue().items() if lab.extension}
PLANT = DiscreteModel(
    [[1.1, 0.3], [0.0, 0.8]], [[0.2, 0.1], [0.1, 0.4]], [[1.0, 0.0]], [[0.5]], B=[[0.0], [1.0]], P0=[[2.0, 0.0], [0.0, 1.0]]
)  # fmt: skip
COST = Cost([[1.0, 0.0], [0.0, 0.5]], [[0.3]])


class TestEnsemble:
    """The signals of a loop over time."""

    @staticmethod
    def of(model, runs=1000, seed=1):
        loop = regulator(PLANT, COST).closed
        rows = np.vstack([np.eye(2, loop.model.n), loop.model.H[-1:]])
        weight = np.zeros((3, 3))
        weight[:2, :2], weight[2:, 2:] = COST.Qx, COST.Qu
        return loop, loops.ensemble(Experiment(runs, seed, name="loops"), model or loop.model, rows, weight, 150)

    def test_covariances_between_instants_are_those_of_one_large_gaussian_vector(self):
        """x(k) is a sum of what came before, added up by hand."""
        _, found = self.of(None, runs=2)
        model = regulator(PLANT, COST).closed.model
        rows = np.vstack([np.eye(2, model.n), model.H[-1:]])
        steps, n = 4, model.n
        power = [np.linalg.matrix_power(model.Phi, k) for k in range(steps + 1)]
        zero, count = np.zeros((n, n)), range(steps + 1)
        into = np.block([[power[k - j] if j <= k else zero for j in count] for k in count])
        noise = np.zeros((n * (steps + 1),) * 2)
        for j in range(steps + 1):
            noise[n * j : n * (j + 1), n * j : n * (j + 1)] = model.Qd if j else model.P0
        C = np.kron(np.eye(steps + 1), rows)
        whole = (C @ into @ noise @ into.T @ C.T).reshape(steps + 1, 3, steps + 1, 3)
        np.testing.assert_allclose(found.joint[: steps + 1, :, : steps + 1], whole, rtol=1e-12, atol=1e-13)

    def test_the_expected_cost_is_the_regulators(self):
        """After the start is forgotten."""
        _, found = self.of(None, runs=2)
        np.testing.assert_allclose(found.expected(55), regulator(PLANT, COST).cost.value, rtol=1e-8)

    @pytest.mark.parametrize("seed", [1, 2, 3])
    def test_a_right_loop_passes_and_five_per_cent_more_noise_are_found(self, seed):
        """By the cost of the whole time, where no single instant would tell."""
        loop, found = self.of(None, seed=seed)
        right, wrong = report(), report()
        right.part = wrong.part = "a"
        assert loops.agreement(right, "", found) < 6
        assert right.passed
        louder = replace(loop.model, Qd=1.05 * loop.model.Qd, P0=1.05 * loop.model.P0)
        _, other = self.of(louder, seed=seed)
        loops.agreement(wrong, "", replace(other, P=found.P, joint=found.joint))
        assert [check.passed for check in wrong.checks] == [True, False]

    def test_the_mean_cost_has_its_standard_error(self):
        """It is that of independent runs."""
        _, found = self.of(None)
        cost = found.cost(30)
        assert abs(cost.value - found.expected(30)) < 4 * cost.error
        assert 0 < cost.error < 0.1 * cost.value


def five_per_cent(lab, patch, wrong):
    """Make a regulator's parts wrong by five per cent."""
    by_lqr, by_steady, by_bucy = synthesis.lqr, synthesis.steady_estimator, bucy.steady
    if wrong == "L":
        for module in (synthesis, continuous):
            patch.setattr(module, "lqr", lambda *a, **k: replace(found := by_lqr(*a, **k), L=1.05 * found.L))
    elif wrong == "S":
        for module in (synthesis, continuous):
            patch.setattr(module, "lqr", lambda *a, **k: replace(found := by_lqr(*a, **k), S=1.05 * found.S))
    else:
        patch.setattr(synthesis, "steady_estimator", lambda model: (found := by_steady(model))._replace(K=1.05 * found.K))
        patch.setattr(bucy, "steady", lambda model: replace(found := by_bucy(model), K=1.05 * found.K))


@pytest.mark.parametrize("wrong", ["L", "S", "K"])
@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.xdist_group(name)) for name in LABS])
def test_a_regulator_wrong_by_five_per_cent_is_noticed(name, wrong, monkeypatch):
    """Its gain, its cost to go, or its filter's gain."""
    five_per_cent(name, monkeypatch, wrong)
    with pytest.raises((FailedError, ValueError, FloatingPointError)):
        until_a_check_fails(LABS[name])


@pytest.mark.parametrize("wrong", ["N", "constant", "Qx"])
def test_a_sampled_cost_wrong_by_five_per_cent_is_noticed(wrong, monkeypatch):
    """Cross term, weight, and what the noise adds between the samples, in the regulators of lab 25."""
    right = synthesis.sample

    def mutated(*args, **named):
        model, cost = right(*args, **named)
        return type(right(*args, **named))(model, replace(cost, **{wrong: 1.05 * getattr(cost, wrong)}))

    monkeypatch.setattr(synthesis, "sample", mutated)
    with pytest.raises((FailedError, ValueError)):
        until_a_check_fails(LABS["task25"])


@cache
def answered(name):
    """The names of a lab's answers by hand, with its default parameters."""
    lab = LABS[name]
    found = labs.by_hand(name).analytic(labs.load(lab).Parameters())
    return [each for each, value in found.items() if value is not None and np.any(np.asarray(value, dtype=float))]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "answer"), [(name, each) for name in LABS for each in answered(name)])
def test_an_answer_by_hand_wrong_by_five_per_cent_is_noticed(name, answer, monkeypatch):
    """Every one of them is compared with another route."""
    hand = labs.by_hand(name)
    right = hand.analytic

    def mutated(p):
        found = right(p)
        return found | {answer: (1.05 * np.asarray(found[answer], dtype=float)).tolist()}

    monkeypatch.setattr(hand, "analytic", mutated)
    with pytest.raises((FailedError, ValueError, FloatingPointError)):
        until_a_check_fails(LABS[name])
