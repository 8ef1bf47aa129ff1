"""Pages that are made from what the project has: the labs' reports, the reference of the library, the commands."""

from __future__ import annotations

import inspect
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import usage
from docstrings import plain
from sphinx.application import Sphinx

from ctlabs.cli import cli

ROOT = Path(__file__).parents[2]

#: The pages of the reference: the title, and the modules in the order in which they are shown. What a module takes from another
#: one is shown where it comes first.
REFERENCE = {
    "ctlabs": ("The front door", ["ctlabs"]),
    "models": (
        "Models",
        [
            "ctlabs.models",
            "ctlabs.models.shaping",
            "ctlabs.models.spectra",
            "ctlabs.models.kinematics",
            "ctlabs.models.linearisation",
            "ctlabs.models.observability",
            "ctlabs.models.symbolic",
            "ctlabs.models.interop",
            "ctlabs.models.field",
            "ctlabs.models.field.model",
            "ctlabs.models.field.stability",
        ],
    ),
    "filtering": (
        "Filtering",
        [
            "ctlabs.filtering",
            "ctlabs.filtering.steady",
            "ctlabs.filtering.bucy",
            "ctlabs.filtering.varying",
            "ctlabs.filtering.reduced",
            "ctlabs.filtering.bayes",
            "ctlabs.filtering.bias",
            "ctlabs.filtering.hypotheses",
            "ctlabs.filtering.between",
            "ctlabs.filtering.updates",
            "ctlabs.filtering.relinearised",
            "ctlabs.filtering.pointmass",
            "ctlabs.filtering.pairing",
            "ctlabs.filtering.extended",
            "ctlabs.filtering.fields",
            "ctlabs.filtering.contradictions",
            "ctlabs.filtering.disturbances",
            "ctlabs.filtering.algorithms.catalogue",
        ],
    ),
    "analysis": (
        "Analysis",
        [
            "ctlabs.analysis",
            "ctlabs.analysis.sensitivity",
            "ctlabs.analysis.budgets",
            "ctlabs.analysis.sources",
            "ctlabs.analysis.scheduling",
            "ctlabs.analysis.fitting",
            "ctlabs.analysis.diagnosis",
        ],
    ),
    "regulation": ("Regulation", ["ctlabs.regulation"]),
    "montecarlo": ("Experiments", ["ctlabs.montecarlo", "ctlabs.montecarlo.chance"]),
    "files": ("Files", ["ctlabs.files", "ctlabs.files.export", "ctlabs.files.modelfile", "ctlabs.files.datafile"]),
    "reporting": ("Reports and figures", ["ctlabs.reporting.report", "ctlabs.reporting.drawing", "ctlabs.reporting.plots"]),
    "text": ("Numbers and words", ["ctlabs.text"]),
}


def report(text: str) -> str:
    r"""A lab's report for the site: its anchors and the links to them as HTML, its neighbours as pages beside it.

    >>> report('## Aim<a id="aim"></a>\n\nSee [(1)](#aim), [lab 6](../task06/report.md).')
    '## Aim<a id="aim"></a>\n\nSee <a href="#aim">(1)</a>, [lab 6](task06.md).'
    """
    text = re.sub(r"\[(!\[[^\]]*\]\([^)]*\))\]\(#([\w-]+)\)", r'<a href="#\2">\1</a>', text)
    text = re.sub(r"\[((?:\\[\[\]]|[^\[\]])*)\]\(#([\w-]+)\)", r'<a href="#\2">\1</a>', text)
    text = re.sub(r"\]\(\.\./(\w+)/report\.md\)", r"](\1.md)", text)
    return re.sub(r"\]\(\.\./README\.md\)", "](index.md)", text)


def labs(place: Path) -> None:
    """The reports of ``reports/`` as pages, and the course's index as the first of them."""
    place.mkdir(parents=True, exist_ok=True)
    names = sorted((path.parent.name for path in (ROOT / "reports").glob("*/report.md")), key=lambda name: (not number(name), name))
    for path in (ROOT / "reports" / name / "report.md" for name in names):
        text = report(path.read_text(encoding="utf-8")).replace("](figures/", f"]({path.parent.name}/")
        write(place / f"{path.parent.name}.md", text)
        shutil.copytree(path.parent / "figures", place / path.parent.name, dirs_exist_ok=True)
    course = (ROOT / "reports" / "README.md").read_text(encoding="utf-8")
    course = re.sub(r"\]\((\w+)/report\.md\)", r"](\1.md)", course)
    head, _, rest = course.partition("\n")
    entries = [f"{number(name)}. {heading(place / f'{name}.md')} <{name}>" if number(name) else name for name in names]
    toctree = "\n".join(["```{toctree}", ":hidden:", "", "0. The method on one example <lab0>", *entries, "```"])
    write(place / "index.md", f"# The labs\n\n{toctree}\n\n{rest}" if head.startswith("# ") else course)
    lab0 = (ROOT / "reports" / "lab0.md").read_text(encoding="utf-8")
    lab0 = lab0.replace("\n### ", "\n## ")
    write(place / "lab0.md", re.sub(r"\]\((\w+)/report\.md\)", r"](\1.md)", report(lab0)).replace("](README.md)", "](index.md)"))
    for picture in (ROOT / "reports").glob("*.png"):
        shutil.copy(picture, place)


def number(lab: str) -> int:
    """The number of a lab of the practicum; 0 for another one."""
    plain = lab.removeprefix("task")
    return int(plain) if plain.isdigit() else 0


def heading(page: Path) -> str:
    """The title of a page."""
    return page.read_text(encoding="utf-8").partition("\n")[0].lstrip("# ")


def commands(group: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Every command below ``group`` by its whole name."""
    for name, command in group.commands.items():
        if isinstance(command, click.Group):
            yield from commands(command, f"{path} {name}")
        else:
            yield f"{path} {name}", command


def command_page() -> str:
    """All commands with what ``--help`` says."""
    lines = ["# Commands", "", "What `ctlabs COMMAND --help` says. `python -m ctlabs` does the same.", ""]
    lines += ["```text", help_of(cli, "ctlabs"), "```", ""]
    for name, command in commands(cli, "ctlabs"):
        lines += [f"## {name}", "", "```text", help_of(command, name), "```", ""]
    return "\n".join(lines)


def help_of(command: Any, name: str) -> str:
    """The help of a command, 100 columns wide."""
    return str(command.get_help(click.Context(command, info_name=name, terminal_width=100, max_content_width=100)))


def public(module: Any) -> dict[str, Any]:
    """The classes and functions that a module is for: those of ``__all__``, else those that it defines itself."""
    names = getattr(module, "__all__", None) or [name for name in vars(module) if not name.startswith("_")]
    things = {name: getattr(module, name) for name in names}
    own = hasattr(module, "__all__")
    return {
        name: thing
        for name, thing in things.items()
        if (inspect.isfunction(thing) or inspect.isclass(thing))
        and usage.home(thing).startswith("ctlabs.")
        and (own or thing.__module__ == module.__name__)
    }


def summary(thing: Any) -> str:
    """The first sentence of a docstring, in one line."""
    text = " ".join((inspect.getdoc(thing) or "").partition("\n\n")[0].split())
    first = re.split(r"(?<=[.:])\s(?=[A-Z])", text, maxsplit=1)[0].rstrip(":").strip()
    return plain([first])[0]


def reference(place: Path) -> None:
    """The pages of the reference, one for each room of the library that there is."""
    shown: dict[str, str] = {}
    written = []
    for page, (title, modules) in REFERENCE.items():
        there = [module for module in map(usage.found, modules) if module is not None]
        if not there:
            continue
        lines = [title, "=" * len(title), ""]
        for module in there:
            lines += section(module, shown, single=len(there) == 1)
        write(place / f"{page}.rst", "\n".join(lines))
        written.append(page)
    for old in place.glob("*.rst"):
        if old.stem not in written:
            old.unlink()
    entries = "".join(f"   {page}\n" for page in written)
    write(place / "index.rst", f"The library's names\n===================\n\n.. toctree::\n\n{entries}")


def section(module: Any, shown: dict[str, str], *, single: bool) -> list[str]:
    """A module: what it is for, a table of its names, and each of them."""
    name = module.__name__
    here = {each: thing for each, thing in public(module).items() if shown.setdefault(usage.home(thing), name) == name}
    lines = [] if single else [name, "-" * len(name), ""]
    lines += [f".. automodule:: {name}", ""]
    lines += [".. rst-class:: names", ""] if here else []
    for each, thing in here.items():
        role = "class" if inspect.isclass(thing) else "func"
        lines += [f"- :{role}:`~{name}.{each}`: {summary(thing)}"]
    lines += [""]
    for each, thing in here.items():
        lines += [f".. autoclass:: {name}.{each}", "   :members:"] if inspect.isclass(thing) else [f".. autofunction:: {name}.{each}"]
        lines += [""]
    return lines


def write(path: Path, text: str) -> None:
    """Write what has changed, so that Sphinx reads anew only this."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def make(app: Sphinx) -> None:
    """Write the pages into ``generated/`` before the sources are looked for."""
    place = Path(app.srcdir) / "generated"
    labs(place / "labs")
    reference(place / "reference")
    write(place / "commands.md", command_page())


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect it."""
    app.connect("builder-inited", make, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
