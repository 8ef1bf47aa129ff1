"""The standard experiment of a lab: one filter shown and tested.

Every lab compares an ensemble with the covariance theory in the same way (bias, RMS, NEES, NIS) and shows one run with its
band, the variances before and after each update, the gain, and the errors; so it is written once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.filtering.measured import begins
from ctlabs.filtering.results import Covariances
from ctlabs.labs.experiment import covariances
from ctlabs.montecarlo import chance
from ctlabs.reporting import plots
from ctlabs.text import Uncertain, squared, text, translated

if TYPE_CHECKING:
    from ctlabs.labs.experiment import Experiment
    from ctlabs.models import DiscreteModel
    from ctlabs.montecarlo import Statistics
    from ctlabs.reporting.report import Chance, Report


#: Measurements shown in the sawtooth of variances: the transient and a few steady teeth.
SHOWN = 15
#: Instants that are tested together, and how far the random numbers of that ensemble are from the others'.
TOGETHER, APART = 150, 1000
#: Powers of ten by which a state may outgrow its error in a simulation: half of the digits of a double are left.
GROWTH = 8.0


#: The figures of a portrait, and what each shows.
FIGURES = {
    "record": "One run: truth, measurements, and the estimate of {name} with its ±σ band.",
    "sawtooth": "Error variance of {name} before and after each update.",
    "gain": "The gain, known before any measurement.",
    "errors": "Innovations, prediction and filtering errors of 25 runs inside the bands of the theory.",
    "ensemble": "RMS and mean of the filtering errors of {runs} runs against theory, in the bands of 95 % of ensembles; "
    "NEES and NIS averaged over the runs.",
}


def rms(stats: Statistics, step: int = -1, state: int = 0, unit: str = "") -> Uncertain:
    """The RMS of the filtering errors of an ensemble at one instant, with its standard error σ/√(2·runs)."""
    found = float(stats.rms[step, state])
    return Uncertain(found, found / math.sqrt(2 * stats.runs), unit)


def mean_error(stats: Statistics, step: int = -1, state: int = 0, unit: str = "") -> Uncertain:
    """The mean of the filtering errors of an ensemble at one instant, with its standard error σ/√runs."""
    bias, square = float(stats.bias[step, state]), float(stats.rms[step, state]) ** 2
    return Uncertain(bias, math.sqrt(max(square - bias**2, 0.0) / stats.runs), unit)


def agreement(
    report: Report,
    name: str,
    stats: Statistics,
    P: ArrayLike,
    bias: ArrayLike | None = None,
    *,
    consistent: bool = True,
) -> float:
    """Put the ensemble's exact tests against theory into the report; returns the largest deviation, in sigmas.

    ``P`` (steps+1, n, n) and ``bias`` (steps+1, n; zero by default) are the theory's; a filter that is not
    ``consistent`` (its own P is not the truth) is tested in bias and variance only.
    """
    tests: dict[str, Chance] = {
        "mean error": chance.bias(stats, P, bias),
        "error variance": chance.variance(stats, P, bias),
    }
    if consistent:
        tests |= {
            "NEES": chance.nees(stats),
            "NIS": chance.nis(stats),
            "NIS of all instants together": chance.pooled_nis(stats),
        }
    return tested(report, name, tests)


def tested(report: Report, name: str, tests: Mapping[str, Chance]) -> float:
    """Put exact tests of the ensemble ``name`` into the report, by what they test; returns the largest deviation, in sigmas."""
    for what, test in tests.items():
        report.chance(text("{what}, {name}", what=what, name=name) if name else what, test)
    return max(abs(test.value) for test in tests.values())


def portrait(
    report: Report,
    experiment: Experiment,
    model: DiscreteModel,
    steps: int,
    *,
    prefix: str = "",
    xlabel: str = "measurement number i",
    state: int = 0,
    measurement: int = 0,
    limits: tuple[float, float] | None = None,
    first: int | None = None,
    stream: int = 0,
    figures: Mapping[str, str],
    together_steps: int = TOGETHER,
) -> Statistics:
    """Figures of a filter and the tests of its ensemble, into the report's present section.

    ``prefix`` tells the figures of several filters apart; ``state`` is the one shown, ``measurement`` the one that
    measures it; ``limits`` are its steady variances before and after an update. ``figures`` are those of :data:`FIGURES` that
    the lab needs, each with the sentence that says what one sees in it. ``together_steps`` are the instants
    that are tested together; an unstable state, whose rounding grows, permits fewer. Returns the statistics.
    """
    name, unit = model.states[state], model.units[state]
    first = begins(model, first)
    schedule = covariances(model, steps, first)
    some = experiment.histories(model, steps=steps, stream=stream, first=first)
    stats = experiment.statistics(model, steps=steps, stream=stream, first=first)
    labelled = text("{name}, {unit}", name=name, unit=unit)
    measured = measurement if model.H[..., measurement, state].any() else None  # another state's is not drawn over it
    draw: dict[str, Callable[[], plots.Figure]] = {
        "record": lambda: plots.record(some, xlabel=xlabel, ylabel=labelled, state=state, measurement=measured),
        "sawtooth": lambda: plots.sawtooth(
            {"": covariances(model, min(steps, SHOWN), first)}, xlabel=xlabel, state=state,
            ylabel=text("variance of {name}, {unit}", name=name, unit=squared(unit)), limits=None if limits is None else [limits],
        ),
        "gain": lambda: _gains(model, schedule, xlabel, first),
        "errors": lambda: plots.errors(
            some, xlabel=xlabel, unit=unit, state=state, measurement=measurement, measured_unit=_measured_unit(model, measurement)
        ),
        "ensemble": lambda: plots.ensemble_against_theory(
            stats, schedule.P_plus, xlabel=xlabel, units=model.units, names=model.states
        ),
    }  # fmt: skip
    for each, sees in figures.items():
        dotted = " Dotted: the limits." if each == "sawtooth" and limits else ""
        said = text(FIGURES[each], dotted, name=name, runs=experiment.runs)
        report.figure(f"{prefix}{each}", draw[each](), f"{said} {translated(sees)}".strip())
    agreement(report, prefix.strip("_"), stats, schedule.P_plus)
    together(report, prefix.strip("_"), experiment, model, stream=stream, first=first, steps=together_steps)
    return stats


def together(
    report: Report,
    name: str,
    experiment: Experiment,
    model: DiscreteModel,
    *,
    stream: int = 0,
    first: int | None = None,
    steps: int = TOGETHER,
) -> float:
    """Test a second ensemble of a constant filter over many instants, all of them together; returns the largest deviation.

    It is long enough for a variance that is wrong by a few per cent at every instant to be found; shorter where the state of an unstable
    system would outgrow the rounding of its error.
    """
    if model.horizon is not None:
        return 0.0
    steps = lasting(model, steps)
    stats = experiment.statistics(model, steps=steps, stream=stream + APART, first=first)
    tests: dict[str, Chance] = {text("NIS of {steps} instants together", steps=steps): chance.pooled_nis(stats)}
    if model.N is None:
        plan = covariances(model, steps, first)
        correlation = chance.error_correlation(model, plan)
        what = text("error variances of {steps} instants together", steps=steps)
        tests[what] = chance.pooled_variance(stats, plan.P_plus, correlation)
    return tested(report, name, tests)


def lasting(model: DiscreteModel, steps: int) -> int:
    """So many steps, or fewer: until an unstable state has grown 10⁸ times, beyond which its rounding would be seen in the errors.

    >>> from ctlabs import DiscreteModel
    >>> lasting(DiscreteModel([[1.3]], [[0]], [[1]], [[1]], P0=[[1]]), 150)
    70
    """
    growth = float(np.log10(max(float(np.abs(np.linalg.eigvals(model.Phi)).max()), 1.0)))
    return steps if growth * steps <= GROWTH else max(1, int(GROWTH / growth))


def largest(report: Report) -> str:
    """A conclusion: how far all ensembles of the report are from theory."""
    chances = [check for check in report.checks if check.kind == "CHANCE" and check.value is not None]
    if not chances:
        return text("No ensemble was tested: no filter here has a finite limit to compare with.")
    each = [(chance.adjusted(check.value or 0.0, check.tolerance), check) for check in chances]
    probability, worst = min(each, key=lambda pair: pair[0])
    said = (
        "Of {tests} tests of the ensemble the least probable result is a deviation of {worst} standard errors ({name}); "
        "if theory is right, one of so many tests comes out as improbable with a probability of at most {p}."
    )
    p = min(1.0, len(chances) * probability)
    if p > 0.995:  # the bound by the sum of all probabilities says nothing more
        said = (
            "Of {tests} tests of the ensemble the least probable result is a deviation of {worst} standard errors ({name}), "
            "which is nothing unusual in so many tests if theory is right."
        )
    return text(said, tests=len(chances), worst=round(abs(worst.value or 0.0), 2), name=worst.name, p=float(f"{p:.2g}"))


def _measured_unit(model: DiscreteModel, measurement: int) -> str:
    """The unit of a measurement that reads states of one unit; "units of z" where that cannot be told."""
    rows = model.H[..., measurement, :].reshape(-1, model.n)
    units = {unit for unit, read in zip(model.units, rows.T, strict=True) if read.any()}
    if len(units) == 1 and units != {""}:
        return units.pop()
    return "units of z"


def _gains(model: DiscreteModel, schedule: Covariances, xlabel: str, first: int) -> plots.Figure:
    names: Sequence[str] = model.states
    many = model.m > 1
    curves = {
        f"{name}" + (f" ← {model.measurements[j]}" if many else ""): schedule.K[first:, i, j]
        for i, name in enumerate(names)
        for j in range(model.m)
    }
    return plots.lines(
        schedule.t[first:], {k: np.asarray(v) for k, v in curves.items()}, xlabel=xlabel, ylabel="gain K", marker="."
    )
