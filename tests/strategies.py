"""Random models and records for hypothesis.

What shrinks is the structure (dimensions and features, drawn one by one, the plain case first); the numbers come from a
seed through numpy's Generator, so that an example stays well scaled while hypothesis simplifies it.
A feature is ``True``, ``False`` or, by default, ``None``: hypothesis chooses.
"""

from __future__ import annotations

from typing import Any

import hypothesis.strategies as st
import numpy as np
from numpy.typing import NDArray

from ctlabs.models import ContinuousModel, DiscreteModel
from tests.reference import at, cross_at, offset_at

Array = NDArray[Any]

seeds = st.integers(0, 2**32 - 1)


def covariance(rng: np.random.Generator, n: int, rank: int | None = None, size: float = 1.0) -> Array:
    """A random covariance of the given rank; of full rank it is well conditioned."""
    rank = n if rank is None else rank
    root = rng.normal(size=(n, rank))
    return size * (root @ root.T + (0.3 * np.eye(n) if rank == n else 0.0))


def transition(rng: np.random.Generator, n: int, stable: bool) -> Array:
    """A random matrix with spectral radius in (0.3, 0.95), or in (1.02, 1.3) if not ``stable``."""
    matrix = rng.normal(size=(n, n))
    radius = np.abs(np.linalg.eigvals(matrix)).max()
    return matrix * (rng.uniform(0.3, 0.95) if stable else rng.uniform(1.02, 1.3)) / radius


def _chosen(draw: st.DrawFn, feature: bool | None) -> bool:
    return draw(st.booleans()) if feature is None else feature


@st.composite
def discrete_models(
    draw: st.DrawFn,
    *,
    stable: bool | None = True,
    singular: bool | None = None,
    varying: bool | None = None,
    correlated: bool | None = None,
    offset: bool | None = None,
    max_n: int = 4,
    max_m: int = 3,
    steps: int = 6,
) -> DiscreteModel:
    """A discrete model, given for ``steps`` steps if it varies; ``singular`` lowers the ranks of Qd and P0 (R stays definite)."""
    n, m = draw(st.integers(1, max_n)), draw(st.integers(1, max_m))
    varies, correlates = _chosen(draw, varying), _chosen(draw, correlated)
    steady, deficient, driven = _chosen(draw, stable), _chosen(draw, singular), _chosen(draw, offset)
    rank_Q, rank_P = (draw(st.integers(0, n - 1)), draw(st.integers(0, n))) if deficient else (n, n)
    rng = np.random.default_rng(draw(seeds))
    count = steps if varies else 1
    Phi = np.array([transition(rng, n, steady) for _ in range(count)])
    H = rng.normal(size=(count + varies, m, n))
    R = np.array([covariance(rng, m) for _ in range(count + varies)])
    W = np.array([covariance(rng, n, rank_Q) for _ in range(count)])
    N = 0.5 * rng.normal(size=(n, m)) if correlates else None
    Qd = W if N is None else W + np.array([N @ np.linalg.solve(R[k], N.T) for k in range(count)])
    c = rng.normal(size=(count, n)) if driven else None
    return DiscreteModel(
        Phi=Phi if varies else Phi[0],
        Qd=Qd if varies else Qd[0],
        H=H if varies else H[0],
        R=R if varies else R[0],
        x0=rng.normal(size=n),
        P0=covariance(rng, n, rank_P),
        dt=rng.uniform(0.1, 2.0),
        N=N,
        offset=None if c is None else c if varies else c[0],
    )


@st.composite
def continuous_models(
    draw: st.DrawFn,
    *,
    stable: bool | None = True,
    singular: bool | None = None,
    correlated: bool | None = None,
    driven: bool | None = None,
    max_n: int = 4,
    max_m: int = 3,
) -> ContinuousModel:
    """A continuous model; ``stable`` puts the rightmost eigenvalue in (−2, −0.1), else in (0.05, 0.5)."""
    n, m, s = draw(st.integers(1, max_n)), draw(st.integers(1, max_m)), draw(st.integers(1, max_n))
    correlates, steady = _chosen(draw, correlated), _chosen(draw, stable)
    deficient, has_input = _chosen(draw, singular), _chosen(draw, driven)
    rank_Q, rank_P = (draw(st.integers(0, s - 1)), draw(st.integers(0, n))) if deficient else (s, n)
    rng = np.random.default_rng(draw(seeds))
    F = rng.normal(size=(n, n))
    right = np.linalg.eigvals(F).real.max()
    F -= (right + (rng.uniform(0.1, 2.0) if steady else -rng.uniform(0.05, 0.5))) * np.eye(n)
    Rc, W = covariance(rng, m), covariance(rng, s, rank_Q)
    N = 0.5 * rng.normal(size=(s, m)) if correlates else None
    return ContinuousModel(
        F=F,
        G=rng.normal(size=(n, s)),
        Q=W if N is None else W + N @ np.linalg.solve(Rc, N.T),
        H=rng.normal(size=(m, n)),
        Rc=Rc,
        N=N,
        B=rng.normal(size=(n, rng.integers(1, 3))) if has_input else None,
        x0=rng.normal(size=n),
        P0=covariance(rng, n, rank_P),
    )


def root(covariance: Array) -> Array:
    """A factor A of a covariance, AAᵀ, by its eigenvectors (singular ones too)."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(values.clip(0))


def record(model: Any, steps: int, rng: np.random.Generator, gaps: float = 0.0, first: int = 1) -> Array:
    """One record of measurements (steps+1, m) drawn from the model; elements are lost with probability ``gaps``."""
    n, m = len(model.x0), model.H.shape[-2]
    x = model.x0 + root(model.P0) @ rng.normal(size=n)
    z = np.empty((steps + 1, m))

    def factor(k: int) -> Array:
        R = np.where(np.isinf(at(model.R, k)), 0.0, at(model.R, k))
        N = cross_at(model, k)
        return root(np.block([[at(model.Qd, min(k, steps - 1)), N], [N.T, R]]))

    varies = any(matrix is not None and matrix.ndim == 3 for matrix in (model.Qd, model.R, model.N))
    once = None if varies else factor(0)
    for k in range(steps + 1):
        noise = (factor(k) if once is None else once) @ rng.normal(size=n + m)
        z[k] = at(model.H, k) @ x + noise[n:]
        if k < steps:
            x = at(model.Phi, k) @ x + offset_at(model, k) + noise[:n]
    z[rng.uniform(size=z.shape) < gaps] = np.nan
    z[:first] = np.nan
    return z
