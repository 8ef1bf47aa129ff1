r"""Subspaces that a matrix keeps, and eigenvalues with the accuracy to which they are known.

An eigenvalue of a matrix known to rounding is known to ``eps·‖A‖·κ``, κ = 1/|yᴴx| for its left and right eigenvectors of length 1:
of a Jordan block of k, κ grows until that is eps^(1/k). Nothing finer is decided about where an eigenvalue lies. Blocks that zeros
of A part from each other (a triangular matrix has n of them) have eigenvalues of their own.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg
from scipy.sparse.csgraph import connected_components

from ctlabs.linalg.checks import Array
from ctlabs.linalg.units import even

ComplexArray = np.ndarray[Any, np.dtype[np.complex128]]


def eigenvalues(A: Array) -> tuple[ComplexArray, Array]:
    """The eigenvalues of A (n,) and how far each of them may be off by the rounding of A, (n,).

    >>> values, doubt = eigenvalues(np.array([[2.0, 1.0], [-1.0, 0.0]]))  # a Jordan block in another basis
    >>> bool((np.abs(values - 1) < doubt + 1e-15).all()), bool((doubt < 1e-2).all())
    (True, True)
    """
    values, doubt = np.zeros(len(A), dtype=np.complex128), np.zeros(len(A))
    for inside in blocks(A):
        values[inside], doubt[inside] = _of_block(A[np.ix_(inside, inside)])
    return values, doubt


def blocks(A: Array) -> list[Array]:
    """The states of A (indices) parted into those that act on each other, directly or through others."""
    if not len(A):
        return []
    count, part = connected_components(A != 0, connection="strong")
    return [np.flatnonzero(part == i) for i in range(count)]


def _of_block(A: Array) -> tuple[ComplexArray, Array]:
    n, eps = len(A), np.finfo(float).eps
    if n == 1:
        return A[0].astype(np.complex128), np.zeros(1)
    # Balancing is exact, and only powers of 2.
    A = even(A)[0]
    values, left, right = scipy.linalg.eig(A, left=True)
    cosine = np.abs((left.conj() * right).sum(axis=0))
    size = float(np.linalg.norm(A, 2))
    return values, np.minimum(4 * n * eps * size / np.maximum(cosine, eps), 1e-3 * size)


def growing(A: Array, continuous: bool) -> Array:
    """Of each eigenvalue, 1 if its mode grows, −1 if it decays, 0 if it is on the boundary to rounding.

    >>> growing(np.diag([1.0, 1 - 1e-15, 1.1]), continuous=False).tolist()
    [0, -1, 1]
    """
    values, doubt = eigenvalues(A)
    distance = values.real if continuous else np.abs(values) - 1
    return np.where(np.abs(distance) <= doubt, 0, np.sign(distance)).astype(int)


def clusters(values: ComplexArray, doubt: Array) -> list[Array]:
    """Indices of eigenvalues that cannot be told apart, a list of groups."""
    near = np.abs(values[:, None] - values) <= doubt[:, None] + doubt
    count, part = connected_components(near, directed=False)
    return [np.flatnonzero(part == i) for i in range(count)]


def kernel(M: Array, tolerance: float) -> Array:
    """Orthonormal basis of the directions that M takes below a tolerance."""
    if not M.size:
        return np.eye(M.shape[1])
    _, sigma, rows = np.linalg.svd(M)
    return rows[int((sigma > tolerance).sum()) :].T


def hidden(A: Array, H: Array, seen: float, moved: float) -> Array:
    """Orthonormal basis of the largest subspace that H does not see and A keeps, up to these fractions of H and A."""
    V = kernel(H, seen * max(np.abs(H).max(initial=0.0), 1e-300))
    size = max(1.0, float(np.linalg.norm(A, 2))) if A.size and V.size else 1.0
    while V.shape[1]:
        image = A @ V
        kept = kernel(image - V @ (V.T @ image), moved * size)
        if kept.shape[1] == V.shape[1]:
            break
        V = V @ kept
    return V
