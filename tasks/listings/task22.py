"""Lab 22: an integrator in coloured measurement noise; continuous and discrete filters of perfect measurements."""

import math

import numpy as np

from ctlabs import ContinuousModel, covariances, discretise, kalman_filter, simulate, steady_state

a, Q1, Q2, sigma1_2, sigma2_2, dt, steps = 2.0, 1.0, 3.0, 1.0, 0.75, 0.1, 20

# (a): what is left to be estimated is x1, measured by dz/dt + az with noise that correlates with the object's
variance_after_first_measurement = sigma1_2 * sigma2_2 / (sigma1_2 + sigma2_2)
derived = ContinuousModel(F=[[0]], G=[[1]], Q=[[Q1]], H=[[a]], Rc=[[Q1 + Q2]], N=[[Q1]], P0=[[variance_after_first_measurement]])
limit = steady_state(derived)
c1, variance_steady_continuous = limit.K[0, 0], limit.P[0, 0]
filter_transfer_function = [[c1, c1 * a], [1.0, a * c1]]

# (b): both states, sampled and measured without noise; the first measurement is made at t0
system = ContinuousModel(F=[[0, 0], [0, -a]], G=np.eye(2), Q=np.diag([Q1, Q2]), H=[[1, 1]], P0=np.diag([sigma1_2, sigma2_2]))
discrete = discretise(system, dt, R=[[0]])
plan, steady = covariances(discrete, steps, first=0), steady_state(discrete)
posterior_variance = plan.P_plus[:, 0, 0]
posterior_variance_steady, gain_steady = steady.P_plus[0, 0], steady.K[0, 0]

# (c): the reduced filter has one state and the pole 1 − (1 − b)K1; it gives the same estimates
b = math.exp(-a * dt)
filter_pole = 1 - (1 - b) * gain_steady
z = simulate(discrete, steps, runs=1, seed=1, first=0).z[:, 0, 0]
whole = kalman_filter(discrete, z, first=0)
estimate = [plan.K[0, 0, 0] * z[0]]
for i in range(1, steps + 1):
    estimate.append(estimate[-1] + plan.K[i, 0, 0] * (z[i] - b * z[i - 1] - (1 - b) * estimate[-1]))

print(f"continuous: c1 = {c1:.5f}, P = {variance_steady_continuous:.5f} m²")
print(f"discrete: P⁺ = {posterior_variance_steady:.5f} m², K1 = {gain_steady:.5f}, pole {filter_pole:.5f}")
print(f"reduced and whole filter differ by {abs(whole.x_plus[:, 0] - estimate).max():.1e} m at most")
