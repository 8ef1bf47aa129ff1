r"""Does an ensemble agree with theory? Exact tests, at one false alarm in a hundred million experiments each.

For a Gaussian error e ~ N(b, P), whatever the number of runs,

.. math:: \frac{\bar e_i - b_i}{\sqrt{P_{ii}/\text{runs}}} \sim N(0,1), \quad
          \sum\frac{(e_i-b_i)^2}{P_{ii}} \sim \chi^2(\text{runs}), \quad
          \text{runs}\cdot\text{NEES} \sim \chi^2(\text{dof}\cdot\text{runs})

Each deviation is written as the normal quantile of its own exact probability, and the worst over all steps and states
is held against the quantile that makes a false alarm anywhere as rare as 10⁻⁸ (Bonferroni's bound; it holds however
the steps depend on one another), so that a report with up to a hundred tests fails by chance once in a million. A variance
that is zero in theory must be met to rounding.

A variance that is wrong by a few per cent at every step hides below such a bound at each of them, so all steps are also
taken together. Innovations of a right filter are independent in time, and the sum of all NIS is χ². Errors are not: with
their correlation Γ over the steps, which the filter's gains give,

.. math:: \sum_k\sum_{\text{runs}}\frac{(e_i-b_i)^2}{P_{ii}} \sim \sum_j\lambda_j(\Gamma)\,\chi^2_j(\text{runs})
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from ctlabs.filtering.results import Covariances
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel, at
from ctlabs.montecarlo.statistics import Statistics

#: Probability that a test of a correct theory fails, over all its steps and states.
FALSE_ALARM = 1e-8
#: A standard deviation below this fraction of the signal is rounding, for x̂ − x cannot be computed better.
ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Verdict:
    """Outcome of a test: the worst deviation as a normal quantile, its bound, and where it was found.

    ``where`` is (step, state) or (step,); ``tests`` counts the comparisons made. ``bool(verdict)`` is ``passed``.
    """

    value: float
    critical: float
    passed: bool
    where: tuple[int, ...]
    tests: int

    def __bool__(self) -> bool:
        return self.passed

    @property
    def p(self) -> float:
        """Probability that a correct theory deviates as much anywhere in the test, at most."""
        return adjusted(self.value, self.critical)

    def __str__(self) -> str:
        word = "agrees" if self.passed else "disagrees"
        return f"{word}: worst deviation {self.value:.2f} standard errors (allowed {self.critical:.2f}) of {self.tests} at {self.where}"


def bias(stats: Statistics, P: ArrayLike, expected: ArrayLike | None = None, when: str = "plus") -> Verdict:
    """Mean errors against ``expected`` (steps+1, d), zero by default, for an error covariance P (steps+1, d, d).

    ``when`` is ``"plus"`` (after the update) or ``"minus"``. A test fails by chance once in a million experiments.

    Source: Bar-Shalom, Li & Kirubarajan, *Estimation with Applications to Tracking and Navigation*, section 5.4.
    """
    mean, _, b, variance = _theory(stats, P, expected, when)
    return _verdict(*_scores(stats, mean - b, variance, lambda x, v: x / np.sqrt(v / stats.runs)))


def variance(stats: Statistics, P: ArrayLike, expected: ArrayLike | None = None, when: str = "plus") -> Verdict:
    """Mean squares of the error about the known mean ``expected`` against the diagonal of P (steps+1, d, d)."""
    mean, spread, b, theory = _theory(stats, P, expected, when)
    square = spread + (mean - b) ** 2

    def score(x: Array, v: Array) -> Array:
        return chi2_quantile(stats.runs * x**2 / v, np.full_like(v, stats.runs))

    return _verdict(*_scores(stats, np.sqrt(square), theory, score))


def mean_square(sample: ArrayLike, variance: ArrayLike) -> Verdict:
    """Mean squares over the runs (last axis of ``sample``) of zero-mean Gaussian quantities against their variances.

    For histories kept as arrays; ``variance`` has the shape of ``sample`` without its last axis. Where it is zero the
    sample must be zero to rounding, measured by the largest standard deviation.

    >>> errors = np.random.default_rng(1).standard_normal((3, 500))
    >>> bool(mean_square(errors, [1, 1, 1])), bool(mean_square(errors, [1, 1, 2]))
    (True, False)
    """
    x = checks.array("sample", sample)
    theory = checks.shaped("variance", variance, x.shape[:-1])
    runs, zero = x.shape[-1], theory == 0
    rounding = ROUNDING * (np.sqrt(theory.max(initial=0.0)) or 1.0)
    tests = int((~zero).sum())
    critical = _critical(max(tests, 1))
    ratio = runs * np.mean(x**2, axis=-1) / np.where(zero, 1.0, theory)
    known = np.abs(x).max(axis=-1) / rounding * critical
    scores = np.where(zero, known, chi2_quantile(np.where(zero, 1.0, ratio), np.full(theory.shape, runs)))
    return _verdict(scores, ~zero, critical)


def means(sample: ArrayLike, expected: ArrayLike, sd: ArrayLike) -> Verdict:
    """Means over the runs (last axis of ``sample``) of independent Gaussian quantities, N(``expected``, ``sd``²), which miss by σ/√runs.

    Where σ is zero they must be met to rounding.

    >>> draws = 3 + np.random.default_rng(1).standard_normal((2, 500))
    >>> bool(means(draws, [3, 3], [1, 1])), bool(means(draws, [3, 4], [1, 1]))
    (True, False)
    """
    x = checks.array("sample", sample)
    wanted, unit = (checks.shaped(name, each, x.shape[:-1]) for name, each in (("expected", expected), ("sd", sd)))
    size = np.where(unit > 0, unit / np.sqrt(x.shape[-1]), ROUNDING * np.maximum(np.abs(wanted), np.finfo(float).tiny))
    scores = (x.mean(axis=-1) - wanted) / size
    return _verdict(scores, np.ones(scores.shape), _critical(scores.size))


def average_of_squares(value: float, expected: float, sd: float, runs: int) -> Verdict:
    r"""An average over the runs of a positive quadratic form of Gaussian quantities, whose mean and standard deviation are known.

    Of all such forms with one variance a single :math:`\chi^2` has the longest upper tail (its cumulants of every order are the
    largest, and with them Chernoff's bound), and the normal distribution the longest lower one: far out, where a test fails, they
    bound the probability for any number of runs.

    >>> x = np.random.default_rng(1).standard_normal((500, 3))
    >>> cost = float((x**2 @ [5, 1, 0.1]).mean())
    >>> sd = (2 * (25 + 1 + 0.01) / 500) ** 0.5
    >>> average_of_squares(cost, 6.1, sd, 500).passed, average_of_squares(cost + 7 * sd, 6.1, sd, 500).passed
    (True, False)
    """
    apart = (value - expected) / sd
    above = float(chi2_quantile(runs + apart * np.sqrt(2 * runs), runs)) if apart > 0 else apart
    return _verdict(np.array([above]), np.ones(1), _critical(1))


def nees(stats: Statistics) -> Verdict:
    """The normalised estimation error squared against χ²(dof·runs) at every step (a matched, linear design)."""
    return _consistency(stats.nees, stats.nees_dof, stats.runs)


def nis(stats: Statistics) -> Verdict:
    """The normalised innovation squared against χ²(dof·runs) at every step with a measurement."""
    return _consistency(stats.nis, stats.nis_dof, stats.runs)


def pooled_nis(stats: Statistics) -> Verdict:
    """All normalised innovations squared together: Σ NIS ~ χ²(Σ dof·runs), as innovations are independent in time.

    A variance of the innovations that is wrong by 5 % at every step is found with 1000 runs of some 60 measurements.
    """
    counted = stats.nis_dof > 0
    if not counted.any():
        return Verdict(0.0, _critical(1), True, (0,), 0)
    total, dof = stats.runs * float(stats.nis[counted].sum()), stats.runs * float(stats.nis_dof[counted].sum())
    return _verdict(np.atleast_1d(chi2_quantile(total, dof)), np.ones(1), _critical(1))


def pooled_variance(stats: Statistics, P: ArrayLike, correlation: ArrayLike) -> Verdict:
    """Mean squares of the unbiased errors of each state against P (steps+1, d, d), all steps together.

    ``correlation`` (d, steps+1, steps+1) : of each state's error in time, as :func:`error_correlation` gives it. Steps at
    which the variance is zero are left out. The distribution is that of a weighted sum of χ², taken by the saddlepoint
    approximation of its tail (relative error some 1e-3 of the probability).

    Source: Barndorff-Nielsen, Biometrika 78 (1991), 483: r* = w + ln(u/w)/w.
    """
    mean, spread, b, theory = _theory(stats, P, None, "plus")
    Gamma = checks.shaped("correlation", correlation, (theory.shape[1], len(theory), len(theory)))
    square = spread + (mean - b) ** 2
    scores = np.zeros(theory.shape[1])
    for i, (own, variance) in enumerate(zip(square.T, theory.T, strict=True)):
        kept = variance > 0
        if kept.any():
            weights = np.linalg.eigvalsh(Gamma[i][np.ix_(kept, kept)]).clip(0)
            scores[i] = weighted_chi2_quantile(
                stats.runs * float((own[kept] / variance[kept]).sum()), weights[weights > 0], stats.runs
            )
    return _verdict(scores, np.ones(len(scores)), _critical(max(len(scores), 1)))


def total_square(sample: ArrayLike, covariance: ArrayLike) -> Verdict:
    r"""The sum of all squares of zero-mean Gaussian vectors, one for each run.

    .. math:: \sum_{\text{runs}}\sum_i y_i^2 \sim \sum_j\lambda_j(C)\,\chi^2_j(\text{runs})

    ``sample`` (d, runs) : of one run all that is counted, such as a signal at all instants · ``covariance`` C (d, d)

    >>> walk = np.random.default_rng(1).standard_normal((20, 1000)).cumsum(axis=0)
    >>> C = np.minimum(np.arange(1, 21)[:, None], np.arange(1, 21))
    >>> bool(total_square(walk, C)), bool(total_square(1.2 * walk, C))
    (True, False)
    """
    y = checks.array("sample", sample)
    weights = np.linalg.eigvalsh(checks.shaped("covariance", covariance, (len(y), len(y)))).clip(0)
    weights = weights[weights > np.finfo(float).eps * len(y) * weights.max(initial=0.0)]
    if not weights.size:
        return Verdict(0.0, _critical(1), not y.any(), (0,), 0)
    score = weighted_chi2_quantile(float((y**2).sum()), weights, y.shape[1])
    return _verdict(np.atleast_1d(score), np.ones(1), _critical(1))


def error_correlation(model: DiscreteModel, plan: Covariances, rows: ArrayLike | None = None) -> Array:
    r"""Correlation in time of the filtering errors of the optimal filter, (n, steps+1, steps+1), or of those at some ``rows`` only.

    .. math:: \mathrm{cov}(e_l^+, e_k^+) = A_l\cdots A_{k+1}P_k^+, \qquad A_k = (I-K_kH_k)\Phi_{k-1} \qquad (N = 0)

    Zero where a variance is zero.

    >>> from ctlabs import covariances
    >>> walk = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])
    >>> error_correlation(walk, covariances(walk, 2))[0].round(3)
    array([[1.   , 0.275, 0.111],
           [0.275, 1.   , 0.405],
           [0.111, 0.405, 1.   ]])
    """
    if model.N is not None:
        msg = "model: expected noises that do not correlate (N = 0), received N"
        raise ValueError(msg)
    wanted = np.arange(len(plan.t)) if rows is None else np.asarray(rows, dtype=np.intp)
    n, place = model.n, {int(k): i for i, k in enumerate(wanted)}
    C = np.zeros((n, len(wanted), len(wanted)))
    across = np.empty((0, n, n))
    for k in range(int(wanted[-1]) + 1):
        if k:
            closed = (np.eye(n) - plan.K[k] @ at(model.H, k, 2)) @ at(model.Phi, k - 1, 2)
            across = closed @ across
        if (i := place.get(k)) is not None:
            across = np.concatenate([across, plan.P_plus[k : k + 1]])
            C[:, i, : i + 1] = np.diagonal(across, axis1=1, axis2=2).T
    C = C + np.swapaxes(np.tril(C, -1), 1, 2)
    sd = np.sqrt(np.diagonal(plan.P_plus[wanted], axis1=1, axis2=2)).T
    size = sd[:, :, None] * sd[:, None, :]
    return np.divide(C, size, out=np.zeros_like(C), where=size > 0)


def weighted_chi2_quantile(x: float, weights: Array, dof: float) -> float:
    r"""The standard normal quantile with the same probability as :math:`\sum_j\lambda_j\chi^2_j(dof)` at x.

    >>> round(weighted_chi2_quantile(1100.0, np.ones(1), 1000), 4), float(chi2_quantile(1100.0, 1000).round(4))
    (2.1804, 2.1804)
    """
    from scipy.optimize import brentq

    ratio, half = x / (dof * float(weights.sum())), 0.5 * dof
    if abs(ratio - 1) < 1e-9:
        return 0.0
    pole = 0.5 / float(weights.max())
    scale = x / dof

    def slope(s: float) -> float:
        return float((weights / (1 - 2 * s * weights)).sum()) - scale

    low = -pole
    while slope(low) > 0:
        low *= 2
    s = brentq(slope, low, pole * (1 - 1e-12), xtol=1e-300, rtol=1e-14)
    left = 1 - 2 * s * weights
    exponent = s * x + half * float(np.log(left).sum())
    w = np.sign(s) * np.sqrt(max(2 * exponent, 0.0))
    u = s * np.sqrt(4 * half * float((weights**2 / left**2).sum()))
    return float(w + np.log(u / w) / w)


def adjusted(value: float, critical: float) -> float:
    """The p-value of a worst deviation whose bound is ``critical``, Bonferroni's factor included."""
    return float(min(1.0, np.exp(np.log(FALSE_ALARM) + special.log_ndtr(-abs(value)) - special.log_ndtr(-critical))))


def chi2_quantile(x: ArrayLike, dof: ArrayLike) -> Array:
    """The standard normal quantile with the same probability as χ²(dof) at x: finite for any x > 0, however extreme.

    >>> chi2_quantile([1.0, 1e4], 1.0).round(2)
    array([ 0.48, 99.99])
    """
    half, a = np.broadcast_arrays(0.5 * np.asarray(x, dtype=np.float64), 0.5 * np.asarray(dof, dtype=np.float64))
    upper = half > a
    with np.errstate(divide="ignore"):  # an underflow is replaced below
        log_tail = np.log(np.where(upper, special.gammaincc(a, half), special.gammainc(a, half)))
    extreme = (log_tail < -600) & (half > 0)
    if extreme.any():
        log_tail = np.array(log_tail)
        log_tail[extreme] = [_log_tail(float(s), float(y)) for s, y in zip(a[extreme], half[extreme], strict=True)]
    log_tail = np.maximum(log_tail, -1e300)
    return np.asarray(np.where(upper, -1.0, 1.0) * _ndtri_exp(log_tail))


def _ndtri_exp(log_p: Array) -> Array:
    """Φ⁻¹(exp(log_p)); for the very extreme by −√(−2 log p − log(2π(−2 log p)))."""
    safe = np.maximum(log_p, -1e15)
    return np.where(log_p < -1e15, -np.sqrt(-2 * log_p), special.ndtri_exp(safe))


def _log_tail(a: float, x: float) -> float:
    """log Q(a, x) for x > a by Legendre's continued fraction, log P(a, x) for x < a by its series."""
    front = a * np.log(x) - x - special.gammaln(a)
    if x < a:
        term = total = 1.0 / a
        n = a
        while term > 1e-17 * total:
            n += 1
            term *= x / n
            total += term
        return float(front + np.log(total))
    tiny = 1e-300
    b = x + 1 - a
    c, d = 1 / tiny, 1 / b
    h = d
    for i in range(1, 1_000_000):
        an = -i * (i - a)
        b += 2
        d = 1 / _away_from_zero(an * d + b, tiny)
        c = _away_from_zero(b + an / c, tiny)
        h *= d * c
        if abs(d * c - 1) < 1e-15:
            break
    return float(front + np.log(h))


def _away_from_zero(x: float, tiny: float) -> float:
    return x if abs(x) > tiny else tiny


def _theory(
    stats: Statistics, P: ArrayLike, expected: ArrayLike | None, when: str
) -> tuple[Array, Array, Array, Array]:
    """Ensemble mean and variance, theory's mean and variance, (steps+1, d) each."""
    if when not in ("plus", "minus"):
        msg = f"when: expected 'plus' or 'minus', received {when!r}"
        raise ValueError(msg)
    size, d = stats.bias.shape
    theory = np.diagonal(checks.shaped("P", P, (size, d, d)), axis1=1, axis2=2)
    b = np.zeros((size, d)) if expected is None else checks.shaped("expected", expected, (size, d))
    if when == "plus":
        return stats.bias, np.diagonal(stats.cov, axis1=1, axis2=2), b, theory
    return stats.bias_minus, stats.runs * stats.bias_minus_se**2, b, theory


def _scores(stats: Statistics, deviation: Array, variance: Array, score) -> tuple[Array, Array, float]:  # type: ignore[no-untyped-def]  # a small closure
    """Scores (steps+1, d); where the variance is zero the deviation as a share of the rounding allowed."""
    size = np.maximum(stats.signal_rms.max(axis=0), np.sqrt(variance.max(axis=0)))
    rounding = ROUNDING * np.where(size > 0, size, 1.0)
    zero = np.sqrt(variance.clip(0)) <= 1e-3 * rounding
    safe = np.where(zero, 1.0, variance)
    tests = int((~zero).sum())
    critical = _critical(max(tests, 1))
    scores = np.where(zero, np.abs(deviation) / rounding * critical, score(np.where(zero, 0.0, deviation), safe))
    return scores, np.where(zero, 0, 1), critical


def _critical(tests: int) -> float:
    return float(-special.ndtri(FALSE_ALARM / (2 * tests)))


def _verdict(scores: Array, counted: Array, critical: float) -> Verdict:
    place = np.unravel_index(int(np.argmax(np.abs(scores))), scores.shape)
    value = float(abs(scores[place]))
    return Verdict(value, critical, value <= critical, tuple(int(i) for i in place), int(np.sum(counted)))


def _consistency(average: Array, dof: Array, runs: int) -> Verdict:
    counted = dof > 0
    if not counted.any():
        return Verdict(0.0, _critical(1), True, (0,), 0)
    scores = np.zeros(len(dof))
    scores[counted] = chi2_quantile(runs * average[counted], runs * dof[counted])
    return _verdict(scores, counted, _critical(int(counted.sum())))
