"""
A load that nobody told of
==========================

A constant torque pushes the motor from t = 0 on. Feedback alone gives way; with the integral of the
place it does not, though nothing is known of the torque, and at the price of a larger swing.
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import ContinuousModel, Cost, regulator


def motor(torque: float) -> ContinuousModel:
    return ContinuousModel(
        F=[[0, 1, 0], [0, -1, 1], [0, 0, 0]], B=[[0], [1], [0]], G=[[0], [1], [0]], Q=[[0.1]], H=[[1, 0, 0]],
        x0=[0, 0, torque], P0=np.zeros((3, 3)), states=["place", "speed", "torque"], measurements=["place"])


believed = ContinuousModel(
    F=[[0, 1], [0, -1]], B=[[0], [1]], G=[[0], [1]], Q=[[0.1]], H=[[1, 0]], P0=np.eye(2), measurements=["place"])
cost = Cost(outputs={"place": 1}, Qu=[[0.1]])

figure, axes = plt.subplots()
for name, integral in {"feedback alone": None, "with the integral": {"place": 1}}.items():
    found = regulator(believed, cost, dt=0.1, R=[[0.01]], integral=integral)
    over = found.loop(motor(torque=1)).covariances(150)
    mean, sd = over.x.mean[:, 0], over.x.sd[:, 0]
    axes.plot(over.t, mean, label=name)
    axes.fill_between(over.t, mean - sd, mean + sd, alpha=0.2)
axes.set(xlabel="t, s", ylabel="place, rad: mean ± σ")
axes.legend()
plt.show()
