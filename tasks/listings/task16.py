"""Lab 16: the Wiener process in white noise, filtered in continuous and in discrete time."""

import math

from ctlabs import ContinuousModel, covariances, discretise, steady_state

Q, R, P0, dt = 4.0, 16.0, 25.0, 1.0
process = ContinuousModel(F=[[0]], G=[[1]], Q=[[Q]], H=[[1]], Rc=[[R]], P0=[[P0]])

# (a): limit of the continuous filter, and its variance on the way there
limit = steady_state(process)
variance_steady_continuous, gain_steady_continuous = limit.P[0, 0], limit.K[0, 0]
tanh = [math.tanh(gain_steady_continuous * t) for t in (0.5, 1, 2, 5)]
variance_continuous = [variance_steady_continuous * (P0 + variance_steady_continuous * x) / (variance_steady_continuous + P0 * x) for x in tanh]

# (b): a measurement every dt with the variance R/dt
sampled = discretise(process, dt)
steady = steady_state(sampled)
prior_variance_steady, posterior_variance_steady, gain_steady = steady.P_minus[0, 0], steady.P_plus[0, 0], steady.K[0, 0]

# (c): the measurement from which the variance stays within 1 % of its limit
P = covariances(sampled, 100).P_plus[1:, 0, 0]
settling_step = max(k for k in range(1, 101) if k == 1 or abs(P[k - 2] / posterior_variance_steady - 1) > 0.01)

print(f"continuous: P = {variance_steady_continuous:.5f} m², K = {gain_steady_continuous:.5f} 1/s; P(t) = {variance_continuous}")
print(f"discrete: P⁻ = {prior_variance_steady:.5f}, P⁺ = {posterior_variance_steady:.5f} m², K = {gain_steady:.5f}")
print(f"the variance has settled within 1 % at measurement {settling_step}")
