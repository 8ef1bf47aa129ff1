"""What a model file holds, version 1: its keys, their types and defaults, as pydantic models.

Sizes and values are the affair of :mod:`ctlabs.files.modelfile.checks`; here a file is taken apart, and its errors told.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, NamedTuple, TypeAlias

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    PlainValidator,
    ValidationError,
    model_validator,
)

from ctlabs.files.mapping import Mapping
from ctlabs.files.modelfile.errors import Path, Problem, meant, place, shown
from ctlabs.files.modelfile.expressions import NAME, RESERVED, VARIABLES, Expression, parse
from ctlabs.filtering.algorithms.catalogue import FORMS
from ctlabs.text import Own

FORMAT = 1
KINDS = ("continuous", "discrete")
#: Most states, measurements, noises, known inputs; most constants; the longest name of anything.
LARGEST, CONSTANTS, LONGEST = 200, 1000, 100
#: No more problems than these are told.
TOLD = 200
#: Largest counts of steps and runs.
STEPS, RUNS = 10_000_000, 100_000_000


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError(f"expected a text in quotes, received {shown(value)}")
    return value


def _label(value: Any) -> str:
    text = _text(value)
    if len(text) > LONGEST or not all(c.isprintable() for c in text):
        raise ValueError(f"expected one line of at most {LONGEST} characters, received {shown(value)}")
    return Own(text)


def _name(value: Any) -> str:
    text = _label(value)
    if not text.strip():
        raise ValueError(f"expected a name, received {shown(value)}")
    return text


def _distinct(names: tuple[str, ...]) -> tuple[str, ...]:
    for i, name in enumerate(names):
        if name in names[:i]:
            raise ValueError(f"expected names that differ, received {shown(name)} twice")
    return names


def _constant_name(name: str) -> str:
    if name in RESERVED:
        what = VARIABLES.get(name, "known already")
        raise ValueError(f'expected a name of its own, received "{name}" ({what}); rename it, say {name}_0')
    if not NAME.fullmatch(name) or len(name) > LONGEST:
        raise ValueError(f"expected a name of letters, digits and _ that begins with a letter, received {shown(name)}")
    return name


def wrong_name(name: str) -> str:
    """What is wrong with the name of a constant; empty where nothing is."""
    try:
        _constant_name(name)
    except ValueError as error:
        return str(error)
    return ""


def _whole(least: int, most: int) -> Any:
    def check(value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
            raise ValueError(f"expected a whole number from {least} to {most}, received {shown(value)}")
        return value

    return PlainValidator(check)


def _algorithm(value: Any) -> str:
    text = _text(value)
    if text not in FORMS:
        raise ValueError(f"unknown algorithm {shown(text)}{meant(text, FORMS, len(FORMS))}")
    return text


def _some(algorithms: tuple[str, ...]) -> tuple[str, ...]:
    if not algorithms:
        raise ValueError("expected at least one algorithm, received none")
    return algorithms


Cell: TypeAlias = Annotated[Expression, PlainValidator(parse)]
Vector: TypeAlias = tuple[Cell, ...]
Matrix: TypeAlias = tuple[tuple[Cell, ...], ...]
Text: TypeAlias = Annotated[str, PlainValidator(_text)]
Label: TypeAlias = Annotated[str, PlainValidator(_label)]
Names: TypeAlias = Annotated[tuple[Annotated[str, PlainValidator(_name)], ...], AfterValidator(_distinct)]
ZERO, ONE = parse(0), parse(1)
#: What an input may answer: the measurement of its own instant, or that before.
ANSWERS = ("current", "delayed")


class _Table(BaseModel):
    """A table of the file; a key that is not listed is refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class ConstantTable(_Table):
    """A constant: its value, and what a slider needs."""

    value: Cell
    min: Cell | None = None
    max: Cell | None = None
    unit: Label = ""
    meaning: Label = ""


class _Model(_Table):
    """What both kinds have."""

    states: Names | None = None
    units: tuple[Label, ...] | None = None
    measurements: Names | None = None
    measurement_units: tuple[Label, ...] | None = None
    H: Matrix
    B: Matrix | None = None
    D: Matrix | None = None
    u: Vector | None = None
    measurement_offset: Vector | None = None
    N: Matrix | None = None
    x0: Vector | None = None
    P0: Matrix
    dt: Cell


class Continuous(_Model):
    """[model] of kind = "continuous"."""

    F: Matrix
    G: Matrix
    Q: Matrix
    R: Matrix | None = None
    Rc: Matrix | None = None


class Discrete(_Model):
    """[model] of kind = "discrete"."""

    Phi: Matrix
    Qd: Matrix
    R: Matrix
    offset: Vector | None = None


class ExperimentTable(_Table):
    """[experiment]: what the commands do unless they are told otherwise."""

    t0: Cell = ZERO
    first: Annotated[int, _whole(0, 1)] = 1
    steps: Annotated[int, _whole(1, STEPS)] = 200
    runs: Annotated[int, _whole(1, RUNS)] = 1000
    seed: Annotated[int, _whole(0, 2**63 - 1)] = 1
    algorithms: Annotated[tuple[Annotated[str, PlainValidator(_algorithm)], ...], AfterValidator(_some)] = ("joseph",)


def _word(value: Any) -> str:
    """A word for "not measured"; a number is one too."""
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise ValueError(f"expected a text in quotes or a number, received {shown(value)}")
    return value if isinstance(value, str) else repr(value)


def _factor(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"expected a number, received {shown(value)}")
    return float(value)


class Data(_Table):
    """[data]: how a record names and writes what the model measures."""

    columns: dict[str, Text] = {}
    time_unit: Text = ""
    t0: Text = ""
    inputs: Annotated[tuple[Annotated[str, PlainValidator(_name)], ...], AfterValidator(_distinct)] = ()
    u0: tuple[Annotated[float, PlainValidator(_factor)], ...] = ()
    regressors: dict[Annotated[str, PlainValidator(_constant_name)], Text] = {}
    record: Text = ""
    missing: tuple[Annotated[str, PlainValidator(_word)], ...] = ()
    scale: dict[str, Annotated[float, PlainValidator(_factor)]] = {}
    decimal: Text = ""
    thousands: Text = ""
    blank: Text = ""
    encoding: Text = ""
    skip: Annotated[int, _whole(0, 10**6)] = 0
    sheet: Text = ""

    @model_validator(mode="after")
    def _sensible(self) -> Data:
        try:
            self.mapping()
        except ValueError as error:
            raise ValueError(str(error).removeprefix("--")) from None
        return self

    def mapping(self) -> Mapping:
        """The same for the reader of records."""
        told = {name: getattr(self, name) for name in type(self).model_fields if name not in ("columns", "time_unit")}
        columns = dict(self.columns)
        time = columns.pop("t", "")
        return Mapping(columns=columns, time=time, unit=self.time_unit, **told)


def _answer(value: Any) -> str:
    text = _text(value)
    if text not in ANSWERS:
        expected = " or ".join(shown(each) for each in ANSWERS)
        raise ValueError(f"expected {expected}, received {shown(text)}")
    return text


def _switch(value: Any) -> bool:
    if not isinstance(value, bool):
        raise ValueError(f"expected true or false, received {shown(value)}")
    return value


class OutputTable(_Table):
    """The weight of a measurement, or of a combination of the states, whose ``row`` is given."""

    weight: Cell
    row: Vector | None = None


Weighed: TypeAlias = Annotated[OutputTable, BeforeValidator(lambda value: value if isinstance(value, dict) else {"weight": value})]


class CostTable(_Table):
    """[cost]: what a regulator shall keep small, and how it is built."""

    Qx: Matrix | None = None
    Qu: Matrix
    N: Matrix | None = None
    Qf: Matrix | None = None
    horizon: Cell | None = None
    outputs: dict[Annotated[str, PlainValidator(_name)], Weighed] = {}
    discount: Cell = ONE
    constant: Cell = ZERO
    delay: Cell = ZERO
    kind: Annotated[str, PlainValidator(_answer)] = "current"
    integral: dict[Annotated[str, PlainValidator(_name)], Cell] = {}
    loads: Names = ()
    track: Names = ()
    stabilise: Annotated[bool, PlainValidator(_switch)] = False


class Document(_Table):
    """A whole file."""

    format: int
    title: Label = ""
    description: Text = ""
    source: Text = ""
    kind: str
    constants: dict[
        Annotated[str, PlainValidator(_constant_name)],
        Annotated[ConstantTable, BeforeValidator(lambda value: value if isinstance(value, dict) else {"value": value})],
    ] = {}
    model: Continuous | Discrete
    experiment: ExperimentTable = ExperimentTable()
    data: Data = Data()
    cost: CostTable | None = None


class _ContinuousDocument(Document):
    model: Continuous


class _DiscreteDocument(Document):
    model: Discrete


DOCUMENTS: dict[str, type[Document]] = {"continuous": _ContinuousDocument, "discrete": _DiscreteDocument}
SECTIONS: dict[str, type[_Model]] = {"continuous": Continuous, "discrete": Discrete}

#: What a key is, for messages and pages.
MEANINGS = {
    "model": "a table [model]",
    "constants": "a table [constants]",
    "experiment": "a table [experiment]",
    "data": "a table [data]",
    "cost": "a table [cost]",
    "Qu": "the weight Qu of the inputs",
    "weight": "the output's weight",
    "F": "the matrix F of dx/dt = F x + B u + G w",
    "G": "the matrix G, by which the noise w enters",
    "Q": "the strength Q of the noise w",
    "Phi": "the transition matrix Phi",
    "Qd": "the covariance Qd of the noise of a step",
    "H": "the matrix H of z = H x + v",
    "R": "the covariance R of a measurement",
    "P0": "the covariance P0 of the state at t0",
    "dt": "the period dt, s",
    "value": "the constant's value",
}


class Read(NamedTuple):
    """A file taken apart: the document (None where that failed), what is wrong, and the cells that are no expressions."""

    document: Document | None
    problems: list[Problem]
    broken: frozenset[Path]


def read(data: dict[str, Any]) -> Read:
    """Take apart the plain data of a file. Cells that are no expressions count as 0, so that the rest can be checked."""
    wrong = _version(data) or list(_too_many(data))
    if wrong:
        return Read(None, wrong[:TOLD], frozenset())
    document, problems, cells = _validated(data)
    if document is None and cells and len(cells) == len(problems):
        document, _, _ = _validated(_without(data, cells))
    return Read(document, problems, frozenset(cells))


def _version(data: dict[str, Any]) -> list[Problem]:
    """What is wrong with ``format`` and ``kind``, on which all else depends."""
    known = Document.model_fields
    problems = [
        Problem("", f"unknown key {shown(key)}{meant(key, known, len(known))}")
        for key in [key for key in data if key not in known][:TOLD]
    ]
    found = data.get("format")
    if "format" not in data:
        problems.append(Problem("format", f"expected format = {FORMAT}, the version of the file, received none"))
    elif isinstance(found, bool) or found != FORMAT:
        problems.append(
            Problem("format", f"expected {FORMAT}, the version this program reads, received {shown(found)}")
        )
    kinds = " or ".join(f'"{kind}"' for kind in KINDS)
    if data.get("kind") not in KINDS:
        problems.append(
            Problem("kind", f"expected {kinds}, received {shown(data['kind']) if 'kind' in data else 'none'}")
        )
    return problems


def _too_many(data: dict[str, Any]) -> Iterator[Problem]:
    """Lists that are longer than anything a file may hold, before each of their elements is read."""
    constants = data.get("constants")
    if isinstance(constants, dict) and len(constants) > CONSTANTS:
        yield Problem("constants", f"expected at most {CONSTANTS} constants, received {len(constants)}")
    for table in ("model", "cost"):
        told = data.get(table)
        for key, value in told.items() if isinstance(told, dict) else ():
            yield from _too_long((table, key), value)


def _too_long(path: Path, value: Any) -> Iterator[Problem]:
    if not isinstance(value, list | dict):
        return
    if len(value) > LARGEST:
        yield Problem(place(path), f"expected at most {LARGEST} rows or elements, received {len(value)}")
        return
    for i, row in enumerate(value) if isinstance(value, list) else ():
        if isinstance(row, list) and len(row) > LARGEST:
            yield Problem(place((*path, i)), f"expected at most {LARGEST} columns, received {len(row)}")


def _validated(data: dict[str, Any]) -> tuple[Document | None, list[Problem], list[Path]]:
    """The document, or problems and those of them that are cells."""
    try:
        return DOCUMENTS[data["kind"]].model_validate(data), [], []
    except ValidationError as error:
        errors = sorted(error.errors(include_url=False), key=lambda found: found["type"] != "extra_forbidden")
    strays = _strays(data)
    cells: list[Path] = []
    problems: list[Problem] = []
    for found in errors[:TOLD]:
        path = _path(data, found["loc"])
        if strays and path[0] == "constants" and path[1] in strays:
            continue
        if strays and path == ("model",):
            where = f"{', '.join(strays[:4])}{', …' if len(strays) > 4 else ''} under [constants]"
            problems.insert(
                0, Problem("model", f"expected a table [model], received none, and {where}; write [model] above")
            )
            continue
        problems.append(_problem(data, found, path))
        if found["type"] == "value_error" and "[key]" not in found["loc"] and _is_cell(path):
            cells.append(path)
    return None, problems, cells if len(errors) <= TOLD else []


def _strays(data: dict[str, Any]) -> list[str]:
    """Keys of a model that stand among the constants, where no section [model] begins."""
    constants = data.get("constants")
    if "model" in data or not isinstance(constants, dict):
        return []
    keys = SECTIONS[data["kind"]].model_fields
    return [key for key, value in constants.items() if key in keys and isinstance(value, list)]


def _path(data: dict[str, Any], loc: tuple[str | int, ...]) -> Path:
    """Where pydantic's place is in the file."""
    path = tuple(part for part in loc if part != "[key]")
    if path[:1] == ("constants",) and len(path) == 3 and not isinstance(data["constants"].get(path[1]), dict):
        return path[:2]
    if path[:2] == ("cost", "outputs") and len(path) == 4 and not isinstance(data["cost"]["outputs"].get(path[2]), dict):
        return path[:3]
    return path


def _is_cell(path: Path) -> bool:
    if path[0] == "constants":
        return len(path) == 2 or path[2:] in {("value",), ("min",), ("max",)}
    if path[0] == "cost":
        return len(path) > 1 and path[1] not in {"kind", "loads", "track", "stabilise"}
    texts = {"states", "units", "measurements", "measurement_units"}
    return path == ("experiment", "t0") or (path[0] == "model" and len(path) > 1 and path[1] not in texts)


def _problem(data: dict[str, Any], found: Any, path: Path) -> Problem:
    kind, key = found["type"], path[-1]
    if kind == "extra_forbidden":
        return Problem(place(path[:-1]), _unknown(data["kind"], path))
    if kind == "missing":
        return Problem(place(path), f"expected {MEANINGS.get(str(key), f'a value of {key}')}, received none")
    if kind == "value_error":
        return Problem(place(path), found["msg"].removeprefix("Value error, "))
    return Problem(place(path), f"expected {_shape(path)}, received {shown(found['input'])}")


def _unknown(kind: str, path: Path) -> str:
    key = str(path[-1])
    tables = {"model": SECTIONS[kind], "experiment": ExperimentTable, "constants": ConstantTable, "data": Data, "cost": CostTable}
    fields: Any = OutputTable if path[0] == "cost" and len(path) > 2 else tables.get(str(path[0]), Document)
    known = list(fields.model_fields)
    other = SECTIONS[KINDS[kind == KINDS[0]]]
    if path[0] == "model" and key in other.model_fields:
        own = " ".join(name for name in known if name not in other.model_fields)
        return f'unknown key "{key}" in a {kind} model; of the two kinds, this one has {own}'
    return f"unknown key {shown(key)}{meant(key, known, len(known))}"


def _shape(path: Path) -> str:
    """What has to stand at a place, where something of another type does."""
    if len(path) == 1 or path[0] == "constants":
        return MEANINGS.get(str(path[0]), "a value")
    key, depth = str(path[1]), len(path)
    if path[0] == "data":
        return "a table NAME = value" if key in {"columns", "scale", "regressors"} else "a list of texts in quotes"
    if key in {"outputs", "integral"} and depth == 2:
        return "a table NAME = weight"
    if key in {"states", "units", "measurements", "measurement_units", "algorithms", "loads", "track"}:
        return "a list of texts in quotes"
    if key in {"x0", "u", "offset", "measurement_offset", "outputs"}:
        return "a list of numbers or expressions"
    return (
        "a list of rows, each a list of numbers or expressions"
        if depth == 2
        else "a row, a list of numbers or expressions"
    )


def _without(data: dict[str, Any], cells: list[Path]) -> dict[str, Any]:
    """A copy of the data with 0 in place of the cells."""

    def copied(value: Any, path: Path) -> Any:
        if path in wrong:
            return 0
        if isinstance(value, dict):
            return {key: copied(item, (*path, key)) for key, item in value.items()}
        if isinstance(value, list):
            return [copied(item, (*path, i)) for i, item in enumerate(value)]
        return value

    wrong = set(cells)
    return {key: copied(value, (key,)) for key, value in data.items()}
