"""What a person does to a model: each command makes another model file of one; no page, no store, no state.

A command that is impossible raises ``ValueError`` in one line; a value that is wrong (an unknown name in a cell) is not
impossible: it stays where it was typed, and the file tells what is wrong with it (:meth:`ctlabs.files.modelfile.ModelFile.problems`).
A new command is a class with the method ``apply``; coloured noise is :class:`ctlabs.workbench.desk.blocks.InsertBlock`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, Protocol, TypeAlias

import numpy as np

from ctlabs.files.modelfile import ModelFile, loads, new
from ctlabs.files.modelfile.errors import Path, place, shown
from ctlabs.files.modelfile.schema import wrong_name
from ctlabs.workbench.desk.kinds import converted
from ctlabs.workbench.desk.plain import typed

#: The file after a command, and what was done, in a few words.
Done: TypeAlias = tuple[ModelFile, str]
#: What a model has several of, each with its rows and columns.
What: TypeAlias = Literal["state", "noise", "measurement"]
#: Parts of a model that may be there or not. u comes with its matrix B; R and Rc take each other's place.
Part: TypeAlias = Literal["u", "N", "offset", "x0", "R", "Rc"]

#: Lists of a model that are texts, and not expressions; names first, units second, by what they name.
LABELS = {"state": ("states", "units"), "measurement": ("measurements", "measurement_units")}
WORDS = {"title", "description", "source", "unit", "meaning", *LABELS["state"], *LABELS["measurement"]}
#: What may be told of a constant beside its value, in the order in which it is written.
TOLD = ("value", "min", "max", "unit", "meaning")


class Command(Protocol):
    """Anything that a person can do to a model."""

    def apply(self, file: ModelFile) -> Done:
        """Do it; ``ValueError`` in one line where it is impossible."""
        ...


def apply(file: ModelFile, command: Command) -> Done:
    """The file after a command, and what was done, in a few words.

    Raises
    ------
    ValueError
        The command is impossible; one line.

    >>> file, done = apply(new(2), EditCell(("model", "F", 1, 0), "-w^2"))
    >>> done, file.problems()[0].where
    ('F[1][0] = -w^2', 'model.F[1][0]')
    """
    made, done = command.apply(file)
    # What is written must be what is read: names do not go into the text, and the text is looked at from the beginning.
    return made if made.name == "" else loads(made.dumps(), "", check=False), done


@dataclass(frozen=True, slots=True)
class Open:
    """Put another model in the place of this one: the text of a file, from the gallery or from a disk."""

    text: str
    name: str = ""

    def apply(self, _file: ModelFile) -> Done:
        return loads(self.text, self.name, check=False), f"open {self.name or 'a file'}"


@dataclass(frozen=True, slots=True)
class New:
    """Begin a model of n states, s noises (of a continuous one), m measurements."""

    n: int = 2
    s: int = 1
    m: int = 1
    kind: str = "continuous"

    def apply(self, _file: ModelFile) -> Done:
        noises = f", {self.s} noises" if self.kind == "continuous" else ""
        label = f"new {self.kind} model: {self.n} states{noises}, {self.m} measurements"
        return new(self.n, self.s, self.m, self.kind), label


@dataclass(frozen=True, slots=True)
class EditCell:
    """Type into a cell: ("model", "F", 0, 1), ("model", "dt"), ("experiment", "t0"), ("title",), a constant ("constants", "q"), or
    what is told beside it ("constants", "q", "min"): a limit of its slider, its unit, its meaning, empty for none.
    """

    path: Path
    text: str

    def apply(self, file: ModelFile) -> Done:
        path = tuple(self.path)
        if path[:1] == ("constants",) and len(path) in {2, 3}:
            return self._constant(file, *map(str, path[1:]))
        name = place(path[1:] if len(path) > 1 else path)
        return _with_defaults(file, path).edit(path, _value(path, self.text)), f"{name} = {_short(self.text)}"

    def _constant(self, file: ModelFile, name: str, key: str = "") -> Done:
        known = _known(file, name)
        if not key:
            return file.set_constant(name, typed(self.text)), f"{name} = {_short(self.text)}"
        if key not in TOLD:
            msg = f"constants.{name}: expected one of {', '.join(TOLD)}, received {shown(key)}"
            raise ValueError(msg)
        told = (known if isinstance(known, dict) else {"value": known}) | {key: _value((key,), self.text.strip())}
        order = [*TOLD, *(each for each in told if each not in TOLD)]
        told = {each: told[each] for each in order if each in told and (each == "value" or told[each] != "")}
        return file.edit(("constants", name), told if set(told) != {"value"} else told["value"]), f"{key} of {name} = {_short(self.text)}"


@dataclass(frozen=True, slots=True)
class EditCells:
    """Type into many cells at once: a pasted block, both sides of a symmetric matrix."""

    cells: tuple[tuple[Path, str], ...]

    def apply(self, file: ModelFile) -> Done:
        cells = [(tuple(path), text) for path, text in self.cells]
        if not cells:
            return file, ""
        (first, text), names = cells[0], dict.fromkeys(str(path[1]) for path, _ in cells if len(path) > 1)
        one = f"{place(first[1:])} = {_short(text)}"
        made = _with_defaults(file, *(path for path, _ in cells)).edit_all([(p, _value(p, t)) for p, t in cells])
        return made, one if len(cells) <= 2 else f"{len(cells)} cells of {', '.join(names)}"


@dataclass(frozen=True, slots=True)
class Rewrite:
    """Another text of the whole file, as it was typed."""

    text: str

    def apply(self, _file: ModelFile) -> Done:
        return loads(self.text, "", check=False), "edit the text"


@dataclass(frozen=True, slots=True)
class Add:
    """One more state (a constant that nothing drives or measures yet), noise of a continuous model, or measurement."""

    what: What
    name: str = ""
    unit: str = ""

    def apply(self, file: ModelFile) -> Done:
        if self.what == "noise":
            return file.add_noise(), "add a noise"
        add = {"state": file.add_state, "measurement": file.add_measurement}[self.what]
        return add(self.name.strip(), self.unit.strip()), f"add {self.what} {self.name}".strip()


@dataclass(frozen=True, slots=True)
class Remove:
    """Without a state, noise or measurement: its rows, columns, name and unit."""

    what: What
    index: int

    def apply(self, file: ModelFile) -> Done:
        remove = {"state": file.remove_state, "noise": file.remove_noise, "measurement": file.remove_measurement}
        return remove[self.what](self.index), f"remove {self.what} {self.index + 1}"


@dataclass(frozen=True, slots=True)
class Name:
    """Name and unit of a state or measurement."""

    what: Literal["state", "measurement"]
    index: int
    name: str
    unit: str = ""

    def apply(self, file: ModelFile) -> Done:
        names = file.states if self.what == "state" else file.measurements
        before = names[self.index] if 0 <= self.index < len(names) else ""
        for key, text in zip(LABELS[self.what], (self.name.strip(), self.unit.strip()), strict=True):
            path, known = ("model", key, self.index), _table(file, "model").get(key)
            same = isinstance(known, list) and known[self.index : self.index + 1] == [text]
            if not same and (text or known is not None):
                file = _with_defaults(file, path).edit(path, text)
        return _renamed(file, self.what, before, self.name.strip()), f"{self.what} {self.index + 1}: {_short(self.name)}"


@dataclass(frozen=True, slots=True)
class AddConstant:
    """A new constant."""

    name: str
    expression: str = "1"

    def apply(self, file: ModelFile) -> Done:
        name = self.name.strip()
        problem = wrong_name(name)
        if name in _table(file, "constants"):
            problem = f"expected a new name, received {shown(name)}, which another constant has"
        if problem:
            msg = f"constants: {problem}"
            raise ValueError(msg)
        return file.set_constant(name, typed(self.expression)), f"constant {name} = {_short(self.expression)}"


@dataclass(frozen=True, slots=True)
class RenameConstant:
    """Another name for a constant, in all expressions too."""

    name: str
    other: str

    def apply(self, file: ModelFile) -> Done:
        other = self.other.strip()
        return file.rename_constant(self.name, other), f"rename {self.name} to {other}"


@dataclass(frozen=True, slots=True)
class RemoveConstant:
    """Without a constant that nothing refers to."""

    name: str

    def apply(self, file: ModelFile) -> Done:
        _known(file, self.name)
        return file.remove_constant(self.name), f"remove constant {self.name}"


@dataclass(frozen=True, slots=True)
class SetKind:
    """The same model in the other time; its matrices become numbers.

    A continuous model becomes its samples. A discrete one becomes the continuous model with those samples, where there is one.
    """

    kind: str

    def apply(self, file: ModelFile) -> Done:
        return converted(file, self.kind), f"a {self.kind} model"


@dataclass(frozen=True, slots=True)
class AddPart:
    """A part that a model may have: a known input "u" (or one more), "N", "offset" (discrete), "x0", "Rc" instead of "R" or "R" of "Rc"."""

    name: Part

    def apply(self, file: ModelFile) -> Done:
        name, found = self.name, file.data()
        model, kind, n = found.get("model", {}), found.get("kind"), file.n
        allowed = {"continuous": ("u", "N", "x0", "R", "Rc"), "discrete": ("u", "N", "offset", "x0")}.get(str(kind), ())
        if name not in allowed:
            msg = f"model: expected one of {', '.join(allowed)} (of a {kind} model), received {shown(name)}"
            raise ValueError(msg)
        if name in model and name != "u":
            msg = f"model.{name}: expected a part that the model does not have yet, received one that it has"
            raise ValueError(msg)
        if name == "u":
            if "cost" in found:
                msg = "model.u: expected a model without [cost], whose regulator makes the inputs, received one with it"
                raise ValueError(msg)
            if "B" in model and "u" not in model:
                return file.edit(("model", "u"), [0] * file.inputs), "add the known inputs u"
            B = [[*row, 0] for row in model["B"]] if "u" in model else [[0]] * n
            label = "add a known input to u" if "u" in model else "add a known input u"
            return file.edit(("model", "B"), B).edit(("model", "u"), [*model.get("u", []), 0]), label
        if name in {"R", "Rc"}:
            other = "Rc" if name == "R" else "R"
            return file.edit(("model", name), model[other]).remove(("model", other)), f"{name} instead of {other}"
        if name == "N" and kind == "continuous" and "Rc" not in model:
            msg = "model.N: expected Rc (the strength of a continuous measurement's noise) beside it, received R"
            raise ValueError(msg)
        zero = [0] * n if name != "N" else np.zeros((file.s if kind == "continuous" else n, file.m), dtype=int)
        return file.edit(("model", name), zero), f"add {name}"


@dataclass(frozen=True, slots=True)
class RemovePart:
    """Without a part that a model need not have."""

    name: Part

    def apply(self, file: ModelFile) -> Done:
        model = _table(file, "model")
        there = [part for part in ("u", "N", "offset", "x0") if part in model]
        if self.name not in there:
            msg = f"model: expected one of {', '.join(there) or 'none: there is no such part'}, received {shown(self.name)}"
            raise ValueError(msg)
        for key in (self.name, *(("B",) if self.name == "u" and "B" in model else ())):
            file = file.remove(("model", key))
        return file, f"remove {self.name}"


# Within --------------------------------------------------------------------------------------------------------------


def _renamed(file: ModelFile, what: str, old: str, new: str) -> ModelFile:
    """The file whose [cost] calls a state or measurement by its new name, too."""
    cost = _table(file, "cost")
    if old in {"", new} or not new:
        return file
    for key in ("loads",) if what == "state" else ("track", "outputs", "integral"):
        told = cost.get(key)
        if isinstance(told, list) and old in told:
            file = file.edit(("cost", key), [new if each == old else each for each in told])
        elif isinstance(told, dict) and old in told and not isinstance(told[old], dict):
            file = file.edit(("cost", key), {new if each == old else each: value for each, value in told.items()})
    return file


def _value(path: Path, text: str) -> Any:
    """What a text is in the file: a name as it is, a number or an expression elsewhere."""
    return text if any(part in WORDS for part in path[:2]) or path[-1:] in {("unit",), ("meaning",)} else typed(text)


def _short(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= 40 else f"{line[:39]}…"


def _with_defaults(file: ModelFile, *paths: Path) -> ModelFile:
    """The file with the lists written out that were left out and are typed into: names, units, x0."""
    for key in dict.fromkeys(path[1] for path in paths if path[:1] == ("model",) and len(path) > 2):
        if key in {"x0", *LABELS["state"], *LABELS["measurement"]} and key not in _table(file, "model"):
            file = file.edit(("model", key), [0] * file.n if key == "x0" else list(getattr(file, str(key))))
    return file


def _table(file: ModelFile, name: str) -> dict[str, Any]:
    """[model], [constants] or [cost], as far as it is a table."""
    found = file.data().get(name)
    return found if isinstance(found, dict) else {}


def _known(file: ModelFile, name: str) -> Any:
    """What stands in the file for a constant; ``ValueError`` where there is none of the name."""
    if name not in (known := _table(file, "constants")):
        msg = f"constants: expected one of {', '.join(known) or 'none: the model has no constants'}, received {shown(name)}"
        raise ValueError(msg)
    return known[name]
