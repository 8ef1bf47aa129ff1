"""Lab 19: the free motion of a first-order system, its continuous filter and that of discrete measurements."""

from ctlabs import ContinuousModel, covariances, discretise, steady_state

beta, dt = 1.0, 0.1
model = ContinuousModel(F=[[-beta]], G=[[1]], Q=[[0]], H=[[1]], Rc=[[1]], P0=[[1]])

# (a): P(t) of the Kalman–Bucy filter, and its limit
variance_continuous = covariances(model, [0.25, 0.5, 1.0, 2.0]).P[:, 0, 0]
limit = steady_state(model)
variance_limit, filter_pole = limit.P[0, 0], limit.poles[0].real

# (b): the equivalent discrete measurements: Φ = exp(−β Δt), R = 1/Δt
sampled = discretise(model, dt)
plan = covariances(sampled, steps=round(1 / dt))
posterior_variance_at_1s = plan.P_plus[-1, 0, 0]
posterior_variance_limit = steady_state(sampled).P_plus[0, 0]

# (c): the difference from P(1 s) is halved with the period
for n in (8, 16, 32, 64):
    difference = covariances(discretise(model, 1 / n), steps=n).P_plus[-1, 0, 0] - variance_continuous[2]
    print(f"Δt = {1 / n:.5f} s: P⁺ − P = {difference:.3e} m²")

print("P(0.25), P(0.5), P(1), P(2):", variance_continuous)
print(f"limit {variance_limit:.5f}, pole {filter_pole:.5f}; discrete at 1 s: {posterior_variance_at_1s:.5f}, limit {posterior_variance_limit:.5f}")
