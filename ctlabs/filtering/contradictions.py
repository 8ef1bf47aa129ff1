r"""Contradictions: an exact measurement that disagrees with what is known exactly.

A perfect element, or one whose noise is combined of those before it, may have an innovation of no variance given those of
the elements b that enter the update before it. It is known already and tells nothing; but

.. math:: e_i = \nu_i - w^T\nu_b, \quad w = S_{bb}^{-1}S_{bi}, \quad \nu = z - H\hat x^-

must be zero. Where it is not, the record is an event of probability zero, and the likelihood −∞. What rounding may leave of
e_i is bounded by

.. math:: \gamma\left(|z_i| + |h_i||\hat x| + |w|^T(|z_b| + |H_b||\hat x|) + \text{that of }w\right) + \sqrt{gWg^T}, \quad
          g = h_i - w^TH_b, \quad \gamma = (n + m + 2)\varepsilon

in which z, H, Φ … count as known to their last digits, as decimals are, and W bounds what x̂ has gathered since t0: every
step moves it like an error of x̂ and adds a rounding of its own, within ±t,

.. math:: W \leftarrow (1 + \tfrac1j)AWA^T + (1 + j)\,n\,\mathrm{diag}(t^2), \quad A = \Phi \text{ or } I - KH,

which is an ellipsoid around the sum of the ellipsoid and the box for every j > 0 (Schweppe, IEEE Trans. AC-13, 1968). With j
the number of errors so far, those of one sign (of a rounded Φ, say) add up as they may. Nothing depends on units.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ctlabs.filtering.measured import perfect
from ctlabs.filtering.motion import motion
from ctlabs.filtering.results import Contradiction, Filtered, Mask
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel
from ctlabs.text import _, fill, number

if TYPE_CHECKING:
    from ctlabs.filtering.engines.common import System
    from ctlabs.filtering.engines.rounding import Passed, Rounding

EPS = float(np.finfo(float).eps)


def known(model: DiscreteModel, z: Array, used: Mask, first: int) -> Mask:
    """The elements of z (steps+1, m[, runs]) that are measured but known already, and did not enter the update, (steps+1, m).

    >>> m = DiscreteModel([[1]], [[1]], [[1], [1]], np.zeros((2, 2)), x0=[0], P0=[[4]])
    >>> known(m, np.array([[np.nan, np.nan], [1.0, 1.0]]), np.array([[False, False], [True, False]]), 1)
    array([[False, False],
           [False,  True]])
    """
    found = ~used & ~(np.isnan(z) if z.ndim == 2 else np.isnan(z).all(axis=2))
    found[:first] = False
    if model.R.ndim == 2:
        return np.asarray(found & perfect(model.R))
    for k in np.flatnonzero(found.any(axis=1)):
        found[k] &= perfect(model.R[k])
    return found


def find(model: DiscreteModel, z: Array, history: Filtered, first: int) -> tuple[Contradiction, ...]:
    """The contradictions of a record, or of an ensemble of records, row by row.

    Parameters
    ----------
    model : the filter's model
    z : (steps+1, m) or (steps+1, m, runs), by instants, NaN = not measured
    history : of any form of the filter
    first : 1 (first measurement at t1) or 0 (at t0)

    >>> from ctlabs import kalman_filter
    >>> m = DiscreteModel([[0.5]], [[0]], [[1]], [[0]], x0=[1], P0=[[0]])
    >>> kalman_filter(m, [0.5, 0.5]).contradictions[0]._replace(allowed=0)
    Contradiction(row=1, element=0, innovation=0.25, allowed=0, run=0)
    """
    e, allowed = innovations(model, z, history, first)
    with np.errstate(invalid="ignore"):
        wrong = np.argwhere(np.abs(e) > allowed[:, :, None])
    return tuple(
        Contradiction(k - first, i, float(e[k, i, run]), float(allowed[k, i]), run) for k, i, run in wrong.tolist()
    )


def innovations(model: DiscreteModel, z: Array, history: Filtered | _From, first: int) -> tuple[Array, Array]:
    """Of what is known already: innovations given the elements before (steps+1, m, runs), and what rounding explains (steps+1, m).

    NaN for elements that enter the update or are not measured.
    """
    asked = known(model, z, history.used, first)
    runs = (z[..., None] if z.ndim == 2 else z).shape[2]
    e, allowed = np.full((*asked.shape, runs), np.nan), np.full(asked.shape, np.nan)
    unknown = ~np.isfinite(history.P_plus).all(axis=(1, 2))
    begun = int(np.flatnonzero(unknown).max(initial=-1)) + 1  # from here on something is known of every state
    if asked[:begun].any():
        _vaguely(getattr(history, "start", None), e, allowed)
    if begun:  # what has been gathered until then is rounding of the estimate with which the others begin
        rest = slice(begun, None)
        if begun < len(z) and asked[rest].any():
            later = _From(*(getattr(history, name)[rest] for name in _From._fields))
            e[rest], allowed[rest] = innovations(_later(model, begun, later), z[rest], later, 0)
        return e, allowed
    if asked.any():
        from ctlabs.filtering.engines.rounding import Passed, bounds  # numba costs 0.3 s to import

        data, x_minus, x_plus = (_own(a.reshape(len(z), a.shape[1], -1)) for a in (z, history.x_minus, history.x_plus))
        P_minus, P_plus, used = _own(history.P_minus), _own(history.P_plus), _own(history.used)
        rows = Passed(data, x_minus, x_plus, P_minus, P_plus, used, asked, _own(history.K))
        size = np.sqrt(np.where(np.isfinite(model.P0.diagonal()), model.P0.diagonal(), 0.0))
        bounds(*corrected(model, history.used), given(model.x0), size, 0, rows, e, allowed)
    return e, allowed


class _From(NamedTuple):
    """A history from an instant on."""

    x_minus: Array
    x_plus: Array
    P_minus: Array
    P_plus: Array
    K: Array
    used: Mask


def _vaguely(start: Any, e: Array, allowed: Array) -> None:
    """What the first instants after a vague start say of what was known already, into ``e`` and ``allowed``."""
    if start is None:
        return
    rows = len(start.terms)
    e[:rows] = start.excess
    for k in range(rows):
        allowed[k] = vaguely(start.terms[k], start.P.shape[1], k)


def vaguely(terms: Array, n: int, k: int) -> Array:
    """What rounding explains of innovations that are sums of ``terms`` (m,), at instant k since a vague start of n states."""
    return np.asarray(8 * (n + len(terms) + 2) * EPS * (k + 1) * terms)


def _later(model: DiscreteModel, k: int, history: _From) -> DiscreteModel:
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


# Step by step ---------------------------------------------------------------------------------------------------------


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
    from ctlabs.filtering.engines.rounding import Passed

    n, nobody = len(x), np.zeros((2, m), dtype=bool)
    nothing, H, R = np.empty((0, n)), np.zeros((1, m, n)), np.eye(m)[None]
    offset = nothing if c is None else _own(c.T)
    system = System(_own(Phi[None]), _own(Q[None]), offset, H, R, nothing)
    xs, Ps = np.array([x, x]), np.array([P, P])
    seen = Passed(np.full((2, m, 1), np.nan), xs, xs, Ps, Ps, nobody, nobody, np.empty((0, n, m)))
    return _passed(before, system, 1, seen)[0]


def updated(
    before: Gathered, z: Array, H: Array, R: Array, x: Sequence[Array], P: Sequence[Array], used: Mask
) -> tuple[Gathered, Array, Array]:
    """Through one instant's update, with x (n, 1) and P before and after it; and :func:`innovations` of it, (m,) each."""
    from ctlabs.filtering.engines.common import System
    from ctlabs.filtering.engines.rounding import Passed

    n, nothing = len(x[0]), np.empty((0, len(x[0])))
    system = System(np.zeros((1, n, n)), np.zeros((1, n, n)), nothing, _own(H[None]), _own(R[None]), nothing)
    asked = perfect(R) & ~used & ~np.isnan(z)
    xs, Ps = [_own(each[None]) for each in x], [_own(each[None]) for each in P]
    none = np.empty((0, n, len(z)))
    seen = Passed(_own(z[None, :, None]), xs[0], xs[1], Ps[0], Ps[1], _own(used[None]), asked[None], none)
    after, e, allowed = _passed(before, system, 0, seen)
    return after, e[0, :, 0], allowed[0]


def _passed(before: Gathered, system: System, row: int, seen: Passed) -> tuple[Gathered, Array, Array]:
    """What :func:`ctlabs.filtering.engines.rounding.bounds` makes of one motion (row 1) or one update (row 0)."""
    from ctlabs.filtering.engines.rounding import Rounding, bounds

    rows, m, n = len(seen.z), seen.z.shape[1], seen.x_plus.shape[1]
    after, size = Rounding(*(_own(a) for a in before.rounding)), _own(before.size)
    e, allowed, no = np.full((rows, m, 1), np.nan), np.full((rows, m), np.nan), np.empty((0, n, m))
    bounds(system, no, after, size, row, seen, e, allowed)
    return Gathered(after, size), e, allowed


# What follows from them -----------------------------------------------------------------------------------------------


def judged(model: DiscreteModel, filtered: Filtered, first: int) -> Filtered:
    """A filtered record with its ``contradictions``, and −∞ for the log-likelihoods of the runs that have one."""
    found = find(model, filtered.z, filtered, first)
    if not found:
        return filtered
    names = ("log_likelihood", "log_likelihood_diffuse")
    impossible: dict[str, Any] = {name: _impossible(getattr(filtered, name), found) for name in names}
    return replace(filtered, contradictions=found, **impossible)


def _impossible(value: Any, found: Sequence[Contradiction]) -> Any:
    if np.ndim(value) == 0:
        return -np.inf
    runs = np.array(value)
    runs[[each.run for each in found]] = -np.inf
    return runs


def sentence(found: Sequence[Contradiction], names: Sequence[str], where: str) -> str:
    """What contradictions say of the model, the first of them (at ``where``) in numbers; nothing where there are none.

    >>> sentence([Contradiction(2, 0, 0.1, 1e-15)], ["z"], "row 2")[:101]
    'The record is impossible for this model: at row 2, z differs by 0.1 from the value that is known exac'
    """
    if not found:
        return ""
    text = _(
        "The record is impossible for this model: at {where}, {name} differs by {innovation} from the value that is known exactly "
        "there, and rounding explains {allowed} of it. "
    )
    if len(found) > 1:
        text += _("So do {count} elements in all. ")
    text += _(
        "The log-likelihood is −∞, and the estimates are those without such elements. A variance that is 0 where it should not "
        "be, or two sensors of one source, are the likely causes."
    )
    first = found[0]
    return fill(
        text, where=where, name=names[first.element], innovation=number(first.innovation), allowed=number(first.allowed, 2),
        count=len(found),
    )  # fmt: skip
