"""The answers of lab 18 by hand: the second route, which owes nothing to the library."""

import math
from functools import cache

import mpmath
import numpy as np
import sympy
from scipy.integrate import solve_ivp

#: Gravitational parameter of the Earth, m³/s².
EARTH = 3.986004418e14
#: Which of z1 = Θ and z2 = r each set of measurements has.
SETS = {"theta": [0], "range": [1], "both": [0, 1]}
#: The filters are also followed for so many times the measurements.
LONG = 4


def rate(p):
    """w, the Earth's for r0 unless it is given."""
    return p.w if p.w is not None else math.sqrt(EARTH / p.r0**3)


def units(p):
    """Natural units of the four states: r0, r0 w, 1 rad, w."""
    return np.array([p.r0, p.r0 * rate(p), 1.0, rate(p)])


def analytic(p):
    """The sheet's answers, by hand."""
    return asked(p, [p.steps, LONG * p.steps])


def asked(p, counts=()):
    """The same without what takes long, the variances after ``counts`` measurements but for those after the last."""
    w = rate(p)
    values = variances(p, counts or [p.steps])
    return {
        "F": [[0, 1, 0, 0], [3 * w**2, 0, 0, 2 * p.r0 * w], [0, 0, 0, 1], [0, -2 * w / p.r0, 0, 0]],
        "B": [[0, 0], [1, 0], [0, 0], [0, 1 / p.r0]],
        **{f"observability_rank_{name}": rank(rows, RATES) for name, rows in SETS.items()},
        "observability_ranks_half_period": ranks(sympy.pi),
        "observability_ranks_full_period": ranks(2 * sympy.pi),
        "unobservable_direction_range": [0, 0, 1, 0],
        **{f"posterior_variances_{name}": np.diag(P[0]) for name, P in values.items()},
        "covariances": values,
        "gain_limit": -1.5 * w * p.dt / p.r0,
        "growth": 2.25 * (w * p.dt * p.sigma_r / p.r0) ** 2,
    }
#: F in natural units, exactly.
RATES = [[0, 1, 0, 0], [3, 0, 0, 2], [0, 0, 0, 1], [0, -2, 0, 0]]


def transition(m, phase):
    """Φ in natural units after the phase wt (Clohessy & Wiltshire), with sin and cos of the module m (math, mpmath, sympy)."""
    c, s = m.cos(phase), m.sin(phase)
    return [
        [4 - 3 * c, s, 0, 2 - 2 * c],
        [3 * s, c, 0, 2 * s],
        [6 * s - 6 * phase, 2 * c - 2, 1, 4 * s - 3 * phase],
        [6 * c - 6, -2 * s, 0, 4 * c - 3],
    ]


@cache
def ranks(phase):
    """The rank of each set, sampled with this phase."""
    return [rank(rows, transition(sympy, phase)) for rows in SETS.values()]


def rank(rows, A):
    """Rank of [H; HA; HA²; HA³], exactly; natural units do not change it."""
    A, H = sympy.Matrix(A), sympy.Matrix([[int(j == (2, 0)[row]) for j in range(4)] for row in rows])
    return int(sympy.Matrix.vstack(*(H * A**k for k in range(4))).rank(simplify=True))


def variances(p, counts):
    """P(t_N⁺) for each N of ``counts``, from all measurements at once, by set; in natural units inside, 40 digits.

    ΦL(I + LᵀΣ(HΦᵏ)ᵀR⁻¹HΦᵏL)⁻¹LᵀΦᵀ with P0 = LLᵀ holds for a singular P0 too.
    """
    found = {name: [] for name in SETS}
    with mpmath.workdps(40):
        L, phase = mpmath.matrix(root(np.array(p.P0) / np.outer(units(p), units(p))).tolist()), mpmath.mpf(rate(p)) * p.dt
        sums, sigma = [mpmath.zeros(4), mpmath.zeros(4)], (mpmath.mpf(p.sigma_theta), mpmath.mpf(p.sigma_r) / p.r0)
        columns = [list(L[:, j]) for j in range(4)]
        for k in range(1, max(counts) + 1):
            Phi = transition(mpmath, k * phase)
            for row, S in enumerate(sums):
                seen = [mpmath.fdot(Phi[(2, 0)[row]], column) / sigma[row] for column in columns]
                for i in range(4):
                    for j in range(i, 4):
                        S[i, j] += seen[i] * seen[j]
            if k in counts:
                left = mpmath.matrix(Phi) * L
                for name, rows in SETS.items():
                    J = mpmath.matrix(4, 4)
                    for i in range(4):
                        for j in range(4):
                            J[i, j] = (i == j) + sum(sums[row][min(i, j), max(i, j)] for row in rows)
                    found[name].append(np.array((left * J**-1 * left.T).tolist(), dtype=float) * np.outer(units(p), units(p)))
    return found


def root(P):
    """L with LLᵀ = P, by the eigenvalues of the correlations."""
    sd = np.sqrt(np.diag(P))
    safe = np.where(sd > 0, sd, 1.0)
    values, vectors = np.linalg.eigh(P / np.outer(safe, safe))
    return sd[:, None] * vectors * np.sqrt(values.clip(0))


def slope(x, u, G):
    """The sheet's equations, by hand."""
    r, speed, _angle, turn = x
    return np.array([speed, r * turn**2 - G / r**2 + u[0], turn, -2 * turn * speed / r + u[1] / r])


def by_complex_step(x, u, G):
    """∂f/∂(x, u) without differences: the imaginary part of f(x + iε)/ε."""
    point, columns = np.concatenate([x, u]).astype(complex), []
    for j in range(6):
        moved = point.copy()
        moved[j] += 1e-30j * max(abs(point[j]), 1e-12)
        columns.append(slope(moved[:4], moved[4:], G).imag / moved[j].imag)
    return np.array(columns).T


def integrated(p, start, times):
    """The nonlinear motion from a deviation at t0, by an integrator of order 8, in natural units; deviations (4, times)."""
    whole = np.array([1.0, 0, 0, 1.0]) + start / units(p)
    path = solve_ivp(lambda _t, x: slope(x, (0, 0), 1.0), (0, rate(p) * times[-1]), whole, "DOP853", rate(p) * times, rtol=1e-13, atol=1e-14)
    nominal = np.array([np.ones(len(times)), 0 * times, rate(p) * times, np.ones(len(times))])
    return (path.y - nominal) * units(p)[:, None]
