r"""A plant and its controller as one model: (x, ξ, z), with the measurement a state.

.. math:: u = C\xi + Dz + f, \quad x' = \Phi x + Bu + c + w, \quad \xi' = A\xi + B_cz + g, \quad z' = Hx' + D_tu' + d + v'

What v tells of w at the same instant (N ≠ 0) is passed on by the state z: :math:`w = NR^+(z - Hx - D_tu - d) + \tilde w`. So the noise of
the whole is white, and the covariances of x, u and z over time and in the limit are a linear recursion: no random numbers. The truth
may be any model of the same measurements and inputs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ctlabs.linalg import checks, riccati
from ctlabs.linalg.checks import Array
from ctlabs.linalg.correlated import regression
from ctlabs.linalg.covariance import deviations, symmetric
from ctlabs.linalg.units import balanced
from ctlabs.models import at, observability
from ctlabs.models.linear import DiscreteModel, input_names
from ctlabs.regulation.controller import Machine


class Signals(NamedTuple):
    """Mean and covariance of some signals of a loop: ``mean`` (…, d), ``P`` (…, d, d)."""

    mean: Array
    P: Array

    @property
    def sd(self) -> Array:
        """Standard deviations, (…, d)."""
        return deviations(self.P)

    @property
    def rms(self) -> Array:
        """Roots of the mean squares, (…, d)."""
        return np.sqrt(self.sd**2 + self.mean**2)

    def part(self, begin: int, end: int | None) -> Signals:
        """Some of the signals."""
        return Signals(self.mean[..., begin:end], self.P[..., begin:end, begin:end])


@dataclass(frozen=True, slots=True, eq=False)
class LoopCovariances:
    """A loop over time (one row per instant 0 … steps) or in the limit (no such axis).

    ``x``, the true state · ``estimate``, ξ: the estimate before the measurement, and what the controller carries beside it · ``z``, the
    measurement · ``u``, the input · ``joint``, of (x, ξ, u), the order in which the cost weighs them · ``t`` s
    """

    t: Array
    x: Signals
    estimate: Signals
    z: Signals
    u: Signals
    joint: Signals


@dataclass(frozen=True, slots=True, eq=False)
class ClosedLoop:
    """A truth and a controller as one :class:`~ctlabs.models.linear.DiscreteModel`.

    ``model``, with the states (x, ξ, z) and the measurements (z, u), without noise · ``truth`` · ``machine`` · ``poles`` (n+q,)
    """

    model: DiscreteModel
    truth: DiscreteModel
    machine: Machine
    poles: Array

    @property
    def sizes(self) -> tuple[int, int, int, int]:
        """Of x, ξ, z and u."""
        return self.truth.n, len(self.machine.xi0), self.truth.m, self.truth.r

    def covariances(self, steps: int) -> LoopCovariances:
        """Means and covariances over time, from the truth's x0 and P0.

        Raises
        ------
        ValueError
            Steps beyond those for which the truth or the gains are given; an infinite P0.
        FloatingPointError
            The covariance overflows: the loop is unstable; the time is in the message.
        """
        steps = checks.count("steps", steps)
        if self.model.horizon is not None and steps > self.model.horizon:
            msg = f"steps: expected at most {self.model.horizon}, for which the loop is given, received {steps}"
            raise ValueError(msg)
        checks.finite_start("a closed loop", self.model.P0)
        mean, P = followed(self.model, steps)
        if not np.isfinite(P).all():
            k = int(np.argmin(np.isfinite(P).all(axis=(1, 2))))
            msg = f"closed loop: expected finite covariances, received an overflow at step {k} ({self._unstable() or 'it is unstable'})"
            raise FloatingPointError(msg)
        return self._signals(np.arange(steps + 1) * self.model.dt, mean, P)

    def steady(self) -> LoopCovariances:
        """The limits.

        Raises
        ------
        ValueError
            Gains or a truth that vary; a loop that is not stable: the mode is named.
        """
        if self.model.horizon is not None:
            msg = f"closed loop: expected constant gains and a constant truth, received some for {self.model.horizon} steps"
            raise ValueError(msg)
        n, q, _, _ = self.sizes
        decaying(inner_loop(self.truth, self.machine), self.model.states[: n + q], continuous=False)
        X, c, W = self.model.motion(0)
        P = riccati.stationary(X, W, continuous=False).P.high
        mean = np.linalg.solve(np.eye(len(X)) - X, c)
        return self._signals(np.array(np.inf), mean, np.array(P))

    def _unstable(self) -> str:
        """The mode that does not decay, by name; empty where all do."""
        if self.model.horizon is not None:
            return ""
        n, q, _, _ = self.sizes
        A = inner_loop(self.truth, self.machine)
        return unstable(A, self.model.states[: n + q], continuous=False)

    def _signals(self, t: Array, mean: Array, P: Array) -> LoopCovariances:
        """Everything of interest from (x, ξ, z)."""
        n, q, m, _ = self.sizes
        rows, rest = self.model.H[..., m:, :], self.model.measurement_offset
        assert rest is not None
        f = rest[..., m:]
        if rows.ndim == 3:
            rows, f = rows[: len(mean)], f[: len(mean)]
        first = np.eye(n + q, n + q + m)
        C = np.concatenate([np.broadcast_to(first, (*rows.shape[:-2], *first.shape)), rows], axis=-2)
        f = np.concatenate([np.zeros((*f.shape[:-1], n + q)), f], axis=-1)
        both = Signals(np.einsum("...ij,...j->...i", C, mean) + f, symmetric(C @ P @ np.swapaxes(C, -1, -2)))
        whole = Signals(mean, P)
        return LoopCovariances(t, whole.part(0, n), whole.part(n, n + q), whole.part(n + q, None), both.part(n + q, None), both)


def followed(model: DiscreteModel, steps: int) -> Signals:
    """Mean and covariance of a model's state over time, without measurements; what overflows is not finite.

    >>> walk = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[3], P0=[[2]])
    >>> followed(walk, 2).P.ravel(), followed(walk, 2).mean.ravel()
    (array([2., 3., 4.]), array([3., 3., 3.]))
    """
    mean, P = np.empty((steps + 1, model.n)), np.empty((steps + 1, model.n, model.n))
    mean[0], P[0] = model.x0, model.P0
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(steps):
            X, c, W = model.motion(k)
            mean[k + 1], P[k + 1] = X @ mean[k] + c, symmetric(X @ P[k] @ X.T + W)
    return Signals(mean, P)


def unstable(A: Array, states: tuple[str, ...], *, continuous: bool) -> str:
    """The mode of A that grows most, or does not decay, by name; empty where all decay.

    >>> unstable(np.array([[1.5, 0.0], [0.0, 0.5]]), ("a", "b"), continuous=False)
    'the mode eigenvalue 1.5 of the states a'
    """
    units = balanced(A, np.eye(len(A)), continuous=continuous).states
    values, vectors = np.linalg.eig(A * units / units[:, None])
    size = values.real if continuous else np.abs(values)
    i = int(size.argmax())
    limit = 0.0 if continuous else 1.0
    if size[i] < limit:
        return ""
    value = complex(values[i])
    return f"the mode {observability.Mode(value, np.abs(vectors[:, i])).name(states)}"


def decaying(A: Array, states: tuple[str, ...], *, continuous: bool) -> None:
    """Refuse a loop with a mode that does not decay: it is named."""
    if reason := unstable(A, states, continuous=continuous):
        msg = f"closed loop: expected every mode to decay, received {reason}"
        raise ValueError(msg)


def inner_loop(truth: DiscreteModel, M: Machine) -> Array:
    """What moves (x, ξ), with z in its place, where nothing varies."""
    assert truth.B is not None
    D = _through(truth)
    Hx, Hxi = truth.H, D @ M.C
    return np.block([[truth.Phi + truth.B @ M.D @ Hx, truth.B @ (M.C + M.D @ Hxi)], [M.B @ Hx, M.A + M.B @ Hxi]])


def weighed_rows(truth: DiscreteModel, M: Machine, q: int) -> Array:
    """What of (x, ξ) is weighed, without the noise of z: x, the last q elements of ξ, u; (n+q+r, n+size)."""
    n, size = truth.n, len(M.xi0)
    u = np.hstack([M.D @ truth.H, M.C + M.D @ _through(truth) @ M.C])
    return np.vstack([np.eye(n, n + size), np.eye(q, n + size, n + size - q), u])


def _through(truth: DiscreteModel) -> Array:
    """The truth's D."""
    return np.zeros((truth.m, truth.r)) if truth.D is None else truth.D


def closed(truth: DiscreteModel, machine: Machine, set_point: Array | None = None) -> ClosedLoop:
    """The loop of a truth and a controller, measured from t0 on; ``set_point`` (p,), constant.

    Raises
    ------
    ValueError
        Numbers of measurements or inputs that differ; a truth whose input enters the measurement that it answers.
    """
    checks.instance("truth", truth, DiscreteModel)
    r, m = machine.C.shape[-2], len(machine.measurements)
    if truth.B is None or truth.r != r or truth.m != m:
        msg = f"truth: expected {m} measurements and {r} inputs as the design has, received {truth.m} and {truth.r}"
        raise ValueError(msg)
    if not np.isclose(truth.dt, machine.dt, rtol=1e-12, atol=0):
        msg = f"truth: expected the design's period, {machine.dt:g} s, received {truth.dt:g} s"
        raise ValueError(msg)
    if truth.D is not None and truth.D.any() and machine.D.any():
        msg = 'truth: expected no D beside a regulator of kind "current" (a measurement that contains its answer), received one'
        raise ValueError(msg)
    steps = _steps(truth, machine)
    start = np.zeros(len(machine.set_points)) if set_point is None else checks.shaped("set_point", set_point, (len(machine.set_points),))
    count = 1 if steps is None else steps
    last = None if steps is None else (steps if machine.steps is None else machine.steps) - 1
    maps = [_map(truth, machine, k, k + 1 if last is None else min(k + 1, last), start) for k in range(count)]
    X, c, W = (np.array([each[i] for each in maps]) if steps is not None else maps[0][i] for i in range(3))
    x0, P0 = _start(truth, machine, start)
    outputs, rest = _outputs(truth, machine, steps, start)
    states = (*truth.states, *(f"{name} (controller)" for name in machine.states), *truth.measurements)
    model = DiscreteModel(
        X, W, outputs, np.zeros((m + r, m + r)), P0=P0, x0=x0, dt=truth.dt, offset=c, measurement_offset=rest, first=0, states=states,
        measurements=(*truth.measurements, *input_names(r)),
    )  # fmt: skip
    poles = np.sort_complex(np.linalg.eigvals(inner_loop(truth, machine))) if steps is None else np.zeros(0, dtype=complex)
    return ClosedLoop(model, truth, machine, poles)


def _steps(truth: DiscreteModel, machine: Machine) -> int | None:
    """How many steps the loop is given for."""
    return min((n for n in (truth.horizon, machine.steps) if n is not None), default=None)


def _map(truth: DiscreteModel, machine: Machine, k: int, after: int, r: Array) -> tuple[Array, Array, Array]:
    """X, c, W from k to k+1, for (x, ξ, z); ``after``, the instant whose C and f are taken for k+1."""
    assert truth.B is not None
    Phi, c, Qd = truth.motion(k)
    B, (H, R, N), M = at(truth.B, k, 2), truth.measurement(k), machine.at(k)
    D_t = np.zeros((truth.m, truth.r)) if truth.D is None else at(truth.D, k, 2)
    d = np.zeros(truth.m) if truth.measurement_offset is None else at(truth.measurement_offset, k, 1)
    told = np.zeros((truth.n, truth.m)) if N is None else regression(N, np.where(np.isfinite(R), R, 0.0))
    Q = Qd if N is None else symmetric(Qd - told @ N.T)
    f = M["F"] @ r + M["f"]
    moves = B - told @ D_t
    rows_x = np.hstack([Phi - told @ H, moves @ M["C"], told + moves @ M["D"]])
    rows_xi = np.hstack([np.zeros((len(M["A"]), truth.n)), M["A"], M["B"]])
    cx, cxi = moves @ f + c - told @ d, M["G"] @ r + M["g"]
    H_, R_, _ = truth.measurement(k + 1)
    later, D_ = machine.at(after), D_t if truth.D is None else at(truth.D, k + 1, 2)
    d_ = d if truth.measurement_offset is None else at(truth.measurement_offset, k + 1, 1)
    through = D_ @ later["C"]
    rows_z = H_ @ rows_x + through @ rows_xi
    cz = H_ @ cx + through @ cxi + D_ @ (later["F"] @ r + later["f"]) + d_
    V = np.where(np.isfinite(R_), R_, 0.0)
    HQ, q = H_ @ Q, len(M["A"])
    zero = np.zeros((q, truth.n + q + truth.m))
    W = np.vstack([np.hstack([Q, np.zeros((truth.n, q)), HQ.T]), zero, np.hstack([HQ, np.zeros((truth.m, q)), HQ @ H_.T + V])])
    return np.vstack([rows_x, rows_xi, rows_z]), np.concatenate([cx, cxi, cz]), symmetric(W)


def _start(truth: DiscreteModel, machine: Machine, r: Array) -> tuple[Array, Array]:
    """Mean and covariance of (x, ξ, z) at t0; where the gains are scheduled from t1 on, nothing makes use of this z."""
    q, m = len(machine.xi0), truth.m
    M = machine.at(0)
    H, R, _ = truth.measurement(0)
    D_t = np.zeros((m, truth.r)) if truth.D is None else at(truth.D, 0, 2)
    d = np.zeros(m) if truth.measurement_offset is None else at(truth.measurement_offset, 0, 1)
    z = H @ truth.x0 + D_t @ (M["C"] @ machine.xi0 + M["F"] @ r + M["f"]) + d
    cross = H @ np.where(np.isfinite(truth.P0), truth.P0, 0.0)
    P = np.zeros((truth.n + q + m,) * 2)
    P[: truth.n, : truth.n] = truth.P0
    P[truth.n + q :, : truth.n], P[: truth.n, truth.n + q :] = cross, cross.T
    P[truth.n + q :, truth.n + q :] = symmetric(cross @ H.T) + np.where(np.isfinite(R), R, 0.0)
    return np.concatenate([truth.x0, machine.xi0, z]), P


def _outputs(truth: DiscreteModel, machine: Machine, steps: int | None, r: Array) -> tuple[Array, Array]:
    """Rows and constants that give (z, u)."""
    n, q, m = truth.n, len(machine.xi0), truth.m
    rows, rest = [], []
    for k in range(1 if steps is None else steps + 1):
        M = machine.at(k if machine.steps is None else min(k, machine.steps - 1))
        z = np.hstack([np.zeros((m, n + q)), np.eye(m)])
        u = np.hstack([np.zeros((len(M["C"]), n)), M["C"], M["D"]])
        rows.append(np.vstack([z, u]))
        rest.append(np.concatenate([np.zeros(m), M["F"] @ r + M["f"]]))
    return (rows[0], rest[0]) if steps is None else (np.array(rows), np.array(rest))
