r"""Second routes of the studies: slower than the library's, of another principle, and at least as accurate.

They work with 50 digits on the doubles that the first route was given, so that what differs is the first route's error.
"""

from __future__ import annotations

import decimal
from collections.abc import Iterator
from contextlib import contextmanager
from decimal import Decimal
from typing import Any

import numpy as np

from ctlabs.filtering.steady import SteadyState
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel, at
from ctlabs.models.cost import Weights

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

    >>> from ctlabs.filtering import steady
    >>> walk = DiscreteModel([[1]], [[4]], [[1]], [[16]], x0=[0], P0=[[25]])
    >>> float(covariance_of_gain(walk, steady.solve(walk))[0, 0] - (2 + 2 * 17**0.5))
    0.0
    """
    return errors_of_gain(model, limit.K_pred, np.isfinite(np.diag(limit.S)))


def errors_of_gain(model: DiscreteModel, K_pred: Array, measured: Array) -> Array:
    """The same for any predictor gain (n, m); ``measured`` (m,), the measurements that are made."""
    H, R, gain = model.H[measured], model.R[np.ix_(measured, measured)], K_pred[:, measured]
    N = np.zeros((model.n, len(H))) if model.N is None else model.N[:, measured]
    with digits(DIGITS):
        exact = model.n <= LARGE
        Phi, Q, H, R, N, K = (_numbers(M, exact) for M in (model.Phi, model.Qd, H, R, N, gain))
        A, X = Phi - K @ H, Q + K @ R @ K.T - N @ K.T - K @ N.T
        return _summed(A, X, model.n)


def cost_of_gain(model: DiscreteModel, weights: Weights, L: Array) -> Array:
    r"""What a feedback u = −Lx of a known state really costs from each state on, without noise, (n, n).

    .. math:: S = \sum_j (A^T)^j\left(Q_x - NL - L^TN^T + L^TQ_uL\right)A^j, \qquad A = \Phi - BL

    The dual of :func:`covariance_of_gain`, and as indifferent to small errors of the gain.

    >>> from ctlabs.models import Cost
    >>> plant = DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[1]], B=[[1]])
    >>> float(cost_of_gain(plant, Cost([[1]], [[1]]).weights(plant), np.array([[0.6180339887498949]]))[0, 0])
    1.618033988749895
    """
    assert model.B is not None
    with digits(DIGITS):
        exact = model.n <= LARGE
        Phi, B, Qx, Qu, N, gain = (_numbers(M, exact) for M in (model.Phi, model.B, weights.Qx, weights.Qu, weights.N, L))
        NL = N @ gain
        return _summed((Phi - B @ gain).T, Qx - NL - NL.T + gain.T @ Qu @ gain, model.n)


def stationary(Phi: Array, Qd: Array) -> Array:
    """The covariance that a stable system driven by white noise comes to, (n, n): the sum of all that is left of its noises.

    >>> stationary(np.array([[0.5]]), np.array([[3.0]]))
    array([[4.]])
    """
    with digits(DIGITS):
        exact = len(Phi) <= LARGE
        return _summed(_numbers(Phi, exact), _numbers(Qd, exact), len(Phi))


def _summed(A: Any, X: Any, n: int) -> Array:
    """ΣAʲX(Aʲ)ᵀ, rounded to doubles; infinite where it does not end."""
    for _ in range(DOUBLINGS):
        change = A @ X @ A.T
        X, A = X + change, A @ A
        sd = np.sqrt(np.diag(X.astype(float)).clip(0))
        if not np.isfinite(sd).all():
            break
        if (np.abs(change.astype(float)) <= 1e-15 * np.outer(sd, sd)).all():
            X = X.astype(np.float64)
            return 0.5 * (X + X.T)
    return np.full((n, n), np.inf)


def _numbers(M: Array, exact: bool = True) -> Any:
    """Doubles as decimal numbers of the present precision, or as they are."""
    if not exact:
        return np.array(M)
    result = np.empty(M.shape, dtype=object)
    result.ravel()[:] = [Decimal(float(v)) for v in M.ravel()]
    return result


@contextmanager
def digits(number: int) -> Iterator[None]:
    """Decimal arithmetic with so many digits; an overflow is infinite."""
    with decimal.localcontext() as context:
        context.prec = number
        context.traps = dict.fromkeys(context.traps, False)
        yield


def smoothed(model: DiscreteModel, z: Array, first: int) -> tuple[Array, Array]:
    r"""Every state given the whole record, by conditioning the joint Gaussian distribution at once: x (rows, n), P (rows, n, n).

    .. math:: \hat x = E\,x + C_{xz}C_{zz}^{-1}(z - E\,z), \qquad P = C_{xx} - C_{xz}C_{zz}^{-1}C_{zx}

    There is no recursion and no filter in it. With 150 digits a state of which nothing is known has the variance 10⁴⁰ times
    the rest; a measurement that says nothing new is left out. The work grows with the cube of the number of measurements.
    """
    with digits(3 * DIGITS):
        mean, C, H, R, used = _joint(model, z, first)
        Czx = _rows(H, C)
        Czz = _rows(H, Czx.T).T + R
        rows, d = _eliminated(np.hstack([Czz, Czx, (_numbers(z.reshape(-1))[used] - H @ mean)[:, None]]))
        count, n = len(Czz), model.n
        G, e = rows[:, count:-1], rows[:, -1]
        x = mean + (G / d[:, None]).T @ e if len(d) else mean
        P = [
            C[i : i + n, i : i + n] - (G[:, i : i + n] / d[:, None]).T @ G[:, i : i + n] if len(d) else C[i : i + n, i : i + n]
            for i in range(0, len(C), n)
        ]
        return x.astype(np.float64).reshape(-1, n), np.array([part.astype(np.float64) for part in P])


def _rows(H: Any, C: Any) -> Any:
    """H C, where a row of H sees the states of one or two instants only."""
    found = np.full((len(H), C.shape[1]), Decimal(0), dtype=object)
    for i, row in enumerate(H):
        for j in np.flatnonzero(row != 0):
            found[i] = found[i] + row[j] * C[j]
    return found


def _joint(model: DiscreteModel, z: Array, first: int) -> tuple[Any, Any, Any, Any, Array]:
    """Mean and covariance of all states, H and R of all elements measured (N is in H: v_k's part in w_k), and which they are."""
    rows, n, m = len(z), model.n, model.m
    P0 = np.where(np.isinf(model.P0), 1e40 * max(1.0, float(np.abs(z[np.isfinite(z)]).max(initial=1.0)) ** 2), model.P0)
    known = np.isinf(np.diag(model.P0))
    x0 = np.where(known, 0.0, model.x0)
    mean, C = [_numbers(x0)], np.full((rows * n, rows * n), 0, dtype=object)
    C[:n, :n] = _numbers(P0)
    for k in range(1, rows):
        Phi, Q = _numbers(at(model.Phi, k - 1, 2)), _numbers(at(model.Qd, k - 1, 2))
        ahead = Phi @ mean[-1]
        mean.append(ahead if model.offset is None else ahead + _numbers(at(model.offset, k - 1, 1)))
        here, last = slice(k * n, (k + 1) * n), slice((k - 1) * n, k * n)
        C[here, : k * n] = Phi @ C[last, : k * n]
        C[: k * n, here] = C[here, : k * n].T
        C[here, here] = Phi @ C[last, last] @ Phi.T + Q
    variances = np.array([np.diag(at(model.R, k, 2)) for k in range(rows)])
    used = np.isfinite(z) & np.isfinite(variances)
    used[:first] = False
    H, R = np.full((rows * m, rows * n), 0, dtype=object), np.full((rows * m, rows * m), 0, dtype=object)
    for k in range(rows):
        place = slice(k * m, (k + 1) * m)
        H[place, k * n : (k + 1) * n] = _numbers(at(model.H, k, 2))
        R[place, place] = _numbers(np.where(np.isfinite(at(model.R, k, 2)), at(model.R, k, 2), 0.0))
    flat = used.reshape(-1)
    return np.concatenate(mean), C, H[flat], R[np.ix_(flat, flat)], flat


def _eliminated(M: Any) -> tuple[Any, Any]:
    """Gauss's elimination of the symmetric block at the left of M, rows without a pivot left out: the rows, and their pivots."""
    M, kept = M.copy(), []
    size = [abs(M[i, i]) for i in range(len(M))]
    for j in range(len(M)):
        if M[j, j] <= size[j] * Decimal(10) ** (-2 * DIGITS):
            continue
        kept.append(j)
        for i in range(j + 1, len(M)):
            if M[j, i]:  # what stands below the diagonal is what stands beside it
                M[i, i:] = M[i, i:] - M[j, i:] * (M[j, i] / M[j, j])
    return M[kept], np.array([M[j, j] for j in kept], dtype=object)
