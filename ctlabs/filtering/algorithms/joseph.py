r"""Joseph's form: P as a sum of two squares.

.. math:: P^- = \Phi P^+\Phi^T + Q, \qquad S = HP^-H^T + R,\quad K = P^-H^TS^{-1}, \qquad
          P^+ = (I-KH)P^-(I-KH)^T + KRK^T

Source: Bucy & Joseph, *Filtering for Stochastic Processes with Applications to Guidance* (1968), section 16.2; Maybeck
vol. 1, section 5.6. In doubles these are the operations of filterpy (:mod:`ctlabs.filtering.engines.adapter`), in its order, with the
same exact zeros for what a perfect measurement determines.

Operations per step (leading terms): 4n³ for the prediction, 4n³ + 6mn² + 6m²n for the update.

R = 0: yes · singular Q, P0, Φ: yes. P⁺ keeps its symmetry and its sign for any K,
even a rounded one, but a variance that is a small difference of large entries is lost as in every form that hands over P.
"""

from __future__ import annotations

import numpy as np

from ctlabs.filtering.algorithms import contract
from ctlabs.filtering.algorithms.contract import CovarianceState, Evidence, Noise, Numbers
from ctlabs.filtering.measured import informative
from ctlabs.filtering.motion import without_cancelled
from ctlabs.linalg import rounding
from ctlabs.linalg.covariance import symmetric
from ctlabs.models import DiscreteModel


def start(model: DiscreteModel, P0: Numbers) -> CovarianceState:
    """The state at t0."""
    return CovarianceState(contract.column(model, P0), contract.known("joseph", P0))


def predict(state: CovarianceState, Phi: Numbers, c: Numbers | None, Q: Noise) -> CovarianceState:
    """One step ahead."""
    x, P = state
    ahead = Phi.dot(P).dot(Phi.T) + Q.matrix
    if P.dtype == np.float64:
        ahead = without_cancelled(ahead, Phi, P, Q.matrix)
    return CovarianceState(contract.moved(Phi, x, c), ahead)


def update(state: CovarianceState, z: Numbers, H: Numbers, R: Noise) -> tuple[CovarianceState, Evidence]:
    """One instant's measurements, all at once."""
    (x, P), perfect = state, z.dtype == np.float64 and R.singular
    if perfect and not (used := informative(P, H, R.matrix)).all():
        z, H, R = z[used], H[used], Noise(R.matrix[np.ix_(used, used)])
        if not used.any():
            return state, contract.independent(z, R.matrix.diagonal())
    nu, cross = z - H.dot(x), P.dot(H.T)
    S = H.dot(cross) + R.matrix
    K = cross.dot(contract.inverse(S)) if P.dtype == np.float64 else contract.solve(S, cross.T).T  # filterpy inverts S
    left = contract.identity(len(P), P) - K.dot(H)
    after = left.dot(P).dot(left.T) + K.dot(R.matrix).dot(K.T)
    if P.dtype == np.float64:
        after = symmetric(after)
    if perfect:
        after = rounding.corrected(after, P, K, H, S, R.matrix)
    return CovarianceState(x + K.dot(nu), after), contract.evidence(nu, S)
