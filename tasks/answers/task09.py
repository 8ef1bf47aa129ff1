"""The answers of lab 9 by hand: the second route, which owes nothing to the library."""

import math

import mpmath
from scipy import integrate, optimize
from scipy.special import ndtr

#: Q of the input, in units of b².
STRENGTH = 2.0
#: Measurements that the dense check takes together.
DENSE = 20
DIGITS = 60


def analytic(p):
    """The sheet's answers, by hand, in units of b²."""
    with mpmath.workdps(DIGITS):
        F, g, h = circuit(p, "ladder")
        Phi, Qd = sampled(F, g, p.dt)
        perfect, noisy = (scalar_equations(F, g, h, p.dt, R, p.steps) for R in (0.0, p.R_over_b2))
        return {
            "Phi": floats(Phi),
            "Qd": floats(Qd),
            "U1_variance_unmeasured": [float(sampled(F, g, i * mpmath.mpf(p.dt))[1][0, 0]) for i in range(1, p.steps + 1)],
            "posterior_steady_perfect": perfect_limit(Phi, Qd),
            **{f"{name}_perfect": value for name, value in perfect.items()},
            **{f"{name}_noisy": value for name, value in noisy.items()},
        }


def confused(p, found):
    """What known confusions give: the strength of the noise for its covariance, ΦK for K."""
    rows = [(name, [[sum(f * k for f, k in zip(row, K, strict=True)) for row in found["Phi"]] for K in found[f"gain_{name}"]])
            for name in ("perfect", "noisy")]
    return {"strength": [[STRENGTH / (p.R1 * p.C1) ** 2, 0.0], [0.0, 0.0]]} | {f"predictor_gain_{name}": K for name, K in rows}


def floats(matrix):
    """An mpmath matrix as lists."""
    return [[float(x) for x in row] for row in matrix.tolist()]


def circuit(p, kind):
    """F, the column G and the row H of the three readings of the missing figure."""
    R1, R2, C1, C2 = (mpmath.mpf(x) for x in (p.R1, p.R2, p.C1, p.C2))
    load = 0 if kind == "buffered" else 1 / (R2 * C1)
    F = mpmath.matrix([[-1 / (R1 * C1) - load, load], [1 / (R2 * C2), -1 / (R2 * C2)]])
    return F, mpmath.matrix([1 / (R1 * C1), 0]), (1, -1) if kind == "across" else (0, 1)


def sampled(F, g, t):
    """Φ by Newton's divided difference of e^(λt), and Q_d = P∞ − ΦP∞Φᵀ."""
    middle, half = (F[0, 0] + F[1, 1]) / 2, mpmath.sqrt(((F[0, 0] - F[1, 1]) / 2) ** 2 + F[0, 1] * F[1, 0])
    fast, slow = middle - half, middle + half
    slope = (mpmath.exp(slow * t) - mpmath.exp(fast * t)) / (slow - fast) if half else t * mpmath.exp(middle * t)
    Phi = mpmath.exp(fast * t) * mpmath.eye(2) + (F - fast * mpmath.eye(2)) * slope
    P = stationary(F, g)
    return Phi, P - Phi * P * Phi.T


def stationary(F, g):
    """P∞ from FP + PFᵀ + 2ggᵀ = 0, three linear equations."""
    A = mpmath.matrix([[2 * F[0, 0], 2 * F[0, 1], 0], [F[1, 0], F[0, 0] + F[1, 1], F[0, 1]], [0, 2 * F[1, 0], 2 * F[1, 1]]])
    p11, p12, p22 = mpmath.lu_solve(A, -STRENGTH * mpmath.matrix([g[0] ** 2, g[0] * g[1], g[1] ** 2]))
    return mpmath.matrix([[p11, p12], [p12, p22]])


def scalar_equations(F, g, h, dt, R, steps):
    """The filter's equations element by element, from discharged capacitors."""
    (Phi, Qd), (half, Q_half) = sampled(F, g, mpmath.mpf(dt)), sampled(F, g, mpmath.mpf(dt) / 2)
    P, found = mpmath.zeros(2), {name: [] for name in ("U1_variance_prior", "U1_variance_posterior", "gain", "middle")}
    for _i in range(steps):
        found["middle"].append(float((half * P * half.T + Q_half)[0, 0]))
        P = Phi * P * Phi.T + Qd
        f1, f2 = P[0, 0] * h[0] + P[0, 1] * h[1], P[1, 0] * h[0] + P[1, 1] * h[1]
        s = h[0] * f1 + h[1] * f2 + R
        K1, K2 = (f1 / s, f2 / s) if math.isfinite(R) else (0, 0)
        found["U1_variance_prior"].append(float(P[0, 0]))
        P = mpmath.matrix([[P[0, 0] - K1 * f1, P[0, 1] - K1 * f2], [P[0, 1] - K1 * f2, P[1, 1] - K2 * f2]])
        found["U1_variance_posterior"].append(float(P[0, 0]))
        found["gain"].append([float(K1), float(K2)])
    return found


def fraction(Phi, Qd):
    """(A, B, C, D): after perfect measurements P11⁺ follows p ← (Ap + B)/(Cp + D)."""
    a, c, q, m, s = Phi[0, 0], Phi[1, 0], Qd[0, 0], Qd[0, 1], Qd[1, 1]
    return q * c**2 + s * a**2 - 2 * m * a * c, q * s - m**2, c**2, s


def perfect_limit(Phi, Qd):
    """The positive root of Cp² + (D − A)p − B = 0."""
    A, B, C, D = fraction(Phi, Qd)
    return float(2 * B / (D - A + mpmath.sqrt((D - A) ** 2 + 4 * B * C)))


def perfect_powers(p):
    """P11⁺ after 1…steps perfect measurements by powers of the fraction's matrix."""
    with mpmath.workdps(DIGITS):
        A, B, C, D = fraction(*sampled(*circuit(p, "ladder")[:2], p.dt))
        powers = [mpmath.matrix([[A, B], [C, D]]) ** i for i in range(1, p.steps + 1)]
        return [float(M[0, 1] / M[1, 1]) for M in powers]


def dense(p, R):
    """Var(U1 | z1…zi) by conditioning the joint Gaussian distribution of all samples."""
    if math.isinf(R):
        return analytic(p)["U1_variance_unmeasured"][:DENSE]
    n = min(p.steps, DENSE)
    with mpmath.workdps(DIGITS):
        F, g, _h = circuit(p, "ladder")
        at = [sampled(F, g, i * mpmath.mpf(p.dt)) for i in range(1, n + 1)]
        own = [Qd for _Phi, Qd in at]  # the covariance at t_i, from nothing
        C, cross = mpmath.zeros(n), mpmath.zeros(n)
        for j in range(n):
            for i in range(j, n):
                both = at[i - j - 1][0] * own[j] if i > j else own[j]
                C[i, j] = C[j, i] = both[1, 1] + (R if i == j else 0)
                cross[i, j] = both[0, 1]
        L, left = mpmath.cholesky(C), []
        for i in range(n):
            y = []
            for j in range(i + 1):
                y.append((cross[i, j] - mpmath.fsum(L[j, k] * y[k] for k in range(j))) / L[j, j])
            left.append(float(own[i][0, 0] - mpmath.fsum(x * x for x in y)))
        return left


def unannounced(left, limit, k):
    """P(U1 ≥ limit, no alarm) by the voltage; U1 in its own standard deviations, ``left`` = P/V, margin k√left."""
    if left <= 0:
        return 0.0
    if left >= 1:  # the estimate is 0
        return float(ndtr(-limit)) if k < limit else 0.0
    sd = math.sqrt(left * (1 - left))
    return integrate.quad(lambda u: math.exp(-u * u / 2) / math.sqrt(2 * math.pi) * ndtr((limit - k * math.sqrt(left) - (1 - left) * u) / sd), limit, limit + 12, epsabs=0, epsrel=1e-11, limit=500)[0]


def by_estimate(left, limit, k):
    """The same by the estimate, which has the variance 1 − left."""
    if left <= 0:
        return 0.0
    if left >= 1:
        return 0.5 * math.erfc(limit / math.sqrt(2)) if k < limit else 0.0
    sd, end = math.sqrt(1 - left), limit - k * math.sqrt(left)
    return integrate.quad(lambda e: math.exp(-0.5 * e * e) * ndtr((sd * e - limit) / math.sqrt(left)), -12.0, end / sd, epsabs=0, epsrel=1e-11, limit=500)[0] / math.sqrt(2 * math.pi)


def margin(left, limit, share=0.01):
    """The k with which at most ``share`` of the dangerous moments is missed."""
    if left <= 0:
        return 0.0
    if left >= 1:
        return limit
    if unannounced(left, limit, 0.0) <= share * ndtr(-limit):
        return 0.0
    return optimize.brentq(lambda k: unannounced(left, limit, k) - share * ndtr(-limit), 0.0, 10 + limit / math.sqrt(left))
