"""The answers of lab 26 by hand: the second route, which owes nothing to the library."""

import math

import numpy as np
from ctlabs.tasks.answers import task25

mirrored, variance = task25.mirrored, task25.variance
#: (s − 1)², the plant's denominator.
PLANT = np.array([1.0, -2.0, 1.0])


def analytic(p):
    """The sheet's answers, by hand."""
    f, d = gain(p.q), gain(p.sigma)
    recovered = estimator(p.sigma, p.mu)
    return {
        "feedback_gain": [f, f],
        "filter_gain": [d, d],
        "cost_to_go": [[2 * f, f], [f, f]],
        "error_covariance": [[d, d], [d, 2 * d]],
        "cost": 5 * f * d * (f + d - 4),
        "cost_known": 5 * f * p.sigma,
        "loop_polynomial": characteristic(f, (d, d), 1.0).tolist(),
        "gain_margins": closed_margins(f, d),
        "known_state_margin": 2 / f,
        **margins(f, (d, d)),
        "cost_actual": cost(p, (d, d), p.m),
        "recovered_filter_gain": list(recovered),
        "recovered_cost": cost(p, recovered, 1.0),
        "recovered_gain_margins": gain_margins(f, recovered),
        "recovered_modulus": margins(f, recovered)["modulus_margin"],
    }


def price(answer):
    """What the filter of part (e) costs more than the best one, in per cent."""
    return round(100 * (answer["recovered_cost"] / answer["cost"] - 1), 6)


def confused(p, found):
    """What known confusions give: the necessary bounds alone, and the margins of a known state."""
    f, d = found["feedback_gain"][0], found["filter_gain"][0]
    return {
        "necessary_margins": [1 - (d + f - 4) / (2 * d * f), 1 + 1 / (d * f)],
        "half_cost": 0.5 * found["cost"],
    }


def gain(weight):
    """The root of g² = 4g + weight."""
    return 2 + math.sqrt(4 + weight)


def known_phase(f):
    """Where ω + 1/ω = f the known state's loop fs/(s − 1)² has the magnitude 1; its phase may be wrong there by this much, rad."""
    return math.acos(2 / f)


def known_delay(f):
    """The delay that uses up this phase at the higher of the two frequencies, s."""
    return 2 * known_phase(f) / (f + math.sqrt(f * f - 4))


def estimator(sigma, mu):
    """k1, k2 where the input has noise of strength mu too: s² + as + c is the stable factor of (s² − 1)² − σs² + μ."""
    c = math.sqrt(1 + mu)
    a = math.sqrt(2 + sigma + 2 * c)
    return a + 2, a + c + 1


def compensator(f, k):
    """N, D of −u = (N/D) z."""
    k1, k2 = k
    return np.array([f * (k1 + k2), -f * k1]), np.array([1.0, k1 + f - 2, (k1 - 1) * (f - 1) + k2 + f])


def characteristic(f, k, m):
    """(s − 1)²D + mN."""
    N, D = compensator(f, k)
    return np.polyadd(np.polymul(PLANT, D), m * N)


def closed_margins(f, d):
    """The exact bounds of Doyle's loop, with p = df, D = (d − 2)(f − 2), c = d + f − 4."""
    p, D, c = d * f, (d - 2) * (f - 2), d + f - 4
    # c/(8p)·[(2D + c) − √((2D + c)² + 16D)], written so that nothing cancels
    return [1 - 2 * c * D / (p * ((2 * D + c) + math.sqrt((2 * D + c) ** 2 + 16 * D))), 1 + 1 / p]


def gain_margins(f, k):
    """The bounds of m by Hurwitz: b0 > 0, b1 > 0, b1(b3 b2 − b1) > b3² b0, the last a quadratic inequality in m."""
    (n1, n0), (_, alpha, beta) = compensator(f, k)
    b3, b2, c0 = alpha - 2, beta - 2 * alpha + 1, alpha - 2 * beta
    roots = np.roots([-n1 * n1, n1 * (b3 * b2 - 2 * c0) - b3 * b3 * n0, c0 * b3 * b2 - c0 * c0 - b3 * b3 * beta])
    low, high = sorted(roots.real)
    return [float(max(low, -c0 / n1)), float(min(high, -beta / n0))]


def squared(a):
    """|a(jω)|² as a polynomial in ω²."""
    even = np.convolve(a, mirrored(a))[::2]
    return even * (-1.0) ** np.arange(len(even))[::-1]


def least(above, below):
    """min over ω of |above(jω)/below(jω)|, from the zeros of the derivative in ω²."""
    A, B = squared(above), squared(below)
    slope = np.polysub(np.polymul(np.polyder(A), B), np.polymul(A, np.polyder(B)))
    w = [x.real for x in np.roots(slope) if x.real > 0 and abs(x.imag) < 1e-6 * abs(x)]
    return math.sqrt(min(np.polyval(A, x) / np.polyval(B, x) for x in (*w, 0.0)))


def margins(f, k):
    """Phase and delay where |ℓ| = 1; the least distance of ℓ from −1; the balanced disk, the least 2|1 + ℓ|/|1 − ℓ|."""
    N, D = compensator(f, k)
    below = np.polymul(PLANT, D)
    equal = np.roots(np.polysub(squared(below), squared(N)))
    crossings = [math.sqrt(x.real) for x in equal if x.real > 0 and abs(x.imag) < 1e-9 * abs(x)]
    lags = [float(np.angle(-np.polyval(N, 1j * w) / np.polyval(below, 1j * w))) % (2 * math.pi) for w in crossings]
    whole, opposite = np.polyadd(below, N), np.polysub(below, N)
    return {
        "phase_margin": min(min(lag, 2 * math.pi - lag) for lag in lags),
        "delay_margin": min(lag / w for lag, w in zip(lags, crossings, strict=True)),
        "modulus_margin": min(1.0, least(whole, below)),
        "disk_margin": min(2.0, 2 * least(whole, opposite)),
    }


def cost(p, k, m):
    """J with the filter gain k where the input is m times as strong as believed, by the integrals of the loop; None where it is not stable."""
    f = gain(p.q)
    low, high = gain_margins(f, k)
    if not low < m < high:
        return None
    N, D = compensator(f, k)
    whole, s = characteristic(f, k, m), np.array([1.0, 0.0])
    y_w, y_v = np.polysub(np.polymul([2.0, -1.0], D), m * N), m * np.polymul(s, N)
    u_w, u_v = np.polymul(s, N), np.polymul(PLANT, N)
    yw, yv, uw, uv = (variance(b, whole) for b in (y_w, y_v, u_w, u_v))
    return p.q * (p.sigma * yw + yv) + p.sigma * uw + uv
