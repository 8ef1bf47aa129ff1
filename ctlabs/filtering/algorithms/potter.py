r"""Potter's square root: the filter carries S with :math:`P = SS^T`, so P cannot lose its sign.

Correlated noises are separated first (:func:`~ctlabs.filtering.algorithms.contract.decorrelated`); then for each row h with its
variance d

.. math:: f = S^Th,\quad s = f^Tf + d,\quad K = Sf/s, \qquad
          S \leftarrow S - \frac{(Sf)f^T}{s + \sqrt{sd}}, \quad \hat x \leftarrow \hat x + K(z - h^T\hat x)

The prediction makes one triangle of :math:`[\Phi S,\ Q^{1/2}]` by orthogonal transformations; the updates fill it again.

Source: Battin, *Astronautical Guidance* (1964), section 9.5 (Potter's algorithm); Bierman, *Factorization Methods for
Discrete Sequential Estimation* (1977), chapter V; Maybeck vol. 1, sections 7.3 to 7.5.

Operations per step (leading terms, s = rank of Q): 10n³/3 + 2sn² for the prediction, 6n² for each of m elements.

R = 0 and singular R: yes · singular Q, P0, Φ: yes.
"""

from __future__ import annotations

import numpy as np

from ctlabs.filtering.algorithms import array, contract
from ctlabs.filtering.algorithms.contract import Evidence, Noise, Numbers, RootState
from ctlabs.models import DiscreteModel


def start(model: DiscreteModel, P0: Numbers) -> RootState:
    """The state at t0."""
    return RootState(contract.column(model, P0), Noise(contract.known("potter", P0)).root)


#: One step ahead.
predict = array.predict


def update(state: RootState, z: Numbers, H: Numbers, R: Noise) -> tuple[RootState, Evidence]:
    """One instant's measurements, one element after another."""
    x, S = state
    z, H, d = contract.decorrelated(z, H, R)
    nu, s = [], []
    for i, h in enumerate(H):
        f = S.T @ h
        nu.append(z[i] - h @ x)
        s.append(f @ f + d[i])
        if not s[i]:
            continue
        Sf = S @ f
        x = x + np.outer(Sf / s[i], nu[i])
        S = S - np.outer(Sf, f / (s[i] + (s[i] * d[i]) ** 0.5))
    return RootState(x, S), contract.independent(np.array(nu), np.array(s))
