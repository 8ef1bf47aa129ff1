r"""One instant of the filters of :mod:`ctlabs.filtering.engines.forward` and :mod:`ctlabs.filtering.engines.roots`, for measurements that
arrive one by one.

The same loops as over a record, of one prediction or one update: in Joseph's form of all elements, by square roots of those that are
measured.
"""

from __future__ import annotations

import numpy as np

from ctlabs.filtering.engines import roots
from ctlabs.filtering.engines.common import EPS, copied, root
from ctlabs.filtering.engines.forward import DONE as DONE
from ctlabs.filtering.engines.forward import INDEFINITE as INDEFINITE
from ctlabs.filtering.engines.forward import (
    LOG_2PI,
    LOST,
    MARGIN,
    closed,
    gain,
    joseph,
    losing,
    predict,
    thin,
)
from ctlabs.filtering.engines.forward import LOSING as LOSING
from ctlabs.filtering.engines.forward import OVERFLOW as OVERFLOW
from ctlabs.linalg.checks import Array
from ctlabs.linalg.compiled import kernel


@kernel
def predicted(x: Array, P: Array, Phi: Array, c: Array, Q: Array, x_minus: Array, P_minus: Array) -> bool:
    """x_minus = Φx + c, (n, 1), and P_minus = ΦPΦᵀ + Q; whether its variances have digits enough."""
    n = P.shape[0]
    size = np.empty(n)
    predict(P, Phi, Q, P_minus, np.empty((n, n)), size)
    for i in range(n):
        if 0.0 < LOST * P_minus[i, i] < MARGIN * n * EPS * size[i] * size[i]:
            return False
        s = 0.0
        for j in range(n):
            s += Phi[i, j] * x[j, 0]
        x_minus[i, 0] = s + c[i, 0]
    return True


@kernel
def updated(
    x: Array, P: Array, z: Array, H: Array, R: Array, x_plus: Array, P_plus: Array, nu: Array, S: Array, K: Array
) -> tuple[int, float, float]:
    """The update with z (m,), into the last five; how it ended (:data:`DONE`, or why it has no meaning), νᵀS⁻¹ν and the log-likelihood."""
    n, m = P.shape[0], z.shape[0]
    C, Kt, RKt, B, work = np.empty((m, m)), np.empty((m, n)), np.empty((m, n)), np.empty((n, n)), np.empty((n, n))
    pick, sizes = np.arange(m), np.empty((3, m))
    if gain(P, H, R, pick, m, np.ones(m), S, C, Kt, sizes) != DONE:
        return LOSING, np.nan, np.nan
    closed(Kt, H, pick, m, B)
    joseph(P, R, Kt, B, pick, m, P_plus, work, RKt)
    finite = True
    for i in range(n):
        finite &= np.isfinite(P_plus[i, i])
    if finite and (losing(P_plus, P, Kt, H, pick, m, False, sizes) or thin(P_plus, work)):
        return LOSING, np.nan, np.nan
    nis, half = 0.0, 0.5 * m * LOG_2PI
    for a in range(m):
        s = z[a]
        for j in range(n):
            s -= H[a, j] * x[j, 0]
        nu[a] = s
    for i in range(n):
        s = x[i, 0]
        for a in range(m):
            K[i, a] = Kt[a, i]
            s += Kt[a, i] * nu[a]
        x_plus[i, 0] = s
        if not (np.isfinite(s) and np.isfinite(P_plus[i, i])):
            return OVERFLOW, np.nan, np.nan
    e = np.empty(m)
    for a in range(m):
        s = nu[a]
        for b in range(a):
            s -= C[a, b] * e[b]
        e[a] = s / C[a, a]
        nis += e[a] * e[a]
        half += np.log(C[a, a])
    return DONE, nis, -0.5 * nis - half


@kernel
def led(x: Array, L: Array, Phi: Array, c: Array, Q: Array, x_minus: Array, L_minus: Array) -> None:
    """x_minus = Φx + c, (n, 1), and L_minus, a root of ΦLLᵀΦᵀ + Q."""
    n = L.shape[0]
    G, W = np.empty((n, n)), np.empty((n, 2 * n))
    root(Q, G, np.empty(n), W[:, :n])
    copied(L, L_minus)
    roots.ahead(L_minus, Phi, G, W)
    for i in range(n):
        s = 0.0
        for j in range(n):
            s += Phi[i, j] * x[j, 0]
        x_minus[i, 0] = s + c[i, 0]


@kernel
def told(
    x: Array, L: Array, P_minus: Array, z: Array, H: Array, R: Array, used: Array,
    x_plus: Array, L_plus: Array, nu: Array, S: Array, K: Array
) -> tuple[int, float, float]:  # fmt: skip
    """The update by square roots with the elements of z (m,) that are ``used``, as :func:`updated`.

    Perfect measurements of what is known are taken out of ``used``; of what is not used the innovation is NaN, its variance infinite.
    """
    n, m = L.shape[0], z.shape[0]
    W, S_used, Kt, P = np.empty((m + n, m + 2 * n)), np.empty((m, m)), np.empty((m, n)), np.empty((n, n))
    pick, noise, d, e = np.empty(m, dtype=np.int64), np.empty((m, m)), np.empty(m), np.empty(m)
    copied(L, L_plus)
    copied(x, x_plus)
    for a in range(m):
        nu[a] = np.nan
        for b in range(m):
            S[a, b] = np.inf if a == b else 0.0
        for i in range(n):
            K[i, a] = 0.0
    count = roots.told(L_plus, P_minus, H, R, True, used, pick, noise, d, W, np.empty((2, m)))
    if count == 0:
        return DONE, np.nan, 0.0
    end = roots.after(L_plus, P, P_minus, W, H, R, d, pick, count, S_used, np.empty(m), np.empty(n))
    if end != DONE:
        return end, np.nan, np.nan
    roots.gains(W, n, count, Kt)
    nis, half = 0.0, 0.5 * count * LOG_2PI
    for a in range(count):
        s = z[pick[a]]
        for j in range(n):
            s -= H[pick[a], j] * x[j, 0]
        nu[pick[a]] = s
        for b in range(a):
            s -= W[a, b] * e[b]
        e[a] = s / W[a, a]
        nis += e[a] * e[a]
        half += np.log(abs(W[a, a]))
        for b in range(count):
            S[pick[a], pick[b]] = S_used[a, b]
        for i in range(n):
            K[i, pick[a]] = Kt[a, i]
    for i in range(n):
        for a in range(count):
            x_plus[i, 0] += W[count + i, a] * e[a]
    return DONE, nis, -0.5 * nis - half
