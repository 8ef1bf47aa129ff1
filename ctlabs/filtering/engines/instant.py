r"""One instant of the filter of :mod:`ctlabs.filtering.engines.forward`, for measurements that arrive one by one.

The same loops as over a record, of one prediction or one update of all elements.
"""

from __future__ import annotations

import numpy as np

from ctlabs.filtering.engines.common import EPS
from ctlabs.filtering.engines.forward import DONE as DONE
from ctlabs.filtering.engines.forward import (
    LOG_2PI,
    LOST,
    MARGIN,
    OVERFLOW,
    closed,
    gain,
    joseph,
    losing,
    predict,
    thin,
)
from ctlabs.filtering.engines.forward import LOSING as LOSING
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
    if finite and (losing(P_plus, P, Kt, H, pick, m, sizes) or thin(P_plus, work)):
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
