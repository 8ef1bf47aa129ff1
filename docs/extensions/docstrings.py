"""The reference from the docstrings: sections as lists, where each name is used, and links that find a name by any of its paths."""

from __future__ import annotations

import re
from typing import Any

import usage
from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util.nodes import make_refnode

#: The underlined headings of numpydoc that are used.
SECTION = re.compile(r"^(Parameters|Attributes|Returns|Yields|Raises|Fields|Notes|See Also|Examples)$")


def sections(lines: list[str]) -> list[str]:
    """A docstring with numpydoc's sections as definition lists, which take any text.

    >>> sections(["What.", "", "Parameters", "----------", "F, G : (n, n), 1/s", "    more", "", "Source: a book."])
    ['What.', '', '.. rubric:: Parameters', '', '**F, G**', '    (n, n), 1/s', '    more', '', 'Source: a book.']
    """
    found: list[str] = []
    inside = False
    for i, line in enumerate(lines):
        underlined = i + 1 < len(lines) and re.fullmatch(r"-{3,}", lines[i + 1].strip()) is not None
        if SECTION.match(line) and underlined:
            inside = True
            found += [*([""] if found and found[-1] else []), f".. rubric:: {line}", ""]
        elif re.fullmatch(r"-{3,}", line.strip()) and i and SECTION.match(lines[i - 1]):
            continue
        elif inside and (term := re.match(r"^([*\w][\w., *…/]*?) : (.*)$", line)):
            found += [f"**{term[1].replace('*', chr(92) + '*')}**", f"    {term[2]}"]
        else:
            inside = inside and not (line == "" and i + 1 < len(lines) and not ends(lines[i + 1 :]))
            found.append(line)
    return found


def ends(rest: list[str]) -> bool:
    """Whether a section goes on after a blank line: with a term, or a deeper line."""
    return bool(rest and (rest[0].startswith(" ") or re.match(r"^[*\w][\w., *…/]*? : ", rest[0])))


def plain(lines: list[str]) -> list[str]:
    r"""The signs that docstrings mean as they are, and reStructuredText does not: a bar, and what follows a literal.

    >>> plain(["a mode with |λ| ≥ 1, N(0, ``sd``²)", ".. math:: |z|"])
    ['a mode with \\|λ\\| ≥ 1, N(0, ``sd``\\ ²)', '.. math:: |z|']
    """
    found, text = [], True
    for line in lines:
        text = not line.startswith((".. math::", ">>>")) and (text or not line.strip())
        if text:
            parts = re.split(r"(``.+?``|`[^`]*`)", line)
            parts[::2] = [part.replace("|", r"\|") for part in parts[::2]]
            close = [i for i in range(1, len(parts), 2) if re.match(r"[^\s.,;:!?)\]}'\"/–-]", parts[i + 1])]
            for i in close:
                parts[i] += "\\ "
            line = "".join(parts)
        found.append(line)
    return found


def process(app: Sphinx, what: str, _name: str, thing: Any, _options: Any, lines: list[str]) -> None:
    """Sections of a docstring, and below it where the name is used."""
    lines[:] = plain(sections(lines))
    if what not in {"function", "class"}:
        return
    where = app.env.ctlabs_index.get(usage.home(thing))  # type: ignore[attr-defined]
    if where is None:
        return
    labs = [f":doc:`{title(lab)} </generated/labs/{lab}>`" for lab in where["labs"]]
    examples = [f":doc:`/generated/gallery/{path.removesuffix('.py')}`" for path in where["examples"]]
    lines += ["", ".. rst-class:: used", ""]
    lines += [f"Labs: {', '.join(labs)}."] if labs else []
    lines += ["", ".. rst-class:: used", ""] if labs and examples else []
    lines += [f"Examples: {', '.join(examples)}."] if examples else []
    lines += [""]


def title(lab: str) -> str:
    """A lab's name in a list: its number, or its name."""
    number = lab.removeprefix("task")
    return str(int(number)) if number.isdigit() else lab.replace("_", " ")


def remember(app: Sphinx) -> None:
    """Read the labs and the gallery once."""
    app.env.ctlabs_index = usage.index()  # type: ignore[attr-defined]


def resolve(app: Sphinx, env: BuildEnvironment, node: pending_xref, child: nodes.Element) -> nodes.Element | None:
    """A name of the library by another of its paths: the place where the same thing is documented; a private module as code."""
    if node.get("refdomain") != "py":
        return None
    target, module = node["reftarget"], node.get("py:module") or "ctlabs"
    domain = env.get_domain("py")
    homes = documented(env)
    parents = [module.rsplit(".", cut)[0] for cut in range(module.count(".") + 1)]
    for path in [target, *(f"{parent}.{target}" for parent in [module, *parents])]:
        thing = usage.found(path) if path.startswith("ctlabs") else None
        name = homes.get(usage.home(thing)) if thing is not None else None
        if name is not None:
            entry = domain.objects[name]  # type: ignore[attr-defined]
            return make_refnode(app.builder, node["refdoc"], entry.docname, entry.node_id, child, name)
        if thing is not None:  # known, and not part of the reference
            return child
    return None


def documented(env: BuildEnvironment) -> dict[str, str]:
    """By home the name under which a class or function is documented; the shortest, where there are several."""
    if not hasattr(env, "ctlabs_documented"):
        names = sorted(env.get_domain("py").objects, key=len, reverse=True)  # type: ignore[attr-defined]
        env.ctlabs_documented = {usage.home(usage.found(name)): name for name in names if usage.home(usage.found(name))}  # type: ignore[attr-defined]
    return env.ctlabs_documented  # type: ignore[attr-defined, no-any-return]


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect them."""
    app.connect("builder-inited", remember)
    app.connect("autodoc-process-docstring", process)
    app.connect("missing-reference", resolve)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
