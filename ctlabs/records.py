r"""One long record through the Kalman filter, compiled: Joseph's form, as :mod:`ctlabs.kalman` has it.

.. math:: S = HP^-H^T + R = CC^T, \quad K = P^-H^TC^{-T}C^{-1}, \quad
          P^+ = (I-KH)P^-(I-KH)^T + KRK^T

.. math:: \ln p(z) = -\tfrac12\sum_k\left(\nu_k^TS_k^{-1}\nu_k + \ln\det S_k + m_k\ln 2\pi\right)

(Maybeck vol. 1, section 5.6; the likelihood by prediction errors, Schweppe, IEEE Trans. IT-11, 1965.) Where only the data
vary and P has come to its fixed point, the covariances are not computed again as long as the same elements are
measured. What is left of P's way there is summed to its end before it is left out, and lies below 1e-13 of the standard
deviations (:func:`ctlabs.recursions.forward.settled`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ctlabs import _check, contradictions, forms, kalman
from ctlabs._check import Array
from ctlabs.forms import Filtered, contract
from ctlabs.forms.beginning import Beginning, begin
from ctlabs.forms.vague import needed
from ctlabs.models import DiscreteModel
from ctlabs.text import moment

if TYPE_CHECKING:
    from ctlabs.recursions.common import System
    from ctlabs.recursions.forward import Histories


def filter_record(model: DiscreteModel, z: ArrayLike, first: int = 1) -> Filtered:
    """Filter one record, equal to ``forms.run(model, z, "joseph", first)`` but for rounding.

    Parameters
    ----------
    model : constant or time-varying; N, a correlated R, absent (R = inf) and perfect (R = 0) measurements are allowed.
        A record with a perfect measurement of what is known already goes through :mod:`ctlabs.forms`, which is slower.
    z : (steps+1, m), NaN = not measured. With ``first=1`` row 0 is not used.
    first : 1 (first measurement at t1) or 0 (at t0)

    Returns
    -------
    Filtered, without an axis for runs

    Raises
    ------
    TypeError
        A continuous model: discretise it first.
    ValueError
        A shape that does not fit the model; an infinite value; more steps than a time-varying model is given for.
    FloatingPointError
        The covariance overflows, or rounding makes S indefinite: the step and the time are in the message.

    >>> m = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])
    >>> found = filter_record(m, [[np.nan], [1.0], [np.nan]])
    >>> found.x_plus[:, 0].round(6), round(found.log_likelihood, 6)
    (array([0.      , 0.916667, 0.916667]), -2.203059)
    """
    data, used = _measured(model, z, first)
    begun = _begin(model, data, used)
    rows = 0 if begun is None else begun.rows
    out = _histories(len(data), model.n, model.m)
    total = 0.0 if rows == len(data) else _forward(model, data, used, out, begun)
    if total is None:
        return _perfect(model, data, first)
    t, both = np.arange(len(data)) * model.dt, (total, total)
    if begun is not None:
        both = (total + float(begun.ordinary[0]), total + float(begun.diffuse[0]))
        for name, whole in out._asdict().items():
            part = getattr(begun, name)
            whole[:rows] = part[..., 0] if name in ("x_minus", "x_plus", "innovation", "nis") else part
    start = None if begun is None else begun.start
    found = Filtered(t, *out, log_likelihood=both[0], used=used, log_likelihood_diffuse=both[1], start=start)
    judged: Filtered = contradictions.judged(model, data, found, first)
    return judged


def log_likelihood(model: DiscreteModel, z: ArrayLike, first: int = 1) -> float:
    """The logarithm of the probability density of the elements measured, without histories: for fitting.

    Where nothing is known of a state (``inf`` in P0) it is ``log_likelihood_diffuse`` of :class:`ctlabs.forms.Filtered`.
    Parameters, and what is raised, as for :func:`filter_record`.

    >>> m = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])
    >>> round(log_likelihood(m, [[np.nan], [1.0], [np.nan]]), 6)
    -2.203059
    """
    data, used = _measured(model, z, first)
    begun = _begin(model, data, used)
    if begun is not None and np.isfinite(begun.start.excess).any():  # a perfect measurement of what was known: is it true?
        return float(filter_record(model, z, first).log_likelihood_diffuse)
    if begun is not None and begun.rows == len(data):
        return float(begun.diffuse[0])
    total = _forward(model, data, used, _histories(0, model.n, model.m), begun)
    if total is None:
        return float(_perfect(model, data, first).log_likelihood_diffuse)
    return total if begun is None else total + float(begun.diffuse[0])


def system(model: DiscreteModel) -> System:
    """The arrays of a model for the compiled loops."""
    from ctlabs.recursions.common import System

    nothing = np.empty((0, model.n))
    c = nothing if model.offset is None else np.atleast_2d(model.offset)
    N = nothing if model.N is None else model.N
    return System(_stack(model.Phi), _stack(model.Qd), fixed(c), _stack(model.H), _stack(model.R), fixed(N))


def _measured(model: DiscreteModel, z: ArrayLike, first: int) -> tuple[Array, NDArray[np.bool_]]:
    """The record, checked, and which of its elements are measured."""
    _check.instance("model", model, DiscreteModel)
    data = np.array(z, dtype=np.float64, order="C")
    if data.ndim != 2 or data.shape[1] != model.m:
        msg = f"z: expected shape (steps+1, {model.m}), received {np.shape(z)}"
        raise ValueError(msg)
    kalman._horizon(model, len(data) - 1, first)
    used = ~kalman._gaps(data[:, :, None])
    variances = np.diagonal(model.R, axis1=-2, axis2=-1)
    used &= np.isfinite(variances if variances.ndim == 1 else variances[: len(data)])
    used[:first] = False
    return data, used


def _histories(rows: int, n: int, m: int) -> Histories:
    from ctlabs.recursions.forward import Histories

    return Histories(
        np.empty((rows, n)),
        np.empty((rows, n)),
        np.empty((rows, n, n)),
        np.empty((rows, n, n)),
        np.empty((rows, m)),
        np.empty((rows, m, m)),
        np.empty(rows),
    )


def _begin(model: DiscreteModel, z: Array, used: NDArray[np.bool_]) -> Beginning | None:
    """The first instants from a vague start; ``used`` is corrected there."""
    return begin(forms.Record(model, z[:, :, None], 0, float, used), model.P0) if needed(model, model.P0) else None


def _forward(
    model: DiscreteModel, z: Array, used: NDArray[np.bool_], out: Histories, begun: Beginning | None
) -> float | None:
    """The log-likelihood of what follows the beginning, the histories in ``out``; None where nothing is left to learn.

    That is where a perfect measurement is of what is known already.
    """
    from ctlabs.recursions import forward, roots  # numba costs 0.3 s to import

    k, x, P = 0, model.x0, model.P0
    if begun is not None:
        assert begun.x is not None
        assert begun.P is not None
        k, x, P = begun.rows, begun.x[:, 0], begun.P
    begun_at, own = k, system(model)
    end, k, total = forward.forward(own, fixed(x), fixed(P), fixed(z), fixed(used), begun_at, out)
    if end in (forward.LOSING, forward.INDEFINITE):
        L = np.zeros((model.n, model.n))
        columns = contract.rooted(P) if begun is None or begun.L is None else begun.L
        L[:, : columns.shape[1]] = columns
        end, k, total = roots.forward(own, fixed(x), fixed(L), fixed(z), fixed(used), begun_at, out)
    if end == forward.OVERFLOW:
        msg = f"P_minus: expected finite covariances, received an overflow {_when(model, k)}"
        raise FloatingPointError(msg)
    if end == forward.INDEFINITE:
        raise FloatingPointError(_beyond(_when(model, k)))
    return None if end == forward.PERFECT else float(total)


def _perfect(model: DiscreteModel, z: Array, first: int) -> Filtered:
    """The record of a model with perfect measurements, by filterpy."""
    found = forms.run(model, z, "joseph", first)
    begun = 0 if found.start is None else len(found.start.P)  # before, something unknown may be measured
    wrong = np.isnan(found.nis) & found.used.any(axis=1) & (np.arange(len(z)) >= begun)
    if wrong.any():
        raise FloatingPointError(_indefinite(_when(model, int(np.argmax(wrong)))))
    return found


def _when(model: DiscreteModel, k: int) -> str:
    return f"at step {k} (t = {moment(k * model.dt)} s)"


def _beyond(where: str) -> str:
    return (
        f"S: expected a covariance with digits left in double precision, received one {where} of a measurement, or of a difference of "
        "some, whose noise is near the rounding of its prediction: a larger R, or fewer such elements at once, leaves some"
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
    """A contiguous view that cannot be written: one type for the compiler, whoever made the array."""
    view = np.ascontiguousarray(array).view()
    view.setflags(write=False)
    return view
