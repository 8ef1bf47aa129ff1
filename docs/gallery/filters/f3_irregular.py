"""
Measurements at any times
=========================

A continuous model is discretised exactly for each interval, so the times need no grid. The error
grows between measurements, and the forecast at the end is the same filter with nothing to update.
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import ContinuousModel, kalman_filter

track = ContinuousModel(F=[[0, 1], [0, 0]], G=[[0], [1]], Q=[[0.2]], H=[[1, 0]], P0=[[25, 0], [0, 4]])
t = np.array([0.4, 0.7, 1.9, 2.2, 2.3, 5.5, 5.9, 6.4, 9.0, 9.2])
z = np.array([1.2, 0.4, 2.6, 2.2, 3.9, 9.1, 8.4, 10.0, 15.1, 14.2])
grid = np.unique(np.r_[t, np.arange(0.1, 12, 0.1).round(1)])
seen = np.where(np.isin(grid, t), np.interp(grid, t, z), np.nan)
found = kalman_filter(track, seen, t=grid, R=[[1]])
x, sigma = found.x_plus[1:, 0], np.sqrt(found.P_plus[1:, 0, 0])

figure, axes = plt.subplots()
axes.plot(grid, x)
axes.fill_between(grid, x - 2 * sigma, x + 2 * sigma, alpha=0.15)
axes.plot(t, z, "k.")
axes.set(xlabel="t, s", ylabel="position, m")
plt.show()
