"""ctlabs: optimal (Kalman) filtering and control from a problem's statement to a verified report.

>>> from ctlabs import ContinuousModel, discretise, steady_state
>>> walk = ContinuousModel(F=[[0]], G=[[1]], Q=[[4]], H=[[1]], Rc=[[16]], P0=[[25]], states=["x"], units=["m"])
>>> limit = steady_state(discretise(walk, dt=0.5))
>>> limit.K.round(4), limit.P_plus.round(4)
(array([[0.2207]]), array([[7.0623]]))

One verb per question; the type of the model chooses the equation. What is named here is loaded when it is first used, so that
``import ctlabs`` takes no time. Everything else is in the subpackages: :mod:`ctlabs.models`, :mod:`ctlabs.filtering`,
:mod:`ctlabs.analysis`, :mod:`ctlabs.regulation`, :mod:`ctlabs.montecarlo`, :mod:`ctlabs.files`, :mod:`ctlabs.reporting`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ctlabs._front import front

if TYPE_CHECKING:  # what type checkers and editors see; __getattr__ gives the same when it is used
    from ctlabs.analysis import actual_errors, diagnose, error_budget, fit, observability
    from ctlabs.files import read_model, read_record
    from ctlabs.filtering import Filter, covariances, forecast, kalman_filter, smooth, steady_state
    from ctlabs.models import ContinuousModel, Cost, DiscreteModel, NonlinearModel, augment, discretise, from_control
    from ctlabs.montecarlo import monte_carlo, simulate
    from ctlabs.regulation import regulator

__version__ = "0.3.0"

#: Where each name of the front door is at home.
_HOME = {
    "ContinuousModel": "models",
    "Cost": "models",
    "DiscreteModel": "models",
    "Filter": "filtering",
    "NonlinearModel": "models",
    "actual_errors": "analysis",
    "augment": "models",
    "covariances": "filtering",
    "diagnose": "analysis",
    "discretise": "models",
    "error_budget": "analysis",
    "fit": "analysis",
    "forecast": "filtering",
    "from_control": "models",
    "kalman_filter": "filtering",
    "monte_carlo": "montecarlo",
    "observability": "analysis",
    "read_model": "files",
    "read_record": "files",
    "regulator": "regulation",
    "simulate": "montecarlo",
    "smooth": "filtering",
    "steady_state": "filtering",
}

__all__ = [
    "ContinuousModel",
    "Cost",
    "DiscreteModel",
    "Filter",
    "NonlinearModel",
    "actual_errors",
    "augment",
    "covariances",
    "diagnose",
    "discretise",
    "error_budget",
    "fit",
    "forecast",
    "from_control",
    "kalman_filter",
    "monte_carlo",
    "observability",
    "read_model",
    "read_record",
    "regulator",
    "simulate",
    "smooth",
    "steady_state",
]


__getattr__ = front(__name__, _HOME)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
