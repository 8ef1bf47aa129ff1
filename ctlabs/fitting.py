r"""Maximum likelihood for the constants of a model: estimates, their accuracy, and what the record says of each.

The innovations of the right model are independent and Gaussian, so that a record has the log-likelihood

.. math:: \ell(\theta) = -\tfrac12\sum_k\left(\nu_k^TS_k^{-1}\nu_k + \ln\det S_k + m_k\ln 2\pi\right)

After a start without information (``inf`` in P0) every measurement counts, one that determines something unknown by a term that
depends on the model alone (``log_likelihood_diffuse`` of :class:`ctlabs.forms.Filtered`). Its maximum is searched
in the logarithms of positive constants from several starts, and finished by Newton's method in the constants themselves
(:mod:`ctlabs.maximum`); the units of the constants do not matter.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ctlabs import _check, maximum, records
from ctlabs._check import Array
from ctlabs.maximum import Box, Profile, Top
from ctlabs.models import DiscreteModel
from ctlabs.text import _, fill

Build = Callable[[dict[str, float]], DiscreteModel]
Bounds = Mapping[str, tuple[float | None, float | None]]

#: An eigenvalue of the information, scaled to a unit diagonal, below which the record does not tell constants apart.
FLAT = 1e-6
#: Nearer to a bound than this part of its width a constant has no standard error.
NEAR = 1e-3


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
    whether no step promises more · ``observations``, elements measured · ``evaluations`` of ℓ · ``model`` with the
    estimates
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
        No constants; bounds that do not fit them; a start at which the likelihood cannot be evaluated.

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
    top = maximum.search(likelihood, box, starts)
    followed = []
    for _again in range(3):  # a profile that rises above the top has met a higher one: once more from there
        followed = [maximum.profile(likelihood, box, top, i) for i in range(len(names))] if profiles else []
        best = max((point for _interval, _profile, point in followed), key=likelihood, default=top.at)
        if likelihood(best) <= top.value + 1e-6:
            break
        top = maximum.finish(likelihood, box, best)
    covariance, reasons = _accuracy(names, box, top)
    model = build(_named(names, top.at))
    return Fit(
        estimates=_named(names, top.at),
        standard_errors={
            name: None if name in reasons else math.sqrt(covariance[i, i]) for i, name in enumerate(names)
        },
        covariance=covariance,
        intervals={name: interval for name, (interval, _profile, _point) in zip(names, followed, strict=False)},
        log_likelihood=top.value - likelihood.extra(top.at),
        log_likelihood_diffuse=top.value,
        start=_named(names, box.start),
        start_log_likelihood=likelihood(box.start) - likelihood.extra(box.start),
        profiles={name: found for name, (_interval, found, _point) in zip(names, followed, strict=False)},
        reasons=reasons,
        gradient=top.gradient,
        converged=top.converged,
        observations=likelihood.used,
        evaluations=likelihood.evaluations,
        model=model,
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
    likelihood.at_start(box.start)
    top = maximum.nearest(likelihood, box)
    return _named(names, top), likelihood(top)


class _Likelihood:
    """ℓ as a function of the constants' values, −∞ where they make no model; every value is computed once."""

    def __init__(self, build: Build, z: ArrayLike, names: tuple[str, ...], first: int) -> None:
        self.build, self.z, self.names, self.first = build, np.array(z, dtype=np.float64), names, first
        self.known: dict[bytes, float] = {}
        self.used = 0  # elements that enter the filter at the start

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

    def at_start(self, values: Array) -> None:
        """Refuse a start at which nothing can be computed, with the reason."""
        given = ", ".join(f"{name} = {value:g}" for name, value in _named(self.names, values).items())
        try:
            model = self.build(_named(self.names, values))
            self.used = int(records.filter_record(model, self.z, self.first).used.sum())
            value, why = self._value(values), "a log-likelihood that is not finite"
        except KeyError as error:
            value, why = math.nan, f"no value for {error}"
        except (ValueError, ArithmeticError) as error:
            value, why = math.nan, " ".join(str(error).split())
        if not math.isfinite(value):
            msg = f"start: expected constants at which the likelihood can be evaluated, received {given}: {why}"
            raise ValueError(msg)

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


def _accuracy(names: tuple[str, ...], box: Box, top: Top) -> tuple[Array, dict[str, str]]:
    """Covariance of the estimates, and why a constant has none."""
    reasons = {}
    for i, name in enumerate(names):
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
