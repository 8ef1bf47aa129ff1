"""The key of a lab: every value that a hand-out asks for, by the answers by hand, with what known confusions give.

What is asked stands in ``tasks/asked/LAB.toml``; the numbers come from ``tasks/answers/LAB.py``: from ``analytic``, which owes nothing
to the library and simulates nothing (or ``asked``, a part of it that takes less time), and for the confusions of the table from
``confused``.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np

from ctlabs.course.asked import THREE_DIGITS, AskedValue
from ctlabs.labs.catalogue import by_hand, catalogue, folder
from ctlabs.linalg.checks import Array
from ctlabs.reporting.params import LabParameters

#: What is allowed of an element that is 0: this part of the smallest one that is not.
RESIDUE = 1e-3
#: And where all of them are, in the value's unit.
NOTHING = 1e-6


@dataclass(frozen=True, slots=True)
class Question:
    """What is asked of everybody.

    ``item``, ``symbol``, ``unit``, ``meaning`` : as in :class:`~ctlabs.course.asked.AskedValue` · ``first`` : so many rows of a
    long list, 0 for all · ``others`` : names of the numbers that a confusion gives, by its words
    """

    item: str
    symbol: str
    unit: str
    meaning: str
    first: int = 0
    others: Mapping[str, str] = field(default_factory=dict)


@cache
def questions(lab: str) -> dict[str, Question]:
    """The questions of a lab by the names of their values, in the order of the sheet.

    >>> questions("task16")["settling_time"].meaning
    'time from which P(t) stays within 1 % of its limit'

    Raises
    ------
    ValueError
        The lab has none.
    """
    path = folder() / "asked" / f"{lab}.toml"
    if lab not in catalogue() or not path.is_file():
        msg = f"{lab}: expected a lab with a table of what it asks (tasks/asked/{lab}.toml), received none"
        raise ValueError(msg)
    found = {name: Question(**row) for name, row in tomllib.loads(path.read_text(encoding="utf-8")).items()}
    order = catalogue()[lab].parts
    return dict(sorted(found.items(), key=lambda pair: order.index(pair[1].item)))


def key(lab: str, p: LabParameters) -> tuple[AskedValue, ...]:
    """The right answers of a lab for its parameters, in the order of the sheet.

    >>> from ctlabs.labs.catalogue import catalogue, load
    >>> found = {each.name: each for each in key("task16", load(catalogue()["task16"]).Parameters())}
    >>> found["variance_steady_continuous"].value, found["gain_steady"].value.round(4)
    (array(8.), np.float64(0.3904))

    Raises
    ------
    ValueError
        One of the values does not exist for these parameters.
    """
    module = by_hand(lab)
    answers = getattr(module, "asked", module.analytic)(p)
    known = answers | (module.confused(p, answers) if hasattr(module, "confused") else {})
    return tuple(_asked(lab, name, question, known) for name, question in questions(lab).items())


def _asked(lab: str, name: str, question: Question, known: Mapping[str, Any]) -> AskedValue:
    exact = rectangular(known[name])
    if exact is None:
        msg = f"{lab}: {name}: expected parameters for which it exists, received others"
        raise ValueError(msg)
    value = _cut(exact, question.first)
    counted = value.dtype.kind == "i"
    found = AskedValue(
        name, question.item, question.symbol, question.meaning, question.unit, value.astype(float),
        0.0 if counted else THREE_DIGITS, 0.0 if counted else _residue(value), {},
    )  # fmt: skip
    others = {}
    for words, other in question.others.items():
        confused = rectangular(known[other])
        if confused is not None and confused.shape == exact.shape:
            confused = _cut(confused, question.first).astype(float)
            if (abs(confused - value) > 2 * found.allowed).any():  # else nobody can tell them apart
                others[words] = confused
    return replace(found, others=others)


def rectangular(value: Any) -> Array | None:
    """A value as an array; of polynomials with fewer coefficients the missing ones, in front, are 0. None where there is none.

    >>> rectangular([[2.0], [1.0, 3.0]])
    array([[0., 2.],
           [1., 3.]])
    """
    if value is None or (isinstance(value, list | tuple) and any(each is None for each in value)):
        return None
    if isinstance(value, Sequence) and value and all(isinstance(row, Sequence) for row in value):
        longest = max(map(len, value))
        if min(map(len, value)) < longest:
            value = [[0.0] * (longest - len(row)) + list(row) for row in value]
    found: Array = np.asarray(value)
    return found if found.dtype == object or np.isfinite(found).all() else None


def _cut(value: Array, first: int) -> Array:
    return value[:first] if first else value


def _residue(value: Array) -> float:
    sizes = abs(value[value != 0]) if value.ndim else abs(value)
    return RESIDUE * float(np.min(sizes)) if sizes.size and np.any(sizes) else NOTHING
