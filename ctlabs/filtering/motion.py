"""What moves a state from one instant to the next, with what the last measurement tells of it."""

from __future__ import annotations

from operator import gt

import numpy as np

from ctlabs.filtering.results import Mask
from ctlabs.linalg import rounding
from ctlabs.linalg.checks import Array
from ctlabs.linalg.correlated import regression
from ctlabs.linalg.rounding import CANCELLED
from ctlabs.models.linear import DiscreteModel, at


def motion(model: DiscreteModel, k: int, used: Mask) -> tuple[Array, Array, Array | None]:
    """Transition and noise covariance from k to k+1, and the gain M on z_k where w_k correlates with v_k.

    What a measurement tells of the next disturbance is used: Φ − NR⁺H, Qd − NR⁺Nᵀ and the known input NR⁺z
    (Kailath, Sayed & Hassibi, *Linear Estimation*, section 9.5).
    """
    return measured(model, k, used, at(model.H, k, 2), at(model.R, k, 2))


def measured(model: DiscreteModel, k: int, used: Mask, H: Array, R: Array) -> tuple[Array, Array, Array | None]:
    """The same after a measurement at k with H and R of its own."""
    Phi, Qd = at(model.Phi, k, 2), at(model.Qd, k, 2)
    if model.N is None or not used.any():
        return Phi, Qd, None
    N = model.N[:, used]
    M = regression(N, R[np.ix_(used, used)])
    taken = M @ N.T
    return Phi - M @ H[used], rounding.difference(Qd - taken, Qd, taken), M


def motions(model: DiscreteModel, used: Mask) -> tuple[Array, Array, Array]:
    """:func:`motion` of all steps, ``used`` (steps+1, m) being measured: stacks of Φ and Q, of one entry where N = 0 and they are constant.

    The third, M (steps, n, m), 0 where an element is not used, is empty where N = 0.
    """
    Phi, Qd = (matrix if matrix.ndim == 3 else matrix[None] for matrix in (model.Phi, model.Qd))
    if model.N is None:
        return np.ascontiguousarray(Phi), np.ascontiguousarray(Qd), np.zeros((0, model.n, model.m))
    M, taken = np.zeros((len(used) - 1, model.n, model.m)), np.zeros((len(used) - 1, model.n, model.n))
    kinds, which = np.unique(used[:-1], axis=0, return_inverse=True)
    for i, kind in enumerate(kinds):  # the same elements at a time; R is one, or one for each instant
        steps, there = np.flatnonzero(which.ravel() == i), np.flatnonzero(kind)
        if there.size:
            own = regression(model.N[:, there], (model.R if model.R.ndim == 2 else model.R[steps])[..., there[:, None], there])
            M[np.ix_(steps, np.arange(model.n), there)], taken[steps] = own, own @ model.N[:, there].T
    Phi = Phi - M @ (model.H if model.H.ndim == 2 else model.H[:-1])
    return Phi, rounding.difference(Qd - taken, Qd, taken), M


def without_cancelled(P: Array, Phi: Array, before: Array, Q: Array) -> Array:
    """Exact zeros for a predicted state whose row of P is the rounding of the terms that cancelled in it.

    A known combination of states that Φ turns into a state of its own is known, not of a variance ±1e-17.
    """
    variances, own = before.diagonal(), Q.diagonal()
    bound = (len(P) + 1) * CANCELLED * ((Phi * Phi).dot(abs(variances)) + own)  # not below the square of the size (Cauchy)
    if all(map(gt, P.diagonal().tolist(), bound.tolist())):
        return P
    size = np.abs(Phi) @ np.sqrt(np.abs(variances)) + np.sqrt(own)
    lost = CANCELLED * size
    known = (np.abs(P) <= lost[:, None] * size).all(axis=1) & np.isfinite(P.diagonal())
    return np.where(known[:, None] | known, 0.0, P)
