"""The answers of lab 8 by hand: the second route, which owes nothing to the library."""

import math

import mpmath
import numpy as np

#: Digits of the analytic part.
DIGITS = 60


def analytic(p):
    """The sheet's answers, by hand."""
    chosen = intensities(p.a, p.T, p.sigma_y2)
    limits = steady_variances(p.a, p.T, p.dt, p.R, p.sigma_y2)
    with mpmath.workdps(DIGITS):
        _a, _b, alpha, beta, phi, Q11, Q12, Q22 = chain(p.a, p.T, p.dt, p.sigma_y2)
        answer = {
            "Phi_truth": [[float(alpha), float(phi)], [0.0, float(beta)]],
            "Qd_truth": [[float(Q11), float(Q12)], [float(Q12), float(Q22)]],
            "disturbance_correlation": float(neighbours(p.a, p.T, p.dt)),
        }
    answer |= {"intensity_variant1": chosen[0], "intensity_variant2": chosen[1], "optimal_variance_steady": limits["optimal"]}
    C = autocovariance(p)
    answer["optimal_variance"] = conditioned(C, p.R)
    for i, Q in enumerate(chosen, start=1):
        answer[f"claimed_variance_steady_variant{i}"] = limits[f"claimed_variant{i}"]
        answer[f"true_variance_steady_variant{i}"] = limits[f"true_variant{i}"]
        claimed, gains = scalar_filter(p, Q)
        answer[f"claimed_variance_variant{i}"], answer[f"true_variance_variant{i}"] = claimed, weighted(p, C, gains)
    return answer


def confused(p, found):
    """What known confusions give: the strength of the noise that drives y for a covariance, one-sided spectra."""
    return {
        "strength": [[0.0, 0.0], [0.0, 2 * p.sigma_y2 / p.T]],
        "half_intensity1": found["intensity_variant1"] / 2,
        "half_intensity2": found["intensity_variant2"] / 2,
    }


def intensities(a, T, s2):
    """Q of both variants."""
    return 2 * s2 * T, 2 * s2 * T / (1 + a * T)


def growth(rate, t):
    """∫₀ᵗ e^(−rate·s) ds."""
    return -mpmath.expm1(-rate * t) / rate if rate else t


def chain(a, T, dt, s2):
    """a, b = 1/T, and Φ = [[α, φ], [0, β]], Qd of the true model in closed form, for a ≠ b and a = b."""
    a, b, t = mpmath.mpf(a), 1 / mpmath.mpf(T), mpmath.mpf(dt)
    Q, alpha, beta, r = 2 * mpmath.mpf(s2) * b, mpmath.exp(-a * t), mpmath.exp(-b * t), 2 * b
    if a == b:
        first = (1 - mpmath.exp(-r * t) * (1 + r * t)) / r**2
        second = (2 - mpmath.exp(-r * t) * (2 + 2 * r * t + (r * t) ** 2)) / r**3
        return a, b, alpha, beta, t * alpha, Q * second, Q * first, Q * growth(r, t)
    d = b - a
    Q11 = Q * (growth(2 * a, t) - 2 * growth(a + b, t) + growth(2 * b, t)) / d**2
    return a, b, alpha, beta, (alpha - beta) / d, Q11, Q * (growth(a + b, t) - growth(2 * b, t)) / d, Q * growth(r, t)


def from_rest(a, T, s2, t):
    """Var x(t) and E[xy](t) of the system that starts at rest, by integrating (d/dt) Var x = −2a Var x + 2E[xy]."""
    a, b, t = mpmath.mpf(a), 1 / mpmath.mpf(T), mpmath.mpf(t)
    both = mpmath.exp(-2 * a * t) * t if a == b else (mpmath.exp(-2 * a * t) - mpmath.exp(-(a + b) * t)) / (b - a)
    return 2 * s2 / (a + b) * (growth(2 * a, t) - both), s2 * growth(a + b, t)


def neighbours(a, T, dt):
    """Correlation of the disturbances x(t_i+1) − αx(t_i) of two successive intervals."""
    variance, cross = from_rest(a, T, 1, dt)
    return chain(a, T, dt, 1)[4] * cross / variance


def steady_variances(a, T, dt, R, s2):
    """The five steady variances after a measurement: optimal; claimed and true of both variants."""
    found = {}
    with mpmath.workdps(DIGITS):
        _a, _b, alpha, beta, phi, Q11, Q12, Q22 = chain(a, T, dt, s2)
        R = mpmath.mpf(R)
        found["optimal"] = float(optimal(alpha, beta, phi, (Q11, Q12, Q22), R))
        for i, Q in enumerate(intensities(mpmath.mpf(a), mpmath.mpf(T), mpmath.mpf(s2)), start=1):
            P, K = scalar_limit(alpha, Q * growth(2 * mpmath.mpf(a), mpmath.mpf(dt)), R)
            # With e = x̂ − x and m = E[ey] after a measurement, both constant.
            m = -(1 - K) * (phi * beta * s2 + Q12) / (1 - (1 - K) * alpha * beta)
            moved = phi**2 * s2 + Q11 - 2 * alpha * phi * m
            found[f"claimed_variant{i}"] = float(P)
            found[f"true_variant{i}"] = float(((1 - K) ** 2 * moved + K**2 * R) / (1 - ((1 - K) * alpha) ** 2))
    return found


def scalar_limit(alpha, Qd, R):
    """P̄⁺ and K̄ of the simplified filter: P̄⁻ is the positive root of P² + (R(1 − α²) − Q_d)P − Q_dR = 0."""
    half = (Qd - R * (1 - alpha**2)) / 2
    prior = half + mpmath.sqrt(half**2 + Qd * R)
    return prior * R / (prior + R), prior / (prior + R)


def optimal(alpha, beta, phi, Qd, R):
    """The optimal P̄⁺ of x by factoring the spectrum of z: R(S − R)/S with the variance S of the innovations.

    (1 − αB)(1 − βB)z is a moving average; its autocovariances n0, n1, n2 equal those of S½(1 − ζ1B)(1 − ζ2B) with both ζ
    inside the unit circle. With w = ζ + 1/ζ the ζ follow from a quadratic equation.
    """
    if not R:
        return R
    Q11, Q12, Q22 = Qd
    plus, times = alpha + beta, alpha * beta
    n0 = Q11 * (1 + beta**2) + phi**2 * Q22 - 2 * beta * phi * Q12 + R * (1 + plus**2 + times**2)
    n1, n2 = phi * Q12 - beta * Q11 - R * plus * (1 + times), R * times
    half = (n1 + mpmath.sign(n1) * mpmath.sqrt(n1**2 - 4 * n2 * (n0 - 2 * n2))) / -2
    S = n0 + 2 * n1 + 2 * n2  # the spectrum at zero frequency
    for w in (half / n2, (n0 - 2 * n2) / half):
        root = mpmath.sqrt(w * w - 4)
        outside = max((w + root) / 2, (w - root) / 2, key=abs)
        S /= (1 - 1 / outside) ** 2
    return R * (1 - R / mpmath.re(S))


def autocovariance(p):
    """E[x(t_i)x(t_j)], i, j = 1…steps, from rest."""
    with mpmath.workdps(DIGITS):
        start = [from_rest(p.a, p.T, p.sigma_y2, i * mpmath.mpf(p.dt)) for i in range(1, p.steps + 1)]
        move = [chain(p.a, p.T, i * mpmath.mpf(p.dt), 1)[2::2] for i in range(p.steps)]
        C = np.zeros((p.steps, p.steps))
        for j, (variance, cross) in enumerate(start):
            for i in range(j, p.steps):
                C[i, j] = C[j, i] = move[i - j][0] * variance + move[i - j][1] * cross
    return C


def conditioned(C, R):
    """The optimal variance of x(t_i) given z(t_1)…z(t_i), by conditioning the joint Gaussian distribution."""
    if not R:
        return [0.0] * len(C)
    left = [np.linalg.solve(C[:i, :i] + R * np.eye(i), C[:i, i - 1]) for i in range(1, len(C) + 1)]
    return [R * weights[-1] for weights in left]  # the last weight is the gain, and P⁺ = KR


def scalar_filter(p, Q):
    """What a simplified filter claims after measurements 1…steps, and its gains; from P(0) = 0."""
    alpha2, Qd = math.exp(-2 * p.a * p.dt), Q * float(growth(2 * p.a, p.dt))
    step = np.array([[p.R * alpha2, p.R * Qd], [alpha2, Qd + p.R]])
    step /= np.abs(np.linalg.eigvals(step)).max()
    claimed = [float(above / below) for above, below in (np.linalg.matrix_power(step, i)[:, 1] for i in range(p.steps + 1))]
    prior = [alpha2 * P + Qd for P in claimed[:-1]]
    return claimed[1:], [P / (P + p.R) for P in prior]


def weighted(p, C, gains):
    """The true variance of x̂ − x: the estimate is a weighted sum of all measurements so far, whose covariance is C + R."""
    weights, found = np.zeros(p.steps), []
    for i, K in enumerate(gains):
        weights = (1 - K) * math.exp(-p.a * p.dt) * weights
        weights[i] = K
        error = weights - np.eye(p.steps)[i]
        found.append(float(error @ C @ error + p.R * weights @ weights))
    return found
