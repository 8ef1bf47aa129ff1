r"""Maximum likelihood for the constants of a model: estimates, their accuracy, and what the record says of each.

The innovations of the right model are independent and Gaussian, so that a record has the log-likelihood

.. math:: \ell(\theta) = -\tfrac12\sum_k\left(\nu_k^TS_k^{-1}\nu_k + \ln\det S_k + m_k\ln 2\pi\right)

After a start without information (``inf`` in P0) every measurement counts, one that determines something unknown by a term that
depends on the model alone (``log_likelihood_diffuse`` of :class:`ctlabs.filtering.algorithms.Filtered`). Its maximum is searched
in the logarithms of positive constants from several starts, and finished by Newton's method in the constants themselves
(:mod:`ctlabs.analysis.maximum`); the units of the constants do not matter.

Where perfect measurements contradict the constants (:mod:`ctlabs.filtering.contradictions`), ℓ = −∞ has no slope: the sum of squares of
the contradicting innovations is lowered first, until none is left. Constants of which then no other value is possible are
determined exactly, and the likelihood is searched over the others.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ctlabs.analysis import maximum
from ctlabs.analysis.joint import Joint
from ctlabs.analysis.likelihood import Build, Likelihood, named, possible, separate
from ctlabs.analysis.maximum import Box, Profile, Top
from ctlabs.filtering.results import Contradiction
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel
from ctlabs.text import _, fill

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
    build: Build | Sequence[Build],
    z: ArrayLike | Sequence[ArrayLike],
    start: Mapping[str, float],
    bounds: Bounds | None = None,
    first: int | None = None,
    profiles: bool = True,
    *,
    starts: int = 2,
) -> Fit:
    """Constants of greatest likelihood for one record.

    Parameters
    ----------
    build : from constants {name: value} to the discrete model; may raise ValueError where they make no model. Of several
        records a list, one for each
    z : (rows, m), or (rows,) where m = 1; NaN = not measured. Of several records a list
    start : where the search begins, {name: value}
    bounds : {name: (lower, upper)}, ``None`` for no bound; a constant with lower ≥ 0 and a positive start is searched
        by its logarithm, and may end on the bound
    first : 1 (first measurement at t1), 0 (at t0), or as the model says
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
    >>> found = fit(scatter, [1.0, -2.0, 4.0], {"r": 1.0}, {"r": (0, None)})
    >>> round(found.estimates["r"], 6), round(found.standard_errors["r"], 6)
    (7.0, 5.715476)
    """
    names, box = _box(start, bounds)
    builds = [build] if callable(build) else list(build)
    likelihood = Likelihood(builds[0], z, names, first) if callable(build) else Joint(builds, list(z), names, first)  # type: ignore[arg-type]
    likelihood.at_start(box.start)
    begin, remark = possible(likelihood, box, starts)
    fixed = likelihood.determined(begin, box)
    top, followed = _searched(likelihood, Box(begin, box.lower, box.upper), fixed, profiles, starts)
    covariance, reasons = _accuracy(names, box, top, fixed)
    model = builds[0](named(names, top.at))
    left = likelihood.filtered(top.at).contradictions if top.value == -math.inf else ()
    return Fit(
        estimates=named(names, top.at),
        standard_errors={
            name: None if name in reasons else math.sqrt(covariance[i, i]) for i, name in enumerate(names)
        },
        covariance=covariance,
        intervals={names[i]: interval for i, (interval, _profile, _point) in followed.items()}
        | {names[i]: (float(top.at[i]),) * 2 for i in np.flatnonzero(fixed)},
        log_likelihood=top.value - likelihood.extra(top.at),
        log_likelihood_diffuse=top.value,
        start=named(names, box.start),
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
    build: Build, z: ArrayLike, start: Mapping[str, float], bounds: Bounds | None = None, first: int | None = None
) -> tuple[dict[str, float], float]:
    """Estimates and log-likelihood of the maximum next to the start, without their accuracy: a third of :func:`fit`'s work.

    Parameters and refusals are those of :func:`fit`.

    >>> def scatter(c):
    ...     return DiscreteModel([[0]], [[0]], [[1]], [[c["r"]]], x0=[0], P0=[[0]])
    >>> round(most_likely(scatter, [1.0, -2.0, 4.0], {"r": 1.0}, {"r": (0, None)})[0]["r"], 2)
    7.0
    """
    names, box = _box(start, bounds)
    likelihood = Likelihood(build, z, names, first)
    likelihood.at_start(box.start, possible=True)
    top = maximum.nearest(likelihood, box)
    return named(names, top), likelihood(top)


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
    values = checks.array("start", list(start.values()))
    pairs = [bounds.get(name, (None, None)) for name in names]
    lower = checks.array("bounds", [-np.inf if low is None else low for low, _high in pairs], finite=False)
    upper = checks.array("bounds", [np.inf if high is None else high for _low, high in pairs], finite=False)
    for name, low, value, high in zip(names, lower, values, upper, strict=True):
        if not low <= value <= high or low == high:
            msg = (
                f"bounds of {name}: expected lower < upper around the start, received ({low:g}, {high:g}) and {value:g}"
            )
            raise ValueError(msg)
    return names, Box(values, lower, upper)


def _searched(
    likelihood: Likelihood, box: Box, fixed: NDArray[np.bool_], profiles: bool, starts: int
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
        return top._replace(converged=p == 1 or separate(likelihood, box)), {}
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
