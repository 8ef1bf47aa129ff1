"""What a filter is asked: one discrete model, and data by instants, whatever kind of model and of call they came from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.filtering import measured
from ctlabs.filtering.results import Mask
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.linalg.exponential import intervals
from ctlabs.models.linear import ContinuousModel, DiscreteModel, at
from ctlabs.text import moment


@runtime_checkable
class Model(Protocol):
    """What every engine needs of a linear system in discrete time; a :class:`ctlabs.DiscreteModel` is one.

    ``n``, ``m`` : number of states, of measurements · ``x0`` (n,), ``P0`` (n, n) · ``dt``, s · ``first`` ·
    ``states``, ``measurements`` : names
    """

    n: int
    m: int
    x0: Array
    P0: Array
    dt: float
    first: int
    states: tuple[str, ...]
    measurements: tuple[str, ...]

    def motion(self, k: int) -> tuple[Array, Array, Array]:
        """Φ (n, n), c (n,) and Qd (n, n) from k to k+1."""

    def measurement(self, k: int) -> tuple[Array, Array, Array | None]:
        """H (m, n), R (m, m) and N (n, m), or ``None``, at k."""


@dataclass(frozen=True, slots=False, eq=False)
class FilterProblem:
    """A model and data by instants k = 0 … steps.

    ``model``, with what is known of its inputs in ``offset`` · ``z`` (steps+1, m, runs), NaN where nothing is measured and before
    ``first``, without what known inputs bring into it · ``t`` (steps+1,), s · ``first``, the index of the first row of data ·
    ``single``, whether the data had no axis for runs · ``known`` (steps+1, m), what known inputs bring into the data, None where nothing
    """

    model: DiscreteModel
    z: Array
    t: Array
    first: int
    single: bool
    known: Array | None = None

    @cached_property
    def absent(self) -> Mask:
        """The elements that are not measured, (steps+1, m)."""
        return measured.gaps(self.z, self.first)


def pose(
    model: Any,
    z: ArrayLike,
    *,
    first: int | None = None,
    t: ArrayLike | None = None,
    H: ArrayLike | None = None,
    R: ArrayLike | None = None,
    u: ArrayLike | None = None,
    u0: ArrayLike | None = None,
    P0: ArrayLike | None = None,
) -> FilterProblem:
    """The problem of :func:`ctlabs.kalman_filter`, whose arguments these are."""
    m = _known(model)
    rows, single = rows_of(z, m)
    if isinstance(model, ContinuousModel):
        return _sampled(model, rows, single, first, t, H, R, u, u0, P0)
    if t is not None:
        msg = f"t: expected none with a model that has a period (dt = {model.dt:g} s), received one"
        raise ValueError(msg)
    begin = measured.begins(model, first)
    steps = len(rows) - 1 + begin
    discrete = _stacked(model, steps)
    measured.horizon(discrete, steps, least=0)
    discrete = discrete.cut(steps)
    changes: dict[str, Any] = {} if begin == discrete.first else {"first": begin}
    for name, given in (("H", H), ("R", R)):
        if given is not None:
            changes[name] = _by_instants(name, given, len(rows), begin, getattr(discrete, name).shape[-2:])
    if P0 is not None:
        changes["P0"] = P0
    if changes:
        discrete = replace(discrete, **changes)
    discrete, seen = driven(discrete, len(rows), begin, u, u0)
    data, known = _less(rows, seen, begin)
    return FilterProblem(discrete, data, np.arange(steps + 1) * discrete.dt, begin, single, known)


def _less(rows: Array, seen: Array | None, first: int) -> tuple[Array, Array | None]:
    """Data without what is known of them, ``seen`` (rows, m), and that; both by instants."""
    if seen is None or not seen.any():
        return by_instant(rows, first), None
    return by_instant(rows - seen[:, :, None], first), np.concatenate([np.zeros((first, seen.shape[1])), seen])


def _known(model: Any) -> int:
    """The number of measurements of a model that can be filtered."""
    if isinstance(model, DiscreteModel | ContinuousModel | Model):  # the last is asked for its attributes one by one
        return int(model.m)
    msg = f"model: expected a DiscreteModel, a ContinuousModel or a NonlinearModel, received a {type(model).__name__}"
    raise TypeError(msg)


def rows_of(z: ArrayLike, m: int) -> tuple[Array, bool]:
    """The data as (rows, m, runs), which may be those of the caller (:func:`by_instant` copies them), and whether without runs."""
    data: Array = np.asarray(z, dtype=np.float64)
    if data.ndim == 1 and m == 1:
        data = data[:, None]
    single = data.ndim == 2
    data = data[:, :, None] if single else data
    if data.ndim != 3 or data.shape[1] != m or not data.shape[0] or not data.shape[2]:
        msg = f"z: expected shape (rows, {m}) or (rows, {m}, runs), received {np.shape(z)}"
        raise ValueError(msg)
    return data, single


def by_instant(rows: Array, first: int) -> Array:
    """Data by instants, a copy unless nobody can change them: before the first measurement there is an instant without one."""
    if first:
        return np.concatenate([np.full((first, *rows.shape[1:]), np.nan), rows])
    return rows if _frozen(rows) else rows.copy()


def _frozen(data: Array) -> bool:
    """Whether nobody can change an array, nor what it is a view of."""
    while not data.flags.writeable and isinstance(data.base, np.ndarray):
        data = data.base
    return not data.flags.writeable and data.flags.owndata


def _by_instants(name: str, given: ArrayLike, rows: int, first: int, shape: tuple[int, ...]) -> Array:
    """A matrix that is given once, or for each row of data, by instants."""
    check = checks.measurement_covariance if name == "R" else checks.shaped
    matrix = check(name, given, shape, ("rows", *shape))
    if matrix.ndim == 2:
        return matrix
    if len(matrix) != rows:
        msg = f"{name}: expected one matrix, or {rows} as z has rows, received {len(matrix)}"
        raise ValueError(msg)
    return np.concatenate([matrix[:first], matrix])


def _stacked(model: Model, steps: int) -> DiscreteModel:
    """A model of any kind as a DiscreteModel for so many steps."""
    if isinstance(model, DiscreteModel):
        return model
    motions = [model.motion(k) for k in range(steps)]
    seen = [model.measurement(k) for k in range(steps + 1)]
    still = (np.eye(model.n), np.zeros(model.n), np.zeros((model.n, model.n)))
    Phi, c, Qd = (np.array(part) for part in zip(*(motions or [still]), strict=True))
    N = seen[0][2]
    if any(not (each[2] is N or (N is not None and each[2] is not None and np.array_equal(each[2], N))) for each in seen):
        msg = "measurement(k): expected one N for all instants, received some that differ"
        raise ValueError(msg)
    H, R = np.array([each[0] for each in seen]), np.array([each[1] for each in seen])
    if not steps:
        Phi, c, Qd, H, R = Phi[0], c[0], Qd[0], H[0], R[0]
    names = {name: getattr(model, name) for name in ("states", "measurements")}
    return DiscreteModel(Phi, Qd, H, R, x0=model.x0, P0=model.P0, dt=model.dt, N=N, offset=c, first=model.first, **names)


def driven(
    model: DiscreteModel, rows: int, first: int, u: ArrayLike | None, u0: ArrayLike | None
) -> tuple[DiscreteModel, Array | None]:
    """The model with its known inputs in ``offset``, and what they bring into the measurements, (rows, m)."""
    inputs, start = inputs_of(model, rows, first, u, u0)
    seen, c = np.zeros((rows, model.m)), model.offset
    if model.B is not None:
        before = inputs[:-1] if first == 0 else np.concatenate([start[None], inputs[:-1]])
        moved = np.array([at(model.B, k, 2) @ before[k] for k in range(len(before))]).reshape(-1, model.n)
        c = moved if c is None else c + moved
        c = np.zeros(model.n) if not len(moved) else c
    if model.D is not None:
        seen += np.array([at(model.D, k + first, 2) @ inputs[k] for k in range(rows)])
    if model.measurement_offset is not None:
        seen += model.measurement_offset if model.measurement_offset.ndim == 1 else model.measurement_offset[first : first + rows]
    if model.B is None and model.D is None and model.measurement_offset is None:
        return model, None
    return replace(model, B=None, D=None, measurement_offset=None, offset=c), seen


def inputs_of(model: Any, rows: int, first: int, u: ArrayLike | None, u0: ArrayLike | None) -> tuple[Array, Array]:
    """u by rows, (rows, r), and u0 (r,)."""
    r = model.r
    if not r:
        for name, given in (("u", u), ("u0", u0)):
            if given is not None:
                msg = f"{name}: expected a model with B or D, received one without"
                raise ValueError(msg)
        return np.zeros((rows, 0)), np.zeros(0)
    if u is None:
        msg = f"u: expected the known input, ({rows}, {r}) or ({r},), as the model has {'B' if model.B is not None else 'D'}; received None"
        raise ValueError(msg)
    given = checks.array("u", u)
    given = given[:, None] if r == 1 and given.shape == (rows,) and rows > 1 else given
    given = checks.shaped("u", given, (rows, r), (r,))
    constant = given.ndim == 1
    if model.B is None or not first:
        if u0 is not None:
            msg = "u0: expected none (nothing moves between t0 and the first measurement), received one"
            raise ValueError(msg)
        return np.broadcast_to(given, (rows, r)), np.zeros(r)
    if u0 is None and not constant:
        msg = "u0: expected the input from t0 to the first measurement (first=1; u[0] acts from there on), received None"
        raise ValueError(msg)
    start = given if u0 is None else checks.shaped("u0", np.atleast_1d(np.asarray(u0, dtype=np.float64)), (r,))
    return np.broadcast_to(given, (rows, r)), start


# A continuous model, measured at any times ---------------------------------------------------------------------------


def _sampled(
    model: ContinuousModel,
    rows: Array,
    single: bool,
    first: int | None,
    t: ArrayLike | None,
    H: ArrayLike | None,
    R: ArrayLike | None,
    u: ArrayLike | None,
    u0: ArrayLike | None,
    P0: ArrayLike | None,
) -> FilterProblem:
    """The discrete model of the instants at which a continuous one is measured."""
    times = _times(t, len(rows))
    begin = _first(times, first)
    instants = times if not begin else np.concatenate([[0.0], times])
    if R is None:
        msg = "R: expected the covariance of a sampled measurement, in unit² (Rc is a strength): pass R; received None"
        raise ValueError(msg)
    if model.N is not None:
        msg = "model: expected no N (it correlates w with a continuous measurement's noise), received one"
        raise ValueError(msg)
    noise = _by_instants("R", R, len(rows), begin, (model.m, model.m))
    H = model.H if H is None else _by_instants("H", H, len(rows), begin, model.H.shape)
    inputs, start = inputs_of(model, len(rows), begin, u, u0)
    Phi, Qd, offset = _intervals(model, np.diff(instants), np.concatenate([start[None]] * begin + [inputs]))
    seen = np.zeros((len(rows), model.m)) if model.D is None else inputs @ model.D.T
    if model.measurement_offset is not None:
        seen = seen + model.measurement_offset
    discrete = DiscreteModel(
        Phi, Qd, H, noise, x0=model.x0, P0=model.P0 if P0 is None else P0, offset=offset, first=begin,
        states=model.states, measurements=model.measurements, units=model.units, measurement_units=model.measurement_units,
    )  # fmt: skip
    data, known = _less(rows, seen, begin)
    return FilterProblem(discrete, data, instants, begin, single, known)


def _times(t: ArrayLike | None, rows: int) -> Array:
    if t is None:
        msg = "t: expected the times of the rows of z, in s (a ContinuousModel has no period), received None"
        raise ValueError(msg)
    times = checks.shaped("t", t, (rows,))
    back = np.flatnonzero(np.diff(times) <= 0)
    if times[0] < 0 or back.size:
        i = 0 if times[0] < 0 else int(back[0]) + 1
        msg = f"t[{i}]: expected increasing times from t0 = 0 s on, received {moment(times[i])}"
        raise ValueError(msg)
    return times


def _first(times: Array, first: int | None) -> int:
    """Whether an interval without a measurement precedes the first row."""
    own = int(times[0] > 0)
    if first is not None and first != own:
        msg = f"first: expected {own}, as t[0] = {moment(times[0])} s tells, received {first!r}"
        raise ValueError(msg)
    return own


def _intervals(model: ContinuousModel, h: Array, inputs: Array) -> tuple[Array, Array, Array | None]:
    """Φ, Qd and c of each interval; equal ones are discretised once. Without an interval: of no time."""
    W = model.G @ model.Q @ model.G.T
    lengths, which = _alike(h)
    if not len(lengths):
        return np.eye(model.n), np.zeros((model.n, model.n)), None
    Phi, Qd, Gamma = intervals(model.F, W, lengths)
    offset = None
    if model.B is not None:
        offset = np.einsum("kij,kj->ki", (Gamma @ model.B)[which], inputs[: len(h)])
    return (Phi[0], Qd[0], offset) if len(lengths) == 1 else (Phi[which], Qd[which], offset)


def _alike(h: Array) -> tuple[Array, Array]:
    """The different intervals, and which of them each is: those that differ by the rounding of the times are one."""
    if not len(h):
        return h, np.zeros(0, dtype=np.int64)
    order = np.argsort(h, kind="stable")
    group = np.concatenate([[0], np.cumsum(np.diff(h[order]) > 4 * np.spacing(h.sum()))])
    which = np.empty(len(h), dtype=np.int64)
    which[order] = group
    return np.bincount(which, h) / np.bincount(which), which
