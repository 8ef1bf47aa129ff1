"""A bank of filters, one of which is right all the time, and the probability of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.filtering.filter import kalman_filter
from ctlabs.filtering.measured import begins
from ctlabs.filtering.problem import rows_of
from ctlabs.filtering.results import Filtered, consistency
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel


@dataclass(frozen=True, slots=True, eq=False)
class Hypotheses:
    """How probable each model is, given the measurements up to k.

    ``t`` (steps+1,) s · ``probability`` (steps+1, models, runs) · ``log_likelihood`` (steps+1, models, runs), of all
    measurements up to k · ``filters``, one :class:`~ctlabs.filtering.results.Filtered` for each model
    """

    t: Array
    probability: Array
    log_likelihood: Array
    filters: tuple[Filtered, ...]

    def mixture(self, compare: Sequence[ArrayLike]) -> tuple[Array, Array]:
        """Mean (steps+1, d, runs) and covariance (steps+1, d, d, runs) of what ``compare`` (d, n_i) selects of each state.

        The covariance adds the spread of the estimates about their common mean to the filters' own.
        """
        selected = [np.asarray(C, dtype=np.float64) for C in compare]
        means = [C @ one.x_plus for C, one in zip(selected, self.filters, strict=True)]
        own = [C @ one.P_plus @ C.T for C, one in zip(selected, self.filters, strict=True)]
        weights = [self.probability[:, i, None, :] for i in range(len(self.filters))]
        mean = sum((w * x for w, x in zip(weights, means, strict=True)), np.zeros_like(means[0]))
        cov = np.zeros((*own[0].shape, mean.shape[-1]))
        for w, x, P in zip(weights, means, own, strict=True):
            e = x - mean
            cov += w[:, None] * (P[..., None] + e[:, :, None] * e[:, None])
        return mean, cov


def hypotheses(
    models: Sequence[DiscreteModel], z: ArrayLike, prior: ArrayLike | None = None, first: int | None = None
) -> Hypotheses:
    r"""A bank of filters, one of which is right all the time, and the probability of each.

    .. math:: p_i(k) \propto p_i(0)\prod_{j\le k} N(\nu_j^{(i)}; 0, S_j^{(i)})

    in logarithms, so that a model that looked hopeless can recover. (filterpy's ``MMAEFilterBank`` is not used: it
    multiplies likelihoods, which underflow, gives one H to all filters, and sums P over states instead of filters.)

    Parameters
    ----------
    models : discrete models of the same measurements, of any orders
    z : (rows, m[, runs]), measurements; NaN = none
    prior : probabilities before any measurement, equal by default

    Raises
    ------
    ValueError
        Fewer than two models; probabilities that are negative or do not add up to 1; models that measure different things; a
        record that contradicts them all (:mod:`ctlabs.filtering.contradictions`).

    Source: Magill, "Optimal adaptive estimation of sampled stochastic processes", *IEEE Trans. AC-10* (1965).

    >>> still = DiscreteModel([[1]], [[0]], [[1]], [[1]], x0=[0], P0=[[1]])
    >>> other = DiscreteModel([[1]], [[0]], [[1]], [[1]], x0=[5], P0=[[1]])
    >>> hypotheses([still, other], [[4.0], [6.0]]).probability[:, :, 0].round(3)
    array([[0.5  , 0.5  ],
           [0.023, 0.977],
           [0.   , 1.   ]])
    """
    if len(models) < 2:
        msg = f"models: expected two or more, received {len(models)}"
        raise ValueError(msg)
    p = np.full(len(models), 1 / len(models)) if prior is None else checks.shaped("prior", prior, (len(models),))
    if (p < 0).any() or abs(p.sum() - 1) > 1e-9:
        msg = f"prior: expected probabilities that add up to 1, received {p.tolist()}"
        raise ValueError(msg)
    first = begins(models[0], first)
    filters = tuple(kalman_filter(one, rows_of(z, one.m)[0], first=first) for one in models)
    if any(not np.array_equal(one.used, filters[0].used) for one in filters):
        msg = "models: expected the same elements measured by all, received models that use different ones"
        raise ValueError(msg)
    log = np.stack([np.cumsum(_log_likelihoods(one, first), axis=0) for one in filters], axis=1)
    with np.errstate(divide="ignore"):  # a probability of 0 stays 0
        score = log + np.log(p)[:, None]
    best = score.max(axis=1, keepdims=True)
    if np.isneginf(best).any():
        k = int(np.argwhere(np.isneginf(best))[0, 0]) - first
        msg = f"z: expected a record that is possible for one of the models, received one that contradicts all by row {k}"
        raise ValueError(msg)
    weight = np.exp(score - best)
    return Hypotheses(filters[0].t, weight / weight.sum(axis=1, keepdims=True), log, filters)


def _log_likelihoods(one: Filtered, first: int) -> Array:
    """log N(ν; 0, S) of every step and run, (steps+1, runs); 0 where nothing is measured."""
    found = np.zeros((len(one.t), one.z.shape[2]))
    found += consistency(one.innovation, one.S, one.used & ~np.isnan(one.innovation).all(axis=2))[1]
    for each in one.contradictions:  # impossible for this model from there on
        found[each.row + first, each.run] = -np.inf
    return found
