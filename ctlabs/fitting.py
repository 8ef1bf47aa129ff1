r"""Maximum likelihood for the constants of a model: estimates, their accuracy, and what the record says of each.

The innovations of the right model are independent and Gaussian, so that a record has the log-likelihood

.. math:: \ell(\theta) = -\tfrac12\sum_k\left(\nu_k^TS_k^{-1}\nu_k + \ln\det S_k + m_k\ln 2\pi\right)

After a start without information (``inf`` in P0) every measurement counts, one that determines something unknown by a term that
depends on the model alone (``log_likelihood_diffuse`` of :class:`ctlabs.forms.Filtered`). Its maximum is searched
in the logarithms of positive constants from several starts, and finished by Newton's method in the constants themselves
(:mod:`ctlabs.maximum`); the units of the constants do not matter.

Where perfect measurements contradict the constants (:mod:`ctlabs.contradictions`), ℓ = −∞ has no slope: the sum of squares of
the contradicting innovations is lowered first, until none is left. Constants of which then no other value is possible are
determined exactly, and the likelihood is searched over the others.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ctlabs import _check, contradictions, maximum, records
from ctlabs._check import Array
from ctlabs.contradictions import Contradiction
from ctlabs.forms import Filtered
from ctlabs.maximum import Box, Profile, Top
from ctlabs.models import DiscreteModel
from ctlabs.text import _, fill, number

Build = Callable[[dict[str, float]], DiscreteModel]
Bounds = Mapping[str, tuple[float | None, float | None]]

#: An eigenvalue of the information, scaled to a unit diagonal, below which the record does not tell constants apart.
FLAT = 1e-6
#: Nearer to a bound than this part of its width a constant has no standard error.
NEAR = 1e-3
#: The part of a constant by which it is moved to see whether another value is possible.
ASIDE = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    r"""Constants of greatest likelihood.

    ``estimates`` · ``standard_errors``, from the observed information
    :math:`-\partial^2\ell/\partial\theta\partial\theta^T`; ``None`` with the reason in ``reasons`` (the other
    constants' are those given that one) · ``covariance`` (p, p) in the order of ``names``, NaN where there is no
    standard error · ``intervals``, 95 % by the likelihood ratio: all values whose profile lies less than 1.92 below the
    top; infinite where the record sets no limit, the bound where it is reached · ``profiles`` · ``log_likelihood`` of
    the estimates, ``start_log_likelihood`` of ``start`` · ``log_likelihood_diffuse`` of the estimates, which is what was
    maximised: another one than ``log_likelihood`` only where nothing is known of a state at the start ·
    ``gradient`` (p,) of ℓ at the estimates · ``converged``,
    whether no step promises more · ``observations``, elements that enter the filter at the start · ``evaluations`` of ℓ ·
    ``model`` with the estimates · ``contradictions`` of the record with it (ℓ = −∞, the estimates being those that make them
    least) · ``remark``, what became of those of the start, in words
    """

    estimates: dict[str, float]
    standard_errors: dict[str, float | None]
    covariance: Array
    intervals: dict[str, tuple[float, float]]
    log_likelihood: float
    log_likelihood_diffuse: float
    start: dict[str, float]
    start_log_likelihood: float
    profiles: dict[str, Profile]
    reasons: dict[str, str]
    gradient: Array
    converged: bool
    observations: int
    evaluations: int
    model: DiscreteModel
    contradictions: tuple[Contradiction, ...] = ()
    remark: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        """The constants, in the order of ``start``."""
        return tuple(self.estimates)

    @property
    def aic(self) -> float:
        """Akaike's criterion 2p − 2ℓ: smaller is better."""
        return 2 * len(self.estimates) - 2 * self.log_likelihood_diffuse


def fit(
    build: Build,
    z: ArrayLike,
    start: Mapping[str, float],
    bounds: Bounds | None = None,
    first: int = 1,
    profiles: bool = True,
    *,
    starts: int = 2,
) -> Fit:
    """Constants of greatest likelihood for one record.

    Parameters
    ----------
    build : from constants {name: value} to the discrete model; may raise ValueError where they make no model
    z : (steps+1, m), NaN = not measured
    start : where the search begins, {name: value}
    bounds : {name: (lower, upper)}, ``None`` for no bound; a constant with lower ≥ 0 and a positive start is searched
        by its logarithm, and may end on the bound
    first : 1 (first measurement at t1) or 0 (at t0)
    profiles : whether to follow the profile of each constant, and give its likelihood-ratio interval
    starts : how many more starts to climb from, the best of a reproducible choice around the first

    Raises
    ------
    ValueError
        No constants; bounds that do not fit them; a start at which the likelihood cannot be evaluated; no observations.

    Source: Durbin & Koopman, *Time Series Analysis by State Space Methods*, chapter 7; Pawitan, *In All Likelihood*,
    chapters 3 and 9 (profiles, likelihood-ratio intervals).

    >>> def scatter(c):  # independent errors about 0: the estimate is the mean square, its standard error r√(2/3)
    ...     return DiscreteModel([[0]], [[0]], [[1]], [[c["r"]]], x0=[0], P0=[[0]])
    >>> found = fit(scatter, [[np.nan], [1.0], [-2.0], [4.0]], {"r": 1.0}, {"r": (0, None)})
    >>> round(found.estimates["r"], 6), round(found.standard_errors["r"], 6)
    (7.0, 5.715476)
    """
    names, box = _box(start, bounds)
    likelihood = _Likelihood(build, z, names, first)
    likelihood.at_start(box.start)
    begin, remark = _possible(likelihood, box, starts)
    fixed = likelihood.determined(begin, box)
    top, followed = _searched(likelihood, Box(begin, box.lower, box.upper), fixed, profiles, starts)
    covariance, reasons = _accuracy(names, box, top, fixed)
    model = build(_named(names, top.at))
    left = likelihood.filtered(top.at).contradictions if top.value == -math.inf else ()
    return Fit(
        estimates=_named(names, top.at),
        standard_errors={
            name: None if name in reasons else math.sqrt(covariance[i, i]) for i, name in enumerate(names)
        },
        covariance=covariance,
        intervals={names[i]: interval for i, (interval, _profile, _point) in followed.items()}
        | {names[i]: (float(top.at[i]),) * 2 for i in np.flatnonzero(fixed)},
        log_likelihood=top.value - likelihood.extra(top.at),
        log_likelihood_diffuse=top.value,
        start=_named(names, box.start),
        start_log_likelihood=likelihood(box.start) - likelihood.extra(box.start),
        profiles={names[i]: found for i, (_interval, found, _point) in followed.items()},
        reasons=reasons,
        gradient=top.gradient,
        converged=top.converged,
        observations=likelihood.used,
        evaluations=likelihood.evaluations,
        model=model,
        contradictions=left,
        remark=remark,
    )


def most_likely(
    build: Build, z: ArrayLike, start: Mapping[str, float], bounds: Bounds | None = None, first: int = 1
) -> tuple[dict[str, float], float]:
    """Estimates and log-likelihood of the maximum next to the start, without their accuracy: a third of :func:`fit`'s work.

    Parameters and refusals are those of :func:`fit`.

    >>> def scatter(c):
    ...     return DiscreteModel([[0]], [[0]], [[1]], [[c["r"]]], x0=[0], P0=[[0]])
    >>> round(most_likely(scatter, [[np.nan], [1.0], [-2.0], [4.0]], {"r": 1.0}, {"r": (0, None)})[0]["r"], 2)
    7.0
    """
    names, box = _box(start, bounds)
    likelihood = _Likelihood(build, z, names, first)
    likelihood.at_start(box.start, possible=True)
    top = maximum.nearest(likelihood, box)
    return _named(names, top), likelihood(top)


class _Likelihood:
    """ℓ as a function of the constants' values, −∞ where they make no model; every value is computed once."""

    def __init__(self, build: Build, z: ArrayLike, names: tuple[str, ...], first: int) -> None:
        self.build, self.z, self.names, self.first = build, np.array(z, dtype=np.float64), names, first
        self.known: dict[bytes, float] = {}
        self.used = 0  # elements that enter the filter at the start
        size = np.sqrt(np.nanmean(np.where(np.isnan(self.z).all(axis=0), 0.0, self.z) ** 2, axis=0)) if self.z.size else 1.0
        self.size = np.where(size > 0, size, 1.0)  # of each measurement: their innovations are added up in these units

    @property
    def evaluations(self) -> int:
        return len(self.known)

    def __call__(self, values: Array) -> float:
        key = values.tobytes()
        if key not in self.known:
            try:
                self.known[key] = self._value(values)
            except (ValueError, ArithmeticError):
                self.known[key] = -math.inf
        return self.known[key]

    def extra(self, values: Array) -> float:
        """What the measurements that determine something unknown contribute."""
        model = self.build(_named(self.names, values))
        if np.isfinite(model.P0).all():
            return 0.0
        found = records.filter_record(model, self.z, self.first)
        return float(found.log_likelihood_diffuse - found.log_likelihood)

    def at_start(self, values: Array, *, possible: bool = False) -> None:
        """Refuse a record without measurements, and a start at which nothing can be computed (or ``possible``), with the reason."""
        given = ", ".join(f"{name} = {value:g}" for name, value in _named(self.names, values).items())
        excluded = False
        try:
            found = self.filtered(values)
            excluded, self.used = bool(found.contradictions), int(found.used.sum())
            value, why = self._value(values), "a log-likelihood that is not finite"
        except KeyError as error:
            value, why = math.nan, f"no value for {error}"
        except (ValueError, ArithmeticError) as error:
            value, why = math.nan, " ".join(str(error).split())
        if not (math.isfinite(value) or (excluded and not possible)):
            msg = f"start: expected constants at which the likelihood can be evaluated, received {given}: {why}"
            raise ValueError(msg)
        if not (self.used or self._seen(values, found)):
            msg = "no observations: expected a record with at least one element measured, received one without"
            raise ValueError(msg)

    def _seen(self, values: Array, found: Filtered) -> bool:
        """Whether something is measured, though known already."""
        return bool(contradictions.known(self.build(_named(self.names, values)), self.z, found.used, self.first).any())

    def filtered(self, values: Array) -> Filtered:
        """The record filtered with these values."""
        return records.filter_record(self.build(_named(self.names, values)), self.z, self.first)

    def residuals(self, values: Array) -> Array:
        """The innovations of what is known already, in units of their measurements; of what is not, 0."""
        model = self.build(_named(self.names, values))
        with np.errstate(all="ignore"):
            e, _allowed = contradictions.innovations(model, self.z, records.filter_record(model, self.z, self.first), self.first)
        return np.asarray(np.nan_to_num(e[:, :, 0] / self.size)).ravel()

    def determined(self, values: Array, box: Box) -> NDArray[np.bool_]:
        """Which constants have no other value beside this one that the record does not contradict."""
        return np.array([self._single(values, box, i) for i in range(len(values))])

    def _single(self, values: Array, box: Box, i: int) -> bool:
        """Whether both neighbours along axis i are impossible, and one is by a contradiction."""
        inside = [x for x in _beside(box, values) if x[i] != values[i]]
        if not np.isfinite(self(values)) or any(np.isfinite(self(x)) for x in inside):
            return False
        return any(self._contradicts(x) for x in inside)

    def _contradicts(self, values: Array) -> bool:
        try:
            return bool(self.filtered(values).contradictions)
        except (ValueError, ArithmeticError):
            return False

    def _value(self, values: Array) -> float:
        model = self.build(_named(self.names, values))
        with np.errstate(all="ignore"):  # far from the data anything may overflow; the result says so
            if np.diagonal(model.R, axis1=-2, axis2=-1).all():
                value = records.log_likelihood(model, self.z, self.first)
            else:  # the filter passes over perfect measurements of what it knows: densities of fewer elements do not compare
                found = records.filter_record(model, self.z, self.first)
                value = float(found.log_likelihood_diffuse) if found.used.sum() >= self.used else -math.inf
        return value if math.isfinite(value) else -math.inf


def _named(names: tuple[str, ...], values: Array) -> dict[str, float]:
    return {name: float(value) for name, value in zip(names, values, strict=True)}


def _box(start: Mapping[str, float], bounds: Bounds | None) -> tuple[tuple[str, ...], Box]:
    """The names and the box of the search, checked."""
    names, bounds = tuple(start), bounds or {}
    if not names:
        msg = "start: expected at least one constant, received none"
        raise ValueError(msg)
    strange = [name for name in bounds if name not in start]
    if strange:
        msg = f"bounds: expected names among {list(names)}, received {strange[0]!r}"
        raise ValueError(msg)
    values = _check.array("start", list(start.values()))
    pairs = [bounds.get(name, (None, None)) for name in names]
    lower = _check.array("bounds", [-np.inf if low is None else low for low, _high in pairs], finite=False)
    upper = _check.array("bounds", [np.inf if high is None else high for _low, high in pairs], finite=False)
    for name, low, value, high in zip(names, lower, values, upper, strict=True):
        if not low <= value <= high or low == high:
            msg = (
                f"bounds of {name}: expected lower < upper around the start, received ({low:g}, {high:g}) and {value:g}"
            )
            raise ValueError(msg)
    return names, Box(values, lower, upper)


def _possible(likelihood: _Likelihood, box: Box, starts: int) -> tuple[Array, str]:
    """The start, or where the sum of squares of its contradicting innovations is least; and what was done, in words."""
    if math.isfinite(likelihood(box.start)):
        return box.start, ""
    first = likelihood.filtered(box.start).contradictions[0]

    def rank(x: Array) -> tuple[float, float]:
        return likelihood(x), -_squares(likelihood, x)

    others = maximum.others(lambda x: -_squares(likelihood, x), box, box.size, max(starts, 1))
    best = max([box.start, *_beside(box, box.start), *others], key=rank)
    for x in [box.start, *others]:
        if math.isfinite(likelihood(best)):
            break
        best = max((best, _lowered(likelihood, box, x)), key=rank)
    if rank(best) <= (-math.inf, (ASIDE - 1) * _squares(likelihood, box.start)):  # lower by its rounding alone
        best = box.start
    said = fill(
        _(
            "At the start the record is impossible (row {row} of z, element {element}: {innovation} away from what is known "
            "exactly, of which rounding explains {allowed}), and its log-likelihood is −∞. The sum of squares of such "
            "innovations, in units of their measurements, was lowered from {before} to {after}"
        ),
        row=first.row, element=first.element, innovation=number(first.innovation), allowed=number(first.allowed, 2),
        before=number(_squares(likelihood, box.start), 3), after=number(_squares(likelihood, best), 3),
    )  # fmt: skip
    if math.isfinite(likelihood(best)):
        return best, said + _(", where the record is possible; the likelihood was searched from there.")
    return best, said + _(
        ", where the record is still impossible: no constants were found with which the model allows it. A measurement "
        "without noise has to agree in all its digits; where it does not, give it a variance."
    )


def _beside(box: Box, x: Array) -> list[Array]:
    """The points a little to either side along each axis, inside the box."""
    steps = [side * step for step in ASIDE * box.size * np.eye(len(x)) for side in (-1, 1)]
    return [x + step for step in steps if (box.lower <= x + step).all() and (x + step <= box.upper).all()]


def _squares(likelihood: _Likelihood, values: Array) -> float:
    """The sum of squares of the contradicting innovations; ∞ where there is no model."""
    try:
        e = likelihood.residuals(values)
    except (ValueError, ArithmeticError):
        return math.inf
    return float(e @ e)


def _lowered(likelihood: _Likelihood, box: Box, start: Array) -> Array:
    """The least sum of squares from a start on (Gauss & Newton, within the box)."""
    from scipy.optimize import least_squares

    if not math.isfinite(_squares(likelihood, start)):
        return start
    size = likelihood.residuals(start).size

    def residuals(x: Array) -> Array:
        try:
            return likelihood.residuals(x)
        except (ValueError, ArithmeticError):  # no model there: as bad as nothing else
            return np.full(size, 1e6)

    bounds, digits = (box.lower, box.upper), float(np.finfo(float).eps)
    with np.errstate(all="ignore"):  # where a noise appears the innovations vanish at once: no slope is right there
        found = least_squares(
            residuals, start, "3-point", bounds, xtol=digits, ftol=None, gtol=None, x_scale=box.size, max_nfev=100 * len(start)
        )
    return np.clip(found.x, *bounds)


def _searched(
    likelihood: _Likelihood, box: Box, fixed: NDArray[np.bool_], profiles: bool, starts: int
) -> tuple[Top, dict[int, tuple[tuple[float, float], Profile, Array]]]:
    """The maximum over the constants that are not ``fixed``, and their profiles by their places."""
    begin, free = box.start, np.flatnonzero(~fixed)

    def over(rest: Array) -> float:
        values = np.array(begin)
        values[free] = rest
        return likelihood(values)

    p, nan = len(begin), np.full(len(begin), np.nan)
    top = Top(begin, likelihood(begin), nan, np.full((p, p), np.nan), nan, np.zeros(p, dtype=bool), converged=False)
    if not math.isfinite(top.value):
        return top, {}
    if not free.size:
        return top._replace(converged=p == 1 or _separate(likelihood, box)), {}
    inner = Box(begin[free], box.lower[free], box.upper[free])
    found = maximum.search(over, inner, starts)
    followed: list[tuple[tuple[float, float], Profile, Array]] = []
    for _again in range(3):  # a profile that rises above the top has met a higher one: once more from there
        followed = [maximum.profile(over, inner, found, i) for i in range(len(free))] if profiles else []
        best = max((point for _interval, _profile, point in followed), key=over, default=found.at)
        if over(best) <= found.value + 1e-6:
            break
        found = maximum.finish(over, inner, best)
    at, gradient, width, inside = (np.array(a) for a in (begin, nan, nan, fixed))
    at[free], gradient[free], width[free], inside[free] = found.at, found.gradient, found.width, found.free
    hessian, inside[fixed] = np.full((p, p), np.nan), False
    hessian[np.ix_(free, free)] = found.hessian
    whole = Top(at, found.value, gradient, hessian, width, inside, found.converged)
    return whole, dict(zip(free.tolist(), followed, strict=False))


def _separate(likelihood: _Likelihood, box: Box) -> bool:
    """Whether the contradictions tell all constants apart, and not only combinations of them."""
    steps = ASIDE * box.size * np.eye(len(box.start))
    J = np.array([likelihood.residuals(box.start + step) for step in steps])
    J /= np.linalg.norm(J, axis=1, keepdims=True)
    return bool(np.linalg.svd(J, compute_uv=False)[-1] > ASIDE)


def _accuracy(
    names: tuple[str, ...], box: Box, top: Top, fixed: NDArray[np.bool_]
) -> tuple[Array, dict[str, str]]:
    """Covariance of the estimates, and why a constant has none."""
    reasons = {}
    if top.value == -math.inf:
        return np.full((len(names),) * 2, np.nan), dict.fromkeys(
            names, _("with these constants the record is impossible, and the likelihood −∞")
        )
    for i in np.flatnonzero(fixed).tolist():
        reasons[names[i]] = _("the record determines it exactly: other values beside it contradict perfect measurements")
    for i, name in enumerate(names):
        if fixed[i]:
            continue
        for bound in (float(box.lower[i]), float(box.upper[i])):
            if top.at[i] == bound:
                text = _("the likelihood is greatest on the bound {name} = {bound}, where there is no standard error")
                reasons[name] = fill(text, name=name, bound=bound)
            elif abs(top.at[i] - bound) <= NEAR * top.width[i]:
                text = _("the estimate lies too near to the bound {name} = {bound} for a standard error")
                reasons[name] = fill(text, name=name, bound=bound)
    inside = np.array([name not in reasons for name in names])
    covariance = np.full((len(names), len(names)), np.nan)
    A = -top.hessian[np.ix_(inside, inside)] * np.outer(top.width[inside], top.width[inside])
    if not np.isfinite(A).all():
        text = _("the likelihood has no second derivative at the estimate")
        return covariance, reasons | {name: text for name in names if name not in reasons}
    values, vectors = np.linalg.eigh(A)
    flat = values <= FLAT
    vague = np.zeros(len(names), dtype=bool)
    vague[inside] = (np.abs(vectors[:, flat]) > 0.1).any(axis=1)
    for name in np.array(names)[vague].tolist():
        text = _("the record does not determine it (the likelihood does not fall along {names})")
        reasons[name] = fill(text, names=", ".join(names[j] for j in np.flatnonzero(vague)))
    inverse = (vectors[:, ~flat] / values[~flat]) @ vectors[:, ~flat].T
    covariance[np.ix_(inside, inside)] = inverse * np.outer(top.width[inside], top.width[inside])
    covariance[vague], covariance[:, vague] = np.nan, np.nan
    return covariance, reasons
