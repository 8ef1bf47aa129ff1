"""The error covariance of a filter as a sum over its sources; the gains stay fixed."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.analysis import following, sensitivity
from ctlabs.analysis.sources import sources
from ctlabs.filtering.measured import begins
from ctlabs.filtering.results import Covariances
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel


@dataclass(frozen=True, slots=True, eq=False)
class Budget:
    """The error covariance as a sum over its sources.

    ``t`` (steps+1,) s · ``names``, of the sources · ``parts`` (sources, steps+1, d, d), what each adds to P_plus ·
    ``P_plus`` (steps+1, d, d), the covariance with all sources at work, computed at once and not as the sum ·
    ``states``, of the design
    """

    t: Array
    names: tuple[str, ...]
    parts: Array
    P_plus: Array
    states: tuple[str, ...]

    @property
    def variances(self) -> Array:
        """Contribution to the variance of each state, (sources, steps+1, d)."""
        return np.diagonal(self.parts, axis1=-2, axis2=-1)

    def table(self, k: int = -1) -> list[list[str | float]]:
        """Rows (source, contribution to the variance of each state) at step k; the last row is the total."""
        rows: list[list[str | float]] = [
            [name, *part.tolist()] for name, part in zip(self.names, self.variances[:, k], strict=True)
        ]
        return [*rows, ["total", *np.diag(self.P_plus[k]).tolist()]]


def budget(
    model: DiscreteModel,
    steps: int,
    *,
    design: DiscreteModel | None = None,
    groups: Mapping[str, ArrayLike] | None = None,
    compare: ArrayLike | None = None,
    gains: Covariances | None = None,
    first: int | None = None,
) -> Budget:
    """The error covariance by source: initial uncertainty, process noises, measurement noises. The gains stay fixed.

    Quantities that correlate are one source: without ``groups`` every state's initial value, every state's
    process noise and every measurement's noise is a source of its own unless the model correlates it with another.

    Parameters
    ----------
    model : the truth
    steps : number of periods
    design : the model of the filter, when it is not ``model``
    groups : process noise sources instead: name → part of Qd, (n, n) or (steps, n, n); they must add up to Qd
    compare, gains, first : as for :func:`ctlabs.analysis.sensitivity.actual`

    Raises
    ------
    ValueError
        Groups that do not add up to Qd, or groups beside N ≠ 0; and whatever :func:`ctlabs.analysis.sensitivity.actual` refuses.

    Source: Maybeck vol. 1, section 6.8 (error budget).

    >>> m = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]], states=["x"], measurements=["z"])
    >>> [(name, round(variance, 6)) for name, variance in budget(m, 1).table()]
    [('initial x', 0.069444), ('noise on x', 0.006944), ('noise of z', 0.840278), ('total', 0.916667)]
    """
    design = model if design is None else design
    total = sensitivity.actual(model, design, steps, compare=compare, gains=gains, first=first)
    C, _ = following.pair(model, design, compare, steps)
    plan, used = following.plan(model, design, steps, gains, begins(design, first))
    maps = following.maps(model, design, C, plan.K, used)
    found = sources(model, groups)
    parts = np.array([following.covariances(source, maps, used)[1] for source in found.values()])
    return Budget(plan.t, tuple(found), parts, total.P_plus, design.states)


def steady_budget(
    model: DiscreteModel,
    *,
    design: DiscreteModel | None = None,
    groups: Mapping[str, ArrayLike] | None = None,
    compare: ArrayLike | None = None,
) -> Budget:
    """The limit of :func:`budget`: the result has one row, at t = ∞. What is left of an initial uncertainty is that of constants.

    Raises
    ------
    ValueError
        There is no limit (:func:`ctlabs.analysis.sensitivity.steady`); groups as for :func:`budget`.

    >>> m = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]], states=["x"], measurements=["z"])
    >>> [(name, round(variance, 6)) for name, variance in steady_budget(m).table()]
    [('noise on x', 0.17082), ('noise of z', 0.447214), ('total', 0.618034)]
    """
    design = model if design is None else design
    total = sensitivity.steady(model, design, compare)
    names, parts = [], []
    for name, source in sources(model, groups).items():
        R = np.where(np.isinf(model.R), model.R, source.R)
        alone = dataclasses.replace(
            model, P0=source.P0, Qd=source.Qd, R=R, N=source.N if source.N.any() else None, x0=np.zeros(model.n)
        )
        part = sensitivity.steady(alone, design, compare, K=total.K).P_plus
        if part.any():
            names.append(name)
            parts.append(part[None])
    of_each = np.array(parts).reshape(-1, 1, *total.P_plus.shape)
    return Budget(np.array([np.inf]), tuple(names), of_each, total.P_plus[None], design.states)
