"""What every command does: one model file is made from another; no page, no store, no state."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ctlabs.files.modelfile import ModelFile, loads, new
from ctlabs.files.modelfile.edits import changed
from ctlabs.files.modelfile.errors import place, shown
from ctlabs.files.modelfile.schema import wrong_name
from ctlabs.workbench import blocks
from ctlabs.workbench.blocks import InsertBlock
from ctlabs.workbench.commands import (
    AddConstant,
    AddMeasurement,
    AddNoise,
    AddPart,
    AddState,
    Command,
    Describe,
    EditCell,
    EditCells,
    NameMeasurement,
    NameState,
    New,
    Open,
    RemoveConstant,
    RemoveMeasurement,
    RemoveNoise,
    RemovePart,
    RemoveState,
    RenameConstant,
    Rewrite,
    SetConstant,
    SetDt,
    SetExperiment,
    SetKind,
    SetRange,
    SetTitle,
)
from ctlabs.workbench.kinds import converted
from ctlabs.workbench.plain import typed

#: Settings of [experiment] that are whole numbers.
WHOLE = ("first", "steps", "runs", "seed")


def apply(file: ModelFile, command: Command) -> tuple[ModelFile, str]:
    """The file after a command, and what was done, in a few words.

    Raises
    ------
    ValueError
        The command is impossible; one line.

    >>> file, done = apply(new(2), EditCell(("model", "F", 1, 0), "-w^2"))
    >>> done, file.problems()[0].where
    ('F[1][0] = -w^2', 'model.F[1][0]')
    """
    done = _DOERS[type(command)](file, command)
    # What is written must be what is read: names do not go into the text, and the text is looked at from the beginning.
    return done if done[0].name == "" else (loads(done[0].dumps(), "", check=False), done[1])


def _open(_file: ModelFile, command: Open) -> tuple[ModelFile, str]:
    found = loads(command.text, command.name, check=False)
    return loads(found.dumps(), "", check=False), f"open {command.name or 'a file'}"


def _new(_file: ModelFile, command: New) -> tuple[ModelFile, str]:
    file = new(command.n, command.s, command.m, command.kind)
    noises = f", {command.s} noises" if command.kind == "continuous" else ""
    return file, f"new {command.kind} model: {command.n} states{noises}, {command.m} measurements"


def _edit(file: ModelFile, command: EditCell) -> tuple[ModelFile, str]:
    path, text = tuple(command.path), command.text
    if len(path) == 2 and path[0] == "constants":
        return _set_constant(file, SetConstant(str(path[1]), text))
    table, key = (str(path[0]), str(path[1])) if len(path) > 1 else ("", str(path[0] if path else ""))
    words = key in {"title", "description", "source", "states", "units", "measurements", "measurement_units"}
    if table == "model" and len(path) > 2 and key not in file.data().get("model", {}):
        file = _with_default(file, key)
    name = place(path[1:] if len(path) > 1 else path)
    return file.edit(path, text if words else typed(text)), f"{name} = {_short(text)}"


def _edit_cells(file: ModelFile, command: EditCells) -> tuple[ModelFile, str]:
    paths = [tuple(path) for path, _ in command.cells]
    for key in dict.fromkeys(str(path[1]) for path in paths if len(path) > 1 and path[0] == "model"):
        if key not in file.data().get("model", {}):
            file = _with_default(file, key)
    known = file.data()
    for path in paths:
        item: Any = known
        for depth, part in enumerate(path):
            try:
                item = item[part]
            except (KeyError, IndexError, TypeError):
                msg = f"{place(path[: depth + 1])}: expected a cell that is there, received none"
                raise ValueError(msg) from None
        if path[:1] != ("model",) or len(path) < 2 or isinstance(item, dict | list):
            msg = f"{place(path)}: expected a cell of the model, received something else"
            raise ValueError(msg)

    def change(document: Any) -> None:
        for path, (_, text) in zip(paths, command.cells, strict=True):
            table = document
            for key in path[:-1]:
                table = table[key]
            table[path[-1]] = typed(text)

    if not paths:
        return file, ""
    text = changed(file.dumps(), paths[0], change)
    names = ", ".join(dict.fromkeys(str(path[1]) for path in paths))
    one = f"{place(paths[0][1:])} = {_short(command.cells[0][1])}"
    return loads(text, "", check=False), one if len(paths) <= 2 else f"{len(paths)} cells of {names}"


def _rewrite(_file: ModelFile, command: Rewrite) -> tuple[ModelFile, str]:
    return loads(command.text, "", check=False), "edit the text"


def _short(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= 40 else f"{line[:39]}…"


def _with_default(file: ModelFile, key: str) -> ModelFile:
    """The file with a list that was left out: names, units, x0."""
    defaults: dict[str, Callable[[], Any]] = {
        "x0": lambda: [0] * file.n,
        "states": lambda: list(file.states),
        "units": lambda: list(file.units),
        "measurements": lambda: list(file.measurements),
        "measurement_units": lambda: list(file.measurement_units),
    }
    return file.edit(("model", key), defaults[key]()) if key in defaults else file


def _name_state(file: ModelFile, command: NameState) -> tuple[ModelFile, str]:
    return _named(file, ("states", "units"), command), f"state {command.index + 1}: {_short(command.name)}"


def _name_measurement(file: ModelFile, command: NameMeasurement) -> tuple[ModelFile, str]:
    words = f"measurement {command.index + 1}: {_short(command.name)}"
    return _named(file, ("measurements", "measurement_units"), command), words


def _named(file: ModelFile, keys: tuple[str, str], command: NameState | NameMeasurement) -> ModelFile:
    for key, text in zip(keys, (command.name.strip(), command.unit.strip()), strict=True):
        known = file.data().get("model", {})
        if key not in known:
            if not text:
                continue
            file = _with_default(file, key)
        elif known[key][command.index : command.index + 1] == [text]:
            continue
        file = file.edit(("model", key, command.index), text)
    return file


def _constants(file: ModelFile) -> dict[str, Any]:
    found = file.data().get("constants", {})
    return found if isinstance(found, dict) else {}


def _add_constant(file: ModelFile, command: AddConstant) -> tuple[ModelFile, str]:
    name = command.name.strip()
    if name in _constants(file):
        msg = f"constants: expected a new name, received {shown(name)}, which another constant has"
        raise ValueError(msg)
    _well_named(name)
    return file.set_constant(name, typed(command.expression)), f"constant {name} = {_short(command.expression)}"


def _well_named(name: str) -> None:
    if problem := wrong_name(name):
        msg = f"constants: {problem}"
        raise ValueError(msg)


def _known(file: ModelFile, name: str) -> None:
    if name not in (known := _constants(file)):
        msg = f"constants: expected one of {', '.join(known) or 'none: the model has no constants'}, received {shown(name)}"
        raise ValueError(msg)


def _set_constant(file: ModelFile, command: SetConstant) -> tuple[ModelFile, str]:
    _known(file, command.name)
    words = f"{command.name} = {_short(command.expression)}"
    return file.set_constant(command.name, typed(command.expression)), words


def _rename_constant(file: ModelFile, command: RenameConstant) -> tuple[ModelFile, str]:
    other = command.other.strip()
    return file.rename_constant(command.name, other), f"rename {command.name} to {other}"


def _remove_constant(file: ModelFile, command: RemoveConstant) -> tuple[ModelFile, str]:
    _known(file, command.name)
    return file.remove_constant(command.name), f"remove constant {command.name}"


def _set_range(file: ModelFile, command: SetRange) -> tuple[ModelFile, str]:
    given = {key: typed(text) for key, text in (("min", command.min), ("max", command.max)) if text.strip()}
    return _told(file, command.name, given, ("min", "max")), f"range of {command.name}"


def _describe(file: ModelFile, command: Describe) -> tuple[ModelFile, str]:
    pairs = (("unit", command.unit), ("meaning", command.meaning))
    given = {key: text.strip() for key, text in pairs if text.strip()}
    return _told(file, command.name, given, ("unit", "meaning")), f"describe {command.name}"


def _told(file: ModelFile, name: str, given: dict[str, Any], keys: tuple[str, str]) -> ModelFile:
    """A constant with other words beside its value."""
    _known(file, name)
    found = _constants(file)[name]
    old = dict(found) if isinstance(found, dict) else {"value": found}
    now = {key: value for key, value in old.items() if key not in keys} | given
    order = [key for key in ("value", "min", "max", "unit", "meaning") if key in now]
    whole = {key: now[key] for key in [*order, *(key for key in now if key not in order)]}
    return file.edit(("constants", name), whole if set(whole) != {"value"} else whole["value"])


def _set_title(file: ModelFile, command: SetTitle) -> tuple[ModelFile, str]:
    return file.edit(("title",), command.title.strip()), f"title: {_short(command.title)}"


def _set_dt(file: ModelFile, command: SetDt) -> tuple[ModelFile, str]:
    return file.edit(("model", "dt"), typed(command.text)), f"dt = {_short(command.text)}"


def _set_experiment(file: ModelFile, command: SetExperiment) -> tuple[ModelFile, str]:
    key, value = command.key, command.value
    if key in WHOLE:
        try:
            value = int(str(value).strip())
        except ValueError:
            msg = f"experiment.{key}: expected a whole number, received {shown(value)}"
            raise ValueError(msg) from None
    elif key == "t0":
        value = typed(str(value))
    elif key == "algorithms":
        if not isinstance(value, list | tuple):
            msg = f"experiment.algorithms: expected a list of names, received {shown(value)}"
            raise ValueError(msg)
        value = [str(name) for name in value]
    else:
        msg = f"experiment: expected one of t0, {', '.join(WHOLE)}, algorithms, received {shown(key)}"
        raise ValueError(msg)
    return file.edit(("experiment", key), value), f"{key} = {_short(str(command.value))}"


# Parts that may be there or not --------------------------------------------------------------------------------------


def _add_part(file: ModelFile, command: AddPart) -> tuple[ModelFile, str]:
    name, found = command.name, file.data()
    model, kind = found.get("model", {}), found.get("kind")
    allowed = {"continuous": ("u", "N", "x0", "R", "Rc"), "discrete": ("u", "N", "offset", "x0")}.get(str(kind), ())
    if name not in allowed:
        msg = f"model: expected one of {', '.join(allowed)} (of a {kind} model), received {shown(name)}"
        raise ValueError(msg)
    if name == "u" and name in model:
        wider = file.edit(("model", "B"), [[*row, 0] for row in model["B"]])
        return wider.edit(("model", "u"), [*model["u"], 0]), "add a known input to u"
    if name in model:
        msg = f"model.{name}: expected a part that the model does not have yet, received one that it has"
        raise ValueError(msg)
    n, m = file.n, file.m
    if name == "u":
        return file.edit(("model", "B"), np.zeros((n, 1), dtype=int)).edit(("model", "u"), [0]), "add a known input u"
    if name in {"R", "Rc"}:
        other = "Rc" if name == "R" else "R"
        cells = model[other]
        return file.edit(("model", name), cells).remove(("model", other)), f"{name} instead of {other}"
    if name == "N" and kind == "continuous" and "Rc" not in model:
        msg = "model.N: expected Rc (the strength of a continuous measurement's noise) beside it, received R"
        raise ValueError(msg)
    rows = file.s if kind == "continuous" else n
    zero = [0] * n if name in {"offset", "x0"} else np.zeros((rows, m), dtype=int)
    return file.edit(("model", name), zero), f"add {name}"


def _remove_part(file: ModelFile, command: RemovePart) -> tuple[ModelFile, str]:
    name, model = command.name, file.data().get("model", {})
    if name not in model or name not in ("u", "N", "offset", "x0"):
        there = [part for part in ("u", "N", "offset", "x0") if part in model]
        msg = f"model: expected one of {', '.join(there) or 'none: there is no such part'}, received {shown(name)}"
        raise ValueError(msg)
    file = file.remove(("model", name))
    if name == "u" and "B" in model:
        file = file.remove(("model", "B"))
    return file, f"remove {name}"


_DOERS: dict[type[Any], Callable[[ModelFile, Any], tuple[ModelFile, str]]] = {
    Open: _open,
    New: _new,
    EditCell: _edit,
    EditCells: _edit_cells,
    Rewrite: _rewrite,
    AddState: lambda file, c: (file.add_state(c.name.strip(), c.unit.strip()), f"add state {c.name}".strip()),
    RemoveState: lambda file, c: (file.remove_state(c.index), f"remove state {c.index + 1}"),
    AddNoise: lambda file, _: (file.add_noise(), "add a noise"),
    RemoveNoise: lambda file, c: (file.remove_noise(c.index), f"remove noise {c.index + 1}"),
    AddMeasurement: lambda file, c: (
        file.add_measurement(c.name.strip(), c.unit.strip()),
        f"add measurement {c.name}".strip(),
    ),
    RemoveMeasurement: lambda file, c: (file.remove_measurement(c.index), f"remove measurement {c.index + 1}"),
    NameState: _name_state,
    NameMeasurement: _name_measurement,
    AddConstant: _add_constant,
    SetConstant: _set_constant,
    RenameConstant: _rename_constant,
    RemoveConstant: _remove_constant,
    SetRange: _set_range,
    Describe: _describe,
    SetTitle: _set_title,
    SetDt: _set_dt,
    SetKind: lambda file, c: (converted(file, c.kind), f"a {c.kind} model"),
    SetExperiment: _set_experiment,
    AddPart: _add_part,
    RemovePart: _remove_part,
    InsertBlock: blocks.insert,
}
