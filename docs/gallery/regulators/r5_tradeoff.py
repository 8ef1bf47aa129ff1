"""
Quiet or cheap
==============

Every weight of the input gives another regulator, and below their curve there is none. A better sensor
moves the whole curve; more effort only moves along it. The dots have one and the same weight.
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import ContinuousModel, Cost
from ctlabs.regulation import tradeoff

motor = ContinuousModel(
    F=[[0, 1], [0, -1]], B=[[0], [1]], G=[[0], [1]], Q=[[1]], H=[[1, 0]], P0=np.eye(2), measurements=["place"])
cost = Cost(outputs={"place": 1}, Qu=[[1]])

figure, axes = plt.subplots()
for sd in (0.5, 0.1, 0.02):
    curve = tradeoff(motor, cost, np.geomspace(1e-3, 10, 40), dt=0.1, R=[[sd**2]])
    axes.plot(curve.u_rms[:, 0], curve.x_rms[:, 0], label=f"{sd} rad")
    as_given = int(np.argmin(np.abs(np.log(curve.values))))
    axes.plot(curve.u_rms[as_given, 0], curve.x_rms[as_given, 0], "k.")
axes.set(xlabel="σ of the input", ylabel="σ of the place, rad", ylim=(0, None))
axes.legend(title="σ of a measurement")
plt.show()
