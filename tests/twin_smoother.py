"""Filter and smoother without a recursion: the joint Gaussian of all states and measurements, conditioned in 400 digits.

Where nothing is known of a state its variance is 10^120: the limit from there on is 10^-120 away.
"""

from __future__ import annotations

from typing import NamedTuple

import mpmath
import numpy as np

from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel, at
from tests.untraced import untraced

DIGITS = 400
#: The variance of what is not known, and a variance that only an unknown state has.
LARGE, HUGE = mpmath.mpf(10) ** 120, mpmath.mpf(10) ** 60


class Twin(NamedTuple):
    """``x``, ``P``, ``lag_one`` as in :class:`ctlabs.filtering.smoothing.Smoothed`; the diffuse log-likelihood."""

    x: Array
    P: Array
    lag_one: Array
    log_likelihood: float


@untraced
def conditioned(model: DiscreteModel, z: Array, first: int = 1, end: int | None = None) -> Twin:
    """All states of rows 0…end given the measurements up to ``end`` (the last row)."""
    with mpmath.workdps(DIGITS):
        return _conditioned(model, np.asarray(z), first, len(z) - 1 if end is None else end)


def _exact(values: Array) -> mpmath.matrix:
    return mpmath.matrix([[mpmath.mpf(float(v)) for v in row] for row in np.atleast_2d(values)])


def _conditioned(model: DiscreteModel, z: Array, first: int, end: int) -> Twin:
    n, m, rows = model.n, model.m, end + 1
    unknown = np.isinf(np.diag(model.P0))
    P0 = _exact(np.where(unknown[:, None] | unknown, 0.0, model.P0))
    for i in np.flatnonzero(unknown):
        P0[i, i] = LARGE
    # sources: x0, then (w_k, v_k) of each row; states and measurements as maps of them
    size = n + rows * (n + m)
    cov, mean = mpmath.zeros(size), mpmath.zeros(rows * n, 1)
    cov[:n, :n] = P0
    X, Z, value, used = mpmath.zeros(rows * n, size), [], [], []
    now = mpmath.zeros(n, size)
    for i in range(n):
        now[i, i] = mpmath.mpf(1)
    at_now = _exact(np.where(unknown, 0.0, model.x0)).T
    for k in range(rows):
        w, v = n + k * (n + m), n + k * (n + m) + n
        R = at(model.R, k, 2)
        finite = np.isfinite(np.diag(R))
        cov[v : v + m, v : v + m] = _exact(np.where(finite[:, None] & finite, R, 0.0))
        if k < rows - 1:
            cov[w : w + n, w : w + n] = _exact(at(model.Qd, k, 2))
            if model.N is not None:
                cov[w : w + n, v : v + m] = _exact(model.N)
                cov[v : v + m, w : w + n] = _exact(model.N).T
        X[k * n : (k + 1) * n, :] = now
        mean[k * n : (k + 1) * n, 0] = at_now
        H = _exact(at(model.H, k, 2))
        seen, expected = H * now, H * at_now
        for i in range(m):
            if k >= first and finite[i] and not np.isnan(z[k, i]):
                row = seen[i, :].copy()
                row[0, v + i] += 1
                Z.append(row)
                value.append(mpmath.mpf(float(z[k, i])) - expected[i])
                used.append((k, i))
        if k < rows - 1:
            Phi = _exact(at(model.Phi, k, 2))
            now, at_now = Phi * now, Phi * at_now
            for i in range(n):
                now[i, w + i] += 1
            if model.offset is not None:
                at_now += _exact(at(model.offset, k, 1)).T
    prior = X * cov * X.T
    x, P, total = mean, prior, mpmath.mpf(0)
    if Z:
        A = mpmath.matrix(len(Z), size)
        for j, row in enumerate(Z):
            A[j, :] = row
        S, cross, nu = A * cov * A.T, X * cov * A.T, mpmath.matrix(value)
        L = mpmath.cholesky(S)
        white = mpmath.zeros(len(Z), 1 + rows * n)
        for j in range(len(Z)):
            for c in range(1 + rows * n):
                s = nu[j] if c == 0 else cross[c - 1, j]
                for h in range(j):
                    s -= L[j, h] * white[h, c]
                white[j, c] = s / L[j, j]
        x, P = mean + white[:, 1:].T * white[:, 0], prior - white[:, 1:].T * white[:, 1:]
        total = -(white[:, 0].T * white[:, 0])[0] / 2
        for j in range(len(Z)):
            pivot = L[j, j] / (mpmath.sqrt(LARGE) if L[j, j] ** 2 > HUGE else 1)
            total -= mpmath.log(pivot) + mpmath.log(2 * mpmath.pi) / 2
    return _rounded(x, P, total, rows, n)


def _rounded(x: mpmath.matrix, P: mpmath.matrix, total: mpmath.mpf, rows: int, n: int) -> Twin:
    means, covariances, lag_one = np.empty((rows, n)), np.empty((rows, n, n)), np.full((rows, n, n), np.nan)
    lost = [P[i, i] > HUGE for i in range(rows * n)]
    for k in range(rows):
        for i in range(n):
            a = k * n + i
            means[k, i] = np.nan if lost[a] else float(x[a])
            for j in range(n):
                b, c = k * n + j, (k - 1) * n + j
                off = np.inf if i == j else 0.0
                covariances[k, i, j] = off if lost[a] or lost[b] else float(P[a, b])
                if k:
                    lag_one[k, i, j] = np.nan if lost[a] or lost[c] else float(P[a, c])
    return Twin(means, covariances, lag_one, float(total))
