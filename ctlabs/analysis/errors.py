"""The true errors of a filter, and where they come from: over time, or in the steady state."""

from __future__ import annotations

from typing import Any, overload

from ctlabs.analysis import budgets, sensitivity
from ctlabs.analysis.budgets import Budget
from ctlabs.analysis.sensitivity import Actual, ActualSteady
from ctlabs.models.linear import DiscreteModel


@overload
def actual_errors(truth: DiscreteModel, design: DiscreteModel, steps: None = None, **options: Any) -> ActualSteady: ...
@overload
def actual_errors(truth: DiscreteModel, design: DiscreteModel, steps: int, **options: Any) -> Actual: ...
def actual_errors(truth: DiscreteModel, design: DiscreteModel, steps: int | None = None, **options: Any) -> Actual | ActualSteady:
    """True bias and covariance of the filter of ``design`` where the data come from ``truth``.

    Parameters
    ----------
    truth, design : discrete models of the same measurements
    steps : over so many periods (:func:`ctlabs.analysis.sensitivity.actual`); ``None``: the limits
        (:func:`ctlabs.analysis.sensitivity.steady`)
    options : compare, and gains, first (over time) or K (the limits), as there

    >>> truth = DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[10]], offset=[1])
    >>> forgets = DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[10]])
    >>> actual_errors(truth, forgets).bias_plus.round(6)
    array([-0.618034])
    """
    return sensitivity.steady(truth, design, **options) if steps is None else sensitivity.actual(truth, design, steps, **options)


def error_budget(model: DiscreteModel, steps: int | None = None, **options: Any) -> Budget:
    """The error covariance of a filter by source: initial uncertainty, process noises, measurement noises.

    Parameters
    ----------
    model : the truth
    steps : over so many periods (:func:`ctlabs.analysis.budgets.budget`); ``None``: the one row of the result is
        the steady state (:func:`ctlabs.analysis.budgets.steady_budget`)
    options : design, groups, compare, and over time gains, first

    >>> walk = DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[10]], states=["x"], measurements=["z"])
    >>> [(name, round(variance, 6)) for name, variance in error_budget(walk).table()]
    [('noise on x', 0.17082), ('noise of z', 0.447214), ('total', 0.618034)]
    """
    return budgets.steady_budget(model, **options) if steps is None else budgets.budget(model, steps, **options)
