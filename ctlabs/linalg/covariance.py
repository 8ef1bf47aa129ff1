"""Small verbs on covariances."""

from __future__ import annotations

import numpy as np

from ctlabs.linalg.checks import Array


def deviations(P: Array) -> Array:
    """Standard deviations, the roots of the diagonals of covariances (…, n, n).

    A variance that is zero may come out as −1e-30 where a singular covariance is moved: it counts as zero.

    >>> deviations(np.diag([4.0, -1e-30]))
    array([2., 0.])
    """
    return np.sqrt(np.diagonal(P, axis1=-2, axis2=-1).clip(0))


def symmetric(P: Array) -> Array:
    """The symmetric part of matrices (…, n, n)."""
    return 0.5 * (P + np.swapaxes(P, -2, -1))
