r"""A cost per second, seen at the sampling instants: exactly, what happens between them included.

Between two instants the input is held, so state and input together follow :math:`\dot\xi = \bar A\xi` with
:math:`\xi = (x, u)`, and the cost of one period is a quadratic form of what they were at its beginning:

.. math:: \begin{bmatrix}Q_x^d & N^d\\ N^{dT} & Q_u^d\end{bmatrix}
          = \int_0^h e^{\bar A^Ts}\begin{bmatrix}Q_x & N\\ N^T & Q_u\end{bmatrix}e^{\bar As}\,ds, \qquad
          \bar A = \begin{bmatrix}F & B\\ 0 & 0\end{bmatrix}

The cross term :math:`N^d` is not zero where N is. What the noise adds between the instants does not depend on the inputs:

.. math:: c = \int_0^h \mathrm{tr}\,Q_xQ_d(s)\,ds = \mathrm{tr}\,GQG^T\!\int_0^h (h-\tau)\,e^{F^T\tau}Q_xe^{F\tau}\,d\tau
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import symmetric
from ctlabs.linalg.exponential import interval
from ctlabs.models.cost import Cost, Weights
from ctlabs.models.discretisation import discretise
from ctlabs.models.linear import ContinuousModel, DiscreteModel
from ctlabs.regulation.augmented import weighed

#: A part of a period below this fraction of it is the rounding of the delay.
INSTANT = 1e-12
#: The longest delay, in periods: each of them adds as many states as there are inputs.
LONGEST = 100


class SampledProblem(NamedTuple):
    """A model and its cost at the sampling instants; ``cost`` is per step: divide by ``model.dt`` for the mean per second.

    With a delay the states of ``model`` are those of the plant and then the inputs that are still on their way, the latest first.
    """

    model: DiscreteModel
    cost: Cost


def sample(
    model: ContinuousModel,
    cost: Cost,
    dt: float,
    *,
    R: ArrayLike | None = None,
    average: bool = False,
    delay: float = 0.0,
) -> SampledProblem:
    r"""The discrete model and cost that are equal to a continuous model and its cost under an input held for a period.

    Parameters
    ----------
    model : with B
    cost : per second; a horizon, in seconds, is a whole number of periods
    dt : period h, s
    R, average : the sampled measurements, as for :func:`ctlabs.discretise`: their covariance, or exact averages
    delay : from the measurement to the moment at which the input that follows from it begins to act, s; less or more than a period.
        The inputs on their way become states

    Returns
    -------
    SampledProblem ``(model, cost)``: the cost has the exact cross term N, and what the noise adds between the samples as ``cost.constant``

    Raises
    ------
    ValueError
        No B; weights that vary; a discount (sample without, and give it to the discrete cost); a horizon that is not a whole number of
        periods; and whatever :func:`ctlabs.discretise` refuses.

    Source: Åström & Wittenmark, *Computer-Controlled Systems* (1997), section 11.1 and 3.2 (delays).

    >>> walk = ContinuousModel([[0]], [[1]], [[1]], [[1]], B=[[1]], P0=[[1]])
    >>> model, cost = sample(walk, Cost([[1]], [[0]]), dt=0.5, R=[[0]])
    >>> [float(M[0, 0].round(6)) for M in (cost.Qx, cost.N, cost.Qu)], cost.constant
    ([0.5, 0.125, 0.041667], 0.125)
    """
    checks.instance("model", model, ContinuousModel)
    checks.instance("cost", cost, Cost)
    h, late = checks.positive("dt", dt), checks.nonnegative("delay", delay)
    weights = _constant(cost, model)
    if average and late:
        msg = "average: expected no delay beside it (an average is known a period later already), received one"
        raise ValueError(msg)
    plain = discretise(model, h, R=R, average=average)
    constant = h * cost.constant + between(model, weights.Qx, h)
    steps = _steps(cost, h)
    if not late:
        Qx, N, Qu = _split(_weights(model, weights.joint, h), model.n)
        Qf = None if steps is None else weights.Qf
        return SampledProblem(plain, Cost(Qx, Qu, N, Qf, steps, constant=constant))
    return _delayed(model, weights, plain, late, constant, steps)


def between(model: ContinuousModel, Qx: Array, h: float) -> float:
    """What noise adds to the cost within one period that begins in a known state.

    >>> walk = ContinuousModel([[0]], [[1]], [[1]], [[1]], P0=[[1]])
    >>> between(walk, np.eye(1), 2.0)
    2.0
    """
    n, W = model.n, model.G @ model.Q @ model.G.T
    if not W.any() or not Qx.any():
        return 0.0
    # With e^{As} = [[E, sE], [0, E]], E = e^{F's}, one interval has both the integral of EQxE' and that of sEQxE'.
    A = np.block([[model.F.T, np.eye(n)], [np.zeros((n, n)), model.F.T]])
    both = interval(A, np.block([[np.zeros((n, 2 * n))], [np.zeros((n, n)), Qx]]), h).Qd
    return max(0.0, float((W * (h * both[n:, n:] - symmetric(both[:n, n:]))).sum()))


def _constant(cost: Cost, model: ContinuousModel) -> Weights:
    """The weights, which do not vary."""
    weights = cost.weights(model)
    if weights.Qx.ndim == 3:
        msg = "cost: expected constant weights of a continuous model, received some that vary"
        raise ValueError(msg)
    if cost.discount != 1:
        msg = f"discount: expected 1 in a cost that is sampled, received {cost.discount:g} (give it to the discrete cost)"
        raise ValueError(msg)
    return weights


def _steps(cost: Cost, h: float) -> int | None:
    """The horizon in periods."""
    if cost.horizon is None:
        return None
    steps = round(cost.horizon / h)
    if steps < 1 or abs(cost.horizon - steps * h) > 1e-9 * cost.horizon:
        msg = f"horizon: expected a whole number of periods of {h:g} s, received {cost.horizon:g} s ({cost.horizon / h:g} periods)"
        raise ValueError(msg)
    return steps


def _weights(model: ContinuousModel, joint: Array, h: float) -> Array:
    """The weights of one period, (n+r, n+r)."""
    assert model.B is not None
    n, r = model.n, model.r
    A = np.block([[model.F, model.B], [np.zeros((r, n + r))]])
    return interval(A.T, joint, h).Qd


def _split(joint: Array, n: int) -> tuple[Array, Array, Array]:
    """Qx, N, Qu of a joint weight."""
    return joint[:n, :n], joint[:n, n:], joint[n:, n:]


def _moved(model: ContinuousModel, h: float) -> tuple[Array, Array]:
    """Φ and Γ over a part of a period; over none, I and 0."""
    assert model.B is not None
    if not h:
        return np.eye(model.n), np.zeros((model.n, model.r))
    over = interval(model.F, np.zeros_like(model.F), h)
    return over.Phi, over.Gamma @ model.B


def _delayed(
    model: ContinuousModel, weights: Weights, plain: DiscreteModel, late: float, constant: float, steps: int | None
) -> SampledProblem:
    """The sampled model with the inputs on their way among its states."""
    h, n, r = plain.dt, model.n, model.r
    whole, part = divmod(late / h, 1.0)
    if part > 1 - INSTANT:
        whole, part = whole + 1, 0.0
    d, f = int(whole), 0.0 if part < INSTANT else part * h
    if d > LONGEST:
        msg = f"delay: expected at most {LONGEST} periods of {h:g} s, received {late:g} s"
        raise ValueError(msg)
    past = d + (f > 0)
    size = n + past * r

    def place(j: int) -> Array:
        """The rows that pick u[k−j] from (x, past inputs, u): j = 0 is the present one."""
        begin = size if j == 0 else n + (j - 1) * r
        found = np.zeros((r, size + r))
        found[:, begin : begin + r] = np.eye(r)
        return found

    x = np.hstack([np.eye(n), np.zeros((n, size + r - n))])
    (Phi1, Gamma1), (Phi2, Gamma2) = _moved(model, f), _moved(model, h - f)
    middle = Phi1 @ x + (Gamma1 @ place(d + 1) if f else 0.0)
    end = Phi2 @ middle + Gamma2 @ place(d)
    total = np.zeros((size + r, size + r))
    for begin, length, j in ((x, f, d + 1), (middle, h - f, d)):
        if length:
            both = np.vstack([begin, place(j)])
            total = total + both.T @ _weights(model, weights.joint, length) @ both
    on_way = np.vstack([place(j) for j in range(past)])
    grown = np.vstack([end, on_way])
    acting = place(d + 1 if f else d)  # at the instant of the measurement
    D = np.zeros((model.m, r)) if model.D is None else model.D
    H = np.hstack([model.H, np.zeros((model.m, size - n))]) + D @ acting[:, :size]
    wide: dict[str, Any] = {
        "Phi": grown[:, :size],
        "B": grown[:, size:],
        "D": None,
        "H": H,
        "Qd": weighed(plain.Qd, size - n),
        "N": None if plain.N is None else np.vstack([plain.N, np.zeros((size - n, model.m))]),
        "x0": np.concatenate([model.x0, np.zeros(size - n)]),
        "P0": weighed(model.P0, size - n),
        "states": model.states + tuple(f"input {i + 1}, {j} before" for j in range(1, past + 1) for i in range(r)),
        "units": model.units + ("",) * (size - n),
    }
    Qx, N, Qu = _split(symmetric(total), size)
    Qf = None if steps is None else weighed(weights.Qf, size - n)
    return SampledProblem(replace(plain, **wide), Cost(Qx, Qu, N, Qf, steps, constant=constant))

