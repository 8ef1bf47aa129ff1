"""The frame of a lab's report: analysis, plan, experiment, conclusions, and which functions write each of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from inspect import signature
from typing import TYPE_CHECKING, Any

from ctlabs.reporting.report import Report

if TYPE_CHECKING:
    from ctlabs.labs.experiment import Experiment
    from ctlabs.reporting.report import Parameters

#: A function that writes a section into the report, and says by name what later parts need to know.
Part = Callable[..., Mapping[str, Any] | None]


@dataclass(frozen=True, slots=True)
class Skeleton:
    """The parts of a lab in the order of its report.

    A part is given what its arguments name: ``r``, the report; ``p``, the parameters; ``experiment``; what the lab has
    built beforehand; and what the parts before it have returned (``{"steps": 40}``, or nothing).
    """

    analysis: tuple[Part, ...]
    plan: Part
    experiment: tuple[Part, ...]
    conclusions: Part

    def report(self, meta: Mapping[str, Any], p: Parameters, experiment: Experiment, **given: Any) -> Report:
        """The report of a lab, its parts run in order.

        Raises
        ------
        TypeError
            A part asks for what is neither given nor returned by a part before it.
        """
        r = Report(meta, p, experiment.runs, experiment.seed)
        known = {"r": r, "p": p, "experiment": experiment, **given}
        for heading, parts in (
            ("Part I. Analysis", self.analysis),
            ("Plan of the experiment", (self.plan,)),
            ("Part II. Experiment", self.experiment),
            ("Conclusions", (self.conclusions,)),
        ):
            r.heading(heading)
            for part in parts:
                known |= _written(part, known) or {}
        return r


def _written(part: Part, known: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """Run a part on what it names."""
    names = list(signature(part).parameters)
    missing = [name for name in names if name not in known]
    if missing:
        msg = f"{part.__name__}: expected arguments among {sorted(known)}, received {missing}"
        raise TypeError(msg)
    return part(**{name: known[name] for name in names})
