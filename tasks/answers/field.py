"""The answers of the lab field by hand: the second route, which owes nothing to the library."""

import math

import numpy as np
from scipy.optimize import brentq, minimize_scalar
from scipy.signal import lfilter

#: The printed table: α = β, σ_n, σ̂_ε, σ_n/σ̂_ε of variants 1-10; row 5 prints 0.335, which contradicts its ratio: 0.355.
PRINTED = (
    (0.05, 0.5, 0.15, 3.35),
    (0.05, 1.0, 0.22, 4.5),
    (0.05, 1.5, 0.265, 5.65),
    (0.05, 2.0, 0.30, 6.73),
    (0.05, 3.0, 0.355, 8.45),
    (0.1, 0.5, 0.194, 2.58),
    (0.1, 1.0, 0.28, 3.55),
    (0.1, 1.5, 0.35, 4.3),
    (0.1, 2.0, 0.40, 5.05),
    (0.1, 3.0, 0.46, 6.55),
)
#: Waves ω looked at by the hand calculation, radians per step.
OMEGA = np.unique(np.concatenate([np.linspace(0.0, np.pi, 1025), np.geomspace(1e-9, np.pi, 1024)]))


def analytic(p):
    """The printed matrices and equations, taken literally; stability by the waves' amplification from node to node."""
    here = printed_filter(p, p.alpha, p.beta, p.sigma_n)
    several = [printed_filter(p, alpha, alpha, sigma_n) for alpha, sigma_n, *_rest in PRINTED]
    Phi, noise = printed_matrices(p, p.alpha, p.beta)
    spread, X = [0.0], np.zeros_like(Phi)
    with np.errstate(over="ignore", invalid="ignore"):
        for _k in range(p.m):
            X = Phi @ X @ Phi.T + noise
            spread.append(np.diag(X)[: p.N1 + 1].mean())
    expected = math.sqrt(np.mean(spread)) if np.isfinite(spread).all() else None
    return {
        "filters": several,
        "here": here,
        "sigma_eps_true_by_variant": [root_mean(each["true"]) for each in several],
        "sigma_eps_bound_by_variant": [root_mean(each["bound"]) for each in several],
        "sigma_z_expected": expected,
        **asked(p, here),
    }


def asked(p, here=None):
    """What belongs to the given parameters alone; ``here`` is their filter, if it is known."""
    here = here or printed_filter(p, p.alpha, p.beta, p.sigma_n)
    return {
        "sigma_eps_true": root_mean(here["true"]),
        "sigma_eps_filter": root_mean(here["claimed"][1:]),
        "sigma_eps_bound": root_mean(here["bound"]),
        **stability_by_hand(p),
        "stationary_variance_mean": stationary_by_recursion(p),
    }


def printed_coefficients(p, alpha, beta, dt=None):
    """e0…e4 of eq. 17."""
    dt = p.dt if dt is None else dt
    a00, a01, a10, a11 = -alpha * beta / p.b20, -alpha / p.b20, -beta / p.b20, -p.b11 / p.b20
    e4 = math.sqrt(4 * alpha * beta) / p.b20 * dt
    return 1 + dt * (a10 + a11 / p.h), a11 * dt / p.h, (a00 + a01 / p.h) * dt, a01 * dt / p.h, e4


def printed_matrices(p, alpha, beta):
    """Φ of eq. 25-27 and GQGᵀ of eq. 28 and 34, written element by element."""
    e0, e1, e2, e3, e4 = printed_coefficients(p, alpha, beta)
    N = p.N1 + 1
    Phi, G = np.zeros((2 * N, 2 * N)), np.zeros((2 * N, N))
    for i in range(N):
        Phi[i, i] = 1.0
        if i == 0:
            Phi[N, N] = 1.0
            continue
        Phi[i, N + i] = p.dt
        Phi[N + i, i - 1], Phi[N + i, i] = -e3, e2
        Phi[N + i, N + i - 1], Phi[N + i, N + i] = -e1, e0
        G[N + i, i] = e4
    return Phi, p.sigma_eta**2 * G @ G.T


def printed_filter(p, alpha, beta, sigma_n):
    """Eq. 47-49 from P0·I and from 0, and the mean square error of the first filter on a field that starts at rest."""
    Phi, noise = printed_matrices(p, alpha, beta)
    N = p.N1 + 1
    one, H, R = np.eye(2 * N), np.eye(N, 2 * N), sigma_n**2 * np.eye(N)
    claimed, bound, true = p.P0 * one, 0.0 * one, 0.0 * one
    gains, rows = [np.zeros((2 * N, N))], {"claimed": [], "bound": [], "true": []}
    for k in range(p.m + 1):
        if k:
            K, claimed = printed_step(Phi, noise, H, R, claimed)
            bound = printed_step(Phi, noise, H, R, bound)[1]
            left = one - K @ H
            true = left @ (Phi @ true @ Phi.T + noise) @ left.T + K @ R @ K.T
            gains.append(K)
        for name, P in (("claimed", claimed), ("bound", bound), ("true", true)):
            rows[name].append(np.diag(P)[:N])
    return {"Phi": Phi, "gains": gains, **{name: np.array(row) for name, row in rows.items()}}


def printed_step(Phi, noise, H, R, P):
    """K and P of eq. 47-49."""
    P = Phi @ P @ Phi.T + noise
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    P = (np.eye(len(P)) - K @ H) @ P
    return K, 0.5 * (P + P.T)


def printed_estimate(found, data):
    """ẑ of eq. 46 for one record (m+1, N1+1)."""
    X, rows, N = np.zeros(len(found["Phi"])), [], data.shape[1]
    for k, K in enumerate(found["gains"]):
        if k:
            X = found["Phi"] @ X
            X = X + K @ (data[k] - X[:N])
        rows.append(X[:N])
    return np.array(rows)


def root_mean(variances):
    """Root of the mean over all nodes and times."""
    return float(np.sqrt(np.mean(variances)))


def passed_on(p, q, dt):
    """|a(q)|: how much larger node i's oscillation qᵏ is than its neighbour's."""
    e0, e1, _e2, e3, _e4 = printed_coefficients(p, p.alpha, p.beta, dt)
    e2 = printed_coefficients(p, p.alpha, p.beta, dt)[2]
    return np.abs((e1 * (q - 1) + e3 * dt) / ((q - 1) * (q - e0) - e2 * dt))


def largest_passed_on(p, dt, radius=1.0):
    """The largest |a(q)| on |q| = radius."""
    values = passed_on(p, radius * np.exp(1j * OMEGA), dt)
    best = int(np.argmax(values))
    ends = OMEGA[max(best - 1, 0)], OMEGA[min(best + 1, len(OMEGA) - 1)]
    inside = minimize_scalar(lambda w: -passed_on(p, radius * np.exp(1j * w), dt), bounds=ends, method="bounded",
                             options={"xatol": 1e-13})
    return max(float(values[best]), -float(inside.fun))


def stability_by_hand(p):
    """Schur's conditions for the block; for the waves the radius and the step at which some |a| is 1."""
    e0, _e1, e2, _e3, _e4 = printed_coefficients(p, p.alpha, p.beta)
    trace, det = 1 + e0, e0 - e2 * p.dt
    gap = trace**2 / 4 - det
    radius = abs(trace) / 2 + math.sqrt(gap) if gap >= 0 else math.sqrt(det)
    d, c = (e0 - 1) / p.dt, e2 / p.dt  # the block is I + dt·[[0, 1], [c, d]] with c, d < 0
    real = d * d + 4 * c
    eigenvalue = 4 / (-d + math.sqrt(real)) if real >= 0 else d / c

    def excess(r):
        return largest_passed_on(p, p.dt, r) - 1

    top = 2 * max(radius, 1.0)
    while excess(top) > 0:
        top *= 2
    low = radius * (1 + 1e-12)
    factor = brentq(excess, low, top, xtol=1e-15, rtol=1e-14) if excess(low) > 0 else radius
    low, high = 1e-6 * eigenvalue, eigenvalue * (1 - 1e-12)
    if largest_passed_on(p, low) > 1 + 1e-12:
        step = 0.0
    elif largest_passed_on(p, high) <= 1:
        step = eigenvalue
    else:
        step = brentq(lambda dt: largest_passed_on(p, dt) - 1, low, high, xtol=1e-15, rtol=1e-14)
    return {
        "spectral_radius": radius, "von_neumann_factor": factor,
        "dt_limit_eigenvalue": eigenvalue, "dt_limit_von_neumann": step,
    }


def stationary_by_recursion(p):
    """Mean over the nodes of Σ_k (answer to a unit of noise)², node after node by z_i = a(q) z_{i-1}; None if unstable."""
    e0, e1, e2, e3, e4 = printed_coefficients(p, p.alpha, p.beta)
    D = [1.0, -(1 + e0), e0 - e2 * p.dt]
    radius = np.abs(np.roots(D)).max()
    if radius >= 1:
        return None
    steps = min(int(50 / (1 - radius)) + 60 * p.N1, 1 << 21)
    answer = np.zeros(steps)
    answer[2] = e4 * p.dt
    answer, total, variances = lfilter([1.0], D, answer), 0.0, []
    for _i in range(p.N1):
        total += p.sigma_eta**2 * float(answer @ answer)
        variances.append(total)
        answer = lfilter([0.0, -e1, e1 - e3 * p.dt], D, answer)
    return float(np.mean(variances))
