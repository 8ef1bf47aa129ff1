r"""Estimating a signal under a slowly varying error of measurement.

.. math:: y[k] = \lambda^T\varphi[k] + \mu^T\psi[k] + n[k], \quad \lambda \sim N(m_\lambda, K_\lambda),\
          \mu \sim N(m_\mu, K_\mu),\ n \sim N(0, K)

φ and ψ are known functions of the time, λ, μ and n independent. :func:`batch` takes all samples at once, with noise of
any covariance K; :func:`recursion` and the discrete filter of :func:`model` take one after the other, with white noise.
Where signal and error are states, :mod:`ctlabs.filtering.bias` estimates the error or takes it into account, and
:mod:`ctlabs.filtering.hypotheses` doubts it.

Source: Shapiro & Shchelkanovtsev, *Avtometriya* 1968, no. 6.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from ctlabs.filtering import measured
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.linalg.compiled import kernel
from ctlabs.linalg.factors import factor
from ctlabs.models import DiscreteModel
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

    >>> from ctlabs import kalman_filter
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
        x0=problem.mean, P0=problem.covariance, states=[*names("λ", problem.M), *names("μ", problem.L)], measurements=["y"],
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


def names(letter: str, count: int) -> list[str]:
    """Names of so many parameters: the letter, with an index where there are several."""
    return [letter] if count == 1 else [f"{letter}{i}" for i in range(count)]
