r"""
Which form survives rounding?
=============================

Bierman's example: two sensors that differ by δ and are as precise as δ. All forms are the same
filter on paper; with 16 digits, those which carry P lose twice as many digits as those which carry
a root of it.
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import DiscreteModel
from ctlabs.filtering import compare

names = ["conventional", "joseph", "information", "array", "ud"]
deltas = np.geomspace(1e-10, 1e-2, 17)
errors = {name: [] for name in names}
for delta in deltas:
    H = [[1, 1, 1], [1, 1, 1 + delta]]
    model = DiscreteModel(np.eye(3), np.zeros((3, 3)), H, R=delta**2 * np.eye(2), P0=np.eye(3))
    for found in compare(model, [[0.5, 0.5 + 0.5 * delta]], names):
        errors[found.name].append(np.nan if found.failed else max(found.error_P, 1e-17))

figure, axes = plt.subplots()
for name in names:
    axes.loglog(deltas, errors[name], "o-", ms=3, label=name)
axes.axhline(1, color="0.6", ls=":")
axes.set(xlabel="δ", ylabel="relative error of P, against 50 digits")
axes.legend(ncols=2)
plt.show()
