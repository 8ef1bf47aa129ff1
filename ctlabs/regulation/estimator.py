"""The estimator inside a regulator: gains on an innovation, for the state and for the disturbance, steady or scheduled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ctlabs.filtering import reduced, steady
from ctlabs.filtering.filter import covariances
from ctlabs.linalg.checks import Array
from ctlabs.linalg.correlated import regression
from ctlabs.linalg.covariance import symmetric
from ctlabs.linalg.factors import ldl
from ctlabs.models.linear import DiscreteModel, at


class Estimator(NamedTuple):
    r"""The filter's gains on ν = z − ẑ⁻; all (…) have a time axis if the gains are scheduled.

    ``K`` (n, m), :math:`\hat x^+ = \hat x^- + K\nu` · ``K_w`` (n, m), :math:`\hat w = K_w\nu`, what the measurement tells of the
    disturbance of the same instant · ``P_minus``, ``P_plus`` (n, n) · ``S`` (m, m), covariance of ν · ``poles`` · ``error``, a bound of
    that of P (NaN where the reduced filter was needed, whose bound is that of its own states)
    """

    K: Array
    K_w: Array
    P_minus: Array
    P_plus: Array
    S: Array
    poles: Array
    error: float

    def at(self, k: int) -> Estimator:
        """The gains at one instant."""
        K, K_w, P_minus, P_plus, S = (at(M, k, 2) for M in self[:5])
        return Estimator(K, K_w, P_minus, P_plus, S, self.poles, self.error)


def steady_estimator(model: DiscreteModel) -> Estimator:
    """The limits, by the reduced filter where perfect measurements leave the full one without a geometric limit.

    >>> estimator = steady_estimator(DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[1]]))
    >>> estimator.K.round(6), estimator.K_w
    (array([[0.618034]]), array([[0.]]))
    """
    try:
        limit = steady.solve(model)
    except ValueError:
        R = np.where(np.isfinite(model.R), model.R, 1.0)
        if R.ndim == 3 or (ldl(R)[1] > 0).all():
            raise
        return _reduced(model)
    S = np.where(np.isfinite(limit.S), limit.S, 0.0)
    return Estimator(limit.K, disturbance(model, S), limit.P_minus, limit.P_plus, S, limit.poles, limit.error)


def _reduced(model: DiscreteModel) -> Estimator:
    """The same through the model without what perfect measurements determine."""
    found = reduced.steady(reduced.discrete(model))
    P = found.P
    NR = np.zeros_like(found.K) if model.N is None else regression(model.N, model.R)
    Phi, taken = model.Phi - NR @ model.H, NR if model.N is None else NR @ model.N.T
    Qd = model.Qd if model.N is None else symmetric(model.Qd - taken)
    before = symmetric(Phi @ P @ Phi.T + Qd)
    S = symmetric(model.H @ before @ model.H.T + model.R)
    poles = np.sort_complex(np.concatenate([found.poles, np.zeros(model.n - len(found.poles))]))
    return Estimator(found.K, disturbance(model, S), before, P, S, poles, np.nan)


def scheduled_estimator(model: DiscreteModel, steps: int, first: int) -> Estimator:
    """The gains of the filter that begins with the model's x0 and P0, at the instants 0 … steps.

    >>> scheduled_estimator(DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[1]]), 2, 1).K.ravel().round(4)
    array([0.    , 0.6667, 0.625 ])
    """
    plan = covariances(model, steps, first=first)
    S = np.where(np.isfinite(plan.S), plan.S, 0.0)
    K_w = np.array([disturbance(model, each) for each in S])
    return Estimator(plan.K, K_w, plan.P_minus, plan.P_plus, S, np.zeros(0, dtype=complex), 0.0)


def disturbance(model: DiscreteModel, S: Array) -> Array:
    """K_w = NS⁺ (n, m), what an innovation of covariance S tells of the disturbance of its instant; elements without one tell nothing."""
    if model.N is None:
        return np.zeros((model.n, model.m))
    used = np.diag(S) > 0
    found = np.zeros((model.n, model.m))
    found[:, used] = regression(model.N[:, used], S[np.ix_(used, used)])
    return found
