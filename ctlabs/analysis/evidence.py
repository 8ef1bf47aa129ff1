"""What measurements see of a model, and what its noises and inputs reach."""

from __future__ import annotations

from typing import Any

import numpy as np

from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.linalg.factors import factor
from ctlabs.models.discretisation import interval
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


def reachability(
    model: ContinuousModel | DiscreteModel, dt: float | None = None, *, by: str = "noises"
) -> Observability | SamplingLoss:
    """Which modes the noises w or the inputs u reach: the observability of the transposed system, whose names say what is not *reached*.

    Parameters
    ----------
    model : constant
    dt : period, s, of sampling a ContinuousModel, whose inputs are then held: what sampling loses
    by : ``"noises"`` or ``"inputs"`` (a model with B)

    Source: Kalman, Ho & Narendra (1963), *Contributions to Differential Equations* 1, 189.

    >>> track = ContinuousModel(F=[[0, 1], [0, 0]], G=[[1], [0]], Q=[[1]], H=[[1, 0]], B=[[0], [1]], P0=np.eye(2), states=["x", "v"])
    >>> reachability(track).unobservable_modes, reachability(track, by="inputs").ok
    (('eigenvalue 0 of the states v',), True)
    """
    if by not in ("noises", "inputs"):
        msg = f'by: expected "noises" or "inputs", received {by!r}'
        raise ValueError(msg)
    if by == "inputs" and model.B is None:
        msg = "model: expected B, how an input moves the states, received none"
        raise ValueError(msg)
    if isinstance(model, DiscreteModel) and model.horizon is not None:
        msg = f"model: expected constant matrices, received some that vary over {model.horizon} steps"
        raise ValueError(msg)
    if dt is not None:
        checks.instance("model", model, ContinuousModel)
    n = model.n
    names: dict[str, Any] = {"states": model.states, "P0": np.eye(n)}
    if isinstance(model, ContinuousModel):
        moves = model.B if by == "inputs" else model.G @ factor(model.Q)
        assert moves is not None
        dual = ContinuousModel(model.F.T, np.eye(n), np.zeros((n, n)), moves.T, **names)
        if dt is None:
            return analyse(dual)
        # A held input moves the samples by Γ(dt)B, white noise by its covariance over a period: not by B itself.
        dt = checks.positive("dt", dt)
        pushed = _held(model.F, moves, dt) if by == "inputs" else factor(interval(model.F, moves @ moves.T, dt).Qd / dt)
        return loss_by_sampling(dual, dt, pushed.T)
    reached = model.B if by == "inputs" else factor(model.Qd)
    assert reached is not None
    return analyse(DiscreteModel(model.Phi.T, np.zeros((n, n)), reached.T, np.eye(reached.shape[1]), **names))


def _held(F: Array, B: Array, dt: float) -> Array:
    """Γ(dt)B/dt, what a held input does in one period, zero where it is the rounding of what it did on the way there."""
    over = interval(F, np.zeros_like(F), dt)
    eighth, way = interval(F, np.zeros_like(F), dt / 8).Phi, [B]
    for _ in range(8):
        way.append(eighth @ way[-1])
    pushed = over.Gamma @ B / dt
    rate = 1 + float(np.abs(np.linalg.eigvals(F)).max(initial=0.0)) * dt
    return np.where(np.abs(pushed) > 16 * np.finfo(float).eps * rate * np.abs(way).max(axis=0), pushed, 0.0)
