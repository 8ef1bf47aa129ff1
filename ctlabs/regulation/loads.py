"""The feedback of a plant with loads and set points: on what differs from the motion that they ask for."""

from __future__ import annotations

import numpy as np

from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import symmetric
from ctlabs.models.cost import Cost, Weights
from ctlabs.models.linear import ContinuousModel, DiscreteModel
from ctlabs.regulation.feedback import Feedback, lqr
from ctlabs.regulation.targets import Target, check_loads, motion


def moving(model: ContinuousModel | DiscreteModel) -> Array:
    """F or Φ."""
    return model.F if isinstance(model, ContinuousModel) else model.Phi


def still(model: ContinuousModel | DiscreteModel) -> Array:
    """What a constant does in the equation of motion of its own: 0 in continuous time, 1 in discrete time, (1, 1)."""
    return np.zeros((1, 1)) if isinstance(model, ContinuousModel) else np.eye(1)


def loaded(
    model: ContinuousModel | DiscreteModel, w: Weights, places: list[int], C: Array, *, stabilise: bool
) -> tuple[Target, Feedback, Weights]:
    """The motion that each load asks for, the feedback of the whole state, and the weights of what differs from the motion.

    Raises
    ------
    ValueError
        A load that something moves; outputs that the inputs cannot keep free of it; what :func:`ctlabs.regulation.lqr` refuses.
    """
    check_loads(model, places)
    rest = [i for i in range(model.n) if i not in places]
    assert model.B is not None
    A, B, n, r = moving(model), model.B[rest], model.n, model.r
    goal = motion(
        A[np.ix_(rest, rest)], B, C[:, rest], A[np.ix_(rest, places)], C[:, places], A[np.ix_(places, places)], "loads"
    )  # fmt: skip
    own = Cost(w.Qx[np.ix_(rest, rest)], w.Qu, w.N[rest])
    f = lqr(_without(model, rest), own, stabilise=stabilise)
    T, U = np.zeros((len(rest), n)), np.zeros((r, n))
    T[:, rest], T[:, places], U[:, places] = np.eye(len(rest)), -goal.X, goal.U
    # x̃ = Tx and ũ = u − Ux are weighed as x and u were.
    M = np.block([[T, np.zeros((len(rest), r))], [-U, np.eye(r)]])
    joint = np.block([[w.Qx[np.ix_(rest, rest)], w.N[rest]], [w.N[rest].T, w.Qu]])
    whole = symmetric(M.T @ joint @ M)
    about = Weights(whole[:n, :n], whole[n:, n:], whole[:n, n:], np.zeros((n, n)))
    return goal, Feedback(f.L @ T - U, T.T @ f.S @ T, f.L_w @ T, f.weight, f.poles, f.error), about


def _without(model: ContinuousModel | DiscreteModel, rest: list[int]) -> ContinuousModel | DiscreteModel:
    """The plant without its loads, as far as its feedback needs it."""
    names, P0 = [model.states[i] for i in rest], np.eye(len(rest))
    assert model.B is not None
    if isinstance(model, ContinuousModel):
        return ContinuousModel(model.F[np.ix_(rest, rest)], model.G[rest], model.Q, model.H[:, rest], B=model.B[rest], P0=P0, states=names)
    Phi, Qd = model.Phi[np.ix_(rest, rest)], model.Qd[np.ix_(rest, rest)]
    return DiscreteModel(Phi, Qd, model.H[:, rest], model.R, B=model.B[rest], P0=P0, dt=model.dt, states=names)


def forward(model: ContinuousModel | DiscreteModel, f: Feedback, C: Array, places: list[int]) -> tuple[Array, Array]:
    """The inputs per unit of set points, (r, p), and those that keep a known constant from the tracked outputs, (r,)."""
    assert model.B is not None
    rest = [i for i in range(model.n) if i not in places]
    A, B, rows, L = moving(model)[np.ix_(rest, rest)], model.B[rest], C[:, rest], f.L[:, rest]
    p = len(C)
    own = still(model)
    goal = motion(A, B, rows, np.zeros((len(rest), p)), -np.eye(p), np.kron(np.eye(p), own), "set points")
    F = goal.U + L @ goal.X
    if isinstance(model, ContinuousModel) or model.offset is None:
        return F, np.zeros(model.r)
    held = motion(A, B, rows, model.offset[rest][:, None], np.zeros((p, 1)), own, "offset")
    return F, (held.U + L @ held.X)[:, 0]


def at_rest(model: DiscreteModel, C: Array, integrals: int) -> Array:
    """The state, integrals and input about which the cost counts where a known constant is kept from the outputs."""
    assert model.B is not None
    assert model.offset is not None
    held = motion(model.Phi, model.B, C, model.offset[:, None], np.zeros((len(C), 1)), np.eye(1), "offset")
    return np.concatenate([held.X[:, 0], np.zeros(integrals), held.U[:, 0]])
