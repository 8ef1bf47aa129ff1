"""What is done with a measured record, apart from how: it is loaded with every draft."""

from __future__ import annotations

import math
from dataclasses import dataclass

#: Most steps of a forecast.
FORECAST = 100_000


@dataclass(frozen=True, slots=True)
class Wanted:
    """What is done with a record: by which ``algorithm`` it is filtered ("" for the model file's first), whether it is ``smooth``-ed, what
    is beyond the ``gate`` (σ) left out, how many ``steps`` are forecast, and ``which`` of several records is looked at.
    """

    algorithm: str = ""
    smooth: bool = True
    gate: float | None = None
    steps: int = 0
    which: int = 0

    def check(self) -> None:
        """Refuse in one line what cannot be."""
        if self.gate is not None and not 0 < self.gate < math.inf:
            raise ValueError(f"gate: expected a number of σ > 0, received {self.gate!r}")
        if not 0 <= self.steps <= FORECAST:
            raise ValueError(f"forecast: expected 0 to {FORECAST} steps, received {self.steps}")
