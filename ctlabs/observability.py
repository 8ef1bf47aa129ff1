r"""Observability as evidence: which modes a measurement sees, how well, and what sampling loses.

A mode :math:`\lambda, v` with :math:`Av = \lambda v` is not seen by :math:`z = Hx` when :math:`Hv = 0`; the pencil
:math:`[A - \lambda I;\ H]` then loses rank (Popov–Belevitch–Hautus). The subspace of what is never seen is found by
orthogonal steps (the staircase), which repeated eigenvalues do not disturb; the pencil's singular values say how near
to a loss each mode is.

States in mixed units would make such numbers meaningless (a metre beside a radian per second), so every decision is
taken in units chosen by the model itself: the states, measurements and time are scaled so that the nonzero elements of
A and H come as near to 1 as they can in the mean of their logarithms (Curtis & Reid 1972). Results in those units
do not change when the user's units do. States named as part of a mode are those with a share in it in these units.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg

from ctlabs import _check
from ctlabs._check import Array
from ctlabs.discretise import interval, ldl
from ctlabs.models import ContinuousModel, DiscreteModel

#: A direction is unseen below this size, relative to scaled matrices: above what sin(2π) leaves, below a real signal.
UNSEEN = 1e-12
#: The same for noise: what is left of a singular covariance is its rounding, and the factor has the square root of it.
UNDRIVEN = 3e-7
#: An eigenvalue is on the boundary of stability below this distance, relative to the size of the matrix.
MARGIN = 1e-9

ComplexArray = np.ndarray[Any, np.dtype[np.complex128]]


class Mode(NamedTuple):
    """An eigenvalue and its eigenvector in the scaled units, whose elements compare."""

    value: complex
    vector: ComplexArray

    def name(self, states: tuple[str, ...]) -> str:
        """The one way a mode is named in messages and reports.

        >>> Mode(1.0, np.array([1.0, 0.0, -0.5])).name(("x1", "x2", "x3"))
        'eigenvalue 1 of the states x1, x3'
        """
        share = np.abs(self.vector) / np.abs(self.vector).max()
        parts = ", ".join(name for name, s in zip(states, share, strict=True) if s > 1e-6)
        imag = f" ± {abs(self.value.imag):.6g}i" if abs(self.value.imag) > 1e-12 * abs(self.value) else ""
        # Adding 0 turns -0 into 0; rounding leaves no 1e-19 beside an imaginary part.
        real = self.value.real if abs(self.value.real) > 1e-12 * abs(self.value) else 0.0
        return f"eigenvalue {real + 0.0:.6g}{imag} of the states {parts}"


@dataclass(frozen=True, slots=True, eq=False)
class Observability:
    """What the measurements see of a model, with the evidence.

    ``eigenvalues`` (n,), ascending · ``ranks`` (n,), of the pencil at each of them: n when the mode is seen ·
    ``sigma_min`` (n,), the pencil's smallest singular value relative to its largest, in the model's own units
    (unit-free): how near to a loss · ``unobservable`` (n, d), orthonormal basis of the states never seen, in the
    user's units · ``unobservable_modes``, ``undetectable_modes``: names of the modes that are not seen, and of those
    among them that do not decay either (conjugate pairs once)
    """

    eigenvalues: ComplexArray
    ranks: tuple[int, ...]
    sigma_min: Array
    unobservable: Array
    unobservable_modes: tuple[str, ...]
    undetectable_modes: tuple[str, ...]

    @property
    def rank(self) -> int:
        """Dimension of what is seen: the rank of the observability matrix."""
        return self.unobservable.shape[0] - self.unobservable.shape[1]

    @property
    def ok(self) -> bool:
        """Every state is observable."""
        return self.unobservable.shape[1] == 0

    @property
    def detectable(self) -> bool:
        """Every mode that is not seen decays, so a steady filter exists."""
        return not self.undetectable_modes


@dataclass(frozen=True, slots=True, eq=False)
class SamplingLoss:
    r"""What sampling with a period does to observability.

    ``dt`` s · ``rank_continuous``, ``rank``: of the model and of its samples · ``pairs``: the pairs of eigenvalues
    that come together in :math:`e^{\lambda dt}` (conjugate pairs once) · ``losing_periods``, s, the nearest one of each
    pair that can come together, ascending · ``distance``, of dt to the nearest of them, relative; ``inf`` if there are
    none · ``sampled``, the evidence for the sampled model
    """

    dt: float
    rank_continuous: int
    pairs: tuple[tuple[complex, complex], ...]
    losing_periods: tuple[float, ...]
    distance: float
    sampled: Observability

    @property
    def rank(self) -> int:
        """Rank of the sampled model."""
        return self.sampled.rank

    @property
    def lost(self) -> bool:
        """The samples see less than the continuous measurement would."""
        return self.rank < self.rank_continuous


def analyse(model: ContinuousModel | DiscreteModel) -> Observability:
    r"""Observability and detectability of a constant model.

    .. math:: \mathrm{rank}\begin{bmatrix}A-\lambda I\\ H\end{bmatrix} = n \text{ at every eigenvalue of } A

    (A = F or Φ.) Elements of a discrete measurement with R = ∞ are not measured.

    Raises
    ------
    TypeError, ValueError
        Not a model; matrices that vary with time.

    Source: Kailath, *Linear Systems* (1980), section 2.4 (PBH tests) and 6.2 (staircase).

    >>> m = ContinuousModel(F=[[0, 0], [0, 0]], G=[[1, 0], [0, 1]], Q=[[1, 0], [0, 1]], H=[[1, 1]], P0=[[1, 0], [0, 1]])
    >>> seen = analyse(m)
    >>> seen.rank, seen.detectable, seen.undetectable_modes
    (1, False, ('eigenvalue 0 of the states x1, x2',))
    """
    A, H = _pair(model)
    continuous = isinstance(model, ContinuousModel)
    return _analysed(A, H, _scaling(A, H, continuous), growth(A, continuous), model.states)


def gramian(model: ContinuousModel | DiscreteModel, horizon: float) -> Array:
    r"""Observability Gramian: what the measurements over a horizon say of the initial state.

    .. math:: \int_0^{T} e^{F^Ts}H^THe^{Fs}ds \quad\text{or}\quad \sum_{k=0}^{N-1}(\Phi^k)^TH^TH\Phi^k

    Parameters
    ----------
    model : constant model
    horizon : T in s, > 0, of a continuous model; N ≥ 1, the number of measurements, of a discrete one

    Returns
    -------
    (n, n), unit_z²·s or unit_z² per units of two states. A state along which it vanishes is not observable.

    Source: Kailath, *Linear Systems* (1980), section 9.2.

    >>> gramian(ContinuousModel(F=[[0, 1], [0, 0]], G=[[0], [1]], Q=[[1]], H=[[1, 0]], P0=[[1, 0], [0, 1]]), 1.0)
    array([[1.        , 0.5       ],
           [0.5       , 0.33333333]])
    """
    A, H = _pair(model)
    if isinstance(model, ContinuousModel):
        return interval(A.T, H.T @ H, _check.positive("horizon", horizon)).Qd
    rows, total = H, np.zeros_like(A)
    for _ in range(_check.count("horizon", horizon)):
        total = total + rows.T @ rows
        rows = rows @ A
    return total


def loss_by_sampling(model: ContinuousModel, dt: float) -> SamplingLoss:
    r"""Whether samples every dt see all that a continuous measurement would.

    Two modes come together, and one measurement cannot tell them apart, when

    .. math:: \mathrm{Re}\,\lambda_i = \mathrm{Re}\,\lambda_j, \qquad \mathrm{Im}(\lambda_i-\lambda_j) = 2\pi k/dt,
              \quad k = 1, 2, \dots

    The condition names the periods to keep away from; what is lost in fact is found from the sampled pair (several
    measurements may still tell the modes apart).

    Raises
    ------
    TypeError, ValueError
        Not a continuous model; dt ≤ 0.

    Source: Kalman, Ho & Narendra (1963), *Contributions to Differential Equations* 1, 189.

    >>> swing = ContinuousModel(F=[[0, 1], [-1, 0]], G=[[0], [1]], Q=[[1]], H=[[1, 0]], P0=[[1, 0], [0, 1]])
    >>> loss = loss_by_sampling(swing, 2 * np.pi)
    >>> loss.lost, loss.rank, loss.pairs
    (True, 1, ((-1j, 1j),))
    >>> loss_by_sampling(swing, np.pi / 2).lost
    False
    """
    _check.instance("model", model, ContinuousModel)
    dt = _check.positive("dt", dt)
    values = np.linalg.eigvals(model.F).astype(np.complex128)
    periods = {(low, high): _nearest(2 * math.pi / apart, dt) for low, high, apart in _comparable(values)}
    Phi = interval(model.F, np.zeros((model.n, model.n)), dt).Phi
    # The continuous model's units: those of Φ itself may hang on elements like sin(2π) that are rounding.
    scaling = _scaling(model.F, model.H, continuous=True)._replace(time=1.0)
    # The phase λ dt is known to rounding, whatever it is; so are the elements of Φ that vanish with it.
    unseen = max(UNSEEN, 8 * np.finfo(float).eps * np.abs(values).max(initial=0.0) * dt)
    ascending = sorted(periods.values())
    distinct = [now for before, now in zip([0.0, *ascending], ascending, strict=False) if now - before > MARGIN * now]
    met = tuple(pair for pair, period in periods.items() if abs(dt - period) <= MARGIN * period)
    return SamplingLoss(
        dt=dt,
        rank_continuous=analyse(model).rank,
        pairs=met,
        losing_periods=tuple(distinct),
        distance=min((abs(dt - period) / period for period in distinct), default=math.inf),
        sampled=_analysed(Phi, model.H, scaling, growth(Phi, continuous=False), model.states, unseen),
    )


def growth(A: Array, continuous: bool) -> Callable[[complex], float]:
    """A measure of eigenvalues, relative to A: negative if the mode decays, 0 on the boundary, positive if it grows."""
    if not continuous:
        return lambda value: abs(value) - 1
    size = max(np.abs(scipy.linalg.matrix_balance(A, permute=False)[0]).sum(axis=1).max(initial=0.0), 1e-300)
    return lambda value: value.real / size


def undetectable(A: Array, H: Array, continuous: bool) -> list[Mode]:
    """The modes of A that do not decay and are not seen by H, of conjugate pairs the one with Im λ > 0."""
    scaling, grows = _scaling(A, H, continuous), growth(A, continuous)
    scaled, seen = scaling.apply(A, H)
    modes = _modes(_hidden(scaled, seen, UNSEEN, UNSEEN), scaled, scaling.time)
    return [mode for mode in modes if grows(mode.value) >= -MARGIN]


def driven(A: Array, Q: Array, continuous: bool) -> tuple[Array, Array]:
    """Coordinates y of the states x = T y that stay uncertain: T (n, p) and L (p, n) with L T = I.

    Left out are the left modes wᵀA = λwᵀ that do not grow and that no noise drives, wᵀQ = 0 (Jordan chains included):
    the variance along them dies out, or tends to zero as they are measured. What remains, {x : wᵀx = 0}, is kept by A:
    y has the transition L A T and the noise L Q Lᵀ, in units in which their elements are near 1.
    """
    factor, d = ldl(Q)
    B = (factor * np.sqrt(d))[:, d > UNDRIVEN**2 * np.diag(Q)].T
    scaling, grows = _scaling(A.T, B, continuous), growth(A, continuous)
    scaled, seen = scaling.apply(A.T, B)
    hidden = _hidden(scaled, seen, UNDRIVEN, UNSEEN)
    if hidden.shape[1]:
        inner = hidden.T @ scaled @ hidden
        _, Z, count = scipy.linalg.schur(inner, sort=lambda re, im=0.0: grows(complex(re, im) * scaling.time) <= MARGIN)
        hidden = hidden @ Z[:, :count]
    kept = scipy.linalg.null_space(hidden.T) if hidden.shape[1] else np.eye(len(A))
    # A state that becomes known exactly has variance 0, not the square of rounding.
    kept = np.where(np.abs(kept).max(axis=1, initial=0.0)[:, None] > 1e-12, kept, 0.0)
    return kept / scaling.states[:, None], kept.T * scaling.states


class _Scaling(NamedTuple):
    """Units of the states, of the measurements, and of time (1/s): x = states·x̂, Â = A/time in those units."""

    states: Array
    measurements: Array
    time: float

    def apply(self, A: Array, H: Array) -> tuple[Array, Array]:
        return A * self.states / self.states[:, None] / self.time, H * self.states / self.measurements[:, None]

    def back(self, basis: Array) -> Array:
        """An orthonormal basis in the user's units of a subspace given in these, free of rounding where it is zero."""
        if not basis.shape[1]:
            return basis
        # Echelon form: a basis with unit vectors at the rows that determine the others, so that zeros are zeros.
        pivots = scipy.linalg.qr(basis.T, pivoting=True, mode="r")[1][: basis.shape[1]]
        plain = np.linalg.solve(basis[pivots].T, basis.T).T
        plain = np.where(np.abs(plain) > 1e-11, plain, 0.0) * self.states[:, None]
        q, r = np.linalg.qr(plain / np.abs(plain).max(axis=0))
        return q * np.where(np.diag(r) < 0, -1.0, 1.0) + 0.0


def _scaling(A: Array, H: Array, continuous: bool) -> _Scaling:
    """Units in which the nonzero elements of A and H are near 1: least squares in the logarithms, powers of 2."""
    n, m = A.shape[0], H.shape[0]
    time = 1.0
    if continuous:
        time = np.abs(np.linalg.eigvals(A)).max(initial=0.0) or 1.0
    rows: list[Array] = []
    logs: list[float] = []
    size, weights = np.abs(A), _weights(A, time)
    for i, j in np.argwhere(weights > 0):
        rows.append(weights[i, j] * (_unit(i, n + m) - _unit(j, n + m)))
        logs.append(weights[i, j] * math.log2(size[i, j] / time))
    for k, j in np.argwhere(H != 0):
        rows.append(_unit(n + k, n + m) - _unit(j, n + m))
        logs.append(math.log2(abs(H[k, j])))
    if not rows:
        return _Scaling(np.ones(n), np.ones(m), time)
    units = np.exp2(np.linalg.lstsq(np.array(rows), np.array(logs), rcond=1e-12)[0].round())
    return _Scaling(units[:n], units[n:], time)


def _weights(A: Array, time: float) -> Array:
    """How much each element of A says about units: what may be rounding decides only where nothing else does."""
    size, eps = np.abs(A), np.finfo(float).eps
    row, column = size.max(axis=1, initial=1e-300), size.max(axis=0, initial=1e-300)
    relative = size / np.minimum(row[:, None], column)
    loop = size * size.T / time**2  # the same in all units; below rounding, one of the two elements is rounding
    weights = np.where(loop > 0, np.where(loop > 1e-13, 1.0, 1e-3), np.where(relative > 1e-13, 1.0, 1e-6))
    return np.where(((relative > 4 * eps) | (loop > 0)) & ~np.eye(len(A), dtype=bool), weights, 0.0)


def _unit(i: int, size: int) -> Array:
    vector = np.zeros(size)
    vector[i] = 1.0
    return vector


def _pair(model: ContinuousModel | DiscreteModel) -> tuple[Array, Array]:
    """A and the rows of H that are measured."""
    if isinstance(model, ContinuousModel):
        return model.F, model.H
    _check.instance("model", model, DiscreteModel)
    if max(model.Phi.ndim, model.H.ndim, model.R.ndim) == 3:
        msg = f"model: expected constant Phi, H and R, received some that vary over {model.horizon} steps"
        raise ValueError(msg)
    return model.Phi, model.H[np.isfinite(np.diag(model.R))]


def _hidden(A: Array, H: Array, seen: float, moved: float) -> Array:
    """Orthonormal basis of the largest subspace that H does not see and A keeps, up to these fractions of H and A."""
    V = _kernel(H, seen * max(np.abs(H).max(initial=0.0), 1e-300))
    size = max(1.0, float(np.linalg.norm(A, 2))) if A.size else 1.0
    while V.shape[1]:
        image = A @ V
        kept = _kernel(image - V @ (V.T @ image), moved * size)
        if kept.shape[1] == V.shape[1]:
            break
        V = V @ kept
    return V


def _kernel(M: Array, tolerance: float) -> Array:
    """Orthonormal basis of the directions that M takes below a tolerance."""
    if not M.size:
        return np.eye(M.shape[1])
    _, sigma, rows = np.linalg.svd(M)
    return rows[int((sigma > tolerance).sum()) :].T


def _modes(basis: Array, A: Array, time: float) -> list[Mode]:
    """The modes of A in an invariant subspace, of conjugate pairs the one with Im λ > 0."""
    values, vectors = np.linalg.eig(basis.T @ A @ basis)
    return [Mode(complex(v * time), basis @ y) for v, y in zip(values, vectors.T, strict=True) if v.imag >= 0]


def _analysed(
    A: Array,
    H: Array,
    scaling: _Scaling,
    grows: Callable[[complex], float],
    states: tuple[str, ...],
    unseen: float = UNSEEN,
) -> Observability:
    """Evidence for one pair."""
    scaled, seen = scaling.apply(A, H)
    hidden = _hidden(scaled, seen, unseen, unseen)
    rest = scipy.linalg.null_space(hidden.T) if hidden.shape[1] else np.eye(len(A))
    lost = np.linalg.eigvals(hidden.T @ scaled @ hidden)
    values = np.concatenate([lost, np.linalg.eigvals(rest.T @ scaled @ rest)]).astype(np.complex128)
    values = values[np.lexsort((values.imag.round(9), values.real.round(9)))]
    sigma = np.array([_pencil(scaled, seen, value, lost) for value in values]).reshape(len(A), len(A))
    modes = _modes(hidden, scaled, scaling.time)
    return Observability(
        eigenvalues=values * scaling.time,
        ranks=tuple(int(r) for r in (sigma > unseen).sum(axis=1)),
        sigma_min=sigma[:, -1],
        unobservable=scaling.back(hidden),
        unobservable_modes=tuple(mode.name(states) for mode in modes),
        undetectable_modes=tuple(mode.name(states) for mode in modes if grows(mode.value) >= -MARGIN),
    )


def _pencil(A: Array, H: Array, value: complex, lost: ComplexArray) -> Array:
    """Singular values of the pencil at an eigenvalue, relative to the largest.

    A multiple eigenvalue is computed with errors like the root of rounding: where it belongs to a lost mode too,
    the pencil is taken at that one.
    """
    if len(lost) and np.abs(lost - value).min() < 1e-6 * max(1.0, abs(value)):
        value = lost[np.abs(lost - value).argmin()]
    sigma = np.linalg.svd(np.vstack([A - value * np.eye(len(A)), H]), compute_uv=False)
    return sigma / max(sigma[0], 1e-300)


def _nearest(period: float, dt: float) -> float:
    """The multiple (1, 2, …) of a period nearest to dt."""
    return period * max(1, round(dt / period))


def _comparable(values: ComplexArray) -> list[tuple[complex, complex, float]]:
    """Pairs of eigenvalues with equal real parts, the lower one first, and their distance; mirrored ones once."""
    close = 1e-7 * max(np.abs(values).max(initial=0.0), 1e-300)  # double eigenvalues are known to the root of rounding
    found: list[tuple[complex, complex, float]] = []
    for pair in combinations([complex(value) for value in values], 2):
        low, high = sorted(pair, key=lambda value: value.imag)
        apart = high.imag - low.imag
        if abs(low.real - high.real) > close or apart <= close:
            continue
        mirror = (high.conjugate(), low.conjugate())
        known = (both for *both, _ in found)
        if not any(np.abs(np.subtract(both, same)).max() <= close for both in known for same in ((low, high), mirror)):
            found.append((low, high, apart))
    return found
