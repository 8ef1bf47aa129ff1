"""Lab 18: a satellite in a circular orbit, its angle, its range, or both measured."""

import math

import numpy as np

from ctlabs import ContinuousModel, covariances, discretise, observability

r0, sigma_r, sigma_theta, dt, steps = 7.0e6, 50.0, 1e-4, 60.0, 200
w = math.sqrt(3.986004418e14 / r0**3)

# (b): deviations of r, its rate, the angle and its rate from the circular orbit
F = np.array([[0, 1, 0, 0], [3 * w**2, 0, 0, 2 * r0 * w], [0, 0, 0, 1], [0, -2 * w / r0, 0, 0]])
P0 = np.diag([1e6, 1, 1e-8, 1e-14])

# (c): ranks, and the standard deviations after all measurements
sets = {"theta": ([0], [sigma_theta]), "range": ([1], [sigma_r]), "both": ([0, 1], [sigma_theta, sigma_r])}
ranks, variances = {}, {}
for name, (rows, sigma) in sets.items():
    H = np.array([[0, 0, 1, 0], [1, 0, 0, 0]])[rows]
    measured = ContinuousModel(F=F, G=np.zeros((4, 1)), Q=[[0]], H=H, Rc=np.eye(len(rows)), P0=P0)
    ranks[name] = observability(measured).rank
    sampled = discretise(measured, dt, R=np.diag(np.square(sigma)))
    variances[name] = np.diag(covariances(sampled, steps).P_plus[-1])

observability_rank_theta, observability_rank_range, observability_rank_both = ranks.values()
posterior_variances_theta, posterior_variances_range, posterior_variances_both = variances.values()

for name in sets:
    print(f"{name:5s}: rank {ranks[name]}, σ of r {variances[name][0] ** 0.5:8.3f} m, σ of the angle {variances[name][2] ** 0.5 * 1e6:7.3f} µrad")
