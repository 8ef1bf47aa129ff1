"""The answers of lab 22 by hand: the second route, which owes nothing to the library."""

import math

import numpy as np

#: The band of the settling time, as a fraction of the limit.
WITHIN = 0.01


def analytic(p):
    """The sheet's answers, by hand."""
    b, apart, q1, q2 = sampled(p.a, p.dt, p.Q1, p.Q2)
    discrete = discrete_limit(p.a, p.dt, p.Q1, p.Q2)
    gain = (apart * (discrete or 0.0) + q1) / (apart**2 * (discrete or 0.0) + q1 + q2)
    pole = 1 - apart * gain
    c1 = math.sqrt(p.Q1 / (p.Q1 + p.Q2))
    k = c1 if p.a else c1**2
    return {
        "c1": c1,
        "filter_transfer_function": [[k, k * p.a], [1.0, p.a * k]],
        "variance_steady_continuous": limit(p.a, p.Q1, p.Q2),
        "variance_after_first_measurement": first_variance(p.sigma1_2, p.sigma2_2),
        "posterior_variance": variances(p.a, p.dt, p.Q1, p.Q2, first_variance(p.sigma1_2, p.sigma2_2), p.steps),
        "posterior_variance_steady": discrete,
        "gain_steady": gain,
        "filter_pole": pole,
        "filter_z_transfer_function": [[gain, -gain * b], [1.0, -pole]],
        "settling_time": settling_time(p.a, p.Q1, p.Q2, first_variance(p.sigma1_2, p.sigma2_2)),
    }


def confused(p, found):
    """What a known confusion gives."""
    return {"c1_squared": found["c1"] ** 2}


def first_variance(x, y):
    """P(t0⁺): two independent quantities of which the sum is known."""
    return x * y / (x + y) if x + y else 0.0


def limit(a, Q1, Q2):
    """P∞ of part (a), the root of (aP + Q1)² = Q1(Q1+Q2), written so that nothing cancels; None for a = 0."""
    return Q2 * math.sqrt(Q1) / (math.sqrt(Q1 + Q2) + math.sqrt(Q1)) / a if a else None


def variance(a, Q1, Q2, start, t):
    """P(t) of part (a): P' = α − 2βP − γP² solved with τ = tanh(λt)/λ, λ = √(β² + αγ) = a c1."""
    alpha, beta, gamma = Q1 * Q2 / (Q1 + Q2), a * Q1 / (Q1 + Q2), a**2 / (Q1 + Q2)
    rate = a * math.sqrt(Q1 / (Q1 + Q2))
    tau = math.tanh(rate * t) / rate if rate else t
    return (start * (1 - beta * tau) + alpha * tau) / (1 + (beta + gamma * start) * tau)


def settling_time(a, Q1, Q2, start):
    """(P − P∞)/(P + [√(Q1(Q1+Q2)) + Q1]/a) decays like e^(−2λt); None where P∞ is 0 or infinite."""
    end = limit(a, Q1, Q2)
    if not end:
        return 0.0 if end == 0 and start == 0 else None
    other = math.sqrt(Q1) * (math.sqrt(Q1 + Q2) + math.sqrt(Q1)) / a
    ratio = (start - end) / (start + other)
    edge = math.copysign(WITHIN, ratio) * end / (end * (1 + math.copysign(WITHIN, ratio)) + other)
    return max(0.0, math.log(ratio / edge) / (2 * a * math.sqrt(Q1 / (Q1 + Q2)))) if ratio else 0.0


def sampled(a, dt, Q1, Q2):
    """b, 1 − b, q1, q2 of the discrete model."""
    return math.exp(-a * dt), -math.expm1(-a * dt), Q1 * dt, Q2 * (-math.expm1(-2 * a * dt) / (2 * a) if a else dt)


def variances(a, dt, Q1, Q2, start, steps):
    """p from t0: each step is a fraction linear in p above and below, so i steps are the i-th power of its matrix."""
    b, apart, q1, q2 = sampled(a, dt, Q1, Q2)
    step = np.array([[q2 + b**2 * q1, q1 * q2], [apart**2, q1 + q2]])
    step /= np.abs(np.linalg.eigvals(step)).max()
    powers = [np.linalg.matrix_power(step, i) @ [start, 1.0] for i in range(steps + 1)]
    return [float(above / below) for above, below in powers]


def discrete_limit(a, dt, Q1, Q2):
    """The positive root of (1−b)²p² + q1(1−b²)p − q1q2 = 0; None for a = 0."""
    _b, apart, q1, q2 = sampled(a, dt, Q1, Q2)
    if not a:
        return None
    if not q1 * q2:
        return 0.0
    linear = -q1 * math.expm1(-2 * a * dt)
    return 2 * q1 * q2 / (linear + math.sqrt(linear**2 + 4 * apart**2 * q1 * q2))


def white_variance(a, dt, Q1, Q2, K):
    """The true variance of a filter with the gain K that takes x2 for white noise: e = (1−K)(e − w1) + K x2."""
    b, _apart, q1, _q2 = sampled(a, dt, Q1, Q2)
    noise = Q2 / (2 * a)
    cross = K * noise / (1 - (1 - K) * b)
    return ((1 - K) ** 2 * q1 + K**2 * noise + 2 * K * (1 - K) * b * cross) / (K * (2 - K))
