"""Lab 20: an unstable system, its stable filter, and what an approximate transition costs."""

import numpy as np

from ctlabs import ContinuousModel, DiscreteModel, actual_errors, covariances, discretise, steady_state

Q, R_values, P0, dt = 1.0, [1.0, 2.0, 4.0], 1.0, 0.1
models = [ContinuousModel(F=[[1]], G=[[1]], Q=[[Q]], H=[[1]], Rc=[[R]], P0=[[P0]]) for R in R_values]

# (a), (b): P(t), its limit, and the pole of the filter
variance_continuous = [covariances(model, [0.25, 0.5, 1.0, 2.0]).P[:, 0, 0] for model in models]
limits = [steady_state(model) for model in models]
variance_steady_continuous = [limit.P[0, 0] for limit in limits]
gain_steady_continuous = [limit.K[0, 0] for limit in limits]
filter_pole = [limit.poles[0].real for limit in limits]

# (c): the discrete filter; discretise() takes Φ = exp(Δt) and the exact Q_d
sampled = [discretise(model, dt) for model in models]
steady = [steady_state(model) for model in sampled]
prior_variance_steady = [limit.P_minus[0, 0] for limit in steady]
posterior_variance_steady = [limit.P_plus[0, 0] for limit in steady]

# (c): a filter with Φ = 1 + Δt: what it claims and what is true after 4 s
truth = sampled[0]
design = DiscreteModel(Phi=[[1 + dt]], Qd=[[Q * dt]], H=[[1]], R=truth.R, P0=[[P0]], dt=dt)
errors = actual_errors(truth, design, steps=40)
claimed, true = (np.sqrt(each.P_plus[-1, 0, 0]) for each in (errors.claimed, errors))

for row in zip(R_values, variance_steady_continuous, filter_pole, prior_variance_steady, posterior_variance_steady, strict=True):
    print("R = {}: P → {:.4f}, pole {:.4f}; sampled P⁻ → {:.4f}, P⁺ → {:.4f}".format(*row))
print(f"with Φ = 1 + Δt, after 4 s: claimed σ = {claimed:.4f} m, true {true:.4f} m")
