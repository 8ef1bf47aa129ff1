"""The likelihood of several independent records of one model: the sum of theirs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.analysis.likelihood import Build, Likelihood
from ctlabs.filtering.results import Filtered
from ctlabs.linalg.checks import Array


class Joint(Likelihood):
    """:class:`Likelihood` of several records, each with a model of its own made from the same constants."""

    def __init__(self, builds: Sequence[Build], z: Sequence[ArrayLike], names: tuple[str, ...], first: int | None) -> None:
        super().__init__(builds[0], z[0], names, first)
        self.parts = [Likelihood(build, rows, names, first) for build, rows in zip(builds, z, strict=True)]

    def at_start(self, values: Array, *, possible: bool = False) -> None:
        """Refuse what one of the records refuses."""
        for part in self.parts:
            part.at_start(values, possible=possible)
        self.used = sum(part.used for part in self.parts)

    def extra(self, values: Array) -> float:
        """The sum of the records' own."""
        return sum(part.extra(values) for part in self.parts)

    def filtered(self, values: Array) -> Filtered:
        """The first record that contradicts these values, or the first."""
        found = [part.filtered(values) for part in self.parts]
        return next((each for each in found if each.contradictions), found[0])

    def residuals(self, values: Array) -> Array:
        """Those of all records."""
        return np.concatenate([part.residuals(values) for part in self.parts])

    def _value(self, values: Array) -> float:
        return sum(part(values) for part in self.parts)
