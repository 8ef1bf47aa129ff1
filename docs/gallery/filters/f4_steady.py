"""
What a constant gain costs
==========================

The steady gain is all that a small controller needs. It is worse at the beginning only, where the
optimal gain is large.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import ContinuousModel, actual_errors, covariances, discretise, steady_state

track = ContinuousModel(F=[[0, 1], [0, 0]], G=[[0], [1]], Q=[[0.01]], H=[[1, 0]], P0=[[100, 0], [0, 10]])
model = discretise(track, dt=0.5, R=[[4]])
optimal = covariances(model, steps=60)
steady = replace(optimal, K=np.broadcast_to(steady_state(model).K, optimal.K.shape))
constant = actual_errors(model, model, steps=60, gains=steady)

figure, axes = plt.subplots()
axes.semilogy(optimal.t, np.sqrt(optimal.P_plus[:, 0, 0]), label="optimal gains")
axes.semilogy(optimal.t, np.sqrt(constant.P_plus[:, 0, 0]), "--", label="the steady gain throughout")
axes.set(xlabel="t, s", ylabel="σ of the position, m")
axes.legend()
plt.show()
