"""Lab 21: a slope in white noise, its discrete filter, and how its variance and gain die away."""

import numpy as np

from ctlabs import DiscreteModel, covariances, kalman_filter, simulate

R, P0, dt = 2.0, 1.0, 0.5
at = np.array([0.5, 1.0, 2.0, 4.0])

# (a): the formulas of the Kalman–Bucy filter, and the largest gain
variance_continuous = 3 * R * P0 / (3 * R + P0 * at**3)
gain_continuous = variance_continuous * at / R
gain_maximum_time = (3 * R / (2 * P0)) ** (1 / 3)
gain_maximum = 2 * P0 * gain_maximum_time / (3 * R)

# (b): the equivalent discrete measurements: H_k = k Δt, R_d = R/Δt
steps = 40
sampled = DiscreteModel(Phi=[[1]], Qd=[[0]], H=(dt * np.arange(steps + 1.0))[:, None, None], R=[[R / dt]], P0=[[P0]], dt=dt)
plan = covariances(sampled, steps)
posterior_variance = plan.P_plus[np.rint(at / dt).astype(int), 0, 0]

# (c): the variance goes on falling, like 3R/t³; one simulated record
t = dt * steps
found = simulate(sampled, steps, runs=1, seed=1)
estimate = kalman_filter(sampled, found.z[1:, :, 0])

fine = DiscreteModel([[1]], [[0]], (dt / 100 * np.arange(801.0))[:, None, None], [[100 * R / dt]], P0=[[P0]], dt=dt / 100)
print("P of (a), and of a filter with a hundredth of the period:", variance_continuous[-1], covariances(fine, 800).P_plus[-1, 0, 0])
print("P:", variance_continuous, "K:", gain_continuous, "P_k:", posterior_variance, sep="\n")
print(f"largest gain {gain_maximum:.5f} 1/s² at {gain_maximum_time:.5f} s")
print(f"P({t:g} s) / (3R/t³) = {plan.P_plus[-1, 0, 0] * t**3 / (3 * R):.4f}")
print(f"a = {found.x[-1, 0, 0]:.4f} m/s, estimated {estimate.x_plus[-1, 0]:.4f} ± {estimate.P_plus[-1, 0, 0] ** 0.5:.4f} m/s")
