"""What a hand-out asks for: a value by its name and letter, its right answer, and what counts as right."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ctlabs.linalg.checks import Array

#: What counts as right of a number that is written with three significant digits: half a unit of the third is at most so much.
THREE_DIGITS = 0.005


@dataclass(frozen=True, slots=True)
class AskedValue:
    r"""A value that a hand-out asks for, with its right answer.

    ``name`` : as in ``results.json`` · ``item`` : letter of the sheet's item, "a" … · ``symbol`` : in LaTeX ·
    ``meaning`` : a phrase, "variance of the estimate after measurement i" · ``unit`` : SI, as in ``results.json`` ("m²/s", "1") ·
    ``value`` : the right answer, of 0 to 3 dimensions · ``relative`` : what counts as right, as a part of its size (counts: 0) ·
    ``absolute`` : and what is always allowed, for values that are zero ·
    ``others`` : what a known confusion gives, by its words: "predictor for filter gain", "P⁻ for P⁺", "strength for covariance"

    >>> import numpy as np
    >>> AskedValue("gain_steady", "c", r"\bar K", "steady gain", "1", np.array([0.5]), THREE_DIGITS, 0.0, {}).allowed
    array([0.0025])
    """

    name: str
    item: str
    symbol: str
    meaning: str
    unit: str
    value: Array
    relative: float
    absolute: float
    others: Mapping[str, Array]

    @property
    def allowed(self) -> Array:
        """How far each element of an answer may lie from the right one."""
        found: Array = self.relative * abs(self.value) + self.absolute
        return found
