"""
Histories that may have happened
================================

Smoothed estimates are smoother than any history. How low the level has ever been is a question to
whole histories, drawn given the record.
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import DiscreteModel, kalman_filter, smooth
from ctlabs.filtering import draws

flow = [
    1120, 1160, 963, 1210, 1160, 1160, 813, 1230, 1370, 1140, 995, 935, 1110, 994, 1020, 960,
    1180, 799, 958, 1140, 1100, 1210, 1150, 1250, 1260, 1220, 1030, 1100, 774, 840, 874, 694,
    940, 833, 701, 916, 692, 1020, 1050, 969, 831, 726, 456, 824, 702, 1120, 1100, 832, 764,
    821,
]  # 10⁸ m³, 1871 to 1920
level = DiscreteModel(Phi=[[1]], Qd=[[1469.1]], H=[[1]], R=[[15099]], P0=[[np.inf]], first=0)
filtered = kalman_filter(level, flow)
histories = draws(level, filtered, number=2000, seed=1)[:, 0]

figure, (left, right) = plt.subplots(1, 2, width_ratios=[3, 2])
left.plot(1871 + filtered.t, histories[:, :30], lw=0.6, color="0.6")
left.plot(1871 + filtered.t, smooth(level, filtered).x[:, 0])
left.set(ylabel="level, 10⁸ m³")
right.hist(histories.min(axis=0), bins=40)
right.axvline(smooth(level, filtered).x.min(), color="C1")
right.set(xlabel="lowest level of each history")
plt.show()
