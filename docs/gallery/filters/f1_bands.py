r"""
Errors inside their bands
=========================

The bands come from the covariance recursion, before a number is drawn. Nineteen of twenty errors
must lie inside ±2σ.

.. math:: P^+ = (I - KH)P^-(I - KH)^T + KRK^T
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import DiscreteModel, covariances, kalman_filter, simulate

model = DiscreteModel(Phi=[[0.95]], Qd=[[0.2]], H=[[1]], R=[[1]], P0=[[9]])
truth = simulate(model, steps=40, runs=25, seed=1)
error = kalman_filter(model, truth.z).x_plus[:, 0] - truth.x[:, 0]
sigma = np.sqrt(covariances(model, steps=40).P_plus[:, 0, 0])

figure, axes = plt.subplots()
axes.plot(truth.t, error, lw=0.7, color="0.5")
axes.fill_between(truth.t, -2 * sigma, 2 * sigma, alpha=0.15)
axes.plot(truth.t, np.c_[sigma, -sigma], color="C0")
axes.set(xlabel="k", ylabel="error x̂ − x of 25 runs")
plt.show()
