"""Values in a record that look like a program's sign for "not measured"."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ctlabs.linalg.checks import Array

#: Numbers that loggers and archives write for "not measured", in either sign.
SENTINELS = (
    99, 999, 9999, 99999, 999999, 99.9, 999.9, 9999.9, 99.99, 999.99, 9999.99, 99999.99, 999.25, 6999, 7999, 8888, 200, 1000, 32767, 32768,
    65535, 2147483647, 2147483648,
    4294967295, 1e20, 9.96921e36, 9.969209968386869e36, 1e30, 1e35, 3.4028235e38, 1.7976931348623157e308,
)  # fmt: skip
#: How many times the usual spread such a value is away from the others.
FAR = 6
#: Lines that are told.
TOLD = 4


def notes(z: Array, names: Sequence[str], lines: Array) -> list[str]:
    """A sentence for each suspicious value of a column.

    >>> notes(np.array([[1.5], [-9999], [3.5], [4.5]]), ["position"], np.arange(2, 6))
    ['position is -9999 in line 3: if that means not measured, --missing -9999']
    """
    found = []
    for name, column in zip(names, z.T, strict=True):
        measured = column[np.isfinite(column)]
        for value in sorted({float(v) for s in SENTINELS for v in (s, -s) if (measured == v).any()}):
            others = measured[~np.isin(np.abs(measured), SENTINELS)]
            if not _far(value, others):
                continue
            at = lines[column == value]
            where = ", ".join(map(str, at[:TOLD])) + (f" and {len(at) - TOLD} more" if len(at) > TOLD else "")
            text = f"{value:.17g}" if value != int(value) or abs(value) > 1e15 else str(int(value))
            found.append(
                f"{name} is {text} in line{'s' if len(at) > 1 else ''} {where}: if that means not measured, "
                f"--missing {text}"
            )
    return found


def _far(value: float, others: Array) -> bool:
    """Whether a value is away from the others by several times their spread."""
    if len(others) < 2:
        return abs(value) > 900
    low, middle, high = np.percentile(others, [5, 50, 95])
    return bool(abs(value - middle) > FAR * max(high - low, 1e-9 * abs(middle)))
