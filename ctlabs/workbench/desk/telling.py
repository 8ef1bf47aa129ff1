"""Commands on a model that come from a record: how its table is read, and constants that were fitted to it."""

from __future__ import annotations

from collections.abc import Mapping as Table
from dataclasses import dataclass, field
from typing import Any

from ctlabs.files.mapping import Mapping
from ctlabs.files.modelfile import ModelFile
from ctlabs.workbench.desk.commands import Done


@dataclass(frozen=True, slots=True)
class TellData:
    """Say in [data] how records are read; a period of their own is the model's."""

    mapping: Mapping
    words: str = ""

    def apply(self, file: ModelFile) -> Done:
        """The file with this table [data], all that stays as it was typed."""
        told, present = self.mapping.table(), file.data().get("data")
        present = dict(present) if isinstance(present, dict) else {}
        changes = [(("data", key), value) for key, value in told.items() if present.get(key) != value]
        for key in [key for key in present if key not in told]:
            file = file.remove(("data", key))
        if changes:
            file = file.edit_all(changes)
        if self.mapping.dt is not None:
            file = file.edit(("model", "dt"), self.mapping.dt)
        return _tidy(file), self.words or "how data are read"


def _tidy(file: ModelFile) -> ModelFile:
    """Without a table [data] that says nothing any more."""
    return file.remove(("data",)) if file.data().get("data") == {} else file


@dataclass(frozen=True, slots=True)
class TakeEstimates:
    """Put fitted constants into the model."""

    values: Table[str, float] = field(default_factory=dict)

    def apply(self, file: ModelFile) -> Done:
        """The file with these numbers; ``ValueError`` where it has no such constant."""
        known: Any = file.data().get("constants", {})
        for name in self.values:
            if name not in known:
                raise ValueError(f"constants.{name}: expected a constant of the model, received one that it has no more")
        made = file.edit_all([(("constants", name), float(value)) for name, value in self.values.items()])
        return made, f"take the estimates of {', '.join(self.values)}"
