"""How a typed text stands in a model file."""

from __future__ import annotations

from typing import Any

#: What a text of a cell is written as without quotes.
NUMBERS = "0123456789.+-eE"


def typed(text: str) -> Any:
    """What a text of a cell is in the file: a number where its digits stay as they were typed, otherwise the text.

    >>> typed(" 12 "), typed("0.5"), typed("1e-4"), typed("2*q")
    (12, 0.5, '1e-4', '2*q')
    """
    text = text.strip()
    if not text or text.strip(NUMBERS) or len(text) > 40:
        return text
    for kind in (int, float):
        try:
            number = kind(text)
        except ValueError:
            continue
        if str(number) == text:
            return number
    return text
