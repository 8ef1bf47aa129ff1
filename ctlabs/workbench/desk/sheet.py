r"""A model file as a page shows it: grids of cells with their values and problems, constants, and equations.

Everything here works for a file that is wrong in any way: what cannot be told is ``None`` and the problem says why.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from ctlabs.files.modelfile import ModelFile
from ctlabs.files.modelfile.checks import SHAPES, TEXTS, WEIGHTS
from ctlabs.files.modelfile.errors import Path, place
from ctlabs.files.modelfile.expressions import Expression, ExpressionError, parse, values
from ctlabs.files.modelfile.values import VARYING
from ctlabs.text import latex_number

#: Matrices with more rows or columns are shown by their size in equations.
LARGEST = 8
#: How a part is written in an equation, where its name is not its letter.
LETTERS = {"Phi": r"\Phi", "Qd": "Q_d", "Rc": "R_c", "x0": "x_0", "P0": "P_0", "offset": "c"}
#: The order in which parts are shown.
ORDER = ("F", "G", "Q", "Phi", "Qd", "B", "u", "offset", "H", "R", "Rc", "N", "x0", "P0")


@dataclass(frozen=True, slots=True)
class Cell:
    """One cell: its ``path`` in the file, its ``text`` as typed, its ``value`` (at the first measurement, where it ``varies``
    with t or k; ``None`` where it has none), and the ``problem`` with it.
    """

    path: Path
    text: str
    value: float | None = None
    problem: str | None = None
    varies: bool = False


@dataclass(frozen=True, slots=True)
class Grid:
    """A matrix, or a vector as one column.

    ``rows`` of cells · ``row_names``, ``column_names`` · ``problem`` of the whole · ``given``, whether it stands in the file (x0
    is shown as zeros when it does not)
    """

    name: str
    rows: tuple[tuple[Cell, ...], ...]
    row_names: tuple[str, ...]
    column_names: tuple[str, ...]
    problem: str | None = None
    vector: bool = False
    given: bool = True


@dataclass(frozen=True, slots=True)
class ConstantRow:
    """A constant: its cell, the texts and values of its range, unit, meaning; ``used``, whether something refers to it."""

    name: str
    cell: Cell
    min_text: str = ""
    max_text: str = ""
    min: float | None = None
    max: float | None = None
    unit: str = ""
    meaning: str = ""
    used: bool = False


class ModelSheet:
    """A file, ready to be shown. Made anew for every text; all parts are computed when they are first asked for."""

    def __init__(self, file: ModelFile) -> None:
        self.file = file
        self.data = file.contents

    @cached_property
    def problems(self) -> dict[str, str]:
        """What is wrong, by place ("model.F[0][1]", "constants.q", "" for the whole file)."""
        found: dict[str, str] = {}
        for problem in self.file.problems():
            found[problem.where] = (
                f"{found[problem.where]}; {problem.message}" if problem.where in found else problem.message
            )
        return found

    @property
    def title(self) -> str:
        """The title; empty where there is none."""
        return self._text(self.data.get("title"))

    @property
    def description(self) -> str:
        """What the model is."""
        return self._text(self.data.get("description"))

    @property
    def source(self) -> str:
        """Where it comes from."""
        return self._text(self.data.get("source"))

    @property
    def kind(self) -> str:
        """"continuous" or "discrete"; empty where the file does not say."""  # fmt: skip
        found = self.data.get("kind")
        return found if found in SHAPES else ""

    @cached_property
    def sizes(self) -> dict[str, int]:
        """How many states n, measurements m, noises s, inputs r, as far as the file says."""
        return {
            "n": len(self._rows("P0") or self._rows("F") or self._rows("Phi")),
            "m": len(self._rows("H")),
            "s": len(self._rows("Q")) if self.kind == "continuous" else 0,
            "r": len(self._rows("u")) or max((len(row) for row in self._rows("B") if isinstance(row, list)), default=0),
        }

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states."""
        return self._names("states", "x", "n")

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the states."""
        return self._names("units", "", "n")

    @property
    def measurements(self) -> tuple[str, ...]:
        """Names of the measurements."""
        return self._names("measurements", "z", "m")

    @property
    def measurement_units(self) -> tuple[str, ...]:
        """Units of the measurements."""
        return self._names("measurement_units", "", "m")

    @cached_property
    def grids(self) -> dict[str, Grid]:
        """All matrices and vectors, in the order in which they are shown."""
        allowed = SHAPES.get(self.kind, {})
        names = [name for name in ORDER if name in allowed and (name in self._model or name == "x0")]
        return {name: self._grid(name) for name in names}

    @property
    def dt(self) -> Cell:
        """The period."""
        return self._cell(("model", "dt"), self._model.get("dt", ""))

    @cached_property
    def constants(self) -> tuple[ConstantRow, ...]:
        """The constants in their order."""
        from ctlabs.files.modelfile.edits import users

        rows = []
        for name, told in self._constants.items():
            table = told if isinstance(told, dict) else {"value": told}
            low, high = (self._cell(("constants", name, key), table.get(key, "")) for key in ("min", "max"))
            path: Path = ("constants", name)
            cell = self._cell(path, table.get("value", ""))
            inner = self.problems.get(place((*path, "value")))
            problem = "; ".join(p for p in (cell.problem, inner, low.problem, high.problem) if p) or None
            cell = Cell(path, cell.text, self._values.get(name), problem)
            used = any(user[:2] != path for user, _ in users(self.data, name))
            rows.append(
                ConstantRow(name, cell, low.text, high.text, low.value, high.value,
                            self._text(table.get("unit")), self._text(table.get("meaning")), used)
            )  # fmt: skip
        return tuple(rows)

    @property
    def experiment(self) -> dict[str, Any]:
        """t0 (text), first, steps, runs, seed, algorithms, with their defaults."""
        defaults = {"t0": 0, "first": 1, "steps": 200, "runs": 1000, "seed": 1, "algorithms": ["joseph"]}
        found = self.data.get("experiment")
        told = {**defaults, **(found if isinstance(found, dict) else {})}
        return {**told, "t0": _written(told["t0"])}

    @property
    def missing_parts(self) -> tuple[str, ...]:
        """Parts that could be added (:class:`ctlabs.workbench.desk.commands.AddPart`); one more known input always can, unless a
        regulator makes the inputs.
        """
        known = () if "cost" in self.data else ("u",)
        if self.kind == "continuous":
            names = ("N", "Rc") if "R" in self._model else ("N", "R")
            rest = tuple(name for name in names if name not in self._model and not (name == "N" and "Rc" not in self._model))
        else:
            rest = tuple(name for name in ("N", "offset") if name not in self._model)
        return known + rest

    @cached_property
    def weights(self) -> dict[str, Grid]:
        """The matrices of weights in [cost], as far as they are there."""
        told = self.data.get("cost")
        told = told if isinstance(told, dict) else {}
        names = {"n": self.states, "r": self.inputs, "m": self.measurements}
        found = {}
        for name, shape in WEIGHTS.items():
            if isinstance(told.get(name), list):
                found[name] = self._matrix_of(("cost", name), told[name], names[shape[0]], names[shape[1]])
        return found

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        r = self.sizes["r"]
        told = self.data.get("data")
        named = told.get("inputs") if isinstance(told, dict) else None
        if isinstance(named, list) and len(named) == r:
            return tuple(map(self._text, named))
        return ("u",) if r == 1 else _numbered("u", r)

    def shown(self, path: Path) -> Cell:
        """The cell at a path of the file; its text is empty where there is nothing."""
        item: Any = self.data
        for key in path:
            try:
                item = item[key]
            except (KeyError, IndexError, TypeError):
                item = ""
                break
        if len(path) == 2 and path[0] == "constants":
            return next((row.cell for row in self.constants if row.name == path[1]), Cell(tuple(path), ""))
        if (path[:1] == ("model",) and len(path) > 1 and path[1] in TEXTS) or path in {("title",), ("description",)}:
            return Cell(tuple(path), self._text(item), None, self.problems.get(place(path)))
        return self._cell(tuple(path), item)

    # Equations -------------------------------------------------------------------------------------------------------

    def equations(self) -> list[str]:
        r"""The model in LaTeX with its numbers in, line by line; what varies with t or k stays an expression."""
        return self._lines(self._number)

    def statement(self) -> list[str]:
        r"""The model in LaTeX as it was typed."""
        return self._lines(self._symbol)

    def _lines(self, inside: Any) -> list[str]:
        has = self._model.__contains__

        def part(name: str) -> str:
            return self._matrix(name, inside)

        if self.kind == "continuous":
            drive = (rf" + {part('B')}\,u" if has("B") else "") + rf" + {part('G')}\,w"
            lines = [rf"\dot x = {part('F')}\,x{drive}"]
            if has("u"):
                lines.append(rf"u = {part('u')}")
            lines.append(rf"E[w(t)w(\tau)^T] = {part('Q')}\,\delta(t-\tau)")
        elif self.kind == "discrete":
            drive = (rf" + {part('B')}\,u_k" if has("B") else "") + (
                f" + {part('offset')}" if has("offset") else ""
            )
            lines = [rf"x_{{k+1}} = {part('Phi')}\,x_k{drive} + w_k"]
            if has("u"):
                lines.append(rf"u_k = {part('u')}")
            lines.append(rf"E[w_kw_k^T] = {part('Qd')}")
        else:
            return []
        if has("Rc"):
            lines += [rf"z = {part('H')}\,x + v", rf"E[v(t)v(\tau)^T] = {part('Rc')}\,\delta(t-\tau)"]
        else:
            lines += [rf"z_k = {part('H')}\,x_k + v_k", rf"E[v_kv_k^T] = {part('R')}"]
        if has("N"):
            lines.append(rf"E[wv^T] = {part('N')}")
        lines.append(rf"x_0 \sim N\left({part('x0')},\ {part('P0')}\right)")
        return lines

    def _matrix(self, name: str, inside: Any) -> str:
        grid = self.grids.get(name)
        if grid is None or not grid.rows:
            return r"\square"
        rows, columns = len(grid.rows), max(len(row) for row in grid.rows)
        if max(rows, columns) > LARGEST:
            return rf"\underbrace{{{LETTERS.get(name, name)}}}_{{{rows}\times {columns}}}"
        texts = [[inside(cell) for cell in row] for row in grid.rows]
        if rows == columns == 1:
            return (
                texts[0][0] if inside == self._number or _atom(grid.rows[0][0].text) else rf"\left({texts[0][0]}\right)"
            )
        return r"\begin{bmatrix} " + r" \\ ".join(" & ".join(row) for row in texts) + r" \end{bmatrix}"

    def _number(self, cell: Cell) -> str:
        if cell.varies or cell.value is None:
            return self._symbol(cell)
        return latex_number(cell.value)

    def _symbol(self, cell: Cell) -> str:
        try:
            return parse(cell.text).latex()
        except ExpressionError:
            return r"\square"

    # Within ----------------------------------------------------------------------------------------------------------

    @property
    def _model(self) -> Mapping[str, Any]:
        found = self.data.get("model")
        return found if isinstance(found, dict) else {}

    @property
    def _constants(self) -> Mapping[str, Any]:
        found = self.data.get("constants")
        return found if isinstance(found, dict) else {}

    @cached_property
    def _values(self) -> dict[str, float]:
        """The values of the constants that have one."""
        definitions: dict[str, Expression] = {}
        for name, told in self._constants.items():
            try:
                definitions[name] = parse(told.get("value") if isinstance(told, dict) else told)
            except ExpressionError:
                continue
        return values(definitions)[0]

    @cached_property
    def _moving(self) -> dict[str, float]:
        """t and k of the first measurement."""
        first = self.experiment["first"]
        k = float(first) if isinstance(first, int) else 1.0
        t0, dt = (self._value(text, ()) for text in (self.experiment["t0"], _written(self._model.get("dt", ""))))
        return {"k": k, "t": (t0 or 0.0) + k * (dt or 0.0)}

    def _value(self, text: Any, letters: Sequence[str]) -> float | None:
        try:
            moving = {letter: self._moving[letter] for letter in letters} if letters else {}
            return parse(text).value({**self._values, **moving})
        except ExpressionError:
            return None

    def _cell(self, path: Path, item: Any) -> Cell:
        text, problem = _written(item), self.problems.get(place(path))
        if isinstance(item, int | float) and not isinstance(item, bool):
            return Cell(path, text, float(item), problem)
        if text == "":
            return Cell(path, text, None, problem)
        letters = sorted(VARYING.get(self.kind, {}).get(str(path[1]) if len(path) > 1 else "", set()))
        try:
            expression = parse(item)
        except ExpressionError:
            return Cell(path, text, None, problem)
        varies = bool(letters) and not expression.constant
        return Cell(path, text, self._value(item, letters if varies else ()), problem, varies)

    def _rows(self, name: str) -> list[Any]:
        found = self._model.get(name)
        return found if isinstance(found, list) else []

    def _grid(self, name: str) -> Grid:
        shape, path = SHAPES[self.kind][name], ("model", name)
        names = {
            "n": self.states,
            "m": self.measurements,
            "s": _numbered("w", self.sizes["s"]),
            "r": _numbered("u", self.sizes["r"]),
        }
        given = name in self._model
        if len(shape) == 2:
            return self._matrix_of(path, self._rows(name), names[shape[0]], names[shape[1]])
        cells = enumerate(self._rows(name) if given else [0] * self.sizes["n"])
        rows = tuple((self._cell((*path, i), item),) for i, item in cells)
        return Grid(name, rows, names[shape[0]], (), self.problems.get(place(path)), vector=True, given=given)

    def _matrix_of(self, path: Path, told: list[Any], row_names: tuple[str, ...], column_names: tuple[str, ...]) -> Grid:
        """A matrix at a place of the file."""
        rows = tuple(
            tuple(self._cell((*path, i, j), item) for j, item in enumerate(row)) for i, row in enumerate(told) if isinstance(row, list)
        )
        problems = [self.problems.get(place(path)), *(self.problems.get(place((*path, i))) for i in range(len(rows)))]
        return Grid(str(path[-1]), rows, row_names, column_names, "; ".join(found for found in problems if found) or None)

    def _names(self, key: str, letter: str, size: str) -> tuple[str, ...]:
        count, found = self.sizes[size], [self._text(item) for item in self._rows(key)]
        default = _numbered(letter, count) if letter else ("",) * count
        return tuple(found[i] if i < len(found) else default[i] for i in range(count))

    def _text(self, item: Any) -> str:
        return item if isinstance(item, str) else ""


def _numbered(letter: str, count: int) -> tuple[str, ...]:
    return tuple(f"{letter}{i + 1}" for i in range(count))


def _written(item: Any) -> str:
    """An item of the file as the text of a cell."""
    if isinstance(item, str):
        return item
    return (
        repr(item) if isinstance(item, int | float) and not isinstance(item, bool) else "" if item == "" else str(item)
    )


def _atom(text: str) -> bool:
    return text.replace("_", "").replace(".", "").isalnum()
