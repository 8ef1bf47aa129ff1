"""Triangular factors of covariances, which may be singular."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array


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
    """:func:`unit_triangular` of a matrix that is known to be a covariance."""
    n = len(Q)
    L, d, rest = np.eye(n), np.zeros(n), np.array(Q)
    for j in range(n):
        # What is left of a variance after the earlier columns is rounding below n·eps of the variance itself.
        if rest[j, j] <= 4 * n * np.finfo(float).eps * Q[j, j]:
            continue
        d[j] = rest[j, j]
        L[j + 1 :, j] = rest[j + 1 :, j] / d[j]
        rest[j + 1 :, j + 1 :] -= np.outer(L[j + 1 :, j], rest[j + 1 :, j])
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
    """:func:`factor` of a matrix that is known to be a covariance."""
    L, d = ldl(Q)
    return L * np.sqrt(d)
