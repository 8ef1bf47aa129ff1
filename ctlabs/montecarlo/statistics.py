r"""What an experiment says: sums over runs turned into statistics with their standard errors and bands.

.. math:: \text{bias} = \overline{e}, \quad \text{rms}^2 = \overline{e^2}, \quad
          \text{cov} = \overline{(e-\bar e)(e-\bar e)^T}, \quad
          \text{NEES} = \overline{e^TP^+e}, \quad \text{NIS} = \overline{\nu^TS^{-1}\nu}

(averages over the runs, so that rms² = bias² + diag cov exactly). The NEES counts only directions in which the claimed
P has a variance, the NIS only the elements used; ``nees_dof`` and ``nis_dof`` are their expectations when the filter is
consistent. Bands are drawn around theory and are pictures; the checks are in :mod:`ctlabs.montecarlo.chance`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.montecarlo.histogram import Histogram
from ctlabs.montecarlo.sums import columns


@dataclass(frozen=True, slots=True, eq=False)
class Statistics:
    """Statistics of the error e = x̂ − E x over ``runs`` independent runs; index k = 0…steps throughout.

    ``t`` (steps+1,) s · ``bias``, ``rms`` (steps+1, d) after the update, ``bias_minus``, ``rms_minus`` before it ·
    ``cov`` (steps+1, d, d), about the mean, divided by the number of runs · ``nees``, ``nis`` (steps+1,), averages over
    runs, NaN where nothing is counted · ``nees_dof``, ``nis_dof`` (steps+1,), their expectations under consistency ·
    ``signal_rms`` (steps+1, d), of E x, what is estimated · ``…_se``, standard errors (from fourth moments for the
    rms, so that they hold for errors that are not Gaussian) · ``first``, index of the first measurement · ``histogram``
    of chosen errors, if asked for.
    """

    t: Array
    runs: int
    bias: Array
    bias_minus: Array
    rms: Array
    rms_minus: Array
    cov: Array
    nees: Array
    nis: Array
    nees_dof: Array
    nis_dof: Array
    signal_rms: Array
    bias_se: Array
    bias_minus_se: Array
    rms_se: Array
    rms_minus_se: Array
    cov_se: Array
    nees_se: Array
    nis_se: Array
    first: int = 1
    histogram: Histogram | None = None

    @property
    def steps(self) -> int:
        """Number of steps; the arrays have one entry more."""
        return len(self.t) - 1

    @property
    def sd(self) -> Array:
        """Standard deviation of the error about its mean, (steps+1, d)."""
        return np.sqrt(np.diagonal(self.cov, axis1=1, axis2=2))

    @property
    def second_moment(self) -> Array:
        """Average of e eᵀ, (steps+1, d, d): cov + bias biasᵀ."""
        return self.cov + self.bias[:, :, None] * self.bias[:, None, :]

    def nees_band(self, level: float = 0.95) -> tuple[Array, Array]:
        """Where the average NEES of a consistent filter lies with probability ``level`` at each step: χ²(dof·runs)/runs."""
        return _chi2_band(self.nees_dof, self.runs, level)

    def nis_band(self, level: float = 0.95) -> tuple[Array, Array]:
        """Where the average NIS of a consistent filter lies with probability ``level`` at each step."""
        return _chi2_band(self.nis_dof, self.runs, level)

    def rms_band(self, P: ArrayLike, level: float = 0.95) -> tuple[Array, Array]:
        """Where the rms lies with probability ``level`` if the error is N(0, P): √(P χ²(runs)/runs), (steps+1, d) each.

        ``P`` is (steps+1, d, d), the theory's covariance.
        """
        variance = np.diagonal(np.asarray(P, dtype=np.float64), axis1=1, axis2=2)
        low, high = _chi2_band(np.ones(1), self.runs, level)
        return np.sqrt(variance * low), np.sqrt(variance * high)

    def bias_band(self, P: ArrayLike, level: float = 0.95) -> tuple[Array, Array]:
        """Where the bias lies with probability ``level`` if the error is N(0, P), (steps+1, d) each."""
        from scipy.special import ndtri

        variance = np.diagonal(np.asarray(P, dtype=np.float64), axis1=1, axis2=2)
        half = ndtri(0.5 + 0.5 * _level(level)) * np.sqrt(variance / self.runs)
        return -half, half


@dataclass(frozen=True, slots=True)
class Claims:
    """What the sums alone do not say: the clock, the expected mean errors they were taken about, the dimensions counted."""

    t: Array
    first: int
    shift_minus: Array
    shift: Array
    nees_dof: Array
    nis_dof: Array


def from_sums(sums: Array, runs: int, claims: Claims, histogram: Histogram | None = None) -> Statistics:
    """The statistics of ``runs`` runs from the table of sums (its columns: :mod:`ctlabs.montecarlo.kernel`)."""
    d = claims.shift.shape[1]
    mean = sums / runs
    m1, m4 = mean[:, :d], mean[:, d : 2 * d]
    minus1, minus2, minus4 = (mean[:, i * d : (i + 1) * d] for i in (2, 3, 4))
    outer = np.empty((len(sums), d, d))
    rows, cols = np.tril_indices(d)
    outer[:, rows, cols] = outer[:, cols, rows] = mean[:, 6 * d + 4 : columns(d)]
    m2 = np.diagonal(outer, axis1=1, axis2=2)
    cov = outer - m1[:, :, None] * m1[:, None, :]
    variance = np.diagonal(cov, axis1=1, axis2=2).clip(0)
    cov[:, range(d), range(d)] = variance
    variance_minus = (minus2 - minus1**2).clip(0)
    bias, bias_minus = claims.shift + m1, claims.shift_minus + minus1
    rms, rms_minus = np.sqrt(variance + bias**2), np.sqrt(variance_minus + bias_minus**2)
    form, form2 = mean[:, 6 * d : 6 * d + 4 : 2], mean[:, 6 * d + 1 : 6 * d + 4 : 2]
    dof = np.stack([claims.nees_dof, claims.nis_dof], axis=1)
    consistency = np.where(dof > 0, form, np.nan)
    consistency_se = np.where(dof > 0, np.sqrt((form2 - form**2).clip(0) / runs), np.nan)
    return Statistics(
        t=claims.t,
        runs=runs,
        bias=bias,
        bias_minus=bias_minus,
        rms=rms,
        rms_minus=rms_minus,
        cov=cov,
        nees=consistency[:, 0],
        nis=consistency[:, 1],
        nees_dof=claims.nees_dof,
        nis_dof=claims.nis_dof,
        signal_rms=np.sqrt(mean[:, 5 * d : 6 * d]),
        bias_se=np.sqrt(variance / runs),
        bias_minus_se=np.sqrt(variance_minus / runs),
        rms_se=_rms_se(rms, claims.shift, m1, m2, m4, runs),
        rms_minus_se=_rms_se(rms_minus, claims.shift_minus, minus1, minus2, minus4, runs),
        cov_se=np.sqrt((variance[:, :, None] * variance[:, None, :] + cov**2) / runs),
        nees_se=consistency_se[:, 0],
        nis_se=consistency_se[:, 1],
        first=claims.first,
        histogram=histogram,
    )


def _rms_se(rms: Array, shift: Array, m1: Array, m2: Array, m4: Array, runs: int) -> Array:
    """Standard error of √(mean of e²), e = d + shift with symmetric d: half of that of the mean square, over the rms."""
    spread = m4 + 4 * shift**2 * m2 - (m2 + 2 * shift * m1) ** 2
    return 0.5 * np.sqrt(spread.clip(0) / runs) / np.where(rms > 0, rms, 1.0)


def _chi2_band(dof: Array, runs: int, level: float) -> tuple[Array, Array]:
    from scipy.special import gammaincinv

    tail = 0.5 * (1 - _level(level))
    shape = np.where(dof > 0, 0.5 * dof * runs, 1.0)
    low, high = (np.where(dof > 0, 2 * gammaincinv(shape, p) / runs, np.nan) for p in (tail, 1 - tail))
    return low, high


def _level(level: float) -> float:
    if not 0 < checks.positive("level", level) < 1:
        msg = f"level: expected a probability between 0 and 1, received {level!r}"
        raise ValueError(msg)
    return float(level)
