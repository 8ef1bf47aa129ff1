"""The answers of the lab coloured_plant by hand: the second route, which owes nothing to the library."""

import math

import numpy as np
import scipy.linalg

#: Times at which the covariance is given, s.
TIMES = (0.25, 0.5, 1.0, 2.0)


def analytic(p):
    """The example, by hand."""
    P, polynomial = limit(p)
    white = p.a + wide(p)
    return {
        "shaping_filter": [[math.sqrt(2 * p.D * p.alpha)], [1.0, p.alpha]],
        "covariance_steady": P.tolist(),
        "gain_steady": (P[0] / p.r).tolist(),
        "filter_polynomial": polynomial,
        "covariance_continuous": [covariance(p, t).tolist() for t in TIMES],
        "white_claimed_variance": p.r * white,
        "white_actual_variance": white_actual(p),
    }


def limit(p):
    """P∞ and the filter's polynomial s² + c1 s + c0, from Δ(s)Δ(−s) = (a² − s²)(α² − s²) + 2Dαb²/r; nothing cancels."""
    a, alpha, drive = p.a, p.alpha, 2 * p.D * p.alpha / p.r
    c0 = math.hypot(a * alpha, math.sqrt(drive) * p.b)
    c1 = math.sqrt(a * a + alpha * alpha + 2 * c0)
    above = c0 + a * alpha if a >= 0 else drive * p.b**2 / (c0 - a * alpha)  # c0 + aα
    K1 = 2 * above / (c1 + alpha - a) if c1 + alpha - a > abs(a) else c1 - alpha + a
    K2 = drive * p.b / (c0 + alpha**2 + alpha * c1)
    P1, P12 = p.r * K1, p.r * K2
    return np.array([[P1, P12], [P12, p.D - P12**2 / (2 * alpha * p.r)]]), [1.0, c1, c0]


def covariance(p, t):
    """P(t) = P∞ + e^(At)Δ(I + MΔ)⁻¹e^(Aᵀt), Δ = P(0) − P∞, A the filter's matrix, M the information it has by t."""
    P, polynomial = limit(p)
    if not polynomial[2]:  # an integrator that nothing drives
        return np.diag([p.p0 * p.r / (p.r + p.p0 * t), p.D])
    A = np.array([[p.a - P[0, 0] / p.r, p.b], [-P[0, 1] / p.r, -p.alpha]])
    flow, seen = scipy.linalg.expm(A * t), np.diag([1 / p.r, 0.0])
    whole = scipy.linalg.solve_continuous_lyapunov(A.T, -seen)
    difference = np.diag([p.p0, p.D]) - P
    found = P + flow @ difference @ np.linalg.solve(np.eye(2) + (whole - flow.T @ whole @ flow) @ difference, flow.T)
    return 0.5 * (found + found.T)


def wide(p):
    """λ = √(a² + b²S(0)/r), the bandwidth of the filter that takes w for white noise of strength S(0) = 2D/α."""
    return math.hypot(p.a, p.b * math.sqrt(2 * p.D / (p.alpha * p.r)))


def white_actual(p):
    """E e² of ė = −λe − bw + kv with w of variance D and correlation time 1/α; None where that filter stands still."""
    rate = wide(p)
    if not rate:
        return None
    return (p.a + rate) ** 2 * p.r / (2 * rate) + p.b**2 * p.D / (rate * (rate + p.alpha))


def discrete(p, dt, count):
    """P⁻ and K at steps 1…count of the sampled example: P⁻ = YX⁻¹, where (X, Y) moves by powers of one matrix."""
    F, W = np.array([[p.a, p.b], [0, -p.alpha]]), np.diag([0, 2 * p.D * p.alpha])
    block = scipy.linalg.expm(dt * np.block([[-F, W], [np.zeros((2, 2)), F.T]]))
    Phi = block[2:, 2:].T
    Qd, back = Phi @ block[:2, 2:], np.linalg.inv(Phi).T
    seen = back @ np.diag([dt / p.r, 0.0])
    step = np.block([[back, seen], [Qd @ back, Phi + Qd @ seen]])
    start = np.vstack([np.eye(2), Phi @ np.diag([p.p0, p.D]) @ Phi.T + Qd])
    pairs = [np.linalg.matrix_power(step, k) @ start for k in range(count)]
    P = np.array([pair[2:] @ np.linalg.inv(pair[:2]) for pair in pairs])
    return P, P[:, :, :1] / (P[:, :1, :1] + p.r / dt)
