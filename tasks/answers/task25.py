"""The answers of lab 25 by hand: the second route, which owes nothing to the library."""

import math

import numpy as np
import scipy.integrate
import scipy.optimize

#: The autopilot of lab 13: h(s)/h_c(s) = (B1 s + B0)/(s² + A1 s + A0).
B1, B0, A1, A0 = 0.3, 0.003, 0.006, 0.003
NUMERATOR, DENOMINATOR = np.array([B1, B0]), np.array([1.0, A1, A0])
F = np.array([[-A1, 1.0], [-A0, 0.0]])
B = np.array([[B1], [B0]])


def analytic(p):
    """The sheet's answers, by hand."""
    q, h = p.Q, p.dt
    disturbance, sensor = parts(p, h)
    S = math.sqrt(p.Qu + h * h / 12)
    return {
        "sampled_weights": [[h, h**2 / 2], [h**2 / 2, h**3 / 3]],
        "cost_between": q * h**2 / 2,
        "gain_times_period": GAIN,
        "feedback_gain": GAIN / h,
        "regulator_pole": 1 - GAIN,
        "cost_minimum": q * h * (3 + math.sqrt(3)) / 6,
        "gains_naive": [1 / h, NO_CROSS_TERM / h],
        "costs_naive": [q * h * cost_of_gain(g) for g in (1.0, NO_CROSS_TERM)],
        "costs_believed": [q * h, q * h * (ROOT + 0.5)],
        "weighed_gain": (S + h / 2) / (S * h + h * h / 3 + p.Qu),
        "cost_disturbance": disturbance,
        "cost_sensor": sensor,
        "cost_delay": q * p.tau,
        "cost_sampled": disturbance + sensor + q * p.tau,
        "cost_continuous": q * math.sqrt(p.Qu) + math.sqrt(q * p.Rc),
        "period_of_a_tenth": tenth(p),
        **autopilot(p),
    }


def confused(p, found):
    """What known confusions give: the cost at the samples alone, and the strength for the variance of a sampled measurement."""
    S, h = math.sqrt(p.Qu + p.dt**2 / 12), p.dt
    return {
        "minimum_per_period": found["cost_minimum"] * h,
        "deadbeat_gain": 1 / h,
        "at_samples": S * p.Q,
    }


#: The best gain times the period, (3 + √3)/(2 + √3): s² = 1/12 for S = sh, and Lh = (s + 1/2)/(s + 1/3).
GAIN = (3 + math.sqrt(3)) / (2 + math.sqrt(3))
#: Without the cross term s² − s = 1/3, and Lh = s/(s + 1/3).
ROOT = (1 + math.sqrt(7 / 3)) / 2
NO_CROSS_TERM = ROOT / (ROOT + 1 / 3)


def cost_of_gain(g):
    """The mean cost per second of u = −(g/h)x over qh: what is left of the last sample, and what the noise adds until the next one."""
    return (1 - g + g * g / 3) / (g * (2 - g)) + 0.5


def between(g, s):
    """Var x over qh at the fraction s of a period."""
    return (1 - g * s) ** 2 / (g * (2 - g)) + s


def parts(p, h):
    """What the disturbance costs a regulator that knows the state at every moment of sampling and between, and what the sensor costs."""
    return p.Q * math.sqrt(p.Qu + h * h / 12), math.sqrt(p.Q * p.Rc + p.Q**2 * h * h / 4)


def tenth(p):
    """The period at which sampling costs a tenth of the continuous regulator's cost; None where that is 0."""
    limit = p.Q * math.sqrt(p.Qu) + math.sqrt(p.Q * p.Rc)
    if not limit:
        return None
    # Each part is at least a share of its own term in h, so the root lies below where those alone make up the tenth.
    high = 1.1 * limit / (p.Q * (math.sqrt(1 / 12) + 0.5)) * 4
    return float(scipy.optimize.brentq(lambda h: sum(parts(p, h)) - 1.1 * limit, 0.0, high, xtol=1e-15 * high, rtol=1e-14))


def variances(Q, R, P0, steps):
    """P⁺ of the sampled integrator at t0…: each step is the fraction R(P + Q)/(P + Q + R), so i steps are the i-th power of its matrix."""
    step = np.array([[R, R * Q], [1.0, Q + R]])
    step /= np.abs(np.linalg.eigvals(step)).max()
    powers = [np.linalg.matrix_power(step, i) @ [P0, 1.0] for i in range(steps + 1)]
    return [float(above / below) for above, below in powers]


# The autopilot ----------------------------------------------------------------------------------------------------------


def autopilot(p):
    """The autopilot's altitude regulated: left alone, continuously, and sampled."""
    L, K, limit, altitude = continuous(p)
    cost, sampled_gain = sampled(p, p.dt_a)
    return {
        "altitude_variance_free": p.N_c * (B1**2 * A0 + B0**2) / (2 * A0 * A1),
        "autopilot_gain": L,
        "autopilot_filter_gain": K,
        "autopilot_cost_continuous": limit,
        "altitude_variance": altitude,
        "autopilot_gain_sampled": sampled_gain,
        "autopilot_cost": cost,
        "autopilot_cost_delayed": sampled(p, p.dt_a, p.dt_a)[0],
        "losing_period": math.pi / math.sqrt(A0 - A1**2 / 4),
    }


def factor(ratio):
    """c, a of s² + as + c, the stable factor of dd~ + ratio·nn~: c² = a0² + ratio·b0², a² = a1² + ratio·b1² − 2a0 + 2c."""
    c = math.sqrt(A0**2 + ratio * B0**2)
    return c, math.sqrt(A1**2 + ratio * B1**2 + 2 * (c - A0))


def continuous(p):
    """L, K by spectral factorisation; the cost per second and the variance of the altitude by the integrals of the closed loop."""
    c, a = factor(1 / p.Qu_a)
    # det(sI − F + BL) = s² + (a1 + b1 l1 + b0 l2)s + a0 + b0 l1 + (a1 b0 − a0 b1) l2
    L = np.linalg.solve([[B1, B0], [B0, A1 * B0 - A0 * B1]], [a - A1, c - A0])
    c, a = factor(p.N_c / p.N_m)
    K = np.array([a - A1, c - A0])
    M = F - B @ L[None] - np.outer(K, [1.0, 0.0])
    # The controller −u = (N/D) z with N = L adj(sI − M) K, D = det(sI − M)
    D = np.array([1.0, -M[0, 0] - M[1, 1], M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0]])
    N = np.array([L @ K, L @ (np.array([[-M[1, 1], M[0, 1]], [M[1, 0], -M[0, 0]]]) @ K)])
    n, d = NUMERATOR, DENOMINATOR
    whole = np.polyadd(np.polymul(d, D), np.polymul(n, N))
    w_h, both, v_u = (variance(np.polymul(*pair), whole) for pair in ((n, D), (n, N), (d, N)))
    altitude = p.N_c * w_h + p.N_m * both
    return L.tolist(), K.tolist(), altitude + p.Qu_a * (p.N_c * both + p.N_m * v_u), altitude


def variance(b, a):
    """(1/2πj)∫ b(s)b(−s)/[a(s)a(−s)] ds: with bb~ = xa~ + x~a, x of degree n − 1, it is the quotient of the leading coefficients of x and a."""
    n = len(a) - 1
    square = np.convolve(b, mirrored(b))
    wanted = np.concatenate([np.zeros(2 * n - len(square)), square])
    columns = [np.convolve(x, mirrored(a)) + np.convolve(mirrored(x), a) for x in np.eye(n)]
    even = slice(1, None, 2)  # the other coefficients are 0
    return float(np.linalg.solve(np.array(columns).T[even], wanted[even])[0] / a[0])


def mirrored(a):
    """The coefficients of a(−s)."""
    return np.asarray(a) * (-1.0) ** np.arange(len(a))[::-1]


def moved(A, Q, h):
    """e^{Ah} and ∫ e^{As}Qe^{Aᵀs} ds over a period (Van Loan)."""
    n = len(A)
    E = exponential(np.block([[-A, Q], [np.zeros((n, n)), A.T]]) * h)
    Phi = E[n:, n:].T
    found = Phi @ E[:n, n:]
    return Phi, 0.5 * (found + found.T)


def exponential(M):
    """e^M by its series, of a part of M that is squared again and again."""
    halvings = max(0, math.ceil(math.log2(np.abs(M).sum(axis=1).max())) + 2)
    M = M / 2.0**halvings
    found = term = np.eye(len(M))
    for k in range(1, 20):
        term = term @ M / k
        found = found + term
    for _ in range(halvings):
        found = found @ found
    return found


def riccati(A, G, H):
    """S = AᵀS(I + GS)⁻¹A + H by doubling: after k steps S of a task of 2ᵏ steps."""
    while True:
        inside = np.linalg.inv(np.eye(len(A)) + G @ H)
        H, G, A, before = H + A.T @ H @ inside @ A, G + A @ inside @ G @ A.T, A @ inside @ A, H
        if np.abs(H - before).max() <= 1e-16 * np.abs(H).max():
            return 0.5 * (H + H.T)


def sampled(p, h, tau=0.0):
    """The cost per second of the sampled autopilot, whose answer acts tau s after the measurement; and its gain."""
    whole = np.block([[F, B], [np.zeros((1, 3))]])
    Phi, weights = moved(whole.T, np.diag([1.0, 0.0, p.Qu_a]), h)
    A, G = Phi.T[:2, :2], Phi.T[:2, 2:]
    Qx, N, Qu = weights[:2, :2], weights[:2, 2:], weights[2:, 2:]
    noise = moved(F, p.N_c * B @ B.T, h)[1]
    without = G / Qu @ N.T  # the input that the cross term asks for is taken out
    S = riccati(A - without, G @ G.T / Qu, Qx - N @ N.T / Qu)
    W = G.T @ S @ G + Qu
    L = np.linalg.solve(W, G.T @ S @ A + N.T)
    prior = riccati(A.T, np.diag([h / p.N_m, 0.0]), noise)
    P = prior - np.outer(prior[:, 0], prior[0]) / (prior[0, 0] + p.N_m / h)
    if tau:  # when the input begins to act, the state is known as well as a prediction of tau s
        over, more = moved(F, p.N_c * B @ B.T, tau)
        P = over @ P @ over.T + more
    rest = scipy.integrate.quad(lambda t: (h - t) * impulse(t) ** 2, 0, h, epsabs=0, epsrel=1e-11, limit=400)[0]
    return float((np.trace(S @ noise) + (W @ L @ P @ L.T)[0, 0] + p.N_c * rest) / h), L[0].tolist()


def impulse(t):
    """The altitude's answer to an impulse of the command."""
    a = A1 / 2
    w = math.sqrt(A0 - a * a)
    return math.exp(-a * t) * (B1 * math.cos(w * t) + (B0 - B1 * a) / w * math.sin(w * t))
