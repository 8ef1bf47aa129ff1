"""Checks of the input, done once at the edge of the library.

Every message has one style: *what*, expected, received ("G: expected shape (3, s), received (2, 1)").
A letter in an expected shape (``s``, ``m``) is a dimension that the caller is free to choose.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: float64 where nothing else is said (poles are complex, masks Boolean); numpy's own stubs give no more than this.
Array = NDArray[Any]

#: Asymmetry or negative eigenvalues below this fraction of a matrix's size are rounding, above it a mistake.
ROUNDING = 1e-9
#: A negative variance below this fraction of a matrix's size is the rounding of another program, and counts as zero.
LOST = 1e-15
#: A size that no matrix falls below, so that it divides.
TINY = float(np.finfo(float).tiny)


def array(name: str, value: ArrayLike, *, finite: bool = True) -> Array:
    """A read-only float64 copy of ``value``; NaN is refused always, infinity unless ``finite=False``."""
    try:
        # numpy would drop imaginary parts with no more than a warning
        result = None if np.iscomplexobj(value) else np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        result = None
    if result is None:
        msg = f"{name}: expected real numbers, received {' '.join(repr(value).split())}"
        raise TypeError(msg)
    right = np.isfinite(result) if finite else ~np.isnan(result)
    if not right.all():
        where = tuple(int(i) for i in np.argwhere(~right)[0])
        msg = f"{name}: expected finite numbers, received {result[where]} at {list(where)}"
        raise ValueError(msg)
    result.setflags(write=False)
    return result


def _shape_text(shape: tuple[int | str, ...]) -> str:
    return "(" + ", ".join(str(d) for d in shape) + ("," if len(shape) == 1 else "") + ")"


def fits(shape: tuple[int, ...], expected: tuple[int | str, ...]) -> bool:
    """Whether ``shape`` is ``expected``, where a letter in ``expected`` stands for any size."""
    return shape == expected or (
        len(shape) == len(expected)
        and all(isinstance(e, str) or e == d for d, e in zip(shape, expected, strict=True))
    )


def shaped(name: str, value: ArrayLike, *expected: tuple[int | str, ...], finite: bool = True) -> Array:
    """``value`` as a read-only array of one of the ``expected`` shapes."""
    result = array(name, value, finite=finite)
    if not any(fits(result.shape, shape) for shape in expected):
        wanted = " or ".join(_shape_text(shape) for shape in expected)
        msg = f"{name}: expected shape {wanted}, received {_shape_text(result.shape)}"
        raise ValueError(msg)
    return result


def covariance(name: str, value: ArrayLike, *expected: tuple[int | str, ...]) -> Array:
    """A symmetric nonnegative definite matrix, or a stack of them; rounding asymmetry is removed, more is refused."""
    return _nonnegative_definite(name, shaped(name, value, *expected), "variances")


def weight(name: str, value: ArrayLike, *expected: tuple[int | str, ...]) -> Array:
    """:func:`covariance` of what weighs a square, in a cost."""
    return _nonnegative_definite(name, shaped(name, value, *expected), "weights")


def _nonnegative_definite(name: str, result: Array, what: str) -> Array:
    """A matrix, or a stack of them, whose diagonal is called ``what`` in messages; read-only."""
    if result.shape[-1] != result.shape[-2]:
        msg = f"{name}: expected a square matrix, received {_shape_text(result.shape)}"
        raise ValueError(msg)
    M = np.ascontiguousarray(result) if result.ndim == 2 else np.moveaxis(result, 0, -1).copy()  # of a stack every element is one long row
    if (M != M.swapaxes(0, 1)).any():
        asymmetry = np.abs(M - M.swapaxes(0, 1)).max(axis=(0, 1), initial=0.0)
        if (asymmetry > ROUNDING * _size(M)).any():
            msg = f"{name}: expected a symmetric matrix, received one with asymmetry {asymmetry.max():.3g}"
            raise ValueError(msg)
        M = 0.5 * (M + M.swapaxes(0, 1))
    # Scaling to a unit diagonal makes the test independent of the units of the states.
    own = np.arange(len(M))
    diagonal = M[own, own]
    none = diagonal < 0
    if none.any():
        if (diagonal < -LOST * _size(M)).any():
            msg = f"{name}: expected {what} >= 0 on the diagonal, received {diagonal.min():.6g}"
            raise ValueError(msg)
        # what rounding left of a variance of zero
        M = np.where(none[:, None] | none[None], 0.0, M)
        diagonal = M[own, own]
    if len(M) > 1:
        scale = np.sqrt(np.where(diagonal > 0, diagonal, _size(M)))
        lowest = _lowest(M / (scale[:, None] * scale[None]))
        if lowest < -ROUNDING:
            msg = f"{name}: expected a nonnegative definite matrix, received one with eigenvalue {lowest:.3g} (scaled to unit diagonal)"
            raise ValueError(msg)
    result = M if result.ndim == 2 else np.moveaxis(M, -1, 0).copy()
    result.setflags(write=False)
    return result


def _size(M: Array) -> Array:
    """The largest element of M, or of each of a stack (n, n, k); something above 0."""
    return np.maximum(np.abs(M).max(axis=(0, 1), initial=0.0), TINY)


def _lowest(M: Array) -> float:
    """The lowest eigenvalue of M, or of a stack (n, n, k); 0 where none is below −ROUNDING, as pivots of M + ½ ROUNDING I show."""
    if M.ndim == 2:
        return float(np.linalg.eigvalsh(M).min(initial=0.0))
    left, own = M.copy(), np.arange(len(M))
    left[own, own] += 0.5 * ROUNDING
    with np.errstate(all="ignore"):
        for j in range(len(M)):
            if not (left[j, j] > 0).all():
                return float(np.linalg.eigvalsh(np.moveaxis(M, -1, 0)).min(initial=0.0))
            row = left[j, j + 1 :] / left[j, j]
            left[j + 1 :, j + 1 :] -= left[j + 1 :, j, None] * row[None]
    return 0.0


def measurement_covariance(name: str, value: ArrayLike, *expected: tuple[int | str, ...]) -> Array:
    """Like ``covariance``, but ``inf`` on the diagonal is allowed: an element not measured, or a state not known."""
    result = shaped(name, value, *expected, finite=False)
    if np.isfinite(result).all():
        return _nonnegative_definite(name, result, "variances")
    missing = np.isinf(np.diagonal(result, axis1=-2, axis2=-1))
    if (np.diagonal(result, axis1=-2, axis2=-1) == -np.inf).any():
        msg = f"{name}: expected variances >= 0 on the diagonal, received -inf"
        raise ValueError(msg)
    either = missing[..., :, None] | missing[..., None, :]
    off = either & ~np.eye(result.shape[-1], dtype=bool)
    if (result[off] != 0).any():
        msg = f"{name}: expected 0 beside an infinite variance, received a correlation"
        raise ValueError(msg)
    result = np.where(either, result, covariance(name, np.where(either, 0.0, result), *expected))
    result.setflags(write=False)
    return result


def finite_start(what: str, P0: Array) -> None:
    """Refuse a P0 of which a part is not known (``inf``) where no data tell it: ``what`` needs a finite one."""
    if not np.isfinite(P0).all():
        msg = f"P0: expected finite variances ({what} has no data to start from), received inf (nothing known)"
        raise ValueError(msg)


def count(name: str, value: object, *, least: int = 1) -> int:
    """A whole number not below ``least`` (True and 2.0 are no counts)."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        msg = f"{name}: expected a whole number >= {least}, received {value!r}"
        raise ValueError(msg)
    return int(value)


def positive(name: str, value: object) -> float:
    """A finite number above zero."""
    if (
        isinstance(value, bool)
        or not isinstance(value, int | float | np.integer | np.floating)
        or not 0 < float(value) < np.inf
    ):
        msg = f"{name}: expected a number > 0, received {value!r}"
        raise ValueError(msg)
    return float(value)


def labels(name: str, value: tuple[str, ...] | list[str] | None, size: int, letter: str) -> tuple[str, ...]:
    """``size`` names, or the defaults x1, x2, … of ``letter``; an empty letter gives empty strings."""
    if value is None:
        return tuple(f"{letter}{i + 1}" if letter else "" for i in range(size))
    if not isinstance(value, tuple | list) or len(value) != size or not all(isinstance(v, str) for v in value):
        msg = f"{name}: expected {size} names, received {value!r}"
        raise ValueError(msg)
    return tuple(value)


def nonnegative(name: str, value: object) -> float:
    """A finite number ≥ 0."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not 0 <= float(value) < np.inf:
        msg = f"{name}: expected a number >= 0, received {value!r}"
        raise ValueError(msg)
    return float(value)


def instance(name: str, value: object, kind: type) -> None:
    """A ``TypeError`` unless ``value`` is of ``kind``: a continuous model never reaches a discrete filter."""
    if not isinstance(value, kind):
        msg = f"{name}: expected a {kind.__name__}, received a {type(value).__name__}"
        raise TypeError(msg)
