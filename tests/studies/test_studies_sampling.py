"""The check of a discretisation: it passes for what is right and fails for 1 % in the smallest part."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ctlabs.models import ContinuousModel, DiscreteModel
from ctlabs.models.discretisation import discretise
from ctlabs.reporting.report import Report
from ctlabs.studies import common, sampling
from tests import cases, reference
from tests.linalg.test_exponential import EPS, SMALL, model_over_decades, terms


def verdicts(continuous: ContinuousModel, discrete: DiscreteModel) -> list[bool]:
    """Whether the checks of Φ and of Qd pass."""
    report = Report({"name": "x", "title": "x", "source": "x", "parts": ["a"]}, common.Settings(()), 0, 0)
    report.section("a", "a")
    sampling.check(report, continuous, discrete)
    return [check.passed for check in report.checks]


def answer(model: ContinuousModel, dt: float, **broken: Any) -> DiscreteModel:
    return replace(discretise(model, dt, R=np.eye(model.m)), **broken)


@pytest.mark.parametrize("case", cases.numerics("k5_discretise_chain") + cases.numerics("k5_transition_matrix"))
def test_the_smallest_element_is_checked(case: cases.Case) -> None:
    """Right passes, 1 % in Qd[0][0] and 5 % in Φ[0][7] fail."""
    model: Any = cases.model(case["model"])
    dt = case["given"]["dt"]
    good = answer(model, dt)
    assert verdicts(model, good) == [True, True]

    def filled(given: dict[str, Any]) -> dict[str, Any]:
        if "Qd" in given:
            return {"Qd": given["Qd"]}
        return {"Phi": np.vstack([given["Phi_first_row"], good.Phi[1:]])}

    assert verdicts(model, answer(model, dt, **filled(case["right"]))) == [True, True]
    for broken in case["broken"]:
        assert verdicts(model, answer(model, dt, **filled(broken))) == ["Qd" in broken, "Qd" not in broken]


@pytest.mark.parametrize("seed", range(12))
def test_one_per_cent_in_any_element_is_noticed(seed: int) -> None:
    """Of random models over twelve decades, unless the element is the rounding of its own terms; zeros are to be zeros."""
    rng = np.random.default_rng(seed)
    F, W, h = model_over_decades(rng)
    n = len(F)
    model = ContinuousModel(F, np.eye(n), W, np.eye(1, n), P0=np.eye(n))
    good, own = answer(model, h), terms(F, W, h)
    assert verdicts(model, good) == [True, True]
    for place, name in enumerate(("Phi", "Qd")):
        right, size = getattr(good, name), own[place]
        for i in range(n):
            for j in range(n):
                if size[i, j] < SMALL or 0 < abs(right[i, j]) < 1e-4 * size[i, j]:
                    continue
                changed = np.array(right)
                changed[i, j] *= 1.01
                # Unchecked: 1 % may make a covariance of rank 1 indefinite.
                wrong: Any = SimpleNamespace(**{"Phi": good.Phi, "Qd": good.Qd, "dt": h, name: changed})
                assert verdicts(model, wrong)[place] is False


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize("seed", range(6))
def test_the_second_route_is_as_good_as_what_it_judges(seed: int, exact: bool) -> None:
    """The series in integers has every digit; that in doubles what SOLVER asks, to |λ|h = 1e3."""
    F, W, h = model_over_decades(np.random.default_rng(100 + seed))
    speed = 1 + np.abs(np.linalg.eigvals(F)).max() * h
    limit = 4 * EPS if exact else 64 * len(F) * EPS * speed
    found, right = sampling.series(F, W, h, exact=exact), reference.interval(F, W, h)
    for part, expected, own in zip(found, right, terms(F, W, h), strict=False):
        assert (np.abs(part - expected) <= limit * (np.abs(expected) if exact else own) + SMALL).all()


def test_larger_models_are_summed_in_doubles() -> None:
    """Twenty integrators: 1 % in the smallest element is noticed there too."""
    model = ContinuousModel(np.eye(20, k=1), np.eye(20)[:, -1:], [[1.0]], np.eye(1, 20), P0=np.eye(20))
    good = answer(model, 0.1)
    assert verdicts(model, good) == [True, True]
    wrong = np.array(good.Phi)
    wrong[0, -1] *= 1.01
    assert verdicts(model, replace(good, Phi=wrong)) == [False, True]
    extra = np.array(good.Phi)
    extra[-1, 0] = 1e-200
    assert verdicts(model, replace(good, Phi=extra)) == [False, True]
