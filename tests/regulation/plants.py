"""Plants and costs of the regulator's tests."""

from __future__ import annotations

from typing import Any

import numpy as np

from ctlabs import ContinuousModel, Cost, DiscreteModel
from tests.strategies import covariance

#: The DC motor of the acceptance values: position measured, voltage in.
MOTOR = ContinuousModel(
    [[0, 1], [0, -1]], [[0], [1]], [[1]], [[1, 0]], Rc=[[0.01]], B=[[0], [1]], P0=np.eye(2), states=["place", "speed"],
    measurements=["place"],
)  # fmt: skip
MOTOR_COST = Cost(np.diag([1.1, 0.3]), [[0.7]])
#: ẋ = u + w, the state measured exactly.
INTEGRATOR = ContinuousModel([[0]], [[1]], [[1]], [[1]], B=[[1]], P0=[[1]])


def discrete(seed: int, *, offset: bool = False, through: bool = False) -> tuple[DiscreteModel, Cost]:
    """A random plant with correlated noises, perhaps unstable, and a cost with a cross term."""
    rng = np.random.default_rng(seed)
    n, m, r = (int(rng.integers(1, high)) for high in (5, 3, 3))
    Phi = rng.normal(size=(n, n))
    Phi *= 1.1 / max(1.0, np.abs(np.linalg.eigvals(Phi)).max())
    joint, weights = covariance(rng, n + m), covariance(rng, n + r)
    extra: dict[str, Any] = {"offset": rng.normal(size=n)} if offset else {}
    extra |= {"D": rng.normal(size=(m, r))} if through else {}
    model = DiscreteModel(
        Phi, joint[:n, :n], rng.normal(size=(m, n)), joint[n:, n:], N=joint[:n, n:], B=rng.normal(size=(n, r)), P0=covariance(rng, n),
        x0=rng.normal(size=n), **extra,
    )  # fmt: skip
    return model, Cost(weights[:n, :n], weights[n:, n:], weights[:n, n:])


def continuous(seed: int) -> tuple[ContinuousModel, Cost]:
    """A random continuous plant with correlated noises and a cost with a cross term."""
    rng = np.random.default_rng(seed)
    n, m, r = (int(rng.integers(1, high)) for high in (5, 3, 3))
    F = rng.normal(size=(n, n))
    joint, weights = covariance(rng, n + m), covariance(rng, n + r)
    model = ContinuousModel(
        F, np.eye(n), joint[:n, :n], rng.normal(size=(m, n)), Rc=joint[n:, n:], N=joint[:n, n:], B=rng.normal(size=(n, r)),
        P0=covariance(rng, n), x0=rng.normal(size=n),
    )  # fmt: skip
    return model, Cost(weights[:n, :n], weights[n:, n:], weights[:n, n:])
