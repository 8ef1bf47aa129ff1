r"""Histories of a linear system made from white noises.

.. math:: x_{k+1} = \Phi x_k + c_k + G_k\xi^w_k + C_k\xi^v_k, \quad z_k = H_k x_k + L_k\xi^v_k

with ξ of unit variance. [[L, 0], [C, G]] is the lower triangular factor of the joint covariance of v and w; its columns that are
zero at all times are left out and take no random numbers. A matrix that does not vary has one entry on its time axis.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.linalg.factors import root
from ctlabs.models.linear import DiscreteModel


class Truth(NamedTuple):
    """The arrays that make x and z; see the module's equations."""

    x0: Array
    F0: Array
    Phi: Array
    c: Array
    G: Array
    C: Array
    H: Array
    L: Array


class Shape(NamedTuple):
    """How many normals a run takes: ``start`` for x0, ``w`` per step, ``v`` per instant from ``first`` on."""

    start: int
    w: int
    v: int
    steps: int
    first: int


class Normals(NamedTuple):
    """The normals of ``runs`` runs: start (·, runs), w (steps, ·, runs), v (steps+1, ·, runs); v is 0 before ``first``."""

    start: Array
    w: Array
    v: Array


def truth_arrays(model: DiscreteModel, steps: int) -> Truth:
    """Factors and matrices of a truth over ``steps`` steps."""
    checks.finite_start("a simulation", model.P0)
    n, m = model.n, model.m
    varies = model.R.ndim == 3 or model.Qd.ndim == 3
    joint = _noises(model, steps + 1 if varies else 1)
    v = joint[:, :, :m].any(axis=(0, 1))
    w = joint[:, m:, m:].any(axis=(0, 1))
    C = joint[:, m:, :m][:, :, v] if model.N is not None else np.zeros((0, n, 0))
    F0 = root(model.P0)
    return Truth(
        x0=np.array(model.x0),
        F0=np.ascontiguousarray(F0[:, F0.any(axis=0)]),
        Phi=stack(model.Phi, 2),
        c=stack(np.zeros(n) if model.offset is None else model.offset, 1),
        G=np.ascontiguousarray(joint[:, m:, m:][:, :, w]),
        C=np.ascontiguousarray(C),
        H=stack(model.H, 2),
        L=np.ascontiguousarray(joint[:, :m, :m][:, :, v]),
    )


def shape(truth: Truth, steps: int, first: int) -> Shape:
    """The normals that a run of a truth takes; where w and v correlate v is drawn at t0 too."""
    return Shape(truth.F0.shape[1], truth.G.shape[2], truth.L.shape[2], steps, 0 if len(truth.C) else first)


def normals(random: np.random.Generator, size: Shape, runs: int) -> Normals:
    """So many normals of one generator."""
    start, w = random.standard_normal((size.start, runs)), random.standard_normal((size.steps, size.w, runs))
    v = np.zeros((size.steps + 1, size.v, runs))
    random.standard_normal(out=v[size.first :])
    return Normals(start, w, v)


def histories(truth: Truth, xi: Normals, first: int) -> tuple[Array, Array]:
    """States and measurements made from given white noises."""
    steps, runs = len(xi.w), xi.start.shape[1]
    x = np.empty((steps + 1, len(truth.x0), runs))
    z = np.full((steps + 1, truth.H.shape[1], runs), np.nan)
    with np.errstate(over="ignore", invalid="ignore"):  # an overflow is reported by the caller, with its time
        x[0] = truth.x0[:, None] + truth.F0 @ xi.start
        for k in range(steps + 1):
            if k:
                np.matmul(entry(truth.Phi, k - 1), x[k - 1], out=x[k])
                x[k] += entry(truth.c, k - 1)[:, None] + entry(truth.G, k - 1) @ xi.w[k - 1]
                if len(truth.C):
                    x[k] += entry(truth.C, k - 1) @ xi.v[k - 1]
            if k >= first:
                np.matmul(entry(truth.H, k), x[k], out=z[k])
                z[k] += entry(truth.L, k) @ xi.v[k]
    return x, z


def entry(stack: Array, k: int) -> Array:
    """Entry k of a stack that holds one matrix when it does not vary."""
    return stack[k] if len(stack) > 1 else stack[0]


def _noises(model: DiscreteModel, instants: int) -> Array:
    """The lower triangular factors of the joint covariances of (v_k, w_k) of so many instants; absent elements have no noise."""
    m, joint = model.m, np.zeros((instants, model.m + model.n, model.m + model.n))
    R = stack(model.R, 2)[:instants]
    finite = np.isfinite(np.diagonal(R, axis1=1, axis2=2))
    joint[:, :m, :m] = np.where(finite[:, :, None] & finite[:, None, :], R, 0.0)
    leaving = instants if model.Qd.ndim == 2 else min(instants, len(model.Qd))  # nothing leaves the last instant
    joint[:leaving, m:, m:] = stack(model.Qd, 2)[:leaving]
    if model.N is not None:
        joint[:leaving, m:, :m], joint[:leaving, :m, m:] = model.N, model.N.T
    return root(joint)


def stack(matrix: Array, ndim: int) -> Array:
    """A matrix that may vary, with an axis of time: one entry where it does not."""
    return np.array(matrix if matrix.ndim > ndim else matrix[None], order="C")
