r"""The steady state of the discrete filter: covariances, both gains, transfer function, existence.

.. math:: P^- = \Phi P^-\Phi^T + Q_d - (\Phi P^-H^T+N)S^{-1}(\Phi P^-H^T+N)^T, \quad S = HP^-H^T+R

What is returned is the limit of the recursion from P0 > 0: the stabilising solution (:mod:`ctlabs.linalg.riccati`) unless a mode on
the unit circle is not driven by noise; such a mode becomes known exactly as measurements go on, so it is taken out
first (P is zero along it) and the equation solved on the rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ctlabs.linalg import checks, riccati
from ctlabs.linalg.checks import Array
from ctlabs.linalg.correlated import regression
from ctlabs.linalg.factors import ldl
from ctlabs.linalg.updating import updated
from ctlabs.models import DiscreteModel, observability


@dataclass(frozen=True, slots=True, eq=False)
class SteadyState:
    r"""Limits for k → ∞ of the discrete filter.

    ``P_minus``, ``P_plus`` (n, n), covariance of the error before and after an update · ``K`` (n, m), filter gain:
    :math:`\hat x^+ = \hat x^- + K\nu` · ``K_pred`` (n, m), predictor gain ΦK + NS⁺:
    :math:`\hat x^-_{k+1} = \Phi\hat x^-_k + K_{pred}\nu_k` · ``S`` (m, m), covariance of the innovation ·
    ``poles`` (n,), of the filter: eigenvalues of Φ − K_pred H · ``error``, a bound of the error of P_minus and P_plus,
    :math:`|dP_{ij}| \le error\cdot\sigma_i\sigma_j` with their own σ; absolute where one of these is zero
    """

    P_minus: Array
    P_plus: Array
    K: Array
    K_pred: Array
    S: Array
    poles: Array
    error: float


def solve(model: DiscreteModel) -> SteadyState:
    """The steady state of the optimal filter of a constant model.

    Raises
    ------
    ValueError
        The matrices vary with time; or a mode with |λ| ≥ 1 is not observed, so that there is no limit or it
        depends on P0: the message names the mode (its eigenvalue and states), as :func:`ctlabs.models.observability.analyse` does; or R
        is singular and the limit is not reached geometrically (the reduced filter has it); or no solution has an error
        bound below 1e-6.

    Source: Anderson & Moore, *Optimal Filtering* (1979), section 4.4; limits with undriven marginal modes: de Souza,
    Gevers & Goodwin (1986), IEEE Trans. AC-31.

    >>> solve(DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])).K.round(6)
    array([[0.618034]])
    """
    checks.instance("model", model, DiscreteModel)
    if model.horizon is not None:
        msg = f"model: expected constant matrices, received some that vary over {model.horizon} steps"
        raise ValueError(msg)
    if unseen := observability.undetectable(*observability.measured(model), continuous=False):
        msg = (
            "steady state: expected every mode with |eigenvalue| >= 1 to be measured, received the mode "
            f"{unseen[0].name(model.states)}, which no measurement sees: its error variance has no limit "
            "that does not depend on P0"
        )
        raise ValueError(msg)
    made = np.isfinite(np.diag(model.R))
    R = model.R[np.ix_(made, made)]
    try:
        found = riccati.solve(
            model.Phi, model.H[made], model.Qd, R, None if model.N is None else model.N[:, made], continuous=False
        )
    except ValueError as error:
        raise ValueError(_reason(R, error)) from None
    P, K_pred = found.P.high.copy(), np.zeros((model.n, model.m))
    K, S = np.zeros((model.n, model.m)), np.diag(np.full(model.m, np.inf))
    K_pred[:, made] = found.K
    # A perfect measurement of what is known, from others or exactly, says nothing.
    told = riccati.telling(model.H[made], R) & (np.diag(model.H[made] @ P @ model.H[made].T + R) > 0)
    used = np.flatnonzero(made)[told]
    after = updated(found, model.H[used], model.R[np.ix_(used, used)])
    K[:, used], S[np.ix_(used, used)] = after.K, after.S
    poles = np.sort_complex(np.linalg.eigvals(model.Phi - K_pred @ model.H))
    return SteadyState(P, after.P, K, K_pred, S, poles, max(found.error, after.error))


def _reason(R: Array, error: ValueError) -> str:
    """Why there is no steady state."""
    if (ldl(R)[1] > 0).all():
        return f"steady state: {error}"
    return (
        "steady state: expected a limit that is approached geometrically, received a singular R (a measurement, or a combination "
        "of some, without noise) with which the filter has none: the reduced filter (ctlabs.filtering.reduced) leaves out "
        "what it determines"
    )


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
        M[:, used] = regression(model.N[:, used], model.R[np.ix_(used, used)])
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
