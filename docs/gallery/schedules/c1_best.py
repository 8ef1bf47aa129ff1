"""
Two map fixes in ten minutes
============================

A position drifts, and two fixes are allowed. The last instants give the least error at the end; if
the error must stay below a limit on the way, one of them has to come earlier.
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import DiscreteModel, kalman_filter
from ctlabs.analysis import scheduling

flight = DiscreteModel([[1]], [[900]], [[1]], [[900]], P0=[[900]])

figure, axes = plt.subplots()
for limit in (None, 75):
    plan = scheduling.best(flight, count=2, horizon=10, limit=limit)
    z = np.where(np.isin(np.arange(11), plan.instants), 0.0, np.nan)
    found = kalman_filter(flight, z, first=0)
    k = np.repeat(found.t, 2)
    sigma = np.sqrt(np.c_[found.P_minus[:, 0, 0], found.P_plus[:, 0, 0]]).ravel()
    axes.plot(k, sigma, label=f"limit {limit} m: fixes at {plan.instants}" if limit else f"no limit: fixes at {plan.instants}")
axes.axhline(75, color="0.6", ls=":")
axes.set(xlabel="minute", ylabel="σ of the position, m")
axes.legend()
plt.show()
