"""Draws of the state's history given the data, for what has no closed form: greatest and least values, areas, first passages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ctlabs.filtering.forecasting import draws
from ctlabs.filtering.smoothing import smooth
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import deviations
from ctlabs.montecarlo import chance
from ctlabs.reporting.plots.studies import paths as picture
from ctlabs.studies import common
from ctlabs.text import _, fill

if TYPE_CHECKING:
    from ctlabs.reporting.report import Report
    from ctlabs.studies.filtered import Run

#: Numbers that the draws of a record may have.
ROOM = 5e7
#: Draws in a figure.
DRAWN = 25


@dataclass(frozen=True, slots=True, eq=False)
class Paths:
    """Histories x (rows, n, number) at the times t (rows,) of a record's rows, and functions of each: name → (number,)."""

    t: Array
    x: Array
    functions: dict[str, Array]


def compute(run: Run, number: int, seed: int, levels: dict[str, list[float]]) -> Paths:
    """``number`` histories given the record, and of each the greatest and least value of every state, when, and the area below.

    Parameters
    ----------
    levels : values of states of which the first passage is asked for: the first row at which a history is at the other side of the value
        than at its first row, or at the value; NaN where it is at none

    Raises
    ------
    ValueError
        A state that the model does not have; more draws than there is room for; a state that the record leaves unknown.
    """
    for name in levels:
        if name not in run.model.states:
            msg = f"--reach {name}: expected a state of the model ({', '.join(run.model.states)}), received {name!r}"
            raise ValueError(msg)
    size = run.filtered.x_plus.size * number
    if size > ROOM:
        msg = f"--draws: expected at most {int(ROOM // run.filtered.x_plus.size)} of a record of {len(run.z)} instants, received {number}"
        raise ValueError(msg)
    x, t = draws(run.model, run.filtered, number, seed)[run.first :], run.t[run.first :]
    if not np.isfinite(x).all():
        msg = "--draws: expected a record that determines every state, received one that leaves some unknown"
        raise ValueError(msg)
    found: dict[str, Array] = {}
    for i, name in enumerate(run.model.states):
        path = x[:, i]
        high, low = path.argmax(axis=0), path.argmin(axis=0)
        found |= {f"{name}_max": path.max(axis=0), f"{name}_max_t": t[high], f"{name}_min": path.min(axis=0), f"{name}_min_t": t[low]}
        found[f"{name}_area"] = np.asarray(np.trapezoid(path, t, axis=0))
        for level in levels.get(name, []):
            found[f"{name}_reaches_{level:g}_t"] = passages(path, t, level)
    return Paths(t, x, found)


def passages(path: Array, t: Array, level: float) -> Array:
    """The first time at which each path (rows, number) has passed a level, NaN where it never does.

    >>> passages(np.array([[0.0, 3.0, 0.0], [1.0, 2.0, 0.5], [2.0, 1.0, 0.9]]), np.array([0.0, 0.1, 0.2]), 1.0)
    array([0.1, 0.2, nan])
    """
    passed = (path - level) * np.sign(path[0] - level) <= 0
    return np.where(passed.any(axis=0), t[passed.argmax(axis=0)], np.nan)


def report(made: Report, run: Run, found: Paths, seed: int) -> None:
    """The draws in a table, a figure, ``draws.csv``, and a check of their means."""
    number = found.x.shape[2]
    made.says(
        _(
            "{number} histories of the state given the whole record (seed {seed}): each is one that may have happened, so that a function of a history is as spread as its values below. They are drawn at the rows of the record; between these a path may go further."
        ),
        number=number, seed=seed,
    )  # fmt: skip
    rows = []
    for name, values in found.functions.items():
        known = values[np.isfinite(values)]
        told = np.percentile(known, [5, 50, 95]).tolist() if known.size else [None] * 3
        rows.append((name, *told, len(known) / number))
        if "_reaches_" in name:
            made.value(f"{name.removesuffix('_t')}_probability", len(known) / number)
    made.table(
        "draws",
        [_("function of the path"), _("5 % quantile"), _("median"), _("95 % quantile"), _("fraction of draws that have it")],
        rows,
        _("Functions of the path over the draws; _t: the time at which."),
    )
    smoothed = run.smoothed or smooth(run.model, run.filtered)
    x, sd = smoothed.x[run.first :], deviations(smoothed.P)[run.first :]
    for i, (name, unit) in enumerate(list(zip(run.model.states, run.model.units, strict=True))[: common.SHOWN]):
        figure = picture(found.t, found.x[:, i, :DRAWN], (x[:, i], sd[:, i]), ylabel=common.label(name, unit))
        made.figure(f"draws_{i + 1}", figure, _("Draws of {name} given the record, and the smoothed estimate ± 2σ."), name=name)
    made.chance(_("means of the draws"), chance.means(found.x, x, sd), (_("draws"), _("smoother")))
    columns = ["draw", *found.functions]
    table = np.column_stack(list(found.functions.values())).tolist()
    made.csv("draws", columns, [[i, *row] for i, row in enumerate(table)])


def levels(words: tuple[str, ...]) -> dict[str, list[float]]:
    """Values of states, from words such as "level=1000".

    >>> levels(("level=1000", "level=900"))
    {'level': [1000.0, 900.0]}
    """
    found: dict[str, list[float]] = {}
    for word in words:
        name, _equals, value = word.partition("=")
        try:
            level: Any = float(value)
        except ValueError:
            level = np.nan
        if not np.isfinite(level):
            msg = fill("--reach: expected STATE=VALUE with a finite number, received {word}", word=repr(word))
            raise ValueError(msg)
        found.setdefault(name.strip(), []).append(level)
    return found
