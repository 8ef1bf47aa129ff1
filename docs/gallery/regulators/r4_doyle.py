"""
Optimal, and fragile
====================

Doyle's plant (1978): the harder regulator and filter work, the smaller is the error of the plant's gain
that the loop survives. With the state known, half the gain and any larger one would be borne.
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import ContinuousModel, Cost, regulator
from ctlabs.regulation import margins

strengths = np.geomspace(1, 1e4, 25)
gains = []
for q in strengths:
    plant = ContinuousModel(
        F=[[1, 1], [0, 1]], B=[[0], [1]], G=[[1], [1]], Q=[[q]], H=[[1, 0]], Rc=[[1]], P0=np.eye(2))
    gains.append(margins(regulator(plant, Cost(q * np.ones((2, 2)), [[1]]))).inputs["u"].gain)

low, high = np.transpose(gains)
figure, axes = plt.subplots()
axes.fill_between(strengths, low, high, alpha=0.3, label="stable")
axes.axhline(1, color="0.5", ls=":")
axes.axhline(0.5, color="0.5", ls="--", label="borne with the state known")
axes.set(xscale="log", xlabel="weight of the states = strength of the noise", ylabel="gain of the plant / believed")
axes.legend()
plt.show()
