"""
How long is it worth waiting?
=============================

A smoother with a fixed lag gives its estimate some steps late. Most of what the future tells is
there after a few settling times; waiting longer brings nothing.
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import ContinuousModel, discretise, simulate, smooth

track = ContinuousModel(F=[[0, 1], [0, 0]], G=[[0], [1]], Q=[[0.05]], H=[[1, 0]], P0=[[100, 0], [0, 10]])
model = discretise(track, dt=0.5, R=[[4]])
record = simulate(model, steps=120, runs=1, seed=1).z[..., 0]
lags = [0, 1, 2, 4, 6, 8, 12, 16, 24, 32]
sigma = np.sqrt([np.diag(smooth(model, record, lag=lag).P[60]) for lag in lags])

figure, axes = plt.subplots()
axes.plot(lags, sigma / sigma[0], "o-", label=["position", "velocity"])
axes.set(xlabel="lag, periods", ylabel="σ against that of the filter", ylim=(0, 1.05))
axes.legend()
plt.show()
