r"""The steady state of the discrete filter: covariances, both gains, transfer function, existence.

.. math:: P^- = \Phi P^-\Phi^T + Q_d - (\Phi P^-H^T+N)S^{-1}(\Phi P^-H^T+N)^T, \quad S = HP^-H^T+R

What is returned is the limit of the recursion from P0 > 0. python-control's DARE solver gives it unless a mode on the
unit circle is not driven by noise; such a mode becomes known exactly as measurements go on, so it is taken out
first (P is zero along it) and the equation solved on the rest.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from ctlabs import _check, kalman, observability
from ctlabs._check import Array
from ctlabs.linalg import rounding
from ctlabs.models import DiscreteModel


@dataclass(frozen=True, slots=True, eq=False)
class SteadyState:
    r"""Limits for k → ∞ of the discrete filter.

    ``P_minus``, ``P_plus`` (n, n), covariance of the error before and after an update · ``K`` (n, m), filter gain:
    :math:`\hat x^+ = \hat x^- + K\nu` · ``K_pred`` (n, m), predictor gain ΦK + NS⁺:
    :math:`\hat x^-_{k+1} = \Phi\hat x^-_k + K_{pred}\nu_k` · ``S`` (m, m), covariance of the innovation ·
    ``poles`` (n,), of the filter: eigenvalues of Φ − K_pred H
    """

    P_minus: Array
    P_plus: Array
    K: Array
    K_pred: Array
    S: Array
    poles: Array


def solve(model: DiscreteModel) -> SteadyState:
    """The steady state of the optimal filter of a constant model.

    Raises
    ------
    ValueError
        The matrices vary with time; or a mode with |λ| ≥ 1 is not observed, so that there is no limit or it
        depends on P0: the message names the mode (its eigenvalue and states).

    Source: Anderson & Moore, *Optimal Filtering* (1979), section 4.4; limits with undriven marginal modes: de Souza,
    Gevers & Goodwin (1986), IEEE Trans. AC-31.

    >>> solve(DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])).K.round(6)
    array([[0.618034]])
    """
    _check.instance("model", model, DiscreteModel)
    if model.horizon is not None:
        msg = f"model: expected constant matrices, received some that vary over {model.horizon} steps"
        raise ValueError(msg)
    measured = np.isfinite(np.diag(model.R))
    H, R = model.H[measured], model.R[np.ix_(measured, measured)]
    N = np.zeros((model.n, len(H))) if model.N is None else model.N[:, measured]
    unseen = observability.undetectable(model.Phi, H, continuous=False)
    if unseen:
        msg = (
            "steady state: expected every mode with |eigenvalue| >= 1 to be measured, received the mode "
            f"{unseen[0].name(model.states)}, which no measurement sees: its error variance has no limit "
            "that does not depend on P0"
        )
        raise ValueError(msg)
    M = N @ np.linalg.pinv(R, hermitian=True)
    P_minus = _limit(model.Phi - M @ H, H, rounding.difference(model.Qd - M @ N.T, model.Qd, M @ N.T), R)
    K, S, P_plus, used = kalman.update(P_minus, model.H, model.R)
    K_pred = model.Phi @ K
    if model.N is not None:
        K_pred[:, used] += model.N[:, used] @ np.linalg.inv(S[np.ix_(used, used)])
    poles = np.sort_complex(np.linalg.eigvals(model.Phi - K_pred @ model.H))
    return SteadyState(P_minus, P_plus, K, K_pred, S, poles)


def loop(model: DiscreteModel, limit: SteadyState) -> tuple[Array, Array]:
    r"""A (n, n) and M (n, m) of the steady filter :math:`\hat x_k^+ = A\hat x_{k-1}^+ + Mz_{k-1} + Kz_k`.

    .. math:: A = (I-KH)(\Phi - NR^{-1}H), \qquad M = (I-KH)NR^{-1}

    M, what z_{k−1} tells of w_{k−1}, is zero where N = 0.

    >>> walk = DiscreteModel([[1]], [[4]], [[1]], [[16]], x0=[0], P0=[[25]])
    >>> loop(walk, solve(walk))[0].round(6)
    array([[0.609612]])
    """
    left = np.eye(model.n) - limit.K @ model.H
    used = np.isfinite(np.diag(limit.S))
    M = np.zeros((model.n, model.m))
    if model.N is not None:
        M[:, used] = model.N[:, used] @ np.linalg.pinv(model.R[np.ix_(used, used)], hermitian=True)
    return left @ (model.Phi - M @ model.H), left @ M


def transfer_function(
    model: DiscreteModel, state: int = 0, measurement: int = 0, limit: SteadyState | None = None
) -> tuple[Array, Array]:
    r"""From a measurement to an estimate: :math:`\hat x^+(z)/z(z)` of the steady filter, in powers of z⁻¹.

    .. math:: H(z) = (I - Az^{-1})^{-1}(K + Mz^{-1})

    with A and M of :func:`loop`; ``limit`` : :func:`solve`'s answer, where it is known already.

    Returns
    -------
    num, den : ascending powers of z⁻¹, equal lengths n+1, den[0] = 1

    >>> num, den = transfer_function(DiscreteModel([[1]], [[4]], [[1]], [[16]], x0=[0], P0=[[25]]))
    >>> num.round(6), den.round(6)
    (array([0.390388, 0.      ]), array([ 1.      , -0.609612]))
    """
    limit = solve(model) if limit is None else limit
    A, M = loop(model, limit)
    response = [limit.K, A @ limit.K + M]
    while len(response) <= model.n:
        response.append(A @ response[-1])
    den = np.real(np.poly(A))
    num = np.convolve(den, [h[state, measurement] for h in response])[: model.n + 1]
    # By the Cayley-Hamilton theorem the last coefficients vanish; what is left of them is rounding.
    return np.where(np.abs(num) > 1e-13 * np.abs(num).max(), num, 0.0), den


def settling_step(variances: ArrayLike, limit: ArrayLike, within: float = 0.01) -> int | None:
    """The first index from which every variance stays within a fraction of its limit; ``None`` if the last does not.

    Parameters
    ----------
    variances : (steps+1, n), for example the diagonals of P_plus · limit : (n,) · within : fraction of the limit

    >>> settling_step([[10.0], [0.92], [0.66], [0.62], [0.618]], [0.618])
    3
    """
    values, limit = np.asarray(variances, dtype=np.float64), np.asarray(limit, dtype=np.float64)
    outside = (np.abs(values - limit) > within * limit).any(axis=-1)
    last = int(np.flatnonzero(outside).max(initial=-1))
    return None if last == len(values) - 1 else last + 1


def settling(model: DiscreteModel, within: float = 0.01, first: int = 1, longest: int = 100_000) -> int | None:
    """The settling step of a filter: from it on every variance of P_plus stays within ``within`` of its limit.

    Searched over as many steps as it takes, up to ``longest``; ``None`` beyond (a filter that settles like 1/k
    towards a zero limit never gets within a fraction of it).
    """
    limit = np.diag(solve(model).P_plus)
    if not limit.any():
        longest = 64  # a zero limit is reached at once (perfect measurements) or never within a fraction of it
    steps = 64
    while steps <= longest:
        found = settling_step(np.diagonal(kalman.schedule(model, steps, first).P_plus, axis1=1, axis2=2), limit, within)
        # Half of the horizon in the band is taken for staying there: P_plus converges geometrically.
        if found is not None and found <= steps // 2:
            return max(found, first)
        steps *= 4
    return None


def _limit(A: Array, H: Array, Q: Array, R: Array) -> Array:
    """Limit of P⁻ for transition A, no cross term, all elements of H measured."""
    T, left = observability.driven(A, Q, continuous=False)
    W = left @ Q @ left.T
    # Every measurement in the unit of its own σ: noises of very different size make no system of equations singular then.
    sd = np.sqrt(np.diag(R) + np.diag(H @ Q @ H.T))
    unit = 2.0 ** -np.round(np.log2(np.where(sd > 0, sd, 1.0)))
    P = T @ _stabilising(left @ A @ T, unit[:, None] * (H @ T), 0.5 * (W + W.T), R * np.outer(unit, unit)) @ T.T
    return 0.5 * (P + P.T)


def _stabilising(A: Array, H: Array, Q: Array, R: Array) -> Array:
    """The same where every mode on the unit circle is driven."""
    if not len(A):
        return np.zeros((0, 0))
    if not len(H):
        return scipy.linalg.solve_discrete_lyapunov(A, Q)
    import control  # costs 1 s to import

    try:
        # scipy casts its scale factors to integers, and uses only those that fit; where S is nearly singular it warns of
        # the gain, which is computed anew below.
        with np.errstate(invalid="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore", scipy.linalg.LinAlgWarning)
            P, poles, _ = control.dare(A.T, H.T, 0.5 * (Q + Q.T), R)  # it refuses asymmetry by rounding
    except (ValueError, np.linalg.LinAlgError):  # its ordered Schur form fails for slow filters with double poles
        if np.linalg.cond(R) > 1e12:
            raise
        P = _doubled(A, H, Q, R)
        poles = np.linalg.eigvals(A - A @ np.linalg.solve(H @ P @ H.T + R, H @ P).T @ H)
    if not (np.isfinite(P).all() and (np.abs(poles) < 1).all()):
        msg = f"steady state: expected a stabilising solution of the Riccati equation, received filter poles {poles}"
        raise ValueError(msg)
    return _polished(0.5 * (P + P.T), A, H, Q, R)


def _doubled(A: Array, H: Array, Q: Array, R: Array) -> Array:
    """The limit from P = 0 after 2⁶⁴ steps, by doubling their number (Chu, Fan, Lin & Wang 2004, Int. J. Control 77)."""
    F, G, P = A.T, H.T @ np.linalg.solve(R, H), Q
    for _ in range(64):
        W = np.linalg.inv(np.eye(len(A)) + G @ P)
        F, G, P = F @ W @ F, G + F @ W @ G @ F.T, P + F.T @ P @ W @ F
        P, G = 0.5 * (P + P.T), 0.5 * (G + G.T)
    return P


def _polished(P: Array, A: Array, H: Array, Q: Array, R: Array) -> Array:
    """One step of Newton's method (a Lyapunov equation), which brings the solver's rounding to the last digits."""
    S = H @ P @ H.T + R
    K = A @ np.linalg.solve(S, H @ P).T
    closed = A - K @ H
    better = scipy.linalg.solve_discrete_lyapunov(closed, Q + K @ R @ K.T)
    return 0.5 * (better + better.T)
