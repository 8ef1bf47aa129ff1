r"""Companion matrices of a rational function, each element rounded once.

.. math:: \frac{b_0s^n + \dots + b_n}{a_0s^n + \dots + a_n} = D + H(sI - F)^{-1}G, \qquad
          F = \begin{bmatrix}-\bar a_1 & 1 & \\ \vdots & & 1 \\ -\bar a_n & 0 & 0\end{bmatrix}, \quad
          G = \begin{bmatrix}\bar b_1 - D\bar a_1 \\ \vdots \\ \bar b_n - D\bar a_n\end{bmatrix}, \quad
          H = [1\; 0\; \dots], \quad D = \bar b_0

with :math:`\bar a_i = a_i/a_0`, :math:`\bar b_i = b_i/a_0`. The elements are computed as fractions, so that no coefficient is
dropped, however small, and D takes no digits from G. Common factors of numerator and denominator are in order: what they
hide is not driven (or, in the transposed form, not seen).
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from ctlabs.linalg.checks import Array

#: The smallest number that a double holds with all its digits.
TINY = np.finfo(np.float64).tiny


class Companion(NamedTuple):
    """F (n, n), G (n, s), H (m, n), D (m, s)."""

    F: Array
    G: Array
    H: Array
    D: Array

    @property
    def transposed(self) -> Companion:
        """The reachable form of an observable one: Fᵀ, Hᵀ, Gᵀ, Dᵀ."""
        return Companion(self.F.T, self.H.T, self.G.T, self.D.T)


def companion(nums: Sequence[Sequence[float] | Array], den: Sequence[float] | Array) -> Companion:
    """The observable form of several inputs' numerators over one denominator, descending powers; ``transposed`` of outputs'.

    Parameters
    ----------
    nums : each of at most the denominator's degree
    den : of degree n, its first coefficient not zero

    Raises
    ------
    ValueError
        An element beyond the range of doubles.

    >>> found = companion([[1e-15, 1e-15]], [1, 3, 5])
    >>> found.F, found.G.T
    (array([[-3.,  1.],
           [-5.,  0.]]), array([[1.e-15, 1.e-15]]))
    """
    exact = [Fraction(float(a)) for a in den]
    n = len(exact) - 1
    a = np.array([double("den", c / exact[0]) for c in exact[1:]])
    F = np.eye(n, k=1)
    F[:, :1] = -a[:, None]
    G, D = np.zeros((n, len(nums))), np.zeros((1, len(nums)))
    for j, num in enumerate(nums):
        b = [Fraction(0)] * (n + 1 - len(num)) + [Fraction(float(c)) / exact[0] for c in num]
        D[0, j] = double("num", b[0])
        direct = Fraction(D[0, j])
        G[:, j] = [double("num", b[i + 1] - direct * Fraction(a[i])) for i in range(n)]
    return Companion(F, G, np.eye(1, n), D)


def double(name: str, value: Fraction) -> float:
    """The nearest double; refused where it is infinite, or has lost digits near zero.

    >>> double("num", Fraction(1, 3))
    0.3333333333333333
    """
    try:
        found = float(value)
    except OverflowError:
        found = np.inf
    if found == np.inf or (value and abs(found) < TINY):
        size = "smaller" if value and abs(value) < 1 else "larger"
        msg = f"{name}: expected coefficients within double precision (1e-308 to 1e308), received {size} ones"
        raise ValueError(msg)
    return found
