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
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
import scipy.linalg

from ctlabs.linalg import checks, lyapunov, riccati
from ctlabs.linalg.checks import Array
from ctlabs.linalg.staircase import ComplexArray, clusters, eigenvalues, growing, hidden
from ctlabs.linalg.units import balanced, even
from ctlabs.models import ContinuousModel, DiscreteModel
from ctlabs.models.discretisation import interval

#: A direction is unseen below this size, relative to scaled matrices: above what sin(2π) leaves, below a real signal.
UNSEEN = 1e-12
#: An element of H below this part of its row's largest, in units of the model's own, is what rounding left: cos(π/2) is none.
ROUNDED = 64 * np.finfo(float).eps
#: An eigenvalue is on the boundary of stability below this distance, relative to the size of the matrix.
MARGIN = 1e-9

class Mode(NamedTuple):
    """An eigenvalue, the share of the states in its mode (all of a Jordan chain) in the scaled units, and whether it decays."""

    value: complex
    vector: Array | ComplexArray
    decays: bool = False

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
    A, H = measured(model)
    continuous = isinstance(model, ContinuousModel)
    return _analysed(A, H, _scaling(A, H, continuous), continuous, model.states)


def gramian(model: ContinuousModel | DiscreteModel, horizon: float) -> Array:
    r"""Observability Gramian: what the measurements over a horizon say of the initial state.

    .. math:: \int_0^{T} e^{F^Ts}H^THe^{Fs}ds \quad\text{or}\quad \sum_{k=0}^{N-1}(\Phi^k)^TH^TH\Phi^k

    Parameters
    ----------
    model : constant model
    horizon : T in s, > 0, of a continuous model; N ≥ 1, the number of measurements, of a discrete one; ``inf`` of a
        model whose modes all decay

    Returns
    -------
    (n, n), unit_z²·s or unit_z² per units of two states. A state along which it vanishes is not observable.

    Raises
    ------
    ValueError
        No horizon; an infinite one of a model with a mode that does not decay: it is named.

    Source: Kailath, *Linear Systems* (1980), section 9.2.

    >>> gramian(ContinuousModel(F=[[0, 1], [0, 0]], G=[[0], [1]], Q=[[1]], H=[[1, 0]], P0=[[1, 0], [0, 1]]), 1.0)
    array([[1.        , 0.5       ],
           [0.5       , 0.33333333]])
    """
    A, H = measured(model)
    if horizon == math.inf:
        return _endless(model, A, H)
    if isinstance(model, ContinuousModel):
        return interval(A.T, H.T @ H, checks.positive("horizon", horizon)).Qd
    rows, total = H, np.zeros_like(A)
    for _ in range(checks.count("horizon", horizon)):
        total = total + rows.T @ rows
        rows = rows @ A
    return total


def _endless(model: ContinuousModel | DiscreteModel, A: Array, H: Array) -> Array:
    """The Gramian over an infinite horizon."""
    continuous = isinstance(model, ContinuousModel)
    scaling = _scaling(A, H, continuous)
    lasting = [mode for mode in _modes(np.eye(len(A)), scaling.apply(A, H)[0], scaling, continuous) if not mode.decays]
    if lasting:
        msg = (
            f"horizon: expected a finite one beside a mode that does not decay, received inf and the mode "
            f"{lasting[0].name(model.states)}"
        )
        raise ValueError(msg)
    return riccati.stationary(A.T, H.T @ H, continuous=continuous).P.high


def loss_by_sampling(model: ContinuousModel, dt: float, seen: Array | None = None) -> SamplingLoss:
    r"""Whether samples every dt see all that a continuous measurement would.

    Two modes come together, and one measurement cannot tell them apart, when

    .. math:: \mathrm{Re}\,\lambda_i = \mathrm{Re}\,\lambda_j, \qquad \mathrm{Im}(\lambda_i-\lambda_j) = 2\pi k/dt,
              \quad k = 1, 2, \dots

    The condition names the periods to keep away from; what is lost in fact is found from the sampled pair (several
    measurements may still tell the modes apart). ``seen`` (m', n), what the samples see, where that is not H: the dual of a held input.

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
    checks.instance("model", model, ContinuousModel)
    dt = checks.positive("dt", dt)
    values = np.linalg.eigvals(model.F).astype(np.complex128)
    periods = {(low, high): _nearest(2 * math.pi / apart, dt) for low, high, apart in _comparable(values)}
    Phi = interval(model.F, np.zeros((model.n, model.n)), dt).Phi
    # The continuous model's units: those of Φ itself may depend on elements like sin(2π) that are rounding.
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
        sampled=_analysed(Phi, measured(model)[1], scaling, False, model.states, unseen)
        if seen is None
        else _analysed(Phi, seen, _scaling(model.F, seen, continuous=True)._replace(time=1.0), False, model.states, unseen),
    )


def undetectable(A: Array, H: Array, continuous: bool, unseen: float = UNSEEN) -> list[Mode]:
    """The modes of A that do not decay and are not seen by H, of conjugate pairs the one with Im λ > 0.

    ``unseen``: directions below this size in scaled matrices are; below :data:`ROUNDED` they are rounding in any case.
    """
    scaling = _scaling(A, H, continuous)
    scaled, seen = scaling.apply(A, H)
    modes = _modes(never_seen(scaled, seen, unseen), scaled, scaling, continuous)
    return [mode for mode in modes if not mode.decays]


def measured(model: ContinuousModel | DiscreteModel) -> tuple[Array, Array]:
    """A and H of a constant model, as far as they say what is measured.

    Elements of a discrete measurement with R = ∞ are left out. An element of H that is the rounding of its own row is
    zero: the cosine of a heading of 90°, 6e-17, beside a sine of 1. Rows of states in different units do not compare as
    numbers; what compares is the contribution to the measurement of each state's σ at the start, and of the noise that
    drives it (in units in which the elements of A and of that noise are near 1). Both must be below ``ROUNDED`` of
    the row's largest, and neither changes with the user's units.
    """
    if isinstance(model, ContinuousModel):
        A, H, W = model.F, model.H, model.G @ model.Q @ model.G.T
    else:
        checks.instance("model", model, DiscreteModel)
        if max(model.Phi.ndim, model.H.ndim, model.R.ndim) == 3:
            msg = f"model: expected constant Phi, H and R, received some that vary over {model.horizon} steps"
            raise ValueError(msg)
        A, H = model.Phi, model.H[np.isfinite(np.diag(model.R))]
        W = model.Qd if model.Qd.ndim == 2 else model.Qd.max(axis=0)
    if (np.count_nonzero(H, axis=1) < 2).all():
        return A, H
    start = np.diag(model.P0)
    known = (start > 0) & np.isfinite(start)
    shares = [
        np.abs(H) * np.sqrt(np.where(known, start, 0.0)),
        np.abs(H) * balanced(A, W, continuous=isinstance(model, ContinuousModel)).states,
    ]
    rounded = np.all([share <= ROUNDED * share.max(axis=1, keepdims=True) for share in shares], axis=0)
    return A, np.where(rounded, 0.0, H)


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
    n, time = A.shape[0], 1.0
    if continuous:
        time = np.abs(np.linalg.eigvals(A)).max(initial=0.0) or 1.0
    # An equation log|element| + unit of its column − unit of its row = 0, weighted, for each; the normal equations of all.
    whole = np.vstack([A / time, H])
    weights = np.vstack([_weights(A, time), (H != 0).astype(float)]) ** 2
    logs = weights * np.log2(np.abs(whole), where=weights > 0, out=np.zeros_like(whole))
    normal = np.diag(weights.sum(axis=1))
    normal[:n, :n] += np.diag(weights.sum(axis=0))
    normal[:, :n] -= weights
    normal[:n, :] -= weights.T
    right = logs.sum(axis=1)
    right[:n] -= logs.sum(axis=0)
    units = np.exp2(np.linalg.lstsq(normal, right, rcond=1e-14)[0].round())
    return _Scaling(units[:n], units[n:], time)


def _weights(A: Array, time: float) -> Array:
    """How much each element of A says about units: what may be rounding decides only where nothing else does."""
    size, eps = np.abs(A), np.finfo(float).eps
    row, column = size.max(axis=1, initial=1e-300), size.max(axis=0, initial=1e-300)
    relative = size / np.minimum(row[:, None], column)
    loop = size * size.T / time**2  # the same in all units; below rounding, one of the two elements is rounding
    weights = np.where(loop > 0, np.where(loop > 1e-13, 1.0, 1e-3), np.where(relative > 1e-13, 1.0, 1e-6))
    return np.where(((relative > 4 * eps) | (loop > 0)) & ~np.eye(len(A), dtype=bool), weights, 0.0)


def never_seen(A: Array, H: Array, unseen: float) -> Array:
    """Orthonormal basis of what H does not see, and A keeps, in these units and in those that balance the rows and columns of A.

    What is hidden is so in all units; what is seen may seem hidden beside elements a million times as large.
    """
    found = hidden(A, H, unseen, unseen)
    if not found.shape[1]:
        return found
    balanced_A, units = even(A)
    rows = H * units
    size = np.abs(rows).max(axis=1, initial=0.0)
    other = hidden(balanced_A, rows / np.where(size > 0, size, 1.0)[:, None], unseen, unseen)
    return found if other.shape[1] >= found.shape[1] else np.linalg.qr(other * units[:, None])[0]


def _modes(basis: Array, A: Array, scaling: _Scaling, continuous: bool) -> list[Mode]:
    """The modes of A in an invariant subspace; one of eigenvalues that cannot be told apart, of conjugate pairs that with Im λ > 0."""
    inner = basis.T @ A @ basis
    values, doubt = eigenvalues(inner)
    rounded = 0.0
    if not np.isin(np.abs(basis), (0.0, 1.0)).all():  # no states themselves: the product itself rounds
        rounded = 4 * len(A) * np.finfo(float).eps * float(np.abs(A).sum(axis=1).max())
    doubt = doubt + rounded
    stable, found = lyapunov.stable(inner, continuous=continuous), []
    # Modes of a subspace are modes of A, whose eigenvalues may be known better than those of the product.
    settled = bool(basis.shape[1]) and bool((growing(A, continuous) < 0).all())
    for group in clusters(values, doubt):
        value = complex(values[group].mean())
        if value.imag < -doubt[group].max():
            continue
        inside = set(group.tolist())
        _, Z, count = scipy.linalg.schur(
            inner, output="complex", sort=lambda v, inside=inside: int(np.abs(values - v).argmin()) in inside
        )
        share = np.linalg.norm(basis @ Z[:, : max(count, 1)], axis=1)
        distance = value.real if continuous else abs(value) - 1
        # A proof for the product says nothing of a mode that its rounding could have taken over the boundary.
        decays = settled or distance < -doubt[group].max() or (stable and distance < -rounded)
        found.append(Mode(value * scaling.time, share, bool(decays)))
    return found


def _analysed(
    A: Array, H: Array, scaling: _Scaling, continuous: bool, states: tuple[str, ...], unseen: float = UNSEEN
) -> Observability:
    """Evidence for one pair."""
    scaled, seen = scaling.apply(A, H)
    lost_in = never_seen(scaled, seen, unseen)
    rest = scipy.linalg.null_space(lost_in.T) if lost_in.shape[1] else np.eye(len(A))
    lost = np.linalg.eigvals(lost_in.T @ scaled @ lost_in)
    values = np.concatenate([lost, np.linalg.eigvals(rest.T @ scaled @ rest)]).astype(np.complex128)
    values = values[np.lexsort((values.imag.round(9), values.real.round(9)))]
    # Of a conjugate pair the singular values are the same.
    known = {value: _pencil(scaled, seen, value, lost) for value in values[values.imag >= 0].tolist()}
    sigma = np.array([known[value if value in known else value.conjugate()] for value in values.tolist()]).reshape(len(A), len(A))
    modes = _modes(lost_in, scaled, scaling, continuous)
    return Observability(
        eigenvalues=values * scaling.time,
        ranks=tuple(int(r) for r in (sigma > unseen).sum(axis=1)),
        sigma_min=sigma[:, -1],
        unobservable=scaling.back(lost_in),
        unobservable_modes=tuple(mode.name(states) for mode in modes),
        undetectable_modes=tuple(mode.name(states) for mode in modes if not mode.decays),
    )


def _pencil(A: Array, H: Array, value: complex, lost: ComplexArray) -> Array:
    """Singular values of the pencil at an eigenvalue, relative to the largest.

    A multiple eigenvalue is computed with errors like the root of rounding: where it belongs to a lost mode too,
    the pencil is taken at that one.
    """
    if len(lost) and np.abs(lost - value).min() < 1e-6 * max(1.0, abs(value)):
        value = lost[np.abs(lost - value).argmin()]
    at = value if value.imag else value.real
    sigma = np.linalg.svd(np.vstack([A - at * np.eye(len(A)), H]), compute_uv=False)
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
