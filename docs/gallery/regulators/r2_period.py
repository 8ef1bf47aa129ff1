"""
What slow sampling costs
========================

The input is held for a period, and in it noise moves the plant whatever the regulator does. The
cost is that of all times, not of the samples alone, so that periods can be compared.
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import ContinuousModel, Cost, regulator
from ctlabs.regulation import periods

motor = ContinuousModel(
    F=[[0, 1], [0, -1]], B=[[0], [1]], G=[[0], [1]], Q=[[1]], H=[[1, 0]], Rc=[[0.01]], P0=np.eye(2), measurements=["place"])
cost = Cost(outputs={"place": 1}, Qu=[[0.1]])
dt = np.linspace(0.02, 2, 60)
parts = [each.cost for each in periods(motor, cost, dt).members]

figure, axes = plt.subplots()
names = {"between": "between the samples", "regulation": "the state known", "estimation": "estimated"}
axes.stackplot(dt, [[getattr(each, name) for each in parts] for name in names], labels=list(names.values()), alpha=0.7)
axes.axhline(regulator(motor, cost).cost.value, color="k", ls=":", label="without sampling")
axes.set(xlabel="period, s", ylabel="cost per second", xlim=(dt[0], dt[-1]))
axes.legend(loc="upper left")
plt.show()
