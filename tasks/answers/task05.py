"""The answers of lab 5 by hand: the second route, which owes nothing to the library."""

import math
from itertools import islice

import numpy as np
from ctlabs.tasks.answers import kinematics

#: Measurements in the lists.
LISTED = 10


def analytic(p):
    """The sheet's answers, by hand."""
    t, q, c, s = p.tau, p.sigma_w2, math.cos(p.theta), math.sin(p.theta)
    across = (p.D * p.sigma_theta) ** 2
    R11, R22, R12 = p.sigma_D**2 * c**2 + across * s**2, p.sigma_D**2 * s**2 + across * c**2, s * c * (p.sigma_D**2 - across)
    Phi, root = np.array([[1, t], [0, 1]]), math.sqrt(q)
    standard = root * np.array([[math.sqrt(t**3 / 3), 0], [math.sqrt(3 * t / 4), math.sqrt(t) / 2]])
    limits = {R: np.diag(kinematics.steady_state(2, q, t, R)[1]) for R in (R11, R22, p.sigma_D**2, across)}
    first = np.concatenate([limits[R11], limits[R22]])
    best = turned(limits[p.sigma_D**2], limits[across], p.theta)
    paths = {R: transient(p, Phi, standard, R, LISTED) for R in (R11, R22, p.sigma_D**2, across)}
    return {
        "Phi": np.kron(np.eye(2), Phi), "Qd": np.kron(np.eye(2), q * np.array([[t**3 / 3, t**2 / 2], [t**2 / 2, t]])),
        "unit_lower_factor": np.kron(np.eye(2), [[1, 0], [3 / (2 * t), 1]]), "standardised_noise_factor": np.kron(np.eye(2), standard),
        "diagonal_noise_variances": [q * t**3 / 3, q * t / 4] * 2,
        "pseudo_measurement_covariance": [[R11, R12], [R12, R22]], "l21": R12 / R11, "diagonal_variances": [R11, p.sigma_D**2 * across / R11],
        "posterior_variance_steady_variant1": first, "posterior_variance_steady_variant2": best, "variance_ratio_steady": first / best,
        "posterior_variance_variant1": np.hstack([paths[R11], paths[R22]]),
        "posterior_variance_variant2": turned(paths[p.sigma_D**2], paths[across], p.theta),
        "settling_step_variant1": settling_by_hand(p, Phi, standard, (R11, R22), first, lambda a, b: np.concatenate([a, b])),
        "settling_step_variant2": settling_by_hand(p, Phi, standard, (p.sigma_D**2, across), best, lambda a, b: turned(a, b, p.theta)),
        "cost_of_update": costs(4),
    }


def confused(p, found):
    """What known confusions give."""
    R = np.array(found["pseudo_measurement_covariance"])
    strength = np.kron(np.eye(2), [[0, 0], [0, p.sigma_w2]])
    return {
        "strength": strength,
        "first_order": strength * p.tau,
        "uncorrelated": np.diag(np.diag(R)),
        "correlation": R[0, 1] / math.sqrt(R[0, 0] * R[1, 1]),
        "diagonal": np.diag(R),
        "ratio_upside_down": 1 / found["variance_ratio_steady"],
    }


def turned(along, across, theta):
    """Variances of (x, v_x, y, v_y) where radius and its normal have independent errors with the variances given."""
    c2, s2 = math.cos(theta) ** 2, math.sin(theta) ** 2
    return np.concatenate([c2 * along + s2 * across, s2 * along + c2 * across], axis=-1)


def spread(p):
    """Variances of each coordinate and each velocity at t0: as good as a first measurement, and 10τ of Brownian motion."""
    return p.sigma_D**2 + (p.D * p.sigma_theta) ** 2, 10 * p.sigma_w2 * p.tau


def transient(p, Phi, standard, R, count):
    """Variances after 1…count updates of one coordinate measured with the variance R, by square-root arrays."""
    return np.array([np.diag(P) for _K, P in islice(kinematics.filtered(Phi, standard, R, np.diag(spread(p))), count)])


def settling_by_hand(p, Phi, standard, noises, limit, combine, longest=20_000):
    """The first i from which all four variances stay within 1 % of their limits; the two filters run side by side."""
    one, other = (kinematics.filtered(Phi, standard, R, np.diag(spread(p))) for R in noises)
    outside = 0
    for i, ((_K, A), (_L, B)) in enumerate(zip(one, other, strict=False), start=1):
        if (np.abs(combine(np.diag(A), np.diag(B)) - limit) > 0.01 * limit).any():
            outside = i
        if i > 2 * outside + 32:
            return outside + 1
        if i >= longest:
            return None
    return None


def costs(n):
    """Operations of an update: variant 1 as two filters of n/2 states, as one; variant 2 decorrelated; both at once."""
    def scalar(k):
        return k * (2 * k - 1) + 9 * k - 2 * k + 2 * k**2

    both = 2 * n * (2 * n - 1) + 4 * (2 * n - 1) + 4 + 4 * n
    return [2 * scalar(n // 2), 2 * scalar(n), 2 * scalar(n) + 3 + 2 * (n + 1), both + 3 + 2 * (n + 1) + 2 * n + 4 * n + 4 * n**2]


def moments(D, theta, sigma_D, sigma_theta):
    """Exact mean and covariance of (D + e_D)(cos, sin)(θ + e_θ) − (x, y), by E cos e_θ = exp(−σ_θ²/2)."""
    less = -math.expm1(-(sigma_theta**2))
    radial = sigma_D**2 * (1 + (1 - less) ** 2) / 2 + D**2 * less**2 / 2
    normal = -(D**2 + sigma_D**2) * math.expm1(-2 * sigma_theta**2) / 2
    c, s = math.cos(theta), math.sin(theta)
    turn = np.array([[c, -s], [s, c]])
    return D * math.expm1(-(sigma_theta**2) / 2) * np.array([c, s]), turn @ np.diag([radial, normal]) @ turn.T


def moments_by_quadrature(D, theta, sigma_D, sigma_theta):
    """The same by Gauss–Hermite nodes in e_D and e_θ."""
    node, weight = np.polynomial.hermite_e.hermegauss(60)
    weight = weight / weight.sum()
    r, angle = np.meshgrid(D + sigma_D * node, sigma_theta * node, indexing="ij")
    radial, normal = (r - D) * np.cos(angle) - 2 * D * np.sin(angle / 2) ** 2, r * np.sin(angle)
    c, s = math.cos(theta), math.sin(theta)
    e = np.stack([c * radial - s * normal, s * radial + c * normal])
    both = weight[:, None] * weight
    mean = (e * both).sum(axis=(1, 2))
    return mean, np.einsum("aij,bij,ij->ab", e - mean[:, None, None], e - mean[:, None, None], both)


def degenerate(p):
    """Why these numbers are none for an exercise: errors nearly uncorrelated, so that both variants are one filter."""
    along, across, s2 = p.sigma_D**2, (p.D * p.sigma_theta) ** 2, math.sin(p.theta) ** 2
    R11, R22 = along * (1 - s2) + across * s2, along * s2 + across * (1 - s2)
    rho = math.sqrt(s2 * (1 - s2) / (R11 * R22)) * abs(along - across)
    return "the pseudo-measurements are nearly uncorrelated" if rho < 0.2 else ""
