"""A constant signal under a constant slow error and white noise: what is found, and what ignoring the error costs."""

import numpy as np

from ctlabs import DiscreteModel, actual_errors, covariances, kalman_filter

lam, mu, sigma_w2, sigma_lambda2, sigma_mu2, k = 8.0, 5.0, 1000.0, 100.0, 50.0, 10_000


def constants(noise):
    """Signal and slow error as two constant states, of which the sum is measured in noise of this variance."""
    return DiscreteModel(np.eye(2), np.zeros((2, 2)), [[1, 1]], [[noise]], P0=np.diag([sigma_lambda2, sigma_mu2]), states=["λ", "μ"])


# (recursive): for constants the average of k samples says all that they say, so one update by it stands for k
after = covariances(constants(sigma_w2 / k), steps=1)
lambda_variance, mu_variance, covariance = after.P_plus[1, 0, 0], after.P_plus[1, 1, 1], after.P_plus[1, 0, 1]
lambda_gain, mu_gain = after.K[1, :, 0] / k  # of one sample
variance_floor = covariances(constants(0.0), steps=1).P_plus[1, 0, 0]  # λ + μ known exactly

# (figure2): the estimator that ignores μ
ignoring = DiscreteModel([[1]], [[0]], [[1]], [[sigma_w2 / k]], P0=[[sigma_lambda2]])
naive_variance = actual_errors(constants(sigma_w2 / k), ignoring, steps=1, compare=[[1.0, 0.0]]).P_plus[1, 0, 0]
least_at = sigma_w2 / (2 * sigma_mu2 - sigma_lambda2) if 2 * sigma_mu2 > sigma_lambda2 else None

# (figure1), (statement): the estimates from samples without noise, that is, their means
estimates = kalman_filter(constants(sigma_w2 / k), [lam + mu]).x_plus[-1]
lambda_error_percent_expected, mu_error_percent_expected = 100 * (estimates / [lam, mu] - 1)

print(f"P11 = {lambda_variance:.4f}, P22 = {mu_variance:.4f}, P12 = {covariance:.4f}, floor {variance_floor:.4f} u²")
print(f"ignoring μ: {naive_variance:.4f} u²; its least variance at k = {least_at}")
print(f"expected errors: {lambda_error_percent_expected:.3f} % and {mu_error_percent_expected:.3f} %")
