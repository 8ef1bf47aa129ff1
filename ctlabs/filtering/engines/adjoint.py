r"""Back through a filtered record: the derivatives of its log-likelihood by every matrix of the model.

After the instant k the record has a density whose logarithm depends on what is known then, x̂ and P. With the gradient r by x̂ its
gradient by P is :math:`\tfrac12(rr^T - N)`, as of any Gaussian of mean Ax̂ and covariance APAᵀ + V. Through an update,

.. math:: u = S^{-1}\nu - K^Tr^+, \quad D = S^{-1} + K^TN^+K, \quad
          r^- = H^Tu + r^+, \quad N^- = H^TS^{-1}H + (I-KH)^TN^+(I-KH)

and through a motion :math:`r^+ = \Phi^Tr^-,\ N^+ = \Phi^TN^-\Phi`. These are the recursions of the disturbance smoother; with
:math:`G = \tfrac12(rr^T-N)` after a motion,

.. math:: \frac{\partial\ell}{\partial c} = r,\quad \frac{\partial\ell}{\partial Q_d} = G,\quad
          \frac{\partial\ell}{\partial\Phi} = r\hat x^{+T} + 2G\Phi P^+,\quad
          \frac{\partial\ell}{\partial R} = \tfrac12(uu^T - D),\quad \frac{\partial\ell}{\partial z} = -u,

.. math:: \frac{\partial\ell}{\partial H} = u(\hat x^- + P^-r^-)^T + \left(K^TN^+(I-KH) - S^{-1}H\right)P^-

Nothing is inverted but S, so that singular Φ, Qd, R and P are no exceptions.

Source: Koopman & Shephard, *Biometrika* 79 (1992) 823–826; the recursions: de Jong, *JASA* 84 (1989) 1085–1088.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ctlabs.filtering.engines.common import emptied, entry, mirror, picked, picked_inverse, similarity
from ctlabs.linalg.checks import Array
from ctlabs.linalg.compiled import kernel


class Passed(NamedTuple):
    """A filtered record: what the backward pass reads. Shapes as in :class:`ctlabs.filtering.results.Filtered`, without runs."""

    x_minus: Array
    x_plus: Array
    P_minus: Array
    P_plus: Array
    K: Array
    innovation: Array
    S: Array
    used: Array


class Slopes(NamedTuple):
    """∂ℓ by each matrix: entry k of one that varies, or the sum over all instants in a stack of one.

    ``Phi``, ``Qd`` (steps or 1, n, n) · ``offset`` (steps or 1, n) · ``H`` (steps+1 or 1, m, n) · ``R`` (steps+1 or 1, m, m) ·
    ``z`` (steps+1, m) · ``x0`` (n,), ``P0`` (n, n), by the prediction of the first instant that is passed
    """

    Phi: Array
    Qd: Array
    offset: Array
    H: Array
    R: Array
    z: Array
    x0: Array
    P0: Array


@kernel
def backward(Phi: Array, H: Array, seen: Passed, begin: int, out: Slopes) -> None:
    """From the last instant back to ``begin``; adds to ``out``. ``Phi`` (steps or 1, n, n), ``H`` (steps+1 or 1, m, n)."""
    rows, m, n = seen.K.shape[0], seen.K.shape[2], seen.K.shape[1]
    r, before, N, B = np.zeros(n), np.zeros(n), np.zeros((n, n)), np.zeros((n, n))
    work, G = np.zeros((n, n)), np.zeros((n, n))
    pick, u, e, C, V = np.empty(m, dtype=np.int64), np.zeros(m), np.zeros(m), np.zeros((m, m)), np.zeros((m, m))
    NK, SH, X = np.zeros((n, m)), np.zeros((m, n)), np.zeros((m, n))
    for k in range(rows - 1, begin - 1, -1):
        count = picked(seen.used[k], pick)
        if count > 0:
            J, P, S, K = entry(H, k), seen.P_minus[k], seen.S[k], seen.K[k]
            picked_inverse(S, pick, count, C, V)
            for a in range(count):
                e[a] = 0.0
                for b in range(count):
                    e[a] += V[a, b] * seen.innovation[k, pick[b]]
                u[a] = e[a]
                for i in range(n):
                    u[a] -= K[i, pick[a]] * r[i]
                for i in range(n):
                    s, p = 0.0, 0.0
                    for b in range(count):
                        s += V[a, b] * J[pick[b], i]
                    for j in range(n):
                        p += N[i, j] * K[j, pick[a]]
                    SH[a, i], NK[i, a] = s, p
            for i in range(n):
                for j in range(n):
                    s = 1.0 if i == j else 0.0
                    for a in range(count):
                        s -= K[i, pick[a]] * J[pick[a], j]
                    B[i, j] = s
            for i in range(n):
                s = r[i]
                for a in range(count):
                    s += J[pick[a], i] * u[a]
                before[i] = s
            h, g = k % out.H.shape[0], k % out.R.shape[0]
            for a in range(count):
                for j in range(n):  # KᵀN⁺(I−KH) − S⁻¹H
                    s = -SH[a, j]
                    for i in range(n):
                        s += NK[i, a] * B[i, j]
                    X[a, j] = s
                for j in range(n):
                    s = u[a] * seen.x_minus[k, j]
                    for i in range(n):
                        s += (u[a] * before[i] + X[a, i]) * P[i, j]
                    out.H[h, pick[a], j] += s
                for b in range(count):
                    s = V[a, b]
                    for i in range(n):
                        s += K[i, pick[a]] * NK[i, b]
                    out.R[g, pick[a], pick[b]] += 0.5 * (u[a] * u[b] - s)
                out.z[k, pick[a]] = -u[a]
            emptied(G, 0.0)
            similarity(B.T, N, G, work)
            for i in range(n):
                for j in range(i + 1):
                    s = G[i, j]
                    for a in range(count):
                        s += J[pick[a], i] * SH[a, j]
                    N[i, j], N[j, i] = s, s
            for i in range(n):
                r[i] = before[i]
        if k > begin:
            F, x, P = entry(Phi, k - 1), seen.x_plus[k - 1], seen.P_plus[k - 1]
            f, q, c = (k - 1) % out.Phi.shape[0], (k - 1) % out.Qd.shape[0], (k - 1) % out.offset.shape[0]
            for i in range(n):
                out.offset[c, i] += r[i]
                for j in range(n):
                    G[i, j] = 0.5 * (r[i] * r[j] - N[i, j])
                    out.Qd[q, i, j] += G[i, j]
                    s = 0.0
                    for b in range(n):
                        s += F[i, b] * P[b, j]
                    work[i, j] = s
            for i in range(n):
                for j in range(n):
                    s = r[i] * x[j]
                    for b in range(n):
                        s += 2.0 * G[i, b] * work[b, j]
                    out.Phi[f, i, j] += s
            for i in range(n):
                s = 0.0
                for j in range(n):
                    s += F[j, i] * r[j]
                before[i] = s
            for i in range(n):
                r[i] = before[i]
            emptied(G, 0.0)
            similarity(F.T, N, G, work)
            mirror(G)
            N, G = G, N
    for i in range(n):
        out.x0[i] = r[i]
        for j in range(n):
            out.P0[i, j] = 0.5 * (r[i] * r[j] - N[i, j])
