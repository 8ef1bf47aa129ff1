"""Lab 5: the motion in a plane, and the covariance of the pseudo-measurements at a place."""

import math
from dataclasses import replace

import numpy as np
from ctlabs.tasks.answers import task05 as by_hand

from ctlabs.models import ContinuousModel
from ctlabs.models.discretisation import discretise

STATES, UNITS = ("x", "v_x", "y", "v_y"), ("m", "m/s", "m", "m/s")
#: The states as a reader sees them.
LETTERS = ("$x$", "$v_x$", "$y$", "$v_y$")
STEP = "measurement number i"
#: Measurements simulated at a changing geometry, fewer where the point would wander far.
SIMULATED = 20


def system(p, R=None):
    """The discrete model at fixed geometry; the index of a measurement is its time."""
    R = covariance(p, *start(p)) if R is None else R
    return replace(discretise(continuous(p), p.tau, R), dt=1.0)


def start(p):
    """Position at t0."""
    return p.D * math.cos(p.theta), p.D * math.sin(p.theta)


def covariance(p, x, y):
    """R at one position (2, 2), or at several (…, 2, 2)."""
    R11, R22, R12, *_rest = pseudo(p, np.asarray(x, dtype=float), np.asarray(y, dtype=float))
    return np.moveaxis(np.array([[R11, R12], [R12, R22]]), (0, 1), (-2, -1))


def continuous(p):
    """Two independent Wiener velocities."""
    position, velocity = by_hand.spread(p)
    return ContinuousModel(
        F=np.kron(np.eye(2), [[0, 1], [0, 0]]), G=np.kron(np.eye(2), [[0], [1]]), Q=p.sigma_w2 * np.eye(2), H=np.kron(np.eye(2), [[1, 0]]),
        x0=[start(p)[0], 0, start(p)[1], 0], P0=np.diag([position, velocity] * 2), states=STATES, measurements=["z_x", "z_y"], units=UNITS,
    )


def variants(p, R=None):
    """The truth, which is what variant 2 believes, and the design of variant 1."""
    truth = system(p, R)
    return truth, replace(truth, R=truth.R * np.eye(2))


def pseudo(p, x, y):
    """R11, R22, R12, l21, d2 at the position (x, y), which may be arrays: J diag(σ_D², σ_θ²) Jᵀ with J = [[x/D, −y], [y/D, x]]."""
    D = np.hypot(x, y)
    c, s = np.divide(x, D, out=np.ones_like(D), where=D > 0), np.divide(y, D, out=np.zeros_like(D), where=D > 0)
    a, b = p.sigma_D**2, p.sigma_theta**2
    R11, R22, R12 = c**2 * a + y**2 * b, s**2 * a + x**2 * b, c * s * a - x * y * b
    return R11, R22, R12, R12 / R11, a * b * D**2 / R11


def length(p):
    """Measurements at a changing geometry: until the point's own wandering reaches a quarter of D, at most SIMULATED."""
    position, velocity = by_hand.spread(p)
    t = p.tau * np.arange(1, SIMULATED + 1)
    return max(2, int((np.sqrt(position + velocity * t**2 + p.sigma_w2 * t**3 / 3) <= p.D / 4).sum()))
