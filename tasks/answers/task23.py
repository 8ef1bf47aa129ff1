"""The answers of lab 23 by hand: the second route, which owes nothing to the library."""

import math

import numpy as np
import scipy.integrate

#: The box by hand: (s + 4)/(2(s + 2)).
BOX = ((0.5, 2.0), (1.0, 2.0))


def analytic(p):
    """The sheet's answers, by hand."""
    gain, zero = optimum(p)
    discrete = discrete_limit(p)
    a, _b, apart, q1, q2 = sampled(p)
    gain_d = (a * apart * discrete + q1) / (apart**2 * discrete + q1 + q2)
    s2, n2 = p.signal_power / (2 * p.signal_pole), p.noise_power / (2 * p.noise_pole)
    return {
        "black_box_transfer_function": [list(BOX[0]), list(BOX[1])],
        "optimal_transfer_function": [[gain, gain * p.noise_pole], [1.0, zero]],
        "optimal_variance": optimal_variance(p),
        "black_box_variance": p.signal_power / (8 * (p.signal_pole + 2))
        + p.noise_power * (p.noise_pole + 8) / (8 * p.noise_pole * (p.noise_pole + 2)),
        "constant_gain_variance": s2 * n2 / (s2 + n2),
        "posterior_variance": variances(p, p.steps),
        "posterior_variance_steady": discrete,
        "gain_steady": gain_d,
        "filter_pole": a - apart * gain_d,
        "optimal_test_output_power": gain**2 * (1 + (p.noise_pole**2 - zero**2) / (zero * (zero + p.test_pole))),
        "black_box_test_output_power": 0.25 * (1 + 12 / (2 * (2 + p.test_pole))),
    }


def optimum(p):
    """g and c of the optimal filter g(s + b)/(s + c): c² from S_s + S_n = q(ω² + c²)/((ω² + a²)(ω² + b²))."""
    a, b, q = p.signal_pole, p.noise_pole, p.signal_power + p.noise_power
    c = math.sqrt((p.signal_power * b**2 + p.noise_power * a**2) / q)
    return p.signal_power * (a + b) / (q * (a + c)), c


def optimal_variance(p):
    """The positive root of (b−a)²P² + 2[a S_n + b S_s]P − S_s S_n = 0 (powers), written so that nothing cancels."""
    linear = 2 * (p.signal_pole * p.noise_power + p.noise_pole * p.signal_power)
    square = 4 * (p.noise_pole - p.signal_pole) ** 2 * p.signal_power * p.noise_power
    return 2 * p.signal_power * p.noise_power / (linear + math.sqrt(linear**2 + square))


def sampled(p):
    """a, b, a − b, q1, q2 of the discrete model, without cancellation."""
    a, b = math.exp(-p.signal_pole * p.dt), math.exp(-p.noise_pole * p.dt)
    apart = -a * math.expm1((p.signal_pole - p.noise_pole) * p.dt) if (p.noise_pole - p.signal_pole) * p.dt > -600 else -b
    q1 = -p.signal_power * math.expm1(-2 * p.signal_pole * p.dt) / (2 * p.signal_pole)
    return a, b, apart, q1, -p.noise_power * math.expm1(-2 * p.noise_pole * p.dt) / (2 * p.noise_pole)


def variances(p, steps):
    """p from t0: each step is a fraction linear in p above and below, so i steps are the i-th power of its matrix."""
    a, b, apart, q1, q2 = sampled(p)
    step = np.array([[a**2 * q2 + b**2 * q1, q1 * q2], [apart**2, q1 + q2]])
    step /= np.abs(np.linalg.eigvals(step)).max()
    s2, n2 = p.signal_power / (2 * p.signal_pole), p.noise_power / (2 * p.noise_pole)
    powers = [np.linalg.matrix_power(step, i) @ [s2 * n2 / (s2 + n2), 1.0] for i in range(steps + 1)]
    return [float(above / below) for above, below in powers]


def discrete_limit(p):
    """The positive root of (a−b)²p² + [q1(1−b²) + q2(1−a²)]p − q1q2 = 0."""
    _a, _b, apart, q1, q2 = sampled(p)
    linear = -q1 * math.expm1(-2 * p.noise_pole * p.dt) - q2 * math.expm1(-2 * p.signal_pole * p.dt)
    return 2 * q1 * q2 / (linear + math.sqrt(linear**2 + 4 * apart**2 * q1 * q2))


def white_variance(p, K):
    """The true variance of a filter with the gain K that takes n for white: e = (1−K)(a e − w1) + K n."""
    a, b, _apart, q1, _q2 = sampled(p)
    noise = p.noise_power / (2 * p.noise_pole)
    cross = K * noise / (1 - (1 - K) * a * b)
    return ((1 - K) ** 2 * q1 + K**2 * noise + 2 * K * (1 - K) * a * b * cross) / (1 - ((1 - K) * a) ** 2)


def quadrature(p, num, den):
    """The mean square error of a filter by numerical integration over the frequency."""
    a, b, scale = p.signal_pole, p.noise_pole, max(p.signal_pole, p.noise_pole)

    def density(u):
        w = scale * u / (1 - u)
        H = np.polyval(num, 1j * w) / np.polyval(den, 1j * w)
        S = abs(1 - H) ** 2 * p.signal_power / (w * w + a * a) + abs(H) ** 2 * p.noise_power / (w * w + b * b)
        return S * scale / (math.pi * (1 - u) ** 2)

    return scipy.integrate.quad(density, 0, 1, epsabs=1e-13 * (p.signal_power / a + p.noise_power / b), epsrel=1e-11, limit=400)[0]
