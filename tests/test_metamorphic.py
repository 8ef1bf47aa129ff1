"""No verb's answer depends on units, on the order of states and measurements, or on the basis."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import Phase, given, settings

from ctlabs.filtering import covariances, kalman_filter, smooth, steady
from ctlabs.models import DiscreteModel
from tests import metamorphic
from tests.metamorphic import ALGORITHMS, CONTINUOUS, DISCRETE, STEPS, Change, Verb, changes, field, problems

pytestmark = pytest.mark.numerical

#: In units of the standard deviations: rounding of a change of units, times the condition of a well-posed problem.
CLOSE = 1e-9
KINDS = ["units", "order", "basis"]


def size(made: str, value: np.ndarray, sd: dict[str, np.ndarray]) -> Any:
    """What an element is measured by: the standard deviations of what it is made of, or itself."""
    letters = made.replace("t", "").replace("/", "")
    if made in ("", "log"):
        return 1 + np.abs(value)
    total = np.ones(1)
    for letter in letters:
        own = sd[letter.lower()]
        total = np.multiply.outer(total, own if letter.islower() else 1 / own)
    return total[0]


def same(verb: Verb, model: Any, z: np.ndarray, change: Change) -> None:
    """The answer to the changed problem is the changed answer."""
    measured = np.isfinite(z).sum(axis=0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        before, after = verb.call(model, z), verb.call(change.model(model), change.record(z))
    moved = change.model(model)
    P = moved.P0 + (moved.Qd if isinstance(moved, DiscreteModel) else 0.0)
    R = moved.R if isinstance(moved, DiscreteModel) else moved.Rc / (change.c * metamorphic.rate(model))
    noise = np.sqrt(np.diag(moved.H @ P @ moved.H.T + R))
    sd = {"x": np.sqrt(np.diag(P)), "z": noise}
    for name, made in verb.made.items():
        plain, found = np.atleast_1d(field(before, name)), np.atleast_1d(field(after, name))
        known = np.isfinite(plain)  # what did not enter has NaN, or inf on its diagonal
        assert known.sum() == np.isfinite(found).sum(), name
        if made in ("x", "xx", "xZ", "zz") and plain.ndim > len(made):
            rows = known.reshape(len(plain), -1).all(axis=1)
            plain, found = plain[rows], found[rows]
        wanted = change.answer(plain, made, measured)
        finite = np.isfinite(wanted)
        wanted, found = np.where(finite, wanted, 0.0), np.where(finite, found, 0.0)
        own = size(made, wanted, sd)
        if "/" in made:
            own = own / (change.c * metamorphic.rate(model))
        # Estimates move with the data, which are no larger than some σ; covariances of a filter lie below P0 + Qd.
        scale = np.broadcast_to(np.maximum(own, np.abs(wanted) if made == "XX" else own), wanted.shape)
        error = np.abs(found - wanted) / scale
        assert error.max(initial=0.0) < CLOSE * (1e3 if "X" in made or "Z" in made else 10), (name, error.max())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("verb", DISCRETE, ids=lambda verb: verb.name)
@given(data=st.data())
@settings(phases=[Phase.generate], max_examples=5)
def test_discrete_verbs(verb, kind, data):
    """Another unit, order or basis: the same answer in other words."""
    model, z = data.draw(problems(correlated=True))
    same(verb, model, z, data.draw(changes(model.n, model.m, kind)))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("verb", CONTINUOUS, ids=lambda verb: verb.name)
@given(data=st.data())
@settings(phases=[Phase.generate], max_examples=8)
def test_continuous_verbs(verb, kind, data):
    """The same in continuous time, whose unit changes too."""
    model, z = data.draw(problems(continuous=True))
    same(verb, model, z, data.draw(changes(model.n, model.m, kind)))


FILTERS = {
    **{name: lambda m, z, name=name: kalman_filter(m, z, algorithm=name) for name in ALGORITHMS},
    "smooth": smooth,
}


def halved(model: DiscreteModel, z: np.ndarray) -> tuple[DiscreteModel, np.ndarray]:
    """Two steps for each of the model's, nothing measured after the first of them."""
    whole = replace(model, Phi=model.Phi @ model.Phi, Qd=model.Phi @ model.Qd @ model.Phi.T + model.Qd)
    twice = np.full((2 * len(z), model.m), np.nan)
    twice[1::2] = z
    return whole, twice


@pytest.mark.parametrize("name", FILTERS)
@given(problem=problems())
@settings(phases=[Phase.generate], max_examples=4)
def test_a_step_in_two_halves(name, problem):
    """An instant without a measurement changes nothing at the others."""
    model, z = problem
    whole, twice = halved(model, z)
    one, two = FILTERS[name](whole, z), FILTERS[name](model, twice)
    # A form of information moves Φ⁻¹ about, and what it inverts has the square of its condition.
    lost = 64 * np.finfo(float).eps * np.linalg.cond(model.Phi) ** 2 if name == "information" else 0.0
    for letter in ("x", "P") if name == "smooth" else ("x_plus", "P_plus"):
        a, b = getattr(one, letter), getattr(two, letter)[::2]
        np.testing.assert_allclose(a, b, rtol=0, atol=(1e-10 + lost) * max(1.0, np.abs(a).max()))
    if name != "smooth":
        np.testing.assert_allclose(one.log_likelihood, two.log_likelihood, rtol=1e-10 + lost)


def widened(model: DiscreteModel) -> DiscreteModel:
    """A further state that nothing sees and that moves nothing."""
    def beside(M: np.ndarray, last: float) -> np.ndarray:
        wide = np.zeros((model.n + 1, model.n + 1))
        wide[:-1, :-1], wide[-1, -1] = M, last
        return wide

    return DiscreteModel(
        beside(model.Phi, 0.7), beside(model.Qd, 1e6), np.pad(model.H, [(0, 0), (0, 1)]), model.R,
        x0=[*model.x0, 3.0], P0=beside(model.P0, 1e3),
    )  # fmt: skip


@pytest.mark.parametrize("verb", [v for v in DISCRETE if v.name != "observability.gramian"], ids=lambda verb: verb.name)
@given(problem=problems())
@settings(phases=[Phase.generate], max_examples=3)
def test_a_state_that_nothing_sees(verb, problem):
    """The answers for the other states stay."""
    model, z = problem
    before, after = verb.call(model, z), verb.call(widened(model), z)
    for name, made in verb.made.items():
        wanted, found = np.asarray(field(before, name)), np.asarray(field(after, name))
        for axis, letter in enumerate(reversed(made), start=1):
            if letter in "xX" and made != "log":
                found = np.take(found, range(model.n), axis=-axis)
        finite = np.isfinite(wanted)
        size = max(1.0, np.abs(wanted[finite]).max(initial=0.0))
        np.testing.assert_allclose(np.where(finite, found, 0), np.where(finite, wanted, 0), rtol=0, atol=1e-9 * size)


@pytest.mark.parametrize("name", FILTERS)
@given(problem=problems())
@settings(phases=[Phase.generate], max_examples=3)
def test_perfect_measurements_are_the_limit_of_good_ones(name, problem):
    """R = 0 is what R → 0 tends to."""
    model, z = problem
    if name.endswith(("information", "srif", "extended_array")):
        pytest.skip("forms of information have no perfect measurements")
    if model.m > model.n:
        return
    good, perfect = (FILTERS[name](replace(model, R=r * np.eye(model.m)), z) for r in (1e-11, 0.0))
    for letter in ("x", "P") if name == "smooth" else ("x_plus", "P_plus"):
        a, b = getattr(good, letter), getattr(perfect, letter)
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-5 * max(1.0, np.abs(a).max()))


@given(problem=problems())
@settings(phases=[Phase.generate], max_examples=8)
def test_the_steady_state_is_where_the_recursion_goes(problem):
    """N steps at once: from P⁻ of the limit a step leads to itself, and from P0 the steps lead there."""
    model, _z = problem
    limit = steady.solve(model)
    again = covariances(replace(model, P0=limit.P_plus), 1, algorithm="filterpy")
    sd = np.sqrt(np.diag(limit.P_minus))
    assert (np.abs(again.P_minus[1] - limit.P_minus) / np.outer(sd, sd)).max() < 1e-11
    far = covariances(model, 40 * STEPS, algorithm="filterpy")
    assert (np.abs(far.P_minus[-1] - limit.P_minus) / np.outer(sd, sd)).max() < 1e-9
