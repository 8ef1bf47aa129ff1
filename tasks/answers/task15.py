"""The answers of lab 15 by hand: the second route, which owes nothing to the library."""

import math

import numpy as np


def analytic(p):
    """The sheet's answers, by hand."""
    a, b, apart, q1, q2 = sampled(p.w0, p.wn, p.dt, p.Q1, p.Q2)
    variance = variances(p.w0, p.wn, p.dt, p.Q1, p.Q2, p.Es2, p.En2, p.steps)
    limit = variance_limit(p.w0, p.wn, p.dt, p.Q1, p.Q2)
    gain = (a * apart * (limit or 0.0) + q1) / (apart**2 * (limit or 0.0) + q1 + q2)
    pole = a - apart * gain
    total = p.Es2 + p.En2
    return {
        "signal_variance": variance,
        "gain": [p.Es2 / total if total else 0.0]
        + [(a * apart * x + q1) / (apart**2 * x + q1 + q2) for x in variance[:-1]],
        "signal_variance_steady": limit,
        "gain_steady": gain,
        "filter_pole": pole,
        "filter_z_transfer_function": [[gain, -gain * b], [1.0, -pole]],
        "signal_variance_steady_equal_frequencies": p.Q1 * p.Q2 / (p.Q1 + p.Q2) / (2 * p.w0) if p.w0 else None,
    }


def sampled(w0, wn, dt, Q1, Q2):
    """a, b, a − b, q1, q2 of the discrete model, without cancellation."""
    a, b = math.exp(-w0 * dt), math.exp(-wn * dt)
    q = [Q * (-math.expm1(-2 * w * dt) / (2 * w) if w else dt) for w, Q in ((w0, Q1), (wn, Q2))]
    return a, b, -a * math.expm1((w0 - wn) * dt) if (wn - w0) * dt > -600 else -b, *q


def variances(w0, wn, dt, Q1, Q2, Es2, En2, steps):
    """p from t0: each step is a fraction linear in p above and below, so i steps are the i-th power of its matrix."""
    a, b, apart, q1, q2 = sampled(w0, wn, dt, Q1, Q2)
    step = np.array([[a**2 * q2 + b**2 * q1, q1 * q2], [apart**2, q1 + q2]])
    step /= np.abs(np.linalg.eigvals(step)).max()
    start = Es2 * En2 / (Es2 + En2) if Es2 + En2 else 0.0
    powers = [np.linalg.matrix_power(step, i) @ [start, 1.0] for i in range(steps + 1)]
    return [float(above / below) for above, below in powers]


def variance_limit(w0, wn, dt, Q1, Q2):
    """The positive root of (a−b)²p² + [q1(1−b²) + q2(1−a²)]p − q1q2 = 0; None where p does not settle."""
    _a, _b, apart, q1, q2 = sampled(w0, wn, dt, Q1, Q2)
    linear = -q1 * math.expm1(-2 * wn * dt) - q2 * math.expm1(-2 * w0 * dt)
    if not q1 * q2:
        return 0.0 if apart or linear else None
    below = linear + math.sqrt(linear**2 + 4 * apart**2 * q1 * q2)
    return 2 * q1 * q2 / below if below else None
