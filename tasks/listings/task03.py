"""Lab 3: a coordinate whose velocity is a random constant plus Brownian motion."""

import numpy as np

from ctlabs import ContinuousModel, covariances, discretise, steady_state

sigma_w2, tau, R, steps, n = 1.0, 1.0, 1.0, 10, 2
P0 = np.diag([100, 10])
F, G, H = np.eye(n, k=1), np.eye(n)[:, -1:], np.eye(n)[:1]


def model(R, P0):
    """2 integrators in a row, the first of which is measured."""
    return discretise(ContinuousModel(F=F, G=G, Q=[[sigma_w2]], H=H, P0=P0), tau, R=[[R]])


# (a), (b): the discrete model and the factors of its noise covariance
system = model(R, P0)
Phi, Qd = system.Phi, system.Qd
standardised_noise_factor = np.linalg.cholesky(Qd)
diagonal_noise_variances = np.diag(standardised_noise_factor) ** 2
unit_lower_factor = standardised_noise_factor / np.diag(standardised_noise_factor)

# (c): variances of the state from a known start, without measurements
open_loop_covariance = covariances(model(np.inf, np.zeros((n, n))), 20).P_minus[-1]

# (d): the filter along the measurements and in the limit
plan, limit = covariances(system, steps), steady_state(system)
gain, posterior_covariance = plan.K[1:, :, 0], plan.P_plus[1:]
prior_covariance_steady, posterior_covariance_steady = limit.P_minus, limit.P_plus
gain_steady = limit.K[:, 0]
alpha_beta = [gain_steady[0], gain_steady[1] * tau]

print("Qd:", Qd, "factor with unit diagonal:", unit_lower_factor, sep="\n")
print("covariance after 20 periods without measurements:", open_loop_covariance, sep="\n")
print("steady P⁺:", posterior_covariance_steady, "gain:", gain_steady, sep="\n")
