r"""The extended array square root (eSRCF): the innovation and the correction of the state come out of the array too.

One more row rides along with the array of the SRCF (:mod:`ctlabs.filtering.algorithms.array`):

.. math:: \begin{bmatrix}R^{1/2} & HP_-^{1/2}\\ 0 & P_-^{1/2}\\ -\nu^TR^{-T/2} & 0\end{bmatrix}\Theta
          = \begin{bmatrix}S^{1/2} & 0\\ \bar K & P_+^{1/2}\\ -\bar e^T & y^T\end{bmatrix}, \qquad
          \nu = z - H\hat x^-

The products of its rows with the others are the same on both sides: :math:`S^{1/2}\bar e = \nu` and
:math:`P_+^{1/2}y = \bar K\bar e = K\nu`. So :math:`\hat x^+ = \hat x^- + P_+^{1/2}y`, and ē is the whitened innovation:
nothing is solved with S½. Park and Kailath's row is :math:`[-z^TR^{-T/2},\ \hat x_-^TP_-^{-T/2}]`, which needs a regular
P; here x̂⁻ is taken as the origin, where that row begins with 0 and nothing of P is inverted. The prediction is that
of the SRCF: with this origin its row of the state would be zero.

Source: Park & Kailath, New square-root algorithms for Kalman filtering, IEEE Trans. AC-40 (1995) 895–899 (eSRCF);
Kailath, Sayed & Hassibi, *Linear Estimation*, chapter 12.

Operations per step (leading terms, s = rank of Q): 10n³/3 + 2sn² for the prediction, 4(m+n)³/3 + 2mn² and 2(m+n)² for
each run for the update.

R = 0 or singular R: no (the row needs R^{-1/2}) · singular Q, P0, Φ: yes. P is as
accurate as in the SRCF. The estimate is not: the row is as large as R^{-1/2}ν, and its rounding acts on the innovation
like an error of eps·√(HPHᵀ/R) of itself. Where measurements are 10⁴ times more precise than predictions, take the SRCF.
"""

from __future__ import annotations

import numpy as np

from ctlabs.filtering.algorithms import array, contract
from ctlabs.filtering.algorithms.contract import Evidence, Noise, Numbers, RootState
from ctlabs.models import DiscreteModel


def start(model: DiscreteModel, P0: Numbers) -> RootState:
    """The state at t0."""
    return RootState(contract.column(model, P0), Noise(contract.known("extended_array", P0)).root)


#: One step ahead.
predict = array.predict


def update(state: RootState, z: Numbers, H: Numbers, R: Noise) -> tuple[RootState, Evidence]:
    """One instant's measurements, all at once."""
    if R.singular:
        contract.refuse("extended_array", "a regular R", "a perfect measurement (a singular R)")
    (x, root), (m, n) = state, H.shape
    row = -contract.substituted(R.root, z - H @ x).T
    extended = np.vstack([array.pre_array(root, H, R), np.hstack([row, contract.zeros((len(row), n), root)])])
    after = contract.triangularised(extended, m + n)
    root, e, y = after[m : m + n, m:], -after[m + n :, :m].T, after[m + n :, m:].T
    return RootState(x + root @ y, root), contract.whitened(e, after.diagonal()[:m])
