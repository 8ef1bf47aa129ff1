"""Changes of a model file's text that leave all the rest as it was typed: comments, spaces, expressions."""

from __future__ import annotations

import itertools
import re
import tomllib
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import tomlkit
from tomlkit.exceptions import TOMLKitError

from ctlabs.files.modelfile.checks import SHAPES, WEIGHTS
from ctlabs.files.modelfile.errors import ModelFileError, Path, Problem, place, shown
from ctlabs.files.modelfile.expressions import ExpressionError, parse
from ctlabs.files.modelfile.splicing import spliced
from ctlabs.files.modelfile.toml import BOM

#: What a new state's or measurement's own element is; of the others, 0. A new state is a constant that nothing drives.
OWN = {"Phi": 1, "P0": 1, "Q": 1, "R": 1, "Rc": 1}


#: So many entries are put into the text one by one.
FEW = 4


def changed(text: str, path: Path, change: Callable[[Any], None]) -> str:
    """The text after a change of its parsed document; line ends and a byte-order mark stay what they were."""
    mark, plain = (BOM, text[1:]) if text.startswith(BOM) else ("", text)
    windows = "\r\n" in plain and not re.search(r"(?<!\r)\n", plain)
    try:
        document = tomlkit.parse(plain.replace("\r\n", "\n") if windows else plain)
        change(document)
        result = tomlkit.dumps(document)
        tomllib.loads(result)
        result.encode()
    except (
        TOMLKitError,
        tomllib.TOMLDecodeError,
        UnicodeEncodeError,
        RecursionError,
        AttributeError,
        TypeError,
    ) as error:
        what = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ModelFileError(Problem(place(path), f"expected a change that TOML can hold, received: {what}")) from None
    return mark + (result.replace("\n", "\r\n") if windows else result)


def assign(text: str, *changes: tuple[Path, Any], data: dict[str, Any] | None = None) -> str:
    """The text with other values at some places; a table or key that is not there is added. ``data`` : what the text says."""
    values = [(path, _plain(value, path)) for path, value in changes]
    if data is not None and len(values) <= FEW and (made := spliced(text, data, values)) is not None:
        return made

    def change(document: Any) -> None:
        for path, value in values:
            table = document
            for depth, (key, following) in enumerate(itertools.pairwise(path)):
                if depth == 0 and isinstance(key, str) and isinstance(following, str) and key not in table:
                    table[key] = tomlkit.table()
                table = _inside(table, key, path[: depth + 1])
            _put(table, path, value)

    return changed(text, values[0][0], change)


def _put(table: Any, path: Path, value: Any) -> None:
    key = path[-1]
    if isinstance(key, int):
        _inside(table, key, path)
        table[key] = value
        return
    if not isinstance(table, dict):
        raise _error(path[:-1], f"expected a table that holds {shown(key)}, received {shown(_shown(table))}")
    if len(path) == 2 and path[0] == "constants" and isinstance(table.get(key), dict) and not isinstance(value, dict):
        table[key]["value"] = value
    else:
        table[key] = value


def remove(text: str, path: Path) -> str:
    """The text without a key or element."""

    def change(document: Any) -> None:
        table = document
        for depth, key in enumerate(path[:-1]):
            table = _inside(table, key, path[: depth + 1])
        _inside(table, path[-1], path)
        del table[path[-1]]

    return changed(text, path, change)


def _inside(table: Any, key: str | int, path: Path) -> Any:
    """What is at a key; the place is named where there is nothing."""
    if isinstance(key, int):
        if not isinstance(table, list) or isinstance(key, bool):
            raise _error(path, "expected a list there, received none")
        if not 0 <= key < len(table):
            raise _error(path, f"expected an index from 0 to {len(table) - 1}, received {key}")
    elif not isinstance(table, dict) or key not in table:
        raise _error(path, "expected a value there, received none")
    return table[key]


def constants(text: str, data: Mapping[str, Any], values: Mapping[str, float]) -> str:
    """The text with numbers for some constants."""

    def change(document: Any) -> None:
        for name, value in values.items():
            _put(document["constants"], ("constants", name), value)

    return changed(text, ("constants",), change) if data.get("constants") else text


def grow(text: str, kind: str, letter: str, labels: Mapping[str, str], sizes: Mapping[str, int]) -> str:
    """The text with one more state, measurement or noise ("n", "m", "s") at the end; ``labels`` for the lists of names and units."""

    def change(document: Any) -> None:
        model = document["model"]
        for name, label in labels.items():
            if name in model:
                model[name].append(label or _free(_LETTERS[name], model[name]))
            elif label:
                model[name] = [
                    *(f"{_LETTERS[name]}{i + 1}" if _LETTERS[name] else "" for i in range(sizes[letter])),
                    label,
                ]
        for name, shape in SHAPES[kind].items():
            if name in model and name not in labels and letter in shape:
                _grow(model[name], name, shape, letter)
        for matrix, shape in _weights(document, letter):
            _grow(matrix, "", shape, letter)

    return changed(text, ("model",), change)


def _free(letter: str, names: list[str]) -> str:
    """The first default name that none of the others has; units have no letter and stay empty."""
    count = len(names) + 1
    while letter and f"{letter}{count}" in names:
        count += 1
    return f"{letter}{count}" if letter else ""


#: The letter of default names; units have none.
_LETTERS = {"states": "x", "measurements": "z", "units": "", "measurement_units": ""}


def _grow(matrix: Any, name: str, shape: str, letter: str) -> None:
    zero, own = ("0", str(OWN.get(name, 0))) if _typed(matrix) else (0, OWN.get(name, 0))
    if len(shape) == 1:
        matrix.append(zero)
        return
    if shape[1] == letter:
        for row in matrix:
            row.append(zero)
    if shape[0] == letter:
        columns = len(matrix[0])
        matrix.append([own if shape == letter * 2 and j == columns - 1 else zero for j in range(columns)])


def _typed(matrix: Any) -> bool:
    """Whether a matrix is written as texts."""
    first = matrix[0]
    return isinstance(first[0] if isinstance(first, list) else first, str)


def shrink(text: str, kind: str, letter: str, index: int) -> str:
    """The text without one state, measurement or noise."""

    def change(document: Any) -> None:
        for name, shape in SHAPES[kind].items():
            if name not in document["model"] or letter not in shape:
                continue
            _shrink(document["model"][name], shape, letter, index)
        for matrix, shape in _weights(document, letter):
            _shrink(matrix, shape, letter, index)

    return changed(text, ("model",), change)


def _shrink(matrix: Any, shape: str, letter: str, index: int) -> None:
    if shape[1:] == letter:
        for row in matrix:
            del row[index]
    if shape[0] == letter:
        del matrix[index]


def _weights(document: Any, letter: str) -> list[tuple[Any, str]]:
    """The matrices of a table [cost] that have a row or column for each of a kind, and the rows of its outputs, with their shapes."""
    told = document.get("cost")
    if not isinstance(told, dict):
        return []
    found = [(told[name], shape) for name, shape in WEIGHTS.items() if name in told and letter in shape]
    outputs = told.get("outputs") if letter == "n" else None
    rows = outputs.values() if isinstance(outputs, dict) else ()
    return found + [(each["row"], "n") for each in rows if isinstance(each, dict) and "row" in each]


def rename(text: str, old: str, new: str) -> str:
    """The text with another name for a constant, in all expressions too."""
    data = tomllib.loads(text.removeprefix(BOM))
    pattern = rf'(?m)^([ \t]*)({re.escape(old)}|"{re.escape(old)}"|\'{re.escape(old)}\')([ \t]*=)'
    start = re.search(r"(?m)^[ \t]*\[[ \t]*constants[ \t]*\]", text)
    renamed = {new if name == old else name: value for name, value in data["constants"].items()}
    key = new if new.isascii() else f'"{new}"'
    for match in re.compile(pattern).finditer(text, start.end()) if start else ():
        at = match.start(2)
        candidate = text[:at] + key + text[at + len(match[2]) :]
        try:
            found = tomllib.loads(candidate.removeprefix(BOM))
        except tomllib.TOMLDecodeError:
            continue
        if found == {**data, "constants": renamed} and list(found["constants"]) == list(renamed):
            break
    else:
        raise _error(
            ("constants", old), "expected a line of its own in [constants] to rename it, received another form"
        )
    for path, value in users({**data, "constants": renamed}, old):
        candidate = assign(candidate, (path, parse(value).renamed(old, new)))
    return candidate


def users(data: Mapping[str, Any], name: str) -> list[tuple[Path, str]]:
    """The places of expressions that contain a name."""
    found = []

    def walk(value: Any, path: Path) -> None:
        if isinstance(value, dict):
            for key, item in value.items():
                if key not in {"unit", "meaning"}:
                    walk(item, (*path, key))
        elif isinstance(value, list):
            for i, item in enumerate(value):
                walk(item, (*path, i))
        elif isinstance(value, str):
            try:
                if name in parse(value).names:
                    found.append((path, value))
            except ExpressionError:
                pass

    for table in ("constants", "model", "experiment", "cost"):
        told = data.get(table)
        for key, value in told.items() if isinstance(told, dict) else ():
            if (
                table == "constants"
                or (table == "model" and key not in _LETTERS)
                or (table, key) == ("experiment", "t0")
                or (table == "cost" and key not in {"kind", "loads", "track"})
            ):
                walk(value, (table, key))
    return found


def _plain(value: Any, path: Path) -> Any:
    """Numbers, texts and lists of Python for what numpy and tuples hold."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, dict):
        return _inline({str(key): _plain(item, (*path, str(key))) for key, item in value.items()}, path)
    if isinstance(value, list | tuple):
        return [_plain(item, (*path, i)) for i, item in enumerate(value)]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return float(value)
    if isinstance(value, str):
        return str(value)
    raise _error(path, f"expected a number, a text or a list, received {shown(value)}")


def _inline(value: dict[str, Any], path: Path) -> Any:
    """A constant with its limits, and what [data] says of several columns, on one line; any other table as it is."""
    if path[0] not in ("constants", "data", "cost") or len(path) < 2:
        return value
    table = tomlkit.inline_table()
    table.update(value)
    return table


def _shown(item: Any) -> Any:
    return item.unwrap() if hasattr(item, "unwrap") else item


def _error(path: Path, message: str) -> ModelFileError:
    return ModelFileError(Problem(place(path), message))
