r"""A constant error of measurement, estimated beside the signal, in a filter of its own, or only taken into account.

:func:`augmented` makes the error further states, :func:`separate_bias` is Friedland's pair of filters, and :func:`consider` the
Schmidt–Kalman filter, which knows how unsure the error is and does not estimate it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from ctlabs.filtering.bayes import names
from ctlabs.filtering.filter import covariances, kalman_filter
from ctlabs.filtering.measured import begins
from ctlabs.filtering.problem import rows_of
from ctlabs.filtering.results import Covariances, Filtered
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import symmetric
from ctlabs.models import DiscreteModel, at


def augmented(signal: DiscreteModel, G: ArrayLike, P_b: ArrayLike, m_b: ArrayLike | None = None) -> DiscreteModel:
    r"""The signal's model with a constant error of measurement b as further states: z = Hx + Gb + v.

    Parameters
    ----------
    signal : model of the signal and its noises (the error need not be constant: put a varying one into the signal)
    G : (m, L) or (steps+1, m, L), how b enters the measurements
    P_b, m_b : (L, L), (L,), prior covariance and mean of b

    Source: Shapiro & Shchelkanovtsev 1968, the block matrices before eq. (30).

    >>> walk = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])
    >>> augmented(walk, [[1]], [[4]]).H
    array([[1., 1.]])
    """
    P_b, m_b, G = _bias(signal, G, P_b, m_b)
    L = len(m_b)
    return replace(
        signal,
        Phi=_corner(signal.Phi, L, 1.0),
        Qd=_corner(signal.Qd, L, 0.0),
        H=_beside(signal.H, G),
        x0=np.concatenate([signal.x0, m_b]),
        P0=scipy.linalg.block_diag(signal.P0, P_b),
        offset=None if signal.offset is None else np.pad(signal.offset, [*[(0, 0)] * (signal.offset.ndim - 1), (0, L)]),
        N=None if signal.N is None else np.vstack([signal.N, np.zeros((L, signal.m))]),
        states=(*signal.states, *names("b", L)),
        units=(*signal.units, *[""] * L),
    )


@dataclass(frozen=True, slots=True, eq=False)
class SeparateBias:
    """Friedland's two filters and what they give together.

    ``x`` (steps+1, n, runs), signal · ``b`` (steps+1, L, runs), slow error · ``P`` (steps+1, n+L, n+L), covariance of
    both after the update · ``free``, the filter that knows no error · ``bias``, the filter of the error, whose
    measurements are the innovations of the first · ``V`` (steps+1, n, L), what the error b does to the first
    """

    x: Array
    b: Array
    P: Array
    free: Filtered
    bias: Filtered
    V: Array


def separate_bias(
    signal: DiscreteModel, G: ArrayLike, P_b: ArrayLike, z: ArrayLike, m_b: ArrayLike | None = None, first: int | None = None
) -> SeparateBias:
    r"""The augmented filter in two: one of the signal as if there were no error, one of the error alone.

    The innovations of the error-free filter are :math:`\nu_k = B_kb + (\text{white, covariance } \tilde S_k)` with

    .. math:: U_k = \Phi V_{k-1}, \quad B_k = HU_k + G, \quad V_k = U_k - \tilde KB_k, \qquad
              \hat x = \tilde x + V\hat b, \quad P_x = \tilde P + VMV^T, \quad P_{xb} = VM

    where M is the covariance of b̂. The error filter has L states instead of n + L.

    Parameters
    ----------
    signal, G, P_b, m_b : as for :func:`augmented` (signal without N)
    z : (rows, m[, runs]), measurements; NaN = none

    Raises
    ------
    ValueError
        A signal with correlated noises N.

    Source: Friedland, "Treatment of bias in recursive filtering", *IEEE Trans. AC-14* (1969).

    >>> walk = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])
    >>> z = [[[1.0]], [[2.0]]]
    >>> both = kalman_filter(augmented(walk, [[1]], [[4]]), z)
    >>> bool(np.allclose(separate_bias(walk, [[1]], [[4]], z).x[-1], both.x_plus[-1, :1]))
    True
    """
    P_b, m_b, G = _bias(signal, G, P_b, m_b)
    _uncorrelated(signal, "separate_bias")
    data, first = rows_of(z, signal.m)[0], begins(signal, first)
    free = kalman_filter(signal, data, first=first)
    plan, L = free, len(m_b)
    V, B = np.zeros((plan.steps + 1, signal.n, L)), np.zeros((plan.steps + 1, signal.m, L))
    for k in range(plan.steps + 1):
        U = at(signal.Phi, k - 1, 2) @ V[k - 1] if k else V[0]
        B[k] = at(signal.H, k, 2) @ U + at(G, k, 2)
        V[k] = U - plan.K[k] @ B[k]
    still = DiscreteModel(np.eye(L), np.zeros((L, L)), B, plan.S, x0=m_b, P0=P_b, dt=signal.dt, states=names("b", L))
    bias = kalman_filter(still, free.innovation[first:], first=first)
    M, b = bias.P_plus, bias.x_plus
    cross = V @ M
    P = np.block([[plan.P_plus + cross @ np.swapaxes(V, 1, 2), cross], [np.swapaxes(cross, 1, 2), M]])
    return SeparateBias(free.x_plus + V @ b, b, P, free, bias, V)


def consider(
    signal: DiscreteModel, G: ArrayLike, P_b: ArrayLike, steps: int, first: int | None = None
) -> tuple[DiscreteModel, Covariances]:
    r"""The Schmidt–Kalman filter: the error b is never estimated, but its variance and correlation are accounted for.

    .. math:: K = \begin{pmatrix} (P_{xx}H^T + P_{xb}G^T)S^{-1} \\ 0 \end{pmatrix}, \quad S = TPT^T + R,\ T = (H\ G)

    with P by Joseph's form, which is right for any gain. Returns the augmented model and the gains; apply them by
    ``kalman_filter(model, z, gains=gains)``, or give both to :mod:`ctlabs.analysis.sensitivity` and :mod:`ctlabs.montecarlo`.

    Raises
    ------
    ValueError
        A signal with correlated noises N.

    Source: Schmidt (1966); Bierman, *Factorization Methods* (1977), section VIII.2.

    >>> walk = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])
    >>> whole, plan = consider(walk, [[1]], [[4]], 3)
    >>> plan.K[1].round(4).tolist(), plan.P_plus[3, 1, 1].round(9)
    ([[0.6875], [0.0]], np.float64(4.0))
    """
    _uncorrelated(signal, "consider")
    whole = augmented(signal, G, P_b)
    own = covariances(whole, steps, first=first)  # which elements are used, and nothing else
    n, P = whole.n, whole.P0
    P_minus, P_plus, K, S = np.empty((steps + 1, n, n)), np.empty((steps + 1, n, n)), np.zeros_like(own.K), own.S.copy()
    for k in range(steps + 1):
        if k:
            Phi = at(whole.Phi, k - 1, 2)
            P = Phi @ P @ Phi.T + at(whole.Qd, k - 1, 2)
        P_minus[k], used = P, own.used[k]
        T, R = at(whole.H, k, 2)[used], at(whole.R, k, 2)[np.ix_(used, used)]
        inner = T @ P @ T.T + R
        S[k][np.ix_(used, used)] = inner
        K[k][: signal.n, used] = np.linalg.solve(inner, T @ P[:, : signal.n]).T
        rest = np.eye(n) - K[k][:, used] @ T
        P = rest @ P @ rest.T + K[k][:, used] @ R @ K[k][:, used].T
        P = P_plus[k] = symmetric(P)
    return whole, Covariances(own.t, P_minus, P_plus, K, S, own.used)


def _bias(signal: DiscreteModel, G: ArrayLike, P_b: ArrayLike, m_b: ArrayLike | None) -> tuple[Array, Array, Array]:
    """P_b, m_b, G, checked against the signal."""
    checks.instance("signal", signal, DiscreteModel)
    P_b = checks.covariance("P_b", P_b, ("L", "L"))
    L = len(P_b)
    m_b = np.zeros(L) if m_b is None else checks.shaped("m_b", m_b, (L,))
    return P_b, m_b, checks.shaped("G", G, (signal.m, L), ("steps+1", signal.m, L))


def _uncorrelated(signal: DiscreteModel, who: str) -> None:
    if signal.N is not None and signal.N.any():
        msg = f"{who}: expected a signal without N (noises that correlate), received one"
        raise ValueError(msg)


def _beside(H: Array, G: Array) -> Array:
    """(H G), either of which may vary with time."""
    spans = [len(one) for one in (H, G) if one.ndim == 3]
    if not spans:
        return np.hstack([H, G])
    if len(set(spans)) > 1:
        msg = f"G: expected {spans[0]} instants as H has, received {spans[1]}"
        raise ValueError(msg)
    return np.concatenate([np.broadcast_to(one, (spans[0], *one.shape[-2:])) for one in (H, G)], axis=-1)


def _corner(matrix: Array, L: int, diagonal: float) -> Array:
    """The matrix, or each of a stack, with L more rows and columns that hold ``diagonal`` on theirs."""
    n = matrix.shape[-1]
    result = np.zeros((*matrix.shape[:-2], n + L, n + L))
    result[..., :n, :n] = matrix
    result[..., n:, n:] = diagonal * np.eye(L)
    return result
