r"""First solutions of a Riccati equation, from which Newton's method converges: the gain of each has a stable loop.

Doubling the number of steps from zero comes first (structure-preserving doubling; Chu, Fan, Lin & Wang 2004, Int. J. Control 77; a
continuous equation after Cayley's transform: Chu, Fan & Lin 2005, Linear Algebra Appl. 396): some ten products of small matrices.
Where it fails, python-control's solver follows (always scipy's method, whatever else is installed); where both do, the equation with a
little noise added to every state and measurement has a stabilising gain that serves as well.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy.linalg

from ctlabs.linalg.checks import Array
from ctlabs.linalg.manyfold import Manyfold, Matrix, high, inverse, solve, symmetric

#: Above this number of states only doubling is fast enough to be tried.
LARGE = 60
#: Noise added, in units in which the elements of the equation are near 1.
ADDED = 1e-9
DOUBLINGS = 128


class Uncorrelated(NamedTuple):
    """A (n, n), H (m, n), Q (n, n), R (m, m) of an equation without N."""

    A: Matrix
    H: Array
    Q: Matrix
    R: Array


def starts(
    eq: Uncorrelated, precise: Callable[[int], Uncorrelated], *, continuous: bool
) -> Iterator[tuple[int, Callable[[], Matrix]]]:
    """Ways to a first P, the cheapest first, and the multiple of the working precision in which to go on from there.

    ``precise`` : the equation in a multiple of the working precision. Beside a quiet sensor whose noise is correlated with that of
    the states, A − NR⁻¹H has lost A in doubles.
    """
    yield 2, partial(doubled, eq, 0.0, 1, continuous=continuous)
    if eq.H.shape[1] <= LARGE and len(eq.H):
        yield 2, partial(by_control, eq, continuous=continuous)
    yield 2, partial(doubled, eq, ADDED, 1, continuous=continuous)
    if eq.H.shape[1] <= LARGE:
        yield 2, partial(doubled, eq, 0.0, 2, continuous=continuous)
        yield 2, partial(doubled, eq, ADDED, 2, continuous=continuous)
        for fold in (4, 8):
            yield fold, partial(_precisely, precise, fold, continuous=continuous)


def _precisely(precise: Callable[[int], Uncorrelated], fold: int, *, continuous: bool) -> Matrix:
    return doubled(precise(fold), 0.0, fold, continuous=continuous)


def by_control(eq: Uncorrelated, *, continuous: bool) -> Array:
    """P of python-control: the dual equation. ``ArithmeticError`` where it has none, whatever it raises."""
    import control  # costs 1 s to import

    solver = control.care if continuous else control.dare
    try:
        return np.asarray(solver(high(eq.A).T, eq.H.T, high(eq.Q), eq.R, method="scipy")[0])
    except Exception as error:
        msg = f"python-control: expected a solution, received {error}"
        raise ArithmeticError(msg) from error


def doubled(eq: Uncorrelated, added: float, fold: int, *, continuous: bool) -> Matrix:
    """P after 1, 2, 4, … steps from zero, of the equation with added noise, in a multiple of the working precision."""
    one = np.eye(eq.H.shape[1])
    R = eq.R + added * np.diag(np.diag(eq.R) + np.diag(eq.H @ high(eq.Q) @ eq.H.T))
    F: Matrix = eq.A.T
    G: Matrix = eq.H.T @ np.linalg.solve(R, eq.H)
    P: Matrix = eq.Q + added * one
    if fold > 1:
        F, P = Manyfold.of(F, fold), Manyfold.of(P, fold)
        G = eq.H.T @ solve(Manyfold.of(R, fold), Manyfold.of(eq.H))
    if continuous:
        F, G, P = _cayley(F, G, P)
    for _ in range(DOUBLINGS):
        W = inverse(one + G @ P)
        FW, WF = F @ W, W @ F
        F, G, P = FW @ F, symmetric(G + FW @ G @ F.T), symmetric(P + F.T @ P @ WF)
        size = np.abs(high(F)).max(initial=0.0)
        if size < 1e-20:
            return P
        if not size < 1e100:
            break
    msg = "doubling: expected a transition that vanishes, received one that does not"
    raise ArithmeticError(msg)


def _cayley(F: Matrix, G: Matrix, Q: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """The discrete equation with the same solution, for a step near the mean of the fastest and the slowest time."""
    A, one = high(F), np.eye(len(high(F)))
    rates = np.abs(np.linalg.eigvals(np.block([[A.T, high(Q)], [high(G), -A]])))
    rates = rates[rates > 0]
    tau = float(np.exp2(np.round(0.5 * np.log2(rates.min(initial=1.0) * rates.max(initial=1.0)))))
    own = scipy.linalg.eigvals(A)
    while np.abs(own - tau).min() < 1e-2 * tau:
        tau *= 2.0
    B = inverse(F + -tau * one)
    W = inverse(F.T + -tau * one + Q @ B @ G)
    return W.T * (2 * tau) + one, symmetric((B @ G @ W) * (2 * tau)), symmetric((W @ Q @ B) * (2 * tau))
