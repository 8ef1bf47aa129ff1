"""Lab 2: the position of lab 1 with a known drift, and a filter that forgets it."""

from ctlabs import ContinuousModel, actual_errors, covariances, discretise, steady_state

sigma_w2, tau, R, P0, steps, u = 1.0, 1.0, 1.0, 10.0, 10, 1.0


def model(u, P0=P0):
    """ẋ = u + w, sampled."""
    walk = ContinuousModel(F=[[0]], G=[[1]], Q=[[sigma_w2]], H=[[1]], B=[[1]], P0=[[P0]], states=["x"])
    return discretise(walk, tau, R=[[R]], u=[u])


# (a): the input enters the mean only
control_increment = float(model(u).offset[0])
posterior_variance = covariances(model(u), steps).P_plus[1:, 0, 0]
posterior_variance_known_start = covariances(model(u, P0=0.0), steps).P_plus[1:, 0, 0]

# (c): the limit; the bias (truth − estimate) of the filter that forgets u
gain_steady = steady_state(model(u)).K[0, 0]
wrong = actual_errors(model(u), model(0.0))
unmodelled_drift_bias_prior, unmodelled_drift_bias_posterior = -wrong.bias_minus[0], -wrong.bias_plus[0]
unmodelled_drift_mse = wrong.P_plus[0, 0] + unmodelled_drift_bias_posterior**2

print("P⁺:", posterior_variance, "from a known start:", posterior_variance_known_start, sep="\n")
print(f"K = {gain_steady:.5f}; without u the bias is {unmodelled_drift_bias_prior:.5f} m before an update")
print(f"and {unmodelled_drift_bias_posterior:.5f} m after it, the mean square error {unmodelled_drift_mse:.5f} m²")
