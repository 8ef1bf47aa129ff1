"""What is random in a model, as independent sources: initial state, process noise, measurement noise."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import scipy.sparse.csgraph
from numpy.typing import ArrayLike

from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models import ContinuousModel, DiscreteModel
from ctlabs.models.discretisation import interval


class Source(NamedTuple):
    """Independent random quantities: initial covariance, and noises (constant or per step)."""

    P0: Array
    Qd: Array
    R: Array
    N: Array


def everything(model: DiscreteModel) -> Source:
    """Everything that is random in a model, as one source; of what is not measured (R = ∞) nothing."""
    N = np.zeros((model.n, model.m)) if model.N is None else model.N
    return Source(model.P0, model.Qd, np.where(np.isfinite(model.R), model.R, 0.0), N)


def sources(model: DiscreteModel, groups: Mapping[str, ArrayLike] | None) -> dict[str, Source]:
    """Independent sources by name, in the order initial state, process noise, measurement noise."""
    checks.finite_start("an error budget", model.P0)
    n, m, whole = model.n, model.m, everything(model)
    nothing = Source(np.zeros((n, n)), np.zeros((n, n)), np.zeros((m, m)), np.zeros((n, m)))
    found: dict[str, Source] = {}

    def add(name: str, source: Source) -> None:
        if any(part.any() for part in source):
            found[name if name not in found else f"{name} ({len(found) + 1})"] = source

    for group in components(model.P0):
        add("initial " + ", ".join(model.states[i] for i in group), nothing._replace(P0=_block(model.P0, group, group)))
    for name, part in ({} if groups is None else _given(model, groups)).items():
        add(name, nothing._replace(Qd=part))
    Qd = np.zeros((n, n)) if groups is not None else whole.Qd
    Q, R = (np.abs(stack).reshape(-1, *stack.shape[-2:]).max(axis=0) for stack in (Qd, whole.R))
    for group in components(np.block([[Q, whole.N], [whole.N.T, R]])):
        w, v = [i for i in group if i < n], [i - n for i in group if i >= n]
        names = ["on " + ", ".join(model.states[i] for i in w)] if w else []
        names += ["of " + ", ".join(model.measurements[i] for i in v)] if v else []
        source = nothing._replace(Qd=_block(Qd, w, w), R=_block(whole.R, v, v), N=_block(whole.N, w, v))
        add("noise " + " and ".join(names), source)
    return found


def noise_by_input(model: ContinuousModel, dt: float) -> dict[str, Array]:
    """The parts of Qd that come from each noise input of a continuous model: ``groups`` for :func:`ctlabs.analysis.budgets.budget`.

    Inputs that correlate are one source.

    >>> list(noise_by_input(ContinuousModel([[0]], [[1, 1]], [[1, 0], [0, 2]], [[1]], P0=[[0]]), 1.0).values())
    [array([[1.]]), array([[2.]])]
    """
    checks.instance("model", model, ContinuousModel)
    parts = {}
    for group in components(model.Q):
        G = model.G[:, group]
        name = "noise " + ", ".join(f"w{j + 1}" for j in group)
        parts[name] = interval(model.F, G @ model.Q[np.ix_(group, group)] @ G.T, dt).Qd
    return parts


def components(matrix: Array) -> list[list[int]]:
    """Indices that correlate, directly or through others."""
    count, label = scipy.sparse.csgraph.connected_components(matrix != 0, directed=False)
    return [np.flatnonzero(label == i).tolist() for i in range(count)]


def _given(model: DiscreteModel, groups: Mapping[str, ArrayLike]) -> dict[str, Array]:
    """The user's parts of Qd, checked."""
    n = model.n
    if model.N is not None and model.N.any():
        msg = "groups: expected a model without N (process and measurement noise that correlate are one source)"
        raise ValueError(msg)
    parts = {name: checks.covariance(f"groups[{name}]", part, model.Qd.shape) for name, part in groups.items()}
    missing = np.abs(model.Qd - sum(parts.values(), np.zeros((n, n)))).max()
    if missing > checks.ROUNDING * np.abs(model.Qd).max():
        msg = f"groups: expected parts that add up to Qd, received a sum that differs from it by {missing:.3g}"
        raise ValueError(msg)
    return parts


def _block(matrix: Array, rows: list[int], columns: list[int]) -> Array:
    """``matrix`` (or each of a stack) with everything outside the block set to zero."""
    result = np.zeros_like(matrix)
    i, j = np.ix_(rows, columns)
    result[..., i, j] = matrix[..., i, j]
    return result
