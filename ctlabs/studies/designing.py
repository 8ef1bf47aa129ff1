"""From a model file with [cost] to its regulator, and that regulator in a loop with another truth."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ctlabs.linalg.checks import Array
from ctlabs.models import ContinuousModel, Cost, DiscreteModel
from ctlabs.regulation import regulator
from ctlabs.regulation.design import Regulator, Sampling, with_integral_weights
from ctlabs.text import moment

if TYPE_CHECKING:
    from ctlabs.files.modelfile import ModelFile, RegulatorSettings


class Designed(NamedTuple):
    """A regulator of a model file.

    ``file`` · ``model`` with its inputs · ``cost`` and ``told``, how it was built · ``R`` of the samples, where the file has it ·
    ``regulator`` · ``dropped``, set points that a horizon leaves no room for
    """

    file: ModelFile
    model: ContinuousModel | DiscreteModel
    cost: Cost
    told: RegulatorSettings
    R: Array | None
    regulator: Regulator
    dropped: tuple[str, ...]

    @property
    def options(self) -> dict[str, Any]:
        """As for :func:`ctlabs.regulation.regulator`, but for the period."""
        return _options(self.file, self.told, self.R)


def _options(file: ModelFile, told: RegulatorSettings, R: Array | None) -> dict[str, Any]:
    found = told._asdict()
    if file.kind == "discrete":
        del found["delay"]
        return found
    return found | {"R": R}


def designed(file: ModelFile, judge: ModelFile | None = None) -> Designed:
    """The regulator of a model file; without [cost] of its own with that of ``judge``.

    Raises
    ------
    ValueError
        No [cost]; no B; whatever :func:`ctlabs.regulation.regulator` refuses.

    >>> from ctlabs.files.modelfile import ready
    >>> designed(ready("dc_motor")).regulator.L.round(4)
    array([[1.1938, 0.9496]])
    """
    source = file if judge is None or file.cost is not None else judge
    told, cost = source.regulator, source.cost
    assert cost is not None  # its options were there
    horizon = cost.horizon
    steps = None if horizon is None else max(1, round(horizon if file.kind == "discrete" else horizon / file.dt))
    model = file.plant(steps)
    dropped: tuple[str, ...] = ()
    if steps is not None and not (told.integral or told.loads):
        dropped, told = told.track, told._replace(track=())
    first: dict[str, Any] = {} if steps is None else {"first": file.experiment.first}
    if isinstance(model, DiscreteModel):
        return Designed(file, model, cost, told, None, regulator(model, cost, **_options(file, told, None) | first), dropped)
    R = None if model.Rc is not None else file.matrix("R")
    return Designed(file, model, cost, told, R, regulator(model, cost, dt=file.dt, **_options(file, told, R) | first), dropped)


def placed(design: Designed, truth: Designed) -> Regulator:
    """A regulator whose loops with the truth are sampled, delayed and weighed as the truth says, not as the design believes."""
    found = design.regulator
    if isinstance(truth.model, ContinuousModel):
        if found.sampling is None:
            msg = "design: expected a continuous model as the truth's, received a discrete one"
            raise ValueError(msg)
        own = Sampling(truth.model, truth.cost, found.plant.dt, truth.R, False, truth.told.delay)
        return dataclasses.replace(found, sampling=own)
    if found.sampling is not None:
        msg = "design: expected a discrete model as the truth's, received a continuous one"
        raise ValueError(msg)
    if design is truth or found.loads or found.steps is not None or truth.model.n != found.plant.n:
        return found
    integrals = np.diag(found.weights.Qx)[found.plant.n :]
    return dataclasses.replace(found, weights=with_integral_weights(truth.cost.weights(truth.model), integrals))


def changed(file: ModelFile, **told: Any) -> ModelFile:
    """A model file with other values in [cost] (``horizon``, ``delay``, ``kind``) or another period (``dt``); ``None`` changes nothing.

    Raises
    ------
    ValueError
        A period of a discrete model, which has its own; what the file refuses, with its place.

    >>> from ctlabs.files.modelfile import ready
    >>> changed(ready("dc_motor"), dt=0.5, delay=0.1).regulator.delay
    0.1
    """
    wanted = {name: value for name, value in told.items() if value is not None}
    dt = wanted.pop("dt", None)
    if dt is not None:
        if file.kind == "discrete":
            msg = f"dt: expected none with a discrete model, which has its own period, received {moment(dt)}"
            raise ValueError(msg)
        file = file.edit(("model", "dt"), dt)
    places: Sequence[Any] = [(("cost", name), value) for name, value in wanted.items()]
    if places and file.cost is None:
        _ = file.regulator  # says what is missing
    return file.edit_all(places).checked()
