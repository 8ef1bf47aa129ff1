r"""From a continuous model to the equivalent discrete one, exactly, at any stiffness, and back.

The transition matrix and the integrals come from :func:`ctlabs.linalg.exponential.interval`, every element to its own digits.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.linalg.exponential import interval as interval
from ctlabs.linalg.exponential import intervals as intervals
from ctlabs.linalg.logarithm import logarithm, strength
from ctlabs.models import ContinuousModel, DiscreteModel

#: The way back from samples holds matrices of n² rows: as many states take a minute and some gigabytes.
BACK = 30


def discretise(
    model: ContinuousModel,
    dt: float,
    R: ArrayLike | None = None,
    u: ArrayLike | None = None,
    *,
    average: bool = False,
) -> DiscreteModel:
    r"""The discrete model with the same states at the sampling instants t0, t0+dt, t0+2dt.

    .. math:: \Phi = e^{F\,dt}, \quad Q_d = \int_0^{dt} e^{Fs}GQG^Te^{F^Ts}ds, \quad c = \int_0^{dt}e^{Fs}ds\,Bu

    States and their noise are exact. The measurements are one of three kinds:

    * samples z_k = Hx_k + v_k with a covariance R of their own, exact;
    * the averages of the continuous measurement over [t_k, t_k + dt], exact, with ``average=True``: they and x_{k+1} come
      from one interval of the system augmented with y = ∫z dt,

      .. math:: \frac{d}{dt}\begin{bmatrix}x\\y\end{bmatrix} = \begin{bmatrix}F&0\\H&0\end{bmatrix}
                \begin{bmatrix}x\\y\end{bmatrix} + \begin{bmatrix}Gw\\v\end{bmatrix}: \qquad
                H_k = \frac{\Phi_{yx}}{dt}, \quad R = \frac{Q_{yy}}{dt^2}, \quad N = \frac{Q_{xy}}{dt}.

      z_k is known at t_{k+1} only, and there is one of the first period (``first=0``): ``P_minus[k+1]`` is the error of
      x_{k+1} given all that was measured until then;
    * with neither, point samples with R = Rc/dt and :math:`N = \frac1{dt}\int_0^{dt}e^{Fs}ds\,GN_c`: an approximation of
      order dt of the continuous measurement, for periods much shorter than all that the model does.

    Parameters
    ----------
    model : continuous model
    dt : period, s, > 0
    R : (m, m) or (steps+1, m, m), covariance of the sampled measurements, unit²
    u : (r,) or (steps, r), known input where it is known beforehand, constant over each interval: it becomes the offset.
        Without it the discrete model has :math:`B_d = \int_0^{dt}e^{Fs}ds\,B` and takes u at run time
    average : whether the measurements are the exact averages of the continuous one

    Returns
    -------
    DiscreteModel with Phi (n, n), Qd (n, n), unit²

    Raises
    ------
    ValueError
        No R and no Rc; R together with N (a sampler's own noise has no such correlation); u without B; average
        without Rc, with R, or with u, which would enter the averages too (leave it to run time).

    Source: Maybeck vol. 1, section 4.9 (equivalent discrete-time model), also for the augmented system.

    >>> m = ContinuousModel(F=[[0]], G=[[1]], Q=[[4]], H=[[1]], Rc=[[16]], P0=[[25]])
    >>> d = discretise(m, 0.5)
    >>> d.Qd, d.R
    (array([[2.]]), array([[32.]]))
    >>> d = discretise(m, 0.5, average=True)
    >>> d.H, d.R, d.N
    (array([[1.]]), array([[32.66666667]]), array([[1.]]))
    """
    checks.instance("model", model, ContinuousModel)
    if average:
        return _averaged(model, dt, R, u)
    Phi, Qd, Gamma = interval(model.F, model.G @ model.Q @ model.G.T, dt)
    if R is not None and model.N is not None:
        msg = "R: expected none beside the model's N, which correlates w with the noise of strength Rc; received R"
        raise ValueError(msg)
    if R is None:
        R = None if model.Rc is None else model.Rc / dt
    if R is None:
        msg = "R: expected the covariance of the sampled measurements (the model has no Rc), received None"
        raise ValueError(msg)
    B = None if model.B is None else Gamma @ model.B
    N = None if model.N is None else Gamma @ model.G @ model.N / dt
    if u is None:
        return DiscreteModel(Phi, Qd, model.H, R, dt=dt, N=N, B=B, D=model.D, **_kept(model))
    if B is None or model.D is not None:
        msg = f"u: expected a model with B{'' if B is None else ' and without D'}, received one with{'out' if B is None else ' it'}"
        raise ValueError(msg)
    offset = checks.shaped("u", u, (model.r,), ("steps", model.r)) @ B.T
    return DiscreteModel(Phi, Qd, model.H, R, dt=dt, N=N, offset=offset, **_kept(model))


def _averaged(model: ContinuousModel, dt: float, R: ArrayLike | None, u: ArrayLike | None) -> DiscreteModel:
    """:func:`discretise` with the exact averages of the continuous measurement."""
    if R is not None:
        msg = "R: expected none with average=True (the averages' noise follows from Rc), received R"
        raise ValueError(msg)
    if u is not None:
        msg = "u: expected none with average=True (it moves the averages too: give it at run time), received u"
        raise ValueError(msg)
    if model.Rc is None:
        msg = "average: expected a model with Rc, the strength of the noise that is averaged (0 is one), received one without"
        raise ValueError(msg)
    n, m = model.n, model.m
    N = np.zeros((model.s, m)) if model.N is None else model.N
    F = np.block([[model.F, np.zeros((n, m))], [model.H, np.zeros((m, m))]])
    GN = model.G @ N
    W = np.block([[model.G @ model.Q @ model.G.T, GN], [GN.T, model.Rc]])
    Phi, Q, Gamma = interval(F, W, dt)
    H, R, cross = Phi[n:, :n] / dt, Q[n:, n:] / dt / dt, Q[:n, n:] / dt
    inputs: dict[str, Any] = {}
    if model.r:  # constant over the period it moves the averages too
        B, D = (np.zeros((rows, model.r)) if M is None else M for M, rows in ((model.B, n), (model.D, m)))
        both = Gamma @ np.vstack([B, D])
        inputs = {"B": both[:n], "D": both[n:] / dt}
    return DiscreteModel(Phi[:n, :n], Q[:n, :n], H, R, dt=dt, N=cross, first=0, **inputs, **_kept(model))


def _kept(model: ContinuousModel | DiscreteModel) -> dict[str, Any]:
    """What time does not touch: the start, the measurements' offset and the names."""
    names = ("x0", "P0", "measurement_offset", "states", "measurements", "units", "measurement_units")
    return {name: getattr(model, name) for name in names}


def to_continuous(model: DiscreteModel) -> ContinuousModel:
    r"""The continuous model whose samples a discrete model describes: :func:`discretise` backwards.

    .. math:: F = \frac{\log\Phi}{dt}, \qquad \int_0^{dt} e^{Fs}GQG^Te^{F^Ts}ds = Q_d, \qquad R_c = R\,dt

    The logarithm is the principal one: every mode turns by less than half a turn per period. Samples do not tell it from
    a faster one that turns by a whole turn more; a model whose modes lie beyond the Nyquist frequency π/dt comes back
    with their aliases.

    Parameters
    ----------
    model : constant, without N and offset; its R is taken for that of point samples with R = Rc/dt

    Returns
    -------
    ContinuousModel with G = I and Q the strength GQGᵀ

    Raises
    ------
    ValueError
        There is none: Φ is singular, has a negative eigenvalue (no real logarithm, or not only one), or Qd would need a
        strength that is indefinite, as that of a piecewise constant acceleration does. Or it cannot be said: matrices
        that vary, N, a known input (whose B and u are not known apart), an R with ``inf``, more than 30 states.

    Source: Higham, *Functions of Matrices* (2008), section 2.3 (the embedding problem) and chapter 11.

    >>> model = DiscreteModel([[1, 0.5], [0, 1]], [[1/24, 1/8], [1/8, 1/2]], [[1, 0]], [[2]], x0=[0, 0], P0=[[1, 0], [0, 1]], dt=0.5)
    >>> back = to_continuous(model)
    >>> back.F, back.Q.round(12), back.Rc
    (array([[0., 1.],
           [0., 0.]]), array([[0., 0.],
           [0., 1.]]), array([[1.]]))
    """
    checks.instance("model", model, DiscreteModel)
    if model.horizon is not None:
        msg = f"model: expected constant matrices, received some that vary over {model.horizon} steps"
        raise ValueError(msg)
    for name, given in (("N", model.N), ("offset", model.offset)):
        if given is not None and given.any():
            msg = f"{name}: expected none (it belongs to more than one continuous model), received one"
            raise ValueError(msg)
    if not np.isfinite(model.R).all():
        msg = "R: expected finite variances (a strength belongs to what is measured), received inf"
        raise ValueError(msg)
    if model.n > BACK:
        msg = f"model: expected at most {BACK} states (the way back solves n² equations at once), received {model.n}"
        raise ValueError(msg)
    F = logarithm(model.Phi) / model.dt
    Q = _strength(F, model.Qd, model.dt)
    B = None if model.B is None else np.linalg.solve(interval(F, Q, model.dt).Gamma, model.B)
    return ContinuousModel(F, np.eye(model.n), Q, model.H, Rc=model.R * model.dt, B=B, D=model.D, **_kept(model))


def _strength(F: Array, Qd: Array, dt: float) -> Array:
    """W ≥ 0 whose integral is Qd; refused where the nearest one leads to another Qd."""
    W, error = strength(F, Qd, dt)
    # In units of their own uncertainty the elements move by no more than that when negative eigenvalues are set to zero.
    unit = np.sqrt(np.diag(error))
    unit = np.where(unit > 0, unit, 1.0)
    values, vectors = np.linalg.eigh(W / np.outer(unit, unit))
    nearest = (vectors * np.maximum(values, 0.0)) @ vectors.T * np.outer(unit, unit)
    none = (np.abs(W) <= error).all(axis=1)  # a row that is the rounding of its own terms
    nearest[none, :] = nearest[:, none] = 0.0
    sd = np.where(np.diag(Qd) > 0, np.sqrt(np.diag(Qd)), 1.0)
    off = (np.abs(interval(F, nearest, dt).Qd - Qd) / np.outer(sd, sd)).max()
    if off > checks.ROUNDING:
        size = np.sqrt(np.maximum(np.abs(np.diag(W)), np.diag(error)))
        size = np.where(size > 0, size, 1.0)
        lowest = np.linalg.eigvalsh(W / np.outer(size, size))[0]
        msg = (
            "Qd: expected the integral of a nonnegative definite strength over dt, received one that needs a strength "
            f"with eigenvalue {lowest:.3g} (scaled to unit diagonal)"
            if lowest < -checks.ROUNDING
            else "Qd: expected one that determines its strength, received one beside modes of Phi so fast that the strength "
            f"found leads back to another Qd ({off:.2g} of its standard deviations off)"
        )
        raise ValueError(msg)
    return nearest
