r"""Second routes of the studies: slower than the library's, of another principle, and at least as accurate.

They work with 50 digits on the doubles that the first route was given, so that what differs is the first route's error.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ctlabs._check import Array
from ctlabs.models import DiscreteModel
from ctlabs.steady import SteadyState

#: Digits of the second routes.
DIGITS = 50
#: Models of more states are followed in double precision, which 50 digits would take too long for.
LARGE = 12
#: Doublings after which the sum of a Lyapunov equation is given up.
DOUBLINGS = 200


def covariance_of_gain(model: DiscreteModel, limit: SteadyState) -> Array:
    r"""The covariance of the prediction error that a steady filter's gain really has, (n, n).

    .. math:: P = \sum_j A^j\left(Q_d + \bar KR\bar K^T - N\bar K^T - \bar KN^T\right)(A^j)^T, \qquad A = \Phi - \bar KH

    with the predictor's gain K̄, whatever P it was computed from. A gain that is off by δ changes this sum by terms in δ²
    only, so that it is the optimal covariance; a P that is not the Riccati equation's solution differs from it. The sum is
    doubled, :math:`X \leftarrow X + AXA^T,\ A \leftarrow A^2`: slow filters need no more terms than fast ones.

    Source: Kleinman, IEEE Trans. AC-13 (1968) for continuous time; Hewer, IEEE Trans. AC-16 (1971).

    >>> from ctlabs import steady
    >>> walk = DiscreteModel([[1]], [[4]], [[1]], [[16]], x0=[0], P0=[[25]])
    >>> float(covariance_of_gain(walk, steady.solve(walk))[0, 0] - (2 + 2 * 17**0.5))
    0.0
    """
    import mpmath

    measured = np.isfinite(np.diag(limit.S))
    H, R, gain = model.H[measured], model.R[np.ix_(measured, measured)], limit.K_pred[:, measured]
    N = np.zeros((model.n, len(H))) if model.N is None else model.N[:, measured]
    with mpmath.workdps(DIGITS):
        exact = model.n <= LARGE
        Phi, Q, H, R, N, K = (_numbers(M, exact) for M in (model.Phi, model.Qd, H, R, N, gain))
        A, X = Phi - K @ H, Q + K @ R @ K.T - N @ K.T - K @ N.T
        return _summed(A, X, model.n)


def _summed(A: Any, X: Any, n: int) -> Array:
    """ΣAʲX(Aʲ)ᵀ, rounded to doubles; infinite where it does not end."""
    for _ in range(DOUBLINGS):
        change = A @ X @ A.T
        X, A = X + change, A @ A
        sd = np.sqrt(np.diag(X.astype(float)).clip(0))
        if not np.isfinite(sd).all():
            break
        if (np.abs(change.astype(float)) <= 1e-15 * np.outer(sd, sd)).all():
            return np.asarray(0.5 * (X + X.T), dtype=np.float64)
    return np.full((n, n), np.inf)


def _numbers(M: Array, exact: bool) -> Any:
    """Doubles as numbers of 50 digits, or as they are."""
    import mpmath

    if not exact:
        return np.array(M)
    result = np.empty(M.shape, dtype=object)
    result.ravel()[:] = [mpmath.mpf(float(v)) for v in M.ravel()]
    return result
