"""The limit of a filter, for either kind of time."""

from __future__ import annotations

from typing import overload

from ctlabs.filtering import bucy, steady
from ctlabs.models.linear import ContinuousModel, DiscreteModel


@overload
def steady_state(model: DiscreteModel) -> steady.SteadyState: ...
@overload
def steady_state(model: ContinuousModel) -> bucy.BucySteadyState: ...
def steady_state(model: DiscreteModel | ContinuousModel) -> steady.SteadyState | bucy.BucySteadyState:
    """The steady state of the optimal filter of a constant model.

    Of a DiscreteModel ``P_minus``, ``P_plus``, ``K``, ``K_pred``, ``S``, ``poles`` (:func:`ctlabs.filtering.steady.solve`); of a
    ContinuousModel ``P``, ``K``, ``poles`` of the Kalman–Bucy filter (:func:`ctlabs.filtering.bucy.steady`); and ``error``, a
    bound of the error of the covariances in units of the standard deviations that they give.

    Raises
    ------
    TypeError
        Another kind of model.
    ValueError
        There is no limit, or it depends on P0, or it cannot be computed to 1e-6: the message says why.

    >>> walk = ContinuousModel(F=[[0]], G=[[1]], Q=[[4]], H=[[1]], Rc=[[16]], P0=[[25]])
    >>> steady_state(walk).P
    array([[8.]])
    """
    if isinstance(model, ContinuousModel):
        return bucy.steady(model)
    if isinstance(model, DiscreteModel):
        return steady.solve(model)
    msg = f"model: expected a DiscreteModel or a ContinuousModel, received a {type(model).__name__}"
    raise TypeError(msg)
