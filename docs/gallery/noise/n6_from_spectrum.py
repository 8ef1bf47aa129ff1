r"""
Noise from a spectrum
=====================

A rational spectrum is factored, and the stable factor drives white noise: the shaping filter has
the spectrum that was asked for.

.. math:: S(\omega) = \frac{\omega^2 + 9}{\omega^4 + 4\omega^2 + 16} = G(j\omega)\,G(-j\omega)
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import discretise, simulate
from ctlabs.models import shaping, spectra

wanted = spectra.parse("(w^2 + 9)/(w^4 + 4*w^2 + 16)")
block = spectra.shaping_filter(wanted)
runs = simulate(discretise(block, dt=0.05, R=[[0]]), steps=300, runs=12, seed=1)
omega, y = np.geomspace(0.1, 30, 300), np.einsum("n,knr->kr", block.H[0], runs.x)
sigma = np.sqrt(block.H @ shaping.stationary_covariance(block) @ block.H.T).item()

figure, (left, right) = plt.subplots(1, 2)
left.loglog(omega, (omega**2 + 9) / (omega**4 + 4 * omega**2 + 16), lw=5, alpha=0.4, label="asked for")
left.loglog(omega, shaping.psd(block, omega), label="shaping filter")
left.set(xlabel="ω, rad/s", ylabel="spectral density, unit²·s")
left.legend()
right.plot(runs.t, y, lw=0.8)
right.fill_between(runs.t, -2 * sigma, 2 * sigma, alpha=0.15)
right.set(xlabel="t, s", ylabel="y, samples inside ±2σ")
plt.show()
