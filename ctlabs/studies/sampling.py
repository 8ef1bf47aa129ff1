r"""The check of a discretisation, element by element, by a route that shares nothing with the answer.

Φ and Qd once more, by a Taylor series in integers of so many bits that every double has its digits, and by plain doubling:

.. math:: \Phi = \sum_j\frac{(Fh)^j}{j!}, \qquad Q_d = \sum_j V_j, \quad V_0 = Wh, \quad V_j = \frac{(FV_{j-1} + V_{j-1}F^T)h}{j+1}
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np

from ctlabs.linalg.checks import Array
from ctlabs.linalg.units import balanced
from ctlabs.models import ContinuousModel, DiscreteModel
from ctlabs.reporting.report import SOLVER, Report
from ctlabs.text import _

#: Bits after the point: the smallest double has 2^-1074, and what is multiplied keeps 100 more.
BITS = 1200
#: Integers of this size cost 2 µs a product, of which there are 200 n³; models with more states are summed in doubles.
LARGEST = 12
#: The step is halved until the rows of |F|h have sums below 2^-20, in doubles 2^-3: every squaring doubles their rounding.
SHORT, SHORT_IN_DOUBLES = 20, 3
#: Elements below this are next to the smallest double, and have no digits left to compare.
LEAST = 1e-290


def check(report: Report, continuous: ContinuousModel, discrete: DiscreteModel) -> None:
    r"""Φ and Qd of ``discrete`` against the series, each element in units of the sum of its own terms.

    These are the terms of :math:`\Phi = \Phi_{0.4}\Phi_{0.6}` and of :math:`Q_d = Q_{0.4} + \Phi_{0.4}Q_{0.6}\Phi_{0.4}^T`: a
    small element is judged by its own size, one that vanishes because its terms cancel by theirs.
    """
    F, W, dt = continuous.F, continuous.G @ continuous.Q @ continuous.G.T, discrete.dt
    # The parts are no simple fractions, lest an oscillation be split where its terms vanish too.
    (Phi, Q), (rest, Qr) = (series(F, W, part * dt, exact=False) for part in (0.3819660, 0.6180340))
    sizes = abs(Phi) @ abs(rest), abs(Q) + abs(Phi) @ abs(Qr) @ abs(Phi).T
    second = _("series in integers") if len(F) <= LARGEST else _("series in doubles, shorter steps")
    names = _("transition matrix"), _("covariance of the sampled noise")
    found = discrete.Phi, discrete.Qd
    for name, value, expected, size in zip(names, found, series(F, W, dt), sizes, strict=True):
        unit = np.maximum(size, LEAST)
        report.check(name, value / unit, expected / unit, (_("doubling of short steps"), second), SOLVER, scale=1.0)


def series(F: Array, W: Array, h: float, *, exact: bool = True) -> tuple[Array, Array]:
    """Φ and Qd of the interval h, by integers (``exact``, up to LARGEST states) or in doubles.

    >>> Phi, Qd = series(np.eye(3, k=1), np.diag([0.0, 0.0, 1.0]), 0.5)
    >>> float(Phi[0, 2]), float(Qd[0, 0])
    (0.125, 0.0015625)
    """
    n = len(F)
    bits = BITS if exact and n <= LARGEST else 0
    unit = balanced(F * h, continuous=False).states
    ratio, product = unit[:, None] / unit, unit[:, None] * unit
    rows = (np.abs(F * h) / ratio).sum(axis=1).max(initial=0.0)
    halvings = max(0, math.ceil(math.log2(rows)) + (SHORT if bits else SHORT_IN_DOUBLES)) if rows else 0
    size = np.abs(W).max(initial=0.0) or 1.0
    A, V = _numbers(F / ratio, h, bits, halvings), _numbers(W / size / product, h, bits, halvings)
    Phi, Q = _taylor(A, V, bits)
    for _step in range(halvings):
        Q = Q + _times(_times(Phi, Q, bits), Phi.T, bits)
        Phi = _times(Phi, Phi, bits)
    return _doubles(Phi, bits) * ratio, size * product * _doubles(Q, bits)


def _taylor(A: Array, V: Array, bits: int) -> tuple[Array, Array]:
    """Φ and Qd over the short step, until the terms no longer count: in integers none at all, in doubles in no element."""

    def counts(term: Array, total: Array) -> bool:
        return bool((abs(term) > (1 if bits else 2.0**-60 * abs(total))).any())

    P = np.eye(len(A), dtype=object if bits else float) * (1 << bits)
    Phi, Q, j = P, V, 0
    while j == 0 or counts(P, Phi) or counts(V, Q):
        j += 1
        P, FV = _part(_times(A, P, bits), j, bits), _times(A, V, bits)
        V = _part(FV + FV.T, j + 1, bits)
        Phi, Q = Phi + P, Q + V
    return Phi, Q


def _numbers(M: Array, h: float, bits: int, halvings: int) -> Array:
    """M h/2^halvings in units of 2^-bits, rounded down; with no bits in doubles."""
    if not bits:
        return np.ldexp(M * h, -halvings)
    step = Fraction(h) * Fraction(2) ** (bits - halvings)
    return np.array([int(Fraction(x) * step) for x in M.ravel().tolist()], dtype=object).reshape(M.shape)


def _doubles(M: Array, bits: int) -> Array:
    """The inverse of :func:`_numbers`."""
    return np.array([x / (1 << bits) for x in M.ravel().tolist()], dtype=float).reshape(M.shape)


def _times(A: Array, B: Array, bits: int) -> Array:
    product: Array = A @ B
    return product >> bits if bits else product


def _part(M: Array, divisor: int, bits: int) -> Any:
    return M // divisor if bits else M / divisor
