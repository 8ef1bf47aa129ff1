"""Estimates whose own last digits are not far below their standard deviations: a nanometre beside a light-year."""

from __future__ import annotations

import warnings

import numpy as np

from ctlabs.filtering.measured import perfect
from ctlabs.filtering.results import Filtered
from ctlabs.linalg.checks import Array
from ctlabs.text import moment, number

EPS = float(np.finfo(float).eps)
#: Doubles hold 16 digits: of an estimate so many times its standard deviation 1e-8 of that is lost at once, and 1e-6 in a hundred steps.
FAR = 1e8


class RoundingWarning(UserWarning):
    """Estimates that doubles cannot hold to 1e-6 of their standard deviations."""


def warn(filtered: Filtered, x: Array, P: Array, what: str) -> None:
    """Say of which estimates x (rows, n[, runs]), with covariances P, of a filtered record doubles keep too few digits."""
    variance, size = np.diagonal(P, axis1=1, axis2=2), np.abs(x).reshape(*x.shape[:2], -1).max(axis=2)
    few = (variance > 0) & (size > FAR * np.sqrt(np.maximum(variance, 0.0)))
    if not few.any():
        return
    uncertain = few & (variance > _exact(filtered, size))
    if not uncertain.any():
        return
    sd = np.sqrt(np.where(uncertain, variance, np.inf))
    k, i = np.unravel_index(int(np.argmax(np.where(uncertain, size, 0.0) / sd)), sd.shape)
    name = filtered.model.states[i]
    msg = (
        f"{name}: expected an estimate below {FAR:.0e} of its standard deviations, as doubles hold 16 digits; received, {what} at "
        f"t = {moment(filtered.t[k])} s, {number(size[k, i], 3)} with {number(sd[k, i], 3)}, of which rounding is at least "
        f"{number(np.spacing(size[k, i]) / 2 / sd[k, i], 1)}: count {name} from a value near it, in the model and in the measurements"
    )
    warnings.warn(msg, RoundingWarning, stacklevel=3)


def _exact(filtered: Filtered, size: Array) -> Array:
    """Variances (rows, n) that are rounding: what a perfect measurement leaves of a state."""
    R = filtered.model.R
    if not any(perfect(each).any() for each in (R if R.ndim == 3 else R[None])):
        return np.zeros_like(size)
    before = np.diagonal(filtered.P_minus, axis1=1, axis2=2)
    most = np.max(before, axis=0, where=np.isfinite(before), initial=0.0)
    return (8 * filtered.model.n * EPS) ** 2 * np.maximum(most, size**2)
