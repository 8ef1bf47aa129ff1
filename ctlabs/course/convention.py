"""What an answer that is not the right one may be: the right one in another unit, or what a known confusion gives."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from functools import lru_cache

import numpy as np

from ctlabs.course.asked import AskedValue
from ctlabs.course.units import UnitError, coherent, unit
from ctlabs.linalg.checks import Array
from ctlabs.text import SURE

#: What people write for a unit, one for another. Tenths are no unit of theirs: a shifted point is a mistake of arithmetic.
INSTEAD = {
    "m": ("cm", "mm", "km"), "s": ("ms", "min", "h"), "V": ("mV", "kV"), "rad": ("°", "mrad"), "1": ("%",), "%": ("1",),
}  # fmt: skip
#: Quantities whose square is another quantity.
_VARIANCE, _DEVIATION = re.compile(r"variance(?!.*ratio)"), re.compile(r"(^|_)(rms|sd|sigma)(_|$)")


def confused(asked: AskedValue) -> Mapping[str, Array]:
    """What known confusions give: those that the key names, and the square root of a variance.

    >>> from ctlabs.course.asked import THREE_DIGITS
    >>> P = AskedValue("posterior_variance", "c", "P", "variance", "m²", np.array(0.25), THREE_DIGITS, 0.0, {})
    >>> confused(P)
    {'standard deviation for variance': array(0.5)}
    """
    found = dict(asked.others)
    if _VARIANCE.search(asked.name) and (asked.value >= 0).all():
        found.setdefault("standard deviation for variance", np.asarray(np.sqrt(asked.value)))
    elif _DEVIATION.search(asked.name):
        found.setdefault("variance for standard deviation", np.asarray(asked.value**2))
    return found


@lru_cache(maxsize=256)
def scales(name: str) -> tuple[tuple[str, float], ...]:
    """Units that may stand for an asked one, and by what a number in them is larger.

    >>> scales("m²")
    (('cm²', 10000.0), ('mm²', 1000000.0), ('km²', 1e-06))
    >>> scales("1")
    (('%', 100.0),)
    """
    wanted = coherent(name)
    if wanted is None:
        return ()
    found: dict[str, float] = {}
    for other in _written(name):
        try:
            told = unit(other)
        except UnitError:
            continue
        if told.dimension == wanted.dimension and not math.isclose(told.factor, wanted.factor):
            found.setdefault(other, float(f"{wanted.factor / told.factor:.{SURE}g}"))
    return tuple(found.items())


def _written(name: str) -> Iterator[str]:
    """The unit with one of its symbols replaced."""
    if name in ("1", "", "%"):
        yield from INSTEAD["%" if name == "%" else "1"]
        return
    if name == "m/s":
        yield "km/h"
    symbols = {found[0] for found in re.finditer(r"[^\W\d_⁰¹²³⁴⁵⁶⁷⁸⁹]+", name)}
    for symbol in sorted(symbols & INSTEAD.keys()):
        for other in INSTEAD[symbol]:
            yield re.sub(rf"(?<![^\W\d_⁰¹²³⁴⁵⁶⁷⁸⁹]){symbol}(?![^\W\d_⁰¹²³⁴⁵⁶⁷⁸⁹])", other, name)
