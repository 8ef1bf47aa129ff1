"""The second route of labs 3 and 4: answers for n integrators in a row by numpy and scipy alone.

The steady state is a closed form. The n-th difference of the coordinate has the autocorrelation of a B-spline, so the
spectrum of the n-th difference of z is, with u = 2 − z − 1/z and c = σ_w²τ²ⁿ⁻¹,

    R uⁿ + c b(u),   b = 1 − u/6 (n = 2),   b = 1 − u/4 + u²/120 (n = 3)

and its n zeros inside the unit circle are the poles of the steady filter; gains and variances follow from them.
The transient is the square-root filter in array form (orthogonal transformations only), with one least squares problem
over a whole trajectory beside it.
"""

import itertools
import math

import numpy as np
from scipy.linalg import solve_triangular

#: b(u), coefficients of ascending powers.
SPLINE = {2: (1, -1 / 6), 3: (1, -1 / 4, 1 / 120)}


def answers(p, Phi, factor):
    """What labs 3 and 4 have in common; ``Phi`` and the factor of Qd are the sheet's."""
    n = len(Phi)
    steps = list(itertools.islice(filtered(Phi, factor, p.R, p.P0), p.steps))
    prior, posterior, gain = steady_state(n, p.sigma_w2, p.tau, p.R)
    return {
        "open_loop_covariance": spread(n, p.sigma_w2, 20 * p.tau),
        "gain": [K for K, _ in steps],
        "posterior_covariance": [P for _, P in steps],
        "prior_covariance_steady": prior,
        "posterior_covariance_steady": posterior,
        "gain_steady": gain,
        "settling_step": settling(Phi, factor, p.R, p.P0, np.diag(posterior)),
    }


def confused(p, found):
    """What known confusions give in labs 3 and 4: the strength of the noise for its covariance, Φ K for K, P⁻ for P⁺."""
    Phi, n = np.array(found["Phi"], dtype=float), len(p.P0)
    strength = np.zeros((n, n))
    strength[-1, -1] = p.sigma_w2
    before = [np.array(p.P0, dtype=float), *found["posterior_covariance"][:-1]]
    return {
        "strength": strength,
        "first_order": strength * p.tau,
        "predictor_gain": np.array(found["gain"]) @ Phi.T,
        "predictor_gain_steady": Phi @ found["gain_steady"],
        "prior_covariance": [Phi @ P @ Phi.T + np.array(found["Qd"]) for P in before],
    }


def spread(n, strength, t):
    """Covariance at t of n integrators that start from rest: σ_w² ∫ of the products of the powers sⁱ/i!."""
    order = [n - 1 - i for i in range(n)]
    return np.array([[strength * t ** (i + j + 1) / (math.factorial(i) * math.factorial(j) * (i + j + 1)) for j in order] for i in order])


def spread_by_sum(Phi, unit_lower, variances, k):
    """The same at t = kτ from the explicit solution: the sum of (Φᵐ G_d)² over the independent noises."""
    kernels = [np.linalg.matrix_power(Phi, m) @ unit_lower for m in range(k)]
    return sum(kernel @ np.diag(variances) @ kernel.T for kernel in kernels)


def poles(n, c, R):
    """1 − z for the n poles z of the steady filter (c > 0), in a form that cancels neither near z = 1 nor near z = 0."""
    polynomial = np.polynomial.Polynomial([*(c * b for b in SPLINE[n]), R])
    u = np.roots(polynomial.coef[::-1]).astype(complex)
    for _ in range(2):
        u = u - polynomial(u) / polynomial.deriv()(u)
    root, middle = np.sqrt(u * (u - 4)), 2 - u
    z = 2 / np.where(np.abs(middle + root) > np.abs(middle - root), middle + root, middle - root)
    one, other = 0.5 * (u + root), 0.5 * (u - root)
    apart = np.where(np.abs(z) < 0.5, 1 - z, np.where(np.abs(1 - one) < np.abs(1 - other), one, other))
    return np.append(apart, np.ones(n - len(u)))  # R = 0: one pole is at z = 0


def steady_state(n, strength, tau, R):
    """P⁻, P⁺ and K of the limit, from the poles."""
    c = strength * tau ** (2 * n - 1)
    if c == 0:
        return np.zeros((n, n)), np.zeros((n, n)), np.zeros(n)
    K, P = (lab3_limit if n == 2 else lab4_limit)(np.poly(-poles(n, c, R)).real[1:], c, R)
    scale = np.diag(float(tau) ** -np.arange(n))
    P = scale @ P @ scale
    Phi = np.array([[tau ** (j - i) / math.factorial(j - i) if j >= i else 0.0 for j in range(n)] for i in range(n)])
    return Phi @ P @ Phi.T + spread(n, strength, tau), P, scale @ K


def lab3_limit(e, c, R):
    """K and P⁺ for τ = 1 from the elementary symmetric functions of 1 − z; S = c/K2² is the innovation's variance."""
    K = np.array([e[0] - e[1], e[1]])
    S = c / K[1] ** 2
    return K, np.array([[K[0] * R, K[1] * R], [K[1] * R, S * K[1] * (K[0] - K[1] / 2)]])


def lab4_limit(e, c, R):
    """The same for n = 3; the variances not in the first row follow from P⁻ = ΦP⁺Φᵀ + Qd row by row."""
    K = np.array([e[0] - e[1] + e[2], e[1] - 1.5 * e[2], e[2]])
    S = c / K[2] ** 2
    P33 = S * K[2] * (K[1] - K[2] / 2)
    P23 = S * (K[2] * K[0] - K[2] ** 2 / 6) - P33 / 2
    P22 = S * (K[1] * K[0] - K[2] ** 2 / 8) - K[2] * R - 1.5 * P23 - P33 / 2
    return K, np.array([[K[0] * R, K[1] * R, K[2] * R], [K[1] * R, P22, P23], [K[2] * R, P23, P33]])


def square_root(P0):
    """A factor of a covariance that may be singular."""
    values, vectors = np.linalg.eigh(np.asarray(P0, dtype=float))
    return vectors * np.sqrt(values.clip(0))


def filtered(Phi, factor, R, P0):
    """(K, P⁺) at t1, t2, … by the array form: [√R, HL; 0, L] is made lower triangular by an orthogonal matrix."""
    n, L = len(Phi), square_root(P0)
    largest = 0.0
    while True:
        L = np.linalg.qr(np.hstack([Phi @ L, factor]).T, mode="r").T
        largest = max(largest, np.abs(L).max())
        array = np.block([[np.array([[math.sqrt(R)]]), L[:1]], [np.zeros((n, 1)), L]])
        after = np.linalg.qr(array.T, mode="r").T
        K = np.zeros(n)
        if abs(after[0, 0]) > 1e-13 * largest:  # else a perfect measurement of what is known
            K, L = after[1:, 0] / after[0, 0], after[1:, 1:]
        L = np.where(np.linalg.norm(L, axis=1, keepdims=True) > 1e-13 * largest, L, 0.0)  # what is known is known exactly
        yield K, L @ L.T


def settling(Phi, factor, R, P0, limit, longest=100_000):
    """The first i from which every variance of P⁺ is within 1 % of its limit; None if it never is."""
    outside = 0
    for i, (_, P) in enumerate(filtered(Phi, factor, R, P0), start=1):
        if (np.abs(np.diag(P) - limit) > 0.01 * limit).any():
            outside = i
        if i > 2 * outside + 32:
            return outside + 1
        if i >= (longest if limit.any() else 64):
            return None
    return None


def least_squares(Phi, factor, R, P0, k):
    """Covariances, given z at t1…tk, of x(tk) and of x(t0): one least squares problem for all sources (R > 0).

    x(t0) and every noise are unit sources times a factor; the rows are the sources themselves and the k measurements.
    """
    n = len(Phi)
    states = [np.hstack([square_root(P0), np.zeros((n, k * n))])]
    for i in range(k):
        states.append(Phi @ states[-1])
        states[-1][:, (i + 1) * n : (i + 2) * n] = factor
    rows = np.vstack([np.eye((k + 1) * n), *(x[:1] / math.sqrt(R) for x in states[1:])])
    triangle = np.linalg.qr(rows, mode="r")
    found = [solve_triangular(triangle, x.T, trans="T") for x in (states[-1], states[0])]
    return tuple(half.T @ half for half in found)


def backward_differences(n, strength, tau, R):
    """Error covariance of the estimate from the last n measurements alone, the polynomial of degree n − 1 through them."""
    back = np.array([[(-m * tau) ** j / math.factorial(j) for j in range(n)] for m in range(n)])
    noise = np.array([[strength * overlap(n, m * tau, k * tau) for k in range(n)] for m in range(n)])
    differences = np.linalg.inv(back)
    return differences @ (R * np.eye(n) + noise) @ differences.T


def overlap(n, a, b):
    """∫ of ((a − s)(b − s))ⁿ⁻¹/(n − 1)!² over 0 ≤ s ≤ min(a, b): what two past positions miss in common."""
    power = np.polynomial.Polynomial([a, -1.0]) ** (n - 1) * np.polynomial.Polynomial([b, -1.0]) ** (n - 1)
    return power.integ()(min(a, b)) / math.factorial(n - 1) ** 2


def bias(Phi, factor, R, P0, start, steps):
    """The mean error at t0, t1, …: b ← (I − KH)Φb with the gains of the arrays."""
    found = [np.asarray(start, dtype=float)]
    for K, _ in itertools.islice(filtered(Phi, factor, R, P0), steps):
        predicted = Phi @ found[-1]
        found.append(predicted - K * predicted[0])
    return np.array(found)
