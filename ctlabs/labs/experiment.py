"""How a lab's experiments are run: number of runs, seed, and where the work is done.

A lab receives an :class:`Experiment` and asks it for statistics or histories; workers and checkpoints are the caller's
business. Every ``stream`` is an independent sequence of random numbers; the default one is common to all filters of a
lab, so that they are compared on the same data. Labs of different names have different sequences: their experiments are
as many experiments, and not one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ctlabs import montecarlo
from ctlabs.filtering import filter as filtering
from ctlabs.filtering.measured import begins
from ctlabs.filtering.results import Covariances, Filtered

if TYPE_CHECKING:
    from ctlabs.models import DiscreteModel


#: The labs' gains and covariances come from filterpy, the oracle of all other engines.
ALGORITHM = "filterpy"


def covariances(model: DiscreteModel, steps: int, first: int | None = None) -> Covariances:
    """:func:`ctlabs.covariances` by filterpy.

    >>> from ctlabs import DiscreteModel
    >>> covariances(DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[10]]), 2).algorithm
    'filterpy'
    """
    return filtering.covariances(model, steps, first=first, algorithm=ALGORITHM)


def filtered(model: DiscreteModel, z: ArrayLike, first: int | None = None, gains: Covariances | None = None) -> Filtered:
    """:func:`ctlabs.kalman_filter` by filterpy.

    >>> from ctlabs import DiscreteModel
    >>> filtered(DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[10]]), [5, 5, 5]).x_plus[1:, 0].round(4)
    array([4.5833, 4.8571, 4.9462])
    """
    return filtering.kalman_filter(model, z, first=first, gains=gains, algorithm=ALGORITHM)


@dataclass(frozen=True, slots=True)
class Experiment:
    """A computational experiment of ``runs`` runs.

    ``workers`` : blocks of runs computed at a time (all cores) · ``executor`` : where, as for
    :func:`ctlabs.montecarlo.monte_carlo` · ``checkpoint`` : folder in which finished blocks are kept, one folder for each
    ensemble of the lab in their order · ``progress`` : function of (which ensemble, from 0; its runs that are done) · none
    of them changes a number · ``name`` : of the lab, for its own random numbers.
    """

    runs: int = 1000
    seed: int = 1
    workers: int | None = None
    executor: montecarlo.Team | str | None = None
    checkpoint: Path | None = None
    name: str = ""
    progress: Callable[[int, int], object] | None = None
    _ensembles: Iterator[int] = field(default_factory=count, repr=False, compare=False)

    @contextmanager
    def with_workers(self) -> Iterator[Experiment]:
        """The same experiment with its workers started once for all ensembles."""
        with montecarlo.team(self.executor, self.workers) as crew:
            yield replace(self, executor=crew, _ensembles=count())

    def statistics(
        self, truth: DiscreteModel, design: DiscreteModel | None = None, *, steps: int, stream: int = 0, **more: Any
    ) -> montecarlo.Statistics:
        """Statistics of the error of ``design``'s filter on data of ``truth`` (streamed, no histories)."""
        number, tell = next(self._ensembles), self.progress
        folder = None if self.checkpoint is None else self.checkpoint / f"{number:03d}"
        if tell is not None:
            tell(number, 0)
            more = {"progress": lambda done, _: tell(number, done)} | more
        return montecarlo.monte_carlo(
            truth,
            design,
            steps=steps,
            runs=self.runs,
            seed=self.seed_of(stream),
            executor=self.executor,
            workers=self.workers,
            checkpoint=folder,
            **({"algorithm": ALGORITHM} | more),
        )

    def histories(
        self,
        truth: DiscreteModel,
        design: DiscreteModel | None = None,
        *,
        steps: int,
        runs: int = 25,
        stream: int = 0,
        first: int | None = None,
    ) -> Filtered:
        """A few runs with their histories, for figures of single runs."""
        first = begins(truth, first)
        simulation = montecarlo.simulate(truth, steps, runs, self.seed_of(stream), first=first)
        return replace(filtered(design or truth, simulation.z, first=first), truth=simulation.x)

    def seed_of(self, stream: int) -> int:
        """The seed of a stream of the lab's random numbers."""
        return int(np.random.SeedSequence([self.seed, stream, *self.name.encode()]).generate_state(1, np.uint64)[0])
