r"""The matrix exponential and its integrals over an interval, every element to its own digits.

.. math:: \Phi = e^{Fh}, \qquad Q_d = \int_0^h e^{Fs}We^{F^Ts}ds, \qquad \Gamma = \int_0^h e^{Fs}ds

A Padé approximant of low order does not contain the elements of high order in h of a chain of integrators, and an error
that is small beside the largest element may be larger than all of a small one. Van Loan's single block exponential
contains :math:`e^{-Fh}` and overflows its accuracy on stiff systems. Here a Taylor series, summed until no element
changes, serves for a short step, and doubling leads from there to h.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.linalg.units import balanced

#: So many terms beyond the longest simple path leave 2^-16/16!·e of an element: less than half a unit of its last place.
BEYOND = 15
#: A term below this part of the sum, divided by the number of terms that may follow, ends a series.
LAST = np.finfo(float).eps / 4
#: Units are kept within this factor of the user's, lest their products leave double precision.
WIDEST = 2.0**400


#: Intervals that need no more doublings than these, and differ by less than this factor, are sums of the same terms.
FEW, SHORT = 2, 256.0
#: Products of stacks of matrices up to this size go by elements.
SMALL = 4
#: So many results of :func:`intervals` are kept, of so many numbers at most: constants of a model that do not move F and W ask again.
KEPT, NUMBERS = 16, 2**16


class Interval(NamedTuple):
    r"""What a linear system does over one interval h.

    ``Phi`` = :math:`e^{Fh}`; ``Qd`` = :math:`\int_0^h e^{Fs}We^{F^Ts}ds`; ``Gamma`` = :math:`\int_0^h e^{Fs}ds`.
    """

    Phi: Array
    Qd: Array
    Gamma: Array


def interval(F: ArrayLike, W: ArrayLike, h: float) -> Interval:
    r"""Transition matrix, noise covariance and input integral over an interval h.

    .. math:: \Phi(2h) = \Phi(h)^2, \quad Q_d(2h) = Q_d(h) + \Phi(h)Q_d(h)\Phi(h)^T, \quad
              \Gamma(2h) = \Gamma(h) + \Phi(h)\Gamma(h)

    Units are chosen in which the elements of Fh are near 1, and h is halved s times until the rows of \|F\|h have sums
    ≤ ½. There :math:`\Phi = \sum_jP_j` with :math:`P_j = (Fh)^j/j!`, and

    .. math:: \Gamma = h\sum_j\frac{P_j}{j+1}, \qquad Q_d = h\sum_{a,b}\frac{P_aWP_b^T}{a+b+1}

    *How many terms.* A walk of N steps from state j to state i is a simple path of d ≤ n − 1 steps with closed walks,
    N − d steps in all, inserted in one of C(N, d) ways, and closed walks of m steps weigh no more than :math:`2^{-m}`.
    With σ_d for the simple paths' part of the sum, :math:`(|F|h)^N_{ij}/N! \le \sum_d\sigma_d2^{d-N}/(N-d)!` and
    :math:`\sum_d\sigma_d \le (e^{|F|h})_{ij}`: each element has its digits after n − 1 + 15 terms, however small it is, and
    the summation ends sooner where no element of the last term counts. The same holds for Γ and, with \|W\|, for Qd.

    *Rounding.* Each product adds a few units of the last place of its own sum of terms, which the doublings after it
    carry on. Where the terms have one sign (integrators, lags, compartments) an element's relative error is about
    (n + 2^s)ε at worst, that is (n + \|λ\|h)ε, which is also what a change of F by its own rounding makes. Squaring would
    double it for slow modes too; their diagonal elements are kept as Φ_ii − 1, in which nothing grows.
    An element that is zero because no path leads to it is exactly zero.

    Parameters
    ----------
    F : (n, n), 1/s
    W : (n, n), symmetric, strength of the noise on the states, GQGᵀ, unit²/s
    h : s, > 0

    Raises
    ------
    ValueError
        An unstable system grows beyond double precision within h, or F h itself is beyond it.

    Source: doubling after Stillfjord & Tronarp (2023); elementwise accuracy of the exponential: Xue & Ye (2008), SIAM J.
    Matrix Anal. Appl. 30; units: :mod:`ctlabs.linalg.units`.

    >>> interval([[0, 1], [0, 0]], [[0, 0], [0, 1]], 2.0).Qd
    array([[2.66666667, 2.        ],
           [2.        , 2.        ]])
    """
    F, W = checks.shaped("F", F, ("n", "n")), checks.shaped("GQG'", W, ("n", "n"))
    h = checks.positive("dt", h)
    with np.errstate(over="ignore", invalid="ignore"):  # what is beyond double precision is reported below
        found = _interval(F, W, h) if np.isfinite(F * h).all() else None
    if found is None or not all(np.isfinite(part).all() for part in found):
        _beyond(h)
    return found


def intervals(F: ArrayLike, W: ArrayLike, h: ArrayLike) -> Interval:
    r"""Many intervals of one system: :func:`interval` of each, in stacks.

    Intervals within a factor of 2 share their units, their doublings and the terms of the series (short ones, with :data:`FEW` doublings,
    within a factor :data:`SHORT`): with ρ = h/h_max,

    .. math:: \Phi = \sum_j\rho^jP_j, \qquad Q_d = h\sum_m\frac{\rho^mD_m}{m+1}, \qquad
              D_m = \frac1m\left(AD_{m-1} + D_{m-1}A^T\right),\ D_0 = W

    where A = F h_max and :math:`D_m = \sum_{a+b=m}P_aWP_b^T`. The terms are those of :func:`interval`, and so is the accuracy.

    Parameters
    ----------
    F, W : (n, n), as for :func:`interval`
    h : (k,), s, > 0

    Returns
    -------
    Interval of Phi, Qd, Gamma, (k, n, n) each

    Raises
    ------
    ValueError
        As :func:`interval`, with the first interval over which the model leaves double precision.

    >>> intervals([[0, 1], [0, 0]], [[0, 0], [0, 1]], [1.0, 2.0]).Qd[:, 0, 0]
    array([0.33333333, 2.66666667])
    """
    F, W = checks.shaped("F", F, ("n", "n")), checks.shaped("GQG'", W, ("n", "n"))
    lengths = checks.shaped("dt", h, ("k",))
    if not (lengths > 0).all():
        checks.positive("dt", float(lengths[~(lengths > 0)][0]))
    if lengths.size * F.size > NUMBERS:
        return _intervals(F, W, lengths)
    size = float(np.abs(W).max(initial=0.0)) or 1.0  # Qd is linear in W: another strength of the noise is known already
    known = _known(len(F), F.tobytes(), (W / size).tobytes(), lengths.tobytes())
    with np.errstate(over="ignore"):
        Qd = size * known.Qd
    good = np.isfinite(Qd).all(axis=(1, 2))
    if not good.all():
        _beyond(lengths[int(np.argmin(good))])
    return Interval(known.Phi.copy(), Qd, known.Gamma.copy())


@lru_cache(maxsize=KEPT)
def _known(n: int, F: bytes, W: bytes, h: bytes) -> Interval:
    """:func:`intervals` of what was asked before."""
    return _intervals(np.frombuffer(F).reshape(n, n), np.frombuffer(W).reshape(n, n), np.frombuffer(h))


def _intervals(F: Array, W: Array, lengths: Array) -> Interval:
    """:func:`intervals` of checked arguments."""
    found = Interval(*(np.empty((len(lengths), *F.shape)) for _part in Interval._fields))
    left = lengths.copy()
    with np.errstate(over="ignore", invalid="ignore"):
        while left.any():
            most = float(left.max())
            scaling = _scaling(F, W, most) if np.isfinite(F * most).all() else None
            alike = left > most / (SHORT if scaling is not None and scaling[-1] <= FEW else 2)
            for whole, part in zip(found, _alike(F, W, lengths[alike], scaling), strict=True):
                whole[alike] = part
            left[alike] = 0.0
    good = np.all([np.isfinite(part).all(axis=(1, 2)) for part in found], axis=0)
    if not good.all():
        _beyond(float(lengths[int(np.argmin(good))]))
    return found


def _beyond(h: float) -> NoReturn:
    msg = f"dt: expected an interval over which the model stays within double precision, received {h:g} s"
    raise ValueError(msg)


def _interval(F: Array, W: Array, h: float) -> Interval:
    """:func:`interval` of checked matrices; what overflows is not finite."""
    ratio, product, size, doublings = _scaling(F, W, h)
    change, Qd, Gamma = _series(np.ldexp(F * h / ratio, -doublings), W / size / product)
    step = math.ldexp(h, -doublings)
    Phi, Qd, Gamma = _doubled(change, step * Qd, step * Gamma, doublings)
    return Interval(Phi * ratio, size * product * (0.5 * (Qd + Qd.T)), Gamma * ratio)


def _scaling(F: Array, W: Array, h: float) -> tuple[Array, Array, float, int]:
    """The units of Φ and of Qd in the user's, the size of W, and how often h is halved."""
    unit = balanced(F * h, continuous=False).states.clip(1 / WIDEST, WIDEST)
    ratio, product = unit[:, None] / unit, unit[:, None] * unit
    rows = float(np.abs(F * h / ratio).sum(axis=1).max(initial=0.0))
    doublings = max(0, math.ceil(math.log2(2 * rows))) if 0 < rows < np.inf else 0
    return ratio, product, float(np.abs(W).max(initial=0.0)) or 1.0, doublings  # Qd is linear in W, whatever its units


def _doubled(change: Array, Qd: Array, Gamma: Array, doublings: int) -> tuple[Array, Array, Array]:
    """Φ, Qd and Γ of an interval, or of a stack (n, n, k), from Φ − I, Qd and Γ of its 2^doublings-th part."""
    own = np.arange(len(change))
    Phi, slow = change.copy(), change[own, own]
    Phi[own, own] += 1
    for _ in range(doublings):
        Qd, Gamma = Qd + _times(_times(Phi, Qd), Phi.swapaxes(0, 1)), Gamma + _times(Phi, Gamma)
        Phi, slow = _squared(Phi, slow)
    return Phi, Qd, Gamma


def _times(A: Array, B: Array) -> Array:
    """AB; of stacks (n, n, k) of small matrices by whole rows of k elements, which numpy multiplies ten times as fast."""
    if A.ndim == 2:
        return np.asarray(A @ B)
    if len(A) > SMALL:
        return np.moveaxis(np.moveaxis(A, -1, 0) @ np.moveaxis(B, -1, 0), 0, -1)
    found = A[:, 0, None] * B[None, 0]
    for j in range(1, len(A)):
        found += A[:, j, None] * B[None, j]
    return np.asarray(found)


def _alike(F: Array, W: Array, h: Array, scaling: tuple[Array, Array, float, int] | None) -> Interval:
    """:func:`intervals` near each other; what overflows is not finite."""
    if scaling is None:
        return Interval(*(np.full((len(h), *F.shape), np.nan) for _part in Interval._fields))
    (ratio, product, size, doublings), most = scaling, float(h.max())
    A = np.ldexp(F * most / ratio, -doublings)
    P, D = _powers(A), [W / size / product]
    for m in range(1, 2 * len(P) - 1):
        moved = A @ D[-1]
        D.append((moved + moved.T) / m)
    index, step = np.arange(len(D))[:, None], np.ldexp(h, -doublings)
    weights = np.vander(h / most, len(D), increasing=True).T

    def summed(terms: Array, weights: Array) -> Array:
        """Σ_j weight_j·term_j, (n, n, k), laid out as the products want it."""
        flat = terms.reshape(len(terms), -1)
        if len(F) > SMALL:
            return np.moveaxis((weights.T @ flat).reshape(-1, *F.shape), 0, -1)
        return np.asarray((flat.T @ weights).reshape(*F.shape, -1))

    own = weights / (index + 1)
    Phi, Qd, Gamma = _doubled(
        summed(P[1:], weights[1 : len(P)]), step * summed(np.array(D), own), step * summed(P, own[: len(P)]), doublings
    )
    unit, units = ratio[:, :, None], (size * product)[:, :, None]
    return Interval(*(np.moveaxis(part, -1, 0) for part in (Phi * unit, units * (0.5 * (Qd + Qd.swapaxes(0, 1))), Gamma * unit)))


def _series(A: Array, W: Array) -> tuple[Array, Array, Array]:
    """Φ − I, Qd and Γ over a unit of time, in which the rows of |A| have sums ≤ ½."""
    n = len(A)
    P = _powers(A)
    index = np.arange(len(P))
    sums = (1 / (index[:, None] + index + 1)) @ P.reshape(len(P), n * n)  # Σ_b P_b/(a + b + 1) for every a
    left, right = P @ W, sums.reshape(P.shape)
    wide = n, n * len(P)
    Qd = left.swapaxes(0, 1).reshape(wide) @ right.swapaxes(0, 1).reshape(wide).T
    return P[:0:-1].sum(axis=0), Qd, right[0]


def _powers(A: Array) -> Array:
    """The terms A^j/j! of the exponential, j = 0, 1, …, as many as count in some element."""
    n = len(A)
    most = n + BEYOND
    powers = np.empty((most, n, n))
    powers[:2] = np.eye(n), A
    weights = np.cumprod(1 / np.maximum(np.arange(most), 1.0))
    known = 2
    while known < most:
        if known > 8:
            P = weights[:known, None, None] * powers[:known]
            if (np.abs(P[-1]) <= LAST / most * np.abs(P.sum(axis=0))).all():
                return P
        more = min(known - 1, most - known)
        powers[known : known + more] = powers[1 : more + 1] @ powers[known - 1]
        known += more
    return weights[:, None, None] * powers


def _squared(Phi: Array, slow: Array) -> tuple[Array, Array]:
    """Φ² and its diagonal − 1, from Φ and its diagonal − 1: of a slow mode the second is accurate, of a fast one the first."""
    square, others, own = _times(Phi, Phi), Phi * Phi.swapaxes(0, 1), np.arange(len(Phi))
    others[own, own] = 0.0
    slow = slow * (2 + slow) + others.sum(axis=1)
    squares = square[own, own]
    near = slow > -0.5
    square[own, own] = np.where(near, 1 + slow, squares)
    return square, np.where(near, slow, squares - 1)
