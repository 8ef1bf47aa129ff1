"""The experiment: a truth, a design, many runs, and the statistics of the error."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import Executor

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.filtering.extended import EnsembleFilter
from ctlabs.filtering.measured import begins
from ctlabs.filtering.results import Covariances
from ctlabs.linalg import checks
from ctlabs.linalg.threads import one_thread
from ctlabs.models import DiscreteModel
from ctlabs.models.nonlinear import NonlinearModel
from ctlabs.montecarlo.blocks import Merger
from ctlabs.montecarlo.checkpoint import Checkpoint
from ctlabs.montecarlo.executors import InBlocks, Task, Team, team
from ctlabs.montecarlo.functional import functional
from ctlabs.montecarlo.histogram import Bins
from ctlabs.montecarlo.linear import linear
from ctlabs.montecarlo.plan import selection
from ctlabs.montecarlo.progress import Progress, reporter
from ctlabs.montecarlo.statistics import Statistics, from_sums

Truth = DiscreteModel | NonlinearModel
Design = DiscreteModel | NonlinearModel | Callable[[], EnsembleFilter]


def monte_carlo(
    truth: Truth,
    design: Design | None = None,
    *,
    steps: int,
    runs: int,
    seed: int,
    compare: ArrayLike | None = None,
    gains: Covariances | None = None,
    algorithm: str = "auto",
    first: int | None = None,
    histogram: Bins | None = None,
    executor: Executor | Team | str | None = None,
    workers: int | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    progress: Progress = None,
) -> Statistics:
    r"""Simulate a truth, filter it with a design, and count the errors :math:`e = \hat x - Ex` of many runs.

    The design's gains are computed once (:func:`ctlabs.covariances`); a compiled kernel simulates, filters and
    accumulates without storing histories. A nonlinear truth or design runs by vectorised functions instead. The
    result has the same bytes for any number of workers, any executor, interrupted or not; more runs with the same
    seed continue the same experiment.

    Parameters
    ----------
    truth : what happens. x0 ~ N(x0, P0); elements with R = inf are not measured; N is honoured.
    design : what the filter believes; the truth itself if not given. It may have other matrices, another order, or be
        a :class:`NonlinearModel` (extended filter) or a function that makes a :class:`Filter`.
    steps, runs, seed : how many steps, how many runs, a whole number
    compare : E (d, n), which combination of the truth's states each of the design's d states estimates
    gains : with claimed covariances, to use instead of the design's optimal ones
    algorithm : the form of the design's filter, as for :func:`ctlabs.kalman_filter`
    first : 1 (first measurement at t1), 0 (at t0), or as the truth says
    histogram : errors to count in bins
    executor : ``None`` or ``"threads"``, ``"processes"``, the address of a Dask scheduler (``"tcp://host:8786"``), or
        any ``concurrent.futures.Executor``
    workers : all cores by default
    checkpoint : folder in which finished blocks are kept; the same call with the same folder resumes
    progress : ``None`` (a bar on a terminal), ``True``, ``False``, or a function of (runs done, runs)

    Returns
    -------
    Statistics

    Raises
    ------
    ValueError, TypeError
        Shapes that do not fit; a checkpoint of another experiment.
    FloatingPointError
        An unstable truth or filter overflows: the step and the time are in the message.
    BlockFailed
        A block failed four times; what is finished is kept.
    Interrupted
        Ctrl-C; the message says how to resume.

    >>> from ctlabs import covariances
    >>> m = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])
    >>> s = monte_carlo(m, steps=3, runs=1000, seed=1)
    >>> bool((abs(s.rms[1:, 0] ** 2 - covariances(m, 3).P_plus[1:, 0, 0]) < 0.2).all())
    True
    """
    runs, seed = checks.count("runs", runs), checks.count("seed", seed, least=0)
    own = truth if design is None else design
    experiment = prepare(truth, own, steps, compare, gains, first, histogram, algorithm)
    store = None if checkpoint is None else Checkpoint(checkpoint, {**experiment.identity(), "seed": str(seed)})
    with team(executor, workers) as crew, reporter(progress, runs) as show, one_thread():
        if crew.local:
            experiment.prepare()  # here, so that Ctrl-C reaches a compilation
        total = Merger(Task(experiment, seed), runs, crew, store, show).result()
    return from_sums(total.table, runs, experiment.claims(total, runs), experiment.counter.finish(total.counts))


def prepare(
    truth: Truth,
    design: Design,
    steps: int,
    compare: ArrayLike | None,
    given: Covariances | None,
    first: int | None,
    histogram: Bins | None,
    algorithm: str = "auto",
) -> InBlocks:
    """The experiment that runs in blocks."""
    if not isinstance(truth, DiscreteModel | NonlinearModel):
        msg = f"truth: expected a DiscreteModel or a NonlinearModel, received a {type(truth).__name__}"
        raise TypeError(msg)
    if not isinstance(design, DiscreteModel | NonlinearModel) and not callable(design):
        wanted = "a DiscreteModel, a NonlinearModel or a function that makes an EnsembleFilter"
        msg = f"design: expected {wanted}, received a {type(design).__name__}"
        raise TypeError(msg)
    first = begins(truth, first)
    if isinstance(design, DiscreteModel | NonlinearModel):
        E = selection(compare, design.n, truth.n)
    else:
        E = np.eye(truth.n) if compare is None else np.array(checks.shaped("compare", compare, ("d", truth.n)))
    if isinstance(truth, DiscreteModel) and isinstance(design, DiscreteModel):
        return linear(truth, design, steps, first, E, given, histogram, algorithm)
    return functional(truth, design, steps, first, E, given, histogram, algorithm)
