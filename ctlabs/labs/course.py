"""The labs as a course: topics, variants, what each lab needs, one line of its result; the index of a folder of reports."""

from __future__ import annotations

import contextlib
import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from ctlabs.labs import method
from ctlabs.labs.catalogue import VARIANTS, Lab, catalogue, folder, halves, variant
from ctlabs.labs.sheets import bibliography
from ctlabs.reporting import render
from ctlabs.reporting.cells import verdict
from ctlabs.reporting.mathfont import font
from ctlabs.text import _, fill, translated


@dataclass(frozen=True, slots=True)
class Topic:
    """A chapter: its name, what it is about, and its labs."""

    name: str
    about: str
    labs: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Curriculum:
    """All chapters in their order, what each lab needs of earlier ones, and keys of the books."""

    topics: tuple[Topic, ...]
    needs: Mapping[str, tuple[str, ...]]
    books: tuple[str, ...]


@cache
def course() -> Curriculum:
    """The course, from ``tasks/course.toml``.

    >>> course().needs["task17"]
    ('task16',)
    """
    found = tomllib.loads((folder() / "course.toml").read_text(encoding="utf-8"))
    topics = tuple(Topic(each["name"], each["about"], tuple(each["labs"])) for each in found["topic"])
    return Curriculum(topics, {name: tuple(names) for name, names in found["needs"].items()}, tuple(found["books"]))


@dataclass(frozen=True, slots=True)
class LabRow:
    """What the index says of a lab; without a report there are no checks and no result."""

    lab: Lab
    needs: tuple[str, ...]
    variants: str
    result: str = ""
    checks: int = -1
    failed: tuple[str, ...] = ()

    @property
    def there(self) -> bool:
        """Whether it has a report."""
        return self.checks >= 0

    @property
    def good(self) -> bool:
        """Whether all its checks passed, of which there is one at least."""
        return self.checks > 0 and not self.failed

    @property
    def kind(self) -> str:
        """Its variants, or that it is an extension."""
        return translated("extension") if self.lab.extension else self.variants

    @property
    def verdict(self) -> str:
        """How its checks went."""
        return verdict(self.checks, list(self.failed)) if self.there else fill(_("not run yet: ctlabs run {lab}"), lab=self.lab.short)


def rows(out: Path) -> dict[str, LabRow]:
    """Every lab by name, with what the reports in ``out`` say."""
    starred = {letter: dict(variant(letter)) for letter in VARIANTS}
    found = {}
    for name, lab in catalogue().items():
        letters = ", ".join(letter.upper() + "*" * labs[name] for letter, labs in starred.items() if name in labs)
        found[name] = LabRow(lab, course().needs.get(name, ()), letters, **_reported(out / name / "results.json"))
    return found


def _reported(path: Path) -> dict[str, Any]:
    """What a results.json says of its lab; nothing where it is none of ours."""
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        result = json.loads(path.read_text(encoding="utf-8"))
        failed = tuple(check["name"] for check in result["checks"] if not check["passed"])
        return {"result": translated(result.get("result", "")), "checks": len(result["checks"]), "failed": failed}
    return {}


def write_index(out: Path, *, anew: bool = True) -> None:
    """``index.html`` and ``README.md`` in ``out``: the course with its reports, pass or fail at a glance; and lab 0.

    Lab 0 takes as long as another lab's report: not ``anew``, the one that is there stays, as the reports of the other labs do.
    """
    found = rows(out)
    if anew or not (out / "lab0.html").is_file():
        method.write(out)
    render.replace(out / "README.md", _markdown(found))
    books = [render.inline(bibliography()[key]) for key in course().books]
    equations = "".join(render.inline(row.result) for row in found.values())
    page = render.environment().get_template("index.html").render(
        topics=course().topics, rows=found, halves=_halves(found), books=books, inline=render.inline, short=_short, font=font(equations),
        mark=render.MARK, _=_,
    )  # fmt: skip
    render.replace(out / "index.html", page)


def _short(name: str) -> str:
    """What a lab is called in a list: 7, or its name."""
    return catalogue()[name].short


def _halves(found: Mapping[str, LabRow]) -> dict[str, list[list[tuple[str, str]]]]:
    """The two parts of each variant: names and words of their labs, control labs with a star."""
    return {
        letter.upper(): [[(name, _short(name) + "*" * starred) for name, starred in half if name in found] for half in halves(letter)]
        for letter in VARIANTS
    }


def _markdown(found: Mapping[str, LabRow]) -> str:
    """The index in Markdown, for a repository."""
    lines = [
        f"# {_('Optimal filtering: worked labs')}",
        _("Twenty-three labs of a practicum, three from papers and three extensions on control, each a worked report: theory by hand, a "
          "planned experiment, and checks by two routes. Begin with [lab 0](lab0.md), the method on one example."),
    ]  # fmt: skip
    for topic in course().topics:
        lines += [f"## {translated(topic.name)}", translated(topic.about)]
        heads = [_("lab"), _("title"), _("result"), _("needs"), _("variants"), _("checks")]
        table = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
        for name in (each for each in topic.labs if each in found):
            row = found[name]
            title = f"[{row.lab.short}]({name}/report.md)" if row.there else row.lab.short
            needs = ", ".join(map(_short, row.needs))
            result = row.result.replace("|", r"\|")
            table.append(f"| {title} | {translated(row.lab.title)} | {result} | {needs} | {row.kind} | {row.verdict} |")
        lines.append("\n".join(table))
    lines += [f"## {_('Variants')}", _("Twelve labs in two parts; a star marks a lab of the control session.")]
    columns = []
    for letter, parts in _halves(found).items():
        words = [" ".join(word.replace("*", r"\*") for _name, word in part) for part in parts]
        columns.append(f"| {letter} | {' | '.join(words)} |")
    lines.append("\n".join([f"| {_('variant')} | {_('first part')} | {_('second part')} |", "|---|---|---|", *columns]))
    lines += [f"## {_('Books')}", "\n".join(f"- {bibliography()[key]}" for key in course().books), render.MARK]
    return "\n\n".join(lines) + "\n"
