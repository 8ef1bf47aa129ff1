"""The answers of lab 2 by hand: the second route, which owes nothing to the library."""

import math

from ctlabs.tasks.answers import task01


def analytic(p):
    """The sheet's answers, by hand."""
    R, Qd = task01.variances(p), p.sigma_w2 * p.tau
    steady_gain = task01.gain_by_ratio(Qd, R[-1]) if math.isfinite(R[-1]) else 0.0
    forgets = None if steady_gain == 0 else p.u * p.tau * (1 - steady_gain) / steady_gain
    return {
        "control_increment": p.u * p.tau,
        "posterior_variance": task01.conditioned(p.P0, Qd, R),
        "gain_steady": steady_gain if math.isfinite(R[-1]) else None,
        "unmodelled_drift_bias_prior": None if forgets is None else forgets + p.u * p.tau,
        "unmodelled_drift_bias_posterior": forgets,
        "unmodelled_drift_mse": None if forgets is None else steady_gain * R[-1] + forgets**2,
        "posterior_variance_known_start": task01.conditioned(0.0, Qd, R),
    }


def confused(p, found):
    """What known confusions give."""
    before = [p.P0, *found["posterior_variance"][:-1]]
    gain = found["gain_steady"]
    return {
        "velocity": p.u,
        "prior_variance": [P + p.sigma_w2 * p.tau for P in before],
        "posterior_variance_steady": gain * task01.variances(p)[-1] if gain is not None else None,
    }
