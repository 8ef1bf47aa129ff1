"""Lab 5: pseudo-measurements of a point in the plane, with and without their covariance."""

import numpy as np

from ctlabs import ContinuousModel, actual_errors, discretise, steady_state

D, theta, sigma_D, sigma_theta, sigma_w2, tau = 1000.0, np.pi / 6, 10.0, 0.03, 4.0, 1.0
motion = ContinuousModel(
    F=np.kron(np.eye(2), [[0, 1], [0, 0]]), G=np.kron(np.eye(2), [[0], [1]]), Q=sigma_w2 * np.eye(2),
    H=np.kron(np.eye(2), [[1, 0]]), states=["x", "v_x", "y", "v_y"], P0=np.diag([1000, 40, 1000, 40]),
)

# (a), (b): the errors along and across the radius, turned into x and y
c, s = np.cos(theta), np.sin(theta)
turn = np.array([[c, -s], [s, c]])
pseudo_measurement_covariance = turn @ np.diag([sigma_D**2, (D * sigma_theta) ** 2]) @ turn.T
R = pseudo_measurement_covariance
correlation_coefficient = R[0, 1] / np.sqrt(R[0, 0] * R[1, 1])
optimal = discretise(motion, tau, R=R)
Phi, Qd = optimal.Phi, optimal.Qd

# (c): variant 1 takes the covariance for zero; the errors that it has in truth
believed = discretise(motion, tau, R=np.diag(np.diag(R)))
gain = steady_state(believed).K
posterior_variance_steady_variant1 = np.diag(actual_errors(optimal, optimal, K=gain).P_plus)

# (d), (e): the factors of R
l21 = R[0, 1] / R[0, 0]
diagonal_variances = [R[0, 0], R[1, 1] - l21 * R[0, 1]]

# (f), (g): variant 2 is the optimal filter
posterior_variance_steady_variant2 = np.diag(steady_state(optimal).P_plus)
variance_ratio_steady = posterior_variance_steady_variant1 / posterior_variance_steady_variant2

print("R:", pseudo_measurement_covariance, "correlation:", correlation_coefficient)
print("steady variances, variant 1:", posterior_variance_steady_variant1)
print("steady variances, variant 2:", posterior_variance_steady_variant2)
print("ratio:", variance_ratio_steady)
