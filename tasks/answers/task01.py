"""The answers of lab 1 by hand: the second route, which owes nothing to the library."""

import math
from decimal import Decimal, localcontext

import numpy as np

#: Steps after the anomaly that are listed.
AFTER = 6


def variances(p):
    """R(t_i), i = 1, 2, …: the list, or the number repeated."""
    return list(p.R) if isinstance(p.R, tuple) else [p.R] * p.steps


def analytic(p):
    """The sheet's answers, by hand."""
    R, Qd = variances(p), p.sigma_w2 * p.tau
    posterior = conditioned(p.P0, Qd, R)
    prior = [P + Qd for P in [p.P0, *posterior[:-1]]]
    gain = [gain_of(P, r) for P, r in zip(prior, R, strict=True)]
    root = math.sqrt(Qd**2 + 4 * Qd * R[-1]) if math.isfinite(R[-1]) else None
    limit = None if root is None else 0.5 * (root - Qd)
    return {
        "prior_variance": prior,
        "posterior_variance": posterior,
        "gain": gain,
        "prior_variance_steady": None if root is None else 0.5 * (root + Qd),
        "posterior_variance_steady": limit,
        "gain_steady": None if root is None else gain_by_ratio(Qd, R[-1]),
        "settling_step": None if root is None else settling_by_hand(p.P0, Qd, R, limit),
        "bias_factor": list(np.cumprod([1 - K for K in gain])),
        "posterior_variance_missing": None if root is None else recovery(limit, Qd, math.inf, R[-1]),
        "posterior_variance_perfect": None if root is None else recovery(limit, Qd, 0.0, R[-1]),
    }


def conditioned(P0, Qd, R):
    """Var(x(t_i) | z_1…z_i) for every i, by conditioning the joint Gaussian distribution: Cov(x_i, x_j) = P0 + min(i, j)Qd.

    Cov(z) = L diag(d) Lᵀ grows by a row with every measurement. What is left of x_i is a difference of numbers as large as
    P0 + iQd, so it is formed with 60 digits, of the same doubles.
    """
    with localcontext() as digits:
        digits.prec = 60
        start, step = Decimal(float(P0)), Decimal(float(Qd))
        used, L, d, found = [], [], [], []
        for i, r in enumerate(R, start=1):
            row = weights([start + j * step for j in used], L, d)
            before = start + i * step - sum((a * a * v for a, v in zip(row, d, strict=True)), Decimal(0))
            if math.isfinite(r):
                noise = Decimal(float(r))
                known = before + noise <= Decimal("1e-40") * (start + i * step + noise)
                used, L, d = [*used, i], [*L, row], [*d, Decimal(0) if known else before + noise]
                before = Decimal(0) if known else before - before * before / (before + noise)
            found.append(float(before) if r > 0 else 0.0)
    return found


def weights(covariances, L, d):
    """a with covariances = L diag(d) a, row by row; a measurement that says nothing new (d = 0) has none."""
    a = []
    for c, row, v in zip(covariances, L, d, strict=True):
        rest = c - sum((x * y * w for x, y, w in zip(row, a, d, strict=False)), Decimal(0))
        a.append(rest / v if v else Decimal(0))
    return a


def gain_of(P, R):
    """P/(P + R); 0 for an infinite R, and where nothing is left to learn."""
    return P / (P + R) if math.isfinite(R) and P + R > 0 else 0.0


def gain_by_ratio(Qd, R):
    """K̄ from ρ = Qd/R, written without cancellation; 1 for R = 0 with noise, 0 without noise."""
    if R == 0:
        return 1.0 if Qd else 0.0
    ratio = Qd / R
    return 2 * ratio / (ratio + math.sqrt(ratio**2 + 4 * ratio)) if ratio else 0.0


def settling_by_hand(P0, Qd, R, limit):
    """The first measurement from which P⁺ stays within 1 % of its limit; R goes on with its last entry, and there P⁺ is monotone."""
    P, outside, i = P0, 0, 0
    while i < len(R) or (limit and abs(P - limit) > 0.001 * limit):
        P, r, i = P + Qd, R[min(i, len(R) - 1)], i + 1
        P = 0.0 if r == 0 or P == 0 else 1 / (1 / P + 1 / r)
        outside = i if abs(P - limit) > 0.01 * limit else outside
    return None if limit == 0 and P > 0 else outside + 1


def recovery(limit, Qd, anomaly, R):
    """P⁺ at t* and after, from the steady state, by the information: 1/P⁺ = 1/(P + Qd) + 1/R."""
    P, found = limit, []
    for r in [anomaly] + [R] * AFTER:
        P = P + Qd
        P = 0.0 if r == 0 or P == 0 else 1 / (1 / P + 1 / r)
        found.append(P)
    return found
