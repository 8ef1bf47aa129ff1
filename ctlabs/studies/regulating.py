"""A model and a cost make a regulator, and what its loop does: the results of ``ctlabs regulate`` and of the workbench.

The truth is one model file. The regulator is designed with it, or with another one that is believed instead (``design``): then all
that a loop does is what the regulator of the design does to the truth, and what it costs beside what it might.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel
from ctlabs.regulation import cost_budget, ensemble, margins, periods, tradeoff
from ctlabs.regulation.budget import CostBudget
from ctlabs.regulation.closed import ClosedLoop, LoopCovariances, inner_loop, unstable
from ctlabs.regulation.curves import Periods, Tradeoff
from ctlabs.regulation.design import Regulator
from ctlabs.regulation.runs import LoopEnsemble
from ctlabs.regulation.stability import Margins
from ctlabs.studies.designing import Designed, changed, designed, placed
from ctlabs.studies.responses import Response, kicks, start, steps_of
from ctlabs.studies.understanding import Part, of, part
from ctlabs.text import _, fill

if TYPE_CHECKING:
    from ctlabs.files.modelfile import ModelFile

__all__ = ["Designed", "Regulated", "changed", "compute", "designed", "replayed"]

#: By what the inputs' weight is multiplied in the curve of trade-offs, and the period in that of periods.
FACTORS = tuple(np.geomspace(0.01, 100, 21).tolist())
PERIODS = tuple((2.0 ** np.arange(-4, 5)).tolist())


@dataclass(frozen=True, slots=True, eq=False)
class Regulated:
    """A regulator and its loop with the truth.

    ``file``, and that of the design, ``other``, where it is another one · ``design``, ``best`` : the regulator, and the right one for
    the truth (the same without ``other``) · ``placed``, the regulator with the truth's own sampling and weights · ``truth``, its
    model · ``loop``, both together · ``steps``, ``seed`` · ``over``, its covariances over time, and ``limit`` · ``cost`` (of the truth) ·
    ``budget`` · ``margins`` · ``set_points``, ``initial``, ``kicks`` : responses without noise · ``tradeoff``, ``periods`` : the costs
    of other weights and periods · ``ensemble``
    """

    file: ModelFile
    other: ModelFile | None
    design: Designed
    best: Designed
    placed: Regulator
    truth: DiscreteModel
    loop: ClosedLoop
    steps: int
    seed: int
    over: Part[LoopCovariances]
    limit: Part[LoopCovariances]
    cost: Part[float]
    budget: Part[CostBudget]
    margins: Part[Margins]
    set_points: Part[tuple[Response, ...]]
    initial: Part[Response]
    kicks: Part[tuple[Response, ...]]
    tradeoff: Part[Tradeoff]
    periods: Part[Periods]
    ensemble: Part[LoopEnsemble]

    @property
    def regulator(self) -> Regulator:
        """The regulator as it was designed."""
        return self.design.regulator

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return self.file.input_names

    @property
    def plain_inputs(self) -> tuple[str, ...]:
        """Names of the inputs in the library's results."""
        return self.loop.model.measurements[self.truth.m :]

    def weighed(self) -> list[list[str | float]]:
        """Rows (what is weighed, cost, share) of a loop with a budget, under the file's names; last what noise adds between the samples."""
        told, named = self.budget.value, dict(zip(self.plain_inputs, self.inputs, strict=True))
        parts = {named.get(name, name): value for name, value in told.weights.items()}
        if told.between:
            parts[_("between the samples")] = told.between
        return [[name, value, value / (told.total or 1.0)] for name, value in parts.items()]

    @property
    def per(self) -> str:
        """To what a cost refers: "s", "step", or "horizon"."""
        return self.regulator.cost.per

    @property
    def stable(self) -> bool:
        """Whether every mode of the loop decays, loads aside, which no input reaches; over a horizon there is none to tell."""
        poles = self.loop.poles
        loads = len(self.regulator.loads)
        return not len(poles) or int((np.abs(poles) >= 1).sum()) <= loads

    @property
    def growing(self) -> str:
        """The mode that does not decay, in words; empty where all do, or where there is none to tell."""
        if self.stable:
            return ""
        A = inner_loop(self.truth, self.regulator.machine)
        modes = unstable(A, self.loop.model.states[: len(A)], continuous=False)
        return fill(_("{modes}, which grows by a factor {factor} each step"), modes=modes, factor=float(np.abs(self.loop.poles).max()))

    @property
    def noted(self) -> tuple[str, ...]:
        """What was left out of what the file says."""
        return tuple(f"{name} follows no set point: there are none over a finite horizon" for name in self.design.dropped)


def compute(
    model: ModelFile,
    *,
    design: ModelFile | None = None,
    runs: int | None = None,
    steps: int | None = None,
    seed: int | None = None,
    workers: int | None = None,
    progress: Any = None,
    quick: bool = False,
) -> Regulated:
    """The regulator of ``model``, or of ``design``, in a loop with ``model``.

    Parameters
    ----------
    model : the truth, with [cost] · design : what is believed instead; its own [cost] where it has one
    runs, steps, seed : of the ensemble, and for how long the loop is followed; the model file's where not given
    workers, progress : as for :func:`ctlabs.monte_carlo`
    quick : without the ensemble, the margins (:func:`ctlabs.regulation.margins`) and the curves of trade-offs: what a page shows at once

    Raises
    ------
    ValueError
        No [cost], no B; a plant or a cost for which there is no regulator; a design of other inputs or measurements.
    """
    best = designed(model)
    chosen = best if design is None else designed(design, model)
    told = placed(chosen, best)
    plan = model.experiment
    horizon = chosen.regulator.steps
    count = horizon if horizon is not None else steps or plan.steps
    loop = told.loop(best.model)
    truth = loop.truth
    chance = plan.seed if seed is None else seed
    later: Part[Any] = Part(error=ValueError("it was not asked for"))
    over = part(lambda: loop.covariances(count))

    def many() -> LoopEnsemble:
        if found.growing:
            msg = "the loop is not stable"
            raise ValueError(msg)
        return ensemble(
            told, runs=runs or plan.runs, seed=chance, steps=count, truth=best.model, workers=workers, progress=progress
        )  # fmt: skip

    found = Regulated(
        file=model,
        other=design,
        design=chosen,
        best=best,
        placed=told,
        truth=truth,
        loop=loop,
        steps=count,
        seed=chance,
        over=over,
        limit=part(loop.steady),
        cost=part(lambda: _cost(chosen, told, best, design is None)),
        budget=part(lambda: cost_budget(chosen.regulator)),
        margins=later if quick else part(lambda: margins(told, truth)),
        set_points=part(lambda: steps_of(loop, count)),
        initial=of(over, lambda found: start(found, truth)),
        kicks=part(lambda: kicks(loop, best.model, count)),
        tradeoff=later if quick else part(lambda: _weights(chosen)),
        periods=later if quick else part(lambda: _periods(chosen)),
        ensemble=later,
    )
    return found if quick else dataclasses.replace(found, ensemble=of(over, lambda _known: many()))


def _cost(chosen: Designed, told: Regulator, best: Designed, right: bool) -> float:
    """What the loop costs: of the right design from the closed loop's own route."""
    return chosen.regulator.cost.closed_loop if right else told.actual_cost(best.model)


def _weights(chosen: Designed) -> Tradeoff:
    """σ of the states against σ of the inputs."""
    options = chosen.options if isinstance(chosen.model, DiscreteModel) else chosen.options | {"dt": chosen.file.dt}
    return tradeoff(chosen.model, chosen.cost, FACTORS, **options)


def _periods(chosen: Designed) -> Periods:
    """The cost per second of longer and shorter periods."""
    if isinstance(chosen.model, DiscreteModel) or chosen.cost.horizon is not None:
        what = "a discrete model has the one period" if isinstance(chosen.model, DiscreteModel) else "a horizon has its own periods"
        raise ValueError(what)
    return periods(chosen.model, chosen.cost, chosen.file.dt * np.array(PERIODS), **chosen.options)


def replayed(found: Regulated, z: Array) -> Array:
    """The inputs with which the controller, step by step, answers a record of measurements (steps, m): (steps, r)."""
    controller = found.regulator.controller()
    return np.array([controller.step(row) for row in z])
