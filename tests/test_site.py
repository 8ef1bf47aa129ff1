"""The site's examples are short and whole, and the reference knows where names are used; `make docs` runs the examples themselves."""

import ast
import importlib.util
import statistics
from pathlib import Path

import pytest

import ctlabs

ROOT = Path(__file__).parents[1]
EXAMPLES = sorted((ROOT / "docs" / "gallery").rglob("*.py"))


@pytest.fixture(scope="module")
def usage():
    """The module that reads where names are used."""
    spec = importlib.util.spec_from_file_location("usage", ROOT / "docs" / "extensions" / "usage.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("path", EXAMPLES, ids=[path.stem for path in EXAMPLES])
def test_an_example_is_one_idea_with_one_figure(path: Path):
    """A title, a text, at most forty lines, one figure, and nothing but public names."""
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    title, line, *rest = ast.get_docstring(tree).splitlines()
    assert set(line) == {"="}
    assert len(line) >= len(title)
    assert any(rest)
    assert len(text.splitlines()) <= 40
    assert text.count("plt.show()") == text.count("plt.subplots(") == 1
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert not [name for name in names if name.startswith("_")]


def test_the_gallery_is_large_and_its_examples_small():
    """Some twenty-five examples or more, half of them below forty lines by far."""
    assert len(EXAMPLES) >= 25
    assert statistics.median(len(path.read_text(encoding="utf-8").splitlines()) for path in EXAMPLES) <= 40
    assert all((folder / "GALLERY_HEADER.rst").exists() for folder in {path.parent for path in EXAMPLES})


def test_a_use_is_found_by_whatever_path_it_is_reached(usage):
    """A verb is the same from the front door, from its package and as a member of its module; words in texts are none."""
    for code in (
        "from ctlabs import smooth; smooth(1)",
        "from ctlabs.filtering import smooth as s; s(1)",
        "import ctlabs; ctlabs.smooth(1)",
        "from ctlabs.filtering import smoothing; smoothing.smooth(1)",
    ):
        assert usage.used(ast.parse(code)) == {"ctlabs.filtering.smoothing.smooth"}
    assert usage.used(ast.parse("'ctlabs.smooth'; smooth = 1")) == set()


def test_every_lab_and_most_of_the_front_door_are_in_the_index(usage):
    """Each lab uses something of the library, and of the front door only what reads files is in no lab and no example."""
    index = usage.index()
    labs = {lab for where in index.values() for lab in where["labs"]}
    assert labs == {path.parent.name for path in (ROOT / "reports").glob("*/results.json")}
    unused = {name for name in ctlabs.__all__ if usage.home(getattr(ctlabs, name)) not in index}
    assert unused <= {"Filter", "from_control", "read_model", "read_record"}
