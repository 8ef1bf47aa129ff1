r"""What a model's filter will do, before there are any data: :func:`compute`, part by part, for ``ctlabs analyse`` and the workbench.

Each part is a result, or the reason in one line why there is none: a model that is not observable still has poles, one that
varies with time still has a P(t).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from ctlabs.filtering import bucy, steady
from ctlabs.filtering.filter import covariances
from ctlabs.filtering.results import Covariances
from ctlabs.filtering.settle import settling
from ctlabs.filtering.steady import SteadyState
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import deviations
from ctlabs.models import ContinuousModel, DiscreteModel, observability
from ctlabs.models.observability import Observability, SamplingLoss
from ctlabs.reporting.drawing import Drawing, labelled
from ctlabs.reporting.plots import frequency
from ctlabs.reporting.plots.studies import before_after
from ctlabs.text import _, fill, latex_number

if TYPE_CHECKING:
    from ctlabs.files.modelfile import ModelFile

#: The settling step is looked for in so many steps.
SETTLING = 20_000
#: What is to be shown at once: so many steps (fewer of a model that is integrated between them), and the settling step among fewer.
QUICK, INTEGRATED, SOON = 400, 100, 4096
#: Transfer functions are written out, and responses computed, for so many pairs of a state and a measurement; points of a response.
PAIRS, POINTS = 12, 300

Value = TypeVar("Value", covariant=True)
Given = TypeVar("Given")
Made = TypeVar("Made")


@dataclass(frozen=True, slots=True, eq=False)
class Part(Generic[Value]):
    """A result, or the ``error`` that says why there is none. ``if part: use(part.value)``."""

    found: Value | None = None
    error: Exception | None = None

    def __bool__(self) -> bool:
        return self.found is not None

    @property
    def reason(self) -> str:
        """Why there is none, in one line; empty where there is one."""
        if self.error is None:
            return ""
        return " ".join(str(self.error).removeprefix("steady state: ").split()) or type(self.error).__name__

    @property
    def value(self) -> Value:
        """The result; its error where there is none."""
        if self.found is None:
            raise self.error or ValueError("expected a result, received none")
        return self.found


@dataclass(frozen=True, slots=True, eq=False)
class Poles:
    """``model``, eigenvalues of F or Φ · ``filter``, of its steady filter (``None`` where there is none) · ``plane``, "s" or "z"."""

    model: Array
    filter: Array | None
    plane: str

    @property
    def drawing(self) -> Drawing:
        """Both in the complex plane, and where stability ends."""
        found = {_("model"): self.model} | ({} if self.filter is None else {_("filter"): self.filter})
        return frequency.poles(found, plane=self.plane)


@dataclass(frozen=True, slots=True, eq=False)
class Limit:
    """The steady filter: its covariances and gains, and from which step (``settled``, ``None``: not within ``longest``) and time on
    every variance stays within 1 % of it.
    """

    state: SteadyState
    settled: int | None
    time: float | None
    longest: int

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
    """From a measurement to an estimate: coefficients of ascending powers of z⁻¹."""

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
        return rf"\frac{{{_polynomial(self.num)}}}{{{_polynomial(self.den)}}}"


@dataclass(frozen=True, slots=True, eq=False)
class Bode:
    """Frequency responses of a steady filter: ``w`` (points,), rad/s · ``response``, complex (points,), by "estimate ← measurement"."""

    w: Array
    response: dict[str, Any]

    @property
    def names(self) -> tuple[str, ...]:
        """The pairs."""
        return tuple(self.response)

    def drawing(self, names: Sequence[str] | None = None) -> Drawing:
        """Magnitude and phase of the named pairs (all)."""
        drawing = frequency.bode({name: self.response[name] for name in names or self.names}, self.w)
        return dataclasses.replace(drawing, verbatim=True)


@dataclass(frozen=True, slots=True, eq=False)
class Understanding:
    """What can be said of a model, a ``file``.

    ``continuous``, ``discrete``: the models (the samples, of a continuous file) · ``observability`` of the samples, and ``sampling``,
    what they lose · ``poles`` (in the plane of z, and ``poles_continuous`` in that of s) · ``limit``, the steady filter ·
    ``continuous_limit``, of a continuous measurement (Rc) · ``transfers``, ``bode`` of the steady filter · ``transient``, P(t)
    """

    file: ModelFile
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
    continuous_limit: Part[bucy.BucySteadyState]
    transfers: Part[tuple[Transfer, ...]]
    bode: Part[Bode]
    transient: Part[Covariances]

    @property
    def sentences(self) -> tuple[str, ...]:
        """The main things in words."""
        return (*self.seen, *self.settled)

    @property
    def seen(self) -> tuple[str, ...]:
        """What the measurements see, in words."""
        lines = []
        if seen := self.observability.found:
            missing = _("{count} of {n} dimensions are never seen: {modes}.")
            unseen = {"count": len(seen.ranks) - seen.rank, "n": len(seen.ranks), "modes": "; ".join(seen.unobservable_modes)}
            lines.append(_("Every state is observable.") if seen.ok else fill(missing, **unseen))
            if not seen.detectable:
                text = _("Not detectable: {modes} neither decays nor is seen, so its error has no limit that does not depend on P0.")
                lines.append(fill(text, modes="; ".join(seen.undetectable_modes)))
        if (loss := self.sampling.found) and loss.lost:
            lines.append(fill(_("Sampling every {dt} s loses what a continuous measurement would see."), dt=loss.dt))
        return tuple(lines)

    @property
    def settled(self) -> tuple[str, ...]:
        """What the steady filter reaches, in words, or why there is none."""
        limit = self.limit.found
        if limit is None:
            return (fill(_("There is no steady filter: {reason}."), reason=self.limit.reason),) if self.discrete else ()
        parts = zip(self.states, self.units, limit.sd_plus, strict=True)
        sizes = ", ".join(f"{name} {sd:.4g}{' ' + unit if unit else ''}" for name, unit, sd in parts)
        lines = (fill(_("Steady standard deviations after an update: {sizes}."), sizes=sizes),)
        if limit.settled is None:
            return lines
        return *lines, fill(_("The filter settles within {steps} steps ({time} s)."), steps=limit.settled, time=limit.time)

    def deviations(self, states: Sequence[int]) -> Drawing:
        """Standard deviations over time as they will be, with their limits."""
        plan, limit = self.transient.value, self.limit.found
        panels = []
        for i in states:
            limits = () if limit is None else (limit.sd_minus[i], limit.sd_plus[i])
            label = labelled(self.states[i], self.units[i])
            panels.append(before_after(plan.t, plan.sd_minus[:, i], plan.sd_plus[:, i], label, self.units[i], ("σ⁻", "σ⁺"), limits))
        return Drawing(_("Standard deviation over time"), "t, s", tuple(panels), verbatim=True)


def compute(file: ModelFile, *, quick: bool = False) -> Understanding:
    """Everything that can be said of a model; nothing is raised, each part has its own reason. ``quick`` : what a page shows at once."""
    try:
        file.checked()
    except ValueError as error:
        return Understanding(file, (), (), (), (), *(Part(error=error) for _part in range(11)))
    integrated = file.kind == "continuous" and {"F", "G", "Q", "B"} & set(file.varying)
    steps = min(file.experiment.steps, INTEGRATED if integrated else QUICK) if quick else file.experiment.steps
    discrete = part(lambda: file.discrete(steps=steps))
    of_samples: Part[ContinuousModel] = Part(error=ValueError("the model is given in discrete time"))
    continuous = part(file.continuous) if file.kind == "continuous" else of_samples
    constant = of(discrete, _constant)
    limit = of(constant, lambda model: _limit(model, SOON if quick else SETTLING))
    return Understanding(
        file=file,
        states=file.states,
        units=file.units,
        measurements=file.measurements,
        measurement_units=file.measurement_units,
        continuous=continuous,
        discrete=discrete,
        observability=of(constant, observability.analyse),
        sampling=of(continuous, lambda model: observability.loss_by_sampling(model, file.dt)),
        poles=of(constant, lambda model: Poles(np.linalg.eigvals(model.Phi), limit.value.state.poles if limit else None, "z")),
        poles_continuous=of(continuous, _continuous_poles),
        limit=limit,
        continuous_limit=of(continuous, bucy.steady),
        transfers=of(limit, lambda found: _transfers(constant.value, found.state)),
        bode=of(limit, lambda found: _bode(constant.value, found.state)),
        transient=of(discrete, lambda model: _transient(model, steps, file)),
    )


def part(make: Callable[[], Made]) -> Part[Made]:
    """What is made, or why it is not."""
    try:
        with np.errstate(all="ignore"):
            return Part(make())
    except (ValueError, TypeError, ArithmeticError, np.linalg.LinAlgError) as error:
        return Part(error=error)


def of(given: Part[Given], make: Callable[[Given], Made]) -> Part[Made]:
    """A part made of another, which hands its error on."""
    return part(lambda: make(given.value)) if given else Part(error=given.error)


def pairs(model: DiscreteModel, most: int = PAIRS) -> list[tuple[int, int]]:
    """The first pairs of a state and a measurement that is made."""
    return [(i, j) for i in range(model.n) for j in range(model.m) if np.isfinite(model.R[j, j])][:most]


def _constant(model: DiscreteModel) -> DiscreteModel:
    """The model without its known input, which moves no covariance; refused where more varies."""
    if model.offset is not None:
        model = dataclasses.replace(model, offset=None)
    if model.horizon is not None:
        msg = "the matrices vary with time: there are no modes and no steady filter to speak of"
        raise ValueError(msg)
    return model


def _continuous_poles(model: ContinuousModel) -> Poles:
    limit = part(lambda: bucy.steady(model))
    return Poles(np.linalg.eigvals(model.F), limit.value.poles if limit else None, "s")


def _limit(model: DiscreteModel, longest: int) -> Limit:
    found = steady.solve(model)
    settled = settling(model, longest=longest)
    return Limit(found, settled, None if settled is None else settled * model.dt, longest)


def _transfers(model: DiscreteModel, limit: SteadyState) -> tuple[Transfer, ...]:
    return tuple(
        Transfer(model.states[i], model.measurements[j], *steady.transfer_function(model, i, j, limit), model.dt)
        for i, j in pairs(model)
    )


def _bode(model: DiscreteModel, limit: SteadyState) -> Bode:
    r"""H(z) = (I − Az⁻¹)⁻¹(K + Mz⁻¹) on the unit circle, up to the Nyquist frequency (see :func:`ctlabs.filtering.steady.loop`)."""
    nyquist = math.pi / model.dt
    w = np.geomspace(nyquist * 1e-4, nyquist, POINTS)
    late = np.exp(-1j * w * model.dt)[:, None, None]
    A, M = steady.loop(model, limit)
    response = np.linalg.solve(np.eye(model.n) - A * late, limit.K + M * late)
    return Bode(w, {f"{model.states[i]} ← {model.measurements[j]}": response[:, i, j] for i, j in pairs(model)})


def _transient(model: DiscreteModel, steps: int, file: ModelFile) -> Covariances:
    plan = covariances(model, steps, first=file.experiment.first)
    return dataclasses.replace(plan, t=file.experiment.t0 + plan.t)


def _polynomial(coefficients: Array) -> str:
    """In ascending powers of z⁻¹, in LaTeX."""
    text = ""
    for i, coefficient in enumerate(coefficients):
        if coefficient:
            size, power = abs(coefficient), "" if i == 0 else f"z^{{-{i}}}"
            number = "" if size == 1 and power else latex_number(size) + (r"\," if power else "")
            sign = "-" if coefficient < 0 else "+" if text else ""
            text += f" {sign} {number}{power}" if text else f"{sign}{number}{power}"
    return text or "0"
