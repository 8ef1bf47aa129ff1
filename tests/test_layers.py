"""The architecture: rooms, arrows that go down, public names, one home for every heavy dependency, and an import that costs nothing."""

from __future__ import annotations

import ast
import subprocess
import sys
from functools import cache
from graphlib import TopologicalSorter
from importlib import import_module
from pathlib import Path

import pytest

import ctlabs
from tests.sources import Import, dotted, imports, looked_at, private, read, targets

pytestmark = pytest.mark.xdist_group("sources")  # one worker reads them

ROOT = Path(ctlabs.__file__).parent

#: The rooms of ctlabs, lowest first, and what each may import. Every arrow goes down, and every one is needed.
ROOMS: dict[str, set[str]] = {
    "text": set(),
    "_front": set(),
    "linalg": set(),
    "models": {"text", "_front", "linalg"},
    "filtering": {"text", "_front", "linalg", "models"},
    "analysis": {"text", "_front", "linalg", "models", "filtering"},
    "montecarlo": {"text", "linalg", "models", "filtering"},
    "files": {"text", "_front", "linalg", "models", "filtering"},
    "regulation": {"_front", "linalg", "models", "filtering", "analysis", "montecarlo", "files"},
    "reporting": {"text", "_front", "linalg", "filtering", "montecarlo"},
    "labs": {"text", "models", "filtering", "analysis", "montecarlo", "reporting"},
    "studies": {"text", "linalg", "models", "filtering", "analysis", "montecarlo", "files", "regulation", "reporting", "labs"},
    "course": {"text", "linalg", "montecarlo", "files", "reporting", "labs"},
    "workbench": {
        "text",
        "linalg",
        "models",
        "filtering",
        "analysis",
        "montecarlo",
        "files",
        "regulation",
        "reporting",
        "labs",
        "studies",
        "course",
    },
    "cli": {"text", "linalg", "montecarlo", "files", "reporting", "labs", "studies", "course", "workbench"},
    "__main__": {"cli"},
}

FILES = sorted(path for path in ROOT.rglob("*.py") if "__pycache__" not in path.parts)


MODULES = {dotted(path) for path in FILES}


def room(module: str) -> str | None:
    """The room a full name belongs to ("ctlabs.models.linear" → "models"); None outside and for ctlabs itself."""
    parts = module.split(".")
    return parts[1] if parts[0] == "ctlabs" and len(parts) > 1 else None


@cache
def every() -> list[Import]:
    """All imports of the library."""
    return [found for path in FILES for found in read(path).imports]


def internal() -> list[Import]:
    """Those of its own modules. ctlabs/__init__.py only names what is loaded lazily; the arrows are those of the modules."""
    return [i for i in every() if i.target.startswith("ctlabs.") and i.file != ROOT / "__init__.py"]


#: What the front doors name, and the module that is its home: ctlabs.models.discretise → ctlabs.models.discretisation.discretise.
DOORS = {
    f"{dotted(path)}.{name}": f"{dotted(path)}.{home}.{name}"
    for path in FILES
    if path.name == "__init__.py"
    for node in ast.parse(path.read_text(encoding="utf-8")).body
    if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "_HOME"
    for name, home in ast.literal_eval(node.value).items()
}


def at_home(target: str) -> str:
    """A full name with the module in which it is defined, where a front door names it."""
    while target in DOORS:
        target = DOORS[target]
    return target


def home(found: Import) -> str:
    """The room that imports."""
    return room(dotted(found.file)) or "ctlabs"


def forbidden(found: Import) -> bool:
    """Whether the table has no arrow for an import ("from ctlabs import __version__" is the version's, and no room's)."""
    target = room(at_home(found.target))
    return target not in {home(found), "__version__", *ROOMS[home(found)]}


def test_every_room_is_in_the_table_and_every_arrow_goes_down() -> None:
    """A new room is entered above, where what it may import is a decision."""
    assert {room(dotted(path)) for path in FILES} - {None} == set(ROOMS)
    order = list(ROOMS)
    assert [(a, b) for a, below in ROOMS.items() for b in below if order.index(b) >= order.index(a)] == []


def test_the_walk_sees_imports_of_every_kind() -> None:
    """Inside functions, relative, by importlib, and under TYPE_CHECKING."""
    source = """
import a.b
from ctlabs import filtering, kalman_filter
from .base import lines
if TYPE_CHECKING:
    from ctlabs.models import at
def f():
    import control
    importlib.import_module("filterpy.kalman")
"""
    path = ROOT / "reporting" / "plots" / "somewhere.py"
    found = {i.target: i.typing_only for i in imports(looked_at(ast.parse(source)), path)}
    assert set(found) == {
        "a.b", "ctlabs.filtering", "ctlabs.kalman_filter", "ctlabs.reporting.plots.base.lines", "ctlabs.models.at", "control",
        "filterpy.kalman",
    }  # fmt: skip
    assert [target for target, typing_only in found.items() if typing_only] == ["ctlabs.models.at"]
    assert targets(ast.parse("from . import base").body[0], ROOT / "models" / "__init__.py") == ["ctlabs.models.base"]
    assert at_home("ctlabs.kalman_filter") == "ctlabs.filtering.filter.kalman_filter"
    assert len(internal()) > 200


def test_rooms_import_from_rooms_below_only() -> None:
    """As the table says: at the top of a file, inside a function, through importlib, and for type checkers alike."""
    assert [str(i) for i in internal() if forbidden(i)] == []


def test_no_arrow_is_idle() -> None:
    """What the table allows is used."""
    used = {(home(i), room(at_home(i.target))) for i in internal()}
    assert [(a, b) for a, below in ROOMS.items() for b in below if (a, b) not in used] == []


def test_there_are_no_cycles() -> None:
    """The graph of imports between modules can be sorted, packages opened up and what type checkers see included."""
    graph: dict[str, set[str]] = {module: set() for module in MODULES}
    for found in internal():
        source, target = dotted(found.file), at_home(found.target)
        while target not in MODULES and "." in target:
            target = target.rpartition(".")[0]
        # A package's __init__ names what is in it; a module of it that imports a sibling passes through no cycle.
        if target not in {source, "ctlabs"} and not source.startswith(f"{target}."):
            graph[source].add(target)
    TopologicalSorter(graph).prepare()


def test_no_private_name_of_another_module_is_used() -> None:
    """A module that other modules need exports what they need: in the library, the labs and the tests."""
    source = """
from ctlabs.filtering import bayes
from ctlabs.models.linear import _labels
from ctlabs.text import _
bayes._noise(_)
bayes.potter._fields
"""
    assert private(looked_at(ast.parse(source))) == ["3: from ctlabs.models.linear import _labels", "5: bayes._noise"]
    files = [*FILES, *(p for folder in ("tasks", "tests") for p in sorted((ROOT.parent / folder).rglob("*.py")))]
    used = [
        f"{p.relative_to(ROOT.parent)}:{line}"
        for p in files
        for line in read(p).private
    ]
    assert used == []


def test_a_class_has_its_name_alone() -> None:
    """One meaning for each public name, but for what a form of the filter carries, which each of them calls its State."""
    homes: dict[str, list[str]] = {}
    for path in FILES:
        for name in read(path).classes:
            if not name.startswith("_"):
                homes.setdefault(name, []).append(path.relative_to(ROOT).as_posix())
    several = {name: where for name, where in homes.items() if len(where) > 1}
    assert {each.rpartition("/")[0] for each in several.pop("State")} == {"filtering/algorithms"}
    assert several == {}


#: Where a dependency may be imported; a test of every row below shows that the row is not empty talk.
HOMES = {
    "filterpy": {"filtering/engines/adapter.py", "models/interop.py"},
    "control": {"linalg", "models", "filtering/bucy.py"},
    "matplotlib": {"files", "labs", "reporting", "studies", "workbench", "cli"},
    "pydantic": {"files", "labs", "reporting", "studies", "workbench", "cli"},
}


@pytest.mark.parametrize("package", HOMES)
def test_dependencies_have_homes(package: str) -> None:
    """filterpy in its adapter and the exports, python-control where systems are, pydantic at the edge, matplotlib in pictures."""
    users = {
        i.file.relative_to(ROOT).as_posix(): str(i)
        for i in every()
        if i.target.split(".")[0] == package and not i.typing_only
    }
    assert [
        s for user, s in users.items() if not any(user == h or user.startswith(f"{h}/") for h in HOMES[package])
    ] == []
    assert users, f"nobody uses {package}"


def test_nobody_imports_pyplot() -> None:
    """Figures are objects; pyplot's list of open figures is global state. Labs, tests and benchmarks keep to it too."""
    files = [*FILES, *(p for d in ("tasks", "tests", "benchmarks") for p in (ROOT.parent / d).rglob("*.py"))]
    for path in files:
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if "pyplot" in text else ():
            assert not [t for t in targets(node, path) if "pyplot" in t], path


def test_only_the_catalogue_reaches_the_labs() -> None:
    """No module imports ctlabs.tasks; the catalogue finds them, by name."""
    assert [str(i) for i in internal() if room(i.target) == "tasks"] == []
    naming = {
        path.relative_to(ROOT).as_posix()
        for path in FILES
        if "ctlabs.tasks" in (text := path.read_text(encoding="utf-8"))
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.startswith("ctlabs.tasks")
    }
    assert naming <= {"labs/catalogue.py"}


def loaded(statement: str) -> set[str]:
    """The packages in sys.modules of a fresh interpreter after a statement."""
    code = f"import sys; {statement}; print(' '.join({{name.split('.')[0] for name in sys.modules}}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT.parent)
    return set(done.stdout.split())


HEAVY = {"filterpy", "control", "matplotlib", "sympy", "numba", "scipy", "pandas", "pydantic", "jinja2", "numpy"}


def test_importing_ctlabs_costs_nothing() -> None:
    """None of the dependencies is loaded by ``import ctlabs``."""
    assert loaded("import ctlabs") & HEAVY == set()


@pytest.mark.parametrize(
    "module", ["models", "models.discretisation", "filtering.filter", "filtering.steady", "analysis.sensitivity"]
)
def test_modules_load_their_dependencies_when_needed(module: str) -> None:
    """filterpy, python-control, matplotlib, sympy and numba are loaded by the call that needs them, not by the import."""
    heavy = {"filterpy", "control", "matplotlib", "sympy", "numba", "pydantic"}
    assert loaded(f"import ctlabs.{module}") & heavy == set()


FRONT_DOORS = ["ctlabs", *(f"ctlabs.{name}" for name in ROOMS if (ROOT / name / "__init__.py").exists())]


@pytest.mark.parametrize("package", FRONT_DOORS)
def test_what_a_front_door_names_is_there_and_explained(package: str) -> None:
    """Every name of ``__all__`` resolves and has a docstring; the functions of the main door have an example that runs."""
    door = import_module(package)
    names = getattr(door, "__all__", ())
    assert sorted(names) == list(names)
    assert set(names) <= set(dir(door)) or package != "ctlabs"
    for name in names:
        doc = getattr(door, name).__doc__
        assert doc, name
        if package == "ctlabs":
            assert ">>>" in doc, name


@pytest.mark.parametrize(
    "package", sorted(module for module in MODULES if any(m.startswith(f"{module}.") for m in MODULES))
)
def test_modules_and_verbs_do_not_share_names(package: str) -> None:
    """``ctlabs.discretise`` is a function, whatever was imported before: no module of a package has the name of what it offers."""
    inside = {
        module.removeprefix(f"{package}.").split(".")[0] for module in MODULES if module.startswith(f"{package}.")
    }
    offered = {name.rpartition(".")[2] for name in DOORS if name.rpartition(".")[0] == package}
    assert inside & offered == set()


def test_lazy_names_are_the_types_and_verbs_they_name() -> None:
    """``ctlabs.covariances`` and ``ctlabs.DiscreteModel`` work after ``import ctlabs`` alone; unknown names say so."""
    assert "filterpy" in loaded("import ctlabs.filtering; ctlabs.filtering.update([[1]], [[1]], [[1]])")
    from ctlabs.filtering import kalman_filter
    from ctlabs.models.linear import DiscreteModel

    assert ctlabs.DiscreteModel is DiscreteModel
    assert ctlabs.kalman_filter is kalman_filter
    assert {"kalman_filter", "DiscreteModel"} <= set(dir(ctlabs))
    with pytest.raises(AttributeError, match="module 'ctlabs' has no attribute 'nonsense'"):
        _ = ctlabs.nonsense
