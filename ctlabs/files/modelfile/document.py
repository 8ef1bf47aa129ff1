"""A model file: its text, what it means, and changes of both."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from collections.abc import Mapping as Table
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ctlabs.files import whole
from ctlabs.files.mapping import Mapping
from ctlabs.files.modelfile import build, checks, costs, edits, schema
from ctlabs.files.modelfile.costs import RegulatorSettings
from ctlabs.files.modelfile.errors import ModelFileError, Path, Problem, meant, place, shown
from ctlabs.files.modelfile.expressions import VARIABLES
from ctlabs.files.modelfile.toml import LARGEST, decoded, parsed, too_large
from ctlabs.files.modelfile.values import BY_ROW, Instant, Regressors, Values
from ctlabs.linalg.checks import Array
from ctlabs.models import ContinuousModel, Cost, DiscreteModel
from ctlabs.models.linear import input_names


class Constant(NamedTuple):
    """A constant of a file: its value, the expression it was typed as, and the limits, unit and meaning given beside it."""

    name: str
    value: float
    expression: str
    min: float | None
    max: float | None
    unit: str
    meaning: str


class ExperimentSettings(NamedTuple):
    """[experiment]: t0 (s), first (0 or 1), steps, runs, seed, algorithms."""

    t0: float
    first: int
    steps: int
    runs: int
    seed: int
    algorithms: tuple[str, ...]


@dataclass(frozen=True, eq=False, repr=False)
class ModelFile:
    """A model file. Immutable: every change returns another one.

    ``name`` is the file's name in messages. What is read (``constants``, ``states``, :meth:`discrete`, …) raises the first of
    :meth:`problems`; a file from :func:`load` has none, after :meth:`edit` it may.

    >>> from ctlabs.files.modelfile import ready
    >>> nile = ready("local_level")
    >>> nile.states, nile.constants
    (('level',), {'q': 1469.1, 'r': 15099.0})
    >>> nile.replace({"q": 1500}).discrete().Qd
    array([[1500.]])
    """

    name: str
    _text: str
    _data: dict[str, Any]
    _read: schema.Read
    _replaced: Table[str, float] = field(default_factory=dict)
    _sound: bool = False  # the text has no problems, so that only replaced numbers can make some

    # --- what the file says ------------------------------------------------------------------------------------------

    @property
    def title(self) -> str:
        """The title, or the file's name without its ending."""
        return self._document.title or FilePath(self.name).stem

    @property
    def description(self) -> str:
        """What the model is, in words."""
        return self._document.description

    @property
    def source(self) -> str:
        """Where the model comes from."""
        return self._document.source

    @property
    def kind(self) -> str:
        """"continuous" or "discrete"."""  # fmt: skip
        return self._document.kind

    @property
    def constants(self) -> dict[str, float]:
        """The values of the constants."""
        return dict(self._values.constants)

    @property
    def definitions(self) -> tuple[Constant, ...]:
        """The constants with all that is told of them."""
        values, found = self._values.constants, []
        for name, told in self._document.constants.items():
            low, high = (None if bound is None else bound.value(values) for bound in (told.min, told.max))
            text = repr(self._replaced[name]) if name in self._replaced else told.value.text
            found.append(Constant(name, values[name], text, low, high, told.unit, told.meaning))
        return tuple(found)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states; x1, x2, … unless they are given."""
        return self._document.model.states or tuple(f"x{i + 1}" for i in range(self.n))

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the states."""
        return self._document.model.units or ("",) * self.n

    @property
    def measurements(self) -> tuple[str, ...]:
        """Names of the measurements; z1, z2, … unless they are given."""
        return self._document.model.measurements or tuple(f"z{i + 1}" for i in range(self.m))

    @property
    def measurement_units(self) -> tuple[str, ...]:
        """Units of the measurements."""
        return self._document.model.measurement_units or ("",) * self.m

    @property
    def n(self) -> int:
        """Number of states."""
        return self._values.sizes.n

    @property
    def m(self) -> int:
        """Number of measurements."""
        return self._values.sizes.m

    @property
    def s(self) -> int:
        """Number of noises of a continuous model, 0 of a discrete one."""
        return self._values.sizes.s

    @property
    def dt(self) -> float:
        """The period, s."""
        return self._values.dt

    @property
    def experiment(self) -> ExperimentSettings:
        """What the commands do unless they are told otherwise."""
        told = self._document.experiment
        return ExperimentSettings(self._values.t0, told.first, told.steps, told.runs, told.seed, told.algorithms)

    @property
    def cost(self) -> Cost | None:
        """[cost]: what a regulator shall keep small; ``None`` where the file has no such table."""
        return costs.cost(self._values)

    @property
    def regulator(self) -> RegulatorSettings:
        """How the regulator of [cost] is built; :class:`ModelFileError` where the file has no such table."""
        return costs.settings(self._values)

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs: those of [data], or u, or u1, u2, … where [data] has none."""
        told, r = self._document.data.inputs, self.inputs
        return told if len(told) == r else input_names(r)

    @property
    def mapping(self) -> Mapping:
        """[data]: how records name and write what the model measures; of a file whose matrices are wrong, too."""
        read = self._read.document
        document = self._document if read is None else read
        return replace(document.data.mapping(), standing=tuple(name for name in document.data.regressors if name in document.constants))

    @property
    def driven(self) -> bool:
        """Whether the model has a known input that the file does not give: B or D without u."""
        return (self._values.given("B") or self._values.given("D")) and not self._values.given("u")

    @property
    def inputs(self) -> int:
        """Number of known inputs."""
        return self._values.sizes.r

    @property
    def moved(self) -> bool:
        """Whether a known input moves the state: B."""
        return self._values.given("B")

    @property
    def regressors(self) -> tuple[str, ...]:
        """The columns of a record that elements of H, R, D, B or the measurement offset name."""
        values = self._values
        used = {name for matrix in BY_ROW if values.given(matrix) for _, cell in values.cells(matrix) for name in cell.names}
        return tuple(name for name in self._document.data.regressors if name in used)

    @property
    def unknown(self) -> tuple[str, ...]:
        """Names in H, R, D, B or the measurement offset that the file does not declare: perhaps columns of a record.

        >>> from ctlabs.files.modelfile import ready
        >>> ready("local_level").edit(("model", "H", 0, 0), "price").unknown
        ('price',)
        """
        document = self._read.document
        if document is None:
            return ()
        values = Values(document, {}, self.name)
        known = {*document.constants, *document.data.regressors, *VARIABLES}
        cells = (cell for matrix in BY_ROW if values.given(matrix) for _, cell in values.cells(matrix))
        return tuple(dict.fromkeys(name for cell in cells for name in sorted(cell.names) if name not in known))

    def declaring(self, columns: Table[str, str]) -> ModelFile:
        """The same file with further regressors {name: column of the record} in its table [data]."""
        data = self._data.get("data")
        if isinstance(data, dict) and "regressors" in data:
            return self.edit_all([(("data", "regressors", name), column) for name, column in columns.items()])
        return self.edit(("data", "regressors"), dict(columns)) if columns else self

    def absent(self, regressors: Regressors) -> NDArray[np.bool_]:
        """The elements of z, (steps+1, m), that cannot be used, as a regressor beside them has no value."""
        return replace(self._values, regressors=regressors).absent(len(regressors.lines))

    @property
    def varying(self) -> tuple[str, ...]:
        """The matrices that depend on t or k."""
        names = checks.SHAPES[self.kind]
        return tuple(name for name in names if name not in checks.TEXTS and self._values.varies(name))

    def matrix(self, name: str, t: float | None = None, k: int = 0) -> Array:
        """The value of a matrix, vector or number of [model]; of one that varies, at a time t (t0 + k·dt by default) and index k."""
        values = self._values
        if name not in {*checks.SHAPES[self.kind], "dt"} - set(checks.TEXTS) or not values.given(name):
            known = [n for n in checks.SHAPES[self.kind] if n not in checks.TEXTS and values.given(n)]
            raise ModelFileError(
                Problem("model", f"no matrix {shown(name)}{meant(name, known, len(known))}"), self.name
            )
        return values.at(name, Instant(k, values.t0 + k * values.dt if t is None else t))

    def latex(self, name: str) -> str:
        """A matrix of [model] inside an equation, as expressions."""
        values = self._values
        self.matrix(name)
        shape = values.shape(name)
        texts = [cell.latex() for _, cell in values.cells(name)]
        if not shape or len(texts) == 1:
            return texts[0]
        width = shape[1] if len(shape) == 2 else 1
        rows = r" \\ ".join(" & ".join(texts[i : i + width]) for i in range(0, len(texts), width))
        return rf"\begin{{bmatrix}} {rows} \end{{bmatrix}}"

    # --- models --------------------------------------------------------------------------------------------------------

    def continuous(self) -> ContinuousModel:
        """The model of a continuous file.

        Raises
        ------
        ModelFileError
            A discrete file; matrices that vary; what the model refuses, with its place in the file.
        """
        return build.continuous(self._values)

    def discrete(
        self,
        steps: int | None = None,
        times: ArrayLike | None = None,
        inputs: Array | None = None,
        regressors: Regressors | None = None,
    ) -> DiscreteModel:
        """The discrete model that the commands filter with.

        A continuous file is discretised exactly over every interval; B·u is added with u held at its value at the
        interval's beginning; R is the file's, or Rc/dt of the interval that follows. Matrices of a discrete file are taken at
        k and t = t0 + k·dt. A model without t and k in it, over equal intervals, is constant, whatever ``steps``.

        Parameters
        ----------
        steps : how many steps, where matrices vary; those of [experiment] by default
        times : (steps+1,), s, increasing, instead of t0, t0 + dt, …; ``times[0]`` is the instant of x0 and P0. A discrete
            file takes only times dt apart. Where they are not equally spaced, ``dt`` of the model is the mean interval.
        inputs : (steps+1, r), a record's known inputs in place of u: each acts over the interval that follows (B), and
            enters the measurement at its instant (D)
        regressors : columns of a record that elements name, by instants

        Raises
        ------
        ModelFileError, ValueError
            A value that is missing or not allowed at a time, with its place; times that do not increase or that a
            discrete file cannot follow, with their row; a regressor without a record.
        """
        return build.discrete(self._values, steps, times, inputs, regressors)

    def plant(self, steps: int | None = None) -> ContinuousModel | DiscreteModel:
        """The model with its inputs, as a regulator takes it: continuous, or discrete with B and D.

        Parameters
        ----------
        steps : of a discrete file whose matrices vary

        Raises
        ------
        ModelFileError
            No B; a continuous file whose matrices vary.

        >>> from ctlabs.files.modelfile import ready
        >>> ready("double_integrator").plant().B
        array([[0.],
               [1.]])
        """
        return costs.plant(self._values, steps)

    # --- problems ------------------------------------------------------------------------------------------------------

    def problems(self) -> list[Problem]:
        """All that is wrong with the file; an empty list where nothing is."""
        return list(self._problems)

    def checked(self) -> ModelFile:
        """The file itself, if it has no problems; otherwise its first is raised."""
        _ = self._values
        return self

    @cached_property
    def _problems(self) -> tuple[Problem, ...]:
        document, problems, broken = self._read
        if document is None:
            return tuple(problems)
        constants, wrong = self._constants
        found = [*problems, *wrong, *(misfits := checks.sizes(document) or costs.misfits(document))]
        if not misfits:
            without, values = document.constants.keys() - constants.keys(), Values(document, constants, self.name)
            found += checks.numbers(values, broken, without) + costs.problems(values, broken, without)
        return tuple(found)

    @cached_property
    def _constants(self) -> tuple[dict[str, float], list[Problem]]:
        document = self._read.document
        return checks.constants(document, self._replaced, self._read.broken) if document is not None else ({}, [])

    @cached_property
    def _values(self) -> Values:
        document = self._read.document
        problems = self._constants[1] if self._sound else self._problems
        if problems or document is None:
            raise ModelFileError(problems[0], self.name)
        return Values(document, self._constants[0], self.name)

    @property
    def _document(self) -> schema.Document:
        return self._values.document

    def data(self) -> dict[str, Any]:
        """The plain data of the text, whatever is wrong with it; a copy."""
        return parsed(self.dumps(), self.name)

    @property
    def contents(self) -> Table[str, Any]:
        """The plain data of the text, whatever is wrong with it, to be read only."""
        return self.data() if self._replaced else self._data

    # --- the text and its changes ----------------------------------------------------------------------------------------

    def dumps(self) -> str:
        """The text of the file: as it was read, but for what was changed."""
        return self._written

    @cached_property
    def _written(self) -> str:
        return edits.constants(self._text, self._data, self._replaced) if self._replaced else self._text

    def replace(self, values: Table[str, float]) -> ModelFile:
        """The same file with other numbers for some constants; those that are expressions of them follow.

        >>> from ctlabs.files.modelfile import ready
        >>> ready("local_level").replace({"p": 1})
        Traceback (most recent call last):
        ...
        ctlabs.files.modelfile.errors.ModelFileError: local_level.toml: constants: unknown name "p"; known are q, r
        """
        known = self._values.document.constants
        numbers = dict(self._replaced)
        for name, value in values.items():
            if name not in known:
                raise ModelFileError(Problem("constants", f"unknown name {shown(name)}{meant(name, known)}"), self.name)
            numbers[name] = self._number(("constants", name), value)
        return replace(self, _replaced=numbers, _sound=True)

    def _number(self, path: Path, value: float) -> float:
        number = (
            np.float64(value)
            if isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
            else np.nan
        )
        if np.isnan(number):
            raise ModelFileError(Problem(place(path), f"expected a number, received {shown(value)}"), self.name)
        return float(number)

    def edit(self, where: Path, value: Any) -> ModelFile:
        """Another value (a number, an expression, a text, a list) at a place of the file; a key that is not there is added.

        The value is not judged here: :meth:`problems` of the result does that.

        >>> from ctlabs.files.modelfile import ready
        >>> nile = ready("local_level").edit(("model", "P0", 0, 0), "4*r").edit(("title",), "The Nile")
        >>> nile.matrix("P0"), nile.title
        (array([[60396.]]), 'The Nile')
        """
        return self.edit_all([(where, value)])

    def edit_all(self, changes: Sequence[tuple[Path, Any]]) -> ModelFile:
        """Other values at several places, as by :meth:`edit` one after the other."""
        ways = [(self._way(where), value) for where, value in changes]
        data = None if self._replaced else self._data
        return self._changed(lambda text, _: edits.assign(text, *ways, data=data), ways[0][0]) if ways else self

    def remove(self, where: Path) -> ModelFile:
        """The file without a key, or without an element of a list."""
        return self._changed(edits.remove, self._way(where))

    def set_constant(self, name: str, value: Any) -> ModelFile:
        """A constant's value, a number or an expression; a new constant is added at the end."""
        return self.edit(("constants", name), value)

    def remove_constant(self, name: str) -> ModelFile:
        """The file without a constant that nothing refers to."""
        users = [path for path, _ in edits.users(self._settled()._data, name) if path[:2] != ("constants", name)]
        if users:
            message = f"expected a constant that is used nowhere, received one that {place(users[0])} refers to"
            raise ModelFileError(Problem(place(("constants", name)), message), self.name)
        return self.remove(("constants", name))

    def rename_constant(self, old: str, new: str) -> ModelFile:
        """Another name for a constant, in all expressions too."""
        table = self._data.get("constants")
        known, problem = table if isinstance(table, dict) else {}, schema.wrong_name(new)
        if old not in known:
            problem = f"unknown name {shown(old)}{meant(old, known)}"
        elif new in known:
            problem = f"expected a new name, received {shown(new)}, which another constant has"
        elif old in self._document.data.regressors:
            problem = f"expected a constant of the file alone, received {shown(old)}, which is a column of the record, too, under [data]"
        if problem:
            raise ModelFileError(Problem("constants", problem), self.name)
        return self._changed(lambda text, _: edits.rename(text, old, new), ("constants", old))

    def add_state(self, name: str = "", unit: str = "") -> ModelFile:
        """One more state at the end: a constant with the variance 1, which nothing drives or measures yet."""
        return self._grown("n", {"states": name, "units": unit})

    def remove_state(self, index: int) -> ModelFile:
        """The file without a state: its rows and columns, name and unit."""
        return self._shrunk("n", "state", index)

    def add_noise(self) -> ModelFile:
        """One more noise of a continuous model, of strength 1, which drives nothing yet."""
        if self._sized()["s"] == 0:
            message = "expected a continuous model (the noise of a discrete one is Qd, a row for each state), received a discrete one"
            raise ModelFileError(Problem("model", message), self.name)
        return self._grown("s", {})

    def remove_noise(self, index: int) -> ModelFile:
        """The file without a noise of a continuous model."""
        return self._shrunk("s", "noise", index)

    def add_measurement(self, name: str = "", unit: str = "") -> ModelFile:
        """One more measurement at the end: a noise of variance (or strength) 1, which no state enters yet."""
        return self._grown("m", {"measurements": name, "measurement_units": unit})

    def remove_measurement(self, index: int) -> ModelFile:
        """The file without a measurement: its rows and columns, name and unit."""
        return self._shrunk("m", "measurement", index)

    def save(self, path: str | FilePath, *, overwrite: bool = False) -> None:
        """Write the text to a file, whole or not at all.

        Raises
        ------
        ModelFileError
            The file exists, unless ``overwrite``; it cannot be written.
        """
        target = FilePath(path)
        if target.exists() and not overwrite:
            raise ModelFileError(Problem("", f"expected a file that does not exist yet, received {target}"))
        try:
            whole.write(target, self.dumps().encode())
        except OSError as error:
            raise ModelFileError(
                Problem("", f"expected a file that can be written, received: {error.strerror}"), target.name
            ) from None

    def _way(self, where: Path) -> Path:
        path = tuple(where) if isinstance(where, tuple | list) else ()
        if (
            not path
            or not all(isinstance(part, str | int) and not isinstance(part, bool) for part in path)
            or isinstance(path[0], int)
        ):
            raise ModelFileError(
                Problem("", f'expected a place like ("model", "F", 0, 1), received {shown(where)}'), self.name
            )
        return path

    def _changed(self, change: Callable[..., str], path: Path, *arguments: Any) -> ModelFile:
        try:
            text = change(self.dumps(), path, *arguments)
        except ModelFileError as error:
            raise ModelFileError(error.problem, self.name) from None
        return loads(text, self.name, check=False)

    def _settled(self) -> ModelFile:
        """The file with replaced numbers in its text."""
        return loads(self.dumps(), self.name, check=False) if self._replaced else self

    def _sized(self) -> dict[str, int]:
        """The sizes n, m, s; :class:`ModelFileError` unless the matrices fit together, whatever their values."""
        document = self._read.document
        problems = self._read.problems if document is None else checks.sizes(document)
        if document is None or problems:
            raise ModelFileError(problems[0], self.name)
        return Values(document, {}, self.name).sizes._asdict()

    def _grown(self, letter: str, labels: dict[str, str]) -> ModelFile:
        sizes, kind = self._sized(), str(self._data["kind"])
        return self._changed(lambda text, _: edits.grow(text, kind, letter, labels, sizes), ("model",))

    def _shrunk(self, letter: str, what: str, index: int) -> ModelFile:
        size, kind = self._sized()[letter], str(self._data["kind"])
        if isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < size or size < 2:
            expected = f"a {what} from 0 to {size - 1}, and another one left" if size > 1 else f"more than one {what}"
            raise ModelFileError(Problem("model", f"expected {expected}, received {shown(index)} of {size}"), self.name)
        return self._changed(lambda text, _: edits.shrink(text, kind, letter, index), ("model",))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ModelFile) and self.dumps() == other.dumps()

    def __hash__(self) -> int:
        return hash(self.dumps())

    def __repr__(self) -> str:
        return f"<ModelFile {self.name or 'without a name'}, {self.dumps().count(chr(10))} lines>"


def load(path: str | FilePath, *, check: bool = True) -> ModelFile:
    """The model file at a path, or from the standard input ("-"); ``check`` as for :func:`loads`.

    Raises
    ------
    ModelFileError
        The file cannot be read, is no UTF-8 text or no TOML (with line and column), or its first problem; one line.
    """
    name = "stdin" if str(path) == "-" else FilePath(path).name
    try:
        if str(path) == "-":
            if sys.stdin is None:  # closed: <&-
                raise ModelFileError(Problem("", "expected a model on the standard input, received a closed one"), name)
            content = sys.stdin.buffer.read(LARGEST + 1)
        else:
            with FilePath(path).open("rb") as file:
                content = file.read(LARGEST + 1)
    except OSError as error:
        raise ModelFileError(
            Problem("", f"expected a file that can be read, received: {error.strerror}"), str(path)
        ) from None
    return loads(decoded(content, name), name, check=check)


def loads(text: str, name: str = "model.toml", *, check: bool = True) -> ModelFile:
    """The model file that a text is.

    Parameters
    ----------
    text : TOML
    name : the file's name, in front of every message
    check : with ``False`` only TOML itself is required; :meth:`ModelFile.problems` tells the rest

    >>> loads("format = 1")
    Traceback (most recent call last):
    ...
    ctlabs.files.modelfile.errors.ModelFileError: model.toml: kind: expected "continuous" or "discrete", received none
    """
    if len(text) > LARGEST or len(text.encode("utf-8", "replace")) > LARGEST:
        raise too_large(name)
    data = parsed(text, name)
    found = ModelFile(name, text, data, schema.read(data))
    return found.checked() if check else found
