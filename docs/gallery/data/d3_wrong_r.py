"""
Which noise is too small?
=========================

Innovations that are too large may mean a small R or a small Qd; their correlation tells which. Two
wrong models of one record, and what is said of each.
"""

import matplotlib.pyplot as plt

from ctlabs import DiscreteModel, diagnose, simulate


def model(q, r):
    return DiscreteModel(Phi=[[0.98]], Qd=[[q]], H=[[1]], R=[[r]], P0=[[25]], states=["x"], measurements=["z"])


z = simulate(model(1, 4), steps=400, runs=1, seed=1).z[:, 0, 0]
cases = {"right": model(1, 4), "R/8": model(1, 0.5), "Qd/20": model(0.05, 4)}

figure, axes = plt.subplots()
for name, each in cases.items():
    found = diagnose(each, z)
    axes.plot(found.lags, found.autocorrelation[0], "o-", ms=3, label=f"{name}: {found.suggestion or found.verdict}")
axes.fill_between(found.lags, -found.band[0], found.band[0], color="0.5", alpha=0.15)
axes.set(xlabel="lag", ylabel="autocorrelation of the innovations")
axes.legend(fontsize=8)
plt.show()
