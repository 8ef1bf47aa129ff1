"""
The Nile, filtered and smoothed
===============================

An estimate of the filter knows the past, one of the smoother the whole record: it is closer, and it
does not lag behind the fall of 1899.
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import DiscreteModel, kalman_filter, smooth

flow = [
    1120, 1160, 963, 1210, 1160, 1160, 813, 1230, 1370, 1140, 995, 935, 1110, 994, 1020, 960,
    1180, 799, 958, 1140, 1100, 1210, 1150, 1250, 1260, 1220, 1030, 1100, 774, 840, 874, 694,
    940, 833, 701, 916, 692, 1020, 1050, 969, 831, 726, 456, 824, 702, 1120, 1100, 832, 764,
    821,
]  # 10⁸ m³, 1871 to 1920
level = DiscreteModel(Phi=[[1]], Qd=[[1469.1]], H=[[1]], R=[[15099]], P0=[[np.inf]], states=["level"], first=0)
filtered = kalman_filter(level, flow)
smoothed = smooth(level, filtered)
year, sigma = 1871 + filtered.t, np.sqrt(smoothed.P[:, 0, 0])

figure, axes = plt.subplots()
axes.plot(year, flow, ".", color="0.5")
axes.plot(year, filtered.x_plus[:, 0], "--", label="filter")
axes.plot(year, smoothed.x[:, 0], label="smoother ± 2σ")
axes.fill_between(year, smoothed.x[:, 0] - 2 * sigma, smoothed.x[:, 0] + 2 * sigma, alpha=0.15, color="C1")
axes.set(ylabel="flow, 10⁸ m³")
axes.legend()
plt.show()
