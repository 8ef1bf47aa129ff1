r"""Estimating a signal under a slowly varying error of measurement.

.. math:: y[k] = \lambda^T\varphi[k] + \mu^T\psi[k] + n[k], \quad \lambda \sim N(m_\lambda, K_\lambda),\
          \mu \sim N(m_\mu, K_\mu),\ n \sim N(0, K)

φ and ψ are known functions of the time, λ, μ and n independent. :func:`batch` takes all samples at once, with noise of
any covariance K; :func:`recursion` and the discrete filter of :func:`model` take one after the other, with white noise.
The rest is for a signal and an error that are states: an error estimated beside the signal (:func:`augmented`), in a
filter of its own (:func:`separate_bias`), taken into account without being estimated (:func:`consider`), or doubted
(:func:`hypotheses`).

Source: Shapiro & Shchelkanovtsev, *Avtometriya* 1968, no. 6.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from ctlabs.filtering import measured
from ctlabs.filtering.filter import covariances, kalman_filter
from ctlabs.filtering.measured import begins
from ctlabs.filtering.problem import rows_of
from ctlabs.filtering.results import Covariances, Filtered, consistency
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.linalg.compiled import kernel
from ctlabs.linalg.factors import factor
from ctlabs.models import DiscreteModel, at
from ctlabs.models.linear import DEFAULT

#: Samples that are whitened and triangularised at a time, so that memory stays small.
CHUNK = 65_536


@dataclass(frozen=True, slots=True, eq=False)
class SlowError:
    r"""A signal λᵀφ, a slowly varying error μᵀψ and noise n, at N instants; L = 0 (``psi`` None) is no slow error.

    Parameters
    ----------
    phi : (N, M), regressors of the signal, row k is φ[k]
    psi : (N, L), regressors of the slow error, or ``None``
    noise : covariance of n, unit²: a number (white), (N,) variances (white; ``inf`` = no sample), (N, N) (coloured)
    K_lambda, K_mu : (M, M), (L, L), prior covariances; they may be singular
    m_lambda, m_mu : (M,), (L,), prior means, zeros by default

    Raises
    ------
    ValueError, TypeError
        Shapes that do not fit, a covariance that is none, a noise without variance.

    Source: Shapiro & Shchelkanovtsev 1968, eq. (8), where the printed form lacks λᵀ.

    >>> s = SlowError(phi=[[1], [1]], psi=[[1], [1]], noise=1000, K_lambda=[[100]], K_mu=[[50]])
    >>> s.N, s.M, s.L, s.white
    (2, 1, 1, True)
    """

    phi: Array
    psi: Array
    noise: Array
    K_lambda: Array
    K_mu: Array = DEFAULT
    m_lambda: Array = DEFAULT
    m_mu: Array = DEFAULT

    if TYPE_CHECKING:  # what may be given: anything array-like; what is read: arrays

        def __init__(
            self,
            phi: ArrayLike,
            psi: ArrayLike | None,
            noise: ArrayLike,
            K_lambda: ArrayLike,
            K_mu: ArrayLike | None = None,
            m_lambda: ArrayLike | None = None,
            m_mu: ArrayLike | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        def put(name: str, value: Array) -> None:
            value.setflags(write=False)
            object.__setattr__(self, name, value)

        put("phi", phi := checks.shaped("phi", self.phi, ("N", "M")))
        N, M = phi.shape
        psi: Any = self.psi
        put("psi", np.zeros((N, 0)) if psi is None else checks.shaped("psi", self.psi, (N, "L")))
        L = self.L
        put("K_lambda", checks.covariance("K_lambda", self.K_lambda, (M, M)))
        if self.K_mu is None and L:
            msg = f"K_mu: expected shape ({L}, {L}) beside psi, received None"
            raise ValueError(msg)
        put("K_mu", np.zeros((0, 0)) if not L else checks.covariance("K_mu", self.K_mu, (L, L)))
        put("m_lambda", np.zeros(M) if self.m_lambda is None else checks.shaped("m_lambda", self.m_lambda, (M,)))
        put("m_mu", np.zeros(L) if self.m_mu is None else checks.shaped("m_mu", self.m_mu, (L,)))
        put("noise", _noise(self.noise, N))

    @property
    def N(self) -> int:
        """Number of samples."""
        return self.phi.shape[0]

    @property
    def M(self) -> int:
        """Number of parameters of the signal."""
        return self.phi.shape[1]

    @property
    def L(self) -> int:
        """Number of parameters of the slow error."""
        return self.psi.shape[1]

    @property
    def white(self) -> bool:
        """Whether the noise is given by its variances."""
        return self.noise.ndim < 2

    @property
    def mean(self) -> Array:
        """Prior mean of (λ, μ), (M+L,)."""
        return np.concatenate([self.m_lambda, self.m_mu])

    @property
    def covariance(self) -> Array:
        """Prior covariance of (λ, μ), (M+L, M+L)."""
        return scipy.linalg.block_diag(self.K_lambda, self.K_mu)

    def ignoring(self) -> SlowError:
        """The same signal and noise for an estimator that knows of no slow error."""
        return SlowError(self.phi, None, self.noise, self.K_lambda, None, self.m_lambda)


@dataclass(frozen=True, slots=True, eq=False)
class Posterior:
    r"""Posterior distribution of (λ, μ), its covariance :math:`P = FR^{-1}R^{-T}F^T` kept in factors.

    ``mean`` (M+L[, runs]) · ``F`` (M+L, M+L), factor of the prior covariance · ``R`` (M+L, M+L), upper triangular,
    root of the information about the normalised parameters · ``M``, how many of them belong to the signal
    """

    mean: Array
    F: Array
    R: Array
    M: int

    @property
    def lam(self) -> Array:
        """Estimate of λ, (M[, runs])."""
        return self.mean[: self.M]

    @property
    def mu(self) -> Array:
        """Estimate of μ, (L[, runs])."""
        return self.mean[self.M :]

    @property
    def P(self) -> Array:
        """Covariance of the error of (λ̂, μ̂), (M+L, M+L)."""
        root = self._root(np.eye(len(self.F)))
        return root.T @ root

    def combination(self, c: ArrayLike) -> tuple[Array, Array]:
        """Estimate and error variance of cᵀ(λ, μ) for a row c, or rows (q, M+L); small variances keep their digits."""
        c = np.atleast_2d(checks.shaped("c", c, (len(self.F),), ("q", len(self.F))))
        return c @ self.mean, np.sum(self._root(c.T) ** 2, axis=0)

    def signal(self, phi: ArrayLike) -> tuple[Array, Array]:
        r"""ŝ[N, k] and its risk R[N] for the regressors φ[N], (M,) or (q, M), of any instants, past or to come.

        .. math:: \hat s[N,k] = \varphi^T[N]\hat\lambda[k], \quad R[N] = \varphi^T[N]P_{\lambda\lambda}\varphi[N]

        Source: Shapiro & Shchelkanovtsev 1968, eq. (11), (15).
        """
        phi = np.atleast_2d(checks.shaped("phi", phi, (self.M,), ("q", self.M)))
        return self.combination(np.column_stack([phi, np.zeros((len(phi), len(self.F) - self.M))]))

    def _root(self, c: Array) -> Array:
        """R⁻ᵀFᵀc, whose squared length is the variance of cᵀ(λ, μ)."""
        return np.asarray(scipy.linalg.solve_triangular(self.R, self.F.T @ c, trans="T"))


@dataclass(frozen=True, slots=True, eq=False)
class Recursion:
    """Estimates after some numbers of samples.

    ``k`` (q,), how many · ``x`` (q, M+L) · ``P`` (q, M+L, M+L) · ``K`` (q, M+L), gain on the last of them
    """

    k: Array
    x: Array
    P: Array
    K: Array


def batch(problem: SlowError, y: ArrayLike) -> Posterior:
    r"""The Bayesian estimate from all samples at once.

    With the normalised parameters ξ, (λ, μ) = m + Fξ and FFᵀ the prior covariance, and with the noise whitened by
    Cholesky's factor C of K, the estimate is the least-squares solution of

    .. math:: \begin{pmatrix} C^{-1}(\Phi_\lambda\ \Phi_\mu)F \\ I \end{pmatrix}\xi =
              \begin{pmatrix} C^{-1}(y - \Phi_\lambda m_\lambda - \Phi_\mu m_\mu) \\ 0 \end{pmatrix}

    by orthogonal transformations. It is that of equations (11), (12), (15), in which differences of information
    matrices cancel as the samples become many. White noise costs O(N(M+L)²) time and no N×N matrix.

    Parameters
    ----------
    problem : regressors, noise, priors
    y : (N,) or (N, runs), samples; NaN = none, in all runs alike

    Raises
    ------
    ValueError
        y of another length; infinite samples; NaN in some runs only.

    Source: Shapiro & Shchelkanovtsev 1968, eq. (11), (12), (15); Bierman, *Factorization Methods* (1977), ch. IV.

    >>> s = SlowError([[1]] * 4, [[1]] * 4, 1000, [[100]], [[50]])
    >>> e = batch(s, [13, 13, 13, 13])
    >>> e.mean.round(4), e.P.round(4)
    (array([3.25 , 1.625]), array([[ 75.  , -12.5 ],
           [-12.5 ,  43.75]]))
    """
    data = _samples(problem, y)
    used = ~np.isnan(data[:, 0])
    F = scipy.linalg.block_diag(*(factor(K) for K in (problem.K_lambda, problem.K_mu) if len(K)))
    n = len(F)
    R, d = np.zeros((1, n)), np.zeros((1, data.shape[1]))  # start with a zero row, so that an empty record works
    for A, b in _whitened(problem, data, used):
        Q, R = np.linalg.qr(np.vstack([R, A @ F]))
        d = Q.T @ np.vstack([d, b])
    R, d = _informative(R, d, problem.N)
    # The informative rows first and the columns by size: then the prior's ones survive beside any number of samples.
    Q, R, order = scipy.linalg.qr(np.vstack([R, np.eye(n)]), mode="economic", pivoting=True)
    xi = scipy.linalg.solve_triangular(R, Q[: len(d)].T @ d)
    mean = problem.mean[:, None] + F[:, order] @ xi
    return Posterior(mean[:, 0] if np.ndim(y) == 1 else mean, F[:, order], R, problem.M)


def model(problem: SlowError) -> DiscreteModel:
    r"""The discrete model of random constants whose filter is the recursive form of :func:`batch`.

    .. math:: x = (\lambda, \mu),\ \Phi = I,\ Q_d = 0,\ H_k = (\varphi^T\ \psi^T)

    The prior stands at k = 0 and sample k = 1…N is row k−1 of the problem.

    Raises
    ------
    ValueError
        Coloured noise: its shaping filter belongs into the state.

    Source: Shapiro & Shchelkanovtsev 1968, eq. (16)–(19) with Φ = Ψ = I.

    >>> s = SlowError([[1]] * 4, [[1]] * 4, 1000, [[100]], [[50]])
    >>> kalman_filter(model(s), [13, 13, 13, 13]).x_plus[-1].round(4)
    array([3.25 , 1.625])
    """
    _white(problem, "model")
    H = np.hstack([problem.phi, problem.psi])[:, None, :]
    H, R = np.concatenate([H[:1], H]), np.broadcast_to(problem.noise, problem.N)[:, None, None]
    constant = problem.noise.ndim == 0 and bool((H == H[0]).all())
    n = problem.M + problem.L
    return DiscreteModel(
        np.eye(n), np.zeros((n, n)), H[0] if constant else H, R[0] if constant else np.concatenate([R[:1], R]),
        x0=problem.mean, P0=problem.covariance, states=[*_names("λ", problem.M), *_names("μ", problem.L)], measurements=["y"],
    )  # fmt: skip


def record(y: ArrayLike) -> Array:
    """Samples (N,) or (N, runs) as the discrete filter wants them: (N, 1[, runs])."""
    return np.asarray(y, dtype=np.float64)[:, None]


def recursion(problem: SlowError, y: ArrayLike, keep: ArrayLike | None = None) -> Recursion:
    r"""The recursive estimate by Potter's square-root update, compiled: a million samples in a fraction of a second.

    The same numbers as the filter of :func:`model`, at O((M+L)²) flops a sample. With P = SSᵀ and f = Sᵀh,

    .. math:: K = \frac{Sf}{f^Tf + r}, \quad S^+ = S - \frac{Sff^T}{f^Tf + r + \sqrt{r(f^Tf + r)}}

    Parameters
    ----------
    problem : with white noise
    y : (N,), samples; NaN = none
    keep : numbers of samples (increasing, 1…N) after which the estimate is kept; all by default

    Raises
    ------
    ValueError
        Coloured noise; y of another length; ``keep`` out of order.

    Source: Maybeck vol. 1, section 7.3 (Potter).

    >>> s = SlowError([[1]] * 4, [[1]] * 4, 1000, [[100]], [[50]])
    >>> recursion(s, [13, 13, 13, 13], keep=[1, 4]).x.round(4)
    array([[1.1304, 0.5652],
           [3.25  , 1.625 ]])
    """
    _white(problem, "recursion")
    data = _samples(problem, y)
    if np.ndim(y) != 1:
        msg = f"y: expected one record of shape ({problem.N},), received {np.shape(y)}"
        raise ValueError(msg)
    kept = (
        np.arange(1, problem.N + 1) if keep is None else np.array(checks.shaped("keep", keep, ("q",)), dtype=np.int64)
    )
    if not len(kept) or kept[0] < 1 or kept[-1] > problem.N or (np.diff(kept) < 1).any():
        msg = f"keep: expected increasing whole numbers from 1 to {problem.N}, received {np.asarray(keep).tolist()}"
        raise ValueError(msg)
    n = problem.M + problem.L
    x, P, K = np.empty((len(kept), n)), np.empty((len(kept), n, n)), np.empty((len(kept), n))
    rows = np.hstack([problem.phi, problem.psi])
    S = scipy.linalg.block_diag(*(factor(C) for C in (problem.K_lambda, problem.K_mu) if len(C)))
    variances = np.ascontiguousarray(np.broadcast_to(problem.noise, problem.N))
    compiled()(rows, variances, data[:, 0], problem.mean, np.ascontiguousarray(S), kept, x, P, K)
    return Recursion(kept, x, P, K)


# A slow error that is a state ----------------------------------------------------------------------------------------


def augmented(signal: DiscreteModel, G: ArrayLike, P_b: ArrayLike, m_b: ArrayLike | None = None) -> DiscreteModel:
    r"""The signal's model with a constant error of measurement b as further states: z = Hx + Gb + v.

    Parameters
    ----------
    signal : model of the signal and its noises (the error need not be constant: put a varying one into the signal)
    G : (m, L) or (steps+1, m, L), how b enters the measurements
    P_b, m_b : (L, L), (L,), prior covariance and mean of b

    Source: Shapiro & Shchelkanovtsev 1968, the block matrices before eq. (30).

    >>> walk = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])
    >>> augmented(walk, [[1]], [[4]]).H
    array([[1., 1.]])
    """
    P_b, m_b, G = _bias(signal, G, P_b, m_b)
    L = len(m_b)
    return replace(
        signal,
        Phi=_corner(signal.Phi, L, 1.0),
        Qd=_corner(signal.Qd, L, 0.0),
        H=_beside(signal.H, G),
        x0=np.concatenate([signal.x0, m_b]),
        P0=scipy.linalg.block_diag(signal.P0, P_b),
        offset=None if signal.offset is None else np.pad(signal.offset, [*[(0, 0)] * (signal.offset.ndim - 1), (0, L)]),
        N=None if signal.N is None else np.vstack([signal.N, np.zeros((L, signal.m))]),
        states=(*signal.states, *_names("b", L)),
        units=(*signal.units, *[""] * L),
    )


@dataclass(frozen=True, slots=True, eq=False)
class SeparateBias:
    """Friedland's two filters and what they give together.

    ``x`` (steps+1, n, runs), signal · ``b`` (steps+1, L, runs), slow error · ``P`` (steps+1, n+L, n+L), covariance of
    both after the update · ``free``, the filter that knows no error · ``bias``, the filter of the error, whose
    measurements are the innovations of the first · ``V`` (steps+1, n, L), what the error b does to the first
    """

    x: Array
    b: Array
    P: Array
    free: Filtered
    bias: Filtered
    V: Array


def separate_bias(
    signal: DiscreteModel, G: ArrayLike, P_b: ArrayLike, z: ArrayLike, m_b: ArrayLike | None = None, first: int | None = None
) -> SeparateBias:
    r"""The augmented filter in two: one of the signal as if there were no error, one of the error alone.

    The innovations of the error-free filter are :math:`\nu_k = B_kb + (\text{white, covariance } \tilde S_k)` with

    .. math:: U_k = \Phi V_{k-1}, \quad B_k = HU_k + G, \quad V_k = U_k - \tilde KB_k, \qquad
              \hat x = \tilde x + V\hat b, \quad P_x = \tilde P + VMV^T, \quad P_{xb} = VM

    where M is the covariance of b̂. The error filter has L states instead of n + L.

    Parameters
    ----------
    signal, G, P_b, m_b : as for :func:`augmented` (signal without N)
    z : (rows, m[, runs]), measurements; NaN = none

    Raises
    ------
    ValueError
        A signal with correlated noises N.

    Source: Friedland, "Treatment of bias in recursive filtering", *IEEE Trans. AC-14* (1969).

    >>> walk = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])
    >>> z = [[[1.0]], [[2.0]]]
    >>> both = kalman_filter(augmented(walk, [[1]], [[4]]), z)
    >>> bool(np.allclose(separate_bias(walk, [[1]], [[4]], z).x[-1], both.x_plus[-1, :1]))
    True
    """
    P_b, m_b, G = _bias(signal, G, P_b, m_b)
    _uncorrelated(signal, "separate_bias")
    data, first = rows_of(z, signal.m)[0], begins(signal, first)
    free = kalman_filter(signal, data, first=first)
    plan, L = free, len(m_b)
    V, B = np.zeros((plan.steps + 1, signal.n, L)), np.zeros((plan.steps + 1, signal.m, L))
    for k in range(plan.steps + 1):
        U = at(signal.Phi, k - 1, 2) @ V[k - 1] if k else V[0]
        B[k] = at(signal.H, k, 2) @ U + at(G, k, 2)
        V[k] = U - plan.K[k] @ B[k]
    still = DiscreteModel(np.eye(L), np.zeros((L, L)), B, plan.S, x0=m_b, P0=P_b, dt=signal.dt, states=_names("b", L))
    bias = kalman_filter(still, free.innovation[first:], first=first)
    M, b = bias.P_plus, bias.x_plus
    cross = V @ M
    P = np.block([[plan.P_plus + cross @ np.swapaxes(V, 1, 2), cross], [np.swapaxes(cross, 1, 2), M]])
    return SeparateBias(free.x_plus + V @ b, b, P, free, bias, V)


def consider(
    signal: DiscreteModel, G: ArrayLike, P_b: ArrayLike, steps: int, first: int | None = None
) -> tuple[DiscreteModel, Covariances]:
    r"""The Schmidt–Kalman filter: the error b is never estimated, but its variance and correlation are accounted for.

    .. math:: K = \begin{pmatrix} (P_{xx}H^T + P_{xb}G^T)S^{-1} \\ 0 \end{pmatrix}, \quad S = TPT^T + R,\ T = (H\ G)

    with P by Joseph's form, which is right for any gain. Returns the augmented model and the gains; apply them by
    ``kalman_filter(model, z, gains=gains)``, or give both to :mod:`ctlabs.analysis.sensitivity` and :mod:`ctlabs.montecarlo`.

    Raises
    ------
    ValueError
        A signal with correlated noises N.

    Source: Schmidt (1966); Bierman, *Factorization Methods* (1977), section VIII.2.

    >>> walk = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])
    >>> whole, plan = consider(walk, [[1]], [[4]], 3)
    >>> plan.K[1].round(4).tolist(), plan.P_plus[3, 1, 1].round(9)
    ([[0.6875], [0.0]], np.float64(4.0))
    """
    _uncorrelated(signal, "consider")
    whole = augmented(signal, G, P_b)
    own = covariances(whole, steps, first=first)  # which elements are used, and nothing else
    n, P = whole.n, whole.P0
    P_minus, P_plus, K, S = np.empty((steps + 1, n, n)), np.empty((steps + 1, n, n)), np.zeros_like(own.K), own.S.copy()
    for k in range(steps + 1):
        if k:
            Phi = at(whole.Phi, k - 1, 2)
            P = Phi @ P @ Phi.T + at(whole.Qd, k - 1, 2)
        P_minus[k], used = P, own.used[k]
        T, R = at(whole.H, k, 2)[used], at(whole.R, k, 2)[np.ix_(used, used)]
        inner = T @ P @ T.T + R
        S[k][np.ix_(used, used)] = inner
        K[k][: signal.n, used] = np.linalg.solve(inner, T @ P[:, : signal.n]).T
        rest = np.eye(n) - K[k][:, used] @ T
        P = rest @ P @ rest.T + K[k][:, used] @ R @ K[k][:, used].T
        P = P_plus[k] = 0.5 * (P + P.T)
    return whole, Covariances(own.t, P_minus, P_plus, K, S, own.used)


@dataclass(frozen=True, slots=True, eq=False)
class Hypotheses:
    """How probable each model is, given the measurements up to k.

    ``t`` (steps+1,) s · ``probability`` (steps+1, models, runs) · ``log_likelihood`` (steps+1, models, runs), of all
    measurements up to k · ``filters``, one :class:`~ctlabs.filtering.results.Filtered` for each model
    """

    t: Array
    probability: Array
    log_likelihood: Array
    filters: tuple[Filtered, ...]

    def mixture(self, compare: Sequence[ArrayLike]) -> tuple[Array, Array]:
        """Mean (steps+1, d, runs) and covariance (steps+1, d, d, runs) of what ``compare`` (d, n_i) selects of each state.

        The covariance adds the spread of the estimates about their common mean to the filters' own.
        """
        selected = [np.asarray(C, dtype=np.float64) for C in compare]
        means = [C @ one.x_plus for C, one in zip(selected, self.filters, strict=True)]
        own = [C @ one.P_plus @ C.T for C, one in zip(selected, self.filters, strict=True)]
        weights = [self.probability[:, i, None, :] for i in range(len(self.filters))]
        mean = sum((w * x for w, x in zip(weights, means, strict=True)), np.zeros_like(means[0]))
        cov = np.zeros((*own[0].shape, mean.shape[-1]))
        for w, x, P in zip(weights, means, own, strict=True):
            e = x - mean
            cov += w[:, None] * (P[..., None] + e[:, :, None] * e[:, None])
        return mean, cov


def hypotheses(
    models: Sequence[DiscreteModel], z: ArrayLike, prior: ArrayLike | None = None, first: int | None = None
) -> Hypotheses:
    r"""A bank of filters, one of which is right all the time, and the probability of each.

    .. math:: p_i(k) \propto p_i(0)\prod_{j\le k} N(\nu_j^{(i)}; 0, S_j^{(i)})

    in logarithms, so that a model that looked hopeless can recover. (filterpy's ``MMAEFilterBank`` is not used: it
    multiplies likelihoods, which underflow, gives one H to all filters, and sums P over states instead of filters.)

    Parameters
    ----------
    models : discrete models of the same measurements, of any orders
    z : (rows, m[, runs]), measurements; NaN = none
    prior : probabilities before any measurement, equal by default

    Raises
    ------
    ValueError
        Fewer than two models; probabilities that are negative or do not add up to 1; models that measure different things; a
        record that contradicts them all (:mod:`ctlabs.filtering.contradictions`).

    Source: Magill, "Optimal adaptive estimation of sampled stochastic processes", *IEEE Trans. AC-10* (1965).

    >>> still = DiscreteModel([[1]], [[0]], [[1]], [[1]], x0=[0], P0=[[1]])
    >>> other = DiscreteModel([[1]], [[0]], [[1]], [[1]], x0=[5], P0=[[1]])
    >>> hypotheses([still, other], [[4.0], [6.0]]).probability[:, :, 0].round(3)
    array([[0.5  , 0.5  ],
           [0.023, 0.977],
           [0.   , 1.   ]])
    """
    if len(models) < 2:
        msg = f"models: expected two or more, received {len(models)}"
        raise ValueError(msg)
    p = np.full(len(models), 1 / len(models)) if prior is None else checks.shaped("prior", prior, (len(models),))
    if (p < 0).any() or abs(p.sum() - 1) > 1e-9:
        msg = f"prior: expected probabilities that add up to 1, received {p.tolist()}"
        raise ValueError(msg)
    first = begins(models[0], first)
    filters = tuple(kalman_filter(one, rows_of(z, one.m)[0], first=first) for one in models)
    if any(not np.array_equal(one.used, filters[0].used) for one in filters):
        msg = "models: expected the same elements measured by all, received models that use different ones"
        raise ValueError(msg)
    log = np.stack([np.cumsum(_log_likelihoods(one, first), axis=0) for one in filters], axis=1)
    with np.errstate(divide="ignore"):  # a probability of 0 stays 0
        score = log + np.log(p)[:, None]
    best = score.max(axis=1, keepdims=True)
    if np.isneginf(best).any():
        k = int(np.argwhere(np.isneginf(best))[0, 0]) - first
        msg = f"z: expected a record that is possible for one of the models, received one that contradicts all by row {k}"
        raise ValueError(msg)
    weight = np.exp(score - best)
    return Hypotheses(filters[0].t, weight / weight.sum(axis=1, keepdims=True), log, filters)


# Parts ---------------------------------------------------------------------------------------------------------------


def _noise(noise: ArrayLike, N: int) -> Array:
    """The noise as a variance, variances or a covariance, checked."""
    if np.ndim(noise) == 2:
        return checks.covariance("noise", noise, (N, N))
    found = checks.shaped("noise", noise, (), (N,), finite=False)
    if (found <= 0).any():
        msg = f"noise: expected variances > 0, received {found.min():.6g}"
        raise ValueError(msg)
    return found


def _samples(problem: SlowError, y: ArrayLike) -> Array:
    """The samples as (N, runs), NaN where there are none."""
    data = np.array(y, dtype=np.float64)
    if data.ndim not in (1, 2) or len(data) != problem.N:
        msg = f"y: expected shape ({problem.N},) or ({problem.N}, runs), received {np.shape(y)}"
        raise ValueError(msg)
    data = data.reshape(problem.N, -1)
    measured.gaps(data[:, None, :])
    if problem.white:
        data[np.broadcast_to(np.isinf(problem.noise), problem.N)] = np.nan
    return data


def _whitened(problem: SlowError, data: Array, used: Array) -> Any:
    """Chunks of the regressors and of the centred samples, with noise of unit covariance."""
    rows = [problem.phi, problem.psi]
    if not problem.white:
        try:
            C = scipy.linalg.cholesky(problem.noise[np.ix_(used, used)], lower=True)
        except np.linalg.LinAlgError:
            msg = "noise: expected a positive definite covariance, received a singular one"
            raise ValueError(msg) from None
        A = np.hstack([part[used] for part in rows])
        b = data[used] - (A @ problem.mean)[:, None]
        yield tuple(scipy.linalg.solve_triangular(C, part, lower=True) for part in (A, b))
        return
    sd = np.sqrt(np.broadcast_to(problem.noise, problem.N))[:, None]
    for start in range(0, problem.N, CHUNK):
        part = slice(start, start + CHUNK)
        kept = used[part]
        A = np.hstack([block[part][kept] for block in rows])
        b = data[part][kept] - (A @ problem.mean)[:, None]
        yield A / sd[part][kept], b / sd[part][kept]


def _informative(R: Array, d: Array, N: int) -> tuple[Array, Array]:
    """The rows of a triangular root of information without those that are the rounding of N samples.

    Samples that tell of fewer combinations than there are parameters leave rows of rounding beside right-hand sides of
    any size. A true row as small is nothing beside the prior's ones.
    """
    Q, R, order = scipy.linalg.qr(R, mode="economic", pivoting=True)
    size = np.abs(np.diag(R))
    kept = size > np.finfo(float).eps * np.sqrt(N) * len(R) * size.max(initial=0.0)
    rows = np.empty_like(R)
    rows[:, order] = R
    return rows[kept], (Q.T @ d)[kept]


def _white(problem: SlowError, who: str) -> None:
    if not problem.white:
        msg = f"{who}: expected white noise (variances), received a covariance; put its shaping filter into the state"
        raise ValueError(msg)


def _uncorrelated(signal: DiscreteModel, who: str) -> None:
    if signal.N is not None and signal.N.any():
        msg = f"{who}: expected a signal without N (noises that correlate), received one"
        raise ValueError(msg)


def _names(letter: str, count: int) -> list[str]:
    return [letter] if count == 1 else [f"{letter}{i}" for i in range(count)]


def _bias(signal: DiscreteModel, G: ArrayLike, P_b: ArrayLike, m_b: ArrayLike | None) -> tuple[Array, Array, Array]:
    """P_b, m_b, G, checked against the signal."""
    checks.instance("signal", signal, DiscreteModel)
    P_b = checks.covariance("P_b", P_b, ("L", "L"))
    L = len(P_b)
    m_b = np.zeros(L) if m_b is None else checks.shaped("m_b", m_b, (L,))
    return P_b, m_b, checks.shaped("G", G, (signal.m, L), ("steps+1", signal.m, L))


def _beside(H: Array, G: Array) -> Array:
    """(H G), either of which may vary with time."""
    spans = [len(one) for one in (H, G) if one.ndim == 3]
    if not spans:
        return np.hstack([H, G])
    if len(set(spans)) > 1:
        msg = f"G: expected {spans[0]} instants as H has, received {spans[1]}"
        raise ValueError(msg)
    return np.concatenate([np.broadcast_to(one, (spans[0], *one.shape[-2:])) for one in (H, G)], axis=-1)


def _corner(matrix: Array, L: int, diagonal: float) -> Array:
    """The matrix, or each of a stack, with L more rows and columns that hold ``diagonal`` on theirs."""
    n = matrix.shape[-1]
    result = np.zeros((*matrix.shape[:-2], n + L, n + L))
    result[..., :n, :n] = matrix
    result[..., n:, n:] = diagonal * np.eye(L)
    return result


def _log_likelihoods(one: Filtered, first: int) -> Array:
    """log N(ν; 0, S) of every step and run, (steps+1, runs); 0 where nothing is measured."""
    found = np.zeros((len(one.t), one.z.shape[2]))
    found += consistency(one.innovation, one.S, one.used & ~np.isnan(one.innovation).all(axis=2))[1]
    for each in one.contradictions:  # impossible for this model from there on
        found[each.row + first, each.run] = -np.inf
    return found


def potter(rows: Array, r: Array, y: Array, x0: Array, S: Array, keep: Array, xs: Array, Ps: Array, Ks: Array) -> None:
    """Potter's update for one sample after another; plain Python that numba compiles."""
    n, x, f, K, kept = len(x0), x0.copy(), np.zeros(len(x0)), np.zeros(len(x0)), 0
    S = S.copy()
    for k in range(keep[-1]):
        K[:] = 0.0
        if not np.isnan(y[k]):
            alpha, residual = r[k], y[k]
            for j in range(n):
                f[j] = 0.0
                for i in range(n):
                    f[j] += S[i, j] * rows[k, i]
                alpha += f[j] * f[j]
                residual -= rows[k, j] * x[j]
            b = 1.0 / (1.0 + np.sqrt(r[k] / alpha))
            for i in range(n):
                for j in range(n):
                    K[i] += S[i, j] * f[j]
                K[i] /= alpha
                x[i] += K[i] * residual
                for j in range(n):
                    S[i, j] -= b * K[i] * f[j]
        if k + 1 == keep[kept]:
            for i in range(n):
                xs[kept, i], Ks[kept, i] = x[i], K[i]
                for j in range(n):
                    Ps[kept, i, j] = 0.0
                    for m in range(n):
                        Ps[kept, i, j] += S[i, m] * S[j, m]
            kept += 1


@cache
def compiled() -> Callable[..., None]:
    """:func:`potter` compiled once, and kept on disk."""
    quick: Callable[..., None] = kernel(potter)
    return quick
