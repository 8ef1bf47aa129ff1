r"""Carlson's triangular square root: P = CCᵀ with C upper triangular, and it stays so through every update.

Correlated noises are separated first (:func:`~ctlabs.filtering.algorithms.contract.decorrelated`); then for each row h with its
variance d, with f = Cᵀh, a = d and e = 0 to begin with, for the columns j = 1 … n of C

.. math:: a' = a + f_j^2, \qquad C_j \leftarrow \sqrt{a/a'}\,C_j - \frac{f_j}{\sqrt{aa'}}\,e, \qquad
          e \leftarrow e + f_jC_j\ \text{(the old column)},\quad a \leftarrow a'

and in the end s = a, K = e/s. Column j of C and e are zero below j: a triangle remains. The prediction makes a triangle
of :math:`[\Phi C,\ Q^{1/2}]` by orthogonal transformations, from the last row up.

Source: Carlson, Fast triangular formulation of the square root filter, AIAA Journal 11 (1973) 1259–1265.

Operations per step (leading terms, s = rank of Q): 10n³/3 + 2sn² for the prediction, 4.5n² for each of m elements.

R = 0 and singular R: yes · singular Q, P0, Φ: yes.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ctlabs.filtering.algorithms import contract
from ctlabs.filtering.algorithms.contract import Evidence, Noise, Numbers, RootState
from ctlabs.models import DiscreteModel


def start(model: DiscreteModel, P0: Numbers) -> RootState:
    """The state at t0."""
    root = Noise(contract.known("carlson", P0)[::-1, ::-1].copy()).root  # lower, from above; reversed, upper from below
    return RootState(contract.column(model, P0), root[::-1, ::-1].copy())


def predict(state: RootState, Phi: Numbers, c: Numbers | None, Q: Noise) -> RootState:
    """One step ahead."""
    lower = contract.triangular(np.hstack([Phi @ state.root, Q.thin])[::-1].copy())
    return RootState(contract.moved(Phi, state.x, c), lower[::-1, ::-1].copy())


def update(state: RootState, z: Numbers, H: Numbers, R: Noise) -> tuple[RootState, Evidence]:
    """One instant's measurements, one element after another."""
    x, C = state
    z, H, d = contract.decorrelated(z, H, R)
    nu, s = [], []
    for i, h in enumerate(H):
        C, e, a = _measured(C, h, d[i])
        nu.append(z[i] - h @ x)
        s.append(a)
        if a:
            x = x + np.outer(e / a, nu[i])
    return RootState(x, C), contract.independent(np.array(nu), np.array(s))


def _measured(C: Numbers, h: Numbers, a: Any) -> tuple[Numbers, Numbers, Any]:
    """C after one element, e = Ph and s; without noise (a = 0) the first column that it sees becomes zero."""
    f, C, e = C.T @ h, C.copy(), contract.zeros(len(h), C)
    for j in np.flatnonzero(contract.doubles(f)):
        after, old = a + f[j] * f[j], C[: j + 1, j].copy()
        C[: j + 1, j] = (a / after) ** 0.5 * old
        if a:
            C[:j, j] = C[:j, j] - f[j] / (a * after) ** 0.5 * e[:j]
        e[: j + 1] = e[: j + 1] + f[j] * old
        a = after
    return C, e, a
