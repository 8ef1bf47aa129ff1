"""What the project's own source files import, use and define: each file is parsed once for all the tests of a process that ask."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

REPOSITORY = Path(__file__).parents[1]


class Import(NamedTuple):
    """Who imports what, where, and whether only type checkers see it."""

    file: Path
    line: int
    target: str
    typing_only: bool

    def __str__(self) -> str:
        return f"{self.file.relative_to(REPOSITORY)}:{self.line} imports {self.target}"


class Source(NamedTuple):
    """What tests ask about a file. Its tree is not kept: those of all files together are a million objects."""

    imports: list[Import]
    private: list[str]
    classes: list[str]


#: The kinds of nodes that matter below.
LOOKED_AT = (ast.Import, ast.ImportFrom, ast.Call, ast.If, ast.Attribute, ast.ClassDef)


def looked_at(tree: ast.AST) -> list[ast.AST]:
    """The nodes that matter."""
    return [node for node in ast.walk(tree) if isinstance(node, LOOKED_AT)]


@cache
def read(path: Path) -> Source:
    """A file of the project."""
    nodes = looked_at(ast.parse(path.read_text(encoding="utf-8")))
    return Source(imports(nodes, path), private(nodes), [node.name for node in nodes if isinstance(node, ast.ClassDef)])


def dotted(path: Path) -> str:
    """The module's full name."""
    parts = path.relative_to(REPOSITORY).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def is_type_checking(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


def called(function: ast.expr) -> str:
    """The name of what is called, "f" or "module.f"; empty for anything else."""
    match function:
        case ast.Name(name):
            return name
        case ast.Attribute(ast.Name(module), name):
            return f"{module}.{name}"
    return ""


def targets(node: ast.AST, path: Path) -> list[str]:
    """Full names that a statement imports; "from ctlabs import models" is ctlabs.models."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        base = node.module or ""
        if node.level:
            package = dotted(path).split(".") if path.name == "__init__.py" else dotted(path).split(".")[:-1]
            base = ".".join([*package[: len(package) - node.level + 1], *([base] if base else [])])
        return [f"{base}.{alias.name}" for alias in node.names]
    if isinstance(node, ast.Call) and called(node.func) in {"import_module", "importlib.import_module", "__import__"}:
        first = node.args[0]
        return [first.value] if isinstance(first, ast.Constant) and isinstance(first.value, str) else []
    return []


def imports(nodes: Sequence[ast.AST], path: Path) -> list[Import]:
    """All imports of a file, those inside functions too."""
    unseen = {id(inside) for node in nodes if is_type_checking(node) for inside in ast.walk(node)}
    return [
        Import(path, node.lineno, target, id(node) in unseen)  # type: ignore[attr-defined]  # what imports has a line
        for node in nodes
        for target in targets(node, path)
    ]


#: Underscores that are part of a public interface: of named tuples, and the translation.
PUBLIC = {"_", "_fields", "_replace", "_asdict", "_make"}
OURS = {"ctlabs", "tasks", "tests"}


def private(nodes: Sequence[ast.AST]) -> list[str]:
    """The private names of other modules of ours that a module uses, with their lines.

    A module whose own name begins with an underscore is shared by its folder (a lab's second half, the front doors); its public
    names are public.
    """
    found, known = [], set()
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in OURS:
            known |= {alias.asname or alias.name for alias in node.names}
            found += [
                f"{node.lineno}: from {node.module} import {alias.name}"
                for alias in node.names
                if alias.name.startswith("_") and alias.name not in PUBLIC
                and not alias.name.startswith("__") and node.module != "ctlabs.tasks"
            ]  # fmt: skip
        elif isinstance(node, ast.Import):
            known |= {
                alias.asname or alias.name.split(".")[0] for alias in node.names if alias.name.split(".")[0] in OURS
            }
    for node in nodes:
        if isinstance(node, ast.Attribute) and node.attr.startswith("_") and not node.attr.startswith("__"):
            base: ast.expr = node.value
            while isinstance(base, ast.Attribute):
                base = base.value
            if isinstance(base, ast.Name) and base.id in known and node.attr not in PUBLIC:
                found.append(f"{node.lineno}: {ast.unparse(node)}")
    return found
