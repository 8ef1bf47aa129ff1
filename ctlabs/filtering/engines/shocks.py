r"""Backward over the innovations of one record: what they say of a value added at one instant only.

With :math:`K_p = \Phi K + NR^+(I - HK)` the predictor's gain and :math:`L = \Phi(I-KH)` (both with Φ − NR⁺H for Φ where w and v correlate)

.. math:: u_k = S_k^{-1}\nu_k - K_p^Tr_{k+1}, \quad D_k = S_k^{-1} + K_p^TN_{k+1}K_p, \quad
          r_k = H^TS_k^{-1}\nu_k + L^Tr_{k+1}, \quad N_k = H^TS_k^{-1}H + L^TN_{k+1}L

from zeros behind the last instant: r_k and N_k are the score and the information of a value added to x_k, u_k and D_k those of one
added to z_k. No covariance but S is inverted.

Source: de Jong & Penzer (1998), J. Amer. Statist. Assoc. 93, 796–806.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ctlabs.filtering.engines.common import EPS, crossed_out, entry, helper, picked, picked_inverse
from ctlabs.linalg.checks import Array
from ctlabs.linalg.compiled import kernel


class ShockInputs(NamedTuple):
    """What the filter left: Phi (steps or 1, n, n), already Φ − NR⁺H, and M = NR⁺ (steps, n, m) or empty; H (steps+1 or 1, m, n),
    K (steps+1, n, m), S (steps+1, m, m), nu, used (steps+1, m).
    """

    Phi: Array
    M: Array
    H: Array
    K: Array
    S: Array
    nu: Array
    used: Array


class ShockOutputs(NamedTuple):
    """To be filled: r (steps+1, n), the diagonals of N (steps+1, n); u, the diagonals of D (steps+1, m); N of the first instant (n, n)."""

    r: Array
    N: Array
    u: Array
    D: Array
    N0: Array


@helper
def stepped(p: ShockInputs, k: int, pick: Array, count: int, Kp: Array, L: Array) -> None:
    """The predictor's gain Kp (n, m, the leading columns) and L (n, n) of the step after k."""
    n, Phi, H = p.K.shape[1], entry(p.Phi, k), entry(p.H, k)
    for i in range(n):
        for j in range(n):
            L[i, j] = Phi[i, j]
        for a in range(count):
            s = 0.0
            for h in range(n):
                s += Phi[i, h] * p.K[k, h, pick[a]]
            for j in range(n):
                L[i, j] -= s * H[pick[a], j]
            Kp[i, a] = s + p.M[k, i, pick[a]] if p.M.shape[0] > 0 else s


@helper
def carried(N: Array, L: Array, work: Array, size: Array, out: Array) -> None:
    """out = LᵀNL; ``size`` (n,), how much of each diagonal element may be rounding."""
    n = N.shape[0]
    for j in range(n):
        t = 0.0
        for i in range(n):
            t += abs(L[i, j]) * np.sqrt(abs(N[i, i]))
            s = 0.0
            for h in range(n):
                s += N[i, h] * L[h, j]
            work[i, j] = s
        size[j] = 32 * n * EPS * t * t
    for i in range(n):
        for j in range(i + 1):
            s = 0.0
            for h in range(n):
                s += L[h, i] * work[h, j]
            out[i, j] = s
            out[j, i] = s


@kernel
def backward(p: ShockInputs, begin: int, out: ShockOutputs) -> None:
    """Fill ``out`` from the last instant back to ``begin``."""
    last, n, m = p.K.shape[0] - 1, p.K.shape[1], p.K.shape[2]
    r, N, ahead = np.zeros(n), np.zeros((n, n)), np.zeros((n, n))
    u, C, inverse, D = np.zeros(m), np.zeros((m, m)), np.zeros((m, m)), np.zeros((m, m))
    Kp, L, work, size, pick = np.zeros((n, m)), np.zeros((n, n)), np.zeros((n, n)), np.zeros(n), np.empty(m, dtype=np.int64)
    for k in range(last, begin - 1, -1):
        H, count = entry(p.H, k), picked(p.used[k], pick)
        picked_inverse(p.S[k], pick, count, C, inverse)
        if k < last:
            stepped(p, k, pick, count, Kp, L)
        for a in range(count):
            u[a] = 0.0
            for b in range(count):
                u[a] += inverse[a, b] * p.nu[k, pick[b]]
            D[a, a] = inverse[a, a]
            if k < last:
                for i in range(n):
                    u[a] -= Kp[i, a] * r[i]
                    for j in range(n):
                        D[a, a] += Kp[i, a] * N[i, j] * Kp[j, a]
            out.u[k, pick[a]], out.D[k, pick[a]] = u[a], D[a, a]
        for j in range(n):
            size[j] = 0.0
            for i in range(n):
                ahead[i, j] = 0.0
        if k < last:
            carried(N, L, work, size, ahead)
            Phi = entry(p.Phi, k)
            for j in range(n):
                s = 0.0
                for i in range(n):
                    s += Phi[i, j] * r[i]
                work[0, j] = s
            for a in range(count):  # Φᵀr with Φ itself, of which p.Phi may be Φ − NR⁺H
                s = 0.0
                for i in range(n):
                    s += p.M[k, i, pick[a]] * r[i] if p.M.shape[0] > 0 else 0.0
                for j in range(n):
                    work[0, j] += s * H[pick[a], j]
        for j in range(n):
            r[j] = work[0, j] if k < last else 0.0
            for a in range(count):
                r[j] += H[pick[a], j] * u[a]
                for i in range(n):
                    for b in range(count):
                        ahead[i, j] += H[pick[b], i] * inverse[b, a] * H[pick[a], j]
        for j in range(n):
            if ahead[j, j] <= size[j]:
                crossed_out(ahead, j)
                r[j] = 0.0
            out.r[k, j], out.N[k, j] = r[j], ahead[j, j]
        N, ahead = ahead, N
    for i in range(n):
        for j in range(n):
            out.N0[i, j] = N[i, j]
