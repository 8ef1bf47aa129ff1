"""Families of models drawn from a seed, over which the benchmarks hold: nothing may be fast for one model only.

Noise ratios q/r cover nine decades, so that the filters settle in a few steps or in thousands; some never do, their matrices vary,
their data have gaps, or w and v correlate.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ctlabs import DiscreteModel
from ctlabs.linalg.checks import Array

RATIOS = np.geomspace(1e-6, 1e3, 12)


class Named(NamedTuple):
    """A model and what it is."""

    name: str
    model: DiscreteModel


def stable(rng: np.random.Generator, n: int, radius: float) -> Array:
    """A random Φ (n, n) of the spectral radius ``radius``."""
    Phi = rng.normal(size=(n, n)) / np.sqrt(n)
    return Phi * (radius / np.abs(np.linalg.eigvals(Phi)).max())


def covariance(rng: np.random.Generator, n: int) -> Array:
    """A random covariance (n, n) with the mean variance 1."""
    L = rng.normal(size=(n, n)) + np.eye(n)
    Q = L @ L.T
    return Q * (n / np.trace(Q))


def drawn(rng: np.random.Generator, n: int, m: int, ratio: float, radius: float) -> DiscreteModel:
    """A constant model with noises of the ratio q/r."""
    Phi, H = stable(rng, n, radius), rng.normal(size=(m, n))
    r = np.exp(rng.normal())
    return DiscreteModel(Phi, ratio * r * covariance(rng, n), H, r * covariance(rng, m), P0=10 * ratio**0.5 * r * np.eye(n))


def varied(rng: np.random.Generator, model: DiscreteModel, kind: str, steps: int) -> DiscreteModel:
    """The model made a member of a ``kind`` of models, over so many steps."""
    n, m = model.n, model.m
    if kind == "H varies":
        return replace(model, H=model.H * rng.uniform(0.5, 1.5, (steps + 1, m, n)))
    if kind == "gaps":
        R = np.broadcast_to(model.R, (steps + 1, m, m)).copy()
        R[rng.uniform(size=steps + 1) < 0.2] = np.diag(np.full(m, np.inf))
        return replace(model, R=R)
    if kind == "N":
        half = 0.5 * np.linalg.cholesky(model.Qd) @ rng.uniform(-1, 1, (n, m)) / np.sqrt(n * m) @ np.linalg.cholesky(model.R).T
        return replace(model, N=half)
    if kind == "never settles":  # a mode on the unit circle that no noise drives is known better for ever
        Phi, Qd = model.Phi.copy(), model.Qd.copy()
        Phi[-1], Qd[-1], Qd[:, -1] = 0.0, 0.0, 0.0
        Phi[-1, -1] = 1.0
        return replace(model, Phi=Phi, Qd=Qd)
    return model


#: Of each kind so many of twelve, or half as many of six.
KINDS = ("constant",) * 4 + ("H varies",) * 2 + ("gaps",) * 2 + ("N",) * 2 + ("never settles",) * 2


def family(seed: int, n: int, m: int, count: int, steps: int) -> list[Named]:
    """``count`` (12 or 6) models of n states and m measurements, in every kind, at random over the noise ratios."""
    rng = np.random.default_rng([seed, n, m])
    kinds = rng.permutation(KINDS[:: 12 // count])
    found = []
    for ratio, kind in zip(RATIOS[:: 12 // count], kinds.tolist(), strict=True):
        radius = float(rng.choice([0.3, 0.9, 0.99, 0.9999, 1.0]))
        model = varied(rng, drawn(rng, n, m, float(ratio), radius), kind, steps)
        found.append(Named(f"{kind}, q/r {ratio:.0e}, radius {radius:g}", model))
    return found


def constant(seed: int, n: int, m: int, count: int) -> list[Named]:
    """Constant models with spectral radii from 0.5 to 0.9999, over the noise ratios."""
    rng = np.random.default_rng([seed, n, m, 1])
    radii = np.resize([0.5, 0.9, 0.99, 0.999, 0.9999], count)
    ratios = np.geomspace(1e-4, 1e2, count)[rng.permutation(count)]
    return [
        Named(f"q/r {ratio:.0e}, radius {radius:g}", drawn(rng, n, m, float(ratio), float(radius)))
        for ratio, radius in zip(ratios, radii, strict=True)
    ]


def with_bursts(rng: np.random.Generator, z: Array, length: int = 50, share: float = 0.05) -> Array:
    """Data (rows, m) of which bursts are missing: all elements, or one of them."""
    z = z.copy()
    for _ in range(int(share * len(z) / length)):
        k, count = rng.integers(len(z)), rng.integers(1, 2 * length)
        which = slice(None) if rng.uniform() < 0.5 else rng.integers(z.shape[1])
        z[k : k + count, which] = np.nan
    return z
