"""Regulators: optimal feedback of a known state, of an estimated one, and what a closed loop does and costs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ctlabs._front import front

if TYPE_CHECKING:
    from ctlabs.regulation.budget import CostBudget, cost_budget
    from ctlabs.regulation.closed import ClosedLoop
    from ctlabs.regulation.continuous import ContinuousRegulator
    from ctlabs.regulation.controller import Controller
    from ctlabs.regulation.curves import Periods, Tradeoff, periods, tradeoff
    from ctlabs.regulation.design import Regulator
    from ctlabs.regulation.feedback import Feedback, lqr
    from ctlabs.regulation.runs import LoopEnsemble, ensemble
    from ctlabs.regulation.sampling import SampledProblem, sample
    from ctlabs.regulation.stability import Margin, Margins, margins
    from ctlabs.regulation.synthesis import regulator

_HOME = {
    "ClosedLoop": "closed",
    "ContinuousRegulator": "continuous",
    "Controller": "controller",
    "CostBudget": "budget",
    "Feedback": "feedback",
    "LoopEnsemble": "runs",
    "Margin": "stability",
    "Margins": "stability",
    "Periods": "curves",
    "Regulator": "design",
    "SampledProblem": "sampling",
    "Tradeoff": "curves",
    "cost_budget": "budget",
    "ensemble": "runs",
    "lqr": "feedback",
    "margins": "stability",
    "periods": "curves",
    "regulator": "synthesis",
    "sample": "sampling",
    "tradeoff": "curves",
}

__all__ = [
    "ClosedLoop",
    "ContinuousRegulator",
    "Controller",
    "CostBudget",
    "Feedback",
    "LoopEnsemble",
    "Margin",
    "Margins",
    "Periods",
    "Regulator",
    "SampledProblem",
    "Tradeoff",
    "cost_budget",
    "ensemble",
    "lqr",
    "margins",
    "periods",
    "regulator",
    "sample",
    "tradeoff",
]

__getattr__ = front(__name__, _HOME)
