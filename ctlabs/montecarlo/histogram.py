r"""Histograms and quantiles of chosen errors, counted while the runs stream by.

The bins of state i at step k are equal parts of ±span·σ, σ the claimed standard deviation; the outer two also hold
everything beyond.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array


@dataclass(frozen=True, slots=True)
class Bins:
    """What to count: the errors of ``states``, in ``bins`` equal parts of ±``span`` standard deviations.

    ``sd`` (states,) or (steps+1, states) gives these; without it they are the ones that the filter claims, which
    needs gains known beforehand.
    """

    states: tuple[int, ...]
    bins: int = 100
    span: float = 5.0
    sd: Array | None = None

    def __post_init__(self) -> None:
        checks.count("bins", self.bins, least=2)
        checks.positive("span", self.span)
        if not self.states or len(set(self.states)) < len(self.states):
            msg = f"states: expected different indices of compared states, received {self.states!r}"
            raise ValueError(msg)


class Histogrammed(NamedTuple):
    """What the kernel needs of it: the states' indices (s,) and bins per unit of error (steps+1, s)."""

    states: np.ndarray
    scale: Array


@dataclass(frozen=True, slots=True, eq=False)
class Histogram:
    """``counts`` (steps+1, states, bins), whole numbers · ``edges`` (steps+1, states, bins+1) in the states' units."""

    states: tuple[int, ...]
    counts: np.ndarray
    edges: Array

    def quantile(self, p: float) -> Array:
        """The p-quantile of each chosen error at each step, (steps+1, states), to a bin's width; linear inside a bin."""
        if not 0 < p < 1:
            msg = f"p: expected a probability between 0 and 1, received {p!r}"
            raise ValueError(msg)
        below = np.cumsum(self.counts, axis=2)
        target = p * below[:, :, -1:]
        place = (below < target).sum(axis=2, keepdims=True).clip(max=self.counts.shape[2] - 1)
        inside = np.take_along_axis(self.counts, place, 2)
        before = np.take_along_axis(below, place, 2) - inside
        share = (target - before) / np.maximum(inside, 1)
        low, high = (np.take_along_axis(self.edges, place + i, 2) for i in (0, 1))
        result: Array = (low + share * (high - low))[:, :, 0]
        return result


def half_width(bins: Bins, claimed: Array | None, steps: int) -> Array:
    """Half of the range counted, (steps+1, states); ±span where the filter claims to know the state exactly."""
    if bins.sd is not None:
        chosen = checks.shaped("sd", bins.sd, (len(bins.states),), (steps + 1, len(bins.states)))
    elif claimed is None:
        msg = "sd: expected the bins' scale (the design has no covariance known beforehand), received None"
        raise ValueError(msg)
    elif not 0 <= min(bins.states) <= max(bins.states) < claimed.shape[1]:
        msg = f"states: expected indices of {claimed.shape[1]} compared states, received {bins.states}"
        raise ValueError(msg)
    else:
        chosen = claimed[:, list(bins.states)]
    half = np.broadcast_to(bins.span * np.where(chosen > 0, chosen, 1.0), (steps + 1, len(bins.states)))
    return np.array(half, order="C")  # columns that were picked are stored column by column: a kernel of their own


@dataclass(frozen=True, slots=True, eq=False)
class Counter:
    """Where the counts go; without ``bins`` nothing is counted."""

    bins: Bins | None
    half: Array

    @classmethod
    def of(cls, bins: Bins | None, claimed: Array | None, steps: int) -> Counter:
        """For the claimed standard deviations (steps+1, d) of a design, or None."""
        return cls(bins, np.zeros((steps + 1, 0)) if bins is None else half_width(bins, claimed, steps))

    def arrays(self) -> tuple[Histogrammed, np.ndarray]:
        """The kernel's arrays and the table of counts, zero at the start."""
        states = np.array(() if self.bins is None else self.bins.states, dtype=np.int64)
        count = 1 if self.bins is None else self.bins.bins
        return Histogrammed(states, 0.5 * count / self.half), np.zeros((*self.half.shape, count), dtype=np.int64)

    def finish(self, counts: np.ndarray) -> Histogram | None:
        """The histogram from its counts."""
        if self.bins is None:
            return None
        return Histogram(self.bins.states, counts, self.half[:, :, None] * np.linspace(-1, 1, self.bins.bins + 1))
