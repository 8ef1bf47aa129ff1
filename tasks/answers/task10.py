"""The answers of lab 10 by hand: the second route, which owes nothing to the library."""

import math

import numpy as np


def analytic(p):
    """The sheet's answers, by hand."""
    bad, good = (posterior(p.P0, p.R, dt, p.steps) for dt in (p.dt_bad, p.dt_good))
    return {
        "position_variance_bad": bad[:, 0, 0],
        "velocity_variance_bad": bad[:, 1, 1],
        "velocity_variance_good": good[:, 1, 1],
        "velocity_variance_floor": conditional(p.P0) if loses(p.dt_bad) else 0.0,
        "observability_rank_bad": 1 if loses(p.dt_bad) else 2,
        "observability_rank_good": 1 if loses(p.dt_good) else 2,
        "unobservable_direction": [0.0, 1.0] if loses(p.dt_bad) else None,
        "reciprocal_condition_bad": reciprocal_condition(p.dt_bad),
        "reciprocal_condition_good": reciprocal_condition(p.dt_good),
        "velocity_settling_step_bad": settling_by_hand(p.P0, p.R) if loses(p.dt_bad) else None,
    }


def confused(p, found):
    """What a known confusion gives."""
    return {"velocity_variance_start": p.P0[1][1]}


def loses(dt):
    """Whether sin dt is zero, as far as a phase can be known that is given in double precision."""
    return abs(math.sin(dt)) <= max(1e-12, 8 * np.finfo(float).eps * dt)


def offset(dt):
    """How far dt is from the nearest multiple of π, s."""
    return 0.0 if loses(dt) else abs(math.remainder(dt, math.pi))


def reciprocal_condition(dt):
    """σ_min/σ_max of [H; HΦ] = [[1, 0], [cos d, sin d]]: its squared singular values are 1 ± |cos d|."""
    return math.tan(offset(dt) / 2)


def phases(dt, N):
    """cos jd, sin jd for j = 0…N."""
    j = np.arange(N + 1)
    if loses(dt):
        return (-1.0) ** (j * round(dt / math.pi)), np.zeros(N + 1)
    return np.cos(j * dt), np.sin(j * dt)


def determinant(P0):
    """det P0, without rounding where it is singular."""
    (a, b), (_b, c) = P0
    return a * c - b * b if a * c - b * b > 8 * np.finfo(float).eps * a * c else 0.0


def conditional(P0):
    """Variance of ẏ(0) once y(0) is known."""
    return determinant(P0) / P0[0][0] if P0[0][0] else P0[1][1]


def normal(dt, N):
    """Σ hᵀh for 1…N measurements, h = [cos jd, sin jd], and its determinant as a sum of squares, where nothing cancels."""
    c, s = phases(dt, N)
    G = np.cumsum(np.stack([c, s])[:, None, 1:] * np.stack([c, s])[None, :, 1:], axis=-1).transpose(2, 0, 1)
    return G, np.concatenate([[0.0], np.cumsum(np.cumsum(s[1:N] ** 2))])


def scaled(P0, R, dt, N):
    """P⁺/R of [y(0), ẏ(0)] after 1…N measurements, (R A + |A| adj G)/(R² + R tr AG + |A||G|), A = P0, for R > 0."""
    A, (G, detG), detA = np.array(P0), normal(dt, N), determinant(P0)
    adjugate = np.trace(G, axis1=1, axis2=2)[:, None, None] * np.eye(2) - G
    below = R**2 + R * np.einsum("ij,nji->n", A, G) + detA * detG
    return (R * A + detA * adjugate) / below[:, None, None]


def posterior(P0, R, dt, N):
    """P(t_i⁺), i = 1…N: that of the initial state, turned by the phase."""
    if R:
        start = R * scaled(P0, R, dt, N)
    else:  # its limit: nothing is left, or what a single measured combination leaves, if it was not known (cos(π/2) is 6e-17)
        (G, detG), A, detA = normal(dt, N), np.array(P0), determinant(P0)
        seen = np.einsum("ij,nji->n", A, G)
        adjugate = np.trace(G, axis1=1, axis2=2)[:, None, None] * np.eye(2) - G
        start = np.array([
            0 * A if detA * d > 0 else detA * g / t if t > 1e-24 * np.trace(A) else A for d, g, t in zip(detG, adjugate, seen, strict=True)
        ])
    turn = turns(dt, N)
    found = turn @ start @ turn.transpose(0, 2, 1)
    if not R:
        found[:, 0] = found[:, :, 0] = 0.0  # y has just been measured perfectly
    return found


def turns(dt, N):
    """Φ(t_i, t_0), i = 1…N."""
    c, s = phases(dt, N)
    return np.array([[c[1:], s[1:]], [-s[1:], c[1:]]]).transpose(2, 0, 1)


def gains(P0, R, dt, N):
    """K(t_i) = P(t_i⁺)Hᵀ/R, for R > 0."""
    turn = turns(dt, N)
    return (turn @ scaled(P0, R, dt, N) @ turn.transpose(0, 2, 1))[:, :, 0]


def all_at_once(z, P0, R, dt):
    """x̂(t_N⁺) (2, runs) from all measurements z (N, runs) at once, R > 0: turned from P⁺ Σ hᵀz/R at t0."""
    c, s = phases(dt, len(z))
    return turns(dt, len(z))[-1] @ scaled(P0, R, dt, len(z))[-1] @ np.stack([c[1:], s[1:]]) @ z


def inverse(P0, R, dt, N):
    """P⁻¹(t_i⁺), i = 1…N, for regular P0 and R > 0: what the start and the measurements say, turned by the phase."""
    turn = turns(dt, N)
    return turn @ (np.linalg.inv(np.array(P0)) + normal(dt, N)[0] / R) @ turn.transpose(0, 2, 1)


def settling_by_hand(P0, R):
    """The first i from which P22 = floor + P12²R/[P11(R + i P11)] stays within 1 % of its floor, at a losing period."""
    (a, b), floor = P0[0], conditional(P0)
    if not a or not b:
        return 1
    return max(1, math.ceil((b**2 * R / (0.01 * floor * a) - R) / a)) if floor else None
