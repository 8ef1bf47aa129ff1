r"""What a wrong, simplified or reduced filter really does, by linear algebra alone: no data, no random numbers.

A filter runs on the model ``design`` while the data come from the model ``truth``. Its error is followed in the
coordinates (x, e), where x is the truth and :math:`e = \hat x - Cx` the error (C says what each state of the design
stands for). With :math:`A = \Phi_d - MH_d` (M is zero unless the design has N ≠ 0):

.. math:: e_k^+ = (I-KH_d)\,e_k^- + K(H_t-H_dC)\,x_k + Kv_k

.. math:: e_{k+1}^- = A\,e_k^+ + [\Phi_dC - C\Phi_t + M(H_t-H_dC)]\,x_k + c_d - Cc_t - Cw_k + Mv_k

Both brackets vanish where the design is right; then x leaves the equations, and the error of a good filter of an
unstable system is not lost as the small difference of two large numbers.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from ctlabs.analysis import following
from ctlabs.analysis.following import Map
from ctlabs.analysis.lasting import Reaching, reaching
from ctlabs.analysis.sources import everything
from ctlabs.filtering import steady as steady_state
from ctlabs.filtering.filter import covariances
from ctlabs.filtering.measured import begins
from ctlabs.filtering.results import Covariances, Mask
from ctlabs.linalg import checks, riccati
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import symmetric
from ctlabs.models import DiscreteModel, at, observability
from ctlabs.text import mode


@dataclass(frozen=True, slots=True, eq=False)
class TrueErrors:
    """Mean and covariance of the errors e = x̂ − Cx before and after an update: ``bias_…`` ([steps+1,] d), ``P_…`` ([steps+1,] d, d)."""

    bias_minus: Array
    bias_plus: Array
    P_minus: Array
    P_plus: Array

    @property
    def mse_minus(self) -> Array:
        """Mean square error before the update, P + bias biasᵀ, ([steps+1,] d, d)."""
        return self.P_minus + self.bias_minus[..., :, None] * self.bias_minus[..., None, :]

    @property
    def mse_plus(self) -> Array:
        """Mean square error after the update, P + bias biasᵀ, ([steps+1,] d, d)."""
        return self.P_plus + self.bias_plus[..., :, None] * self.bias_plus[..., None, :]


@dataclass(frozen=True, slots=True, eq=False)
class Actual(TrueErrors):
    r"""The true error of a filter, e = x̂ − Cx, over time; d is the order of the design.

    ``t`` (steps+1,) s · ``bias_minus``, ``bias_plus`` (steps+1, d), mean error before and after the update ·
    ``P_minus``, ``P_plus`` (steps+1, d, d), its covariance · ``claimed``, what the filter believes (its covariances)
    """

    t: Array
    claimed: Covariances


@dataclass(frozen=True, slots=True, eq=False)
class ActualSteady(TrueErrors):
    """The limits of :class:`Actual`.

    ``bias_minus``, ``bias_plus`` (d,) · ``P_minus``, ``P_plus`` (d, d) · ``K`` (d, m), the constant gain ·
    ``poles`` (d,), of the filter · ``claimed``, the steady state the design believes in (None for a gain given)
    """

    K: Array
    poles: NDArray[np.complex128]
    claimed: steady_state.SteadyState | None


def actual(
    truth: DiscreteModel,
    design: DiscreteModel,
    steps: int,
    *,
    compare: ArrayLike | None = None,
    gains: Covariances | None = None,
    first: int | None = None,
) -> Actual:
    r"""True bias and covariance of a filter that runs on ``design`` while the data come from ``truth``.

    Exact for linear models that differ in anything: matrices, order, inputs, start, variation with time, N.

    Parameters
    ----------
    truth, design : discrete models with equally many measurements and one period
    steps : number of periods
    compare : C, (d, n), which combination of the truth's states each state of the design estimates; may be left out
        where the orders are equal (identity)
    gains : to apply instead of those of the design's own filter; see :func:`fixed_gain`
    first : 1 (first measurement at t1) or 0 (at t0)

    Raises
    ------
    ValueError
        Orders differ and there is no ``compare``; numbers of measurements or periods differ; steps beyond a horizon.
    FloatingPointError
        The true covariance overflows: the step is in the message.

    A measurement that the truth does not make (R = ∞) is one the filter sees as missing.

    Source: Maybeck vol. 1, section 6.8 (performance analysis of suboptimal filters).

    >>> truth = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]], offset=[1])
    >>> forgets = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])
    >>> actual(truth, forgets, 30).bias_plus[-1].round(6)
    array([-0.618034])
    """
    C, steps = following.pair(truth, design, compare, steps)
    plan, used = following.plan(truth, design, steps, gains, begins(design, first))
    maps = following.maps(truth, design, C, plan.K, used)
    bias_minus, bias_plus = following.means(truth, design, C, maps)
    P_minus, P_plus = following.covariances(everything(truth), maps, used)
    return Actual(bias_minus, bias_plus, P_minus, P_plus, plan.t, plan)


def fixed_gain(design: DiscreteModel, K: ArrayLike, steps: int, first: int | None = None) -> Covariances:
    """What a filter with given gains does: its covariances are the true ones if ``design`` were the truth.

    Parameters
    ----------
    design : discrete model
    K : (n, m), constant, or (steps+1, n, m)
    steps, first : as for :func:`actual`

    >>> m = DiscreteModel([[0.5]], [[1]], [[1]], [[1]], x0=[0], P0=[[1]])
    >>> fixed_gain(m, [[0.3]], 1).P_plus[1].round(4)
    array([[0.7025]])
    """
    own, first = covariances(design, steps, first=first), begins(design, first)
    gains = checks.shaped("K", K, (design.n, design.m), (steps + 1, design.n, design.m))
    measured = np.array([np.isfinite(np.diag(at(design.R, k, 2))) & (k >= first) for k in range(steps + 1)])
    gains = np.where(measured[:, None, :], gains, 0.0)
    maps = following.maps(design, design, np.eye(design.n), gains, measured)
    P_minus, P_plus = following.covariances(everything(design), maps, measured)
    S = np.array([_innovation(design, P_minus[k], k, measured[k]) for k in range(steps + 1)])
    return Covariances(own.t, P_minus, P_plus, gains, S, measured)


def steady(
    truth: DiscreteModel, design: DiscreteModel, compare: ArrayLike | None = None, K: ArrayLike | None = None
) -> ActualSteady:
    """The limit of the true bias and covariance of a filter with the steady gain of ``design``, or the gain ``K``.

    The truth itself need not be stationary: what counts is the part of it that reaches the error. That part may hold
    stable modes, and constants (a bias of a sensor that the design does not know; its mean and variance at t0 enter).

    Parameters
    ----------
    truth, design : constant discrete models
    compare : (d, n), as for :func:`actual`
    K : (d, m), a constant gain instead of the steady one

    Raises
    ------
    ValueError
        There is no limit: the filter does not forget its errors (a pole on or outside the unit circle), or a mode of
        the truth that grows or wanders reaches the error; the message names the pole or the mode.

    >>> m = DiscreteModel([[0.78]], [[0.39]], [[1]], [[0.5]], x0=[0], P0=[[1]])
    >>> steady(m, m, K=[[0.3]]).P_plus.round(6)
    array([[0.33638]])
    """
    C, _ = following.pair(truth, design, compare, None)
    limit, gain, used = _steady_gain(truth, design, K)
    update = following.update(truth, design, C, gain, used, 0, whole=True)
    predict = following.predict(truth, design, C, used, 0, whole=True)
    n = truth.n
    cycle = predict.A @ update.A
    poles = np.sort_complex(np.linalg.eigvals(cycle[n:, n:])).astype(np.complex128)
    if (np.abs(poles) >= 1 - observability.MARGIN).any():
        if limit is not None and np.array_equal(C, np.eye(n)) and _same(truth, design):
            zero = np.zeros(n)  # a marginal mode without noise: ever smaller gains make its error vanish
            return ActualSteady(zero, zero, limit.P_minus, limit.P_plus, gain, poles, limit)
        worst = mode(poles[np.abs(poles).argmax()])
        msg = f"steady: expected a filter with every pole inside the unit circle, received the pole {worst}"
        raise ValueError(msg)
    part = reaching(truth, np.vstack([cycle[n:, :n], update.A[n:, :n]]))
    minus, plus = _limits(truth, part, update, predict, used, C)
    return ActualSteady(minus[0], plus[0], minus[1], plus[1], gain, poles, limit)


def _steady_gain(
    truth: DiscreteModel, design: DiscreteModel, K: ArrayLike | None
) -> tuple[steady_state.SteadyState | None, Array, Mask]:
    """The design's steady state (or None), the gain and the elements used."""
    made = np.isfinite(np.diag(truth.R))
    if K is not None:
        return None, checks.shaped("K", K, (design.n, design.m)), made & np.isfinite(np.diag(design.R))
    if not made.all():
        absent = np.where(made[:, None] & made, design.R, np.diag(np.where(made, 0.0, np.inf)))
        design = dataclasses.replace(design, R=absent, N=None if design.N is None else design.N * made)
    limit = steady_state.solve(design)
    return limit, limit.K, np.isfinite(np.diag(limit.S))


def _same(truth: DiscreteModel, design: DiscreteModel) -> bool:
    """Whether the design differs from the truth in its start at most."""
    pairs = [(truth.Phi, design.Phi), (truth.Qd, design.Qd), (truth.H, design.H), (truth.R, design.R)]
    pairs += [
        (np.zeros(1) if a is None else a, np.zeros(1) if b is None else b)
        for a, b in ((truth.N, design.N), (truth.offset, design.offset))
    ]
    return all(np.array_equal(a, b) or not (a.any() or b.any()) for a, b in pairs)


def _limits(
    truth: DiscreteModel, part: Reaching, update: Map, predict: Map, used: Mask, C: Array
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """(mean, covariance) of e before and after an update, in the limit."""
    n, r = truth.n, len(part.to_s)
    into = scipy.linalg.block_diag(part.to_s, np.eye(len(C)))
    back = scipy.linalg.block_diag(part.from_s, np.eye(len(C)))
    update_s = Map(into @ update.A @ back, into @ update.W, into @ update.V, into @ update.c)
    predict_s = Map(into @ predict.A @ back, into @ predict.W, into @ predict.V, into @ predict.c)
    whole = everything(truth)
    R, N = whole.R[np.ix_(used, used)], whole.N[:, used]
    cycle, still = predict_s.A @ update_s.A, np.zeros((r + len(C), r + len(C)))
    noise = _moved(symmetric(update_s.V @ R @ update_s.V.T), update_s, predict_s, truth.Qd, R, N)
    X = riccati.stationary(cycle, noise, continuous=False).P.high if noise.any() else still
    X_plus = symmetric(update_s.A @ X @ update_s.A.T + update_s.V @ R @ update_s.V.T)
    mean = np.linalg.solve(np.eye(len(cycle)) - cycle, predict_s.c)
    # The constants y add T y to e⁻, with T = (cycle of e) T + (what the coupling makes of y), and so to e⁺.
    E, couple = (predict.A @ update.A)[n:, n:], (predict.A @ update.A)[n:, :n] @ part.from_y
    T = np.linalg.solve(np.eye(len(C)) - E, couple)
    T_plus = update.A[n:, n:] @ T + update.A[n:, :n] @ part.from_y
    P_y, y = part.to_y @ truth.P0 @ part.to_y.T, part.to_y @ truth.x0
    return (
        (mean[r:] + T @ y, X[r:, r:] + T @ P_y @ T.T),
        ((update_s.A @ mean)[r:] + T_plus @ y, X_plus[r:, r:] + T_plus @ P_y @ T_plus.T),
    )


def _moved(X: Array, update: Map, predict: Map, Qd: Array, R: Array, N: Array) -> Array:
    """The joint covariance after a prediction; v_k sits in e_k⁺ already and correlates with w_k through N."""
    W, V = predict.W, predict.V
    with np.errstate(over="ignore", invalid="ignore"):  # the caller reports an overflow, with its step
        cross = predict.A @ update.V @ (R @ V.T + N.T @ W.T) + V @ N.T @ W.T
        return symmetric(predict.A @ X @ predict.A.T + W @ Qd @ W.T + V @ R @ V.T + cross + cross.T)


def _innovation(model: DiscreteModel, P: Array, k: int, used: Mask) -> Array:
    """Covariance of the innovation at k; inf on the diagonal for elements left out."""
    H, S = at(model.H, k, 2)[used], np.diag(np.full(model.m, np.inf))
    S[np.ix_(used, used)] = H @ P @ H.T + at(model.R, k, 2)[np.ix_(used, used)]
    return S
