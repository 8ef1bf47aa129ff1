"""Lab 25: a plant and its cost sampled, the regulator of least variance, and the autopilot of lab 13."""

import numpy as np

from ctlabs import ContinuousModel, Cost, regulator
from ctlabs.regulation import sample

Q, dt, Qu, Rc, tau = 1.0, 0.5, 0.1, 0.2, 0.25
integrator = ContinuousModel(F=[[0]], B=[[1]], G=[[1]], Q=[[Q]], H=[[1]], P0=[[Q]])

# (a): the model and the cost at the samples
model, cost = sample(integrator, Cost(Qx=[[1]], Qu=[[0]]), dt, R=[[0]])
sampled_weights = np.block([[cost.Qx, cost.N], [cost.N.T, cost.Qu]])
cost_between = cost.constant

# (b): least variance
least = regulator(integrator, Cost([[1]], [[0]]), dt=dt, R=[[0]])
feedback_gain, cost_minimum = least.L[0, 0], least.cost.value

# (d): with a weight of the input, a noisy sensor and a delay
weighed = regulator(integrator, Cost([[1]], [[Qu]]), dt=dt, R=[[Rc / dt]], delay=tau)
cost_sampled = weighed.cost.value

# (e): the autopilot
B1, B0, A1, A0 = 0.3, 0.003, 0.006, 0.003
autopilot = ContinuousModel(
    F=[[-A1, 1], [-A0, 0]], B=[[B1], [B0]], G=[[B1], [B0]], Q=[[1296]], H=[[1, 0]], Rc=[[6561]], P0=np.zeros((2, 2))
)
altitude = Cost(Qx=[[1, 0], [0, 0]], Qu=[[1]])
autopilot_cost_continuous = regulator(autopilot, altitude).cost.value
autopilot_cost = regulator(autopilot, altitude, dt=10).cost.value
autopilot_cost_delayed = regulator(autopilot, altitude, dt=10, delay=10).cost.value

print(f"L h = {feedback_gain * dt:.9f}, J = {cost_minimum:.9f}; with weight, noise and delay {cost_sampled:.6f}")
print(f"autopilot: {autopilot_cost_continuous:.2f} m², every 10 s {autopilot_cost:.2f}, a period late {autopilot_cost_delayed:.2f}")
