"""Where the names of the library are used: in labs, in their listings, and in the examples of the gallery."""

from __future__ import annotations

import ast
import importlib
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

ROOT = Path(__file__).parents[2]


def home(thing: Any) -> str:
    """Where a class or function is written, as ``module.name``; nothing for other things.

    >>> import ctlabs
    >>> home(ctlabs.smooth)
    'ctlabs.filtering.smoothing.smooth'
    """
    module, name = getattr(thing, "__module__", None), getattr(thing, "__qualname__", None)
    return f"{module}.{name}" if isinstance(module, str) and isinstance(name, str) and callable(thing) else ""


def found(path: str) -> Any:
    """The thing that a dotted path names, or None."""
    parts = path.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            thing: Any = importlib.import_module(".".join(parts[:cut]))
        except ImportError:
            continue
        for name in parts[cut:]:
            thing = getattr(thing, name, None)
        return thing
    return None


def imported(tree: ast.AST) -> dict[str, Any]:
    """What the names that a file imports from ctlabs stand for."""
    names: dict[str, Any] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "ctlabs":
            names |= {each.asname or each.name: found(f"{node.module}.{each.name}") for each in node.names}
        elif isinstance(node, ast.Import):
            for each in node.names:
                if each.name.split(".")[0] == "ctlabs":
                    names[each.asname or "ctlabs"] = found(each.name if each.asname else "ctlabs")
    return names


def used(tree: ast.AST) -> set[str]:
    """The homes of all names of the library that a file uses.

    >>> sorted(used(ast.parse("from ctlabs.models import shaping as s; s.bias(1.0)")))
    ['ctlabs.models.shaping.bias']
    """
    names = imported(tree)
    things = [names[node.id] for node in ast.walk(tree) if isinstance(node, ast.Name) and node.id in names]
    return {home(each) for each in [*things, *attributes(tree, names)] if home(each).startswith("ctlabs.")}


def attributes(tree: ast.AST, names: dict[str, Any]) -> Iterator[Any]:
    """The members of modules that a file reaches with dots."""

    def thing(node: ast.AST) -> Any:
        if isinstance(node, ast.Name):
            return names.get(node.id)
        if isinstance(node, ast.Attribute) and isinstance(owner := thing(node.value), ModuleType):
            known = getattr(owner, node.attr, None)
            return found(f"{owner.__name__}.{node.attr}") if known is None else known
        return None

    return (thing(node) for node in ast.walk(tree) if isinstance(node, ast.Attribute))


def labs() -> dict[str, list[Path]]:
    """The files of each lab: its own, the modules beside it, its listing."""
    names = sorted(path.parent.name for path in (ROOT / "reports").glob("*/results.json"))
    files = [*sorted((ROOT / "tasks").glob("*.py")), *sorted((ROOT / "tasks" / "listings").glob("*.py"))]
    return {lab: [path for path in files if path.stem.lstrip("_").startswith(lab)] for lab in names}


def examples() -> list[Path]:
    """The examples of the gallery."""
    return sorted((ROOT / "docs" / "gallery").rglob("*.py"))


def index() -> dict[str, dict[str, list[str]]]:
    """Of every name used somewhere its labs and examples: ``index()[home]["labs"]``, and ``["examples"]`` as paths."""
    where: dict[str, dict[str, list[str]]] = defaultdict(lambda: {"labs": [], "examples": []})
    for lab, files in labs().items():
        for name in {name for path in files for name in used(ast.parse(path.read_text(encoding="utf-8")))}:
            where[name]["labs"].append(lab)
    for path in examples():
        for name in used(ast.parse(path.read_text(encoding="utf-8"))):
            where[name]["examples"].append(path.relative_to(ROOT / "docs" / "gallery").as_posix())
    return dict(where)
