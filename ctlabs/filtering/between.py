r"""The error covariance of a sampled filter between its measurements.

After the measurement at t_k nothing comes in until t_{k+1}, and the covariance follows the system alone:

.. math:: P(t_k+s) = \Phi(s)P_k^+\Phi(s)^T + Q_d(s), \qquad 0 \le s \le dt
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ctlabs.filtering.results import Covariances
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models import ContinuousModel
from ctlabs.models.discretisation import interval

#: The schedule belongs to the model when its predictions are the model's to this accuracy.
SAME = 1e-8


@dataclass(frozen=True, slots=True, eq=False)
class Between:
    """A covariance in continuous time; every sampling instant stands twice, before and after its update.

    ``t`` (points,) s, not decreasing · ``P`` (points, n, n)
    """

    t: Array
    P: Array

    @property
    def sd(self) -> Array:
        """Standard deviation of the error, (points, n)."""
        return np.sqrt(np.diagonal(self.P, axis1=1, axis2=2))


def between(model: ContinuousModel, filtered: Covariances, points: int = 50) -> Between:
    """P(t) of a filter that is given by its covariances, from t0 to its last measurement.

    Parameters
    ----------
    model : the continuous model whose sampled form the covariances belong to
    filtered : covariances at the sampling instants (:func:`ctlabs.covariances`)
    points : how many parts an interval is divided into

    Raises
    ------
    TypeError
        A discrete model.
    ValueError
        Covariances of another model: its prediction is not what the model makes of P⁺ one period before (nor that of a
        model whose w and v correlate: there a measurement tells of the interval after it).

    Source: Maybeck vol. 1, eq. 5-45 to 5-47 (propagation between samples).

    >>> from ctlabs import covariances, discretise
    >>> walk = ContinuousModel([[0]], [[1]], [[1]], [[1]], P0=[[0]])
    >>> P = between(walk, covariances(discretise(walk, 1.0, R=[[1.0]]), 2), points=2)
    >>> P.t, P.P[:, 0, 0]
    (array([0. , 0.5, 1. , 1. , 1.5, 2. , 2. ]), array([0. , 0.5, 1. , 0.5, 1. , 1.5, 0.6]))
    """
    checks.instance("model", model, ContinuousModel)
    points = checks.count("points", points)
    n, dt = filtered.P_plus.shape[-1], float(filtered.t[1] - filtered.t[0])
    if n != model.n:
        msg = f"filtered: expected covariances of {model.n} states, received {n}"
        raise ValueError(msg)
    W = model.G @ model.Q @ model.G.T
    parts = [interval(model.F, W, float(s)) for s in np.linspace(0.0, dt, points + 1)[1:]]
    Phi = np.array([np.eye(n), *(part.Phi for part in parts)])
    Qd = np.array([np.zeros((n, n)), *(part.Qd for part in parts)])
    P = Phi @ filtered.P_plus[:-1, None] @ np.swapaxes(Phi, 1, 2) + Qd
    P = 0.5 * (P + np.swapaxes(P, -1, -2))
    wrong = np.abs(P[:, -1] - filtered.P_minus[1:]).max(axis=(1, 2)) > SAME * np.abs(P[:, -1]).max(axis=(1, 2))
    if wrong.any():
        k = int(np.argmax(wrong)) + 1
        msg = (
            f"filtered: expected predictions of this model, received P_minus[{k}] = {filtered.P_minus[k].tolist()} "
            f"where the model gives {P[k - 1, -1].tolist()}"
        )
        raise ValueError(msg)
    t = filtered.t[:-1, None] + np.linspace(0.0, dt, points + 1)
    t[:, -1] = filtered.t[1:]
    last = filtered.P_plus[-1:]
    return Between(np.append(t.ravel(), filtered.t[-1]), np.concatenate([P.reshape(-1, n, n), last]))
