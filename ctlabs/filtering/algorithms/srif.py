r"""The square-root information filter (SRIF): the data equation :math:`\rho x = b + \text{noise}`, of unit covariance.

ρ is upper triangular, :math:`P^{-1} = \rho^T\rho,\ \hat x = \rho^{-1}b`. Measurements are equations that join it; an
orthogonal transformation from the left restores the triangle, and what it leaves is the residual e:

.. math:: \Theta\begin{bmatrix}R^{-1/2}H & R^{-1/2}z\\ \rho_- & b_-\end{bmatrix}
          = \begin{bmatrix}\rho_+ & b_+\\ 0 & e\end{bmatrix}, \qquad e^Te = \nu^TS^{-1}\nu, \quad
          \det S = \det R\,(\det\rho_+/\det\rho_-)^2

For the prediction the noise w of unit covariance has the data equation w = 0. With Θ that brings
:math:`[\Phi,\ Q^{1/2}]` to the triangle [T, 0], the unknowns Θᵀ(x, w) = (u, v) give x⁻ = Tu + c; v is eliminated, and
:math:`\rho_- = \rho_uT^{-1},\ b_- = b_u + \rho_-c`. Bierman's equations, :math:`\rho\Phi^{-1}(x^- - Q^{1/2}w - c) = b`,
are the same without the inverse of Φ. Equations enter in order of size, the largest first: then rounding in a large
one, a precise measurement, does not touch a small one.

Source: Dyer & McReynolds, J. Optimization Theory and Applications 3 (1969) 444–458; Bierman, *Factorization Methods for
Discrete Sequential Estimation* (1977), chapters V and VI; Cox & Higham, BIT 38 (1998) 34–50 (order of the equations).

Operations per step (leading terms, s = rank of Q): 17n³/3 + 12sn² + 8s²n + 4s³/3 for the prediction, 4n³/3 + 2mn²
+ m²n for the update.

R = 0 and singular R: no · singular Q: yes · singular P0: no · singular Φ: where ΦPΦᵀ + Q is regular.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ctlabs.filtering.algorithms import contract
from ctlabs.filtering.algorithms.contract import Evidence, Noise, Numbers
from ctlabs.models import DiscreteModel

EPS = float(np.finfo(float).eps)


class State(NamedTuple):
    """``rho`` (n, n), upper triangular · ``b`` (n, runs)."""

    rho: Numbers
    b: Numbers

    @property
    def mean(self) -> Numbers:
        """The estimate, (n, runs)."""
        return contract.substituted_back(self.rho, self.b)

    @property
    def covariance(self) -> Numbers:
        """The covariance of its error, (n, n)."""
        root = contract.substituted_back(self.rho, contract.identity(len(self.rho), self.rho))
        return root @ root.T


def start(model: DiscreteModel, P0: Numbers) -> State:
    """The state at t0."""
    if not contract.definite(contract.known("srif", P0)):
        contract.refuse("srif", "a P0 with an inverse", "a singular one")
    lower = contract.inverse(Noise(P0).root)
    rho = contract.triangular(lower.T.copy()).T
    return State(rho, rho @ contract.column(model, P0))


def predict(state: State, Phi: Numbers, c: Numbers | None, Q: Noise) -> State:
    """One step ahead."""
    (rho, b), (n, s) = state, Q.thin.shape
    units = _units(rho)
    both = np.hstack([Phi * units, Q.thin])[::-1]  # from the last row up: T is upper triangular, and so is ρ
    w = np.hstack([contract.zeros((s, n), rho), contract.identity(s, rho)])
    x = np.hstack([rho * units, contract.zeros((n, s), rho)])
    turned = contract.triangularised(np.vstack([both, w, x]), n)
    T = turned[:n, :n][::-1, ::-1]
    if (np.abs(contract.doubles(T.diagonal())) <= 16 * n * EPS * _size(contract.doubles(both[::-1]))).any():
        contract.refuse("srif", "ΦPΦᵀ + Q with an inverse", "a singular Φ whose null space Q does not fill")
    unknown = np.hstack([turned[n:, n:], turned[n:, :n][:, ::-1]])  # v, then u
    equations = np.hstack([unknown, np.vstack([contract.zeros((s, b.shape[1]), b), b])])
    left = _triangle(equations, s + n, s)
    rho = contract.substituted(T.T.copy(), left[s : s + n, s:]).T.copy()
    b = left[s + n :, s:].T
    return State(rho, b if c is None else b + rho @ c)


def update(state: State, z: Numbers, H: Numbers, R: Noise) -> tuple[State, Evidence]:
    """One instant's measurements, all at once."""
    if R.singular:
        contract.refuse("srif", "an R with an inverse", "a perfect measurement (a singular R)")
    (rho, b), n = state, H.shape[1]
    b = np.repeat(b, z.shape[1] // b.shape[1], axis=1)  # of one run until data of several come in
    own = contract.substituted(R.root, np.hstack([H, z]))
    left = _triangle(np.vstack([own, np.hstack([rho, b])]), n, n)
    after = State(left[:n, :n].T.copy(), left[n:, :n].T.copy())
    S_root = R.root.diagonal().copy()
    S_root[0] = S_root[0] * np.prod(after.rho.diagonal() / rho.diagonal())  # the product is √det S
    return after, contract.whitened(left[n:, n:].T, S_root)




def _triangle(equations: Numbers, unknown: int, first: int) -> Numbers:
    """The triangle, transposed, that orthogonal transformations from the left make of equations (rows).

    Its first ``unknown`` columns are the unknowns'. The equations are put in the order of their size in the ``first`` ones.
    """
    order = np.argsort(-_size(contract.doubles(equations[:, :first])), kind="stable")
    return contract.triangularised(equations[order].T.copy(), unknown)


def _size(rows: Numbers) -> Numbers:
    """The largest element of each row."""
    return np.abs(rows).max(axis=1, initial=0.0)


def _units(rho: Numbers) -> Numbers:
    """Units of the states in which they are known about equally well: rotations may then mix metres and radians.

    Powers of 2, so that nothing is rounded.
    """
    return contract.like(2.0 ** -np.round(np.log2(_size(contract.doubles(rho.T)))), rho)
