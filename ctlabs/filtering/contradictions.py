r"""Contradictions: an exact measurement that disagrees with what is known exactly.

A perfect element, or one whose noise is combined of those before it, may have an innovation of no variance given those of
the elements b that enter the update before it. It is known already and tells nothing; but

.. math:: e_i = \nu_i - w^T\nu_b, \quad w = S_{bb}^{-1}S_{bi}, \quad \nu = z - H\hat x^-

must be zero. Where it is not, the record is an event of probability zero, and the likelihood −∞. What rounding may leave of
e_i is bounded by

.. math:: \gamma\left(|z_i| + |h_i||\hat x| + |w|^T(|z_b| + |H_b||\hat x|) + \text{that of }w\right) + \sqrt{gWg^T}, \quad
          g = h_i - w^TH_b, \quad \gamma = (n + m + 2)\varepsilon

in which W bounds what x̂ has gathered since t0 (:mod:`ctlabs.filtering.gathered`). Nothing depends on units.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ctlabs.filtering import gathered
from ctlabs.filtering.measured import perfect
from ctlabs.filtering.problem import FilterProblem
from ctlabs.filtering.results import Contradiction, Filtered, Mask
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel
from ctlabs.text import _, fill, number

EPS = float(np.finfo(float).eps)


def known(model: DiscreteModel, z: Array, used: Mask, first: int) -> Mask:
    """The elements of z (steps+1, m[, runs]) that are measured but known already, and did not enter the update, (steps+1, m).

    >>> m = DiscreteModel([[1]], [[1]], [[1], [1]], np.zeros((2, 2)), x0=[0], P0=[[4]])
    >>> known(m, np.array([[np.nan, np.nan], [1.0, 1.0]]), np.array([[False, False], [True, False]]), 1)
    array([[False, False],
           [False,  True]])
    """
    found = ~used
    found[:first] = False
    if not found.any():
        return found
    found &= ~(np.isnan(z) if z.ndim == 2 else np.isnan(z).all(axis=2))
    if model.R.ndim == 2:
        return np.asarray(found & perfect(model.R))
    for k in np.flatnonzero(found.any(axis=1)):
        found[k] &= perfect(model.R[k])
    return found


def find(model: DiscreteModel, z: Array, history: Filtered, first: int, offset: Array | None = None) -> tuple[Contradiction, ...]:
    """The contradictions of a record, or of an ensemble of records, row by row.

    Parameters
    ----------
    model : the filter's model
    z : (steps+1, m) or (steps+1, m, runs), by instants, NaN = not measured
    history : of any form of the filter
    first : 1 (first measurement at t1) or 0 (at t0)
    offset : (steps+1, m), what was known of the measurements and is not in z any more; its rounding is

    >>> from ctlabs import kalman_filter
    >>> m = DiscreteModel([[0.5]], [[0]], [[1]], [[0]], x0=[1], P0=[[0]])
    >>> kalman_filter(m, [0.5, 0.5]).contradictions[0]._replace(allowed=0)
    Contradiction(row=1, element=0, innovation=0.25, allowed=0, run=0)
    """
    if not known(model, z, history.used, first).any():
        return ()
    e, allowed = innovations(model, z, history, first, offset)
    with np.errstate(invalid="ignore"):
        wrong = np.argwhere(np.abs(e) > allowed[:, :, None])
    return tuple(
        Contradiction(k - first, i, float(e[k, i, run]), float(allowed[k, i]), run) for k, i, run in wrong.tolist()
    )


def innovations(
    model: DiscreteModel, z: Array, history: Filtered, first: int, offset: Array | None = None
) -> tuple[Array, Array]:
    """Of what is known already: innovations given the elements before (steps+1, m, runs), and what rounding explains (steps+1, m).

    NaN for elements that enter the update or are not measured.
    """
    asked = known(model, z, history.used, first)
    offset = np.zeros(asked.shape) if offset is None else offset
    e, allowed = gathered.innovations(model, z, offset, history, asked)
    begun = gathered.begins(history)
    if asked[:begun].any():
        _vaguely(history.start, offset, e, allowed)
    return e, allowed


def _vaguely(start: Any, offset: Array, e: Array, allowed: Array) -> None:
    """What the first instants after a vague start say of what was known already, into ``e`` and ``allowed``."""
    if start is None:
        return
    rows = len(start.terms)
    e[:rows] = start.excess
    for k in range(rows):
        allowed[k] = vaguely(start.terms[k] + 2 * np.abs(offset[k]), start.P.shape[1], k)


def vaguely(terms: Array, n: int, k: int) -> Array:
    """What rounding explains of innovations that are sums of ``terms`` (m,), at instant k since a vague start of n states."""
    return np.asarray(8 * (n + len(terms) + 2) * EPS * (k + 1) * terms)


# What follows from them -----------------------------------------------------------------------------------------------


def judged(problem: FilterProblem, filtered: Filtered) -> Filtered:
    """The filtered record of a problem with its ``contradictions``, and −∞ for the log-likelihoods of the runs that have one."""
    found = find(problem.model, filtered.z, filtered, problem.first, problem.known)
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
