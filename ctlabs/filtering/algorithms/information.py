r"""The information form: Y = P⁻¹ and y = Yx̂ in place of P and x̂.

.. math:: Y^+ = Y^- + H^TR^{-1}H, \qquad y^+ = y^- + H^TR^{-1}z

.. math:: M = \Phi^{-T}Y\Phi^{-1},\quad J = MG(G^TMG + D^{-1})^{-1}, \qquad
          Y^- = (I-JG^T)M(I-JG^T)^T + JD^{-1}J^T, \quad y^- = (I-JG^T)\Phi^{-T}y + Y^-c

with Q = GDGᵀ of full rank s: a prediction has the shape of an update. An update is a sum, and costs the least of all
where measurements are many; the estimate itself takes a solution of Yx̂ = y.

Source: Maybeck vol. 1, section 5.7; Anderson & Moore, *Optimal Filtering* (1979), section 6.3; the prediction in
Joseph's form is the dual of :mod:`ctlabs.filtering.algorithms.joseph`.

Operations per step (leading terms): 2m²n + 2mn² for the update, (32/3)n³ + 6sn² + 4s²n + 2s³/3 for the prediction.

R = 0 and singular R: no · singular Q: yes · singular P0: no (it has no inverse) · singular Φ: no. What Y adds up it
rounds to the size of the sum: where one combination of states is known far better than another, the poorly known one is lost.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ctlabs.filtering.algorithms import contract
from ctlabs.filtering.algorithms.contract import Counted, Evidence, Noise, Numbers
from ctlabs.models import DiscreteModel


class State(NamedTuple):
    """``Y`` (n, n) · ``y`` (n, runs)."""

    Y: Numbers
    y: Numbers

    @property
    def mean(self) -> Numbers:
        """The estimate, (n, runs)."""
        C = contract.cholesky(self.Y)
        return contract.substituted_back(C.T, contract.substituted(C, self.y))

    @property
    def covariance(self) -> Numbers:
        """The covariance of its error, (n, n)."""
        root = contract.substituted(contract.cholesky(self.Y), contract.identity(len(self.Y), self.Y))
        return root.T @ root


def start(model: DiscreteModel, P0: Numbers) -> State:
    """The state at t0."""
    if not contract.definite(contract.known("information", P0)):
        contract.refuse("information", "a P0 with an inverse", "a singular one")
    Y = contract.inverse(P0)
    return State(Y, Y @ contract.column(model, P0))


def predict(state: State, Phi: Numbers, c: Numbers | None, Q: Noise) -> State:
    """One step ahead."""
    back = _inverse(Phi)
    M, y = back.T @ state.Y @ back, back.T @ state.y
    G, d = Q.thin_L, Q.thin_d
    if len(d):
        MG = M @ G
        J = contract.solve(G.T @ MG + np.diag(1 / d), MG.T).T
        left = contract.identity(len(M), M) - J @ G.T
        M, y = left @ M @ left.T + (J / d) @ J.T, left @ y
    return State(M, y if c is None else y + M @ c)


def update(state: State, z: Numbers, H: Numbers, R: Noise) -> tuple[State, Evidence]:
    """One instant's measurements, all at once."""
    if R.singular:
        contract.refuse("information", "an R with an inverse", "a perfect measurement (singular R)")
    own, rows, d = contract.decorrelated(z, H, R)
    weighted = rows.T / d
    Y, y = state.Y + weighted @ rows, state.y + weighted @ own
    return State(Y, y), _evidence(state, z, H, R)




def _evidence(state: State, z: Numbers, H: Numbers, R: Noise) -> Evidence:
    """Of ν = z − HY⁻¹y with S = HY⁻¹Hᵀ + R."""
    if contract.kind_of(z) is Counted:  # what no estimate needs is not counted
        return contract.independent(z, R.matrix.diagonal())
    both = contract.substituted(contract.cholesky(state.Y), np.hstack([H.T, state.y]))
    root, e = both[:, : len(H)], both[:, len(H) :]
    return contract.evidence(z - root.T @ e, root.T @ root + R.matrix)


def _inverse(Phi: Numbers) -> Numbers:
    """Φ⁻¹, refused where Φ has none, or none that rounding leaves a digit of."""
    try:
        back = contract.inverse(Phi)
    except np.linalg.LinAlgError:
        contract.refuse("information", "a Phi with an inverse", "a singular one")
    both, limit = (
        np.abs(contract.doubles(back)) @ np.abs(contract.doubles(Phi)),
        1 / (16 * len(Phi) * np.finfo(float).eps),
    )
    # Its elements have units; its largest eigenvalue has none, but takes longer.
    if both.max() > limit and np.abs(np.linalg.eigvals(both)).max() > limit:
        contract.refuse("information", "a Phi with an inverse", "one singular to rounding")
    return back
