r"""Bierman's and Thornton's factors: :math:`P = U\,\mathrm{diag}(d)\,U^T`, U unit upper triangular; no square roots.

Correlated noises are separated first (:func:`~ctlabs.filtering.algorithms.contract.decorrelated`); then for each row h with its
variance r, with a = Uᵀh, b = diag(d)a, s₀ = r and K = 0 to begin with, for the columns j = 1 … n (Bierman's update)

.. math:: s_j = s_{j-1} + a_jb_j,\quad d_j \leftarrow d_j\,s_{j-1}/s_j,\quad
          U_j \leftarrow U_j - (a_j/s_{j-1})K,\quad K \leftarrow K + b_jU_j\ \text{(the old column)}

and in the end the gain is K/sₙ. The prediction is Thornton's: weighted Gram–Schmidt of the rows of [ΦU, L_Q] with the
weights (d, d_Q), from the last row up (:func:`ctlabs.filtering.algorithms.ld.gram_schmidt`).

Source: Bierman, *Factorization Methods for Discrete Sequential Estimation* (1977), chapters V (update) and VI
(prediction); Maybeck vol. 1, section 7.7; Thornton & Bierman, in *Control and Dynamic Systems* 16 (1980).

Operations per step (leading terms, s = rank of Q): 4n³ + 2sn² for the prediction, 4n² for each of m elements.

R = 0 and singular R: yes · singular Q, P0, Φ: yes.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ctlabs.filtering.algorithms import contract
from ctlabs.filtering.algorithms.contract import Evidence, Noise, Numbers
from ctlabs.filtering.algorithms.ld import gram_schmidt
from ctlabs.models import DiscreteModel


class State(NamedTuple):
    """``x`` (n, runs) · ``U`` (n, n), unit upper triangular, and ``d`` (n,): P = U diag(d) Uᵀ."""

    x: Numbers
    U: Numbers
    d: Numbers

    @property
    def mean(self) -> Numbers:
        """The estimate, (n, runs)."""
        return self.x

    @property
    def covariance(self) -> Numbers:
        """The covariance of its error, (n, n)."""
        return (self.U * self.d) @ self.U.T


def start(model: DiscreteModel, P0: Numbers) -> State:
    """The state at t0."""
    P = Noise(contract.known("ud", P0)[::-1, ::-1].copy())  # U comes from below, L from above
    return State(contract.column(model, P0), P.L[::-1, ::-1].copy(), P.d[::-1].copy())


def predict(state: State, Phi: Numbers, c: Numbers | None, Q: Noise) -> State:
    """One step ahead."""
    rows, weights = np.hstack([Phi @ state.U, Q.thin_L]), np.concatenate([state.d, Q.thin_d])
    L, d = gram_schmidt(rows[::-1], weights)
    return State(contract.moved(Phi, state.x, c), L[::-1, ::-1].copy(), d[::-1].copy())


def update(state: State, z: Numbers, H: Numbers, R: Noise) -> tuple[State, Evidence]:
    """One instant's measurements, one element after another."""
    x, U, d = state
    z, H, variances = contract.decorrelated(z, H, R)
    nu, s = [], []
    for i, h in enumerate(H):
        U, d, K, after = _measured(U, d, h, variances[i])
        nu.append(z[i] - h @ x)
        s.append(after)
        if after:
            x = x + np.outer(K / after, nu[i])
    return State(x, U, d), contract.independent(np.array(nu), np.array(s))


def _measured(U: Numbers, d: Numbers, h: Numbers, s: Any) -> tuple[Numbers, Numbers, Numbers, Any]:
    """U and d after one element of variance s, Ph, and the variance of the innovation; s = 0 is no exception."""
    a = U.T @ h
    b, U, d, K = d * a, U.copy(), d.copy(), contract.zeros(len(d), d)
    for j in np.flatnonzero(contract.doubles(b)):
        after, old = s + a[j] * b[j], U[:j, j].copy()
        d[j] = d[j] * (s / after)
        if s:
            U[:j, j] = old - K[:j] * (a[j] / s)
        K[:j] = K[:j] + old * b[j]
        K[j], s = b[j], after
    return U, d, K, s
