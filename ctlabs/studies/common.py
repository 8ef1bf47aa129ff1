"""What the studies share: a report begun, the model shown, the clock of a record, names fit for figures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ctlabs.analysis.naming import stands_for
from ctlabs.linalg.checks import Array
from ctlabs.models import ContinuousModel, DiscreteModel
from ctlabs.reporting import plots
from ctlabs.reporting.params import plain
from ctlabs.reporting.report import Report
from ctlabs.text import _, fill

if TYPE_CHECKING:
    from ctlabs.files.modelfile import ModelFile

__all__ = [
    "Settings", "begin", "condition", "cost", "delicacy", "distinct", "label", "measured", "model_name", "settings", "show",
    "stands_for", "states_table", "units", "wide",
]  # fmt: skip

#: Models of more states than this are described by their sizes, not by their matrices.
LARGE = 12
#: Covariances of a larger condition number are filtered differently by different forms.
SINGULAR = 1e7
#: Figures of single states are drawn for so many of them.
SHOWN = 6


@dataclass(frozen=True, slots=True)
class Settings:
    """The constants of a model and the settings of a study, as a report lists them: name, value, unit, meaning."""

    rows: tuple[tuple[str, Any, str, str], ...]

    def plain(self) -> dict[str, Any]:
        """The values by name, as JSON holds them."""
        return {name: plain(value) for name, value, _unit, _meaning in self.rows}

    def described(self) -> list[tuple[str, str, str]]:
        """Name, unit and meaning of each."""
        return [(name, unit, meaning) for name, _value, unit, meaning in self.rows]


def form(model: ModelFile, asked: str | None) -> str:
    """The form asked for, or the first of the model file; instead of Joseph's, which files have unless they say otherwise, ``"auto"``.

    That is Joseph's too, but where it would lose digits.
    """
    own = asked or model.experiment.algorithms[0]
    return "auto" if own == "joseph" and asked is None else own


def settings(model: ModelFile, *own: tuple[str, Any, str, str]) -> Settings:
    """The model's constants, then a study's ``own`` settings (a name that a constant has gets an underscore)."""
    constants = [
        (found.name, found.value, found.unit, found.meaning or _("a constant of the model"))
        for found in model.definitions
    ]
    taken = set(model.constants)
    return Settings((*constants, *((f"{name}_" if name in taken else name, *rest) for name, *rest in own)))


def begin(
    kind: str,
    title: str,
    model: ModelFile,
    parts: str,
    given: Settings,
    *,
    data: str = "",
    runs: int = 0,
    seed: int = 0,
) -> Report:
    """An empty report of a study with lettered ``parts``."""
    source = f"ctlabs {kind} {Path(model.name).name}" + (f" {data}" if data else "")
    meta = {"name": kind, "title": f"{model_name(model)}: {title}", "source": source, "parts": list(parts)}
    return Report(meta, given, runs, seed)


def model_name(model: ModelFile) -> str:
    """The model's title on one line."""
    return " ".join(model.title.split())


def show(report: Report, model: ContinuousModel | DiscreteModel) -> None:
    """The matrices of a model that is not too large for a page."""
    if model.n <= LARGE and model.m <= LARGE:
        report.model(model)
    else:
        report.says(_("The model has {n} states and {m} measurements."), n=model.n, m=model.m)


def notes(report: Report, told: Sequence[str]) -> None:
    """What was done with a record beyond reading it."""
    for note in dict.fromkeys(told):
        report.says("**{note}.**", note=note)
    if told:
        report.value("notes", "; ".join(dict.fromkeys(told)))


def label(name: str, unit: str = "") -> str:
    """A name and its unit for an axis; a dollar sign in it begins no formula."""
    shown = f"{name}, {unit}" if unit and unit != "1" else name
    return shown.replace("$", r"\$")


def units(model: ContinuousModel | DiscreteModel) -> str:
    """The unit of a value that holds a number per state."""
    return ", ".join(unit or "—" for unit in model.units) if any(unit not in ("", "1") for unit in model.units) else "1"


def measured(model: DiscreteModel, state: int) -> int | None:
    """The measurement that reads this state alone, if there is one."""
    H = model.H if model.H.ndim == 2 else model.H[0]
    for j, row in enumerate(H):
        if row[state] == 1 and np.count_nonzero(row) == 1:
            return j
    return None


def cost(report: Report, design: DiscreteModel, t: Array, claimed: Array, true: Array, optimal: Array) -> None:
    """What a filter of a wrong model believes of its errors, what they are, and what the right filter would reach.

    Each (steps+1, d): standard deviations, the true ones with the bias in them.
    """
    report.says(
        _(
            "What the filter believes of its errors (claimed), what they are by the theory of a wrong filter (true; bias included), and what the right filter would reach (optimal):"
        )
    )
    for i, (name, unit) in enumerate(list(zip(design.states, design.units, strict=True))[:SHOWN]):
        curves = {_("true"): true[:, i], _("claimed"): claimed[:, i], _("optimal"): optimal[:, i]}
        ylabel = label(fill(_("RMS error of {name}"), name=name), unit)
        report.figure(
            f"cost_{i + 1}",
            plots.transient(t, curves, ylabel=ylabel, log=wide(*curves.values())),
            _("RMS error of {name} after each update: claimed, true, and optimal."),
            name=name,
        )
    for name, values in (("rms_theory", true), ("rms_claimed", claimed), ("rms_optimal", optimal)):
        report.value(name, values[-1], units(design))
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = np.where(optimal[-1] > 0, true[-1] / optimal[-1], np.where(true[-1] > 0, np.inf, 1.0))
    report.value("cost", factor)
    worst = int(np.argmax(factor))
    report.says(
        _("The wrong model costs at most a factor {cost} in RMS error (state {name}) at the end."),
        cost=float(factor[worst]),
        name=design.states[worst],
    )


def distinct(table: str, columns: Sequence[str]) -> None:
    """Refuse two columns of one name: states and measurements whose names collide with a table's own.

    >>> distinct("estimates.csv", ["k", "t", "x", "x_sd", "x_sd", "x_sd_sd"])
    Traceback (most recent call last):
    ...
    ValueError: estimates.csv: expected columns of different names, received "x_sd" twice: rename a state or a measurement
    """
    for i, name in enumerate(columns):
        if name in columns[:i]:
            msg = f'{table}: expected columns of different names, received "{name}" twice: rename a state or a measurement'
            raise ValueError(msg)


def condition(P: Array) -> float:
    """The condition number of a covariance, of its correlations: 1 where nothing is uncertain, infinite where it is singular."""
    sd = np.sqrt(np.diag(P).clip(0))
    kept = sd > 0
    if not kept.any():
        return 1.0
    values = np.linalg.eigvalsh(P[np.ix_(kept, kept)] / np.outer(sd[kept], sd[kept]))
    return float(values[-1] / values[0]) if values[0] > 0 else np.inf


def delicacy(P_minus: Array, P_plus: Array, S: Array, most: int) -> float:
    """How much rounding is magnified: the largest condition number of P⁺ and S, of at most ``most`` rows of each.

    They are rows at equal distances, and those whose update lessens a variance most. Or, where it is larger, that
    factor in units of 1/ε: Joseph's form squares I − KH, whose rounding ε then stands beside what is left. Rows at which something
    is unknown do not count.
    """
    known = np.isfinite(P_minus).all(axis=(1, 2))
    if not known.any():
        return 1.0
    P_minus, P_plus, S = P_minus[known], P_plus[known], S[known]
    before, after = (np.diagonal(P, axis1=1, axis2=2) for P in (P_minus, P_plus))
    lessened = (before / np.where(after > 0, after, np.inf)).max(axis=1)
    rows = {*range(0, len(P_plus), -(-2 * len(P_plus) // most)), *np.argsort(lessened)[-most // 2 :].tolist()}
    worst = max(condition(P_plus[k]) for k in rows)
    for k in rows:
        used = np.isfinite(np.diag(S[k]))
        worst = max(worst, condition(S[k][np.ix_(used, used)]))
    return max(worst, float(np.finfo(float).eps * lessened.max()))


def other_form(algorithm: str) -> tuple[str, str]:
    """Another form of the filter than ``algorithm``, to check it by: its name in words, and that for ``algorithm=``.

    Factors keep more digits than what they check, and cost no import of another program.
    """
    return (_("filterpy"), "filterpy") if algorithm == "ud" else (_("UD factors"), "ud")


def wide(*curves: Array) -> str:
    """The axis to draw logarithmically: "y" where positive curves span more than two orders of magnitude."""
    values = np.concatenate(curves)
    return "y" if 0 < 100 * np.nanmin(values) < np.nanmax(values) else ""


def states_table(
    report: Report, name: str, model: DiscreteModel, columns: Mapping[str, Iterable[float | None]], caption: str
) -> None:
    """A table with a row per state and a column per quantity."""
    rows = zip(model.states, model.units, *columns.values(), strict=True)
    report.table(name, [_("state"), _("unit"), *columns], rows, caption)
