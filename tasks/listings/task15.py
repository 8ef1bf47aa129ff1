"""Lab 15: a signal in coloured noise; the filter of perfect measurements and its reduction to one state."""

import math

import numpy as np

from ctlabs import ContinuousModel, actual_errors, covariances, discretise, kalman_filter, simulate, steady_state

w0, wn, dt, Q1, Q2, Es2, En2, steps = 1.0, 2.0, 0.5, 2.0, 1.0, 1.0, 0.5, 10


def sampled(Q1, wn):
    """Signal and noise as two states, sampled exactly and measured without white noise."""
    system = ContinuousModel(F=np.diag([-w0, -wn]), G=np.eye(2), Q=np.diag([Q1, Q2]), H=[[1, 1]], P0=np.diag([Es2, En2]))
    return discretise(system, dt, R=[[0]])


# (a): the recursion, from the measurement at t0 on, and its limit
model = sampled(Q1, wn)
plan, limit = covariances(model, steps, first=0), steady_state(model)
signal_variance, gain = plan.P_plus[:, 0, 0], plan.K[:, 0, 0]
signal_variance_steady, gain_steady = limit.P_plus[0, 0], limit.K[0, 0]

# (b): the reduced filter has one state, and gives the same estimates
a, b = math.exp(-w0 * dt), math.exp(-wn * dt)
filter_pole = a - (a - b) * gain_steady
z = simulate(model, steps, runs=1, seed=1, first=0).z[:, 0, 0]
whole = kalman_filter(model, z, first=0)
estimate = [gain[0] * z[0]]
for i in range(1, steps + 1):
    estimate.append(a * estimate[-1] + gain[i] * (z[i] - b * z[i - 1] - (a - b) * estimate[-1]))

# (c): equal frequencies, and the given filter on a signal that moves less
signal_variance_steady_equal_frequencies = steady_state(sampled(Q1, w0)).P_plus[0, 0]
wrong = actual_errors(sampled(Q1 / 2, wn), model)

print("p:", signal_variance, "K:", gain, sep="\n")
print(f"limit {signal_variance_steady:.6f} V², gain {gain_steady:.6f}, pole {filter_pole:.6f}")
print(f"equal frequencies: {signal_variance_steady_equal_frequencies:.6f} V²; half of Q1: {wrong.P_plus[0, 0]:.6f} V²")
print(f"reduced and whole filter differ by {abs(whole.x_plus[:, 0] - estimate).max():.1e} V at most")
