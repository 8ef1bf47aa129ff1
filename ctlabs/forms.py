r"""Numerically different forms of one filter: what rounding does to each, and what each costs.

Algebraically all of them are the Kalman filter; measurements are processed one element at a time (R diagonal).

- ``conventional``: :math:`P^+ = P^- - KHP^-`, the short form
- ``joseph``: :math:`P^+ = (I-KH)P^-(I-KH)^T + KRK^T`
- ``potter``: a square root, :math:`P = SS^T`
- ``ud``: Bierman's and Thornton's factors, :math:`P = U\,\mathrm{diag}(d)\,U^T`, without square roots

Every form is written once, for any kind of number: with doubles it filters, with numbers of 50 digits it is the
reference, with numbers that count their operations it gives the cost.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ctlabs import _check
from ctlabs._check import Array
from ctlabs.discretise import ldl
from ctlabs.models import DiscreteModel, at

#: Arrays of doubles, of mpmath numbers, or of counted ones.
Numbers = NDArray[Any]
Parts = tuple[Numbers, ...]
#: Digits of the reference.
DIGITS = 50


@dataclass(frozen=True, slots=True, eq=False)
class Filtered:
    """``x_plus`` (steps+1, n), ``P_plus`` (steps+1, n, n): one record filtered by one form, rounded to doubles."""

    x_plus: Array
    P_plus: Array


class Comparison(NamedTuple):
    """One form on one record, against the filter with 50 digits on the same doubles.

    ``flops`` per step (one prediction and one update, dense matrices; a square root is one operation) · ``error_P``, the largest
    ‖P⁺ − P_ref‖/‖P_ref‖ · ``error_variance`` (n,), the largest relative error of each variance of P⁺ (of one
    that should be 0: the standard deviation left, as a fraction of the largest) · ``error_x`` (n,), the largest error of each estimate
    """

    name: str
    flops: int
    error_P: float
    error_variance: Array
    error_x: Array


class _Form(NamedTuple):
    """How a form keeps P0 and Qd (as tuples of arrays, made in double precision) and carries P."""

    begin: Callable[[Array], Parts]
    noise: Callable[[Array], Parts]
    predict: Callable[[Parts, Numbers, Parts], Parts]
    update: Callable[[Parts, Numbers, Any], tuple[Parts, Numbers]]
    covariance: Callable[[Parts], Numbers]


def run(model: DiscreteModel, z: ArrayLike, form: str, first: int = 1) -> Filtered:
    """Filter one record with one form, in double precision.

    Parameters
    ----------
    model : discrete, R diagonal, without N
    z : (steps+1, m), NaN = not measured
    form : a name of :data:`FORMS`
    first : 1 (first measurement at t1) or 0 (at t0)

    Raises
    ------
    ValueError
        A form of another name; correlated measurement noise (decorrelate it first) or N; z of another shape.

    Source: Bierman, *Factorization Methods for Discrete Sequential Estimation* (1977), chapters V and VI.

    >>> m = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])
    >>> run(m, [[0.0], [1.0], [2.0]], "ud").P_plus[1:, 0, 0].round(6)
    array([0.916667, 0.657143])
    """
    return _rounded(*_run(model, _record(model, z), form, first, float))


def reference(model: DiscreteModel, z: ArrayLike, first: int = 1) -> Filtered:
    """The same filter computed with 50 digits from the same doubles, and rounded once at the end."""
    import mpmath

    with mpmath.workdps(DIGITS):
        return _rounded(*_run(model, _record(model, z), "joseph", first, mpmath.mpf))


def flops(model: DiscreteModel, form: str) -> int:
    """Additions, multiplications, divisions and square roots of one step, counted while it is done.

    >>> m = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])
    >>> flops(m, "conventional") < flops(m, "joseph")
    True
    """
    _Counted.total = 0
    _run(model, np.zeros((2, model.m)), form, 1, _Counted, steps=1)
    return _Counted.total


def compare(
    model: DiscreteModel, z: ArrayLike, forms: Sequence[str] | None = None, first: int = 1
) -> tuple[Comparison, ...]:
    """Several forms (all by default) on one record: errors by rounding, and cost.

    >>> m = DiscreteModel([[1]], [[1]], [[1]], [[1e-14]], x0=[0], P0=[[1]])
    >>> [c.error_P > 1e-4 for c in compare(m, [[0.0], [1.0]])]
    [True, False, False, False]
    """
    exact, found = reference(model, z, first), []
    for name in FORMS if forms is None else forms:
        own = run(model, z, name, first)
        difference, size = (
            np.linalg.norm(own.P_plus - exact.P_plus, axis=(1, 2)),
            np.linalg.norm(exact.P_plus, axis=(1, 2)),
        )
        variances, wanted = (np.diagonal(P, axis1=1, axis2=2) for P in (own.P_plus, exact.P_plus))
        found.append(
            Comparison(
                name,
                flops(model, name),
                float(_relative(difference, size).max()),
                _relative(np.abs(variances - wanted), wanted).max(axis=0),
                np.abs(own.x_plus - exact.x_plus).max(axis=0),
            )
        )
    return tuple(found)


def _relative(difference: Array, size: Array) -> Array:
    """difference/size; where the size is 0 the standard deviation left, as a fraction of the largest one."""
    left = np.sqrt(difference / (size.max() or np.finfo(float).tiny))
    return np.where(size > 0, difference / np.where(size > 0, size, 1.0), left)


def _record(model: DiscreteModel, z: ArrayLike) -> Array:
    _check.instance("model", model, DiscreteModel)
    data = np.array(z, dtype=np.float64)
    if data.ndim != 2 or data.shape[1] != model.m or len(data) < 2:
        msg = f"z: expected shape (steps+1, {model.m}), received {data.shape}"
        raise ValueError(msg)
    return data


def _run(
    model: DiscreteModel, z: Array, form: str, first: int, kind: Any, steps: int | None = None
) -> tuple[list[Numbers], list[Numbers]]:
    """Estimates and covariances in the arithmetic of ``kind``."""
    if form not in FORMS:
        msg = f"form: expected one of {', '.join(FORMS)}, received {form!r}"
        raise ValueError(msg)
    diagonal = model.R == np.where(np.eye(model.m, dtype=bool), model.R, 0.0)
    if not diagonal.all() or (model.N is not None and model.N.any()):
        msg = "model: expected uncorrelated noises (R diagonal, no N), received correlated ones: decorrelate them first"
        raise ValueError(msg)
    how = FORMS[form]
    x, P = _as(model.x0, kind), tuple(_as(part, kind) for part in how.begin(np.array(model.P0)))
    x_plus, P_plus = [], []
    for k in range(len(z)):
        if k:
            Phi = _as(at(model.Phi, k - 1, 2), kind)
            noise = tuple(_as(part, kind) for part in how.noise(np.array(at(model.Qd, k - 1, 2))))
            x, P = Phi @ x, how.predict(P, Phi, noise)
            if model.offset is not None:
                x = x + _as(at(model.offset, k - 1, 1), kind)
        H, R = at(model.H, k, 2), np.diag(at(model.R, k, 2))
        for i in np.flatnonzero(np.isfinite(R) & np.isfinite(z[k]) & (k >= first)):
            h = _as(H[i], kind)
            innovation = kind(z[k, i]) - h @ x
            P, K = how.update(P, h, kind(R[i]))
            x = x + K * innovation
        x_plus.append(x)
        if steps is None:
            P_plus.append(how.covariance(P))
    return x_plus, P_plus


def _as(values: Array, kind: Any) -> Numbers:
    """An array of numbers of a kind."""
    if kind is float:
        return np.array(values, dtype=np.float64)
    numbers = np.empty(np.shape(values), dtype=object)
    numbers.ravel()[:] = [kind(float(v)) for v in np.ravel(values)]
    return numbers


def _rounded(x: list[Numbers], P: list[Numbers]) -> Filtered:
    return Filtered(np.array(x).astype(np.float64), np.array(P).astype(np.float64))


class _Counted:
    """A double that counts what is done with it."""

    __slots__ = ("value",)
    total = 0

    def __init__(self, value: float) -> None:
        self.value = float(value)

    def __bool__(self) -> bool:
        return bool(self.value)


def _counts(operation: Callable[[float, float], float], *, swapped: bool) -> Callable[[_Counted, Any], _Counted]:
    def apply(self: _Counted, other: Any) -> _Counted:
        if isinstance(other, np.ndarray):
            return NotImplemented  # element by element, by the array
        _Counted.total += 1
        pair = (self.value, float(getattr(other, "value", other)))
        return _Counted(operation(*(pair[::-1] if swapped else pair)))

    return apply


for _name in ("add", "sub", "mul", "truediv", "pow"):
    for _prefix in ("", "r"):
        setattr(_Counted, f"__{_prefix}{_name}__", _counts(getattr(operator, _name), swapped=bool(_prefix)))


# The forms -----------------------------------------------------------------------------------------------------------


def _gain(f: Numbers, s: Any) -> Numbers:
    """f/s, and 0 for a perfect measurement of something known."""
    return f / s if s else np.zeros_like(f)


def _whole(P: Array) -> Parts:
    return (P,)


def _predicted(P: Parts, Phi: Numbers, Q: Parts) -> Parts:
    return (Phi @ P[0] @ Phi.T + Q[0],)


def _short(P: Parts, h: Numbers, r: Any) -> tuple[Parts, Numbers]:
    f = P[0] @ h
    K = _gain(f, h @ f + r)
    return (P[0] - np.outer(K, h @ P[0]),), K


def _joseph(P: Parts, h: Numbers, r: Any) -> tuple[Parts, Numbers]:
    f = P[0] @ h
    K = _gain(f, h @ f + r)
    left = np.eye(len(h)) - np.outer(K, h)
    return (left @ P[0] @ left.T + np.outer(K * r, K),), K


def _root(P: Array) -> Parts:
    L, d = ldl(P)
    return (L * np.sqrt(d),)


def _potter_predict(S: Parts, Phi: Numbers, Q: Parts) -> Parts:
    """The lower triangular factor of ΦSSᵀΦᵀ + Q by modified Gram–Schmidt on the rows of [ΦS, Q½]."""
    rows, n = np.hstack([Phi @ S[0], Q[0]]), len(Phi)
    factor = np.zeros_like(Phi)
    for i in range(n):
        factor[i, i] = (rows[i] @ rows[i]) ** 0.5
        if factor[i, i]:
            rows[i] = rows[i] / factor[i, i]
            for j in range(i + 1, n):
                factor[j, i] = rows[j] @ rows[i]
                rows[j] = rows[j] - factor[j, i] * rows[i]
    return (factor,)


def _potter(S: Parts, h: Numbers, r: Any) -> tuple[Parts, Numbers]:
    f = S[0].T @ h
    s, Sf = f @ f + r, S[0] @ f
    if not s:
        return S, np.zeros_like(Sf)
    return (S[0] - np.outer(Sf, f / (s + (s * r) ** 0.5)),), Sf / s


def _ud_begin(P0: Array) -> Parts:
    L, d = ldl(np.array(P0[::-1, ::-1]))  # U comes from below, L from above
    return L[::-1, ::-1].copy(), d[::-1].copy()


def _ud_predict(P: Parts, Phi: Numbers, Q: Parts) -> Parts:
    """Thornton's weighted Gram–Schmidt of the rows of [ΦU, L] with the weights (d, d_Q)."""
    rows, weights, n = np.hstack([Phi @ P[0], Q[0]]), np.concatenate([P[1], Q[1]]), len(Phi)
    U, d = np.eye(n, dtype=Phi.dtype), np.zeros_like(P[1])
    for j in reversed(range(n)):
        weighted = weights * rows[j]
        d[j] = rows[j] @ weighted
        if d[j]:
            for i in range(j):
                U[i, j] = rows[i] @ weighted / d[j]
                rows[i] = rows[i] - U[i, j] * rows[j]
    return U, d


def _ud(P: Parts, h: Numbers, r: Any) -> tuple[Parts, Numbers]:
    """Bierman's update."""
    U, d = P[0].copy(), P[1].copy()
    a = U.T @ h
    b, before, K = d * a, r, np.zeros_like(d)
    for j in range(len(d)):
        s = before + a[j] * b[j]
        if s:
            d[j] = d[j] * before / s
        old = U[:j, j].copy()
        if before:
            U[:j, j] = old - K[:j] * (a[j] / before)
        K[:j] = K[:j] + old * b[j]
        K[j], before = b[j], s
    return (U, d), _gain(K, before)


FORMS: dict[str, _Form] = {
    "conventional": _Form(_whole, _whole, _predicted, _short, lambda P: P[0]),
    "joseph": _Form(_whole, _whole, _predicted, _joseph, lambda P: P[0]),
    "potter": _Form(_root, _root, _potter_predict, _potter, lambda S: S[0] @ S[0].T),
    "ud": _Form(_ud_begin, ldl, _ud_predict, _ud, lambda P: (P[0] * P[1]) @ P[0].T),
}
