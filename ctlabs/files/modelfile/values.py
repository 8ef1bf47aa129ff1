"""The numbers of a model file: its matrices at a time, or at many times."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from ctlabs.files.modelfile.errors import ModelFileError, Path, Problem, place
from ctlabs.files.modelfile.expressions import Expression, ExpressionError
from ctlabs.files.modelfile.schema import Document
from ctlabs.linalg.checks import Array
from ctlabs.text import moment

#: Which of t and k a value may contain; those that are not listed are constant.
VARYING: dict[str, dict[str, set[str]]] = {
    "continuous": {
        "F": {"t"},
        "G": {"t"},
        "Q": {"t"},
        "B": {"t"},
        "Rc": {"t"},
        "u": {"t", "k"},
        "H": {"t", "k"},
        "D": {"t", "k"},
        "measurement_offset": {"t", "k"},
        "R": {"t", "k"},
    },
    "discrete": {name: {"t", "k"} for name in ("Phi", "Qd", "offset", "B", "u", "H", "D", "measurement_offset", "R")},
}
#: The matrices whose elements may name columns of a record (regressors); what belongs to a measurement, element by element.
BY_ROW = ("H", "R", "D", "measurement_offset", "B")
MEASURED = ("H", "R", "D", "measurement_offset")


class Instant(NamedTuple):
    """An index and the time that belongs to it."""

    k: int
    t: float

    def __str__(self) -> str:
        return f"at k = {self.k}, t = {moment(self.t)} s"


@dataclass(frozen=True, eq=False)
class Instants(Sequence[Instant]):
    """Instants that are made when they are asked for: ``t`` (instants,), s, the first with the index ``begin``."""

    t: Array
    begin: int = 0

    def __len__(self) -> int:
        return len(self.t)

    @overload
    def __getitem__(self, index: int) -> Instant: ...
    @overload
    def __getitem__(self, index: slice) -> Instants: ...
    def __getitem__(self, index: int | slice) -> Instant | Instants:
        """One, or those of a slice without a step."""
        if isinstance(index, slice):
            start, stop, _step = index.indices(len(self))
            return Instants(self.t[start:stop], self.begin + start)
        k = range(len(self))[index]
        return Instant(self.begin + k, float(self.t[k]))


class Regressors(NamedTuple):
    """Columns of a record by instants.

    ``values`` {name: (steps+1,)}, NaN where there is none · ``lines`` (steps+1,), where they stand, 0 without a row · ``source``, the file
    """

    values: Mapping[str, Array]
    lines: Array
    source: str

    def place(self, k: int) -> str:
        """Where an instant is in the file."""
        return f"{self.source}: line {self.lines[k]}" if self.lines[k] else f"{self.source}: k = {k}, which has no row"

    def continued(self, steps: int, constants: Mapping[str, float]) -> Regressors:
        """The same over so many further instants, at which the constants of these names stand in."""
        values = {name: np.concatenate([own, np.full(steps, constants[name])]) for name, own in self.values.items()}
        return Regressors(values, np.concatenate([self.lines, np.zeros(steps, dtype=self.lines.dtype)]), self.source)


class Sizes(NamedTuple):
    """States, measurements, noises (of a continuous model), known inputs."""

    n: int
    m: int
    s: int
    r: int


@dataclass(frozen=True)
class Values:
    """A document and the values of its constants."""

    document: Document
    constants: Mapping[str, float]
    file: str = ""
    regressors: Regressors | None = None

    def given(self, name: str) -> bool:
        """Whether the file has this matrix."""
        return getattr(self.document.model, name, None) is not None

    def varies(self, name: str) -> bool:
        """Whether a matrix depends on t or k, or on a regressor."""
        return self.in_time(name) or self.by_row(name)

    def in_time(self, name: str) -> bool:
        """Whether a matrix depends on t or k."""
        return self.given(name) and any(not cell.constant for _, cell in self.cells(name))

    def by_row(self, name: str) -> bool:
        """Whether an element of a matrix names a regressor."""
        return self.given(name) and any(self.named(cell) for _, cell in self.cells(name))

    def named(self, cell: Expression) -> frozenset[str]:
        """The regressors in a cell, but for those in whose place a constant stands, as no record has them."""
        return cell.names & self._columns

    @cached_property
    def _columns(self) -> frozenset[str]:
        told = {} if self.regressors is None else self.regressors.values
        return frozenset(name for name in self.document.data.regressors if name in told or name not in self.document.constants)

    def cells(self, name: str) -> Iterator[tuple[tuple[int, ...], Expression]]:
        """The cells of a matrix, a vector or a number, with their indices."""
        return leaves(getattr(self.document.model, name))

    def constant(self, name: str) -> Array:
        """A matrix that does not vary."""
        return self._filled(name, self.cells(name))

    def function(self, name: str) -> Callable[[Instant], Array]:
        """A matrix as a function of the instant; only what varies is computed again."""
        cells = list(self.cells(name))
        moving = [(index, cell) for index, cell in cells if not cell.constant or self.named(cell)]
        still = self._filled(name, [(index, cell) for index, cell in cells if cell.constant and not self.named(cell)])
        allowed = VARYING[self.document.kind].get(name, set())

        def at(instant: Instant) -> Array:
            result = still.copy()
            variables = {"t": instant.t, "k": float(instant.k)}
            names = {**self.constants, **{letter: variables[letter] for letter in allowed}}
            for index, cell in moving:
                own = self._row(name, index, cell, instant.k)
                if any(math.isnan(value) for value in own.values()):
                    continue  # not measured there: see absent
                try:
                    result[index] = cell.value({**names, **own})
                except ExpressionError as error:
                    where = self.regressors.place(instant.k) if own and self.regressors else str(instant)
                    raise self.error(("model", name, *index), f"{where}: {error}") from None
            return result

        return at if moving else lambda _: still

    def _row(self, name: str, index: tuple[int, ...], cell: Expression, k: int) -> dict[str, float]:
        """The regressors of a cell at an instant."""
        names = self.named(cell)
        if not names:
            return {}
        if self.regressors is None:
            raise self.without_record(("model", name, *index), min(names))
        return {each: float(self.regressors.values[each][k]) for each in names}

    def without_record(self, path: Path, regressor: str) -> ModelFileError:
        """What a regressor asks for."""
        text = (
            f'expected a record with "{regressor}", a regressor, received none: filter, fit and forecast read one; '
            f"to do without, let a constant stand in for it, {regressor} = VALUE under [constants] (--set {regressor}=VALUE "
            "then changes it)"
        )
        return self.error(path, text)

    def at(self, name: str, instant: Instant) -> Array:
        """A matrix at an instant."""
        return self.function(name)(instant)

    def stack(self, name: str, instants: Iterable[Instant]) -> Array:
        """A matrix at many instants, (instants, rows, columns)."""
        instants = list(instants)
        quick = self._quickly(name, [instant.k for instant in instants]) if self.by_row(name) else None
        return np.array(list(map(self.function(name), instants))) if quick is None else quick

    def _quickly(self, name: str, k: list[int]) -> Array | None:
        """A matrix whose elements name regressors, with one operation for all instants; None where an element has t, k or no value."""
        if self.regressors is None or self.in_time(name):
            return None
        cells = list(self.cells(name))
        result = np.empty((len(k), *self.shape(name)))
        result[:] = self._filled(name, [(index, cell) for index, cell in cells if not self.named(cell)])
        for index, cell in cells:
            if names := self.named(cell):
                rows = {each: np.asarray(self.regressors.values[each])[k] for each in names}
                there = np.isfinite(list(rows.values())).all(axis=0)
                values = cell.many({**self.constants, **{each: row[there] for each, row in rows.items()}})
                if values is None:
                    return None
                result[(there, *index)] = values
        return result

    def absent(self, count: int) -> NDArray[np.bool_]:
        """The elements of z, (count, m), that cannot be used, as a regressor beside them has no value."""
        mask = np.zeros((count, self.sizes.m), dtype=bool)
        for name in MEASURED if self.regressors is not None else ():
            for index, cell in self.cells(name) if self.given(name) else ():
                for each in self.named(cell):
                    assert self.regressors is not None
                    lacks = np.isnan(self.regressors.values[each])
                    for i in index if name == "R" else index[:1]:
                        mask[lacks, i] = True
        return mask

    def shape(self, name: str) -> tuple[int, ...]:
        """The shape of a matrix."""
        value = getattr(self.document.model, name)
        if isinstance(value, Expression):
            return ()
        return (len(value), len(value[0])) if value and isinstance(value[0], tuple) else (len(value),)

    @cached_property
    def dt(self) -> float:
        """The period, s."""
        return float(self.constant("dt"))

    @cached_property
    def t0(self) -> float:
        """The initial instant, s."""
        try:
            return self.document.experiment.t0.value(self.constants)
        except ExpressionError as error:
            raise self.error(("experiment", "t0"), str(error)) from None

    @cached_property
    def sizes(self) -> Sizes:
        """How many of everything; the sizes of a checked document are consistent."""
        model: Any = self.document.model
        s = len(model.Q) if self.document.kind == "continuous" else 0
        r = next((len(matrix[0]) for matrix in (model.B, model.D) if matrix is not None), 0)
        return Sizes(len(model.P0), len(model.H), s, r)

    def error(self, path: Path, message: str) -> ModelFileError:
        """An error at a place of this file."""
        return ModelFileError(Problem(place(path), message), self.file)

    def _filled(self, name: str, cells: Iterable[tuple[tuple[int, ...], Expression]]) -> Array:
        result = np.zeros(self.shape(name))
        for index, cell in cells:
            try:
                result[index] = cell.value(self.constants)
            except ExpressionError as error:
                raise self.error(("model", name, *index), str(error)) from None
        return result


def leaves(value: Any, index: tuple[int, ...] = ()) -> Iterator[tuple[tuple[int, ...], Expression]]:
    """The expressions in nested lists, with their indices."""
    if isinstance(value, Expression):
        yield index, value
        return
    for i, item in enumerate(value):
        yield from leaves(item, (*index, i))
