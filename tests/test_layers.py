"""The architecture: layers, no cycles, one home for every heavy dependency, and an import that costs nothing."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path
from typing import NamedTuple

import pytest

import ctlabs

ROOT = Path(ctlabs.__file__).parent

#: Modules and packages of ctlabs, lowest layer first. A name that does not exist yet is no error; one that is missing here is.
LAYERS: list[set[str]] = [
    {"_check", "compiled", "linalg", "text"},
    {"models", "interop"},
    {"discretise", "shaping", "kinematics", "observability", "spectra", "symbolic", "linearise"},
    {
        "between",
        "bucy",
        "contradictions",
        "forms",
        "kalman",
        "online",
        "records",
        "recursions",
        "smoothing",
        "steady",
        "updates",
        "varying",
    },
    {
        "bayes",
        "diagnosis",
        "experiment",
        "export",
        "fields",
        "fitting",
        "likelihood",
        "maximum",
        "montecarlo",
        "reduced",
        "scheduling",
        "sensitivity",
    },
    {"datafile", "mathml", "modelfile", "params", "plots", "portrait", "render", "report", "studies"},
    {"labs", "cli", "workbench", "__main__"},
]
LAYER = {name: number for number, names in enumerate(LAYERS) for name in names}

FILES = sorted(path for path in ROOT.rglob("*.py") if "__pycache__" not in path.parts)


class Import(NamedTuple):
    """Who imports what, where, and whether only type checkers see it."""

    file: Path
    line: int
    target: str
    typing_only: bool

    def __str__(self) -> str:
        return f"{self.file.relative_to(ROOT)}:{self.line} imports {self.target}"


def dotted(path: Path) -> str:
    """The module's full name."""
    parts = ["ctlabs", *path.relative_to(ROOT).with_suffix("").parts]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {dotted(path) for path in FILES}


def unit(module: str) -> str | None:
    """The part of ctlabs a full name belongs to ("ctlabs.plots.base" → "plots"); None outside and for ctlabs itself."""
    parts = module.split(".")
    return parts[1] if parts[0] == "ctlabs" and len(parts) > 1 else None


def is_type_checking(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


def targets(node: ast.AST, path: Path) -> list[str]:
    """Full names that a statement imports; "from ctlabs import kalman" is ctlabs.kalman."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        base = node.module or ""
        if node.level:
            package = dotted(path).split(".") if path.name == "__init__.py" else dotted(path).split(".")[:-1]
            base = ".".join([*package[: len(package) - node.level + 1], *([base] if base else [])])
        return [f"{base}.{alias.name}" for alias in node.names]
    if isinstance(node, ast.Call) and ast.unparse(node.func) in {
        "import_module",
        "importlib.import_module",
        "__import__",
    }:
        first = node.args[0]
        return [first.value] if isinstance(first, ast.Constant) and isinstance(first.value, str) else []
    return []


def imports(path: Path) -> Iterator[Import]:
    """All imports of a file, those inside functions too."""

    def walk(node: ast.AST, typing_only: bool) -> Iterator[Import]:
        for child in ast.iter_child_nodes(node):
            inside = typing_only or is_type_checking(node)
            for target in targets(child, path):
                yield Import(path, child.lineno, target, inside)  # type: ignore[attr-defined]  # statements have lines
            yield from walk(child, inside)

    yield from walk(ast.parse(path.read_text(encoding="utf-8")), typing_only=False)


ALL = [found for path in FILES for found in imports(path)]
#: ctlabs/__init__.py only names what is loaded lazily; the layers are those of the modules.
INTERNAL = [i for i in ALL if i.target.startswith("ctlabs.") and i.file != ROOT / "__init__.py"]


def home(found: Import) -> str:
    """The part of ctlabs that imports."""
    return unit(dotted(found.file)) or "ctlabs"


def is_upwards(found: Import) -> bool:
    """Whether the target's layer is above (a module without a layer is the affair of the first test)."""
    return LAYER.get(unit(found.target) or "", 0) > LAYER.get(home(found), len(LAYERS))


def test_every_module_has_a_layer() -> None:
    """A new module is entered in the table above, where its layer is a decision."""
    assert {unit(dotted(path)) for path in FILES} - {None} <= set(LAYER)
    assert len(LAYER) == sum(map(len, LAYERS)), "a module stands in two layers"


def test_the_walk_sees_imports_of_every_kind() -> None:
    """Inside functions, relative, by importlib, and under TYPE_CHECKING."""
    source = """
import a.b
from ctlabs import kalman, steady
from .base import lines
if TYPE_CHECKING:
    from ctlabs.models import at
def f():
    import control
    importlib.import_module("filterpy.kalman")
"""
    path = ROOT / "plots" / "somewhere.py"
    tree, found = ast.parse(source), []
    for node in ast.walk(tree):
        found += targets(node, path)
    assert set(found) == {
        "a.b", "ctlabs.kalman", "ctlabs.steady", "ctlabs.plots.base.lines", "ctlabs.models.at", "control", "filterpy.kalman",
    }  # fmt: skip
    assert targets(ast.parse("from . import base").body[0], ROOT / "plots" / "__init__.py") == ["ctlabs.plots.base"]
    assert len(INTERNAL) > 20


def test_modules_import_from_their_own_or_lower_layers_only() -> None:
    """Not upwards: neither at the top of a file, nor inside a function, nor through importlib."""
    assert [str(i) for i in INTERNAL if not i.typing_only and is_upwards(i)] == []


def test_types_alone_are_no_way_around_the_layers() -> None:
    """An annotation may not look upwards either."""
    assert [str(i) for i in INTERNAL if i.typing_only and is_upwards(i)] == []


def test_there_are_no_cycles() -> None:
    """The graph of run-time imports between modules, packages opened up, can be sorted."""
    graph: dict[str, set[str]] = {module: set() for module in MODULES}
    for found in INTERNAL:
        source, target = dotted(found.file), found.target
        while target not in MODULES and "." in target:
            target = target.rpartition(".")[0]
        # A package's own __init__ collects its modules; a module below it that imports a sibling passes through no cycle.
        if not found.typing_only and target not in {source, "ctlabs"} and not source.startswith(f"{target}."):
            graph[source].add(target)
    TopologicalSorter(graph).prepare()


#: Where a dependency may be imported; a test of every row below shows that the row is not empty talk.
HOMES = {
    "filterpy": {"kalman", "interop"},
    "control": {"interop", "shaping", "bucy", "linalg", "observability"},
    "pydantic": set().union(*LAYERS[5:]),
    "matplotlib": set().union(*LAYERS[5:]),
}


@pytest.mark.parametrize("package", HOMES)
def test_dependencies_have_homes(package: str) -> None:
    """filterpy in kalman and interop, python-control where systems are, pydantic at the edge, matplotlib in pictures."""
    users = {home(i): str(i) for i in ALL if i.target.split(".")[0] == package and not i.typing_only}
    assert set(users) <= HOMES[package], users
    assert users, f"nobody uses {package}"


def test_nobody_imports_pyplot() -> None:
    """Figures are objects; pyplot's list of open figures is global state. Labs, tests and benchmarks keep to it too."""
    files = [*FILES, *(p for d in ("tasks", "tests", "benchmarks") for p in (ROOT.parent / d).rglob("*.py"))]
    for path in files:
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if "pyplot" in text else ():
            assert not [t for t in targets(node, path) if "pyplot" in t], path


def test_only_the_catalogue_reaches_the_labs() -> None:
    """No module imports ctlabs.tasks; labs finds them, by name."""
    assert [str(i) for i in INTERNAL if unit(i.target) == "tasks"] == []
    naming = {
        path.name
        for path in FILES
        if "ctlabs.tasks" in (text := path.read_text(encoding="utf-8"))
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.startswith("ctlabs.tasks")
    }
    assert naming <= {"labs.py"}


def loaded(statement: str) -> set[str]:
    """The packages in sys.modules of a fresh interpreter after a statement."""
    code = f"import sys; {statement}; print(' '.join({{name.split('.')[0] for name in sys.modules}}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT.parent)
    return set(done.stdout.split())


HEAVY = {"filterpy", "control", "matplotlib", "sympy", "numba", "scipy", "pandas", "pydantic", "jinja2", "numpy"}


def test_importing_ctlabs_costs_nothing() -> None:
    """None of the dependencies is loaded by ``import ctlabs``."""
    assert loaded("import ctlabs") & HEAVY == set()


@pytest.mark.parametrize("module", ["models", "discretise", "kalman", "steady"])
def test_modules_load_their_dependencies_when_needed(module: str) -> None:
    """filterpy, python-control, matplotlib, sympy and numba are loaded by the call that needs them, not by the import."""
    assert (
        loaded(f"import ctlabs.{module}") & {"filterpy", "control", "matplotlib", "sympy", "numba", "pydantic"} == set()
    )


def test_lazy_names_are_the_modules_and_types_they_name() -> None:
    """``ctlabs.kalman`` and ``ctlabs.DiscreteModel`` work after ``import ctlabs`` alone; unknown names say so."""
    assert "filterpy" in loaded("import ctlabs; ctlabs.kalman.update([[1]], [[1]], [[1]])")
    from ctlabs import models

    assert ctlabs.DiscreteModel is models.DiscreteModel
    assert {"kalman", "DiscreteModel"} <= set(dir(ctlabs))
    with pytest.raises(AttributeError, match="module 'ctlabs' has no attribute 'nonsense'"):
        _ = ctlabs.nonsense
