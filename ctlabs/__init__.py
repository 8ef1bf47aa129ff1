"""ctlabs: optimal (Kalman) filtering from a problem's statement to a verified report.

>>> from ctlabs import ContinuousModel, steady
>>> from ctlabs.discretise import discretise
>>> walk = ContinuousModel(F=[[0]], G=[[1]], Q=[[4]], H=[[1]], Rc=[[16]], P0=[[25]], states=["x"], units=["m"])
>>> limit = steady.solve(discretise(walk, dt=0.5))
>>> limit.K.round(4), limit.P_plus.round(4)
(array([[0.2207]]), array([[7.0623]]))

Everything named in ``__all__`` is loaded when it is first used, so that ``import ctlabs`` takes no time.
``ctlabs.discretise`` is the module; its main verb is imported from it, as above.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # what type checkers and editors see; __getattr__ gives the same when it is used
    from ctlabs import (
        bayes,
        between,
        bucy,
        datafile,
        diagnosis,
        discretise,
        experiment,
        export,
        fields,
        fitting,
        forms,
        interop,
        kalman,
        kinematics,
        labs,
        linearise,
        modelfile,
        models,
        montecarlo,
        observability,
        online,
        params,
        plots,
        portrait,
        records,
        reduced,
        render,
        report,
        scheduling,
        sensitivity,
        shaping,
        smoothing,
        spectra,
        steady,
        studies,
        symbolic,
        text,
        updates,
        varying,
    )
    from ctlabs.models import ContinuousModel, DiscreteModel
    from ctlabs.online import Filter
    from ctlabs.shaping import augment

__version__ = "0.2.0"

__all__ = [
    "ContinuousModel",
    "DiscreteModel",
    "Filter",
    "augment",
    "bayes",
    "between",
    "bucy",
    "datafile",
    "diagnosis",
    "discretise",
    "experiment",
    "export",
    "fields",
    "fitting",
    "forms",
    "interop",
    "kalman",
    "kinematics",
    "labs",
    "linearise",
    "modelfile",
    "models",
    "montecarlo",
    "observability",
    "online",
    "params",
    "plots",
    "portrait",
    "records",
    "reduced",
    "render",
    "report",
    "scheduling",
    "sensitivity",
    "shaping",
    "smoothing",
    "spectra",
    "steady",
    "studies",
    "symbolic",
    "text",
    "updates",
    "varying",
]

#: The module of every name that is not a module itself.
_HOME = {"ContinuousModel": "models", "DiscreteModel": "models", "Filter": "online", "augment": "shaping"}


def __getattr__(name: str) -> Any:
    if name not in __all__:
        msg = f"module 'ctlabs' has no attribute {name!r}"
        raise AttributeError(msg)
    if name in _HOME:
        return getattr(import_module(f"ctlabs.{_HOME[name]}"), name)
    return import_module(f"ctlabs.{name}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
