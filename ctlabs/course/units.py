"""Units as people write them: m²/s, m^2/s, m2 s-1, cm, mrad, °, %, м²/с.

.. code-block:: text

    unit   = power { ("·" | "*" | " ") power } { "/" power }       after the first "/" no product: a/b·c has two readings
    power  = symbol [ ["^" | "**"] whole number ] | "1" | "(" unit ")" [ … ]

A unit is a factor to the coherent unit of SI and the exponents of what it is made of. Radians and per cent are numbers.
"""

from __future__ import annotations

import math
import re
import string
from functools import lru_cache
from typing import NamedTuple

from ctlabs.text import LOWERED

#: What exponents belong to: kg, m, s, A, K, and the units of the sheets that no one has elsewhere.
BASES = ("kg", "m", "s", "A", "K", "b", "u", "flop")
#: Longest text that is looked at.
LENGTH = 60
#: Largest exponent.
POWER = 12


class WrittenUnit(NamedTuple):
    """``factor`` to the coherent unit, ``dimension`` : exponents of BASES."""

    factor: float
    dimension: tuple[int, ...]

    def times(self, other: WrittenUnit, power: int = 1) -> WrittenUnit:
        """Its product with a power of another."""
        dimension = tuple(a + power * b for a, b in zip(self.dimension, other.dimension, strict=True))
        return WrittenUnit(self.factor * other.factor**power, dimension)


ONE = WrittenUnit(1.0, (0,) * len(BASES))


def _made(factor: float = 1.0, **exponents: int) -> WrittenUnit:
    return WrittenUnit(factor, tuple(exponents.get(base, 0) for base in BASES))


_V = {"kg": 1, "m": 2, "s": -3, "A": -1}
#: Units that take prefixes, by their symbols and the letters by which they are written in Russian.
PREFIXED = {
    "m": _made(m=1), "s": _made(s=1), "g": _made(1e-3, kg=1), "A": _made(A=1), "K": _made(K=1), "b": _made(b=1), "u": _made(u=1),
    "V": _made(**_V), "Hz": _made(s=-1), "N": _made(kg=1, m=1, s=-2), "J": _made(kg=1, m=2, s=-2), "W": _made(kg=1, m=2, s=-3),
    "Pa": _made(kg=1, m=-1, s=-2), "C": _made(A=1, s=1), "Ω": _made(kg=1, m=2, s=-3, A=-2), "F": _made(kg=-1, m=-2, s=4, A=2),
    "H": _made(kg=1, m=2, s=-2, A=-2), "rad": ONE, "flop": _made(flop=1),
}  # fmt: skip
#: Units that take none.
PLAIN = {
    **{name: WrittenUnit(factor, ONE.dimension) for name, factor in (("%", 1e-2), ("‰", 1e-3), ("°", math.pi / 180))},
    **dict.fromkeys("'′", WrittenUnit(math.pi / 10800, ONE.dimension)), "″": WrittenUnit(math.pi / 648000, ONE.dimension),
    "min": _made(60.0, s=1), "h": _made(3600.0, s=1), "d": _made(86400.0, s=1),
    "km/h": _made(1 / 3.6, m=1, s=-1), "kn": _made(1852 / 3600, m=1, s=-1), "rpm": _made(math.pi / 30, s=-1), "SI": ONE,
}  # fmt: skip
#: Other spellings.
SPELLED = {
    "deg": "°", "degree": "°", "degrees": "°", "град": "°", "º": "°", "percent": "%", "prozent": "%", "arcmin": "'", "arcsec": "″",
    "meter": "m", "metre": "m", "meters": "m", "metres": "m", "sec": "s", "secs": "s", "second": "s", "seconds": "s", "c": "s",
    "hour": "h", "hours": "h", "hr": "h", "minute": "min", "minutes": "min", "day": "d", "days": "d", "volt": "V", "volts": "V",
    "radian": "rad", "radians": "rad", "Ohm": "Ω", "ohm": "Ω", "Ω": "Ω", "flops": "flop",
    "м": "m", "с": "s", "сек": "s", "г": "g", "А": "A", "К": "K", "В": "V", "Гц": "Hz", "Н": "N", "Дж": "J", "Вт": "W", "Па": "Pa",
    "Ом": "Ω", "Ф": "F", "Гн": "H", "рад": "rad", "мин": "min", "ч": "h", "час": "h", "сут": "d", "б": "b",
}  # fmt: skip
PREFIXES = {
    "Y": 1e24, "Z": 1e21, "E": 1e18, "P": 1e15, "T": 1e12, "G": 1e9, "M": 1e6, "k": 1e3, "h": 1e2, "da": 1e1, "d": 1e-1, "c": 1e-2,
    "m": 1e-3, "µ": 1e-6, "μ": 1e-6, "n": 1e-9, "p": 1e-12, "f": 1e-15,
    "Т": 1e12, "Г": 1e9, "М": 1e6, "к": 1e3, "д": 1e-1, "с": 1e-2, "м": 1e-3, "мк": 1e-6, "н": 1e-9, "п": 1e-12,
}  # fmt: skip
_RAISED = LOWERED | {ord("−"): "-"}
_TOKEN = re.compile(
    r"\s*(?:(?P<symbol>[^\W\d_⁰¹²³⁴⁵⁶⁷⁸⁹]+|[%‰°º'′″])|(?P<one>1)(?!\d)|(?P<opening>\()|(?P<closing>\))|(?P<mark>[·⋅*×/]))"
    r"(?(mark)|(?(opening)|(?P<power>\s*(?:\^|\*\*)\s*(?:\(\s*[-+−]?\d{1,3}\s*\)|[-+−]?\d{1,3})|[⁻⁺]?[⁰¹²³⁴⁵⁶⁷⁸⁹]{1,3}|[-−]?\d{1,3})?))"
)


class UnitError(ValueError):
    """A text that is no unit."""


@lru_cache(maxsize=4096)
def unit(text: str) -> WrittenUnit:
    """The unit that a text says.

    >>> unit("cm²").factor, unit("m2 s-1") == unit("m²/s") == unit("м^2/с"), unit("%").factor
    (0.0001, True, 0.01)
    """
    if len(text) > LENGTH:
        raise UnitError(f"expected a unit, received {len(text)} characters")
    text = text.strip()
    if text in PLAIN:
        return PLAIN[text]
    found, at = _product(text, 0, 0)
    if at < len(text):
        raise _refusal(text)
    return found


def _refusal(text: str) -> UnitError:
    return UnitError(f'expected a unit such as m²/s, received "{text}"')


def _product(text: str, at: int, depth: int) -> tuple[WrittenUnit, int]:
    """Powers multiplied and divided, from a place on to the end or a closing bracket; the place after them."""
    found, sign, divided, wanted = ONE, 1, False, True
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None or depth > 3:
            raise _refusal(text)
        if match["closing"]:
            break
        at = match.end()
        if match["mark"]:
            if wanted:
                raise _refusal(text)
            sign, wanted = -1 if match["mark"] == "/" else 1, True
            continue
        if divided and sign == 1:
            raise UnitError(f'"{text}" has two readings: expected brackets, as in 1/(m²·s)')
        if match["opening"]:
            inner, at = _product(text, at, depth + 1)
            match = _TOKEN.match(text, at)
            if match is None:
                raise _refusal(text)
            at = match.end()
        else:
            inner = _symbol(match["symbol"]) if match["symbol"] else ONE
        found = found.times(inner, sign * _whole(match["power"]))
        divided, sign, wanted = divided or sign == -1, 1, False
    if wanted or (depth == 0 and at < len(text)) or (depth and at == len(text)):
        raise _refusal(text)
    return found, at


def _whole(text: str | None) -> int:
    if not text:
        return 1
    power = int(text.translate(_RAISED).strip("^*()" + string.whitespace))
    if abs(power) > POWER:
        raise UnitError(f"expected exponents up to {POWER}, received {power}")
    return power


def _symbol(text: str) -> WrittenUnit:
    """A unit by its symbol, with a prefix or without."""
    for name in (text, SPELLED.get(text, "")):
        if name in PREFIXED:
            return PREFIXED[name]
        if name in PLAIN:
            return PLAIN[name]
    for size in (2, 1):
        name = SPELLED.get(text[size:], text[size:])
        if text[:size] in PREFIXES and name in PREFIXED:
            return WrittenUnit(PREFIXES[text[:size]] * PREFIXED[name].factor, PREFIXED[name].dimension)
    raise UnitError(f'expected a unit such as m²/s, received "{text}"')


def coherent(text: str) -> WrittenUnit | None:
    """The unit of an asked value, None where its elements have several.

    >>> coherent("m², m²/s") is None, coherent("SI") is None, coherent("V²").factor
    (True, True, 1.0)
    """
    return None if "," in text or text == "SI" else ONE if text in ("", "1") else unit(text)


