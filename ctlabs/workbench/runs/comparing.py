"""How two models, or two experiments, differ."""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from ctlabs.workbench.desk.store import KeptExperiment
    from ctlabs.workbench.runs.outcomes import Outcome
    from ctlabs.workbench.runs.summaries import Summary


class Line(NamedTuple):
    """A line of two texts: ``mark`` "-" (only the first has it), "+" (only the second) or " " (both)."""

    mark: str
    text: str


class Row(NamedTuple):
    """Something in which two experiments are compared; ``same`` to the last digit or not."""

    name: str
    unit: str
    first: Any
    second: Any
    same: bool


@dataclass(frozen=True, slots=True)
class Difference:
    """``lines`` of the model files, ``settings`` and ``results`` side by side (all of them: filter by ``same``)."""

    lines: tuple[Line, ...]
    settings: tuple[Row, ...] = ()
    results: tuple[Row, ...] = ()

    @property
    def same_model(self) -> bool:
        """Whether the model files are the same."""
        return all(line.mark == " " for line in self.lines)

    def changes(self, around: int = 2) -> tuple[Line, ...]:
        """The lines that differ with so many around them; "…" for those left out."""
        near = {j for i, line in enumerate(self.lines) if line.mark != " " for j in range(i - around, i + around + 1)}
        kept: list[Line] = []
        for i, line in enumerate(self.lines):
            if i in near:
                kept.append(line)
            elif not kept or kept[-1].text != "…":
                kept.append(Line(" ", "…"))
        return tuple(kept) if near else ()


def models(first: str, second: str) -> Difference:
    r"""The lines of two model files.

    >>> [line for line in models("a = 1\nb = 2", "a = 1\nb = 3").lines]
    [Line(mark=' ', text='a = 1'), Line(mark='-', text='b = 2'), Line(mark='+', text='b = 3')]
    """
    a, b = first.splitlines(), second.splitlines()
    lines: list[Line] = []
    for what, start, end, other_start, other_end in difflib.SequenceMatcher(None, a, b, autojunk=False).get_opcodes():
        if what == "equal":
            lines += [Line(" ", text) for text in a[start:end]]
        else:
            lines += [Line("-", text) for text in a[start:end]] + [Line("+", text) for text in b[other_start:other_end]]
    return Difference(tuple(lines))


def experiments(
    first: tuple[KeptExperiment, Outcome | Summary], second: tuple[KeptExperiment, Outcome | Summary]
) -> Difference:
    """Two kept experiments, or other results that are kept."""
    (a, found_a), (b, found_b) = first, second
    settings = _rows(_settings(a.settings), _settings(b.settings))
    return Difference(models(a.model, b.model).lines, settings, _rows(found_a.summary, found_b.summary))


def _settings(plan: dict[str, Any]) -> dict[str, tuple[Any, str]]:
    """Settings as they are read: the data by their name, the anomalies one by one, the design by its text."""
    shown: dict[str, tuple[Any, str]] = {}
    for key, value in plan.items():
        if key == "data":
            shown[key] = (None if value is None else f"{value['name']} ({value['key'][:8]})", "")
        elif key == "anomalies":
            words = [
                f"{a['k']}{'–' + str(a['last']) if a['last'] is not None else ''}: R[{a['measurement']}] = {a['R']}"
                for a in value
            ]
            shown[key] = ("; ".join(words) or None, "")
        elif key in {"algorithms", "free"}:
            shown[key] = (", ".join(value), "")
        elif key == "wanted":
            shown |= {name: (each, "") for name, each in value.items()}
        elif key == "design":
            shown[key] = ("the model itself" if value is None else value, "")
        else:
            shown[key] = (value, "")
    return shown


def _rows(a: dict[str, tuple[Any, str]], b: dict[str, tuple[Any, str]]) -> tuple[Row, ...]:
    names = [*a, *(name for name in b if name not in a)]
    rows = []
    for name in names:
        (x, unit), (y, other) = a.get(name, (None, "")), b.get(name, (None, ""))
        rows.append(Row(name, unit or other, x, y, _same(x, y)))
    return tuple(rows)


def _same(x: Any, y: Any) -> bool:
    if isinstance(x, float) and isinstance(y, float):
        return x == y or (math.isnan(x) and math.isnan(y))
    if isinstance(x, list | tuple | np.ndarray) or isinstance(y, list | tuple | np.ndarray):
        return x is not None and y is not None and np.array_equal(np.asarray(x), np.asarray(y))
    return bool(x == y)
