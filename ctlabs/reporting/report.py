"""A report of a lab or a study: text, equations, tables, figures, values and checks, in the order of its parts.

A :class:`Report` knows nothing of files; :mod:`ctlabs.reporting.render` writes it. A check always compares two *different* routes
to the same number; its kind is one of the four tolerances (EXACT, SOLVER, ORDER, CHANCE).
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from numpy.typing import ArrayLike

from ctlabs.reporting.agreement import DIGITS, ROUNDING, compared, known, numbers
from ctlabs.reporting.params import plain
from ctlabs.reporting.wording import in_words_of_the_reader
from ctlabs.text import fill, latex_matrix, text, translated

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ctlabs.reporting.drawing import Drawing

#: Algebra: the same numbers by two formulas.
EXACT = 1e-12
#: A Riccati or Lyapunov solver, an integrator or a limit against a closed form.
SOLVER = 1e-8
KINDS = {EXACT: "EXACT", SOLVER: "SOLVER"}


@dataclass(frozen=True, slots=True)
class Text:
    """A paragraph in Markdown with LaTeX between dollar signs."""

    text: str


@dataclass(frozen=True, slots=True)
class Equation:
    """A displayed equation that the text refers to, by its number."""

    name: str
    latex: str
    number: int


@dataclass(frozen=True, slots=True)
class Copy:
    """A small copy of a figure of the report, beside its result."""

    name: str


@dataclass(frozen=True, slots=True)
class Heading:
    """A heading; ``part`` is the sheet's letter where the section answers one, ``name`` what a text calls it by."""

    text: str
    level: int
    part: str | None = None
    name: str = ""


@dataclass(frozen=True, slots=True)
class Table:
    """A table, also written as CSV; cells are numbers, words or lists."""

    name: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]
    caption: str
    number: int


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure and its caption."""

    name: str
    figure: Drawing | Figure
    caption: str
    number: int


@dataclass(frozen=True, slots=True)
class Value:
    """A number the sheet asks for; ``at`` are the times of a list, ``reason`` says why a value is null, ``symbol`` is its letter."""

    name: str
    value: Any
    unit: str
    part: str
    at: tuple[float, ...] | None = None
    reason: str = ""
    symbol: str = ""


@dataclass(frozen=True, slots=True)
class Check:
    """Two routes to one number, or to many of which one stands for all, and their allowed difference.

    ``share`` : the largest difference of all elements, as a part of what each is measured by (of EXACT and SOLVER)
    """

    name: str
    part: str
    route: tuple[str, str]
    value: float | None
    expected: float | None
    tolerance: float
    kind: str
    passed: bool
    share: float = 0.0


Block = Text | Equation | Heading | Table | Picture | Copy | Value | Check


class Parameters(Protocol):
    """What a report was made with: a lab's parameters, or the constants and settings of a study."""

    def plain(self) -> dict[str, Any]:
        """The values by name, as JSON holds them."""

    def described(self) -> list[tuple[str, str, str]]:
        """Name, unit and meaning of each."""


class Chance(Protocol):
    """What an exact test of an ensemble says (:mod:`ctlabs.montecarlo.chance`)."""

    @property
    def value(self) -> float:
        """The worst deviation, as a normal quantile."""

    @property
    def critical(self) -> float:
        """Its bound."""

    @property
    def passed(self) -> bool:
        """Whether it is within the bound."""


@dataclass
class Report:
    """The report of one lab, or of one study of somebody's own model and data.

    Parameters
    ----------
    meta : the lab's META (name, title, source, parts)
    parameters : the lab's parameters
    runs, seed : of the computational experiment; no runs where there is none
    files : further files of the report's folder, by name
    more : what ``results.json`` holds besides parameters, values and checks
    framed : whether it is a lab's, whose values by their machine names stand in the appendix
    listing : the script in the appendix
    bibliography : what ``{ref:key}`` in a text refers to, by key
    around : addresses of the pages before, above and after it, and their titles
    """

    meta: Mapping[str, Any]
    parameters: Parameters
    runs: int
    seed: int
    blocks: list[Block] = field(default_factory=list)
    part: str = ""
    files: dict[str, bytes] = field(default_factory=dict)
    more: dict[str, Any] = field(default_factory=dict)
    framed: bool = False
    listing: str = ""
    bibliography: Mapping[str, str] = field(default_factory=dict)
    around: Mapping[str, tuple[str, str]] = field(default_factory=dict)

    def heading(self, title: str, name: str = "") -> None:
        """Begin one of the report's large divisions (theory, plan, experiment, conclusions); ``{sec:name}`` refers to it."""
        self.blocks.append(Heading(translated(title), 2, name=name))

    def section(self, part: str, title: str) -> None:
        """Begin the answer to a lettered item of the sheet."""
        if part not in self.meta["parts"]:
            msg = f"section: expected one of the parts {self.meta['parts']}, received {part!r}"
            raise ValueError(msg)
        self.part = part
        self.blocks.append(Heading(translated(title), 3, part))

    def subsection(self, title: str, name: str) -> None:
        """Begin a smaller division that answers no lettered item; ``{sec:name}`` refers to it."""
        self.blocks.append(Heading(translated(title), 3, name=name))

    def says(self, /, *sentences: str, **values: object) -> None:
        """A paragraph; ``{name}`` is replaced by a value, with five significant digits, ``{name:3}`` with three.

        ``{fig:name}``, ``{tab:name}``, ``{eq:name}``, ``{part:b}``, ``{sec:plan}`` and ``{ref:key, p. 217}`` become the number
        of a figure, table, equation, section or reference, and a link to it.
        """
        self.blocks.append(Text(text(*sentences, **values)))

    def math(self, latex: str, name: str = "", /, **values: object) -> None:
        """A displayed equation; ``{name}`` is replaced by a number or matrix in LaTeX.

        With a ``name`` it has a number, and ``{eq:name}`` in a text refers to it.
        """
        shown = {key: v if isinstance(v, str) else latex_matrix(v) for key, v in values.items()}  # type: ignore[arg-type]  # numbers and arrays
        filled = fill(latex, **shown)
        if name:
            self._new(Equation, name)
            self.blocks.append(Equation(name, filled, 1 + self._count(Equation)))
        else:
            self.blocks.append(Text(f"$$\n{filled}\n$$"))

    def model(self, model: Any) -> None:
        """Every matrix of a model, as an equation."""
        self.blocks.append(Text(f"$$\n{model._repr_latex_().strip('$')}\n$$"))

    def items(self, lines: Iterable[str], /, **values: object) -> None:
        """A list of points, with placeholders as in :meth:`says`."""
        self.blocks.append(Text("\n".join(f"- {text(line, **values)}" for line in lines)))

    def table(
        self, name: str, columns: Sequence[str], rows: Iterable[Sequence[Any]], caption: str, /, **values: object
    ) -> None:
        """A table in the text and as ``tables/NAME.csv`` (there with full precision)."""
        self._new(Table, name)
        found = tuple(tuple(map(_cell, row)) for row in rows)
        for row in found:
            if len(row) != len(columns):
                msg = f"table {name}: expected {len(columns)} cells in a row, received {len(row)}"
                raise ValueError(msg)
        heads = tuple(map(translated, columns))
        self.blocks.append(Table(name, heads, found, text(caption, **values), 1 + self._count(Table)))

    def csv(self, name: str, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
        """A file ``NAME.csv`` beside the report, for other programs; NaN and None are empty cells."""
        file = io.StringIO()
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows([["" if cell is None or cell != cell else cell for cell in row] for row in rows])
        self.files[f"{name}.csv"] = file.getvalue().encode()

    def figure(self, name: str, figure: Drawing | Figure, caption: str, /, **values: object) -> None:
        """A figure and a caption that says what it shows."""
        self._new(Picture, name)
        shown = in_words_of_the_reader(figure)
        self.blocks.append(Picture(name, shown, text(caption, **values), 1 + self._count(Picture)))

    def value(
        self,
        name: str,
        value: Any,
        unit: str = "1",
        *,
        at: Sequence[float] | None = None,
        reason: str = "",
        symbol: str = "",
        agrees: Mapping[str, Any] | None = None,
        routes: tuple[str, str] = ("recursion", "closed form"),
        kind: float = SOLVER,
    ) -> None:
        r"""A value of the results, and with ``agrees`` the check that the sheet's own answer is the same number.

        ``at`` : times of a list · ``reason`` : why the value is null · ``symbol`` : its letter in LaTeX, such as ``\bar K``; a
        value that has one stands among the answers · ``agrees`` : answers by name, of another route
        """
        value = plain(value)
        self._new(Value, name)
        if _has_null(value) and not reason:
            msg = f"value {name}: expected a reason beside null, received none"
            raise ValueError(msg)
        when, why = None if at is None else tuple(map(float, at)), translated(reason) if _has_null(value) else ""
        self.blocks.append(Value(name, value, translated(unit), self.part, when, why, symbol))
        if agrees is not None:
            self.check(name.replace("_", " "), value, agrees[name], routes, kind)

    def check(
        self,
        name: str,
        value: Any,
        expected: Any,
        routes: tuple[str, str],
        kind: float = SOLVER,
        *,
        scale: ArrayLike | None = None,
    ) -> None:
        """Two routes agree, element by element.

        The difference allowed is ``kind`` times the expected element, in covariances times σ_iσ_j, so that the smallest
        variance is judged like the largest in whatever units. An expected 0 is measured by the largest element. Where
        elements pass through zero, ``scale`` (a number, or one for each element) says what they are measured by.
        """
        name, routes = translated(name), self._two(routes)
        if kind not in KINDS:
            msg = f"check {name}: expected the tolerance EXACT or SOLVER, received {kind}"
            raise ValueError(msg)
        found = compared(value, expected, scale, kind)
        passed = found.share <= kind
        self.blocks.append(
            Check(name, self.part, routes, found.value, found.expected, kind * found.size, KINDS[kind], passed, found.share)
        )

    def holds(self, name: str, margin: ArrayLike, routes: tuple[str, str], *, size: float) -> None:
        """An inequality between two routes: ``margin`` ≥ 0 everywhere, up to rounding (EXACT relative to ``size``)."""
        name, routes = translated(name), self._two(routes)
        least, limit = float(numbers(margin).min()), EXACT * size
        passed = least >= -limit
        self.blocks.append(Check(name, self.part, routes, 0.0 if passed else least, 0.0, limit, "EXACT", passed, ROUNDING))

    def chance(self, name: str, result: Chance, routes: tuple[str, str] = ("ensemble", "covariance theory")) -> None:
        """An ensemble agrees with theory: the worst deviation, in sigmas, is below what chance gives once in 10⁶."""
        name, routes = translated(name), self._two(routes)
        self.blocks.append(Check(name, self.part, routes, result.value, 0.0, result.critical, "CHANCE", result.passed))

    def order(
        self, name: str, errors: Sequence[float], expected: float, routes: tuple[str, str], *, within: float = 0.2
    ) -> None:
        """Errors for a period halved again and again shrink like 2^−expected (of the last pair)."""
        name, routes = translated(name), self._two(routes)
        found = math.log2(errors[-2] / errors[-1])
        self.blocks.append(
            Check(name, self.part, routes, found, expected, within, "ORDER", abs(found - expected) <= within)
        )

    @property
    def checks(self) -> list[Check]:
        """All checks, in order."""
        return [block for block in self.blocks if isinstance(block, Check)]

    @property
    def values(self) -> dict[str, Value]:
        """All values by name."""
        return {block.name: block for block in self.blocks if isinstance(block, Value)}

    @property
    def passed(self) -> bool:
        """Whether every check passed (a report without checks has not)."""
        return bool(self.checks) and all(check.passed for check in self.checks)

    def results(self) -> dict[str, Any]:
        """What ``results.json`` holds: numbers in the digits that are known on any machine."""
        values: dict[str, Any] = {}
        for value in self.values.values():
            values[value.name] = {"value": known(value.value), "unit": value.unit, "part": value.part}
            if value.at is not None:
                values[value.name]["at"] = list(value.at)
            if value.reason:
                values[value.name]["reason"] = value.reason
        return {
            "schema": 1,
            "lab": self.meta["name"],
            "title": self.meta["title"],
            "source": self.meta["source"],
            "seed": self.seed,
            "runs": self.runs,
            "parameters": self.parameters.plain(),
            "values": values,
            "checks": [
                {
                    "name": c.name, "part": c.part, "route": list(c.route), "value": _told(c), "expected": known(plain(c.expected)),
                    "tolerance": known(plain(c.tolerance)), "kind": c.kind, "passed": bool(c.passed),
                }
                for c in self.checks
            ],
            **self.more,
        }  # fmt: skip

    def _count(self, kind: type) -> int:
        return sum(isinstance(block, kind) for block in self.blocks)

    def _new(self, kind: type[Equation | Table | Picture | Value], name: str) -> None:
        if any(isinstance(block, kind) and block.name == name for block in self.blocks):
            msg = f"{kind.__name__.lower()} {name}: expected a new name, received one that is taken"
            raise ValueError(msg)

    def _two(self, routes: tuple[str, str]) -> tuple[str, str]:
        """The names of two routes, translated."""
        if len(set(routes)) != 2:
            msg = f"check: expected two different routes, received {routes}"
            raise ValueError(msg)
        return translated(routes[0]), translated(routes[1])


def _told(check: Check) -> Any:
    """The value of a check as it is written down; a random number's standard errors have five digits."""
    return known(plain(check.value), 5 if check.kind in {"CHANCE", "ORDER"} else DIGITS)


def _cell(cell: Any) -> Any:
    return translated(cell) if isinstance(cell, str) else cell


def _has_null(value: Any) -> bool:
    return any(map(_has_null, value)) if isinstance(value, list) else value is None
