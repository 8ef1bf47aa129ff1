"""The forms of the filter side by side: what each costs, and what rounding does to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.filtering.algorithms import contract
from ctlabs.filtering.algorithms.catalogue import FORMS
from ctlabs.filtering.algorithms.catalogue import form as named
from ctlabs.filtering.algorithms.contract import Counted, Noise, Numbers
from ctlabs.filtering.engines import driver
from ctlabs.filtering.engines.record import ByInstant
from ctlabs.filtering.problem import FilterProblem, pose
from ctlabs.filtering.results import Filtered, without_runs
from ctlabs.linalg.checks import Array
from ctlabs.models.linear import DiscreteModel

#: Digits of the reference.
DIGITS = 50
#: How large the relative error of P and the error of the estimate (in units of its σ) may be.
GRADES = (("exact", 1e-10, 1e-8), ("accurate", 1e-6, 1e-3), ("losing", 1e-2, 0.1))
#: Rows of a record that is timed twice.
SHORT = 200


class Comparison(NamedTuple):
    """One form on one record, against the filter with 50 digits on the same doubles.

    ``flops`` per step (one prediction and one update, dense matrices; a square root is one operation) · ``error_P``, the
    largest ‖P⁺ − P_ref‖/‖P_ref‖ (Frobenius) · ``error_variance`` (n,), the largest relative error of each variance of P⁺
    (of one that should be 0: the standard deviation left, as a fraction of the largest) · ``error_x`` (n,), the largest
    error of each estimate · ``seconds`` per step of prediction and update, as measured: never the same twice ·
    ``failed``: why the form refused or gave up, its numbers being ``None`` then; otherwise empty
    """

    name: str
    flops: int | None
    error_P: float | None
    error_variance: Array | None
    error_x: Array | None
    seconds: float | None
    failed: str


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """One form of the filter on a record.

    ``flops`` and ``seconds`` per step · ``error_P``, ``error_x``: the largest relative error of P⁺ and the largest error of an
    estimate in units of its σ, against 50 digits (``None`` where it was not compared, or refused) · ``failed``, why it refused or gave
    up; empty otherwise · ``rms`` (n,), RMS error of the last estimates of simulated runs
    """

    name: str
    flops: int | None = None
    seconds: float | None = None
    error_P: float | None = None
    error_x: float | None = None
    failed: str = ""
    rms: Array | None = None

    @property
    def grade(self) -> str:
        """"exact" to rounding, "accurate", "losing" digits, "wrong", "failed", or "" where it was not compared."""  # fmt: skip
        P, x = self.error_P, self.error_x
        if self.failed or P is None or x is None:
            return "failed" if self.failed else ""
        return next((name for name, bound_P, bound_x in GRADES if P <= bound_P and x <= bound_x), "wrong")


def reference(model: DiscreteModel, z: ArrayLike, first: int | None = None) -> Filtered:
    """What :func:`ctlabs.kalman_filter` gives, computed with 50 digits from the same doubles, and rounded once at the end."""
    import mpmath

    problem = pose(model, z, first=first)
    with mpmath.workdps(DIGITS):
        found = driver.run(problem, "joseph", mpmath.mpf, own_start=True)[0]
    return without_runs(found) if problem.single else found


def flops(model: DiscreteModel, form: str) -> int:
    """Additions, multiplications, divisions and square roots of one step, counted while it is done.

    A step is one prediction and one update with all measured elements. What depends on no data and is the same at
    every step of a constant model (factors of Qd and R, the matrices with N) is not counted.

    >>> m = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])
    >>> flops(m, "conventional") < flops(m, "joseph")
    True
    """
    how = named(form)
    z = np.zeros((2, model.m, 1))
    if model.N is None:  # otherwise what a measurement tells of the next disturbance belongs to a step
        z[0] = np.nan
    record = ByInstant(model, z, Counted, driver.entering(FilterProblem(model, z, np.arange(2.0), 0, single=True)))
    known = np.isfinite(model.P0).all()
    P0 = np.eye(model.n) + 0.1 if not known or contract.definite(model.P0) else model.P0
    state = how.start(model, contract.numbers(P0, Counted))
    if record.used[0].any():
        state = how.update(state, *_regular(record, 0, P0))[0]
    Phi, c, Q = record.motion(0)
    ahead = contract.doubles(Phi) @ P0 @ contract.doubles(Phi).T + contract.doubles(Q.matrix)
    measured = _regular(record, 1, ahead) if record.used[1].any() else None
    Counted.total = 0
    state = how.predict(state, Phi, c, Q)
    if measured is not None:
        how.update(state, *measured)
    return Counted.total


def _regular(record: ByInstant, k: int, P: Array) -> tuple[Numbers, Numbers, Noise]:
    """A measurement of the same shape, without the rounding that makes a form give up: a regular R of the size of HPHᵀ.

    What is counted are dense matrices, not their values; whether R is singular or correlated stays as it is.
    """
    z, H, R = record.measurement(k)
    if R.singular:
        return z, H, R
    rows = contract.doubles(H)
    sd = np.sqrt(np.diag(rows @ P @ rows.T) + np.diag(contract.doubles(R.matrix)))
    correlations = np.where(contract.doubles(R.matrix) != 0, 0.5 / len(sd), 0.0)
    np.fill_diagonal(correlations, 1.0)
    return z, H, Noise(contract.numbers(correlations * np.outer(sd, sd), Counted))


def compare(
    model: DiscreteModel,
    z: ArrayLike,
    forms: Sequence[str] | None = None,
    first: int | None = None,
    *,
    exact: Filtered | None = None,
) -> tuple[Comparison, ...]:
    """Several forms (all by default) on one record: errors by rounding, and cost.

    Each starts from P0 itself, if that is finite. A form that refuses the model, or gives up on the way, stays in the list and
    says why. ``exact`` is the record's
    :func:`reference`, where it is at hand already: it takes most of the time.

    >>> m = DiscreteModel([[1]], [[1]], [[1]], [[1e-14]], x0=[0], P0=[[1]])
    >>> [c.error_P > 1e-4 for c in compare(m, [[1.0]], ["conventional", "joseph", "potter", "ud"])]
    [True, False, False, False]
    >>> compare(m, [[np.nan], [1.0]], ["steady"])[0].failed[:12]
    'form steady:'
    """
    names = list(FORMS) if forms is None else list(forms)
    for name in names:
        named(name)
    known, problem = reference(model, z, first) if exact is None else exact, pose(model, z, first=first)
    return tuple(_compared(problem, name, known) for name in names)


def _compared(problem: FilterProblem, name: str, exact: Filtered) -> Comparison:
    try:
        own, seconds = driver.run(problem, name, own_start=True)
        if len(own.t) <= SHORT:  # the first step of a process takes longer than all others: once more
            seconds = min(seconds, driver.run(problem, name, own_start=True)[1])
        count = flops(problem.model, name)
    except (ValueError, FloatingPointError) as error:
        return Comparison(name, None, None, None, None, None, str(error))
    known = np.isfinite(exact.P_plus).all(axis=(1, 2))  # from a start without information not all rows are
    if not known.any():
        why = f"form {name}: expected a record that determines every state, received one that leaves some unknown"
        return Comparison(name, None, None, None, None, None, why)
    P, right = own.P_plus[known], exact.P_plus[known]
    difference, size = (np.linalg.norm(each, axis=(1, 2)) for each in (P - right, right))
    variances, wanted = (np.diagonal(each, axis1=1, axis2=2) for each in (P, right))
    return Comparison(
        name,
        count,
        float(_relative(difference, size).max()),
        _relative(np.abs(variances - wanted), wanted).max(axis=0),
        np.abs(own.x_plus - exact.x_plus.reshape(own.x_plus.shape))[known].max(axis=(0, 2)),
        seconds,
        "",
    )


def _relative(difference: Array, size: Array) -> Array:
    """difference/size; where the size is 0 the standard deviation left, as a fraction of the largest one."""
    left = np.sqrt(difference / (size.max() or np.finfo(float).tiny))
    return np.where(size > 0, difference / np.where(size > 0, size, 1.0), left)


