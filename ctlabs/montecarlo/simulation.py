"""Histories of a truth: states and measurements of many runs, the same runs that :func:`ctlabs.montecarlo.monte_carlo` counts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.filtering import measured
from ctlabs.filtering.problem import driven
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel
from ctlabs.models.histories import histories, shape, truth_arrays
from ctlabs.montecarlo import streams
from ctlabs.montecarlo.plan import check_finite, layout, missing


@dataclass(frozen=True, slots=True, eq=False)
class Simulation:
    """``t`` (steps+1,) s · ``x`` (steps+1, n, runs), states · ``z`` (rows, m, runs), measurements from the first one on, NaN where none."""

    t: Array
    x: Array
    z: Array


def simulate(
    model: DiscreteModel,
    steps: int,
    runs: int,
    seed: int,
    first: int | None = None,
    *,
    u: ArrayLike | None = None,
    u0: ArrayLike | None = None,
) -> Simulation:
    r"""Draw ``runs`` records of a linear Gaussian system.

    .. math:: x_0 \sim N(\bar x_0, P_0), \quad x_{k+1} = \Phi_k x_k + c_k + w_k, \quad z_k = H_k x_k + v_k

    Parameters
    ----------
    model : discrete model; singular P0, Qd, R and correlated w, v (N) are honoured; R = inf means no measurement
    steps, runs : how many
    seed : whole number; the first runs of an experiment do not depend on how many there are, nor the states on
        what is measured
    first : 1 (first measurement at t1), 0 (at t0), or as the model says: the instant of z's first row
    u, u0 : known inputs, as for :func:`ctlabs.kalman_filter`

    Raises
    ------
    FloatingPointError
        An unstable system overflows: the step and the time are in the message.

    >>> m = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])
    >>> s = simulate(m, steps=3, runs=2, seed=1)
    >>> s.x.shape, s.z.shape
    ((4, 1, 2), (3, 1, 2))
    """
    steps = measured.horizon(model, steps)
    runs, seed = checks.count("runs", runs), checks.count("seed", seed, least=0)
    first = measured.begins(model, first)
    model, seen = driven(model.cut(steps), steps + 1 - first, first, u, u0)
    truth = truth_arrays(model, steps)
    x, z = histories(truth, streams.normals(seed, layout(model.n, steps), shape(truth, steps, first), runs), first)
    check_finite("x", x, model.dt)
    absent = missing(model, steps)
    absent[:first] = True
    z[absent] = np.nan
    z = z[first:]
    return Simulation(np.arange(steps + 1) * model.dt, x, z if seen is None else z + seen[:, :, None])
