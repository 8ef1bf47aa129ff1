r"""The derivatives of a record's log-likelihood by the matrices of its model, exact, from one pass forward and one back.

With them the derivative by any constant θ is a sum over matrices (:mod:`ctlabs.filtering.engines.adjoint`),

.. math:: \frac{\partial\ell}{\partial\theta} = \sum_M\left\langle\frac{\partial\ell}{\partial M},
          \frac{\partial M}{\partial\theta}\right\rangle

The first instants of a record whose start is vague
(:mod:`ctlabs.filtering.algorithms.vague`) have no such recursion: what they leave, their own likelihood and the x̂, P with which an
ordinary filter goes on, is a function of the matrices (:func:`beginning`) that a caller differentiates.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ctlabs.filtering.algorithms import vague
from ctlabs.filtering.engines.compiled import fixed
from ctlabs.filtering.engines.record import ByInstant
from ctlabs.filtering.filter import solved
from ctlabs.filtering.problem import FilterProblem
from ctlabs.filtering.results import Filtered
from ctlabs.linalg.checks import Array
from ctlabs.linalg.correlated import regression
from ctlabs.models.linear import DiscreteModel, at

#: A P0 so many times as large as the noises, as measurements see it, leaves half of a slope's digits.
WIDE = 1e8
#: The matrices of a posed problem.
MATRICES = ("Phi", "Qd", "offset", "H", "R", "N", "x0", "P0")


@dataclass(frozen=True, slots=True, eq=False)
class Slopes:
    """∂ℓ by each matrix of a problem's model, of the matrix's own shape; ``None`` where the model has none.

    ``z`` (steps+1, m), by the measurements, 0 where nothing is measured · ``begun``, the instants of a vague start, of which the others
    say nothing: ``x0`` and ``P0`` are then by the x̂ and P of instant ``begun`` · ``found``, the filtered record, with an axis of one run
    """

    Phi: Array
    Qd: Array
    offset: Array | None
    H: Array
    R: Array
    N: Array | None
    x0: Array
    P0: Array
    z: Array
    begun: int
    found: Filtered


class Begun(NamedTuple):
    """What the first instants of a vague start leave: their log-likelihood, and the prediction x (n,), P (n, n) of the next."""

    log_likelihood: float
    x: Array
    P: Array


def slopes(problem: FilterProblem) -> Slopes | None:
    """∂ℓ by every matrix, for one record; ``None`` where ℓ has no derivative: it is −∞, or w correlates with perfect measurements.

    Raises
    ------
    FloatingPointError
        The covariance overflows, or rounding makes S indefinite.

    >>> from ctlabs.filtering.problem import pose
    >>> own = slopes(pose(DiscreteModel([[1]], [[0]], [[1]], [[2.0]], P0=[[0]]), [1.0, -3.0]))
    >>> own.R, own.x0  # ½Σ(ν²/r² − 1/r), Σν/r
    (array([[0.75]]), array([-1.]))
    """
    from ctlabs.filtering.engines import adjoint  # numba costs 0.3 s to import

    found, model = solved(problem), problem.model
    if not np.isfinite(found.log_likelihood_diffuse[0]):
        return None
    used, rows = found.used, len(problem.z)
    begun = 0 if _moderate(model) else _begun(found)
    Phi, M = _motions(model, used) if model.N is not None else (_stack(model.Phi), None)
    if Phi is None:
        return None
    H, R = _stack(model.H), _stack(model.R)
    steps, n, m = rows - 1, model.n, model.m
    own = _lengths(model, steps) if M is None else {"Phi": steps, "Qd": steps, "offset": steps}
    out = adjoint.AdjointSlopes(
        np.zeros((own["Phi"], n, n)), np.zeros((own["Qd"], n, n)), np.zeros((own["offset"], n)), np.zeros((len(H), m, n)),
        np.zeros((len(R), m, m)), np.zeros((rows, m)), np.zeros(n), np.zeros((n, n)),
    )  # fmt: skip
    if begun < rows:
        histories = [np.ascontiguousarray(a) for a in (
            found.x_minus[:, :, 0], found.x_plus[:, :, 0], found.P_minus, found.P_plus, found.K, found.innovation[:, :, 0], found.S, used,
        )]  # fmt: skip
        adjoint.backward(fixed(Phi), fixed(H), adjoint.AdjointInputs(*histories), begun, out)
    N = None
    if M is not None:
        N = _uncoupled(problem, used, M, out, begun)
    return Slopes(
        Phi=_like(out.Phi, model.Phi), Qd=_like(out.Qd, model.Qd),
        offset=None if model.offset is None else _like(out.offset, model.offset),
        H=_like(out.H, model.H), R=_like(out.R, model.R), N=N, x0=out.x0, P0=out.P0, z=out.z, begun=begun, found=found,
    )  # fmt: skip


def beginning(problem: FilterProblem, begun: int) -> Begun:
    """The first ``begun`` instants from a vague start, each as :mod:`ctlabs.filtering.algorithms.vague` takes it.

    However soon another model's start is known, the number of instants is the one asked for: what is left behind them is a smooth
    function of the matrices. NaN where something is not known by then.
    """
    variances = np.diagonal(_stack(problem.model.R)[: len(problem.z)], axis1=1, axis2=2)
    used = ~problem.absent & np.isfinite(variances)
    record = ByInstant(problem.model, problem.z, float, used)
    state, total = vague.start(problem.model, problem.model.P0), 0.0
    for k in range(begun):
        if k:
            state = vague.predict(state, *record.motion(k - 1))
        if record.used[k].any():
            state, told = vague.update(state, *record.measurement(k))
            record.used[k, record.used[k]] = told.used
            total += float(told.log_likelihood[0])
    if begun < len(problem.z):
        state = vague.predict(state, *record.motion(begun - 1))
    elif state.lost.any():
        return Begun(total, np.zeros(problem.model.n), np.zeros(problem.model.P0.shape))
    return Begun(total, state.mean[:, 0], state.covariance)


def _moderate(model: DiscreteModel) -> bool:
    """Whether the pass back may go through to t0, from a P0 that is large but leaves half of the digits."""
    return bool(np.isfinite(model.P0).all() and (np.abs(vague.sight(model)) @ np.sqrt(model.P0.diagonal())).max(initial=0.0) ** 2 <= WIDE)


def _begun(found: Filtered) -> int:
    """How many instants of the record passed before an ordinary filter could go on."""
    return 0 if found.start is None else len(found.start.P)


def _lengths(model: DiscreteModel, steps: int) -> dict[str, int]:
    """How many entries the motions' stacks have."""
    offset = 1 if model.offset is None or model.offset.ndim == 1 else steps
    return {"Phi": len(_stack(model.Phi)), "Qd": len(_stack(model.Qd)), "offset": offset}


def _motions(model: DiscreteModel, used: Array) -> tuple[Array | None, Array | None]:
    """Φ − NR⁻¹H and NR⁻¹ (steps, n, m) where w and v correlate; nothing where an R is singular."""
    steps = len(used) - 1
    Phi, M = np.array(np.broadcast_to(model.Phi, (steps, model.n, model.n))), np.zeros((steps, model.n, model.m))
    assert model.N is not None
    known: dict[bytes, Array] = {}
    for k in range(steps):
        there, R = used[k], at(model.R, k, 2)
        if not there.any():
            continue
        key = there.tobytes() if model.R.ndim == 2 else b""
        if not key or key not in known:
            own = R[np.ix_(there, there)]
            if np.linalg.matrix_rank(own / np.sqrt(np.outer(own.diagonal(), own.diagonal()) + (own == 0)), hermitian=True) < len(own):
                return None, None
            known[key] = regression(model.N[:, there], own)
        M[k][:, there] = known[key]
        Phi[k] -= known[key] @ at(model.H, k, 2)[there]
    return Phi, M


def _uncoupled(problem: FilterProblem, used: Array, M: Array, out: object, begun: int) -> Array:
    """∂ℓ by N; those by R and H are completed by what M = NR⁻¹ carries, and Φ − MH, Qd − MNᵀ, c + Mz are as by Φ, Qd, c."""
    from ctlabs.filtering.engines import adjoint

    assert isinstance(out, adjoint.AdjointSlopes)
    model, z = problem.model, np.where(used, np.nan_to_num(problem.z[:, :, 0]), 0.0)
    N = np.zeros(M.shape[1:])
    for k in range(max(begun, 0), len(M)):
        there = np.flatnonzero(used[k])
        if not there.size:
            continue
        own, R, H = M[k][:, there], at(model.R, k, 2)[np.ix_(there, there)], at(model.H, k, 2)[there]
        told = np.outer(out.offset[k], z[k, there]) - out.Phi[k] @ H.T
        right = np.linalg.solve(R, told.T).T
        N[:, there] += right - 2 * out.Qd[k] @ own
        h, r = k % len(out.H), k % len(out.R)
        out.H[h][there] -= own.T @ out.Phi[k]
        crossed = own.T @ right
        out.R[r][np.ix_(there, there)] += own.T @ out.Qd[k] @ own - 0.5 * (crossed + crossed.T)
        out.z[k, there] += own.T @ out.offset[k]
    return N


def _stack(matrix: Array) -> Array:
    return matrix if matrix.ndim == 3 else matrix[None]


def _like(found: Array, matrix: Array) -> Array:
    """Derivatives in the shape of their matrix: summed where it is constant."""
    return found if found.ndim == matrix.ndim else found.sum(axis=0)
