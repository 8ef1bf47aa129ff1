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
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.linalg
import scipy.sparse.csgraph
from numpy.typing import ArrayLike, NDArray

from ctlabs.filtering import steady as steady_state
from ctlabs.filtering.algorithms import contract
from ctlabs.filtering.filter import covariances, planned
from ctlabs.filtering.measured import begins
from ctlabs.filtering.results import Covariances, Mask
from ctlabs.linalg import checks, riccati
from ctlabs.linalg.checks import Array
from ctlabs.linalg.correlated import regression
from ctlabs.models import ContinuousModel, DiscreteModel, at, observability
from ctlabs.models.discretisation import interval
from ctlabs.models.linear import check_inputs
from ctlabs.text import mode

#: Below this fraction of the terms it is the difference of, a coupling of the error to the truth is rounding.
ROUNDING = 1e-13
#: A mode of the truth is on the unit circle when Φ − λI is singular to this accuracy for a λ of modulus 1.
UNIT = 1e-12


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


@dataclass(frozen=True, slots=True, eq=False)
class Budget:
    """The error covariance as a sum over its sources.

    ``t`` (steps+1,) s · ``names``, of the sources · ``parts`` (sources, steps+1, d, d), what each adds to P_plus ·
    ``P_plus`` (steps+1, d, d), the covariance with all sources at work, computed at once and not as the sum ·
    ``states``, of the design
    """

    t: Array
    names: tuple[str, ...]
    parts: Array
    P_plus: Array
    states: tuple[str, ...]

    @property
    def variances(self) -> Array:
        """Contribution to the variance of each state, (sources, steps+1, d)."""
        return np.diagonal(self.parts, axis1=-2, axis2=-1)

    def table(self, k: int = -1) -> list[list[str | float]]:
        """Rows (source, contribution to the variance of each state) at step k; the last row is the total."""
        rows: list[list[str | float]] = [
            [name, *part.tolist()] for name, part in zip(self.names, self.variances[:, k], strict=True)
        ]
        return [*rows, ["total", *np.diag(self.P_plus[k]).tolist()]]


class Source(NamedTuple):
    """Independent random quantities: initial covariance, and noises (constant or per step)."""

    P0: Array
    Qd: Array
    R: Array
    N: Array


class _Map(NamedTuple):
    """X ← A X + W w + V v + c for X = (x, e)."""

    A: Array
    W: Array
    V: Array
    c: Array


class _Maps(NamedTuple):
    """``update[k]`` leads over the measurement at k, ``predict[k]`` from there to k+1; d is the order of e."""

    update: list[_Map]
    predict: list[_Map]
    d: int


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
    C, steps = _pair(truth, design, compare, steps)
    plan, used = _plan(truth, design, steps, gains, begins(design, first))
    maps = _maps(truth, design, C, plan.K, used)
    bias_minus, bias_plus = _means(truth, design, C, maps)
    P_minus, P_plus = _covariances(_all(truth), maps, used)
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
    maps = _maps(design, design, np.eye(design.n), gains, measured)
    P_minus, P_plus = _covariances(_all(design), maps, measured)
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
    C, _ = _pair(truth, design, compare, None)
    limit, gain, used = _steady_gain(truth, design, K)
    update = _update(truth, design, C, gain, used, 0, whole=True)
    predict = _predict(truth, design, C, used, 0, whole=True)
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
    part = _reaching(truth, np.vstack([cycle[n:, :n], update.A[n:, :n]]))
    minus, plus = _limits(truth, part, update, predict, used, C)
    return ActualSteady(minus[0], plus[0], minus[1], plus[1], gain, poles, limit)


def budget(
    model: DiscreteModel,
    steps: int,
    *,
    design: DiscreteModel | None = None,
    groups: Mapping[str, ArrayLike] | None = None,
    compare: ArrayLike | None = None,
    gains: Covariances | None = None,
    first: int | None = None,
) -> Budget:
    """The error covariance by source: initial uncertainty, process noises, measurement noises. The gains stay fixed.

    Quantities that correlate are one source: without ``groups`` every state's initial value, every state's
    process noise and every measurement's noise is a source of its own unless the model correlates it with another.

    Parameters
    ----------
    model : the truth
    steps : number of periods
    design : the model of the filter, when it is not ``model``
    groups : process noise sources instead: name → part of Qd, (n, n) or (steps, n, n); they must add up to Qd
    compare, gains, first : as for :func:`actual`

    Raises
    ------
    ValueError
        Groups that do not add up to Qd, or groups beside N ≠ 0; and whatever :func:`actual` refuses.

    Source: Maybeck vol. 1, section 6.8 (error budget).

    >>> m = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]], states=["x"], measurements=["z"])
    >>> [(name, round(variance, 6)) for name, variance in budget(m, 1).table()]
    [('initial x', 0.069444), ('noise on x', 0.006944), ('noise of z', 0.840278), ('total', 0.916667)]
    """
    design = model if design is None else design
    total = actual(model, design, steps, compare=compare, gains=gains, first=first)
    C, _ = _pair(model, design, compare, steps)
    plan, used = _plan(model, design, steps, gains, begins(design, first))
    maps = _maps(model, design, C, plan.K, used)
    found = sources(model, groups)
    parts = np.array([_covariances(source, maps, used)[1] for source in found.values()])
    return Budget(plan.t, tuple(found), parts, total.P_plus, design.states)


def steady_budget(
    model: DiscreteModel,
    *,
    design: DiscreteModel | None = None,
    groups: Mapping[str, ArrayLike] | None = None,
    compare: ArrayLike | None = None,
) -> Budget:
    """The limit of :func:`budget`: the result has one row, at t = ∞. What is left of an initial uncertainty is that of constants.

    Raises
    ------
    ValueError
        There is no limit (:func:`steady`); groups as for :func:`budget`.

    >>> m = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]], states=["x"], measurements=["z"])
    >>> [(name, round(variance, 6)) for name, variance in steady_budget(m).table()]
    [('noise on x', 0.17082), ('noise of z', 0.447214), ('total', 0.618034)]
    """
    design = model if design is None else design
    total = steady(model, design, compare)
    names, parts = [], []
    for name, source in sources(model, groups).items():
        R = np.where(np.isinf(model.R), model.R, source.R)
        alone = dataclasses.replace(
            model, P0=source.P0, Qd=source.Qd, R=R, N=source.N if source.N.any() else None, x0=np.zeros(model.n)
        )
        part = steady(alone, design, compare, K=total.K).P_plus
        if part.any():
            names.append(name)
            parts.append(part[None])
    of_each = np.array(parts).reshape(-1, 1, *total.P_plus.shape)
    return Budget(np.array([np.inf]), tuple(names), of_each, total.P_plus[None], design.states)


def noise_by_input(model: ContinuousModel, dt: float) -> dict[str, Array]:
    """The parts of Qd that come from each noise input of a continuous model: ``groups`` for :func:`budget`.

    Inputs that correlate are one source.

    >>> list(noise_by_input(ContinuousModel([[0]], [[1, 1]], [[1, 0], [0, 2]], [[1]], P0=[[0]]), 1.0).values())
    [array([[1.]]), array([[2.]])]
    """
    checks.instance("model", model, ContinuousModel)
    parts = {}
    for group in components(model.Q):
        G = model.G[:, group]
        name = "noise " + ", ".join(f"w{j + 1}" for j in group)
        parts[name] = interval(model.F, G @ model.Q[np.ix_(group, group)] @ G.T, dt).Qd
    return parts


def _pair(
    truth: DiscreteModel, design: DiscreteModel, compare: ArrayLike | None, steps: int | None
) -> tuple[Array, int]:
    """C, and the number of steps, of two models that can work on the same data (``steps`` None: constant models)."""
    checks.instance("truth", truth, DiscreteModel)
    checks.instance("design", design, DiscreteModel)
    if truth.m != design.m or truth.dt != design.dt:
        msg = (
            f"design: expected the truth's m = {truth.m} and dt = {truth.dt!r} s, "
            f"received m = {design.m} and dt = {design.dt!r} s"
        )
        raise ValueError(msg)
    check_inputs(truth, design)
    for name, model in (("truth", truth), ("design", design)):
        if steps is None and model.horizon is not None:
            msg = f"{name}: expected constant matrices, received some that vary over {model.horizon} steps"
            raise ValueError(msg)
        if steps is not None and model.horizon is not None and checks.count("steps", steps) > model.horizon:
            msg = f"steps: expected at most {model.horizon} (the {name} is given for so many), received {steps}"
            raise ValueError(msg)
    if compare is None and truth.n != design.n:
        msg = f"compare: expected a matrix of shape {(design.n, truth.n)} (the orders differ), received None"
        raise ValueError(msg)
    C = np.eye(truth.n) if compare is None else checks.shaped("compare", compare, (design.n, truth.n))
    return C, 0 if steps is None else checks.count("steps", steps)


def _plan(
    truth: DiscreteModel, design: DiscreteModel, steps: int, gains: Covariances | None, first: int
) -> tuple[Covariances, Mask]:
    """The gains, and the elements (steps+1, m) that both the filter uses and the truth measures."""
    made = np.array([np.isfinite(np.diag(at(truth.R, k, 2))) for k in range(steps + 1)])
    if gains is None:
        gains = planned(design, ~made, first)
    elif gains.K.shape != (steps + 1, design.n, design.m):
        msg = f"gains: expected gains of shape {(steps + 1, design.n, design.m)}, received {gains.K.shape}"
        raise ValueError(msg)
    return gains, gains.used & made


def _cross_gain(design: DiscreteModel, k: int, used: Mask) -> Array:
    """M = NR⁺ of the design: what its filter infers from z_k about w_k, (d, elements used)."""
    if design.N is None:
        return np.zeros((design.n, int(used.sum())))
    return regression(design.N[:, used], at(design.R, k, 2)[np.ix_(used, used)])


def _difference(a: Array, b: Array) -> Array:
    """a − b, exactly zero where rounding is all there is."""
    return np.where(np.abs(a - b) > ROUNDING * (np.abs(a) + np.abs(b)), a - b, 0.0)


def _update(
    truth: DiscreteModel, design: DiscreteModel, C: Array, K: Array, used: Mask, k: int, *, whole: bool
) -> _Map:
    """Over the measurement at k; without x unless ``whole``."""
    K, H_t, H_d = K[:, used], at(truth.H, k, 2)[used], at(design.H, k, 2)[used]
    n = truth.n if whole else 0
    coupling = K @ _difference(H_t, H_d @ C)
    A = np.block([[np.eye(n), np.zeros((n, design.n))], [coupling[:, :n], np.eye(design.n) - K @ H_d]])
    return _Map(A, np.zeros((n + design.n, truth.n)), np.vstack([np.zeros((n, K.shape[1])), K]), np.zeros(n + design.n))


def _predict(truth: DiscreteModel, design: DiscreteModel, C: Array, used: Mask, k: int, *, whole: bool) -> _Map:
    """From after the measurement at k to before that at k+1; without x unless ``whole``."""
    Phi_t, Phi_d, M = at(truth.Phi, k, 2), at(design.Phi, k, 2), _cross_gain(design, k, used)
    H_t, H_d = at(truth.H, k, 2)[used], at(design.H, k, 2)[used]
    n = truth.n if whole else 0
    coupling = _difference(Phi_d @ C, C @ Phi_t) + M @ _difference(H_t, H_d @ C)
    A = np.block([[Phi_t[:n, :n], np.zeros((n, design.n))], [coupling[:, :n], Phi_d - M @ H_d]])
    c_t, c_d = (np.zeros(m.n) if m.offset is None else at(m.offset, k, 1) for m in (truth, design))
    return _Map(
        A,
        np.vstack([np.eye(truth.n)[:n], -C]),
        np.vstack([np.zeros((n, M.shape[1])), M]),
        np.concatenate([c_t[:n], c_d - C @ c_t]),
    )


def _maps(truth: DiscreteModel, design: DiscreteModel, C: Array, K: Array, used: Mask) -> _Maps:
    """The maps of all steps; x is left out where it never reaches the error."""

    def all_maps(whole: bool) -> _Maps:
        return _Maps(
            [_update(truth, design, C, K[k], used[k], k, whole=whole) for k in range(len(K))],
            [_predict(truth, design, C, used[k], k, whole=whole) for k in range(len(K) - 1)],
            design.n,
        )

    n = truth.n
    if np.array_equal(C, np.eye(n)) and np.array_equal(truth.Phi, design.Phi) and np.array_equal(truth.H, design.H):
        return all_maps(whole=False)  # nothing couples
    joint = all_maps(whole=True)
    return joint if any(step.A[n:, :n].any() for step in (*joint.update, *joint.predict)) else all_maps(whole=False)


def _means(truth: DiscreteModel, design: DiscreteModel, C: Array, maps: _Maps) -> tuple[Array, Array]:
    """Mean of e before and after each update."""
    d, X = design.n, np.concatenate([truth.x0, design.x0 - C @ truth.x0])[-len(maps.predict[0].c) :]
    minus, plus = np.empty((len(maps.update), d)), np.empty((len(maps.update), d))
    for k, update in enumerate(maps.update):
        if k:
            X = maps.predict[k - 1].A @ X + maps.predict[k - 1].c
        minus[k] = X[-d:]
        X = update.A @ X
        plus[k] = X[-d:]
    return minus, plus


def _covariances(source: Source, maps: _Maps, used: Mask) -> tuple[Array, Array]:
    """Covariance of e before and after each update, as far as ``source`` makes it.

    By a root of it: of P0 = 1e14 R no more than the rounding of P0 would be left in the covariance itself.
    """
    d = maps.d
    checks.finite_start("the actual error", source.P0)
    L = maps.predict[0].W @ contract.rooted(source.P0)  # x0 enters (x, e) as w does: with I and −C
    minus, plus = np.empty((len(maps.update), d, d)), np.empty((len(maps.update), d, d))
    known: dict[bytes, Array] = {}
    constant = source.Qd.ndim == source.R.ndim == 2
    for k, update in enumerate(maps.update):
        key = used[k].tobytes()
        noises = known[key] if constant and key in known else _noises(source, k, used[k], last=k + 1 == len(maps.update))
        known[key] = noises
        v, w = np.split(noises, [int(used[k].sum())])
        with np.errstate(over="ignore", invalid="ignore"):  # reported below, with its step
            minus[k], after = _squared(L[-d:]), np.hstack([update.A @ L, update.V @ v])
            plus[k] = _squared(after[-d:])
            if not np.isfinite(minus[k]).all():
                msg = f"sensitivity: expected finite covariances, received an overflow at step {k}"
                raise FloatingPointError(msg)
            if k + 1 < len(maps.update):
                # v_k sits in e_k⁺ already, and correlates with w_k through N.
                predict = maps.predict[k]
                moved = predict.A @ after
                moved[:, L.shape[1] :] += predict.W @ w + predict.V @ v
                L = contract.triangular(moved) if np.isfinite(moved).all() else moved
    return minus, plus


def _noises(source: Source, k: int, used: Array, *, last: bool) -> Array:
    """A root of the joint covariance of v_k, as far as it is used, and w_k; nothing of w after the last instant."""
    R, N = at(source.R, k, 2)[np.ix_(used, used)], source.N[:, used]
    Qd = np.zeros((len(N), len(N))) if last and source.Qd.ndim == 3 else at(source.Qd, k, 2)
    N = N if Qd.any() else 0 * N
    return contract.rooted(np.block([[R, N.T], [N, Qd]]))


def _squared(L: Array) -> Array:
    return L @ L.T


def _moved(X: Array, update: _Map, predict: _Map, Qd: Array, R: Array, N: Array) -> Array:
    """The joint covariance after a prediction; v_k sits in e_k⁺ already and correlates with w_k through N."""
    W, V = predict.W, predict.V
    with np.errstate(over="ignore", invalid="ignore"):  # the caller reports an overflow, with its step
        cross = predict.A @ update.V @ (R @ V.T + N.T @ W.T) + V @ N.T @ W.T
        return _symmetric(predict.A @ X @ predict.A.T + W @ Qd @ W.T + V @ R @ V.T + cross + cross.T)


def _symmetric(P: Array) -> Array:
    return 0.5 * (P + P.T)


def _finite(R: Array) -> Array:
    return np.where(np.isfinite(R), R, 0.0)


def _all(model: DiscreteModel) -> Source:
    return Source(model.P0, model.Qd, _finite(model.R), np.zeros((model.n, model.m)) if model.N is None else model.N)


def _innovation(model: DiscreteModel, P: Array, k: int, used: Mask) -> Array:
    """Covariance of the innovation at k; inf on the diagonal for elements left out."""
    H, S = at(model.H, k, 2)[used], np.diag(np.full(model.m, np.inf))
    S[np.ix_(used, used)] = H @ P @ H.T + at(model.R, k, 2)[np.ix_(used, used)]
    return S


# The budget's sources ------------------------------------------------------------------------------------------------


def components(matrix: Array) -> list[list[int]]:
    """Indices that correlate, directly or through others."""
    count, label = scipy.sparse.csgraph.connected_components(matrix != 0, directed=False)
    return [np.flatnonzero(label == i).tolist() for i in range(count)]


def sources(model: DiscreteModel, groups: Mapping[str, ArrayLike] | None) -> dict[str, Source]:
    """Independent sources by name, in the order initial state, process noise, measurement noise."""
    checks.finite_start("an error budget", model.P0)
    n, m, everything = model.n, model.m, _all(model)
    nothing = Source(np.zeros((n, n)), np.zeros((n, n)), np.zeros((m, m)), np.zeros((n, m)))
    found: dict[str, Source] = {}

    def add(name: str, source: Source) -> None:
        if any(part.any() for part in source):
            found[name if name not in found else f"{name} ({len(found) + 1})"] = source

    for group in components(model.P0):
        add("initial " + ", ".join(model.states[i] for i in group), nothing._replace(P0=_block(model.P0, group, group)))
    for name, part in ({} if groups is None else _given(model, groups)).items():
        add(name, nothing._replace(Qd=part))
    Qd = np.zeros((n, n)) if groups is not None else everything.Qd
    Q, R = (np.abs(stack).reshape(-1, *stack.shape[-2:]).max(axis=0) for stack in (Qd, everything.R))
    for group in components(np.block([[Q, everything.N], [everything.N.T, R]])):
        w, v = [i for i in group if i < n], [i - n for i in group if i >= n]
        names = ["on " + ", ".join(model.states[i] for i in w)] if w else []
        names += ["of " + ", ".join(model.measurements[i] for i in v)] if v else []
        source = nothing._replace(Qd=_block(Qd, w, w), R=_block(everything.R, v, v), N=_block(everything.N, w, v))
        add("noise " + " and ".join(names), source)
    return found


def _block(matrix: Array, rows: list[int], columns: list[int]) -> Array:
    """``matrix`` (or each of a stack) with everything outside the block set to zero."""
    result = np.zeros_like(matrix)
    i, j = np.ix_(rows, columns)
    result[..., i, j] = matrix[..., i, j]
    return result


def _given(model: DiscreteModel, groups: Mapping[str, ArrayLike]) -> dict[str, Array]:
    """The user's parts of Qd, checked."""
    n = model.n
    if model.N is not None and model.N.any():
        msg = "groups: expected a model without N (process and measurement noise that correlate are one source)"
        raise ValueError(msg)
    parts = {name: checks.covariance(f"groups[{name}]", part, model.Qd.shape) for name, part in groups.items()}
    missing = np.abs(model.Qd - sum(parts.values(), np.zeros((n, n)))).max()
    if missing > checks.ROUNDING * np.abs(model.Qd).max():
        msg = f"groups: expected parts that add up to Qd, received a sum that differs from it by {missing:.3g}"
        raise ValueError(msg)
    return parts


# The steady state ----------------------------------------------------------------------------------------------------


class _Part(NamedTuple):
    """What of the truth reaches the error: x = from_y y + from_s s + (the rest); y constant, s stable.

    ``to_y``, ``to_s`` give y and s of x (as rows), ``from_y``, ``from_s`` their directions as the error sees them.
    """

    to_y: Array
    to_s: Array
    from_y: Array
    from_s: Array


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


def _reaching(truth: DiscreteModel, coupling: Array) -> _Part:
    """The smallest part of the truth that drives the error through ``coupling``: its constants and stable modes."""
    V = _rows(coupling)
    while len(wider := _rows(np.vstack([V, V @ truth.Phi]))) > len(V):
        V = wider
    one = np.eye(len(V))
    Phi = V @ truth.Phi @ V.T
    lasting = _lasting(Phi)
    to_y = _fixed(Phi.T).T if lasting else np.zeros((0, len(V)))
    if len(to_y) != len(lasting) or _moves(to_y @ V, truth):
        states = ", ".join(name for name, column in zip(truth.states, V.T, strict=True) if np.abs(column).max() > 1e-9)
        msg = (
            f"steady: expected stable modes and constants of the truth to drive the error, received the mode "
            f"{mode(max(lasting, key=abs))} of the states {states}, which grows or wanders: there is no limit"
        )
        raise ValueError(msg)
    from_y, S = np.zeros((len(V), 0)), one
    if lasting:
        from_y, S = _fixed(Phi), scipy.linalg.null_space(to_y)
        from_y = from_y @ np.linalg.inv(to_y @ from_y)
    # S spans an invariant subspace of Phi: s = Sᵀ(I − from_y to_y)Vx moves by SᵀΦS.
    return _Part(to_y @ V, S.T @ (one - from_y @ to_y) @ V, V.T @ from_y, V.T @ S)


def _moves(to_y: Array, truth: DiscreteModel) -> bool:
    """Whether noise or a known input enters the combinations ``to_y`` of the truth."""
    to_y = np.where(np.abs(to_y) > 1e-12 * np.abs(to_y).max(axis=1, keepdims=True), to_y, 0.0)
    inputs = np.column_stack([truth.Qd, np.zeros(truth.n) if truth.offset is None else truth.offset])
    return bool((np.abs(to_y @ inputs) > 1e-12 * np.abs(to_y) @ np.abs(inputs)).any())


def _rows(matrix: Array) -> Array:
    """Orthonormal basis (as rows) of the row space; rows of different units count alike."""
    size = np.linalg.norm(matrix, axis=1, keepdims=True)
    rows = matrix[size[:, 0] > 0] / size[size[:, 0] > 0]
    return scipy.linalg.orth(rows.T, rcond=1e-10).T if len(rows) else np.zeros((0, matrix.shape[1]))


def _fixed(Phi: Array) -> Array:
    """Orthonormal basis (as columns) of the vectors with Φx = x, to the accuracy of :func:`_lasting`."""
    _, sigma, rows = np.linalg.svd(Phi - np.eye(len(Phi)))
    return rows[sigma <= _unit(Phi)].T


def _lasting(Phi: Array) -> list[complex]:
    """The eigenvalues on or outside the unit circle.

    One of multiplicity j is computed with an error of the order eps^(1/j): a ramp's 1 may come out as 1 − 1e-8.
    """
    values = np.linalg.eigvals(Phi)
    found = []
    for value in values:
        short = 1 - abs(value)
        nearest = value / abs(value) if value else 1.0
        several = int((np.abs(values - nearest) <= 3 * short).sum())
        singular = np.linalg.svd(Phi - nearest * np.eye(len(Phi)), compute_uv=False)[-1] <= _unit(Phi)
        if short < 0 or (singular and short ** max(several, 1) <= 1e-14):
            found.append(complex(value))
    return found


def _unit(Phi: Array) -> float:
    return UNIT * max(1.0, np.abs(Phi).max())


def _limits(
    truth: DiscreteModel, part: _Part, update: _Map, predict: _Map, used: Mask, C: Array
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """(mean, covariance) of e before and after an update, in the limit."""
    n, r = truth.n, len(part.to_s)
    into = scipy.linalg.block_diag(part.to_s, np.eye(len(C)))
    back = scipy.linalg.block_diag(part.from_s, np.eye(len(C)))
    update_s = _Map(into @ update.A @ back, into @ update.W, into @ update.V, into @ update.c)
    predict_s = _Map(into @ predict.A @ back, into @ predict.W, into @ predict.V, into @ predict.c)
    everything = _all(truth)
    R, N = everything.R[np.ix_(used, used)], everything.N[:, used]
    cycle, still = predict_s.A @ update_s.A, np.zeros((r + len(C), r + len(C)))
    noise = _moved(_symmetric(update_s.V @ R @ update_s.V.T), update_s, predict_s, truth.Qd, R, N)
    X = riccati.stationary(cycle, noise, continuous=False).P.high if noise.any() else still
    X_plus = _symmetric(update_s.A @ X @ update_s.A.T + update_s.V @ R @ update_s.V.T)
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
