"""Where two routes to the same numbers differ most, and by how much: the comparison behind a check."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.reporting.params import plain

#: Two numbers that differ by less, in their own scale, are the same up to rounding.
ROUNDING = 1e-12
#: Significant digits in which machines agree.
DIGITS = 10


@dataclass(frozen=True, slots=True)
class Agreement:
    """Two routes to one or many numbers: the element that stands for all, its scale, and the largest share of a scale."""

    value: float | None
    expected: float | None
    size: float
    share: float

    def told(self, kind: float) -> Agreement:
        """As it is written down: numbers that are equal up to rounding are equal, and rounding about zero is zero."""
        if self.value is None or self.expected is None or self.share > kind:
            return self
        expected = 0.0 if abs(self.expected) <= ROUNDING * self.size else self.expected
        same = self.share <= ROUNDING or abs(self.value - expected) <= ROUNDING * self.size
        return Agreement(expected if same else self.value, expected, self.size, max(self.share, ROUNDING))


def compared(value: Any, expected: Any, scale: ArrayLike | None, kind: float) -> Agreement:
    """How far two routes are apart, each element in its own scale.

    Where they agree within ``kind`` the element of largest size stands for all: which one has the largest rounding error
    depends on the machine. Where they do not, it is the one that differs most.
    """
    if value is None or expected is None:
        agree = value is None and expected is None
        return Agreement(_scalar(value), _scalar(expected), 1.0, 0.0 if agree else math.inf)
    found, wanted = numbers(value), numbers(expected)
    if found.shape != wanted.shape:
        msg = f"check: expected two arrays of one shape, received {found.shape} and {wanted.shape}"
        raise ValueError(msg)
    if not found.size:
        msg = "check: expected at least one number, received none"
        raise ValueError(msg)
    same = (found == wanted) | (np.isnan(found) & np.isnan(wanted))
    with np.errstate(invalid="ignore"):
        difference = np.where(same, 0.0, np.abs(found - wanted))
    difference = np.where(np.isnan(difference), np.inf, difference)
    size = np.broadcast_to(_sizes(wanted) if scale is None else np.asarray(scale, dtype=np.float64), wanted.shape)
    share = np.divide(difference, size, out=np.where(difference > 0, np.inf, 0.0), where=size > 0)
    largest = np.array([float(f"{abs(element):.8e}") for element in np.nan_to_num(wanted.ravel())])
    at = np.unravel_index(int(np.argmax(share if share.max() > kind else largest)), wanted.shape)
    return Agreement(_known(found[at]), _known(wanted[at]), float(size[at]), float(share.max())).told(kind)


def known(x: Any, digits: int = DIGITS) -> Any:
    """Numbers, in lists or alone, to so many significant digits: what is known of them on any machine.

    >>> known([0.1 + 0.2, 1 / 3, None, True, "inf", 7])
    [0.3, 0.3333333333, None, True, 'inf', 7]
    """
    if isinstance(x, list):
        return [known(item, digits) for item in x]
    return float(f"{x:.{digits - 1}e}") if isinstance(x, float) else x


def _sizes(wanted: np.ndarray[Any, np.dtype[np.float64]]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """What each element is measured by: σ_iσ_j in a covariance, otherwise its own size; the largest one's where that is 0."""
    finite = np.where(np.isfinite(wanted), np.abs(wanted), 0.0)
    size = finite
    if (
        wanted.ndim >= 2
        and wanted.shape[-1] == wanted.shape[-2]
        and np.array_equal(finite, np.swapaxes(finite, -1, -2))
    ):
        sd = np.sqrt(np.diagonal(finite, axis1=-2, axis2=-1))
        both = sd[..., :, None] * sd[..., None, :]
        if (finite <= both * (1 + 1e-9)).all():
            size = both
    return np.where(size > 0, size, finite.max(initial=0.0) or 1.0)


def numbers(value: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Floats, with NaN for null (a NaN itself has been refused by ``plain``)."""
    return np.atleast_1d(np.array(_infinite(plain(value)), dtype=np.float64))


def _infinite(value: Any) -> Any:
    if isinstance(value, list):
        return [_infinite(item) for item in value]
    return float(value) if isinstance(value, str) else value


def _scalar(value: Any) -> float | None:
    return None if value is None else float(numbers(value).ravel()[0])


def _known(element: float) -> float | None:
    return None if math.isnan(element) else float(element)
