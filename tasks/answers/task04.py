"""The answers of lab 4 by hand: the second route, which owes nothing to the library."""

import math

from ctlabs.tasks.answers import kinematics


def analytic(p):
    """The sheet's answers, by hand."""
    t, q = p.tau, p.sigma_w2
    Phi = [[1, t, t**2 / 2], [0, 1, t], [0, 0, 1]]
    lower = [[1, 0, 0], [5 / (2 * t), 1, 0], [10 / (3 * t**2), 4 / t, 1]]
    variances = [q * t**5 / 20, q * t**3 / 48, q * t / 9]
    factor = [[g * math.sqrt(d) for g, d in zip(row, variances, strict=True)] for row in lower]
    return kinematics.answers(p, Phi, factor) | {
        "Phi": Phi,
        "Qd": [
            [q * t**5 / 20, q * t**4 / 8, q * t**3 / 6],
            [q * t**4 / 8, q * t**3 / 3, q * t**2 / 2],
            [q * t**3 / 6, q * t**2 / 2, q * t],
        ],
        "unit_lower_factor": lower,
        "diagonal_noise_variances": variances,
        "standardised_noise_factor": factor,
    }


def confused(p, found):
    """What known confusions give."""
    return kinematics.confused(p, found)
