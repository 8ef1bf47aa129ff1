r"""The linear quadratic regulator: what to do with a state that is known.

.. math:: u_k = -L x_k - L_w w_k, \quad L = \tilde Q^{-1}(B^TS\Phi + N^T), \quad L_w = \tilde Q^{-1}B^TS, \quad \tilde Q = B^TSB + Q_u

.. math:: S = \Phi^TS\Phi + Q_x - (\Phi^TSB + N)\tilde Q^{-1}(\Phi^TSB + N)^T

(in continuous time :math:`L = Q_u^{-1}(B^TS + N^T)`). This is the filter's equation of the transposed system, Φ → Φᵀ, H → Bᵀ,
Q_d → Q_x, R → Q_u, and it is solved by the filter's solver (:mod:`ctlabs.linalg.riccati`), with its bound of the error. L_w is for
those who know something of the disturbance when they act: a measurement whose noise correlates with it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.filtering import bucy
from ctlabs.linalg import checks, riccati
from ctlabs.linalg.checks import Array
from ctlabs.linalg.correlated import regression
from ctlabs.linalg.covariance import symmetric
from ctlabs.linalg.factors import ldl, root
from ctlabs.models import at, observability
from ctlabs.models.cost import Cost, Weights
from ctlabs.models.linear import ContinuousModel, DiscreteModel


@dataclass(frozen=True, slots=True, eq=False)
class Feedback:
    r"""A regulator of a known state, u = −L x.

    ``L`` (r, n), or (steps, r, n) over a finite horizon, or (points, r, n) at given times of it · ``S`` (n, n) or (steps+1, n, n) or
    (points, n, n): :math:`x^TSx` is what the rest will cost without noise · ``L_w`` (r, n) or (steps, r, n), the gain on a known
    disturbance, zero in continuous time · ``weight`` (r, r) or (steps, r, r), Q̃, what a unit of wrong input costs · ``poles`` (n,) of
    the closed loop, ascending; empty over a finite horizon · ``error``, a bound of the error of S,
    :math:`|dS_{ij}| \le error\sqrt{S_{ii}S_{jj}}`
    """

    L: Array
    S: Array
    L_w: Array
    weight: Array
    poles: Array
    error: float


def lqr(
    model: ContinuousModel | DiscreteModel, cost: Cost, *, t: ArrayLike | None = None, stabilise: bool = False
) -> Feedback:
    """The optimal feedback of a known state.

    Parameters
    ----------
    model : with B; a discrete one may vary with time if the horizon is finite
    cost : its horizon decides between the steady regulator and that of a finite horizon; its discount counts
    t : (points,), s from the beginning, the times at which a continuous regulator of finite horizon is wanted
    stabilise : what becomes of a mode that grows and that the cost does not see: it may grow (which costs nothing, so there is no
        regulator to compute: refused), or is brought to rest with the least effort (``True``)

    Returns
    -------
    Feedback

    Raises
    ------
    ValueError
        No B; a mode that the inputs do not reach and that does not decay; one that the cost does not see and that does not decay: it is
        named. Qu singular in continuous time.

    Source: Anderson & Moore, *Optimal Control: Linear Quadratic Methods* (1990), chapters 2 and 3; with a known disturbance: Åström,
    *Introduction to Stochastic Control Theory* (1970), section 8.4.

    >>> model = DiscreteModel([[1]], [[1]], [[1]], [[1]], B=[[1]], P0=[[1]])
    >>> lqr(model, Cost([[1]], [[1]])).L.round(6)
    array([[0.618034]])
    """
    checks.instance("cost", cost, Cost)
    if not isinstance(model, ContinuousModel):
        checks.instance("model", model, DiscreteModel)
    weights = cost.weights(model)
    if t is not None and (cost.horizon is None or isinstance(model, DiscreteModel)):
        msg = "t: expected a continuous model and a cost with a horizon beside times, received none"
        raise ValueError(msg)
    if isinstance(model, DiscreteModel):
        if cost.horizon is not None:
            steps = whole_steps(cost)
            assert steps is not None
            return _finite(model, weights, steps, math.sqrt(cost.discount))
        return _steady(model, weights, math.sqrt(cost.discount), stabilise)
    _positive(weights.Qu)
    if cost.horizon is not None:
        return _in_time(model, weights, cost, t)
    return _steady(model, weights, 0.5 * math.log(cost.discount), stabilise)


def whole_steps(cost: Cost) -> int | None:
    """The horizon of a discrete cost, a whole number of steps; ``None``: for ever.

    >>> whole_steps(Cost([[1]], [[1]], horizon=3))
    3
    """
    if cost.horizon is None:
        return None
    return checks.count("horizon", int(cost.horizon) if cost.horizon == int(cost.horizon) else cost.horizon)


def _positive(Qu: Array) -> None:
    """Refuse a singular Qu of a continuous model."""
    scale = np.sqrt(np.diag(Qu))
    if not scale.all() or (ldl(Qu / np.outer(scale, scale))[1] <= 0).any():
        msg = (
            "Qu: expected a positive definite matrix in continuous time, received a singular one (an input that costs nothing would be "
            "infinite; sample the model, or weigh every input)"
        )
        raise ValueError(msg)


def _steady(model: ContinuousModel | DiscreteModel, w: Weights, factor: float, stabilise: bool) -> Feedback:
    """The steady regulator; ``factor``, √β in discrete, ½ log β in continuous time."""
    continuous = isinstance(model, ContinuousModel)
    _constant(model, w)
    assert model.B is not None
    plant = model.F if isinstance(model, ContinuousModel) else model.Phi
    A, B = (plant + factor * np.eye(model.n), model.B) if continuous else (factor * plant, factor * model.B)
    _reached(A, B, model.states, continuous)
    _seen(A, B, w, model.states, continuous, stabilise)
    try:
        found = riccati.solve(A.T, B.T, w.Qx, w.Qu, w.N, continuous=continuous)
    except ValueError as error:
        msg = f"regulator: {error}"
        raise ValueError(msg) from None
    S, L = found.P.high.copy(), found.K.T.copy()
    weight = w.Qu if continuous else symmetric(B.T @ S @ B) + w.Qu
    L_w = np.zeros_like(L) if continuous else factor * regression(S @ B, weight).T
    poles = np.sort_complex(np.linalg.eigvals(plant - model.B @ L))
    return Feedback(L, S, L_w, np.array(weight), poles, found.error)


def _constant(model: ContinuousModel | DiscreteModel, w: Weights) -> None:
    """Refuse what varies where a limit is sought."""
    varies = w.Qx.ndim == 3 or (isinstance(model, DiscreteModel) and model.horizon is not None)
    if varies:
        msg = "regulator: expected constant matrices and weights for a steady regulator, received some that vary (give the cost a horizon)"
        raise ValueError(msg)


def _reached(A: Array, B: Array, states: tuple[str, ...], continuous: bool) -> None:
    """Refuse a mode that does not decay and that no input reaches."""
    unseen = observability.ROUNDED if continuous else observability.UNSEEN
    if lost := observability.undetectable(A.T, B.T, continuous, unseen):
        which = "Re(eigenvalue) >= 0" if continuous else "|eigenvalue| >= 1"
        msg = (
            f"regulator: expected every mode with {which} to be reached by an input, received the {_mode(lost[0], states)}, "
            "which none reaches: nothing can stabilise it"
        )
        raise ValueError(msg)


def _seen(A: Array, B: Array, w: Weights, states: tuple[str, ...], continuous: bool, stabilise: bool) -> None:
    """Refuse a mode that does not decay and that the cost does not see."""
    M = regression(w.N, w.Qu).T
    C = root(symmetric(w.Qx - w.N @ M)).T
    unseen = observability.undetectable(A - B @ M, C, continuous)
    grows = [abs(mode.value) > 1 + observability.MARGIN if not continuous else mode.value.real > 0 for mode in unseen]
    lasting = [mode for mode, grown in zip(unseen, grows, strict=True) if not grown]
    if lasting:
        msg = (
            f"regulator: expected every mode that does not decay to be seen by the cost, received the {_mode(lasting[0], states)}, "
            "which it does not see: the cost is the same whether it stays or comes to rest (give one of these states a weight)"
        )
        raise ValueError(msg)
    if unseen and not stabilise:
        msg = (
            f"regulator: expected every mode that grows to be seen by the cost, received the {_mode(unseen[0], states)}, which it "
            "does not see: to let it grow costs nothing, to bring it to rest costs inputs (stabilise=True does so with the least effort)"
        )
        raise ValueError(msg)


def _mode(mode: observability.Mode, states: tuple[str, ...]) -> str:
    return f"mode {mode.name(states)}"


def _finite(model: DiscreteModel, w: Weights, steps: int, factor: float) -> Feedback:
    """The regulator of a finite number of steps, backwards from the last."""
    given = {"the model": model.horizon, "the weights": len(w.Qx) if w.Qx.ndim == 3 else None}
    for what, most in given.items():
        if most is not None and most < steps:
            msg = f"horizon: expected at most {most} steps, for which {what} is given, received {steps}"
            raise ValueError(msg)
    assert model.B is not None
    n, r = model.n, model.r
    S, L, L_w = np.empty((steps + 1, n, n)), np.empty((steps, r, n)), np.empty((steps, r, n))
    weight = np.empty((steps, r, r))
    S[steps] = w.Qf
    for k in range(steps - 1, -1, -1):
        Phi, B = factor * at(model.Phi, k, 2), factor * at(model.B, k, 2)
        Qx, Qu, N = at(w.Qx, k, 2), at(w.Qu, k, 2), at(w.N, k, 2)
        reach = S[k + 1] @ B
        weight[k] = symmetric(B.T @ reach) + Qu
        L[k], L_w[k] = regression(Phi.T @ reach + N, weight[k]).T, factor * regression(reach, weight[k]).T
        loop, NL = Phi - B @ L[k], N @ L[k]
        S[k] = symmetric(loop.T @ S[k + 1] @ loop + Qx - NL - NL.T + L[k].T @ Qu @ L[k])
        if not np.isfinite(S[k]).all():
            msg = f"regulator: expected finite costs, received an overflow {steps - k} steps before the end"
            raise FloatingPointError(msg)
    return Feedback(L, S, L_w, weight, np.zeros(0, dtype=complex), 0.0)


def _in_time(model: ContinuousModel, w: Weights, cost: Cost, t: ArrayLike | None) -> Feedback:
    """The regulator of a finite time: the Kalman-Bucy filter of the transposed system, with time running back from the end."""
    assert model.B is not None
    assert cost.horizon is not None
    _constant(model, w)
    times = np.linspace(0.0, cost.horizon, 101) if t is None else checks.shaped("t", t, ("points",))
    if times.size and not 0 <= times.min() <= times.max() <= cost.horizon:
        msg = f"t: expected times from 0 to the horizon, {cost.horizon:g} s, received {times.min():g} to {times.max():g} s"
        raise ValueError(msg)
    n = model.n
    A = model.F + 0.5 * math.log(cost.discount) * np.eye(n)
    dual = ContinuousModel(A.T, np.eye(n), w.Qx, model.B.T, Rc=w.Qu, N=w.N if w.N.any() else None, P0=w.Qf)
    left, order = np.unique(cost.horizon - times, return_inverse=True)
    found = bucy.transient(dual, left)
    S, L = found.P[order], np.swapaxes(found.K, 1, 2)[order]
    weight = np.broadcast_to(w.Qu, (len(times), *w.Qu.shape))
    return Feedback(L, S, np.zeros_like(L), weight, np.zeros(0, dtype=complex), 0.0)
