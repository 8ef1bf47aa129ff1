"""The table [cost] of a model file: what its regulator shall keep small, checked with every problem's place."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from ctlabs.files.modelfile import build
from ctlabs.files.modelfile.checks import ONE_PER, WEIGHTS
from ctlabs.files.modelfile.errors import ModelFileError, Path, Problem, meant, place, shown
from ctlabs.files.modelfile.expressions import Expression, ExpressionError
from ctlabs.files.modelfile.schema import CostTable, Document, OutputTable
from ctlabs.files.modelfile.values import Instant, Values, leaves
from ctlabs.linalg.checks import Array
from ctlabs.models import ContinuousModel, Cost, DiscreteModel

#: The tables of [cost] whose keys are names.
NAMED = ("outputs", "integral")


class RegulatorSettings(NamedTuple):
    """How a model file's regulator is built, beside its cost: the options of :func:`ctlabs.regulation.regulator` of these names."""

    kind: str
    delay: float
    integral: dict[str, float]
    loads: tuple[str, ...]
    track: tuple[str, ...]
    stabilise: bool


def misfits(document: Document) -> list[Problem]:
    """What of [cost] does not fit the sizes and names of a model whose own sizes do."""
    told = document.cost
    return [] if told is None else list(_misfits(document, told))


def _misfits(document: Document, told: CostTable) -> Iterator[Problem]:
    model: Any = document.model
    if model.B is None:
        yield Problem("model.B", "expected the matrix B by which the inputs of a regulator enter, received none beside [cost]")
        return
    if model.u is not None:
        yield Problem("model.u", "expected none beside [cost], whose regulator makes the inputs, received one")
    size = {"n": len(model.P0), "r": len(model.B[0])}
    for name, shape in WEIGHTS.items():
        yield from _matrix(name, getattr(told, name), shape, size)
    if told.Qx is None and not told.outputs:
        yield Problem("cost.Qx", "expected the weight Qx of the states, or outputs, received neither")
    if told.Qf is not None and told.horizon is None:
        yield Problem("cost.horizon", "expected a horizon beside Qf, the weight of the last state, received none")
    for name, output in told.outputs.items():
        if output.row is not None and len(output.row) != size["n"]:
            text = f"expected {size['n']} numbers (one per state), received {len(output.row)}"
            yield Problem(place(("cost", "outputs", name, "row")), text)
    yield from _strangers(document, told)


def _strangers(document: Document, told: CostTable) -> Iterator[Problem]:
    """Names that no state or measurement has."""
    model: Any = document.model
    states = model.states or tuple(f"x{i + 1}" for i in range(len(model.P0)))
    seen = model.measurements or tuple(f"z{i + 1}" for i in range(len(model.H)))
    own = [name for name, output in told.outputs.items() if output.row is None]
    groups: list[tuple[str, Iterable[str], tuple[str, ...], str]] = [
        ("outputs", own, seen, "a measurement (or a row beside the weight)"),
        ("integral", told.integral, seen, "a measurement"),
        ("track", told.track, seen, "a measurement"),
        ("loads", told.loads, states, "a state"),
    ]
    for key, names, known, what in groups:
        for i, name in enumerate(names):
            if name not in known:
                where = place(("cost", key, name if key in NAMED else i))
                yield Problem(where, f"expected {what}, received {shown(name)}{meant(name, known)}")


def _matrix(name: str, value: Any, shape: str, size: dict[str, int]) -> Iterator[Problem]:
    """Rows and columns of a weight."""
    rows, columns = (size[letter] for letter in shape)
    if value is None:
        return
    if len(value) != rows:
        yield Problem(f"cost.{name}", f"expected {rows} row{'s' if rows > 1 else ''} ({ONE_PER[shape[0]]}), received {len(value)}")
        return
    for i, row in enumerate(value):
        if len(row) != columns:
            text = f"expected {columns} column{'s' if columns > 1 else ''} ({ONE_PER[shape[1]]}), received {len(row)}"
            yield Problem(place(("cost", name, i)), text)


def cells(told: CostTable) -> Iterator[tuple[Path, Expression]]:
    """Every expression of the table, with its place."""
    for name in (*WEIGHTS, "horizon", "discount", "constant", "delay"):
        if (value := getattr(told, name)) is not None:
            for index, cell in leaves(value):
                yield ("cost", name, *index), cell
    for name, output in told.outputs.items():
        plain = output.row is None
        yield ("cost", "outputs", name) if plain else ("cost", "outputs", name, "weight"), output.weight
        for index, cell in leaves(output.row or ()):
            yield ("cost", "outputs", name, "row", *index), cell
    for name, cell in told.integral.items():
        yield ("cost", "integral", name), cell


def problems(found: Values, broken: frozenset[Path], without: set[str]) -> list[Problem]:
    """Cells without a value, and a cost that is none. ``without`` : constants that have no value themselves."""
    told = found.document.cost
    if told is None:
        return []
    wrong = []
    for path, cell in cells(told):
        if path in broken:
            continue
        try:
            cell.check(list(found.document.constants))
            if not cell.names & without:
                cell.value(found.constants)
        except ExpressionError as error:
            wrong.append(Problem(place(path), str(error)))
    if wrong or without or any(path in broken for path, _ in cells(told)):
        return wrong
    try:
        made = cost(found)
        settings(found)
        if not (found.varies("H") or found.varies("D")):
            _joint(found, made)
    except ModelFileError as error:
        return [error.problem]
    return []


def cost(found: Values) -> Cost | None:
    """The cost of a file, ``None`` where it has none.

    Raises
    ------
    ModelFileError
        An indefinite weight, a horizon or discount out of range, with its place.
    """
    told = found.document.cost
    if told is None:
        return None
    outputs = {name: _output(found, name, each) for name, each in told.outputs.items()}
    given: dict[str, Any] = {name: _filled(found, name) for name in WEIGHTS if getattr(told, name) is not None}
    horizon = None if told.horizon is None else _number(found, told.horizon, "horizon")
    discount, constant = _number(found, told.discount, "discount"), _number(found, told.constant, "constant")
    try:
        return Cost(**given, horizon=horizon, outputs=outputs or None, discount=discount, constant=constant)
    except ValueError as error:
        raise _told(found, error) from None


def settings(found: Values) -> RegulatorSettings:
    """How the regulator is built.

    Raises
    ------
    ModelFileError
        No [cost]; a negative delay or weight; a delay in a discrete file.
    """
    told = found.document.cost
    if told is None:
        raise found.error(("cost",), "expected a table [cost] with the weights Qx (or outputs) and Qu, received none")
    delay = _number(found, told.delay, "delay")
    if not 0 <= delay < math.inf:
        raise found.error(("cost", "delay"), f"expected a time >= 0, s, received {delay:g}")
    if delay and found.document.kind == "discrete":
        raise found.error(("cost", "delay"), f"expected none in a discrete model, which is sampled already, received {delay:g}")
    integral = {name: _number(found, cell, "integral", name) for name, cell in told.integral.items()}
    for name, weight in integral.items():
        if not 0 < weight < math.inf:
            raise found.error(("cost", "integral", name), f"expected a weight > 0, received {weight:g}")
    return RegulatorSettings(told.kind, delay, integral, told.loads, told.track, told.stabilise)


def _joint(found: Values, made: Cost | None) -> None:
    """Refuse weights that are indefinite together: those of the outputs count."""
    if made is None or made.N is None or made.outputs is None:
        return
    n, r = found.sizes.n, found.sizes.r
    model = DiscreteModel(
        np.eye(n), np.zeros((n, n)), found.constant("H"), np.eye(found.sizes.m), P0=np.eye(n), B=np.ones((n, r)),
        D=found.constant("D") if found.given("D") else None, measurements=found.document.model.measurements,
    )  # fmt: skip
    try:
        made.weights(model)
    except ValueError as error:
        raise _told(found, error) from None


def _told(found: Values, error: ValueError) -> ModelFileError:
    """What the library says about a cost, with its place in the file."""
    name, _, message = str(error).partition(": ")
    told = found.document.cost
    for each in () if told is None else told.outputs:
        if name == f"outputs[{each!r}]":
            return found.error(("cost", "outputs", each), message)
    joint = name.startswith("[[")
    where: Path = ("cost", "N") if joint else ("cost", name) if name in CostTable.model_fields else ("cost",)
    return found.error(where, str(error) if joint or len(where) == 1 else message)


def _filled(found: Values, name: str) -> Array:
    rows = getattr(found.document.cost, name)
    return np.array([[_number(found, cell, name, i, j) for j, cell in enumerate(row)] for i, row in enumerate(rows)]).reshape(len(rows), -1)


def _output(found: Values, name: str, told: OutputTable) -> float | tuple[Array, float]:
    """The weight of an output, with its row where it has one."""
    where = ("outputs", name)
    if told.row is None:
        return _number(found, told.weight, *where)
    row = [_number(found, cell, *where, "row", i) for i, cell in enumerate(told.row)]
    return np.array(row), _number(found, told.weight, *where, "weight")


def _number(found: Values, cell: Expression, *path: str | int) -> float:
    try:
        return cell.value(found.constants)
    except ExpressionError as error:
        raise found.error(("cost", *path), str(error)) from None


def plant(found: Values, steps: int | None = None) -> ContinuousModel | DiscreteModel:
    """The model with its inputs, B and D, for a regulator.

    A discrete file whose matrices vary is given for ``steps`` periods.
    """
    if found.document.kind == "continuous":
        return build.continuous(found)
    if not found.given("B"):
        raise found.error(("model", "B"), "expected the matrix B by which the inputs of a regulator enter, received none")
    model = build.discrete(found, steps)
    count = model.horizon or steps or found.document.experiment.steps
    instants = [Instant(k, found.t0 + k * found.dt) for k in range(count + 1)]
    B = found.stack("B", instants[:-1]) if found.varies("B") else found.constant("B")
    D = None if not found.given("D") else found.stack("D", instants) if found.varies("D") else found.constant("D")
    return dataclasses.replace(model, B=B, D=D)
