r"""One long record through the Kalman filter, compiled: Joseph's form, and square roots where it would lose digits.

.. math:: S = HP^-H^T + R = CC^T, \quad K = P^-H^TC^{-T}C^{-1}, \quad
          P^+ = (I-KH)P^-(I-KH)^T + KRK^T

.. math:: \ln p(z) = -\tfrac12\sum_k\left(\nu_k^TS_k^{-1}\nu_k + \ln\det S_k + m_k\ln 2\pi\right)

(Maybeck vol. 1, section 5.6; the likelihood by prediction errors, Schweppe, IEEE Trans. IT-11, 1965.) Where only the data
vary and P has come to its fixed point, the covariances are not computed again as long as the same elements are
measured. What is left of P's way there is summed to its end before it is left out, and lies below 1e-13 of the standard
deviations (:func:`ctlabs.filtering.engines.forward.settled`). A record with N ≠ 0 beside a perfect measurement goes through the form
``joseph`` of :mod:`ctlabs.filtering.algorithms`, which is slower.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ctlabs.filtering import contradictions
from ctlabs.filtering.algorithms import contract
from ctlabs.filtering.algorithms.beginning import Beginning, begin
from ctlabs.filtering.engines import driver
from ctlabs.filtering.engines.record import ByInstant
from ctlabs.filtering.problem import FilterProblem
from ctlabs.filtering.results import Filtered, Mask
from ctlabs.linalg.checks import Array
from ctlabs.models.linear import DiscreteModel
from ctlabs.text import moment

if TYPE_CHECKING:
    from ctlabs.filtering.engines.common import System
    from ctlabs.filtering.engines.means import Histories


class LostDigits(FloatingPointError):
    """The covariance of an innovation has no digits left in double precision."""


def record(problem: FilterProblem) -> Filtered:
    """One record (a problem of one run), equal to that of the form ``joseph`` but for rounding.

    Raises
    ------
    FloatingPointError
        The covariance overflows, or (:class:`LostDigits`) rounding makes S indefinite: the step and the time are in the message.
    """
    model, data, used = problem.model, problem.z[:, :, 0], _entering(problem)
    begun = _begin(problem, used)
    rows = 0 if begun is None else begun.rows
    out = _histories(len(data), model.n, model.m)
    done = (0.0, "joseph") if rows == len(data) else _forward(problem, used, out, begun)
    if done is None:
        return _perfect(problem)
    total, algorithm = done
    both = (total, total)
    if begun is not None:
        both = (total + float(begun.ordinary[0]), total + float(begun.diffuse[0]))
        for name, whole in out._asdict().items():
            part = getattr(begun, name)
            whole[:rows] = part[..., 0] if name in ("x_minus", "x_plus", "innovation", "nis") else part
    found = Filtered(
        problem.t, out.P_minus, out.P_plus, out.K, out.S, used, algorithm,
        x_minus=out.x_minus[..., None], x_plus=out.x_plus[..., None], innovation=out.innovation[..., None],
        nis=out.nis[:, None], z=problem.z, model=model, log_likelihood=np.array(both[:1]), log_likelihood_diffuse=np.array(both[1:]),
        start=None if begun is None else begun.start,
    )  # fmt: skip
    return contradictions.judged(problem, found)


def log_likelihood(problem: FilterProblem) -> tuple[float, int]:
    """``log_likelihood_diffuse`` of :func:`record`, without histories, and how many elements enter the filter: for fitting."""
    model, rows = problem.model, len(problem.z)
    used = _entering(problem)
    begun = _begin(problem, used, gains=False)
    if begun is not None and np.isfinite(begun.start.excess).any():  # a perfect measurement of what was known: is it true?
        return _counted(record(problem))
    if begun is not None and begun.rows == rows:
        return float(begun.diffuse[0]), int(used.sum())
    asked = used.copy()
    done = _forward(problem, used, _histories(0, model.n, model.m), begun)
    if done is None:
        return _counted(_perfect(problem))
    if not np.array_equal(used, asked):  # again one of what was known
        return _counted(record(problem))
    return done[0] if begun is None else done[0] + float(begun.diffuse[0]), int(used.sum())


def _counted(found: Filtered) -> tuple[float, int]:
    return float(found.log_likelihood_diffuse[0]), int(found.used.sum())


def system(model: DiscreteModel) -> System:
    """The arrays of a model for the compiled loops."""
    from ctlabs.filtering.engines.common import System

    nothing = np.empty((0, model.n))
    c = nothing if model.offset is None else np.atleast_2d(model.offset)
    N = nothing if model.N is None else model.N
    return System(_stack(model.Phi), _stack(model.Qd), fixed(c), _stack(model.H), _stack(model.R), fixed(N))


def _histories(rows: int, n: int, m: int) -> Histories:
    from ctlabs.filtering.engines.means import Histories

    return Histories(
        np.empty((rows, n)),
        np.empty((rows, n)),
        np.empty((rows, n, n)),
        np.empty((rows, n, n)),
        np.empty((rows, n, m)),
        np.empty((rows, m)),
        np.empty((rows, m, m)),
        np.empty(rows),
    )


def _entering(problem: FilterProblem) -> Mask:
    """The elements that are measured, (steps+1, m)."""
    model, rows = problem.model, len(problem.z)
    finite = np.isfinite(np.diagonal(model.R, axis1=-2, axis2=-1))
    return ~problem.absent if finite.all() else ~problem.absent & (finite if finite.ndim == 1 else finite[:rows])


def _begin(problem: FilterProblem, used: Mask, *, gains: bool = True) -> Beginning | None:
    """The first instants from a vague start; ``used`` is corrected there."""
    return begin(ByInstant(problem.model, problem.z, float, used), problem.model.P0, gains=gains)


def _forward(problem: FilterProblem, used: Mask, out: Histories, begun: Beginning | None) -> tuple[float, str] | None:
    """The log-likelihood of what follows the beginning, and the form; the histories in ``out``. None where N ≠ 0 beside a singular R.

    Perfect measurements of what is known already are taken out of ``used``.
    """
    from ctlabs.filtering.engines import forward, roots  # numba costs 0.3 s to import

    model, k = problem.model, 0
    x, P = model.x0, model.P0
    if begun is not None:
        assert begun.x is not None
        assert begun.P is not None
        k, x, P = begun.rows, begun.x[:, 0], begun.P
    own, begin_at, algorithm = (system(model), fixed(x), fixed(problem.z[:, :, 0]), fixed(used)), k, "joseph"
    end, k, total = forward.filtered(own[0], own[1], fixed(P), own[2], own[3], begin_at, out)
    if end in (forward.LOSING, forward.INDEFINITE, forward.PERFECT):
        L, algorithm = np.zeros((model.n, model.n)), "array"
        columns = contract.rooted(P) if begun is None or begun.L is None else begun.L
        L[:, : columns.shape[1]] = columns
        entering = used.copy()
        end, k, total = roots.forward(own[0], own[1], fixed(L), own[2], entering, begin_at, out)
        used[:] = entering
    if end == forward.OVERFLOW:
        msg = f"P_minus: expected finite covariances, received an overflow {_when(problem, k)}"
        raise FloatingPointError(msg)
    if end == forward.INDEFINITE:
        raise LostDigits(beyond(_when(problem, k)))
    return None if end == forward.PERFECT else (float(total), algorithm)


def _perfect(problem: FilterProblem) -> Filtered:
    """The record of a model with perfect measurements, by filterpy."""
    found = driver.run(problem, "joseph")[0]
    begun = 0 if found.start is None else len(found.start.P)  # before, something unknown may be measured
    wrong = np.isnan(found.nis[:, 0]) & found.used.any(axis=1) & (np.arange(len(problem.z)) >= begun)
    if wrong.any():
        raise LostDigits(_indefinite(_when(problem, int(np.argmax(wrong)))))
    return found


def _when(problem: FilterProblem, k: int) -> str:
    return f"at step {k} (t = {moment(problem.t[k])} s)"


def beyond(where: str) -> str:
    """That square roots have too few digits ``where``."""
    return (
        f"S: expected a covariance with digits left in double precision, received one {where} of a measurement, or of a difference of "
        "some, whose noise is near the rounding of its prediction: a larger R, or fewer such elements at once, leaves some; a form with "
        "factors (algorithm ud) may keep more"
    )


def _indefinite(where: str) -> str:
    return (
        f"S: expected a positive definite covariance, received one indefinite by rounding {where}; "
        "a factorised form (ud, array, srif) keeps its digits"
    )


def _stack(matrix: Array) -> Array:
    """A constant matrix as a stack of one."""
    return fixed(matrix if matrix.ndim == 3 else matrix[None])


def fixed(array: Array) -> Array:
    """A contiguous view that cannot be written: the same array type for numba whatever the origin."""
    view = np.ascontiguousarray(array).view()
    view.setflags(write=False)
    return view
