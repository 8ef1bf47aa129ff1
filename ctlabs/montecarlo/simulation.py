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
from ctlabs.montecarlo import streams
from ctlabs.montecarlo.plan import Truth, check_finite, entry, layout, missing, truth_arrays


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


def shape(truth: Truth, steps: int, first: int) -> streams.Shape:
    """The normals that a run of a truth takes; where w and v correlate v is drawn at t0 too."""
    return streams.Shape(truth.F0.shape[1], truth.G.shape[2], truth.L.shape[2], steps, 0 if len(truth.C) else first)


def histories(truth: Truth, xi: streams.Normals, first: int) -> tuple[Array, Array]:
    """States and measurements made from given white noises."""
    steps, runs = len(xi.w), xi.start.shape[1]
    x = np.empty((steps + 1, len(truth.x0), runs))
    z = np.full((steps + 1, truth.H.shape[1], runs), np.nan)
    with np.errstate(over="ignore", invalid="ignore"):  # an overflow is reported by the caller, with its time
        x[0] = truth.x0[:, None] + truth.F0 @ xi.start
        for k in range(steps + 1):
            if k:
                np.matmul(entry(truth.Phi, k - 1), x[k - 1], out=x[k])
                x[k] += entry(truth.c, k - 1)[:, None] + entry(truth.G, k - 1) @ xi.w[k - 1]
                if len(truth.C):
                    x[k] += entry(truth.C, k - 1) @ xi.v[k - 1]
            if k >= first:
                np.matmul(entry(truth.H, k), x[k], out=z[k])
                z[k] += entry(truth.L, k) @ xi.v[k]
    return x, z
