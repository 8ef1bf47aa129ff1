r"""Independence of innovations.

Of the right model they are white: their partial autocorrelations :math:`\hat\pi_l` are those of independent numbers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array

#: Lags of the whiteness test: one for every five innovations, at most this many.
LAGS = 10
#: Innovations of one measurement below which its independence is not tested.
FEWEST = 10


class Whiteness(NamedTuple):
    """Independence of one measurement's innovations.

    ``lags``, counted in innovations · ``r``, autocorrelations · ``partial`` ones · ``band``, within ± which 95 % of either
    lie for independent innovations · ``p`` of all lags together, NaN where the innovations are too few
    """

    lags: Array
    r: Array
    partial: Array
    band: Array
    p: float


def whiteness(e: ArrayLike, lags: int | None = None) -> Whiteness:
    r"""Ljung and Box's test in Monti's form, for standardised innovations whose mean is zero.

    .. math:: r_l = \frac{\sum_k e_ke_{k-l}}{\sum_k e_k^2}, \quad
              \sum_{l=1}^L\left[F^{-1}(\hat\pi_l)\right]^2 \approx \chi^2(L)

    The partial autocorrelations :math:`\hat\pi_l` of independent innovations are nearly independent, with
    :math:`\hat\pi_l^2` of a Beta distribution whose mean is (N−l)/N(N+2); F⁻¹ turns them into normal deviates. For 50
    innovations already the p-values are right to the tails, where those of Ljung and Box's sum are too small by a factor 5.
    Innovations on both sides of a gap are neighbours: independent ones stay so when some are left out.

    Parameters
    ----------
    e : (steps+1,), NaN where there is none
    lags : L, by default N/5, at most 10

    Source: Ljung & Box (1978), Biometrika 65; Monti (1994), Biometrika 81.

    >>> found = whiteness([1.0, -1.0] * 20)
    >>> found.r[:2], bool(found.p < 1e-6)
    (array([-0.975,  0.95 ]), True)
    """
    given = np.asarray(e, dtype=np.float64)
    x: Array = given[np.isfinite(given)]
    N, square = len(x), float(x @ x)
    if N < FEWEST or square == 0:
        nothing = np.zeros(0)
        return Whiteness(nothing, nothing, nothing, nothing, np.nan)
    wanted = min(LAGS, N // 5) if lags is None else min(checks.count("lags", lags), N - 1)
    at = np.arange(1, wanted + 1)
    r = np.array([x[lag:] @ x[:-lag] for lag in at.tolist()]) / square
    variance, partial = (N - at) / (N * (N + 2.0)), _partial(r)
    outside = special.betainc(0.5 / variance - 0.5, 0.5, np.maximum(1 - partial**2, 1e-300))
    scores = special.ndtri(0.5 * outside)
    band = np.sqrt(special.betaincinv(0.5, 0.5 / variance - 0.5, 0.95))
    return Whiteness(at, r, partial, band, float(special.chdtrc(wanted, (scores**2).sum())))


def _partial(r: Array) -> Array:
    """Partial autocorrelations by the recursion of Durbin and Levinson."""
    found, prediction, left = [], np.zeros(0), 1.0
    for k in range(len(r)):
        found.append((r[k] - prediction @ r[:k][::-1]) / left)
        prediction = np.append(prediction - found[k] * prediction[::-1], found[k])
        left *= 1 - found[k] ** 2
    return np.array(found)
