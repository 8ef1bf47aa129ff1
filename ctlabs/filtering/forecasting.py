"""What comes after a record."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.filtering.motion import motion
from ctlabs.filtering.problem import inputs_of
from ctlabs.filtering.results import Filtered
from ctlabs.filtering.smoothing import belongs, smooth
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import deviations, symmetric
from ctlabs.models.histories import histories, normals, shape, truth_arrays
from ctlabs.models.linear import DiscreteModel, at


@dataclass(frozen=True, slots=True, eq=False)
class Forecast:
    """States and measurements after a record, given all of it.

    ``t`` (steps,) s · ``x`` (steps, n[, runs]), ``P`` (steps, n, n), states and covariance of their errors · ``z`` (steps, m[, runs]),
    ``S`` (steps, m, m), measurements and covariance of their errors; ``inf`` on its diagonal where an element is not measured
    """

    t: Array
    x: Array
    P: Array
    z: Array
    S: Array

    @property
    def sd(self) -> Array:
        """Standard deviations of the states' errors, (steps, n)."""
        return deviations(self.P)


def forecast(model: DiscreteModel, filtered: Filtered, steps: int, u: ArrayLike | None = None) -> Forecast:
    r"""The next states and measurements after a filtered record.

    .. math:: \hat x_{k+1} = \Phi\hat x_k + Bu_k + c, \quad P_{k+1} = \Phi P_k\Phi^T + Q_d, \quad
              \hat z = H\hat x + Du + d, \quad S = HPH^T + R

    Parameters
    ----------
    model : discrete, given for the steps to come
    filtered : of :func:`ctlabs.kalman_filter`, with any algorithm
    steps : how many periods
    u : (steps+1, r), or (r,) if it is constant: the known input from the last instant of the record on, where the model has B or D

    >>> from ctlabs import kalman_filter
    >>> walk = DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[10]])
    >>> ahead = forecast(walk, kalman_filter(walk, [5, 5, 5]), 2)
    >>> ahead.z.ravel().round(4), ahead.sd.ravel().round(4)
    (array([4.9462, 4.9462]), array([1.2742, 1.6198]))
    """
    checks.instance("model", model, DiscreteModel)
    belongs(model, filtered)
    steps, last = checks.count("steps", steps), len(filtered.t) - 1
    if model.horizon is not None and last + steps > model.horizon:
        msg = f"steps: expected at most {model.horizon - last} more (the model is given for {model.horizon}), received {steps}"
        raise ValueError(msg)
    inputs = inputs_of(model, steps + 1, 0, u, None)[0]
    single = filtered.x_plus.ndim == 2
    x = filtered.x_plus[-1][:, None] if single else filtered.x_plus[-1]
    P, known = filtered.P_plus[-1], filtered.z[-1][:, None] if single else filtered.z[-1]
    if not np.isfinite(P).all():
        msg = "filtered: expected a record that determines every state, received one that leaves some unknown (inf in P_plus)"
        raise ValueError(msg)
    rows: dict[str, list[Array]] = {"x": [], "P": [], "z": [], "S": []}
    nothing = np.zeros(model.m, dtype=bool)
    for i in range(steps):
        k = last + i
        Phi, Q, M = motion(model, k, filtered.used[-1] if not i else nothing)
        x = Phi @ x + (0.0 if M is None else M @ known[filtered.used[-1]])
        if model.offset is not None:
            x = x + at(model.offset, k, 1)[:, None]
        if model.B is not None:
            x = x + (at(model.B, k, 2) @ inputs[i])[:, None]
        P = symmetric(Phi @ P @ Phi.T + Q)
        H, R = at(model.H, k + 1, 2), at(model.R, k + 1, 2)
        z = H @ x
        if model.D is not None:
            z = z + (at(model.D, k + 1, 2) @ inputs[i + 1])[:, None]
        if model.measurement_offset is not None:
            z = z + at(model.measurement_offset, k + 1, 1)[:, None]
        for name, value in (("x", x), ("P", P), ("z", z), ("S", symmetric(H @ P @ H.T) + R)):
            rows[name].append(value)
    t = filtered.t[-1] + model.dt * np.arange(1, steps + 1)
    arrays = {name: np.array(values) for name, values in rows.items()}
    if single:
        arrays |= {"x": arrays["x"][:, :, 0], "z": arrays["z"][:, :, 0]}
    return Forecast(t, **arrays)


def draws(model: Any, filtered: Filtered, number: int, seed: int) -> Array:
    """Histories of the state given the data, (steps+1, n, number): samples of the smoother's joint distribution.

    A simulated history and its own smoothed estimate differ by an error of the right distribution, which is added to the
    smoothed estimate of the data (Durbin & Koopman, Biometrika 89, 2002). That error does not depend on where a state begins of which
    nothing is known: such a one is simulated from x0. A state that the record leaves unknown is NaN.

    Parameters
    ----------
    model : the filter's
    filtered : one record · number : how many · seed : whole number

    >>> from ctlabs import kalman_filter
    >>> walk = DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[10]])
    >>> found = kalman_filter(walk, [5, 5, 5])
    >>> bool(abs(draws(walk, found, 4000, 1).mean(axis=2) - smooth(walk, found).x).max() < 0.05)
    True
    """
    own = filtered.model
    if filtered.z.ndim != 2 or not isinstance(own, DiscreteModel):
        msg = f"filtered: expected one record of a linear model, received shape {filtered.z.shape} of a {type(own).__name__}"
        raise ValueError(msg)
    steps, number = len(filtered.t) - 1, checks.count("number", number)
    unknown = np.isinf(own.P0.diagonal())
    begun = replace(own, P0=np.where(unknown[:, None] | unknown, 0.0, own.P0)) if unknown.any() else own
    truth, random = truth_arrays(begun, steps), np.random.default_rng(checks.count("seed", seed, least=0))
    x, z = histories(truth, normals(random, shape(truth, steps, first=0), number), first=0)
    z[np.isnan(filtered.z)] = np.nan
    return np.asarray(smooth(model, filtered).x[:, :, None] + x - smooth(own, z, first=0).x)
