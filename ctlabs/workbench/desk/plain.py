"""How a typed text is read: as the number of a field, one reader for all pages, and as it stands in a model file.

A decimal comma, the minus sign of print, blanks between thousands (thin ones too) and powers of ten as 1e4 or 1.2·10⁻³ are understood.
What has two readings (1,120) is refused with both of them. A field for a number takes an expression, too: pi/2, 1/3.
"""

from __future__ import annotations

import math
import re
from typing import Any

from ctlabs.files.modelfile.expressions import ExpressionError, comma_hint, parse
from ctlabs.files.spelling import EITHER, GROUPED, shown
from ctlabs.text import DASHES, LOWERED

#: What a text of a cell is written as without quotes.
NUMBERS = "0123456789.+-eE"
_BLANKS = re.compile(r"[ \u00a0\u2007\u2009\u202f]+")
_MINUS = str.maketrans(dict.fromkeys(DASHES, "-") | {"＋": "+"})
#: A power of ten as it is printed, behind the digits before it.
_TEN = re.compile(r"(?<=[\d.,]) ?[·⋅×*∙] ?10(?:\^\(?([-+]?\d{1,3})\)?|([⁻⁺]?[⁰¹²³⁴⁵⁶⁷⁸⁹]{1,3}))")
_PLAIN = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", re.ASCII)
_COMMA = re.compile(r"[-+]?(?:\d+,\d*|,\d+)(?:[eE][-+]?\d+)?", re.ASCII)


def plainly(text: str) -> str:
    """A number as people write it, in the signs of a model file; any other text as it is.

    >>> plainly("−0,5"), plainly("12 500,25"), plainly("1,2·10⁻³"), plainly("1,120"), plainly("2*q")
    ('-0.5', '12500.25', '1.2e-3', '1,120', '2*q')
    """
    text = text.strip()
    if _PLAIN.fullmatch(text):
        return text
    told = _TEN.sub(lambda found: f"e{found[1] or found[2].translate(LOWERED)}", text.translate(_MINUS))
    told = re.sub(r"^([-+]) ", r"\1", _BLANKS.sub(" ", told))
    mantissa, *power = re.split(r"(?=[eE])", told, maxsplit=1)
    if " " in mantissa and (found := GROUPED.fullmatch(mantissa)) and found[4] == " ":
        told = "".join([mantissa.replace(" ", ""), *power])
    elif EITHER.fullmatch(told):
        return text
    if _COMMA.fullmatch(told):
        told = told.replace(",", ".")
    return told if _PLAIN.fullmatch(told) else text


def number(text: object, expected: str = "a number") -> float:
    """The number that was typed into a field; an expression of numbers, too.

    Raises
    ------
    ValueError
        What was ``expected`` and received, and what to write instead; one line.

    >>> number("1e4"), number("−2,5"), number("1/4"), number("inf")
    (10000.0, -2.5, 0.25, inf)
    """
    told = str(text or "").strip()
    try:
        return parse(plainly(told)).value({})
    except ExpressionError:
        raise ValueError(f"expected {expected}, received {_received(told)}{comma_hint(told)}") from None


def whole(text: object, least: int, most: int) -> int:
    """The whole number from ``least`` to ``most`` that was typed into a field: 1000, 1 000, 1e3.

    Raises
    ------
    ValueError
        What was expected and received; one line.
    """
    told = str(text or "").strip()
    found = plainly(told.replace("_", ""))
    value = int(found) if re.fullmatch(r"[-+]?\d{1,20}", found, re.ASCII) else _round(found)
    if value is None or not least <= value <= most:
        why = "" if _PLAIN.fullmatch(found) else comma_hint(told)
        raise ValueError(f"expected a whole number from {least} to {most}, received {_received(told)}{why}")
    return value


def numbers(text: object) -> tuple[float, ...]:
    """Numbers in a row, with semicolons between them, or with commas, or with blanks; none of an empty text.

    Where there are semicolons, commas are decimal ones.

    >>> numbers("0,5; 2"), numbers("0.5, 2"), numbers("")
    ((0.5, 2.0), (0.5, 2.0), ())
    """
    told = str(text or "").strip()
    between = ";" if ";" in told else "," if "," in told else None
    return tuple(number(part) for part in told.split(between) if part.strip())


def typed(text: str) -> Any:
    """What a text of a cell is in the file: a number where its digits stay as they were typed, otherwise the text.

    >>> typed(" 12 "), typed("0.5"), typed("0,5"), typed("1e-4"), typed("2*q")
    (12, 0.5, 0.5, '1e-4', '2*q')
    """
    text = plainly(text)
    if not text or text.strip(NUMBERS) or len(text) > 40:
        return text
    for kind in (int, float):
        try:
            found = kind(text)
        except ValueError:
            continue
        if str(found) == text:
            return found
    return text


def _round(text: str) -> int | None:
    """The whole number that is written like 1e5."""
    if not _PLAIN.fullmatch(text):
        return None
    value = float(text)
    return int(value) if math.isfinite(value) and value.is_integer() else None


def _received(text: str) -> str:
    return shown(text) if text else "nothing"
