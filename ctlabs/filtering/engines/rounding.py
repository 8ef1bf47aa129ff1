r"""What rounding may have left in the innovations of elements that are known already: :mod:`ctlabs.filtering.gathered`.

The errors that an estimate has gathered lie in the ellipsoid of W, carried as its roots ``sd`` and its ``shape`` W/(sd sdᵀ),
since the square of a small number may underflow.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ctlabs.filtering.engines.common import EPS, System, entry, helper, picked
from ctlabs.linalg.checks import Array
from ctlabs.linalg.compiled import kernel

#: The rounding of numbers so small that they have no digits left.
LEAST = float(np.finfo(float).smallest_subnormal)


class Rounding(NamedTuple):
    """W of an estimate: ``sd`` (n,), ``shape`` (n, n), and ``j`` (1,), the number of errors in it and one more."""

    sd: Array
    shape: Array
    j: Array


class RoundingInputs(NamedTuple):
    """What was measured, and what a filter made of it: z (rows, m, runs) without what was ``known`` (rows, m) of it, x (rows, n, runs),
    P (rows, n, n), which elements entered the updates and which are ``asked`` for (rows, m); ``K`` (rows, n, m), its gains, or empty.
    """

    z: Array
    known: Array
    x_minus: Array
    x_plus: Array
    P_minus: Array
    P_plus: Array
    used: Array
    asked: Array
    K: Array


@helper
def moved(w: Rounding, A: Array, t: Array, B: Array, W: Array) -> None:
    """W ← (1 + 1/p) A W Aᵀ + (1 + p) n diag(t²): an error in W moved by A, and one more within ±t."""
    n, old, new = t.shape[0], 0.0, 0.0
    for i in range(n):
        unit = np.sqrt(n) * t[i]
        for h in range(n):
            B[i, h] = A[i, h] * w.sd[h]
            unit += abs(B[i, h])
        unit = unit if unit > 0.0 else 1.0
        for h in range(n):
            B[i, h] /= unit
        t[i] /= unit
        B[i, n] = unit
    for i in range(n):
        for h in range(n):
            s = 0.0
            for a in range(n):
                for b in range(n):
                    s += B[i, a] * w.shape[a, b] * B[h, b]
            W[i, h] = s
        old += max(W[i, i], 0.0)
        new += n * t[i] * t[i]
    if old > 0.0 and new > 0.0:
        p = np.sqrt(old / new)
        for i in range(n):
            for h in range(n):
                W[i, h] *= 1.0 + 1.0 / p
            W[i, i] += (1.0 + p) * n * t[i] * t[i]
    else:
        for i in range(n):
            W[i, i] += n * t[i] * t[i]
    for i in range(n):
        w.sd[i] = np.sqrt(W[i, i]) if W[i, i] > 0.0 else 0.0
    for i in range(n):
        for h in range(n):
            both = w.sd[i] * w.sd[h]
            w.shape[i, h] = W[i, h] / both if both > 0.0 else 0.0
    for i in range(n):
        w.sd[i] *= B[i, n]
    w.j[0] += 1.0


@helper
def along(w: Rounding, g: Array) -> float:
    """√(g W gᵀ)."""
    n, unit, s = g.shape[0], 0.0, 0.0
    for i in range(n):
        unit = max(unit, abs(g[i]) * w.sd[i])
    if unit > 0.0:
        for i in range(n):
            for h in range(n):
                s += (g[i] * w.sd[i] / unit) * w.shape[i, h] * (g[h] * w.sd[h] / unit)
    return float(unit * np.sqrt(s)) if s > 0.0 else 0.0


@helper
def largest(values: Array, out: Array) -> None:
    """|values| (·, runs) in the run in which it is largest; of what is not known, nothing."""
    for i in range(values.shape[0]):
        out[i] = 0.0
        for r in range(values.shape[1]):
            if np.isfinite(values[i, r]):
                out[i] = max(out[i], abs(values[i, r]))


@helper
def given(seen: RoundingInputs, k: int, out: Array) -> None:
    """The terms of row k of z: its own, and twice what was known, which is taken off what was measured."""
    largest(seen.z[k], out)
    for a in range(out.shape[0]):
        out[a] += 2 * abs(seen.known[k, a])


@helper
def inverted(H: Array, P: Array, R: Array, pick: Array, count: int, scale: Array, V: Array, C: Array) -> None:
    """V = (S/scale scaleᵀ)⁻¹ of the elements picked; a pivot lost by rounding counts as the rounding."""
    n = P.shape[0]
    for a in range(count):
        for b in range(count):
            s = R[pick[a], pick[b]]
            for i in range(n):
                for j in range(n):
                    s += H[pick[a], i] * P[i, j] * H[pick[b], j]
            C[a, b] = s / (scale[pick[a]] * scale[pick[b]])
            V[a, b] = 1.0 if a == b else 0.0
    for a in range(count):
        C[a, a] = max(EPS, C[a, a])
        for b in range(count):
            if b != a:
                factor = C[b, a] / C[a, a]
                for c in range(count):
                    C[b, c] -= factor * C[a, c]
                    V[b, c] -= factor * V[a, c]
        pivot = C[a, a]
        for c in range(count):
            C[a, c] /= pivot
            V[a, c] /= pivot


@helper
def own(V: Array, nu: Array, pick: Array, count: int, scale: Array) -> float:
    """Σ|V||ν/scale| of the elements picked, the largest of all runs."""
    most = 0.0
    for r in range(nu.shape[1]):
        s = 0.0
        for a in range(count):
            for b in range(count):
                s += abs(V[a, b] * nu[pick[b], r]) / scale[pick[b]]
        most = max(most, s)
    return most


@kernel
def bounds(system: System, M: Array, w: Rounding, size: Array, begun: int, seen: RoundingInputs, e: Array, allowed: Array) -> None:
    """Innovations ``e`` (rows, m, runs) of the elements asked for, given those before them, and what rounding may leave of them.

    ``system.Phi`` and ``M`` (steps or 1, n, m) move the state by Φ − MH and Mz where w and v correlate; M may be empty. ``w``
    and ``size`` (n,), the roots of the terms of P's diagonal, hold what is known before the update of row 0, or with ``begun``
    = 1 after it, and are left after that of the last row.
    """
    rows, m, n = seen.z.shape[0], seen.z.shape[1], seen.x_plus.shape[1]
    gamma = (n + m + 2) * EPS
    x, z, t, g, before = np.empty(n), np.empty(m), np.empty(n), np.empty(n), np.empty(n)
    terms, scale, cross, weight = np.empty(m), np.empty(m), np.empty(m), np.empty(m)
    B, W, A, K, PH = np.empty((n, n + 1)), np.empty((n, n)), np.empty((n, n)), np.empty((n, m)), np.empty((n, m))
    V, C, pick, nu = np.empty((m, m)), np.empty((m, m)), np.empty(m, dtype=np.int64), np.empty((m, seen.z.shape[2]))
    for k in range(begun, rows):
        if k > 0:
            Phi, Q, H = entry(system.Phi, k - 1), entry(system.Q, k - 1), entry(system.H, k - 1)
            largest(seen.x_plus[k - 1], x)
            given(seen, k - 1, z)
            for i in range(n):
                before[i] = seen.P_plus[k - 1, i, i]
                before[i] = np.sqrt(before[i]) if 0.0 < before[i] < np.inf else 0.0
            for i in range(n):
                turned = 0.0  # of a diagonal element (cos 90°) beside a pair that turn into each other: their rounding
                for j in range(n):
                    turned = max(turned, np.sqrt(abs(Phi[i, j])) * np.sqrt(abs(Phi[j, i])))
                own_term = turned if Phi[i, i] != 0.0 else 0.0
                t[i] = own_term * x[i] + (abs(system.c[(k - 1) % system.c.shape[0], i]) if system.c.shape[0] > 0 else 0.0)
                size[i] = own_term * before[i] + np.sqrt(Q[i, i])
                for j in range(n):
                    t[i] += abs(Phi[i, j]) * x[j]
                    size[i] += abs(Phi[i, j]) * before[j]
                if M.shape[0] > 0:
                    for a in range(m):
                        s = z[a]
                        for j in range(n):
                            s += abs(H[a, j]) * x[j]
                        t[i] += abs(entry(M, k - 1)[i, a]) * s
                t[i] = gamma * t[i] + LEAST
            moved(w, Phi, t, B, W)
        H, R, P = entry(system.H, k), entry(system.R, k), seen.P_minus[k]
        count = picked(seen.used[k], pick)
        diffuse = False
        for i in range(n):
            diffuse |= count > 0 and not np.isfinite(P[i, i])
        for late in range(2 if diffuse else 1):
            if diffuse and not late:
                # No weights where nothing was known: each state has its own digits, and what is known is compared with it.
                largest(seen.x_plus[k], x)
                for i in range(n):
                    for j in range(n):
                        w.shape[i, j] = 1.0 if i == j else 0.0
                    w.sd[i] = np.sqrt(n) * EPS * w.j[0] * x[i]
                w.j[0] += 1.0
                continue
            there = seen.x_plus[k] if late else seen.x_minus[k]
            largest(there, x)
            given(seen, k, z)
            for a in range(m):
                s, terms[a] = 0.0, z[a]
                for j in range(n):
                    s += abs(H[a, j]) * size[j]
                    terms[a] += abs(H[a, j]) * x[j]
                scale[a] = np.hypot(s, np.sqrt(R[a, a])) if np.isfinite(R[a, a]) else 0.0
                for r in range(nu.shape[1]):
                    nu[a, r] = seen.z[k, a, r]
                    for j in range(n):
                        if H[a, j] != 0.0:
                            nu[a, r] -= H[a, j] * there[j, r]
            for a in range(m):
                if not seen.asked[k, a] or (late and R[a, a] != 0.0):
                    continue
                number = 0
                while not late and number < count and pick[number] < a:
                    number += 1
                if number > 0:
                    inverted(H, P, R, pick, number, scale, V, C)
                for b in range(number):
                    cross[b] = R[pick[b], a]
                    for i in range(n):
                        for j in range(n):
                            cross[b] += H[pick[b], i] * P[i, j] * H[a, j]
                for j in range(n):
                    g[j] = H[a, j]
                bound, spread = terms[a], scale[a]
                for r in range(nu.shape[1]):
                    e[k, a, r] = nu[a, r]
                for b in range(number):
                    weight[b] = 0.0
                    for c in range(number):
                        weight[b] += V[b, c] * (cross[c] / scale[pick[c]])
                    weight[b] /= scale[pick[b]]
                    for j in range(n):
                        g[j] -= weight[b] * H[pick[b], j]
                    bound += abs(weight[b]) * terms[pick[b]]
                    spread += abs(weight[b]) * scale[pick[b]]
                    for r in range(nu.shape[1]):
                        e[k, a, r] -= weight[b] * nu[pick[b], r]
                if number > 0:
                    bound += w.j[0] * spread * own(V, nu, pick, number, scale)
                allowed[k, a] = gamma * bound + along(w, g) + LEAST
        if count > 0 and not diffuse:
            inverted(H, P, R, pick, count, scale, V, C)
            wide = own(V, nu, pick, count, scale)
            for i in range(n):
                t[i] = x[i] + (w.j[0] * wide * size[i] if P[i, i] > 0.0 else 0.0)
                for a in range(count):
                    PH[i, a] = 0.0
                    for j in range(n):
                        PH[i, a] += P[i, j] * H[pick[a], j]
                for a in range(count):
                    K[i, a] = 0.0
                    if seen.K.shape[0] > 0:
                        K[i, a] = seen.K[k, i, pick[a]]
                    else:
                        for b in range(count):
                            K[i, a] += PH[i, b] / scale[pick[b]] * V[b, a]
                        K[i, a] /= scale[pick[a]]
                    t[i] += abs(K[i, a]) * (terms[pick[a]] + w.j[0] * wide * scale[pick[a]])
                t[i] = gamma * t[i] + LEAST
                for j in range(n):
                    A[i, j] = 1.0 if i == j else 0.0
                    for a in range(count):
                        A[i, j] -= K[i, a] * H[pick[a], j]
            moved(w, A, t, B, W)
