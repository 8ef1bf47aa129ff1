"""Lab 7: the scalar filter, its steady state, and a constant gain that is not the best."""

from ctlabs import DiscreteModel, actual_errors, covariances, steady_state

Phi, Q, R, P0, K_star = 0.78, 0.39, 0.5, 1.0, 0.3
model = DiscreteModel(Phi=[[Phi]], Qd=[[Q]], H=[[1]], R=[[R]], P0=[[P0]])

# (a), (f): variances before and after each of five measurements, and the gain
plan = covariances(model, steps=5)
prior_variance, posterior_variance, gain = (each[1:, 0, 0] for each in (plan.P_minus, plan.P_plus, plan.K))

# (c): the limit, which is also the best constant gain
limit = steady_state(model)
gain_steady = limit.K[0, 0]
prior_variance_steady, posterior_variance_steady = limit.P_minus[0, 0], limit.P_plus[0, 0]

# (b): the true variance under the constant gain K_star
suboptimal_variance_ratio = actual_errors(model, model, K=[[K_star]]).P_plus[0, 0] / R

# (e): without process noise
noiseless_limit = steady_state(DiscreteModel(Phi=[[Phi]], Qd=[[0]], H=[[1]], R=[[R]], P0=[[P0]])).P_plus[0, 0]

print("P⁻, P⁺, K:", prior_variance, posterior_variance, gain, sep="\n")
print(f"steady state: P⁻ = {prior_variance_steady:.5f}, P⁺ = {posterior_variance_steady:.5f}, K = {gain_steady:.5f}")
print(f"constant gain {K_star}: P/R = {suboptimal_variance_ratio:.5f}; without process noise P⁺ → {noiseless_limit}")
