"""The answers of lab 16 by hand: the second route, which owes nothing to the library."""

import math

import numpy as np

#: Times at which P(t) is given, s.
TIMES = (0.5, 1.0, 2.0, 5.0)
#: The band of the settling time, as a fraction of the limit.
WITHIN = 0.01


def analytic(p):
    """The sheet's answers, by hand."""
    rate, limit = math.sqrt(p.Q / p.R), math.sqrt(p.Q) * math.sqrt(p.R)
    prior, posterior = sampled_limits(p.Q, p.R, p.dt)
    gain = posterior * p.dt / p.R
    return {
        "variance_steady_continuous": limit,
        "gain_steady_continuous": rate,
        "filter_transfer_function": [[rate], [1.0, rate]],
        "variance_continuous": [variance(p.Q, p.R, p.P0, t) for t in TIMES],
        "settling_time": settling_time(p.Q, p.R, p.P0),
        "prior_variance_steady": prior,
        "posterior_variance_steady": posterior,
        "gain_steady": gain,
        "filter_z_transfer_function": [[gain, 0.0], [1.0, gain - 1]],
        "settling_step": settling_by_hand(p.Q, p.R, p.P0, p.dt),
    }


def confused(p, found):
    """What a known confusion gives: the strength of the measurement's noise for its variance R/Δt."""
    return {"gain_strength": found["prior_variance_steady"] / (found["prior_variance_steady"] + p.R)}


def variance(Q, R, P0, t):
    """P(t) of part (a), the solution of P' = Q − P²/R."""
    if not Q:
        return P0 * R / (R + P0 * t)
    limit, share = math.sqrt(Q) * math.sqrt(R), math.tanh(math.sqrt(Q / R) * t)
    return limit * (P0 + limit * share) / (limit + P0 * share)


def settling_time(Q, R, P0):
    """When (P − P∞)/(P + P∞), which decays like e^(−2√(Q/R)t), enters the band for good; None if P∞ = 0 < P0."""
    if not Q:
        return None if P0 else 0.0
    limit = math.sqrt(Q) * math.sqrt(R)
    start = (P0 - limit) / (P0 + limit)
    edge = WITHIN / (2 + WITHIN) if start > 0 else WITHIN / (2 - WITHIN)
    return max(0.0, math.log(abs(start) / edge) / (2 * math.sqrt(Q / R))) if start else 0.0


def sampled_limits(Q, R, dt):
    """P⁻ and P⁺ of part (b): the roots of P² ∓ Q dt P − QR = 0, written so that nothing cancels."""
    above = 0.5 * Q * dt + math.sqrt(Q * R + (0.5 * Q * dt) ** 2)
    return above, Q * R / above if above else 0.0


def settling_by_hand(Q, R, P0, dt):
    """The same for P⁺: (P⁺ − P⁺∞)/(P⁺ + P⁻∞) shrinks by the factor (P⁺∞/P⁻∞)² with each measurement."""
    if not Q:
        return None if P0 else 1
    prior, posterior = sampled_limits(Q, R, dt)
    start = (P0 - posterior) / (P0 + prior)
    edge = math.copysign(WITHIN, start) * posterior
    ratio = abs(start) * (posterior + edge + prior) / abs(edge)
    return max(1, math.ceil(math.log(ratio) / (2 * math.log(prior / posterior)))) if start else 1


def posterior_variance(Q, R, P0, dt, k):
    """P⁺ after k measurements, by the k-th power of the fraction R_d(P + Q_d)/(P + Q_d + R_d)."""
    step = np.array([[R / dt, Q * R], [1.0, Q * dt + R / dt]])
    step /= np.abs(np.linalg.eigvals(step)).max()
    above, below = np.linalg.matrix_power(step, k) @ [P0, 1.0]
    return float(above / below)
