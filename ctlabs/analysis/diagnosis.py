r"""Do the data speak against the model? Verdict on one record, and what to change.

Of the right model the innovations are independent, :math:`\nu_k \sim N(0, S_k)`. Three tests look at their size, their mean
and their independence; likelihood ratios say whether the covariances R and Qd are of the right size, and which constant
would be missing:

.. math:: \sum_k\nu_k^TS_k^{-1}\nu_k \sim \chi^2\Big(\sum_k m_k\Big), \quad
          \sqrt N\,\bar e \sim N(0,1), \quad
          N(N+2)\sum_{l=1}^{L}\frac{\hat\pi_l^2}{N-l} \approx \chi^2(L), \quad
          2\ln\frac{\max_{a,b}p(z; aR, bQ_d)}{p(z; R, Q_d)} \approx \chi^2(2)

with :math:`e_k = \nu_k/\sqrt{S_k}` of one measurement, N of them, and their partial autocorrelations
:math:`\hat\pi_l`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from ctlabs.analysis import fitting
from ctlabs.filtering.filter import kalman_filter, log_likelihood
from ctlabs.filtering.measured import begins
from ctlabs.filtering.results import Filtered, without_runs
from ctlabs.filtering.smoothing import belongs
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel
from ctlabs.text import _, fill, number

#: Lags of the whiteness test: one for every five innovations, at most this many.
LAGS = 10
#: Innovations of one measurement below which its independence is not tested.
FEWEST = 10
#: Rows of a record that a program does best to have diagnosed: what would make it more likely takes some hundred filters.
LONG = 100_000
#: The probability that any innovation of a record is so far from 0, below which it deserves a word.
IMPROBABLE = 1e-12
#: A factor on R so small that the record would be most likely without any noise.
NOTHING = 1e-9


class Candidate(NamedTuple):
    """One change of the model: what is scaled or added, by how much, and 2 ln of the likelihood ratio it gains.

    ``kind`` is "R", "Qd", "R and Qd", "input" (a constant added to a state every step) or "bias" (of a measurement) ·
    ``place`` of the state or measurement, 0 else · ``size``, factors or the constant · ``gain`` ·
    ``p``, the probability of so much gain from a right model · ``model``, changed, and ``shift`` (m,), to take off z
    """

    kind: str
    place: int
    size: tuple[float, ...]
    gain: float
    p: float
    model: DiscreteModel
    shift: Array


@dataclass(frozen=True, slots=True, eq=False)
class Diagnosis:
    """What the innovations of one record say of the model.

    ``nis_mean`` per instant with a measurement, its expectation ``nis_expected``, exact 95 % ``nis_band`` and two-sided
    ``nis_p`` · per measurement ``mean`` of the standardised innovations, ``mean_p``, ``whiteness_p`` (NaN: too few innovations)
    and their ``autocorrelation`` at ``lags``, of which 95 % lie within ± ``band`` if they are independent · ``factor_R``,
    ``factor_Q``, the factor on R alone and on Qd alone that makes the record most likely, ``factors`` for both together,
    ``None`` where there is nothing to scale ·
    ``tests``, every p-value the verdict rests on, of which a right model fails any with probability ``level`` at most ·
    ``verdict``: "consistent", "R", "Qd", "R and Qd", "input", "bias", "correlated", "other" or "contradiction" (the record is
    impossible for the model: no factor is given) · ``suggestion`` in words
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
) -> Diagnosis:
    """Test one filtered record against its model, and say what to change.

    A right model is suspected with probability ``level`` at most: the tests share it (Šidák). Where one fails, the change
    that makes the record most likely is taken (a factor on R, on Qd or on both, a constant input, a bias), and the changed
    model is tested again. Constants that were fitted to the same record make the tests milder.

    Parameters
    ----------
    model : the filter's model
    z : one record, (rows, m), NaN = not measured; or what :func:`ctlabs.kalman_filter` made of it with any algorithm
    first : 1 (first measurement at t1), 0 (at t0), or as the model says
    level : probability of a false alarm
    longest : of a longer record only its first so many rows are looked at; all if not given

    Raises
    ------
    ValueError
        Several runs; shapes that do not fit; nothing measured.

    Source: Bar-Shalom, Li & Kirubarajan, *Estimation with Applications to Tracking and Navigation*, section 5.4; Ljung & Box
    (1978), Biometrika 65.

    >>> rng = np.random.default_rng(2)
    >>> m = DiscreteModel([[0.5]], [[1]], [[1]], [[1]], x0=[0], P0=[[1]])
    >>> z = 3 * rng.normal(size=(200, 1))
    >>> diagnose(m, z).verdict
    'R'
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
    scales = [] if excluded else _scales(model, data, first)
    tests = p_values(model, own)
    if scales:
        tests[_("size of R and Qd")] = scales[-1].p
    suspicious = min(tests.values()) < _share(level, len(tests))
    verdict, words = ("consistent", _("nothing speaks against the model"))
    if excluded:
        text = _("{name} at row {row} contradicts what is known exactly: the record is impossible for this model")
        verdict, words = "contradiction", fill(text, name=model.measurements[excluded[0].element], row=excluded[0].row)
    elif suspicious:
        verdict, words = _explained(model, data, first, level, own, scales)
        words += _farthest(model, filtered, len(data), first)
    elif own.dof < FEWEST:
        words += fill(_(" (but so few innovations, {count}, could hardly do so)"), count=own.dof)
    alone = {c.kind: c.size for c in scales}
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
    )


# --- the tests -------------------------------------------------------------------------------------------------------


class Whiteness(NamedTuple):
    """Independence of one measurement's innovations.

    ``lags``, counted in innovations · ``r``, autocorrelations · ``partial`` ones · ``band``, within ± which 95 % of either
    lie for independent innovations · ``p`` of all lags together, NaN where the innovations are too few
    """

    lags: Array
    r: Array
    partial: Array
    band: Array
    p: float


def whiteness(e: ArrayLike, lags: int | None = None) -> Whiteness:
    r"""Ljung and Box's test in Monti's form, for standardised innovations whose mean is zero.

    .. math:: r_l = \frac{\sum_k e_ke_{k-l}}{\sum_k e_k^2}, \quad
              \sum_{l=1}^L\left[F^{-1}(\hat\pi_l)\right]^2 \approx \chi^2(L)

    The partial autocorrelations :math:`\hat\pi_l` of independent innovations are nearly independent, with
    :math:`\hat\pi_l^2` of a Beta distribution whose mean is (N−l)/N(N+2); F⁻¹ turns them into normal deviates. For 50
    innovations already the p-values are right to the tails, where those of Ljung and Box's sum are too small by a factor 5.
    Innovations on both sides of a gap are neighbours: independent ones stay so when some are left out.

    Parameters
    ----------
    e : (steps+1,), NaN where there is none
    lags : L, by default N/5, at most 10

    Source: Ljung & Box (1978), Biometrika 65; Monti (1994), Biometrika 81.

    >>> found = whiteness([1.0, -1.0] * 20)
    >>> found.r[:2], bool(found.p < 1e-6)
    (array([-0.975,  0.95 ]), True)
    """
    given = np.asarray(e, dtype=np.float64)
    x: Array = given[np.isfinite(given)]
    N, square = len(x), float(x @ x)
    if N < FEWEST or square == 0:
        nothing = np.zeros(0)
        return Whiteness(nothing, nothing, nothing, nothing, np.nan)
    wanted = min(LAGS, N // 5) if lags is None else min(checks.count("lags", lags), N - 1)
    at = np.arange(1, wanted + 1)
    r = np.array([x[lag:] @ x[:-lag] for lag in at.tolist()]) / square
    variance, partial = (N - at) / (N * (N + 2.0)), _partial(r)
    outside = special.betainc(0.5 / variance - 0.5, 0.5, np.maximum(1 - partial**2, 1e-300))
    scores = special.ndtri(0.5 * outside)
    band = np.sqrt(special.betaincinv(0.5, 0.5 / variance - 0.5, 0.95))
    return Whiteness(at, r, partial, band, float(special.chdtrc(wanted, (scores**2).sum())))


def _partial(r: Array) -> Array:
    """Partial autocorrelations by the recursion of Durbin and Levinson."""
    found, prediction, left = [], np.zeros(0), 1.0
    for k in range(len(r)):
        found.append((r[k] - prediction @ r[:k][::-1]) / left)
        prediction = np.append(prediction - found[k] * prediction[::-1], found[k])
        left *= 1 - found[k] ** 2
    return np.array(found)


class Innovations(NamedTuple):
    """Size, mean and independence of one record's innovations.

    ``dof``, how many innovations · ``nis_mean``, ``nis_expected`` and ``nis_band`` (of 95 %), per instant with a measurement,
    and the two-sided ``nis_p`` · per measurement ``mean`` of e_k and its ``mean_p`` (NaN: never measured), ``whiteness``
    """

    dof: int
    nis_mean: float
    nis_expected: float
    nis_band: tuple[float, float]
    nis_p: float
    mean: Array
    mean_p: Array
    whiteness: tuple[Whiteness, ...]

    @property
    def whiteness_p(self) -> Array:
        """The p-values of the whiteness, (m,)."""
        return np.array([w.p for w in self.whiteness])

    @property
    def lags(self) -> Array:
        """1, 2, … to the largest lag of any measurement, (L,)."""
        return np.arange(1, max(len(w.lags) for w in self.whiteness) + 1)

    @property
    def autocorrelation(self) -> Array:
        """Of every measurement at these lags, (m, L); NaN beyond its own."""
        return self._beside([w.r for w in self.whiteness])

    @property
    def band(self) -> Array:
        """Within ± which 95 % of those of independent innovations lie, (m, L)."""
        return self._beside([w.band for w in self.whiteness])

    def _beside(self, rows: Sequence[Array]) -> Array:
        length = len(self.lags)
        return np.array([np.append(row, np.full(length - len(row), np.nan)) for row in rows])


def innovations(innovation: ArrayLike, S: ArrayLike, nis: ArrayLike) -> Innovations:
    """Test the innovations of one record, as a filter returns them, without asking for another model.

    Parameters
    ----------
    innovation : ν (steps+1, m), NaN = not measured · S : (steps+1, m, m) · nis : νᵀS⁻¹ν (steps+1,), NaN = none

    Raises
    ------
    ValueError
        Nothing measured.

    Source: as for :func:`diagnose`.

    >>> m = DiscreteModel([[0.5]], [[1]], [[1]], [[1]], x0=[0], P0=[[1]])
    >>> run = kalman_filter(m, 3 * np.random.default_rng(2).normal(size=(200, 1)))
    >>> found = innovations(run.innovation, run.S, run.nis)
    >>> found.nis_mean > found.nis_band[1], found.nis_p < 1e-6
    (True, True)
    """
    given, squares = np.asarray(innovation, dtype=np.float64), np.asarray(nis, dtype=np.float64)
    there = np.isfinite(given)
    count, instants, total = there.sum(axis=0), int(there.any(axis=1).sum()), float(np.nansum(squares))
    if not instants:
        msg = "z: expected at least one measurement that enters the filter, received none"
        raise ValueError(msg)
    variance = np.diagonal(np.asarray(S), axis1=1, axis2=2)
    e = np.where(there, given / np.sqrt(np.where(there, variance, 1.0)), np.nan)
    dof = int(count.sum())
    low, high = (float(edge) / instants for edge in special.chdtri(dof, [0.975, 0.025]))
    tails = float(special.gammainc(0.5 * dof, 0.5 * total)), float(special.gammaincc(0.5 * dof, 0.5 * total))
    mean = np.where(count > 0, np.nansum(e, axis=0) / np.maximum(count, 1), np.nan)
    return Innovations(
        dof=dof,
        nis_mean=total / instants,
        nis_expected=dof / instants,
        nis_band=(low, high),
        nis_p=min(1.0, 2 * min(tails)),
        mean=mean,
        mean_p=special.erfc(np.abs(mean) * np.sqrt(0.5 * count)),
        whiteness=tuple(whiteness(column) for column in e.T),
    )


def p_values(model: DiscreteModel, own: Innovations) -> dict[str, float]:
    """The p-values on which a verdict rests."""
    p = {_("NIS"): own.nis_p}
    for name, by_mean, independent in zip(model.measurements, own.mean_p, own.whiteness, strict=True):
        if np.isfinite(by_mean):
            p[fill(_("mean of {name}"), name=name)] = float(by_mean)
        if np.isfinite(independent.p):
            p[fill(_("independence of {name}"), name=name)] = independent.p
    return p


def _record(filtered: Filtered, longest: int | None, first: int) -> tuple[DiscreteModel, Array, Innovations]:
    """The model, the record by instants and its innovations, cut to their first rows."""
    model, data, innovation = filtered.model, filtered.z, filtered.innovation
    if not isinstance(model, DiscreteModel) or data.ndim != 2:
        msg = f"z: expected one record of a linear model, (rows, m), received {type(model).__name__} and shape {data.shape}"
        raise ValueError(msg)
    rows = len(data) if longest is None else min(len(data), checks.count("longest", longest, least=2) + first)
    own = innovations(innovation[:rows], filtered.S[:rows], filtered.nis[:rows])
    return model.cut(rows - 1), data[:rows], own


def _share(level: float, tests: int) -> float:
    """The level of each of several tests together at ``level`` (exact for independent ones, else on the safe side)."""
    return float(-np.expm1(np.log1p(-level) / tests))


def _farthest(model: DiscreteModel, filtered: Filtered, rows: int, first: int) -> str:
    """A word on the innovation of most standard deviations, where chance all but excludes it."""
    innovation = np.asarray(filtered.innovation)[:rows].reshape(rows, model.m)
    variance = np.diagonal(np.asarray(filtered.S), axis1=1, axis2=2)[:rows]
    there = np.isfinite(innovation)
    e = np.abs(np.where(there, innovation, 0.0)) / np.sqrt(np.where(there, variance, 1.0))
    k, i = divmod(int(np.argmax(e)), model.m)
    if not there.sum() * special.erfc(e[k, i] / np.sqrt(2)) < IMPROBABLE:
        return ""
    text = _("; {name} at row {row} lies {size} standard deviations from its prediction, which chance all but excludes")
    return fill(text, name=model.measurements[i], row=k - first, size=_brief(float(e[k, i])))


# --- what would make the record more likely --------------------------------------------------------------------------


def scaled(model: DiscreteModel, a: float, b: float) -> DiscreteModel:
    """aR, bQd, and N between them."""
    R = np.where(np.isinf(model.R), model.R, a * np.where(np.isinf(model.R), 0.0, model.R))
    return replace(model, R=R, Qd=b * model.Qd, N=None if model.N is None else np.sqrt(a * b) * model.N)


def _scales(model: DiscreteModel, z: Array, first: int) -> list[Candidate]:
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
        found.append(Candidate(" and ".join(names), 0, size, gain, p, build(factors), np.zeros(model.m)))
    return found


def constants(model: DiscreteModel, z: Array, first: int) -> list[Candidate]:
    """The most likely constant input of each state and bias of each measurement; the likelihood is quadratic in them."""
    record = kalman_filter(model, z[first:], first=first)
    here, found = record.log_likelihood_diffuse, []
    variances = np.diagonal(record.P_minus, axis1=1, axis2=2)
    known = np.isfinite(variances)
    spread = np.sqrt(np.where(known, variances, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1))
    S = np.diagonal(record.S, axis1=1, axis2=2)
    seen = np.isfinite(S)
    noise = np.sqrt(np.where(seen, S, 0.0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1))
    spread = np.where(spread > 0, spread, noise.max())
    for kind, count, sizes in (("input", model.n, spread), ("bias", model.m, noise)):
        for i in range(count):
            unit = np.eye(count)[i]

            def changed(c: float, kind: str = kind, unit: Array = unit) -> tuple[DiscreteModel, Array]:
                if kind == "bias":
                    return model, c * unit
                return replace(model, offset=c * unit + (0.0 if model.offset is None else model.offset)), np.zeros(
                    model.m
                )

            best = _quadratic(lambda c: _shifted(*changed(c), z, first), here, float(sizes[i]))
            if best is not None:
                c, gain = best
                p = float(special.chdtrc(1, gain))
                found.append(Candidate(kind, i, (c,), gain, p, *changed(c)))
    return found


def _shifted(model: DiscreteModel, shift: Array, z: Array, first: int) -> float:
    return log_likelihood(model, (z - shift)[first:], first)


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


def _best(candidates: Sequence[Candidate], level: float) -> Candidate | None:
    """The smallest of Akaike's criterion; two factors only where one is significantly worse; None if none is significant."""
    found = [c for c in candidates if c.p < _share(level, len(candidates))]
    both = [c for c in found if len(c.size) == 2]
    single = [c for c in found if len(c.size) == 1]
    scales = [c for c in single if c.kind in ("R", "Qd")]
    if both and scales and special.chdtrc(1, both[0].gain - max(c.gain for c in scales)) > level:
        found = single
    return min(found, key=lambda c: 2 * len(c.size) - c.gain, default=None)


def _explained(
    model: DiscreteModel, z: Array, first: int, level: float, own: Innovations, scales: list[Candidate]
) -> tuple[str, str]:
    """Verdict and words where a test has failed: up to two changes, and what they leave unexplained."""
    changes: list[Candidate] = []
    words: list[str] = []
    left, tests = own, p_values(model, own)
    for again in range(2):
        candidates = [*(_scales(model, z, first) if again else scales), *constants(model, z, first)]
        best = _best(candidates, level)
        if best is None:
            break
        changes.append(best)
        words.append(_sentence(model, best, candidates))
        model, z = best.model, z - best.shift
        found = kalman_filter(model, z[first:], first=first)
        left = innovations(found.innovation, found.S, found.nis)
        tests = p_values(model, left)
        if min(tests.values()) >= _share(level, len(tests)):
            break
    share = _share(level, len(tests))
    if any(w.p < share for w in left.whiteness):
        if own.nis_p >= share:
            return "correlated", _(
                "the innovations are correlated although their size is right: a state or a coloured noise is missing"
            )
        if not changes:
            return "correlated", _("the innovations are correlated: a state or a coloured noise is missing")
        return "correlated", fill(
            _(
                "the innovations are correlated, also after the most likely change ({changes}): a state or a coloured noise is missing"
            ),
            changes="; ".join(words),
        )
    if not changes:
        worst = min(tests, key=lambda name: tests[name])
        return "other", fill(
            _("the record does not fit the model ({test}: p = {p}), and neither R, Qd nor a constant explains it"),
            test=worst,
            p=_brief(tests[worst]),
        )
    return max(changes, key=lambda c: c.gain).kind, "; ".join(words)


def _sentence(model: DiscreteModel, change: Candidate, candidates: Sequence[Candidate]) -> str:
    """A change in words, and another one that the record hardly tells from it."""
    text = _words(model, change)
    rivals = [c for c in candidates if c.kind != change.kind and len(c.size) == 1 == len(change.size)]
    rival = max(rivals, key=lambda c: c.gain, default=None)
    if rival is not None and rival.gain > change.gain - 4.0:
        text += fill(_(" (hardly to be told from: {other})"), other=_words(model, rival))
    return text


def _words(model: DiscreteModel, change: Candidate) -> str:
    if change.kind == "bias":
        name = model.measurements[change.place]
        return fill(
            _("{name} has a bias of about {size}, or a constant is missing in the model"),
            name=name,
            size=_brief(change.size[0]),
        )
    if change.kind == "input":
        name, unit = model.states[change.place], model.units[change.place]
        size = f"{_brief(change.size[0])} {unit}".strip()
        return fill(_("a drift is missing: a constant of about {size} enters {name} every step"), size=size, name=name)
    named = zip(change.kind.split(" and "), change.size, strict=True)
    return _(" and ").join(_factor(name, size) for name, size in named)


def _factor(name: str, factor: float) -> str:
    if factor < 1e-6:
        return fill(_("{name} too large (the record is most likely without it)"), name=name)
    text = _("{name} too small by about a factor {by}") if factor > 1 else _("{name} too large by about a factor {by}")
    return fill(text, name=name, by=_brief(max(factor, 1 / factor)))


def _brief(value: float) -> str:
    return number(value, 2)
