"""A model in the other time: a continuous one as its samples, a discrete one as what it may be the samples of."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg

from ctlabs.files.modelfile import ModelFile, from_model
from ctlabs.files.modelfile.errors import shown
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models import ContinuousModel
from ctlabs.models.discretisation import interval


def converted(file: ModelFile, kind: str) -> ModelFile:
    """The model of another kind, its matrices as numbers; ``ValueError`` where there is none."""
    if kind not in {"continuous", "discrete"}:
        msg = f"kind: expected continuous or discrete, received {shown(kind)}"
        raise ValueError(msg)
    if file.kind == kind:
        return file
    if "cost" in file.data():
        msg = "kind: expected a model without [cost], received one with it (a second's weights are not a step's)"
        raise ValueError(msg)
    if file.varying:
        msg = f"kind: expected matrices that do not vary with time, received {', '.join(file.varying)}"
        raise ValueError(msg)
    made = _sampled(file) if kind == "discrete" else _resolved(file)
    return _labelled(made, file)


def _sampled(file: ModelFile) -> ModelFile:
    return from_model(file.discrete(), file.title or "Model")


def _resolved(file: ModelFile) -> ModelFile:
    """The continuous model with these samples."""
    model = file.discrete()
    if model.N is not None or model.offset is not None:
        msg = "kind: expected a model without N, offset and u, received one with them"
        raise ValueError(msg)
    F, W = before_sampling(model.Phi, model.Qd, model.dt)
    plant = ContinuousModel(F, np.eye(model.n), W, model.H, P0=model.P0, x0=model.x0, states=model.states,
                            measurements=model.measurements, units=model.units)  # fmt: skip
    return from_model(plant, file.title or "Model", dt=model.dt, R=model.R)


def before_sampling(Phi: Array, Qd: Array, dt: float) -> tuple[Array, Array]:
    r"""F and Q with :math:`e^{Fdt} = \Phi` and :math:`\int_0^{dt}e^{Fs}Qe^{F^Ts}ds = Q_d`."""
    if not np.linalg.cond(Phi) < 1e12:
        msg = "Phi: expected the samples of a continuous model (no eigenvalue 0), received a singular matrix"
        raise ValueError(msg)
    with np.errstate(all="ignore"):
        F = np.atleast_2d(scipy.linalg.logm(Phi)) / dt
    if np.abs(np.imag(F)).max() > 1e-9 * np.abs(F).max(initial=1e-300):
        msg = "Phi: expected the samples of a continuous model (no negative real eigenvalue), received others"
        raise ValueError(msg)
    F = np.where(np.abs(np.real(F)) > 1e-13 * np.abs(F).max(initial=1e-300), np.real(F), 0.0)
    # The exponential of [[F, Q], [0, -Fᵀ]]dt is [[Φ, Qd Φ⁻ᵀ], [0, Φ⁻ᵀ]] (Van Loan); its logarithm leads back.
    back = np.linalg.inv(Phi).T
    with np.errstate(all="ignore"):
        both = scipy.linalg.logm(np.block([[Phi, Qd @ back], [np.zeros_like(Phi), back]])) / dt
    W = np.real(both[: len(Phi), len(Phi) :])
    W = (W + W.T) / 2
    W = np.where(np.abs(W) > 1e-13 * np.abs(W).max(initial=0.0), W, 0.0)
    try:
        checks.covariance("Q", W, Phi.shape)
    except ValueError:
        msg = "Qd: expected the samples of a continuous model's noise, received a covariance that no white noise gives"
        raise ValueError(msg) from None
    again = interval(F, W, dt)
    for name, found, wanted in (("Phi", again.Phi, Phi), ("Qd", again.Qd, Qd)):
        if np.abs(found - wanted).max() > 1e-9 * max(np.abs(wanted).max(), 1e-300):
            msg = f"{name}: expected the samples of a continuous model, received others"
            raise ValueError(msg)
    return F, W


def _labelled(made: ModelFile, old: ModelFile) -> ModelFile:
    """The words and settings of the old file in the new one."""
    found, model = old.data(), old.data()["model"]
    settings: dict[str, Any] = {**found.get("experiment", {}), "t0": old.experiment.t0}
    return made.edit_all(
        [
            *(((key,), found[key]) for key in ("description", "source") if key in found),
            *((("model", key), model[key]) for key in ("states", "units", "measurements", "measurement_units") if key in model),
            *((("experiment", key), value) for key, value in settings.items()),
        ]
    )
