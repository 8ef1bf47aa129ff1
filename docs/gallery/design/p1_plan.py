"""
The accuracy before there are data
==================================

Which receiver must be bought? σ of position and velocity for three qualities of the measurement,
from the covariance recursion alone.
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import ContinuousModel, covariances, discretise

car = ContinuousModel(F=[[0, 1], [0, 0]], G=[[0], [1]], Q=[[0.5]], H=[[1, 0]], P0=[[2500, 0], [0, 100]])

figure, panels = plt.subplots(1, 2)
for sd in (1, 3, 10):
    plan = covariances(discretise(car, dt=1, R=[[sd**2]]), steps=25)
    for state, axes in enumerate(panels):
        axes.semilogy(plan.t, np.sqrt(plan.P_plus[:, state, state]), "o-", ms=3, label=f"{sd} m")
panels[0].set(xlabel="t, s", ylabel="σ of the position, m")
panels[1].set(xlabel="t, s", ylabel="σ of the velocity, m/s")
panels[0].legend(title="error of a position")
plt.show()
