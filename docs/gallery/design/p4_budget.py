"""
Who contributes what
====================

The error of an estimate is a sum over its sources. At first the unknown start rules, in the end
disturbance and sensor share: which of them is worth money?
"""

import matplotlib.pyplot as plt

from ctlabs import ContinuousModel, discretise, error_budget

track = ContinuousModel(
    F=[[0, 1], [0, 0]], G=[[0], [1]], Q=[[0.05]], H=[[1, 0]], P0=[[100, 0], [0, 10]], states=["x", "v"], measurements=["position"])
budget = error_budget(discretise(track, dt=0.5, R=[[4]]), steps=30)

figure, axes = plt.subplots()
axes.stackplot(budget.t[1:], budget.parts[:, 1:, 0, 0], labels=budget.names, alpha=0.7)
axes.set(xlabel="t, s", ylabel="variance of the position, m²", ylim=(0, 5))
axes.legend()
plt.show()
