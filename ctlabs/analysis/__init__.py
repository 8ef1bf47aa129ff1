"""What can be said of a model without data, and of a model and a record."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ctlabs._front import front

if TYPE_CHECKING:
    from ctlabs.analysis.diagnosis import diagnose
    from ctlabs.analysis.errors import actual_errors, error_budget
    from ctlabs.analysis.evidence import observability, reachability
    from ctlabs.analysis.fitting import fit
    from ctlabs.analysis.naming import stands_for

_HOME = {
    "actual_errors": "errors",
    "diagnose": "diagnosis",
    "error_budget": "errors",
    "fit": "fitting",
    "observability": "evidence",
    "reachability": "evidence",
    "stands_for": "naming",
}

__all__ = [
    "actual_errors",
    "diagnose",
    "error_budget",
    "fit",
    "observability",
    "reachability",
    "stands_for",
]

__getattr__ = front(__name__, _HOME)
