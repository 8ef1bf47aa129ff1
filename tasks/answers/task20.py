"""The answers of lab 20 by hand: the second route, which owes nothing to the library."""

import math

import numpy as np

#: Times at which P(t) is given, s, and that at which V̇ is.
TIMES = (0.25, 0.5, 1.0, 2.0)
MOMENT = 1.0


def analytic(p):
    """The sheet's answers, by hand, one per R."""
    each = [by_hand(p.Q, R, p.P0, p.dt) for R in p.R_values]
    return {name: [one[name] for one in each] for name in each[0]}


def by_hand(Q, R, P0, dt):
    """The same for one R."""
    kappa, at = math.sqrt(1 + Q / R), variance(Q, R, P0, MOMENT)
    prior, posterior = sampled_limits(Q, R, dt)
    return {
        "variance_steady_continuous": R * (1 + kappa),
        "variance_continuous": [variance(Q, R, P0, t) for t in TIMES],
        "filter_pole": -kappa,
        "gain_steady_continuous": 1 + kappa,
        "prior_variance_steady": prior,
        "posterior_variance_steady": posterior,
        "lyapunov_derivative": -(1 / R + Q / at**2),
        "error_of_the_approximation": approximation(Q, R, dt),
    }


def variance(Q, R, P0, t):
    """P(t) of part (a), with κ − tanh κt = (κ − 1) + (1 − tanh κt) written so that nothing cancels."""
    kappa = math.sqrt(1 + Q / R)
    share, fading = math.tanh(kappa * t), math.exp(-2 * kappa * t)
    rest = (Q / R) / (kappa + 1) + 2 * fading / (1 + fading)
    return (P0 * (kappa + share) + Q * share) / (rest + P0 / R * share)


def homogeneous(Q, R, P0, t):
    """y(t)/y(0) of part (b): exp ∫(1 − P/R)dt = 1/(cosh κt + (P0/R − 1) sinh κt/κ)."""
    kappa = math.sqrt(1 + Q / R)
    fading = math.exp(-2 * kappa * t)
    return 2 * math.exp(-kappa * t) * kappa / (((Q / R) / (kappa + 1) + P0 / R) * (1 - fading) + 2 * kappa * fading)


def sampled_limits(Q, R, dt):
    """P⁻ and P⁺ of part (c): the positive root of P² − [(e^(2dt) − 1)R_d + Q_d]P − Q_dR_d = 0."""
    growth, Rd = math.expm1(2 * dt), R / dt
    Qd = 0.5 * Q * growth
    half = 0.5 * (growth * Rd + Qd)
    prior = half + math.sqrt(half**2 + Qd * Rd)
    return prior, prior / (1 + prior / Rd)


def approximation(Q, R, dt):
    """The error of the steady filter with Φ = 1 + dt, Q_d = Q dt as a multiple of x, which grows by e^dt each period."""
    Qd, Rd = Q * dt, R / dt
    half = 0.5 * (dt * (2 + dt) * Rd + Qd)
    prior = half + math.sqrt(half**2 + Qd * Rd)
    left = Rd / (prior + Rd)
    return -left * (math.expm1(dt) - dt) / (math.exp(dt) - left * (1 + dt))


def posterior_variances(Q, R, P0, dt, steps):
    """P⁺ after 0..steps measurements: with the fixed points A and −B of one step (P⁺ − A)/(P⁺ + B) falls like λ^k.

    λ = e^(2dt)(1 − K)² with the steady gain; written so that nothing cancels.
    """
    prior, A = sampled_limits(Q, R, dt)
    Rd, Qd = R / dt, 0.5 * Q * math.expm1(2 * dt)
    B = Rd * Qd * math.exp(-2 * dt) / A
    power = 2 * (dt - math.log1p(prior / Rd)) * np.arange(steps + 1)
    left, gone, weight = np.exp(power), -np.expm1(power), (A + B) / (P0 + B)
    return (left * P0 * weight + gone * A) / (gone + left * weight)


def moments_of_the_approximation(Q, R, P0, dt, steps):
    """True E[e²] after each measurement of the filter with Φ = 1 + dt, Q_d = Q dt, and E[x²], from E[x²], E[xe], E[e²]."""
    right, short, Rd = math.exp(dt), 1 + dt, R / dt
    Qd, gap = 0.5 * Q * math.expm1(2 * dt), -(math.expm1(dt) - dt)
    X, M, V, P = P0, -P0, P0, P0
    errors, states = [V], [X]
    for _step in range(steps):
        V, M, X = short**2 * V + 2 * short * gap * M + gap**2 * X + Qd, right * (short * M + gap * X) - Qd, right**2 * X + Qd
        P = short**2 * P + Q * dt
        K = P / (P + Rd)
        P, V, M = K * Rd, (1 - K) ** 2 * V + K**2 * Rd, (1 - K) * M
        errors.append(V)
        states.append(X)
    return np.array(errors), np.array(states)


def decay(Q, R, low, high):
    """The least of P/R + Q/P for P from low to high, the rate at which V falls."""
    lowest = min(max(math.sqrt(Q * R), low), high)
    return lowest / R + Q / lowest
