"""What a measurement's noise tells of a disturbance that it correlates with."""

from __future__ import annotations

import numpy as np

from ctlabs.linalg.checks import Array


def regression(N: Array, R: Array) -> Array:
    r"""M = NR⁺ (…, n, m): E[w | v] = Mv for cov(w, v) = N (n, m) and cov v = R (…, m, m), which may be singular.

    The pseudo-inverse is taken in units in which the variances are near 1 (powers of 2, which round nothing): beside a noise of
    1e18 one of 1 is no rounding.

    >>> regression(np.array([[1.0, 1e9]]), np.diag([2.0, 4e18])).tolist()
    [[0.5, 2.5e-10]]
    """
    variances = np.diagonal(R, axis1=-2, axis2=-1)
    unit = np.exp2(np.round(0.5 * np.log2(variances, where=variances > 0, out=np.zeros(variances.shape))))[..., None, :]
    return np.asarray((N / unit) @ np.linalg.pinv(R / (np.swapaxes(unit, -1, -2) * unit), hermitian=True) / unit)
