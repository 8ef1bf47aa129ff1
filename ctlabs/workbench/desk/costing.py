"""Commands on what a regulator is for: an input, the table [cost] of a model file, its weights and the regulator's settings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ctlabs.files.modelfile import ModelFile
from ctlabs.files.modelfile.errors import Path, place, shown
from ctlabs.workbench.desk.commands import Done
from ctlabs.workbench.desk.plain import typed

#: The tables of [cost] whose keys are names: weights of outputs, of their integrals.
NAMED = ("outputs", "integral")
#: What a regulator does where [cost] does not say: a setting that says the same is left out.
DEFAULTS: dict[str, Any] = {"kind": "current", "delay": 0, "track": [], "loads": [], "stabilise": False, "horizon": ""}


@dataclass(frozen=True, slots=True)
class AddInput:
    """One more input, which moves one state: a column of B with a 1."""

    state: int

    def apply(self, file: ModelFile) -> Done:
        """The file with it; ``ValueError`` where there is no such state, or where the inputs are known."""
        n, model = file.n, file.data().get("model", {})
        if not 0 <= self.state < n:
            msg = f"model.B: expected one of the {n} states, received number {self.state + 1}"
            raise ValueError(msg)
        if "u" in model:
            msg = "model.u: expected inputs that a regulator makes, received known ones"
            raise ValueError(msg)
        before = model.get("B") or [[]] * n
        made = file.edit(("model", "B"), [[*row, int(i == self.state)] for i, row in enumerate(before)])
        cost = _cost(file)
        r = len(before[0])
        if "Qu" in cost:
            wider = [[*row, 0] for row in cost["Qu"]]
            made = made.edit(("cost", "Qu"), [*wider, [0] * r + [1]])
        if "N" in cost:
            made = made.edit(("cost", "N"), [[*row, 0] for row in cost["N"]])
        return made, f"add an input that moves {file.states[self.state]}"


@dataclass(frozen=True, slots=True)
class BeginCost:
    """Let a regulator make the inputs: a table [cost], all weights 1; what the inputs were known to be is left out."""

    def apply(self, file: ModelFile) -> Done:
        """The file with it; ``ValueError`` without an input."""
        model = file.data().get("model", {})
        if "B" not in model:
            msg = "model.B: expected the matrix by which an input enters, received none"
            raise ValueError(msg)
        if "u" in model:
            file = file.remove(("model", "u"))
        r = len(model["B"][0])
        return file.edit_all([(("cost", "Qx"), _unit(file.n)), (("cost", "Qu"), _unit(r))]), "a regulator, all weights 1"


@dataclass(frozen=True, slots=True)
class EndCost:
    """Without [cost]: the inputs stay, nothing makes them."""

    def apply(self, file: ModelFile) -> Done:
        """The file without it."""
        return (file.remove(("cost",)) if "cost" in file.data() else file), "no regulator"


@dataclass(frozen=True, slots=True)
class Weigh:
    """A weight: ("Qx", i, i) of a state, ("Qu", j, j) of an input, any element of Qx, Qu, N, Qf, ("outputs", name), ("integral", name).

    Of a name, nothing or 0 leaves it out.
    """

    path: Path
    text: str

    def apply(self, file: ModelFile) -> Done:
        """The file with it."""
        name, *rest = self.path
        label = f"weight {place(self.path)} = {' '.join(self.text.split())[:40]}"
        if name in NAMED:
            return self._named(file, str(name), str(rest[0])), label
        changes: list[tuple[Path, Any]] = []
        if name == "Qx" and "Qx" not in _cost(file):
            changes.append((("cost", "Qx"), [[0] * file.n for _ in range(file.n)]))
        changes.append((("cost", *self.path), typed(self.text)))
        for change in changes:
            file = file.edit(*change)
        return file, label

    def _named(self, file: ModelFile, table: str, name: str) -> ModelFile:
        cost = _cost(file)
        present = dict(cost.get(table, {}))
        text = self.text.strip()
        row = isinstance(present.get(name), dict)
        if text in {"", "0"} and not row:
            present.pop(name, None)
        elif row:
            present[name] = {**present[name], "weight": typed(text or "0")}
        else:
            present[name] = typed(text)
        if table == "outputs" and not present and "Qx" not in cost:
            file = file.edit(("cost", "Qx"), [[0] * file.n for _ in range(file.n)])
        if present:
            return file.edit(("cost", table), present)
        return file.remove(("cost", table)) if table in cost else file


@dataclass(frozen=True, slots=True)
class SetRegulator:
    """How the regulator is built: "kind", "delay", "horizon" (texts), "track", "loads" (names), "stabilise" (yes or no)."""

    key: str
    value: str | bool | Sequence[str]

    def apply(self, file: ModelFile) -> Done:
        """The file with it; ``ValueError`` for another key."""
        if self.key not in DEFAULTS:
            msg = f"cost: expected one of {', '.join(DEFAULTS)}, received {shown(self.key)}"
            raise ValueError(msg)
        value: Any = self.value if isinstance(self.value, bool) else list(self.value)
        if isinstance(self.value, str):
            value = self.value if self.key == "kind" else typed(self.value.strip()) if self.value.strip() else DEFAULTS[self.key]
        said = value if not isinstance(value, list) else ", ".join(value) or "none"
        label = f"{self.key}: {said if said != '' else 'none'}"
        if value != DEFAULTS[self.key]:
            return file.edit(("cost", self.key), value), label
        return (file.remove(("cost", self.key)) if self.key in _cost(file) else file), label


def _cost(file: ModelFile) -> dict[str, Any]:
    """[cost], as far as it is a table."""
    found = file.data().get("cost")
    return found if isinstance(found, dict) else {}


def _unit(size: int) -> list[list[int]]:
    return [[int(i == j) for j in range(size)] for i in range(size)]
