r"""The array in LD factors: :math:`P = L\,\mathrm{diag}(d)\,L^T`, without square roots, by weighted Gram–Schmidt.

.. math:: [\Phi L_+,\ L_Q]\ \text{with weights}\ (d_+, d_Q) \to L_-, d_-; \qquad
          \begin{bmatrix}L_R & HL_-\\ 0 & L_-\end{bmatrix}\ \text{with weights}\ (d_R, d_-) \to
          \begin{bmatrix}L_S & 0\\ \bar K & L_+\end{bmatrix},\ (d_S, d_+)

.. math:: S = L_S\,\mathrm{diag}(d_S)\,L_S^T, \qquad \hat x^+ = \hat x^- + \bar K\,L_S^{-1}(z - H\hat x^-)

where rows A with weights W become A = LV, the rows of V orthogonal in W with squares d. All L are unit lower triangular:
nothing is divided to find the correction of the state. It is the dual of UD (:mod:`ctlabs.filtering.algorithms.ud`): factors from
above instead of from below, and the whole vector at once instead of element by element.

Source: Jover & Kailath, A parallel architecture for Kalman filter measurement update and parameter estimation,
Automatica 22 (1986) 43–57; Björck & Paige, SIAM J. Matrix Anal. Appl. 13 (1992) 176–190 (why Gram–Schmidt will do).

Operations per step (leading terms, s = rank of Q): 4n³ + 2sn² for the prediction, 2(m+n)³ + 2mn² for the update.

R = 0 and singular R: yes · singular Q, P0, Φ: yes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ctlabs.filtering.algorithms import contract
from ctlabs.filtering.algorithms.contract import Evidence, Noise, Numbers
from ctlabs.models import DiscreteModel

#: What is left of a row below this fraction of it, for each of its elements, is rounding.
EPS = float(np.finfo(float).eps)


class State(NamedTuple):
    """``x`` (n, runs) · ``L`` (n, n), unit lower triangular, and ``d`` (n,): P = L diag(d) Lᵀ."""

    x: Numbers
    L: Numbers
    d: Numbers

    @property
    def mean(self) -> Numbers:
        """The estimate, (n, runs)."""
        return self.x

    @property
    def covariance(self) -> Numbers:
        """The covariance of its error, (n, n)."""
        return (self.L * self.d) @ self.L.T


def start(model: DiscreteModel, P0: Numbers) -> State:
    """The state at t0."""
    P = Noise(contract.known("ld", P0))
    return State(contract.column(model, P0), P.L, P.d)


def predict(state: State, Phi: Numbers, c: Numbers | None, Q: Noise) -> State:
    """One step ahead."""
    rows, weights = np.hstack([Phi @ state.L, Q.thin_L]), np.concatenate([state.d, Q.thin_d])
    return State(contract.moved(Phi, state.x, c), *gram_schmidt(rows, weights))


def update(state: State, z: Numbers, H: Numbers, R: Noise) -> tuple[State, Evidence]:
    """One instant's measurements, all at once."""
    (x, L, d), m = state, len(H)
    rows = np.block([[R.L, H @ L], [contract.zeros(H.T.shape, L), L]])
    after, squares = gram_schmidt(rows, np.concatenate([R.d, d]))
    e = contract.substituted(after[:m, :m], z - H @ x)
    return State(x + after[m:, :m] @ e, after[m:, m:], squares[m:]), contract.independent(e, squares[:m])


def gram_schmidt(rows: Numbers, weights: Numbers) -> tuple[Numbers, Numbers]:
    """L (p, p), unit lower triangular, and d (p,) with A·diag(w)·Aᵀ = L·diag(d)·Lᵀ, for rows A (p, q), weights w (q,).

    Modified Gram–Schmidt: each row is taken from those after it as soon as it is there. Rounding may leave the rows
    less than orthogonal; the factors are right all the same. A row that depends on those before it has d = 0.

    >>> gram_schmidt(np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([1.0, 3.0]))
    (array([[1.  , 0.  ],
           [0.75, 1.  ]]), array([4.  , 0.75]))
    """
    V, (p, q) = rows.copy(), rows.shape
    L, d = contract.identity(p, rows).copy(), contract.zeros(p, rows)
    for j in range(p):
        weighted = V[j] * weights
        square = V[j] @ weighted
        if square <= ((q * EPS) ** 2 * ((L[j, :j] * L[j, :j]) @ d[:j]) if j else 0.0):
            continue
        d[j] = square
        if j + 1 < p:
            L[j + 1 :, j] = V[j + 1 :] @ weighted / square
            V[j + 1 :] = V[j + 1 :] - np.outer(L[j + 1 :, j], V[j])
    return L, d
