"""Triangular factors of covariances, which may be singular."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array

EPS = float(np.finfo(float).eps)


def unit_triangular(Q: ArrayLike) -> tuple[Array, Array]:
    r"""The factors of :math:`Q = L\,\mathrm{diag}(d)\,L^T`, L unit lower triangular, d ≥ 0; Q may be singular.

    A direction without noise has d = 0 and a unit column in L.

    Parameters
    ----------
    Q : (n, n), symmetric nonnegative definite

    Returns
    -------
    L (n, n), d (n,)

    Source: Golub & Van Loan, *Matrix Computations*, section 4.1 (LDLᵀ).

    >>> unit_triangular([[1/3, 1/2], [1/2, 1]])[1]
    array([0.33333333, 0.25      ])
    """
    return ldl(checks.covariance("Q", Q, ("n", "n")))


def ldl(Q: Array) -> tuple[Array, Array]:
    """:func:`unit_triangular` of matrices (…, n, n) that are known to be covariances."""
    n = Q.shape[-1]
    L, d, rest = np.zeros(Q.shape), np.zeros(Q.shape[:-1]), np.array(Q)
    for j in range(n):
        left, below = rest[..., j, j].copy(), rest[..., j + 1 :, j].copy()
        # What is left of a variance after the earlier columns is rounding below n·eps of the variance itself.
        there = left > 4 * n * EPS * Q[..., j, j]
        L[..., j, j], d[..., j] = 1.0, np.where(there, left, 0.0)
        L[..., j + 1 :, j] = np.where(there[..., None], below, 0.0) / np.where(there, left, 1.0)[..., None]
        rest[..., j + 1 :, j + 1 :] -= L[..., j + 1 :, j, None] * below[..., None, :]
    return L, d


def factor(Q: ArrayLike) -> Array:
    r"""The lower triangular :math:`\bar G` with :math:`\bar G\bar G^T = Q`: Cholesky's, and as good when Q is singular.

    White noise of unit variance times this factor has the covariance Q.

    >>> factor([[1.0, 1.0], [1.0, 1.0]])
    array([[1., 0.],
           [1., 0.]])
    """
    return root(checks.covariance("Q", Q, ("n", "n")))


def root(Q: Array) -> Array:
    """:func:`factor` of matrices (…, n, n) that are known to be covariances."""
    L, d = ldl(Q)
    return L * np.sqrt(d)[..., None, :]
