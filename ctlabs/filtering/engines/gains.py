"""The estimates of many records under gains that are known beforehand: one matrix product for all runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ctlabs.filtering import contradictions
from ctlabs.filtering.motion import motion
from ctlabs.filtering.results import Covariances, Filtered, consistency
from ctlabs.models.linear import at

if TYPE_CHECKING:
    from ctlabs.filtering.algorithms.beginning import Beginning
    from ctlabs.filtering.problem import FilterProblem


def apply(problem: FilterProblem, plan: Covariances, algorithm: str, begun: Beginning | None = None) -> Filtered:
    """The estimates of all runs, and what they say of the model that the gains were made for; ``begun``, after a vague start."""
    model, z = problem.model, problem.z
    x_minus = np.empty((len(z), model.n, z.shape[2]))
    x_plus, innovation = np.empty_like(x_minus), np.full(z.shape, np.nan)
    x_minus[0] = np.where(np.isinf(np.diag(model.P0)), 0.0, model.x0)[:, None]
    used = plan.used & ~problem.absent
    for k in range(len(z)):
        if k:
            Phi, _, M = motion(model, k - 1, used[k - 1])
            np.matmul(Phi, x_plus[k - 1], out=x_minus[k])
            if M is not None:
                x_minus[k] += M @ z[k - 1, used[k - 1]]
            if model.offset is not None:
                x_minus[k] += at(model.offset, k - 1, 1)[:, None]
        np.subtract(z[k], at(model.H, k, 2) @ x_minus[k], out=innovation[k])
        if used[k].all():
            np.matmul(plan.K[k], innovation[k], out=x_plus[k])
        else:
            np.matmul(plan.K[k][:, used[k]], innovation[k, used[k]], out=x_plus[k])
            innovation[k, ~used[k]] = np.nan
        x_plus[k] += x_minus[k]
    for values, variances in ((x_minus, plan.P_minus), (x_plus, plan.P_plus), (innovation, plan.S)):
        values[np.isinf(np.diagonal(variances, axis1=1, axis2=2))] = np.nan  # not known, whatever stands there
    nis, logs = consistency(innovation, plan.S, used & np.isfinite(innovation).all(axis=2))
    ordinary, diffuse, rows = np.zeros(1), np.zeros(1), 0
    if begun is not None:
        ordinary, diffuse, rows, nis[: begun.rows] = begun.ordinary, begun.diffuse, begun.rows, begun.nis
    total = logs[rows:].sum(axis=0)
    found = Filtered(
        plan.t, plan.P_minus, plan.P_plus, plan.K, plan.S, used, algorithm,
        x_minus=x_minus, x_plus=x_plus, innovation=innovation, nis=nis, z=z, model=model,
        log_likelihood=total + ordinary, log_likelihood_diffuse=total + diffuse, start=None if begun is None else begun.start,
    )  # fmt: skip
    return contradictions.judged(problem, found)
