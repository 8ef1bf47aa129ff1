"""
Beginning with nothing
======================

``inf`` in P0 is exact: two positions determine the velocity, and before that its variance is
infinite. A guess with a small P0 that is wrong is remembered for a long time.
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import DiscreteModel, kalman_filter, simulate

start = {"unknown": np.diag([np.inf, np.inf]), "thought to be known": np.diag([1.0, 0.01])}
truth = DiscreteModel([[1, 1], [0, 1]], [[0.01, 0], [0, 0.01]], [[1, 0]], [[4]], x0=[20, 2], P0=np.zeros((2, 2)))
record = simulate(truth, steps=30, runs=1, seed=4)

figure, axes = plt.subplots()
for name, P0 in start.items():
    model = DiscreteModel(truth.Phi, truth.Qd, truth.H, truth.R, x0=[0, 0], P0=P0)
    found = kalman_filter(model, record.z[..., 0])
    line = axes.errorbar(found.t, found.x_plus[:, 1], 2 * np.sqrt(found.P_plus[:, 1, 1]), fmt="o-", ms=3, lw=1, label=name)
axes.plot(record.t, record.x[:, 1, 0], "k", label="truth")
axes.set(xlabel="k", ylabel="velocity ± 2σ", ylim=(-2, 6))
axes.legend()
plt.show()
