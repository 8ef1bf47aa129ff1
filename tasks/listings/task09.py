"""Lab 9: the voltage inside an RC ladder from the voltage at its output, in units of b."""

from ctlabs import ContinuousModel, covariances, discretise, steady_state

R1, R2, C1, C2, dt, steps, R = 1.0, 1.0, 1.0, 1.0, 0.5, 4, 0.2
circuit = ContinuousModel(
    F=[[-1 / (R1 * C1) - 1 / (R2 * C1), 1 / (R2 * C1)], [1 / (R2 * C2), -1 / (R2 * C2)]],
    G=[[1 / (R1 * C1)], [0]], Q=[[2]], H=[[0, 1]], P0=[[0, 0], [0, 0]], states=["U1", "U0"],
)

# (a): a perfect voltmeter
perfect = discretise(circuit, dt, R=[[0]])
Phi, Qd = perfect.Phi, perfect.Qd
plan = covariances(perfect, steps)
U1_variance_prior_perfect, U1_variance_posterior_perfect = plan.P_minus[1:, 0, 0], plan.P_plus[1:, 0, 0]
gain_perfect = plan.K[1:, :, 0]
posterior_steady_perfect = steady_state(perfect).P_plus[0, 0]

# (b): a noisy one
plan = covariances(discretise(circuit, dt, R=[[R]]), steps)
U1_variance_prior_noisy, U1_variance_posterior_noisy = plan.P_minus[1:, 0, 0], plan.P_plus[1:, 0, 0]
gain_noisy = plan.K[1:, :, 0]

print("(a) before:", U1_variance_prior_perfect, "after:", U1_variance_posterior_perfect, sep="\n")
print("(b) before:", U1_variance_prior_noisy, "after:", U1_variance_posterior_noisy, sep="\n")
print(f"steady after a perfect measurement: {posterior_steady_perfect:.5f} b²")
