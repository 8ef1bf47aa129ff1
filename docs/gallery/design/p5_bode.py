"""
A filter is a filter
====================

In the steady state the Kalman–Bucy filter has a transfer function: a low-pass from the measurement
to the position, whose bandwidth grows with the ratio of disturbance to noise.
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import ContinuousModel
from ctlabs.filtering import bucy

omega = np.geomspace(0.01, 100, 300)

figure, axes = plt.subplots()
for q in (0.01, 1, 100):
    track = ContinuousModel(F=[[0, 1], [0, 0]], G=[[0], [1]], Q=[[q]], H=[[1, 0]], Rc=[[1]], P0=[[1, 0], [0, 1]])
    num, den = bucy.transfer_function(track)
    axes.loglog(omega, np.abs(np.polyval(num, 1j * omega) / np.polyval(den, 1j * omega)), label=f"Q/Rc = {q:g}")
axes.set(xlabel="ω, rad/s", ylabel="|x̂/z|")
axes.legend()
plt.show()
