"""A file that says the same stays as it is: numbers that agree in the digits that are known are not written anew."""

from __future__ import annotations

import math
import re
from pathlib import Path

from ctlabs.text import LOWERED, RAISED_DIGITS

#: A number in JSON or CSV, or in print; powers of ten in both forms.
_NUMBER = re.compile(r"[-−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
#: A power of ten below which a difference lies: that of rounding may be one more or less on another machine.
_BOUND = re.compile(f"< 10(⁻[{RAISED_DIGITS}]+)")
#: Numbers of two runs agree when they differ by less, as a part of their size: what another machine's rounding changes.
RELATIVE = 1e-9
#: Files whose numbers are looked at; pages are made from them, and pictures are pictures.
LOOKED_AT = {".json", ".csv", ".md"}


def kept(old: str, new: str) -> str:
    r"""The new text, but each line of the old one that says the same.

    >>> kept('{"a": 0.3333333333,\n"b": 2}', '{"a": 0.3333333334,\n"b": 3}')
    '{"a": 0.3333333333,\n"b": 3}'
    """
    before, after = old.split("\n"), new.split("\n")
    if len(before) != len(after):
        return new
    return "\n".join(a if same(a, b) else b for a, b in zip(before, after, strict=True))


def same(a: str, b: str) -> bool:
    """Whether two lines hold the same words, and numbers that agree up to rounding.

    >>> same("| 8.2612 | < 10⁻¹² |", "| 8.2612 | < 10⁻¹¹ |"), same("| < 10⁻¹² |", "| < 10⁻⁹ |")
    (True, False)
    """
    if a == b:
        return True
    bounds = [[int(power.translate(LOWERED)) for power in _BOUND.findall(line)] for line in (a, b)]
    if len(bounds[0]) != len(bounds[1]) or any(abs(x - y) > 1 for x, y in zip(*bounds, strict=True)):
        return False
    a, b = _BOUND.sub("<", a), _BOUND.sub("<", b)
    if _NUMBER.split(a) != _NUMBER.split(b):
        return False
    pairs = zip(_NUMBER.findall(a), _NUMBER.findall(b), strict=True)
    return all(x == y or math.isclose(_float(x), _float(y), rel_tol=RELATIVE) for x, y in pairs)


def _float(shown: str) -> float:
    return float(shown.replace("−", "-"))


def keep(place: Path, folder: Path) -> None:
    """Put into a new folder what of the ``folder`` that it will replace says the same."""
    for path in place.rglob("*"):
        before = folder / path.relative_to(place)
        if path.suffix in LOOKED_AT and before.is_file():
            old, new = (each.read_text(encoding="utf-8", errors="surrogateescape") for each in (before, path))
            if (text := kept(old, new)) != new:
                path.write_text(text, encoding="utf-8", errors="surrogateescape", newline="")
