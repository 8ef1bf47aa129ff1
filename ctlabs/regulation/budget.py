r"""Where the cost of a loop comes from: by source of noise, by weight, by what is not known.

The cost is linear in the covariances of the noises. With Z, what a unit of the loop's state :math:`s = (x, \xi)` will cost,

.. math:: Z = A^TZA + Y^TQY, \qquad J = \sum_{sources}\mathrm{tr}\,Z\,W_{source} + \mathrm{tr}\,D^TQ_{uu}D\,R_{source}

(A moves s, Y gives what is weighed), every source has its share by one equation, and their sum is a route to J of its own: it
uses neither the covariance of the loop nor the separation theorem.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from ctlabs.analysis.sources import Source, components, noise_by_input, sources
from ctlabs.linalg import checks, riccati
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import symmetric
from ctlabs.models.linear import derived, input_names
from ctlabs.regulation.augmented import weighed
from ctlabs.regulation.closed import inner_loop, weighed_rows
from ctlabs.regulation.continuous import ContinuousRegulator, rows_weighed
from ctlabs.regulation.design import Regulator, about_loads, picked


@dataclass(frozen=True, slots=True, eq=False)
class CostBudget:
    """The cost of a loop in parts.

    ``sources``, name → share of each independent source of noise · ``weights``, name → share of each state, integral and input that the
    cost weighs, a cross term half to each · ``unknown``, what not knowing the state costs · ``known``, what the disturbances would cost
    a regulator that knows it · ``between``, what noise adds between the samples, whatever the regulator does · ``total`` · ``per``
    """

    sources: dict[str, float]
    weights: dict[str, float]
    unknown: float
    known: float
    between: float
    total: float
    per: str

    def table(self) -> list[list[str | float]]:
        """Rows (source, share), and the total."""
        rows: list[list[str | float]] = [[name, value] for name, value in self.sources.items()]
        if self.between:
            rows.append(["between the samples", self.between])
        return [*rows, ["total", self.total]]


def cost_budget(regulator: Regulator | ContinuousRegulator) -> CostBudget:
    """The cost of a steady regulator by source, by weight, and by what is not known.

    Raises
    ------
    ValueError
        Scheduled gains.

    Source: Åström, *Introduction to Stochastic Control Theory* (1970), section 8.6, for the two parts.

    >>> from ctlabs import Cost, DiscreteModel, regulator
    >>> plant = DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[1]], B=[[1]], states=["x"], measurements=["z"])
    >>> budget = cost_budget(regulator(plant, Cost([[1]], [[1]])))
    >>> {name: round(value, 4) for name, value in budget.sources.items()}, round(budget.total, 4)
    ({'noise on x': 1.7889, 'noise of z': 0.4472}, 2.2361)
    """
    if isinstance(regulator, ContinuousRegulator):
        return _continuous(regulator)
    checks.instance("regulator", regulator, Regulator)
    if regulator.steps is not None:
        msg = "cost budget: expected a steady regulator, received one with scheduled gains"
        raise ValueError(msg)
    truth, M = regulator.plant, regulator.machine
    unit = regulator.unit
    q = regulator.design.n - truth.n
    A, rows, n = inner_loop(truth, M), weighed_rows(truth, M, q), truth.n
    to, kept = about_loads(n, len(M.xi0), regulator.loads, regulator.target)
    back = np.linalg.inv(to)[:, kept]
    to, rows = to[kept], rows @ back
    A, joint = to @ A @ back, regulator.weights.joint
    Z = riccati.stationary(A.T, rows.T @ joint @ rows, continuous=False).P.high
    assert truth.B is not None
    # Disturbances move x, the measurement's noise moves x through the input, and ξ.
    pushed, into = to[:, :n], to @ np.vstack([truth.B @ M.D, M.B])
    direct = M.D.T @ regulator.weights.Qu @ M.D
    found, whole, noise = {}, np.zeros_like(Z), np.zeros((truth.m, truth.m))
    for name, s in _by_source(regulator).items():
        R = np.where(np.isfinite(s.R), s.R, 0.0)
        cross = pushed @ s.N @ into.T
        W = pushed @ s.Qd @ pushed.T + into @ R @ into.T + cross + cross.T
        found[name] = unit * (float((Z * W).sum()) + float((direct * R).sum()))
        whole, noise = whole + W, noise + R
    P = riccati.stationary(A, symmetric(whole), continuous=False).P.high
    second = rows @ P @ rows.T
    second[n + q :, n + q :] += M.D @ noise @ M.D.T
    if not regulator.loads:
        y = scipy.linalg.block_diag(picked(n, len(M.xi0), q), np.eye(truth.r)) @ regulator.closed.steady().joint.mean
        second += np.outer(y, y)
    if regulator.cost.offset:
        found["known offset"] = regulator.cost.offset
    names = (*regulator.design.states, *input_names(truth.r))
    return _budget(regulator, found, unit * (joint * second).sum(axis=1), names)


def _budget(regulator: Regulator | ContinuousRegulator, found: dict[str, float], by_weight: Array, names: tuple[str, ...]) -> CostBudget:
    cost = regulator.cost
    shares = {name: float(value) for name, value in zip(names, by_weight, strict=True) if value}
    return CostBudget(found, shares, cost.estimation, cost.regulation, cost.between, cost.value, cost.per)


def _by_source(regulator: Regulator) -> dict[str, Source]:
    """The sources; of a sampled plant by the inputs of its continuous noise, unless they correlate with the measurements."""
    truth = regulator.plant
    model = derived(truth, P0=np.zeros((truth.n, truth.n)))
    given = regulator.sampling
    if given is None or (truth.N is not None and truth.N.any()):
        return sources(model, None)
    parts = {name: weighed(part, truth.n - len(part)) for name, part in noise_by_input(given.model, truth.dt).items()}
    return sources(model, parts)


def _continuous(regulator: ContinuousRegulator) -> CostBudget:
    """The budget of a continuous regulator: each independent group of the noises w and v."""
    loop, truth = regulator.closed, regulator.plant
    to, kept = about_loads(truth.n, loop.model.n - truth.n, regulator.loads, regulator.target, regulator.follows)
    back = np.linalg.inv(to)[:, kept]
    F, G, Q = to[kept] @ loop.model.F @ back, to[kept] @ loop.model.G, loop.model.Q
    rows, joint = rows_weighed(loop, regulator.design.n - truth.n) @ back, regulator.weights.joint
    Z = riccati.stationary(F.T, rows.T @ joint @ rows, continuous=True).P.high
    names = [f"noise w{i + 1}" for i in range(truth.s)] + [f"noise of {name}" for name in truth.measurements]
    found: dict[str, float] = {}
    for group in components(Q):
        part = np.zeros_like(Q)
        part[np.ix_(group, group)] = Q[np.ix_(group, group)]
        share = float((Z * (G @ part @ G.T)).sum())
        if share:
            found[" and ".join(names[i] for i in group)] = share
    second = rows @ riccati.stationary(F, symmetric(G @ Q @ G.T), continuous=True).P.high @ rows.T
    return _budget(regulator, found, (joint * second).sum(axis=1), (*regulator.design.states, *input_names(truth.r)))
