r"""What is left of a sum when its terms cancel: a number, or rounding.

A computed sum :math:`s = \sum_i t_i` carries an error of about :math:`\varepsilon\sum_i|t_i|` (Higham, *Accuracy and Stability of
Numerical Algorithms*, 2nd ed., section 4.2). What is left below that is taken for zero; nothing else is: a variance may be
small beside others, or beside what it was before, without being rounding. Every rule here compares a sum with its own terms, so
that it depends on no units.
"""

from __future__ import annotations

import numpy as np

from ctlabs.linalg.checks import Array

EPS = float(np.finfo(float).eps)
#: What is left of a sum of n terms below 4nε of their sizes is rounding.
MARGIN = 4
#: Remainders of a cancelling sum below this fraction of its terms are rounding, gathered over some hundred steps.
CANCELLED = 2e-13


def level(terms: Array, count: int, eps: float = EPS) -> Array:
    """What rounding may leave of sums of ``count`` terms whose sizes add up to ``terms``."""
    return MARGIN * count * eps * terms


def difference(M: Array, given: Array, taken: Array) -> Array:
    """A covariance M = given − taken with exact zeros where all of a variance was taken away.

    Parameters
    ----------
    M, given, taken : (…, n, n)

    >>> difference(np.array([[1e-17]]), np.array([[0.1]]), np.array([[0.1]]))
    array([[0.]])
    """
    left, *parts = (np.diagonal(each, axis1=-2, axis2=-1) for each in (M, given, taken))
    known = left <= level(2 * (np.abs(parts[0]) + np.abs(parts[1])), M.shape[-1])  # a product of three matrices was taken
    return np.where(known[..., :, None] | known[..., None, :], 0.0, M)


def corrected(
    P_plus: Array, P_minus: Array, K: Array, H: Array, S: Array | None = None, R: Array | None = None
) -> Array:
    r"""P⁺ = (I−KH)P⁻(I−KH)ᵀ + KRKᵀ with exact zeros for the states that perfect measurements determined.

    Row i of B = I − KH is a difference itself: K is known to :math:`\varepsilon|K||S||S^{-1}|`, so that of
    :math:`b_i = \sum_j|B_{ij}|\sigma_j` an error
    :math:`c_i = \varepsilon\sum_j(\delta_{ij} + (|K||S||S^{-1}||H|)_{ij})\sigma_j` is left, and of the variance
    :math:`\varepsilon b_i^2 + c_i^2`, beside :math:`\varepsilon(|K||R||K|^T)_{ii}` where correlated noises cancel.

    Parameters
    ----------
    P_plus, P_minus : (…, n, n) · K : (…, n, m) · H : (…, m, n) · S, R : (…, m, m), not needed where m = 1

    >>> H = np.array([[1.0, 1e-8]])  # x1 is known as well as 1e-8 x2 is, which is not exactly
    >>> K = np.array([[1.0], [1e-8]])
    >>> corrected(np.array([[1e-16, -1e-8], [-1e-8, 1.0]]), np.eye(2), K, H)
    array([[ 1.e-16, -1.e-08],
           [-1.e-08,  1.e+00]])
    """
    n = P_plus.shape[-1]
    variances, before = (np.diagonal(P, axis1=-2, axis2=-1) for P in (P_plus, P_minus))
    sd, unit, size = np.sqrt(before.clip(0))[..., None], np.eye(n), np.abs(K)
    if S is not None and S.shape[-1] > 1:
        size = size @ np.abs(S) @ np.abs(np.linalg.pinv(S, hermitian=True))
    left = (np.abs(unit - K @ H) @ sd)[..., 0]
    terms = ((unit + size @ np.abs(H)) @ sd)[..., 0]
    lost = level(left**2, n) + level(terms, n) ** 2
    if R is not None:
        lost = lost + level(((np.abs(K) @ np.abs(R)) * np.abs(K)).sum(axis=-1), n)
    known = variances <= lost
    return np.where(known[..., :, None] | known[..., None, :], 0.0, P_plus) if known.any() else P_plus
