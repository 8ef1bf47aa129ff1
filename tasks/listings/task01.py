"""Lab 1: a position that is a random constant plus Brownian motion."""

import numpy as np

from ctlabs import ContinuousModel, covariances, discretise, steady_state

sigma_w2, tau, R, x0_mean, P0, steps = 1.0, 1.0, 1.0, 0.0, 10.0, 10
walk = ContinuousModel(F=[[0]], G=[[1]], Q=[[sigma_w2]], H=[[1]], x0=[x0_mean], P0=[[P0]], states=["x"])
model = discretise(walk, tau, R=[[R]])

# (a): variances and gain, known before any measurement; what is left of a wrong initial mean
plan = covariances(model, steps)
prior_variance, posterior_variance, gain = (each[1:, 0, 0] for each in (plan.P_minus, plan.P_plus, plan.K))
bias_factor = np.cumprod(1 - gain)

# (c): the limit, and when the variance stays within 1 % of it
limit = steady_state(model)
prior_variance_steady, posterior_variance_steady = limit.P_minus[0, 0], limit.P_plus[0, 0]
gain_steady = limit.K[0, 0]
outside = np.abs(posterior_variance - posterior_variance_steady) > 0.01 * posterior_variance_steady
settling_step = int(np.flatnonzero(outside)[-1]) + 2

# (d): in the steady state one measurement is missing (R = ∞), or perfect (R = 0); six follow
after = {}
for name, anomaly in (("missing", np.inf), ("perfect", 0.0)):
    variances = np.array([np.inf, anomaly, *[R] * 6])[:, None, None]
    start = ContinuousModel(F=[[0]], G=[[1]], Q=[[sigma_w2]], H=[[1]], P0=limit.P_plus)
    after[name] = covariances(discretise(start, tau, R=variances), 7).P_plus[1:, 0, 0]
posterior_variance_missing, posterior_variance_perfect = after["missing"], after["perfect"]

print("P⁻, P⁺, K:", prior_variance, posterior_variance, gain, sep="\n")
print(f"steady: P⁻ = {prior_variance_steady:.5f}, P⁺ = {posterior_variance_steady:.5f}, K = {gain_steady:.5f}; settled at {settling_step}")
print("after a missing one:", posterior_variance_missing, "after a perfect one:", posterior_variance_perfect, sep="\n")
