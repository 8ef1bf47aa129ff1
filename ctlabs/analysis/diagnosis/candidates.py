r"""Changes of the whole model that would make a record more likely: R and Qd, a constant, the initial estimate.

.. math:: 2\ln\frac{\max_{a,b}p(z; aR, bQ_d)}{p(z; R, Q_d)} \approx \chi^2(2)

and of a constant or an initial estimate, in which ln p(z) is quadratic, χ² exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy import special

from ctlabs.analysis import fitting
from ctlabs.filtering.disturbances import StartShift
from ctlabs.filtering.filter import kalman_filter, log_likelihood
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel
from ctlabs.models.linear import derived

#: A factor on R so small that the record would be most likely without any noise.
NOTHING = 1e-9


class Event(NamedTuple):
    """Something that happened at single rows of a record, counted from 0 as those of z.

    ``kind`` is "outlier" (of measurement ``place``), "break" (state ``place`` jumps before this row) or "stuck" (the measurement
    repeats its value) · ``rows``, one; all with this outlying value; all that repeat it · ``value``, measured (NaN: a break) ·
    ``size``, how far it is from what the rest of the record suggests · ``sigmas``, the same in standard deviations; of "stuck" 0 ·
    ``p``, a bound of its probability in a record of the model, wherever it might have been · ``rival``, another event that the record
    hardly tells from it, or None
    """

    kind: str
    place: int
    rows: tuple[int, ...]
    value: float
    size: float
    sigmas: float
    p: float
    rival: Event | None = None


class Candidate(NamedTuple):
    """One change of the model or the record, and 2 ln of the likelihood ratio that it gains.

    ``kind`` is "R", "Qd", "R and Qd", "wander" (a variance for a state to which Qd gives none), "input" (a constant added to a state every
    step), "bias" (of a measurement), "start" (another initial estimate) or that of its first event · ``place`` of the state or
    measurement, 0 else · ``size``, factors, the constant, the shift of x0 · ``gain`` · ``p``, the probability of so much gain
    from a right model · ``cost``, what Akaike's criterion takes off · ``model`` and ``z`` (steps+1, m), changed · ``events``
    """

    kind: str
    place: int
    size: tuple[float, ...]
    gain: float
    p: float
    cost: float
    model: DiscreteModel
    z: Array
    events: tuple[Event, ...] = ()


def scaled(model: DiscreteModel, a: float, b: float) -> DiscreteModel:
    """aR, bQd, and N between them, for factors not below 0: a covariance stays one, if no number is too large."""
    R = checks.array("R", np.where(np.isinf(model.R), model.R, a * np.where(np.isinf(model.R), 0.0, model.R)), finite=False)
    Qd = checks.array("Qd", b * model.Qd)
    return derived(model, R=R, Qd=Qd, N=None if model.N is None else np.sqrt(a * b) * model.N)


def scales(model: DiscreteModel, z: Array, first: int) -> list[Candidate]:
    """The most likely factors on R alone, on Qd alone and on both, as far as there is something to scale."""
    free = [
        name for name, M in (("R", np.where(np.isinf(model.R), 0.0, model.R)), ("Qd", model.Qd)) if np.asarray(M).any()
    ]
    here = log_likelihood(model, z[first:], first)
    found: list[Candidate] = []
    for names in [*([name] for name in free), *([free] if len(free) == 2 else [])]:
        best = {c.kind: max(c.size[0], 1e-3) for c in found} if len(names) == 2 else {}
        leading = max(found, key=lambda c: c.gain).kind if best else ""
        start = {name: best[name] if name == leading else 1.0 for name in names}

        def build(c: dict[str, float]) -> DiscreteModel:
            return scaled(model, c.get("R", 1.0), c.get("Qd", 1.0))

        bounds = {"R": (NOTHING, None), "Qd": (0.0, None)}  # R = 0 itself would take the filter's slow way
        own = {name: bounds[name] for name in names}
        factors, top = fitting.most_likely(build, z[first:], start, own, first)
        gain = max(2 * (top - here), 0.0)
        p = float(special.chdtrc(len(names), gain))
        size = tuple(factors.values())
        found.append(Candidate(" and ".join(names), 0, size, gain, p, 2.0 * len(names), build(factors), z))
    return found


def wandering(model: DiscreteModel, z: Array, first: int) -> list[Candidate]:
    """The most likely variance per step of each state to which Qd gives none.

    Where perfect measurements were known already there are none: with a variance, however small, they would be further data.
    """
    if (~kalman_filter(model, z[first:], first=first).used & np.isfinite(z) & np.isfinite(_variances(model))).any():
        return []
    still = np.flatnonzero(~np.diagonal(model.Qd, axis1=-2, axis2=-1).reshape(-1, model.n).any(axis=0))
    here, spread, found = log_likelihood(model, z[first:], first), _sizes(model, z, first)[0], []
    for j in still.tolist():
        unit = np.zeros((model.n, model.n))
        unit[j, j] = spread[j] ** 2

        def build(c: dict[str, float], unit: Array = unit) -> DiscreteModel:
            return derived(model, Qd=checks.array("Qd", model.Qd + c["q"] * unit))

        factor, top = fitting.most_likely(build, z[first:], {"q": 1 / len(z)}, {"q": (0.0, None)}, first)
        gain = max(2 * (top - here), 0.0)
        size = (factor["q"] * unit[j, j],)
        found.append(Candidate("wander", j, size, gain, float(special.chdtrc(1, gain)), 2.0, build(factor), z))
    return found


def started(model: DiscreteModel, z: Array, moved: StartShift | None) -> list[Candidate]:
    """The most likely initial estimate, where the record did not begin without information."""
    if moved is None or not moved.dof:
        return []
    p, changed = float(special.chdtrc(moved.dof, moved.gain)), replace(model, x0=model.x0 + moved.shift)
    return [Candidate("start", 0, tuple(moved.shift.tolist()), moved.gain, p, 2.0 * moved.dof, changed, z)]


def constants(model: DiscreteModel, z: Array, first: int) -> list[Candidate]:
    """The most likely constant input of each state and bias of each measurement; the likelihood is quadratic in them."""
    here, found = log_likelihood(model, z[first:], first), []
    spread, noise = _sizes(model, z, first)
    for kind, name, count, sizes in (("input", "offset", model.n, spread), ("bias", "measurement_offset", model.m, noise)):
        for i in range(count):
            unit = np.eye(count)[i]

            def changed(c: float, name: str = name, unit: Array = unit) -> DiscreteModel:
                own = getattr(model, name)
                change: dict[str, Any] = {name: c * unit + (0.0 if own is None else own)}
                return replace(model, **change)

            best = _quadratic(lambda c: log_likelihood(changed(c), z[first:], first), here, float(sizes[i]))
            if best is not None:
                c, gain = best
                p = float(special.chdtrc(1, gain))
                found.append(Candidate(kind, i, (c,), gain, p, 2.0, changed(c), z))
    return found


def beyond_scales(model: DiscreteModel, z: Array, first: int, scales: Sequence[Candidate]) -> list[Candidate]:
    """The constants, each with the p of what it gains beside the most likely factors on R and Qd.

    Where Qd is too small a wandering state looks as if it were driven: a constant has to be significant whatever the factors are. What
    both together gain is at least what it gains beside the factors, and at least what it gains alone.
    """
    found = constants(model, z, first)
    if not found or not scales:
        return found
    best = max(scales, key=lambda c: c.gain)
    beside = {(c.kind, c.place): c.gain for c in constants(best.model, z, first)}
    gains = [max(beside.get((c.kind, c.place), 0.0), c.gain - best.gain) for c in found]
    return [c._replace(p=float(special.chdtrc(1, max(gain, 0.0)))) for c, gain in zip(found, gains, strict=True)]


def _variances(model: DiscreteModel) -> Array:
    return np.asarray(np.diagonal(model.R, axis1=-2, axis2=-1))


def _sizes(model: DiscreteModel, z: Array, first: int) -> tuple[Array, Array]:
    """Usual standard deviations of the predicted states (n,) and of the innovations (m,)."""
    record = kalman_filter(model, z[first:], first=first)
    variances = np.diagonal(record.P_minus, axis1=1, axis2=2)
    known = np.isfinite(variances)
    spread = np.sqrt(np.where(known, variances, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1))
    S = np.diagonal(record.S, axis1=1, axis2=2)
    seen = np.isfinite(S)
    noise = np.sqrt(np.where(seen, S, 0.0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1))
    return np.where(spread > 0, spread, noise.max()), noise


def _quadratic(f: Callable[[float], float], here: float, c: float) -> tuple[float, float] | None:
    """Maximum and twice the gain of a quadratic function from its values at 0 and ±c; None where it is flat."""
    if c == 0 or not np.isfinite(c):
        return None
    for _again in range(2):
        up, down = f(c), f(-c)
        if not np.isfinite([up, here, down]).all():  # a constant that contradicts perfect measurements
            return None
        slope, bend = (up - down) / (2 * c), -(up - 2 * here + down) / c**2
        if not bend * c**2 > 1e-9 * abs(here):
            return None
        best, c = slope / bend, 1.0 / np.sqrt(bend)
    return float(best), float(slope**2 / bend)
