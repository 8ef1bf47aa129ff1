"""The site's examples are short and whole, and the reference knows where names are used; `make docs` runs the examples themselves."""

import ast
import importlib.util
import shutil
import statistics
import subprocess
import sys
from pathlib import Path

import pytest

import ctlabs

ROOT = Path(__file__).parents[1]
EXAMPLES = sorted((ROOT / "docs" / "gallery").rglob("*.py"))


def extension(name: str):
    """A module of the site's own."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / "extensions" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def usage():
    """The module that reads where names are used."""
    return extension("usage")


@pytest.fixture(scope="module")
def links():
    """The module that follows the site's links."""
    pytest.importorskip("sphinx", reason="sphinx is not installed: pip install -e '.[docs]'")
    return extension("links")


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


def test_a_link_that_leads_nowhere_is_found(links, tmp_path: Path):
    """A page, a place on it and a picture that are not there; what is there, and what is elsewhere, is none."""
    (tmp_path / "sub").mkdir()
    (tmp_path / "a.html").write_text('<p id="here"><a href="sub/b.html#place">', encoding="utf-8")
    page = '<p id="place"><a href="../a.html#here"><a href="#place"><a href="https://example.org/x"><a href="../a.html#gone">'
    (tmp_path / "sub" / "b.html").write_text(page + '<a href="c.html"><img src="../d.png">', encoding="utf-8")
    assert links.broken(tmp_path) == ["sub/b.html: ../a.html#gone", "sub/b.html: ../d.png", "sub/b.html: c.html"]


@pytest.mark.slow
def test_the_site_is_built_without_a_warning_and_its_links_lead_somewhere(links, tmp_path: Path):
    """All pages and every link inside them, in a copy; the examples of the gallery are not run here."""
    for name in ("furo", "myst_parser", "sphinx_gallery", "sphinx_copybutton"):
        pytest.importorskip(name, reason=f"{name} is not installed: pip install -e '.[docs]'")
    for path in ROOT.iterdir():
        if path.name != "docs" and not path.name.startswith("."):
            (tmp_path / path.name).symlink_to(path, target_is_directory=path.is_dir())
    shutil.copytree(ROOT / "docs", tmp_path / "docs", ignore=shutil.ignore_patterns("generated", "__pycache__"))
    site, quick = tmp_path / "site", ("-D", "sphinx_gallery_conf.plot_gallery=0")
    command = [sys.executable, "-m", "sphinx", "-W", "-n", "-q", "--keep-going", *quick, "docs", site]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert len(list(site.rglob("*.html"))) > 100
    assert links.broken(site) == []


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
