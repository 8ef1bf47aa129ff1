"""
The years after the record
==========================

A forecast is the filter with nothing to update. The band of the level grows; that of what will be
measured has the noise of a year in it, too.
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import DiscreteModel, forecast, kalman_filter

flow = [
    1120, 1160, 963, 1210, 1160, 1160, 813, 1230, 1370, 1140, 995, 935, 1110, 994, 1020, 960,
    1180, 799, 958, 1140, 1100, 1210, 1150, 1250, 1260, 1220, 1030, 1100, 774, 840, 874, 694,
    940, 833, 701, 916, 692, 1020, 1050, 969, 831, 726, 456, 824, 702, 1120, 1100, 832, 764,
    821,
]  # 10⁸ m³, 1871 to 1920
level = DiscreteModel(Phi=[[1]], Qd=[[1469.1]], H=[[1]], R=[[15099]], P0=[[np.inf]], first=0)
filtered = kalman_filter(level, flow)
ahead = forecast(level, filtered, steps=15)
year = 1871 + len(flow) + np.arange(15)

figure, axes = plt.subplots()
axes.plot(1871 + filtered.t, flow, ".", color="0.5")
axes.plot(1871 + filtered.t, filtered.x_plus[:, 0])
for variance, alpha in ((ahead.P, 0.3), (ahead.S, 0.12)):
    band = 2 * np.sqrt(variance[-15:, 0, 0])
    axes.fill_between(year, ahead.z[:, 0] - band, ahead.z[:, 0] + band, alpha=alpha, color="C0")
axes.set(ylabel="flow, 10⁸ m³")
plt.show()
