r"""Size, mean and independence of the innovations of one record, as a filter returns them.

.. math:: \sum_k\nu_k^TS_k^{-1}\nu_k \sim \chi^2\Big(\sum_k m_k\Big), \quad \sqrt N\,\bar e \sim N(0,1), \quad
          N(N+2)\sum_{l=1}^{L}\frac{\hat\pi_l^2}{N-l} \approx \chi^2(L)

with :math:`e_k = \nu_k/\sqrt{S_k}` of one measurement, N of them, and their partial autocorrelations :math:`\hat\pi_l`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from ctlabs.analysis.diagnosis.independence import Whiteness, whiteness
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel
from ctlabs.text import _, fill


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
    >>> from ctlabs import kalman_filter
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
    mean = np.where(count > 0, np.nansum(e, axis=0) / np.maximum(count, 1), np.nan)
    return Innovations(
        dof=dof,
        nis_mean=total / instants,
        nis_expected=dof / instants,
        nis_band=(low, high),
        nis_p=chi2_p(total, dof),
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


def chi2_p(total: float, dof: int) -> float:
    """The two-sided probability that χ²(dof) is as far out as ``total``.

    >>> round(chi2_p(3.841, 1), 3), chi2_p(0.0, 1)
    (0.1, 0.0)
    """
    tails = special.gammainc(0.5 * dof, 0.5 * total), special.gammaincc(0.5 * dof, 0.5 * total)
    return min(1.0, 2 * float(min(tails)))


def share(level: float, tests: int) -> float:
    """The level of each of several tests together at ``level`` (exact for independent ones, else on the safe side)."""
    return float(-np.expm1(np.log1p(-level) / tests))
