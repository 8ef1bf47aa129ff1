"""What a system is: continuous, discrete and nonlinear models, and how they come from physics, transfer functions and spectra."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ctlabs._front import front

if TYPE_CHECKING:
    from ctlabs.models.anomalies import Anomaly, anomalous
    from ctlabs.models.cost import Cost
    from ctlabs.models.discretisation import discretise, to_continuous
    from ctlabs.models.interop import from_control, to_control, to_dataframe, to_filterpy
    from ctlabs.models.linear import ContinuousModel, DiscreteModel, at
    from ctlabs.models.nonlinear import NonlinearModel
    from ctlabs.models.shaping import augment, augment_measurement

_HOME = {
    "Anomaly": "anomalies",
    "ContinuousModel": "linear",
    "Cost": "cost",
    "DiscreteModel": "linear",
    "NonlinearModel": "nonlinear",
    "anomalous": "anomalies",
    "at": "linear",
    "augment": "shaping",
    "augment_measurement": "shaping",
    "discretise": "discretisation",
    "from_control": "interop",
    "to_continuous": "discretisation",
    "to_control": "interop",
    "to_dataframe": "interop",
    "to_filterpy": "interop",
}

__all__ = [
    "Anomaly",
    "ContinuousModel",
    "Cost",
    "DiscreteModel",
    "NonlinearModel",
    "anomalous",
    "at",
    "augment",
    "augment_measurement",
    "discretise",
    "from_control",
    "to_continuous",
    "to_control",
    "to_dataframe",
    "to_filterpy",
]

__getattr__ = front(__name__, _HOME)
