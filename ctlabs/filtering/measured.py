"""Which elements of a measurement enter an update: those that are there, and tell something."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from ctlabs.filtering.results import Mask
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.linalg.factors import EPS, ldl
from ctlabs.models.linear import DiscreteModel


def begins(model: Any, first: int | None) -> int:
    """The index of the first measurement: the model's own where None is asked for.

    >>> begins(DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[1]], first=0), None)
    0
    """
    value = model.first if first is None else first
    if isinstance(value, bool) or value not in (0, 1):
        msg = f"first: expected 0 or 1, received {value!r}"
        raise ValueError(msg)
    return int(value)


def horizon(model: DiscreteModel, steps: int, least: int = 1) -> int:
    """A number of steps that the model is given for."""
    checks.instance("model", model, DiscreteModel)
    steps = checks.count("steps", steps, least=least)
    if model.horizon is not None and steps > model.horizon:
        msg = f"steps: expected at most {model.horizon} (the model is given for so many), received {steps}"
        raise ValueError(msg)
    return steps


def gaps(z: Array, begin: int = 0) -> Mask:
    """Where data (rows, m, runs) are missing, (rows, m): NaN, in every run or in none. ``begin`` : the first row's number."""
    missing = np.isnan(z)
    if z.shape[2] == 1 and not np.isinf(z).any():
        return missing[:, :, 0]
    absent: Mask = np.all(missing, axis=2)
    wrong = np.isinf(z).any(axis=2) | (missing.any(axis=2) & ~absent)
    if wrong.any():
        k, i = np.argwhere(wrong)[0]
        received = "an infinite value" if np.isinf(z[k, i]).any() else "NaN in some runs only"
        msg = f"z[{k - begin}][{i}]: expected finite numbers, or NaN in every run, received {received}"
        raise ValueError(msg)
    return absent


def without(R: Array, missing: Mask) -> Array:
    """R with the ``missing`` elements' variance infinite and their correlations gone."""
    either = missing[:, None] | missing
    return np.where(either, np.where(np.eye(len(R), dtype=bool), np.inf, 0.0), R)


def perfect(R: Array) -> Mask:
    """Which elements have no noise of their own: a variance of zero, or a noise combined of those before it.

    >>> perfect(np.array([[1.0, 1.0], [1.0, 1.0]]))
    array([False,  True])
    """
    if R.diagonal().all() and np.count_nonzero(R) == len(R):  # independent noises, none of them zero
        return np.zeros(len(R), dtype=bool)
    return _perfect(len(R), R.tobytes())


@lru_cache(maxsize=64)
def _perfect(m: int, numbers: bytes) -> Mask:
    """:func:`perfect` of the numbers of R (m, m): an online filter asks the same at every instant. The answer cannot be written."""
    R = np.frombuffer(numbers).reshape(m, m)
    there = np.isfinite(R.diagonal())
    found = np.asarray(there & (ldl(np.where(there[:, None] & there, R, 0.0))[1] == 0))
    found.setflags(write=False)
    return found


def any_perfect(R: Array) -> bool:
    """Whether an element of R (m, m), or of any of a stack (…, m, m), is :func:`perfect`."""
    variances = np.diagonal(R, axis1=-2, axis2=-1)
    if variances.all() and np.count_nonzero(R) == variances.size:  # independent noises, none of them zero
        return False
    there = np.isfinite(variances)
    left = ldl(np.where(there[..., :, None] & there[..., None, :], R, 0.0))[1]
    return bool((there & (left == 0)).any())


def informative(P: Array, H: Array, R: Array) -> Mask:
    """Which elements enter the update: those measured, but no perfect one whose value is known already.

    An element is known when its innovation, given the innovations before it, has a variance at the rounding level of its
    own terms.
    """
    used, exact = np.isfinite(R.diagonal()), perfect(R)
    if exact.any():
        finite = np.where(used[:, None] & used, R, 0.0)
        S = H @ P @ H.T + finite
        size = (np.abs(H) @ np.sqrt(np.diag(P).clip(0))) ** 2 + np.diag(finite)
        for i in np.flatnonzero(exact):
            left, terms = S[i, i], np.sqrt(size[i])
            if used[:i].any():
                before = np.flatnonzero(used[:i])
                weights = np.linalg.solve(S[np.ix_(before, before)], S[before, i])
                left, terms = left - S[i, before] @ weights, np.abs(weights) @ np.sqrt(size[before]) + terms
            used[i] = left > 16 * len(P) * EPS * terms**2  # the terms of the innovation that is left
    return used
