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

from functools import partial
from typing import NamedTuple

import numpy as np

from ctlabs.filtering.engines.common import copied, emptied, entry, mirror, picked, picked_inverse, similarity
from ctlabs.linalg.checks import Array
from ctlabs.linalg.compiled import helper, kernel


class AdjointInputs(NamedTuple):
    """A filtered record: what the backward pass reads. Shapes as in :class:`ctlabs.filtering.results.Filtered`, without runs."""

    x_minus: Array
    x_plus: Array
    P_minus: Array
    P_plus: Array
    K: Array
    innovation: Array
    S: Array
    used: Array


class AdjointSlopes(NamedTuple):
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


@helper
def _equal(A: Array, B: Array) -> bool:
    """Whether two matrices are the same to the last digit."""
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            if A[i, j] != B[i, j]:
                return False
    return True


class AdjointSums(NamedTuple):
    """What instants with the same gain and covariances sum up to, before :func:`_added` takes it.

    ``rr`` (n, n), of rrᵀ, and ``rx`` (n, n), of r·x̂⁺ᵀ, after the motion · ``uu`` (m, m), ``ub`` (m, n), ``ux`` (m, n), of uuᵀ, u·r⁻ᵀ and
    u·x̂⁻ᵀ, of the elements that are used
    """

    rr: Array
    rx: Array
    uu: Array
    ub: Array
    ux: Array


@partial(helper, inline="always")
def _resting(seen: AdjointInputs, k: int) -> bool:
    """Whether the same elements are used at k as at k+1, with the same gain and covariance."""
    n, m = seen.K.shape[1], seen.K.shape[2]
    for a in range(m):
        if seen.used[k, a] != seen.used[k + 1, a]:
            return False
        for i in range(n):
            if seen.K[k, i, a] != seen.K[k + 1, i, a]:
                return False
        for b in range(m):
            if seen.S[k, a, b] != seen.S[k + 1, a, b]:
                return False
    return True


@partial(helper, inline="always")
def _settled(seen: AdjointInputs, k: int) -> bool:
    """Whether P⁻ of k, and P⁺ before it, are those of k+1."""
    n = seen.K.shape[1]
    for i in range(n):
        for j in range(n):
            if seen.P_minus[k, i, j] != seen.P_minus[k + 1, i, j] or seen.P_plus[k - 1, i, j] != seen.P_plus[k, i, j]:
                return False
    return True


@helper
def _updated(k: int, J: Array, V: Array, pick: Array, count: int, r: Array, u: Array, before: Array,
             seen: AdjointInputs, sums: AdjointSums, out: AdjointSlopes) -> None:  # fmt: skip
    """r through the update at k, and its part of the sums."""
    n = r.shape[0]
    for a in range(count):
        u[a] = 0.0
        for b in range(count):
            u[a] += V[a, b] * seen.innovation[k, pick[b]]
        for i in range(n):
            u[a] -= seen.K[k, i, pick[a]] * r[i]
        out.z[k, pick[a]] = -u[a]
    for i in range(n):
        s = r[i]
        for a in range(count):
            s += J[pick[a], i] * u[a]
        before[i] = s
    for a in range(count):
        for j in range(n):
            sums.ux[a, j] += u[a] * seen.x_minus[k, j]
            sums.ub[a, j] += u[a] * before[j]
        for b in range(count):
            sums.uu[a, b] += u[a] * u[b]
    for i in range(n):
        r[i] = before[i]


@helper
def _moved(k: int, F: Array, r: Array, before: Array, seen: AdjointInputs, sums: AdjointSums, out: AdjointSlopes) -> None:
    """r through the motion to k, and its part of the sums."""
    n, c = r.shape[0], k - 1 if out.offset.shape[0] > 1 else 0
    for i in range(n):
        out.offset[c, i] += r[i]
        for j in range(n):
            sums.rr[i, j] += r[i] * r[j]
            sums.rx[i, j] += r[i] * seen.x_plus[k - 1, j]
    for i in range(n):
        s = 0.0
        for j in range(n):
            s += F[j, i] * r[j]
        before[i] = s
    for i in range(n):
        r[i] = before[i]


@helper
def _measured(k: int, times: int, D: Array, X: Array, pick: Array, count: int,
              seen: AdjointInputs, sums: AdjointSums, out: AdjointSlopes) -> None:  # fmt: skip
    """What H and R gain of the sums over so many updates, the first of which is at k."""
    n, h, g = X.shape[1], k if out.H.shape[0] > 1 else 0, k if out.R.shape[0] > 1 else 0
    for a in range(count):
        for j in range(n):
            s = sums.ux[a, j]
            for i in range(n):
                s += (sums.ub[a, i] + times * X[a, i]) * seen.P_minus[k, i, j]
            out.H[h, pick[a], j] += s
        for b in range(count):
            out.R[g, pick[a], pick[b]] += 0.5 * (sums.uu[a, b] - times * D[a, b])
    emptied(sums.uu, 0.0)
    emptied(sums.ub, 0.0)
    emptied(sums.ux, 0.0)


@helper
def _driven(k: int, times: int, F: Array, N: Array, G: Array, work: Array,
            seen: AdjointInputs, sums: AdjointSums, out: AdjointSlopes) -> None:  # fmt: skip
    """What Φ and Qd gain of the sums over so many motions, the first of which is to k; N is that before the measurement at k."""
    n, f, q = G.shape[0], k - 1 if out.Phi.shape[0] > 1 else 0, k - 1 if out.Qd.shape[0] > 1 else 0
    for i in range(n):
        for j in range(n):
            G[i, j] = 0.5 * (sums.rr[i, j] - times * N[i, j])
            out.Qd[q, i, j] += G[i, j]
            s = 0.0
            for b in range(n):
                s += F[i, b] * seen.P_plus[k - 1, b, j]
            work[i, j] = s
    for i in range(n):
        for j in range(n):
            s = sums.rx[i, j]
            for b in range(n):
                s += 2.0 * G[i, b] * work[b, j]
            out.Phi[f, i, j] += s
    emptied(sums.rr, 0.0)
    emptied(sums.rx, 0.0)


@helper
def _gained(S: Array, K: Array, J: Array, pick: Array, count: int, C: Array, V: Array, SH: Array, B: Array) -> None:
    """V = S⁻¹, S⁻¹H and B = I − KH of an update."""
    n = K.shape[0]
    picked_inverse(S, pick, count, C, V)
    for a in range(count):
        for i in range(n):
            s = 0.0
            for b in range(count):
                s += V[a, b] * J[pick[b], i]
            SH[a, i] = s
    for i in range(n):
        for j in range(n):
            s = 1.0 if i == j else 0.0
            for a in range(count):
                s -= K[i, pick[a]] * J[pick[a], j]
            B[i, j] = s


@helper
def _told(
    N: Array, K: Array, J: Array, pick: Array, count: int, V: Array, SH: Array, B: Array,
    NK: Array, D: Array, X: Array, N_minus: Array, work: Array,
) -> None:  # fmt: skip
    """D = S⁻¹ + KᵀN⁺K, X = KᵀN⁺(I−KH) − S⁻¹H and N⁻ of an update."""
    n = K.shape[0]
    for a in range(count):
        for i in range(n):
            s = 0.0
            for j in range(n):
                s += N[i, j] * K[j, pick[a]]
            NK[i, a] = s
    for a in range(count):
        for j in range(n):
            s = -SH[a, j]
            for i in range(n):
                s += NK[i, a] * B[i, j]
            X[a, j] = s
        for b in range(count):
            s = V[a, b]
            for i in range(n):
                s += K[i, pick[a]] * NK[i, b]
            D[a, b] = s
    emptied(N_minus, 0.0)
    similarity(B.T, N, N_minus, work)
    for i in range(n):
        for j in range(i + 1):
            s = N_minus[i, j]
            for a in range(count):
                s += J[pick[a], i] * SH[a, j]
            N_minus[i, j], N_minus[j, i] = s, s


@helper
def _rested(
    k: int, begin: int, F: Array, J: Array, V: Array, pick: Array, count: int,
    r: Array, u: Array, before: Array, seen: AdjointInputs, sums: AdjointSums, out: AdjointSlopes,
) -> int:  # fmt: skip
    """Back from k as long as nothing changes but r, not as far as ``begin``; the last instant that is done."""
    while k - 1 > begin and _resting(seen, k - 1) and _settled(seen, k - 1):
        k -= 1
        if count > 0:
            _updated(k, J, V, pick, count, r, u, before, seen, sums, out)
        _moved(k, F, r, before, seen, sums, out)
    return k


@kernel
def backward(Phi: Array, H: Array, seen: AdjointInputs, begin: int, out: AdjointSlopes) -> None:
    """From the last instant back to ``begin``; adds to ``out``. ``Phi`` (steps or 1, n, n), ``H`` (steps+1 or 1, m, n)."""
    rows, m, n = seen.K.shape[0], seen.K.shape[2], seen.K.shape[1]
    r, before, N, N_minus, B = np.zeros(n), np.zeros(n), np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
    work, G = np.zeros((n, n)), np.zeros((n, n))
    pick, u, C, V, D = np.empty(m, dtype=np.int64), np.zeros(m), np.zeros((m, m)), np.zeros((m, m)), np.zeros((m, m))
    NK, SH, X = np.zeros((n, m)), np.zeros((m, n)), np.zeros((m, n))
    sums = AdjointSums(np.zeros((n, n)), np.zeros((n, n)), np.zeros((m, m)), np.zeros((m, n)), np.zeros((m, n)))
    still = Phi.shape[0] == 1 and H.shape[0] == 1 and out.Qd.shape[0] == 1 and out.R.shape[0] == 1
    moved = True  # whether N has changed since the instant after
    k = rows
    while k > begin:
        k -= 1
        # Where gains and N have come to rest, what they alone make is that of the instant after.
        other = k == rows - 1 or H.shape[0] > 1 or not _resting(seen, k)
        if other:
            count = picked(seen.used[k], pick)
        J = entry(H, k)
        if count > 0:
            K = seen.K[k]
            if other:
                _gained(seen.S[k], K, J, pick, count, C, V, SH, B)
            if other or moved:
                _told(N, K, J, pick, count, V, SH, B, NK, D, X, N_minus, work)
            _updated(k, J, V, pick, count, r, u, before, seen, sums, out)
            _measured(k, 1, D, X, pick, count, seen, sums, out)
        elif other or moved:
            copied(N, N_minus)
        if k > begin:
            F = entry(Phi, k - 1)
            _moved(k, F, r, before, seen, sums, out)
            _driven(k, 1, F, N_minus, G, work, seen, sums, out)
            if other or moved or Phi.shape[0] > 1:
                emptied(G, 0.0)
                similarity(F.T, N_minus, G, work)
                mirror(G)
                moved = not _equal(G, N)
                N, G = G, N
            if still and not moved:
                first = _rested(k, begin, F, J, V, pick, count, r, u, before, seen, sums, out)
                if first < k:
                    _measured(first, k - first, D, X, pick, count, seen, sums, out)
                    _driven(first, k - first, F, N_minus, G, work, seen, sums, out)
                    k = first
    for i in range(n):
        out.x0[i] = r[i]
        for j in range(n):
            out.P0[i, j] = 0.5 * (r[i] * r[j] - N_minus[i, j])
