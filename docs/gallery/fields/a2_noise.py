"""
How good must the sensors of a field be?
========================================

The claimed standard deviation at each node, for three sensors. The boundary is known least, since
the neighbours on one side are missing.
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs.filtering import fields

field = fields.RandomField(alpha=0.1, beta=0.1, b20=0.25, b11=1.0, h=1.0, dt=0.2, N1=30, sigma_eta=3.0)
truth = field.simulate(steps=150, seed=1)

figure, axes = plt.subplots()
for sigma_n in (0.3, 1.0, 3.0):
    found = fields.filter_exact(field, fields.measure(truth, sigma_n=sigma_n, seed=2)[1:], sigma_n=sigma_n)
    axes.plot(np.arange(field.nodes), np.sqrt(found.variance[-1]) / sigma_n, "o-", ms=3, label=f"{sigma_n:g}")
axes.set(xlabel="node", ylabel="σ of the estimate / σ of a sensor", ylim=(0, 1))
axes.legend(title="σ of a sensor")
plt.show()
