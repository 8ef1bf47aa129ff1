"""
All schedules, and the price of a limit
=======================================

Every choice of three instants out of twelve: its error at the end, against the worst one on the
way. The lower left edge is what may be bargained for.
"""

import matplotlib.pyplot as plt

from ctlabs import DiscreteModel
from ctlabs.analysis import scheduling

flight = DiscreteModel([[1]], [[900]], [[1]], [[900]], P0=[[900]])
every = scheduling.exhaustive(flight, count=3, horizon=12)
limits = range(62, 110, 2)
plans = [scheduling.best(flight, count=3, horizon=12, limit=limit) for limit in limits]

figure, axes = plt.subplots()
axes.plot(every.worst, every.rms, ".", color="0.7", label="every schedule")
axes.plot(limits, [plan.rms for plan in plans], "-", drawstyle="steps-post", label="the best within a limit")
axes.set(xlabel="largest σ on the way, m", ylabel="σ at the end, m")
axes.legend()
plt.show()
