r"""Filters of lower order for perfect measurements, and so for coloured measurement noise.

Measurement noise that is coloured becomes part of the state, and what is left of it in z = Hx + v is no white noise: some
combinations of the measurements are perfect. Each of them determines one direction of the state, so that the error
covariance is singular and the filter carries more equations than it needs. In the basis (ζ, y) of the perfect measurements
ζ = H_p x and the rest y = W x,

.. math:: x = L\zeta + My, \qquad \begin{bmatrix} H_p \\ W\end{bmatrix}\begin{bmatrix} L & M\end{bmatrix} = I,

only y has to be estimated. What the next measurement adds to the present one (in continuous time: its derivative) is a
measurement of y whose noise is the process noise itself: a model with white noises that correlate, N ≠ 0.

:func:`discrete` and :func:`continuous` make that model; the other verbs lead back to the state of the given one. All are
exact: the reduced filter gives the estimates of the full one to rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from ctlabs.filtering import bucy, motion
from ctlabs.filtering import filter as full
from ctlabs.filtering import steady as steady_state
from ctlabs.filtering.engines import adapter
from ctlabs.filtering.measured import begins
from ctlabs.filtering.problem import by_instant, rows_of
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.linalg.correlated import regression
from ctlabs.linalg.covariance import symmetric
from ctlabs.linalg.factors import ldl
from ctlabs.models import ContinuousModel, DiscreteModel

#: Perfect measurements depend on each other when the relative size of one, given the others, is below this.
DEPENDENT = 1e-10


class Basis(NamedTuple):
    """The basis (ζ, y): x = Lζ + My, ζ = H_p x = D_p z, y = Wx; ``D`` decorrelates the noises of the measurements.

    ``D_p``, ``D_n`` (p, m), (m−p, m), their perfect and noisy rows, ``H_p``, ``H_n`` those of DH, ``noisy`` the
    variances or strengths of the latter · ``T`` (n, n), the rows of H_p and W · ``y``, the indices of the states that
    make up y
    """

    D_p: Array
    D_n: Array
    H_p: Array
    H_n: Array
    noisy: Array
    T: Array
    L: Array
    M: Array
    W: Array
    y: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class ReducedDiscrete:
    r"""The reduced model in discrete time.

    .. math:: y_{k+1} = \tilde\Phi y_k + \tilde w_k + B_yz_k + c_y, \qquad
              A_1z_{k+1} - A_0z_k - c_z = \tilde Hy_k + \tilde v_k

    ``model``, with Φ̃, H̃, the covariances of w̃ and ṽ and their N; entry k of its measurement needs z_{k+1}, so its
    *prediction* of y is the estimate after the update of the full filter; P0 is the covariance of y after the first
    measurement · ``full``, the given model · ``basis`` · ``B_y`` (n−p, m), ``A_1``, ``A_0`` (m, m), ``c_y``, ``c_z`` ·
    ``K_first`` (n, m), the full gain at the first measurement · ``first``, its index
    """

    model: DiscreteModel
    full: DiscreteModel
    basis: Basis
    B_y: Array
    A_1: Array
    A_0: Array
    c_y: Array
    c_z: Array
    K_first: Array
    first: int


@dataclass(frozen=True, slots=True, eq=False)
class ReducedContinuous:
    r"""The reduced model in continuous time.

    .. math:: \dot y = \tilde Fy + WFL\zeta + WGw, \qquad
              \begin{bmatrix}\dot\zeta - H_pFL\zeta \\ (D_n - H_nLD_p)z\end{bmatrix} = \tilde Hy + \tilde v

    ``model``, with F̃, H̃, WG, the strengths of w and ṽ = (H_pGw, v_n) and their N; P0 is the covariance of y just after
    the measurement has begun · ``full``, the given model · ``basis`` · ``K_first`` (n, m), the gain at t0⁺
    """

    model: ContinuousModel
    full: ContinuousModel
    basis: Basis
    K_first: Array


@dataclass(frozen=True, slots=True, eq=False)
class Estimates:
    """Estimates by the reduced filter: ``t`` (steps+1,) s · ``x_plus`` (steps+1, n, runs) · ``y`` (steps+1, n−p, runs)."""

    t: Array
    x_plus: Array
    y: Array


@dataclass(frozen=True, slots=True, eq=False)
class ReducedSteadyState:
    """The limits of a filter, found by the reduced one.

    ``P`` (n, n), covariance of the error of the full state (after an update) · ``K`` (n, m), gain on the innovation of z;
    in continuous time (n−p, m), on that of the derived measurement · ``poles`` (n−p,)
    """

    P: Array
    K: Array
    poles: Array


class Realisation(NamedTuple):
    r"""A steady filter without differentiation: :math:`\dot\xi = A\xi + Bz,\ \hat x = C\xi + Dz`."""

    A: Array
    B: Array
    C: Array
    D: Array


def discrete(model: DiscreteModel, keep: Sequence[str | int] | None = None, first: int | None = None) -> ReducedDiscrete:
    """The reduced model of a discrete model with perfect measurements.

    Parameters
    ----------
    model : constant; some combinations of its measurements have no noise (R singular; R = 0 if all)
    keep : names or indices of the n − p states to be y; by default those best determined beside the measurements
    first : index of the first measurement, 1 or 0, by default as the model says

    Raises
    ------
    ValueError
        No perfect measurement, or as many as states (then there is nothing to estimate); perfect measurements of which
        one follows from the others; absent ones (R = inf); states in ``keep`` that the measurements determine.

    Source: Bryson & Henrikson (1968), J. Spacecraft 5, 662; Maybeck vol. 1, section 5.10.

    >>> m = DiscreteModel([[0.6, 0], [0, 0.4]], [[0.6, 0], [0, 0.2]], [[1, 1]], [[0]], P0=[[1, 0], [0, 0.5]])
    >>> small = discrete(m, first=0)
    >>> small.model.n, steady(small).P.round(6)
    (1, array([[ 0.187645, -0.187645],
           [-0.187645,  0.187645]]))
    """
    checks.instance("model", model, DiscreteModel)
    if model.horizon is not None:
        msg = f"model: expected constant matrices, received some that vary over {model.horizon} steps"
        raise ValueError(msg)
    first = begins(model, first)
    if not np.isfinite(np.diag(model.R)).all():
        msg = "R: expected every element to be measured, received inf"
        raise ValueError(msg)
    b = _basis("R", model.R, model.H, model.states, keep)
    NR = np.zeros((model.n, model.m)) if model.N is None else regression(model.N, model.R)
    # What a noisy measurement tells of the next disturbance is taken out first, as in the full filter.
    Phi, Qd = model.Phi - NR @ model.H, model.Qd - (0.0 if model.N is None else NR @ model.N.T)
    E, c = Phi @ b.L @ b.D_p + NR, np.zeros(model.n) if model.offset is None else model.offset
    U = np.vstack([b.H_p, b.H_n @ b.M @ b.W])
    x, P = model.x0, model.P0
    if first:
        x, P = _mean_at_t1(model), symmetric(model.Phi @ P @ model.Phi.T + model.Qd)
    K_first, _, P, _ = adapter.update(P, model.H, model.R)
    reduced = DiscreteModel(
        Phi=b.W @ Phi @ b.M,
        Qd=symmetric(b.W @ Qd @ b.W.T),
        H=U @ Phi @ b.M,
        R=symmetric(U @ Qd @ U.T + scipy.linalg.block_diag(np.zeros((len(b.D_p),) * 2), np.diag(b.noisy))),
        N=b.W @ Qd @ U.T,
        x0=b.W @ x,
        P0=symmetric(b.W @ P @ b.W.T),
        dt=model.dt,
        states=[model.states[i] for i in b.y],
        units=[model.units[i] for i in b.y],
    )
    A_1 = np.vstack([b.D_p, b.D_n - b.H_n @ b.L @ b.D_p])
    return ReducedDiscrete(reduced, model, b, b.W @ E, A_1, U @ E, b.W @ c, U @ c, K_first, first)


def continuous(model: ContinuousModel, keep: Sequence[str | int] | None = None) -> ReducedContinuous:
    r"""The reduced model of a continuous model with perfect measurements.

    Parameters
    ----------
    model : without Rc (all measurements are perfect) or with a singular one; no known input
    keep : as for :func:`discrete`

    Raises
    ------
    ValueError
        As for :func:`discrete`; also perfect measurements whose derivative has no white noise: it is then known as well,
        and an optimal filter would differentiate z; a model with B.

    Source: Bryson & Johansen (1965), IEEE Trans. AC-10, 4; Maybeck vol. 1, section 5.10.

    >>> m = ContinuousModel([[0, 0], [0, -2]], [[1, 0], [0, 1]], [[1, 0], [0, 3]], [[1, 1]], P0=[[1, 0], [0, 0.75]])
    >>> small = continuous(m, keep=[0])
    >>> transfer_function(small)
    (array([0.5, 1. ]), array([1., 1.]))
    """
    checks.instance("model", model, ContinuousModel)
    if model.B is not None:
        msg = "B: expected no known input (take the response to it out of x and z first), received one"
        raise ValueError(msg)
    Rc = np.zeros((model.m, model.m)) if model.Rc is None else model.Rc
    b = _basis("Rc", Rc, model.H, model.states, keep)
    GQ, direct = model.G @ model.Q, b.H_p @ model.G
    N_n = np.zeros((model.s, len(b.D_n))) if model.N is None else model.N @ b.D_n.T
    rate = symmetric(b.H_p @ GQ @ model.G.T @ b.H_p.T)
    size = (np.abs(direct) @ np.sqrt(np.diag(model.Q))) ** 2
    if not size.all() or (ldl(rate / np.sqrt(np.outer(size, size)))[1] < DEPENDENT).any():
        msg = (
            "model: expected white noise in the derivative of every perfect measurement, received HGQG'H' = "
            f"{rate.tolist()}: the derivative is known too, and an optimal filter would differentiate z"
        )
        raise ValueError(msg)
    K_first, _, P, _ = adapter.update(model.P0, b.H_p, np.zeros_like(rate))
    cross = direct @ N_n
    reduced = ContinuousModel(
        F=b.W @ model.F @ b.M,
        G=b.W @ model.G,
        Q=model.Q,
        H=np.vstack([b.H_p @ model.F @ b.M, b.H_n @ b.M]),
        Rc=np.block([[rate, cross], [cross.T, np.diag(b.noisy)]]),
        N=np.hstack([GQ.T @ b.H_p.T, N_n]),
        x0=b.W @ model.x0,
        P0=symmetric(b.W @ P @ b.W.T),
        states=[model.states[i] for i in b.y],
        units=[model.units[i] for i in b.y],
    )
    return ReducedContinuous(reduced, model, b, K_first @ b.D_p)


def covariances(reduced: ReducedDiscrete, steps: int) -> tuple[Array, Array]:
    """Covariances after each update and gains of the full filter, by the reduced one.

    Returns
    -------
    P_plus (steps+1, n, n), K (steps+1, n, m); before the first measurement the initial covariance and 0

    >>> m = DiscreteModel([[0.6, 0], [0, 0.4]], [[0.6, 0], [0, 0.2]], [[1, 1]], [[0]], P0=[[1, 0], [0, 0.5]])
    >>> bool(np.allclose(covariances(discrete(m, first=0), 5)[0], full.covariances(m, 5, first=0).P_plus, rtol=0, atol=1e-14))
    True
    """
    steps, b, first = checks.count("steps", steps), reduced.basis, reduced.first
    P = np.empty((steps + 1, reduced.full.n, reduced.full.n))
    K = np.zeros((steps + 1, reduced.full.n, reduced.full.m))
    P[0], K[first] = reduced.full.P0, reduced.K_first
    gains, P_y = _gains(reduced, steps - first)
    P[first:] = b.M @ P_y @ b.M.T
    K[first + 1 :] = b.L @ b.D_p + b.M @ gains @ reduced.A_1
    return P, K


def estimates(reduced: ReducedDiscrete, z: ArrayLike) -> Estimates:
    r"""The estimates of the full state by the recursion of lower order.

    .. math:: \hat y_{k+1} = \tilde\Phi\hat y_k + B_yz_k + c_y + K_k(A_1z_{k+1} - A_0z_k - c_z - \tilde H\hat y_k), \qquad
              \hat x_k^+ = L\zeta_k + M\hat y_k

    Parameters
    ----------
    reduced : from :func:`discrete`
    z : (rows, m) or (rows, m, runs), one row for each instant from the first measurement on, nothing missing

    >>> m = DiscreteModel([[0.6, 0], [0, 0.4]], [[0.6, 0], [0, 0.2]], [[1, 1]], [[0]], P0=[[1, 0], [0, 0.5]])
    >>> z = [[0.3], [1.0], [-0.5]]
    >>> estimates(discrete(m, first=0), z).x_plus[-1].round(6)
    array([-0.348994, -0.151006])
    >>> full.kalman_filter(m, z, first=0).x_plus[-1].round(6)
    array([-0.348994, -0.151006])
    """
    model, b, first = reduced.full, reduced.basis, reduced.first
    data, single = rows_of(z, model.m)
    if not np.isfinite(data).all():
        msg = "z: expected finite numbers (a gap needs the full filter), received NaN or infinity"
        raise ValueError(msg)
    data = by_instant(data, first)
    steps = len(data) - 1
    gains, _ = _gains(reduced, steps - first)
    x = np.empty((steps + 1, model.n, data.shape[2]))
    x[0] = model.x0[:, None]
    x[first] = _mean_at_t1(model)[:, None] if first else model.x0[:, None]
    x[first] += reduced.K_first @ (data[first] - model.H @ x[first])
    y = np.empty((steps + 1, reduced.model.n, data.shape[2]))
    y[0], y[first] = b.W @ x[0], b.W @ x[first]
    for k in range(first, steps):
        derived = reduced.A_1 @ data[k + 1] - reduced.A_0 @ data[k] - reduced.c_z[:, None]
        y[k + 1] = reduced.model.Phi @ y[k] + reduced.B_y @ data[k] + reduced.c_y[:, None]
        y[k + 1] += gains[k - first] @ (derived - reduced.model.H @ y[k])
    x[first + 1 :] = b.L @ b.D_p @ data[first + 1 :] + b.M @ y[first + 1 :]
    t = np.arange(steps + 1) * model.dt
    return Estimates(t, x[:, :, 0], y[:, :, 0]) if single else Estimates(t, x, y)


def transient(reduced: ReducedContinuous, t: ArrayLike) -> Array:
    """Covariance of the full state at times t > 0 (at t = 0 just after the measurement has begun), (points, n, n).

    >>> m = ContinuousModel([[0, 0], [0, -2]], [[1, 0], [0, 1]], [[1, 0], [0, 3]], [[1, 1]], P0=[[1, 0], [0, 0.75]])
    >>> transient(continuous(m), [0.0, 1.0])[:, 0, 0].round(6)
    array([0.428571, 0.490025])
    """
    return reduced.basis.M @ bucy.transient(reduced.model, t).P @ reduced.basis.M.T


def steady(reduced: ReducedDiscrete | ReducedContinuous) -> ReducedSteadyState:
    """The limit of the filter, by the reduced one.

    Raises
    ------
    ValueError
        As for :func:`ctlabs.filtering.steady.solve` and :func:`ctlabs.filtering.bucy.steady`: a mode that neither decays nor is measured.

    >>> m = ContinuousModel([[0, 0], [0, -2]], [[1, 0], [0, 1]], [[1, 0], [0, 3]], [[1, 1]], P0=[[1, 0], [0, 0.75]])
    >>> steady(continuous(m)).P.round(6), steady(continuous(m)).poles.round(6)
    (array([[ 0.5, -0.5],
           [-0.5,  0.5]]), array([-1.+0.j]))
    """
    b = reduced.basis
    if isinstance(reduced, ReducedDiscrete):
        limit = steady_state.solve(reduced.model)
        K = b.L @ b.D_p + b.M @ limit.K_pred @ reduced.A_1
        return ReducedSteadyState(symmetric(b.M @ limit.P_minus @ b.M.T), K, limit.poles)
    rest = bucy.steady(reduced.model)
    return ReducedSteadyState(symmetric(b.M @ rest.P @ b.M.T), rest.K, rest.poles)


def realisation(reduced: ReducedContinuous) -> Realisation:
    r"""The steady filter as it would be built: with ξ = ŷ − K_pζ the derivative of ζ disappears.

    .. math:: \dot\xi = (\tilde F - K\tilde H)(\xi + K_p\zeta) + (W - K_pH_p)FL\zeta + K_n(D_n - H_nLD_p)z, \qquad
              \hat x = M\xi + (MK_p + L)\zeta

    >>> m = ContinuousModel([[0, 0], [0, -2]], [[1, 0], [0, 1]], [[1, 0], [0, 3]], [[1, 1]], P0=[[1, 0], [0, 0.75]])
    >>> realisation(continuous(m, keep=[0])).D.round(6)
    array([[0.5],
           [0.5]])
    """
    b, full, K = reduced.basis, reduced.full, bucy.steady(reduced.model).K
    p = len(b.D_p)
    A = reduced.model.F - K @ reduced.model.H
    B = (A @ K[:, :p] + (b.W - K[:, :p] @ b.H_p) @ full.F @ b.L) @ b.D_p + K[:, p:] @ (b.D_n - b.H_n @ b.L @ b.D_p)
    return Realisation(A, B, b.M, (b.M @ K[:, :p] + b.L) @ b.D_p)


def transfer_function(reduced: ReducedDiscrete | ReducedContinuous, state: int = 0, measurement: int = 0) -> tuple[Array, Array]:
    """From a measurement to the estimate of a state (of the full model) in the steady filter, direct term included.

    Returns
    -------
    num, den : both of length n−p+1, den[0] = 1; descending powers of s, or ascending powers of z⁻¹

    >>> m = DiscreteModel([[0.6, 0], [0, 0.4]], [[0.6, 0], [0, 0.2]], [[1, 1]], [[0]], P0=[[1, 0], [0, 0.5]])
    >>> num, den = transfer_function(discrete(m))
    >>> num.round(6), den.round(6)
    (array([ 0.770914, -0.308366]), array([ 1.      , -0.445817]))
    """
    if isinstance(reduced, ReducedContinuous):
        A, B, C, D = realisation(reduced)
        response = [D[state, measurement], *_markov(A, B[:, measurement], C[state])]
    else:
        b, K = reduced.basis, steady_state.solve(reduced.model).K_pred
        A, now = reduced.model.Phi - K @ reduced.model.H, K @ reduced.A_1
        B = A @ now + reduced.B_y - K @ reduced.A_0
        response = [(b.L @ b.D_p + b.M @ now)[state, measurement], *_markov(A, B[:, measurement], b.M[state])]
    den = np.real(np.poly(A))
    return np.convolve(den, response)[: len(den)], den


def _mean_at_t1(model: DiscreteModel) -> Array:
    """The mean at t1."""
    return model.Phi @ model.x0 + (0.0 if model.offset is None else model.offset)


def _basis(name: str, R: Array, H: Array, states: tuple[str, ...], keep: Sequence[str | int] | None) -> Basis:
    """Decorrelated measurements, divided into perfect and noisy ones, and the states that complete the former."""
    lower, d = ldl(R)
    D = scipy.linalg.solve_triangular(lower, np.eye(len(R)), lower=True, unit_diagonal=True)
    perfect = d <= 16 * len(R) * np.finfo(float).eps * np.diag(R)
    H_all, n = D @ H, H.shape[1]
    H_p, p = H_all[perfect], int(perfect.sum())
    if not p or p >= n:
        msg = f"{name}: expected 1 to {n - 1} perfect measurements (without noise) of {n} states, received {p}"
        raise ValueError(msg)
    scale = np.sqrt((H_p**2).sum(axis=1, keepdims=True))
    sigma = np.linalg.svd(H_p / np.where(scale > 0, scale, 1.0), compute_uv=False)
    if not scale.all() or sigma[-1] < DEPENDENT * sigma[0]:
        msg = "H: expected perfect measurements of which none follows from the others, received dependent ones"
        raise ValueError(msg)
    y = _rest(H_p / scale, states, keep)
    W = np.eye(n)[list(y)]
    T = np.vstack([H_p, W])
    inverse = np.linalg.inv(T)
    return Basis(D[perfect], D[~perfect], H_p, H_all[~perfect], d[~perfect], T, inverse[:, :p], inverse[:, p:], W, y)


def _rest(H_p: Array, states: tuple[str, ...], keep: Sequence[str | int] | None) -> tuple[int, ...]:
    """Indices of the states that complete the perfect measurements to a basis."""
    n, size = H_p.shape[1], H_p.shape[1] - len(H_p)
    free = scipy.linalg.null_space(H_p)
    if keep is None:
        order = scipy.linalg.qr(free.T, mode="r", pivoting=True)[1]
        return tuple(sorted(int(i) for i in order[:size]))
    try:
        chosen = tuple(states.index(item) if isinstance(item, str) else range(n)[item] for item in keep)
    except (ValueError, IndexError, TypeError):
        chosen = ()
    if len(set(chosen)) != size or len(chosen) != size:
        msg = f"keep: expected {size} different states of {', '.join(states)}, received {keep!r}"
        raise ValueError(msg)
    if np.linalg.svd(free[list(chosen)], compute_uv=False)[-1] < DEPENDENT:
        msg = f"keep: expected states that the perfect measurements leave open, received {keep!r}"
        raise ValueError(msg)
    return chosen


def _gains(reduced: ReducedDiscrete, steps: int) -> tuple[Array, Array]:
    """Predictor gains (steps, n−p, m) and covariances (steps+1, n−p, n−p) of the reduced model."""
    model = reduced.model
    if not steps:
        return np.zeros((0, model.n, model.m)), model.P0[None]
    plan = full.covariances(model, steps, first=0)
    gains = np.zeros((steps, model.n, model.m))
    for k in range(steps):
        used = plan.used[k]
        Phi, _, known = motion.motion(model, k, used)
        gains[k] = Phi @ plan.K[k]
        if known is not None:
            gains[k][:, used] += known
    return gains, plan.P_minus


def _markov(A: Array, b: Array, c: Array) -> list[float]:
    """c b, c A b, … as many as A has rows."""
    found: list[float] = []
    for _ in range(len(A)):
        found.append(float(c @ b))
        b = A @ b
    return found

