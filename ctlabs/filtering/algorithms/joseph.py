r"""Joseph's form: P as a sum of two squares, by filterpy.

.. math:: P^- = \Phi P^+\Phi^T + Q, \qquad S = HP^-H^T + R,\quad K = P^-H^TS^{-1}, \qquad
          P^+ = (I-KH)P^-(I-KH)^T + KRK^T

Source: Bucy & Joseph, *Filtering for Stochastic Processes with Applications to Guidance* (1968), section 16.2; Maybeck
vol. 1, section 5.6. Doubles go through the adapter of filterpy (:mod:`ctlabs.filtering.engines.adapter`), with its exact zeros for what a
perfect measurement determines; other numbers through the formula.

Operations per step (leading terms): 4n³ for the prediction, 4n³ + 6mn² + 6m²n for the update.

R = 0: yes · singular Q, P0, Φ: yes. P⁺ keeps its symmetry and its sign for any K,
even a rounded one, but a variance that is a small difference of large entries is lost as in every form that hands over P.
"""

from __future__ import annotations

from threading import local
from typing import Any

import numpy as np

from ctlabs.filtering.algorithms import contract
from ctlabs.filtering.algorithms.contract import CovarianceState, Evidence, Noise, Numbers
from ctlabs.filtering.engines import adapter
from ctlabs.filtering.motion import without_cancelled
from ctlabs.models import DiscreteModel


def start(model: DiscreteModel, P0: Numbers) -> CovarianceState:
    """The state at t0."""
    _filterpy(model.n)  # costs 0.7 s to import: here rather than in a step
    return CovarianceState(contract.column(model, P0), contract.known("joseph", P0))


def predict(state: CovarianceState, Phi: Numbers, c: Numbers | None, Q: Noise) -> CovarianceState:
    """One step ahead."""
    x, P = state
    if P.dtype == np.float64:
        kf = _filterpy(len(P))
        kf.P = P
        kf.predict(F=Phi, Q=Q.matrix)
        ahead = without_cancelled(kf.P, Phi, P, Q.matrix)
    else:
        ahead = Phi @ P @ Phi.T + Q.matrix
    return CovarianceState(contract.moved(Phi, x, c), ahead)


def update(state: CovarianceState, z: Numbers, H: Numbers, R: Noise) -> tuple[CovarianceState, Evidence]:
    """One instant's measurements, all at once."""
    x, P = state
    nu = z - H @ x
    if P.dtype == np.float64:
        kf = _filterpy(len(P))
        kf.P = P
        K, S, after, used = adapter.updated(kf, H, R.matrix)
        if not used.all():
            nu_used, S_used = nu[used], S[np.ix_(used, used)]
            return CovarianceState(x + K[:, used] @ nu_used, after), contract.evidence(nu_used, S_used)
        return CovarianceState(x + K @ nu, after), contract.evidence(nu, S)
    cross = P @ H.T
    S = H @ cross + R.matrix
    K = contract.solve(S, cross.T).T
    left = contract.identity(len(P), P) - K @ H
    return CovarianceState(x + K @ nu, left @ P @ left.T + K @ R.matrix @ K.T), contract.evidence(nu, S)


#: One filter per thread and order: it is filled and read step by step, and keeps nothing but its buffers.
_KEPT = local()


def _filterpy(n: int) -> Any:
    """filterpy's filter of n states."""
    name = f"n{n}"
    if not hasattr(_KEPT, name):
        setattr(_KEPT, name, adapter.made(np.eye(n)))
    return getattr(_KEPT, name)
