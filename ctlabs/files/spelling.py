"""How numbers, instants and missing values are spelled in tables."""

from __future__ import annotations

import json
import re

#: Words (in lower case) that programs write for "not measured".
WORDS = frozenset({
    "", "na", "n/a", "nan", "+nan", "-nan", "null", "none", "nat", "<na>", "<n/a>", "#n/a", "#n/a n/a", "#na", "nan(ind)", "-nan(ind)",
    ".", "?",
}) | {f"{sign}1.#{word}{'0' * zeros}" for sign in ("", "-") for word in ("qnan", "snan", "ind") for zeros in range(6)}  # fmt: skip
#: A number with at most one mark.
NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)([eEdD][+-]?\d+)?", re.ASCII)
#: A number with one mark that may part thousands: 1,120 or 1.120.
EITHER = re.compile(r"[+-]?[1-9]\d{0,2}[.,]\d{3}", re.ASCII)
#: A number in groups of thousands.
GROUPED = re.compile(r"([+-]?)(\d{1,3})(([.,'’ \u00a0\u2009\u202f])\d{3}(?:\4\d{3})*)(?:([.,])(\d*))?", re.ASCII)
#: What to do with a line of words below a table.
FOREIGN = "; if the line is not part of the table, remove it or begin it with #"
INFINITE = re.compile(r"[+-]?(inf|infinity|∞|1\.#inf)", re.IGNORECASE)
#: The months as MATLAB, SAS and spreadsheets write them.
MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
#: 31-May-2024, 31 May 2024, 31MAY2024
NAMED = re.compile(rf"(\d{{1,2}})([-/. ]?)({'|'.join(MONTHS)})\2(\d{{4}}|\d\d)(?!\d)", re.ASCII | re.IGNORECASE)
#: 2024-05-31, 31.05.2024, 5/31/24, 31-May-2024, 12:30, 2024-05-31T12:30:00Z
INSTANT = re.compile(
    NAMED.pattern + r"([T: ]+\d{1,2}:.*)?|"
    r"\d{1,4}([-./])\d{1,2}\6\d{1,4}([T ]+\d{1,2}:.*|[T ]\d{4,6}\S*)?|\d{1,3}:\d{2}(:\d{2})?.{0,9}|\d{8}T\d{4,6}\S*",
    re.ASCII | re.IGNORECASE,
)


def shown(text: str) -> str:
    """What was received, in quotes and not too long."""
    return json.dumps(short(text), ensure_ascii=False)


def short(text: str) -> str:
    """A text of at most 40 characters."""
    return text if len(text) <= 40 else f"{text[:37]}…"
