r"""When the difference scheme of a random field is stable.

A wave of number θ (radians per node) moves by :math:`x_{k+1} = (I + \Delta t\,M)\,x_k` with

.. math:: M = \begin{bmatrix} 0 & 1 \\ -(b_{00} + b_{01}s)/b_{20} & -(b_{10} + b_{11}s)/b_{20} \end{bmatrix}, \qquad
          s = \frac{1 - w}{h}, \quad w = e^{-i\theta}

so that its rates μ solve :math:`b_{20}\mu^2 + (b_{10} + b_{11}s)\mu + b_{00} + b_{01}s = 0` and it is multiplied by
1 + Δt·μ in each step. With w = 0 the same matrix is the diagonal block of a node without its neighbour: its
eigenvalues are those of the whole Φ, each as many times as there are nodes. |1 + Δt·μ| ≤ 1 for Δt from 0 to
−2 Re μ/|μ|², so both limits of Δt are closed forms, minimised over the waves.

Since the eigenvalues are a subharmonic function of w, no wave is damped more strongly than the block: the condition on
the waves (von Neumann's) is the stricter one, and where they differ a field of many nodes grows enormously before the
block's damping wins.

Source: Richtmyer & Morton, *Difference Methods for Initial-Value Problems* (1967), chapter 4; Trefethen & Embree,
*Spectra and Pseudospectra* (2005), section 31 (why eigenvalues mislead).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar

from ctlabs.linalg.checks import Array

Complex = NDArray[np.complex128]

#: Wave numbers looked at first; conjugate waves behave alike, so half the circle is enough.
THETA = np.unique(np.concatenate([np.linspace(0.0, np.pi, 2049), np.geomspace(1e-5, np.pi, 512)]))


class FieldEquation(NamedTuple):
    """Coefficients of the field's equation, and the distance h of its nodes."""

    b20: float
    b10: float
    b00: float
    b11: float
    b01: float
    h: float


def rates(equation: FieldEquation, w: ArrayLike) -> Complex:
    """The two rates μ (1/s) of a wave with w = exp(−iθ), (2, …); w = 0: of one node without its neighbour.

    >>> rates(FieldEquation(0.25, 0.1, 0.01, 1.0, 0.1, 1.0), 0.0).real.round(4)
    array([-4.2976, -0.1024])
    """
    s = (1 - np.asarray(w, dtype=np.complex128)) / equation.h
    b, c = equation.b10 + equation.b11 * s, equation.b00 + equation.b01 * s
    root = np.sqrt(b * b - 4 * equation.b20 * c)
    root = np.where((np.conj(b) * root).real < 0, -root, root)
    q = -0.5 * (b + root)  # the root of larger modulus; the other one by the product, so that nothing cancels
    large = np.where(q == 0, 1.0, q)
    return np.array([q / equation.b20, np.where(q == 0, 0.0, c / large)])


def factor(equation: FieldEquation, dt: float, theta: ArrayLike) -> Array:
    """By how much a wave of number θ is multiplied in a step at most, in the long run, (…)."""
    return _growth(rates(equation, np.exp(-1j * np.asarray(theta))), dt)


def von_neumann_factor(equation: FieldEquation, dt: float) -> float:
    """The largest factor over all waves; the scheme is stable where it is at most 1.

    >>> round(von_neumann_factor(FieldEquation(0.25, 0.1, 0.01, 1.0, 0.1, 1.0), 0.3), 4)
    1.4896
    """
    return -_least(lambda theta: -factor(equation, dt, theta))


def spectral_radius(equation: FieldEquation, dt: float) -> float:
    """The largest modulus of the eigenvalues of a node's block [[1, dt], [e2, e0]]."""
    return float(_growth(rates(equation, 0.0), dt))


def dt_limit_von_neumann(equation: FieldEquation) -> float:
    """The largest dt (s) at which no wave grows; 0 where the equation itself makes some wave grow.

    >>> round(dt_limit_von_neumann(FieldEquation(0.25, 0.1, 0.01, 1.0, 0.1, 1.0)), 5)
    0.241
    """
    return _least(lambda theta: _limit(rates(equation, np.exp(-1j * np.asarray(theta)))))


def dt_limit_eigenvalue(equation: FieldEquation) -> float:
    """The largest dt (s) at which the eigenvalues of a node's block are inside the unit circle.

    >>> round(dt_limit_eigenvalue(FieldEquation(0.25, 0.1, 0.01, 1.0, 0.1, 1.0)), 5)
    0.46537
    """
    return float(_limit(rates(equation, 0.0)))


def _growth(mu: Complex, dt: float) -> Array:
    return np.abs(1 + dt * mu).max(axis=0)


def _limit(mu: Complex) -> Array:
    """−2 Re μ/|μ|², the least of the two; a rate of 0 sets no limit, a growing wave has the limit 0."""
    size = np.abs(mu) ** 2
    limit = np.where(size > 0, -2 * mu.real / np.where(size > 0, size, 1.0), np.inf)
    return limit.min(axis=0).clip(min=0.0)


def _least(f: Callable[[Any], Array]) -> float:
    """The least value over all waves: on a grid, then refined between the neighbours of the best wave."""
    values = f(THETA)
    best = int(np.argmin(values))
    low, high = THETA[max(best - 1, 0)], THETA[min(best + 1, len(THETA) - 1)]
    refined = minimize_scalar(
        lambda theta: float(f(theta)), bounds=(low, high), method="bounded", options={"xatol": 1e-12}
    )
    return float(min(values[best], refined.fun))
