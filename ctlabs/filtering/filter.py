"""The filter of a record, and what it will do before there is one."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import product
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.filtering import bucy, digits, measured
from ctlabs.filtering.algorithms import beginning, catalogue
from ctlabs.filtering.algorithms.vague import needed
from ctlabs.filtering.engines import adapter, compiled, driver, gains
from ctlabs.filtering.engines.record import ByInstant
from ctlabs.filtering.gate import gated
from ctlabs.filtering.problem import FilterProblem, by_instant, pose, rows_of
from ctlabs.filtering.results import Covariances, Filtered, LeftOut, Mask, without_runs
from ctlabs.linalg.checks import Array
from ctlabs.models.linear import ContinuousModel, DiscreteModel

#: Two forms agree that differ by less than this fraction of the standard deviations.
SAME = 1e-7


def kalman_filter(
    model: Any,
    z: ArrayLike,
    *,
    first: int | None = None,
    t: ArrayLike | None = None,
    H: ArrayLike | None = None,
    R: ArrayLike | None = None,
    u: ArrayLike | None = None,
    u0: ArrayLike | None = None,
    algorithm: str = "auto",
    gains: Covariances | None = None,
    P0: ArrayLike | None = None,
    gate: float | None = None,
) -> Filtered:
    r"""The optimal estimates of a record, or of an ensemble of records.

    .. math:: \hat x_k^- = \Phi\hat x_{k-1}^+ + Bu_{k-1} + c, \quad P_k^- = \Phi P_{k-1}^+\Phi^T + Q_d, \quad
              S = HP^-H^T + R, \quad K = P^-H^TS^{-1}

    .. math:: \nu = z - H\hat x^- - Du - d, \quad \hat x^+ = \hat x^- + K\nu, \quad P^+ = (I-KH)P^-(I-KH)^T + KRK^T

    Parameters
    ----------
    model : a DiscreteModel, constant or given for as many steps as z has; a ContinuousModel, measured at the times ``t`` with
        noises of the covariance ``R``; a NonlinearModel (by an extended filter); or any object of the protocol
        :class:`ctlabs.filtering.Model`
    z : (rows, m), or (rows, m, runs) for records of one kind, which share their gains; (rows,) where m = 1. One row for each
        instant at which something is measured, in order; NaN = not measured, in all runs alike
    first : 1, z[0] is measured a period after t0; 0, at t0; by default as the model says
    t : (rows,), s since t0 = 0, increasing, of a ContinuousModel
    H, R : in place of the model's: (m, n), (m, m), or with an axis of rows before these
    u : (rows, r), or (r,) if it is constant: the known input of a model with B or D. u[i] enters the measurement z[i] (D) and
        acts from its instant until the next (B)
    u0 : (r,), the input from t0 to the first measurement, where that comes later and the model has B
    algorithm : ``"auto"``, ``"filterpy"``, or a form of :mod:`ctlabs.filtering.algorithms` by name. All are the same filter, and
        differ by rounding; the result says which was used
    gains : apply these gains (of :func:`covariances`, or another filter's) instead of the optimal ones
    P0 : (n, n), in place of the model's; ``inf`` on its diagonal means that nothing is known of that state
    gate : leave out the elements whose innovation is beyond so many standard deviations, of one record of a linear model; the result
        lists them (``left_out``) (:mod:`ctlabs.filtering.gate`)

    Returns
    -------
    Filtered, over the instants k = 0 … steps: row 0 is t0, which is measured only with ``first=0``

    Raises
    ------
    TypeError
        Something that is no model.
    ValueError
        A shape that does not fit the model; an infinite value; NaN in some runs only; more rows than a time-varying model is given
        for; an input missing or superfluous; what a form cannot do.
    FloatingPointError
        The covariance overflows, or rounding makes S indefinite: the step and the time are in the message.

    Source: Maybeck vol. 1, eq. 5-36 to 5-42, with Joseph's form.

    >>> walk = DiscreteModel(Phi=[[1]], Qd=[[1]], H=[[1]], R=[[1]], P0=[[10]])
    >>> found = kalman_filter(walk, [5, 5, 5])
    >>> found.x_plus[1:, 0].round(4), found.algorithm
    (array([4.5833, 4.8571, 4.9462]), 'joseph')
    >>> kalman_filter(walk, [5, 5, 50, 5], gate=5).left_out[0][:3]
    (2, 0, 50.0)
    """
    if not isinstance(model, DiscreteModel) and callable(getattr(model, "f", None)):
        from ctlabs.filtering import extended

        if gate is not None:
            msg = "gate: expected none with a nonlinear model, received one"
            raise ValueError(msg)
        return extended.filtered(model, z, first=first, R=R, H=H, t=t, u=u, u0=u0, algorithm=algorithm, gains=gains, P0=P0)
    problem = pose(model, z, first=first, t=t, H=H, R=R, u=u, u0=u0, P0=P0)
    given, left = rows_of(z, problem.model.m)[0], tuple[LeftOut, ...]()
    if gate is not None:
        if gains is not None:
            msg = "gate: expected none beside given gains, which hold for data that are all there; received one"
            raise ValueError(msg)
        problem, left = gated(problem, given, gate, _best)
    found = replace(_filtered(problem, algorithm, gains), left_out=left)
    found = replace(found, remarks=digits.remarks(found, found.x_plus, found.P_plus, "filtered"))
    if problem.known is not None:
        found = replace(found, known=problem.known, given=np.where(np.isnan(problem.z), np.nan, by_instant(given, problem.first)))
    return without_runs(found) if problem.single else found


@overload
def covariances(model: DiscreteModel, steps: int, *, first: int | None = None, algorithm: str = "auto") -> Covariances: ...
@overload
def covariances(model: ContinuousModel, steps: ArrayLike) -> bucy.Transient: ...
def covariances(model: Any, steps: Any, *, first: int | None = None, algorithm: str = "auto") -> Covariances | bucy.Transient:
    """The covariances and gains of the optimal filter of ``model`` over ``steps`` steps; no data are needed.

    Parameters
    ----------
    model : discrete, constant or given for at least ``steps`` steps; or continuous, with Rc: then the transient of the Kalman–Bucy
        filter (:func:`ctlabs.filtering.bucy.transient`)
    steps : number of periods; of a continuous model the times, s
    first : 1 (first measurement at t1), 0 (at t0), or as the model says
    algorithm : as for :func:`kalman_filter`

    Raises
    ------
    TypeError
        Something that is no such model.
    ValueError
        steps < 1, or more steps than a time-varying model is given for; first or an algorithm beside a continuous model.
    FloatingPointError
        The covariance overflows, or that of the innovation is singular by rounding: the step and the time are in the message.

    >>> m = DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[10]])
    >>> covariances(m, 2).P_plus[1:, 0, 0].round(6)
    array([0.916667, 0.657143])
    >>> covariances(ContinuousModel([[0]], [[1]], [[4]], [[1]], Rc=[[16]], P0=[[25]]), [0, 1, 10]).P[:, 0, 0].round(3)
    array([25.   , 11.741,  8.   ])
    """
    if isinstance(model, ContinuousModel):
        if np.ndim(steps) == 0:
            msg = "model: expected a DiscreteModel for a number of steps (discretise it, or give times), received a ContinuousModel"
            raise TypeError(msg)
        if first is not None or algorithm != "auto":
            msg = "first, algorithm: expected none with a ContinuousModel, whose measurement is continuous; received one"
            raise ValueError(msg)
        return bucy.transient(model, steps)
    steps = measured.horizon(model, steps)
    return planned(model, np.zeros((steps + 1, model.m), dtype=bool), measured.begins(model, first), algorithm)


def planned(model: DiscreteModel, absent: Mask, first: int, algorithm: str = "auto") -> Covariances:
    """:func:`covariances` where the elements ``absent`` (steps+1, m) are not measured."""
    absent, model = np.array(absent), model.cut(len(absent) - 1)
    absent[:first] = True
    t = np.arange(len(absent)) * model.dt
    if algorithm == "filterpy":
        return adapter.covariances(model, absent)
    return _without_data(_filtered(_silent(model, absent, t, first), algorithm, None))


def _silent(model: DiscreteModel, absent: Mask, t: Array, first: int) -> FilterProblem:
    """The problem of a record of zeros: the covariances depend on no data."""
    return FilterProblem(model, np.where(absent, np.nan, 0.0)[:, :, None], t, first, single=True)


def _without_data(found: Filtered) -> Covariances:
    """The half of a result that depends on no data."""
    return Covariances(found.t, found.P_minus, found.P_plus, found.K, found.S, found.used, found.algorithm)


def log_likelihood(model: DiscreteModel, z: ArrayLike, first: int | None = None) -> float:
    """The logarithm of the probability density of the elements measured, without histories: for fitting.

    Where nothing is known of a state (``inf`` in P0) it is ``log_likelihood_diffuse`` of :class:`ctlabs.filtering.Filtered`.
    Parameters, and what is raised, as for :func:`kalman_filter`; one record.

    >>> m = DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[10]])
    >>> round(log_likelihood(m, [1.0, np.nan]), 6)
    -2.203059
    """
    problem = pose(model, z, first=first)
    if not problem.single:
        msg = f"z: expected one record, (rows, {model.m}), received an ensemble"
        raise ValueError(msg)
    return density(problem)[0]


def density(problem: FilterProblem) -> tuple[float, int]:
    """:func:`log_likelihood` of a posed problem, and how many elements enter the filter."""
    try:
        return compiled.log_likelihood(problem)
    except compiled.LostDigits as lost:
        found = _rescued(problem, lost)
        return float(found.log_likelihood_diffuse[0]), int(found.used.sum())


def solved(problem: FilterProblem) -> Filtered:
    """The record of a posed problem, by the default algorithm; with an axis of runs."""
    return _best(problem)


def _filtered(problem: FilterProblem, algorithm: str, given: Covariances | None) -> Filtered:
    """The one place where an algorithm is chosen."""
    if given is not None:
        return _with_gains(problem, given)
    if algorithm == "filterpy":
        plan = adapter.covariances(problem.model, problem.absent)
        return gains.apply(problem, plan, "filterpy", _begun(problem))
    if algorithm == "auto":
        return _best(problem)
    if algorithm == "joseph":
        return _compiled(problem)
    catalogue.form(algorithm, "auto", "filterpy")
    return driver.run(problem, algorithm)[0]


def _best(problem: FilterProblem) -> Filtered:
    """The compiled loop, or what keeps the digits that it has not."""
    try:
        return _compiled(problem)
    except compiled.LostDigits as lost:
        return _rescued(problem, lost)


def _rescued(problem: FilterProblem, lost: compiled.LostDigits) -> Filtered:
    """Factors of P with which square roots, of P or of its inverse, agree; otherwise the compiled loop's refusal."""
    tried = cache(lambda form: _tried(problem, form))
    for factors, roots in product(("ud", "ld"), ("carlson", "srif")):
        found, other = tried(factors), tried(roots)
        if found is not None and other is not None and agree(found, other):
            return found
    raise lost


def _tried(problem: FilterProblem, form: str) -> Filtered | None:
    try:
        return driver.run(problem, form)[0]
    except (ValueError, FloatingPointError):
        return None


def agree(one: Filtered, other: Filtered) -> bool:
    """Whether two forms give the same estimates and covariances, in units of their standard deviations."""
    before = beginning.close(one.x_minus, other.x_minus, one.P_minus, other.P_minus, SAME)
    after = beginning.close(one.x_plus, other.x_plus, one.P_plus, other.P_plus, SAME)
    return before and after and bool(np.isfinite(one.log_likelihood).all())


def _compiled(problem: FilterProblem) -> Filtered:
    """A record in one pass; of an ensemble the gains, and one matrix product for all runs at every step.

    Joseph's form, or square roots where that would lose digits.
    """
    if problem.z.shape[2] == 1:
        return compiled.record(problem)
    if problem.model.R.ndim == 2 and not measured.any_perfect(problem.model.R) and not needed(problem.model, problem.model.P0):
        plan = _without_data(compiled.record(_silent(problem.model, problem.absent, problem.t, problem.first)))
        return gains.apply(problem, plan, plan.algorithm)
    return driver.run(problem, "joseph")[0]


def _with_gains(problem: FilterProblem, given: Covariances) -> Filtered:
    shape = (len(problem.z), problem.model.n, problem.model.m)
    if given.K.shape != shape:
        msg = f"gains: expected gains of shape {shape}, received {given.K.shape}"
        raise ValueError(msg)
    return gains.apply(problem, _at(given, problem.t), given.algorithm)


def _at(given: Covariances, t: Array) -> Covariances:
    """Gains at the instants of a record."""
    return given if np.array_equal(given.t, t) else replace(given, t=t)


def _begun(problem: FilterProblem) -> beginning.Beginning | None:
    """The first instants of a record from a vague start."""
    if not needed(problem.model, problem.model.P0):
        return None
    record = ByInstant(problem.model, problem.z, float, driver.entering(problem))
    return beginning.begin(record, problem.model.P0)
