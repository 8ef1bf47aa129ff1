r"""The compiled inner loops: simulate, filter and accumulate a block of runs without storing histories.

A block is a number of tiles of ``width`` runs. All runs of a tile step together; every loop over them is contiguous,
so the compiler vectorises it, and everything a tile touches stays in the nearest cache. The normals are those that
``Generator.standard_normal`` would give (:mod:`ctlabs.montecarlo.ziggurat`), in the order

    states' stream:        per tile ξ0 (columns of F0, width), then per step ξw (columns of G, width)
    measurements' stream:  per tile and step ξv (columns of L, width), from step ``first`` (from 0 where w and v correlate)

so a block with fewer runs is a prefix of the full one. The functions are plain Python and run without numba as well.

The columns of the sums, with d compared states, about the expected mean error (``shift``):

    0…d Σe · d…2d Σe⁴ · 2d…3d Σe⁻ · 3d…4d Σ(e⁻)² · 4d…5d Σ(e⁻)⁴ · 5d…6d Σ(Ex)² · NEES, NEES², NIS, NIS² · Σeeᵀ by rows, lower
"""

from __future__ import annotations

from functools import partial

import numpy as np

from ctlabs.linalg import compiled
from ctlabs.linalg.checks import Array
from ctlabs.models.histories import Truth
from ctlabs.montecarlo.histogram import Histogrammed
from ctlabs.montecarlo.plan import Design
from ctlabs.montecarlo.ziggurat import Stream, fill

#: Sums may be reordered into vectors; NaN and infinity keep their meaning, for overflows must show.
FAST = {"reassoc", "contract", "nsz", "arcp"}
#: Elements from which a product of a matrix with a tile is left to BLAS.
LARGE = 256
#: A helper becomes part of the kernel, at LLVM's level. As a function of its own it would exist twice in a process that
#: compiles, with sums in another order, and such a process would not give the bytes of one that loads the cache.
inlined = partial(compiled.helper, fastmath=FAST, forceinline=True)


@compiled.helper
def blas(A: Array, x: Array, out: Array) -> None:
    """out = A x by BLAS; no arithmetic of its own, so that it may stay a function and costs its compilation once."""
    np.dot(A, x, out)


@compiled.helper
def assign(a: Array, y: Array) -> None:
    """y = a in every run."""
    for i in range(y.shape[0]):
        for r in range(y.shape[1]):
            y[i, r] = a[i]


@compiled.helper
def dense(A: Array) -> bool:
    """Whether a BLAS product is the faster one: A is large and has few zeros."""
    if A.size < LARGE:
        return False
    filled = 0
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            if A[i, j] != 0.0:
                filled += 1
    return 4 * filled > A.size


@compiled.helper
def add_product(A: Array, x: Array, y: Array, work: Array, sign: float = 1.0) -> None:
    """y += ± A x; zeros of a small or sparse A cost nothing."""
    if dense(A):
        product = work[: A.shape[0]]
        blas(A, x, product)
        for i in range(y.shape[0]):
            for r in range(y.shape[1]):
                y[i, r] += sign * product[i, r]
        return
    for i in range(A.shape[0]):
        j = 0
        while j < A.shape[1]:  # two columns at a time: each time y is read and written once
            count, p, q = 0, 0, 0
            while j < A.shape[1] and count < 2:
                if A[i, j] != 0.0:
                    p, q = q, j
                    count += 1
                j += 1
            if count == 2:
                a, b = sign * A[i, p], sign * A[i, q]
                for r in range(y.shape[1]):
                    y[i, r] += a * x[p, r] + b * x[q, r]
            elif count == 1:
                a = sign * A[i, q]
                for r in range(y.shape[1]):
                    y[i, r] += a * x[q, r]


@inlined
def add_squares(x: Array, count: int, out: Array) -> None:
    """Add Σx² of the first ``count`` runs."""
    for i in range(x.shape[0]):
        s = 0.0
        for r in range(count):
            s += x[i, r] * x[i, r]
        out[i] += s


@inlined
def add_outer(e: Array, count: int, out: Array, square: Array) -> None:
    """Add the lower triangle of Σeeᵀ, by rows; runs beyond ``count`` are zero."""
    d, place = e.shape[0], 0
    if e.shape[0] * e.shape[0] >= LARGE:
        np.dot(e, e.T, square)
        for i in range(d):
            for j in range(i + 1):
                out[place] += square[i, j]
                place += 1
        return
    for i in range(d):
        for j in range(i + 1):
            s = 0.0
            for r in range(count):
                s += e[i, r] * e[j, r]
            out[place] += s
            place += 1


@inlined
def add_form(W: Array, start: Array, e: Array, count: int, u: Array, q: Array, out: Array) -> None:
    """Add the quadratic form |W e + start|² and its square to ``out``; u and q are scratch rows."""
    q[:] = 0.0
    if dense(W):
        product = u[: W.shape[0]]
        blas(W, e, product)
        for i in range(W.shape[0]):
            for r in range(count):
                value = product[i, r] + start[i]
                q[r] += value * value
    else:
        row = u[0]
        for i in range(W.shape[0]):
            last = 0
            for j in range(W.shape[1]):
                if W[i, j] != 0.0:
                    last = j
            row[:] = start[i]
            for j in range(last):
                a = W[i, j]
                if a != 0.0:
                    for r in range(count):
                        row[r] += a * e[j, r]
            a = W[i, last]
            for r in range(count):  # the last term is squared with the sum
                value = row[r] + a * e[last, r]
                q[r] += value * value
    s1, s2 = 0.0, 0.0
    for r in range(count):
        s1 += q[r]
        s2 += q[r] * q[r]
    out[0] += s1
    out[1] += s2


@inlined
def add_counts(e: Array, shift: Array, count: int, bins: Histogrammed, k: int, counts: Array) -> None:
    """Count the chosen errors in their bins; the outer bins hold everything beyond."""
    last = counts.shape[1] - 1
    for i in range(bins.states.shape[0]):
        state = bins.states[i]
        for r in range(count):
            place = (e[state, r] + shift[state]) * bins.scale[k, i] + 0.5 * (last + 1)
            # Compared before it is made a whole number, for infinity and NaN have none.
            if place >= last:
                counts[i, last] += 1
            elif place > 0.0:
                counts[i, int(place)] += 1
            else:
                counts[i, 0] += 1


@inlined
def error(
    estimate: Array, there: Array, shift: Array, count: int, e: Array, first: Array, second: Array, fourth: Array
) -> None:  # fmt: skip
    """e = x̂ − Ex − shift, zero in the runs that do not count, its powers added on the way; ``second`` may be empty."""
    for i in range(e.shape[0]):
        s1, s2, s4 = 0.0, 0.0, 0.0
        for r in range(count):
            value = estimate[i, r] - there[i, r] - shift[i]
            square = value * value
            e[i, r] = value
            s1 += value
            s2 += square
            s4 += square * square
        for r in range(count, e.shape[1]):
            e[i, r] = 0.0
        first[i] += s1
        fourth[i] += s4
        if second.shape[0] > 0:
            second[i] += s2


@partial(compiled.kernel, fastmath=FAST, error_model="python")
def block(
    states: Stream,
    measurements: Stream,
    tiles: int,
    width: int,
    last: int,
    first: int,
    truth: Truth,
    design: Design,
    bins: Histogrammed,
    sums: Array,
    counts: Array,
) -> None:
    """``tiles`` tiles, of which the last counts ``last`` runs; adds to ``sums`` (steps+1, columns) and ``counts``."""
    n, d, m = truth.Phi.shape[1], design.A.shape[1], truth.H.shape[1]
    xi0, xiw = np.empty((truth.F0.shape[1], width)), np.empty((truth.G.shape[2], width))
    xiv = np.zeros((truth.L.shape[2], width))
    x, moved = np.empty((n, width)), np.empty((n, width))
    estimate, predicted = np.empty((d, width)), np.empty((d, width))
    z, nu = np.zeros((m, width)), np.empty((m, width))
    e, there, work, q = np.empty((d, width)), np.empty((d, width)), np.empty((max(n, d, m), width)), np.empty(width)
    square, nothing, zeros = np.empty((d, d)), np.empty(0), np.zeros(m)
    correlated = truth.C.shape[0] > 0
    for tile in range(tiles):
        count = width if tile < tiles - 1 else last
        fill(states, xi0)
        assign(truth.x0, x)
        add_product(truth.F0, xi0, x, work)
        assign(design.x0, estimate)
        for k in range(sums.shape[0]):
            row = sums[k]
            if k > 0:
                fill(states, xiw)
                assign(truth.c[(k - 1) % truth.c.shape[0]], moved)
                add_product(truth.Phi[(k - 1) % truth.Phi.shape[0]], x, moved, work)
                add_product(truth.G[(k - 1) % truth.G.shape[0]], xiw, moved, work)
                if correlated:
                    add_product(truth.C[(k - 1) % truth.C.shape[0]], xiv, moved, work)
                x, moved = moved, x
                assign(design.b[(k - 1) % design.b.shape[0]], predicted)
                add_product(design.A[(k - 1) % design.A.shape[0]], estimate, predicted, work)
                if design.M.shape[0] > 0:
                    add_product(design.M[k - 1], z, predicted, work)
                estimate, predicted = predicted, estimate
            if design.same:
                there = x
            else:
                there[:] = 0.0
                add_product(design.E, x, there, work)
            error(estimate, there, design.shift_minus[k], count, e, row[2 * d : 3 * d], row[3 * d : 4 * d], row[4 * d : 5 * d])
            if k >= first or correlated:
                fill(measurements, xiv)
            if k >= first:
                z[:] = 0.0
                add_product(truth.H[k % truth.H.shape[0]], x, z, work)
                add_product(truth.L[k % truth.L.shape[0]], xiv, z, work)
                nu[:] = z
                add_product(design.H[k % design.H.shape[0]], estimate, nu, work, -1.0)
                add_product(design.K[k], nu, estimate, work)
                add_form(design.V[k], zeros, nu, count, work, q, row[6 * d + 2 : 6 * d + 4])
            error(estimate, there, design.shift[k], count, e, row[:d], nothing, row[d : 2 * d])
            add_outer(e, count, row[6 * d + 4 :], square)
            add_form(design.W[k], design.shift_white[k], e, count, work, q, row[6 * d : 6 * d + 2])
            if bins.states.shape[0] > 0:
                add_counts(e, design.shift[k], count, bins, k, counts[k])
            add_squares(there, count, row[5 * d : 6 * d])

