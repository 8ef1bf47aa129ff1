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

import numpy as np
from numpy.typing import ArrayLike

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
class Heading:
    """A heading; ``part`` is the sheet's letter where the section answers one."""

    text: str
    level: int
    part: str | None = None


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
    """A number the sheet asks for; ``at`` are the times of a list, ``reason`` says why a value is null."""

    name: str
    value: Any
    unit: str
    part: str
    at: tuple[float, ...] | None = None
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Check:
    """Two routes to one number: ``value`` and ``expected`` of the worst element, and their allowed difference."""

    name: str
    part: str
    route: tuple[str, str]
    value: float | None
    expected: float | None
    tolerance: float
    kind: str
    passed: bool


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
    """

    meta: Mapping[str, Any]
    parameters: Parameters
    runs: int
    seed: int
    blocks: list[Text | Heading | Table | Picture | Value | Check] = field(default_factory=list)
    part: str = ""
    files: dict[str, bytes] = field(default_factory=dict)
    more: dict[str, Any] = field(default_factory=dict)

    def heading(self, title: str) -> None:
        """Begin one of the report's large divisions (analysis, plan, experiment, conclusions)."""
        self.blocks.append(Heading(translated(title), 2))

    def section(self, part: str, title: str) -> None:
        """Begin the answer to a lettered item of the sheet."""
        if part not in self.meta["parts"]:
            msg = f"section: expected one of the parts {self.meta['parts']}, received {part!r}"
            raise ValueError(msg)
        self.part = part
        self.blocks.append(Heading(translated(title), 3, part))

    def says(self, /, *sentences: str, **values: object) -> None:
        """A paragraph; ``{name}`` is replaced by a value, with five significant digits."""
        self.blocks.append(Text(text(*sentences, **values)))

    def math(self, latex: str, /, **values: object) -> None:
        """A displayed equation; ``{name}`` is replaced by a number or matrix in LaTeX."""
        shown = {name: v if isinstance(v, str) else latex_matrix(v) for name, v in values.items()}  # type: ignore[arg-type]  # numbers and arrays
        self.blocks.append(Text(f"$$\n{fill(latex, **shown)}\n$$"))

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
        agrees: Mapping[str, Any] | None = None,
        routes: tuple[str, str] = ("recursion", "closed form"),
        kind: float = SOLVER,
    ) -> None:
        """A value of the results, and with ``agrees`` the check that the sheet's own answer is the same number.

        ``at`` : times of a list · ``reason`` : why the value is null · ``agrees`` : answers by name, of another route
        """
        value = plain(value)
        self._new(Value, name)
        if _has_null(value) and not reason:
            msg = f"value {name}: expected a reason beside null, received none"
            raise ValueError(msg)
        when, why = None if at is None else tuple(map(float, at)), translated(reason) if _has_null(value) else ""
        self.blocks.append(Value(name, value, translated(unit), self.part, when, why))
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
        worst, reference, error, size = _worst(value, expected, scale)
        limit = kind * size
        self.blocks.append(Check(name, self.part, routes, worst, reference, limit, KINDS[kind], error <= limit))

    def holds(self, name: str, margin: ArrayLike, routes: tuple[str, str], *, size: float) -> None:
        """An inequality between two routes: ``margin`` ≥ 0 everywhere, up to rounding (EXACT relative to ``size``)."""
        name, routes = translated(name), self._two(routes)
        least = float(_numbers(margin).min())
        self.blocks.append(
            Check(name, self.part, routes, min(least, 0.0), 0.0, EXACT * size, "EXACT", least >= -EXACT * size)
        )

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
        """What ``results.json`` holds."""
        values: dict[str, Any] = {}
        for value in self.values.values():
            values[value.name] = {"value": value.value, "unit": value.unit, "part": value.part}
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
                    "name": c.name, "part": c.part, "route": list(c.route), "value": plain(c.value), "expected": plain(c.expected),
                    "tolerance": plain(c.tolerance), "kind": c.kind, "passed": bool(c.passed),
                }
                for c in self.checks
            ],
            **self.more,
        }  # fmt: skip

    def _count(self, kind: type) -> int:
        return sum(isinstance(block, kind) for block in self.blocks)

    def _new(self, kind: type[Table | Picture | Value], name: str) -> None:
        if any(isinstance(block, kind) and block.name == name for block in self.blocks):
            msg = f"{kind.__name__.lower()} {name}: expected a new name, received one that is taken"
            raise ValueError(msg)

    def _two(self, routes: tuple[str, str]) -> tuple[str, str]:
        """The names of two routes, translated."""
        if len(set(routes)) != 2:
            msg = f"check: expected two different routes, received {routes}"
            raise ValueError(msg)
        return translated(routes[0]), translated(routes[1])


def _worst(value: Any, expected: Any, scale: ArrayLike | None) -> tuple[float | None, float | None, float, float]:
    """The element that differs most in its own scale: value, expected, their difference, and that scale."""
    if value is None or expected is None:
        return (
            (None, None, 0.0, 1.0)
            if value is None and expected is None
            else (_scalar(value), _scalar(expected), math.inf, 1.0)
        )
    found, wanted = _numbers(value), _numbers(expected)
    if found.shape != wanted.shape:
        msg = f"check: expected two arrays of one shape, received {found.shape} and {wanted.shape}"
        raise ValueError(msg)
    if not found.size:
        msg = "check: expected at least one number, received none"
        raise ValueError(msg)
    same = (found == wanted) | (np.isnan(found) & np.isnan(wanted))
    with np.errstate(invalid="ignore"):
        difference = np.where(same, 0.0, np.abs(found - wanted))
    difference = np.where(np.isnan(difference), np.inf, difference)
    size = np.broadcast_to(_sizes(wanted) if scale is None else np.asarray(scale, dtype=np.float64), wanted.shape)
    share = np.divide(difference, size, out=np.where(difference > 0, np.inf, 0.0), where=size > 0)
    at = np.unravel_index(int(np.argmax(share)), difference.shape)
    return _known(found[at]), _known(wanted[at]), float(difference[at]), float(size[at])


def _sizes(wanted: np.ndarray[Any, np.dtype[np.float64]]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """What each element is measured by: σ_iσ_j in a covariance, otherwise its own size; the largest one's where that is 0."""
    finite = np.where(np.isfinite(wanted), np.abs(wanted), 0.0)
    size = finite
    if wanted.ndim >= 2 and wanted.shape[-1] == wanted.shape[-2] and np.array_equal(finite, np.swapaxes(finite, -1, -2)):
        sd = np.sqrt(np.diagonal(finite, axis1=-2, axis2=-1))
        both = sd[..., :, None] * sd[..., None, :]
        if (finite <= both * (1 + 1e-9)).all():
            size = both
    return np.where(size > 0, size, finite.max(initial=0.0) or 1.0)


def _cell(cell: Any) -> Any:
    return translated(cell) if isinstance(cell, str) else cell


def _known(element: float) -> float | None:
    return None if math.isnan(element) else float(element)


def _has_null(value: Any) -> bool:
    return any(map(_has_null, value)) if isinstance(value, list) else value is None


def _numbers(value: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Floats, with NaN for null (a NaN itself has been refused by ``plain``)."""
    return np.atleast_1d(np.array(_infinite(plain(value)), dtype=np.float64))


def _infinite(value: Any) -> Any:
    if isinstance(value, list):
        return [_infinite(item) for item in value]
    return float(value) if isinstance(value, str) else value


def _scalar(value: Any) -> float | None:
    return None if value is None else float(_numbers(value).ravel()[0])
