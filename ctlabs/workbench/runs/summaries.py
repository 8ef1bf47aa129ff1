"""What is kept of a record that was filtered and of a fit: numbers to compare, and what shows the result again.

A filtered record is kept by its model, its data and what was wanted, from which its estimates come again in a moment; a fit, which
takes longer, with all its numbers.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ctlabs.workbench.runs.fits import FitResult
    from ctlabs.workbench.runs.records import Judgement, RecordEstimates

#: What is not kept of a fit: figures, which the record gives again.
DRAWN = {"profiles": (), "before": None, "after": None}
#: What else than an experiment is kept, in a word.
KINDS = {"filter": "filtered", "fit": "fitted"}


@dataclass(frozen=True, slots=True)
class Summary:
    """A kept result: its ``kind``, one of :data:`KINDS`, ``summary``, numbers by name with their units, and the ``fit`` if it is one."""

    kind: str
    summary: dict[str, tuple[Any, str]]
    fit: FitResult | None = None

    def plain(self) -> dict[str, Any]:
        """As texts, numbers, lists and dicts."""
        fit = None
        if self.fit is not None:
            fit = {each.name: getattr(self.fit, each.name) for each in dataclasses.fields(self.fit) if each.name not in DRAWN}
        return {"kind": self.kind, "summary": self.summary, "fit": fit}

    @classmethod
    def of(cls, plain: Mapping[str, Any]) -> Summary:
        """The summary of :meth:`plain`'s answer."""
        fit = plain["fit"]
        if fit is not None:
            from ctlabs.workbench.runs.fits import FitResult  # which takes a while to load

            tuples = {key: tuple(fit[key]) for key in ("names", "units", "start", "values", "errors")}
            intervals = tuple(None if each is None else (each[0], each[1]) for each in fit["intervals"])
            fit = FitResult(**{**fit, **tuples, **DRAWN, "intervals": intervals})
        return cls(str(plain["kind"]), {name: (value, str(unit)) for name, (value, unit) in plain["summary"].items()}, fit)


def of_record(found: RecordEstimates, told: Judgement) -> Summary:
    """A filtered record: how likely it is, what speaks against the model, and the estimates in the end."""
    summary: dict[str, tuple[Any, str]] = {
        "rows": (found.rows, ""),
        "missing": (found.missing, ""),
        "log_likelihood": (found.log_likelihood, ""),
        "left_out": (found.beyond, ""),
        "verdict": (told.suggestion, ""),
    }
    for name, *values in told.tests[1:]:
        if values and isinstance(values[0], float):
            summary[str(name)] = values[0], ""
    for i, (state, unit) in enumerate(zip(found.states, found.units, strict=True)):
        summary[f"{state} at the end"] = float(found.x[-1, i]), unit
        summary[f"sd of {state} at the end"] = float(found.sd[-1, i]), unit
    return Summary("filter", summary)


def of_fit(found: FitResult) -> Summary:
    """A fit: the constants with their standard errors, and the likelihood."""
    summary: dict[str, tuple[Any, str]] = {}
    for name, unit, value, error in zip(found.names, found.units, found.values, found.errors, strict=True):
        summary[name] = value, unit
        summary[f"standard error of {name}"] = None if math.isnan(error) else error, unit
    summary["log_likelihood"] = found.log_likelihood, ""
    summary["aic"] = found.aic, ""
    summary["converged"] = "yes" if found.converged else "no", ""
    return Summary("fit", summary, found)
