r"""
Brownian motion: the integral of white noise
============================================

It wanders without bounds: the variance grows like Qt, and the density Q/ω² has no limit at ω = 0.

.. math:: \dot y = w, \qquad \operatorname{var} y(t) = Qt, \qquad S(\omega) = \frac{Q}{\omega^2}
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import discretise, simulate
from ctlabs.models import shaping

Q = 0.5
block = shaping.random_walk(strength=Q)
runs = simulate(discretise(block, dt=0.1, R=[[0]]), steps=300, runs=20, seed=1)
omega, sigma = np.geomspace(0.1, 30, 200), np.sqrt(Q * runs.t)

figure, (left, right) = plt.subplots(1, 2)
left.loglog(omega, Q / omega**2)
left.set(xlabel="ω, rad/s", ylabel="spectral density, unit²·s")
right.plot(runs.t, runs.x[:, 0], lw=0.8)
right.fill_between(runs.t, -2 * sigma, 2 * sigma, alpha=0.15)
right.set(xlabel="t, s", ylabel="y, samples inside ±2σ")
plt.show()
