"""
What not knowing costs
======================

A motor is held in place against a random torque. Whoever knows its state pays the part below; the
rest is the price of a noisy sensor. The gain of the feedback is the same for all of them.
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import ContinuousModel, Cost, regulator

motor = ContinuousModel(
    F=[[0, 1], [0, -1]], B=[[0], [1]], G=[[0], [1]], Q=[[1]], H=[[1, 0]], P0=np.eye(2), measurements=["place"])
cost = Cost(outputs={"place": 1}, Qu=[[0.1]])
noises = np.geomspace(0.01, 1, 30)
found = [regulator(motor, cost, dt=0.1, R=[[sd**2]]).cost for sd in noises]

figure, axes = plt.subplots()
known = [each.regulation + each.between for each in found]
axes.stackplot(noises, known, [each.estimation for each in found], labels=["the state known", "estimated"], alpha=0.7)
axes.set(xscale="log", xlabel="σ of a measurement, rad", ylabel="cost per second", xlim=(noises[0], noises[-1]))
axes.legend(loc="upper left")
plt.show()
