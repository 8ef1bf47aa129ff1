"""Packages whose names are loaded when they are first used, so that importing one takes no time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def front(package: str, home: Mapping[str, str]) -> Callable[[str], Any]:
    """``__getattr__`` of a package: ``home``, the module of each name."""

    def get(name: str) -> Any:
        if name not in home:
            msg = f"module {package!r} has no attribute {name!r}"
            raise AttributeError(msg)
        return getattr(import_module(f"{package}.{home[name]}"), name)

    return get
