r"""The way back from an interval: F from :math:`\Phi = e^{Fh}`, and W from :math:`Q_d = \int_0^h e^{Fs}We^{F^Ts}ds`.

Both are solved in units of the system's own, so that a chain of integrators at a small period has its digits.
"""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np
import scipy.linalg

from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.linalg.exponential import interval
from ctlabs.linalg.units import balanced

EPS = float(np.finfo(float).eps)


class Strength(NamedTuple):
    """A strength (n, n), symmetric, and what rounding of ``Qd`` and of the solution may have changed in each element."""

    W: Array
    error: Array


def logarithm(Phi: Array) -> Array:
    r"""The principal logarithm A of a real matrix: :math:`e^A = \Phi`, every eigenvalue's imaginary part between −π and π.

    It exists, is real and unique, where no eigenvalue is zero or negative. An element to which no path in Φ leads is zero.

    Parameters
    ----------
    Phi : (n, n)

    Raises
    ------
    ValueError
        A zero or a negative eigenvalue, or one that rounding of Φ's elements cannot tell from it; a logarithm that double
        precision loses, because a mode has decayed below the rounding of the others.

    Source: Higham, *Functions of Matrices* (2008), theorem 1.31 and chapter 11.

    >>> logarithm(np.array([[1.0, 0.5], [0.0, 1.0]]))
    array([[0. , 0.5],
           [0. , 0. ]])
    """
    n = len(Phi)
    unit = balanced(Phi - np.eye(n), continuous=False).states
    ratio = unit[:, None] / unit
    _principal(Phi / ratio)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that modes have decayed is no fault yet: the way back below decides
        A = np.real(scipy.linalg.logm(Phi / ratio)) * ratio
    reached = np.linalg.matrix_power((np.eye(n) + (Phi != 0) > 0).astype(float), n) > 0
    A = np.where(reached, A, 0.0)
    try:
        for _ in range(3):
            A = np.where(reached, A + _step(A, Phi), 0.0)
        # The size of an element's own terms, in e^A = e^{0.382A} e^{0.618A}: where they cancel, their rounding stays.
        terms = np.abs(_exponential(0.382 * A)) @ np.abs(_exponential(0.618 * A))
        off = float((np.abs(_exponential(A) - Phi) / np.maximum(terms + np.abs(Phi), np.finfo(float).tiny)).max(initial=0.0))
    except ValueError:  # e^{-A} beyond double precision
        off = np.inf
    if not off <= checks.ROUNDING:
        msg = (
            "Phi: expected modes that have not decayed below the rounding of others, received a matrix "
            f"whose logarithm leads back to another one ({off:.2g} off)"
        )
        raise ValueError(msg)
    return A


def _exponential(A: Array) -> Array:
    return interval(A, np.zeros_like(A), 1.0).Phi


def _step(A: Array, Phi: Array) -> Array:
    r"""Newton's: D with :math:`\int_{-1/2}^{1/2}e^{-As}De^{As}ds = e^{-A/2}(\Phi - e^A)e^{-A/2}`, every element to its own size."""
    n, one = len(A), np.eye(len(A))
    back = _exponential(-0.5 * A)
    residual = back @ (Phi - _exponential(A)) @ back
    K = np.kron(one, A.T) - np.kron(A, one)
    half = interval(K, np.zeros_like(K), 0.5).Gamma + interval(-K, np.zeros_like(K), 0.5).Gamma
    step: Array = np.linalg.solve(half, residual.ravel()).reshape(n, n)
    return step


def _principal(Phi: Array) -> None:
    """Refuse a matrix that has no principal logarithm, as far as the rounding of its elements tells."""
    n = len(Phi)
    try:
        # The smallest relative change of the elements that makes Φ singular is about one over this, in any units.
        with np.errstate(over="ignore", invalid="ignore"):
            both = np.abs(np.linalg.inv(Phi)) @ np.abs(Phi)
        distance = np.abs(np.linalg.eigvals(both)).max(initial=0.0) if np.isfinite(both).all() else np.inf
    except np.linalg.LinAlgError:
        distance = np.inf
    if not distance * n * EPS < 1:
        msg = "Phi: expected an invertible matrix (e^{F dt} is one), received one that is singular to the rounding of its elements"
        raise ValueError(msg)
    values, left, right = scipy.linalg.eig(Phi, left=True)
    own = np.einsum("ik,ij,jk->k", np.abs(left), np.abs(Phi), np.abs(right))
    with np.errstate(divide="ignore"):  # a double eigenvalue: its vectors are orthogonal, and it moves by √ε
        moved = n * EPS * own / np.abs(np.einsum("ik,ik->k", left.conj(), right))
    negative = (values.real < 0) & (np.abs(values.imag) <= np.minimum(moved, np.sqrt(n * EPS) * np.abs(values)))
    if negative.any():
        msg = (
            "Phi: expected no negative eigenvalue (alone it has no real logarithm, and in a pair not only one), "
            f"received the eigenvalue {values[negative][0].real:.6g}"
        )
        raise ValueError(msg)


def strength(F: Array, Qd: Array, h: float) -> Strength:
    r"""The symmetric W with :math:`\int_0^h e^{Fs}We^{F^Ts}ds = Q_d`; it need not be a strength (W ≥ 0).

    .. math:: \mathrm{vec}\,Q_d = \int_0^h e^{(F\otimes I+I\otimes F)s}ds\ \mathrm{vec}\,W,

    n(n+1)/2 equations for the elements on and above the diagonal, of the states that are driven, in units in which Qd/h has
    the diagonal 1. They have one solution unless two eigenvalues of F differ by a multiple of 2πi/h. The residual is brought
    to the rounding of its own terms by refinement, and ``error`` is :math:`|L^{-1}|(|Q_d| + |L||W|)` times that rounding.

    Parameters
    ----------
    F : (n, n), 1/s · Qd : (n, n), symmetric · h : s

    Source: Van Loan (1978), IEEE Trans. AC-23, for the way there; refinement: Skeel (1980), Math. Comp. 35.

    >>> strength(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[1/3, 1/2], [1/2, 1.0]]), 1.0).W.round(12) + 0.0
    array([[0., 0.],
           [0., 1.]])
    """
    driven = np.flatnonzero(np.diag(Qd) > 0)
    n, size = len(driven), np.sqrt(np.diag(Qd)[driven] / h)
    A = F[np.ix_(driven, driven)] * h * size / size[:, None]
    rows, columns = np.triu_indices(n)
    both = np.zeros((n * n, len(rows)))  # vec W from the elements on and above the diagonal
    for k, (i, j) in enumerate(zip(rows, columns, strict=True)):
        both[[i * n + j, j * n + i], k] = 1.0
    K = (np.kron(A, np.eye(n)) + np.kron(np.eye(n), A))[rows * n + columns] @ both
    L = interval(K, np.zeros_like(K), 1.0).Gamma
    q, inverse = (Qd[np.ix_(driven, driven)] / h / np.outer(size, size))[rows, columns], np.linalg.inv(L)
    w = inverse @ q
    for _ in range(4):
        w = w + inverse @ (q - L @ w)
    error = len(w) * EPS * (np.abs(inverse) @ (np.abs(q) + np.abs(L) @ np.abs(w)))
    found = Strength(np.zeros(F.shape), np.zeros(F.shape))
    for whole, part in zip(found, (w, error), strict=True):
        whole[np.ix_(driven, driven)] = (both @ part).reshape(n, n) * np.outer(size, size)
    return found
