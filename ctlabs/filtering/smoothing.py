r"""Smoothing: every state given the whole record, or given so many more measurements.

The estimate from what is measured up to k and the likelihood of what is measured after k meet:

.. math:: p(x_k \mid z_1\dots z_N) \propto p(x_k \mid z_1\dots z_k)\;
          \exp\left(-\tfrac12\|U_k(x_k - \hat x_k^+) - y_k\|^2\right), \qquad
          P_s = L(I + L^TU^TUL)^{-1}L^T,\ P^+ = LL^T

(Fraser & Potter, IEEE Trans. AC-14, 1969). U and y come backward through orthogonal reflections of
square roots (:mod:`ctlabs.filtering.engines.backward`), and perfect measurements (R = 0) as constraints Cx = c beside them: no covariance
is inverted, so that singular P0, Qd, Φ, R or P⁻ are no exceptions, and P_s is a square, symmetric and nonnegative. After a
vague start (:mod:`ctlabs.filtering.algorithms.vague`) L has the columns of what is vaguely known, or not known, beside P's. With N ≠ 0 the
transition is Φ−NR⁺H with the noise Qd−NR⁺Nᵀ. Only the filter's estimates, covariances and innovations are used: any form's will do.
It equals the recursion of Rauch, Tung & Striebel (AIAA J. 3, 1965), where that has the inverses that it needs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.filtering import digits
from ctlabs.filtering.algorithms.beginning import close, units
from ctlabs.filtering.engines import compiled
from ctlabs.filtering.filter import kalman_filter
from ctlabs.filtering.measured import any_perfect
from ctlabs.filtering.motion import motions
from ctlabs.filtering.problem import Model
from ctlabs.filtering.results import Contradiction, Filtered
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models.linear import ContinuousModel, DiscreteModel

if TYPE_CHECKING:
    from ctlabs.filtering.engines.backward import Backward, Prior

#: Smoothed estimates that differ by this part of their standard deviations in other units of the states are said to.
FAR = 1e-7
#: Windows of the fixed-lag smoother that go back together where their matrices are the same.
TOGETHER = 64


@dataclass(frozen=True, slots=True, eq=False)
class Smoothed:
    """Estimates given the whole record.

    ``t`` (steps+1,) s · ``x`` (steps+1, n[, runs]) · ``P`` (steps+1, n, n), covariance of their errors · ``lag_one``
    (steps+1, n, n), entry k is cov(x_k, x_{k−1}) given the record; NaN at 0, which nothing precedes. A state that the
    whole record does not determine is NaN with the variance ``inf``, zeros beside it and NaN in ``lag_one`` ·
    ``contradictions``, those of the filtered record: the estimates are given the rest of it
    """

    t: Array
    x: Array
    P: Array
    lag_one: Array
    contradictions: tuple[Contradiction, ...] = ()
    remarks: tuple[str, ...] = ()


def smooth(model: Any, z: ArrayLike | Filtered, *, lag: int | None = None, **options: Any) -> Smoothed:
    r"""Every state given the whole record; or, with ``lag``, given what is measured up to so many steps later.

    Parameters
    ----------
    model : the filter's model, discrete, or continuous with the times ``t`` of the measurements
    z : the record, (rows, m[, runs]), or what :func:`ctlabs.kalman_filter` made of it with any algorithm
    lag : None, or the number of steps ≥ 0 that the estimate of x_k may wait: :math:`E[x_k \mid z_1\dots z_{k+lag}]`, exactly, of
        one record, at a work per step proportional to ``lag``. 0 is the filter; the last ``lag`` states have the rest of the record
    options : as for :func:`ctlabs.kalman_filter`: first, t, H, R, u, u0, P0, algorithm

    Raises
    ------
    TypeError
        A nonlinear model.
    ValueError
        A history that does not fit the model; one that began without information elsewhere (``inf`` in P, and no ``start``).
    FloatingPointError
        An overflow.

    >>> m = DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[10]])
    >>> found = smooth(m, [1.0, 2.0])
    >>> found.x[:, 0].round(6), found.P[:, 0, 0].round(6), found.lag_one[1:, 0, 0].round(6)
    (array([1.142857, 1.257143, 1.628571]), array([1.428571, 0.628571, 0.657143]), array([0.571429, 0.314286]))
    """
    if isinstance(z, Filtered):
        if options:
            msg = f"{next(iter(options))}: expected none beside a filtered record, which had its own; received one"
            raise ValueError(msg)
        filtered = z
        belongs(model, filtered)
    else:
        if not isinstance(model, ContinuousModel | Model):
            msg = f"model: expected a DiscreteModel or a ContinuousModel, received a {type(model).__name__}"
            raise TypeError(msg)
        filtered = kalman_filter(model, z, **options)
    _finite(filtered)
    found = _smoothed(filtered)
    found = found if lag is None else _lagged(filtered, found, checks.count("lag", lag, least=0))
    return replace(found, remarks=(*found.remarks, *digits.remarks(filtered, found.x, found.P, "smoothed")))


def belongs(model: Any, filtered: Filtered) -> None:
    """Refuse a history of another model."""
    own = filtered.model
    if not isinstance(own, DiscreteModel) or not isinstance(model, ContinuousModel | Model):
        wrong = model if isinstance(own, DiscreteModel) else own
        msg = f"model: expected a DiscreteModel or a ContinuousModel, received a {type(wrong).__name__}"
        raise TypeError(msg)
    if (model.n, model.m) != (own.n, own.m):
        msg = f"filtered: expected a record of a model with n, m = {model.n, model.m}, received one with {own.n, own.m}"
        raise ValueError(msg)
    if isinstance(model, DiscreteModel):
        same = model.cut(len(filtered.t) - 1)
        for name in ("Phi", "Qd"):
            if not np.array_equal(getattr(same, name), getattr(own, name)):
                msg = f"filtered: expected a record of this model, received one that was filtered with another {name}"
                raise ValueError(msg)


def _smoothed(filtered: Filtered) -> Smoothed:
    single = filtered.x_plus.ndim == 2
    way, prior, x = _way(filtered)
    elsewhere, start = None, filtered.start
    perfect = start is not None and any_perfect(filtered.model.R)
    if start is not None and not perfect:  # a perfect measurement leaves σ that are the rounding of zero
        elsewhere = _elsewhere(way, prior, x)
    P, lag_one = np.empty_like(filtered.P_plus), np.full_like(filtered.P_plus, np.nan)
    _compiled("smooth", way, prior, x, P, lag_one)
    remarks: tuple[str, ...] = ()
    if elsewhere is not None and not close(x, elsewhere[0], P, elsewhere[1], FAR):
        text = (
            f"in other units of the states the smoothed estimates or covariances differ by more than {FAR:.0e} of their standard "
            "deviations: rounding has grown that much on the way back from a vague start; a smaller P0 leaves more digits"
        )
        remarks = (text,)
    if start is not None and perfect and start.precise:
        text = (
            f"the first {len(start.P)} instants after a start with little information took more digits than doubles have, and on the way "
            "back there are no others: their smoothed estimates may have few that are right; a smaller P0 leaves more"
        )
        remarks = (text,)
    return Smoothed(filtered.t, x[:, :, 0] if single else x, P, lag_one, filtered.contradictions, remarks)


def _elsewhere(way: Backward, prior: Prior, x: Array) -> tuple[Array, Array]:
    """The estimates and covariances computed in other units of the states, whose rounding is another."""
    d = units(x.shape[1])
    column, both = d[:, None], np.outer(d, d)
    there = way._replace(
        Phi=way.Phi * column / d, G=way.G * column, rows=way.rows / d, values=way.values.copy(), shift=way.shift * column
    )
    moved, P = x * column, np.empty_like(prior.P)
    _compiled("smooth", there, prior._replace(P=prior.P * both, L=prior.L * column, A=prior.A * column), moved, P, np.empty_like(P))
    return moved / column, P / both


def _lagged(filtered: Filtered, whole: Smoothed, lag: int) -> Smoothed:
    """The estimates given what is measured up to ``lag`` steps later; ``lag_one`` is not known then."""
    if filtered.x_plus.ndim != 2:
        msg = "lag: expected one record, (rows, m), received an ensemble"
        raise ValueError(msg)
    steps, unknown = len(filtered.t) - 1, np.full_like(whole.lag_one, np.nan)
    if lag >= steps:
        return replace(whole, lag_one=unknown)
    way, prior, x = _way(filtered)
    P = np.empty_like(filtered.P_plus)
    _compiled("windows", way, prior, lag, TOGETHER, x, P)
    x, rest = x[:, :, 0], slice(steps - lag, None)
    x[rest], P[rest] = whole.x[rest], whole.P[rest]
    return replace(whole, x=x, P=P, lag_one=unknown)


def _finite(filtered: Filtered) -> None:
    """Refuse infinite covariances, but those of a vague start."""
    begin = 0 if filtered.start is None else len(filtered.start.P)
    unknown = ~np.isfinite(filtered.P_plus[begin:]).all(axis=(1, 2))
    if unknown.any():
        found = f"inf at step {begin + int(np.argmax(unknown))} (no information)"
        msg = f"filtered.P_plus: expected finite covariances, received {found}"
        raise ValueError(msg)


def _way(filtered: Filtered) -> tuple[Backward, Prior, Array]:
    """What the compiled way back needs: later data, earlier data, and x̂⁺ (steps+1, n, runs) to be changed."""
    from ctlabs.filtering.engines.backward import Backward, Prior

    model: DiscreteModel = filtered.model
    rows, n, m, start = len(filtered.t), model.n, model.m, filtered.start
    x_minus, x_plus = (x.reshape(rows, n, -1).copy() for x in (filtered.x_minus, filtered.x_plus))
    innovation, P = filtered.innovation.reshape(rows, m, -1).copy(), filtered.P_plus.copy()
    L, A = np.empty((2, 0, n, n))
    unknown, later = np.empty(0, dtype=np.int64), np.zeros(rows, dtype=np.int64)
    if start is not None:
        begin = len(start.P)
        x_minus[:begin], x_plus[:begin], innovation[:begin] = start.x_minus, start.x_plus, start.innovation
        P[:begin], L, A, unknown, later[:begin] = start.P, start.L, start.A, start.unknown, start.determined
    Phi, Q, _M = motions(model, filtered.used)
    system = compiled.system(model)
    way = Backward(
        Phi,
        np.empty_like(Q),
        np.empty((rows, m, n)),
        np.empty(innovation.shape),
        np.empty((rows, m), dtype=np.int64),
        x_plus - x_minus,
        np.empty(rows, dtype=np.int64),
    )
    _compiled("prepare", system, compiled.fixed(filtered.used), compiled.fixed(innovation), Q, way)
    return way, Prior(P, L, A, unknown.astype(np.int64), later), x_plus


def _compiled(name: str, *arguments: object) -> None:
    """A compiled loop of :mod:`ctlabs.filtering.engines.backward`, loaded when it is needed."""
    from ctlabs.filtering.engines import backward

    if getattr(backward, name)(*arguments) is False:
        msg = "smoothed P: expected finite covariances, received an overflow"
        raise FloatingPointError(msg)
