"""Scheduling of measurements: the search finds what complete enumeration finds, and says what it cannot know."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ctlabs.analysis import scheduling
from ctlabs.labs.experiment import covariances
from ctlabs.models import DiscreteModel
from tests.reference import EXACT, close
from tests.strategies import seeds


def scalar(P0=900.0, Q=900.0, R=900.0, Phi=1.0):
    return DiscreteModel([[Phi]], [[Q]], [[1]], [[R]], x0=[0], P0=[[P0]])


def drawn(seed, n):
    rng = np.random.default_rng(seed)
    A, B, C = (rng.normal(size=(n, n)) for _ in range(3))
    return DiscreteModel(0.6 * A, B @ B.T, rng.normal(size=(1, n)), [[1.0]], x0=np.zeros(n), P0=C @ C.T)


def through_the_filter(model, instants, horizon):
    """RMS at the end and the worst prior RMS of a selection, by the ordinary filter with R = ∞ elsewhere."""
    R = np.full((horizon + 1, 1, 1), np.inf)
    R[list(instants)] = model.R
    timed = DiscreteModel(model.Phi, model.Qd, model.H, R, x0=model.x0, P0=model.P0)
    schedule = covariances(timed, horizon, first=0)
    rms = np.sqrt(np.einsum("i,kij,j->k", model.H[0], schedule.P_minus, model.H[0]))
    return rms[-1], rms[list(instants)].max()


@settings(max_examples=20)
@given(seed=seeds)
@pytest.mark.parametrize("n", [1, 2, 3])
def test_enumeration_agrees_with_the_filter(n, seed):
    """Every selection's RMS is that of the ordinary filter with the other measurements absent."""
    model = drawn(seed, n)
    every = scheduling.exhaustive(model, 2, 5)
    assert [tuple(row) for row in every.instants] == list(combinations(range(5), 2))
    for row, rms, worst in zip(every.instants, every.rms, every.worst, strict=True):
        assert close([rms, worst], through_the_filter(model, row, 5), 1e-10)


@settings(max_examples=30)
@given(n=st.integers(1, 3), seed=seeds)
def test_the_search_finds_the_best_of_all(n, seed):
    """With nothing cut off, the search through time equals complete enumeration, with and without a limit."""
    model = drawn(seed, n)
    every = scheduling.exhaustive(model, 3, 8)
    for limit in (None, float(np.median(every.worst)), float(0.99 * every.worst.min())):
        winner, found = every.best(limit), scheduling.best(model, 3, 8, limit=limit)
        assert found.gap == 0
        if winner is None:
            assert found.instants is None
            assert close(found.needed, every.worst.min(), 1e-8)
        else:
            assert close(found.rms, every.rms[winner], EXACT)


def test_a_limit_at_all_instants_is_stricter_than_one_at_updates():
    """What holds always holds at updates; the search respects it between updates too."""
    free = scheduling.exhaustive(scalar(), 2, 10)
    always = scheduling.exhaustive(scalar(), 2, 10, when="always")
    assert (always.worst >= free.worst).all()
    found = scheduling.best(scalar(), 2, 10, limit=float(np.sort(always.worst)[3]), when="always")
    assert close(found.rms, always.rms[always.best(float(np.sort(always.worst)[3]))], EXACT)


def test_equal_plans_are_won_by_the_last():
    """Without noise and error growth every instant is as good: the lexicographically last selection is taken."""
    assert scheduling.best(scalar(Q=0.0), 2, 6).instants == (4, 5)
    every = scheduling.exhaustive(scalar(Q=0.0), 2, 6)
    assert tuple(every.instants[every.best()]) == (4, 5)


def test_what_a_cap_cuts_off_is_bounded_by_the_gap():
    """With one covariance kept the plan may be worse, but never by more than the gap it reports."""
    for seed in range(20):
        model = drawn(seed, 3)
        optimum = scheduling.exhaustive(model, 3, 9).rms.min()
        found = scheduling.best(model, 3, 9, kept=1)
        assert optimum * (1 - 1e-10) <= found.rms <= optimum + found.gap + 1e-10 * optimum


def test_a_wrong_filter_is_noticed():
    """The identity with the filter fails when R is 5 % too large."""
    every = scheduling.exhaustive(scalar(R=1.05 * 900), 2, 5)
    assert not close(every.rms[0], through_the_filter(scalar(), every.instants[0], 5)[0], EXACT)


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (lambda: scheduling.best(scalar(), 4, 3), r"count: expected at most as many .* \(3\), received 4"),
        (lambda: scheduling.best(scalar(), 2, 3, limit=-1.0), "limit: expected a number > 0, received -1.0"),
        (lambda: scheduling.exhaustive(scalar(), 20, 60), "selections: expected at most 50000000"),
        (lambda: scheduling.exhaustive(scalar(R=np.inf), 1, 3), "model: expected constant matrices, finite R"),
    ],
)
def test_impossible_questions_are_refused(action, message):
    """One line says what was expected."""
    with pytest.raises(ValueError, match=message):
        action()
