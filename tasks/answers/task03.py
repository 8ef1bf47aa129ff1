"""The answers of lab 3 by hand: the second route, which owes nothing to the library."""

import math

from ctlabs.tasks.answers import kinematics
from scipy.optimize import brentq


def analytic(p):
    """The sheet's answers, by hand."""
    t, q = p.tau, p.sigma_w2
    Phi = [[1, t], [0, 1]]
    root = math.sqrt(q)
    factor = [[root * math.sqrt(t**3 / 3), 0], [root * math.sqrt(3 * t / 4), root * math.sqrt(t) / 2]]
    return kinematics.answers(p, Phi, factor) | {
        "Phi": Phi,
        "Qd": [[q * t**3 / 3, q * t**2 / 2], [q * t**2 / 2, q * t]],
        "unit_lower_factor": [[1, 0], [3 / (2 * t), 1]],
        "diagonal_noise_variances": [q * t**3 / 3, q * t / 4],
        "standardised_noise_factor": factor,
        "alpha_beta": alpha_beta(q * t**3, p.R),
    }


def confused(p, found):
    """What known confusions give."""
    return kinematics.confused(p, found)


def alpha_beta(c, R):
    """α and β from β² R = (1 − α) c and α² + αβ + β²/6 − 2β = 0, c = σ_w²τ³; the root in β is bracketed."""
    if c == 0:
        return [0.0, 0.0]

    def alpha(beta):
        return 0.5 * (math.sqrt(8 * beta + beta**2 / 3) - beta)

    largest = 3 - math.sqrt(3)  # where α = 1, the limit for R = 0
    beta = brentq(lambda b: b**2 * R - (1 - alpha(b)) * c, 0.0, largest, xtol=1e-300, rtol=1e-15) if R else largest
    return [alpha(beta), beta]
