"""Sizes and values of a model file: every problem with its place."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from ctlabs.files.modelfile.errors import ModelFileError, Path, Problem, place
from ctlabs.files.modelfile.expressions import VARIABLES, Expression, ExpressionError, parse, values
from ctlabs.files.modelfile.schema import LARGEST, Document
from ctlabs.files.modelfile.values import BY_ROW, VARYING, Instant, Values
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models.linear import check_joint

#: How many instants of a varying matrix are looked at.
INSTANTS = 200

#: Rows and columns of every matrix; vectors and lists have rows only.
SHAPES: dict[str, dict[str, str]] = {
    "continuous": {
        "states": "n", "units": "n", "measurements": "m", "measurement_units": "m",
        "F": "nn", "G": "ns", "Q": "ss", "B": "nr", "D": "mr", "u": "r", "H": "mn",
        "measurement_offset": "m", "R": "mm", "Rc": "mm", "N": "sm", "x0": "n", "P0": "nn",
    },
    "discrete": {
        "states": "n", "units": "n", "measurements": "m", "measurement_units": "m",
        "Phi": "nn", "Qd": "nn", "B": "nr", "D": "mr", "u": "r", "offset": "n", "H": "mn",
        "measurement_offset": "m", "R": "mm", "N": "nm", "x0": "n", "P0": "nn",
    },
}  # fmt: skip
#: Where a size is read, in this order: the rows (0) or columns (1) of what is given.
SOURCES = {
    "n": (("states", 0), ("F", 0), ("Phi", 0)),
    "m": (("measurements", 0), ("H", 0)),
    "s": (("Q", 0),),
    "r": (("u", 0), ("B", 1), ("D", 1)),
}
ONE_PER = {"n": "one per state", "m": "one per measurement", "s": "one per noise", "r": "one per known input"}
#: The same of the table [cost].
WEIGHTS = {"Qx": "nn", "Qu": "rr", "N": "nr", "Qf": "nn"}
TEXTS = ("states", "units", "measurements", "measurement_units")
#: Smaller variances and periods have inverses and squares beyond double precision.
TINY = 1e-150
COVARIANCES = ("Q", "Qd", "Rc", "P0")


def constants(
    document: Document, replaced: Mapping[str, float], broken: frozenset[Path] = frozenset()
) -> tuple[dict[str, float], list[Problem]]:
    """The values of the constants, some of them replaced by numbers, and what is wrong with those that are no ``broken`` cells."""
    wrong_cells = {str(path[1]) for path in broken if path[0] == "constants"}
    definitions: dict[str, Expression] = {name: found.value for name, found in document.constants.items()}
    numbers = {name: value for name, value in replaced.items() if name in definitions}
    found, wrong = values(
        {name: expression for name, expression in definitions.items() if name not in numbers}
        | {name: parse(value) for name, value in numbers.items()},
        wrong_cells - numbers.keys(),
    )
    problems = [
        Problem(place(("constants", name)), error.args[0])
        if name
        else Problem("constants", f"expected no constants that need each other, received {error.args[0]}")
        for name, error in wrong.items()
    ]
    found = {name: found[name] for name in definitions if name in found}
    problems += [problem for name in found if name not in wrong_cells for problem in _range(document, name, found)]
    return found, problems


def _range(document: Document, name: str, found: Mapping[str, float]) -> Iterator[Problem]:
    """A constant outside its own limits."""
    constant, limits = document.constants[name], {"min": -math.inf, "max": math.inf}
    for key in limits:
        expression = getattr(constant, key)
        if expression is None:
            continue
        try:
            limits[key] = expression.value(found)
        except ExpressionError as error:
            yield Problem(place(("constants", name, key)), str(error))
            return
    if limits["min"] > limits["max"]:
        yield Problem(
            place(("constants", name)),
            f"expected min <= max, received min = {limits['min']:g}, max = {limits['max']:g}",
        )
    elif not limits["min"] <= found[name] <= limits["max"]:
        yield Problem(
            place(("constants", name)),
            f"expected a value from {limits['min']:g} to {limits['max']:g}, received {found[name]:g}",
        )


def sizes(document: Document) -> list[Problem]:
    """Matrices that do not fit together."""
    model, problems, size = document.model, [], {}
    shapes = SHAPES[document.kind]
    for letter, sources in SOURCES.items():
        for name, axis in sources:
            value = getattr(model, name, None)
            if value is not None:
                size[letter] = len(value) if axis == 0 else len(value[0]) if value else 0
                break
        if letter in size and not 1 <= size[letter] <= LARGEST:
            problems.append(
                Problem(
                    place(("model", name)), f"expected from 1 to {LARGEST} ({ONE_PER[letter]}), received {size[letter]}"
                )
            )
    for name, shape in shapes.items():
        value = getattr(model, name, None)
        if value is not None and not problems:
            problems += _misfits(name, value, shape, size)
    return problems or list(_missing(document))


def _misfits(name: str, value: Any, shape: str, size: dict[str, int]) -> Iterator[Problem]:
    rows = size.get(shape[0], len(value))
    entries = "names" if name in {"states", "measurements"} else "texts" if "units" in name else "numbers"
    if len(value) != rows:
        what = _plural(rows, "rows" if len(shape) == 2 else entries)
        yield Problem(place(("model", name)), f"expected {what} ({ONE_PER[shape[0]]}), received {len(value)}")
    if len(shape) == 1:
        return
    columns = size.get(shape[1], len(value[0]) if value else 0)
    wrong = [i for i, row in enumerate(value) if len(row) != columns]
    lengths = {len(row) for row in value}
    message = f"expected {_plural(columns, 'columns')} ({ONE_PER[shape[1]]}), received"
    if wrong and len(lengths) == 1:
        yield Problem(place(("model", name)), f"{message} {lengths.pop()}")
    else:
        for i in wrong:
            yield Problem(place(("model", name, i)), f"{message} {len(value[i])}")


def _plural(count: int, words: str) -> str:
    return f"{count} {words if count != 1 else words[:-1]}"


def _missing(document: Document) -> Iterator[Problem]:
    """What one key asks of another."""
    model: Any = document.model
    if document.kind == "continuous" and (model.R is None) == (model.Rc is None):
        received = "neither" if model.R is None else "both"
        yield Problem(
            "model.R",
            f"expected R (covariance of a sampled measurement) or Rc (strength of a continuous one), received {received}",
        )
    if model.u is not None and model.B is None and model.D is None:
        yield Problem("model.B", "expected the matrix B by which the known input u enters, received none (nor D)")
    for name in document.data.regressors:
        if name in document.constants and (other := _elsewhere(document, name)):
            text = f"expected a name of its own, or a constant that stands in for the column, received {name}, which {other} needs too"
            yield Problem(place(("data", "regressors", name)), text)
    if document.kind == "continuous" and model.N is not None and model.R is not None:
        yield Problem("model.N", "expected Rc beside N (the noise that w correlates with), received R")


def _elsewhere(document: Document, name: str) -> str:
    """A place that needs a name where no column of a record may stand, or nothing."""
    values = Values(document, {})
    for constant, told in document.constants.items():
        if name in told.value.names:
            return place(("constants", constant))
    for matrix in [*(n for n in SHAPES[document.kind] if n not in (*TEXTS, *BY_ROW) and values.given(n)), "dt"]:
        for index, cell in values.cells(matrix):
            if name in cell.names:
                return place(("model", matrix, *index))
    return place(("experiment", "t0")) if name in document.experiment.t0.names else ""


def numbers(found: Values, broken: frozenset[Path], without: set[str]) -> list[Problem]:
    """Cells without a value, and matrices that are no covariances. ``without``: constants that have no value themselves."""
    problems, sound = [], set()
    for name in [*(n for n in SHAPES[found.document.kind] if n not in TEXTS and found.given(n)), "dt"]:
        hidden = any(("model", name, *index) in broken or cell.names & without for index, cell in found.cells(name))
        wrong = list(_cells(found, name, broken, without))
        problems += wrong
        sound |= set() if wrong or hidden else {name}
    problems += _settings(found, "dt" in sound, ("experiment", "t0") not in broken, without)
    if problems or "dt" not in sound or without or broken:
        constant = [name for name in SHAPES[found.document.kind] if name in sound and not found.varies(name)]
        return problems + [p for name in constant for p in _matrix(found, name, [])]
    instants = [Instant(k, found.t0 + k * found.dt) for k in range(min(found.document.experiment.steps, INSTANTS) + 1)]
    for name in SHAPES[found.document.kind]:
        if name in sound and not found.by_row(name):  # a regressor has its values with a record
            problems += _matrix(found, name, instants)
    return problems or _cross(found)


def _cells(found: Values, name: str, broken: frozenset[Path], without: set[str]) -> Iterator[Problem]:
    """The cells with unknown names, and the constant ones that have no value."""
    columns = found.document.data.regressors
    known = [*found.document.constants, *sorted(VARYING[found.document.kind].get(name, set())), *(columns if name in BY_ROW else ())]
    for index, cell in found.cells(name):
        path: Path = ("model", name, *index)
        if path in broken:
            continue
        try:
            cell.check(known)
            if cell.constant and not cell.names & without and not found.named(cell):
                cell.value(found.constants)
        except ExpressionError as error:
            hint, strange = "", sorted(cell.names - set(known) - VARIABLES.keys())
            if strange and strange[0] in columns:
                hint = f" ({strange[0]} is a column of the record: it may stand in {', '.join(BY_ROW[:-1])} and B)"
            elif strange and name in BY_ROW and "did you mean" not in str(error):
                hint = f'; a column of a record is declared, regressors = {{ {strange[0]} = "COLUMN" }} under [data], or --regressor'
            yield Problem(place(path), f"{error}{hint}")


def _settings(found: Values, dt: bool, t0: bool, without: set[str]) -> list[Problem]:
    """dt and t0."""
    problems = []
    if dt and not 0 < found.dt < math.inf:
        problems.append(Problem("model.dt", f"expected a period > 0, s, received {found.dt:g}"))
    elif dt and not TINY <= found.dt <= 1 / TINY:
        problems.append(
            Problem("model.dt", f"expected a period from {TINY:g} to {1 / TINY:g} s, received {found.dt:g}")
        )
    try:
        if t0 and not found.document.experiment.t0.names & without and not math.isfinite(found.t0):
            problems.append(Problem("experiment.t0", f"expected a finite time, s, received {found.t0:g}"))
    except ModelFileError as error:
        problems.append(error.problem)
    return problems


def _matrix(found: Values, name: str, instants: list[Instant]) -> list[Problem]:
    """The check that the models make of this matrix, with its place; of a varying one at the first instants."""
    try:
        if not found.varies(name):
            return _refused(name, found.constant(name))
        first = found.document.experiment.first if name in {"H", "R"} else 0
        last = len(instants) if name in {"H", "R"} else len(instants) - 1
        for instant in instants[first:last]:
            wrong = _refused(name, found.at(name, instant))
            if wrong:
                return [Problem(wrong[0].where, f"{instant}: {wrong[0].message}")]
    except ModelFileError as error:
        return [error.problem]
    return []


def _refused(name: str, value: Array) -> list[Problem]:
    """What a model says about a matrix."""
    place_of = f"model.{name}"
    try:
        if name in COVARIANCES and name != "P0":
            checks.covariance(place_of, value, value.shape)
        elif name in ("R", "P0"):
            checks.measurement_covariance(place_of, value, value.shape)
        else:
            checks.array(place_of, value)
    except ValueError as error:
        return [Problem(place_of, str(error).removeprefix(f"{place_of}: "))]
    if name in COVARIANCES or name == "R":
        variances = value.diagonal()
        small = variances[(variances > 0) & (variances < TINY)]
        if small.size:
            return [Problem(place_of, f"expected variances of 0 or from {TINY:g} on, received {small[0]:g}")]
    return []


def _cross(found: Values) -> list[Problem]:
    """N beside the covariances of the noises it correlates."""
    if not found.given("N"):
        return []
    Q, R = ("Q", "Rc") if found.document.kind == "continuous" else ("Qd", "R")
    if found.by_row(R):
        return []
    moving = [name for name in (("F", "G", "Rc") if found.document.kind == "continuous" else ()) if found.varies(name)]
    if moving:
        return [
            Problem("model.N", f"expected {', '.join(moving)} that do not vary beside N, received expressions of t")
        ]
    instants = [Instant(1, found.t0 + found.dt)] if found.varies(Q) or found.varies(R) else [Instant(0, found.t0)]
    try:
        check_joint("N", found.at(Q, instants[0]), found.constant("N"), found.at(R, instants[0]))
    except ValueError as error:
        return [
            Problem("model.N", str(error).replace("[[Q, N], [N', R]]", f"[[{Q}, N], [N', {R}]]").removeprefix("N: "))
        ]
    return []
