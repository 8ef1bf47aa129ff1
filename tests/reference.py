r"""Textbook oracles, written plainly and apart from the library: what a test compares ctlabs with.

A model is read through its fields alone (Phi, Qd, H, R, x0, P0, N, offset; constant, or one more axis for the time),
a record z is (steps+1, m) with NaN where nothing is measured, and ``first`` has the library's meaning: with 1 the
row 0 of z is not used. Nothing here is fast, and nothing here is imported from ctlabs.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any, NamedTuple

import mpmath
import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[Any]

#: Tolerance of algebra in floating point, relative to the size of what is compared.
EXACT = 1e-12
#: Tolerance of Riccati and Lyapunov solvers, relative to the size of what is compared.
SOLVER = 1e-8


def deviation(a: ArrayLike, b: ArrayLike, size: float = 0.0) -> float:
    """The largest difference of two arrays, relative to their largest element; infinities and NaN must coincide.

    ``size`` is a lower bound for that element: the size of the terms whose difference ``a`` and ``b`` are.
    """
    first, second = np.asarray(a), np.asarray(b)
    if first.shape != second.shape and first.size != 1 and second.size != 1:
        msg = f"deviation: expected equal shapes, received {first.shape} and {second.shape}"
        raise ValueError(msg)
    first, second = np.broadcast_arrays(first, second)
    finite = np.isfinite(first) & np.isfinite(second)
    if not np.array_equal(first[~finite], second[~finite], equal_nan=True):
        return np.inf
    first, second = first[finite], second[finite]
    size = max(size, np.abs(first).max(initial=0.0), np.abs(second).max(initial=0.0))
    return float(np.abs(first - second).max() / size) if size else 0.0


def close(a: ArrayLike, b: ArrayLike, tolerance: float, size: float = 0.0) -> bool:
    """Whether two arrays agree within ``tolerance`` of their size (not element by element)."""
    return deviation(a, b, size) <= tolerance


def order(errors: ArrayLike) -> Array:
    """Observed orders p of a method, log₂ of the ratios of successive errors while the step is halved."""
    errors = np.asarray(errors, dtype=np.float64)
    return np.log2(errors[:-1] / errors[1:])


def broken(matrix: ArrayLike, element: tuple[int, ...] | None = None, by: float = 0.05) -> Array:
    """A copy with one element changed by 5 %, the largest unless ``element`` says which."""
    copy = np.array(matrix, dtype=np.float64)
    where = np.unravel_index(np.argmax(np.abs(copy)), copy.shape) if element is None else element
    copy[where] *= 1 + by
    return copy


class Moments(NamedTuple):
    """Means (steps+1, n) and covariances (steps+1, n, n) of x_k given z before k (minus) and up to k (plus)."""

    x_minus: Array
    P_minus: Array
    x_plus: Array
    P_plus: Array


class Trajectory(NamedTuple):
    """Mean (steps+1, n) and covariance (steps+1, n, n) of every x_k given the whole record."""

    x: Array
    P: Array


def at(matrix: Array, k: int, ndim: int = 2) -> Array:
    """The value at k of a matrix that may vary with time."""
    return matrix if matrix.ndim == ndim else matrix[k]


def offset_at(model: Any, k: int) -> Array:
    """The known input c_k, zeros without one."""
    return np.zeros(len(model.x0)) if model.offset is None else at(model.offset, k, 1)


def cross_at(model: Any, k: int) -> Array:
    """N_k = E[w_k v_kᵀ], zeros without one."""
    return np.zeros((len(model.x0), model.H.shape[-2])) if model.N is None else at(model.N, k)


def present(model: Any, z: Array, k: int, first: int) -> NDArray[np.intp]:
    """Indices of the elements that are measured at k."""
    if k < first:
        return np.zeros(0, dtype=np.intp)
    return np.flatnonzero(np.isfinite(np.diag(at(model.R, k))) & ~np.isnan(z[k]))


# --- the recursion -------------------------------------------------------------------------------------------------


def predict(x: Array, P: Array, Phi: Array, Qd: Array, c: Array | float = 0.0) -> tuple[Array, Array]:
    """x⁻ = Φx⁺ + c, P⁻ = ΦP⁺Φᵀ + Qd."""
    return Phi @ x + c, Phi @ P @ Phi.T + Qd


def update(x: Array, P: Array, z: Array, H: Array, R: Array) -> tuple[Array, Array, Array]:
    """x⁺ = x⁻ + Kν, P⁺ = (I − KH)P⁻, K = P⁻Hᵀ(HP⁻Hᵀ + R)⁻¹, with a plain inverse; returns x⁺, P⁺, K."""
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    return x + K @ (z - H @ x), (np.eye(len(P)) - K @ H) @ P, K


def information_update(x: Array, P: Array, z: Array, H: Array, R: Array) -> tuple[Array, Array, Array]:
    """The same from (P⁺)⁻¹ = (P⁻)⁻¹ + HᵀR⁻¹H and K = P⁺HᵀR⁻¹ (P⁻ and R must be invertible)."""
    P_plus = np.linalg.inv(np.linalg.inv(P) + H.T @ np.linalg.inv(R) @ H)
    K = P_plus @ H.T @ np.linalg.inv(R)
    return x + K @ (z - H @ x), P_plus, K


def recursion(model: Any, z: ArrayLike, first: int = 1) -> Moments:
    r"""The textbook filter; where w and v correlate as a one-step predictor.

    .. math:: \hat x^-_{k+1} = \Phi\hat x^-_k + c + K_p\nu,\ P^-_{k+1} = \Phi P^-\Phi^T + Q_d - K_pSK_p^T,\
              K_p = (\Phi P^-H^T + N)S^{-1}
    """
    z = np.asarray(z, dtype=np.float64)
    x, P = np.array(model.x0), np.array(model.P0)
    rows = []
    for k in range(len(z)):
        used = present(model, z, k, first)
        H, R, N = at(model.H, k)[used], at(model.R, k)[np.ix_(used, used)], cross_at(model, k)[:, used]
        x_plus, P_plus, _ = update(x, P, z[k, used], H, R)
        rows.append((x, P, x_plus, P_plus))
        if k + 1 < len(z):
            Phi, S, nu = at(model.Phi, k), H @ P @ H.T + R, z[k, used] - H @ x
            K_pred = (Phi @ P @ H.T + N) @ np.linalg.inv(S)
            x = Phi @ x + offset_at(model, k) + K_pred @ nu
            P = Phi @ P @ Phi.T + at(model.Qd, k) - K_pred @ S @ K_pred.T
    return Moments(*(np.array(column) for column in zip(*rows, strict=True)))


def high_precision(model: Any, z: ArrayLike, first: int = 1, digits: int = 60) -> Moments:
    """:func:`recursion` with ``digits`` decimal digits on the same doubles, rounded once at the end."""
    z = np.asarray(z, dtype=np.float64)
    rows = []
    with mpmath.workdps(digits):
        x, P = mpmath.matrix(model.x0.tolist()), mpmath.matrix(model.P0.tolist())
        for k in range(len(z)):
            used = present(model, z, k, first)
            Phi = at(model.Phi, min(k, len(z) - 2)).tolist()
            Phi, n = mpmath.matrix(Phi), len(Phi)
            x_plus, P_plus, K_pred, S, nu = x, P, mpmath.zeros(n, 1), mpmath.zeros(1), mpmath.zeros(1)
            if used.size:
                H, N = mpmath.matrix(at(model.H, k)[used].tolist()), mpmath.matrix(cross_at(model, k)[:, used].tolist())
                S = H * P * H.T + mpmath.matrix(at(model.R, k)[np.ix_(used, used)].tolist())
                nu, inverse = mpmath.matrix(z[k, used].tolist()) - H * x, S**-1
                K, K_pred = P * H.T * inverse, (Phi * P * H.T + N) * inverse
                x_plus, P_plus = x + K * nu, P - K * S * K.T
            rows.append((x, P, x_plus, P_plus))
            if k + 1 < len(z):
                x = Phi * x + mpmath.matrix(offset_at(model, k).tolist()) + K_pred * nu
                P = Phi * P * Phi.T + mpmath.matrix(at(model.Qd, k).tolist()) - K_pred * S * K_pred.T
    columns = [np.array([as_floats(value) for value in column]) for column in zip(*rows, strict=True)]
    return Moments(columns[0][:, :, 0], columns[1], columns[2][:, :, 0], columns[3])


def as_floats(matrix: Any) -> Array:
    """An mpmath matrix in double precision."""
    return np.array(matrix.tolist(), dtype=np.float64)


# --- the joint Gaussian distribution of the whole trajectory --------------------------------------------------------


class Joint(NamedTuple):
    """Mean and covariance of (x_0 … x_steps, z_0 … z_steps), stacked; absent elements of z have variance 0 here."""

    mean: Array
    cov: Array
    steps: int
    n: int
    m: int

    def x(self, k: int) -> slice:
        """Where x_k stands."""
        return slice(k * self.n, (k + 1) * self.n)

    def z(self, k: int, elements: ArrayLike) -> NDArray[np.intp]:
        """Where elements of z_k stand."""
        return (self.steps + 1) * self.n + k * self.m + np.asarray(elements, dtype=np.intp)


def joint(model: Any, steps: int) -> Joint:
    """Every x_k and z_k written as a linear map of the sources (x_0, w_0 …, v_0 …), whose covariance is given."""
    n, m = len(model.x0), model.H.shape[-2]
    sources = n + steps * n + (steps + 1) * m
    w, v = n, n + steps * n
    C = np.zeros((sources, sources))
    C[:n, :n] = model.P0
    for k in range(steps + 1):
        R = np.array(at(model.R, k))
        R[np.isinf(R)] = 0.0
        vk = slice(v + k * m, v + (k + 1) * m)
        C[vk, vk] = R
        if k < steps:
            wk = slice(w + k * n, w + (k + 1) * n)
            C[wk, wk] = at(model.Qd, k)
            C[wk, vk] = cross_at(model, k)
            C[vk, wk] = C[wk, vk].T
    states, means = [np.eye(n, sources)], [np.array(model.x0)]
    for k in range(steps):
        following = at(model.Phi, k) @ states[-1]
        following[:, w + k * n : w + (k + 1) * n] += np.eye(n)
        states.append(following)
        means.append(at(model.Phi, k) @ means[-1] + offset_at(model, k))
    measured, measured_means = [], []
    for k in range(steps + 1):
        row = at(model.H, k) @ states[k]
        row[:, v + k * m : v + (k + 1) * m] += np.eye(m)
        measured.append(row)
        measured_means.append(at(model.H, k) @ means[k])
    T = np.vstack(states + measured)
    return Joint(np.concatenate(means + measured_means), T @ C @ T.T, steps, n, m)


def condition(mean: Array, cov: Array, known: NDArray[np.intp], values: Array) -> tuple[Array, Array]:
    """Mean and covariance of everything given that some elements are known (Maybeck vol. 1, eq. 3-117)."""
    if not len(known):
        return mean, cov
    gain = cov[:, known] @ np.linalg.pinv(cov[np.ix_(known, known)], rcond=1e-13, hermitian=True)
    return mean + gain @ (values - mean[known]), cov - gain @ cov[known]


def _known(model: Any, z: Array, J: Joint, first: int, rows: range) -> tuple[NDArray[np.intp], Array]:
    found = [present(model, z, k, first) for k in rows]
    places = [J.z(k, elements) for k, elements in zip(rows, found, strict=True)]
    values = [z[k, elements] for k, elements in zip(rows, found, strict=True)]
    empty = np.zeros(0)
    return np.concatenate([empty, *places]).astype(np.intp), np.concatenate([empty, *values])


def conditioned(model: Any, z: ArrayLike, first: int = 1) -> Moments:
    """The filter by definition: the moments of x_k given z_first … z_{k−1} and z_first … z_k."""
    z = np.asarray(z, dtype=np.float64)
    J = joint(model, len(z) - 1)
    rows = []
    for k in range(len(z)):
        row: list[Array] = []
        for last in (k, k + 1):
            mean, cov = condition(J.mean, J.cov, *_known(model, z, J, first, range(last)))
            row += [mean[J.x(k)], cov[J.x(k), J.x(k)]]
        rows.append(row)
    return Moments(*(np.array(column) for column in zip(*rows, strict=True)))


def smoothed(model: Any, z: ArrayLike, first: int = 1) -> Trajectory:
    """The smoother by definition: the moments of every x_k given the whole record."""
    z = np.asarray(z, dtype=np.float64)
    J = joint(model, len(z) - 1)
    mean, cov = condition(J.mean, J.cov, *_known(model, z, J, first, range(len(z))))
    ks = range(len(z))
    return Trajectory(np.array([mean[J.x(k)] for k in ks]), np.array([cov[J.x(k), J.x(k)] for k in ks]))


def log_likelihood(model: Any, z: ArrayLike, first: int = 1) -> float:
    """The logarithm of the joint density of the measured elements."""
    z = np.asarray(z, dtype=np.float64)
    J = joint(model, len(z) - 1)
    known, values = _known(model, z, J, first, range(len(z)))
    residual, S = values - J.mean[known], J.cov[np.ix_(known, known)]
    return float(-0.5 * (residual @ np.linalg.solve(S, residual) + np.linalg.slogdet(2 * np.pi * S)[1]))


# --- least squares -------------------------------------------------------------------------------------------------


def least_squares(model: Any, z: ArrayLike, first: int = 1) -> Trajectory:
    """All x_k at once by weighted least squares: the smoother, and in its last entry the filter.

    Minimises ‖x_0 − x̄_0‖² in P0⁻¹ plus the squares of every (x_{k+1} − Φx_k − c, z_k − Hx_k) in the inverse of the
    joint covariance of (w_k, v_k); P0 and these covariances must be positive definite.
    """
    z = np.asarray(z, dtype=np.float64)
    steps, n = len(z) - 1, len(model.x0)
    blocks, values = [], []

    def add(block: Array, value: Array, covariance: Array) -> None:
        L = np.linalg.cholesky(covariance)
        blocks.append(np.linalg.solve(L, block))
        values.append(np.linalg.solve(L, value))

    add(np.eye(n, (steps + 1) * n), np.array(model.x0), np.array(model.P0))
    for k in range(steps + 1):
        used = present(model, z, k, first)
        H, R, N = at(model.H, k)[used], at(model.R, k)[np.ix_(used, used)], cross_at(model, k)[:, used]
        measured = np.zeros((len(used), (steps + 1) * n))
        measured[:, k * n : (k + 1) * n] = H
        if k == steps:
            if len(used):
                add(measured, z[k, used], R)
            continue
        moved = np.zeros((n, (steps + 1) * n))
        # The residuals, value − block·x, are w_k and v_k themselves: their signs matter where they correlate.
        moved[:, k * n : (k + 1) * n], moved[:, (k + 1) * n : (k + 2) * n] = at(model.Phi, k), -np.eye(n)
        add(
            np.vstack([moved, measured]),
            np.concatenate([-offset_at(model, k), z[k, used]]),
            np.block([[at(model.Qd, k), N], [N.T, R]]),
        )
    A, b = np.vstack(blocks), np.concatenate(values)
    x = np.linalg.lstsq(A, b)[0]
    inverse = np.linalg.pinv(A)
    cov = inverse @ inverse.T
    parts = [slice(k * n, (k + 1) * n) for k in range(steps + 1)]
    return Trajectory(np.array([x[p] for p in parts]), np.array([cov[p, p] for p in parts]))


def information(model: Any, steps: int, first: int = 1) -> Array:
    """The information on x_0 of P0 and the measurements where Qd = 0: P0⁻¹ + Σ ΨᵀHᵀR⁻¹HΨ."""
    J, Psi = np.linalg.inv(model.P0), np.eye(len(model.x0))
    for k in range(steps + 1):
        if k >= first:
            HPsi = at(model.H, k) @ Psi
            J = J + HPsi.T @ np.linalg.inv(at(model.R, k)) @ HPsi
        if k < steps:
            Psi = at(model.Phi, k) @ Psi
    return J


# --- exponentials in integers --------------------------------------------------------------------------------------------


def exponential(M: ArrayLike, h: float, bits: int) -> list[list[Fraction]]:
    """e^{Mh} by Taylor's series and squaring in integers of ``bits`` bits after the point."""
    step = Fraction(h) * 2**bits
    A = np.array([[int(Fraction(float(x)) * step) for x in row] for row in np.asarray(M)], dtype=object)
    halvings = max(0, int(abs(A).sum(axis=1).max()).bit_length() - bits) + 24
    A, one = A >> halvings, np.eye(len(A), dtype=object) * (1 << bits)
    total, term, j = one, one, 0
    while (abs(term) > 1).any():
        j += 1
        term = (A @ term >> bits) // j
        total = total + term
    for _ in range(halvings):
        total = total @ total >> bits
    return [[Fraction(x, 1 << bits) for x in row] for row in total.tolist()]


def interval(F: ArrayLike, W: ArrayLike, h: float) -> tuple[Array, Array, Array]:
    """Φ, Qd and Γ by Van Loan's block exponential, with bits enough for its e^{−Fh}: every double has all its digits."""
    F, W = np.array(F, dtype=float), np.array(W, dtype=float)
    n, zero = len(F), np.zeros_like(F)
    bits = 1500 + int(4 * np.abs(np.linalg.eigvals(F)).max() * h)
    van_loan = np.array(exponential(np.block([[-F, W], [zero, F.T]]), h, bits), dtype=object)
    inputs = np.array(exponential(np.block([[F, np.eye(n)], [zero, zero]]), h, bits), dtype=object)
    Phi, Gamma = inputs[:n, :n], inputs[:n, n:]
    Qd = van_loan[n:, n:].T @ van_loan[:n, n:]
    return Phi.astype(float), Qd.astype(float), Gamma.astype(float)
