r"""
Noise around a resonance
========================

A damped oscillator driven by white noise: gusts, waves, the shaking of a mount. ζ says how sharp
the peak is.

.. math:: \ddot y + 2\zeta\omega_0\dot y + \omega_0^2y = w, \qquad
          S(\omega) = \frac{4\zeta\omega_0^3\sigma^2}{(\omega_0^2-\omega^2)^2 + 4\zeta^2\omega_0^2\omega^2}
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import discretise, simulate
from ctlabs.models import shaping

block = shaping.second_order(variance=4.0, natural_frequency=3.0, damping=0.1)
runs = simulate(discretise(block, dt=0.05, R=[[0]]), steps=400, runs=12, seed=1)
omega, sigma = np.geomspace(0.05, 50, 400), np.sqrt(shaping.stationary_covariance(block)[0, 0])

figure, (left, right) = plt.subplots(1, 2)
left.loglog(omega, shaping.psd(block, omega))
left.set(xlabel="ω, rad/s", ylabel="spectral density, unit²·s")
right.plot(runs.t, runs.x[:, 0], lw=0.8)
right.fill_between(runs.t, -2 * sigma, 2 * sigma, alpha=0.15)
right.set(xlabel="t, s", ylabel="y, samples inside ±2σ")
plt.show()
