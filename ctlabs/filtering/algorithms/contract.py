r"""What every form of the filter promises, and the arithmetic they share.

A form is a module with three functions: ``start``, ``predict``, ``update`` (:class:`Form`). It carries a state (a NamedTuple of
arrays) from instant to instant, :class:`CovarianceState`, :class:`RootState` or one of its own making, which says what it means by its
``mean``, the estimate (n, runs), or (n, 1) before data of several runs came in, and ``covariance``, that of its error (n, n):

.. math:: x \leftarrow \Phi x + c, \quad P \leftarrow \Phi P\Phi^T + Q; \qquad
          z = Hx + v,\ E[vv^T] = R

Estimates are columns, (n, runs): one covariance serves all runs. Everything is written once for any kind of number:
doubles (float64 arrays) filter, mpmath's numbers (object arrays) are the reference with 50 digits, and
:class:`Counted` numbers (object arrays) give the cost. Therefore a form takes square roots as ``x**0.5``, makes zeros
and unit matrices by :func:`zeros` and :func:`identity`, and leaves linear algebra to the functions below: LAPACK for
doubles, plain loops for the others. What every step of the quickest forms does is ``A.dot(B)``: of small matrices it takes half the
time of ``A @ B``.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from functools import cached_property, lru_cache
from typing import Any, NamedTuple, NoReturn, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from ctlabs.linalg import factors, rounding
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel

#: Arrays of doubles, of mpmath numbers, or of counted ones.
Numbers = NDArray[Any]
LOG_2PI = float(np.log(2 * np.pi))


class Evidence(NamedTuple):
    """What the elements of one instant say of the model: ``log_likelihood`` (runs,) and ``nis`` (runs,), νᵀS⁻¹ν.

    Of the innovation *before* the update. Made by :func:`evidence`, :func:`independent` or :func:`whitened`.
    """

    log_likelihood: Numbers
    nis: Numbers


class CovarianceState(NamedTuple):
    """``x`` (n, runs) · ``P`` (n, n)."""

    x: Numbers
    P: Numbers

    @property
    def mean(self) -> Numbers:
        """The estimate, (n, runs)."""
        return self.x

    @property
    def covariance(self) -> Numbers:
        """The covariance of its error, (n, n)."""
        return self.P


class RootState(NamedTuple):
    """``x`` (n, runs) · ``root`` (n, n), P = root·rootᵀ."""

    x: Numbers
    root: Numbers

    @property
    def mean(self) -> Numbers:
        """The estimate, (n, runs)."""
        return self.x

    @property
    def covariance(self) -> Numbers:
        """The covariance of its error, (n, n)."""
        return self.root.dot(self.root.T)


class Form(Protocol):
    """The functions of a form's module. Each returns a new state and leaves the given one as it is."""

    def start(self, model: DiscreteModel, P0: Numbers) -> Any:
        """The state at t0: mean ``model.x0``, covariance ``P0`` (n, n), which stands in place of ``model.P0``.

        It is finite: where nothing is known of a state the driver begins by :mod:`ctlabs.filtering.algorithms.vague`.
        """

    def predict(self, state: Any, Phi: Numbers, c: Numbers | None, Q: Noise) -> Any:
        """One step ahead; c is (n, 1), (n, runs) or ``None`` (nothing to add)."""

    def update(self, state: Any, z: Numbers, H: Numbers, R: Noise) -> tuple[Any, Evidence]:
        """One instant's measurements: z (m, runs), H (m, n); only elements that are measured, m ≥ 1.

        Of perfect elements (R = 0) those that are known already have been left out by the driver.
        """


class Noise:
    """A covariance and its factors, computed when first asked for.

    ``matrix`` (n, n) · ``L``, ``d``: M = L diag(d) Lᵀ with a unit lower triangular L; d has exact zeros where M is
    singular · ``root`` (n, n): L√d, lower triangular · ``thin`` (n, rank): its columns that are not zero, and
    ``thin_L``, ``thin_d`` likewise · ``diagonal``: whether M is · ``singular``

    The factors are made once for all steps with the same matrix, so counted numbers do not count them.
    """

    def __init__(self, matrix: Numbers) -> None:
        self.matrix = matrix

    @cached_property
    def _factors(self) -> tuple[Numbers, Numbers]:
        if self.matrix.dtype == np.float64:
            return factors.ldl(self.matrix)
        if kind_of(self.matrix) is Counted:
            L, d = factors.ldl(doubles(self.matrix))
            return numbers(L, Counted), numbers(d, Counted)
        return ldl(self.matrix)

    @property
    def L(self) -> Numbers:
        """The unit lower triangular factor."""
        return self._factors[0]

    @property
    def d(self) -> Numbers:
        """The diagonal factor, (n,)."""
        return self._factors[1]

    @cached_property
    def root(self) -> Numbers:
        """L√d, lower triangular."""
        L, d = doubles(self.L), doubles(self.d)
        return like(L * np.sqrt(d), self.L) if kind_of(self.L) is Counted else self.L * self.d**0.5

    @cached_property
    def _rank(self) -> NDArray[np.intp]:
        return np.flatnonzero(doubles(self.d))

    @cached_property
    def thin(self) -> Numbers:
        """The columns of ``root`` that are not zero, (n, rank)."""
        return self.root[:, self._rank]

    @cached_property
    def thin_L(self) -> Numbers:
        """The columns of ``L`` with d > 0, (n, rank)."""
        return self.L[:, self._rank]

    @cached_property
    def thin_d(self) -> Numbers:
        """The elements of ``d`` above 0, (rank,)."""
        return self.d[self._rank]

    @cached_property
    def columns(self) -> Numbers:
        """A root (n, rank) whose columns have no order: :func:`rooted`."""
        if kind_of(self.matrix) is Counted:
            return numbers(rooted(doubles(self.matrix)), Counted)
        return rooted(self.matrix)

    @cached_property
    def diagonal(self) -> bool:
        """Whether the matrix is diagonal."""
        M = doubles(self.matrix)
        return not M[~np.eye(len(M), dtype=bool)].any()

    @property
    def singular(self) -> bool:
        """Whether it has no inverse."""
        return len(self._rank) < len(self.d)


def refuse(form: str, expected: str, received: str) -> NoReturn:
    """The ``ValueError`` of a form that cannot do what it is asked for."""
    msg = f"form {form}: expected {expected}, received {received}"
    raise ValueError(msg)


def known(form: str, P0: Numbers) -> Numbers:
    """P0, refused where nothing is known of a state (``inf``): a form takes over when something is."""
    if unknown(P0).any():
        refuse(form, "a finite P0", "inf on its diagonal (nothing known)")
    return P0


def unknown(P: Numbers) -> NDArray[np.bool_]:
    """The states of which nothing is known, (n,): an infinite variance."""
    return np.isinf(doubles(P.diagonal()))


def definite(P: Numbers) -> bool:
    """Whether a covariance has an inverse that rounding leaves something of (whatever the units of its states)."""
    M = doubles(P)
    sd = np.sqrt(M.diagonal())
    return bool(sd.all()) and bool(np.linalg.eigvalsh(M / np.outer(sd, sd))[0] > 64 * len(M) * np.finfo(float).eps)


# Kinds of numbers -----------------------------------------------------------------------------------------------------


def numbers(values: Any, kind: Any) -> Numbers:
    """An array of numbers of a kind (``float``, ``mpmath.mpf``, :class:`Counted`) from doubles."""
    if kind is float:
        return np.array(values, dtype=np.float64)
    result = np.empty(np.shape(values), dtype=object)
    result.ravel()[:] = [kind(float(v)) for v in np.ravel(values)]
    return result


def kind_of(values: Numbers) -> Any:
    """The kind of an array's numbers."""
    return float if values.dtype == np.float64 or not values.size else type(values.flat[0])


def like(values: Any, other: Numbers) -> Numbers:
    """Doubles as numbers of the kind of ``other``."""
    return numbers(values, kind_of(other))


def doubles(values: Numbers) -> Array:
    """Any numbers, rounded to doubles."""
    return values if values.dtype == np.float64 else values.astype(np.float64)


def zeros(shape: int | tuple[int, ...], other: Numbers) -> Numbers:
    """Zeros of the kind of ``other`` (``np.zeros`` with dtype object would give integers, and 1/3 of them doubles)."""
    return np.zeros(shape) if other.dtype == np.float64 else like(np.zeros(shape), other)


def identity(n: int, other: Numbers) -> Numbers:
    """The unit matrix in the kind of ``other``; that of doubles is kept, and cannot be written."""
    return _unit(n) if other.dtype == np.float64 else like(np.eye(n), other)


@lru_cache(maxsize=64)
def _unit(n: int) -> Array:
    """The unit matrix in doubles."""
    unit = np.eye(n)
    unit.setflags(write=False)
    return unit


def column(model: DiscreteModel, P0: Numbers) -> Numbers:
    """x0 as an (n, 1) column in the kind of P0: what ``start`` begins with."""
    return like(model.x0[:, None], P0)


class Counted:
    """A double that counts what is done with it: + − × ÷ and powers (a square root is one operation)."""

    __slots__ = ("value",)
    total = 0

    def __init__(self, value: float) -> None:
        self.value = float(value)

    def __bool__(self) -> bool:
        return bool(self.value)

    def __float__(self) -> float:
        return self.value

    def __abs__(self) -> Counted:
        return Counted(abs(self.value))

    def __neg__(self) -> Counted:
        return Counted(-self.value)

    def __lt__(self, other: Any) -> bool:
        return self.value < float(other)

    def __gt__(self, other: Any) -> bool:
        return self.value > float(other)

    def __le__(self, other: Any) -> bool:
        return self.value <= float(other)

    def __ge__(self, other: Any) -> bool:
        return self.value >= float(other)


def _counts(operation: Callable[[float, float], float], *, swapped: bool) -> Callable[[Counted, Any], Counted]:
    def apply(self: Counted, other: Any) -> Counted:
        if isinstance(other, np.ndarray):
            return NotImplemented  # element by element, by the array
        Counted.total += 1
        pair = (self.value, float(other))
        return Counted(operation(*(pair[::-1] if swapped else pair)))

    return apply


for _name in ("add", "sub", "mul", "truediv", "pow"):
    for _prefix in ("", "r"):
        setattr(Counted, f"__{_prefix}{_name}__", _counts(getattr(operator, _name), swapped=bool(_prefix)))


# What a filter does in any form ---------------------------------------------------------------------------------------


def moved(Phi: Numbers, x: Numbers, c: Numbers | None) -> Numbers:
    """Φx + c."""
    return Phi.dot(x) if c is None else Phi.dot(x) + c


def decorrelated(z: Numbers, H: Numbers, R: Noise) -> tuple[Numbers, Numbers, Numbers]:
    """L⁻¹z, L⁻¹H and the variances d of the independent noises of its elements, from R = L diag(d) Lᵀ.

    For forms that take one element after another (Bierman 1977, section IV.2).
    """
    if R.diagonal:
        return z, H, R.matrix.diagonal()
    both = substituted(R.L, np.hstack([z, H]))
    return both[:, : z.shape[1]], both[:, z.shape[1] :], R.d


def evidence(nu: Numbers, S: Numbers) -> Evidence:
    """Of an innovation ν (m, runs) with the covariance S (m, m); NaN where rounding has made S indefinite."""
    if S.dtype == np.float64 and len(S):
        C, info = lapack.dpotrf(S, lower=1)
        if not info:
            return whitened(lapack.dtrtrs(C, nu, lower=1)[0], C.diagonal())
    if kind_of(nu) is Counted:
        return independent(nu, S.diagonal())
    d, white = eliminated(S, nu)
    return independent(white, d)


def independent(nu: Numbers, s: Numbers) -> Evidence:
    """Of independent innovations ν (m, runs) with variances s (m,); one with s = 0 says nothing.

    Counted numbers do not count it: no estimate depends on it.
    """
    if kind_of(nu) is Counted:
        nothing = zeros(nu.shape[1], nu)
        return Evidence(nothing, nothing)
    if not s.all():
        nu, s = nu[s != 0], s[s != 0]
    nis = _squares(nu, nu / s[:, None])
    return Evidence(-0.5 * (nis + (_logs(s) + len(s) * _log_2pi(nu))), nis)


def whitened(e: Numbers, c: Numbers) -> Evidence:
    """Of e = C⁻¹ν (m, runs) where S = CCᵀ, c (m,) being the diagonal of the triangular C."""
    if kind_of(e) is Counted:
        return independent(e, c)
    nis = _squares(e, e)
    return Evidence(-0.5 * (nis + (2 * _logs(abs(c)) + len(c) * _log_2pi(e))), nis)


def _squares(a: Numbers, b: Numbers) -> Numbers:
    """The sums of the products of columns (m, runs)."""
    return a[:, 0].dot(b) if a.shape[1] == 1 else (a * b).sum(axis=0)


def _log_2pi(values: Numbers) -> Any:
    if values.dtype == np.float64:
        return LOG_2PI
    import mpmath

    return mpmath.log(2 * mpmath.pi)


def _logs(values: Numbers) -> Any:
    """The sum of the natural logarithms; NaN if one is of a negative number."""
    if values.dtype == np.float64:
        return sum([math.log(v) if v > 0 else -math.inf if v == 0 else math.nan for v in values.tolist()])
    import mpmath

    return sum((mpmath.log(v) if v > 0 else mpmath.nan for v in values), mpmath.mpf(0))


# Linear algebra by two routes -----------------------------------------------------------------------------------------


def triangular(A: Numbers) -> Numbers:
    """The lower triangular L (p, p) with LLᵀ = AAᵀ and no negative diagonal, for A (p, q)."""
    p, q = A.shape
    if not q:
        return zeros((p, p), A)
    if q >= p and A.dtype == np.float64:
        R = lapack.dgeqrf(A.T)[0][:p]
        return R.T * _lower(p) * np.copysign(1.0, R.diagonal())
    L = triangularised(A, p)
    return L[:, :p].copy() if q >= p else np.hstack([L, zeros((p, p - q), A)])


def triangularised(A: Numbers, rows: int) -> Numbers:
    """AΘ, Θ orthogonal, of the same shape as A: its first ``rows`` rows lower triangular, no negative diagonal.

    The rows below take part in the rotation without being made triangular (gains and states ride along).
    """
    corner = min(rows, A.shape[1])
    if A.dtype == np.float64:
        R, tau, _, _ = lapack.dgeqrf(A[:rows].T)
        result = np.empty_like(A)
        if rows < len(A):
            result[rows:] = lapack.dormqr("L", "T", R[:, : len(tau)], tau, A[rows:].T, 64 * len(A))[0].T
        result[:rows, :corner] = R.T[:, :corner] * _lower(rows)[:, :corner]
        result[:rows, corner:] = 0.0
        result[:, :corner] *= np.copysign(1.0, R.diagonal())
        return result
    result = _reflected(A, rows)
    negative = result.diagonal()[:corner] < 0
    if negative.any():
        result[:, :corner][:, negative] = -result[:, :corner][:, negative]
    return result


@lru_cache(maxsize=64)
def _lower(p: int) -> Array:
    """Ones on and below the diagonal, (p, p)."""
    ones = np.tri(p)
    ones.setflags(write=False)
    return ones


def _reflected(A: Numbers, rows: int) -> Numbers:
    """Householder's reflections from the right, for any kind of number."""
    A = A.copy()
    for i in range(min(A[:rows].shape)):
        v = A[i, i:].copy()
        if not any(v[1:]):
            continue
        norm = (v @ v) ** 0.5
        pivot = norm if v[0] < 0 else -norm
        v[0] = v[0] - pivot
        A[i + 1 :, i:] = A[i + 1 :, i:] - np.outer(A[i + 1 :, i:] @ v, v * (2 / (v @ v)))
        A[i, i + 1 :] = zeros(A.shape[1] - i - 1, v)
        A[i, i] = pivot
    return A


def ldl(M: Numbers) -> tuple[Numbers, Numbers]:
    """L (n, n), d (n,) with M = L diag(d) Lᵀ, for any kind of number.

    As :func:`ctlabs.linalg.factors.ldl`: what is left of a variance below the rounding *of doubles* is zero, as M was given
    in doubles.
    """
    n = len(M)
    L, d, rest = identity(n, M).copy(), zeros(n, M), M.copy()
    for j in range(n):
        if rest[j, j] <= 4 * n * float(np.finfo(float).eps) * M[j, j]:
            continue
        d[j] = rest[j, j]
        L[j + 1 :, j] = rest[j + 1 :, j] / d[j]
        rest[j + 1 :, j + 1 :] = rest[j + 1 :, j + 1 :] - np.outer(L[j + 1 :, j], rest[j + 1 :, j])
    return L, d


def rooted(M: Numbers) -> Numbers:
    """Columns A (n, rank) with M = AAᵀ up to the rounding of each state's own variance.

    The state of whose variance most is left comes next (a fraction, so that units do not matter): what is left in the end is small
    for all states at once. In the states' own order a variance may vanish while much of its covariances is left.
    """
    n, rest, found = len(M), M.copy(), list[Numbers]()
    variance, lost = doubles(M.diagonal()), rounding.MARGIN * n * precision(M)
    left = np.where(variance > 0, 1.0, 0.0)
    while left.any():
        j = int(left.argmax())
        if left[j] <= lost:
            break
        column = rest[:, j] / rest[j, j] ** 0.5
        rest = rest - np.outer(column, column)
        rest[j, :], rest[:, j] = zeros(n, M), zeros(n, M)
        found.append(column)
        left = np.where(variance > 0, doubles(rest.diagonal()) / np.where(variance > 0, variance, 1.0), 0.0)
    return np.column_stack(found) if found else zeros((n, 0), M)


def precision(values: Numbers) -> float:
    """The relative precision of a kind of number."""
    if values.dtype == np.float64 or kind_of(values) is Counted:
        return rounding.EPS
    import mpmath

    return float(mpmath.mp.eps)


def eliminated(S: Numbers, right: Numbers) -> tuple[Numbers, Numbers]:
    """d (m,) and L⁻¹·right of S = L diag(d) Lᵀ without any threshold; S may be indefinite by rounding."""
    m = len(S)
    if m > 1 and S.dtype == np.float64:
        C, info = lapack.dpotrf(S, lower=1)
        if not info:
            c = C.diagonal()
            return c * c, c[:, None] * lapack.dtrtrs(C, right, lower=1)[0]
    S, right = S.copy(), right.copy()
    for j in range(m - 1):
        if not S[j, j]:
            continue
        factors = S[j + 1 :, j] / S[j, j]
        S[j + 1 :, j + 1 :] = S[j + 1 :, j + 1 :] - np.outer(factors, S[j, j + 1 :])
        right[j + 1 :] = right[j + 1 :] - np.outer(factors, right[j])
    return S.diagonal(), right


def solve(A: Numbers, B: Numbers) -> Numbers:
    """A⁻¹B for A (n, n), B (n, k); ``numpy.linalg.LinAlgError`` where A is singular."""
    if len(A) == 1:
        return B / _pivot(A[0, 0])
    if A.dtype == np.float64:
        X, info = lapack.dgesv(A, B)[2:]
        _pivot(not info)
        return X
    A, B, n = A.copy(), B.copy(), len(A)
    for j in range(n):
        i = j + int(np.argmax(np.abs(doubles(A[j:, j]))))
        _pivot(A[i, j])
        A[[j, i]], B[[j, i]] = A[[i, j]], B[[i, j]]
        factors = A[j + 1 :, j] / A[j, j]
        A[j + 1 :, j + 1 :] = A[j + 1 :, j + 1 :] - np.outer(factors, A[j, j + 1 :])
        B[j + 1 :] = B[j + 1 :] - np.outer(factors, B[j])
    return substituted_back(A, B)


def inverse(A: Numbers) -> Numbers:
    """A⁻¹ for A (n, n); ``numpy.linalg.LinAlgError`` where A is singular."""
    return solve(A, identity(len(A), A))


def cholesky(A: Numbers) -> Numbers:
    """The lower triangular L with A = LLᵀ; ``numpy.linalg.LinAlgError`` unless A is positive definite."""
    if A.dtype == np.float64:
        L, info = lapack.dpotrf(A, lower=1)
        _pivot(not info)
        return L
    n = len(A)
    L = zeros((n, n), A)
    for j in range(n):
        rest = A[j:, j] - L[j:, :j] @ L[j, :j] if j else A[:, 0]
        _pivot(rest[0] > 0)
        L[j, j] = rest[0] ** 0.5
        L[j + 1 :, j] = rest[1:] / L[j, j]
    return L


def substituted(L: Numbers, B: Numbers) -> Numbers:
    """L⁻¹B by forward substitution: L (n, n) lower triangular (what is above its diagonal is not read), B (n, k)."""
    if L.dtype == np.float64:
        X, info = lapack.dtrtrs(L, B, lower=1)
        _pivot(not info)
        return X
    X = B.copy()
    for i in range(len(L)):
        X[i] = (X[i] - L[i, :i] @ X[:i] if i else X[i]) / _pivot(L[i, i])
    return X


def substituted_back(U: Numbers, B: Numbers) -> Numbers:
    """U⁻¹B by back substitution: U (n, n) upper triangular (what is below its diagonal is not read), B (n, k)."""
    return substituted(U[::-1, ::-1], B[::-1])[::-1].copy()


def _pivot(value: Any) -> Any:
    """A pivot that is not zero."""
    if not value:
        msg = "expected a regular matrix, received a singular one"
        raise np.linalg.LinAlgError(msg)
    return value
