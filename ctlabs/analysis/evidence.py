"""What measurements see of a model, and what its noises reach."""

from __future__ import annotations

from typing import Any

import numpy as np

from ctlabs.linalg import checks
from ctlabs.linalg.factors import factor
from ctlabs.models.linear import ContinuousModel, DiscreteModel
from ctlabs.models.observability import Observability, SamplingLoss, analyse, loss_by_sampling


def observability(model: ContinuousModel | DiscreteModel, dt: float | None = None) -> Observability | SamplingLoss:
    """Which modes the measurements see, how well, and by name those they do not; with ``dt``, what sampling loses of them.

    Parameters
    ----------
    model : constant
    dt : period, s, of sampling a ContinuousModel

    Source: the pencil of Popov, Belevitch and Hautus; see :mod:`ctlabs.models.observability`.

    >>> track = ContinuousModel(F=[[0, 1], [0, 0]], G=[[0], [1]], Q=[[1]], H=[[0, 1]], P0=np.eye(2), states=["x", "v"])
    >>> observability(track).unobservable_modes
    ('eigenvalue 0 of the states x',)
    """
    if dt is None:
        return analyse(model)
    checks.instance("model", model, ContinuousModel)
    assert isinstance(model, ContinuousModel)
    return loss_by_sampling(model, dt)


def reachability(model: ContinuousModel | DiscreteModel) -> Observability:
    """Which modes the noises w reach: the observability of the dual system, whose names say what is not *reached*.

    >>> track = ContinuousModel(F=[[0, 1], [0, 0]], G=[[1], [0]], Q=[[1]], H=[[1, 0]], P0=np.eye(2), states=["x", "v"])
    >>> reachability(track).unobservable_modes
    ('eigenvalue 0 of the states v',)
    """
    n = model.n
    names: dict[str, Any] = {"states": model.states, "P0": np.eye(n)}
    if isinstance(model, ContinuousModel):
        return analyse(ContinuousModel(model.F.T, np.eye(n), np.zeros((n, n)), (model.G @ factor(model.Q)).T, **names))
    if model.horizon is not None:
        msg = f"model: expected constant matrices, received some that vary over {model.horizon} steps"
        raise ValueError(msg)
    root = factor(model.Qd).T
    return analyse(DiscreteModel(model.Phi.T, np.zeros((n, n)), root, np.eye(n), **names))
