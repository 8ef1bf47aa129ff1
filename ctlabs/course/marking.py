r"""What an answer is: right, right but for its unit, its sign, its rows, its convention; or wrong, and by how much.

An element x̂ of an answer is right where :math:`|\hat x - x| \le` ``allowed``, which admits the rounding to three significant digits
(half a unit of the third is at most 0.5 %) and no error of 2 %. An answer is right where all its elements are; what is not right is
held against what known mistakes would have given, in the order of :class:`Kind`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from ctlabs.course.asked import AskedValue
from ctlabs.course.convention import confused, scales
from ctlabs.course.units import coherent
from ctlabs.course.values import Received
from ctlabs.linalg.checks import Array
from ctlabs.text import number

#: Rounding of a number in binary, and of a unit's factor.
ROUNDING = 1e-9


class Kind(StrEnum):
    """What an answer is."""

    RIGHT = "right"
    UNIT = "right, but in another unit"
    TRANSPOSED = "transposed"
    SIGN = "right but for the sign"
    OTHER = "another convention"
    WRONG = "wrong"
    UNREADABLE = "not readable"
    NONE = "no answer"


#: The part of a value's credit that each kind earns.
CREDIT = {
    Kind.RIGHT: 1.0, Kind.UNIT: 0.5, Kind.TRANSPOSED: 0.5, Kind.SIGN: 0.5, Kind.OTHER: 0.5,
    Kind.WRONG: 0.0, Kind.UNREADABLE: 0.0, Kind.NONE: 0.0,
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class ValueMark:
    """What an answer is: ``kind``, in ``words``, and the largest relative ``error`` of an element (NaN where there is none to tell).

    ``values`` : as received, in the asked unit, None where nothing could be read · ``line`` of the file, 0 where there is none
    """

    asked: AskedValue
    kind: Kind
    words: str
    error: float = math.nan
    values: Array | None = None
    text: str = ""
    line: int = 0


def mark(asked: AskedValue, received: Received | None, line: int = 0) -> ValueMark:
    """The mark of an answer.

    >>> from ctlabs.course.asked import THREE_DIGITS
    >>> from ctlabs.course.values import answer
    >>> K = AskedValue("gain", "c", "K", "gain", "1", np.array(0.52346), THREE_DIGITS, 0.0, {"K_pred for K": np.array(0.4083)})
    >>> [mark(K, answer(text, ())).words for text in ("0,523", "52.3", "-0.523", "0.408", "0.534")]
    ['right', 'right, but in another unit: % for 1', 'right but for the sign', 'another convention: K_pred for K', 'wrong by 2 %']
    """
    if received is None:
        return ValueMark(asked, Kind.NONE, Kind.NONE.value, line=line)
    values, kind, words = _in_unit(asked, received)
    error = _error(asked, values)
    if not kind:
        kind, words = _kind(asked, values, received.unit is None, error)
    if kind == Kind.RIGHT and received.turned:
        words = "right (rows and columns exchanged)"
    return ValueMark(asked, kind, words or kind.value, error, values, received.text, line)


def agrees(asked: AskedValue, values: Array, wanted: Array | None = None) -> bool:
    """Whether each element is what is ``wanted`` (the right answer), in the digits that count; NaN in it is asked of nobody."""
    return bool(_elements(asked, values, asked.value if wanted is None else wanted).all())


def _elements(asked: AskedValue, values: Array, wanted: Array) -> Array:
    """Which elements agree."""
    if wanted.dtype == bool:
        return np.asarray(values == wanted)
    allowed = (asked.relative * np.abs(wanted) + asked.absolute) * (1 + ROUNDING)
    with np.errstate(invalid="ignore"):
        near = np.abs(values - wanted) <= np.where(np.isfinite(allowed), allowed, 0.0)
    found: Array = near | (values == wanted) | np.isnan(wanted)
    return found


def _in_unit(asked: AskedValue, received: Received) -> tuple[Array, Kind | None, str]:
    """The numbers in the asked unit; a verdict where the unit alone decides."""
    values, told, wanted = received.values, received.unit, coherent(asked.unit)
    if told is None or values.dtype == bool:
        return values, None, ""
    if wanted is None:
        if math.isclose(told.factor, 1.0):
            return values, None, ""
        return values, Kind.UNIT, f"{Kind.UNIT}: expected coherent units ({asked.unit})" if agrees(asked, values) else ""
    if told.dimension == wanted.dimension:
        return values / wanted.factor, None, ""
    bare = values / told.factor
    if agrees(asked, bare):
        return bare, Kind.UNIT, f"the number is right, its unit is not: expected {asked.unit}"
    return bare, Kind.WRONG, f"wrong, and its unit is not {asked.unit}"


def _kind(asked: AskedValue, values: Array, bare: bool, error: float) -> tuple[Kind, str]:
    wanted = asked.value
    if agrees(asked, values):
        return Kind.RIGHT, ""
    if wanted.dtype == bool:
        return Kind.WRONG, Kind.WRONG.value
    if _free(asked) and _proportional(asked, values):
        return Kind.RIGHT, "right (up to a factor, which is free)"
    if wanted.ndim >= 2 and wanted.shape[-1] == wanted.shape[-2] and agrees(asked, np.swapaxes(values, -1, -2)):
        return Kind.TRANSPOSED, ""
    if agrees(asked, -values):
        return Kind.SIGN, ""
    if agrees(asked, np.abs(values), np.abs(wanted)):
        count = int((~_elements(asked, values, wanted)).sum())
        return Kind.SIGN, f"{Kind.SIGN} of {count} of {wanted.size} elements"
    names = [name for name, other in confused(asked).items() if _is(asked, values, other)]
    if names:
        return Kind.OTHER, f"{Kind.OTHER}: {' or '.join(names)}"
    for name, factor in scales(asked.unit) if bare and np.any(wanted) else ():
        if agrees(asked, values / factor):
            return Kind.UNIT, f"{Kind.UNIT}: {name} for {asked.unit or '1'}"
    return Kind.WRONG, _how_wrong(asked, values, error)


def _is(asked: AskedValue, values: Array, other: Array) -> bool:
    """Whether an answer is what a confusion gives, where that differs from the right one."""
    return other.shape == asked.value.shape and agrees(asked, values, other) and not agrees(asked, other)


def _free(asked: AskedValue) -> bool:
    """Whether a common factor is free: a direction, and the two polynomials of a transfer function."""
    return asked.name.split("_variant")[0].endswith(("direction", "transfer_function")) or "direction" in asked.name


def _proportional(asked: AskedValue, values: Array) -> bool:
    wanted = np.nan_to_num(asked.value)
    at = int(np.argmax(np.abs(wanted)))
    own = values.ravel()[at]
    return bool(np.isfinite(own) and own != 0) and agrees(asked, values * (wanted.ravel()[at] / own))


def _error(asked: AskedValue, values: Array) -> float:
    """The largest relative error of an element; infinite where the right one is zero."""
    wanted = asked.value
    if wanted.dtype == bool:
        return math.nan
    off = ~_elements(asked, values, wanted) & np.isfinite(wanted)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        part = np.abs(values - wanted) / np.abs(wanted)
    if not off.any():
        part, off = np.where(wanted == 0, 0.0, part), np.isfinite(wanted)
    left = part[off]
    return float(np.nanmax(left)) if left.size and not np.isnan(left).all() else math.nan


def _how_wrong(asked: AskedValue, values: Array, error: float) -> str:
    good = _elements(asked, values, asked.value)
    size = f"by {number(100 * error, 2)} %" if math.isfinite(error) else ""
    if asked.value.ndim == 0:
        return f"wrong {size}".strip()
    left_out, wrong = int(np.isnan(values).sum()), int((~good).sum())
    place = np.unravel_index(int(np.argmin(good)), good.shape)
    where = ", ".join(str(int(i) + 1) for i in place)
    said = f"wrong: {wrong} of {good.size} elements, the first at {where if len(place) == 1 else f'({where})'}"
    return said + (f", {size.replace('by', 'by up to', 1)}" if size else "") + (f"; {left_out} left out" if left_out else "")
