r"""What every block of a linear experiment needs, computed once: factors of the noises, gains, whitening, layout.

Truth and design step together, run by run:

.. math:: x_{k+1} = \Phi x_k + c_k + G_k\xi^w_k + C_k\xi^v_k, \quad z_k = H_k x_k + L_k\xi^v_k

.. math:: \hat x^-_{k+1} = A_k\hat x^+_k + M_k z_k + b_k, \quad \nu_k = z_k - \hat H_k\hat x^-_k, \quad
          \hat x^+_k = \hat x^-_k + K_k\nu_k, \quad e_k = \hat x_k - E x_k

with white ξ of unit variance. [[L, 0], [C, G]] is the lower triangular factor of the joint covariance of v and w;
its columns that are zero at all times are left out and cost no random numbers. A matrix that does not vary has one
entry on its time axis.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.filtering import measured, motion
from ctlabs.filtering.filter import planned
from ctlabs.filtering.results import Covariances, Mask
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel
from ctlabs.models.histories import Truth, entry, stack
from ctlabs.text import moment

#: Directions in which a covariance, scaled to a unit diagonal, is below this fraction of its size have no variance.
RANK = 1e-10
#: Nanoseconds a block is planned to take; at four times that it still answers an interrupt within 0.2 s.
BLOCK_NS = 5e7
#: Runs that step together: their states stay in the processor's nearest caches.
WIDTH = 500


class Tiling(NamedTuple):
    """How runs are grouped: ``width`` runs in a tile, ``tiles`` tiles in a block; each block has its own stream."""

    width: int
    tiles: int

    @property
    def runs(self) -> int:
        """Runs in a full block."""
        return self.width * self.tiles

    def count(self, runs: int) -> int:
        """Blocks in an experiment."""
        return -(-runs // self.runs)


def layout(n: int, steps: int) -> Tiling:
    """The grouping for n states: fixed by the size of the problem, never by the machine or the number of workers.

    >>> layout(2, 1000).runs == layout(2, 1000).width * layout(2, 1000).tiles
    True
    """
    runs = int(BLOCK_NS / ((10 + 4 * n + 0.5 * n * n) * (steps + 1)))
    width = min(max(runs, 1), WIDTH)
    return Tiling(width, min(max(runs // width, 1), 512))


class Design(NamedTuple):
    """The arrays that make x̂, e and the consistency statistics; W and V whiten e and ν."""

    x0: Array
    A: Array
    b: Array
    M: Array
    H: Array
    K: Array
    W: Array
    V: Array
    E: Array
    same: bool
    shift_minus: Array
    shift: Array
    shift_white: Array


@dataclass(frozen=True, slots=True, eq=False)
class Gains:
    """A linear design over some steps: its arrays, the covariances it claims, and how many dimensions NEES and NIS count."""

    arrays: Design
    plan: Covariances
    nees_dof: Array
    nis_dof: Array


def gains(
    design: DiscreteModel,
    steps: int,
    first: int,
    absent: Mask,
    E: Array,
    given: Covariances | None = None,
    algorithm: str = "auto",
) -> Gains:
    """The arrays of a linear filter; elements that are ``absent`` (steps+1, m) from the truth's data are not used."""
    measured.horizon(design, steps)
    if absent.shape[1] != design.m:
        msg = f"design: expected {absent.shape[1]} measurements as the truth has, received {design.m}"
        raise ValueError(msg)
    plan = planned(design, absent, first, algorithm) if given is None else given
    if plan.K.shape != (steps + 1, design.n, design.m):
        msg = f"gains: expected gains of shape {(steps + 1, design.n, design.m)}, received {plan.K.shape}"
        raise ValueError(msg)
    used = plan.used & ~absent
    used[:first] = False
    A, _Q, M = motion.motions(design, used)
    W, nees_dof = whiten(plan.P_plus)
    V, nis_dof = whiten(np.where(used[:, :, None] & used[:, None, :], plan.S, 0.0))
    zero = np.zeros((steps + 1, design.n))
    arrays = Design(
        x0=np.array(design.x0),
        A=A,
        b=stack(np.zeros(design.n) if design.offset is None else design.offset, 1),
        M=M,
        H=stack(design.H, 2),
        K=np.ascontiguousarray(np.where(used[:, None, :], plan.K, 0.0)),
        W=W,
        V=V,
        E=E,
        same=bool(E.shape[0] == E.shape[1] and (E == np.eye(len(E))).all()),
        shift_minus=zero,
        shift=zero,
        shift_white=zero,
    )
    return Gains(arrays, plan, nees_dof, nis_dof)


def about_mean_error(truth: Truth, design: Design, steps: int, dt: float) -> Design:
    """The design with the mean errors that a linear truth gives it: sums are taken about them."""
    minus, plus = _mean_error(truth, design, steps, dt)
    return design._replace(shift_minus=minus, shift=plus, shift_white=np.einsum("kij,kj->ki", design.W, plus))


def selection(compare: ArrayLike | None, d: int, n: int) -> Array:
    """The matrix E of e = x̂ − E x, (d, n); without one truth and design have the same states."""
    if compare is None:
        if d != n:
            msg = f"compare: expected a matrix of shape ({d}, {n}) (design and truth differ in order), received None"
            raise ValueError(msg)
        return np.eye(n)
    return np.array(checks.shaped("compare", compare, (d, n)), order="C")


def missing(model: DiscreteModel, steps: int) -> Mask:
    """Which elements a truth does not measure, (steps+1, m)."""
    absent = np.isinf(np.diagonal(model.R, axis1=-2, axis2=-1))
    return np.array(np.broadcast_to(absent, (len(absent) if absent.ndim == 2 else steps + 1, model.m))[: steps + 1])


def whiten(P: Array) -> tuple[Array, Array]:
    """W with |W e|² = eᵀP⁺e (P⁺ the pseudo-inverse) for each P of a stack, and the ranks.

    Directions without variance are left out: their row of W is zero.
    """
    diagonal = np.diagonal(P, axis1=-2, axis2=-1)
    scale = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    unit = P / (scale[:, :, None] * scale[:, None, :])
    which = np.concatenate([[True], (unit[1:] != unit[:-1]).any(axis=(1, 2))])  # what repeats is done once
    W, rank = _whitened(unit[which])
    again = np.cumsum(which) - 1
    return np.ascontiguousarray(W[again] / scale[:, None, :]), rank[again]


def _whitened(unit: Array) -> tuple[Array, Array]:
    """:func:`whiten` in unit variances: triangular, with half the products, or spectral where P is singular."""
    count, n = unit.shape[:2]
    W, rank, full = np.empty_like(unit), np.full(count, float(n)), np.zeros(count, dtype=bool)
    with suppress(np.linalg.LinAlgError):
        inverse = np.tril(np.linalg.inv(np.linalg.cholesky(unit)))
        full = (inverse**2).sum(axis=(1, 2)) * n * RANK < 1  # the sum is at least 1/λ of every eigenvalue, and these are at most n
        W[full] = inverse[full]
    values, vectors = np.linalg.eigh(unit[~full])
    kept = values > RANK * np.maximum(values[:, -1:], np.finfo(float).tiny)
    W[~full] = np.where(kept, 1 / np.sqrt(np.where(kept, values, 1.0)), 0.0)[:, :, None] * np.swapaxes(vectors, 1, 2)
    rank[~full] = kept.sum(axis=1)
    regular = np.flatnonzero(~full)[kept.all(axis=1)]
    if regular.size:
        W[regular] = np.tril(np.linalg.inv(np.linalg.cholesky(unit[regular])))
    return W, rank


def check_finite(name: str, value: Array, dt: float) -> None:
    """A ``FloatingPointError`` that names the first step at which ``value`` (time first) is not finite."""
    wrong = ~np.isfinite(value.reshape(len(value), -1)).all(axis=1)
    if wrong.any():
        k = int(np.argmax(wrong))
        msg = f"{name}: expected finite values, received an overflow at step {k} (t = {moment(k * dt)} s)"
        raise FloatingPointError(msg)


def _mean_error(truth: Truth, design: Design, steps: int, dt: float) -> tuple[Array, Array]:
    """E[e] before and after each update; sums taken about it lose nothing to a large bias."""
    d = len(design.x0)
    minus, plus = np.empty((steps + 1, d)), np.empty((steps + 1, d))
    x, estimate = truth.x0, design.x0
    with np.errstate(over="ignore", invalid="ignore"):  # an overflow is reported below, with its time
        for k in range(steps + 1):
            if k:
                z = entry(truth.H, k - 1) @ x
                estimate = entry(design.A, k - 1) @ estimate + entry(design.b, k - 1)
                if len(design.M):
                    estimate = estimate + entry(design.M, k - 1) @ z
                x = entry(truth.Phi, k - 1) @ x + entry(truth.c, k - 1)
            minus[k] = estimate - design.E @ x
            estimate = estimate + entry(design.K, k) @ (entry(truth.H, k) @ x - entry(design.H, k) @ estimate)
            plus[k] = estimate - design.E @ x
    check_finite("mean error", plus, dt)
    return minus, plus
