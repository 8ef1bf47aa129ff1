"""Lab 11: a random walk, its first measurements in exact fractions, and its limit."""

from fractions import Fraction

from ctlabs import DiscreteModel, covariances, kalman_filter, steady_state

mean, second_moment, Q, R = 1.0, 2.0, 0.5, 0.25
P1 = second_moment - mean**2
model = DiscreteModel(Phi=[[1]], Qd=[[Q]], H=[[1]], R=[[R]], x0=[mean], P0=[[P1]], first=0)  # measured at t1 already

# (a), (b): the variances and gains of five measurements
plan = covariances(model, steps=4)
prior_variance, gain, posterior_variance = (each[:, 0, 0] for each in (plan.P_minus, plan.K, plan.P_plus))
information_increment = 1 / posterior_variance[:2] - 1 / prior_variance[:2]

# (a): the estimate is affine in z1, z2; its coefficients are the answers to unit measurements
constant = kalman_filter(model, [0, 0]).x_plus[:, 0]
unit = [kalman_filter(model, z).x_plus[:, 0] - constant for z in ([1, 0], [0, 1])]
posterior_estimate_coefficients_1 = [constant[0], unit[0][0]]
posterior_estimate_coefficients_2 = [constant[1], unit[0][1], unit[1][1]]

# (b): the limits
limit = steady_state(model)
prior_variance_steady, posterior_variance_steady, gain_steady = limit.P_minus[0, 0], limit.P_plus[0, 0], limit.K[0, 0]

exact = [Fraction(c).limit_denominator(1000) for c in posterior_estimate_coefficients_2]
print("x̂(t2⁺) = {} + {} z1 + {} z2".format(*exact))
print("P⁻, K, P⁺:", prior_variance, gain, posterior_variance, sep="\n")
print(f"steady state: P⁻ = {prior_variance_steady:.5f}, P⁺ = {posterior_variance_steady:.5f}, K = {gain_steady:.5f}")
