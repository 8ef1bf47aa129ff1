r"""The filter of a long field: boundary layers and one convolution kernel, O(nodes) time and memory.

Far from both ends the field looks the same from every node, so the gain is a convolution. On an infinite line the
covariance falls apart into waves: for each wave number θ a 2×2 Riccati equation with

.. math:: \Phi(\theta) = \begin{bmatrix} 1 & \Delta t \\ e_2 - e_3w & e_0 - e_1w \end{bmatrix}, \quad w = e^{-i\theta},
          \qquad K(\theta) = \frac{1}{P^-_{11} + \sigma^2}\begin{bmatrix} P^-_{11} \\ P^-_{21} \end{bmatrix}

and the kernel is the inverse transform of K. Its tails give the reach to the left and to the right. The gains near the
two ends come from the exact filter of a short field, which reaches so far to each side of one middle node; the row of
that node is compared with the kernel, and what differs counts as truncation beside the tails.

Where nodes are not measured the gain is no convolution: the nodes within two half-widths of a gap are filtered again,
exactly, in overlapping windows.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike
from scipy.fft import irfft, next_fast_len, rfft

from ctlabs.filtering.fields.filters import FieldEstimate, filter_exact, measurements, predicted, updated
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.linalg.threads import one_thread
from ctlabs.models.field.model import RandomField

#: Half-widths that are tried at most; beyond, a window would cost as much as a long field by the exact filter.
WIDEST = 512
#: The field travels to the right, so the left end is felt farther than the kernel: some hundred times its tail there.
MARGIN = 500


class _Line(NamedTuple):
    """The filter of an infinite line.

    ``kernels`` (steps+1, 2, 2·far+1), for z and z*, from the farthest node to the right to that to the left ·
    ``variance`` (steps+1,), of the error of z
    """

    kernels: Array
    variance: Array


class _Reach(NamedTuple):
    """How many nodes to the left and to the right a correction uses."""

    left: int
    right: int


class _Ends(NamedTuple):
    """The filter of a short field, a window.

    ``left``, ``right`` (steps+1, 2, nodes, window), rows of the gain at the two ends · ``middle`` (steps+1, 2, window),
    the row between them, in the order of a kernel · ``variance`` (steps+1, window), of the error of z
    """

    left: Array
    middle: Array
    right: Array
    variance: Array


def filter_local(
    field: RandomField, measured: ArrayLike, *, sigma_n: float, P0: float = 10.0, tolerance: float = 1e-8
) -> FieldEstimate:
    """The filter of a long field by boundary layers and a convolution kernel.

    Parameters
    ----------
    field, measured, sigma_n, P0 : as for :func:`ctlabs.filtering.fields.filter_dense`
    tolerance : share of the gain (sum of its absolute values along a row) that may be left out

    Returns
    -------
    FieldEstimate, with the ``half_width`` chosen and the ``truncation`` achieved. A field not longer than its window
    is filtered exactly.

    Raises
    ------
    ValueError
        Data as refused by the other filters; a tolerance that no half-width reaches (the message says which is reached).

    >>> field = RandomField(0.1, 0.1, 0.25, 1, 1, 0.2, 2000, 3)
    >>> estimate = filter_local(field, np.zeros((100, 2001)), sigma_n=1.0, tolerance=1e-6)
    >>> estimate.half_width < 60, estimate.truncation <= 1e-6
    (True, True)
    """
    checks.positive("tolerance", tolerance)
    data, single = measurements(field, measured, sigma_n, P0)
    gaps = np.isnan(data[:, :, 0])
    updates = np.logical_not(gaps.all(axis=1))
    with one_thread():  # matrices of a hundred rows: a second thread would only wait
        plan = _plan(field, sigma_n, P0, tolerance, updates)
        if plan is None:
            return filter_exact(field, measured, sigma_n=sigma_n, P0=P0)
        line, ends, reach, truncation = plan
        z_hat = _estimate(field, data, line, ends, reach)
    variance = np.empty((len(data), field.nodes))
    variance[:] = line.variance[:, None]
    variance[:, : reach.left] = ends.variance[:, : reach.left]
    variance[:, -reach.right :] = ends.variance[:, -reach.right :]
    holes = np.flatnonzero((gaps & updates[:, None]).any(axis=0))
    if len(holes):
        _refilter(field, data, sigma_n, P0, max(reach), holes, z_hat, variance)
    return FieldEstimate(z_hat[:, :, 0] if single else z_hat, variance, truncation, max(reach))


def _plan(
    field: RandomField, sigma_n: float, P0: float, tolerance: float, updates: Array
) -> tuple[_Line, _Ends, _Reach, float] | None:
    """Kernels, ends, reach and truncation; None where the window is as long as the field."""
    far = 128
    wanted = max(tolerance / MARGIN, 1e-14), max(tolerance / 20, 1e-14)
    while True:
        line = _line(field, sigma_n, P0, updates, far)
        left, right = _tails(line.kernels)
        if max(left[far // 2] - wanted[0], right[far // 2] - wanted[1]) <= 0 or far >= 2 * WIDEST:
            break
        far *= 2
    reach, truncation = _Reach(_first(left, wanted[0]), _first(right, wanted[1])), np.inf
    while sum(reach) + 1 < field.nodes:
        ends = _ends(field, sigma_n, P0, updates, reach)
        apart = np.abs(ends.middle - _cut(line.kernels, reach)).sum(axis=2).max(axis=0) / _size(line.kernels)
        before, truncation = truncation, float(left[reach.left] + right[reach.right] + apart.max())
        if truncation <= tolerance:
            return line, ends, reach, truncation
        if max(reach) == WIDEST or (before < 1e-12 and truncation > 0.5 * before):  # too wide, or rounding
            reached = f"{min(before, truncation):.1e} (what half-width {max(reach)} reaches)"
            msg = f"tolerance: expected at least {reached}, received {tolerance:g}"
            raise ValueError(msg)
        reach = _Reach(*(min(w + max(4, w // 8), WIDEST) for w in reach))
    return None


def _first(tails: Array, wanted: float) -> int:
    """The least width, 1 to WIDEST, whose tail is at most ``wanted``."""
    return min(max(int(np.argmax(tails <= wanted)), 1), WIDEST) if tails.min() <= wanted else WIDEST


def _line(field: RandomField, sigma_n: float, P0: float, updates: Array, far: int) -> _Line:
    """The filter of an infinite line, wave by wave; ``far`` nodes of the kernels to each side."""
    size, R = 4 * far, sigma_n**2
    e, dt, w = field.coefficients, field.dt, np.exp(-2j * np.pi * np.arange(2 * far + 1) / size)
    couple, keep, noise = e.e2 - e.e3 * w, e.e0 - e.e1 * w, (e.e4 * field.sigma_eta) ** 2
    a, b, c = np.full(len(w), P0), np.zeros(len(w), dtype=np.complex128), np.full(len(w), P0)
    K, variance = np.zeros((len(updates), 2, len(w)), dtype=np.complex128), np.full(len(updates), P0)
    for k in range(1, len(updates)):
        # P = [[a, b], [b*, c]]; the first row of ΦP is (p, q), the second (r, s)
        p, q = a + dt * np.conj(b), b + dt * c
        r, s = couple * a + keep * np.conj(b), couple * b + keep * c
        a, b = (p + dt * q).real, p * np.conj(couple) + q * np.conj(keep)
        c = (r * np.conj(couple) + s * np.conj(keep)).real + noise
        if updates[k]:
            K[k] = a / (a + R), np.conj(b) / (a + R)
            c = c - (np.conj(b) * K[k, 1].conj()).real
            a, b = R * a / (a + R), R * b / (a + R)
        variance[k] = (a[0] + 2 * a[1:-1].sum() + a[-1]) / size
    whole = np.fft.irfft(K, size, axis=2)
    return _Line(np.concatenate([whole[:, :, -far:], whole[:, :, : far + 1]], axis=2), variance)


def _size(kernels: Array) -> Array:
    """The largest sum of absolute values over time, for z and z*, (2,)."""
    size = np.abs(kernels).sum(axis=2).max(axis=0)
    return np.where(size > 0, size, 1.0)


def _tails(kernels: Array) -> tuple[Array, Array]:
    """The share of the gain beyond each width 0…far to the left and to the right, the worse of z and z*, over all steps."""
    far = kernels.shape[2] // 2
    size = np.abs(kernels)

    def beyond(side: Array) -> Array:
        tail = np.cumsum(side[:, :, ::-1], axis=2)[:, :, ::-1].max(axis=0)  # at w the sum from the node w + 1 on
        tail = np.concatenate([tail, side[:, :, -1:].max(axis=0)], axis=1)  # the last node stands for what follows
        return np.asarray((tail / _size(kernels)[:, None]).max(axis=0))

    return beyond(size[:, :, far + 1 :]), beyond(size[:, :, :far][:, :, ::-1])


def _cut(kernels: Array, reach: _Reach) -> Array:
    far = kernels.shape[2] // 2
    return kernels[:, :, far - reach.right : far + reach.left + 1]


def _ends(field: RandomField, sigma_n: float, P0: float, updates: Array, reach: _Reach) -> _Ends:
    """The exact filter's gains on a short field with the given reach to each side of one node."""
    N, steps, m = sum(reach) + 1, len(updates) - 1, reach.left
    short = replace(field, N1=N - 1, allow_unstable=True)
    noise, P, seen = (field.coefficients.e4 * field.sigma_eta) ** 2, P0 * np.eye(2 * N), np.arange(N)
    left, middle, right = (np.zeros((steps + 1, 2, rows, N)) for rows in (m, 1, reach.right))
    variance = np.full((steps + 1, N), P0)
    for k in range(1, steps + 1):
        P = predicted(short, P, noise)
        if updates[k]:
            W, P = updated(P, seen, sigma_n**2)
            for i, K in enumerate((W[:, :N].T, W[:, N:].T)):
                left[k, i], middle[k, i], right[k, i] = K[:m], K[m : m + 1], K[m + 1 :]
        variance[k] = np.diagonal(P)[:N]
    # the row i of a convolution holds the kernel backwards: the node j has the weight kernel[i − j]
    return _Ends(left, middle[:, :, 0, ::-1], right, variance)


def _estimate(field: RandomField, data: Array, line: _Line, ends: _Ends, reach: _Reach) -> Array:
    """ẑ of all runs by the gains of the ends and the kernel between; gaps correct nothing."""
    N, runs, window = field.nodes, data.shape[2], sum(reach) + 1
    kernels, z_hat, x = _cut(line.kernels, reach), np.zeros(data.shape), np.zeros((2 * N, runs))
    for k in range(1, len(data)):
        x = field.advance(x)
        innovation = data[k] - x[:N]
        np.nan_to_num(innovation, copy=False)
        inner = _convolved(innovation, kernels[k])
        for i, part in enumerate((x[:N], x[N:])):
            part[: reach.left] += ends.left[k, i] @ innovation[:window]
            part[reach.left : N - reach.right] += inner[i]
            part[N - reach.right :] += ends.right[k, i] @ innovation[N - window :]
        z_hat[k] = x[:N]
    return z_hat


def _convolved(values: Array, kernels: Array) -> tuple[Array, Array]:
    """Σ_j kernel[j] values[i − j] for the nodes i with all neighbours, (those nodes, runs) for each of two kernels.

    By transforms of overlapping pieces, some eight kernels long (overlap and save: Stockham, 1966).
    """
    width = kernels.shape[1]
    size = next_fast_len(min(8 * width, len(values)), real=True)
    count, block = len(values) - width + 1, size - width + 1
    blocks = -(-count // block)
    padded = np.zeros((blocks * block + width - 1, values.shape[1]))
    padded[: len(values)] = values
    pieces = rfft(np.ascontiguousarray(sliding_window_view(padded, size, axis=0)[::block]), axis=2)  # (blocks, runs, waves)
    both = (irfft(pieces * waves, size, axis=2)[:, :, width - 1 :] for waves in rfft(kernels, size, axis=1))
    first, second = (np.swapaxes(part, 1, 2).reshape(blocks * block, -1)[:count] for part in both)
    return first, second


def _refilter(
    field: RandomField, data: Array, sigma_n: float, P0: float, w: int, holes: Array, z_hat: Array, variance: Array
) -> None:
    """Replace the estimates within two half-widths of a gap by those of exact filters in overlapping windows.

    A gap lets the variance grow, so its influence reaches farther than that of an end.
    """
    N, far = field.nodes, 2 * w
    near = np.zeros(N, dtype=bool)
    for hole in holes:
        near[max(hole - far, 0) : hole + far + 1] = True
    nodes = np.flatnonzero(near)
    while len(nodes):
        last = nodes[0] + 2 * far + w
        piece = nodes[nodes < last]
        low, high = max(int(piece[0]) - far, 0), min(int(piece[-1]) + far + 1, N)
        short = replace(field, N1=high - low - 1, allow_unstable=True)
        done = filter_exact(short, data[1:, low:high], sigma_n=sigma_n, P0=P0)
        z_hat[:, piece], variance[:, piece] = done.z_hat[:, piece - low], done.variance[:, piece - low]
        nodes = nodes[nodes >= last]
