"""The answers of lab 24 by hand: the second route, which owes nothing to the library."""

import math

import numpy as np


def analytic(p):
    """The sheet's answers, by hand."""
    known, found = regulator(p.Phi, p.b, p.Qx, p.Qu), estimator(p.Phi, p.Q, p.R)
    S, L, W, c = known
    prior, posterior, K = found
    regulation, price = S * p.Q, L**2 * W
    spread = (prior - posterior) / (1 - c**2)
    plan = horizon(p)
    return {
        "cost_to_go": S,
        "feedback_gain": L,
        "regulator_pole": c,
        "cost_known": regulation,
        "prior_variance_steady": prior,
        "posterior_variance_steady": posterior,
        "gain_steady": K,
        "cost_current": regulation + price * posterior,
        "cost_delayed": regulation + price * prior,
        "state_variance": spread + posterior,
        "input_variance": L**2 * spread,
        "cost_other_gain": cost_of_gain(p, p.L_star, p.R),
        "cost_perfect_delayed": (S + price) * p.Q,
        "cost_free_input": p.Qx * prior,
        "least_input_variance": max(p.Phi**2 - 1, 0.0) * (prior - posterior) / p.b**2,
        "cost_unmeasured": p.Qx * p.Q / (1 - p.Phi**2) if p.Phi < 1 else None,
        **plan,
        "true_factor_limits": limits(p.b, L, K, (1 - K) * c),
        "cost_actual": actual_cost(p, p.Phi_true),
    }


def confused(p, found):
    """What known confusions give: the predictor's gain, a cost with ½, and an input that is one step late."""
    return {
        "predictor_gain": p.Phi * found["gain_steady"],
        "half_known": 0.5 * found["cost_known"],
        "half_current": 0.5 * found["cost_current"],
    }


def riccati(a, b, q, r):
    """The positive root of b²S² + [r(1 − a²) − qb²]S − qr = 0, written so that nothing cancels."""
    middle = r * (1 - a * a) - q * b * b
    root = math.sqrt(middle * middle + 4 * b * b * q * r)
    return (root - middle) / (2 * b * b) if middle <= 0 else 2 * q * r / (middle + root)


def regulator(a, b, q, r):
    """S, L, W = r + b²S, and the pole a − bL = ar/W."""
    S = riccati(a, b, q, r)
    W = r + b * b * S
    return S, a * b * S / W, W, a * r / W


def estimator(a, Q, R):
    """P⁻, P⁺ and K in the limit: the same quadratic, with b = 1."""
    P = riccati(a, 1.0, Q, R)
    return P, P * R / (P + R), P / (P + R)


def current(p, a):
    """The cost of the current regulator of a plant with the factor a."""
    S, L, W, _ = regulator(a, p.b, p.Qx, p.Qu)
    return S * p.Q + L**2 * W * estimator(a, p.Q, p.R)[1]


def cost_of_gain(p, gain, R):
    """The cost of u = −gain x̂⁺ with the optimal estimate; None where it does not hold the plant."""
    prior, posterior, _ = estimator(p.Phi, p.Q, R)
    pole = p.Phi - p.b * gain
    if abs(pole) >= 1:
        return None
    spread = (prior - posterior) / (1 - pole**2)
    return p.Qx * (spread + posterior) + p.Qu * gain**2 * spread


def cost_of_estimator(p, K):
    """The cost of the optimal feedback of an estimate with another gain: SQ + L²W times its error variance; None where it grows."""
    S, L, W, _ = regulator(p.Phi, p.b, p.Qx, p.Qu)
    left = 1 - (1 - K) ** 2 * p.Phi**2
    return S * p.Q + L**2 * W * ((1 - K) ** 2 * p.Q + K**2 * p.R) / left if left > 0 else None


def trade(p, r):
    """Standard deviations of x and u for a weight r of the input: known, current, delayed."""
    _, L, _, c = regulator(p.Phi, p.b, p.Qx, r)
    prior, posterior, _ = estimator(p.Phi, p.Q, p.R)
    left = 1 - c**2
    rows = ((p.Q / left, 0.0), ((prior - posterior) / left, posterior), (p.Phi**2 * (prior - posterior) / left, prior))
    return [(math.sqrt(spread + error), L * math.sqrt(spread)) for spread, error in rows]


def powers(step, start, count):
    """start and the count values that follow under x → (ax + b)/(cx + d): i steps are the i-th power of the matrix."""
    step = np.asarray(step, dtype=float)
    step = step / np.abs(np.linalg.eigvals(step)).max()
    pairs = [np.linalg.matrix_power(step, i) @ [start, 1.0] for i in range(count + 1)]
    return [float(above / below) for above, below in pairs]


def horizon(p):
    """The regulator of N steps with the last state weighed by Q_x, measured from t1 on: S backwards, P⁺ forwards, and the whole cost."""
    a2, b2, N = p.Phi**2, p.b**2, p.steps
    S = powers([[a2 * p.Qu + p.Qx * b2, p.Qx * p.Qu], [b2, p.Qu]], p.Qx, N)[::-1]
    P = powers([[p.R * a2, p.R * p.Q], [a2, p.Q + p.R]], p.P0, N)
    prior = [a2 * x + p.Q for x in P[:-1]]
    W = [p.Qu + b2 * s for s in S[1:]]
    L = [p.Phi * p.b * s / w for s, w in zip(S[1:], W, strict=True)]
    unknown = sum(x * g * g * w for x, g, w in zip(P[:-1], L, W, strict=True))
    return {
        "cost_to_go_horizon": S,
        "feedback_gain_horizon": L,
        "gain_horizon": [x / (x + p.R) for x in prior],
        "cost_horizon": S[0] * p.P0 + p.Q * sum(S[1:]) + unknown,
        "cost_horizon_unknown": unknown,
    }


def limits(b, L, K, m):
    """True factors between which λ² − (a + m − KbL)λ + am has its roots inside the unit circle (those > 0)."""
    high = 1 + K * b * L / (1 - m)
    return [max(0.0, K * b * L / (1 + m) - 1), min(high, 1 / m) if m > 0 else high]


def actual_cost(p, a):
    """The cost of the regulator of Φ where the plant has the factor a: three linear equations for x and x̂⁺; None where it grows."""
    _, L, _, c = regulator(p.Phi, p.b, p.Qx, p.Qu)
    K = estimator(p.Phi, p.Q, p.R)[2]
    m, g = (1 - K) * c, p.b * L
    low, high = limits(p.b, L, K, m)
    if not (a < high and (a > low or K * g < 1 + m)):
        return None
    # X = Var x, C = cov(x, x̂), Y = Var x̂; x' = ax − g x̂ + w, x̂' = m x̂ + K(x' + v)
    A = np.array([
        [1 - a * a, 2 * a * g, -g * g],
        [-K, 1 - m * a, m * g],
        [-K * K, -2 * m * K * a, 1 - m * m + 2 * m * K * g],
    ])
    X, _, Y = np.linalg.solve(A, [p.Q, 0.0, K * K * p.R])
    return float(p.Qx * X + p.Qu * L**2 * Y)
