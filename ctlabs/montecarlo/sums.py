"""What a block gives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ctlabs.linalg.checks import Array


class Sums(NamedTuple):
    """The table of sums (steps+1, columns) and the counts of a histogram (steps+1, states, bins), which may be empty."""

    table: Array
    counts: np.ndarray

    def plus(self, other: Sums) -> Sums:
        """The sums over both; added in block order, so that the bytes do not depend on who finished first."""
        return Sums(self.table + other.table, self.counts + other.counts)


def columns(d: int) -> int:
    """Columns of the table for d compared states; what they hold: :mod:`ctlabs.montecarlo.kernel`."""
    return 6 * d + 4 + d * (d + 1) // 2
