r"""One instant of the filter of :mod:`ctlabs.filtering.engines.roots`, for measurements that arrive one by one.

The same loops as over a record, of one prediction or one update.
"""

from __future__ import annotations

import numpy as np

from ctlabs.filtering.engines import roots
from ctlabs.filtering.engines.common import copied, root
from ctlabs.filtering.engines.forward import DONE as DONE
from ctlabs.filtering.engines.forward import INDEFINITE as INDEFINITE
from ctlabs.filtering.engines.forward import LOG_2PI
from ctlabs.filtering.engines.forward import OVERFLOW as OVERFLOW
from ctlabs.linalg.checks import Array
from ctlabs.linalg.compiled import kernel


@kernel
def predicted(x: Array, L: Array, Phi: Array, c: Array, Q: Array, x_minus: Array, L_minus: Array, P_minus: Array) -> int:
    """x_minus = Φx + c, (n, 1), L_minus, a root of P_minus = ΦLLᵀΦᵀ + Q; how it ended (:data:`DONE`, or why it has no meaning)."""
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
    return DONE if roots.squared(L_minus, P_minus) else OVERFLOW


@kernel
def updated(
    x: Array, L: Array, P: Array, z: Array, H: Array, R: Array, used: Array,
    x_plus: Array, L_plus: Array, P_plus: Array, nu: Array, S: Array, K: Array
) -> tuple[int, float, float]:  # fmt: skip
    """The update with the elements of z (m,) that are ``used``, into what follows; how it ended, νᵀS⁻¹ν and the log-likelihood.

    Perfect measurements of what is known are taken out of ``used``; of what is not used the innovation is NaN, its variance infinite.
    """
    n, m = L.shape[0], z.shape[0]
    W, S_used, Kt = np.empty((m + n, m + 2 * n)), np.empty((m, m)), np.empty((m, n))
    pick, noise, d, e = np.empty(m, dtype=np.int64), np.empty((m, m)), np.empty(m), np.empty(m)
    copied(L, L_plus)
    copied(x, x_plus)
    copied(P, P_plus)
    for a in range(m):
        nu[a] = np.nan
        for b in range(m):
            S[a, b] = np.inf if a == b else 0.0
        for i in range(n):
            K[i, a] = 0.0
    count = roots.told(L_plus, P, H, R, True, used, pick, noise, d, W, np.empty((2, m)))
    if count == 0:
        return DONE, np.nan, 0.0
    end = roots.after(L_plus, P_plus, P, W, H, R, d, pick, count, S_used, np.empty(m), np.empty(n))
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
