"""Lab 26: Doyle's plant, its optimal regulator, the margins, and a filter that believes in noise at the input."""

import numpy as np

from ctlabs import ContinuousModel, Cost, regulator
from ctlabs.regulation import margins

q, sigma, m, mu = 60.0, 60.0, 1.008, 100.0


def plant(gain=1.0, more=0.0):
    """With an input that acts ``gain`` times as strongly, and noise of strength ``more`` at it."""
    return ContinuousModel(
        F=[[1, 1], [0, 1]], B=[[0], [gain]], G=[[1, 0], [1, 1]], Q=[[sigma, 0], [0, more]], H=[[1, 0]], Rc=[[1]], P0=np.zeros((2, 2))
    )


wanted = Cost(Qx=q * np.ones((2, 2)), Qu=[[1]])
optimal = regulator(plant(), wanted)

# (a), (b), (c)
feedback_gain, filter_gain, cost = optimal.L[0], optimal.K[:, 0], optimal.cost.value
margin = margins(optimal).inputs["u"]
gain_margins, phase_margin, delay_margin = margin.gain, margin.phase, margin.delay
cost_actual = optimal.actual_cost(plant(gain=m))

# (e): designed for noise at the input, at work where there is none
recovered = regulator(plant(more=mu), wanted)
recovered_filter_gain, recovered_cost = recovered.K[:, 0], recovered.actual_cost(plant())
recovered_gain_margins = margins(recovered, plant()).inputs["u"].gain

print(f"L = {feedback_gain}, K = {filter_gain}, J = {cost:.6f}")
print(f"stable for {gain_margins[0]:.6f} < m < {gain_margins[1]:.6f}; J({m}) = {cost_actual:.3f}")
print(f"recovered: {recovered_gain_margins[0]:.6f} < m < {recovered_gain_margins[1]:.6f}, J = {recovered_cost:.3f}")
