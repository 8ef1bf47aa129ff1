r"""What a regulator costs, on three routes that share no formula.

Separation: :math:`\mathrm{tr}\,SQ_d + \mathrm{tr}\,\tilde Q[L\ L_w]\Pi[L\ L_w]^T` with the joint covariance Π of the errors of state and
disturbance. Innovations: the errors of the estimate cost :math:`\mathrm{tr}\,Q_xP`, and the innovations are the only disturbance of the
estimate, :math:`\mathrm{tr}\,SKS_\nu K^T`. Closed loop: the covariances of (x, u) from a Lyapunov equation, with the weights.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ctlabs.linalg.checks import Array
from ctlabs.models import at
from ctlabs.models.linear import DiscreteModel
from ctlabs.regulation.closed import Signals
from ctlabs.regulation.estimator import Estimator
from ctlabs.regulation.feedback import Feedback


@dataclass(frozen=True, eq=False)
class LoopCost:
    """What a loop costs, and the ways on which that was found.

    ``regulation``, what the disturbances (and over a finite horizon the start) cost a regulator that knows the state · ``estimation``,
    what not knowing it adds · ``offset``, the cost of a known constant load · ``between``, what noise adds between the samples ·
    ``innovations``, the whole from the errors of the estimate and the innovations that move it · ``of_loop``, what computes the whole
    per step or horizon from the closed loop, and ``unit``, by which that is multiplied · ``per`` : ``"s"``, ``"step"`` or
    ``"horizon"``, to which the numbers refer
    """

    regulation: float
    estimation: float
    offset: float
    between: float
    innovations: float
    of_loop: Callable[[], float]
    per: str
    unit: float = 1.0

    @property
    def value(self) -> float:
        """The cost by the separation theorem: the sum of the first four."""
        return self.regulation + self.estimation + self.offset + self.between

    def __float__(self) -> float:
        return self.value

    @cached_property
    def closed_loop(self) -> float:
        """The whole from the covariances of the closed loop, whose equation is solved when this is first asked for."""
        return self.unit * self.of_loop()

    @property
    def routes(self) -> dict[str, float]:
        """The cost on its three routes."""
        return {"separation": self.value, "closed loop": self.closed_loop, "innovations": self.innovations}

    @property
    def spread(self) -> float:
        """The largest difference between two routes, relative."""
        values = list(self.routes.values())
        return (max(values) - min(values)) / max(abs(self.value), np.finfo(float).tiny)

    def scaled(self, factor: float, per: str) -> LoopCost:
        """Per another unit of time."""
        return LoopCost(
            factor * self.regulation,
            factor * self.estimation,
            factor * self.offset,
            factor * self.between,
            factor * self.innovations,
            self.of_loop,
            per,
            factor * self.unit,
        )


class Parts(NamedTuple):
    """Of a cost: regulation, estimation, and the whole by the innovations."""

    regulation: float
    estimation: float
    innovations: float


def trace(*factors: Array) -> float:
    """tr of a product.

    >>> trace(np.eye(2), 2 * np.eye(2))
    4.0
    """
    product = factors[0]
    for each in factors[1:]:
        product = product @ each
    return float(np.trace(product))


def step_cost(design: DiscreteModel, Qx: Array, f: Feedback, e: Estimator, kind: str, k: int) -> Parts:
    """What instant k adds, with the feedback and the estimator of that instant and S of the next."""
    Phi, _, Qd = design.motion(k)
    assert design.B is not None
    B = at(design.B, k, 2)
    S, L, Lw, weight = f.S, f.L, f.L_w, f.weight
    known = trace(S, Qd)
    if kind == "delayed":
        move = Phi @ e.K + e.K_w
        return Parts(known, trace(weight, L, e.P_minus, L.T), trace(Qx, e.P_minus) + trace(S, move, e.S, move.T))
    # The joint covariance of x − x̂⁺ and w − ŵ: what the innovation takes from that of x − x̂⁻ and w.
    both = np.hstack([L, Lw])
    gain = np.vstack([e.K, e.K_w])
    prior = np.block([[e.P_minus, np.zeros_like(Qd)], [np.zeros_like(Qd), Qd]])
    joint = prior - gain @ e.S @ gain.T
    n = len(Phi)
    joint[:n, :n] = e.P_plus
    # tr(SQd) counts the disturbance as if nothing were known of it and no input answered it; Lw answers.
    unknown = trace(weight, both, joint, both.T) - trace(weight, Lw, Qd, Lw.T)
    told = e.K_w @ e.S
    cross = 2 * trace((Phi - B @ L).T, S, told, e.K.T)
    answered = trace(S - Lw.T @ weight @ Lw, told, e.K_w.T)
    return Parts(known, unknown, trace(Qx, e.P_plus) + cross + answered)


def arrival(S: Array, e: Estimator) -> float:
    """What the innovation of one instant costs through the estimate that it moves."""
    return trace(S, e.K, e.S, e.K.T)


def offset_gains(design: DiscreteModel, f: Feedback, steps: int | None) -> tuple[Array, float]:
    r"""The optimal answer to a known constant or scheduled load c, and its cost.

    .. math:: g_k = (\Phi-BL_k)^T(S_{k+1}c_k + g_{k+1}), \qquad f_k = -\tilde Q^{-1}B^T(S_{k+1}c_k + g_{k+1})
    """
    assert design.B is not None
    r, inputs_by = design.r, design.B
    if design.offset is None or not design.offset.any():
        return np.zeros(r if steps is None else (steps, r)), 0.0

    def answer(S: Array, L: Array, weight: Array, c: Array, g: Array, k: int) -> tuple[Array, float, Array]:
        B = at(inputs_by, k, 2)
        push = S @ c + g
        seen = B.T @ push
        u = np.linalg.lstsq(weight, seen, rcond=None)[0]
        return -u, float(c @ S @ c + 2 * g @ c - seen @ u), (design.motion(k)[0] - B @ L).T @ push

    if steps is None:
        c, loop = design.offset, (design.Phi - design.B @ f.L).T
        g = np.linalg.solve(np.eye(design.n) - loop, loop @ f.S @ c)
        u, cost, _ = answer(f.S, f.L, f.weight, c, g, 0)
        return u, cost
    g, inputs, total = np.zeros(design.n), np.empty((steps, r)), 0.0
    for k in range(steps - 1, -1, -1):
        inputs[k], cost, g = answer(f.S[k + 1], f.L[k], f.weight[k], design.motion(k)[1], g, k)
        total += cost
    return inputs, total + 2 * float(g @ design.x0)


def weighed_square(weights: Array, signals: Signals) -> float:
    """E[yᵀQy]."""
    return float((weights * (signals.P + np.outer(signals.mean, signals.mean))).sum())

