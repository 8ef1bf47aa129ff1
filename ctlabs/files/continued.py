"""Times after those of a record, written as its own are."""

from __future__ import annotations

import datetime as dt

from ctlabs.files.mapping import ABSOLUTE, RELATIVE
from ctlabs.linalg.checks import Array


def continued(last: str, unit: str, since: Array) -> list[str] | None:
    """The times ``since`` (rows,), s, after the last one of a record, as that is written; None for what is not written so here.

    Dates with their zone and separator, and whole numbers of a unit; to the microsecond, or to the unit.

    >>> import numpy as np
    >>> continued("2024-05-31T23:59:59+02:00", "iso", np.array([1.0, 2.5]))
    ['2024-06-01T00:00:00+02:00', '2024-06-01T00:00:01.500000+02:00']
    >>> continued("1717156804000", "unix_ms", np.array([1.0, 2.5]))
    ['1717156805000', '1717156806500']
    """
    text = last.strip()
    if unit == "iso":
        try:
            begin = dt.datetime.fromisoformat(text)
        except ValueError:
            return None
        mark = text[10] if len(text) > 10 else "T"
        later = [(begin + dt.timedelta(seconds=float(each))).isoformat(mark) for each in since]
        return [each.removesuffix("+00:00") + "Z" if text.endswith("Z") else each for each in later]
    units = {**RELATIVE, **ABSOLUTE}
    if unit in units and text.lstrip("-").isdecimal():
        numerator, denominator = units[unit]
        steps = [float(each) * denominator / numerator for each in since]
        if all(abs(step - round(step)) < 1e-6 for step in steps):
            return [str(int(text) + round(step)) for step in steps]
    return None
