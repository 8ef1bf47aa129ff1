r"""The array square root (SRCF): a prediction and an update are one orthogonal transformation each.

.. math:: [\Phi P_+^{1/2},\ Q^{1/2}]\,\Theta_1 = [P_-^{1/2},\ 0], \qquad
          \begin{bmatrix}R^{1/2} & HP_-^{1/2}\\ 0 & P_-^{1/2}\end{bmatrix}\Theta_2
          = \begin{bmatrix}S^{1/2} & 0\\ \bar K & P_+^{1/2}\end{bmatrix}

.. math:: \bar K = P^-H^TS^{-T/2}, \qquad \hat x^+ = \hat x^- + \bar K\,S^{-1/2}(z - H\hat x^-)

All factors are lower triangular. Multiplying each side by its transpose gives the filter's equations, without a
covariance ever being formed; noises may be correlated, no element is taken apart.

Source: Kaminski, Bryson & Schmidt, IEEE Trans. AC-16 (1971) 727–736; Morf & Kailath, IEEE Trans. AC-20 (1975) 487–497;
Verhaegen & Van Dooren, IEEE Trans. AC-31 (1986) 907–917 (SRCF); Kailath, Sayed & Hassibi, *Linear Estimation*,
chapter 12.

Operations per step (leading terms, s = rank of Q): 10n³/3 + 2sn² for the prediction, 4(m+n)³/3 + 2mn² for the update.

R = 0 and singular R: yes · singular Q, P0, Φ: yes.
"""

from __future__ import annotations

import numpy as np

from ctlabs.filtering.algorithms import contract
from ctlabs.filtering.algorithms.contract import Evidence, Noise, Numbers, RootState
from ctlabs.models import DiscreteModel


def start(model: DiscreteModel, P0: Numbers) -> RootState:
    """The state at t0."""
    return RootState(contract.column(model, P0), Noise(contract.known("array", P0)).root)


def predict(state: RootState, Phi: Numbers, c: Numbers | None, Q: Noise) -> RootState:
    """One step ahead."""
    return RootState(contract.moved(Phi, state.x, c), contract.triangular(np.concatenate((Phi.dot(state.root), Q.thin), axis=1)))


def update(state: RootState, z: Numbers, H: Numbers, R: Noise) -> tuple[RootState, Evidence]:
    """One instant's measurements, all at once."""
    x, m = state.x, len(H)
    after = contract.triangular(pre_array(state.root, H, R))
    S_root, K_bar, root = after[:m, :m], after[m:, :m], after[m:, m:]
    nu, pivots = z - H.dot(x), contract.doubles(S_root.diagonal())
    if not pivots.all():  # an element without noise and known already: its column is zero throughout
        told = pivots != 0
        nu, S_root, K_bar = nu[told], S_root[np.ix_(told, told)], K_bar[:, told]
    e = contract.substituted(S_root, nu) if len(nu) else nu
    return RootState(x + K_bar.dot(e), root), contract.whitened(e, S_root.diagonal())


def pre_array(root: Numbers, H: Numbers, R: Noise) -> Numbers:
    """[R½, HP½; 0, P½], (m+n, m+n)."""
    m, n = H.shape
    made = contract.zeros((m + n, m + n), root)
    made[:m, :m], made[:m, m:], made[m:, m:] = R.root, H.dot(root), root
    return made
