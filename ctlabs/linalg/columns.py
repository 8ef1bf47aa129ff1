r"""Columns whose span matters, not they themselves: an uncertainty Aδ with δ ~ N(0, I), or with a flat δ.

:math:`AA^T` is the same for A and AΘ, Θ orthogonal. Householder's reflections turn A so that few columns carry what is asked
for. They are graded: a column that is small beside the others keeps its digits. Any kind of number will do (float64 arrays, or
object arrays of mpmath's numbers); ``eps`` is its precision.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ctlabs.linalg import rounding

Numbers = NDArray[Any]
#: Columns carry the rounding of some hundred steps.
GATHERED = 100


class Turned(NamedTuple):
    """``A`` (n, d) after the reflection, and the sizes of the terms of its sums, (n, d)."""

    A: Numbers
    terms: Numbers


def cleaned(A: Numbers, terms: Numbers, eps: float) -> Numbers:
    """A with exact zeros where an element is at the rounding of its own terms."""
    return np.where(np.abs(A) <= rounding.level(terms, A.shape[0], eps), 0 * A, A)


def seen(h: Numbers, A: Numbers, eps: float, gathered: float = GATHERED) -> Numbers:
    """a = hA (d,), with exact zeros where it is rounding: what a measurement h (n,) sees of the columns.

    ``gathered``: of how many steps. A column without a size of its own is seen or not, and the rounding of all steps must not
    pass for sight; one with a size contributes what it is, so that no more than this product's own rounding is left out.

    >>> seen(np.array([0.1, 0.2, -0.3]), np.array([[1.0], [1.0], [1.0]]), rounding.EPS)
    array([0.])
    """
    a, terms = h @ A, np.abs(h) @ np.abs(A)
    return np.where(np.abs(a) <= gathered * rounding.level(terms, len(h), eps), 0 * a, a)


def turned(A: Numbers, a: Numbers, terms: Numbers | None = None) -> Turned:
    """AΘ, Θ orthogonal, that turns the row a (d,), which is not zero, into one number at its beginning.

    The column with the largest element comes first, so that the reflection takes from small columns no more than their size.

    >>> turned(np.array([[3.0, 4.0], [-4.0, 3.0]]), np.array([3.0, 4.0])).A.round(12) + 0.0
    array([[-5.,  0.],
           [ 0., -5.]])
    """
    terms = np.abs(A) if terms is None else terms
    if len(a) == 1:
        return Turned(A, terms)
    order = np.argsort(-np.abs(a.astype(np.float64)), kind="stable")
    A, a, terms = A[:, order], a[order], terms[:, order]
    v = a.copy()
    size = (a @ a) ** 0.5
    v[0] = a[0] + size if a[0] > 0 else a[0] - size
    scale = 2 / (v @ v)
    return Turned(A - np.outer(A @ v, v) * scale, terms + np.outer(terms @ np.abs(v), np.abs(v)) * scale)


def moved(Phi: Numbers, A: Numbers, eps: float) -> Numbers:
    """ΦA with as few columns as span it: what a singular Φ loses is left out, and the small columns come last.

    >>> moved(np.array([[1.0, 1.0], [0.0, 0.0]]), np.eye(2), rounding.EPS).shape
    (2, 1)
    """
    ahead, terms = Phi @ A, np.abs(Phi) @ np.abs(A)
    for j in range(A.shape[1]):
        ahead = cleaned(ahead, terms, eps)
        rest = np.abs(ahead[:, j:]).max(axis=1, initial=0)
        if not (rest > 0).any():
            return ahead[:, :j]
        size = terms[:, j:].max(axis=1)
        i = int(np.argmax([float(r / s) if s > 0 else 0.0 for r, s in zip(rest, size, strict=True)]))
        ahead[:, j:], terms[:, j:] = turned(ahead[:, j:], ahead[i, j:], terms[:, j:])
    return cleaned(ahead, terms, eps)
