"""Trade-offs: what less noise in the state costs in inputs, and what a longer period costs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models.cost import Cost
from ctlabs.models.linear import ContinuousModel, DiscreteModel
from ctlabs.regulation.continuous import ContinuousRegulator
from ctlabs.regulation.design import Regulator
from ctlabs.regulation.synthesis import regulator


@dataclass(frozen=True, slots=True, eq=False)
class Tradeoff:
    """Regulators of other weights.

    ``values`` (k,), of what was varied · ``x_rms`` (k, n), ``u_rms`` (k, r), limits · ``cost`` (k,) · ``members``
    """

    values: Array
    x_rms: Array
    u_rms: Array
    cost: Array
    members: tuple[Regulator | ContinuousRegulator, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Periods:
    """Regulators of other periods: ``values`` (k,), the periods, s · ``cost`` (k,), per second · ``members``."""

    values: Array
    cost: Array
    members: tuple[Regulator, ...]


def tradeoff(model: ContinuousModel | DiscreteModel, cost: Cost, factors: ArrayLike, **options: Any) -> Tradeoff:
    r"""σ of the states against σ of the inputs as the inputs' weight changes: Qu and the cross weight √ with it.

    .. math:: Q_u \leftarrow \rho Q_u, \qquad N \leftarrow \sqrt\rho N

    Parameters
    ----------
    factors : ρ > 0
    options : as for :func:`ctlabs.regulator`

    >>> plant = DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[1]], B=[[1]])
    >>> tradeoff(plant, Cost([[1]], [[1]]), [0.1, 1, 10]).u_rms.ravel().round(3)
    array([0.919, 0.669, 0.395])
    """
    rho = _positive("factors", factors)

    def member(factor: float) -> Regulator | ContinuousRegulator:
        N = None if cost.N is None else np.sqrt(factor) * cost.N
        return regulator(model, replace(cost, Qu=factor * cost.Qu, N=N), **options)

    members = tuple(member(factor) for factor in rho.tolist())
    limits = [each.closed.steady() for each in members]
    x, u = np.array([each.x.rms for each in limits]), np.array([each.u.rms for each in limits])
    return Tradeoff(rho, x, u, np.array([each.cost.value for each in members]), members)


def periods(model: ContinuousModel, cost: Cost, dt: ArrayLike, **options: Any) -> Periods:
    """The cost per second against the period, what happens between the samples included.

    Parameters
    ----------
    dt : periods, s
    options : as for :func:`ctlabs.regulator`; without R the samples' covariance is Rc/dt

    >>> walk = ContinuousModel([[0]], [[1]], [[1]], [[1]], B=[[1]], P0=[[1]])
    >>> periods(walk, Cost([[1]], [[0]]), [0.5, 1.0], R=[[0]]).cost.round(6)
    array([0.394338, 0.788675])
    """
    values = _positive("dt", dt)
    members = tuple(regulator(model, cost, dt=h, **options) for h in values.tolist())
    return Periods(values, np.array([each.cost.value for each in members]), members)


def _positive(name: str, values: ArrayLike) -> Array:
    found = checks.shaped(name, values, ("k",))
    if not (found > 0).all():
        msg = f"{name}: expected numbers > 0, received {found.tolist()}"
        raise ValueError(msg)
    return found
