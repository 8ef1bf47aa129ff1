"""
One wrong value
===============

A typing error among fifty values makes the innovations as large as a wrong R would. The rows are
tried first: the outlier is named, with what the other rows suggest.
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import DiscreteModel, diagnose, kalman_filter

flow = [
    1120, 1160, 963, 1210, 1160, 1160, 813, 1230, 1370, 1140, 995, 935, 1110, 994, 1020, 960,
    1180, 799, 958, 1140, 1100, 1210, 1150, 1250, 1260, 1220, 1030, 1100, 774, 840, 874, 694,
    940, 833, 701, 916, 692, 1020, 1050, 969, 831, 726, 456, 824, 702, 1120, 1100, 832, 764,
    821,
]  # 10⁸ m³, 1871 to 1920
flow[20] = 11000  # a zero too many
level = DiscreteModel(Phi=[[1]], Qd=[[1469.1]], H=[[1]], R=[[15099]], P0=[[np.inf]], states=["level"], measurements=["flow"], first=0)
found = diagnose(level, flow)
print(found.verdict, [(event.kind, event.rows, round(event.sigmas)) for event in found.events])

figure, axes = plt.subplots()
for gate, name in ((None, "every value"), (5, "gate=5")):
    axes.plot(kalman_filter(level, flow, gate=gate).x_plus[:, 0], label=name)
axes.plot(flow, ".", color="0.5")
axes.set(xlabel="year after 1871", ylabel="level, 10⁸ m³", ylim=(400, 2600))
axes.legend()
plt.show()
