"""
Claimed, true, best
===================

A filter with a wrong Qd claims one σ and has another. Too little process noise is dangerous: the
claim falls while the error rises. Too much is cheap.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import DiscreteModel, actual_errors, steady_state

truth = DiscreteModel(Phi=[[0.99]], Qd=[[0.1]], H=[[1]], R=[[1]], P0=[[1]])
factors = np.geomspace(1e-3, 1e3, 61)
found = [actual_errors(truth, replace(truth, Qd=truth.Qd * factor)) for factor in factors]

figure, axes = plt.subplots()
axes.semilogx(factors, [np.sqrt(each.claimed.P_plus[0, 0]) for each in found], "--", label="claimed")
axes.semilogx(factors, [np.sqrt(each.P_plus[0, 0]) for each in found], label="true")
axes.axhline(np.sqrt(steady_state(truth).P_plus[0, 0]), color="0.6", ls=":", label="best possible")
axes.set(xlabel="Qd of the filter / true Qd", ylabel="σ of the estimate")
axes.legend()
plt.show()
