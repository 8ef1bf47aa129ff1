r"""How many points of a figure are outside their 95 % bands, and how many chance puts there.

One in twenty is expected. How far the share strays from that depends on how alike the points are: errors of neighbouring instants hardly
differ, so their RMS leave their bands together. With the correlation ρ in time of a Gaussian error, twice its squares summed over the runs
are a bivariate χ² (Kibble's) with the correlation ρ², of which the indicator g of a place outside the band has the covariance

.. math:: \mathrm{cov}(g_k, g_l) = \sum_{j\ge1} c_j^2\,\rho_{kl}^{2j}, \qquad c_j = \mathrm E\,g\,\psi_j, \quad
          \psi_j = L_j^{(\alpha-1)}\big/\sqrt{\tbinom{j+\alpha-1}{j}}, \quad \alpha = \text{runs}/2

with Laguerre's polynomials. The share has the mean and variance that follow, and the quantiles of a Beta distribution with these, but for
the probability of no point at all. Correlations between states are not counted: their shares are taken to go together, so that the band
is rather too wide.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from ctlabs.filtering.results import Covariances
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel
from ctlabs.montecarlo import chance
from ctlabs.montecarlo.statistics import Statistics

#: What a band leaves outside; terms of the series.
OUTSIDE, TERMS = 0.05, 200
#: Instants that are looked at, evenly spread: at most, and at least; and the products of numbers that their correlations may take.
INSTANTS, FEW, PATIENCE = 300, 20, 3e9


class Share(NamedTuple):
    """A share, and what chance makes of it.

    ``value``, how many of ``points`` are outside · ``low`` to ``high``, where it lies in 95 % of experiments of a right theory · ``p``,
    the probability that it is so far out or farther
    """

    value: float
    low: float
    high: float
    p: float
    points: int


def outside(stats: Statistics, model: DiscreteModel, plan: Covariances) -> Share | None:
    """The share of the RMS errors of the optimal filter, ``plan``, outside their bands; None where no error has a variance, and where
    the model is so large that their correlations would take longer than the runs.

    >>> from ctlabs import covariances, monte_carlo
    >>> walk = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])
    >>> found = outside(monte_carlo(walk, steps=100, runs=50, seed=1), walk, covariances(walk, 100))
    >>> found.low < found.value < found.high, found.p > 0.05, found.points
    (True, True, 101)
    """
    count = min(stats.steps + 1, INSTANTS, int(PATIENCE / (stats.steps * model.n**3)))
    if count < min(FEW, stats.steps + 1):
        return None
    rows = np.unique(np.linspace(0, stats.steps, count).round().astype(np.intp))
    P = np.diagonal(plan.P_plus[rows], axis1=1, axis2=2)
    low, high = (band[rows] for band in stats.rms_band(plan.P_plus))
    known = np.isfinite(P) & (high > low * (1 + 1e-9)) & (P > (1e-9 * stats.signal_rms.max(axis=0, initial=0.0)) ** 2)
    if not known.any():
        return None
    rms = stats.rms[rows]
    out = known & ((rms < low) | (rms > high))
    correlation = chance.error_correlation(model, plan, rows)
    sd = sum(_spread(correlation[i][np.ix_(there, there)], stats.runs) for i, there in enumerate(known.T) if there.any())
    return judged(int(out.sum()), int(known.sum()), float(sd / known.sum()))


def judged(out: int, points: int, sd: float) -> Share:
    """The share ``out`` / ``points``, whose standard deviation by chance is ``sd``, held against its Beta distribution.

    >>> share = judged(12, 100, 0.02)
    >>> round(share.low, 3), round(share.high, 3), round(share.p, 3)
    (0.019, 0.096, 0.01)
    """
    size = OUTSIDE * (1 - OUTSIDE) / sd**2 - 1  # a + b
    a, b = OUTSIDE * size, (1 - OUTSIDE) * size
    none = (1 - OUTSIDE) ** (size + 1)  # that no point at all is outside: as of so many independent ones, whose share varies as much
    low, high = (float(special.betaincinv(a, b, q)) for q in (0.025, 0.975))
    low = 0.0 if none > 0.025 else low
    below, above = (float(special.betainc(a, b, min(max(out + half, 0), points) / points)) for half in (0.5, -0.5))
    below = max(below, none)
    return Share(out / points, low, high, min(1.0, 2 * below, 2 * (1 - above)), points)


def covariance(r: Array, runs: int) -> Array:
    """Of the indicators of two mean squares over ``runs`` runs outside their 95 % bands, whose correlation is ``r``, from 0 to 1.

    >>> covariance(np.array([0.0, 1.0]), 100).round(6)
    array([0.    , 0.0475])
    """
    grid = 1 - np.linspace(1, 0, 1001) ** 2  # denser where the series bends, towards 1
    c2 = _coefficients(runs) ** 2
    values = np.polynomial.polynomial.polyval(grid, np.concatenate([[0.0], c2]))
    values = values + (OUTSIDE * (1 - OUTSIDE) - c2.sum()) * grid ** (TERMS + 1)
    return np.interp(r, grid, values)


def _spread(correlation: Array, runs: int) -> float:
    """The standard deviation of how many points are outside."""
    return float(np.sqrt(covariance(np.minimum(correlation**2, 1.0), runs).sum()))


def _coefficients(runs: int) -> NDArray[np.float64]:
    r"""c_1, c_2, …: since :math:`\int x^{\alpha-1}e^{-x}L_j^{(\alpha-1)} = x^\alpha e^{-x}L_{j-1}^{(\alpha)}/j`, by the recurrence of the
    polynomials, each divided by its norm.
    """
    alpha = 0.5 * runs
    x = special.gammaincinv(alpha, np.array([OUTSIDE / 2, 1 - OUTSIDE / 2]))
    front = np.exp(alpha * np.log(x) - x - special.gammaln(alpha))
    before, now, found = np.zeros(2), np.ones(2), np.empty(TERMS)
    for j in range(TERMS):
        found[j] = np.subtract(*(front * now)) / np.sqrt((j + 1) * alpha)
        up = np.sqrt((j + 1) * (j + 1 + alpha))
        before, now = now, ((2 * j + 1 + alpha - x) * now - np.sqrt(j * (j + alpha)) * before) / up
    return found
