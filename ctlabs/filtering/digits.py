"""Estimates whose own last digits are not far below their standard deviations: a nanometre beside a light-year."""

from __future__ import annotations

import numpy as np

from ctlabs.filtering.measured import any_perfect
from ctlabs.filtering.results import Filtered
from ctlabs.linalg.checks import Array
from ctlabs.text import moment, number

#: Doubles hold 16 digits: of an estimate so many times its standard deviation 1e-8 of that is lost at once, and 1e-6 in a hundred steps.
FAR = 1e8


def remarks(filtered: Filtered, x: Array, P: Array, what: str) -> tuple[str, ...]:
    """Of which estimates x (rows, n[, runs]), with covariances P, of a filtered record doubles keep too few digits: a sentence, or none.

    Perfect measurements determine what they see, at once or ever better (as the shocks of a moving average): of what is exact to the
    last digit nothing is said.
    """
    variance, flat = np.diagonal(P, axis1=1, axis2=2), x.reshape(*x.shape[:2], -1)
    least, most = variance.min(where=variance > 0, initial=np.inf), np.abs(flat.max(initial=0.0)) + np.abs(flat.min(initial=0.0))
    if most <= FAR * np.sqrt(least):
        return ()
    size = np.abs(flat).max(axis=2)
    few = (variance > 0) & (size > FAR * np.sqrt(np.maximum(variance, 0.0)))
    if not few.any() or any_perfect(filtered.model.R):
        return ()
    sd = np.sqrt(np.where(few, variance, np.inf))
    k, i = np.unravel_index(int(np.argmax(np.where(few, size, 0.0) / sd)), sd.shape)
    name = filtered.model.states[i]
    least = number(np.spacing(size[k, i]) / 2 / sd[k, i], 1)
    text = (
        f"{name}, {what} at t = {moment(filtered.t[k])} s, is {number(size[k, i], 3)} with a standard deviation of "
        f"{number(sd[k, i], 3)}: doubles hold 16 digits, so that rounding is at least {least} of it; count {name} from a value near it, "
        "in the model and in the measurements"
    )
    return (text,)
