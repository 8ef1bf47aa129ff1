"""The answers of lab 21 by hand: the second route, which owes nothing to the library."""

import math

import numpy as np
import scipy.integrate

#: Times at which the variances are given, s.
TIMES = (0.5, 1.0, 2.0, 4.0)


def analytic(p):
    """The sheet's answers, by hand."""
    when = (1.5 * p.R / p.P0) ** (1 / 3) if p.P0 else None
    return {
        "variance_continuous": [variance(p.R, p.P0, t) for t in TIMES],
        "gain_continuous": [variance(p.R, p.P0, t) * t / p.R for t in TIMES],
        "gain_maximum": 2 * p.P0 * when / (3 * p.R) if when else 0.0,
        "gain_maximum_time": when,
        "posterior_variance": [sampled_variance(p.R, p.P0, p.dt, last(t, p.dt)) for t in TIMES],
    }


def confused(p, found):
    """What a known confusion gives: H = t left out of the gain."""
    return {"gain_without_t": [P / p.R for P in found["variance_continuous"]]}


def variance(R, P0, t):
    """P(t) of part (a)."""
    return P0 / (1 + P0 * t**3 / (3 * R))


def sampled_variance(R, P0, dt, k):
    """P_k of part (b)."""
    return P0 / (1 + P0 * dt**3 * k * (k + 1) * (2 * k + 1) / (6 * R))


def added_variance(R, P0, dt, k):
    """The same by adding the information of the measurements one by one."""
    return P0 / (1 + P0 * float(np.sum(np.arange(1, k + 1) ** 2.0)) * dt**3 / R)


def last(t, dt):
    """The number of the last measurement not later than t."""
    return math.floor(t / dt * (1 + 1e-12))


def response(R, P0, t):
    """∫₀ᵗ |ψ(t,τ)K(τ)| dτ by quadrature, ψ(t,τ) = e^(−∫K h) with the exponent by quadrature too."""

    def exponent(tau):
        return scipy.integrate.quad(lambda s: P0 * s**2 / (R + P0 * s**3 / 3), tau, t, epsabs=1e-13)[0]

    return scipy.integrate.quad(lambda s: math.exp(-exponent(s)) * P0 * s / (R + P0 * s**3 / 3), 0, t, epsabs=0)[0]


def drift(R, P0, t):
    """∫₀ᵗ ψ(t,τ) dτ likewise: what a disturbance 1 of ȧ leaves in the error."""
    return scipy.integrate.quad(lambda s: (3 * R + P0 * s**3) / (3 * R + P0 * t**3), 0, t, epsabs=0)[0]


def halving(R, P0, s):
    """How long after s an error is halved without noise: ψ(s + T, s) = ½."""
    c = 3 * R / P0
    # (2s³ + c)^⅓ − s as a quotient, in which nothing cancels for large s
    root = (2 * s**3 + c) ** (1 / 3)
    return (s**3 + c) / (root**2 + root * s + s**2)


def batch(z, t, R, P0, dt):
    """The estimate after the last of the measurements by least squares, all at once."""
    t = np.asarray(t)
    return float(P0 * (t @ z) * dt / (R + P0 * (t @ t) * dt))
