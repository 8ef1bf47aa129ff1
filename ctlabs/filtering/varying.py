r"""The Kalman–Bucy filter of a continuous model whose matrices vary with time, by integrating its equations.

.. math:: \dot P = FP + PF^T + GQG^T - P H^TR_c^{-1}H P, \quad K_c = P H^TR_c^{-1}, \quad
          \dot\Psi = (F - K_cH)\Psi,\ \Psi(0) = I

Every matrix may be a function of the time. For constant matrices :mod:`ctlabs.filtering.bucy` is exact and far quicker; here a
Runge–Kutta method of order 8 steps through time, so the matrices should be smooth, and the filter's fastest time
constant should not be very short beside the horizon.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
import scipy.integrate
import scipy.linalg
from numpy.polynomial import Chebyshev
from numpy.typing import ArrayLike

from ctlabs.filtering.bucy import Transient
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.text import moment

#: A matrix, or its value at a time in s.
Matrix: TypeAlias = ArrayLike | Callable[[float], ArrayLike]
#: Relative tolerance of a step.
RTOL = 1e-12
#: Below this fraction of the largest covariance the tolerance is absolute.
FLOOR = 1e-14


@dataclass(frozen=True, slots=True)
class VaryingModel:
    r"""Linear Gaussian system in continuous time with matrices that vary.

    .. math:: \dot x = F(t)x + G(t)w, \quad z = H(t)x + v, \quad w \sim Q(t),\ v \sim R_c(t) \text{ (strengths)}

    ``F`` (n, n) 1/s · ``G`` (n, s) · ``Q`` (s, s) · ``H`` (m, n) · ``Rc`` (m, m), positive definite · ``P0`` (n, n),
    covariance of x(0), a matrix. The others are matrices or functions of t, s.
    """

    F: Matrix
    G: Matrix
    Q: Matrix
    H: Matrix
    Rc: Matrix
    P0: ArrayLike


def transient(model: VaryingModel, t: ArrayLike) -> Transient:
    """The covariance of the error and the gain at given times.

    Parameters
    ----------
    model : its P0 is the covariance at t = 0; it may be singular, or zero
    t : (points,), s, increasing from t ≥ 0

    Raises
    ------
    ValueError
        Times that do not increase; a matrix of a wrong shape, or an Rc that is not positive definite, with its time.
    FloatingPointError
        The integration fails, or the covariance overflows.

    Source: Maybeck vol. 1, eq. 5-126 (the equation).

    >>> slope = VaryingModel([[0]], [[1]], [[0]], lambda t: [[t]], Rc=[[2]], P0=[[1]])
    >>> transient(slope, [0.5, 1, 2, 4]).P[:, 0, 0].round(6)
    array([0.979592, 0.857143, 0.428571, 0.085714])
    """
    return _integrated(model, t)[0]


def transition(model: VaryingModel, t: ArrayLike) -> Array:
    """Ψ(t, 0), what the filter makes by time t of an error at 0 without noise; (points, n, n). Raises as above.

    >>> slope = VaryingModel([[0]], [[1]], [[0]], lambda t: [[t]], Rc=[[2]], P0=[[1]])
    >>> transition(slope, [1, 2])[:, 0, 0].round(6)
    array([0.857143, 0.428571])
    """
    return _integrated(model, t)[1]


def gain_peak(model: VaryingModel, t: ArrayLike, state: int = 0, measurement: int = 0) -> tuple[float, float]:
    """When an element of the gain is largest, and how large, between the first and the last of the times.

    ``t`` is close enough to tell the highest peak from others; the peak is refined by a polynomial through it.

    >>> slope = VaryingModel([[0]], [[1]], [[0]], lambda t: [[t]], Rc=[[2]], P0=[[1]])
    >>> np.round(gain_peak(slope, np.linspace(0, 5, 26)), 6)
    array([1.44225, 0.48075])
    """
    t = np.asarray(t, dtype=np.float64)
    gains = transient(model, t).K[:, state, measurement]
    best = int(np.argmax(gains))
    low, high = t[max(best - 1, 0)], t[min(best + 1, len(t) - 1)]
    if not gains[best] or not low < high:
        return float(t[best]), float(gains[best])

    def gain(at: Array) -> Array:
        order = np.argsort(at)
        found = np.empty(len(at))
        found[order] = transient(model, at[order]).K[:, state, measurement]
        return found

    curve = Chebyshev.interpolate(gain, 16, domain=[low, high])
    roots = curve.deriv().roots()
    turns = roots.real[(np.abs(roots.imag) < 1e-6 * (high - low)) & (low < roots.real) & (roots.real < high)]
    values = curve(turns)
    # A turn is more exact than the sample beside it, so equality up to rounding goes to a turn between two samples.
    inside = 0 < best < len(t) - 1
    if not turns.size or values.max() < gains[best] * (1 + (-1e-9 if inside else 1e-9)):
        return float(t[best]), float(gains[best])
    return float(turns[values.argmax()]), float(values.max())


def _integrated(model: VaryingModel, t: ArrayLike) -> tuple[Transient, Array]:
    """P, K and Ψ at the times."""
    checks.instance("model", model, VaryingModel)
    model = _read(model)
    P0 = checks.covariance("P0", model.P0, ("n", "n"))
    t = checks.shaped("t", t, ("points",))
    if not t.size or t[0] < 0 or (np.diff(t) <= 0).any():
        shown = t.tolist() if t.size < 8 else f"{moment(t[0], t[-1])} … {moment(t[-1], t[0])}"
        msg = f"t: expected increasing times >= 0, received {shown}"
        raise ValueError(msg)
    n, upper = len(P0), np.triu_indices(len(P0))
    noise = _disturbance(model, 0.0, n)
    size = max(float(np.abs(P0).max()), float(np.abs(noise).max()) * float(t[-1])) or 1.0

    def whole(packed: Array) -> Array:
        P = np.zeros((n, n))
        P[upper] = packed
        return P + np.triu(P, 1).T

    def derivative(now: float, y: Array) -> Array:
        P, Psi = whole(y[: len(upper[0])]) * size, y[len(upper[0]) :].reshape(n, n)
        F, H = _at(model.F, "F", now, (n, n)), _at(model.H, "H", now, ("m", n))
        K = _gain(model, now, P, H)
        change = F @ P + P @ F.T + _disturbance(model, now, n) - K @ H @ P
        return np.concatenate([0.5 * (change + change.T)[upper] / size, ((F - K @ H) @ Psi).ravel()])

    start = np.concatenate([P0[upper] / size, np.eye(n).ravel()])
    y = start[:, None]
    if t[-1] > 0:
        with np.errstate(over="ignore", invalid="ignore"):  # reported below
            run = scipy.integrate.solve_ivp(
                derivative, (0.0, float(t[-1])), start, "DOP853", t, rtol=RTOL, atol=RTOL * FLOOR
            )
        if not run.success or not np.isfinite(run.y).all():
            msg = f"P: expected a covariance that can be integrated to t = {moment(t[-1])} s, received: {run.message}"
            raise FloatingPointError(msg)
        y = run.y
    P = np.array([whole(column) for column in y[: len(upper[0])].T]) * size
    Psi = y[len(upper[0]) :].T.reshape(-1, n, n)
    gains = [
        _gain(model, float(now), row, _at(model.H, "H", float(now), ("m", n))) for now, row in zip(t, P, strict=True)
    ]
    return Transient(t, P, np.array(gains)), Psi


def _read(model: VaryingModel) -> VaryingModel:
    """The model whose constant matrices are arrays already, as a solver asks some ten thousand times."""
    given = {name: getattr(model, name) for name in ("F", "G", "Q", "H", "Rc")}
    return replace(model, **{name: checks.array(f"{name}(t = 0 s)", M) for name, M in given.items() if not callable(M)})


def _at(matrix: Matrix, name: str, now: float, shape: tuple[int | str, ...]) -> Array:
    """A matrix at a time; the time is written into a message only, as a solver asks some ten thousand times."""
    value = matrix(now) if callable(matrix) else matrix
    if type(value) is np.ndarray and value.dtype == np.float64 and checks.fits(value.shape, shape) and np.isfinite(value).all():
        return value
    return checks.shaped(f"{name}(t = {moment(now)} s)", value, shape)


def _disturbance(model: VaryingModel, now: float, n: int) -> Array:
    """GQGᵀ."""
    G = _at(model.G, "G", now, (n, "s"))
    return G @ _at(model.Q, "Q", now, (G.shape[1], G.shape[1])) @ G.T


def _gain(model: VaryingModel, now: float, P: Array, H: Array) -> Array:
    Rc = _at(model.Rc, "Rc", now, (len(H), len(H)))
    try:
        root = scipy.linalg.cho_factor(Rc, lower=True)
    except np.linalg.LinAlgError:
        msg = f"Rc(t = {moment(now)} s): expected a positive definite matrix, received {Rc.tolist()}"
        raise ValueError(msg) from None
    return scipy.linalg.cho_solve(root, H @ P, check_finite=False).T
