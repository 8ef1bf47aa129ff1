r"""The conventional covariance form: the short formula for P.

.. math:: P^- = \Phi P^+\Phi^T + Q, \qquad S = HP^-H^T + R,\quad K = P^-H^TS^{-1}, \qquad
          \hat x^+ = \hat x^- + K(z - H\hat x^-),\quad P^+ = P^- - KHP^-

Source: Kalman (1960), J. Basic Engineering 82; Maybeck vol. 1, eq. 5-36 to 5-42.

Operations per step (leading terms): 4n³ for the prediction, 6mn² + 4m²n for the update.

R = 0: yes · singular Q, P0, Φ: yes. P⁺ is a difference: where a measurement is far
better than the prediction it loses as many digits as P⁻/P⁺ has, then its symmetry and its sign.
"""

from __future__ import annotations

from ctlabs.filtering.algorithms import contract
from ctlabs.filtering.algorithms.contract import CovarianceState, Evidence, Noise, Numbers
from ctlabs.models import DiscreteModel


def start(model: DiscreteModel, P0: Numbers) -> CovarianceState:
    """The state at t0."""
    return CovarianceState(contract.column(model, P0), contract.known("conventional", P0))


def predict(state: CovarianceState, Phi: Numbers, c: Numbers | None, Q: Noise) -> CovarianceState:
    """One step ahead."""
    return CovarianceState(contract.moved(Phi, state.x, c), Phi @ state.P @ Phi.T + Q.matrix)


def update(state: CovarianceState, z: Numbers, H: Numbers, R: Noise) -> tuple[CovarianceState, Evidence]:
    """One instant's measurements, all at once."""
    x, P = state
    cross = P @ H.T
    S = H @ cross + R.matrix
    K = contract.solve(S.T, cross.T).T
    nu = z - H @ x
    return CovarianceState(x + K @ nu, P - K @ (H @ P)), contract.evidence(nu, S)
