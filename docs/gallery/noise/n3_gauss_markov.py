r"""
The Gauss–Markov process
========================

Bounded noise that forgets within its correlation time T: white below the corner 1/T, Brownian
motion above it.

.. math:: \dot y = -\frac1Ty + w, \qquad S(\omega) = \frac{2\sigma^2/T}{\omega^2+1/T^2}
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import discretise, simulate
from ctlabs.models import shaping

block = shaping.gauss_markov(variance=4.0, tau=2.0)
runs = simulate(discretise(block, dt=0.05, R=[[0]]), steps=400, runs=12, seed=1)
omega, sigma = np.geomspace(0.05, 50, 400), np.sqrt(shaping.stationary_covariance(block)[0, 0])

figure, (left, right) = plt.subplots(1, 2)
left.loglog(omega, shaping.psd(block, omega))
left.set(xlabel="ω, rad/s", ylabel="spectral density, unit²·s")
right.plot(runs.t, runs.x[:, 0], lw=0.8)
right.fill_between(runs.t, -2 * sigma, 2 * sigma, alpha=0.15)
right.set(xlabel="t, s", ylabel="y, samples inside ±2σ")
plt.show()
