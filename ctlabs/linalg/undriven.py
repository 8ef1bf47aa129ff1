r"""What no noise drives: combinations :math:`w^Tx` that become known exactly, whatever they were.

With :math:`w^TA = \lambda w^T` and :math:`w^TQ = 0` the variance along w dies out if the mode decays, and tends to zero as it is
measured if λ is on the boundary of stability. Only the latter stand in the way of a Riccati solver, which finds no stable filter.
Two kinds are found, and none by how small a number is:

- states that no element of Q and A leads any noise to, to which zero is exactly zero;
- of the eigenvalues on the boundary, left vectors to which every source of noise contributes no more than the rounding of its own
  contribution, in the combinations of states that the cluster of eigenvalues leaves possible (Jordan chains included).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.linalg

from ctlabs.linalg.checks import Array
from ctlabs.linalg.staircase import blocks, eigenvalues, growing, hidden
from ctlabs.linalg.units import balanced


class Rest(NamedTuple):
    """The states that stay uncertain and the others as combinations of them, x[known] = M x[kept].

    ``kept`` (p,), ``known`` (n−p,) indices · ``M`` (n−p, p) · ``doubt`` (n−p, p), what rounding leaves open of M
    """

    kept: Array
    known: Array
    M: Array
    doubt: Array


def without(A: Array, Q: Array, *, continuous: bool) -> Rest:
    """What is left when all that becomes known is taken out.

    >>> without(np.diag([1.0, 1.0]), np.diag([1e-30, 0.0]), continuous=False).kept.tolist()
    [0]
    """
    moving = np.flatnonzero(~_still(A, Q, continuous))
    A, Q, n = A[np.ix_(moving, moving)], Q[np.ix_(moving, moving)], len(A)
    x = balanced(A, Q, continuous=continuous).states
    W, tolerance = _marginal(A * x / x[:, None], Q / np.outer(x, x), continuous)
    d = W.shape[1]
    # Echelon form: the states that W determines best, as combinations of the others.
    order = scipy.linalg.qr(W.T, pivoting=True, mode="r")[1] if d else np.arange(len(moving))
    given, free = np.sort(order[:d]), np.sort(order[d:])
    solved = -np.linalg.solve(W[given].T, W[free].T) if d else np.zeros((0, len(free)))
    solved = np.where(np.abs(solved) > tolerance, solved, 0.0)
    doubt = tolerance * np.where(solved.any(axis=1, keepdims=True) & (solved != 0), 1.0, 0.0)
    M, open_ = np.zeros((n - len(free), len(free))), np.zeros((n - len(free), len(free)))
    known = np.setdiff1d(np.arange(n), moving[free])
    rows = np.searchsorted(known, moving[given])
    unit = x[given][:, None] / x[free]
    M[rows], open_[rows] = solved * unit, doubt * unit
    return Rest(moving[free], known, M, open_)


def _still(A: Array, Q: Array, continuous: bool) -> Array:
    """The states (n,) that are led no noise to, and no mode that grows."""
    n = len(A)
    source = np.diag(Q) > 0
    if source.all():
        return ~source
    for inside in blocks(A):
        if not source[inside].any():
            source[inside] = (growing(A[np.ix_(inside, inside)], continuous) > 0).any()
    linked = (A != 0) | np.eye(n, dtype=bool)
    while True:
        reached = (linked & source).any(axis=1)
        if (reached == source).all():
            return ~source
        source = reached


def _marginal(A: Array, Q: Array, continuous: bool) -> tuple[Array, float]:
    """Basis W (n, d) of undriven left vectors on the boundary of stability, and the rounding of its elements."""
    n = len(A)
    nothing = np.zeros((n, 0)), 0.0
    values, doubt = eigenvalues(A)
    distance = values.real if continuous else np.abs(values) - 1
    boundary = np.abs(distance) <= doubt + 4 * np.finfo(float).eps * np.abs(values)
    if not boundary.any():
        return nothing
    T, Z, k = scipy.linalg.schur(A.T, sort=lambda re, im=0.0: bool(boundary[np.abs(values - complex(re, im)).argmin()]))
    if not k:
        return nothing
    rest = T[k:, k:]
    gap, tilt = 1.0, 0.0
    if len(rest):
        tilt = float(np.linalg.norm(scipy.linalg.solve_sylvester(T[:k, :k], -rest, T[:k, k:])))
        gap = min(1.0, np.abs(values[boundary][:, None] - values[~boundary]).min(initial=1.0))
    # The rounding of A turns an invariant subspace by eps·‖A‖ over its distance from the others.
    tolerance = min(16 * n * np.finfo(float).eps * (1 + tilt) * max(1.0, np.abs(A).max()) / max(gap, 1e-300), 1e-6)
    sources = _sources(Q)
    rows = sources @ Z[:, :k]
    rows = rows[np.linalg.norm(rows, axis=1) > tolerance]
    rows = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    return Z[:, :k] @ hidden(T[:k, :k], rows, tolerance, tolerance), tolerance


def _sources(Q: Array) -> Array:
    """Independent noises, each (a row) of length 1: Q = Σ d·row·rowᵀ, what is rounding of its own variance left out."""
    n, rest = len(Q), np.array(Q)
    rows, open_ = [], np.diag(Q) > 0
    while open_.any():
        share = np.where(open_, np.diag(rest) / np.where(np.diag(Q) > 0, np.diag(Q), 1.0), 0.0)
        j = int(share.argmax())
        if share[j] <= 4 * n * np.finfo(float).eps:
            break
        column = rest[:, j] / np.sqrt(rest[j, j])
        rows.append(column / np.linalg.norm(column))
        rest -= np.outer(column, column)
        open_[j] = False
        rest[j, :] = rest[:, j] = 0.0
    return np.array(rows).reshape(len(rows), n)
