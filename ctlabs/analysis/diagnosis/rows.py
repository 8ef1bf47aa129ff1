r"""Single rows that speak against the model: outlying measurements, and breaks of a state.

The greatest of K values τ ~ N(0, 1) (:mod:`ctlabs.filtering.disturbances`) is beyond c in a record of the model with probability

.. math:: P(\max|\tau| > c) \le K\,\mathrm{erfc}(c/\sqrt2)

at most, however they depend on each other. The greatest is taken out of the record, or added to the state, and the rest is looked at
again, as an outlier makes its neighbours look strange and may hide another one.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import special

from ctlabs.analysis.diagnosis.candidates import Candidate, Event
from ctlabs.filtering.disturbances import Shocks, shocks
from ctlabs.filtering.filter import kalman_filter
from ctlabs.filtering.results import Filtered
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel

#: No more rows than one in so many, and than MOST, are taken for exceptions; at least FEW may be.
ONE_IN, MOST, FEW = 20, 20, 3
#: Twice the gain by which one explanation has to exceed another, to be told from it.
TOLD = 4.0


class Place(NamedTuple):
    """Where τ is greatest: "outlier" or "break", the instant, the element or state, τ² and its p, and the value added."""

    kind: str
    k: int
    i: int
    square: float
    p: float
    size: float


def greatest(found: Shocks) -> Place | None:
    """The greatest τ of a record, None where none can be told; of an outlier and a break that are as likely, the outlier.

    >>> from ctlabs import kalman_filter
    >>> walk = DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[10]])
    >>> greatest(shocks(kalman_filter(walk, [0.0, 0.0, 12.0, 0.0, 0.0])))[:3]
    ('outlier', 3, 0)
    """
    best = None
    for kind, tau, size in (("outlier", found.outlier, found.outlier_size), ("break", found.shock, found.shock_size)):
        square = np.where(np.isfinite(tau), tau, 0.0) ** 2
        k, i = (int(at) for at in np.unravel_index(np.argmax(square), square.shape))
        if square[k, i] > (best.square * (1 + 1e-9) if best else 0.0):
            best = Place(kind, k, i, float(square[k, i]), chance(float(square[k, i]), found.count), float(size[k, i]))
    return best


def chance(square: float, count: int) -> float:
    """A bound of the probability that any of ``count`` values τ of a right model has such a square."""
    return min(1.0, float(count * special.erfc(np.sqrt(0.5 * square))))


def singled_out(model: DiscreteModel, z: Array, first: int, level: float) -> Candidate | None:
    """The rows that are significant at ``level``, one after the other, as one change; None where there are none.

    Its ``z`` lacks the outliers, its ``model`` has the breaks as known inputs. Equal outlying values of one measurement are one event.
    """
    events: list[Event] = []
    changed, left = model, z
    limit = max(FEW, min(MOST, (len(z) - first) // ONE_IN))
    while len(events) < limit:
        found = shocks(kalman_filter(changed, left[first:], first=first))
        place = greatest(found)
        if place is None or place.p >= level:
            break
        if place.kind == "break":
            rows, rival = (place.k - first,), _rival(found, place, first)
            event = Event("break", place.i, rows, np.nan, place.size, float(np.sqrt(place.square)), place.p, rival)
        else:
            event = _outlier(found, place, left, first, level)
        events.append(event)
        changed, left = _without(changed, left, event, first)
    if not events:
        return None
    events = _confirmed(model, z, first, events, level)
    outliers = sum(len(event.rows) for event in events if event.kind == "outlier")
    if 2 * outliers >= np.isfinite(z[first:]).sum():  # what half of a record does is no exception
        return None
    return _judged(model, z, events, first)


def _outlier(found: Shocks, place: Place, z: Array, first: int, level: float) -> Event:
    """An outlying value, with all others of its measurement that are equal and outlying."""
    value, tau = z[place.k, place.i], found.outlier[:, place.i]
    with np.errstate(invalid="ignore"):
        alike = (z[:, place.i] == value) & (found.count * special.erfc(np.abs(tau) / np.sqrt(2)) < level)
    rows = tuple((np.flatnonzero(alike) - first).tolist())
    rival = _rival(found, place, first) if len(rows) == 1 else None
    return Event("outlier", place.i, rows, float(value), place.size, float(np.sqrt(place.square)), place.p, rival)


def _rival(found: Shocks, place: Place, first: int) -> Event | None:
    """An event of another kind, or of another state, at the same row that is nearly as likely."""
    best = None
    for kind, tau, size in (("outlier", found.outlier, found.outlier_size), ("break", found.shock, found.shock_size)):
        for i, value in enumerate(tau[place.k].tolist()):
            if (kind, i) != (place.kind, place.i) and value**2 > place.square - TOLD and (best is None or abs(value) > best.sigmas):
                best = Event(kind, i, (place.k - first,), np.nan, float(size[place.k, i]), abs(value), chance(value**2, found.count))
    return best


def _without(model: DiscreteModel, z: Array, event: Event, first: int) -> tuple[DiscreteModel, Array]:
    """The record without an event: its outliers missing, or its break a known input."""
    at = np.array(event.rows) + first
    if event.kind == "break":
        offset = np.zeros((len(z) - 1, model.n)) + (0.0 if model.offset is None else model.offset)
        offset[at - 1, event.place] += event.size
        return replace(model, offset=offset), z
    left = z.copy()
    left[at, event.place] = np.nan
    return model, left


def _confirmed(model: DiscreteModel, z: Array, first: int, events: list[Event], level: float) -> list[Event]:
    """The outliers told by the record without all others; what is not outlying beside that goes back."""
    kept = []
    for event in events:
        if event.kind == "outlier":
            changed, left = model, z
            for other in events:
                changed, left = _without(changed, left, other, first)
            k = event.rows[0] + first
            left[k, event.place] = event.value
            found = shocks(kalman_filter(changed, left[first:], first=first))
            tau = found.outlier[k, event.place]
            if chance(tau**2, found.count) >= level and len(events) > 1:
                continue
            event = event._replace(size=float(found.outlier_size[k, event.place]), sigmas=abs(float(tau)))
        kept.append(event)
    return kept


def _judged(model: DiscreteModel, z: Array, events: list[Event], first: int) -> Candidate | None:
    r"""What the events gain together: at least this.

    The values of the outliers are free, so that their density counts at its top, :math:`\prod(2\pi V)^{-1/2}` with the variances V of
    each given what was measured elsewhere, which are not above those given what was measured before.
    """
    if not events:
        return None
    before = kalman_filter(model, z[first:], first=first)
    changed, left = model, z
    for event in events:
        changed, left = _without(changed, left, event, first)
    after = kalman_filter(changed, left[first:], first=first)
    gone = np.isnan(left) & ~np.isnan(z)
    top = np.log(2 * np.pi * _variances(after)[gone]).sum()
    gain = float(2 * (after.log_likelihood_diffuse - before.log_likelihood_diffuse) - top)
    count = int(gone.sum()) + sum(event.kind == "break" for event in events)
    cost = count * (2.0 + 2.0 * np.log(max(int(np.isfinite(z).sum()), 1)))
    leading = max(events, key=lambda event: event.sigmas)
    return Candidate(leading.kind, leading.place, (leading.size,), gain, leading.p, cost, changed, left, tuple(events))


def _variances(filtered: Filtered) -> Array:
    """The variances of all elements given what was measured before, (steps+1, m)."""
    model: DiscreteModel = filtered.model
    R = np.diagonal(model.R, axis1=-2, axis2=-1)
    P = np.where(np.isfinite(filtered.P_minus), filtered.P_minus, 0.0)
    return np.asarray(((model.H @ P) * model.H).sum(axis=-1) + R)
