r"""Filters of a random field: the published equations, and the same numbers by structure.

With H = [I 0] and R = σ²I only the measured nodes o enter: with S = P⁻_oo + σ²I and W = S⁻¹P⁻_o·

.. math:: P^+_{o\cdot} = \sigma^2W, \qquad P^+_{uu} = P^-_{uu} - P^-_{uo}W_{\cdot u}

for the states u that are not measured (all z*, and nodes in a gap). The first equation subtracts nothing, so a
variance far below P⁻ keeps its digits. ΦPΦᵀ is the recursion applied to the columns and then to the rows of P.
The first row of data belongs to t1; NaN means not measured, in every run.
"""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from ctlabs.filtering.filter import kalman_filter
from ctlabs.filtering.measured import gaps as missing
from ctlabs.filtering.problem import by_instant
from ctlabs.filtering.results import Covariances
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.linalg.threads import one_thread
from ctlabs.models.field.model import RandomField

#: Matrices of fewer rows are filtered on one thread: a second one would wait more than it works.
SMALL = 512
Indices = NDArray[np.signedinteger[Any]]


@dataclass(frozen=True, slots=True, eq=False)
class FieldEstimate:
    """What a filter of a field gives; index 0 is t0, which is not updated.

    ``z_hat`` (steps+1, N1+1[, runs]), u · ``variance`` (steps+1, N1+1), u², of the error of z as the filter claims it ·
    ``truncation``, how much of the gain was left out, as a share of it (0 for an exact filter) · ``half_width``,
    how many nodes to each side a correction uses
    """

    z_hat: Array
    variance: Array
    truncation: float
    half_width: int


def filter_dense(
    field: RandomField,
    measured: ArrayLike,
    *,
    sigma_n: float,
    P0: float = 10.0,
    gains: Covariances | None = None,
) -> FieldEstimate:
    """The published filter (eq. 46–49) by the common discrete filter on dense matrices.

    Parameters
    ----------
    field : the model
    measured : (rows, N1+1[, runs]), u, from t1 on; NaN = not measured, in every run
    sigma_n : standard deviation of the measurement noise, u
    P0 : variance of every state at t0 as the filter believes it
    gains : computed before, by :func:`ctlabs.covariances` of ``field.model(sigma_n, P0)``

    Raises
    ------
    ValueError
        Data of another shape, infinite, or NaN in some runs only.

    >>> field = RandomField(0.1, 0.1, 0.25, 1, 1, 0.2, 30, 3)
    >>> filter_dense(field, np.zeros((10, 31)), sigma_n=1.0).z_hat.shape
    (11, 31)
    """
    data, single = measurements(field, measured, sigma_n, P0)
    done = kalman_filter(field.model(sigma_n, P0), data[1:], gains=gains)
    variance = np.array(np.diagonal(done.P_plus, axis1=1, axis2=2)[:, : field.nodes])
    z_hat = done.x_plus[:, : field.nodes]
    return FieldEstimate(z_hat[:, :, 0] if single else z_hat, variance, 0.0, field.N1)


def filter_exact(
    field: RandomField, measured: ArrayLike, *, sigma_n: float, P0: float = 10.0
) -> FieldEstimate:
    """The same numbers as :func:`filter_dense` by the structure of the matrices; parameters as there.

    >>> field = RandomField(0.1, 0.1, 0.25, 1, 1, 0.2, 30, 3)
    >>> z = np.cumsum(np.ones((10, 31)), axis=0)
    >>> exact, dense = filter_exact(field, z, sigma_n=1.0), filter_dense(field, z, sigma_n=1.0)
    >>> bool(np.abs(exact.z_hat - dense.z_hat).max() < 1e-12)
    True
    """
    data, single = measurements(field, measured, sigma_n, P0)
    N, steps, runs = field.nodes, len(data) - 1, data.shape[2]
    noise = (field.coefficients.e4 * field.sigma_eta) ** 2
    P, x = P0 * np.eye(2 * N), np.zeros((2 * N, runs))
    z_hat, variance = np.empty((steps + 1, N, runs)), np.empty((steps + 1, N))
    z_hat[0], variance[0] = 0.0, P0
    with one_thread() if N < SMALL else nullcontext():
        for k in range(1, steps + 1):
            x, P = field.advance(x), predicted(field, P, noise)
            seen = np.flatnonzero(~np.isnan(data[k, :, 0]))
            if len(seen):
                W, P = updated(P, seen, sigma_n**2)
                x += W.T @ (data[k, seen] - x[seen])
            z_hat[k], variance[k] = x[:N], np.diagonal(P)[:N]
    return FieldEstimate(z_hat[:, :, 0] if single else z_hat, variance, 0.0, field.N1)


def predicted(field: RandomField, P: Array, noise: float) -> Array:
    """ΦPΦᵀ + Qd for a covariance (2N, 2N); ``noise`` = (e4 σ_η)²."""
    P = field.advance(field.advance(P).T)
    inner = np.arange(field.nodes + 1, 2 * field.nodes)
    P[inner, inner] += noise
    return P


def updated(P: Array, seen: Indices, variance: float) -> tuple[Array, Array]:
    """The transposed gain (nodes seen, 2N) and the covariance after a measurement of the nodes ``seen``."""
    N, count = len(P) // 2, len(seen)
    order = np.concatenate([seen, np.setdiff1d(np.arange(2 * N), seen)])  # the measured states first
    P = P if count == N else P[np.ix_(order, order)]
    S = P[:count, :count].copy()
    S[np.diag_indices_from(S)] += variance
    factor = scipy.linalg.cho_factor(S, lower=True, overwrite_a=True, check_finite=False)
    W = scipy.linalg.cho_solve(factor, P[:count], check_finite=False)
    P_plus = np.empty_like(P)
    P_plus[:count] = variance * W
    P_plus[count:, :count] = P_plus[:count, count:].T
    P_plus[count:, count:] = P[count:, count:] - P[count:, :count] @ W[:, count:]
    P_plus = 0.5 * (P_plus + P_plus.T)
    if count == N:
        return W, P_plus
    back = np.argsort(order)
    return W[:, back], P_plus[np.ix_(back, back)]


def measurements(field: RandomField, measured: ArrayLike, sigma_n: float, P0: float) -> tuple[Array, bool]:
    """The data by instants, (steps+1, N1+1, runs), and whether they were one run; the filters' other arguments are checked too."""
    checks.instance("field", field, RandomField)
    checks.positive("sigma_n", sigma_n)
    checks.nonnegative("P0", P0)
    data = np.array(measured, dtype=np.float64)
    if data.ndim not in (2, 3) or data.shape[1] != field.nodes or not len(data):
        msg = f"measured: expected shape (rows, {field.nodes}[, runs]), received {data.shape}"
        raise ValueError(msg)
    single = data.ndim == 2
    data = by_instant(data[:, :, None] if single else data, 1)
    missing(data, 1)
    return data, single
