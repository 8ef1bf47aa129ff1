"""
Is the filter consistent?
=========================

The normalised squares of the errors average n, if the filter is as wrong as it says. A filter that
believes its sensor too much shows itself at once.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from scipy.stats import chi2

from ctlabs import DiscreteModel, monte_carlo

truth = DiscreteModel(Phi=[[0.95]], Qd=[[1]], H=[[1]], R=[[4]], P0=[[10]])
runs = 500
low, high = chi2.ppf([0.025, 0.975], runs) / runs

figure, axes = plt.subplots()
for name, design in {"right": truth, "R half as large": replace(truth, R=[[2]])}.items():
    stats = monte_carlo(truth, design, steps=50, runs=runs, seed=1)
    axes.plot(np.arange(51), stats.nees, "o-", ms=3, label=name)
axes.axhspan(low, high, color="0.5", alpha=0.15)
axes.set(xlabel="k", ylabel="NEES, mean of 500 runs", ylim=(0.5, 2.2))
axes.legend()
plt.show()
