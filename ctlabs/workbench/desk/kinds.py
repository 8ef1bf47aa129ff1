r"""A model in the other time: a continuous one as its samples, a discrete one as what it may be the samples of.

A table [cost] goes with it: the cost of a period under a held input is that of the step, and back, as the noise of a period is,

.. math:: \int_0^h e^{\bar A^Ts}\bar Q e^{\bar As}\,ds = \begin{bmatrix}Q_x^d & N^d\\ N^{dT} & Q_u^d\end{bmatrix}, \qquad
          e^{\bar Ah} = \begin{bmatrix}\Phi & B_d\\ 0 & I\end{bmatrix}
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg

from ctlabs.files.modelfile import ModelFile, from_model
from ctlabs.files.modelfile.errors import shown
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.linalg.units import balanced
from ctlabs.models import ContinuousModel, Cost, DiscreteModel, discretise
from ctlabs.models.discretisation import interval
from ctlabs.regulation import sample
from ctlabs.regulation.sampling import between


def converted(file: ModelFile, kind: str) -> ModelFile:
    """The model of another kind, its matrices as numbers; ``ValueError`` where there is none."""
    if kind not in {"continuous", "discrete"}:
        msg = f"kind: expected continuous or discrete, received {shown(kind)}"
        raise ValueError(msg)
    if file.kind == kind:
        return file
    if file.varying:
        msg = f"kind: expected matrices that do not vary with time, received {', '.join(file.varying)}"
        raise ValueError(msg)
    made = _sampled(file) if kind == "discrete" else _resolved(file)
    return _labelled(made, file)


def _sampled(file: ModelFile) -> ModelFile:
    """The samples of a continuous model."""
    if not file.driven:
        return from_model(file.discrete(), file.title or "Model")
    model, cost = file.plant(), file.cost
    assert isinstance(model, ContinuousModel)
    R = None if model.Rc is not None else file.matrix("R")
    if cost is None:
        return from_model(discretise(model, file.dt, R=R), file.title or "Model")
    plant, stepwise = sample(model, cost, file.dt, R=R, delay=file.regulator.delay)
    return _weighed(from_model(plant, file.title or "Model"), file, stepwise, file.dt)


def _resolved(file: ModelFile) -> ModelFile:
    """The continuous model with these samples."""
    model = file.plant() if file.driven else file.discrete()
    assert isinstance(model, DiscreteModel)
    if model.N is not None or model.offset is not None:
        msg = "kind: expected a model without N, offset and u, received one with them"
        raise ValueError(msg)
    n, r = model.n, 0 if model.B is None else model.r
    A, W = before_sampling(_with_inputs(model), scipy.linalg.block_diag(model.Qd, np.zeros((r, r))), model.dt)
    plant = ContinuousModel(
        A[:n, :n], np.eye(n), W[:n, :n], model.H, B=A[:n, n:] if r else None, D=model.D, measurement_offset=model.measurement_offset,
        P0=model.P0, x0=model.x0, states=model.states, measurements=model.measurements, units=model.units,
    )  # fmt: skip
    made, cost = from_model(plant, file.title or "Model", dt=model.dt, R=model.R), file.cost
    return made if cost is None else _weighed(made, file, _per_second(model, plant, cost), 1 / model.dt)


def _with_inputs(model: DiscreteModel) -> Array:
    """Φ of the states and the inputs, which are held."""
    if model.B is None:
        return model.Phi
    return np.block([[model.Phi, model.B], [np.zeros((model.r, model.n)), np.eye(model.r)]])


def _per_second(model: DiscreteModel, plant: ContinuousModel, cost: Cost) -> Cost:
    """The cost per second of which this is the cost per step."""
    if cost.discount != 1:
        msg = f"cost.discount: expected 1 in a cost that goes to the other time, received {cost.discount:g}"
        raise ValueError(msg)
    own, n, h = cost.weights(model), model.n, model.dt
    try:
        Q = before_sampling(_with_inputs(model).T, own.joint, h)[1]
    except ValueError:
        msg = "cost: expected the weights of a step to be what some weights per second come to in a period, received weights that none do"
        raise ValueError(msg) from None
    noise = between(plant, Q[:n, :n], h)
    rest = cost.constant - noise
    if rest < -1e-9 * noise:
        msg = (
            f"cost.constant: expected at least {noise:.6g}, what noise between the samples costs in each step and a cost per second "
            f"cannot leave out, received {cost.constant:g}"
        )
        raise ValueError(msg)
    horizon = None if cost.horizon is None else cost.horizon * h
    Qf = None if horizon is None else own.Qf
    return Cost(Q[:n, :n], Q[n:, n:], Q[:n, n:], Qf, horizon, constant=rest / h if rest > 1e-9 * noise else 0.0)


def _weighed(made: ModelFile, old: ModelFile, cost: Cost, per: float) -> ModelFile:
    """A model with a cost in numbers and the regulator's settings; ``per``, the new unit of time in the old one's."""
    told = old.regulator
    table: dict[str, Any] = {name: M.tolist() for name in ("Qx", "Qu", "N", "Qf") if (M := getattr(cost, name)) is not None and M.any()}
    table |= {"horizon": cost.horizon} if cost.horizon is not None else {}
    table |= {"constant": cost.constant} if cost.constant else {}
    table |= {"integral": {name: weight * per for name, weight in told.integral.items()}} if told.integral else {}
    kept = {"kind": told.kind, "loads": list(told.loads), "track": list(told.track), "stabilise": told.stabilise}
    table |= {key: kept[key] for key in old.data()["cost"] if key in kept}
    return made.edit_all([(("cost", key), value) for key, value in table.items()])


def before_sampling(Phi: Array, Qd: Array, dt: float) -> tuple[Array, Array]:
    r"""F and Q with :math:`e^{Fdt} = \Phi` and :math:`\int_0^{dt}e^{Fs}Qe^{F^Ts}ds = Q_d`, in whatever units the states are."""
    x = balanced(Phi, Qd, continuous=False).states
    F, W = _before(Phi * x / x[:, None], Qd / np.outer(x, x), dt)
    return F * x[:, None] / x, W * np.outer(x, x)


def _before(Phi: Array, Qd: Array, dt: float) -> tuple[Array, Array]:
    """The same in units in which the elements of Φ and Q_d are near 1."""
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
    own = ("states", "units") if made.n == old.n else ()  # inputs on their way have become states, with names of their own
    return made.edit_all(
        [
            *(((key,), found[key]) for key in ("description", "source") if key in found),
            *((("model", key), model[key]) for key in (*own, "measurements", "measurement_units") if key in model),
            *((("experiment", key), value) for key, value in settings.items()),
            *((("data", key), value) for key, value in found.get("data", {}).items()),
        ]
    )
