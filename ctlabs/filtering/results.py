"""What a filter gives: its covariances, which no data change, and the estimates of a record."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import deviations

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Covariances:
    """What a filter does, whatever the data: its covariances and gains, at the instants k = 0 … steps.

    ``t`` (steps+1,) s · ``P_minus``, ``P_plus`` (steps+1, n, n), covariance of the error given the measurements
    before k and up to k · ``K`` (steps+1, n, m), the gain · ``S`` (steps+1, m, m), covariance of the innovation ·
    ``used`` (steps+1, m), whether the element enters the update. Where it does not (absent, or a perfect
    measurement of something known) K = 0 and S = inf on the diagonal · ``algorithm``, the form that was used.

    A state of which nothing is known (``inf`` in P0) has the variance ``inf``, with zeros beside it.
    """

    t: Array
    P_minus: Array
    P_plus: Array
    K: Array
    S: Array
    used: Mask
    algorithm: str = ""

    @property
    def steps(self) -> int:
        """Number of steps; the arrays have one entry more."""
        return len(self.t) - 1

    @property
    def sd_minus(self) -> Array:
        """Standard deviation of the prediction error, (steps+1, n)."""
        return deviations(self.P_minus)

    @property
    def sd_plus(self) -> Array:
        """Standard deviation of the filtering error, (steps+1, n)."""
        return deviations(self.P_plus)


class Contradiction(NamedTuple):
    """A measurement z[row, element] (of ``run``, in an ensemble) that is impossible, as what is known exactly excludes it.

    ``innovation``, its distance from the only possible value · ``allowed``, what rounding may explain of that
    """

    row: int
    element: int
    innovation: float
    allowed: float
    run: int = 0


class LeftOut(NamedTuple):
    """A measurement z[row, element] beyond the gate: its ``value``, its ``innovation``, and that in standard deviations, ``sigmas``."""

    row: int
    element: int
    value: float
    innovation: float
    sigmas: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FilteredRow:
    """One instant of :class:`Filtered`, whose names these are, without its axis of instants: what ``Filter.step`` and ``row`` give.

    ``t`` s · ``x_minus``, ``x_plus`` (n,) · ``P_minus``, ``P_plus`` (n, n) · ``K`` (n, m) · ``S`` (m, m) · ``used`` (m,) ·
    ``innovation`` (m,) · ``nis`` · ``contradictions`` and ``left_out``, those of this instant
    """

    t: float
    x_minus: Array
    x_plus: Array
    P_minus: Array
    P_plus: Array
    K: Array
    S: Array
    used: Mask
    innovation: Array
    nis: Any
    contradictions: tuple[Contradiction, ...] = ()
    left_out: tuple[LeftOut, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """What a smoother needs of the first instants: x = x̂ + e + Aδ after each update, and how it came about.

    ``x_minus``, ``x_plus`` (rows, n, runs), with any number where a state is not known · ``innovation`` (rows, m, runs) of x_minus,
    NaN where an element does not enter the update · ``P`` (rows, n, n), the covariance of e, and its root ``L`` ·
    ``A`` (rows, n, n), first the ``unknown`` (rows,) columns, then vague ones with δ ~ N(0, I), then zeros ·
    ``determined`` (rows,), how many of the unknown columns later measurements determine · ``excess`` (rows, m, runs), the
    innovations of perfect elements that were known already, and the ``terms`` (rows, m) whose rounding may be in them; NaN for
    all others · ``precise``, whether doubles were not enough for it, and more digits were taken
    """

    x_minus: Array
    x_plus: Array
    innovation: Array
    P: Array
    L: Array
    A: Array
    unknown: NDArray[np.intp]
    determined: NDArray[np.intp]
    excess: Array
    terms: Array
    precise: bool = False


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Filtered(Covariances):
    """One record, or an ensemble of records, filtered: the covariances, and what the data give, at the instants k = 0 … steps.

    ``x_minus``, ``x_plus`` (steps+1, n[, runs]), estimates given the measurements before k and up to k; NaN where nothing
    is known of a state · ``innovation`` (steps+1, m[, runs]), NaN where an element does not enter the update · ``nis``
    (steps+1[, runs]), νᵀS⁻¹ν, NaN where nothing is measured, or something unknown is · ``log_likelihood`` (a number or
    (runs,)), −½Σ(νᵀS⁻¹ν + ln det S + m ln 2π), NaN where rounding has left S indefinite, −∞ where there is a contradiction ·
    ``log_likelihood_diffuse``, see below · ``contradictions``, the perfect measurements that
    disagree with what is known exactly (:mod:`ctlabs.filtering.contradictions`); the filter goes on without them · ``z``
    (steps+1, m[, runs]), the data, by instants, without what known inputs bring into them · ``model``, the discrete model of these
    instants that was used · ``truth`` (steps+1, n[, runs]), the states that were estimated, where they are
    known from a simulation · ``start``, what the smoother needs of the first instants after a vague start · ``left_out``, what was
    beyond the gate, and is NaN in ``z`` · ``remarks``, sentences on estimates so far from zero that doubles cannot hold them to 1e-6 of
    their standard deviations · ``known`` (steps+1, m), what known inputs bring into the measurements, and ``given``, ``z`` with
    it, as the data were given; None where they bring nothing.

    ``log_likelihood`` is the density of what is measured after something is known of every state, given what was measured
    before. ``log_likelihood_diffuse`` counts every
    measurement, one that determines something unknown by −½ ln 2π − ½ ln α² (Durbin & Koopman, section 7.2.2): constants of
    the model on which α depends have their greatest likelihood by this one. From a finite P0 both are the same.
    """

    x_minus: Array
    x_plus: Array
    innovation: Array
    nis: Array
    log_likelihood: Any
    log_likelihood_diffuse: Any
    z: Array
    model: Any
    truth: Array | None = None
    start: Start | None = None
    contradictions: tuple[Contradiction, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    remarks: tuple[str, ...] = ()
    known: Array | None = None
    given: Array | None = None

    @property
    def asked(self) -> tuple[Any, Array]:
        """The model with what is known of the measurements in ``measurement_offset``, and the data as they were given, by instants."""
        if self.known is None or self.given is None:
            return self.model, self.z
        return replace(self.model, measurement_offset=self.known), self.given

    def row(self, k: int) -> FilteredRow:
        """The instant k = 0 … steps; a negative one counts from the end."""
        k = range(self.steps + 1)[k]
        names = ("x_minus", "x_plus", "P_minus", "P_plus", "K", "S", "used", "innovation", "nis")
        found: dict[str, Any] = {name: getattr(self, name)[k] for name in names}
        for name in ("contradictions", "left_out"):
            found[name] = tuple(each for each in getattr(self, name) if each.row + self.model.first == k)
        return FilteredRow(t=float(self.t[k]), **found)

    def error(self, when: str = "plus") -> Array:
        """e = x̂ − x, (steps+1, n[, runs]), after (``"plus"``) or before (``"minus"``) the update."""
        if self.truth is None:
            msg = "error: expected a simulated truth, received measured data (truth is None)"
            raise ValueError(msg)
        return (self.x_plus if when == "plus" else self.x_minus) - self.truth


def without_runs(found: Filtered) -> Filtered:
    """The estimates of one record without the last axis."""
    names = ("x_minus", "x_plus", "innovation", "nis", "z")
    parts: dict[str, Any] = {name: getattr(found, name)[..., 0] for name in names}
    parts["given"] = None if found.given is None else found.given[..., 0]
    truth = None if found.truth is None else found.truth[..., 0]
    both: dict[str, Any] = {name: float(getattr(found, name)[0]) for name in ("log_likelihood", "log_likelihood_diffuse")}
    return replace(found, truth=truth, **parts, **both)


def gains(P_minus: Array, H: Array, S: Array, used: Mask) -> Array:
    """K = P⁻HᵀS⁻¹ of every instant, (rows, n, m), 0 where an element does not enter; H (m, n) or (rows, m, n)."""
    m = used.shape[1]
    cross = np.where(used[:, :, None], H @ np.where(np.isfinite(P_minus), P_minus, 0.0), 0.0)
    finite = used & np.isfinite(np.diagonal(S, axis1=1, axis2=2))
    variances = np.abs(np.where(finite, np.diagonal(S, axis1=1, axis2=2), 1.0))  # rounding may have made one negative
    scale = np.sqrt(np.where(variances > 0, variances, 1.0))  # unit variances: no unit matters
    unit = np.where(finite[:, :, None] & finite[:, None, :], S, np.eye(m)) / (scale[:, :, None] * scale[:, None, :])
    plain = m == 1 and (unit > 0).all()
    K = cross / scale[:, :, None] ** 2 if plain else _solved(unit, cross / scale[:, :, None]) / scale[:, :, None]
    return np.swapaxes(np.where(finite[:, :, None], K, 0.0), 1, 2)


def _solved(S: Array, right: Array) -> Array:
    """S⁻¹ times the right sides; where rounding has made sensors one, they share the gain of that one."""
    try:
        return np.linalg.solve(S, right)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(S, hermitian=True) @ right)


def consistency(innovation: Array, S: Array, used: Mask) -> tuple[Array, Array]:
    """νᵀS⁻¹ν (rows, runs), NaN where nothing enters, and the log-likelihood of each instant (rows, runs), 0 there."""
    rows, _m, runs = innovation.shape
    nis, logs = np.full((rows, runs), np.nan), np.zeros((rows, runs))
    kinds = np.unique(used, axis=0)
    for kind in kinds[kinds.any(axis=1)]:
        at = (used == kind).all(axis=1)
        at[at] = np.isfinite(np.diagonal(S[at], axis1=1, axis2=2)[:, kind]).all(axis=1)
        part, nu = S[at][:, kind][:, :, kind], innovation[at][:, kind]
        sd = np.sqrt(np.diagonal(part, axis1=1, axis2=2))
        L = np.linalg.cholesky(part / (sd[:, :, None] * sd[:, None, :]))
        white = np.linalg.solve(L, nu / sd[:, :, None])
        nis[at] = np.square(white).sum(axis=1)
        half = np.log(np.diagonal(L, axis1=1, axis2=2)).sum(axis=1) + np.log(sd).sum(axis=1)
        logs[at] = -0.5 * nis[at] - half[:, None] - 0.5 * kind.sum() * np.log(2 * np.pi)
    return nis, logs
