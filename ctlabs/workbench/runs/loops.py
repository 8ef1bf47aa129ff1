"""What the page Control computes: the regulator of a model file at once; curves of trade-offs and ensembles in a process of the worker."""

from __future__ import annotations

import csv
import dataclasses
import importlib
import io
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ctlabs.files.modelfile import ModelFile, loads
from ctlabs.linalg.checks import Array
from ctlabs.linalg.manyfold import Manyfold
from ctlabs.montecarlo import simulate
from ctlabs.regulation import ensemble, margins, periods, tradeoff
from ctlabs.regulation.curves import Periods, Tradeoff
from ctlabs.regulation.runs import LoopEnsemble
from ctlabs.studies import designing, regulating
from ctlabs.studies.regulating import Regulated
from ctlabs.studies.understanding import part

#: Steps for which a loop is followed at most, and fewest: what a slider moves is there at once.
LONGEST, SHORTEST = 400, 20
#: By what the inputs' weight and the period are multiplied for the curves.
FACTORS = tuple(np.geomspace(0.01, 100, 9).tolist())
PERIODS = tuple((2.0 ** np.arange(-3, 4)).tolist())
#: The files that a regulator is exported as.
KINDS = ("h", "npz", "mat")


def steps(file: ModelFile) -> int:
    """For how many steps the page follows the loop of a model file."""
    return min(max(file.experiment.steps, SHORTEST), LONGEST)


@lru_cache(maxsize=16)
def regulated(text: str) -> Regulated:
    """The regulator of a model file's text, its loop, budget and margins; of a text that one comes back to it is there at once.

    Raises
    ------
    ValueError
        What the file or :func:`ctlabs.regulation.regulator` refuses.
    """
    file = loads(text, "")
    found = regulating.compute(file, steps=steps(file), quick=True)
    return dataclasses.replace(found, margins=part(lambda: margins(found.placed, found.truth)))


def elsewhere(design: str, truth: str) -> Regulated:
    """The regulator of one text in a loop with the plant of another.

    Raises
    ------
    ValueError
        What a file or the library refuses; inputs or measurements that differ.
    """
    believed, plant = loads(design, "design"), loads(truth, "truth")
    if plant.cost is None:
        plant = _weighed(plant, believed)
    return regulating.compute(plant, design=believed, steps=steps(plant), quick=True)


def _weighed(plant: ModelFile, believed: ModelFile) -> ModelFile:
    """A plant without [cost], with that of the design: its numbers, since the constants may be others."""
    made, told = plant, believed.regulator
    cost = believed.cost
    assert cost is not None
    if "u" in made.data().get("model", {}):
        made = made.remove(("model", "u"))
    table: dict[str, Any] = {name: M.tolist() for name in ("Qx", "Qu", "N") if (M := getattr(cost, name)) is not None}
    if cost.outputs:
        table["outputs"] = {
            name: weight if row is None else {"row": row.tolist(), "weight": weight} for name, (row, weight) in cost.outputs.items()
        }
    table |= {"kind": told.kind, "track": list(told.track), "stabilise": told.stabilise}
    table |= {"integral": told.integral} if told.integral else {}
    table |= {"delay": told.delay} if told.delay else {}
    return made.edit_all([(("cost", key), value) for key, value in table.items()]).checked()


@dataclass(frozen=True, slots=True, eq=False)
class Family:
    """Regulators of other weights or periods.

    ``values`` (k,) of what varied · ``cost`` (k,) · ``x`` (k, n) and ``u`` (k, r), RMS in the limit, of weights · ``reason`` where there
    are none
    """

    values: Array
    cost: Array
    x: Array
    u: Array
    reason: str = ""

    @property
    def tradeoff(self) -> Tradeoff:
        """As the library has it, without the regulators."""
        return Tradeoff(self.values, self.x, self.u, self.cost, ())

    @property
    def periods(self) -> Periods:
        """The same of periods."""
        return Periods(self.values, self.cost, ())


@dataclass(frozen=True, slots=True, eq=False)
class LoopCurves:
    """What other weights of the inputs, and other periods, would give."""

    weights: Family
    periods: Family


def curves(model: str, progress: Callable[[int, int], object] | None = None) -> LoopCurves:
    """The curves of trade-offs of a model file, regulator by regulator."""
    file = loads(model, "")
    found = designing.designed(file)
    continuous = found.file.kind == "continuous"
    dt: dict[str, Any] = {"dt": file.dt} if continuous else {}
    done, total = 0, len(FACTORS) + (len(PERIODS) if continuous else 0)

    def tell() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, total)

    def family(values: tuple[float, ...], one: Callable[[float], Tradeoff | Periods]) -> Family:
        members, kept, reason = [], [], ""
        for value in values:
            made = part(lambda value=value: one(value))  # type: ignore[misc]  # the value of this round
            if made:
                members.append(made.value)
                kept.append(value)
            reason = reason or made.reason
            tell()
        if not members:
            return _none(reason)
        cost = np.concatenate([each.cost for each in members])
        sizes = [each for each in members if isinstance(each, Tradeoff)]
        x, u = (np.array([getattr(each, name)[0] for each in sizes]) for name in ("x_rms", "u_rms"))
        return Family(np.array(kept), cost, x, u)

    weights = family(FACTORS, lambda factor: tradeoff(found.model, found.cost, [factor], **found.options, **dt))
    if not continuous or found.cost.horizon is not None:
        return LoopCurves(weights, _none("a horizon has its own periods" if continuous else "a discrete model has the one period"))
    plant: Any = found.model
    return LoopCurves(weights, family(tuple(file.dt * np.array(PERIODS)), lambda h: periods(plant, found.cost, [h], **found.options)))


def _none(reason: str) -> Family:
    nothing = np.zeros(0)
    return Family(nothing, nothing, nothing, nothing, reason)


def many(
    model: str, runs: int, seed: int, progress: Callable[[int, int], object] | None = None, workers: int | None = None
) -> LoopEnsemble:
    """Many runs of a model file's loop, as long as the page follows it.

    Raises
    ------
    ValueError
        What the file, the library or :func:`ctlabs.monte_carlo` refuses; a loop that is not stable.
    """
    file = loads(model, "")
    found = designing.designed(file)
    given = {"workers": workers, "progress": progress or False}
    count = found.regulator.steps or steps(file)
    return ensemble(found.regulator, runs=runs, seed=seed, steps=count, truth=found.model, **given)


def exported(model: str, kind: str, name: str = "regulator") -> bytes:
    """The regulator of a model file as a file: C ("h"), NumPy ("npz"), MATLAB ("mat").

    Raises
    ------
    ValueError
        Another kind; what the file or the library refuses.
    """
    if kind not in KINDS:
        msg = f"export: expected one of {', '.join(KINDS)}, received {kind!r}"
        raise ValueError(msg)
    with tempfile.TemporaryDirectory() as folder:
        return regulated(model).regulator.export(Path(folder) / f"{name}.{kind}").read_bytes()


def one_run(model: str, seed: int) -> str:
    """One run of a model file's loop as a table (CSV): t, the states, what was measured, the inputs, each number to its last digit.

    Raises
    ------
    ValueError
        What the file or the library refuses.
    """
    found = regulated(model)
    made = simulate(found.loop.model, found.steps, 1, seed, first=0)
    n, m = found.truth.n, found.truth.m
    z = made.z[:, :, 0]
    heads = ["t", *found.truth.states, *(f"{name} (measured)" for name in found.truth.measurements), *found.inputs]
    told = io.StringIO()
    writer = csv.writer(told, lineterminator="\n")
    writer.writerow(heads)
    columns = np.column_stack([made.t, made.x[:, :n, 0], z[:, : m + found.truth.r]])
    writer.writerows([repr(float(value)) for value in row] for row in columns)
    return told.getvalue()


@lru_cache(maxsize=1)
def warm() -> None:
    """Load the compiled products that a regulator in some dozens needs, which takes a second or two once."""
    importlib.import_module("ctlabs.linalg.loops")
    whole = Manyfold((np.eye(2), np.zeros((2, 2))))
    _ = whole @ whole

