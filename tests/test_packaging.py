"""The project installs as a whole: packages, data, dependencies, the lazy front door, the wheel, the Makefile."""

import ast
import importlib.metadata
import io
import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from functools import cache
from pathlib import Path

import pytest

import ctlabs
from tests.sources import read

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
SETUPTOOLS = PROJECT["tool"]["setuptools"]


def run(*command: object, cwd: Path, env: dict[str, str] | None = None) -> subprocess.CompletedProcess[str]:
    """A finished command with its text; its own environment has no way back into the repository."""
    clean = {name: value for name, value in os.environ.items() if name not in {"PYTHONPATH", "MAKEFLAGS", "MAKELEVEL"}}
    arguments = [str(part) for part in command]
    return subprocess.run(
        arguments, cwd=cwd, env=clean | (env or {}), capture_output=True, text=True, encoding="utf-8", check=False
    )


def source_files() -> dict[Path, str]:
    """Every file of the two source folders and its path inside the wheel."""
    found = {}
    for folder, package in (("ctlabs", "ctlabs"), ("tasks", "ctlabs/tasks")):
        for path in sorted((ROOT / folder).rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts and path.suffix != ".po":
                found[path] = f"{package}/{path.relative_to(ROOT / folder).as_posix()}"
    return found


@pytest.mark.xdist_group("a group")
def test_a_group_of_tests_is_one(request):
    """pytest-xdist writes a group behind a test's name; where it silently does not, as with pytest 9.2, both workers run every lab."""
    if not request.config.getoption("loadgroup", default=False):
        pytest.skip("run without groups")
    assert request.node.nodeid.endswith("@a group")


def test_every_folder_with_code_is_a_listed_package():
    """A new subpackage that is not listed in pyproject.toml would be missing from the wheel."""
    modules = [Path(inside) for inside in source_files().values() if inside.endswith(".py")]
    folders = {module.parent.as_posix().replace("/", ".") for module in modules}
    assert sorted(folders) == SETUPTOOLS["packages"]
    assert (ROOT / SETUPTOOLS["package-dir"]["ctlabs.tasks"]).is_dir()


def test_every_data_file_is_listed_package_data():
    """Templates, style sheets and the typing marker reach the wheel."""
    home = SETUPTOOLS["package-dir"]
    folders = {
        ROOT / home.get(package, package.replace(".", "/")): found for package, found in SETUPTOOLS["package-data"].items()
    }
    listed = {path for folder, patterns in folders.items() for pattern in patterns for path in folder.glob(pattern)}
    data = {path for path in source_files() if path.suffix != ".py"}
    assert ROOT / "ctlabs/py.typed" in data
    assert data <= listed


def test_one_version_everywhere():
    """The citation and the changelog speak of the version in ctlabs/__init__.py, which is the package's."""
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.search(r"^version: (.*)$", citation, re.MULTILINE)[1] == ctlabs.__version__
    assert re.search(r"^## \[(\S+)\]", changelog, re.MULTILINE)[1] == ctlabs.__version__
    assert PROJECT["tool"]["setuptools"]["dynamic"]["version"]["attr"] == "ctlabs.__version__"


#: The sections of Keep a Changelog, in its order.
SECTIONS = ("Added", "Changed", "Deprecated", "Removed", "Fixed", "Security")


def test_the_changelog_is_kept():
    """Each version has sections of these names in this order, none of them empty, and its entries in the order of what they are about."""
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    versions = re.split(r"^## ", text, flags=re.MULTILINE)[1:]
    assert len(versions) >= 3
    for version in versions:
        heading, *parts = re.split(r"^### ", version, flags=re.MULTILINE)
        assert "\n- " not in heading, "an entry stands in no section"
        names = [part.partition("\n")[0] for part in parts]
        assert names == [name for name in SECTIONS if name in names]
        for part in parts:
            entries = re.findall(r"^- (.*)", part, re.MULTILINE)
            assert entries
            about = [re.sub(r"[*`_.-]", "", entry).strip().casefold() for entry in entries]
            assert about == sorted(about)


def test_what_the_project_says_of_itself_is_true():
    """The Pythons of the classifiers begin with the oldest that is admitted and are tried by the matrix; the marker of types is there."""
    project, told = PROJECT["project"], PROJECT["project"]["classifiers"]
    pythons = [version[1] for line in told if (version := re.fullmatch(r"Programming Language :: Python :: (3\.\d+)", line))]
    versions = re.search(r"^VERSIONS = (.*)$", (ROOT / ".ci/matrix.py").read_text(encoding="utf-8"), re.MULTILINE)
    assert set(pythons) <= set(ast.literal_eval(versions[1]))
    assert project["requires-python"] == f">={pythons[0]}"
    assert ("Typing :: Typed" in told) == (ROOT / "ctlabs/py.typed").exists()
    assert set(project.get("urls", {})) == set() or all(url.startswith("https://") for url in project["urls"].values())
    installing = (ROOT / "docs/howto/install.md").read_text(encoding="utf-8")
    assert ("not on a package index" in installing) == ("urls" not in project)  # RELEASING.md: both change together


#: The tests that read all sources: one worker does.
reads_sources = pytest.mark.xdist_group("sources")


def imported(folder: str) -> set[str]:
    """Top-level names of everything a folder's modules import, wherever in the file."""
    paths = list((ROOT / folder).rglob("*.py"))
    names = {found.target.split(".")[0] for path in paths for found in read(path).imports}
    siblings = {path.stem for path in (ROOT / folder).glob("*.py")}
    return names - set(sys.stdlib_module_names) - siblings - {"ctlabs", "tests", "tasks"}


def distributions(requirements: list[str]) -> set[str]:
    """The names of requirements, in one spelling."""
    plain = [name for line in requirements for name in re.match(r"[\w.\-\[]+", line)[0].split("[")]
    return {re.sub(r"[-_.]+", "-", name).lower() for name in plain}


@cache
def homes() -> dict[str, list[str]]:
    """The distributions that bring a module: those installed are read once."""
    return dict(importlib.metadata.packages_distributions())


#: Used where they are installed, asked for by no one: tables for those who have pandas, peers of the benchmarks; and pandoc's
#: interface, which has a distribution with pandoc and one without.
OPTIONAL = {"pandas", "jax", "dynamax", "pykalman", "pypandoc"}


@reads_sources
@pytest.mark.parametrize(
    ("folder", "extras"),
    [
        ("ctlabs", ["cluster", "print", "workbench"]),
        ("tasks", []),
        ("tests", ["cluster", "test", "workbench"]),
        ("benchmarks", ["cluster", "test", "workbench"]),
        ("docs/extensions", ["docs"]),
        ("docs/gallery", []),
    ],
    ids=["ctlabs", "tasks", "tests", "benchmarks", "extensions", "gallery"],
)
def test_every_import_is_a_declared_dependency(folder: str, extras: list[str]):
    """What the code imports is what pyproject.toml asks for, with a lower bound."""
    project = PROJECT["project"]
    lines = project["dependencies"] + [line for extra in extras for line in project["optional-dependencies"][extra]]
    for name in imported(folder) - OPTIONAL:
        declared = distributions(homes().get(name, [name])) & distributions(lines)
        assert declared, f"{folder} imports {name}, which no line of pyproject.toml brings"
    assert all(">=" in line for line in lines if not line.startswith("ctlabs["))


def test_lazy_names_are_those_that_type_checkers_see():
    """``__all__``, the imports for type checkers and the names that resolve are one list."""
    tree = ast.parse(Path(ctlabs.__file__).read_text(encoding="utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If))
    typed = [alias.name for node in block.body if isinstance(node, ast.ImportFrom) for alias in node.names]
    assert sorted(typed) == sorted(ctlabs.__all__)
    assert set(ctlabs.__all__) <= set(dir(ctlabs))
    for name in ctlabs.__all__:
        assert getattr(ctlabs, name).__name__.rpartition(".")[2] == name


def test_discretise_is_a_function_in_whatever_order_it_is_reached():
    """``ctlabs.discretise`` never changes its meaning: no import of a module puts itself in its place."""
    first, second = "import ctlabs; verb = ctlabs.discretise", "from ctlabs.models.discretisation import discretise"
    for code in (f"{first}; {second}", f"{second}; {first}"):
        done = run(sys.executable, "-c", f"{code}; assert callable(verb) and verb is discretise is ctlabs.discretise", cwd=ROOT)
        assert done.returncode == 0, done.stderr


def test_an_unknown_attribute_is_an_attribute_error():
    """A misspelt name fails as in any other module."""
    with pytest.raises(AttributeError, match="module 'ctlabs' has no attribute 'kalmann'"):
        _ = ctlabs.kalmann


@reads_sources
def test_import_ctlabs_loads_no_other_library():
    """``import ctlabs`` is instant: numpy and the rest are loaded when a name is first used."""
    code = "import sys, json, ctlabs; print(json.dumps(sorted({name.split('.')[0] for name in sys.modules})))"
    done = run(sys.executable, "-c", code, cwd=ROOT)
    loaded = set(json.loads(done.stdout)) - set(sys.stdlib_module_names)
    assert not loaded & (imported("ctlabs") | imported("tasks"))


def test_python_m_ctlabs_is_the_command():
    """``python -m ctlabs --help`` prints what ``ctlabs --help`` prints, in any folder."""
    done = run(sys.executable, "-m", "ctlabs", "--help", cwd=ROOT)
    assert done.returncode == 0
    assert done.stdout.startswith("Usage: ctlabs ")
    assert {"list", "show", "run"} <= set(re.findall(r"^ {2}(\w+)", done.stdout, re.MULTILINE))


needs_make = pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed (the pip lines do without)")


@needs_make
def test_make_alone_lists_the_targets():
    """``make`` without a target explains itself and installs nothing."""
    done = run("make", cwd=ROOT)
    assert done.returncode == 0
    shown = set(re.findall(r"^ {2}make (\w+)", done.stdout, re.MULTILINE))
    assert shown == {"help", "labs", "test", "slow", "check", "kernels", "docs", "matrix", "dist", "pictures", "bench", "clean"}


@needs_make
def test_make_refuses_a_python_that_is_too_old(tmp_path: Path):
    """Without Python ≥ 3.11 with venv, make says so in one line, names the way out and leaves nothing behind."""
    for name in ("Makefile", "pyproject.toml"):
        shutil.copy(ROOT / name, tmp_path)
    old = tmp_path / "python-old"
    old.write_text('#!/bin/sh\n[ "$1" = --version ] && echo "Python 3.8.10" && exit 0\nexit 1\n', encoding="utf-8")
    old.chmod(0o755)
    done = run("make", "labs", f"PYTHON={old}", cwd=tmp_path)
    assert done.returncode != 0
    assert "expected Python >= 3.11 with venv, received Python 3.8.10" in done.stderr.splitlines()[0]
    assert "PYTHON=" in done.stderr.splitlines()[0]
    assert not (tmp_path / ".venv").exists()


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel built from a copy of the sources."""
    place = tmp_path_factory.mktemp("build")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, place)
    for name in ("ctlabs", "tasks"):
        shutil.copytree(ROOT / name, place / name, ignore=shutil.ignore_patterns("__pycache__"))
    done = run(sys.executable, "-m", "build", "--wheel", "--outdir", place / "dist", place, cwd=place)
    assert done.returncode == 0, done.stdout + done.stderr
    return next((place / "dist").glob("ctlabs-*.whl"))


@pytest.mark.slow
@pytest.mark.xdist_group("wheel")
def test_the_wheel_holds_every_source_file(wheel: Path):
    """Nothing that works in the repository is missing from an installation."""
    inside = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    assert inside == set(source_files().values())


def installed(wheel: Path, venv: Path) -> Path:
    """The Python of a new environment with the wheel in it; the libraries are this environment's."""
    assert run(sys.executable, "-m", "venv", "--without-pip", venv, cwd=venv.parent).returncode == 0
    python = venv / ("Scripts" if os.name == "nt" else "bin") / "python"
    done = run(sys.executable, "-m", "pip", "--python", python, "install", "--no-deps", wheel, cwd=venv.parent)
    assert done.returncode == 0, done.stderr
    where = "import sysconfig; print(sysconfig.get_paths()['purelib'])"
    site = Path(run(python, "-c", where, cwd=venv.parent).stdout.strip())
    libraries = [path for path in sys.path if Path(path).name == "site-packages"]
    # Plain paths in a .pth file: the libraries are found there, an editable ctlabs is not.
    (site / "libraries.pth").write_text("\n".join(libraries) + "\n", encoding="utf-8")
    return python


@pytest.mark.slow
@pytest.mark.xdist_group("wheel")
def test_the_wheel_runs_a_lab_without_the_repository(wheel: Path, tmp_path: Path):
    """``pip install ctlabs-*.whl && ctlabs run 7`` works in an empty folder (the libraries are this environment's)."""
    venv = tmp_path / "venv"
    python = installed(wheel, venv)
    bin_folder = python.parent
    empty = tmp_path / "empty"
    empty.mkdir()

    here = run(python, "-c", "import ctlabs; print(ctlabs.__file__)", cwd=empty).stdout.strip()
    assert Path(here).is_relative_to(venv)
    listed = run(bin_folder / "ctlabs", "list", cwd=empty)
    assert listed.returncode == 0, listed.stderr
    assert re.search(r"^ *7 .*limits of the optimal filter", listed.stdout, re.MULTILINE)
    done = run(bin_folder / "ctlabs", "run", "7", "--runs", 50, "--out", "out", cwd=empty)
    assert done.returncode == 0, done.stderr
    result = json.loads((empty / "out/task07/results.json").read_text(encoding="utf-8"))
    assert result["checks"]
    assert all(check["passed"] for check in result["checks"])
    assert (empty / "out/task07/report.html").stat().st_size > 10_000
    assert [path.name for path in empty.iterdir()] == ["out"]


@pytest.mark.slow
@pytest.mark.xdist_group("wheel")
def test_a_commit_gives_the_same_archives_wherever_it_is_built(tmp_path: Path):
    """Wheel and source distribution of two copies of the sources, with other times and modes of files, are the same bytes."""
    found = []
    for place in (tmp_path / "one", tmp_path / "another" / "place"):
        place.mkdir(parents=True)
        for name in ("pyproject.toml", "README.md", "LICENSE"):
            shutil.copyfile(ROOT / name, place / name)
        for name in ("ctlabs", "tasks", ".ci"):
            shutil.copytree(ROOT / name, place / name, ignore=shutil.ignore_patterns("__pycache__"), copy_function=shutil.copyfile)
        (place / "README.md").chmod(0o600 if found else 0o644)
        done = run(sys.executable, place / ".ci/dist.py", place / "dist", cwd=place, env={"SOURCE_DATE_EPOCH": "1764000000"})
        assert done.returncode == 0, done.stderr
        found.append({path.name: path.read_bytes() for path in (place / "dist").iterdir()})
    assert len(found[0]) == 2
    assert found[0] == found[1]
    (archive,) = (data for name, data in found[0].items() if name.endswith(".tar.gz"))
    with tarfile.open(fileobj=io.BytesIO(archive)) as packed:
        inside = {name.partition("/")[2] for name in packed.getnames()}
    assert {path.relative_to(ROOT).as_posix() for path in source_files()} <= inside


#: What somebody writes who uses the library. The checkers must know its types: all lines are right but the last.
CONSUMER = """
import numpy as np

from ctlabs import DiscreteModel, kalman_filter, steady_state

model = DiscreteModel(Phi=[[1.0]], Qd=[[1.0]], H=[[1.0]], R=[[1.0]], P0=[[10.0]])
rows: int = kalman_filter(model, np.array([1.0, 2.0])).x_plus.shape[0]
bound: float = steady_state(model).error
steady_state(model).nothing
"""


@pytest.mark.slow
@pytest.mark.xdist_group("wheel")
@pytest.mark.parametrize("checker", ["mypy", "pyright"])
def test_types_are_known_outside(checker: str, wheel: Path, tmp_path: Path):
    """A type checker reads the installed package (py.typed): it finds the one attribute that does not exist, and nothing else."""
    pytest.importorskip(checker, reason=f"{checker} is not installed here; the extra `test` has it")
    python = installed(wheel, tmp_path / "venv")
    (tmp_path / "program.py").write_text(CONSUMER, encoding="utf-8")
    options = {
        "mypy": ["--strict", "--no-incremental", "--python-executable", python],
        "pyright": ["--pythonpath", python],
    }[checker]
    done = run(sys.executable, "-m", checker, *options, "program.py", cwd=tmp_path)
    errors = re.findall(r"program\.py:(\d+).*error", done.stdout)
    assert errors == ["9"], done.stdout + done.stderr
    assert '"nothing"' in done.stdout


def installations() -> set[tuple[str, str]]:
    """What every page, and every message of the package, types behind ``pip install``, and where."""
    from tests.test_docs import PAGES

    found = set()
    sources = (path for path in source_files() if path.suffix == ".py")
    for path in (*PAGES, ROOT / "SUPPORT.md", ROOT / "RELEASING.md", ROOT / "SECURITY.md", *sources):
        for line in re.findall(r"\bpip install ([^`#&\n]+)", path.read_text(encoding="utf-8")):
            words = re.sub(r"[\"')].*$", "", line.replace("-e ", "").strip(" '\"")).split()
            found |= {(word.removeprefix("dist/"), path.name) for word in words[:1]}
    return found


def test_every_line_that_installs_it_names_what_there_is():
    """No index has ctlabs: a clone, a wheel of this version, or an extra by name of what is installed; and the extras exist."""
    found, extras = installations(), set(PROJECT["project"]["optional-dependencies"])
    assert {".", "ctlabs-*.whl"} <= {what for what, _ in found}
    assert {"README.md", "install.md", "own-data.md", "CONTRIBUTING.md", "RELEASING.md"} <= {where for _, where in found}
    others = distributions(PROJECT["project"]["dependencies"])
    for what, where in found:
        if what in others:  # which an index has
            continue
        told = re.fullmatch(r"(\.|ctlabs-(\*|[\d.]+-py3-none-any)\.whl|ctlabs(?=\[))(?:\[([\w,]+)\])?", what)
        assert told, f"{where} installs {what}"
        assert told[2] in {None, "*", f"{ctlabs.__version__}-py3-none-any"}
        assert set((told[3] or "test").split(",")) <= extras


@pytest.mark.slow
@pytest.mark.xdist_group("wheel")
def test_the_lines_that_install_it_are_true(wheel: Path, tmp_path: Path):
    """Every way to install that a page types works: from a clone, editable, from a wheel, with extras that there are."""
    clone = tmp_path / "clone"
    clone.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, clone)
    for name in ("ctlabs", "tasks"):
        shutil.copytree(ROOT / name, clone / name, ignore=shutil.ignore_patterns("__pycache__"))
    for i, what in enumerate((["."], ["-e", "."], [str(wheel)])):
        venv = tmp_path / f"venv{i}"
        assert run(sys.executable, "-m", "venv", "--without-pip", venv, cwd=tmp_path).returncode == 0
        python = venv / ("Scripts" if os.name == "nt" else "bin") / "python"
        done = run(sys.executable, "-m", "pip", "--python", python, "install", "--no-deps", *what, cwd=clone)
        assert done.returncode == 0, done.stderr
        shown = run(python, "-c", "import importlib.metadata as m; print(m.version('ctlabs'))", cwd=tmp_path)
        assert shown.stdout.strip() == ctlabs.__version__
        # An extra by name is that of the version which is there: no index is asked for ctlabs.
        more = run(sys.executable, "-m", "pip", "--python", python, "install", "--no-deps", "--no-index", "ctlabs[print]", cwd=tmp_path)
        assert more.returncode == 0, more.stderr
