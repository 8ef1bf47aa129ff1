"""An experiment with functions: a nonlinear truth, an extended or other filter, step by step over tiles of runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from threading import Event

import numpy as np

from ctlabs.filtering import measured
from ctlabs.filtering.extended import EnsembleFilter, Extended
from ctlabs.filtering.results import Covariances, Mask
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.linalg.factors import root
from ctlabs.models import DiscreteModel
from ctlabs.models.histories import Truth, entry, truth_arrays
from ctlabs.models.nonlinear import NonlinearModel
from ctlabs.montecarlo import identity, streams
from ctlabs.montecarlo.histogram import Bins, Counter
from ctlabs.montecarlo.nonlinear import Scheduled, normalised
from ctlabs.montecarlo.plan import WIDTH, Gains, Tiling, gains, layout, missing
from ctlabs.montecarlo.statistics import Claims
from ctlabs.montecarlo.sums import Sums, columns


@dataclass(frozen=True, slots=True, eq=False)
class LinearWorld:
    """A linear truth made of white noises."""

    arrays: Truth
    absent: Mask

    @property
    def sizes(self) -> tuple[int, int, int]:
        """White noises for x0, w, v."""
        return self.arrays.F0.shape[1], self.arrays.G.shape[2], self.arrays.L.shape[2]

    def start(self, xi: Array) -> Array:
        """x at t0."""
        return self.arrays.x0[:, None] + self.arrays.F0 @ xi

    def move(self, k: int, x: Array, xiw: Array, xiv: Array) -> Array:
        """From k to k+1."""
        truth = self.arrays
        x = entry(truth.Phi, k) @ x + entry(truth.c, k)[:, None] + entry(truth.G, k) @ xiw
        return x + entry(truth.C, k) @ xiv if len(truth.C) else x

    def measure(self, k: int, x: Array, xiv: Array) -> Array:
        """z at k, NaN where not measured."""
        z = entry(self.arrays.H, k) @ x + entry(self.arrays.L, k) @ xiv
        z[self.absent[k]] = np.nan
        return z


@dataclass(frozen=True, slots=True, eq=False)
class FunctionWorld:
    """A nonlinear truth made of white noises."""

    model: NonlinearModel
    F0: Array
    G: Array
    L: Array
    absent: Mask

    @property
    def sizes(self) -> tuple[int, int, int]:
        """White noises for x0, w, v."""
        return self.F0.shape[1], self.G.shape[2], self.L.shape[2]

    def start(self, xi: Array) -> Array:
        """x at t0."""
        return self.model.x0[:, None] + self.F0 @ xi

    def move(self, k: int, x: Array, xiw: Array, xiv: Array) -> Array:
        """From k to k+1."""
        return np.asarray(self.model.f(k, x, entry(self.G, k) @ xiw), dtype=np.float64)

    def measure(self, k: int, x: Array, xiv: Array) -> Array:
        """z at k, NaN where not measured."""
        z = np.array(self.model.h(k, x, entry(self.L, k) @ xiv), dtype=np.float64)
        z[self.absent[k]] = np.nan
        return z


World = LinearWorld | FunctionWorld
Design = Gains | NonlinearModel | Callable[[], EnsembleFilter]


@dataclass(frozen=True, slots=True, eq=False)
class Functional:
    """An experiment whose truth or design is not linear, ready to run."""

    steps: int
    first: int
    dt: float
    world: World
    design: Design
    E: Array
    layout: Tiling
    counter: Counter

    def prepare(self) -> None:
        """Nothing to compile."""

    def block(self, seed: int, block: int, runs: int, stop: Event | None = None) -> Sums:
        """The sums over the first ``runs`` runs of a block."""
        _, counts = self.counter.arrays()
        total = Sums(np.zeros((self.steps + 1, columns(len(self.E)) + 2)), counts)
        states, measurements = streams.generators(seed, block)
        with np.errstate(
            over="ignore", invalid="ignore"
        ):  # an overflow is reported with its step when blocks are merged
            for begin in range(0, runs, self.layout.width):
                self._tile(states, measurements, min(self.layout.width, runs - begin), total, stop)
        return total

    def claims(self, total: Sums, runs: int) -> Claims:
        """The clock, and the average dimensions counted."""
        t, zero = np.arange(self.steps + 1) * self.dt, np.zeros((self.steps + 1, len(self.E)))
        return Claims(t, self.first, zero, zero, total.table[:, -2] / runs, total.table[:, -1] / runs)

    def identity(self) -> dict[str, str]:
        """Digests of everything that the sums depend on."""
        return {
            **identity.versions(),
            "steps": str(self.steps),
            "first": str(self.first),
            "truth": identity.digest(self.world),
            "design": identity.digest(self.design, self.E),
            "histogram": identity.digest(self.counter),
        }

    def _filter(self) -> EnsembleFilter:
        if isinstance(self.design, Gains):
            return Scheduled(self.design.arrays, self.design.plan.P_plus, self.design.nis_dof)
        return Extended(self.design) if isinstance(self.design, NonlinearModel) else self.design()

    def _tile(
        self,
        states: np.random.Generator,
        measurements: np.random.Generator,
        count: int,
        total: Sums,
        stop: Event | None,
    ) -> None:
        """All steps of one tile; ``count`` of its runs are counted."""
        width, world, estimator = self.layout.width, self.world, self._filter()
        start, w, v = world.sizes
        early = isinstance(world, LinearWorld) and len(world.arrays.C) > 0
        x = world.start(states.standard_normal((start, width)))[:, :count]
        estimator.start(count)
        xiv = np.zeros((v, count))
        for k in range(self.steps + 1):
            if stop is not None and stop.is_set():
                msg = "stopped"
                raise RuntimeError(msg)
            if k:
                x = world.move(k - 1, x, states.standard_normal((w, width))[:, :count], xiv)
                estimator.predict(k)
            before = estimator.x - self.E @ x
            if k >= self.first or early:
                xiv = measurements.standard_normal((v, width))[:, :count]
            consistency = estimator.update(k, world.measure(k, x, xiv)) if k >= self.first else None
            self._add(total, k, x, before, estimator, consistency)

    def _add(
        self, total: Sums, k: int, x: Array, before: Array, estimator: EnsembleFilter, consistency: tuple[Array, float] | None
    ) -> None:
        """The columns of one step (see :mod:`ctlabs.montecarlo.kernel`)."""
        d, row, truth = len(self.E), total.table[k], self.E @ x
        e = estimator.x - truth
        for i, power in enumerate((e, e**4, before, before**2, before**4, truth**2)):
            row[i * d : (i + 1) * d] += power.sum(axis=1)
        if estimator.P is not None and np.isfinite(e).all():
            nees, rank = normalised(e, estimator.P)
            row[6 * d : 6 * d + 2] += nees.sum(), (nees**2).sum()
            row[-2] += rank * e.shape[1]
        if consistency is not None:
            nis, dof = consistency
            row[6 * d + 2 : 6 * d + 4] += nis.sum(), (nis**2).sum()
            row[-1] += dof * e.shape[1]
        row[6 * d + 4 : columns(d)] += (e @ e.T)[np.tril_indices(d)]
        if self.counter.bins is not None:
            count = self.counter.bins.bins
            place = e[list(self.counter.bins.states)] * (0.5 * count / self.counter.half[k])[:, None] + 0.5 * count
            for i, each in enumerate(np.clip(np.nan_to_num(place), 0, count - 1).astype(np.int64)):
                total.counts[k, i] += np.bincount(each, minlength=count)


def functional(
    truth: DiscreteModel | NonlinearModel,
    design: DiscreteModel | NonlinearModel | Callable[[], EnsembleFilter],
    steps: int,
    first: int,
    E: Array,
    given: Covariances | None = None,
    bins: Bins | None = None,
    algorithm: str = "auto",
) -> Functional:
    """The experiment of any truth and any design."""
    if isinstance(truth, DiscreteModel):
        measured.horizon(truth, steps)
        world: World = LinearWorld(truth_arrays(truth, steps), missing(truth, steps))
        grouping = layout(truth.n, steps)
    else:
        world = _function_world(truth, steps, first)
        grouping = Tiling(WIDTH, 1)  # Python's cost per step is shared by a tile; a block of one answers soonest
    m = truth.m
    claimed = None
    if isinstance(design, DiscreteModel):
        filtering = gains(design, steps, first, world.absent, E, given, algorithm)
        claimed = filtering.plan.sd_plus
        return Functional(steps, first, truth.dt, world, filtering, E, grouping, Counter.of(bins, claimed, steps))
    if given is not None:
        msg = f"gains: expected none beside a design that is not a DiscreteModel, received a {type(given).__name__}"
        raise ValueError(msg)
    if isinstance(design, NonlinearModel) and design.m != m:
        msg = f"design: expected {m} measurements as the truth has, received {design.m}"
        raise ValueError(msg)
    return Functional(steps, first, truth.dt, world, design, E, grouping, Counter.of(bins, claimed, steps))


def _function_world(truth: NonlinearModel, steps: int, first: int) -> FunctionWorld:
    """The factors of a nonlinear truth's noises."""
    if callable(truth.Qd) or callable(truth.R):
        msg = "truth: expected Qd and R as matrices (let f and h shape the noise), received a function"
        raise ValueError(msg)
    checks.count("steps", steps)
    if first not in (0, 1):
        msg = f"first: expected 0 or 1, received {first!r}"
        raise ValueError(msg)
    for name, matrix, least in (("Qd", truth.Qd, steps), ("R", truth.R, steps + 1)):
        if matrix.ndim == 3 and len(matrix) < least:
            msg = f"{name}: expected at least {least} entries for {steps} steps, received {len(matrix)}"
            raise ValueError(msg)
    infinite = np.isinf(np.diagonal(truth.R, axis1=-2, axis2=-1))
    if infinite.any() and truth.q != truth.m:
        msg = f"R: expected finite variances where h mixes {truth.q} noises into {truth.m} measurements, received inf"
        raise ValueError(msg)
    absent = np.array(np.broadcast_to(infinite, (steps + 1, truth.q))) if infinite.ndim == 1 else infinite[: steps + 1]
    if truth.q != truth.m:
        absent = np.zeros((steps + 1, truth.m), dtype=bool)
    finite = np.where(np.isfinite(truth.R), truth.R, 0.0)
    Q = truth.Qd if truth.Qd.ndim == 3 else truth.Qd[None]
    R = finite if finite.ndim == 3 else finite[None]
    F0 = root(truth.P0)
    return FunctionWorld(
        truth,
        F0[:, F0.any(axis=0)],
        np.array([root(each) for each in Q]),
        np.array([root(each) for each in R]),
        absent,
    )
