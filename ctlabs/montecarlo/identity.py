"""Digests of models and functions, by which a checkpoint knows its experiment."""

from __future__ import annotations

import dataclasses
import functools
import platform
from collections.abc import Iterator
from hashlib import sha256
from importlib.metadata import version
from types import CodeType, FunctionType, MethodType
from typing import Any

import numpy as np

from ctlabs.linalg.compiled import COMPILED

#: Changed with every change of the random numbers, of the grouping of runs or of the sums.
FORMAT = "1"


def versions() -> dict[str, str]:
    """What decides the last bits beside the experiment itself."""
    return {
        "format": FORMAT,
        "python": platform.python_version(),
        "numpy": version("numpy"),
        "numba": version("numba") if COMPILED else "none",
        "machine": platform.machine(),
    }


def digest(*values: object) -> str:
    """A digest of arrays, numbers, dataclasses and functions (their code and the values they refer to)."""
    total = sha256()
    seen: set[int] = set()
    for value in values:
        for part in _parts(value, seen):
            total.update(len(part).to_bytes(8, "little") + part)
    return total.hexdigest()[:16]


def _parts(value: Any, seen: set[int]) -> Iterator[bytes]:
    """The value as a sequence of byte strings."""
    if isinstance(value, np.ndarray | np.generic):
        yield f"array {value.dtype} {value.shape}".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif value is None or isinstance(value, bool | int | float | complex | str | bytes):
        yield repr(value).encode()
    elif isinstance(value, list | tuple | set | frozenset | dict):
        yield f"{type(value).__name__} {len(value)}".encode()
        items = (
            value.items()
            if isinstance(value, dict)
            else sorted(value, key=repr)
            if isinstance(value, set | frozenset)
            else value
        )
        for item in items:
            yield from _parts(item, seen)
    elif id(value) in seen:
        yield b"again"
    else:
        seen.add(id(value))
        yield from _compound(value, seen)


def _compound(value: Any, seen: set[int]) -> Iterator[bytes]:
    """Functions, code, dataclasses and other objects."""
    yield f"{type(value).__module__}.{type(value).__qualname__}".encode()
    if isinstance(value, FunctionType):
        yield from _parts(value.__code__, seen)
        yield from _parts((value.__defaults__, value.__kwdefaults__), seen)
        yield from _parts([cell.cell_contents for cell in value.__closure__ or ()], seen)
        names = sorted(_names(value.__code__) & value.__globals__.keys())
        yield from _parts({name: value.__globals__[name] for name in names if _telling(value.__globals__[name])}, seen)
    elif isinstance(value, CodeType):
        yield value.co_code
        yield from _parts((value.co_names, value.co_consts), seen)
    elif isinstance(value, MethodType):
        yield from _parts((value.__func__, value.__self__), seen)
    elif isinstance(value, functools.partial):
        yield from _parts((value.func, value.args, value.keywords), seen)
    elif isinstance(value, type):
        yield f"{value.__module__}.{value.__qualname__}".encode()
    elif dataclasses.is_dataclass(value):
        yield from _parts([(f.name, getattr(value, f.name)) for f in dataclasses.fields(value)], seen)
    elif hasattr(value, "__dict__"):
        yield from _parts(vars(value), seen)
    else:
        yield getattr(value, "__qualname__", "").encode()


def _names(code: CodeType) -> set[str]:
    names = set(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            names |= _names(constant)
    return names


def _telling(value: object) -> bool:
    """Whether a global that a function refers to can change what it computes (modules do not, between versions)."""
    return isinstance(value, np.ndarray | np.generic | bool | int | float | complex | str | tuple | list | FunctionType)
