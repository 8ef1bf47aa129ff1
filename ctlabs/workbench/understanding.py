r"""What a model's filter will do, before there are any data: everything the page "Understand" shows, part by part.

Each part is a result, or the reason in one line why there is none: a model that is not observable still has poles, one that
varies with time still has a P(t).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from ctlabs.files.modelfile import Experiment, ModelFile
from ctlabs.filtering import bucy, steady
from ctlabs.filtering.filter import covariances
from ctlabs.filtering.settle import settling
from ctlabs.filtering.steady import SteadyState
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import deviations
from ctlabs.models import ContinuousModel, DiscreteModel, observability
from ctlabs.models.observability import Observability, SamplingLoss
from ctlabs.text import latex_number

#: P(t) is computed over so many steps at most (of a model that is integrated between them: fewer), the frequency response at so
#: many points.
STEPS, INTEGRATED, POINTS = 400, 100, 300
#: Transfer functions are written out, and responses computed, for so many pairs of a state and a measurement.
PAIRS = 12
#: The settling step is looked for among so many steps.
LONGEST = 4096

Value = TypeVar("Value", covariant=True)


@dataclass(frozen=True, slots=True, eq=False)
class Part(Generic[Value]):
    """A result, or the ``reason`` why there is none. ``if part: use(part.value)``."""

    found: Value | None = None
    reason: str = ""

    def __bool__(self) -> bool:
        return self.found is not None

    @property
    def value(self) -> Value:
        """The result; ``ValueError`` with the reason where there is none."""
        if self.found is None:
            raise ValueError(self.reason)
        return self.found


@dataclass(frozen=True, slots=True, eq=False)
class Poles:
    """``model``, eigenvalues of F or Φ · ``filter``, of its steady filter (``None`` where there is none) · ``plane``, "s" or "z"."""

    model: Array
    filter: Array | None
    plane: str


@dataclass(frozen=True, slots=True, eq=False)
class Limit:
    """The steady filter: its covariances and gains, and from which step (``settled``, ``None``: not within 4096) and time on
    every variance stays within 1 % of it.
    """

    state: SteadyState
    settled: int | None
    time: float | None

    @property
    def sd_minus(self) -> Array:
        """Standard deviations before an update, (n,)."""
        return deviations(self.state.P_minus)

    @property
    def sd_plus(self) -> Array:
        """Standard deviations after an update, (n,)."""
        return deviations(self.state.P_plus)


@dataclass(frozen=True, slots=True, eq=False)
class Transfer:
    """From a measurement to an estimate: coefficients of ascending powers of z⁻¹ (``dt`` > 0) or descending ones of s (dt = 0)."""

    state: str
    measurement: str
    num: Array
    den: Array
    dt: float

    @property
    def name(self) -> str:
        """"estimate ← measurement"."""  # fmt: skip
        return f"{self.state} ← {self.measurement}"

    @property
    def latex(self) -> str:
        """The function, written."""
        if self.dt:
            return rf"\frac{{{_ascending(self.num)}}}{{{_ascending(self.den)}}}"
        return rf"\frac{{{_descending(self.num)}}}{{{_descending(self.den)}}}"


@dataclass(frozen=True, slots=True, eq=False)
class Bode:
    """Frequency responses of the steady filter.

    ``w`` (points,), rad/s, up to the Nyquist frequency · ``names`` (pairs,) · ``gain`` (pairs, points), ratio of amplitudes ·
    ``phase`` (pairs, points), degrees, without jumps
    """

    w: Array
    names: tuple[str, ...]
    gain: Array
    phase: Array


@dataclass(frozen=True, slots=True, eq=False)
class Transient:
    """From the start on: ``t`` (steps+1,) s · ``P_minus``, ``P_plus`` (steps+1, n, n) · ``K`` (steps+1, n, m) · ``first``."""

    t: Array
    P_minus: Array
    P_plus: Array
    K: Array
    first: int

    @property
    def sd_minus(self) -> Array:
        """(steps+1, n)."""
        return deviations(self.P_minus)

    @property
    def sd_plus(self) -> Array:
        """(steps+1, n)."""
        return deviations(self.P_plus)


@dataclass(frozen=True, slots=True, eq=False)
class Understanding:
    """What can be said of a model.

    ``continuous``, ``discrete``: the models (the samples, of a continuous file) · ``observability`` of the samples, and ``sampling``,
    what they lose · ``poles`` (in the plane of z, and ``poles_continuous`` in that of s) · ``limit``, the steady filter ·
    ``continuous_limit``, of a continuous measurement (Rc) · ``transfers``, ``bode`` of the steady filter · ``transient``, P(t)
    """

    states: tuple[str, ...]
    units: tuple[str, ...]
    measurements: tuple[str, ...]
    measurement_units: tuple[str, ...]
    continuous: Part[ContinuousModel]
    discrete: Part[DiscreteModel]
    observability: Part[Observability]
    sampling: Part[SamplingLoss]
    poles: Part[Poles]
    poles_continuous: Part[Poles]
    limit: Part[Limit]
    continuous_limit: Part[bucy.SteadyState]
    transfers: Part[tuple[Transfer, ...]]
    bode: Part[Bode]
    transient: Part[Transient]

    @property
    def sentences(self) -> tuple[str, ...]:
        """The main things in words."""
        return tuple(_sentences(self))


def warm() -> None:
    """Load what :func:`understand` needs (about a second), so that the first model is understood as quickly as the next ones."""
    from ctlabs.files.modelfile import new

    understand(new())


def understand(file: ModelFile) -> Understanding:
    """Everything that can be said of a model; nothing is raised, each part has its own reason."""
    try:
        file.checked()
    except ValueError as error:
        return _nothing(file, " ".join(str(error).split()))
    integrated = file.kind == "continuous" and {"F", "G", "Q", "B"} & set(file.varying)
    steps = min(file.experiment.steps, INTEGRATED if integrated else STEPS)
    discrete = _part(lambda: file.discrete(steps=steps))
    discrete_only: Part[ContinuousModel] = Part(reason="the model is given in discrete time")
    continuous = _part(file.continuous) if file.kind == "continuous" else discrete_only
    limit = _of(discrete, _limit)
    return Understanding(
        states=file.states,
        units=file.units,
        measurements=file.measurements,
        measurement_units=file.measurement_units,
        continuous=continuous,
        discrete=discrete,
        observability=_of(discrete, lambda model: observability.analyse(_constant(model))),
        sampling=_of(continuous, lambda model: observability.loss_by_sampling(model, file.dt)),
        poles=_of(
            discrete,
            lambda model: Poles(
                np.linalg.eigvals(_constant(model).Phi), limit.value.state.poles if limit else None, "z"
            ),
        ),
        poles_continuous=_of(continuous, _continuous_poles),
        limit=limit,
        continuous_limit=_of(continuous, bucy.steady),
        transfers=_of(limit, lambda found: _transfers(_constant(discrete.value), found.state)),
        bode=_of(limit, lambda found: _bode(_constant(discrete.value), found.state)),
        transient=_of(discrete, lambda model: _transient(model, steps, file.experiment)),
    )


def _nothing(file: ModelFile, reason: str) -> Understanding:
    """Of a file with problems."""
    from ctlabs.workbench.sheet import Sheet

    sheet = Sheet(file)
    names = (sheet.states, sheet.units, sheet.measurements, sheet.measurement_units)
    return Understanding(*names, *(Part(reason=reason) for _ in range(11)))


Given = TypeVar("Given")
Made = TypeVar("Made")


def _part(make: Callable[[], Made]) -> Part[Made]:
    try:
        with np.errstate(all="ignore"):
            return Part(make())
    except (ValueError, TypeError, ArithmeticError, np.linalg.LinAlgError) as error:
        return Part(reason=" ".join(str(error).split()) or type(error).__name__)


def _of(given: Part[Given], make: Callable[[Given], Made]) -> Part[Made]:
    """A part made of another, which hands its reason on."""
    return _part(lambda: make(given.value)) if given else Part(reason=given.reason)


def _constant(model: DiscreteModel) -> DiscreteModel:
    """The model without its known input, which moves no covariance; refused where more varies."""
    if model.offset is not None:
        model = dataclasses.replace(model, offset=None)
    if model.horizon is not None:
        msg = "the matrices vary with time: there are no modes and no steady filter to speak of"
        raise ValueError(msg)
    return model


def _continuous_poles(model: ContinuousModel) -> Poles:
    limit = _part(lambda: bucy.steady(model))
    return Poles(np.linalg.eigvals(model.F), limit.value.poles if limit else None, "s")


def _limit(model: DiscreteModel) -> Limit:
    model = _constant(model)
    found = steady.solve(model)
    settled = settling(model, longest=LONGEST)
    return Limit(found, settled, None if settled is None else settled * model.dt)


def _pairs(model: DiscreteModel) -> list[tuple[int, int]]:
    seen = [j for j in range(model.m) if np.isfinite(model.R[j, j])]
    return [(i, j) for i in range(model.n) for j in seen][:PAIRS]


def _transfers(model: DiscreteModel, limit: SteadyState) -> tuple[Transfer, ...]:
    return tuple(
        Transfer(model.states[i], model.measurements[j], *steady.transfer_function(model, i, j, limit), model.dt)
        for i, j in _pairs(model)
    )


def _bode(model: DiscreteModel, limit: SteadyState) -> Bode:
    nyquist = math.pi / model.dt
    w = np.geomspace(nyquist * 1e-4, nyquist, POINTS)
    late = np.exp(-1j * w * model.dt)[:, None, None]
    A, M = steady.loop(model, limit)
    pairs = _pairs(model)
    response = np.linalg.solve(np.eye(model.n) - A * late, limit.K + M * late)
    values = np.array([response[:, i, j] for i, j in pairs]).reshape(len(pairs), POINTS)
    gain = np.abs(values)
    phase = np.full(values.shape, np.nan)
    for row, value in zip(phase, values, strict=True):
        known = np.abs(value) > 0
        row[known] = np.degrees(np.unwrap(np.angle(value[known])))
    return Bode(w, tuple(f"{model.states[i]} ← {model.measurements[j]}" for i, j in pairs), gain, phase)


def _transient(model: DiscreteModel, steps: int, told: Experiment) -> Transient:
    plan = covariances(model, steps, first=told.first)
    return Transient(told.t0 + plan.t, plan.P_minus, plan.P_plus, plan.K, told.first)


# In words ------------------------------------------------------------------------------------------------------------


def _sentences(found: Understanding) -> list[str]:
    lines = []
    if seen := found.observability.found:
        if seen.ok:
            lines.append("Every state is observable.")
        else:
            lines.append(
                f"{len(seen.ranks) - seen.rank} of {len(seen.ranks)} dimensions are never seen: {'; '.join(seen.unobservable_modes)}."
            )
        if not seen.detectable:
            lines.append(f"Not detectable: {'; '.join(seen.undetectable_modes)} neither decays nor is seen.")
    if (loss := found.sampling.found) and loss.lost:
        lines.append(f"Sampling every {loss.dt:g} s loses what a continuous measurement would see.")
    if limit := found.limit.found:
        sizes = ", ".join(
            f"{name} {sd:.4g}{' ' + unit if unit else ''}"
            for name, unit, sd in zip(found.states, found.units, limit.sd_plus, strict=True)
        )
        lines.append(f"Steady standard deviations after an update: {sizes}.")
        if limit.settled is not None:
            lines.append(f"The filter settles within {limit.settled} steps ({limit.time:.4g} s).")
    elif found.discrete:
        lines.append(f"There is no steady filter: {found.limit.reason}.")
    return lines


def _ascending(p: Array) -> str:
    return _polynomial([(c, "" if i == 0 else f"z^{{-{i}}}") for i, c in enumerate(p)])


def _descending(p: Array) -> str:
    degree = len(p) - 1
    powers = ["" if d == 0 else "s" if d == 1 else f"s^{{{d}}}" for d in range(degree, -1, -1)]
    return _polynomial(list(zip(p, powers, strict=True)))


def _polynomial(terms: list[tuple[float, str]]) -> str:
    text = ""
    for coefficient, power in terms:
        if not coefficient:
            continue
        size = abs(coefficient)
        number = "" if size == 1 and power else latex_number(size) + (r"\," if power else "")
        sign = "-" if coefficient < 0 else "+" if text else ""
        text += f" {sign} {number}{power}" if text else f"{sign}{number}{power}"
    return text or "0"
