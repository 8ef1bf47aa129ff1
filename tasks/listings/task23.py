"""Lab 23: the optimum for an engineer's black box, in continuous and in discrete time."""

import numpy as np

from ctlabs import ContinuousModel, covariances, discretise, steady_state

signal_power, signal_pole, noise_power, noise_pole, dt, steps = 5 / 12, 2.0, 7 / 12, 4.0, 0.1, 20
a, b, q = signal_pole, noise_pole, signal_power + noise_power
signal, noise = signal_power / (2 * a), noise_power / (2 * b)  # stationary variances

# (b): the signal, measured by dz/dt + bz with noise that correlates with the process noise
derived = ContinuousModel(F=[[-a]], G=[[1]], Q=[[signal_power]], H=[[b - a]], Rc=[[q]], N=[[signal_power]], P0=[[signal]])
limit = steady_state(derived)
gain, optimal_variance = limit.K[0, 0], limit.P[0, 0]
optimal_transfer_function = [[gain, gain * b], [1.0, a + (b - a) * gain]]
constant_gain_variance = signal * noise / (signal + noise)


def box_error():
    """The box ŝ = ξ + z/2 with ξ' = −2ξ + z on signal and noise: its stationary mean square error."""
    F = np.array([[-a, 0, 0], [0, -b, 0], [1, 1, -2]])
    Q = np.diag([signal_power, noise_power, 0.0])
    eye = np.eye(3)
    P = np.linalg.solve(np.kron(F, eye) + np.kron(eye, F), -Q.ravel()).reshape(3, 3)
    row = np.array([0.5 - 1, 0.5, 1.0])
    return row @ P @ row


black_box_variance = box_error()

# (c), (d): both processes as states, sampled, measured without noise from t0 on
system = ContinuousModel(F=np.diag([-a, -b]), G=np.eye(2), Q=np.diag([signal_power, noise_power]), H=[[1, 1]], P0=np.diag([signal, noise]))
discrete = discretise(system, dt, R=[[0]])
posterior_variance = covariances(discrete, steps, first=0).P_plus[:, 0, 0]
steady = steady_state(discrete)
posterior_variance_steady, gain_steady = steady.P_plus[0, 0], steady.K[0, 0]

print(f"optimum ({gain:.4f} s + {gain * b:.4f})/(s + {optimal_transfer_function[1][1]:.4f}): {optimal_variance:.6f} V²")
print(f"box: {black_box_variance:.6f} V², best constant gain: {constant_gain_variance:.6f} V²")
print(f"discrete: from {posterior_variance[0]:.6f} to {posterior_variance_steady:.6f} V², K = {gain_steady:.5f}")
