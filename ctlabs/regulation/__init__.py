"""Regulators: optimal feedback of a known state, of an estimated one, and what a closed loop does and costs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ctlabs._front import front

if TYPE_CHECKING:
    from ctlabs.regulation.closed import ClosedLoop
    from ctlabs.regulation.controller import Controller
    from ctlabs.regulation.feedback import Feedback, lqr
    from ctlabs.regulation.sampling import Sampled, sample
    from ctlabs.regulation.synthesis import regulator

_HOME = {
    "ClosedLoop": "closed",
    "Controller": "controller",
    "Feedback": "feedback",
    "Sampled": "sampling",
    "lqr": "feedback",
    "regulator": "synthesis",
    "sample": "sampling",
}

__all__ = ["ClosedLoop", "Controller", "Feedback", "Sampled", "lqr", "regulator", "sample"]

__getattr__ = front(__name__, _HOME)
