"""Lab 8: a coloured input, two simplified filters, and what they really do."""

import numpy as np

from ctlabs import ContinuousModel, actual_errors, covariances, discretise, steady_state

a, T, dt, R, s2, steps = 1.0, 0.1, 0.5, 2.0, 5.0, 20
first = [[1.0, 0.0]]  # of the true states (x, y) the filters estimate x

# (a): the input y is a second state, driven by white noise
truth = ContinuousModel(F=[[-a, 1], [0, -1 / T]], G=[[0], [1]], Q=[[2 * s2 / T]], H=[[1, 0]], P0=np.diag([0, s2]))
truth = discretise(truth, dt, R=[[R]])
Phi_truth, Qd_truth = truth.Phi, truth.Qd
optimal_variance = covariances(truth, steps).P_plus[1:, 0, 0]
optimal_variance_steady = steady_state(truth).P_plus[0, 0]

# (c): white noise in place of y
intensity_variant1, intensity_variant2 = 2 * s2 * T, 2 * s2 * T / (1 + a * T)
claimed, true, over_time = [], [], []
for Q in (intensity_variant1, intensity_variant2):
    design = discretise(ContinuousModel(F=[[-a]], G=[[1]], Q=[[Q]], H=[[1]], P0=[[0]]), dt, R=[[R]])
    limit = actual_errors(truth, design, compare=first)  # (e), (f): claimed and true in the steady state
    claimed.append(limit.claimed.P_plus[0, 0])
    true.append(limit.P_plus[0, 0])
    over_time.append(actual_errors(truth, design, steps, compare=first).P_plus[1:, 0, 0])

claimed_variance_steady_variant1, claimed_variance_steady_variant2 = claimed
true_variance_steady_variant1, true_variance_steady_variant2 = true
true_variance_variant1, true_variance_variant2 = over_time

print(f"optimal {optimal_variance_steady:.5f} m²")
for i in range(2):
    print(f"variant {i + 1}: claims {claimed[i]:.5f} m², has {true[i]:.5f} m²")
