"""When a filter has come to its limit."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.filtering.filter import covariances
from ctlabs.filtering.measured import begins
from ctlabs.filtering.steady import solve
from ctlabs.models.linear import DiscreteModel


def settling_step(variances: ArrayLike, limit: ArrayLike, within: float = 0.01) -> int | None:
    """The first index from which every variance stays within a fraction of its limit; ``None`` if the last does not.

    Parameters
    ----------
    variances : (steps+1, n), for example the diagonals of P_plus · limit : (n,) · within : fraction of the limit

    >>> settling_step([[10.0], [0.92], [0.66], [0.62], [0.618]], [0.618])
    3
    """
    values, limit = np.asarray(variances, dtype=np.float64), np.asarray(limit, dtype=np.float64)
    outside = (np.abs(values - limit) > within * limit).any(axis=-1)
    last = int(np.flatnonzero(outside).max(initial=-1))
    return None if last == len(values) - 1 else last + 1


def settling(model: DiscreteModel, within: float = 0.01, first: int | None = None, longest: int = 100_000) -> int | None:
    """The settling step of a filter: from it on every variance of P_plus stays within ``within`` of its limit.

    Searched over as many steps as it takes, up to ``longest``; ``None`` beyond (a filter that settles like 1/k
    towards a zero limit never gets within a fraction of it).
    """
    limit = np.diag(solve(model).P_plus)
    if not limit.any():
        longest = 64  # a zero limit is reached at once (perfect measurements) or never within a fraction of it
    steps = 64
    while steps <= longest:
        found = settling_step(np.diagonal(covariances(model, steps, first=first).P_plus, axis1=1, axis2=2), limit, within)
        # Half of the horizon in the band is taken for staying there: P_plus converges geometrically.
        if found is not None and found <= steps // 2:
            return max(found, begins(model, first))
        steps *= 4
    return None
