"""
What a record tells of two constants
====================================

Maximum likelihood, with the profile of each constant. That of q is far from a parabola: its 95 %
interval is to be believed, its standard error is not.
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import DiscreteModel, fit

flow = [
    1120, 1160, 963, 1210, 1160, 1160, 813, 1230, 1370, 1140, 995, 935, 1110, 994, 1020, 960,
    1180, 799, 958, 1140, 1100, 1210, 1150, 1250, 1260, 1220, 1030, 1100, 774, 840, 874, 694,
    940, 833, 701, 916, 692, 1020, 1050, 969, 831, 726, 456, 824, 702, 1120, 1100, 832, 764,
    821,
]  # 10⁸ m³, 1871 to 1920


def model(c):
    return DiscreteModel(Phi=[[1]], Qd=[[c["q"]]], H=[[1]], R=[[c["r"]]], P0=[[np.inf]], first=0)


found = fit(model, flow, {"q": 1000.0, "r": 10000.0})

figure, panels = plt.subplots(1, 2, sharey=True)
for axes, name in zip(panels, ("q", "r"), strict=True):
    profile = found.profiles[name]
    axes.plot(profile.values, profile.log_likelihood - found.log_likelihood_diffuse)
    axes.axhline(-1.92, color="0.6", ls=":")
    axes.axvspan(*found.intervals[name], alpha=0.12)
    axes.plot(found.estimates[name], 0, "o")
    axes.set(xlabel=name, ylim=(-5, 0.5))
panels[0].set(ylabel="log-likelihood below its top")
plt.show()
