"""High-precision twins of the library's verbs: the textbook's formulas with a hundred digits and more, written without it.

Matrices are numpy arrays of mpmath numbers, so that ``@`` and ``.T`` are the formulas. They take the doubles of a model as exact.
"""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np

from ctlabs.linalg.checks import Array
from tests.untraced import untraced

#: Decimal digits: those of an answer, and what a loop within 1e-20 of its boundary and elements over 40 decades cost.
DIGITS = 120


def exact(M: Any) -> Array:
    """The same numbers with all digits."""
    return np.vectorize(mpmath.mpf, otypes=[object])(np.asarray(M, dtype=np.float64))


def eye(n: int) -> Array:
    """The identity."""
    return exact(np.eye(n))


def solve(A: Array, B: Array) -> Array:
    """A⁻¹B by elimination with pivots chosen by column."""
    n, M = len(A), np.hstack([A, B])
    for j in range(n):
        pivot = j + max(range(n - j), key=lambda i: abs(M[j + i, j]))
        M[[j, pivot]] = M[[pivot, j]]
        M[j] = M[j] / M[j, j]
        for i in range(n):
            if i != j and M[i, j]:
                M[i] = M[i] - M[i, j] * M[j]
    return M[:, n:]


@untraced
def riccati(A: Any, H: Any, Q: Any, R: Any, N: Any = None, *, continuous: bool, digits: int = DIGITS) -> Array:
    """The limit from P = 0 of the filter's Riccati equation, by doubling the number of steps until nothing changes."""
    with mpmath.workdps(digits):
        A, H, Q, R = exact(A), exact(H), exact(Q), exact(R)
        if N is not None:
            M = solve(R, exact(N).T).T
            A, Q = A - M @ H, Q - M @ exact(N).T
        F, G, P = A.T, H.T @ solve(R, H) if len(H) else 0 * A, Q
        if continuous:
            F, G, P = _cayley(F, G, P)
        one = eye(len(A))
        for _ in range(400):
            W = solve(one + G @ P, np.hstack([F, G]))
            n = len(A)
            more = F.T @ P @ W[:, :n]
            F, G, P = F @ W[:, :n], G + F @ W[:, n:] @ F.T, P + more
            P, G = (P + P.T) / 2, (G + G.T) / 2
            if np.abs(F).max() ** 2 < mpmath.mpf(10) ** (-digits):
                return P
    raise AssertionError("the limit was not reached")


def _cayley(F: Array, G: Array, Q: Array) -> tuple[Array, Array, Array]:
    """The discrete equation with the same solution (Chu, Fan & Lin 2005)."""
    one = eye(len(F))
    rates = np.abs(np.linalg.eigvals(np.block([[F.T, Q], [G, -F]]).astype(float)))
    tau = mpmath.mpf(float(np.exp(np.log(rates[rates > 0]).mean())) * 1.0123)
    B = solve(F - tau * one, one)
    W = solve(F.T - tau * one + Q @ B @ G, one)
    return one + 2 * tau * W.T, 2 * tau * B @ G @ W, 2 * tau * W @ Q @ B


@untraced
def update(P: Array, H: Any, R: Any) -> tuple[Array, Array]:
    """(P⁺, K) from P⁻, in Joseph's form."""
    H, R = exact(H), exact(R)
    K = solve(H @ P @ H.T + R, H @ P).T
    left = eye(len(P)) - K @ H
    return left @ P @ left.T + K @ R @ K.T, K


@untraced
def filtered(model: Any, z: Array, first: int = 1, digits: int = DIGITS) -> dict[str, list[Array]]:
    """x and P after each update of a constant model, and the log-likelihood; NaN is not measured."""
    with mpmath.workdps(digits):
        Phi, Qd, x, P = exact(model.Phi), exact(model.Qd), exact(model.x0), exact(model.P0)
        found: dict[str, list[Any]] = {"x_plus": [], "P_plus": [], "log_likelihood": [mpmath.mpf(0)]}
        for k, row in enumerate(np.asarray(z)):
            if k:
                x, P = Phi @ x, Phi @ P @ Phi.T + Qd
            used = np.isfinite(row) & (k >= first)
            if used.any():
                H, R = exact(model.H[used]), exact(model.R[np.ix_(used, used)])
                nu, S = exact(row[used]) - H @ x, H @ P @ H.T + R
                P, K = update(P, model.H[used], model.R[np.ix_(used, used)])
                x = x + K @ nu
                log = mpmath.log(mpmath.det(mpmath.matrix(2 * mpmath.pi * S)))
                found["log_likelihood"].append(-(log + nu @ solve(S, nu[:, None])[:, 0]) / 2)
            found["x_plus"].append(x)
            found["P_plus"].append(P)
        return found


def off(found: Any, right: Array) -> float:
    """The largest error of a covariance, in units of the standard deviations that it gives; absolute where one is zero."""
    found = exact(found)
    sd = [mpmath.sqrt(v) if v > 0 else mpmath.mpf(1) for v in found.diagonal()]
    size = np.outer(np.array(sd, dtype=object), np.array(sd, dtype=object))
    return float((np.abs(found - right) / size).max()) if len(sd) else 0.0
