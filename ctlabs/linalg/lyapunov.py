r"""Lyapunov equations, with a bound of the error that the solution itself proves.

.. math:: X = AXA^T + Q \qquad\text{or}\qquad AX + XA^T + Q = 0

X is the sum of :math:`A^kQ(A^k)^T` over all k, of which the number of terms is doubled at once (Smith 1968); Cayley's transform makes
a discrete equation of a continuous one. The operator :math:`\mathcal L^{-1}: Q \mapsto X` is positive: a residual between −M and M
leaves an error between :math:`-\mathcal L^{-1}M` and :math:`\mathcal L^{-1}M`. An X with :math:`AXA^T + M/2 \preceq X` proves both that
A is stable and that :math:`\mathcal L^{-1}M \preceq 2X` (Lyapunov), however it was found.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ctlabs.linalg.checks import Array
from ctlabs.linalg.manyfold import Manyfold, Matrix, high, inverse, rounding, symmetric

#: The number of terms is doubled until a power of A is below this, or so many times.
NEGLIGIBLE, DOUBLINGS = 1e-24, 128


class Operator:
    """The operator Q ↦ X of one stable matrix, in the precision of that matrix."""

    def __init__(self, A: Matrix, *, continuous: bool) -> None:
        """``ArithmeticError``: A is not stable, as far as this precision tells."""
        self.continuous, self.A = continuous, A
        self._root: Matrix | None = None
        step = A
        if continuous:
            self._root, step = _transformed(A)
        self._powers: list[Matrix] = []
        while len(self._powers) < DOUBLINGS:
            self._powers.append(step)
            step = step @ step
            size = np.abs(high(step)).max(initial=0.0)
            if size < NEGLIGIBLE:
                return
            if not size < 1e30:
                break
        msg = "A: expected a stable matrix, received one whose powers do not vanish"
        raise ArithmeticError(msg)

    def solve(self, Q: Matrix) -> Matrix:
        """X of one symmetric Q."""
        if self._root is not None:
            Q = self._root @ Q @ self._root.T
        for step in self._powers:
            Q = symmetric(Q + step @ Q @ step.T)
        return Q


def _transformed(A: Matrix) -> tuple[Matrix, Matrix]:
    """√(2τ)(τI − A)⁻¹ and (τI − A)⁻¹(τI + A), with the τ = 2²ᵏ⁻¹ that brings the eigenvalues nearest to zero."""
    one, values = np.eye(len(high(A))), np.linalg.eigvals(high(A))
    values = -np.abs(values.real) + 1j * values.imag  # the powers decide about stability
    size = np.abs(values[values != 0])
    low, top = np.log2([size.min(initial=1.0), size.max(initial=1.0)]) if size.size else (0.0, 0.0)
    choices = 2.0 ** (2 * np.arange(np.floor(low / 2), np.ceil(top / 2) + 2) - 1)
    tau = min(choices, key=lambda t: np.abs((t + values) / (t - values)).max(initial=0.0))
    root = inverse((tau * one - A) if isinstance(A, np.ndarray) else A * -1.0 + tau * one)
    return root * float(np.sqrt(2 * tau)), root * (2 * tau) - one


def residual(A: Matrix, X: Matrix, Q: Matrix, *, continuous: bool) -> Manyfold:
    """AXAᵀ − X + Q or AX + XAᵀ + Q, in at least twice the working precision."""
    A = Manyfold.of(A, 2)
    AX = A @ X
    return (AX + AX.T if continuous else AX @ A.T - X) + Q


class Proof(NamedTuple):
    """A is stable, and a residual between ∓c·diag(weight) leaves an error between ∓c·reach."""

    weight: Array
    reach: Array

    def times(self, D: Array) -> float:
        """A c with −c·diag(weight) ⪯ D ⪯ c·diag(weight), of one that is bounded element by element."""
        return float((np.abs(D) / np.sqrt(np.outer(self.weight, self.weight))).sum(axis=1).max(initial=0.0))


def prove(operator: Operator, A: Manyfold, size: Array) -> Proof | None:
    """The proof for A (of which the operator may be that of a rounded one), or None if it fails.

    ``size`` (n, n) : sums of the magnitudes of which the elements of A are sums.
    """
    continuous = operator.continuous
    weight = 1.0 + size.sum(axis=1) if continuous else np.ones(len(size))
    M: Matrix = np.diag(weight)
    X = operator.solve(Manyfold.of(M) if isinstance(operator.A, Manyfold) else M)
    rest = np.abs(residual(A, X, M, continuous=continuous).high)
    rest += lost(size, np.abs(high(X)), A.fold, continuous=continuous)
    proof = Proof(weight, 2 * high(X))
    return proof if proof.times(rest) <= 0.5 else None


def stable(A: Array, *, continuous: bool) -> bool:
    """Whether A can be proved stable; False is no proof of the contrary.

    >>> stable(np.array([[0.9, 1e3], [0.0, 0.9]]), continuous=False), stable(np.eye(1), continuous=False)
    (True, False)
    """
    try:
        with np.errstate(all="ignore"):
            return prove(Operator(A, continuous=continuous), Manyfold.of(A, 2), np.abs(A)) is not None
    except (ArithmeticError, np.linalg.LinAlgError):
        return False


def lost(size: Array, X: Array, fold: int, *, continuous: bool) -> Array:
    """Bound of the rounding of :func:`residual`: products know the largest elements of rows and columns only."""
    n, row, most = len(size), size.max(axis=1, initial=0.0), X.max(initial=0.0)
    terms = row[:, None] + row if continuous else n * np.outer(row, row) + 1.0
    return 4 * n * rounding(fold) * most * terms
