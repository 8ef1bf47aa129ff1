r"""
A pendulum that swings over
===========================

A nonlinear model goes through the same verbs by an extended filter. Measured is the horizontal
position of the bob, so near the top the sensor hardly sees the angle, and σ swells.

.. math:: \ddot\varphi = -9.81\sin\varphi + w, \qquad z = \sin\varphi + v
"""

import matplotlib.pyplot as plt
import numpy as np

from ctlabs import NonlinearModel, kalman_filter

dt = 0.02


def step(k, x, w):
    rate = x[1] - 9.81 * np.sin(x[0]) * dt + w[0]
    return np.stack([x[0] + rate * dt, rate])


model = NonlinearModel(
    f=step, h=lambda k, x, v: np.sin(x[:1]) + v, Qd=[[0.01]], R=[[0.01]], x0=[2.0, 0.0], P0=[[0.05, 0], [0, 0.05]], dt=dt)
random, x, truth, z = np.random.default_rng(2), np.array([2.1, 0.1]), [], []
for k in range(200):
    x = step(k, x[:, None], 0.1 * random.normal(size=(1, 1)))[:, 0]
    truth.append(x[0])
    z.append(np.sin(x[0]) + 0.1 * random.normal())
found = kalman_filter(model, z)
angle, sigma = found.x_plus[1:, 0], np.sqrt(found.P_plus[1:, 0, 0])

figure, axes = plt.subplots()
axes.plot(found.t[1:], truth, "k", found.t[1:], angle, "C0")
axes.fill_between(found.t[1:], angle - 2 * sigma, angle + 2 * sigma, alpha=0.2)
axes.plot(found.t[1:], z, ".", ms=2, color="0.6")
axes.set(xlabel="t, s", ylabel="angle, rad (grey: sin φ as measured)")
plt.show()
