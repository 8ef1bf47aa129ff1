"""What can be said without data: modes seen and reached, and the limits of true errors and of their budget."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ctlabs import ContinuousModel, DiscreteModel, actual_errors, error_budget, observability, steady_state
from ctlabs.analysis import reachability
from ctlabs.models import discretise
from ctlabs.models.observability import Observability, SamplingLoss
from tests.reference import EXACT, SOLVER, close

pytestmark = pytest.mark.numerical

TRACK = DiscreteModel(
    [[1, 0.5], [0, 0.9]], [[0.1, 0.05], [0.05, 0.2]], [[1, 0], [0, 1]], [[1, 0.3], [0.3, 0.5]], P0=np.eye(2), dt=0.5,
    states=["x", "v"], measurements=["gauge", "radar"],
)  # fmt: skip
DESIGN = replace(TRACK, Phi=[[1, 0.5], [0, 0.8]], R=[[2, 0], [0, 0.5]], offset=[0.1, 0.0])
LONG = 400


def swing(H: list[list[float]], G: list[list[float]]) -> ContinuousModel:
    """An oscillator of period 2 s beside a decaying state."""
    w = np.pi
    return ContinuousModel(
        [[0, 1, 0], [-w * w, 0, 0], [0, 0, -1]], G, np.eye(len(G[0])), H, Rc=np.eye(len(H)), P0=np.eye(3), states=["x", "v", "b"]
    )


class TestModes:
    def test_what_is_not_measured_is_named(self) -> None:
        """Of the oscillator and the state beside it, only the one that is measured is seen."""
        found = observability(swing([[1, 0, 0]], [[0], [1], [1]]))
        assert isinstance(found, Observability)
        assert (found.rank, found.ok, found.detectable) == (2, False, True)
        assert found.unobservable_modes == ("eigenvalue -1 of the states b",)
        whole = observability(swing([[1, 0, 1]], [[0], [1], [1]]))
        assert isinstance(whole, Observability)
        assert whole.ok

    def test_reachability_is_observability_of_the_dual(self) -> None:
        """The rank is Kalman's, of (G, FG, F²G); what no noise reaches is named."""
        for G in ([[0], [1], [0]], [[0], [1], [1]], [[0], [0], [1]], [[0, 0], [1, 0], [0, 1]]):
            model = swing([[1, 0, 1]], G)
            krylov = np.hstack([np.linalg.matrix_power(model.F, i) @ model.G for i in range(3)])
            assert reachability(model).rank == np.linalg.matrix_rank(krylov)
        assert reachability(swing([[1, 0, 1]], [[0], [1], [0]])).unobservable_modes == ("eigenvalue -1 of the states b",)

    def test_a_strength_of_zero_reaches_nothing(self) -> None:
        """It is G√Q that counts, and of a discrete model √Qd."""
        model = swing([[1, 0, 1]], [[0, 0], [1, 0], [0, 1]])
        assert reachability(model).ok
        assert reachability(replace(model, Q=np.diag([1.0, 0.0]))).rank == 2
        sampled = discretise(replace(model, Q=np.diag([1.0, 0.0])), 0.3)
        assert reachability(sampled).rank == 2
        assert reachability(discretise(model, 0.3)).ok

    def test_with_a_period_it_is_what_sampling_loses(self) -> None:
        """Half a swing between samples hides the speed; of a discrete model there is no period to choose."""
        model = swing([[1, 0, 1]], [[0], [1], [1]])
        lost, kept = observability(model, 1.0), observability(model, 0.3)
        assert isinstance(lost, SamplingLoss)
        assert isinstance(kept, SamplingLoss)
        assert (lost.rank_continuous, lost.sampled.rank, kept.sampled.rank) == (3, 2, 3)
        with pytest.raises(TypeError, match="model: expected a ContinuousModel, received a DiscreteModel"):
            observability(TRACK, 0.3)
        with pytest.raises(ValueError, match="model: expected constant matrices"):
            reachability(replace(TRACK, Qd=np.ones((3, 1, 1)) * TRACK.Qd))


class TestLimits:
    def test_the_limit_of_the_true_errors_is_that_of_the_transient(self) -> None:
        """Covariance, bias and mean square error of a wrong filter after a long time; 5 % in its R are seen."""
        limit, path = actual_errors(TRACK, DESIGN), actual_errors(TRACK, DESIGN, LONG)
        for name in ("P_minus", "P_plus", "bias_minus", "bias_plus", "mse_plus"):
            assert close(getattr(limit, name), getattr(path, name)[-1], SOLVER), name
        other = actual_errors(TRACK, replace(DESIGN, R=1.05 * DESIGN.R))
        assert not close(other.P_plus, limit.P_plus, 1e-4)

    def test_of_the_right_filter_it_is_the_steady_state(self) -> None:
        """No bias, and the covariance that it claims."""
        found, own = actual_errors(TRACK, TRACK), steady_state(TRACK)
        assert close(found.P_plus, own.P_plus, SOLVER)
        assert close(found.K, own.K, SOLVER)
        assert not found.bias_plus.any()

    def test_a_gain_may_be_given(self) -> None:
        """As K, of the limits; half the gain is worse than the best."""
        K = steady_state(TRACK).K
        best, half = actual_errors(TRACK, TRACK, K=K), actual_errors(TRACK, TRACK, K=0.5 * K)
        assert close(best.P_plus, steady_state(TRACK).P_plus, SOLVER)
        assert (np.diag(half.P_plus) > np.diag(best.P_plus)).all()

    @pytest.mark.parametrize("design", [None, DESIGN], ids=["own", "wrong"])
    def test_the_parts_of_a_budget_add_up(self, design: DiscreteModel | None) -> None:
        """To the covariance with all sources at work, which is computed at once: steady and at every step."""
        for found in (error_budget(TRACK, design=design), error_budget(TRACK, 20, design=design)):
            assert close(found.parts.sum(axis=0), found.P_plus, SOLVER)
            assert not close((1.05 * found.parts).sum(axis=0), found.P_plus, 1e-3)
            assert found.table()[-1][0] == "total"

    @pytest.mark.parametrize("design", [None, DESIGN], ids=["own", "wrong"])
    def test_the_steady_budget_is_the_limit_of_the_transient_one(self, design: DiscreteModel | None) -> None:
        """Source by source; the initial uncertainty is forgotten, and has no row."""
        limit, path = error_budget(TRACK, design=design), error_budget(TRACK, LONG, design=design)
        assert limit.t.tolist() == [np.inf]
        assert set(limit.names) <= set(path.names)
        last = dict(zip(path.names, path.parts[:, -1], strict=True))
        for name, part in zip(limit.names, limit.parts[:, 0], strict=True):
            assert close(part, last.pop(name), SOLVER), name
        assert all(np.abs(rest).max() < SOLVER for rest in last.values())
        assert close(limit.P_plus[0], actual_errors(TRACK, design or TRACK).P_plus, EXACT)

    def test_without_noises_nothing_is_left(self) -> None:
        """A state that decays, unmeasured errors and all: the budget is of zeros."""
        still = DiscreteModel([[0.5]], [[0]], [[1]], [[1]], P0=[[1]])
        found = error_budget(still)
        assert found.names == ()
        assert found.parts.shape == (0, 1, 1, 1)
        assert found.table() == [["total", 0.0]]


# What inputs reach -----------------------------------------------------------------------------------------------------


def driven(F: list[list[float]], B: list[list[float]]) -> ContinuousModel:
    n = len(F)
    return ContinuousModel(F, np.eye(n), np.eye(n), np.eye(1, n), B=B, P0=np.eye(n))


def test_inputs_reach_what_the_transposed_system_sees():
    model = driven([[-1, 0], [0, 2]], [[1], [0]])
    found = reachability(model, by="inputs")
    assert found.undetectable_modes == ("eigenvalue 2 of the states x2",)
    assert reachability(discretise(model, 0.1, R=[[1]]), by="inputs").undetectable_modes[0].endswith("of the states x2")
    assert reachability(model).ok  # the noises reach both


def test_a_held_input_loses_a_swing_of_its_period():
    swing = driven([[0, 1], [-1, 0]], [[0], [1]])
    assert reachability(swing, 1.0, by="inputs").rank == 2
    for period in (np.pi, 2 * np.pi):
        lost = reachability(swing, period, by="inputs")
        assert lost.lost
        assert lost.rank == (1 if period == np.pi else 0)  # over a whole turn a held input does nothing at all
    assert not reachability(swing, np.pi).lost  # noise does not hold still


def test_reachability_by_what_it_does_not_have_is_refused():
    with pytest.raises(ValueError, match="model: expected B"):
        reachability(driven([[0.0]], [[1.0]]).__class__([[0]], [[1]], [[1]], [[1]], P0=[[1]]), by="inputs")
    with pytest.raises(ValueError, match='by: expected "noises" or "inputs"'):
        reachability(driven([[0.0]], [[1.0]]), by="wind")
