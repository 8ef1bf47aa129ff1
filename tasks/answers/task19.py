"""The answers of lab 19 by hand: the second route, which owes nothing to the library."""

import math
from functools import cache

import numpy as np
import sympy

#: Times at which P(t) is given, s.
TIMES = (0.25, 0.5, 1.0, 2.0)
#: The band of the settling time, as a fraction of the limit.
WITHIN = 0.01


def analytic(p):
    """The sheet's answers, by hand."""
    return asked(p) | {"free_response": free_response(p.alpha, p.beta), "hint": hint()}


def asked(p):
    """Those that are numbers of the filter."""
    return {
        "states_required": len([1.0, p.beta]) - 1,  # the degree of the denominator s + β
        "variance_continuous": [variance(p.beta, t) for t in TIMES],
        "variance_limit": max(0.0, -2 * p.beta),
        "filter_pole": -abs(p.beta),
        "settling_time": settling_time(p.beta),
        "posterior_variance_at_1s": sampled_variance(p.beta, p.dt, last(p.dt)),
        "posterior_variance_limit": max(0.0, -math.expm1(2 * min(p.beta, 0.0) * p.dt) / p.dt),
    }


def confused(p, found):
    """What known confusions give."""
    return {"plant_pole": -p.beta, "variance_1s": variance(p.beta, 1.0)}


def mean_power(x):
    """(eˣ − 1)/x, the mean of e^s over [0, x], which is 1 at x = 0 and loses no digits near it."""
    return math.expm1(x) / x if x else 1.0


def variance(beta, t):
    """P(t) of part (a): two positive terms, so nothing cancels; for β > 0 multiplied by e^(−2βt) so that none overflows."""
    x = 2 * beta * t
    return math.exp(-x) / (1 + t * mean_power(-x)) if x > 0 else 1 / (math.exp(x) + t * mean_power(x))


def sampled_variance(beta, dt, k):
    """P⁺ₖ of part (b), likewise: (gᵏ − 1)/(g − 1) = k·m(2βk dt)/m(2β dt) with m of mean_power."""
    if not k:
        return 1.0
    x, step = 2 * beta * dt * k, 2 * beta * dt
    if x > 0:  # the sum g⁰ + … + gᵏ⁻¹ times g⁻ᵏ is g⁻¹ + … + g⁻ᵏ
        return math.exp(-x) / (1 + dt * k * math.exp(-step) * mean_power(-x) / mean_power(-step))
    return 1 / (math.exp(x) + dt * k * mean_power(x) / mean_power(step))


def sampled_power(beta, dt, k):
    """The same by the k-th power of the step's matrix: (J, 1) → (gJ + dt, 1), scaled to keep its elements below 1."""
    step = np.array([[1.0, dt * math.exp(-2 * beta * dt)], [0.0, math.exp(-2 * beta * dt)]])
    if beta < 0:
        step = np.array([[math.exp(2 * beta * dt), dt], [0.0, 1.0]])
    above, below = np.linalg.matrix_power(step, k) @ [1.0, 1.0]
    return float(below / above)


def settling_time(beta):
    """When P is within the band of 2|β| for good: 1/P − 1/(2|β|) decays like e^(−2|β|t). None if the limit is 0."""
    if beta >= 0:
        return None
    limit = -2 * beta
    start = 1 - 1 / limit  # 1/P(0) − 1/P∞, negative if P starts above its limit
    edge = (1 / (1 + math.copysign(WITHIN, -start)) - 1) / limit
    return max(0.0, math.log(start / edge) / limit) if start else 0.0


def last(dt):
    """The number of the last measurement not later than 1 s."""
    return math.floor(1 / dt * (1 + 1e-12))


def batch(z, t, beta, dt):
    """The estimate after the last of the measurements z by least squares, all at once: z_j = e^(−βt_j) x(0) + v_j."""
    h = np.exp(-beta * np.asarray(t))
    return float(h[-1] * dt * (h @ z) / (1 + dt * (h @ h)))


def free_response(alpha, beta):
    """x(t)/x(0) at TIMES with w = 0, from the realisation q̇ = −βq + (α−β)w, x = q + w by Laplace's transform."""
    s, t, b, a, Q, W = sympy.symbols("s t b a Q W")
    state = sympy.solve(sympy.Eq(s * Q - 1, -b * Q + (a - b) * W), Q)[0]
    x = sympy.residue((state + W).subs(W, 0) * sympy.exp(s * t), s, -b)
    return [float(x.subs({a: alpha, b: beta, t: when})) for when in TIMES]


@cache
def hint():
    """Elements in which d(M⁻¹)/dt differs from the hint's equation: for 1 × 1, 2 × 2, and 2 × 2 with +B mistaken for −B."""
    t = sympy.Symbol("t")

    def wrong(n, sign):
        M = sympy.Matrix(n, n, lambda i, j: sympy.Function(f"m{min(i, j)}{max(i, j)}")(t))
        A = sympy.Matrix(n, n, lambda i, j: sympy.Symbol(f"a{i}{j}"))
        B = sympy.Matrix(n, n, lambda i, j: sympy.Symbol(f"b{min(i, j)}{max(i, j)}"))
        inverse, motion = M.inv(), A * M + M * A.T - M * B * M
        rates = {M[i, j].diff(t): motion[i, j] for i in range(n) for j in range(n)}
        claimed = -A.T * inverse - inverse * A + sign * B
        return sum(sympy.cancel(sympy.together(e.subs(rates))) != 0 for e in inverse.diff(t) - claimed)

    return [wrong(1, 1), wrong(2, 1), wrong(2, -1)]
