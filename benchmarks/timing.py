"""How the benchmarks measure: medians, of a few repetitions each."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

#: Repetitions of which the median is taken.
REPEATS = 7


def median(action: Callable[[], object]) -> float:
    """Median seconds of an action."""
    return statistics.median(timed(action) for _ in range(REPEATS))


def timed(action: Callable[[], object]) -> float:
    """Seconds of an action."""
    start = time.perf_counter()
    action()
    return time.perf_counter() - start
