r"""Textbook oracles, written plainly and apart from the library: what a test compares ctlabs with.

A model is read through its fields alone (Phi, Qd, H, R, x0, P0, N, offset; constant, or one more axis for the time),
a record z is (steps+1, m) with NaN where nothing is measured, and ``first`` has the library's meaning: with 1 the
row 0 of z is not used. Nothing here is imported from ctlabs.

An oracle must be more accurate than what it judges, on every processor. What needs an inverse, or is a small difference
of large terms, is therefore computed with ``DIGITS`` decimal digits, in arrays of ``decimal.Decimal``, from the very
doubles that the library was given (:func:`exact`), and rounded once at its end (:func:`as_floats`).
"""

from __future__ import annotations

import base64
import decimal
import functools
from decimal import Decimal
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[Any]

#: Decimal digits of what the oracles compute with.
DIGITS = 60
#: ln 2π.
LOG_2PI = Decimal("1.83787706640934548356065947281123527972279494727556682563430308096553139185452079538")
#: The rounding unit of doubles, 2⁻⁵².
EPS = 2.0**-52
#: Tolerance of algebra in floating point, relative to the size of what is compared.
EXACT = 1e-12
#: Tolerance of Riccati and Lyapunov solvers, relative to the size of what is compared.
SOLVER = 1e-8


# --- numbers of many digits ----------------------------------------------------------------------------------------


def precisely(function: Any) -> Any:
    """The function with ``DIGITS`` digits inside, or with those of the context that it is called in, if they are more."""

    @functools.wraps(function)
    def run(*args: Any, **named: Any) -> Any:
        with decimal.localcontext(prec=max(DIGITS, decimal.getcontext().prec)):
            return function(*args, **named)

    return run


_decimals = np.frompyfunc(lambda number: Decimal(float(number)), 1, 1)


def exact(numbers: ArrayLike) -> Array:
    """The same numbers as Decimals, without rounding; ``@``, ``+`` and ``*`` then keep the digits of the context."""
    array = np.asarray(numbers)
    return array.copy() if array.dtype == object else np.asarray(_decimals(array), dtype=object)


def as_floats(numbers: Any) -> Array:
    """Numbers of any precision, in an array or a matrix of mpmath, rounded to doubles."""
    return np.array(numbers.tolist(), dtype=np.float64)


def identity(n: int) -> Array:
    """I with Decimals."""
    return exact(np.eye(n))


@precisely
def solve(A: ArrayLike, B: ArrayLike) -> Array:
    """X of AX = B by elimination with row pivots, B (n,) or (n, k), in Decimals."""
    A, X = exact(A), exact(B)
    for i in range(len(A)):
        pivot = i + int(np.argmax(np.abs(A[i:, i])))
        A[[i, pivot]], X[[i, pivot]] = A[[pivot, i]], X[[pivot, i]]
        X[i], A[i] = X[i] / A[i, i], A[i] / A[i, i]
        for j in range(len(A)):
            if j != i and A[j, i]:
                X[j], A[j] = X[j] - A[j, i] * X[i], A[j] - A[j, i] * A[i]
    return X


def inverse(A: ArrayLike) -> Array:
    """A⁻¹ in Decimals."""
    return solve(A, identity(len(np.asarray(A))))


# --- how close -----------------------------------------------------------------------------------------------------


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
    return float(np.abs(first - second).max(initial=0.0) / size) if size else 0.0


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


@precisely
def predict(x: Array, P: Array, Phi: Array, Qd: Array, c: Array | float = 0.0) -> tuple[Array, Array]:
    """x⁻ = Φx⁺ + c, P⁻ = ΦP⁺Φᵀ + Qd."""
    x, P, Phi, Qd, c = (exact(given) for given in (x, P, Phi, Qd, c))
    return as_floats(Phi @ x + c), as_floats(Phi @ P @ Phi.T + Qd)


@precisely
def update(x: Array, P: Array, z: Array, H: Array, R: Array) -> tuple[Array, Array, Array]:
    """x⁺ = x⁻ + Kν, P⁺ = (I − KH)P⁻, K = P⁻Hᵀ(HP⁻Hᵀ + R)⁻¹, with a plain inverse; returns x⁺, P⁺, K."""
    x, P, z, H, R = (exact(given) for given in (x, P, z, H, R))
    K = P @ H.T @ inverse(H @ P @ H.T + R)
    return as_floats(x + K @ (z - H @ x)), as_floats(P - K @ H @ P), as_floats(K)


@precisely
def information_update(x: Array, P: Array, z: Array, H: Array, R: Array) -> tuple[Array, Array, Array]:
    """The same from (P⁺)⁻¹ = (P⁻)⁻¹ + HᵀR⁻¹H and K = P⁺HᵀR⁻¹ (P⁻ and R must be invertible)."""
    x, P, z, H, R = (exact(given) for given in (x, P, z, H, R))
    P_plus = inverse(inverse(P) + H.T @ inverse(R) @ H)
    K = P_plus @ H.T @ inverse(R)
    return as_floats(x + K @ (z - H @ x)), as_floats(P_plus), as_floats(K)


@precisely
def recursion(model: Any, z: ArrayLike, first: int = 1) -> Moments:
    r"""The textbook filter; where w and v correlate as a one-step predictor.

    .. math:: \hat x^-_{k+1} = \Phi\hat x^-_k + c + K_p\nu,\ P^-_{k+1} = \Phi P^-\Phi^T + Q_d - K_pSK_p^T,\
              K_p = (\Phi P^-H^T + N)S^{-1}
    """
    z = np.asarray(z, dtype=np.float64)
    x, P = exact(model.x0), exact(model.P0)
    rows = []
    for k in range(len(z)):
        used = present(model, z, k, first)
        H, R, N = (exact(M) for M in (at(model.H, k)[used], at(model.R, k)[np.ix_(used, used)], cross_at(model, k)[:, used]))
        S, nu = H @ P @ H.T + R, exact(z[k, used]) - H @ x
        S_inverse = inverse(S)
        K = P @ H.T @ S_inverse
        rows.append((x, P, x + K @ nu, P - K @ H @ P))
        if k + 1 < len(z):
            Phi = exact(at(model.Phi, k))
            K_pred = (Phi @ P @ H.T + N) @ S_inverse
            x = Phi @ x + exact(offset_at(model, k)) + K_pred @ nu
            P = Phi @ P @ Phi.T + exact(at(model.Qd, k)) - K_pred @ S @ K_pred.T
    return Moments(*(np.array([as_floats(value) for value in column]) for column in zip(*rows, strict=True)))


def high_precision(model: Any, z: ArrayLike, first: int = 1, digits: int = DIGITS) -> Moments:
    """:func:`recursion` with more than ``DIGITS`` digits."""
    with decimal.localcontext(prec=digits):
        return recursion(model, z, first)


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


@precisely
def joint(model: Any, steps: int) -> Joint:
    """Each z_k = Hx_k + v and x_{k+1} = Φx_k + c + w is joined to what precedes it, in Decimals."""
    n, m = len(model.x0), model.H.shape[-2]
    size = (steps + 1) * (n + m)
    J = Joint(exact(np.zeros(size)), exact(np.zeros((size, size))), steps, n, m)
    J.mean[J.x(0)], J.cov[J.x(0), J.x(0)] = exact(model.x0), exact(model.P0)

    def join(place: slice, M: Array, source: slice, noise: Array) -> None:
        """The element M·(the source) + a noise of the given covariance, independent of all elements so far."""
        M = exact(M)
        J.mean[place], J.cov[place] = M @ J.mean[source], M @ J.cov[source]
        J.cov[:, place] = J.cov[place].T
        J.cov[place, place] = M @ J.cov[source, source] @ M.T + exact(noise)

    for k in range(steps + 1):
        zk = slice(J.z(k, 0), J.z(k, m))
        R = at(model.R, k)
        join(zk, at(model.H, k), J.x(k), np.where(np.isinf(R), 0.0, R))
        if k < steps:
            join(J.x(k + 1), at(model.Phi, k), J.x(k), at(model.Qd, k))
            J.mean[J.x(k + 1)] += exact(offset_at(model, k))
            J.cov[J.x(k + 1), zk] += exact(cross_at(model, k))
            J.cov[zk, J.x(k + 1)] = J.cov[J.x(k + 1), zk].T
    return J


@precisely
def condition(J: Joint, known: NDArray[np.intp], values: Array, sizes: Array) -> Joint:
    """Moments of everything given that some elements are known, one after another (Maybeck vol. 1, eq. 3-117).

    An element that follows from those before it tells nothing more: of its variance, at first ``sizes``, only rounding is
    left (:func:`follows`).
    """
    mean, cov = J.mean, J.cov
    for i, value in zip(known, exact(values), strict=True):
        if not follows(cov[i, i], sizes[i]):
            gain = cov[i] / cov[i, i]
            mean, cov = mean + gain * (value - mean[i]), cov - np.multiply.outer(gain, cov[i])
    return J._replace(mean=mean, cov=cov)


def follows(left: Decimal, size: Decimal) -> bool:
    """Whether of a variance of a given size next to nothing is left: 10 to the power of −3/4 of the digits."""
    return left <= size.scaleb(-3 * decimal.getcontext().prec // 4)


def _known(model: Any, z: Array, J: Joint, first: int, rows: range) -> tuple[NDArray[np.intp], Array]:
    found = [present(model, z, k, first) for k in rows]
    places = [J.z(k, elements) for k, elements in zip(rows, found, strict=True)]
    values = [z[k, elements] for k, elements in zip(rows, found, strict=True)]
    empty = np.zeros(0)
    return np.concatenate([empty, *places]).astype(np.intp), np.concatenate([empty, *values])


def learned(model: Any, z: ArrayLike, first: int = 1) -> list[Joint]:
    """The joint distribution of everything given nothing, z up to row 0, up to row 1, … and the whole record; rounded."""
    z = np.asarray(z, dtype=np.float64)
    J = joint(model, len(z) - 1)
    found, sizes = [J], J.cov.diagonal()
    for k in range(len(z)):
        found.append(condition(found[-1], *_known(model, z, J, first, range(k, k + 1)), sizes))
    return [given._replace(mean=as_floats(given.mean), cov=as_floats(given.cov)) for given in found]


def conditioned(model: Any, z: ArrayLike, first: int = 1) -> Moments:
    """The filter by definition: the moments of x_k given z_first … z_{k−1} and z_first … z_k."""
    given = learned(model, z, first)
    rows = [
        (before.mean[x], before.cov[x, x], after.mean[x], after.cov[x, x])
        for x, before, after in zip(map(given[0].x, range(len(given))), given[:-1], given[1:], strict=False)
    ]
    return Moments(*(np.array(column) for column in zip(*rows, strict=True)))


def smoothed(model: Any, z: ArrayLike, first: int = 1) -> Trajectory:
    """The smoother by definition: the moments of every x_k given the whole record."""
    return states(learned(model, z, first)[-1])


def states(J: Joint) -> Trajectory:
    """The moments of every x_k."""
    parts = [J.x(k) for k in range(J.steps + 1)]
    return Trajectory(np.array([J.mean[p] for p in parts]), np.array([J.cov[p, p] for p in parts]))


@precisely
def log_likelihood(model: Any, z: ArrayLike, first: int = 1) -> float:
    """The logarithm of the joint density of the measured elements, the product of each one's given those before it.

    An element that follows from those before it has no density.
    """
    z = np.asarray(z, dtype=np.float64)
    J = joint(model, len(z) - 1)
    known, values = _known(model, z, J, first, range(len(z)))
    nu, S, total = exact(values) - J.mean[known], J.cov[np.ix_(known, known)], Decimal(0)
    for size in S.diagonal().copy():
        if not follows(S[0, 0], size):
            total -= (nu[0] ** 2 / S[0, 0] + S[0, 0].ln() + LOG_2PI) / 2
            gain = S[1:, 0] / S[0, 0]
            nu[1:], S[1:, 1:] = nu[1:] - gain * nu[0], S[1:, 1:] - np.multiply.outer(gain, S[0, 1:])
        nu, S = nu[1:], S[1:, 1:]
    return float(total)


# --- least squares -------------------------------------------------------------------------------------------------


@precisely
def least_squares(model: Any, z: ArrayLike, first: int = 1, P0: Array | None = None) -> Trajectory:
    """All x_k at once by weighted least squares: the smoother, and in its last entry the filter.

    Minimises ‖x_0 − x̄_0‖² in P0⁻¹ plus the squares of every (x_{k+1} − Φx_k − c, z_k − Hx_k) in the inverse of the
    joint covariance of (w_k, v_k); these covariances must be positive definite. ``P0``, in the place of the model's, may
    have infinite variances: of such a state nothing is known, and the measurements must determine it.
    """
    P0 = model.P0 if P0 is None else P0
    z = np.asarray(z, dtype=np.float64)
    steps, n = len(z) - 1, len(model.x0)
    J, y = exact(np.zeros(((steps + 1) * n, (steps + 1) * n))), exact(np.zeros((steps + 1) * n))

    def add(block: Array, value: Array, covariance: Array) -> None:
        """The squares of value − block·x in the inverse of the covariance, in the normal equations Jx = y."""
        nonlocal J, y
        weighted = exact(block).T @ inverse(covariance)
        J, y = J + weighted @ exact(block), y + weighted @ exact(value)

    told = np.flatnonzero(np.isfinite(np.diag(P0)))
    if told.size:
        add(np.eye(n, (steps + 1) * n)[told], model.x0[told], P0[np.ix_(told, told)])
    for k in range(steps + 1):
        used = present(model, z, k, first)
        H, R, N = at(model.H, k)[used], at(model.R, k)[np.ix_(used, used)], cross_at(model, k)[:, used]
        measured = np.zeros((len(used), (steps + 1) * n))
        measured[:, k * n : (k + 1) * n] = H
        if k == steps:
            if used.size:
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
    P = inverse(J)
    x, P = as_floats(P @ y), as_floats(P)
    parts = [slice(k * n, (k + 1) * n) for k in range(steps + 1)]
    return Trajectory(np.array([x[p] for p in parts]), np.array([P[p, p] for p in parts]))


@precisely
def information(model: Any, steps: int, first: int = 1) -> Array:
    """The information on x_0 of P0 and the measurements where Qd = 0: P0⁻¹ + Σ ΨᵀHᵀR⁻¹HΨ."""
    J, Psi = inverse(model.P0), identity(len(model.x0))
    for k in range(steps + 1):
        if k >= first:
            HPsi = exact(at(model.H, k)) @ Psi
            J = J + HPsi.T @ inverse(at(model.R, k)) @ HPsi
        if k < steps:
            Psi = exact(at(model.Phi, k)) @ Psi
    return as_floats(J)


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


#: A picture of one dot, for reports whose figures nobody looks at.
PNG = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAADElEQVR4nGNgYGAAAAAEAAH2FzhVAAAAAElFTkSu"
    "QmCC"
)
