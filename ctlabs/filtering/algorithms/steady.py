r"""The steady-gain form: the gain's limit from the first step on, and no covariances to compute.

.. math:: \hat x^- = \Phi\hat x^+ + c, \qquad \hat x^+ = \hat x^- + K_\infty(z - H\hat x^-)

with K∞ of :func:`ctlabs.filtering.steady.solve`. The covariances it tells are the limits P∞⁻, P∞⁺ (P0 at t0): what the filter
claims, right once the optimal filter has settled. Before that its error is larger than the optimal filter's;
:func:`ctlabs.analysis.sensitivity.actual` says by how much.

Source: Maybeck vol. 1, section 5.8; Anderson & Moore, *Optimal Filtering* (1979), section 4.4.

Operations per step: 2n² for the prediction, 4mn for the update.

R = 0, singular Q, P0, Φ: yes, where the limit exists · matrices that vary, missing
elements, instants without a measurement: no, the gain then has no limit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ctlabs.filtering import steady
from ctlabs.filtering.algorithms import contract
from ctlabs.filtering.algorithms.contract import Evidence, Noise, Numbers
from ctlabs.models import DiscreteModel


class Limits(NamedTuple):
    """``P_minus``, ``P_plus`` (n, n) · ``K`` (n, m), ``S`` (m, m) of the elements that enter the steady update."""

    P_minus: Numbers
    P_plus: Numbers
    K: Numbers
    S: Numbers


class State(NamedTuple):
    """``x`` (n, runs) · ``P`` (n, n), the covariance claimed · ``waiting``: predicted, and not yet updated."""

    x: Numbers
    P: Numbers
    waiting: bool
    limits: Limits

    @property
    def mean(self) -> Numbers:
        """The estimate, (n, runs)."""
        return self.x

    @property
    def covariance(self) -> Numbers:
        """The covariance that the filter claims, (n, n)."""
        return self.P


def start(model: DiscreteModel, P0: Numbers) -> State:
    """The state at t0."""
    contract.known("steady", P0)
    try:
        found = steady.solve(model)
    except ValueError as error:
        msg = f"form steady: {error}"
        raise ValueError(msg) from error
    used = np.isfinite(np.diag(found.S))
    parts = (found.P_minus, found.P_plus, found.K[:, used], found.S[np.ix_(used, used)])
    return State(contract.column(model, P0), P0, False, Limits(*(contract.like(part, P0) for part in parts)))


def predict(state: State, Phi: Numbers, c: Numbers | None, Q: Noise) -> State:  # noqa: ARG001  # the limit knows Q
    """One step ahead."""
    if state.waiting:
        _absent(state.limits, 0)
    return State(contract.moved(Phi, state.x, c), state.limits.P_minus, bool(len(state.limits.S)), state.limits)


def update(state: State, z: Numbers, H: Numbers, R: Noise) -> tuple[State, Evidence]:  # noqa: ARG001  # nor R
    """One instant's measurements, all at once."""
    limits = state.limits
    if len(z) != len(limits.S):
        _absent(limits, len(z))
    nu = z - H @ state.x
    return State(state.x + limits.K @ nu, limits.P_plus, False, limits), contract.evidence(nu, limits.S)




def _absent(limits: Limits, received: int) -> None:
    expected = f"{len(limits.S)} measured elements at every instant (the gain has no limit otherwise)"
    contract.refuse("steady", expected, f"{received} at one")
