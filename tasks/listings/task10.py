"""Lab 10: an oscillator sampled once a cycle, and four times."""

import math

import numpy as np

from ctlabs import ContinuousModel, covariances, discretise, observability

P0, R, steps = np.array([[4.0, 1.0], [1.0, 2.0]]), 1.0, 10
oscillator = ContinuousModel(F=[[0, 1], [-1, 0]], G=[[0], [1]], Q=[[0]], H=[[1, 0]], P0=P0, states=["y", "v"])

variances, ranks, lost = {}, {}, {}
for name, dt in (("bad", 2 * math.pi), ("good", math.pi / 2)):
    sampled = discretise(oscillator, dt, R=[[R]])
    variances[name] = covariances(sampled, steps).P_plus[1:]
    seen = observability(sampled)
    ranks[name], lost[name] = seen.rank, seen.unobservable

position_variance_bad, velocity_variance_bad = variances["bad"][:, 0, 0], variances["bad"][:, 1, 1]
velocity_variance_good = variances["good"][:, 1, 1]
observability_rank_bad, observability_rank_good = ranks["bad"], ranks["good"]
velocity_variance_floor = P0[1, 1] - P0[0, 1] ** 2 / P0[0, 0]

print("ranks:", ranks, "lost at the bad period:", lost["bad"].ravel())
print("variance of the velocity, bad: ", velocity_variance_bad.round(5))
print("variance of the velocity, good:", velocity_variance_good.round(5))
print("floor:", velocity_variance_floor)
