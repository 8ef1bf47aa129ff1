r"""Maximum likelihood for the constants of a model: estimates, their accuracy, and what the record says of each.

The innovations of the right model are independent and Gaussian, so that a record has the log-likelihood

.. math:: \ell(\theta) = -\tfrac12\sum_k\left(\nu_k^TS_k^{-1}\nu_k + \ln\det S_k + m_k\ln 2\pi\right)

After a start without information (``inf`` in P0) every measurement counts, one that determines something unknown by a term that
depends on the model alone (``log_likelihood_diffuse`` of :class:`ctlabs.filtering.Filtered`). Its maximum is searched
with its exact derivatives (:mod:`ctlabs.analysis.score`), in the logarithms of positive constants (:mod:`ctlabs.analysis.maximum`);
the units of the constants do not matter. Of a constant that enters by its square alone, or by its sine and cosine, one value of all
that no record tells apart is searched (:mod:`ctlabs.analysis.symmetry`).

Where perfect measurements contradict the constants (:mod:`ctlabs.filtering.contradictions`), ℓ = −∞ has no slope: the sum of squares of
the contradicting innovations is lowered first, until none is left. Constants of which then no other value is possible are
determined exactly, and the likelihood is searched over the others.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ctlabs.analysis import maximum
from ctlabs.analysis.likelihood import Build, Likelihood, named, pieces, possible, separate
from ctlabs.analysis.maximum import Profile, Top
from ctlabs.analysis.surface import Box, Surface, moved
from ctlabs.analysis.symmetry import folded, principal
from ctlabs.filtering.results import Contradiction
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.linalg.threads import one_thread
from ctlabs.models import DiscreteModel
from ctlabs.text import _, fill

Bounds = Mapping[str, tuple[float | None, float | None]]

#: An eigenvalue of the information, scaled to a unit diagonal, below which the record does not tell constants apart.
FLAT = 1e-6
#: A slope, for a change by a standard deviation, beside which a direction is not flat.
RISING = 1e-2
#: Nearer to a bound than this part of its width a constant has no standard error.
NEAR = 1e-3


class Progress(NamedTuple):
    """How far a fit is: ``stage``, in words · ``done`` likelihoods of about ``expected`` · ``best`` log-likelihood so far · ``seconds``."""

    stage: str
    done: int
    expected: int
    best: float
    seconds: float

    @property
    def left(self) -> float:
        """About so many seconds are left."""
        return self.seconds * (self.expected - self.done) / max(self.done, 1)


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
    least) · ``remark``, what became of those of the start, and what else is worth knowing, in words · ``models``, of every record, with
    the estimates · ``interrupted``, whether Ctrl-C ended the search
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
    models: tuple[DiscreteModel, ...] = ()
    interrupted: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """The constants, in the order of ``start``."""
        return tuple(self.estimates)

    @property
    def correlation(self) -> Array | None:
        """Of the estimates, (p, p); None for one constant, and where one has no standard error."""
        sd = np.sqrt(np.diag(self.covariance))
        return self.covariance / np.outer(sd, sd) if len(sd) > 1 and np.isfinite(sd).all() and (sd > 0).all() else None

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
    starts: int = 0,
    progress: Callable[[Progress], object] | None = None,
) -> Fit:
    """Constants of greatest likelihood for one record, or for several records of the same constants.

    Parameters
    ----------
    build : from constants {name: value} to the discrete model; may raise ValueError where they make no model. Of several
        records a list, one for each
    z : (rows, m), or (rows,) where m = 1; NaN = not measured. Of several records a list
    start : where the search begins, {name: value}
    bounds : {name: (lower, upper)}, ``None`` for no bound; a constant with lower ≥ 0 is searched by its logarithm, and may end
        on the bound
    first : 1 (first measurement at t1), 0 (at t0), or as the model says
    profiles : whether to follow the profile of each constant, and give its likelihood-ratio interval
    starts : how many more starts to climb from, the best of a reproducible choice around the first
    progress : called after each likelihood. Ctrl-C ends the search with the best that was found

    Raises
    ------
    ValueError
        No constants; bounds that do not fit them; a start at which the likelihood cannot be evaluated; data of a wrong shape; no
        observations.

    Source: Durbin & Koopman, *Time Series Analysis by State Space Methods*, chapter 7; Pawitan, *In All Likelihood*,
    chapters 3 and 9 (profiles, likelihood-ratio intervals).

    >>> def scatter(c):  # independent errors about 0: the estimate is the mean square, its standard error r√(2/3)
    ...     return DiscreteModel([[0]], [[0]], [[1]], [[c["r"]]], x0=[0], P0=[[0]])
    >>> found = fit(scatter, [1.0, -2.0, 4.0], {"r": 1.0}, {"r": (0, None)})
    >>> round(found.estimates["r"], 6), round(found.standard_errors["r"], 6)
    (7.0, 5.715476)
    """
    names, given = _box(start, bounds)
    watch = None if progress is None else _Watch(progress, len(names), starts, profiles)
    likelihood = Likelihood(pieces(build, z, first), names, given, watch)
    likelihood.at_start(given.start)
    way = _Search(likelihood, given, watch)
    try:
        with one_thread():  # its matrices are small: threads that wait for each other cost more than they save
            way.run(starts, profiles)
    except KeyboardInterrupt:
        way.stop()
    top, fixed, followed = way.top, way.fixed, way.followed
    covariance, reasons = _accuracy(names, way.box, top, fixed, way.stopped)
    models = tuple(piece.build(named(names, top.at)) for piece in likelihood.records)
    left = likelihood.contradictions(top.at) if top.value == -math.inf else ()
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
        start=named(names, given.start),
        start_log_likelihood=likelihood(given.start) - likelihood.extra(given.start),
        profiles={names[i]: found for i, (_interval, found, _point) in followed.items()},
        reasons=reasons,
        gradient=top.gradient,
        converged=top.converged,
        observations=sum(likelihood.used),
        evaluations=likelihood.evaluations,
        model=models[0],
        contradictions=left,
        remark=way.remark,
        models=models,
        interrupted=way.stopped,
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
    likelihood = Likelihood(pieces(build, z, first), names, box)
    likelihood.at_start(box.start, possible=True)
    top = maximum.nearest(likelihood, box, likelihood.score)
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


class _Search:
    """A fit on its way: what is known of the maximum when it ends, or is stopped."""

    def __init__(self, likelihood: Likelihood, box: Box, watch: _Watch | None) -> None:
        self.likelihood, self.box, self.watch = likelihood, box, watch
        p = len(box.start)
        self.fixed = np.zeros(p, dtype=bool)
        self.remark, self.stopped = "", False
        self.followed: dict[int, tuple[tuple[float, float], Profile, Array]] = {}
        self.top = self._unknown(box.start)
        self.turns: dict[int, float] = {}

    def run(self, starts: int, profiles: bool) -> None:
        """Search; then profiles, from a higher top if they meet one."""
        begin, self.remark = possible(self.likelihood, self.box, starts)
        self.fixed = self.likelihood.determined(begin, self.box)
        self.box = Box(begin, self.box.lower, self.box.upper)
        self.top = self._unknown(begin)
        if not math.isfinite(self.top.value):
            return
        if self.fixed.all():
            self.top = self.top._replace(converged=len(begin) == 1 or separate(self.likelihood, self.box))
            return
        self._fold()
        f, inner, slope = self._free()
        surface = Surface(f, inner, slope)
        climbed = maximum.best(surface, starts)
        nothing = np.full(len(climbed.at), np.nan)
        bends = np.full((len(climbed.at),) * 2, np.nan)
        self._found(Top(climbed.at, climbed.value, nothing, bends, nothing, np.zeros(len(climbed.at), dtype=bool), converged=False))
        self._says("accuracy")
        top = maximum.finished(surface, climbed)
        self._found(top)
        for _again in range(3):  # a profile that rises above the top has met a higher one: once more from there
            higher = self._follow(top) if profiles else None
            if higher is None:
                break
            f, inner, slope = self._free()
            top = maximum.finish(f, inner, higher, slope)
            self._found(top)
        if self.likelihood.inexact:
            text = _("Where the likelihood has no exact derivative (perfect measurements of what is known), differences took its place.")
            self._remark(text)

    def stop(self) -> None:
        """Ctrl-C: the best so far."""
        self.stopped = True
        if self.likelihood.top > self.top.value + 1e-6:
            self.top = self._unknown(self.likelihood.best)
        self._remark(
            fill(
                _("The search was interrupted after {count} likelihoods: these are the best constants until then."),
                count=self.likelihood.evaluations,
            )
        )

    def _remark(self, text: str) -> None:
        self.remark = f"{self.remark} {text}".strip()

    def _says(self, stage: str) -> None:
        if self.watch is not None:
            self.watch.stage = stage

    def _unknown(self, at: Array) -> Top:
        """A point of which only the likelihood is known."""
        p, nan = len(at), np.full(len(at), np.nan)
        return Top(at, self.likelihood(at), nan, np.full((p, p), np.nan), nan, np.zeros(p, dtype=bool), converged=False)

    def _fold(self) -> None:
        """Signs and turns that no record tells."""
        found = folded(self.likelihood, self.likelihood.matrices, self.box)
        own = [i for i in found.signs if not self.fixed[i]]
        self.box, self.turns = found.box, {i: turn for i, turn in found.turns.items() if not self.fixed[i]}
        changed = [self.likelihood.names[i] for i in own if self.likelihood.box.start[i] < 0]
        if changed:
            text = _("The likelihood is the same for both signs of {names}, and the positive one is given.")
            self._remark(fill(text, names=", ".join(changed)))

    def _free(self) -> tuple[Callable[[Array], float], Box, Callable[[Array], Array | None]]:
        """The likelihood and its score over the constants that are not fixed."""
        free, box = np.flatnonzero(~self.fixed), self.box

        def whole(rest: Array) -> Array:
            values = np.array(box.start)
            values[free] = rest
            return values

        def slope(rest: Array) -> Array | None:
            found = self.likelihood.score(whole(rest))
            return None if found is None else found[free]

        inner = Box(box.start[free], box.lower[free], box.upper[free])
        return lambda rest: self.likelihood(whole(rest)), inner, slope

    def _found(self, top: Top) -> None:
        """A top over the free constants as one over all; angles within their turn."""
        free, p = np.flatnonzero(~self.fixed), len(self.fixed)
        at, gradient, width, inside = (np.array(a) for a in (self.box.start, np.full(p, np.nan), np.full(p, np.nan), self.fixed))
        at[free], gradient[free], width[free], inside[free] = top.at, top.gradient, top.width, top.free
        for i, turn in self.turns.items():
            at[i] = principal(at[i], turn, self.box.lower[i], self.box.upper[i])
        hessian, inside[self.fixed] = np.full((p, p), np.nan), False
        hessian[np.ix_(free, free)] = top.hessian
        self.top = Top(at, top.value, gradient, hessian, width, inside, top.converged)

    def _follow(self, top: Top) -> Array | None:
        """The profiles of the free constants; the highest point that they met, if it is above the top."""
        f, inner, slope = self._free()
        free = np.flatnonzero(~self.fixed)
        top = top._replace(at=self.top.at[free])
        for j, i in enumerate(free.tolist()):
            self._says(fill(_("profile of {name}"), name=self.likelihood.names[i]))
            box = inner
            if i in self.turns:  # half a turn either way
                half = 0.5 * self.turns[i]
                low, high = moved(box.lower, j, top.at[j] - half), moved(box.upper, j, top.at[j] + half)
                ends = np.maximum(box.lower, low), np.minimum(box.upper, high)
                box = Box(box.start, *ends)
            self.followed[i] = maximum.profile(f, box, top, j, slope)
            best = self.followed[i][2]
            if f(best) > top.value + 1e-6:
                return best
        return None


class _Watch:
    """Tells how far a fit is."""

    def __init__(self, tell: Callable[[Progress], object], p: int, starts: int, profiles: bool) -> None:
        self.tell, self.stage, self.begun = tell, "search", perf_counter()
        self.later = 4 * p + (24 * p if profiles else 0)
        self.search = (12 + 8 * p) * (1 + starts) + 8 * starts * (p + 1)
        self.before: dict[str, int] = {}

    def __call__(self, likelihood: Likelihood) -> None:
        done = likelihood.evaluations
        self.before.setdefault(self.stage, done)
        searched = done if self.stage == "search" else self.before.get("accuracy", done)
        expected = max(searched, self.search if self.stage == "search" else 0) + self.later
        self.tell(Progress(self.stage, done, max(expected, done), likelihood.top, perf_counter() - self.begun))


def _accuracy(
    names: tuple[str, ...], box: Box, top: Top, fixed: NDArray[np.bool_], stopped: bool = False
) -> tuple[Array, dict[str, str]]:
    """Covariance of the estimates, and why a constant has none."""
    reasons = {}
    if stopped and np.isnan(top.hessian).all():
        return np.full((len(names),) * 2, np.nan), dict.fromkeys(names, _("the search was interrupted before its end"))
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
    rising = vectors[:, flat].T @ (top.gradient * top.width)[inside]
    for name in np.array(names)[vague].tolist():
        text = _("the record does not determine it (the likelihood does not fall along {names})")
        if (np.abs(rising) > RISING).any():
            text = _("the likelihood still rises along {names} where the search ended")
        reasons[name] = fill(text, names=", ".join(names[j] for j in np.flatnonzero(vague)))
    inverse = (vectors[:, ~flat] / values[~flat]) @ vectors[:, ~flat].T
    covariance[np.ix_(inside, inside)] = inverse * np.outer(top.width[inside], top.width[inside])
    covariance[vague], covariance[:, vague] = np.nan, np.nan
    return covariance, reasons
