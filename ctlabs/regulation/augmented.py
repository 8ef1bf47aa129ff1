r"""A plant with what its controller carries beside the estimate: integrals of outputs, :math:`q_{k+1} = q_k + h z_k` or :math:`\dot q = z`.

The controller integrates what is measured, noise included, so it knows q exactly, and with it the noise of the measurement is a
disturbance that the measurement itself tells: N ≠ 0. Nothing else of the theory changes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import scipy.linalg

from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import symmetric
from ctlabs.models.linear import ContinuousModel, DiscreteModel


def names(measurements: tuple[str, ...], chosen: list[int]) -> tuple[str, ...]:
    """Of the integrals."""
    return tuple(f"integral of {measurements[i]}" for i in chosen)


def with_integrals(model: DiscreteModel, chosen: list[int]) -> DiscreteModel:
    """The discrete plant with the integrals of some measurements as its last states.

    >>> one = DiscreteModel([[0.5]], [[1]], [[1]], [[2]], P0=[[1]], B=[[1]], dt=0.1)
    >>> both = with_integrals(one, [0])
    >>> both.Phi, both.Qd, both.N
    (array([[0.5, 0. ],
           [0.1, 1. ]]), array([[1.  , 0.  ],
           [0.  , 0.02]]), array([[0. ],
           [0.2]]))
    """
    if not chosen:
        return model
    if model.horizon is not None:
        msg = f"integral: expected a constant model, received one that varies over {model.horizon} steps"
        raise ValueError(msg)
    n, q, h = model.n, len(chosen), model.dt
    D = np.zeros((model.m, model.r)) if model.D is None else model.D
    N = np.zeros((n, model.m)) if model.N is None else model.N
    c = np.zeros(n) if model.offset is None else model.offset
    d = np.zeros(model.m) if model.measurement_offset is None else model.measurement_offset
    rows = h * model.R[chosen]
    assert model.B is not None
    wide: dict[str, Any] = {
        "Phi": np.block([[model.Phi, np.zeros((n, q))], [h * model.H[chosen], np.eye(q)]]),
        "B": np.vstack([model.B, h * D[chosen]]),
        "Qd": symmetric(np.block([[model.Qd, h * N[:, chosen]], [h * N[:, chosen].T, h * rows[:, chosen]]])),
        "N": np.vstack([N, rows]),
        "H": np.hstack([model.H, np.zeros((model.m, q))]),
        "offset": np.concatenate([c, h * d[chosen]]) if c.any() or d[chosen].any() else None,
        "x0": np.concatenate([model.x0, np.zeros(q)]),
        "P0": scipy.linalg.block_diag(model.P0, np.zeros((q, q))),
        "states": model.states + names(model.measurements, chosen),
        "units": model.units + ("",) * q,
    }
    return replace(model, **wide)


def integrating(model: ContinuousModel, chosen: list[int]) -> ContinuousModel:
    """The continuous plant with the integrals of some measurements as its last states."""
    if not chosen:
        return model
    n, q, s = model.n, len(chosen), model.s
    assert model.Rc is not None
    assert model.B is not None
    D = np.zeros((model.m, model.r)) if model.D is None else model.D
    N = np.zeros((s, model.m)) if model.N is None else model.N
    rows = model.Rc[chosen]
    wide: dict[str, Any] = {
        "F": np.block([[model.F, np.zeros((n, q))], [model.H[chosen], np.zeros((q, q))]]),
        "B": np.vstack([model.B, D[chosen]]),
        "G": scipy.linalg.block_diag(model.G, np.eye(q)),
        "Q": symmetric(np.block([[model.Q, N[:, chosen]], [N[:, chosen].T, rows[:, chosen]]])),
        "N": np.vstack([N, rows]),
        "H": np.hstack([model.H, np.zeros((model.m, q))]),
        "x0": np.concatenate([model.x0, np.zeros(q)]),
        "P0": scipy.linalg.block_diag(model.P0, np.zeros((q, q))),
        "states": model.states + names(model.measurements, chosen),
        "units": model.units + ("",) * q,
    }
    return replace(model, **wide)


def weighed(M: Array, size: int, own: Array | None = None) -> Array:
    """A weight or a covariance with those of further states behind it, zero unless given."""
    more = np.zeros((size, size)) if own is None else np.diag(own)
    if M.ndim == 3:
        return np.array([scipy.linalg.block_diag(each, more) for each in M])
    return np.asarray(scipy.linalg.block_diag(M, more))
