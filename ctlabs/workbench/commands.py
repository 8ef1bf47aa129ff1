"""What a person does to a model: typed commands. What each of them does: :func:`ctlabs.workbench.applying.apply`.

A command that is impossible raises ``ValueError`` in one line; a value that is wrong (an unknown name in a cell) is not
impossible: it stays where it was typed, and the file tells what is wrong with it (:meth:`ctlabs.files.modelfile.ModelFile.problems`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

from ctlabs.files.modelfile.errors import Path
from ctlabs.workbench.blocks import InsertBlock as InsertBlock


@dataclass(frozen=True, slots=True)
class Open:
    """Put another model in the place of this one: the text of a file, from the gallery or from a disk."""

    text: str
    name: str = ""


@dataclass(frozen=True, slots=True)
class New:
    """Begin a model of n states, s noises (of a continuous one), m measurements."""

    n: int = 2
    s: int = 1
    m: int = 1
    kind: str = "continuous"


@dataclass(frozen=True, slots=True)
class EditCell:
    """Type into a cell: ("model", "F", 0, 1), ("model", "x0", 0), ("model", "dt"), ("constants", "q"), ("title",)."""

    path: Path
    text: str


@dataclass(frozen=True, slots=True)
class EditCells:
    """Type into many cells of [model] at once: a pasted block, both sides of a symmetric matrix."""

    cells: tuple[tuple[Path, str], ...]


@dataclass(frozen=True, slots=True)
class Rewrite:
    """Another text of the whole file, as it was typed."""

    text: str


@dataclass(frozen=True, slots=True)
class AddState:
    """One more state, a constant that nothing drives or measures yet."""

    name: str = ""
    unit: str = ""


@dataclass(frozen=True, slots=True)
class RemoveState:
    """Without a state: its rows, columns, name and unit."""

    index: int


@dataclass(frozen=True, slots=True)
class AddNoise:
    """One more noise of a continuous model."""


@dataclass(frozen=True, slots=True)
class RemoveNoise:
    """Without a noise of a continuous model."""

    index: int


@dataclass(frozen=True, slots=True)
class AddMeasurement:
    """One more measurement, which no state enters yet."""

    name: str = ""
    unit: str = ""


@dataclass(frozen=True, slots=True)
class RemoveMeasurement:
    """Without a measurement: its rows, columns, name and unit."""

    index: int


@dataclass(frozen=True, slots=True)
class NameState:
    """Name and unit of a state."""

    index: int
    name: str
    unit: str = ""


@dataclass(frozen=True, slots=True)
class NameMeasurement:
    """Name and unit of a measurement."""

    index: int
    name: str
    unit: str = ""


@dataclass(frozen=True, slots=True)
class AddConstant:
    """A new constant."""

    name: str
    expression: str = "1"


@dataclass(frozen=True, slots=True)
class SetConstant:
    """Another number or expression for a constant."""

    name: str
    expression: str


@dataclass(frozen=True, slots=True)
class RenameConstant:
    """Another name for a constant, in all expressions too."""

    name: str
    other: str


@dataclass(frozen=True, slots=True)
class RemoveConstant:
    """Without a constant that nothing refers to."""

    name: str


@dataclass(frozen=True, slots=True)
class SetRange:
    """The range of a constant's slider: numbers or expressions; empty for none."""

    name: str
    min: str = ""
    max: str = ""


@dataclass(frozen=True, slots=True)
class Describe:
    """Unit and meaning of a constant."""

    name: str
    unit: str = ""
    meaning: str = ""


@dataclass(frozen=True, slots=True)
class SetTitle:
    """Another title."""

    title: str


@dataclass(frozen=True, slots=True)
class SetDt:
    """Another period, s."""

    text: str


@dataclass(frozen=True, slots=True)
class SetKind:
    """The same model in the other time; its matrices become numbers.

    A continuous model becomes its samples. A discrete one becomes the continuous model with those samples, where there is one.
    """

    kind: str


@dataclass(frozen=True, slots=True)
class SetExperiment:
    """A setting of [experiment]: t0 (a text), first, steps, runs, seed, or algorithms (a list of names)."""

    key: str
    value: Any


#: Parts of a model that may be there or not. u comes with its matrix B; R and Rc take each other's place.
Part: TypeAlias = Literal["u", "N", "offset", "x0", "R", "Rc"]


@dataclass(frozen=True, slots=True)
class AddPart:
    """A part that a model may have: a known input "u" (or one more), "N", "offset" (discrete), "x0", "Rc" instead of "R" or "R" of "Rc"."""

    name: Part


@dataclass(frozen=True, slots=True)
class RemovePart:
    """Without a part that a model need not have."""

    name: Part


Command: TypeAlias = (
    Open | New | EditCell | EditCells | Rewrite
    | AddState | RemoveState | AddNoise | RemoveNoise | AddMeasurement | RemoveMeasurement | NameState
    | NameMeasurement | AddConstant | SetConstant | RenameConstant | RemoveConstant | SetRange | Describe | SetTitle | SetDt
    | SetKind | SetExperiment | AddPart | RemovePart | InsertBlock
)  # fmt: skip
