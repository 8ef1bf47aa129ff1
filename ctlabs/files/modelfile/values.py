"""The numbers of a model file: its matrices at a time, or at many times."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, overload

import numpy as np

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
        "R": {"t", "k"},
    },
    "discrete": {name: {"t", "k"} for name in ("Phi", "Qd", "offset", "B", "u", "H", "R")},
}


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

    def given(self, name: str) -> bool:
        """Whether the file has this matrix."""
        return getattr(self.document.model, name, None) is not None

    def varies(self, name: str) -> bool:
        """Whether a matrix depends on t or k."""
        return self.given(name) and any(not cell.constant for _, cell in self.cells(name))

    def cells(self, name: str) -> Iterator[tuple[tuple[int, ...], Expression]]:
        """The cells of a matrix, a vector or a number, with their indices."""
        return _leaves(getattr(self.document.model, name), ())

    def constant(self, name: str) -> Array:
        """A matrix that does not vary."""
        return self._filled(name, self.cells(name))

    def function(self, name: str) -> Callable[[Instant], Array]:
        """A matrix as a function of the instant; only what varies is computed again."""
        cells = list(self.cells(name))
        moving = [(index, cell) for index, cell in cells if not cell.constant]
        still = self._filled(name, [pair for pair in cells if pair[1].constant])
        allowed = VARYING[self.document.kind].get(name, set())

        def at(instant: Instant) -> Array:
            result = still.copy()
            variables = {"t": instant.t, "k": float(instant.k)}
            names = {**self.constants, **{letter: variables[letter] for letter in allowed}}
            for index, cell in moving:
                try:
                    result[index] = cell.value(names)
                except ExpressionError as error:
                    raise self.error(("model", name, *index), f"{instant}: {error}") from None
            return result

        return at if moving else lambda _: still

    def at(self, name: str, instant: Instant) -> Array:
        """A matrix at an instant."""
        return self.function(name)(instant)

    def stack(self, name: str, instants: Iterable[Instant]) -> Array:
        """A matrix at many instants, (instants, rows, columns)."""
        return np.array(list(map(self.function(name), instants)))

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
        return Sizes(len(model.P0), len(model.H), s, len(model.B[0]) if model.B is not None else 0)

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


def _leaves(value: Any, index: tuple[int, ...]) -> Iterator[tuple[tuple[int, ...], Expression]]:
    if isinstance(value, Expression):
        yield index, value
        return
    for i, item in enumerate(value):
        yield from _leaves(item, (*index, i))
