r"""What rounding may have left in an estimate: an ellipsoid W that moves like an error of x̂, and grows at every step.

z, H, Φ … count as known to their last digits, as decimals are. Every step adds a rounding of its own, within ±t,

.. math:: W \leftarrow (1 + \tfrac1p)AWA^T + (1 + p)\,n\,\mathrm{diag}(t^2), \quad A = \Phi \text{ or } I - KH, \quad
          p^2 = \frac{\mathrm{tr}\,AWA^T}{n\,\mathrm{tr}\,\mathrm{diag}(t^2)}

which is an ellipsoid around the sum of the ellipsoid and the box for every p > 0, with this p the smallest in the trace, taken in
units of the terms (Schweppe, IEEE Trans. AC-13, 1968): errors of one sign (of a rounded Φ, say) add up as they may, and what the
filter forgets is forgotten. Nothing depends on units.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ctlabs.filtering.measured import perfect
from ctlabs.filtering.motion import motion
from ctlabs.filtering.results import Filtered, Mask
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel

if TYPE_CHECKING:
    from ctlabs.filtering.engines.common import System
    from ctlabs.filtering.engines.rounding import Rounding, RoundingInputs

EPS = float(np.finfo(float).eps)


class History(NamedTuple):
    """What is needed of a filter's results: of :class:`Filtered`, or of a part of it."""

    x_minus: Array
    x_plus: Array
    P_minus: Array
    P_plus: Array
    K: Array
    used: Mask


def begins(history: Filtered | History) -> int:
    """The instant from which on something is known of every state."""
    unknown = ~np.isfinite(history.P_plus).all(axis=(1, 2))
    return int(np.flatnonzero(unknown).max(initial=-1)) + 1


def innovations(model: DiscreteModel, z: Array, known: Array, history: Filtered | History, asked: Mask) -> tuple[Array, Array]:
    """Innovations of the elements ``asked`` for (rows, m), given those before them, (rows, m, runs), and what rounding explains of them.

    z is what was measured without what was ``known`` (rows, m) of it.

    NaN for all others, and before something is known of every state: what has been gathered until then is rounding of the estimate
    with which the others begin.
    """
    rows, m = asked.shape
    runs = 1 if z.ndim == 2 else z.shape[2]
    e, allowed = np.full((rows, m, runs), np.nan), np.full((rows, m), np.nan)
    begun = begins(history)
    if not asked[begun:].any():
        return e, allowed
    if begun:
        rest = slice(begun, None)
        later = History(*(getattr(history, name)[rest] for name in History._fields))
        e[rest], allowed[rest] = innovations(_later(model, begun, later), z[rest], known[rest], later, asked[rest])
        return e, allowed
    from ctlabs.filtering.engines.rounding import RoundingInputs, bounds  # numba costs 0.3 s to import

    data, x_minus, x_plus = (_own(a.reshape(rows, a.shape[1], -1)) for a in (z, history.x_minus, history.x_plus))
    P_minus, P_plus, used = _own(history.P_minus), _own(history.P_plus), _own(history.used)
    seen = RoundingInputs(data, _own(known), x_minus, x_plus, P_minus, P_plus, used, asked, _own(history.K))
    size = np.sqrt(np.where(np.isfinite(model.P0.diagonal()), model.P0.diagonal(), 0.0))
    bounds(*corrected(model, history.used), given(model.x0), size, 0, seen, e, allowed)
    return e, allowed


def _later(model: DiscreteModel, k: int, history: History) -> DiscreteModel:
    """The model from instant k on, with what was known then before its measurement."""
    varying: dict[str, Any] = {name: M[k:] for name, (M, _extra) in model.varying().items()}
    x0 = history.x_minus[0].reshape(model.n, -1)[:, 0]
    return replace(model, x0=np.where(np.isfinite(x0), x0, 0.0), P0=history.P_plus[0], **varying)


def given(x: Array) -> Rounding:
    """The rounding of numbers that are given, (n,): their last digits."""
    from ctlabs.filtering.engines.rounding import Rounding

    return Rounding(np.sqrt(len(x)) * EPS * np.where(np.isfinite(x), np.abs(x), 0.0), np.eye(len(x)), np.ones(1))


def corrected(model: DiscreteModel, used: Mask) -> tuple[System, Array]:
    """The arrays of a model, with Φ − NR⁺H for Φ where w and v correlate; and NR⁺ (steps, n, m), or nothing."""
    from ctlabs.filtering.engines.common import System

    steps, nothing = len(used) - 1, np.empty((0, model.n))
    c = nothing if model.offset is None else _own(np.atleast_2d(model.offset))
    Phi, Q, H, R = (_own(a if a.ndim == 3 else a[None]) for a in (model.Phi, model.Qd, model.H, model.R))
    system = System(Phi, Q, c, H, R, nothing)
    if model.N is None:
        return system, np.empty((0, model.n, model.m))
    M, Phi = np.zeros((steps, model.n, model.m)), np.empty((steps, model.n, model.n))
    for k in range(steps):
        Phi[k], _Q, told = motion(model, k, used[k])
        if told is not None:
            M[k][:, used[k]] = told
    return system._replace(Phi=Phi), M


def _own(a: NDArray[Any]) -> NDArray[Any]:
    """A contiguous copy: the same array type for numba whatever the origin."""
    return np.array(a, order="C")


class Gathered(NamedTuple):
    """What rounding may have left in an estimate: the ellipsoid, and ``size`` (n,), the roots of the terms of P's diagonal."""

    rounding: Rounding
    size: Array


def begun(x: Array, P: Array) -> Gathered:
    """At t0, where x (n,) and P (n, n) are given."""
    return Gathered(given(x), np.sqrt(np.where(np.isfinite(P.diagonal()), P.diagonal(), 0.0)))


def predicted(before: Gathered, x: Array, P: Array, Phi: Array, c: Array | None, Q: Array, m: int) -> Gathered:
    """One step ahead from x (n, 1) and P, by Φ, c (n, 1) and Q, of a model with m measurements."""
    from ctlabs.filtering.engines.common import System
    from ctlabs.filtering.engines.rounding import RoundingInputs

    n, nobody = len(x), np.zeros((2, m), dtype=bool)
    nothing, H, R = np.empty((0, n)), np.zeros((1, m, n)), np.eye(m)[None]
    offset = nothing if c is None else _own(c.T)
    system = System(_own(Phi[None]), _own(Q[None]), offset, H, R, nothing)
    xs, Ps = np.array([x, x]), np.array([P, P])
    seen = RoundingInputs(np.full((2, m, 1), np.nan), np.zeros((2, m)), xs, xs, Ps, Ps, nobody, nobody, np.empty((0, n, m)))
    return _passed(before, system, 1, seen)[0]


def updated(
    before: Gathered, z: Array, known: Array, H: Array, R: Array, x: Sequence[Array], P: Sequence[Array], used: Mask
) -> tuple[Gathered, Array, Array]:
    """Through one instant's update, with x (n, 1) and P before and after it; and :func:`innovations` of it, (m,) each."""
    from ctlabs.filtering.engines.common import System
    from ctlabs.filtering.engines.rounding import RoundingInputs

    n, nothing = len(x[0]), np.empty((0, len(x[0])))
    system = System(np.zeros((1, n, n)), np.zeros((1, n, n)), nothing, _own(H[None]), _own(R[None]), nothing)
    asked = perfect(R) & ~used & ~np.isnan(z)
    xs, Ps = [_own(each[None]) for each in x], [_own(each[None]) for each in P]
    none = np.empty((0, n, len(z)))
    seen = RoundingInputs(_own(z[None, :, None]), _own(known[None]), xs[0], xs[1], Ps[0], Ps[1], _own(used[None]), asked[None], none)
    after, e, allowed = _passed(before, system, 0, seen)
    return after, e[0, :, 0], allowed[0]


def _passed(before: Gathered, system: System, row: int, seen: RoundingInputs) -> tuple[Gathered, Array, Array]:
    """What :func:`ctlabs.filtering.engines.rounding.bounds` makes of one motion (row 1) or one update (row 0)."""
    from ctlabs.filtering.engines.rounding import Rounding, bounds

    rows, m, n = len(seen.z), seen.z.shape[1], seen.x_plus.shape[1]
    after, size = Rounding(*(_own(a) for a in before.rounding)), _own(before.size)
    e, allowed, no = np.full((rows, m, 1), np.nan), np.full((rows, m), np.nan), np.empty((0, n, m))
    bounds(system, no, after, size, row, seen, e, allowed)
    return Gathered(after, size), e, allowed


