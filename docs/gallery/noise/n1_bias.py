r"""
A bias: the random constant
===========================

An offset that nobody knows and that stays the same throughout a run: nothing drives it, and all its
power is at ω = 0.

.. math:: \dot y = 0, \qquad E[y(t+\tau)y(t)] = \sigma^2
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import discretise, simulate
from ctlabs.models import shaping

block = shaping.bias(variance=4.0)
runs = simulate(discretise(block, dt=0.1, R=[[0]]), steps=100, runs=20, seed=1)
lag = np.linspace(0, 10, 50)

figure, (left, right) = plt.subplots(1, 2)
left.plot(lag, shaping.autocorrelation(block, lag))
left.set(xlabel="lag τ, s", ylabel="autocorrelation, unit²", ylim=(0, 5))
right.plot(runs.t, runs.x[:, 0], lw=0.8)
right.fill_between(runs.t, -4, 4, alpha=0.15)
right.set(xlabel="t, s", ylabel="y, samples inside ±2σ")
plt.show()
