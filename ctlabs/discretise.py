r"""From a continuous model to the equivalent discrete one, exactly, at any stiffness.

The transition matrix and the integrals come from :func:`ctlabs.linalg.exponential.interval`, every element to its own digits.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ctlabs import _check
from ctlabs._check import Array
from ctlabs.linalg.exponential import interval as interval
from ctlabs.models import ContinuousModel, DiscreteModel


def discretise(
    model: ContinuousModel, dt: float, R: ArrayLike | None = None, u: ArrayLike | None = None
) -> DiscreteModel:
    r"""The discrete model with the same states at the sampling instants t0, t0+dt, t0+2dt.

    .. math:: \Phi = e^{F\,dt}, \quad Q_d = \int_0^{dt} e^{Fs}GQG^Te^{F^Ts}ds, \quad c = \int_0^{dt}e^{Fs}ds\,Bu

    Parameters
    ----------
    model : continuous model
    dt : period, s, > 0
    R : (m, m) or (steps+1, m, m), covariance of the sampled measurements, unit². Without it the measurements
        are those equivalent to the continuous ones, averages over the interval that follows: R = Rc/dt, and
        :math:`N = \frac1{dt}\int_0^{dt}e^{Fs}ds\,GN_c` where w and v correlate.
    u : (r,) or (steps, r), known input, constant over each interval

    Returns
    -------
    DiscreteModel with Phi (n, n), Qd (n, n), unit²

    Raises
    ------
    ValueError
        No R and no Rc; R together with N (a sampler's own noise has no such correlation); u without B.

    Source: Maybeck vol. 1, section 4.9 (equivalent discrete-time model).

    >>> m = ContinuousModel(F=[[0]], G=[[1]], Q=[[4]], H=[[1]], Rc=[[16]], P0=[[25]])
    >>> d = discretise(m, 0.5)
    >>> d.Qd, d.R
    (array([[2.]]), array([[32.]]))
    """
    _check.instance("model", model, ContinuousModel)
    Phi, Qd, Gamma = interval(model.F, model.G @ model.Q @ model.G.T, dt)
    if R is not None and model.N is not None:
        msg = "R: expected none beside the model's N, which correlates w with the noise of strength Rc; received R"
        raise ValueError(msg)
    if R is None:
        R = None if model.Rc is None else model.Rc / dt
    if R is None:
        msg = "R: expected the covariance of the sampled measurements (the model has no Rc), received None"
        raise ValueError(msg)
    offset = None
    if u is not None:
        if model.B is None:
            msg = "u: expected a model with B, received one without"
            raise ValueError(msg)
        r = model.B.shape[1]
        offset = _check.shaped("u", u, (r,), ("steps", r)) @ (Gamma @ model.B).T
    return DiscreteModel(
        Phi=Phi,
        Qd=Qd,
        H=model.H,
        R=R,
        x0=model.x0,
        P0=model.P0,
        dt=dt,
        N=None if model.N is None else Gamma @ model.G @ model.N / dt,
        offset=offset,
        states=model.states,
        measurements=model.measurements,
        units=model.units,
    )


def unit_triangular(Q: ArrayLike) -> tuple[Array, Array]:
    r"""The factors of :math:`Q = L\,\mathrm{diag}(d)\,L^T`, L unit lower triangular, d ≥ 0; Q may be singular.

    A direction without noise has d = 0 and a unit column in L.

    Parameters
    ----------
    Q : (n, n), symmetric nonnegative definite

    Returns
    -------
    L (n, n), d (n,)

    Source: Golub & Van Loan, *Matrix Computations*, section 4.1 (LDLᵀ).

    >>> unit_triangular([[1/3, 1/2], [1/2, 1]])[1]
    array([0.33333333, 0.25      ])
    """
    return ldl(_check.covariance("Q", Q, ("n", "n")))


def ldl(Q: Array) -> tuple[Array, Array]:
    """:func:`unit_triangular` of a matrix that is known to be a covariance."""
    n = len(Q)
    L, d, rest = np.eye(n), np.zeros(n), np.array(Q)
    for j in range(n):
        # What is left of a variance after the earlier columns is rounding below n·eps of the variance itself.
        if rest[j, j] <= 4 * n * np.finfo(float).eps * Q[j, j]:
            continue
        d[j] = rest[j, j]
        L[j + 1 :, j] = rest[j + 1 :, j] / d[j]
        rest[j + 1 :, j + 1 :] -= np.outer(L[j + 1 :, j], rest[j + 1 :, j])
    return L, d


def factor(Q: ArrayLike) -> Array:
    r"""The lower triangular :math:`\bar G` with :math:`\bar G\bar G^T = Q`: Cholesky's, and as good when Q is singular.

    White noise of unit variance times this factor has the covariance Q.

    >>> factor([[1.0, 1.0], [1.0, 1.0]])
    array([[1., 0.],
           [1., 0.]])
    """
    L, d = unit_triangular(Q)
    return L * np.sqrt(d)
