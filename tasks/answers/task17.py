"""The answers of lab 17 by hand: the second route, which owes nothing to the library."""

import math

import numpy as np
from ctlabs.tasks.answers import task16

#: Times at which P(t) is given, s.
TIMES = (0.25, 0.5, 1.0, 2.0)
#: x3 of the states x1, x2.
SUM = [[1.0, 1.0]]


def analytic(p):
    """The sheet's answers, by hand."""
    Q, P0 = p.q1 + p.q2, p.P01 + p.P02
    rate = math.sqrt(Q / p.R)
    prior, posterior = task16.sampled_limits(Q, p.R, p.dt)
    # z from w1 and w2: the Markov parameters H Fᵏ G are [1, 1], 0, 0; the rank of their Hankel matrix is the order.
    markov = [np.ones((1, 2)), np.zeros((1, 2)), np.zeros((1, 2))]
    hankel = np.block([[markov[i + j] for j in range(2)] for i in range(2)])
    return {
        "states_required": int(np.linalg.matrix_rank(hankel)),
        "variance_steady_continuous": math.sqrt(Q) * math.sqrt(p.R),
        "gain_steady_continuous": rate,
        "filter_transfer_function": [[rate], [1.0, rate]],
        "variance_continuous": [task16.variance(Q, p.R, P0, t) for t in TIMES],
        "prior_variance_steady": prior,
        "posterior_variance_steady": posterior,
        "gain_steady": posterior * p.dt / p.R,
        "settling_step": task16.settling_by_hand(Q, p.R, P0, p.dt),
        "observability_rank_two_states": int(np.linalg.matrix_rank(np.array([SUM[0], [0.0, 0.0]]))),
        "growth_rate_x1": growth(p),
        "other_readings": other_readings(p),
    }


def growth(p):
    """The rate at which P11 grows in the end: the noise of q2 x1 − q1 x2, which z never shows, seen in x1."""
    return p.q1 * (p.q2 / (p.q1 + p.q2)) if p.q1 else 0.0


def other_readings(p):
    """P∞ of x3 for the other readings of the figure, in the order of ``readings``."""
    Q, c = p.q1 + p.q2, (4 * p.q1 + p.q2) / p.R
    # Two different poles: the squares of the filter's poles have the sum 5 + Q/R and the product 4 + c.
    above = Q / p.R + 2 * c / (math.sqrt(4 + c) + 2)
    return [
        Q / (math.sqrt(1 + Q / p.R) + 1),
        p.R * above / (math.sqrt(9 + above) + 3),
        p.R * math.sqrt(2) * (Q / p.R) ** 0.25,
    ]
