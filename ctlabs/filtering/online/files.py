"""The file of a saved filter: a header in JSON and plain arrays, in NumPy's .npz without pickled objects."""

from __future__ import annotations

import io
import json
import os
import secrets
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ctlabs.linalg.checks import Array
from ctlabs.models import ContinuousModel, DiscreteModel

#: Version of the files.
FORMAT = 4
#: The fields of a model that are no matrices.
LABELS = ("states", "measurements", "units", "measurement_units")


#: What is restored from a file.
T = TypeVar("T")


def write(path: Path, header: dict[str, Any], arrays: dict[str, Array]) -> None:
    """Write a file under another name and rename it: whoever reads it sees the old one or the new one, whole."""
    data = io.BytesIO()
    text = json.dumps({"format": FORMAT, **header}).encode()
    np.savez(data, allow_pickle=False, header=np.frombuffer(text, dtype=np.uint8), **arrays)
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
    try:
        with temporary.open("xb") as file:
            file.write(data.getvalue())
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def read(path: Path, restore: Callable[[dict[str, Any], dict[str, Array]], T]) -> T:
    """What ``restore`` makes of the header and arrays of a file; one line, with the file's name, if it cannot."""
    data = path.read_bytes()
    try:
        arrays = _arrays(data)
        header = json.loads(arrays["header"].tobytes())
        if header["format"] == FORMAT:
            return restore(header, arrays)
    # A damaged file may raise whatever zipfile, zlib, numpy, json and the checks of a model know.
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        msg = f"{path}: expected a filter saved by ctlabs, received a foreign or damaged file ({reason})"
        raise ValueError(msg) from error
    msg = f"{path}: expected a saved filter of format {FORMAT}, received format {header['format']!r}"
    raise ValueError(msg)


def described(given: DiscreteModel | ContinuousModel) -> tuple[dict[str, Any], dict[str, Array]]:
    """A model as entries of the header, and arrays."""
    labels = {name: getattr(given, name) for name in LABELS}
    values = {name: getattr(given, name) for name in _matrices(type(given))}
    arrays = {f"model.{name}": np.asarray(value) for name, value in values.items() if value is not None}
    return {"model": type(given).__name__, "labels": labels}, arrays


def model(header: dict[str, Any], arrays: dict[str, Array]) -> DiscreteModel | ContinuousModel:
    """The model that was described."""
    labels: dict[str, Any] = {name: tuple(header["labels"][name]) for name in LABELS}
    kind = {"DiscreteModel": DiscreteModel, "ContinuousModel": ContinuousModel}[header["model"]]
    values: dict[str, Any] = {name: arrays.get(f"model.{name}") for name in _matrices(kind)}
    for name in ("dt", "first"):
        if name in values:
            values[name] = values[name].item()
    return kind(**values, **labels)


def _matrices(kind: type) -> list[str]:
    """The fields of a model that are numbers."""
    return [field.name for field in fields(kind) if field.name not in LABELS]


def leaves(value: Any) -> Iterator[Any]:
    """The arrays and numbers of nested tuples, in order; ``None`` is none."""
    if isinstance(value, tuple):
        for item in value:
            yield from leaves(item)
    elif value is not None:
        yield value


def filled(template: Any, saved: Iterator[Array]) -> Any:
    """A copy of nested tuples with other leaves, of the same types and shapes."""
    if isinstance(template, tuple):
        return type(template)(*(filled(item, saved) for item in template))
    if template is None:
        return None
    found, wanted = next(saved), np.asarray(template)
    if found.dtype != wanted.dtype or found.shape != wanted.shape:
        msg = f"expected {wanted.dtype} of shape {wanted.shape}, received {found.dtype} of shape {found.shape}"
        raise ValueError(msg)
    return found if isinstance(template, np.ndarray) else found.item()


def _arrays(data: bytes) -> dict[str, Array]:
    """The arrays of an .npz file as ``numpy.savez`` writes it: not compressed, no objects."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        if any(member.compress_type != zipfile.ZIP_STORED for member in archive.infolist()):
            msg = "expected members that are not compressed"
            raise ValueError(msg)
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        return dict(file)
