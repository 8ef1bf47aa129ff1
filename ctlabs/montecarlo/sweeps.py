"""The same experiment over a grid of parameters: one progress bar, one table, the arrays of a line figure or heat map."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.montecarlo.executors import Team, team
from ctlabs.montecarlo.progress import Progress, reporter
from ctlabs.montecarlo.runner import monte_carlo
from ctlabs.montecarlo.statistics import Statistics


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """``axes``: the values of each parameter · ``points``: their combinations, last parameter fastest · ``statistics``
    and ``rows`` (what was measured, by name), one per point.
    """

    axes: dict[str, tuple[Any, ...]]
    points: tuple[dict[str, Any], ...]
    statistics: tuple[Statistics, ...]
    rows: tuple[dict[str, float], ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Columns of the table: parameters, then what was measured."""
        return (*self.axes, *self.rows[0])

    def table(self) -> list[list[Any]]:
        """Rows of the table, without the names."""
        return [[*point.values(), *row.values()] for point, row in zip(self.points, self.rows, strict=True)]

    def surface(self, name: str) -> Array:
        """One measured quantity on the grid, an axis per parameter: a line for one, a heat map for two."""
        if name not in self.rows[0]:
            msg = f"name: expected one of {', '.join(self.rows[0])}, received {name!r}"
            raise ValueError(msg)
        return np.array([row[name] for row in self.rows]).reshape([len(values) for values in self.axes.values()])

    def csv(self) -> str:
        """The table as CSV, numbers in full precision."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.names)
        writer.writerows(
            [[repr(float(v)) if isinstance(v, float | np.floating) else v for v in row] for row in self.table()]
        )
        return text.getvalue()

    def write_csv(self, path: str | os.PathLike[str]) -> None:
        """Write the table; an interrupted writing leaves the previous file whole."""
        target = Path(path)
        temporary = target.with_name(f".{target.name}.{os.getpid()}")
        try:
            temporary.write_text(self.csv(), encoding="utf-8")
            temporary.replace(target)
        finally:
            temporary.unlink(missing_ok=True)


def last_step(stats: Statistics) -> dict[str, float]:
    """What a sweep measures unless told otherwise: bias and rms at the last step with standard errors, mean NEES and NIS."""
    row: dict[str, float] = {}
    for i in range(stats.bias.shape[1]):
        row |= {
            f"bias_{i + 1}": float(stats.bias[-1, i]),
            f"bias_{i + 1}_se": float(stats.bias_se[-1, i]),
            f"rms_{i + 1}": float(stats.rms[-1, i]),
            f"rms_{i + 1}_se": float(stats.rms_se[-1, i]),
        }
    for name, values in (("nees", stats.nees), ("nis", stats.nis)):
        present = values[~np.isnan(values)]
        row[name] = float(present.mean()) if present.size else float("nan")
    return row


def sweep(
    build: Callable[..., Any],
    grid: Mapping[str, Sequence[Any]],
    *,
    steps: int,
    runs: int,
    seed: int,
    measure: Callable[[Statistics], dict[str, float]] = last_step,
    executor: Executor | Team | str | None = None,
    workers: int | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    progress: Progress = None,
    **options: Any,
) -> Sweep:
    """Run an experiment at every point of a grid, with the same random numbers at each (differences show sooner).

    Parameters
    ----------
    build : function of the grid's parameters that returns the truth, or (truth, design), or a dictionary of
        :func:`monte_carlo`'s arguments (``truth``, ``design``, ``compare``, ``schedule``, …)
    grid : values of each parameter
    measure : what to put in the table, by name, from a point's statistics
    checkpoint : folder; each point has its own inside
    options : further arguments of :func:`monte_carlo` for every point; the rest is as there

    Raises
    ------
    ValueError
        An empty grid; and as for :func:`monte_carlo`.

    >>> from ctlabs.models import DiscreteModel
    >>> def model(R): return DiscreteModel([[1]], [[1]], [[1]], [[R]], x0=[0], P0=[[10]])
    >>> sweep(model, {"R": [0.1, 10.0]}, steps=5, runs=200, seed=1).surface("rms_1").shape
    (2,)
    """
    axes = {name: tuple(values) for name, values in grid.items()}
    if not axes or not all(axes.values()):
        msg = f"grid: expected at least one parameter with at least one value, received {dict(grid)!r}"
        raise ValueError(msg)
    runs = checks.count("runs", runs)
    points = tuple(dict(zip(axes, values, strict=True)) for values in product(*axes.values()))
    found = []
    with team(executor, workers) as crew, reporter(progress, runs * len(points), "Sweep") as show:
        for i, point in enumerate(points):
            folder = None if checkpoint is None else Path(checkpoint) / f"point-{i:04d}"
            arguments = {"steps": steps, "runs": runs, "seed": seed, **options, **_arguments(build(**point))}
            found.append(monte_carlo(**arguments, executor=crew, checkpoint=folder, progress=_onward(show, i * runs)))
    return Sweep(axes, points, tuple(found), tuple(measure(stats) for stats in found))


def _arguments(built: Any) -> dict[str, Any]:
    if isinstance(built, dict):
        return built
    if isinstance(built, tuple):
        return dict(zip(("truth", "design"), built, strict=True))
    return {"truth": built}


def _onward(show: Callable[[int], None], before: int) -> Callable[[int, int], None]:
    return lambda done, _: show(before + done)
