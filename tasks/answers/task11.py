"""The answers of lab 11 by hand: the second route, which owes nothing to the library."""

import math
from fractions import Fraction

import numpy as np
import scipy.linalg

#: The band of the settling time, as a fraction of the limit.
WITHIN = 0.01


def decimal(x):
    """The fraction that a number is as it was written: 0.1 is 1/10."""
    return Fraction(repr(float(x)))


def analytic(p):
    """The sheet's answers, by hand."""
    exact = two_measurements(p)
    P1 = start(p)
    prior = predictions(P1, p.Q, p.R, p.steps)
    above = 0.5 * (p.Q + math.sqrt(p.Q**2 + 4 * p.Q * p.R))
    return {
        "prior_variance": prior,
        "gain": [gain(P, p.R) for P in prior],
        "posterior_variance": [gain(P, p.R) * p.R for P in prior],
        "information_increment": [1 / p.R if p.R else math.inf] * 2,
        "posterior_estimate_coefficients_1": [float(c) for c in exact["coefficients"][0]],
        "posterior_estimate_coefficients_2": [float(c) for c in exact["coefficients"][1]],
        "prior_variance_steady": above,
        "posterior_variance_steady": p.Q * p.R / above if above else 0.0,
        "gain_steady": p.Q / above if above else 0.0,
        "settling_step": settling_step(P1, p.Q, p.R),
    }


def confused(p, found):
    """What a known confusion gives."""
    return {"noise_variance": [p.R, p.R]}


def start(p):
    """Var x(t1) = E x² − (E x)², without cancellation."""
    return float(decimal(p.x1_second_moment) - decimal(p.x1_mean) ** 2)


def gain(P, R):
    """K = P⁻/(P⁻ + R); 0 where a perfect measurement meets what is known."""
    return P / (P + R) if P + R else 0.0


def two_measurements(p):
    """Exact P⁻, K, P⁺ at t1, t2 (sympy fractions), and x̂⁺ as the coefficients of 1, z1(, z2)."""
    import sympy

    z = sympy.symbols("z1 z2")
    mean, second, Q, R = (sympy.Rational(*decimal(x).as_integer_ratio()) for x in (p.x1_mean, p.x1_second_moment, p.Q, p.R))
    found = {"prior": [], "gain": [], "posterior": [], "coefficients": []}
    P, x = second - mean**2, mean
    for i in range(2):
        K = P / (P + R) if P + R else sympy.Integer(0)
        x = sympy.expand(x + K * (z[i] - x))
        found["prior"].append(P)
        found["gain"].append(K)
        found["posterior"].append(K * R)
        found["coefficients"].append([x.subs({z[0]: 0, z[1]: 0}), *(x.coeff(z[j]) for j in range(i + 1))])
        P = K * R + Q
    return found


def steady_exact(p):
    """P̄⁻ with its root, by sympy."""
    import sympy

    Q, R = (sympy.Rational(*decimal(x).as_integer_ratio()) for x in (p.Q, p.R))
    return (Q + sympy.sqrt(Q**2 + 4 * Q * R)) / 2


def predictions(P1, Q, R, steps):
    """P⁻ at t1, t2, …: a step is the fraction [(R + Q)P + QR]/(P + R), so i steps are the i-th power of its matrix."""
    if not R:
        return [P1] + [Q] * (steps - 1)
    step = np.array([[R + Q, Q * R], [1.0, R]])
    step /= np.abs(np.linalg.eigvals(step)).max()
    powers = [np.linalg.matrix_power(step, i) @ [P1, 1.0] for i in range(steps)]
    return [float(above / below) for above, below in powers]


def settling_step(P1, Q, R):
    """The first i from which P⁺ is within 1 % of its limit: (P⁺ − P̄⁺)/(P⁺ + P̄⁻) shrinks by (P̄⁺/P̄⁻)² with each step."""
    if not R or not (Q or P1):
        return 1
    if not Q:
        return None
    prior = 0.5 * (Q + math.sqrt(Q**2 + 4 * Q * R))
    posterior = Q * R / prior
    first = gain(P1, R) * R
    ratio = (first - posterior) / (first + prior)
    edge = math.copysign(WITHIN, ratio) * posterior
    far = abs(ratio) * (posterior + edge + prior) / abs(edge)
    return 1 + max(0, math.ceil(math.log(far) / (2 * math.log(prior / posterior)))) if far else 1


def vector_limit(Q, R):
    """P̄⁻ for H = I: in the coordinates in which R = I and Q is diagonal every one is the scalar problem."""
    q, V = scipy.linalg.eigh(Q, R)
    back = R @ V
    q = q.clip(0)
    return back @ np.diag(0.5 * (q + np.sqrt(q**2 + 4 * q))) @ back.T
