"""
A break is not noise
====================

A level that jumps once is not a level that wanders: the remedy is one event, not a larger Qd. The
diagnosis tells them apart and finds the row.
"""

import matplotlib.pyplot as plt

from ctlabs import DiscreteModel, diagnose, simulate, smooth

level = DiscreteModel(Phi=[[1]], Qd=[[1]], H=[[1]], R=[[25]], P0=[[100]], states=["level"], measurements=["z"])
z = simulate(level, steps=120, runs=1, seed=5).z[:, 0, 0]
z[70:] -= 25
found = diagnose(level, z)
print(found.suggestion)

figure, axes = plt.subplots()
axes.plot(z, ".", color="0.5")
axes.plot(smooth(level, z).x[1:, 0])
for event in found.events:
    axes.axvline(event.rows[0] - 0.5, color="C1", ls="--")
axes.set(xlabel="row", ylabel="z (line: the smoothed level)")
plt.show()
