"""Lab 17: two Wiener processes of which only the sum is measured."""

import numpy as np

from ctlabs import ContinuousModel, discretise, observability, steady_state

q1, q2, R, P01, P02, dt = 1.0, 1.0, 2.0, 1.0, 2.0, 1.0

# (a): one state is enough
one = ContinuousModel(F=[[0]], G=[[1]], Q=[[q1 + q2]], H=[[1]], Rc=[[R]], P0=[[P01 + P02]])
limit = steady_state(one)
variance_steady_continuous, gain_steady_continuous = limit.P[0, 0], limit.K[0, 0]

# the trap: with two states the model is not detectable, and no steady covariance exists
two = ContinuousModel(F=np.zeros((2, 2)), G=np.eye(2), Q=np.diag([q1, q2]), H=[[1, 1]], Rc=[[R]], P0=np.diag([P01, P02]))
observability_rank_two_states = observability(two).rank
try:
    steady_state(two)
except ValueError as refusal:
    print("two states:", refusal)

# (b): a measurement every dt with the variance R/dt
steady = steady_state(discretise(one, dt))
prior_variance_steady, posterior_variance_steady, gain_steady = steady.P_minus[0, 0], steady.P_plus[0, 0], steady.K[0, 0]

print(f"continuous: P = {variance_steady_continuous:.5f} m², K = {gain_steady_continuous:.5f} 1/s")
print(f"discrete: P⁻ = {prior_variance_steady:.5f}, P⁺ = {posterior_variance_steady:.5f} m², K = {gain_steady:.5f}")
