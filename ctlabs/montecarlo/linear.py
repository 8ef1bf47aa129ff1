"""A linear experiment as blocks: the compiled kernel behind the interface that workers see."""

from __future__ import annotations

from dataclasses import dataclass
from threading import Event

import numpy as np

from ctlabs.filtering import measured
from ctlabs.filtering.results import Covariances
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel
from ctlabs.models.histories import Truth, truth_arrays
from ctlabs.models.linear import check_inputs
from ctlabs.montecarlo import identity, streams
from ctlabs.montecarlo.histogram import Bins, Counter
from ctlabs.montecarlo.plan import Gains, Tiling, about_mean_error, gains, layout, missing
from ctlabs.montecarlo.statistics import Claims
from ctlabs.montecarlo.sums import Sums, columns


@dataclass(frozen=True, slots=True, eq=False)
class LinearRuns:
    """A linear truth with a linear design, ready to run."""

    steps: int
    first: int
    dt: float
    truth: Truth
    gains: Gains
    layout: Tiling
    counter: Counter

    def prepare(self) -> None:
        """Compile the kernel, or load it: a block without tiles."""
        self._sums(0, 0, 0, 1)

    def block(self, seed: int, block: int, runs: int, stop: Event | None = None) -> Sums:
        """The sums over the first ``runs`` runs of a block."""
        tiles = -(-runs // self.layout.width)
        return self._sums(seed, block, tiles, runs - (tiles - 1) * self.layout.width)

    def claims(self, total: Sums, runs: int) -> Claims:
        """The clock, the mean errors the sums are taken about, the dimensions counted."""
        design = self.gains.arrays
        t = np.arange(self.steps + 1) * self.dt
        return Claims(t, self.first, design.shift_minus, design.shift, self.gains.nees_dof, self.gains.nis_dof)

    def identity(self) -> dict[str, str]:
        """Digests of everything that the sums depend on."""
        return {
            **identity.versions(),
            "steps": str(self.steps),
            "first": str(self.first),
            "truth": identity.digest(self.truth),
            "design": identity.digest(self.gains.arrays),
            "histogram": identity.digest(self.counter),
        }

    def _sums(self, seed: int, block: int, tiles: int, last: int) -> Sums:
        from ctlabs.montecarlo import kernel, ziggurat  # numba costs 0.3 s to import

        bins, counts = self.counter.arrays()
        table = np.zeros((self.steps + 1, columns(len(self.gains.arrays.x0))))
        states, measurements = streams.generators(seed, block)
        kernel.block(
            ziggurat.stream(states),
            ziggurat.stream(measurements),
            tiles,
            self.layout.width,
            last,
            self.first,
            self.truth,
            self.gains.arrays,
            bins,
            table,
            counts,
        )
        return Sums(table, counts)


def linear(
    truth: DiscreteModel,
    design: DiscreteModel,
    steps: int,
    first: int,
    E: Array,
    given: Covariances | None = None,
    bins: Bins | None = None,
    algorithm: str = "auto",
) -> LinearRuns:
    """The experiment of a linear truth and a linear design."""
    measured.horizon(truth, steps)
    check_inputs(truth, design)
    world = truth_arrays(truth, steps)
    filtering = gains(design, steps, first, missing(truth, steps), E, given, algorithm)
    # A filter that has the truth for its model has no mean error, whatever its gains.
    own = design is truth and filtering.arrays.same
    arrays = filtering.arrays if own else about_mean_error(world, filtering.arrays, steps, truth.dt)
    filtering = Gains(arrays, filtering.plan, filtering.nees_dof, filtering.nis_dof)
    counter = Counter.of(bins, filtering.plan.sd_plus, steps)
    return LinearRuns(steps, first, truth.dt, world, filtering, layout(truth.n, steps), counter)
