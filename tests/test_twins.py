"""Every verb beside its twin in ball arithmetic on random models: how far off, what it says of that, what it refuses.

``--twins N`` asks about N models for each of four seeds (2500 make the 10⁴ of a release); ``-s`` shows the table.
"""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest
from flint import arb, ctx

from ctlabs.filtering import smooth
from ctlabs.models import DiscreteModel
from tests import reference, twin_smoother, twins

pytestmark = pytest.mark.numerical

SEEDS = (11, 12, 13, 14)
#: Of so many solvable models one may be refused.
REFUSED = 1000


def table(verb: str, found: list[twins.Outcome]) -> str:
    """The row of a verb: models, refused, beyond doubles, above 1e-6 unsaid, the worst, median of bound over error."""
    solved = [one for one in found if not one.refused]
    worst = max((one.off for one in solved), default=0.0)
    ratio = np.median([one.bound / max(one.off, 1e-17) for one in solved]) if solved else np.nan
    refused, beyond, unsaid = (sum(map(bool, flags)) for flags in zip(*((o.refused, o.beyond, o.unsaid) for o in found), strict=True))
    return f"{verb:15} {len(found):6} {refused:5} {beyond:5} {unsaid:5} {worst:9.1e} {ratio:7.1f}"


@pytest.mark.parametrize("verb", twins.VERBS)
def test_no_verb_differs_from_its_twin_without_saying_so(verb: str, request: pytest.FixtureRequest) -> None:
    """Within 1e-6 σ, within the bound that is given, which is rarely above a thousand times the error; refused is nothing solvable."""
    count = request.config.getoption("--twins")
    models = [[seed, i] for i in range(count) for seed in SEEDS]
    found = [twins.VERBS[verb](model) for model in models]
    print("\n" + table(verb, found))
    assert [model for model, one in zip(models, found, strict=True) if one.unsaid] == []
    assert [model for model, one in zip(models, found, strict=True) if one.bound < one.off] == []
    bounds = [one.bound / max(one.off, 1e-17) for one in found if np.isfinite(one.bound)]
    assert not bounds or np.median(bounds) < 1e3
    assert REFUSED * sum(bool(one.refused) for one in found) <= len(found)


# --- the twins themselves, beside others written apart -----------------------------------------------------------------


def model(**changes: Any) -> DiscreteModel:
    """Two states, correlated noises, gaps."""
    given: dict[str, Any] = {"Phi": [[1, 0.5], [-0.2, 0.8]], "Qd": [[0.5, 0.1], [0.1, 0.3]], "H": [[1, 0], [1, -2]]}
    given |= {"R": [[0.4, 0.1], [0.1, 2.0]], "x0": [1, -1], "P0": [[2, 0.3], [0.3, 1]], "N": [[0.1, 0.0], [0.05, 0.1]]}
    return DiscreteModel(**(given | changes))


def test_the_record_s_twin_is_the_joint_gaussian_conditioned() -> None:
    """Against 400 digits without a recursion, from a known and from an unknown start."""
    z = np.array([[np.nan, np.nan], [0.3, -1.0], [1.1, np.nan], [np.nan, np.nan], [-0.4, 2.0], [0.1, 0.2]])
    for P0 in ([[2, 0.3], [0.3, 1]], [[np.inf, 0], [0, 1]]):
        right, found = twin_smoother.conditioned(model(P0=P0), z), twins.filtered(model(P0=P0), z)
        for k in range(len(z)):
            assert reference.close(twins.floats(found.x[k])[:, 0], right.x[k], 1e-15)
            assert reference.close(twins.floats(found.P[k]), right.P[k], 1e-15)
            if k:
                lag = found.lag_one[k]
                assert lag is not None
                assert reference.close(twins.floats(lag), right.lag_one[k], 1e-15)
    assert float(twins.filtered(model(), z).log_likelihood) == pytest.approx(reference.log_likelihood(model(), z), rel=1e-14)


def test_the_sampled_twin_is_the_exponential_in_integers() -> None:
    """A stiff system, over a long step."""
    F, W = np.array([[-1e3, 1.0], [2.0, -1e-3]]), np.array([[1.0, 0.1], [0.1, 1e-6]])
    Phi, Qd, _ = reference.interval(F, W, 3.0)
    found = twins.sampled(F, W, 3.0)
    assert reference.close(twins.floats(found.Phi), Phi, 1e-15)
    assert reference.close(twins.floats(found.Qd), Qd, 1e-15)


def test_the_riccati_twin_solves_its_equation() -> None:
    """P = ΦPΦᵀ + Qd − VS⁻¹Vᵀ to a hundred digits, by numbers of mpmath."""
    here = model()
    P = twins.riccati(here.Phi, here.H, here.Qd, here.R, here.N, continuous=False)
    with mpmath.workdps(60), ctx.workprec(400):
        digits = np.array([mpmath.mpf(v.mid().str(60, radius=False)) for v in P.entries()], dtype=object).reshape(2, 2)
        Phi, H, Qd, R, N = map(twins.exact, (here.Phi, here.H, here.Qd, here.R, here.N))
        V, S = Phi @ digits @ H.T + N, H @ digits @ H.T + R
        inverse = np.array([[S[1, 1], -S[0, 1]], [-S[1, 0], S[0, 0]]], dtype=object) / (S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0])
        assert np.abs(Phi @ digits @ Phi.T + Qd - V @ inverse @ V.T - digits).max() < 1e-50


def test_a_wrong_answer_is_told_from_a_right_one() -> None:
    """A change of 1e-9 of the smallest variance is 1e-9 to the comparison, and an estimate's rounding is none."""
    P = np.diag([1e12, 1e-12])
    assert twins.off(P, twins.balls(P)) == 0
    assert twins.off(P * [[1, 1], [1, 1 + 1e-9]], twins.balls(P)) == pytest.approx(1e-9, rel=1e-6)
    x = np.array([3e6, 2e-6])
    assert twins.off_estimate(x + np.array([0, 1e-12]), twins.balls(x), twins.balls(P)) == pytest.approx(1e-6, rel=1e-3)
    with ctx.workprec(200):
        third = twins.balls(np.ones((1, 1))) / arb(3)
    assert twins.off_estimate(np.array([1 / 3]), third, twins.balls(np.full((1, 1), 1e-40))) == 0
    right, terms, scale = (twins.balls(x), twins.balls(P)), np.zeros(2), np.array([1.0, 1e-10])
    assert twins.within_rounding(x, P, *right, terms, scale) == (0, 0)
    assert twins.within_rounding(x, P * [[1, 1], [1, 1.01]], *right, terms, scale)[1] == pytest.approx(1e-2)
    assert twins.within_rounding(x, P + np.array([[0, 0.01], [0.01, 0]]), *right, terms, scale)[1] == pytest.approx(1e-2)
    assert twins.within_rounding(x + np.array([0, 1e-8]), P, *right, terms, scale)[0] == pytest.approx(1e-2)
    assert twins.within_rounding(x + np.array([0, 1e-8]), P, *right, np.array([0, 2e-8]), scale)[0] == 0
    assert twins.within_rounding(x, np.diag([1e12, np.inf]), *right, terms, scale) == (np.inf, np.inf)
    assert twins.Outcome(1e-5).unsaid
    assert not twins.Outcome(1e-5, 1e-4).unsaid
    assert twins.Outcome(1e-3, 1e-4).unsaid


@pytest.mark.parametrize("seed", [[11, 53], [13, 377], [12, 612]])
def test_a_way_back_that_loses_digits_says_so(seed: list[int]) -> None:
    """From a vague start, along directions that hardly a measurement tells of: another rounding shows it."""
    here = twins.discrete(seed)
    assert smooth(here, twins.data(here, seed)[1:]).remarks[0].startswith("in other units of the states the smoothed estimates")


@pytest.mark.parametrize(
    ("verb", "seed"),
    [
        ("smooth", [14, 38]),  # a mode of 1e-144, whose squares underflow
        ("smooth", [11, 46]),
        ("smooth", [2, 295]),
        ("smooth", [2, 9]),
        ("filter_record", [13, 149]),  # eight states of which one sensor leaves directions of 1e-10
        ("filter_record", [14, 1402]),
        ("steady.solve", [12, 187]),  # the loop is stable to rounding of P alone: corrections halve long before they square
        ("steady.solve", [14, 332]),
        ("steady.solve", [12, 60]),  # Φ − NR⁻¹H has lost Φ
        ("steady.solve", [12, 905]),
    ],
)
def test_models_that_were_wrong_once(verb: str, seed: list[int]) -> None:
    """What the 10⁴ models found stays found."""
    found = twins.VERBS[verb](seed)
    assert not found.refused
    assert found.off < 1e-9


@pytest.mark.parametrize("seed", [[14, 448], [13, 1221]])
def test_a_chain_that_is_seen_by_a_hair_has_its_limit(seed: list[int]) -> None:
    """Integrators whose measurement nearly vanishes along one exponential: in scaled matrices 1e-13 of it is left, which is enough."""
    found = twins.steady_continuous(seed)
    assert not found.refused
    assert found.off < 1e-12
