"""
A random field, and its filter
==============================

A field on a line, driven by noise in space and time, measured at every node with an error of 1
unit. The filter knows the equation of the field, and sees through the noise.
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs.filtering import fields

field = fields.RandomField(alpha=0.1, beta=0.1, b20=0.25, b11=1.0, h=1.0, dt=0.2, N1=30, sigma_eta=3.0)
truth = field.simulate(steps=150, seed=1)
measured = fields.measure(truth, sigma_n=1.0, seed=2)
estimate = fields.filter_exact(field, measured[1:], sigma_n=1.0).z_hat

figure, panels = plt.subplots(1, 3, sharey=True)
for axes, values, name in zip(panels, (truth, measured, estimate), ("truth", "measured", "filtered"), strict=True):
    axes.imshow(values, origin="lower", aspect="auto", extent=(0, 30, 0, 30), cmap="RdBu", vmin=-4, vmax=4)
    error = np.sqrt(np.nanmean((values - truth) ** 2))
    axes.set(xlabel="x, m", title=name if not error else f"{name}, RMS error {error:.2f}")
    axes.grid(visible=False)
panels[0].set(ylabel="t, s")
plt.show()
