"""The answers of lab 7 by hand: the second route, which owes nothing to the library."""

import math

import numpy as np

#: Table 3 of the sheet: Φ, Q, R, P0.
TABLE3 = (
    (0.78, 0.39, 0.5, 1.0),
    (0.78, 0.78, 0.5, 1.0),
    (0.78, 0.39, 1.0, 1.0),
    (0.78, 0.78, 1.0, 1.0),
    (0.78, 0.39, 5.0, 1.0),
    (1.0, 25.0, 32.0, 1.0),
)


def analytic(p):
    """The sheet's answers, by hand."""
    gain = optimal_gain(p.Phi**2, p.Q / p.R)
    posterior = variances(p.Phi, p.Q, p.R, p.P0, p.steps)
    table3 = [variances(*row, p.steps) for row in TABLE3]
    return {
        "gain_optimal_by_lambda": [optimal_gain(p.Phi2, ratio) for ratio in p.lambdas],
        "gain_steady": gain,
        "posterior_variance_steady": gain * p.R,
        "prior_variance_steady": p.Phi**2 * gain * p.R + p.Q,
        "settling_step": settling_by_hand(p.Phi, p.Q, p.R, p.P0, gain * p.R),
        "suboptimal_variance_ratio": variance_ratio(p.K_star, p.Phi**2, p.Q / p.R),
        "noiseless_limit": max(p.Phi**2 - 1, 0) * p.R / p.Phi**2 if p.Phi else 0.0,
        "prior_variance": predicted(p.Phi, p.Q, posterior),
        "posterior_variance": posterior[1:],
        "gain": [P / p.R for P in posterior[1:]],
        "table3_prior_variance": [predicted(row[0], row[1], P) for row, P in zip(TABLE3, table3, strict=True)],
        "table3_posterior_variance": [P[1:] for P in table3],
        "table3_gain": [[x / row[2] for x in P[1:]] for row, P in zip(TABLE3, table3, strict=True)],
    }


def confused(p, found):
    """What known confusions give: the predictor's gain ΦK, and P⁻ for P⁺ where there is no noise."""
    return {
        "predictor_gain": [p.Phi * K for K in found["gain"]],
        "predictor_gain_steady": p.Phi * found["gain_steady"],
        "noiseless_prior": p.Phi**2 * found["noiseless_limit"],
    }


def optimal_gain(Phi2, ratio):
    """K̄ of part (c), the positive root of Φ²K² + (λ + 1 − Φ²)K − λ = 0, written so that nothing cancels."""
    b = ratio + 1 - Phi2
    root = math.sqrt(b * b + 4 * Phi2 * ratio)
    if b <= 0:
        return (root - b) / (2 * Phi2)
    return 2 * ratio / (b + root)


def variance_ratio(K, Phi2, ratio):
    """P̄/R of part (b) for a constant gain; None where it diverges."""
    left = 1 - (1 - K) ** 2 * Phi2
    return ((1 - K) ** 2 * ratio + K**2) / left if left > 0 else None


def variances(Phi, Q, R, P0, steps):
    """P⁺ at t0…: each step is the fraction R(Φ²P + Q)/(Φ²P + Q + R), so i steps are the i-th power of its matrix."""
    step = np.array([[R * Phi**2, R * Q], [Phi**2, Q + R]])
    step /= np.abs(np.linalg.eigvals(step)).max()
    powers = [np.linalg.matrix_power(step, i) @ [P0, 1.0] for i in range(steps + 1)]
    return [float(above / below) for above, below in powers]


def settling_by_hand(Phi, Q, R, P0, limit):
    """The first measurement from which P⁺ stays within 1 % of its limit: the step is increasing in P, so P⁺ is monotone."""
    P, i = P0, 0
    while i == 0 or abs(P - limit) > 0.01 * limit:
        before, i = Phi**2 * P + Q, i + 1
        P = R * before / (before + R)
        if P == 0 != limit or (limit == 0 < P):
            return None
    return i


def predicted(Phi, Q, posterior):
    """P⁻ at t1… from P⁺ one step before."""
    return [Phi**2 * P + Q for P in posterior[:-1]]


def noiseless(Phi, R, P0, steps):
    """P⁺ for Q = 0 by the information: 1/P(i) = Φ⁻²ⁱ/P0 + (1 + Φ⁻² + … + Φ⁻²⁽ⁱ⁻¹⁾)/R; for |Φ| ≤ 1 multiplied by Φ²ⁱ."""
    if abs(Phi) > 1:
        return [1 / (Phi ** (-2 * i) / P0 + sum(Phi ** (-2 * j) for j in range(i)) / R) for i in range(steps + 1)]
    return [P0 * Phi ** (2 * i) / (1 + P0 / R * sum(Phi ** (2 * j) for j in range(1, i + 1))) for i in range(steps + 1)]
