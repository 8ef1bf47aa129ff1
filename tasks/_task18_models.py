"""Lab 18: the orbit as a linear and as a nonlinear model."""

from dataclasses import replace
from functools import cache

import numpy as np
import sympy
from ctlabs.tasks import _task18_scales as scales
from ctlabs.tasks._task18_scales import STATES, UNITS
from ctlabs.tasks.answers import task18 as by_hand

from ctlabs.models import DiscreteModel, linearisation
from ctlabs.models.discretisation import discretise
from ctlabs.models.nonlinear import NonlinearModel

#: Bounds of the deviations that an extended filter moves, in natural units; it may take any angle.
LOWEST, HIGHEST = np.array([-0.7, -2, -np.inf, -0.9]), np.array([3, 2, np.inf, 2])


@cache
def equations():
    """The sheet's equations for sympy, and the circular orbit as a trajectory in t."""
    r, speed, angle, turn, u_r, u_tau = sympy.symbols("r rdot Theta Thetadot u_r u_tau", real=True)
    G, r0, w, t = sympy.symbols("G r_0 w t", positive=True)
    dynamics = linearisation.Dynamics([speed, r * turn**2 - G / r**2 + u_r, turn, -2 * turn * speed / r + u_tau / r], [r, speed, angle, turn], [u_r, u_tau])
    circle = dynamics.at({r: r0, speed: 0, angle: w * t, turn: w, u_r: 0, u_tau: 0, G: r0**3 * w**2}, t)
    return dynamics, circle


def measured(p, rows=(0, 1)):
    """The linear model of the deviations with some of the measurements."""
    return linearisation.model(equations()[1], {"r_0": p.r0, "w": by_hand.rate(p)}, H=scales.seeing(rows), P0=p.P0, states=STATES, units=UNITS, measurements=[("z1", "z2")[row] for row in rows])


def designed(p, rows):
    """The linear model with both measurements, those not in the set marked as absent."""
    return discretise(replace(measured(p), B=None), p.dt, R=np.diag([scales.noise(p)[i, i] if i in rows else np.inf for i in (0, 1)]))


def nonlinear(p, flow, rows=(0, 1), *, bounded=False):
    """The nonlinear motion in deviations from the circular orbit, as a truth and (bounded) as the model of an extended filter.

    A filter far astray may put the satellite into the centre, where nothing is finite; bounds keep its deviations away from there.
    """
    circle, turned = np.array([[p.r0], [0], [0], [by_hand.rate(p)]]), np.array([[p.r0], [0], [by_hand.rate(p) * p.dt], [by_hand.rate(p)]])
    low, high = ((edge * by_hand.units(p))[:, None] for edge in ((LOWEST, HIGHEST) if bounded else (np.full(4, -np.inf), np.full(4, np.inf))))
    return NonlinearModel(
        f=lambda _k, x, _w: flow.f(circle + np.clip(x, low, high)) - turned, h=lambda _k, x, v: x[[2, 0]] + v,
        F=lambda _k, x: flow.F(circle + np.clip(x, low, high)), H=lambda _k, _x: scales.seeing((0, 1)),
        Qd=[[0.0]], R=np.diag([scales.noise(p)[i, i] if i in rows else np.inf for i in (0, 1)]), x0=np.zeros(4), P0=p.P0, dt=p.dt, states=STATES,
    )


def in_natural_units(p, rows):
    """The sampled model with the states in units of r0, r0 w, 1 rad, w."""
    system, s = discretise(measured(p, rows), p.dt, R=scales.noise(p, rows)), by_hand.units(p)
    m = np.array([(1.0, p.r0)[row] for row in rows])
    return DiscreteModel(system.Phi * s / s[:, None], np.zeros((4, 4)), system.H * s / m[:, None], system.R / np.outer(m, m), x0=system.x0, P0=system.P0 / np.outer(s, s), dt=p.dt)
