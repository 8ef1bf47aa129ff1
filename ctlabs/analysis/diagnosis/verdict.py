r"""Do the data speak against the model? Verdict on one record, and what to change.

Of the right model the innovations are independent, :math:`\nu_k \sim N(0, S_k)`. Their size, mean and independence are tested
(:mod:`~ctlabs.analysis.diagnosis.consistency`), every single row (:mod:`~ctlabs.analysis.diagnosis.rows`), runs of equal values
(:mod:`~ctlabs.analysis.diagnosis.repeats`), the initial estimate, and by a likelihood ratio the size of R and Qd
(:mod:`~ctlabs.analysis.diagnosis.candidates`). Where one fails, the change that explains most is named: rows before the model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from ctlabs.analysis.diagnosis.candidates import Candidate, Event, beyond_scales, scales, started, wandering
from ctlabs.analysis.diagnosis.consistency import Innovations, innovations, p_values, share
from ctlabs.analysis.diagnosis.independence import FEWEST
from ctlabs.analysis.diagnosis.repeats import repeated, stuck
from ctlabs.analysis.diagnosis.rows import greatest, singled_out
from ctlabs.analysis.diagnosis.wording import FIRST, Where, brief, by_number, sentence, shown
from ctlabs.filtering.disturbances import Shocks, shocks
from ctlabs.filtering.filter import kalman_filter
from ctlabs.filtering.measured import begins
from ctlabs.filtering.results import Filtered, without_runs
from ctlabs.filtering.smoothing import belongs
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel
from ctlabs.text import _, fill

#: Rows of a record that a program does best to have diagnosed: what would make it more likely takes some hundred filters.
LONG = 100_000
#: The probability that any innovation of a record is so far from 0, below which it deserves a word.
IMPROBABLE = 1e-12
#: Changes that are put together to explain a record.
CHANGES = 3


@dataclass(frozen=True, slots=True, eq=False)
class Diagnosis:
    """What the innovations of one record say of the model.

    ``nis_mean`` per instant with a measurement, its expectation ``nis_expected``, exact 95 % ``nis_band`` and two-sided
    ``nis_p`` · per measurement ``mean`` of the standardised innovations, ``mean_p``, ``whiteness_p`` (NaN: too few innovations)
    and their ``autocorrelation`` at ``lags``, of which 95 % lie within ± ``band`` if they are independent · ``factor_R``,
    ``factor_Q``, the factor on R alone and on Qd alone that makes the record most likely, ``factors`` for both together,
    ``None`` where there is nothing to scale ·
    ``events``, what happened at single rows: outliers, breaks, runs of equal values ·
    ``tests``, every p-value the verdict rests on, of which a right model fails any with probability ``level`` at most ·
    ``verdict``: "consistent", "outlier", "break", "stuck", "start" (the initial estimate), "R", "Qd", "R and Qd", "input", "bias",
    "correlated", "other" or "contradiction" (the record is impossible for the model: no factor is given) · ``suggestion`` in words
    """

    nis_mean: float
    nis_expected: float
    nis_band: tuple[float, float]
    nis_p: float
    mean: Array
    mean_p: Array
    whiteness_p: Array
    lags: Array
    autocorrelation: tuple[Array, ...]
    band: tuple[Array, ...]
    factor_R: float | None
    factor_Q: float | None
    factors: tuple[float, float] | None
    tests: dict[str, float]
    level: float
    verdict: str
    suggestion: str
    events: tuple[Event, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether nothing speaks against the model."""
        return self.verdict == "consistent"


def diagnose(
    model: DiscreteModel,
    z: ArrayLike | Filtered,
    *,
    first: int | None = None,
    level: float = 0.01,
    longest: int | None = None,
    where: Where = by_number,
) -> Diagnosis:
    """Test one filtered record against its model, and say what to change.

    A right model is suspected with probability ``level`` at most: the tests share it (Šidák). Where one fails, the change
    that makes the record most likely is taken (rows that are exceptions, another initial estimate, a factor on R, on Qd or on both, a
    constant input, a bias), and what is changed is tested again. Constants that were fitted to the same record make the tests
    milder.

    Parameters
    ----------
    model : the filter's model
    z : one record, (rows, m), NaN = not measured; or what :func:`ctlabs.kalman_filter` made of it with any algorithm
    first : 1 (first measurement at t1), 0 (at t0), or as the model says
    level : probability of a false alarm
    longest : of a longer record only its first so many rows are looked at; all if not given
    where : how row i (of z, from 0) is called in words; "row i" if not given

    Raises
    ------
    ValueError
        Several runs; shapes that do not fit; nothing measured.

    Source: Bar-Shalom, Li & Kirubarajan, *Estimation with Applications to Tracking and Navigation*, section 5.4; Ljung & Box
    (1978), Biometrika 65; Harvey & Koopman (1992), J. Bus. Econ. Stat. 10.

    >>> rng = np.random.default_rng(2)
    >>> m = DiscreteModel([[0.5]], [[1]], [[1]], [[1]], x0=[0], P0=[[1]])
    >>> diagnose(m, 3 * rng.normal(size=(200, 1))).verdict
    'R'
    >>> z = rng.normal(size=(200, 1))
    >>> z[100] = 20
    >>> diagnose(m, z).suggestion.partition(",")[0]
    'z1 = 20 in row 100 is an outlier'
    """
    first = begins(model, first)
    if isinstance(z, Filtered):
        belongs(model, z)
        filtered = without_runs(z) if z.z.ndim == 3 and z.z.shape[2] == 1 else z
    else:
        filtered = kalman_filter(model, z, first=first)
    model, data, own = _record(filtered, longest, first)
    if not 0 < level < 1:
        msg = f"level: expected a probability between 0 and 1, received {level!r}"
        raise ValueError(msg)
    excluded = [c for c in filtered.contradictions if c.row + first < len(data)]
    factors: list[Candidate] = []
    tests = p_values(model, own)
    events: tuple[Event, ...] = ()
    verdict, words = ("consistent", _("nothing speaks against the model"))
    if excluded:
        row, name = excluded[0].row, model.measurements[excluded[0].element]
        value = float(data[row + first, excluded[0].element])
        text = _("{name} = {value} in {row} contradicts what is known exactly, {known}: the record is impossible for this model")
        known = shown(value - excluded[0].innovation)
        verdict, words = "contradiction", fill(text, name=name, value=shown(value), row=where(row), known=known)
    else:
        whole = filtered if len(filtered.z) == len(data) else kalman_filter(model, data[first:], first=first)
        case = _case(model, whole, first)
        factors = scales(model, data, first)
        tests = case.tests
        if factors:
            tests[_("size of R and Qd")] = factors[-1].p
        if min(tests.values()) < share(level, len(tests)):
            verdict, words, events = _explained(case, level, factors, where)
            words += "" if events or verdict == "start" else _farthest(model, filtered, len(data), first, where)
        elif own.dof < FEWEST:
            words += fill(_(" (but so few innovations, {count}, could hardly do so)"), count=own.dof)
    alone = {c.kind: c.size for c in factors}
    return Diagnosis(
        nis_mean=own.nis_mean,
        nis_expected=own.nis_expected,
        nis_band=own.nis_band,
        nis_p=own.nis_p,
        mean=own.mean,
        mean_p=own.mean_p,
        whiteness_p=own.whiteness_p,
        lags=own.lags,
        autocorrelation=tuple(own.autocorrelation),
        band=tuple(own.band),
        factor_R=alone["R"][0] if "R" in alone else None,
        factor_Q=alone["Qd"][0] if "Qd" in alone else None,
        factors=(alone["R and Qd"][0], alone["R and Qd"][1]) if "R and Qd" in alone else None,
        tests=tests,
        level=level,
        verdict=verdict,
        suggestion=words,
        events=events,
    )


class _Case(NamedTuple):
    """A model and a record, by instants, and what its innovations, its single rows and its equal values say."""

    model: DiscreteModel
    z: Array
    first: int
    own: Innovations
    shocks: Shocks
    repeats: list[Event]

    @property
    def tests(self) -> dict[str, float]:
        """The p-values on which the verdict rests."""
        p, place, start = p_values(self.model, self.own), greatest(self.shocks), self.shocks.start
        if place is not None:
            p[_("single rows")] = place.p
        if start is not None and start.dof:
            p[_("initial estimate")] = float(special.chdtrc(start.dof, start.gain))
        if self.repeats:
            p[_("equal values")] = min(event.p for event in self.repeats)
        return p


def _case(model: DiscreteModel, found: Filtered, first: int) -> _Case:
    own = innovations(found.innovation, found.S, found.nis)
    return _Case(model, found.asked[1], first, own, shocks(found), repeated(found, first))


def tests_of(model: DiscreteModel, filtered: Filtered, first: int) -> dict[str, float]:
    """The p-values of one filtered record on which a verdict rests, but that of the size of R and Qd."""
    return _case(model, filtered, first).tests


def _record(filtered: Filtered, longest: int | None, first: int) -> tuple[DiscreteModel, Array, Innovations]:
    """The model, the record by instants as it was given, and its innovations, cut to their first rows."""
    if not isinstance(filtered.model, DiscreteModel) or filtered.z.ndim != 2:
        msg = f"z: expected one record of a linear model, (rows, m), received {type(filtered.model).__name__} and shape {filtered.z.shape}"
        raise ValueError(msg)
    (model, data), innovation = filtered.asked, filtered.innovation
    rows = len(data) if longest is None else min(len(data), checks.count("longest", longest, least=2) + first)
    own = innovations(innovation[:rows], filtered.S[:rows], filtered.nis[:rows])
    return model.cut(rows - 1), data[:rows], own


def _farthest(model: DiscreteModel, filtered: Filtered, rows: int, first: int, where: Where) -> str:
    """A word on the innovation of most standard deviations, where chance all but excludes it."""
    innovation = np.asarray(filtered.innovation)[:rows].reshape(rows, model.m)
    variance = np.diagonal(np.asarray(filtered.S), axis1=1, axis2=2)[:rows]
    there = np.isfinite(innovation)
    e = np.abs(np.where(there, innovation, 0.0)) / np.sqrt(np.where(there, variance, 1.0))
    k, i = divmod(int(np.argmax(e)), model.m)
    if not there.sum() * special.erfc(e[k, i] / np.sqrt(2)) < IMPROBABLE:
        return ""
    text = _("; {name} at {row} lies {size} standard deviations from its prediction, which chance all but excludes")
    return fill(text, name=model.measurements[i], row=where(k - first), size=brief(float(e[k, i])))


def _candidates(case: _Case, level: float, factors: list[Candidate]) -> list[Candidate]:
    """All changes that are to be compared, or the runs of equal values alone, which no other change explains."""
    model, z, first = case.model, case.z, case.first
    runs = [event for event in case.repeats if event.p < level]
    if runs and factors:  # also where R and Qd are such that the record is most likely
        other = repeated(kalman_filter(factors[-1].model, z[first:], first=first), first)
        also = {(event.place, event.rows) for event in other if event.p < level}
        runs = [event for event in runs if (event.place, event.rows) in also]
    if (found := stuck(model, z, runs, first)) is not None:
        return [found]
    rows = singled_out(model, z, first, level)
    return [
        *([] if rows is None else [rows]),
        *started(model, z, case.shocks.start),
        *factors,
        *wandering(model, z, first),
        *beyond_scales(model, z, first, factors),
    ]


def _best(candidates: Sequence[Candidate], level: float) -> Candidate | None:
    """The smallest of Akaike's criterion; two factors only where one is significantly worse; None if none is significant."""
    found = [c for c in candidates if c.p < share(level, len(candidates))]
    both = [c for c in found if c.kind == "R and Qd"]
    single = [c for c in found if c.kind != "R and Qd"]
    alone = [c for c in single if c.kind in ("R", "Qd")]
    if both and alone and special.chdtrc(1, both[0].gain - max(c.gain for c in alone)) > level:
        found = single
    return min(found, key=lambda c: c.cost - c.gain, default=None)


def _explained(
    case: _Case, level: float, factors: list[Candidate], where: Where
) -> tuple[str, str, tuple[Event, ...]]:
    """Verdict, words and events where a test has failed: a few changes, and what they leave unexplained."""
    own, changes, words = case.own, list[Candidate](), list[tuple[bool, str]]()
    tests = case.tests
    while len(changes) < CHANGES:
        factors = scales(case.model, case.z, case.first) if changes else factors
        candidates = _candidates(case, share(level, len(tests)), factors)
        best = _best(candidates, level)
        if best is None:
            break
        changes.append(best)
        rivals = [c for c in candidates if c.p < share(level, len(candidates))]
        words.append((best.kind not in FIRST, sentence(case.model, best, rivals, where)))
        case = _case(best.model, kalman_filter(best.model, best.z[case.first :], first=case.first), case.first)
        tests = case.tests
        if min(tests.values()) >= share(level, len(tests)):
            break
    told = "; ".join(text for _later, text in sorted(words, key=lambda pair: pair[0]))
    events = tuple(event for change in changes for event in change.events)
    part = share(level, len(tests))
    if any(w.p < part for w in case.own.whiteness):
        if not changes:
            if own.nis_p >= part:
                told = _("the innovations are correlated although their size is right: a state or a coloured noise is missing")
            else:
                told = _("the innovations are correlated: a state or a coloured noise is missing")
            return "correlated", told, events
        text = _(
            "the innovations are correlated, also after the most likely change ({changes}): a state or a coloured noise is missing"
        )
        return "correlated", fill(text, changes=told), events
    if not changes:
        worst = min(tests, key=lambda name: tests[name])
        text = _("the record does not fit the model ({test}: p = {p}), and neither single rows, R, Qd nor a constant explains it")
        return "other", fill(text, test=worst, p=brief(tests[worst])), events
    kind = max(changes, key=lambda c: c.gain).kind
    return "Qd" if kind == "wander" else kind, told, events
