r"""
A tone of unknown phase
=======================

Amplitude and phase are random, the frequency is known, and nothing changes within a run: all power
is at one frequency.

.. math:: \ddot y + \omega_0^2y = 0, \qquad E[y(t+\tau)y(t)] = \sigma^2\cos\omega_0\tau
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import discretise, simulate
from ctlabs.models import shaping

block = shaping.oscillator(variance=4.0, frequency=2.0)
runs = simulate(discretise(block, dt=0.05, R=[[0]]), steps=200, runs=12, seed=1)
lag = np.linspace(0, 10, 300)

figure, (left, right) = plt.subplots(1, 2)
left.plot(lag, shaping.autocorrelation(block, lag))
left.set(xlabel="lag τ, s", ylabel="autocorrelation, unit²")
right.plot(runs.t, runs.x[:, 0], lw=0.8)
right.fill_between(runs.t, -4, 4, alpha=0.15)
right.set(xlabel="t, s", ylabel="y, samples inside ±2σ")
plt.show()
