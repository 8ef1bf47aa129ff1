"""The answers of lab 12 by hand: the second route, which owes nothing to the library."""

import math
from itertools import pairwise

import numpy as np


def analytic(p):
    """The sheet's answers, by hand."""
    x, P = p.Phi * p.x_posterior + p.b, p.Phi**2 * p.P_posterior + p.Q
    h2, R2 = math.sin(p.t), math.cos(p.t) ** 2
    if abs(math.cos(p.t)) <= 1e-15 * max(1.0, abs(p.t)):
        R2 = 0.0
    first = [x + 2 * P * (p.z1 - 2 * x) / (1 + 4 * P), P / (1 + 4 * P)]
    linear = both(x, P, h2, p.z1 - 2 * x, p.z2 - h2 * x, R2, 0.0)
    extended = both(x, P, math.cos(x), p.z1 - 2 * x, p.z2 - math.sin(x), R2, 0.0)
    slope = math.cos(first[0])
    s = slope**2 * first[1] + R2
    again = [first[0] + first[1] * slope * (p.z2 - math.sin(first[0])) / s, first[1] * R2 / s] if s else first
    possible = p.R12**2 <= R2 * (1 + 1e-12)
    correlated = both(x, P, h2, p.z1 - 2 * x, p.z2 - h2 * x, R2, p.R12) if possible else None
    return {
        "prior": [x, P], "after_z1": first, "linear_sequential": linear, "linear_joint": linear,
        "ekf_joint": extended, "ekf_sequential_fixed": extended, "ekf_sequential_relinearised": again,
        "exact_posterior": exact_by_hand(*first, p.z2, R2), "correlated_joint": correlated,
        "correlated_sequential_naive": linear if possible else None, "correlated_sequential_decorrelated": correlated,
        "naive_actual_variance": actual_by_hand(P, h2, R2, p.R12) if possible else None,
    }


def confused(p, found):
    """What known confusions give."""
    x, P = found["prior"]
    return {"prior_without_b": [x - p.b, P], "naive_claimed": found["linear_joint"][1]}


def both(x, P, h2, nu1, nu2, R2, R12):
    """Estimate and variance by Cramer's rule for the 2×2 system; h1 = 2, R1 = 1."""
    det = R2 - R12**2
    det = 0.0 if det <= 1e-12 * R2 else det
    below = det + P * (4 * R2 - 4 * h2 * R12 + h2**2)
    if below <= 1e-15 * (R2 + P * (4 * R2 + h2**2)):  # the second element is known already
        return [x + 2 * P * nu1 / (1 + 4 * P), P / (1 + 4 * P)]
    return [x + P * ((2 * R2 - h2 * R12) * nu1 + (h2 - 2 * R12) * nu2) / below, P * det / below]


def gains(P, h2, R2):
    """Gains of z1 and z2 for independent noises."""
    below = R2 + P * (4 * R2 + h2**2)
    return (2 * P * R2 / below, P * h2 / below) if below else (0.0, 0.0)


def actual_by_hand(P, h2, R2, R12):
    """The true variance of a filter that neglects R12: (1 − KH)²P + KRKᵀ."""
    K1, K2 = gains(P, h2, R2)
    return (1 - 2 * K1 - h2 * K2) ** 2 * P + K1**2 + 2 * K1 * K2 * R12 + K2**2 * R2


def exact_by_hand(m, P, z2, R2):
    """Mean and variance of N(x; m, P)·N(z2; sin x, R2) by the double exponential rule between the roots of sin x = z2.

    Near a root r the difference sin x − sin r = 2 cos(r + δ/2) sin(δ/2) keeps its digits, so that R2 → 0 is no trouble.
    """
    if P == 0:
        return [m, 0.0]
    R2, angle = max(R2, 1e-30), math.asin(max(-1.0, min(1.0, z2)))
    beyond = z2 - max(-1.0, min(1.0, z2))
    reach = 12 * math.sqrt(P) + 2 * math.pi
    k = np.arange(math.floor((m - reach) / (2 * math.pi)) - 1, math.ceil((m + reach) / (2 * math.pi)) + 2)
    roots = np.unique(np.concatenate([angle + 2 * math.pi * k, math.pi - angle + 2 * math.pi * k]))
    roots = roots[np.concatenate([[True], np.diff(roots) > 1e-9])]
    t = np.arange(-5.5, 5.5, 1 / 256)
    s, r = 1 / (1 + np.exp(-math.pi * np.sinh(t))), 1 / (1 + np.exp(math.pi * np.sinh(t)))
    logs, weights, points = [], [], []
    for left, right in pairwise(roots):
        middle = [left, m, right] if left < m < right else [left, right]
        for a, b in pairwise(middle):
            x = np.where(s < 0.5, a + (b - a) * s, b - (b - a) * r)
            near = np.where(x - left < right - x, left, right)
            delta = np.where((s < 0.5) & (near == a), (b - a) * s, np.where((s >= 0.5) & (near == b), -(b - a) * r, x - near))
            rest = -2 * np.cos(near + delta / 2) * np.sin(delta / 2)  # sin r − sin x, and z2 − sin x = rest + beyond
            logs.append(-0.5 * (x - m) ** 2 / P - 0.5 * rest * (rest + 2 * beyond) / R2)
            weights.append((b - a) * np.cosh(t) * s * r)
            points.append(x)
    logs, weights, x = np.concatenate(logs), np.concatenate(weights), np.concatenate(points)
    density = weights * np.exp(logs - logs.max())
    density /= density.sum()
    mean = density @ x
    return [float(mean), float(density @ (x - mean) ** 2)]


def lagged(p, P, R2, h2, steps):
    """True variances of the filter that believes in independence when v2(t_i) is v1(t_{i−1}), scaled; P⁻ at t1 is given."""
    variance, cross, scale = P, 0.0, math.sqrt(R2)  # cross = E[e⁺ v1] one step before
    claimed, found = P, []
    for _i in range(steps):
        K1, K2 = gains(claimed, h2, R2)
        left = 1 - 2 * K1 - h2 * K2
        variance = left**2 * variance + K1**2 + K2**2 * R2 + 2 * left * p.Phi * cross * K2 * scale
        found.append(variance)
        cross, variance, claimed = K1, p.Phi**2 * variance + p.Q, p.Phi**2 * left * claimed + p.Q
    return found
