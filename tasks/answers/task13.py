"""The answers of lab 13 by hand: the second route, which owes nothing to the library."""

import math

import mpmath
import numpy as np
import scipy.integrate
import sympy

#: The transfer function h(s)/h_c(s) = (b1 s + b0)/(s² + a1 s + a0) of the sheet.
B1, B0, A1, A0 = 0.3, 0.003, 0.006, 0.003
#: Times at which variances are given, s.
TIMES = (1.0, 10.0, 60.0, 300.0)


def analytic(p):
    """The sheet's answers, by hand: spectral factorisation for limits, closed forms for what leads to them."""
    with mpmath.workdps(60):
        d1, d0, P = two_state_limit(p.N_c, p.N_m)
        roots = filter_roots(d1, d0)
        far = float(30 / min(abs(root.real) for root in roots))
        *at, last = covariance(p.N_c, p.N_m, p.var_hc0, (*TIMES, far))
        prior, posterior, gain = sampled_limit(p.N_c, p.N_m, p.dt)
        return {
            "altitude_variance_steady_continuous": float(P[0, 0]),
            "altitude_gain_steady_continuous": float(P[0, 0] / p.N_m),
            "steady_covariance": np.array(P.tolist(), dtype=float)[:2, :2],
            "filter_polynomial": [1.0, float(d1), float(d0)],
            "filter_poles_continuous": sorted([float(z.real), float(z.imag)] for z in roots),
            "altitude_variance_prior_steady": prior,
            "altitude_variance_posterior_steady": posterior,
            "altitude_gain_steady": gain,
            "altitude_variance_continuous": [float(C[0, 0]) for C in at],
            "command_variance_continuous": [float(C[2, 2]) for C in at],
            "covariance_continuous": [np.array(C.tolist(), dtype=float) for C in at],
            "far": far,
            "far_covariance": np.array(last.tolist(), dtype=float),
            "command_time_origin": float(far - (p.N_c + p.N_m) / last[2, 2]) if p.var_hc0 else None,
        }


def two_state_limit(N_c, N_m):
    """d1, d0 of the filter's polynomial d(s)d(−s) = a(s)a(−s) + (N_c/N_m) b(s)b(−s), and the covariance (of 3 states)."""
    a1, a0, b1, b0, ratio = *map(mpmath.mpf, (A1, A0, B1, B0)), mpmath.mpf(N_c) / N_m
    d0 = mpmath.sqrt(a0**2 + ratio * b0**2)
    d1 = mpmath.sqrt(a1**2 - 2 * a0 + ratio * b1**2 + 2 * d0)
    P11, P12 = N_m * (d1 - a1), N_m * (d0 - a0)
    # The equation of dP12/dt = 0 gives P22.
    P22 = a1 * P12 + a0 * P11 - b1 * b0 * N_c + P11 * P12 / N_m
    return d1, d0, mpmath.matrix([[P11, P12, 0], [P12, P22, 0], [0, 0, 0]])


def filter_roots(d1, d0):
    """The filter's poles; equal ones are set apart by less than any double shows."""
    apart = mpmath.sqrt(d1**2 - 4 * d0 or d0 * mpmath.mpf(10) ** -40)
    return [mpmath.mpc(-d1 - apart) / 2, mpmath.mpc(-d1 + apart) / 2]


def covariance(N_c, N_m, var, times):
    """P(t) of the three states: with X = P − P∞, A = F − KH and Γ = ∫e^{Aᵀs}HᵀHe^{As}ds/N_m, X = e^{At}X0(I + ΓX0)⁻¹e^{Aᵀt}."""
    d1, d0, limit = two_state_limit(N_c, N_m)
    a1, b1, b0 = map(mpmath.mpf, (A1, B1, B0))
    q = mpmath.matrix([1, a1 - b1, 1])  # settled flight at the commanded altitude, as b0 = a0
    X0, identity = var * q * q.T - limit, mpmath.eye(3)
    roots = [*filter_roots(d1, d0), mpmath.mpc(0)]
    # Eigenvectors of A = [[−d1, 1, b1], [−d0, 0, b0], [0, 0, 0]] by columns: (1, λ + d1, 0) and, for the constant command, its equilibrium.
    V = mpmath.matrix([[1, 1, b0 / d0], [roots[0] + d1, roots[1] + d1, d1 * b0 / d0 - b1], [0, 0, 1]])
    inverse, found = V**-1, []
    for t in times:
        M, grown = mpmath.zeros(3), mpmath.zeros(3)
        for i in range(3):
            grown[i, i] = mpmath.exp(roots[i] * t)
            for j in range(3):
                rate = roots[i] + roots[j]
                M[i, j] = V[0, i] * V[0, j] * (mpmath.expm1(rate * t) / rate if rate else t) / N_m
        Gamma, move = inverse.T * M * inverse, V * grown * inverse
        P = limit + move * X0 * (identity + Gamma * X0) ** -1 * move.T
        found.append(P.apply(mpmath.re))
    return found


def scalar_equations(N_c, N_m, start, times):
    """P11, P12, P13, P22, P23, P33 at the times after the first, by integrating the six scalar equations from there."""

    def rates(_t, P):
        P11, P12, P13, P22, P23, P33 = P
        return [
            2 * (-A1 * P11 + P12 + B1 * P13) + B1**2 * N_c - P11**2 / N_m,
            -A1 * P12 + P22 + B1 * P23 - A0 * P11 + B0 * P13 + B1 * B0 * N_c - P11 * P12 / N_m,
            -A1 * P13 + P23 + B1 * P33 - P11 * P13 / N_m,
            2 * (-A0 * P12 + B0 * P23) + B0**2 * N_c - P12**2 / N_m,
            -A0 * P13 + B0 * P33 - P12 * P13 / N_m,
            -(P13**2) / N_m,
        ]

    solution = scipy.integrate.solve_ivp(rates, (times[0], times[-1]), start[np.triu_indices(3)], method="LSODA",
                                         t_eval=times[1:], rtol=1e-12, atol=1e-13 * max(float(start[0, 0]), 1e-300))
    return solution.y.T


def transition(N_c, dt):
    """Φ and Q_d of the three states, by Van Loan's block exponential with as many digits as it loses."""
    F = mpmath.matrix([[-mpmath.mpf(A1), 1, B1], [-mpmath.mpf(A0), 0, B0], [0, 0, 0]])
    G = mpmath.matrix([B1, B0, 0])
    block = mpmath.zeros(6)
    block[:3, :3], block[:3, 3:], block[3:, 3:] = -F * dt, G * G.T * mpmath.mpf(N_c) * dt, F.T * dt
    whole = mpmath.expm(block)
    Phi = whole[3:, 3:].T
    return Phi, Phi * whole[:3, 3:]


def sampled_limit(N_c, N_m, dt):
    """P⁻, P⁺ and K of the altitude: R_d φ(z)φ(1/z) + n(z)Q_d n(1/z)ᵀ = S d(z)d(1/z), S = P⁻ + R_d."""
    if not N_c:
        return 0.0, 0.0, 0.0
    with mpmath.workdps(60 + int(0.05 * dt)):
        Phi, Qd = transition(N_c, dt)
        R, trace, det = mpmath.mpf(N_m) / dt, Phi[0, 0] + Phi[1, 1], Phi[0, 0] * Phi[1, 1] - Phi[0, 1] * Phi[1, 0]
        low = mpmath.matrix([[-Phi[1, 1], Phi[0, 1]]])
        r2 = R * det
        r1 = -R * trace * (1 + det) + (Qd[0, :2] * low.T)[0]
        r0 = R * (1 + trace**2 + det**2) + Qd[0, 0] + (low * Qd[:2, :2] * low.T)[0]
        # With u = z + 1/z the polynomial is r2(u² − 2) + r1 u + r0; of each pair z, 1/z the stable root.
        apart = mpmath.sqrt(mpmath.mpc(r1**2 - 4 * r2 * (r0 - 2 * r2)))
        inside = []
        for u in ((-r1 + apart) / (2 * r2), (-r1 - apart) / (2 * r2)):
            split = mpmath.sqrt(u**2 - 4)
            inside.append(min((u + split) / 2, (u - split) / 2, key=abs))
        S = mpmath.re(r2 / (inside[0] * inside[1]))
        prior = S - R
        return float(prior), float(prior * R / S), float(prior / S)


def digits(p, k):
    """Digits that the power of the linear map takes: over k periods its elements spread like e^(2·(sum of the poles)·k dt)."""
    return 80 + int(k * p.dt * (0.2 + 0.3 * math.sqrt(p.N_c / p.N_m)))


def sampled_covariance(p, k):
    """P⁺ of the three states after k measurements: the k-th power of the linear map of (Y, X), P = Y X⁻¹."""
    with mpmath.workdps(digits(p, k)):
        Phi, Qd = transition(p.N_c, p.dt)
        back, J = (Phi**-1).T, mpmath.zeros(3)
        J[0, 0] = p.dt / mpmath.mpf(p.N_m)
        step = mpmath.zeros(6)
        step[:3, :3], step[:3, 3:] = Phi, Qd * back
        step[3:, :3], step[3:, 3:] = J * Phi, back + J * Qd * back
        q = mpmath.matrix([1, mpmath.mpf(A1) - mpmath.mpf(B1), 1])
        start = mpmath.zeros(6, 3)
        start[:3, :], start[3:, :] = p.var_hc0 * q * q.T, mpmath.eye(3)
        both = step**k * start
        P = both[:3, :] * both[3:, :] ** -1
        return np.array(P.tolist(), dtype=float)


def zero_roots():
    """How often λ = 0 is a root of the characteristic polynomial of the three states' Hamiltonian matrix."""
    b1, b0, a1, a0 = map(sympy.Rational, map(str, (B1, B0, A1, A0)))
    F = sympy.Matrix([[-a1, 1, b1], [-a0, 0, b0], [0, 0, 0]])
    N_c, N_m = sympy.symbols("N_c N_m", positive=True)
    G, H, s = sympy.Matrix([b1, b0, 0]), sympy.Matrix([[1, 0, 0]]), sympy.Symbol("s")
    hamiltonian = sympy.Matrix(sympy.BlockMatrix([[F, G * G.T * N_c], [H.T * H / N_m, -F.T]]))
    polynomial = hamiltonian.charpoly(s)
    return min(power for (power,), _coefficient in polynomial.terms())
