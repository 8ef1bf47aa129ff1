"""Lab 13: the altitude behind an autopilot, measured continuously and once a second."""

import numpy as np

from ctlabs import ContinuousModel, covariances, discretise, steady_state

N_c, N_m, var, dt, steps = 36.0**2, 81.0**2, 22500.0**2, 1.0, 300
F, G = np.array([[-0.006, 1.0], [-0.003, 0.0]]), np.array([[0.3], [0.003]])
two = ContinuousModel(F=F, G=G, Q=[[N_c]], H=[[1, 0]], Rc=[[N_m]], P0=np.zeros((2, 2)))

# (a): the limit is that of the two states which noise drives
limit = steady_state(two)
altitude_variance_steady_continuous, altitude_gain_steady_continuous = limit.P[0, 0], limit.K[0, 0]
filter_polynomial = np.poly(limit.poles)

# (b): the same for a measurement once a second
sampled = steady_state(discretise(two, dt))
altitude_variance_prior_steady, altitude_variance_posterior_steady = sampled.P_minus[0, 0], sampled.P_plus[0, 0]
altitude_gain_steady = sampled.K[0, 0]

# (c): three states, with the unknown constant command, from settled flight
q = np.append(-np.linalg.solve(F, G[:, 0]), 1.0)
three = ContinuousModel(
    F=np.vstack([np.hstack([F, G]), np.zeros(3)]), G=np.vstack([G, [0]]), Q=[[N_c]], H=[[1, 0, 0]], Rc=[[N_m]], P0=var * np.outer(q, q)
)
plan = covariances(discretise(three, dt), steps)

print(f"continuous: P11 = {altitude_variance_steady_continuous:.3f} m², K1 = {altitude_gain_steady_continuous:.5f} 1/s")
print(f"sampled: P11 = {altitude_variance_prior_steady:.3f} m² before, {altitude_variance_posterior_steady:.3f} m² after a measurement")
for k in (1, 10, 60, 300):
    print(f"t = {k * dt:3.0f} s: σ of h {plan.sd_plus[k, 0]:8.3f} m, σ of h_c0 {plan.sd_plus[k, 2]:8.3f} m, K3 {plan.K[k, 2, 0]:.5f}")
