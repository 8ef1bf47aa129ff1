"""The update that follows a steady prediction, with the digits that the prediction has."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ctlabs.linalg import manyfold
from ctlabs.linalg.checks import Array
from ctlabs.linalg.manyfold import Manyfold
from ctlabs.linalg.riccati import NOTHING, Solution, power


class Updated(NamedTuple):
    """After the update.

    ``P`` (n, n) · ``K`` (n, m) · ``S`` (m, m) · ``error``, the bound for P as in :class:`.riccati.Solution`
    """

    P: Array
    K: Array
    S: Array
    error: float


def updated(before: Solution, H: Array, R: Array) -> Updated:
    r"""The update of P⁻ by measurements with an S that has an inverse.

    .. math:: P^+ = (I - KH)P^-(I - KH)^T + KRK^T - rS^{-1}r^T, \quad r = KS - P^-H^T

    with K as rounded; r is what that costs. An error between ∓Y of P⁻ leaves one between ∓(I − KH)Y(I − KH)ᵀ.
    """
    x = power(np.diag(before.P.high))
    z = power(np.diag(H @ before.P.high @ H.T) + np.diag(R))
    P, H, R = Manyfold.of(before.P.scaled(1 / x, 1 / x), 2), H * x / z[:, None], R / np.outer(z, z)
    PH = P @ H.T
    S = H @ PH + R
    K = manyfold.solve(S, PH.T).T
    left, miss = np.eye(len(x)) - K @ H, K @ S - PH
    after = (left @ P @ left.T + K @ R @ K.T - miss @ manyfold.solve(S, miss.T)).symmetric
    reach = left.high @ (before.reach / np.outer(x, x)) @ left.high.T
    variance, sd = np.diag(after.high), np.sqrt(np.maximum(np.diag(P.high), 0.0))
    terms = (sd + np.abs(K.high) @ (np.abs(H) @ sd + np.sqrt(np.diag(R)))) ** 2
    zero = variance <= NOTHING ** (P.fold / 2) * terms
    own = np.where(zero, 1.0, variance)
    doubt = np.diag(reach) + manyfold.rounding(P.fold) * 8 * len(x) ** 2 * terms
    part = float(np.where(zero, 0.0, doubt / own).max(initial=0.0)) + np.finfo(float).eps
    absolute = float((np.where(zero, doubt + np.abs(variance), 0.0) * x * x.max(initial=0.0)).max(initial=0.0))
    found = np.where(zero[:, None] | zero, 0.0, after.high) * np.outer(x, x)
    return Updated(found, K.high * x[:, None] / z, S.high * np.outer(z, z), max(part, absolute))
