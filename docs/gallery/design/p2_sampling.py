"""
A bad sampling period
=====================

An oscillator sampled every half cycle shows one phase only, and its velocity is lost. The peak says
how near to the bad period one may come.
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import ContinuousModel, discretise, observability, steady_state

spring = ContinuousModel(F=[[0, 1], [-1, 0]], G=[[0], [1]], Q=[[0.1]], H=[[1, 0]], P0=[[1, 0], [0, 1]], states=["x", "v"])
periods = np.r_[np.linspace(0.3, 3.1, 60), np.linspace(3.18, 6.2, 60)]
sigma = np.sqrt([np.diag(steady_state(discretise(spring, dt, R=[[0.5]])).P_plus) for dt in periods])

figure, axes = plt.subplots()
axes.plot(periods, sigma, label=["position", "velocity"])
for period in observability(spring, dt=1.0).losing_periods:
    axes.axvline(period, color="0.6", ls=":")
axes.set(xlabel="sampling period, s", ylabel="steady σ")
axes.legend()
plt.show()
