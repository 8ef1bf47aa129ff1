r"""Runs of equal values: a sensor that is stuck.

Given what was measured before, a value that is recorded in steps of d equals any given one with probability

.. math:: p_k \le \mathrm{erf}\left(\frac{d}{2\sqrt{2S_k}}\right)

at most, so that a run of equal values begins somewhere among K with probability :math:`K\prod p_k` at most.
"""

from __future__ import annotations

import numpy as np
from scipy import special

from ctlabs.analysis.diagnosis.candidates import Candidate, Event
from ctlabs.filtering.results import Filtered
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel


def resolution(values: Array) -> Array:
    """Steps in which values are recorded, an upper bound for each: the least difference, or the last digit that is written.

    Of a logger with a fixed number of digits large values have coarser steps than small ones.

    >>> resolution(np.array([0.25, 1.0, 2.75])), resolution(np.array([1230.0, 1.23, 1.24])).round(6)
    (array([0.75, 0.75, 0.75]), array([10.  ,  0.01,  0.01]))
    """
    some = values if len(values) <= 1000 else values[:: len(values) // 1000]
    digits = max(len(repr(abs(v)).partition("e")[0].replace(".", "").strip("0")) for v in some.tolist())
    with np.errstate(divide="ignore"):
        written = np.where(values == 0, 0.0, 10.0 ** (np.floor(np.log10(np.abs(values))) + 1 - digits))
    steps = np.diff(np.unique(values))
    steps = steps[steps > 8 * np.finfo(float).eps * np.abs(values).max()]
    return np.maximum(written, steps.min(initial=np.inf) if steps.size else 10.0**-12 * np.abs(values))


def repeated(filtered: Filtered, first: int) -> list[Event]:
    """The runs of equal values of a record, each with a bound ``p`` of the probability that there is one like it."""
    variances, z = np.diagonal(filtered.S, axis1=1, axis2=2), filtered.asked[1]
    there = filtered.used & np.isfinite(variances) & np.isfinite(z)
    count, found = int(there.sum()), []
    for i in range(there.shape[1]):
        at = np.flatnonzero(there[:, i])
        values = z[at, i]
        same = values[1:] == values[:-1]
        if not same.any():
            continue
        steps = resolution(values)
        with np.errstate(divide="ignore"):
            log_p = np.log(special.erf(steps / np.sqrt(8 * variances[at, i])))
        edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]])))
        for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            p = min(1.0, float(np.exp(min(np.log(count) + log_p[begin + 1 : end + 1].sum(), 0.0))))
            rows = tuple((at[begin : end + 1] - first).tolist())
            found.append(Event("stuck", i, rows, float(values[begin]), 0.0, 0.0, p))
    return found


def stuck(model: DiscreteModel, z: Array, events: list[Event], first: int) -> Candidate | None:
    """Runs of equal values as a change of the record, in which each is measured once; None where there are none."""
    if not events:
        return None
    left = z.copy()
    for event in events:
        left[np.array(event.rows[1:]) + first, event.place] = np.nan
    worst = min(events, key=lambda event: event.p)
    gain = -2 * float(np.log(max(worst.p, 1e-300)))
    return Candidate("stuck", worst.place, (float(len(worst.rows)),), gain, worst.p, 0.0, model, left, tuple(events))
