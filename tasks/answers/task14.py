"""The answers of lab 14 by hand: the second route, which owes nothing to the library."""

import math
from itertools import combinations


def cases(p):
    """P0, Qd, R and the limit of each part."""
    s, high = p.sigma**2, p.sigma_high**2
    return {
        "a": (s, s, s, None),
        "b": (s, s, s, p.limit_rms),
        "c": (high, s, s, p.limit_rms),
        "d": (s, high, s, p.limit_rms),
        "e": (s, s, high, p.limit_rms),
    }


def analytic(p):
    """The sheet's answers by trying every selection, one number at a time."""
    answer = {"pairs": math.comb(p.horizon, p.fixes)}
    for part, (P0, Qd, R, limit) in cases(p).items():
        tried = [(instants, *followed(P0, Qd, R, instants, p.horizon)) for instants in combinations(range(p.horizon), p.fixes)]
        good = [(rms, instants) for instants, rms, prior, _posterior in tried if limit is None or prior <= limit * (1 + 1e-12)]
        least = min(good)[0] if good else None
        answer[f"{part}_best_pair"] = list(max(i for rms, i in good if rms <= least * (1 + 1e-12))) if good else None
        answer[f"{part}_terminal_rms"] = least
        answer[f"{part}_feasible_pairs"] = len(good)
        answer[f"{part}_feasible_posterior"] = sum(limit is None or posterior <= limit for *_rest, posterior in tried)
        answer[f"{part}_gains"] = gains(P0, Qd, R, answer[f"{part}_best_pair"]) if good else None
        answer[f"{part}_needed"] = min(prior for _i, _rms, prior, _posterior in tried)
    return answer


def confused(p, found):
    """What a known confusion gives."""
    return {"a_terminal_variance": found["a_terminal_rms"] ** 2}


def followed(P0, Qd, R, instants, horizon):
    """RMS at the end, and the largest RMS before and after a fix, of one selection."""
    P, prior, posterior = P0, 0.0, 0.0
    for t in range(horizon):
        if t in instants:
            prior = max(prior, math.sqrt(P))
            P = 1 / (1 / P + 1 / R)
            posterior = max(posterior, math.sqrt(P))
        P = P + Qd
    return math.sqrt(P), prior, posterior


def gains(P0, Qd, R, instants):
    """P/(P + R) at each fix, where P follows from the information of the fixes before: 1/P⁺ = 1/P⁻ + 1/R."""
    found, P, last = [], P0, 0
    for t in instants:
        P += (t - last) * Qd
        found.append(1 / (1 + R / P))
        P, last = 1 / (1 / P + 1 / R), t
    return found
